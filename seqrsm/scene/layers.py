"""A scene as every engine meets it: turned, levelled about its datum, coarser where that will do; and its fields."""

from __future__ import annotations

from dataclasses import replace
from functools import lru_cache

import numpy as np

from seqrsm.arrays import AnyArray, Float32Array, FloatArray, IntArray
from seqrsm.errors import SceneError
from seqrsm.scene.scene import NO_COVER, Scene
from seqrsm.scene.terrain import strips


@lru_cache(maxsize=6)
def known_heights(scene: Scene) -> tuple[int, float, float]:
    """Number, mean [m] and maximum [m] of the known elevations.

    Raises
    ------
    SceneError
        No cell has an elevation.
    """
    known, total, highest = 0, 0.0, -np.inf
    for row in scene.elevation_m:
        heights = row[~np.isnan(row)]
        if heights.size:
            known += heights.size
            # In order: the mean does not depend on how a machine adds several at a time.
            total += float(np.cumsum(heights, dtype=np.float64)[-1])
            highest = max(highest, float(heights.max()))
    if known == 0:
        raise SceneError("no cell has an elevation", "Give at least one", field="elevation_m")
    return known, total / known, highest


def turned(scene: Scene, turns: int, precision: str) -> tuple[AnyArray, AnyArray, AnyArray]:
    """Elevation, of element type ``precision``, cover and field turned by quarters, as ``numpy.rot90`` counts them."""
    # Row-major copies: a transposed view would make the kernels walk against the memory.
    return (
        np.array(np.rot90(scene.elevation_m, turns), dtype=precision, order="C"),
        np.ascontiguousarray(np.rot90(scene.cover, turns)),
        np.ascontiguousarray(np.rot90(scene.field_id, turns)),
    )


def levelled(elevation_m: AnyArray, cover: AnyArray, mean_m: float) -> AnyArray:
    """Count elevations from a mean and fill their gaps, both in place; the cover, with none where the gaps were.

    At least one elevation is finite.
    """
    elevation_m -= elevation_m.dtype.type(mean_m)
    gaps = np.isnan(elevation_m)
    if not gaps.any():
        return cover
    fill_gaps(elevation_m)
    return np.where(gaps, np.uint8(NO_COVER), cover)


def fill_gaps(elevation_m: AnyArray) -> None:
    """Give cells without elevation that of the nearest cell of their row, and empty rows that of the nearest full one.

    In place; at least one cell is finite. Of two as near the first. Geometry needs a surface everywhere; the cells stay
    without power and without score.
    """
    rows, cols = elevation_m.shape
    full = np.zeros(rows, dtype=np.bool_)
    for part in strips(rows, cols):
        heights = elevation_m[part]
        gaps = np.isnan(heights)
        full[part] = ~gaps.all(axis=1)
        at = np.flatnonzero(gaps & full[part, None])
        if at.size:
            heights.flat[at] = heights.flat[_nearest(at, np.flatnonzero(~gaps), cols)]
    empty = np.flatnonzero(~full)
    if empty.size:
        elevation_m[empty] = elevation_m[_nearest(empty, np.flatnonzero(full), rows)]


def _nearest(at: IntArray, known: IntArray, cols: int) -> IntArray:
    """Of rising places ``known`` in an array of ``cols`` columns the nearest in the row of each place ``at``.

    Of two as near the first. Every row that ``at`` lies in has one.
    """
    ends = np.concatenate([[-1], known, [(known[-1] // cols + 1) * cols]])  # the two that are added lie in no row
    place, row = np.searchsorted(known, at), at // cols
    before, after = ends[place], ends[place + 1]
    first = (before // cols == row) & ((after // cols != row) | (at - before <= after - at))
    return np.where(first, before, after)


@lru_cache(maxsize=6)
def moisture_of_fields(scene: Scene) -> FloatArray | None:
    """Mean soil moisture of each field's valid cells [m3/m3] (n_fields,), nan where it has none; None without layer."""
    if scene.soil_moisture is None:
        return None
    valid = scene.valid()
    field = scene.field_id[valid]
    count = np.bincount(field, minlength=scene.n_fields)
    total = np.bincount(field, scene.soil_moisture[valid].astype(np.float64), minlength=scene.n_fields)
    return np.asarray(np.where(count > 0, total / np.maximum(count, 1), np.nan))


@lru_cache(maxsize=6)
def centres_of_fields(scene: Scene) -> FloatArray:
    """Middle of each field's cells (2, n_fields), south and east of the scene's north-western corner [m]."""
    field = scene.field_id.ravel()
    count = np.maximum(np.bincount(field, minlength=scene.n_fields), 1)
    rows, columns = (np.broadcast_to(x, scene.shape).ravel() for x in np.indices(scene.shape, sparse=True))
    south, east = (np.bincount(field, x, scene.n_fields) / count for x in (rows, columns))
    return np.asarray((np.stack([south, east]) + 0.5) * scene.cell_m)


@lru_cache(maxsize=6)
def categories_of_fields(scene: Scene) -> AnyArray:
    """Category of each field of a scene, uint8 (n_fields,): of its last cell, should they differ; 255 where none."""
    found = np.full(scene.n_fields, NO_COVER, dtype=np.uint8)
    for field, cover in zip(scene.field_id, scene.cover, strict=True):  # by rows: no arrays as large as the scene
        known = cover != NO_COVER
        found[field[known]] = cover[known]
    return found


LARGEST = 16
"""Cells along a side of the blocks that become one, at most. With the data base as it is there are then five, and what
is made of each once, such as parts of its fields, is kept for six."""

_LEAST_SIDE = 8


def cells_in_one(cell_m: float, detail_m: float, cells: int) -> int:
    """Cells along a side of the blocks that may become one: a power of 2, so that few data bases serve many sensors.

    ``detail_m``: side of what a sensor tells apart [m], along which so many ``cells`` are to be left at least; 0 keeps
    the data base as it is.
    """
    factor = 1
    while cells > 0 and factor < LARGEST and 2 * factor * cells * cell_m <= detail_m * (1.0 + 1e-9):
        factor *= 2
    return factor


@lru_cache(maxsize=6)
def coarse_scene(scene: Scene, factor: int) -> Scene:
    """Data base of ``factor`` times wider cells: what varies smoothly is averaged, the rest is that of the middle cell.

    The category of one cell, not of the majority: over many cells the shares of categories stay what they are. Cells
    left over at the far edges are dropped. `scene` itself where `factor` is 1, or fewer than 8 cells would be left
    along a side, or than there are fields.
    """
    rows, cols = (n // factor for n in scene.shape)
    if factor == 1 or min(rows, cols) < _LEAST_SIDE or scene.n_fields > rows * cols:
        return scene
    middle = tuple(slice(factor // 2, n * factor, factor) for n in (rows, cols))

    def mean(layer: Float32Array) -> Float32Array:
        """Of the known values of each block whose middle one is known."""
        blocks = layer[: rows * factor, : cols * factor].reshape(rows, factor, cols, factor)
        known = np.isfinite(blocks)
        total = np.sum(blocks, axis=(1, 3), dtype=np.float64, where=known)
        counted = np.maximum(known.sum(axis=(1, 3)), 1)
        return np.where(np.isfinite(layer[middle]), total / counted, np.nan).astype(np.float32)

    return replace(
        scene,
        elevation_m=mean(scene.elevation_m),
        cover=np.ascontiguousarray(scene.cover[middle]),
        field_id=np.ascontiguousarray(scene.field_id[middle]),
        scored=np.ascontiguousarray(scene.scored[middle]),
        cell_m=scene.cell_m * factor,
        bounds=None,
        temperature_k=None if scene.temperature_k is None else mean(scene.temperature_k),
        soil_moisture=None if scene.soil_moisture is None else mean(scene.soil_moisture),
    )
