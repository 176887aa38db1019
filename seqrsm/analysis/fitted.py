"""The fit of one application's scores: which runs, over which part of the region, from which sources."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from seqrsm.analysis.runs import (
    LISTED_RUNS,
    ScoredRuns,
    block_labels,
    in_box,
    occasions_shared,
    response_scale,
    scored_runs,
    setting_ids,
    stretch,
)
from seqrsm.analysis.scale import ResponseScale
from seqrsm.analysis.surfaces import Surface, surface_of
from seqrsm.arrays import FloatArray
from seqrsm.decide.discrepancy import find_discrepancy
from seqrsm.decide.moving import Box, Plan, RegionState, RegionStep, evidence_limit, sub_region, walk, whole_box
from seqrsm.decide.stopping import Departure
from seqrsm.design.factors import ContinuousFactor, setting_text, settings_text
from seqrsm.design.quadratic import QuadraticModel
from seqrsm.design.region import Region
from seqrsm.errors import FitError, Problem
from seqrsm.fit.estimability import missing_runs
from seqrsm.fit.least_squares import LeastSquaresFit, block_columns, fit_least_squares
from seqrsm.fit.selection import average_models
from seqrsm.spec.read import ApplicationSpec, CampaignSpec
from seqrsm.store.records import RunRecord


def confirmation_reason(application: str) -> str:
    """What is recorded with a fresh run at an application's optimum; each application is confirmed by its own."""
    return f"fresh run at the optimum of {application}"


@dataclass(frozen=True, slots=True)
class Fitted:
    """A fitted surface with what it was fitted to.

    Attributes
    ----------
    application : ApplicationSpec
    region, model : Region, QuadraticModel
        The part of the campaign's region that is fitted, with its own coding.
    data : ScoredRuns
        The runs in it.
    scale : ResponseScale
    fit : LeastSquaresFit
        With blocks and sources as constants: what tests and diagnostics are made of.
    surface : Surface
        What the optimum is sought on.
    state : RegionState
    n_scored : int
        Scored runs in and outside the box.
    departure : Departure
        Smooth departure from the quadratic in the box.
    dropped : tuple of str
        Terms of the whole model that were left out by selection.
    """

    application: ApplicationSpec
    region: Region
    model: QuadraticModel
    data: ScoredRuns
    scale: ResponseScale
    fit: LeastSquaresFit
    surface: Surface
    state: RegionState
    n_scored: int
    departure: Departure
    dropped: tuple[str, ...] = ()

    @property
    def occasions(self) -> int:
        """Occasions that simulated runs share (common random numbers), 0 where each has its own."""
        return occasions_shared(self.data)


@dataclass(frozen=True, slots=True)
class RegionChange:
    """One thing that happened to the fitted region, in natural units.

    Attributes
    ----------
    batch, n_runs : int
        After which batch, and how many scored runs there were.
    kind : str
        "shrink" (a smaller box is called for), "move" (the box follows the optimum), "filled" (the box called for has
        runs enough and is fitted from now on).
    ranges : dict
        Low and high end of every continuous factor in the box, natural units.
    text : str
        One sentence.
    """

    batch: int
    n_runs: int
    kind: str
    ranges: dict[str, tuple[float, float]]
    text: str


def region_state(spec: CampaignSpec, application: ApplicationSpec, data: ScoredRuns) -> RegionState:
    """The fitted part of the region, from the scored runs batch by batch."""
    if not spec.region_moves or not len(data.scores):
        return RegionState(whole_box(spec.region.k))
    scale = response_scale(spec, data)
    columns, _ = block_columns(block_labels(spec, data))
    Z = np.hstack([QuadraticModel(spec.factors, spec.model.order).matrix(data.points), columns])
    weights = spec.errors.weights(Z, scale.values, scale.weights)
    plan = Plan(
        spec.region,
        order=spec.model.order,
        goal=application.goal,
        max_runs=max(spec.stop.max_runs, len(data.scores)),
        seed=spec.seed % 2**32,
        alpha=spec.stop.lack_of_fit_alpha,
    )
    return walk(plan, data.points, scale.values, data.batches, weights=weights, extra=columns)


def fit_application(spec: CampaignSpec, application: ApplicationSpec, runs: Sequence[RunRecord]) -> Fitted:
    """Fit one application's scores over the part of the region that they call for.

    Raises
    ------
    FitError
        Fewer scores than terms, or terms that the runs cannot tell apart.
    """
    everything = scored_runs(spec.region, runs, application.name)
    state = region_state(spec, application, everything)
    region = sub_region(spec.region, state.box)
    whole = QuadraticModel(region.factors, spec.model.order)
    data = in_box(everything, state.box)
    scale = response_scale(spec, data)
    model = select_terms(spec, whole, data, scale) if spec.model.terms == "hierarchical" else whole
    fit = fit_surface(spec, region, model, data, scale)
    surface = surface_of(spec, model, data, scale, fit)
    dropped = tuple(name for name in whole.term_names if name not in model.term_names)
    found = find_discrepancy(model, data.points, fit.Z, fit.y, fit.weights, application.goal)
    ratio = float(np.exp(0.5 * found.noise_slope))
    departure = Departure(found.evidence, evidence_limit(fit.df_residual), found.noise_evidence, ratio)
    return Fitted(
        application, region, model, data, scale, fit, surface, state, len(everything.scores), departure, dropped
    )


def _weights(spec: CampaignSpec, Z: FloatArray, scale: ResponseScale, data: ScoredRuns) -> FloatArray:
    """Relative weights: by the scale, by the errors, and less for runs whose simulation has an error of its own."""
    own = None if data.model_sd is None else np.square(data.model_sd * stretch(scale, data))
    return spec.errors.weights(Z, scale.values, scale.weights, own)


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
    shown = "; ".join(settings_text(region.factors, settings) for settings in missing.settings[:LISTED_RUNS])
    count = len(missing.settings)
    more = f" and {count - LISTED_RUNS} more (`seqrsm propose` names them)" if count > LISTED_RUNS else ""
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


def natural_ranges(region: Region, box: Box) -> dict[str, tuple[float, float]]:
    """Ends of every continuous factor in ``box``, natural units."""
    return {
        factor.name: (factor.low, factor.high)
        for factor in sub_region(region, box).factors
        if isinstance(factor, ContinuousFactor)
    }


def region_history(spec: CampaignSpec, state: RegionState) -> tuple[RegionChange, ...]:
    """What happened to the region, in natural units and words."""
    return tuple(
        RegionChange(
            step.batch, step.n_runs, step.kind, natural_ranges(spec.region, step.box), _in_words(spec.region, step)
        )
        for step in state.steps
    )


def range_text(region: Region, box: Box) -> str:
    """The ranges that a box cuts, in words; "the whole region" where it cuts none."""
    parts = [
        f"{cut.name} {setting_text(cut, cut.low)} to {setting_text(cut, cut.high)} {cut.unit}".rstrip()
        for cut, whole in zip(sub_region(region, box).factors, region.factors, strict=True)
        if isinstance(cut, ContinuousFactor) and cut != whole
    ]
    return ", ".join(parts) or "the whole region"


def _in_words(region: Region, step: RegionStep) -> str:
    where = range_text(region, step.box)
    if step.kind == "filled":
        return f"After {step.n_runs} runs the quadratic is fitted to {where}."
    if step.kind == "move":
        return f"After {step.n_runs} runs the optimum lay on an edge of the fitted region: it moves to {where}."
    tested = f", lack of fit p = {step.lack_of_fit_p:.2g}" if np.isfinite(step.lack_of_fit_p) else ""
    return (
        f"After {step.n_runs} runs the quadratic did not describe the region (evidence of a smooth departure "
        f"{step.evidence:.1f}{tested}): it shrinks to {where}, which is filled with runs first."
    )
