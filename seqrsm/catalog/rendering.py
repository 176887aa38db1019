"""What a set of entries says about each sensor parameter, equal statements put together, and plain data for JSON."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from typing import Any

from seqrsm.catalog.tables import Entry, Platform
from seqrsm.plain import plain


@dataclass(frozen=True, slots=True)
class Statement:
    """One printed value of one sensor parameter and where it stands."""

    parameter: str
    """One of `PARAMETERS`."""
    system: str
    """Either "active" or "passive": radar or radiometer."""
    printed: str
    """The value, as printed; the unit of the column follows in brackets where the print leaves it to the head."""
    read_as: str
    """The frequencies it stands for [GHz], for bands, wavelengths and frequencies; "" otherwise."""
    tables: tuple[str, ...]
    """Tables that print it, in order."""
    applications: tuple[str, ...]
    """Applications it is printed for, each once."""


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
    """What ``entries``, such as those that `seqrsm.catalog.search` found, print for each sensor parameter.

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
        Statement(*key, tuple(sorted(tables, key=lambda table: int(table.removeprefix("A.")))), tuple(applications))
        for key, (tables, applications) in found.items()
    ]
    statements.sort(key=lambda s: (PARAMETERS.index(s.parameter), s.system))
    return tuple(statements)


def to_json(entries: Iterable[Entry | Platform]) -> list[dict[str, Any]]:
    """Every field of entries or platforms by its name, and what they are called."""
    return [{**plain(entry), "name": entry.name} for entry in entries]
