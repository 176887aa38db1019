"""Where each cell of the scene falls in the image, and what becomes of it."""

from __future__ import annotations

import numpy as np

from seqrsm.arrays import AnyArray
from seqrsm.simulate.radar import kernels
from seqrsm.simulate.radar.echo import EchoGrid
from seqrsm.simulate.radar.frame import RadarFrame, to_scene


def register(
    frame: RadarFrame,
    grid: EchoGrid,
    *,
    ground_format: bool,
    cells_a_pixel: float,
    n_azimuth: int,
    scene_shape: tuple[int, int],
    n_categories: int,
) -> tuple[AnyArray, AnyArray]:
    """Relation of a scene's cells to the pixels of one image.

    Parameters
    ----------
    frame : RadarFrame
    grid : EchoGrid
    ground_format : bool
        Range format of the image.
    cells_a_pixel : float
        Azimuth cells in a pixel.
    n_azimuth : int
        Columns of pixels.
    scene_shape : tuple of int
        Rows and columns of the scene.
    n_categories : int
        Categories of the scene; the first number that is none.

    Returns
    -------
    pixel : int32 array (rows, cols)
        Pixel ``row * n_azimuth + column`` of each cell; -1 without data or outside the image.
    state : uint8 array (rows, cols)
        Bits of `kernels`: CAST_SHADOW, SELF_SHADOW, LAYOVER, NO_DATA.
    """
    offset, state = place_cells(frame, grid, n_categories, ground_format=ground_format)
    base = grid.base[1:-1]
    kernels.mark_layover(offset, base, state)
    # The frame's columns of a plan-position indicator repeat a pixel's worth at either end.
    repeated = 1 if frame.wrapped else 0
    width = n_azimuth + 2 * repeated
    pixel = kernels.register_cells(offset, base, state, grid.first, grid.n_bins, cells_a_pixel, width)
    del offset
    pixel = to_scene(pixel, frame, scene_shape, -1)
    if repeated:
        row, column = np.divmod(pixel, width)
        pixel = np.where(pixel < 0, pixel, row * n_azimuth + column - repeated)
    return pixel, to_scene(state, frame, scene_shape, kernels.NO_DATA)


def place_cells(
    frame: RadarFrame, grid: EchoGrid, n_categories: int, *, ground_format: bool
) -> tuple[AnyArray, AnyArray]:
    """Range position of every element less that of its row [bins], and its mask bits but for layover.

    Parameters
    ----------
    frame : RadarFrame
    grid : EchoGrid
    n_categories : int
        Categories of the scene.
    ground_format : bool
        Range format of the image.

    Returns
    -------
    offset : float array (n, m)
    state : uint8 array (n, m)
    """
    shape = (len(frame.source), frame.elevation_m.shape[1])
    offset = np.empty(shape, dtype=frame.elevation_m.dtype)
    state = np.empty(shape, dtype=np.uint8)
    dtype = offset.dtype
    # No channels: position and state alone.
    table = np.empty((0, 2 * (n_categories + 1)), dtype=np.result_type(dtype, np.complex64))
    kernels.power_cells(
        frame.elevation_m,
        frame.source,
        frame.cover,
        frame.field,
        grid.geometry,
        frame.cell_m,
        ground_format,
        table,
        n_categories,
        np.empty((0, 0), dtype=dtype),
        np.empty(0, dtype=dtype),
        np.empty((0, 0, 0), dtype=dtype),
        offset,
        state,
    )
    return offset, state
