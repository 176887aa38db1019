"""Point Scattering Model of a side-looking radar: RSL TR 380-1 chapter 3.2, in the report's two phases.

Phase one (`seqrsm.simulate.radar.echo`, the report's POWER) finds for every data-base element whether it is lit, its
local incidence, area and slant range, and from them the mean power it returns, collected into range bins. Phase two
here (the report's GREY TONE without the film, which is `seqrsm.simulate.radar.receiver`) forms the beam and the pixels,
and adds the receiver's noise, fading and transfer function.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import cache, partial
from typing import Final

import numpy as np

from seqrsm.arrays import AnyArray, FloatArray, Precision
from seqrsm.constants import EARTH_RADIUS_M
from seqrsm.remember import cached_by_thread
from seqrsm.rng import stream_key
from seqrsm.scattering.sigma0 import Sigma0Lookup, Sigma0Table
from seqrsm.scene.scene import Scene
from seqrsm.sensor.earth import ground_range_of_slant, range_geometry
from seqrsm.sensor.radar import LAYERS, PHASE, RadarConfiguration
from seqrsm.simulate.radar import kernels, kernels_speckle
from seqrsm.simulate.radar.echo import (
    EchoGrid,
    block,
    echo_grid,
    echo_sums,
    field_factors,
    layover_of_cells,
    pixels_of_cells,
    shadow_of_cells,
    sigma0_lut,
)
from seqrsm.simulate.radar.fading import correlated_fading, fade_together, gamma_tables, normal_table, spread_over_cells
from seqrsm.simulate.radar.frame import RadarFrame, make_frame
from seqrsm.simulate.radar.occasion import Occasion, draw_ground_state, look_up, met_occasion, nominal_ground_state
from seqrsm.simulate.radar.receiver import converter_noise, received
from seqrsm.simulate.radar.result import RadarImage
from seqrsm.simulate.radar.targets import CulturalTarget, add_targets
from seqrsm.simulate.runner import do_all
from seqrsm.simulate.visits import ONCE, Visit
from seqrsm.units import linear_to_db

TOO_WEAK: Final = "the echo is weaker than the receiver's noise"
SATURATED: Final = "the receiver is saturated"


def simulate_radar(
    scene: Scene,
    radar: RadarConfiguration,
    table: Sigma0Table,
    *,
    seed: int,
    run_id: int,
    precision: Precision = "float32",
    threads: int = 1,
    targets: Sequence[CulturalTarget] = (),
    visit: Visit = ONCE,
) -> RadarImage:
    """Image of a scene by a radar on one occasion.

    The image is a function of the arguments but ``threads``, which share the columns of a large scene: the same seed
    and run id, of campaign and run, key the same occasion and fading in any process. Single precision is for use,
    double for reference; see the tests for how far they differ (a median of some 1e-7 of a pixel's power). ``targets``
    stand on top of the scene's cover; ``visit`` is which of a run's images this is.

    Raises
    ------
    ConfigurationError
        The radar cannot look at this scene from its flight line.
    ScatteringDataError
        The table lacks a category, frequency or channel.
    SceneError
        No cell has an elevation, or a target lies outside the scene.
    """
    grid, *of_cells = _geometry(scene, radar, precision)
    key = {"seed": seed, "run_id": run_id}
    state = draw_ground_state(radar, visit, **key)
    lookups = look_up(scene, radar, table, state, visit.day)
    occasion = met_occasion(scene, radar, table, lookups, state, visit, **key)
    sums = echo_sums(radar, grid, sigma0_lut(lookups, occasion), field_factors(occasion), threads)
    if targets:
        add_targets(sums, targets, scene.shape, radar, grid)
    notes = tuple(dict.fromkeys(note for lookup in lookups for note in lookup.notes))
    speckle = stream_key(seed, run_id, visit.purpose("speckle"))
    image = _form_image(sums, scene, radar, grid, of_cells, occasion, speckle, notes, threads)
    return replace(image, table=table, day=visit.day)


def expected_image(scene: Scene, radar: RadarConfiguration, table: Sigma0Table, day: float | None) -> RadarImage:
    """Image without fading of ground that is as the table has it on a day of the year, in the middle of its states.

    What maps of covers and elevations tell of an image beforehand: cultural targets are not on them.
    """
    grid, *of_cells = _geometry(scene, radar, "float32")
    state = nominal_ground_state(radar)
    lookups = look_up(scene, radar, table, state, day)
    nothing = np.zeros((len(lookups), len(scene.categories)))
    occasion = Occasion(*state, nothing, nothing[:, :0])
    sums = echo_sums(radar, grid, sigma0_lut(lookups, occasion), field_factors(occasion))
    still, unused = replace(radar, fading="none"), (np.uint32(0), np.uint32(0))
    return _form_image(sums, scene, still, grid, of_cells, occasion, unused, (), 1)


@cached_by_thread  # occasions of one setting, and dates of one sensor, share it
def _geometry(
    scene: Scene, radar: RadarConfiguration, precision: Precision
) -> tuple[EchoGrid, *tuple[Callable[[], AnyArray], ...]]:
    """Grid of a radar over a scene; pixels, shadow and layover of the scene's cells for when they are asked for."""
    grid = echo_grid(make_frame(scene, radar, precision), radar)
    asked = (cache(partial(of, scene, radar, grid)) for of in (pixels_of_cells, shadow_of_cells, layover_of_cells))
    return grid, *asked


def _form_image(
    sums: AnyArray,
    scene: Scene,
    radar: RadarConfiguration,
    grid: EchoGrid,
    of_cells: Sequence[Callable[[], AnyArray]],
    occasion: Occasion,
    speckle: tuple[np.uint32, np.uint32],
    notes: tuple[str, ...],
    threads: int,
) -> RadarImage:
    """Phase two: resolution cells, receiver noise, fading and receiver."""
    frame, n = grid.frame, grid.n_bins
    # The last entry is the centre of the swath.
    flat = range_geometry(_places(radar, grid), frame.height_m, frame.curved)
    incidence = flat.incidence_rad
    calibration = radar.received_power_w(incidence, flat.slant_range_m, incidence - flat.turn_rad)
    slant, theta, ground_range = flat.slant_range_m[:n], incidence[:n], flat.ground_range_m[:n]
    looks, noise = radar.looks_used(theta), radar.noise_power_w(slant)
    mean, smeared = _mean_power(sums, radar, grid, (slant, theta, ground_range), threads)
    lit, rounded = mean, np.zeros(0)
    if radar.adc_bits:
        rounded = converter_noise(mean, noise, calibration[:n], radar)
        lit = np.asarray(mean + rounded[:, None, None] * calibration[:n, None], dtype=mean.dtype)
    power = _faded(lit, noise, looks, radar, speckle, threads)
    return RadarImage(
        intensity=received(power, radar, float(calibration[n])),
        mean_power=mean,
        noise_power_w=noise,
        looks=looks,
        calibration_w=calibration[:n],
        noise_equivalent_sigma0=noise / calibration[:n],
        slant_range_m=slant,
        ground_range_m=ground_range,
        incidence_angle_deg=np.rad2deg(theta),
        range_spacing_m=radar.range_spacing_m,
        azimuth_spacing_m=radar.pixel_spacing_m,
        registration=of_cells[0],
        in_shadow=of_cells[1],
        laid_over=of_cells[2],
        radar=radar,
        occasion=occasion,
        quarter_turns=frame.quarter_turns,
        cell_m=frame.cell_m,
        scene_shape=scene.shape,
        notes=(*notes, *_engine_notes(radar, looks, smeared, frame), *_converter_notes(radar, rounded)),
    )


def _places(radar: RadarConfiguration, grid: EchoGrid) -> FloatArray:
    """Ground range of the middle of every image row on flat ground, and of the centre of the swath [m]."""
    frame, out = grid.frame, np.empty(grid.n_bins + 1)
    position = (grid.first + 0.5 + np.arange(grid.n_bins)) * radar.range_spacing_m
    if radar.range_format == "ground":
        ground = frame.near_edge_m + position
    else:
        edge = range_geometry(np.array([frame.near_edge_m]), frame.height_m, frame.curved)
        ground = ground_range_of_slant(edge.slant_range_m[0] + position, frame.height_m, frame.curved)
    # Rows before the nadir echo exist only where terrain is displaced there; they take the angle of the innermost cell.
    np.maximum(ground, 0.5 * min(frame.cell_m, frame.near_edge_m), out=out[:-1])
    out[-1] = frame.centre_m
    return out


def _mean_power(
    sums: AnyArray,
    radar: RadarConfiguration,
    grid: EchoGrid,
    flat: tuple[FloatArray, FloatArray, FloatArray],
    threads: int,
) -> tuple[AnyArray, int]:
    """Mean power of the ground in each pixel [W], and how many rows are finer than the range response.

    ``flat``: slant range [m], incidence [rad] and ground range [m] of flat ground in each row.
    """
    slant, theta, ground_range = flat
    frame, n = grid.frame, grid.n_bins
    across, along = np.asarray(radar.ground_resolution_m(theta)), radar.azimuth_resolution_m(slant)
    # Ground range of one bin on flat ground, so that the sum over a bin becomes that of one single-look cell.
    bin_ground = radar.range_spacing_m / (1.0 if radar.range_format == "ground" else np.sin(theta))
    constant = radar.radar_constant_w_m2() / grid.reference_range_m**4
    beam = np.full(n, radar.resolution_m if radar.finer_pixels else 0.0)
    if radar.aperture == "real":
        beam = np.maximum(beam, along)
    # Power of a resolution cell over a bin's sum [W]; width of the azimuth average before pixels are taken [cells].
    factor, beam = constant * (across * along) * frame.cell_m / bin_ground, beam / frame.cell_m
    if frame.column_m is not None:
        # Columns of one angle: a beam is as many of them on every ring.
        column_m = ground_range * (frame.column_m[-1] / frame.ground_range_m[-1])
        factor *= frame.cell_m / column_m
        beam = np.full(n, radar.azimuth_beamwidth_rad * frame.ground_range_m[-1] / frame.column_m[-1])
    width = (np.maximum(across, radar.resolution_m) if radar.finer_pixels else across) / bin_ground
    mean = np.empty((sums.shape[0], n, grid.n_azimuth), dtype=sums.dtype)
    is_box = radar.cell_shape == "box"
    boxed = beam if is_box else np.zeros(n)

    def average(k: int) -> None:
        c, rows = block(k, n, threads)
        lines = np.empty(sums.shape[2] + 1), np.empty(sums.shape[2])
        kernels.average_azimuth(sums[c, rows], boxed[rows], grid.cells_a_pixel, factor[rows], mean[c, rows], *lines)

    do_all(average, threads * len(mean), threads)
    if frame.wrapped:
        mean = np.ascontiguousarray(mean[:, :, 1:-1])
    smeared = int((width > 1.0).sum())
    if not is_box:
        mean = spread_over_cells(mean, radar.cell_shape, width, beam / grid.cells_a_pixel)
    elif smeared:
        for plane in mean:
            _smear_range(plane, width)
    return mean, smeared


def _smear_range(plane: AnyArray, width: FloatArray) -> None:
    """Average a plane (n_bins, n_pixels) in place over the range response where it is wider than a bin.

    So it is in near range and with a shallow bandwidth. ``width`` (n_bins,) is that of the range response [bins]; rows
    with 1 or less are left alone.
    """
    rows = np.flatnonzero(width > 1.0)
    low = np.maximum(rows + 0.5 - 0.5 * width[rows], 0.0)
    high = np.minimum(rows + 0.5 + 0.5 * width[rows], len(plane))
    last = min(int(high.max()), len(plane) - 1)
    total = np.zeros((last + 2, plane.shape[1]))
    np.cumsum(plane[: last + 1], axis=0, dtype=np.float64, out=total[1:])

    def integral(x: FloatArray) -> FloatArray:
        k = np.minimum(x.astype(np.int64), last)
        return np.asarray(total[k] + (x - k)[:, None] * (total[k + 1] - total[k]))

    plane[rows] = (integral(high) - integral(low)) / (high - low)[:, None]


def _faded(
    mean: AnyArray,
    noise: FloatArray,
    looks: FloatArray,
    radar: RadarConfiguration,
    key: tuple[np.uint32, np.uint32],
    threads: int,
) -> AnyArray:
    """Power with noise and fading, in the type of ``mean``.

    Two channels whose phase is known fade by the complex Wishart law of real N, as they are related in each pixel.
    """
    if radar.fading == "none":
        return np.asarray(mean + noise[None, :, None], dtype=mean.dtype)
    if PHASE not in radar.channels:
        return _faded_alone(mean, noise, looks, radar.layers, radar, key, threads)
    n = len(radar.recorded)
    out = np.empty_like(mean)
    out[:n] = _faded_alone(mean[:n], noise, looks, radar.layers[:n], radar, key, threads)
    alone = np.ones_like(mean[n:]), np.zeros_like(noise), np.ones_like(looks), radar.layers[n:]
    free = _faded_alone(*alone, radar, key, threads)
    one, other = (radar.layers.index(channel) for channel in radar.pair)
    fade_together(mean[one], mean[other], mean[n:], noise, looks, free, out[one], out[other], out[n:])
    return out


def _faded_alone(
    mean: AnyArray,
    noise: FloatArray,
    looks: FloatArray,
    layers: Sequence[str],
    radar: RadarConfiguration,
    key: tuple[np.uint32, np.uint32],
    threads: int,
) -> AnyArray:
    """Power with noise and fading of layers that have nothing to do with each other."""
    numbers = np.array([LAYERS.index(layer) for layer in layers])
    if radar.finer_pixels:
        pixels = radar.resolution_m / radar.pixel_spacing_m  # of equal slant range those at the centre
        factor = correlated_fading(mean.shape, looks, numbers, key, (pixels, pixels), radar.cell_shape)
        return np.asarray((mean + noise[None, :, None]) * factor, dtype=mean.dtype)
    out = np.empty_like(mean)

    def fade(k: int) -> None:
        c, rows = block(k, mean.shape[1], threads)
        (tables, which), spread = gamma_tables(looks[rows]), 1.0 / np.sqrt(looks[rows])
        own = tables, which, spread, numbers[c], normal_table(), *key, rows.start
        lines = kernels_speckle.work_lines(mean.shape[2])
        kernels_speckle.add_speckle(mean[c, rows], noise[rows], *own, out[c, rows], *lines)

    do_all(fade, threads * len(mean), threads)
    return out


def finer_than_cells(radar: RadarConfiguration, cell_m: float) -> str:
    """What is to be said of pixels finer than a database's cells [m]."""
    return (
        f"pixels finer than the ground: the scene has nothing smaller than its cells of {cell_m:g} m, so pixels of "
        f"{radar.pixel_spacing_m:.3g} m show no more detail and have fewer looks"
    )


def blind_channels(radar: RadarConfiguration, frame: RadarFrame, lookups: Sequence[Sigma0Lookup]) -> list[str]:
    """Layers in which no cover is seen at the centre of the swath: too weak for noise, or saturated.

    Each as "kind: what"; ``lookups``: one for each layer.
    """
    flat = range_geometry(np.array([frame.centre_m]), frame.height_m, frame.curved)
    theta = flat.incidence_rad
    noise_db = float(linear_to_db(radar.noise_equivalent_sigma0(theta, flat.slant_range_m, flat.look_rad))[0])
    level_db = radar.receiver_level_db if radar.receiver == "saturation" else math.inf
    weak, strong = [], []
    for layer, lookup in zip(radar.layers, lookups, strict=True):
        sigma0 = [np.interp(math.degrees(theta[0]), lookup.theta_deg, row) for row in lookup.sigma0]
        cover_db = linear_to_db(np.array(sigma0))
        weak += [layer] * bool((cover_db < noise_db).all())
        strong += [layer] * bool((cover_db > level_db).all())
    notes = []
    if weak:
        text = f"every cover in {' and '.join(weak)}, where noise stands for a sigma0 of {noise_db:.1f} dB"
        notes.append(f"{TOO_WEAK}: {text}")
    if strong:
        text = f"every cover in {' and '.join(strong)} returns more than the level of {level_db:g} dB"
        notes.append(f"{SATURATED}: {text}")
    return notes


def tops_counted_twice(frame: RadarFrame) -> list[str]:
    """Whether the elevations hold the trees and buildings already that are set on them; "kind: what", or none.

    They do where, two cells across an edge, the ground rises by half their height or more in the median.
    """
    found, tall = frame.edge_m
    if tall == 0.0 or found < 0.5 * tall:
        return []
    remedy = "set tree_height_m and building_height_m to 0 if these are the elevations of tops"
    what = f"the ground rises by {found:.1f} m where trees or buildings of {tall:g} m begin"
    return [f"heights counted twice: {what}; {remedy}"]


_WIDE_DEG = 20.0
"""By it crops gain -0.1 points over 12 deg, 0.2 over 18, 1.1 over 25, 3.1 over 46, in 16 worlds."""


def _converter_notes(radar: RadarConfiguration, rounded: FloatArray) -> list[str]:
    """What the noise of a converter stands for in each channel, its sigma0 (n_layers,); none without a converter."""
    told = ", ".join(
        f"{level:.1f} dB in {name}" for name, level in zip(radar.recorded, linear_to_db(rounded), strict=False)
    )
    return [f"the error of a {radar.adc_bits}-bit converter stands for a sigma0 of {told}"] if told else []


def _engine_notes(radar: RadarConfiguration, looks: FloatArray, smeared: int, frame: RadarFrame) -> tuple[str, ...]:
    """Assumptions of the engine that matter for this image."""
    least, sag_m = float(looks.min()), frame.ground_range_m[-1] ** 2 / (2.0 * EARTH_RADIUS_M)
    edges = frame.ground_range_m[[frame.pad_near, frame.pad_near + frame.n_rows - 1]]
    near, far = edges * radar.azimuth_beamwidth_rad
    steep, flat = np.degrees(range_geometry(edges, frame.height_m, frame.curved).incidence_rad)
    rotated = not frame.wrapped and frame.cell_of_scene is not None
    both = " and ".join(radar.pair)
    notes = {
        "fading is correlated over the resolution cell and independent between channels": radar.finer_pixels,
        "fading is independent between pixels and between channels": not radar.finer_pixels,
        f"where the phase between {both} is recorded, their fading is correlated": PHASE in radar.channels,
        f"classifiers do not know the incidence angle, which spans more than {_WIDE_DEG:g} deg: crops score 1 percent "
        "lower over 25 deg, 3 over 45": flat - steep > _WIDE_DEG,
        "ground outside the scene returns nothing": frame.wrapped,
        "ground outside the scene is its mirror image": not frame.wrapped,
        f"{both} are used by their powers; channel 'phase' would add the phase between them": (
            set(radar.pair) <= set(radar.channels) and PHASE not in radar.channels
        ),
        finer_than_cells(radar, frame.cell_m): radar.pixel_spacing_m < frame.cell_m,
        f"parts of fields, {radar.texture_m:g} m a side, differ by {radar.texture_db:g} dB (as configured)": (
            radar.texture_db > 0.0
        ),
        "fields are even inside: texture_db = 0": radar.texture_db <= 0.0,
        f"trees of {radar.tree_height_m:g} m and buildings of {radar.building_height_m:g} m hide what lies behind "
        "them, at every frequency": frame.top_m is not frame.elevation_m,
        "antenna gain is the same over the swath": radar.elevation_pattern == "isotropic",
        f"{smeared} of {len(looks)} image rows are finer than the range response ({radar.slant_resolution_m:.4g} m "
        "slant): their power is spread over it": smeared > 0 and not radar.finer_pixels,
        f"the near part of the swath offers {least:.3g} looks, fewer than asked for": (
            radar.looks is not None and least < radar.looks * (1.0 - 1e-9)
        ),
        f"the Earth is taken as flat; its curvature at the far edge would be {sag_m:.0f} m": (
            not frame.curved and sag_m > radar.resolution_m
        ),
        f"the beam is {near:.3g} to {far:.3g} m wide on the ground; a pixel is one beam wide": frame.wrapped,
        "the scene was resampled to polar coordinates, its categories by the nearest cell": frame.wrapped,
        "the heading is not along the grid: the scene was rotated, its categories by the nearest cell": rotated,
    }
    return tuple(note for note, holds in notes.items() if holds)
