"""A surface that need not be a quadratic: a Gaussian process about a shrunk quadratic, averaged over what is not known.

``score(x) = c + z(u)'b + f(u) + block + noise``, where each numeric factor's axis may be bent: u = `bent` (x). The
coefficients b are normal about 0 with one free scale, with the products of categories and squares that the quadratic
model has not; f is a Matern 5/2 process with a length of its own for each numeric factor and one correlation between
the levels of categories; effects of blocks have one free scale. Bends, scales, lengths and noise have priors, in units
of the scores' scatter and of the region, and are drawn by importance: nothing rests on one best guess of them.

Of two sources, the surface is that of one of them; the other's departs from it by ``z(x)'d`` with normal d, and has a
noise of its own (Kennedy & O'Hagan 2001, J. R. Statist. Soc. B 63, 425-464).

References
----------
Rasmussen & Williams (2006), Gaussian processes for machine learning, 2.7, 5.1; Snoek et al. (2014), Input warping for
Bayesian optimization of non-stationary functions, ICML.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable, Iterator
from copy import copy
from dataclasses import dataclass, fields, replace

import numpy as np
from scipy.linalg.lapack import dpotrf, dtrtri
from scipy.special import logsumexp

from seqrsm.arrays import BoolArray, FloatArray, IntArray
from seqrsm.design.factors import CategoricalFactor
from seqrsm.design.quadratic import QuadraticModel
from seqrsm.fit.gather import gathered
from seqrsm.fit.importance import weighted_draws

LEAST_RUNS = 5
MOST_SETTINGS = 250
"""Of more, near ones are `gathered`: every likelihood costs the cube of their number."""

_VAGUE = 100.0  # prior variance of the constant, in units of the scores' variance
_JITTER = 1e-9
_BEYOND = 1e300  # more than any sum of squared scores: keeps a matrix with the scores as its last row positive
_PRIOR = {"trend": (0.5, 1.0), "process": (0.6, 1.0), "noise": (0.2, 1.2), "length": (1.2, 0.9), "block": (0.2, 1.2)}
"""Medians, and standard deviations of the logarithm: of coefficients, process, noise and effects of blocks in units of
the scores' scatter; lengths in units of a factor's half-range, but see `_TAIL`."""
_TAIL = 2.0
"""Of the prior of lengths: above the median, what their logarithm gains with the square of the standard deviations. One
factor of four has a length above 6, one of six above 20: the process hardly depends on it."""
_BETWEEN = (0.0, 1.2)  # mean and standard deviation of the logit of the correlation between two levels
_BEND = (0.0, 0.7)  # mean and standard deviation of an axis's bend
_DIFFERENCE = (0.0, 0.4)  # of the logarithm of what the stated difference between sources is multiplied by
_OWN_NOISE = 0.9  # standard deviation of the logarithm of the own source's noise over the other's
_KEPT, FEW = 100, 20
"""Draws kept, and those of them that do where places are sought."""
_FEATURES = 1000
_CACHED = 2**16  # numbers that stay in the processor's cache


@dataclass(frozen=True, slots=True)
class Sources:
    """Which runs are of the source whose surface is sought, and how far the other's may depart."""

    own: BoolArray
    """(n,)."""
    difference_sd: FloatArray
    """(p,): prior standard deviation of each coefficient of the difference, score units."""
    weight: float
    """Of a run of the own source, where one of the other has 1: what the quadratic is weighed with."""
    ratio: float = 1.0
    """A guess of the variance of a run of the other source over that of one of the own."""


@dataclass(frozen=True, slots=True)
class Blocks:
    """How the scores of blocks differ: by effects that are alike in size."""

    columns: FloatArray
    """(n, e): of the effects in each run."""
    new: bool
    """Future runs are made in a new block; otherwise in the mean one, where the columns are 0."""


@dataclass(frozen=True, slots=True)
class Hyper:
    """Draws of what the process rests on, in units of the scores' scatter; a row, or an entry, a draw."""

    trend: FloatArray
    process: FloatArray
    noise: FloatArray
    """(d,): standard deviations of coefficients, of the process and of a run of weight 1."""
    between: FloatArray
    """(d,): correlation of the process between two levels of a category, 1 without categories."""
    lengths: FloatArray
    bends: FloatArray
    """(d, q): of each numeric factor: on the bent axis (see `bent`) the process does not depend on one whose length is
    far above 2; a bend of 0 leaves the axis as it is."""
    difference: FloatArray
    other_noise: FloatArray
    """(d,): of two sources: what the stated standard deviation of their difference is multiplied by, and the noise of
    the other source; 0 of one."""
    block: FloatArray
    """(d,): standard deviation of the effects of blocks, 0 without blocks."""

    @classmethod
    def of(cls, theta: FloatArray, n_numeric: int, categories: bool, sources: bool, blocks: bool) -> Hyper:
        """From rows (d, h) as they are sampled: logarithms, a logit of ``between`` before lengths, bends after them."""
        trend, process, noise = np.exp(theta[:, :3]).T
        between = 1.0 / (1.0 + np.exp(-theta[:, 3])) if categories else np.ones(len(theta))
        ends = np.cumsum([n_numeric, n_numeric, 2 * sources])
        lengths, bends, of_sources, of_blocks = np.split(theta[:, 3 + categories :], ends, axis=1)
        difference, share = np.exp(of_sources).T if sources else np.zeros((2, len(theta)))
        (block,) = np.exp(of_blocks).T if blocks else np.zeros((1, len(theta)))
        other_noise, noise = (noise, share * noise) if sources else (share, noise)
        median, sd = _PRIOR["length"]
        above = np.maximum(lengths - np.log(median), 0.0) / sd
        lengths = np.exp(lengths + _TAIL * above**2)
        return cls(trend, process, noise, between, lengths, bends, difference, other_noise, block)

    def some(self, which: slice) -> Hyper:
        """The draws in these places."""
        return Hyper(*(getattr(self, f.name)[which] for f in fields(self)))


@dataclass(frozen=True, slots=True)
class _Places:
    """Points under each draw: bent coordinates in lengths (d, m, q), columns of the trend times its scale (t, d, m).

    And rows (m, p) of the difference between sources, each term in units of its standard deviation; without columns
    where there is one source.
    """

    scaled: FloatArray
    columns: FloatArray
    levels: FloatArray
    difference: FloatArray

    @property
    def rows(self) -> FloatArray:
        """The trend by points, (d, m, t)."""
        return self.columns.transpose(1, 2, 0)

    def some(self, which: slice) -> _Places:
        """The same under the draws in these places."""
        return replace(self, scaled=self.scaled[which], columns=self.columns[:, which])


def bent(x: FloatArray, bends: FloatArray) -> FloatArray:
    """Coordinates ``(exp(b x) - cosh b) / sinh b``: -1 and 1 stay, gains that level off become straight lines.

    What Box and Tidwell (1962, Transformation of the independent variables, Technometrics 4, 531-550) do with powers.
    """
    small = np.abs(bends) < 1e-4
    b = np.where(small, 1.0, bends)
    found: FloatArray = (np.exp(b * x) - np.cosh(b)) / np.sinh(b)
    return np.where(small, x + 0.5 * bends * (x**2 - 1.0), found) if small.any() else found


def _squares(a: _Places, b: _Places) -> FloatArray:
    """5 |a - b|^2, (d, m, n), by one product."""
    of_a, of_b = (5.0 * np.einsum("dmq,dmq->dm", at.scaled, at.scaled)[..., None] for at in (a, b))
    left = np.concatenate([-10.0 * a.scaled, of_a, np.ones_like(of_a)], axis=-1)
    right = np.concatenate([b.scaled, np.ones_like(of_b), of_b], axis=-1)
    found: FloatArray = left @ np.swapaxes(right, 1, 2)
    return found


def _bent_places(h: Hyper, terms: IntArray, base: FloatArray, levels: FloatArray, difference: FloatArray) -> _Places:
    """Of points with base columns (m, b), levels, and rows (m, p) of the difference; `trend_columns` of the terms."""
    numeric = slice(1, 1 + h.lengths.shape[1])
    columns = np.repeat(base.T[:, None], len(h.trend), axis=1)  # (b, d, m): whole columns are taken faster
    columns[numeric] = bent(columns[numeric], h.bends.T[..., None])
    first, second, third = terms.T
    products = h.trend[:, None] * columns[first]
    products *= columns[second]
    products *= columns[third]
    scaled = columns[numeric] / h.lengths.T[..., None]
    return _Places(scaled.transpose(1, 2, 0).copy(), products, levels, difference)


def _matern(h: Hyper, squares: FloatArray, apart: IntArray) -> FloatArray:
    """Covariance (d, p) of the process between points by `_squares` and numbers (p,) of categories that differ.

    In place, for most of the time goes into memory; ``squares`` are no more after it.
    """
    k = np.maximum(squares, 0.0, out=squares)
    r = np.sqrt(k)
    k /= 3.0
    k += r
    k += 1.0
    np.negative(r, out=r)
    k *= np.exp(r, out=r)
    by_number = np.square(h.process)[:, None] * h.between[:, None] ** np.arange(1 + apart.max(initial=0))
    k *= by_number.take(apart, axis=1) if by_number.shape[1] > 1 else by_number
    return k


def _apart(a: FloatArray, b: FloatArray) -> IntArray:
    """In how many categories the levels (m, c) and (n, c) of points differ, (m, n)."""
    found = np.zeros((len(a), len(b)), dtype=np.int64)
    for of_a, of_b in zip(a.T, b.T, strict=True):  # a sum over so short an axis takes as long as exp
        found += of_a[:, None] != of_b
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


def kinds(model: QuadraticModel, points: FloatArray, sources: Sources | None, blocks: Blocks | None) -> FloatArray:
    """Levels, blocks and sources (n, j) of runs at coded points: by these, runs near each other are not gathered."""
    found = [points[:, list(model.categorical)]]
    found += [] if blocks is None else [blocks.columns]
    found += [] if sources is None else [sources.own[:, None].astype(np.float64)]
    return np.hstack(found)


def _prior_of(n_numeric: int, categories: bool, ratio: float | None, blocks: bool) -> tuple[FloatArray, FloatArray]:
    """Mean and standard deviation (h,) of the sampled coordinates; ``ratio`` is that of `Sources`."""
    rows = [(np.log(_PRIOR[name][0]), _PRIOR[name][1]) for name in ("trend", "process", "noise")]
    rows += [_BETWEEN] * categories
    rows += [(np.log(_PRIOR["length"][0]), _PRIOR["length"][1])] * n_numeric
    rows += [_BEND] * n_numeric
    if ratio is not None:  # the noise sampled is then that of the other source
        rows += [_DIFFERENCE, (-0.5 * np.log(ratio), _OWN_NOISE)]
    if blocks:
        rows.append((np.log(_PRIOR["block"][0]), _PRIOR["block"][1]))
    mean, sd = np.array(rows).T
    return mean, sd


def prior_covariances(
    model: QuadraticModel, points: FloatArray, n: int, rng: np.random.Generator
) -> Iterator[FloatArray]:
    """Covariances (m, m) of surfaces at coded points (m, k) for ``n`` draws of the prior, without that of the constant.

    In units of the scatter that scores are to have.
    """
    q, categories = len(model.numeric), bool(model.categorical)
    mean, sd = _prior_of(q, categories, None, False)
    base, levels, terms = model.base(points), points[:, list(model.categorical)], trend_columns(model)
    apart, none = _apart(levels, levels), np.empty((len(points), 0))
    for _ in range(n):
        h = Hyper.of((mean + sd * rng.standard_normal(len(mean)))[None, :], q, categories, False, False)
        at = _bent_places(h, terms, base, levels, none)
        k = _matern(h, _squares(at, at).reshape(1, -1), apart.ravel()).reshape(apart.shape)
        yield np.asarray(k + at.rows[0] @ at.rows[0].T)


class Process:
    """Posterior of a process, given scores.

    ``hyper`` are a hundred draws: of twenty, the ends of an interval would depend on one or two. Fewer from 112
    settings on, twenty at the least: the more runs, the less they differ. ``log_bayes_factor`` is the log evidence for
    the process, less that for the quadratic with coefficients of the same free scale and equal noise: about 0 where the
    scores do not tell, > 3 where the quadratic is refuted; so many ``effective_draws`` estimate it. ``centre`` and
    ``scatter`` are mean and standard deviation of the scores, score units; where runs are ``gathered`` near ones count
    as repeats at their middle.
    """

    def __init__(
        self,
        model: QuadraticModel,
        points: FloatArray,
        y: FloatArray,
        weights: FloatArray,
        rng: np.random.Generator,
        sources: Sources | None = None,
        blocks: Blocks | None = None,
    ) -> None:
        """Sample, from scores ``y`` (n,), not all equal, with relative ``weights`` (n,) > 0 at coded ``points`` (n, k).

        There are `LEAST_RUNS` at least, of `MOST_SETTINGS` `kinds` at most; the model is without selection of terms.
        The surface and future runs are of the own one of two ``sources``; ``blocks`` are no part of it.
        """
        self.model, weights = model, np.asarray(weights, dtype=np.float64)
        self.centre, self.scatter = float(np.mean(y)), float(np.std(y))
        # Equal runs at the same settings tell as much as their mean, and their scatter about it: matrices are smaller.
        own = np.ones(len(y), dtype=np.bool_) if sources is None else sources.own
        self._blocks = Blocks(np.empty((len(y), 0)), False) if blocks is None else blocks
        same = np.hstack([points, weights[:, None], kind := kinds(model, points, sources, blocks)])
        _, first, place = np.unique(same, axis=0, return_index=True, return_inverse=True)
        place = place.reshape(-1)  # numpy 2.0 gives it a second axis
        self.gathered = len(first) > MOST_SETTINGS
        if self.gathered:
            pilot = self._pilot(points, y, weights, rng, sources)
            scales = np.mean(1.0 / pilot.hyper.lengths, axis=0)  # how much each factor matters
            guess = pilot.some(FEW).mean
            place, points, y = gathered(model, points, y, weights, kind, guess, scales, MOST_SETTINGS)
            first = np.unique(place, return_index=True)[1]
        self._place, self._runs, total = place, np.bincount(place), np.bincount(place, weights)
        self._points, self._columns_of_blocks = np.asarray(points, dtype=np.float64)[first], self._blocks.columns[first]
        self._inverse_weights = self._runs / total
        self._weights = weights * self._inverse_weights[place]  # over the place's mean: 1 but where runs are gathered
        scores = (y - self.centre) / self.scatter
        self._y = np.bincount(place, weights * scores) / total
        self._squares = np.bincount(place, weights * np.square(scores - self._y[place])) * self._inverse_weights
        n, self._is_own, self._sources = len(first), own[first], sources
        i, j = np.tril_indices(n)
        self._pairs = i * n + j
        self._in_blocks = np.sum(self._columns_of_blocks[i] * self._columns_of_blocks[j], axis=1)
        self._columns = trend_columns(model)
        self._base, self._levels = model.base(self._points), self._points[:, list(model.categorical)]
        self._apart = _apart(self._levels, self._levels)[i, j]
        self._difference = self._of_difference(self._points) * self._is_own[:, None]
        ratio = None if sources is None else sources.ratio
        self._prior = _prior_of(len(model.numeric), bool(model.categorical), ratio, self._blocks.columns.size > 0)
        mean, sd = self._prior
        found = weighted_draws(self._log_posterior, len(mean), rng)
        kept = min(_KEPT // FEW, MOST_SETTINGS**2 // n**2) * FEW
        self._keep(mean + sd * found.some(kept, rng))
        self.effective_draws = found.effective
        self.log_bayes_factor = found.log_evidence - self._log_evidence_of_quadratic()

    def _pilot(
        self, points: FloatArray, y: FloatArray, weights: FloatArray, rng: np.random.Generator, sources: Sources | None
    ) -> Process:
        """The process of at most half of `MOST_SETTINGS` runs."""
        few = np.lexsort(points.T)[:: -(-2 * len(y) // MOST_SETTINGS)]
        few = np.union1d(few, [np.argmin(y), np.argmax(y)])  # scores that are not all equal
        own = None if sources is None else replace(sources, own=sources.own[few])
        blocks = Blocks(self._blocks.columns[few], self._blocks.new)
        return Process(self.model, points[few], y[few], weights[few], rng, own, blocks)

    def some(self, n: int) -> Process:
        """The same with about ``n`` of its draws, evenly spread over all."""
        found, some = copy(self), slice(None, None, max(len(self._alpha) // n, 1))
        found.hyper, found._own = self.hyper.some(some), self._own.some(some)
        found._roots, found._alpha = self._roots[some], self._alpha[some]
        return found

    def means(self, points: FloatArray) -> FloatArray:
        """Mean (d, m) of the surface at coded points (m, k) for each draw, score units."""
        sums = np.empty((len(self._alpha), len(points)))
        for some, h, at, own, apart in self._parts(points):
            alpha = self._alpha[some]
            slopes = np.einsum("dnt,dn->dt", own.rows, alpha)
            sums[some] = (self._of_process(h, at, own, apart) @ alpha[..., None])[..., 0]
            sums[some] += np.einsum("dmt,dt->dm", at.rows, slopes) + _VAGUE * np.sum(alpha, axis=1)[:, None]
            sums[some] += np.square(h.difference)[:, None] * (alpha @ own.difference @ at.difference.T)
        found: FloatArray = self.centre + self.scatter * sums
        return found

    def mean(self, points: FloatArray) -> FloatArray:
        """Mean (m,) of the surface at coded points (m, k), score units."""
        return np.asarray(np.mean(self.means(points), axis=0))

    def pull(self, points: FloatArray) -> FloatArray:
        """By how much each run's score moves the mean of the surface at coded points (m, k): (n, m).

        With other scores (b, n) the means are ``centre + (scores - centre) @ pull``; what the process rests on stays.
        """
        found = np.zeros((len(points), len(self._y)))
        for some, h, at, own, apart in self._parts(points):
            halves, roots = self._covariance(h, at, own, apart) @ self._roots[some], self._roots[some]
            found += np.sum(halves @ np.swapaxes(roots, 1, 2), axis=0)
        share = self._weights / self._runs[self._place] / len(self._alpha)
        return np.asarray(found.T[self._place] * share[:, None])

    def joint(self, points: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Means (d, m) and covariances (d, m, m) of the surface at coded points (m, k), score units."""
        d, m, levels = len(self._alpha), len(points), points[:, list(self.model.categorical)]
        means, covariances, among = np.empty((d, m)), np.empty((d, m, m)), _apart(levels, levels)
        for some, h, at, own, apart in self._parts(points):
            means[some], halves = self._given(some, self._covariance(h, at, own, apart))
            found = self._covariance(h, at, at, among)
            found -= halves @ np.swapaxes(halves, 1, 2)
            covariances[some] = self.scatter**2 * found
        return means, covariances

    def marginals(self, points: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Means and variances (d, m) of the surface at coded points (m, k), score units."""
        means, variances = np.empty((2, len(self._alpha), len(points)))
        for some, h, at, own, apart in self._parts(points):
            means[some], halves = self._given(some, self._covariance(h, at, own, apart))
            variances[some] = np.sum(at.rows**2, axis=-1) + np.square(h.process)[:, None] + _VAGUE
            variances[some] += np.square(h.difference)[:, None] * np.sum(at.difference**2, axis=1)
            variances[some] -= np.sum(np.square(halves, out=halves), axis=2)
        return means, self.scatter**2 * np.maximum(variances, 0.0)

    def draw(self, rng: np.random.Generator) -> tuple[Callable[[FloatArray], FloatArray], float, float]:
        """One draw: the surface, a function of points (m, k), and standard deviations of a run of weight 1 and a block.

        A draw of the process without scores, from random features, is moved by what the scores say (Wilson et al. 2020,
        Efficiently sampling functions from Gaussian process posteriors, ICML).
        """
        d = int(rng.integers(len(self.hyper.noise)))
        h = self.hyper.some(slice(d, d + 1))
        # The spectrum of a Matern 5/2 covariance is Student's distribution with 5 degrees of freedom.
        waves = rng.standard_normal((_FEATURES, h.lengths.shape[1]))
        waves /= np.sqrt(rng.chisquare(5.0, (_FEATURES, 1)) / 5.0)
        phases = rng.uniform(0.0, 2.0 * np.pi, _FEATURES).astype(np.float32)
        sizes = [len(f.levels) for f in self.model.factors if isinstance(f, CategoricalFactor)]
        levels = np.array(list(itertools.product(*(range(size) for size in sizes))), dtype=np.float64)
        apart = np.sum(levels[:, None] != levels[None, :], axis=-1)
        factor = np.linalg.cholesky(h.between**apart + _JITTER * np.eye(len(levels)))
        heights = factor @ rng.standard_normal((len(levels), _FEATURES)) * h.process * np.sqrt(2.0 / _FEATURES)
        # A cosine of 32 bits takes a thirtieth of the time, and so many waves are off by 3 % anyway.
        across, height_of = waves.T.astype(np.float32), heights.astype(np.float32)
        slopes, middle = rng.standard_normal(len(self._columns)), np.sqrt(_VAGUE) * rng.standard_normal()
        differs = h.difference * rng.standard_normal(self._difference.shape[1])

        def before(at: _Places) -> FloatArray:
            which = np.argmin(np.sum(at.levels[:, None] != levels[None], axis=-1), axis=1)
            found = np.empty(len(which))
            for some in _in_cache(len(which), _FEATURES):
                waved = at.scaled[0, some].astype(np.float32) @ across
                waved += phases
                waved = np.cos(waved, out=waved)
                waved *= height_of[which[some]]
                found[some] = waved.sum(axis=1)
            return np.asarray(found + at.rows[0] @ slopes + middle + at.difference @ differs)

        own = self._places_of_runs(h)
        # What scores have beyond the surface.
        others = np.diag(self._variances(h)[0] / self._runs)
        others += np.square(h.block) * self._columns_of_blocks @ self._columns_of_blocks.T
        error = np.linalg.cholesky(others) @ rng.standard_normal(len(others))
        pull = self._roots[d] @ ((self._y - before(own) - error) @ self._roots[d])

        def surface(points: FloatArray) -> FloatArray:
            at = _bent_places(h, self._columns, *self._of_points(points))
            cross = self._covariance(h, at, own, _apart(at.levels, own.levels))
            return np.asarray(self.centre + self.scatter * (before(at) + cross[0] @ pull))

        return surface, float(self.scatter * h.noise[0]), float(np.sqrt(self.common_variance[d]))

    @property
    def noise_variance(self) -> FloatArray:
        """Variance (d,) of a run of weight 1 for each draw, score units."""
        return np.asarray(np.square(self.scatter * self.hyper.noise))

    @property
    def block_variance(self) -> FloatArray:
        """Variance (d,) of the effect of a block for each draw, score units."""
        return np.asarray(np.square(self.scatter * self.hyper.block))

    @property
    def common_variance(self) -> FloatArray:
        """Variance (d,) that future runs have in common, as those of a new block, for each draw, score units."""
        return self._blocks.new * self.block_variance

    @property
    def variance_of_runs(self) -> FloatArray:
        """Variance (n,) of each run about its source's surface, over all draws, score units."""
        of_places = self.scatter**2 * np.mean(self._variances(self.hyper), axis=0)
        return np.asarray(of_places[self._place] / self._weights)

    @property
    def places(self) -> tuple[FloatArray, IntArray]:
        """Coded points (p, k) that runs count at, and the number (n,) of each run's."""
        return self._points, self._place

    def _given(self, some: slice, cross: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Means (d, m), and for each draw the root (m, n) of what the scores take off the variances there."""
        means: FloatArray = self.centre + self.scatter * np.einsum("dmn,dn->dm", cross, self._alpha[some])
        return means, cross @ self._roots[some]

    def _parts(self, points: FloatArray) -> Iterator[tuple[slice, Hyper, _Places, _Places, IntArray]]:
        """Draws by parts whose covariances stay in the cache, places of points (m, k) and runs, and their `_apart`."""
        given = self._of_points(points)
        apart = _apart(given[1], self._levels)
        for some in _in_cache(len(self._alpha), apart.size):
            h = self.hyper.some(some)
            yield some, h, _bent_places(h, self._columns, *given), self._own.some(some), apart

    def _of_points(self, points: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
        """What places have under every draw: base columns, levels, and rows of the difference."""
        return self.model.base(points), points[:, list(self.model.categorical)], self._of_difference(points)

    def _places_of_runs(self, h: Hyper) -> _Places:
        return _bent_places(h, self._columns, self._base, self._levels, self._difference)

    def _of_difference(self, points: FloatArray) -> FloatArray:
        if self._sources is None:
            return np.empty((len(points), 0))
        return np.asarray(self.model.matrix(points) * self._sources.difference_sd / self.scatter)

    def _covariance(self, h: Hyper, a: _Places, b: _Places, apart: IntArray) -> FloatArray:
        """Of the surface (d, m, n)."""
        k = self._of_process(h, a, b, apart)
        k += a.rows @ np.swapaxes(b.rows, 1, 2)
        k += _VAGUE
        if self._sources is not None:
            k += np.square(h.difference)[:, None, None] * (a.difference @ b.difference.T)
        return k

    def _of_process(self, h: Hyper, a: _Places, b: _Places, apart: IntArray) -> FloatArray:
        """Covariance (d, m, n) of the process alone."""
        squares = _squares(a, b)
        return _matern(h, squares.reshape(len(squares), -1), apart.ravel()).reshape(squares.shape)

    def _of_scores(self, h: Hyper, own: _Places) -> FloatArray:
        """Covariance of the scores, with the scores as one row more: (d, n + 1, n + 1), the lower triangle alone.

        The last row of its Cholesky factor is what a triangular system would have to be solved for.
        """
        pairs, n = self._pairs, len(self._y)
        k = _matern(h, _squares(own, own).reshape(-1, n * n).take(pairs, axis=1), self._apart)
        # A copy: numpy takes twice as long for the product of so small a matrix with its own transpose.
        k += (own.rows @ np.swapaxes(own.rows, 1, 2).copy()).reshape(-1, n * n).take(pairs, axis=1)
        k += _VAGUE
        if self._blocks.columns.size:
            k += np.square(h.block)[:, None] * self._in_blocks
        if self._sources is not None:
            k += np.square(h.difference)[:, None] * (own.difference @ own.difference.T).take(pairs)
        V, diagonal = np.zeros((len(k), n + 1, n + 1)), np.arange(n)
        V.reshape(len(k), -1)[:, pairs + pairs // n] = k
        V[:, diagonal, diagonal] += self._variances(h) / self._runs
        V[:, n, :n], V[:, n, n] = self._y, _BEYOND
        return V

    def _variances(self, h: Hyper) -> FloatArray:
        """Of a run at each place, (d, n)."""
        noise = np.where(self._is_own, h.noise[:, None], h.other_noise[:, None])
        return np.asarray(np.square(noise) * self._inverse_weights + _JITTER)

    def _log_likelihood(self, theta: FloatArray) -> FloatArray:
        """Of rows (d, h), without its constant; -inf where rounding leaves no positive matrix."""
        n, found = len(self._y), np.empty(len(theta))
        for some in _in_cache(len(theta), len(self._pairs)):
            h = self._hyper_of(theta[some])
            with np.errstate(over="ignore", invalid="ignore"):  # bent axes of runs far outside a narrowed region
                V = self._of_scores(h, self._places_of_runs(h))
            failed = np.array([dpotrf(each.T, overwrite_a=True, clean=False)[1] != 0 for each in V])
            failed |= ~np.isfinite(V[:, n]).all(axis=1)
            scales = np.where(failed[:, None], 1.0, np.diagonal(V, axis1=1, axis2=2)[:, :n])
            sums = -np.sum(np.log(scales), axis=1) - 0.5 * np.sum(np.square(V[:, n, :n]), axis=1)
            found[some] = np.where(failed, -np.inf, sums + self._of_repeats(self._variances(h)))
        return found

    def _hyper_of(self, theta: FloatArray) -> Hyper:
        given = bool(self.model.categorical), self._sources is not None, self._blocks.columns.size > 0
        return Hyper.of(theta, len(self.model.numeric), *given)

    def _log_posterior(self, z: FloatArray) -> FloatArray:
        """Of rows (d, h) in units of the prior, up to its constant."""
        mean, sd = self._prior
        found = np.full(len(z), -np.inf)
        inside = np.all(np.abs(z) < 5.0, axis=1)
        if inside.any():
            found[inside] = self._log_likelihood(mean + sd * z[inside]) - 0.5 * np.sum(z[inside] ** 2, axis=1)
        return found

    def _keep(self, theta: FloatArray) -> None:
        """Condition on the scores under these hyperparameters (d, h)."""
        self.hyper, n = self._hyper_of(theta), len(self._y)
        self._own = self._places_of_runs(self.hyper)
        factors = np.linalg.cholesky(self._of_scores(self.hyper, self._own))
        # Inverses (d, n, n) of transposed factors: a product with one takes a third of what a solution takes.
        self._roots = np.array([dtrtri(factor[:n, :n].T)[0] for factor in factors])
        self._alpha = np.einsum("dij,dj->di", self._roots, factors[:, n, :n])

    def _of_repeats(self, variances: FloatArray) -> FloatArray:
        """Log likelihood of the scatter of equal runs about their means, by the variances (d, n) of a run."""
        sums = np.sum((self._runs - 1) * np.log(variances) + self._squares / variances, axis=1)
        return np.asarray(-0.5 * (sums + np.sum(np.log(self._runs))))

    def _log_evidence_of_quadratic(self) -> float:
        """Of the model's own terms with coefficients of free scale and equal noise, on a grid of the scales."""
        rows, blocks = self.model.matrix(self._points)[:, 1:], self._columns_of_blocks
        weight = 1.0 if self._sources is None else self._sources.weight
        inverse_weights = self._inverse_weights / np.where(self._is_own, weight, 1.0)
        root = np.sqrt(self._runs / inverse_weights)
        known = np.hstack([np.full((len(rows), 1), np.sqrt(_VAGUE)), self._difference])
        columns, y = np.hstack([known, rows, blocks]) * root[:, None], self._y * root
        z = np.linspace(-3.5, 3.5, 25)
        # The more runs the better the noise is known, by 1 / sqrt(2 n) of itself: two points each such width at least.
        of_noise = np.linspace(-3.5, 3.5, max(25, math.ceil(10.0 * math.sqrt(self._runs.sum()))))
        grids = z, z if blocks.size else np.zeros(1), of_noise
        names = zip(("trend", "block", "noise"), grids, strict=True)
        trends, of_blocks, noises = (_PRIOR[name][0] * np.exp(_PRIOR[name][1] * at) for name, at in names)
        sizes = np.ones((len(trends), len(of_blocks), columns.shape[1]))
        sizes[..., known.shape[1] : known.shape[1] + rows.shape[1]] = trends[:, None, None]
        sizes[..., columns.shape[1] - blocks.shape[1] :] = of_blocks[:, None]
        variances = np.square(noises) + _JITTER
        gram, moment = columns.T @ columns, sizes * (columns.T @ y)
        logs = np.empty((len(trends), len(of_blocks), len(noises)))
        for log, size, along in zip(logs, sizes, moment, strict=True):
            own, axes = np.linalg.eigh(size[:, :, None] * gram * size[:, None, :])
            own = np.where(own > 1e-13 * own[:, -1:], own, np.inf)  # directions that no column has
            squares = np.square(np.einsum("bij,bi->bj", axes, along)) / own
            left = np.maximum(y @ y - np.sum(squares, axis=1), 0.0)[:, None] / variances
            own, squares = np.where(np.isinf(own), 0.0, own)[..., None], squares[..., None]
            total = own / variances + 1.0
            log[:] = left + np.sum(squares / (variances * total) + np.log(total), axis=1) + len(y) * np.log(variances)
        of_prior = z[:, None, None] ** 2 + grids[1][:, None] ** 2 + of_noise**2
        logs = self._of_repeats(variances[:, None] * inverse_weights) - 0.5 * (logs + of_prior)
        steps = np.log([grid[1] - grid[0] for grid in grids if len(grid) > 1]) - 0.5 * np.log(2.0 * np.pi)
        return float(logsumexp(logs) + np.sum(steps) + np.sum(np.log(root)))
