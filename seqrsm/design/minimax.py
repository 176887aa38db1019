"""Search for G-optimal designs: the smallest largest prediction variance over the region.

The largest z'Dz over the region, D = (Z'Z + R)^-1, is shared by many places at an optimum, so that moves of one
coordinate at a time jam. All continuous coordinates therefore move together, downhill on a soft maximum: the mean of
(z'Dz)^q to the power 1/q over places that cover the region, with q growing, and with the highest places of all added
once q is so large that the gaps of the cover count. Levels of discrete and categorical factors, which cannot move by
steps, are exchanged on the same soft maximum.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from seqrsm.arrays import FloatArray
from seqrsm.design import kernels_minimax as kernels
from seqrsm.design import search
from seqrsm.design.quadratic import QuadraticModel
from seqrsm.design.region import Region
from seqrsm.progress import tell

# Low powers first lead to optima of one kind, high ones at once to others: the starts take turns.
_ROUGH = ((4.0, 16.0, 64.0), (16.0, 64.0), (32.0,))
_FINE = 256.0  # tells which designs are better; these alone are finished
_LAST, _FINISHED = (512.0, 2048.0, 16384.0), 6
_QUICK, _THOROUGH = (100, 1e-5), (300, 1e-7)  # iterations and the gain that ends them
_PLACES = 2500
_HIGH, _MOST_HIGH, _SWEEPS = 0.85, 200, 30
_RADIUS = 1e-5  # places nearer to each other than this are one
_RISE = 1e-6
_DIFFERENCE, _RETURNS = 1e-6, 6
_PASSES = 3  # of exchanges of levels, and of these and the descent in turn
_FEW_TERMS = 10
_SAME = 1e-3


class MinimaxSearch:
    """Designs in a region, judged at places that cover it.

    Parameters
    ----------
    model, region : QuadraticModel, Region
    precision : ndarray (p, p)
        What the prior and fixed runs bring to M.
    largest : callable
        Largest z'Dz over a region with constraints for D (p, p), and the places (m, k) where it is high.
    """

    def __init__(
        self,
        model: QuadraticModel,
        region: Region,
        precision: FloatArray,
        largest: Callable[[FloatArray], tuple[float, FloatArray]],
    ) -> None:
        self.model, self.region, self.largest = model, region, largest
        self.precision = np.ascontiguousarray(precision)
        self.free = list(region.continuous)
        self.held = [j for j in range(region.k) if j not in self.free]
        self.columns = np.array([model.columns[j].start for j in self.free], dtype=np.int64)
        places = region.candidates(3 if region.is_box else 5, limit=_PLACES)
        # All arrays row by row: kernels are compiled anew for another layout.
        self.bases = np.ascontiguousarray(model.base(places[:: max(1, -(-len(places) // (2 * _PLACES)))]))
        self.places = self._rows(self.bases)

    def _rows(self, bases: FloatArray) -> FloatArray:
        return np.ascontiguousarray(bases[:, self.model.first] * bases[:, self.model.second])

    def _heights(self, points: FloatArray) -> tuple[FloatArray, FloatArray]:
        """(Z'Z + R)^-1 of a design and its variance at the places."""
        D = kernels.covariance(np.ascontiguousarray(self.model.matrix(points)), self.precision)
        return D, np.einsum("ij,ij->i", self.places @ D, self.places)

    def _highest(self, points: FloatArray) -> tuple[float, FloatArray]:
        """Largest variance of a design over the box, and the model rows (m, p) of its highest places."""
        D, heights = self._heights(points)
        order = np.argsort(-heights, kind="stable")[:_MOST_HIGH]
        tops = self.bases[order[heights[order] > _HIGH * heights[order[0]]]].copy()
        values = np.empty(len(tops))
        kernels.climb(tops, self.columns, self.model.first, self.model.second, D, _SWEEPS, values)
        # Told apart by one number each: rows of a table are sorted far more slowly.
        marks = np.rint(tops / _RADIUS) @ np.sqrt(np.arange(2.0, 2.0 + tops.shape[1]))
        distinct = np.unique(np.rint(marks), return_index=True)[1]
        return max(float(values.max()), float(heights[order[0]])), self._rows(tops[distinct])

    def value(self, points: FloatArray, best: float) -> float:
        """Largest variance of a design; where constraints make that dear, only as far as needed to exceed ``best``.

        What rises between the places then joins them, so that later designs are judged there, too.
        """
        if self.region.is_box:
            return self._highest(points)[0]
        D, heights = self._heights(points)
        top = float(heights.max())
        if top > best:
            return top
        value, where = self.largest(D)
        if value > top * (1.0 + _RISE):
            self.places = np.vstack([self.places, self.model.matrix(where)])
        return max(value, top)

    def _half_spaces(self, points: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Constraints about the runs (n, k), normals x <= offsets: normals (n, h, c) of length one, offsets (n, h)."""
        n, c, h = len(points), len(self.free), len(self.region.constraints)
        if self.region.is_box:
            return np.zeros((n, 0, c)), np.zeros((n, 0))
        slacks = self.region.slacks(points)
        slopes = np.empty((n, h, c))
        for column, j in enumerate(self.free):
            # Backwards in the upper half, so that a logarithm or root is not asked beyond the bound.
            step = np.where(points[:, j] > 0.0, -_DIFFERENCE, _DIFFERENCE)
            moved = points.copy()
            moved[:, j] += step
            slopes[:, :, column] = (self.region.slacks(moved) - slacks) / step[:, None]
        lengths = np.linalg.norm(slopes, axis=2)
        usable = np.isfinite(lengths) & np.isfinite(slacks) & (lengths > 1e-9)
        safe = np.where(usable, lengths, 1.0)
        normals = np.where(usable[:, :, None], -slopes / safe[:, :, None], 0.0)
        reach = np.einsum("nhc,nc->nh", normals, points[:, self.free])
        return normals, np.where(usable, reach + slacks / safe, 1e9)

    def _back(self, moved: FloatArray, start: FloatArray) -> FloatArray:
        """``moved`` (n, k) with runs that left the region brought back to its edge, near to where they are."""
        if self.region.is_box:
            return moved
        for _ in range(_RETURNS):
            out = np.flatnonzero(self.region.slack(moved) < 0.0)
            if not out.size:
                return moved
            normals, offsets = self._half_spaces(moved[out])
            beyond = np.einsum("nhc,nc->nh", normals, moved[out][:, self.free]) - offsets
            worst = np.argmax(beyond, axis=1)
            step = beyond[np.arange(out.size), worst] + 1e-9
            step = np.where(beyond.max(axis=1) > 0.0, step, 0.0)
            back = moved[out][:, self.free] - step[:, None] * normals[np.arange(out.size), worst]
            moved[out[:, None], self.free] = np.clip(back, -1.0, 1.0)
        out = np.flatnonzero(self.region.slack(moved) < 0.0)
        moved[out] = search.bisect(start[out], moved[out], self.region.slack)
        return moved

    def lower(self, points: FloatArray, power: float, effort: tuple[int, float]) -> FloatArray:
        """Continuous coordinates downhill on the soft maximum."""
        if not self.free:
            return points
        places = self.places
        if power >= _FINE and self.region.is_box:
            places = np.vstack([places, self._highest(points)[1]])
        base = np.ascontiguousarray(self.model.base(points))
        kernels.descend(
            base,
            self.columns,
            self.model.first,
            self.model.second,
            self.precision,
            places,
            *self._half_spaces(points),
            power,
            *effort,
        )
        moved = points.copy()
        moved[:, self.free] = base[:, self.columns]
        return self._back(moved, points)

    def exchange(self, points: FloatArray, power: float) -> FloatArray:
        """Exchange the levels of discrete and categorical factors, one run at a time, on the soft maximum."""
        points = points.copy()
        for _ in range(_PASSES if self.held else 0):
            before = points.copy()
            for i in range(len(points)):
                rest_of = np.ascontiguousarray(self.model.matrix(np.delete(points, i, axis=0)))
                D = kernels.covariance(rest_of, self.precision)
                P = self.places @ D
                rest = np.einsum("ij,ij->i", P, self.places)
                for j in self.held:
                    levels = self.region.axes[j]
                    assert levels is not None
                    rows = np.repeat(points[i : i + 1], len(levels), axis=0)
                    rows[:, j] = levels
                    rows = rows[self.region.feasible(rows)]
                    f = self.model.matrix(rows)
                    share = 1.0 + np.einsum("ij,jk,ik->i", f, D, f)
                    left = np.maximum(rest[:, None] - (P @ f.T) ** 2 / share, 0.0)
                    top = left.max(axis=0)
                    soft = np.log(top) + np.log(np.mean((left / top) ** power, axis=0)) / power
                    points[i] = rows[int(np.argmin(soft))]
            if np.array_equal(points, before):
                break
        return points

    def _searched(self, start: FloatArray, powers: tuple[float, ...], best: float) -> tuple[float, FloatArray]:
        points = start
        for power in (*powers, _FINE):
            for _ in range(_PASSES):
                before = points
                points = self.lower(self.exchange(points, power), power, _QUICK)
                if np.array_equal(before[:, self.held], points[:, self.held]):
                    break
        return self.value(points, best), points

    def _finished(self, points: FloatArray) -> tuple[float, FloatArray]:
        ends = []
        for power in _LAST:
            points = self.lower(points, power, _THOROUGH)
            ends.append((self.value(points, np.inf), points))
        return min(ends, key=_value)

    def search(self, starts: list[FloatArray], kicks: int, rng: np.random.Generator) -> tuple[FloatArray, int]:
        """Best design from several starts, then from ``kicks`` others in which some runs of the best lie elsewhere.

        Returns it and how many of the searches came within a thousandth of the best one's largest variance.
        """
        total = len(starts) + kicks
        turns = _ROUGH[:1] if self.held else _ROUGH[1:] if self.model.p <= _FEW_TERMS else _ROUGH
        found: list[tuple[float, FloatArray]] = []
        for i in range(total):
            tell("searching the design", i, total)
            best = min(found, key=_value, default=(np.inf, starts[0]))
            if i < len(starts):
                found.append(self._searched(starts[i], turns[i % len(turns)], best[0]))
                continue
            other = best[1].copy()
            chosen = rng.choice(len(other), min(len(other), 1 + int(rng.integers(3))), replace=False)
            other[chosen] = self.region.sample(len(chosen), rng)
            found.append(self._searched(other, turns[-1], best[0]))
        found.sort(key=_value)
        hits = sum(value < found[0][0] * (1.0 + _SAME) for value, _ in found)
        return min((self._finished(points) for _, points in found[:_FINISHED]), key=_value)[1], hits


def _value(pair: tuple[float, FloatArray]) -> float:
    return pair[0]
