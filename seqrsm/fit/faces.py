"""Exact maximum of a quadratic on the cube [-1, 1]^q by enumeration of its 3^q faces.

The maximiser of a quadratic on a box is a stationary point of the quadratic restricted to one of the faces: each
coordinate is free, at -1 or at +1. All faces with the same set of free coordinates share one matrix, so the work is
2^q factorisations with many right-hand sides, for any number of quadratics at once.
"""

from __future__ import annotations

from collections.abc import Iterator
from itertools import combinations, product

import numpy as np

from seqrsm.arrays import BoolArray, FloatArray, IntArray

# A pivot below this share of the largest coefficient is no curvature: the ridge then runs into a smaller face, which is
# enumerated as well, and the value lost is at most this share.
_FLAT_PIVOT = 1e-11
_INSIDE = 1e-12
_CHUNK = 4096


def quadratic_values(constant: FloatArray, linear: FloatArray, quadratic: FloatArray, points: FloatArray) -> FloatArray:
    """Values of m quadratics, each at its own points.

    Parameters
    ----------
    constant, linear, quadratic : ndarray (m,), (m, q), (m, q, q)
        The quadratic ``c + x'b + x'Bx`` with symmetric B.
    points : ndarray (m, n, q)
        Coded points.

    Returns
    -------
    ndarray (m, n)
    """
    values: FloatArray = constant[:, None] + (points @ linear[:, :, None])[..., 0]
    values += np.sum((points @ quadratic) * points, axis=-1)
    return values


def _concave(quadratic: FloatArray, scale: FloatArray) -> BoolArray:
    """Which of the matrices (m, f, f) are negative definite, by the pivots of L D L' of their negatives."""
    work = -quadratic
    size = work.shape[-1]
    good = np.ones(len(work), dtype=bool)
    for j in range(size):
        pivot = work[:, j, j]
        good &= pivot > _FLAT_PIVOT * scale
        if j + 1 == size or not good.any():
            break
        safe = np.where(good, pivot, 1.0)
        column = work[:, j + 1 :, j]
        work[:, j + 1 :, j + 1 :] -= column[:, :, None] * (column[:, None, :] / safe[:, None, None])
    return good


def face_maxima(
    constant: FloatArray, linear: FloatArray, quadratic: FloatArray
) -> Iterator[tuple[IntArray, FloatArray, FloatArray]]:
    """Stationary points of m quadratics on every face of the cube on which they can have a maximum.

    A face on which a quadratic is not strictly concave is left out for it: its maximum there, if any, is also attained
    on a smaller face.

    Parameters
    ----------
    constant, linear, quadratic : ndarray (m,), (m, q), (m, q, q)
        The quadratics ``c + x'b + x'Bx`` with symmetric B.

    Yields
    ------
    rows : ndarray (r,) of int
        Which quadratics.
    points : ndarray (r, f, q)
        The stationary point on each of the f faces with the same free coordinates, clipped to the cube.
    values : ndarray (r, f)
        Value there; -inf where the stationary point lies outside the face.
    """
    m, q = linear.shape
    scale = np.maximum(
        np.abs(quadratic).reshape(m, -1).max(axis=1, initial=0.0), np.abs(linear).max(axis=1, initial=0.0)
    )
    for size in range(q + 1):
        signs = np.array(list(product((-1.0, 1.0), repeat=q - size)), dtype=np.float64).reshape(
            2 ** (q - size), q - size
        )
        for free_set in combinations(range(q), size):
            free = np.array(free_set, dtype=np.int64)
            fixed = np.setdiff1d(np.arange(q), free)
            block = quadratic[:, free[:, None], free]
            rows = np.flatnonzero(_concave(block, scale)) if size else np.arange(m)
            if not len(rows):
                continue
            points = np.empty((len(rows), len(signs), q))
            points[:, :, fixed] = signs
            inside = np.ones((len(rows), len(signs)), dtype=bool)
            if size:
                cross = quadratic[rows][:, free[:, None], fixed]
                right = linear[rows][:, free, None] + 2.0 * cross @ signs.T
                solution = np.linalg.solve(-2.0 * block[rows], right).transpose(0, 2, 1)
                inside = np.all(np.abs(solution) <= 1.0 + _INSIDE, axis=-1)
                points[:, :, free] = np.clip(solution, -1.0, 1.0)
            values = quadratic_values(constant[rows], linear[rows], quadratic[rows], points)
            yield rows, points, np.where(inside, values, -np.inf)


def cube_maxima(constant: FloatArray, linear: FloatArray, quadratic: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Global maximum of each of m quadratics on the cube [-1, 1]^q.

    Parameters
    ----------
    constant, linear, quadratic : ndarray (m,), (m, q), (m, q, q)
        The quadratics ``c + x'b + x'Bx`` with symmetric B. q = 0 is allowed.

    Returns
    -------
    points : ndarray (m, q)
        A maximiser of each.
    values : ndarray (m,)
        Its value.
    """
    m, q = linear.shape
    best_points = np.zeros((m, q))
    best_values = np.full(m, -np.inf)
    # Small chunks keep the arrays of one face set in the cache.
    step = max(64, _CHUNK >> max(0, q - 4))
    for start in range(0, m, step):
        part = slice(start, min(start + step, m))
        points, values = best_points[part], best_values[part]
        for rows, found, found_values in face_maxima(constant[part], linear[part], quadratic[part]):
            face = np.argmax(found_values, axis=1)
            value = found_values[np.arange(len(rows)), face]
            better = value > values[rows]
            values[rows[better]] = value[better]
            points[rows[better]] = found[better, face[better]]
    return best_points, best_values
