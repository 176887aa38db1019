"""What to measure: which means of the tables carry the interval, and what a flight would bring instead."""

from __future__ import annotations

import math
from collections.abc import Sequence

from seqrsm.analysis.ground import RANKED, ranked_values
from seqrsm.analysis.results import Analysis
from seqrsm.report.blocks import Paragraph, Section, right, table
from seqrsm.report.rounding import (
    decimals_of_significant,
    format_change,
    format_number,
    format_percent,
    format_significant,
)
from seqrsm.report.wording import half_width_text, score_decimals
from seqrsm.store.records import EventRecord

_SHOWN, _LEAST = 10, 0.005


def measure_section(analysis: Analysis, events: Sequence[EventRecord], key: str) -> Section | None:
    """Return the ranking of covers by their share of what is not known of the ground; None where it was not made.

    Of the events those of the kind `seqrsm.analysis.ground.RANKED` tell it.
    """
    found = [e.detail for e in events if e.kind == RANKED and e.detail.get("application") == analysis.application]
    best = analysis.optimum
    if not found or best.ground is None or not best.of_ground > 0.0:
        return None
    title = "Which covers to measure"
    of_ground, chance = best.ground.sd_ground**2, best.ground.sd_chance**2
    values = ranked_values(found[-1]["values"], of_ground)
    total = best.whole.half_width

    def with_less(share: float) -> float:
        """Half-width where a share of the ground's variance is gone."""
        return math.sqrt(max(total**2 - share * best.of_ground**2, 0.0))

    head = (
        f"The stop-rule half-width is {half_width_text(analysis, total)}; one flight over the site would leave "
        f"{half_width_text(analysis, with_less(of_ground / (of_ground + chance)))}."
    )
    left = round(100.0 * (1.0 - sum(value["share"] for value in values)))
    if left > 0:
        head += f" {left} % of the table uncertainty is not due to the level of one cover, but to single channels, to"
        head += " fields, to several covers together and, with several dates, to the season."
    values = [value for value in values if value["share"] >= _LEAST]
    least = format_percent(_LEAST)
    if not values:
        return Section(key, title, (Paragraph(f"{head} No cover alone has a share of {least}."),))
    largest = max(max(abs(value["up"]), abs(value["down"])) for value in values)
    unit, places = found[-1]["unit"], max(score_decimals(analysis), decimals_of_significant(largest, 2), 0)
    shown = values[:_SHOWN]
    halved = [with_less(0.75 * value["share"]) for value in shown]
    decimals = max(decimals_of_significant(width, 2) for width in halved)
    rows = tuple(
        (
            value["category"],
            f"\u00b1 {format_significant(value['mean_sd'], 2)}{f' {unit}' if unit else ''}",
            f"{format_change(value['up'], places)} / {format_change(value['down'], places)}",
            f"{100.0 * value['share']:.0f} %",
            format_number(width, decimals),
        )
        for value, width in zip(shown, halved, strict=True)
    )
    columns = (
        "Cover",
        right("Mean backscatter, s.d." if unit else "Mean emissivity, s.d."),
        right("Score change, +1 / \u22121 s.d.", analysis.score_unit),
        right("Share"),
        right("Half-width if halved", analysis.score_unit),
    )
    how = (
        " For each cover: the change of the score at the recommended settings when its tabulated mean is one standard "
        "deviation higher or lower, its share of the table uncertainty, and the half-width that would be left if that "
        "standard deviation were halved."
    )
    caption = f"Covers by their share of the table uncertainty, {least} or more"
    if len(values) > _SHOWN:
        caption += f", the {_SHOWN} of {len(values)} with the largest"
    return Section(key, title, (Paragraph(head, method=how), table(caption, columns, rows)))
