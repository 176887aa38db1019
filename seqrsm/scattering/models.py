"""Published models of permittivity, reflectivity and backscatter, each named by quantity, author and year.

Every function works on arrays that broadcast together. Angles are incidence angles [rad] below pi/2. Permittivity is
relative, with a positive imaginary part for loss; models of backscatter take a negative one alike. Results are linear
backscatter coefficients [1] (power for an area) unless the name ends in ``_db``.
"""

from __future__ import annotations

from typing import Final, NamedTuple, TypeAlias

import numpy as np
from numpy.typing import ArrayLike, NDArray

from seqrsm.arrays import FloatArray

ComplexLike: TypeAlias = complex | NDArray[np.complex128]


class Reflectivity(NamedTuple):
    """Power reflectivity of a smooth surface at horizontal and at vertical polarization [1]."""

    h: FloatArray
    v: FloatArray


class Backscatter(NamedTuple):
    """Backscatter coefficients at HH, HV and VV polarization [1]."""

    hh: FloatArray
    hv: FloatArray
    vv: FloatArray


def reflectivity_fresnel(permittivity: ComplexLike, theta: ArrayLike) -> Reflectivity:
    """Fresnel reflectivity of a smooth half space at angles of 0 to pi/2."""
    theta = np.asarray(theta, dtype=np.float64)
    cosine = np.cos(theta)
    root = np.sqrt(np.asarray(permittivity, dtype=np.complex128) - np.sin(theta) ** 2)
    h = np.abs((cosine - root) / (cosine + root)) ** 2
    v = np.abs((permittivity * cosine - root) / (permittivity * cosine + root)) ** 2
    return Reflectivity(np.asarray(h), np.asarray(v))


def backscatter_oh92(permittivity: ComplexLike, ks: ArrayLike, theta: ArrayLike) -> Backscatter:
    """Backscatter of a rough bare surface, first model of Oh, Sarabandi and Ulaby.

    Holds for wavenumbers times root-mean-square height, ``ks``, of 0.1 to 6 (smaller values give a nearly dark surface)
    and from 10 to 70 deg. Oh, Sarabandi and Ulaby 1992, "An empirical model and an inversion technique for radar
    scattering from bare soil surfaces", IEEE TGRS 30(2) (PRISM-1).
    """
    ks, theta = np.asarray(ks, dtype=np.float64), np.asarray(theta, dtype=np.float64)
    nadir = reflectivity_fresnel(permittivity, 0.0).h
    surface = reflectivity_fresnel(permittivity, theta)
    co_ratio = (1.0 - (2.0 * theta / np.pi) ** (1.0 / (3.0 * nadir)) * np.exp(-ks)) ** 2
    cross_ratio = 0.23 * np.sqrt(nadir) * -np.expm1(-ks)
    g = 0.7 * -np.expm1(-0.65 * ks**1.8)
    vv = g * np.cos(theta) ** 3 / np.sqrt(co_ratio) * (surface.v + surface.h)
    return Backscatter(np.asarray(co_ratio * vv), np.asarray(cross_ratio * vv), np.asarray(vv))


def backscatter_oh04(moisture: ArrayLike, ks: ArrayLike, theta: ArrayLike) -> Backscatter:
    """Backscatter of bare soil from its moisture and roughness, last model of Oh.

    Holds for a volumetric moisture of 0.04 to 0.291 [m^3/m^3], wavenumbers times root-mean-square height, ``ks``, of
    0.13 to 6.98, and from 10 to 70 deg. Oh 2004, "Quantitative retrieval of soil moisture content and surface roughness
    from multipolarized radar observations of bare soil surfaces", IEEE TGRS 42(3).
    """
    mv, ks = np.asarray(moisture, dtype=np.float64), np.asarray(ks, dtype=np.float64)
    theta = np.asarray(theta, dtype=np.float64)
    co_ratio = 1.0 - (2.0 * theta / np.pi) ** (0.35 * mv**-0.65) * np.exp(-0.4 * ks**1.4)
    cross_ratio = 0.095 * (0.13 + np.sin(1.5 * theta)) ** 1.4 * -np.expm1(-1.3 * ks**0.9)
    hv = 0.11 * mv**0.7 * np.cos(theta) ** 2.2 * -np.expm1(-0.32 * ks**1.8)
    vv = hv / cross_ratio
    return Backscatter(np.asarray(co_ratio * vv), np.asarray(hv), np.asarray(vv))


def soil_response_baghdadi16(theta: ArrayLike) -> tuple[FloatArray, FloatArray]:
    """What moisture and roughness do to the backscatter of bare soil at angles (...) [rad], from 18 to 57 deg.

    Change of HH, HV and VV (3, ...) with volumetric moisture [dB per m^3/m^3], and with the root-mean-square height [dB
    per factor of ten]. Baghdadi et al. 2016, "A new empirical model for radar scattering from bare soil surfaces",
    Remote Sensing 8(11), 920: ``10^(g mv cot t) (k s)^(h sin t)``, mv in percent, fitted to images of farmed fields in
    L, C and X band.
    """
    theta = np.asarray(theta, dtype=np.float64)
    by_moisture, by_height = (np.reshape(one, (3, *(1,) * theta.ndim)) for one in ((0.9, 1.1, 0.8), (8.6, 4.4, 7.1)))
    return 10.0 * by_moisture / np.tan(theta), by_height * np.sin(theta)


def backscatter_layer_ulaby14(
    ground: ArrayLike, ground_reflectivity: ArrayLike, albedo: ArrayLike, optical_depth: ArrayLike, theta: ArrayLike
) -> FloatArray:
    """Co-polarized backscatter of a layer of Rayleigh scatterers over rough ground (model S2RT/R).

    Of the ground alone, its backscatter and Fresnel reflectivity at the same polarization; of the layer, its
    single-scattering albedo, below about 0.2, and extinction times thickness, one way and vertical [Np]. Ulaby and Long
    2014, "Microwave Radar and Radiometric Remote Sensing", chapter 11: diffuse upper boundary, terms for the ground,
    the layer, the layer seen by reflection, and layer-ground double reflection.
    """
    theta, a, tau = (np.asarray(x, dtype=np.float64) for x in (theta, albedo, optical_depth))
    r = np.asarray(ground_reflectivity, dtype=np.float64)
    cosine = np.cos(theta)
    two_way = np.exp(-2.0 * tau / cosine)
    volume = 0.75 * a * cosine * (1.0 - two_way) * (1.0 + r**2 * two_way)
    return np.asarray(two_way * np.asarray(ground) + volume + 6.0 * a * tau * r * two_way)


def backscatter_ulaby89_db(parameters: ArrayLike, theta: ArrayLike) -> FloatArray:
    """Mean backscatter of a terrain class [dB] by the regression of Ulaby and Dobson, from 0 to 80 deg.

    P1 + P2 exp(-P3 t) + P4 cos(P5 t + P6), with P1 to P6 of the class, band and polarization: Ulaby and Dobson 1989,
    "Handbook of Radar Scattering Statistics for Terrain".
    """
    p1, p2, p3, p4, p5, p6 = np.asarray(parameters, dtype=np.float64)
    theta = np.asarray(theta, dtype=np.float64)
    return np.asarray(p1 + p2 * np.exp(-p3 * theta) + p4 * np.cos(p5 * theta + p6))


_VACUUM_F_M: Final = 8.854e-12  # as in the soil model's own constants
_ALPHA: Final = 0.65
_QUARTZ_DENSITY: Final = 2.65
_SAND, _CLAY = 0.3, 0.3  # mass fractions of loam
_DENSITY: Final = 1.7  # of the dry soil [g/cm^3]
_SOIL_C: Final = 23.0
_SMOOTH_GHZ: Final = (1.3, 5.0)


def permittivity_water_ulaby14(frequency_ghz: ArrayLike, temperature_c: ArrayLike) -> NDArray[np.complex128]:
    """Permittivity of pure water at 0.1 to 1000 GHz and 0 to 30 deg C by a double Debye spectrum.

    Ulaby and Long 2014, "Microwave Radar and Radiometric Remote Sensing", section 4-1.
    """
    f, t = np.asarray(frequency_ghz, dtype=np.float64), np.asarray(temperature_c, dtype=np.float64)
    static = 87.85306 * np.exp(-0.00456992 * t)
    middle = 0.63000075e1 * np.exp(-0.26242021e-2 * t)
    high = 0.37245044e1 + 0.92609781e-2 * t
    slow_ns = 0.17667420e-3 * np.exp(0.58366888e3 / (t + 0.12634992e3))
    fast_ns = 0.69227972e-4 * np.exp(0.30742330e3 / (t + 0.12634992e3))
    debye = (static - middle) / (1.0 - 2j * np.pi * f * slow_ns) + (middle - high) / (1.0 - 2j * np.pi * f * fast_ns)
    return np.asarray(debye + high, dtype=np.complex128)


def permittivity_soil(frequency_ghz: ArrayLike, moisture: ArrayLike) -> NDArray[np.complex128]:
    """Permittivity of moist loam without the published model's step at 1.3 GHz, which is 2.4 in the imaginary part.

    From 1.3 to 5 GHz the effective conductivity goes over from that of Peplinski 1995 to that of Dobson 1985 along the
    logarithm of frequency (assumed). Elsewhere it is `permittivity_soil_dobson85`. Real soil has no such step: the
    model of Mironov, Kosolapova and Fomin 2009, IEEE TGRS 47(7), which holds at all these frequencies, has none.
    """
    f = np.asarray(frequency_ghz, dtype=np.float64)
    return permittivity_soil_dobson85(f, moisture, np.asarray(np.interp(np.log(f), np.log(_SMOOTH_GHZ), (0.0, 1.0))))


def permittivity_soil_dobson85(
    frequency_ghz: ArrayLike, moisture: ArrayLike, share: ArrayLike
) -> NDArray[np.complex128]:
    """Permittivity of moist loam, semi-empirical mixing model, at 0.3 to 18 GHz and moistures above 0 [m^3/m^3].

    ``share`` is of the conductivity of Dobson, the rest that of Peplinski; as published 0 below 1.3 GHz and 1 from
    there on. Dobson, Ulaby, Hallikainen and El-Rayes 1985, IEEE TGRS 23(1); below 1.3 GHz the conductivity of
    Peplinski, Ulaby and Dobson 1995, IEEE TGRS 33(3). The imaginary part has no power 1/alpha, as in Ulaby and Long
    2014 section 4-8. Free water: Debye with the relaxation time of Stogryn 1971.
    """
    f, mv = np.asarray(frequency_ghz, dtype=np.float64), np.asarray(moisture, dtype=np.float64)
    low = 0.0467 + 0.22 * _DENSITY - 0.411 * _SAND + 0.661 * _CLAY
    high = -1.645 + 1.939 * _DENSITY - 2.256 * _SAND + 1.594 * _CLAY
    conductivity = (1.0 - np.asarray(share)) * low + np.asarray(share) * high
    water_real, water_imag = _free_water_stogryn71(f, _SOIL_C)
    pore = (_QUARTZ_DENSITY - _DENSITY) / (_QUARTZ_DENSITY * mv)
    water_imag = water_imag + pore * conductivity / (2.0 * np.pi * _VACUUM_F_M * f * 1e9)
    b_real = 1.27 - 0.519 * _SAND - 0.152 * _CLAY
    b_imag = 2.06 - 0.928 * _SAND - 0.255 * _CLAY
    real = (1.0 + 0.66 * _DENSITY + mv**b_real * water_real**_ALPHA - mv) ** (1.0 / _ALPHA)
    return np.asarray(real + 1j * mv**b_imag * water_imag, dtype=np.complex128)


def _free_water_stogryn71(frequency_ghz: FloatArray, t: float) -> tuple[FloatArray, FloatArray]:
    """Real and imaginary permittivity of the free water in soil at ``t`` [deg C]."""
    static = 88.045 - 0.4147 * t + 6.295e-4 * t**2 + 1.075e-5 * t**3
    relaxation = (1.1109e-10 - 3.824e-12 * t + 6.938e-14 * t**2 - 5.096e-16 * t**3) * frequency_ghz * 1e9
    fall = (static - 4.9) / (1.0 + relaxation**2)
    return 4.9 + fall, relaxation * fall


def permittivity_wet_snow_hallikainen86(
    frequency_ghz: ArrayLike, dry_density_g_cm3: float, water_percent: float
) -> NDArray[np.complex128]:
    """Permittivity of wet snow at 3 to 37 GHz, modified Debye-like model.

    Density without the water 0.09 to 0.38 [g/cm^3], water by volume 1 to 12 [percent]. Hallikainen, Ulaby and
    Abdelrazik 1986, IEEE TAP 34(11).
    """
    f = np.asarray(frequency_ghz, dtype=np.float64)
    a1 = 0.78 + 0.03 * f - 0.58e-3 * f**2
    a2 = 0.97 - 0.39e-2 * f + 0.39e-3 * f**2
    b1 = 0.31 - 0.05 * f + 0.87e-3 * f**2
    a = a1 * (1.0 + 1.83 * dry_density_g_cm3 + 0.02 * water_percent**1.015) + b1
    wet = water_percent**1.31
    ratio = f / 9.07
    real = a + 0.073 * a1 * wet / (1.0 + ratio**2)
    imaginary = 0.073 * a2 * ratio * wet / (1.0 + ratio**2)
    return np.asarray(real + 1j * imaginary, dtype=np.complex128)
