"""Likelihood and mean of the process, one set of hyperparameters after the other."""

from __future__ import annotations

import numpy as np

from seqrsm.arrays import FloatArray, IntArray
from seqrsm.jit import kernel


@kernel
def log_likelihoods(
    scales: FloatArray,
    lengths: FloatArray,
    bends: FloatArray,
    base: FloatArray,
    columns: IntArray,
    levels: FloatArray,
    vague: FloatArray,
    y: FloatArray,
    gap: FloatArray,
    inverse_weights: FloatArray,
) -> FloatArray:
    """Log likelihood (d,) of scores y (n,), without its constant; -inf where rounding leaves no positive matrix.

    Parameters
    ----------
    scales : ndarray (d, 5)
        Standard deviations of coefficients, process and noise, growth of the noise, correlation between categories.
    lengths, bends : ndarray (d, q)
    base : ndarray (n, m)
        One, the numeric factors, contrasts.
    columns : ndarray (t, 3) of int
        Base columns whose product a column of the trend is.
    levels : ndarray (n, c)
        Of the categories.
    vague : ndarray (n, n)
        Covariance of constants and nuisance effects.
    y, gap, inverse_weights : ndarray (n,)
    """
    n, q, t = len(y), lengths.shape[1], len(columns)
    found = np.empty(len(scales))
    V = np.empty((n + 1, n))  # lower triangle; the scores are the last row, which the factor holds solved
    column = np.empty(n + 1)
    # One row a coordinate, and a term: what the inner loops run along lies together.
    at, rows = base.T.copy(), np.empty((t, n))
    apart, k = np.empty(n), np.empty(n)
    for d in range(len(scales)):
        trend, process, noise = scales[d, 0], scales[d, 1] ** 2, scales[d, 2] ** 2
        growth, between = scales[d, 3], scales[d, 4]
        for c in range(1, 1 + q):
            bend = bends[d, c - 1]
            if abs(bend) < 1e-4:
                for i in range(n):
                    at[c, i] = base[i, c] + 0.5 * bend * (base[i, c] ** 2 - 1.0)
            else:
                middle, half = np.cosh(bend), np.sinh(bend)
                for i in range(n):
                    at[c, i] = (np.exp(bend * base[i, c]) - middle) / half
        for e in range(t):
            for i in range(n):
                rows[e, i] = trend * at[columns[e, 0], i] * at[columns[e, 1], i] * at[columns[e, 2], i]
        for i in range(n):
            for j in range(i + 1):
                apart[j] = 0.0
                k[j] = vague[i, j]
            for c in range(1, 1 + q):
                inverse, own = 5.0 / lengths[d, c - 1] ** 2, at[c, i]
                for j in range(i + 1):
                    apart[j] += (at[c, j] - own) ** 2 * inverse
            for e in range(t):
                own = rows[e, i]
                for j in range(i + 1):
                    k[j] += own * rows[e, j]
            for j in range(i + 1):
                r = np.sqrt(apart[j])
                of_process = process * (1.0 + r * (1.0 + r / 3.0)) * np.exp(-r)
                for c in range(levels.shape[1]):
                    if levels[i, c] != levels[j, c]:
                        of_process *= between
                V[i, j] = k[j] + of_process
            own = noise * (1.0 + (growth * gap[i]) ** 2) * inverse_weights[i]
            V[i, i] += own + 1e-9
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


@kernel
def process_sums(
    scaled: FloatArray,
    levels: FloatArray,
    own_scaled: FloatArray,
    own_levels: FloatArray,
    process: FloatArray,
    between: FloatArray,
    alpha: FloatArray,
) -> FloatArray:
    """Sums (d, m) of the process's covariance between points and scores, times ``alpha`` (d, n).

    Parameters
    ----------
    scaled, own_scaled : ndarray (d, m, q), (d, n, q)
        Bent coordinates of points and of scores, in lengths.
    levels, own_levels : ndarray (m, c), (n, c)
        Of the categories.
    process, between : ndarray (d,)
        Standard deviation of the process, and its correlation between two levels.
    alpha : ndarray (d, n)
    """
    found = np.zeros(scaled.shape[:2])
    for d in range(len(scaled)):
        for i in range(scaled.shape[1]):
            total = 0.0
            for j in range(own_scaled.shape[1]):
                r2 = 0.0
                for c in range(scaled.shape[2]):
                    r2 += (scaled[d, i, c] - own_scaled[d, j, c]) ** 2
                r = np.sqrt(5.0 * r2)
                k = alpha[d, j] * (1.0 + r * (1.0 + r / 3.0)) * np.exp(-r)
                for c in range(levels.shape[1]):
                    if levels[i, c] != own_levels[j, c]:
                        k *= between[d]
                total += k
            found[d, i] = process[d] ** 2 * total
    return found
