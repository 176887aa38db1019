"""What is not known of the ground: how far the tables' means may be off, and one draw of that, a world.

The mean of a table's row departs from that of a given ground by a standard deviation ``mean_sd``, which rests on how
much two sources of the same cover and band differ (`data/mean_sd.csv`). A world is one draw of all departures; flights
over one ground meet the same world on different occasions. Departures are normal and of unit variance times the row's
``mean_sd``, with these correlations:

* covers: a quarter of the variance is common to all, a quarter to kin (covers of one class of ground), half is a
  cover's own. Sites of C-band measurements share half of their variance over crops, the two L-band flights none.
* channels: 0.85 between HH and VV, 0.75 between either and HV, as between the differences of the same sources; from 40
  deg down HH and VV get alike, `own_weights`. H and V of emissivity: 1 at nadir to 0.9 at grazing, by the square of the
  sine; TELSEM2 (below) has 0.94 at 53 deg.
* bands: straight lines between draws two octaves apart, `drawn_by_frequency`: 0.3 between L and C band, 0.99 between
  1.25 and 1.4 GHz (assumed). Emission changes in 4.5 octaves as much, `emission_as_ghz`: 0.97 between 19 and 37 GHz,
  0.88 between 37 and 85, 0.74 between 19 and 85. The atlas of emissivities TELSEM2 (Aires et al. 2011, Q. J. R.
  Meteorol. Soc. 137, 690-699, and its later files) relates places of one class of snow-free land by 0.95, 0.83, 0.73.
* angles: cos(2 (a - b)), so that 30 degrees apart half of a departure is left (assumed).
* days: the course of a cover through the year departs by four harmonics of the year, which lose half of their
  correlation in some 45 days (assumed), less their mean over the days for which the level holds: there the course is
  known as well as the level is. Covers share it as they share departures of means: between two sites of C-band months
  0.13 (VV) and 0.39 (HV) of its variance is common to crops.
* bare soil: where a crop leaves soil bare, its departures are the soil's, `over_soil`; under snow, too (assumed). From
  November to March maize and winter wheat depart alike from one site of C-band months to another: by 1.0 (VV) and
  0.5 dB (HV) rms more or less than each other, from May to August by 2.5 and 3.3.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from functools import lru_cache
from typing import Final

import numpy as np

from seqrsm.arrays import FloatArray
from seqrsm.rng import generator
from seqrsm.scattering.readers import shipped_rows

BARE_SOIL: Final = "Bareground"
OWN: Final = "own"
"""In `data/mean_sd.csv`, a cover that `data/variability.csv` does not hold."""

_ALL, _KIN = 0.25, 0.25
_LOWEST_GHZ, _STEP_OCTAVES, _EMISSION_OCTAVES = 0.9, 2.0, 4.5
_COMMON, _CO = 0.75, 0.10  # shares of a deviate that all channels, and that HH and VV have in common
_EMISSIVITY_OWN: Final = 0.1
_PARTS: Final = {"common": 0, "co": 1, "HH": 2, "HV": 3, "VV": 4, "H": 5, "V": 6}
_ANGLE_RATE: Final = 2.0
_ELSEWHERE: Final = 2**40
_FIELD_LOG_SD: Final = 0.3  # of the field-to-field standard deviations of the classes of the Flevoland flight
_TURN: Final = _ANGLE_RATE * np.deg2rad(np.arange(91.0) - 40.0)
_BY_ANGLE: Final = np.stack([np.cos(_TURN), np.sin(_TURN)])
_YEAR: Final = 2.0 * np.pi * np.arange(1.0, 366.0) / 365.0
_HARMONICS: Final = (0.4, 0.3, 0.2, 0.1)  # shares of the variance
_SLANT: Final = np.sin(np.deg2rad(np.arange(91.0)))
_FULL_APART_DEG: Final = 40.0


@dataclass(frozen=True, slots=True)
class World:
    """One draw of everything that the tables do not know; the same seed and number give the same world."""

    seed: int
    number: int
    """Of the campaign, and of the world in it."""
    elsewhere: tuple[str, ...] = ()
    """Covers whose own parts, which they share with no other, are as in another world."""

    def departure(self, category: str, kin: str, frequency_ghz: float, channel: str) -> FloatArray:
        """Standard normal departure (91,) of a cover's mean at incidence angles 0, 1, ..., 90 degrees.

        ``kin``: class that the cover shares part of its departure with; "" for none. ``channel``: HH, HV, VV of
        backscatter, H, V of emissivity.
        """
        emission = channel in ("H", "V")
        ghz = emission_as_ghz(frequency_ghz) if emission else frequency_ghz
        deviate = _shared(self.seed, self.numbers(category), category, kin, ghz, 0)
        if not emission:
            return _of_channel(deviate @ _BY_ANGLE, channel, _OWN_BY_ANGLE)
        apart = _EMISSIVITY_OWN * _SLANT**2
        common, own = deviate[[0, _PARTS[channel]]] @ _BY_ANGLE
        return np.asarray(np.sqrt(1.0 - apart) * common + np.sqrt(apart) * own)

    def season(self, category: str, kin: str, frequency_ghz: float, channel: str, level_days: FloatArray) -> FloatArray:
        """Departure (365,) of the course of a cover's backscatter on days 1 to 365, of unit mean square over the year.

        Of the same covers, frequencies and channels of backscatter as `departure`, and independent of it.
        ``level_days`` (365,): weights of the days for which the table's level holds, which sum to 1; the departure's
        mean over them is 0.
        """
        return _season(self.seed, self.numbers(category), category, kin, frequency_ghz, channel, level_days.tobytes())

    def field_factor(self, category: str) -> float:
        """What the cover's standard deviation from field to field is multiplied by, 1 in the middle."""
        return _field_factor(self.seed, self.numbers(category)[1], category)

    def of(self, category: str) -> World:
        """The world as one cover knows it: the same where others are elsewhere."""
        return World(self.seed, self.number, (category,) * (category in self.elsewhere))

    def numbers(self, category: str) -> tuple[int, int]:
        """Of the world that a cover shares with others, and of the one that it has for its own."""
        return self.number, self.number + _ELSEWHERE * (category in self.elsewhere)


def co_apart(theta_deg: FloatArray | float, full_deg: float = _FULL_APART_DEG) -> FloatArray:
    """How far HH and VV are apart at incidence angles [deg], over what they are from ``full_deg`` on: 0 to 1.

    At nadir nothing of the ground tells one from the other; differences begin with the square of the sine.
    """
    sine = np.sin(np.deg2rad(np.minimum(theta_deg, full_deg)))
    return np.asarray(np.square(sine / math.sin(math.radians(full_deg))))


def own_weights(channel: str, theta_deg: FloatArray | float) -> FloatArray:
    """Weights (3, ...) of draws of HH's, HV's and VV's own by which a channel departs at incidence angles [deg].

    Their squares add to 1. From 40 deg on each has its own alone; HH and VV then get the same of both, related by one
    less the square of `co_apart`. Fields of the L-band flight over Flevoland are related by 0.93, 0.84 and 0.50 in all
    at some 31, 43 and 51 deg.
    """
    half = 0.5 * np.arcsin(1.0 - np.square(co_apart(theta_deg)))
    own, other, none = np.cos(half), np.sin(half), np.zeros_like(half)
    return np.stack({"HH": (own, none, other), "HV": (none, none + 1.0, none), "VV": (other, none, own)}[channel])


_OWN_BY_ANGLE: Final = {channel: own_weights(channel, np.arange(91.0)) for channel in ("HH", "HV", "VV")}
_OWN_OF_SEASON: Final = {channel: own_weights(channel, 90.0) for channel in ("HH", "HV", "VV")}


def over_soil(
    own: FloatArray, soil: FloatArray, closed: FloatArray | float, related: FloatArray | float = 0.0
) -> FloatArray:
    """Standard normal departures of covers that hide a share ``closed`` of the soil, from their own and bare soil's.

    ``related``: correlation of the two.
    """
    bare = 1.0 - np.asarray(closed)
    return (closed * own + bare * soil) / np.sqrt(np.square(closed) + np.square(bare) + 2.0 * closed * bare * related)


def related_covers(kin: str, other: str) -> float:
    """Correlation of the departures of two covers of these classes."""
    return _ALL + _KIN * (kin == other != "")


def course_deviation(level_days: FloatArray) -> FloatArray:
    """Standard deviation (365,) of `World.season` on each day, for weights as it has them."""
    return _anchored(level_days.tobytes())[1]


@lru_cache(maxsize=16)
def _anchored(level_days: bytes) -> tuple[FloatArray, FloatArray]:
    """Cosines and sines of the harmonics by days (8, 365), and the standard deviation (365,) of a course.

    Less their mean over some days, and over what is then left of a course's standard deviation over the year.
    """
    phase = np.outer(np.arange(1, len(_HARMONICS) + 1), _YEAR)
    waves = np.sqrt(_HARMONICS)[:, None, None] * np.stack([np.cos(phase), np.sin(phase)], axis=1)
    waves = waves.reshape(-1, _YEAR.size)
    waves = waves - (waves @ np.frombuffer(level_days))[:, None]
    variance = np.square(waves).sum(axis=0)
    return waves / math.sqrt(variance.mean()), np.sqrt(variance / variance.mean())


@lru_cache(maxsize=256)  # of several channels
def _field_factor(seed: int, number: int, category: str) -> float:
    """See `World.field_factor`."""
    return float(np.exp(_FIELD_LOG_SD * generator(seed, number, f"world fields {category}").normal()))


@lru_cache(maxsize=256)  # of several dates
def _season(
    seed: int, numbers: tuple[int, int], category: str, kin: str, frequency_ghz: float, channel: str, level_days: bytes
) -> FloatArray:
    """See `World.season`."""
    harmonics = range(1, 1 + len(_HARMONICS))
    deviates = [
        _of_channel(_shared(seed, numbers, category, kin, frequency_ghz, harmonic), channel, _OWN_OF_SEASON)
        for harmonic in harmonics
    ]
    return np.asarray(np.concatenate(deviates) @ _anchored(level_days)[0])


def _of_channel(deviate: FloatArray, channel: str, own_of: Mapping[str, FloatArray]) -> FloatArray:
    """Values (n,) of a channel of backscatter from those of all parts (parts, n), by `own_weights` of each channel."""
    common, co, *own = deviate[:5]
    co_share = 0.0 if channel == "HV" else _CO
    single = sum(weight * part for weight, part in zip(own_of[channel], own, strict=True))
    return np.asarray(
        math.sqrt(_COMMON) * common + math.sqrt(co_share) * co + math.sqrt(1.0 - _COMMON - co_share) * single
    )


@lru_cache(maxsize=256)  # of several channels
def _shared(
    seed: int, numbers: tuple[int, int], category: str, kin: str, frequency_ghz: float, harmonic: int
) -> FloatArray:
    """Standard normal (parts, 2), in part common to all covers, to kin, and a cover's own."""
    own = 1.0 - _ALL - (_KIN if kin else 0.0)
    parts = [("", _ALL, 0), (f"kin {kin}", 1.0 - _ALL - own, 0), (f"cover {category}", own, 1)]
    drawn = [math.sqrt(w) * _drawn(seed, numbers[i], name, frequency_ghz, harmonic) for name, w, i in parts if w > 0.0]
    return np.asarray(sum(drawn))


@lru_cache(maxsize=256)  # covers share some of them
def _drawn(seed: int, number: int, name: str, frequency_ghz: float, harmonic: int) -> FloatArray:
    """Standard normal (parts, 2) at a frequency, of a harmonic of the year or, with 0, by incidence angle."""
    name = f"season {harmonic} {name}" if harmonic else name
    return drawn_by_frequency(seed, number, f"world {name}", (len(_PARTS), 2), frequency_ghz)


def drawn_by_frequency(
    seed: int,
    number: int,
    purpose: str,
    shape: tuple[int, ...],
    frequency_ghz: float,
    step_octaves: float = _STEP_OCTAVES,
) -> FloatArray:
    """Standard normal draws of a shape that depend on the frequency, so that near ones see nearly the same.

    Draws stand at 0.9 GHz and every step from there, a frequency takes straight lines between. With steps of two
    octaves L and C band are correlated by 0.3, C and X by 0.7 (assumed). What one frequency draws does not depend on
    which others are drawn. ``number``: run or world of a campaign's ``seed``; ``purpose``: name of the draws.
    """
    lower, share = _place(frequency_ghz, step_octaves)
    here, above = (generator(seed, number, f"{purpose} band {lower + k}").standard_normal(shape) for k in (0, 1))
    return np.asarray(((1.0 - share) * here + share * above) / math.hypot(1.0 - share, share))


def emission_as_ghz(frequency_ghz: float) -> float:
    """Frequency [GHz] at which `drawn_by_frequency` draws for emission at a frequency [GHz].

    Departures of emissivity from their means change more slowly with frequency than those of backscatter.
    """
    return float(_LOWEST_GHZ * (frequency_ghz / _LOWEST_GHZ) ** (_STEP_OCTAVES / _EMISSION_OCTAVES))


def related_by_frequency(one_ghz: float, other_ghz: float, step_octaves: float = _STEP_OCTAVES) -> float:
    """Correlation of what two frequencies [GHz] see of `drawn_by_frequency`."""
    places = (_place(ghz, step_octaves) for ghz in (one_ghz, other_ghz))
    first, second = ({band: 1.0 - share, band + 1: share} for band, share in places)
    common = sum(weight * second.get(band, 0.0) for band, weight in first.items())
    return common / (math.hypot(*first.values()) * math.hypot(*second.values()))


def _place(frequency_ghz: float, step_octaves: float) -> tuple[int, float]:
    """Number of the draws below a frequency, and its place between them and the next."""
    at = math.log2(frequency_ghz / _LOWEST_GHZ) / step_octaves
    return math.floor(at), at % 1.0


@lru_cache(maxsize=4096)
def default_mean_sd(quantity: str, category: str, status: str, frequency_ghz: float, channel: str) -> float:
    """Standard deviation of a row's mean by what it rests on: [dB] of sigma0, [1] of emissivity.

    The first row of `data/mean_sd.csv` that fits; an empty cell fits everything.
    """
    kind = "cross" if channel == "HV" else "co"
    for row in shipped_rows("mean_sd.csv"):
        wanted = (("quantity", quantity), ("category", category), ("status", status), ("polarization", kind))
        low, high = float(row.text("low_ghz") or 0.0), float(row.text("high_ghz") or math.inf)
        if low <= frequency_ghz < high and all(row.text(name) in ("", value) for name, value in wanted):
            return float(row.text("mean_sd"))
    raise KeyError((quantity, status))  # a gap in the shipped file, not a user's error
