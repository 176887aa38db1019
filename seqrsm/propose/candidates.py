"""Where a next run may be: points that cover the region, a cloud around the optimum, and settings run before."""

from __future__ import annotations

from functools import lru_cache

import numpy as np

from seqrsm.arrays import BoolArray, FloatArray, IntArray
from seqrsm.design.region import Region

_CLOUD = 320


@lru_cache(maxsize=8)
def _cover(region: Region, limit: int) -> FloatArray:
    points = region.candidates(limit=limit)
    points.setflags(write=False)
    return points


def jitter(region: Region, points: FloatArray, radius: FloatArray | float, rng: np.random.Generator) -> FloatArray:
    """Points moved at random in their continuous coordinates.

    They are rounded to 0.001 of the coded half-range: finer differences are no different settings of a sensor.

    Parameters
    ----------
    region : Region
    points : ndarray (n, k)
    radius : float or ndarray (n, 1)
        Standard deviation of the moves, coded.
    rng : numpy.random.Generator

    Returns
    -------
    ndarray (n, k)
        Inside the bounds; constraints are not looked at.
    """
    moved = points.copy()
    free = list(region.continuous)
    step = np.asarray(radius) * rng.standard_normal((len(points), len(free)))
    moved[:, free] = np.clip(np.round(points[:, free] + step, 3), -1.0, 1.0)
    return moved


def _cloud(region: Region, x_hat: FloatArray, targets: FloatArray, rng: np.random.Generator) -> FloatArray:
    """Points around the estimated optimum and the draws of it; discrete levels and categories sometimes change."""
    half = _CLOUD // 2
    centres = np.vstack([np.repeat(x_hat[None, :], half, axis=0), targets[rng.integers(len(targets), size=half)]])
    radius = np.exp(rng.uniform(np.log(0.05), np.log(0.5), size=(len(centres), 1)))
    points = jitter(region, centres, radius, rng)
    axes = region.axes
    for j in (*region.discrete, *region.categorical):
        levels = axes[j]
        if levels is None:
            continue
        change = rng.random(len(points)) < 0.25
        points[change, j] = levels[rng.integers(len(levels), size=int(change.sum()))]
    return points


def candidate_points(
    region: Region,
    x_hat: FloatArray,
    targets: FloatArray,
    done: FloatArray,
    rng: np.random.Generator,
    n_candidates: int,
) -> tuple[FloatArray, BoolArray]:
    """Candidates for the next runs.

    Parameters
    ----------
    region : Region
    x_hat : ndarray (k,)
        Estimated optimum.
    targets : ndarray (m, k)
        Posterior draws of it.
    done : ndarray (r, k)
        Executed settings.
    rng : numpy.random.Generator
    n_candidates : int
        Points that cover the region.

    Returns
    -------
    points : ndarray (n, k)
        Distinct and feasible, executed ones first.
    executed : ndarray (n,) of bool
    """
    fresh = np.vstack([_cover(region, n_candidates), x_hat[None, :], targets, _cloud(region, x_hat, targets, rng)])
    # Executed settings are compared as they were coded; only those still allowed can be repeated.
    points = np.vstack([done, fresh])
    executed = np.arange(len(points)) < len(done)
    keep = np.sort(_first_rows(points))
    keep = keep[region.feasible(points[keep], tol=1e-9)]
    return points[keep], executed[keep]


def _first_rows(points: FloatArray) -> IntArray:
    """Index of the first occurrence of every distinct row."""
    _, first = np.unique(np.round(points, 9) + 0.0, axis=0, return_index=True)
    return np.asarray(first, dtype=np.int64)
