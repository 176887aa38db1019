"""Test surfaces of the sequential studies, and one campaign on one of them.

The surfaces are drawn anew for every seed, so that a pair of campaigns with the same seed sees the same surface and
the same start runs. Scores are percentages in size: tens of points over the region, noise of a point or two.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from scipy.optimize import minimize

from seqrsm.arrays import FloatArray
from seqrsm.decide.allowance import Allowance, departure_allowance
from seqrsm.decide.intervals import IntervalKind, half_width
from seqrsm.decide.moving import Plan, RegionState, look, sub_region, whole_box
from seqrsm.decide.stopping import StopRule
from seqrsm.design.factors import ContinuousFactor
from seqrsm.design.optimal import start_design
from seqrsm.design.quadratic import QuadraticModel
from seqrsm.design.region import Region
from seqrsm.fit.optimum import optimum, optimum_draws
from seqrsm.propose.batch import propose_batch

Surface = Callable[[FloatArray], FloatArray]


def saturating(rng: np.random.Generator, k: int) -> Surface:
    """Gains that level off, less a cost that does not."""
    a, b, best = rng.uniform(14, 26, k), rng.uniform(2.0, 3.5, k), rng.uniform(-0.3, 0.9, k)
    c = a * b * np.exp(-b * (best + 1))
    return lambda x: 40 + np.sum(a * (1 - np.exp(-b * (x + 1))) - c * (x + 1), axis=-1)


def asymmetric(rng: np.random.Generator, k: int) -> Surface:
    """A slow slope on one side, a cliff on the other (LINEX)."""
    steep, best, size = (
        rng.uniform(2.0, 3.0, k) * rng.choice([-1, 1], k),
        rng.uniform(-0.4, 0.4, k),
        rng.uniform(1, 2, k),
    )
    return lambda x: 85 - np.sum(size * (np.exp(steep * (x - best)) - steep * (x - best) - 1), axis=-1)


def two_humped(rng: np.random.Generator, k: int) -> Surface:
    """Two hills of different height on opposite sides of the centre."""
    side = rng.normal(size=k)
    side *= 0.55 / np.linalg.norm(side)

    def value(x: FloatArray) -> FloatArray:
        high, low = np.sum((x - side) ** 2, axis=-1), np.sum((x + side) ** 2, axis=-1)
        return 45 + 35 * np.exp(-high / 0.32) + 27 * np.exp(-low / 0.32)

    return value


def plateau(rng: np.random.Generator, k: int) -> Surface:
    """A tilted table with steep sides."""
    centre, tilt, size = rng.uniform(-0.25, 0.25, k), rng.normal(size=k), rng.uniform(0.8, 1.1, k)
    tilt /= np.linalg.norm(tilt)

    def value(x: FloatArray) -> FloatArray:
        far = np.sum(((x - centre) / size) ** 2, axis=-1)
        return 50 + 35 / (1 + np.exp(8 * (far - 0.8))) + 5 * (x - centre) @ tilt

    return value


def quadratic(rng: np.random.Generator, k: int, reach: float = 0.6) -> Surface:
    """A rotated quadratic, its top within ``reach`` of the centre in every coordinate."""
    turn, _ = np.linalg.qr(rng.normal(size=(k, k)))
    B = turn @ np.diag(rng.uniform(4, 14, k)) @ turn.T
    best = rng.uniform(-reach, reach, k)
    return lambda x: 90 - np.einsum("...i,ij,...j->...", x - best, B, x - best)


def border(rng: np.random.Generator, k: int) -> Surface:
    """A quadratic whose top lies beyond one face."""
    turn, _ = np.linalg.qr(rng.normal(size=(k, k)))
    B = turn @ np.diag(rng.uniform(4, 14, k)) @ turn.T
    best = rng.uniform(-0.5, 0.5, k)
    best[0] = 1.3
    return lambda x: 90 - np.einsum("...i,ij,...j->...", x - best, B, x - best)


@lru_cache(maxsize=16)
def stage(k: int) -> tuple[QuadraticModel, Region, FloatArray]:
    """Model, region and start design of k factors."""
    factors = tuple(ContinuousFactor(f"x{i}", -1.0, 1.0) for i in range(k))
    model, region = QuadraticModel(factors), Region(factors)
    return model, region, start_design(model, region, model.p + 6, 3, 0)


def true_optimum(surface: Surface, k: int) -> float:
    """Largest value on [-1, 1]^k, by climbs from the best of many points."""
    points = np.random.default_rng(0).uniform(-1, 1, (20_000, k))
    values = surface(points)
    starts = points[np.argsort(-values)[:6]]
    climbs = [minimize(lambda x: -float(surface(x)), s, bounds=[(-1, 1)] * k, method="L-BFGS-B") for s in starts]
    return max(float(values.max()), *(-climb.fun for climb in climbs))


@dataclass(frozen=True, slots=True)
class Fitted:
    """What one look knows."""

    point: FloatArray  # recommended, coded in the whole region
    local: FloatArray
    mean: float
    s: float
    df: int
    h: float
    beta: FloatArray
    C: FloatArray
    n: int
    distinct: int
    allowance: Allowance


def fit_box(state: RegionState, model: QuadraticModel, region: Region, X: FloatArray, y: FloatArray) -> Fitted:
    """Least squares in the box of ``state``."""
    inside = state.box.contains(X)
    local, scores = state.box.local(X[inside]), y[inside]
    Z = model.matrix(local)
    C = np.linalg.inv(Z.T @ Z)
    beta = np.linalg.lstsq(Z, scores, rcond=None)[0]
    rest = scores - Z @ beta
    df = len(scores) - model.p
    best = optimum(model, region, beta).point
    z = model.matrix(best[None, :])[0]
    count = np.unique(np.round(local, 9), axis=0)
    allowance = departure_allowance(model, region, local, Z, scores, best, z)
    point = state.box.outwards(best)
    s = float(np.sqrt(rest @ rest / df))
    return Fitted(point, best, float(z @ beta), s, df, float(z @ C @ z), beta, C, len(scores), len(count), allowance)


def next_points(
    state: RegionState, found: Fitted, k: int, X: FloatArray, n: int, rng: np.random.Generator, seed: int
) -> FloatArray:
    """Next runs, as ``seqrsm run`` chooses them."""
    model, region, _ = stage(k)
    box = state.box if state.target is None else state.target
    done = box.local(X[box.contains(X)])
    if state.target is None:
        root = np.linalg.cholesky(found.C + 1e-12 * np.eye(model.p))
        sigma = found.s * np.sqrt(found.df / rng.chisquare(found.df, size=(64, 1)))
        draws = found.beta + sigma * (rng.standard_normal((64, model.p)) @ root.T)
        options = {
            "x_hat": found.local,
            "target_points": optimum_draws(model, region, draws)[0],
            "df_pure_error": found.n - found.distinct,
        }
    else:
        options = {
            "x_hat": np.zeros(k),
            "target_points": np.zeros((1, k)),
            "df_pure_error": 99,
            "criterion": "D",
            "prior_precision": 0.05 * np.eye(model.p),
        }
    batch = propose_batch(
        model, region, Z_done=model.matrix(done), points_done=done, n=n, seed=seed, n_candidates=700, **options
    )
    return np.array([box.outwards(proposal.point) for proposal in batch])


def widths(found: Fitted, level: float = 0.95) -> tuple[float, float]:
    """Half-widths of the confidence and the prediction interval at the recommended settings, by the quadratic alone."""
    return (
        float(half_width("confidence", found.s, found.df, found.h, level)),
        float(half_width("prediction", found.s, found.df, found.h, level)),
    )


def allowed(found: Fitted, kind: IntervalKind, level: float = 0.95, replicates: int = 5) -> tuple[float, float]:
    """Ends of the interval with a departure from the quadratic allowed for."""
    half = float(half_width(kind, found.s, found.df, found.h, level, replicates))
    return found.allowance.ends(found.mean, half, found.df, level)


def widening(found: Fitted, rule: StopRule) -> float:
    """Factor by which the allowance widens the interval that the stop rule watches."""
    low, high = allowed(found, rule.interval, rule.level, rule.replicates)
    return (high - low) / (
        2.0 * float(half_width(rule.interval, found.s, found.df, found.h, rule.level, rule.replicates))
    )


def begin(k: int, max_runs: int, moving: bool) -> tuple[Plan, RegionState]:
    """Plan and first state; ``moving`` False keeps the whole region for ever."""
    _, region, _ = stage(k)
    return Plan(region, max_runs=max_runs if moving else 0), RegionState(whole_box(k))


def step(plan: Plan, state: RegionState, X: FloatArray, y: FloatArray, batch: int) -> RegionState:
    """One look."""
    return look(plan, state, X, y, batch) if plan.max_runs else state


__all__ = [
    "Fitted",
    "Surface",
    "allowed",
    "begin",
    "fit_box",
    "next_points",
    "stage",
    "step",
    "sub_region",
    "true_optimum",
    "widening",
    "widths",
]
