"""How the intervals were found: the surfaces that were weighed, and the curvature of the quadratic."""

from __future__ import annotations

import math

import numpy as np

from seqrsm.analysis.belief import PRIOR_LOG_ODDS, STATED
from seqrsm.analysis.results import Analysis
from seqrsm.arrays import FloatArray
from seqrsm.fit.canonical import within_error
from seqrsm.fit.process import MOST_SETTINGS
from seqrsm.report.blocks import Block, Details, Equation, Paragraph, Section, right, table
from seqrsm.report.figures.surfaces import numeric_factor
from seqrsm.report.rounding import format_around, format_number, format_plus_minus, format_share, format_significant
from seqrsm.report.wording import (
    decimal_cell,
    fitted_unit,
    is_weighted,
    listing,
    number_cell,
    readable,
    readable_text,
    rounded_settings,
    with_unit,
)

_FAR = 5.0  # coded: a stationary point beyond it has no settings worth a number
_WHOLE_RANGE = 2.0  # coded
_SAMPLER_WORDS = {
    "draws": "draws kept",
    "steps": "steps per walker",
    "tau": "autocorrelation time",
    "ess": "effective sample size at least",
    "ess_ends": "effective sample size at the interval ends at least",
    "acceptance": "acceptance rate",
    "r_hat": "R-hat over independent ensembles at most",
}


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


def _prediction_equation(weighted: bool) -> Equation:
    own, weights, words = ("1 \\/ w_0", "W ", "one over w zero") if weighted else ("1", "", "one")
    return Equation(
        f"hat(y)(x_0) plus.minus t_(N - p, alpha \\/ 2) dot s dot sqrt({own} + z_0^top (Z^top {weights}Z)^(-1) z_0)",
        "y hat at x zero plus or minus t with N minus p degrees of freedom at alpha over two, times s, times the "
        f"square root of {words} plus z zero transposed times the inverse of Z transposed {weights}Z times z zero",
    )


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
    nearest = " whose point nearest to the centre lies" if stationary.flat.any() else ""
    place = _place(analysis, stationary.point, stationary.se)
    text += f"has a {stationary.kind}{nearest} {where} the region at {place}."
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
    columns = (
        right("Curvature", fitted_unit(analysis)),
        *(right(readable(analysis.region.names[index])) for index in numeric),
    )
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
        elif se[index] > _WHOLE_RANGE:
            settings.append(f"{readable(factor.name)} not determined")
            continue
        elif factor.scale == "linear":
            text = format_plus_minus(value, high - value)
        else:
            text = format_around(low, value, high)
        settings.append(f"{readable(factor.name)} {with_unit(text, factor.unit)}")
    return listing(settings)


def _sampler_value(name: str, value: float | str) -> str:
    if not isinstance(value, float):
        return str(value)
    if name == "acceptance":
        return format_share(value)
    if name == "r_hat":
        return format_number(value, 4)
    return f"{format_significant(value, 2)} steps" if name == "tau" else format_significant(value, 3)
