"""The stop rule as data, and the half-width that it looks at."""

from __future__ import annotations

from dataclasses import dataclass, fields
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike
from scipy.special import ndtr, ndtri

from seqrsm.arrays import FloatArray
from seqrsm.decide.intervals import IntervalKind, anytime_half_width, half_width
from seqrsm.errors import Problem, SpecError

Guard = Literal["runs", "confirmation", "anytime", "spending"]

_INTERVAL_NAMES = {
    "prediction": "prediction interval of one future run",
    "prediction_mean": "prediction interval of the mean of {m} future runs",
    "confidence": "confidence interval of the mean",
}


@dataclass(frozen=True, slots=True)
class StopRule:
    """When a campaign may stop.

    Parameters
    ----------
    interval : "prediction", "prediction_mean" or "confidence"
        The interval at the optimum that must be narrow.
    half_width : float
        Its target half-width, score units, > 0.
    level : float
        Two-sided probability of the interval, in (0, 1).
    max_runs : int
        The budget.
    replicates : int
        m of "prediction_mean" and of the confirmation set, >= 2.
    guard : "runs", "confirmation", "anytime" or "spending"
        What guards against stopping on a lucky s: at least ``runs_per_term`` runs for each term; a set of fresh runs
        that agrees with the model; an interval that holds at every look; or an error probability that is spent over the
        looks, little at first (O'Brien-Fleming type, Lan & DeMets 1983).
    runs_per_term : float
        For the guard "runs".
    min_df_pure_error : int
        Degrees of freedom of pure error asked for.
    alpha_lack_of_fit : float
        Lack of fit with a smaller p stops the stopping.

    Raises
    ------
    SpecError
        Naming every value that is impossible.
    """

    interval: IntervalKind = "prediction"
    half_width: float = 1.0
    level: float = 0.95
    max_runs: int = 80
    replicates: int = 5
    guard: Guard = "runs"
    runs_per_term: float = 3.0
    min_df_pure_error: int = 4
    alpha_lack_of_fit: float = 0.05

    def __post_init__(self) -> None:
        limits = {
            "interval": (self.interval in _INTERVAL_NAMES, '"prediction", "prediction_mean" or "confidence"'),
            "half_width": (self.half_width > 0.0 and np.isfinite(self.half_width), "a positive number of score units"),
            "level": (0.0 < self.level < 1.0, "a probability between 0 and 1, such as 0.95"),
            "max_runs": (self.max_runs >= 1, "at least 1"),
            "replicates": (self.replicates >= 2, "at least 2"),
            "guard": (
                self.guard in ("runs", "confirmation", "anytime", "spending"),
                '"runs", "confirmation", "anytime" or "spending"',
            ),
            "runs_per_term": (self.runs_per_term >= 0.0, "0 or more"),
            "min_df_pure_error": (self.min_df_pure_error >= 0, "0 or more"),
            "alpha_lack_of_fit": (0.0 <= self.alpha_lack_of_fit < 1.0, "a probability below 1, such as 0.05"),
        }
        wrong = [
            Problem("impossible stop rule", f"Give {limits[f.name][1]}.", field=f.name, value=getattr(self, f.name))
            for f in fields(self)
            if not limits[f.name][0]
        ]
        if wrong:
            raise SpecError(*wrong)

    @property
    def interval_name(self) -> str:
        """The interval in words."""
        return _INTERVAL_NAMES[self.interval].format(m=self.replicates)

    def min_runs(self, n_terms: int) -> int:
        """Fewest runs the guard allows for a model of ``n_terms`` terms."""
        return int(np.ceil(self.runs_per_term * n_terms)) if self.guard == "runs" else n_terms + 1

    def planned_information(self, n_terms: int) -> float:
        """Information ``1/h`` the guard "anytime" is tuned to: that of average leverage when the budget is spent."""
        return max(self.max_runs / n_terms, 1.0)


def spending_level(rule: StopRule, n_runs: ArrayLike, n_before: ArrayLike = 0) -> FloatArray:
    """Level of the interval at one look under the guard "spending".

    The error probability spent after a share ``t`` of the budget is ``2 - 2 Phi(z / sqrt(t))``, z the quantile of
    ``1 - alpha / 2`` (Lan & DeMets 1983, Biometrika 70, 659-663). Each look has what was not spent at the look before,
    so that all intervals together miss with probability alpha at most (Bonferroni), for a fixed contrast.

    Parameters
    ----------
    rule : StopRule
    n_runs, n_before : array_like of int
        Runs at this look, and at the one before (0: there was none).

    Returns
    -------
    ndarray
        In (0, 1).
    """
    z = float(ndtri(0.5 + 0.5 * rule.level))

    def spent(n: ArrayLike) -> FloatArray:
        share = np.clip(np.asarray(n, dtype=np.float64) / rule.max_runs, 1e-9, 1.0)
        return np.asarray(2.0 * ndtr(-z / np.sqrt(share)))

    return 1.0 - np.clip(spent(n_runs) - spent(n_before), 1e-12, 1.0)


def rule_half_width(
    rule: StopRule,
    s: ArrayLike,
    df_residual: ArrayLike,
    h: ArrayLike,
    n_terms: int,
    *,
    n_runs: ArrayLike | None = None,
    n_before: ArrayLike = 0,
) -> FloatArray:
    """Half-width the rule looks at: Student's, or for the guards "anytime" and "spending" a wider one.

    Parameters
    ----------
    rule : StopRule
    s, df_residual, h : array_like
        Residual standard deviation, its degrees of freedom, and ``z0' (Z'WZ)^-1 z0``.
    n_terms : int
        Terms of the model; ``max_runs / n_terms`` is the information planned for.
    n_runs : array_like, optional
        Runs made, for the guard "spending"; those of the fit by default.
    n_before : array_like, optional
        Runs at the look before, for the same.

    Returns
    -------
    ndarray
        Score units; nan without residual degrees of freedom.
    """
    if rule.guard == "spending":
        made = np.asarray(df_residual) + n_terms if n_runs is None else n_runs
        level = spending_level(rule, made, n_before)
        return half_width(rule.interval, s, df_residual, h, level, rule.replicates)
    if rule.guard != "anytime":
        return half_width(rule.interval, s, df_residual, h, rule.level, rule.replicates)
    planned = rule.planned_information(n_terms)
    return anytime_half_width(rule.interval, s, df_residual, h, rule.level, planned, rule.replicates)
