"""Physical temperature of the ground from its exposure to the sun: RSL TR 380-1 chapter 3.3.3, 300 K to 340 K.

Exposure is the cosine of the sun's incidence on the sloping ground, zero in cast shadow and at night: 1 only for ground
square to the sun. Under cloud it is what is left of that, and light from the whole sky, which all ground gets alike.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Final

import numpy as np

from seqrsm.arrays import AnyArray, BoolArray, FloatArray
from seqrsm.scene.terrain import slopes

_DROP_M: Final = 1e-5  # effective radius of a cloud's drops, assumed
_FORWARD: Final = 0.85  # asymmetry of what they scatter of sunlight


@dataclass(frozen=True, slots=True)
class Sun:
    """Place of the sun."""

    elevation_deg: float
    """Above the horizon [deg], negative at night."""
    azimuth_deg: float
    """From north over east [deg]."""


def sun_position(latitude_deg: float, day_of_year: float, hour: float) -> Sun:
    """Place of the sun at a latitude, -90 to 90 [deg], north positive, on a day from 1 to 366 and solar time [h].

    Declination 23.45 sin(360 (284 + n) / 365) deg: Cooper 1969, Solar Energy 12(3); good to half a degree.
    """
    declination = math.radians(23.45) * math.sin(2.0 * math.pi * (284.0 + day_of_year) / 365.0)
    latitude, angle = math.radians(latitude_deg), math.radians(15.0 * (hour - 12.0))
    up = math.sin(latitude) * math.sin(declination) + math.cos(latitude) * math.cos(declination) * math.cos(angle)
    east = -math.cos(declination) * math.sin(angle)
    north = math.cos(latitude) * math.sin(declination) - math.sin(latitude) * math.cos(declination) * math.cos(angle)
    return Sun(math.degrees(math.atan2(up, math.hypot(east, north))), math.degrees(math.atan2(east, north)) % 360.0)


def cast_shadow(elevation_m: AnyArray, cell_m: float, sun: Sun) -> BoolArray:
    """Cells (rows, cols) that the sun does not reach because other ground stands before it; all at night.

    Parallel rays by the recurrence of the shadow's height, row by row (or column by column) away from the sun; between
    the cells of a row the height is linear. Nothing outside the scene casts a shadow. Elevations (rows, cols) [m] have
    row 0 in the north and no gaps.
    """
    z = np.asarray(elevation_m, dtype=np.float64)
    if sun.elevation_deg <= 0.0:
        return np.ones(z.shape, dtype=bool)
    azimuth = math.radians(sun.azimuth_deg)
    to_south, to_east = -math.cos(azimuth), math.sin(azimuth)  # towards the sun, in rows and columns
    transposed = abs(to_east) > abs(to_south)
    if transposed:
        z = z.T
        to_south, to_east = to_east, to_south
    # Walk away from the sun: it stands before row 0 of the walk.
    forward = to_south <= 0.0
    z = z if forward else z[::-1]
    shift = to_east / abs(to_south)
    fall = cell_m * math.hypot(1.0, shift) * math.tan(math.radians(sun.elevation_deg))
    dark = np.zeros(z.shape, dtype=bool)
    column = np.arange(z.shape[1], dtype=np.float64)
    height = z[0]
    for i in range(1, len(z)):
        ray = np.interp(column + shift, column, height, left=-np.inf, right=-np.inf) - fall
        dark[i] = z[i] < ray
        height = np.maximum(z[i], ray)
    dark = dark if forward else dark[::-1]
    return np.ascontiguousarray(dark.T if transposed else dark)


def sunlight_under(cloud_kg_m2: float, elevation_deg: float) -> tuple[float, float]:
    """Shares of the sun's light on level ground that come through a cloud of so much water: straight, and in all.

    The cloud's optical depth is 1.5 times its water over the density and the radius of its drops (Stephens 1978, J.
    Atmos. Sci. 35, 2111-2122); two streams without absorption (Bohren 1987, Am. J. Phys. 55, 524-533). The sun stands
    above the horizon [deg].
    """
    depth = 1.5 * cloud_kg_m2 / (1000.0 * _DROP_M)
    straight = math.exp(-depth / math.sin(math.radians(elevation_deg)))
    return straight, 2.0 / (2.0 + (1.0 - _FORWARD) * depth)


def sun_exposure(elevation_m: AnyArray, cell_m: float, sun: Sun, cloud_kg_m2: float = 0.0) -> FloatArray:
    """Exposure (rows, cols), 0 to 1: cosine of the sun's incidence, 0 in shadow; arguments as of `cast_shadow`.

    Under a cloud of so much water [kg/m2] little of the sun itself is left, and ground in its shadow has light, too.
    """
    if sun.elevation_deg <= 0.0:
        return np.zeros(np.shape(elevation_m))
    straight, in_all = sunlight_under(cloud_kg_m2, sun.elevation_deg)
    east, north = slopes(elevation_m, cell_m)
    up = math.sin(math.radians(sun.elevation_deg))
    level = math.cos(math.radians(sun.elevation_deg))
    azimuth = math.radians(sun.azimuth_deg)
    across = -level * (math.sin(azimuth) * east + math.cos(azimuth) * north) + up
    cosine = across / np.sqrt(1.0 + east**2 + north**2)
    beam = np.where(cast_shadow(elevation_m, cell_m, sun), 0.0, np.clip(cosine, 0.0, 1.0))
    return np.asarray(straight * beam + (in_all - straight) * up)


def time_exposure(
    elevation_m: AnyArray,
    cell_m: float,
    *,
    latitude_deg: float,
    day_of_year: float,
    hour: float,
    exposure_hours: float = 0.0,
    cloud_kg_m2: float = 0.0,
) -> FloatArray:
    """Exposure (rows, cols), 0 to 1, at an hour, or its mean over the ``exposure_hours`` before.

    The mean is by the middle of half-hour steps; 0 hours take the moment. Arguments as of `sun_exposure` and
    `sun_position`.
    """
    steps = math.ceil(2.0 * exposure_hours)
    hours = [hour] if steps == 0 else [hour - exposure_hours * (k + 0.5) / steps for k in range(steps)]
    suns = [sun_position(latitude_deg, day_of_year, h) for h in hours]
    total = sum(sun_exposure(elevation_m, cell_m, sun, cloud_kg_m2) for sun in suns)
    return np.asarray(total) / len(hours)
