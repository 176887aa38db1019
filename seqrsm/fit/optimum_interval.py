"""Intervals at the estimated optimum that allow for its having been searched for.

The t intervals of RSL TR 380-1 eq. (2-17) and (2-23) hold at a setting fixed beforehand. The fitted maximum is where
surface and error together are highest, so its value is too high on average and the t interval misses the true response
there too often: hardly where the surface is curved beside the noise, by many percent where it is flat. A parametric
bootstrap, with the search repeated in every draw, shows by how much. The interval given is the wider of the t interval
and the bootstrap-t interval at each end, since either alone can be short.

References
----------
Efron, Tibshirani (1993), An introduction to the bootstrap, chapters 12 and 14 (bootstrap-t).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from seqrsm.arrays import FloatArray
from seqrsm.design.quadratic import QuadraticModel
from seqrsm.design.region import Region
from seqrsm.errors import FitError, Problem
from seqrsm.fit.intervals import student_quantile
from seqrsm.fit.least_squares import LeastSquaresFit
from seqrsm.fit.optimum import Goal, optimum, optimum_draws


@dataclass(frozen=True, slots=True)
class SearchedInterval:
    """Estimate at the optimum with intervals that allow for the search.

    Attributes
    ----------
    point : ndarray (k,)
    mean : float
        Fitted value there.
    optimism : float
        By how much the fitted optimum exceeds (minimum: falls short of) the true response there, on average.
    confidence, prediction : tuple of float
        Of the mean response there, and of the mean of ``replicates`` future runs.
    level : float
    """

    point: FloatArray
    mean: float
    optimism: float
    confidence: tuple[float, float]
    prediction: tuple[float, float]
    level: float


def searched_interval(
    model: QuadraticModel,
    region: Region,
    fit: LeastSquaresFit,
    goal: Goal = "maximize",
    *,
    level: float = 0.95,
    weight: float = 1.0,
    replicates: int = 1,
    draws: int = 1000,
    seed: int = 0,
) -> SearchedInterval:
    """Intervals at the estimated optimum, with the search repeated in ``draws`` bootstrap surfaces.

    Parameters
    ----------
    model, region : QuadraticModel, Region
    fit : LeastSquaresFit
        Its first columns are the model's terms; blocks may follow.
    goal : "maximize" or "minimize"
    level : float
        Coverage, in (0, 1).
    weight, replicates
        Of future runs, as in ``LeastSquaresFit.predict``.
    draws, seed : int

    Raises
    ------
    FitError
        No estimate of error, or terms that the runs cannot tell apart.
    """
    if fit.aliased or not fit.s > 0.0:
        raise FitError(Problem(f"no interval at the optimum: {fit.reason}", "Add runs."))
    beta, L = fit.estimate[: model.p], fit.factor[: model.p]
    point = optimum(model, region, beta, goal).point
    row = model.matrix(point[None, :])
    mean, h = float((row @ beta)[0]), float(np.sum(np.square(row @ L)))
    rng = np.random.default_rng(seed)
    betas = beta + fit.s * (rng.standard_normal((draws, L.shape[1])) @ L.T)
    s = fit.s * np.sqrt(rng.chisquare(fit.df_residual, draws) / fit.df_residual)
    points, values = optimum_draws(model, region, betas, goal)
    rows = model.matrix(points)
    gap = values - rows @ beta
    h_draws = np.sum(np.square(rows @ L), axis=1)
    own = 1.0 / (weight * replicates)
    future = gap + fit.s * np.sqrt(own) * rng.standard_normal(draws)
    return SearchedInterval(
        point,
        mean,
        float(np.mean(gap)),
        _ends(mean, fit.s * np.sqrt(h), gap / (s * np.sqrt(h_draws)), fit.df_residual, level),
        _ends(mean, fit.s * np.sqrt(own + h), future / (s * np.sqrt(own + h_draws)), fit.df_residual, level),
        level,
    )


def _ends(mean: float, se: float, pivots: FloatArray, df: int, level: float) -> tuple[float, float]:
    """Bootstrap-t ends, each no nearer than that of the t interval; pivots are (estimate - truth) / se."""
    t = student_quantile(df, level)
    low, high = np.quantile(pivots, [0.5 - 0.5 * level, 0.5 + 0.5 * level])
    return mean - max(float(high), t) * se, mean - min(float(low), -t) * se
