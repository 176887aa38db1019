"""``seqrsm rehearse``: what the stop rule would do, on truths drawn from what is believed now.

Each rehearsed campaign is one as `run` makes it, from its own start design: the same analysis, proposals and rule, with
scores that are the truth's and noise of the size found.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass, replace
from typing import Any

import numpy as np
from scipy.special import ndtri

from seqrsm.analysis.conclude import LOOK_DRAWS, analyse, stop_rule
from seqrsm.analysis.ground import Ground, ground_of_scores
from seqrsm.analysis.posterior import draw_coefficients
from seqrsm.analysis.results import Analysis
from seqrsm.analysis.runs import evidence
from seqrsm.analysis.scale import Interval
from seqrsm.arrays import FloatArray
from seqrsm.campaign.campaign import Campaign
from seqrsm.campaign.next_runs import confirmation_batch, next_batch, start_batch
from seqrsm.errors import FitError
from seqrsm.fit.error_models import Draws
from seqrsm.fit.optimum import optimum, sign_of
from seqrsm.propose.cloud import climb
from seqrsm.rng import generator
from seqrsm.spec.read import CampaignSpec
from seqrsm.store.records import CONFIRMATION, NewRun, NewScore, RunRecord, ScoreRecord

_PLACES = 2000


@dataclass(frozen=True, slots=True)
class _Truth:
    """A surface on the scale of the fit, standard deviations of its runs and of their days, and its best value."""

    mean: Callable[[FloatArray], FloatArray]
    sd: Callable[[FloatArray], FloatArray]
    of_day: float
    best: float


def rehearse_campaign(campaign: Campaign, n_campaigns: int, progress: Callable[[int, int], None]) -> dict[str, Any]:
    """Rehearse the first application's campaign from what is believed now.

    Returns ``campaigns``; ``rows``: label and text; ``notes``; and the plain numbers under ``numbers``. FitError of too
    few scores to know anything yet, or scores without scatter.
    """
    analysis = campaign.analyse_all(campaign.spec.applications[0].name)[0]
    spec = _plain(campaign.spec, analysis)
    draws = draw_coefficients(campaign.spec, analysis.fitted, sampler="exact", n_draws=2000)
    if not np.any(draws.sigma > 0.0):
        raise FitError("the scores do not scatter, so nothing is known of how future ones do", "Score repeated runs.")
    ended = []
    for i in range(n_campaigns):
        progress(i, n_campaigns)
        rng = generator(spec.seed, i, "rehearsal")
        truth = _truth(analysis, draws, rng)
        ended.append(_rehearsed(replace(spec, seed=spec.seed + 1 + i), analysis, truth, rng))
    progress(n_campaigns, n_campaigns)
    return _summary(campaign.spec, analysis, draws, ended)


def _plain(spec: CampaignSpec, analysis: Analysis) -> CampaignSpec:
    """The first application alone, its scores normal and of equal weight unless they are counts.

    In random blocks or none: what constants new ones would have, nobody knows.
    """
    weights = "counts" if np.isfinite(analysis.scale.trials) else "equal"
    blocks = {"block": None, "block_effect": "fixed"} if analysis.fitted.surface.fixed_blocks else {}
    model = spec.model.model_copy(update={"errors": "normal", "weights": weights, **blocks})
    return replace(spec, applications=spec.applications[:1], considerations=(), model=model, simulator=None)


def _truth(analysis: Analysis, draws: Draws, rng: np.random.Generator) -> _Truth:
    """A draw of the process, or of the quadratic, by their probabilities."""
    fitted, goal, region = analysis.fitted, analysis.goal, analysis.region
    process, sign = fitted.departure.believed, sign_of(goal)
    if process is not None and rng.random() < fitted.departure.probability:
        mean, sigma, of_day = process.draw(rng)
        (point, *_) = climb(lambda at: sign * mean(at), region, region.sample(_PLACES, rng), rng)
        best = float(mean(point[None, :])[0])
    else:
        i = int(rng.integers(len(draws.sigma)))
        sigma, of_day = draws.sigma[i], 0.0 if draws.sigma_block is None else float(draws.sigma_block[i])
        beta = draws.terms[i]
        mean = lambda at: np.asarray(analysis.model.matrix(at) @ beta)  # noqa: E731
        best = optimum(analysis.model, region, beta, goal).value
    sigma *= np.sqrt(fitted.surface.errors.run_variance)  # of the law's scale, which all these draws are of
    return _Truth(mean, lambda at: np.asarray(sigma / np.sqrt(fitted.scale.weight_at(mean(at)))), of_day, best)


def make_campaign(
    spec: CampaignSpec,
    source: str,
    score: Callable[[FloatArray], Sequence[NewScore]],
    *,
    n_draws: int,
    ground: Ground | None = None,
) -> tuple[Analysis, list[RunRecord]]:
    """A campaign of one application as `run` makes it, in memory: its last look, and all runs.

    ``score`` gives scores of new runs at coded points (n, k), in their order; the same settings may score otherwise
    next time. Each call is for one batch, which is a block of its own where the model has blocks. Every run is of the
    ``source``; ``n_draws`` are drawn of the posterior at each look. ``ground``: what is known of its part of the
    scatter.
    """
    (application,) = spec.applications
    runs: list[RunRecord] = []
    batch = 1
    new = start_batch(spec, source)
    blocked = spec.model.block is not None
    while True:
        new = [replace(run, block=f"day {batch}") for run in new] if blocked else new
        scores = score(spec.region.code([run.settings for run in new]))
        runs += [
            scored_run(len(runs) + 1 + i, batch, run, scored)
            for i, (run, scored) in enumerate(zip(new, scores, strict=True))
        ]
        analysis = analyse(spec, application, runs, ground=ground, n_draws=n_draws)
        left = spec.stop.max_runs - sum(run.purpose != CONFIRMATION for run in runs)
        batch += 1
        if analysis.decision.wants_confirmation:
            new = confirmation_batch(spec, [analysis], source)
        elif analysis.decision.held or left <= 0:
            return analysis, runs
        else:
            new = next_batch(spec, [analysis], evidence(runs), min(spec.batch, left), source)


def scored_run(number: int, batch: int, run: NewRun, score: NewScore) -> RunRecord:
    """The record of a run as it stands in the store once it is scored."""
    return RunRecord(
        run_id=number,
        batch=batch,
        purpose=run.purpose,
        why=run.why,
        source=run.source,
        state="scored",
        proposed=dict(run.settings),
        executed=None,
        block=run.block,
        cost=run.cost,
        attempts=1,
        scores=(ScoreRecord(number, **asdict(score), scored_at=""),),
    )


def _rehearsed(spec: CampaignSpec, known: Analysis, truth: _Truth, rng: np.random.Generator) -> dict[str, float]:
    """How one campaign on one truth ends: whether it stops, runs, loss, and by interval the share that it covers."""
    name, limits, unlimited = spec.applications[0].name, spec.applications[0].score_limits, known.scale.to_score
    trials = round(known.scale.trials) if np.isfinite(known.scale.trials) else None

    def to_score(values: FloatArray, runs: float = np.inf, scatter: FloatArray | float = 0.0) -> FloatArray:
        return np.clip(unlimited(values, runs, scatter), *limits)

    def score(points: FloatArray) -> list[NewScore]:
        values, scatter = truth.mean(points), truth.sd(points) * rng.standard_normal(len(points))
        if truth.of_day:
            scatter += truth.of_day * rng.standard_normal()
        # The rule asks whether the optimum beats a guess, where that was simulated.
        of_guess = {"guess": known.data.guess}
        scores = [float(one) for one in to_score(values, 1.0, scatter)]
        if trials is None:
            return [NewScore(name, one, metadata=of_guess) for one in scores]
        counted = [round(one * trials / 100.0) for one in scores]
        return [NewScore(name, 100.0 * n / trials, n=trials, correct=n, metadata=of_guess) for n in counted]

    at, ground = known.optimum.point[None, :], known.fitted.ground
    part = known.fitted.ground_share
    if ground is not None:  # measured anew, of runs that scatter as this truth's do
        draws = generator(spec.seed, 0, "rehearsal: ground")
        shape = (ground.n_worlds, ground.n_simulations // ground.n_worlds)
        own, common = draws.standard_normal(shape), draws.standard_normal((ground.n_worlds, 1))
        scatter = truth.sd(at) * (np.sqrt(part) * common + np.sqrt(1.0 - part) * own)
        ground = ground_of_scores(to_score(truth.mean(at), 1.0, scatter))
    analysis, runs = make_campaign(spec, known.data.sources[0], score, n_draws=LOOK_DRAWS, ground=ground)
    best = analysis.optimum
    at = best.point[None, :]
    mean, sd = truth.mean(at), np.hypot(truth.sd(at), truth.of_day)
    future = to_score(mean, 1.0, sd * rng.standard_normal((400, 1)))
    # Flights of one day, over one ground: its part of the scatter is theirs in common.
    share = (truth.of_day / sd) ** 2 if truth.of_day else part
    common, chance = rng.standard_normal((400, 1)), rng.standard_normal((400, best.replicates))
    several = np.mean(to_score(mean, 1.0, sd * (np.sqrt(share) * common + np.sqrt(1.0 - share) * chance)), axis=1)
    # What the ends of the scale keep from the scatter moves the mean.
    scattered = unlimited(mean, scatter=sd * ndtri((np.arange(400) + 0.5) / 400.0))
    true = unlimited(mean) + np.mean(np.clip(scattered, *limits) - scattered)
    covered = {
        "confidence": _share(true, best.confidence),
        "prediction": _share(future, best.prediction),
        "prediction_mean": _share(several, best.prediction_mean),
    }
    loss = abs(float(to_score(np.array([truth.best]))[0]) - float(to_score(mean)[0]))
    return {
        **covered,
        "rule": covered[spec.stop.interval],
        "held": analysis.decision.held,
        "runs": len(runs),
        "loss": loss,
    }


def _share(values: FloatArray, interval: Interval) -> float:
    return float(np.mean((values >= interval.low) & (values <= interval.high)))


def _summary(spec: CampaignSpec, analysis: Analysis, draws: Draws, ended: Sequence[dict[str, float]]) -> dict[str, Any]:
    found = {name: np.array([one[name] for one in ended]) for name in ended[0]}
    low, middle, high = (int(x) for x in np.quantile(found["runs"], [0.1, 0.5, 0.9]))
    numbers = {
        "stopped": float(np.mean(found["held"])),
        "runs_p10": low,
        "runs_median": middle,
        "runs_p90": high,
        "cost_median": float(np.median(found["runs"] * spec.cost.of(spec.own_source))),
        "coverage_rule": float(np.mean(found["rule"])),
        "coverage_new_run": float(np.mean(found["prediction"])),
        "coverage_mean": float(np.mean(found["confidence"])),
        "regret_median": float(np.median(found["loss"])),
        "regret_p95": float(np.quantile(found["loss"], 0.95)),
    }

    def share(name: str) -> str:
        """With its standard error, half a campaign added to either side: never 0 for none or all."""
        n = len(ended)
        p = (numbers[name] * n + 0.5) / (n + 1.0)
        return f"{100 * numbers[name]:.1f} % ± {100 * np.sqrt(p * (1.0 - p) / n):.1f}"

    lost = f"{numbers['regret_median']:.3g} ({numbers['regret_p95']:.3g}) {analysis.score_unit}".rstrip()
    rows = [
        ("campaigns that stop before the budget", share("stopped")),
        ("runs needed, median (10 % to 90 %)", f"{middle} ({low} to {high})"),
        (f"coverage of the {stop_rule(spec.stop).interval_name}", share("coverage_rule")),
        ("coverage of one new run at the optimum", share("coverage_new_run")),
        ("coverage of the mean at the optimum", share("coverage_mean")),
        ("utility lost, median (95 %)", lost),
    ]
    if spec.cost.told_unit:
        rows.insert(2, ("cost, median", f"{numbers['cost_median']:g} {spec.cost.told_unit}"))
    quadratics = 100 * (1.0 - analysis.fitted.departure.probability)
    notes = [
        f"Surfaces are drawn from the posterior: {quadratics:.0f} % of them are quadratics. Errors are normal; "
        "± is a Monte Carlo standard error."
    ]
    if len(spec.applications) > 1:
        notes.append(f"Rehearsed is the first application alone: {analysis.application}.")
    if draws.sigma_block is not None:
        notes.append("Each rehearsed batch is a block of its own.")
    if np.isfinite(analysis.scale.trials):
        notes.append(f"All rehearsed runs are shares of {analysis.scale.trials:g} decisions, the median n.")
    elif spec.model.weights == "se":
        notes.append("All rehearsed runs scatter as expected of the median standard error.")
    return {"campaigns": len(ended), "rows": rows, "notes": notes, "numbers": numbers}
