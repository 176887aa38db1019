"""Sentences and cells that several sections share: scores with their uncertainty, intervals, or why there is none."""

from __future__ import annotations

import math

import numpy as np

from seqrsm.analysis.results import Analysis, EffectBound, Interval, SettingPosterior
from seqrsm.design.factors import CategoricalFactor, ContinuousFactor, Factor
from seqrsm.report.blocks import Cell
from seqrsm.report.rounding import (
    NOTHING,
    decimals_for,
    decimals_of_significant,
    format_number,
    format_p,
    format_plain,
    format_plus_minus,
    format_range,
    format_share,
    format_significant,
)
from seqrsm.report.wording import format_setting, level_labels, level_text, listing, readable, with_unit
from seqrsm.spec.read import StopSpec


def number_cell(text: str, value: float) -> Cell:
    """Return a cell that is sorted by its number."""
    return Cell(text, value if math.isfinite(value) else None)


def p_cell(p: float) -> Cell:
    """Return a cell with a tail probability."""
    return number_cell(format_p(p), p)


def significant_cell(value: float, digits: int = 3) -> Cell:
    """Return a cell with a number of significant digits."""
    return number_cell(format_significant(value, digits), value)


def whole_cell(value: int) -> Cell:
    """Return a cell with a whole number."""
    return Cell(str(value), float(value))


def no_error_estimate(analysis: Analysis) -> str:
    """Why there are no intervals, in words; "" where there are."""
    fit = analysis.fit
    if fit.df_residual == 0:
        return f"no error estimate: N = p ({fit.n_runs} runs, {fit.rank} terms)"
    if not math.isfinite(analysis.optimum.confidence.half_width):
        return "no interval: the runs do not determine the score at these settings"
    return ""


def score_decimals(analysis: Analysis) -> int:
    """Decimal places of scores at the optimum: those of the confidence interval, else of s, else three digits.

    A standard error decides the digits, not the half-width of an interval, which is about twice as wide.
    """
    for size in (
        analysis.optimum.confidence.half_width,
        analysis.fit.s if analysis.response == "identity" else math.nan,
    ):
        if math.isfinite(size) and size > 0.0:
            return decimals_for(size / 2.0)
    return decimals_of_significant(analysis.optimum.mean, 3)


def run_decimals(analysis: Analysis) -> int:
    """Decimal places of the score of a single run: those of its prediction interval at the optimum."""
    half = analysis.optimum.prediction.half_width
    if math.isfinite(half) and half > 0.0:
        return decimals_for(half / 2.0)
    return decimals_of_significant(analysis.optimum.mean, 3)


def score_text(analysis: Analysis, value: float, *, unit: bool = True) -> str:
    """Return a mean score with its unit."""
    text = format_number(value, score_decimals(analysis))
    return with_unit(text, analysis.score_unit) if unit else text


def interval_text(analysis: Analysis, interval: Interval) -> str:
    """Return ``low to high``, or why there is no interval."""
    if not (math.isfinite(interval.low) and math.isfinite(interval.high)):
        return no_error_estimate(analysis) or "no interval"
    return with_unit(format_range(interval.low, interval.high, score_decimals(analysis)), analysis.score_unit)


def half_width_text(analysis: Analysis, half_width: float) -> str:
    """Return a half-width to two digits, or why there is none."""
    if not math.isfinite(half_width):
        return no_error_estimate(analysis) or "not defined"
    return with_unit(format_significant(half_width, 2), analysis.score_unit)


def mean_text(analysis: Analysis) -> str:
    """Return the mean score at the optimum with its confidence half-width, where there is one."""
    half = analysis.optimum.confidence.half_width
    if not math.isfinite(half):
        return score_text(analysis, analysis.optimum.mean)
    return with_unit(format_plus_minus(analysis.optimum.mean, half, score_decimals(analysis)), analysis.score_unit)


def of_quadratic(analysis: Analysis) -> str:
    """What to add to a heading of the quadratic's optimum where other settings are recommended; else ""."""
    return "" if analysis.optimum.quadratic is None else ", by the quadratic alone"


def setting_spread(posterior: SettingPosterior | None) -> float:
    """Half the width of the credible interval of an optimal setting; nan where there is none."""
    return math.nan if posterior is None else 0.5 * (posterior.high - posterior.low)


def setting_posterior(analysis: Analysis, factor: Factor) -> SettingPosterior | None:
    """Posterior of a factor's optimal setting."""
    return next((item for item in analysis.posterior.settings if item.factor == factor.name), None)


def optimum_setting_text(analysis: Analysis, factor: Factor, *, unit: bool = True) -> str:
    """Return the recommended setting of a factor, to the digits that its posterior supports."""
    spread = setting_spread(setting_posterior(analysis, factor))
    return format_setting(factor, analysis.optimum.settings[factor.name], spread, unit=unit)


def setting_range_text(analysis: Analysis, factor: Factor) -> str:
    """Return the credible interval of an optimal setting, or the probabilities of the levels."""
    posterior = setting_posterior(analysis, factor)
    if posterior is None:
        return NOTHING
    shares = level_probabilities(analysis, factor)
    if shares:
        ordered = sorted(shares.items(), key=lambda item: -item[1])
        return ", ".join(f"{level}: {format_share(share)}" for level, share in ordered if share >= 0.005)
    spread = setting_spread(posterior)
    ends = (format_setting(factor, end, spread, unit=False) for end in (posterior.low, posterior.high))
    return " to ".join(ends)


def level_probabilities(analysis: Analysis, factor: Factor) -> dict[str, float]:
    """Posterior probability that each level of a categorical or discrete factor is optimal; empty for others."""
    if isinstance(factor, ContinuousFactor):
        return {}
    draws = analysis.posterior.optimum_points[:, analysis.region.names.index(factor.name)]
    if isinstance(factor, CategoricalFactor):
        coded = np.arange(len(factor.levels), dtype=np.float64)
    else:
        coded = factor.coded_levels
    labels = level_labels(factor)
    return {label: float(np.mean(np.abs(draws - c) < 1e-6)) for label, c in zip(labels, coded, strict=True)}


def settings_sentence(analysis: Analysis) -> str:
    """Return the recommended settings: ``"frequency 9.4 GHz, resolution 12 m and polarization HV"``."""
    parts = [f"{readable(factor.name)} {optimum_setting_text(analysis, factor)}" for factor in analysis.region.factors]
    return parts[0] if len(parts) == 1 else f"{', '.join(parts[:-1])} and {parts[-1]}"


def level_phrase(analysis: Analysis) -> str:
    """Return the level of the campaign's intervals, such as ``"95 %"``."""
    return level_text(analysis.optimum.level)


def watched_interval(stop: StopSpec) -> str:
    """Return the interval that the stop rule watches, in words."""
    return {
        "prediction": "prediction interval of one future run",
        "prediction_mean": f"prediction interval of the mean of {stop.replicates} future runs",
        "confidence": "confidence interval of the mean",
    }[stop.interval]


def loss_text(analysis: Analysis, loss: float) -> str:
    """Return an expected loss to two digits; "less than" a hundredth of the interval where it is smaller."""
    half = analysis.optimum.prediction.half_width
    smallest = 0.01 * (half if math.isfinite(half) and half > 0.0 else abs(analysis.optimum.mean))
    if loss < smallest:
        return f"less than {with_unit(format_significant(smallest, 1), analysis.score_unit)}"
    return with_unit(format_significant(loss, 2), analysis.score_unit)


def effects_text(analysis: Analysis) -> str:
    """What the prior says of effects, and how likely that is without it; "" where it says nothing."""
    posterior = analysis.posterior
    if not posterior.effects:
        return ""
    said = listing([_effect_text(analysis, bound) for bound in posterior.effects])
    share = posterior.effects_probability
    without = f" Without this prior the probability of that is {format_share(share)}." if math.isfinite(share) else ""
    return f"By the prior, from the low to the high end of its range, {said}.{without}"


def _effect_text(analysis: Analysis, bound: EffectBound) -> str:
    name, low, high = readable(bound.factor), bound.low, bound.high
    if low == 0.0 and high > 0.0 and math.isinf(high):
        return f"{name} does not lower the mean score"
    if high == 0.0 and math.isinf(low):
        return f"{name} does not raise the mean score"
    ends = [with_unit(format_plain(end), analysis.score_unit) for end in (low, high)]
    if math.isinf(high):
        return f"{name} changes the mean score by {ends[0]} or more"
    if math.isinf(low):
        return f"{name} changes the mean score by {ends[1]} or less"
    return f"{name} changes the mean score by {format_plain(low)} to {ends[1]}"
