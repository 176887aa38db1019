"""Whether a smooth departure from the quadratic shows in the scores.

The scores are taken as quadratic plus a stationary Gaussian process plus noise. Its likelihood against that of the
quadratic alone is a test of lack of fit that needs no repeats and sees what pure error with four degrees of freedom
cannot: neighbouring residuals of one sign.

The noise may be larger where the scores are poorer, as it is of percentages and of any sensor out of its best range. A
process would then pass for that, so both likelihoods may have a noise whose log variance rises linearly as the fitted
score falls (a variance function of the mean, Davidian & Carroll 1987): a departure is what is gained beyond it.

References
----------
Sacks, Welch, Mitchell & Wynn (1989), Statistical Science 4, 409-423 (kriging with a trend); Patterson & Thompson
(1971), Biometrika 58, 545-554 (restricted likelihood); Davidian & Carroll (1987), J. Am. Stat. Assoc. 82, 1079-1091.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from seqrsm.arrays import FloatArray
from seqrsm.design.quadratic import QuadraticModel
from seqrsm.fit.optimum import Goal

LENGTHS = (0.35, 0.6, 1.0)
"""Lengths of the process that are tried, in coded units."""

VARIANCES = (0.1, 0.3, 1.0, 3.0, 10.0, 30.0, 100.0)
"""Its variances, in units of the noise variance."""

NOISE_SLOPES = (0.0, 1.0, 2.0, 3.0)
"""Log ratios of the noise variance, of the poorest fitted score over the best, that are tried."""

EVIDENCE = 3.0
"""Evidence from which the quadratic counts as wrong, with many residual degrees of freedom."""

MAX_RUNS = 400  # the cost grows with the cube
_OTHER_CATEGORY = 0.5  # correlation of the departures of two categories at equal settings


@dataclass(frozen=True, slots=True)
class Discrepancy:
    """The most likely smooth departure from the quadratic.

    Attributes
    ----------
    evidence : float
        Twice the gain of the restricted log likelihood over the quadratic alone, >= 0; 0 where nothing is gained.
    noise_slope : float
        Log ratio of the noise variance, of the poorest fitted score over the best, beside the process.
    noise_evidence : float
        Twice the gain of the restricted log likelihood by unequal noise, without any process.
    """

    evidence: float
    noise_slope: float = 0.0
    noise_evidence: float = 0.0


def _smooth_covariance(model: QuadraticModel, A: FloatArray, B: FloatArray, length: float) -> FloatArray:
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
    if len(y) < Z.shape[1] + 3 or float(np.ptp(y)) <= 1e-12 * max(1.0, float(np.max(np.abs(y)))):
        return Discrepancy(0.0)
    poor = _poorness(Z, y, noise, goal)
    frames = [_contrasts(Z, y, noise * np.exp(slope * poor)) for slope in NOISE_SLOPES]
    if frames[0] is None:
        return Discrepancy(0.0)
    alone = [
        -np.inf if frame is None else frame.constant - 0.5 * frame.df * np.log(max(float(frame.y @ frame.y), 1e-300))
        for frame in frames
    ]
    chosen = int(np.argmax(alone))
    tried = sorted({0, chosen})
    gains = np.full((len(tried), len(LENGTHS), 1 + len(VARIANCES)), -np.inf)
    for i, length in enumerate(LENGTHS):
        K = _smooth_covariance(model, points, points, length)
        for t, place in enumerate(tried):
            frame = frames[place]
            assert frame is not None
            gains[t, i] = frame.constant + _restricted(frame.free.T @ K @ frame.free, frame.y) - alone[chosen]
    noise_evidence = 2.0 * float(alone[chosen] - alone[0])
    t, i, j = (int(place) for place in np.unravel_index(int(np.argmax(gains)), gains.shape))
    if j == 0 or gains[t, i, j] <= 0.0:
        return Discrepancy(0.0, NOISE_SLOPES[chosen], noise_evidence)
    return Discrepancy(2.0 * float(gains[t, i, j]), NOISE_SLOPES[tried[t]], noise_evidence)


def evidence_limit(df_residual: int) -> float:
    """Evidence from which a departure counts: with few degrees of freedom the likelihood ratio has long tails.

    Passed by 1 to 4 % of quadratics with equal noise, 6 to 45 residual degrees of freedom.
    """
    return EVIDENCE * (1.0 + 3.0 / max(df_residual, 1))


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
