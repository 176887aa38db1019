"""Simulation and flight together: the flight's surface is the simulation's plus a linear discrepancy.

Kennedy and O'Hagan (2001), J. R. Statist. Soc. B 63, 425-464, with the discrepancy in its linear form: simulated runs
have the model row [z, 0], flights [z, z]. The discrepancy has a normal prior around zero, so that few flights correct
the simulation and do not replace it; terms of each order are half as wide as those of the order before, since a ground
mostly scores more or less wherever the sensor stands (reports/validation/worlds.md); and each source has its own
variance. Without the terms of second order the flight's optimum would have the simulation's curvature, however much the
flights say otherwise: on real scores the intervals then cover too little (reports/validation/flevoland_flights.md).
Everything is conjugate given the ratio of the variances; the ratio has a posterior of its own, on a grid, and intervals
and draws are mixtures over it.

That is the quadratic's part of what is believed; the process beside it (`seqrsm.fit.process`) has the same difference.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.special import stdtr

from seqrsm.arrays import BoolArray, FloatArray, IntArray
from seqrsm.design.quadratic import QuadraticModel
from seqrsm.fit.conjugate import ConjugatePosterior, NormalInverseGamma, crossing, posterior, with_further
from seqrsm.fit.intervals import Interval, Prediction, t_quantile
from seqrsm.fit.least_squares import block_columns

FEW_FLIGHTS = 4
"""With fewer flights the discrepancy is mostly its prior."""

_RATIO_RUNS = 2.0  # degrees of freedom that the guess of the ratio of variances is worth
_RATIOS = np.exp(np.linspace(np.log(0.01), np.log(100.0), 25))  # variance of a simulation over that of a flight
_ROUNDS = 25  # of the iteration for the variances
_DUST = 1e-6  # of the likeliest ratio's probability: what has less is left out
_OF_SCORES = 0.4  # standard deviation of the mean difference over that of the scores: a guess
_WIDTH = {"intercept": 1.0, "linear": 0.5, "category": 0.5, "interaction": 0.25, "square": 0.25}
"""Prior standard deviation of a term of the discrepancy, over that of its intercept."""


def discrepancy_sd(model: QuadraticModel, prior_sd: float) -> FloatArray:
    """Prior standard deviation (p,) of each term of the discrepancy; ``prior_sd`` is that of the intercept."""
    return prior_sd * np.array([_WIDTH[term.kind] for term in model.terms])


def guessed_sd(y: FloatArray) -> float:
    """Prior standard deviation of the discrepancy's intercept where nothing is known of it but scores (n,)."""
    return max(_OF_SCORES * float(np.std(y)), 1e-9 * max(1.0, float(np.max(np.abs(y)))))


def stacked_rows(model: QuadraticModel, points: FloatArray, is_flight: BoolArray) -> FloatArray:
    """Rows (n, 2 p) of coded ``points`` (n, k): [z, z] of flights and [z, 0] of simulations."""
    Z = model.matrix(points)
    return np.hstack([Z, Z * np.asarray(is_flight)[:, None]])


def blocks_within(blocks: Sequence[str], is_flight: BoolArray) -> FloatArray:
    """Contrasts (n, e) of each source's own blocks (n,); of one source its `block_columns`.

    Zeros are the mean of its blocks, which is what `stacked_rows` tell apart: a contrast of days with simulations would
    take the difference between the two.
    """
    found = []
    for own in (~is_flight, is_flight):
        columns, _ = block_columns(np.array(blocks)[own])
        found.append(np.zeros((len(own), columns.shape[1])))
        found[-1][own] = columns
    return np.hstack(found)


@dataclass(frozen=True, slots=True)
class StackedRuns:
    """Rows [z, discrepancy, blocks] (n, c), scores, relative weights within a source, which runs are flights: (n,).

    ``ratio``: a guess of the variance of a simulation over that of a flight.
    """

    Z: FloatArray
    y: FloatArray
    weights: FloatArray
    flights: BoolArray
    ratio: float


@dataclass(frozen=True, slots=True)
class GivenRatio:
    """Posterior for one ratio of the variances (simulation over flight), and the share of probability it has."""

    ratio: float
    share: float
    posterior: ConjugatePosterior


@dataclass(frozen=True, slots=True)
class SourceFit:
    """The flight's surface from both sources."""

    estimate: FloatArray
    """(p,): coefficients of the flight's surface."""
    simulation: FloatArray
    """(p,): those of the simulation's."""
    s: float
    """Standard deviation of one flight, score units, at the likeliest ratio of the variances."""
    s_simulation: float
    """That of one simulated run."""
    df_residual: float
    """Degrees of freedom of ``s``: those of the flights' own residuals, with the guess."""
    n_flights: int
    n_simulations: int

    prior_sd: float
    """Prior standard deviation of the discrepancy's intercept, its mean over the region, score units."""
    prior_share: float
    """Share of the discrepancy's prior variance, over all its terms, that is left: 1 before the first flight, near 0
    after many."""
    posterior: ConjugatePosterior
    """Of all coefficients, [z, discrepancy] and then blocks."""
    model: QuadraticModel

    runs: StackedRuns
    """What was fitted."""
    by_ratio: tuple[GivenRatio, ...]
    """What intervals and draws are mixed from."""

    @property
    def flight_weight(self) -> float:
        """Relative weight of a flight; a simulated run has 1."""
        return (self.s_simulation / self.s) ** 2

    @property
    def prior_driven(self) -> bool:
        """Whether the discrepancy is mostly its prior."""
        return self.n_flights < FEW_FLIGHTS or self.prior_share > 0.5

    @property
    def log_evidence(self) -> float:
        """Logarithm of the probability of the scores under ``prior_sd``, over all ratios; up to a constant of the runs.

        Least where the surface passes through every score and tells nothing of variances.
        """
        one = max(self.by_ratio, key=lambda given: given.share)
        if one.posterior.b <= 0.0:
            return -math.inf
        narrow = float(np.sum(np.log(self.s_simulation / discrepancy_sd(self.model, self.prior_sd))))
        return _log_weight(self.runs, one.posterior, one.ratio) - math.log(one.share) + narrow

    def flight_rows(self, rows: FloatArray) -> FloatArray:
        """Rows of all coefficients from model rows (m, p) of flights, at the mean block."""
        full = np.zeros((len(rows), len(self.posterior.mean)))
        full[:, : 2 * self.model.p] = np.hstack([rows, rows])
        return full

    def variance_unscaled(self, rows: FloatArray) -> FloatArray:
        """Variance of the flight's mean at model rows (m, p), in units of ``s`` squared."""
        return self.posterior.variance_unscaled(self.flight_rows(rows)) * self.flight_weight

    def predict(
        self, rows: FloatArray, level: float = 0.95, weight: float | FloatArray = 1.0, replicates: float = 1
    ) -> Prediction:
        """Intervals of the flight's mean and of future flights; arguments as in ``LeastSquaresFit.predict``.

        They hold ``level`` of the mixture over the ratio of the variances, the mean in the middle; the standard error
        is that of the likeliest ratio.
        """
        full = self.flight_rows(np.atleast_2d(rows))
        mean = full @ self.posterior.mean
        future = replicates * np.asarray(weight, dtype=np.float64)
        off = np.array([full @ one.posterior.mean for one in self.by_ratio]) - mean
        scale = np.array([one.posterior.scale for one in self.by_ratio])[:, None]
        seen = scale**2 * np.array([one.posterior.variance_unscaled(full) for one in self.by_ratio])
        noise = scale**2 / np.array([one.ratio for one in self.by_ratio])[:, None] / future
        confidence = self._half_width(off, np.sqrt(seen), level)
        prediction = self._half_width(off, np.sqrt(seen + noise), level)
        return Prediction(
            mean,
            Interval(mean - confidence, mean + confidence),
            Interval(mean - prediction, mean + prediction),
            self.s_simulation * np.sqrt(self.posterior.variance_unscaled(full)),
        )

    def _half_width(self, off: FloatArray, se: FloatArray, level: float) -> FloatArray:
        """Half-widths (m,) that hold ``level`` of mixtures of Student's t with centres and scales (r, m)."""
        share = np.array([one.share for one in self.by_ratio])
        df = np.array([one.posterior.df for one in self.by_ratio])
        # Where every one of them holds the level, so does the mixture.
        most = np.max(np.abs(off) + t_quantile(df, level)[:, None] * se, axis=0)

        def excess(half: FloatArray, at: IntArray) -> FloatArray:
            upper = stdtr(df[:, None], (half - off[:, at]) / se[:, at])
            lower = stdtr(df[:, None], (-half - off[:, at]) / se[:, at])
            return np.asarray(share @ (upper - lower) - level)

        return crossing(excess, np.zeros_like(most), most)

    def discrepancy(self, row: FloatArray, level: float = 0.95) -> tuple[float, float, float]:
        """Flight less simulation at a model row (p,), and the ends of its credible interval."""
        full = np.zeros((1, len(self.posterior.mean)))
        full[0, self.model.p : 2 * self.model.p] = row
        mean = float(full[0] @ self.posterior.mean)
        se = self.posterior.scale * float(np.sqrt(self.posterior.variance_unscaled(full)[0]))
        half = float(t_quantile(self.posterior.df, level)) * se
        return mean, mean - half, mean + half

    def draws(
        self, n: int, rng: np.random.Generator, base: NormalInverseGamma | None = None
    ) -> tuple[FloatArray, FloatArray]:
        """Draws of all coefficients (n, c) and of the standard deviation (n,) of one flight, in no order.

        ``base``: prior of the model terms; that of the fit by default.
        """
        given = self.by_ratio
        if base is not None:
            given = _by_ratio(self.model, self.runs, self.prior_sd, self.posterior, self.flight_weight, base)
        counts = rng.multinomial(n, [one.share for one in given])
        parts = [(*one.posterior.draws(int(m), rng), one.ratio) for one, m in zip(given, counts, strict=True) if m]
        order = rng.permutation(n)
        beta = np.concatenate([found for found, _, _ in parts])[order]
        sigma = np.concatenate([found / np.sqrt(r) for _, found, r in parts])[order]
        return beta, sigma


def _by_ratio(
    model: QuadraticModel,
    runs: StackedRuns,
    prior_sd: float,
    likeliest: ConjugatePosterior,
    ratio: float,
    base: NormalInverseGamma | None,
) -> tuple[GivenRatio, ...]:
    """Posterior of the ratio of the variances on a grid, and all else given it.

    The prior of the ratio has the guess as its middle and is worth two runs of each. A surface through every score says
    nothing of variances: there the likeliest stands alone.
    """
    n_extra = runs.Z.shape[1] - 2 * model.p
    prior = source_prior(model, n_extra, prior_sd, likeliest.scale, base)
    given = [posterior(runs.Z, runs.y, np.where(runs.flights, r, 1.0) * runs.weights, prior) for r in _RATIOS]
    if any(one.b <= 0.0 for one in given):
        return (GivenRatio(ratio, 1.0, likeliest),)
    log_share = np.array([_log_weight(runs, one, r) for one, r in zip(given, _RATIOS.tolist(), strict=True)])
    share = np.exp(log_share - np.max(log_share))
    share[share < _DUST] = 0.0
    share /= np.sum(share)
    return tuple(GivenRatio(float(r), float(w), one) for r, w, one in zip(_RATIOS, share, given, strict=True) if w)


def _log_weight(runs: StackedRuns, given: ConjugatePosterior, ratio: float) -> float:
    """Logarithm of the probability of a ratio and of the scores under it, up to a constant of runs and prior."""
    likelihood = float(np.linalg.slogdet(given.factor)[1]) - given.a * math.log(given.b)
    to_guess = ratio / runs.ratio
    likelihood += 0.5 * np.count_nonzero(runs.flights) * math.log(ratio)
    return likelihood + math.log(to_guess) - 2.0 * math.log1p(to_guess)


def to_flight(model: QuadraticModel, coefficients: FloatArray) -> FloatArray:
    """Coefficients (m, p) of the flight's surface from those (m, 2 p + e) of the stacked model."""
    return np.asarray(coefficients[:, : model.p] + coefficients[:, model.p : 2 * model.p])


def source_prior(
    model: QuadraticModel, n_extra: int, prior_sd: float, sigma: float, base: NormalInverseGamma | None = None
) -> NormalInverseGamma:
    """Prior of the stacked model: the discrepancy around zero with `discrepancy_sd`, the rest as ``base`` (flat).

    There are ``n_extra`` columns of blocks; ``prior_sd`` and ``sigma`` are those of the discrepancy's intercept and of
    one simulated run, score units, > 0.
    """
    of_discrepancy = (sigma / discrepancy_sd(model, prior_sd)) ** 2
    return with_further(base, model.p, np.append(of_discrepancy, np.zeros(n_extra)))


def fit_sources(
    model: QuadraticModel,
    points: FloatArray,
    y: FloatArray,
    is_flight: Sequence[bool] | BoolArray,
    *,
    weights: FloatArray | None = None,
    extra: FloatArray | None = None,
    prior_sd: float,
    ratio: float = 1.0,
) -> SourceFit:
    """Fit simulated runs and flights together, of scores y (n,) at coded points (n, k).

    The variance of each source is estimated from its own residuals, with a guess ``ratio`` > 0 of a simulation's over a
    flight's, worth two runs. Intervals and draws do not take these two as known: they are mixtures over the ratio's
    posterior. ``weights`` (n,) are relative within a source, ``extra`` (n, e) columns of blocks, see `blocks_within`;
    ``prior_sd``, score units, as in `discrepancy_sd`. FitError where runs and priors leave a coefficient or sigma
    undetermined.
    """
    flights = np.asarray(is_flight, dtype=np.bool_)
    n = len(y)
    own = np.ones(n) if weights is None else np.asarray(weights, dtype=np.float64)
    blocks = np.empty((n, 0)) if extra is None else extra
    Z = np.hstack([stacked_rows(model, points, flights), blocks])
    df_flights = _RATIO_RUNS
    guess, sigma = ratio, max(0.25 * float(np.std(y)), 1e-12)
    for _ in range(_ROUNDS):
        w = np.where(flights, own * ratio, own)
        found = posterior(Z, y, w, source_prior(model, blocks.shape[1], prior_sd, sigma))
        before, sigma = sigma, found.scale if found.scale > 0.0 else sigma
        rest = (y - Z @ found.mean) ** 2 * own
        free = 1.0 - w * found.variance_unscaled(Z)
        df_flights = float(np.sum(free[flights])) + _RATIO_RUNS
        of = [
            (float(np.sum(rest[mask])) + _RATIO_RUNS * own_guess) / (float(np.sum(free[mask])) + _RATIO_RUNS)
            for mask, own_guess in ((~flights, sigma**2), (flights, sigma**2 / guess))
        ]
        ratio = float(np.clip(of[0] / of[1], 0.01, 100.0)) if of[1] > 0.0 else 1.0
        if abs(sigma - before) <= 1e-9 * before:
            break
    w = np.where(flights, own * ratio, own)
    found = posterior(Z, y, w, source_prior(model, blocks.shape[1], prior_sd, sigma))
    of_prior = np.sum(discrepancy_sd(model, prior_sd) ** 2)
    left = found.scale**2 * np.sum(found.factor[model.p : 2 * model.p] ** 2) / of_prior
    runs = StackedRuns(Z, y, own, flights, guess)
    return SourceFit(
        estimate=to_flight(model, found.mean[None, :])[0],
        simulation=found.mean[: model.p],
        s=found.scale / np.sqrt(ratio),
        s_simulation=found.scale,
        df_residual=df_flights,
        n_flights=int(np.count_nonzero(flights)),
        n_simulations=int(np.count_nonzero(~flights)),
        prior_sd=prior_sd,
        prior_share=float(np.clip(left, 0.0, 1.0)),
        posterior=found,
        model=model,
        runs=runs,
        by_ratio=_by_ratio(model, runs, prior_sd, found, ratio, None),
    )
