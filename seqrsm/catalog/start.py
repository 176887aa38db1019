"""Start ranges of the sensor's parameters for an application, taken from what Tables A.1 to A.20 print.

Each printed value is one statement. The start range of a parameter reaches from the lowest to the highest printed
number; inside it stands the part on which most statements agree, the prior knowledge of where the optimum lies.
Equal prints of one table count once.

Which utility that ships measures an application, or why none does, is in ``measures.csv``: patterns, the first of which
that is found in the words counts; the utility as in ``campaign.toml``, and the engine that it needs or suits; or why
there is none.
"""

from __future__ import annotations

import difflib
import re
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from functools import lru_cache
from itertools import pairwise
from math import inf

from seqrsm.catalog.search import entries_about, platforms_called, table_called, words_of
from seqrsm.catalog.tables import Entry, Range, load_catalog, rows_of
from seqrsm.errors import UserError

#: Where an open side is closed when only one number is printed: value, and the print that gives it.
_TABLE_EDGES = {
    ("frequency", "active", "low"): (0.4, "Table A.8: no active requirement in P-Band"),
    ("frequency", "active", "high"): (36.0, "Table A.12: no requirements above 36 GHz were found"),
    ("frequency", "passive", "low"): (0.4, "Table A.13: no passive requirement in P-Band"),
    ("frequency", "passive", "high"): (100.0, "Table A.15: upper edge of W-Band"),
    ("resolution", "active", "low"): (0.5, "Table A.17: finest resolution wanted"),
    ("depression_angle", "active", "low"): (10.0, "Tables A.16, A.17 and A.20: largest nadir angle, 80 deg"),
    ("depression_angle", "active", "high"): (90.0, "Tables A.16, A.17 and A.19: smallest nadir angle, 0 deg"),
}

_CHANNELS = ("HH", "HV", "VV")


@dataclass(frozen=True, slots=True)
class Source:
    """One print that a start range rests on."""

    table: str
    """Number of the table."""
    printed: str
    """What is printed."""
    ranges: tuple[Range, ...]
    """What it says in the parameter's unit."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Suggestion:
    """What the literature suggests of a factor."""

    sources: tuple[Source, ...]
    """Every print it rests on, by table."""
    notes: tuple[str, ...]
    """How open sides were closed, and what else to know."""

    @property
    def tables(self) -> tuple[str, ...]:
        """Numbers of the tables it rests on."""
        return tuple(dict.fromkeys(source.table for source in self.sources))


@dataclass(frozen=True, slots=True)
class StartRange(Suggestion):
    """Suggested range of one numeric factor."""

    name: str
    """One of "frequency", "resolution" and "depression_angle": name of the parameter in ``campaign.toml``."""
    unit: str
    """One of "GHz", "m" and "deg": its unit."""
    scale: str
    """Either "log" or "linear": coding of the factor."""
    ends: tuple[float, float] | None
    """Start range in ``unit``; None where no number is printed; both alike where only one is."""
    agreed: tuple[float, float] | None
    """Part of it on which most sources agree; None where no two of several do."""
    n_agreeing: int
    """How many sources cover that part."""
    best: float | None
    """Value printed as best."""


@dataclass(frozen=True, slots=True)
class StartLevels(Suggestion):
    """Suggested levels of the factor polarization; among its sources are those that name no channel."""

    levels: tuple[str, ...]
    """Single channels first, then sets ("HH+HV"); empty where no channel is printed."""


@dataclass(frozen=True, slots=True)
class StartRanges:
    """What the literature suggests for an application."""

    system: str
    """Either "active" or "passive": radar or radiometer."""
    entries: tuple[Entry, ...]
    """The entries all numbers come from."""
    ranges: tuple[StartRange, ...]
    """frequency, resolution and, for radar, depression_angle."""
    polarization: StartLevels
    """Levels of polarization."""


def _sources(
    entries: Iterable[Entry], printed: Callable[[Entry], str], ranges: Callable[[Entry], tuple[Range, ...]]
) -> tuple[Source, ...]:
    """Prints with their ranges, each print of a table once; entries that print nothing are left out."""
    found = dict.fromkeys(Source(e.table, text, ranges(e)) for e in entries if (text := printed(e)))
    return tuple(sorted(found, key=lambda source: int(source.table.removeprefix("A."))))


def agreement(sources: Sequence[tuple[Range, ...]]) -> tuple[float, float, int]:
    """Ends of the interval that most sources cover, and how many do; of several as often covered, of the lowest.

    Each source has ranges, at least one of them with a number; open sides reach without end.
    """
    closed = [
        [(-inf if r.low is None else r.low, inf if r.high is None else r.high) for r in ranges] for ranges in sources
    ]
    ends = sorted({end for ranges in closed for r in ranges for end in r})
    # Between two neighbouring ends the count is constant. Two ranges that only touch do not agree: a single value
    # counts where it is printed as such.
    places = [(low, high) for low, high in pairwise(ends)]
    places += {(low, high) for ranges in closed for low, high in ranges if low == high}
    places.sort()
    counts = [sum(any(r[0] <= a and b <= r[1] for r in ranges) for ranges in closed) for a, b in places]
    most = max(counts)
    first = last = counts.index(most)
    while last + 1 < len(counts) and counts[last + 1] == most and places[last + 1][0] == places[last][1]:
        last += 1
    return places[first][0], places[last][1], most


def _start_range(
    name: str, unit: str, scale: str, system: str, sources: tuple[Source, ...], best: float | None
) -> StartRange:
    ranges = [source.ranges for source in sources if source.ranges]
    numbers = [end for values in ranges for r in values for end in (r.low, r.high) if end is not None]
    if not numbers:
        none = ("no number is printed",)
        return StartRange(name, unit, scale, None, None, 0, best, sources=sources, notes=none)
    low, high, notes = min(numbers), max(numbers), []
    for side in ("low", "high"):
        if any(getattr(r, side) is None for values in ranges for r in values):
            edge = _TABLE_EDGES.get((name, system, side))
            if low == high and edge is not None:
                low, high = (edge[0], high) if side == "low" else (low, edge[0])
                notes.append(f"{side} end not printed; {edge[0]:g} {unit} from {edge[1]}")
            else:
                notes.append(f"a source prints no {side} end: the range is that of the printed numbers")
    agreed_low, agreed_high, count = agreement(ranges)
    agreed = (max(agreed_low, low), min(agreed_high, high)) if count > 1 or len(ranges) == 1 else None
    if agreed is None:
        notes.append("no two sources agree")
    if low == high:
        notes.append("only one value is printed")
    return StartRange(name, unit, scale, (low, high), agreed, count, best, sources=sources, notes=tuple(notes))


def _resolution_ranges(entry: Entry) -> tuple[Range, ...]:
    ends = [r for r in (entry.resolution_wanted_m, entry.resolution_accepted_m) if r is not None]
    if ends:
        return (Range(min(ends), max(ends)),)
    return (entry.resolution_class_m,) if entry.resolution_class_m else ()


def _resolution_print(entry: Entry) -> str:
    if entry.resolution_wanted or entry.resolution_accepted:
        return f"wanted {entry.resolution_wanted or '-'}, accepted {entry.resolution_accepted or '-'} m"
    return entry.heading if entry.resolution_class_m else ""


def _depression_ranges(entry: Entry) -> tuple[Range, ...]:
    """Depression angles [deg] of the printed nadir angles, on flat ground: one is 90 minus the other."""
    return tuple(
        Range(None if r.high is None else 90.0 - r.high, None if r.low is None else 90.0 - r.low)
        for r in entry.nadir_angle_deg
    )


def _polarization(entries: Sequence[Entry]) -> StartLevels:
    sources = _sources(entries, lambda entry: entry.polarization, lambda entry: ())
    sets = {channels for entry in entries for channels in entry.channels}
    singles = {(channel,) for channels in sets for channel in channels}
    order = sorted(sets | singles, key=lambda channels: (len(channels), [_CHANNELS.index(c) for c in channels]))
    notes = [] if order else ["no channel is printed"]
    if any("cross" in source.printed.lower() for source in sources):
        notes.append("cross is taken as HV")
    return StartLevels(tuple("+".join(channels) for channels in order), sources=sources, notes=tuple(notes))


def _none_found(words: str, system: str) -> UserError:
    for kind, named in (("table", table_called(words)), ("spacecraft", platforms_called(words))):
        if named:
            hint = f"Name what you want to observe; `seqrsm catalog {words.strip()}` shows the {kind}."
            return UserError(f"this is a {kind}, not an application", hint, value=words)
    elsewhere = any(entry.system != system for entry in entries_about(words))
    entries = [entry for entry in load_catalog().entries if entry.system == system or not elsewhere]
    known = {word for entry in entries for word in words_of(entry.name)}
    near = [match for word in words_of(words) for match in difflib.get_close_matches(word, known, n=2)]
    hint = f"Near words in the tables: {', '.join(dict.fromkeys(near))}." if near else "Use fewer or other words."
    kind = f"{system} application" if elsewhere else "application"
    return UserError(f"no {kind} of Tables A.1 to A.20 holds all of these words", hint, value=words)


def start_ranges(words: str, *, system: str = "active") -> StartRanges:
    """Suggested start ranges and prior knowledge for an application, from its words; ``system``: "active" or "passive".

    Frequency [GHz], resolution [m], for radar depression angle [deg] and, for both, levels of polarization. The numbers
    are those of print, also where a simulator takes less (nadir is a depression angle of 90 deg). UserError without
    words, or where no entry holds them all.
    """
    if not words_of(words):
        raise UserError("no words to look up", "Name an application, such as 'soil moisture'.", value=words)
    entries = entries_about(words, system=system)
    if not entries:
        raise _none_found(words, system)
    frequency = _sources(
        entries,
        lambda entry: ", ".join(filter(None, (entry.frequency, entry.wavelength))),
        lambda entry: entry.frequency_ghz,
    )
    ranges = [
        _start_range("frequency", "GHz", "log", system, frequency, None),
        _start_range("resolution", "m", "log", system, _sources(entries, _resolution_print, _resolution_ranges), None),
    ]
    if system == "active":
        angles = _sources(entries, lambda entry: entry.nadir_angle, _depression_ranges)
        best = {90.0 - e.best_nadir_angle_deg for e in entries if e.best_nadir_angle_deg is not None}
        only = best.pop() if len(best) == 1 else None
        ranges.append(_start_range("depression_angle", "deg", "linear", system, angles, only))
    return StartRanges(system, entries, tuple(ranges), _polarization(entries))


@dataclass(frozen=True, slots=True)
class Measure:
    """What an application is measured by."""

    utility: str
    """As in ``campaign.toml``; "" where none that ships measures it."""
    engine: str
    """Either "psm" or "prm", which the utility needs or suits; "" without one."""
    says: str
    """Why there is none; "" where there is one."""


def measure_of(words: str) -> Measure:
    """The measure of an application, from its words: the first row of ``measures.csv`` whose pattern is in them."""
    text = words.lower()
    return next(found for pattern, found in _measures() if pattern.search(text))


@lru_cache(maxsize=1)
def _measures() -> list[tuple[re.Pattern[str], Measure]]:
    rows = rows_of("measures.csv")
    return [(re.compile(row["pattern"]), Measure(row["utility"], row["engine"], row["says"])) for row in rows]
