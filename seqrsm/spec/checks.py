"""What must hold in ``campaign.toml`` beyond the type of each key: tables that fit each other."""

from __future__ import annotations

import os
from collections.abc import Mapping, Sequence
from dataclasses import replace
from math import inf, isfinite
from pathlib import Path as FilePath
from typing import Any, TypeAlias, TypeVar

import numpy as np

from seqrsm.design.constraints import Constraint, arithmetic
from seqrsm.design.factors import CategoricalFactor, Factor, settings_text, span
from seqrsm.design.region import Region, declaration_problems
from seqrsm.errors import Problem, RegionError
from seqrsm.fit.error_models import ERROR_MODELS, NORMAL
from seqrsm.spec.faults import Reporter
from seqrsm.spec.sensors import RESERVED
from seqrsm.spec.tables import ApplicationSpec, ConsiderationSpec, ModelSpec, Table
from seqrsm.spec.toml_lines import Path

_COVER = 1000
_T = TypeVar("_T", bound=Table, covariant=True)
Tables: TypeAlias = Sequence[tuple[int, _T]]
"""Repeated tables that are right in themselves, each with its place in the file."""


def different_names(report: Reporter) -> None:
    """Every factor, application and consideration has a name of its own."""
    seen: set[tuple[object, str]] = set()
    for path, name in report.names.items():
        if path[0] in ("factor", "application", "consideration") and (path[0], name) in seen:
            report.add((*path, "name"), f"two tables [[{path[0]}]] have this name", "Rename one.", name)
        seen.add((path[0], name))


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


def desirabilities(kind: str, tables: Tables[ApplicationSpec | ConsiderationSpec], report: Reporter) -> None:
    """``unacceptable`` lies on the bad side of ``ideal``."""
    for index, table in tables:
        if table.unacceptable is None or table.ideal is None:
            continue
        rises = table.ideal > table.unacceptable
        if table.ideal == table.unacceptable or rises != (table.goal == "maximize"):
            side = "above" if table.goal == "maximize" else "below"
            remedy = f'With goal = "{table.goal}" it lies {side} unacceptable.'
            report.add((kind, index, "ideal"), "ideal is not better than unacceptable", remedy, table.ideal)


def model(
    table: ModelSpec, applications: Tables[ApplicationSpec], names: Sequence[str], *, simulated: bool, report: Reporter
) -> None:
    """Keys of ``[model]`` that exclude each other, the factors' ``names``, or what the scores will be."""
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
        elif by_counts and any(not one.is_percent for _, one in applications):
            remedy = f'Set utility = "percent_correct", or {key} = "{plain}".'
            report.add(place, f"{what} are for percentages of correct decisions", remedy, value)
    no_percent = [one.name for _, one in applications if not one.may_be_percent]
    if table.response == "logit" and no_percent:
        message = f"logits are of scores from 0 to 100 percent, and those of '{no_percent[0]}' are not"
        report.add(("model", "response"), message, 'Set response = "identity".', table.response)
    if errors.response and table.response != errors.response:
        remedy = f'Add response = "{errors.response}".'
        message = f"{errors.name} scores are modelled on the {errors.response} scale"
        report.add(("model", "errors"), message, remedy, errors.name)
    if errors.of_counts and table.weights != "equal":
        remedy = "Omit weights: the counts determine them."
        message = f"{errors.name} errors take their weights from the counts"
        report.add(("model", "weights"), message, remedy, table.weights)
    other = {*names, *RESERVED} - {"block", "source", "date", "note"}
    if table.block is not None and (not table.block.strip() or table.block in other):
        message = "the column of blocks needs a name that means nothing else"
        report.add(("model", "block"), message, 'Name a column of the scores files, such as "day".', table.block)
    if table.block_effect == "random" and table.block is None:
        report.add(("model", "block_effect"), "block_effect needs a block", 'Add block = "block".', "random")
    if table.block_effect == "random" and not errors.random_blocks:
        known = " or ".join(f'"{name}"' for name, model in ERROR_MODELS.items() if model.random_blocks)
        remedy = f'Write errors = {known}, or block_effect = "fixed".'
        report.add(("model", "block_effect"), f"{errors.name} errors have no random blocks", remedy, "random")


def catalogued(applications: Tables[ApplicationSpec], engine: str | None, report: Reporter) -> None:
    """Words that an application names of the catalogue are in it, for the engine's kind of sensor."""
    kind, system = {"psm": ("radar ", "active"), "prm": ("radiometer ", "passive")}.get(engine or "", ("", None))
    for index, application in applications:
        if not application.catalog:
            continue
        from seqrsm.catalog.search import search  # reads tables that few campaigns need here

        if not application.catalog.strip() or not search(application.catalog, system=system):
            message = f"no {kind}entry of Tables A.1 to A.20 matches this"
            remedy = "`seqrsm catalog` lists them, `seqrsm catalog WORDS` tries words; or omit the key."
            report.add(("application", index, "catalog"), message, remedy, application.catalog)


def goals(applications: Tables[ApplicationSpec], report: Reporter) -> None:
    """An error is made small, a utility that has a unit keeps it, and what suffices can be scored."""
    for index, application in applications:
        path: Path = ("application", index)
        if application.is_error and application.goal == "maximize":
            report.add((*path, "goal"), "the utility is an error", 'Write goal = "minimize".', application.goal)
        if application.unit not in ("", application.score_unit):
            text = f"scores of this utility are in {application.score_unit}"
            report.add((*path, "unit"), text, "Remove the key.", application.unit)
        low, high = application.score_limits
        if application.sufficient is not None and not low <= application.sufficient <= high:
            ends = f"Scores go from {low:g} to {high:g}." if isfinite(low) else f"Scores are {high:g} at most."
            report.add((*path, "sufficient"), "there is no such score", ends, application.sufficient)


def targets(applications: Tables[ApplicationSpec], stop: object, report: Reporter) -> None:
    """A target in ``[stop]``, as written, is for scores of one unit; of your own functions it may be unknown."""
    for key in ("half_width", *(("loss",) if isinstance(stop, dict) and "loss" in stop else ())):
        shared = [(i, one) for i, one in applications if one.has_known_unit and getattr(one, key) is None]
        if len({one.score_unit for _, one in shared}) > 1:
            for index, one in shared:
                text = f"scores of these applications have different units and share [stop] {key}"
                remedy = f"Add {key} = NUMBER{f', in {one.score_unit}' if one.score_unit else ''}."
                report.add(("application", index, key), text, remedy)


def expressions(
    tables: Tables[ConsiderationSpec], factors: Sequence[Factor], region: Region | None, report: Reporter
) -> None:
    """Expressions of considerations: arithmetic in the factors, with a value at points that cover the region."""
    settings = region.natural(region.candidates(limit=_COVER)) if tables and region is not None else None
    for index, table in tables:
        try:
            written = arithmetic(table.expr)
            problems = list(declaration_problems(factors, [written]))
            if settings is not None and not problems:
                problems = _undefined(written, factors, settings)
        except RegionError as error:
            problems = [replace(problem, value=table.expr) for problem in error.problems]
        for problem in problems:
            report.add(("consideration", index, "expr"), problem.message, problem.remedy, problem.value or table.expr)


def _undefined(written: Constraint, factors: Sequence[Factor], settings: Mapping[str, np.ndarray]) -> list[Problem]:
    """The first of the settings, (n,) by name, at which the expression has no value."""
    n = len(settings[factors[0].name])
    nowhere = np.flatnonzero(~np.isfinite(written.right(settings, n)))
    if not nowhere.size:
        return []
    used = [factor for factor in factors if factor.name in written.names]
    there = settings_text(used, {name: values[nowhere[0]] for name, values in settings.items()})
    return [Problem(f"there is no finite value at {there}", "Change it, or exclude such settings by a constraint.")]


def simulator(folder: FilePath, table: Mapping[str, Any], factor_names: Sequence[str], report: Reporter) -> None:
    """Scene, table and map exist, and no sensor parameter is both a factor and fixed; ``table`` as written."""
    fixed = table.get("fixed")
    for key in ("scene", "table", "calendar", "known_map"):
        file, more = table.get(key), "; `seqrsm scene import` makes one" if key == "scene" else ""
        if isinstance(file, str) and file and not os.path.isfile(folder / file):
            remedy = f"Give its path from the campaign's folder{more}."
            report.add(("simulator", key), "there is no such file", remedy, file)
    for key, value in fixed.items() if isinstance(fixed, dict) else ():
        if key in factor_names:
            message = f"'{key}' is both a factor and fixed"
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
    applications: Tables[ApplicationSpec], factors: Sequence[Factor], model: ModelSpec | None, report: Reporter
) -> None:
    """What ``[application.prior]`` says is possible."""
    numeric = {factor.name: factor for factor in factors if not isinstance(factor, CategoricalFactor)}
    known_factors = f"The numeric factors are {', '.join(numeric)}." if numeric else "There are none."
    for index, application in applications:
        if application.prior is None:
            continue
        prior = application.prior
        path: Path = ("application", index, "prior")
        if prior.utility is not None:
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
