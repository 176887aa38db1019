"""Many runs as fewer settings: near runs count as repeats at their middle.

The quadratic's part of what their scores differ by is moved with them; the rest of it is taken for scatter.
"""

from __future__ import annotations

import heapq

import numpy as np

from seqrsm.arrays import AnyArray, FloatArray, IntArray
from seqrsm.design.quadratic import QuadraticModel


def gathered(
    model: QuadraticModel, points: FloatArray, y: FloatArray, weights: FloatArray, kind: AnyArray, most: int
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Settings, scores and weights of runs with at most ``most`` different settings and weights.

    Groups are halved at the mean of the factor in which they are widest, the one with most squares first.

    Parameters
    ----------
    model : QuadraticModel
        Of which a fit by least squares says what scores differ by within a group.
    points : ndarray (n, k)
        Coded settings.
    y, weights : ndarray (n,)
        Scores, and relative weights, > 0.
    kind : ndarray (n, j)
        Runs with equal rows may be gathered; at most ``most`` rows are different.

    Returns
    -------
    ndarray (n, k), (n,), (n,)
        Of each run: the mean settings of its group, its score there, and the harmonic mean of the group's weights, by
        which the mean of the scores has the variance that it has.
    """
    group = _groups(points[:, list(model.numeric)], kind, most)
    size = np.bincount(group)
    points = np.array(points, dtype=np.float64)
    before = model.matrix(points)
    for j in model.numeric:
        points[:, j] = (np.bincount(group, points[:, j]) / size)[group]
    root = np.sqrt(weights)
    slopes = np.linalg.lstsq(before * root[:, None], y * root, rcond=None)[0]
    moved = y + (model.matrix(points) - before) @ slopes
    return points, moved, (size / np.bincount(group, 1.0 / weights))[group]


def _groups(at: FloatArray, kind: AnyArray, most: int) -> IntArray:
    """Number (n,) of each run's group, by numeric settings (n, q)."""
    group = np.unique(kind, axis=0, return_inverse=True)[1].reshape(-1)
    widest: list[tuple[float, int, int]] = []

    def push(number: int) -> None:
        own = at[group == number]
        squares = np.sum(np.square(own - own.mean(axis=0)), axis=0)
        if squares.max(initial=0.0) > 0.0:
            heapq.heappush(widest, (-float(squares.max()), number, int(np.argmax(squares))))

    n = int(group.max()) + 1
    for number in range(n):
        push(number)
    while widest and n < most:
        _, number, axis = heapq.heappop(widest)
        inside = np.flatnonzero(group == number)
        group[inside[at[inside, axis] > at[inside, axis].mean()]] = n
        push(number)
        push(n)
        n += 1
    return group
