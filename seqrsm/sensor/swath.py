"""Where a scene lies before a radar: ground ranges, the edges of the swath, and what keeps it from being imaged."""

from __future__ import annotations

import math

import numpy as np

from seqrsm.arrays import FloatArray
from seqrsm.constants import SPEED_OF_LIGHT_M_S
from seqrsm.errors import ConfigurationError, Problem
from seqrsm.sensor.earth import ground_range_of_look, horizon_ground_range_m, range_geometry, slant_range_of_ground
from seqrsm.sensor.radar import RadarConfiguration, at_fault, rounded_down, rounded_up


def ground_ranges_m(
    radar: RadarConfiguration, n_rows: int, cell_m: float, mean_elevation_m: float, highest_elevation_m: float
) -> tuple[FloatArray, slice]:
    """Ground range (n_rows,) of the centre of each row of a scene [m], and the rows within the swath.

    The depression angle points at the centre; rows are cells across the track, of a plan-position indicator rings, a
    cell of ``cell_m`` apart. Mean and highest elevation are the scene's [m].

    Raises
    ------
    ConfigurationError
        The flight line is too low, the swath is empty, reaches behind nadir or beyond the horizon, or pulses overlap.
    """
    height = radar.altitude_m - mean_elevation_m
    if radar.scan == "ppi":
        y = cell_m * np.arange(1, n_rows + 1, dtype=np.float64)
    else:
        # A line below the ground has no geometry: it is refused by its height.
        look = math.radians(90.0 - radar.depression_angle_deg)
        centre = ground_range_of_look(look, height, radar.curved) if height > 0.0 else 0.0
        y = centre + (np.arange(n_rows, dtype=np.float64) - 0.5 * (n_rows - 1)) * cell_m
    rows = _swath_rows(radar, y, height) if height > 0.0 else slice(0, n_rows)
    problems = _swath_problems(radar, y[rows], cell_m, height, highest_elevation_m)
    if problems:
        raise ConfigurationError(*problems)
    return y, rows


def _swath_rows(radar: RadarConfiguration, y: FloatArray, height_m: float) -> slice:
    """Rows between the edges of the swath, by the ground range (n_rows,) [m] of each; refused where there are none."""
    if radar.near_incidence_deg == 0.0 and radar.far_incidence_deg == 90.0:
        return slice(0, len(y))
    incidence = np.rad2deg(range_geometry(y, height_m, radar.curved).incidence_rad)
    inside = np.ones(len(y), dtype=bool)
    if radar.near_incidence_deg > 0.0:
        inside &= incidence >= radar.near_incidence_deg
    if radar.far_incidence_deg < 90.0:
        inside &= (incidence <= radar.far_incidence_deg) & (y > 0.0)
    if not inside.any():
        seen = f"{float(incidence.min()):.4g} to {float(incidence.max()):.4g} deg"
        text = f"the swath misses the scene, which lies at incidence angles of {seen}"
        remedy = "Move the edges of the swath or the depression angle"
        raise ConfigurationError(at_fault(radar, "near_incidence_deg", text, remedy))
    kept = np.flatnonzero(inside)
    return slice(int(kept[0]), int(kept[-1]) + 1)


def _swath_problems(
    radar: RadarConfiguration, y: FloatArray, cell_m: float, height_m: float, highest_m: float
) -> list[Problem]:
    """Every contradiction between the radar and a scene of rows at ground ranges (n_rows,) [m], and so high [m]."""
    if radar.altitude_m <= highest_m:
        text, remedy = "the flight line is not above the ground", f"Fly above {rounded_up(highest_m)} m"
        return [at_fault(radar, "altitude_m", text, remedy)]
    found = []
    near, far = float(y[0]) - 0.5 * cell_m, float(y[-1]) + 0.5 * cell_m
    if near <= 0.0:
        limit = math.degrees(math.atan(height_m / (0.5 * (far - near))))
        text = f"the near edge of the swath lies {-near:.0f} m behind nadir"
        remedy = f"Use less than {rounded_down(limit)} deg, or fly higher"
        found.append(at_fault(radar, "depression_angle", text, remedy))
    horizon = horizon_ground_range_m(height_m)
    if far > horizon:
        text = f"the far edge of the swath at {far / 1e3:.4g} km lies beyond the horizon at {horizon / 1e3:.4g} km"
        if not radar.curved:
            text += ", which the real Earth has also where it is taken as flat"
        found.append(at_fault(radar, "depression_angle", text, "Use a larger depression angle"))
    if found:
        return found
    r_near, r_far = (slant_range_of_ground(edge, height_m, radar.curved) for edge in (near, far))
    if radar.aperture == "real" and radar.scan == "slar":
        widest = float(radar.azimuth_resolution_m(r_far))
        if radar.resolution_m < widest * (1.0 - 1e-9):
            text = f"the real beam is {widest:.4g} m wide at the far edge, {r_far:.0f} m away"
            remedy = f"Use a resolution of at least {rounded_up(widest)} m, a longer antenna or a higher frequency"
            found.append(at_fault(radar, "resolution", text, remedy))
    pulse_m = 0.5e-6 * SPEED_OF_LIGHT_M_S * radar.pulse_length_us
    if pulse_m >= r_near:
        text = f"the pulse ends after the echo from the near edge, {r_near:.0f} m away, has begun"
        limit_us = 2e6 * r_near / SPEED_OF_LIGHT_M_S
        found.append(at_fault(radar, "pulse_length_us", text, f"Keep it below {rounded_down(limit_us)} us"))
    window = 0.5 * SPEED_OF_LIGHT_M_S / radar.prf_hz
    if r_far - r_near + pulse_m > window:
        limit_hz = 0.5 * SPEED_OF_LIGHT_M_S / (r_far - r_near + pulse_m)
        text = f"echoes of two pulses overlap: the swath and the pulse take {r_far - r_near + pulse_m:.0f} m of range"
        found.append(at_fault(radar, "prf_hz", text, f"Use at most {rounded_down(limit_hz)} Hz"))
    return found
