"""What each step of a factor brings: the second date over the first, one set of sensors over another."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from numpy.random import Generator

from seqrsm.analysis.belief import Fitted, mixed_quantiles
from seqrsm.analysis.ground import sds_of_levels
from seqrsm.analysis.results import OptimumEstimate, Step
from seqrsm.arrays import AnyArray, FloatArray
from seqrsm.design.factors import CategoricalFactor, DiscreteFactor
from seqrsm.fit.error_models import Draws
from seqrsm.fit.optimum import sign_of
from seqrsm.rng import generator
from seqrsm.store.records import EventRecord

_DRAWS = 4000


def steps_of(
    fitted: Fitted, best: OptimumEstimate, draws: Draws, ranked: Sequence[EventRecord], seed: int
) -> tuple[Step, ...]:
    """Steps from the recommended settings of every factor with values or levels, from joint draws of the surface.

    ``draws`` are of the quadratic; ``ranked`` tells what paired simulations found of other levels, see
    `seqrsm.analysis.ground.sds_of_levels`. Steps are left out of whose two settings a constraint forbids one.
    """
    scale, limits = fitted.scale, fitted.application.score_limits
    point, optimism, level = best.point, best.optimism, best.level
    rng = generator(seed, fitted.fit.n_runs, "steps")
    sd_here = sds_of_levels(ranked, fitted.application.name, best.settings)
    found: list[Step] = []
    terms = draws.first(_DRAWS).terms
    for j, factor in enumerate(fitted.region.factors):
        if isinstance(factor, DiscreteFactor):
            values: tuple[float | str, ...] = factor.values
            pairs = [(i, i - 1) for i in range(1, len(values))]
        elif isinstance(factor, CategoricalFactor):
            values, chosen_level = factor.levels, int(point[j])
            pairs = [(i, chosen_level) for i in range(len(values)) if i != chosen_level]
        else:
            continue
        coded = factor.coded_levels
        points = np.repeat(point[None, :], len(values), axis=0)
        points[:, j] = coded
        feasible = fitted.region.feasible(points)
        chosen = np.isclose(coded, point[j])
        drawn = joint_draws(fitted, points, terms, rng)
        parts = [(np.clip(scale.to_score(one), *limits), share) for one, share in drawn]
        sign, mean = sign_of(fitted.goal), scale.to_score(fitted.mean(points))
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


def joint_draws(fitted: Fitted, points: FloatArray, terms: FloatArray, rng: Generator) -> list[tuple[AnyArray, float]]:
    """Draws (n, m) of the surface at points (m, k), and the probability of each kind of surface.

    ``terms`` (n, p) are those of the quadratic's coefficients.
    """
    process, share = fitted.departure.believed, fitted.departure.probability
    found = [(terms @ fitted.surface.rows(points).T, 1.0 - share)]
    if process is not None:
        means, covariances = process.joint(points)
        each = -(-_DRAWS // len(means))
        size, axes = np.linalg.eigh(covariances)
        # Symmetric roots: levels that are equally alike have no axes of their own but those of rounding.
        roots = (axes * np.sqrt(np.maximum(size, 0.0))[:, None, :]) @ np.swapaxes(axes, 1, 2)
        of_process = means[:, None, :] + rng.standard_normal((len(means), each, len(points))) @ roots
        found.append((np.concatenate(of_process), share))
    return [part for part in found if part[1] > 0.0]
