"""Sentences and rows of the study that the terminal and the report share."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence

from seqrsm.analysis.results import Analysis, BlockResponse, BlockStudy, PathPoint, SearchedOptimum, Study, TermChoice
from seqrsm.fit.location import LocationRegion
from seqrsm.report.rounding import format_percent, format_significant
from seqrsm.report.wording import capital, half_width_text, interval_text, level_phrase, score_text

LOCATION_METHODS = {
    "scheffe": "confidence region",
    "simulated": "confidence region",
    "box_hunter": "Box-Hunter, stationary point",
    "simulation set": "posterior set",
}
"""Short names of the constructions of :mod:`seqrsm.fit.location`."""


def searched_text(analysis: Analysis, study: Study) -> str:
    """What the search does to the estimate, or why it is not known."""
    found = study.searched
    if isinstance(found, str):
        return f"Not computed: {found}."
    size = half_width_text(analysis, abs(found.optimism))
    where = "" if analysis.optimum.quadratic is None else "At the optimum of the quadratic alone. "
    return (
        f"{where}The settings were chosen by the same scores, which makes their mean look about {size} too good "
        "(bootstrap with the search repeated). Intervals that allow for it:"
    )


def searched_rows(analysis: Analysis, study: Study) -> list[tuple[str, str, str]]:
    """Name, ends and half-width of the intervals that allow for the search; empty where there are none."""
    found = study.searched
    if not isinstance(found, SearchedOptimum):
        return []
    replicates = analysis.optimum.replicates
    return [
        (name, interval_text(analysis, interval), format_significant(interval.half_width, 2))
        for name, interval in (
            ("confidence interval of the mean, after search", found.confidence),
            ("prediction interval of one future run, after search", found.prediction),
            (f"prediction interval of the mean of {replicates} runs, after search", found.prediction_mean),
        )
    ]


def location_text(region: LocationRegion, j: int) -> str:
    """Extent of a location region along factor ``j``."""
    found = region.ranges[j]
    if found.levels:
        return ", ".join(found.levels)
    if not math.isfinite(found.low_natural):
        return "none"
    return f"{format_significant(found.low_natural, 3)} to {format_significant(found.high_natural, 3)}"


def averaged_text(found: TermChoice, name: Callable[[str], str] = str) -> str:
    """How many models, the most probable one, and the most probable terms, each written by ``name``."""
    how = "all" if found.exhaustive else "a search visited"
    units, share = found.models[0]
    best = ", ".join(map(name, units)) or "none"
    median = ", ".join(map(name, found.median)) or "none"
    return (
        f"{how} {found.n_models} hierarchical models; the most probable ({format_percent(share)}) has: {best}. "
        f"More likely than not: {median}."
    )


def profile_text(study: Study) -> str:
    """What the profile of the transform's power says."""
    found = study.profile
    if isinstance(found, str):
        return f"Scale of the scores not profiled: {found}."
    name, zero = ("Box-Cox power", "logarithm") if found.family == "box-cox" else ("logit power", "logit")
    ends = " to ".join("open" if math.isinf(end) else f"{end:.2f}" for end in (found.low, found.high))
    if found.identity_inside:
        verdict = "the scores may stay as they are (1)"
    elif found.zero_inside:
        verdict = f"the {zero} (0) fits the model better than the scores as they are (1)"
    else:
        verdict = f"neither the scores as they are (1) nor their {zero} (0) is the best scale"
    return f"{name} {found.best:.2f} ({100 * found.level:g} % interval {ends}): {verdict}."


def block_rows(analysis: Analysis, found: BlockStudy) -> list[list[str]]:
    """Block, mean, confidence and prediction interval of the recommended settings."""
    rows = [_block_row(analysis, one.block, one) for one in found.same]
    if isinstance(found.new, BlockResponse):
        rows.append(_block_row(analysis, "a new block", found.new))
    return rows


def _block_row(analysis: Analysis, name: str, one: BlockResponse) -> list[str]:
    ends = (interval_text(analysis, interval) for interval in (one.confidence, one.prediction))
    return [name, score_text(analysis, one.mean), *ends]


def block_text(found: BlockStudy) -> str:
    """How much blocks differ."""
    if isinstance(found.new, str):
        return f"How blocks differ cannot be told: {found.new}."
    ratio = " to ".join(format_significant(end, 2) for end in found.ratio)
    text = (
        f"Blocks are {found.effect} effects in the fit. Standard deviation of a run "
        f"{format_significant(found.sigma, 3)}, of the blocks {format_significant(found.sigma_block, 3)} (restricted "
        f"maximum likelihood, on the scale of the fit); credible interval of their ratio {ratio}. A run in a new block "
        "brings that block's effect."
    )
    return f"{text} {capital(found.note)}." if found.note else text


def path_rows(analysis: Analysis, path: Sequence[PathPoint]) -> list[list[str]]:
    """Distance, settings, mean, and a word where the point lies outside the region."""
    return [
        [
            f"{point.distance:.2f}",
            *(
                value if isinstance(value, str) else format_significant(value, 4)
                for value in (point.settings[factor.name] for factor in analysis.region.factors)
            ),
            score_text(analysis, point.mean, unit=False),
            "" if point.inside else "outside",
        ]
        for point in path
    ]


def location_caption(analysis: Analysis, regions: Sequence[LocationRegion]) -> str:
    """What the regions are."""
    level = level_phrase(analysis)
    texts = {
        "scheffe": (
            f"Confidence region ({level} or more) of the best settings of the bounded region: no other setting is "
            "better beyond what Scheff\u00e9's simultaneous bound allows (Peterson, Cahya and del Castillo 2002)."
        ),
        "box_hunter": f"Box and Hunter's region ({level}) of the stationary point, where it lies inside the bounds.",
        "simulation set": f"Posterior set: the best settings of the {level} deepest draws of the coefficients.",
    }
    return " ".join(texts[region.method] for region in regions)
