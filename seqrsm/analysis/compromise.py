"""One design for several applications: how much each gives up, and which designs nothing beats.

RSL TR 380-1 sections 1.1 and 2.0: 'whether there is a different design which will satisfy the combination of
applications, even though to a lesser degree'. The utility of each application becomes a desirability between 0 and 1
(Derringer & Suich 1980, Journal of Quality Technology 12, 214-219), and the compromise is the setting with the largest
weighted geometric mean of them. Cost, build time and risk enter as further desirabilities. Posterior draws of every
surface, independent of the others, give the posterior of the compromise and of what each application loses: that scores
of one image may scatter alike is not counted.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from functools import partial
from typing import Any

import numpy as np

from seqrsm.analysis.belief import intervals
from seqrsm.analysis.results import Analysis
from seqrsm.analysis.scale import Interval
from seqrsm.analysis.to_json import fields_to_json
from seqrsm.arrays import BoolArray, FloatArray
from seqrsm.design.constraints import arithmetic
from seqrsm.design.factors import CategoricalFactor, central_range
from seqrsm.design.region import Region
from seqrsm.fit.intervals import known
from seqrsm.fit.optimum import Goal, sign_of
from seqrsm.propose.cloud import climb
from seqrsm.rng import generator
from seqrsm.spec.read import CampaignSpec
from seqrsm.spec.tables import ConsiderationSpec

Surface = Callable[[FloatArray], FloatArray]
"""Values (n,) at coded points (n, k)."""

DRAWS = 200
"""Posterior draws of each surface that the compromise is found for."""

_COVER = 3000
_FRONT = 400  # points of the Pareto front that are kept, spread evenly
_RADII = (0.3, 0.15, 0.07, 0.03, 0.01, 0.003)
_UNACCEPTABLE = -1e9  # in place of log 0: ranks what is unacceptable to some, the lighter first; its exponential is 0


@dataclass(frozen=True, slots=True)
class Objective:
    """One thing that matters."""

    name: str
    goal: Goal

    weight: float
    """Share in the compromise, > 0."""
    mean: Surface
    """Estimated values at coded points, none that there cannot be."""
    draws: Surface | None = None
    """Values (m, n) under m posterior draws at coded points (n, k); None where nothing is uncertain, as with a cost."""
    unacceptable: float | None = None
    ideal: float | None = None
    """Values of desirability 0 and 1; by default the worst and the best of ``mean`` over the region."""
    unit: str = ""

    application: bool = True
    """False for a consideration."""
    optimum: FloatArray | None = None
    """(k,): coded settings of its own optimum, as told elsewhere; by default found here."""
    intervals: Callable[[FloatArray], tuple[Interval, ...]] | None = None
    """Confidence interval of the mean, and prediction interval of one run, at coded settings (k,)."""


@dataclass(frozen=True, slots=True)
class GivenUp:
    """What one application or consideration gives up at the compromise, in its own units."""

    name: str

    value: float
    """Estimated value at the compromise."""
    own_best: float
    """Estimated value at its own optimum."""
    given_up: float
    """``own_best`` against ``value``, >= 0 when the compromise is worse."""
    low: float
    high: float
    """Ends of the credible interval of that, over draws each with its own optimum; nan without draws, as of a
    consideration, whose values are exact."""
    desirability: float
    """At the compromise, in [0, 1]."""
    unit: str

    application: bool
    """False for a consideration."""
    own_settings: dict[str, float | str]
    """Its own optimum, natural units."""
    text: str
    """One sentence."""
    confidence: Interval | None = None
    prediction: Interval | None = None
    """Of the mean, and of one future run, at the compromise; None of a consideration."""

    @property
    def interval(self) -> Interval:
        """Credible interval of ``given_up``."""
        return Interval(self.low, self.high)


@dataclass(frozen=True, slots=True)
class CompromiseEstimate:
    """The compromise over several objectives."""

    point: FloatArray
    """(k,): coded settings."""
    settings: dict[str, float | str]
    """The same in natural units, by factor name."""
    desirability: float
    """Weighted geometric mean there, in [0, 1]."""
    expected_shortfall: float
    """Mean desirability lost by acting on ``point`` and not on the compromise of the true surfaces; nan without
    draws."""
    level: float
    """Of the credible intervals."""
    credible: dict[str, Interval]
    """Credible interval of each numeric factor's setting, natural units; empty without draws."""
    given_up: tuple[GivenUp, ...]
    """One for each objective, applications first."""
    front_settings: tuple[dict[str, float | str], ...]
    """Settings that no other setting beats in every objective, from a cover of the region."""
    front_values: FloatArray
    """(f, objectives): estimated values there."""
    levels: dict[str, dict[str, float]] = field(default_factory=dict)
    """Probability of each level of each categorical factor; empty without draws."""
    warnings: tuple[str, ...] = ()
    """What the summary must say of these settings, as of an analysis."""

    def to_json(self) -> dict[str, Any]:
        """The compromise as a JSON document."""
        return {
            "settings": self.settings,
            "desirability": self.desirability,
            "expected_shortfall": self.expected_shortfall,
            "level": self.level,
            "settings_credible": {name: {"low": i.low, "high": i.high} for name, i in self.credible.items()},
            "levels": self.levels,
            "given_up": [fields_to_json(row) for row in self.given_up],
            "pareto_front": [
                {"settings": settings, "values": values}
                for settings, values in zip(self.front_settings, self.front_values.tolist(), strict=True)
            ],
        }


def campaign_compromise(spec: CampaignSpec, analyses: Sequence[Analysis]) -> CompromiseEstimate | None:
    """The compromise over all applications and considerations; None where there is nothing to weigh."""
    if len(analyses) + len(spec.considerations) < 2 or len(analyses) < len(spec.applications):
        return None
    objectives = [_application(spec, analysis) for analysis in analyses]
    objectives += [_consideration(spec.region, table) for table in spec.considerations]
    return compromise(spec.region, objectives, level=spec.stop.level, seed=spec.seed % 2**32)


def _application(spec: CampaignSpec, analysis: Analysis) -> Objective:
    table = spec.application(analysis.application)
    scale, fitted, departure = analysis.scale, analysis.fitted, analysis.fitted.departure
    # Keyed by the application, or those of equal designs would have equal draws and err alike.
    rng, limits = generator(spec.seed, analysis.fit.n_runs, f"compromise: {table.name}"), table.score_limits
    some = rng.permutation(analysis.posterior.term_draws)[:DRAWS]
    surfaces = []
    if departure.believed is not None:
        surfaces = [departure.believed.draw(rng)[0] for _ in range(round(departure.probability * len(some)))]
        some = some[len(surfaces) :]
    order = rng.permutation(len(some) + len(surfaces))

    def drawn(points: FloatArray) -> FloatArray:
        values = np.vstack([some @ analysis.model.matrix(points).T, *(surface(points) for surface in surfaces)])
        return np.clip(scale.to_score(values[order]), *limits)

    def at(point: FloatArray) -> tuple[Interval, ...]:
        _, found = intervals(fitted, point, spec.stop.level, (1.0,), 0.0)
        return tuple(Interval(math.nan, math.nan) if fitted.surface.s == 0.0 else one.within(*limits) for one in found)

    return Objective(
        table.name,
        table.goal,
        table.weight,
        lambda points: np.clip(scale.to_score(fitted.mean(points)), *limits),
        drawn,
        table.unacceptable,
        table.ideal,
        analysis.score_unit,
        optimum=analysis.optimum.point,
        intervals=at,
    )


def _consideration(region: Region, table: ConsiderationSpec) -> Objective:
    written, ends = arithmetic(table.expr), (table.unacceptable, table.ideal)

    def value(points: FloatArray) -> FloatArray:
        return written.right(region.natural(points), len(points))

    return Objective(table.name, table.goal, table.weight, value, None, *ends, table.unit, application=False)


def desirability(values: FloatArray, goal: Goal, unacceptable: float, ideal: float) -> FloatArray:
    """Desirability in [0, 1]: 0 at ``unacceptable`` and beyond, 1 at ``ideal`` and beyond.

    Equal ones make every value ideal; where ``ideal`` is the worse one, nothing is acceptable.
    """
    span = sign_of(goal) * (ideal - unacceptable)
    if span <= 0.0:
        return np.full(np.shape(values), float(span == 0.0))
    scaled: FloatArray = np.clip(sign_of(goal) * (np.asarray(values) - unacceptable) / span, 0.0, 1.0)
    return scaled


def pareto_front(values: FloatArray, goals: Sequence[Goal]) -> BoolArray:
    """Which rows (n,) of ``values`` (n, objectives) no other row beats: at least as good in all, better in one.

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


def compromise(
    region: Region, objectives: Sequence[Objective], *, level: float = 0.95, seed: int = 0
) -> CompromiseEstimate:
    """The setting with the largest weighted geometric mean of desirabilities of one or more objectives.

    Those with draws have equally many. ``level``: of the credible intervals; equal inputs and seeds give equal results.
    """
    rng = np.random.default_rng(seed)
    cover = np.vstack([region.candidates(limit=_COVER), region.sample(_COVER // 2, rng)])
    means = np.column_stack([objective.mean(cover) for objective in objectives])
    own_points, limits = [], []
    for i, objective in enumerate(objectives):
        own = objective.optimum
        if own is None:
            heights = sign_of(objective.goal) * means[:, i]
            own = climb(partial(_signed, objective), region, cover, rng, heights, _RADII)[0]
        own_points.append(own)
        limits.append(_limits(objective, means[:, i], float(objective.mean(own_points[-1][None, :])[0])))
    weights = np.array([objective.weight for objective in objectives])
    weights = weights / weights.sum()

    def merit(values: FloatArray) -> FloatArray:
        """Logarithm of the weighted geometric mean of desirabilities, of values (..., objectives)."""
        found: FloatArray = np.zeros(values.shape[:-1])
        for i, (objective, (worst, best)) in enumerate(zip(objectives, limits, strict=True)):
            d = desirability(values[..., i], objective.goal, worst, best)
            found = found + weights[i] * np.log(d, out=np.full(np.shape(d), _UNACCEPTABLE), where=d > 0.0)
        return found

    def at(points: FloatArray) -> FloatArray:
        return np.column_stack([objective.mean(points) for objective in objectives])

    point = climb(lambda points: merit(at(points)), region, cover, rng, merit(means), _RADII)[0]
    draw_points, shortfall, losses_of_draws = _draws(objectives, cover, point, merit)
    tail = [0.5 * (1.0 - level), 1.0 - 0.5 * (1.0 - level)]
    credible, levels = {}, {}
    for factor, column in zip(region.factors, draw_points.T, strict=True) if len(draw_points) else ():
        if isinstance(factor, CategoricalFactor):
            shares = np.mean(np.abs(column[:, None] - factor.coded_levels) < 1e-6, axis=0)
            levels[factor.name] = dict(zip(factor.levels, shares.tolist(), strict=True))
        else:
            credible[factor.name] = Interval(*central_range(factor, column, tail[0]))
    here = at(point[None, :])[0]
    rows = []
    for i, (objective, own, (worst, best)) in enumerate(zip(objectives, own_points, limits, strict=True)):
        value, own_best = float(here[i]), float(objective.mean(own[None, :])[0])
        if sign_of(objective.goal) * (value - own_best) > 0.0:  # by what a search leaves
            own_best = value
        given_up, low, high, between = sign_of(objective.goal) * (own_best - value), float("nan"), float("nan"), ""
        spread = 0.0  # exact
        if i in losses_of_draws:
            low, high = (float(x) for x in np.quantile(losses_of_draws[i], tail))
            spread = 0.5 * (high - low)
            between = f" ({100 * level:g} % credible interval {known(low, spread)} to {known(high, spread)})"
        suffix = f" {objective.unit}" if objective.unit else ""
        confidence, prediction = (None, None) if objective.intervals is None else objective.intervals(point)
        rows.append(
            GivenUp(
                name=objective.name,
                value=value,
                own_best=own_best,
                given_up=given_up,
                low=low,
                high=high,
                desirability=float(desirability(here[i : i + 1], objective.goal, worst, best)[0]),
                unit=objective.unit,
                application=objective.application,
                own_settings=region.decode(own)[0],
                text=f"{objective.name}: {known(value, spread)}{suffix} against {known(own_best, spread)} at its own "
                f"optimum, {known(given_up, spread)}{suffix} given up{between}.",
                confidence=confidence,
                prediction=prediction,
            )
        )
    front = np.flatnonzero(pareto_front(means, [objective.goal for objective in objectives]))
    front = front[np.argsort(means[front, 0], kind="stable")]
    front = front[np.unique(np.linspace(0, len(front) - 1, min(_FRONT, len(front))).astype(np.int64))]
    return CompromiseEstimate(
        point=point,
        settings=region.decode(point)[0],
        desirability=float(np.exp(merit(here[None, :])[0])),
        expected_shortfall=shortfall,
        level=level,
        credible=credible,
        given_up=tuple(rows),
        front_settings=tuple(region.decode(cover[front])),
        front_values=means[front],
        levels=levels,
    )


def _signed(objective: Objective, points: FloatArray) -> FloatArray:
    return sign_of(objective.goal) * objective.mean(points)


def _limits(objective: Objective, values: FloatArray, best: float) -> tuple[float, float]:
    """Values of desirability 0 and 1: as given, or the worst of the cover and the objective's own optimum.

    A default never contradicts what is given: all may be better than ``ideal``, or none than ``unacceptable``.
    """
    sign, worst, ideal = sign_of(objective.goal), objective.unacceptable, objective.ideal
    if worst is None:
        worst = sign * min(float(np.min(sign * values)), math.inf if ideal is None else sign * ideal)
    elif ideal is None and sign * best <= sign * worst:
        best = -sign * math.inf
    return worst, best if ideal is None else ideal


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
    of = merit(values)
    best = np.argmax(of, axis=1)
    shortfall = float(np.mean(np.exp(of[np.arange(m), best]) - np.exp(of[:, -1])))
    losses = {}
    for i in uncertain:
        sign = sign_of(objectives[i].goal)
        losses[i] = np.asarray(np.max(sign * values[:, :, i], axis=1) - sign * values[:, -1, i])
    return points[best], shortfall, losses
