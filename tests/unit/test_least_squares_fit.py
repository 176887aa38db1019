"""Least squares: closed forms, defined results at the edges, and the errors."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from seqrsm.errors import FitError
from seqrsm.fit import linear_system
from seqrsm.fit.intervals import Interval
from seqrsm.fit.least_squares import AliasedError, block_columns, fit_least_squares
from seqrsm.fit.linear_system import factorise, solve


def half_width(interval: Interval) -> np.ndarray:
    return 0.5 * (interval.high - interval.low)


def terms(p: int) -> list[Any]:
    return [SimpleNamespace(name=f"z{i}", kind="linear" if i else "intercept") for i in range(p)]


def quadratic(n: int, seed: int = 0) -> tuple[np.ndarray, np.ndarray]:
    rng = np.random.default_rng(seed)
    a, b = rng.uniform(-1, 1, (2, n))
    Z = np.column_stack([np.ones(n), a, b, a * b, a * a, b * b])
    return Z, 60 + Z @ np.array([0, 3, -2, 1, -4, -5]) + rng.normal(0, 1.5, n)


def test_straight_line_by_hand() -> None:
    """x = -1, 0, 1, 2; y = 1, 2, 2, 5: the closed forms of simple regression."""
    x, y = np.array([-1.0, 0, 1, 2]), np.array([1.0, 2, 2, 5])
    fit = fit_least_squares(np.column_stack([np.ones(4), x]), y, terms(2))
    np.testing.assert_allclose(fit.estimate, [1.9, 1.2], rtol=1e-15)  # Sxy / Sxx = 6 / 5
    assert fit.sse == pytest.approx(1.8, rel=1e-14)  # 9 - 36 / 5
    assert fit.s == pytest.approx(np.sqrt(0.9), rel=1e-14)
    np.testing.assert_allclose(fit.se, np.sqrt([0.9 * (1 / 4 + 0.25 / 5), 0.9 / 5]), rtol=1e-14)
    np.testing.assert_allclose(fit.leverage, [0.7, 0.3, 0.3, 0.7], rtol=1e-14)
    assert fit.r2 == pytest.approx(0.8, rel=1e-14)
    assert fit.press == pytest.approx(float(np.sum((fit.residuals / (1 - fit.leverage)) ** 2)), rel=1e-14)


def test_prediction_interval_is_equation_2_23() -> None:
    """At the mean of x: y +- t S sqrt(1/m + 1/n), where t(2, 0.025) = 0.95 / sqrt(2 * 0.975 * 0.025)."""
    x, y = np.array([-1.0, 0, 1, 2]), np.array([1.0, 2, 2, 5])
    fit = fit_least_squares(np.column_stack([np.ones(4), x]), y, terms(2))
    row = np.array([[1.0, 0.5]])
    t = 0.95 / np.sqrt(2 * 0.975 * 0.025)
    for weight, replicates in ((1.0, 1), (1.0, 5), (4.0, 1), (0.5, 3)):
        found = fit.predict(row, 0.95, weight, replicates)
        assert found.mean[0] == pytest.approx(2.5, rel=1e-14)
        assert half_width(found.confidence)[0] == pytest.approx(t * np.sqrt(0.9 / 4), rel=1e-10)  # scipy before 1.17
        wanted = t * np.sqrt(0.9 * (1 / (weight * replicates) + 1 / 4))
        assert half_width(found.prediction)[0] == pytest.approx(wanted, rel=1e-10)


def test_partial_f_equals_the_extra_sum_of_squares_of_a_refit() -> None:
    Z, y = quadratic(25)
    w = np.random.default_rng(5).uniform(0.2, 4, 25)
    full = fit_least_squares(Z, y, terms(6), weights=w)
    for group in ([3], [4, 5], [1, 3, 4], [2, 3, 5], [1, 2, 3, 4, 5]):
        keep = [i for i in range(6) if i not in group]
        reduced = fit_least_squares(Z[:, keep], y, [terms(6)[i] for i in keep], weights=w)
        test = full.partial_f(group)
        assert test.df == len(group)
        assert test.ss == pytest.approx(reduced.sse - full.sse, rel=1e-10)
        assert test.f == pytest.approx((reduced.sse - full.sse) / len(group) / full.s**2, rel=1e-10)


def test_f_of_one_term_is_its_t_squared() -> None:
    Z, y = quadratic(14)
    fit = fit_least_squares(Z, y, terms(6))
    for i in range(6):
        test = fit.partial_f([i])
        assert test.f == pytest.approx(fit.t[i] ** 2, rel=1e-11)
        assert test.p == pytest.approx(fit.p_value[i], rel=1e-9)


def test_deleted_residuals_equal_refits() -> None:
    Z, y = quadratic(12)
    fit = fit_least_squares(Z, y, terms(6))
    for i in range(12):
        rest = np.delete(np.arange(12), i)
        other = fit_least_squares(Z[rest], y[rest], terms(6))
        gap = y[i] - float(Z[i] @ other.estimate)
        assert gap == pytest.approx(fit.residuals[i] / (1 - fit.leverage[i]), rel=1e-9)
        spread = other.s * np.sqrt(1 / (1 - fit.leverage[i]))
        assert fit.studentised[i] == pytest.approx(gap / spread, rel=1e-9)


def test_integer_weights_are_repeated_runs() -> None:
    Z, y = quadratic(15)
    w = np.random.default_rng(2).integers(1, 5, 15)
    weighted = fit_least_squares(Z, y, terms(6), weights=w.astype(float))
    repeated = fit_least_squares(np.repeat(Z, w, axis=0), np.repeat(y, w), terms(6))
    np.testing.assert_allclose(weighted.estimate, repeated.estimate, rtol=1e-12)
    assert weighted.sse == pytest.approx(repeated.sse, rel=1e-12)
    np.testing.assert_allclose(weighted.covariance_unscaled, repeated.covariance_unscaled, rtol=1e-11, atol=1e-14)


def test_scaling_and_shifting_the_scores() -> None:
    Z, y = quadratic(20)
    a, b = fit_least_squares(Z, y, terms(6)), fit_least_squares(Z, 7.0 + 3.0 * y, terms(6))
    np.testing.assert_allclose(b.se, 3.0 * a.se, rtol=1e-12)
    np.testing.assert_allclose(b.estimate[1:], 3.0 * a.estimate[1:], rtol=1e-12)
    assert b.r2 == pytest.approx(a.r2, rel=1e-12)


def test_aliased_terms_are_refused_by_name() -> None:
    """a and b vary together: neither slope is estimable."""
    rng = np.random.default_rng(0)
    a, c = rng.uniform(-1, 1, (2, 12))
    Z = np.column_stack([np.ones(12), a, a, c])
    with pytest.raises(AliasedError, match="cannot separate these terms: z1, z2") as caught:
        fit_least_squares(Z, 5 + 2 * a + c + rng.normal(0, 0.1, 12), terms(4))
    assert caught.value.n_dependent == 1
    assert caught.value.problems[0].message.endswith("z1, z2")


def test_of_many_aliased_terms_the_first_are_named() -> None:
    """A category of many levels has dozens, and what would mend it has to be seen after them."""
    Z = np.ones((40, 30))
    with pytest.raises(AliasedError, match=r"these terms: z0, .*, z11 and 18 more\.") as caught:
        fit_least_squares(Z, np.arange(40.0), terms(30))
    assert caught.value.n_dependent == 29


def test_columns_of_zeros_are_aliased() -> None:
    Z, y = quadratic(10)
    Z[:, 3] = 0.0
    with pytest.raises(AliasedError, match="these terms: z3"):
        fit_least_squares(Z, y, terms(6))


def test_saturated_fit_interpolates_and_has_no_intervals() -> None:
    Z, y = quadratic(6)
    fit = fit_least_squares(Z, y, terms(6))
    np.testing.assert_allclose(Z @ fit.estimate, y, rtol=1e-11)
    assert np.isnan([fit.s, fit.press, fit.r2_adjusted]).all()
    assert np.isnan(fit.se).all()
    assert np.isnan(fit.p_value).all()
    found = fit.predict(Z[:2])
    np.testing.assert_allclose(found.mean, y[:2], rtol=1e-11)
    assert np.isnan(half_width(found.prediction)).all()
    assert "degrees of freedom" in fit.partial_f([1]).reason
    assert isinstance(fit.lack_of_fit(), str)
    assert fit.leverage_one_runs == (0, 1, 2, 3, 4, 5)


def test_repeats_that_agree_but_for_rounding_test_no_lack_of_fit() -> None:
    """Of an exact fit F would be 0 over the rounding of a logit, and p = 1 a test passed."""
    x = np.tile([-1.0, 0.0, 1.0, -0.5], 2)
    y = 5.98896 * x
    y[4] = np.nextafter(y[4], 0.0)
    fit = fit_least_squares(np.column_stack([np.ones(8), x]), y, terms(2), setting_ids=[0, 1, 2, 3] * 2)
    told = fit.lack_of_fit()
    assert fit.sse == 0.0
    assert isinstance(told, str)
    assert "pure error is zero" in told


def test_a_run_with_leverage_one_is_named() -> None:
    Z = np.column_stack([np.ones(8), np.linspace(-1, 1, 8), [0, 0, 0, 1.0, 0, 0, 0, 0]])
    y = np.random.default_rng(0).normal(size=8)
    fit = fit_least_squares(Z, y, terms(3))
    assert fit.leverage_one_runs == (3,)
    assert np.isnan(fit.press)
    assert np.isnan(fit.studentised[3])
    assert np.isfinite(np.delete(fit.studentised, 3)).all()


@pytest.mark.parametrize("level", [0.0, 50.0, -3.25, 1e-8, 1e8])
def test_scores_that_do_not_vary(level: float) -> None:
    Z, _ = quadratic(12)
    fit = fit_least_squares(Z, np.full(12, level), terms(6))
    assert fit.s == 0.0
    assert np.isnan(fit.r2)
    assert np.isnan(fit.p_value).all()
    assert np.isnan(fit.partial_f([1, 2]).f)
    assert "exactly" in fit.reason
    found = fit.predict(Z[:3])
    np.testing.assert_allclose(found.mean, level, rtol=1e-12, atol=1e-300)
    assert np.isnan(fit.se).all()  # no scatter seen is none known
    assert np.isnan(half_width(found.prediction)).all()
    assert [row.f for row in fit.anova() if row.f == row.f] == []


def test_every_unusable_run_is_named() -> None:
    Z, y = quadratic(10)
    y[[2, 7]] = np.nan, np.inf
    w = np.ones(10)
    w[4] = 0.0
    with pytest.raises(FitError, match=r"run 3, 8 (.*\n)*.*run 5 ") as caught:
        fit_least_squares(Z, y, terms(6), weights=w)
    assert len(caught.value.problems) == 2


def test_fewer_runs_than_terms() -> None:
    Z, y = quadratic(5)
    with pytest.raises(FitError, match="5 runs cannot determine 6 terms"):
        fit_least_squares(Z, y, terms(6))


def test_blocks_sum_to_zero_and_predictions_are_for_their_mean() -> None:
    rng = np.random.default_rng(1)
    days = ["mon", "tue", "wed"] * 8
    effect = {"mon": 3.0, "tue": -1.0, "wed": 7.0}
    columns, names = block_columns(days)
    assert names == ("block[mon]", "block[tue]")
    np.testing.assert_array_equal(columns[:3], [[1, 0], [0, 1], [-1, -1]])
    x = rng.uniform(-1, 1, 24)
    y = 10 + 2 * x + np.array([effect[d] for d in days])
    fit = fit_least_squares(np.column_stack([np.ones(24), x, columns]), y, [*terms(2), *names], block_ids=days)
    assert fit.kinds == ("intercept", "linear", "block", "block")
    np.testing.assert_allclose(fit.estimate, [13.0, 2.0, 0.0, -4.0], rtol=1e-12, atol=1e-12)
    assert fit.predict(np.array([[1.0, 0.5]])).mean[0] == pytest.approx(14.0, rel=1e-12)
    assert fit.predict(np.array([[1.0, 0.5, -1, -1]])).mean[0] == pytest.approx(18.0, rel=1e-12)
    assert block_columns(["one"] * 4)[0].shape == (4, 0)


def test_double_double_products_are_exact() -> None:
    rng = np.random.default_rng(0)
    A = rng.normal(size=(6, 37)) * 10.0 ** rng.integers(-6, 6, (6, 37))
    x = rng.normal(size=(37, 2))
    from fractions import Fraction

    high, low = linear_system.matmul(A, x, np.zeros_like(x))
    for i in range(6):
        for j in range(2):
            exact = sum(Fraction(a) * Fraction(b) for a, b in zip(A[i], x[:, j], strict=True))
            error = abs(Fraction(high[i, j]) + Fraction(low[i, j]) - exact)
            size = sum(abs(Fraction(a) * Fraction(b)) for a, b in zip(A[i], x[:, j], strict=True))
            assert error <= size * Fraction(1, 2**98)


def test_refinement_gives_the_exact_solution_of_an_ill_conditioned_system() -> None:
    """Hilbert-like columns with integer entries: the exact solution is known, plain QR keeps 8 digits of it."""
    x = np.arange(1.0, 31.0)
    Z = np.vander(x, 6, increasing=True)  # products: numpy 1.26 rounds some powers wrongly
    wanted = np.array([3.0, -1, 4, -1, 5, -9])
    basic, residual = solve(factorise(Z), Z @ wanted + 0.0)
    np.testing.assert_allclose(basic, wanted, rtol=1e-15)
    np.testing.assert_allclose(residual, 0.0, atol=1e-25)
    plain = np.linalg.solve(np.linalg.qr(Z)[1], np.linalg.qr(Z)[0].T @ (Z @ wanted))
    assert np.max(np.abs(plain / wanted - 1)) > 1e-12  # negative control: without refinement digits are lost


def test_condition_number_is_that_of_unit_columns() -> None:
    Z, y = quadratic(20)
    scaled = Z * np.array([1, 1e9, 1e-7, 1, 1, 3.0])
    expected = np.linalg.cond(Z / np.linalg.norm(Z, axis=0))
    for matrix in (Z, scaled):
        fit = fit_least_squares(matrix, y, terms(6))
        assert fit.condition_number == pytest.approx(expected, rel=1e-9)
