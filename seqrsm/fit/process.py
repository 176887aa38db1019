"""A surface that need not be a quadratic: a Gaussian process about a shrunk quadratic, averaged over what is not known.

``score(x) = c + z(x)'b + f(x) + nuisance + noise``. The coefficients b are normal about 0 with one free scale, with the
products of categories and squares that the quadratic model has not; f is a Matern 5/2 process with a length of its own
for each numeric factor and one correlation between the levels of categories; the noise may grow where scores are
poorer. The scale of b, the process and the noise have priors in units of the scores' scatter, and are sampled with
emcee: nothing rests on one best guess of them.

References
----------
Rasmussen & Williams (2006), Gaussian processes for machine learning, 2.7, 5.1; Foreman-Mackey et al. (2013), emcee: the
MCMC hammer, PASP 125, 306-312.
"""

from __future__ import annotations

import itertools
from collections.abc import Callable
from dataclasses import dataclass, fields

import numpy as np
from scipy.linalg import solve_triangular
from scipy.special import gammaln, logsumexp

from seqrsm.arrays import FloatArray, IntArray
from seqrsm.design.factors import CategoricalFactor
from seqrsm.design.quadratic import QuadraticModel

LEAST_RUNS = 8
MOST_RUNS = 250
"""Above it a look would take many seconds: every likelihood costs the cube of the runs."""

_VAGUE = 100.0  # prior variance of constants and nuisance effects, in units of the scores' variance
_JITTER = 1e-9
_PRIOR = {"trend": (0.5, 1.0), "process": (0.6, 1.0), "noise": (0.2, 1.2), "growth": (0.3, 1.2), "length": (1.2, 0.9)}
"""Medians, and standard deviations of the logarithm: of coefficients, process and noise in units of the scores'
scatter; growth of the noise per unit of that below the best score; lengths in units of a factor's half-range."""
_BETWEEN = (0.0, 1.2)  # mean and standard deviation of the logit of the correlation between two levels
_WALKERS, _STEPS, _KEPT = 32, 60, 20
_MANY_RUNS, _FEWER_STEPS = 100, 30  # above so many runs
_IMPORTANCE_DRAWS = 512
_FEATURES = 1000


@dataclass(frozen=True, slots=True)
class Hyper:
    """Draws of what the process rests on, in units of the scores' scatter; a row, or an entry, a draw.

    Attributes
    ----------
    trend, process, noise, growth : ndarray (d,)
        Standard deviations of coefficients, of the process and of a run of weight 1 at the best score; growth of the
        noise per unit that the mean falls below the best.
    between : ndarray (d,)
        Correlation of the process between two levels of a category, 1 without categories.
    lengths : ndarray (d, q)
        Of each numeric factor, coded: far above 2 the process does not depend on it.
    """

    trend: FloatArray
    process: FloatArray
    noise: FloatArray
    growth: FloatArray
    between: FloatArray
    lengths: FloatArray

    @classmethod
    def of(cls, theta: FloatArray, categories: bool) -> Hyper:
        """From rows (d, h) of logarithms, the logit of ``between`` in the fifth place where there are categories."""
        trend, process, noise, growth = np.exp(theta[:, :4]).T
        between = 1.0 / (1.0 + np.exp(-theta[:, 4])) if categories else np.ones(len(theta))
        return cls(trend, process, noise, growth, between, np.exp(theta[:, 4 + categories :]))


def trend_rows(model: QuadraticModel, points: FloatArray) -> FloatArray:
    """Rows (n, t) of the trend: all terms but the intercept, and products of contrasts with squares."""
    rows = model.matrix(points)[:, 1:]
    if model.order == 1 or not model.categorical:
        return rows
    base = model.base(points)
    squares, contrasts = base[:, 1 : 1 + len(model.numeric)] ** 2, base[:, 1 + len(model.numeric) :]
    return np.hstack([rows, (contrasts[:, :, None] * squares[:, None, :]).reshape(len(rows), -1)])


class Process:
    """Posterior of a process, given scores.

    Attributes
    ----------
    model : QuadraticModel
        Whose terms the trend has.
    hyper : Hyper
        Twenty draws.
    log_bayes_factor : float
        Log evidence for the process, less that for the quadratic with coefficients of the same free scale and equal
        noise: about 0 where the scores do not tell, > 3 where the quadratic is refuted.
    centre, scatter : float
        Mean and standard deviation of the scores, score units.
    effective_draws : float
        Of the 512 that the evidence was estimated by.
    """

    def __init__(
        self,
        model: QuadraticModel,
        points: FloatArray,
        y: FloatArray,
        weights: FloatArray,
        nuisance: FloatArray,
        shared: FloatArray,
        goal_sign: float,
        rng: np.random.Generator,
    ) -> None:
        """Sample.

        Parameters
        ----------
        model : QuadraticModel
            Without selection of terms.
        points : ndarray (n, k)
            Coded settings, ``LEAST_RUNS`` <= n <= ``MOST_RUNS``.
        y : ndarray (n,)
            Scores, not all equal.
        weights : ndarray (n,)
            Relative weights, > 0.
        nuisance : ndarray (n, e)
            Columns of effects that are no part of the surface (blocks); 0 in future runs.
        shared : ndarray (n, r)
            Errors that scores share: their prior standard deviations.
        goal_sign : float
            1 where the score is maximized, -1 where minimized.
        rng : numpy.random.Generator
        """
        n = len(y)
        self.model, self._points = model, np.asarray(points, dtype=np.float64)
        self.centre, self.scatter, self._sign = float(np.mean(y)), float(np.std(y)), goal_sign
        self._y = (y - self.centre) / self.scatter
        self._inverse_weights = 1.0 / np.asarray(weights, dtype=np.float64)
        self._trend = trend_rows(model, self._points)
        constants = np.hstack([np.ones((n, 1)), nuisance])
        self._vague = _VAGUE * constants @ constants.T + shared @ shared.T / self.scatter**2
        self._gram = self._trend @ self._trend.T
        self._squares, self._others = self._apart(self._points, self._points, np.tril_indices(n, -1))
        self._gap = np.zeros(n)
        chain = self._sample(rng)
        self._keep(chain[rng.integers(len(chain), size=_KEPT)])
        evidence, self.effective_draws = self._log_evidence(chain, rng)
        self.log_bayes_factor = evidence - self._log_evidence_of_quadratic()

    def means(self, points: FloatArray) -> FloatArray:
        """Mean (d, m) of the surface at coded points (m, k) for each draw, score units."""
        trend = trend_rows(self.model, points)
        cross = self._covariance(points, trend, self._points, self._trend)
        found: FloatArray = self.centre + self.scatter * np.einsum("dmn,dn->dm", cross, self._alpha)
        return found

    def mean(self, points: FloatArray) -> FloatArray:
        """Mean (m,) of the surface at coded points (m, k), score units."""
        return np.asarray(np.mean(self.means(points), axis=0))

    def joint(self, points: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Means (d, m) and covariances (d, m, m) of the surface at coded points (m, k), score units."""
        trend = trend_rows(self.model, points)
        cross = self._covariance(points, trend, self._points, self._trend)
        covariance = self._covariance(points, trend, points, trend)
        for d, factor in enumerate(self._factors):
            half = solve_triangular(factor, cross[d].T, lower=True, check_finite=False)
            covariance[d] -= half.T @ half
        means = self.centre + self.scatter * np.einsum("dmn,dn->dm", cross, self._alpha)
        return means, self.scatter**2 * covariance

    def marginals(self, points: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Means and variances (d, m) of the surface at coded points (m, k), score units."""
        trend = trend_rows(self.model, points)
        cross = self._covariance(points, trend, self._points, self._trend)
        means = self.centre + self.scatter * np.einsum("dmn,dn->dm", cross, self._alpha)
        h = self.hyper
        own = np.square(h.trend)[:, None] * np.sum(trend**2, axis=1) + np.square(h.process)[:, None] + _VAGUE
        for d, factor in enumerate(self._factors):
            half = solve_triangular(factor, cross[d].T, lower=True, check_finite=False)
            own[d] -= np.sum(half**2, axis=0)
        return means, self.scatter**2 * np.maximum(own, 0.0)

    def draw(
        self, rng: np.random.Generator
    ) -> tuple[Callable[[FloatArray], FloatArray], Callable[[FloatArray], FloatArray]]:
        """One draw of the surface, and the standard deviation of a run of weight 1: functions of points (m, k).

        A draw of the process without scores, from random features, is moved by what the scores say (Wilson et al. 2020,
        Efficiently sampling functions from Gaussian process posteriors, ICML).
        """
        d = int(rng.integers(len(self.hyper.noise)))
        h = Hyper(*(getattr(self.hyper, f.name)[d : d + 1] for f in fields(Hyper)))
        numeric, categorical = list(self.model.numeric), list(self.model.categorical)
        # The spectrum of a Matern 5/2 covariance is Student's distribution with 5 degrees of freedom.
        waves = rng.standard_normal((_FEATURES, len(numeric))) / np.sqrt(rng.chisquare(5.0, (_FEATURES, 1)) / 5.0)
        waves, phases = waves / h.lengths, rng.uniform(0.0, 2.0 * np.pi, _FEATURES)
        sizes = [len(f.levels) for f in self.model.factors if isinstance(f, CategoricalFactor)]
        levels = np.array(list(itertools.product(*(range(size) for size in sizes))), dtype=np.float64)
        apart = np.sum(levels[:, None] != levels[None, :], axis=-1)
        factor = np.linalg.cholesky(h.between**apart + _JITTER * np.eye(len(levels)))
        heights = factor @ rng.standard_normal((len(levels), _FEATURES)) * h.process * np.sqrt(2.0 / _FEATURES)
        slopes = h.trend * rng.standard_normal(self._trend.shape[1])
        middle = np.sqrt(_VAGUE) * rng.standard_normal()

        def before(points: FloatArray) -> FloatArray:
            which = np.argmin(np.sum(points[:, None, categorical] != levels[None], axis=-1), axis=1)
            features = np.cos(points[:, numeric] @ waves.T + phases)
            found: FloatArray = np.sum(features * heights[which], axis=1) + trend_rows(self.model, points) @ slopes
            return np.asarray(found + middle)

        own = np.arange(len(self._y))
        noise = np.square(h.noise) * (1.0 + np.square(h.growth * self._gap)) * self._inverse_weights
        V = self._of_scores(h)[0]
        others = self._vague - _VAGUE + np.diag(noise)  # what scores have beyond the surface
        error = np.linalg.cholesky(others + _JITTER * np.eye(len(own))) @ rng.standard_normal(len(own))
        pull = np.linalg.solve(V, self._y - before(self._points) - error)

        def surface(points: FloatArray) -> FloatArray:
            cross = self._matern(h, *self._apart(points, self._points))[0]
            cross += h.trend**2 * (trend_rows(self.model, points) @ self._trend.T) + _VAGUE
            return np.asarray(self.centre + self.scatter * (before(points) + cross @ pull))

        def scatter(points: FloatArray) -> FloatArray:
            gap = np.maximum(self._best - self._sign * surface(points), 0.0) / self.scatter
            return np.asarray(self.scatter * h.noise * np.sqrt(1.0 + np.square(h.growth * gap)))

        return surface, scatter

    def noise_variance(self, means: FloatArray) -> FloatArray:
        """Variance (d, m) of a run of weight 1 where the surface has these means (d, m), score units."""
        gap = np.maximum(self._best - self._sign * means, 0.0) / self.scatter
        h = self.hyper
        found: FloatArray = (self.scatter * h.noise[:, None]) ** 2 * (1.0 + (h.growth[:, None] * gap) ** 2)
        return found

    def _apart(
        self, a: FloatArray, b: FloatArray, pairs: tuple[IntArray, IntArray] | None = None
    ) -> tuple[FloatArray, FloatArray]:
        """Squared distances (..., q) in each numeric factor, and numbers (...) of categories that differ."""
        left, right = (a[:, None], b[None, :]) if pairs is None else (a[pairs[0]], b[pairs[1]])
        numeric, categorical = list(self.model.numeric), list(self.model.categorical)
        others = np.sum(left[..., categorical] != right[..., categorical], axis=-1)
        return np.square(left[..., numeric] - right[..., numeric]), others.astype(np.float64)

    def _matern(self, h: Hyper, squares: FloatArray, others: FloatArray) -> FloatArray:
        """Covariance (d, ...) of the process between pairs."""
        r = np.sqrt(5.0 * np.tensordot(1.0 / h.lengths**2, squares, axes=(1, squares.ndim - 1)))
        shape = (-1,) + (1,) * others.ndim
        k = np.exp(-r)
        k *= 1.0 + r * (1.0 + r / 3.0)
        k *= np.square(h.process).reshape(shape)
        if self.model.categorical:
            k *= h.between.reshape(shape) ** others
        return k

    def _covariance(self, a: FloatArray, trend_a: FloatArray, b: FloatArray, trend_b: FloatArray) -> FloatArray:
        found = self._matern(self.hyper, *self._apart(np.atleast_2d(a), np.atleast_2d(b)))
        found += np.square(self.hyper.trend)[:, None, None] * (trend_a @ trend_b.T) + _VAGUE
        return found

    def _of_scores(self, h: Hyper) -> FloatArray:
        """Covariance (d, n, n) of the scores."""
        n, d = len(self._y), len(h.noise)
        V = np.empty((d, n, n))
        V[:] = np.square(h.trend)[:, None, None] * self._gram + self._vague
        k = self._matern(h, self._squares, self._others)
        i, j = np.tril_indices(n, -1)
        V[:, i, j] += k
        V[:, j, i] += k
        own = np.arange(n)
        noise = np.square(h.noise)[:, None] * (1.0 + np.square(h.growth[:, None] * self._gap)) * self._inverse_weights
        V[:, own, own] += np.square(h.process)[:, None] + noise + _JITTER
        return V

    def _log_likelihood(self, theta: FloatArray) -> FloatArray:
        """Of rows (d, h)."""
        from seqrsm.fit.kernels import log_likelihoods  # numba: only where there is a process

        h = Hyper.of(theta, bool(self.model.categorical))
        scales = np.column_stack([h.trend, h.process, h.noise, h.growth, h.between, h.lengths])
        found: FloatArray = log_likelihoods(
            scales, self._squares, self._others, self._gram, self._vague, self._y, self._gap, self._inverse_weights
        )
        return found

    @property
    def _prior(self) -> tuple[FloatArray, FloatArray]:
        """Mean and standard deviation (h,) of the sampled coordinates."""
        names = ["trend", "process", "noise", "growth"]
        rows = [(np.log(_PRIOR[name][0]), _PRIOR[name][1]) for name in names]
        rows += [_BETWEEN] * bool(self.model.categorical)
        rows += [(np.log(_PRIOR["length"][0]), _PRIOR["length"][1])] * len(self.model.numeric)
        mean, sd = np.array(rows).T
        return mean, sd

    def _log_posterior(self, theta: FloatArray) -> FloatArray:
        """Of rows (d, h), up to the constant of the prior."""
        mean, sd = self._prior
        z = (theta - mean) / sd
        found = np.full(len(theta), -np.inf)
        inside = np.all(np.abs(z) < 5.0, axis=1)
        if inside.any():
            found[inside] = self._log_likelihood(theta[inside]) - 0.5 * np.sum(z[inside] ** 2, axis=1)
        return found

    def _sample(self, rng: np.random.Generator) -> FloatArray:
        """Draws (m, h): first with equal noise, then with the gap to the best score that these show."""
        from seqrsm.fit.ensemble import short_chain  # emcee: only where there is a process

        mean, sd = self._prior
        seen, chain = np.empty((0, len(mean))), np.empty((0, len(mean)))
        last = _STEPS if len(self._y) <= _MANY_RUNS else _FEWER_STEPS
        for steps in (last // 2, last):
            pool = mean + sd * np.clip(rng.standard_normal((200, len(mean))), -3.0, 3.0)
            start = pool[np.argsort(-self._log_posterior(pool), kind="stable")[:_WALKERS]]
            if len(seen):
                start[: _WALKERS // 2] = seen[: _WALKERS // 2]
            start = start + 0.05 * rng.standard_normal(start.shape)
            chain, seen = short_chain(self._log_posterior, start, steps, rng)
            if steps < last:
                self._keep(seen[:8])
                h = self.hyper
                noise = np.square(h.noise)[:, None] * self._inverse_weights
                fitted = np.mean(self._y - noise * self._alpha, axis=0)
                self._gap = np.maximum(np.max(self._sign * fitted) - self._sign * fitted, 0.0)
        return chain

    def _keep(self, theta: FloatArray) -> None:
        """Condition on the scores under these hyperparameters (d, h)."""
        self.hyper = Hyper.of(theta, bool(self.model.categorical))
        V = self._of_scores(self.hyper)
        self._factors = np.linalg.cholesky(V)
        self._alpha = np.linalg.solve(V, np.broadcast_to(self._y[:, None], (len(V), len(self._y), 1)))[..., 0]
        self._best = -np.inf
        self._best = float(np.max(self._sign * self.mean(self._points)))

    def _log_evidence(self, chain: FloatArray, rng: np.random.Generator) -> tuple[float, float]:
        """By importance sampling from a Student-t distribution fitted to the chain; and its effective draws."""
        n, h, df = _IMPORTANCE_DRAWS, chain.shape[1], 6.0
        factor = np.linalg.cholesky(1.3 * np.cov(chain.T) + 1e-4 * np.eye(h))
        wide = rng.standard_normal((n, h)) / np.sqrt(rng.chisquare(df, (n, 1)) / df)
        of_proposal = (
            float(gammaln(0.5 * (df + h)) - gammaln(0.5 * df) - 0.5 * h * np.log(df * np.pi))
            - float(np.sum(np.log(np.diag(factor))))
            - 0.5 * (df + h) * np.log1p(np.sum(wide**2, axis=1) / df)
        )
        logs = self._log_posterior(chain.mean(axis=0) + wide @ factor.T) - of_proposal
        constant = -0.5 * h * np.log(2.0 * np.pi) - float(np.sum(np.log(self._prior[1])))
        shares = np.exp(logs - logs.max())
        return float(logsumexp(logs)) - np.log(n) + constant, float(np.sum(shares) ** 2 / np.sum(shares**2))

    def _log_evidence_of_quadratic(self) -> float:
        """Of the model's own terms with coefficients of free scale and equal noise, on a grid of the two scales."""
        rows = self.model.matrix(self._points)[:, 1:]
        root = np.sqrt(1.0 / self._inverse_weights)
        y, square = self._y * root, np.outer(root, root)
        gram, vague = rows @ rows.T * square, self._vague * square
        (trend, sd_trend), (noise, sd_noise) = _PRIOR["trend"], _PRIOR["noise"]
        z = np.linspace(-3.5, 3.5, 25)
        step = z[1] - z[0]
        variances = np.square(noise * np.exp(sd_noise * z))
        logs = np.empty((len(z), len(z)))
        for i, scale in enumerate(trend * np.exp(sd_trend * z)):
            own, vectors = np.linalg.eigh(scale**2 * gram + vague)
            total = np.maximum(own, 0.0)[:, None] + variances + _JITTER
            logs[i] = -0.5 * np.sum(((vectors.T @ y) ** 2)[:, None] / total + np.log(total), axis=0)
        logs += -0.5 * (z[:, None] ** 2 + z**2) - np.log(2.0 * np.pi)
        return float(logsumexp(logs) + 2.0 * np.log(step) + np.sum(np.log(root)))
