"""Errors that are not normal: weights that make least squares the most likely fit; Gibbs sampling for Student-t."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from scipy.special import gammaln

from seqrsm.arrays import FloatArray, IntArray
from seqrsm.errors import FitError
from seqrsm.fit.conjugate import NormalInverseGamma, Prior, posterior
from seqrsm.fit.convergence import ess, ess_tail

STUDENT_DF = 4.0
"""Degrees of freedom ``nu`` of Student-t errors."""

_EM_STEPS, _TOO_HIGH = 60, 0.095


def student_share(square: FloatArray) -> FloatArray:
    """What a run counts in the most likely fit, by the square of its error over the scale.

    Lange, Little & Taylor (1989), J. Am. Stat. Assoc. 84, 881-896. A wild score counts for next to nothing.
    """
    return (STUDENT_DF + 1.0) / (STUDENT_DF + square)


def likely_weights(
    Z: FloatArray, y: FloatArray, weights: FloatArray, share_of: Callable[[FloatArray], FloatArray]
) -> FloatArray:
    """Weights (n,) that turn least squares into the most likely fit.

    ``share_of``: as `student_share`. Scaled to mean 1; with fewer than three residual degrees of freedom every run
    counts alike.
    """
    found = _most_likely(Z, y, weights, share_of)
    return weights if found is None else np.asarray(weights * found[0] / np.mean(found[0]))


def _most_likely(
    Z: FloatArray, y: FloatArray, weights: FloatArray, share_of: Callable[[FloatArray], FloatArray]
) -> tuple[FloatArray, FloatArray, float] | None:
    """Shares and squared errors (n,), each times its weight, and the squared scale; None as `likely_weights` has it."""
    n, p = Z.shape
    if n < p + 3:
        return None
    share = np.ones(n)
    for _ in range(_EM_STEPS):
        root = np.sqrt(weights * share)
        beta = np.linalg.lstsq(Z * root[:, None], y * root, rcond=None)[0]
        square = weights * (y - Z @ beta) ** 2
        variance = float(np.sum(share * square)) / (n - p)
        if variance <= (n * np.finfo(np.float64).eps) ** 2 * float(np.mean(y**2)):  # nothing but rounding is left
            return None
        after = share_of(square / variance)
        if np.max(np.abs(after - share)) < 1e-10:
            break
        share = after
    return share, square, variance


def student_evidence(Z: FloatArray, y: FloatArray, weights: FloatArray) -> float:
    """Natural logarithm of the evidence for Student-t errors over that for normal ones, of Z (n, p) and y (n,).

    Flat priors of the coefficients and of log sigma, the same in both. By Laplace's approximation with the expected
    information (Lange, Little & Taylor 1989), which is too high by about a tenth of the sum of squared leverages, by
    three where 60 runs have 45 terms (importance sampling over the runs' shares). 0 with fewer than three residual
    degrees of freedom, or without scatter.
    """
    wild, plain = (_most_likely(Z, y, weights, share_of) for share_of in (student_share, np.ones_like))
    if wild is None or plain is None:
        return 0.0
    (n, p), nu = Z.shape, STUDENT_DF
    (_, square, scale), (*_, variance) = wild, plain
    found = n * (gammaln(0.5 * (nu + 1.0)) - gammaln(0.5 * nu) - 0.5 * np.log(0.5 * nu))
    found -= 0.5 * (nu + 1.0) * np.sum(np.log1p(square / (nu * scale)))
    found -= 0.5 * (p * np.log((nu + 1.0) / (nu + 3.0)) + np.log(nu / (nu + 3.0)))
    leverage = np.sum(np.linalg.qr(Z * np.sqrt(weights)[:, None])[0] ** 2, axis=1)
    return float(found + 0.5 * (n - p) * (1.0 + np.log(variance / scale)) - _TOO_HIGH * np.sum(leverage**2))


_CHAINS, _WARM_UP = 200, 20
_LEAST_SWEEPS = 12
_ENDS = (0.025, 0.975)


def student_draws(
    Z: FloatArray, y: FloatArray, weights: FloatArray, prior: Prior, n_draws: int, rng: np.random.Generator
) -> tuple[FloatArray, FloatArray, dict[str, float]]:
    """Coefficients (m, p) and scale (m,) under Student-t errors, of Z (n, p), y and weights (n,); how well they mix.

    An error is normal with a precision of its own from a gamma distribution; given these the posterior is the exact
    one, and given the errors the precisions are gamma (Geweke 1993, J. Appl. Econometrics 8, S19-S40). All chains start
    from the most likely weights and move together; there is nothing to tune. At least ``n_draws`` are made, in random
    order: any part of them is a sample. They are worth from a fifth to all of as many independent ones.

    Last, of a coefficient or log sigma: ``ess`` and ``ess_ends``, the smallest effective number of draws, of the mean
    and of the ends of 95 % intervals; ``r_hat``, the largest potential scale reduction over the chains (Gelman & Rubin
    1992); ``steps``: sweeps after the warm-up. FitError where a score lies so far from the others, some 1e11 times
    their scatter, that their digits are lost beside it.
    """
    beta, sigma, _, reached = _gibbs(Z, y, weights, prior, n_draws, rng)
    return beta, sigma, reached


def student_draws_of_days(
    Z: FloatArray, y: FloatArray, weights: FloatArray, days: IntArray, n_draws: int, rng: np.random.Generator
) -> tuple[FloatArray, FloatArray, FloatArray, dict[str, float]]:
    """The same under a flat prior with a normal effect of each of the ``days`` (n,), which are numbered from 0.

    Third are standard deviations (m,) of the days; coefficients are those of the average day. The ratio of the standard
    deviations has a half-Cauchy prior of scale 1, as in `seqrsm.fit.blocks`, by two gamma steps (Makalic & Schmidt
    2016, IEEE Signal Process. Lett. 23, 179-182).
    """
    p, d = Z.shape[1], 1 + int(np.max(days))
    precision = np.diag(np.repeat([0.0, 1.0], [p, d]))  # in units of 1 / (ratio sigma)^2
    prior = NormalInverseGamma(np.zeros(p + d), precision, 0.0, 0.0)
    beta, sigma, ratio, reached = _gibbs(np.hstack([Z, np.eye(d)[days]]), y, weights, prior, n_draws, rng, d)
    return beta[:, :p], sigma, ratio * sigma, reached


def _gibbs(
    Z: FloatArray,
    y: FloatArray,
    weights: FloatArray,
    prior: Prior,
    n_draws: int,
    rng: np.random.Generator,
    effects: int = 0,
) -> tuple[FloatArray, FloatArray, FloatArray, dict[str, float]]:
    """See `student_draws`; the last coefficients are ``effects``, whose ratio to sigma is the third array."""
    n, p = Z.shape
    start = posterior(Z, y, weights, prior)
    # As seen from the least-squares fit and in its own units: normal equations in u then lose no digits.
    X, y = Z @ start.factor, y - Z @ start.mean
    given = prior or NormalInverseGamma(np.zeros(p), np.zeros((p, p)), 0.0, 0.0)
    rank = int(np.linalg.matrix_rank(given.Lambda0, hermitian=True))
    shape = given.a0 + 0.5 * (n + rank - p)
    # The scores as a last column: one Cholesky factor of the sums of products holds the fit and its residual too.
    XY = np.column_stack([X, y])
    outer = (XY[:, :, None] * XY[:, None, :]).reshape(n, (p + 1) ** 2)
    root = np.column_stack([start.factor, given.m0 - start.mean])
    plain = np.arange(p) < p - effects
    own, of_effects = (root.T @ (given.Lambda0 * np.outer(kept, kept)) @ root for kept in (plain, ~plain))
    precision = scale = np.ones(_CHAINS)
    likely = likely_weights(X, y, weights, student_share)
    share = np.repeat((likely / weights)[None, :], _CHAINS, axis=0)
    sweeps = max(-(-n_draws // _CHAINS), _LEAST_SWEEPS)
    u, (sigmas, ratios) = np.empty((sweeps, _CHAINS, p)), np.empty((2, sweeps, _CHAINS))
    for sweep in range(-_WARM_UP, sweeps):
        A = ((share * weights) @ outer).reshape(_CHAINS, p + 1, p + 1) + own
        A += precision[:, None, None] * of_effects
        total = A[:, p, p].copy()
        A[:, p, p] += total + 1.0  # what is left of the scores may be nothing, which a Cholesky factor cannot hold
        try:
            L = np.linalg.cholesky(A)
        except np.linalg.LinAlgError:
            far = int(np.argmax(np.abs(y)))
            message = f"the score of run {far + 1} (counted from 1) lies too far from the others for Student-t errors"
            raise FitError(message, "void it or correct it") from None
        half = L[:, p, :p]
        rss = total - np.sum(half**2, axis=1)
        sigma = np.sqrt((given.b0 + 0.5 * np.maximum(rss, 1e-300)) / rng.gamma(shape, size=_CHAINS))
        at = _solved_upwards(L, half + sigma[:, None] * rng.standard_normal((_CHAINS, p)))
        with np.errstate(over="ignore"):  # a run of no weight; where all have none, the next factor is refused
            square = weights * (y - at @ X.T) ** 2 / sigma[:, None] ** 2
        share = rng.standard_gamma(0.5 * (STUDENT_DF + 1.0), square.shape) * (2.0 / (STUDENT_DF + square))
        if effects:
            size = np.sum(np.square(start.mean[~plain] + at @ start.factor[~plain].T), axis=1) / sigma**2
            precision = rng.gamma(0.5 * (effects + 1.0), size=_CHAINS) / (0.5 * size + scale)
            scale = rng.gamma(1.0, size=_CHAINS) / (1.0 + precision)
        if sweep >= 0:
            u[sweep], sigmas[sweep], ratios[sweep] = at, sigma, 1.0 / np.sqrt(precision)
    beta = start.mean + u @ start.factor.T
    # Column by column of what is known: coefficients that hardly differ from their mean have lost their digits.
    scales = np.log(sigmas), np.log(np.hypot(1.0, ratios) * sigmas)
    known = np.concatenate([(u @ start.factor.T)[..., plain], np.stack(scales[: 1 + bool(effects)], axis=-1)], axis=2)
    within = np.mean(np.var(known, axis=0, ddof=1), axis=0)
    between = np.var(np.mean(known, axis=0), axis=0, ddof=1)
    r_hat = float(np.sqrt(np.max((sweeps - 1.0) / sweeps + between / np.maximum(within, 1e-300))))
    order = rng.permutation(sweeps * _CHAINS)
    reached = {
        "steps": sweeps,
        "ess": min(ess(one.T) for one in np.moveaxis(known, 2, 0)),
        "ess_ends": min(ess_tail(one.T, _ENDS) for one in np.moveaxis(known, 2, 0)),
        "r_hat": r_hat,
    }
    return beta.reshape(-1, p)[order], sigmas.ravel()[order], ratios.ravel()[order], reached


def _solved_upwards(L: FloatArray, right: FloatArray) -> FloatArray:
    """Solutions (m, p) of ``L' x = right``, of the first p rows and columns of lower triangles (m, > p, > p)."""
    x = right.copy()
    for i in range(right.shape[1] - 1, -1, -1):
        x[:, i] -= np.einsum("cj,cj->c", L[:, i + 1 : right.shape[1], i], x[:, i + 1 :])
        x[:, i] /= L[:, i, i]
    return x
