"""Monte Carlo at the optimum with Student-t errors, random days, flights beside simulations: cases of the study."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from statistics_cases import COMPARED, LEVEL, Row, surface

from seqrsm.decide.sources import discrepancy_sd, fit_sources, to_flight
from seqrsm.design.quadratic import QuadraticModel
from seqrsm.fit.blocks import fit_random_blocks
from seqrsm.fit.conjugate import Flat
from seqrsm.fit.least_squares import fit_least_squares
from seqrsm.fit.optimum import optimum
from seqrsm.fit.optimum_interval import searched_from_draws
from seqrsm.fit.robust import STUDENT_DF, student_draws, student_weights

RUNS, SIGMA, DRAWS = 24, 0.5, 800
DISCREPANCY_SD = 0.5

Case = tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray, float]
"""True coefficients, their estimate, draws of them (m, p), of what a future run adds (m,), and what it does add."""


def student(model: QuadraticModel, points: np.ndarray, beta: np.ndarray, rng: np.random.Generator) -> Case:
    Z, ones = model.matrix(points), np.ones(RUNS)
    y = Z @ beta + SIGMA * rng.standard_t(STUDENT_DF, size=RUNS)
    estimate = fit_least_squares(Z, y, model.terms, weights=student_weights(Z, y, ones)).estimate
    found = student_draws(Z, y, ones, Flat(), DRAWS, rng)
    noise = found.sigma * rng.standard_t(STUDENT_DF, len(found.sigma))
    return beta, estimate, found.beta, noise, SIGMA * float(rng.standard_t(STUDENT_DF))


def days(model: QuadraticModel, points: np.ndarray, beta: np.ndarray, rng: np.random.Generator) -> Case:
    """Eight days of three runs, the ratio of standard deviations from its prior, cut at 10; the future run: a new day.

    The mean is that of the average day.
    """
    ratio = float(np.tan(0.5 * np.pi * rng.uniform(0.0, 2.0 / np.pi * np.arctan(10.0))))
    day = np.arange(RUNS) % 8
    y = model.matrix(points) @ beta + SIGMA * (ratio * rng.normal(size=8)[day] + rng.normal(size=RUNS))
    found = fit_random_blocks(model.matrix(points), y, day.tolist())
    betas, sigma, of_days = found.draws(DRAWS, rng)
    noise = np.hypot(sigma, of_days) * rng.normal(size=DRAWS)
    return beta, found.estimate, betas, noise, SIGMA * float(np.hypot(ratio, 1.0) * rng.normal())


def flights(model: QuadraticModel, points: np.ndarray, beta: np.ndarray, rng: np.random.Generator) -> Case:
    """Sixteen simulations and eight flights, whose surface differs by draws from the prior of the discrepancy."""
    flown, Z = np.arange(RUNS) % 3 == 0, model.matrix(points)
    truth = beta + discrepancy_sd(model, DISCREPANCY_SD) * rng.normal(size=model.p)
    y = np.where(flown, Z @ truth, Z @ beta) + SIGMA * rng.normal(size=RUNS)
    found = fit_sources(model, points, y, flown, prior_sd=DISCREPANCY_SD)
    betas, sigma = found.draws(DRAWS, rng)
    noise = sigma * rng.normal(size=DRAWS)
    return truth, found.estimate, to_flight(model, betas), noise, SIGMA * float(rng.normal())


def at_the_optimum(sets: int, name: str) -> Iterator[Row]:
    """Mean and one run at the recommended settings, after search."""
    for curvature in (6.0, 0.5):
        model, region, points, beta = surface(2, RUNS, curvature)
        rng = np.random.default_rng(5)
        hits = np.zeros((sets, 4), dtype=bool)
        for i in range(sets):
            truth, estimate, betas, noise, own = CASES[name](model, points, beta, rng)
            best = optimum(model, region, estimate)
            row = model.matrix(best.point[None, :])[0]
            here, draws = float(row @ truth), betas @ row
            _, ends = searched_from_draws(model, region, estimate, betas, [np.zeros(len(noise)), noise], level=LEVEL)
            plain = [np.quantile(draws + extra, [0.5 - 0.5 * LEVEL, 0.5 + 0.5 * LEVEL]) for extra in (0.0, noise)]
            pairs = zip([*ends, *plain], (here, here + own) * 2, strict=True)
            hits[i] = [low <= value <= high for (low, high), value in pairs]
        shares = hits.mean(axis=0)
        what = f"{name}, curvature {curvature / SIGMA:g} sigma"
        yield Row(f"mean at the optimum; {what}", shares[0], LEVEL, True, sets, COMPARED, shares[2])
        yield Row(f"one run at the optimum; {what}", shares[1], LEVEL, True, sets, COMPARED, shares[3])


CASES = {"Student-t errors": student, "random days": days, "flights and simulations": flights}
