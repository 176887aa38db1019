"""Names, settings, lists, scores with their uncertainty, as a reader wants them: "depression angle", "a, b and c"."""

from __future__ import annotations

import math
import re
from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from typing import Literal

import numpy as np

from seqrsm.analysis.results import Analysis, EffectBound, SettingPosterior
from seqrsm.analysis.scale import Interval
from seqrsm.campaign.next_runs import rounded_settings as settings_of_run
from seqrsm.decide.stopping import interval_names
from seqrsm.design.factors import CategoricalFactor, ContinuousFactor, DiscreteFactor, Factor, NumericFactor, span
from seqrsm.design.region import Region
from seqrsm.plain import counted, heading
from seqrsm.report.blocks import Cell, Column, right
from seqrsm.report.rounding import (
    MINUS,
    NOTHING,
    decimals_for,
    decimals_of_significant,
    format_number,
    format_p,
    format_percent,
    format_plain,
    format_range,
    format_share,
    format_significant,
    width_digits,
)
from seqrsm.sensor.parameters import Parameter
from seqrsm.sensor.sets import SENSORS
from seqrsm.spec.read import CampaignSpec
from seqrsm.spec.sensors import without_effect
from seqrsm.spec.tables import StopSpec
from seqrsm.store.records import RunRecord


def capital(text: str) -> str:
    """Begin a text with a capital letter, the rest as it is."""
    return text[:1].upper() + text[1:]


def source_counts(runs: Sequence[RunRecord]) -> str:
    """Return how many runs or scores of each source there are: ``"65 simulated runs and 4 measured scores"``."""
    found = []
    for source, n in Counter(run.source for run in runs).items():
        if source == "simulation":
            found.append(counted(n, "simulated run"))
            continue
        scores = sum(len(run.scores) for run in runs if run.source == source)
        told = counted(scores, "measured score" if source == "flight" else f"{source} score")
        found.append(told if scores == n else f"{told} of {counted(n, 'run')}")
    return listing(found)


def cost_texts(costs: Mapping[str, float], unit: str) -> tuple[str, str]:
    """Return what scored runs cost, and what is not in it: ``", without 12.5 kEUR of voided runs"`` or ``""``."""
    spent, voided = (with_unit(format_plain(float(f"{costs[key]:.6g}")), unit) for key in ("cost_spent", "cost_voided"))
    return spent, f", without {voided} of voided runs" if costs["cost_voided"] else ""


def readable(name: str) -> str:
    """Return a factor's name without underscores; of a sensor parameter, without the suffix that tells its unit."""
    member, dot, _ = name.rpartition(".")
    parameter = _parameter(name)
    return name.replace("_", " ") if parameter is None else f"{member}{dot}{parameter.label}"


def _parameter(name: str) -> Parameter | None:
    """The sensor parameter of this name, also where it is a member's, as in ``C.resolution``."""
    own = name.rpartition(".")[2]
    return next((table[own] for table in SENSORS.values() if own in table), None)


def readable_term(name: str) -> str:
    """Return a term's name as it is written in text: ``"frequency²"``, ``"frequency × resolution"``."""
    if name.endswith("^2"):
        return readable(name[:-2]) + "\u00b2"
    parts: list[str] = []
    depth, start = 0, 0
    for index, sign in enumerate(name):
        depth += (sign == "[") - (sign == "]")
        # A level may itself hold a colon: only those outside brackets separate factors.
        if sign == ":" and depth == 0:
            parts.append(name[start:index])
            start = index + 1
    parts.append(name[start:])
    split = (part.partition("[") for part in parts)
    return " \u00d7 ".join(readable(head) + bracket + tail for head, bracket, tail in split)


def fitted_unit(analysis: Analysis) -> str:
    """Unit of the response that the model is fitted to."""
    return "logit" if analysis.scale.kind == "logit" else analysis.score_unit


def is_weighted(analysis: Analysis) -> bool:
    """Whether runs have weights of their own, before what their errors make of them."""
    return bool(np.ptp(analysis.scale.weights) > 0.0)


def with_unit(text: str, unit: str) -> str:
    """Append a unit, if there is one, on the same line."""
    return f"{text}\u00a0{unit}" if unit and text != NOTHING else text


def targets_text(spec: CampaignSpec, target: Literal["half_width", "loss"]) -> str:
    """A target of all applications with its unit, or of each with its name; "" where there is none."""
    targets = [(one, getattr(spec.stop_of(one.name), target)) for one in spec.applications]
    texts = {one.name: with_unit(format_plain(x), one.score_unit) for one, x in targets if x is not None}
    if len(texts) == len(spec.applications) and len(set(texts.values())) == 1:
        return next(iter(texts.values()))
    return listing([f"{text} for {name}" for name, text in texts.items()])


def axis_label(factor: Factor) -> str:
    """Return name and unit of a factor, as on an axis or in a table's head."""
    return heading(readable(factor.name), factor.unit)


def factor_column(factor: Factor) -> Column:
    """Return the head of a column of settings."""
    return right(readable(factor.name), factor.unit)


def listing(items: Sequence[str]) -> str:
    """Join items: ``"a"``, ``"a and b"``, ``"a, b and c"``."""
    if len(items) < 2:
        return "".join(items)
    return f"{', '.join(items[:-1])} and {items[-1]}"


def setting_decimals(factor: NumericFactor, value: float, spread: float = math.nan) -> int:
    """Decimal places of a setting: those that ``spread`` supports, else one part in 100 of the factor's range.

    ``spread`` is half the width of the credible interval of the optimal setting [unit of the factor]. On a
    logarithmic axis the range is taken locally, so that small settings keep their digits.
    """
    low, high = span(factor)
    local = (high - low) if factor.scale == "linear" else abs(value) * math.log(high / low)
    finest = decimals_for(local / 100.0)
    if not math.isfinite(spread) or spread <= 0.0:
        return finest
    # Half of the half-width is about a standard error: it decides the digits, two at least (2 ms for 2.48 ms would be
    # another sensor), up to those that a sensor can be set to.
    return min(max(decimals_for(spread / 2.0), decimals_of_significant(value, 2)), finest + 1)


def format_setting(factor: Factor, value: float | str, spread: float = math.nan, *, unit: bool = True) -> str:
    """Format one setting of a factor; levels of discrete factors and bounds keep all digits that the user gave."""
    if isinstance(factor, CategoricalFactor):
        return str(value)
    number, places = float(value), _places(factor, float(value), spread)
    text = format_plain(number) if places is None else format_number(number, places)
    return with_unit(text, factor.unit if unit else "")


def _places(factor: NumericFactor, number: float, spread: float) -> int | None:
    """Decimal places of a setting; None for all its digits."""
    exact = isinstance(factor, DiscreteFactor) or number in span(factor)
    return None if exact and len(f"{number:.12g}") <= 8 else setting_decimals(factor, number, spread)


def told_settings(region: Region, settings: Mapping[str, float | str], spreads: Mapping[str, float]) -> dict[str, str]:
    """Settings by factor, without units, to the digits that their ``spreads`` support; dashes where without effect.

    Where rounding would leave the region, by a constraint on several factors, they are those of a run made there.
    """
    told, rounded = {}, dict(settings)
    idle = dict.fromkeys(without_effect(region.factors, settings), NOTHING)
    for factor in region.factors:
        value, spread = settings[factor.name], spreads.get(factor.name, math.nan)
        told[factor.name] = format_setting(factor, value, spread, unit=False)
        if not isinstance(factor, CategoricalFactor):
            places = _places(factor, float(value), spread)
            rounded[factor.name] = float(value) if places is None else round(float(value), places)
    if region.feasible(region.code([rounded]))[0] or not region.feasible(region.code([settings]))[0]:
        return told | idle
    made = settings_of_run(region, region.code([settings]))[0]
    return {name: format_value(value) for name, value in made.items()} | idle


def describe_factor(factor: Factor) -> tuple[str, str]:
    """Kind and allowed values of a factor in words."""
    if isinstance(factor, CategoricalFactor):
        return "categorical", ", ".join(factor.levels)
    scale = "logarithmic" if factor.scale == "log" else "linear"
    if isinstance(factor, DiscreteFactor):
        values = ", ".join(format_plain(value) for value in factor.values)
        return f"discrete, {scale}", values
    return f"continuous, {scale}", f"{format_plain(factor.low)} to {format_plain(factor.high)}"


def level_text(level: float) -> str:
    """Return a probability such as 0.95 as ``"95 %"``."""
    return f"{format_plain(round(100.0 * level, 6))}\u00a0%"


_SIGNS = str.maketrans({"u": "\u00b5", "2": "\u00b2", "3": "\u00b3"})  # of "us", "kg/m2", "m3/m3"


def fixed_unit(name: str, value: float | str) -> str:
    """Unit of a sensor parameter by its name; none for text."""
    parameter = None if isinstance(value, str) else _parameter(name)
    return "" if parameter is None else parameter.unit.translate(_SIGNS)


def readable_text(text: str, names: Iterable[str]) -> str:
    """A sentence with readable names of factors, minus signs and powers of ten; no line ends before a percent sign."""
    text = re.sub(r"(?<=\d) (?=%)", "\u00a0", text)
    text = re.sub(r"\d(?:\.\d+)?e[+-]\d+(?!\w)", lambda found: format_plain(float(found[0])), text)
    text = re.sub(r"(?<![^\s(\[])-(?=\d)", MINUS, text)
    for name in sorted((name for name in names if "_" in name), key=len, reverse=True):
        text = re.sub(rf"(?<!\w){re.escape(name)}(?!\w)", readable(name), text)
    return text


def format_value(value: float | str) -> str:
    """Format a value that a person wrote: text as it is, a number with all its digits."""
    return value if isinstance(value, str) else format_plain(float(value))


def level_labels(factor: CategoricalFactor | DiscreteFactor) -> list[str]:
    """Levels of a categorical or discrete factor as text."""
    if isinstance(factor, CategoricalFactor):
        return list(factor.levels)
    return [format_plain(value) for value in factor.values]


def shortened(text: str, length: int) -> str:
    """Cut a long text for a drawing, where it would push the axes out, but not its unit; tables hold it in full."""
    _, bracket, end = text.rpartition(" [")
    unit = bracket + end if bracket and end.endswith("]") and len(end) < length // 2 else ""
    return text if len(text) <= length else f"{text[: length - 1 - len(unit)]}\u2026{unit}"


def slug(text: str) -> str:
    """Text as a part of a file name: letters, digits and hyphens of ASCII."""
    return re.sub(r"[^a-z0-9]+", "-", text.lower()).strip("-")[:60] or "x"


def number_cell(text: str, value: float) -> Cell:
    """Return a cell that is sorted by its number."""
    return Cell(text, value if math.isfinite(value) else None)


def p_cell(p: float) -> Cell:
    """Return a cell with a tail probability, empty where there is none."""
    return number_cell(format_p(p), p) if math.isfinite(p) else Cell("")


def significant_cell(value: float, digits: int = 3) -> Cell:
    """Return a cell with a number of significant digits, empty where there is no number."""
    return number_cell(format_significant(value, digits), value) if math.isfinite(value) else Cell("")


def decimal_cell(value: float, places: int) -> Cell:
    """Return a cell with a number to some decimal places, empty where there is no number."""
    return number_cell(format_number(value, places), value) if math.isfinite(value) else Cell("")


def share_cell(share: float) -> Cell:
    """Return a cell with a share in percent, empty where there is none."""
    return number_cell(format_percent(share), share) if math.isfinite(share) else Cell("")


def whole_cell(value: int) -> Cell:
    """Return a cell with a whole number."""
    return Cell(str(value), float(value))


def no_error_estimate(analysis: Analysis) -> str:
    """Why least squares give no error, in words; "" where they do."""
    fit = analysis.fit
    if fit.df_residual == 0:
        return f"no error estimate: as many terms as runs ({fit.n_runs} runs, {fit.n_terms} terms)"
    return "no error estimate: the model passes through every score" if fit.s == 0.0 else ""


def no_intervals(analysis: Analysis) -> str:
    """Why there are no intervals, in words; "" where there are."""
    return "" if math.isfinite(analysis.optimum.confidence.half_width) else no_error_estimate(analysis)


def score_decimals(analysis: Analysis) -> int:
    """Decimal places of scores at the optimum: those of the confidence interval, else of s, else three digits.

    A standard error decides the digits, not the half-width of an interval, which is about twice as wide.
    """
    s = analysis.fit.s if analysis.scale.kind == "identity" else math.nan
    return _decimals(analysis, analysis.optimum.confidence.half_width, s)


def run_decimals(analysis: Analysis) -> int:
    """Decimal places of the score of a single run: those of its prediction interval at the optimum."""
    return _decimals(analysis, analysis.optimum.prediction.half_width)


def _decimals(analysis: Analysis, *sizes: float) -> int:
    sized = (decimals_for(size / 2.0) for size in sizes if math.isfinite(size) and size > 0.0)
    return next(sized, decimals_of_significant(analysis.optimum.mean, 3))


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
    """Return a half-width to two digits, to three where the first is 1, or why there is none."""
    if not math.isfinite(half_width):
        return no_error_estimate(analysis) or "not defined"
    return with_unit(format_significant(half_width, width_digits(half_width)), analysis.score_unit)


def mean_text(analysis: Analysis) -> str:
    """Return the mean score at the optimum with its confidence interval, which need not be symmetric about it."""
    best, decimals = analysis.optimum, score_decimals(analysis)
    if not math.isfinite(best.confidence.half_width):
        return score_text(analysis, best.mean)
    ends = format_range(best.confidence.low, best.confidence.high, decimals)
    return with_unit(f"{format_number(best.mean, decimals)} ({ends})", analysis.score_unit)


def setting_posterior(analysis: Analysis, factor: Factor) -> SettingPosterior:
    """Posterior of a factor's optimal setting."""
    return analysis.posterior.settings[analysis.region.names.index(factor.name)]


def setting_spread(analysis: Analysis, factor: Factor) -> float:
    """Half the width of the credible interval of an optimal setting; nan for a factor of levels."""
    posterior = setting_posterior(analysis, factor)
    return 0.5 * (posterior.high - posterior.low)


def setting_spreads(analysis: Analysis) -> dict[str, float]:
    """`setting_spread` of each factor."""
    return {factor.name: setting_spread(analysis, factor) for factor in analysis.region.factors}


def optimum_setting_text(analysis: Analysis, factor: Factor, *, unit: bool = True) -> str:
    """Return the recommended setting of a factor, to the digits that its posterior supports."""
    text = told_settings(analysis.region, analysis.optimum.settings, setting_spreads(analysis))[factor.name]
    return with_unit(text, factor.unit if unit else "")


def rounded_settings(analysis: Analysis, settings: Mapping[str, float | str]) -> str:
    """Return settings in one line, the recommended ones to the digits that the report gives them."""
    best, spreads = analysis.optimum.settings, setting_spreads(analysis)
    same = {name: spread for name, spread in spreads.items() if settings[name] == best[name]}
    return ", ".join(setting_phrases(analysis.region, told_settings(analysis.region, settings, same)))


def setting_phrases(region: Region, told: Mapping[str, str]) -> list[str]:
    """Return settings of `told_settings` with name and unit, without those that have no effect."""
    known = (factor for factor in region.factors if told[factor.name] != NOTHING)
    return [f"{readable(factor.name)} {with_unit(told[factor.name], factor.unit)}" for factor in known]


def setting_range_text(analysis: Analysis, factor: Factor) -> str:
    """Return the credible interval of an optimal setting, or the probabilities of the levels."""
    shares = level_probabilities(analysis, factor)
    if shares:
        return shares_text(shares)
    posterior, spread = setting_posterior(analysis, factor), setting_spread(analysis, factor)
    ends = (format_setting(factor, end, spread, unit=False) for end in (posterior.low, posterior.high))
    return " to ".join(ends)


def shares_text(shares: Mapping[str, float]) -> str:
    """Return the probabilities of levels, the likeliest first, without the hardly possible."""
    ordered = sorted(shares.items(), key=lambda item: -item[1])
    return ", ".join(f"{level}: {format_share(share)}" for level, share in ordered if share >= 0.005)


def at_bound_text(analysis: Analysis, factor: Factor) -> str:
    """Return the probability that the optimal setting lies at a bound; "" without bounds, or any value between them."""
    share = setting_posterior(analysis, factor).p_at_bound
    two = isinstance(factor, DiscreteFactor) and len(factor.values) == 2
    return "" if two or math.isnan(share) else format_share(share)


def level_probabilities(analysis: Analysis, factor: Factor) -> dict[str, float]:
    """Posterior probability that each level of a categorical or discrete factor is optimal; empty for others."""
    if isinstance(factor, ContinuousFactor):
        return {}
    draws = analysis.posterior.optimum_points[:, analysis.region.names.index(factor.name)]
    levels = zip(level_labels(factor), factor.coded_levels, strict=True)
    return {label: float(np.mean(np.abs(draws - coded) < 1e-6)) for label, coded in levels}


def level_phrase(analysis: Analysis) -> str:
    """Return the level of the campaign's intervals, such as ``"95 %"``."""
    return level_text(analysis.optimum.level)


CUT = "before the interval is cut at the bounds of the score"
"""Which half-width is told where the ends of an interval are less than two of it apart."""


def watched_interval(stop: StopSpec, one_ground: bool = False) -> str:
    """Return the interval that the stop rule uses, in words, see `interval_names`."""
    return interval_names(stop.replicates, one_ground)[stop.interval]


def parts_of_width(analysis: Analysis) -> str:
    """Return the two parts of the stop-rule half-width: ``"; sampling ± 4.2, tables ± 8.7"``, or ``""``."""
    best = analysis.optimum
    if best.ground is None:
        return ""
    chance, ground = (format_significant(part, 2) for part in (best.by_chance.half_width, best.of_ground))
    return f"; sampling \u00b1\u00a0{chance}, tables \u00b1\u00a0{ground}"


def ground_sentence(analysis: Analysis, stop: StopSpec) -> str:
    """Return the interval's two parts, sampling error and table uncertainty; ``""`` with flights or no interval."""
    best = analysis.optimum
    if best.ground is not None and not math.isfinite(best.whole.half_width):
        return ""
    if best.ground is None:
        if any(source != "simulation" for source in analysis.data.sources):
            return ""
        return (
            "Table uncertainty has not been separated from sampling error: the interval of the mean of several runs "
            "treats all scatter of simulated scores as sampling error."
        )
    widths = (best.whole.half_width, best.by_chance.half_width, best.of_ground)
    whole, chance, ground = (half_width_text(analysis, width) for width in widths)
    left = " The target applies to sampling error only." if stop.worlds == "ignore" else ""
    return (
        f"The {watched_interval(stop, one_ground=True)}, \u00b1\u00a0{whole}, combines "
        f"\u00b1\u00a0{chance} of sampling error with \u00b1\u00a0{ground} of table uncertainty: how far "
        "the ground may depart from the tabulated means (estimated "
        f"from {best.ground.n_simulations} simulations in {best.ground.n_worlds} draws of the tables). Flights reduce "
        f"table uncertainty; simulations do not.{left}"
    )


def loss_text(analysis: Analysis, loss: float) -> str:
    """Return an expected loss to two digits; "less than" a hundredth of the interval, else of the loss that counts."""
    half = analysis.optimum.prediction.half_width
    smallest = 0.01 * (half if math.isfinite(half) and half > 0.0 else analysis.posterior.regret_epsilon)
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
    without = f" Without this prior its probability is {format_share(share)}." if math.isfinite(share) else ""
    return f"Prior constraint, from the low to the high end of the range: {said}.{without}"


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


def ground_name(averaged: int) -> str:
    """On which database a run was simulated, by the cells along a side of those that were one."""
    return "full scene" if averaged == 1 else f"{averaged} x {averaged} cells averaged"
