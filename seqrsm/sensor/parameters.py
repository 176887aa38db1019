"""Every parameter of the two sensors, a row of ``data/parameters.csv`` each, and all that is read from the rows.

A row says by which name ``campaign.toml`` knows the parameter, which field of the configuration it sets, its unit, its
limits or levels, what it is, and why a campaign cannot vary it where it cannot. From the rows come the names taken as
factors and under ``[simulator.fixed]``, the conversion of what is written there, the check of every value alone, the
units and labels of reports, and what ``seqrsm parameters`` prints. Defaults stand with the fields, in
`seqrsm.sensor.radar.RadarConfiguration` and `seqrsm.sensor.radiometer.RadiometerConfiguration`. A new parameter is a
field there and a row here; one that a campaign is to vary, and could not, loses the reason in its row.
"""

from __future__ import annotations

import csv
import difflib
import math
from collections.abc import Callable, Mapping
from dataclasses import MISSING, dataclass, fields
from pathlib import Path
from types import MappingProxyType
from typing import Any, Final, Literal, TypeVar

from seqrsm.errors import ConfigurationError, Problem
from seqrsm.sensor.antenna import pattern_points

Kind = Literal["number", "whole", "word", "channels", "pattern", "function", "file", "days"]


@dataclass(frozen=True, slots=True)
class Parameter:
    """One parameter of a sensor."""

    name: str
    """In ``campaign.toml``."""
    field: str
    """Of the configuration."""
    kind: Kind
    """A number; a whole number; one of `levels`; some of `levels`, joined by "+"; points of an antenna pattern (see
    `seqrsm.sensor.antenna.pattern_points`); one of `levels` or a function of the user's, "module:function"; the path of
    a file; days of the year, joined by "+"."""
    what: str
    """What it is, in a phrase."""
    unit: str = ""
    """Empty for a pure number, and where there is no number."""
    low: float = -math.inf
    high: float = math.inf
    """Least and largest value [`unit`]."""
    levels: tuple[str, ...] = ()
    """All that a word may be; the channels that there are; the functions that have a name."""
    values: tuple[float, ...] = ()
    """All that a number may be which is not free between its limits [`unit`]."""
    why_fixed: str = ""
    """Why a campaign cannot vary it, "" where it can."""
    said: str = ""
    """Its name in a report, "" for `name` without underscores and without the suffix that tells the unit."""
    part: str = ""
    """Of `seqrsm.sensor.exchange.PROPERTIES`, that which it belongs to; "" for none."""

    @property
    def numeric(self) -> bool:
        """Whether its values are numbers."""
        return self.kind in ("number", "whole")

    @property
    def continuous(self) -> bool:
        """Whether it takes every number between its limits."""
        return self.kind == "number" and not self.values

    @property
    def allowed(self) -> str:
        """What it may be, in words."""
        levels = ", ".join(self.levels or [f"{value:g}" for value in self.values])
        if self.numeric and not self.values:
            whole = "whole " if self.kind == "whole" else ""
            return f"a {whole}number from {self.low:g} to {self.high:g} {self.unit}".rstrip()
        if self.kind == "channels":
            return f"one or more of {levels}, each once, as in {self.levels[0]}+{self.levels[1]}"
        if self.kind == "days":
            return 'days of the year, as in "120+150+200"'
        if self.kind == "pattern":
            return 'look angles [deg] and gains [dB], as in "0:-20, 40:0, 70:-3"'
        if self.kind == "function":
            named = f"{levels}, or " if levels else ""
            return f'{named}a function of yours, "package.module:function"'
        return "the path of a file" if self.kind == "file" else f"{levels} {self.unit}".rstrip()

    @property
    def label(self) -> str:
        """Its name as people read it; no two of a sensor have the same."""
        return self.said or self.name.removesuffix(f"_{self.unit.lower().replace('/', '_')}").replace("_", " ")

    def problem(self, value: object) -> Problem | None:
        """What makes a value of the field's type impossible, whatever the other parameters are; None: nothing."""
        if self.numeric:
            number = value if isinstance(value, int | float) and not isinstance(value, bool) else math.nan
            if not self.low <= number <= self.high:
                return Problem("out of range", f"Give {self.allowed}: {self.what}", field=self.name, value=value)
            if (self.kind == "whole" and number != round(number)) or (self.values and number not in self.values):
                return Problem("not one of its values", f"Give {self.allowed}", field=self.name, value=value)
        if self.kind == "channels":
            known = isinstance(value, tuple) and bool(value) and len(set(value)) == len(value)
            if not known or not set(value) <= set(self.levels):  # type: ignore[call-overload]
                written = "+".join(map(str, value)) if isinstance(value, tuple) else value
                return Problem("not a set of channels", f"Give {self.allowed}", field=self.name, value=written)
        elif self.kind == "function":
            if value and value not in self.levels and ":" not in str(value):
                return Problem("unknown", f"Give {self.allowed}", field=self.name, value=value)
        elif self.levels and value not in self.levels:
            return Problem("unknown", f"Known: {self.allowed}", field=self.name, value=value)
        return None

    def converted(self, written: float | str, problems: list[Problem]) -> object:
        """A value as the field holds it, from that of ``campaign.toml``; why it cannot be is added to ``problems``."""
        if self.numeric:
            try:
                if isinstance(written, bool):
                    raise ValueError
                number = float(written)
            except (TypeError, ValueError):
                problems.append(Problem("not a number", f"Give {self.allowed}", field=self.name, value=written))
                return written
            return int(number) if self.kind == "whole" and number.is_integer() else number
        text = str(written)
        if self.kind == "channels":
            return tuple(part.strip() for part in text.split("+"))
        if self.kind != "pattern":
            return text
        try:
            return pattern_points(text)
        except ConfigurationError as error:
            problems.extend(error.problems)
            return ()

    def level_problems(self, written: float | str) -> list[Problem]:
        """What makes a value of ``campaign.toml`` impossible as the level of a factor."""
        problems: list[Problem] = []
        if self.kind == "function" and written not in self.levels:
            text = f"your own function cannot be a level: {_CODE}" if ":" in str(written) else "unknown"
            remedy = f"Known: {', '.join(self.levels)}; your own function may be given in [simulator.fixed]"
            return [Problem(text, remedy, field=self.name, value=written)]
        # Levels are told apart as they are written: no blanks in "HH+HV".
        value = tuple(str(written).split("+")) if self.kind == "channels" else self.converted(written, problems)
        found = None if problems else self.problem(value)
        return problems if found is None else [found]


_CODE: Final = "a function may change, so runs of one level would not be repeats"
_ROWS: Final = Path(__file__).parent / "data" / "parameters.csv"


def _table(sensor: str) -> Mapping[str, Parameter]:
    """Parameters of a sensor by their names in ``campaign.toml``."""
    with _ROWS.open(encoding="utf-8", newline="") as file:
        rows = [row for row in csv.DictReader(file) if row.pop("sensor") == sensor]
    return MappingProxyType({row["name"]: _parameter(row) for row in rows})


def _parameter(row: Mapping[str, str]) -> Parameter:
    """A row; levels and values are separated by blanks, and an empty cell leaves the default."""
    number = int if row["kind"] == "whole" else float
    told: dict[str, Any] = {name: text for name, text in row.items() if text}
    told |= {end: number(told[end]) for end in ("low", "high") if end in told}
    told |= {"levels": tuple(row["levels"].split()), "values": tuple(map(float, row["values"].split()))}
    return Parameter(**told)


RADAR: Final = _table("radar")
"""Parameters of `RadarConfiguration` by their names in ``campaign.toml``."""

RADIOMETER: Final = _table("radiometer")
"""Parameters of `RadiometerConfiguration` by their names in ``campaign.toml``."""

CALENDAR: Final = _table("calendar")
"""Parameters of `seqrsm.sensor.sets.Dates`, which every sensor has, by their names in ``campaign.toml``."""


def value_problems(table: Mapping[str, Parameter], configuration: Any) -> list[Problem]:
    """Every value of a configuration that is impossible alone; None is possible where it is the default."""
    values = {field.name: (getattr(configuration, field.name), field.default) for field in fields(configuration)}
    checked = [(row, values[row.field]) for row in table.values() if row.kind not in ("file", "pattern")]
    found = (row.problem(value) for row, (value, default) in checked if value is not None or default is not None)
    return [problem for problem in found if problem is not None]


def listed(table: Mapping[str, Parameter], configuration: Any) -> list[dict[str, Any]]:
    """Every row in plain values, with the default of its field and whether the field must be given."""
    default = {field.name: field.default for field in fields(configuration)}
    return [
        {
            **{name: getattr(row, name) for name in ("name", "field", "unit", "kind", "what", "allowed", "why_fixed")},
            "low": row.low if row.numeric else None,
            "high": row.high if row.numeric else None,
            "levels": [*row.levels, *row.values],
            "default": None if default[row.field] in (MISSING, ()) else default[row.field],
            "required": default[row.field] is MISSING,
            "factor": not row.why_fixed,
        }
        for row in table.values()
    ]


_Configuration = TypeVar("_Configuration")


def configured(
    sensor: str,
    configuration: Callable[..., _Configuration],
    table: Mapping[str, Parameter],
    settings: Mapping[str, float | str],
    fixed: Mapping[str, float | str] | None = None,
) -> _Configuration:
    """Configuration of one point of a design, a dataclass whose fields without a default must be given.

    ``sensor``, "radar" or "radiometer", is for messages. ``settings`` and ``fixed`` are levels of the factors, and
    everything that is no factor; by the names of ``campaign.toml``. A polarization such as ``"HH+HV"`` is a set of
    channels.

    Raises
    ------
    ConfigurationError
        Unknown, doubled or missing names; impossible values; contradictions; all that can be told at once.
    """
    given: dict[str, object] = {}
    problems: list[Problem] = []
    for name, written in [*settings.items(), *(fixed or {}).items()]:
        row = table.get(name)
        if row is None:
            near = difflib.get_close_matches(name, table, n=1)
            remedy = f"Did you mean '{near[0]}'?" if near else f"Known: {', '.join(table)}"
            problems.append(Problem(f"no such {sensor} parameter", remedy, field=name, value=written))
        elif row.field in given:
            problems.append(Problem("given twice", "Give it once: as a factor or as fixed", field=name))
        else:
            given[row.field] = row.converted(written, problems)
    needed = {field.name for field in fields(configuration) if field.default is MISSING}  # type: ignore[arg-type]
    for row in table.values():
        if row.field in needed - given.keys():
            remedy = f"Make it a factor or give it under [simulator.fixed]: {row.what}"
            problems.append(Problem("missing", remedy, field=row.name))
    if problems:
        raise ConfigurationError(*problems)
    return configuration(**given)
