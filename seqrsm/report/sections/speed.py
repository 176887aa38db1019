"""On which database the runs were simulated, and the measured trade-off of speed and accuracy."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from functools import partial
from typing import TYPE_CHECKING, Any

from seqrsm.campaign.dossier import Dossier
from seqrsm.campaign.status import simulated_by
from seqrsm.campaign.tradeoff import COARSENED
from seqrsm.report.blocks import (
    Block,
    Bullets,
    Cell,
    FigureBlock,
    Head,
    Panel,
    PanelData,
    Paragraph,
    Section,
    right,
    table,
)
from seqrsm.report.figures import drawing
from seqrsm.report.rounding import format_number, format_plain, format_significant
from seqrsm.report.wording import ground_name, listing, number_cell, significant_cell, slug, whole_cell, with_unit

if TYPE_CHECKING:
    from matplotlib.figure import Figure


def speed_section(dossier: Dossier) -> Section | None:
    """Return on which database each run was simulated, and the measured trade-off; None without a simulator."""
    simulator, measured = dossier.spec.simulator, dossier.tradeoff
    if simulator is None:
        return None
    unit = dossier.spec.applications[0].score_unit
    how = "on the full scene"
    if simulator.tolerance > 0.0:
        accepted = with_unit(format_plain(simulator.tolerance), unit)
        how = f"on the coarsest scene whose measured rms error of the score is at most {accepted}"
    blocks: list[Block] = [Paragraph(f"Runs were simulated {how}.")]
    rows = [(ground_name(one["averaged"]), whole_cell(one["runs"])) for one in simulated_by(dossier.runs)]
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
        blocks.append(Paragraph(text + "The intervals do not include it."))
    if measured is not None:
        blocks += tradeoff_blocks(measured, unit)
    return Section("speed", "Speed and accuracy of the simulations", tuple(blocks))


def tradeoff_blocks(measured: Mapping[str, Any], unit: str) -> list[Block]:
    """What ``seqrsm tradeoff`` measured: coarser databases against the one as it is.

    Parameters
    ----------
    measured : Mapping
        From `seqrsm.campaign.tradeoff.measure_tradeoff`.
    unit : str
        Of the scores.
    """
    simulation = measured["simulation"]
    blocks: list[Block] = []
    for name, rows in simulation["applications"].items():
        if rows:
            blocks += _tradeoff_blocks(name, rows, simulation["tolerance"], unit)
    notes = [f"A configuration could not be simulated: {reason}" for reason in simulation["failures"]]
    return [*blocks, Bullets(tuple(notes))] if notes else blocks


def _tradeoff_blocks(name: str, rows: Sequence[Mapping[str, Any]], tolerance: float, unit: str) -> list[Block]:
    columns: tuple[Head, ...] = (
        right("Minimum cells per pixel side"),
        right("Cells averaged"),
        right("Time per run", "ms"),
        right("Time relative to full scene", "%"),
        *(right(title, unit) for title in ("Bias \u00b1 s.e.", "Rms error", "Largest error")),
        right("Rank correlation"),
        right("Utility lost \u00b1 s.e.", unit),
    )
    accepted = f" (accepted: {with_unit(format_plain(tolerance), unit)})" if tolerance > 0.0 else ""
    caption = (
        f"Coarsened scenes against the full scene for {name}{accepted}, {rows[-1]['configurations']} configurations "
        f"and {rows[-1]['occasions']} occasions. Cells are averaged while the minimum number per pixel side remains. "
        "Time: CPU time. Utility lost: by choosing the configuration that scores best on the coarsened scene"
    )
    alt = "; ".join(
        f"{_label(row)}: {100 * row['time_ratio']:.3g} % of the time, rms error {row['rms_error']:.2g}" for row in rows
    )
    draw = partial(drawing.draw, partial(_paint, rows, tolerance, unit))
    title = f"Speed and accuracy, {name}"
    panel = Panel(title, alt, draw, name=slug(f"speed against accuracy {name}"), data=partial(_data, rows))
    under = (
        "Error of the score against time per run, by minimum cells per pixel side. Dotted: tolerance, if any. The full "
        "simulation has no error and is drawn at the bottom."
    )
    return [FigureBlock((panel,), under), table(caption, columns, map(_row, rows))]


def _label(row: Mapping[str, Any]) -> str:
    return f"{row['cells']} cells" if row["cells"] else "all"


def _row(row: Mapping[str, Any]) -> tuple[Cell, ...]:
    rank = row["rank_correlation"]
    return (
        Cell(_label(row)),
        Cell(listing([f"{k} x {k}" for k in row["averaged"]])),
        significant_cell(1000.0 * row["seconds"]),
        number_cell(format_significant(100.0 * row["time_ratio"], 3), row["time_ratio"]),
        Cell(f"{format_number(row['bias'], 2)} \u00b1 {format_number(row['bias_se'], 2)}", row["bias"]),
        number_cell(format_number(row["rms_error"], 2), row["rms_error"]),
        number_cell(format_number(row["largest_error"], 2), row["largest_error"]),
        Cell("none") if rank is None else number_cell(format_number(rank, 2), rank),
        Cell(f"{format_number(row['utility_lost'], 2)} \u00b1 {format_number(row['utility_lost_se'], 2)}"),
    )


def _data(rows: Sequence[Mapping[str, Any]]) -> PanelData:
    names = ("cells", "time_ratio", "bias", "bias_se", "rms_error", "largest_error")
    return PanelData(names, tuple(tuple(row[name] for name in names) for row in rows))


def _paint(rows: Sequence[Mapping[str, Any]], tolerance: float, unit: str, figure: Figure) -> None:
    from matplotlib.ticker import FuncFormatter, LogLocator, NullLocator

    axes = figure.add_subplot()
    least = 0.5 * min([row["rms_error"] for row in rows if row["rms_error"] > 0.0], default=tolerance or 1.0)
    if tolerance > 0.0:
        axes.axhline(tolerance, color=drawing.MUTED, linestyle=":", linewidth=1.0)
    for row in rows:
        x, y = 100.0 * row["time_ratio"], max(row["rms_error"], least)
        axes.scatter([x], [y], s=26, color=drawing.BLUE, zorder=3, linewidths=0)
        axes.annotate(_label(row), (x, y), xytext=(5, 4), textcoords="offset points", fontsize=8)
    axes.set_xscale("log")
    axes.set_yscale("log")
    for axis in (axes.xaxis, axes.yaxis):
        axis.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0)))
        axis.set_major_formatter(FuncFormatter(lambda x, _: f"{x:g}"))
        axis.set_minor_locator(NullLocator())
    axes.set_xlabel("time per run [% of full simulation]")
    axes.set_ylabel(f"rms error of the score [{unit}]" if unit else "rms error of the score")
    axes.grid(visible=True)
    axes.margins(x=0.18, y=0.18)
