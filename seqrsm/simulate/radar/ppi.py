"""Plan-position indicator: a rotating antenna over one point, RSL TR 380-1 section 3.2.3.

The data base is turned from rectangular into polar coordinates, rings of one ground range by columns of one bearing, on
which the same kernels work as for a side-looking radar; pixels are as wide as the real beam, a constant angle.
`seqrsm.simulate.radar.result` turns the picture back into rectangular coordinates, north up.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import lru_cache
from typing import Final

import numpy as np

from seqrsm.arrays import AnyArray, FloatArray, IntArray
from seqrsm.errors import ConfigurationError, Problem
from seqrsm.scene.layers import fill_gaps, known_heights
from seqrsm.scene.scene import NO_COVER, Scene

_MOST_CELLS: Final = 400_000_000
_BLOCK: Final = 2_000_000


@dataclass(frozen=True, slots=True, eq=False)
class PolarLayers:
    """A scene's layers on rings around the antenna.

    Attributes
    ----------
    elevation_m, cover, field : array (n_rings, m)
        As in `RadarFrame`. The columns go clockwise from north; the first and the last pixel's worth of them repeat the
        other end, so that slopes and beams run over north without a seam.
    cell_of_scene : int64 array (rows, cols)
        Place of each cell of the scene in the layers.
    columns_a_pixel : int
        Columns in one beamwidth: in one pixel.
    mean_m, peak_m : float
        Of the scene's elevations [m].
    """

    elevation_m: AnyArray
    cover: AnyArray
    field: AnyArray
    cell_of_scene: IntArray
    columns_a_pixel: int
    mean_m: float
    peak_m: float

    @property
    def column_rad(self) -> float:
        """Angle between columns [rad]."""
        return 2.0 * math.pi / int(self.elevation_m.shape[1] - 2 * self.columns_a_pixel)


@lru_cache(maxsize=2)
def polar_layers(scene: Scene, east_m: float, north_m: float, beamwidth_rad: float, precision: str) -> PolarLayers:
    """Scene in polar coordinates: elevation by straight lines, category and field by the nearest cell.

    Rings are a cell apart and reach the farthest corner of the scene; columns are at most a cell apart on the farthest
    ring. What lies outside the scene is no data.

    Parameters
    ----------
    scene : Scene
    east_m, north_m : float
        Antenna from the middle of the scene [m].
    beamwidth_rad : float
        Half-power width of the beam in azimuth; pixels are as wide, rounded so that their number is a multiple of 4.
    precision : {"float32", "float64"}

    Returns
    -------
    PolarLayers

    Raises
    ------
    ConfigurationError
        The antenna stands so far away that the rings would not fit into memory.
    """
    rows, cols = scene.shape
    cell = scene.cell_m
    corner = math.hypot(0.5 * cols * cell + abs(east_m), 0.5 * rows * cell + abs(north_m))
    rings = max(math.ceil(corner / cell), 1)
    pixels = pixels_around(beamwidth_rad)
    wide = max(math.ceil(2.0 * math.pi * rings / pixels), 1)
    columns = (pixels + 2) * wide
    if rings * columns > _MOST_CELLS:
        text = f"the farthest corner of the scene is {corner:.0f} m away: {rings} rings of {columns} cells"
        remedy = f"Move the antenna closer, or coarsen the scene: at most {_MOST_CELLS} cells are possible"
        raise ConfigurationError(Problem(text, remedy, field="antenna_east_m", value=east_m))
    step = 2.0 * math.pi / (pixels * wide)
    bearing = (np.arange(-wide, (pixels + 1) * wide) + 0.5)[None, :] * step
    _, mean, peak = known_heights(scene)
    elevation = np.empty((rings, columns), dtype=precision)
    cover = np.empty(elevation.shape, dtype=np.uint8)
    field = np.empty(elevation.shape, dtype=np.int32)
    # Some rings at a time: whole arrays of positions would take many times the memory of the layers.
    for low in range(0, rings, max(_BLOCK // columns, 1)):
        part = slice(low, min(low + max(_BLOCK // columns, 1), rings))
        radius = np.arange(part.start + 1.0, part.stop + 1.0)[:, None]
        col = 0.5 * (cols - 1) + east_m / cell + radius * np.sin(bearing)
        row = 0.5 * (rows - 1) - north_m / cell - radius * np.cos(bearing)
        inside = (row > -0.5) & (row < rows - 0.5) & (col > -0.5) & (col < cols - 0.5)
        i = np.rint(np.clip(row, 0, rows - 1)).astype(np.int64)
        j = np.rint(np.clip(col, 0, cols - 1)).astype(np.int64)
        elevation[part] = np.where(inside, bilinear(scene.elevation_m, row, col) - mean, np.nan)
        cover[part] = np.where(np.isnan(elevation[part]), np.uint8(NO_COVER), scene.cover[i, j])
        field[part] = scene.field_id[i, j]
    if np.isnan(elevation).any() and not np.isnan(elevation).all():
        fill_gaps(elevation)
    place = np.empty((rows, cols), dtype=np.int64)
    east = (np.arange(cols) - 0.5 * (cols - 1)) - east_m / cell
    for k in range(rows):
        north = (0.5 * (rows - 1) - k) - north_m / cell
        ring = np.clip(np.rint(np.hypot(east, north)).astype(np.int64) - 1, 0, rings - 1)
        column = np.floor(np.mod(np.arctan2(east, north), 2.0 * math.pi) / step).astype(np.int64)
        place[k] = ring * columns + wide + np.minimum(column, pixels * wide - 1)
    return PolarLayers(elevation, cover, field, place, wide, mean, peak)


def pixels_around(beamwidth_rad: float) -> int:
    """Number of pixels around, each about a beamwidth: a multiple of 4."""
    return max(4 * round(0.5 * math.pi / beamwidth_rad), 4)


def bilinear(layer: AnyArray, row: FloatArray, col: FloatArray) -> FloatArray:
    """Values of a layer between its cells by straight lines; held at the edges, beside nan the nearest cell's."""
    rows, cols = layer.shape
    r, c = np.clip(row, 0.0, rows - 1.0), np.clip(col, 0.0, cols - 1.0)
    i, j = np.minimum(r.astype(np.int64), max(rows - 2, 0)), np.minimum(c.astype(np.int64), max(cols - 2, 0))
    fr, fc = r - i, c - j
    down, right = np.minimum(i + 1, rows - 1), np.minimum(j + 1, cols - 1)
    upper = (1.0 - fc) * layer[i, j] + fc * layer[i, right]
    lower = (1.0 - fc) * layer[down, j] + fc * layer[down, right]
    out = (1.0 - fr) * upper + fr * lower
    beside = np.isnan(out)
    if beside.any():
        # A cell beside a hole keeps what is known of it.
        nearest = layer[np.rint(r).astype(np.int64), np.rint(c).astype(np.int64)]
        out = np.where(beside, nearest, out)
    return np.asarray(out)
