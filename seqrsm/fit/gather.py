"""Many runs as fewer settings: near runs count as repeats at their middle.

What their scores differ by according to a first guess of the surface is moved with them; the rest is taken for scatter.
"""

from __future__ import annotations

import heapq
from collections.abc import Callable

import numpy as np

from seqrsm.arrays import AnyArray, FloatArray, IntArray
from seqrsm.design.quadratic import QuadraticModel


def gathered(
    model: QuadraticModel,
    points: FloatArray,
    y: FloatArray,
    weights: FloatArray,
    kind: AnyArray,
    guess: Callable[[FloatArray], FloatArray],
    scales: FloatArray,
    most: int,
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Settings, scores and weights of runs with at most ``most`` different settings and weights.

    Groups are halved at the mean of the factor in which they are widest, the one with most squares first.

    Parameters
    ----------
    model : QuadraticModel
    points : ndarray (n, k)
        Coded settings.
    y, weights : ndarray (n,)
        Scores, and relative weights, > 0.
    kind : ndarray (n, j)
        Runs with equal rows may be gathered; at most ``most`` rows are different.
    guess : callable
        Of the surface at coded points (m, k), which a quadratic by least squares makes better.
    scales : ndarray (q,)
        By which distances along each numeric factor are multiplied: the more a factor matters, the larger.

    Returns
    -------
    ndarray (n, k), (n,), (n,)
        Of each run: the mean settings of its group, its score there, and the harmonic mean of the group's weights, by
        which the mean of the scores has the variance that it has.
    """
    group = _groups(points[:, list(model.numeric)] * scales, kind, most)
    size = np.bincount(group)
    middle = np.array(points, dtype=np.float64)
    for j in model.numeric:
        middle[:, j] = (np.bincount(group, points[:, j]) / size)[group]
    here, root, before = guess(points), np.sqrt(weights), model.matrix(points)
    columns = np.hstack([before, kind])  # what blocks and sources differ by is no slope
    slopes = np.linalg.lstsq(columns * root[:, None], (y - here) * root, rcond=None)[0][: model.p]
    moved = y + guess(middle) - here + (model.matrix(middle) - before) @ slopes
    return middle, moved, (size / np.bincount(group, 1.0 / weights))[group]


def _groups(at: FloatArray, kind: AnyArray, most: int) -> IntArray:
    """Number (n,) of each run's group, by scaled numeric settings (n, q)."""
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
