"""The atmosphere between ground, antenna and space: loss L(f, angle), up-welling and down-welling radiation.

Total losses of dry air and vapour are those of the shipped table of nodes; they are spread over height exponentially,
cloud and rain as slabs, and every layer radiates at its own temperature. So one account gives the loss below the
antenna, the radiation of that part, and the whole sky's radiation on the ground: the terms of RSL TR 380-1 eq. (3-35).
The atmosphere is horizontally layered; slant paths follow 1/cos up to 75 deg and are held beyond.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import ArrayLike

from seqrsm.arrays import FloatArray
from seqrsm.constants import COSMIC_BACKGROUND_K
from seqrsm.scattering.models import permittivity_water_ulaby14
from seqrsm.scattering.readers import numbers_of, shipped_rows
from seqrsm.units import LN10_OVER_10

_PREFIX: Final = {"us_standard": "USstd", "midlatitude_summer": "MLS", "midlatitude_winter": "MLW"}
# Air temperature at the ground of the model atmospheres [K]; their lapse rate [K/km] follows from the nodes' mean
# radiating temperature, (T0 - tmr) / scale height of dry absorption.
_SURFACE_K: Final = {"us_standard": 288.15, "midlatitude_summer": 294.2, "midlatitude_winter": 272.2}
_LAPSE_K_KM: Final = {"us_standard": 6.5, "midlatitude_summer": 5.8, "midlatitude_winter": 4.4}
_TOP_KM: Final = 40.0
_TROPOPAUSE_KM: Final = 11.0
_DRY_SCALE_KM: Final = 4.2  # absorption goes as pressure squared: half of 8 km and a little more
_WET_SCALE_KM: Final = 2.2
_CLOUD_KM: Final = (1.0, 2.0)
_CLOUD_C: Final = 10.0
_RAIN_TOP_KM: Final = 3.0
_LARGEST_SECANT: Final = 1.0 / math.cos(math.radians(75.0))
_EDGES_KM: Final[FloatArray] = np.concatenate([np.linspace(0.0, 4.0, 81)[:-1], np.linspace(4.0, 40.0, 145)])


@dataclass(frozen=True, slots=True, eq=False)
class Atmosphere:
    """The atmosphere at one frequency."""

    depth_np: FloatArray
    """(n_layers,): optical depth of each layer at the vertical, from the ground up [Np]."""
    temperature_k: FloatArray
    """(n_layers,): physical temperature, or its Planck equivalent [K]."""
    edge_km: FloatArray
    """(n_layers + 1,): heights of the layers' edges above the ground [km]."""
    space_k: float
    """Radiation of space [K]."""
    notes: tuple[str, ...]

    def transmission(self, theta: ArrayLike, height_m: float = math.inf) -> FloatArray:
        """1 / L of the loss factor L >= 1 between the ground and an antenna so high above it [m].

        ``theta``: angle of the path from the vertical [rad].
        """
        return np.asarray(np.exp(-float(self._below(height_m).sum()) * _secant(theta)))

    def upwelling_k(self, theta: ArrayLike, height_m: float = math.inf) -> FloatArray:
        """Radiation of the air below the antenna, (1 - 1/L) T_sky of eq. (3-35) [K]; arguments as in `transmission`."""
        depth = self._below(height_m)[:, None] * _secant(theta).ravel()
        above = np.cumsum(depth[::-1], axis=0)[::-1] - depth
        out = (-np.expm1(-depth) * np.exp(-above) * self.temperature_k[:, None]).sum(axis=0)
        return np.asarray(out.reshape(np.shape(theta)))

    def sky_k(self, theta: ArrayLike) -> FloatArray:
        """Radiation of air and space that reaches the ground at zenith angles [rad], T_r of eq. (3-35) [K]."""
        depth = self.depth_np[:, None] * _secant(theta).ravel()
        below = np.cumsum(depth, axis=0) - depth
        air = (-np.expm1(-depth) * np.exp(-below) * self.temperature_k[:, None]).sum(axis=0)
        out = air + self.space_k * np.exp(-depth.sum(axis=0))
        return np.asarray(out.reshape(np.shape(theta)))

    def _below(self, height_m: float) -> FloatArray:
        """Optical depth of the part of each layer that lies below a height."""
        bottom, top = self.edge_km[:-1], self.edge_km[1:]
        return np.asarray(self.depth_np * np.clip((height_m / 1000.0 - bottom) / (top - bottom), 0.0, 1.0))


def _secant(theta: ArrayLike) -> FloatArray:
    cosine = np.maximum(np.cos(np.asarray(theta, dtype=np.float64)), 1.0 / _LARGEST_SECANT)
    return np.asarray(1.0 / cosine)


def make_atmosphere(
    frequency_ghz: float,
    *,
    atmosphere: str = "us_standard",
    weather: str = "clear",
    cloud_kg_m2: float = 0.3,
    rain_mm_h: float = 5.0,
    planck_offset_k: float = 0.0,
) -> Atmosphere:
    """Atmosphere at a frequency within the table of nodes, 0.4 to 170 GHz; "none" leaves only space.

    ``weather`` "cloud" is a slab of water from 1 to 2 km; "rain" is that cloud, and drops from the ground to 3 km. Both
    are assumed; liquid water [kg/m2] and rain rate [mm/h] are >= 0. ``planck_offset_k``: h f / k [K] to count radiation
    by Planck's law, 0 for Rayleigh-Jeans.
    """
    space = float(radiation_equivalent_k(COSMIC_BACKGROUND_K, planck_offset_k))
    if atmosphere == "none":
        return Atmosphere(np.zeros(1), np.zeros(1), np.array([0.0, _TOP_KM]), space, ("no atmosphere",))
    prefix = _PREFIX[atmosphere]
    nodes = numbers_of("atmosphere_nodes.csv", ("frequency_ghz", f"{prefix}_dry_db", f"{prefix}_wet_db"))
    # The logarithm of the loss is linear in that of the frequency between nodes.
    f, *losses = np.log(nodes).T
    dry, wet = (float(np.exp(np.interp(math.log(frequency_ghz), f, loss))) for loss in losses)
    depth_db = dry * _exponential(_DRY_SCALE_KM) + wet * _exponential(_WET_SCALE_KM)
    notes = [
        f"atmosphere {atmosphere.replace('us_', 'US ').replace('_', ' ')}, {weather}; zenith loss of its gases "
        f"{dry + wet:.3g} dB at {frequency_ghz:.3g} GHz (computed table)"
    ]
    if weather != "clear":
        depth_db = depth_db + cloud_kg_m2 * cloud_db_per_kg_m2(frequency_ghz) * _slab(*_CLOUD_KM)
        notes.append(f"cloud of {cloud_kg_m2:g} kg/m2 from 1 to 2 km at 10 C (assumed)")
    if weather == "rain":
        depth_db = depth_db + _RAIN_TOP_KM * rain_db_km(frequency_ghz, rain_mm_h) * _slab(0.0, _RAIN_TOP_KM)
        notes.append(f"rain of {rain_mm_h:g} mm/h up to 3 km, its scattering counted as absorption (assumed)")
    if frequency_ghz < 1.0:
        notes.append("radiation of the Galaxy, which counts below 1 GHz, is left out")
    middle = np.minimum(0.5 * (_EDGES_KM[:-1] + _EDGES_KM[1:]), _TROPOPAUSE_KM)
    temperature = _SURFACE_K[atmosphere] - _LAPSE_K_KM[atmosphere] * middle
    equivalent = radiation_equivalent_k(temperature, planck_offset_k)
    return Atmosphere(depth_db * LN10_OVER_10, equivalent, _EDGES_KM, space, tuple(notes))


def radiation_equivalent_k(temperature_k: ArrayLike, planck_offset_k: float) -> FloatArray:
    """Radiation of a black body at T > 0 [K] by Planck's law, x / (exp(x / T) - 1) with x = h f / k [K].

    0 for x gives T itself, the law of Rayleigh and Jeans (eq. 3-32).
    """
    temperature = np.asarray(temperature_k, dtype=np.float64)
    if planck_offset_k == 0.0:
        return temperature
    return np.asarray(planck_offset_k / np.expm1(planck_offset_k / temperature))


def _exponential(scale_km: float) -> FloatArray:
    """Share of an exponential atmosphere in each layer; all of it lies below the top."""
    inside = np.exp(-_EDGES_KM[:-1] / scale_km) - np.exp(-_EDGES_KM[1:] / scale_km)
    return np.asarray(inside / inside.sum())


def _slab(bottom_km: float, top_km: float) -> FloatArray:
    """Share of a uniform slab in each layer."""
    inside = np.minimum(_EDGES_KM[1:], top_km) - np.maximum(_EDGES_KM[:-1], bottom_km)
    return np.asarray(np.maximum(inside, 0.0) / (top_km - bottom_km))


def cloud_db_per_kg_m2(frequency_ghz: float) -> float:
    """Loss of a cloud of small drops at 10 C for its liquid water [dB m2/kg].

    Rayleigh absorption, 0.819 f / (eps'' (1 + eta**2)) dB/km for 1 g/m3 with eta = (2 + eps') / eps'' (the form of
    ITU-R P.840).
    """
    water = complex(permittivity_water_ulaby14(frequency_ghz, _CLOUD_C))
    imaginary = abs(water.imag)
    eta = (2.0 + water.real) / imaginary
    return float(0.819 * frequency_ghz / (imaginary * (1.0 + eta**2)))


def rain_db_km(frequency_ghz: float, rain_mm_h: float) -> float:
    """Specific loss of rain of a rate >= 0 [mm/h]: k R**alpha [dB/km], ITU-R P.838-3, mean of H and V.

    The value at 1 GHz holds below it.
    """
    x = math.log10(max(frequency_ghz, 1.0))
    values = [10.0 ** _regression(x, "k", p) * rain_mm_h ** _regression(x, "alpha", p) for p in ("H", "V")]
    return float(sum(values)) / len(values)


def _regression(x: float, coefficient: str, polarization: str) -> float:
    """Of log10 k, or of alpha, at x = log10(frequency / GHz)."""
    own = [
        row
        for row in shipped_rows("atmosphere_rain.csv")
        if (row.text("coefficient"), row.text("polarization")) == (coefficient, polarization)
    ]
    terms = [[float(row.text(name)) for name in "abc"] for row in own if row.text("part") == "term"]
    slope, constant = next((float(row.text("a")), float(row.text("b"))) for row in own if row.text("part") == "line")
    return sum(a * math.exp(-(((x - b) / c) ** 2)) for a, b, c in terms) + slope * x + constant
