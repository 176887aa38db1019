"""What is known of errors beside the common one: counts of decisions.

A share of n decisions, each right with probability p, scatters with variance p (1 - p) / n; where decisions depend on
each other (one field, one day) with a multiple of it, the dispersion, which the residuals tell (Wedderburn 1974,
Biometrika 61, 439-447; McCullagh & Nelder 1989, Generalized Linear Models, section 4.5). On the percent scale a surface
that is quadratic in percent stays one.
"""

from __future__ import annotations

import numpy as np

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
