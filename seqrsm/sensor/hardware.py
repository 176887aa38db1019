"""Whether a side-looking radar could be built: what ties its parameters in fact, each with its margin.

`seqrsm.sensor.radar` refuses what contradicts itself. Here is what a drawing board would refuse: pulses that come back
mixed (RSL TR 380-1, section 3.2; area of the antenna: Freeman et al. 2000, IEEE Trans. Geosci. Remote Sensing 38(1),
320-324), more gain than the beam leaves (4 pi over its solid angle), and flight lines that nothing flies.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Final

import numpy as np

from seqrsm.constants import EARTH_GM_M3_S2, EARTH_RADIUS_M, SPEED_OF_LIGHT_M_S
from seqrsm.sensor.earth import LOWEST_ORBIT_M, range_geometry
from seqrsm.sensor.radar import RadarConfiguration
from seqrsm.units import db_to_linear

ASSUMED_BITS: Final = 4
"""Of each of I and Q where there is no converter, as RADARSAT-1's."""

_SAMPLES_A_HERTZ: Final = 1.15  # from 1.07 (RADARSAT-1) to 1.22 (ERS) flew
_GAIN_MARGIN: Final = 0.5
"""Gain is held against its limit to half, since beams are given to their half power and shapes differ."""


@dataclass(frozen=True, slots=True)
class Limit:
    """One rule."""

    name: str

    margin: float
    """What there is over what is needed; below 1 no such radar can be built."""
    text: str
    """The numbers."""


def orbit_speed_m_s(altitude_m: float) -> float:
    """Ground speed [m/s] of a satellite on a circular orbit at an altitude [m], the Earth standing still."""
    orbit_m = EARTH_RADIUS_M + altitude_m
    return math.sqrt(EARTH_GM_M3_S2 / orbit_m) * EARTH_RADIUS_M / orbit_m


def data_rate_bit_s(radar: RadarConfiguration, near_m: float, far_m: float) -> float:
    """Rate of a swath's raw data [bit/s]: samples of a pulse's echo, two numbers each, times pulses a second.

    The echo lasts as long as the swath is deep, and the pulse; every pulse is received in all channels that its
    transmit polarization has (Curlander and McDonough 1991, Synthetic Aperture Radar: Systems and Signal Processing,
    chapter 6). Bits are those of the converter, or 4 (assumed) where it has none; no headers, no compression.
    ``near_m`` and ``far_m`` are ground ranges from the point under the antenna.
    """
    near, far = range_geometry(np.array([max(near_m, 0.0), far_m]), radar.altitude_m, radar.curved).slant_range_m
    echo_s = 2.0 * float(far - near) / SPEED_OF_LIGHT_M_S + 1e-6 * radar.pulse_length_us
    samples = _SAMPLES_A_HERTZ * 1e6 * radar.bandwidth_mhz * echo_s
    received = len(radar.recorded) / radar.n_transmit
    return 2.0 * (radar.adc_bits or ASSUMED_BITS) * samples * received * radar.prf_hz


def limits(radar: RadarConfiguration, near_m: float, far_m: float) -> tuple[Limit, ...]:
    """The rules for a radar whose swath reaches over these ground ranges [m]; none for a rotating antenna.

    Ranges are from the point under the antenna.
    """
    if radar.scan == "ppi":
        return ()
    edges = range_geometry(np.array([max(near_m, 0.0), far_m]), radar.altitude_m, radar.curved)
    (near_slant, far_slant), (near_look, far_look) = edges.slant_range_m, edges.look_rad
    window_m = 0.5 * SPEED_OF_LIGHT_M_S * (1.0 / radar.prf_hz - 1e-6 * radar.pulse_length_us)
    depth_m = max(float(far_slant - near_slant), 1e-9)
    told = f"{radar.prf_hz:g} pulses a second tell {1e-3 * window_m:.3g} km of slant range apart"
    found = [
        Limit("swath against pulse rate", window_m / depth_m, f"{told}, the swath is {1e-3 * depth_m:.3g} km deep")
    ]
    gain, width = float(db_to_linear(radar.antenna_gain_db)), radar.azimuth_beamwidth_rad
    isotropic = radar.elevation_pattern == "isotropic"
    height = float(far_look - near_look) if isotropic else math.radians(radar.elevation_beamwidth_deg)
    most = 4.0 * math.pi / (width * height) / _GAIN_MARGIN
    told = f"a beam of {math.degrees(height):.3g} by {math.degrees(width):.3g} deg has at most"
    told += f" {10.0 * math.log10(most):.1f} dB, 3 dB of it for its shape; specified are {radar.antenna_gain_db:g} dB"
    found.append(Limit("gain against beam", most / gain, told))
    if radar.aperture == "synthetic":
        area = gain * radar.wavelength_m**2 / (4.0 * math.pi)
        path = 0.5 * float(near_slant + far_slant) * math.tan(radar.centre_incidence_rad)
        in_space_m_s = radar.speed_m_s / radar.ground_share
        needed = radar.n_transmit * 4.0 * in_space_m_s * radar.wavelength_m * path / SPEED_OF_LIGHT_M_S
        told = f"a gain of {radar.antenna_gain_db:g} dB is {area:.3g} m2 of antenna; ambiguities allow no less than "
        told += f"{needed:.3g} m2"
        found.append(Limit("antenna area against ambiguities", area / needed, told))
    if radar.altitude_m > LOWEST_ORBIT_M:
        orbit = orbit_speed_m_s(radar.altitude_m)
        margin = min(radar.speed_m_s / orbit, orbit / radar.speed_m_s) / 0.9
        told = f"a satellite at {1e-3 * radar.altitude_m:.4g} km moves at {orbit:.0f} m/s over the ground"
        found.append(Limit("speed against orbit", margin, f"{told}, not at {radar.speed_m_s:g} m/s"))
    return tuple(found)
