"""Posterior of coefficients and optimum: prior from the words of ``campaign.toml``, exact or emcee draws, summary."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import TYPE_CHECKING, Literal, TypeAlias

import numpy as np

from seqrsm.analysis.fitted import Fitted
from seqrsm.analysis.results import EffectBound, Interval, OptimumEstimate, PosteriorSummary, SettingPosterior
from seqrsm.analysis.surface import columns_within_sources, counts_of, shared_loadings
from seqrsm.arrays import FloatArray, IntArray
from seqrsm.decide.moving import Box
from seqrsm.decide.sources import source_prior, stacked_rows, to_flight
from seqrsm.design.factors import CategoricalFactor, span
from seqrsm.design.quadratic import QuadraticModel
from seqrsm.design.region import Region
from seqrsm.errors import ConvergenceError
from seqrsm.fit.conjugate import (
    Flat,
    LinearBounds,
    NormalInverseGamma,
    Prior,
    bounded_draws,
    posterior,
    weakly_informative,
    with_further,
)
from seqrsm.fit.elicitation import OptimumNear, RepeatScatter, UtilityRange, elicited_prior
from seqrsm.fit.least_squares import LeastSquaresFit
from seqrsm.fit.optimum import Goal, at_bound, optimum_draws
from seqrsm.fit.robust import STUDENT_DF, student_draws
from seqrsm.fit.score_models import CoefficientPrior, beta_binomial_model
from seqrsm.fit.transforms import logit_scores
from seqrsm.rng import generator
from seqrsm.spec.read import ApplicationSpec, CampaignSpec
from seqrsm.spec.tables import ExpectedOptimum, KnowledgeSpec

if TYPE_CHECKING:
    from seqrsm.fit.ensemble import EnsemblePosterior, GeneralPosterior


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


Sampler: TypeAlias = Literal["exact", "emcee"]

Made: TypeAlias = dict[str, float | str | int]

_AT_BOUND = 1.0 - 1e-6
_LEAST_SHARE = 0.25  # of the draws wanted that must hold the bounds, else the ensemble sampler works inside them


@dataclass(frozen=True, slots=True)
class Counts:
    """Beta-binomial scatter: correlation (m,) of the decisions of a run, and the trials of a future run."""

    correlation: FloatArray
    trials: float


@dataclass(frozen=True, slots=True)
class Draws:
    """Posterior draws of the surface whose optimum is sought, on the scale of the fit.

    Attributes
    ----------
    terms : ndarray (m, p)
        Coded coefficients; those of the flight's surface where there are two sources.
    sigma : ndarray (m,)
        Standard deviation (scale, of Student-t errors) of a future run of weight 1.
    made : dict
        How they were made.
    sigma_block : ndarray (m,), optional
        Standard deviation of random blocks.
    counts : Counts, optional
        Of scores that are counts: they take the place of sigma.
    effects : EffectBounds, optional
        Bounds that all draws hold.
    share : float, optional
        Probability of these bounds without them; None where it is not known.
    """

    terms: FloatArray
    sigma: FloatArray
    made: Made
    sigma_block: FloatArray | None = None
    counts: Counts | None = None
    effects: EffectBounds | None = None
    share: float | None = None


@dataclass(frozen=True, slots=True)
class OuterPoint:
    """A point of the fitted box, coded in the campaign's region, and the campaign's bounds that it lies on."""

    point: FloatArray
    at_bound: tuple[str, ...]


def outer_bounds(region: Region, box: Box, point: FloatArray) -> OuterPoint:
    """A point (k,) coded in ``box``, seen from the campaign's region: an edge of the box alone is no bound."""
    outer = box.outwards(point)
    snapped = np.where(np.abs(outer) >= 1.0 - 1e-9, np.sign(outer), outer)
    free = list(region.continuous)
    outer[free] = snapped[free]
    return OuterPoint(outer, at_bound(region, outer))


def prior_of(spec: CampaignSpec, fitted: Fitted) -> Prior:
    """The stated prior; flat by default, where the runs can carry it: credible and t intervals agree."""
    fit = fitted.fit
    stated = stated_prior(spec, fitted.application, fitted.model, fitted.region, n_blocks=fit.n_terms - fitted.model.p)
    if stated is not None:
        return stated
    return Flat() if fit.df_residual > 0 else weakly_informative(fit.kinds, fit.y)


def _stacked(spec: CampaignSpec, fitted: Fitted) -> tuple[FloatArray, FloatArray, Prior]:
    """Rows, weights and prior of the model that is sampled."""
    fit, found = fitted.fit, fitted.sources
    if found is None:
        robust = spec.model.errors == "student_t"
        # Without scatter there is no unit for the prior of shared errors.
        loadings = shared_loadings(fitted.data, fitted.scale)[0][:, : None if fit.s > 0.0 else 0]
        weights = fitted.scale.weights if robust else fit.weights
        return np.hstack([fit.Z, loadings]), weights, _with_shared(prior_of(spec, fitted), fit, loadings.shape[1])
    flights = np.array([source == "flight" for source in fitted.data.sources])
    columns = columns_within_sources(spec, fitted.data)
    Z = np.hstack([stacked_rows(fitted.model, fitted.data.points, flights), columns])
    weights = np.where(flights, found.flight_weight, 1.0) * fitted.scale.weights
    base = stated_prior(spec, fitted.application, fitted.model, fitted.region)
    return Z, weights, source_prior(fitted.model, columns.shape[1], found.prior_sd, found.s_simulation, base)


def _with_shared(prior: Prior, fit: LeastSquaresFit, shared: int) -> Prior:
    """The prior with an error that the scores of each rung share, of standard deviation 1 for its own column."""
    return with_further(prior, fit.n_terms, np.full(shared, fit.s**2)) if shared else prior


def _coefficient_prior(spec: CampaignSpec, fitted: Fitted) -> CoefficientPrior:
    """Of the logit: as stated, else N(0, 10^2) for the intercept and N(0, 2.5^2) for the others."""
    kinds = np.array(fitted.fit.kinds)
    sd = np.where(kinds == "intercept", 10.0, 2.5)
    extra = len(kinds) - fitted.model.p
    stated = stated_prior(spec, fitted.application, fitted.model, fitted.region, extra)
    if stated is None:
        return CoefficientPrior(np.zeros(len(kinds)), sd)
    silent = np.diagonal(stated.Lambda0) == 0.0
    return CoefficientPrior(
        stated.m0, sd, precision=precision_of(stated) + np.diag(np.where(silent, 1.0 / np.square(sd), 0.0))
    )


def draw_coefficients(spec: CampaignSpec, fitted: Fitted, *, sampler: Sampler, n_draws: int) -> Draws:
    """Draws of the coefficients and of sigma; keyed by the campaign's seed.

    They hold the bounds that are stated of effects, but for those that the scores contradict and no sampler can hold.
    """
    stated = stated_bounds(spec, fitted.application, fitted.model, fitted.region)
    if stated is None:
        return _draws(spec, fitted, sampler, n_draws, None)
    rows = np.eye(fitted.model.p)[stated.terms]
    found = _draws(spec, fitted, sampler, n_draws, LinearBounds(rows, stated.low, stated.high))
    if _enough(len(found.terms), n_draws):
        return replace(found, effects=stated)
    return replace(_draws(spec, fitted, sampler, n_draws, None), share=found.share)


def _draws(spec: CampaignSpec, fitted: Fitted, sampler: Sampler, n_draws: int, bounds: LinearBounds | None) -> Draws:
    errors, p = spec.model.errors, fitted.model.p
    rng = generator(spec.seed, fitted.n_scored, "posterior")
    if errors == "beta_binomial":
        return _binomial_draws(spec, fitted, rng, n_draws, bounds)
    made: Made
    if fitted.blocks is not None:
        made = {"method": "exact", "draws": n_draws, "blocks": "random"}
        (beta, sigma, of_blocks), share = _within(partial(fitted.blocks.draws, rng=rng), bounds, n_draws)
        return Draws(beta, sigma, made | {"draws": len(sigma)}, sigma_block=of_blocks, share=share)
    Z, weights, prior = _stacked(spec, fitted)
    to_terms = np.eye(Z.shape[1])[:, :p] if fitted.sources is None else to_flight(fitted.model, np.eye(Z.shape[1]))
    inner = None if bounds is None else LinearBounds(bounds.rows @ to_terms.T, bounds.low, bounds.high)
    y, exact, share = fitted.fit.y, None, None
    if fitted.sources is not None and errors == "normal" and fitted.fit.sse > 0.0:
        base = stated_prior(spec, fitted.application, fitted.model, fitted.region)
        (beta, sigma), share = _within(partial(fitted.sources.draws, rng=rng, base=base), inner, n_draws)
        if inner is None or _enough(len(sigma), n_draws):
            made = {"method": "exact", "draws": len(sigma), "sources": 2}
            return Draws(to_flight(fitted.model, beta), sigma, made, share=share)
    # A surface through every score leaves nothing to sample: sigma is 0.
    through = fitted.fit.sse == 0.0
    if through or (sampler == "exact" and errors == "normal"):
        (beta, sigma), share = _within(partial(posterior(Z, y, weights, prior).draws, rng=rng), inner, n_draws)
        if through and fitted.sources is None and not np.any(sigma):
            beta[:, : len(fitted.fit.estimate)] = fitted.fit.estimate  # no rounding dust, which has a best end
        made = {"method": "exact", "draws": len(sigma)}
        exact = through or _enough(len(sigma), n_draws)
    elif sampler == "exact":
        beta, sigma, made, share = _student_draws(Z, y, weights, prior, n_draws, rng, inner)
        exact = _enough(len(sigma), n_draws)
    if not exact:
        from seqrsm.fit.ensemble import sample_posterior

        seed = int(rng.integers(2**31))
        try:
            chain = sample_posterior(Z, y, weights, errors=errors, prior=prior, nu=STUDENT_DF, bounds=inner, seed=seed)
        except ConvergenceError:
            if errors != "student_t":
                raise
            # A wild score makes a posterior of several hills, between which the ensemble hardly moves.
            beta, sigma, made, share = _student_draws(Z, y, weights, prior, n_draws, rng, inner)
        else:
            keep = _spread(len(chain.sigma), n_draws)
            made = _sampled(chain, errors, len(keep))
            beta, sigma = chain.beta[keep], chain.sigma[keep]
            if inner is not None and share is None:
                if errors == "normal":
                    free = posterior(Z, y, weights, prior).draws(n_draws, rng)[0]
                else:
                    free = student_draws(Z, y, weights, prior, n_draws, rng).beta
                share = float(np.mean(inner.hold(free)))
    if fitted.sources is None:
        return Draws(beta[:, :p], sigma, made, share=share)
    ratio = 1.0 / np.sqrt(fitted.sources.flight_weight)
    return Draws(to_flight(fitted.model, beta), sigma * ratio, made, share=share)


def _within(
    draw: Callable[[int], tuple[FloatArray, ...]], bounds: LinearBounds | None, n_draws: int
) -> tuple[tuple[FloatArray, ...], float | None]:
    """Draws that hold the bounds, and the share of all draws that does."""
    return (draw(n_draws), None) if bounds is None else bounded_draws(draw, bounds, n_draws)


def _enough(found: int, wanted: int) -> bool:
    return found >= _LEAST_SHARE * wanted


def _binomial_draws(
    spec: CampaignSpec, fitted: Fitted, rng: np.random.Generator, n_draws: int, bounds: LinearBounds | None
) -> Draws:
    from seqrsm.fit.ensemble import sample_model

    correct, trials = counts_of(fitted.data, 'errors = "beta_binomial"')
    prior = _coefficient_prior(spec, fitted)
    if bounds is not None:
        low, high = (np.full(len(prior.mean), end) for end in (-np.inf, np.inf))
        terms = np.argmax(bounds.rows, axis=1)
        low[terms], high[terms] = bounds.low, bounds.high
        prior = replace(prior, low=low, high=high)
    model = beta_binomial_model(fitted.fit.Z, correct, trials, prior)
    chain = sample_model(model, seed=int(rng.integers(2**31)))
    keep = _spread(len(chain.draws), n_draws)
    correlation = chain.of("correlation")[keep]
    made = _sampled(chain, "beta_binomial", len(keep))
    made |= {"correlation": float(np.mean(correlation)), "trials": float(np.median(trials))}
    beta = chain.of("beta")[keep][:, : fitted.model.p]
    counts = Counts(correlation, float(np.median(trials)))
    return Draws(beta, np.full(len(keep), fitted.fit.s), made, counts=counts)


def _student_draws(
    Z: FloatArray,
    y: FloatArray,
    weights: FloatArray,
    prior: Prior,
    n_draws: int,
    rng: np.random.Generator,
    bounds: LinearBounds | None,
) -> tuple[FloatArray, FloatArray, Made, float | None]:
    found = student_draws(Z, y, weights, prior, n_draws, rng)
    made: Made = {
        "method": "gibbs",
        "errors": "student_t",
        "draws": len(found.sigma),
        "steps": found.sweeps,
        "ess": found.ess,
        "r_hat": found.r_hat,
    }
    if bounds is None:
        return found.beta, found.sigma, made, None

    def more(n: int) -> tuple[FloatArray, ...]:
        again = student_draws(Z, y, weights, prior, n, rng)
        return again.beta, again.sigma

    (beta, sigma), share = bounded_draws(more, bounds, n_draws)
    return beta, sigma, made | {"draws": len(sigma)}, share


def _spread(n: int, wanted: int) -> IntArray:
    return np.linspace(0, n - 1, min(wanted, n)).astype(np.int64)


def _sampled(chain: EnsemblePosterior | GeneralPosterior, errors: str, draws: int) -> Made:
    return {
        "method": "emcee",
        "errors": errors,
        "draws": draws,
        "steps": chain.steps,
        "tau": float(np.max(chain.tau)),
        "ess": float(np.min(chain.ess)),
        "ess_ends": float(np.min(chain.ess_ends)),
        "acceptance": float(np.mean(list(chain.acceptance.values()))),
        "r_hat": float(np.max(chain.r_hat)),
    }


def central(draws: FloatArray, level: float) -> Interval:
    """Equal-tailed interval of draws (m,)."""
    tail = 0.5 * (1.0 - level)
    low, high = np.quantile(draws, [tail, 1.0 - tail])
    return Interval(float(low), float(high))


def future_scores(spec: CampaignSpec, fitted: Fitted, draws: Draws, row: FloatArray, replicates: int) -> FloatArray:
    """Draws (m,) of the mean of future scores at a model row (p,)."""
    here = draws.terms @ row
    rng = generator(spec.seed, fitted.n_scored, "predictive")
    size = (len(here), replicates)
    if draws.counts is not None:
        share = fitted.scale.to_score(here)[:, None] / 100.0
        phi = (1.0 / draws.counts.correlation - 1.0)[:, None]
        success = rng.beta(np.maximum(share * phi, 1e-9), np.maximum((1.0 - share) * phi, 1e-9), size)
        trials = max(round(draws.counts.trials), 1)
        counted: FloatArray = np.mean(100.0 * rng.binomial(trials, success) / trials, axis=1)
        return counted
    future: FloatArray = np.mean(fitted.scale.to_score(here[:, None] + _noise(spec, fitted, draws, here, size, rng)), 1)
    return future


def future_noise(spec: CampaignSpec, fitted: Fitted, draws: Draws, row: FloatArray, replicates: int) -> FloatArray:
    """Draws (m,) of what the mean of future runs adds to the mean response, on the scale of the fit; not of counts."""
    here = draws.terms @ row
    rng = generator(spec.seed, fitted.n_scored, "future noise")
    return np.asarray(np.mean(_noise(spec, fitted, draws, here, (len(here), replicates), rng), axis=1))


def _noise(
    spec: CampaignSpec,
    fitted: Fitted,
    draws: Draws,
    here: FloatArray,
    size: tuple[int, int],
    rng: np.random.Generator,
) -> FloatArray:
    """What blocks and single runs (m, replicates) add to the mean response ``here`` (m,)."""
    block = np.zeros((len(here), 1))
    if draws.sigma_block is not None:
        blocks = (len(here), size[1] if fitted.occasions else 1)  # an occasion for each run, or one day for all
        block = draws.sigma_block[:, None] * rng.standard_normal(blocks)
    noise = rng.standard_normal(size) if spec.model.errors == "normal" else rng.standard_t(STUDENT_DF, size)
    spread = draws.sigma[:, None] / np.sqrt(fitted.scale.weight_at(here[:, None] + block))
    return np.asarray(block + spread * noise)


def summarise_posterior(
    spec: CampaignSpec, fitted: Fitted, estimate: OptimumEstimate, draws: Draws, *, goal: Goal
) -> PosteriorSummary:
    """Posterior of the optimum: the exact optimum of the fitted region for every draw of the coefficients.

    Returns
    -------
    PosteriorSummary
        Location and value of the optimum, predictive interval at the recommended settings, and what acting on the
        recommendation may lose.
    """
    scale, model = fitted.scale, fitted.model
    points, values = optimum_draws(model, fitted.region, draws.terms, goal)
    row = model.matrix(estimate.point[None, :])[0]
    here = scale.to_score(draws.terms @ row)
    best_scores = scale.to_score(values)
    sign = 1.0 if goal == "maximize" else -1.0
    regret = np.maximum(sign * (best_scores - here), 0.0)
    epsilon = 0.25 * spec.stop.half_width
    tail = 0.5 * (1.0 - spec.stop.level)
    outer = np.array([fitted.state.box.outwards(point) for point in points])
    return PosteriorSummary(
        sampler=draws.made,
        term_draws=draws.terms,
        optimum_points=points,
        optimum_values=best_scores,
        settings=tuple(_setting(spec.region, j, outer[:, j], tail) for j in range(spec.region.k)),
        mean=float(np.mean(best_scores)),
        credible=central(best_scores, spec.stop.level),
        predictive=central(future_scores(spec, fitted, draws, row, 1), spec.stop.level),
        expected_regret=float(np.mean(regret)),
        p_regret_above=float(np.mean(regret > epsilon)),
        regret_epsilon=epsilon,
        effects=_effects(draws),
        effects_probability=float("nan") if draws.share is None else draws.share,
    )


def _effects(draws: Draws) -> tuple[EffectBound, ...]:
    stated = draws.effects
    if stated is None:
        return ()
    ends = zip(stated.factors, 2.0 * stated.low, 2.0 * stated.high, strict=True)
    return tuple(EffectBound(name, float(low), float(high)) for name, low, high in ends)


def _setting(region: Region, j: int, coded: FloatArray, tail: float) -> SettingPosterior:
    factor = region.factors[j]
    if isinstance(factor, CategoricalFactor):
        share = {level: float(np.mean(coded == i)) for i, level in enumerate(factor.levels)}
        return SettingPosterior(factor.name, np.nan, np.nan, np.nan, np.nan, share)
    low, high = factor.decode(np.quantile(coded, [tail, 1.0 - tail]))
    # The mean is taken on the coded axis, where a factor on a log scale is symmetric.
    mean = float(factor.decode(np.array([np.mean(coded)]))[0])
    at_bound = float(np.mean(np.abs(coded) >= _AT_BOUND))
    return SettingPosterior(factor.name, mean, float(low), float(high), at_bound, {})
