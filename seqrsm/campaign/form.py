"""The form that a flight crew fills in: issued runs with an empty score, ready for `seqrsm ingest`."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from seqrsm.campaign.export import csv_text
from seqrsm.design.factors import CategoricalFactor, Factor
from seqrsm.errors import Problem, UserError
from seqrsm.files import put
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


def form_rows(spec: CampaignSpec, runs: Sequence[RunRecord]) -> tuple[list[str], list[list[object]]]:
    """Columns and rows of the form, a row for each run and application; None where somebody is to fill in.

    Factors are in their own units; the block's column has the name of ``[model] block``.
    """
    several = ["application"] if len(spec.applications) > 1 else []
    block = spec.model.block or "block"
    own = [name for name in dict.fromkeys((block, "score", "se", "note")) if name not in spec.region.names]
    rows: list[list[object]] = []
    for run in runs:
        cells = {block: run.block or None, "note": run.why}
        settings = [run.proposed[name] for name in spec.region.names]
        rows += [
            [run.run_id, *([one.name] if several else []), *settings, *(cells.get(name) for name in own)]
            for one in spec.applications
        ]
    return ["run_id", *several, *spec.region.names, *own], rows


def write_form(path: Path, spec: CampaignSpec, runs: Sequence[RunRecord]) -> None:
    """Write the form with units in its header; text that a spreadsheet would run as a formula is neutralised.

    Raises
    ------
    UserError
        The file exists, or cannot be written.
    """
    units = {
        factor.name: f"{factor.name} [{factor.unit}]"
        for factor in spec.factors
        if not isinstance(factor, CategoricalFactor) and factor.unit
    }
    header, rows = form_rows(spec, runs)
    if path.exists():
        raise UserError(Problem("the file exists already", "Name a new file.", file=str(path)))
    put(path, csv_text([units.get(name, name) for name in header], rows).encode("utf-8"))
