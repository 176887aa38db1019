"""Names, settings and lists as a reader wants them: "depression angle", "9.4 GHz", "a, b and c"."""

from __future__ import annotations

import math
import re
from collections.abc import Iterable, Mapping, Sequence

from seqrsm.design.factors import CategoricalFactor, DiscreteFactor, Factor, NumericFactor, span
from seqrsm.report.rounding import decimals_for, format_number, format_plain
from seqrsm.sensor.parameters import RADAR, RADIOMETER, find


def capital(text: str) -> str:
    """Begin a text with a capital letter, the rest as it is."""
    return text[:1].upper() + text[1:]


def counted(n: int, one: str, many: str = "") -> str:
    """Return ``"1 cover"`` or ``"3 covers"``; ``many`` where that is not ``one`` with an s."""
    return f"{n} {one if n == 1 else many or f'{one}s'}"


def readable(name: str) -> str:
    """Return a factor's name without underscores; of a sensor parameter, without the suffix that tells its unit."""
    parameter = RADAR.get(name) or RADIOMETER.get(name)
    return name.replace("_", " ") if parameter is None else parameter.label


def readable_term(name: str) -> str:
    """Return a term's name as it is written in text: ``"frequency²"``, ``"frequency × resolution"``."""
    if name.endswith("^2"):
        return readable(name[:-2]) + "\u00b2"
    parts: list[str] = []
    depth, start = 0, 0
    for index, sign in enumerate(name):
        depth += (sign == "[") - (sign == "]")
        # A level may itself hold a colon: only those outside brackets separate factors.
        if sign == ":" and depth == 0:
            parts.append(name[start:index])
            start = index + 1
    parts.append(name[start:])
    return " \u00d7 ".join(_readable_part(part) for part in parts)


def _readable_part(part: str) -> str:
    head, bracket, tail = part.partition("[")
    return readable(head) + bracket + tail


def with_unit(text: str, unit: str) -> str:
    """Append a unit, if there is one, on the same line."""
    return f"{text}\u00a0{unit}" if unit else text


def axis_label(factor: Factor) -> str:
    """Return name and unit of a factor, as on an axis or in a table's head."""
    unit = "" if isinstance(factor, CategoricalFactor) else factor.unit
    return f"{readable(factor.name)} [{unit}]" if unit else readable(factor.name)


def listing(items: Sequence[str], last: str = "and") -> str:
    """Join items: ``"a"``, ``"a and b"``, ``"a, b and c"``."""
    if len(items) < 2:
        return "".join(items)
    return f"{', '.join(items[:-1])} {last} {items[-1]}"


def setting_decimals(factor: NumericFactor, value: float, spread: float = math.nan) -> int:
    """Decimal places of a setting: those that ``spread`` supports, else one part in 100 of the factor's range.

    ``spread`` is half the width of the credible interval of the optimal setting [unit of the factor]. On a
    logarithmic axis the range is taken locally, so that small settings keep their digits.
    """
    low, high = span(factor)
    local = (high - low) if factor.scale == "linear" else abs(value) * math.log(high / low)
    finest = decimals_for(local / 100.0)
    if not math.isfinite(spread) or spread <= 0.0:
        return finest
    # Half of the half-width is about a standard error: it decides the digits, up to those that a sensor can be set to.
    return min(decimals_for(spread / 2.0), finest + 3)


def format_setting(factor: Factor, value: float | str, spread: float = math.nan, *, unit: bool = True) -> str:
    """Format one setting of a factor; levels of discrete factors and bounds keep all digits that the user gave."""
    if isinstance(factor, CategoricalFactor):
        return str(value)
    number = float(value)
    low, high = span(factor)
    exact = isinstance(factor, DiscreteFactor) or number in (low, high)
    if exact and len(f"{number:.12g}") <= 8:
        text = format_plain(number)
    else:
        text = format_number(number, setting_decimals(factor, number, spread))
    return with_unit(text, factor.unit if unit else "")


def format_settings(factors: Sequence[Factor], settings: Mapping[str, float | str]) -> str:
    """Format all settings in one line: ``"frequency 9.4 GHz, polarization HV"``."""
    return ", ".join(
        f"{readable(factor.name)} {format_setting(factor, settings[factor.name])}"
        for factor in factors
        if factor.name in settings
    )


def describe_factor(factor: Factor) -> tuple[str, str]:
    """Kind and allowed values of a factor in words."""
    if isinstance(factor, CategoricalFactor):
        return "categorical", ", ".join(factor.levels)
    scale = "logarithmic" if factor.scale == "log" else "linear"
    if isinstance(factor, DiscreteFactor):
        values = ", ".join(format_plain(value) for value in factor.values)
        return f"discrete, {scale}", values
    return f"continuous, {scale}", f"{format_plain(factor.low)} to {format_plain(factor.high)}"


def level_text(level: float) -> str:
    """Return a probability such as 0.95 as ``"95 %"``."""
    return f"{format_plain(round(100.0 * level, 6))}\u00a0%"


_SIGNS = str.maketrans({"u": "\u00b5", "2": "\u00b2", "3": "\u00b3"})  # of "us", "kg/m2", "m3/m3"


def fixed_unit(name: str, value: float | str) -> str:
    """Unit of a sensor parameter by its name; none for text."""
    parameter = None if isinstance(value, str) else find(RADAR, name) or find(RADIOMETER, name)
    return "" if parameter is None else parameter.unit.translate(_SIGNS)


def fixed_label(name: str) -> str:
    """Name of a sensor parameter, by that of ``campaign.toml`` or of its field, as a reader wants it."""
    parameter = find(RADAR, name) or find(RADIOMETER, name)
    return readable(name if parameter is None else parameter.name)


def readable_text(text: str, names: Iterable[str]) -> str:
    """A sentence in which factors stand by their readable names, and no line ends before a percent sign."""
    text = re.sub(r"(?<=\d) (?=%)", "\u00a0", text)
    for name in sorted((name for name in names if "_" in name), key=len, reverse=True):
        text = re.sub(rf"(?<!\w){re.escape(name)}(?!\w)", readable(name), text)
    return text


def format_value(value: float | str) -> str:
    """Format a value that a person wrote: text as it is, a number with all its digits."""
    return value if isinstance(value, str) else format_plain(float(value))


def level_labels(factor: CategoricalFactor | DiscreteFactor) -> list[str]:
    """Levels of a categorical or discrete factor as text."""
    if isinstance(factor, CategoricalFactor):
        return list(factor.levels)
    return [format_plain(value) for value in factor.values]


def shortened(text: str, length: int) -> str:
    """Cut a long text for a drawing, where it would push the axes out; tables hold it in full."""
    return text if len(text) <= length else f"{text[: length - 1]}\u2026"


def slug(text: str) -> str:
    """Text as a part of a file name: letters, digits and hyphens of ASCII."""
    return re.sub(r"[^a-z0-9]+", "-", text.lower()).strip("-")[:60] or "x"
