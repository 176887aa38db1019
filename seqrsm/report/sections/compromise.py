"""Several applications at once: the settings that serve them all, and what each gives up for it."""

from __future__ import annotations

import math

from seqrsm.analysis.compromise import CompromiseEstimate, GivenUp
from seqrsm.campaign.dossier import Dossier
from seqrsm.design.factors import CategoricalFactor
from seqrsm.report.blocks import Block, Cell, Column, Details, Paragraph, Section, Table
from seqrsm.report.rounding import NOTHING, decimals_for, decimals_of_significant, format_number, format_range
from seqrsm.report.wording import axis_label, format_setting, level_text, listing, number_cell, readable, with_unit

MAX_FRONT_ROWS = 20


def compromise_section(dossier: Dossier) -> Section | None:
    """Return the compromise; None where there is nothing to weigh."""
    found = dossier.compromise
    if found is None:
        return None
    blocks: list[Block] = [
        _settings_sentence(dossier, found),
        Paragraph(
            f"Overall desirability {format_number(found.desirability, 3)}: the weighted geometric mean of the "
            "desirabilities below, each 0 where a score is no longer acceptable and 1 where it is as good as can be. "
            "Acting on these settings is expected to lose "
            f"{format_number(found.expected_shortfall, 3)} of it against the unknown best compromise."
        ),
        _setting_table(dossier, found),
        _loss_table(found),
    ]
    if found.front_settings:
        blocks.append(Details("Settings that no other beats in everything", (_front_table(dossier, found),)))
    return Section("compromise", "Compromise between the applications", tuple(blocks))


def compromise_summary(dossier: Dossier) -> tuple[Block, ...]:
    """Return what a summary says of several applications: the settings that serve them all, and their price."""
    found = dossier.compromise
    return () if found is None else (_settings_sentence(dossier, found), _loss_table(found))


def _settings_sentence(dossier: Dossier, found: CompromiseEstimate) -> Paragraph:
    factors = dossier.spec.factors
    settings = listing(
        [f"{readable(f.name)} {format_setting(f, found.settings[f.name], _spread(found, f.name))}" for f in factors]
    )
    return Paragraph(f"The settings that serve all best: {settings}.", "lead")


def _spread(found: CompromiseEstimate, name: str) -> float:
    interval = found.credible.get(name)
    return math.nan if interval is None else interval.half_width


def _setting_table(dossier: Dossier, found: CompromiseEstimate) -> Table:
    rows = []
    for factor in dossier.spec.factors:
        interval, spread = found.credible.get(factor.name), _spread(found, factor.name)
        ends = NOTHING
        if interval is not None and not isinstance(factor, CategoricalFactor):
            parts = (format_setting(factor, end, spread, unit=False) for end in (interval.low, interval.high))
            ends = " to ".join(parts)
        value = format_setting(factor, found.settings[factor.name], spread, unit=False)
        rows.append((Cell(axis_label(factor)), Cell(value), Cell(ends)))
    level = level_text(found.level)
    columns = (Column("Factor"), Column("Setting", align="right"), Column(f"Credible interval {level}"))
    return Table(columns, tuple(rows), "Settings of the compromise")


def _loss_table(found: CompromiseEstimate) -> Table:
    rows = []
    for item in found.given_up:
        places = _places(item)
        known = math.isfinite(item.interval.low) and math.isfinite(item.interval.high)
        rows.append(
            (
                Cell(item.name),
                Cell(with_unit(format_number(item.value, places), item.unit)),
                Cell(with_unit(format_number(item.own_best, places), item.unit)),
                Cell(with_unit(format_number(item.given_up, places), item.unit)),
                Cell(format_range(item.interval.low, item.interval.high, places) if known else "exact"),
                number_cell(format_number(item.desirability, 2), item.desirability),
            )
        )
    columns = (
        Column("Application or consideration"),
        Column("At the compromise", align="right"),
        Column("At its own optimum", align="right"),
        Column("Given up", align="right"),
        Column(f"Credible {level_text(found.level)}", align="right"),
        Column("Desirability", align="right"),
    )
    return Table(columns, tuple(rows), "What each gives up")


def _places(item: GivenUp) -> int:
    half = item.interval.half_width
    return decimals_for(half / 2.0, decimals_of_significant(item.own_best, 3))


def _front_table(dossier: Dossier, found: CompromiseEstimate) -> Table:
    factors = dossier.spec.factors
    count = len(found.front_settings)
    chosen = range(0, count, max(1, -(-count // MAX_FRONT_ROWS)))
    rows = []
    for i in chosen:
        cells = [Cell(format_setting(f, found.front_settings[i][f.name], unit=False)) for f in factors]
        for item, value in zip(found.given_up, found.front_values[i].tolist(), strict=True):
            cells.append(number_cell(format_number(value, _places(item)), value))
        rows.append(tuple(cells))
    columns = tuple(Column(axis_label(f)) for f in factors)
    columns += tuple(Column(item.name, item.unit, "right") for item in found.given_up)
    caption = "Settings that no other beats in everything (Pareto front)"
    if len(rows) < count:
        caption += f"; {len(rows)} of {count}"
    return Table(columns, tuple(rows), caption, sortable=True)
