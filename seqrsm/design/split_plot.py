"""Designs in plots: flights whose settings stay, and blocks such as days.

A hard-to-change factor keeps its value within a plot (a flight); runs of one plot share a random effect, so that with
V = I + eta ZZ' (eta the variance of plots over that of runs) the information is

    M = X'V^-1 X = X'X - sum_w  eta / (1 + m_w eta) s_w s_w',    s_w the sum of the m_w rows of plot w

(Goos & Vandebroek 2003, Technometrics 45, 235-245). Fixed blocks are the limit of a large eta, without hard factors.
In a box, chains of compiled local searches; with constraints, many starts exchanged at the same time.
"""

from __future__ import annotations

import numpy as np

from seqrsm.arrays import BoolArray, FloatArray, IntArray
from seqrsm.design import kernels_plots as kernels
from seqrsm.design.factors import CategoricalFactor
from seqrsm.design.quadratic import QuadraticModel
from seqrsm.design.region import Region
from seqrsm.errors import DesignError, Problem
from seqrsm.progress import tell

FIXED_BLOCKS = 1e4
"""Variance ratio that stands for fixed blocks."""

_COARSE = 3
_STARTS, _KEPT, _ROUNDS = 96, 12, 4
_PASSES = 25
_GAIN, _SAME = 1e-9, 1e-8
_ZOOMS = (0.5, 0.2, 0.05, 0.01, 0.002)
_STEPS = np.array([-1.0, 0.0, 1.0])
# By number of terms: chains of local searches, as many as the time of a D-optimal search allows, and searches in each.
_EFFORT = ((10, 2, 200), (15, 3, 350), (21, 6, 350), (28, 12, 350), (10_000, 4, 350))
_RANDOM, _RETURN = 40, 60  # searches from random starts in each chain; kicks after which it returns to its best
_FALL = 0.002  # of log|M| a term, still taken as the next to be kicked
_RIDGE = 1e-2  # carries a search out of a singular start


def plot_sizes(n_runs: int, n_plots: int) -> IntArray:
    """Plot (n_runs,) of each run; sizes differ by one at most.

    Raises
    ------
    DesignError
        More plots than runs, or none.
    """
    if not 1 <= n_plots <= n_runs:
        raise DesignError(
            Problem(f"{n_runs} runs cannot be put into {n_plots} plots", f"Give 1 to {n_runs}.", value=n_plots)
        )
    return np.repeat(np.arange(n_plots), [len(part) for part in np.array_split(np.arange(n_runs), n_plots)])


def plot_information(rows: FloatArray, plots: IntArray, eta: float) -> FloatArray:
    """X'V^-1 X for model rows (..., n, p)."""
    M = np.swapaxes(rows, -1, -2) @ rows
    for plot in np.unique(plots):
        inside = plots == plot
        total = rows[..., inside, :].sum(axis=-2)
        M = M - eta / (1.0 + np.count_nonzero(inside) * eta) * total[..., :, None] * total[..., None, :]
    return M


def split_plot_design(
    model: QuadraticModel,
    region: Region,
    plots: IntArray,
    hard: tuple[int, ...] = (),
    eta: float = 1.0,
    seed: int = 0,
) -> FloatArray:
    """D-optimal runs in plots.

    Parameters
    ----------
    model, region : QuadraticModel, Region
    plots : ndarray (n,) of int
        Plot of each run, ascending.
    hard : tuple of int
        Factors that stay within a plot.
    eta : float
        Variance of plots over that of runs, >= 0; `FIXED_BLOCKS` for fixed blocks.
    seed : int

    Returns
    -------
    ndarray (n, k)
        Coded points, plot by plot.

    Raises
    ------
    DesignError
        Too few runs or plots for the model's terms.
    """
    _check(model, plots, hard, eta)
    rng = np.random.default_rng([seed, 3])
    engine = _Plots(model, region, np.asarray(plots), hard, eta)
    found: FloatArray = _search_box(engine, rng) if region.is_box else _search_constrained(engine, rng)
    if not np.isfinite(engine.values(engine.rows(found[None]))[0]):
        raise DesignError(Problem("every design tried was singular", "Ask for more runs or more plots."))
    return found


def _search_constrained(engine: _Plots, rng: np.random.Generator) -> FloatArray:
    """Many designs exchanged at the same time, some plots of the best set anew."""
    points = engine.start(_STARTS, rng)
    values = engine.exchange(points, _COARSE)
    for _ in range(_ROUNDS):
        best = _best(values, _KEPT)
        points, values = points[best], values[best]
        others = engine.perturb(np.repeat(points, _STARTS // _KEPT // 2, axis=0), rng)
        points = np.concatenate([points, others])
        values = np.concatenate([values, engine.exchange(others, _COARSE)])
    # On finer levels the order may change: designs that are best on coarse ones differ in what they gain.
    points = points[_best(values, _KEPT)]
    values = engine.exchange(points, 5)
    for radius in _ZOOMS[1:3]:
        values = engine.exchange(points, _COARSE, radius)
    found: FloatArray = points[int(np.argmax(values))]
    return found


def _search_box(engine: _Plots, rng: np.random.Generator) -> FloatArray:
    """Chains of compiled local searches: from random starts, then from the best with some of its runs set anew."""
    model, region = engine.model, engine.region
    chains, searches = next((chains, searches) for p, chains, searches in _EFFORT if model.p <= p)
    n, plan = len(engine.plots), engine.plan()
    F = np.empty((n, model.p))
    held = np.zeros(1 + sum(len(columns) for columns in model.columns), dtype=bool)
    for j in engine.hard:
        held[list(model.columns[j])] = True
    ends: list[tuple[float, FloatArray]] = []
    for chain in range(chains):
        fresh = model.base(engine.start(searches, rng).reshape(-1, region.k))
        fresh = np.ascontiguousarray(fresh).reshape(searches, n, -1)
        best, current = (-np.inf, fresh[0]), (-np.inf, fresh[0])
        for count in range(searches):
            tell("searching the design", chain * searches + count, chains * searches)
            G = fresh[count]
            if count >= _RANDOM:
                if count % _RETURN == 0:
                    current = best
                G = _kicked(current[1], G, engine.runs_of, held, rng)
            value = _improved(G, F, engine.eta, plan)
            if count < _RANDOM or value > current[0] - _FALL * model.p:
                current = value, G
            if value > best[0]:
                best = value, G.copy()
            ends.append((value, G.copy()))
    # Off the three levels the order may change: designs that are best on them differ in what they gain.
    ends.sort(key=lambda pair: -pair[0])
    chosen = _best(np.array([value for value, _ in ends]), _KEPT)
    finished = []
    for index in chosen:
        value, G = ends[index]
        for radius in _ZOOMS:
            value = kernels.exchange(G, F, engine.eta, 0.0, plan, _STEPS, radius, _PASSES)
        finished.append((value, G))
    return engine.from_base(max(finished, key=lambda pair: pair[0])[1])


def _improved(G: FloatArray, F: FloatArray, eta: float, plan: kernels.Plan) -> float:
    """Exchange on three levels, in place; log|M|. A ridge leads out of a singular start."""
    value = kernels.exchange(G, F, eta, 0.0, plan, _STEPS, 0.0, _PASSES)
    if value == -np.inf:
        kernels.exchange(G, F, eta, _RIDGE, plan, _STEPS, 0.0, _PASSES)
        value = kernels.exchange(G, F, eta, 0.0, plan, _STEPS, 0.0, _PASSES)
    return value


def _kicked(
    G: FloatArray, fresh: FloatArray, runs_of: list[IntArray], held: BoolArray, rng: np.random.Generator
) -> FloatArray:
    """Base columns of a design with a plot, the shared setting of one, or some runs as in another."""
    G = G.copy()
    kind = rng.random()
    if kind < 0.3:
        runs = runs_of[int(rng.integers(len(runs_of)))]
        G[runs] = fresh[runs]
        return G
    if kind < 0.5 and held.any():
        runs = runs_of[int(rng.integers(len(runs_of)))]
        G[np.ix_(runs, np.flatnonzero(held))] = fresh[np.ix_(runs, np.flatnonzero(held))]
    runs = rng.choice(len(G), min(len(G), 1 + int(rng.integers(3))), replace=False)
    G[np.ix_(runs, np.flatnonzero(~held))] = fresh[np.ix_(runs, np.flatnonzero(~held))]
    return G


def _best(values: FloatArray, count: int) -> IntArray:
    """Indices of the best values, at most ``count``, equal ones once: copies of one design crowd out all others."""
    order = np.argsort(-values, kind="stable")[: max(int(np.count_nonzero(np.isfinite(values))), 1)]
    fresh = np.append(True, np.abs(np.diff(values[order])) > _SAME * np.abs(values[order[1:]]))
    found: IntArray = order[fresh][:count]
    return found


def _check(model: QuadraticModel, plots: IntArray, hard: tuple[int, ...], eta: float) -> None:
    n_plots = len(np.unique(plots))
    if len(plots) < model.p:
        raise DesignError(Problem(f"{len(plots)} runs cannot estimate {model.p} terms", f"Ask for {model.p} or more."))
    needed = model.p + n_plots - 1
    if eta >= FIXED_BLOCKS and not hard and len(plots) < needed:
        raise DesignError(
            Problem(
                f"{len(plots)} runs cannot estimate {model.p} terms and the differences of {n_plots} blocks",
                f"Ask for {needed} runs or more, or for fewer blocks.",
                field="blocks",
                value=n_plots,
            )
        )
    names = [model.factors[j].name for j in hard]
    alone = [t for t in model.terms if t.kind == "intercept" or all(name in names for name in t.factors)]
    if hard and n_plots < len(alone):
        raise DesignError(
            Problem(
                f"{n_plots} plots cannot estimate the {len(alone)} terms that change between plots only",
                f"Ask for {len(alone) + 1} plots or more: one besides tells how plots scatter.",
                field="plots",
                value=n_plots,
            )
        )


class _Plots:
    def __init__(
        self, model: QuadraticModel, region: Region, plots: IntArray, hard: tuple[int, ...], eta: float
    ) -> None:
        self.model, self.region, self.plots, self.hard, self.eta = model, region, plots, hard, eta
        self.runs_of = [np.flatnonzero(plots == plot) for plot in np.unique(plots)]
        self.easy = [j for j in range(region.k) if j not in hard]

    def rows(self, points: FloatArray) -> FloatArray:
        flat = self.model.matrix(points.reshape(-1, self.region.k))
        return flat.reshape(*points.shape[:-1], self.model.p)

    def values(self, rows: FloatArray) -> FloatArray:
        sign, log_det = np.linalg.slogdet(plot_information(rows, self.plots, self.eta))
        found: FloatArray = np.where(sign > 0.0, log_det, -np.inf)
        return found

    def plan(self) -> kernels.Plan:
        """Plots and factors as the kernels take them."""
        model, region = self.model, self.region
        widths = [len(columns) for columns in model.columns]
        levels, level_at, terms, term_at = [np.empty((0, max(widths)))], [0], [np.empty(0, dtype=np.int64)], [0]
        for axis, columns in zip(region.axes, model.columns, strict=True):
            if axis is not None:
                points = np.tile(region.centre(), (len(axis), 1))
                points[:, len(level_at) - 1] = axis
                block = np.zeros((len(axis), max(widths)))
                block[:, : len(columns)] = model.base(points)[:, list(columns)]
                levels.append(block)
            level_at.append(sum(len(block) for block in levels))
            inside = np.isin(model.first, list(columns)) | np.isin(model.second, list(columns))
            terms.append(np.flatnonzero(inside))
            term_at.append(sum(len(some) for some in terms))
        return (
            np.append([runs[0] for runs in self.runs_of], len(self.plots)).astype(np.int64),
            np.isin(np.arange(region.k), self.hard),
            np.array([axis is None for axis in region.axes]),
            np.array([columns.start for columns in model.columns], dtype=np.int64),
            np.array(widths, dtype=np.int64),
            np.array(level_at, dtype=np.int64),
            np.concatenate(levels),
            np.array(term_at, dtype=np.int64),
            np.concatenate(terms),
            model.first,
            model.second,
        )

    def from_base(self, base: FloatArray) -> FloatArray:
        """Coded points (n, k) of base columns."""
        points = np.empty((len(base), self.region.k))
        for j, columns in enumerate(self.model.columns):
            factor = self.model.factors[j]
            points[:, j] = base[:, columns.start]
            if isinstance(factor, CategoricalFactor):
                off = base[:, None, list(columns)] - factor.contrasts[None]
                points[:, j] = np.argmin(np.sum(off**2, axis=2), axis=1)
        return points

    def start(self, starts: int, rng: np.random.Generator) -> FloatArray:
        points = self.region.sample(starts * len(self.plots), rng).reshape(starts, len(self.plots), self.region.k)
        if self.hard:
            for runs in self.runs_of:
                held = points.copy()
                for j in self.hard:
                    held[:, runs, j] = points[:, runs[:1], j]
                flat = held[:, runs].reshape(-1, self.region.k)
                good = np.all(self.region.feasible(flat).reshape(starts, -1), axis=1)
                # Where the shared value does not suit a run, the whole plot begins at one setting.
                points[:, runs] = np.where(good[:, None, None], held[:, runs], points[:, runs[:1]])
        return points

    def perturb(self, points: FloatArray, rng: np.random.Generator) -> FloatArray:
        """One plot of each design set anew."""
        fresh = self.start(len(points), rng)
        for i in range(len(points)):
            runs = self.runs_of[int(rng.integers(len(self.runs_of)))]
            points[i, runs] = fresh[i, runs]
        return points

    def exchange(self, points: FloatArray, levels: int, radius: float | None = None) -> FloatArray:
        """Coordinate exchange of all designs (s, n, k), in place; their values."""
        values = self.values(self.rows(points))
        for _ in range(_PASSES):
            before = values.copy()
            for members in self.runs_of:
                rest = self.rows(np.delete(points, members, axis=1))
                outside = plot_information(rest, np.delete(self.plots, members), self.eta)
                moves = [(members, j) for j in self.hard]
                moves += [(members[i : i + 1], j) for i in range(len(members)) for j in self.easy]
                for runs, j in moves:
                    values = self._move(points, members, outside, runs, j, levels, radius, values)
            gained = np.where(np.isfinite(before), values - before, np.where(np.isfinite(values), np.inf, 0.0))
            if not np.any(gained > _GAIN):
                break
        return values

    def _move(
        self,
        points: FloatArray,
        members: IntArray,
        outside: FloatArray,
        runs: IntArray,
        j: int,
        levels: int,
        radius: float | None,
        values: FloatArray,
    ) -> FloatArray:
        """Give coordinate j of ``runs``, in the plot ``members``, its best value in every design.

        ``outside`` (s, p, p): information of the other plots.
        """
        axis = self.region.axes[j]
        if axis is None:
            steps = np.linspace(-1.0, 1.0, levels)
            now = points[:, runs[0], j][:, None]
            tried = np.clip(now + radius * steps, -1.0, 1.0) if radius else np.repeat(steps[None, :], len(points), 0)
        else:
            tried = np.repeat(axis[None, :], len(points), axis=0)
        changed = np.repeat(points[:, None, runs, :], tried.shape[1], axis=1)
        changed[..., j] = tried[:, :, None]
        allowed = np.all(self.region.feasible(changed.reshape(-1, self.region.k)).reshape(*changed.shape[:-1]), axis=-1)
        own = np.repeat(self.rows(points[:, members])[:, None], tried.shape[1], axis=1)
        own[:, :, np.searchsorted(members, runs), :] = self.rows(changed)
        inside = plot_information(own, np.zeros(len(members), dtype=np.int64), self.eta)
        sign, log_det = np.linalg.slogdet(outside[:, None] + inside)
        found = np.where(allowed & (sign > 0.0), log_det, -np.inf)
        best = np.argmax(found, axis=1)
        reached = found[np.arange(len(points)), best]
        better = reached > values + _GAIN
        chosen = tried[np.arange(len(points)), best]
        for i in runs:
            points[better, i, j] = chosen[better]
        return np.where(better, reached, values)
