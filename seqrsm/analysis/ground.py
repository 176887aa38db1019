"""How much of the scatter of simulated scores is one ground against another, and how much the chance of an occasion.

Every simulated run meets a world of its own (`seqrsm.scattering.worlds`), so that the fitted surface is the expected
score over worlds and a run scatters about it as one flight over an unknown ground does. Several flights over one ground
share their world. A bundle of simulations at one setting, two occasions in each of some worlds, tells both. The scatter
of the runs about the surface does not: it is that of the whole region, and poor settings scatter more.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike
from scipy.special import chdtri

from seqrsm.arrays import FloatArray, IntArray
from seqrsm.decide.sources import discrepancy_sd
from seqrsm.design.quadratic import QuadraticModel
from seqrsm.store.records import EventRecord

MEASURED = "worlds"
"""Kind of the event that keeps a bundle's scores."""

RANKED = "values"
"""Kind of the event that keeps what knowing covers would leave, and what the ground does to other levels."""

N_WORLDS, OCCASIONS = 16, 2
LEVEL_WORLDS = 8
"""Worlds in which other levels of categorical factors are held against the recommended ones."""

COVERS = 3
"""Of which is told what knowing them would bring."""
FEW_WORLDS = 4
"""After which covers that hardly moved the score are left out, see `still_ranked`."""
_TOO_LITTLE = 0.1  # of what the third cover did

MOST_SHARE = 0.98
"""Of a run's variance, the most that is told to be the ground's."""

_PARTS = 100
_FUTURE_PARTS = 30


@dataclass(frozen=True, slots=True)
class Ground:
    """Two parts of the scatter of one simulated run, score units."""

    sd_ground: float
    sd_chance: float
    """Standard deviation from world to world, and from occasion to occasion in one world: estimates without bias of the
    variance, 0 where it would be negative."""
    n_worlds: int
    n_simulations: int
    """Of the bundle that they were measured by."""
    share: float
    """Share of a run's variance that is the ground's, 0 to 0.98: the mean of what the scores leave possible, since few
    worlds tell it to a tenth or two and too small a share makes intervals too short."""

    @property
    def variance(self) -> float:
        """Of a simulated run: both parts together."""
        return self.sd_ground**2 + self.sd_chance**2


def ground_of_scores(scores: ArrayLike) -> Ground:
    """Analysis of variance of scores (worlds, occasions), at least two of each, or (settings, worlds, occasions)."""
    y = np.asarray(scores, dtype=np.float64)
    *groups, worlds, m = y.shape
    n_worlds = math.prod(groups) * worlds
    of_means, within = _variances(y)
    total = of_means + within * (1.0 - 1.0 / m)
    share = _share(total, n_worlds - math.prod(groups), within, n_worlds * (m - 1))
    return Ground(float(np.sqrt(max(total - within, 0.0))), float(np.sqrt(within)), n_worlds, y.size, share)


def _variances(scores: FloatArray) -> tuple[float, float]:
    """Variance of the means of a world's occasions, and in worlds, of scores (..., worlds, occasions); 0 of one."""
    within = float(np.mean(np.var(scores, axis=-1, ddof=1))) if scores.shape[-1] > 1 else 0.0
    return float(np.mean(np.var(np.mean(scores, axis=-1), axis=-1, ddof=1))), within


def _share(total: float, df: int, chance: float, df_chance: int) -> float:
    """Mean share of the ground in a variance, both it and chance's with scaled inverse chi-squared distributions."""
    parts = _middles(_PARTS)
    whole = total * df / chdtri(df, parts)
    rest = chance * df_chance / chdtri(df_chance + 2, parts)[:, None]  # two more: with the estimate as its mean
    share = 1.0 - np.divide(rest, whole, out=np.ones((_PARTS, _PARTS)), where=whole > 0.0)
    return min(float(np.mean(np.maximum(share, 0.0))), MOST_SHARE)


def _middles(n: int) -> FloatArray:
    """Probabilities (n,) in the middles of equal parts, which stand for a distribution."""
    return (np.arange(n) + 0.5) / n


def prior_of_difference(ground: Ground, model: QuadraticModel, points: FloatArray) -> float:
    """Prior standard deviation of the mean difference between flights and simulations over the region, score units.

    The real ground is one world: with this prior the difference has the variance of worlds, on average over the
    settings that were run, coded ``points`` (n, k), in place of a guess (`seqrsm.decide.sources`).
    """
    size = np.sum(np.square(model.matrix(points) * discrepancy_sd(model, 1.0)), axis=1)
    return float(ground.sd_ground / np.sqrt(np.mean(size)))


def left_of_ground(scores: FloatArray, elsewhere: FloatArray, variance: float) -> tuple[float, float]:
    """Share of a ``variance`` between grounds that knowing some covers would leave at least; its standard error.

    ``scores`` and ``elsewhere`` (worlds,) of the same occasion of each world, so that chance is in both alike; in the
    latter these covers' own parts are as in another world: Jansen's estimate of their total effect (Saltelli et al.
    2010, Comput. Phys. Commun. 181, 259, table 2). Knowing them takes off no more, and less where the score rests on
    how they differ from others: covers are told apart by that.
    """
    total = 0.5 * np.square(scores - elsewhere) / variance
    return max(1.0 - float(total.mean()), 0.0), float(total.std(ddof=1)) / math.sqrt(len(total))


def still_ranked(moved: FloatArray) -> IntArray:
    """Which covers to go on with, by what each did (covers, worlds) to the score in few worlds.

    Those whose squares come to a tenth of the third largest at least. The same three are then found in 91 to 98 % of
    sets of worlds, the first in 99 % (``tests/studies/ranking_study.py``).
    """
    so_far = np.nansum(np.square(moved), axis=1)
    return np.flatnonzero(so_far >= _TOO_LITTLE * np.sort(so_far)[-COVERS:][0])


def future_sd(scores: FloatArray, runs: float) -> float:
    """Standard deviation of the mean of ``runs`` occasions over one ground, of scores or differences of scores.

    ``scores`` (worlds, occasions): the variance of means of a world's occasions is the ground's and a share of chance;
    with another number of occasions the share changes by what the scores within worlds tell.
    """
    of_means, within = _variances(scores)
    return math.sqrt(max(of_means + within * (1.0 / runs - 1.0 / scores.shape[1]), within / runs))


def future_sds(scores: FloatArray, runs: float) -> FloatArray:
    """What `future_sd` may be (m,), one as probable as the other: both variances as in `_share`.

    Few worlds leave open how much of the variance of their means is chance, less of which counts in the future.
    Student's t takes no account of that: its intervals of 95 % hold 85 to 94 % where most of the variance is chance.
    """
    worlds, occasions = scores.shape
    parts, df = _middles(_FUTURE_PARTS), worlds * (occasions - 1)
    of_means, within = _variances(scores)
    whole = of_means * (worlds - 1) / chdtri(worlds - 1, parts)
    if not df:
        return np.asarray(np.sqrt(whole))
    chance = within * df / chdtri(df + 2, parts)[:, None]
    ground = whole - chance / occasions
    possible = ground >= 0.0 if (ground >= 0.0).any() else np.ones_like(ground, dtype=np.bool_)
    return np.asarray(np.quantile(np.sqrt(np.maximum(ground, 0.0) + chance / runs)[possible], parts))


def sds_of_levels(
    events: Sequence[EventRecord], application: str, settings: Mapping[str, float | str]
) -> dict[tuple[str, str], float]:
    """By factor and level, the standard deviation from ground to ground of what it gains over these settings.

    Empty where it was not measured for them. ``events`` are of the kind `RANKED`.
    """
    found = [e.detail for e in events if e.detail and e.detail.get("application") == application]
    of_these = [one["levels"] for one in found if one["settings"] == settings and "levels" in one]
    return {(one["factor"], one["level"]): one["sd"] for one in of_these[-1]} if of_these else {}


def measured_ground(events: Sequence[EventRecord], application: str) -> Ground | None:
    """What the last bundle says of an application; None without one."""
    found: list[Any] = [e.detail["scores"] for e in events if e.detail and e.detail.get("application") == application]
    return ground_of_scores(found[-1]) if found else None
