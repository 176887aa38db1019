"""Posterior of the coefficients and of the optimum, by exact draws or by emcee, in score units."""

from __future__ import annotations

from typing import Literal, TypeAlias

import numpy as np

from seqrsm.arrays import FloatArray
from seqrsm.campaign.analysis import Interval, OptimumEstimate, PosteriorSummary, SettingPosterior
from seqrsm.campaign.response import ResponseScale
from seqrsm.campaign.spec import CampaignSpec
from seqrsm.design.factors import CategoricalFactor
from seqrsm.design.quadratic import QuadraticModel
from seqrsm.design.region import Region
from seqrsm.fit.conjugate import Flat, NormalInverseGamma, Prior, posterior, weakly_informative
from seqrsm.fit.least_squares import LeastSquaresFit
from seqrsm.fit.optimum import Goal, optimum_draws
from seqrsm.rng import generator

Sampler: TypeAlias = Literal["exact", "emcee"]

STUDENT_DF = 4.0
"""Degrees of freedom of errors = "student_t"."""

_AT_BOUND = 1.0 - 1e-6


def prior_of(spec: CampaignSpec, fit: LeastSquaresFit) -> Prior:
    """The prior of ``[model]``; flat by default, where the runs can carry it: credible and t intervals agree."""
    prior = spec.model.prior
    if prior is None:
        return Flat() if fit.df_residual > 0 else weakly_informative(fit.kinds, fit.y)
    flat = np.array([kind in ("intercept", "block") for kind in fit.kinds])
    precision = np.where(flat, 0.0, (prior.noise_sd / prior.coefficient_sd) ** 2)
    shape = 0.5 * prior.noise_runs
    return NormalInverseGamma(np.zeros(len(flat)), np.diag(precision), shape, shape * prior.noise_sd**2)


def draw_coefficients(
    spec: CampaignSpec, fit: LeastSquaresFit, *, sampler: Sampler, n_draws: int
) -> tuple[FloatArray, FloatArray, dict[str, float | str | int]]:
    """Draws of all coefficients (m, p), of sigma (m,), and how they were made; keyed by the campaign's seed."""
    prior = prior_of(spec, fit)
    rng = generator(spec.seed, fit.n_runs, "posterior")
    if sampler == "exact" and spec.model.errors == "normal":
        beta, sigma = posterior(fit.Z, fit.y, fit.weights, prior).draws(n_draws, rng)
        return beta, sigma, {"method": "exact", "draws": n_draws}
    from seqrsm.fit.ensemble import sample_posterior

    chain = sample_posterior(
        fit.Z, fit.y, fit.weights, errors=spec.model.errors, prior=prior, nu=STUDENT_DF, seed=int(rng.integers(2**31))
    )
    keep = np.linspace(0, len(chain.sigma) - 1, min(n_draws, len(chain.sigma))).astype(np.int64)
    made: dict[str, float | str | int] = {
        "method": "emcee",
        "errors": spec.model.errors,
        "draws": len(keep),
        "steps": chain.steps,
        "tau": float(np.max(chain.tau)),
        "ess": float(np.min(chain.ess)),
        "acceptance": float(np.mean(list(chain.acceptance.values()))),
        "r_hat": float(np.max(chain.r_hat)),
    }
    return chain.beta[keep], chain.sigma[keep], made


def summarise_posterior(
    spec: CampaignSpec,
    region: Region,
    model: QuadraticModel,
    fit: LeastSquaresFit,
    scale: ResponseScale,
    estimate: OptimumEstimate,
    *,
    goal: Goal,
    sampler: Sampler,
    n_draws: int,
) -> PosteriorSummary:
    """Posterior of the optimum: the exact optimum of the region for every draw of the coefficients.

    Returns
    -------
    PosteriorSummary
        Location and value of the optimum, predictive interval at the recommended settings, and what acting on the
        recommendation may lose.
    """
    beta, sigma, made = draw_coefficients(spec, fit, sampler=sampler, n_draws=n_draws)
    terms = beta[:, : model.p]
    points, values = optimum_draws(model, region, terms, goal)
    here = terms @ model.matrix(estimate.point[None, :])[0]
    rng = generator(spec.seed, fit.n_runs, "predictive")
    noise = rng.standard_normal(len(here)) if spec.model.errors == "normal" else rng.standard_t(STUDENT_DF, len(here))
    future = scale.to_score(here + sigma / np.sqrt(scale.weight_at(here)) * noise)
    best_scores = scale.to_score(values)
    sign = 1.0 if goal == "maximize" else -1.0
    regret = np.maximum(sign * (best_scores - scale.to_score(here)), 0.0)
    epsilon = 0.25 * spec.stop.half_width
    tail = 0.5 * (1.0 - spec.stop.level)

    def central(draws: FloatArray) -> Interval:
        low, high = np.quantile(draws, [tail, 1.0 - tail])
        return Interval(float(low), float(high))

    return PosteriorSummary(
        sampler=made,
        term_draws=terms,
        optimum_points=points,
        optimum_values=best_scores,
        settings=tuple(_setting(region, j, points[:, j], tail) for j in range(region.k)),
        mean=float(np.mean(best_scores)),
        credible=central(best_scores),
        predictive=central(future),
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
