"""What ``seqrsm tradeoff`` measured of the sampler, of single precision and of the search of designs."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from seqrsm.report.blocks import Block, Cell, Column, Table
from seqrsm.report.rounding import format_significant
from seqrsm.report.wording import number_cell, whole_cell


def numerics_blocks(numerics: Mapping[str, Any]) -> list[Block]:
    """One table for each part that was measured; none for those that were not."""
    blocks: list[Block] = []
    sampler = numerics.get("sampler") or {}
    for name, rows in {} if "why" in sampler else sampler.items():
        blocks.append(_sampler_table(name, rows))
    precision = numerics.get("precision") or []
    if precision and "why" not in precision:
        blocks.append(_precision_table(precision))
    if numerics.get("design_search"):
        blocks.append(_search_table(numerics["design_search"]))
    return blocks


def _number(value: float) -> Cell:
    return number_cell(format_significant(value, 3), value)


def _sampler_table(name: str, rows: Sequence[Mapping[str, Any]]) -> Table:
    columns = (
        Column("Method"),
        Column("Interval of"),
        Column("Draws", align="right"),
        Column("Monte Carlo error of its ends", align="right"),
        Column("Time", "s", "right"),
    )
    cells = tuple(
        (
            Cell(row["method"]),
            Cell(row["quantity"]),
            whole_cell(row["draws"]),
            Cell(f"{format_significant(row['error_low'], 2)} and {format_significant(row['error_high'], 2)}"),
            _number(row["seconds"]),
        )
        for row in rows
    )
    return Table(columns, cells, f"Draws of the posterior of {name} against the Monte Carlo error of its intervals")


def _precision_table(rows: Sequence[Mapping[str, Any]]) -> Table:
    columns = (
        Column("Score, single", align="right"),
        Column("Score, double", align="right"),
        Column("Median difference of a pixel", "1", "right"),
        Column("Time, single", "ms", "right"),
        Column("Time, double", "ms", "right"),
    )
    cells = tuple(
        (
            number_cell(f"{row['score32']:.4f}", row["score32"]),
            number_cell(f"{row['score64']:.4f}", row["score64"]),
            Cell(f"{row['median_difference']:.1e}", row["median_difference"]),
            _number(1000.0 * row["seconds32"]),
            _number(1000.0 * row["seconds64"]),
        )
        for row in rows
    )
    return Table(columns, cells, "Single against double precision of the simulation, at some configurations")


def _search_table(rows: Sequence[Mapping[str, Any]]) -> Table:
    columns = (
        Column("Restarts", align="right"),
        Column("Efficiency, median", align="right"),
        Column("Least", align="right"),
        Column("Time", "s", "right"),
    )
    cells = tuple(
        (
            whole_cell(row["restarts"]),
            number_cell(f"{row['efficiency']:.4f}", row["efficiency"]),
            number_cell(f"{row['least_efficiency']:.4f}", row["least_efficiency"]),
            _number(row["seconds"]),
        )
        for row in rows
    )
    return Table(columns, cells, "Restarts of the search of the start design, against the best that was found")
