"""Where a next run may be: points that cover the region, a cloud around the optimum, and settings run before."""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from seqrsm.arrays import BoolArray, FloatArray, first_of_largest
from seqrsm.design.region import Region
from seqrsm.propose.known import Evidence, Known, Rows

_COVERING, _CLOUD = 2000, 320
_BARRED_RADIUS = 0.1
_REFINE_RADII = (0.1, 0.03, 0.01)
_REFINE_POINTS = 48


@dataclass(frozen=True, slots=True)
class Source:
    """Who makes the next runs: what a run of theirs tells, and costs."""

    rows: Rows | None = None
    """Model rows of new runs, where these are not simply those of the model."""
    weight: float = 1.0
    """Relative weight of a new run."""
    cost: float = 1.0
    """> 0: divides the gain."""


AGAIN = "; repeats settings run or proposed before"
"""To be added to the reason of a run whose settings were."""


@dataclass(frozen=True, slots=True)
class Choice:
    """One candidate: its coded settings (k,), model row (p,), gain per cost, and whether it was run already."""

    point: FloatArray
    row: FloatArray
    gain: float
    executed: bool

    @property
    def again(self) -> str:
        """`AGAIN` where it does."""
        return AGAIN * self.executed


@dataclass(frozen=True, slots=True)
class Candidates:
    """Coded settings (n, k) with their model rows (n, p), and whether they were run already."""

    points: FloatArray
    rows: FloatArray
    executed: BoolArray

    def choice(self, index: int, gain: float) -> Choice:
        """One of them, with its gain per cost."""
        return Choice(self.points[index].copy(), self.rows[index], float(gain), bool(self.executed[index]))


class Search:
    """The candidates of one batch; settings chosen can be repeated from then on."""

    def __init__(self, known: Known, source: Source, rng: np.random.Generator, evidence: Evidence) -> None:
        self.known, self.source, self.rng = known, source, rng
        self._region = known.region
        self._barred = evidence.barred
        done = np.empty((0, known.region.k)) if evidence.points is None else np.asarray(evidence.points)
        points, executed = _candidate_points(known, done, rng)
        allowed = clear_of(points, self._barred, self._region)
        if allowed.any():
            points, executed = points[allowed], executed[allowed]
        self.candidates = self._evaluate(points, executed)

    def best(self, gain: Rows, allowed: BoolArray) -> Choice:
        """Best allowed candidate by ``gain`` of rows; one that was not run yet is moved a little where that gains."""
        here = self.candidates
        gains = np.where(allowed, gain(here.rows) / self.source.cost, -np.inf)
        index = first_of_largest(gains)
        found = here.choice(index, gains[index])
        if found.executed or not self._region.continuous:
            return found
        for radius in _REFINE_RADII:
            near = self._region.jitter(np.repeat(found.point[None, :], _REFINE_POINTS, axis=0), radius, self.rng)
            # Settings with three decimals of the coded range are all that a sensor can be told apart by.
            near = near[self._region.feasible(near, tol=0.0) & clear_of(near, self._barred, self._region)]
            if not len(near):
                continue
            moved = self._evaluate(near, np.zeros(len(near), dtype=bool))
            gains = gain(moved.rows) / self.source.cost
            index = first_of_largest(gains)
            if gains[index] > found.gain:
                found = moved.choice(index, gains[index])
        return found

    def take(self, point: FloatArray, repeats: bool) -> None:
        """Count a run at these settings as made; they can be repeated from now on."""
        new = self._evaluate(point[None, :], np.ones(1, dtype=bool))
        self.known.take(new.rows[0], repeats)
        if repeats:
            return
        old = self.candidates
        # The same point may be among the candidates as one not run yet.
        other = ~np.all(old.points == point, axis=1)
        self.candidates = Candidates(
            np.vstack([old.points[other], new.points]),
            np.vstack([old.rows[other], new.rows]),
            np.concatenate([old.executed[other], new.executed]),
        )

    def _evaluate(self, points: FloatArray, executed: BoolArray) -> Candidates:
        rows = self.source.rows or self.known.model.matrix
        return Candidates(points, self.known.padded(rows(points)), executed)


def clear_of(points: FloatArray, barred: FloatArray | None, region: Region) -> BoolArray:
    """Points (n, k) that are not beside settings that could not be carried out, ``barred`` (b, k)."""
    if barred is None:
        return np.ones(len(points), dtype=np.bool_)
    free = list(region.continuous)
    held = [j for j in range(region.k) if j not in free]
    near = np.all(np.abs(points[:, None, free] - barred[None, :, free]) <= _BARRED_RADIUS, axis=-1)
    same = np.all(np.abs(points[:, None, held] - barred[None, :, held]) < 1e-9, axis=-1)
    clear: BoolArray = ~np.any(near & same, axis=1)
    return clear


@lru_cache(maxsize=8)
def _cover(region: Region) -> FloatArray:
    points = region.candidates(limit=_COVERING)
    points.setflags(write=False)
    return points


def _cloud(region: Region, x_hat: FloatArray, targets: FloatArray, rng: np.random.Generator) -> FloatArray:
    """Points around the estimated optimum and the draws of it; discrete levels and categories sometimes change."""
    half = _CLOUD // 2
    centres = np.vstack([np.repeat(x_hat[None, :], half, axis=0), targets[rng.integers(len(targets), size=half)]])
    radius = np.exp(rng.uniform(np.log(0.05), np.log(0.5), size=(len(centres), 1)))
    points = region.jitter(centres, radius, rng)
    axes = region.axes
    for j in (*region.discrete, *region.categorical):
        levels = axes[j]
        if levels is None:
            continue
        change = rng.random(len(points)) < 0.25
        points[change, j] = levels[rng.integers(len(levels), size=int(change.sum()))]
    return points


def _candidate_points(known: Known, done: FloatArray, rng: np.random.Generator) -> tuple[FloatArray, BoolArray]:
    """Candidates (n, k), distinct and feasible, executed ones first; and which were executed (n,).

    They are points that cover the region, the optimum and draws of it, a cloud, and the settings ``done`` (r, k).
    """
    region, x_hat, targets = known.region, known.x_hat, known.targets
    fresh = np.vstack([_cover(region), x_hat[None, :], targets, _cloud(region, x_hat, targets, rng)])
    # Executed settings are compared as they were coded; only those still allowed can be repeated.
    points = np.vstack([done, fresh])
    executed = np.arange(len(points)) < len(done)
    keep = np.sort(np.unique(np.round(points, 9) + 0.0, axis=0, return_index=True)[1])
    keep = keep[region.feasible(points[keep])]
    return points[keep], executed[keep]
