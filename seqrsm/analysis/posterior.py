"""Posterior of coefficients and optimum: prior from the words of ``campaign.toml``, exact or emcee draws, summary."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np

from seqrsm.analysis.belief import Fitted, intervals_by_draws
from seqrsm.analysis.results import EffectBound, OptimumEstimate, PosteriorSummary, SettingPosterior
from seqrsm.analysis.scale import Interval
from seqrsm.arrays import BoolArray, FloatArray
from seqrsm.design.factors import CategoricalFactor, DiscreteFactor, central_range
from seqrsm.design.quadratic import QuadraticModel
from seqrsm.design.region import Region
from seqrsm.fit.conjugate import LinearBounds, NormalInverseGamma
from seqrsm.fit.elicitation import elicited_prior
from seqrsm.fit.error_models import Draws, Sampler, enough
from seqrsm.fit.least_squares import LeastSquaresFit
from seqrsm.fit.optimum import optimum_draws, sign_of
from seqrsm.fit.transforms import logit_scores
from seqrsm.rng import batch_seed, generator
from seqrsm.spec.read import CampaignSpec
from seqrsm.spec.tables import ApplicationSpec, ExpectedOptimum


def stated_prior(
    spec: CampaignSpec, application: ApplicationSpec, fit: LeastSquaresFit | None = None
) -> NormalInverseGamma | None:
    """The prior that ``campaign.toml`` states of the terms, on the scale of the fit; None where it states none.

    Where it does not say by what repeated runs scatter, the scores' ``fit`` does, if it can: sigma's guess scales the
    whole prior, and with one that is too large the prior is tighter than what was said, and sigma too large.
    """
    known = application.prior
    if known is None or known.utility is None:
        return None
    low, high = known.utility
    repeat_sd = 0.1 * (high - low) if known.repeat_sd is None else known.repeat_sd
    if spec.model.response == "logit":
        middle = min(max(0.5 * (low + high), 1.0), 99.0)
        repeat_sd *= 100.0 / (middle * (100.0 - middle))
        low, high = (float(end) for end in logit_scores(np.array([low, high])))
    if known.repeat_sd is None and fit is not None and (df := fit.df_residual) >= _TELLING_DF and fit.s > 0.0:
        repeat_sd = fit.s * math.sqrt(df / (df - 2))  # the mean of sigma^2 by the scores alone
    optimum = {}
    for name, expected in known.optimum.items():
        stated = expected if isinstance(expected, ExpectedOptimum) else ExpectedOptimum(value=float(expected))
        optimum[name] = stated.value, stated.doubt
    return elicited_prior(
        spec.quadratic,
        spec.region,
        (low, high),
        probability=known.probability,
        repeat_sd=repeat_sd,
        repeat_runs=known.repeat_runs,
        optimum=optimum,
        goal=application.goal,
    )


def stated_bounds(application: ApplicationSpec, model: QuadraticModel) -> LinearBounds | None:
    """Bounds of effects that ``campaign.toml`` states, on the scale of the fit; None where it states none.

    Of a factor's linear term: half of its effect, the squares of both ends being equal.
    """
    known = application.prior
    if known is None or not known.effect:
        return None
    terms, low, high = zip(
        *(
            (model.term_names.index(factor.name), *known.effect[factor.name])
            for factor in model.factors
            if factor.name in known.effect
        ),
        strict=True,
    )
    return LinearBounds(np.eye(model.p)[list(terms)], 0.5 * np.array(low), 0.5 * np.array(high))


def effects_left_out(application: ApplicationSpec, posterior: PosteriorSummary) -> list[str]:
    """A warning where what is stated of effects is not used."""
    stated = {} if application.prior is None else application.prior.effect
    if not stated or posterior.effects:
        return []
    what = f"The [application.prior] bounds on the effect of {', '.join(stated)}"
    reason = f"the scores contradict it (probability {posterior.effects_probability:.1g})"
    return [f"{what} are not used in the posterior: {reason}."]


_TELLING_DF = 5  # with fewer the scores know their scatter no better than the guess
_STEP = 1e-6  # coded, that an optimum at a bound cannot take
_MOST_OPTIMA = 8000  # draws whose optimum is sought


def draw_coefficients(spec: CampaignSpec, fitted: Fitted, *, sampler: Sampler, n_draws: int) -> Draws:
    """Draws of the coefficients and of sigma; keyed by the campaign's seed.

    They hold the bounds that are stated of effects, but for those that the scores contradict and no sampler can hold.
    """
    stated = stated_prior(spec, fitted.application, fitted.fit)
    bounds = stated_bounds(fitted.application, fitted.model)

    def draws(held: LinearBounds | None) -> Draws:
        rng = generator(spec.seed, fitted.fit.n_runs, "posterior")
        return fitted.surface.draws(stated, held, sampler, n_draws, rng)

    found = draws(bounds)
    if bounds is None:
        return found
    if enough(len(found.terms), n_draws):
        return replace(found, bounds=bounds)
    return replace(draws(None), share=found.share)


def summarise_posterior(
    spec: CampaignSpec, fitted: Fitted, estimate: OptimumEstimate, draws: Draws, looked: Draws, taken_off: float
) -> PosteriorSummary:
    """Posterior of the optimum: the exact optimum for every draw of the coefficients, and optima of the process.

    ``looked``: draws by which the loss is told. ``taken_off`` the predictive interval is what `optimism` found.
    """
    point = estimate.point
    points, best_scores, regret = _optima(spec, fitted, point, draws)
    if looked is not draws:
        *_, regret = _optima(spec, fitted, point, looked)
    low, high = fitted.application.score_limits
    stop = spec.stop_of(fitted.application.name)
    epsilon = 0.25 * stop.half_width if stop.loss is None else stop.loss
    level, prior = spec.stop.level, fitted.application.prior
    tail = 0.5 * (1.0 - level)
    stated = {} if draws.bounds is None or prior is None else prior.effect
    rng = generator(spec.seed, fitted.fit.n_runs, "predictive")
    _, (_, predictive) = intervals_by_draws(fitted, point, level, (1.0,), taken_off, draws, rng)
    return PosteriorSummary(
        sampler=draws.made,
        term_draws=draws.terms,
        optimum_points=points,
        optimum_values=best_scores,
        settings=tuple(_setting(spec.region, j, points, tail) for j in range(spec.region.k)),
        mean=float(np.mean(best_scores)),
        credible=Interval(*(float(end) for end in np.quantile(best_scores, [tail, 1.0 - tail]))),
        predictive=predictive.within(low, high),
        expected_regret=float(np.mean(regret)),
        p_regret_above=float(np.mean(regret > epsilon)),
        regret_epsilon=epsilon,
        effects=tuple(EffectBound(f.name, *stated[f.name]) for f in spec.factors if f.name in stated),
        effects_probability=float("nan") if draws.share is None else draws.share,
    )


def _optima(
    spec: CampaignSpec, fitted: Fitted, point: FloatArray, draws: Draws
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Optimum of each draw, coded (m, k); its score (m,), and how much of that a coded ``point`` (k,) loses (m,)."""
    n = min(len(draws.terms), _MOST_OPTIMA)
    of_process = round(n * fitted.departure.probability)
    terms = draws.terms[: n - of_process]
    points, values = optimum_draws(fitted.model, fitted.region, terms, fitted.goal)
    here = terms @ fitted.surface.rows(point[None, :])[0]
    if of_process:
        own = fitted.optima(point, fitted.data.points, of_process, batch_seed(spec.seed, fitted.fit.n_runs))
        points, values, here = (np.concatenate(both) for both in zip((points, values, here), own, strict=True))
    limits = fitted.application.score_limits
    best_scores, here_scores = (np.clip(fitted.scale.to_score(found), *limits) for found in (values, here))
    return points, best_scores, np.maximum(sign_of(fitted.goal) * (best_scores - here_scores), 0.0)


def _setting(region: Region, j: int, points: FloatArray, tail: float) -> SettingPosterior:
    factor, coded = region.factors[j], points[:, j]
    if isinstance(factor, CategoricalFactor):
        share = {level: float(np.mean(coded == i)) for i, level in enumerate(factor.levels)}
        return SettingPosterior(factor.name, np.nan, np.nan, np.nan, np.nan, share)
    low, high = central_range(factor, coded, tail)
    # The mean is taken on the coded axis, where a factor on a log scale is symmetric.
    mean = float(factor.decode(np.array([np.mean(coded)]))[0])
    return SettingPosterior(factor.name, mean, low, high, float(np.mean(_at_bound(region, j, points))), {})


def _at_bound(region: Region, j: int, points: FloatArray) -> BoolArray:
    """Which ``points`` (m, k) the next setting of factor ``j``, one way or the other, takes out of the region."""
    factor, found = region.factors[j], np.zeros(len(points), dtype=np.bool_)
    for side in (-1, 1):
        beyond = points.copy()
        if isinstance(factor, DiscreteFactor):
            levels = np.concatenate([[-np.inf], factor.coded_levels, [np.inf]])
            nearest = np.argmin(np.abs(points[:, [j]] - factor.coded_levels), axis=1)
            beyond[:, j] = levels[1 + nearest + side]
        else:
            beyond[:, j] += side * _STEP
        found |= ~region.feasible(beyond)
    return found
