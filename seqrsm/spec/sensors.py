"""Factors, members of sets and candidates of ``campaign.toml``: whether sensors have such parameters and values."""

from __future__ import annotations

import difflib
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

from seqrsm.design.factors import CategoricalFactor, ContinuousFactor, DiscreteFactor, Factor
from seqrsm.errors import RegionError
from seqrsm.sensor.named import nearest_names, sensors_called
from seqrsm.sensor.parameters import Parameter
from seqrsm.sensor.sets import SENSORS, set_problems
from seqrsm.spec.faults import Reporter
from seqrsm.spec.tables import CandidateSpec
from seqrsm.spec.toml_lines import Path

#: Columns of a scores file, which no factor may be named after.
RESERVED = ("run_id", "application", "score", "se", "n", "correct", "block", "source", "date", "note")


def factors(
    tables: Sequence[Mapping[str, Any] | None], raw: Sequence[object], instruments: Sensors, report: Reporter
) -> list[Factor | None]:
    """Factors of the tables, None for those that are wrong; ``raw``: the same tables as written."""
    made: list[Factor | None] = []
    for index, table in enumerate(tables):
        path: Path = ("factor", index)
        before = len(report.problems)
        if table is None:
            written = raw[index]
            name, unit = (written.get("name"), written.get("unit", "")) if isinstance(written, dict) else (None, "")
            if isinstance(name, str) and isinstance(unit, str):
                _check_parameter(path, {"name": name, "unit": unit}, instruments, report)
            made.append(None)
            continue
        _check_parameter(path, table, instruments, report)
        factor = _make_factor(path, table, instruments, report)
        made.append(factor if len(report.problems) == before else None)
    return made


@dataclass(frozen=True, slots=True)
class Sensors:
    """What ``[simulator]`` says of its sensors, as written; it may be wrong."""

    engine: str | None
    """That of members which name no other; None without a simulator, or with an unknown engine."""
    members: Mapping[str, Mapping[str, Any]]
    """What members have of their own."""

    def table(self, member: str) -> Mapping[str, Parameter]:
        """Parameters of a member's sensor; "": of every sensor that there is, the main one's first."""
        if self.engine is None:
            return {}
        if member:
            return SENSORS.get(str(self.members.get(member, {}).get("engine", self.engine)), {})
        others = (SENSORS.get(str(own.get("engine", self.engine)), {}) for own in self.members.values())
        return {name: row for table in (*others, SENSORS[self.engine]) for name, row in table.items()}

    def parameter(self, name: str) -> Parameter | None:
        """The parameter that a factor is; without an engine, one of Table 1 whose name does not tell its unit."""
        if self.engine is not None:
            member, _, own = name.rpartition(".")
            return self.table(member).get(own)
        rows = (table.get(name) for table in SENSORS.values())
        return next((row for row in rows if row is not None and row.name != row.field), None)


def sensors(table: object) -> Sensors:
    """The sensors of ``[simulator]`` as written, so that factors are checked even where another key of it is wrong."""
    written = table if isinstance(table, dict) else {}
    engine, members = str(written.get("engine")), written.get("members")
    own = {k: v for k, v in members.items() if isinstance(v, dict)} if isinstance(members, dict) else {}
    return Sensors(engine if engine in SENSORS else None, own)


def members(instruments: Sensors, written: Sequence[object], fixed: object, report: Reporter) -> None:
    """Every member's table is of parameters that its sensor has; names before a dot are those of members."""
    if instruments.engine is None:
        return
    fixed = fixed if isinstance(fixed, dict) else {}
    factors = {i: f for i, f in enumerate(written) if isinstance(f, dict) and isinstance(f.get("name"), str)}
    known = _set_members(factors.values(), fixed)
    for name, own in instruments.members.items():
        _check_member(name, own, known, instruments.engine, report)
        if "dates" in own and "interval_days" not in own and "interval_days" in {f["name"] for f in factors.values()}:
            text = "dates of its own at the interval that is a factor of all sensors"
            report.add(("simulator", "members", name, "dates"), text, "Give it interval_days, too.", own["dates"])
    names: dict[Path, str] = {("factor", i, "name"): f["name"] for i, f in factors.items()}
    names |= {("simulator", "fixed", key): key for key in fixed}
    for path, name in names.items():
        member, dot, own_name = name.rpartition(".")
        table = instruments.table(member)
        if dot and member not in known:
            remedy = f"Members are {', '.join(sorted(known))}." if known else 'Let frequency be a set, as in "L+C".'
            report.add(path, f"'{member}' is no member of a set", remedy, name)
        elif path[0] == "simulator" and (dot or known) and own_name not in table:
            who = f"the member '{member}' has no" if dot else "no sensor of the set has"
            remedy = _meant(own_name, table, instruments.engine, member + dot)
            report.add(path, f"{who} such sensor parameter", remedy, name)


def _set_members(factors: Iterable[Mapping[str, Any]], fixed: Mapping[str, Any]) -> set[str]:
    """Members of the sets that the factor frequency has as levels, or that ``[simulator.fixed]`` gives for it."""
    levels = [f.get("levels") for f in factors if f["name"] == "frequency"]
    sets = [level for own in levels if isinstance(own, list) for level in own]
    sets += [fixed["frequency"]] if isinstance(fixed.get("frequency"), str) else []
    return _in_sets(sets)


def _in_sets(sets: Iterable[object]) -> set[str]:
    return {part.strip() for level in sets for part in str(level).split("+")}


def without_effect(factors: Sequence[Factor], settings: Mapping[str, float | str]) -> tuple[str, ...]:
    """Names of factors that no member of the set of ``settings`` takes, and of intervals where there is one date."""
    levels = [f.levels for f in factors if f.name == "frequency" and isinstance(f, CategoricalFactor)]
    present = _in_sets([settings.get("frequency")])
    absent = _in_sets(level for own in levels for level in own) - present
    dates = {f.name.rpartition(".")[0]: settings[f.name] for f in factors if f.name.rpartition(".")[2] == "dates"}

    def idle(factor: Factor) -> bool:
        member, _, own = factor.name.rpartition(".")
        counts = {dates.get(member, dates.get(""))} if member else set(dates.values())
        once = own == "interval_days" and counts == {1.0}
        return member in absent or present <= set(factor.not_of) or once

    return tuple(f.name for f in factors if idle(f))


def _check_member(name: str, own: Mapping[str, Any], known: set[str], engine: str, report: Reporter) -> None:
    """A set names the member, and its sensor has the parameters; ``engine``: where its table names none."""
    path: Path = ("simulator", "members", name)
    if name not in known:
        remedy = 'Name it in the levels of the factor frequency, or in [simulator.fixed] frequency, as in "L+C".'
        report.add(path, "no set has this member", remedy, name)
    engine = str(own.get("engine", engine))
    if engine not in SENSORS:
        report.add((*path, "engine"), "there is no such engine", f"Known: {', '.join(SENSORS)}.", engine)
        return
    for key in own:
        if key not in ("engine", *SENSORS[engine]):
            remedy = _meant(key, SENSORS[engine], engine)
            report.add((*path, key), f"the engine '{engine}' has no such sensor parameter", remedy, key)


def _meant(name: str, table: Mapping[str, Parameter], engine: str, before: str = "") -> str:
    """Which parameter of a table a wrong name may stand for; ``before``: a member's name and dot."""
    near = difflib.get_close_matches(name, table, n=1)
    return f"Did you mean '{before}{near[0]}'?" if near else f"`seqrsm parameters {engine}` lists those it has."


def _check_parameter(path: Path, table: Mapping[str, Any], instruments: Sensors, report: Reporter) -> None:
    name = table["name"]
    if name in RESERVED:
        report.add((*path, "name"), "a column of the scores file has this name", "Choose another name.", name)
        return
    parameter = instruments.parameter(name)
    if parameter is not None and parameter.numeric and table["unit"] not in ("", parameter.unit):
        remedy = f'Write unit = "{parameter.unit}" and give the range in it.' if parameter.unit else "Leave it out."
        report.add((*path, "unit"), f"'{name}' is given in another unit than the sensor's", remedy, table["unit"])
    if instruments.engine is None:
        return
    member, dot, own = name.rpartition(".")
    if parameter is None:
        remedy = _meant(own, instruments.table(member), instruments.engine, f"{member}{dot}")
        report.add((*path, "name"), f"the engine '{instruments.engine}' has no such sensor parameter", remedy, name)
    elif dot and own == "frequency":
        remedy = "Let the levels of the factor frequency name its members."
        report.add((*path, "name"), "a member's frequency identifies the member", remedy, name)
    elif parameter.why_fixed:
        remedy = f"Give it under [simulator.fixed]: {parameter.why_fixed}."
        report.add((*path, "name"), "this parameter cannot be a factor", remedy, name)


def _check_levels(
    path: Path, table: Mapping[str, Any], parameter: Parameter, instruments: Sensors, report: Reporter
) -> None:
    """Every end, value or level is one that the sensor can take; levels of the frequency are sets of sensors."""
    of_sensors = table["name"] == "frequency" and table["levels"] is not None
    forms = {"levels": "levels"}
    if parameter.numeric and not of_sensors:
        forms = {"low": "low and high", "values": "values"} if parameter.continuous else {"values": "values"}
    if all(table[key] is None for key in forms):
        needed = ", or ".join(forms.values())
        report.add(path, f"'{parameter.name}' is given by {needed}", f"Give {needed}: {parameter.allowed}.")
        return
    given: list[tuple[Path, Any]] = [((*path, key), table[key]) for key in ("low", "high") if table[key] is not None]
    for key in ("values", "levels"):
        given += [((*path, key, index), value) for index, value in enumerate(table[key] or ())]
    parts = "sensors" if of_sensors else parameter.kind
    seen: dict[frozenset[str], str] = {}
    for place, value in given:
        for problem in set_problems(value, instruments.members) if of_sensors else parameter.level_problems(value):
            report.add(place, problem.message, f"{problem.remedy}.", value)
        if parts in ("sensors", "channels"):
            same = seen.setdefault(frozenset(value.split("+")), value)
            if same != value:
                report.add(place, f"this is the same set of {parts} as '{same}'", "Drop one.", value)


def _make_factor(path: Path, table: Mapping[str, Any], instruments: Sensors, report: Reporter) -> Factor | None:
    name, scale = table["name"], table["scale"]
    parameter = instruments.parameter(name)
    unit = table["unit"] or ("" if parameter is None else parameter.unit)
    given = [key for key in ("low", "high", "values", "levels") if table[key] is not None]
    factor: Factor
    try:
        match given:
            case ["levels"]:
                for key in ("unit", "scale"):
                    if (*path, key) in report.lines:
                        report.add((*path, key), f"a factor with levels has no {key}", "Leave it out.", table[key])
                factor = CategoricalFactor(name, tuple(table["levels"]))
            case ["values"]:
                factor = DiscreteFactor(name, tuple(table["values"]), unit, scale)
            case ["low", "high"]:
                factor = ContinuousFactor(name, table["low"], table["high"], unit, scale)
            case _:
                said = " and ".join(given) or "none of them"
                message = f"a factor has either low and high, or values, or levels; here: {said}"
                report.add(path, message, "Give low and high, or values, or levels.")
                return None
        if "." not in name and name != "frequency":
            own = instruments.members.items()
            without = (one for one, has in own if name in has or name not in instruments.table(one))
            factor = replace(factor, not_of=tuple(without))
    except RegionError as error:
        for problem in error.problems:
            last = (problem.field or "").rpartition(".")[2]
            key = last if last in ("name", "low", "high", "values", "levels", "scale") else given[0]
            report.add((*path, key), problem.message, problem.remedy, problem.value)
        return None
    if instruments.engine is not None and parameter is not None and not parameter.why_fixed:
        _check_levels(path, table, parameter, instruments, report)
    return factor


def candidates(
    tables: Sequence[tuple[int, CandidateSpec]], instruments: Sensors, factors: Sequence[str], report: Reporter
) -> None:
    """Note every fault of the candidates; ``factors``: names of the campaign's."""
    names: set[str] = set()
    for index, table in tables:
        path = ("candidate", index)
        own = table.name or f"{table.sensor} {table.polarization}".strip()
        if own in names:
            report.add(path, "this candidate is listed twice", "Remove one.", own)
        names.add(own)
        if table.sensor:
            _check_named(path, table, instruments, report)
        elif not table.name or not table.parameters:
            remedy = 'Give sensor = "Sentinel-1 IW GRDH", or name and parameters = { frequency = 5.4 }.'
            report.add(path, "a candidate is a known sensor, or a name with parameters", remedy)
        for key, value in table.parameters.items():
            place, row = (*path, "parameters", key), instruments.parameter(key)
            if instruments.engine is None and key not in factors:
                remedy = f"Factors are {', '.join(factors)}."
                report.add(place, "without a simulator a candidate is defined by its factors", remedy, value)
            elif instruments.engine is not None and row is None:
                report.unknown_key(place, instruments.table(""))
            elif instruments.engine is not None and row is not None and row.kind != "file" and key != "frequency":
                for problem in row.level_problems(value):
                    report.add(place, problem.message, f"{problem.remedy}.", value)


def _check_named(path: tuple[str, int], table: CandidateSpec, instruments: Sensors, report: Reporter) -> None:
    found = sensors_called(table.sensor)
    place = (*path, "sensor")
    if not found:
        near = nearest_names(table.sensor)
        known = f"Did you mean {' or '.join(near)}?" if near else "`seqrsm catalog NAME` lists them."
        report.add(place, "no sensor has this name", known, table.sensor)
        return
    fitting = [one for one in found if instruments.engine in (None, one.engine)]
    if not fitting:
        kind = "radars" if instruments.engine == "psm" else "radiometers"
        report.add(place, f"the engine '{instruments.engine}' simulates {kind}", "Name one of these.", table.sensor)
        return
    asked = table.polarization
    if asked and not any(set(asked.split("+")) == set(own.split("+")) for one in fitting for own in one.channels):
        there = dict.fromkeys(own for one in fitting for own in one.channels)
        remedy = f"It has {', or '.join(there)}."
        report.add((*path, "polarization"), "the sensor has no such set of channels", remedy, asked)
