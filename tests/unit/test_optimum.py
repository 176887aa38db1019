"""The optimum over box, levels and constraints against closed forms, enumeration and dense scans."""

from __future__ import annotations

from itertools import product

import numpy as np
import pytest

from seqrsm.design.constraints import Constraint
from seqrsm.design.factors import CategoricalFactor, ContinuousFactor, DiscreteFactor
from seqrsm.design.quadratic import QuadraticModel, Quadratics
from seqrsm.design.region import Region
from seqrsm.fit import constrained
from seqrsm.fit.constrained import climb, polish, retract
from seqrsm.fit.faces import cube_maxima
from seqrsm.fit.optimum import at_bound, optimum, optimum_draws


def cube(k: int, *constraints: str) -> tuple[QuadraticModel, Region]:
    factors = tuple(ContinuousFactor(f"x{i}", -1.0, 1.0) for i in range(k))
    return QuadraticModel(factors), Region(factors, tuple(Constraint(c) for c in constraints))


def beta_of(model: QuadraticModel, c: float, b: np.ndarray, B: np.ndarray) -> np.ndarray:
    """Coefficients of c + x'b + x'Bx in the model's order of terms."""
    beta = np.zeros(model.p)
    names = {f.name: i for i, f in enumerate(model.factors)}
    for t, term in enumerate(model.terms):
        index = [names[name] for name in term.factors]
        if term.kind == "intercept":
            beta[t] = c
        elif term.kind == "linear":
            beta[t] = b[index[0]]
        elif term.kind == "square":
            beta[t] = B[index[0], index[0]]
        else:
            beta[t] = 2.0 * B[index[0], index[1]]
    return beta


def mixed() -> tuple[QuadraticModel, tuple]:
    factors = (
        ContinuousFactor("a", 1.0, 10.0, scale="log"),
        CategoricalFactor("e", ("u", "v", "w")),
        ContinuousFactor("b", 0.0, 5.0),
        DiscreteFactor("d", (1.0, 2.0, 4.0, 8.0), scale="log"),
        DiscreteFactor("g", (0.0, 1.0)),
    )
    return QuadraticModel(factors), factors


@pytest.mark.parametrize("face", list(product((-1, 0, 1), repeat=4)))
def test_maximum_on_every_face_of_the_cube(face: tuple[int, ...]) -> None:
    # -|x - t|^2 with t beyond the bounds in the fixed coordinates: the maximum is the projection of t.
    model, region = cube(4)
    target = np.array([2.0 * f if f else 0.3 for f in face])
    expected = np.clip(target, -1.0, 1.0)
    found = optimum(model, region, beta_of(model, -target @ target, 2.0 * target, -np.eye(4)))
    np.testing.assert_allclose(found.point, expected, atol=1e-12)
    assert found.value == pytest.approx(-np.sum((expected - target) ** 2), abs=1e-12)
    assert len(found.at_bound) == sum(f != 0 for f in face)
    assert found.exact
    assert not found.flat
    assert len(found.ties) == 0


def test_interior_maximum_is_the_solution_of_the_normal_equations() -> None:
    model, region = cube(2)
    B = np.array([[-2.0, 0.5], [0.5, -1.0]])
    b = np.array([0.4, -0.6])
    found = optimum(model, region, beta_of(model, 3.0, b, B))
    np.testing.assert_allclose(found.point, np.linalg.solve(-2.0 * B, b), atol=1e-13)
    assert found.at_bound == {}


def test_minimum_is_the_maximum_of_the_negative() -> None:
    model, factors = mixed()
    region = Region(factors)
    beta = np.random.default_rng(1).normal(size=model.p)
    low, high = optimum(model, region, beta, "minimize"), optimum(model, region, -beta)
    np.testing.assert_array_equal(low.point, high.point)
    assert low.value == -high.value
    assert low.value == pytest.approx(float((model.matrix(low.point[None, :]) @ beta)[0]), abs=1e-12)


def test_all_discrete_region_equals_enumeration() -> None:
    factors = (
        DiscreteFactor("d", (1.0, 2.0, 5.0)),
        CategoricalFactor("e", ("u", "v", "w")),
        DiscreteFactor("g", (0.0, 1.0, 3.0, 9.0)),
    )
    model, region = QuadraticModel(factors), Region(factors)
    points = np.array(list(product(factors[0].coded_levels, range(3), factors[2].coded_levels)))
    Z = model.matrix(points)
    for seed in range(20):
        beta = np.random.default_rng(seed).normal(size=model.p)
        found = optimum(model, region, beta)
        assert found.value == pytest.approx((Z @ beta).max(), abs=1e-12)
        np.testing.assert_array_equal(found.point, points[np.argmax(Z @ beta)])


def test_first_order_surface_has_its_optimum_at_a_vertex() -> None:
    factors = tuple(ContinuousFactor(f"x{i}", -1.0, 1.0) for i in range(3))
    model, region = QuadraticModel(factors, order=1), Region(factors)
    found = optimum(model, region, np.array([5.0, 1.0, -2.0, 0.5]))
    np.testing.assert_array_equal(found.point, [1.0, -1.0, 1.0])
    assert found.value == pytest.approx(8.5)
    assert found.at_bound == {"x0": "high", "x1": "low", "x2": "high"}


def test_saddle_reports_both_corners() -> None:
    model, region = cube(2)
    found = optimum(model, region, beta_of(model, 0.0, np.zeros(2), np.array([[0.0, 1.0], [1.0, 0.0]])))
    corners = np.vstack([found.point[None, :], found.ties])
    assert {tuple(c) for c in corners} == {(1.0, 1.0), (-1.0, -1.0)}
    assert found.value == pytest.approx(2.0)
    assert not found.flat  # between the two corners the surface is lower


def test_stationary_ridge_is_reported_as_flat() -> None:
    model, region = cube(2)
    direction = np.array([1.0, 1.0])
    found = optimum(model, region, beta_of(model, 1.0, np.zeros(2), -np.outer(direction, direction)))
    assert found.value == pytest.approx(1.0)
    assert found.flat
    assert len(found.ties) >= 1


def test_tied_categories_are_reported_and_are_no_ridge() -> None:
    factors = (ContinuousFactor("x", -1.0, 1.0), CategoricalFactor("e", ("u", "v", "w")))
    model, region = QuadraticModel(factors), Region(factors)
    beta = np.zeros(model.p)
    beta[model.term_names.index("x^2")] = -1.0
    found = optimum(model, region, beta)
    assert {found.point[1], *found.ties[:, 1]} == {0.0, 1.0, 2.0}
    assert not found.flat


def test_constant_surface_is_flat_everywhere() -> None:
    model, region = cube(3)
    found = optimum(model, region, beta_of(model, 7.0, np.zeros(3), np.zeros((3, 3))))
    assert found.value == 7.0
    assert found.flat
    assert np.all(found.point == 0.0)
    points, values = optimum_draws(model, region, np.tile([7.0, *np.zeros(9)], (400, 1)))
    assert np.all(values == 7.0)
    assert np.allclose(np.quantile(points, [0.25, 0.5, 0.75], axis=0).T, [-0.5, 0.0, 0.5], atol=0.15)  # anywhere


def test_random_surfaces_equal_the_best_of_many_local_searches() -> None:
    from scipy.optimize import minimize

    rng = np.random.default_rng(5)
    model, region = cube(3)
    for _ in range(15):
        A = rng.normal(size=(3, 3))
        b, B = rng.normal(size=3), 0.5 * (A + A.T)
        found = optimum(model, region, beta_of(model, 0.0, b, B))
        local = [
            minimize(lambda x, b=b, B=B: -(x @ b + x @ B @ x), x0, bounds=[(-1, 1)] * 3, method="L-BFGS-B").fun
            for x0 in rng.uniform(-1, 1, (30, 3))
        ]
        assert found.value == pytest.approx(-min(local), abs=1e-6)


def test_eight_factors_are_never_below_a_dense_scan() -> None:
    rng = np.random.default_rng(8)
    model, region = cube(8)
    A = rng.normal(size=(8, 8))
    beta = beta_of(model, 0.0, rng.normal(size=8), -A @ A.T / 8 + 0.1 * np.eye(8))
    found = optimum(model, region, beta)
    X = region.sample(100_000, rng)
    assert found.value >= (model.matrix(X) @ beta).max()


def test_draws_equal_single_optima() -> None:
    model, factors = mixed()
    region = Region(factors)
    betas = np.random.default_rng(3).normal(size=(40, model.p))
    points, values = optimum_draws(model, region, betas, "minimize")
    for beta, point, value in zip(betas, points, values, strict=True):
        single = optimum(model, region, beta, "minimize")
        assert value == pytest.approx(single.value, abs=1e-10)
        assert float((model.matrix(point[None, :]) @ beta)[0]) == pytest.approx(value, abs=1e-10)


def test_no_draws_give_no_points() -> None:
    for model, region in (cube(2), cube(2, "x0 + x1 <= 0.5")):
        points, values = optimum_draws(model, region, np.zeros((0, model.p)))
        assert points.shape == (0, 2)
        assert values.shape == (0,)


def test_cube_without_coordinates() -> None:
    points, values = cube_maxima(Quadratics(np.array([2.0, 3.0]), np.zeros((2, 0)), np.zeros((2, 0, 0))))
    assert points.shape == (2, 0)
    np.testing.assert_array_equal(values, [2.0, 3.0])


def test_at_bound_names_numeric_factors_only() -> None:
    _, factors = mixed()
    point = np.array([-1.0, 1.0, 0.2, 1.0, -1.0])
    assert at_bound(Region(factors), point) == {"a": "low", "d": "high", "g": "low"}


# constraints ----------------------------------------------------------------------------------------------------------


def test_linear_surface_on_a_disc() -> None:
    model, region = cube(2, "x0 ** 2 + x1 ** 2 <= 0.5")
    found = optimum(model, region, beta_of(model, 0.0, np.array([3.0, 4.0]), np.zeros((2, 2))))
    # max b'x on |x| <= r is r |b|, at r b / |b|
    assert found.value == pytest.approx(5.0 * np.sqrt(0.5), abs=1e-7)
    np.testing.assert_allclose(found.point, np.sqrt(0.5) * np.array([0.6, 0.8]), atol=1e-4)
    assert found.active_constraints == ("x0 ** 2 + x1 ** 2 <= 0.5",)
    assert not found.exact
    assert region.feasible(found.point[None, :])[0]


def test_quadratic_programme_with_known_solution() -> None:
    # max -(x - 1)^2 - (y - 1)^2 s.t. x + y <= 0.5: the foot of the perpendicular, (0.25, 0.25)
    model, region = cube(2, "x0 + x1 <= 0.5")
    found = optimum(model, region, beta_of(model, -2.0, np.array([2.0, 2.0]), -np.eye(2)))
    np.testing.assert_allclose(found.point, [0.25, 0.25], atol=1e-5)
    assert found.value == pytest.approx(-2 * 0.75**2, abs=1e-8)


def test_feasible_box_optimum_is_kept_and_certain() -> None:
    model, region = cube(2, "x0 + x1 <= 0.5")
    found = optimum(model, region, beta_of(model, 0.0, np.array([-0.4, -0.4]), -np.eye(2)))
    np.testing.assert_allclose(found.point, [-0.2, -0.2], atol=1e-12)
    assert found.exact
    assert found.active_constraints == ()


def test_both_parts_of_a_disconnected_region_are_searched() -> None:
    model, region = cube(2, "x0 <= -0.8 or x0 >= 0.6")
    # -(x - 0.1)^2: the right part is nearer, at 0.6; with -0.2 the left one, at -0.8 or 0.6 by distance
    right = optimum(model, region, beta_of(model, 0.0, np.array([0.2, 0.0]), -np.eye(2)))
    np.testing.assert_allclose(right.point, [0.6, 0.0], atol=1e-6)
    left = optimum(model, region, beta_of(model, 0.0, np.array([-0.6, 0.0]), -np.eye(2)))
    np.testing.assert_allclose(left.point, [-0.8, 0.0], atol=1e-6)


def test_constraint_that_depends_on_a_category_and_a_discrete_level() -> None:
    factors = (
        ContinuousFactor("x", 0.0, 10.0),
        CategoricalFactor("e", ("u", "v")),
        DiscreteFactor("d", (1.0, 2.0, 4.0)),
    )
    region = Region(factors, (Constraint('e == "v" or x <= 4'), Constraint("x * d <= 12")))
    model = QuadraticModel(factors)
    beta = np.zeros(model.p)
    beta[model.term_names.index("x")] = 1.0
    beta[model.term_names.index("e[u]")] = 0.4
    beta[model.term_names.index("d")] = 0.5
    # coded x = x/5 - 1, d = (d - 1)/1.5 - 1. Best of each level by hand: x is the smallest of its limits.
    table = {
        (e, d): min(4.0 if e == 0 else 10.0, 12.0 / d) / 5 - 1 + (0.4 if e == 0 else -0.4) + 0.5 * ((d - 1) / 1.5 - 1)
        for e in (0, 1)
        for d in (1.0, 2.0, 4.0)
    }
    found = optimum(model, region, beta)
    assert found.value == pytest.approx(max(table.values()), abs=1e-7)
    e, d = max(table, key=lambda key: table[key])
    assert found.point[1] == e
    assert region.decode(found.point)[0]["d"] == d


def test_constrained_draws_are_feasible_and_near_the_single_optimum() -> None:
    model, region = cube(3, "x0 ** 2 + x1 ** 2 + x2 ** 2 <= 1.2", "x0 + x1 <= 0.9")
    rng = np.random.default_rng(6)
    betas = rng.normal(size=(60, model.p))
    points, values = optimum_draws(model, region, betas)
    assert region.feasible(points).all()
    np.testing.assert_allclose(np.sum(model.matrix(points) * betas, axis=1), values, atol=1e-10)
    single = np.array([optimum(model, region, beta).value for beta in betas[:20]])
    # the values spread over several units
    assert np.max(single - values[:20]) < 2e-2
    assert np.median(single - values[:20]) < 1e-4
    assert np.max(values[:20] - single) < 1e-7


def test_retract_ends_on_the_boundary() -> None:
    _, region = cube(2, "x0 ** 2 + x1 ** 2 <= 0.25")
    moved = retract(region, np.array([[1.0, 0.0], [0.1, 0.1]]), np.zeros((2, 2)))
    np.testing.assert_allclose(moved[0], [0.5, 0.0], atol=1e-4)
    np.testing.assert_array_equal(moved[1], [0.1, 0.1])
    assert (region.slacks(moved) >= 0.0).all()


def test_climb_never_descends() -> None:
    model, region = cube(2, "x0 ** 2 + x1 ** 2 <= 0.25")
    rng = np.random.default_rng(9)
    starts = region.sample(50, rng)
    c, b, B = forms = model.forms(rng.normal(size=(50, model.p)))
    before = c + np.sum(b * starts, axis=1) + np.einsum("ni,nij,nj->n", starts, B, starts)
    points, values = climb(region, forms, starts, np.zeros((50, 2)), rng)
    assert (values >= before).all()
    assert region.feasible(points, tol=0.0).all()


def test_a_search_that_ends_outside_is_drawn_back(monkeypatch: pytest.MonkeyPatch) -> None:
    model, region = cube(2, "x0 ** 2 + x1 ** 2 <= 0.25")
    form = model.forms(np.array([0.0, 1.0, 0.0, 0.0, 0.0, 0.0]))

    class Outside:
        x = np.array([0.9, 0.0])

    monkeypatch.setattr(constrained.scipy.optimize, "minimize", lambda *_args, **_kwargs: Outside())
    point, value = polish(region, form, np.zeros(2))
    assert region.feasible(point[None, :], tol=0.0)[0]
    assert value == pytest.approx(0.5, abs=1e-4)
    Outside.x = np.array([np.nan, 0.0])
    point, value = polish(region, form, np.array([0.1, 0.0]))
    np.testing.assert_array_equal(point, [0.1, 0.0])
    assert value == pytest.approx(0.1)


def test_active_bounds_prove_what_enumeration_finds(monkeypatch: pytest.MonkeyPatch) -> None:
    rng = np.random.default_rng(31)
    for q in (2, 3, 5):
        root = rng.normal(size=(300, q, q))
        quadratic = -root @ root.transpose(0, 2, 1) + np.where(rng.random((300, 1, 1)) < 0.3, 0.8, 0.0) * np.eye(q)
        linear = rng.normal(size=(300, q)) * rng.choice([0.3, 3.0, 30.0], size=(300, 1))
        points, values = cube_maxima(Quadratics(np.zeros(300), linear, quadratic))
        with monkeypatch.context() as patch:
            patch.setattr("seqrsm.fit.faces.well_curved", lambda forms: np.zeros(len(forms.linear), dtype=np.bool_))
            enumerated, best = cube_maxima(Quadratics(np.zeros(300), linear, quadratic))
        np.testing.assert_allclose(values, best, rtol=1e-12, atol=1e-12)
        np.testing.assert_allclose(points, enumerated, atol=1e-9)
