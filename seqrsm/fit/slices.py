"""A fitted surface cut into quadratics in the continuous factors, one for each combination of levels."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import lru_cache
from itertools import product

import numpy as np

from seqrsm.arrays import FloatArray
from seqrsm.design.quadratic import QuadraticModel
from seqrsm.design.region import Region


@dataclass(frozen=True, slots=True)
class Slice:
    """Quadratics of m surfaces in the continuous factors at one combination of levels."""

    template: FloatArray  # (k,), continuous entries 0
    constant: FloatArray
    linear: FloatArray
    quadratic: FloatArray


def slices(model: QuadraticModel, region: Region, betas: FloatArray) -> Iterator[Slice]:
    """One slice per combination of categories and discrete values."""
    axes = region.axes
    numeric = list(region.numeric)
    free = np.array([numeric.index(j) for j in region.continuous], dtype=np.int64)
    held = np.array([numeric.index(j) for j in region.discrete], dtype=np.int64)
    values = [axes[j] for j in region.discrete]
    for levels in region.level_combinations():
        constant, linear, quadratic = model.forms(betas, levels)
        inner = quadratic[:, free[:, None], free]
        cross = quadratic[:, free[:, None], held]
        square = quadratic[:, held[:, None], held]
        for combination in product(*(v for v in values if v is not None)):
            d = np.array(combination, dtype=np.float64)
            template = np.zeros(region.k)
            template[list(region.discrete)] = d
            template[list(region.categorical)] = levels
            yield Slice(
                template,
                constant + linear[:, held] @ d + np.sum((square @ d) * d, axis=1),
                linear[:, free] + 2.0 * cross @ d,
                inner,
            )


def full_points(region: Region, template: FloatArray, continuous: FloatArray) -> FloatArray:
    """Points (..., k) with the continuous factors of ``continuous`` (..., c) and the levels of ``template`` (k,)."""
    points = np.broadcast_to(template, (*continuous.shape[:-1], region.k)).copy()
    points[..., list(region.continuous)] = continuous
    return points


@lru_cache(maxsize=8)
def feasible_cover(region: Region) -> FloatArray:
    """Feasible points that reach into every part of a constrained region."""
    rng = np.random.default_rng(20_011)
    points = np.vstack([region.candidates(), region.sample(4000, rng), region.anchors])
    return points[region.feasible(points, tol=0.0)]


def deepest(region: Region, points: FloatArray) -> FloatArray:
    """Return the point (k,) of ``points`` (n, k) that lies deepest inside the constraints."""
    found: FloatArray = points[int(np.argmax(region.slack(points)))]
    return found


def stack(pieces: Sequence[Slice]) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Constants, linear and quadratic parts of all slices in one array each, first axis slice by slice."""
    return (
        np.concatenate([s.constant for s in pieces]),
        np.concatenate([s.linear for s in pieces]),
        np.concatenate([s.quadratic for s in pieces]),
    )
