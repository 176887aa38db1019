"""How interval and optimum moved with the runs, and the confirmation."""

from __future__ import annotations

import math
from collections.abc import Sequence
from functools import partial

from seqrsm.analysis.results import Analysis
from seqrsm.report.blocks import (
    Block,
    Details,
    Entry,
    FigureBlock,
    Head,
    Panel,
    Paragraph,
    Section,
    Table,
    right,
    table,
)
from seqrsm.report.figures.data import look_data
from seqrsm.report.figures.fit import half_width_panel, mean_history_panel
from seqrsm.report.history import Look, read_looks
from seqrsm.report.rounding import decimals_for, format_number, format_plain, format_significant
from seqrsm.report.wording import (
    decimal_cell,
    factor_column,
    format_setting,
    half_width_text,
    interval_text,
    level_phrase,
    listing,
    number_cell,
    score_decimals,
    score_text,
    setting_posterior,
    setting_spread,
    whole_cell,
    with_unit,
)
from seqrsm.spec.read import CampaignSpec
from seqrsm.store.records import LookRecord


def history_section(spec: CampaignSpec, records: Sequence[LookRecord], analysis: Analysis, key: str) -> Section | None:
    """Return how interval and optimum moved with the runs, and the fresh runs; None where there is neither."""
    looks = read_looks(records, analysis.application)
    blocks: list[Block] = []
    if looks:
        blocks.append(_history_figure(analysis, looks, spec.stop.half_width))
        blocks.append(Details(f"All {len(looks)} interim analyses", (_look_table(analysis, looks),), long=True))
    if analysis.confirmation is not None:
        blocks.append(_confirmation(analysis))
    if not blocks:
        return None
    return Section(f"{key}-history", "Progress of interval and optimum", tuple(blocks))


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
        draw = partial(half_width_panel, analysis, looks, target)
        panels.append(Panel("Stop-rule half-width", alt, draw, name="history-of-half-width", data=data))
    if any(math.isfinite(look.mean) for look in looks):
        alt = f"Mean score at the optimum of each interim analysis, last {score_text(analysis, looks[-1].mean)}."
        draw = partial(mean_history_panel, analysis, looks)
        panels.append(Panel("Mean score at the optimum", alt, draw, name="history-of-mean-score", data=data))
    caption = (
        "Results of each interim analysis. Dashed green: target of the stop rule; dotted grey: noise floor, which more "
        "runs cannot lower. Band: confidence interval of the mean."
    )
    return FigureBlock(tuple(panels), caption, columns=3)


def _look_table(analysis: Analysis, looks: Sequence[Look]) -> Table:
    factors, unit = analysis.region.factors, analysis.score_unit
    rows: list[tuple[Entry, ...]] = []
    for look in looks:
        settings = (
            format_setting(f, look.settings[f.name], setting_spread(setting_posterior(analysis, f)), unit=False)
            if f.name in look.settings
            else ""
            for f in factors
        )
        width = format_significant(look.half_width, 3) if math.isfinite(look.half_width) else "none"
        rows.append(
            (
                whole_cell(look.n_runs),
                number_cell(width, look.half_width),
                decimal_cell(look.mean, score_decimals(analysis)),
                *settings,
                "yes" if look.held else "no",
            )
        )
    columns: tuple[Head, ...] = (
        *(right("Runs"), right("Half-width", unit), right("Mean at optimum", unit)),
        *map(factor_column, factors),
        "Rule met",
    )
    return table("Interval and optimum at each interim analysis", columns, rows, sortable=True)


def _confirmation(analysis: Analysis) -> Paragraph:
    confirmation = analysis.confirmation
    assert confirmation is not None
    places = max(decimals_for(confirmation.interval.half_width), score_decimals(analysis))
    runs = listing([str(run) for run in confirmation.run_ids])
    scores = ", ".join(format_number(score, places) for score in confirmation.scores)
    text = (
        f"Confirmation runs {runs} at the recommended settings scored {scores}. Their mean is "
        f"{with_unit(format_number(confirmation.mean, places), analysis.score_unit)}, with a {level_phrase(analysis)} "
        f"interval, independent of the model, of {interval_text(analysis, confirmation.interval)}."
    )
    return Paragraph(text)
