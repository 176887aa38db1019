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

_GROUP = 250  # campaigns that move in step: bounds the memory


@dataclass(frozen=True, slots=True)
class Rehearsal:
    """What the rule did in simulated campaigns; arrays hold one entry per campaign.

    Attributes
    ----------
    stopped : ndarray (c,) of bool
        The rule held before the budget was spent.
    runs : ndarray (c,) of int
        Runs made, confirmation runs included.
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

    stopped: BoolArray
    runs: IntArray
    half_width: FloatArray
    covers_rule: BoolArray
    covers_new_run: BoolArray
    covers_mean: BoolArray
    covers_confirmation: BoolArray
    regret: FloatArray
    s_ratio: FloatArray


def share_se(share: float, n: int) -> float:
    """Standard error of a share of ``n`` campaigns, half a campaign added to either side: never 0 for none or all."""
    p = (share * n + 0.5) / (n + 1.0)
    return float(np.sqrt(p * (1.0 - p) / n))


def rehearse(
    stage: Stage,
    beta_draws: FloatArray,
    sigma_draws: FloatArray,
    n_campaigns: int = 200,
    seed: int = 0,
    progress: Callable[[int, int], None] | None = None,
) -> Rehearsal:
    """Simulate whole campaigns under a stop rule.

    Parameters
    ----------
    stage : Stage
        What all campaigns share: the model, the rule, the start design.
    beta_draws : ndarray (m, p)
        Truths to draw from: posterior (or prior) draws of the coded coefficients, score units.
    sigma_draws : ndarray (m,)
        Standard deviation of one run, with each draw.
    n_campaigns : int
        Campaigns to simulate, >= 1.
    seed : int
        Equal inputs and seed give equal results.
    progress : callable, optional
        Called with the number of campaigns that have ended and their total.

    Returns
    -------
    Rehearsal
    """
    rng = np.random.default_rng(seed)
    chosen = rng.integers(len(beta_draws), size=n_campaigns)
    betas = np.asarray(beta_draws, dtype=np.float64)[chosen]
    sigmas = np.asarray(sigma_draws, dtype=np.float64)[chosen]
    groups = []
    for first in range(0, n_campaigns, _GROUP):
        part = slice(first, min(first + _GROUP, n_campaigns))

        def report(ended: int, first: int = first) -> None:
            if progress is not None:
                progress(first + ended, n_campaigns)

        groups.append(Campaigns(stage, betas[part], sigmas[part], rng).run(report))
    joined = {name: np.concatenate([group[name] for group in groups]) for name in groups[0]}
    held = {name: joined[name].astype(bool) for name in joined if name == "stopped" or name.startswith("covers_")}
    rest = {name: joined[name] for name in ("half_width", "regret", "s_ratio")}
    return Rehearsal(runs=joined["runs"].astype(np.int64), **held, **rest)
