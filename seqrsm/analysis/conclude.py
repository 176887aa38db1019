"""Fit one application's scores and draw the conclusions: a pure function of runs, specification and seed."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from seqrsm.analysis.belief import Fitted, intervals, intervals_by_draws
from seqrsm.analysis.fitted import confirmation_reason, fit_application
from seqrsm.analysis.gap import largest_gap
from seqrsm.analysis.ground import Ground
from seqrsm.analysis.optimism import optimism
from seqrsm.analysis.posterior import draw_coefficients, effects_left_out, summarise_posterior
from seqrsm.analysis.results import Analysis, Confirmation, FactorImportance, OptimumEstimate
from seqrsm.analysis.runs import NO_BLOCK, block_labels, evidence, former_factors
from seqrsm.analysis.scale import Interval
from seqrsm.analysis.steps import steps_of
from seqrsm.analysis.study import block_study
from seqrsm.arrays import FloatArray
from seqrsm.decide.confirmation import Agreement, confirmation_agrees, confirmation_interval, counted_confirmation
from seqrsm.decide.stopping import LACK_OF_FIT_ALPHA, MODEL_ALPHA, Decision, Look, StopRule, decide
from seqrsm.design.factors import settings_text
from seqrsm.design.quadratic import QuadraticModel
from seqrsm.fit.canonical import StationaryPoint, stationary_point, variance_shares
from seqrsm.fit.error_models import Draws, Sampler
from seqrsm.fit.intervals import LackOfFit, known, t_quantile
from seqrsm.fit.least_squares import LeastSquaresFit, extrapolated, influential_runs, known_scatter
from seqrsm.fit.optimum import Optimum, optimum, sign_of
from seqrsm.fit.robust import student_evidence
from seqrsm.rng import generator
from seqrsm.score.utilities import utility_of
from seqrsm.spec.read import CampaignSpec
from seqrsm.spec.sensors import without_effect
from seqrsm.spec.tables import ApplicationSpec, StopSpec
from seqrsm.store.records import CONFIRMATION, EventRecord, RunRecord

LOOK_DRAWS = 1000
"""Posterior draws of a look; by these the stop rule is held against its targets, so that all looks say the same."""

_WILD, _SURE = 2.0, math.log(1000.0)
"""Log evidence from which Student-t errors are offered, as in 2 % of looks at normal scores; and from which the ratio
is told as more than 1000."""

_MIN_DF = 4
"""Residual degrees of freedom from which that test says something."""

_SAME = 0.01
"""Coded settings so near are told as the same."""


def stop_rule(stop: StopSpec, ground_share: float = 0.0) -> StopRule:
    """The rule of ``[stop]``, with the share of a run's variance that is the ground's."""
    return StopRule(
        interval=stop.interval,
        half_width=stop.half_width,
        loss=math.inf if stop.loss is None else stop.loss,
        level=stop.level,
        max_runs=stop.max_runs,
        replicates=stop.replicates,
        guard=stop.guard,
        ground_share=ground_share,
        counts_ground=stop.worlds == "count",
    )


def as_found(rule: StopRule, fitted: Fitted, point: FloatArray) -> StopRule:
    """The rule with what scores tell: what a surface that is no quadratic asks, and what a day brings at a point (k,).

    That is common to future runs as a ground is.
    """
    rule = replace(rule, acting_terms=fitted.acting_terms())
    if not fitted.common_sd or rule.interval == "confidence":  # which is of the average block
        return rule
    return replace(rule, ground_share=(fitted.common_sd / fitted.scatter(point)[0]) ** 2, counts_ground=True)


def analyse(
    spec: CampaignSpec,
    application: ApplicationSpec,
    runs: Sequence[RunRecord],
    *,
    ground: Ground | None = None,
    ranked: Sequence[EventRecord] = (),
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
    ground : Ground or None
        What part of the scatter of simulated scores is one ground against another, where it was measured.
    ranked : sequence of EventRecord
        Of the kind `seqrsm.analysis.ground.RANKED`.
    sampler : "exact" or "emcee"
        How the posterior is drawn; with errors = "student_t" "exact" is a Gibbs sampler of exact conditionals.
    n_draws : int
        Posterior draws of the optimum.
    thorough : bool
        Add how blocks differ, the steps, and where no run was made.

    Raises
    ------
    FitError
        Fewer scores than terms.
    ConvergenceError
        emcee did not converge.
    """
    fitted = fit_application(spec, application, runs, ground)
    region, model, beta = fitted.region, fitted.model, fitted.surface.estimate
    of_quadratic = optimum(model, region, beta, fitted.goal)
    fitted = fitted.without_far(of_quadratic)
    draws = looked = draw_coefficients(spec, fitted, sampler=sampler, n_draws=n_draws)
    if (sampler, n_draws) != ("exact", LOOK_DRAWS):  # the rule is told by the draws of a look, or two would be
        looked = draw_coefficients(spec, fitted, sampler="exact", n_draws=LOOK_DRAWS)
    of_steps, alone = draws, looked
    if application.prior is not None:  # the recommended settings and the score there rest on the scores alone
        silent = replace(fitted, application=application.model_copy(update={"prior": None}))
        of_steps = alone = draw_coefficients(spec, silent, sampler="exact", n_draws=LOOK_DRAWS)
    best = fitted.best(of_quadratic, fitted.data.points, generator(spec.seed, fitted.fit.n_runs, "best settings"))
    rng = generator(spec.seed, fitted.fit.n_runs, "optimism")
    taken_off = optimism(fitted, best.point, rng)
    estimate = _possible(_estimate(spec, fitted, best, alone, taken_off), *application.score_limits)
    confirmation, agreement = _confirmation(spec, fitted, best.point, runs, taken_off)
    # Whether the score without an image is that of a map that exists.
    known_map = bool(spec.simulator and spec.simulator.known_map) and utility_of(application.utility).classifies
    posterior = summarise_posterior(spec, fitted, estimate, draws, looked, taken_off)
    loss = posterior.expected_regret
    decision = _decision(spec, fitted, estimate, loss, alone, agreement, known_map)
    stationary = _stationary(fitted, of_quadratic)
    return Analysis(
        application=application.name,
        goal=fitted.goal,
        score_unit=application.score_unit,
        fitted=fitted,
        importance=tuple(_importance(model, fitted.fit, beta)),
        stationary=stationary,
        of_quadratic=of_quadratic,
        optimum=estimate,
        posterior=posterior,
        decision=decision,
        confirmation=confirmation,
        known_map=known_map,
        warnings=(
            *_warnings(spec, fitted, best),
            *effects_left_out(application, posterior),
            *former_factors(region, runs, fitted.data),
        ),
        notes=tuple(
            _notes(spec, fitted, estimate)
            + ([f"The posterior was drawn {draws.instead}."] if sampler == "emcee" and draws.instead else [])
        ),
        steps=steps_of(fitted, estimate, of_steps, ranked, spec.seed) if thorough and fitted.surface.s > 0.0 else (),
        sources=fitted.surface.compare(best.point, spec.stop.level, application.score_unit),
        blocks=block_study(spec, fitted, best.point) if thorough else None,
        gap=largest_gap(region, fitted.data.points) if thorough else None,
        thorough=thorough,
    )


def _estimate(spec: CampaignSpec, fitted: Fitted, best: Optimum, draws: Draws, taken_off: float) -> OptimumEstimate:
    stop, scale, share = spec.stop, fitted.scale, fitted.ground_share
    whole, chance = (replace(stop_rule(stop, share), counts_ground=counts) for counts in (True, False))
    asked = (1.0, whole.replicates_of("prediction_mean"), whole.replicates_of(), chance.replicates_of())
    if fitted.surface.errors.exact:
        mean, found = intervals(fitted, best.point, stop.level, asked, taken_off)
    else:
        rng = generator(spec.seed, fitted.fit.n_runs, "predictive")
        mean, found = intervals_by_draws(fitted, best.point, stop.level, asked, taken_off, draws, rng)
    if fitted.surface.s == 0.0:  # no scatter was seen, which is not to say that there is none
        found = (Interval(math.nan, math.nan),) * len(found)
    if share == 0.0:  # one of these: draws are rounded to whole runs, and no end of runs on a new day is a mean
        watched = ("confidence", "prediction", "prediction_mean").index(stop.interval)
        found = (*found[:3], found[watched], found[watched])
    return OptimumEstimate(
        settings=fitted.region.decode(best.point)[0],
        point=best.point,
        at_bound=best.at_bound,
        active_constraints=best.active_constraints,
        mean=mean,
        optimism=float(scale.to_score(fitted.mean(best.point[None, :]))[0]) - mean if taken_off else 0.0,
        confidence=found[0],
        prediction=found[1],
        prediction_mean=found[2],
        replicates=stop.replicates,
        level=stop.level,
        whole=found[3],
        by_chance=found[4],
        ground=fitted.ground,
        ties=tuple(fitted.region.decode(best.ties)) if len(best.ties) else (),
        ridge=best.flat,
        exact=best.exact,
    )


def _possible(estimate: OptimumEstimate, low: float, high: float) -> OptimumEstimate:
    """The estimate cut to possible scores; half-widths that the stop rule watches are not shortened by that."""
    return replace(
        estimate,
        mean=min(max(estimate.mean, low), high),
        confidence=estimate.confidence.within(low, high),
        prediction=estimate.prediction.within(low, high),
        prediction_mean=estimate.prediction_mean.within(low, high),
        whole=estimate.whole.within(low, high),
        by_chance=estimate.by_chance.within(low, high),
    )


def _importance(model: QuadraticModel, fit: LeastSquaresFit, beta: FloatArray) -> list[FactorImportance]:
    """Partial F of all terms of each factor (RSL TR 380-1 eq. 2-14) and variance shares, the most important first."""
    rows = []
    for factor, alone, in_all in zip(model.factors, *variance_shares(model, beta), strict=True):
        test = fit.partial_f(model.factor_terms(factor.name))
        rows.append(FactorImportance(factor.name, test.df, test.f, test.p, float(alone), float(in_all)))
    return sorted(rows, key=lambda row: -row.f if np.isfinite(row.f) else np.inf)


def _stationary(fitted: Fitted, best: Optimum) -> StationaryPoint | None:
    model, region, surface = fitted.model, fitted.region, fitted.surface
    if model.order == 1 or not region.numeric:
        return None
    levels, variance = tuple(int(best.point[j]) for j in region.categorical), known_scatter(surface.s) ** 2
    return stationary_point(
        model, region, surface.estimate, levels, lambda rows: variance * surface.variance_unscaled(rows)
    )


def _decision(
    spec: CampaignSpec,
    fitted: Fitted,
    estimate: OptimumEstimate,
    loss: float,
    draws: Draws,
    agreement: Agreement | None,
    known_map: bool,
) -> Decision:
    application = fitted.application
    rule = as_found(stop_rule(spec.stop_of(application.name), fitted.ground_share), fitted, estimate.point)
    fit, surface = fitted.fit, fitted.surface
    _, h = fitted.scatter(estimate.point)
    reach = float(t_quantile(np.inf, rule.level))
    of_run = fitted.sd_of_run(estimate.point, reach)
    if surface.errors.of_counts:  # which near 100 % scatter less to either side than logits do
        rng, here = generator(spec.seed, fit.n_runs, "scatter"), fitted.mean(estimate.point[None, :])
        runs = surface.errors.future_scores(draws, fitted.scale, np.tile(here, len(draws.sigma)), 1, rng)
        of_run = float(np.ptp(np.quantile(runs, [0.5 - 0.5 * rule.level, 0.5 + 0.5 * rule.level]))) / (2.0 * reach)
    lack = fit.lack_of_fit()
    look = Look(
        n_runs=fit.n_runs,
        n_terms=surface.n_terms,
        s=known_scatter(of_run),
        df_residual=surface.df_residual,
        df_pure_error=fit.df_pure_error,
        h=h,
        loss=loss,
        half_width=(estimate.whole if rule.counts_ground else estimate.by_chance).half_width,
        model_p=_model_p(fitted),
        guess=None if np.isnan(fitted.data.guess) else fitted.data.guess,
        known_map=known_map,
        lead=(estimate.mean - fitted.data.guess) * sign_of(application.goal),
        lack_of_fit=lack.p if isinstance(lack, LackOfFit) else lack,
        weighed=fitted.departure.process is not None,
        saturated=fitted.region.has_at_most(fitted.model.p),
        n_confirmation=fitted.data.purposes.count(CONFIRMATION),
        one_block=_one_block(spec, fitted),
        n_flights=fitted.data.sources.count("flight") if len(set(fitted.data.sources)) > 1 else None,
    )
    return decide(rule, look, agreement, application.score_unit)


def _gain_of_student(fitted: Fitted) -> float:
    """Log evidence for Student-t over normal errors of measured scores; 0 where another surface explains them better.

    Both are weighed against the quadratic with normal errors.
    """
    fit, surface = fitted.fit, fitted.surface
    if not surface.errors.exact or set(fitted.data.sources) != {"flight"}:  # no simulation goes wrong
        return 0.0
    gain, of_process = student_evidence(fit.Z, fit.y, fit.weights), fitted.departure.log_bayes_factor
    return 0.0 if of_process > gain else gain


def _one_block(spec: CampaignSpec, fitted: Fitted) -> bool:
    """Whether intervals ought to include the scatter between flight days, which one day cannot tell."""
    return spec.model.block_effect == "random" and fitted.surface.fixed_blocks and "flight" in fitted.data.sources


def _model_p(fitted: Fitted) -> float | None:
    """P of the F test of all terms, 1 of equal scores; None where nothing is left to test with, or no term to test."""
    all_terms = np.arange(1, fitted.model.p)
    if not fitted.fit.df_residual or not len(all_terms):
        return None
    return 1.0 if fitted.data.all_equal else fitted.fit.partial_f(all_terms).p


def _confirmation(
    spec: CampaignSpec, fitted: Fitted, best: FloatArray, runs: Sequence[RunRecord], taken_off: float
) -> tuple[Confirmation | None, Agreement | None]:
    """The latest set of confirmation runs, against what is believed at their settings; none once it is in the fit.

    ``best``: the settings recommended now, coded (k,).
    """
    application, scale, surface = fitted.application, fitted.scale, fitted.surface
    why = confirmation_reason(application.name)
    used = {run.run_id for run in evidence(runs)}
    fresh = [run for run in runs if run.purpose == CONFIRMATION and run.state == "scored" and run.why == why]
    fresh = [run for run in fresh if run.run_id not in used]
    fresh = [run for run in fresh if run.batch == fresh[-1].batch and run.score_of(application.name) is not None]
    if len(fresh) < 2:
        return None, None
    found = [score for run in fresh if (score := run.score_of(application.name)) is not None]
    scores = np.array([score.score for score in found])
    counts = [(score.correct, score.n) for score in found if score.correct is not None and score.n]
    if application.is_percent and len(counts) == len(found):
        right, trials = zip(*counts, strict=True)
        interval = counted_confirmation(right, trials, spec.stop.level)
    else:
        interval = confirmation_interval(scores, spec.stop.level)
    at = fitted.region.code([fresh[0].settings])
    predicted = fitted.bands(at, spec.stop.level, scale.weight_at, len(scores))
    values = scale.centred(scores, np.array([n for _, n in counts]) if len(counts) == len(found) else None)
    wide = Interval(float(predicted.prediction.low[0]), float(predicted.prediction.high[0])).also_less(taken_off)
    of_mean = Interval(interval.low, interval.high).within(*application.score_limits)
    own = Interval(float(predicted.confidence.low[0]), float(predicted.confidence.high[0])).also_less(taken_off)
    low, high = scale.of_runs(own, wide, len(scores))
    expected, half = Interval(float(low), float(high)).within(*application.score_limits), of_mean.half_width
    measured = f"{known(interval.mean, half)} {application.score_unit}".rstrip()
    where = "the recommended settings"
    if not np.allclose(at[0], best, atol=_SAME):
        where = f"{settings_text(spec.factors, fresh[0].settings)}, recommended before,"
    ends = f"{100 * spec.stop.level:g} % interval {known(of_mean.low, half)} to {known(of_mean.high, half)}"
    text = (
        f"{len(scores)} confirmation runs at {where} averaged {measured} ({ends if half else 'all equal'}), "
        f"{{verdict}} the model's prediction interval for their mean, {known(expected.low, expected.half_width)} to "
        f"{known(expected.high, expected.half_width)} (p = {{p}})."
    )
    agreement = confirmation_agrees(
        confirmation_interval(values, spec.stop.level),
        predicted=0.5 * (wide.low + wide.high),
        half_width=wide.half_width,
        df=surface.df_residual,
        text=text,
    )
    confirmation = Confirmation(
        run_ids=tuple(run.run_id for run in fresh),
        scores=tuple(float(score) for score in scores),
        mean=interval.mean,
        interval=of_mean,
        agrees=agreement.agrees,
        text=agreement.text,
    )
    return confirmation, agreement


def _notes(spec: CampaignSpec, fitted: Fitted, best: OptimumEstimate) -> list[str]:
    """How the result was found: nothing that casts doubt on it."""
    application, data, surface = fitted.application, fitted.data, fitted.surface
    idle = without_effect(spec.factors, best.settings)
    why = "as no sensor of the set takes it or there is but one date"
    found = [f"Of no effect, {why}: {', '.join(idle)}."] if idle else []
    outside = int(np.count_nonzero(~fitted.region.feasible(data.points)))
    if outside:
        found.append(f"Runs outside the region, included in the fit: {outside}.")
    if surface.fixed_blocks and len(set(block_labels(spec, data))) > len(set(data.sources)):
        found.append("Blocks differ by fitted constants; the score at the optimum is for their unweighted mean.")
    counted = data.trials is not None and len(data.trials) > 0 and bool(np.all(np.isfinite(data.trials)))
    if application.is_percent and counted and spec.model.weights == "equal" and surface.errors.exact:
        found.append('The scores are counts: [model] weights = "counts" would weight them by their binomial variance.')
    measured = application.unit in ("percent", "%") and spec.model.response == "identity"
    past = best.prediction.low < 0.0 or best.prediction.high > 100.0
    if measured and past and np.min(data.scores) >= 0.0 and np.max(data.scores) <= 100.0:
        found.append('Intervals reach beyond 0 to 100 percent: where no score can, use [model] response = "logit".')
    return found


def _warnings(spec: CampaignSpec, fitted: Fitted, best: Optimum) -> list[str]:
    application, fit, data, surface = fitted.application, fitted.fit, fitted.data, fitted.surface
    found = []
    if fit.reason and not surface.s > 0.0:
        instead = "; settings and intervals rest on shrunk coefficients" if fitted.departure.believed else ""
        found.append(f"No error estimate by least squares: {fit.reason}{instead}.")
    labels = block_labels(spec, data)
    alone = labels.count(NO_BLOCK) or labels.count("flight")  # beside simulations, which have no blocks
    if spec.model.block is not None and any(data.blocks) and alone:
        found.append(f"Runs without a block, which count as one block of their own: {alone}.")
    if spec.model.block is None and (named := len({*data.blocks} - {""})) > 1:
        told = "intervals do not include how they differ"
        found.append(f'The runs are of {named} blocks, and {told}: [model] block = "block" would include it.')
    if _one_block(spec, fitted):
        found.append(
            "Only one block so far: block differences are unknown, and the intervals apply to this block only."
        )
    if surface.note:
        found.append(surface.note)
    if not surface.fixed_blocks and application.prior is not None and application.prior.utility is not None:
        found.append("With random blocks only the bounds on effects of [application.prior] are used.")
    if bool(extrapolated(fit, fitted.model.matrix(best.point[None, :]))[0]):
        found.append("The optimum is an extrapolation: its leverage exceeds that of every run.")
    of_model = f" for the {fitted.model.name}" if fitted.departure.probability > 0.0 else ""
    found += [
        f"Run {data.run_ids[run.run]} is unusual{of_model}: {'; '.join(run.reasons)}."
        for run in influential_runs(fit)
        if any("outlier" in reason for reason in run.reasons)
    ]
    if (gain := _gain_of_student(fitted)) > _WILD:
        times = "more than 1000" if gain > _SURE else f"{float(f'{math.exp(gain):.1g}'):.0f}"
        found.append(
            f"A few scores lie far off the others: Student-t errors are {times} times as probable as normal ones. Void "
            'the runs in which something went wrong; otherwise [model] errors = "student_t" lets such scores count for '
            "little."
        )
    if best.flat and not fitted.data.all_equal:
        found.append("The optimum lies on a ridge: other settings are equally good (see the canonical analysis).")
    lack = fit.lack_of_fit()
    if spec.model.order == 1 and isinstance(lack, LackOfFit) and lack.p < LACK_OF_FIT_ALPHA:
        small = ", so intervals and expected loss are too small" if fitted.departure.process is None else ""
        found.append(
            f"The first-order model does not fit (lack of fit, p = {lack.p:.2g}){small}: [model] order = 2 would fit "
            "curvature."
        )
    if fit.condition_number > 1e3:
        found.append(f"The design is ill-conditioned (condition number {fit.condition_number:.2g}).")
    # A random day's effect, and the difference between sources, are drawn towards zero.
    drawn = data.sources if surface.fixed_blocks else labels
    passed = [run for run in fit.leverage_one_runs if list(drawn).count(drawn[run]) > 1]
    if passed and fit.df_residual:  # else the model passes through every run, as said above
        ids = ", ".join(str(data.run_ids[run]) for run in passed)
        one, several = f"run {ids} (leverage 1): its score", f"runs {ids} (leverage 1): their scores"
        found.append(f"The model must pass through {one if len(passed) == 1 else several} cannot be checked.")
    if fitted.data.all_equal:
        found.append("All scores are equal, so there is no optimum: every setting is equally good.")
    elif fit.df_residual >= _MIN_DF and (p := _model_p(fitted)) is not None and p > MODEL_ALPHA:
        test = f"F test of all terms: p = {p:.2g}"
        found.append(f"No factor has a significant effect ({test}): other settings may be equally good.")
    at_end = int(np.isin(data.scores, application.score_limits).sum())
    if at_end > 0.5 * len(data.scores) and not (spec.errors.of_counts or fitted.data.all_equal):
        found.append(
            f"{at_end} of {len(data.scores)} scores lie at the end of their scale, where runs do not scatter: "
            "intervals are too narrow at settings that score otherwise, and may be at the recommended ones."
        )
    if application.is_percent and spec.model.response == "identity" and len(data.scores):
        values = fitted.scale.to_score(fit.fitted)
        if np.max(values) > 95.0 or np.min(values) < 5.0:
            found.append(
                'Fitted scores exceed 95 % or fall below 5 %: [model] response = "logit" suits bounded scores.'
            )
    return found
