"""Search for G-optimal designs: the smallest largest prediction variance over the region.

The largest z'Dz over the region, D = (Z'Z + R)^-1, is shared by many places at an optimum, so that exchanges of one
coordinate jam on it. All continuous coordinates therefore move together, downhill on a soft maximum: the mean of
(z'Dz)^q to the power 1/q over places that cover the region, with q growing. Levels of discrete and categorical factors
are exchanged on the same soft maximum.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from seqrsm.arrays import FloatArray
from seqrsm.design.evaluate import largest_variance
from seqrsm.design.exchange import covariance, in_coordinates, lower
from seqrsm.design.quadratic import QuadraticModel
from seqrsm.design.region import Region
from seqrsm.progress import tell

# Powers q, the fine ones for the best few designs. Low powers first lead to optima of one kind, high ones at once to
# others: the starts take turns.
_ROUGH, _FINE = (8.0, 32.0, 128.0), (256.0, 1024.0, 4096.0)
_FINISHED = 5
_PASSES = 3  # of exchanges of levels
_PLACES = 2500
_FEW_FACTORS = 3
_ASCENTS, _SWEEPS = 40, 8  # towards the largest variance of a design on the way
_SAME = 1e-3


def search_minimax(
    model: QuadraticModel, region: Region, precision: FloatArray, starts: list[FloatArray]
) -> tuple[FloatArray, int]:
    """Best design (n, k) reached from the starts, and how many came within a thousandth of its largest variance.

    Parameters
    ----------
    model, region : QuadraticModel, Region
    precision : ndarray (p, p)
        What fixed runs bring to M.
    starts : list of ndarray (n, k)
    """
    rough, fine = (
        SoftMaximum(model, region, precision, model.matrix(region.candidates(levels, limit=_PLACES)))
        for levels in ((5, 9) if region.k <= _FEW_FACTORS else (3, 5))
    )
    found = []
    for number, start in enumerate(starts):
        tell("searching the design", number, len(starts))
        points = start
        for power in _ROUGH[number % len(_ROUGH) :]:
            points = rough.lower(rough.exchange(points, power), power)
        found.append((float(np.max(fine.heights(points))), points))
    found.sort(key=lambda pair: pair[0])
    ends = []
    for _, points in found[:_FINISHED]:
        for power in _FINE:
            points = fine.lower(fine.exchange(points, power), power)
            ends.append((largest_variance(model, region, fine.covariance(points), _ASCENTS, _SWEEPS)[0], points))
    hits = sum(value < found[0][0] * (1.0 + _SAME) for value, _ in found)
    return min(ends, key=lambda pair: pair[0])[1], hits


@dataclass(frozen=True, slots=True)
class SoftMaximum:
    """Mean of (z'Dz)^q over places, to the power 1/q, to be lowered.

    Parameters
    ----------
    model, region : QuadraticModel, Region
    precision : ndarray (p, p)
        What fixed runs bring to M.
    places : ndarray (m, p)
        Rows z.
    """

    model: QuadraticModel
    region: Region
    precision: FloatArray
    places: FloatArray

    def covariance(self, points: FloatArray) -> FloatArray:
        """D (p, p) of a design (n, k)."""
        Z = self.model.matrix(points)
        return covariance(self.precision + Z.T @ Z)

    def heights(self, points: FloatArray) -> FloatArray:
        """Variances z'Dz at the places (m,)."""
        return np.asarray(np.einsum("ij,ij->i", self.places @ self.covariance(points), self.places))

    def value(self, points: FloatArray, power: float) -> tuple[float, FloatArray]:
        """Its logarithm, and the slope (n, c) of that in the continuous coordinates."""
        first, second = self.model.first, self.model.second
        base = self.model.base(points)
        F = base[:, first] * base[:, second]
        P = self.places @ self.covariance(points)
        v = np.einsum("ij,ij->i", P, self.places)
        top = float(v.max())
        share = (v / top) ** power
        P *= np.sqrt(share / v)[:, None]
        pulled = (F @ P.T) @ P * (-2.0 / float(share.sum()))
        slope = in_coordinates(self.model, self.region, base, pulled)
        return float(np.log(top) + np.log(np.mean(share)) / power), slope

    def lower(self, start: FloatArray, power: float) -> FloatArray:
        """The design (n, k) with its continuous coordinates moved downhill within the region."""
        return lower(self.region, start, lambda points: self.value(points, power))

    def exchange(self, start: FloatArray, power: float) -> FloatArray:
        """The design (n, k) with the levels of discrete and categorical factors exchanged, one run at a time."""
        held = [j for j in range(self.region.k) if j not in self.region.continuous]
        points = start.copy()
        for _ in range(_PASSES if held else 0):
            before = points.copy()
            for i in range(len(points)):
                D = self.covariance(np.delete(points, i, axis=0))
                P = self.places @ D
                rest = np.einsum("ij,ij->i", P, self.places)
                for j in held:
                    levels = self.region.axes[j]
                    assert levels is not None
                    rows = np.repeat(points[i : i + 1], len(levels), axis=0)
                    rows[:, j] = levels
                    rows = rows[self.region.feasible(rows)]
                    f = self.model.matrix(rows)
                    left = rest[:, None] - (P @ f.T) ** 2 / (1.0 + np.einsum("ij,jk,ik->i", f, D, f))
                    top = left.max(axis=0)
                    soft = np.log(top) + np.log(np.mean((left / top) ** power, axis=0)) / power
                    points[i] = rows[int(np.argmin(soft))]
            if np.array_equal(points, before):
                break
        return points
