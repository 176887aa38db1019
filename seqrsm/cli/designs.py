"""``seqrsm design``: an optimal design without a campaign."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, get_args

import numpy as np

from seqrsm.design.constraints import Constraint
from seqrsm.design.evaluate import DesignReport, evaluate_design
from seqrsm.design.factors import CategoricalFactor, ContinuousFactor, DiscreteFactor, Factor
from seqrsm.design.optimal import Criterion, optimal_design
from seqrsm.design.quadratic import QuadraticModel
from seqrsm.design.region import Region
from seqrsm.errors import UserError
from seqrsm.files import csv_text, put
from seqrsm.plain import plain, shallow
from seqrsm.rng import generator

_MAX_FACTORS = 8


def parse_factor(text: str) -> Factor:
    """A factor from ``NAME=LOW:HIGH``, ``NAME=LOW:HIGH:log`` or ``NAME=LEVEL,LEVEL,...``; UserError of all else."""
    remedy = 'Write NAME=LOW:HIGH, NAME=LOW:HIGH:log, or NAME=LEVEL,LEVEL; for example "looks=1,2,4".'
    name, equals, rest = (part.strip() for part in text.partition("="))
    if not equals or not name or not rest:
        raise UserError("a factor cannot be read", remedy, field="--factor", value=text)
    if ":" in rest:
        low, _, tail = rest.partition(":")
        high, _, scale = tail.partition(":")
        try:
            ends = float(low), float(high)
        except ValueError:
            message = "the range of a factor is not a pair of numbers"
            raise UserError(message, remedy, field="--factor", value=text) from None
        if scale.strip() not in ("", "log", "linear"):
            raise UserError("unknown scale", "Use log or linear.", field="--factor", value=text)
        return ContinuousFactor(name, *ends, scale="log" if scale.strip() == "log" else "linear")
    levels = [part.strip() for part in rest.split(",") if part.strip()]
    try:
        return DiscreteFactor(name, tuple(float(level) for level in levels))
    except ValueError:
        return CategoricalFactor(name, tuple(levels))


def factors_of(number: int | None, declared: Sequence[str]) -> tuple[Factor, ...]:
    """Coded continuous factors x1, x2 ... of a number, or those that are declared, see `parse_factor`.

    UserError where both are given, neither is, or there are too many.
    """
    if declared and number is not None:
        remedy = "Give --factors or --factor, not both."
        raise UserError("both a number of factors and factors are given", remedy, field="--factors")
    if declared:
        found = tuple(parse_factor(text) for text in declared)
        if len(found) > _MAX_FACTORS:
            raise UserError("too many factors", f"Use {_MAX_FACTORS} at most.", field="--factor", value=len(found))
        return found
    if number is None:
        raise UserError("no factors", "Give their number (--factors) or each of them (--factor).", field="--factors")
    return tuple(ContinuousFactor(f"x{i + 1}", -1.0, 1.0) for i in range(number))


def standalone_design(
    factors: tuple[Factor, ...],
    constraints: Sequence[str],
    *,
    runs: int,
    criterion: str,
    order: int,
    centre: int,
    seed: int,
    random_order: bool,
) -> dict[str, Any]:
    """Make a design of ``factors``, see `factors_of`, and tell how good it is: points, settings, and their quality.

    ``runs`` include those at the ``centre``; ``order`` is 1 or 2; rows are in the order made, or in ``random_order``.
    DesignError or RegionError of fewer runs than terms, factors or constraints that cannot be; UserError of options
    that do not go together.
    """
    known: dict[str, Criterion] = {name: name for name in get_args(Criterion)}
    if criterion.upper() not in known:
        raise UserError("unknown criterion", f"Use one of {', '.join(known)}.", field="--criterion", value=criterion)
    if centre >= runs:
        remedy = "Give fewer, or more --runs, which include those at the centre."
        raise UserError("no runs remain besides those at the centre", remedy, field="--centre", value=centre)
    region = Region(factors, tuple(Constraint(text) for text in constraints))
    model = QuadraticModel(factors, order)
    repeats = np.tile(region.centre(), (centre, 1))
    design = optimal_design(model, region, runs - centre, known[criterion.upper()], seed=seed, fixed=repeats)
    points = np.vstack([repeats, design.points])
    if random_order:
        points = points[generator(seed, 0, "order of runs").permutation(len(points))]
    report = evaluate_design(model, region, points)
    return {
        "factors": region.k,
        "names": list(region.names),
        "runs": len(points),
        "terms": model.p,
        "criterion": criterion.upper(),
        "run_order": "random" if random_order else "standard",
        "points": points.tolist(),
        "settings": region.decode(points),
        **plain(shallow(report)),
        "warnings": _warnings(report, saturated=len(points) == model.p),
        "searches": design.starts,
        "searches_that_ended_here": design.hits,
        "seed": seed,
    }


def _warnings(report: DesignReport, *, saturated: bool) -> list[str]:
    warnings = []
    if report.condition_number > 1e3:
        warnings.append(f"the design is ill-conditioned (condition number {report.condition_number:.2g})")
    if saturated:
        warnings.append("as many runs as terms: the scatter cannot be estimated")
    elif not report.df_pure_error:
        warnings.append("no settings are repeated, so lack of fit cannot be tested")
    return warnings


def write_design(out: Path, design: Mapping[str, Any]) -> None:
    """Write the runs of a design of `standalone_design` as CSV, natural settings; UserError where that cannot be."""
    columns = []
    for name in design["names"]:
        column = [settings[name] for settings in design["settings"]]
        if not isinstance(column[0], str):
            least = 1e-6 * max(map(abs, column))  # below it, the search's rounding of zero
            column = [f"{value if abs(value) >= least else 0.0:.12g}" for value in column]
        columns.append(column)
    put(out, csv_text([design["names"], *zip(*columns, strict=True)]).encode("utf-8"))
