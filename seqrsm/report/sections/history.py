"""How interval and optimum moved with the runs."""

from __future__ import annotations

import math
from collections.abc import Sequence
from functools import partial

from seqrsm.analysis.results import Analysis
from seqrsm.report.blocks import Details, Entry, FigureBlock, Head, Section, Table, right, table
from seqrsm.report.figures import drawing
from seqrsm.report.figures.fit import Look, look_data, paint_half_widths, paint_mean_history, read_looks
from seqrsm.report.rounding import format_against, format_plain
from seqrsm.report.wording import (
    decimal_cell,
    factor_column,
    half_width_text,
    number_cell,
    score_decimals,
    score_text,
    setting_spreads,
    told_settings,
    whole_cell,
    with_unit,
)
from seqrsm.spec.read import CampaignSpec
from seqrsm.spec.tables import StopSpec
from seqrsm.store.records import LookRecord


def history_section(spec: CampaignSpec, records: Sequence[LookRecord], analysis: Analysis, key: str) -> Section | None:
    """Return how interval and optimum moved with the runs; None before the first interim analysis."""
    looks = read_looks(records, analysis.application)
    if not looks:
        return None
    stop = spec.stop_of(analysis.application)
    every = Details(f"Interim analyses ({len(looks)})", (_look_table(analysis, looks, stop),), long=True)
    figure = _history_figure(analysis, looks, stop.half_width)
    blocks = (figure, every) if len(looks) > 1 else (every,)  # one point has neither progress nor a band
    return Section(f"{key}-history", "Progress of interval and optimum", blocks)


def _history_figure(analysis: Analysis, looks: Sequence[Look], target: float) -> FigureBlock:
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
        paint = partial(paint_half_widths, analysis, looks, target)
        panels.append(drawing.panel("Stop-rule half-width", alt, paint, "history of half-width", data))
    if any(math.isfinite(look.mean) for look in looks):
        alt = f"Mean score at the optimum of each interim analysis, last {score_text(analysis, looks[-1].mean)}."
        paint = partial(paint_mean_history, analysis, looks)
        panels.append(drawing.panel("Mean score at the optimum", alt, paint, "history of mean score", data))
    lines = "Dashed green: target of the stop rule" if known else ""
    if known and analysis.decision.noise_floor > 0.0:
        lines += "; dotted grey: noise floor as estimated now, which more runs cannot lower"
    band = "Band: confidence interval of the mean" if any(math.isfinite(look.confidence[0]) for look in looks) else ""
    caption = " ".join(f"{text}." for text in ("Results of each interim analysis", lines, band) if text)
    return FigureBlock(lambda: tuple(panels), caption, columns=3)


def _look_table(analysis: Analysis, looks: Sequence[Look], stop: StopSpec) -> Table:
    factors, unit = analysis.region.factors, analysis.score_unit
    limit = math.nan if stop.loss is None else stop.loss
    rows: list[tuple[Entry, ...]] = []
    for look in looks:
        known = all(f.name in look.settings for f in factors)
        told = told_settings(analysis.region, look.settings, setting_spreads(analysis)) if known else {}
        width = format_against(look.half_width, stop.half_width, 3) if math.isfinite(look.half_width) else "none"
        rows.append(
            (
                whole_cell(look.n_runs),
                number_cell(width, look.half_width),
                decimal_cell(look.mean, score_decimals(analysis)),
                number_cell(format_against(look.loss, limit, 2) if math.isfinite(look.loss) else "", look.loss),
                *(told.get(f.name, "") for f in factors),
                "yes" if look.held else "no",
            )
        )
    columns: tuple[Head, ...] = (
        *(right("Runs"), right("Half-width", unit), right("Mean at optimum", unit), right("Expected loss", unit)),
        *map(factor_column, factors),
        "Rule met",
    )
    caption = "Interval and optimum at each interim analysis, and now. Rule met: all conditions of the stop rule"
    return table(caption, columns, rows, sortable=True)
