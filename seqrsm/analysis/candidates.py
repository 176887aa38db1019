"""A sensor against the optimum: the difference of their scores, and the probability that the sensor suffices.

Both were simulated on the same occasions of the same worlds, so that a difference is owed to the sensors. Scores of
one setting have two variances: from world to world, and from occasion to occasion in one (`seqrsm.analysis.ground`).
What is told of a future is told of ``runs`` occasions over one ground, as the stop rule's interval has it.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from scipy.special import stdtr, stdtrit

from seqrsm.analysis.belief import mixed_quantiles
from seqrsm.analysis.ground import future_sd
from seqrsm.analysis.results import Analysis
from seqrsm.analysis.scale import Interval
from seqrsm.analysis.steps import joint_draws
from seqrsm.arrays import FloatArray, IntArray
from seqrsm.fit.conjugate import where_reached


@dataclass(frozen=True, slots=True)
class Sufficing:
    """From when on a sensor suffices.

    Attributes
    ----------
    score : float
        Score, or difference to the optimum.
    relative : bool
        Whether it is a difference.
    sign : float
        1 where large scores are good, -1 where small ones are.
    """

    score: float
    relative: bool
    sign: float


@dataclass(frozen=True, slots=True)
class Comparison:
    """A sensor against the optimum, score units.

    Attributes
    ----------
    score, difference : float
        Expected score, and by how much it exceeds that of the optimum; by a surface not better, as its best is told.
    confidence : Interval
        Of the expected difference over all grounds.
    one_ground : Interval
        Of the difference over one ground at any place of the swath, on so many occasions as the stop rule's interval.
    probability : float
        That it suffices there.
    """

    score: float
    difference: float
    confidence: Interval
    one_ground: Interval
    probability: float


def compared(sensor: FloatArray, optimum: FloatArray, rule: Sufficing, level: float, runs: float) -> Comparison:
    """Compare a sensor with the optimum from simulations.

    Parameters
    ----------
    sensor : ndarray (places, worlds, occasions)
        Scores at places of its swath, any of which the ground may lie at.
    optimum : ndarray (worlds, occasions)
        Scores in the same worlds and on the same occasions; at least two worlds.
    rule : Sufficing
    level : float
        Of both intervals.
    runs : float
        Occasions over one ground; ``inf`` for the mean of all.
    """
    difference, df = sensor - optimum, optimum.shape[0] - 1
    mean, of_mean, _ = _moments(difference.mean(axis=0), runs)
    half = float(stdtrit(df, 0.5 + 0.5 * level))
    ends = (_quantile(difference, 0.5 + side * 0.5 * level, runs) for side in (-1.0, 1.0))
    judged = difference if rule.relative else sensor
    share = float(np.mean([_beyond(place, rule, runs) for place in judged]))
    return Comparison(
        score=float(sensor.mean()),
        difference=mean,
        confidence=Interval(mean - half * of_mean, mean + half * of_mean),
        one_ground=Interval(*ends),
        probability=share,
    )


def _moments(scores: FloatArray, runs: float) -> tuple[float, float, float]:
    """Mean of scores (worlds, occasions), its standard error, and that of a future mean over one ground."""
    error = math.sqrt(float(np.var(scores.mean(axis=1), ddof=1)) / len(scores))
    return float(scores.mean()), error, math.hypot(future_sd(scores, runs), error)


def _quantile(scores: FloatArray, p: float, runs: float) -> float:
    """Quantile of a future mean over one ground at any of the places, from scores (places, worlds, occasions)."""
    df = scores.shape[1] - 1
    mean, _, sd = np.array([_moments(place, runs) for place in scores]).T
    sd = np.maximum(sd, 1e-9)
    each = mean + stdtrit(df, p) * sd

    def below(x: FloatArray, _: IntArray) -> FloatArray:
        return np.asarray(np.mean(stdtr(df, (x - mean[:, None]) / sd[:, None]), axis=0))

    return float(where_reached(p, each[:, None], np.array([1e-9]), below)[0])


def _beyond(scores: FloatArray, rule: Sufficing, runs: float) -> float:
    mean, _, of_future = _moments(scores, runs)
    gap = rule.sign * (mean - rule.score)
    return float(stdtr(len(scores) - 1, gap / of_future)) if of_future > 0.0 else float(gap >= 0.0)


def by_surface(
    analysis: Analysis, points: FloatArray, rule: Sufficing, sds: tuple[float, float], rng: np.random.Generator
) -> Comparison:
    """Compare two settings of the region by what is believed of the surface.

    Parameters
    ----------
    analysis : Analysis
    points : ndarray (2, k)
        The sensor's and the optimum's settings, coded.
    rule : Sufficing
    sds : tuple of float
        Of a future difference, and of a future score, over one ground about the surface, see `future_sd`.
    rng : Generator
    """
    fitted, optimism, level = analysis.fitted, analysis.optimum.optimism, analysis.optimum.level
    scale, limits = fitted.scale, fitted.application.score_limits
    mean = scale.to_score(fitted.mean(points))
    above = rule.sign * max(rule.sign * (mean[0] - mean[1] + optimism), 0.0)  # as chosen as the optimum, see `Step`
    less = np.array([above, optimism])
    drawn = joint_draws(fitted, points, analysis.posterior.term_draws, rng)
    parts = [(np.clip(scale.to_score(one) - less, *limits), share) for one, share in drawn]
    gains = [(one[:, 0] - one[:, 1], share) for one, share in parts]
    futures = [(one + sds[0] * rng.standard_normal(len(one)), share) for one, share in gains]
    judged = futures
    if not rule.relative:
        judged = [(one[:, 0] + sds[1] * rng.standard_normal(len(one)), share) for one, share in parts]
    mean = np.clip(mean - less, *limits)
    return Comparison(
        score=float(mean[0]),
        difference=float(mean[0] - mean[1]),
        confidence=mixed_quantiles(gains, level).also_less(optimism - above),
        one_ground=mixed_quantiles(futures, level).also_less(optimism - above),
        probability=sum(share * float(np.mean(rule.sign * (one - rule.score) >= 0.0)) for one, share in judged),
    )
