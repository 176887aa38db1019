"""Confidence regions of the optimum's location: published figures, closed forms and coverage by Monte Carlo."""

from __future__ import annotations

import dataclasses
import json
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from scipy import stats

from seqrsm.design.constraints import Constraint
from seqrsm.design.factors import CategoricalFactor, ContinuousFactor
from seqrsm.design.quadratic import QuadraticModel
from seqrsm.design.region import Region
from seqrsm.errors import FitError
from seqrsm.fit.conjugate import posterior
from seqrsm.fit.least_squares import LeastSquaresFit, fit_least_squares
from seqrsm.fit.location import (
    best_settings,
    box_hunter_contains,
    box_hunter_region,
    box_hunter_statistic,
    gradient_rows,
    location_region,
    simulation_set,
)

DATA = Path(__file__).parents[1] / "reference" / "data" / "rsm"
LEVEL = 0.9
SQUARE = (ContinuousFactor("a", -1.0, 1.0), ContinuousFactor("b", -1.0, 1.0))
MODEL, BOX = QuadraticModel(SQUARE), Region(SQUARE)
# a*b before the squares; the stationary point of 70 + 2a - b + ab - 4a^2 - 3b^2 solves 8a - b = 2, -a + 6b = -1.
BETA = np.array([70.0, 2.0, -1.0, 1.0, -4.0, -3.0])
STATIONARY = np.linalg.solve([[8.0, -1.0], [-1.0, 6.0]], [2.0, -1.0])
CORNER = np.array([70.0, 4.0, 5.0, 0.5, -1.0, -1.0])  # best at (1, 1): the gradient there is (2.5, 3.5)


def design(n: int = 14) -> np.ndarray:
    grid = np.array([(a, b) for a in (-1.0, 0.0, 1.0) for b in (-1.0, 0.0, 1.0)])
    return np.vstack([grid, np.zeros((n - 9, 2))])


def data_sets(
    beta: np.ndarray, sets: int, sigma: float = 1.5, seed: int = 0
) -> tuple[LeastSquaresFit, np.ndarray, np.ndarray]:
    """A fit, and the estimates (sets, 6) and s (sets,) of many data sets on the same design."""
    points = design()
    Z = MODEL.matrix(points)
    rng = np.random.default_rng(seed)
    y = Z @ beta + sigma * rng.normal(size=(sets, len(points)))
    fit = fit_least_squares(Z, y[0], MODEL.terms)
    estimates = y @ Z @ fit.covariance_unscaled
    s = np.sqrt(np.sum((y - estimates @ Z.T) ** 2, axis=1) / fit.df_residual)
    return fit, estimates, s


def near(level: float, sets: int, width: float = 4.0) -> float:
    return width * float(np.sqrt(level * (1 - level) / sets))


def test_gradient_by_finite_differences() -> None:
    factors = (*SQUARE, CategoricalFactor("c", ("u", "v", "w")))
    model = QuadraticModel(factors)
    rng = np.random.default_rng(0)
    points = np.column_stack([rng.uniform(-1, 1, (20, 2)), rng.integers(3, size=20)])
    D = gradient_rows(model, points)
    for j in range(2):
        step = np.zeros(3)
        step[j] = 1e-4
        slope = (model.matrix(points + step) - model.matrix(points - step)) / 2e-4
        np.testing.assert_allclose(D[:, j], slope, atol=1e-10)


def test_box_hunter_statistic_of_the_chemical_process() -> None:
    table = pd.read_csv(DATA / "chemical.csv")
    want = json.loads((DATA / "chemical_expected.json").read_text())
    points = table[["x1", "x2"]].to_numpy(float)
    fit = fit_least_squares(MODEL.matrix(points), table["y"].to_numpy(float), MODEL.terms)
    at = np.array([want["stationary_point"], [0.0, 0.0], [1.0, 1.0]])
    found = box_hunter_statistic(MODEL, fit, at)
    published = want["box_hunter_statistic"]
    assert found[0] < 1e-20
    np.testing.assert_allclose(found[1:], [published["origin"], published["one"]], rtol=1e-11)
    np.testing.assert_array_equal(box_hunter_contains(MODEL, fit, at), [True, False, False])


def test_box_hunter_region_covers_as_stated() -> None:
    sets = 10_000
    fit, estimates, s = data_sets(BETA, sets)
    statistic = np.array(
        [
            box_hunter_statistic(MODEL, dataclasses.replace(fit, estimate=e, s=float(v)), STATIONARY)[0]
            for e, v in zip(estimates, s, strict=True)
        ]
    )
    limit = stats.f(2, fit.df_residual).ppf(LEVEL)
    assert np.mean(statistic <= limit) == pytest.approx(LEVEL, abs=near(LEVEL, sets))
    # Controls: the normal limit, and the point one standard error away, must be seen.
    assert abs(np.mean(statistic <= stats.chi2(2).ppf(LEVEL) / 2) - LEVEL) > 0.01


@pytest.mark.parametrize(("beta", "best"), [(BETA, STATIONARY), (CORNER, np.array([1.0, 1.0]))])
def test_regions_of_the_bounded_optimum_cover_at_least_as_stated(beta: np.ndarray, best: np.ndarray) -> None:
    sets = 3000
    fit, estimates, s = data_sets(beta, sets, seed=1)
    test = best_settings(MODEL, BOX, fit, level=LEVEL, n_against=150)
    critical = test.critical_value(best)
    assert critical < test.scheffe
    statistic = np.array(
        [
            dataclasses.replace(test, fit=dataclasses.replace(fit, estimate=e, s=float(v))).statistic(best)[0]
            for e, v in zip(estimates, s, strict=True)
        ]
    )
    simulated, scheffe = np.mean(statistic <= critical), np.mean(statistic <= test.scheffe)
    assert LEVEL - near(LEVEL, sets) < simulated <= scheffe
    # Control: a constant half as large misses the best settings too often, where their own gradient vanishes.
    if np.all(np.abs(best) < 1.0):
        assert np.mean(statistic <= 0.5 * critical) < LEVEL - near(LEVEL, sets)


def test_statistic_by_hand() -> None:
    """The largest of (z - z0)'b / (s sqrt((z - z0)' C (z - z0))), one setting after the other."""
    fit, _, _ = data_sets(BETA, 1)
    test = best_settings(MODEL, BOX, fit, "minimize", n_against=50)
    x0 = np.array([0.3, -0.7])
    z0 = MODEL.matrix(x0)[0]
    values = []
    near = x0 + 0.1 * (test.nearby - x0)
    for z in MODEL.matrix(np.vstack([test.against, near])):
        d = z - z0
        values.append(-d @ fit.estimate / (fit.s * np.sqrt(d @ fit.covariance_unscaled @ d)))
    assert test.statistic(x0)[0] == pytest.approx(max(values), rel=1e-9)
    assert test.scheffe == pytest.approx(np.sqrt(5 * stats.f(5, fit.df_residual).ppf(0.95)), rel=1e-10)


def test_region_holds_the_estimate_and_ranges_hold_the_region() -> None:
    fit, _, _ = data_sets(BETA, 1)
    test = best_settings(MODEL, BOX, fit, level=LEVEL, n_against=300)
    large, small = location_region(test), location_region(test, "simulated", n_points=400)
    assert 0.0 < small.share <= large.share < 1.0
    for found in (large, small):
        assert BOX.feasible(found.points).all()
        for j, extent in enumerate(found.ranges):
            assert extent.low == found.points[:, j].min()
            assert extent.low <= np.linalg.solve([[8.0, -1.0], [-1.0, 6.0]], [2.0, -1.0])[j] <= extent.high
    assert test.contains(large.points).all()
    # A fine grid finds nothing beyond the ranges but for the grid's own step.
    grid = np.stack(np.meshgrid(*[np.linspace(-1, 1, 81)] * 2), axis=-1).reshape(-1, 2)
    kept = grid[test.contains(grid)]
    for j, extent in enumerate(large.ranges):
        assert extent.low < kept[:, j].min() + 0.02
        assert extent.high > kept[:, j].max() - 0.02


def test_simulation_set_covers_per_factor() -> None:
    sets = 400
    fit, estimates, s = data_sets(BETA, sets, seed=4)
    rng = np.random.default_rng(5)
    inside = np.empty((sets, 2))
    for i in range(sets):
        sigma = s[i] * np.sqrt(fit.df_residual / rng.chisquare(fit.df_residual, 500))
        betas = estimates[i] + sigma[:, None] * (rng.normal(size=(500, 6)) @ fit.factor.T)
        ranges = simulation_set(MODEL, BOX, betas, level=LEVEL).ranges
        inside[i] = [r.low <= x <= r.high for r, x in zip(ranges, STATIONARY, strict=True)]
    assert np.all(np.mean(inside, axis=0) > LEVEL - near(LEVEL, sets, 3.0))


def test_mixed_constrained_region_and_blocks() -> None:
    factors = (
        ContinuousFactor("a", 1.0, 3.0),
        CategoricalFactor("c", ("u", "v", "w")),
        ContinuousFactor("b", 0.0, 2.0),
    )
    model, region = QuadraticModel(factors), Region(factors, (Constraint("a + b <= 4"),))
    rng = np.random.default_rng(6)
    points = region.sample(40, rng)
    day = np.repeat([1.0, -1.0], 20)
    y = 50 + 3.0 * (points[:, 1] == 1) - 4 * points[:, 0] ** 2 + 5 * day + 0.3 * rng.normal(size=40)
    fit = fit_least_squares(np.column_stack([model.matrix(points), day]), y, [*model.terms, "day"])
    test = best_settings(model, region, fit, n_against=300)
    found = location_region(test, n_points=500)
    assert region.feasible(found.points, 1e-6).all()
    assert found.ranges[1].levels == ("v",)
    assert found.ranges[0].low_natural < 2.0 < found.ranges[0].high_natural
    hunter = box_hunter_region(model, region, fit, (1,))
    assert (hunter.points[:, 1] == 1).all()
    draws, _ = posterior(fit.Z, y).draws(400, rng)
    cloud = simulation_set(model, region, draws[:, : model.p])
    assert cloud.ranges[1].levels == ("v",)


def test_no_error_estimate_no_region() -> None:
    Z = MODEL.matrix(design(9)[[0, 1, 2, 3, 4, 8]])
    fit = fit_least_squares(Z, np.arange(6.0), MODEL.terms)
    for asked in (lambda: best_settings(MODEL, BOX, fit), lambda: box_hunter_statistic(MODEL, fit, np.zeros((1, 2)))):
        with pytest.raises(FitError, match="no confidence region"):
            asked()
