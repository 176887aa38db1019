"""Rivers, roads and towns of a synthetic scene: paths of least cost over the terrain, and blocks of a town."""

from __future__ import annotations

import math
from collections.abc import Sequence
from itertools import pairwise

import numpy as np
from scipy.ndimage import distance_transform_edt
from scipy.sparse import coo_array
from scipy.sparse.csgraph import dijkstra

from seqrsm.arrays import AnyArray, BoolArray, FloatArray, IntArray
from seqrsm.scene.fields import hash_uniform
from seqrsm.scene.terrain import strips

_COARSE_CELLS = 120
"""Cells a side at most of the grid on which paths are sought."""

Cell = tuple[int, int]


def river_mask(elevation_m: AnyArray, count: int, width_cells: float, *, seed: int) -> BoolArray:
    """Rivers that cross the scene from edge to edge through its valleys, by turns west to east and north to south.

    Parameters
    ----------
    elevation_m : float array (rows, cols)
    count : int
    width_cells : float
        Width of each [cells], at least 1.
    seed : int

    Returns
    -------
    bool array (rows, cols)
    """
    coarse, step = _coarse(elevation_m)
    rows, cols = coarse.shape
    low = coarse - coarse.min()
    scale = float(low.max()) or 1.0
    mask = np.zeros(elevation_m.shape, dtype=np.bool_)
    for k in range(count):
        noise = hash_uniform(np.arange(rows * cols), seed + k).reshape(rows, cols)
        cost = 0.1 + 4.0 * low / scale + 0.8 * noise
        # Each river takes its own part of the edge, and its lowest cell there.
        part, parts = k // 2, (count + 1 - k % 2) // 2
        across = k % 2 == 0
        edges = (cost[:, 0], cost[:, -1]) if across else (cost[0], cost[-1])
        first, last = (_lowest_of_part(edge, part, parts) for edge in edges)
        ends = ((first, 0), (last, cols - 1)) if across else ((0, first), (rows - 1, last))
        mask |= _drawn(_path(cost, *ends), step, elevation_m.shape, width_cells)
    return mask


def town_centres(rows: int, cols: int, count: int, *, seed: int) -> list[Cell]:
    """Centres of towns, each as far from those before it as the best of some drawn places is."""
    chosen: list[Cell] = []
    for k in range(count):
        draw = hash_uniform(np.arange(24) + 24 * k, seed)
        places = [(int((0.1 + 0.8 * a) * rows), int((0.1 + 0.8 * b) * cols)) for a, b in draw.reshape(12, 2)]
        chosen.append(max(places, key=lambda p: min((math.dist(p, c) for c in chosen), default=0.0)))
    return chosen


def town_mask(shape: tuple[int, int], centres: Sequence[Cell], radius_cells: float, *, seed: int) -> BoolArray:
    """Ground of towns: rounds of the radius, give or take a third, with bays and spurs."""
    mask = np.zeros(shape, dtype=np.bool_)
    for own in strips(*shape):
        row, col = np.ogrid[own, 0 : shape[1]]
        for k, (i, j) in enumerate(centres):
            draw = hash_uniform(np.arange(8) + 8 * k, seed)
            bearing = np.arctan2(row - i, col - j)
            border = radius_cells * (0.7 + 0.6 * draw[0])
            for wave in range(2, 5):
                border = border * (1.0 + 0.15 * np.cos(wave * bearing + 2.0 * math.pi * draw[wave]))
            mask[own] |= np.hypot(row - i, col - j) <= border
    return mask


def road_mask(
    elevation_m: AnyArray, cell_m: float, centres: Sequence[Cell], river: BoolArray, width_cells: float, *, seed: int
) -> BoolArray:
    """Roads from each town to its nearest neighbour before it, and from the first to the west and east edges.

    They shun slopes and cross rivers where that is short. A scene without towns gets one road from west to east.
    """
    coarse, step = _coarse(elevation_m)
    rows, cols = coarse.shape
    along, across = np.gradient(coarse, cell_m * step) if min(rows, cols) > 1 else (coarse * 0.0, coarse * 0.0)
    noise = hash_uniform(np.arange(rows * cols), seed).reshape(rows, cols)
    wet = _coarse(river)[0] > 0.0
    cost = 1.0 + 60.0 * (along**2 + across**2) + 0.3 * noise + 4.0 * wet
    at = [(min(i // step, rows - 1), min(j // step, cols - 1)) for i, j in centres]
    start = at[0] if at else (rows // 2, cols // 2)
    pairs = [(start, (start[0], 0)), (start, (start[0], cols - 1))]
    pairs += [(at[k], min(at[:k], key=lambda c, k=k: math.dist(c, at[k]))) for k in range(1, len(at))]  # type: ignore[misc]
    mask = np.zeros(elevation_m.shape, dtype=np.bool_)
    for one, other in pairs:
        mask |= _drawn(_path(cost, one, other), step, elevation_m.shape, width_cells)
    return mask


def _coarse(layer: AnyArray) -> tuple[FloatArray, int]:
    """Every so many-th cell of a layer, and how many."""
    step = max(-(-max(layer.shape) // _COARSE_CELLS), 1)
    return np.asarray(layer[::step, ::step], dtype=np.float64), step


def _lowest_of_part(edge: AnyArray, part: int, parts: int) -> int:
    first, last = part * len(edge) // parts, max((part + 1) * len(edge) // parts, part * len(edge) // parts + 1)
    return first + int(np.argmin(edge[first:last]))


def _path(cost: FloatArray, start: Cell, end: Cell) -> IntArray:
    """Cells (n, 2) of the path of least cost between two cells over the eight neighbours of each."""
    rows, cols = cost.shape
    number = np.arange(rows * cols).reshape(rows, cols)
    one, other, weight = [], [], []
    for di, dj in ((0, 1), (1, 0), (1, 1), (1, -1)):
        a = number[: rows - di, max(-dj, 0) : cols - max(dj, 0)].ravel()
        b = number[di:, max(dj, 0) : cols + min(dj, 0)].ravel()
        one.append(a)
        other.append(b)
        weight.append(0.5 * (cost.ravel()[a] + cost.ravel()[b]) * math.hypot(di, dj))
    edges = (np.concatenate(weight), (np.concatenate(one), np.concatenate(other)))
    graph = coo_array(edges, shape=(cost.size, cost.size)).tocsr()
    source, target = int(number[start]), int(number[end])
    _, before = dijkstra(graph, directed=False, indices=[source], return_predecessors=True)
    cells = [target]
    while cells[-1] != source:
        cells.append(int(before[0, cells[-1]]))
    return np.stack(np.divmod(np.array(cells), cols), axis=1)


def _drawn(path: IntArray, step: int, shape: tuple[int, int], width_cells: float) -> BoolArray:
    """Cells within half the width of a path of the coarse grid; the path runs out over the edges."""
    points = np.minimum(path * step + (step - 1) / 2, np.array(shape) - 1.0)
    for end in (0, -1):
        for axis in (0, 1):
            if path[end, axis] == 0:
                points[end, axis] = 0.0
            elif path[end, axis] == -(-shape[axis] // step) - 1:
                points[end, axis] = shape[axis] - 1.0
    parts = [points[:1]]
    for a, b in pairwise(points):
        n = math.ceil(2.0 * math.dist(a, b)) + 1
        parts.append(a + (b - a) * (np.arange(1, n + 1) / n)[:, None])
    cells = np.rint(np.concatenate(parts)).astype(np.int64)
    free = np.ones(shape, dtype=np.bool_)
    free[cells[:, 0], cells[:, 1]] = False
    half = 0.5 * max(width_cells, 1.0)
    reach = math.ceil(half)
    mask = np.zeros(shape, dtype=np.bool_)
    for own in strips(*shape):
        # What lies further away than the reach does not matter to the strip.
        first = max(own.start - reach, 0)
        around = free[first : own.stop + reach]
        if not around.all():
            mask[own] = (distance_transform_edt(around) < half)[own.start - first : own.stop - first]
    return mask
