"""Log posterior densities for the sampler, in whitened coordinates, and the proposal they are sampled with.

Coordinates of a walker: u (p,) and log sigma, with beta = mean + scale * L u. ``mean``, ``L`` and ``scale`` come from a
conjugate posterior, the *base*; for normal errors and a conjugate prior the base is the target itself.

Below it, any other model with a log density: parameters with bounds are sampled on an unbounded scale, x = log(v - low)
for one bound, the logit of the share of the interval for two, with the Jacobian. The proposal is then a Student-t
distribution at the mode with the curvature there.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, Protocol

import numpy as np
import scipy
from scipy.special import expit, gammaln

from seqrsm.arrays import FloatArray
from seqrsm.errors import FitError
from seqrsm.fit.conjugate import ConjugatePosterior, LinearBounds, Prior, posterior
from seqrsm.fit.moves import Distribution

# Of the base's degrees of freedom, the share that the proposal keeps unless errors are normal: its tails are heavier.
_TAIL = 0.7


class Errors(Protocol):
    """Errors that add to a linear model, by the squares of errors over their scale."""

    def log_likelihood(self, square: FloatArray) -> FloatArray:
        """Log density (m,) of the n errors of each row (m, n) at scale 1, up to a constant."""

    def share(self, square: FloatArray) -> FloatArray:
        """Weight of each run in the most likely fit: -2 times the slope of its log density by the square."""


_MANY = 1000
"""Runs from which the sum of squares is taken from a triangle; fewer cost nothing as they are."""


@dataclass(frozen=True, slots=True)
class Proposal:
    """Normal-inverse-gamma distribution of (u, log sigma).

    sigma^2 ~ InverseGamma(a, b), u | sigma ~ N(centre, sigma^2 MM').
    """

    centre: FloatArray
    """(p,)."""
    M: FloatArray
    inverse: FloatArray
    """(p, p): lower triangular, and its inverse: a product is faster here than a triangular solve in every step."""
    a: float
    b: float

    def draw(self, random: Any, n: int) -> FloatArray:
        """Draw (n, d) with a ``numpy.random.RandomState``."""
        p = self.centre.size
        sigma = np.sqrt(self.b / random.standard_gamma(self.a, size=n))
        u = self.centre + sigma[:, None] * (random.standard_normal((n, p)) @ self.M.T)
        return np.hstack([u, np.log(sigma)[:, None]])

    def log_density(self, x: FloatArray) -> FloatArray:
        """Normalised log density (n, d) -> (n,)."""
        p = self.centre.size
        g = (x[:, :p] - self.centre) @ self.inverse.T
        value = -(p + 2.0 * self.a) * x[:, p] - (0.5 * np.sum(np.square(g), axis=1) + self.b) * np.exp(-2.0 * x[:, p])
        value += self.a * np.log(self.b) - gammaln(self.a) + np.log(2.0)
        value -= np.sum(np.log(np.diagonal(self.M))) + 0.5 * p * np.log(2.0 * np.pi)
        return np.asarray(value)

    def tuned(self, draws: FloatArray) -> Proposal:
        """The member of the family with the moments of ``draws`` (n, d), n well above d."""
        p = self.centre.size
        precision = np.exp(-2.0 * draws[:, p])
        centre = np.sum(draws[:, :p] * precision[:, None], axis=0) / np.sum(precision)
        residual = (draws[:, :p] - centre) * np.sqrt(precision)[:, None]
        M = np.linalg.cholesky(residual.T @ residual / draws.shape[0])
        rate = float(np.mean(precision) / np.var(precision))
        return Proposal(centre, M, np.linalg.inv(M), float(np.mean(precision)) * rate, rate)


@dataclass(frozen=True, slots=True)
class Target:
    """What the sampler needs."""

    log_prob: Callable[[FloatArray], FloatArray]
    """(n, d) -> (n,), up to a constant."""
    proposal: Distribution
    """From the base: the target itself for normal errors and a conjugate prior."""
    exact: bool
    """Whether it is."""
    d: int
    """Dimensions."""
    unpack: Callable[[FloatArray], FloatArray]
    """(n, d) -> parameters (n, d) in their own units; coefficients, then sigma."""
    bounds: LinearBounds | None = None
    """Of the first coordinates."""

    def start(self, random: Any, n: int) -> FloatArray:
        """Where n walkers begin: drawn from the proposal, and inside the bounds."""
        x = self.proposal.draw(random, n)
        if self.bounds is not None:
            p = self.bounds.rows.shape[1]
            x[:, :p] = self.bounds.moved_inside(x[:, :p], random)
        return x


def build_target(
    Z: FloatArray, y: FloatArray, w: FloatArray, errors: Errors | None, prior: Prior, bounds: LinearBounds | None
) -> Target:
    """Posterior of ``y = Z beta + e``; Z (n, p), y and weights w (n,), errors None where normal, bounds cut the prior.

    FitError of scores that cannot be used, or that the model reproduces exactly.
    """
    base = _base(Z, y, w, prior, errors)
    if base.b == 0.0:
        raise FitError("the model reproduces every score exactly, so sigma has no posterior to sample")
    p, scale = Z.shape[1], base.scale
    tail = 1.0 if errors is None else _TAIL
    root = np.sqrt(w)
    A = np.ascontiguousarray(((Z * root[:, None]) @ base.factor * scale).T)
    r0 = root * (y - Z @ base.mean)
    n = r0.size
    if errors is None and n > _MANY:
        # |r0 - A'u| = |R_0 - R_A u| for the triangle R of [A', r0]: the sampler need not visit every run at each step.
        R = np.linalg.qr(np.column_stack([A.T, r0]))[1]
        A, r0 = np.ascontiguousarray(R[:, :p].T), np.asarray(R[:, p])
    log_prior = _log_prior(prior, base)
    half_log_w = 0.5 * float(np.sum(np.log(w)))
    inner = None if bounds is None else bounds.seen_from(base.mean, scale * base.factor)

    def log_prob(x: FloatArray) -> FloatArray:
        with np.errstate(over="ignore", under="ignore", invalid="ignore", divide="ignore"):
            log_sigma = x[:, p]
            square = np.square(r0 - x[:, :p] @ A) * np.exp(-2.0 * log_sigma)[:, None]
            value = half_log_w - n * log_sigma
            value += -0.5 * np.sum(square, axis=1) if errors is None else errors.log_likelihood(square)
            value += log_prior(x[:, :p], log_sigma)
            if inner is not None:
                value[~inner.hold(x[:, :p])] = -np.inf
        return np.where(np.isfinite(value), value, -np.inf)

    proposal = Proposal(np.zeros(p), np.eye(p) / scale, np.eye(p) * scale, tail * base.a, tail * base.b)
    return Target(
        log_prob,
        proposal,
        tail == 1.0 and inner is None,
        p + 1,
        lambda x: np.column_stack([base.mean + scale * (x[:, :p] @ base.factor.T), np.exp(x[:, p])]),
        inner,
    )


def _base(Z: FloatArray, y: FloatArray, w: FloatArray, prior: Prior, errors: Errors | None) -> ConjugatePosterior:
    """Conjugate posterior near the target: reweighted for other than normal errors."""
    base = posterior(Z, y, w, prior)
    if errors is None:
        return base
    for _ in range(30):
        square = w * np.square(y - Z @ base.mean) / max(base.b / base.a, np.finfo(np.float64).tiny)
        new = posterior(Z, y, w * errors.share(square), prior)
        change = abs(new.scale - base.scale)
        base = new
        if change < 1e-3 * base.scale:
            break
    return base


def _log_prior(prior: Prior, base: ConjugatePosterior) -> Callable[[FloatArray, FloatArray], FloatArray]:
    """Log prior of (u, log sigma), with the Jacobian of log sigma."""
    if prior is None:
        return lambda u, log_sigma: np.zeros(log_sigma.shape)
    m0, Lambda0, a0, b0 = prior.m0, prior.Lambda0, prior.a0, prior.b0
    rank = int(np.linalg.matrix_rank(Lambda0, hermitian=True))

    def conjugate(u: FloatArray, log_sigma: FloatArray) -> FloatArray:
        deviation = base.mean - m0 + base.scale * (u @ base.factor.T)
        quadratic = np.sum((deviation @ Lambda0) * deviation, axis=1)
        return np.asarray(-(2.0 * a0 + rank) * log_sigma - (b0 + 0.5 * quadratic) * np.exp(-2.0 * log_sigma))

    return conjugate


_DF = 6.0  # of the proposal: heavier tails than a posterior near normal
_WIDEN = 1.15
_STEP = 1e-4


@dataclass(frozen=True, slots=True)
class GeneralModel:
    """Parameters and their joint log density with the data."""

    start: FloatArray
    """(d,): likely values, inside the bounds."""
    low: FloatArray
    high: FloatArray
    """(d,): bounds; -inf and inf where there is none."""
    log_density: Callable[[FloatArray], FloatArray]
    """(n, d) parameter values -> (n,) log prior plus log likelihood, up to a constant; -inf where impossible."""

    def natural(self, x: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Parameter values (n, d) of unbounded coordinates (n, d), and the log Jacobian (n,)."""
        values, log_jacobian = x.copy(), np.zeros(x.shape[0])
        for j, (low, high) in enumerate(zip(self.low, self.high, strict=True)):
            if np.isfinite(low) and np.isfinite(high):
                width = high - low
                values[:, j] = low + width * expit(x[:, j])
                log_jacobian += -np.abs(x[:, j]) - 2.0 * np.log1p(np.exp(-np.abs(x[:, j]))) + np.log(width)
            elif np.isfinite(low):
                values[:, j] = low + np.exp(x[:, j])
                log_jacobian += x[:, j]
            elif np.isfinite(high):
                values[:, j] = high - np.exp(x[:, j])
                log_jacobian += x[:, j]
        return values, log_jacobian

    def unbounded_start(self) -> FloatArray:
        """Coordinates (d,) of ``start``."""
        x = self.start.copy()
        for j, (value, low, high) in enumerate(zip(self.start, self.low, self.high, strict=True)):
            if np.isfinite(low) and np.isfinite(high):
                x[j] = np.log(value - low) - np.log(high - value)
            elif np.isfinite(low):
                x[j] = np.log(value - low)
            elif np.isfinite(high):
                x[j] = np.log(high - value)
        return x


@dataclass(frozen=True, slots=True)
class StudentProposal:
    """Multivariate Student-t distribution with ``_DF`` degrees of freedom, centre (d,) and scale LL'."""

    centre: FloatArray
    L: FloatArray
    inverse: FloatArray

    @classmethod
    def of(cls, centre: FloatArray, covariance: FloatArray) -> StudentProposal:
        """From a positive definite scale matrix (d, d)."""
        L: FloatArray = np.asarray(np.linalg.cholesky(covariance), dtype=np.float64)
        return cls(centre, L, np.asarray(np.linalg.inv(L), dtype=np.float64))

    def draw(self, random: Any, n: int) -> FloatArray:
        """Draw (n, d) with a ``numpy.random.RandomState``."""
        normal = random.standard_normal((n, self.centre.size)) @ self.L.T
        scale = np.sqrt(random.chisquare(_DF, size=(n, 1)) / _DF)
        return np.asarray(self.centre + normal / scale)

    def log_density(self, x: FloatArray) -> FloatArray:
        """Normalised log density (n, d) -> (n,)."""
        d = self.centre.size
        square = np.sum(np.square((x - self.centre) @ self.inverse.T), axis=1)
        constant = gammaln(0.5 * (_DF + d)) - gammaln(0.5 * _DF) - 0.5 * d * np.log(_DF * np.pi)
        constant -= np.sum(np.log(np.diagonal(self.L)))
        return np.asarray(constant - 0.5 * (_DF + d) * np.log1p(square / _DF))

    def tuned(self, draws: FloatArray) -> StudentProposal:
        """Same centre and somewhat more than the covariance of ``draws`` (n, d)."""
        return StudentProposal.of(np.mean(draws, axis=0), _WIDEN * np.atleast_2d(np.cov(draws, rowvar=False)))


def general_target(model: GeneralModel) -> Target:
    """Target for the sampler, with its proposal at the mode; FitError where the density is not finite at the start."""
    d = len(model.start)

    def log_prob(x: FloatArray) -> FloatArray:
        with np.errstate(all="ignore"):
            values, log_jacobian = model.natural(x)
            value = model.log_density(values) + log_jacobian
        return np.where(np.isfinite(value), value, -np.inf)

    start = model.unbounded_start()
    if not np.all(np.isfinite(start)) or not np.isfinite(log_prob(start[None, :])[0]):
        raise FitError("the posterior density is not finite where it is expected to lie")
    mode = _mode(log_prob, start)
    covariance = _covariance(log_prob, mode)
    return Target(log_prob, StudentProposal.of(mode, covariance), False, d, lambda x: model.natural(x)[0])


def _mode(log_prob: Callable[[FloatArray], FloatArray], start: FloatArray) -> FloatArray:
    steps = _STEP * np.eye(start.size)

    def negative(x: FloatArray) -> tuple[float, FloatArray]:
        values = -log_prob(np.vstack([x, x + steps, x - steps]))
        with np.errstate(invalid="ignore"):  # the search may step where the density is 0
            gradient = (values[1 : start.size + 1] - values[start.size + 1 :]) / (2.0 * _STEP)
        return float(np.minimum(values[0], 1e300)), np.where(np.isfinite(gradient), gradient, 0.0)

    found = scipy.optimize.minimize(negative, start, jac=True, method="L-BFGS-B", options={"maxiter": 500})
    mode: FloatArray = np.asarray(found.x, dtype=np.float64)
    return mode if np.isfinite(log_prob(mode[None, :])[0]) else start


def _covariance(log_prob: Callable[[FloatArray], FloatArray], mode: FloatArray) -> FloatArray:
    """Inverse of the negative Hessian at the mode, by differences; directions without curvature get a wide step."""
    d = mode.size
    step = 3e-3
    moves = step * np.eye(d)
    pairs = [(a * moves[i] + b * moves[j]) for i in range(d) for j in range(d) for a in (1, -1) for b in (1, -1)]
    values = log_prob(mode + np.array(pairs)).reshape(d, d, 2, 2)
    with np.errstate(invalid="ignore"):
        hessian = (values[:, :, 0, 0] - values[:, :, 0, 1] - values[:, :, 1, 0] + values[:, :, 1, 1]) / (4.0 * step**2)
        precision = -0.5 * (hessian + hessian.T)
    precision = np.where(np.isfinite(precision), precision, np.eye(d))
    eigenvalues, vectors = np.linalg.eigh(precision)
    eigenvalues = np.maximum(eigenvalues, 0.1)
    return np.asarray(_WIDEN * (vectors / eigenvalues) @ vectors.T)


_PLACING, _A_DRAW = 4000, 6  # draws of each round that only places the next; of the last, for each that is asked for
_A_DIMENSION = 10  # least of the former that are independent, for each dimension


def draws_by_importance(model: GeneralModel, n: int, rng: np.random.Generator) -> tuple[FloatArray, float] | None:
    """Draws (n, d) of a model's parameters, and how many independent ones they are worth; None where few have weight.

    Of Student's distribution at the mode, then of one with the moments of these draws. Errors: as of `general_target`.
    """
    target = general_target(model)
    proposal: Distribution = target.proposal
    for size, least in (*[(_PLACING, _A_DIMENSION * target.d)] * 2, (_A_DRAW * n, n)):
        x = proposal.draw(rng, size)
        logs = target.log_prob(x) - proposal.log_density(x)
        shares = np.exp(logs - logs.max())
        shares /= shares.sum()
        worth = float(1.0 / np.sum(shares**2))
        if worth < least:
            return None
        x = x[rng.choice(size, max(n, _PLACING), p=shares)]
        proposal = proposal.tuned(x)
    return target.unpack(x[:n]), 1.0 / (1.0 / worth + 1.0 / n)
