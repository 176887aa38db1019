"""Search for G-optimal designs: the smallest largest prediction variance over the region.

The largest z'Dz over the region, D = (Z'Z + R)^-1, is shared by many places at an optimum, so that moves of one
coordinate at a time jam. All coordinates therefore move together: first downhill on a soft maximum, the mean of
(z'Dz)^q to the power 1/q with q growing, then by a sequence of linear programmes that lower all of the highest places
at once (Madsen 1975, J. Inst. Maths Applics 16, 321-328). Levels of discrete and categorical factors, which cannot move
by steps, are exchanged.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from scipy.optimize import linprog, minimize

from seqrsm.arrays import FloatArray
from seqrsm.design import search
from seqrsm.design.exchange import smallest_eigenvalue
from seqrsm.design.quadratic import QuadraticModel
from seqrsm.design.region import Region

_POWERS = (4.0, 16.0, 64.0)
_PLACES = 1200
_STEP = 0.25  # the model is a quadratic: central differences of any step are exact
_ITERATIONS = 60
_PROGRAMMES = 30
_HIGH = 0.9
_MOST_PLACES = 160
_TRUST, _LEAST_TRUST = 0.2, 1e-4
_PASSES = 3
_GAIN = 1e-6


class MinimaxSearch:
    """Designs in a region, judged at places that cover it.

    Parameters
    ----------
    model, region : QuadraticModel, Region
    precision : ndarray (p, p)
        What the prior and fixed runs bring to M.
    largest : callable
        Exact largest z'Dz over the region for D (p, p), and the places (m, k) where it is high.
    """

    def __init__(
        self,
        model: QuadraticModel,
        region: Region,
        precision: FloatArray,
        largest: Callable[[FloatArray], tuple[float, FloatArray]],
    ) -> None:
        self.model, self.region, self.precision, self.largest = model, region, precision, largest
        places = region.candidates(limit=_PLACES)
        self.places = model.matrix(places[:: max(1, -(-len(places) // _PLACES))])
        self.free = list(region.continuous)

    def covariance(self, points: FloatArray) -> FloatArray | None:
        """(Z'Z + R)^-1, or None where it is singular."""
        Z = self.model.matrix(points)
        M = self.precision + Z.T @ Z
        if smallest_eigenvalue(M) < 1e-9:
            return None
        scale = 1.0 / np.sqrt(np.diag(M))
        return np.asarray(np.linalg.inv(M * np.outer(scale, scale)) * np.outer(scale, scale))

    def _slopes(self, points: FloatArray) -> FloatArray:
        """Derivatives (n, c, p) of the model rows in the continuous coordinates."""
        found = np.empty((len(points), len(self.free), self.model.p))
        for c, j in enumerate(self.free):
            ahead, behind = points.copy(), points.copy()
            ahead[:, j] += _STEP
            behind[:, j] -= _STEP
            found[:, c] = (self.model.matrix(ahead) - self.model.matrix(behind)) / (2.0 * _STEP)
        return found

    def _soft(self, flat: FloatArray, points: FloatArray, power: float) -> tuple[float, FloatArray]:
        """Logarithm of the soft maximum and its gradient."""
        moved = points.copy()
        moved[:, self.free] = flat.reshape(len(points), -1)
        D = self.covariance(moved)
        if D is None:
            return 1e3, np.zeros_like(flat)
        P = self.places @ D
        variance = np.einsum("ij,ij->i", P, self.places)
        top = float(variance.max())
        share = (variance / top) ** power
        value = np.log(top) + np.log(share.mean()) / power
        weight = share / variance / share.sum()
        lowered = (P * weight[:, None]).T @ P  # D W D
        rows = self.model.matrix(moved) @ lowered
        gradient = -2.0 * np.einsum("ip,icp->ic", rows, self._slopes(moved))
        return value, gradient.ravel()

    def _back(self, moved: FloatArray, start: FloatArray) -> FloatArray:
        """``moved`` (n, k) with runs that left the region brought back to its edge."""
        if self.region.is_box:
            return moved
        out = ~self.region.feasible(moved, tol=0.0)
        if out.any():
            moved[out] = search.bisect(start[out], moved[out], self.region.slack)
        return moved

    def smooth(self, points: FloatArray, powers: tuple[float, ...] = _POWERS) -> FloatArray:
        """Downhill on soft maxima of growing power."""
        for power in powers:
            found = minimize(
                self._soft,
                points[:, self.free].ravel(),
                args=(points, power),
                jac=True,
                method="L-BFGS-B",
                bounds=[(-1.0, 1.0)] * (len(points) * len(self.free)),
                options={"maxiter": _ITERATIONS},
            )
            moved = points.copy()
            moved[:, self.free] = np.clip(found.x.reshape(len(points), -1), -1.0, 1.0)
            points = self._back(moved, points)
        return points

    def value(self, points: FloatArray) -> tuple[float, FloatArray]:
        """Largest variance over the region, exact, and places where it is high; inf where the design is singular."""
        D = self.covariance(points)
        return (np.inf, np.empty((0, self.region.k))) if D is None else self.largest(D)

    def sharpen(self, points: FloatArray) -> tuple[FloatArray, float]:
        """Sequential linear programmes on the highest places; the design and its largest variance."""
        value, where = self.value(points)
        if not np.isfinite(value) or not self.free:
            return points, value
        trust, n, c = _TRUST, len(points), len(self.free)
        for _ in range(_PROGRAMMES):
            D = self.covariance(points)
            if D is None:
                break
            rows = np.vstack([self.model.matrix(where), self.places])
            P = rows @ D
            variance = np.einsum("ij,ij->i", P, rows)
            high = np.argsort(-variance, kind="stable")[:_MOST_PLACES]
            high = high[variance[high] > _HIGH * value]
            pull = P[high] @ self.model.matrix(points).T
            change = np.einsum("mp,icp->mic", P[high], self._slopes(points))
            slope = (-2.0 * pull[:, :, None] * change).reshape(len(high), n * c)
            at = points[:, self.free].ravel()
            bounds = [(max(-trust, -1.0 - x), min(trust, 1.0 - x)) for x in at]
            step = linprog(
                np.append(np.zeros(n * c), 1.0),
                A_ub=np.column_stack([slope / value, -np.ones(len(high))]),
                b_ub=-variance[high] / value,
                bounds=[*bounds, (0.0, None)],
                method="highs",
            )
            if step.x is None:
                break
            moved = points.copy()
            moved[:, self.free] = np.clip(at + step.x[:-1], -1.0, 1.0).reshape(n, c)
            moved = self._back(moved, points)
            reached, there = self.value(moved)
            if reached < value:
                gained = 1.0 - reached / value
                points, value, where = moved, reached, there
                trust = min(1.5 * trust, 0.5)
                if gained < _GAIN and trust < 10.0 * _LEAST_TRUST:
                    break
            else:
                trust *= 0.3
                if trust < _LEAST_TRUST:
                    break
        return points, value

    def exchange(self, points: FloatArray) -> FloatArray:
        """Exchange the levels of discrete and categorical factors, one run at a time, on the largest variance."""
        points = points.copy()
        held = [j for j in range(self.region.k) if j not in self.free]
        for _ in range(_PASSES if held else 0):
            before = points.copy()
            for i in range(len(points)):
                Z = self.model.matrix(np.delete(points, i, axis=0))
                M = self.precision + Z.T @ Z
                D = np.linalg.inv(M + 1e-9 * float(np.trace(M)) / len(M) * np.eye(len(M)))
                P = self.places @ D
                rest = np.einsum("ij,ij->i", P, self.places)
                for j in held:
                    levels = self.region.axes[j]
                    assert levels is not None
                    rows = np.repeat(points[i : i + 1], len(levels), axis=0)
                    rows[:, j] = levels
                    rows = rows[self.region.feasible(rows)]
                    f = self.model.matrix(rows)
                    share = 1.0 + np.einsum("ij,jk,ik->i", f, D, f)
                    worst = np.max(rest[:, None] - (P @ f.T) ** 2 / share, axis=0)
                    points[i] = rows[int(np.argmin(worst))]
            if np.array_equal(points, before):
                break
        return points

    def search(self, starts: list[FloatArray], rounds: int, rng: np.random.Generator) -> tuple[FloatArray, float]:
        """Best design from several, then from ``rounds`` others in which some runs of the best lie elsewhere.

        Only the more promising third of the starts is sharpened.
        """
        soft = sorted((self._smoothed(start, i % 2 == 1) for i, start in enumerate(starts)), key=lambda pair: pair[0])
        sharp = [self.sharpen(points) for _, points in soft[: max(1, (len(soft) + 2) // 3)]]
        points, value = min(sharp, key=lambda pair: pair[1])
        for _ in range(rounds):
            other = points.copy()
            chosen = rng.choice(len(points), min(len(points), 1 + int(rng.integers(3))), replace=False)
            other[chosen] = self.region.sample(len(chosen), rng)
            found, reached = self.sharpen(self._smoothed(other, True)[1])
            if reached < value:
                points, value = found, reached
        return points, value

    def _smoothed(self, start: FloatArray, steep: bool) -> tuple[float, FloatArray]:
        """From low powers optima of one kind are found; from high ones others, too."""
        points = self.exchange(start)
        points = self.smooth(points, _POWERS[1:] if steep else _POWERS) if self.free else points
        return self.value(points)[0], points
