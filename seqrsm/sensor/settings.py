"""Settings of a design point and fixed parameters, by the names of Table 1 or of fields, to the fields of a sensor."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import MISSING, fields

from seqrsm.errors import Problem


def collect(
    kind: str,
    configuration: type,
    names: Mapping[str, str],
    settings: Mapping[str, float | str],
    fixed: Mapping[str, float | str] | None,
) -> tuple[dict[str, float | str], list[Problem]]:
    """Values by field, as given, and every problem of their names.

    Parameters
    ----------
    kind : str
        "radar" or "radiometer", for messages.
    configuration : type
        Dataclass of the sensor; fields without a default must be given.
    names : Mapping[str, str]
        Field by the name in ``campaign.toml``, where they differ.
    settings, fixed : Mapping
        Levels of the factors, and everything that is no factor; by the names above or those of the fields.

    Returns
    -------
    given : dict
    problems : list of Problem
        Unknown, doubled and missing names.
    """
    given: dict[str, float | str] = {}
    problems: list[Problem] = []
    by_field = {field.name: field for field in fields(configuration)}
    shown = {target: name for name, target in names.items()}
    known = [*names, *(name for name in by_field if name not in shown)]
    for name, value in [*settings.items(), *(fixed or {}).items()]:
        target = names.get(name, name)
        if target not in by_field:
            problems.append(Problem(f"no such {kind} parameter", f"Known: {', '.join(known)}", field=name, value=value))
        elif target in given:
            remedy = "Give it once: as a factor or as fixed, and by one of its names"
            problems.append(Problem("given twice", remedy, field=name))
        else:
            given[target] = value
    for name, field in by_field.items():
        if field.default is MISSING and field.default_factory is MISSING and name not in given:
            remedy = "Make it a factor or give it under [simulator.fixed]"
            problems.append(Problem("missing", remedy, field=shown.get(name, name)))
    return given, problems
