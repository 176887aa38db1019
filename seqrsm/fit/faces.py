"""Exact maximum of a quadratic on the cube [-1, 1]^q, by its active bounds or by enumeration of its 3^q faces.

The maximiser of a quadratic on a box is a stationary point of the quadratic restricted to one of the faces: each
coordinate is free, at -1 or at +1. All faces with the same set of free coordinates share one matrix, so the work is
2^q factorisations with many right-hand sides, for any number of quadratics at once. A quadratic that is clearly
concave has one maximum, which its active bounds prove without enumeration.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from functools import lru_cache
from itertools import combinations, product

import numpy as np

from seqrsm.arrays import BoolArray, FloatArray, IntArray
from seqrsm.design.quadratic import QuadraticModel, Quadratics
from seqrsm.design.region import Region


def slices(model: QuadraticModel, region: Region, betas: FloatArray) -> Iterator[tuple[FloatArray, Quadratics]]:
    """Each combination of categories and discrete values: m surfaces there as quadratics in the continuous factors.

    Before them a template (k,): the combination, continuous entries 0.
    """
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
            level = constant + linear[:, held] @ d + np.sum((square @ d) * d, axis=1)
            yield template, Quadratics(level, linear[:, free] + 2.0 * cross @ d, inner)


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


def stacked(pieces: Iterable[tuple[FloatArray, Quadratics]]) -> tuple[list[FloatArray], Quadratics]:
    """Templates of all slices, and their quadratics together, slice by slice."""
    templates, forms = zip(*pieces, strict=True)
    return list(templates), Quadratics(*(np.concatenate(parts) for parts in zip(*forms, strict=True)))


# A pivot below this share of the largest coefficient is no curvature: the ridge then runs into a smaller face, which is
# enumerated as well, and the value lost is at most this share.
_FLAT_PIVOT = 1e-11
_INSIDE = 1e-12
_CHUNK = 4096
# Concave by this share of the largest coefficient: one maximum, and nothing tied with it that could be told from it.
_CURVED_PIVOT = 1e-4
_ACTIVE_SET_ROUNDS = 12


def _concave(quadratic: FloatArray, scale: FloatArray, share: float = _FLAT_PIVOT) -> BoolArray:
    """Which of the matrices (m, f, f) are negative definite, by the pivots of L D L' of their negatives."""
    work = -quadratic
    size = work.shape[-1]
    good = np.ones(len(work), dtype=bool)
    for j in range(size):
        pivot = work[:, j, j]
        good &= pivot > share * scale
        if j + 1 == size or not good.any():
            break
        safe = np.where(good, pivot, 1.0)
        column = work[:, j + 1 :, j]
        work[:, j + 1 :, j + 1 :] -= column[:, :, None] * (column[:, None, :] / safe[:, None, None])
    return good


def _scale(forms: Quadratics) -> FloatArray:
    """Largest coefficient of each of m quadratics."""
    of_squares = np.abs(forms.quadratic).max(axis=(1, 2), initial=0.0)
    found: FloatArray = np.maximum(of_squares, np.abs(forms.linear).max(axis=1, initial=0.0))
    return found


def well_curved(forms: Quadratics) -> BoolArray:
    """Which of m quadratics are so clearly concave that they have one maximum on the cube and no ridge."""
    return _concave(forms.quadratic, _scale(forms), _CURVED_PIVOT)


def _active_set(forms: Quadratics) -> tuple[FloatArray, BoolArray]:
    """Maxima of concave quadratics on the cube by guesses of the active bounds, and which are proved.

    Each round solves for the free coordinates with the others at their bounds, then frees bounds whose multiplier has
    the wrong sign and binds coordinates that left the cube (Hintermueller, Ito & Kunisch 2002, SIAM J. Optim. 13,
    865-888). A guess that reproduces itself fulfils the conditions of Karush, Kuhn and Tucker, which prove the maximum
    of a concave function; one that does not within some rounds is left to enumeration.
    """
    _, linear, quadratic = forms
    m, q = linear.shape
    side = np.zeros((m, q))
    points = np.zeros((m, q))
    proved = np.zeros(m, dtype=np.bool_)
    todo = np.arange(m)
    unit = np.eye(q)
    for _ in range(_ACTIVE_SET_ROUNDS):
        held = side[todo] != 0.0
        matrix = np.where(held[:, :, None], unit, -2.0 * quadratic[todo])
        x = np.linalg.solve(matrix, np.where(held, side[todo], linear[todo])[:, :, None])[..., 0]
        slope = linear[todo] + 2.0 * (quadratic[todo] @ x[:, :, None])[..., 0]
        outside = np.where(np.abs(x) > 1.0 + _INSIDE, np.sign(x), 0.0)
        after = np.where(held, np.where(slope * side[todo] >= 0.0, side[todo], 0.0), outside)
        same = np.all(after == side[todo], axis=1)
        points[todo[same]], proved[todo[same]] = np.clip(x[same], -1.0, 1.0), True
        side[todo] = after
        todo = todo[~same]
        if not len(todo):
            break
    return points, proved


def face_maxima(forms: Quadratics) -> Iterator[tuple[IntArray, FloatArray, FloatArray]]:
    """Stationary points of m quadratics on every face of the cube on which they can have a maximum.

    A face on which one is not strictly concave is left out for it: its maximum there, if any, is also attained on a
    smaller face. By sets of f faces with the same free coordinates: which quadratics (r,), their points (r, f, q),
    clipped to the cube, and the values there (r, f), -inf where the stationary point lies outside the face.
    """
    _, linear, quadratic = forms
    m, q = linear.shape
    scale = _scale(forms)
    for size in range(q + 1):
        signs = np.array(list(product((-1.0, 1.0), repeat=q - size))).reshape(2 ** (q - size), q - size)
        for free_set in combinations(range(q), size):
            free = np.array(free_set, dtype=np.int64)
            fixed = np.setdiff1d(np.arange(q), free)
            block = quadratic[:, free[:, None], free]
            rows = np.flatnonzero(_concave(block, scale)) if size else np.arange(m)
            if not len(rows):
                continue
            points = np.empty((len(rows), len(signs), q))
            points[:, :, fixed] = signs
            inside = np.ones((len(rows), len(signs)), dtype=bool)
            if size:
                cross = quadratic[rows][:, free[:, None], fixed]
                right = linear[rows][:, free, None] + 2.0 * cross @ signs.T
                solution = np.linalg.solve(-2.0 * block[rows], right).transpose(0, 2, 1)
                inside = np.all(np.abs(solution) <= 1.0 + _INSIDE, axis=-1)
                points[:, :, free] = np.clip(solution, -1.0, 1.0)
            values = forms.take(rows).values(points)
            yield rows, points, np.where(inside, values, -np.inf)


def cube_maxima(forms: Quadratics) -> tuple[FloatArray, FloatArray]:
    """Global maximum of each of m quadratics on the cube [-1, 1]^q: a maximiser (m, q), and its value (m,).

    q = 0 is allowed.
    """
    m, q = forms.linear.shape
    best_points = np.zeros((m, q))
    best_values = np.full(m, -np.inf)
    left = np.arange(m)
    if q > 1:
        curved = np.flatnonzero(well_curved(forms))
        points, proved = _active_set(forms.take(curved))
        done = curved[proved]
        best_points[done] = points[proved]
        best_values[done] = forms.take(done).values(best_points[done][:, None, :])[:, 0]
        left = np.setdiff1d(left, done, assume_unique=True)
    # Small chunks keep the arrays of one face set in the cache.
    step = max(64, _CHUNK >> max(0, q - 4))
    for start in range(0, len(left), step):
        part = left[start : start + step]
        points, values = best_points[part], best_values[part]
        for rows, found, found_values in face_maxima(forms.take(part)):
            face = np.argmax(found_values, axis=1)
            value = found_values[np.arange(len(rows)), face]
            better = value > values[rows]
            values[rows[better]] = value[better]
            points[rows[better]] = found[better, face[better]]
        best_points[part], best_values[part] = points, values
    return best_points, best_values
