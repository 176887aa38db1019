"""The optimum: its intervals, the response surfaces around it, and where its settings may lie."""

from __future__ import annotations

import math
from collections.abc import Sequence
from functools import partial

import numpy as np

from seqrsm.analysis.belief import PRIOR_LOG_ODDS, STATED
from seqrsm.analysis.ground import LEVEL_WORLDS
from seqrsm.analysis.results import Analysis
from seqrsm.analysis.scale import Interval
from seqrsm.arrays import FloatArray
from seqrsm.design.factors import ContinuousFactor, DiscreteFactor, setting_with_unit
from seqrsm.fit.canonical import within_error
from seqrsm.fit.process import MOST_SETTINGS
from seqrsm.remember import recalled
from seqrsm.report.blocks import (
    Block,
    Details,
    Equation,
    FigureBlock,
    Panel,
    PanelData,
    Paragraph,
    Section,
    right,
    table,
)
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
    numeric_factor,
    ranked_factors,
    surface,
)
from seqrsm.report.rounding import (
    NOTHING,
    format_around,
    format_number,
    format_plus_minus,
    format_share,
    format_significant,
)
from seqrsm.report.wording import (
    CUT,
    decimal_cell,
    effects_text,
    fitted_unit,
    format_setting,
    half_width_text,
    interval_text,
    is_weighted,
    level_phrase,
    listing,
    no_intervals,
    number_cell,
    optimum_setting_text,
    readable,
    readable_text,
    rounded_settings,
    score_decimals,
    score_text,
    setting_range_text,
    watched_interval,
    with_unit,
)
from seqrsm.spec.tables import StopSpec

_WATCHED = {"prediction": "One future run", "prediction_mean": "Mean of future runs"}
_FAR = 5.0  # coded: a stationary point beyond it, or with such an error, has no settings worth a number


def _prediction_equation(weighted: bool) -> Equation:
    own, weights, words = ("1 \\/ w_0", "W ", "one over w zero") if weighted else ("1", "", "one")
    return Equation(
        f"hat(y)(x_0) plus.minus t_(N - p, alpha \\/ 2) dot s dot sqrt({own} + z_0^top (Z^top {weights}Z)^(-1) z_0)",
        "y hat at x zero plus or minus t with N minus p degrees of freedom at alpha over two, times s, times the "
        f"square root of {words} plus z zero transposed times the inverse of Z transposed {weights}Z times z zero",
    )


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


def shape_section(analysis: Analysis, key: str) -> Section:
    """Return how the intervals were found: the surfaces that were weighed, the shape, the posterior's sampler."""
    blocks: list[Block] = [*_prediction(analysis), *_departure(analysis), *_choice(analysis)]
    blocks += _shape(analysis)
    kept = analysis.posterior.sampler.items()
    sampled = "; ".join(f"{_SAMPLER_WORDS.get(name, readable(name))} {_sampler_value(name, x)}" for name, x in kept)
    blocks.append(Paragraph(f"Posterior computation: {sampled}.", "note"))
    return Section(f"{key}-shape", "Intervals and shape of the surface", tuple(blocks))


def _prediction(analysis: Analysis) -> list[Block]:
    """How the interval of a future run follows from the quadratic."""
    surface, departure = analysis.fitted.surface, analysis.fitted.departure
    whose = f"With the {analysis.model.name} alone, the" if departure.probability > 0.0 else "The"
    weighted = is_weighted(analysis)
    weights = ", W holds the weights of the runs and w\u2080 is that of the future run" if weighted else ""
    if not surface.errors.exact:
        how = f"{whose} intervals are quantiles of posterior draws; a future run adds an error, {surface.errors.words}."
    elif surface.common_sd:
        how = (
            f"{whose} intervals average those of Student's t over how far blocks may differ; a future run adds its "
            "error and the effect of a new block."
        )
    else:
        how = (
            f"{whose} prediction interval of one future run is (RSL TR 380-1, eq. (2-23), with the factor s that its "
            f"print omits; z\u2080 is the full model row{weights})"
        )
        return [Paragraph("", method=how), _prediction_equation(weighted)]
    return [Paragraph("", method=how)]


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


def _departure(analysis: Analysis) -> list[Block]:
    """Whether the surface is a quadratic, and what the quadratic alone would recommend."""
    found, model = analysis.fitted.departure, analysis.model.name
    if found.process is None:
        text = (
            f"Settings and intervals are those of the {model}; no alternative surface was considered: {found.reason}."
        )
        if found.reason == STATED and analysis.fitted.surface.errors.exact:
            text += (
                " The prior enters the credible intervals of the optimal settings, the expected loss and the choice of "
                "runs; the recommended settings and the intervals of the score rest on the scores alone."
            )
        return [Paragraph(text)]
    many = f"Near runs count as repeats at their middle, so that {MOST_SETTINGS} settings are left. "
    of_many = many if found.process.gathered else ""
    two = "It has the same model discrepancy, of uncertain size, and a noise variance for each source. "
    of_sources = "" if analysis.sources is None else two
    alternative = f"a Gaussian process about a {model} of shrunk coefficients"
    how = (
        f"The alternative is {alternative}, with a length scale and an axis warp for each factor, averaged over "
        f"{len(found.process.hyper.noise)} draws of its hyperparameters: another seed moves the ends of intervals by a "
        f"few percent of their half-width, by up to a fifth at 20 runs. {of_many}{of_sources}Its prior probability is "
        f"{format_share(1.0 / (1.0 + math.exp(-PRIOR_LOG_ODDS)))}; with few runs a term it may be the likelier of a "
        "surface that follows it."
    )
    factor = f"log Bayes factor {format_number(found.log_bayes_factor, 1)}"
    if found.probability == 0.0:
        return [Paragraph(f"The scores favour the {model} ({factor}). ", method=how)]
    alone = rounded_settings(analysis, analysis.region.decode(analysis.of_quadratic.point)[0])
    weighed = (
        f"has a probability of {format_share(found.probability)} ({factor}); settings and intervals average over both "
        "surfaces"
    )
    if found.reason:
        weighed = f"alone gives settings and intervals, whatever its probability ({factor}): {found.reason}"
    text = (
        f"The alternative to the {model}, {alternative}, {weighed}. Coefficients, analysis of variance, F tests, "
        f"effects, residuals and curvatures are the {model}'s; its optimum is at {alone}. "
    )
    return [Paragraph(text, method=how)]


def _choice(analysis: Analysis) -> list[Block]:
    """The correction of the mean for selection bias: the settings were chosen from the same scores."""
    off = analysis.optimum.optimism
    if not off:
        return []
    side, end = ("below", "lower") if off > 0.0 else ("above", "upper")
    amount = with_unit(format_significant(abs(off), 2), analysis.score_unit)
    text = (
        f"The reported mean is {amount} {side} the fitted surface, and the {end} ends of the intervals extend by as "
        "much: the same scores selected the settings and estimate their mean, so the fitted optimum is too good on "
        "average (selection bias, the winner's curse). "
    )
    how = (
        "The bias is estimated by a parametric bootstrap: 200 sets of scores are simulated about the fitted surface, "
        "shrunk towards its mean over the runs by the variance that error adds, and each selects and estimates "
        f"anew; for the {analysis.model.name}, with the runs proposed for the optimum at the optimum of its own "
        "earlier scores."
    )
    return [Paragraph(text, method=how)]


def _shape(analysis: Analysis) -> list[Block]:
    """Canonical analysis in words and as a table."""
    stationary = analysis.stationary
    numeric = analysis.region.numeric
    if stationary is None or not numeric:
        return []
    if stationary.kind == "none" or not np.all(np.isfinite(stationary.point[list(numeric)])):
        warning = readable_text(stationary.warning, analysis.region.names)
        return [Paragraph(warning or "The quadratic has no stationary point.")]
    where = "inside" if stationary.inside_region else "outside"
    text = (
        "At the optimal levels of the categorical factors the quadratic "
        if analysis.region.categorical
        else "The quadratic "
    )
    text += f"has a {stationary.kind} {where} the region at {_place(analysis, stationary.point, stationary.se)}."
    method = " \u00b1 and brackets: one standard error either way, by the delta method on the scale of the factor."
    blocks: list[Block] = [Paragraph(text, method=method if np.any(np.isfinite(stationary.se)) else "")]
    if stationary.warning:
        blocks.append(Paragraph(readable_text(stationary.warning, analysis.region.names), "note"))
    if stationary.flat.any() and np.all(np.isfinite(stationary.exact_point[list(numeric)])):
        place = _place(analysis, stationary.exact_point, stationary.exact_se)
        where = "inside" if stationary.exact_inside_region else "outside"
        text = f"If no curvature is set to zero, the stationary point lies {where} the region: {place}."
        blocks.append(Paragraph(text))
    rows = (
        (number_cell(format_significant(value, 3), value), *(decimal_cell(x, 2) for x in direction))
        for value, direction in zip(stationary.eigenvalues.tolist(), stationary.eigenvectors.T.tolist(), strict=True)
    )
    columns = (right("Curvature", fitted_unit(analysis)), *(right(_name(analysis, index)) for index in numeric))
    caption = "Principal curvatures of the quadratic and their directions, coded units"
    return [*blocks, Details("Canonical analysis", (table(caption, columns, rows),))]


def _place(analysis: Analysis, point: FloatArray, se: FloatArray) -> str:
    """Settings of the numeric factors at a coded point (k,), with their standard errors."""
    ends, settings = within_error(analysis.region, point, se), []
    for index in analysis.region.numeric:
        factor = numeric_factor(analysis, index)
        end = math.copysign(1.0, point[index])
        if abs(point[index]) > _FAR:
            bound = with_unit(format_significant(float(factor.decode(end)), 3), factor.unit)
            settings.append(f"{readable(factor.name)} far {'above' if end > 0.0 else 'below'} {bound}")
            continue
        value = float(factor.decode(point[index]))
        low, high = ends[factor.name]
        if not se[index] > 0.0:  # nan where nothing is known of errors
            text = format_significant(value, 3)
        elif se[index] > _FAR:  # on a logarithmic scale its ends would have a hundred digits
            settings.append(f"{readable(factor.name)} not determined")
            continue
        elif factor.scale == "linear":
            text = format_plus_minus(value, high - value)
        else:
            text = format_around(low, value, high)
        settings.append(f"{readable(factor.name)} {with_unit(text, factor.unit)}")
    return listing(settings)


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


_SAMPLER_WORDS = {
    "draws": "draws kept",
    "steps": "steps per walker",
    "tau": "autocorrelation time",
    "ess": "effective sample size at least",
    "ess_ends": "effective sample size at the interval ends at least",
    "acceptance": "acceptance rate",
    "r_hat": "R-hat over independent ensembles at most",
}


def _sampler_value(name: str, value: float | str) -> str:
    if not isinstance(value, float):
        return str(value)
    if name == "acceptance":
        return format_share(value)
    if name == "r_hat":
        return format_number(value, 4)
    return f"{format_significant(value, 2)} steps" if name == "tau" else format_significant(value, 3)


def _posterior_figure(analysis: Analysis) -> FigureBlock:
    panels = []
    for index, factor in enumerate(analysis.region.factors):
        alt = f"Posterior of the optimal {readable(factor.name)}: {setting_range_text(analysis, factor)}."
        paint, data = partial(paint_optimum_posterior, analysis, index), partial(optimum_draws_data, analysis, index)
        name = f"posterior of optimal {factor.name}"
        panels.append(drawing.panel(readable(factor.name), alt, paint, name, data, height_in=1.7))
    caption = "Posterior of the optimal setting of each factor. Dashed: recommended setting."
    return FigureBlock(lambda: tuple(panels), caption, columns=3)
