"""Several applications at once: the settings that serve them all, and what each gives up for it."""

from __future__ import annotations

import itertools
import math
from functools import partial
from typing import TYPE_CHECKING, Any

from seqrsm.analysis.compromise import CompromiseEstimate, GivenUp
from seqrsm.design.factors import CategoricalFactor
from seqrsm.design.region import Region
from seqrsm.plain import heading
from seqrsm.report.blocks import (
    Block,
    Details,
    Entry,
    FigureBlock,
    Head,
    PanelData,
    Paragraph,
    Section,
    Table,
    right,
    table,
)
from seqrsm.report.figures import drawing
from seqrsm.report.rounding import NOTHING, decimals_for, decimals_of_significant, format_number, format_range
from seqrsm.report.wording import (
    axis_label,
    factor_column,
    format_setting,
    level_text,
    listing,
    number_cell,
    setting_phrases,
    shares_text,
    shortened,
    told_settings,
    with_unit,
)

if TYPE_CHECKING:
    from matplotlib.axes import Axes

MAX_FRONT_ROWS = 10
MAX_FRONT_PANELS = 3


def compromise_section(region: Region, found: CompromiseEstimate) -> Section:
    """Return the details of the compromise: its settings, and the Pareto front."""
    short = found.expected_shortfall  # an average over draws: none of them is no certainty
    lost = "less than 0.001" if short < 0.001 else format_number(short, 3)
    blocks: list[Block] = [
        Paragraph(
            f"Overall desirability {format_number(found.desirability, 3)}: the weighted geometric mean of the "
            "individual desirabilities in the summary, from 0 (unacceptable) to 1 (ideal). Its expected shortfall from "
            f"the unknown best compromise is {lost}."
        ),
        _setting_table(region, found),
    ]
    if found.front_settings:
        blocks.append(Details("Pareto front", (_front_table(region, found),)))
    return Section("compromise", "Details of the compromise", tuple(blocks))


def compromise_summary(region: Region, found: CompromiseEstimate) -> tuple[Block, ...]:
    """Return what a summary says of several applications: the settings that serve them all, and their price."""
    drawn = (_front_figure(found),) if len(found.front_settings) > 1 and len(found.given_up) > 1 else ()
    told = told_settings(region, found.settings, _spreads(found))
    settings = listing(setting_phrases(region, told))
    lead, missed = f"Recommended compromise: {settings}.", [g.name for g in found.given_up if g.desirability == 0.0]
    if missed:
        lead += f" It is unacceptable for {listing(missed)}: no setting was found that is acceptable for all."
    warnings = (Paragraph(text, "warning") for text in found.warnings)
    return (Paragraph(lead, "lead"), *warnings, *drawn, *_score_table(found), _loss_table(found))


def _front_figure(found: CompromiseEstimate) -> FigureBlock:
    """Each pair of objectives: the Pareto front and the compromise on it."""
    panels = []
    for i, j in list(itertools.combinations(range(len(found.given_up)), 2))[:MAX_FRONT_PANELS]:
        x, y = found.given_up[i], found.given_up[j]
        title = f"{y.name} against {x.name}"
        alt = (
            f"Pareto front of {len(found.front_settings)} settings, {title}; the compromise has "
            f"{with_unit(format_number(x.value, _places(x)), x.unit)} and "
            f"{with_unit(format_number(y.value, _places(y)), y.unit)}."
        )
        rows = tuple(tuple(row) for row in found.front_values[:, [i, j]].tolist())
        data = partial(PanelData, (heading(x.name, x.unit), heading(y.name, y.unit)), rows)
        panels.append(drawing.panel(title, alt, partial(_paint_front, found, i, j), f"pareto {title}", data))
    caption = "Pareto front: settings that no other setting improves on in every objective. Star: the compromise."
    return FigureBlock(lambda: tuple(panels), caption, columns=3 if len(panels) > 2 else 2)


def _paint_front(found: CompromiseEstimate, i: int, j: int, axes: Axes) -> None:
    x, y = found.given_up[i], found.given_up[j]
    axes.scatter(found.front_values[:, i], found.front_values[:, j], s=16, color=drawing.BLUE, linewidths=0)
    star: dict[str, Any] = {"s": 130, "marker": "*", "facecolor": drawing.ORANGE, "edgecolor": drawing.INK, "zorder": 5}
    axes.scatter([x.value], [y.value], **star)
    axes.set_xlabel(shortened(heading(x.name, x.unit), 40))
    axes.set_ylabel(shortened(heading(y.name, y.unit), 28))
    # Points closer than their errors (exact ones: than a hundredth) are not drawn apart.
    for item, limits, limit in ((x, axes.get_xlim(), axes.set_xlim), (y, axes.get_ylim(), axes.set_ylim)):
        half, middle = item.interval.half_width, 0.5 * sum(limits)
        least = half if math.isfinite(half) else 0.01 * abs(item.value)
        if limits[1] - limits[0] < 2.0 * least:
            limit(middle - least, middle + least)
    axes.grid(visible=True, zorder=0)


def _spreads(found: CompromiseEstimate) -> dict[str, float]:
    return {name: interval.half_width for name, interval in found.credible.items()}


def _setting_table(region: Region, found: CompromiseEstimate) -> Table:
    rows, spreads = [], _spreads(found)
    told = told_settings(region, found.settings, spreads)
    for factor in region.factors:
        interval, ends = found.credible.get(factor.name), NOTHING
        if interval is not None and not isinstance(factor, CategoricalFactor) and told[factor.name] != NOTHING:
            spread = spreads[factor.name]
            parts = (format_setting(factor, end, spread, unit=False) for end in (interval.low, interval.high))
            ends = " to ".join(parts)
        elif factor.name in found.levels:
            ends = shares_text(found.levels[factor.name])
        rows.append((axis_label(factor), told[factor.name], ends))
    columns = ("Factor", right("Setting"), f"{level_text(found.level)} credible interval")
    return table("Settings of the compromise", columns, rows)


def _score_table(found: CompromiseEstimate) -> tuple[Table, ...]:
    """What each application is expected to score; none where nothing is known of errors."""
    rows: list[tuple[Entry, ...]] = []
    for item in found.given_up:
        ends = [one for one in (item.confidence, item.prediction) if one is not None and math.isfinite(one.half_width)]
        if len(ends) == 2:
            places = decimals_for(ends[0].half_width / 2.0, decimals_of_significant(item.own_best, 3))
            mean = with_unit(format_number(item.value, places), item.unit)
            rows.append(
                (item.name, mean, *(with_unit(format_range(one.low, one.high, places), item.unit) for one in ends))
            )
    level = level_text(found.level)
    titles = ("Mean score", f"{level} confidence interval", f"One future run, {level} prediction interval")
    caption = "Scores to expect at the compromise, not corrected for selection bias"
    return (table(caption, ("Application", *map(right, titles)), rows),) if rows else ()


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
                with_unit(format_range(item.interval.low, item.interval.high, places), item.unit) if known else "exact",
                number_cell(format_number(item.desirability, 2), item.desirability),
            )
        )
    titles = ("At compromise", "At own optimum", "Given up", f"{level_text(found.level)} credible interval")
    columns: tuple[Head, ...] = ("Objective", *map(right, titles), right("Desirability"))
    caption = (
        "Cost of the compromise to each objective, by fitted scores not corrected for selection bias; the interval is "
        "of the loss against its true optimum, wherever that lies, and so may be above the loss of the fitted scores"
    )
    return table(caption, columns, rows)


def _places(item: GivenUp) -> int:
    half = item.interval.half_width
    return decimals_for(half / 2.0, decimals_of_significant(item.own_best, 3))


def _front_table(region: Region, found: CompromiseEstimate) -> Table:
    count = len(found.front_settings)
    chosen = range(0, count, max(1, -(-count // MAX_FRONT_ROWS)))
    rows: list[tuple[Entry, ...]] = [
        (
            *told_settings(region, found.front_settings[i], {}).values(),
            *(
                number_cell(format_number(value, _places(item)), value)
                for item, value in zip(found.given_up, found.front_values[i].tolist(), strict=True)
            ),
        )
        for i in chosen
    ]
    columns: tuple[Head, ...] = (
        *map(factor_column, region.factors),
        *(right(item.name, item.unit) for item in found.given_up),
    )
    caption = "Settings on the Pareto front"
    if len(chosen) < count:
        caption += f", {len(chosen)} of {count}"
    return table(caption, columns, rows, sortable=True)
