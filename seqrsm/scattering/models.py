"""Published backscatter models, each named by quantity, author and year.

Every function works on arrays that broadcast together. Angles are incidence angles [rad] below pi/2, permittivity is
relative with a negative or positive imaginary part alike, and results are linear backscatter coefficients [1] (power
for an area) unless the name ends in ``_db``.
"""

from __future__ import annotations

from typing import NamedTuple, TypeAlias

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
    """Fresnel reflectivity of a smooth half space.

    Parameters
    ----------
    permittivity : complex
        Relative permittivity [1].
    theta : float array
        Incidence angle [rad], 0 to pi/2.
    """
    theta = np.asarray(theta, dtype=np.float64)
    cosine = np.cos(theta)
    root = np.sqrt(np.asarray(permittivity, dtype=np.complex128) - np.sin(theta) ** 2)
    h = np.abs((cosine - root) / (cosine + root)) ** 2
    v = np.abs((permittivity * cosine - root) / (permittivity * cosine + root)) ** 2
    return Reflectivity(np.asarray(h), np.asarray(v))


def backscatter_oh92(permittivity: ComplexLike, ks: ArrayLike, theta: ArrayLike) -> Backscatter:
    """Backscatter of a rough bare surface, first model of Oh, Sarabandi and Ulaby.

    Parameters
    ----------
    permittivity : complex
        Relative permittivity of the ground [1].
    ks : float array
        Wavenumber times root-mean-square height [1], 0.1 to 6; smaller values give a nearly dark surface.
    theta : float array
        Incidence angle [rad], 10 to 70 degrees.

    Notes
    -----
    Oh, Sarabandi and Ulaby 1992, "An empirical model and an inversion technique for radar scattering from bare soil
    surfaces", IEEE TGRS 30(2) (PRISM-1).
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

    Parameters
    ----------
    moisture : float array
        Volumetric soil moisture [m^3/m^3], 0.04 to 0.291.
    ks : float array
        Wavenumber times root-mean-square height [1], 0.13 to 6.98.
    theta : float array
        Incidence angle [rad], 10 to 70 degrees.

    Notes
    -----
    Oh 2004, "Quantitative retrieval of soil moisture content and surface roughness from multipolarized radar
    observations of bare soil surfaces", IEEE TGRS 42(3).
    """
    mv, ks = np.asarray(moisture, dtype=np.float64), np.asarray(ks, dtype=np.float64)
    theta = np.asarray(theta, dtype=np.float64)
    co_ratio = 1.0 - (2.0 * theta / np.pi) ** (0.35 * mv**-0.65) * np.exp(-0.4 * ks**1.4)
    cross_ratio = 0.095 * (0.13 + np.sin(1.5 * theta)) ** 1.4 * -np.expm1(-1.3 * ks**0.9)
    hv = 0.11 * mv**0.7 * np.cos(theta) ** 2.2 * -np.expm1(-0.32 * ks**1.8)
    vv = hv / cross_ratio
    return Backscatter(np.asarray(co_ratio * vv), np.asarray(hv), np.asarray(vv))


def backscatter_layer_ulaby14(
    ground: ArrayLike, ground_reflectivity: ArrayLike, albedo: ArrayLike, optical_depth: ArrayLike, theta: ArrayLike
) -> FloatArray:
    """Co-polarized backscatter of a layer of Rayleigh scatterers over rough ground (model S2RT/R).

    Parameters
    ----------
    ground : float array
        Backscatter coefficient of the ground alone [1].
    ground_reflectivity : float array
        Fresnel reflectivity of the ground at the same polarization [1].
    albedo : float array
        Single-scattering albedo of the layer [1]; the single-scattering theory holds below about 0.2.
    optical_depth : float array
        Extinction times thickness, one way and vertical [Np].
    theta : float array
        Incidence angle [rad], below pi/2.

    Notes
    -----
    Ulaby and Long 2014, "Microwave Radar and Radiometric Remote Sensing", chapter 11: diffuse upper boundary, terms for
    the ground, the layer, the layer seen by reflection, and layer-ground double reflection.
    """
    theta, a, tau = (np.asarray(x, dtype=np.float64) for x in (theta, albedo, optical_depth))
    r = np.asarray(ground_reflectivity, dtype=np.float64)
    cosine = np.cos(theta)
    two_way = np.exp(-2.0 * tau / cosine)
    volume = 0.75 * a * cosine * (1.0 - two_way) * (1.0 + r**2 * two_way)
    return np.asarray(two_way * np.asarray(ground) + volume + 6.0 * a * tau * r * two_way)


def backscatter_ulaby89_db(parameters: ArrayLike, theta: ArrayLike) -> FloatArray:
    """Mean backscatter of a terrain class [dB] by the regression of Ulaby and Dobson.

    Parameters
    ----------
    parameters : float array (6,)
        P1 to P6 of the class, band and polarization.
    theta : float array
        Incidence angle [rad], 0 to 80 degrees.

    Notes
    -----
    Ulaby and Dobson 1989, "Handbook of Radar Scattering Statistics for Terrain":
    P1 + P2 exp(-P3 t) + P4 cos(P5 t + P6).
    """
    p1, p2, p3, p4, p5, p6 = np.asarray(parameters, dtype=np.float64)
    theta = np.asarray(theta, dtype=np.float64)
    return np.asarray(p1 + p2 * np.exp(-p3 * theta) + p4 * np.cos(p5 * theta + p6))
