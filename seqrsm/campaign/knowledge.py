"""Prior knowledge of a campaign, from the words of ``campaign.toml`` to a prior of the coded coefficients."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from seqrsm.arrays import FloatArray, IntArray
from seqrsm.campaign.analysis import PosteriorSummary
from seqrsm.design.factors import CategoricalFactor, span
from seqrsm.design.quadratic import QuadraticModel
from seqrsm.design.region import Region
from seqrsm.fit.conjugate import NormalInverseGamma
from seqrsm.fit.elicitation import OptimumNear, RepeatScatter, UtilityRange, elicited_prior
from seqrsm.fit.transforms import logit_scores
from seqrsm.spec.read import ApplicationSpec, CampaignSpec
from seqrsm.spec.tables import ExpectedOptimum, KnowledgeSpec


def stated_prior(
    spec: CampaignSpec, application: ApplicationSpec, model: QuadraticModel, region: Region, n_blocks: int = 0
) -> NormalInverseGamma | None:
    """The prior that ``campaign.toml`` states, on the scale of the fit; None where it states none.

    Parameters
    ----------
    spec : CampaignSpec
    application : ApplicationSpec
    model, region : QuadraticModel, Region
        Those that are fitted: a part of the campaign's region, maybe.
    n_blocks : int
        Columns of blocks after the model's terms; nothing is known of them.
    """
    size = model.p + n_blocks
    stated = spec.model.prior
    if stated is not None:
        free = np.array([term.kind == "intercept" for term in model.terms] + [True] * n_blocks)
        precision = np.where(free, 0.0, (stated.noise_sd / stated.coefficient_sd) ** 2)
        shape = 0.5 * stated.noise_runs
        return NormalInverseGamma(np.zeros(size), np.diag(precision), shape, shape * stated.noise_sd**2)
    if application.prior is None or application.prior.utility is None:
        return None
    found = _elicited(spec, application, application.prior, application.prior.utility, model, region)
    mean, precision = np.zeros(size), np.zeros((size, size))
    mean[: model.p], precision[: model.p, : model.p] = found.m0, found.Lambda0
    return NormalInverseGamma(mean, precision, found.a0, found.b0)


def _elicited(
    spec: CampaignSpec,
    application: ApplicationSpec,
    known: KnowledgeSpec,
    utility: Sequence[float],
    model: QuadraticModel,
    region: Region,
) -> NormalInverseGamma:
    low, high = utility
    repeat_sd = 0.1 * (high - low) if known.repeat_sd is None else known.repeat_sd
    if spec.model.response == "logit":
        middle = min(max(0.5 * (low + high), 1.0), 99.0)
        repeat_sd *= 100.0 / (middle * (100.0 - middle))
        low, high = (float(end) for end in logit_scores(np.array([low, high])).value)
    numeric = {factor.name: factor for factor in region.factors if not isinstance(factor, CategoricalFactor)}
    optima = []
    for name, expected in known.optimum.items():
        stated = expected if isinstance(expected, ExpectedOptimum) else ExpectedOptimum(value=float(expected))
        least, most = span(numeric[name])
        # What was expected outside the part of the region that is fitted has been refuted by the scores.
        if least <= stated.value <= most and name in model.term_names:
            optima.append(OptimumNear(name, stated.value, stated.doubt))
    return elicited_prior(
        model,
        region,
        UtilityRange(low, high, known.probability),
        optima=optima,
        scatter=RepeatScatter(repeat_sd, known.repeat_runs),
        goal=application.goal,
    )


@dataclass(frozen=True, slots=True)
class EffectBounds:
    """``effect`` of ``[application.prior]`` as bounds of coded coefficients, on the scale of the fit.

    Attributes
    ----------
    factors : tuple of str
    terms : ndarray (c,)
        Index of each factor's linear term among the model's: half of its effect, the squares of both ends being equal.
    low, high : ndarray (c,)
    """

    factors: tuple[str, ...]
    terms: IntArray
    low: FloatArray
    high: FloatArray


def stated_bounds(
    spec: CampaignSpec, application: ApplicationSpec, model: QuadraticModel, region: Region
) -> EffectBounds | None:
    """Bounds of effects that ``campaign.toml`` states; None where it states none that is about this region.

    A statement on a whole range says nothing of the part of it that is left where the fitted region has shrunk, nor of
    a factor whose term was left out.
    """
    known = application.prior
    if known is None or not known.effect:
        return None
    whole = {factor.name: factor for factor in spec.factors}
    found = [
        (factor.name, model.term_names.index(factor.name), *known.effect[factor.name])
        for factor in region.factors
        if factor.name in known.effect and factor == whole[factor.name] and factor.name in model.term_names
    ]
    if not found:
        return None
    names, terms, low, high = zip(*found, strict=True)
    return EffectBounds(names, np.array(terms), 0.5 * np.array(low), 0.5 * np.array(high))


def precision_of(prior: NormalInverseGamma) -> FloatArray:
    """Prior precision of the coefficients with sigma at its prior guess."""
    return prior.Lambda0 * (prior.a0 / prior.b0)


def effects_left_out(application: ApplicationSpec, posterior: PosteriorSummary) -> list[str]:
    """A warning where what is stated of effects is not used."""
    stated = {} if application.prior is None else application.prior.effect
    names = [name for name in stated if name not in [bound.factor for bound in posterior.effects]]
    if not names:
        return []
    share = posterior.effects_probability
    if np.isfinite(share) and not posterior.effects:
        reason = f"the scores contradict it (probability {share:.1g})"
    else:
        reason = "it is about the whole range and the full model, which are not fitted here"
    what = f"What [application.prior] says of the effect of {', '.join(names)}"
    return [f"{what} is left out of the posterior: {reason}."]
