"""What was asked, and the runs that answer it."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Sequence
from functools import partial

from seqrsm.analysis.results import Analysis
from seqrsm.campaign.dossier import Dossier
from seqrsm.decide.stopping import LACK_OF_FIT_ALPHA
from seqrsm.design.factors import CategoricalFactor, Factor
from seqrsm.plain import counted, heading
from seqrsm.report.blocks import Block, Bullets, Cell, Column, Details, Paragraph, Section, Table, right, table
from seqrsm.report.rounding import NOTHING, decimals_for, format_number, format_plain, format_significant
from seqrsm.report.wording import (
    axis_label,
    describe_factor,
    factor_column,
    fixed_unit,
    format_value,
    level_text,
    listing,
    number_cell,
    readable,
    run_decimals,
    source_counts,
    targets_text,
    watched_interval,
    whole_cell,
    with_unit,
)
from seqrsm.store.records import RankingSummary, RunRecord

_SAME = ("Batch", "State", "Source", "Purpose", "In the fit", "Block")
"""Columns of the table of runs that the caption states where all rows are alike."""

MOST_RUNS = 2000
"""Rows of the table of runs; more would be hundreds of pages that nobody turns."""

_SERVES = {
    "optimum": ": mean at the optimum",
    "regret": ": place of the optimum",
    "spread": ": far from other runs",
    "repeat": ": pure error",
}
"""What a purpose of proposed runs stands for."""


def question_section(dossier: Dossier) -> Section:
    """Return question and region: applications, factors, constraints, stop rule."""
    spec, region = dossier.spec, dossier.spec.region
    blocks: list[Block] = [Paragraph(_stop_text(dossier))]
    if len(spec.applications) + len(spec.considerations) > 1:
        told = [(one.name, readable(one.utility), one.goal, one.weight) for one in spec.applications]
        told += [(heading(one.name, one.unit), one.expr, one.goal, one.weight) for one in spec.considerations]
        rows = ((name, value, goal, number_cell(format_plain(w), w)) for name, value, goal, w in told)
        columns = ("Objective", "Score, or value in natural units", "Goal", right("Weight"))
        blocks.append(table("Objectives", columns, rows))
    coded = "Factors; the model uses each coded from \u22121 to 1 on its scale"
    described = ((axis_label(factor), *describe_factor(factor)) for factor in region.factors)
    blocks.append(table(coded, ("Factor", "Kind and scale", "Range or levels"), described))
    if region.constraints:
        blocks.append(Paragraph("Constraints on the settings, in natural units:"))
        blocks.append(Bullets(tuple(constraint.expr for constraint in region.constraints)))
    if spec.simulator is not None and spec.simulator.fixed:
        members = spec.simulator.members.items()
        given = spec.simulator.fixed | {f"{member}.{name}": v for member, own in members for name, v in own.items()}
        fixed = (
            f"{readable(name)} {with_unit(format_value(value), fixed_unit(name, value))}"
            for name, value in given.items()
        )
        blocks.append(Paragraph(f"Sensor parameters held fixed: {'; '.join(fixed)}."))
    return Section("question", "Question and region", (*blocks, *_data_blocks(dossier)))


def _stop_text(dossier: Dossier) -> str:
    stop = dossier.spec.stop
    target, loss = (targets_text(dossier.spec, key) for key in ("half_width", "loss"))
    loss = f" and the settings an expected loss of at most {loss}" if loss else ""
    guards = {
        "runs": "a minimum number of runs for the terms of the model",
        "confirmation": f"{stop.confirmation_runs} confirmation runs that agree with the model",
    }
    model = dossier.spec.quadratic.name
    return (
        f"Stop rule: the {level_text(stop.level)} {watched_interval(stop)} at the optimum has a half-width of at most "
        f"{target}{loss}; in addition, {guards[stop.guard]}. If only the {model} is considered, pure "
        "error must be estimable and lack of fit not significant (at "
        f"{level_text(LACK_OF_FIT_ALPHA)}). Budget: {stop.max_runs} runs."
    )


def _data_blocks(dossier: Dossier) -> list[Block]:
    """How the data came: runs by state, source and purpose."""
    runs = dossier.runs
    states = Counter(run.state for run in runs)
    scored = [run for run in runs if run.state == "scored"]
    counts = listing([f"{count} {state}" for state, count in states.items()])
    batches = counted(len({run.batch for run in runs}), "batch", "batches")
    text = f"The campaign has {counted(len(runs), 'run')} in {batches}: {counts}."
    if len({run.source for run in scored}) > 1:
        text += f" Sources: {source_counts(scored)}."
    purposes = Counter(run.purpose or "not stated" for run in runs)
    whys = listing([f"{readable(of)}{_SERVES.get(of, '')} ({count})" for of, count in purposes.items()])
    blocks: list[Block] = [Paragraph(f"{text} Purposes: {whys}.")]
    left_out = [run for run in runs if run.state in ("void", "failed")]
    if left_out:
        rows = ((whole_cell(run.run_id), run.state, run.reason or "no reason recorded") for run in left_out)
        blocks.append(table("Runs excluded from the fit", (right("Run"), "State", "Reason"), rows))
    return [*blocks, *(interpreter_table(one) for one in dossier.rankings)]


def interpreter_table(summary: RankingSummary) -> Table:
    """Return how sharply each interpreter tells images apart, and agrees with the scores."""
    rows = (
        (
            one.interpreter,
            whole_cell(one.rankings),
            number_cell(format_significant(one.sharpness, 2), one.sharpness),
            f"{format_significant(one.low, 2)} to {format_significant(one.high, 2)}",
            NOTHING if one.agreement is None else number_cell(format_number(one.agreement, 2), one.agreement),
        )
        for one in summary.interpreters
    )
    caption = (
        f"Interpreters of {summary.application}. Sharpness: of preferences, 1 on average, 0 of a guess; agreement: "
        "Kendall's tau-b of an interpreter's rankings with the scores"
    )
    heads = ("Interpreter", right("Rankings"), right("Sharpness"), "95 % interval", right("Agreement"))
    return table(caption, heads, rows)


def run_section(dossier: Dossier) -> Section:
    """Return the table of the runs, the last section of a report: all of them, or the last `MOST_RUNS`."""
    total = len(dossier.runs)
    some = f"The last {MOST_RUNS} of {total}" if total > MOST_RUNS else ""
    table_of = (_run_table(dossier, dossier.runs[-MOST_RUNS:]),)
    block = Details(f"{some or f'All {total}'} runs with settings and scores", table_of)
    note = (Paragraph(f"{some} runs; `seqrsm export` writes them all.", "note"),) if some else ()
    return Section("runs", "The last runs" if some else "All runs", (*note, block))


def _run_table(dossier: Dossier, runs: Sequence[RunRecord]) -> Table:
    applications = [application.name for application in dossier.spec.applications]
    by_name = {analysis.application: analysis for analysis in dossier.analyses}
    with_error = {score.application for run in dossier.runs for score in run.scores if score.se is not None}
    fitted = {int(run) for analysis in dossier.analyses for run in analysis.data.run_ids}
    left_out = any(run.state == "scored" and run.run_id not in fitted for run in dossier.runs) and bool(fitted)
    columns: list[tuple[Column, Callable[[RunRecord], Cell]]] = [
        (right("Run"), lambda run: whole_cell(run.run_id)),
        (right("Batch"), lambda run: whole_cell(run.batch)),
    ]
    for f in dossier.spec.factors:
        column = Column(readable(f.name)) if isinstance(f, CategoricalFactor) else factor_column(f)
        columns.append((column, partial(_setting_cell, f)))
    for name in applications:
        analysis = by_name.get(name)
        title, unit = "Score" if len(applications) == 1 else f"Score {name}", analysis.score_unit if analysis else ""
        columns.append((right(title, unit), partial(_score_cell, name, analysis)))
        if name in with_error:
            columns.append((right("s.e.", unit), partial(_error_cell, name)))
    columns.append((Column("State"), lambda run: Cell(run.state)))
    columns.append((Column("Source"), lambda run: Cell(run.source)))
    columns.append((Column("Purpose"), lambda run: Cell(readable(run.purpose))))
    if left_out:
        columns.append((Column("In the fit"), lambda run: Cell("yes" if run.run_id in fitted else "no")))
    if any(run.block for run in dossier.runs):
        columns.append((Column("Block"), lambda run: Cell(run.block)))
    filled = [(column, [cell_of(run) for run in runs]) for column, cell_of in columns]
    alike = {c.title: cells[0].text for c, cells in filled if c.title in _SAME and len({x.text for x in cells}) == 1}
    told = ", ".join(f"{title.lower()} {text}" for title, text in alike.items())
    caption = f"Settings as run, and scores{f'; all runs: {told}' if told else ''}"
    kept = [own for own in filled if own[0].title not in alike]
    rows = zip(*(cells for _, cells in kept), strict=True)
    return Table(tuple(column for column, _ in kept), tuple(rows), caption, sortable=True)


def _setting_cell(factor: Factor, run: RunRecord) -> Cell:
    value = run.settings.get(factor.name)
    if value is None:
        return Cell("")
    if isinstance(factor, CategoricalFactor):
        return Cell(str(value))
    return number_cell(format_plain(float(f"{float(value):.4g}")), float(value))


def _score_cell(application: str, analysis: Analysis | None, run: RunRecord) -> Cell:
    record = run.score_of(application)
    if record is None:
        return Cell("")
    if record.se is not None:
        text = format_number(record.score, decimals_for(record.se))
    elif analysis is not None:
        text = format_number(record.score, run_decimals(analysis))
    else:
        text = format_significant(record.score, 4)
    return number_cell(text, record.score)


def _error_cell(application: str, run: RunRecord) -> Cell:
    record = run.score_of(application)
    if record is None or record.se is None:
        return Cell("")
    return number_cell(format_number(record.se, decimals_for(record.se)), record.se)
