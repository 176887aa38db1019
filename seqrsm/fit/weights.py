"""What is known of errors beside the common one: counts of decisions, errors of known variance, errors that runs share.

A share of n decisions, each right with probability p, scatters with variance p (1 - p) / n; where decisions depend on
each other (one field, one day) with a multiple of it, the dispersion, which the residuals tell (Wedderburn 1974,
Biometrika 61, 439-447; McCullagh & Nelder 1989, Generalized Linear Models, section 4.5). On the percent scale a surface
that is quadratic in percent stays one.

Scores of one cheaper simulation are off together, which more of them do not average out.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.optimize import brentq

from seqrsm.arrays import FloatArray

_ROUNDS = 4


def share_variance(percent: FloatArray, trials: FloatArray | float) -> FloatArray:
    """Binomial variance of a score expected at ``percent`` [%] from ``trials`` decisions, percent squared.

    The probability is kept one decision in ``trials`` + 2 away from 0 and 1, where the formula would claim certainty.
    """
    n = np.asarray(trials, dtype=np.float64)
    edge = 1.0 / (n + 2.0)
    p = np.clip(np.asarray(percent, dtype=np.float64) / 100.0, edge, 1.0 - edge)
    return np.asarray(1e4 * p * (1.0 - p) / n)


def expected_shares(Z: FloatArray, percent: FloatArray, trials: FloatArray) -> FloatArray:
    """Scores (n,) that a linear model expects of every run [%], each run counting by its binomial variance.

    Iteratively reweighted least squares: weights come from what is expected, since by what was scored a lucky run would
    count for more. With no more runs than terms the scores themselves, shrunk by one decision each way.

    Parameters
    ----------
    Z : ndarray (n, p)
    percent, trials : ndarray (n,)
        Scores [%], and decisions behind each, > 0.
    """
    expected: FloatArray = (percent * trials + 100.0) / (trials + 2.0)
    if len(percent) <= Z.shape[1]:
        return expected
    for _ in range(_ROUNDS):
        root = 1.0 / np.sqrt(share_variance(expected, trials))
        expected = Z @ np.linalg.lstsq(Z * root[:, None], percent * root, rcond=None)[0]
    return expected


_LEAST = 1e-3
"""Least share of the mean known variance that the common variance is taken to have."""


def own_weights(Z: FloatArray, y: FloatArray, variance: FloatArray, weights: FloatArray) -> FloatArray:
    """Weights of runs with Var(y_i) = sigma^2 / w_i + v_i, relative to a run without the error of its own.

    sigma^2 solves sum r_i^2 / (sigma^2 / w_i + v_i) = n - p, the residuals r being those of the weighted fit: Paule and
    Mandel (1982), J. Res. Natl. Bur. Stand. 87, 377. The weight is then w_i / (1 + w_i v_i / sigma^2), so that the
    fit's variance of a run of weight 1 is sigma^2: what a future run without that error has.

    Intervals hold while v is no larger than sigma^2. Runs whose own error is much larger tell next to nothing of
    sigma, yet count in the degrees of freedom: with v = 9 sigma^2 in half of 24 runs, 95 % intervals hold 91 %.

    Parameters
    ----------
    Z : float64 array (n, p)
        Model matrix.
    y : float64 array (n,)
    variance : float64 array (n,)
        Known variance v of each run's own error, >= 0, in the square of the unit of ``y``.
    weights : float64 array (n,)
        Relative weights w, > 0.

    Returns
    -------
    float64 array (n,)
        ``weights`` themselves where no variance is known or there are no degrees of freedom.
    """
    n, p = Z.shape
    if not np.any(variance > 0.0) or n <= p:
        return weights

    def excess(sigma2: float) -> float:
        own = weights / (1.0 + weights * variance / sigma2)
        root = np.sqrt(own)
        beta = np.linalg.lstsq(Z * root[:, None], y * root, rcond=None)[0]
        square = float(np.sum(own * (y - Z @ beta) ** 2))
        return float(square / sigma2) - float(n - p)

    least = _LEAST * float(np.mean(variance))
    most = max(float(np.var(y)) * n, least) * 10.0
    sigma2 = least if excess(least) <= 0.0 else float(brentq(excess, least, most, rtol=1e-6))
    return np.asarray(weights / (1.0 + weights * variance / sigma2))


_NOTHING = 1e-9


@dataclass(frozen=True, slots=True)
class SharedError:
    """What shared errors do to the fitted mean at m points, given the scores.

    Attributes
    ----------
    shift : ndarray (m,)
        Expected true mean less fitted mean, in the unit of the scores.
    variance : ndarray (m,)
        Variance of the fitted mean's error that the scores leave open, the same unit squared; >= 0.
    """

    shift: FloatArray
    variance: FloatArray


def shared_error(
    Z: FloatArray, y: FloatArray, weights: FloatArray, loadings: FloatArray, rows: FloatArray
) -> SharedError:
    """Shared errors in y = Z beta + C delta + e, delta ~ N(0, 1), e_i ~ N(0, sigma^2 / w_i), beta flat.

    The fit is the least-squares one, which does not know of delta: its mean at a point is off by use' C delta, where
    use holds what each score counts in it. Contrasts of the scores that the model cannot follow tell of delta; sigma is
    taken from those that delta does not touch. Shift and variance together give the generalised least-squares mean
    and its variance (Henderson 1975, Biometrics 31, 423; tested against it).

    Parameters
    ----------
    Z : float64 array (n, p)
        Model matrix of full rank.
    y, weights : float64 array (n,)
        Scores, and inverse relative variances.
    loadings : float64 array (n, r)
        C: prior standard deviation of each shared error in each score, 0 for scores that it does not touch.
    rows : float64 array (m, p)
        Model rows of the points.

    Returns
    -------
    SharedError
        Nothing shifted and all of the prior's variance where no degrees of freedom are left to learn from.
    """
    n, p = Z.shape
    root = np.sqrt(weights)
    Q, R = np.linalg.qr(Z * root[:, None])
    use = root[:, None] * (Q @ np.linalg.solve(R.T, rows.T))
    carried = use.T @ loadings
    contrasts, seen = root * y, loadings * root[:, None]
    contrasts, seen = contrasts - Q @ (Q.T @ contrasts), seen - Q @ (Q.T @ seen)
    basis, size, _ = np.linalg.svd(seen, full_matrices=False)
    basis = basis[:, size > _NOTHING * max(float(np.abs(loadings).max(initial=0.0)), 1e-300)]
    df = n - p - basis.shape[1]
    left = contrasts - basis @ (basis.T @ contrasts)
    sigma2 = float(left @ left) / df if df > 0 else 0.0
    if not sigma2 > 0.0:
        return SharedError(np.zeros(len(rows)), np.sum(carried**2, axis=1))
    precision = np.eye(loadings.shape[1]) + seen.T @ seen / sigma2
    errors = np.linalg.solve(precision, seen.T @ contrasts / sigma2)
    variance = np.sum(carried * np.linalg.solve(precision, carried.T).T, axis=1)
    return SharedError(-(carried @ errors), np.maximum(variance, 0.0))
