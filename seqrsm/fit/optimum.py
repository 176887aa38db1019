"""The best settings of a fitted surface: exact over box and levels, guaranteed feasible under constraints.

With b and B of ``c + x'b + x'Bx`` in the continuous factors, each combination of categories and discrete values is a
quadratic on a cube, whose maximum is found by enumeration of faces (:mod:`seqrsm.fit.faces`). That maximum bounds the
constrained one from above; where it is not feasible, climbs from many feasible points take over.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np

from seqrsm.arrays import BoolArray, FloatArray, IntArray
from seqrsm.design.quadratic import QuadraticModel, Quadratics
from seqrsm.design.region import ROUNDING, Region
from seqrsm.fit.constrained import climb, line_ascent, polish
from seqrsm.fit.faces import (
    cube_maxima,
    deepest,
    face_maxima,
    feasible_cover,
    full_points,
    slices,
    stacked,
    well_curved,
)

Goal = Literal["maximize", "minimize"]

_TIE = 1e-9
_MAX_TIES = 64
_STARTS = 24


@dataclass(frozen=True, slots=True)
class Optimum:
    """The optimum of a fitted surface."""

    point: FloatArray
    """(k,): coded settings. Among equally good ones the nearest to the centre."""
    value: float
    """Fitted value there."""
    at_bound: dict[str, str]
    """Numeric factors at an end of their range, and which: "low" or "high"."""
    active_constraints: tuple[str, ...]
    """Expressions of the constraints that hold with equality there."""
    ties: FloatArray
    """(t, k): other settings as good, to 1e-9 of the surface's coefficients."""
    flat: bool
    """Settings between two tied ones are as good as well: the optimum is a ridge, not a point."""
    exact: bool
    """Found by enumeration, hence certain; False where constraints cut the enumerated optimum off, and the point is the
    best of many feasible climbs."""


def sign_of(goal: Goal) -> float:
    """1 where the score is maximized, -1 where minimized: times it, more is better."""
    return 1.0 if goal == "maximize" else -1.0


def optimum(model: QuadraticModel, region: Region, beta: FloatArray, goal: Goal = "maximize") -> Optimum:
    """Global optimum of a fitted surface, of coded coefficients ``beta`` (p,), over the region.

    Exact for a box with any discrete and categorical factors. Under constraints each combination of levels whose
    unconstrained bound could win is searched by 24 feasible climbs, SLSQP from the best of them, and coordinate-wise
    exact line searches over the feasible intervals; the result is feasible and never worse than any candidate of the
    region.
    """
    signed = sign_of(goal) * beta[None, :]
    if not np.any(signed[0, 1:]):  # every setting is as good
        point, ties, flat, exact = region.centre(), np.empty((0, region.k)), True, True
        value = float(signed[0, 0])
    else:
        tied, exact = (_box_optima if region.is_box else _constrained_optima)(model, region, signed)
        point, ties = _choose(region, np.array(tied))
        value = float((model.matrix(point[None, :]) @ signed[0])[0])
        flat = _is_flat(model, region, signed, point, ties)
    return Optimum(
        point=point,
        value=sign_of(goal) * value,
        at_bound=at_bound(region, point),
        active_constraints=active_constraints(region, point),
        ties=ties,
        flat=flat,
        exact=exact,
    )


def at_bound(region: Region, point: FloatArray) -> dict[str, str]:
    """Numeric factors of ``point`` (k,) that lie at an end of their range, and which: "low" or "high"."""
    ends = [j for j in region.numeric if abs(point[j]) >= 1.0 - ROUNDING]
    return {region.names[j]: "high" if point[j] > 0.0 else "low" for j in ends}


def active_constraints(region: Region, point: FloatArray) -> tuple[str, ...]:
    """Expressions of the constraints that hold with equality at ``point`` (k,)."""
    slacks = region.slacks(point[None, :])[0]
    return tuple(c.expr for c, slack in zip(region.constraints, slacks, strict=True) if slack < 1e-6)


def _tolerance(signed: FloatArray) -> float:
    return _TIE * float(np.abs(signed[0, 1:]).sum())


def _choose(region: Region, points: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Split distinct tied points into the one nearest to the centre and the others."""
    _, first = np.unique(np.round(points, 6) + 0.0, axis=0, return_index=True)
    distinct = points[first]
    distance = np.round(np.sum(distinct[:, list(region.numeric)] ** 2, axis=1), 9)
    order = np.argsort(distance, kind="stable")
    return distinct[order[0]], distinct[order[1 : 1 + _MAX_TIES]]


def _is_flat(model: QuadraticModel, region: Region, signed: FloatArray, point: FloatArray, ties: FloatArray) -> bool:
    """Whether the middle between the optimum and a tied point at the same levels is as good and feasible."""
    held = list(region.discrete) + list(region.categorical)
    same = ties[np.all(ties[:, held] == point[held], axis=1)]
    if not len(same):
        return False
    middle = 0.5 * (same + point)
    value = float((model.matrix(point[None, :]) @ signed[0])[0])
    as_good = model.matrix(middle) @ signed[0] >= value - _tolerance(signed)
    return bool(np.any(as_good & region.feasible(middle)))


def _box_optima(model: QuadraticModel, region: Region, signed: FloatArray) -> tuple[list[FloatArray], bool]:
    """Points that are equally good, and whether they are certain: they are."""
    templates, forms = stacked(slices(model, region, signed))
    found_points, values = cube_maxima(forms)
    close = np.flatnonzero(values >= values.max() - _tolerance(signed))[:256]
    limit = float(values.max()) - _tolerance(signed)
    single = well_curved(forms.take(close))
    found = [full_points(region, templates[i], found_points[i]) for i in close[single]]
    close = close[~single]
    for rows, points, face_values in face_maxima(forms.take(close)):
        row, face = np.nonzero(face_values >= limit)
        found += [
            full_points(region, templates[close[rows[i]]], points[i, j])
            for i, j in zip(row[:_MAX_TIES], face[:_MAX_TIES], strict=True)
        ]
    return found, True


def _constrained_optima(model: QuadraticModel, region: Region, signed: FloatArray) -> tuple[list[FloatArray], bool]:
    """Points that are equally good, and whether they are certain."""
    templates, forms = stacked(slices(model, region, signed))
    bound_points, bounds = cube_maxima(forms)
    cover = feasible_cover(region)
    cover_values = model.matrix(cover) @ signed[0]
    tolerance = _tolerance(signed)
    held = list(region.discrete) + list(region.categorical)
    best = int(np.argmax(cover_values))
    limit = float(cover_values[best])
    found = [(limit, cover[best], False)]
    # The largest bound first: once a feasible value exceeds the bounds that are left, these need no search.
    for index in np.argsort(-bounds, kind="stable"):
        if bounds[index] < limit - tolerance:
            break
        exact_point = full_points(region, templates[index], bound_points[index])
        if region.feasible(exact_point[None, :], tol=0.0)[0]:
            found.append((float(bounds[index]), exact_point, True))
        else:
            rows = np.flatnonzero(np.all(cover[:, held] == templates[index][held], axis=1))
            if not len(rows):
                continue
            starts = cover[rows[_spread_starts(cover[rows], cover_values[rows])]]
            point, value = _search_slice(region, forms.take(index), starts, deepest(region, cover[rows]))
            found.append((value, point, False))
        limit = max(limit, found[-1][0])
    tied = [item for item in found if item[0] >= limit - tolerance]
    # A point that reached its enumerated bound is certain even when a climb found it as well.
    return [item[1] for item in tied], any(item[2] for item in tied)


def _spread_starts(points: FloatArray, values: FloatArray) -> IntArray:
    """Indices of good points that do not crowd: the best, then good ones far from those already taken."""
    pool = np.argsort(-values, kind="stable")[:2000]
    spread = max(float(values[pool[0]] - values[pool[-1]]), 1e-300)
    merit = (values[pool] - values[pool[0]]) / spread
    chosen = [0]
    nearest = np.full(len(pool), np.inf)
    for _ in range(min(_STARTS, len(pool)) - 1):
        nearest = np.minimum(nearest, np.linalg.norm(points[pool] - points[pool[chosen[-1]]], axis=1))
        chosen.append(int(np.argmax(np.where(nearest > 0.0, nearest + merit, -np.inf))))
    return np.asarray(pool[np.array(chosen)], dtype=np.int64)


def _search_slice(region: Region, form: Quadratics, starts: FloatArray, anchor: FloatArray) -> tuple[FloatArray, float]:
    forms = Quadratics(*(np.broadcast_to(part, (len(starts), *np.shape(part))) for part in form))
    rng = np.random.default_rng(20_021)
    points, values = climb(region, forms, starts, np.broadcast_to(anchor, starts.shape), rng, steps=16)
    best_point, best_value = points[0], -np.inf
    for row in np.argsort(-values, kind="stable")[:4]:
        point, value = polish(region, form, points[row])
        if value > best_value:
            best_point, best_value = point, value
    # The last word has the exact line search: it also crosses gaps between feasible intervals.
    return line_ascent(region, form, best_point)


def optimum_draws(
    model: QuadraticModel, region: Region, betas: FloatArray, goal: Goal = "maximize"
) -> tuple[FloatArray, FloatArray]:
    """Optimum of each of m surfaces, such as posterior draws: points (m, k), and values (m,) there.

    Exact for a box. Under constraints it is exact for every draw whose box optimum is feasible; the others start from
    the best of a dense set of feasible points at their two most promising combinations of levels and climb from there,
    sharing what was found for the other draws. All points are feasible; a value can fall short of :func:`optimum` by
    some 1e-4 of the surface's range, now and then by 1e-2. Where all coded coefficients ``betas`` (m, p) but the first
    are 0 every setting is as good, and the point is a random one.
    """
    signed = sign_of(goal) * betas
    m = len(signed)
    points, values = np.zeros((m, region.k)), np.full(m, -np.inf)
    if m and region.is_box:
        for template, forms in slices(model, region, signed):
            found, found_values = cube_maxima(forms)
            better = found_values > values
            points[better] = full_points(region, template, found[better])
            values[better] = found_values[better]
    elif m:
        points, values = _constrained_draws(model, region, signed)
    level = ~np.any(signed[:, 1:], axis=1)
    if np.any(level):
        points[level] = region.sample(int(np.count_nonzero(level)), np.random.default_rng(20_029))
    return points, sign_of(goal) * values


def _constrained_draws(model: QuadraticModel, region: Region, signed: FloatArray) -> tuple[FloatArray, FloatArray]:
    pieces = list(slices(model, region, signed))
    cover = feasible_cover(region)
    held = list(region.discrete) + list(region.categorical)
    m = len(signed)
    scores = model.matrix(cover) @ signed.T
    best = np.argmax(scores, axis=0)
    points, values = cover[best].copy(), scores[best, np.arange(m)]
    merit = np.full((len(pieces), m), -np.inf)
    starts, anchors = np.zeros((len(pieces), m, region.k)), np.zeros((len(pieces), region.k))
    for index, (template, forms) in enumerate(pieces):
        found, found_values = cube_maxima(forms)
        full = full_points(region, template, found)
        better = region.feasible(full, tol=0.0) & (found_values > values)
        points[better], values[better] = full[better], found_values[better]
        rows = np.flatnonzero(np.all(cover[:, held] == template[held], axis=1))
        if len(rows):
            top = np.argmax(scores[rows], axis=0)
            starts[index], anchors[index] = cover[rows[top]], deepest(region, cover[rows])
            merit[index] = np.where(found_values > values, scores[rows[top], np.arange(m)], -np.inf)
    rank = np.argsort(np.argsort(-merit, axis=0, kind="stable"), axis=0, kind="stable")
    rng = np.random.default_rng(20_023)
    for index, (_, forms) in enumerate(pieces):
        todo = np.flatnonzero((rank[index] < 2) & np.isfinite(merit[index]))
        if len(todo):
            _improve(region, forms.take(todo), todo, starts[index, todo], anchors[index], points, values, rng)
    return points, values


def _improve(
    region: Region,
    forms: Quadratics,
    todo: IntArray,
    starts: FloatArray,
    anchor: FloatArray,
    points: FloatArray,
    values: FloatArray,
    rng: np.random.Generator,
) -> None:
    """Climb for some draws at one combination of levels; ``points`` and ``values`` are updated in place."""
    constant, linear, quadratic = forms
    inside = np.broadcast_to(anchor, starts.shape)
    found, found_values = climb(region, forms, starts, inside, rng, steps=24)
    # Draws have neighbouring optima: each tries what the others found, then finishes its own climb.
    shared = found[:: max(1, len(found) // 200)]
    x = shared[:, list(region.continuous)]
    table = constant[:, None] + linear @ x.T + np.tensordot(quadratic, x[:, :, None] * x[:, None, :], ((1, 2), (1, 2)))
    other = np.argmax(table, axis=1)
    swap: BoolArray = table[np.arange(len(todo)), other] > found_values
    found[swap] = shared[other[swap]]
    found, found_values = climb(region, forms, found, inside, rng)
    better = found_values > values[todo]
    points[todo[better]], values[todo[better]] = found[better], found_values[better]
