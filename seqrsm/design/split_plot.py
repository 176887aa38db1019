"""Designs in plots: flights whose settings stay, and blocks such as days.

A hard-to-change factor keeps its value within a plot (a flight); runs of one plot share a random effect, so that with
V = I + eta ZZ' (eta the variance of plots over that of runs) the information is

    M = X'V^-1 X = X'X - sum_w  eta / (1 + m_w eta) s_w s_w',    s_w the sum of the m_w rows of plot w

(Goos & Vandebroek 2003, Technometrics 45, 235-245). Fixed blocks are the limit of a large eta, without hard factors.
Many starts are exchanged coordinate by coordinate at the same time.
"""

from __future__ import annotations

import numpy as np

from seqrsm.arrays import FloatArray, IntArray
from seqrsm.design.quadratic import QuadraticModel
from seqrsm.design.region import Region
from seqrsm.errors import DesignError, Problem

FIXED_BLOCKS = 1e4
"""Variance ratio that stands for fixed blocks."""

_COARSE = 3
_STARTS, _KEPT, _ROUNDS = 96, 12, 4
_PASSES = 25
_GAIN, _SAME = 1e-9, 1e-8
_ZOOMS = (0.2, 0.05)


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
    starts: int = _STARTS,
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
    starts : int
        Random starts.

    Returns
    -------
    ndarray (n, k)
        Coded points, plot by plot.

    Raises
    ------
    DesignError
        Too few runs or plots for the model's terms.
    """
    _check(model, plots, hard)
    rng = np.random.default_rng([seed, 3])
    engine = _Plots(model, region, np.asarray(plots), hard, eta)
    points = engine.start(starts, rng)
    values = engine.exchange(points, _COARSE)
    for _ in range(_ROUNDS):
        best = _best(values, _KEPT)
        points, values = points[best], values[best]
        others = engine.perturb(np.repeat(points, max(starts // _KEPT // 2, 1), axis=0), rng)
        points = np.concatenate([points, others])
        values = np.concatenate([values, engine.exchange(others, _COARSE)])
    # On finer levels the order may change: designs that are best on coarse ones differ in what they gain.
    points = points[_best(values, _KEPT)]
    values = engine.exchange(points, 5)
    for radius in _ZOOMS:
        values = engine.exchange(points, _COARSE, radius)
    if not np.isfinite(values.max()):
        raise DesignError(Problem("every design tried was singular", "Ask for more runs or more plots."))
    found: FloatArray = points[int(np.argmax(values))]
    return found


def _best(values: FloatArray, count: int) -> IntArray:
    """Indices of the best values, at most ``count``, equal ones once: copies of one design crowd out all others."""
    order = np.argsort(-values, kind="stable")[: max(int(np.count_nonzero(np.isfinite(values))), 1)]
    fresh = np.append(True, np.abs(np.diff(values[order])) > _SAME * np.abs(values[order[1:]]))
    found: IntArray = order[fresh][:count]
    return found


def _check(model: QuadraticModel, plots: IntArray, hard: tuple[int, ...]) -> None:
    if len(plots) < model.p:
        raise DesignError(Problem(f"{len(plots)} runs cannot estimate {model.p} terms", f"Ask for {model.p} or more."))
    names = [model.factors[j].name for j in hard]
    alone = [t for t in model.terms if t.kind == "intercept" or all(name in names for name in t.factors)]
    n_plots = len(np.unique(plots))
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
