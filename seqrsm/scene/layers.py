"""A scene as every engine meets it: turned to a heading, levelled about its datum, and what its fields are."""

from __future__ import annotations

from functools import lru_cache

import numpy as np

from seqrsm.arrays import AnyArray, FloatArray
from seqrsm.errors import Problem, SceneError
from seqrsm.scene import kernels
from seqrsm.scene.scene import NO_COVER, Scene


def known_heights(scene: Scene) -> tuple[int, float, float]:
    """Number, mean [m] and maximum [m] of the known elevations.

    Raises
    ------
    SceneError
        No cell has an elevation.
    """
    known, mean, highest = kernels.elevation_summary(scene.elevation_m)
    if known == 0:
        raise SceneError(Problem("no cell has an elevation", "Give at least one", field="elevation_m"))
    return known, mean, highest


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
    kernels.fill_no_data(elevation_m)
    return np.where(gaps, np.uint8(NO_COVER), cover)


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
    """Category of each field of a scene, uint8 (n_fields,)."""
    return kernels.categories_of_fields(scene.field_id, scene.cover, scene.n_fields)
