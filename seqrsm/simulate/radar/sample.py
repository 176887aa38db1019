"""Some pixels of a radar's image without the image: the cheaper rungs of the fidelity ladder.

`radar_strips` takes columns of pixels: every range line in them is whole, so that shadow, layover, local incidence and
range are those of the full image, and only the azimuth is sampled. `radar_flat_sample` takes single pixels of flat
ground. Both draw the same occasion as the full image of that run; fading is drawn as often as asked for.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, fields, replace
from functools import lru_cache
from typing import TYPE_CHECKING, Any

import numpy as np

from seqrsm.arrays import AnyArray, BoolArray, FloatArray, IntArray
from seqrsm.rng import generator, stream_key
from seqrsm.scene.scene import Scene
from seqrsm.scene.statistics import aggregated
from seqrsm.sensor.earth import range_geometry
from seqrsm.sensor.radar import CHANNELS, RadarConfiguration
from seqrsm.simulate import kernels_sample
from seqrsm.simulate.fidelity import RungPlan
from seqrsm.simulate.radar import kernels
from seqrsm.simulate.radar.echo import LUT_STEPS, EchoGrid, echo_grid, echo_sums, field_factors, sigma0_lut
from seqrsm.simulate.radar.fading import add_fading
from seqrsm.simulate.radar.frame import RadarFrame, make_frame
from seqrsm.simulate.radar.ground import look_up, met_occasion
from seqrsm.simulate.radar.occasion import Occasion, draw_ground_state
from seqrsm.simulate.radar.psm import refuse_gaussian
from seqrsm.simulate.radar.receiver import received
from seqrsm.simulate.radar.registration import place_cells
from seqrsm.simulate.radar.row_law import RowLaw, row_law
from seqrsm.simulate.sample import Sample, places
from seqrsm.simulate.visits import ONCE

if TYPE_CHECKING:
    from seqrsm.scattering.sigma0 import Sigma0Lookup, Sigma0Table

FLAT_POINTS = 8
"""Points along each side of a flat resolution cell that is wider than so many cells of the data base."""


def meet(
    scene: Scene, radar: RadarConfiguration, table: Sigma0Table, seed: int, run_id: int
) -> tuple[list[Sigma0Lookup], Occasion]:
    """Backscatter of the categories and state of the ground in a run: those of `simulate_radar`."""
    state = draw_ground_state(radar, ONCE, seed=seed, run_id=run_id)
    lookups = look_up(scene, radar, table, state)
    return lookups, met_occasion(scene, radar, table, lookups, state, ONCE, seed=seed, run_id=run_id)


def radar_sample(
    scene: Scene,
    radar: RadarConfiguration,
    lookups: list[Sigma0Lookup],
    occasion: Occasion,
    rung: RungPlan,
    *,
    seed: int,
    run_id: int,
) -> Sample:
    """The pixels that a rung below the top looks at."""
    key = {"seed": seed, "run_id": run_id, "draws": rung.draws}
    if rung.rung == "F0":
        return radar_flat_sample(scene, radar, lookups, occasion, rows=rung.rows, columns=rung.columns, **key)
    columns = None if rung.rung == "F3" else rung.columns
    return radar_strips(scene, radar, lookups, occasion, columns=columns, coarse=rung.coarse, **key)


@lru_cache(maxsize=4)
def coarse_scene(scene: Scene, factor: int) -> Scene:
    """Data base of ``factor`` times wider cells: mean elevation, category and field of the middle cell.

    The category of one cell, not of the majority: over many cells the shares of categories stay what they are.
    """
    rows, cols = (n // factor * factor for n in scene.shape)
    middle = (slice(factor // 2, rows, factor), slice(factor // 2, cols, factor))
    z = np.asarray(aggregated(scene.elevation_m, factor), dtype=np.float32)
    return replace(
        scene,
        elevation_m=z,
        cover=np.ascontiguousarray(scene.cover[middle]),
        field_id=np.ascontiguousarray(scene.field_id[middle]),
        scored=scene.scored[middle] & np.isfinite(z),
        cell_m=scene.cell_m * factor,
        bounds=None,
        # Of no use to a radar's frame; moisture acts by the fields of the scene itself.
        temperature_k=None,
        soil_moisture=None,
    )


def radar_strips(
    scene: Scene,
    radar: RadarConfiguration,
    lookups: list[Sigma0Lookup],
    occasion: Occasion,
    *,
    seed: int,
    run_id: int,
    columns: int | None = None,
    draws: int = 1,
    coarse: int = 1,
) -> Sample:
    """Columns of pixels of an image, each as in the full image but for the place of the pixel grid along the flight.

    Parameters
    ----------
    scene : Scene
    radar : RadarConfiguration
    lookups, occasion
        Of `meet`, for the same run.
    seed, run_id : int
        Key of the columns' places and of the fading.
    columns : int, optional
        How many columns of pixels, in equal steps from a random start; all of them if not given.
    draws : int
        How often fading is drawn.
    coarse : int
        Cells of the data base along the side of one of the coarser data base.

    Returns
    -------
    Sample
    """
    ground = coarse_scene(scene, coarse) if coarse > 1 else scene
    frame = make_frame(ground, radar, "float32")
    grid = echo_grid(frame, radar)
    law = row_law(frame, radar, grid)
    m = int(frame.elevation_m.shape[1])
    per_pixel = radar.pixel_spacing_m / frame.cell_m
    n_pixels = max(math.ceil(m / per_pixel - 1e-9), 1)
    turns = frame.quarter_turns
    scored = np.rot90(ground.scored, turns)
    if columns is None or columns >= n_pixels:
        layout, gathered = None, frame
    else:
        start = float(generator(seed, run_id, "strips").random())
        layout = _layout(places(n_pixels, columns, start), per_pixel, float(law.beam_cells.max()), m)
        take = layout.cells.ravel()
        gathered = replace(
            frame,
            elevation_m=_taken(frame.elevation_m, take),
            cover=_taken(frame.cover, take),
            field=_taken(frame.field, take),
        )
        scored = _taken(scored, take)
    sums = echo_sums(gathered, radar, grid, sigma0_lut(lookups, occasion), field_factors(occasion))
    mean = _pixels(sums, law, per_pixel, n_pixels, layout)
    pixel = _registration(gathered, radar, grid, len(scene.categories), per_pixel, mean.shape[2], layout)
    own = slice(frame.pad_near, frame.pad_near + frame.n_rows)
    rows = slice(int(frame.source[own][0]), int(frame.source[own][-1]) + 1)
    values = faded_draws(mean, law.noise_w, law.looks, law.calibration_w, law.reference_w, radar, seed, run_id, draws)
    column = np.arange(n_pixels) if layout is None else layout.column
    n_columns = mean.shape[2]
    return Sample(
        values=values,
        across_m=np.repeat(law.ground_range_m - law.ground_range_m[0], n_columns),
        along_m=np.tile((column + 0.5) * radar.pixel_spacing_m, grid.n_bins),
        extent_m=(float(np.ptp(law.ground_range_m)), (n_pixels - 0.5) * radar.pixel_spacing_m),
        column=np.tile(np.arange(n_columns), grid.n_bins),
        share=n_columns / n_pixels,
        pixel_of_cell=pixel[own],
        cover=gathered.cover[rows],
        field=gathered.field[rows],
        scored=scored[rows],
        covariates=None,
        moist=None,
        occasion=occasion,
        record=radar_record(radar, scene, law.looks, law.noise_w / law.calibration_w, occasion),
    )


def _taken(layer: AnyArray, columns: IntArray) -> AnyArray:
    """Some columns of a layer of the frame."""
    return np.take(layer, columns, axis=1)


def radar_record(
    radar: RadarConfiguration, scene: Scene, looks: FloatArray, nesz: FloatArray, occasion: Occasion
) -> dict[str, Any]:
    """What is kept with a score of a radar's image: plain numbers and names."""
    noise_db = 10.0 * np.log10(nesz)
    return {
        "engine": "psm",
        "looks": [float(looks.min()), float(looks.max())],
        "noise_equivalent_sigma0_db": [round(float(np.min(noise_db)), 2), round(float(np.max(noise_db)), 2)],
        "occasion": dict(occasion.record(radar.channels, scene.categories)),
    }


@dataclass(frozen=True, slots=True, eq=False)
class _Layout:
    """Cells gathered for each sampled column of pixels: what its beam reaches, and one more for the slope.

    ``column`` (k,): number of the column in the full image; ``cells`` (k, width): cells of the frame; ``weight``
    (k, width): what part of the pixel each cell fills.
    """

    column: IntArray
    cells: IntArray
    weight: FloatArray


def _layout(column: IntArray, per_pixel: float, beam_cells: float, m: int) -> _Layout:
    halo = 1 + (math.ceil(0.5 * beam_cells) if beam_cells > 1.0 else 0)
    low = column * per_pixel
    high = np.minimum(low + per_pixel, float(m))
    cell = np.floor(low + 1e-9).astype(np.int64)[:, None] + np.arange(-halo, math.ceil(per_pixel) + 1 + halo)
    weight = np.maximum(np.minimum(cell + 1.0, high[:, None]) - np.maximum(cell, low[:, None]), 0.0)
    return _Layout(column, np.clip(cell, 0, m - 1), weight / weight.sum(axis=1, keepdims=True))


def _pixels(sums: AnyArray, law: RowLaw, per_pixel: float, n_pixels: int, layout: _Layout | None) -> AnyArray:
    """Mean power (n_channels, n_range, columns) of the sampled columns, or of all."""
    n_channels, n_bins, _ = sums.shape
    if layout is None:
        mean = np.empty((n_channels, n_bins, n_pixels), dtype=sums.dtype)
        kernels.average_azimuth(sums, law.beam_cells, per_pixel, law.factor_w, mean)
    else:
        k, width = layout.cells.shape
        if (law.beam_cells > 1.0).any():
            rows = sums.reshape(n_channels, n_bins * k, width)
            sums = np.empty_like(rows)
            kernels.average_azimuth(rows, np.repeat(law.beam_cells, k), 1.0, np.ones(n_bins * k), sums)
        parts = sums.reshape(n_channels, n_bins, k, width)
        mean = np.einsum("cbkw,kw->cbk", parts, layout.weight.astype(sums.dtype))
        mean *= law.factor_w.astype(sums.dtype)[None, :, None]
    if (law.range_width > 1.0).any():
        kernels.smear_range(mean, law.range_width)
    return mean


def _registration(
    frame: RadarFrame,
    radar: RadarConfiguration,
    grid: EchoGrid,
    n_categories: int,
    per_pixel: float,
    n_columns: int,
    layout: _Layout | None,
) -> AnyArray:
    """Pixel of each gathered cell of the frame; -1 outside the sampled pixels."""
    offset, state = place_cells(frame, grid, n_categories, ground_format=radar.range_format == "ground")
    base = grid.base[1:-1]
    width = per_pixel if layout is None else float(layout.cells.shape[1])
    pixel: AnyArray = kernels.register_cells(offset, base, state, grid.first, grid.n_bins, width, n_columns)
    if layout is not None:
        # Each cell once: those held at the edge of the scene come again.
        first = np.diff(layout.cells, axis=1, prepend=-1) > 0
        own = first & (((layout.cells + 0.5) / per_pixel).astype(np.int64) == layout.column[:, None])
        pixel[:, ~own.ravel()] = -1
    return pixel


def faded_draws(
    mean: AnyArray,
    noise: FloatArray,
    looks: FloatArray,
    calibration: FloatArray,
    reference_w: float,
    radar: RadarConfiguration,
    seed: int,
    run_id: int,
    draws: int,
) -> FloatArray:
    """Apparent sigma0 (n_draws, n_channels, n_pixels) with the receiver's noise and as many draws of fading.

    Neighbouring pixels fade independently: a utility that is a mean over pixels sees no difference.
    """
    refuse_gaussian(radar, looks)
    n_channels, n_range, n_columns = mean.shape
    numbers = np.array([CHANNELS.index(channel) for channel in radar.channels])
    out = np.empty((draws, n_channels, n_range * n_columns))
    power = np.empty_like(mean)
    for k in range(draws):
        if radar.fading == "none":
            power = mean + noise.astype(mean.dtype)[None, :, None]
        else:
            key = stream_key(seed, run_id, f"speckle of draw {k}")
            add_fading(mean, noise, looks, numbers, key, power, gaussian=radar.fading == "gaussian")
        shown = received(power, radar, reference_w) / calibration[None, :, None]
        out[k] = shown.reshape(n_channels, -1)
    return out


def radar_flat_sample(
    scene: Scene,
    radar: RadarConfiguration,
    lookups: list[Sigma0Lookup],
    occasion: Occasion,
    *,
    seed: int,
    run_id: int,
    rows: int,
    columns: int,
    draws: int = 1,
) -> Sample:
    """Single pixels of ground taken as flat: no image, no relief.

    Each pixel is the mean over the cells of the data base in it, or over `FLAT_POINTS` points a side where they are
    many, of sigma0 at the incidence of flat ground in the cell's row.

    Parameters
    ----------
    scene, radar, lookups, occasion, seed, run_id, draws
        As in `radar_strips`; ground range format, no azimuth average but the pixel's own.
    rows, columns : int
        Image rows and columns, each in equal steps; a pixel is taken where they cross.

    Returns
    -------
    Sample
    """
    frame = make_frame(scene, radar, "float32")
    per_pixel = radar.pixel_spacing_m / frame.cell_m
    m, n = int(frame.elevation_m.shape[1]), frame.n_rows
    n_bins, n_pixels = (max(math.ceil(size / per_pixel - 1e-9), 1) for size in (n, m))
    start = generator(seed, run_id, "strips").random(2)
    column, row = places(n_pixels, columns, float(start[0])), places(n_bins, rows, float(start[1]))
    law = _flat_law(frame, radar, row)
    across, weight_across, inside_across = _points(row * per_pixel, per_pixel, law.range_width, n)
    along, weight_along, inside_along = _points(column * per_pixel, per_pixel, np.ones(len(column)), m)
    first = int(frame.source[frame.pad_near])
    size = (across.size, along.size)
    cover, field = np.empty(size, dtype=frame.cover.dtype), np.empty(size, dtype=frame.field.dtype)
    pixel, mean = np.empty(size, dtype=np.int32), np.empty((len(lookups), len(row), len(column)))
    kernels_sample.flat_pixels(
        frame.cover,
        frame.field,
        across + first,
        along,
        weight_across,
        weight_along,
        inside_across,
        inside_along,
        _flat_curves(frame, lookups, occasion, across),
        field_factors(occasion),
        cover,
        field,
        pixel,
        mean,
    )
    nesz = law.noise_w / law.calibration_w
    values = faded_draws(mean, nesz, law.looks, np.ones(len(row)), law.reference_w, radar, seed, run_id, draws)
    k = len(column)
    return Sample(
        values=values,
        across_m=np.repeat(row * radar.pixel_spacing_m, k),
        along_m=np.tile((column + 0.5) * radar.pixel_spacing_m, len(row)),
        extent_m=((n_bins - 1) * radar.pixel_spacing_m, (n_pixels - 0.5) * radar.pixel_spacing_m),
        column=np.arange(k * len(row)),
        share=len(row) * k / (n_bins * n_pixels),
        pixel_of_cell=pixel,
        cover=cover,
        field=field,
        scored=_taken(np.rot90(scene.scored, frame.quarter_turns)[(across + first).ravel()], along.ravel()),
        covariates=None,
        moist=None,
        occasion=occasion,
        record=radar_record(radar, scene, law.looks, nesz, occasion),
    )


def _flat_law(frame: RadarFrame, radar: RadarConfiguration, row: IntArray) -> RowLaw:
    """`row_law` of some rows of an image of flat ground."""
    flat = replace(frame, lowest_m=np.zeros_like(frame.lowest_m), highest_m=np.zeros_like(frame.highest_m))
    law = row_law(flat, radar, echo_grid(flat, radar))
    row = np.minimum(row, len(law.looks) - 1)
    rows = {one.name: getattr(law, one.name)[row] for one in fields(law) if one.name != "reference_w"}
    return RowLaw(**rows, reference_w=1.0)


def _points(low: AnyArray, size: float, width: FloatArray, n: int) -> tuple[IntArray, FloatArray, BoolArray]:
    """Cells under each pixel along one axis, what part of the pixel each fills, and whether its centre lies in it.

    ``low``: lower edge of the pixel [cells]; the range response may be ``width`` pixels wide about its middle.
    """
    reach = np.maximum(width, 1.0) * size
    begin = low + 0.5 * size - 0.5 * reach
    count = math.floor(float(reach.max())) + 2
    if count <= FLAT_POINTS:
        cell = np.floor(begin[:, None] + 1e-9).astype(np.int64) + np.arange(count)
        weight = np.minimum(cell + 1.0, (begin + reach)[:, None]) - np.maximum(cell, begin[:, None])
        weight = np.maximum(weight, 0.0)
        middle = cell + 0.5
    else:
        middle = begin[:, None] + (np.arange(FLAT_POINTS) + 0.5) * (reach[:, None] / FLAT_POINTS)
        cell = np.floor(middle).astype(np.int64)
        weight = np.ones_like(middle)
    known = (cell >= 0) & (cell < n)
    weight = np.where(known, weight, 0.0)
    inside = known & (middle >= low[:, None]) & (middle < low[:, None] + size)
    total = weight.sum(axis=1, keepdims=True)
    return np.clip(cell, 0, n - 1), weight / np.where(total > 0.0, total, 1.0), inside


def _flat_curves(frame: RadarFrame, lookups: list[Sigma0Lookup], occasion: Occasion, rows: IntArray) -> FloatArray:
    """sigma0 of each category (n_channels, n_categories + 1, a, p) at the incidence of flat ground; 0 for none."""
    near = frame.ground_range_m[frame.pad_near]
    theta = range_geometry(near + rows.ravel() * frame.cell_m, frame.height_m, frame.curved).incidence_rad
    place = np.sin(0.5 * theta) * (LUT_STEPS / math.sqrt(0.5))
    step = np.minimum(place.astype(np.int64), LUT_STEPS - 1)
    part = place - step
    lut = sigma0_lut(lookups, occasion)
    curve = lut[:, :, step] * (1.0 - part) + lut[:, :, step + 1] * part
    return np.concatenate([curve, np.zeros_like(curve[:, :1])], axis=1).reshape(*lut.shape[:1], -1, *rows.shape)
