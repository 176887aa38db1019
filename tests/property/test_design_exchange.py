from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest
from short_search import optimal_design

from seqrsm.design import exchange
from seqrsm.design.constraints import Constraint
from seqrsm.design.evaluate import evaluate_design, inestimable_terms, prediction_variance, region_moments
from seqrsm.design.factors import CategoricalFactor, ContinuousFactor, DiscreteFactor
from seqrsm.design.optimal import start_design
from seqrsm.design.quadratic import QuadraticModel
from seqrsm.design.region import Region
from seqrsm.errors import DesignError

MIXED = (
    ContinuousFactor("frequency", 1.2, 17.0, "GHz", "log"),
    DiscreteFactor("looks", (1, 2, 4, 8, 16), scale="log"),
    CategoricalFactor("polarization", ("HH", "VV", "HV")),
    ContinuousFactor("resolution", 3.0, 50.0, "m", "log"),
)
LOOKS = Constraint("looks <= 4 * (resolution / 12.1) ** 2")
MODEL = QuadraticModel(MIXED)
PLANE = tuple(ContinuousFactor(name, -1.0, 1.0) for name in "xy")


def log_det(model, points, prior=0.0):
    Z = model.matrix(points)
    return float(np.linalg.slogdet(Z.T @ Z + prior)[1])


@pytest.mark.parametrize("criterion", ["D", "I", "A"])
def test_no_single_move_improves_a_mixed_design(criterion):
    """An optimal design is a local optimum: no change of one coordinate of one run, over a fine grid, does better."""
    region = Region(MIXED)
    design = optimal_design(MODEL, region, MODEL.p + 2, criterion, seed=5, starts=20)
    assert np.all(region.feasible(design.points, tol=0.0))
    W = np.eye(MODEL.p) if criterion == "A" else region_moments(MODEL, region)

    def loss(points):
        Z = MODEL.matrix(points)
        return -log_det(MODEL, points) if criterion == "D" else float(np.sum(np.linalg.inv(Z.T @ Z) * W))

    best = loss(design.points)
    for i in range(design.points.shape[0]):
        for j, levels in enumerate(region.axes):
            for value in np.linspace(-1.0, 1.0, 21) if levels is None else levels:
                moved = design.points.copy()
                moved[i, j] = value
                assert loss(moved) >= best - 1e-6 * abs(best), (i, j, value)


@pytest.mark.parametrize("weighted", [False, True])
def test_rows_are_exchanged_as_by_trying_each(weighted, monkeypatch) -> None:
    """Against the determinant, or the trace, of every design that differs by one row."""
    model, region = MODEL, Region(MIXED)
    monkeypatch.setattr(exchange, "_MAX_PASSES", 2)
    candidates = region.candidates(3)
    rows, rng = model.matrix(candidates), np.random.default_rng(5)
    weight = region_moments(model, region) if weighted else None
    task = exchange.Task(model.p + 5, 1e-2 * np.eye(model.p), weight)
    points = candidates[rng.choice(len(candidates), task.n)]
    tried = points.copy()
    for _ in range(2):
        for i in range(task.n):
            before = task.value(model.matrix(tried))
            values = []
            for candidate in candidates:
                other = tried.copy()
                other[i] = candidate
                values.append(task.value(model.matrix(other)))
            if max(values) > before + 1e-9:
                tried[i] = candidates[int(np.argmax(np.array(values) > max(values) - 1e-9))]
    exchange._exchange(points, model.matrix(points), candidates, rows, task, -np.inf)
    np.testing.assert_array_equal(points, tried)


@pytest.mark.parametrize("weighted", [False, True])
def test_the_slope_of_the_loss_is_that_of_differences(weighted) -> None:
    region, points = Region(MIXED), start_design(MODEL, Region(MIXED), 24, seed=2)
    points[:, [0, 3]] = np.clip(points[:, [0, 3]], -0.8, 0.8)
    task = exchange.Task(24, np.zeros((MODEL.p, MODEL.p)), region_moments(MODEL, region) if weighted else None)
    value, slope = task.loss(MODEL, region, points)
    assert value == pytest.approx(-task.value(MODEL.matrix(points)))
    assert slope.shape == (24, 2)
    for column, factor in enumerate((0, 3)):
        for run in range(0, 24, 5):
            ends = []
            for step in (-1e-5, 1e-5):
                moved = points.copy()
                moved[run, factor] += step
                ends.append(task.loss(MODEL, region, moved)[0])
            assert slope[run, column] == pytest.approx((ends[1] - ends[0]) / 2e-5, rel=1e-4, abs=1e-6)


def test_a_descent_that_goes_astray_is_not_followed(monkeypatch) -> None:
    """Within constraints SLSQP may end where terms coincide."""
    region, points = Region(MIXED), start_design(MODEL, Region(MIXED), 24, seed=2)
    task = exchange.Task(24, np.zeros((MODEL.p, MODEL.p)), None)
    value, moved = exchange._descended(MODEL, region, task, points)
    assert value == pytest.approx(log_det(MODEL, moved))
    assert value > log_det(MODEL, points)
    same = np.tile(points[0, list(region.continuous)], len(points))
    monkeypatch.setattr("scipy.optimize.minimize", lambda *_, **__: SimpleNamespace(x=same))
    value, kept = exchange._descended(MODEL, region, task, points)
    np.testing.assert_array_equal(kept, points)
    assert value == pytest.approx(log_det(MODEL, points))


def test_the_same_seed_gives_the_same_design():
    region = Region(MIXED)
    one, two = (optimal_design(MODEL, region, 22, seed=9, starts=20).points for _ in range(2))
    np.testing.assert_array_equal(one, two)


def test_symmetries_of_the_cube_leave_the_value():
    model = QuadraticModel(tuple(ContinuousFactor(f"x{i}", 0.0, 1.0) for i in range(3)))
    design = optimal_design(model, Region(model.factors), 12)
    turned = design.points[:, [2, 0, 1]] * np.array([1.0, -1.0, 1.0])
    assert log_det(model, turned) == pytest.approx(log_det(model, design.points), abs=1e-9)


def test_units_and_level_names_do_not_matter():
    other = (
        ContinuousFactor("a", 0.0, 1.0),
        DiscreteFactor("b", (10.0, 20.0, 30.0, 40.0, 50.0)),
        CategoricalFactor("c", ("x", "y", "z")),
        ContinuousFactor("d", -5.0, 5.0),
    )
    one = optimal_design(MODEL, Region(MIXED), 20, starts=60)
    model = QuadraticModel(other)
    two = optimal_design(model, Region(other), 20, starts=60)
    # Coded levels differ in the last digit, which may lead to another of many designs that are as good.
    assert log_det(model, two.points) == pytest.approx(log_det(MODEL, one.points), abs=0.01 * MODEL.p)


def test_constrained_designs_are_feasible_and_locally_optimal():
    region = Region(MIXED, (LOOKS,))
    design = optimal_design(MODEL, region, MODEL.p + 2, seed=1, starts=4)
    assert np.all(region.feasible(design.points, tol=0.0))
    candidates = region.sample(300, np.random.default_rng(0))
    for i in range(design.points.shape[0]):
        for candidate in candidates:
            moved = design.points.copy()
            moved[i] = candidate
            assert log_det(MODEL, moved) <= log_det(MODEL, design.points) + 1e-3
    # The box allows more: its optimum is an upper bound.
    free = optimal_design(MODEL, Region(MIXED), MODEL.p + 2, starts=100)
    assert log_det(MODEL, design.points) <= log_det(MODEL, free.points)


def test_d_optimal_first_order_design_on_a_triangle_is_its_corners():
    region = Region(PLANE, (Constraint("x + y <= 0"),))
    model = QuadraticModel(PLANE, order=1)
    design = optimal_design(model, region, 3)
    corners = {tuple(np.round(point, 9) + 0.0) for point in design.points}
    assert corners == {(-1.0, -1.0), (1.0, -1.0), (-1.0, 1.0)}
    # |Z'Z| = (2 * area)^2 = 4^2.
    assert log_det(model, design.points) == pytest.approx(np.log(16.0), abs=1e-9)


def test_i_optimality_on_a_disc_uses_its_moments():
    region = Region(PLANE, (Constraint("x**2 + y**2 <= 0.64"),))
    model = QuadraticModel(PLANE)
    W = region_moments(model, region)
    # On a disc of radius R: E x^2 = R^2/4, E x^4 = R^4/8, E x^2 y^2 = R^4/24.
    names = list(model.term_names)
    x2, y2, xy = names.index("x^2"), names.index("y^2"), names.index("x:y")
    assert W[0, x2] == pytest.approx(0.16, rel=2e-3)
    assert W[x2, x2] == pytest.approx(0.4096 / 8.0, rel=3e-3)
    assert W[x2, y2] == pytest.approx(0.4096 / 24.0, rel=3e-3)
    assert W[xy, xy] == pytest.approx(0.4096 / 24.0, rel=3e-3)
    design = optimal_design(model, region, 8, "I", starts=6)
    assert np.all(np.hypot(*design.points.T) <= 0.8 + 1e-12)


def test_box_moments_are_the_mean_over_a_fine_crossing():
    region = Region(MIXED)
    nodes, weights = np.polynomial.legendre.leggauss(3)
    rows, mass = [], []
    for a, wa in zip(nodes, weights / 2.0, strict=True):
        for d, wd in zip(nodes, weights / 2.0, strict=True):
            for b in MIXED[1].coded_levels:
                for c in range(3):
                    rows.append((a, b, c, d))
                    mass.append(wa * wd / 15.0)
    Z = MODEL.matrix(np.array(rows))
    np.testing.assert_allclose(region_moments(MODEL, region), Z.T @ (Z * np.array(mass)[:, None]), atol=1e-15)


def test_fewer_runs_than_terms_need_fixed_runs():
    region = Region(MIXED)
    with pytest.raises(DesignError, match=r"17 runs cannot estimate 18 terms"):
        optimal_design(MODEL, region, 17)
    fixed = region.sample(12, np.random.default_rng(3))
    added = optimal_design(MODEL, region, 6, fixed=fixed, starts=10).points
    assert np.linalg.matrix_rank(MODEL.matrix(np.vstack([fixed, added]))) == 18


def test_terms_that_no_runs_can_separate_are_named():
    region = Region(PLANE, (Constraint("x - y <= 0"), Constraint("y - x <= 0")))
    with pytest.raises(DesignError) as caught:
        optimal_design(QuadraticModel(PLANE), region, 8)
    assert "y, x^2, y^2" in str(caught.value)
    with pytest.raises(DesignError) as caught:
        start_design(QuadraticModel(PLANE), region, 12)
    assert "y, x^2, y^2" in str(caught.value)


@pytest.mark.parametrize("constraints", [(), (LOOKS,)])
def test_the_start_design_has_its_centre_repeats(constraints):
    region = Region(MIXED, constraints)
    points = start_design(MODEL, region, MODEL.p + 6, seed=2)
    assert points.shape == (24, 4)
    assert np.all(region.feasible(points))
    np.testing.assert_array_equal(points[:3], np.tile(region.centre(), (3, 1)))
    report = evaluate_design(MODEL, region, points)
    assert np.linalg.matrix_rank(MODEL.matrix(points)) == MODEL.p
    assert report.df_pure_error >= 2
    assert report.condition_number < 30.0
    with pytest.raises(DesignError):
        start_design(MODEL, region, 3)


@pytest.mark.parametrize(("k", "efficiency"), [(2, 0.86), (3, 0.8), (4, 0.75), (5, 0.7), (6, 0.68)])
def test_a_quarter_of_a_start_design_lies_between_its_edges_and_the_centre(k, efficiency):
    """Against an optimal design of as many runs, by the volume of the coefficients' region and by predictions."""
    factors = tuple(ContinuousFactor(f"x{j}", -1.0, 1.0) for j in range(k))
    model, region = QuadraticModel(factors), Region(factors)
    n = model.p + 6
    points = start_design(model, region, n, 3, seed=1)
    around = points[3:]
    inner = np.max(np.abs(around), axis=1) <= 0.5
    assert np.sum(inner) == (n - 3) // 4
    np.testing.assert_array_equal(np.unique(np.abs(around[~inner])), [0.0, 1.0])
    best = optimal_design(model, region, n - 3, seed=1, fixed=points[:3]).points
    best = np.vstack([points[:3], best])
    Z = model.matrix(points)
    assert np.linalg.slogdet(Z.T @ Z)[1] >= log_det(model, best) + model.p * np.log(efficiency)
    # Edges and centre alone cannot tell a third power from a slope.
    assert all(np.linalg.matrix_rank(np.column_stack([Z, points[:, j] ** 3])) == model.p + 1 for j in range(k))
    # What that costs where an optimum is sought: the standard error of a mean is a fifth larger at most.
    inside = np.random.default_rng(0).uniform(-0.7, 0.7, (2000, k))
    of_both = [np.sqrt(np.mean(prediction_variance(model, each, inside) / n)) for each in (points, best)]
    assert of_both[0] < 1.2 * of_both[1]


def test_a_run_is_drawn_in_only_where_the_region_allows_it():
    """Looks times cell area bounded: half-way to the centre may lie outside a region that is not convex."""
    region = Region(MIXED, (LOOKS,))
    points = start_design(MODEL, region, MODEL.p + 6, seed=4)
    assert np.all(region.feasible(points))
    assert np.linalg.matrix_rank(MODEL.matrix(points)) == MODEL.p
    of_levels = tuple(DiscreteFactor(f"x{j}", (1.0, 2.0, 4.0)) for j in range(2))
    model = QuadraticModel(of_levels)
    assert set(np.abs(start_design(model, Region(of_levels), 12, 3, 1)).ravel().round(9)) <= set(
        np.abs(Region(of_levels).candidates()).ravel().round(9)
    )


def test_what_is_missing_of_a_start_design_goes_well_with_what_is_made():
    region = Region(MIXED)
    made = start_design(MODEL, region, MODEL.p + 6, seed=2)[:10]
    more = start_design(MODEL, region, MODEL.p + 6, seed=3, fixed=made)
    assert more.shape == (14, 4)
    assert evaluate_design(MODEL, region, np.vstack([made, more])).condition_number < 30.0


def test_terms_that_points_cannot_tell_are_named():
    corners = np.array([[-1.0, -1.0], [1.0, -1.0], [-1.0, 1.0], [1.0, 1.0], [0.0, 0.0]])
    assert inestimable_terms(QuadraticModel(PLANE), corners) == ("y^2",)


def test_leverages_sum_to_the_number_of_terms():
    region = Region(MIXED)
    points = region.sample(40, np.random.default_rng(8))
    report = evaluate_design(MODEL, region, points)
    assert report.leverage.sum() == pytest.approx(MODEL.p, rel=1e-12)
    np.testing.assert_allclose(prediction_variance(MODEL, points, points) / 40.0, report.leverage, rtol=1e-9)
    sample = region.sample(20_000, np.random.default_rng(1))
    assert report.i_value == pytest.approx(prediction_variance(MODEL, points, sample).mean(), rel=0.03)
    assert np.all(np.diff(report.fraction_of_design_space) >= 0.0)


def test_figures_of_a_factorial_twice_by_hand():
    """Z'Z is 8 times the identity: each coefficient has a variance of 1/8, the mean of a response of 1/8 (1 + 2/3)."""
    corners = np.array([[a, b] for a in (-1.0, 1.0) for b in (-1.0, 1.0)] * 2)
    report = evaluate_design(QuadraticModel(PLANE, 1), Region(PLANE), corners)
    assert (report.d_value, report.a_value, report.i_value) == pytest.approx((1.0, 1.0, 5.0 / 3.0))
    assert (report.condition_number, report.n_distinct, report.df_pure_error) == (pytest.approx(1.0), 4, 4)
    np.testing.assert_allclose(report.leverage, 3.0 / 8.0)


def test_random_starts_that_are_singular_lead_to_the_same_design_as_others():
    """With eight levels and a constraint most random starts cannot determine the model, some but for rounding."""
    factors = (CategoricalFactor("channels", tuple("abcdefgh")), *MIXED[1:2], MIXED[3])
    region = Region(factors, (LOOKS,))
    model = QuadraticModel(factors)
    centre = np.tile(region.centre(), (3, 1))
    found = [optimal_design(model, region, 30, seed=seed, starts=1, fixed=centre) for seed in range(12)]
    values = np.exp([log_det(model, np.vstack([centre, design.points])) / model.p for design in found])
    assert np.all(values > 0.97 * np.max(values)), values
    assert all(np.linalg.matrix_rank(model.matrix(design.points)) == model.p for design in found)


@pytest.mark.parametrize(("k", "n", "levels"), [(1, 5, 2001), (2, 9, 201), (3, 16, 41), (6, 36, 5)])
def test_the_largest_prediction_variance_is_that_of_the_whole_region(k, n, levels):
    """Of 10,000 random points hardly one lies near a corner: with six factors it was told as less than half."""
    factors = tuple(ContinuousFactor(f"x{i}", -1.0, 1.0) for i in range(k))
    points = np.clip(np.random.default_rng(k).uniform(-1.6, 1.6, (n, k)), -1.0, 1.0)
    grid = np.array(np.meshgrid(*[np.linspace(-1.0, 1.0, levels)] * k)).reshape(k, -1).T

    def rows(x):
        i, j = np.triu_indices(k)
        return np.column_stack([np.ones(len(x)), x, x[:, i] * x[:, j]])

    covariance = np.linalg.inv(rows(points).T @ rows(points))
    largest = n * np.max(np.sum(rows(grid) @ covariance * rows(grid), axis=1))
    told = evaluate_design(QuadraticModel(factors), Region(factors), points).fraction_of_design_space
    assert told[-1] == pytest.approx(largest, rel=0.01)
    assert np.all(np.diff(told) >= 0.0)
