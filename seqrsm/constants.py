"""Physical constants, each with its unit and source.

The speed of light, the Boltzmann and the Planck constant are exact in the SI since 2019 (CODATA 2018 and later,
NIST SP 961). Derived values are computed from them here and nowhere else.
"""

from __future__ import annotations

import math
from typing import Final

SPEED_OF_LIGHT_M_S: Final = 299_792_458.0
"""Speed of light in vacuum [m/s], exact (SI)."""

BOLTZMANN_J_K: Final = 1.380_649e-23
"""Boltzmann constant [J/K], exact (SI, CODATA 2018)."""

PLANCK_J_S: Final = 6.626_070_15e-34
"""Planck constant [J s], exact (SI, CODATA 2018)."""

REFERENCE_TEMPERATURE_K: Final = 290.0
"""Temperature at which a noise figure is defined [K] (IEEE Std 100, 'noise factor')."""

COSMIC_BACKGROUND_K: Final = 2.725_48
"""Temperature of the cosmic microwave background [K] (Fixsen 2009, doi 10.1088/0004-637X/707/2/916)."""

EARTH_RADIUS_M: Final = 6_371_008.8
"""Mean radius of the Earth [m] (GRS 80, Moritz 2000, R1)."""

EARTH_GM_M3_S2: Final = 3.986_004_418e14
"""Gravitational constant times mass of the Earth [m3/s2] (IERS Conventions 2010, Table 1.1)."""


def wavenumber_rad_m(frequency_ghz: float) -> float:
    """Wavenumber in vacuum [rad/m] at a frequency [GHz]."""
    return 2.0 * math.pi * (frequency_ghz * 1e9) / SPEED_OF_LIGHT_M_S
