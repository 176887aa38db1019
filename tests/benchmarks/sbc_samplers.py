"""Simulation-based calibration of sampled posteriors: ``python tests/benchmarks/sbc_samplers.py [sets [study ...]]``.

Truths are drawn from the prior, scores from the truths, and the ranks of the truths among the posterior draws must be
uniform. Printed: Kolmogorov-Smirnov p value of every parameter's ranks (each above 0.001 but for chance), and that of
a control whose posterior is made half as wide about its median, which must be far below.
"""

from __future__ import annotations

import sys
from collections.abc import Callable

import numpy as np
from scipy import stats
from scipy.special import expit

from seqrsm.errors import ConvergenceError
from seqrsm.fit.ensemble import WeakPrior, sample_model, sample_posterior
from seqrsm.fit.score_models import CoefficientPrior, Discrepancy, beta_binomial_model, normal_model

Study = Callable[[np.random.Generator, int], tuple[np.ndarray, np.ndarray]]

X = np.linspace(-1, 1, 12)
Z = np.column_stack([np.ones(12), X])
SD = np.full(2, 2.0)
PRIOR = CoefficientPrior(np.zeros(2), SD)
SOURCE, DAY = np.arange(12) % 2, np.arange(12) // 3
LIGHT = {"min_ess": 400, "walkers": 32, "ensembles": 2, "max_seconds": 20.0}


def half_normal(rng: np.random.Generator) -> float:
    return abs(float(rng.normal()))


def student(rng: np.random.Generator, seed: int) -> tuple[np.ndarray, np.ndarray]:
    beta, sigma = SD * rng.normal(size=2), half_normal(rng)
    y = Z @ beta + sigma * rng.standard_t(4, size=12)
    found = sample_posterior(Z, y, errors="student_t", prior=WeakPrior(np.zeros(2), SD, 1.0), seed=seed, **LIGHT)
    return np.append(beta, sigma), np.column_stack([found.beta, found.sigma])


def sources(rng: np.random.Generator, seed: int) -> tuple[np.ndarray, np.ndarray]:
    beta, sigma = SD * rng.normal(size=2), np.array([half_normal(rng), half_normal(rng)])
    y = Z @ beta + sigma[SOURCE] * rng.normal(size=12)
    model = normal_model(Z, y, PRIOR, sources=SOURCE.tolist())
    return np.concatenate([beta, sigma]), sample_model(model, seed=seed, **LIGHT).draws


def days(rng: np.random.Generator, seed: int) -> tuple[np.ndarray, np.ndarray]:
    beta, sigma, tau = SD * rng.normal(size=2), half_normal(rng), half_normal(rng)
    y = Z @ beta + tau * rng.normal(size=4)[DAY] + sigma * rng.normal(size=12)
    model = normal_model(Z, y, PRIOR, days=DAY.tolist())
    return np.array([*beta, sigma, tau]), sample_model(model, seed=seed, **LIGHT).draws


def discrepancy(rng: np.random.Generator, seed: int) -> tuple[np.ndarray, np.ndarray]:
    beta, sigma = SD * rng.normal(size=2), np.array([half_normal(rng), half_normal(rng)])
    gamma, scale = rng.normal(size=1), 1.0 + 0.3 * float(rng.normal())
    flight = SOURCE == 1
    mean = np.where(flight, scale * (Z @ beta) + gamma[0], Z @ beta)
    y = mean + sigma[SOURCE] * rng.normal(size=12)
    differs = Discrepancy(np.ones((12, 1)), flight, np.ones(1), scale_sd=0.3)
    model = normal_model(Z, y, PRIOR, sources=SOURCE.tolist(), discrepancy=differs)
    return np.array([*beta, *gamma, *sigma, scale]), sample_model(model, seed=seed, **LIGHT).draws


def counts(rng: np.random.Generator, seed: int) -> tuple[np.ndarray, np.ndarray]:
    beta, correlation = SD * rng.normal(size=2), float(rng.beta(1, 9))
    phi, share = 1.0 / correlation - 1.0, np.clip(expit(Z @ beta), 1e-9, 1 - 1e-9)
    p = rng.beta(np.maximum(share * phi, 1e-12), np.maximum((1.0 - share) * phi, 1e-12))
    correct = rng.binomial(40, p).astype(float)
    model = beta_binomial_model(Z, correct, np.full(12, 40.0), PRIOR)
    return np.array([*beta, correlation]), sample_model(model, seed=seed, **LIGHT).draws


def bounded(rng: np.random.Generator, seed: int) -> tuple[np.ndarray, np.ndarray]:
    beta, sigma = np.array([float(rng.normal()) * 2.0, 2.0 * half_normal(rng)]), half_normal(rng)
    y = Z @ beta + sigma * rng.normal(size=12)
    prior = CoefficientPrior(np.zeros(2), SD, np.array([-np.inf, 0.0]), np.array([np.inf, np.inf]))
    return np.append(beta, sigma), sample_model(normal_model(Z, y, prior), seed=seed, **LIGHT).draws


def main() -> None:
    sets = int(sys.argv[1]) if len(sys.argv) > 1 else 200
    only = sys.argv[2:]
    studies: dict[str, Study] = {
        "Student-t errors": student,
        "two sources": sources,
        "random days": days,
        "discrepancy and scale": discrepancy,
        "beta-binomial": counts,
        "bounded coefficient": bounded,
    }
    for name, study in studies.items():
        if only and study.__name__ not in only:
            continue
        rng = np.random.default_rng(1)
        ranks, narrow, refused = [], [], 0
        for i in range(sets):
            try:
                truth, draws = study(rng, i)
            except ConvergenceError:  # counted and shown: the sampler says so itself, and gives no draws
                refused += 1
                continue
            middle = np.median(draws, axis=0)
            ranks.append(np.mean(draws < truth, axis=0))
            narrow.append(np.mean(middle + 0.5 * (draws - middle) < truth, axis=0))
        p = [float(stats.kstest(column, "uniform").pvalue) for column in np.array(ranks).T]
        wrong = [float(stats.kstest(column, "uniform").pvalue) for column in np.array(narrow).T]
        print(
            f"{name:24s} p = {', '.join(f'{v:.3f}' for v in p)}   control {min(wrong):.0e}   refused {refused}",
            flush=True,
        )


if __name__ == "__main__":
    main()
