"""Whole campaigns simulated forward: how a stop rule behaves before it is used.

Truths are drawn from the posterior (or a prior), each campaign gets its own noise, and runs are chosen by the same
greedy gain as real ones. What differs from a real campaign: runs are chosen from a fixed set of candidates, without the
cloud around the optimum, and the posterior of a campaign is that of least squares; both make the figures a little
pessimistic. Under constraints optima are looked for on a dense set of feasible points.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from seqrsm.arrays import BoolArray, FloatArray, IntArray
from seqrsm.decide.campaigns import Campaigns, Stage
from seqrsm.decide.rule import StopRule
from seqrsm.design.quadratic import QuadraticModel
from seqrsm.design.region import Region
from seqrsm.errors import DesignError, Problem
from seqrsm.fit.optimum import Goal

_GROUP = 250  # campaigns that move in step: bounds the memory


@dataclass(frozen=True, slots=True)
class Rehearsal:
    """What the rule did in simulated campaigns; arrays hold one entry per campaign.

    Attributes
    ----------
    rule : StopRule
    n_start, batch_size : int
        Runs of the start design and of each batch.
    stopped : ndarray (c,) of bool
        The rule held before the budget was spent.
    runs : ndarray (c,) of int
        Runs made, confirmation runs included.
    cost : ndarray (c,)
        ``runs`` times the cost of a run.
    half_width : ndarray (c,)
        Half-width the rule looked at, at the end, score units.
    covers_rule : ndarray (c,) of bool
        The rule's interval held what it is for: one new run, the mean of m new runs, or the true mean at the settings.
    covers_new_run, covers_mean : ndarray (c,) of bool
        The Student intervals held one new run, and the true mean, at the recommended settings.
    covers_confirmation : ndarray (c,) of bool
        The t interval of a fresh set of ``rule.replicates`` runs held the true mean there.
    regret : ndarray (c,)
        True optimum less true mean at the recommended settings, >= 0, score units.
    s_ratio : ndarray (c,)
        Residual standard deviation over the true one at the end.
    """

    rule: StopRule
    n_start: int
    batch_size: int
    stopped: BoolArray
    runs: IntArray
    cost: FloatArray
    half_width: FloatArray
    covers_rule: BoolArray
    covers_new_run: BoolArray
    covers_mean: BoolArray
    covers_confirmation: BoolArray
    regret: FloatArray
    s_ratio: FloatArray

    @property
    def n_campaigns(self) -> int:
        """Number of campaigns."""
        return len(self.runs)

    @property
    def share_stopped(self) -> float:
        """Share of campaigns in which the rule held within the budget."""
        return float(self.stopped.mean())

    def runs_needed(self, probability: float) -> float:
        """Runs within which the rule held in this share of campaigns; inf where the budget did not suffice."""
        ended = np.sort(np.where(self.stopped, self.runs.astype(np.float64), np.inf))
        index = min(int(np.ceil(probability * len(ended))), len(ended)) - 1
        return float(ended[max(index, 0)])

    def coverage(self, of: str = "rule", stopped_only: bool = False) -> tuple[float, float]:
        """Coverage and its binomial standard error.

        Parameters
        ----------
        of : "rule", "new_run", "mean" or "confirmation"
        stopped_only : bool
            Leave out campaigns that ended on their budget.

        Returns
        -------
        tuple of float
            nan where no campaign is left.
        """
        covers: BoolArray = getattr(self, f"covers_{of}")
        chosen = covers[self.stopped] if stopped_only else covers
        if not len(chosen):
            return float("nan"), float("nan")
        share = float(chosen.mean())
        return share, share_se(share, len(chosen))

    def summary(self, unit: str = "") -> tuple[str, ...]:
        """Return sentences with the figures; ``unit`` is that of the score."""
        suffix = f" {unit}" if unit else ""
        share = f"the rule held in {100 * self.share_stopped:.0f} % within {self.rule.max_runs} runs"
        held = [f"{self.n_campaigns} campaigns: {share}."]
        if self.stopped.any():
            low, middle, high = np.quantile(self.runs[self.stopped], [0.1, 0.5, 0.9])
            held.append(f"Where it held, after {middle:.0f} runs (10 % by {low:.0f}, 90 % by {high:.0f}).")
        cover, se = self.coverage("rule")
        held.append(
            f"The {self.rule.interval_name} held in {100 * cover:.1f} ± {100 * se:.1f} % "
            f"(nominal {100 * self.rule.level:g} %)."
        )
        mean, mean_se = self.coverage("mean")
        new, new_se = self.coverage("new_run")
        held.append(
            f"Coverage at the recommended settings: mean {100 * mean:.1f} ± {100 * mean_se:.1f} %, "
            f"one new run {100 * new:.1f} ± {100 * new_se:.1f} %."
        )
        median, worst = np.quantile(self.regret, [0.5, 0.9])
        held.append(
            f"Utility lost against the true optimum: median {median:.2g}{suffix}, 90 % below {worst:.2g}{suffix}."
        )
        low, middle, high = np.quantile(self.cost, [0.1, 0.5, 0.9])
        held.append(f"Cost: median {middle:.4g} (10 % below {low:.4g}, 90 % below {high:.4g}).")
        return tuple(held)


def share_se(share: float, n: int) -> float:
    """Standard error of a share of ``n`` campaigns, half a campaign added to either side: never 0 for none or all."""
    p = (share * n + 0.5) / (n + 1.0)
    return float(np.sqrt(p * (1.0 - p) / n))


def rehearse(
    model: QuadraticModel,
    region: Region,
    *,
    beta_draws: FloatArray,
    sigma_draws: FloatArray,
    rule: StopRule,
    start_points: FloatArray,
    batch_size: int = 4,
    n_campaigns: int = 200,
    seed: int = 0,
    goal: Goal = "maximize",
    cost_per_run: float = 1.0,
    spread_share: float = 0.25,
    n_targets: int = 16,
    n_candidates: int = 700,
    progress: Callable[[int, int], None] | None = None,
) -> Rehearsal:
    """Simulate whole campaigns under a stop rule.

    Parameters
    ----------
    model, region : QuadraticModel, Region
    beta_draws : ndarray (m, p)
        Truths to draw from: posterior (or prior) draws of the coded coefficients, score units.
    sigma_draws : ndarray (m,)
        Standard deviation of one run, with each draw.
    rule : StopRule
    start_points : ndarray (n0, k)
        Coded start design, with its repeats; n0 > p and estimable.
    batch_size : int
        Runs between two looks, >= 1.
    n_campaigns : int
        Campaigns to simulate, >= 1.
    seed : int
        Equal inputs and seed give equal results.
    goal : "maximize" or "minimize"
    cost_per_run : float
    spread_share : float
        As in ``propose_batch``.
    n_targets : int
        Posterior draws of the optimum per look.
    n_candidates : int
        Points to choose runs from.
    progress : callable, optional
        Called with the number of campaigns that have ended and their total.

    Returns
    -------
    Rehearsal

    Raises
    ------
    DesignError
        The start design cannot estimate the model and its noise.
    """
    start = np.atleast_2d(np.asarray(start_points, dtype=np.float64))
    Z_start = model.matrix(start)
    if len(start) <= model.p or np.linalg.matrix_rank(Z_start) < model.p:
        raise DesignError(
            Problem(
                f"{len(start)} start runs cannot estimate {model.p} terms and the noise",
                f"Start with an optimal design of {model.p + 4} runs or more.",
                field="start_points",
            )
        )
    rng = np.random.default_rng(seed)
    chosen = rng.integers(len(beta_draws), size=n_campaigns)
    betas = np.asarray(beta_draws, dtype=np.float64)[chosen]
    sigmas = np.asarray(sigma_draws, dtype=np.float64)[chosen]
    stage = Stage(model, region, start, rule, batch_size, goal, spread_share, n_targets, n_candidates)
    groups = []
    for first in range(0, n_campaigns, _GROUP):
        part = slice(first, min(first + _GROUP, n_campaigns))

        def report(ended: int, first: int = first) -> None:
            if progress is not None:
                progress(first + ended, n_campaigns)

        groups.append(Campaigns(stage, betas[part], sigmas[part], rng).run(report))
    joined = {name: np.concatenate([group[name] for group in groups]) for name in groups[0]}
    return Rehearsal(
        rule=rule,
        n_start=len(start),
        batch_size=batch_size,
        stopped=joined["stopped"].astype(bool),
        runs=joined["runs"].astype(np.int64),
        cost=joined["runs"] * cost_per_run,
        half_width=joined["half_width"],
        covers_rule=joined["covers_rule"].astype(bool),
        covers_new_run=joined["covers_new_run"].astype(bool),
        covers_mean=joined["covers_mean"].astype(bool),
        covers_confirmation=joined["covers_confirmation"].astype(bool),
        regret=joined["regret"],
        s_ratio=joined["s_ratio"],
    )
