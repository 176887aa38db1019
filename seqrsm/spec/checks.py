"""What must hold in ``campaign.toml`` beyond the type of each key, and how a fault is told to the user."""

from __future__ import annotations

import difflib
import os
import re
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from math import inf, isfinite
from pathlib import Path as FilePath
from typing import Any

from seqrsm.design.constraints import Constraint
from seqrsm.design.factors import CategoricalFactor, ContinuousFactor, DiscreteFactor, Factor, span
from seqrsm.design.region import Region
from seqrsm.errors import Problem, RegionError
from seqrsm.fit.error_models import ERROR_MODELS, NORMAL
from seqrsm.sensor.named import nearest_names, sensors_called
from seqrsm.sensor.parameters import Parameter, find
from seqrsm.sensor.sets import SENSORS, set_problem
from seqrsm.spec.tables import ApplicationSpec, CandidateSpec, ConsiderationSpec, ModelSpec, Table
from seqrsm.spec.toml_lines import Path, line_of

#: Columns of a scores file, which no factor may be named after.
RESERVED = ("run_id", "application", "score", "se", "n", "correct", "block", "source", "date", "note")


class Reporter:
    """Collects problems with their lines.

    Parameters
    ----------
    file : str
        Name of the file.
    lines : dict
        From `seqrsm.spec.toml_lines.key_lines`.
    """

    def __init__(self, file: str, lines: dict[Path, int]) -> None:
        self.file = file
        self.lines = lines
        self.problems: list[Problem] = []
        self.names: dict[Path, str] = {}

    def add(self, path: Path, message: str, remedy: str = "", value: object | None = None) -> None:
        """Note a problem of the key or table at ``path``."""
        line = line_of(self.lines, path)
        self.problems.append(Problem(message, remedy, self.file, line, self.words(path), value))

    def words(self, path: Path) -> str:
        """The place in the user's words, such as ``factor 'frequency': low`` or ``[stop] level``."""
        if len(path) == 1 or not isinstance(path[1], int):
            head, rest = f"[{path[0]}]", path[1:]
        else:
            name = self.names.get(path[:2])
            head = f"{path[0]} no. {path[1] + 1}" if name is None else f"{path[0]} '{name}'"
            head, rest = (head + ":" if path[2:] else head), path[2:]
        tail = ""
        for part in rest:
            tail += f" no. {part + 1}" if isinstance(part, int) else (f".{part}" if tail else f"{part}")
        return f"{head} {tail}".strip()

    def unknown_key(self, path: Path, known: Iterable[str], remedy: str = "") -> None:
        """Note a key that is not one of ``known``, with the nearest of them where there is no ``remedy``."""
        names = list(known)
        near = difflib.get_close_matches(str(path[-1]), names, n=1)
        others = f"Known here: {', '.join(names)}." if names else "Remove it."
        remedy = remedy or (f"Did you mean '{near[0]}'?" if near else others)
        self.add(path, f"'{path[-1]}' is not a known key", remedy)

    def missing_table(self, key: str, *, repeated: bool) -> None:
        """Note that a whole table is absent."""
        header = f"[[{key}]]" if repeated else f"[{key}]"
        self.problems.append(Problem(f"the file has no {header}", f"Add a table {header}.", self.file, 1, f"[{key}]"))

    def invalid(self, path: Path, detail: Mapping[str, Any], table: type[Table]) -> None:
        """Note one error of pydantic's list, of a table of this class."""
        # pydantic adds the branch of a union ("str", "float") to the place; it is no key of the file.
        location = path
        for part in detail["loc"]:
            if (*location, part) in self.lines or detail["type"] in ("missing", "extra_forbidden"):
                location = (*location, part)
        kind, value = detail["type"], detail["input"] if detail["loc"][-1:] != ("url",) else "***"
        if any(p.line == line_of(self.lines, location) and p.field == self.words(location) for p in self.problems):
            return
        if kind == "extra_forbidden":
            inner = len(detail["loc"]) > 1
            remedy = "" if inner else table.GONE.get(str(detail["loc"][0]), (None, ""))[1]
            self.unknown_key(location, [] if inner else table.model_fields, remedy)
        elif kind == "missing":
            self.add(location, "the key is missing", f"Add: {detail['loc'][-1]} = ...")
        elif kind in ("model_type", "dict_type"):
            header = ".".join(str(part) for part in location if isinstance(part, str))
            header = f"[[{header}]]" if len(location) == 2 and isinstance(location[1], int) else f"[{header}]"
            self.add(location, "a table is expected here", f"Write it as a table: {header}.", value)
        elif kind in _WRONG_TYPE:
            self.add(location, f"{_WRONG_TYPE[kind]} is expected here", _retype(kind, value), value)
        else:
            message = detail["msg"].removeprefix("Input ").replace("should", "must", 1)
            options = re.findall(r"'([^']*)'", message) if kind == "literal_error" else []
            near = difflib.get_close_matches(str(value), options, n=1)
            self.add(location, message[:1].lower() + message[1:], f'Did you mean "{near[0]}"?' if near else "", value)


_WRONG_TYPE = {
    "float_type": "a number",
    "int_type": "a whole number",
    "int_from_float": "a whole number",
    "string_type": "text",
    "list_type": "a list",
    "finite_number": "a finite number",
}


def _retype(kind: str, value: object) -> str:
    if kind == "string_type":
        return "Put it in quotes."
    if kind == "list_type":
        return "Write it in square brackets: [ ... ]."
    if isinstance(value, str):
        return "Write the number without quotes, with a point for decimals and no unit."
    return ""


def different_names(kind: str, report: Reporter) -> None:
    """Every table of a kind has a name of its own."""
    seen: set[str] = set()
    for path, name in report.names.items():
        if path[0] == kind and name in seen:
            report.add((*path, "name"), f"two tables [[{kind}]] have this name", "Rename one.", name)
        elif path[0] == kind:
            seen.add(name)


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
    """What ``[simulator]`` says of its sensors, as written; it may be wrong.

    Attributes
    ----------
    engine : str or None
        That of members which name no other; None without a simulator, or with an unknown engine.
    members : Mapping
        What members have of their own.
    """

    engine: str | None
    members: Mapping[str, Mapping[str, Any]]

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
            return find(self.table(member), own)
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
    factors = [f for f in written if isinstance(f, dict) and isinstance(f.get("name"), str)]
    levels = (f.get("levels") for f in factors if f["name"] == "frequency")
    sets = [level for own in levels if isinstance(own, list) for level in own]
    sets += [fixed[key] for key in ("frequency", "frequency_ghz") if isinstance(fixed.get(key), str)]
    known = {part.strip() for level in sets for part in str(level).split("+")}
    path: Path
    for name, own in instruments.members.items():
        path = ("simulator", "members", name)
        if name not in known:
            remedy = 'Name it in the levels of the factor frequency, or in [simulator.fixed] frequency, as in "L+C".'
            report.add(path, "no set has this member", remedy, name)
        engine = str(own.get("engine", instruments.engine))
        if engine not in SENSORS:
            report.add((*path, "engine"), "there is no such engine", f"Known: {', '.join(SENSORS)}.", engine)
            continue
        for key in own:
            if key != "engine" and find(SENSORS[engine], key) is None:
                remedy = _meant(key, SENSORS[engine], engine)
                report.add((*path, key), f"the engine '{engine}' has no such sensor parameter", remedy, key)
    places: list[tuple[Path, str]] = [(("factor", i, "name"), f["name"]) for i, f in enumerate(factors)]
    for path, name in (*places, *((("simulator", "fixed", key), key) for key in fixed)):
        member, dot, own_name = name.rpartition(".")
        if dot and member not in known:
            remedy = f"Members are {', '.join(sorted(known))}." if known else 'Let frequency be a set, as in "L+C".'
            report.add(path, f"'{member}' is no member of a set", remedy, name)
        elif path[0] == "simulator" and (dot or sets) and find(instruments.table(member), own_name) is None:
            who = f"the member '{member}' has no" if dot else "no sensor of the set has"
            remedy = _meant(own_name, instruments.table(member), instruments.engine, f"{member}{dot}")
            report.add(path, f"{who} such sensor parameter", remedy, name)


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
    elif own != parameter.name:
        remedy = f"Write '{member}{dot}{parameter.name}'."
        report.add((*path, "name"), "a factor must have its parameter's name in this file", remedy, name)
    elif dot and own == "frequency":
        remedy = "Let the levels of the factor frequency name its members."
        report.add((*path, "name"), "a member's frequency identifies the member", remedy, name)
    elif parameter.why_fixed:
        remedy = f"Give it under [simulator.fixed]. {parameter.why_fixed}."
        report.add((*path, "name"), "this parameter cannot be a factor", remedy, name)


def _check_levels(path: Path, table: Mapping[str, Any], parameter: Parameter, report: Reporter) -> None:
    """Every end, value or level of a factor is one that the sensor can take."""
    forms = {"levels": "levels"}
    if parameter.numeric:
        forms = {"low": "low and high", "values": "values"} if parameter.continuous else {"values": "values"}
    if all(table[key] is None for key in forms):
        needed = ", or ".join(forms.values())
        report.add(path, f"'{parameter.name}' is given by {needed}", f"Give {needed}: {parameter.allowed}.")
        return
    given: list[tuple[Path, Any]] = [((*path, key), table[key]) for key in ("low", "high") if table[key] is not None]
    for key in ("values", "levels"):
        given += [((*path, key, index), value) for index, value in enumerate(table[key] or ())]
    seen: dict[frozenset[str], str] = {}
    for place, value in given:
        for problem in parameter.level_problems(value):
            report.add(place, problem.message, f"{problem.remedy}.", value)
        if parameter.kind == "channels":
            same = seen.setdefault(frozenset(value.split("+")), value)
            if same != value:
                report.add(place, f"this is the same set of channels as '{same}'", "Drop one.", value)


def _check_sets(path: Path, levels: Sequence[str], instruments: Sensors, report: Reporter) -> None:
    """Every level of the factor frequency is a set of sensors, and no two are the same."""
    seen: dict[frozenset[str], str] = {}
    for index, level in enumerate(levels):
        place = (*path, "levels", index)
        problem = set_problem(level, instruments.members)
        if problem is not None:
            report.add(place, problem.message, f"{problem.remedy}.", level)
        same = seen.setdefault(frozenset(level.split("+")), level)
        if same != level:
            report.add(place, f"this is the same set of sensors as '{same}'", "Drop one.", level)


def _make_factor(path: Path, table: Mapping[str, Any], instruments: Sensors, report: Reporter) -> Factor | None:
    name, scale = table["name"], table["scale"]
    parameter = instruments.parameter(name)
    unit = table["unit"] or ("" if parameter is None else parameter.unit)
    given = [key for key in ("low", "high", "values", "levels") if table[key] is not None]
    if given not in (["low", "high"], ["values"], ["levels"]):
        said = " and ".join(given) or "none of them"
        remedy = "Give low and high, or values, or levels."
        report.add(path, f"a factor has either low and high, or values, or levels; here: {said}", remedy)
        return None
    factor: Factor
    try:
        if given == ["levels"]:
            for key in ("unit", "scale"):
                if (*path, key) in report.lines:
                    report.add((*path, key), f"a factor with levels has no {key}", "Leave it out.", table[key])
            factor = CategoricalFactor(name, tuple(table["levels"]))
        elif given == ["values"]:
            factor = DiscreteFactor(name, tuple(table["values"]), unit, scale)
        else:
            factor = ContinuousFactor(name, table["low"], table["high"], unit, scale)
    except RegionError as error:
        for problem in error.problems:
            last = (problem.field or "").rpartition(".")[2]
            key = last if last in ("name", "low", "high", "values", "levels", "scale") else given[0]
            report.add((*path, key), problem.message, problem.remedy, problem.value)
        return None
    if parameter is not None and parameter.name == name.rpartition(".")[2] and not parameter.why_fixed:
        if instruments.engine is not None and name == "frequency" and table["levels"] is not None:
            _check_sets(path, table["levels"], instruments, report)
        elif instruments.engine is not None:
            _check_levels(path, table, parameter, report)
    return factor


def constraints(expressions: Sequence[str | None], report: Reporter) -> list[Constraint | None]:
    """Constraints of the expressions; None for those that are wrong."""
    made: list[Constraint | None] = []
    for index, expression in enumerate(expressions):
        constraint = None
        if expression is not None:
            try:
                constraint = Constraint(expression)
            except RegionError as error:
                for problem in error.problems:
                    report.add(("constraint", index, "expr"), problem.message, problem.remedy, problem.value)
        made.append(constraint)
    return made


def desirabilities(kind: str, tables: Sequence[ApplicationSpec | ConsiderationSpec | None], report: Reporter) -> None:
    """``unacceptable`` lies on the bad side of ``ideal``."""
    for index, table in enumerate(tables):
        if table is None or table.unacceptable is None or table.ideal is None:
            continue
        rises = table.ideal > table.unacceptable
        if table.ideal == table.unacceptable or rises != (table.goal == "maximize"):
            side = "above" if table.goal == "maximize" else "below"
            remedy = f'With goal = "{table.goal}" it lies {side} unacceptable.'
            report.add((kind, index, "ideal"), "ideal is not better than unacceptable", remedy, table.ideal)


def model(
    table: ModelSpec, applications: Sequence[ApplicationSpec | None], *, simulated: bool, report: Reporter
) -> None:
    """Keys of ``[model]`` that exclude each other, or what the scores will be."""
    errors = ERROR_MODELS[table.errors]
    counted = (
        ("errors", table.errors, errors.of_counts, NORMAL.name, f"{errors.name} errors"),
        ("weights", table.weights, table.weights == "counts", "equal", "weights by counts"),
    )
    for key, value, by_counts, plain, what in counted:
        place: Path = ("model", key)
        if by_counts and simulated:
            remedy = f'Use {key} = "{plain}": a simulated score is no count of independent decisions.'
            report.add(place, "simulated scores come without counts", remedy, value)
        elif by_counts and any(one is not None and not one.is_percent for one in applications):
            remedy = f'Set utility = "percent_correct", or {key} = "{plain}".'
            report.add(place, f"{what} are for percentages of correct decisions", remedy, value)
    if errors.response and table.response != errors.response:
        remedy = f'Add response = "{errors.response}".'
        message = f"{errors.name} scores are modelled on the {errors.response} scale"
        report.add(("model", "errors"), message, remedy, errors.name)
    if errors.of_counts and table.weights != "equal":
        remedy = "Omit weights: the counts determine them."
        message = f"{errors.name} errors take their weights from the counts"
        report.add(("model", "weights"), message, remedy, table.weights)
    if table.block_effect == "random" and table.block is None:
        report.add(("model", "block_effect"), "block_effect needs a block", 'Add block = "block".', "random")
    if table.block_effect == "random" and not errors.random_blocks:
        remedy = 'Write errors = "normal", or block_effect = "fixed".'
        report.add(("model", "block_effect"), "random blocks need normal errors", remedy, "random")


def catalogued(applications: Sequence[ApplicationSpec | None], engine: str | None, report: Reporter) -> None:
    """Words that an application names of the catalogue are in it, for the engine's kind of sensor."""
    kind, system = {"psm": ("radar ", "active"), "prm": ("radiometer ", "passive")}.get(engine or "", ("", None))
    for index, application in enumerate(applications):
        if application is None or not application.catalog:
            continue
        from seqrsm.catalog import search  # reads tables that few campaigns need here

        if not application.catalog.strip() or not search(application.catalog, system=system):
            message = f"no {kind}entry of Tables A.1 to A.20 matches this"
            remedy = "`seqrsm catalog` lists them, `seqrsm catalog WORDS` tries words; or omit the key."
            report.add(("application", index, "catalog"), message, remedy, application.catalog)


def goals(applications: Sequence[ApplicationSpec | None], report: Reporter) -> None:
    """An error is made small, and a utility that has a unit keeps it."""
    for index, application in enumerate(applications):
        if application is None:
            continue
        path: Path = ("application", index)
        if application.is_error and application.goal == "maximize":
            report.add((*path, "goal"), "the utility is an error", 'Write goal = "minimize".', application.goal)
        if application.unit not in ("", application.score_unit):
            text = f"scores of this utility are in {application.score_unit}"
            report.add((*path, "unit"), text, "Remove the key.", application.unit)


def expressions(texts: Sequence[str | None], factors: Sequence[Factor], report: Reporter) -> None:
    """Expressions of considerations: arithmetic in numeric factors, and in the parts of levels."""
    numeric = [factor.name for factor in factors if not isinstance(factor, CategoricalFactor)]
    categorical = [factor.name for factor in factors if isinstance(factor, CategoricalFactor)]
    for index, text in enumerate(texts):
        if text is None:
            continue
        path: Path = ("consideration", index, "expr")
        try:
            found = Constraint(f"0 <= ({text})")
        except RegionError as error:
            for problem in error.problems:
                report.add(path, problem.message, problem.remedy, text)
            continue
        for name in sorted(found.numeric_names - set(numeric)):
            report.add(
                path, f"'{name}' is not a numeric factor", f"The numeric factors are {', '.join(numeric)}.", text
            )
        for name in sorted({name for name, _ in found.labels} - set(categorical)):
            report.add(path, f"'{name}' is not a factor with levels", "count takes a factor with levels.", text)


def simulator(folder: FilePath, table: Mapping[str, Any], factor_names: Sequence[str], report: Reporter) -> None:
    """Scene, table and map exist, and no sensor parameter is both a factor and fixed; ``table`` as written."""
    fixed = table.get("fixed")
    for key, more in (("scene", "; `seqrsm scene import` makes one"), ("table", ""), ("known_map", "")):
        file = table.get(key)
        if isinstance(file, str) and file and not os.path.isfile(folder / file):
            remedy = f"Give its path from the campaign's folder{more}."
            report.add(("simulator", key), "there is no such file", remedy, file)
    for key, value in fixed.items() if isinstance(fixed, dict) else ():
        parameter = sensors(table).parameter(key)
        for name in factor_names:
            if name == key or (parameter is not None and name in (parameter.name, parameter.field)):
                message = f"'{name}' is both a factor and fixed"
                report.add(("simulator", "fixed", key), message, "Remove it from one of the two.", value)


def region(
    factors: Sequence[Factor | None], constraints: Sequence[Constraint | None], report: Reporter
) -> Region | None:
    """The region, once every factor and constraint is right in itself."""
    made_factors = tuple(factor for factor in factors if factor is not None)
    made_constraints = tuple(constraint for constraint in constraints if constraint is not None)
    names = [factor.name for factor in made_factors]
    complete = len(made_factors) == len(factors) and len(made_constraints) == len(constraints)
    if not complete or len(set(names)) < len(names):
        return None
    try:
        return Region(made_factors, made_constraints)
    except RegionError as error:
        for problem in error.problems:
            report.add(_constraint_path(problem, made_constraints), problem.message, problem.remedy, problem.value)
    return None


def _constraint_path(problem: Problem, constraints: Sequence[Constraint]) -> Path:
    for index, constraint in enumerate(constraints):
        if problem.value == constraint.expr or problem.field == f"constraint '{constraint.expr}'":
            return ("constraint", index, "expr")
    return ("constraint",) if constraints else ("factor",)


def knowledge(
    applications: Sequence[ApplicationSpec | None], factors: Sequence[Factor], model: ModelSpec | None, report: Reporter
) -> None:
    """What ``[application.prior]`` says is possible, and said in one place only."""
    numeric = {factor.name: factor for factor in factors if not isinstance(factor, CategoricalFactor)}
    known_factors = f"The numeric factors are {', '.join(numeric)}." if numeric else "There are none."
    for index, application in enumerate(applications):
        if application is None or application.prior is None:
            continue
        prior = application.prior
        path: Path = ("application", index, "prior")
        if prior.utility is not None:
            if model is not None and model.prior is not None:
                report.add(path, "there is also a prior in [model]", "Give it in one place only.")
            low, high = prior.utility
            if not low < high or (application.is_percent and not 0.0 <= low < high <= 100.0):
                remedy = f"Give [low, high]{', between 0 and 100' if application.is_percent else ''}."
                report.add((*path, "utility"), "this is not a range of scores", remedy, [low, high])
        elif prior.optimum or prior.repeat_sd is not None or not prior.effect:
            remedy = "Give utility = [low, high]: the mean score at a setting taken at random."
            report.add(path, "the range of the utility is missing", remedy)
        for name in (*prior.optimum, *prior.effect):
            if name not in numeric:
                key = "optimum" if name in prior.optimum else "effect"
                report.add((*path, key, name), f"'{name}' is not a numeric factor", known_factors)
        for name, expected in prior.optimum.items():
            if name not in numeric:
                continue
            value = expected if isinstance(expected, (int, float)) else expected.value
            low, high = span(numeric[name])
            if not low <= value <= high:
                remedy = f"Give a value from {low:g} to {high:g}."
                place = (*path, "optimum", name)
                report.add(place, "the optimum is expected outside the factor's range", remedy, value)
        logit = model is not None and model.response == "logit"
        for name, (least, most) in prior.effect.items():
            place = (*path, "effect", name)
            if not least < most or (least, most) == (-inf, inf):
                remedy = "Give [least, most], such as [0.0, inf] for a score that rises."
                report.add(place, "these bounds are empty or contradictory", remedy, [least, most])
            elif logit and any(isfinite(end) and end != 0.0 for end in (least, most)):
                remedy = "Give 0 or no bound (inf): on the logit scale only the sign of an effect can be bounded."
                report.add(place, "the bounds of the effect are no signs", remedy, [least, most])


def candidates(
    tables: Sequence[CandidateSpec | None], instruments: Sensors, factors: Sequence[str], report: Reporter
) -> None:
    """Note every fault of the candidates; ``factors``: names of the campaign's."""
    names: set[str] = set()
    for index, table in enumerate(tables):
        if table is None:
            continue
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
