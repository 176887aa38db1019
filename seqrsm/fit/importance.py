"""Draws of a posterior by importance, and its evidence: from the peak, in rounds of kernels about the draws before."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
import scipy
from scipy.special import gammaln

from seqrsm.arrays import FloatArray, IntArray

_EARLY, _LEAST_LATE, _MOST_LATE, _DRAWS = 2, 3, 8, 250  # rounds that only place others, and that count; draws of each
_ENOUGH = 200.0  # effective draws of those that count: more rounds until there are as many
_DF, _WIDER = 6.0, 1.2  # of a kernel: degrees of freedom, and how much wider than the draws its variance is
_OWN = 0.75  # share of the variance that is a kernel's own
_AFAR = 38  # draws of a round that spread as far as the prior
_LEAST = 60.0  # effective draws that the next round is placed by
_FAR, _OUTSIDE = 4.9, -1e10  # largest coordinate of a peak, and the log density told where there is none
_STEP, _WIDE_STEP = 1e-4, 0.03  # of differences: for slopes, and for curvatures
_NEWTON, _STILL, _FALL = 12, 1e-7, 0.01  # steps by these at most; the length of the last one; what one may lose
_HIGHER = 0.1  # of log density: that another end is taken for the higher one


@dataclass(frozen=True, slots=True)
class WeightedDraws:
    """Draws of a posterior."""

    draws: FloatArray
    """(m, d)."""
    shares: FloatArray
    """(m,): of the probability, 1 in all."""
    log_evidence: float
    """Logarithm of the integral of likelihood times prior."""

    @property
    def effective(self) -> float:
        """Equally weighted draws that would tell as much."""
        return _effective(self.shares)

    def some(self, n: int, rng: np.random.Generator) -> FloatArray:
        """Equally weighted draws (n, d)."""
        return self.draws[_systematic(self.shares, n, rng)]


def weighted_draws(log_density: Callable[[FloatArray], FloatArray], d: int, rng: np.random.Generator) -> WeightedDraws:
    """Draws by importance, of late rounds: from the peak, in rounds of kernels about the draws before.

    The first round is Student's distribution with the curvature of the peak (Tierney & Kadane 1986, J. Am. Stat. Assoc.
    81, 82-86). Each later one is a mixture of narrower ones about the weighted draws of the round before, drawn in so
    that their spread stays that of all (West 1993, Computing Science and Statistics 24, 325-333): it follows ridges and
    bends that one distribution does not. Some draws of each spread as far as the prior and find what lies away from the
    peak (Hesterberg 1995, Technometrics 37, 185-194). Where the density still reaches further, single draws would have
    most of the weight: but for the evidence, it is at most the mean times the root of their number (Ionides 2008, J.
    Comput. Graph. Stat. 17, 295-311).

    ``log_density`` is of rows (m, d) where the prior is standard normal: log likelihood - |z|^2 / 2; -inf where a |z|
    is 5 or more.
    """
    peak, spread = _peak(log_density, d)
    centres, shares, kernel = peak[None, :], np.ones(1), spread
    near, prior = _DRAWS - _AFAR, (np.zeros((1, d)), np.ones(1), np.eye(d))
    rounds: list[tuple[FloatArray, FloatArray]] = []
    for done in range(_EARLY + _MOST_LATE):
        if done >= _EARLY + _LEAST_LATE and _effective(_bounded(rounds[_EARLY:])[1]) >= _ENOUGH:
            break
        root = np.asarray(np.linalg.cholesky(_WIDER * kernel), dtype=np.float64)
        wide = rng.standard_normal((_DRAWS, d)) / np.sqrt(rng.chisquare(_DF, (_DRAWS, 1)) / _DF)
        z = np.vstack([centres[_systematic(shares, near, rng)] + wide[:near] @ root.T, wide[near:]])
        of_near, of_prior = _log_mixture(z, centres, shares, root), _log_mixture(z, *prior)
        logs = log_density(z) - np.logaddexp(of_near + np.log(near / _DRAWS), of_prior + np.log(_AFAR / _DRAWS))
        rounds.append((z, logs))
        shares = _tempered(logs)
        centre, known = shares @ z, _effective(shares)
        apart = z - centre
        spread = (known * (apart.T * shares) @ apart + d * spread) / (known + d)
        centres, kernel = centre + np.sqrt(1.0 - _OWN) * apart, _OWN * spread
    draws, shares, mean = _bounded(rounds[_EARLY:])
    return WeightedDraws(draws, shares, mean - 0.5 * d * np.log(2.0 * np.pi))


def _bounded(rounds: Sequence[tuple[FloatArray, FloatArray]]) -> tuple[FloatArray, FloatArray, float]:
    """Draws of rounds, their shares, and the logarithm of their mean weight before any was bounded."""
    draws, logs = (np.concatenate(parts) for parts in zip(*rounds, strict=True))
    weights = np.exp(logs - logs.max())
    mean = float(logs.max() + np.log(np.mean(weights)))
    weights = np.minimum(weights, np.mean(weights) * np.sqrt(len(weights)))
    return draws, weights / np.sum(weights), mean


def _peak(log_density: Callable[[FloatArray], FloatArray], d: int) -> tuple[FloatArray, FloatArray]:
    """The peak (d,), and the covariance (d, d) of the normal distribution with its curvature; by differences.

    Draws must not depend on the last digits of the density, which are the processor's, and where BFGS ends does. So it
    starts at the prior's centre and at the highest of some places, the same for every seed, and Newton's steps go on
    from the higher end.
    """

    def height(z: FloatArray) -> FloatArray:
        return np.maximum(log_density(z), _OUTSIDE)

    def depth_and_slope(z: FloatArray) -> tuple[float, FloatArray]:
        first, *others = height(z + _STEP * np.eye(1 + d, d, -1))
        return -first, (first - np.array(others)) / _STEP

    places = np.random.default_rng(d).standard_normal((_DRAWS, d))
    ends = [
        scipy.optimize.minimize(
            depth_and_slope, start, jac=True, method="BFGS", options={"maxiter": 30, "gtol": 0.1}
        ).x.clip(-_FAR, _FAR)
        for start in (places[np.argmax(height(places))], np.zeros(d))
    ]
    first, other = height(np.array(ends))
    at = ends[int(other > first + _HIGHER)]
    step, (i, j) = _WIDE_STEP * np.eye(d), np.triu_indices(d, 1)
    around = np.vstack([0.0 * step[:1], step, -step, step[i] + step[j]])
    peak, spread, highest, move = at, np.eye(d), -np.inf, np.zeros(d)
    for _ in range(_NEWTON):
        top, up, down, both = np.split(height(at + around), [1, 1 + d, 1 + 2 * d])
        if top[0] < highest - _FALL:
            move *= 0.25
            at = peak + move
            continue
        peak, highest = at, float(top[0])
        curved = np.diag(2.0 * top - up - down)
        curved[i, j] = curved[j, i] = up[i] + up[j] - both - top
        own, axes = np.linalg.eigh(curved / _WIDE_STEP**2)
        # The prior's is 1: where differences say less, the distribution is no normal one, and wide enough.
        spread = (axes / np.maximum(own, 0.5)) @ axes.T
        at = np.clip(peak + spread @ (up - down) / (2.0 * _WIDE_STEP), -_FAR, _FAR)
        move = at - peak
        if np.max(np.abs(move)) < _STILL:
            break
    return peak, spread


def _log_mixture(z: FloatArray, centres: FloatArray, shares: FloatArray, root: FloatArray) -> FloatArray:
    """Log density (m,) of Student's distributions about ``centres`` (c, d) by their shares."""
    d = z.shape[1]
    a, b = (np.linalg.solve(root, x.T).T for x in (z, centres))
    squares = np.sum(a**2, axis=1)[:, None] + np.sum(b**2, axis=1) - 2.0 * a @ b.T
    mixed = (1.0 + np.maximum(squares, 0.0) / _DF) ** (-0.5 * (_DF + d)) @ shares
    constant = gammaln(0.5 * (_DF + d)) - gammaln(0.5 * _DF) - 0.5 * d * np.log(_DF * np.pi)
    return np.asarray(np.log(mixed) + constant - np.sum(np.log(np.diag(root))))


def _tempered(logs: FloatArray) -> FloatArray:
    """Shares by the weights' logarithms, made more alike where few draws would have all."""
    apart = logs - logs.max()
    for power in 0.8 ** np.arange(40.0):
        shares: FloatArray = np.exp(power * apart) / np.sum(np.exp(power * apart))
        if _effective(shares) >= _LEAST:
            break
    return shares


def _effective(shares: FloatArray) -> float:
    return float(1.0 / np.sum(shares**2))


def _systematic(shares: FloatArray, n: int, rng: np.random.Generator) -> IntArray:
    """Places (n,), each as often as its share says to the nearest whole number."""
    reached = np.cumsum(shares)
    found: IntArray = np.searchsorted(reached, (rng.random() + np.arange(n)) / n * reached[-1])
    return np.minimum(found, len(shares) - 1, out=found)
