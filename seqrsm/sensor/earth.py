"""Distances and angles between a flight line and flat ground at a given ground range, on a sphere or on a plane.

On the sphere the elements are those of the plane with other numbers: with D the chord that stands for the ground range,
R**2 = D**2 + H**2 at the datum, and an element at height z over the datum is seen as on a plane whose antenna stands
``up_m - z`` over the element's own horizontal and ``along_m`` away along it. So one set of kernels serves both.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Final

import numpy as np

from seqrsm.arrays import FloatArray
from seqrsm.constants import EARTH_RADIUS_M

LOWEST_ORBIT_M: Final = 120e3


@dataclass(frozen=True, slots=True, eq=False)
class RangeGeometry:
    """What the ground range on the datum determines; every array has its shape."""

    ground_range_m: FloatArray
    """Arc on the datum from the point under the antenna [m]."""
    slant_range_m: FloatArray
    """From the antenna to the datum [m]."""
    chord_m: FloatArray
    """D, with slant range**2 = D**2 + height**2 [m]; the ground range itself on a plane."""
    chord_per_m: FloatArray
    """Derivative of `chord_m` with respect to the ground range."""
    along_m: FloatArray
    up_m: FloatArray
    """Distance and height of the antenna along and over the local horizontal [m]."""
    turn_rad: FloatArray
    """Angle between the local vertical and that under the antenna [rad]; 0 on a plane."""

    @property
    def incidence_rad(self) -> FloatArray:
        """Angle at the ground from the local vertical to the antenna [rad]; worked out at each call."""
        return np.asarray(np.arctan2(self.along_m, self.up_m))

    @property
    def look_rad(self) -> FloatArray:
        """Angle at the antenna from its vertical to the ground [rad]; worked out at each call."""
        return self.incidence_rad - self.turn_rad


def range_geometry(ground_range_m: FloatArray, height_m: float, curved: bool) -> RangeGeometry:
    """Geometry of flat ground at ground ranges, arcs on the datum [m] that are negative behind nadir.

    The antenna stands > 0 over the datum [m], a sphere of the Earth's mean radius or a plane.
    """
    arc = np.asarray(ground_range_m, dtype=np.float64)
    if not curved:
        slant, up = np.sqrt(arc * arc + height_m * height_m), np.full_like(arc, height_m)
        return RangeGeometry(arc, slant, arc, np.ones_like(arc), arc, up, np.zeros_like(arc))
    radius = EARTH_RADIUS_M
    half = 0.5 * arc / radius
    scale = math.sqrt(radius * (radius + height_m))
    turn = 2.0 * half
    chord = 2.0 * scale * np.sin(half)
    chord2 = chord * chord
    return RangeGeometry(
        ground_range_m=arc,
        slant_range_m=np.sqrt(chord2 + height_m * height_m),
        chord_m=chord,
        chord_per_m=scale / radius * np.cos(half),
        along_m=(radius + height_m) * np.sin(turn),
        up_m=height_m - chord2 / (2.0 * radius),
        turn_rad=turn,
    )


def slant_range_of_ground(ground_range_m: float, height_m: float, curved: bool) -> float:
    """Slant range [m] of the datum at one ground range [m]; `range_geometry` of many."""
    chord = ground_range_m
    if curved:
        radius = EARTH_RADIUS_M
        chord = 2.0 * math.sqrt(radius * (radius + height_m)) * math.sin(0.5 * ground_range_m / radius)
    return math.hypot(chord, height_m)


def ground_range_of_slant(slant_range_m: FloatArray, height_m: float, curved: bool) -> FloatArray:
    """Ground range [m] of the datum at a slant range [m]; 0 for ranges shorter than the height."""
    slant = np.asarray(slant_range_m, dtype=np.float64)
    chord = np.sqrt(np.maximum((slant - height_m) * (slant + height_m), 0.0))
    if not curved:
        return chord
    scale = 2.0 * math.sqrt(EARTH_RADIUS_M * (EARTH_RADIUS_M + height_m))
    return np.asarray(2.0 * EARTH_RADIUS_M * np.arcsin(np.minimum(chord / scale, 1.0)))


def ground_share(altitude_m: float, curved: bool) -> float:
    """Way over ground of each metre that a satellite at an altitude [m] moves in space, R / (R + h).

    1 of a plane and below orbits, where it would be 0.997 at 20 km. It is that of the ground below the satellite:
    beside it the way is shorter by the cosine of the angle between both, 0.998 at an incidence of 35 deg from 700 km.
    """
    return EARTH_RADIUS_M / (EARTH_RADIUS_M + altitude_m) if curved and altitude_m > LOWEST_ORBIT_M else 1.0


def incidence_of_look(look_rad: float, height_m: float, curved: bool) -> float:
    """Incidence angle [rad] where a ray at a look angle [rad] meets the datum; nan where it passes the horizon."""
    if not curved:
        return look_rad
    sine = (EARTH_RADIUS_M + height_m) / EARTH_RADIUS_M * math.sin(look_rad)
    return math.asin(sine) if sine < 1.0 else math.nan


def ground_range_of_look(look_rad: float, height_m: float, curved: bool) -> float:
    """Ground range [m] where a ray at a look angle [rad] meets the datum; nan where it passes the horizon."""
    if not curved:
        return height_m * math.tan(look_rad)
    return EARTH_RADIUS_M * (incidence_of_look(look_rad, height_m, curved) - look_rad)


def horizon_ground_range_m(height_m: float) -> float:
    """Ground range of the horizon [m]."""
    return EARTH_RADIUS_M * math.acos(EARTH_RADIUS_M / (EARTH_RADIUS_M + height_m))
