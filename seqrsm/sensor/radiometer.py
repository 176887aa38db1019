"""Scanning radiometer: the seven passive parameters of RSL TR 380-1 Table 1, the rest of the set, and its noise.

The final resolution is the side of the square footprint at nadir; altitude turns it into the antenna's half-power
beamwidth. On a cone it is the square of the same area as the ellipse's two diameters make. What the scan makes of
period, speed, beam and integration time is in `seqrsm.sensor.scan`.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import partial
from typing import Final, Literal

import numpy as np

from seqrsm.arrays import FloatArray
from seqrsm.constants import BOLTZMANN_J_K, EARTH_RADIUS_M, PLANCK_J_S, SPEED_OF_LIGHT_M_S
from seqrsm.errors import ConfigurationError, Problem
from seqrsm.sensor.parameters import RADIOMETER, configured, value_problems

CHANNELS: Final = RADIOMETER["polarization"].levels
"""Polarization channels in the order of every draw."""


@dataclass(frozen=True, slots=True)
class RadiometerConfiguration:
    """One scanning radiometer on one flight line over the middle of the scene.

    The defaults stand for a light airborne imager; they are choices, not data of a certain set. What each field is, its
    unit, limits and levels stand in ``data/parameters.csv``. More is to be said of some:

    * Each of ``channels`` has a receiver of its own.
    * ``resolution_m`` is that of the half-power beam on the ground; of a conical scan the root of the product of its
      two diameters.
    * ``noise_temperature_k`` is referred to the antenna terminals; the system's is this plus the antenna temperature.
    * ``scan_period_s`` makes two image lines, a turn of a conical scan one.
    * ``conical_incidence_deg`` is the same everywhere. Each turn draws an arc ahead of the craft, of which the scene
      sees the middle.
    * ``beam`` "sidelobes" is (sin x / x)**2 of a uniformly lit antenna.
    * ``antenna_limit_m`` refuses a finer beam. By default a large antenna is only noted.
    * ``gaps``: where sweeps leave ground unseen at nadir, score what is recorded, or refuse. ``overlap``: where a
      footprint at nadir holds two sweeps or more, average as many as it holds into one line of the image, with less
      noise and a line wider by up to a half, or make each a line of its own.
    * ``radiation`` "auto" is Rayleigh-Jeans unless its error over the scene exceeds the radiometric resolution.
    * ``weather``: `seqrsm.scattering.atmosphere.make_atmosphere`. Cloud and rain take most of the sun's heating.
    * ``temperature`` of the ground is by exposure to the sun, `temperature_low_k` everywhere, or the layer of the data
      base.
    * Mean soil moisture of a run is uniform between its ends; each field departs by a draw of its own and by one that
      neighbouring fields share. Famiglietti et al. 2008 (Water Resour. Res. 44, W01423) found 0.036 m3/m3 within 2.5 m
      and 0.071 within 50 km; the defaults give 0.06 over some kilometres. A data base with moisture of its own takes
      the place of what they share.

    Raises
    ------
    ConfigurationError
        Impossible or contradicting values, all at once, with the numbers.
    """

    frequency_ghz: float
    channels: tuple[str, ...]
    resolution_m: float
    integration_time_ms: float
    bandwidth_mhz: float
    noise_temperature_k: float
    scan_period_s: float
    altitude_m: float
    speed_m_s: float = 70.0
    scan_half_angle_deg: float = 0.0
    conical_incidence_deg: float = 0.0
    heading_deg: float = 90.0
    receiver: Literal["total_power", "dicke", "correlation"] = "total_power"
    reference_temperature_k: float = 300.0
    gain_fluctuation: float = 0.0
    beam: Literal["gaussian", "box", "sidelobes", "measured"] = "gaussian"
    beam_file: str = ""
    antenna_limit_m: float = 1000.0
    gaps: Literal["record", "refuse"] = "record"
    overlap: Literal["average", "nearest"] = "average"
    radiation: Literal["auto", "rayleigh_jeans", "planck"] = "auto"
    atmosphere: str = "us_standard"
    weather: str = "clear"
    cloud_kg_m2: float = 0.3
    rain_mm_h: float = 5.0
    temperature: Literal["exposure", "constant", "layer"] = "exposure"
    temperature_low_k: float = 300.0
    temperature_high_k: float = 340.0
    temperature_date_sd_k: float = 3.0
    temperature_field_sd_k: float = 1.0
    latitude_deg: float = 40.0
    day_of_year: float = 172.0
    hour: float = 12.0
    exposure_hours: float = 0.0
    soil_moisture_low: float = 0.10
    soil_moisture_high: float = 0.30
    soil_moisture_field_sd: float = 0.04
    soil_moisture_region_sd: float = 0.045
    soil_moisture_region_m: float = 1000.0

    def __post_init__(self) -> None:
        problems = value_problems(RADIOMETER, self) or _set_problems(self)
        if problems:
            raise ConfigurationError(*problems)

    @property
    def wavelength_m(self) -> float:
        """Wavelength lambda [m]."""
        return SPEED_OF_LIGHT_M_S / (self.frequency_ghz * 1e9)

    @property
    def planck_offset_k(self) -> float:
        """The frequency as a temperature, h f / k [K]; half of it is what Rayleigh-Jeans errs by for warm ground."""
        return PLANCK_J_S * self.frequency_ghz * 1e9 / BOLTZMANN_J_K

    @property
    def planck_used_k(self) -> float:
        """`planck_offset_k` where radiation is to follow Planck's law, else 0: see `radiation`."""
        errs = self.radiation == "auto" and 0.5 * self.planck_offset_k > float(self.nedt_k(300.0))
        return self.planck_offset_k if errs or self.radiation == "planck" else 0.0

    @property
    def conical(self) -> bool:
        """Whether it scans on a cone, not across the track."""
        return self.conical_incidence_deg > 0.0

    @property
    def quarter_turns(self) -> int:
        """``numpy.rot90(layer, quarter_turns)`` turns a scene layer into rows that the beam is pointed across."""
        # From the left edge to the right of a sweep, from the near end to the far of what a cone looks ahead to.
        return round((self.heading_deg - 90.0) / 90.0) - self.conical

    @property
    def footprint_m(self) -> tuple[float, float]:
        """Half-power width of a round beam on the ground, in the direction of view and square to it [m]."""
        stretch = math.sqrt(math.cos(math.radians(self.conical_incidence_deg)))
        return self.resolution_m / stretch, self.resolution_m * stretch

    def reach_m(self, height_m: float) -> tuple[float, float]:
        """Length of the beam from a height [m] to the ground, and how far from the point below it meets it [m].

        Over a sphere, sin(look) = R / (R + h) sin(incidence).
        """
        incidence = math.radians(self.conical_incidence_deg)
        look = math.asin(EARTH_RADIUS_M / (EARTH_RADIUS_M + height_m) * math.sin(incidence))
        radius = EARTH_RADIUS_M * math.sin(incidence - look)
        return (radius / math.sin(look) if look > 0.0 else height_m), radius

    def beamwidth_rad(self, height_m: float) -> float:
        """Half-power beamwidth [rad] that gives the footprint from a height [m]."""
        return 2.0 * math.atan(0.5 * self.footprint_m[1] / self.reach_m(height_m)[0])

    def antenna_m(self, height_m: float) -> float:
        """Length of the antenna with that beam [m]: 1.22 lambda / beamwidth, a common taper of the aperture."""
        return 1.22 * self.wavelength_m / self.beamwidth_rad(height_m)

    def nedt_k(self, antenna_k: FloatArray | float) -> FloatArray:
        """Radiometric resolution: standard deviation of one footprint's temperature [K] at an antenna temperature [K].

        From the variance of the detected power of Gaussian noise in 2 B tau independent samples (Tiuri 1964, Radio
        astronomy receivers, IEEE Trans. Military Electronics 8), T_A that of the antenna:

        * total power: T_sys**2 / (B tau) + (T_sys dG/G)**2, T_sys = T_A + T_N;
        * Dicke, half the time on the load: 2 (T_sys**2 + T_load**2) / (B tau) + ((T_A - T_ref) dG/G)**2;
        * correlation of two receivers behind a hybrid with a load: 2 (T_mean**2 + ((T_A - T_ref) / 2)**2) / (B tau) +
          ((T_A - T_ref) dG/G)**2, T_mean = (T_A + T_ref) / 2 + T_N.
        """
        antenna = np.asarray(antenna_k, dtype=np.float64)
        system = antenna + self.noise_temperature_k
        load = self.reference_temperature_k + self.noise_temperature_k
        difference = antenna - self.reference_temperature_k
        if self.receiver == "total_power":
            white, slow = system**2, system
        elif self.receiver == "dicke":
            white, slow = 2.0 * (system**2 + load**2), difference
        else:
            white, slow = 2.0 * ((0.5 * (system + load)) ** 2 + (0.5 * difference) ** 2), difference
        samples = self.bandwidth_mhz * 1e3 * self.integration_time_ms
        return np.asarray(np.sqrt(white / samples + (slow * self.gain_fluctuation) ** 2))


def _set_problems(radiometer: RadiometerConfiguration) -> list[Problem]:
    """Every contradiction between values that are possible alone."""
    problems = []
    if radiometer.bandwidth_mhz >= 1e3 * radiometer.frequency_ghz:
        remedy = f"Keep it below the frequency, {1e3 * radiometer.frequency_ghz:g} MHz"
        problems.append(Problem("larger than the frequency", remedy, field="bandwidth", value=radiometer.bandwidth_mhz))
    if radiometer.bandwidth_mhz * 1e3 * radiometer.integration_time_ms < 1.0:
        text = "bandwidth x integration time holds less than one independent sample"
        problems.append(Problem(text, "Increase the integration time", field="integration_time"))
    for low, high in (("temperature_low_k", "temperature_high_k"), ("soil_moisture_low", "soil_moisture_high")):
        if getattr(radiometer, low) > getattr(radiometer, high):
            problems.append(Problem("above the high end", f"Keep it at or below {high}", field=low))
    if radiometer.conical and radiometer.scan_half_angle_deg > 0.0:
        text = "a conical scan has no half angle"
        problems.append(Problem(text, "Leave out scan_half_angle_deg", field="conical_incidence_deg"))
    if radiometer.beam == "measured" and not radiometer.beam_file:
        problems.append(Problem("missing", "Name the CSV file of the measured pattern", field="beam_file"))
    return problems


from_settings: Final = partial(configured, "radiometer", RadiometerConfiguration, RADIOMETER)
"""Radiometer of one point of a design, its ``settings`` and ``fixed``: see `seqrsm.sensor.parameters.configured`."""
