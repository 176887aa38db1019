"""Posterior draws under Student-t errors: as many as it takes for intervals that do not change with the seed."""

from __future__ import annotations

from functools import partial

import numpy as np
import pytest
from scipy.special import logsumexp
from scipy.stats import gamma as gamma_law
from scipy.stats import norm, t

from seqrsm.design.factors import ContinuousFactor
from seqrsm.design.quadratic import QuadraticModel
from seqrsm.fit.conjugate import LinearBounds, NormalInverseGamma
from seqrsm.fit.error_models import LinearRuns, StudentT
from seqrsm.fit.least_squares import fit_least_squares
from seqrsm.fit.robust import student_evidence

SEEDS = 10


def runs_of(n: int, wild: int, seed: int = 0) -> LinearRuns:
    """Four factors, 15 terms; some scores wild."""
    model = QuadraticModel(tuple(ContinuousFactor(name, -1.0, 1.0) for name in "abcd"))
    rng = np.random.default_rng(seed)
    Z = model.matrix(rng.uniform(-1.0, 1.0, (n, 4)))
    y = Z @ rng.normal(size=model.p) + rng.standard_t(4.0, n)
    y[:wild] += 15.0
    return linear(Z, y, model.terms, None)


def linear(Z: np.ndarray, y: np.ndarray, terms, prior) -> LinearRuns:
    fit = fit_least_squares(Z, y, terms)
    return LinearRuns(fit, Z.shape[1], Z, y, np.ones(len(y)), prior, lambda beta: beta, True, 1.0, None)


def drawn(runs: LinearRuns, seed: int, bounds: LinearBounds | None = None):
    return StudentT().draws(runs, bounds, "exact", 4000, np.random.default_rng(seed))


@pytest.mark.parametrize(("n", "wild"), [(60, 0), (60, 5), (24, 0)])
def test_intervals_do_not_change_with_the_seed(n: int, wild: int) -> None:
    runs = runs_of(n, wild)
    widths, means, sd = [], [], []
    for seed in range(SEEDS):
        found = drawn(runs, seed)
        values = np.column_stack([found.terms, np.log(found.sigma)])
        low, high = np.quantile(values, [0.025, 0.975], axis=0)
        widths.append(0.5 * (high - low))
        means.append(values.mean(axis=0))
        sd.append(values.std(axis=0))
        assert found.made["ess"] > 4000.0
        assert found.made["ess_ends"] > 4000.0
    scatter = np.std(widths, axis=0, ddof=1) / np.mean(widths, axis=0)
    assert np.sqrt(np.mean(np.square(scatter))) < 0.012
    assert np.max(scatter) < 0.015 * 1.35  # the largest of 16, each known to 24 %
    # What the scatter of the means says of the effective number, without asking the chains.
    implied = np.mean(np.square(sd), axis=0) / np.var(means, axis=0, ddof=1)
    assert 1.0 / np.mean(1.0 / implied) > 4000.0


@pytest.mark.parametrize("prior", [None, NormalInverseGamma(np.array([1.0]), np.array([[3.0]]), 2.0, 3.0)])
def test_draws_of_a_mean_meet_the_integral(prior) -> None:
    """One coefficient: its posterior with sigma's, on a grid, from the densities alone."""
    y = np.array([-1.3, 0.2, 0.4, 0.9, 1.1, 1.6, 9.0])
    found = drawn(linear(np.ones((7, 1)), y, ["intercept"], prior), 3)
    mu, log_sigma = np.linspace(-6.0, 9.0, 1501), np.linspace(-4.0, 5.0, 901)
    sigma = np.exp(log_sigma)[None, :]
    log_density = sum(t.logpdf(one, 4.0, loc=mu[:, None], scale=sigma) for one in y)
    if isinstance(prior, NormalInverseGamma):
        log_density += norm.logpdf(mu[:, None], 1.0, sigma / np.sqrt(3.0))
        log_density += gamma_law.logpdf(sigma**-2, 2.0, scale=1.0 / 3.0) - 2.0 * np.log(sigma)
    density = np.exp(log_density - log_density.max())
    for values, grid, margin in (
        (found.terms[:, 0], mu, density.sum(axis=1)),
        (np.log(found.sigma), log_sigma, density.sum(axis=0)),
    ):
        reached = (np.cumsum(margin) - 0.5 * margin) / margin.sum()
        for share in (0.025, 0.25, 0.5, 0.75, 0.975):
            assert np.mean(values < np.interp(share, reached, grid)) == pytest.approx(share, abs=0.012)


def test_the_first_draws_are_as_good_as_any() -> None:
    """Draws are in no order: a part of them is a sample, not the beginning of chains."""
    found = drawn(runs_of(60, 5), 1)
    x = np.log(found.sigma) - np.mean(np.log(found.sigma))
    correlation = [float(np.mean(x[lag:] * x[:-lag]) / np.mean(x * x)) for lag in (1, 40, 80, 100, 160, 200)]
    assert np.max(np.abs(correlation)) < 4.0 / np.sqrt(len(x))


def test_bounded_draws_are_as_many() -> None:
    runs = runs_of(24, 0)
    middle = float(np.median(drawn(runs, 0).terms[:, 1]))
    bounds = LinearBounds(np.eye(15)[[1]], np.array([middle]), np.array([np.inf]))
    held = partial(drawn, runs, bounds=bounds)
    widths = []
    for seed in range(SEEDS):
        found = held(seed)
        assert np.all(found.terms[:, 1] >= middle)
        assert found.share == pytest.approx(0.5, abs=0.03)
        low, high = np.quantile(found.terms, [0.025, 0.975], axis=0)
        widths.append(0.5 * (high - low))
    scatter = np.std(widths, axis=0, ddof=1) / np.mean(widths, axis=0)
    assert np.sqrt(np.mean(np.square(scatter))) < 0.012


def evidence_on_a_grid(y: np.ndarray, law) -> float:
    """Log evidence of scores about one mean, up to a constant: flat in the mean and in log sigma."""
    middle = np.median(y) + np.std(y) * np.linspace(-3.0, 3.0, 401)
    log_sigma = np.log(np.std(y)) + np.linspace(-3.5, 2.5, 301)
    density = law.logpdf((y[:, None, None] - middle[:, None]) / np.exp(log_sigma)) - log_sigma
    return float(logsumexp(density.sum(axis=0)))


@pytest.mark.parametrize("n", [12, 40])
@pytest.mark.parametrize("wild", [(), (8.0,), (9.0, -7.0)])
def test_evidence_for_student_errors_is_that_of_a_grid(n: int, wild: tuple[float, ...]) -> None:
    y = norm.ppf((np.arange(n) + 0.5) / n)
    y[: len(wild)] = wild
    expected = evidence_on_a_grid(y, t(4.0)) - evidence_on_a_grid(y, norm)
    rows, weights = np.ones((n, 1)), np.ones(n)
    found = student_evidence(rows, y, weights)
    assert found == pytest.approx(expected, abs=0.25)
    # Of its unit and offset it knows nothing, and a weight w is a score and its row times the root of w.
    assert student_evidence(rows, 1e-6 * y + 3.0, weights) == pytest.approx(found, abs=1e-5)
    w = np.linspace(0.5, 2.0, n)
    root = np.sqrt(w)
    assert student_evidence(rows, y, w) == pytest.approx(student_evidence(root[:, None], root * y, weights), abs=1e-8)


@pytest.mark.parametrize(("k", "n"), [(2, 12), (3, 15), (6, 45), (8, 60)])
def test_normal_scores_are_hardly_ever_taken_for_wild_ones(k: int, n: int) -> None:
    """A ratio of evidences has a mean of 1 where the other errors are true: 25 was told of 60 runs for 45 terms."""
    rng = np.random.default_rng(5)
    model = QuadraticModel(tuple(ContinuousFactor(f"x{j}", -1.0, 1.0) for j in range(k)))
    ratios = []
    for _ in range(60):
        Z = model.matrix(rng.uniform(-1.0, 1.0, (n, k)))
        ratios.append(np.exp(student_evidence(Z, rng.standard_normal(n), np.ones(n))))
    assert np.mean(ratios) == pytest.approx(1.0, abs=0.15 + 3.0 * np.std(ratios) / np.sqrt(60))
    assert np.max(ratios) < 30.0


def test_without_scatter_no_errors_are_likelier() -> None:
    rows = np.column_stack([np.ones(9), np.linspace(-1.0, 1.0, 9)])
    assert student_evidence(rows, rows @ [1.0, 2.0], np.ones(9)) == 0.0
    assert student_evidence(rows[:4], np.array([1.0, 5.0, 2.0, 0.0]), np.ones(4)) == 0.0
