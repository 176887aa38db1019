"""The fit of one application's scores: which runs, over which part of the region, from which sources."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from seqrsm.arrays import BoolArray, FloatArray
from seqrsm.campaign.analysis import Interval, RegionChange, ScoredRuns, SourceComparison
from seqrsm.campaign.records import RunRecord
from seqrsm.campaign.response import ResponseScale
from seqrsm.campaign.spec import ApplicationSpec, CampaignSpec
from seqrsm.decide.discrepancy import find_discrepancy
from seqrsm.decide.moving import Box, Plan, RegionState, RegionStep, evidence_limit, sub_region, walk, whole_box
from seqrsm.decide.sources import SourceFit, fit_sources
from seqrsm.decide.stopping import Departure
from seqrsm.design.factors import ContinuousFactor, setting_text
from seqrsm.design.quadratic import QuadraticModel
from seqrsm.design.region import Region
from seqrsm.errors import FitError, Problem
from seqrsm.fit.blocks import block_columns
from seqrsm.fit.intervals import Prediction
from seqrsm.fit.least_squares import LeastSquaresFit, fit_least_squares

CONFIRMATION = "confirmation"
"""Purpose of the fresh runs at the recommended settings; they stay out of the fit."""

STUDENT_DF = 4.0
"""Degrees of freedom of errors = "student_t"."""

_SAME_SETTING_DECIMALS = 9
_EM_STEPS = 60


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

    @property
    def beta(self) -> FloatArray:
        """Coefficients (p,) of the surface whose optimum is sought."""
        found: FloatArray = self.fit.estimate[: self.model.p] if self.sources is None else self.sources.estimate
        return found

    @property
    def s(self) -> float:
        """Standard deviation of a future run of weight 1, on the scale of the fit."""
        return self.fit.s if self.sources is None else self.sources.s

    @property
    def df_residual(self) -> int:
        """Degrees of freedom of ``s``."""
        return self.fit.df_residual if self.sources is None else int(self.sources.df_residual)

    def predict(
        self, rows: FloatArray, level: float = 0.95, weight: float | FloatArray = 1.0, replicates: int = 1
    ) -> Prediction:
        """Mean, confidence and prediction interval at model rows (m, p); of flights where there are two sources."""
        if self.sources is None:
            return self.fit.predict(rows, level, weight, replicates)
        return self.sources.predict(rows, level, weight, replicates)

    def variance_unscaled(self, rows: FloatArray) -> FloatArray:
        """Variance of the mean at model rows (m, p), in units of ``s`` squared."""
        return self.fit.variance_unscaled(rows) if self.sources is None else self.sources.variance_unscaled(rows)


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


def in_box(data: ScoredRuns, box: Box) -> ScoredRuns:
    """The runs in ``box``, coded in it."""
    if box.whole:
        return data
    keep: BoolArray = box.contains(data.points)
    names = [np.array(getattr(data, name), dtype=object)[keep] for name in ("sources", "purposes", "blocks")]
    return ScoredRuns(
        run_ids=data.run_ids[keep],
        batches=data.batches[keep],
        points=box.local(data.points[keep]),
        scores=data.scores[keep],
        score_se=data.score_se[keep],
        sources=tuple(names[0]),
        purposes=tuple(names[1]),
        blocks=tuple(names[2]),
    )


def setting_ids(points: FloatArray) -> list[tuple[float, ...]]:
    """Equal for equal executed settings; coded points (n, k) compared to 1e-9 of half a factor's range."""
    return [tuple(row) for row in np.round(points, _SAME_SETTING_DECIMALS) + 0.0]


def block_labels(spec: CampaignSpec, data: ScoredRuns, *, with_source: bool = True) -> list[str]:
    """Block of each run: its flight day, where ``[model] block`` asks for it, and its source where there are two."""
    source_too = with_source and len(set(data.sources)) > 1
    with_block = spec.model.block is not None
    return [
        " ".join(part for part in (source if source_too else "", block if with_block else "") if part) or "all"
        for source, block in zip(data.sources, data.blocks, strict=True)
    ]


def student_weights(Z: FloatArray, y: FloatArray, weights: FloatArray, nu: float = STUDENT_DF) -> FloatArray:
    """Weights (n,) that turn least squares into the most likely fit with Student-t errors.

    Lange, Little & Taylor (1989), J. Am. Stat. Assoc. 84, 881-896: each run counts ``(nu + 1) / (nu + r^2 / s^2)``, so
    that a wild score counts for next to nothing. Scaled to mean 1; with fewer than three residual degrees of freedom
    every run counts alike.
    """
    n, p = Z.shape
    if n < p + 3:
        return weights
    share = np.ones(n)
    for _ in range(_EM_STEPS):
        root = np.sqrt(weights * share)
        beta = np.linalg.lstsq(Z * root[:, None], y * root, rcond=None)[0]
        square = weights * (y - Z @ beta) ** 2
        variance = float(np.sum(share * square)) / (n - p)
        if variance <= (n * np.finfo(np.float64).eps) ** 2 * float(np.mean(y**2)):  # nothing but rounding is left
            return weights
        after = (nu + 1.0) / (nu + square / variance)
        if np.max(np.abs(after - share)) < 1e-10:
            break
        share = after
    found: FloatArray = weights * share / float(np.mean(share))
    return found


def fit_surface(spec: CampaignSpec, model: QuadraticModel, data: ScoredRuns, scale: ResponseScale) -> LeastSquaresFit:
    """Least-squares fit on the scale of ``[model] response``, with blocks and sources as effects.

    Raises
    ------
    FitError
        Fewer scores than terms, or terms that the runs cannot tell apart.
    """
    labels = block_labels(spec, data)
    columns, names = block_columns(labels)
    n, needed = len(data.scores), model.p + len(names)
    if n < needed:
        raise FitError(
            Problem(f"{n} scored runs cannot determine {needed} terms", "Score more runs, or set [model] order = 1.")
        )
    Z = np.hstack([model.matrix(data.points), columns])
    robust = spec.model.errors == "student_t"
    fit = fit_least_squares(
        Z,
        scale.values,
        [*model.terms, *names],
        weights=student_weights(Z, scale.values, scale.weights) if robust else scale.weights,
        setting_ids=setting_ids(data.points),
        block_ids=labels,
    )
    if fit.aliased:
        raise FitError(
            Problem(
                f"the runs cannot tell these terms apart: {', '.join(fit.aliased)}",
                "Add runs that vary these factors (`seqrsm propose`), or set [model] order = 1.",
            )
        )
    return fit


def region_state(spec: CampaignSpec, application: ApplicationSpec, data: ScoredRuns) -> RegionState:
    """The fitted part of the region, from the scored runs batch by batch."""
    if not spec.region_moves or not len(data.scores):
        return RegionState(whole_box(spec.region.k))
    scale = ResponseScale.of(spec.model.response, data.scores)
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
    model = QuadraticModel(region.factors, spec.model.order)
    data = in_box(everything, state.box)
    scale = ResponseScale.of(spec.model.response, data.scores)
    fit = fit_surface(spec, model, data, scale)
    sources = None
    if len(set(data.sources)) > 1:
        columns, _ = block_columns(block_labels(spec, data, with_source=False))
        sources = fit_sources(
            model,
            data.points,
            scale.values,
            [source == "flight" for source in data.sources],
            weights=fit.weights,
            extra=columns,
            prior_sd=spec.model.discrepancy_sd,
        )
    found = find_discrepancy(model, data.points, fit.Z, fit.y, fit.weights)
    departure = Departure(found.evidence, evidence_limit(fit.df_residual))
    return Fitted(region, model, data, scale, fit, sources, state, len(everything.scores), departure)


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
            f"({level:.0%} credible interval {interval.low:.3g} to {interval.high:.3g}); after {found.n_flights} "
            f"flights this is {source} word ({100 * found.prior_share:.0f} % of the prior variance is left). All "
            "intervals are for flights."
        ),
    )


__all__ = [
    "CONFIRMATION",
    "Fitted",
    "block_labels",
    "compare_sources",
    "fit_application",
    "fit_surface",
    "in_box",
    "natural_ranges",
    "range_text",
    "region_history",
    "region_state",
    "scored_runs",
    "setting_ids",
]
