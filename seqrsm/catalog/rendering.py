"""What a set of entries says about each sensor parameter, and results as rows of strings and as plain data for JSON.

Equal statements are put together; how rows look on a terminal is the command line's.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, fields, is_dataclass
from typing import Any, Final, TypeAlias

from seqrsm.catalog.tables import Catalog, Entry, Platform, Range, Table


@dataclass(frozen=True, slots=True)
class Statement:
    """One printed value of one sensor parameter and where it stands.

    Attributes
    ----------
    parameter : str
        One of `PARAMETERS`.
    system : {"active", "passive"}
        Radar or radiometer.
    printed : str
        The value, as printed; the unit of the column follows in brackets where the print leaves it to the head.
    read_as : str
        The frequencies it stands for [GHz], for bands, wavelengths and frequencies; "" otherwise.
    tables : tuple of str
        Tables that print it, in order.
    applications : tuple of str
        Applications it is printed for, each once.
    """

    parameter: str
    system: str
    printed: str
    read_as: str
    tables: tuple[str, ...]
    applications: tuple[str, ...]


#: The parameters a summary tells of, in its order.
PARAMETERS = (
    "band",
    "wavelength or frequency",
    "resolution class",
    "resolution wanted and accepted",
    "polarization",
    "nadir angle",
    "revisit",
)


def _printed(entry: Entry) -> dict[str, str]:
    """Printed value of each parameter of `PARAMETERS`; "" where the entry prints none."""
    resolutions = (entry.resolution_wanted or "-", entry.resolution_accepted or "-")
    in_band = bool(entry.band)
    return {
        "band": f"{entry.band} ({entry.frequency}, {entry.wavelength})" if in_band else "",
        "wavelength or frequency": "" if in_band else _with_unit(entry.wavelength, "cm", "GHz"),
        "resolution class": entry.heading.removeprefix("Resolution").lstrip(" -") if entry.resolution_class_m else "",
        "resolution wanted and accepted": "" if resolutions == ("-", "-") else "{} m, {} m".format(*resolutions),
        "polarization": entry.polarization,
        "nadir angle": _with_unit(entry.nadir_angle, "deg", "°"),
        "revisit": entry.auxiliary,
    }


def _with_unit(printed: str, unit: str, others: str) -> str:
    """``printed`` with the column's unit, if it holds a number and none of the ``others`` that tell its unit."""
    bare = any(c.isdigit() for c in printed) and others not in printed
    return f"{printed} [{unit}]" if bare else printed


def _read_as(entry: Entry, parameter: str) -> str:
    if parameter not in ("band", "wavelength or frequency") or not entry.frequency_ghz:
        return ""
    return "; ".join(map(str, entry.frequency_ghz)) + " GHz"


def summary(entries: Iterable[Entry]) -> tuple[Statement, ...]:
    """What ``entries`` print for each sensor parameter.

    Parameters
    ----------
    entries : iterable of Entry
        For instance what `seqrsm.catalog.search` found.

    Returns
    -------
    tuple of Statement
        By parameter in the order of `PARAMETERS`, radar before radiometer, then in the order of ``entries``.
    """
    found: dict[tuple[str, str, str, str], tuple[list[str], list[str]]] = {}
    for entry in entries:
        for parameter, printed in _printed(entry).items():
            if printed:
                key = (parameter, entry.system, printed, _read_as(entry, parameter))
                tables, applications = found.setdefault(key, ([], []))
                tables += [] if entry.table in tables else [entry.table]
                applications += [] if entry.name in applications else [entry.name]
    statements = [
        Statement(*key, tuple(sorted(tables, key=_place)), tuple(applications))
        for key, (tables, applications) in found.items()
    ]
    statements.sort(key=lambda s: (PARAMETERS.index(s.parameter), s.system))
    return tuple(statements)


def _place(table: str) -> int:
    """Place of table "A.n" in the appendix."""
    return int(table.removeprefix("A."))


Rows: TypeAlias = tuple[tuple[str, ...], tuple[tuple[str, ...], ...]]
"""Names of the columns, and the rows under them."""

Result: TypeAlias = Catalog | Sequence[Entry] | Sequence[Statement] | Sequence[Table]
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


def _table_row(table: Table) -> dict[str, str]:
    return {
        "table": table.number,
        "kind": table.kind,
        "title": table.title,
        "entries": str(table.n_entries),
        "none": str(table.n_none),
        "note": table.note,
    }


_ROW: Final[Mapping[type, Callable[[Any], dict[str, str]]]] = {
    Entry: _entry_row,
    Statement: _statement_row,
    Table: _table_row,
}


def catalog_rows(result: Result) -> Rows:
    """Columns and rows of strings of a result.

    Parameters
    ----------
    result : Catalog, or a sequence of Entry, Statement or Table
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
    rows = [_ROW[type(item)](item) for item in result]
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
