"""Coverage of the intervals and size of the F tests by Monte Carlo, each with a control that must fail."""

from __future__ import annotations

from functools import cache
from types import SimpleNamespace

import numpy as np
import pytest

from seqrsm.fit.intervals import student_quantile
from seqrsm.fit.least_squares import LeastSquaresFit, fit_least_squares

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
    half = one.confidence.half_width[0] / fit.s * s
    inside = np.abs((estimates - beta) @ ROW[0]) <= half
    assert np.mean(inside) == pytest.approx(LEVEL, abs=ERROR)


@pytest.mark.parametrize(("weight", "replicates"), [(1.0, 1), (1.0, 5), (2.5, 1), (0.4, 3)])
@pytest.mark.parametrize("n", [8, 12, 40])
def test_prediction_interval_covers_the_mean_of_future_runs(n: int, weight: float, replicates: int) -> None:
    fit, _, estimates, s, beta = study(n)
    rng = np.random.default_rng(1000 + n)
    future = ROW[0] @ beta + 2.0 / np.sqrt(weight) * rng.normal(size=(SETS, replicates)).mean(axis=1)
    half = fit.predict(ROW, LEVEL, weight, replicates).prediction.half_width[0] / fit.s * s
    assert np.mean(np.abs(future - estimates @ ROW[0]) <= half) == pytest.approx(LEVEL, abs=ERROR)


def test_the_study_sees_a_wrong_interval() -> None:
    """Dropping the 1 under the root of eq. 2-23, its S, or the degrees of freedom must show."""
    fit, _, estimates, s, beta = study(12)
    future = ROW[0] @ beta + 2.0 * np.random.default_rng(5).normal(size=SETS)
    gap = np.abs(future - estimates @ ROW[0])
    h = fit.variance_unscaled(ROW)[0]
    t = student_quantile(6, LEVEL)
    assert np.mean(gap <= t * s * np.sqrt(1 + h)) == pytest.approx(LEVEL, abs=ERROR)
    for wrong in (t * s * np.sqrt(h), t * np.sqrt(1 + h), 1.96 * s * np.sqrt(1 + h)):
        assert abs(np.mean(gap <= wrong) - LEVEL) > 0.01


def test_sizes_of_the_f_tests() -> None:
    """Under the null the p values are uniform: their deciles are right within four standard errors."""
    rng = np.random.default_rng(8)
    points = [(a, b) for a in (-1.0, 0.0, 1.0) for b in (-1.0, 0.0, 1.0)] + [(0.0, 0.0)] * 4
    a, b = np.array(points).T
    Z = np.column_stack([np.ones(13), a, b, a * b, a * a, b * b])
    kinds = ["intercept", "linear", "linear", "interaction", "square", "square"]
    terms = [SimpleNamespace(name=f"z{i}", kind=k) for i, k in enumerate(kinds)]
    sets = 1500
    p = np.empty((sets, 2))
    for i in range(sets):
        fit = fit_least_squares(Z, 50 + 3 * a + rng.normal(size=13), terms, setting_ids=points)
        lof = fit.lack_of_fit()
        assert not isinstance(lof, str)
        p[i] = fit.partial_f([3, 4, 5]).p, lof.p
    for level in (0.05, 0.1, 0.5, 0.9):
        error = 4 * np.sqrt(level * (1 - level) / sets)
        np.testing.assert_allclose(np.mean(p < level, axis=0), level, atol=error)
