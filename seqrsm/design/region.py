"""The region of allowed settings: a box of factors, cut by constraints.

Points are rows of coded values in factor order (see :mod:`seqrsm.design.factors`); settings are mappings of names to
natural values, as a user writes them.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np
import scipy

from seqrsm.arrays import BoolArray, FloatArray
from seqrsm.design import search
from seqrsm.design.constraints import Constraint
from seqrsm.design.factors import (
    LOG_NEEDS_POSITIVE,
    CategoricalFactor,
    ContinuousFactor,
    DiscreteFactor,
    Factor,
    OfFactors,
)
from seqrsm.errors import Problem, RegionError

ROUNDING = 1e-9
"""Of coded units and slacks: settings that miss a bound by less are on it."""
_LINE_SAMPLES = 65
_MAX_DRAWN = 1_000_000
_MOST_CELLS = 20_000  # counted, of a region without continuous factors


def declaration_problems(factors: Sequence[Factor], constraints: Sequence[Constraint]) -> list[Problem]:
    """What keeps factors, and conditions on them, from being those of a region."""
    problems = []
    if not factors:
        problems.append(Problem("a region needs at least one factor", "Declare a factor."))
    names = [factor.name for factor in factors]
    problems += [
        Problem("two factors have the same name", "Rename one.", field="factor", value=name)
        for name in sorted({name for name in names if names.count(name) > 1})
    ]
    by_name = {factor.name: factor for factor in factors}
    discrete = {factor.name: factor.values for factor in factors if isinstance(factor, DiscreteFactor)}
    for constraint in constraints:
        place = f"constraint '{constraint.expr}'"
        problems += [
            Problem("a name is not a factor", f"The factors are {', '.join(names)}.", field=place, value=name)
            for name in sorted(constraint.names - by_name.keys())
        ]
        text = "a categorical factor stands where a number is needed"
        problems += [
            Problem(text, "Use ==, != or in.", field=place, value=name)
            for name in sorted(constraint.numeric_names)
            if isinstance(by_name.get(name), CategoricalFactor)
        ]
        text = "< and > include their end, which would be allowed here"
        problems += [
            Problem(text, "Write <= or >= with the nearest value that is allowed.", field=place, value=end)
            for side, end in constraint.open_ends
            if end in discrete.get(side, ()) or (side.startswith("count(") and end.is_integer())
        ]
        for name, labels in constraint.labels:
            factor = by_name.get(name)
            if isinstance(factor, CategoricalFactor):
                known = f"The levels are {', '.join(factor.levels)}."
                problems += [
                    Problem(f"'{name}' has no such level", known, field=place, value=label)
                    for label in labels
                    if label not in factor.levels
                ]
            elif factor is not None:
                text = "==, !=, in and count are for categorical factors"
                problems.append(Problem(text, "Use <= or >=.", field=place, value=name))
    return problems


@dataclass(frozen=True, slots=True)
class Region(OfFactors):
    """Allowed settings of the factors.

    RegionError of names that do not fit, or of constraints that leave no setting (naming those in conflict).
    """

    factors: tuple[Factor, ...]
    """In the order of the columns of every point."""
    constraints: tuple[Constraint, ...] = ()
    """All must hold; in natural units."""
    #: Some feasible points (m, k), kept from the check at creation; empty for a box.
    anchors: FloatArray = field(init=False, repr=False, compare=False)

    def __post_init__(self) -> None:
        problems = declaration_problems(self.factors, self.constraints)
        if problems:
            raise RegionError(*problems)
        anchors = np.empty((0, self.k)) if self.is_box else search.feasible_anchors(self.axes, self.slacks)
        if not self.is_box and anchors.shape[0] == 0:
            conflict = search.conflicting(self.axes, self.slacks, len(self.constraints))
            which = "this constraint" if len(conflict) == 1 else "these constraints together"
            text, remedy = (
                f"no setting of the factors satisfies {which}",
                "Widen a factor's range or relax the constraint.",
            )
            written = [self.constraints[index].expr for index in conflict]
            raise RegionError(*(Problem(text, remedy, field="constraint", value=expr) for expr in written))
        object.__setattr__(self, "anchors", anchors)

    @property
    def continuous(self) -> tuple[int, ...]:
        """Indices of the continuous factors."""
        return tuple(i for i, f in enumerate(self.factors) if isinstance(f, ContinuousFactor))

    @property
    def discrete(self) -> tuple[int, ...]:
        """Indices of the discrete numeric factors."""
        return tuple(i for i, f in enumerate(self.factors) if isinstance(f, DiscreteFactor))

    @property
    def is_box(self) -> bool:
        """Whether no constraint cuts the product of the factors' ranges and levels."""
        return not self.constraints

    def has_at_most(self, n: int) -> bool:
        """Whether it has no more than ``n`` settings: a model with as many terms describes each, whatever the truth."""
        cells = float(np.prod([0.0 if axis is None else axis.size for axis in self.axes]))
        return not self.continuous and cells <= _MOST_CELLS and len(self.candidates()) <= n

    @property
    def axes(self) -> search.Axes:
        """Per factor the array of its coded levels, or None for a continuous one."""
        return tuple(None if isinstance(factor, ContinuousFactor) else factor.coded_levels for factor in self.factors)

    def code(self, settings: Sequence[Mapping[str, float | str]]) -> FloatArray:
        """Coded points (n, k) of settings in natural units.

        Settings need not be feasible: a run that was flown is a fact. Numbers may come as text; further keys are left
        alone. RegionError tells every factor that is missing, every unknown level and every value that is no finite
        number.
        """
        values = np.empty((len(settings), self.k))
        problems: list[Problem] = []
        for row, setting in enumerate(settings):
            for column, factor in enumerate(self.factors):
                found = _number(factor, setting)
                if isinstance(found, Problem):
                    problems.append(Problem(found.message, found.remedy, None, row + 1, found.field, found.value))
                else:
                    values[row, column] = found
        if problems:
            raise RegionError(*problems)
        for column, factor in enumerate(self.factors):
            if not isinstance(factor, CategoricalFactor):
                values[:, column] = factor.code(values[:, column])
        return values

    def decode(self, points: FloatArray) -> list[dict[str, float | str]]:
        """Return settings in natural units of coded points (n, k) or (k,): one mapping of names to values per point."""
        columns = list(self.natural(points).values())
        return [
            {
                factor.name: str(value) if isinstance(factor, CategoricalFactor) else float(value)
                for factor, value in zip(self.factors, row, strict=True)
            }
            for row in zip(*columns, strict=True)
        ]

    def slacks(self, points: FloatArray) -> FloatArray:
        """Slack of every constraint at points (m, k), shape (m, constraints); >= 0 where it holds."""
        settings = self.natural(points, frozenset().union(*(constraint.names for constraint in self.constraints)))
        slacks = np.empty((points.shape[0], len(self.constraints)))
        for column, constraint in enumerate(self.constraints):
            slacks[:, column] = constraint.slack(settings)
        return slacks

    def slack(self, points: FloatArray) -> FloatArray:
        """Smallest slack over the constraints, shape (n,), >= 0 where all hold; +inf for a box. Levels must be levels.

        Bounds and discrete levels are not looked at: see :meth:`feasible`.
        """
        return np.asarray(np.min(self.slacks(np.atleast_2d(points)), axis=1, initial=np.inf))

    def allowed(self, points: FloatArray) -> BoolArray:
        """Whether all constraints hold (n,), but for rounding; bounds and levels are not looked at."""
        return np.asarray(self.slack(points) >= -ROUNDING)

    def feasible(self, points: FloatArray, tol: float = ROUNDING) -> BoolArray:
        """Which points (n, k) lie within the bounds, on the levels and inside all constraints, to ``tol``."""
        points = np.atleast_2d(np.asarray(points, dtype=np.float64))
        feasible: BoolArray = np.all(np.isfinite(points), axis=1)
        for column, factor in enumerate(self.factors):
            values = np.where(np.isfinite(points[:, column]), points[:, column], 0.0)
            if isinstance(factor, ContinuousFactor):
                feasible &= np.abs(values) <= 1.0 + tol
            elif isinstance(factor, DiscreteFactor):
                feasible &= factor.match(values)[1]
            else:
                feasible &= (values == np.rint(values)) & (values >= 0) & (values < len(factor.levels))
        if not self.is_box and np.any(feasible):
            feasible[feasible] = self.slack(points[feasible]) >= -tol
        return feasible

    def sample(self, n: int, rng: np.random.Generator) -> FloatArray:
        """Feasible random points (n, k), uniform in coded factors and over levels.

        Uniform by rejection; where less than about one in 10^4 of the box is feasible, the rest comes from a
        coordinate-wise hit-and-run walk through the feasible set, which is uniform in the limit only.
        """
        if self.is_box:
            return search.uniform(self.axes, n, rng)
        found: list[FloatArray] = []
        count, drawn = 0, 0
        while count < n and drawn < min(10_000 * n, _MAX_DRAWN):
            size = int(np.clip(4 * (n - count) * max(drawn, 1) / max(count, 1), 1024, 65_536))
            points = search.uniform(self.axes, size, rng)
            good = points[self.slack(points) >= 0.0]
            found.append(good)
            count += good.shape[0]
            drawn += size
        points = np.vstack([np.empty((0, self.k)), *found])[:n]
        if points.shape[0] < n:
            points = np.vstack([points, self._walk(n - points.shape[0], rng, np.vstack([points, self.anchors]))])
        return points

    def _walk(self, n: int, rng: np.random.Generator, starts: FloatArray) -> FloatArray:
        """Feasible points (n, k) along a hit-and-run walk."""
        point = starts[rng.integers(starts.shape[0])].copy()
        rows = np.empty((n, self.k))
        for row in range(n):
            for j in range(self.k):
                spans = self.line_intervals(point, j)
                if spans.shape[0] == 0:
                    continue
                lengths = spans[:, 1] - spans[:, 0]
                weights = lengths / lengths.sum() if lengths.sum() > 0.0 else np.full(lengths.size, 1.0 / lengths.size)
                span = spans[rng.choice(lengths.size, p=weights)]
                point[j] = rng.uniform(span[0], span[1])
            rows[row] = point
            point = point if rng.random() < 0.9 else starts[rng.integers(starts.shape[0])].copy()
        return rows

    def jitter(self, points: FloatArray, radius: FloatArray | float, rng: np.random.Generator) -> FloatArray:
        """Points (n, k) moved at random in their continuous coordinates; constraints are not looked at, bounds are.

        The moves have a coded standard deviation ``radius``, one or (n, 1), and are rounded to 0.001 of the coded
        half-range: finer differences are no different settings of a sensor.
        """
        moved = points.copy()
        free = list(self.continuous)
        step = np.asarray(radius) * rng.standard_normal((len(points), len(free)))
        moved[:, free] = np.clip(np.round(points[:, free] + step, 3), -1.0, 1.0)
        return moved

    def half_sides(self, at: FloatArray, runs: FloatArray) -> FloatArray:
        """Half the side (n,), coded, of the largest box about each place ``at`` (n, k) without any of the runs (r, k).

        It lies within the ranges: 0 to 1; 0 at a run, whatever its level of the categorical factors; below 0 outside
        them.
        """
        numeric = list(self.numeric)
        found: FloatArray = 1.0 - np.max(np.abs(at[:, list(self.continuous)]), axis=1, initial=0.0)
        if not numeric:
            return np.minimum(found, 0.0)
        nearest, _ = scipy.spatial.KDTree(runs[:, numeric]).query(at[:, numeric], p=np.inf)
        return np.minimum(found, nearest)

    def at_other_levels(self, points: FloatArray) -> FloatArray:
        """Points (n, k) with one discrete or categorical factor moved, to each of its levels; constraints apart."""
        found = [points[:0]]
        for j, factor in enumerate(self.factors):
            for level in () if isinstance(factor, ContinuousFactor) else factor.coded_levels:
                moved = points[points[:, j] != level]
                moved[:, j] = level
                found.append(moved)
        return np.vstack(found)

    def candidates(self, n_continuous_levels: int = 5, limit: int = 20_000) -> FloatArray:
        """Feasible points that cover the region, shape (m, k), without repeats: a grid, or an even sequence.

        The grid has so many levels of each continuous factor; odd, so that the centre belongs to it. Beyond ``limit``
        points it is face centres, a coarser grid that fits and an even sequence of this length. For a constrained
        region points on the boundaries of the constraints, found by bisection along each continuous coordinate, are
        added: optima lie there.
        """
        points = search.cover(self.axes, n_continuous_levels, limit)
        if self.is_box:
            return points
        good = points[self.slack(points) >= 0.0]
        inner = np.vstack([good, self.anchors])
        found, budget = [inner], max(limit // max(2 * len(self.continuous), 1), 1)
        starts = inner[:: -(-len(inner) // budget)]
        for j in self.continuous:
            for end in (-1.0, 1.0):
                ends = starts.copy()
                ends[:, j] = end
                out = self.slack(ends) < 0.0
                if np.any(out):
                    found.append(search.bisect(starts[out], ends[out], self.slack))
        return search.distinct(np.vstack(found))

    def level_combinations(self) -> tuple[tuple[int, ...], ...]:
        """All combinations of level indices of the categorical factors; ``((),)`` where there is none."""
        return tuple(itertools.product(*(range(len(self.axes[i])) for i in self.categorical)))  # type: ignore[arg-type]

    def line_intervals(self, point: FloatArray, j: int) -> FloatArray:
        """Feasible intervals (m, 2) of factor ``j`` with the other factors as in ``point`` (k,).

        Ascending, disjoint, both ends feasible; a level of a discrete or categorical factor is an interval of no
        length. Intervals of a continuous factor shorter than 1/32 may be missed unless ``point`` lies in them.
        """
        levels = self.axes[j]
        if self.is_box and levels is None:
            return np.array([[-1.0, 1.0]])
        # The point's own place too, so that a narrow interval around it is not missed.
        places = np.append(np.linspace(-1.0, 1.0, _LINE_SAMPLES), np.clip(point[j], -1.0, 1.0))
        line = np.sort(places) if levels is None else levels
        rows = np.tile(np.asarray(point, dtype=np.float64), (len(line), 1))
        rows[:, j] = line
        good = self.slack(rows) >= 0.0
        if levels is not None:
            return np.repeat(line[good][:, None], 2, axis=1)
        step = np.diff(good.astype(np.int8), prepend=0, append=0)
        ends = []
        for inner, way in ((np.flatnonzero(step[:-1] == 1), -1), (np.flatnonzero(step[1:] == -1), 1)):
            values, outer = line[inner], inner + way
            cut = (outer >= 0) & (outer < len(line))
            # Between the last feasible sample and the next one lies the boundary.
            values[cut] = search.bisect(rows[inner[cut]], rows[outer[cut]], self.slack)[:, j]
            ends.append(values)
        return np.stack(ends, axis=1)

    def centre(self) -> FloatArray:
        """Central point (k,): coded 0, the discrete level nearest to 0, first level of each categorical factor.

        In a constrained region where that is not feasible: the feasible candidate nearest to it among those at least
        half as far inside the constraints as the best.
        """
        target = np.array([0.0 if levels is None else levels[np.argmin(np.abs(levels))] for levels in self.axes])
        target[list(self.categorical)] = 0.0
        if self.is_box or self.feasible(target, tol=0.0)[0]:
            return target
        points = self.candidates(limit=4000)
        slack = self.slack(points)
        points = points[slack >= 0.5 * np.max(slack)]
        numeric = list(self.numeric)
        distance = np.linalg.norm(points[:, numeric] - target[numeric], axis=1)
        chosen: FloatArray = points[np.argmin(distance)]
        return chosen

    def natural(self, points: FloatArray, names: Collection[str] | None = None) -> dict[str, np.ndarray]:
        """Natural values (n,) of each factor by its name, levels by theirs, at coded points (n, k); or of some."""
        points = np.atleast_2d(np.asarray(points, dtype=np.float64))
        return {
            factor.name: np.array(factor.levels)[own.astype(np.intp)]
            if isinstance(factor, CategoricalFactor)
            else factor.decode(own)
            for factor, own in zip(self.factors, points.T, strict=True)
            if names is None or factor.name in names
        }


def _number(factor: Factor, setting: Mapping[str, float | str]) -> float | Problem:
    """Natural value of a numeric factor, index of the level of a categorical one, or what is wrong."""
    if factor.name not in setting:
        return Problem("a factor has no value", "Give one for every factor.", field=factor.name)
    value = setting[factor.name]
    if isinstance(factor, CategoricalFactor):
        label = value.strip() if isinstance(value, str) else str(value)
        if label not in factor.levels:
            remedy = f"The levels are {', '.join(factor.levels)}."
            return Problem("unknown level", remedy, field=factor.name, value=value)
        return float(factor.levels.index(label))
    try:
        number = math.nan if isinstance(value, bool) else float(value)
    except (TypeError, ValueError, OverflowError):
        number = math.nan
    if not math.isfinite(number):
        return Problem("not a finite number", "Give a number.", field=factor.name, value=value)
    if factor.scale == "log" and number <= 0.0:
        return Problem(LOG_NEEDS_POSITIVE, "Give a value > 0.", field=factor.name, value=number)
    return number
