"""Profile likelihoods of transforms, normal plot, influential runs and extrapolation."""

from __future__ import annotations

import numpy as np
import pytest
from scipy import stats
from statsmodels.api import OLS, ProbPlot
from statsmodels.stats.outliers_influence import OLSInfluence

from seqrsm.design.factors import ContinuousFactor
from seqrsm.design.quadratic import QuadraticModel
from seqrsm.errors import FitError
from seqrsm.fit.least_squares import extrapolated, fit_least_squares, influential_runs, normal_plot
from seqrsm.fit.transforms import box_cox_profile, logit_profile

MODEL = QuadraticModel((ContinuousFactor("a", -1.0, 1.0), ContinuousFactor("b", -1.0, 1.0)))


def rows(n: int, seed: int = 0) -> tuple[np.ndarray, np.random.Generator]:
    rng = np.random.default_rng(seed)
    return MODEL.matrix(rng.uniform(-1, 1, (n, 2))), rng


def test_box_cox_of_a_sample_is_that_of_scipy() -> None:
    y = np.random.default_rng(1).lognormal(1.0, 0.6, 40) + 0.5
    found = box_cox_profile(np.ones((40, 1)), y, level=0.9)
    # scipy counts all 40 runs, not the 39 degrees of freedom
    assert found.best == pytest.approx(stats.boxcox_normmax(y, method="mle"), abs=1e-6)
    top = stats.boxcox_llf(found.best, y)
    expected = [(stats.boxcox_llf(power, y) - top) * 39 / 40 for power in found.powers]
    np.testing.assert_allclose(found.log_likelihood, expected, atol=1e-8)
    for end in (found.low, found.high):
        fall = (top - stats.boxcox_llf(end, y)) * 39 / 40
        assert fall == pytest.approx(0.5 * stats.chi2(1).ppf(0.9), rel=1e-8)


@pytest.mark.parametrize(("power", "identity", "zero"), [(1.0, True, False), (0.0, False, True), (-1.0, False, False)])
def test_box_cox_finds_the_scale_that_made_the_scores(power: float, identity: bool, zero: bool) -> None:
    Z, rng = rows(60)
    t = 3.0 + 1.5 * Z @ np.array([0, 0.5, -0.3, 0.2, -0.4, 0.3]) + 0.05 * rng.normal(size=60)
    y = np.exp(t) if power == 0 else t ** (1 / power)
    found = box_cox_profile(Z, y)
    assert found.low < power < found.high
    assert (found.identity_inside, found.zero_inside) == (identity, zero)


@pytest.mark.parametrize("power", [0.0, 1.0])
def test_logit_profile_tells_percent_from_logit(power: float) -> None:
    Z, rng = rows(80, 3)
    eta = 0.6 * Z @ np.array([0.6, 1.2, -0.8, 0.5, -0.6, 0.7])
    noise = 0.05 * rng.normal(size=80)
    percent = 100 / (1 + np.exp(-(2 * eta + 2 * noise))) if power == 0 else 50 + 15 * (eta + noise)
    found = logit_profile(Z, percent)
    assert found.low <= power < found.high
    assert found.identity_inside == (power == 1.0)
    assert found.zero_inside == (power == 0.0)


def test_logit_profile_by_change_of_variables() -> None:
    """The density of the percent scores at power 1 and at power 0, written with scipy's own pieces."""
    Z, rng = rows(20, 4)
    percent = 100 / (1 + np.exp(-(Z @ np.array([1.0, 1, 0, 0, 0, 0]) + 0.3 * rng.normal(size=20))))
    found = logit_profile(Z, percent)

    def density(t: np.ndarray, log_jacobian: float) -> float:
        r = t - Z @ np.linalg.lstsq(Z, t, rcond=None)[0]
        sd = np.sqrt(np.mean(r**2))
        return float(np.sum(stats.norm.logpdf(r, 0, sd)) + log_jacobian)

    p = percent / 100
    one = density(2 * (2 * p - 1), 20 * np.log(4))
    zero = density(np.log(p / (1 - p)), float(np.sum(-np.log(p * (1 - p)))))
    at = {round(v, 6): ll for v, ll in zip(found.powers.tolist(), found.log_likelihood.tolist(), strict=True)}
    assert at[0.0] - at[1.0] == pytest.approx((zero - one) * 14 / 20, rel=1e-9)


def test_coverage_of_the_profile_interval() -> None:
    sets, inside, control = 400, 0, 0
    for seed in range(sets):
        Z, rng = rows(50, 100 + seed)
        y = np.exp(1.0 + Z @ np.array([0, 0.5, -0.3, 0.2, -0.4, 0.3]) + 0.3 * rng.normal(size=50))
        found = box_cox_profile(Z, y, level=0.9)
        inside += found.zero_inside
        control += found.identity_inside
    assert inside / sets == pytest.approx(0.9, abs=4 * np.sqrt(0.09 / sets))
    assert control < 0.05 * sets


def test_profiles_refuse() -> None:
    Z, rng = rows(12)
    y = 5 + rng.uniform(0, 1, 12)
    with pytest.raises(FitError, match="run 3 "):
        box_cox_profile(Z, np.where(np.arange(12) == 2, 0.0, y))
    with pytest.raises(FitError, match="outside"):
        logit_profile(Z, np.where(np.arange(12) == 2, 101.0, y))
    with pytest.raises(FitError, match="as many terms"):
        box_cox_profile(Z[:6], y[:6])
    with pytest.raises(FitError, match="exactly"):
        box_cox_profile(Z, np.full(12, 7.0))
    ends = logit_profile(Z, np.where(np.arange(12) < 3, 100.0, 20.0 * y / y.max()))
    assert np.isfinite(ends.log_likelihood).all()


def test_normal_plot_is_that_of_statsmodels() -> None:
    Z, rng = rows(25, 5)
    fit = fit_least_squares(Z, rng.normal(size=25), MODEL.terms)
    found = normal_plot(fit)
    external = OLSInfluence(OLS(fit.y, Z).fit()).resid_studentized_external
    np.testing.assert_allclose(found.residuals, np.sort(external), rtol=1e-9)
    np.testing.assert_allclose(found.residuals, fit.studentised[found.runs], rtol=0)
    np.testing.assert_allclose(found.quantiles, ProbPlot(external, a=0.375).theoretical_quantiles, rtol=1e-12)
    assert found.correlation == pytest.approx(stats.pearsonr(found.residuals, found.quantiles)[0], rel=1e-12)
    saturated = fit_least_squares(Z[:6], fit.y[:6], MODEL.terms)
    assert normal_plot(saturated).runs.size == 0


def test_influential_runs_are_named_with_reasons() -> None:
    Z, rng = rows(30, 6)
    y = Z @ np.arange(6.0) + 0.2 * rng.normal(size=30)
    y[7] += 4.0
    found = influential_runs(fit_least_squares(Z, y, MODEL.terms))
    assert found[0].run == 7
    text = " ".join(found[0].reasons)
    assert "outlier" in text
    assert "Cook" in text
    apart = np.vstack([np.tile(Z[:6], (4, 1)), MODEL.matrix(np.array([[3.0, 3.0]]))])
    far = influential_runs(fit_least_squares(apart, rng.normal(size=25), MODEL.terms))
    assert any(run.run == 24 and "leverage" in run.reasons[0] for run in far)
    lonely = np.array([[1.0, 0.0], [1.0, 0.0], [1.0, 0.0], [1.0, 1.0]])
    terms = MODEL.terms[:2]
    last = influential_runs(fit_least_squares(lonely, np.array([1.0, 2.0, 3.0, 9.0]), terms))
    assert [run.run for run in last] == [3]
    assert "leverage 1" in last[0].reasons[0]


def test_extrapolation_has_nothing_to_do_with_weights() -> None:
    Z, rng = rows(20, 7)
    w = np.full(20, 1e4)
    fit = fit_least_squares(Z, rng.normal(size=20), MODEL.terms, weights=w)
    at = MODEL.matrix(np.array([[0.0, 0.0], [4.0, -4.0]]))
    np.testing.assert_array_equal(extrapolated(fit, at), [False, True])
    assert not extrapolated(fit, Z).any()
