"""Where each cell of the scene falls in the image, and what becomes of it."""

from __future__ import annotations

import numpy as np

from seqrsm.arrays import AnyArray
from seqrsm.scene.scene import Scene
from seqrsm.sensor.radar import RadarConfiguration
from seqrsm.simulate.radar import kernels
from seqrsm.simulate.radar.echo import EchoGrid
from seqrsm.simulate.radar.frame import RadarFrame, to_scene


def pixels_of_cells(
    scene: Scene, radar: RadarConfiguration, frame: RadarFrame, grid: EchoGrid, cells_a_pixel: float, n_azimuth: int
) -> AnyArray:
    """Pixel of each cell of a scene: by its own elevation alone, so that nothing else need be known of the echo.

    Parameters
    ----------
    scene : Scene
    radar : RadarConfiguration
    frame : RadarFrame
    grid : EchoGrid
    cells_a_pixel : float
        Azimuth cells in a pixel.
    n_azimuth : int
        Columns of pixels.

    Returns
    -------
    int32 array (rows, cols)
        Pixel ``row * n_azimuth + column``; -1 without data or outside the image.
    """
    own = slice(frame.pad_near, frame.pad_near + frame.n_rows)
    first = int(frame.source[frame.pad_near])
    rows = slice(first, first + frame.n_rows)
    # The frame's columns of a plan-position indicator repeat a pixel's worth at either end.
    repeated = 1 if frame.wrapped else 0
    width = n_azimuth + 2 * repeated
    pixel = np.full(frame.elevation_m.shape, -1, dtype=np.int32)
    kernels.register_cells(
        frame.elevation_m[rows],
        frame.cover[rows],
        len(scene.categories),
        grid.geometry[own],
        grid.base[1:-1][own],
        radar.range_format == "ground",
        grid.first,
        cells_a_pixel,
        (grid.n_bins, width),
        pixel[rows],
    )
    pixel = to_scene(pixel, frame, scene.shape, -1)
    if repeated:
        row, column = np.divmod(pixel, width)
        pixel = np.where(pixel < 0, pixel, row * n_azimuth + column - repeated)
    return pixel


def state_of_cells(scene: Scene, radar: RadarConfiguration, frame: RadarFrame, grid: EchoGrid) -> AnyArray:
    """Bits of `kernels` (CAST_SHADOW, SELF_SHADOW, LAYOVER, NO_DATA) of each cell of a scene, uint8 (rows, cols)."""
    n_categories = len(scene.categories)
    shape = (len(frame.source), frame.elevation_m.shape[1])
    dtype = frame.elevation_m.dtype
    offset, state = np.empty(shape, dtype=dtype), np.empty(shape, dtype=np.uint8)
    # No channels: position and state alone.
    kernels.sum_echoes(
        frame.elevation_m,
        frame.top_m,
        frame.source,
        frame.cover,
        frame.field,
        grid.geometry,
        grid.rows.astype(dtype),
        radar.range_format == "ground",
        np.empty((0, 2 * (n_categories + 1)), dtype=np.result_type(dtype, np.complex64)),
        n_categories,
        np.empty((0, 0), dtype=dtype),
        np.empty(0, dtype=dtype),
        grid.base,
        grid.first,
        0,
        shape[1],
        np.empty((0, grid.n_bins, shape[1]), dtype=dtype),
        offset,
        state,
    )
    kernels.mark_layover(offset, grid.base[1:-1], state)
    del offset
    own = slice(frame.pad_near, frame.pad_near + frame.n_rows)
    first = int(frame.source[frame.pad_near])
    whole = np.full(frame.elevation_m.shape, kernels.NO_DATA, dtype=np.uint8)
    whole[first : first + frame.n_rows] = state[own]
    return to_scene(whole, frame, scene.shape, kernels.NO_DATA)
