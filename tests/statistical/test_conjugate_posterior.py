"""The exact posterior: against least squares, other formulas, draws, and by simulation-based calibration."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest
from scipy import stats

from seqrsm.errors import FitError
from seqrsm.fit.conjugate import ConjugatePosterior, LinearBounds, NormalInverseGamma, posterior, weakly_informative
from seqrsm.fit.least_squares import fit_least_squares

KINDS = ["intercept", "linear", "linear", "interaction", "square", "square"]


def problem(n: int, seed: int = 0) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    rng = np.random.default_rng(seed)
    a, b = rng.uniform(-1, 1, (2, n))
    Z = np.column_stack([np.ones(n), a, b, a * b, a * a, b * b])
    w = rng.uniform(0.3, 3.0, n)
    return Z, 70 + Z @ np.array([0, 4, -3, 2, -6, -5]) + 2 * rng.normal(size=n) / np.sqrt(w), w


def prior(p: int = 6, seed: int = 1) -> NormalInverseGamma:
    rng = np.random.default_rng(seed)
    K = rng.normal(size=(p, p))
    return NormalInverseGamma(rng.normal(0, 5, p), K.T @ K / 10, 2.5, 6.0)


@pytest.mark.parametrize("n", [7, 9, 30])
def test_flat_prior_reproduces_least_squares(n: int) -> None:
    Z, y, w = problem(n)
    terms = [SimpleNamespace(name=f"z{i}", kind=k) for i, k in enumerate(KINDS)]
    fit, exact = fit_least_squares(Z, y, terms, weights=w), posterior(Z, y, w, None)
    assert exact.df == n - 6
    np.testing.assert_allclose(exact.mean, fit.estimate, rtol=1e-13)
    np.testing.assert_allclose(margin_scale(exact), fit.se, rtol=1e-12)
    for level in (0.5, 0.95):
        rows = np.random.default_rng(3).uniform(-1, 1, (5, 6))
        theirs = fit.predict(rows, level, 2.0, 3)
        np.testing.assert_allclose(interval(exact, rows, level)[1], theirs.confidence.high, rtol=1e-11)
        np.testing.assert_allclose(interval(exact, rows, level, 6.0)[0], theirs.prediction.low, rtol=1e-11)


def margin_scale(found: ConjugatePosterior) -> np.ndarray:
    """Student-t scale of every coefficient."""
    return found.scale * np.sqrt(np.sum(np.square(found.factor), axis=1))


def interval(found: ConjugatePosterior, rows: np.ndarray, level: float, future: float = np.inf) -> np.ndarray:
    """Ends of the Student-t interval of the mean, or of so many future runs of weight 1."""
    half = stats.t.ppf(0.5 + 0.5 * level, found.df) * found.scale * np.sqrt(1 / future + found.variance_unscaled(rows))
    return rows @ found.mean + np.array([-1.0, 1.0])[:, None] * half


def precision_of(found: ConjugatePosterior) -> np.ndarray:
    inverse = np.linalg.inv(found.factor)
    return inverse.T @ inverse


def test_formulas_of_the_update() -> None:
    """Lambda = Lambda0 + Z'WZ, m, a, b as printed in the textbooks, on a well-conditioned problem."""
    Z, y, w = problem(20)
    p0 = prior()
    found = posterior(Z, y, w, p0)
    precision = p0.Lambda0 + (Z.T * w) @ Z
    m = np.linalg.solve(precision, p0.Lambda0 @ p0.m0 + Z.T @ (w * y))
    b = p0.b0 + 0.5 * (y @ (w * y) + p0.m0 @ p0.Lambda0 @ p0.m0 - m @ precision @ m)
    np.testing.assert_allclose(found.mean, m, rtol=1e-10)
    np.testing.assert_allclose(precision_of(found), precision, rtol=1e-9, atol=1e-9)
    assert found.a == p0.a0 + 10
    assert found.b == pytest.approx(b, rel=1e-9)


def test_updating_in_two_steps_is_updating_at_once() -> None:
    Z, y, w = problem(20)
    p0 = prior()
    first = posterior(Z[:4], y[:4], w[:4], p0)
    second = posterior(Z[4:], y[4:], w[4:], NormalInverseGamma(first.mean, precision_of(first), first.a, first.b))
    once = posterior(Z, y, w, p0)
    np.testing.assert_allclose(second.mean, once.mean, rtol=1e-9)
    assert (second.a, second.b) == (once.a, pytest.approx(once.b, rel=1e-10))


def test_prior_flat_in_some_directions() -> None:
    """A precision of rank r counts r, not p, half degrees: with an infinitely wide slope, as least squares on it."""
    Z, y, _ = problem(10)
    p0 = NormalInverseGamma(np.zeros(6), np.diag([0.0, 0, 0, 1e12, 1e12, 1e12]), 0.0, 0.0)
    found = posterior(Z, y, None, p0)
    terms = [SimpleNamespace(name=f"z{i}", kind="linear") for i in range(3)]
    reduced = fit_least_squares(Z[:, :3], y, terms)
    np.testing.assert_allclose(found.mean[:3], reduced.estimate, rtol=1e-9)
    assert found.df == 10 + 3 - 6 == reduced.df_residual
    assert found.scale == pytest.approx(reduced.s, rel=1e-6)


def test_draws_have_the_exact_margins() -> None:
    Z, y, w = problem(12)
    exact = posterior(Z, y, w)
    beta, sigma = exact.draws(40_000, np.random.default_rng(0))
    for j in range(6):
        margin = stats.t(exact.df, exact.mean[j], margin_scale(exact)[j])
        assert stats.kstest(beta[:, j], margin.cdf).pvalue > 1e-4
    assert stats.kstest(sigma**2, stats.invgamma(exact.a, scale=exact.b).cdf).pvalue > 1e-4
    np.testing.assert_allclose(
        np.std(beta, axis=0), margin_scale(exact) * np.sqrt(exact.df / (exact.df - 2)), rtol=0.05
    )
    row = Z[:1]
    new = beta @ row[0] + sigma / np.sqrt(2.0) * np.random.default_rng(1).normal(size=40_000)
    low, high = interval(exact, row, 0.9, 2.0)
    assert np.mean((new > low) & (new < high)) == pytest.approx(0.9, abs=0.006)


def test_fewer_runs_than_terms_with_the_default_prior() -> None:
    Z, y, _ = problem(4)
    found = posterior(Z, y, None, weakly_informative(KINDS, y))
    assert np.isfinite(found.mean).all()
    assert found.df == 7.0
    none = posterior(np.zeros((0, 6)), np.zeros(0), None, weakly_informative(KINDS, 10.0 * y))
    assert none.mean[0] == pytest.approx(10.0 * y.mean())
    wide, narrow = (np.ptp(interval(one, Z, 0.95, 1.0), axis=0) for one in (none, found))
    assert (wide > narrow).all()


def test_default_prior_is_overruled_by_data() -> None:
    Z, y, w = problem(60)
    found, flat = posterior(Z, y, w, weakly_informative(KINDS, y)), posterior(Z, y, w)
    assert np.max(np.abs(found.mean - flat.mean) / margin_scale(flat)) < 0.1
    constant = weakly_informative(KINDS, np.full(5, 40.0))
    assert np.isfinite(constant.Lambda0).all()
    assert constant.b0 > 0


def test_refused() -> None:
    Z, y, _ = problem(6)
    for bad in (lambda: posterior(Z, y), lambda: posterior(Z[:4], y[:4])):
        with pytest.raises(FitError):
            bad()


def test_simulation_based_calibration() -> None:
    """Truths drawn from the prior rank uniformly in their posteriors (Cook, Gelman, Rubin 2006)."""
    rng = np.random.default_rng(4)
    Z, _, w = problem(9)
    p0 = prior()
    L = np.linalg.cholesky(np.linalg.inv(p0.Lambda0))
    t, precision = np.empty((2000, 6)), np.empty(2000)
    for i in range(len(t)):
        sigma = np.sqrt(p0.b0 / rng.standard_gamma(p0.a0))
        beta = p0.m0 + sigma * (L @ rng.normal(size=6))
        found = posterior(Z, Z @ beta + sigma / np.sqrt(w) * rng.normal(size=9), w, p0)
        t[i] = (beta - found.mean) / margin_scale(found)
        precision[i] = found.b / sigma**2
    df = 2 * (p0.a0 + 4.5)
    p = [stats.kstest(column, stats.t(df).cdf).pvalue for column in t.T]
    assert min(*p, stats.kstest(precision, stats.gamma(df / 2).cdf).pvalue) > 1e-3
    # Controls: intervals a quarter too narrow, or sigma with two degrees of freedom too many, must be seen.
    assert min(stats.kstest(column, stats.t(df, scale=0.75).cdf).pvalue for column in t.T) < 1e-3
    assert stats.kstest(precision, stats.gamma(df / 2 + 1).cdf).pvalue < 1e-3


@pytest.mark.parametrize("count", [1, 2])
def test_draws_inside_bounds_are_those_that_hold_them(count: int) -> None:
    """Bounds that three draws of a hundred hold: rejection, the definition, beside draws that need none."""
    found = posterior(*problem(9), None)
    rows = np.array([[0.0, 1.0, 0.3, 0.0, 0.0, 0.0], [0.0, 1.0, -1.0, 0.0, 0.5, 0.0]])[:count]
    middle, sd = rows @ found.mean, np.sqrt(found.variance_unscaled(rows)) * found.scale
    bounds = LinearBounds(
        rows, np.array([-np.inf, -1.0])[:count] * sd + middle, middle - np.array([2.2, 0.3])[:count] * sd
    )
    beta, sigma = found.draws(400_000, np.random.default_rng(1))
    held = bounds.hold(beta)
    inside = found.draws_inside(bounds, 8000, np.random.default_rng(2))
    assert bounds.hold(inside[0]).all()
    for theirs, ours in zip((*beta[held].T, sigma[held]), (*inside[0].T, inside[1]), strict=True):
        assert stats.ks_2samp(theirs, ours).pvalue > 1e-4
    wrong = found.draws(8000, np.random.default_rng(3))  # the control
    assert stats.ks_2samp(sigma[held], wrong[1]).pvalue < 1e-6


def test_draws_inside_two_bounds_that_no_draw_holds() -> None:
    """Margins of a correlated pair far out in its tail, by quadrature of the density."""
    found = posterior(*problem(12), None)
    rows = np.array([[0.0, 1.0, 0.0, 0.0, 0.0, 0.0], [0.0, 0.8, -1.0, 0.0, 0.0, 0.0]])
    high = np.array([-1.0, 0.5])
    inside = (
        found.draws_inside(LinearBounds(rows, np.full(2, -np.inf), high), 20_000, np.random.default_rng(1))[0] @ rows.T
    )
    covariance = found.scale**2 * rows @ found.factor @ found.factor.T @ rows.T
    grid = [end - np.geomspace(1e-5, 1e4, 1500) for end in high]
    density = stats.multivariate_t(rows @ found.mean, covariance, df=found.df).pdf(
        np.stack(np.meshgrid(*grid, indexing="ij"), -1)
    )
    density *= np.abs(np.gradient(grid[0]))[:, None] * np.abs(np.gradient(grid[1]))
    assert density.sum() < 1e-4
    for axis in (0, 1):
        below = 1.0 - np.cumsum(density.sum(axis=1 - axis)) / density.sum()
        shares = np.interp(inside[:, axis], grid[axis][::-1], below[::-1])
        assert stats.kstest(shares, "uniform").pvalue > 1e-3


@pytest.mark.parametrize("df", [3, 400])
def test_draws_inside_a_bound_a_thousand_standard_errors_off(df: int) -> None:
    """Of many scores the tail is smaller than numbers are: the draws lie at the bound, on its side."""
    found = ConjugatePosterior(np.array([5.0, 1000.0]), np.eye(2), 0.5 * df, 0.5 * df)
    for low, high in ((-np.inf, 0.0), (2000.0, np.inf), (-1.0, 0.0)):
        bounds = LinearBounds(np.array([[0.0, 1.0]]), np.array([low]), np.array([high]))
        beta, sigma = found.draws_inside(bounds, 500, np.random.default_rng(1))
        assert low - 1e-9 <= beta[:, 1].min() <= beta[:, 1].max() <= high + 1e-9  # to rounding
        assert np.isfinite(beta).all()
        assert np.isfinite(sigma).all()
