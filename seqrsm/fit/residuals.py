"""What the runs say against the model: normal plot, influential runs by name, extrapolation."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.special import ndtri, stdtr

from seqrsm.arrays import BoolArray, FloatArray, IntArray
from seqrsm.fit.least_squares import LeastSquaresFit

_OUTLIER = 0.05  # familywise level of the outlier test


@dataclass(frozen=True, slots=True)
class NormalPlot:
    """Ordered studentised residuals beside the normal quantiles they should follow.

    Attributes
    ----------
    runs : ndarray (m,) of int
        Index of the run of each residual; runs without one (leverage 1) are left out.
    quantiles, residuals : ndarray (m,)
        Blom's normal scores, and the externally studentised residuals in ascending order.
    correlation : float
        Of the two; near 1 for normal errors, nan for fewer than 3 runs.
    """

    runs: IntArray
    quantiles: FloatArray
    residuals: FloatArray
    correlation: float


@dataclass(frozen=True, slots=True)
class InfluentialRun:
    """A run that stands out.

    Attributes
    ----------
    run : int
        Index.
    leverage, cooks_distance, studentised : float
    reasons : tuple of str
        Sentences with the figure and the limit it passes.
    """

    run: int
    leverage: float
    cooks_distance: float
    studentised: float
    reasons: tuple[str, ...]


def normal_plot(fit: LeastSquaresFit) -> NormalPlot:
    """Data of the normal plot; empty where no residual is defined."""
    runs = np.flatnonzero(np.isfinite(fit.studentised)).astype(np.int64)
    runs = runs[np.argsort(fit.studentised[runs], kind="stable")]
    residuals = fit.studentised[runs]
    quantiles = np.asarray(ndtri((np.arange(1.0, runs.size + 1.0) - 0.375) / (runs.size + 0.25)), dtype=np.float64)
    spread = runs.size > 2 and float(np.ptp(residuals)) > 0.0
    return NormalPlot(
        runs, quantiles, residuals, float(np.corrcoef(quantiles, residuals)[0, 1]) if spread else float("nan")
    )


def influential_runs(fit: LeastSquaresFit) -> tuple[InfluentialRun, ...]:
    """Runs with Cook's distance above 4/n, leverage above 2p/n, or a residual that fails the outlier test.

    The outlier test is Bonferroni's at 5 %: n p(|t|) < 0.05 with the externally studentised residual, Student-t with
    ``df - 1`` degrees of freedom.

    Returns
    -------
    tuple of InfluentialRun
        The largest Cook's distance first.
    """
    n, p = fit.n_runs, fit.rank
    found = []
    for i in range(n):
        h, d, t = float(fit.leverage[i]), float(fit.cooks_distance[i]), float(fit.studentised[i])
        reasons = []
        if i in fit.leverage_one_runs:
            reasons.append("leverage 1: the model must pass through its score, which nothing can check")
        elif h > 2.0 * p / n:
            reasons.append(f"leverage {h:.2f} is above 2p/n = {2.0 * p / n:.2f}: it stands apart from the other runs")
        if d > 4.0 / n:
            reasons.append(f"Cook's distance {d:.2g} is above 4/n = {4.0 / n:.2g}: without it the surface would move")
        if fit.df_residual > 1 and np.isfinite(t):
            chance = 2.0 * n * float(stdtr(fit.df_residual - 1.0, -abs(t)))
            if chance < _OUTLIER:
                reasons.append(f"studentised residual {t:.1f}: an outlier at {max(chance, 1e-6):.2g} in {n} runs")
        if reasons:
            found.append(InfluentialRun(i, h, d, t, tuple(reasons)))
    return tuple(sorted(found, key=lambda run: -run.cooks_distance if np.isfinite(run.cooks_distance) else -np.inf))


def extrapolated(fit: LeastSquaresFit, rows: FloatArray) -> BoolArray:
    """Which model rows (m, p) are further from the runs than any run is: z'Cz above that of every run.

    Both sides leave out the weights: a precise run does not reach further. True where the mean is not estimable.
    """
    limit = float(np.max(fit.variance_unscaled(fit.Z)))
    return np.asarray(~(fit.variance_unscaled(rows) <= limit * (1.0 + 1e-9)))
