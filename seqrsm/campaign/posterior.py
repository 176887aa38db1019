"""Posterior of the coefficients and of the optimum, by exact draws or by emcee, in score units."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal, TypeAlias

import numpy as np

from seqrsm.arrays import FloatArray
from seqrsm.campaign.analysis import Interval, OptimumEstimate, PosteriorSummary, SettingPosterior
from seqrsm.campaign.fitted import STUDENT_DF, Fitted, block_labels
from seqrsm.campaign.spec import CampaignSpec
from seqrsm.decide.moving import Box
from seqrsm.decide.sources import source_prior, stacked_rows, to_flight
from seqrsm.design.factors import CategoricalFactor
from seqrsm.design.region import Region
from seqrsm.fit.blocks import block_columns
from seqrsm.fit.conjugate import Flat, NormalInverseGamma, Prior, posterior, weakly_informative
from seqrsm.fit.least_squares import LeastSquaresFit
from seqrsm.fit.optimum import Goal, at_bound, optimum_draws
from seqrsm.rng import generator

Sampler: TypeAlias = Literal["exact", "emcee"]

_AT_BOUND = 1.0 - 1e-6


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
    """

    terms: FloatArray
    sigma: FloatArray
    made: dict[str, float | str | int]


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


def prior_of(spec: CampaignSpec, fit: LeastSquaresFit) -> Prior:
    """The prior of ``[model]``; flat by default, where the runs can carry it: credible and t intervals agree."""
    prior = spec.model.prior
    if prior is None:
        return Flat() if fit.df_residual > 0 else weakly_informative(fit.kinds, fit.y)
    flat = np.array([kind in ("intercept", "block") for kind in fit.kinds])
    precision = np.where(flat, 0.0, (prior.noise_sd / prior.coefficient_sd) ** 2)
    shape = 0.5 * prior.noise_runs
    return NormalInverseGamma(np.zeros(len(flat)), np.diag(precision), shape, shape * prior.noise_sd**2)


def _stacked(spec: CampaignSpec, fitted: Fitted) -> tuple[FloatArray, FloatArray, Prior]:
    """Rows, weights and prior of the model that is sampled."""
    fit, found = fitted.fit, fitted.sources
    if found is None:
        robust = spec.model.errors == "student_t"
        return fit.Z, fitted.scale.weights if robust else fit.weights, prior_of(spec, fit)
    flights = np.array([source == "flight" for source in fitted.data.sources])
    columns, _ = block_columns(block_labels(spec, fitted.data, with_source=False))
    Z = np.hstack([stacked_rows(fitted.model, fitted.data.points, flights), columns])
    weights = np.where(flights, found.flight_weight, 1.0) * fitted.scale.weights
    return Z, weights, source_prior(fitted.model, columns.shape[1], found.prior_sd, found.s_simulation)


def draw_coefficients(spec: CampaignSpec, fitted: Fitted, *, sampler: Sampler, n_draws: int) -> Draws:
    """Draws of the coefficients and of sigma; keyed by the campaign's seed."""
    Z, weights, prior = _stacked(spec, fitted)
    rng = generator(spec.seed, fitted.n_scored, "posterior")
    # A surface through every score leaves nothing to sample: sigma is 0.
    if fitted.fit.sse == 0.0 or (sampler == "exact" and spec.model.errors == "normal"):
        beta, sigma = posterior(Z, fitted.fit.y, weights, prior).draws(n_draws, rng)
        made: dict[str, float | str | int] = {"method": "exact", "draws": n_draws}
    else:
        from seqrsm.fit.ensemble import sample_posterior

        seed, errors = int(rng.integers(2**31)), spec.model.errors
        chain = sample_posterior(Z, fitted.fit.y, weights, errors=errors, prior=prior, nu=STUDENT_DF, seed=seed)
        keep = np.linspace(0, len(chain.sigma) - 1, min(n_draws, len(chain.sigma))).astype(np.int64)
        made = {
            "method": "emcee",
            "errors": spec.model.errors,
            "draws": len(keep),
            "steps": chain.steps,
            "tau": float(np.max(chain.tau)),
            "ess": float(np.min(chain.ess)),
            "acceptance": float(np.mean(list(chain.acceptance.values()))),
            "r_hat": float(np.max(chain.r_hat)),
        }
        beta, sigma = chain.beta[keep], chain.sigma[keep]
    if fitted.sources is None:
        return Draws(beta[:, : fitted.model.p], sigma, made)
    ratio = 1.0 / np.sqrt(fitted.sources.flight_weight)
    return Draws(to_flight(fitted.model, beta), sigma * ratio, made)


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
    noise = rng.standard_normal(size) if spec.model.errors == "normal" else rng.standard_t(STUDENT_DF, size)
    scale = fitted.scale
    spread = (draws.sigma / np.sqrt(scale.weight_at(here)))[:, None]
    future: FloatArray = np.mean(scale.to_score(here[:, None] + spread * noise), axis=1)
    return future


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
    )


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
