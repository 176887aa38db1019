"""The least-squares surface of the runs in hand: scale, weights, blocks, terms; and what is missing where it fails."""

from __future__ import annotations

import numpy as np

from seqrsm.analysis.occasions import occasion_of, shared_occasions, similarity
from seqrsm.analysis.results import ScoredRuns
from seqrsm.analysis.scale import ResponseScale
from seqrsm.arrays import FloatArray, IntArray
from seqrsm.design.factors import settings_text
from seqrsm.design.quadratic import QuadraticModel
from seqrsm.design.region import Region
from seqrsm.errors import FitError, Problem
from seqrsm.fit.blocks import RandomBlockPosterior, block_columns, fit_random_blocks
from seqrsm.fit.estimability import missing_runs
from seqrsm.fit.least_squares import LeastSquaresFit, fit_least_squares
from seqrsm.fit.robust import student_weights
from seqrsm.fit.selection import average_models
from seqrsm.fit.weights import expected_shares, own_weights
from seqrsm.spec.read import CampaignSpec

_SAME_SETTING_DECIMALS = 9
_LISTED_RUNS = 8


def setting_ids(points: FloatArray) -> list[tuple[float, ...]]:
    """Equal for equal executed settings; coded points (n, k) compared to 1e-9 of half a factor's range."""
    return [tuple(row) for row in np.round(points, _SAME_SETTING_DECIMALS) + 0.0]


def block_labels(spec: CampaignSpec, data: ScoredRuns, *, with_source: bool = True) -> list[str]:
    """Block of each run.

    The occasion that simulated runs share; the flight day, where ``[model] block`` asks for it; and the source where
    there are two. Runs alone in their occasions are one block: a constant for each would leave nothing of them.
    """
    source_too = with_source and len(set(data.sources)) > 1
    with_block = spec.model.block is not None
    together = shared_occasions(zip(data.sources, data.blocks, strict=True))
    found = []
    for source, block in zip(data.sources, data.blocks, strict=True):
        number = occasion_of(source, block)
        counts = with_block if number is None else number in together
        found.append(" ".join(part for part in (source if source_too else "", block if counts else "") if part))
    return [label or "all" for label in found]


def columns_within_sources(spec: CampaignSpec, data: ScoredRuns) -> FloatArray:
    """Columns (n, b) of blocks where flights and simulations differ by terms of their own.

    Contrasts of the flight days, and of the occasions that simulated runs share: 0 for every other run, which met one
    from the same source of occasions, so that flights are not told from simulations by them.
    """
    shared = np.array([occasion_of(*each) is not None for each in zip(data.sources, data.blocks, strict=True)])
    labels = np.array(block_labels(spec, data, with_source=False), dtype=object)
    days, _ = block_columns(["all" if own else label for own, label in zip(shared, labels, strict=True)])
    occasions, names = block_columns(labels[shared & (labels != "all")])
    within = np.zeros((len(labels), len(names)))
    within[shared & (labels != "all")] = occasions[:, : len(names)]
    return np.hstack([days, within])


def occasions_shared(data: ScoredRuns) -> int:
    """How many occasions the simulated runs share; 0 where each run has its own."""
    return len(shared_occasions(zip(data.sources, data.blocks, strict=True)))


def response_scale(spec: CampaignSpec, data: ScoredRuns) -> ResponseScale:
    """Scores on the scale of ``[model] response``, with the weights of ``[model] weights``.

    Raises
    ------
    FitError
        Weights from standard errors or counts that some scores do not have.
    """
    if spec.model.weights == "equal":
        return ResponseScale.of(spec.model.response, data.scores)
    if spec.model.weights == "counts":
        _, trials = counts_of(data, 'weights = "counts"')
        columns, _ = block_columns(block_labels(spec, data))
        Z = np.hstack([QuadraticModel(spec.factors, spec.model.order).matrix(data.points), columns])
        return ResponseScale.of_counts(
            spec.model.response, data.scores, trials, expected_shares(Z, data.scores, trials)
        )
    if not np.all(data.score_se > 0.0):
        named = _run_list(data.run_ids[~(data.score_se > 0.0)])
        remedy = 'Give every score its standard error (column se), or set [model] weights = "equal".'
        raise FitError(Problem(f"{named} have no standard error to be weighted by", remedy))
    return ResponseScale.of(spec.model.response, data.scores, data.score_se)


def counts_of(data: ScoredRuns, what: str) -> tuple[FloatArray, FloatArray]:
    """Correct decisions and trials (n,) of every run, which ``what`` needs.

    Raises
    ------
    FitError
        Runs without counts.
    """
    known = np.zeros(len(data.scores), dtype=np.bool_)
    if data.trials is not None and data.correct is not None:
        known = np.isfinite(data.trials) & np.isfinite(data.correct)
    if data.trials is None or data.correct is None or not np.all(known):
        remedy = "Give the columns n and correct for every score, or leave that out of [model]."
        raise FitError(Problem(f"{_run_list(data.run_ids[~known])} have no counts, which {what} needs", remedy))
    return data.correct, data.trials


def _run_list(ids: IntArray) -> str:
    shown = ", ".join(str(int(run)) for run in ids[:_LISTED_RUNS])
    return f"runs {shown}" + (", ..." if len(ids) > _LISTED_RUNS else "")


def _weights(spec: CampaignSpec, Z: FloatArray, scale: ResponseScale, data: ScoredRuns) -> FloatArray:
    """Relative weights: by the scale, by the tails, and less for runs whose simulation has an error of its own."""
    if spec.model.errors == "student_t":
        return student_weights(Z, scale.values, scale.weights)
    if data.model_sd is None:
        return scale.weights
    return own_weights(Z, scale.values, np.square(data.model_sd * _stretch(scale, data)), scale.weights)


def _stretch(scale: ResponseScale, data: ScoredRuns) -> FloatArray:
    """Unit of the scale of the fit for one of each score (n,)."""
    if scale.kind == "identity":
        return np.ones(len(data.scores))
    inner = np.clip(data.scores, 0.5, 99.5)
    return np.asarray(100.0 / (inner * (100.0 - inner)))


def shared_loadings(data: ScoredRuns, scale: ResponseScale) -> tuple[FloatArray, tuple[str, ...]]:
    """Error that the scores of each rung share, and the rungs: prior standard deviations (n, r) on the fit's scale."""
    if data.model_bias is None or not np.any(data.model_bias > 0.0):
        return np.zeros((len(data.scores), 0)), ()
    own = data.model_bias * _stretch(scale, data)
    made = np.array(data.rungs)
    rungs = tuple(sorted(set(made[own > 0.0].tolist())))
    return np.column_stack([np.where(made == rung, own, 0.0) for rung in rungs]), rungs


def fit_surface(
    spec: CampaignSpec, region: Region, model: QuadraticModel, data: ScoredRuns, scale: ResponseScale
) -> LeastSquaresFit:
    """Least-squares fit on the scale of ``[model] response``, with blocks and sources as effects.

    Raises
    ------
    FitError
        Fewer scores than terms, or terms that the runs cannot tell apart: with runs that would mend it.
    """
    labels = block_labels(spec, data)
    columns, names = block_columns(labels)
    n, needed = len(data.scores), model.p + len(names)
    if n < needed:
        message = f"{n} scored runs cannot determine {needed} terms"
        raise FitError(Problem(message, _remedy(region, model, data, "Score more runs", needed - n)))
    Z = np.hstack([model.matrix(data.points), columns])
    fit = fit_least_squares(
        Z,
        scale.values,
        [*model.terms, *names],
        weights=_weights(spec, Z, scale, data),
        setting_ids=setting_ids(data.points),
        block_ids=labels,
        crossed_blocks=occasions_shared(data) > 0,
    )
    if fit.aliased:
        message = f"the runs cannot tell these terms apart: {', '.join(fit.aliased)}"
        raise FitError(Problem(message, _remedy(region, model, data, "Add runs", n_aliased=len(fit.null.T))))
    return fit


def _remedy(
    region: Region, model: QuadraticModel, data: ScoredRuns, start: str, n_short: int = 0, n_aliased: int = 0
) -> str:
    """Runs that would make every term estimable, in words; or why none would."""
    missing = missing_runs(model, region, data.points)
    if missing.unresolved:
        return (
            f"No run of the region tells {', '.join(missing.unresolved)} apart: change the factors or constraints, "
            "or set [model] order = 1."
        )
    if not missing.settings:
        least = max(n_short, n_aliased)
        if n_aliased:
            return "Blocks and settings change together: repeat settings of one block in another, or leave blocks out."
        return f"{start}: at least {least} more (`seqrsm propose` names good ones), or set [model] order = 1."
    shown = "; ".join(settings_text(region.factors, settings) for settings in missing.settings[:_LISTED_RUNS])
    count = len(missing.settings)
    more = f" and {count - _LISTED_RUNS} more (`seqrsm propose` names them)" if count > _LISTED_RUNS else ""
    return f"{start}; {count} at these settings would do: {shown}{more}. Or set [model] order = 1."


def select_terms(spec: CampaignSpec, model: QuadraticModel, data: ScoredRuns, scale: ResponseScale) -> QuadraticModel:
    """The model of the terms that are more likely than not, by averaging over hierarchical sub-models.

    Raises
    ------
    FitError
        Scores that cannot be used.
    """
    if not len(data.scores) or float(np.ptp(scale.values)) == 0.0:
        return QuadraticModel(model.factors, model.order, (0,))
    columns, names = block_columns(block_labels(spec, data))
    Z = np.hstack([model.matrix(data.points), columns])
    found = average_models(
        Z, scale.values, [*model.terms, *names], weights=_weights(spec, Z, scale, data), seed=spec.seed
    )
    chosen = {0}
    for unit, present in zip(found.units, found.median_model.tolist(), strict=True):
        chosen.update(unit.columns if present else ())
    return QuadraticModel(model.factors, model.order, tuple(sorted(chosen)))


def random_blocks(
    spec: CampaignSpec, model: QuadraticModel, data: ScoredRuns, scale: ResponseScale
) -> RandomBlockPosterior:
    """Surface of the average block, with blocks as a random effect.

    Raises
    ------
    FitError
        One block, two sources, or no scatter.
    """
    if len(set(data.sources)) > 1:
        remedy = 'Set [model] block_effect = "fixed".'
        raise FitError(Problem("random blocks are for scores of one source, here are simulations and flights", remedy))
    labels, alike = block_labels(spec, data), None
    if occasions_shared(data):
        # Runs that share no occasion met one each, as random effects can.
        each = zip(labels, data.run_ids.tolist(), strict=True)
        labels = [f"run {run_id}" if label == "all" else label for label, run_id in each]
        alike = similarity(model.factors, data.points)
    return fit_random_blocks(model.matrix(data.points), scale.values, labels, weights=scale.weights, similarity=alike)
