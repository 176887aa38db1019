"""Search for the rows of an optimal design: among candidates, in a box (compiled), in a region with constraints."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from threading import Thread
from typing import TYPE_CHECKING, Any

import numpy as np

from seqrsm.arrays import FloatArray
from seqrsm.design.factors import CategoricalFactor
from seqrsm.design.quadratic import QuadraticModel
from seqrsm.design.region import Region
from seqrsm.progress import heard, tell

if TYPE_CHECKING:
    from seqrsm.design.kernels import Layout

# Starts with log|M|/p below this are drawn anew: an exchange from there ends in poor optima.
_FLOOR_PER_TERM = -6.0
# A wandering step of the iterated local search may fall by this share of the criterion.
_THRESHOLD = 0.002
_CANDIDATES = 3000
_POLISHED = 2
_MAX_PASSES = 60
# In all for one design: in an oblique sliver coordinate moves creep along it, thousands of passes for a per mille.
_POLISH_PASSES = 120
_COARSE, _PASS_GAIN = 1e-3, 1e-9
_SEARCHING, _TOLD_EVERY_S = "searching the design", 0.2
# Smallest eigenvalue of M with unit diagonal: below the first M is singular but for rounding, below the second too
# near to it to be exchanged from (random runs over many levels are), and a ridge carries the search out of there.
_SINGULAR, _DOUBTFUL, _RIDGE = 1e-14, 1e-8, 1e-2


@dataclass(frozen=True, slots=True)
class Task:
    """What is to be searched.

    Parameters
    ----------
    n : int
        Rows to choose.
    precision : ndarray (p, p)
        What the prior and fixed rows bring to M.
    weight : ndarray (p, p) or None
        None: maximise log|M|. Else: minimise tr(weight M^-1).
    """

    n: int
    precision: FloatArray
    weight: FloatArray | None

    @property
    def kernel_weight(self) -> FloatArray:
        """Weight as the kernels take it."""
        return np.zeros_like(self.precision) if self.weight is None else self.weight

    def value(self, Z: FloatArray) -> float:
        """Value to be maximised, from rows (n, p) of the model matrix: log|M| or -log tr(weight M^-1)."""
        M = self.precision + Z.T @ Z
        if smallest_eigenvalue(M) <= _SINGULAR * M.shape[0]:
            return -np.inf
        if self.weight is None:
            return float(np.linalg.slogdet(M)[1])
        trace = float(np.trace(np.linalg.solve(M, self.weight)))
        return -float(np.log(trace)) if trace > 0.0 else -np.inf


def smallest_eigenvalue(M: FloatArray) -> float:
    """Smallest eigenvalue of a symmetric matrix (p, p) scaled to unit diagonal; 0 where the diagonal has a 0."""
    d = np.sqrt(np.diagonal(M))
    if not np.all(d > 0.0):
        return 0.0
    return float(np.linalg.eigvalsh(M / np.outer(d, d))[0])


def layout(model: QuadraticModel, region: Region) -> Layout:
    """Arrays that describe factors and terms to the kernels; see :mod:`seqrsm.design.kernels`."""
    kind, count, spans, span_at, term_at = [], [], [], [0], [0]
    terms: list[int] = []
    own: list[int] = []
    other: list[int] = []
    for factor, columns, levels in zip(model.factors, model.columns, region.axes, strict=True):
        categorical = isinstance(factor, CategoricalFactor)
        kind.append(int(categorical))
        count.append(0 if levels is None or not categorical else levels.size)
        spans += [(-1.0, 1.0)] if levels is None else [(float(v), float(v)) for v in levels]
        span_at.append(len(spans))
        for t, (a, b) in enumerate(zip(model.first.tolist(), model.second.tolist(), strict=True)):
            if a in columns or b in columns:
                terms.append(t)
                own.append(a if a in columns else b)
                other.append(-1 if a in columns and b in columns else (b if a in columns else a))
        term_at.append(len(terms))
    starts = [columns.start for columns in model.columns]
    integers = [np.array(x, dtype=np.int64) for x in (kind, starts, count, span_at, term_at, terms, own, other)]
    kind_, column, count_, span_at_, term_at_, terms_, own_, other_ = integers
    return (kind_, column, count_, np.array(spans), span_at_, term_at_, terms_, own_, other_, model.first, model.second)


def search_box(
    model: QuadraticModel, region: Region, task: Task, chains: int, starts: int, moves: int, seed: int
) -> tuple[FloatArray, int]:
    """Best rows (n, k) found in a box, and how many local searches ended at their value."""
    p = model.p
    threshold = _THRESHOLD * (p if task.weight is None else 1.0)
    points, value, hits = _told(
        chains * (starts + moves),
        seed,
        task.n,
        1 + sum(len(columns) for columns in model.columns),
        task.precision,
        task.kernel_weight,
        task.weight is not None,
        layout(model, region),
        chains,
        starts,
        moves,
        threshold,
        _FLOOR_PER_TERM * p,
    )
    return points, hits if np.isfinite(value) else 0


def _told(total: int, *arguments: Any) -> tuple[FloatArray, float, int]:
    """The compiled search; where somebody listens it runs in a thread of its own and its count is told meanwhile."""
    done = np.zeros(1, dtype=np.int64)
    from seqrsm.design import kernels  # numba: compiled where a box is searched, not for a start design

    search: Callable[..., tuple[FloatArray, float, int]] = kernels.search
    if not heard():
        return search(*arguments, done)
    found: list[tuple[FloatArray, float, int] | BaseException] = []

    def work() -> None:
        try:
            found.append(search(*arguments, done))
        except BaseException as error:
            found.append(error)

    # A daemon: an interrupted program ends without waiting for it.
    thread = Thread(target=work, daemon=True)
    thread.start()
    while thread.is_alive():
        thread.join(_TOLD_EVERY_S)
        tell(_SEARCHING, int(done[0]), total)
    if isinstance(found[0], BaseException):
        raise found[0]
    return found[0]


def search_candidates(
    model: QuadraticModel, candidates: FloatArray, task: Task, starts: int, rng: np.random.Generator
) -> list[tuple[float, FloatArray]]:
    """Values and rows (n, k) of local optima over candidates (m, k), the best first: exchange from random starts.

    Fedorov's exchange, row by row (Cook & Nachtsheim 1980, Technometrics 22, 315-324).
    """
    rows = model.matrix(candidates)
    found: list[tuple[float, FloatArray]] = []
    for start in range(starts):
        tell(_SEARCHING, start, starts)
        chosen = rng.choice(candidates.shape[0], task.n, replace=candidates.shape[0] < task.n)
        points = candidates[chosen].copy()
        if smallest_eigenvalue(task.precision + rows[chosen].T @ rows[chosen]) < _DOUBTFUL:
            ridge = replace(task, precision=task.precision + _RIDGE * np.eye(model.p), weight=None)
            _candidate_exchange(points, rows[chosen], candidates, rows, ridge, _COARSE)
        found.append((_candidate_exchange(points, model.matrix(points), candidates, rows, task, _COARSE), points))
    return sorted(found, key=lambda pair: -pair[0])


def search_constrained(
    model: QuadraticModel, region: Region, task: Task, starts: int, seed: int
) -> tuple[FloatArray, int]:
    """Best rows (n, k) found in a region with constraints.

    Candidate exchange from random starts over points that cover the region and its boundary, then exact coordinate
    exchange along feasible intervals for the best few, the two in turn until neither gains: candidates jump over
    oblique edges where coordinate moves jam.
    """
    rng = np.random.default_rng([seed, 1])
    candidates = region.candidates(limit=_CANDIDATES)
    if candidates.shape[0] > _CANDIDATES:
        candidates = candidates[np.sort(rng.choice(candidates.shape[0], _CANDIDATES, replace=False))]
    rows = model.matrix(candidates)
    polished = []
    for value, points in search_candidates(model, candidates, task, starts, rng)[:_POLISHED]:
        current, left = value, _POLISH_PASSES
        while left > 0:
            after, used = _polish(model, region, task, points, min(left, _MAX_PASSES))
            left -= used
            after = max(after, _candidate_exchange(points, model.matrix(points), candidates, rows, task, _COARSE))
            if not after > current + _PASS_GAIN:
                break
            current = after
        polished.append((task.value(model.matrix(points)), points))
    best = max(value for value, _ in polished)
    winner = next(points for value, points in polished if value == best)
    hits = sum(value > best - 1e-5 for value, _ in polished) if np.isfinite(best) else 0
    return winner, hits


def _polish(model: QuadraticModel, region: Region, task: Task, points: FloatArray, passes: int) -> tuple[float, int]:
    """Coordinate exchange along feasible intervals, in place; all rows' intervals of a coordinate are found at once.

    Returns the value reached and the passes made, at most ``passes``.
    """
    from seqrsm.design import kernels

    plan = layout(model, region)
    n_base = 1 + sum(len(columns) for columns in model.columns)
    linear = task.weight is not None
    value, made = -np.inf, 0
    while made < passes:
        made += 1
        total = 0.0
        for j in range(model.k):
            spans, counts = region.line_intervals_of(points, j)
            gain, value = kernels.sweep(
                j, spans, counts, points, task.precision, task.kernel_weight, linear, plan, n_base
            )
            total += gain
        if total < _PASS_GAIN:
            break
    return value, made


def _candidate_exchange(
    points: FloatArray, Z: FloatArray, candidates: FloatArray, rows: FloatArray, task: Task, pass_gain: float
) -> float:
    """Replace each row by the best candidate until a pass gains less, in place; returns the value reached.

    Gains are those of the exchange of one row: determinant ratio (1 + d_n)(1 - d_o) + d_no^2; fall of the trace
    [(1 - d_o) e_n + 2 d_no e_no - (1 + d_n) e_o] / ratio (Fedorov 1972).
    """
    Z = Z.copy()
    value = task.value(Z)
    if not np.isfinite(value):
        return value
    for _ in range(_MAX_PASSES):
        before = value
        for i in range(points.shape[0]):
            D = np.linalg.inv(task.precision + Z.T @ Z)
            u = D @ Z[i]
            d_o, d_no = float(Z[i] @ u), rows @ u
            d_n = np.einsum("ij,ij->i", rows @ D, rows)
            ratio = (1.0 - d_o) * (1.0 + d_n) + d_no**2
            gains = ratio - 1.0
            if task.weight is not None:
                E = D @ task.weight @ D
                w = E @ Z[i]
                e_n, e_no = np.einsum("ij,ij->i", rows @ E, rows), rows @ w
                fall = (1.0 - d_o) * e_n + 2.0 * d_no * e_no - (1.0 + d_n) * float(Z[i] @ w)
                gains = np.where(ratio > 1e-9, fall / np.maximum(ratio, 1e-9), -np.inf)
            best = int(np.argmax(gains))
            if gains[best] > 1e-9 * (1.0 if task.weight is None else np.exp(-before)):
                Z[i], points[i] = rows[best], candidates[best]
        value = task.value(Z)
        if not value > before + pass_gain:
            break
    return value
