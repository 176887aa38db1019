"""What is asked of a fit beside the optimum: how blocks differ, and partial F tests of any terms."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from seqrsm.analysis.belief import Fitted
from seqrsm.analysis.results import Analysis, BlockResponse, BlockStudy
from seqrsm.analysis.runs import block_labels
from seqrsm.analysis.scale import Interval
from seqrsm.arrays import FloatArray
from seqrsm.errors import FitError, UserError
from seqrsm.fit.intervals import FTest
from seqrsm.spec.read import CampaignSpec


def block_study(spec: CampaignSpec, fitted: Fitted, point: FloatArray) -> BlockStudy | None:
    """How blocks differ, and what the recommended settings ``point`` (k,), coded, give in a new one by the quadratic.

    None where there is one block; a sentence stands for what cannot be had.
    """
    surface, scale, level = fitted.surface, fitted.scale, spec.stop.level
    labels = block_labels(spec, fitted.data)
    if len(set(labels)) < 2 or spec.model.block is None:
        return None
    row = fitted.model.matrix(point[None, :])
    sigma = sigma_block = low = high = float("nan")
    note = ""
    try:
        days = surface.days(spec)
    except FitError as error:
        new: BlockResponse | str = error.problems[0].message
    else:
        if days is None:
            return None
        weight = float(scale.weight_at(surface.predict(row).mean)[0]) / surface.errors.run_variance
        found = days.predict(row, level, weight=weight)
        confidence = scale.in_scores(float(found.confidence.low[0]), float(found.confidence.high[0]))
        prediction = Interval(*(float(end[0]) for end in scale.of_runs(found.confidence, found.prediction, 1.0)))
        low, high = fitted.application.score_limits
        mean = min(max(float(scale.to_score(found.mean)[0]), low), high)
        new = BlockResponse(mean, confidence.within(low, high), prediction.within(low, high))
        of_scale = math.sqrt(surface.errors.run_variance)
        sigma, sigma_block, note = of_scale * days.sigma, days.sigma_day, days.reason
        low, high = (end / of_scale for end in days.sigma_ratio_interval(level))
    return BlockStudy(
        effect="fixed" if surface.fixed_blocks else "random",
        new=new,
        sigma=sigma,
        sigma_block=sigma_block,
        ratio=(low, high),
        note=note,
    )


GROUPS = {
    "first order": ("linear", "category"),
    "linear": ("linear",),
    "categories": ("category",),
    "second order": ("interaction", "square"),
    "interactions": ("interaction",),
    "squares": ("square",),
    "blocks": ("block",),
    "all": ("linear", "category", "interaction", "square"),
}


@dataclass(frozen=True, slots=True)
class TermTest:
    """What was asked for, the terms that it means, and the test that all of their coefficients are zero."""

    asked: str
    terms: tuple[str, ...]
    test: FTest


def term_test(analysis: Analysis, asked: str) -> TermTest:
    """Partial F test of a group of terms.

    ``asked``: a list, joined by commas, of factors (all terms that hold them), terms, and `GROUPS`. Where a factor and
    a term have the same name the factor is meant; ``term:NAME`` means the term. UserError of a name that is none of
    these.
    """
    fit, chosen = analysis.fit, set[int]()
    for name in (part.strip() for part in asked.split(",")):
        found = _places(analysis, name)
        if not found:
            factors = ", ".join(analysis.region.names)
            raise UserError(
                "no term, factor or group of this name",
                f"Factors: {factors}. Groups: {', '.join(GROUPS)}. Terms: {', '.join(fit.names)}.",
                field="test",
                value=name,
            )
        chosen.update(found)
    places = sorted(chosen)
    return TermTest(asked, tuple(fit.names[i] for i in places), fit.partial_f(places))


def _places(analysis: Analysis, name: str) -> list[int]:
    fit = analysis.fit
    if name.startswith("term:"):
        return [i for i, term in enumerate(fit.names) if term == name.removeprefix("term:")]
    if name in analysis.region.names:
        held: list[int] = np.asarray(analysis.model.factor_terms(name)).tolist()
        return held
    kinds = GROUPS.get(name.replace("-", " ").casefold())
    if kinds is not None:
        return [i for i, kind in enumerate(fit.kinds) if kind in kinds]
    return [i for i, term in enumerate(fit.names) if term == name]
