"""A surface that need not be a quadratic: a Gaussian process about a shrunk quadratic, averaged over what is not known.

``score(x) = c + z(u)'b + f(u) + nuisance + noise``, where each numeric factor's axis may be bent: u = `bent` (x). The
coefficients b are normal about 0 with one free scale, with the products of categories and squares that the quadratic
model has not; f is a Matern 5/2 process with a length of its own for each numeric factor and one correlation between
the levels of categories. Bends, scales, lengths and noise have priors, in units of the scores' scatter and of the
region, and are sampled with emcee: nothing rests on one best guess of them.

References
----------
Rasmussen & Williams (2006), Gaussian processes for machine learning, 2.7, 5.1; Snoek et al. (2014), Input warping for
Bayesian optimization of non-stationary functions, ICML; Foreman-Mackey et al. (2013), emcee: the MCMC hammer, PASP 125,
306-312.
"""

from __future__ import annotations

import itertools
from collections.abc import Callable, Iterator
from dataclasses import dataclass, fields

import numpy as np
from scipy.linalg import cho_solve, solve_triangular
from scipy.linalg.lapack import dpotrf, dtrtrs
from scipy.special import gammaln, logsumexp

from seqrsm.arrays import FloatArray, IntArray
from seqrsm.design.factors import CategoricalFactor
from seqrsm.design.quadratic import QuadraticModel

LEAST_RUNS = 8
MOST_RUNS = 250
"""Above it a look would take many seconds: every likelihood costs the cube of the runs."""

_VAGUE = 100.0  # prior variance of constants and nuisance effects, in units of the scores' variance
_JITTER = 1e-9
_PRIOR = {"trend": (0.5, 1.0), "process": (0.6, 1.0), "noise": (0.2, 1.2), "length": (1.2, 0.9)}
"""Medians, and standard deviations of the logarithm: of coefficients, process and noise in units of the scores'
scatter; lengths in units of a factor's half-range."""
_BETWEEN = (0.0, 1.2)  # mean and standard deviation of the logit of the correlation between two levels
_BEND = (0.0, 0.7)  # mean and standard deviation of an axis's bend
_WALKERS, _STEPS, _KEPT = 32, 100, 20
_MANY_RUNS, _FEWER_STEPS = 100, 30  # above so many runs
_POOL = 200  # draws of the prior, the best of which the walkers start from
_IMPORTANCE_DRAWS = 1024
_FEATURES = 1000
_CACHED = 2**16  # numbers that stay in the processor's cache


@dataclass(frozen=True, slots=True)
class Hyper:
    """Draws of what the process rests on, in units of the scores' scatter; a row, or an entry, a draw.

    Attributes
    ----------
    trend, process, noise : ndarray (d,)
        Standard deviations of coefficients, of the process and of a run of weight 1.
    between : ndarray (d,)
        Correlation of the process between two levels of a category, 1 without categories.
    lengths, bends : ndarray (d, q)
        Of each numeric factor: on the bent axis (see `bent`) the process does not depend on one whose length is far
        above 2; a bend of 0 leaves the axis as it is.
    """

    trend: FloatArray
    process: FloatArray
    noise: FloatArray
    between: FloatArray
    lengths: FloatArray
    bends: FloatArray

    @classmethod
    def of(cls, theta: FloatArray, n_numeric: int, categories: bool) -> Hyper:
        """From rows (d, h) as they are sampled: logarithms, bends last, before the lengths a logit of ``between``."""
        trend, process, noise = np.exp(theta[:, :3]).T
        between = 1.0 / (1.0 + np.exp(-theta[:, 3])) if categories else np.ones(len(theta))
        lengths, bends = theta[:, 3 + categories :][:, :n_numeric], theta[:, 3 + categories + n_numeric :]
        return cls(trend, process, noise, between, np.exp(lengths), bends)

    def some(self, which: slice) -> Hyper:
        """The draws in these places."""
        return Hyper(*(getattr(self, f.name)[which] for f in fields(self)))


@dataclass(frozen=True, slots=True)
class _Places:
    """Points under each draw: bent coordinates in lengths (d, m, q), columns of the trend times its scale (t, d, m)."""

    scaled: FloatArray
    columns: FloatArray
    levels: FloatArray

    @property
    def rows(self) -> FloatArray:
        """The trend by points, (d, m, t)."""
        return np.moveaxis(self.columns, 0, -1)

    def some(self, which: slice) -> _Places:
        """The same under the draws in these places."""
        return _Places(self.scaled[which], self.columns[:, which], self.levels)


def bent(x: FloatArray, bends: FloatArray) -> FloatArray:
    """Coordinates ``(exp(b x) - cosh b) / sinh b``: -1 and 1 stay, gains that level off become straight lines.

    What Box and Tidwell (1962, Transformation of the independent variables, Technometrics 4, 531-550) do with powers.
    """
    small = np.abs(bends) < 1e-4
    b = np.where(small, 1.0, bends)
    found: FloatArray = np.where(small, x + 0.5 * bends * (x**2 - 1.0), (np.exp(b * x) - np.cosh(b)) / np.sinh(b))
    return found


def _in_cache(n: int, size: int) -> Iterator[slice]:
    """Parts of ``n`` matrices of so many elements each."""
    together = max(_CACHED // size, 1)
    return (slice(first, first + together) for first in range(0, n, together))


def trend_columns(model: QuadraticModel) -> IntArray:
    """Base columns (t, 3) whose product each term is: all terms but the intercept, and contrasts times squares."""
    found = [(a, b, 0) for a, b in zip(model.first[1:], model.second[1:], strict=True)]
    if model.order == 2 and model.categorical:
        q = len(model.numeric)
        contrasts = range(1 + q, model.columns[model.categorical[-1]].stop)
        found += [(contrast, j, j) for contrast in contrasts for j in range(1, 1 + q)]
    return np.array(found, dtype=np.int64)


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
        Of the 1024 that the evidence was estimated by.
    """

    def __init__(
        self,
        model: QuadraticModel,
        points: FloatArray,
        y: FloatArray,
        weights: FloatArray,
        nuisance: FloatArray,
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
        rng : numpy.random.Generator
        """
        n = len(y)
        self.model, self._points = model, np.asarray(points, dtype=np.float64)
        self.centre, self.scatter = float(np.mean(y)), float(np.std(y))
        self._y = (y - self.centre) / self.scatter
        self._inverse_weights = 1.0 / np.asarray(weights, dtype=np.float64)
        constants = np.hstack([np.ones((n, 1)), nuisance])
        self._vague = _VAGUE * constants @ constants.T
        self._columns = trend_columns(model)
        self._base, self._levels = model.base(self._points), self._points[:, list(model.categorical)]
        self._prior = self._log_prior()
        chain = self._sample(rng)
        self._keep(chain[rng.integers(len(chain), size=_KEPT)])
        evidence, self.effective_draws = self._log_evidence(chain, rng)
        self.log_bayes_factor = evidence - self._log_evidence_of_quadratic()

    def means(self, points: FloatArray) -> FloatArray:
        """Mean (d, m) of the surface at coded points (m, k) for each draw, score units."""
        at, own, h = self._places(self.hyper, points), self._own, self.hyper
        sums = np.empty((len(self._alpha), len(points)))
        for some in _in_cache(len(sums), len(points) * len(self._y)):
            cross = self._of_process(h.some(some), at.some(some), own.some(some))
            sums[some] = (cross @ self._alpha[some, :, None])[..., 0]
        slopes = np.einsum("dnt,dn->dt", own.rows, self._alpha)
        sums += np.einsum("dmt,dt->dm", at.rows, slopes) + _VAGUE * np.sum(self._alpha, axis=1)[:, None]
        found: FloatArray = self.centre + self.scatter * sums
        return found

    def mean(self, points: FloatArray) -> FloatArray:
        """Mean (m,) of the surface at coded points (m, k), score units."""
        return np.asarray(np.mean(self.means(points), axis=0))

    def means_of(self, scores: FloatArray, points: FloatArray) -> FloatArray:
        """Means (b, m) of the surface at coded points (m, k) if the runs had these scores (b, n), score units.

        What the process rests on stays as it is.
        """
        cross = self._covariance(self.hyper, self._places(self.hyper, points), self._own)
        y = (scores - self.centre) / self.scatter
        sums = np.zeros((len(scores), len(points)))
        for factor, row in zip(self._factors, cross, strict=True):
            sums += cho_solve((factor, True), y.T, check_finite=False).T @ row.T
        found: FloatArray = self.centre + self.scatter * sums / len(cross)
        return found

    def joint(self, points: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Means (d, m) and covariances (d, m, m) of the surface at coded points (m, k), score units."""
        at = self._places(self.hyper, points)
        cross, covariance = self._covariance(self.hyper, at, self._own), self._covariance(self.hyper, at, at)
        for d, half in enumerate(self._halves(cross)):
            covariance[d] -= half.T @ half
        return self._means(cross), self.scatter**2 * covariance

    def marginals(self, points: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Means and variances (d, m) of the surface at coded points (m, k), score units."""
        at = self._places(self.hyper, points)
        cross = self._covariance(self.hyper, at, self._own)
        variances = np.sum(at.rows**2, axis=-1) + np.square(self.hyper.process)[:, None] + _VAGUE
        for d, half in enumerate(self._halves(cross)):
            variances[d] -= np.sum(half**2, axis=0)
        return self._means(cross), self.scatter**2 * np.maximum(variances, 0.0)

    def draw(self, rng: np.random.Generator) -> tuple[Callable[[FloatArray], FloatArray], float]:
        """One draw of the surface, a function of points (m, k), and the standard deviation of a run of weight 1.

        A draw of the process without scores, from random features, is moved by what the scores say (Wilson et al. 2020,
        Efficiently sampling functions from Gaussian process posteriors, ICML).
        """
        d = int(rng.integers(len(self.hyper.noise)))
        h = self.hyper.some(slice(d, d + 1))
        # The spectrum of a Matern 5/2 covariance is Student's distribution with 5 degrees of freedom.
        waves = rng.standard_normal((_FEATURES, h.lengths.shape[1]))
        waves /= np.sqrt(rng.chisquare(5.0, (_FEATURES, 1)) / 5.0)
        phases = rng.uniform(0.0, 2.0 * np.pi, _FEATURES)
        sizes = [len(f.levels) for f in self.model.factors if isinstance(f, CategoricalFactor)]
        levels = np.array(list(itertools.product(*(range(size) for size in sizes))), dtype=np.float64)
        apart = np.sum(levels[:, None] != levels[None, :], axis=-1)
        factor = np.linalg.cholesky(h.between**apart + _JITTER * np.eye(len(levels)))
        heights = factor @ rng.standard_normal((len(levels), _FEATURES)) * h.process * np.sqrt(2.0 / _FEATURES)
        slopes, middle = rng.standard_normal(len(self._columns)), np.sqrt(_VAGUE) * rng.standard_normal()

        def before(at: _Places) -> FloatArray:
            which = np.argmin(np.sum(at.levels[:, None] != levels[None], axis=-1), axis=1)
            found: FloatArray = np.sum(np.cos(at.scaled[0] @ waves.T + phases) * heights[which], axis=1)
            return np.asarray(found + at.rows[0] @ slopes + middle)

        own = self._places(h, self._points)
        V = self._of_scores(h, own)[0]
        # What scores have beyond the surface.
        others = self._vague - _VAGUE + np.diag(np.square(h.noise) * self._inverse_weights + _JITTER)
        error = np.linalg.cholesky(others) @ rng.standard_normal(len(V))
        pull = np.linalg.solve(V, self._y - before(own) - error)

        def surface(points: FloatArray) -> FloatArray:
            at = self._places(h, points)
            return np.asarray(self.centre + self.scatter * (before(at) + self._covariance(h, at, own)[0] @ pull))

        return surface, float(self.scatter * h.noise[0])

    @property
    def noise_variance(self) -> FloatArray:
        """Variance (d,) of a run of weight 1 for each draw, score units."""
        return np.asarray(np.square(self.scatter * self.hyper.noise))

    def _means(self, cross: FloatArray) -> FloatArray:
        found: FloatArray = self.centre + self.scatter * np.einsum("dmn,dn->dm", cross, self._alpha)
        return found

    def _halves(self, cross: FloatArray) -> Iterator[FloatArray]:
        """For each draw the root (n, m) of what the scores take off the variances at the points of ``cross``."""
        for factor, row in zip(self._factors, cross, strict=True):
            yield solve_triangular(factor, row.T, lower=True, check_finite=False)

    def _places(self, h: Hyper, points: FloatArray) -> _Places:
        return self._bent_places(h, self.model.base(points), points[:, list(self.model.categorical)])

    def _bent_places(self, h: Hyper, base: FloatArray, levels: FloatArray) -> _Places:
        """Of points with base columns (m, b)."""
        numeric = slice(1, 1 + len(self.model.numeric))
        columns = np.repeat(base.T[:, None], len(h.trend), axis=1)  # (b, d, m): whole columns are taken faster
        columns[numeric] = bent(columns[numeric], h.bends.T[..., None])
        first, second, third = self._columns.T
        products = h.trend[:, None] * columns[first]
        products *= columns[second]
        products *= columns[third]
        scaled = columns[numeric] / h.lengths.T[..., None]
        return _Places(np.moveaxis(scaled, 0, -1).copy(), products, levels)

    def _covariance(self, h: Hyper, a: _Places, b: _Places) -> FloatArray:
        """Of the surface (d, m, n)."""
        k = self._of_process(h, a, b)
        k += a.rows @ np.swapaxes(b.rows, 1, 2)
        k += _VAGUE
        return k

    def _of_process(self, h: Hyper, a: _Places, b: _Places) -> FloatArray:
        """Covariance (d, m, n) of the process alone."""
        # One product gives 5 |a - b|^2; the rest is done in place, for most of the time goes into memory.
        of_a, of_b = (5.0 * np.sum(at.scaled**2, axis=-1, keepdims=True) for at in (a, b))
        left = np.concatenate([-10.0 * a.scaled, of_a, np.ones_like(of_a)], axis=-1)
        right = np.concatenate([b.scaled, np.ones_like(of_b), of_b], axis=-1)
        r = left @ np.swapaxes(right, 1, 2)
        np.sqrt(np.maximum(r, 0.0, out=r), out=r)
        k: FloatArray = r / 3.0
        k += 1.0
        k *= r
        k += 1.0
        np.negative(r, out=r)
        k *= np.exp(r, out=r)
        apart, most = np.sum(a.levels[:, None] != b.levels[None, :], axis=-1), a.levels.shape[1]
        scales = np.square(h.process)[:, None] * h.between[:, None] ** np.arange(1 + most)
        k *= (scales @ (apart.ravel() == np.arange(1 + most)[:, None])).reshape(k.shape)
        return k

    def _of_scores(self, h: Hyper, own: _Places) -> FloatArray:
        """Covariance (d, n, n) of the scores."""
        V = self._covariance(h, own, own)
        V += self._vague - _VAGUE
        diagonal = np.arange(len(self._y))
        V[:, diagonal, diagonal] += np.square(h.noise)[:, None] * self._inverse_weights + _JITTER
        return V

    def _log_likelihood(self, theta: FloatArray) -> FloatArray:
        """Of rows (d, h), without its constant; -inf where rounding leaves no positive matrix."""
        found = np.empty(len(theta))
        for some in _in_cache(len(theta), len(self._y) ** 2):
            h = Hyper.of(theta[some], len(self.model.numeric), bool(self.model.categorical))
            for d, V in enumerate(self._of_scores(h, self._bent_places(h, self._base, self._levels)), some.start):
                root, failed = dpotrf(V.T, overwrite_a=True, clean=False)
                solved, _ = dtrtrs(root, self._y, trans=1)
                found[d] = -np.inf if failed else -np.log(root.diagonal()).sum() - 0.5 * solved @ solved
        return found

    def _log_prior(self) -> tuple[FloatArray, FloatArray]:
        """Mean and standard deviation (h,) of the sampled coordinates."""
        names = ["trend", "process", "noise"]
        rows = [(np.log(_PRIOR[name][0]), _PRIOR[name][1]) for name in names]
        rows += [_BETWEEN] * bool(self.model.categorical)
        rows += [(np.log(_PRIOR["length"][0]), _PRIOR["length"][1])] * len(self.model.numeric)
        rows += [_BEND] * len(self.model.numeric)
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
        """Draws (m, h)."""
        from seqrsm.fit.ensemble import short_chain  # emcee: only where there is a process

        mean, sd = self._prior
        walkers = max(_WALKERS, 2 * len(mean))
        pool = mean + sd * np.clip(rng.standard_normal((_POOL, len(mean))), -3.0, 3.0)
        start = pool[np.argsort(-self._log_posterior(pool), kind="stable")[:walkers]]
        start = start + 0.05 * rng.standard_normal(start.shape)
        return short_chain(self._log_posterior, start, _STEPS if len(self._y) <= _MANY_RUNS else _FEWER_STEPS, rng)

    def _keep(self, theta: FloatArray) -> None:
        """Condition on the scores under these hyperparameters (d, h)."""
        self.hyper = Hyper.of(theta, len(self.model.numeric), bool(self.model.categorical))
        self._own = self._places(self.hyper, self._points)
        V = self._of_scores(self.hyper, self._own)
        self._factors = np.linalg.cholesky(V)
        self._alpha = np.linalg.solve(V, np.broadcast_to(self._y[:, None], (len(V), len(self._y), 1)))[..., 0]

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
