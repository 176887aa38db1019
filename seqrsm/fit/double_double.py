"""Sums of products in twice the working precision.

A number is held as an unevaluated sum ``high + low`` of two doubles, about 32 digits. Only IEEE double arithmetic is
used, so results are the same on every platform (the 80-bit ``numpy.longdouble`` is not).

References
----------
Dekker (1971), A floating-point technique for extending the available precision, Numer. Math. 18, 224-242.
Ogita, Rump, Oishi (2005), Accurate sum and dot product, SIAM J. Sci. Comput. 26, 1955-1988.
"""

from __future__ import annotations

from seqrsm.arrays import FloatArray

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
    """Product ``A @ (x_high + x_low)`` in double-double.

    Parameters
    ----------
    A : ndarray (n, p)
        Plain doubles.
    x_high, x_low : ndarray (p, m)

    Returns
    -------
    tuple of ndarray (n, m)
        High and low part.
    """
    columns = A.T[:, :, None]  # (p, n, 1)
    p, e = two_product(columns, x_high[:, None, :])
    return sum_first_axis(p, e + columns * x_low[:, None, :])
