"""The part of the region that is looked at now: it shrinks towards the optimum under lack of fit, and moves.

The bounds of the campaign are hard. Inside them the quadratic is fitted to a box of the continuous factors that starts
as everything. When the quadratic fails there, a smaller box around the likely optimum is filled with runs; once it can
carry a fit of its own, it takes the place of the larger one. Where the fitted optimum lies on an edge of the box that
is no bound of the campaign, the box follows it: steepest ascent by steps of a box. Runs outside the box stay in the
store, and enter again when the box comes back to them.

All of it is a function of the scored runs, batch by batch: nothing is kept, so a campaign that was killed goes on as if
it had not been.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Literal

import numpy as np

from seqrsm.arrays import BoolArray, FloatArray, IntArray
from seqrsm.decide.discrepancy import find_discrepancy, likely_optimum
from seqrsm.decide.stopping import NO_DEPARTURE
from seqrsm.design.factors import ContinuousFactor, Factor
from seqrsm.design.quadratic import QuadraticModel
from seqrsm.design.region import Region
from seqrsm.errors import FitError
from seqrsm.fit.anova import LackOfFit
from seqrsm.fit.least_squares import TermLike, fit_least_squares
from seqrsm.fit.optimum import Goal, optimum

StepKind = Literal["shrink", "move", "filled"]

EVIDENCE = 3.0
"""Evidence of a smooth departure from which the quadratic counts as wrong, with many residual degrees of freedom; see
``reports/coverage/zoom.md``."""

ALPHA = 0.002
"""Lack of fit against pure error calls for a smaller box below this p at once, and below that of the stop rule when it
lasts for `PERSISTENT` looks."""

PERSISTENT = 3

SHRINK = (0.3, 0.6)
"""Least and largest size of the smaller box over that of the one before; strong evidence shrinks more."""

RUNS_PER_TERM = 2.0
"""Runs in a box, for each term, before it is fitted by itself."""

MEAN_VARIANCE = 0.35
"""Mean variance of the estimated response over a box, in units of sigma squared, above which it is not fitted yet: runs
that crowd in one corner are many and say little."""

SLACK = 1.15
"""Runs up to this share beyond a box belong to it: a box is no reason to forget a neighbour."""

SMALLEST = 0.15
"""Smallest half-width of a box, in half-widths of the campaign's bounds."""

SLOPE = 2.5
"""A box follows the optimum over an edge only where the surface still rises there, by so many standard errors: an
optimum on an edge for want of curvature goes nowhere."""

_SAME = 1e-6
_DERIVATIVE = 1e-3
_DIGITS = 4
_SAMPLE = 400


@dataclass(frozen=True, slots=True)
class Box:
    """Bounds of the numeric factors, coded in the campaign's region.

    Attributes
    ----------
    low, high : tuple of float
        One for each factor; -1 and 1 where nothing is cut off (always for discrete and categorical factors).
    """

    low: tuple[float, ...]
    high: tuple[float, ...]

    @property
    def whole(self) -> bool:
        """Whether it is the campaign's region itself."""
        return all(x == -1.0 for x in self.low) and all(x == 1.0 for x in self.high)

    def local(self, points: FloatArray) -> FloatArray:
        """Points (n, k) coded in this box: -1 and 1 are its ends; discrete and categorical columns stay."""
        low, high = np.array(self.low), np.array(self.high)
        cut = (low != -1.0) | (high != 1.0)
        found = np.array(points, dtype=np.float64)
        found[:, cut] = (2.0 * found[:, cut] - (low + high)[cut]) / (high - low)[cut]
        return found

    def outwards(self, local: FloatArray) -> FloatArray:
        """Points (..., k) coded in this box, coded in the campaign's region."""
        low, high = np.array(self.low), np.array(self.high)
        cut = (low != -1.0) | (high != 1.0)
        found: FloatArray = np.where(cut, 0.5 * (low + high + local * (high - low)), local)
        return found

    def contains(self, points: FloatArray, slack: float = SLACK) -> BoolArray:
        """Whether points (n, k), coded in the campaign's region, belong to the box, widened by ``slack``."""
        if self.whole:
            return np.ones(len(points), dtype=np.bool_)
        low, high = np.array(self.low), np.array(self.high)
        cut = (low != -1.0) | (high != 1.0)
        local = self.local(points)[:, cut]
        return np.asarray(np.all(np.abs(local) <= slack + 1e-9, axis=1))


@dataclass(frozen=True, slots=True)
class RegionStep:
    """One thing that happened to the region.

    Attributes
    ----------
    batch, n_runs : int
        After which batch, and how many scored runs there were.
    kind : "shrink", "move" or "filled"
        A smaller box is called for; the box follows the optimum; the box called for has runs enough and is now fitted.
    box : Box
        The box called for, or fitted from now on.
    evidence : float
        For a smooth departure from the quadratic; 0 for "filled".
    lack_of_fit_p : float
        p of the lack-of-fit test against pure error; nan where it could not be made.
    """

    batch: int
    n_runs: int
    kind: StepKind
    box: Box
    evidence: float
    lack_of_fit_p: float


@dataclass(frozen=True, slots=True)
class RegionState:
    """The region as it stands.

    Attributes
    ----------
    box : Box
        What is fitted.
    target : Box or None
        The box that is being filled with runs; None when proposals serve the one that is fitted.
    steps : tuple of RegionStep
        How it came to this.
    doubts : int
        Looks in a row at which lack of fit in the box was significant by the stop rule.
    """

    box: Box
    target: Box | None = None
    steps: tuple[RegionStep, ...] = ()
    doubts: int = 0


def whole_box(k: int) -> Box:
    """The campaign's region of k factors."""
    return Box((-1.0,) * k, (1.0,) * k)


def sub_region(region: Region, box: Box) -> Region:
    """The part of ``region`` in ``box`` as a region of its own, with its own coding."""
    if box.whole:
        return region
    factors: list[Factor] = []
    for factor, low, high in zip(region.factors, box.low, box.high, strict=True):
        if isinstance(factor, ContinuousFactor) and (low, high) != (-1.0, 1.0):
            ends = factor.decode(np.array([low, high]))
            low_end, high_end = (float(f"{end:.12g}") for end in ends)  # without the dust of coding to and fro
            factors.append(replace(factor, low=low_end, high=high_end))
        else:
            factors.append(factor)
    return Region(tuple(factors), region.constraints)


def needed_runs(n_terms: int) -> int:
    """Runs a box must hold before it is fitted by itself."""
    return max(int(np.ceil(RUNS_PER_TERM * n_terms)), n_terms + 4)


def evidence_limit(df_residual: int) -> float:
    """Evidence from which a departure counts: with few degrees of freedom the likelihood ratio has long tails.

    Passed by 1 to 4 % of quadratics with equal noise, 6 to 45 residual degrees of freedom.
    """
    return EVIDENCE * (1.0 + 3.0 / max(df_residual, 1))


def box_around(region: Region, point: FloatArray, half: FloatArray) -> Box:
    """Box of half-widths ``half`` (k,) around ``point`` (k,), pushed inside the bounds.

    Its ends are settings of four digits in natural units: they are read by people.
    """
    low, high = np.full(region.k, -1.0), np.full(region.k, 1.0)
    for j in region.continuous:
        centre = float(np.clip(point[j], -1.0 + half[j], 1.0 - half[j]))
        factor = region.factors[j]
        assert isinstance(factor, ContinuousFactor)
        ends = np.array([centre - half[j], centre + half[j]])
        natural = np.array([float(f"{value:.{_DIGITS}g}") for value in factor.decode(ends)])
        coded = factor.code(natural) if natural[0] < natural[1] else ends
        low[j] = -1.0 if ends[0] <= -1.0 + _SAME else max(float(coded[0]), -1.0)
        high[j] = 1.0 if ends[1] >= 1.0 - _SAME else min(float(coded[1]), 1.0)
    return Box(tuple(low.tolist()), tuple(high.tolist()))


@dataclass(frozen=True, slots=True)
class _Data:
    """Scored runs: coded in the campaign's region, with columns of blocks."""

    points: FloatArray
    y: FloatArray
    weights: FloatArray
    extra: FloatArray

    def take(self, chosen: BoolArray) -> _Data:
        return _Data(self.points[chosen], self.y[chosen], self.weights[chosen], self.extra[chosen])


@dataclass(frozen=True, slots=True)
class Plan:
    """What a campaign fixes beforehand.

    Attributes
    ----------
    region : Region
        The campaign's; its bounds are hard.
    order : 1 or 2
        Of the model.
    goal : "maximize" or "minimize"
    max_runs : int
        The budget: no box is called for that it could not fill.
    seed : int
    alpha : float
        Lack of fit with a smaller p keeps the stop rule from holding.
    """

    region: Region
    order: Literal[1, 2] = 2
    goal: Goal = "maximize"
    max_runs: int = 80
    seed: int = 0
    alpha: float = 0.05


def walk(
    plan: Plan,
    points: FloatArray,
    y: FloatArray,
    batches: IntArray,
    *,
    weights: FloatArray | None = None,
    extra: FloatArray | None = None,
) -> RegionState:
    """The region after every batch scored so far.

    Parameters
    ----------
    plan : Plan
    points : ndarray (n, k)
        Coded settings of the scored runs.
    y, weights : ndarray (n,)
        Scores on the scale of the fit and their relative weights.
    batches : ndarray (n,) of int
        Batch of each run.
    extra : ndarray (n, e), optional
        Columns of blocks.

    Returns
    -------
    RegionState
    """
    n = len(y)
    data = _Data(points, y, np.ones(n) if weights is None else weights, np.empty((n, 0)) if extra is None else extra)
    state = RegionState(whole_box(plan.region.k))
    if not plan.region.continuous:
        return state
    for batch in np.unique(batches):
        state = _advance(plan, state, data.take(batches <= batch), int(batch))
    return state


def look(
    plan: Plan, state: RegionState, points: FloatArray, y: FloatArray, batch: int, weights: FloatArray | None = None
) -> RegionState:
    """The region after one more batch, from the state before; points, scores and weights of all batches so far."""
    of_runs = np.ones(len(y)) if weights is None else weights
    return _advance(plan, state, _Data(points, y, of_runs, np.empty((len(y), 0))), batch)


def _advance(plan: Plan, state: RegionState, data: _Data, batch: int) -> RegionState:
    """One batch further; runs that were there all along may allow several steps at once."""
    for _ in range(8):
        if state.target is not None:
            if not _can_be_fitted(plan, state.target, data):
                return state
            step = RegionStep(batch, len(data.y), "filled", state.target, 0.0, float("nan"))
            state = RegionState(state.target, None, (*state.steps, step))
        state = _call_for(plan, state, data, batch)
        if state.target is None:
            return state
    return state


def _rows(model: QuadraticModel, local: FloatArray, extra: FloatArray) -> FloatArray:
    columns = extra[:, np.ptp(extra, axis=0) > 0.0] if extra.shape[1] and len(extra) else extra[:, :0]
    return np.hstack([model.matrix(local), columns])


def _can_be_fitted(plan: Plan, box: Box, data: _Data) -> bool:
    inside = data.take(box.contains(data.points))
    here = sub_region(plan.region, box)
    model = QuadraticModel(here.factors, plan.order)
    Z = _rows(model, box.local(inside.points), inside.extra)
    if len(inside.y) < needed_runs(Z.shape[1]) or int(np.linalg.matrix_rank(Z)) < Z.shape[1]:
        return False
    at = model.matrix(here.sample(_SAMPLE, np.random.default_rng(0)))
    _, R = np.linalg.qr(Z * np.sqrt(inside.weights)[:, None])
    root = np.linalg.solve(R.T, np.hstack([at, np.zeros((_SAMPLE, Z.shape[1] - model.p))]).T)
    return float(np.mean(np.sum(root**2, axis=0))) <= MEAN_VARIANCE * float(np.mean(1.0 / inside.weights))


@dataclass(frozen=True, slots=True)
class _Inside:
    """The runs in the box that is fitted, and their model."""

    region: Region
    model: QuadraticModel
    local: FloatArray
    Z: FloatArray
    data: _Data


def _call_for(plan: Plan, state: RegionState, data: _Data, batch: int) -> RegionState:
    """What the runs in the box call for: a smaller box, one further on, or nothing."""
    box = state.box
    inside = data.take(box.contains(data.points))
    here = sub_region(plan.region, box)
    model = QuadraticModel(here.factors, plan.order)
    local = box.local(inside.points)
    view = _Inside(here, model, local, _rows(model, local, inside.extra), inside)
    if len(inside.y) < view.Z.shape[1] + 3:
        return state
    found = find_discrepancy(model, local, view.Z, inside.y, inside.weights, plan.goal)
    p = _lack_of_fit_p(view)
    limit = evidence_limit(len(inside.y) - view.Z.shape[1])
    half = 0.5 * (np.array(box.high) - np.array(box.low))
    target: Box | None = None
    kind: StepKind = "shrink"
    # Without any smooth departure a small p tells of unequal noise or chance, which a smaller box would not mend.
    doubtful = found.evidence >= NO_DEPARTURE
    state = replace(state, doubts=state.doubts + 1 if doubtful and p < plan.alpha else 0)
    if found.evidence > limit or (doubtful and p < ALPHA) or state.doubts >= PERSISTENT:
        if float(np.max(half[list(plan.region.continuous)])) > SMALLEST:
            centre = likely_optimum(model, here, local, view.Z, inside.y, found, plan.goal, inside.weights, plan.seed)
            target = box_around(
                plan.region, box.outwards(centre), np.maximum(_shrink(found.evidence / limit) * half, SMALLEST)
            )
    elif not box.whole:
        kind, target = "move", _follow(plan, box, view, half)
    if target is None or np.allclose([*target.low, *target.high], [*box.low, *box.high], atol=1e-3):
        return state
    missing = needed_runs(view.Z.shape[1]) - int(np.count_nonzero(target.contains(data.points)))
    if max(missing, 1) > plan.max_runs - len(data.y) and not _can_be_fitted(plan, target, data):
        return state
    step = RegionStep(batch, len(data.y), kind, target, found.evidence, p)
    return RegionState(box, target, (*state.steps, step))


def _shrink(strength: float) -> float:
    """Size of the smaller box.

    The evidence of a cubic departure falls with the sixth power of the size. Stronger evidence shrinks twice as much as
    that asks for: a surface with a cliff shows as much of it in the next box, too.
    """
    return float(np.clip(0.6 * max(strength, 1.0) ** (-1.0 / 3.0), *SHRINK))


def _follow(plan: Plan, box: Box, view: _Inside, half: FloatArray) -> Box | None:
    """Box of the same size around an optimum on an edge of this one that is no bound of the campaign."""
    root = np.sqrt(view.data.weights)
    beta, rss, rank, _ = np.linalg.lstsq(view.Z * root[:, None], view.data.y * root, rcond=None)
    df = len(root) - view.Z.shape[1]
    if rank < view.Z.shape[1] or df < 1 or not len(rss):
        return None
    coefficients = np.asarray(beta[: view.model.p], dtype=np.float64)
    best = optimum(view.model, view.region, coefficients, plan.goal).point
    point = box.outwards(best)
    _, R = np.linalg.qr(view.Z * root[:, None])
    moves = False
    for j in plan.region.continuous:
        if abs(best[j]) > 1.0 - _SAME and abs(point[j]) < 1.0 - _SAME:
            step = np.zeros(plan.region.k)
            step[j] = _DERIVATIVE
            slope = (view.model.matrix((best + step)[None, :]) - view.model.matrix((best - step)[None, :]))[0]
            row = np.concatenate([slope, np.zeros(view.Z.shape[1] - view.model.p)])
            se = np.sqrt(float(rss[0]) / df) * float(np.linalg.norm(np.linalg.solve(R.T, row)))
            moves = moves or abs(float(slope @ coefficients)) > SLOPE * se
    return box_around(plan.region, point, half) if moves else None


def _lack_of_fit_p(view: _Inside) -> float:
    ids = [tuple(row) for row in np.round(view.local, 9) + 0.0]
    names: list[TermLike | str] = [*view.model.terms, *(f"block {i}" for i in range(view.Z.shape[1] - view.model.p))]
    try:
        fit = fit_least_squares(view.Z, view.data.y, names, weights=view.data.weights, setting_ids=ids)
    except FitError:
        return float("nan")
    lack = fit.lack_of_fit()
    return float(lack.p) if isinstance(lack, LackOfFit) and np.isfinite(lack.p) else float("nan")
