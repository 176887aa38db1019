"""Student-t errors: weights that make least squares the most likely fit, and posterior draws by Gibbs sampling."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from seqrsm.arrays import FloatArray
from seqrsm.fit.conjugate import Flat, NormalInverseGamma, Prior, posterior

STUDENT_DF = 4.0
"""Degrees of freedom of Student-t errors, where they are not estimated."""

_EM_STEPS = 60


def student_weights(Z: FloatArray, y: FloatArray, weights: FloatArray, nu: float = STUDENT_DF) -> FloatArray:
    """Weights (n,) that turn least squares into the most likely fit with Student-t errors.

    Lange, Little & Taylor (1989), J. Am. Stat. Assoc. 84, 881-896: each run counts ``(nu + 1) / (nu + r^2 / s^2)``, so
    that a wild score counts for next to nothing. Scaled to mean 1; with fewer than three residual degrees of freedom
    every run counts alike.
    """
    n, p = Z.shape
    if n < p + 3:
        return weights
    share = np.ones(n)
    for _ in range(_EM_STEPS):
        root = np.sqrt(weights * share)
        beta = np.linalg.lstsq(Z * root[:, None], y * root, rcond=None)[0]
        square = weights * (y - Z @ beta) ** 2
        variance = float(np.sum(share * square)) / (n - p)
        if variance <= (n * np.finfo(np.float64).eps) ** 2 * float(np.mean(y**2)):  # nothing but rounding is left
            return weights
        after = (nu + 1.0) / (nu + square / variance)
        if np.max(np.abs(after - share)) < 1e-10:
            break
        share = after
    found: FloatArray = weights * share / float(np.mean(share))
    return found


_CHAINS, _WARM_UP = 40, 30


@dataclass(frozen=True, slots=True)
class StudentDraws:
    """Posterior draws under Student-t errors.

    Attributes
    ----------
    beta, sigma : ndarray (m, p), (m,)
        Coefficients and scale of the errors, chain by chain within a sweep.
    r_hat : float
        Largest potential scale reduction of a coefficient over the chains (Gelman & Rubin 1992).
    ess : float
        Smallest effective number of draws, from the scatter of the chains' means.
    sweeps : int
        After the warm-up.
    """

    beta: FloatArray
    sigma: FloatArray
    r_hat: float
    ess: float
    sweeps: int


def student_draws(
    Z: FloatArray,
    y: FloatArray,
    weights: FloatArray,
    prior: Prior,
    n_draws: int,
    rng: np.random.Generator,
    nu: float = STUDENT_DF,
) -> StudentDraws:
    """Posterior of coefficients and scale under Student-t errors.

    An error is normal with a precision of its own from a gamma distribution; given these the posterior is the exact
    one, and given the errors the precisions are gamma (Geweke 1993, J. Appl. Econometrics 8, S19-S40). All chains start
    from the most likely weights and move together; there is nothing to tune.

    Parameters
    ----------
    Z, y, weights : ndarray (n, p), (n,), (n,)
    prior : Flat or NormalInverseGamma
    n_draws : int
        At least so many.
    rng : numpy.random.Generator
    nu : float
        Degrees of freedom of the errors.
    """
    n, p = Z.shape
    start = posterior(Z, y, weights, prior)
    # As seen from the least-squares fit and in its own units: normal equations in u then lose no digits.
    X, y = Z @ start.factor, y - Z @ start.mean
    given = NormalInverseGamma(np.zeros(p), np.zeros((p, p)), 0.0, 0.0) if isinstance(prior, Flat) else prior
    rank = int(np.linalg.matrix_rank(given.Lambda0, hermitian=True))
    off, Lambda0 = given.m0 - start.mean, start.factor.T @ given.Lambda0 @ start.factor
    pull, apart = start.factor.T @ (given.Lambda0 @ off), float(off @ given.Lambda0 @ off)
    shape = given.a0 + 0.5 * (n + rank - p)
    outer = (X[:, :, None] * X[:, None, :]).reshape(n, p * p)
    first = student_weights(X, y, weights, nu) / weights
    share = np.repeat(first[None, :], _CHAINS, axis=0)
    sweeps = max(-(-n_draws // _CHAINS), 25)
    betas, sigmas = np.empty((sweeps, _CHAINS, p)), np.empty((sweeps, _CHAINS))
    for sweep in range(-_WARM_UP, sweeps):
        w = share * weights
        L = np.linalg.cholesky((w @ outer).reshape(_CHAINS, p, p) + Lambda0)
        half = np.linalg.solve(L, ((w * y) @ X + pull)[:, :, None])
        rss = w @ y**2 + apart - np.sum(half[..., 0] ** 2, axis=1)
        sigma = np.sqrt((given.b0 + 0.5 * np.maximum(rss, 1e-300)) / rng.gamma(shape, size=_CHAINS))
        noise = sigma[:, None, None] * rng.standard_normal((_CHAINS, p, 1))
        u = np.linalg.solve(np.swapaxes(L, 1, 2), half + noise)[..., 0]
        square = weights * (y - u @ X.T) ** 2 / sigma[:, None] ** 2
        share = rng.gamma(0.5 * (nu + 1.0), 2.0 / (nu + square))
        if sweep >= 0:
            betas[sweep], sigmas[sweep] = start.mean + u @ start.factor.T, sigma
    within = np.mean(np.var(betas, axis=0, ddof=1), axis=0)
    between = np.var(np.mean(betas, axis=0), axis=0, ddof=1)
    r_hat = float(np.sqrt(np.max((sweeps - 1.0) / sweeps + between / np.maximum(within, 1e-300))))
    ess = float(np.min(np.minimum(within / np.maximum(sweeps * between, 1e-300), 1.0))) * sweeps * _CHAINS
    return StudentDraws(betas.reshape(-1, p), sigmas.ravel(), r_hat, ess, sweeps)
