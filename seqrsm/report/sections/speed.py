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
    FigureBlock,
    Head,
    Panel,
    PanelData,
    Paragraph,
    Section,
    Table,
    right,
    table,
)
from seqrsm.report.figures import drawing
from seqrsm.report.rounding import format_number, format_plain, format_significant
from seqrsm.report.wording import listing, number_cell, significant_cell, slug, whole_cell, with_unit
from seqrsm.simulate.fidelity import MEANINGS, RUNGS

if TYPE_CHECKING:
    from matplotlib.figure import Figure


def speed_section(dossier: Dossier) -> Section | None:
    """Return which model each run was simulated by, and the measured trade-off; None without a simulator."""
    simulator, measured = dossier.spec.simulator, dossier.tradeoff
    if simulator is None:
        blocks = [] if measured is None else tradeoff_blocks(measured, "")
        return Section("speed", "Speed and accuracy of the numbers", tuple(blocks)) if blocks else None
    unit = dossier.spec.applications[0].unit
    accepted = with_unit(format_plain(simulator.tolerance), unit)
    how = (
        f"the cheapest model of each run that is proven to stay within {accepted} of the full simulation"
        if simulator.fidelity == "auto"
        else f"rung {simulator.fidelity} of the ladder of models, as asked for"
    )
    blocks = [
        Paragraph(
            f"Runs are simulated by {how}. All models of a run draw the same occasion: its fields, date, moisture and "
            "training ground."
        )
    ]
    rungs = _run_table(dossier, unit)
    if rungs is not None:
        blocks += [rungs, *_checks(dossier, unit)]
    if dossier.plan is not None:
        blocks += plan_blocks(dossier.plan, unit, "the recommended settings")
    if measured is None:
        blocks.append(Paragraph("seqrsm tradeoff measures speed against accuracy on this scene; it was not run."))
    else:
        blocks += tradeoff_blocks(measured, unit)
    return Section("speed", "Speed and accuracy of the simulations", tuple(blocks))


def tradeoff_blocks(measured: Mapping[str, Any], unit: str) -> list[Block]:
    """What ``seqrsm tradeoff`` measured: every model against the full simulation, then draws, precision and searches.

    Parameters
    ----------
    measured : Mapping
        From `seqrsm.campaign.tradeoff.measure_tradeoff`.
    unit : str
        Of the scores.
    """
    simulation = measured["simulation"]
    if simulation is None:
        return [Paragraph(f"Nothing was simulated: {measured['why']}."), *numerics_blocks(measured["numerics"])]
    blocks: list[Block] = []
    for name, rows in simulation["applications"].items():
        blocks += _tradeoff_blocks(name, rows, simulation["tolerance"], unit)
    notes = [f"{rung} cannot be used: {reason}" for rung, reason in simulation["refused"].items()]
    notes += [f"A configuration could not be simulated: {reason}" for reason in simulation["failures"]]
    blocks += [Bullets(tuple(notes))] if notes else []
    return blocks + numerics_blocks(measured["numerics"])


def _run_table(dossier: Dossier, unit: str) -> Table | None:
    kept = [found for run in dossier.runs if run.state == "scored" and (found := fidelity_of(run))]
    rows = []
    for rung in RUNGS:
        own = [found for found in kept if found["rung"] == rung]
        if own:
            bound = max(float(found["bound"]) for found in own)
            left = listing(sorted({str(name) for found in own for name in found["left_out"]})) or "nothing"
            rows.append((rung, MEANINGS[rung], whole_cell(len(own)), _bound(bound), left))
    columns = ("Model", "What is made", right("Runs"), right("Largest error, bound", unit), "Left out")
    return table("Models by which the runs were simulated", columns, rows) if rows else None


def _bound(bound: float | None) -> Cell:
    """Bound of an error; None where none is known."""
    if bound is None:
        return Cell("no bound")
    return number_cell(format_significant(bound, 2) if bound > 0.0 else "0", bound)


_VERDICTS = {"exact": "proven to change nothing", "bounded": "within the tolerance", "needed": "needed"}


def plan_blocks(plan: Mapping[str, Any], unit: str, where: str) -> list[Block]:
    """What the planner says of every model of a run at some settings and of every effect, in words."""
    rungs = [
        (
            rung["rung"],
            rung["meaning"],
            *(("", "") if rung["refused"] else (_bound(rung["bound"]), f"{1000.0 * rung['effort']:.0f}")),
            rung["refused"] or ", ".join(rung["left_out"]) or "nothing left out",
        )
        for rung in plan["rungs"]
    ]
    effects = [
        (effect["name"], _VERDICTS[effect["verdict"]], _bound(effect["bound"]), effect["text"])
        for effect in plan["effects"]
    ]
    blocks: list[Block] = []
    if rungs:
        left = "Left out, or why it cannot be used"
        columns = ("Model", "What is made", right("Error at most", unit), right("Time, about", "ms"), left)
        blocks.append(table(f"Every model of a run at {where}", columns, rungs))
    if effects:
        heads = ("Effect", "Leaving it out", right("Changes the score by at most", unit), "Test")
        caption = f"What each effect does at {where}. Chosen there: {plan['why']}"
        blocks.append(table(caption, heads, effects))
    else:
        blocks.append(Paragraph(f"Chosen there: {plan['why']}"))
    return blocks


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
    columns: tuple[Head, ...] = (
        "Model",
        right("Time of a run", "ms"),
        right("Time of the full simulation", "%"),
        *(right(title, unit) for title in ("Bias \u00b1 s.e.", "Rms error", "Largest error", "Error at most")),
        right("Rank correlation"),
        right("Utility lost \u00b1 s.e.", unit),
    )
    caption = (
        f"Each model against the full simulation (F4) for {name}, over {rows[-1]['configurations']} configurations and "
        f"{rows[-1]['occasions']} occasions; the last row is what the planner chooses, which accepts errors of "
        f"{with_unit(format_plain(tolerance), unit)}. Time: median CPU time. Utility lost: by taking the configuration "
        "that the model finds best"
    )
    alt = "; ".join(
        f"{row['rung']}: {100 * row['time_ratio']:.3g} % of the time, rms error {row['rms_error']:.2g}" for row in rows
    )
    draw = partial(drawing.draw, partial(_paint, rows, tolerance, unit))
    title = f"Speed against accuracy, {name}"
    panel = Panel(title, alt, draw, name=slug(f"speed against accuracy {name}"), data=partial(_data, rows))
    under = (
        "Time of a run against the error of its score, each over that of the full simulation. Dotted: the tolerance; "
        "orange: what the planner chooses; dashed: models that no other beats in both. F4 has no error and "
        "is drawn at the bottom."
    )
    return [FigureBlock((panel,), under), table(caption, columns, map(_row, rows))]


def _row(row: Mapping[str, Any]) -> tuple[Cell, ...]:
    rank = row["rank_correlation"]
    return (
        Cell("planner" if row["rung"] == AUTO else row["rung"]),
        significant_cell(1000.0 * row["seconds"]),
        number_cell(format_significant(100.0 * row["time_ratio"], 3), row["time_ratio"]),
        Cell(f"{format_number(row['bias'], 2)} \u00b1 {format_number(row['bias_se'], 2)}", row["bias"]),
        number_cell(format_number(row["rms_error"], 2), row["rms_error"]),
        number_cell(format_number(row["largest_error"], 2), row["largest_error"]),
        _bound(row["bound"]),
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
