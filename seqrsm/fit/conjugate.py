"""Exact posterior of the normal linear model: the normal-inverse-gamma family.

    beta | sigma^2 ~ N(m0, sigma^2 Lambda0^-1),   sigma^2 ~ InverseGamma(a0, b0)

The posterior is of the same form, with Lambda = Lambda0 + Z'WZ, and every margin is a Student t with 2a degrees of
freedom. It is the reference that the ensemble sampler is checked against, and the posterior itself where the model is
normal. It is computed by orthogonal factorisation of the stacked rows [W^(1/2) Z; Lambda0^(1/2)]: Z'WZ is never formed.

Bounds of linear combinations of coefficients cut the prior off. The posterior is then that under the whole prior, cut
off in the same place: draws of the latter that hold the bounds are draws of the former; where too few do, the ensemble
sampler works inside the bounds.

References
----------
Gelman et al., Bayesian Data Analysis, 3rd ed., section 14.2 (flat prior) and chapter 14.8 (prior as extra rows).
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any, TypeAlias

import numpy as np
from scipy.special import ndtri, stdtr, stdtrit

from seqrsm.arrays import BoolArray, FloatArray, IntArray
from seqrsm.errors import FitError, Problem
from seqrsm.fit import linear_system
from seqrsm.fit.intervals import Interval

_MOST = 60  # times the draws wanted, before rejection gives up
_MOST_SECANTS = 100
_SWEEPS = 50
_FIRST_STEP = 0.3  # largest distance from a bound at which a walker starts, in standard deviations


@dataclass(frozen=True, slots=True)
class LinearBounds:
    """``low <= rows @ beta <= high``."""

    rows: FloatArray
    """(c, p): linearly independent."""
    low: FloatArray
    high: FloatArray
    """(c,): -inf and inf where there is no bound; low < high."""

    def hold(self, beta: FloatArray) -> BoolArray:
        """Which coefficients (n, p) lie inside."""
        value = beta @ self.rows.T
        return np.asarray(np.all((value >= self.low) & (value <= self.high), axis=1))

    def seen_from(self, mean: FloatArray, transform: FloatArray) -> LinearBounds:
        """The same bounds of u (p,), with ``beta = mean + transform @ u``."""
        offset = self.rows @ mean
        return LinearBounds(self.rows @ transform, self.low - offset, self.high - offset)

    def moved_inside(self, u: FloatArray, random: Any) -> FloatArray:
        """Points (n, p) moved to inside, by the shortest way and to random distances from the bounds they broke.

        ``u`` is whitened: one step is about a standard deviation. ``random`` is a ``numpy.random.RandomState``.
        """
        value = u @ self.rows.T
        step = _FIRST_STEP * np.linalg.norm(self.rows, axis=1)
        step = np.where(np.isfinite(self.high - self.low), np.minimum(step, 0.5 * (self.high - self.low)), step)
        depth = step * random.uniform(0.01, 1.0, size=value.shape)
        wanted = np.where(value < self.low, self.low + depth, value)
        wanted = np.where(value > self.high, self.high - depth, wanted)
        back = np.linalg.lstsq(self.rows, (wanted - value).T, rcond=None)[0]
        return np.asarray(u + back.T)


def within(
    draw: Callable[[int], tuple[FloatArray, ...]], bounds: LinearBounds | None, n: int, most: int = _MOST
) -> tuple[tuple[FloatArray, ...], float | None]:
    """Draws that hold the bounds, and the share of all draws that do, None without bounds.

    ``draw`` makes so many: coefficients (m, p) and whatever belongs to them, each (m, ...). ``n`` are wanted; fewer are
    given where hardly any of ``most`` times as many hold.
    """
    if bounds is None:
        return draw(n), None
    kept: list[tuple[FloatArray, ...]] = []
    made = found = 0
    while found < n and made < most * n:
        new = draw(n)
        inside = bounds.hold(new[0])
        made, found = made + len(inside), found + int(np.count_nonzero(inside))
        kept.append(tuple(column[inside] for column in new))
    together = tuple(np.concatenate(columns)[:n] for columns in zip(*kept, strict=True))
    return together, found / made


def mixture_quantile(
    probability: float, shares: FloatArray, df: FloatArray, centre: FloatArray, scale: FloatArray
) -> FloatArray:
    """Quantile (m,) of mixtures of Student's t at a ``probability`` in (0, 1).

    Parts have ``shares`` (c,) and ``df`` (c,) or () in every mixture, and each its ``centre`` and ``scale`` > 0 (m, c).
    """
    each = centre + scale * stdtrit(df, probability)
    margin = 1e-9 * (np.abs(each).max(axis=1) + scale.max(axis=1))

    def below(x: FloatArray, k: IntArray) -> FloatArray:
        return np.asarray(stdtr(df, (x[:, None] - centre[k]) / scale[k]) @ shares)

    return where_reached(probability, each.T, margin, below)


def where_reached(
    probability: float, each: FloatArray, margin: FloatArray, below: Callable[[FloatArray, IntArray], FloatArray]
) -> FloatArray:
    """Where (m,) distribution functions ``below`` (places, numbers of them) reach a probability.

    That is between the quantiles of their parts, ``each`` (c, m), which err by less than ``margin`` (m,).
    """

    def above(x: FloatArray, k: IntArray) -> FloatArray:
        # As normal deviates, which nearly lie on a line: half the steps.
        return np.asarray(ndtri(np.clip(below(x, k), 1e-300, 1.0 - 1e-16)) - ndtri(probability))

    return crossing(above, each.min(axis=0) - margin, each.max(axis=0) + margin)


def crossing(rising: Callable[[FloatArray, IntArray], FloatArray], low: FloatArray, high: FloatArray) -> FloatArray:
    """Where (m,) rising functions of (places, numbers of functions) are zero, between ``low`` and ``high`` (m,).

    By the Illinois rule (Dowell & Jarratt 1971, BIT 11, 168-174): secants, whose end that stays counts half.
    """
    k, side, x, found = np.arange(len(low)), np.zeros(len(low)), low, low.copy()
    at_low, at_high, near = rising(low, k), rising(high, k), 1e-14 * (high - low)
    for _ in range(_MOST_SECANTS):
        before, apart = x, at_high - at_low
        x = low + np.clip(-at_low / np.where(apart > 0.0, apart, 1.0), 0.0, 1.0) * (high - low)
        found[k], at = x, rising(x, k)
        up = at > 0.0
        at_low = np.where(up, np.where(side > 0, 0.5, 1.0) * at_low, at)
        at_high = np.where(up, at, np.where(side < 0, 0.5, 1.0) * at_high)
        low, high, side = np.where(up, low, x), np.where(up, x, high), np.where(up, 1.0, -1.0)
        left = ~(np.abs(x - before) <= near + 1e-15 * np.abs(x))
        if not left.any():
            break
        k, side, x, near = k[left], side[left], x[left], near[left]
        low, high, at_low, at_high = low[left], high[left], at_low[left], at_high[left]
    return found


def mixture_interval(
    level: float, shares: FloatArray, df: FloatArray, centre: FloatArray, scale: FloatArray
) -> Interval:
    """Equal-tailed interval of each mixture."""
    tail = 0.5 * (1.0 - level)
    return Interval(*(mixture_quantile(end, shares, df, centre, scale) for end in (tail, 1.0 - tail)))


@dataclass(frozen=True, slots=True)
class NormalInverseGamma:
    """Conjugate prior."""

    m0: FloatArray
    """(p,): prior mean of the coefficients."""
    Lambda0: FloatArray
    """(p, p): prior precision relative to sigma^2, positive semidefinite; null directions are flat."""
    a0: float
    b0: float
    """Shape and scale of the inverse gamma of sigma^2, >= 0; the prior counts as 2 a0 runs that found b0 / a0."""


Prior: TypeAlias = NormalInverseGamma | None
"""None is flat, p(beta, sigma^2) proportional to 1 / sigma^2: its intervals are those of least squares."""


def with_further(base: Prior, p: int, precision: FloatArray) -> NormalInverseGamma:
    """Prior of the first ``p`` coefficients with more behind them: around zero, of ``precision`` (c,), 0 for flat."""
    mean, Lambda0 = np.zeros(p + len(precision)), np.diag(np.concatenate([np.zeros(p), precision]))
    if base is None:
        return NormalInverseGamma(mean, Lambda0, 0.0, 0.0)
    mean[:p], Lambda0[:p, :p] = base.m0[:p], base.Lambda0[:p, :p]
    return NormalInverseGamma(mean, Lambda0, base.a0, base.b0)


@dataclass(frozen=True, slots=True)
class ConjugatePosterior:
    """Normal-inverse-gamma posterior."""

    mean: FloatArray
    """(p,): posterior mean of the coefficients."""
    factor: FloatArray
    """(p, p): L with Lambda^-1 = LL'."""
    a: float
    b: float
    """Shape and scale of the inverse gamma of sigma^2."""

    @property
    def df(self) -> float:
        """Degrees of freedom 2a of the Student-t margins."""
        return 2.0 * self.a

    @property
    def scale(self) -> float:
        """Scale sqrt(b / a) of a run of weight 1; the residual standard deviation s under the flat prior."""
        return float(np.sqrt(self.b / self.a))

    def variance_unscaled(self, rows: FloatArray) -> FloatArray:
        """Value of z' Lambda^-1 z for rows (m, p) -> (m,)."""
        return np.asarray(np.sum(np.square(np.atleast_2d(rows) @ self.factor), axis=1))

    def draws(self, n: int, rng: np.random.Generator) -> tuple[FloatArray, FloatArray]:
        """Independent draws: beta (n, p) and sigma (n,)."""
        sigma = np.sqrt(self.b / rng.standard_gamma(self.a, size=n))
        normal = rng.standard_normal((n, self.factor.shape[1]))
        return self.mean + sigma[:, None] * (normal @ self.factor.T), sigma

    def draws_inside(self, bounds: LinearBounds, n: int, rng: np.random.Generator) -> tuple[FloatArray, FloatArray]:
        """Draws (n, p) and (n,) that hold the bounds, however improbable these are.

        Each bounded combination in turn is drawn from its Student distribution given the others, cut off (Geweke 1991,
        Computing Science and Statistics 23, 571-578): one is drawn exactly, several in `_SWEEPS` turns from the point
        of the bounds that is nearest. What is not bounded is drawn given these.
        """
        rows, offset, count = bounds.rows @ self.factor, bounds.rows @ self.mean, len(bounds.low)
        precision = np.linalg.inv(rows @ rows.T)
        low, high = bounds.low - offset, bounds.high - offset
        off, df = np.tile(np.clip(0.0, low, high), (n, 1)), 2.0 * self.a + count - 1.0
        for j in np.tile(np.arange(count), _SWEEPS if count > 1 else 1):
            off[:, j] = 0.0
            along, square = off @ precision[j], np.sum((off @ precision) * off, axis=1)
            centre = -along / precision[j, j]
            scale = np.sqrt((2.0 * self.b + square - along**2 / precision[j, j]) / (df * precision[j, j]))
            off[:, j] = centre + scale * _student_within(df, (low[j] - centre) / scale, (high[j] - centre) / scale, rng)
        square = np.sum((off @ precision) * off, axis=1)
        sigma = np.sqrt((self.b + 0.5 * square) / rng.standard_gamma(self.a + 0.5 * count, size=n))
        normal = sigma[:, None] * rng.standard_normal((n, self.factor.shape[1]))
        normal += (off - normal @ rows.T) @ precision @ rows
        return self.mean + normal @ self.factor.T, sigma


def _student_within(df: float, low: FloatArray, high: FloatArray, rng: np.random.Generator) -> FloatArray:
    """Draws (n,) of Student's distribution cut off at ``low`` and ``high`` (n,), by its inverse in the lower tail.

    Bounds too far off for its tail to be a number are met where it ends.
    """
    sign = np.where(low > 0.0, -1.0, 1.0)  # small probabilities are known to more digits than those near 1
    low, high = np.where(sign > 0.0, low, -high), np.where(sign > 0.0, high, -low)
    below = stdtr(df, low)
    share = below + rng.random(len(low)) * (stdtr(df, high) - below)
    return np.asarray(sign * np.clip(stdtrit(df, np.maximum(share, 1e-300)), low, high))


def posterior(
    Z: FloatArray, y: FloatArray, weights: FloatArray | None = None, prior: Prior = None
) -> ConjugatePosterior:
    """Exact posterior of ``y = Z beta + e``, e_i ~ N(0, sigma^2 / weight_i), of coded rows Z (n, p) and scores y (n,).

    Weights (n,) > 0 are 1 and the prior is flat by default; n <= p is allowed where the prior determines what the runs
    do not. FitError where both leave a coefficient or sigma undetermined.
    """
    Z, y = np.asarray(Z, dtype=np.float64), np.asarray(y, dtype=np.float64)
    n, p = Z.shape
    w = np.ones(n) if weights is None else np.asarray(weights, dtype=np.float64)
    if prior is None:
        prior = NormalInverseGamma(np.zeros(p), np.zeros((p, p)), 0.0, 0.0)
    root = np.sqrt(w)
    K = _root(prior.Lambda0)
    stacked = np.vstack([Z * root[:, None], K])
    target = np.concatenate([y * root, K @ prior.m0])
    factors = linear_system.factorise(stacked)
    if factors.rank < p:
        raise FitError("runs and prior leave some terms undetermined", "add runs or use an informative prior")
    mean, residual = linear_system.solve(factors, target)
    if np.linalg.norm(residual) <= max(stacked.shape) * linear_system.EPSILON * np.linalg.norm(target):
        residual = np.zeros_like(residual)  # below the rounding of the scores as stored
    # A flat direction of Lambda0 adds no power of sigma to the density and so costs half a degree of shape.
    a = prior.a0 + 0.5 * (n + K.shape[0] - p)
    b = prior.b0 + 0.5 * float(residual @ residual)
    if a <= 0.0:
        problem = Problem(f"{n} runs and {p} terms leave no degrees of freedom for sigma", "use an informative prior")
        raise FitError(problem)
    return ConjugatePosterior(mean, linear_system.covariance_factor(factors), a, b)


def weakly_informative(kinds: Sequence[str], y: FloatArray) -> NormalInverseGamma:
    """Proper prior on the natural scale of the scores: wide beside the data, finite where the data are silent.

    ``kinds`` (p,) are those of the terms ("intercept", "linear", ...), in coded units where one step spans half the
    region. Scores ``y`` (n,) fix the centre, and their standard deviation the scale: what changing one factor across
    the region might well do. The prior guess of sigma is a quarter of the scale, worth three runs. Prior standard
    deviations, with sigma there: 10 times the scale for the intercept about the mean score, 2.5 times for all else
    about 0.
    """
    y = np.asarray(y, dtype=np.float64)
    spread = float(np.std(y, ddof=1)) if y.size > 1 else 0.0
    scale = spread if spread > 0.0 else 1.0
    noise = 0.25 * scale
    intercept = np.array(kinds) == "intercept"
    sd = np.where(intercept, 10.0, 2.5) * scale
    mean, a0 = np.where(intercept, np.mean(y) if y.size else 0.0, 0.0), 1.5
    return NormalInverseGamma(mean, np.diag(np.square(noise / sd)), a0, a0 * noise**2)


def _root(Lambda0: FloatArray) -> FloatArray:
    """K (r, p) with K'K = Lambda0 and r its rank; diagonal matrices exactly."""
    if not np.any(Lambda0 - np.diag(np.diagonal(Lambda0))):
        diagonal = np.diagonal(Lambda0)
        return np.diag(np.sqrt(diagonal))[diagonal > 0.0]
    scale = np.sqrt(np.maximum(np.diagonal(Lambda0), np.finfo(np.float64).tiny))
    values, vectors = np.linalg.eigh(Lambda0 / np.outer(scale, scale))
    keep = values > Lambda0.shape[0] * linear_system.EPSILON * values[-1]
    return np.asarray((np.sqrt(values[keep]) * vectors[:, keep]).T * scale)
