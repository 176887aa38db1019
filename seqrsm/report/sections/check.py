"""What a campaign will take: what ``seqrsm check`` finds, and what a rehearsal says."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

from seqrsm.campaign.assumptions import summarise_notes
from seqrsm.campaign.check import CheckResult
from seqrsm.report.blocks import Bullets, Definitions, Paragraph, Section
from seqrsm.report.rounding import format_plain, format_significant


def check_sections(result: CheckResult, *, every_note: bool) -> tuple[Section, ...]:
    """Return what a campaign will take, and what its simulation rests on: in short, or every statement."""
    items = [
        ("factors", str(result.n_factors)),
        ("terms of the model", str(result.n_terms)),
        ("start design", f"{result.start_runs} runs"),
        ("fewest runs to stop", str(result.min_runs)),
        ("budget", f"{result.max_runs} runs, cost {format_plain(result.cost)}"),
    ]
    if math.isfinite(result.seconds_per_run):
        each, total = format_significant(result.seconds_per_run, 2), result.seconds_per_run * result.max_runs
        items.append(("one simulated run here", f"{each} s; the budget {_duration(total)}"))
    known = math.isfinite(result.noise)
    items.append(("standard deviation of a run", format_significant(result.noise) if known else result.noise_source))
    if result.ground_share > 0.0:
        items.append(("of its variance, the ground's", f"{format_significant(100.0 * result.ground_share, 2)} %"))
    if known:
        items.append(("found from", result.noise_source))
    sections = [Section("check", f"campaign {result.name}", (Definitions(tuple(items)),))]
    if result.combinations:
        sections.append(Section("combinations", "What some settings do", (Bullets(result.combinations),)))
    if result.hardware:
        text = "The radar that is recommended so far, against what ties its parameters; below 1 it could not be built"
        sections.append(Section("hardware", text, (Bullets(result.hardware),)))
    if result.notes:
        more = "" if every_note else "; all of them with -v or --json"
        title = f"What the simulation rests on ({len(result.notes)} statements{more})"
        notes = result.notes if every_note else summarise_notes(result.notes, result.covers)
        sections.append(Section("notes", title, (Bullets(notes),)))
    return tuple(sections)


def _duration(seconds: float) -> str:
    if seconds < 90.0:
        return f"{seconds:.0f} s"
    return f"{seconds / 60.0:.0f} min" if seconds < 5400.0 else f"{seconds / 3600.0:.1f} h"


def rehearsal_section(result: Mapping[str, Any]) -> Section:
    """Return the operating characteristics of the stop rule, as `seqrsm.campaign.rehearsal` found them."""
    items = tuple((label, text) for label, text in result["rows"])
    notes = (Paragraph(note) for note in result["notes"])
    return Section("rehearsal", f"{result['campaigns']} rehearsed campaigns", (Definitions(items), *notes))
