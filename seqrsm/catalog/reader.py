"""Reads the tables from the package's CSV files, once, when they are first asked for.

The files hold the print and, beside it, the numbers read from it. A range is written ``low..high``, an open side is
left empty, several ranges are separated by ``;``; sets of channels by ``|``.
"""

from __future__ import annotations

import csv
from collections.abc import Iterable, Mapping
from functools import lru_cache
from pathlib import Path

from seqrsm.catalog.tables import Catalog, Entry, Platform, PlatformItem, Range, Table
from seqrsm.constants import SPEED_OF_LIGHT_M_S

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


def _frequencies_of(wavelengths_cm: Iterable[Range]) -> tuple[Range, ...]:
    return tuple(
        Range(_CM_GHZ / r.high if r.high else None, _CM_GHZ / r.low if r.low else None) for r in wavelengths_cm
    )


def _within(outer: Range, inner: Range) -> Range:
    """The part of ``outer`` that ``inner`` leaves; an application may narrow the band it is listed under."""
    lows = [r.low for r in (outer, inner) if r.low is not None]
    highs = [r.high for r in (outer, inner) if r.high is not None]
    return Range(max(lows, default=None), min(highs, default=None))


def _application(row: Row, section: Row) -> Entry:
    bands = _ranges(section["frequency_ghz"])
    limit = _range(row["frequency_ghz"])
    return Entry(
        table=row["table"],
        number=int(row["entry"]),
        system=section["system"],
        category=row["category"],
        application=row["application"],
        numeral=row["numeral"],
        reading=row["reading"],
        heading=section["heading"],
        band=section["band"],
        wavelength=section["wavelength"],
        frequency=section["frequency"],
        wavelength_cm=_ranges(section["wavelength_cm"]),
        frequency_ghz=tuple(_within(band, limit) for band in bands) if limit else bands,
        resolution_class_m=_range(section["resolution_m"]),
        note=" ".join(filter(None, (row["note"], section["note"]))),
    )


def _requirement(row: Row, category: str, bands: Mapping[str, Range]) -> Entry:
    named = tuple(bands[letter] for letter in row["bands"].split(";") if letter)
    wavelengths = _ranges(row["wavelength_cm"])
    return Entry(
        table=row["table"],
        number=int(row["entry"]),
        system="active",
        category=category,
        application=row["application"],
        group=row["group"],
        reading=row["reading"],
        wavelength=row["wavelength"],
        wavelength_cm=wavelengths,
        frequency_ghz=_ranges(row["frequency_ghz"]) + named + _frequencies_of(wavelengths),
        n_frequencies=row["n_frequencies"],
        resolution_wanted=row["desired"],
        resolution_accepted=row["accepted"],
        resolution_wanted_m=_number(row["desired_m"]),
        resolution_accepted_m=_number(row["accepted_m"]),
        polarization=row["polarization"],
        channels=tuple(tuple(names.split("+")) for names in row["channels"].split("|") if names),
        nadir_angle=row["nadir_angle"],
        nadir_angle_deg=_ranges(row["nadir_angle_deg"]),
        best_nadir_angle_deg=_number(row["best_angle_deg"]),
        auxiliary=row["auxiliary"],
        revisit_days=_range(row["revisit_days"]),
        note=row["note"],
    )


def _entries(tables: Iterable[Row]) -> tuple[Entry, ...]:
    sections = {(row["table"], row["section"]): row for row in rows_of("sections.csv")}
    applications = [_application(row, sections[row["table"], row["section"]]) for row in rows_of("applications.csv")]
    # Tables A.16 to A.20 name bands without edges: those of the radar tables A.8 to A.12 stand for them.
    edges = [row for row in sections.values() if row["band"] and row["system"] == "active"]
    bands = {row["band"]: _ranges(row["frequency_ghz"])[0] for row in edges}
    subjects = {row["table"]: row["printed_title"].removesuffix(" System Requirements") for row in tables}
    requirements = [_requirement(row, subjects[row["table"]], bands) for row in rows_of("requirements.csv")]
    return (*applications, *requirements)


def _platforms() -> tuple[Platform, ...]:
    items: dict[str, list[PlatformItem]] = {}
    for row in rows_of("spacecraft_items.csv"):
        items.setdefault(row["table"], []).append(PlatformItem(row["item"], row["printed"], row["note"]))
    return tuple(
        Platform(
            table=row["table"],
            spacecraft=row["spacecraft"],
            reading=row["reading"],
            items=tuple(items[row["table"]]),
            note=row["note"],
        )
        for row in rows_of("spacecraft.csv")
    )


@lru_cache(maxsize=1)
def load_catalog() -> Catalog:
    """The catalogue, read on the first call and kept.

    Returns
    -------
    Catalog
        Tables A.1 to A.39 of RSL TR 380-1, Appendix A.
    """
    rows = rows_of("tables.csv")
    entries, platforms = _entries(rows), _platforms()
    tables = []
    for row in rows:
        own = [entry for entry in entries if entry.table == row["table"]]
        n_none = sum(entry.is_none for entry in own)
        n_platforms = sum(platform.table == row["table"] for platform in platforms)
        tables.append(
            Table(
                number=row["table"],
                kind=row["kind"],
                listed_title=row["listed_title"],
                title=row["printed_title"],
                note=row["note"],
                n_entries=len(own) - n_none + n_platforms,
                n_none=n_none,
            )
        )
    return Catalog(tuple(tables), entries, platforms)
