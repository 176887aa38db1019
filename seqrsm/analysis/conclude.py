"""Fit one application's scores and draw the conclusions: a pure function of runs, specification and seed."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from seqrsm.analysis.departed import departed_optimum_of, departed_text, departures_of, of_both, with_departure
from seqrsm.analysis.fitted import (
    CONFIRMATION,
    Fitted,
    compare_sources,
    confirmation_reason,
    fit_application,
    natural_ranges,
    range_text,
    region_history,
    scored_runs,
)
from seqrsm.analysis.posterior import (
    Draws,
    Sampler,
    central,
    draw_coefficients,
    effects_left_out,
    future_scores,
    outer_bounds,
    summarise_posterior,
)
from seqrsm.analysis.results import (
    Analysis,
    Confirmation,
    FactorImportance,
    Interval,
    OptimumEstimate,
)
from seqrsm.analysis.scale import ResponseScale
from seqrsm.analysis.study import study_fit
from seqrsm.analysis.surface import block_labels, shared_loadings
from seqrsm.arrays import FloatArray, IntArray
from seqrsm.decide.allowance import Departures
from seqrsm.decide.forecast import MODEL_ALPHA
from seqrsm.decide.intervals import Agreement, confirmation_agrees, confirmation_interval, counted_confirmation
from seqrsm.decide.stopping import Decision, StopRule, decide
from seqrsm.design.evaluate import is_saturated
from seqrsm.design.quadratic import QuadraticModel
from seqrsm.design.region import Region
from seqrsm.fit.anova import LackOfFit
from seqrsm.fit.canonical import StationaryPoint, stationary_point
from seqrsm.fit.importance import variance_shares
from seqrsm.fit.least_squares import LeastSquaresFit
from seqrsm.fit.optimum import Goal, Optimum, optimum
from seqrsm.fit.residuals import extrapolated, influential_runs
from seqrsm.plain import known
from seqrsm.spec.read import ApplicationSpec, CampaignSpec
from seqrsm.store.records import LookRecord, RunRecord

__all__ = ["CONFIRMATION", "analyse", "scored_runs", "stop_rule"]

_MIN_DF = 4
"""Residual degrees of freedom from which that test says something."""


def stop_rule(spec: CampaignSpec) -> StopRule:
    """The rule of ``[stop]``."""
    stop = spec.stop
    return StopRule(
        interval=stop.interval,
        half_width=stop.half_width,
        level=stop.level,
        max_runs=stop.max_runs,
        replicates=stop.replicates,
        guard=stop.guard,
        alpha_lack_of_fit=stop.lack_of_fit_alpha,
    )


def analyse(
    spec: CampaignSpec,
    application: ApplicationSpec,
    runs: Sequence[RunRecord],
    looks: Sequence[LookRecord],
    *,
    sampler: Sampler = "exact",
    n_draws: int = 4000,
    thorough: bool = False,
) -> Analysis:
    """Response surface, optimum, intervals, posterior and decision of one application.

    Parameters
    ----------
    spec : CampaignSpec
    application : ApplicationSpec
        One of ``spec.applications``.
    runs : sequence of RunRecord
        All runs; those that do not count are left out here.
    looks : sequence of LookRecord
        Earlier looks at this application, for the rule of two looks.
    sampler : "exact" or "emcee"
        How the posterior is drawn; with errors = "student_t" "exact" is a Gibbs sampler of exact conditionals.
    n_draws : int
        Posterior draws of the optimum.
    thorough : bool
        Add the study: regions of the optimum's place, averaging over models, paths and the rest.

    Raises
    ------
    FitError
        Fewer scores than terms.
    ConvergenceError
        emcee did not converge.
    """
    goal: Goal = application.goal
    fitted = fit_application(spec, application, runs)
    region, model, fit = fitted.region, fitted.model, fitted.fit
    best = optimum(model, region, fitted.beta, goal)
    draws = draw_coefficients(spec, fitted, sampler=sampler, n_draws=n_draws)
    departures = departures_of(fitted)
    of_quadratic = estimate = _estimate(spec, fitted, departures, best, draws)
    departed = departed_optimum_of(spec, fitted, departures, best)
    if departed is not None:
        estimate = _estimate(spec, fitted, departures, departed, draws, chosen=True)
    lack = fit.lack_of_fit()
    confirmation, agreement = _confirmation(spec, application, fitted, runs)
    decision = _decision(spec, application, fitted, estimate, lack, looks, agreement)
    posterior = summarise_posterior(spec, fitted, of_quadratic, draws, goal=goal)
    if departed is not None:  # what the settings may lose is not the quadratic's to say
        posterior = replace(posterior, expected_regret=math.nan, p_regret_above=math.nan)
    stationary = _stationary(model, region, fitted.beta, best)
    return Analysis(
        application=application.name,
        goal=goal,
        scale=fitted.scale,
        score_unit=application.unit,
        region=region,
        model=model,
        data=fitted.data,
        fit=fit,
        anova=fit.anova(),
        lack_of_fit=lack,
        importance=tuple(_importance(model, fit, fitted.beta)),
        stationary=stationary,
        optimum=estimate if departed is None else of_both(estimate, best),
        posterior=posterior,
        decision=decision,
        confirmation=confirmation,
        warnings=tuple(
            ([] if departed is None else [departed_text(spec, fitted, best)])
            + _warnings(spec, application, fitted, best if departed is None else departed)
            + effects_left_out(application, posterior)
        ),
        n_scored=fitted.n_scored,
        beta=fitted.beta,
        region_state=fitted.state,
        region_history=region_history(spec, fitted.state),
        sources=compare_sources(fitted, best.point, spec.stop.level),
        dropped=fitted.dropped,
        study=study_fit(spec, fitted, of_quadratic, stationary, draws) if thorough else None,
    )


def _estimate(
    spec: CampaignSpec,
    fitted: Fitted,
    departures: Departures | None,
    best: Optimum,
    draws: Draws,
    chosen: bool = False,
) -> OptimumEstimate:
    stop, scale = spec.stop, fitted.scale
    row = fitted.model.matrix(best.point[None, :])
    one = fitted.predict(row, stop.level, weight := scale.weight_at(fitted.predict(row).mean))
    several = fitted.predict(row, stop.level, weight, stop.replicates)

    def in_scores(low: FloatArray, high: FloatArray) -> Interval:
        return Interval(float(scale.to_score(low)[0]), float(scale.to_score(high)[0]))

    confidence = in_scores(one.confidence.low, one.confidence.high)
    prediction = in_scores(one.prediction.low, one.prediction.high)
    prediction_mean = in_scores(several.prediction.low, several.prediction.high)
    if spec.model.errors != "normal":
        # The t interval of least squares knows nothing of heavy tails or counts: these are quantiles of the posterior.
        futures = [future_scores(spec, fitted, draws, row[0], m) for m in (1, stop.replicates)]
        mean = scale.to_score(draws.terms @ row[0])
        confidence, prediction, prediction_mean = (central(x, stop.level) for x in (mean, *futures))
        # Where the mean is known far worse than runs scatter, the draws alone would make one shorter than the other.
        prediction_mean = prediction_mean.around(confidence)
        prediction = prediction.around(prediction_mean)
    hard = outer_bounds(spec.region, fitted.state.box, best.point)
    plain = (confidence, prediction, prediction_mean)
    return OptimumEstimate(
        settings=spec.region.decode(hard.point)[0],
        point=best.point,
        at_bound=hard.at_bound + tuple(f"constraint {expr}" for expr in best.active_constraints),
        mean=float(scale.to_score(one.mean)[0]),
        confidence=confidence,
        prediction=prediction,
        prediction_mean=prediction_mean,
        replicates=stop.replicates,
        level=stop.level,
        with_departure=with_departure(spec, fitted, departures, best, plain, chosen),
        ties=tuple(fitted.region.decode(best.ties)) if len(best.ties) else (),
        ridge=best.flat,
        exact=best.exact,
    )


def _importance(model: QuadraticModel, fit: LeastSquaresFit, beta: FloatArray) -> list[FactorImportance]:
    """Partial F of all terms of each factor (RSL TR 380-1 eq. 2-14) and variance shares, the most important first."""
    rows = []
    shares = variance_shares(model, beta)
    for j, factor in enumerate(model.factors):
        indices: IntArray = model.factor_terms(factor.name)
        both = float(shares.first_order[j]), float(shares.total[j])
        if not len(indices):  # every term of it was left out
            rows.append(FactorImportance(factor.name, 0, np.nan, np.nan, *both))
            continue
        test = fit.partial_f(indices)
        rows.append(FactorImportance(factor.name, test.df, test.f, test.p, *both))
    return sorted(rows, key=lambda row: -row.f if np.isfinite(row.f) else np.inf)


def _stationary(model: QuadraticModel, region: Region, beta: FloatArray, best: Optimum) -> StationaryPoint | None:
    if model.order == 1 or not region.numeric:
        return None
    return stationary_point(model, region, beta, tuple(int(best.point[j]) for j in region.categorical))


def _decision(
    spec: CampaignSpec,
    application: ApplicationSpec,
    fitted: Fitted,
    estimate: OptimumEstimate,
    lack: LackOfFit | str,
    looks: Sequence[LookRecord],
    agreement: Agreement | None,
) -> Decision:
    rule, fit = stop_rule(spec), fitted.fit
    widths = {
        "prediction": estimate.prediction.half_width,
        "prediction_mean": estimate.prediction_mean.half_width,
        "confidence": estimate.confidence.half_width,
    }
    earlier = [look for look in looks if look.after_run < fitted.n_scored]
    before = earlier[-1].summary if earlier else {}
    # Two looks at different regions are not two looks at the same thing.
    same = before.get("region", {}).get("ranges") in (None, _ranges(spec, fitted))
    return decide(
        rule,
        n_runs=fit.n_runs,
        # Terms that were left out by selection have used up their runs; random blocks are no terms.
        n_terms=(fit.n_terms if fitted.blocks is None else fitted.model.p) + len(fitted.dropped),
        s=fitted.s,
        df_residual=fitted.df_residual,
        df_pure_error=fit.df_pure_error,
        lack_of_fit_p=lack.p if isinstance(lack, LackOfFit) else None,
        lack_of_fit_reason=lack if isinstance(lack, str) else "",
        saturated=is_saturated(fitted.model, fitted.region),
        h=float(fitted.variance_unscaled(fitted.model.matrix(estimate.point[None, :]))[0]),
        half_width=widths[rule.interval],
        held_at_previous_look=bool(before.get("conditions_hold")) and same,
        model_p=_model_p(fitted),
        confirmation=agreement,
        unit=application.unit,
        n_spent=fitted.n_scored,
        n_before=earlier[-1].after_run if earlier else 0,
        departure=fitted.departure,
        widening=1.0 if estimate.with_departure is None else estimate.with_departure.widening,
    )


def _model_p(fitted: Fitted) -> float | None:
    """P of the F test of all terms, 1 of equal scores; None where nothing is left to test with, or no term to test."""
    all_terms = np.arange(1, fitted.model.p)
    if not fitted.fit.df_residual or not len(all_terms):
        return None
    return 1.0 if _all_equal(fitted) else fitted.fit.partial_f(all_terms).p


def _all_equal(fitted: Fitted) -> bool:
    return float(np.ptp(fitted.data.scores)) == 0.0


def _ranges(spec: CampaignSpec, fitted: Fitted) -> dict[str, list[float]]:
    return {name: list(ends) for name, ends in natural_ranges(spec.region, fitted.state.box).items()}


def _confirmation(
    spec: CampaignSpec, application: ApplicationSpec, fitted: Fitted, runs: Sequence[RunRecord]
) -> tuple[Confirmation | None, Agreement | None]:
    """The latest set of confirmation runs, against the model's prediction at their settings."""
    why = confirmation_reason(application.name)
    fresh = [run for run in runs if run.purpose == CONFIRMATION and run.state == "scored" and run.why == why]
    fresh = [run for run in fresh if run.batch == fresh[-1].batch and run.score_of(application.name) is not None]
    if len(fresh) < 2:
        return None, None
    scale = fitted.scale
    found = [score for run in fresh if (score := run.score_of(application.name)) is not None]
    scores = np.array([score.score for score in found])
    counts = [(score.correct, score.n) for score in found if score.correct is not None and score.n]
    if application.is_percent and len(counts) == len(found):
        right, trials = zip(*counts, strict=True)
        interval = counted_confirmation(right, trials, spec.stop.level)
    else:
        interval = confirmation_interval(scores, spec.stop.level)
    row = fitted.model.matrix(fitted.region.code([fresh[0].settings]))
    weight = float(scale.weight_at(fitted.predict(row).mean)[0])
    predicted = fitted.predict(row, spec.stop.level, weight, len(scores))
    fresh_scale = ResponseScale.of(spec.model.response, scores)
    agreement = confirmation_agrees(
        confirmation_interval(fresh_scale.values, spec.stop.level),
        predicted=float(predicted.mean[0]),
        s=fitted.s / np.sqrt(weight),
        df=fitted.df_residual,
        h=float(fitted.variance_unscaled(row)[0]) * weight,
        unit=application.unit,
    )
    low, high = (float(scale.to_score(end)[0]) for end in (predicted.prediction.low, predicted.prediction.high))
    verdict, half = "agrees with" if agreement.agrees else "contradicts", 0.5 * (interval.high - interval.low)
    measured = f"{known(interval.mean, half)} {application.unit}".rstrip()
    text = (
        f"{len(scores)} fresh runs at the recommended settings scored {measured} on average "
        f"({100 * spec.stop.level:g} % interval {known(interval.low, half)} to {known(interval.high, half)}); this "
        f"{verdict} the model, which predicted their mean between {known(low, half)} and {known(high, half)} "
        f"(p = {agreement.p:.2g})."
    )
    confirmation = Confirmation(
        run_ids=tuple(run.run_id for run in fresh),
        scores=tuple(float(score) for score in scores),
        mean=interval.mean,
        interval=Interval(interval.low, interval.high),
        agrees=agreement.agrees,
        text=text,
    )
    return confirmation, agreement


def _counts_shared_error(spec: CampaignSpec, fitted: Fitted) -> str:
    """Which intervals count an error that the scores of a rung share."""
    if fitted.sources is not None:
        return "that is part of the difference between flight and simulation, whose prior is [model] discrepancy_sd"
    if spec.model.errors != "normal":
        return "the posterior counts that, and all intervals, which are made of it"
    if fitted.blocks is not None:
        return (
            "the intervals with a departure allowed for count that, the posterior and the plain confidence and "
            "prediction intervals do not"
        )
    return (
        "the posterior and the intervals with a departure allowed for count that, the plain confidence and prediction "
        "intervals do not"
    )


def _warnings(spec: CampaignSpec, application: ApplicationSpec, fitted: Fitted, best: Optimum) -> list[str]:
    fit, data, state = fitted.fit, fitted.data, fitted.state
    found = []
    if fit.reason:
        found.append(f"No error estimate: {fit.reason}.")
    if not state.box.whole:
        found.append(
            f"The quadratic is fitted to a part of the region, {range_text(spec.region, state.box)}, with "
            f"{fit.n_runs} of {fitted.n_scored} runs: it failed in the whole."
        )
    if state.target is not None:
        found.append(
            "The scores spoke, at this look or an earlier one, against one quadratic for the whole; "
            f"{range_text(spec.region, state.target)} is being filled with runs and will take its place."
        )
    if state.box.whole:
        outside = int(np.count_nonzero(~fitted.region.feasible(data.points)))
        if outside:
            found.append(f"{outside} runs were made outside the region; they are part of the fit.")
    if fitted.blocks is None and len(set(block_labels(spec, data, with_source=False))) > 1:
        found.append("Blocks differ by fitted constants; the optimum's value is that of their plain mean.")
    if fitted.blocks is None and (spec.model.block_effect == "random" or fitted.occasions == 1):
        found.append("One block so far: how blocks differ is not known yet, and the intervals are for this block only.")
    if fitted.dropped:
        found.append(
            f"{len(fitted.dropped)} terms were left out by the same scores that are fitted: intervals hold given the "
            "terms that stay, and are too short for the doubt about them; `seqrsm fit` shows averages over models."
        )
    if fitted.blocks is not None and fitted.blocks.reason:
        found.append(f"{fitted.blocks.reason[:1].upper()}{fitted.blocks.reason[1:]}.")
    if fitted.sources is not None and fitted.sources.prior_driven:
        found.append(
            f"With {fitted.sources.n_flights} flights the difference between flight and simulation is mostly what the "
            "prior says ([model] discrepancy_sd)."
        )
    _, rungs = shared_loadings(data, fitted.scale)
    if rungs and data.model_bias is not None:
        found.append(
            f"Simulated scores of {' and '.join(rungs)} may be off together, by {2.0 * np.max(data.model_bias):.2g} at "
            f"most: {_counts_shared_error(spec, fitted)}."
        )
    if bool(extrapolated(fit, fitted.model.matrix(best.point[None, :]))[0]):
        found.append("The optimum is an extrapolation: it lies further from the runs than any run does.")
    found += [
        f"Run {data.run_ids[run.run]} stands out ({'; '.join(run.reasons)})."
        for run in influential_runs(fit)
        if any("outlier" in reason for reason in run.reasons)
    ]
    if best.flat:
        found.append("The optimum is a ridge: other settings are as good, see the canonical analysis.")
    if fit.condition_number > 1e3:
        found.append(f"The design is ill-conditioned (condition number {fit.condition_number:.2g}).")
    if fit.leverage_one_runs:
        ids = ", ".join(str(data.run_ids[i]) for i in fit.leverage_one_runs)
        found.append(f"The model must pass through run {ids} (leverage 1): its score cannot be checked.")
    if _all_equal(fitted):
        found.append("All scores are equal: there is no optimum to find, and every setting is as good.")
    elif fit.df_residual >= _MIN_DF and (p := _model_p(fitted)) is not None and p > MODEL_ALPHA:
        test = f"F test of all terms: p = {p:.2g}"
        found.append(f"No parameter is seen to matter ({test}): other settings may be as good.")
    counted = data.trials is not None and len(data.trials) > 0 and bool(np.all(np.isfinite(data.trials)))
    if application.is_percent and counted and (spec.model.weights, spec.model.errors) == ("equal", "normal"):
        found.append('Scores are counts: [model] weights = "counts" would let them count by their binomial variance.')
    if application.is_percent and spec.model.response == "identity" and len(data.scores):
        values = fitted.scale.to_score(fit.fitted)
        if np.max(values) > 95.0 or np.min(values) < 5.0:
            found.append('Fitted scores pass 95 % or fall below 5 %: [model] response = "logit" fits bounded scores.')
    return found
