"""Scores of one cheaper simulation are off together: what that does to intervals, by Monte Carlo and in closed form."""

from __future__ import annotations

import numpy as np
import pytest

from seqrsm.fit.conjugate import NormalInverseGamma, posterior
from seqrsm.fit.least_squares import fit_least_squares
from seqrsm.fit.weights import shared_error

N, CASES = 24, 1000
BETA = np.array([5.0, 1.0, -2.0])


def matrix(rng: np.random.Generator) -> np.ndarray:
    x = rng.uniform(-1.0, 1.0, N)
    return np.column_stack([np.ones(N), x, x**2])


def loadings(cheap: float, bound: float) -> np.ndarray:
    """The first part of the runs by a rung of such a bound, the others by the top."""
    return np.where(np.arange(N) < cheap * N, 0.5 * bound, 0.0)[:, None]


def test_shift_and_variance_are_those_of_generalised_least_squares() -> None:
    rng = np.random.default_rng(1)
    Z, weights = matrix(rng), rng.uniform(0.5, 2.0, N)
    C = np.column_stack([np.where(np.arange(N) < 9, 1.5, 0.0), np.where(np.arange(N) >= 16, rng.uniform(1, 2, N), 0.0)])
    y = Z @ BETA + C @ np.array([1.3, -0.7]) + rng.standard_normal(N) / np.sqrt(weights)
    row = np.array([1.0, 0.4, 0.16])
    found = shared_error(Z, y, weights, C, np.vstack([Z[0], row]))
    fit = fit_least_squares(Z, y, ["1", "x", "x2"], weights=weights)
    # The same sigma, from the residuals of the model with both errors as constants.
    both = fit_least_squares(np.hstack([Z, C]), y, ["1", "x", "x2", "a", "b"], weights=weights)
    V = both.s**2 * np.diag(1.0 / weights) + C @ C.T
    inverse = np.linalg.inv(V)
    covariance = np.linalg.inv(Z.T @ inverse @ Z)
    beta = covariance @ Z.T @ inverse @ y
    assert row @ fit.estimate + found.shift[1] == pytest.approx(row @ beta, rel=1e-9)
    total = both.s**2 * fit.variance_unscaled(row[None, :])[0] + found.variance[1]
    assert total == pytest.approx(row @ covariance @ row, rel=1e-9)


def test_without_shared_errors_nothing_changes() -> None:
    rng = np.random.default_rng(2)
    Z = matrix(rng)
    found = shared_error(Z, rng.normal(size=N), np.ones(N), np.zeros((N, 0)), Z[:1])
    assert (found.shift[0], found.variance[0]) == (0.0, 0.0)
    found = shared_error(Z, rng.normal(size=N), np.ones(N), np.zeros((N, 2)), Z[:1])
    assert (found.shift[0], found.variance[0]) == (0.0, 0.0)


def test_runs_of_one_rung_alone_leave_all_of_the_bound_open() -> None:
    rng = np.random.default_rng(3)
    Z = matrix(rng)
    y = Z @ BETA + rng.standard_normal(N)
    found = shared_error(Z, y, np.ones(N), np.full((N, 1), 1.5), np.array([[1.0, 0.0, 0.0]]))
    assert found.shift[0] == pytest.approx(0.0, abs=1e-9)
    assert found.variance[0] == pytest.approx(1.5**2, rel=1e-9)


def test_saturated_runs_leave_all_open() -> None:
    rng = np.random.default_rng(4)
    Z = matrix(rng)[:3]
    found = shared_error(Z, Z @ BETA, np.ones(3), np.ones((3, 1)), np.array([[1.0, 0.0, 0.0]]))
    assert found.shift[0] == 0.0
    assert found.variance[0] == pytest.approx(1.0)


@pytest.mark.parametrize(("cheap", "bound"), [(0.5, 2.0), (0.8, 4.0), (1.0, 1.0), (0.3, 0.2)])
def test_intervals_of_the_mean_hold(cheap: float, bound: float) -> None:
    """Nominal 95 percent with the shared error allowed for; the plain interval is the negative control."""
    rng = np.random.default_rng(5)
    row = np.array([1.0, 0.3, 0.09])
    C, ones = loadings(cheap, bound), np.ones(N)
    held = plain = 0
    square = square_plain = 0.0
    for _ in range(CASES):
        Z = matrix(rng)[rng.permutation(N)]
        y = Z @ BETA + C[:, 0] * rng.standard_normal() + rng.standard_normal(N)
        fit = fit_least_squares(Z, y, ["1", "x", "x2"])
        found = shared_error(Z, y, ones, C, row[None, :])
        without = fit.predict(row[None, :])
        counted = without.with_error(found.shift, found.variance, fit.df_residual)
        true = row @ BETA
        held += counted.confidence.low[0] <= true <= counted.confidence.high[0]
        plain += without.confidence.low[0] <= true <= without.confidence.high[0]
        square += (counted.mean[0] - true) ** 2
        square_plain += (without.mean[0] - true) ** 2
    noise = np.sqrt(0.95 * 0.05 / CASES)
    # The shared error's own scatter in s makes the interval a little too wide where most of it is learnt.
    assert 0.95 - 4.0 * noise <= held / CASES <= 0.95 + 4.0 * noise + 0.02
    if bound >= 1.0:
        assert plain / CASES < 0.92
        assert square < 1.001 * square_plain
    if bound >= 2.0:
        assert square < 0.9 * square_plain


def test_exact_posterior_with_a_column_for_the_shared_error_agrees() -> None:
    """The way posterior draws take it: a column of the loadings whose coefficient is N(0, 1) beforehand."""
    rng = np.random.default_rng(6)
    Z, C = matrix(rng), loadings(0.6, 3.0)
    y = Z @ BETA + C[:, 0] * 1.1 + 0.8 * rng.standard_normal(N)
    sigma = 0.8
    precision = np.diag([0.0, 0.0, 0.0, sigma**2])
    found = posterior(np.hstack([Z, C]), y, None, NormalInverseGamma(np.zeros(4), precision, 0.0, 0.0))
    V = sigma**2 * np.eye(N) + C @ C.T
    covariance = np.linalg.inv(Z.T @ np.linalg.inv(V) @ Z)
    beta = covariance @ Z.T @ np.linalg.inv(V) @ y
    np.testing.assert_allclose(found.mean[:3], beta, rtol=1e-9)
    assert (found.factor @ found.factor.T)[:3, :3] * sigma**2 == pytest.approx(covariance, rel=1e-9)
