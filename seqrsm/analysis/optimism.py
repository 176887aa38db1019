"""By how much the mean at the recommended settings is too high for having been chosen by the scores that tell it.

Chance that favours some settings is told with them. This is the bootstrap of the bias (Efron & Tibshirani 1993, An
introduction to the bootstrap, ch. 10): new scores are drawn about a surface that is taken to be true, and each set of
them chooses and tells anew. A fitted surface varies more than the true one, since error adds to it, so the surface is
first brought nearer to its mean over the runs, until its variance there is what is left of it less that of the error
(as in James and Stein's estimate, Efron & Morris 1973, J. Am. Stat. Assoc. 68, 117).

Runs that were proposed for the optimum lie where the scores before them had it: they measure the chosen settings anew,
and take most of the bias away (Nie et al. 2018, Why adaptively collected data have negative bias and how to correct for
it, AISTATS). For the quadratic they are replayed: each new set of scores puts them where it has its own optimum.
Measured: ``reports/statistics``, "at the recommended settings", and ``reports/peers``.
"""

from __future__ import annotations

from copy import deepcopy

import numpy as np

from seqrsm.analysis.belief import Fitted
from seqrsm.analysis.surfaces import Surface
from seqrsm.arrays import BoolArray, FloatArray
from seqrsm.fit.optimum import sign_of
from seqrsm.fit.process import Process
from seqrsm.store.records import CONFIRMATION

_SETS, _OF_PROCESS, _COVER, _NEAR = 200, 1000, 250, 200
"""New sets of scores, of the process, whose sets cost little, and settings among which each set chooses."""
_DRAWS = 50
"""Of the process: by all of them the half-width of an interval would depend on the seed no less."""

_FOR_THE_OPTIMUM = ("optimum", "regret", CONFIRMATION)
"""Purposes of runs that lie where the scores before them had the optimum."""


def optimism(fitted: Fitted, point: FloatArray, rng: np.random.Generator) -> float:
    """By how much the mean at the coded ``point`` (k,) is too high, too low where minimized, for having been chosen.

    That of the quadratic and that of the process, by their probabilities; what the process rests on stays. It is to be
    taken off, on the scale of the fit: >= 0, <= 0 where minimized; 0 without an estimate of error.
    """
    surface, region, sign = fitted.surface, fitted.region, sign_of(fitted.goal)
    process, share, made = fitted.departure.believed, fitted.departure.probability, surface.data.points
    if not surface.s > 0.0:
        return 0.0
    near = np.vstack([region.jitter(np.repeat(point[None, :], _NEAR, axis=0), radius, rng) for radius in (0.4, 0.15)])
    at = np.vstack([made, point[None, :], region.sample(_COVER, rng), near[region.feasible(near)]])

    other = deepcopy(rng)  # what one surface draws does not depend on whether the other is believed

    def noise(sets: int, rng: np.random.Generator) -> FloatArray:
        drawn = np.empty((sets, len(made)))
        drawn[:, np.lexsort(made.T)] = sign * _normal(sets, len(made), rng)  # whatever the order of the runs
        return drawn

    found = (1.0 - share) * _of_quadratic(surface, at, sign, noise(_SETS, rng), rng) if share < 1.0 else 0.0
    if process is not None:
        found += share * _of_process(process, surface.fit.y, at[len(made) :], sign, noise(_OF_PROCESS, other))
    return float(sign * max(sign * found, 0.0))


def _of_quadratic(surface: Surface, at: FloatArray, sign: float, noise: FloatArray, rng: np.random.Generator) -> float:
    """Mean (told less true) where each set has its best of the places ``at`` (m, k), the runs first."""
    rows, n = surface.rows(at), noise.shape[1]
    apart = rows[:n] - rows[:n].mean(axis=0)  # what settings have in common, as a day's effect, chooses none
    error, of_unit = (
        float(np.mean(np.sum((apart @ covariance) * apart, axis=1)))
        for covariance in (surface.error_covariance, surface.fit.covariance_unscaled[: rows.shape[1], : rows.shape[1]])
    )
    mean = rows @ surface.estimate
    true, _ = _shrunk(mean, mean[:n], error)
    later = np.isin(surface.data.purposes, _FOR_THE_OPTIMUM)
    if later.any():
        scatter = noise * np.sqrt(surface.fit.inflation * error / (of_unit * surface.fit.weights))
        return _above(_replayed(surface, rows, true, later, sign, scatter), true, n, sign)
    size, axes = np.linalg.eigh(surface.error_covariance)
    root = (axes * np.sqrt(np.maximum(size, 0.0))) @ axes.T  # symmetric: the same, whatever the order of the runs
    return _above(true + sign * _normal(_SETS, len(size), rng) @ (rows @ root).T, true, n, sign)


def _replayed(
    surface: Surface, rows: FloatArray, true: FloatArray, later: BoolArray, sign: float, scatter: FloatArray
) -> FloatArray:
    """Means told (sets, m) at places with these ``rows`` (m, c) and ``true`` means, by least squares.

    ``scatter`` (sets, n) is that of the runs; the ``later`` of them are made at the best place by the batches before
    theirs, the others where they were.
    """
    fit, c, n = surface.fit, rows.shape[1], scatter.shape[1]
    size = fit.Z.shape[1]
    gram, moment = np.zeros((_SETS, size, size)), np.zeros((_SETS, size))
    for batch in np.unique(surface.data.batches):
        now = surface.data.batches == batch
        placed, kept = np.flatnonzero(now & later), np.flatnonzero(now & ~later)
        if len(placed):
            best = n + np.argmax(sign * _told(gram, moment, rows)[:, n:], axis=1)
            Z = np.tile(fit.Z[placed], (_SETS, 1, 1))
            Z[..., :c] = rows[best][:, None, :]
            weighted = np.swapaxes(Z * fit.weights[placed, None], 1, 2)
            gram += weighted @ Z
            moment += (weighted @ (true[best, None] + scatter[:, placed])[..., None])[..., 0]
        weighted = fit.Z[kept] * fit.weights[kept, None]
        gram += fit.Z[kept].T @ weighted
        moment += (true[kept] + scatter[:, kept]) @ weighted
    return _told(gram, moment, rows)


def _told(gram: FloatArray, moment: FloatArray, rows: FloatArray) -> FloatArray:
    """Means (sets, m) by normal equations; of least norm where terms cannot be told apart yet."""
    tiny = (1e-9 * np.trace(gram, axis1=1, axis2=2)[:, None, None] + 1e-300) * np.eye(gram.shape[1])
    coefficients = np.linalg.solve(gram + tiny, moment[..., None])[:, : rows.shape[1], 0]
    return np.asarray(coefficients @ rows.T)


def _of_process(process: Process, y: FloatArray, others: FloatArray, sign: float, noise: FloatArray) -> float:
    """The same of the process of scores ``y`` (n,), with all runs where they were and these ``others`` beside them.

    Runs lie at the process's places: of many runs those are fewer.
    """
    places, place = process.places
    pull = process.some(_DRAWS).pull(np.vstack([places, others]))

    def means(scores: FloatArray) -> FloatArray:
        return np.asarray(process.centre + (scores - process.centre) @ pull)

    mean = means(y)
    of_runs, sd = mean[place], np.sqrt(process.variance_of_runs)
    told = means(np.vstack([of_runs[None], np.full((1, len(y)), np.mean(of_runs)), of_runs + sd * noise]))
    same, flat, errors = told[0], told[1], told[2:] - told[0]
    true, kept = _shrunk(mean, of_runs, float(np.mean(np.var(errors[:, place], axis=1))))
    return _above(flat + kept * (same - flat) + errors, true, len(places), sign)


def _shrunk(mean: FloatArray, of_runs: FloatArray, error: float) -> tuple[FloatArray, float]:
    """Means (m,) nearer to that over the runs, whose variance includes ``error``; and the factor."""
    level, varies = float(np.mean(of_runs)), float(np.var(of_runs))
    kept = max(1.0 - error / varies, 0.0) if varies > 0.0 else 0.0
    return level + kept * (mean - level), kept


def _above(told: FloatArray, true: FloatArray, n: int, sign: float) -> float:
    """Mean of told less true where each set (a row of ``told``) has its best place; the first ``n`` are of runs."""
    chosen = n + np.argmax(sign * told[:, n:], axis=1)
    return float(np.mean(told[np.arange(len(told)), chosen] - true[chosen]))


def _normal(sets: int, n: int, rng: np.random.Generator) -> FloatArray:
    """Standard normal numbers (sets, n), each half of the sets the other's negative: their mean is exactly 0."""
    half = rng.standard_normal((sets // 2, n))
    return np.vstack([half, -half])
