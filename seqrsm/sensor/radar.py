"""Side-looking radar: the seven active parameters of RSL TR 380-1 Table 1, the rest of the set, and what follows.

The final resolution cell is a square of ``resolution_m`` on the ground. Bandwidth and antenna give a finer cell, the
single-look cell; the samples that fit into the final cell are averaged and are its looks (eqs. 3-8 to 3-10).
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass
from functools import partial
from typing import Final, Literal, TypeVar

import numpy as np

from seqrsm.arrays import FloatArray
from seqrsm.constants import BOLTZMANN_J_K, EARTH_RADIUS_M, REFERENCE_TEMPERATURE_K, SPEED_OF_LIGHT_M_S
from seqrsm.errors import ConfigurationError, Problem
from seqrsm.sensor.antenna import PATTERN_STEPS, ElevationPattern, atmosphere_factor, elevation_gain
from seqrsm.sensor.earth import ground_share, incidence_of_look
from seqrsm.sensor.parameters import RADAR, configured, value_problems
from seqrsm.units import db_to_linear

PHASE: Final = "phase"
"""The channel that stands for the phase between HH and VV, or RH and RV, and for how well they are related."""

TOGETHER: Final = {("HH", "VV"): ("HH+VV", "HH+iVV"), ("RH", "RV"): ("RH+RV", "RH+iRV")}
"""Its layers by the two channels: both added, as they are and a quarter wave apart, each with half of its power."""

LAYERS: Final = (
    *(channel for channel in RADAR["polarization"].levels if channel != PHASE),
    *(layer for both in TOGETHER.values() for layer in both),
)
"""Layers of images in the order of every draw; the first letter is transmitted, R being right circular."""

GROUND_OF: Final = {"HH": "HH", "HV": "HV", "VV": "VV", "VH": "HV", "RH": "HH", "RV": "VV"}
"""Channel of the scattering tables that each channel's draws are those of: VH is HV, a circular wave's echo mostly the
like-polarized one."""

_CALIBRATIONS: Final = (("i_min_w",), ("i_c_w", "i_qc"), ("p_rc_w", "g_rc"))

_Real = TypeVar("_Real", float, FloatArray)


@dataclass(frozen=True, slots=True)
class RadarConfiguration:
    """One radar on one flight line, complete and free of contradictions.

    The defaults stand for a light airborne synthetic-aperture radar; they are choices, not data of a certain set. What
    each field is, its unit, limits and levels stand in ``data/parameters.csv``. More is to be said of some:

    * ``channels`` are transmitted, then received; transmit polarizations take turns and share the pulses. "phase" needs
      HH and VV, or RH and RV (compact polarimetry).
    * ``bandwidth_mhz`` that ``resolution_m`` does not need becomes looks (eq. 3-10). ``looks`` of None are all that
      there are; where the near part of the swath offers fewer than asked for, all of them are averaged.
    * ``depression_angle_deg`` cannot be 90: at nadir itself nothing is resolved in ground range.
    * ``heading_deg`` other than along the grid turns the data base first: elevation by straight lines, category by the
      nearest cell.
    * ``scan`` "ppi", a plan-position indicator, rotates over one point, with a real aperture and pixels as wide as its
      beam; speed, heading and antenna length do not matter but for the beamwidth, and ``depression_angle_deg`` is that
      of the beam and of the range where the set is judged.
    * ``aperture``: the azimuth cell of one look is L/2, or R beta (eq. 3-9), for an ``antenna_length_m`` L and an
      ``azimuth_beamwidth_deg`` beta, which is lambda/L if None; a given one is that of a length lambda/beta, which then
      stands for L in resolution and looks. From orbit L/2 is in space, and shorter on the ground
      (`seqrsm.sensor.earth.ground_share`).
    * ``antenna_gain_db`` is the same at every frequency; how it falls off its peak tells
      `seqrsm.sensor.antenna.elevation_gain`. ``pattern_table`` has look angles [deg] and gains [dB].
    * ``prf_hz``: a higher rate lowers the noise of a synthetic aperture; that of a real one fluctuates as if each
      sample were one pulse, which costs at most 2 points of percent correct. Compression gains bandwidth x pulse
      length.
    * ``zenith_loss_db`` grows with the slant path.
    * ``pixel_m``, at most the resolution: finer pixels overlap in what they see, and fade together.
    * ``cell_shape`` is the response in power about the middle of a resolution cell, whose side is its half-power width:
      all within it alike, a Gaussian, or the sinc**2 of an evenly filled band; the latter two need pixels of at most
      half that. Of the swath, ground beyond its edges is not imaged.
    * ``fading`` is that of eq. (3-11) with any real N. ``receiver`` and ``processing``, M and S of eqs. (3-1) and
      (3-3), may be a ``package.module:function`` of an array, of powers or of intensities after M and Q; M bends and
      has unit gain at ``receiver_level_db`` over the power of flat ground of sigma0 = 1 at the centre of the swath. The
      error of the converter Q is noise. See `seqrsm.simulate.radar.receiver`.
    * ``n_bits`` and ``dynamic_range_db`` are n and m of eqs. (3-16) to (3-18), ``film_gamma`` and ``film_k`` are of
      eqs. (3-4) to (3-6). The picture is calibrated by I_min (eq. 3-16), by I_C and I_QC (eq. 3-17) or by P_RC and G_RC
      (eq. 3-18); with none its median is mid-grey.
    * Soil moisture and wind of a run are uniform between their ends. ``soil_moisture_field_sd`` and
      ``soil_moisture_region_sd`` are as of a radiometer; 0 where the spread of bare fields' backscatter is to have all
      of it. ``texture_db``, 0 for even fields: `seqrsm.simulate.radar.occasion`.
    * ``tree_height_m`` and ``building_height_m`` (assumed) stand on the scene's elevations and are opaque; 0 where
      these are those of the tops (a surface model). Crops are too short to matter: 2 m hide one cell of 3 m at 30 deg.
    * ``targets_file``: `seqrsm.simulate.radar.targets.load_targets`.

    Raises
    ------
    ConfigurationError
        Impossible or contradicting values, all at once, with the numbers.
    """

    frequency_ghz: float
    channels: tuple[str, ...]
    resolution_m: float
    bandwidth_mhz: float
    peak_power_w: float
    depression_angle_deg: float
    altitude_m: float
    looks: float | None = None
    heading_deg: float = 90.0
    scan: Literal["slar", "ppi"] = "slar"
    antenna_east_m: float = 0.0
    antenna_north_m: float = 0.0
    antenna_length_m: float = 2.0
    antenna_gain_db: float = 25.0
    aperture: Literal["synthetic", "real"] = "synthetic"
    azimuth_beamwidth_deg: float | None = None
    elevation_pattern: ElevationPattern = "isotropic"
    boresight_depression_deg: float | None = None
    elevation_beamwidth_deg: float = 30.0
    pattern_table: tuple[tuple[float, float], ...] = ()
    pulse_length_us: float = 5.0
    prf_hz: float = 1000.0
    speed_m_s: float = 100.0
    noise_figure_db: float = 4.0
    loss_db: float = 3.0
    zenith_loss_db: float = 0.0
    pixel_m: float | None = None
    cell_shape: Literal["box", "gaussian", "sinc_squared"] = "box"
    range_format: Literal["ground", "slant"] = "ground"
    near_incidence_deg: float = 0.0
    far_incidence_deg: float = 90.0
    earth: Literal["curved", "flat"] = "curved"
    fading: Literal["gamma", "none"] = "gamma"
    receiver: str = "linear"
    receiver_level_db: float = 0.0
    agc_length_m: float = 500.0
    adc_bits: int = 0
    adc_range_db: float = 8.0
    processing: str = ""
    n_bits: int = 8
    dynamic_range_db: float = 20.0
    film_gamma: float = 1.0
    film_k: float = 1.0
    i_min_w: float | None = None
    i_c_w: float | None = None
    i_qc: float | None = None
    p_rc_w: float | None = None
    g_rc: float | None = None
    season: str = "spring_summer"
    snow: Literal["none", "dry", "wet"] = "none"
    snow_depth_cm: float = 15.0
    soil_moisture_low: float = 0.10
    soil_moisture_high: float = 0.30
    soil_moisture_field_sd: float = 0.0
    soil_moisture_region_sd: float = 0.0
    soil_moisture_region_m: float = 1000.0
    wind_low_m_s: float = 2.0
    wind_high_m_s: float = 8.0
    texture_db: float = 1.0
    texture_m: float = 50.0
    tree_height_m: float = 15.0
    building_height_m: float = 8.0
    calibration_sd_db: float = 0.0
    targets_file: str = ""

    def __post_init__(self) -> None:
        problems = value_problems(RADAR, self) or _set_problems(self)
        if problems:
            raise ConfigurationError(*problems)

    @property
    def calibrated(self) -> bool:
        """Whether the picture's grey tones are asked for: by a calibration, the film, or the decibels they span."""
        given = (self.i_min_w, self.i_c_w, self.p_rc_w)
        film = (self.film_gamma, self.film_k, self.dynamic_range_db) != (1.0, 1.0, 20.0)
        return film or any(value is not None for value in given)

    @property
    def wavelength_m(self) -> float:
        """Wavelength lambda [m]."""
        return SPEED_OF_LIGHT_M_S / (self.frequency_ghz * 1e9)

    @property
    def curved(self) -> bool:
        """Whether the ground is a sphere."""
        return self.earth == "curved"

    @property
    def centre_incidence_rad(self) -> float:
        """Incidence angle on flat ground at the centre of the scene [rad]; nan beyond the horizon."""
        return incidence_of_look(math.radians(90.0 - self.depression_angle_deg), self.altitude_m, self.curved)

    @property
    def ground_share(self) -> float:
        """Way over ground of each metre of the flight line; less than 1 from orbit."""
        return ground_share(self.altitude_m, self.curved)

    def elevation_gain(self, look_rad: FloatArray) -> FloatArray:
        """One-way antenna pattern over its peak at look angles [rad]."""
        boresight = self.boresight_depression_deg
        depression = self.depression_angle_deg if boresight is None else boresight
        return elevation_gain(
            self.elevation_pattern,
            look_rad,
            math.radians(90.0 - depression),
            math.radians(self.elevation_beamwidth_deg),
            self.pattern_table,
        )

    def pattern_lut(self) -> FloatArray:
        """Two-way pattern at equal steps of tan(look / 2), look from 0 to 90 deg; empty for an isotropic one."""
        if self.elevation_pattern == "isotropic":
            return np.empty(0)
        return self.elevation_gain(2.0 * np.arctan(np.linspace(0.0, 1.0, PATTERN_STEPS + 1))) ** 2

    def atmosphere(self, incidence_rad: FloatArray) -> FloatArray:
        """Two-way transmission L_T L_R of the atmosphere at incidence angles [rad]."""
        return atmosphere_factor(self.zenith_loss_db, incidence_rad) ** 2

    @property
    def slant_resolution_m(self) -> float:
        """Slant range resolution of one look, c/(2B) [m]."""
        return SPEED_OF_LIGHT_M_S / (2e6 * self.bandwidth_mhz)

    @property
    def pixel_spacing_m(self) -> float:
        """Side of a pixel on the ground [m]."""
        return self.resolution_m if self.pixel_m is None else self.pixel_m

    @property
    def finer_pixels(self) -> bool:
        """Whether pixels are finer than the resolution cell."""
        return self.pixel_spacing_m < self.resolution_m

    @property
    def range_spacing_m(self) -> float:
        """Spacing of the image rows [m]: that of pixels on the ground, or its slant range at the centre."""
        return self.pixel_spacing_m * (1.0 if self.range_format == "ground" else math.sin(self.centre_incidence_rad))

    @property
    def recorded(self) -> tuple[str, ...]:
        """Its channels without the phase, which is that between two of them."""
        return tuple(channel for channel in self.channels if channel != PHASE)

    @property
    def pair(self) -> tuple[str, str]:
        """The two channels between which a phase is."""
        return ("RH", "RV") if {"RH", "RV"} & set(self.channels) else ("HH", "VV")

    @property
    def layers(self) -> tuple[str, ...]:
        """Layers of its images: a channel each, and at the end `TOGETHER` for the phase."""
        return (*self.recorded, *TOGETHER[self.pair]) if PHASE in self.channels else self.channels

    @property
    def n_transmit(self) -> int:
        """Number of transmit polarizations that share the pulses."""
        return len({channel[0] for channel in self.recorded})

    def ground_resolution_m(self, incidence_rad: _Real) -> _Real:
        """Ground range resolution of one look, c/(2 B sin(theta)) [m], at incidence angles [rad] > 0."""
        spacing: _Real = self.slant_resolution_m / np.sin(incidence_rad)
        return spacing

    def azimuth_resolution_m(self, slant_range_m: _Real) -> _Real:
        """Azimuth resolution of one look [m]: `sample_m`, or R beta of a real aperture (eq. 3-9)."""
        if self.aperture == "synthetic":
            return self.sample_m + 0.0 * slant_range_m
        return slant_range_m * self.azimuth_beamwidth_rad

    @property
    def sample_m(self) -> float:
        """Way over ground from one independent sample to the next [m]: L/2, or lambda / (2 beta) of a given beam.

        Both are of the flight line itself, so that from orbit the way is shorter by the ground's share.
        """
        if self.azimuth_beamwidth_deg is None:
            return 0.5 * self.antenna_length_m * self.ground_share
        return 0.5 * self.wavelength_m / self.azimuth_beamwidth_rad * self.ground_share

    @property
    def azimuth_beamwidth_rad(self) -> float:
        """Half-power beamwidth along the track [rad]: as given, or lambda/L."""
        if self.azimuth_beamwidth_deg is not None:
            return math.radians(self.azimuth_beamwidth_deg)
        return self.wavelength_m / self.antenna_length_m

    def looks_available(self, incidence_rad: _Real) -> _Real:
        """Independent samples N in a final resolution cell, a real number.

        Eq. (3-8) with the chosen cell in place of the finest: N_a = resolution/(L/2) along the track, the same for both
        apertures (a real aperture with resolution = R lambda/L gives N_a = 2 R lambda/L**2, eq. 3-9), and N_r =
        resolution/(c/(2 B sin(theta))) across. N_r is never below 1: where the range response is wider than the cell,
        a pixel still holds one sample. Rows of equal slant range are cells that hold as many everywhere as at the
        centre, unless their pixels are finer than the cell. A plan-position indicator hovers over one point: its beam
        gives one sample, whatever the pulses.
        """
        at = incidence_rad
        if self.range_format == "slant" and not self.finer_pixels:
            at = self.centre_incidence_rad + 0.0 * incidence_rad
        across: _Real = np.maximum(self.resolution_m / self.ground_resolution_m(at), 1.0)
        return across if self.scan == "ppi" else self.resolution_m / self.sample_m * across

    def looks_used(self, incidence_rad: FloatArray) -> FloatArray:
        """Samples averaged in a final cell at incidence angles [rad]: those asked for, or all."""
        available = self.looks_available(incidence_rad)
        return np.maximum(available if self.looks is None else np.minimum(available, self.looks), 1.0)

    def received_power_w(
        self, incidence_rad: FloatArray, slant_range_m: FloatArray, look_rad: FloatArray
    ) -> FloatArray:
        """Mean power of one pulse from one single-look cell of flat ground of sigma0 = 1 [W]: eq. (3-20).

        The look angle [rad] tells the antenna's gain; on a plane it is the incidence angle.
        """
        area = self.ground_resolution_m(incidence_rad) * self.azimuth_resolution_m(slant_range_m)
        two_way = self.elevation_gain(look_rad) ** 2 * self.atmosphere(incidence_rad)
        return np.asarray(self.radar_constant_w_m2() * area * two_way / np.square(np.square(slant_range_m)))

    def radar_constant_w_m2(self) -> float:
        """P_T G**2 lambda**2 L_T L_R / (4 pi)**3 [W m2]: eq. (3-20) without sigma0 A / R**4."""
        gain = db_to_linear(2.0 * self.antenna_gain_db - self.loss_db)
        return float(self.peak_power_w * gain * self.wavelength_m**2 / (4.0 * math.pi) ** 3)

    def thermal_noise_w(self) -> float:
        """Noise power in the bandwidth of the receiver, k T0 B F [W], T0 = 290 K."""
        density_w_hz = BOLTZMANN_J_K * REFERENCE_TEMPERATURE_K
        return float(density_w_hz * self.bandwidth_mhz * 1e6 * db_to_linear(self.noise_figure_db))

    @property
    def compression_gain(self) -> float:
        """Gain of pulse compression in signal to noise, bandwidth x pulse length, at least 1."""
        return max(1.0, self.bandwidth_mhz * self.pulse_length_us)

    def coherent_pulses(self, slant_range_m: _Real) -> _Real:
        """Pulses of one transmit polarization added in phase: those sent over the synthetic length R lambda/L."""
        if self.aperture == "real":
            return 1.0 + 0.0 * slant_range_m
        along = slant_range_m * self.azimuth_beamwidth_rad
        pulses: _Real = np.maximum(self.prf_hz / self.n_transmit * along / self.speed_m_s, 1.0)
        return pulses

    @property
    def pulses_a_sample(self) -> float:
        """Pulses of one transmit polarization added in phase for each independent sample, at least 1."""
        if self.aperture == "real":
            return 1.0
        return max(self.prf_hz / self.n_transmit * self.sample_m / self.speed_m_s, 1.0)

    def noise_power_w(self, slant_range_m: FloatArray) -> FloatArray:
        """Noise power of one look [W], on the scale of `received_power_w`: divided by both processing gains."""
        return np.asarray(self.thermal_noise_w() / (self.compression_gain * self.coherent_pulses(slant_range_m)))

    def noise_equivalent_sigma0(
        self, incidence_rad: FloatArray, slant_range_m: FloatArray, look_rad: FloatArray
    ) -> FloatArray:
        """The sigma0 (linear) of flat ground whose mean power equals the noise power."""
        return self.noise_power_w(slant_range_m) / self.received_power_w(incidence_rad, slant_range_m, look_rad)


from_settings: Final = partial(configured, "radar", RadarConfiguration, RADAR)
"""Radar of one point of a design, its ``settings`` and ``fixed``: see `seqrsm.sensor.parameters.configured`."""


def at_fault(radar: RadarConfiguration, name: str, text: str, remedy: str) -> Problem:
    """Problem of the parameter of this name in ``campaign.toml``, with its value."""
    return Problem(text, remedy, field=name, value=getattr(radar, RADAR[name].field))


def _set_problems(radar: RadarConfiguration) -> list[Problem]:
    """Every contradiction between values that are possible alone; needs no scene."""
    found = [*_excluded_choices(radar), *_calibration_problems(radar)]
    theta = radar.centre_incidence_rad
    if math.isnan(theta):
        least = 90.0 - math.degrees(math.asin(EARTH_RADIUS_M / (EARTH_RADIUS_M + radar.altitude_m)))
        text = f"the line of sight to the centre of the scene passes the horizon, {least:.4g} deg below the horizontal"
        return [*found, at_fault(radar, "depression_angle", text, f"Use at least {rounded_up(least)} deg")]
    across = radar.ground_resolution_m(theta)
    if radar.resolution_m < across * (1.0 - 1e-9):
        needed = radar.bandwidth_mhz * across / radar.resolution_m
        finest = f"{across:.4g} m in ground range, no finer"
        text = f"{radar.bandwidth_mhz:g} MHz at an incidence of {math.degrees(theta):.4g} deg resolve {finest}"
        remedy = f"Use at least {rounded_up(needed)} MHz or a resolution of at least {rounded_up(across)} m"
        found.append(at_fault(radar, "resolution", text, remedy))
    along, given_deg = radar.sample_m, radar.azimuth_beamwidth_deg
    if radar.scan == "slar" and radar.resolution_m < along * (1.0 - 1e-9):
        what = f"an antenna of {radar.antenna_length_m:g} m" if given_deg is None else f"a beam of {given_deg:g} deg"
        text = f"{what} resolves {along:.4g} m in azimuth, no finer"
        other = "shorter antenna" if given_deg is None else "wider beam"
        remedy = f"Use a resolution of at least {rounded_up(along)} m or a {other}"
        found.append(at_fault(radar, "resolution", text, remedy))
    available = radar.looks_available(theta)
    if not found and radar.looks is not None and radar.looks > available * (1.0 + 1e-9):
        held = f"{available:.4g} independent samples at the centre of the scene"
        text = f"a cell of {radar.resolution_m:g} m holds {held}"
        remedy = f"Ask for at most {rounded_down(available)} looks, or more bandwidth, or a coarser resolution"
        found.append(at_fault(radar, "looks", text, remedy))
    sampled = radar.prf_hz / radar.n_transmit
    if radar.scan == "slar" and sampled < radar.speed_m_s / along:
        need = radar.n_transmit * radar.speed_m_s / along
        text = f"each transmit polarization (here {radar.n_transmit}) needs a pulse every {along:.4g} m flown"
        found.append(at_fault(radar, "prf_hz", text, f"Use at least {rounded_up(need)} Hz"))
    if radar.pulse_length_us * 1e-6 * radar.prf_hz >= 1.0:
        remedy = f"Keep it below {rounded_down(1e6 / radar.prf_hz)} us"
        found.append(at_fault(radar, "pulse_length_us", "the pulse is longer than the time to the next one", remedy))
    for low, high in (("soil_moisture_low", "soil_moisture_high"), ("wind_low_m_s", "wind_high_m_s")):
        if getattr(radar, low) > getattr(radar, high):
            found.append(at_fault(radar, low, "above the high end", f"Keep it at or below {high}"))
    return found


def _excluded_choices(radar: RadarConfiguration) -> Iterator[Problem]:
    """Choices that exclude or need each other."""
    if radar.near_incidence_deg >= radar.far_incidence_deg:
        text = "the near edge of the swath lies beyond the far edge"
        yield at_fault(radar, "near_incidence_deg", text, "Keep it below far_incidence_deg")
    if PHASE in radar.channels and not set(radar.pair) <= set(radar.channels):
        text = f"the phase is that between {' and '.join(radar.pair)}"
        remedy = "Use RH+RV+phase" if radar.pair == ("RH", "RV") else "Use HH+VV+phase, or HH+HV+VV+phase"
        yield at_fault(radar, "polarization", text, remedy)
    if PHASE in radar.channels and radar.receiver != "linear":
        yield at_fault(radar, "receiver", "phases need a linear receiver", f'Use "linear", or omit {PHASE}')
    if {"HV", "VH"} <= set(radar.channels):
        text = "HV and VH carry the same information"
        yield at_fault(radar, "polarization", text, "Omit one: HH+HV+VV is complete")
    if len({channel[0] == "R" for channel in radar.recorded}) > 1:
        text = "a radar sends circular waves or linear ones: from both linear ones every other follows"
        yield at_fault(radar, "polarization", text, "Use RH+RV, or HH+HV+VV")
    if radar.scan == "ppi":
        if radar.aperture != "real":
            yield at_fault(radar, "aperture", "a rotating antenna forms no synthetic aperture", 'Add aperture = "real"')
        if radar.pixel_m is not None:
            text = "the pixels of a plan-position indicator are as wide as its beam"
            yield at_fault(radar, "pixel_m", text, "Omit pixel_m")
    elif radar.antenna_east_m or radar.antenna_north_m:
        text = "an antenna position needs a plan-position indicator"
        yield at_fault(radar, "antenna_east_m", text, 'Add scan = "ppi", or omit it')
    if radar.pixel_m is not None and radar.pixel_m > radar.resolution_m:
        text, remedy = "pixels coarser than the resolution cell", "Make it at most the resolution, or omit it"
        yield at_fault(radar, "pixel_m", text, remedy)
    if radar.cell_shape != "box" and radar.pixel_spacing_m > 0.5 * radar.resolution_m:
        text = "the pixels are too coarse for a cell with a shape"
        yield at_fault(radar, "cell_shape", text, 'Set pixel_m to at most half the resolution, or use "box"')
    if (radar.elevation_pattern == "table") != bool(radar.pattern_table):
        remedy = 'Give both elevation_pattern = "table" and pattern_table, or neither'
        yield Problem("a pattern needs its table, and a table its pattern", remedy, field="pattern_table")
    if radar.snow != "none" and radar.season != "winter":
        yield at_fault(radar, "snow", "snow occurs in winter only", 'Use season = "winter", or snow = "none"')


def _calibration_problems(radar: RadarConfiguration) -> Iterator[Problem]:
    """More than one calibration of the picture, and pairs of which half is missing."""
    used = [names for names in _CALIBRATIONS if any(getattr(radar, name) is not None for name in names)]
    if len(used) > 1:
        text = f"more than one calibration of the picture: {'; '.join(' and '.join(names) for names in used)}"
        yield Problem(text, "Give one of them", field=used[1][0])
    for names in used:
        missing = [name for name in names if getattr(radar, name) is None]
        yield from (Problem("half of a calibration pair", f"Give {' and '.join(names)}", field=n) for n in missing)


def rounded_down(value: float) -> str:
    """Five digits, never above `value`: what a message allows must be allowed."""
    unit = 10.0 ** (math.floor(math.log10(value)) - 4)
    return f"{math.floor(value / unit * (1.0 + 1e-12)) * unit:.5g}"


def rounded_up(value: float) -> str:
    """Five digits, never below `value`."""
    unit = 10.0 ** (math.floor(math.log10(value)) - 4)
    return f"{math.ceil(value / unit * (1.0 - 1e-12)) * unit:.5g}"
