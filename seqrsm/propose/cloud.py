"""Places where the optimum of a process may be, the surface's joint draws there, and the runs that tell most of it."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from copy import deepcopy
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from scipy.linalg.lapack import dpotrf

from seqrsm.arrays import BoolArray, FloatArray, IntArray, first_of_largest
from seqrsm.design.region import Region
from seqrsm.fit.process import FEW, Process
from seqrsm.progress import tell
from seqrsm.propose.batch import Proposal
from seqrsm.propose.candidates import AGAIN, clear_of
from seqrsm.propose.known import percent
from seqrsm.remember import recalled

_COVER = 1000
RADII = (0.15, 0.06, 0.025, 0.01)
_TOPS_OF_DRAW, _TOPS, _NEAR, _PEAK = 3, 12, 2, 20
_ANYWHERE, _FAR, _AGAIN = 40, 20, 40
_FAR_EVERY, _FAR_ENOUGH, _LARGE_BOX = 4, 0.8, 0.4
"""Where runs far from all others are asked for, every fourth is: the box without a run around it is at least a share of
the largest, while that has a side of this share of each factor's range."""
_DRAWS_OF_EACH = 12
_ASIDE = 50
"""For each factor, peaks moved aside along two factors or so, where optima of draws are sought too: random places alone
are far apart where there are many factors."""
_NUGGET = 1e-7
_EQUAL = 1e-9  # of the range of means: such differences are none


def climb(
    mean: Callable[[FloatArray], FloatArray],
    region: Region,
    starts: FloatArray,
    rng: np.random.Generator,
    of_starts: FloatArray | None = None,
    radii: Sequence[float] = RADII,
) -> FloatArray:
    """Places (m, k), the best of ``mean`` first, found from ``starts`` by ever smaller steps and by changes of level.

    ``of_starts`` are the means there, where they are known already.
    """
    pool, values = starts, mean(starts) if of_starts is None else of_starts
    for radius in radii:
        best = np.argsort(-values, kind="stable")[:8]
        near = region.jitter(np.repeat(pool[best], 24, axis=0), radius, rng)
        near = near[region.feasible(near, tol=0.0)]
        pool, values = np.vstack([pool[best], near]), np.append(values[best], mean(near))
        near, found = pool[:0], values[:0]
        while True:
            pool, values = np.vstack([pool, near]), np.append(values, found)
            near = region.at_other_levels(pool[[np.argmax(values)]])
            near = near[region.feasible(near, tol=0.0)]
            # Rounding, which is the processor's, makes no level better.
            if not len(near) or np.max(found := mean(near)) <= np.max(values) + _EQUAL * np.ptp(values):
                break
    return pool[np.argsort(-values, kind="stable")]


def cloud_of(
    process: Process,
    region: Region,
    x_hat: FloatArray,
    made: FloatArray,
    sign: float,
    seed: int | np.random.Generator,
    pending: FloatArray | None = None,
) -> tuple[Cloud, np.random.Generator]:
    """The `Cloud` of a seed, and the generator to draw from it by.

    It is placed once for the intervals of a look and the runs that are proposed after it.
    """

    def placed() -> tuple[Cloud, np.random.Generator]:
        rng = np.random.default_rng(seed)
        return Cloud(process, region, x_hat, made, sign, rng, pending), rng

    cloud, rng = recalled(placed, (process, region, x_hat, made, sign, seed, pending))
    return cloud, deepcopy(rng)


class Cloud:
    """Places round the optima of draws of a process, with the surface's joint distribution there.

    ``points`` (m, k) are coded and feasible, of the executed and pending ones the forty best; ``executed`` (m,) were
    run or are pending. ``means`` (d, m), which rise towards the goal, and ``covariances`` (d, m, m) are those of each
    draw of the hyperparameters, ``mean`` and ``covariance`` those over all. ``noise`` and ``block`` are variances of a
    run of weight 1 and of the effect of a block.
    """

    def __init__(
        self,
        process: Process,
        region: Region,
        x_hat: FloatArray,
        made: FloatArray,
        sign: float,
        rng: np.random.Generator,
        pending: FloatArray | None = None,
    ) -> None:
        """Place the cloud about the recommended settings ``x_hat`` (k,) and the executed ones ``made`` (r, k).

        ``sign`` is 1 where the score is maximized, -1 where minimized; runs at ``pending`` (w, k) have no score yet.
        """
        process = process.some(FEW)
        still = made[region.feasible(made)]
        cover = np.vstack([x_hat[None, :], region.sample(_COVER, rng), still])
        of_draws = sign * process.means(cover)
        heights = of_draws.mean(axis=0)
        tops = np.concatenate([np.argsort(-row, kind="stable")[:_TOPS_OF_DRAW] for row in of_draws])
        tops = np.unique(np.append(tops, np.argsort(-heights, kind="stable")[:_TOPS]))
        near = region.jitter(np.repeat(cover[tops], _NEAR, axis=0), 0.12, rng)
        peak = climb(lambda at: sign * process.mean(at), region, cover, rng, heights)[:_PEAK]
        anywhere = cover[rng.permutation(len(cover))[:_ANYWHERE]]
        runs = made if pending is None else np.vstack([made, pending])
        far = cover[np.argsort(-region.half_sides(cover, runs), kind="stable")[:_FAR]]
        fresh = np.vstack([x_hat[None, :], peak, near, anywhere, far])
        others = region.sample(_ASIDE * region.k, rng)
        moved = rng.random(others.shape) < 2.0 / region.k
        fresh = np.vstack([fresh, np.where(moved, others, peak[rng.integers(len(peak), size=len(others))])])
        fresh = fresh[region.feasible(fresh)]
        still = still[np.argsort(-heights[1 + _COVER :], kind="stable")[:_AGAIN]]
        still = still if pending is None else np.vstack([still, pending])
        both = np.vstack([still, fresh])
        _, first = np.unique(np.round(both, 9) + 0.0, axis=0, return_index=True)
        points = both[first]
        self.points, self.executed = points, first < len(still)
        self.hat = int(np.argmin(np.sum(np.square(points - x_hat), axis=1)))
        means, self.covariances = process.joint(points)
        self.means = sign * means
        apart = self.means - self.means.mean(axis=0)
        self.mean = self.means.mean(axis=0)
        self.covariance = self.covariances.mean(axis=0) + apart.T @ apart / len(means)
        self.noise, self.block = float(process.noise_variance.mean()), float(process.block_variance.mean())

    def draws(self, of_each: int, rng: np.random.Generator) -> FloatArray:
        """Joint draws (d * of_each, m) of the surface, rising towards the goal."""
        found = [
            mean + rng.standard_normal((of_each, len(mean))) @ root.T
            for mean, root in zip(self.means, self._roots, strict=True)
        ]
        return np.vstack(found)

    @cached_property
    def _roots(self) -> list[FloatArray]:
        return [_root(covariance) for covariance in self.covariances]


@dataclass(frozen=True, slots=True)
class Runs:
    """Runs before those that are chosen."""

    settings: FloatArray
    """(r, k): coded, of scored and pending runs."""
    pending: BoolArray | IntArray
    """(r,): 0 of scored runs; of others the new block that they will be made in, 1 being that of the runs to come."""
    barred: FloatArray | None = None
    """(b, k): as of `Evidence`."""


def new_blocks(pending: Iterable[int]) -> list[int]:
    """Numbers of the new blocks, by `Runs.pending`; the last is 1, that of the runs to come."""
    return sorted({1, *pending} - {0}, reverse=True)


def propose_from_process(
    process: Process,
    region: Region,
    x_hat: FloatArray,
    runs: Runs,
    n: int,
    *,
    weight: float = 1.0,
    sign: float = 1.0,
    far: bool = False,
    seed: int = 0,
) -> tuple[Proposal, ...]:
    """Choose the next ``n`` >= 0 runs, each given all before it; arguments that are not told here are those of `Cloud`.

    A run is judged by what it takes, on average over the process's hyperparameters, off the variance of the value at
    the recommended settings, and off the variance of what these lose against the optimum. Where there are blocks, the
    runs are made in one new block, whose effect has to be told from the surface by them.

    New runs have a relative ``weight``. With ``far`` one run in four is chosen among the places that are farthest from
    all runs, while there are large boxes without; none where there are levels alone. Equal inputs and seed give equal
    proposals.
    """
    made, pending = runs.settings, runs.pending
    waits, blocks = pending > 0, new_blocks(pending.tolist())
    cloud, rng = cloud_of(process, region, x_hat, made[~waits], sign, seed, made[waits] if waits.any() else None)
    ahead = _Ahead(cloud.covariance, cloud.noise / weight, cloud.block, len(blocks))
    for point, block in zip(made[waits], pending[waits], strict=True):
        place = int(np.argmin(np.sum(np.square(cloud.points - point), axis=1)))
        ahead.count(place, blocks.index(block) - len(blocks))
    draws = cloud.draws(_DRAWS_OF_EACH, rng)
    best = np.argmax(draws, axis=1)
    inside = region.feasible(cloud.points)  # a pending run need not be
    allowed = clear_of(cloud.points, runs.barred, region) & inside
    allowed = allowed if allowed.any() else inside
    executed = cloud.executed.copy()
    found: list[Proposal] = []
    for i in range(n):
        tell("choosing the next runs", i, n)
        covariance, cross, total = ahead.covariance, ahead.cross, ahead.total
        at_hat = covariance[cloud.hat]
        value = np.square(cross[cloud.hat]) / total
        loss = np.mean(np.square(cross[best] - cross[cloud.hat]), axis=0) / total
        among, box, half = allowed, 0.0, np.zeros(len(allowed))
        if far and region.continuous and (len(made) + i + 1) % _FAR_EVERY == 0:
            half = region.half_sides(cloud.points, np.vstack([made, *(one.point[None, :] for one in found)]))
            box = float(half[allowed].max())
        spread = box >= _LARGE_BOX
        if spread:
            among = allowed & (half >= _FAR_ENOUGH * box)
        chosen = first_of_largest(np.where(among, value + loss, -np.inf))
        of_loss = np.mean(np.diag(covariance)[best] - 2.0 * at_hat[best] + at_hat[cloud.hat])
        narrower = 1.0 - np.sqrt(max(1.0 - value[chosen] / max(at_hat[cloud.hat], 1e-300), 0.0))
        share = loss[chosen] / of_loss if of_loss > 0.0 else 0.0
        why = (
            f"narrows the confidence interval of the mean at the optimum by {percent(float(narrower))}, the "
            f"variance of the loss at these settings by {percent(float(share))}"
        )
        again = bool(executed[chosen])
        purpose = "regret" if loss[chosen] > value[chosen] else "optimum"
        if spread:
            purpose = "spread"
            side = percent(float(half[chosen]))
            why = f"no run so far in the box of {side} of each continuous factor's range around it; {why}"
        gain = float(value[chosen] + loss[chosen])
        found.append(Proposal(cloud.points[chosen].copy(), purpose, gain, why + AGAIN * again, again))
        executed[chosen] = True
        ahead.count(chosen)
    return tuple(found)


def _root(covariance: FloatArray) -> FloatArray:
    """A matrix (m, m) whose product with its transpose is this; of the part above zero where rounding leaves more."""
    raised, m = covariance.copy(), len(covariance)
    raised.flat[:: m + 1] += _NUGGET * max(float(np.trace(covariance)) / m, 1e-300)
    root, failed = dpotrf(raised.T, lower=True, overwrite_a=True)  # half the time of numpy's
    if failed:  # scores without noise: the variance left is less than the rounding of the prior's
        own, vectors = np.linalg.eigh(covariance)
        root = vectors * np.sqrt(np.maximum(own, 0.0))
    return np.asarray(root)


class _Ahead:
    """What is known of the surface at m places, and of new blocks, while runs are counted as made.

    ``cross`` (m, m): covariance of the surface and of the scores that runs of the last block would have, from column to
    column; ``total`` (m,): variance of these scores.
    """

    def __init__(self, covariance: FloatArray, noise: float, block: float, blocks: int = 1) -> None:
        self._all, self._noise = np.pad(covariance, (0, blocks)), noise  # behind the places are the blocks' effects
        self._all[len(covariance) :, len(covariance) :] = block * np.eye(blocks)
        self._m = len(covariance)
        self._see()

    @property
    def covariance(self) -> FloatArray:
        """Of the surface (m, m)."""
        return self._all[: self._m, : self._m]

    def count(self, place: int, block: int = -1) -> None:
        """Count a run there as made in a block, by its place from the end."""
        row = self._all[:, place] + self._all[:, block]
        self._all -= np.outer(row, row) / (max(row[place] + row[block], 0.0) + self._noise)
        self._see()

    def _see(self) -> None:
        self.cross, of_block = self.covariance + self._all[: self._m, -1:], self._all[-1, : self._m] + self._all[-1, -1]
        self.total = np.maximum(np.diag(self.cross) + of_block, 0.0) + self._noise
