"""Image of a radar, with all that a score, a picture or a record needs of it."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np

from seqrsm.arrays import AnyArray, BoolArray, FloatArray, IntArray
from seqrsm.scattering.sigma0 import Sigma0Table
from seqrsm.sensor.radar import RadarConfiguration
from seqrsm.simulate.radar.occasion import Occasion
from seqrsm.units import linear_to_db

_POINTS: Final = 3
"""Points a side at which a pixel of the rectangular picture looks up the polar image."""


@dataclass(frozen=True, slots=True, eq=False)
class RadarImage:
    """Radar image: rows of range (near range first), columns along the flight or of bearing clockwise from north."""

    intensity: AnyArray
    """(n_channels, n_range, n_azimuth): received power of one look with receiver noise and fading, averaged over the
    looks, after M, Q and S [W]."""
    mean_power: AnyArray
    """As `intensity`: expectation of the ground's part of it [W]."""
    noise_power_w: FloatArray
    """(n_range,): expectation of the receiver's part [W]."""
    looks: FloatArray
    """(n_range,): independent samples N in a pixel."""
    calibration_w: FloatArray
    """(n_range,): power of one look from flat ground with sigma0 = 1 [W], eq. (3-20)."""
    noise_equivalent_sigma0: FloatArray
    """(n_range,): sigma0 of flat ground that returns as much as the noise, linear."""
    slant_range_m: FloatArray
    ground_range_m: FloatArray
    incidence_angle_deg: FloatArray
    """(n_range,): of flat ground in the middle of the row [m, m, deg]."""
    range_spacing_m: float
    azimuth_spacing_m: float
    """Spacing of pixels, in range in the unit of the range format [m]; of a plan-position indicator in azimuth that of
    its rectangular picture."""
    registration: Callable[[], AnyArray]
    in_shadow: Callable[[], BoolArray]
    laid_over: Callable[[], BoolArray]
    """Give what `pixels_of_cells`, `shadow_of_cells` and `layover_of_cells` do; made when asked for, and once."""
    radar: RadarConfiguration

    occasion: Occasion
    """State of the ground in this run."""
    quarter_turns: int
    """``numpy.rot90(scene layer, quarter_turns)`` has the image's orientation."""
    cell_m: float
    scene_shape: tuple[int, int]
    """Side of a cell [m], rows and columns of the scene."""
    notes: tuple[str, ...]
    """Assumptions that went into the image."""
    table: Sigma0Table | None = None
    """That the ground was looked up in."""
    day: float | None = None
    """Day of the year, where the image has one."""

    @property
    def pixel_of_cell(self) -> AnyArray:
        """Pixel ``row * n_azimuth + column`` of each cell of the scene, int32 (rows, cols); -1 where there is none."""
        return self.registration()

    @property
    def shadow(self) -> BoolArray:
        """Cells of the scene (rows, cols) that return nothing for geometry."""
        return self.in_shadow()

    @property
    def layover(self) -> BoolArray:
        """Cells of the scene (rows, cols) whose echo is mixed with other ground in range."""
        return self.laid_over()

    def record(self, categories: Sequence[str]) -> Mapping[str, object]:
        """What is kept with a score: plain numbers and names."""
        noise_db = linear_to_db(self.noise_equivalent_sigma0)
        return {
            "engine": "psm",
            "looks": [float(self.looks.min()), float(self.looks.max())],
            "noise_equivalent_sigma0_db": [round(float(noise_db.min()), 2), round(float(noise_db.max()), 2)],
            "occasion": dict(self.occasion.record(self.radar.layers, categories)),
        }

    def apparent_sigma0(self) -> AnyArray:
        """Intensity over what flat ground of sigma0 = 1 would return: calibrated, noise left in, linear."""
        return np.asarray(self.intensity / self.calibration_w[None, :, None])

    def place_m(self, row: IntArray, column: IntArray) -> tuple[FloatArray, FloatArray]:
        """Centres of pixels on flat ground [m]: across and along the track, or south and east of the antenna."""
        across = self.ground_range_m[row]
        if self.radar.scan == "slar":
            return np.asarray(across), np.asarray((column + 0.5) * self.azimuth_spacing_m)
        bearing = (column + 0.5) * (2.0 * math.pi / self.intensity.shape[2])
        return np.asarray(-across * np.cos(bearing)), np.asarray(across * np.sin(bearing))


def rectangular_pixels(image: RadarImage) -> IntArray:
    """Polar pixels that each pixel of the rectangular picture looks at, at points spread over it.

    int64 (height, width, points): ``row * n_azimuth + column`` of the image of a plan-position indicator; -1 where it
    has none. North up, over the scene's extent, pixels of the radar's resolution.
    """
    rows, cols = (n * image.cell_m for n in image.scene_shape)
    size, radar = image.radar.resolution_m, image.radar
    parts = (np.arange(_POINTS) + 0.5) / _POINTS
    x = (np.arange(math.ceil(cols / size - 1e-9))[:, None] + parts) * size - 0.5 * cols - radar.antenna_east_m
    y = 0.5 * rows - radar.antenna_north_m - (np.arange(math.ceil(rows / size - 1e-9))[:, None] + parts) * size
    east, north = x[None, :, None, :], y[:, None, :, None]
    ground = image.ground_range_m
    edges = np.concatenate(([ground[0]], 0.5 * (ground[1:] + ground[:-1]), [ground[-1]]))
    edges[0] -= (ground[1] - ground[0]) * 0.5 if len(ground) > 1 else 0.5 * size
    edges[-1] += (ground[-1] - ground[-2]) * 0.5 if len(ground) > 1 else 0.5 * size
    row = np.searchsorted(edges, np.hypot(east, north), side="right") - 1
    n_azimuth = image.intensity.shape[2]
    column = np.floor(np.mod(np.arctan2(east, north), 2.0 * math.pi) * (n_azimuth / (2.0 * math.pi))).astype(np.int64)
    pixel = np.where((row >= 0) & (row < len(ground)), row * n_azimuth + np.minimum(column, n_azimuth - 1), -1)
    return np.asarray(pixel.reshape(*pixel.shape[:2], -1), dtype=np.int64)


def rectangular(layer: AnyArray, pixels: IntArray) -> AnyArray:
    """Layers (..., n_range, n_azimuth) turned into (..., height, width) by `rectangular_pixels`: means of the points.

    nan where no point is seen.
    """
    flat = layer.reshape(*layer.shape[:-2], -1)
    seen = pixels >= 0
    total = np.where(seen, flat[..., np.maximum(pixels, 0)], 0.0).sum(axis=-1)
    with np.errstate(invalid="ignore"):
        return np.asarray(total / seen.sum(axis=-1))
