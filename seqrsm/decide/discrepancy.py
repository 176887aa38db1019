"""Whether a smooth departure from the quadratic shows in the scores, and where the optimum lies if it does.

The scores are taken as quadratic plus a stationary Gaussian process plus noise. Its likelihood against that of the
quadratic alone is a test of lack of fit that needs no repeats and sees what pure error with four degrees of freedom
cannot: neighbouring residuals of one sign. The process also tells where to look next: its mean keeps every run in use.

The noise may be larger where the scores are poorer, as it is of percentages and of any sensor out of its best range. A
process would then pass for that, so both likelihoods may have a noise whose log variance rises linearly as the fitted
score falls (a variance function of the mean, Davidian & Carroll 1987): a departure is what is gained beyond it.

References
----------
Sacks, Welch, Mitchell & Wynn (1989), Statistical Science 4, 409-423 (kriging with a trend); Patterson & Thompson
(1971), Biometrika 58, 545-554 (restricted likelihood); Davidian & Carroll (1987), J. Am. Stat. Assoc. 82, 1079-1091.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field, replace

import numpy as np
from scipy.linalg import cho_solve, solve_triangular

from seqrsm.arrays import FloatArray
from seqrsm.design.quadratic import QuadraticModel
from seqrsm.design.region import Region
from seqrsm.fit.optimum import Goal

LENGTHS = (0.35, 0.6, 1.0)
"""Lengths of the process that are tried, in coded units of the region looked at."""

VARIANCES = (0.1, 0.3, 1.0, 3.0, 10.0, 30.0, 100.0)
"""Its variances, in units of the noise variance."""

NOISE_SLOPES = (0.0, 1.0, 2.0, 3.0)
"""Log ratios of the noise variance, of the poorest fitted score over the best, that are tried."""

MAX_RUNS = 400  # the cost grows with the cube
_COVER = 900
_CLIMB = ((0.2, 160), (0.1, 160), (0.05, 160), (0.02, 160))
_OTHER_CATEGORY = 0.5  # correlation of the departures of two categories at equal settings


@dataclass(frozen=True, slots=True)
class Discrepancy:
    """The most likely smooth departure from the quadratic.

    Attributes
    ----------
    evidence : float
        Twice the gain of the restricted log likelihood over the quadratic alone, >= 0; 0 where nothing is gained.
    length : float
        Length of the process, coded units; nan without one.
    variance : float
        Its variance over that of the noise; 0 without one.
    gains : ndarray (lengths, 1 + variances)
        Gain of the restricted log likelihood over the quadratic alone, for each of `LENGTHS` and for variance 0 and
        each of `VARIANCES`, with the noise that suits best; empty where it could not be found.
    noise_slope : float
        Log ratio of the noise variance, of the poorest fitted score over the best, beside the process.
    noise_evidence : float
        Twice the gain of the restricted log likelihood by unequal noise, without any process.
    """

    evidence: float
    length: float
    variance: float
    gains: FloatArray = field(default_factory=lambda: np.empty((0, 0)))
    noise_slope: float = 0.0
    noise_evidence: float = 0.0


def smooth_covariance(model: QuadraticModel, A: FloatArray, B: FloatArray, length: float) -> FloatArray:
    """Covariance (m, n) of a process of variance 1 between coded points A (m, k) and B (n, k)."""
    numeric, categorical = list(model.numeric), list(model.categorical)
    gap = A[:, None, numeric] - B[None, :, numeric]
    K: FloatArray = np.exp(-0.5 * np.sum(gap**2, axis=-1) / length**2)
    if categorical:
        differ = np.sum(A[:, None, categorical] != B[None, :, categorical], axis=-1)
        K = K * _OTHER_CATEGORY**differ
    return K


def _restricted(K: FloatArray, white: FloatArray) -> FloatArray:
    """Restricted log likelihood with variance 0 and `VARIANCES` of a process, up to a constant; sigma profiled out.

    Parameters
    ----------
    K : ndarray (m, m)
        Covariance of the scores' contrasts that the quadratic leaves free, for a process of variance 1; theirs by noise
        alone is the unit matrix.
    white : ndarray (m,)
        These contrasts.
    """
    spread, turn = np.linalg.eigh(K)
    square = (turn.T @ white) ** 2
    scale = 1.0 + np.concatenate([[0.0], VARIANCES])[:, None] * np.maximum(spread, 0.0)
    rss = np.maximum(np.sum(square / scale, axis=1), 1e-300)
    found: FloatArray = -0.5 * (np.sum(np.log(scale), axis=1) + len(white) * np.log(rss))
    return found


def find_discrepancy(
    model: QuadraticModel,
    points: FloatArray,
    Z: FloatArray,
    y: FloatArray,
    weights: FloatArray | None = None,
    goal: Goal = "maximize",
) -> Discrepancy:
    """Look for a smooth departure from the quadratic, allowing for noise that is larger where scores are poorer.

    Parameters
    ----------
    model : QuadraticModel
    points : ndarray (n, k)
        Coded settings.
    Z : ndarray (n, p + e)
        Model rows, with e columns for blocks.
    y : ndarray (n,)
        Scores.
    weights : ndarray (n,), optional
        Inverse relative variances.
    goal : "maximize" or "minimize"
        Which scores are poor.

    Returns
    -------
    Discrepancy
        None found (evidence 0) with fewer than three residual degrees of freedom or scores that are all alike.
    """
    step = max(1, -(-len(y) // MAX_RUNS))
    points, Z, y = points[::step], Z[::step], y[::step]
    noise = np.ones(len(y)) if weights is None else 1.0 / np.asarray(weights)[::step]
    nothing = Discrepancy(0.0, float("nan"), 0.0)
    if len(y) < Z.shape[1] + 3 or float(np.ptp(y)) <= 1e-12 * max(1.0, float(np.max(np.abs(y)))):
        return nothing
    poor = _poorness(Z, y, noise, goal)
    frames = [_contrasts(Z, y, noise * np.exp(slope * poor)) for slope in NOISE_SLOPES]
    if frames[0] is None:
        return nothing
    alone = [
        -np.inf if frame is None else frame.constant - 0.5 * frame.df * np.log(max(float(frame.y @ frame.y), 1e-300))
        for frame in frames
    ]
    chosen = int(np.argmax(alone))
    tried = sorted({0, chosen})
    gains = np.full((len(tried), len(LENGTHS), 1 + len(VARIANCES)), -np.inf)
    for i, length in enumerate(LENGTHS):
        K = smooth_covariance(model, points, points, length)
        for t, place in enumerate(tried):
            frame = frames[place]
            assert frame is not None
            gains[t, i] = frame.constant + _restricted(frame.free.T @ K @ frame.free, frame.y) - alone[chosen]
    noise_evidence = 2.0 * float(alone[chosen] - alone[0])
    t, i, j = (int(place) for place in np.unravel_index(int(np.argmax(gains)), gains.shape))
    if j == 0 or gains[t, i, j] <= 0.0:
        slope = NOISE_SLOPES[chosen]
        return replace(nothing, gains=np.max(gains, axis=0), noise_slope=slope, noise_evidence=noise_evidence)
    return Discrepancy(
        2.0 * float(gains[t, i, j]),
        LENGTHS[i],
        VARIANCES[j - 1],
        np.max(gains, axis=0),
        NOISE_SLOPES[tried[t]],
        noise_evidence,
    )


@dataclass(frozen=True, slots=True)
class _Contrasts:
    """Contrasts of the scores that the quadratic cannot follow, with unit noise, and the likelihood's constant."""

    free: FloatArray
    y: FloatArray
    constant: float

    @property
    def df(self) -> int:
        return len(self.y)


def _contrasts(Z: FloatArray, y: FloatArray, noise: FloatArray) -> _Contrasts | None:
    """Contrasts under noise of variances ``noise`` (n,); None where the terms cannot be told apart."""
    root = 1.0 / np.sqrt(noise)
    Q, R = np.linalg.qr(Z * root[:, None], mode="complete")
    diagonal = np.abs(np.diag(R))
    if diagonal.min(initial=np.inf) <= 1e-10 * diagonal.max(initial=0.0):
        return None
    free = Q[:, Z.shape[1] :] * root[:, None]
    return _Contrasts(free, free.T @ y, float(np.sum(np.log(root)) - np.sum(np.log(diagonal))))


def _poorness(Z: FloatArray, y: FloatArray, noise: FloatArray, goal: Goal) -> FloatArray:
    """How poor the fitted score of each run is (n,): a range of 1 over the runs, mean 0."""
    root = 1.0 / np.sqrt(noise)
    fitted = Z @ np.linalg.lstsq(Z * root[:, None], y * root, rcond=None)[0]
    spread = float(np.ptp(fitted))
    if spread <= 1e-12 * max(1.0, float(np.max(np.abs(fitted)))):
        return np.zeros(len(y))
    share = (fitted - np.mean(fitted)) / spread
    return np.asarray(-share if goal == "maximize" else share)


def likely_optimum(
    model: QuadraticModel,
    region: Region,
    points: FloatArray,
    Z: FloatArray,
    y: FloatArray,
    found: Discrepancy,
    goal: Goal = "maximize",
    weights: FloatArray | None = None,
    seed: int = 0,
) -> FloatArray:
    """Where quadratic and departure together are best.

    Parameters
    ----------
    model, region : QuadraticModel, Region
    points, Z, y, weights
        As for :func:`find_discrepancy`.
    found : Discrepancy
        Its result.
    goal : "maximize" or "minimize"
    seed : int
        Of the search; equal inputs give an equal point.

    Returns
    -------
    ndarray (k,)
        Coded, feasible.
    """
    step = max(1, -(-len(y) // MAX_RUNS))
    points, Z, y = points[::step], Z[::step], y[::step]
    noise = np.ones(len(y)) if weights is None else 1.0 / np.asarray(weights)[::step]
    length = found.length if found.variance > 0.0 else 1.0
    noise = noise * np.exp(found.noise_slope * _poorness(Z, y, noise, goal))
    V = np.diag(noise) + found.variance * smooth_covariance(model, points, points, length)
    factor = (np.linalg.cholesky(V), True)
    beta = np.linalg.lstsq(
        solve_triangular(factor[0], Z, lower=True), solve_triangular(factor[0], y, lower=True), rcond=None
    )[0]
    pull = cho_solve(factor, y - Z @ beta) * found.variance
    sign = 1.0 if goal == "maximize" else -1.0

    def value(at: FloatArray) -> FloatArray:
        mean: FloatArray = model.matrix(at) @ beta[: model.p] + smooth_covariance(model, at, points, length) @ pull
        return sign * mean

    return climb_from_cover(region, points, value, seed)


def climb_from_cover(
    region: Region, points: FloatArray, value: Callable[[FloatArray], FloatArray], seed: int = 0
) -> FloatArray:
    """Feasible point (k,) of the largest ``value``, from a cover of the region and the feasible ones of ``points``.

    ``value`` takes coded points (m, k) and gives (m,); equal inputs give an equal point.
    """
    rng = np.random.default_rng(seed)
    inside = points[region.feasible(points)]
    pool = np.vstack([region.candidates(limit=_COVER), region.sample(_COVER, rng), inside])
    free = list(region.continuous)
    for radius, count in _CLIMB:
        best = pool[int(np.argmax(value(pool)))]
        near = np.repeat(best[None, :], count, axis=0)
        near[:, free] = np.clip(near[:, free] + radius * rng.standard_normal((count, len(free))), -1.0, 1.0)
        pool = np.vstack([best, near[region.feasible(near)]])
    chosen: FloatArray = pool[int(np.argmax(value(pool)))]
    return chosen
