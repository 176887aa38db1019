"""The package's only unit conversions: decibel, and units of one kind.

Inside the package every float is in the unit its name's suffix tells; conversions happen at the border, here.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Final, overload

import numpy as np

from seqrsm.arrays import FloatArray
from seqrsm.constants import SPEED_OF_LIGHT_M_S

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


_KINDS: Final[Sequence[Mapping[str, float]]] = (
    {"GHz": 1e9, "MHz": 1e6, "kHz": 1e3, "Hz": 1.0},
    {"m": 1.0, "km": 1e3, "cm": 1e-2, "mm": 1e-3, "ft": 0.3048},
    {"W": 1.0, "kW": 1e3},
    {"deg": np.pi / 180.0, "rad": 1.0},
    {"s": 1.0, "ms": 1e-3, "us": 1e-6},
)
"""Units of one kind, each with its value in the kind's own unit."""


def units_like(unit: str) -> tuple[str, ...]:
    """Units of the same kind as ``unit``, itself among them; none where only itself is known."""
    return next((tuple(kind) for kind in _KINDS if unit in kind), ())


def unit_factor(unit: str, wanted: str) -> float | None:
    """Number that turns a value in ``unit`` into ``wanted``; None where the two are not known to be of one kind."""
    if unit == wanted:
        return 1.0
    return next((kind[unit] / kind[wanted] for kind in _KINDS if unit in kind and wanted in kind), None)


def reciprocal_factor(unit: str, wanted: str) -> float | None:
    """Number that a wavelength in ``unit`` divides to give the frequency in ``wanted``, or the other way round."""
    frequency, length = _KINDS[:2]
    pairs = ((length, frequency), (frequency, length))
    return next(
        (SPEED_OF_LIGHT_M_S / one[unit] / other[wanted] for one, other in pairs if unit in one and wanted in other),
        None,
    )
