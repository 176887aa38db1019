"""Runs along the path of steepest ascent of the fitted surface.

Box & Wilson (1951), J. R. Statist. Soc. B 13, 1-45. With a first-order surface the path is a straight line until a
bound stops one of the factors; with a second-order one it bends, and ends at the optimum of the region.
"""

from __future__ import annotations

import numpy as np

from seqrsm.arrays import FloatArray
from seqrsm.design.quadratic import QuadraticModel
from seqrsm.design.region import Region
from seqrsm.fit.optimum import Goal, sign_of

_STEP = 0.02  # coded; far below the spacing of the runs
_STEPS = 400


def ascent_path(
    model: QuadraticModel, region: Region, beta: FloatArray, start: FloatArray, goal: Goal = "maximize"
) -> FloatArray:
    """Path of steepest ascent (descent, to minimise) in the continuous factors.

    Parameters
    ----------
    model, region : QuadraticModel, Region
    beta : ndarray (p,)
        Coded coefficients.
    start : ndarray (k,)
        Feasible; its discrete and categorical factors are held.
    goal : "maximize" or "minimize"

    Returns
    -------
    ndarray (m, k)
        Feasible points from ``start`` on, in steps of 0.02 of the coded half-range; the last is where the surface, a
        bound or a constraint ends the path.
    """
    sign = sign_of(goal)
    free = list(region.continuous)
    path = [np.asarray(start, dtype=np.float64)]
    if not free:
        return np.array(path)
    probe = 1e-4 * np.eye(region.k)[free]
    for _ in range(_STEPS):
        here = path[-1]
        ends = np.vstack([here + probe, here - probe])
        values = sign * (model.matrix(ends) @ beta)
        gradient = values[: len(free)] - values[len(free) :]
        # A factor at a bound that wants further out stays there.
        blocked = (np.abs(here[free]) >= 1.0 - 1e-12) & (np.sign(gradient) == np.sign(here[free]))
        gradient = np.where(blocked, 0.0, gradient)
        size = float(np.linalg.norm(gradient))
        if size <= 1e-12 * max(1.0, float(np.max(np.abs(beta)))):
            break
        after = here.copy()
        after[free] = np.clip(here[free] + _STEP * gradient / size, -1.0, 1.0)
        gain = sign * float(((model.matrix(after[None, :]) - model.matrix(here[None, :])) @ beta)[0])
        if gain <= 0.0 or not region.feasible(after[None, :])[0]:
            break
        path.append(after)
    return np.array(path)


def steepest_points(
    model: QuadraticModel, region: Region, beta: FloatArray, start: FloatArray, n: int, goal: Goal = "maximize"
) -> FloatArray:
    """``n`` points spread evenly over the path, its end included; shape (n, k)."""
    path = ascent_path(model, region, beta, start, goal)
    index = np.round(np.linspace(0, len(path) - 1, n + 1)[1:]).astype(np.int64)
    points: FloatArray = path[index]
    free = list(region.continuous)
    rounded = points.copy()
    rounded[:, free] = np.round(points[:, free], 3)
    good = region.feasible(rounded, tol=0.0)
    return np.where(good[:, None], rounded, points)
