"""Searching and covering a constrained region, on plain arrays.

``axes`` holds per factor the ascending coded levels, or None for a continuous factor on [-1, 1]; ``slack`` maps points
(n, k) to (n,), >= 0 where feasible.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import TypeAlias

import numpy as np

from seqrsm.arrays import BoolArray, FloatArray, IntArray

Axes: TypeAlias = tuple[FloatArray | None, ...]
Slack: TypeAlias = Callable[[FloatArray], FloatArray]

_LINE_SAMPLES = 65
_BISECTIONS = 52
_MAX_DRAWN = 1_000_000
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


def feasible_anchors(axes: Axes, slacks: Callable[[FloatArray], FloatArray], count: int = 256) -> FloatArray:
    """Return some feasible points (m, k), m <= ``count``; none where none could be found.

    A cover of the box first; where that meets nothing, the points nearest to feasible are improved coordinate by
    coordinate, so that a thin region is found too.
    """
    points = np.vstack([cover(axes, 5, 4096), low_discrepancy(axes, 4096)])
    worst = np.min(slacks(points), axis=1)
    good = points[worst >= 0.0]
    if good.shape[0] == 0:
        order = np.argsort(-worst, kind="stable")[:64]
        good = _climb(axes, slacks, points[order])
    step = max(good.shape[0] // count, 1)
    anchors: FloatArray = good[::step][:count]
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


def boundary_points(continuous: Sequence[int], points: FloatArray, slack: Slack, limit: int) -> FloatArray:
    """Points where lines along the continuous coordinates through feasible ``points`` leave the feasible set."""
    if not continuous:
        return points[:0]
    budget = max(limit // (2 * len(continuous)), 1)
    starts = points[:: -(-points.shape[0] // budget)]
    found = [points[:0]]
    for j in continuous:
        for end in (-1.0, 1.0):
            ends = starts.copy()
            ends[:, j] = end
            out: BoolArray = slack(ends) < 0.0
            if np.any(out):
                found.append(bisect(starts[out], ends[out], slack))
    return np.vstack(found)


def line_intervals(points: FloatArray, j: int, levels: FloatArray | None, slack: Slack) -> tuple[FloatArray, IntArray]:
    """Feasible intervals of coordinate ``j`` through each of the points (n, k).

    Returns
    -------
    spans : ndarray (n, m, 2)
        Ascending, disjoint, both ends feasible; rows of nan after the last. Levels are intervals of no length.
    counts : ndarray (n,)
        How many intervals each line has.
    """
    n = points.shape[0]
    if levels is None:
        line = np.linspace(-1.0, 1.0, _LINE_SAMPLES)
        # The point's own place too, so that a narrow interval around it is not missed.
        lines = np.sort(np.column_stack([np.tile(line, (n, 1)), np.clip(points[:, j], -1.0, 1.0)]), axis=1)
    else:
        lines = np.tile(levels, (n, 1))
    rows = np.repeat(points[:, None, :], lines.shape[1], axis=1)
    rows[:, :, j] = lines
    good = (slack(rows.reshape(-1, points.shape[1])) >= 0.0).reshape(lines.shape)
    if levels is not None:
        first = last = good
    else:
        step = np.diff(good.astype(np.int8), prepend=0, append=0, axis=1)
        first, last = step[:, :-1] == 1, step[:, 1:] == -1
    counts = np.count_nonzero(first, axis=1)
    spans = np.full((n, max(int(counts.max(initial=0)), 1), 2), np.nan)
    for side, marks in enumerate((first, last)):
        line_of, place = np.nonzero(marks)
        values = lines[line_of, place]
        beyond = place + (1 if side else -1)
        if levels is None:
            # Between the last feasible sample and the next one lies the boundary.
            cut = (beyond >= 0) & (beyond < lines.shape[1])
            if np.any(cut):
                inner, outer = rows[line_of[cut], place[cut]], rows[line_of[cut], beyond[cut]]
                values[cut] = bisect(inner, outer, slack)[:, j]
        position = np.arange(line_of.size) - np.searchsorted(line_of, line_of)
        spans[line_of, position, side] = values
    return spans, counts


def sample(
    axes: Axes,
    n: int,
    rng: np.random.Generator,
    slack: Slack,
    intervals: Callable[[FloatArray, int], FloatArray],
    anchors: FloatArray,
) -> FloatArray:
    """Feasible random points (n, k) by rejection, completed by a hit-and-run walk where rejection is hopeless."""
    found: list[FloatArray] = []
    count, drawn = 0, 0
    while count < n and drawn < min(10_000 * n, _MAX_DRAWN):
        size = int(np.clip(4 * (n - count) * max(drawn, 1) / max(count, 1), 1024, 65_536))
        points = uniform(axes, size, rng)
        good = points[slack(points) >= 0.0]
        found.append(good)
        count += good.shape[0]
        drawn += size
    points = np.vstack([np.empty((0, len(axes))), *found])[:n]
    if points.shape[0] < n:
        points = np.vstack([points, _walk(n - points.shape[0], rng, intervals, np.vstack([points, anchors]))])
    return points


def _walk(
    n: int, rng: np.random.Generator, intervals: Callable[[FloatArray, int], FloatArray], starts: FloatArray
) -> FloatArray:
    k = starts.shape[1]
    point = starts[rng.integers(starts.shape[0])].copy()
    rows = np.empty((n, k))
    for row in range(n):
        for j in range(k):
            spans = intervals(point, j)
            if spans.shape[0] == 0:
                continue
            lengths = spans[:, 1] - spans[:, 0]
            weights = lengths / lengths.sum() if lengths.sum() > 0.0 else np.full(lengths.size, 1.0 / lengths.size)
            span = spans[rng.choice(lengths.size, p=weights)]
            point[j] = rng.uniform(span[0], span[1])
        rows[row] = point
        point = point if rng.random() < 0.9 else starts[rng.integers(starts.shape[0])].copy()
    return rows
