"""Side-looking radar: the seven active parameters of RSL TR 380-1 Table 1, the rest of the set, and what follows.

The final resolution cell is a square of ``resolution_m`` on the ground. Bandwidth and antenna give a finer cell, the
single-look cell; the samples that fit into the final cell are averaged and are its looks (eqs. 3-8 to 3-10).
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import MISSING, dataclass, fields
from typing import Final, Literal, overload

import numpy as np

from seqrsm.arrays import FloatArray
from seqrsm.constants import BOLTZMANN_J_K, REFERENCE_TEMPERATURE_K, SPEED_OF_LIGHT_M_S
from seqrsm.errors import ConfigurationError, Problem
from seqrsm.sensor.feasibility import TEXT_FIELDS, set_problems, swath_problems, value_problems
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
        Side of the final resolution cell and of a pixel, on the ground [m].
    bandwidth_mhz : float
        Bandwidth of the pulse [MHz]; what resolution does not need becomes looks (eq. 3-10).
    peak_power_w : float
        Peak transmitted power P_T [W].
    depression_angle_deg : float
        Angle below the horizontal to the centre of the scene [deg], 0.5 to 89.5.
    altitude_m : float
        Height of the flight line above the zero of the scene's elevations [m].
    looks : float or None
        Samples averaged in a final cell; None averages all there are. Where the swath's near part offers fewer than
        asked for, all of them are averaged.
    heading_deg : float
        Direction of flight from north [deg]: 0, 90, 180 or 270. The radar looks to the right.
    antenna_length_m : float
        Length L along the track [m].
    antenna_gain_db : float
        One-way gain G over isotropic [dB], the same over the whole swath and at every frequency.
    aperture : {"synthetic", "real"}
        Azimuth cell of one look: L/2, or R lambda/L (eq. 3-9).
    pulse_length_us : float
        Length of the transmitted pulse [us]; compression gains bandwidth x length.
    prf_hz : float
        Pulses a second [Hz], all transmit polarizations together.
    speed_m_s : float
        Ground speed [m/s].
    noise_figure_db, loss_db : float
        Noise figure of the receiver [dB]; two-way loss of antenna feed, propagation and processing [dB].
    range_format : {"ground", "slant"}
        Spacing of the image rows: equal steps on flat ground, or equal slant ranges.
    n_bits, dynamic_range_db : int, float
        Bits of a grey tone and the decibels coded into them (n and m of eqs. 3-16 to 3-18).
    season : {"spring_summer", "fall", "winter"}
        Season of the scattering table.
    soil_moisture_low, soil_moisture_high : float
        Volumetric soil moisture of a run is uniform between them [m3/m3].
    wind_low_m_s, wind_high_m_s : float
        Wind speed over water of a run is uniform between them [m/s].

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
    antenna_length_m: float = 2.0
    antenna_gain_db: float = 25.0
    aperture: Literal["synthetic", "real"] = "synthetic"
    pulse_length_us: float = 5.0
    prf_hz: float = 1000.0
    speed_m_s: float = 100.0
    noise_figure_db: float = 4.0
    loss_db: float = 3.0
    range_format: Literal["ground", "slant"] = "ground"
    n_bits: int = 8
    dynamic_range_db: float = 20.0
    season: str = "spring_summer"
    soil_moisture_low: float = 0.10
    soil_moisture_high: float = 0.30
    wind_low_m_s: float = 2.0
    wind_high_m_s: float = 8.0

    def __post_init__(self) -> None:
        problems = value_problems(self) or set_problems(self)
        if problems:
            raise ConfigurationError(*problems)

    @property
    def wavelength_m(self) -> float:
        """Wavelength lambda [m]."""
        return SPEED_OF_LIGHT_M_S / (self.frequency_ghz * 1e9)

    @property
    def centre_incidence_rad(self) -> float:
        """Incidence angle on flat ground at the centre of the scene [rad]."""
        return math.radians(90.0 - self.depression_angle_deg)

    @property
    def slant_resolution_m(self) -> float:
        """Slant range resolution of one look, c/(2B) [m]."""
        return SPEED_OF_LIGHT_M_S / (2e6 * self.bandwidth_mhz)

    @property
    def range_spacing_m(self) -> float:
        """Spacing of the image rows [m]: the resolution on the ground, or its slant range at the centre."""
        return self.resolution_m * (1.0 if self.range_format == "ground" else math.sin(self.centre_incidence_rad))

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
        """Azimuth resolution of one look [m]: L/2, or R lambda/L of a real aperture (eq. 3-9)."""
        if self.aperture == "synthetic":
            return 0.5 * self.antenna_length_m + 0.0 * slant_range_m
        return slant_range_m * self.wavelength_m / self.antenna_length_m

    @overload
    def looks_available(self, incidence_rad: float) -> float: ...
    @overload
    def looks_available(self, incidence_rad: FloatArray) -> FloatArray: ...
    def looks_available(self, incidence_rad: float | FloatArray) -> float | FloatArray:
        """Independent samples N in a final resolution cell, a real number.

        Eq. (3-8) with the chosen cell in place of the finest: N_a = resolution/(L/2) along the track, the same for both
        apertures (a real aperture with resolution = R lambda/L gives N_a = 2 R lambda/L**2, eq. 3-9), and N_r =
        resolution/(c/(2 B sin(theta))) across. N_r is never below 1: where the range response is wider than the cell,
        a pixel still holds one sample.
        """
        across = self.resolution_m / self.ground_resolution_m(incidence_rad)
        return self.resolution_m / (0.5 * self.antenna_length_m) * np.maximum(across, 1.0)

    def looks_used(self, incidence_rad: FloatArray) -> FloatArray:
        """Samples averaged in a final cell at incidence angles [rad]: those asked for, or all."""
        available = self.looks_available(incidence_rad)
        return np.maximum(available if self.looks is None else np.minimum(available, self.looks), 1.0)

    @overload
    def received_power_w(self, sigma0: float, incidence_rad: float, slant_range_m: float) -> float: ...
    @overload
    def received_power_w(self, sigma0: float, incidence_rad: FloatArray, slant_range_m: FloatArray) -> FloatArray: ...
    def received_power_w(
        self, sigma0: float, incidence_rad: float | FloatArray, slant_range_m: float | FloatArray
    ) -> float | FloatArray:
        """Mean power of one pulse from one single-look cell of flat ground [W]: eq. (3-20)."""
        area = self.ground_resolution_m(incidence_rad) * self.azimuth_resolution_m(slant_range_m)
        return self.radar_constant_w_m2() * sigma0 * area / slant_range_m**4

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
        along = slant_range_m * self.wavelength_m / self.antenna_length_m
        return np.maximum(self.prf_hz / self.n_transmit * along / self.speed_m_s, 1.0)

    def noise_power_w(self, slant_range_m: FloatArray) -> FloatArray:
        """Noise power of one look [W], on the scale of `received_power_w`: divided by both processing gains."""
        return np.asarray(self.thermal_noise_w() / (self.compression_gain * self.coherent_pulses(slant_range_m)))

    def noise_equivalent_sigma0(self, incidence_rad: FloatArray, slant_range_m: FloatArray) -> FloatArray:
        """The sigma0 (linear) of flat ground whose mean power equals the noise power."""
        return self.noise_power_w(slant_range_m) / self.received_power_w(1.0, incidence_rad, slant_range_m)

    def ground_ranges_m(
        self, n_rows: int, cell_m: float, mean_elevation_m: float, highest_elevation_m: float
    ) -> FloatArray:
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
        float64 array (n_rows,)

        Raises
        ------
        ConfigurationError
            The flight line is too low, the swath reaches behind nadir or beyond the horizon, or pulses overlap.
        """
        height = self.altitude_m - mean_elevation_m
        centre = height / math.tan(math.radians(self.depression_angle_deg))
        y = centre + (np.arange(n_rows, dtype=np.float64) - 0.5 * (n_rows - 1)) * cell_m
        problems = swath_problems(self, y, cell_m, height, highest_elevation_m)
        if problems:
            raise ConfigurationError(*problems)
        return y


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
    given: dict[str, float | str] = {}
    problems: list[Problem] = []
    by_field = {field.name: field for field in fields(RadarConfiguration) if field.name != "channels"}
    known = [*PARAMETER_FIELDS, *(name for name in by_field if name not in PARAMETER_FIELDS.values())]
    for name, value in [*settings.items(), *(fixed or {}).items()]:
        target = PARAMETER_FIELDS.get(name, name)
        if target != "channels" and target not in by_field:
            problems.append(Problem("no such radar parameter", f"Known: {', '.join(known)}", field=name, value=value))
        elif target in given:
            problems.append(Problem("given twice", "Give it as a factor or as fixed, not both", field=name))
        else:
            given[target] = value
    names = {target: name for name, target in PARAMETER_FIELDS.items()}
    required = ["channels", *(name for name, field in by_field.items() if field.default is MISSING)]
    for name in required:
        if name not in given:
            remedy = "Make it a factor or give it under [simulator.fixed]"
            problems.append(Problem("missing", remedy, field=names.get(name, name)))
    arguments: dict[str, object] = {}
    for name, value in given.items():
        arguments[name] = _converted(name, value, problems, names.get(name, name))
    if problems:
        raise ConfigurationError(*problems)
    build: Callable[..., RadarConfiguration] = RadarConfiguration
    return build(**arguments)


def _converted(name: str, value: float | str, problems: list[Problem], shown: str) -> object:
    """Value of a field as its type; what cannot be converted is added to ``problems``."""
    if name == "channels":
        return tuple(part.strip() for part in str(value).split("+"))
    if name in TEXT_FIELDS:
        return str(value)
    try:
        if isinstance(value, bool):
            raise ValueError
        number = float(value)
    except (TypeError, ValueError):
        problems.append(Problem("not a number", "Give a number", field=shown, value=value))
        return value
    if name == "n_bits" and number == round(number):
        return int(number)
    return number
