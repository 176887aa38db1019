"""Where each cell of the scene falls in the image, and what becomes of it: made when asked for, and once."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from seqrsm.arrays import AnyArray, BoolArray
from seqrsm.simulate.radar import kernels
from seqrsm.simulate.radar.echo import EchoGrid
from seqrsm.simulate.radar.frame import RadarFrame, to_scene


@dataclass(frozen=True, slots=True, eq=False)
class Registration:
    """Relation of a scene's cells to the pixels of one image.

    Attributes
    ----------
    frame : RadarFrame
    grid : EchoGrid
    ground_format : bool
        Range format of the image.
    cells_a_pixel : float
        Azimuth cells in a pixel.
    n_range, n_azimuth : int
        Size of the image.
    scene_shape : tuple of int
        Rows and columns of the scene.
    n_categories : int
        Categories of the scene; the first number that is none.
    wrapped_pixels : int
        Pixels that the frame's columns repeat at either end (plan-position indicator).
    """

    frame: RadarFrame
    grid: EchoGrid
    ground_format: bool
    cells_a_pixel: float
    n_range: int
    n_azimuth: int
    scene_shape: tuple[int, int]
    n_categories: int
    wrapped_pixels: int = 0
    _made: dict[str, AnyArray] = field(default_factory=dict, repr=False)

    def _make(self) -> None:
        frame, grid = self.frame, self.grid
        offset, state = place_cells(frame, grid, self.n_categories, ground_format=self.ground_format)
        base = grid.base[1:-1]
        kernels.mark_layover(offset, base, state)
        pixel = kernels.register_cells(
            offset,
            base,
            state,
            grid.first,
            self.n_range,
            self.cells_a_pixel,
            self.n_azimuth + 2 * self.wrapped_pixels,
        )
        del offset
        pixel = to_scene(pixel, frame, self.scene_shape, -1)
        if self.wrapped_pixels:
            row, column = np.divmod(pixel, self.n_azimuth + 2 * self.wrapped_pixels)
            pixel = np.where(pixel < 0, pixel, row * self.n_azimuth + column - self.wrapped_pixels)
        self._made["pixel"] = pixel
        self._made["state"] = to_scene(state, frame, self.scene_shape, kernels.NO_DATA)

    def _layer(self, name: str) -> AnyArray:
        if name not in self._made:
            self._make()
        return self._made[name]

    @property
    def pixel_of_cell(self) -> AnyArray:
        """Pixel ``row * n_azimuth + column`` of each cell, int32 (rows, cols); -1 without data or outside the image."""
        return self._layer("pixel")

    @property
    def shadow(self) -> BoolArray:
        """Cells (rows, cols) that return nothing for geometry."""
        return np.asarray((self._layer("state") & np.uint8(kernels.CAST_SHADOW | kernels.SELF_SHADOW)) != 0)

    @property
    def layover(self) -> BoolArray:
        """Cells (rows, cols) whose echo is mixed with other ground in range."""
        return np.asarray((self._layer("state") & np.uint8(kernels.LAYOVER)) != 0)


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
