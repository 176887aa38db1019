"""Runs whose scores carry an error of known variance beside the common one: cheaper simulations among full ones."""

from __future__ import annotations

import numpy as np
from scipy.optimize import brentq

from seqrsm.arrays import FloatArray

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
