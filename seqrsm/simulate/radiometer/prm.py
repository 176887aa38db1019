"""Point Radiation Model of a scanning radiometer: RSL TR 380-1 chapter 3.3, in the report's two programs.

`radiation_map` is the report's POWER: what every data-base element sends to the antenna, eq. (3-35). `scan_image` is
its SIMULATE: the flight, the footprints and their sums, the receiver's noise.

Figures B.15 to B.17 name beamwidths of "0.01" and "0.0175 degrees". As degrees they would need antennas of a hundred
metres and more at any frequency of the report and footprints of a decimetre; 0.01 rad and 0.0175 rad (one degree) are
meant: 10 m and 17.5 m from 1 km.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from seqrsm.arrays import AnyArray, FloatArray, Precision
from seqrsm.rng import stream_key
from seqrsm.scattering.atmosphere import Atmosphere, make_atmosphere, radiation_equivalent_k
from seqrsm.scattering.emissivity import MOISTURE_NODES, EmissivityLookup, EmissivityTable, departed
from seqrsm.scene.layers import known_heights
from seqrsm.scene.scene import Scene
from seqrsm.sensor.radiometer import CHANNELS, RadiometerConfiguration
from seqrsm.sensor.scan import BEAM_STEPS_A_WIDTH, ScanGeometry, scan_geometry
from seqrsm.simulate.radiometer import kernels_prm, kernels_scan
from seqrsm.simulate.radiometer.frame import (
    RadiometerFrame,
    make_radiometer_frame,
    surface_temperature_k,
    temperature_layer,
)
from seqrsm.simulate.radiometer.occasion import RadiometerOccasion, draw_radiometer_occasion, stages_of
from seqrsm.simulate.radiometer.result import RadiometerImage
from seqrsm.simulate.visits import ONCE, Visit

_CHEBYSHEV_NODES = np.cos(np.pi * (np.arange(200) + 0.5) / 200)
_CHEBYSHEV = np.linalg.pinv(np.polynomial.chebyshev.chebvander(_CHEBYSHEV_NODES, 9))

LUT_STEPS = 1024
"""Steps of the tables of emissivity and sky in sin(theta/2): 0.06 to 0.11 deg each."""


def simulate_radiometer(
    scene: Scene,
    radiometer: RadiometerConfiguration,
    table: EmissivityTable,
    *,
    seed: int,
    run_id: int,
    precision: Precision = "float32",
    visit: Visit = ONCE,
) -> RadiometerImage:
    """Image of a scene by a radiometer on one occasion.

    The image is a function of the arguments alone: the same seed and run id, of campaign and run, key the same occasion
    and noise in any process. ``precision`` is that of the arrays of cells; footprints are summed in double precision in
    any case. ``visit`` is which of a run's images this is.

    Raises
    ------
    ConfigurationError
        The scan is impossible over this scene.
    ScatteringDataError
        A category, frequency or polarization without data.
    SceneError
        No cell has an elevation, or the layer of temperature is asked for and missing.
    """
    frame = make_radiometer_frame(scene, radiometer, precision)
    n, m = frame.elevation_m.shape
    scan = scan_geometry(radiometer, frame.height_m, n * scene.cell_m, m * scene.cell_m)
    stages = stages_of(scene, table.calendar, visit, seed=seed, run_id=run_id)
    lookups = lookups_of(scene, radiometer, table, stages.day, stages.categories)
    occasion = draw_radiometer_occasion(radiometer, lookups, stages, scene, visit, seed=seed, run_id=run_id)
    frame = replace(frame, cover=stages.of_cells(frame.cover, frame.field))
    planck_k = radiometer.planck_used_k
    air = air_over(radiometer, planck_k)
    met = Meeting(frame, scan, lookups, occasion, air, planck_k, table, visit.day)
    ground_k = surface_temperature_k(scene, frame, radiometer, lookups[0], occasion)
    mapped = radiation_map(met, radiometer, ground_k)
    law = "Planck's law" if planck_k > 0.0 else "the Rayleigh-Jeans law"
    notes = dict.fromkeys(note for lookup in lookups for note in lookup.notes)
    return scan_image(
        met,
        mapped,
        radiometer,
        noise=stream_key(seed, run_id, visit.purpose("receiver noise")),
        notes=(*notes, *air.notes, f"radiation by {law}"),
    )


@dataclass(frozen=True, slots=True, eq=False)
class Meeting:
    """What one run of a radiometer meets: the scene in its frame, its scan, emissivities, air, and the occasion.

    ``planck_k`` is h f / k [K], and the air made with it, where radiation is by Planck's law; 0 by Rayleigh-Jeans, eqs.
    (3-32) to (3-34). ``table`` is what the ground was looked up in; ``day`` is that of the visit.
    """

    frame: RadiometerFrame
    scan: ScanGeometry
    lookups: list[EmissivityLookup]
    occasion: RadiometerOccasion
    air: Atmosphere
    planck_k: float
    table: EmissivityTable
    day: float | None


def lookups_of(
    scene: Scene,
    radiometer: RadiometerConfiguration,
    table: EmissivityTable,
    day: ArrayLike | None,
    categories: Sequence[str] = (),
) -> list[EmissivityLookup]:
    """Emissivities of a scene's covers, or of ``categories``, on a day of the year, one table for each channel.

    What H and V have in common of fields and dates is that at the scene's mean square of the sine of the look angle.
    """
    look = partial(table.lookup, categories or scene.categories, radiometer.frequency_ghz, day=day)
    squared_sine = _mean_squared_sine(scene, radiometer)
    return [look(channel).seen_at(squared_sine) for channel in radiometer.channels]


def _mean_squared_sine(scene: Scene, radiometer: RadiometerConfiguration) -> float:
    """Of the look angles over a scene: of a cone its own, else the mean of x**2 / (x**2 + h**2) across the track."""
    if radiometer.conical:
        return math.sin(math.radians(radiometer.conical_incidence_deg)) ** 2
    _, mean, _ = known_heights(scene)
    tangent = 0.5 * scene.shape[radiometer.quarter_turns % 2] * scene.cell_m / max(radiometer.altitude_m - mean, 1.0)
    if radiometer.scan_half_angle_deg > 0.0:
        tangent = min(tangent, math.tan(math.radians(radiometer.scan_half_angle_deg)))
    return 1.0 - math.atan(tangent) / tangent


def air_over(radiometer: RadiometerConfiguration, planck_k: float) -> Atmosphere:
    """The air of a radiometer's weather."""
    return make_atmosphere(
        radiometer.frequency_ghz,
        atmosphere=radiometer.atmosphere,
        weather=radiometer.weather,
        cloud_kg_m2=radiometer.cloud_kg_m2,
        rain_mm_h=radiometer.rain_mm_h,
        planck_offset_k=planck_k,
    )


def check_radiometer(
    scene: Scene, radiometer: RadiometerConfiguration, table: EmissivityTable, day: float | None = None
) -> ScanGeometry:
    """Refuse before any run what `simulate_radiometer` would refuse, and with its errors; costs next to nothing.

    ``day`` is of the year. Notes of the scan tell of gaps, overlap, idle time and smear.
    """
    _, mean, _ = known_heights(scene)
    if radiometer.temperature == "layer":
        temperature_layer(scene)
    for channel in radiometer.channels:
        table.refuse(scene.categories, radiometer.frequency_ghz, channel, day)
    rows, columns = scene.shape if radiometer.quarter_turns % 2 == 0 else scene.shape[::-1]
    return scan_geometry(radiometer, radiometer.altitude_m - mean, rows * scene.cell_m, columns * scene.cell_m)


def radiation_map(
    met: Meeting, radiometer: RadiometerConfiguration, ground_k: AnyArray
) -> tuple[AnyArray, AnyArray, AnyArray]:
    """Program POWER: what every element sends to the antenna, eq. (3-35); ``ground_k`` (n, m) is its temperature [K].

    Antenna temperature (n_channels, n, m) that the element alone would give, in kelvin of radiation, 0 if not seen;
    displacement by height, towards higher row numbers (n, m) [cells]; bits of `kernels_prm`, uint8 (n, m): BLOCKED,
    NO_DATA.
    """
    frame = met.frame
    dtype = frame.elevation_m.dtype
    n, m = frame.elevation_m.shape
    geometry = row_geometry(frame, met.air, radiometer.conical)
    antenna = np.empty((len(met.lookups), n, m), dtype=dtype)
    state = np.empty((n, m), dtype=np.uint8)
    kernels_prm.emit_cells(
        frame.elevation_m,
        frame.cover,
        frame.field,
        ground_k if met.planck_k == 0.0 else radiation_equivalent_k(ground_k, met.planck_k).astype(dtype),
        geometry,
        frame.height_m,
        frame.cell_m,
        *emission_tables(met.lookups, met.air, met.occasion, dtype),
        antenna,
        state,
    )
    # By y z / (h - z), outward.
    z, away = frame.elevation_m, (frame.away_m / frame.cell_m).astype(dtype)[:, None]
    return antenna, away * z / (dtype.type(frame.height_m) - z), state


def row_geometry(frame: RadiometerFrame, air: Atmosphere, conical: bool) -> FloatArray:
    """Geometry (n, 5) of the rows of a frame, as `kernels_prm.emit_cells` takes it."""
    away_m = np.abs(frame.away_m)
    look = np.arctan2(away_m, frame.height_m)
    towards_nadir = away_m - frame.cell_m
    geometry = np.empty((len(away_m), 5))
    geometry[:, 0] = away_m
    # Ground within a cell of nadir blocks nothing behind it.
    geometry[:, 1] = np.where(
        towards_nadir > 0.25 * frame.cell_m, frame.cell_m / np.maximum(towards_nadir, 0.25 * frame.cell_m), 0.0
    )
    if conical:
        # Rays of a cone are parallel: each row is as far off as the one before, and before the first there is none.
        geometry[:, 1] = np.where(np.arange(len(away_m)) > 0, frame.cell_m / away_m, 0.0)
    geometry[:, 2] = np.where(frame.away_m >= 0.0, 1.0, -1.0)
    geometry[:, 3] = air.upwelling_k(look, frame.height_m)
    geometry[:, 4] = air.transmission(look, frame.height_m)
    return geometry


def emission_tables(
    lookups: Sequence[EmissivityLookup], air: Atmosphere, occasion: RadiometerOccasion, dtype: Any
) -> tuple[AnyArray, FloatArray, AnyArray, AnyArray]:
    """Tables of emissivity and sky, moisture and factor of each field, as `kernels_prm.emit_cells` takes them."""
    steps = np.minimum(np.arange(LUT_STEPS + 2) / LUT_STEPS, 1.0)
    theta_deg = np.rad2deg(2.0 * np.arcsin(steps * math.sqrt(0.5)))
    covers = zip(lookups, occasion.class_offset[:, :, None, None], strict=True)
    on_date = [replace(look, emissivity=departed(look.emissivity, part)) for look, part in covers]
    lut = np.stack([look.at_angles(theta_deg) for look in on_date]).astype(dtype)
    # Each value beside its step to the next, as one element of twice the size that one load fetches.
    pairs = np.zeros((*lut.shape, 2), dtype=dtype)
    pairs[..., 0] = lut
    pairs[..., :-1, 1] = np.diff(lut, axis=-1)
    table = pairs.view(np.uint64 if dtype == np.float32 else np.complex128)[..., 0]
    place = (occasion.field_moisture - MOISTURE_NODES[0]) / (MOISTURE_NODES[1] - MOISTURE_NODES[0])
    place = np.clip(place, 0.0, len(MOISTURE_NODES) - 1.0 - 1e-6)
    factor = 1.0 - (occasion.field_offset if occasion.field_offset.any() else occasion.field_offset[:, :0])
    return table, _sky_polynomial(air), place.astype(dtype), factor.astype(dtype)


def _sky_polynomial(air: Atmosphere) -> FloatArray:
    """Sky radiation for the kernel: sin(theta/2)**2 at 75 deg, beyond which slant paths are held, and a polynomial.

    It follows the layers to 1 mK in clear air.
    """
    most = math.sin(0.5 * math.radians(75.0)) ** 2
    t = _CHEBYSHEV_NODES
    value = air.sky_k(2.0 * np.arcsin(np.sqrt(0.5 * most * (t + 1.0))))
    # About its own mean, so that a sky of one temperature keeps it to the last digit.
    fitted = _CHEBYSHEV @ (value - value[0])
    power = np.polynomial.chebyshev.cheb2poly(fitted)
    return np.concatenate([[most], power + np.eye(10)[0] * value[0]])


def scan_image(
    met: Meeting,
    mapped: tuple[AnyArray, AnyArray, AnyArray],
    radiometer: RadiometerConfiguration,
    *,
    noise: tuple[np.uint32, np.uint32],
    notes: tuple[str, ...] = (),
) -> RadiometerImage:
    """Program SIMULATE: the sweep over the scene, the beam's sum over each footprint, the receiver's noise.

    ``mapped`` is of `radiation_map`; ``noise`` keys its stream; ``notes`` are recorded with the image.
    """
    frame, scan = met.frame, met.scan
    antenna_k, offset, state = mapped
    n_channels, n, m = antenna_k.shape
    total = np.zeros_like(antenna_k)
    weight = np.zeros((n, m), dtype=total.dtype)
    kernels_scan.bin_angle(antenna_k, offset, state, total, weight)
    look = np.arctan2(frame.across_m, scan.from_m)
    edge = np.arctan2(np.append(frame.across_m, -frame.across_m[0] + frame.cell_m) - 0.5 * frame.cell_m, scan.from_m)
    part = np.clip(0.5 + 0.5 * look / scan.half_angle_rad, 0.0, 1.0)
    width = radiometer.footprint_m[1] / np.cos(look)
    rows = np.empty((n_channels, n, scan.n_sweeps))
    seen = np.empty((n, scan.n_sweeps))
    per_width = float(BEAM_STEPS_A_WIDTH)
    kernels_scan.average_along(
        total, weight, part, width, scan.sweep_advance_m, frame.cell_m, scan.along, per_width, rows, seen
    )
    mean = np.empty((n_channels, len(scan.look_rad), scan.n_sweeps))
    kernels_scan.average_across(rows, seen, edge, scan.place_rad, scan.beamwidth_rad, scan.across, per_width, mean)
    if met.planck_k > 0.0:
        mean = met.planck_k / np.log1p(met.planck_k / mean)
    mean, nedt = _lines(mean, radiometer.nedt_k(mean), scan)
    brightness = mean
    if nedt.any():
        brightness = np.empty_like(mean)
        numbers = np.array([CHANNELS.index(channel) for channel in radiometer.channels])
        kernels_scan.add_receiver_noise(mean, nedt, numbers, *noise, brightness)
    footprint = np.empty((n, m), dtype=np.int32)
    coverage = np.empty((n, m), dtype=np.int32)
    # The beam moves across the rows of a sweep, along those of a conical scan.
    moved = (1.0, max(1.0, scan.smear)) if radiometer.conical else (max(1.0, scan.smear), 1.0)
    held_rad, held_m = np.array([scan.beamwidth_rad, radiometer.footprint_m[1]]) * moved
    sweep = (scan.from_m, frame.cell_m, held_rad, scan.half_angle_rad, scan.place_rad[0], scan.step_rad)
    sampled = (len(scan.look_rad), held_m, scan.sweep_advance_m, scan.n_sweeps)
    end_rad = edge[-1] if radiometer.conical else scan.half_angle_rad  # a cone's footprints are spread over the scene
    farthest = max(scan.place_rad[0] + (len(scan.look_rad) - 1.0) * scan.step_rad, end_rad) + 0.5 * held_rad
    kernels_scan.register_cells(
        offset,
        state,
        np.array([*sweep, *sampled, scan.sweeps_a_line, scan.n_lines, farthest], dtype=np.float64),
        footprint,
        coverage,
    )
    dtype = antenna_k.dtype
    back = -frame.quarter_turns
    return RadiometerImage(
        brightness_k=brightness.astype(dtype),
        mean_k=mean.astype(dtype),
        nedt_k=nedt.astype(dtype),
        scan=scan,
        pixel_of_cell=np.ascontiguousarray(np.rot90(footprint, back)),
        coverage=np.ascontiguousarray(np.rot90(coverage, back)),
        blocked=np.ascontiguousarray(np.rot90((state & kernels_prm.BLOCKED) != 0, back)),
        radiometer=radiometer,
        occasion=met.occasion,
        table=met.table,
        day=met.day,
        quarter_turns=frame.quarter_turns,
        notes=(*notes, *scan.notes, *_ENGINE_NOTES),
    )


def _lines(mean_k: FloatArray, nedt_k: FloatArray, scan: ScanGeometry) -> tuple[FloatArray, FloatArray]:
    """Image lines, each the mean of the sweeps that see it, and the noise that is left (n_channels, n_samples, n)."""
    if scan.sweeps_a_line == 1:
        return mean_k, nedt_k
    shape = (*mean_k.shape[:2], scan.n_lines, scan.sweeps_a_line)
    missing = ((0, 0), (0, 0), (0, scan.n_lines * scan.sweeps_a_line - scan.n_sweeps))
    mean, nedt = (np.pad(x, missing, constant_values=np.nan).reshape(shape) for x in (mean_k, nedt_k))
    count = np.isfinite(mean).sum(axis=3)
    each = np.where(count > 0, count, np.nan)
    return np.nansum(mean, axis=3) / each, np.sqrt(np.nansum(nedt**2, axis=3)) / each


_ENGINE_NOTES = (
    "the aircraft moves during a sweep; each row of a footprint is seen when the antenna axis crosses it",
    "emissivities are those of flat ground; the sky is reflected as by a smooth surface at the slope of the ground",
    "ground outside the scene is taken to be like the ground inside it",
)
