"""What a campaign will take: what ``seqrsm check`` finds, and what a rehearsal says."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

from seqrsm.campaign.budget import Plan
from seqrsm.campaign.check import CheckResult, Judged
from seqrsm.report.blocks import Bullets, Definitions, Paragraph, Section, right, table
from seqrsm.report.rounding import NOTHING, format_against, format_plain, format_significant
from seqrsm.report.sections.sources import group_notes
from seqrsm.report.wording import with_unit


def check_sections(result: CheckResult) -> tuple[Section, ...]:
    """Return what a campaign will take, and what its simulation rests on: in short, or every statement."""
    cost = f", cost {with_unit(format_plain(result.cost), result.cost_unit)}" if result.cost_unit else ""
    judged = result.judged
    least, most = (str(max(own)) for own in zip(*((j.min_runs, j.min_runs_departed) for j in judged), strict=True))
    if most != least:
        least += f", or up to {most} if scores favour another surface than the model"
    if result.further_days is not None:
        enough = min(one.further_days or 0 for one in judged)
        least += f", and more for each further flight day; the budget is enough for {enough} of these"
    items = [
        ("factors", str(result.n_factors)),
        ("model terms", str(result.n_terms)),
        ("initial design", f"{result.start_runs} runs"),
        ("minimum runs to stop", least),
        ("budget", f"{result.max_runs} runs{cost}"),
    ]
    if math.isfinite(result.seconds_per_run):
        each, total = format_significant(result.seconds_per_run, 2), result.seconds_per_run * result.max_runs
        items.append(("simulation time here", f"{each} s a run; {_duration(total)} for the budget"))
    of = {one.application: f", {one.application}" if result.others else "" for one in judged}
    for one in judged:
        known = math.isfinite(one.noise)
        scatter = with_unit(format_significant(one.noise), one.unit) if known else one.noise_source
        items.append((f"run-to-run standard deviation{of[one.application]}", scatter))
        if one.ground_share > 0.0:
            items.append(
                (
                    f"variance from table uncertainty{of[one.application]}",
                    f"{format_significant(100.0 * one.ground_share, 2)} %",
                )
            )
        if known:
            items.append((f"estimated from{of[one.application]}", one.noise_source))
    sections = [Section("check", f"campaign {result.name}", (Definitions(tuple(items)),))]
    told: set[Paragraph] = set()  # what a row is stands once
    for one in judged:
        sections += _budget_sections(one, of[one.application], told)
    if result.combinations:
        sections.append(Section("combinations", "Notes on the region and the scene", (Bullets(result.combinations),)))
    if result.hardware:
        text = "Feasibility of the radar recommended so far (margins below 1 cannot be built)"
        sections.append(Section("hardware", text, (Bullets(result.hardware),)))
    if result.notes:
        title = f"Assumptions of the simulation ({len(result.notes)}; --json shows all, with those on single covers)"
        sections.append(Section("notes", title, (Bullets(group_notes(result.notes, result.covers)[2]),)))
    return tuple(sections)


def _budget_sections(result: Judged, of: str, told: set[Paragraph]) -> list[Section]:
    """What the budget can give, in different ways, and what other numbers of runs give; ``of`` which application.

    What a row is joins ``told`` and is not repeated.
    """
    if not result.plans:
        return []
    known = math.isfinite(result.target)

    def amount(value: float, target: float = math.nan) -> str:
        return format_against(value, target, 2) if math.isfinite(value) else "-"

    def numbers(plan: Plan) -> tuple[str, str, str]:
        reach = "yes" if plan.reaches(result.target, result.target_loss) else "no"
        return (
            amount(plan.half_width, result.target),
            amount(plan.loss, result.target_loss),
            reach if plan.runs >= plan.asked else f"needs {plan.asked} runs",
        )

    columns = (right("Half-width", result.unit), right("Expected loss", result.unit))
    limit = f", loss {format_plain(result.target_loss)}" if math.isfinite(result.target_loss) else ""
    reach = f"\u00b1 {format_plain(result.target)}{limit}?" if known else "Enough runs?"
    departed = []
    if result.loss_departed > result.plans[0].loss:
        loss = amount(result.loss_departed, result.target_loss)
        departed.append(("if the surface is no quadratic", NOTHING, NOTHING, loss, NOTHING))
    ways = table(
        f"Expected results of {result.plans[0].runs} runs",
        ("Model", right("Terms"), *columns, reach),
        [(plan.change or "as in campaign.toml", str(plan.n_terms), *numbers(plan)) for plan in result.plans] + departed,
    )
    first = {plan.runs: plan for plan in result.over if plan.change}
    heads = (right("First order", result.unit), right("Loss", result.unit)) if first else ()
    other = table(
        "Expected results of other numbers of runs",
        (right("Runs"), *columns, reach, *heads),
        [
            (str(n), *numbers(plan), *((amount(first[n].half_width), amount(first[n].loss)) if first else ()))
            for n, plan in ((plan.runs, plan) for plan in result.over if not plan.change)
        ],
    )
    not_known = "" if known else " The run-to-run standard deviation (s.d. of a run) is not known yet."
    how = (
        f"Each row: 200 simulated campaigns on {result.surfaces}. Half-width: that of the stop-rule interval; "
        f"expected loss: mean shortfall of the settings found from the best in the region.{not_known} These are rough "
        "estimates; `seqrsm rehearse` simulates every step of `run`, once there are scores."
    )
    note = {Paragraph(how, "note")} - told
    told |= note
    return [Section("budget", f"What the budget can achieve{of}", (ways, other, *note))]


def _duration(seconds: float) -> str:
    if seconds < 90.0:
        return f"{seconds:.0f} s" if seconds >= 1.0 else "less than 1 s"
    return f"{seconds / 60.0:.0f} min" if seconds < 5400.0 else f"{seconds / 3600.0:.1f} h"


def rehearsal_section(result: Mapping[str, Any]) -> Section:
    """Return the operating characteristics of the stop rule, as `seqrsm.campaign.rehearsal` found them."""
    items = tuple((label, text) for label, text in result["rows"])
    notes = (Paragraph(note) for note in result["notes"])
    return Section("rehearsal", f"{result['campaigns']} rehearsed campaigns", (Definitions(items), *notes))
