"""The fit of one application's scores: which runs, over which part of the region, from which sources."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from seqrsm.analysis.results import Interval, RegionChange, ScoredRuns, SourceComparison
from seqrsm.analysis.scale import ResponseScale
from seqrsm.analysis.surface import (
    block_labels,
    columns_within_sources,
    fit_surface,
    occasions_shared,
    random_blocks,
    response_scale,
    select_terms,
)
from seqrsm.arrays import BoolArray, FloatArray
from seqrsm.decide.discrepancy import find_discrepancy
from seqrsm.decide.moving import Box, Plan, RegionState, RegionStep, evidence_limit, sub_region, walk, whole_box
from seqrsm.decide.sources import SourceFit, fit_sources
from seqrsm.decide.stopping import Departure
from seqrsm.design.factors import ContinuousFactor, setting_text
from seqrsm.design.quadratic import QuadraticModel
from seqrsm.design.region import Region
from seqrsm.fit.blocks import RandomBlockPosterior, block_columns
from seqrsm.fit.intervals import Prediction
from seqrsm.fit.least_squares import LeastSquaresFit
from seqrsm.fit.robust import student_weights
from seqrsm.spec.read import ApplicationSpec, CampaignSpec
from seqrsm.store.records import CONFIRMATION, RunRecord


def confirmation_reason(application: str) -> str:
    """What is recorded with a fresh run at an application's optimum; each application is confirmed by its own."""
    return f"fresh run at the optimum of {application}"


@dataclass(frozen=True, slots=True)
class Fitted:
    """A fitted surface with what it was fitted to.

    Attributes
    ----------
    region, model : Region, QuadraticModel
        The part of the campaign's region that is fitted, with its own coding.
    data : ScoredRuns
        The runs in it.
    scale : ResponseScale
    fit : LeastSquaresFit
        With blocks and sources as constants: what tests and diagnostics are made of.
    sources : SourceFit or None
        The flight's surface, where there are simulations and flights.
    state : RegionState
    n_scored : int
        Scored runs in and outside the box.
    departure : Departure
        Smooth departure from the quadratic in the box.
    application : ApplicationSpec
    dropped : tuple of str
        Terms of the whole model that were left out by selection.
    blocks : RandomBlockPosterior or None
        The surface of the average block, where blocks are random.
    occasions : int
        Occasions that simulated runs share (common random numbers), 0 where each has its own. A future run meets one
        of its own, and so do all runs of a future mean.
    """

    region: Region
    model: QuadraticModel
    data: ScoredRuns
    scale: ResponseScale
    fit: LeastSquaresFit
    sources: SourceFit | None
    state: RegionState
    n_scored: int
    departure: Departure
    application: ApplicationSpec
    dropped: tuple[str, ...] = ()
    blocks: RandomBlockPosterior | None = None
    occasions: int = 0

    @property
    def beta(self) -> FloatArray:
        """Coefficients (p,) of the surface whose optimum is sought."""
        if self.blocks is not None:
            return self.blocks.estimate
        found: FloatArray = self.fit.estimate[: self.model.p] if self.sources is None else self.sources.estimate
        return found

    @property
    def s(self) -> float:
        """Standard deviation of a future run of weight 1, on the scale of the fit; in a new block where they vary."""
        if self.blocks is not None:
            return self.blocks.s_new_day
        return self.fit.s if self.sources is None else self.sources.s

    @property
    def df_residual(self) -> int:
        """Degrees of freedom of ``s``."""
        if self.blocks is not None:
            return int(self.blocks.df)
        return self.fit.df_residual if self.sources is None else int(self.sources.df_residual)

    def predict(
        self, rows: FloatArray, level: float = 0.95, weight: float | FloatArray = 1.0, replicates: int = 1
    ) -> Prediction:
        """Mean, confidence and prediction interval at model rows (m, p); of flights where there are two sources.

        Where blocks are random: of the average block, and of runs in a new one.
        """
        if self.blocks is not None:
            w = float(np.mean(weight))
            return self.blocks.predict(rows, level, weight=w, replicates=replicates, apart=self.occasions > 0)
        if self.sources is None:
            return self.fit.predict(rows, level, weight, replicates)
        return self.sources.predict(rows, level, weight, replicates)

    def variance_unscaled(self, rows: FloatArray) -> FloatArray:
        """Variance of the mean at model rows (m, p), in units of ``s`` squared."""
        if self.blocks is not None:
            return self.blocks.variance(rows) / self.s**2
        return self.fit.variance_unscaled(rows) if self.sources is None else self.sources.variance_unscaled(rows)


def scored_runs(region: Region, runs: Sequence[RunRecord], application: str) -> ScoredRuns:
    """Runs that enter the fit of ``application``: scored, not void, no confirmation runs; in order of id."""
    used = [
        (run, score)
        for run in runs
        if run.state == "scored" and run.purpose != CONFIRMATION and (score := run.score_of(application)) is not None
    ]
    errors = [_model_error(score.metadata) for _, score in used]
    return ScoredRuns(
        run_ids=np.array([run.run_id for run, _ in used], dtype=np.int64),
        batches=np.array([run.batch for run, _ in used], dtype=np.int64),
        points=region.code([run.settings for run, _ in used]) if used else np.empty((0, region.k)),
        scores=np.array([score.score for _, score in used], dtype=np.float64),
        score_se=np.array([np.nan if score.se is None else score.se for _, score in used], dtype=np.float64),
        sources=tuple(run.source for run, _ in used),
        purposes=tuple(run.purpose for run, _ in used),
        blocks=tuple(run.block for run, _ in used),
        trials=_counts([score.n for _, score in used]),
        correct=_counts([score.correct for _, score in used]),
        model_sd=np.array([part for part, _, _ in errors], dtype=np.float64),
        model_bias=np.array([bias for _, bias, _ in errors], dtype=np.float64),
        rungs=tuple(rung for _, _, rung in errors),
    )


def _model_error(metadata: Mapping[str, Any]) -> tuple[float, float, str]:
    """Errors of a score's simulation [score units]: of looking at a part of the ground, shared in its rung; the rung.

    The bound of what a rung leaves out counts as two standard deviations.
    """
    fidelity = metadata.get("fidelity")
    if not isinstance(fidelity, Mapping):
        return 0.0, 0.0, ""
    sampling = metadata.get("sampling_se")
    part = float(sampling) if isinstance(sampling, float) and np.isfinite(sampling) else 0.0
    return part, 0.5 * float(fidelity.get("bias_bound", 0.0)), str(fidelity.get("rung", ""))


def _counts(values: Sequence[int | None]) -> FloatArray:
    return np.array([np.nan if value is None else value for value in values], dtype=np.float64)


def in_box(data: ScoredRuns, box: Box) -> ScoredRuns:
    """The runs in ``box``, coded in it."""
    if box.whole:
        return data
    keep: BoolArray = box.contains(data.points)
    names = [np.array(getattr(data, name), dtype=object)[keep] for name in ("sources", "purposes", "blocks")]
    columns = (data.trials, data.correct, data.model_sd, data.model_bias)
    counts = [None if column is None else column[keep] for column in columns]
    return ScoredRuns(
        run_ids=data.run_ids[keep],
        batches=data.batches[keep],
        points=box.local(data.points[keep]),
        scores=data.scores[keep],
        score_se=data.score_se[keep],
        sources=tuple(names[0]),
        purposes=tuple(names[1]),
        blocks=tuple(names[2]),
        trials=counts[0],
        correct=counts[1],
        model_sd=counts[2],
        model_bias=counts[3],
        rungs=tuple(rung for rung, kept in zip(data.rungs, keep.tolist(), strict=True) if kept) if data.rungs else (),
    )


def region_state(spec: CampaignSpec, application: ApplicationSpec, data: ScoredRuns) -> RegionState:
    """The fitted part of the region, from the scored runs batch by batch."""
    if not spec.region_moves or not len(data.scores):
        return RegionState(whole_box(spec.region.k))
    scale = response_scale(spec, data)
    columns, _ = block_columns(block_labels(spec, data))
    weights = scale.weights
    Z = np.hstack([QuadraticModel(spec.factors, spec.model.order).matrix(data.points), columns])
    if spec.model.errors == "student_t" and len(data.scores) > Z.shape[1]:
        weights = student_weights(Z, scale.values, weights)
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
    sources = blocks = None
    if len(set(data.sources)) > 1:
        sources = fit_sources(
            model,
            data.points,
            scale.values,
            [source == "flight" for source in data.sources],
            weights=fit.weights,
            extra=columns_within_sources(spec, data),
            prior_sd=spec.model.discrepancy_sd,
        )
    occasions = occasions_shared(data)
    # Occasions are a sample of what a flight may meet; with flights in the fit, or wild errors, they are constants.
    sampled = occasions > 0 and spec.model.errors == "normal" and sources is None
    if (spec.model.block_effect == "random" or sampled) and len(set(block_labels(spec, data))) > 1:
        blocks = random_blocks(spec, model, data, scale)
    dropped = tuple(name for name in whole.term_names if name not in model.term_names)
    found = find_discrepancy(model, data.points, fit.Z, fit.y, fit.weights, application.goal)
    ratio = float(np.exp(0.5 * found.noise_slope))
    departure = Departure(found.evidence, evidence_limit(fit.df_residual), found.noise_evidence, ratio)
    scored = len(everything.scores)
    return Fitted(
        region, model, data, scale, fit, sources, state, scored, departure, application, dropped, blocks, occasions
    )


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


def compare_sources(fitted: Fitted, point: FloatArray, level: float) -> SourceComparison | None:
    """Simulation against flight at ``point`` (k,); on a transformed scale the difference is taken in scores."""
    found = fitted.sources
    if found is None:
        return None
    row = fitted.model.matrix(point[None, :])
    simulated = row @ found.simulation
    mean, low, high = found.discrepancy(row[0], level)

    def in_scores(difference: float) -> float:
        ends = fitted.scale.to_score(np.array([float(simulated[0]), float(simulated[0]) + difference]))
        return float(ends[1] - ends[0])

    difference, interval = in_scores(mean), Interval(in_scores(low), in_scores(high))
    source = "mostly the prior's" if found.prior_driven else "mostly the flights'"
    return SourceComparison(
        n_simulations=found.n_simulations,
        n_flights=found.n_flights,
        s_simulation=found.s_simulation,
        s_flight=found.s,
        difference=difference,
        interval=interval,
        prior_sd=found.prior_sd,
        prior_share=found.prior_share,
        prior_driven=found.prior_driven,
        text=(
            f"At the recommended settings flights score {difference:+.3g} against simulations "
            f"({100 * level:g} % credible interval {interval.low:.3g} to {interval.high:.3g}); after {found.n_flights} "
            f"flights this is {source} word ({100 * found.prior_share:.0f} % of the prior variance is left). All "
            "intervals are for flights."
        ),
    )


__all__ = [
    "CONFIRMATION",
    "Fitted",
    "compare_sources",
    "fit_application",
    "in_box",
    "natural_ranges",
    "range_text",
    "region_history",
    "region_state",
    "scored_runs",
]
