"""Least squares against statsmodels on random problems, with and without weights."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest
import statsmodels.api as sm
from half_widths import half_width
from scipy import stats
from statsmodels.stats.outliers_influence import OLSInfluence, variance_inflation_factor

from seqrsm.fit.intervals import known
from seqrsm.fit.least_squares import AliasedError, fit_least_squares, influential_runs, normal_plot, outlier_p


def problem(seed: int, weighted: bool) -> tuple[np.ndarray, np.ndarray, np.ndarray, list[SimpleNamespace]]:
    rng = np.random.default_rng(seed)
    n, p = int(rng.integers(12, 70)), int(rng.integers(2, 11))
    Z = np.column_stack([np.ones(n), rng.uniform(-1, 1, (n, p - 1))])
    y = Z @ rng.normal(0, 10, p) + 50 + rng.normal(0, rng.uniform(0.1, 5), n)
    w = rng.uniform(0.1, 10, n) if weighted else np.ones(n)
    return Z, y, w, [SimpleNamespace(name=f"z{i}", kind="linear" if i else "intercept") for i in range(p)]


@pytest.mark.parametrize("weighted", [False, True])
@pytest.mark.parametrize("seed", range(40))
def test_random_problems(seed: int, weighted: bool) -> None:
    Z, y, w, terms = problem(seed, weighted)
    ours = fit_least_squares(Z, y, terms, weights=w)
    theirs = sm.WLS(y, Z, weights=w).fit()
    close = {"rtol": 1e-9, "atol": 1e-11}
    np.testing.assert_allclose(ours.estimate, theirs.params, **close)
    np.testing.assert_allclose(ours.se, theirs.bse, **close)
    np.testing.assert_allclose(ours.t, theirs.tvalues, rtol=1e-9, atol=1e-9)
    np.testing.assert_allclose(ours.p_value, theirs.pvalues, rtol=1e-7, atol=1e-14)
    np.testing.assert_allclose(ours.covariance_unscaled, theirs.normalized_cov_params, **close)
    np.testing.assert_allclose(ours.r2, theirs.rsquared, **close)
    np.testing.assert_allclose(ours.r2_adjusted, theirs.rsquared_adj, **close)
    np.testing.assert_allclose(ours.fitted, theirs.fittedvalues, **close)
    np.testing.assert_allclose(ours.residuals, theirs.resid, rtol=1e-9, atol=1e-10)
    low, high = theirs.conf_int(0.1).T
    interval = ours.interval(0.9)
    np.testing.assert_allclose(interval.low, low, rtol=1e-9, atol=1e-10)
    np.testing.assert_allclose(interval.high, high, rtol=1e-9, atol=1e-10)
    test = theirs.f_test(np.eye(len(terms))[1:])
    group = ours.partial_f(range(1, len(terms)))
    assert group.f == pytest.approx(float(test.fvalue), rel=1e-9)
    assert group.p == pytest.approx(float(test.pvalue), rel=1e-6, abs=1e-200)


def test_a_line_through_the_origin() -> None:
    """Without an intercept sums of squares are about zero, and no degree of freedom goes to the mean."""
    Z, y, w, terms = problem(1, True)
    ours, theirs = fit_least_squares(Z[:, 1:], y, terms[1:], weights=w), sm.WLS(y, Z[:, 1:], weights=w).fit()
    assert ours.r2 == pytest.approx(theirs.rsquared, rel=1e-9)
    assert ours.r2_adjusted == pytest.approx(theirs.rsquared_adj, rel=1e-9)


@pytest.mark.parametrize("seed", range(20))
def test_intervals_for_new_runs(seed: int) -> None:
    Z, y, w, terms = problem(seed, True)
    ours = fit_least_squares(Z, y, terms, weights=w)
    rng = np.random.default_rng(seed)
    rows = np.column_stack([np.ones(13), rng.uniform(-1.5, 1.5, (13, Z.shape[1] - 1))])
    new_weight = rng.uniform(0.2, 5, 13)
    theirs = sm.WLS(y, Z, weights=w).fit().get_prediction(rows, weights=new_weight).summary_frame(0.05)
    mine = ours.predict(rows, weight=new_weight)
    for value, column in (
        (mine.mean, "mean"),
        (mine.se_mean, "mean_se"),
        (mine.confidence.low, "mean_ci_lower"),
        (mine.confidence.high, "mean_ci_upper"),
        (mine.prediction.low, "obs_ci_lower"),
        (mine.prediction.high, "obs_ci_upper"),
    ):
        np.testing.assert_allclose(value, theirs[column], rtol=1e-9, atol=1e-10)


@pytest.mark.parametrize("seed", range(20))
def test_influence(seed: int) -> None:
    Z, y, _, terms = problem(seed, False)
    ours, theirs = fit_least_squares(Z, y, terms), OLSInfluence(sm.OLS(y, Z).fit())
    np.testing.assert_allclose(ours.leverage, theirs.hat_matrix_diag, rtol=1e-9, atol=1e-12)
    np.testing.assert_allclose(ours.studentised, theirs.resid_studentized_external, rtol=1e-8, atol=1e-10)
    np.testing.assert_allclose(ours.cooks_distance, theirs.cooks_distance[0], rtol=1e-8, atol=1e-12)
    assert ours.press == pytest.approx(float(np.sum(theirs.resid_press**2)), rel=1e-9)
    if Z.shape[1] > 2:
        vif = [variance_inflation_factor(Z, i) for i in range(1, Z.shape[1])]
        np.testing.assert_allclose(ours.vif()[1:], vif, rtol=1e-9)


@pytest.mark.parametrize("alone", [False, True])
def test_outliers_are_those_of_the_runs_that_have_a_residual(alone: bool) -> None:
    """A run that alone determines a term has no residual, and is none of those that are tested."""
    Z, y, _, terms = problem(4, False)
    y[3] += 40.0
    theirs = OLSInfluence(sm.OLS(y, Z).fit())
    t, n = theirs.resid_studentized_external, len(y)
    tested = np.isfinite(t)
    if alone:
        Z, y = np.vstack([np.column_stack([Z, np.zeros(n)]), np.eye(1, Z.shape[1] + 1, Z.shape[1])]), np.append(y, 50.0)
        terms = [*terms, SimpleNamespace(name="alone", kind="linear")]
        tested, t = np.append(tested, False), np.append(t, np.nan)
    fit = fit_least_squares(Z, y, terms)
    wanted = np.where(tested, 2.0 * tested.sum() * stats.t.sf(np.abs(t), fit.df_residual - 1), np.nan)
    np.testing.assert_allclose(outlier_p(fit), wanted, rtol=1e-6, atol=1e-12)
    plot = normal_plot(fit)
    blom = stats.mstats.plotting_positions(plot.residuals, 0.375, 0.375)
    np.testing.assert_allclose(plot.quantiles, stats.norm.ppf(blom), rtol=1e-9, atol=1e-12)


def test_runs_of_large_cooks_distance_are_named() -> None:
    between = 0
    for seed in range(12):
        Z, y, _, terms = problem(seed, False)
        cooks, n = OLSInfluence(sm.OLS(y, Z).fit()).cooks_distance[0], len(y)
        found = influential_runs(fit_least_squares(Z, y, terms))
        named = {run.run for run in found if any("Cook" in reason for reason in run.reasons)}
        assert named == set(np.flatnonzero(cooks > 4.0 / n))
        between += np.count_nonzero((cooks > 4.0 / n) & (cooks < 4.0 / (n - len(terms))))
    assert between  # some are named by a limit of 4/n that one of 4/(n - p) would leave out


def test_columns_apart_by_more_than_the_error_of_settings_are_told_apart() -> None:
    """Two of 100 runs that differ by 0.003 root mean square: more than an error of 0.001, less than one of 0.004."""
    rng = np.random.default_rng(0)
    a, apart = rng.uniform(-1.0, 1.0, 100), 0.003 * rng.choice([-1.0, 1.0], 100)
    Z = np.column_stack([np.ones(100), a, a + apart])
    terms = [SimpleNamespace(name=f"z{i}", kind="linear" if i else "intercept") for i in range(3)]
    fit_least_squares(Z, rng.normal(size=100), terms, tolerance=0.001)
    with pytest.raises(AliasedError, match="z1, z2"):
        fit_least_squares(Z, rng.normal(size=100), terms, tolerance=0.004)


def test_digits_that_an_uncertainty_supports() -> None:
    told = [known(*pair) for pair in ((12.3456, 0.0123), (60.123, 5.2), (1234.6, 23.0), (0.5, 0.0))]
    assert told == ["12.346", "60.1", "1235", "0.5"]


def test_quantiles_by_another_route() -> None:
    Z, y, w, terms = problem(3, True)
    fit = fit_least_squares(Z, y, terms, weights=w)
    for level in (0.5, 0.9, 0.95, 0.99, 0.999):
        half = stats.t(fit.df_residual).ppf(0.5 + level / 2) * fit.se
        np.testing.assert_allclose(half_width(fit.interval(level)), half, rtol=1e-10)
