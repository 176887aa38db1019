"""``seqrsm design``: an optimal design without a campaign."""

from __future__ import annotations

import csv
from pathlib import Path
from typing import Any

from seqrsm.design.factors import ContinuousFactor
from seqrsm.design.optimal import optimal_design
from seqrsm.design.quadratic import QuadraticModel
from seqrsm.design.region import Region
from seqrsm.errors import Problem, UserError


def standalone_design(n_factors: int, n_runs: int, criterion: str, seed: int, out: Path | None) -> dict[str, Any]:
    """Optimal design for the full quadratic model in ``n_factors`` factors on [-1, 1].

    Parameters
    ----------
    n_factors, n_runs : int
    criterion : str
        "D", "I", "G" or "A".
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
    design = optimal_design(model, Region(factors), n_runs, criterion=criterion.upper(), seed=seed)
    if out is not None:
        try:
            with out.open("w", newline="", encoding="utf-8") as stream:
                writer = csv.writer(stream)
                writer.writerow([factor.name for factor in factors])
                writer.writerows([[repr(float(x)) for x in row] for row in design.points])
        except OSError as error:
            raise UserError(Problem(f"cannot write the file: {error.strerror}", file=str(out))) from error
    return {
        "factors": n_factors,
        "runs": n_runs,
        "terms": model.p,
        "criterion": criterion.upper(),
        "points": design.points.tolist(),
        **design.summary(),
    }
