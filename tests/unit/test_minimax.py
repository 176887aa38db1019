"""The descent on the largest prediction variance: its slope, its hills, and the regions and levels it keeps to."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.optimize import minimize

from seqrsm.design import kernels_minimax as kernels
from seqrsm.design.constraints import Constraint
from seqrsm.design.evaluate import largest_variance
from seqrsm.design.factors import CategoricalFactor, ContinuousFactor, DiscreteFactor
from seqrsm.design.minimax import _FINE, MinimaxSearch
from seqrsm.design.optimal import optimal_design
from seqrsm.design.quadratic import QuadraticModel
from seqrsm.design.region import Region


def build(*constraints: str, k: int = 3, category: bool = False) -> tuple[QuadraticModel, Region]:
    factors: tuple = tuple(ContinuousFactor(f"x{i}", -1.0, 1.0) for i in range(k))
    factors += (CategoricalFactor("c", ("u", "v", "w")),) if category else ()
    return QuadraticModel(factors), Region(factors, tuple(Constraint(text) for text in constraints))


def engine(model: QuadraticModel, region: Region) -> MinimaxSearch:
    return MinimaxSearch(model, region, 0.1 * np.eye(model.p), lambda D: largest_variance(model, region, D, 60, 8))


def soft(model, points, rows, power):
    """The soft maximum written out anew."""
    Z = model.matrix(points)
    D = np.linalg.inv(Z.T @ Z + 0.1 * np.eye(model.p))
    return np.log(np.mean(np.sum((rows @ D) * rows, axis=1) ** power)) / power


@pytest.mark.parametrize("category", [False, True])
@pytest.mark.parametrize("power", [4.0, 64.0])
def test_the_slope_is_that_of_differences(power, category) -> None:
    model, region = build(category=category)
    points = region.sample(model.p + 2, np.random.default_rng(1))
    search = engine(model, region)
    base = model.base(points)
    F, slope = np.empty((len(points), model.p)), np.empty((len(points), 3))
    value = kernels.soft_maximum(
        base, search.columns, model.first, model.second, search.precision, search.places, power, F, slope
    )
    assert value == pytest.approx(soft(model, points, search.places, power), rel=1e-7, abs=1e-7)
    for i, j in ((0, 0), (1, 2), (4, 1)):
        ends = []
        for step in (-1e-5, 1e-5):
            moved = points.copy()
            moved[i, j] += step
            ends.append(soft(model, moved, search.places, power))
        assert slope[i, j] == pytest.approx((ends[1] - ends[0]) / 2e-5, rel=1e-4, abs=1e-7)


def test_the_price_of_leaving_a_half_space_and_its_slope() -> None:
    base = np.array([[1.0, 0.5, 0.9], [1.0, -0.5, 0.2]])
    free = np.array([1, 2])
    normals = np.array([[[0.6, 0.8]], [[0.6, 0.8]]])
    slope = np.zeros((2, 2))
    price = kernels.outside(base, free, normals, np.array([[0.5], [0.5]]), 10.0, slope)
    beyond = 0.6 * 0.5 + 0.8 * 0.9 - 0.5
    assert price == pytest.approx(10.0 * beyond**2)
    np.testing.assert_allclose(slope, [[20.0 * beyond * 0.6, 20.0 * beyond * 0.8], [0.0, 0.0]])


def test_the_descent_ends_where_another_minimiser_gains_nothing() -> None:
    model, region = build(k=2)
    search = engine(model, region)
    points = search.lower(region.sample(8, np.random.default_rng(2)), 16.0, (400, 1e-12))
    assert np.max(np.abs(points)) <= 1.0
    reached = soft(model, points, search.places, 16.0)
    other = minimize(
        lambda x: soft(model, x.reshape(points.shape), search.places, 16.0),
        points.ravel(),
        method="L-BFGS-B",
        bounds=[(-1.0, 1.0)] * points.size,
    )
    assert other.fun >= reached - 1e-5


def test_places_climb_to_the_hills_of_the_variance() -> None:
    model, region = build(k=2)
    points = region.sample(9, np.random.default_rng(5))
    Z = model.matrix(points)
    D = np.linalg.inv(Z.T @ Z)
    axis = np.linspace(-1.0, 1.0, 401)
    grid = np.stack([m.ravel() for m in np.meshgrid(axis, axis, indexing="ij")], axis=1)
    rows = model.matrix(grid)
    heights = np.sum((rows @ D) * rows, axis=1)
    starts = model.base(region.candidates(3))
    values = np.empty(len(starts))
    kernels.climb(starts, np.array([1, 2]), model.first, model.second, D, 60, values)
    assert values.max() == pytest.approx(heights.max(), rel=1e-4)
    for base, value in zip(starts, values, strict=True):
        z = base[model.first] * base[model.second]
        assert value == pytest.approx(z @ D @ z, rel=1e-9)
        near = np.max(np.abs(grid - base[1:]), axis=1) < 0.02
        assert value >= heights[near].max() - 1e-9


@pytest.mark.parametrize(
    "constraints", [("x0 + x1 <= 0.4",), ("x0**2 + x1**2 <= 1.2",), ("x0 + x1 <= 0.1", "x0 + x1 >= -0.1")]
)
def test_runs_stay_in_the_region_and_slide_along_its_edge(constraints) -> None:
    model, region = build(*constraints, k=2)
    search = engine(model, region)
    start = region.sample(10, np.random.default_rng(4))
    points = start
    for _ in range(4):  # a curved edge is drawn anew where the runs are
        points = search.lower(points, 16.0, (200, 1e-9))
        assert np.all(region.feasible(points, tol=1e-9))
    assert soft(model, points, search.places, 16.0) < soft(model, start, search.places, 16.0) - 0.05
    if len(constraints) == 1:
        assert np.count_nonzero(region.slack(points) < 1e-3) >= 2


@pytest.mark.parametrize(("rise", "joins"), [(0.5, True), (2e-6, True), (1e-7, False), (-0.5, False)])
def test_places_join_where_the_variance_rises_between_the_others(rise: float, joins: bool) -> None:
    """Under constraints, where the largest variance over the region is higher than at all places judged so far."""
    model, region = build("x0 + x1 <= 0.4", k=2)
    points = region.sample(9, np.random.default_rng(6))
    Z = model.matrix(points)
    covariance = np.linalg.inv(Z.T @ Z + 0.1 * np.eye(model.p))
    between = np.array([[0.11, 0.23], [-0.37, 0.71]])
    asked = []

    def largest(D: np.ndarray) -> tuple[float, np.ndarray]:
        asked.append(D)
        return top * (1.0 + rise), between

    search = MinimaxSearch(model, region, 0.1 * np.eye(model.p), largest)
    before = search.places
    top = float(np.max(np.sum((before @ covariance) * before, axis=1)))
    assert search.value(points, best=0.9 * top) == pytest.approx(top)  # worse than the best: not worth asking
    assert not asked
    assert search.value(points, best=1.1 * top) == pytest.approx(max(top, top * (1.0 + rise)), rel=1e-7)
    np.testing.assert_allclose(asked, [covariance], rtol=1e-6)
    np.testing.assert_array_equal(search.places, np.vstack([before, model.matrix(between)]) if joins else before)


@pytest.mark.parametrize("constraints", [(), ("x0 + x1 <= 0.4",)])
def test_the_highest_places_of_a_box_join_once_the_gaps_of_the_cover_count(constraints, monkeypatch) -> None:
    """From the power that tells which design is better on; under constraints `value` alone adds some."""
    model, region = build(*constraints, k=2)
    search = engine(model, region)
    corners = [[1.0, 1.0], [1.0, -1.0], [1.0, 1.0], [-1.0, 0.9]]
    points = np.array([*corners, [-1.0, -0.5], [0.2, -0.2], [-0.9, 0.0], [-0.4, -0.2]])
    seen = []
    monkeypatch.setattr(kernels, "descend", lambda base, _c, _f, _s, _r, places, *_: seen.append(places))
    for power in (64.0, _FINE, 16384.0):
        search.lower(points, power, (1, 1.0))
    Z = model.matrix(points)
    D = np.linalg.inv(Z.T @ Z + 0.1 * np.eye(model.p))
    fine = model.matrix(region.candidates(81))
    highest = np.max(np.sum((fine @ D) * fine, axis=1))
    tops = [np.max(np.sum((places @ D) * places, axis=1)) for places in seen]
    if not constraints:
        assert tops[0] < 0.9 * highest  # or the test could not tell
        assert tops[1:] == pytest.approx([highest] * 2, rel=1e-3)
    for places in seen if constraints else seen[:1]:
        np.testing.assert_array_equal(places, search.places)


def test_levels_are_exchanged_on_the_largest_variance() -> None:
    factors = (DiscreteFactor("a", (0.0, 1.0, 2.0)), DiscreteFactor("b", (0.0, 1.0, 2.0)))
    model, region = QuadraticModel(factors), Region(factors)
    design = optimal_design(model, region, 9, "G", seed=0, starts=8)
    # The full factorial is among the designs of nine runs.
    Z = model.matrix(region.candidates(3))
    whole = float(np.max(np.sum((Z @ np.linalg.inv(Z.T @ Z)) * Z, axis=1)))
    assert design.value <= whole * (1.0 + 1e-9)
    assert np.all(region.feasible(design.points))


def test_the_same_seed_gives_the_same_design_and_hits_are_counted() -> None:
    model, region = build(k=2)
    one, other = (optimal_design(model, region, 9, "G", seed=7) for _ in range(2))
    np.testing.assert_array_equal(one.points, other.points)
    assert 1 <= one.hits <= one.starts
