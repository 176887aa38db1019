"""The package's only unit conversions: decibel, gigahertz, degrees, and the units of the sensor parameters.

Inside the package every float is in the unit its name's suffix tells; conversions happen at the border, here.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from types import MappingProxyType
from typing import Final, overload

import numpy as np

from seqrsm.arrays import FloatArray
from seqrsm.errors import ConfigurationError, Problem

LN10_OVER_10: Final = float(np.log(10.0) / 10.0)
"""Natural logarithm of the power ratio that 1 dB stands for [1/dB]."""


@overload
def db_to_linear(value_db: float) -> float: ...
@overload
def db_to_linear(value_db: FloatArray) -> FloatArray: ...
def db_to_linear(value_db: float | FloatArray) -> float | FloatArray:
    """Power ratio of ``value_db`` [dB]; -inf dB gives 0."""
    if isinstance(value_db, float):
        return float(np.exp(LN10_OVER_10 * value_db))
    result = np.exp(LN10_OVER_10 * np.asarray(value_db, dtype=np.float64))
    return float(result) if np.ndim(value_db) == 0 else np.asarray(result)


@overload
def linear_to_db(value: float) -> float: ...
@overload
def linear_to_db(value: FloatArray) -> FloatArray: ...
def linear_to_db(value: float | FloatArray) -> float | FloatArray:
    """Decibels [dB] of the power ratio ``value`` >= 0; 0 gives -inf, a negative ratio nan, without a warning."""
    with np.errstate(divide="ignore", invalid="ignore"):
        result = 10.0 * np.log10(np.asarray(value, dtype=np.float64))
    return float(result) if np.ndim(value) == 0 else np.asarray(result)


def ghz_to_hz(frequency_ghz: float) -> float:
    """Frequency [Hz] of ``frequency_ghz`` [GHz]."""
    return frequency_ghz * 1e9


@overload
def deg_to_rad(angle_deg: float) -> float: ...
@overload
def deg_to_rad(angle_deg: FloatArray) -> FloatArray: ...
def deg_to_rad(angle_deg: float | FloatArray) -> float | FloatArray:
    """Angle [rad] of ``angle_deg`` [deg]."""
    result = np.deg2rad(np.asarray(angle_deg, dtype=np.float64))
    return float(result) if np.ndim(angle_deg) == 0 else np.asarray(result)


@dataclass(frozen=True, slots=True)
class ParameterUnit:
    """Unit of one sensor parameter of RSL TR 380-1 Table 1.

    Attributes
    ----------
    unit : str
        The unit all of seqrsm uses for it; "" for a pure number.
    accepted : Mapping[str, float]
        Every accepted unit name with the factor that turns a value in it into ``unit``.
    """

    unit: str
    accepted: Mapping[str, float]


def _unit(unit: str, **others: float) -> ParameterUnit:
    return ParameterUnit(unit, MappingProxyType({unit: 1.0, **others}))


PARAMETER_UNITS: Final[Mapping[str, ParameterUnit]] = MappingProxyType(
    {
        "frequency": _unit("GHz", MHz=1e-3, Hz=1e-9),
        "polarization": _unit(""),
        "resolution": _unit("m", km=1e3),
        "looks": _unit(""),
        "bandwidth": _unit("MHz", kHz=1e-3, Hz=1e-6, GHz=1e3),
        "peak_power": _unit("W", kW=1e3),
        "depression_angle": _unit("deg", rad=180.0 / np.pi),
        "integration_time": _unit("ms", s=1e3, us=1e-3),
        "noise_temperature": _unit("K"),
        "scan_period": _unit("s", ms=1e-3),
    }
)
"""The parameters of Table 1 by their names in ``campaign.toml``, with the units accepted for each."""


def to_parameter_unit(parameter: str, value: float, unit: str = "") -> float:
    """``value`` of a sensor parameter in the unit seqrsm uses for it.

    Parameters
    ----------
    parameter : str
        A name of `PARAMETER_UNITS`.
    value : float
        Value in ``unit``.
    unit : str
        A unit accepted for the parameter; "" means the parameter's own unit.

    Raises
    ------
    ConfigurationError
        Unknown parameter, or a unit that is not accepted for it.
    """
    entry = PARAMETER_UNITS.get(parameter)
    if entry is None:
        known = ", ".join(PARAMETER_UNITS)
        raise ConfigurationError(Problem("no such sensor parameter", f"Known: {known}", field=parameter))
    if unit and unit not in entry.accepted:
        names = ", ".join(name for name in entry.accepted if name) or "none (a pure number)"
        raise ConfigurationError(Problem("unit not accepted", f"Accepted: {names}", field=parameter, value=unit))
    return value * entry.accepted[unit] if unit else value
