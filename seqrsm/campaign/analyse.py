"""Fit one application's scores and draw the conclusions: a pure function of runs, specification and seed."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from seqrsm.arrays import FloatArray, IntArray
from seqrsm.campaign.analysis import (
    Analysis,
    Confirmation,
    FactorImportance,
    Interval,
    OptimumEstimate,
    ScoredRuns,
)
from seqrsm.campaign.posterior import Sampler, summarise_posterior
from seqrsm.campaign.records import LookRecord, RunRecord
from seqrsm.campaign.response import ResponseScale
from seqrsm.campaign.spec import ApplicationSpec, CampaignSpec
from seqrsm.decide.intervals import Agreement, confirmation_agrees, confirmation_interval
from seqrsm.decide.stopping import Decision, StopRule, decide
from seqrsm.design.quadratic import QuadraticModel
from seqrsm.design.region import Region
from seqrsm.errors import FitError, Problem
from seqrsm.fit.anova import LackOfFit
from seqrsm.fit.blocks import block_columns
from seqrsm.fit.canonical import StationaryPoint, stationary_point
from seqrsm.fit.least_squares import LeastSquaresFit, fit_least_squares
from seqrsm.fit.optimum import Goal, Optimum, optimum

CONFIRMATION = "confirmation"
"""Purpose of the fresh runs at the recommended settings; they stay out of the fit."""

_SAME_SETTING_DECIMALS = 9


def scored_runs(region: Region, runs: Sequence[RunRecord], application: str) -> ScoredRuns:
    """Runs that enter the fit of ``application``: scored, not void, no confirmation runs; in order of id."""
    used = [
        (run, score)
        for run in runs
        if run.state == "scored" and run.purpose != CONFIRMATION and (score := run.score_of(application)) is not None
    ]
    return ScoredRuns(
        run_ids=np.array([run.run_id for run, _ in used], dtype=np.int64),
        batches=np.array([run.batch for run, _ in used], dtype=np.int64),
        points=region.code([run.settings for run, _ in used]) if used else np.empty((0, region.k)),
        scores=np.array([score.score for _, score in used], dtype=np.float64),
        score_se=np.array([np.nan if score.se is None else score.se for _, score in used], dtype=np.float64),
        sources=tuple(run.source for run, _ in used),
        purposes=tuple(run.purpose for run, _ in used),
        blocks=tuple(run.block for run, _ in used),
    )


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


def setting_ids(points: FloatArray) -> list[tuple[float, ...]]:
    """Equal for equal executed settings; coded points (n, k) compared to 1e-9 of half a factor's range."""
    return [tuple(row) for row in np.round(points, _SAME_SETTING_DECIMALS) + 0.0]


def fit_surface(spec: CampaignSpec, model: QuadraticModel, data: ScoredRuns, scale: ResponseScale) -> LeastSquaresFit:
    """Least-squares fit on the scale of ``[model] response``, with blocks and sources as effects.

    Raises
    ------
    FitError
        Fewer scores than terms.
    """
    labels = block_labels(spec, data)
    columns, names = block_columns(labels)
    n, needed = len(data.scores), model.p + len(names)
    if n < needed:
        raise FitError(
            Problem(f"{n} scored runs cannot determine {needed} terms", "Score more runs, or set [model] order = 1.")
        )
    return fit_least_squares(
        np.hstack([model.matrix(data.points), columns]),
        scale.values,
        [*model.terms, *names],
        weights=scale.weights,
        setting_ids=setting_ids(data.points),
        block_ids=labels,
    )


def block_labels(spec: CampaignSpec, data: ScoredRuns) -> list[str]:
    """Block of each run: its flight day, where ``[model] block`` asks for it, and its source where there are two."""
    with_source = len(set(data.sources)) > 1
    with_block = spec.model.block is not None
    return [
        " ".join(part for part in (source if with_source else "", block if with_block else "") if part) or "all"
        for source, block in zip(data.sources, data.blocks, strict=True)
    ]


def analyse(
    spec: CampaignSpec,
    application: ApplicationSpec,
    runs: Sequence[RunRecord],
    looks: Sequence[LookRecord],
    *,
    sampler: Sampler = "exact",
    n_draws: int = 4000,
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
        How the posterior is drawn; errors = "student_t" needs and always gets emcee.
    n_draws : int
        Posterior draws of the optimum.

    Raises
    ------
    FitError
        Fewer scores than terms.
    ConvergenceError
        emcee did not converge.
    """
    region, model = spec.to_region(), QuadraticModel(spec.factors, spec.model.order)
    goal: Goal = application.goal
    data = scored_runs(region, runs, application.name)
    scale = ResponseScale.of(spec.model.response, data.scores)
    fit = fit_surface(spec, model, data, scale)
    if fit.aliased:
        raise FitError(
            Problem(
                f"the runs cannot tell these terms apart: {', '.join(fit.aliased)}",
                "Add runs that vary these factors (`seqrsm propose`), or set [model] order = 1.",
            )
        )
    beta = fit.estimate[: model.p]
    best = optimum(model, region, beta, goal)
    estimate = _estimate(spec, region, model, fit, scale, best)
    lack = fit.lack_of_fit()
    confirmation, agreement = _confirmation(spec, application, region, model, fit, scale, runs)
    decision = _decision(spec, application, model, fit, estimate, lack, looks, agreement)
    posterior = summarise_posterior(
        spec,
        region,
        model,
        fit,
        scale,
        estimate,
        goal=goal,
        sampler=sampler,
        n_draws=n_draws,
    )
    return Analysis(
        application=application.name,
        goal=goal,
        response=spec.model.response,
        score_unit=application.unit,
        region=region,
        model=model,
        data=data,
        fit=fit,
        anova=fit.anova(),
        lack_of_fit=lack,
        importance=tuple(_importance(model, fit)),
        stationary=_stationary(model, region, beta, best),
        optimum=estimate,
        posterior=posterior,
        decision=decision,
        confirmation=confirmation,
        warnings=tuple(_warnings(spec, application, region, model, data, fit, scale, best)),
    )


def _estimate(
    spec: CampaignSpec, region: Region, model: QuadraticModel, fit: LeastSquaresFit, scale: ResponseScale, best: Optimum
) -> OptimumEstimate:
    stop = spec.stop
    row = model.matrix(best.point[None, :])
    weight = scale.weight_at(fit.predict(row).mean)
    one = fit.predict(row, stop.level, weight)
    several = fit.predict(row, stop.level, weight, stop.replicates)

    def in_scores(low: FloatArray, high: FloatArray) -> Interval:
        return Interval(float(scale.to_score(low)[0]), float(scale.to_score(high)[0]))

    return OptimumEstimate(
        settings=region.decode(best.point)[0],
        point=best.point,
        at_bound=best.at_bound + tuple(f"constraint {expr}" for expr in best.active_constraints),
        mean=float(scale.to_score(one.mean)[0]),
        confidence=in_scores(one.confidence.low, one.confidence.high),
        prediction=in_scores(one.prediction.low, one.prediction.high),
        prediction_mean=in_scores(several.prediction.low, several.prediction.high),
        replicates=stop.replicates,
        level=stop.level,
    )


def _importance(model: QuadraticModel, fit: LeastSquaresFit) -> list[FactorImportance]:
    """Partial F of all terms of each factor (RSL TR 380-1 eq. 2-14), the most important first."""
    rows = []
    for factor in model.factors:
        indices: IntArray = model.factor_terms(factor.name)
        test = fit.partial_f(indices)
        rows.append(FactorImportance(factor.name, test.df, test.f, test.p))
    return sorted(rows, key=lambda row: -row.f if np.isfinite(row.f) else np.inf)


def _stationary(model: QuadraticModel, region: Region, beta: FloatArray, best: Optimum) -> StationaryPoint | None:
    if model.order == 1 or not region.numeric:
        return None
    return stationary_point(model, region, beta, tuple(int(best.point[j]) for j in region.categorical))


def _decision(
    spec: CampaignSpec,
    application: ApplicationSpec,
    model: QuadraticModel,
    fit: LeastSquaresFit,
    estimate: OptimumEstimate,
    lack: LackOfFit | str,
    looks: Sequence[LookRecord],
    agreement: Agreement | None,
) -> Decision:
    rule = stop_rule(spec)
    widths = {
        "prediction": estimate.prediction.half_width,
        "prediction_mean": estimate.prediction_mean.half_width,
        "confidence": estimate.confidence.half_width,
    }
    earlier = [look for look in looks if look.after_run < fit.n_runs]
    all_terms = np.arange(1, model.p)
    return decide(
        rule,
        n_runs=fit.n_runs,
        n_terms=fit.n_terms,
        s=fit.s,
        df_residual=fit.df_residual,
        df_pure_error=lack.df_pe if isinstance(lack, LackOfFit) else 0,
        lack_of_fit_p=lack.p if isinstance(lack, LackOfFit) else None,
        lack_of_fit_reason=lack if isinstance(lack, str) else "",
        h=float(fit.variance_unscaled(model.matrix(estimate.point[None, :]))[0]),
        half_width=widths[rule.interval],
        held_at_previous_look=bool(earlier and earlier[-1].summary.get("conditions_hold")),
        model_p=fit.partial_f(all_terms).p if fit.df_residual else None,
        confirmation=agreement,
        unit=application.unit,
    )


def _confirmation(
    spec: CampaignSpec,
    application: ApplicationSpec,
    region: Region,
    model: QuadraticModel,
    fit: LeastSquaresFit,
    scale: ResponseScale,
    runs: Sequence[RunRecord],
) -> tuple[Confirmation | None, Agreement | None]:
    """The latest set of confirmation runs, against the model's prediction at their settings."""
    fresh = [run for run in runs if run.purpose == CONFIRMATION and run.state == "scored"]
    fresh = [run for run in fresh if run.batch == fresh[-1].batch and run.score_of(application.name) is not None]
    if len(fresh) < 2:
        return None, None
    scores = np.array([score.score for run in fresh if (score := run.score_of(application.name)) is not None])
    interval = confirmation_interval(scores, spec.stop.level)
    row = model.matrix(region.code([fresh[0].settings]))
    weight = float(scale.weight_at(fit.predict(row).mean)[0])
    predicted = fit.predict(row, spec.stop.level, weight, len(scores))
    fresh_scale = ResponseScale.of(spec.model.response, scores)
    agreement = confirmation_agrees(
        confirmation_interval(fresh_scale.values, spec.stop.level),
        predicted=float(predicted.mean[0]),
        s=fit.s / np.sqrt(weight),
        df=fit.df_residual,
        h=float(fit.variance_unscaled(row)[0]) * weight,
        unit=application.unit,
    )
    low, high = (float(scale.to_score(end)[0]) for end in (predicted.prediction.low, predicted.prediction.high))
    verdict = "agrees with" if agreement.agrees else "contradicts"
    text = (
        f"{len(scores)} fresh runs at the recommended settings scored {interval.mean:.4g} on average "
        f"({spec.stop.level:.0%} interval {interval.low:.4g} to {interval.high:.4g}); this {verdict} the model, "
        f"which predicted their mean between {low:.4g} and {high:.4g} (p = {agreement.p:.2g})."
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


def _warnings(
    spec: CampaignSpec,
    application: ApplicationSpec,
    region: Region,
    model: QuadraticModel,
    data: ScoredRuns,
    fit: LeastSquaresFit,
    scale: ResponseScale,
    best: Optimum,
) -> list[str]:
    found = []
    if fit.reason:
        found.append(f"No error estimate: {fit.reason}.")
    outside = int(np.count_nonzero(~region.feasible(data.points)))
    if outside:
        found.append(f"{outside} runs were made outside the region; they are part of the fit.")
    if len(set(block_labels(spec, data))) > 1:
        found.append("Blocks or sources differ by fitted constants; the optimum's value is that of their plain mean.")
    h_best = float(fit.variance_unscaled(model.matrix(best.point[None, :]))[0])
    if h_best > float(np.max(fit.leverage)) + 1e-9:
        found.append("The optimum is an extrapolation: its leverage is larger than that of every run.")
    if best.flat:
        found.append("The optimum is a ridge: other settings are as good, see the canonical analysis.")
    if fit.condition_number > 1e3:
        found.append(f"The design is ill-conditioned (condition number {fit.condition_number:.2g}).")
    if fit.leverage_one_runs:
        ids = ", ".join(str(data.run_ids[i]) for i in fit.leverage_one_runs)
        found.append(f"The model must pass through run {ids} (leverage 1): its score cannot be checked.")
    if application.is_percent and spec.model.response == "identity" and len(data.scores):
        fitted = scale.to_score(fit.fitted)
        if np.max(fitted) > 95.0 or np.min(fitted) < 5.0:
            found.append('Fitted scores pass 95 % or fall below 5 %: [model] response = "logit" fits bounded scores.')
    return found
