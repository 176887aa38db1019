"""Results of the catalogue as rows of strings and as plain data for JSON; how they look on a terminal is the CLI's."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import fields, is_dataclass
from typing import Any, TypeAlias

from seqrsm.catalog.summary import Statement
from seqrsm.catalog.tables import Catalog, Entry, Platform, Range, Table

Rows: TypeAlias = tuple[tuple[str, ...], tuple[tuple[str, ...], ...]]
"""Names of the columns, and the rows under them."""

Result: TypeAlias = Catalog | Sequence[Entry] | Sequence[Statement] | Sequence[Platform] | Sequence[Table]
"""What can be shown as rows."""


def _ranges(ranges: Sequence[Range]) -> str:
    return "; ".join(map(str, ranges))


def _entry_row(entry: Entry) -> dict[str, str]:
    return {
        "table": entry.table,
        "system": entry.system,
        "category": entry.category,
        "application": entry.name,
        "band or wavelength": entry.band or entry.wavelength,
        "frequency [GHz]": _ranges(entry.frequency_ghz),
        "resolution class [m]": str(entry.resolution_class_m or ""),
        "wanted [m]": entry.resolution_wanted,
        "accepted [m]": entry.resolution_accepted,
        "polarization": entry.polarization,
        "nadir angle [deg]": entry.nadir_angle,
        "revisit": entry.auxiliary,
        "note": entry.note,
    }


def _statement_row(statement: Statement) -> dict[str, str]:
    return {
        "parameter": statement.parameter,
        "system": statement.system,
        "printed": statement.printed,
        "read as": statement.read_as,
        "tables": ", ".join(statement.tables),
        "applications": "; ".join(statement.applications),
    }


def _platform_row(platform: Platform) -> dict[str, str]:
    lines = ("Altitude", "Pointing Acc.", "Size", "Weight", "Power", "Telemetry", "Data Storage")
    notes = [platform.note, *(item.note for item in platform.items)]
    return {
        "table": platform.table,
        "platform": platform.name,
        **{line.lower(): platform.printed(line) for line in lines},
        "note": " ".join(filter(None, notes)),
    }


def _table_row(table: Table) -> dict[str, str]:
    return {
        "table": table.number,
        "kind": table.kind,
        "title": table.title,
        "entries": str(table.n_entries),
        "none": str(table.n_none),
        "note": table.note,
    }


def _one_row(item: object) -> dict[str, str]:
    match item:
        case Entry():
            return _entry_row(item)
        case Statement():
            return _statement_row(item)
        case Platform():
            return _platform_row(item)
        case Table():
            return _table_row(item)
        case _:
            raise TypeError(f"no rows for {type(item).__name__}")


def catalog_rows(result: Result) -> Rows:
    """Columns and rows of strings of a result.

    Parameters
    ----------
    result : Catalog, or a sequence of Entry, Statement, Platform or Table
        A catalogue gives its tables.

    Returns
    -------
    columns : tuple of str
        Names; empty for an empty sequence.
    rows : tuple of tuple of str
        One cell per column; "" where nothing is printed. Columns that are empty in every row are left out.
    """
    if isinstance(result, Catalog):
        result = result.tables
    rows = [_one_row(item) for item in result]
    columns = tuple(name for name in (rows[0] if rows else ()) if any(row[name] for row in rows))
    return columns, tuple(tuple(row[name] for name in columns) for row in rows)


def to_json(result: object) -> Any:
    """A result as dictionaries, lists, strings and numbers, every field of it by its name.

    Parameters
    ----------
    result : any result of this package
        Dataclasses become dictionaries, sequences lists; an open or unprinted number is None.

    Returns
    -------
    dict, list, str, float, int, bool or None
        What ``json.dumps`` takes.
    """
    if is_dataclass(result) and not isinstance(result, type):
        document = {field.name: to_json(getattr(result, field.name)) for field in fields(result)}
        if isinstance(result, Entry | Platform):
            document["name"] = result.name
        return document
    if isinstance(result, tuple | list):
        return [to_json(item) for item in result]
    return result
