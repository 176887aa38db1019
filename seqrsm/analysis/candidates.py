"""A sensor against the optimum, or another: the difference of their scores, and the probability that it suffices.

Both were simulated on the same occasions of the same worlds, so that a difference is owed to the sensors. Scores of
one setting have two variances: from world to world, and from occasion to occasion in one (`seqrsm.analysis.ground`).
What is told of a future is told of ``runs`` occasions over one ground, as the stop rule's interval has it.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.special import ndtr, ndtri, stdtrit

from seqrsm.analysis.belief import mixed_quantiles
from seqrsm.analysis.ground import future_sds
from seqrsm.analysis.results import Analysis
from seqrsm.analysis.scale import Interval
from seqrsm.analysis.steps import joint_draws
from seqrsm.arrays import FloatArray, IntArray
from seqrsm.fit.conjugate import where_reached


@dataclass(frozen=True, slots=True)
class Sufficing:
    """From when on a sensor suffices."""

    score: float
    """Score, or difference to the optimum."""
    relative: bool
    """Whether it is a difference."""
    sign: float
    """1 where large scores are good, -1 where small ones are."""
    most: float = math.inf
    """Largest difference of two scores that there can be."""


@dataclass(frozen=True, slots=True)
class Comparison:
    """A sensor against the optimum or another, score units."""

    score: float
    difference: float
    """Expected score, and by how much it exceeds that of the optimum; by a surface not better, as its best is told."""
    confidence: Interval
    """Of the expected difference over all grounds."""
    one_ground: Interval
    """Of the difference over one ground at any place of the swath, on so many occasions as the stop rule's interval."""
    probability: float
    """That it suffices there."""


def compared(sensor: FloatArray, other: FloatArray, rule: Sufficing, level: float, runs: float) -> Comparison:
    """Compare a sensor with the optimum, or with another sensor, from simulations; ``level``: of both intervals.

    ``sensor`` (places, worlds, occasions) are scores at places of its swath, any of which the ground may lie at;
    ``other`` those in the same worlds, at least two, and on the same occasions, with or without places, any of which
    may meet any of the sensor's. ``runs`` are occasions over one ground; ``inf`` for the mean of all.
    """
    difference, df = (sensor[:, None] - other).reshape(-1, *other.shape[-2:]), other.shape[-2] - 1
    mean, half = float(difference.mean()), float(stdtrit(df, 0.5 + 0.5 * level)) * _error(difference.mean(axis=0))
    ends = (_quantile(difference, 0.5 + side * 0.5 * level, runs) for side in (-1.0, 1.0))
    judged = difference if rule.relative else sensor
    share = float(np.mean([_beyond(place, rule, runs) for place in judged]))
    return Comparison(
        score=float(sensor.mean()),
        difference=mean,
        confidence=Interval(mean - half, mean + half).within(-rule.most, rule.most),
        one_ground=Interval(*ends).within(-rule.most, rule.most),
        probability=share,
    )


def _error(scores: FloatArray) -> float:
    """Standard error of the mean of scores (worlds, occasions)."""
    return math.sqrt(float(np.var(scores.mean(axis=1), ddof=1)) / len(scores))


def _sds(scores: FloatArray, runs: float) -> FloatArray:
    """What the standard deviation of a future mean about that of scores (worlds, occasions) may be (m,)."""
    return np.hypot(future_sds(scores, runs), _error(scores))


def _quantile(scores: FloatArray, p: float, runs: float) -> float:
    """Quantile of a future mean over one ground at any of the places, from scores (places, worlds, occasions)."""
    sd = np.maximum([_sds(place, runs) for place in scores], 1e-9)
    mean = scores.mean(axis=(1, 2))[:, None]
    each = (mean + ndtri(p) * sd).ravel()

    def below(x: FloatArray, _: IntArray) -> FloatArray:
        return np.asarray(np.mean(ndtr((x - mean[..., None]) / sd[..., None]), axis=(0, 1)))

    return float(where_reached(p, each[:, None], np.array([1e-9]), below)[0])


def _beyond(scores: FloatArray, rule: Sufficing, runs: float) -> float:
    gap = rule.sign * (float(scores.mean()) - rule.score)
    sd = _sds(scores, runs)
    return float(np.mean(ndtr(gap / sd))) if sd.any() else float(gap >= 0.0)


def by_surface(
    analysis: Analysis, points: FloatArray, rule: Sufficing, sds: Sequence[FloatArray], rng: np.random.Generator
) -> Comparison:
    """Compare the sensor's with the optimum's settings, coded ``points`` (2, k), by what is believed of the surface.

    ``sds`` are two arrays (m,): of a future difference, and of a future score, over one ground about the surface, one
    as probable as the other.
    """
    fitted, optimism, level = analysis.fitted, analysis.optimum.optimism, analysis.optimum.level
    scale, limits = fitted.scale, fitted.application.score_limits
    mean = scale.to_score(fitted.mean(points))
    above = rule.sign * max(rule.sign * (mean[0] - mean[1] + optimism), 0.0)  # as chosen as the optimum, see `Step`
    less = np.array([above, optimism])
    drawn = joint_draws(fitted, points, analysis.posterior.term_draws, rng)
    parts = [(np.clip(scale.to_score(one) - less, *limits), share) for one, share in drawn]
    gains = [(one[:, 0] - one[:, 1], share) for one, share in parts]

    def to_come(one: FloatArray, of: FloatArray) -> FloatArray:
        return np.asarray(one + rng.choice(of, len(one)) * rng.standard_normal(len(one)))

    futures = [(to_come(one, sds[0]), share) for one, share in gains]
    judged = futures
    if not rule.relative:
        judged = [(to_come(one[:, 0], sds[1]), share) for one, share in parts]
    mean = np.clip(mean - less, *limits)
    return Comparison(
        score=float(mean[0]),
        difference=float(mean[0] - mean[1]),
        confidence=mixed_quantiles(gains, level).also_less(optimism - above),
        one_ground=mixed_quantiles(futures, level).also_less(optimism - above).within(-rule.most, rule.most),
        probability=sum(share * float(np.mean(rule.sign * (one - rule.score) >= 0.0)) for one, share in judged),
    )
