"""Likelihood of the process, one set of hyperparameters after the other."""

from __future__ import annotations

import numpy as np

from seqrsm.arrays import FloatArray
from seqrsm.jit import kernel


@kernel
def log_likelihoods(
    scales: FloatArray,
    squares: FloatArray,
    others: FloatArray,
    gram: FloatArray,
    vague: FloatArray,
    y: FloatArray,
    gap: FloatArray,
    inverse_weights: FloatArray,
) -> FloatArray:
    """Log likelihood (d,) of scores y (n,), without its constant; -inf where rounding leaves no positive matrix.

    Parameters
    ----------
    scales : ndarray (d, 5 + q)
        Standard deviations of coefficients, process and noise, growth of the noise, correlation between categories,
        lengths.
    squares : ndarray (n (n - 1) / 2, q)
        Squared distances of pairs, in the order (1, 0), (2, 0), (2, 1), ...
    others : ndarray (n (n - 1) / 2,)
        Numbers of categories that differ.
    gram, vague : ndarray (n, n)
        Products of the trend's rows; covariance of constants and nuisance effects.
    y, gap, inverse_weights : ndarray (n,)
    """
    n, q = len(y), squares.shape[1]
    found = np.empty(len(scales))
    V = np.empty((n + 1, n))  # lower triangle; the scores are the last row, which the factor holds solved
    column = np.empty(n + 1)
    inverse = np.empty(q)
    for d in range(len(scales)):
        trend, process, noise = scales[d, 0] ** 2, scales[d, 1] ** 2, scales[d, 2] ** 2
        growth, between = scales[d, 3], scales[d, 4]
        for c in range(q):
            inverse[c] = 5.0 / scales[d, 5 + c] ** 2
        pair = 0
        for i in range(n):
            for j in range(i):
                r2 = 0.0
                for c in range(q):
                    r2 += squares[pair, c] * inverse[c]
                r = np.sqrt(r2)
                k = process * (1.0 + r * (1.0 + r / 3.0)) * np.exp(-r)
                if others[pair] > 0.0:
                    k *= between ** others[pair]
                V[i, j] = k + trend * gram[i, j] + vague[i, j]
                pair += 1
            own = noise * (1.0 + (growth * gap[i]) ** 2) * inverse_weights[i]
            V[i, i] = process + trend * gram[i, i] + vague[i, i] + own + 1e-9
            V[n, i] = y[i]
        total = 0.0
        for j in range(n):
            if not V[j, j] > 0.0:
                total = -np.inf
                break
            root = np.sqrt(V[j, j])
            for i in range(j + 1, n + 1):
                column[i] = V[i, j] / root
            for i in range(j + 1, n + 1):
                left = column[i]
                for m in range(j + 1, min(i + 1, n)):
                    V[i, m] -= left * column[m]
            total -= np.log(root) + 0.5 * column[n] ** 2
        found[d] = total
    return found
