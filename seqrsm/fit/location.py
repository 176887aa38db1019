"""Where the optimum may lie: confidence regions of its location, by four constructions.

* Box and Hunter (1954): the stationary point of the quadratic, wherever it is. The gradient there is zero, so
  ``{x : g(x)' [D(x) C D(x)']^-1 g(x) / (q s^2) <= F(q, df)}`` with ``g(x) = D(x) beta`` has exact coverage. It says
  nothing of an optimum at the region's bound.
* ``scheffe``: the best point of the *bounded* region, in the manner of Peterson, Cahya and del Castillo (2002): x0 is
  kept when no setting x of the region is better beyond what Scheffe's simultaneous bound allows,
  ``(z(x) - z(x0))' b <= sqrt((p - 1) F) s |d(x)|`` with ``|d|^2 = d' C d`` and ``d = z(x) - z(x0)``. Conservative.
* ``simulated``: the same with the smaller constant of x0 itself, the quantile of the largest studentised difference
  over the settings compared with, found by simulation. Still at least nominal.
* the simulation set: the maximisers of the posterior draws inside the ellipsoid that holds ``level`` of them.

References
----------
Box, Hunter (1954), A confidence region for the solution of a set of simultaneous equations with an application to
experimental design, Biometrika 41, 190-199.
Peterson, Cahya, del Castillo (2002), A general approach to confidence regions for optimal factor levels of response
surfaces, Biometrics 58, 422-431.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Literal

import numpy as np
from scipy.special import fdtri

from seqrsm.arrays import BoolArray, FloatArray
from seqrsm.design.factors import CategoricalFactor
from seqrsm.design.quadratic import QuadraticModel
from seqrsm.design.region import Region
from seqrsm.errors import FitError, Problem
from seqrsm.fit.least_squares import LeastSquaresFit
from seqrsm.fit.optimum import Goal, optimum, optimum_draws, sign_of

Method = Literal["scheffe", "simulated"]

_CHUNK = 512
_SEED = 20_051
_NEAR = 0.1
_NEIGHBOURS = 64
_DUST = 1e-7  # of the largest distance: differences of the surface smaller than this are rounding


@dataclass(frozen=True, slots=True)
class FactorRange:
    """Extent of a location region along one factor.

    Attributes
    ----------
    factor : str
    low, high : float
        Coded ends; nan for a categorical factor.
    low_natural, high_natural : float
        The same in natural units.
    levels : tuple of str
        Levels of a categorical factor that occur in the region; empty otherwise.
    """

    factor: str
    low: float
    high: float
    low_natural: float
    high_natural: float
    levels: tuple[str, ...]


@dataclass(frozen=True, slots=True)
class LocationRegion:
    """Settings that may be the best, as points of the region: plotted in pairs they show its shape.

    Attributes
    ----------
    method : str
        "box_hunter", "scheffe", "simulated" or "simulation set".
    level : float
    points : ndarray (m, k)
        Coded settings that belong to it.
    share : float
        Of the whole region's volume (uniform in coded factors and over levels); nan for the simulation set.
    ranges : tuple of FactorRange
        Along every factor, in the factors' order.
    """

    method: str
    level: float
    points: FloatArray
    share: float
    ranges: tuple[FactorRange, ...]


def gradient_rows(model: QuadraticModel, points: FloatArray) -> FloatArray:
    """D(x) of ``g(x) = D(x) beta``: derivatives of the model row by the q numeric factors, (m, q, p)."""
    base = model.base(points)
    rows = np.zeros((base.shape[0], len(model.numeric), model.p))
    for j in range(len(model.numeric)):
        first, second = model.first == j + 1, model.second == j + 1
        rows[:, j] = first * base[:, model.second] + second * base[:, model.first]
    return rows


def box_hunter_statistic(model: QuadraticModel, fit: LeastSquaresFit, points: FloatArray) -> FloatArray:
    """Statistic (m,) of Box and Hunter at points (m, k); F with (q, df) degrees of freedom at the stationary point.

    nan where the gradient's covariance is singular, as at every point for a first-order model with more runs alike.
    """
    points = np.atleast_2d(np.asarray(points, dtype=np.float64))
    q = len(model.numeric)
    _error_known(fit)
    D = gradient_rows(model, points)
    g = D @ fit.estimate[: model.p]
    root = D @ fit.factor[: model.p]  # (m, q, r)
    U, values, _ = np.linalg.svd(root, full_matrices=False)
    bad = values[:, -1] <= 1e-12 * values[:, 0]
    scaled = np.einsum("mij,mi->mj", U, g) / np.where(values > 0.0, values, 1.0)
    return np.where(bad, np.nan, np.sum(np.square(scaled), axis=1) / (q * fit.s**2))


def box_hunter_contains(
    model: QuadraticModel, fit: LeastSquaresFit, points: FloatArray, level: float = 0.95
) -> BoolArray:
    """Whether points (m, k) belong to the Box-Hunter region of the stationary point at their categorical levels."""
    limit = fdtri(len(model.numeric), fit.df_residual, level)
    return np.asarray(box_hunter_statistic(model, fit, points) <= limit)


@dataclass(frozen=True, slots=True)
class BestSettings:
    """Test of settings for being the best of a bounded region; see :func:`best_settings`.

    Attributes
    ----------
    model, region, fit, goal
        As given.
    against : ndarray (c, k)
        Settings that every candidate is compared with. Coverage holds whatever they are; more make a smaller region.
    nearby : ndarray (u, k)
        Settings whose continuous factors, drawn up to a tenth of the way from the candidate, give it neighbours: where
        the surface is steep one of them is better.
    scheffe : float
        The constant sqrt((p - 1) F(level; p - 1, df)).
    level : float
    draws : int
        Simulated errors behind the constants of :meth:`critical_value`.
    """

    model: QuadraticModel
    region: Region
    fit: LeastSquaresFit
    goal: Goal
    against: FloatArray
    nearby: FloatArray
    scheffe: float
    level: float
    draws: int

    def statistic(self, points: FloatArray) -> FloatArray:
        """Largest studentised advantage (m,) that another setting has over each point (m, k); <= 0 at the optimum."""
        found = [np.max(gain / distance, axis=1) for gain, distance in self._compare(points)]
        return np.asarray(np.concatenate(found) / self.fit.s)

    def critical_value(self, point: FloatArray) -> float:
        """Quantile of the largest studentised difference from ``point`` (k,) over ``against``, by simulation."""
        point = np.asarray(point, dtype=np.float64)
        others, ok = self._neighbours(point[None, :])
        rows, _ = self._whitened(np.vstack([point, self.against, others[0][ok[0]]]))
        d = rows[1:] - rows[0]
        length = np.linalg.norm(d, axis=1)
        d = d[length > _DUST * np.max(length, initial=0.0)]
        rng = np.random.default_rng(_SEED)
        error = rng.standard_normal((self.draws, d.shape[1]))
        scale = np.sqrt(rng.chisquare(self.fit.df_residual, self.draws) / self.fit.df_residual)
        unit = d / np.linalg.norm(d, axis=1, keepdims=True)
        return float(np.quantile(np.max(error @ unit.T, axis=1) / scale, self.level))

    def contains(self, points: FloatArray, method: Method = "scheffe") -> BoolArray:
        """Which points (m, k) may be the best; they need not lie in the region's cover."""
        points = np.atleast_2d(np.asarray(points, dtype=np.float64))
        statistic = self.statistic(points)
        inside: BoolArray = statistic <= self.scheffe
        if method == "simulated":
            # The constant of a point lies below Scheffe's and is positive: only what is between needs it.
            for i in np.flatnonzero(inside & (statistic > 0.0)):
                inside[i] = statistic[i] <= self.critical_value(points[i])
        return inside

    def _whitened(self, points: FloatArray) -> tuple[FloatArray, FloatArray]:
        Z = self.model.matrix(points)
        sign = sign_of(self.goal)
        rows: FloatArray = Z @ self.fit.factor[: self.model.p]
        return rows, sign * (Z @ self.fit.estimate[: self.model.p])

    def _neighbours(self, points: FloatArray) -> tuple[FloatArray, BoolArray]:
        """Neighbours (m, u, k) of each point at its own levels, and which of them are feasible."""
        free = list(self.region.continuous)
        found = np.repeat(points[:, None, :], len(self.nearby), axis=1)
        found[:, :, free] += _NEAR * (self.nearby[:, free] - found[:, :, free])
        if self.region.is_box:
            return found, np.ones(found.shape[:2], dtype=np.bool_)
        ok = self.region.feasible(found.reshape(-1, self.region.k)).reshape(found.shape[:2])
        return found, ok

    def _compare(self, points: FloatArray) -> Iterator[tuple[FloatArray, FloatArray]]:
        """Advantage of every other setting over each point, and |d|, both (chunk, c + u); 0 and 1 for itself."""
        points = np.atleast_2d(np.asarray(points, dtype=np.float64))
        other, other_value = self._whitened(self.against)
        for start in range(0, len(points), _CHUNK):
            part = points[start : start + _CHUNK]
            rows, value = self._whitened(part)
            square = np.sum(np.square(rows), axis=1)[:, None] + np.sum(np.square(other), axis=1)
            distance = np.sqrt(np.maximum(square - 2.0 * rows @ other.T, 0.0))
            gain = other_value - value[:, None]
            dust = distance <= _DUST * np.sqrt(np.max(square))
            near, ok = self._neighbours(part)
            near_rows, near_value = self._whitened(near.reshape(-1, self.region.k))
            near_distance = np.linalg.norm(near_rows.reshape(*ok.shape, rows.shape[1]) - rows[:, None, :], axis=2)
            distance = np.hstack([distance, near_distance])
            gain = np.hstack([gain, near_value.reshape(ok.shape) - value[:, None]])
            itself = np.hstack([dust, ~ok | (near_distance <= _DUST * np.sqrt(np.max(square)))])
            gain[itself], distance[itself] = 0.0, 1.0
            yield gain, distance


def best_settings(
    model: QuadraticModel,
    region: Region,
    fit: LeastSquaresFit,
    goal: Goal = "maximize",
    *,
    level: float = 0.95,
    n_against: int = 1000,
    draws: int = 2000,
) -> BestSettings:
    """Set up the test of settings for being the best of the region.

    Parameters
    ----------
    model, region : QuadraticModel, Region
    fit : LeastSquaresFit
        Its first columns are the model's terms; blocks may follow.
    goal : "maximize" or "minimize"
    level : float
        Coverage, in (0, 1).
    n_against : int
        Settings that candidates are compared with, beside the corners and centres of the region.
    draws : int
        For the constants of the method "simulated".

    Raises
    ------
    FitError
        No estimate of error, or terms that the runs cannot tell apart.
    """
    _error_known(fit)
    if not 0.0 < level < 1.0:
        raise ValueError(f"level must lie between 0 and 1, got {level}")
    df = model.p - 1
    scheffe = float(np.sqrt(df * fdtri(df, fit.df_residual, level)))
    rng = np.random.default_rng(_SEED)
    against = np.vstack([region.candidates(3, limit=n_against), region.sample(n_against, rng)])
    nearby = region.sample(_NEIGHBOURS, rng) if region.continuous else against[:0]
    return BestSettings(model, region, fit, goal, against, nearby, scheffe, level, draws)


def location_region(test: BestSettings, method: Method = "scheffe", *, n_points: int = 2000) -> LocationRegion:
    """Confidence region of the best settings of the bounded region.

    Parameters
    ----------
    test : BestSettings
    method : "scheffe" or "simulated"
        The second is smaller and takes some seconds.
    n_points : int
        Settings of the region that are tried; the ends of the ranges are then pushed outwards from the best of them.
    """
    region, fit, model = test.region, test.fit, test.model
    rng = np.random.default_rng(_SEED + 1)
    uniform = region.sample(n_points, rng)
    inside = test.contains(uniform, method)
    best = optimum(model, region, fit.estimate[: model.p], test.goal).point
    corners = region.candidates(3, limit=n_points)
    kept = np.vstack([best, uniform[inside], corners[test.contains(corners, method)]])
    kept = _stretched(test, kept, rng) if method == "scheffe" else kept
    return LocationRegion(method, test.level, kept, float(np.mean(inside)), _ranges(region, kept))


def box_hunter_region(
    model: QuadraticModel,
    region: Region,
    fit: LeastSquaresFit,
    levels: tuple[int, ...] = (),
    *,
    level: float = 0.95,
    n_points: int = 4000,
) -> LocationRegion:
    """Part of the Box-Hunter region of the stationary point that lies in the region, at given categorical levels.

    An empty set of points says that the stationary point lies outside.
    """
    rng = np.random.default_rng(_SEED + 2)
    points = np.vstack([region.sample(n_points, rng), region.candidates(5, limit=n_points)])
    points[:, list(region.categorical)] = levels
    points = points[region.feasible(points)]
    inside = box_hunter_contains(model, fit, points, level)
    share = float(np.mean(inside[:n_points])) if inside.size else 0.0
    return LocationRegion("box_hunter", level, points[inside], share, _ranges(region, points[inside]))


def simulation_set(
    model: QuadraticModel,
    region: Region,
    betas: FloatArray,
    goal: Goal = "maximize",
    *,
    level: float = 0.95,
) -> LocationRegion:
    """Maximisers of the ``level`` share of posterior draws that lie deepest (smallest Mahalanobis distance).

    Parameters
    ----------
    betas : ndarray (m, p)
        Posterior draws of the model's coefficients, m well above p.
    """
    betas = np.asarray(betas, dtype=np.float64)
    deviation = betas - np.mean(betas, axis=0)
    # The distance is unchanged by any invertible map, and the left singular vectors are such a map of the draws.
    U, values, _ = np.linalg.svd(deviation, full_matrices=False)
    depth = np.sum(np.square(U[:, values > 1e-12 * values[0]]), axis=1)
    kept = betas[depth <= np.quantile(depth, level)]
    points, _ = optimum_draws(model, region, kept, goal)
    return LocationRegion("simulation set", level, points, float("nan"), _ranges(region, points))


def _stretched(test: BestSettings, points: FloatArray, rng: np.random.Generator) -> FloatArray:
    """Points of the region's boundary beyond those found, by random search outwards along each numeric factor."""
    region = test.region
    free = list(region.continuous)
    found = [points]
    for j in free:
        for sign in (-1.0, 1.0):
            far = points[np.argmax(sign * points[:, j])]
            for step in np.geomspace(0.5, 1e-3, 12):
                trial = np.repeat(far[None, :], 128, axis=0)
                trial[:, free] = np.clip(trial[:, free] + step * rng.standard_normal((128, len(free))), -1.0, 1.0)
                trial = trial[(sign * trial[:, j] > sign * far[j]) & region.feasible(trial)]
                trial = trial[test.contains(trial)] if len(trial) else trial
                if len(trial):
                    far = trial[np.argmax(sign * trial[:, j])]
            found.append(far[None, :])
    return np.vstack(found)


def _ranges(region: Region, points: FloatArray) -> tuple[FactorRange, ...]:
    nan = float("nan")
    ranges = []
    for j, factor in enumerate(region.factors):
        column = points[:, j]
        if isinstance(factor, CategoricalFactor):
            levels = tuple(factor.levels[int(i)] for i in np.unique(column))
            ranges.append(FactorRange(factor.name, nan, nan, nan, nan, levels))
        elif not column.size:
            ranges.append(FactorRange(factor.name, nan, nan, nan, nan, ()))
        else:
            ends = np.array([np.min(column), np.max(column)])
            low, high = (float(v) for v in factor.decode(ends))
            ranges.append(FactorRange(factor.name, float(ends[0]), float(ends[1]), low, high, ()))
    return tuple(ranges)


def _error_known(fit: LeastSquaresFit) -> None:
    if fit.aliased or not fit.s > 0.0:
        raise FitError(Problem(f"the location of the optimum has no confidence region: {fit.reason}", "Add runs."))
