"""Antenna patterns in elevation and the loss of the atmosphere: what multiplies eq. (3-20) from one angle to another.

RSL TR 380-1 Table 2: antenna pattern factor in range direction, atmospheric losses. Patterns are one-way power relative
to the peak, which is the antenna gain.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Final, Literal

import numpy as np

from seqrsm.arrays import FloatArray
from seqrsm.constants import EARTH_RADIUS_M
from seqrsm.errors import ConfigurationError

ElevationPattern = Literal["isotropic", "cosecant_squared", "sinc_squared", "table"]

PATTERN_FLOOR_DB: Final = -40.0
"""Least one-way pattern [dB]: nulls of real antennas are filled, and ground in them keeps a finite calibration."""

PATTERN_STEPS: Final = 8192
"""Steps of the pattern's table between looking down and looking level."""

_ATMOSPHERE_M: Final = 8000.0  # thickness of a uniform shell with the attenuation of the real one
SINC_SQUARED_HALF: Final = 0.442946470689452
"""Where sinc(x)**2 is 1/2."""


def elevation_gain(
    kind: ElevationPattern,
    look_rad: FloatArray,
    boresight_rad: float,
    beamwidth_rad: float,
    table: Sequence[tuple[float, float]] = (),
) -> FloatArray:
    """One-way power pattern relative to its peak at look angles from the vertical, 0 to pi/2 [rad].

    Within `PATTERN_FLOOR_DB` and 1. The same everywhere; or cosec**2 of the depression angle from the boresight
    inwards, which lights level ground evenly, and half a sinc**2 beam beyond it; or sinc**2, whose peak is the
    boresight and whose half-power width is > 0; or straight lines in decibels between the points of a ``table``, look
    angle [deg], rising, and gain [dB] below the peak.
    """
    look = np.asarray(look_rad, dtype=np.float64)
    if kind == "isotropic":
        return np.ones_like(look)
    floor = 10.0 ** (0.1 * PATTERN_FLOOR_DB)
    if kind == "table":
        angles, levels = np.array(table, dtype=np.float64).T
        return np.asarray(np.maximum(10.0 ** (0.1 * np.interp(np.rad2deg(look), angles, levels)), floor))
    beam = np.sinc(2.0 * SINC_SQUARED_HALF * (look - boresight_rad) / beamwidth_rad) ** 2
    if kind == "cosecant_squared":
        # csc of the depression angle is sec of the look angle; normalised at the boresight.
        inner = (math.cos(boresight_rad) / np.maximum(np.cos(look), 1e-12)) ** 2
        beam = np.where(look <= boresight_rad, inner, beam)
    return np.asarray(np.maximum(beam, floor))


def atmosphere_factor(zenith_loss_db: float, incidence_rad: FloatArray) -> FloatArray:
    """One-way transmission L_T = L_R of eq. (3-20), at most 1, at incidence angles on flat ground [rad].

    Of a loss straight down from the flight line [dB], >= 0, by the path through a shell of 8 km: the secant of the
    angle up to some 75 deg, finite at the horizon.
    """
    cosine = np.cos(np.asarray(incidence_rad, dtype=np.float64))
    a = EARTH_RADIUS_M / _ATMOSPHERE_M
    # (sqrt((a + 1)**2 - a**2 sin**2) - a cos) with the difference of large numbers taken out.
    path = (2.0 * a + 1.0) / (np.sqrt(a * a * cosine * cosine + 2.0 * a + 1.0) + a * cosine)
    return np.asarray(10.0 ** (-0.1 * zenith_loss_db * path))


def pattern_points(text: str) -> tuple[tuple[float, float], ...]:
    """Points of a pattern from text such as ``"0:-20, 40:0, 70:-3"`` (look angle [deg] : gain [dB]).

    Raises
    ------
    ConfigurationError
        Not at least two points of rising angles with gains of at most 0 dB.
    """
    try:
        points = tuple((float(a), float(b)) for a, b in (part.split(":") for part in text.split(",")))
    except ValueError:
        points = ()
    angles = [angle for angle, _ in points]
    finite = all(math.isfinite(number) for point in points for number in point)
    if len(points) < 2 or not finite or sorted(set(angles)) != angles or max(gain for _, gain in points) > 0.0:
        remedy = 'Write rising look angles [deg] with gains [dB] of at most 0, as in "0:-20, 40:0, 70:-3"'
        raise ConfigurationError("not a pattern", remedy, field="pattern_table", value=text)
    return points
