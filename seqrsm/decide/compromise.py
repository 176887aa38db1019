"""One design for several applications: how much each gives up, and which designs nothing beats.

RSL TR 380-1 sections 1.1 and 2.0: 'whether there is a different design which will satisfy the combination of
applications, even though to a lesser degree'. The utility of each application becomes a desirability between 0 and 1
(Derringer & Suich 1980, Journal of Quality Technology 12, 214-219), and the compromise is the setting with the largest
weighted geometric mean of them. Cost, build time and risk enter as further desirabilities. Posterior draws of every
surface give the posterior of the compromise and of what each application loses.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from seqrsm.arrays import BoolArray, FloatArray
from seqrsm.design.region import Region
from seqrsm.errors import FitError, Problem
from seqrsm.fit.optimum import Goal, sign_of

Surface = Callable[[FloatArray], FloatArray]
"""Values (n,) at coded points (n, k)."""

_COVER = 3000
_FRONT = 400  # points of the Pareto front that are kept, spread evenly
_CLIMB = ((0.3, 200), (0.15, 200), (0.07, 200), (0.03, 200), (0.01, 200), (0.003, 200))
_LEAST = 1e-6  # of a desirability: a geometric mean of zeros would rank nothing


@dataclass(frozen=True, slots=True)
class Objective:
    """One thing that matters.

    Attributes
    ----------
    name : str
    goal : "maximize" or "minimize"
    weight : float
        Share in the compromise, > 0.
    mean : callable
        Estimated values at coded points.
    draws : callable or None
        Values (m, n) under m posterior draws at coded points (n, k); None where nothing is uncertain, as with a cost.
    unacceptable, ideal : float or None
        Values of desirability 0 and 1; by default the worst and the best of ``mean`` over the region.
    """

    name: str
    goal: Goal
    weight: float
    mean: Surface
    draws: Surface | None = None
    unacceptable: float | None = None
    ideal: float | None = None


@dataclass(frozen=True, slots=True)
class Loss:
    """What one objective gives up at the compromise.

    Attributes
    ----------
    name : str
    value : float
        Estimated value at the compromise.
    own_best : float
        Estimated value at its own optimum.
    own_point : ndarray (k,)
        Its own optimum, coded.
    given_up : float
        ``own_best`` against ``value``, >= 0 when the compromise is worse.
    low, high : float
        Ends of the credible interval of that, over draws each with its own optimum; nan without draws.
    desirability : float
        At the compromise, in [0, 1].
    """

    name: str
    value: float
    own_best: float
    own_point: FloatArray
    given_up: float
    low: float
    high: float
    desirability: float


@dataclass(frozen=True, slots=True)
class Compromise:
    """The compromise over several objectives.

    Attributes
    ----------
    point : ndarray (k,)
        Coded settings.
    desirability : float
        Weighted geometric mean there, in [0, 1].
    given_up : tuple of Loss
        One for each objective.
    draw_points : ndarray (m, k)
        Compromise of each posterior draw; empty without draws.
    expected_shortfall : float
        Mean desirability lost by acting on ``point`` and not on the compromise of the true surfaces; nan without draws.
    front_points : ndarray (f, k)
        Settings that no other setting beats in every objective, from a cover of the region.
    front_values : ndarray (f, objectives)
        Estimated values there.
    """

    point: FloatArray
    desirability: float
    given_up: tuple[Loss, ...]
    draw_points: FloatArray
    expected_shortfall: float
    front_points: FloatArray
    front_values: FloatArray


def desirability(values: FloatArray, goal: Goal, unacceptable: float, ideal: float) -> FloatArray:
    """Desirability in [0, 1]: 0 at ``unacceptable`` and beyond, 1 at ``ideal`` and beyond.

    Parameters
    ----------
    values : ndarray
    goal : "maximize" or "minimize"
    unacceptable, ideal : float
        In the order of the goal; equal ones make every value ideal.

    Returns
    -------
    ndarray
    """
    span = ideal - unacceptable
    if (span > 0.0) != (goal == "maximize") or span == 0.0:
        return np.ones(np.shape(values))
    scaled: FloatArray = np.clip((np.asarray(values) - unacceptable) / span, 0.0, 1.0)
    return scaled


def pareto_front(values: FloatArray, goals: Sequence[Goal]) -> BoolArray:
    """Which rows of ``values`` (n, objectives) no other row beats: at least as good in all, better in one.

    Returns
    -------
    ndarray (n,) of bool
        Of equal rows all or none.
    """
    better = values * np.array([sign_of(goal) for goal in goals])
    order = np.lexsort(-better.T[::-1])
    front = np.zeros(len(values), dtype=np.bool_)
    kept = np.empty((0, better.shape[1]))
    for index in order:
        row = better[index]
        beaten = np.any(np.all(kept >= row, axis=1) & np.any(kept > row, axis=1)) if len(kept) else False
        if not beaten:
            front[index] = True
            kept = np.vstack([kept, row])
    return front


def compromise(region: Region, objectives: Sequence[Objective], *, level: float = 0.95, seed: int = 0) -> Compromise:
    """The setting with the largest weighted geometric mean of desirabilities.

    Parameters
    ----------
    region : Region
    objectives : sequence of Objective
        One or more; those with draws have equally many.
    level : float
        Of the credible intervals.
    seed : int
        Of the search; equal inputs give equal results.

    Returns
    -------
    Compromise

    Raises
    ------
    FitError
        No objective.
    """
    if not objectives:
        raise FitError(Problem("a compromise needs at least one objective", "Add an [[application]]."))
    rng = np.random.default_rng(seed)
    cover = np.vstack([region.candidates(limit=_COVER), region.sample(_COVER // 2, rng)])
    means = np.column_stack([objective.mean(cover) for objective in objectives])
    own_points, limits = [], []
    for i, objective in enumerate(objectives):
        sign = sign_of(objective.goal)
        own_points.append(_climb(region, cover, sign * means[:, i], _signed(objective, sign), rng))
        limits.append(_limits(objective, means[:, i], float(objective.mean(own_points[-1][None, :])[0])))
    weights = np.array([objective.weight for objective in objectives])
    weights = weights / weights.sum()

    def merit(values: FloatArray) -> FloatArray:
        """Weighted log desirability of values (..., objectives)."""
        found: FloatArray = np.zeros(values.shape[:-1])
        for i, (objective, (worst, best)) in enumerate(zip(objectives, limits, strict=True)):
            d = desirability(values[..., i], objective.goal, worst, best)
            found = found + weights[i] * np.log(np.maximum(d, _LEAST))
        return found

    def at(points: FloatArray) -> FloatArray:
        return np.column_stack([objective.mean(points) for objective in objectives])

    point = _climb(region, cover, merit(means), lambda points: merit(at(points)), rng)
    draw_points, shortfall, losses_of_draws = _draws(objectives, cover, point, merit)
    here = at(point[None, :])[0]
    losses = []
    for i, objective in enumerate(objectives):
        sign = sign_of(objective.goal)
        own = own_points[i]
        own_best = float(objective.mean(own[None, :])[0])
        low = high = float("nan")
        if i in losses_of_draws:
            tail = 0.5 * (1.0 - level)
            low, high = (float(x) for x in np.quantile(losses_of_draws[i], [tail, 1.0 - tail]))
        worst, best = limits[i]
        d = float(desirability(here[i : i + 1], objective.goal, worst, best)[0])
        losses.append(
            Loss(objective.name, float(here[i]), own_best, own, sign * (own_best - float(here[i])), low, high, d)
        )
    front = np.flatnonzero(pareto_front(means, [objective.goal for objective in objectives]))
    front = front[np.argsort(means[front, 0], kind="stable")]
    front = front[np.unique(np.linspace(0, len(front) - 1, min(_FRONT, len(front))).astype(np.int64))]
    return Compromise(
        point=point,
        desirability=float(np.exp(merit(here[None, :])[0])),
        given_up=tuple(losses),
        draw_points=draw_points,
        expected_shortfall=shortfall,
        front_points=cover[front],
        front_values=means[front],
    )


def _signed(objective: Objective, sign: float) -> Surface:
    def value(points: FloatArray) -> FloatArray:
        found: FloatArray = sign * objective.mean(points)
        return found

    return value


def _limits(objective: Objective, values: FloatArray, best: float) -> tuple[float, float]:
    """Values of desirability 0 and 1: as given, or the worst of the cover and the objective's own optimum."""
    worst = float(values.min() if objective.goal == "maximize" else values.max())
    return (
        worst if objective.unacceptable is None else objective.unacceptable,
        best if objective.ideal is None else objective.ideal,
    )


def _climb(
    region: Region, cover: FloatArray, values: FloatArray, merit: Surface, rng: np.random.Generator
) -> FloatArray:
    """Best of the cover, improved by random steps that shrink, in the continuous factors."""
    best, reached = cover[int(np.argmax(values))], float(values.max())
    free = list(region.continuous)
    if not free:
        return np.array(best)
    for radius, count in _CLIMB:
        near = np.repeat(best[None, :], count, axis=0)
        near[:, free] = np.clip(near[:, free] + radius * rng.standard_normal((count, len(free))), -1.0, 1.0)
        near = near[region.feasible(near, tol=0.0)]
        if len(near):
            found = merit(near)
            if float(found.max()) > reached:
                best, reached = near[int(np.argmax(found))], float(found.max())
    return np.array(best)


def _draws(
    objectives: Sequence[Objective], cover: FloatArray, point: FloatArray, merit: Callable[[FloatArray], FloatArray]
) -> tuple[FloatArray, float, dict[int, FloatArray]]:
    """Compromise of every draw over the cover, the shortfall of ``point``, and each objective's loss by draw."""
    uncertain = [i for i, objective in enumerate(objectives) if objective.draws is not None]
    if not uncertain:
        return np.empty((0, cover.shape[1])), float("nan"), {}
    points = np.vstack([cover, point])
    tables: dict[int, FloatArray] = {}
    for i in uncertain:
        surface = objectives[i].draws
        assert surface is not None
        tables[i] = surface(points)
    m = min(len(table) for table in tables.values())
    values = np.empty((m, len(points), len(objectives)))
    for i, objective in enumerate(objectives):
        values[:, :, i] = tables[i][:m] if i in tables else objective.mean(points)[None, :]
    of = np.exp(merit(values))
    best = np.argmax(of, axis=1)
    shortfall = float(np.mean(of[np.arange(m), best] - of[:, -1]))
    losses = {}
    for i in uncertain:
        sign = sign_of(objectives[i].goal)
        losses[i] = np.asarray(np.max(sign * values[:, :, i], axis=1) - sign * values[:, -1, i])
    return points[best], shortfall, losses
