"""Canonical analysis against closed forms."""

from __future__ import annotations

import numpy as np
import pytest

from seqrsm.design.constraints import Constraint
from seqrsm.design.factors import CategoricalFactor, ContinuousFactor, DiscreteFactor
from seqrsm.design.quadratic import QuadraticModel, Quadratics
from seqrsm.design.region import Region
from seqrsm.fit import canonical
from seqrsm.fit.canonical import canonical_form, stationary_point, within_error
from seqrsm.fit.least_squares import fit_least_squares


@pytest.mark.parametrize(
    ("diagonal", "kind"),
    [
        ((-1.0, -2.0), "maximum"),
        ((1.0, 2.0), "minimum"),
        ((1.0, -2.0), "saddle"),
        ((-2.0, 0.05), "ridge"),
        ((-2.0, 0.0), "ridge"),
        ((2.0, 0.1), "ridge"),
        ((0.0, 0.0), "none"),
    ],
)
def test_kind_follows_the_signs_of_the_eigenvalues(diagonal: tuple[float, float], kind: str) -> None:
    turn = np.array([[0.8, -0.6], [0.6, 0.8]])
    B = turn @ np.diag(diagonal) @ turn.T
    form = canonical_form(Quadratics(np.array(1.0), np.array([0.3, 0.1]), B))
    assert form.kind == kind
    np.testing.assert_allclose(form.eigenvalues, sorted(diagonal, reverse=True), atol=1e-14)
    np.testing.assert_allclose(form.eigenvectors @ np.diag(form.eigenvalues) @ form.eigenvectors.T, B, atol=1e-14)


def test_gradient_vanishes_at_the_stationary_point(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(canonical, "FLAT", 0.0)
    rng = np.random.default_rng(2)
    A = rng.normal(size=(5, 5))
    b, B = rng.normal(size=5), A + A.T
    form = canonical_form(Quadratics(np.array(0.0), b, B))
    np.testing.assert_allclose(b + 2.0 * B @ form.point, 0.0, atol=1e-11)
    np.testing.assert_array_equal(form.point, form.exact_point)


def test_ridge_point_has_no_part_along_the_flat_axis() -> None:
    B = np.diag([-4.0, -0.1])
    form = canonical_form(Quadratics(np.array(0.0), np.array([1.0, 1.0]), B))
    np.testing.assert_allclose(form.point, [0.125, 0.0], atol=1e-15)
    np.testing.assert_allclose(form.exact_point, [0.125, 5.0])
    assert form.flat.tolist() == [True, False]


def test_singular_surface_has_no_exact_point(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(canonical, "FLAT", 0.0)
    form = canonical_form(Quadratics(np.array(0.0), np.array([1.0, 0.0]), np.diag([-4.0, 0.0])))
    assert np.isnan(form.exact_point).all()
    np.testing.assert_allclose(form.point, [0.125, 0.0])


def test_stationary_point_of_a_model_with_categories_and_constraints() -> None:
    factors = (
        ContinuousFactor("x", 0.0, 10.0),
        CategoricalFactor("e", ("u", "v")),
        DiscreteFactor("d", (1.0, 2.0, 4.0)),
    )
    model = QuadraticModel(factors)
    beta = np.zeros(model.p)
    for name, value in {"x": 0.4, "e[u]:x": 0.2, "x^2": -1.0, "d^2": -1.0, "intercept": 2.0}.items():
        beta[model.term_names.index(name)] = value
    region = Region(factors)
    # d/dx (0.4 +- 0.2) x - x^2 = 0
    for level, x in ((0, 0.3), (1, 0.1)):
        found = stationary_point(model, region, beta, (level,))
        np.testing.assert_allclose(found.point, [x, level, 0.0], atol=1e-14)
        assert found.kind == "maximum"
        assert found.inside_region
        assert found.warning == ""
        assert found.value == pytest.approx(2.0 + x**2)
    cut = Region(factors, (Constraint("x <= 6"),))
    assert not stationary_point(model, cut, beta, (0,)).inside_region  # x = 6.5 in natural units
    assert stationary_point(model, cut, beta, (1,)).inside_region
    beta[model.term_names.index("x")] = 4.0
    assert not stationary_point(model, region, beta, (0,)).inside_region


def test_ridge_and_plane_are_told_in_words() -> None:
    factors = (ContinuousFactor("x", -1.0, 1.0), ContinuousFactor("y", -1.0, 1.0))
    model, region = QuadraticModel(factors), Region(factors)
    beta = np.array([0.0, 1.0, 1.0, 0.0, -2.0, -0.02])
    ridge = stationary_point(model, region, beta)
    assert ridge.kind == "ridge"
    assert "y" in ridge.warning
    assert "1 %" in ridge.warning
    third = (*factors, ContinuousFactor("z", -1.0, 1.0))
    both = QuadraticModel(third)
    of_three = np.zeros(both.p)
    of_three[[both.term_names.index(f"{name}^2") for name in "xyz"]] = -2.0, -0.1, -0.02
    warning = stationary_point(both, Region(third), of_three).warning
    assert "along z; y" in warning or "along y; z" in warning
    assert "at most 5 % of the largest (ridge threshold 10 %)" in warning
    assert "in these directions" in warning
    assert "in this direction" in ridge.warning
    plane = stationary_point(model, region, np.array([0.0, 1.0, 1.0, 0.0, 0.0, 0.0]))
    assert plane.kind == "none"
    assert not plane.inside_region
    assert "no curvature" in plane.warning


LOG_AND_LEVELS = (
    ContinuousFactor("x", 0.0, 10.0),
    ContinuousFactor("f", 1.0, 16.0, scale="log"),
    DiscreteFactor("d", (1.0, 2.0, 5.0)),
    CategoricalFactor("e", ("u", "v")),
)


def fitted_surface(n: int = 60, noise: float = 0.02, flat: float = -0.9) -> tuple[QuadraticModel, Region, np.ndarray]:
    model = QuadraticModel(LOG_AND_LEVELS)
    region = Region(LOG_AND_LEVELS)
    beta = np.zeros(model.p)
    stated = {"intercept": 5.0, "x": 0.4, "f": -0.3, "d": 0.2, "x^2": -1.0, "f^2": -1.4, "d^2": flat, "x:f": 0.3}
    for name, value in stated.items():
        beta[model.term_names.index(name)] = value
    rng = np.random.default_rng(5)
    Z = model.matrix(region.sample(n, rng))
    fit = fit_least_squares(Z, Z @ beta + noise * rng.normal(size=n), model.terms)
    return model, region, fit


def test_standard_errors_of_the_stationary_point_against_draws() -> None:
    """Small errors: the scatter of the stationary points of draws of the coefficients, solved one by one."""
    model, region, fit = fitted_surface()
    found = stationary_point(model, region, fit.estimate, (1,), variance=lambda J: fit.s**2 * fit.variance_unscaled(J))
    covariance = fit.s**2 * np.linalg.inv(fit.Z.T @ fit.Z)
    draws = np.random.default_rng(1).multivariate_normal(fit.estimate, covariance, size=20_000)
    _, b, B = model.forms(draws, (1,))
    coded = np.linalg.solve(-2.0 * B, b[..., None])[..., 0]
    assert found.exact_se[:3] == pytest.approx(coded.std(axis=0), rel=0.03)
    np.testing.assert_array_equal(found.se, found.exact_se)
    assert np.isnan(found.se[3])
    natural = np.column_stack([factor.decode(coded[:, j]) for j, factor in enumerate(LOG_AND_LEVELS[:3])])
    ends = within_error(region, found.exact_point, found.exact_se)
    assert list(ends) == ["x", "f", "d"]
    half_widths = [0.5 * (high - low) for low, high in ends.values()]
    assert half_widths == pytest.approx(natural.std(axis=0), rel=0.03)
    wide = within_error(region, np.zeros(4), np.full(4, 3.0))
    assert wide["f"] == pytest.approx((4.0 / 64.0, 4.0 * 64.0))  # about the middle of 1 to 16: never below 0


def test_standard_errors_where_a_flat_axis_is_dropped() -> None:
    """The same for the point with the flat axis left out, which turns with the draws; the exact one is less sure."""
    model, region, fit = fitted_surface(noise=0.002, flat=-0.08)
    found = stationary_point(model, region, fit.estimate, (0,), variance=lambda J: fit.s**2 * fit.variance_unscaled(J))
    assert found.flat.sum() == 1
    covariance = fit.s**2 * np.linalg.inv(fit.Z.T @ fit.Z)
    draws = np.random.default_rng(2).multivariate_normal(fit.estimate, covariance, size=20_000)
    _, b, B = model.forms(draws, (0,))
    values, vectors = np.linalg.eigh(B)
    kept = np.where(np.abs(values) >= 0.1 * np.abs(values).max(axis=1, keepdims=True), 1.0 / values, 0.0)
    reduced = -0.5 * np.einsum("mij,mj,mkj,mk->mi", vectors, kept, vectors, b)
    exact = np.linalg.solve(-2.0 * B, b[..., None])[..., 0]
    assert found.se[:3] == pytest.approx(reduced.std(axis=0), rel=0.03)
    assert found.exact_se[:3] == pytest.approx(exact.std(axis=0), rel=0.05)
    assert found.exact_se[2] > 5.0 * found.se[2]
    np.testing.assert_allclose(found.exact_point[:3], np.linalg.solve(-2.0 * B0(model, fit), b0(model, fit)), rtol=1e-9)
    at_exact = model.matrix(found.exact_point[None, :]) @ fit.estimate
    assert found.exact_value == pytest.approx(float(at_exact[0]), rel=1e-9)
    assert found.exact_inside_region == bool(np.all(np.abs(found.exact_point[:3]) <= 1.0))


def b0(model: QuadraticModel, fit) -> np.ndarray:
    return model.forms(fit.estimate, (0,))[1]


def B0(model: QuadraticModel, fit) -> np.ndarray:
    return model.forms(fit.estimate, (0,))[2]


def test_one_factor_against_the_ratio_of_two_coefficients() -> None:
    """x = -b / 2c: its variance by the delta method is (Vb + 4 x Vbc + 4 x^2 Vc) / 4c^2."""
    model = QuadraticModel((ContinuousFactor("x", -1.0, 1.0),))
    x = np.linspace(-1.0, 1.0, 9)
    fit = fit_least_squares(model.matrix(x[:, None]), np.sin(7 * x) / 9 + 0.5 * x - x**2, model.terms)
    found = stationary_point(
        model, Region(model.factors), fit.estimate, variance=lambda J: fit.s**2 * fit.variance_unscaled(J)
    )
    V = fit.s**2 * np.linalg.inv(fit.Z.T @ fit.Z)
    _, b, c = fit.estimate
    at = -b / (2 * c)
    want = np.sqrt((V[1, 1] + 4 * at * V[1, 2] + 4 * at**2 * V[2, 2]) / (4 * c**2))
    assert found.exact_point[0] == pytest.approx(at)
    assert found.exact_se[0] == pytest.approx(want, rel=1e-10)


def test_without_errors_there_are_no_standard_errors() -> None:
    model, region, fit = fitted_surface()
    found = stationary_point(model, region, fit.estimate, (0,))
    assert np.all(np.isnan(found.se))
    assert np.all(np.isnan(found.exact_se))
