"""What a departure from the quadratic, too small to be detected, does to the estimate at the recommended settings.

The t interval of a quadratic holds where the surface is one. On others it is short after a campaign has stopped: what
lack of fit is left is of the size of a standard error, and its test does not see it. Therefore the departure is taken
as unknown, of any size from next to nothing to many times the noise, and averaged over by what the scores say of each
size (Kennedy & O'Hagan 2001, J. R. Statist. Soc. B 63, 425-464; Hoeting, Madigan, Raftery & Volinsky 1999, Statist.
Sci. 14, 382-401). Given a kind and a size, the error of the least-squares mean at a point is normal with known moments:
its expectation follows from the residuals, and its variance is what these leave open.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from seqrsm.arrays import FloatArray
from seqrsm.decide.discrepancy import LENGTHS, MAX_RUNS, VARIANCES, smooth_covariance
from seqrsm.decide.intervals import t_quantile
from seqrsm.design.moments import region_moments
from seqrsm.design.quadratic import QuadraticModel
from seqrsm.design.region import Region

_LEAST_SIGNAL = 0.1


@dataclass(frozen=True, slots=True)
class Allowance:
    """What a departure is expected to do to the fitted mean at one point.

    Attributes
    ----------
    shift : float
        Expected true mean less fitted mean, on the scale of the fit.
    variance : float
        Variance that this adds to that of the fitted mean, the same scale squared; >= 0.
    """

    shift: float
    variance: float

    def ends(self, mean: float, half_width: float, df: float, level: float) -> tuple[float, float]:
        """Interval with the departure allowed for, from the one of the quadratic alone.

        Parameters
        ----------
        mean, half_width : float
            Fitted mean, and half-width of the interval that the quadratic gives.
        df : float
            Degrees of freedom of the residuals.
        level : float
            Two-sided probability.

        Returns
        -------
        low, high : float
        """
        half = float(np.hypot(half_width, float(t_quantile(df, level)) * np.sqrt(self.variance)))
        return mean + self.shift - half, mean + self.shift + half


NO_ALLOWANCE = Allowance(0.0, 0.0)
"""Of a model with nothing left over to judge it by."""


def _bends(model: QuadraticModel, points: FloatArray) -> FloatArray:
    """Third Legendre polynomial of each numeric factor, (n, q): the first bend that a quadratic has not."""
    x = points[:, list(model.numeric)]
    found: FloatArray = 2.5 * x**3 - 1.5 * x
    return found


def _kinds(model: QuadraticModel, A: FloatArray, B: FloatArray) -> list[tuple[FloatArray, float]]:
    """Covariance of departures at points A and B, with prior weight, for each kind: local humps, and bends."""
    share = 0.5 / len(LENGTHS) if model.numeric else 1.0 / len(LENGTHS)
    kinds = [(smooth_covariance(model, A, B, length), share) for length in LENGTHS]
    return [*kinds, (_bends(model, A) @ _bends(model, B).T, 0.5)] if model.numeric else kinds


@lru_cache(maxsize=8)
def _moments(model: QuadraticModel, region: Region) -> FloatArray:
    return region_moments(model, region)


def _signal(model: QuadraticModel, region: Region, beta: FloatArray, C: FloatArray, s2: float) -> float:
    """Variance of the fitted surface over the region, less what noise adds to it, over that of the noise."""
    W = _moments(model, region)
    spread = W - np.outer(W[0], W[0])
    found = float(beta @ spread @ beta) - s2 * float(np.sum(C * spread))
    return max(found / s2, _LEAST_SIGNAL)


def departure_allowance(
    model: QuadraticModel,
    region: Region,
    points: FloatArray,
    Z: FloatArray,
    y: FloatArray,
    point: FloatArray,
    row: FloatArray,
    weights: FloatArray | None = None,
) -> Allowance:
    """Average over departures from the quadratic at the recommended settings.

    A departure is either a stationary Gaussian process of one of `LENGTHS`, or a bend of third order along each factor
    (even chances); its variance v is one of `VARIANCES` times that of the noise. Before the scores are seen all of
    these are alike likely up to the variance V of the fitted surface over the region, and less so beyond, as
    1 / (1 + (v/V)^2): what the quadratic leaves out is rarely more than what it describes.

    Parameters
    ----------
    model, region : QuadraticModel, Region
        What is fitted, over the part of the region that is looked at.
    points : ndarray (n, k)
        Coded settings of the runs.
    Z : ndarray (n, p + e)
        Model rows, with e columns for blocks.
    y : ndarray (n,)
        Scores on the scale of the fit.
    point : ndarray (k,)
        Recommended settings, coded.
    row : ndarray (p + e,)
        Model row there.
    weights : ndarray (n,), optional
        Inverse relative variances.

    Returns
    -------
    Allowance
        None with fewer than three residual degrees of freedom or where least squares leaves nothing over.
    """
    # Of very many runs every so many-th: fewer contrasts rule out less, so the allowance is rather too wide.
    step = max(1, -(-len(y) // MAX_RUNS))
    points, Z, y = points[::step], Z[::step], y[::step]
    n, p = Z.shape
    root = np.ones(n) if weights is None else np.sqrt(np.asarray(weights, dtype=np.float64)[::step])
    if n < p + 3:
        return NO_ALLOWANCE
    Q, R = np.linalg.qr(Z * root[:, None], mode="complete")
    diagonal = np.abs(np.diag(R))
    if diagonal.min() <= 1e-10 * diagonal.max():
        return NO_ALLOWANCE
    free = Q[:, p:] * root[:, None]  # contrasts of the scores that the quadratic cannot follow
    contrasts = free.T @ y
    if float(contrasts @ contrasts) <= 1e-24 * max(1.0, float(np.sum((root * y) ** 2))):
        return NO_ALLOWANCE
    use = root * (Q[:, :p] @ np.linalg.solve(R[:p].T, row))  # what each score counts in the fitted mean
    h = float(np.sum((use / root) ** 2))
    estimate = np.linalg.solve(R[:p], Q[:, :p].T @ (root * y))
    inverse = np.linalg.inv(R[:p])
    s2_alone = float(contrasts @ contrasts) / (n - p)
    signal = _signal(model, region, estimate[: model.p], (inverse @ inverse.T)[: model.p, : model.p], s2_alone)
    ratio = np.asarray(VARIANCES)[:, None]
    likely = 1.0 / (1.0 + (ratio[:, 0] / signal) ** 2)
    likely /= likely.sum()
    table = []
    at = point[None, :]
    own = [float(K[0, 0]) for K, _ in _kinds(model, at, at)]
    cross = [K[:, 0] for K, _ in _kinds(model, points, at)]
    for (K, share), k00, k0 in zip(_kinds(model, points, points), own, cross, strict=True):
        spread, turn = np.linalg.eigh(free.T @ K @ free)
        seen = turn.T @ contrasts
        pull = turn.T @ (free.T @ (k0 - K @ use))
        missed = float(use @ K @ use - 2.0 * use @ k0) + k00  # mean square of fitted less true mean, per variance
        scale = 1.0 + ratio * np.maximum(spread, 0.0)
        rss = np.sum(seen**2 / scale, axis=1)
        s2 = rss / (n - p)
        log_likelihood = -0.5 * (np.sum(np.log(scale), axis=1) + (n - p) * np.log(rss))
        shift = np.sum(ratio * pull * seen / scale, axis=1)
        left = ratio[:, 0] * missed - np.sum(ratio**2 * pull**2 / scale, axis=1)
        variance = s2 * (h + np.maximum(left, 0.0))
        table.append(np.column_stack([log_likelihood, share * likely, shift, variance]))
    likelihood, prior, shift, variance = np.vstack(table).T
    weight = prior * np.exp(likelihood - likelihood.max())
    weight /= weight.sum()
    mean = float(weight @ shift)
    total = float(weight @ (variance + shift**2)) - mean**2
    return Allowance(mean, max(total - s2_alone * h, 0.0))
