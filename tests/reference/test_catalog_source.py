"""The catalogue against counts and samples read from the report's text (see data/catalog_samples.md)."""

import csv
from pathlib import Path

import pytest

from seqrsm.catalog.tables import load_catalog

CATALOG = load_catalog()
TABLES = {table.number: table for table in CATALOG.tables}
with (Path(__file__).parent / "data" / "catalog_samples.csv").open(encoding="utf-8", newline="") as file:
    SAMPLES = [tuple(row.values()) for row in csv.DictReader(file)]

COUNTS = [row for row in SAMPLES if row[2].startswith("count")]
ENTRIES = [row for row in SAMPLES if row not in COUNTS and int(row[0][2:]) <= 20]
PLATFORMS = [row for row in SAMPLES if int(row[0][2:]) > 20]


@pytest.mark.parametrize(("table", "numeral", "field", "count"), COUNTS)
def test_count(table: str, numeral: str, field: str, count: str) -> None:
    own = [e for e in CATALOG.entries if e.table == table and e.is_none == (field == "count none")]
    if numeral == "*":
        stated = TABLES[table]
        assert len(own) == int(count) == (stated.n_none if "none" in field else stated.n_entries)
    else:
        assert sum(e.numeral == numeral for e in own) == int(count)


def test_totals() -> None:
    # sums of the counts above, made by hand: 275 applications, 11 times "None", 67 rows of requirements
    lists = [e for e in CATALOG.entries if int(e.table[2:]) <= 15]
    assert sum(not e.is_none for e in lists) == 275
    assert sum(e.is_none for e in CATALOG.entries) == 11
    assert len(CATALOG.entries) - len(lists) == 67
    assert [t.number for t in CATALOG.tables] == [f"A.{n}" for n in range(1, 40)]
    assert [p.table for p in CATALOG.platforms] == [f"A.{n}" for n in range(21, 40) if n != 26]
    assert {row[0] for row in SAMPLES} == {t.number for t in CATALOG.tables} - {"A.26"}


@pytest.mark.parametrize(("table", "name", "field", "value"), ENTRIES)
def test_entry(table: str, name: str, field: str, value: str) -> None:
    own = [e for e in CATALOG.entries if e.table == table and name in (e.name, e.application)]
    assert value in [getattr(e, field) for e in own]


@pytest.mark.parametrize(("table", "spacecraft", "item", "value"), PLATFORMS)
def test_platform(table: str, spacecraft: str, item: str, value: str) -> None:
    (platform,) = [p for p in CATALOG.platforms if p.table == table]
    assert platform.spacecraft == spacecraft
    assert [line.printed for line in platform.items if line.item == item] == [value]


def test_every_platform_has_the_seven_printed_lines() -> None:
    lines = ["Altitude", "Pointing Acc.", "Size", "Weight", "Power", "Telemetry", "Data Storage"]
    assert all([item.item for item in p.items][:7] == lines for p in CATALOG.platforms)


def test_disagreements_of_the_print_are_kept() -> None:
    edges = {(e.table, e.band): (e.frequency, e.wavelength) for e in CATALOG.entries if e.band}
    assert edges["A.11", "X"] == ("5.0-12 GHz", "5.0-2.5 cm")
    assert edges["A.14", "X"] == ("5.0-12 GHz", "6.0-2.5 cm")
    assert TABLES["A.3"].listed_title.endswith("25m to 30m resolution")
    assert TABLES["A.3"].title == "Resolution 25m to 50m"
    assert "15km X 25km" in TABLES["A.7"].listed_title
    assert "15km X 23km" in TABLES["A.7"].title
    assert all(TABLES[number].note for number in ("A.3", "A.7", "A.9", "A.10", "A.11", "A.13", "A.15", "A.26"))
