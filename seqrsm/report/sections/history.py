"""How interval and optimum moved with the runs, the parts of the stop rule, and the confirmation."""

from __future__ import annotations

import math
from collections.abc import Sequence
from functools import partial

from seqrsm.analysis.results import Analysis
from seqrsm.campaign.dossier import Dossier
from seqrsm.design.factors import CategoricalFactor, Factor
from seqrsm.report.blocks import Block, Bullets, Cell, Column, Details, FigureBlock, Panel, Paragraph, Section, Table
from seqrsm.report.figures.data import look_data
from seqrsm.report.figures.fit import half_width_panel, mean_history_panel, setting_history_panel
from seqrsm.report.history import Look, read_looks
from seqrsm.report.rounding import decimals_for, format_number, format_plain, format_significant
from seqrsm.report.wording import (
    format_setting,
    half_width_text,
    interval_text,
    level_phrase,
    listing,
    number_cell,
    optimum_setting_text,
    readable,
    score_decimals,
    score_text,
    setting_posterior,
    setting_spread,
    slug,
    whole_cell,
    with_unit,
)


def history_section(dossier: Dossier, analysis: Analysis, key: str) -> Section:
    """Return how interval and optimum moved with the runs, and the parts of the stop rule."""
    stop = dossier.spec.stop
    looks = read_looks(dossier.looks, analysis.application)
    blocks: list[Block] = []
    if looks:
        blocks.append(_history_figure(analysis, looks, stop.half_width, dossier.spec.factors))
        blocks.append(Details(f"All {len(looks)} looks", (_look_table(analysis, looks),)))
    else:
        blocks.append(Paragraph("No look at the data is recorded."))
    rows = tuple((Cell(readable(c.name)), Cell(_holds(c.holds)), Cell(c.text)) for c in analysis.decision.checks)
    columns = (Column("Part of the stop rule"), Column("Holds"), Column("Finding"))
    blocks.append(Table(columns, rows, "The stop rule at the last look"))
    if analysis.decision.futility:
        blocks.append(Bullets(tuple(analysis.decision.futility)))
    if analysis.confirmation is not None:
        blocks += _confirmation(analysis)
    return Section(f"{key}-history", "Interval and optimum against the number of runs", tuple(blocks))


def _holds(holds: bool | None) -> str:
    return {True: "yes", False: "no", None: "not testable"}[holds]


def _history_figure(analysis: Analysis, looks: Sequence[Look], target: float, factors: Sequence[Factor]) -> FigureBlock:
    known = [look for look in looks if math.isfinite(look.half_width)]
    target_text = with_unit(format_plain(target), analysis.score_unit)
    panels = []
    data = partial(look_data, analysis, looks)
    if known:
        alt = (
            f"Half-width against scored runs: {half_width_text(analysis, known[0].half_width)} after "
            f"{known[0].n_runs} runs, {half_width_text(analysis, known[-1].half_width)} after "
            f"{known[-1].n_runs}; the target is {target_text}."
        )
        svg = half_width_panel(analysis, looks, target)
        panels.append(Panel("Half-width that decides", alt, svg=svg, name="history-of-half-width", data=data))
    if any(math.isfinite(look.mean) for look in looks):
        alt = f"Estimated mean score at the optimum of each look, last {score_text(analysis, looks[-1].mean)}."
        svg = mean_history_panel(analysis, looks)
        panels.append(Panel("Mean score at the optimum", alt, svg=svg, name="history-of-mean-score", data=data))
    for factor in factors:
        if any(factor.name in look.settings for look in looks):
            alt = f"Optimal {readable(factor.name)} of each look, last {optimum_setting_text(analysis, factor)}."
            svg = setting_history_panel(factor, looks)
            name = slug(f"history of optimal {factor.name}")
            panels.append(Panel(readable(factor.name), alt, svg=svg, name=name, data=data))
    caption = (
        "What each look at the data found. Dashed green: target of the stop rule; dotted grey: noise floor, below "
        "which no number of runs can bring the half-width. Band: confidence interval of the mean."
    )
    return FigureBlock(tuple(panels), caption)


def _look_table(analysis: Analysis, looks: Sequence[Look]) -> Table:
    factors = analysis.region.factors
    columns = [Column("Runs", align="right"), Column("Half-width", analysis.score_unit, "right")]
    columns += [Column("Mean at the optimum", analysis.score_unit, "right")]
    columns += [Column(readable(f.name), "" if isinstance(f, CategoricalFactor) else f.unit, "right") for f in factors]
    columns.append(Column("Rule held"))
    rows = []
    for look in looks:
        settings = [
            format_setting(f, look.settings[f.name], setting_spread(setting_posterior(analysis, f)), unit=False)
            if f.name in look.settings
            else ""
            for f in factors
        ]
        width = format_significant(look.half_width, 3) if math.isfinite(look.half_width) else "none"
        mean = format_number(look.mean, score_decimals(analysis)) if math.isfinite(look.mean) else ""
        rows.append(
            (
                whole_cell(look.n_runs),
                number_cell(width, look.half_width),
                number_cell(mean, look.mean),
                *(Cell(text) for text in settings),
                Cell("" if look.held is None else _holds(look.held)),
            )
        )
    return Table(tuple(columns), tuple(rows), "Interval and optimum at every look", sortable=True)


def _confirmation(analysis: Analysis) -> list[Block]:
    confirmation = analysis.confirmation
    assert confirmation is not None
    places = max(decimals_for(confirmation.interval.half_width), score_decimals(analysis))
    runs = listing([str(run) for run in confirmation.run_ids])
    scores = ", ".join(format_number(score, places) for score in confirmation.scores)
    text = (
        f"Confirmation: runs {runs} were made afresh at the recommended settings and scored {scores}. Their mean is "
        f"{with_unit(format_number(confirmation.mean, places), analysis.score_unit)}, with an interval that does not "
        f"rest on the model: {interval_text(analysis, confirmation.interval)} ({level_phrase(analysis)})."
    )
    return [Paragraph(text), Paragraph(confirmation.text)]
