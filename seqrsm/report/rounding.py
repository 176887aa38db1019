"""Numbers as text, with the digits that their uncertainty supports.

The rule is that of the Particle Data Group (Review of Particle Physics, Introduction, section 5.3 "Rounding"): look at
the three leading digits of the uncertainty; 100 to 354 keep two digits, 355 to 949 keep one, 950 to 999 round up to
1000 and keep two. The value gets the same last decimal place.
"""

from __future__ import annotations

import math

from seqrsm.decide.stopping import telling

MINUS = "\u2212"
NOTHING = "\u2013"
"""Shown where there is no number (an en dash); the words that say why stand beside it."""

_SUPERSCRIPTS = str.maketrans("-0123456789", "\u207b\u2070\u00b9\u00b2\u00b3\u2074\u2075\u2076\u2077\u2078\u2079")
_MAX_DECIMALS = 6
_MAX_INTEGER_DIGITS = 7


def decimals_for(uncertainty: float, fallback: int = 2) -> int:
    """Return the decimal places that an uncertainty supports, negative for tens, hundreds, ...

    By the Particle Data Group's rule, of a standard error, half-width or spread in the unit of the value, whatever its
    sign; ``fallback`` where it is below 1e-300, infinite or nan.
    """
    size = abs(uncertainty)
    if not math.isfinite(size) or size < 1e-300:
        return fallback
    exponent = math.floor(math.log10(size))
    # Dividing by a power of ten can land just outside [100, 1000); rounding to an integer first brings it back.
    leading = round(size / 10.0 ** (exponent - 2))
    if leading >= 1000:
        exponent, leading = exponent + 1, 100
    if leading >= 950:
        return -exponent
    return (1 if leading <= 354 else 0) - exponent


def decimals_of_significant(value: float, digits: int = 3) -> int:
    """Return the decimal places that show ``digits`` significant digits of a value."""
    if not math.isfinite(value) or value == 0.0:
        return max(digits - 1, 0)
    return digits - 1 - int(f"{value:.{digits - 1}e}".partition("e")[2])  # of the rounded value: 9.96 is 10 in two


def format_number(value: float, decimals: int = 2) -> str:
    """Format a value to a number of decimal places, with a true minus sign.

    Negative ``decimals`` round to tens, hundreds and so on. Where plain digits would be long (more than six decimals,
    or seven digits before the point) powers of ten are used. nan gives an en dash, infinity its sign.
    """
    if math.isnan(value):
        return NOTHING
    if math.isinf(value):
        return "\u221e" if value > 0 else MINUS + "\u221e"
    rounded = round(value, decimals)
    if rounded != 0.0 and (decimals > _MAX_DECIMALS or abs(rounded) >= 10.0**_MAX_INTEGER_DIGITS):
        exponent = math.floor(math.log10(abs(rounded)))
        digits = max(exponent + decimals, 0)
        mantissa = f"{rounded / 10.0**exponent:.{digits}f}"
        return f"{_signed(mantissa)} \u00d7 10{str(exponent).translate(_SUPERSCRIPTS)}"
    return _signed(f"{rounded:.{min(max(decimals, 0), _MAX_DECIMALS)}f}")


def _signed(text: str) -> str:
    """Replace the hyphen by a minus sign and drop the sign of zero."""
    if text.startswith("-"):
        return text[1:] if not text.strip("-0.") else MINUS + text[1:]
    return text


def format_significant(value: float, digits: int = 3) -> str:
    """Format a value to a number of significant digits."""
    return format_number(value, decimals_of_significant(value, digits))


def format_against(value: float, target: float, digits: int) -> str:
    """Format a value to as many significant digits, or to as many more as show on which side of its target it is."""
    return format_significant(value, telling(value, target, digits))


def width_digits(width: float) -> int:
    """Significant digits of a half-width: two, or three where the first is 1."""
    return 3 if f"{width:e}".startswith("1") else 2


def format_plus_minus(value: float, uncertainty: float) -> str:
    """Format ``value ± uncertainty``, both to the decimal place of the uncertainty."""
    decimals = decimals_for(uncertainty, decimals_of_significant(value, 3))
    if not math.isfinite(uncertainty):
        return format_number(value, decimals)
    return f"{format_number(value, decimals)}\u00a0\u00b1\u00a0{format_number(abs(uncertainty), decimals)}"


def format_around(low: float, value: float, high: float) -> str:
    """Format ``value (low to high)``, to the digits that the shorter side supports; ``low`` is never rounded to 0."""
    decimals = decimals_for(min(value - low, high - value), decimals_of_significant(value, 3))
    below = format_number(low, max(decimals, decimals_of_significant(low, 1)))
    return f"{format_number(value, decimals)} ({below} to {format_number(high, decimals)})"


def format_range(low: float, high: float, decimals: int | None = None) -> str:
    """Format ``low to high``, to the digits that half their distance supports unless ``decimals`` says otherwise."""
    if math.isnan(low) or math.isnan(high):
        return NOTHING
    places = decimals_for(0.5 * (high - low)) if decimals is None else decimals
    return f"{format_number(low, places)} to {format_number(high, places)}"


def format_p(p: float) -> str:
    """Format a probability of the tail: two significant digits down to 0.001, below that ``< 0.001``."""
    if math.isnan(p):
        return NOTHING
    if p < 0.001:
        return "< 0.001"
    return format_number(p, 3 if p < 0.0995 else 2)


def format_percent(fraction: float) -> str:
    """Format a fraction as percent: whole percents, with one decimal below one and above 99 percent."""
    if math.isnan(fraction):
        return NOTHING
    percent = min(max(100.0 * fraction, 0.0), 100.0)  # a sum of probabilities may pass 1 by rounding
    if 0.0 < percent < 0.1:
        return "< 0.1\u00a0%"
    if 99.9 < percent < 100.0:
        return "> 99.9\u00a0%"
    decimals = 0 if 0.95 <= percent <= 99.05 or percent in (0.0, 100.0) else 1
    return f"{format_number(percent, decimals)}\u00a0%"


def format_share(fraction: float) -> str:
    """Format a probability that is known from draws: none or all of them is no certainty."""
    return format_percent(min(max(fraction, 1e-4), 1.0 - 1e-4)) if math.isfinite(fraction) else NOTHING


def format_plain(value: float) -> str:
    """Format a number that a person chose (a bound, a target): all its digits and no more."""
    if not math.isfinite(value):
        return format_number(value)
    text = f"{value:.12g}"
    if "e" in text or text.endswith("0" * 7):
        mantissa, exponent = f"{value:.11e}".split("e")
        mantissa = mantissa.rstrip("0").rstrip(".")
        return f"{_signed(mantissa)} \u00d7 10{str(int(exponent)).translate(_SUPERSCRIPTS)}"
    return _signed(text)
