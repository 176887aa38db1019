"""Point Scattering Model of a side-looking radar: RSL TR 380-1 chapter 3.2, in the report's two phases.

Phase one (`power_map`, the report's POWER) finds for every data-base element whether it is lit, its local incidence,
area and slant range, and from them the mean power it returns. Phase two (`form_image`, the report's GREY TONE without
the film, which is `seqrsm.simulate.receiver`) collects elements into range bins, the beam and the pixels, and adds the
receiver's noise and fading.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Literal

import numpy as np

from seqrsm.arrays import AnyArray, BoolArray, FloatArray
from seqrsm.constants import EARTH_RADIUS_M
from seqrsm.rng import stream_key
from seqrsm.sensor.feasibility import CHANNELS
from seqrsm.sensor.radar import RadarConfiguration
from seqrsm.simulate import kernels
from seqrsm.simulate.frame import RadarFrame, make_frame, unpadded
from seqrsm.simulate.occasion import (
    Occasion,
    draw_ground_state,
    draw_occasion,
    nominal_ground_state,
    nominal_occasion,
)

if TYPE_CHECKING:
    from seqrsm.scattering.sigma0 import Sigma0Lookup, Sigma0Table
    from seqrsm.scene.scene import Scene

Precision = Literal["float32", "float64"]

LUT_STEPS = 2048
"""Steps of the table of sigma0 in sin(theta/2): 0.03 to 0.06 deg each."""


@dataclass(frozen=True, slots=True, eq=False)
class PowerMap:
    """Phase one: what every data-base element returns.

    Attributes
    ----------
    frame : RadarFrame
        The ground as the radar sees it.
    power : float array (n_channels, n, m)
        sigma0 x surface area / cell area x (reference range / range)**4; 0 where nothing returns.
    offset : float array (n, m)
        Range position minus that of flat ground in the same row [bins].
    state : uint8 array (n, m)
        Bits of `kernels`: CAST_SHADOW, SELF_SHADOW, LAYOVER, NO_DATA.
    base : float64 array (n + 2,)
        Range position of flat ground in each row from the near edge of the scene [bins], one row more at both ends.
    reference_range_m : float
        Slant range of flat ground at the centre of the scene [m].
    """

    frame: RadarFrame
    power: AnyArray
    offset: AnyArray
    state: AnyArray
    base: FloatArray
    reference_range_m: float


@dataclass(frozen=True, slots=True, eq=False)
class RadarImage:
    """Image of a side-looking radar, rows of range (near range first), columns along the flight.

    Attributes
    ----------
    intensity : float array (n_channels, n_range, n_azimuth)
        Received power of one look with receiver noise and fading, averaged over the looks [W].
    mean_power : float array, same shape
        Expectation of the ground's part of it [W].
    noise_power_w : float64 array (n_range,)
        Expectation of the receiver's part [W].
    looks : float64 array (n_range,)
        Independent samples N in a pixel.
    calibration_w : float64 array (n_range,)
        Power of one look from flat ground with sigma0 = 1 [W], eq. (3-20).
    noise_equivalent_sigma0 : float64 array (n_range,)
        sigma0 of flat ground that returns as much as the noise, linear.
    slant_range_m, ground_range_m, incidence_angle_deg : float64 array (n_range,)
        Of flat ground in the middle of the row [m, m, deg].
    range_spacing_m, azimuth_spacing_m : float
        Spacing of pixels, in range in the unit of the range format [m].
    pixel_of_cell : int32 array (rows, cols)
        Pixel ``row * n_azimuth + column`` into which each cell of the scene falls; -1 for cells without data.
    shadow, layover : bool array (rows, cols)
        Cells of the scene that return nothing for geometry; cells whose echo is mixed with other ground in range.
    radar : RadarConfiguration
    occasion : Occasion
        State of the ground in this run.
    quarter_turns : int
        ``numpy.rot90(scene layer, quarter_turns)`` has the image's orientation.
    notes : tuple of str
        Assumptions that went into the image.
    """

    intensity: AnyArray
    mean_power: AnyArray
    noise_power_w: FloatArray
    looks: FloatArray
    calibration_w: FloatArray
    noise_equivalent_sigma0: FloatArray
    slant_range_m: FloatArray
    ground_range_m: FloatArray
    incidence_angle_deg: FloatArray
    range_spacing_m: float
    azimuth_spacing_m: float
    pixel_of_cell: AnyArray
    shadow: BoolArray
    layover: BoolArray
    radar: RadarConfiguration
    occasion: Occasion
    quarter_turns: int
    notes: tuple[str, ...]

    def apparent_sigma0(self) -> AnyArray:
        """Intensity over what flat ground of sigma0 = 1 would return: calibrated, noise left in, linear."""
        return np.asarray(self.intensity / self.calibration_w[None, :, None])

    def north_up(self, layer: AnyArray) -> AnyArray:
        """Turn the last two axes of an image layer so that north is up."""
        return np.rot90(layer, -self.quarter_turns, axes=(-2, -1))


def simulate_radar(
    scene: Scene,
    radar: RadarConfiguration,
    table: Sigma0Table,
    *,
    seed: int,
    run_id: int,
    precision: Precision = "float32",
    random_occasion: bool = True,
) -> RadarImage:
    """Image of a scene by a radar on one occasion.

    The image is a function of the arguments alone: the same seed and run id give the same bits in any process.

    Parameters
    ----------
    scene : Scene
    radar : RadarConfiguration
    table : Sigma0Table
    seed, run_id : int
        Campaign and run; they key the occasion and the fading.
    precision : {"float32", "float64"}
        Element type of the arrays. Single precision is for use, double for reference; see the tests for how far they
        differ (a median of some 1e-7 of a pixel's power).
    random_occasion : bool
        False takes the table's own values and the middle of the ranges of moisture and wind, for pictures and tests.

    Returns
    -------
    RadarImage

    Raises
    ------
    ConfigurationError
        The radar cannot look at this scene from its flight line.
    ScatteringDataError
        The table lacks a category, frequency or channel.
    """
    frame = make_frame(scene, radar, precision)
    state = draw_ground_state(radar, seed=seed, run_id=run_id) if random_occasion else nominal_ground_state(radar)
    lookups = [
        table.lookup(
            scene.categories,
            radar.frequency_ghz,
            channel,
            season=radar.season,
            wind_m_s=state[1],
            soil_moisture=state[0],
        )
        for channel in radar.channels
    ]
    field_category = kernels.categories_of_fields(frame.field, frame.cover, scene.n_fields)
    if random_occasion:
        occasion = draw_occasion(radar, lookups, field_category, state, seed=seed, run_id=run_id)
    else:
        occasion = nominal_occasion(lookups, field_category, state)
    mapped = power_map(frame, radar, sigma0_lut(lookups, occasion), 10.0 ** (0.1 * occasion.field_offset_db))
    notes = tuple(dict.fromkeys(note for lookup in lookups for note in lookup.notes))
    return form_image(mapped, radar, occasion, seed=seed, run_id=run_id, notes=notes)


def sigma0_lut(lookups: Sequence[Sigma0Lookup], occasion: Occasion) -> FloatArray:
    """Table of sigma0 on equal steps of sin(theta/2) from 0 to 90 deg.

    sin(theta/2) is smooth in the angle and needs no inverse function in the kernel. Between the table's angles sigma0
    is linear in decibels, or in power where it falls to zero.

    Parameters
    ----------
    lookups : sequence of Sigma0Lookup
        One for each channel.
    occasion : Occasion
        Its class offsets are applied.

    Returns
    -------
    float64 array (n_channels, n_categories, LUT_STEPS + 2)
    """
    q = np.minimum(np.arange(LUT_STEPS + 2) / LUT_STEPS, 1.0) * math.sqrt(0.5)
    theta_deg = np.rad2deg(2.0 * np.arcsin(q))
    out = np.empty((len(lookups), lookups[0].sigma0.shape[0], LUT_STEPS + 2))
    for c, lookup in enumerate(lookups):
        nodes = np.asarray(lookup.theta_deg, dtype=np.float64)
        k = np.clip(np.searchsorted(nodes, theta_deg, side="right") - 1, 0, len(nodes) - 2)
        f = np.clip((theta_deg - nodes[k]) / (nodes[k + 1] - nodes[k]), 0.0, 1.0)
        low, high = lookup.sigma0[:, k], lookup.sigma0[:, k + 1]
        both = (low > 0.0) & (high > 0.0)
        ratio = np.where(both, high, 1.0) / np.where(both, low, 1.0)
        out[c] = np.where(both, low * ratio**f, low + f * (high - low))
    out *= 10.0 ** (0.1 * occasion.class_offset_db[:, :, None])
    return out


def power_map(frame: RadarFrame, radar: RadarConfiguration, lut: FloatArray, field_factor: FloatArray) -> PowerMap:
    """Phase one: geometry, propagation and mean power of every element.

    Parameters
    ----------
    frame : RadarFrame
    radar : RadarConfiguration
    lut : float64 array (n_channels, n_categories, LUT_STEPS + 2)
        Of `sigma0_lut`.
    field_factor : float64 array (n_channels, n_fields)
        Factor of each field's sigma0.

    Returns
    -------
    PowerMap
    """
    dtype = frame.elevation_m.dtype
    n, m = frame.elevation_m.shape
    height, cell = frame.height_m, frame.cell_m
    around = np.concatenate(([frame.ground_range_m[0] - cell], frame.ground_range_m, [frame.ground_range_m[-1] + cell]))
    edge = frame.near_edge_m
    slant = np.hypot(around, height)
    ground_format = radar.range_format == "ground"
    position = around - edge if ground_format else slant - math.hypot(edge, height)
    base = position / radar.range_spacing_m
    reference = math.hypot(frame.centre_m, height)
    geometry = np.empty((n, 4))
    geometry[:, 0] = frame.ground_range_m
    geometry[:, 1] = slant[1:-1]
    geometry[:, 2] = np.concatenate(([0.0], cell / frame.ground_range_m[:-1]))
    geometry[:, 3] = (reference / slant[1:-1]) ** 4
    power = np.empty((lut.shape[0], n, m), dtype=dtype)
    offset = np.empty((n, m), dtype=dtype)
    state = np.empty((n, m), dtype=np.uint8)
    kernels.power_cells(
        frame.elevation_m,
        frame.cover,
        frame.field,
        geometry,
        height,
        cell,
        ground_format,
        radar.range_spacing_m,
        lut.astype(dtype),
        field_factor.astype(dtype),
        power,
        offset,
        state,
    )
    kernels.mark_layover(offset, base[1:-1], state)
    return PowerMap(frame, power, offset, state, base, reference)


def form_image(
    mapped: PowerMap,
    radar: RadarConfiguration,
    occasion: Occasion,
    *,
    seed: int,
    run_id: int,
    notes: tuple[str, ...] = (),
) -> RadarImage:
    """Phase two: resolution cells, receiver noise and fading.

    Parameters
    ----------
    mapped : PowerMap
    radar : RadarConfiguration
    occasion : Occasion
        Recorded with the image.
    seed, run_id : int
        Key of the fading.
    notes : tuple of str
        Notes of the scattering table, to which those of the engine are added.

    Returns
    -------
    RadarImage
    """
    frame = mapped.frame
    dtype = mapped.power.dtype
    rows = slice(frame.pad_near, frame.pad_near + frame.n_rows)
    base = mapped.base[1:-1]
    first = math.floor(float((base[rows] + mapped.offset[rows].min(axis=1)).min()))
    last = math.floor(float((base[rows] + mapped.offset[rows].max(axis=1)).max()))
    # A position that rounds onto the far edge belongs to the last bin inside it.
    n_bins = max(last - first + 1, 1)
    ground, slant, theta = _row_geometry(frame, radar, first, n_bins)
    m = mapped.power.shape[2]
    sums = np.zeros((mapped.power.shape[0], n_bins, m), dtype=dtype)
    kernels.bin_range(mapped.power, mapped.offset, mapped.base, first, sums)
    cells_a_pixel = radar.resolution_m / frame.cell_m
    n_pixels = max(math.ceil(m / cells_a_pixel - 1e-9), 1)
    mean = np.empty((sums.shape[0], n_bins, n_pixels), dtype=dtype)
    across = np.asarray(radar.ground_resolution_m(theta))
    single_look = across * radar.azimuth_resolution_m(slant)
    # Ground range of one bin on flat ground, so that the sum over a bin becomes that of one single-look cell.
    bin_ground = radar.range_spacing_m / (1.0 if radar.range_format == "ground" else np.sin(theta))
    constant = radar.radar_constant_w_m2() / mapped.reference_range_m**4
    factor = constant * single_look * frame.cell_m / bin_ground
    beam = np.zeros(n_bins)
    if radar.aperture == "real":
        beam = np.asarray(radar.azimuth_resolution_m(slant)) / frame.cell_m
    kernels.average_azimuth(sums, beam, cells_a_pixel, factor, mean)
    width = across / bin_ground
    smeared = int((width > 1.0).sum())
    if smeared:
        kernels.smear_range(mean, width)
    looks = radar.looks_used(theta)
    noise = radar.noise_power_w(slant)
    intensity = np.empty_like(mean)
    numbers = np.array([CHANNELS.index(channel) for channel in radar.channels])
    kernels.add_speckle(mean, noise, looks, numbers, *stream_key(seed, run_id, "speckle"), intensity)
    pixel = kernels.register_cells(
        mapped.offset[rows], base[rows], mapped.state[rows], first, n_bins, cells_a_pixel, n_pixels
    )
    state = unpadded(mapped.state, frame)
    calibration = np.asarray(radar.received_power_w(1.0, theta, slant))
    return RadarImage(
        intensity=intensity,
        mean_power=mean,
        noise_power_w=noise,
        looks=looks,
        calibration_w=calibration,
        noise_equivalent_sigma0=noise / calibration,
        slant_range_m=slant,
        ground_range_m=ground,
        incidence_angle_deg=np.rad2deg(theta),
        range_spacing_m=radar.range_spacing_m,
        azimuth_spacing_m=radar.resolution_m,
        pixel_of_cell=np.ascontiguousarray(np.rot90(pixel, -frame.quarter_turns)),
        shadow=(state & np.uint8(kernels.CAST_SHADOW | kernels.SELF_SHADOW)) != 0,
        layover=(state & np.uint8(kernels.LAYOVER)) != 0,
        radar=radar,
        occasion=occasion,
        quarter_turns=frame.quarter_turns,
        notes=(*notes, *_engine_notes(radar, looks, smeared, frame)),
    )


def _row_geometry(
    frame: RadarFrame, radar: RadarConfiguration, first: int, n_bins: int
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Ground range [m], slant range [m] and incidence [rad] of flat ground in the middle of every image row."""
    position = (first + 0.5 + np.arange(n_bins)) * radar.range_spacing_m
    # Rows before the nadir echo exist only where terrain is displaced there; they take the angle of the innermost cell.
    least = 0.5 * min(frame.cell_m, frame.near_edge_m)
    if radar.range_format == "ground":
        ground = np.maximum(frame.near_edge_m + position, least)
    else:
        slant = math.hypot(frame.near_edge_m, frame.height_m) + position
        ground = np.sqrt(np.maximum(slant**2 - frame.height_m**2, least**2))
    return ground, np.hypot(ground, frame.height_m), np.arctan2(ground, frame.height_m)


def _engine_notes(radar: RadarConfiguration, looks: FloatArray, smeared: int, frame: RadarFrame) -> tuple[str, ...]:
    """Assumptions of the engine that matter for this image."""
    notes = [
        "fading is independent between pixels and between channels",
        "antenna gain is the same over the swath",
        "ground outside the data base is its mirror image",
    ]
    if smeared:
        notes.append(
            f"{smeared} of {len(looks)} image rows are finer than the range response "
            f"({radar.slant_resolution_m:.4g} m slant): their power is spread over it"
        )
    if radar.looks is not None and float(looks.min()) < radar.looks * (1.0 - 1e-9):
        notes.append(f"the near part of the swath offers {float(looks.min()):.3g} looks, fewer than asked for")
    sag_m = frame.ground_range_m[-1] ** 2 / (2.0 * EARTH_RADIUS_M)
    if sag_m > radar.resolution_m:
        notes.append(f"the Earth is taken as flat; its curvature at the far edge would be {sag_m:.0f} m")
    return tuple(notes)
