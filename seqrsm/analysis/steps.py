"""What each step of a factor brings: the second date over the first, one set of sensors over another."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from seqrsm.analysis.belief import Belief, mixed_quantiles
from seqrsm.analysis.scale import Interval, ResponseScale
from seqrsm.arrays import AnyArray, FloatArray
from seqrsm.design.factors import CategoricalFactor, DiscreteFactor
from seqrsm.fit.error_models import Draws
from seqrsm.fit.optimum import sign_of

_DRAWS = 4000


@dataclass(frozen=True, slots=True)
class Step:
    """One value or level of a factor against another, everything else as recommended.

    Attributes
    ----------
    factor : str
    level, over : float or str
        The value and the next smaller one; or a level of a categorical factor and the recommended level.
    mean : float
        Score expected at ``level``: the recommended one's is less for having been chosen, and the others' by as much as
        leaves none above it.
    gain : float
        By which it exceeds that at ``over``; negative where scores fall.
    interval : Interval
        Of the gain, at the level of ``[stop]``; further towards the other level by what choosing one may add.
    better : float
        Probability that the score at ``level`` is the better one, expected over all grounds; by the draws as they are,
        since choosing the best by the same scores moves means and not, or hardly, these probabilities.
    better_here, loss_here : float
        Probability that it is the better one on the actual ground, one draw of what the tables leave open, and the
        score that ``over`` is then expected to lose; nan where simulations did not compare the two.
    """

    factor: str
    level: float | str
    over: float | str
    mean: float
    gain: float
    interval: Interval
    better: float
    better_here: float = math.nan
    loss_here: float = math.nan


def steps_of(
    belief: Belief,
    scale: ResponseScale,
    limits: tuple[float, float],
    point: FloatArray,
    optimism: float,
    level: float,
    draws: Draws,
    sd_here: Mapping[tuple[str, str], float],
    rng: np.random.Generator,
) -> tuple[Step, ...]:
    """Steps of every factor with values or levels, from joint draws of the surface.

    Parameters
    ----------
    belief : Belief
    scale : ResponseScale
    limits : tuple of float
        Ends that no score can leave.
    point : ndarray (k,)
        Recommended settings, coded.
    optimism : float
        Of their mean, score units, see `OptimumEstimate`.
    level : float
        Of the intervals.
    draws : Draws
        Of the quadratic.
    sd_here : Mapping
        By factor and level, see `seqrsm.analysis.ground.sds_of_levels`.
    rng : Generator

    Returns
    -------
    tuple of Step
        Those left out of whose two settings a constraint forbids one.
    """
    found: list[Step] = []
    terms = draws.first(_DRAWS).terms
    for j, factor in enumerate(belief.region.factors):
        if isinstance(factor, DiscreteFactor):
            values: tuple[float | str, ...] = factor.values
            pairs = [(i, i - 1) for i in range(1, len(values))]
        elif isinstance(factor, CategoricalFactor):
            values, best = factor.levels, int(point[j])
            pairs = [(i, best) for i in range(len(values)) if i != best]
        else:
            continue
        coded = factor.coded_levels
        points = np.repeat(point[None, :], len(values), axis=0)
        points[:, j] = coded
        feasible = belief.region.feasible(points)
        chosen = np.isclose(coded, point[j])
        drawn = joint_draws(belief, points, terms, rng)
        parts = [(np.clip(scale.to_score(one), *limits), share) for one, share in drawn]
        sign, mean = sign_of(belief.goal), scale.to_score(belief.mean(points))
        mean[chosen] -= optimism
        above = np.max(sign * mean[feasible & ~chosen], initial=-np.inf) - np.min(sign * mean[chosen], initial=np.inf)
        mean[~chosen] -= sign * max(above, 0.0)
        mean = np.clip(mean, *limits)
        for i, over in pairs:
            if feasible[i] and feasible[over]:
                gains = [(one[:, i] - one[:, over], share) for one, share in parts]
                interval = mixed_quantiles(gains, level).also_less(optimism * (float(chosen[i]) - float(chosen[over])))
                gains = [(sign * gain, share) for gain, share in gains]
                better, here = sum(share * float(np.mean(gain > 0.0)) for gain, share in gains), (math.nan, math.nan)
                if (sd := sd_here.get((factor.name, str(values[i])))) is not None:
                    there = [(gain + sd * rng.standard_normal(len(gain)), share) for gain, share in gains]
                    here = (
                        sum(share * float(np.mean(gain > 0.0)) for gain, share in there),
                        sum(share * float(np.mean(np.maximum(gain, 0.0))) for gain, share in there),
                    )
                gain = float(mean[i] - mean[over])
                found.append(Step(factor.name, values[i], values[over], float(mean[i]), gain, interval, better, *here))
    return tuple(found)


def joint_draws(
    belief: Belief, points: FloatArray, terms: FloatArray, rng: np.random.Generator
) -> list[tuple[AnyArray, float]]:
    """Draws (n, m) of the surface at points (m, k), and the probability of each kind of surface.

    ``terms`` (n, p) are those of the quadratic's coefficients.
    """
    process, share = belief.departure.believed, belief.departure.probability
    found = [(terms @ belief.surface.rows(points).T, 1.0 - share)]
    if process is not None:
        means, covariances = process.joint(points)
        each = -(-_DRAWS // len(means))
        size, axes = np.linalg.eigh(covariances)
        # Symmetric roots: levels that are equally alike have no axes of their own but those of rounding.
        roots = (axes * np.sqrt(np.maximum(size, 0.0))[:, None, :]) @ np.swapaxes(axes, 1, 2)
        of_process = means[:, None, :] + rng.standard_normal((len(means), each, len(points))) @ roots
        found.append((np.concatenate(of_process), share))
    return [part for part in found if part[1] > 0.0]
