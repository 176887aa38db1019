"""The exact interval of a confirmation set, and whether it agrees with the model."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike
from scipy.special import stdtr

from seqrsm.fit.intervals import t_quantile


@dataclass(frozen=True, slots=True)
class ConfirmationInterval:
    """Interval of the mean of fresh runs at settings fixed before they were made."""

    mean: float
    low: float
    high: float
    """Score units."""
    n: int
    """Number of fresh runs."""
    level: float
    """Two-sided probability."""


@dataclass(frozen=True, slots=True)
class Agreement:
    """Whether a confirmation mean lies in the model's prediction interval for the mean of m runs."""

    agrees: bool

    p: float
    """Two-sided, of Student's t."""
    text: str
    """One sentence with the numbers."""


def confirmation_interval(scores: ArrayLike, level: float = 0.95) -> ConfirmationInterval:
    """Interval of the mean utility at the recommended settings from fresh runs alone.

    Its coverage is exact for normal noise whatever the design and the stopping rule were, because the settings were
    fixed before these runs. There are m >= 2 ``scores`` (m,); ``level`` is the two-sided probability, in (0, 1).
    """
    values = np.asarray(scores, dtype=np.float64)
    mean, s = float(values.mean()), float(values.std(ddof=1))
    half = float(t_quantile(len(values) - 1, level)) * s / np.sqrt(len(values))
    return ConfirmationInterval(mean, mean - half, mean + half, len(values), level)


_FEW = 10
"""Right or wrong decisions below which the scatter of some shares says next to nothing of their variance."""


def counted_confirmation(correct: ArrayLike, trials: ArrayLike, level: float = 0.95) -> ConfirmationInterval:
    """Interval [%] of the mean of m >= 2 fresh runs whose scores are shares of correct decisions.

    The score interval of the pooled share (Wilson 1927, J. Am. Stat. Assoc. 22, 209-212): all p for which
    (share - p)^2 <= t^2 phi p (1 - p) / N, with the dispersion phi that the runs show among each other (1: decisions
    are independent) and Student's t for it. It does not leave 0 to 100 and is skewed as counts are. With fewer than ten
    right or wrong decisions phi is next to unknown; then the interval holds that of independent decisions, too. Of each
    run 0 <= correct <= trials, (m,); ``level`` is the two-sided probability, in (0, 1).
    """
    right, n = np.asarray(correct, dtype=np.float64), np.asarray(trials, dtype=np.float64)
    total, m = float(n.sum()), len(n)
    share = float(right.sum()) / total
    spread = float(np.sum(n * (right / n - share) ** 2)) / (m - 1)
    own = share * (1.0 - share)

    def ends(phi: float, quantile: float) -> tuple[float, float]:
        a = quantile**2 * phi / total
        middle, half = (share + 0.5 * a) / (1.0 + a), np.sqrt(a * own + 0.25 * a**2) / (1.0 + a)
        return max(float(middle - half), 0.0), min(float(middle + half), 1.0)

    low, high = ends(spread / own, float(t_quantile(m - 1, level))) if own > 0.0 else (share, share)
    if min(share, 1.0 - share) * total < _FEW:
        alone = ends(1.0, float(t_quantile(np.inf, level)))
        low, high = min(low, alone[0]), max(high, alone[1])
    return ConfirmationInterval(100.0 * share, 100.0 * low, 100.0 * high, m, level)


def confirmation_agrees(
    confirmation: ConfirmationInterval, *, predicted: float, half_width: float, df: float, text: str = ""
) -> Agreement:
    """Test fresh runs against the model's prediction for their mean.

    ``predicted`` was estimated before the fresh runs, with a prediction interval for that mean of ``half_width`` at the
    level of the fresh runs' own, made with ``df`` degrees of freedom. ``text`` says in score units what was measured
    and predicted, with a place for the verdict and one for its p.
    """
    se = half_width / float(t_quantile(df, confirmation.level))
    difference = confirmation.mean - predicted
    t = float(difference / se) if se > 0.0 else float(np.sign(difference) * np.inf if difference else 0.0)
    p = float(2.0 * stdtr(df, -abs(t)))
    agrees = bool(abs(difference) <= half_width)
    verdict = "in line with" if agrees else "contradicting"
    return Agreement(agrees, p, text.replace("{verdict}", verdict).replace("{p}", f"{p:.2g}"))
