"""Intervals and tests as data, with the quantiles behind them."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from scipy.special import fdtrc, stdtrit

from seqrsm.arrays import FloatArray


@dataclass(frozen=True, slots=True)
class Interval:
    """Lower and upper end, arrays of one shape; nan where the interval is not defined."""

    low: FloatArray
    high: FloatArray

    @property
    def half_width(self) -> FloatArray:
        """Half of ``high - low``."""
        return 0.5 * (self.high - self.low)

    def with_error(self, mean: FloatArray, shift: FloatArray, variance: FloatArray, quantile: float) -> Interval:
        """A t interval about ``mean`` that counts a further error: its expectation, its variance, the t factor."""
        error = quantile * np.sqrt(variance)
        return Interval(
            mean + shift - np.hypot(mean - self.low, error), mean + shift + np.hypot(self.high - mean, error)
        )


@dataclass(frozen=True, slots=True)
class Prediction:
    """Estimated response with both intervals at m points.

    Attributes
    ----------
    mean : ndarray (m,)
        Estimated mean response; nan where it is not estimable.
    confidence : Interval
        Of the mean response (RSL TR 380-1 eq. 2-17).
    prediction : Interval
        Of the mean of ``replicates`` future runs (eq. 2-23 with the factor S that is missing in print).
    se_mean, se_prediction : ndarray (m,)
        Standard errors behind the two intervals.
    level : float
        Coverage of each interval.
    reason : str
        Why intervals are nan; empty when none is.
    """

    mean: FloatArray
    confidence: Interval
    prediction: Interval
    se_mean: FloatArray
    se_prediction: FloatArray
    level: float
    reason: str

    def with_error(self, shift: FloatArray, variance: FloatArray, df: float) -> Prediction:
        """The same with an error of the mean counted that is not in yet: its expectation and variance (m,)."""
        quantile = student_quantile(df, self.level)
        return replace(
            self,
            mean=self.mean + shift,
            confidence=self.confidence.with_error(self.mean, shift, variance, quantile),
            prediction=self.prediction.with_error(self.mean, shift, variance, quantile),
            se_mean=np.sqrt(self.se_mean**2 + variance),
            se_prediction=np.sqrt(self.se_prediction**2 + variance),
        )


@dataclass(frozen=True, slots=True)
class FTest:
    """Partial F test of a group of terms (RSL TR 380-1 eq. 2-14).

    ``df`` is the rank of the group given the other terms, ``ss`` the extra sum of squares, ``ms = ss / df``;
    ``f`` and ``p`` are nan, with ``reason``, where no test exists.
    """

    df: int
    ss: float
    ms: float
    f: float
    p: float
    reason: str = ""


def student_quantile(df: float, level: float) -> float:
    """Two-sided Student-t factor t(df, (1 - level) / 2); nan for df = 0."""
    if not 0.0 < level < 1.0:
        raise ValueError(f"level must lie between 0 and 1, got {level}")
    return float(stdtrit(float(df), 0.5 + 0.5 * level)) if df > 0 else float("nan")


def f_ratio(ss: float, df: int, sse: float, df_residual: int) -> tuple[float, float, str]:
    """F = (ss / df) / (sse / df_residual), its p value, and the reason where they are nan."""
    nan = float("nan")
    if df_residual == 0:
        return nan, nan, "no residual degrees of freedom"
    if sse == 0.0:
        return nan, nan, "the model reproduces every score exactly, so there is no error to test against"
    f = (ss / df) / (sse / df_residual)
    return f, float(fdtrc(df, df_residual, f)), ""
