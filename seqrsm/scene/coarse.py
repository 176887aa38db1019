"""A data base of wider cells, where less detail will do."""

from __future__ import annotations

from dataclasses import replace
from functools import lru_cache

import numpy as np

from seqrsm.arrays import Float32Array
from seqrsm.scene.scene import Scene

LARGEST = 16
"""Cells along a side of the blocks that become one, at most. With the data base as it is there are then five, and what
is made of each once, such as parts of its fields, is kept for six."""

_LEAST_SIDE = 8


def cells_in_one(cell_m: float, detail_m: float, cells: int) -> int:
    """Cells along a side of the blocks that may become one: a power of 2, so that few data bases serve many sensors.

    Parameters
    ----------
    cell_m : float
        Side of a cell [m].
    detail_m : float
        Side of what a sensor tells apart [m].
    cells : int
        That are to be left along that side at least; 0 keeps the data base as it is.
    """
    factor = 1
    while cells > 0 and factor < LARGEST and 2 * factor * cells * cell_m <= detail_m * (1.0 + 1e-9):
        factor *= 2
    return factor


@lru_cache(maxsize=6)
def coarse_scene(scene: Scene, factor: int) -> Scene:
    """Data base of ``factor`` times wider cells: what varies smoothly is averaged, the rest is that of the middle cell.

    The category of one cell, not of the majority: over many cells the shares of categories stay what they are. Cells
    left over at the far edges are dropped.

    Parameters
    ----------
    scene : Scene
    factor : int

    Returns
    -------
    Scene
        `scene` itself where `factor` is 1, or fewer than 8 cells would be left along a side, or than there are fields.
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
