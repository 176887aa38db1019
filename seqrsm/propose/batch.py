"""The next batch of runs, chosen one by one for what each adds to those before it."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Literal

import numpy as np

from seqrsm.arrays import BoolArray, FloatArray
from seqrsm.design.quadratic import QuadraticModel
from seqrsm.design.region import Region
from seqrsm.errors import DesignError, Problem
from seqrsm.fit.optimum import Goal
from seqrsm.fit.rank_one import downdate, information_gain, is_reserved_run, linear_gain, optimum_targets
from seqrsm.progress import tell
from seqrsm.propose.candidates import candidate_points, jitter
from seqrsm.propose.criteria import CRITERIA, average_matrix, relative_drop, unscaled_covariance
from seqrsm.propose.steepest import steepest_points

Purpose = Literal["optimum", "regret", "repeat", "spread", "average", "thompson", "steepest", "tie"]
Rows = Callable[[FloatArray], FloatArray]
"""Model rows (n, p) of coded points (n, k)."""


_MAX_TARGETS = 128
_BARRED_RADIUS = 0.1
_REFINE_RADII = (0.1, 0.03, 0.01)
_REFINE_POINTS = 48


@dataclass(frozen=True, slots=True)
class Proposal:
    """One run to be made.

    Attributes
    ----------
    point : ndarray (k,)
        Coded settings, feasible.
    purpose : str
        "optimum" (value there), "regret" (place of it), "repeat" (pure error), "spread" (whole region, lack of fit),
        "average" (I criterion), "thompson", "steepest", or "tie" (settings of earlier blocks in the new one).
    gain : float
        Drop of the criterion per unit of cost; only comparable within a purpose.
    why : str
        One line with the number behind it.
    repeats : bool
        The settings were run, or are pending, already.
    """

    point: FloatArray
    purpose: Purpose
    gain: float
    why: str
    repeats: bool


@dataclass(slots=True)
class _Candidates:
    points: FloatArray
    rows: FloatArray
    executed: BoolArray
    cost: FloatArray


def propose_batch(
    model: QuadraticModel,
    region: Region,
    *,
    Z_done: FloatArray,
    x_hat: FloatArray,
    target_points: FloatArray,
    n: int,
    points_done: FloatArray | None = None,
    weights_done: FloatArray | None = None,
    prior_precision: FloatArray | None = None,
    df_pure_error: int = 0,
    criterion: str = "optimum",
    spread_share: float = 0.25,
    min_df_pure_error: int = 4,
    weight: float = 1.0,
    cost: Callable[[FloatArray], FloatArray] | None = None,
    seed: int = 0,
    n_candidates: int = 2000,
    barred: FloatArray | None = None,
    rows: Rows | None = None,
    target_rows: Rows | None = None,
    beta: FloatArray | None = None,
    goal: Goal = "maximize",
    ties: int = 0,
) -> tuple[Proposal, ...]:
    """Choose the next ``n`` runs.

    Each run is the candidate with the largest gain per cost, given all runs before it in the batch. Candidates cover
    the region, the estimated optimum and posterior draws of it with a cloud around them, and the executed settings. A
    share of the runs is kept for repeats until there is enough pure error, and from then on for the least known places,
    so that lack of fit stays testable.

    Parameters
    ----------
    model, region : QuadraticModel, Region
    Z_done : ndarray (r, p) or (r, p + e)
        Model rows of all scored and pending runs; e further columns (blocks) are nuisance and zero for new runs.
    x_hat : ndarray (k,)
        Estimated optimum, coded.
    target_points : ndarray (m, k)
        Optima of posterior draws, coded; 64 or more are advised.
    n : int
        Runs to propose, >= 0.
    points_done : ndarray (r, k), optional
        Coded settings of the scored and pending runs, which repeats are chosen from.
    weights_done : ndarray (r,), optional
        Relative weights of those runs; 1 by default.
    prior_precision : ndarray (p, p) or (p + e, p + e), optional
        Added to Z'WZ, in units of 1/sigma squared. Where runs and prior together leave a coefficient undetermined,
        0.01 (coefficients within 10 sigma) is added.
    df_pure_error : int
        Degrees of freedom of pure error, with those that pending repeats will bring.
    criterion : "optimum", "D", "I", "thompson" or "steepest"
        "optimum" is half value at the optimum, half expected regret.
    spread_share : float
        Share of runs kept for repeats and spread, in [0, 1]; counted over the whole campaign.
    min_df_pure_error : int
        Below it the kept runs are repeats.
    weight : float
        Relative weight of a new run.
    cost : callable, optional
        Cost > 0 of coded points (n, k) -> (n,); divides the gain.
    seed : int
        Fixes the cloud; equal inputs and seed give equal proposals.
    n_candidates : int
        Points that cover the region.
    barred : ndarray (b, k), optional
        Settings that could not be carried out: nothing within 0.1 (coded) of one of them is proposed, unless that
        leaves nothing.
    rows, target_rows : callable, optional
        Model rows of new runs, and of the runs that the campaign is about, where these are not simply those of
        ``model``: a simulated run has no discrepancy, the flights that it is to predict have.
    beta : ndarray (p,), optional
        Coefficients, for "steepest".
    goal : "maximize" or "minimize"
        For the same.
    ties : int
        How many runs, the first ones, repeat executed settings to tell the effect of a new block from the surface: the
        last column of ``Z_done`` and of ``rows`` is then that of the new block, 1 in its runs.

    Returns
    -------
    tuple of Proposal

    Raises
    ------
    DesignError
        Unknown criterion, or "steepest" without coefficients.
    """
    if criterion not in CRITERIA:
        raise DesignError(
            Problem("unknown criterion", f"Use one of {', '.join(CRITERIA)}.", "", None, "criterion", criterion)
        )
    if criterion == "steepest" and beta is None:
        raise DesignError(Problem("steepest ascent needs a fitted surface", "Score the start design first."))
    if n <= 0:
        return ()
    rng = np.random.default_rng(seed)
    done = np.empty((0, region.k)) if points_done is None else np.atleast_2d(np.asarray(points_done, dtype=np.float64))
    engine = _Engine(
        model=model,
        region=region,
        C=unscaled_covariance(Z_done, weights_done, prior_precision),
        x_hat=np.asarray(x_hat, dtype=np.float64),
        targets=_thin(np.atleast_2d(np.asarray(target_points, dtype=np.float64))),
        criterion=criterion,
        weight=weight,
        cost=cost,
        rng=rng,
        barred=np.empty((0, region.k)) if barred is None else np.atleast_2d(np.asarray(barred, dtype=np.float64)),
        new_rows=rows,
        target_rows=target_rows,
    )
    points, executed = candidate_points(region, engine.x_hat, engine.targets, done, rng, n_candidates)
    allowed = engine.allowed(points)
    if allowed.any():
        points, executed = points[allowed], executed[allowed]
    engine.candidates = engine.evaluate(points, executed)
    path: list[FloatArray] = []
    if criterion == "steepest" and beta is not None:
        path = list(steepest_points(model, region, np.asarray(beta, dtype=np.float64), region.centre(), n, goal))
    proposals = []
    n_before = len(Z_done)
    for i in range(n):
        tell("choosing the next runs", i, n)
        reserved = is_reserved_run(n_before + i, spread_share)
        if i < ties and engine.candidates.executed.any():
            proposal = engine.tie()
        elif path and not reserved:
            proposal = engine.along(path.pop(0))
        elif reserved and df_pure_error < min_df_pure_error and engine.candidates.executed.any():
            proposal = engine.repeat(df_pure_error)
        elif reserved:
            proposal = engine.spread()
        else:
            proposal = engine.best()
        df_pure_error += proposal.repeats
        proposals.append(proposal)
        engine.take(proposal)
    return tuple(proposals)


class _Engine:
    """Candidates and the covariance that falls with every run taken."""

    candidates: _Candidates

    def __init__(
        self,
        *,
        model: QuadraticModel,
        region: Region,
        C: FloatArray,
        x_hat: FloatArray,
        targets: FloatArray,
        criterion: str,
        weight: float,
        cost: Callable[[FloatArray], FloatArray] | None,
        rng: np.random.Generator,
        barred: FloatArray,
        new_rows: Rows | None,
        target_rows: Rows | None,
    ) -> None:
        self.barred = barred
        self.new_rows = model.matrix if new_rows is None else new_rows
        self.target_rows = model.matrix if target_rows is None else target_rows
        self.model, self.region, self.C = model, region, C
        self.x_hat, self.targets = x_hat, targets
        self.criterion, self.weight, self.cost, self.rng = criterion, weight, cost, rng
        self.z_hat = self.padded(self.target_rows(x_hat[None, :]))[0]
        self.W_value, self.W_regret = optimum_targets(self.z_hat, self.padded(self.target_rows(targets)))

    def rows(self, points: FloatArray) -> FloatArray:
        """Model rows, with zeros for nuisance columns."""
        return self.padded(self.new_rows(points))

    def padded(self, Z: FloatArray) -> FloatArray:
        extra = len(self.C) - Z.shape[1]
        return np.hstack([Z, np.zeros((len(Z), extra))]) if extra else Z

    def allowed(self, points: FloatArray) -> BoolArray:
        """Points that are not beside settings that could not be carried out."""
        if not len(self.barred):
            return np.ones(len(points), dtype=np.bool_)
        free = list(self.region.continuous)
        held = [j for j in range(self.region.k) if j not in free]
        near = np.all(np.abs(points[:, None, free] - self.barred[None, :, free]) <= _BARRED_RADIUS, axis=-1)
        same = np.all(np.abs(points[:, None, held] - self.barred[None, :, held]) < 1e-9, axis=-1)
        clear: BoolArray = ~np.any(near & same, axis=1)
        return clear

    def along(self, point: FloatArray) -> Proposal:
        """A point of the path of steepest ascent."""
        found = self.evaluate(point[None, :], np.zeros(1, dtype=bool))
        executed = bool(np.any(np.all(self.candidates.points[self.candidates.executed] == point, axis=1)))
        why = f"on the path of steepest ascent from the centre; {self.narrowing(found.rows[0])}"
        gain = float(self.gains(found, "optimum")[0])
        return Proposal(point, "steepest", gain, self._repeated(why, executed), executed)

    def evaluate(self, points: FloatArray, executed: BoolArray) -> _Candidates:
        cost = np.ones(len(points)) if self.cost is None else np.asarray(self.cost(points), dtype=np.float64)
        return _Candidates(points, self.rows(points), executed, cost)

    def gains(self, candidates: _Candidates, purpose: str) -> FloatArray:
        """Gain per cost of each candidate."""
        if purpose == "D":
            gain = information_gain(self.C, candidates.rows, self.weight)
        elif purpose == "I":
            gain = linear_gain(self.C, self.average(), candidates.rows, self.weight)
        else:
            gain = linear_gain(self.C, self.W_value + self.W_regret, candidates.rows, self.weight)
        per_cost: FloatArray = gain / candidates.cost
        return per_cost

    def average(self) -> FloatArray:
        W = np.zeros_like(self.C)
        p = self.model.p
        W[:p, :p] = average_matrix(self.model, self.region)
        return W

    def best(self) -> Proposal:
        if self.criterion == "thompson":
            return self.thompson()
        if self.criterion == "D":
            return self.spread(among_executed=True)
        # The path of steepest ascent may be shorter than the batch.
        purpose = "I" if self.criterion == "I" else "optimum"
        point, z, gain, executed = self.pick(purpose, np.ones(len(self.candidates.points), dtype=bool))
        if self.criterion == "I":
            W = self.average()
            share = relative_drop(self.C, W, z, self.weight)
            why = f"lowers the mean prediction variance over the region by {_percent(share)}"
            return Proposal(point, "average", gain, why, executed)
        value = linear_gain(self.C, self.W_value, z[None, :], self.weight)[0]
        regret = linear_gain(self.C, self.W_regret, z[None, :], self.weight)[0]
        if regret > value:
            share = relative_drop(self.C, self.W_regret, z, self.weight)
            why = f"lowers the expected loss from a misplaced optimum by {_percent(share)}"
            return Proposal(point, "regret", gain, self._repeated(why, executed), executed)
        return Proposal(point, "optimum", gain, self._repeated(self.narrowing(z), executed), executed)

    def repeat(self, df_pure_error: int) -> Proposal:
        point, z, gain, _ = self.pick("optimum", self.candidates.executed, refine=False)
        why = (
            f"repeats settings already run: pure error gets {df_pure_error + 1} degrees of freedom instead of "
            f"{df_pure_error}; {self.narrowing(z)}"
        )
        return Proposal(point, "repeat", gain, why, True)

    def tie(self) -> Proposal:
        """The executed settings that tell most of the new block's effect, the last coefficient."""
        CZ = self.candidates.rows @ self.C
        drop = CZ[:, -1] ** 2 / (1.0 / self.weight + np.sum(CZ * self.candidates.rows, axis=1)) / self.candidates.cost
        index = int(np.argmax(np.where(self.candidates.executed, drop, -np.inf)))
        left = max(float(self.C[-1, -1] - drop[index] * self.candidates.cost[index]), 0.0)
        why = (
            "ties the new block to the earlier ones: repeats settings already run, so that its effect is known to "
            f"{np.sqrt(left):.2g} s"
        )
        return Proposal(self.candidates.points[index].copy(), "tie", float(drop[index]), why, True)

    def spread(self, among_executed: bool = False) -> Proposal:
        allowed = ~self.candidates.executed
        if among_executed or not allowed.any():
            allowed = np.ones_like(allowed)
        point, z, gain, executed = self.pick("D", allowed)
        se = float(np.sqrt(z @ self.C @ z))
        why = f"the mean is least known here (standard error {se:.2g} s): keeps lack of fit testable over the region"
        return Proposal(point, "spread", gain, self._repeated(why, executed), executed)

    def thompson(self) -> Proposal:
        point = self.targets[int(self.rng.integers(len(self.targets)))].copy()
        found = self.evaluate(point[None, :], np.zeros(1, dtype=bool))
        se = float(np.sqrt(found.rows[0] @ self.C @ found.rows[0]))
        executed = bool(np.any(np.all(self.candidates.points[self.candidates.executed] == point, axis=1)))
        why = f"a posterior draw has its optimum here (standard error of the mean {se:.2g} s)"
        return Proposal(
            point, "thompson", float(self.gains(found, "optimum")[0]), self._repeated(why, executed), executed
        )

    def narrowing(self, z: FloatArray) -> str:
        """What a run at row z does to the two intervals at the estimated optimum."""
        h = float(self.z_hat @ self.C @ self.z_hat)
        C = downdate(self.C, z, self.weight)
        h_new = max(float(self.z_hat @ C @ self.z_hat), 0.0)
        prediction = 1.0 - np.sqrt((1.0 / self.weight + h_new) / (1.0 / self.weight + h))
        confidence = 1.0 - np.sqrt(h_new / h) if h > 0.0 else 0.0
        return (
            f"narrows the prediction interval at the optimum by {_percent(prediction)}, the confidence interval of the "
            f"mean by {_percent(confidence)}"
        )

    @staticmethod
    def _repeated(why: str, executed: bool) -> str:
        return f"{why}; repeats settings already run" if executed else why

    def pick(self, purpose: str, allowed: BoolArray, refine: bool = True) -> tuple[FloatArray, FloatArray, float, bool]:
        """Best allowed candidate, moved a little where that gains: point, row, gain, whether executed."""
        gains = np.where(allowed, self.gains(self.candidates, purpose), -np.inf)
        index = int(np.argmax(gains))
        point, z, gain = self.candidates.points[index], self.candidates.rows[index], float(gains[index])
        if self.candidates.executed[index] or not refine or not self.region.continuous:
            return point.copy(), z, gain, bool(self.candidates.executed[index])
        for radius in _REFINE_RADII:
            near = jitter(self.region, np.repeat(point[None, :], _REFINE_POINTS, axis=0), radius, self.rng)
            # Settings with three decimals of the coded range are all that a sensor can be told apart by.
            near = near[self.region.feasible(near, tol=0.0) & self.allowed(near)]
            if not len(near):
                continue
            found = self.evaluate(near, np.zeros(len(near), dtype=bool))
            values = self.gains(found, purpose)
            best = int(np.argmax(values))
            if values[best] > gain:
                point, z, gain = near[best], found.rows[best], float(values[best])
        return point.copy(), z, gain, False

    def take(self, proposal: Proposal) -> None:
        """Count a run as made; its settings can be repeated from now on."""
        z = self.rows(proposal.point[None, :])[0]
        self.C = downdate(self.C, z, self.weight)
        if not proposal.repeats:
            new = self.evaluate(proposal.point[None, :], np.ones(1, dtype=bool))
            old = self.candidates
            # The same point may be among the candidates as one not run yet.
            other = ~np.all(old.points == proposal.point, axis=1)
            self.candidates = _Candidates(
                np.vstack([old.points[other], new.points]),
                np.vstack([old.rows[other], new.rows]),
                np.concatenate([old.executed[other], new.executed]),
                np.concatenate([old.cost[other], new.cost]),
            )


def _percent(share: float) -> str:
    return f"{100.0 * share:.2g} %"


def _thin(points: FloatArray) -> FloatArray:
    step = max(1, -(-len(points) // _MAX_TARGETS))
    return points[::step]
