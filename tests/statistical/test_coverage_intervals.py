"""Coverage of the intervals and size of the F tests by Monte Carlo, each with a control that must fail."""

from __future__ import annotations

import dataclasses
from functools import cache
from types import SimpleNamespace

import numpy as np
import pytest
from half_widths import half_width
from scipy.special import fdtrc

from seqrsm.design.factors import ContinuousFactor
from seqrsm.design.quadratic import QuadraticModel
from seqrsm.design.region import Region
from seqrsm.fit.intervals import t_quantile
from seqrsm.fit.least_squares import LeastSquaresFit, block_columns, fit_least_squares
from seqrsm.fit.natural import natural_transform

SETS = 40_000
LEVEL = 0.95
# Four standard errors of an estimated coverage near 0.95.
ERROR = 4 * np.sqrt(LEVEL * (1 - LEVEL) / SETS)


@cache
def study(n: int) -> tuple[LeastSquaresFit, np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """One design and SETS score vectors: fit of the first, weights, estimates (SETS, p), s (SETS,), true surface."""
    rng = np.random.default_rng(n)
    a, b = rng.uniform(-1, 1, (2, n))
    Z = np.column_stack([np.ones(n), a, b, a * b, a * a, b * b])
    w = rng.uniform(0.3, 3.0, n)
    beta = np.array([70.0, 4, -3, 2, -6, -5])
    y = Z @ beta + 2.0 * rng.normal(size=(SETS, n)) / np.sqrt(w)
    terms = [SimpleNamespace(name=f"z{i}", kind="linear" if i else "intercept") for i in range(6)]
    fit = fit_least_squares(Z, y[0], terms, weights=w)
    # The design is fixed, so the hat matrix of the first fit serves all score vectors.
    estimates = (y * w) @ Z @ fit.covariance_unscaled
    s = np.sqrt(np.sum(w * (y - estimates @ Z.T) ** 2, axis=1) / (n - 6))
    np.testing.assert_allclose(estimates[0], fit.estimate, rtol=1e-10)
    assert s[0] == pytest.approx(fit.s, rel=1e-10)
    return fit, w, estimates, s, beta


ROW = np.array([[1.0, 0.4, -0.3, -0.12, 0.16, 0.09]])


@pytest.mark.parametrize("n", [8, 12, 40])
def test_confidence_interval_covers_the_mean(n: int) -> None:
    fit, _, estimates, s, beta = study(n)
    one = fit.predict(ROW, LEVEL)
    half = half_width(one.confidence)[0] / fit.s * s
    inside = np.abs((estimates - beta) @ ROW[0]) <= half
    assert np.mean(inside) == pytest.approx(LEVEL, abs=ERROR)


@pytest.mark.parametrize(("weight", "replicates"), [(1.0, 1), (1.0, 5), (2.5, 1), (0.4, 3)])
@pytest.mark.parametrize("n", [8, 12, 40])
def test_prediction_interval_covers_the_mean_of_future_runs(n: int, weight: float, replicates: int) -> None:
    fit, _, estimates, s, beta = study(n)
    rng = np.random.default_rng(1000 + n)
    future = ROW[0] @ beta + 2.0 / np.sqrt(weight) * rng.normal(size=(SETS, replicates)).mean(axis=1)
    half = half_width(fit.predict(ROW, LEVEL, weight, replicates).prediction)[0] / fit.s * s
    assert np.mean(np.abs(future - estimates @ ROW[0]) <= half) == pytest.approx(LEVEL, abs=ERROR)


def test_the_study_sees_a_wrong_interval() -> None:
    """Dropping the 1 under the root of eq. 2-23, its S, or the degrees of freedom must show."""
    fit, _, estimates, s, beta = study(12)
    future = ROW[0] @ beta + 2.0 * np.random.default_rng(5).normal(size=SETS)
    gap = np.abs(future - estimates @ ROW[0])
    h = fit.variance_unscaled(ROW)[0]
    t = t_quantile(6, LEVEL)
    assert np.mean(gap <= t * s * np.sqrt(1 + h)) == pytest.approx(LEVEL, abs=ERROR)
    for wrong in (t * s * np.sqrt(h), t * np.sqrt(1 + h), 1.96 * s * np.sqrt(1 + h)):
        assert abs(np.mean(gap <= wrong) - LEVEL) > 0.01


def test_sizes_of_the_f_tests() -> None:
    """Under the null the p values of every F test are uniform, within one percent at the usual levels."""
    rng = np.random.default_rng(8)
    points = [(a, b) for a in (-1.0, 0.0, 1.0) for b in (-1.0, 0.0, 1.0)] + [(0.0, 0.0)] * 4
    a, b = np.array(points).T
    Z = np.column_stack([np.ones(13), a, b, a * b, a * a, b * b])
    kinds = ["intercept", "linear", "linear", "interaction", "square", "square"]
    terms = [SimpleNamespace(name=f"z{i}", kind=k) for i, k in enumerate(kinds)]
    w = rng.uniform(0.5, 2.0, 13)
    sets = 10_000
    y = 50 + rng.normal(size=(sets, 13)) / np.sqrt(w)
    first = fit_least_squares(Z, y[0], terms, weights=w, setting_ids=points)
    estimates = (y * w) @ Z @ first.covariance_unscaled
    sse = np.sum(w * (y - estimates @ Z.T) ** 2, axis=1)
    p, ratio = np.empty((sets, 5)), np.empty(sets)
    for i in range(sets):
        s = float(np.sqrt(sse[i] / 7))
        fit = dataclasses.replace(
            first, y=y[i], estimate=estimates[i], sse=float(sse[i]), s=s, se=first.se * s / first.s
        )
        if i % 1000 == 0:
            again = fit_least_squares(Z, y[i], terms, weights=w, setting_ids=points)
            np.testing.assert_allclose(fit.partial_f([3, 4, 5]).p, again.partial_f([3, 4, 5]).p, rtol=1e-8)
            rows = [(row.f, other.f) for row, other in zip(fit.anova(), again.anova(), strict=True)]
            np.testing.assert_allclose(*np.array(rows).T, rtol=1e-8)
        lof = fit.lack_of_fit()
        assert not isinstance(lof, str)
        groups = ([3, 4, 5], [1, 2], [2], [1, 3, 4])
        p[i] = [*(fit.partial_f(group).p for group in groups), lof.p]
        ratio[i] = lof.f
    for level in (0.01, 0.05, 0.1, 0.5, 0.9):
        np.testing.assert_allclose(np.mean(p < level, axis=0), level, atol=min(0.01, 4 * np.sqrt(level / sets)) + 0.003)
        assert np.max(np.abs(np.mean(p < level, axis=0) - level)) < 4 * np.sqrt(level * (1 - level) / sets)
    # Control: lack of fit tested with the residual's degrees of freedom in place of those of pure error.
    assert abs(np.mean(fdtrc(3, 7, ratio) < 0.05) - 0.05) > 0.01


def test_sequential_f_tests_have_their_size() -> None:
    """Blocks, first order, interactions, squares of the analysis of variance, with days as fixed blocks."""
    rng = np.random.default_rng(9)
    n, sets = 18, 2000
    a, b = rng.uniform(-1, 1, (2, n))
    day = np.arange(n) % 3
    columns, names = block_columns(day.tolist())
    Z = np.column_stack([np.ones(n), a, b, a * b, a * a, b * b, columns])
    kinds = ["intercept", "linear", "linear", "interaction", "square", "square"]
    terms = [*(SimpleNamespace(name=f"z{i}", kind=k) for i, k in enumerate(kinds)), *names]
    p = np.empty((sets, 4))
    for i in range(sets):
        y = 50 + rng.normal(size=n)
        rows = {row.source: row for row in fit_least_squares(Z, y, terms).anova()}
        p[i] = [rows[source].p for source in ("blocks", "first order", "interactions", "squares")]
    for level in (0.05, 0.5):
        assert np.max(np.abs(np.mean(p < level, axis=0) - level)) < 4 * np.sqrt(level * (1 - level) / sets)


def test_natural_coefficients_are_covered() -> None:
    """10 000 data sets: every natural-unit coefficient's interval, within one percent of nominal."""
    factors = (ContinuousFactor("f", 1.0, 18.0, scale="log"), ContinuousFactor("x", 20.0, 70.0))
    model, region = QuadraticModel(factors), Region(factors)
    rng = np.random.default_rng(10)
    points = region.sample(12, rng)
    Z, beta, sets = model.matrix(points), np.array([70.0, 4, -3, 2, -6, -5]), 10_000
    y = Z @ beta + 2.0 * rng.normal(size=(sets, 12))
    first = fit_least_squares(Z, y[0], model.terms)
    natural = first.predict(natural_transform(model), LEVEL)
    estimates = y @ Z @ first.covariance_unscaled
    s = np.sqrt(np.sum((y - estimates @ Z.T) ** 2, axis=1) / 6)
    half = half_width(natural.confidence) / first.s * s[:, None]
    gap = np.abs((estimates - beta) @ natural_transform(model).T)
    error = 4 * np.sqrt(LEVEL * (1 - LEVEL) / sets)
    assert error < 0.01
    np.testing.assert_allclose(np.mean(gap <= half, axis=0), LEVEL, atol=error)
    # Control: the standard errors of the coded coefficients alone, as if T were diagonal.
    wrong = half * (np.abs(np.diagonal(natural_transform(model))) * first.se / natural.se_mean)
    assert np.max(np.abs(np.mean(gap <= wrong, axis=0) - LEVEL)) > 0.01


def test_prediction_in_a_block_already_run_and_in_the_mean_block() -> None:
    """A new run in a block already run, and one in the mean block: fixed block columns, 10 000 data sets."""
    rng = np.random.default_rng(11)
    n, sets = 18, 10_000
    a = rng.uniform(-1, 1, n)
    day = np.arange(n) % 3
    columns, names = block_columns(day.tolist())
    Z = np.column_stack([np.ones(n), a, a * a, columns])
    terms = [SimpleNamespace(name=f"z{i}", kind="linear" if i else "intercept") for i in range(3)]
    beta = np.array([50.0, 3, -4, 2.0, -1.0])
    y = Z @ beta + rng.normal(size=(sets, n))
    first = fit_least_squares(Z, y[0], [*terms, *names])
    estimates = y @ Z @ first.covariance_unscaled
    s = np.sqrt(np.sum((y - estimates @ Z.T) ** 2, axis=1) / first.df_residual)
    for row in (np.array([[1.0, 0.5, 0.25, 1.0, 0.0]]), np.array([[1.0, 0.5, 0.25, 0.0, 0.0]])):
        future = row[0] @ beta + rng.normal(size=(sets, 3)).mean(axis=1)
        half = half_width(first.predict(row, LEVEL, replicates=3).prediction)[0] / first.s * s
        inside = np.mean(np.abs(estimates @ row[0] - future) <= half)
        assert inside == pytest.approx(LEVEL, abs=4 * np.sqrt(LEVEL * (1 - LEVEL) / sets))
