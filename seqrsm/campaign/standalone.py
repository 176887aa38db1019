"""``seqrsm design``: an optimal design without a campaign."""

from __future__ import annotations

import csv
from pathlib import Path
from typing import Any, get_args

from seqrsm.design.evaluate import evaluate_design
from seqrsm.design.factors import ContinuousFactor
from seqrsm.design.optimal import Criterion, optimal_design
from seqrsm.design.quadratic import QuadraticModel
from seqrsm.design.region import Region
from seqrsm.errors import Problem, UserError


def _criterion(text: str) -> Criterion:
    for criterion in get_args(Criterion):
        if text.upper() == criterion:
            found: Criterion = criterion
            return found
    known = ", ".join(get_args(Criterion))
    raise UserError(Problem("unknown criterion", f"Use one of {known}.", field="--criterion", value=text))


def standalone_design(n_factors: int, n_runs: int, criterion: str, seed: int, out: Path | None) -> dict[str, Any]:
    """Optimal design for the full quadratic model in ``n_factors`` factors on [-1, 1].

    Parameters
    ----------
    n_factors, n_runs : int
    criterion : str
        One of `seqrsm.design.optimal.Criterion`, in any case.
    seed : int
        Of the search.
    out : Path, optional
        CSV of the coded points.

    Returns
    -------
    dict
        Points and what is known of their quality.

    Raises
    ------
    DesignError
        Fewer runs than terms, or an unknown criterion.
    UserError
        The file cannot be written.
    """
    factors = tuple(ContinuousFactor(f"x{i + 1}", -1.0, 1.0) for i in range(n_factors))
    model = QuadraticModel(factors)
    region = Region(factors)
    design = optimal_design(model, region, n_runs, _criterion(criterion), seed=seed)
    if out is not None:
        try:
            with out.open("w", newline="", encoding="utf-8") as stream:
                writer = csv.writer(stream)
                writer.writerow([factor.name for factor in factors])
                writer.writerows([[repr(float(x)) for x in row] for row in design.points])
        except OSError as error:
            raise UserError(Problem(f"cannot write the file: {error.strerror}", file=str(out))) from error
    report = evaluate_design(model, region, design.points)
    return {
        "factors": n_factors,
        "runs": n_runs,
        "terms": model.p,
        "criterion": design.criterion,
        "points": design.points.tolist(),
        "d_efficiency": design.d_efficiency,
        "i_efficiency": design.i_efficiency,
        "g_efficiency": report.g_efficiency,
        "d_value": design.d_value,
        "i_value": design.i_value,
        "condition_number": design.condition_number,
        "fraction_of_design_space": report.fraction_of_design_space.tolist(),
        "warnings": [f"cannot be estimated: {name}" for name in design.inestimable],
        "searches": design.starts,
        "searches_that_ended_here": design.hits,
        "seed": design.seed,
    }
