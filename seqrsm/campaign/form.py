"""The form that a flight crew fills in: issued runs with an empty score, ready for `seqrsm ingest`."""

from __future__ import annotations

import csv
from collections.abc import Sequence
from pathlib import Path

from seqrsm.campaign.export import safe_cell
from seqrsm.design.factors import CategoricalFactor, Factor
from seqrsm.errors import Problem, UserError
from seqrsm.score.cells import FactorColumn
from seqrsm.spec.read import CampaignSpec
from seqrsm.store.records import RunRecord


def factor_columns(factors: Sequence[Factor]) -> list[FactorColumn]:
    """What the columns of the factors must hold in a file that comes back."""
    return [
        FactorColumn(factor.name, levels=factor.levels)
        if isinstance(factor, CategoricalFactor)
        else FactorColumn(factor.name, factor.unit)
        for factor in factors
    ]


def write_form(path: Path, spec: CampaignSpec, runs: Sequence[RunRecord]) -> None:
    """Write one row for each run and application: settings with their units in the header, ``score`` left empty.

    The block's column has the name of ``[model] block``; text that a spreadsheet would run as a formula is neutralised.

    Raises
    ------
    UserError
        The file exists, or cannot be written.
    """
    headers = [
        safe_cell(
            factor.name
            if isinstance(factor, CategoricalFactor) or not factor.unit
            else f"{factor.name} [{factor.unit}]"
        )
        for factor in spec.factors
    ]
    several = len(spec.applications) > 1
    block = spec.model.block or "block"
    own = [column for column in (block, "score", "se", "note") if column not in spec.region.names]
    try:
        if path.exists():
            raise FileExistsError
        part = path.with_name(f"{path.name}.part")  # a form is there whole or not at all
        with part.open("w", newline="", encoding="utf-8") as stream:
            writer = csv.writer(stream)
            writer.writerow(["run_id", *(["application"] if several else []), *headers, *dict.fromkeys(own)])
            for run in runs:
                settings = [run.proposed[name] for name in spec.region.names]
                for application in spec.applications:
                    name = [application.name] if several else []
                    cells = {block: run.block, "note": run.why}
                    row = [run.run_id, *name, *settings, *(cells.get(column, "") for column in dict.fromkeys(own))]
                    writer.writerow([safe_cell(cell) for cell in row])
        part.replace(path)
    except FileExistsError:
        raise UserError(Problem("the file exists already", "Name a new file.", file=str(path))) from None
    except OSError as error:
        raise UserError(
            Problem(f"cannot write the file: {error.strerror}", "Name another file.", file=str(path))
        ) from error
