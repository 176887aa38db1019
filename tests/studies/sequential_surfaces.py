"""Test surfaces of the sequential studies, and one campaign on one of them.

The surfaces are drawn anew for every seed, so that a pair of campaigns with the same seed sees the same surface and
the same start runs. Scores are percentages in size: tens of points over the region, noise of a point or two.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import lru_cache

import numpy as np
from scipy.optimize import minimize

from seqrsm.analysis.scale import ResponseScale
from seqrsm.arrays import FloatArray
from seqrsm.decide.discrepancy import evidence_limit, find_discrepancy
from seqrsm.decide.intervals import IntervalKind, half_width
from seqrsm.decide.stopping import Departure
from seqrsm.design.factors import ContinuousFactor
from seqrsm.design.optimal import start_design
from seqrsm.design.quadratic import QuadraticModel
from seqrsm.design.region import Region
from seqrsm.fit.anova import LackOfFit
from seqrsm.fit.least_squares import LeastSquaresFit, fit_least_squares
from seqrsm.fit.optimum import optimum, optimum_draws
from seqrsm.fit.robust import student_weights
from seqrsm.fit.weights import expected_shares
from seqrsm.propose.batch import plan_of, propose_batch
from seqrsm.propose.known import Evidence, Sought

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


class Told:
    """What the fit is told of the scores: plain errors, Student-t errors, or counts of ``trials``."""

    def __init__(self, errors: str = "normal", trials: int = 0) -> None:
        self.student, self.trials = errors == "student_t", trials if errors == "binomial" else 0

    def weights(self, Z: FloatArray, y: FloatArray) -> FloatArray:
        """Relative weights (n,) of runs."""
        if self.student:
            return tail_weights(Z, y)
        if not self.trials:
            return np.ones(len(y))
        trials = np.full(len(y), float(self.trials))
        return ResponseScale.of_counts("identity", y, trials, expected_shares(Z, y, trials)).weights

    def weight_at(self, Z: FloatArray, y: FloatArray, value: float) -> float:
        """Relative weight of a future run whose expected score is ``value``."""
        if not self.trials:
            return 1.0
        trials = np.full(len(y), float(self.trials))
        return float(ResponseScale.of_counts("identity", y, trials, expected_shares(Z, y, trials)).weight_at(value))


NORMAL = Told()


@dataclass(frozen=True, slots=True)
class Fitted:
    """What one look knows."""

    told: Told
    point: FloatArray  # recommended, coded
    row: FloatArray  # of the recommended settings
    fit: LeastSquaresFit
    model: QuadraticModel
    weight: float  # of a run at the recommended settings
    departure: Departure

    @property
    def mean(self) -> float:
        return float(self.row @ self.fit.estimate)

    @property
    def s(self) -> float:
        """Of a run at the recommended settings."""
        return self.fit.s / float(np.sqrt(self.weight))

    @property
    def h(self) -> float:
        """In units of that."""
        return float(self.fit.variance_unscaled(self.row[None, :])[0]) * self.weight

    def half_width(self, kind: IntervalKind, level: float = 0.95, replicates: int = 5) -> float:
        """Of an interval at the recommended settings."""
        if not self.told.student:
            return float(half_width(kind, self.s, self.fit.df_residual, self.h, level, replicates))
        beta, sigma = _draws_of(self.fit.Z.tobytes(), self.fit.y.tobytes(), self.fit.n_terms)
        rng = np.random.default_rng(len(self.fit.y))
        m = {"confidence": 0, "prediction": 1, "prediction_mean": replicates}[kind]
        noise = rng.standard_t(4.0, (len(sigma), m)).mean(axis=1) if m else 0.0
        low, high = np.quantile(beta @ self.row + sigma * noise, [0.5 - 0.5 * level, 0.5 + 0.5 * level])
        return 0.5 * float(high - low)

    def ends(self, kind: IntervalKind, level: float = 0.95) -> FloatArray:
        """Of the same interval."""
        return self.mean + self.half_width(kind, level) * np.array([-1.0, 1.0])


@lru_cache(maxsize=2)
def _draws_of(Z: bytes, y: bytes, p: int) -> tuple[FloatArray, FloatArray]:
    """Posterior draws of a fit, made once for all its intervals."""
    return student_draws(np.frombuffer(Z).reshape(-1, p), np.frombuffer(y))


@lru_cache(maxsize=4)
def _weights_of(Z: bytes, y: bytes, p: int) -> FloatArray:
    scores = np.frombuffer(y)
    return student_weights(np.frombuffer(Z).reshape(-1, p), scores, np.ones(len(scores)))


def tail_weights(Z: FloatArray, y: FloatArray) -> FloatArray:
    """Weights (n,) of Student-t errors, remembered for the same runs."""
    return _weights_of(np.ascontiguousarray(Z).tobytes(), np.ascontiguousarray(y).tobytes(), Z.shape[1])


def student_draws(Z: FloatArray, y: FloatArray, nu: float = 4.0, chains: int = 25) -> tuple[FloatArray, FloatArray]:
    """Posterior of coefficients and scale under Student-t errors and flat priors, by Gibbs sampling.

    Errors are normal with precisions drawn from a gamma distribution (Geweke 1993, J. Appl. Econometrics 8, S19-S40);
    ``seqrsm`` itself samples the same posterior by emcee, twenty times slower.
    """
    rng = np.random.default_rng(len(y))
    n, p = Z.shape
    share = np.ones((chains, n))
    betas, sigmas = [], []
    outer = (Z[:, :, None] * Z[:, None, :]).reshape(n, p * p)
    for sweep in range(95):
        L = np.linalg.cholesky((share @ outer).reshape(chains, p, p))
        right = (share * y) @ Z
        half = np.linalg.solve(L, right[:, :, None])
        rss = np.maximum(share @ y**2 - np.sum(half[..., 0] ** 2, axis=1), 1e-12)
        sigma = np.sqrt(rss / rng.chisquare(n - p, chains))
        noise = sigma[:, None] * rng.standard_normal((chains, p))
        beta = np.linalg.solve(np.swapaxes(L, 1, 2), half + noise[:, :, None])[..., 0]
        square = (y - beta @ Z.T) ** 2 / sigma[:, None] ** 2
        share = rng.gamma(0.5 * (nu + 1.0), 2.0 / (nu + square))
        if sweep >= 15:
            betas.append(beta)
            sigmas.append(sigma)
    return np.vstack(betas), np.concatenate(sigmas)


def fit_scores(
    model: QuadraticModel, region: Region, X: FloatArray, y: FloatArray, told: Told = NORMAL, least: int = 0
) -> Fitted:
    """The fit, as ``seqrsm`` makes it; a departure is looked for from ``least`` runs on."""
    Z = model.matrix(X)
    weights = told.weights(Z, y)
    ids = [tuple(row) for row in np.round(X, 9) + 0.0]
    fit = fit_least_squares(Z, y, model.terms, weights=weights, setting_ids=ids)
    best = optimum(model, region, fit.estimate).point
    departure = Departure(0.0, evidence_limit(fit.df_residual))
    if len(y) >= least:
        departure = replace(departure, evidence=find_discrepancy(model, X, Z, y, weights).evidence)
    row = model.matrix(best[None, :])[0]
    weight = told.weight_at(Z, y, float(row @ fit.estimate))
    return Fitted(told, best, row, fit, model, weight, departure)


def next_points(found: Fitted, k: int, X: FloatArray, n: int, rng: np.random.Generator, seed: int) -> FloatArray:
    """Next runs, as ``seqrsm run`` chooses them."""
    model, region, _ = stage(k)
    fit = found.fit
    df = fit.df_residual
    sigma = fit.s * np.sqrt(df / rng.chisquare(df, size=(64, 1)))
    draws = fit.estimate + sigma * (rng.standard_normal((64, model.p)) @ fit.factor.T)
    evidence = Evidence(model.matrix(X), X, df_pure_error=pure_error(found))
    sought = Sought(found.point, optimum_draws(model, region, draws)[0])
    batch = propose_batch(model, region, evidence, sought, n, plan_of("optimum"), seed=seed, n_candidates=700)
    return np.array([proposal.point for proposal in batch])


def pure_error(found: Fitted) -> int:
    """Degrees of freedom of pure error."""
    lack = found.fit.lack_of_fit()
    return lack.df_pe if isinstance(lack, LackOfFit) else 0
