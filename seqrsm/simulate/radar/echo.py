"""Phase one of the Point Scattering Model: what every element of the data base returns, the report's program POWER.

`echo_sums` collects the elements into range bins as it goes, in strips of columns that threads share, and keeps nothing
else. Where each cell of the scene falls in the image, and what becomes of it, is worked out when it is asked for.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cache
from typing import Any, Final

import numpy as np

from seqrsm.arrays import AnyArray, BoolArray, FloatArray, IntArray
from seqrsm.scattering.curves import THETA_DEG, whole_degrees
from seqrsm.scattering.sigma0 import Sigma0Lookup
from seqrsm.scene.scene import Scene
from seqrsm.sensor.earth import range_geometry
from seqrsm.sensor.radar import RadarConfiguration
from seqrsm.simulate.radar import kernels
from seqrsm.simulate.radar.frame import RadarFrame, to_scene
from seqrsm.simulate.radar.occasion import Occasion
from seqrsm.simulate.runner import do_all
from seqrsm.units import LN10_OVER_10, db_to_linear

LUT_STEPS: Final = 1024
"""Steps of the table of sigma0 in sin(theta/2): 0.08 to 0.11 deg each, with straight lines between: 0.0001 dB where
sigma0 falls by 0.5 dB a degree."""


def block(k: int, n_rows: int, parts: int) -> tuple[slice, slice]:
    """Channel and rows of the k-th piece of work on ``parts`` pieces a channel: contiguous in memory."""
    channel, part = divmod(k, parts)
    return slice(channel, channel + 1), slice(part * n_rows // parts, (part + 1) * n_rows // parts)


@dataclass(frozen=True, slots=True, eq=False)
class EchoGrid:
    """A frame, and the numbers of each of its rows that the kernels work with."""

    frame: RadarFrame

    geometry: FloatArray
    """(n, 10): see `kernels.sum_echoes`."""
    rows: FloatArray
    """(n, 14): from it, for loops in single precision: distances are in slant ranges of the datum, so that powers of
    them stay within it."""
    base: FloatArray
    """(n + 2,): range position of flat ground in each row from the near edge of the swath [bins], one row more at both
    ends."""
    first: int
    n_bins: int
    """First range bin that ground of the swath reaches, and the number of bins."""
    reference_range_m: float
    """Slant range of flat ground at the centre of the scene [m]."""
    cells_a_pixel: float
    n_azimuth: int
    """Azimuth cells in a pixel, and columns of pixels."""


def sigma0_lut(lookups: Sequence[Sigma0Lookup], occasion: Occasion) -> FloatArray:
    """Table of sigma0 (n_channels, n_categories, LUT_STEPS + 2) on equal steps of sin(theta/2) from 0 to 90 deg.

    sin(theta/2) is smooth in the angle and needs no inverse function in the kernel. Between the table's angles sigma0
    is linear in decibels, or in power where it falls to zero, as in the last degree before 90 deg. There is a lookup
    for each channel; the occasion's class offsets are applied.
    """
    out = np.empty((len(lookups), lookups[0].sigma0.shape[0], LUT_STEPS + 2))
    k, part = _steps_between()
    for c, lookup in enumerate(lookups):
        sigma0, offset_db = lookup.sigma0, occasion.class_offset_db[c][:, None]
        with np.errstate(divide="ignore", invalid="ignore"):
            level = np.log(sigma0) + LN10_OVER_10 * offset_db
            low = level[:, k]
            np.exp(part * (level[:, k + 1] - low) + low, out=out[c])
        last = k == THETA_DEG.size - 2
        low, high = sigma0[:, -2:-1], sigma0[:, -1:]
        out[c][:, last] = (low + part[last] * (high - low)) * db_to_linear(offset_db)
        if not (sigma0 > 0.0).all():
            low, high = sigma0[:, k], sigma0[:, k + 1]
            straight = (low + part * (high - low)) * db_to_linear(offset_db)
            out[c] = np.where((low > 0.0) & (high > 0.0), out[c], straight)
    return out


@cache
def _steps_between() -> tuple[IntArray, FloatArray]:
    """For each step of the table of sigma0: the angle of `THETA_DEG` at or before it, and the part of the way on."""
    q = np.minimum(np.arange(LUT_STEPS + 2) / LUT_STEPS, 1.0) * math.sqrt(0.5)
    return whole_degrees(np.rad2deg(2.0 * np.arcsin(q)))


def field_factors(occasion: Occasion) -> FloatArray:
    """Factor of each field's sigma0 (n_channels, n_fields); (n_channels, 0) where all are 1, which costs nothing."""
    if not occasion.field_offset_db.any():
        return np.empty((len(occasion.field_offset_db), 0))
    return db_to_linear(occasion.field_offset_db)


def echo_grid(frame: RadarFrame, radar: RadarConfiguration) -> EchoGrid:
    """Row numbers of a frame for one radar."""
    cell, y = frame.cell_m, frame.ground_range_m
    n = len(y)
    # The rows, one more at both ends, the near edge of the swath and the centre of the scene.
    places = np.empty(n + 4)
    places[1:-3] = y
    places[0], places[-3], places[-2], places[-1] = y[0] - cell, y[-1] + cell, frame.near_edge_m, frame.centre_m
    ground = range_geometry(places, frame.height_m, frame.curved)
    slant, up = ground.slant_range_m, ground.up_m
    reference = float(slant[-1])
    own, around = slice(1, n + 1), slice(0, n + 2)
    ground_format = radar.range_format == "ground"
    geometry = np.empty((n, 10))
    geometry[:, 0] = ground.along_m[own]
    geometry[:, 1] = slant[own]
    geometry[0, 2] = 0.0
    np.divide(cell, ground.along_m[1:n], out=geometry[1:, 2])
    np.square(np.square(reference / slant[own]), out=geometry[:, 3])
    if radar.zenith_loss_db:
        geometry[:, 3] *= radar.atmosphere(ground.incidence_rad[own])
    geometry[:, 9] = cell
    if frame.column_m is not None:
        geometry[:, 9] = frame.column_m
        # The area of an element over that of a square cell.
        geometry[:, 3] *= geometry[:, 9] / cell
    geometry[:, 4] = up[own]
    geometry[:, 5] = up[:n]
    if ground_format:
        base = (places[around] - frame.near_edge_m) / radar.range_spacing_m
        geometry[:, 6] = ground.chord_m[own]
        np.divide(1.0, radar.range_spacing_m * ground.chord_per_m[own], out=geometry[:, 7])
    else:
        base = (slant[around] - slant[-2]) / radar.range_spacing_m
        geometry[:, 6] = slant[own]
        geometry[:, 7] = 1.0 / radar.range_spacing_m
    np.tan(0.5 * ground.turn_rad[own], out=geometry[:, 8])
    first, last = _reach(frame, geometry, base[own], ground_format)
    # A position that rounds onto the far edge belongs to the last bin inside it.
    rows = _row_numbers(geometry, cell, ground_format)
    n_bins, cells_a_pixel = max(last - first + 1, 1), float(frame.wrapped) or radar.pixel_spacing_m / cell
    n_azimuth = max(math.ceil(frame.elevation_m.shape[1] / cells_a_pixel - 1e-9), 1)
    return EchoGrid(frame, geometry, rows, base, first, n_bins, reference, cells_a_pixel, n_azimuth)


def _row_numbers(geometry: FloatArray, cell: float, ground_format: bool) -> FloatArray:
    """`EchoGrid.rows`."""
    n = len(geometry)
    before, after = np.maximum(np.arange(n) - 1, 0), np.minimum(np.arange(n) + 1, n - 1)
    y, slant, descent, gain, h, h_before, place, per_metre, *_ = geometry.T
    place, per_metre = place[after], per_metre[after]
    per_span = np.divide(1.0, cell * (after - before), out=np.zeros(n), where=after > before)
    nadir = -place * per_metre if ground_format else np.full(n, -math.inf)
    own = per_span, y / slant, h / slant, 1.0 / slant, 2.0 * h, 1.0 / slant**2, descent, h_before, gain
    behind = 2.0 * h[after], 1.0 / place**2, per_metre / place, nadir, np.arange(n) < n - 1
    return np.column_stack(own + behind)


def _reach(frame: RadarFrame, geometry: FloatArray, base: FloatArray, ground_format: bool) -> tuple[int, int]:
    """First and last range bin that elements of the swath reach."""
    own = slice(frame.pad_near, frame.pad_near + frame.n_rows)
    # Range falls with height, so the extremes of each row tell.
    ends = np.stack([frame.lowest_m, frame.highest_m], axis=1)[frame.source[own]]
    reached = base[own, None] + range_offset(ends, geometry[own], ground_format)
    return math.floor(reached.min()), math.floor(reached.max())


def range_offset(z: AnyArray, geometry: FloatArray, ground_format: bool) -> AnyArray:
    """Range position minus that of the datum [bins] of heights in some rows, as the kernels find it.

    Heights (n, k) are over the datum [m], ``geometry`` (n, 10) is of `EchoGrid`; the position is ground or slant range.
    """
    up, place, per_metre = geometry[:, 4:5], geometry[:, 6:7], geometry[:, 7:8]
    numbers = (2.0 * up, 1.0 / place**2, per_metre / place, -place * per_metre)
    twice_h, per_place2, to_bins, nadir = (x.astype(z.dtype) for x in numbers)
    rise = z * (z - twice_h)
    offset = rise * to_bins / (1.0 + np.sqrt(np.maximum(1.0 + rise * per_place2, 0.0)))
    return np.asarray(np.maximum(offset, nadir) if ground_format else offset)


def paired_table(lut: FloatArray, dtype: np.dtype[Any]) -> AnyArray:
    """Table of sigma0 as `kernels.sum_echoes` wants it, the category of no data appended."""
    pairs = np.zeros((lut.shape[0], lut.shape[1] + 1, lut.shape[2] - 1, 2), dtype=dtype)
    pairs[:, :-1, :, 0] = lut[:, :, :-1]
    pairs[:, :-1, :, 1] = np.diff(lut)
    return pairs.view(np.result_type(dtype, np.complex64)).reshape(lut.shape[0], -1)


def echo_sums(
    radar: RadarConfiguration, grid: EchoGrid, lut: FloatArray, field_factor: FloatArray, threads: int = 1
) -> AnyArray:
    """Power of every range bin and column, summed over the elements in it: float (n_channels, n_bins, m).

    sigma0 x surface area / cell area x (reference range / range)**4 x antenna pattern x atmosphere, both two-way and
    relative to their best. The table ``lut`` is of `sigma0_lut`, ``field_factor`` (n_channels, n_fields) of
    `field_factors`. Threads share the columns; the bits do not depend on their number.
    """
    dtype = grid.frame.elevation_m.dtype
    m = grid.frame.elevation_m.shape[1]
    out = np.zeros((lut.shape[0], grid.n_bins, m), dtype=dtype)
    factor = field_factor.astype(dtype, order="C")  # in another order the kernel would be compiled once more
    found = paired_table(lut, dtype), lut.shape[1], factor, radar.pattern_lut().astype(dtype)
    dark = np.empty((0, 0), dtype=np.uint8)
    parts = min(threads, m)
    edges = [k * m // parts for k in range(parts + 1)]

    def do(k: int) -> None:
        _sum_echoes(radar, grid, found, (edges[k], edges[k + 1]), out, dark)

    do_all(do, len(edges) - 1, threads)
    return out


def _sum_echoes(
    radar: RadarConfiguration,
    grid: EchoGrid,
    tables: tuple[AnyArray, int, AnyArray, AnyArray],
    columns: tuple[int, int],
    out: AnyArray,
    dark: AnyArray,
) -> None:
    """Some columns of a frame by the kernel; ``tables``: sigma0, its categories, factors of fields, antenna pattern."""
    frame = grid.frame
    layers = frame.elevation_m, frame.top_m, frame.source, frame.cover, frame.field
    offset = range_offset(frame.elevation_m[frame.source[:1]], grid.geometry[:1], radar.range_format == "ground")[0]
    ranges = grid.geometry, grid.rows.astype(frame.elevation_m.dtype), offset
    sigma0, n_categories, factor, pattern = tables
    lines = kernels.work_lines(frame.elevation_m, sigma0)
    kernels.sum_echoes(
        *layers, *ranges, sigma0, n_categories, factor, pattern, grid.base, grid.first, *columns, out, dark, *lines
    )


def pixels_of_cells(scene: Scene, radar: RadarConfiguration, grid: EchoGrid) -> AnyArray:
    """Pixel (rows, cols) of each cell of a scene, by its own elevation alone: nothing else need be known of the echo.

    Row by row of the image; -1 without data or outside the image.
    """
    frame = grid.frame
    own = slice(frame.pad_near, frame.pad_near + frame.n_rows)
    first = int(frame.source[frame.pad_near])
    rows = slice(first, first + frame.n_rows)
    pixel = np.full(frame.elevation_m.shape, -1, dtype=np.int32)
    m = frame.elevation_m.shape[1]
    column = np.minimum((np.arange(m) + 0.5) / grid.cells_a_pixel, grid.n_azimuth - 1).astype(np.int32)
    kernels.register_cells(
        frame.elevation_m[rows],
        frame.cover[rows],
        len(scene.categories),
        grid.geometry[own],
        grid.base[1:-1][own],
        radar.range_format == "ground",
        grid.first,
        np.int32(grid.n_bins),
        np.int32(grid.n_azimuth),
        column,
        np.empty(m, dtype=frame.elevation_m.dtype),
        pixel[rows],
    )
    pixel = to_scene(pixel, frame, scene.shape, -1)
    if frame.wrapped:  # the frame's columns of a plan-position indicator repeat a pixel's worth at either end
        row, column = np.divmod(pixel, grid.n_azimuth)
        pixel = np.where(pixel < 0, pixel, row * (grid.n_azimuth - 2) + column - 1)
    return pixel


def shadow_of_cells(scene: Scene, radar: RadarConfiguration, grid: EchoGrid) -> BoolArray:
    """Whether each cell of a scene returns nothing for geometry, (rows, cols)."""
    frame = grid.frame
    dtype, m = frame.elevation_m.dtype, frame.elevation_m.shape[1]
    dark = np.empty((len(frame.source), m), dtype=np.uint8)
    sigma0 = np.empty((0, 2), dtype=np.result_type(dtype, np.complex64))
    tables = sigma0, 0, np.empty((0, 0), dtype=dtype), np.empty(0, dtype=dtype)
    _sum_echoes(radar, grid, tables, (0, m), np.empty((0, grid.n_bins, m), dtype=dtype), dark)
    return _of_scene(dark != 0, frame, scene)


def layover_of_cells(scene: Scene, radar: RadarConfiguration, grid: EchoGrid) -> BoolArray:
    """Whether the echo of each cell of a scene is mixed with other ground in range, (rows, cols)."""
    frame, ground_format = grid.frame, radar.range_format == "ground"
    offset = np.empty((len(frame.source), frame.elevation_m.shape[1]), dtype=frame.elevation_m.dtype)
    for i, row in enumerate(frame.source):
        offset[i] = range_offset(frame.elevation_m[row : row + 1], grid.geometry[i : i + 1], ground_format)
    return _of_scene(out_of_order(offset, grid.base[1:-1]), frame, scene)


def out_of_order(offset: AnyArray, base: FloatArray) -> BoolArray:
    """Where the order of ranges differs from the order on the ground, (n, m): two sweeps, no sort.

    ``offset`` (n, m): range position minus that of the datum of the row, ``base`` (n,) [bins].
    """

    def passed(offset: AnyArray, base: FloatArray, sign: float) -> BoolArray:
        found, far = np.zeros(offset.shape, dtype=np.bool_), sign * offset[0]
        for i, step in enumerate(np.diff(sign * base).astype(offset.dtype), start=1):
            reach, here = far - step, sign * offset[i]
            found[i] = here <= reach
            far = np.maximum(reach, here)
        return found

    return passed(offset, base, 1.0) | passed(offset[::-1], base[::-1], -1.0)[::-1]


def _of_scene(layer: BoolArray, frame: RadarFrame, scene: Scene) -> BoolArray:
    """Rows of a frame (n, m) as `to_scene` has them; False beyond the swath."""
    whole = np.zeros(frame.elevation_m.shape, dtype=np.bool_)
    first = int(frame.source[frame.pad_near])
    whole[first : first + frame.n_rows] = layer[frame.pad_near : frame.pad_near + frame.n_rows]
    return to_scene(whole, frame, scene.shape, 0)
