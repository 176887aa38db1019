"""Weights that make least squares the most likely fit under Student-t errors."""

from __future__ import annotations

import numpy as np

from seqrsm.arrays import FloatArray

STUDENT_DF = 4.0
"""Degrees of freedom of Student-t errors, where they are not estimated."""

_EM_STEPS = 60


def student_weights(Z: FloatArray, y: FloatArray, weights: FloatArray, nu: float = STUDENT_DF) -> FloatArray:
    """Weights (n,) that turn least squares into the most likely fit with Student-t errors.

    Lange, Little & Taylor (1989), J. Am. Stat. Assoc. 84, 881-896: each run counts ``(nu + 1) / (nu + r^2 / s^2)``, so
    that a wild score counts for next to nothing. Scaled to mean 1; with fewer than three residual degrees of freedom
    every run counts alike.
    """
    n, p = Z.shape
    if n < p + 3:
        return weights
    share = np.ones(n)
    for _ in range(_EM_STEPS):
        root = np.sqrt(weights * share)
        beta = np.linalg.lstsq(Z * root[:, None], y * root, rcond=None)[0]
        square = weights * (y - Z @ beta) ** 2
        variance = float(np.sum(share * square)) / (n - p)
        if variance <= (n * np.finfo(np.float64).eps) ** 2 * float(np.mean(y**2)):  # nothing but rounding is left
            return weights
        after = (nu + 1.0) / (nu + square / variance)
        if np.max(np.abs(after - share)) < 1e-10:
            break
        share = after
    found: FloatArray = weights * share / float(np.mean(share))
    return found
