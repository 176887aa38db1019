"""Searching and covering a constrained region, on plain arrays.

``axes`` holds per factor the ascending coded levels, or None for a continuous factor on [-1, 1]; ``slack`` maps points
(n, k) to (n,), >= 0 where feasible.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import TypeAlias

import numpy as np

from seqrsm.arrays import FloatArray

Axes: TypeAlias = tuple[FloatArray | None, ...]
Slack: TypeAlias = Callable[[FloatArray], FloatArray]

_BISECTIONS = 52
_SEED = 20_011


def distinct(points: FloatArray) -> FloatArray:
    """Rows (m, k) without repeats (to 1e-9 of coded units), in the order they came."""
    _, index = np.unique(np.round(points, 9) + 0.0, axis=0, return_index=True)
    return points[np.sort(index)]


def from_unit_cube(axes: Axes, unit: FloatArray) -> FloatArray:
    """Points of the box from numbers in [0, 1), column by column; levels get equal shares."""
    points = 2.0 * unit - 1.0
    for column, levels in enumerate(axes):
        if levels is not None:
            index = np.minimum((unit[:, column] * levels.size).astype(np.intp), levels.size - 1)
            points[:, column] = levels[index]
    return points


def uniform(axes: Axes, n: int, rng: np.random.Generator) -> FloatArray:
    """Uniform random points of the box, shape (n, k)."""
    return from_unit_cube(axes, rng.random((n, len(axes))))


def low_discrepancy(axes: Axes, n: int) -> FloatArray:
    """First ``n`` points of an additive recurrence on the box.

    Its steps are the powers of 1/phi, phi the root of phi^(k+1) = phi + 1 (Roberts 2018): as even as a Sobol sequence
    at these sizes, and without the import of scipy.stats.
    """
    k = len(axes)
    phi = 2.0
    for _ in range(60):
        phi = (1.0 + phi) ** (1.0 / (k + 1))
    steps = phi ** -np.arange(1.0, k + 1.0)
    return from_unit_cube(axes, (0.5 + np.arange(1.0, n + 1.0)[:, None] * steps) % 1.0)


def grid(axes: Axes, n_continuous_levels: int, limit: int) -> FloatArray | None:
    """Product of all levels, or None where it has more than ``limit`` points."""
    lines = [np.linspace(-1.0, 1.0, n_continuous_levels) if levels is None else levels for levels in axes]
    if float(np.prod([float(line.size) for line in lines])) > limit:
        return None
    return np.stack([mesh.ravel() for mesh in np.meshgrid(*lines, indexing="ij")], axis=1)


def cover(axes: Axes, n_continuous_levels: int, limit: int) -> FloatArray:
    """Grid of the box; where that is larger than ``limit``, a coarser grid that fits and an even sequence."""
    full = grid(axes, n_continuous_levels, limit)
    if full is not None:
        return full
    outline = [_ends(axes)]
    for n in (3, 2):
        coarse = grid(axes, n, limit)
        if coarse is not None:
            outline.append(coarse)
            break
    return distinct(np.vstack([*outline, low_discrepancy(axes, limit)]))


def _ends(axes: Axes) -> FloatArray:
    """Centre of the box and the centres of its faces."""
    lines = [np.array([-1.0, 0.0, 1.0]) if levels is None else levels for levels in axes]
    centre = np.array([line[np.argmin(np.abs(line))] for line in lines])
    rows = [centre]
    for column, line in enumerate(lines):
        for value in line:
            row = centre.copy()
            row[column] = value
            rows.append(row)
    return np.array(rows)


def feasible_anchors(axes: Axes, slacks: Callable[[FloatArray], FloatArray]) -> FloatArray:
    """Return some feasible points (m, k), 256 at most; none where none could be found.

    A cover of the box first; where that meets nothing, the points nearest to feasible are improved coordinate by
    coordinate, so that a thin region is found too.
    """
    points = np.vstack([cover(axes, 5, 4096), low_discrepancy(axes, 4096)])
    worst = np.min(slacks(points), axis=1)
    good = points[worst >= 0.0]
    if good.shape[0] == 0:
        order = np.argsort(-worst, kind="stable")[:64]
        good = _climb(axes, slacks, points[order])
    step = max(good.shape[0] // 256, 1)
    anchors: FloatArray = good[::step][:256]
    return anchors


def _climb(axes: Axes, slacks: Callable[[FloatArray], FloatArray], points: FloatArray) -> FloatArray:
    """Random search for larger slack around each row, with a shrinking step; returns the rows that became feasible."""
    rng = np.random.default_rng(_SEED)
    points = points.copy()
    best = np.min(slacks(points), axis=1)
    trials = 32
    for step in np.geomspace(1.0, 1e-6, 60):
        moves = np.repeat(points, trials, axis=0)
        for column, levels in enumerate(axes):
            touched = rng.random(moves.shape[0]) < max(0.5, 1.0 / len(axes))
            if levels is None:
                shift = np.clip(moves[:, column] + step * rng.standard_normal(moves.shape[0]), -1.0, 1.0)
            else:
                shift = levels[rng.integers(levels.size, size=moves.shape[0])]
            moves[touched, column] = shift[touched]
        values = np.min(slacks(moves), axis=1).reshape(-1, trials)
        winner = np.argmax(values, axis=1)
        gain = np.take_along_axis(values, winner[:, None], axis=1)[:, 0]
        better = gain > best
        points[better] = moves.reshape(points.shape[0], trials, -1)[np.arange(points.shape[0]), winner][better]
        best = np.maximum(best, gain)
        if np.count_nonzero(best >= 0.0) >= points.shape[0] // 2:
            break
    improved: FloatArray = points[best >= 0.0]
    return improved


def conflicting(axes: Axes, slacks: Callable[[FloatArray], FloatArray], n_constraints: int) -> tuple[int, ...]:
    """Return the indices of constraints that no point satisfies together, none of which can be left out."""
    kept = list(range(n_constraints))
    for index in range(n_constraints):
        rest = [i for i in kept if i != index]
        if rest and not len(feasible_anchors(axes, lambda points, rest=rest: slacks(points)[:, rest])):  # type: ignore[misc]
            kept = rest
    return tuple(kept)


def bisect(inside: FloatArray, outside: FloatArray, slack: Slack) -> FloatArray:
    """Feasible point next to the boundary on each segment from a feasible to an infeasible end; all (n, k)."""
    inside, outside = inside.copy(), outside.copy()
    for _ in range(_BISECTIONS):
        middle = 0.5 * (inside + outside)
        good = slack(middle) >= 0.0
        inside[good] = middle[good]
        outside[~good] = middle[~good]
    return inside
