"""What a departure from the quadratic, too small to be detected, does to the estimate at the recommended settings.

The t interval of a quadratic holds where the surface is one. On others it is short after a campaign has stopped: what
lack of fit is left is of the size of a standard error, and its test does not see it. Therefore the departure is taken
as unknown, of any size from next to nothing to many times the noise, and averaged over by what the scores say of each
size (Kennedy & O'Hagan 2001, J. R. Statist. Soc. B 63, 425-464; Hoeting, Madigan, Raftery & Volinsky 1999, Statist.
Sci. 14, 382-401). Given a kind and a size, the error of the least-squares mean at a point is normal with known moments:
its expectation follows from the residuals, and its variance is what these leave open.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import lru_cache

import numpy as np

from seqrsm.arrays import FloatArray
from seqrsm.decide.discrepancy import LENGTHS, MAX_RUNS, VARIANCES, climb_from_cover, smooth_covariance
from seqrsm.decide.intervals import t_quantile
from seqrsm.design.moments import region_moments
from seqrsm.design.quadratic import QuadraticModel
from seqrsm.design.region import Region
from seqrsm.fit.optimum import Goal

Rows = Callable[[FloatArray], FloatArray]
"""Model rows (m, p) of coded points (m, k)."""

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

    @property
    def of_chosen(self) -> Allowance:
        """The same at settings chosen because the departure is good there, as :func:`departed_optimum` does.

        The largest of many estimated departures is estimated too large. The scores cannot say by how much, so that the
        departure itself counts as an error of its size.
        """
        return Allowance(self.shift, self.variance + self.shift**2)

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


@dataclass(frozen=True, slots=True)
class _Kind:
    """One kind of departure of each of `VARIANCES`, as the contrasts of the scores show it.

    Attributes
    ----------
    K : ndarray (n, n)
        Covariance at the runs, for variance 1.
    turn, seen : ndarray (m, m), (m,)
        Directions in which contrasts are independent, and the contrasts in them.
    scale : ndarray (sizes, m)
        Their variances over that of the noise.
    s2, weight : ndarray (sizes,)
        Variance of the noise; probability of this kind and size.
    """

    K: FloatArray
    turn: FloatArray
    seen: FloatArray
    scale: FloatArray
    s2: FloatArray
    weight: FloatArray


@dataclass(frozen=True, slots=True)
class Departures:
    """Departures from the quadratic, weighed by what the scores say of each: see :func:`weigh_departures`.

    Attributes
    ----------
    model : QuadraticModel
    points : ndarray (n, k)
        Coded settings of the runs.
    root : ndarray (n,)
        Square roots of their weights.
    counts : ndarray (n, p)
        What each score counts in each least-squares coefficient.
    free : ndarray (n, m)
        Contrasts of the scores that the quadratic cannot follow.
    kinds : tuple of _Kind
    s2 : float
        Variance of the noise where there is no departure.
    """

    model: QuadraticModel
    points: FloatArray
    root: FloatArray
    counts: FloatArray
    free: FloatArray
    kinds: tuple[_Kind, ...]
    s2: float

    def allowance(self, point: FloatArray, row: FloatArray) -> Allowance:
        """Average at settings ``point`` (k,) with the model row ``row`` (p,)."""
        at = point[None, :]
        use = self.counts @ row
        h = float(np.sum((use / self.root) ** 2))
        ratio = np.asarray(VARIANCES)[:, None]
        own = [float(k00[0, 0]) for k00, _ in _kinds(self.model, at, at)]
        cross = [k0[:, 0] for k0, _ in _kinds(self.model, self.points, at)]
        mean, square = 0.0, 0.0
        for kind, k00, k0 in zip(self.kinds, own, cross, strict=True):
            pull = kind.turn.T @ (self.free.T @ (k0 - kind.K @ use))
            missed = float(use @ kind.K @ use - 2.0 * use @ k0) + k00  # mean square of fitted less true mean
            shift = np.sum(ratio * pull * kind.seen / kind.scale, axis=1)
            left = ratio[:, 0] * missed - np.sum(ratio**2 * pull**2 / kind.scale, axis=1)
            variance = kind.s2 * (h + np.maximum(left, 0.0))
            mean += float(kind.weight @ shift)
            square += float(kind.weight @ (variance + shift**2))
        return Allowance(mean, max(square - mean**2 - self.s2 * h, 0.0))

    def shifts(self, at: FloatArray, rows: FloatArray) -> FloatArray:
        """Shift of :meth:`allowance` at many settings (m, k) with model rows (m, p): (m,)."""
        use = rows @ self.counts.T
        ratio = np.asarray(VARIANCES)
        found: FloatArray = np.zeros(len(at))
        for kind, (k0, _) in zip(self.kinds, _kinds(self.model, at, self.points), strict=True):
            pull = self.free @ (kind.turn @ ((kind.weight * ratio) @ (kind.seen / kind.scale)))
            found += k0 @ pull - use @ (kind.K @ pull)
        return found


def weigh_departures(
    model: QuadraticModel,
    region: Region,
    points: FloatArray,
    Z: FloatArray,
    y: FloatArray,
    weights: FloatArray | None = None,
) -> Departures | None:
    """What departures from the quadratic the scores speak for.

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
    weights : ndarray (n,), optional
        Inverse relative variances.

    Returns
    -------
    Departures or None
        None with fewer than three residual degrees of freedom or where least squares leaves nothing over.
    """
    # Of very many runs every so many-th: fewer contrasts rule out less, so the allowance is rather too wide.
    step = max(1, -(-len(y) // MAX_RUNS))
    points, Z, y = points[::step], Z[::step], y[::step]
    n, p = Z.shape
    root = np.ones(n) if weights is None else np.sqrt(np.asarray(weights, dtype=np.float64)[::step])
    if n < p + 3:
        return None
    Q, R = np.linalg.qr(Z * root[:, None], mode="complete")
    diagonal = np.abs(np.diag(R))
    if diagonal.min() <= 1e-10 * diagonal.max():
        return None
    free = Q[:, p:] * root[:, None]  # contrasts of the scores that the quadratic cannot follow
    contrasts = free.T @ y
    if float(contrasts @ contrasts) <= 1e-24 * max(1.0, float(np.sum((root * y) ** 2))):
        return None
    inverse = np.linalg.inv(R[:p])
    counts = root[:, None] * (Q[:, :p] @ inverse.T)
    s2 = float(contrasts @ contrasts) / (n - p)
    signal = _signal(model, region, (counts.T @ y)[: model.p], (inverse @ inverse.T)[: model.p, : model.p], s2)
    ratio = np.asarray(VARIANCES)
    likely = 1.0 / (1.0 + (ratio / signal) ** 2)
    likely /= likely.sum()
    kinds, chances = [], []
    for K, share in _kinds(model, points, points):
        spread, turn = np.linalg.eigh(free.T @ K @ free)
        seen = turn.T @ contrasts
        scale = 1.0 + ratio[:, None] * np.maximum(spread, 0.0)
        rss = np.sum(seen**2 / scale, axis=1)
        log_likelihood = -0.5 * (np.sum(np.log(scale), axis=1) + (n - p) * np.log(rss))
        kinds.append(_Kind(K, turn, seen, scale, rss / (n - p), log_likelihood))
        chances.append(np.log(share * likely) + log_likelihood)
    chance = np.exp(np.array(chances) - np.max(chances))
    chance /= chance.sum()
    weighed = tuple(replace(kind, weight=weight) for kind, weight in zip(kinds, chance, strict=True))
    return Departures(model, points, root, counts, free, weighed, s2)


def departed_optimum(
    departures: Departures, region: Region, rows: Rows, estimate: FloatArray, goal: Goal = "maximize", seed: int = 0
) -> FloatArray:
    """Where quadratic and averaged departure together are best: the centre of the interval is highest there.

    For surfaces that are seen to be no quadratic: the quadratic's own optimum may then lie far from the best settings,
    and a smaller box, in which a quadratic does, takes 2 runs for each term first.

    Parameters
    ----------
    departures : Departures
    region : Region
        That of the departures.
    rows : callable
        Model rows (m, p + e) of coded points (m, k).
    estimate : ndarray (p + e,)
        Coefficients of the quadratic.
    goal : "maximize" or "minimize"
    seed : int
        Of the search; equal inputs give an equal point.

    Returns
    -------
    ndarray (k,)
        Coded, feasible.
    """
    sign = 1.0 if goal == "maximize" else -1.0

    def value(at: FloatArray) -> FloatArray:
        Z = rows(at)
        return sign * (Z @ estimate + departures.shifts(at, Z))

    return climb_from_cover(region, departures.points, value, seed)
