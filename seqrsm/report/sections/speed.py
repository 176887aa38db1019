"""How faithfully the runs were simulated, what that could cost in accuracy, and the measured trade-off."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from functools import partial
from typing import TYPE_CHECKING, Any

import numpy as np

from seqrsm.campaign.dossier import Dossier
from seqrsm.campaign.fidelity_watch import VIOLATED, fidelity_of
from seqrsm.campaign.tradeoff import AUTO
from seqrsm.report.blocks import (
    Block,
    Bullets,
    Cell,
    Column,
    FigureBlock,
    Panel,
    PanelData,
    Paragraph,
    Section,
    Table,
)
from seqrsm.report.figures import drawing
from seqrsm.report.rounding import format_number, format_plain, format_significant
from seqrsm.report.sections.numerics import numerics_blocks
from seqrsm.report.wording import listing, number_cell, slug, whole_cell, with_unit
from seqrsm.simulate.fidelity import MEANINGS, RUNGS

if TYPE_CHECKING:
    from matplotlib.figure import Figure


def speed_section(dossier: Dossier) -> Section | None:
    """Return which model each run was simulated by, and the measured trade-off; None without a simulator."""
    simulator = dossier.spec.simulator
    if simulator is None:
        tables = [] if dossier.tradeoff is None else numerics_blocks(dossier.tradeoff["numerics"])
        return Section("speed", "Speed and accuracy of the numbers", tuple(tables)) if tables else None
    unit = dossier.spec.applications[0].unit
    accepted = with_unit(format_plain(simulator.tolerance), unit)
    how = (
        f"the cheapest model of each run that is proven to stay within {accepted} of the full simulation"
        if simulator.fidelity == "auto"
        else f"rung {simulator.fidelity} of the ladder of models, as asked for"
    )
    blocks: list[Block] = [
        Paragraph(
            f"Runs are simulated by {how}. All models of a run draw the same occasion: its fields, date, moisture and "
            "training ground."
        )
    ]
    table = _run_table(dossier, unit)
    if table is not None:
        blocks += [table, *_checks(dossier, unit)]
    if dossier.plan is not None and dossier.plan["effects"]:
        blocks.append(_effects_table(dossier.plan, unit))
    measured = dossier.tradeoff
    if measured is None:
        blocks.append(Paragraph("seqrsm tradeoff measures speed against accuracy on this scene; it was not run."))
    else:
        for name, rows in measured["simulation"]["applications"].items():
            blocks += _tradeoff_blocks(name, rows, simulator.tolerance, unit)
        refused = [f"{rung} cannot be used: {reason}" for rung, reason in measured["simulation"]["refused"].items()]
        blocks += [Bullets(tuple(refused))] if refused else []
        blocks += numerics_blocks(measured["numerics"])
    return Section("speed", "Speed and accuracy of the simulations", tuple(blocks))


def _run_table(dossier: Dossier, unit: str) -> Table | None:
    kept = [found for run in dossier.runs if run.state == "scored" and (found := fidelity_of(run))]
    rows = []
    for rung in RUNGS:
        own = [found for found in kept if found["rung"] == rung]
        if own:
            bound = max(float(found["bound"]) for found in own)
            left = listing(sorted({str(name) for found in own for name in found["left_out"]})) or "nothing"
            worst = number_cell(format_significant(bound, 2) if bound > 0.0 else "0", bound)
            rows.append((Cell(rung), Cell(MEANINGS[rung]), whole_cell(len(own)), worst, Cell(left)))
    columns = (
        Column("Model"),
        Column("What is made"),
        Column("Runs", align="right"),
        Column("Largest error, bound", unit, "right"),
        Column("Left out"),
    )
    return Table(columns, tuple(rows), "Models by which the runs were simulated") if rows else None


_VERDICTS = {"exact": "proven to change nothing", "bounded": "within the tolerance", "needed": "needed"}


def _effects_table(plan: Mapping[str, Any], unit: str) -> Table:
    """What the planner says of every effect, in words."""
    rows = tuple(
        (
            Cell(effect["name"]),
            Cell(_VERDICTS[effect["verdict"]]),
            Cell("no bound")
            if effect["bound"] is None
            else number_cell(format_significant(effect["bound"], 2) if effect["bound"] > 0.0 else "0", effect["bound"]),
            Cell(effect["text"]),
        )
        for effect in plan["effects"]
    )
    columns = (
        Column("Effect"),
        Column("Leaving it out"),
        Column("Changes the score by at most", unit, "right"),
        Column("Test"),
    )
    return Table(columns, rows, f"What each effect does at the recommended settings. Chosen there: {plan['why']}")


def _checks(dossier: Dossier, unit: str) -> list[Block]:
    """What the online check found."""
    checks = [found["check"] for run in dossier.runs if (found := fidelity_of(run)) and "check" in found]
    violations = [event for event in dossier.events if event.kind == VIOLATED]
    if not checks:
        return [Paragraph("No run was drawn for a check by the next model; a twentieth of them is.", "note")]
    worst = max(checks, key=lambda check: abs(check["difference"]) / check["limit"])
    text = (
        f"Runs drawn at random and simulated by the next model, too: {len(checks)}. The largest difference against its "
        f"limit was {with_unit(format_number(abs(worst['difference']), 2), unit)} of "
        f"{with_unit(format_number(worst['limit'], 2), unit)}."
    )
    if not violations:
        return [Paragraph(text + " No bound was violated.")]
    factors = listing(
        [
            f"{event.detail['rung']} by a factor of {format_significant(event.detail['factor'], 2)}"
            for event in violations
        ]
    )
    text += f" Bounds were violated and widened: {factors}; runs that this put in doubt were made again."
    return [Paragraph(text, "warning")]


def _tradeoff_blocks(name: str, rows: Sequence[Mapping[str, Any]], tolerance: float, unit: str) -> list[Block]:
    columns = (
        Column("Model"),
        Column("Time of the full simulation", "%", "right"),
        Column("Bias \u00b1 s.e.", unit, "right"),
        Column("Rms error", unit, "right"),
        Column("Largest error", unit, "right"),
        Column("Rank correlation", align="right"),
        Column("Utility lost \u00b1 s.e.", unit, "right"),
    )
    table = Table(
        columns,
        tuple(_row(row) for row in rows),
        f"Each model against the full simulation (F4) for {name}, over {rows[-1]['configurations']} configurations and "
        f"{rows[-1]['occasions']} occasions; the last row is what the planner chooses. Utility lost: by taking the "
        "configuration that the model finds best",
    )
    alt = "; ".join(
        f"{row['rung']}: {100 * row['time_ratio']:.3g} % of the time, rms error {row['rms_error']:.2g}" for row in rows
    )
    svg = drawing.draw(partial(_paint, rows, tolerance, unit))
    data = partial(_data, rows)
    panel = Panel(
        f"Speed against accuracy, {name}", alt, svg=svg, name=slug(f"speed against accuracy {name}"), data=data
    )
    caption = (
        "Time of a run against the error of its score, each over that of the full simulation. Dotted: the tolerance; "
        "orange: what the planner chooses; dashed: models that no other beats in both. F4 has no error and "
        "is drawn at the bottom."
    )
    return [FigureBlock((panel,), caption), table]


def _row(row: Mapping[str, Any]) -> tuple[Cell, ...]:
    rank = row["rank_correlation"]
    return (
        Cell("planner" if row["rung"] == AUTO else row["rung"]),
        number_cell(format_significant(100.0 * row["time_ratio"], 3), row["time_ratio"]),
        Cell(f"{format_number(row['bias'], 2)} \u00b1 {format_number(row['bias_se'], 2)}", row["bias"]),
        number_cell(format_number(row["rms_error"], 2), row["rms_error"]),
        number_cell(format_number(row["largest_error"], 2), row["largest_error"]),
        Cell("none") if rank is None else number_cell(format_number(rank, 2), rank),
        Cell(f"{format_number(row['utility_lost'], 2)} \u00b1 {format_number(row['utility_lost_se'], 2)}"),
    )


def pareto(rows: Sequence[Mapping[str, Any]]) -> list[Mapping[str, Any]]:
    """Models that no other beats in both time and error; the planner's own choice is a mixture of them."""
    from seqrsm.decide.compromise import pareto_front

    models = [row for row in rows if row["rung"] != AUTO]
    values = np.array([(row["time_ratio"], row["rms_error"]) for row in models]).reshape(-1, 2)
    front = pareto_front(values, ("minimize", "minimize"))
    return [row for row, best in zip(models, front, strict=True) if best]


def _data(rows: Sequence[Mapping[str, Any]]) -> PanelData:
    names = ("rung", "time_ratio", "bias", "bias_se", "rms_error", "largest_error")
    return PanelData(names, tuple(tuple(row[name] for name in names) for row in rows))


def _paint(rows: Sequence[Mapping[str, Any]], tolerance: float, unit: str, figure: Figure) -> None:
    from matplotlib.ticker import FuncFormatter, LogLocator, NullLocator

    axes = figure.add_subplot()
    least = 0.5 * min([row["rms_error"] for row in rows if row["rms_error"] > 0.0], default=tolerance)
    axes.axhline(tolerance, color=drawing.MUTED, linestyle=":", linewidth=1.0)
    front = sorted((100.0 * row["time_ratio"], max(row["rms_error"], least)) for row in pareto(rows))
    axes.plot(*zip(*front, strict=True), color=drawing.MUTED, linestyle="--", linewidth=0.8, zorder=1)
    for row in rows:
        x, y = 100.0 * row["time_ratio"], max(row["rms_error"], least)
        planner = row["rung"] == AUTO
        color = drawing.ORANGE if planner else drawing.BLUE
        axes.scatter([x], [y], s=26, color=color, marker="s" if planner else "o", zorder=3, linewidths=0)
        if not planner:
            text = "F4 (exact)" if row["rms_error"] == 0.0 else row["rung"]
            axes.annotate(text, (x, y), xytext=(5, 4), textcoords="offset points", fontsize=8)
    axes.set_xscale("log")
    axes.set_yscale("log")
    for axis in (axes.xaxis, axes.yaxis):
        axis.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0)))
        axis.set_major_formatter(FuncFormatter(lambda x, _: f"{x:g}"))
        axis.set_minor_locator(NullLocator())
    axes.set_xlabel("time of a run [% of the full simulation]")
    axes.set_ylabel(f"rms error of the score [{unit}]" if unit else "rms error of the score")
    axes.grid(visible=True)
    axes.margins(x=0.18, y=0.18)
