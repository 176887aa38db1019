"""Maximum of a quadratic in a region cut by constraints: monotone climbs that never leave the region.

Every point handed out was checked by :meth:`Region.feasible`. A step that would leave the region is drawn back towards
a feasible anchor by root finding, so that the climb can follow curved boundaries.
"""

from __future__ import annotations

import numpy as np
import scipy

from seqrsm.arrays import FloatArray
from seqrsm.design.quadratic import Quadratics
from seqrsm.design.region import Region

_ROOT_STEPS, _MOST_ROUNDS = 9, 5
_FIRST_STEP, _LAST_STEP = 0.3, 1e-4
_DIFFERENCE, _NEARLY_ACTIVE = 1e-6, 1e-3


def retract(region: Region, points: FloatArray, anchors: FloatArray) -> FloatArray:
    """Draw infeasible points (m, k) towards feasible anchors (m, k) until they are feasible; the others stay.

    Points lie on the segments. Each equals its anchor in the discrete and categorical columns.
    """
    result = points.copy()
    slack = region.slack(points)
    rows = np.flatnonzero(slack < 0.0)
    if not len(rows):
        return result
    outside, inside = points[rows], anchors[rows]
    # False position with the Illinois halving; the feasible end is what is returned, however far it got.
    low, high = np.zeros(len(rows)), np.ones(len(rows))
    slack_low, slack_high = slack[rows], np.maximum(region.slack(inside), 0.0)
    last = np.zeros(len(rows))
    for _ in range(_ROOT_STEPS):
        middle = low + (high - low) * np.clip(-slack_low / (slack_high - slack_low), 0.02, 0.98)
        slack = region.slack(outside + middle[:, None] * (inside - outside))
        good = slack >= 0.0
        side = np.where(good, 1.0, -1.0)
        again = side == last
        high, slack_high = np.where(good, middle, high), np.where(good, slack, slack_high)
        low, slack_low = np.where(good, low, middle), np.where(good, slack_low, slack)
        slack_low = np.where(again & good, 0.5 * slack_low, slack_low)
        slack_high = np.where(again & ~good, 0.5 * slack_high, slack_high)
        last = side
    # At high = 1 the sum may differ from the anchor by rounding.
    drawn = np.where(high[:, None] == 1.0, inside, outside + high[:, None] * (inside - outside))
    result[rows] = drawn
    return result


def climb(
    region: Region,
    forms: Quadratics,
    starts: FloatArray,
    anchors: FloatArray,
    rng: np.random.Generator,
    steps: int = 40,
) -> tuple[FloatArray, FloatArray]:
    """Improve feasible points ``starts`` (m, k), each for its own quadratic: points, never worse, and values (m,).

    The m ``forms`` are in the continuous factors, the other columns held. A step along a curved boundary is drawn back
    towards ``anchors`` (m, k), feasible points well inside at the same levels. Of ``steps`` each row has its own
    length, which grows on success and shrinks on failure; ``rng`` is for the random directions.
    """
    free = list(region.continuous)
    points = starts.copy()
    values = forms.values(points[:, None, free])[:, 0]
    length = np.full(len(points), _FIRST_STEP)
    for step in range(steps):
        x = points[:, free]
        gradient = forms.linear + 2.0 * (forms.quadratic @ x[:, :, None])[..., 0]
        # Along the boundary, across it, and now and then anywhere: no direction is jammed at a corner for ever.
        kind = ("tangent", "gradient", "tangent", "random")[step % 4]
        if kind == "gradient":
            direction = gradient
        elif kind == "tangent":
            direction = _tangent(region, points, free, gradient)
        else:
            drawn = rng.standard_normal(x.shape)
            direction = drawn * np.where(np.sum(drawn * gradient, axis=1) < 0.0, -1.0, 1.0)[:, None]
        norm = np.linalg.norm(direction, axis=1, keepdims=True)
        direction = direction / np.where(norm > 0.0, norm, 1.0)
        trial = points.copy()
        trial[:, free] = np.clip(x + length[:, None] * direction, -1.0, 1.0)
        trial = retract(region, trial, points if kind == "gradient" else anchors)
        found = forms.values(trial[:, None, free])[:, 0]
        better = found > values
        points[better], values[better] = trial[better], found[better]
        length = np.clip(length * np.where(better, 1.6, 0.6), _LAST_STEP, 1.0)
    return points, values


def _tangent(region: Region, points: FloatArray, free: list[int], gradient: FloatArray) -> FloatArray:
    """Gradient without the parts that lead out of the box or across a constraint that is nearly active."""
    m, c = gradient.shape
    x = points[:, free]
    # Backwards in the upper half, so that a logarithm or root is not asked beyond the bound.
    sign = np.where(x > 0.0, -1.0, 1.0)
    shifted = np.repeat(points[None, :, :], c + 1, axis=0)
    for column, j in enumerate(free):
        shifted[column, :, j] += sign[:, column] * _DIFFERENCE
    slacks = region.slacks(shifted.reshape((c + 1) * m, -1)).reshape(c + 1, m, -1)
    slopes = (slacks[:-1] - slacks[-1]) * (sign / _DIFFERENCE).T[:, :, None]
    normals = np.where(np.isfinite(slopes), slopes, 0.0).transpose(2, 1, 0)
    active = np.where(slacks[-1] < _NEARLY_ACTIVE, 1.0, 0.0).T
    blocked = np.zeros((m, c), dtype=bool)
    along = gradient
    for _ in range(2):
        # A coordinate at its bound is taken out of gradient and normals alike, else the projection undoes it.
        blocked |= ((x >= 1.0) & (along > 0.0)) | ((x <= -1.0) & (along < 0.0))
        along = np.where(blocked, 0.0, gradient)
        units: list[FloatArray] = []
        for normal, is_active in zip(normals, active, strict=True):
            unit = np.where(blocked, 0.0, normal * is_active[:, None])
            for other in units:
                unit = unit - np.sum(unit * other, axis=1, keepdims=True) * other
            length = np.linalg.norm(unit, axis=1, keepdims=True)
            unit = np.divide(unit, length, out=np.zeros_like(unit), where=length > 1e-9)
            along = along - np.minimum(np.sum(along * unit, axis=1, keepdims=True), 0.0) * unit
            units.append(unit)
    return np.where(blocked, 0.0, along)


def line_ascent(region: Region, form: Quadratics, start: FloatArray) -> tuple[FloatArray, float]:
    """Exact maximisation along one continuous coordinate after the other, over its feasible intervals.

    ``form`` is one quadratic in the continuous factors; ``start`` (k,) is feasible. Returns a feasible point (k,),
    never worse than that, and its value.
    """
    _, linear, quadratic = form
    free = list(region.continuous)
    point = start.copy()
    x = point[free]
    value = form.at(x)
    for _ in range(_MOST_ROUNDS):  # it ends when a round gains nothing
        before = value
        for column, j in enumerate(free):
            slope = linear[column] + 2.0 * (quadratic[column] @ x - quadratic[column, column] * x[column])
            curvature = quadratic[column, column]
            intervals = region.line_intervals(point, j)
            tries = intervals.ravel()
            if curvature < 0.0:
                tries = np.concatenate([tries, np.clip(-0.5 * slope / curvature, intervals[:, 0], intervals[:, 1])])
            gains = slope * (tries - x[column]) + curvature * (tries**2 - x[column] ** 2)
            best = int(np.argmax(gains)) if len(gains) else -1
            if best >= 0 and gains[best] > 1e-15 * (1.0 + abs(value)):
                trial = point.copy()
                trial[j] = tries[best]
                if region.feasible(trial[None, :], tol=0.0)[0]:
                    point, x, value = trial, trial[free], value + float(gains[best])
        if value - before <= 1e-13 * (1.0 + abs(value)):
            break
    return point, form.at(x)


def polish(region: Region, form: Quadratics, start: FloatArray) -> tuple[FloatArray, float]:
    """SLSQP on the slacks of constraints, drawn back into the region where it ends outside; else as `line_ascent`."""
    free = list(region.continuous)
    _, linear, quadratic = form

    def full(x: FloatArray) -> FloatArray:
        point = start.copy()
        point[free] = np.clip(x, -1.0, 1.0)
        return point

    def slacks(x: FloatArray) -> FloatArray:
        found: FloatArray = region.slacks(full(x)[None, :])[0]
        return found

    def loss(x: FloatArray) -> float:
        return -form.at(x) / scale

    def slope(x: FloatArray) -> FloatArray:
        found: FloatArray = -(linear + 2.0 * quadratic @ x) / scale
        return found

    scale = max(float(np.abs(linear).max(initial=0.0)), float(np.abs(quadratic).max(initial=0.0)), 1e-300)
    found = scipy.optimize.minimize(
        loss,
        start[free],
        jac=slope,
        bounds=[(-1.0, 1.0)] * len(free),
        constraints=scipy.optimize.NonlinearConstraint(slacks, 1e-13, np.inf),
        method="SLSQP",
        options={"maxiter": 100, "ftol": 1e-14},
    )
    before = form.at(start[free])
    if not np.all(np.isfinite(found.x)):
        return start, before
    point = retract(region, full(found.x)[None, :], start[None, :])[0]
    after = form.at(point[free])
    return (point, after) if after > before else (start, before)
