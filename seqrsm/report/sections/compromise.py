"""Several applications at once: the settings that serve them all, and what each gives up for it."""

from __future__ import annotations

import math
from collections.abc import Sequence

from seqrsm.analysis.compromise import CompromiseEstimate, GivenUp
from seqrsm.design.factors import CategoricalFactor, Factor
from seqrsm.report.blocks import Block, Details, Entry, Head, Paragraph, Section, Table, right, table
from seqrsm.report.rounding import NOTHING, decimals_for, decimals_of_significant, format_number, format_range
from seqrsm.report.wording import (
    axis_label,
    format_setting,
    level_text,
    listing,
    number_cell,
    readable,
    with_unit,
)

MAX_FRONT_ROWS = 20


def compromise_section(factors: Sequence[Factor], found: CompromiseEstimate) -> Section:
    """Return the compromise over the campaign's factors."""
    blocks: list[Block] = [
        _settings_sentence(factors, found),
        Paragraph(
            f"Overall desirability {format_number(found.desirability, 3)}: the weighted geometric mean of the "
            "desirabilities below, each 0 where a score is no longer acceptable and 1 where it is as good as can be. "
            "Acting on these settings is expected to lose "
            f"{format_number(found.expected_shortfall, 3)} of it against the unknown best compromise."
        ),
        _setting_table(factors, found),
        _loss_table(found),
    ]
    if found.front_settings:
        blocks.append(Details("Settings that no other beats in everything", (_front_table(factors, found),)))
    return Section("compromise", "Compromise between the applications", tuple(blocks))


def compromise_summary(factors: Sequence[Factor], found: CompromiseEstimate) -> tuple[Block, ...]:
    """Return what a summary says of several applications: the settings that serve them all, and their price."""
    return _settings_sentence(factors, found), _loss_table(found)


def _settings_sentence(factors: Sequence[Factor], found: CompromiseEstimate) -> Paragraph:
    settings = listing(
        [f"{readable(f.name)} {format_setting(f, found.settings[f.name], _spread(found, f.name))}" for f in factors]
    )
    return Paragraph(f"The settings that serve all best: {settings}.", "lead")


def _spread(found: CompromiseEstimate, name: str) -> float:
    interval = found.credible.get(name)
    return math.nan if interval is None else interval.half_width


def _setting_table(factors: Sequence[Factor], found: CompromiseEstimate) -> Table:
    rows = []
    for factor in factors:
        interval, spread = found.credible.get(factor.name), _spread(found, factor.name)
        ends = NOTHING
        if interval is not None and not isinstance(factor, CategoricalFactor):
            parts = (format_setting(factor, end, spread, unit=False) for end in (interval.low, interval.high))
            ends = " to ".join(parts)
        rows.append((axis_label(factor), format_setting(factor, found.settings[factor.name], spread, unit=False), ends))
    columns = ("Factor", right("Setting"), f"Credible interval {level_text(found.level)}")
    return table("Settings of the compromise", columns, rows)


def _loss_table(found: CompromiseEstimate) -> Table:
    rows: list[tuple[Entry, ...]] = []
    for item in found.given_up:
        places = _places(item)
        known = math.isfinite(item.interval.low) and math.isfinite(item.interval.high)
        scores = (item.value, item.own_best, item.given_up)
        rows.append(
            (
                item.name,
                *(with_unit(format_number(score, places), item.unit) for score in scores),
                format_range(item.interval.low, item.interval.high, places) if known else "exact",
                number_cell(format_number(item.desirability, 2), item.desirability),
            )
        )
    titles = ("At the compromise", "At its own optimum", "Given up", f"Credible {level_text(found.level)}")
    columns: tuple[Head, ...] = ("Application or consideration", *map(right, titles), right("Desirability"))
    return table("What each gives up", columns, rows)


def _places(item: GivenUp) -> int:
    half = item.interval.half_width
    return decimals_for(half / 2.0, decimals_of_significant(item.own_best, 3))


def _front_table(factors: Sequence[Factor], found: CompromiseEstimate) -> Table:
    count = len(found.front_settings)
    chosen = range(0, count, max(1, -(-count // MAX_FRONT_ROWS)))
    rows: list[tuple[Entry, ...]] = [
        (
            *(format_setting(f, found.front_settings[i][f.name], unit=False) for f in factors),
            *(
                number_cell(format_number(value, _places(item)), value)
                for item, value in zip(found.given_up, found.front_values[i].tolist(), strict=True)
            ),
        )
        for i in chosen
    ]
    columns: tuple[Head, ...] = (*map(axis_label, factors), *(right(item.name, item.unit) for item in found.given_up))
    caption = "Settings that no other beats in everything (Pareto front)"
    if len(chosen) < count:
        caption += f"; {len(chosen)} of {count}"
    return table(caption, columns, rows, sortable=True)
