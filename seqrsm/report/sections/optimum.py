"""The optimum: its intervals, the response surfaces around it, and where its settings may lie."""

from __future__ import annotations

import math
from collections.abc import Sequence
from functools import partial

import numpy as np

from seqrsm.analysis.ground import LEVEL_WORLDS
from seqrsm.analysis.results import Analysis
from seqrsm.analysis.scale import Interval
from seqrsm.design.factors import ContinuousFactor, DiscreteFactor, setting_with_unit
from seqrsm.remember import recalled
from seqrsm.report.blocks import Block, FigureBlock, Panel, PanelData, Paragraph, Section, right, table
from seqrsm.report.figures import drawing
from seqrsm.report.figures.optimum import (
    contour_data,
    levels_data,
    optimum_draws_data,
    paint_contours,
    paint_intervals,
    paint_lines,
    paint_optimum_posterior,
    paint_slice,
    score_column,
    slice_data,
    target_is_near,
)
from seqrsm.report.figures.surfaces import (
    MAX_PAIRS,
    Line,
    Surface,
    chosen_pairs,
    line,
    lines_by_level,
    ranked_factors,
    surface,
)
from seqrsm.report.rounding import NOTHING, format_share
from seqrsm.report.wording import (
    CUT,
    decimal_cell,
    effects_text,
    format_setting,
    half_width_text,
    interval_text,
    level_phrase,
    listing,
    no_intervals,
    optimum_setting_text,
    readable,
    score_decimals,
    score_text,
    setting_range_text,
    watched_interval,
)
from seqrsm.spec.tables import StopSpec

_WATCHED = {"prediction": "One future run", "prediction_mean": "Mean of future runs"}


def intervals_at(analysis: Analysis, stop: StopSpec) -> list[tuple[str, Interval]]:
    """Name and ends of each interval at the recommended settings, as the table and its picture show them."""
    optimum = analysis.optimum
    found = [
        ("Mean score", optimum.confidence),
        ("One future run", optimum.prediction),
        (f"Mean of {optimum.replicates} future runs", optimum.prediction_mean),
    ]
    if optimum.ground is not None and stop.interval == "confidence":  # whose sampling error is all that it has
        found.append(("Mean score over one ground", optimum.whole))
    elif optimum.ground is not None:
        found.append((f"{_WATCHED[stop.interval]}, sampling error only", optimum.by_chance))
    return found


def first_panels(analysis: Analysis, stop: StopSpec) -> FigureBlock:
    """Return the picture of the first page: the surface over the two most important factors, and the intervals."""
    pairs = chosen_pairs(analysis)
    found = intervals_at(analysis, stop)
    told = "; ".join(f"{name} {interval_text(analysis, one)}" for name, one in found)
    columns = ("interval", score_column(analysis, "low"), score_column(analysis, "high"))
    intervals = drawing.panel(
        "Intervals at the recommended settings",
        f"Intervals at the recommended settings: {told}.",
        partial(paint_intervals, analysis, found, stop),
        "intervals",
        lambda: PanelData(columns, tuple((name, one.low, one.high) for name, one in found)),
        height_in=2.0,
    )
    if pairs:
        first = _contours(analysis, slice(1))
    else:
        first = _slices(analysis, [analysis.region.names.index(ranked_factors(analysis)[0])])
    beside = f"Right: {level_phrase(analysis)} intervals of the mean score and of future runs"
    if target_is_near(found, stop):
        beside += "; dashed: the target half-width"
    return FigureBlock(lambda: (*first.panels, intervals), f"{first.caption} {beside}.")


def optimum_section(analysis: Analysis, key: str, stop: StopSpec) -> Section:
    """Return the intervals at the optimum, the surface around it, and where its settings may lie."""
    found = intervals_at(analysis, stop)
    rows = ((name, interval_text(analysis, one), half_width_text(analysis, one.half_width)) for name, one in found)
    cut = next((f"; half-width: {CUT}" for _, one in found if math.isfinite(one.cut_from)), "")
    columns = ("Interval", right("Low to high"), right("Half-width"))
    blocks: list[Block] = []
    floor = analysis.decision.noise_floor
    if math.isfinite(floor) and floor > 0.0:
        counted = analysis.fitted.ground_share > 0.0 and stop.worlds == "count"
        cause = "Table uncertainty and run-to-run scatter give" if counted else "Run-to-run scatter alone gives"
        if analysis.fitted.common_sd and stop.interval != "confidence":
            cause = "Scatter of runs and of blocks gives"
        text = f"{cause} the {watched_interval(stop, counted)} a half-width of"
        blocks.append(Paragraph(f"{text} {half_width_text(analysis, floor)}, a floor that more runs cannot lower."))
    blocks.append(table(f"{level_phrase(analysis)} intervals at the recommended settings{cut}", columns, rows))
    blocks += _gap(analysis)
    blocks += _steps(analysis)
    blocks += _surfaces(analysis, slice(1, None))  # the first opens the report
    if effects := effects_text(analysis):
        blocks.append(Paragraph(effects))
    blocks.append(_posterior_figure(analysis))
    return Section(f"{key}-optimum", "Optimum and intervals", tuple(blocks))


def _gap(analysis: Analysis) -> list[Block]:
    """What no interval tells: a peak that no run came near."""
    if analysis.gap is None:
        return []
    factors = {factor.name: factor for factor in analysis.region.factors}
    ranges = []
    for name, (low, high) in analysis.gap.ranges.items():
        first, last = format_setting(factors[name], low, unit=False), format_setting(factors[name], high)
        ranges.append(f"{readable(name)} {f'{first} to ' * (low < high)}{last}")
    text = (
        "Intervals take the score to change smoothly between runs. The largest box without a run spans "
        f"{format_share(analysis.gap.share)} of each continuous factor's coded range: {listing(ranges)}. A peak within "
        "it would be unseen."
    )
    return [Paragraph(text)]


def _steps(analysis: Analysis) -> list[Block]:
    """What each value or level of a factor gains, the others as recommended."""
    if not analysis.steps:
        return []
    factors = {factor.name: factor for factor in analysis.region.factors}
    places = score_decimals(analysis)
    on_ground = any(math.isfinite(step.better_here) for step in analysis.steps)
    rows = [
        (
            readable(step.factor),
            f"{setting_with_unit(factors[step.factor], step.level)} instead of "
            f"{setting_with_unit(factors[step.factor], step.over)}",
            decimal_cell(step.mean, places),
            decimal_cell(step.gain, places),
            interval_text(analysis, step.interval),
            format_share(step.better),
            *((format_share(step.better_here), loss) if on_ground else ()),
        )
        for step in analysis.steps
        for loss in (decimal_cell(step.loss_here, places).text or NOTHING,)
    ]
    unit, word = analysis.score_unit, "Gain" if analysis.goal == "maximize" else "Difference"
    columns = (
        *("Factor", "Change", right("Mean", unit), right(word, unit)),
        *(right(f"{level_phrase(analysis)} interval"), right("Pr(better)")),
        *((right("Pr(better here)"), right("Loss if kept", unit)) if on_ground else ()),
    )
    caption = "Effect of changing one factor, the others as recommended; the interval of the "
    caption += f"{word.lower()} allows for selection bias"
    if on_ground:
        caption += (
            ". Pr(better): on average over the grounds that the tables allow; Pr(better here): on the actual ground, "
            f"which is one of them ({LEVEL_WORLDS} paired simulations); loss if kept: what the recommended level is "
            "expected to lose there"
        )
    return [table(caption, columns, rows)]


def surface_section(analysis: Analysis, key: str) -> Section:
    """Return contours of all pairs of numeric factors and slices, for a reader who wants the surface alone."""
    return Section(key, "Response surfaces", tuple(_surfaces(analysis, slice(None))))


def _surfaces(analysis: Analysis, which: slice) -> list[Block]:
    """Contours of some of the pairs of `chosen_pairs`, and slices."""
    blocks: list[Block] = [_contours(analysis, which)] if chosen_pairs(analysis)[which] else []
    return [*blocks, _slices(analysis, range(analysis.region.k)), *_by_level(analysis)]


def _contour_panels(analysis: Analysis, which: slice) -> tuple[Panel, ...]:
    pairs = chosen_pairs(analysis)
    every = recalled(lambda: [surface(analysis, x, y) for x, y in pairs], (analysis, pairs))  # the first page shows one
    limits = _limits(every)
    return tuple(
        drawing.panel(
            f"{_name(analysis, s.y_index)} against {_name(analysis, s.x_index)}",
            _contour_alt(analysis, s),
            partial(paint_contours, analysis, s, limits),
            f"surface {_name(analysis, s.y_index)} against {_name(analysis, s.x_index)}",
            partial(contour_data, analysis, s),
            height_in=2.0,
        )
        for s in every[which]
    )


def _contours(analysis: Analysis, which: slice) -> FigureBlock:
    all_pairs = math.comb(len(analysis.region.numeric), 2)
    unit = f" in {analysis.score_unit}" if analysis.score_unit else ""
    caption = (
        f"Fitted mean score{unit} over pairs of factors, the others as recommended; the colour scale is common to all "
        "pairs. White circles: runs, at any setting of the other factors; orange dots: posterior draws of the optimum; "
        "star: recommended settings."
    )
    if not analysis.region.is_box:
        caption += " Hatched: excluded by the constraints."
    if len(chosen_pairs(analysis)) < all_pairs:
        caption += f" {MAX_PAIRS} of {all_pairs} pairs are drawn, those of the most important factors."
    return FigureBlock(lambda: _contour_panels(analysis, which), caption, columns=3)


def _limits(surfaces: Sequence[Surface]) -> tuple[float, float]:
    """Ends of the common colour scale: the range of the allowed settings, a little widened where it is flat."""
    values = np.concatenate([s.mean[s.slack >= 0.0].ravel() for s in surfaces])
    if values.size == 0:
        return 0.0, 1.0
    low, high = float(values.min()), float(values.max())
    margin = max(1e-9, 1e-6 * abs(low)) if high - low <= 1e-9 * max(abs(low), abs(high)) else 0.0
    return low - margin, high + margin


def _contour_alt(analysis: Analysis, s: Surface) -> str:
    names = f"{_name(analysis, s.x_index)} (across) and {_name(analysis, s.y_index)} (up)"
    allowed = np.where(s.slack >= 0.0, s.mean, np.nan)
    if not np.any(np.isfinite(allowed)):
        return f"Contours over {names}: not determined by these runs."
    low, high = (score_text(analysis, float(f(allowed))) for f in (np.nanmin, np.nanmax))
    best = _best(analysis, s.x_index, s.y_index)
    return f"Contours of the fitted mean score over {names}, from {low} to {high}; the optimum is at {best}."


def _best(analysis: Analysis, *indices: int) -> str:
    """Recommended settings of factors, such of a member that the recommended set has not left out."""
    told = (optimum_setting_text(analysis, analysis.region.factors[i]) for i in indices)
    return listing([text for text in told if text != NOTHING]) or "a set without it"


def _name(analysis: Analysis, index: int) -> str:
    return readable(analysis.region.names[index])


def _slice_panels(analysis: Analysis, indices: Sequence[int]) -> tuple[Panel, ...]:
    lines = [line(analysis, index) for index in indices]
    shown = [v[one.allowed] for one in lines for v in (one.mean, one.prediction.low, one.prediction.high)]
    scores = np.concatenate([*shown, *(one.run_score for one in lines)])
    scores = scores[np.isfinite(scores)]
    ends = float(scores.min()), float(scores.max())
    return tuple(_slice_panel(analysis, one, ends) for one in lines)


def _slice_panel(analysis: Analysis, here: Line, ends_of_all: tuple[float, float]) -> Panel:
    factor = analysis.region.factors[here.index]
    ends = [v for v in here.mean[here.allowed] if np.isfinite(v)]
    spread = f" from {score_text(analysis, min(ends))} to {score_text(analysis, max(ends))}" if ends else ""
    best = _best(analysis, here.index)
    alt = f"Fitted mean score along {readable(factor.name)} through the optimum{spread}; best at {best}."
    paint, data = partial(paint_slice, analysis, here, ends_of_all), partial(slice_data, analysis, here)
    return drawing.panel(readable(factor.name), alt, paint, f"slice {factor.name}", data)


def _slices(analysis: Analysis, indices: Sequence[int]) -> FigureBlock:
    level = level_phrase(analysis)
    caption = (
        f"Slices through the optimum (dashed line). Line or diamonds: fitted mean; dark band: {level} confidence "
        "interval; light band: prediction interval of one run; grey dots: runs, moved along the fitted surface to the "
        "recommended setting of the other factors."
    )
    missing = no_intervals(analysis)
    if missing:
        caption += f" No bands: {missing}."
    if not analysis.region.is_box:
        caption += " Settings excluded by the constraints are left out"
        of_levels = [i for i in indices if not isinstance(analysis.region.factors[i], ContinuousFactor)]
        excluded = any(not line(analysis, i).allowed.all() for i in of_levels)
        caption += "; hollow diamonds: excluded levels." if excluded else "."
    return FigureBlock(lambda: _slice_panels(analysis, indices), caption, columns=3)


def _level_panel(analysis: Analysis, i: int, j: int) -> Panel:
    factors, lines = analysis.region.factors, lines_by_level(analysis, i, j)
    title = f"{readable(factors[i].name)} by {readable(factors[j].name)}"
    best = max(lines, key=lambda one: float(np.max(one.mean)))
    alt = f"Fitted mean score against {title}, up to {score_text(analysis, float(np.max(best.mean)))}."
    paint, data = partial(paint_lines, analysis, j, lines), partial(levels_data, analysis, j, lines)
    return drawing.panel(title, alt, paint, title, data)


def _by_level(analysis: Analysis) -> list[Block]:
    """The mean against each number that has but some values, a line for each level of each factor of levels."""
    factors = analysis.region.factors
    pairs = [
        (i, j)
        for i in analysis.region.numeric
        if isinstance(factors[i], DiscreteFactor)
        for j in analysis.region.categorical
    ]
    if not pairs:
        return []
    caption = (
        f"Fitted mean score with {level_phrase(analysis)} confidence intervals, the other factors as recommended; "
        "points at one value are drawn side by side."
    )
    return [FigureBlock(lambda: tuple(_level_panel(analysis, *pair) for pair in pairs[:MAX_PAIRS]), caption)]


def _posterior_figure(analysis: Analysis) -> FigureBlock:
    panels = []
    for index, factor in enumerate(analysis.region.factors):
        alt = f"Posterior of the optimal {readable(factor.name)}: {setting_range_text(analysis, factor)}."
        paint, data = partial(paint_optimum_posterior, analysis, index), partial(optimum_draws_data, analysis, index)
        name = f"posterior of optimal {factor.name}"
        panels.append(drawing.panel(readable(factor.name), alt, paint, name, data, height_in=1.7))
    caption = "Posterior of the optimal setting of each factor. Dashed: recommended setting."
    return FigureBlock(lambda: tuple(panels), caption, columns=3)
