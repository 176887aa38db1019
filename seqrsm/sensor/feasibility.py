"""What makes a radar impossible: values alone, values against each other, the radar against the extent of a scene.

Every check returns all it finds as `Problem`, with the numbers that would do.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import TYPE_CHECKING, Final

import numpy as np

from seqrsm.arrays import FloatArray
from seqrsm.constants import SPEED_OF_LIGHT_M_S
from seqrsm.errors import ConfigurationError, Problem
from seqrsm.sensor.antenna import pattern_points
from seqrsm.sensor.earth import horizon_ground_range_m, horizon_look_rad, range_geometry, slant_range_of_ground

if TYPE_CHECKING:
    from seqrsm.sensor.radar import RadarConfiguration

CHANNELS: Final = ("HH", "HV", "VV")
"""Polarization channels in the order of every draw; the first letter is transmitted."""

SEASONS: Final = ("spring_summer", "fall", "winter")

TEXT_FIELDS: Final[Mapping[str, tuple[str, ...]]] = {
    "aperture": ("synthetic", "real"),
    "scan": ("slar", "ppi"),
    "range_format": ("ground", "slant"),
    "season": SEASONS,
    "elevation_pattern": ("isotropic", "cosecant_squared", "sinc_squared", "table"),
    "earth": ("curved", "flat"),
    "binning": ("overlap", "nearest"),
    "fading": ("gamma", "gaussian", "none"),
    "snow": ("none", "dry", "wet"),
}
"""Fields that hold a word, and the words."""

_LIMITS: Final[Mapping[str, tuple[float, float, str]]] = {
    "frequency_ghz": (0.1, 100.0, "GHz"),
    "resolution_m": (0.05, 1e5, "m"),
    "bandwidth_mhz": (1e-3, 1e4, "MHz"),
    "peak_power_w": (1e-6, 1e9, "W"),
    "depression_angle_deg": (0.05, 89.95, "deg"),
    "altitude_m": (1.0, 2e6, "m"),
    "antenna_length_m": (1e-2, 1e3, "m"),
    "antenna_gain_db": (-10.0, 80.0, "dB"),
    "pulse_length_us": (1e-3, 1e5, "us"),
    "prf_hz": (1.0, 1e6, "Hz"),
    "speed_m_s": (1.0, 1e4, "m/s"),
    "noise_figure_db": (0.0, 40.0, "dB"),
    "loss_db": (0.0, 60.0, "dB"),
    "heading_deg": (-360.0, 360.0, "deg"),
    "antenna_east_m": (-1e6, 1e6, "m"),
    "antenna_north_m": (-1e6, 1e6, "m"),
    "elevation_beamwidth_deg": (0.1, 180.0, "deg"),
    "zenith_loss_db": (0.0, 30.0, "dB"),
    "near_incidence_deg": (0.0, 89.9, "deg"),
    "far_incidence_deg": (0.1, 90.0, "deg"),
    "receiver_level_db": (-100.0, 100.0, "dB"),
    "agc_length_m": (1.0, 1e6, "m"),
    "adc_bits": (0, 32, ""),
    "adc_range_db": (-100.0, 100.0, "dB"),
    "film_gamma": (1e-3, 1e3, ""),
    "film_k": (1e-12, 1e12, ""),
    "snow_depth_cm": (0.0, 500.0, "cm"),
    "n_bits": (1, 32, ""),
    "dynamic_range_db": (0.1, 200.0, "dB"),
    "texture_db": (0.0, 20.0, "dB"),
    "texture_m": (0.1, 1e5, "m"),
    "soil_moisture_low": (0.01, 0.6, "m3/m3"),
    "soil_moisture_high": (0.01, 0.6, "m3/m3"),
    "wind_low_m_s": (0.0, 40.0, "m/s"),
    "wind_high_m_s": (0.0, 40.0, "m/s"),
}


_OPTIONAL: Final[Mapping[str, tuple[float, float, str]]] = {
    "looks": (1.0, 1e6, ""),
    "pixel_m": (0.05, 1e5, "m"),
    "azimuth_beamwidth_deg": (1e-3, 90.0, "deg"),
    "boresight_depression_deg": (0.0, 90.0, "deg"),
    "i_min_w": (1e-40, 1e12, "W"),
    "i_c_w": (1e-40, 1e12, "W"),
    "i_qc": (0.0, 2.0**32, ""),
    "p_rc_w": (1e-40, 1e12, "W"),
    "g_rc": (-(2.0**32), 2.0**32, ""),
}

_WHOLE: Final = ("n_bits", "adc_bits")

RECEIVERS: Final = ("linear", "square_law", "saturation", "compression", "agc")
"""Transfer functions M by name."""

GAUSSIAN_LOOKS: Final = 16.0
"""Least looks for eq. (3-12): there it is negative with probability Phi(-4) = 3e-5."""

_CALIBRATIONS: Final = (("i_min_w",), ("i_c_w", "i_qc"), ("p_rc_w", "g_rc"))

_SHOWN: Final[Mapping[str, str]] = {
    "frequency_ghz": "frequency",
    "resolution_m": "resolution",
    "bandwidth_mhz": "bandwidth",
    "peak_power_w": "peak_power",
    "depression_angle_deg": "depression_angle",
}  # a campaign calls these fields by their names of Table 1


def _down(value: float) -> str:
    """Five digits, never above `value`: what a message allows must be allowed."""
    unit = 10.0 ** (math.floor(math.log10(value)) - 4)
    return f"{math.floor(value / unit * (1.0 + 1e-12)) * unit:.5g}"


def _up(value: float) -> str:
    """Five digits, never below `value`."""
    unit = 10.0 ** (math.floor(math.log10(value)) - 4)
    return f"{math.ceil(value / unit * (1.0 - 1e-12)) * unit:.5g}"


def converted(name: str, value: float | str, problems: list[Problem], shown: str) -> object:
    """Value of a field of `RadarConfiguration` as its type; what cannot be converted is added to ``problems``."""
    if name == "channels":
        return tuple(part.strip() for part in str(value).split("+"))
    if name in TEXT_FIELDS or name in ("receiver", "processing", "targets_file"):
        return str(value)
    if name == "pattern_table":
        try:
            return pattern_points(str(value))
        except ConfigurationError as error:
            problems.extend(error.problems)
            return ()
    try:
        if isinstance(value, bool):
            raise ValueError
        number = float(value)
    except (TypeError, ValueError):
        problems.append(Problem("not a number", "Give a number", field=shown, value=value))
        return value
    if name in _WHOLE and number == round(number):
        return int(number)
    return number


def value_problems(radar: RadarConfiguration) -> list[Problem]:
    """Every value that is impossible alone.

    Parameters
    ----------
    radar : RadarConfiguration
        Perhaps with values of a wrong type.

    Returns
    -------
    list of Problem
    """
    problems = []
    given = {name: limits for name, limits in _OPTIONAL.items() if getattr(radar, name) is not None}
    for name, (low, high, unit) in {**_LIMITS, **given}.items():
        value = getattr(radar, name)
        if not (isinstance(value, int | float) and not isinstance(value, bool) and low <= value <= high):
            remedy = f"Give a number from {low:g} to {high:g} {unit}".rstrip()
            problems.append(Problem("out of range", remedy, field=_SHOWN.get(name, name), value=value))
        elif name in _WHOLE and value != round(value):
            problems.append(Problem("not a whole number", "Give whole bits", field=name, value=value))
    for name, allowed in TEXT_FIELDS.items():
        if getattr(radar, name) not in allowed:
            problems.append(Problem("unknown", f"Known: {', '.join(allowed)}", field=name, value=getattr(radar, name)))
    known = isinstance(radar.channels, tuple) and all(channel in CHANNELS for channel in radar.channels)
    if not known or not radar.channels or len(set(radar.channels)) != len(radar.channels):
        remedy = f"Name one or more of {', '.join(CHANNELS)}, each once, as in HH+HV"
        value = "+".join(str(part) for part in radar.channels) if isinstance(radar.channels, tuple) else radar.channels
        problems.append(Problem("not a set of channels", remedy, field="polarization", value=value))
    if radar.receiver not in RECEIVERS and ":" not in radar.receiver:
        remedy = f'Known: {", ".join(RECEIVERS)}; or name a function as "package.module:function"'
        problems.append(Problem("unknown", remedy, field="receiver", value=radar.receiver))
    if radar.processing and ":" not in radar.processing:
        remedy = 'Name a function as "package.module:function"'
        problems.append(Problem("unknown", remedy, field="processing", value=radar.processing))
    return problems


def set_problems(radar: RadarConfiguration) -> list[Problem]:
    """Every contradiction between values that are possible alone; needs no scene.

    Parameters
    ----------
    radar : RadarConfiguration

    Returns
    -------
    list of Problem
    """
    problems = _choice_problems(radar)
    theta = radar.centre_incidence_rad
    if math.isnan(theta):
        least = 90.0 - math.degrees(horizon_look_rad(radar.altitude_m))
        text = f"the line of sight to the centre of the scene passes the horizon, {least:.4g} deg below the horizontal"
        problems.append(
            Problem(text, f"Use at least {_up(least)} deg", field="depression_angle", value=radar.depression_angle_deg)
        )
        return problems
    across = radar.ground_resolution_m(theta)
    if radar.resolution_m < across * (1.0 - 1e-9):
        needed = radar.bandwidth_mhz * across / radar.resolution_m
        problems.append(
            Problem(
                f"{radar.bandwidth_mhz:g} MHz at an incidence of {math.degrees(theta):.4g} deg resolve {across:.4g} m "
                "in ground range, no finer",
                f"Use at least {_up(needed)} MHz or a resolution of at least {_up(across)} m",
                field="resolution",
                value=radar.resolution_m,
            )
        )
    along = 0.5 * radar.antenna_length_m
    if radar.scan == "slar" and radar.resolution_m < along * (1.0 - 1e-9):
        remedy = f"Use a resolution of at least {_up(along)} m or a shorter antenna"
        text = f"an antenna of {radar.antenna_length_m:g} m resolves {along:g} m in azimuth, no finer"
        problems.append(Problem(text, remedy, field="resolution", value=radar.resolution_m))
    available = radar.looks_available(theta)
    if not problems and radar.looks is not None and radar.looks > available * (1.0 + 1e-9):
        text = (
            f"a cell of {radar.resolution_m:g} m holds {available:.4g} independent samples at the centre of the scene"
        )
        remedy = f"Ask for at most {_down(available)} looks, or more bandwidth, or a coarser resolution"
        problems.append(Problem(text, remedy, field="looks", value=radar.looks))
    sampled = radar.prf_hz / radar.n_transmit
    if radar.scan == "slar" and sampled < 2.0 * radar.speed_m_s / radar.antenna_length_m:
        need = radar.n_transmit * 2.0 * radar.speed_m_s / radar.antenna_length_m
        text = f"{radar.n_transmit} transmit polarizations need two pulses each per antenna length flown"
        problems.append(Problem(text, f"Use at least {_up(need)} Hz", field="prf_hz", value=radar.prf_hz))
    if radar.pulse_length_us * 1e-6 * radar.prf_hz >= 1.0:
        text = "the pulse is longer than the time to the next one"
        problems.append(Problem(text, f"Keep it below {_down(1e6 / radar.prf_hz)} us", field="pulse_length_us"))
    for low, high in (("soil_moisture_low", "soil_moisture_high"), ("wind_low_m_s", "wind_high_m_s")):
        if getattr(radar, low) > getattr(radar, high):
            problems.append(Problem("above the high end", f"Keep it at or below {high}", field=low))
    return problems


def _choice_problems(radar: RadarConfiguration) -> list[Problem]:
    """Choices that exclude or need each other."""
    problems = []
    if radar.near_incidence_deg >= radar.far_incidence_deg:
        text, remedy = "the near edge of the swath lies beyond the far edge", "Keep it below far_incidence_deg"
        problems.append(Problem(text, remedy, field="near_incidence_deg", value=radar.near_incidence_deg))
    if radar.fading == "gaussian" and radar.looks is not None and radar.looks < GAUSSIAN_LOOKS:
        share = 0.5 * math.erfc(math.sqrt(0.5 * radar.looks))
        text = (
            f"the Gaussian form of fading is negative in {100.0 * share:.2g} percent of pixels of {radar.looks:g} looks"
        )
        remedy = f'Use at least {GAUSSIAN_LOOKS:g} looks, or fading = "gamma"'
        problems.append(Problem(text, remedy, field="fading", value=radar.fading))
    if radar.scan == "ppi":
        if radar.aperture != "real":
            text, remedy = "a rotating antenna forms no synthetic aperture", 'Add aperture = "real"'
            problems.append(Problem(text, remedy, field="aperture", value=radar.aperture))
        if radar.pixel_m is not None:
            text, remedy = "the pixels of a plan-position indicator are as wide as its beam", "Leave pixel_m out"
            problems.append(Problem(text, remedy, field="pixel_m", value=radar.pixel_m))
    elif radar.antenna_east_m or radar.antenna_north_m:
        text, remedy = (
            "a place of the antenna belongs to a plan-position indicator",
            'Add scan = "ppi", or leave it out',
        )
        problems.append(Problem(text, remedy, field="antenna_east_m", value=radar.antenna_east_m))
    if radar.pixel_m is not None and radar.pixel_m > radar.resolution_m:
        remedy = "Make it at most the resolution, or leave it out"
        problems.append(
            Problem("pixels coarser than the resolution cell", remedy, field="pixel_m", value=radar.pixel_m)
        )
    if (radar.elevation_pattern == "table") != bool(radar.pattern_table):
        remedy = 'Give both elevation_pattern = "table" and pattern_table, or neither'
        problems.append(Problem("a pattern and its table belong together", remedy, field="pattern_table"))
    if radar.snow != "none" and radar.season != "winter":
        remedy = 'Use season = "winter", or snow = "none"'
        problems.append(Problem("snow lies in winter only", remedy, field="snow", value=radar.snow))
    used = [names for names in _CALIBRATIONS if any(getattr(radar, name) is not None for name in names)]
    if len(used) > 1:
        text = f"more than one calibration of the picture: {'; '.join(' and '.join(names) for names in used)}"
        problems.append(Problem(text, "Give one of them", field=used[1][0]))
    problems += [
        Problem("half of a calibration pair", f"Give {' and '.join(names)}", field=name)
        for names in used
        for name in names
        if getattr(radar, name) is None
    ]
    return problems


def swath_rows(radar: RadarConfiguration, y: FloatArray, height_m: float) -> slice:
    """Rows between the near and the far edge of the swath.

    Parameters
    ----------
    radar : RadarConfiguration
    y : float64 array (n_rows,)
        Ground range of each row's centre [m].
    height_m : float
        Flight line above the mean elevation [m].

    Raises
    ------
    ConfigurationError
        No row lies between them.
    """
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
        raise ConfigurationError(Problem(text, remedy, field="near_incidence_deg", value=radar.near_incidence_deg))
    kept = np.flatnonzero(inside)
    return slice(int(kept[0]), int(kept[-1]) + 1)


def swath_problems(
    radar: RadarConfiguration, y: FloatArray, cell_m: float, height_m: float, highest_m: float
) -> list[Problem]:
    """Every contradiction between the radar and the extent of a scene.

    Parameters
    ----------
    radar : RadarConfiguration
    y : float64 array (n_rows,)
        Ground range of each row's centre [m].
    cell_m, height_m, highest_m : float
        Side of a cell; flight line above the mean elevation; highest elevation of the scene [m].

    Returns
    -------
    list of Problem
    """
    if radar.altitude_m <= highest_m:
        remedy = f"Fly above {_up(highest_m)} m"
        return [Problem("the flight line is not above the ground", remedy, field="altitude_m", value=radar.altitude_m)]
    problems = []
    near, far = float(y[0]) - 0.5 * cell_m, float(y[-1]) + 0.5 * cell_m
    if near <= 0.0:
        limit = math.degrees(math.atan(height_m / (0.5 * (far - near))))
        text = f"the near edge of the swath lies {-near:.0f} m behind nadir"
        remedy = f"Use less than {_down(limit)} deg, or fly higher"
        problems.append(Problem(text, remedy, field="depression_angle", value=radar.depression_angle_deg))
    horizon = horizon_ground_range_m(height_m)
    if far > horizon:
        text = f"the far edge of the swath at {far / 1e3:.4g} km lies beyond the horizon at {horizon / 1e3:.4g} km"
        if not radar.curved:
            text += ", which the real Earth has also where it is taken as flat"
        problems.append(Problem(text, "Use a larger depression angle", field="depression_angle"))
    if problems:
        return problems
    r_near, r_far = (slant_range_of_ground(edge, height_m, radar.curved) for edge in (near, far))
    if radar.aperture == "real" and radar.scan == "slar":
        widest = float(radar.azimuth_resolution_m(r_far))
        if radar.resolution_m < widest * (1.0 - 1e-9):
            text = f"the real beam is {widest:.4g} m wide at the far edge, {r_far:.0f} m away"
            remedy = f"Use a resolution of at least {_up(widest)} m, a longer antenna or a higher frequency"
            problems.append(Problem(text, remedy, field="resolution", value=radar.resolution_m))
    pulse_m = 0.5e-6 * SPEED_OF_LIGHT_M_S * radar.pulse_length_us
    if pulse_m >= r_near:
        text = f"the pulse ends after the echo from the near edge, {r_near:.0f} m away, has begun"
        limit_us = 2e6 * r_near / SPEED_OF_LIGHT_M_S
        problems.append(Problem(text, f"Keep it below {_down(limit_us)} us", field="pulse_length_us"))
    window = 0.5 * SPEED_OF_LIGHT_M_S / radar.prf_hz
    if r_far - r_near + pulse_m > window:
        limit_hz = 0.5 * SPEED_OF_LIGHT_M_S / (r_far - r_near + pulse_m)
        text = f"echoes of two pulses overlap: the swath and the pulse take {r_far - r_near + pulse_m:.0f} m of range"
        problems.append(Problem(text, f"Use at most {_down(limit_hz)} Hz", field="prf_hz", value=radar.prf_hz))
    return problems
