"""A further model of errors needs its likelihood, what runs count by it, and its noise: the rest is the base's."""

from __future__ import annotations

import numpy as np
import pytest
from scipy import stats

from seqrsm.fit.conjugate import LinearBounds
from seqrsm.fit.error_models import ERROR_MODELS, Additive, LinearRuns
from seqrsm.fit.least_squares import fit_least_squares

Y = np.array([-1.3, 0.2, 0.4, 0.9, 1.1, 1.6, 9.0])


class Logistic(Additive):
    """Logistic errors."""

    name = "logistic"
    words = "logistic"

    def log_likelihood(self, square):
        r = np.sqrt(square)
        return np.sum(-r - 2.0 * np.log1p(np.exp(-r)), axis=1)

    def share(self, square):
        r = np.sqrt(np.maximum(square, 1e-12))
        return np.tanh(0.5 * r) / r

    def noise(self, size, rng):
        return rng.logistic(size=size)


def runs() -> LinearRuns:
    Z, weights = np.ones((7, 1)), np.ones(7)
    fit = fit_least_squares(Z, Y, ["intercept"], weights=Logistic().weights(Z, Y, weights))
    return LinearRuns(fit, 1, Z, Y, weights, None, lambda beta: beta, True, 1.0, None)


def margins() -> tuple[tuple[np.ndarray, np.ndarray], ...]:
    """Mean and log scale on a grid, and the density of each, from that of the errors alone."""
    mu, log_sigma = np.linspace(-6.0, 9.0, 1501), np.linspace(-4.0, 4.0, 801)
    log_density = sum(stats.logistic.logpdf(y, mu[:, None], np.exp(log_sigma)[None, :]) for y in Y)
    density = np.exp(log_density - log_density.max())
    return (mu, density.sum(axis=1)), (log_sigma, density.sum(axis=0))


@pytest.mark.parametrize("sampler", ["exact", "emcee"])
def test_draws_meet_the_integral(sampler) -> None:
    """No sampler of its own: both are emcee's."""
    found = Logistic().draws(runs(), None, sampler, 4000, np.random.default_rng(3))
    assert (found.made["method"], found.made["errors"]) == ("emcee", "logistic")
    for values, (grid, margin) in zip((found.terms[:, 0], np.log(found.sigma)), margins(), strict=True):
        reached = (np.cumsum(margin) - 0.5 * margin) / margin.sum()
        for share in (0.025, 0.25, 0.5, 0.75, 0.975):
            assert np.mean(values < np.interp(share, reached, grid)) == pytest.approx(share, abs=0.025)


def test_the_share_of_draws_in_bounds_is_that_of_the_integral() -> None:
    bounds = LinearBounds(np.eye(1), np.array([1.0]), np.array([np.inf]))
    found = Logistic().draws(runs(), bounds, "exact", 4000, np.random.default_rng(3))
    (mu, density), _ = margins()
    assert found.terms.min() >= 1.0
    assert found.share == pytest.approx(density[mu >= 1.0].sum() / density.sum(), abs=0.03)


def test_least_squares_by_its_weights_is_the_most_likely_fit() -> None:
    mu, sigma = stats.logistic.fit(Y)
    rough = runs().fit
    # The scale is estimated with n - 1 in place of n, which moves the mean a little.
    assert float(rough.estimate[0]) == pytest.approx(mu, abs=0.1 * sigma)
    assert abs(float(rough.estimate[0]) - Y.mean()) > 0.2 * sigma


def test_intervals_and_tests_of_student_errors_hold_their_level() -> None:
    """Weights that the scores choose make residuals small: intervals covered 0.90, and F tests of 0.05 had 0.15."""
    rng = np.random.default_rng(40)
    errors, n, q = ERROR_MODELS["student_t"], 40, stats.t(34).ppf(0.975)
    X = rng.uniform(-1.0, 1.0, (n, 2))
    Z = np.column_stack([np.ones(n), X, X[:, 0] * X[:, 1], X**2])
    names = ["intercept", "a", "b", "ab", "aa", "bb"]
    covered, rejected, run = [], [], []
    for _ in range(1000):
        y = rng.standard_t(4, n)
        fit = fit_least_squares(Z, y, names, weights=errors.weights(Z, y, np.ones(n)), inflation=errors.inflation)
        covered.append(np.mean(np.abs(fit.estimate) < q * fit.se))
        rejected.append([fit.partial_f(range(1, 6)).p < 0.05, fit.partial_f([5]).p < 0.05])
        band = fit.predict(Z[:1], weight=1.0 / errors.run_variance).prediction
        run.append(band.low[0] < rng.standard_t(4) < band.high[0])
    assert np.mean(covered) == pytest.approx(0.95, abs=0.01)
    assert np.mean(rejected, axis=0) == pytest.approx(0.05, abs=0.022)
    assert np.mean(run) == pytest.approx(0.95, abs=0.02)


def test_what_is_inflated_and_what_is_not() -> None:
    rng = np.random.default_rng(3)
    Z, y, w = np.column_stack([np.ones(12), rng.normal(size=(12, 2))]), rng.normal(size=12), rng.uniform(0.5, 2.0, 12)
    plain, more = (fit_least_squares(Z, y, ["intercept", "a", "b"], weights=w, inflation=c) for c in (1.0, 1.4))
    np.testing.assert_allclose(more.se, np.sqrt(1.4) * plain.se, rtol=1e-12)
    np.testing.assert_allclose(more.covariance_unscaled, 1.4 * plain.covariance_unscaled, rtol=1e-12)
    np.testing.assert_allclose(more.variance_unscaled(Z), 1.4 * plain.variance_unscaled(Z), rtol=1e-12)
    assert (more.s, more.sse, more.press) == (plain.s, plain.sse, plain.press)
    one, other = plain.partial_f([1, 2]), more.partial_f([1, 2])
    assert (other.ss, 1.4 * other.f) == pytest.approx((one.ss, one.f), rel=1e-12)
    np.testing.assert_allclose(more.vif(), plain.vif(), rtol=1e-12)
