"""The fitted surface on grids and lines through the optimum, in natural and score units: what the figures draw."""

from __future__ import annotations

import itertools
from dataclasses import dataclass

import numpy as np

from seqrsm.analysis.results import Analysis
from seqrsm.arrays import BoolArray, FloatArray, IntArray
from seqrsm.design.factors import CategoricalFactor, ContinuousFactor, Factor, NumericFactor
from seqrsm.design.region import ROUNDING
from seqrsm.fit.intervals import Interval, Prediction

GRID_POINTS = 41
LINE_POINTS = 81
MAX_PAIRS = 6


@dataclass(frozen=True, slots=True)
class Surface:
    """Fitted mean over two numeric factors, the others at the optimum."""

    x_index: int
    y_index: int

    x: FloatArray
    y: FloatArray
    """(g,): natural values of the two factors."""
    mean: FloatArray
    """(g, g): score; first axis follows ``y``."""
    slack: FloatArray
    """(g, g): smallest slack of the constraints, but for rounding; negative where the settings are not allowed."""


@dataclass(frozen=True, slots=True)
class Line:
    """Fitted mean and bands along one factor, the others at the optimum."""

    index: int
    """Of the factor."""
    x: FloatArray
    """(m,): natural values; level indices of a categorical factor."""
    mean: FloatArray
    """(m,): score."""
    confidence: Interval
    prediction: Interval
    """(m,): of scores; nan where there is no error estimate."""
    allowed: BoolArray
    """(m,): whether the constraints hold."""
    run_ids: IntArray
    """(n,): of runs whose own value of the factor the constraints allow here."""
    run_x: FloatArray
    run_score: FloatArray
    """(n,): these runs moved to this line: the fitted mean at that value, plus what their score is off the fitted
    surface."""


def numeric_factor(analysis: Analysis, index: int) -> NumericFactor:
    """Return the factor of that index, which must be numeric."""
    factor = analysis.region.factors[index]
    if isinstance(factor, CategoricalFactor):
        raise TypeError(f"{factor.name} is categorical")
    return factor


def ranked_factors(analysis: Analysis) -> list[str]:
    """Names of the factors, the most important first, by their F ratio; untestable ones come last, in factor order."""
    order = {row.factor: -row.f for row in analysis.importance if np.isfinite(row.f)}
    return sorted(analysis.region.names, key=lambda name: order.get(name, np.inf))


def chosen_pairs(analysis: Analysis) -> list[tuple[int, int]]:
    """Pairs of numeric factors to draw: all, or the ``MAX_PAIRS`` among the most important factors."""
    region = analysis.region
    rank = {name: place for place, name in enumerate(ranked_factors(analysis))}
    numeric = sorted(region.numeric, key=lambda i: rank[region.names[i]])
    pairs = list(itertools.combinations(numeric, 2))
    pairs.sort(key=lambda pair: (rank[region.names[pair[0]]] + rank[region.names[pair[1]]], pair))
    return [(min(pair), max(pair)) for pair in pairs[:MAX_PAIRS]]


def surface(analysis: Analysis, x_index: int, y_index: int) -> Surface:
    """Evaluate the fitted mean over a pair of numeric factors."""
    coded = np.linspace(-1.0, 1.0, GRID_POINTS)
    points = np.repeat(analysis.optimum.point[None, :], GRID_POINTS**2, axis=0)
    points[:, x_index] = np.tile(coded, GRID_POINTS)
    points[:, y_index] = np.repeat(coded, GRID_POINTS)
    shape = (GRID_POINTS, GRID_POINTS)
    return Surface(
        x_index,
        y_index,
        numeric_factor(analysis, x_index).decode(coded),
        numeric_factor(analysis, y_index).decode(coded),
        _scores(analysis, analysis.fitted.mean(points)).reshape(shape),
        (analysis.region.slack(points) + ROUNDING).reshape(shape),
    )


def predict(analysis: Analysis, points: FloatArray) -> Prediction:
    """Predict at coded points (m, k), on the scale of the fit, at the level of the campaign's intervals."""
    return analysis.fitted.bands(points, analysis.optimum.level, analysis.scale.weight_at)


def line(analysis: Analysis, index: int) -> Line:
    """Evaluate mean and bands along one factor through the optimum."""
    factor = analysis.region.factors[index]
    coded, made, fitted = _places(factor), analysis.data.points, analysis.fitted
    moved = _along(analysis, index, made[:, index])
    kept = analysis.region.allowed(moved)
    # What a run is off the surface that is drawn, less what its block adds, and a simulation on flights.
    off, (sources, blocks) = analysis.fit.y - fitted.mean(made), fitted.surface.for_process()
    simulated = np.empty((len(off), 0)) if sources is None else ~sources.own[:, None]
    beside = np.hstack([simulated, *(() if blocks is None else (blocks.columns,))])
    off = off - beside @ np.linalg.lstsq(beside, off, rcond=None)[0]
    score = _scores(analysis, fitted.mean(moved) + off)[kept]
    own = made[kept, index]
    natural, run_x = (at if isinstance(factor, CategoricalFactor) else factor.decode(at) for at in (coded, own))
    runs = (analysis.data.run_ids[kept], run_x, score)
    return _line(analysis, index, natural, _along(analysis, index, coded), runs)


def lines_by_level(analysis: Analysis, index: int, category: int) -> tuple[Line, ...]:
    """`line` along a numeric factor for each level of a categorical one; without runs."""
    factor, found = numeric_factor(analysis, index), []
    coded, none = _places(factor), (np.empty(0, dtype=np.int64), np.empty(0), np.empty(0))
    levels = analysis.region.factors[category]
    assert isinstance(levels, CategoricalFactor)
    for level in levels.coded_levels:
        points = _along(analysis, index, coded)
        points[:, category] = level
        found.append(_line(analysis, index, factor.decode(coded), points, none))
    return tuple(found)


def _places(factor: Factor) -> FloatArray:
    """Coded values at which a line along a factor is drawn: its levels, or many."""
    return np.linspace(-1.0, 1.0, LINE_POINTS) if isinstance(factor, ContinuousFactor) else factor.coded_levels


def _line(
    analysis: Analysis, index: int, x: FloatArray, points: FloatArray, runs: tuple[IntArray, FloatArray, FloatArray]
) -> Line:
    """Mean and bands at coded points (m, k) where the factor has natural values ``x`` (m,); ``runs`` end a `Line`."""
    shown = predict(analysis, points)
    limits, future = (
        analysis.fitted.application.score_limits,
        analysis.scale.of_runs(shown.confidence, shown.prediction, 1.0),
    )
    confidence = Interval(_scores(analysis, shown.confidence.low), _scores(analysis, shown.confidence.high))
    prediction = Interval(*(np.clip(end, *limits) for end in future))
    allowed = analysis.region.allowed(points)
    return Line(index, x, _scores(analysis, shown.mean), confidence, prediction, allowed, *runs)


def _scores(analysis: Analysis, values: FloatArray) -> FloatArray:
    """Scores of values on the scale of the fit, as far as there can be such scores."""
    return np.clip(analysis.scale.to_score(values), *analysis.fitted.application.score_limits)


def _along(analysis: Analysis, index: int, coded: FloatArray) -> FloatArray:
    points = np.repeat(analysis.optimum.point[None, :], coded.size, axis=0)
    points[:, index] = coded
    return points
