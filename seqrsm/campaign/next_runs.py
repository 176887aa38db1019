"""Which runs to make next: the start design, then batches chosen for the interval at the optimum."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from seqrsm.arrays import FloatArray
from seqrsm.campaign.analysis import Analysis
from seqrsm.campaign.records import NewRun, RunRecord
from seqrsm.campaign.spec import CampaignSpec
from seqrsm.design.factors import CategoricalFactor
from seqrsm.design.optimal import optimal_design, start_design
from seqrsm.design.quadratic import QuadraticModel
from seqrsm.design.region import Region
from seqrsm.fit.anova import LackOfFit
from seqrsm.propose.batch import propose_batch

START = "start"
CENTRE_REPEATS = 3
EXTRA_RUNS = 6
"""Runs of the start design beyond one for each term: campaign studies found 4 to 6 enough for a first look."""

SIGNIFICANT_DIGITS = 4
"""Settings are proposed with this many: nobody sets a frequency to sixteen digits."""


def start_size(model: QuadraticModel, spec: CampaignSpec) -> int:
    """Runs of the start design: at most the budget, and never fewer than its own repeats need."""
    return max(min(model.p + EXTRA_RUNS, spec.stop.max_runs), model.p + CENTRE_REPEATS - 1)


def start_batch(spec: CampaignSpec, model: QuadraticModel, source: str, made: Sequence[RunRecord] = ()) -> list[NewRun]:
    """Start design, or what is missing of it when ``made`` holds runs already."""
    n = start_size(model, spec)
    if made:
        fixed = spec.region.code([run.settings for run in made])
        points = optimal_design(model, spec.region, max(n - len(made), 1), seed=spec.seed, fixed=fixed).points
    else:
        points = start_design(model, spec.region, n, CENTRE_REPEATS, spec.seed)
    cost = spec.cost.simulation if source == "simulation" else spec.cost.flight
    why = f"start design: {n} runs for a model of {model.p} terms"
    return [NewRun(settings, START, why, source, cost) for settings in rounded_settings(spec.region, points)]


def next_batch(
    spec: CampaignSpec,
    model: QuadraticModel,
    analyses: Sequence[Analysis],
    active: Sequence[RunRecord],
    n: int,
    source: str,
    failed: Sequence[RunRecord] = (),
) -> list[NewRun]:
    """Batch by the default criterion; several applications take turns, by weight.

    Parameters
    ----------
    spec, model
    analyses : sequence of Analysis
        One for each application, of the scores so far.
    active : sequence of RunRecord
        Scored and pending runs; pending ones count as made.
    n : int
        Runs wanted.
    source : "simulation" or "flight"
        Who will make them.
    failed : sequence of RunRecord
        Settings that could not be carried out; they are not proposed again.
    """
    region = spec.region
    cost = spec.cost.simulation if source == "simulation" else spec.cost.flight
    barred = region.code([run.proposed for run in failed]) if failed else np.empty((0, region.k))
    made: list[NewRun] = []
    for index, share in _shares(spec, n):
        analysis = analyses[index]
        done = [run.settings for run in active] + [dict(run.settings) for run in made]
        points = region.code(done)
        proposals = propose_batch(
            model,
            region,
            Z_done=model.matrix(points),
            x_hat=analysis.optimum.point,
            target_points=analysis.posterior.optimum_points[:256],
            n=share + len(barred),
            points_done=points,
            df_pure_error=_pure_error_df(analysis, active),
            seed=(spec.seed + 7919 * len(done)) % 2**32,
        )
        allowed = [p for p in proposals if not _is_barred(p.point, barred)][:share]
        settings = rounded_settings(region, np.array([p.point for p in allowed]).reshape(-1, region.k))
        for proposal, setting in zip(allowed, settings, strict=True):
            why = proposal.why if len(analyses) == 1 else f"{analysis.application}: {proposal.why}"
            made.append(NewRun(setting, proposal.purpose, why, source, cost))
    return made


def _shares(spec: CampaignSpec, n: int) -> list[tuple[int, int]]:
    """Runs of the batch for each application, in proportion to the weights; the largest remainders round up."""
    weights = np.array([application.weight for application in spec.applications])
    wanted = n * weights / weights.sum()
    counts = np.floor(wanted).astype(int)
    for index in np.argsort(counts - wanted, kind="stable")[: n - int(counts.sum())]:
        counts[index] += 1
    return [(index, int(count)) for index, count in enumerate(counts) if count]


def _pure_error_df(analysis: Analysis, active: Sequence[RunRecord]) -> int:
    """Degrees of freedom of pure error that scored runs have and pending repeats will bring."""
    scored = analysis.lack_of_fit.df_pe if isinstance(analysis.lack_of_fit, LackOfFit) else 0
    return scored + sum(run.state != "scored" and run.purpose == "repeat" for run in active)


def _is_barred(point: FloatArray, barred: FloatArray) -> bool:
    return bool(len(barred)) and bool(np.any(np.all(np.abs(barred - point) < 1e-3, axis=1)))


def rounded_settings(region: Region, points: FloatArray) -> list[dict[str, float | str]]:
    """Natural settings to `SIGNIFICANT_DIGITS`, where rounding does not leave the region."""
    found = []
    for point, settings in zip(points, region.decode(points), strict=True):
        rounded: dict[str, float | str] = {
            factor.name: value
            if isinstance(value, str) or isinstance(factor, CategoricalFactor)
            else float(f"{value:.{SIGNIFICANT_DIGITS}g}")
            for factor, value in ((f, settings[f.name]) for f in region.factors)
        }
        at_bounds = np.abs(point) >= 1.0 - 1e-9
        for j in region.numeric:
            if at_bounds[j]:  # a bound is a number the user wrote
                rounded[region.names[j]] = settings[region.names[j]]
        found.append(rounded if region.feasible(region.code([rounded]))[0] else dict(settings))
    return found
