"""Search for the rows of an optimal design: exchange among candidates, then descent of all coordinates together."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import scipy

from seqrsm.arrays import FloatArray, first_of_largest
from seqrsm.design import search
from seqrsm.design.quadratic import QuadraticModel
from seqrsm.design.region import Region
from seqrsm.progress import tell

_SEARCHING = "searching the design"
_CANDIDATES, _FEW_FACTORS = 3**8, 3
_CHAIN = 20  # local searches of a chain
_REPLACED = (4, 20)  # rows drawn anew between two of them
_FEWEST, _SURE = 100, 60  # searches made at least, and those of them that come to one value, which ends the rest
_NEAR = 0.02  # an exchange that ends further below the chain's best than this is not worth a descent
_MAX_PASSES, _MAX_ROUNDS, _FINISHED = 60, 20, 4
_COARSE, _FINE, _SAME = 1e-3, 1e-9, 1e-5  # of the criterion: of a pass of exchanges, of a last round, of two optima
# Smallest eigenvalue of M with unit diagonal: below the first M is singular but for rounding, below the second too
# near to it to be exchanged from (random runs over many levels are), and a ridge carries the search out of there.
_SINGULAR, _DOUBTFUL, _RIDGE = 1e-14, 1e-8, 1e-2
_ITERATIONS, _GAIN = 100, 1e-12  # of a descent: at most, and of the last
_LEAST_RIDGE = 1e-10  # share of the mean diagonal of M added to it: a singular design has a huge variance, not none
_DIFFERENCE = 1e-6


def covariance(M: FloatArray) -> FloatArray:
    """Inverse of M (p, p), of one that is next to singular too."""
    return np.asarray(np.linalg.inv(M + _LEAST_RIDGE * float(np.trace(M)) / len(M) * np.eye(len(M))))


def in_coordinates(model: QuadraticModel, region: Region, base: FloatArray, pulled: FloatArray) -> FloatArray:
    """Slope (n, c) in the continuous coordinates, from that in the rows (n, p) of the model matrix.

    ``base`` are the base columns of the design, of which each term is a product of two.
    """
    slope = np.zeros_like(base.T)
    np.add.at(slope, model.first, (pulled * base[:, model.second]).T)
    np.add.at(slope, model.second, (pulled * base[:, model.first]).T)
    return slope[[model.columns[j].start for j in region.continuous]].T


@dataclass(frozen=True, slots=True)
class Task:
    """What is to be searched."""

    n: int
    """Rows to choose."""
    precision: FloatArray
    """(p, p): what fixed rows bring to M."""
    weight: FloatArray | None
    """(p, p): None: maximise log|M|. Else: minimise tr(weight M^-1)."""

    def value(self, Z: FloatArray) -> float:
        """Value to be maximised, from rows (n, p) of the model matrix: log|M| or -log tr(weight M^-1)."""
        M = self.precision + Z.T @ Z
        if smallest_eigenvalue(M) <= _SINGULAR * M.shape[0]:
            return -np.inf
        if self.weight is None:
            return float(np.linalg.slogdet(M)[1])
        trace = float(np.trace(np.linalg.solve(M, self.weight)))
        return -float(np.log(trace)) if trace > 0.0 else -np.inf

    def loss(self, model: QuadraticModel, region: Region, points: FloatArray) -> tuple[float, FloatArray]:
        """Less the value, and its slope (n, c) in the continuous coordinates of a design (n, k)."""
        base = model.base(points)
        F = base[:, model.first] * base[:, model.second]
        M = self.precision + F.T @ F
        D = covariance(M)
        if self.weight is None:
            return -float(np.linalg.slogdet(M)[1]), in_coordinates(model, region, base, -2.0 * F @ D)
        trace = float(np.sum(self.weight * D))
        return float(np.log(trace)), in_coordinates(model, region, base, F @ (D @ self.weight @ D) * (-2.0 / trace))


def smallest_eigenvalue(M: FloatArray) -> float:
    """Smallest eigenvalue of a symmetric matrix (p, p) scaled to unit diagonal; 0 where the diagonal has a 0."""
    d = np.sqrt(np.diagonal(M))
    if not np.all(d > 0.0):
        return 0.0
    return float(np.linalg.eigvalsh(M / np.outer(d, d))[0])


def search_candidates(
    model: QuadraticModel, candidates: FloatArray, task: Task, starts: int, rng: np.random.Generator
) -> tuple[float, FloatArray]:
    """Value and rows (n, k) of the best of some local optima over candidates (m, k), from random starts."""
    rows, best = model.matrix(candidates), (-np.inf, candidates[: task.n])
    for start in range(starts):
        tell(_SEARCHING, start, starts)
        points = _drawn(candidates, task.n, rng)
        value = _from_anywhere(model, points, candidates, rows, task)
        if value > best[0] + _FINE:
            best = value, points
    return best


def search_region(
    model: QuadraticModel, region: Region, task: Task, searches: int, seed: int
) -> tuple[FloatArray, int, int]:
    """Best rows (n, k) by so many local searches of a region; how many ended at their value, of how many made.

    Chains of local searches: the first from random candidates, each further one from the best of its chain with some
    rows drawn anew (iterated local search); where many come to one value, they end early. In a box each ends in a
    descent of all coordinates, which is dear within constraints. The best of the best few chains are exchanged and
    descended until neither gains: candidates jump over oblique edges, descent finds what lies between them. None ends
    where all were singular.
    """
    rng = np.random.default_rng([seed, 1])
    candidates = region.candidates(5 if region.k <= _FEW_FACTORS else 3, limit=_CANDIDATES)
    rows = model.matrix(candidates)
    worth = _NEAR * (model.p if task.weight is None else 1.0)
    values: list[float] = []
    tops: list[tuple[float, FloatArray]] = []
    for number in range(searches):
        tell(_SEARCHING, number, searches)
        exchanged = number % 2 == 0 or not region.is_box
        if number % _CHAIN == 0:
            tops.append((-np.inf, candidates))
        top, points = tops[-1]
        if np.isfinite(top):
            points = points.copy()
            some = rng.choice(task.n, min(int(rng.integers(*_REPLACED)), task.n), replace=False)
            points[some] = _drawn(candidates, len(some), rng) if exchanged else region.sample(len(some), rng)
        else:
            points = _drawn(candidates, task.n, rng)
        value = _from_anywhere(model, points, candidates, rows, task) if exchanged else np.inf
        if region.is_box and value > top - worth:
            value, points = _descended(model, region, task, points)
        values.append(value)
        if value > top + _FINE:
            tops[-1] = value, points
        hits = int(np.count_nonzero(np.array(values) > max(values) - _SAME))
        if number + 1 >= _FEWEST and hits >= _SURE:
            break
    tops.sort(key=lambda pair: -pair[0])
    if not np.isfinite(tops[0][0]):
        return tops[0][1], 0, len(values)
    ends = [_finished(model, region, task, candidates, top) for top in tops[:_FINISHED] if np.isfinite(top[0])]
    return max(ends, key=lambda pair: pair[0])[1], hits, len(values)


def _finished(
    model: QuadraticModel, region: Region, task: Task, candidates: FloatArray, top: tuple[float, FloatArray]
) -> tuple[float, FloatArray]:
    """Value and design (n, k) that neither exchange nor descent betters."""
    (before, points), rows = top, model.matrix(candidates)
    for _ in range(_MAX_ROUNDS):
        _, points = _descended(model, region, task, points)
        value = _exchange(points, model.matrix(points), candidates, rows, task, _FINE)
        if not value > before + _FINE:
            break
        before = value
    return value, points


def _drawn(candidates: FloatArray, n: int, rng: np.random.Generator) -> FloatArray:
    chosen: FloatArray = candidates[rng.choice(len(candidates), n, replace=len(candidates) < n)]
    return chosen


def _descended(model: QuadraticModel, region: Region, task: Task, start: FloatArray) -> tuple[float, FloatArray]:
    """Value and design (n, k) with its continuous coordinates moved; as it was where that made it no better.

    By scipy's L-BFGS-B in a box, by SLSQP within constraints.
    """
    before = task.value(model.matrix(start))
    free = list(region.continuous)
    if not free:
        return before, start

    def design(x: FloatArray) -> FloatArray:
        points = start.copy()
        points[:, free] = x.reshape(-1, len(free))
        return points

    def valued(x: FloatArray) -> tuple[float, FloatArray]:
        found, slope = task.loss(model, region, design(x))
        return found, slope.ravel()

    def slacks(x: FloatArray) -> FloatArray:
        return np.nan_to_num(region.slacks(design(x)), nan=-1.0, posinf=1.0, neginf=-1.0).ravel()

    def slack_slopes(x: FloatArray) -> FloatArray:
        n, c = len(start), len(free)
        here, slopes = slacks(x).reshape(n, -1), np.zeros((n, len(region.constraints), n, c))
        for column in range(c):
            moved = x.reshape(n, c).copy()
            # Inwards, so that a logarithm or root is not asked beyond the bound.
            step = np.where(moved[:, column] > 0.0, -_DIFFERENCE, _DIFFERENCE)
            moved[:, column] += step
            slopes[range(n), :, range(n), column] = (slacks(moved).reshape(n, -1) - here) / step[:, None]
        return slopes.reshape(-1, n * c)

    constraints: Any = () if region.is_box else ({"type": "ineq", "fun": slacks, "jac": slack_slopes},)
    options: Any = {"maxiter": _ITERATIONS, "ftol": _GAIN}
    found = scipy.optimize.minimize(
        valued,
        start[:, free].ravel(),
        jac=True,
        method="SLSQP" if constraints else "L-BFGS-B",
        bounds=[(-1.0, 1.0)] * (len(start) * len(free)),
        constraints=constraints,
        options=options,
    )
    moved = design(np.clip(found.x, -1.0, 1.0))
    out = region.slack(moved) < 0.0
    moved[out] = search.bisect(start[out], moved[out], region.slack)
    after = task.value(model.matrix(moved))
    return (after, moved) if after > before else (before, start)


def _from_anywhere(
    model: QuadraticModel, points: FloatArray, candidates: FloatArray, rows: FloatArray, task: Task
) -> float:
    """Exchange rows in place, from a design that may be singular; returns the value reached."""
    Z = model.matrix(points)
    if smallest_eigenvalue(task.precision + Z.T @ Z) < _DOUBTFUL:
        ridge = replace(task, precision=task.precision + _RIDGE * np.eye(model.p), weight=None)
        _exchange(points, Z, candidates, rows, ridge, _COARSE)
        Z = model.matrix(points)
    return _exchange(points, Z, candidates, rows, task, _COARSE)


def _exchange(
    points: FloatArray, Z: FloatArray, candidates: FloatArray, rows: FloatArray, task: Task, pass_gain: float
) -> float:
    """Replace each row by the best candidate until a pass gains less, in place; returns the value reached.

    Gains are those of the exchange of one row: determinant ratio (1 + d_n)(1 - d_o) + d_no^2; fall of the trace
    [(1 - d_o) e_n + 2 d_no e_no - (1 + d_n) e_o] / ratio (Fedorov 1972; row by row: Cook & Nachtsheim 1980,
    Technometrics 22, 315-324).
    """
    value = task.value(Z)
    if not np.isfinite(value):
        return value
    for _ in range(_MAX_PASSES):
        before, moved = value, True
        for i in range(len(points)):
            if moved:
                D = np.linalg.inv(task.precision + Z.T @ Z)
                if i == 0:  # later it is kept up, which is less work
                    d_n = np.einsum("ij,ij->i", rows @ D, rows)
                if task.weight is not None:
                    E = D @ task.weight @ D
                    e_n = np.einsum("ij,ij->i", rows @ E, rows)
            D_o = D @ Z[i]
            d_o, d_no = float(Z[i] @ D_o), rows @ D_o
            ratio = (1.0 - d_o) * (1.0 + d_n) + d_no**2
            gains, least = ratio - 1.0, 1e-9
            if task.weight is not None:
                E_o = E @ Z[i]
                fall = (1.0 - d_o) * e_n + 2.0 * d_no * (rows @ E_o) - (1.0 + d_n) * float(Z[i] @ E_o)
                gains = np.where(ratio > 1e-9, fall / np.maximum(ratio, 1e-9), -np.inf)
                least *= float(np.exp(-before))
            best = first_of_largest(gains)
            moved = bool(gains[best] > least)
            if moved:
                d_nb = rows @ (D @ rows[best])
                fall_d = (1.0 - d_o) * d_nb**2 + 2.0 * d_no[best] * d_no * d_nb - (1.0 + d_n[best]) * d_no**2
                d_n = d_n - fall_d / ratio[best]
                Z[i], points[i] = rows[best], candidates[best]
        value = task.value(Z)
        if not value > before + pass_gain:
            break
    return value
