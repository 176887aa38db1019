"""A departure from the quadratic: what it does to the intervals, and what is recommended where one is seen."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from seqrsm.analysis.fitted import Fitted
from seqrsm.analysis.posterior import outer_bounds
from seqrsm.analysis.results import DepartureIntervals, Interval, OptimumEstimate
from seqrsm.analysis.surface import shared_loadings
from seqrsm.arrays import FloatArray
from seqrsm.decide.allowance import NO_ALLOWANCE, Allowance, Departures, departed_optimum, weigh_departures
from seqrsm.design.evaluate import is_saturated
from seqrsm.design.factors import setting_text
from seqrsm.fit.optimum import Optimum, active_constraints, at_bound
from seqrsm.fit.shared_error import SharedError, shared_error
from seqrsm.spec.read import CampaignSpec


def departures_of(fitted: Fitted) -> Departures | None:
    """Departures from the quadratic that the scores of an application speak for; None where nothing tells of them."""
    fit = fitted.fit
    if fitted.sources is not None or not fit.s > 0.0:
        return None
    moved = _shared(fitted, np.zeros(fit.n_terms))[1]
    return weigh_departures(fitted.model, fitted.region, fitted.data.points, fit.Z, fit.y - moved, fit.weights)


def with_departure(
    spec: CampaignSpec,
    fitted: Fitted,
    departures: Departures | None,
    best: Optimum,
    intervals: tuple[Interval, Interval, Interval],
    chosen: bool,
) -> DepartureIntervals | None:
    """Confidence, prediction and prediction interval of the mean of several with a departure allowed for.

    ``chosen`` says that the settings were chosen for it.
    """
    fit, scale = fitted.fit, fitted.scale
    if fitted.sources is not None or not fit.s > 0.0:
        return None
    row = fit.rows_with_mean_block(fitted.model.matrix(best.point[None, :]))[0]
    shared, _ = _shared(fitted, row)
    allowance = NO_ALLOWANCE if departures is None else departures.allowance(best.point, row)
    allowance = allowance.of_chosen if chosen else allowance
    allowance = Allowance(allowance.shift + shared.shift, allowance.variance + shared.variance)
    mean = float(row @ fit.estimate)
    found, widening = [], 1.0
    for kind, interval in zip(("confidence", "prediction", "prediction_mean"), intervals, strict=True):
        # On the scale of the fit, where the interval of the quadratic is (nearly) symmetric.
        low, high = scale.of_score(np.array([interval.low, interval.high]))
        ends = allowance.ends(mean, 0.5 * float(high - low), fit.df_residual, spec.stop.level)
        scores = scale.to_score(np.array(ends))
        found.append(Interval(float(scores[0]), float(scores[1])))
        if kind == spec.stop.interval:
            widening = (ends[1] - ends[0]) / float(high - low)
    shifted = float(scale.to_score(np.array([mean + allowance.shift]))[0])
    return DepartureIntervals(shifted, found[0], found[1], found[2], widening)


def _shared(fitted: Fitted, row: FloatArray) -> tuple[SharedError, FloatArray]:
    """Errors that the scores of a rung share, and what they add to each score (n,)."""
    fit = fitted.fit
    loadings, _ = shared_loadings(fitted.data, fitted.scale)
    found = shared_error(fit.Z, fit.y, fit.weights, loadings, row)
    return found, loadings @ found.errors


def departed_optimum_of(
    spec: CampaignSpec, fitted: Fitted, departures: Departures | None, best: Optimum
) -> Optimum | None:
    """Best settings of quadratic and departure together; None where no departure is seen.

    Only where the region may shrink: elsewhere the quadratic is what was asked for.
    """
    fit, model, region = fitted.fit, fitted.model, fitted.region
    if departures is None or not spec.region_moves or model.order != 2 or is_saturated(model, region):
        return None
    if not fitted.departure.seen:
        return None
    moved = _shared(fitted, np.zeros(fit.n_terms))[1]
    root = np.sqrt(fit.weights)
    estimate = fit.estimate - np.linalg.lstsq(fit.Z * root[:, None], moved * root, rcond=None)[0]
    point = departed_optimum(
        departures,
        region,
        lambda at: fit.rows_with_mean_block(model.matrix(at)),
        estimate,
        fitted.application.goal,
        spec.seed % 2**32,
    )
    return replace(
        best,
        point=point,
        value=float(model.matrix(point[None, :])[0] @ fitted.beta),
        at_bound=at_bound(region, point),
        active_constraints=active_constraints(region, point),
        ties=np.empty((0, region.k)),
        flat=False,
        exact=False,
    )


def of_both(estimate: OptimumEstimate, best: Optimum) -> OptimumEstimate:
    """The estimate with mean and intervals of quadratic and departure together; ``best`` is the quadratic's optimum."""
    both = estimate.with_departure
    if both is None:
        return estimate
    return replace(
        estimate,
        mean=both.mean,
        confidence=both.confidence,
        prediction=both.prediction,
        prediction_mean=both.prediction_mean,
        quadratic=best.point,
    )


def departed_text(spec: CampaignSpec, fitted: Fitted, best: Optimum) -> str:
    """Why the recommended settings are not those of the quadratic, which are named."""
    hard = outer_bounds(spec.region, fitted.state.box, best.point)
    settings = spec.region.decode(hard.point)[0]
    names = ", ".join(f"{factor.name} {setting_text(factor, settings[factor.name])}" for factor in spec.region.factors)
    return (
        f"The scores speak against a quadratic here (evidence {fitted.departure.evidence:.1f}, limit "
        f"{fitted.departure.limit:.1f}): recommended are the settings where quadratic and smooth departure together "
        f"are best. The quadratic alone has its optimum at {names}."
    )
