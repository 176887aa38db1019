"""Moments of the model's terms over the region: the weights W of the I criterion tr(W (Z'Z)^-1)."""

from __future__ import annotations

import numpy as np

from seqrsm.arrays import FloatArray
from seqrsm.design import search
from seqrsm.design.quadratic import QuadraticModel
from seqrsm.design.region import Region

_SEQUENCE = 1 << 17
_ENOUGH = 1000
_SEED = 33_391


def region_moments(model: QuadraticModel, region: Region) -> FloatArray:
    """Return the mean of z(x) z(x)' over the region, shape (p, p).

    Coded continuous factors are uniform on [-1, 1], levels of discrete and categorical factors equally likely. Exact
    for a box (E x^2 = 1/3, E x^4 = 1/5, E x^2 y^2 = 1/9); for a constrained region the mean over the feasible part
    of an even sequence of 131072 points, relative error about 1e-3.
    """
    if region.is_box:
        return np.asarray(np.prod(model.part_moments()[1], axis=0))
    points = search.low_discrepancy(region.axes, _SEQUENCE)
    points = points[region.slack(points) >= 0.0]
    if points.shape[0] < _ENOUGH:
        points = region.sample(_ENOUGH, np.random.default_rng(_SEED))
    Z = model.matrix(points)
    W: FloatArray = Z.T @ Z / points.shape[0]
    return W
