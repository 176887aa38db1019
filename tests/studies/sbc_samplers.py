"""Simulation-based calibration of sampled posteriors: ``python tests/studies/sbc_samplers.py [sets [study ...]]``.

Truths are drawn from the prior, scores from the truths, and the ranks of the truths among the posterior draws must be
uniform. Printed: Kolmogorov-Smirnov p value of every parameter's ranks (each above 0.001 but for chance), and that of
a control whose posterior is made half as wide about its median, which must be far below.
"""

from __future__ import annotations

import sys
from collections.abc import Callable
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parents[1]))
import numpy as np
from scipy import stats
from scipy.special import expit
from shorthands import sample_posterior

from seqrsm.design.factors import ContinuousFactor
from seqrsm.design.quadratic import QuadraticModel
from seqrsm.design.region import Region
from seqrsm.errors import ConvergenceError
from seqrsm.fit import ensemble
from seqrsm.fit.blocks import fit_random_blocks
from seqrsm.fit.conjugate import LinearBounds, NormalInverseGamma, posterior
from seqrsm.fit.elicitation import elicited_prior
from seqrsm.fit.error_models import StudentT
from seqrsm.fit.optimum import optimum_draws
from seqrsm.fit.score_models import CoefficientPrior, beta_binomial_model
from seqrsm.fit.target import general_target

Study = Callable[[np.random.Generator, int], tuple[np.ndarray, np.ndarray]]

X = np.linspace(-1, 1, 12)
Z = np.column_stack([np.ones(12), X])
SD = np.full(2, 2.0)
PRIOR = CoefficientPrior(np.zeros(2), np.diag(SD**-2.0))
CONJUGATE = NormalInverseGamma(np.zeros(2), np.diag([0.25, 0.25]), 3.0, 3.0)
DAY = np.arange(12) // 3
# A light effort for each of thousands of fits.
ensemble.MIN_ESS = 400.0
ensemble.WALKERS, ensemble.ENSEMBLES = 32, 2


def student(rng: np.random.Generator, seed: int) -> tuple[np.ndarray, np.ndarray]:
    beta, sigma = ancestral(CONJUGATE, rng)
    y = Z @ beta + sigma * rng.standard_t(4, size=12)
    found = sample_posterior(Z, y, errors=StudentT(), prior=CONJUGATE, seed=seed)
    return np.append(beta, sigma), found.draws


def counts(rng: np.random.Generator, seed: int) -> tuple[np.ndarray, np.ndarray]:
    beta, correlation = SD * rng.normal(size=2), float(rng.beta(1, 9))
    phi, share = 1.0 / correlation - 1.0, np.clip(expit(Z @ beta), 1e-9, 1 - 1e-9)
    p = rng.beta(np.maximum(share * phi, 1e-12), np.maximum((1.0 - share) * phi, 1e-12))
    correct = rng.binomial(40, p).astype(float)
    model = beta_binomial_model(Z, correct, np.full(12, 40.0), PRIOR)
    return np.array([*beta, correlation]), ensemble.sample(general_target(model), seed).draws


def bounded(rng: np.random.Generator, seed: int) -> tuple[np.ndarray, np.ndarray]:
    beta, sigma = ancestral(CONJUGATE, rng)
    while beta[1] < 0.0:
        beta, sigma = ancestral(CONJUGATE, rng)
    y = Z @ beta + sigma * rng.normal(size=12)
    bounds = LinearBounds(np.eye(2)[1:], np.zeros(1), np.full(1, np.inf))
    found = sample_posterior(Z, y, prior=CONJUGATE, bounds=bounds, seed=seed)
    return np.append(beta, sigma), found.draws


def exact(rng: np.random.Generator, seed: int) -> tuple[np.ndarray, np.ndarray]:
    beta, sigma = ancestral(CONJUGATE, rng)
    found = posterior(Z, Z @ beta + sigma * rng.normal(size=12), None, CONJUGATE)
    draws = found.draws(2000, np.random.default_rng(seed))
    return np.append(beta, sigma), np.column_stack(draws)


def elicited(rng: np.random.Generator, seed: int) -> tuple[np.ndarray, np.ndarray]:
    """Stated in natural terms, sampled with emcee; place and value of the optimum are ranked, too."""
    factors = (ContinuousFactor("frequency", 1.0, 18.0, scale="log"),)
    model, region = QuadraticModel(factors), Region(factors)
    said = {"probability": 0.95, "repeat_sd": 3.5, "repeat_runs": 3.0, "optimum": {"frequency": (5.0, 0.5)}}
    prior = elicited_prior(model, region, (60.0, 95.0), goal="maximize", **said)
    beta, sigma = ancestral(prior, rng)
    X = model.matrix(np.linspace(-1.0, 1.0, 9)[:, None])
    found = sample_posterior(X, X @ beta + sigma * rng.normal(size=9), prior=prior, seed=seed)
    keep = np.linspace(0, len(found.draws) - 1, 1000).astype(int)
    places, values = optimum_draws(model, region, found.draws[keep, :-1])
    (place,), (value,) = optimum_draws(model, region, beta[None, :])
    # Ties at a bound are broken at random: a rank among equals is any of theirs.
    jitter = 1e-9 * rng.normal(size=len(keep) + 1)
    truth = np.array([*beta, sigma, float(place[0]) + jitter[-1], value])
    return truth, np.column_stack([found.draws[keep], places[:, 0] + jitter[:-1], values])


def blocks(rng: np.random.Generator, seed: int) -> tuple[np.ndarray, np.ndarray]:
    """Exact posterior with random days; flat priors of coefficients and sigma are replaced by fixed truths."""
    ratio = float(np.tan(0.5 * np.pi * rng.random()))
    beta, effect = np.array([3.0, -1.0]), ratio * rng.normal(size=4)
    found = fit_random_blocks(Z, Z @ beta + effect[DAY] + rng.normal(size=12), DAY.tolist())
    b, sigma, of_days = found.draws(2000, np.random.default_rng(seed))
    return np.array([*beta, 1.0, ratio]), np.column_stack([b, sigma, of_days / sigma])


def ancestral(prior: NormalInverseGamma, rng: np.random.Generator) -> tuple[np.ndarray, float]:
    sigma = float(np.sqrt(prior.b0 / rng.standard_gamma(prior.a0)))
    L = np.linalg.cholesky(np.linalg.inv(prior.Lambda0))
    return prior.m0 + sigma * (L @ rng.normal(size=len(prior.m0))), sigma


STUDIES: dict[str, Study] = {
    "conjugate, exact": exact,
    "random days, exact": blocks,
    "natural terms, emcee": elicited,
    "Student-t errors": student,
    "beta-binomial": counts,
    "bounded coefficient": bounded,
}


def main() -> None:
    sets = int(sys.argv[1]) if len(sys.argv) > 1 else 200
    only = sys.argv[2:]
    for name, study in STUDIES.items():
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
