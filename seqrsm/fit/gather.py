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
) -> tuple[IntArray, FloatArray, FloatArray]:
    """At most ``most`` groups of runs: of each its number (n,), the group's mean settings (n, k), its score there (n,).

    Groups are divided at the mean of the factor in which they are widest, the one with most squares first; distances
    along each numeric factor are multiplied by ``scales`` (q,): the more a factor matters, the larger. Runs at coded
    points (n, k) have scores and relative weights > 0 (n,); those with equal rows of ``kind`` (n, j), of which at most
    ``most`` are different, may be gathered. ``guess`` is one of the surface at coded points (m, k), which a quadratic
    by least squares makes better.
    """
    group = _groups(points[:, list(model.numeric)] * scales, kind, most)
    middle, total = np.array(points, dtype=np.float64), np.bincount(group, weights)
    for j in model.numeric:
        middle[:, j] = (np.bincount(group, weights * points[:, j]) / total)[group]
    here, root, before = guess(points), np.sqrt(weights), model.matrix(points)
    columns = np.hstack([before, kind])  # what blocks and sources differ by is no slope
    slopes = np.linalg.lstsq(columns * root[:, None], (y - here) * root, rcond=None)[0][: model.p]
    moved = y + guess(middle) - here + (model.matrix(middle) - before) @ slopes
    return group, middle, moved


def _groups(at: FloatArray, kind: AnyArray, most: int) -> IntArray:
    """Number (n,) of each run's group, by scaled numeric settings (n, q)."""
    group = np.unique(kind, axis=0, return_inverse=True)[1].reshape(-1)
    widest: list[tuple[float, int, int]] = []

    def push(number: int) -> None:
        own = at[group == number]
        squares = np.sum(np.square(own - own.mean(axis=0)), axis=0)
        squares[np.ptp(own, axis=0) == 0.0] = 0.0  # which rounding may leave some of
        if squares.max(initial=0.0) > 0.0:
            heapq.heappush(widest, (-float(squares.max()), number, int(np.argmax(squares))))

    n = int(group.max()) + 1
    for number in range(n):
        push(number)
    while widest and n < most:
        _, number, axis = heapq.heappop(widest)
        inside = np.flatnonzero(group == number)
        along = at[inside, axis]
        cut = np.clip(along.mean(), along.min(), np.nextafter(along.max(), -np.inf))  # both sides have some
        group[inside[along > cut]] = n
        push(number)
        push(n)
        n += 1
    return group
