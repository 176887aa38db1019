"""Sets of sensors that look at one ground together, and the dates on which they do.

A set is written as the frequency of a configuration: ``L+C`` names two members, ``1.25+9.6`` two others. A member is a
band letter, a number of gigahertz, or a name for which ``[simulator.members.NAME]`` gives what that member has of its
own, its engine among it. What is given without a name holds for every member that has such a parameter;
``C.resolution`` belongs to the member C. A member's own table goes before a factor without a name, a factor with its
name before both.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from itertools import pairwise
from typing import Any, Final

from seqrsm.errors import ConfigurationError, Problem
from seqrsm.sensor.parameters import CALENDAR, RADAR, RADIOMETER, Parameter, configured

SENSORS: Final[Mapping[str, Mapping[str, Parameter]]] = {
    "psm": {**RADAR, **CALENDAR},
    "prm": {**RADIOMETER, **CALENDAR},
}
"""Parameters by engine, those of the dates among them."""

BANDS: Final[Mapping[str, float]] = {
    "P": 0.435, "L": 1.25, "S": 3.2, "C": 5.4, "X": 9.65, "Ku": 13.6, "K": 18.7, "Ka": 35.0,
}  # fmt: skip
"""Frequency that a band's letter stands for [GHz]."""

YEAR_DAYS: Final = 365
_LATEST: Final = 3 * YEAR_DAYS  # a named sensor may pass some weeks after the latest first day, 730
NEXT_YEAR: Final = "Count days of the next year on from 365"

Values = Mapping[str, float | str]


@dataclass(frozen=True, slots=True)
class Dates:
    """When a sensor looks.

    Raises
    ------
    ConfigurationError
        Dates without a day, out of order, or given twice.
    """

    dates: int = 1
    """How many times."""
    first_day: float | None = None
    """Day of the year of the first, or on into the next (380 is its 15th); None: the season stands for it."""
    interval_days: float = 12.0
    """Between one date and the next [d]."""
    days: str = ""
    """The days themselves, as in ``120+150+200``, in place of the three."""

    def __post_init__(self) -> None:
        if self.days and (self.dates != 1 or self.first_day is not None):
            text = "the days are specified twice"
            raise ConfigurationError(text, "Give days, or dates and first_day", field="days", value=self.days)
        if not self.days and self.first_day is None and self.dates != 1:
            text = "several dates need a first day"
            raise ConfigurationError(text, "Give first_day", field="dates", value=self.dates)
        field, value = ("days", self.days) if self.days else ("first_day", self.first_day)
        rising = all(1.0 <= day < later for day, later in pairwise((*self.on, math.inf)))
        if not rising or self.on[:1] > (_LATEST,):
            text, remedy = "these are no rising days of the year", f"Write each once, in order, from 1. {NEXT_YEAR}"
            raise ConfigurationError(text, f"{remedy}: 385 in place of 20", field=field, value=value)

    @property
    def on(self) -> tuple[float, ...]:
        """Days, rising, those of the next year beyond 365; empty where the season stands for them."""
        if self.days:
            try:
                return tuple(float(day) for day in self.days.split("+"))
            except ValueError:
                return (math.nan,)
        if self.first_day is None:
            return ()
        return tuple(self.first_day + k * self.interval_days for k in range(self.dates))


def day_of_year(day: float) -> float:
    """Day of the year, from 1 to below 366, of a day that may be counted on into later years."""
    return day - YEAR_DAYS * ((math.floor(day) - 1) // YEAR_DAYS)


@dataclass(frozen=True, slots=True)
class Member:
    """One sensor of a set."""

    name: str
    """Empty where there is only one."""
    engine: str

    settings: Values
    fixed: Values
    """Its parameters, those of the dates left out."""
    dates: Dates


def frequency_of(name: str, members: Mapping[str, Values]) -> float | None:
    """Frequency [GHz] of a member by its table, band letter or number; None: no such member."""
    written = members.get(name, {}).get("frequency", name)
    try:
        return BANDS.get(str(written)) or float(written)
    except (TypeError, ValueError):
        return None


def set_problems(written: float | str, members: Mapping[str, Values]) -> list[Problem]:
    """What makes a set of frequencies impossible, such as an unknown or doubled member."""
    names = [part.strip() for part in str(written).split("+")]
    for name in names:
        if frequency_of(name, members) is None:
            known = ", ".join(dict.fromkeys([*BANDS, *members]))
            remedy = f"A member is a number of GHz, a band or a [simulator.members] of yours: {known}"
            return [Problem("no such member of a set", remedy, field="frequency", value=name)]
    if len(set(names)) < len(names):
        return [Problem("a member stands twice in the set", "Give it once", field="frequency", value=written)]
    return []


def members_of(engine: str, settings: Values, fixed: Values, members: Mapping[str, Values]) -> tuple[Member, ...]:
    """The sensors of a configuration, each with what is its own.

    ``engine`` is of members that do not name another; ``settings`` and ``fixed`` are levels of the factors, and what is
    no factor; ``members`` tells what members have of their own, by name. ConfigurationError tells unknown or doubled
    members, and impossible dates.
    """
    written = settings.get("frequency", fixed.get("frequency", 0.0))
    own = bool(members) or any("." in name for name in (*settings, *fixed))
    if not isinstance(written, str) or (not own and "+" not in written):
        dates, plain, rest = _apart(_in_ghz(settings), _in_ghz(fixed))
        return (Member("", engine, plain, rest, dates),)
    problems = set_problems(written, members)
    if problems:
        raise ConfigurationError(*problems)
    return tuple(_member(part.strip(), engine, settings, fixed, members) for part in written.split("+"))


def _in_ghz(values: Values) -> Values:
    """The same with a band's letter as its frequency."""
    return {key: BANDS.get(str(value), value) if key == "frequency" else value for key, value in values.items()}


def _member(name: str, engine: str, settings: Values, fixed: Values, members: Mapping[str, Values]) -> Member:
    own = dict(members.get(name, {}))
    own_engine = str(own.pop("engine", engine))
    table = SENSORS[own_engine]
    given: dict[str, Any] = {}
    for values in (fixed, settings):
        given |= {key: value for key, value in values.items() if key in table}
    given |= own
    for values in (fixed, settings):
        given |= {key.rpartition(".")[2]: v for key, v in values.items() if key.rpartition(".")[:2] == (name, ".")}
    given["frequency"] = frequency_of(name, members)
    dates, given, _ = _apart(given, {})
    return Member(name, own_engine, given, {}, dates)


def _apart(settings: Values, fixed: Values) -> tuple[Dates, dict[str, Any], dict[str, Any]]:
    """The dates, and settings and fixed parameters without them."""
    when = [{k: v for k, v in values.items() if k in CALENDAR} for values in (settings, fixed)]
    rest = [{k: v for k, v in values.items() if k not in CALENDAR} for values in (settings, fixed)]
    return configured("calendar", Dates, CALENDAR, *when), rest[0], rest[1]
