"""Least squares against statsmodels on random problems, with and without weights."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest
import statsmodels.api as sm
from half_widths import half_width
from scipy import stats
from statsmodels.stats.outliers_influence import OLSInfluence, variance_inflation_factor

from seqrsm.fit.least_squares import fit_least_squares


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


def test_quantiles_by_another_route() -> None:
    Z, y, w, terms = problem(3, True)
    fit = fit_least_squares(Z, y, terms, weights=w)
    for level in (0.5, 0.9, 0.95, 0.99, 0.999):
        half = stats.t(fit.df_residual).ppf(0.5 + level / 2) * fit.se
        np.testing.assert_allclose(half_width(fit.interval(level)), half, rtol=1e-10)
