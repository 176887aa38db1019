"""Side-looking radar: the seven active parameters of RSL TR 380-1 Table 1, the rest of the set, and what follows.

The final resolution cell is a square of ``resolution_m`` on the ground. Bandwidth and antenna give a finer cell, the
single-look cell; the samples that fit into the final cell are averaged and are its looks (eqs. 3-8 to 3-10).
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Final, Literal, overload

import numpy as np

from seqrsm.arrays import FloatArray
from seqrsm.constants import BOLTZMANN_J_K, REFERENCE_TEMPERATURE_K, SPEED_OF_LIGHT_M_S
from seqrsm.errors import ConfigurationError
from seqrsm.sensor.antenna import (
    PATTERN_STEPS,
    ElevationPattern,
    atmosphere_factor,
    elevation_gain,
    pattern_file_text,
)
from seqrsm.sensor.earth import ground_range_of_look, incidence_of_look
from seqrsm.sensor.feasibility import converted, set_problems, swath_problems, swath_rows, value_problems
from seqrsm.sensor.settings import collect
from seqrsm.units import db_to_linear

PARAMETER_FIELDS: Final[Mapping[str, str]] = {
    "frequency": "frequency_ghz",
    "polarization": "channels",
    "resolution": "resolution_m",
    "looks": "looks",
    "bandwidth": "bandwidth_mhz",
    "peak_power": "peak_power_w",
    "depression_angle": "depression_angle_deg",
}
"""Names of the active parameters of Table 1 in ``campaign.toml`` and the fields they set."""


@dataclass(frozen=True, slots=True)
class RadarConfiguration:
    """One radar on one flight line, complete and free of contradictions.

    The defaults stand for a light airborne synthetic-aperture radar; they are choices, not data of a certain set.

    Attributes
    ----------
    frequency_ghz : float
        Carrier frequency [GHz], 0.1 to 100.
    channels : tuple of str
        Polarization channels imaged together, of HH, HV, VV. Transmit polarizations take turns and share the pulses.
    resolution_m : float
        Side of the final resolution cell on the ground [m].
    bandwidth_mhz : float
        Bandwidth of the pulse [MHz]; what resolution does not need becomes looks (eq. 3-10).
    peak_power_w : float
        Peak transmitted power P_T [W].
    depression_angle_deg : float
        Angle below the horizontal to the centre of the scene [deg], 0.05 to 89.95: at nadir itself nothing is resolved
        in ground range.
    altitude_m : float
        Height of the flight line above the zero of the scene's elevations [m].
    looks : float or None
        Samples averaged in a final cell; None averages all there are. Where the swath's near part offers fewer than
        asked for, all of them are averaged.
    heading_deg : float
        Direction of flight from north [deg], -360 to 360. The radar looks to the right. Other headings than along the
        grid turn the data base first: elevation by straight lines, category by the nearest cell.
    antenna_length_m : float
        Length L along the track [m].
    antenna_gain_db : float
        Peak one-way gain G over isotropic [dB], the same at every frequency.
    scan : {"slar", "ppi"}
        Side-looking along a flight line, or a plan-position indicator: an antenna that rotates over one point. The
        latter has a real aperture and pixels as wide as its beam; speed, heading and antenna length do not matter but
        for the beamwidth, and `depression_angle_deg` is that of the beam and of the range where the set is judged.
    antenna_east_m, antenna_north_m : float
        Of a plan-position indicator, from the middle of the scene [m].
    aperture : {"synthetic", "real"}
        Azimuth cell of one look: L/2, or R beta (eq. 3-9).
    azimuth_beamwidth_deg : float or None
        Half-power beamwidth beta along the track [deg]; None is lambda/L.
    elevation_pattern : {"isotropic", "cosecant_squared", "sinc_squared", "table"}
        How the gain falls off its peak with the look angle (`seqrsm.sensor.antenna.elevation_gain`).
    boresight_depression_deg : float or None
        Depression angle of the peak [deg]; None is `depression_angle_deg`.
    elevation_beamwidth_deg : float
        Half-power width of the beam in elevation [deg].
    pattern_table : tuple of (float, float)
        Look angle [deg] and gain [dB] of ``elevation_pattern = "table"``; as text ``"0:-20, 40:0, 70:-3"``, or by
        ``pattern_file``, a CSV file of columns ``look_deg,gain_db``.
    pulse_length_us : float
        Length of the transmitted pulse [us]; compression gains bandwidth x length.
    prf_hz : float
        Pulses a second [Hz], all transmit polarizations together.
    speed_m_s : float
        Ground speed [m/s].
    noise_figure_db, loss_db : float
        Noise figure of the receiver [dB]; two-way loss of antenna feed and processing [dB].
    zenith_loss_db : float
        One-way loss of the atmosphere straight down from the flight line [dB]; it grows with the slant path.
    pixel_m : float or None
        Side of a pixel on the ground [m], at most the resolution; None is the resolution. Finer pixels overlap in what
        they see, and fade together.
    range_format : {"ground", "slant"}
        Spacing of the image rows: equal steps on flat ground, or equal slant ranges.
    near_incidence_deg, far_incidence_deg : float
        Edges of the swath, incidence angles on flat ground [deg]; ground outside is not imaged.
    earth : {"curved", "flat"}
        Sphere or plane under the elevations.
    binning : {"overlap", "nearest"}
        Range bins take the parts of elements they overlap, or whole elements by their centres as in the report.
    fading : {"gamma", "gaussian", "none"}
        Eq. (3-11) with any real N; eq. (3-12), refused below 16 looks, where it goes negative too often; or none.
    receiver : str
        M of eq. (3-1): linear, square_law, saturation, compression, agc, or ``package.module:function`` of a power
        array (`seqrsm.simulate.radar.receiver`).
    receiver_level_db : float
        Level of M's bend, of its unit gain, and of the converter [dB] over the power of flat ground of sigma0 = 1 at
        the centre of the swath.
    agc_length_m : float
        Flight path over which the automatic gain follows the echo [m].
    adc_bits, adc_range_db : int, float
        Bits of the converter Q, 0 for none, and its full scale over the receiver's level [dB].
    processing : str
        S of eq. (3-3): ``package.module:function`` of the intensities after M and Q, or "" for none.
    n_bits, dynamic_range_db : int, float
        Bits of a grey tone and the decibels coded into them (n and m of eqs. 3-16 to 3-18).
    film_gamma, film_k : float
        Slope and constant of the film, eqs. (3-4) to (3-6).
    i_min_w, i_c_w, i_qc, p_rc_w, g_rc : float or None
        Calibration of the picture: the intensity that becomes 0 (eq. 3-16); the intensity I_C and its level I_QC (eq.
        3-17); or the power P_RC and its grey tone G_RC (eq. 3-18). With none the picture's median is mid-grey.
    season : {"spring_summer", "fall", "winter"}
        Season of the scattering table.
    snow, snow_depth_cm : {"none", "dry", "wet"}, float
        Snow of a winter, and its depth [cm].
    soil_moisture_low, soil_moisture_high : float
        Volumetric soil moisture of a run is uniform between them [m3/m3].
    wind_low_m_s, wind_high_m_s : float
        Wind speed over water of a run is uniform between them [m/s].
    texture_db, texture_m : float
        How much parts of a field differ from its mean in a run, standard deviation [dB], 0 for even fields; side of
        these parts [m] (`seqrsm.simulate.radar.texture`).
    targets_file : str
        CSV file of cultural targets (`seqrsm.simulate.radar.targets.load_targets`); "" for none.

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
    range_format: Literal["ground", "slant"] = "ground"
    near_incidence_deg: float = 0.0
    far_incidence_deg: float = 90.0
    earth: Literal["curved", "flat"] = "curved"
    binning: Literal["overlap", "nearest"] = "overlap"
    fading: Literal["gamma", "gaussian", "none"] = "gamma"
    receiver: str = "linear"
    receiver_level_db: float = 0.0
    agc_length_m: float = 500.0
    adc_bits: int = 0
    adc_range_db: float = 20.0
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
    wind_low_m_s: float = 2.0
    wind_high_m_s: float = 8.0
    texture_db: float = 0.0
    texture_m: float = 50.0
    targets_file: str = ""

    def __post_init__(self) -> None:
        problems = value_problems(self) or set_problems(self)
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
    def n_transmit(self) -> int:
        """Number of transmit polarizations that share the pulses."""
        return len({channel[0] for channel in self.channels})

    @overload
    def ground_resolution_m(self, incidence_rad: float) -> float: ...
    @overload
    def ground_resolution_m(self, incidence_rad: FloatArray) -> FloatArray: ...
    def ground_resolution_m(self, incidence_rad: float | FloatArray) -> float | FloatArray:
        """Ground range resolution of one look, c/(2 B sin(theta)) [m], at incidence angles [rad] > 0."""
        return self.slant_resolution_m / np.sin(incidence_rad)

    @overload
    def azimuth_resolution_m(self, slant_range_m: float) -> float: ...
    @overload
    def azimuth_resolution_m(self, slant_range_m: FloatArray) -> FloatArray: ...
    def azimuth_resolution_m(self, slant_range_m: float | FloatArray) -> float | FloatArray:
        """Azimuth resolution of one look [m]: L/2, or R beta of a real aperture (eq. 3-9)."""
        if self.aperture == "synthetic":
            return 0.5 * self.antenna_length_m + 0.0 * slant_range_m
        return slant_range_m * self.azimuth_beamwidth_rad

    @property
    def azimuth_beamwidth_rad(self) -> float:
        """Half-power beamwidth along the track [rad]: as given, or lambda/L."""
        if self.azimuth_beamwidth_deg is not None:
            return math.radians(self.azimuth_beamwidth_deg)
        return self.wavelength_m / self.antenna_length_m

    @overload
    def looks_available(self, incidence_rad: float) -> float: ...
    @overload
    def looks_available(self, incidence_rad: FloatArray) -> FloatArray: ...
    def looks_available(self, incidence_rad: float | FloatArray) -> float | FloatArray:
        """Independent samples N in a final resolution cell, a real number.

        Eq. (3-8) with the chosen cell in place of the finest: N_a = resolution/(L/2) along the track, the same for both
        apertures (a real aperture with resolution = R lambda/L gives N_a = 2 R lambda/L**2, eq. 3-9), and N_r =
        resolution/(c/(2 B sin(theta))) across. N_r is never below 1: where the range response is wider than the cell,
        a pixel still holds one sample. A plan-position
        indicator hovers over one point: its beam gives one sample, whatever the pulses.
        """
        across = self.resolution_m / self.ground_resolution_m(incidence_rad)
        if self.scan == "ppi":
            return np.maximum(across, 1.0)
        return self.resolution_m / (0.5 * self.antenna_length_m) * np.maximum(across, 1.0)

    def looks_used(self, incidence_rad: FloatArray) -> FloatArray:
        """Samples averaged in a final cell at incidence angles [rad]: those asked for, or all."""
        available = self.looks_available(incidence_rad)
        return np.maximum(available if self.looks is None else np.minimum(available, self.looks), 1.0)

    def received_power_w(
        self,
        sigma0: float,
        incidence_rad: FloatArray,
        slant_range_m: FloatArray,
        look_rad: FloatArray | None = None,
    ) -> FloatArray:
        """Mean power of one pulse from one single-look cell of flat ground [W]: eq. (3-20).

        The look angle [rad] tells the antenna's gain; it is the incidence angle if not given (on a plane).
        """
        area = self.ground_resolution_m(incidence_rad) * self.azimuth_resolution_m(slant_range_m)
        power = self.radar_constant_w_m2() * sigma0 * area
        if self.elevation_pattern != "isotropic" or self.zenith_loss_db:
            two_way = self.elevation_gain(incidence_rad if look_rad is None else look_rad) ** 2
            power = power * (two_way * self.atmosphere(incidence_rad))
        return np.asarray(power / np.square(np.square(slant_range_m)))

    def radar_constant_w_m2(self) -> float:
        """P_T G**2 lambda**2 L_T L_R / (4 pi)**3 [W m2]: eq. (3-20) without sigma0 A / R**4."""
        gain = db_to_linear(2.0 * self.antenna_gain_db - self.loss_db)
        return float(self.peak_power_w * gain * self.wavelength_m**2 / (4.0 * math.pi) ** 3)

    def thermal_noise_w(self) -> float:
        """Noise power in the bandwidth of the receiver, k T0 B F [W], T0 = 290 K."""
        return float(
            BOLTZMANN_J_K * REFERENCE_TEMPERATURE_K * self.bandwidth_mhz * 1e6 * db_to_linear(self.noise_figure_db)
        )

    @property
    def compression_gain(self) -> float:
        """Gain of pulse compression in signal to noise, bandwidth x pulse length, at least 1."""
        return max(1.0, self.bandwidth_mhz * self.pulse_length_us)

    @overload
    def coherent_pulses(self, slant_range_m: float) -> float: ...
    @overload
    def coherent_pulses(self, slant_range_m: FloatArray) -> FloatArray: ...
    def coherent_pulses(self, slant_range_m: float | FloatArray) -> float | FloatArray:
        """Pulses of one transmit polarization added in phase: those sent over the synthetic length R lambda/L."""
        if self.aperture == "real":
            return 1.0 + 0.0 * slant_range_m
        along = slant_range_m * self.azimuth_beamwidth_rad
        return np.maximum(self.prf_hz / self.n_transmit * along / self.speed_m_s, 1.0)

    def noise_power_w(self, slant_range_m: FloatArray) -> FloatArray:
        """Noise power of one look [W], on the scale of `received_power_w`: divided by both processing gains."""
        return np.asarray(self.thermal_noise_w() / (self.compression_gain * self.coherent_pulses(slant_range_m)))

    def noise_equivalent_sigma0(
        self, incidence_rad: FloatArray, slant_range_m: FloatArray, look_rad: FloatArray | None = None
    ) -> FloatArray:
        """The sigma0 (linear) of flat ground whose mean power equals the noise power."""
        return self.noise_power_w(slant_range_m) / self.received_power_w(1.0, incidence_rad, slant_range_m, look_rad)

    def ground_ranges_m(
        self, n_rows: int, cell_m: float, mean_elevation_m: float, highest_elevation_m: float
    ) -> tuple[FloatArray, slice]:
        """Ground range of the centre of each row of a scene [m], the depression angle pointing at its centre.

        Parameters
        ----------
        n_rows : int
            Cells of the scene across the track.
        cell_m : float
            Side of a cell [m].
        mean_elevation_m, highest_elevation_m : float
            Of the scene [m].

        Returns
        -------
        float64 array (n_rows,), slice
            Ground ranges, and the rows within the swath.

        Raises
        ------
        ConfigurationError
            The flight line is too low, the swath is empty, reaches behind nadir or beyond the horizon, or pulses
            overlap.
        """
        height = self.altitude_m - mean_elevation_m
        # A line below the ground has no geometry: it is refused by its height.
        look = math.radians(90.0 - self.depression_angle_deg)
        centre = ground_range_of_look(look, height, self.curved) if height > 0.0 else 0.0
        y = centre + (np.arange(n_rows, dtype=np.float64) - 0.5 * (n_rows - 1)) * cell_m
        rows = swath_rows(self, y, height) if height > 0.0 else slice(0, n_rows)
        problems = swath_problems(self, y[rows], cell_m, height, highest_elevation_m)
        if problems:
            raise ConfigurationError(*problems)
        return y, rows

    def ring_ranges_m(
        self, n_rings: int, cell_m: float, mean_elevation_m: float, highest_elevation_m: float
    ) -> tuple[FloatArray, slice]:
        """Ground range of the rings of a plan-position indicator [m], and those within the swath.

        Parameters, results and errors are those of `ground_ranges_m`, for rings in place of rows.
        """
        height = self.altitude_m - mean_elevation_m
        y = cell_m * np.arange(1, n_rings + 1, dtype=np.float64)
        rows = swath_rows(self, y, height) if height > 0.0 else slice(0, n_rings)
        problems = swath_problems(self, y[rows], cell_m, height, highest_elevation_m)
        if problems:
            raise ConfigurationError(*problems)
        return y, rows


def from_settings(
    settings: Mapping[str, float | str], fixed: Mapping[str, float | str] | None = None
) -> RadarConfiguration:
    """Radar of one point of a design.

    Parameters
    ----------
    settings : Mapping[str, float or str]
        Levels of the factors, by the names of Table 1 (`PARAMETER_FIELDS`) or of the fields of `RadarConfiguration`.
        A polarization such as ``"HH+HV"`` is a set of channels.
    fixed : Mapping[str, float or str], optional
        Everything that is no factor, by the same names.

    Returns
    -------
    RadarConfiguration

    Raises
    ------
    ConfigurationError
        Unknown, doubled or missing names; impossible values; contradictions; all that can be told at once.
    """
    names = {**PARAMETER_FIELDS, "pattern_file": "pattern_table"}
    given, problems = collect("radar", RadarConfiguration, names, settings, fixed)
    if "pattern_file" in {**settings, **(fixed or {})} and "pattern_table" in given:
        given["pattern_table"] = pattern_file_text(str(given["pattern_table"]), problems)
    shown = {target: name for name, target in names.items()}
    arguments: dict[str, object] = {}
    for name, value in given.items():
        arguments[name] = converted(name, value, problems, shown.get(name, name))
    if problems:
        raise ConfigurationError(*problems)
    build: Callable[..., RadarConfiguration] = RadarConfiguration
    return build(**arguments)
