"""What Tables A.1 to A.39 of RSL TR 380-1 hold: tables, entries, platforms, and the ranges read from their print.

They are read from the package's CSV files, once, when they are first asked for. The files hold the print and, beside
it, the numbers read from it. A range is written ``low..high``, an open side is left empty, several ranges are separated
by ``;``; sets of channels by ``|``. A column that is a field of what its row becomes has the field's name.
"""

from __future__ import annotations

import csv
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, fields, replace
from functools import lru_cache
from pathlib import Path
from typing import Any

from seqrsm.constants import SPEED_OF_LIGHT_M_S


@dataclass(frozen=True, slots=True)
class Range:
    """A printed range; a side that is not printed is None ("> 30" has no upper side)."""

    low: float | None
    high: float | None
    """Ends, both included, in the unit the field's name tells. low == high for a single printed number."""

    def __str__(self) -> str:
        low, high = (None if end is None else f"{float(f'{end:.4g}'):.10g}" for end in (self.low, self.high))
        if low is None or high is None:
            return f"< {high}" if low is None else f"> {low}"
        return low if low == high else f"{low} to {high}"


@dataclass(frozen=True, slots=True)
class Table:
    """One of Tables A.1 to A.39."""

    number: str
    """From "A.1" to "A.39"."""
    kind: str
    """One of "resolution", "frequency", "requirements" and "platform": A.1-A.7, A.8-A.15, A.16-A.20, A.21-A.39."""
    listed_title: str
    """Title in the report's list of tables; "" for the platforms, which it does not list one by one."""
    title: str
    """Title over the table itself, as printed; "" when the page is missing (A.26)."""
    note: str
    """Damage and contradictions."""
    n_entries: int
    """Applications, requirements, or the one platform, that the table states."""
    n_none: int
    """User categories or bands for which the table says "None"."""


@dataclass(frozen=True, slots=True)
class Entry:
    """One application of Tables A.1 to A.20, as printed, with the numbers read from the print."""

    table: str
    """Number of the table, "A.16"."""
    number: int
    """Place in the table, from 1."""
    system: str
    """Either "active" or "passive": radar or radiometer. Tables A.16 to A.20 are "radar parameters" by the report's own
    words."""
    category: str
    """User category printed over the entry; for A.16 to A.20 the subject of the table; "" where none is printed."""
    application: str
    """As printed; "None" where the table says that nothing was found; "" where the print is lost."""
    numeral: str = ""
    """Roman numeral printed before the category, or before the application where there is no category."""
    group: str = ""
    """Heading the application stands under in Tables A.16 to A.20."""
    reading: str = ""
    """What an obviously damaged application means; "" otherwise."""
    heading: str = ""
    """Resolution class or band over the entry, as printed (A.1 to A.15)."""
    band: str = ""
    """Letter of the band (A.8 to A.15)."""
    wavelength: str = ""
    frequency: str = ""
    """As printed. Tables A.16 to A.20 print frequencies in the column Wavelength (cm): ``wavelength`` holds it."""
    wavelength_cm: tuple[Range, ...] = ()
    """Wavelengths printed [cm]."""
    frequency_ghz: tuple[Range, ...] = ()
    """Frequencies printed [GHz], or those of the printed wavelengths or bands; empty: no number is printed."""
    n_frequencies: str = ""
    """How many frequencies at once, where printed: "2", "1 or 2", "several"."""
    resolution_class_m: Range | None = None
    """Resolution class of Tables A.1 to A.7 [m]; for the passive part of A.7 the two sides of the cell."""
    resolution_wanted: str = ""
    resolution_accepted: str = ""
    """Columns Desire and Accept, as printed."""
    resolution_wanted_m: float | None = None
    resolution_accepted_m: float | None = None
    """The same [m]."""
    polarization: str = ""
    """As printed."""
    channels: tuple[tuple[str, ...], ...] = ()
    """Sets of channels asked for, one or another; cross is HV. Empty: the print names no channel."""
    nadir_angle: str = ""
    """As printed."""
    nadir_angle_deg: tuple[Range, ...] = ()
    """Angles from the vertical [deg]."""
    best_nadir_angle_deg: float | None = None
    """Angle printed as best [deg]."""
    auxiliary: str = ""
    """Column Auxiliary (revisit interval), as printed."""
    revisit_days: Range | None = None
    """Revisit interval [days], where it is printed as a number."""
    note: str = ""
    """Damage, contradictions, and how the entry was read."""

    @property
    def is_none(self) -> bool:
        """Whether the entry is the table's statement that nothing was found."""
        return self.application == "None"

    @property
    def name(self) -> str:
        """Application with the heading it stands under, for people; the reading where the print is lost."""
        own = self.application or self.reading
        return f"{self.group}: {own}" if self.group and self.application else own


@dataclass(frozen=True, slots=True)
class PlatformItem:
    """One printed line of a platform table."""

    item: str
    """Name of the line: Altitude, Pointing Acc., Size, Weight, Power, Telemetry, Data Storage, or a remark's name."""
    printed: str
    """What stands there; "" where the line is empty in print."""
    note: str
    """Damage, contradictions, and how the line was read."""


@dataclass(frozen=True, slots=True)
class Platform:
    """A spacecraft, or a set of general limits, of Tables A.21 to A.39."""

    table: str
    """Number of the table."""
    spacecraft: str
    """As printed."""
    reading: str
    """What an obviously damaged name means; "" otherwise."""
    items: tuple[PlatformItem, ...]
    """Every printed line, empty ones too."""
    note: str
    """Remarks on the whole table."""

    @property
    def name(self) -> str:
        """Name for people."""
        return self.reading or self.spacecraft


@dataclass(frozen=True, slots=True)
class Catalog:
    """Tables A.1 to A.39."""

    tables: tuple[Table, ...]
    """All 39, A.26 (page missing) included."""
    entries: tuple[Entry, ...]
    """Everything Tables A.1 to A.20 state, the statements "None" included, in printed order."""
    platforms: tuple[Platform, ...]
    """Tables A.21 to A.39 without A.26."""

    def of(self, table: Table) -> tuple[Entry, ...] | tuple[Platform, ...]:
        """What a table states: its entries, or the one platform."""
        entries = tuple(entry for entry in self.entries if entry.table == table.number)
        return entries or tuple(platform for platform in self.platforms if platform.table == table.number)


_DATA = Path(__file__).with_name("data")
_CM_GHZ = SPEED_OF_LIGHT_M_S * 1e2 / 1e9
"""Wavelength [cm] times frequency [GHz]."""

Row = Mapping[str, str]


def rows_of(name: str) -> list[dict[str, str]]:
    """Rows of one of the package's files."""
    with (_DATA / name).open(encoding="utf-8", newline="") as file:
        return list(csv.DictReader(file))


def _number(text: str) -> float | None:
    return float(text) if text else None


def _ranges(text: str) -> tuple[Range, ...]:
    parts = [part.split("..") for part in text.split(";") if part]
    return tuple(Range(_number(low), _number(high)) for low, high in parts)


def _range(text: str) -> Range | None:
    found = _ranges(text)
    return found[0] if found else None


def _within(outer: Range, inner: Range) -> Range:
    """The part of ``outer`` that ``inner`` leaves; an application may narrow the band it is listed under."""
    lows = [r.low for r in (outer, inner) if r.low is not None]
    highs = [r.high for r in (outer, inner) if r.high is not None]
    return Range(max(lows, default=None), min(highs, default=None))


_READ: Mapping[str, Callable[[str], object]] = {
    "str": str,
    "int": int,
    "float | None": _number,
    "Range | None": _range,
    "tuple[Range, ...]": _ranges,
    "tuple[tuple[str, ...], ...]": lambda text: tuple(tuple(names.split("+")) for names in text.split("|") if names),
}


def _told(kind: type[Entry | Platform | PlatformItem | Table], *rows: Row) -> dict[str, Any]:
    """Fields that have a column of their name in a row, each read as its type; later rows go before earlier ones."""
    return {one.name: _READ[str(one.type)](row[one.name]) for row in rows for one in fields(kind) if one.name in row}


def _application(row: Row, section: Row) -> Entry:
    told = _told(Entry, section, row)
    limit, bands = _range(row["frequency_ghz"]), _ranges(section["frequency_ghz"])
    told["frequency_ghz"] = tuple(_within(band, limit) for band in bands) if limit else bands
    told["note"] = " ".join(filter(None, (row["note"], section["note"])))
    return Entry(**told)


def _requirement(row: Row, category: str, bands: Mapping[str, Range]) -> Entry:
    found = Entry(system="active", category=category, **_told(Entry, row))
    named = tuple(bands[letter] for letter in row["bands"].split(";") if letter)
    waves = found.wavelength_cm
    of_waves = tuple(Range(_CM_GHZ / r.high if r.high else None, _CM_GHZ / r.low if r.low else None) for r in waves)
    return replace(found, frequency_ghz=found.frequency_ghz + named + of_waves)


def _entries(tables: Iterable[Row]) -> tuple[Entry, ...]:
    sections = {(row["table"], row["section"]): row for row in rows_of("sections.csv")}
    applications = [_application(row, sections[row["table"], row["section"]]) for row in rows_of("applications.csv")]
    # Tables A.16 to A.20 name bands without edges: those of the radar tables A.8 to A.12 stand for them.
    edges = [row for row in sections.values() if row["band"] and row["system"] == "active"]
    bands = {row["band"]: _ranges(row["frequency_ghz"])[0] for row in edges}
    subjects = {row["number"]: row["title"].removesuffix(" System Requirements") for row in tables}
    requirements = [_requirement(row, subjects[row["table"]], bands) for row in rows_of("requirements.csv")]
    return (*applications, *requirements)


def _platforms() -> tuple[Platform, ...]:
    items: dict[str, list[PlatformItem]] = {}
    for row in rows_of("spacecraft_items.csv"):
        items.setdefault(row["table"], []).append(PlatformItem(**_told(PlatformItem, row)))
    return tuple(
        Platform(items=tuple(items[row["table"]]), **_told(Platform, row)) for row in rows_of("spacecraft.csv")
    )


@lru_cache(maxsize=1)
def load_catalog() -> Catalog:
    """Tables A.1 to A.39 of RSL TR 380-1, Appendix A, read on the first call and kept."""
    rows = rows_of("tables.csv")
    entries, platforms = _entries(rows), _platforms()
    tables = []
    for row in rows:
        own = [entry for entry in entries if entry.table == row["number"]]
        n_none = sum(entry.is_none for entry in own)
        n_platforms = sum(platform.table == row["number"] for platform in platforms)
        tables.append(Table(n_entries=len(own) - n_none + n_platforms, n_none=n_none, **_told(Table, row)))
    return Catalog(tuple(tables), entries, platforms)
