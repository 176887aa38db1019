"""Quantiles of mixtures of Student-t distributions: what model averages and unknown variance ratios predict."""

from __future__ import annotations

import numpy as np
from scipy.special import gammaln, stdtr

from seqrsm.arrays import FloatArray
from seqrsm.fit.intervals import Interval

_STEPS = 100


def mixture_cdf(x: FloatArray, shares: FloatArray, df: FloatArray, centre: FloatArray, scale: FloatArray) -> FloatArray:
    """P(X <= x) (m,) of m mixtures with ``shares`` (c,), degrees of freedom (c,), centres and scales (m, c)."""
    return np.asarray(np.sum(shares * stdtr(df, (x[:, None] - centre) / scale), axis=1))


def mixture_quantile(
    probability: float, shares: FloatArray, df: FloatArray, centre: FloatArray, scale: FloatArray
) -> FloatArray:
    """Quantile (m,) of each mixture, by Newton steps inside a shrinking bracket.

    Arguments as in :func:`mixture_cdf`, scales > 0; ``probability`` in (0, 1).
    """
    far = 10.0 * scale
    low, high = np.min(centre - far, axis=1), np.max(centre + far, axis=1)
    for _ in range(200):  # heavy tails: widen until the quantile is bracketed
        short = mixture_cdf(low, shares, df, centre, scale) > probability
        long = mixture_cdf(high, shares, df, centre, scale) < probability
        if not np.any(short | long):
            break
        width = high - low
        low, high = np.where(short, low - width, low), np.where(long, high + width, high)
    x = 0.5 * (low + high)
    tiny = 4.0 * np.finfo(np.float64).eps * np.maximum(np.abs(low) + np.abs(high), np.max(scale, axis=1))
    log_constant = gammaln(0.5 * (df + 1.0)) - gammaln(0.5 * df) - 0.5 * np.log(df * np.pi)
    for _ in range(_STEPS):
        excess = mixture_cdf(x, shares, df, centre, scale) - probability
        low, high = np.where(excess < 0.0, x, low), np.where(excess < 0.0, high, x)
        log_kernel = log_constant - 0.5 * (df + 1.0) * np.log1p(np.square((x[:, None] - centre) / scale) / df)
        density = np.sum(shares * np.exp(log_kernel) / scale, axis=1)
        with np.errstate(divide="ignore", over="ignore"):
            newton = x - excess / density
        new = np.where((newton > low) & (newton < high), newton, 0.5 * (low + high))
        done = bool(np.all(np.abs(new - x) <= tiny))
        x = new
        if done:
            break
    return np.asarray(x)


def mixture_interval(
    level: float, shares: FloatArray, df: FloatArray, centre: FloatArray, scale: FloatArray
) -> Interval:
    """Equal-tailed interval of each mixture."""
    if not 0.0 < level < 1.0:
        raise ValueError(f"level must lie between 0 and 1, got {level}")
    tail = 0.5 * (1.0 - level)
    return Interval(
        mixture_quantile(tail, shares, df, centre, scale), mixture_quantile(1.0 - tail, shares, df, centre, scale)
    )
