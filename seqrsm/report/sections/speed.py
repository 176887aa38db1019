"""On which database the runs were simulated, and the measured trade-off of speed and accuracy."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from itertools import groupby
from typing import Any

from seqrsm.campaign.dossier import Dossier
from seqrsm.campaign.status import simulated_by
from seqrsm.campaign.tradeoff import COARSENED
from seqrsm.report.blocks import Block, Bullets, Cell, Head, Paragraph, Section, right, table
from seqrsm.report.rounding import decimals_for, format_number, format_plain, format_significant
from seqrsm.report.wording import ground_name, listing, number_cell, significant_cell, whole_cell, with_unit


def speed_section(dossier: Dossier) -> Section | None:
    """Return how scenes were coarsened and what that cost; None where every run had the full scene."""
    simulator, measured = dossier.spec.simulator, dossier.tradeoff
    if simulator is None:
        return None
    grounds = simulated_by(dossier.runs)
    if measured is None and simulator.tolerance == 0.0 and all(one["averaged"] == 1 for one in grounds):
        return None
    units = {one.name: one.score_unit for one in dossier.spec.applications}
    unit = next(iter(units.values())) if len(set(units.values())) == 1 else ""
    how = "on the full scene"
    if simulator.tolerance > 0.0:
        accepted = with_unit(format_plain(simulator.tolerance), unit)
        how = f"on the coarsest scene whose measured rms error of the score is at most {accepted}"
    blocks: list[Block] = [Paragraph(f"Runs were simulated {how}.")]
    rows = [(ground_name(one["averaged"]), whole_cell(one["runs"])) for one in grounds]
    if rows:
        blocks.append(table("Resolution of the simulations", ("Scene", right("Runs")), rows))
    compared = [event.detail for event in dossier.events if event.kind == COARSENED]
    if compared:
        differences = listing(
            [
                f"{with_unit(format_number(error, 2), unit)} at {cells}"
                for cells, error in compared[-1]["rms_error"].items()
            ]
        )
        text = f"Rms difference of scores, by the cells left along a side of a pixel: {differences}. "
        few = "It was measured at a few settings, from the finest to the coarsest sensor of the region"
        other = "" if measured is None else "; the table below is of others, spread over the region"
        blocks.append(Paragraph(f"{text}{few}{other}. The intervals do not include it."))
    if measured is not None:
        blocks += tradeoff_blocks(measured, units)
    return Section("speed", "Speed and accuracy of the simulations", tuple(blocks))


def tradeoff_blocks(measured: Mapping[str, Any], units: Mapping[str, str]) -> list[Block]:
    """What `seqrsm.campaign.tradeoff.measure_tradeoff` measured: coarser databases against the one as it is.

    ``units`` are those of the scores of each application.
    """
    simulation = measured["simulation"]
    tolerance = simulation["tolerance"]
    blocks: list[Block] = []
    for name, rows in ((name, rows) for name, rows in simulation["applications"].items() if rows):
        unit = units.get(name, "")  # of an application that has another name by now
        accepted = f" (accepted: {with_unit(format_plain(tolerance), unit)})" if tolerance > 0.0 else ""
        columns: tuple[Head, ...] = (
            right("Minimum cells per pixel side"),
            right("Cells averaged"),
            right("Time per run", "ms"),
            right("Time relative to full scene", "%"),
            *(right(title, unit) for title in ("Bias \u00b1 s.e.", "Rms error", "Largest error")),
            right("Rank correlation"),
            right("Utility lost \u00b1 s.e.", unit),
        )
        places = max(decimals_for(max(row["rms_error"] for row in rows)), 2)  # scores may lie between 0 and 1
        caption = (
            f"Coarsened scenes against the full scene for {name}{accepted}, {rows[-1]['configurations']} "
            f"configurations and {rows[-1]['occasions']} occasions. Cells are averaged while the minimum number per "
            "pixel side remains. Time: CPU time. Utility lost: by choosing the configuration that scores best on the "
            "coarsened scene"
        )
        blocks.append(table(caption, columns, (_row(list(alike), places) for _, alike in groupby(rows, _numbers))))
    notes = [f"A configuration could not be simulated: {reason}" for reason in simulation["failures"]]
    return [*blocks, Bullets(tuple(notes))] if notes else blocks


def _numbers(row: Mapping[str, Any]) -> dict[str, Any]:
    """All but the minimum of cells: coarser scenes that average as many cells are the same scene."""
    return {name: value for name, value in row.items() if name != "cells"}


def _row(alike: Sequence[Mapping[str, Any]], places: int) -> tuple[Cell, ...]:
    row = alike[0]
    rank = row["rank_correlation"]
    return (
        Cell(listing([f"{one['cells']} cells" if one["cells"] else "all" for one in alike])),
        Cell(listing([f"{k} x {k}" for k in row["averaged"]])),
        significant_cell(1000.0 * row["seconds"]),
        number_cell(format_significant(100.0 * row["time_ratio"], 3), row["time_ratio"]),
        Cell(f"{format_number(row['bias'], places)} \u00b1 {format_number(row['bias_se'], places)}", row["bias"]),
        number_cell(format_number(row["rms_error"], places), row["rms_error"]),
        number_cell(format_number(row["largest_error"], places), row["largest_error"]),
        Cell("none") if rank is None else number_cell(format_number(rank, 2), rank),
        Cell(f"{format_number(row['utility_lost'], places)} \u00b1 {format_number(row['utility_lost_se'], places)}"),
    )
