"""What ``seqrsm tradeoff`` measured of the sampler, of single precision and of the search of designs."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from seqrsm.report.blocks import Block, Cell, Paragraph, Table, right, table
from seqrsm.report.rounding import format_significant
from seqrsm.report.wording import number_cell, significant_cell, whole_cell


def numerics_blocks(numerics: Mapping[str, Any]) -> list[Block]:
    """One table for each part that was measured, or why it was not; nothing for those that were not asked for."""
    blocks: list[Block] = []
    sampler = numerics.get("sampler") or {}
    if "why" in sampler:
        blocks.append(Paragraph(f"The sampler was not measured: {sampler['why']}."))
    else:
        blocks += [_sampler_table(name, rows) for name, rows in sampler.items()]
    precision = numerics.get("precision") or []
    if precision and "why" not in precision:
        blocks.append(_precision_table(precision))
    if numerics.get("design_search"):
        blocks.append(_search_table(numerics["design_search"]))
    return blocks


def _sampler_table(name: str, rows: Sequence[Mapping[str, Any]]) -> Table:
    columns = ("Method", "Interval of", right("Draws"), right("Monte Carlo error of its ends"), right("Time", "s"))
    cells = (
        (
            row["method"],
            row["quantity"],
            whole_cell(row["draws"]),
            f"{format_significant(row['error_low'], 2)} and {format_significant(row['error_high'], 2)}",
            significant_cell(row["seconds"]),
        )
        for row in rows
    )
    return table(f"Draws of the posterior of {name} against the Monte Carlo error of its intervals", columns, cells)


def _precision_table(rows: Sequence[Mapping[str, Any]]) -> Table:
    columns = (
        *(right("Score, single"), right("Score, double"), right("Median difference of a pixel", "1")),
        *(right("Time, single", "ms"), right("Time, double", "ms")),
    )
    cells = (
        (
            *(number_cell(f"{row[name]:.4f}", row[name]) for name in ("score32", "score64")),
            Cell(f"{row['median_difference']:.1e}", row["median_difference"]),
            *(significant_cell(1000.0 * row[name]) for name in ("seconds32", "seconds64")),
        )
        for row in rows
    )
    return table("Single against double precision of the simulation, at some configurations", columns, cells)


def _search_table(rows: Sequence[Mapping[str, Any]]) -> Table:
    columns = (right("Restarts"), right("Efficiency, median"), right("Least"), right("Time", "s"))
    cells = (
        (
            whole_cell(row["restarts"]),
            *(number_cell(f"{row[name]:.4f}", row[name]) for name in ("efficiency", "least_efficiency")),
            significant_cell(row["seconds"]),
        )
        for row in rows
    )
    return table("Restarts of the search of the start design, against the best that was found", columns, cells)
