"""Scores of images from the rankings of several interpreters: the Plackett-Luce model.

An interpreter who chooses the best of the images at hand, then the best of the rest, and so on, takes image i with
probability w_i / (sum of the w left) at each step, where w_i = exp(kappa_j theta_i). ``theta`` is the score of the
image in logits: of two images whose scores differ by d, the better one is preferred with probability 1 / (1 + exp(-d)).
``kappa_j`` is the effect of interpreter j: how sharply he or she tells images apart, 1 for the average interpreter, 0
for one who guesses. A shift that an interpreter adds to all images cancels in a ranking, so it cannot and need not be
known. Images that an interpreter ranks equal count as ranked in some order that we are not told: their probability is
summed over all orders, which is the integral of eq. 2.

Scores are relative: here their mean is zero, and each new ranking changes all of them.

Several interpreters who rank many images say little of each: the most probable scores and sharpnesses together would be
those of one infallible interpreter, whose order the scores repeat. Scores are therefore drawn from a normal
distribution whose spread, like the sharpnesses, is the most probable one over all scores that the rankings leave
possible (an EM algorithm; expectations to second order). Such scores lie nearer to their mean than the true ones; they
are moved apart by the factor that is expected of them.

References: R. L. Plackett, Appl. Statist. 24 (1975) 193-202; R. D. Luce, Individual Choice Behavior, 1959; the integral
for ties is that of J. D. Kalbfleisch and R. L. Prentice, Biometrika 60 (1973) 267-278, for equal times of death; scales
of rankers are those of K. Raman and T. Joachims, KDD 2014, 1037-1046.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
import scipy

from seqrsm.arrays import FloatArray, IntArray

SPREAD_LOGIT, SPREAD_WORTH = 1.5, 2.0
"""Standard deviation of scores, and the number of images that it stands for beside those that are ranked (assumed)."""
SHARPNESS_PRIOR_SD = 0.5
"""Prior of log kappa: two thirds of interpreters are between 0.6 and 1.6 times as sharp as the average one."""

_ROUNDS, _SETTLED = 300, 1e-4
_LEAST_LEFT: Final = 0.02
_SHARPEST: Final = 3.0  # log kappa, either way: six standard deviations of its prior

# Nodes of eq. 2 in v = log t: the integrand is analytic and dies out doubly exponentially, so the trapezoidal rule on
# them is exact to rounding.
_V = np.arange(-40.0, 4.5, 0.125)
_T = np.exp(_V)
_WEIGHT = 0.125 * np.exp(_V - _T)


@dataclass(frozen=True, slots=True)
class Ranking:
    """One interpreter's order of some images."""

    interpreter: int
    """Index of the interpreter."""
    groups: tuple[tuple[int, ...], ...]
    """Indices of the images, the best first; images ranked equal stand in one group."""

    @classmethod
    def of(cls, interpreter: int, images: Sequence[int], ranks: Sequence[float]) -> Ranking:
        """From the rank of each image, 1 (or the smallest) for the best; equal ranks are ties."""
        levels = sorted(set(ranks))
        groups = tuple(
            tuple(image for image, rank in zip(images, ranks, strict=True) if rank == level) for level in levels
        )
        return cls(interpreter, groups)


@dataclass(frozen=True, slots=True)
class RankingFit:
    """Scores of images and effects of interpreters."""

    scores: FloatArray
    se: FloatArray
    """(n,): theta and its standard error [logit]; the scores have mean zero."""
    covariance: FloatArray
    """(n, n): of the scores; its rows add up to zero."""
    sharpness: FloatArray
    sharpness_log_se: FloatArray
    """(m,): kappa of each interpreter (geometric mean 1), and the standard error of its logarithm."""
    agreement: FloatArray
    """(m,): Kendall's tau-b between each interpreter's rankings and the scores; nan where it is undefined."""

    @property
    def scale_se(self) -> float:
        """Relative standard error of the distance between scores, which all have in common; 0 where all are equal."""
        size = float(self.scores @ self.scores)
        return max(float(self.scores @ self.covariance @ self.scores), 0.0) ** 0.5 / size if size > 0.0 else 0.0


def fit_rankings(rankings: Sequence[Ranking], n_images: int, n_interpreters: int) -> RankingFit:
    """Scores and interpreter effects with their standard errors.

    Every image is in at least one ranking; they should be connected by them, see `connected`.
    """
    of = [[ranking for ranking in rankings if ranking.interpreter == j] for j in range(n_interpreters)]
    scores, covariance = _mean_standing(rankings, n_images), np.zeros((n_images, n_images))
    log_sharpness, deviation = np.zeros(n_interpreters), np.zeros(n_interpreters)
    sd = SPREAD_LOGIT
    for _ in range(_ROUNDS):
        scores, covariance = most_probable(rankings, scores, log_sharpness, sd)
        size = float(scores @ scores + np.trace(covariance)) + SPREAD_WORTH * SPREAD_LOGIT**2
        new_sd, new = float(np.sqrt(size / (n_images - 1 + SPREAD_WORTH))), log_sharpness
        if n_interpreters > 1:
            new, deviation = np.array([_sharpness(own, scores, covariance) for own in of]).T
            new = new - new.mean()
        change = max(abs(new_sd / sd - 1.0), float(np.max(np.abs(new - log_sharpness))))
        sd, log_sharpness = new_sd, new
        if change < _SETTLED:
            break
    # What is left of a score's deviation: near 1 where rankings say much, 0 where they say nothing.
    left = max(1.0 - np.trace(covariance) / (max(n_images - 1, 1) * sd**2), _LEAST_LEFT)
    covariance = covariance / left
    return RankingFit(
        scores=scores / left,
        se=np.sqrt(np.maximum(np.diag(covariance), 0.0)),
        covariance=covariance,
        sharpness=np.exp(log_sharpness),
        sharpness_log_se=deviation,
        agreement=np.array([_agreement(rankings, scores, j) for j in range(n_interpreters)]),
    )


def most_probable(
    rankings: Sequence[Ranking], start: FloatArray, log_sharpness: FloatArray, sd: float
) -> tuple[FloatArray, FloatArray]:
    """Mode and covariance of the scores, whose prior has the standard deviation ``sd``; inf: of the likelihood."""
    n = len(start)
    basis, precision = _contrasts(n), sd**-2.0
    if n == 1:
        return np.zeros(1), np.zeros((1, 1))

    def minus_log_posterior(reduced: FloatArray) -> tuple[float, FloatArray, FloatArray]:
        x = basis @ reduced
        value, gradient, hessian = log_likelihood(rankings, x, log_sharpness)
        slope, curvature = gradient - precision * x, hessian - precision * np.eye(n)
        return 0.5 * precision * float(x @ x) - value, -basis.T @ slope, -basis.T @ curvature @ basis

    found = _newton(minus_log_posterior, basis.T @ start)
    return basis @ found, basis @ np.linalg.inv(minus_log_posterior(found)[2]) @ basis.T


def _sharpness(rankings: Sequence[Ranking], scores: FloatArray, covariance: FloatArray) -> tuple[float, float]:
    """Log sharpness of the interpreter of some rankings, the most probable over the scores, and its standard error."""
    rankings = [Ranking(0, ranking.groups) for ranking in rankings]

    def minus_log_posterior(log_sharpness: float) -> float:
        value, _, hessian = log_likelihood(rankings, scores, np.array([log_sharpness]))
        expected = value + 0.5 * float(np.sum(hessian * covariance))
        return 0.5 * (log_sharpness / SHARPNESS_PRIOR_SD) ** 2 - expected

    best = float(
        scipy.optimize.minimize_scalar(minus_log_posterior, bounds=(-_SHARPEST, _SHARPEST), method="bounded").x
    )
    step = 0.05
    ends = [minus_log_posterior(best + k * step) for k in (-1, 0, 1)]
    curvature = (ends[0] - 2.0 * ends[1] + ends[2]) / step**2
    return best, float(max(curvature, SHARPNESS_PRIOR_SD**-2.0) ** -0.5)


def _newton(function: Callable[[FloatArray], tuple[float, FloatArray, FloatArray]], start: FloatArray) -> FloatArray:
    """Minimum of a function given with gradient and Hessian, by Newton steps, damped while they do not descend."""
    x, (value, gradient, hessian) = start, function(start)
    damping = 0.0
    for _ in range(500):
        if np.max(np.abs(gradient)) < 1e-9:
            break
        lowest = float(np.linalg.eigvalsh(hessian)[0])
        shift = max(damping, 1e-3 - lowest if lowest < 1e-9 else 0.0)
        step = -np.linalg.solve(hessian + shift * np.eye(len(x)), gradient)
        step *= min(1.0, 5.0 / float(np.max(np.abs(step))))
        new = function(x + step)
        if new[0] <= value + 1e-12 * abs(value):
            x, (value, gradient, hessian) = x + step, new
            damping *= 0.1
        else:
            damping = max(10.0 * damping, 1e-2)
            if damping > 1e8:  # rounding is all that is left
                break
    return x


def log_likelihood(
    rankings: Sequence[Ranking], scores: FloatArray, log_sharpness: FloatArray
) -> tuple[float, FloatArray, FloatArray]:
    """Log likelihood, its gradient and Hessian in scores theta (n,) [logit] and log kappa (m,), the log sharpness."""
    value, gradient, hessian = 0.0, np.zeros(len(scores)), np.zeros((len(scores), len(scores)))
    for ranking in rankings:
        images = np.array([image for group in ranking.groups for image in group], dtype=np.intp)
        kappa = float(np.exp(log_sharpness[ranking.interpreter]))
        log_p, g, h = _log_probability(kappa * scores[images], [len(group) for group in ranking.groups])
        value += log_p
        gradient[images] += kappa * g
        hessian[np.ix_(images, images)] += kappa**2 * h
    return value, gradient, hessian


def _log_probability(eta: FloatArray, sizes: Sequence[int]) -> tuple[float, FloatArray, FloatArray]:
    """Log probability of an order of images with log worths ``eta`` (n,), in groups of ``sizes``; its derivatives."""
    n, starts = len(eta), np.cumsum([0, *sizes[:-2]]) if len(sizes) > 1 else np.zeros(0, dtype=np.intp)
    single = starts[np.array(sizes[:-1], dtype=np.intp) == 1]
    left = np.where(np.arange(n) >= single[:, None], eta, -np.inf)  # the last group is what is left: certain
    worth = np.exp(left - left.max(axis=1, keepdims=True))
    share = worth / worth.sum(axis=1, keepdims=True)
    log_p, g, h = float(np.sum(np.log(share[np.arange(len(single)), single]))), -share.sum(axis=0), share.T @ share
    g[single] += 1.0
    h[np.diag_indices(n)] -= share.sum(axis=0)
    for start, m in zip(starts, sizes[:-1], strict=True):
        if m > 1:
            of_group, slope, curvature = _tied(eta[start:], m)
            log_p += of_group
            g[start:] += slope
            h[start:, start:] += curvature
    return log_p, g, h


def _tied(eta: FloatArray, m: int) -> tuple[float, FloatArray, FloatArray]:
    """Log probability that the first ``m`` of the images with log worths ``eta`` come before all others.

    With w = exp(eta), W = sum of w over the others and a_i = w_i / W (eq. 2):
    P = integral from 0 to infinity of exp(-t) product over i of (1 - exp(-a_i t)) dt.
    """
    chosen, rest = eta[:m], eta[m:]
    top = rest.max()
    worth = np.exp(rest - top)
    share = worth / worth.sum()
    alpha = chosen - top - np.log(worth.sum())
    x = np.clip(np.exp(alpha)[:, None] * _T, 1e-300, 700.0)
    density = _WEIGHT * np.prod(-np.expm1(-x), axis=0)
    total = density.sum()
    density = density / total
    slope = x / np.expm1(x)
    g_alpha = slope @ density
    h_alpha = (slope * density) @ slope.T - np.outer(g_alpha, g_alpha)
    np.fill_diagonal(h_alpha, (slope * (1.0 - x)) @ density - g_alpha**2)
    jacobian = np.hstack([np.eye(m), np.tile(-share, (m, 1))])
    hessian = jacobian.T @ h_alpha @ jacobian
    hessian[m:, m:] -= g_alpha.sum() * (np.diag(share) - np.outer(share, share))
    return float(np.log(total)), jacobian.T @ g_alpha, hessian


def connected(rankings: Sequence[Ranking], n_images: int) -> IntArray:
    """Number of the group of each image; images that no chain of rankings joins are in different groups."""
    label = np.arange(n_images)
    for ranking in rankings:
        images = [image for group in ranking.groups for image in group]
        touched = np.isin(label, label[images])
        label[touched] = label[images].min()
    return np.unique(label, return_inverse=True)[1].astype(np.int64)


def _contrasts(n: int) -> FloatArray:
    """Orthonormal basis (n, n - 1) of the vectors whose elements add up to zero."""
    full = np.linalg.qr(np.column_stack([np.ones(n), np.eye(n)[:, 1:]]))[0]
    return np.asarray(full[:, 1:], dtype=np.float64)


def _mean_standing(rankings: Sequence[Ranking], n_images: int) -> FloatArray:
    """Mean over its rankings of each image's standing, from -1 (last) to 1 (first)."""
    total, count = np.zeros(n_images), np.zeros(n_images)
    for ranking in rankings:
        for place, group in enumerate(ranking.groups):
            images = list(group)
            total[images] += 1.0 - 2.0 * place / max(len(ranking.groups) - 1, 1) if len(ranking.groups) > 1 else 0.0
            count[images] += 1.0
    standing = total / np.maximum(count, 1.0)
    return np.asarray(standing - standing.mean(), dtype=np.float64)


def _agreement(rankings: Sequence[Ranking], scores: FloatArray, interpreter: int) -> float:
    """Kendall's tau-b of an interpreter's rankings with the scores, weighted by the number of pairs."""
    total, pairs = 0.0, 0.0
    for ranking in rankings:
        if ranking.interpreter != interpreter or len(ranking.groups) < 2:
            continue
        images = [image for group in ranking.groups for image in group]
        places = [place for place, group in enumerate(ranking.groups) for _ in group]
        tau = _kendall(-np.array(places, dtype=np.float64), scores[images])
        if np.isfinite(tau):
            weight = len(images) * (len(images) - 1) / 2.0
            total, pairs = total + weight * tau, pairs + weight
    return total / pairs if pairs else float("nan")


def _kendall(x: FloatArray, y: FloatArray) -> float:
    """Kendall's tau-b: concordant less discordant pairs, over the geometric mean of the untied pairs of each."""
    dx, dy = np.sign(x[:, None] - x), np.sign(y[:, None] - y)
    untied = float(np.sum(dx**2)) * float(np.sum(dy**2))
    return float(np.sum(dx * dy)) / untied**0.5 if untied else float("nan")
