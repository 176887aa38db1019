"""What to measure: which means of the tables to know better, and what a flight would bring instead."""

from __future__ import annotations

from collections.abc import Sequence

from seqrsm.analysis.ground import N_WORLDS, RANKED
from seqrsm.analysis.results import Analysis, OptimumEstimate
from seqrsm.report.blocks import Paragraph, Section, right, table
from seqrsm.report.rounding import decimals_of_significant, format_number, format_plain, format_significant
from seqrsm.report.wording import half_width_text, listing, with_unit
from seqrsm.spec.tables import CostSpec
from seqrsm.store.records import EventRecord


def width_after_flight(best: OptimumEstimate) -> float:
    """Stop-rule half-width where one flight over the site has shown its ground, as far as one occasion can."""
    assert best.ground is not None
    of_ground, chance = best.ground.sd_ground**2, best.ground.sd_chance**2
    return best.width_left(chance / (of_ground + chance))


_OF_HALF = 0.25  # of a cover's part of the variance: it goes as the square of the standard deviation of its mean


def measure_section(analysis: Analysis, events: Sequence[EventRecord], cost: CostSpec, key: str) -> Section | None:
    """Return what would be left of the half-width if covers were better known; None where it was not simulated.

    Of the events those of the kind `seqrsm.analysis.ground.RANKED` tell it.
    """
    found = [e.detail for e in events if e.kind == RANKED and e.detail.get("application") == analysis.application]
    found = [detail for detail in found if "known" in detail]
    best = analysis.optimum
    if not found or best.ground is None or not best.of_ground > 0.0:
        return None
    title = "Which covers to measure"
    price = f" ({with_unit(format_plain(cost.flight), cost.told_unit)})" if cost.told_unit else ""
    head = (
        f"The stop-rule half-width is {half_width_text(analysis, best.whole.half_width)}; one flight over the site"
        f"{price} would leave {half_width_text(analysis, width_after_flight(best))}."
    )
    known, unit = found[-1]["known"], found[-1]["unit"]
    if not known:
        return Section(key, title, (Paragraph(head),))
    widths, helping = ([tell(one["left"]) for one in known] for tell in (best.width_left, best.helped))
    if not any(helping):
        least = f" Exact knowledge of covers would leave {half_width_text(analysis, min(widths))} at best."
        return Section(key, title, (Paragraph(head + least),))
    single = [k for k, one in enumerate(known) if len(one["covers"]) == 1]
    some = [k for k in single if helping[k]]
    if 0 < len(some) < len(single):  # all together help by these
        known, widths = ([row[k] for k in some] for row in (known, widths))
    halved = [best.width_left(_OF_HALF + (1.0 - _OF_HALF) * one["left"]) for one in known]
    errors = [0.5 * one["se"] * best.of_ground**2 / own for one, own in zip(known, widths, strict=True)]
    decimals = max(decimals_of_significant(own, 2) for own in widths)
    sds = [f"\u00b1 {format_significant(one['mean_sd'], 2)}{f' {unit}' if unit else ''}" for one in known]
    rows = tuple(
        (
            listing(one["covers"]),
            sd if len(one["covers"]) == 1 else "",
            format_number(half, decimals),
            format_number(own, decimals),
            format_number(error, decimals),
        )
        for one, sd, half, own, error in zip(known, sds, halved, widths, errors, strict=True)
    )
    columns = (
        "Covers",
        right("Mean backscatter, s.d." if unit else "Mean emissivity, s.d."),
        right("S.d. halved", analysis.score_unit),
        right("Known exactly", analysis.score_unit),
        right("Standard error", analysis.score_unit),
    )
    how = (
        f" The covers are those that move the score most. From {N_WORLDS} draws of the tables, with and without "
        "these covers drawn anew (total effect): knowing a cover helps less than told where the score depends on its "
        "contrast with others that stay unknown. The standard error is that of the column before it."
    )
    caption = "Half-width at best if covers were better known"
    return Section(key, title, (Paragraph(head, method=how), table(caption, columns, rows)))
