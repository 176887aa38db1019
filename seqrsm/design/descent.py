"""All continuous coordinates of a design moved downhill together, within the region."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
from scipy.optimize import minimize

from seqrsm.arrays import FloatArray
from seqrsm.design import search
from seqrsm.design.quadratic import QuadraticModel
from seqrsm.design.region import Region

_ITERATIONS, _GAIN = 100, 1e-12  # at most, and of the last
_RIDGE = 1e-10  # share of the mean diagonal of M added to it: a singular design has a huge variance, not none
_DIFFERENCE = 1e-6


def covariance(M: FloatArray) -> FloatArray:
    """Inverse of M (p, p), of one that is next to singular too."""
    return np.asarray(np.linalg.inv(M + _RIDGE * float(np.trace(M)) / len(M) * np.eye(len(M))))


def in_coordinates(model: QuadraticModel, region: Region, base: FloatArray, pulled: FloatArray) -> FloatArray:
    """Slope (n, c) in the continuous coordinates, from that in the rows (n, p) of the model matrix.

    ``base`` are the base columns of the design, of which each term is a product of two.
    """
    slope = np.zeros_like(base.T)
    np.add.at(slope, model.first, (pulled * base[:, model.second]).T)
    np.add.at(slope, model.second, (pulled * base[:, model.first]).T)
    return slope[[model.columns[j].start for j in region.continuous]].T


def lower(region: Region, start: FloatArray, value: Callable[[FloatArray], tuple[float, FloatArray]]) -> FloatArray:
    """The design (n, k) moved downhill in ``value``, which gives its slope (n, c) too.

    By scipy's L-BFGS-B in a box, by SLSQP within constraints.
    """
    free = list(region.continuous)
    if not free:
        return start

    def design(x: FloatArray) -> FloatArray:
        points = start.copy()
        points[:, free] = x.reshape(-1, len(free))
        return points

    def valued(x: FloatArray) -> tuple[float, FloatArray]:
        found, slope = value(design(x))
        return found, slope.ravel()

    def slacks(x: FloatArray) -> FloatArray:
        return np.nan_to_num(region.slacks(design(x)), nan=-1.0, posinf=1.0, neginf=-1.0).ravel()

    def slack_slopes(x: FloatArray) -> FloatArray:
        n, c = len(start), len(free)
        here, slopes = slacks(x).reshape(n, -1), np.zeros((n, len(region.constraints), n, c))
        for column in range(c):
            moved = x.reshape(n, c).copy()
            # Inwards, so that a logarithm or root is not asked beyond the bound.
            step = np.where(moved[:, column] > 0.0, -_DIFFERENCE, _DIFFERENCE)
            moved[:, column] += step
            slopes[range(n), :, range(n), column] = (slacks(moved).reshape(n, -1) - here) / step[:, None]
        return slopes.reshape(-1, n * c)

    constraints: Any = () if region.is_box else ({"type": "ineq", "fun": slacks, "jac": slack_slopes},)
    options: Any = {"maxiter": _ITERATIONS, "ftol": _GAIN}
    found = minimize(
        valued,
        start[:, free].ravel(),
        jac=True,
        method="SLSQP" if constraints else "L-BFGS-B",
        bounds=[(-1.0, 1.0)] * (len(start) * len(free)),
        constraints=constraints,
        options=options,
    )
    moved = design(np.clip(found.x, -1.0, 1.0))
    out = region.slack(moved) < 0.0
    moved[out] = search.bisect(start[out], moved[out], region.slack)
    return moved
