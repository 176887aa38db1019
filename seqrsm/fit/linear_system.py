"""The orthogonal factorisation under every least-squares fit, with refinement to full double precision.

The normal equations are never formed. Columns are scaled by powers of two (exact), factored by pivoted Householder QR,
the rank is read from the diagonal of R, and the solution is refined on the augmented system

    [ I  X ] [r]   [f]
    [ X' 0 ] [b] = [g]

with its residuals in double-double arithmetic. f = y, g = 0 gives the least-squares solution; f = 0, g = -e_j gives
column j of (X'X)^-1.

A double-double number is held as an unevaluated sum ``high + low`` of two doubles, about 32 digits. Only IEEE double
arithmetic is used, so results are the same on every platform (the 80-bit ``numpy.longdouble`` is not).

References
----------
Bjorck (1967), Iterative refinement of linear least squares solutions I, BIT 7, 257-278.
Demmel, Hida, Riedy, Li (2009), Extra-precise iterative refinement for overdetermined least squares problems,
ACM Trans. Math. Softw. 35, 28.
Dekker (1971), A floating-point technique for extending the available precision, Numer. Math. 18, 224-242.
Ogita, Rump, Oishi (2005), Accurate sum and dot product, SIAM J. Sci. Comput. 26, 1955-1988.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.linalg import qr, solve_triangular
from scipy.linalg.lapack import dtrtri

from seqrsm.arrays import FloatArray, IntArray

_SPLITTER = 134217729.0  # 2**27 + 1: cuts a 53-bit significand into two halves of at most 26 bits


def two_sum(a: FloatArray, b: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return ``(s, e)`` with s the rounded sum and s + e exactly a + b (Knuth); arrays broadcast."""
    s = a + b
    v = s - a
    return s, (a - (s - v)) + (b - v)


def two_product(a: FloatArray, b: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return ``(p, e)`` with p the rounded product and p + e exactly a * b (Dekker); |a|, |b| below about 1e292."""
    p = a * b
    t = _SPLITTER * a
    a_high = t - (t - a)
    a_low = a - a_high
    t = _SPLITTER * b
    b_high = t - (t - b)
    b_low = b - b_high
    return p, ((a_high * b_high - p) + a_high * b_low + a_low * b_high) + a_low * b_low


def add(a_high: FloatArray, a_low: FloatArray, b_high: FloatArray, b_low: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Sum of two double-double arrays, renormalised so that ``|low|`` is at most half an ulp of ``high``."""
    s, e = two_sum(a_high, b_high)
    return two_sum(s, e + (a_low + b_low))


def sum_first_axis(high: FloatArray, low: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Pairwise double-double sum over axis 0 (at least one element)."""
    while high.shape[0] > 1:
        half = high.shape[0] // 2
        s, e = add(high[:half], low[:half], high[half : 2 * half], low[half : 2 * half])
        if high.shape[0] % 2:
            s[0], e[0] = add(s[0], e[0], high[-1], low[-1])
        high, low = s, e
    return high[0], low[0]


def matmul(A: FloatArray, x_high: FloatArray, x_low: FloatArray) -> tuple[FloatArray, FloatArray]:
    """High and low part (n, m) of ``A @ (x_high + x_low)`` in double-double; A (n, p) of plain doubles, x (p, m)."""
    columns = A.T[:, :, None]  # (p, n, 1)
    p, e = two_product(columns, x_high[:, None, :])
    return sum_first_axis(p, e + columns * x_low[:, None, :])


EPSILON = float(np.finfo(np.float64).eps)
_MAX_REFINEMENTS = 12
_REFINE_COVARIANCE_ABOVE = 1e2  # condition number above which R^-1 alone loses more than two digits


@dataclass(frozen=True, slots=True)
class Factorisation:
    """Pivoted QR of the column-scaled matrix ``X`` (n, p)."""

    X: FloatArray
    """(n, p): the matrix with its columns scaled, ``X = Z * scale``."""
    scale: FloatArray
    """(p,): powers of two."""
    pivot: IntArray
    """(p,): column order of the factorisation: the first ``rank`` are a basis of the column space."""
    rank: int

    Q: FloatArray
    """(n, rank)."""
    R: FloatArray
    """(rank, rank)."""
    null: FloatArray
    """(p, p - rank): basis of the null space of ``X`` (in scaled coefficients), unit columns."""
    condition_number: float
    """2-norm condition number with columns scaled to unit length; inf when the rank is short."""


def factorise(Z: FloatArray) -> Factorisation:
    """Factor ``Z`` (n, p); rank tolerance max(n, p) * eps * |r_11| on scaled columns."""
    n, p = Z.shape
    norms = np.sqrt(np.sum(np.square(Z), axis=0))
    scale = np.exp2(-np.rint(np.log2(np.where(norms > 0.0, norms, 1.0))))
    X = Z * scale
    Q, R, pivot = qr(X, mode="economic", pivoting=True, check_finite=False)
    diagonal = np.abs(np.diagonal(R))
    largest = float(diagonal[0]) if diagonal.size else 0.0
    rank = int(np.count_nonzero(diagonal > max(n, p) * EPSILON * largest))
    null = np.zeros((p, p - rank))
    if rank < p:
        null[pivot[:rank]] = -solve_triangular(R[:rank, :rank], R[:rank, rank:], check_finite=False)
        null[pivot[rank:]] = np.eye(p - rank)
        null /= np.linalg.norm(null, axis=0)
    singular = np.linalg.svd(R / np.linalg.norm(R, axis=0), compute_uv=False) if rank == p else np.zeros(1)
    condition = float(singular[0] / singular[-1]) if singular[-1] > 0.0 else float("inf")
    basis: FloatArray = np.asarray(Q[:, :rank], dtype=np.float64)
    triangle: FloatArray = np.asarray(R[:rank, :rank], dtype=np.float64)
    return Factorisation(X, scale, pivot.astype(np.int64), rank, basis, triangle, null, condition)


def solve_augmented(
    X: FloatArray, Q: FloatArray, R: FloatArray, f: FloatArray, g: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Solve ``r + X b = f``, ``X'r = g`` for several f (n, m) and g (r, m): b (r, m) and residuals (n, m).

    X (n, r) has full rank and is factorised, ``X = Q R``. The relative error is near one ulp in norm as long as cond(X)
    is below about 1e15.
    """
    r_high, r_low = np.zeros_like(f), np.zeros_like(f)
    b_high, b_low = np.zeros_like(g), np.zeros_like(g)
    f_step, g_step = f, g
    previous = np.inf
    for _ in range(_MAX_REFINEMENTS):
        h = solve_triangular(R, g_step, trans="T", check_finite=False)
        d = Q.T @ f_step
        b_step = solve_triangular(R, d - h, check_finite=False)
        r_step = (f_step - Q @ d) + Q @ h
        r_high, r_low = add(r_high, r_low, r_step, np.zeros_like(f))
        b_high, b_low = add(b_high, b_low, b_step, np.zeros_like(g))
        size = float(np.max(np.abs(b_step), initial=0.0))
        floor = 1e-6 * float(np.max(np.abs(b_high), initial=0.0))
        done = bool(np.all(np.abs(b_step) <= 0.125 * EPSILON * np.maximum(np.abs(b_high), floor)))
        if done or size == 0.0 or size > 0.5 * previous:
            break
        previous = size
        high, low = matmul(X, b_high, b_low)
        high, low = add(high, low, r_high, r_low)
        s, e = add(f, np.zeros_like(f), -high, -low)
        f_step = s + e
        high, low = matmul(np.ascontiguousarray(X.T), r_high, r_low)
        s, e = add(g, np.zeros_like(g), -high, -low)
        g_step = s + e
    return b_high, r_high


def solve(factors: Factorisation, y: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Least-squares coefficients (p,) and residuals (n,), for unscaled columns; of full rank."""
    basis, coefficients, g = factors.pivot, np.zeros(factors.rank), np.zeros((factors.rank, 1))
    b, r = solve_augmented(np.ascontiguousarray(factors.X[:, basis]), factors.Q, factors.R, y[:, None], g)
    coefficients[basis] = b[:, 0] * factors.scale[basis]
    return coefficients, r[:, 0]


def covariance_factor(factors: Factorisation) -> FloatArray:
    """Matrix ``L`` (p, p) with (Z'Z)^-1 = L L'; of full rank."""
    inverse, _ = dtrtri(factors.R)  # unlike a triangular solve it is not spread over threads, which is slower
    L = np.zeros((factors.rank, factors.rank))
    L[factors.pivot] = np.triu(inverse) * factors.scale[factors.pivot, None]
    return L


def covariance(factors: Factorisation, L: FloatArray) -> FloatArray:
    """Unscaled covariance (Z'Z)^-1 (p, p); its columns are refined where the condition number costs digits."""
    if factors.condition_number < _REFINE_COVARIANCE_ABOVE:
        return L @ L.T
    basis, f = factors.pivot, np.zeros((factors.X.shape[0], factors.rank))
    X = np.ascontiguousarray(factors.X[:, basis])
    columns, _ = solve_augmented(X, factors.Q, factors.R, f, -np.eye(factors.rank))
    C = np.empty_like(columns)
    C[np.ix_(basis, basis)] = 0.5 * (columns + columns.T)
    return C * np.outer(factors.scale, factors.scale)
