"""Factors of a campaign and their coding.

A numeric factor is coded onto [-1, 1] before any model matrix is formed (RSL TR 380-1 eq. (2-4)): a quadratic in coded
factors is well conditioned where the same quadratic in hertz and seconds is not. Frequency, resolution, looks,
bandwidth and power are naturally coded in their logarithm. A categorical factor keeps the index of its level.
"""

from __future__ import annotations

import keyword
import math
import re
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cache
from typing import ClassVar, Literal, TypeAlias

import numpy as np
from numpy.typing import ArrayLike

from seqrsm.arrays import FloatArray
from seqrsm.errors import Problem, RegionError
from seqrsm.plain import heading

Scale: TypeAlias = Literal["linear", "log"]

#: Functions a constraint may call; no factor may bear such a name.
FUNCTION_NAMES = ("log", "log10", "sqrt", "exp", "min", "max", "abs", "count")

# A dot stands between the name of a sensor and that of its parameter.
_NAME = re.compile(r"(?:[A-Za-z_][A-Za-z0-9_]*\.)?[A-Za-z_][A-Za-z0-9_]*\Z")
# A measured 12.1 that went through a text file or single precision still is the level 12.1.
_LEVEL_TOLERANCE = 1e-6


def _name_problems(name: str) -> list[Problem]:
    if not _NAME.match(name) or len(name) > 64:
        text = "a factor's name is not usable in constraints and term names"
        remedy = "Use 1 to 64 letters a to z, digits and underscores, no digit first, one dot after a sensor's name."
        return [Problem(text, remedy, field="name", value=name)]
    if keyword.iskeyword(name) or name in FUNCTION_NAMES:
        return [Problem("a factor has a reserved name", "Choose another name.", field="name", value=name)]
    return []


def _scale_problems(name: str, scale: Scale, smallest: float) -> list[Problem]:
    if scale == "log" and smallest <= 0.0:
        text, remedy = "a logarithmic factor must be positive throughout", "Raise the lower end above 0 or use"
        return [Problem(text, f'{remedy} scale = "linear".', field=name, value=smallest)]
    return []


def _not_finite(what: str, field: str, values: Iterable[float]) -> list[Problem]:
    return [Problem(f"{what} is not a finite number", field=field, value=v) for v in values if not math.isfinite(v)]


def _list_problems(field: str, listed: tuple[object, ...], what: str) -> list[Problem]:
    """What makes a list of values or levels none of a factor."""
    if len(listed) < 2:
        remedy = "List two or more, or make it a fixed parameter."
        return [Problem(f"a factor needs at least two {what}s", remedy, field=field, value=listed)]
    if len(set(listed)) < len(listed):
        return [Problem(f"a {what} is listed twice", "List each once.", field=field, value=listed)]
    return []


LOG_NEEDS_POSITIVE = "a logarithmic factor takes positive values only"
_SAME_END = 1e-14
"""Coded distance from an end that is rounding and no setting of its own."""


def log_ratio(values: ArrayLike, low: float) -> FloatArray:
    """``log(values / low)`` to full precision, for values next to ``low`` and values 600 decades above it."""
    x = np.asarray(values, dtype=np.float64)
    near = np.abs(x - low) <= low
    # The difference of two logarithms of nearly equal numbers has lost its digits.
    return np.where(near, np.log1p(np.where(near, (x - low) / low, 0.0)), np.log(x) - np.log(low))


_width = cache(log_ratio)
"""Of a whole interval, (high, low), which is asked for again and again."""


def _code(name: str, natural: ArrayLike, low: float, high: float, scale: Scale) -> FloatArray:
    values = np.asarray(natural, dtype=np.float64)
    # These forms, unlike (2 x - low - high) / (high - low), give -1 and +1 exactly at the ends.
    if scale == "linear":
        return ((values - low) - (high - values)) / (high - low)
    if np.any(values <= 0.0):
        bad = float(values[values <= 0.0].flat[0])
        raise RegionError(LOG_NEEDS_POSITIVE, "Give a value > 0.", field=name, value=bad)
    above, width = log_ratio(values, low), _width(high, low)
    return (above - (width - above)) / width


def _decode(coded: ArrayLike, low: float, high: float, scale: Scale) -> FloatArray:
    t = np.asarray(coded, dtype=np.float64)
    if scale == "linear":
        natural = low * ((1.0 - t) / 2.0) + high * ((1.0 + t) / 2.0)
    else:
        # Two equal factors: their product may span more decades than a number holds.
        root = np.exp(_width(high, low) * ((1.0 + t) / 4.0))
        natural = low * root * root
    # exp(log(x)) differs from x in the last digit: the ends are what the user wrote.
    natural = np.where(np.abs(t + 1.0) <= _SAME_END, low, np.where(np.abs(t - 1.0) <= _SAME_END, high, natural))
    return np.where(np.abs(t) <= 1.0, np.minimum(np.maximum(natural, low), high), natural)


@dataclass(frozen=True, slots=True, kw_only=True)
class _OfSensors:
    not_of: tuple[str, ...] = field(default=(), repr=False)  # repr makes part of a campaign's hash
    """Members of a set of sensors that do not take it, or have their own."""


@dataclass(frozen=True, slots=True)
class ContinuousFactor(_OfSensors):
    """Numeric factor that takes any value of a closed interval; RegionError with all that is wrong."""

    name: str
    """Identifier of letters, digits and underscores."""
    low: float
    high: float
    """Ends of the interval in natural units, ``low < high``; coded -1 and +1."""
    unit: str = ""
    """Unit of ``low`` and ``high``, for reports."""
    scale: Scale = "linear"
    """Whether the value or its logarithm is coded linearly; ``"log"`` needs ``low > 0``."""

    def __post_init__(self) -> None:
        problems = _name_problems(self.name)
        broken = _not_finite("an end of the interval", f"{self.name}.low", [self.low])
        broken += _not_finite("an end of the interval", f"{self.name}.high", [self.high])
        problems += broken
        if not broken:
            if not self.low < self.high or not math.isfinite(float(self.high) - float(self.low)):
                text, ends_given = "the lower end is not below the upper end", (self.low, self.high)
                problems.append(Problem(text, "Give low < high.", field=self.name, value=ends_given))
            problems += _scale_problems(self.name, self.scale, float(self.low))
        if problems:
            raise RegionError(*problems)
        object.__setattr__(self, "low", float(self.low))
        object.__setattr__(self, "high", float(self.high))

    def code(self, natural: ArrayLike) -> FloatArray:
        """Coded values of natural ones, any shape; values beyond the interval give |coded| > 1."""
        return _code(self.name, natural, self.low, self.high, self.scale)

    def decode(self, coded: ArrayLike) -> FloatArray:
        """Natural values [``unit``] of coded ones, any shape."""
        return _decode(coded, self.low, self.high, self.scale)


@dataclass(frozen=True, slots=True)
class DiscreteFactor(_OfSensors):
    """Numeric factor that takes only the values listed; RegionError with all that is wrong."""

    name: str
    """Identifier of letters, digits and underscores."""
    values: tuple[float, ...]
    """Two or more different values in natural units; kept in ascending order."""
    unit: str = ""
    """Unit of the values, for reports."""
    scale: Scale = "linear"
    """Whether the value or its logarithm is coded linearly from the smallest (-1) to the largest (+1)."""

    def __post_init__(self) -> None:
        problems = _name_problems(self.name)
        values = tuple(self.values)
        broken = _not_finite("a value", f"{self.name}.values", values)
        problems += broken
        if not broken:
            values = tuple(sorted(float(v) for v in values))
            problems += _list_problems(f"{self.name}.values", values, "value")
            if values:
                problems += _scale_problems(self.name, self.scale, values[0])
        if problems:
            raise RegionError(*problems)
        object.__setattr__(self, "values", values)

    @property
    def coded_levels(self) -> FloatArray:
        """Coded values of the levels, ascending, first -1 and last +1; shape (levels,)."""
        return _code(self.name, self.values, self.values[0], self.values[-1], self.scale)

    def code(self, natural: ArrayLike) -> FloatArray:
        """Coded values of natural ones, any shape; a value that is a level but for rounding gets its exact code."""
        coded = _code(self.name, natural, self.values[0], self.values[-1], self.scale)
        index, hit = self.match(coded)
        return np.where(hit, self.coded_levels[index], coded)

    def decode(self, coded: ArrayLike) -> FloatArray:
        """Natural values [``unit``] of coded ones, any shape; exact at the levels."""
        t = np.asarray(coded, dtype=np.float64)
        index, hit = self.match(t)
        between = _decode(t, self.values[0], self.values[-1], self.scale)
        return np.where(hit, np.asarray(self.values)[index], between)

    def match(self, coded: ArrayLike) -> tuple[np.ndarray, np.ndarray]:
        """Index of the nearest level of each coded value, and whether it is that level but for rounding."""
        t = np.asarray(coded, dtype=np.float64)
        levels = self.coded_levels
        right = np.clip(np.searchsorted(levels, t), 1, levels.size - 1)
        index = np.where(t - levels[right - 1] <= levels[right] - t, right - 1, right)
        tolerance = min(_LEVEL_TOLERANCE, 1e-3 * float(np.min(np.diff(levels))))
        return index, np.abs(t - levels[index]) <= tolerance


@dataclass(frozen=True, slots=True)
class CategoricalFactor(_OfSensors):
    """Factor whose levels have no order, such as the polarization; RegionError with all that is wrong."""

    name: str
    """Identifier of letters, digits and underscores."""
    levels: tuple[str, ...]
    """Two or more different names; a point holds the index into this tuple."""

    unit: ClassVar[str] = ""

    def __post_init__(self) -> None:
        problems = _name_problems(self.name)
        levels = tuple(self.levels)
        field = f"{self.name}.levels"
        problems += [
            Problem("a level's name is empty or has blanks or control signs at its ends", field=field, value=level)
            for level in levels
            if not level or level != level.strip() or not level.isprintable()
        ]
        problems += _list_problems(field, levels, "level")
        if problems:
            raise RegionError(*problems)
        object.__setattr__(self, "levels", levels)

    @property
    def coded_levels(self) -> FloatArray:
        """Index of each level, as points hold it; shape (c,)."""
        return np.arange(len(self.levels), dtype=np.float64)

    @property
    def contrasts(self) -> FloatArray:
        """Sum-to-zero contrasts: row = level, column = contrast; identity above a row of -1; shape (c, c - 1)."""
        c = len(self.levels)
        return np.vstack([np.eye(c - 1), -np.ones((1, c - 1))])


Factor: TypeAlias = ContinuousFactor | DiscreteFactor | CategoricalFactor
NumericFactor: TypeAlias = ContinuousFactor | DiscreteFactor


class OfFactors:
    """What is made of factors, in the order of the columns of points."""

    __slots__ = ()
    factors: tuple[Factor, ...]

    @property
    def k(self) -> int:
        """Number of factors."""
        return len(self.factors)

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the factors."""
        return tuple(factor.name for factor in self.factors)

    @property
    def numeric(self) -> tuple[int, ...]:
        """Indices of the continuous and discrete numeric factors."""
        return tuple(i for i, f in enumerate(self.factors) if not isinstance(f, CategoricalFactor))

    @property
    def categorical(self) -> tuple[int, ...]:
        """Indices of the categorical factors."""
        return tuple(i for i, f in enumerate(self.factors) if isinstance(f, CategoricalFactor))


_DIGITS = 4
_CLOSE = 0.005  # coded: a quarter of a percent of the range


def span(factor: NumericFactor) -> tuple[float, float]:
    """Smallest and largest natural value of a numeric factor."""
    if isinstance(factor, ContinuousFactor):
        return factor.low, factor.high
    return factor.values[0], factor.values[-1]


def central_range(factor: NumericFactor, coded: ArrayLike, tail: float) -> tuple[float, float]:
    """Quantiles ``tail`` and 1 - ``tail`` of coded draws, natural: of a factor with few values, two of the values."""
    draws, ends = np.asarray(coded, dtype=np.float64), [tail, 1.0 - tail]
    discrete = isinstance(factor, DiscreteFactor)
    found = np.quantile(draws, ends, method="inverted_cdf") if discrete else np.quantile(draws, ends)
    low, high = factor.decode(found).tolist()
    return low, high


def plain_setting(factor: NumericFactor, value: float) -> float:
    """``value`` to four significant digits, or to as many more as a narrow range needs to tell settings apart."""
    for digits in range(_DIGITS, 17):
        rounded = float(f"{value:.{digits}g}")
        if np.all(np.abs(factor.code([rounded]) - factor.code([value])) <= _CLOSE):
            return rounded
    return value


def setting_with_unit(factor: Factor, value: float | str) -> str:
    """A level or setting as people write it, with its unit."""
    if isinstance(value, str) or isinstance(factor, CategoricalFactor):
        return str(value)
    return f"{plain_setting(factor, float(value)):.15g} {factor.unit}".rstrip()


def with_units(factors: Sequence[Factor], settings: Mapping[str, float | str]) -> dict[str, float | str]:
    """Settings by name and unit, "frequency [GHz]"."""
    return {heading(factor.name, factor.unit): settings[factor.name] for factor in factors}


def settings_text(factors: Sequence[Factor], settings: Mapping[str, float | str]) -> str:
    """Settings in one line, with units."""
    return ", ".join(f"{factor.name} {setting_with_unit(factor, settings[factor.name])}" for factor in factors)
