"""Fit, optimum and intervals do not depend on units, on the order of runs, factors and levels, or on block names."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from seqrsm.design.factors import CategoricalFactor, ContinuousFactor
from seqrsm.design.quadratic import QuadraticModel
from seqrsm.design.region import Region
from seqrsm.fit.least_squares import fit_least_squares
from seqrsm.fit.natural import natural_transform
from seqrsm.fit.optimum import optimum

SEEDS = st.integers(0, 10_000)


def campaign(
    seed: int, scale: float = 1.0, shift: float = 0.0, order: tuple[int, ...] = (0, 1, 2), levels: str = "uvw"
):
    """The same 30 runs, with the first factor in other units and factors and levels in other orders."""
    factors = (
        ContinuousFactor("a", shift + scale * 1.0, shift + scale * 3.0),
        ContinuousFactor("b", 1.0, 100.0, scale="log"),
        CategoricalFactor("c", tuple(levels)),
    )
    chosen = tuple(factors[i] for i in order)
    model, region = QuadraticModel(chosen), Region(chosen)
    rng = np.random.default_rng(seed)
    a, b = rng.uniform(1, 3, 30), 10 ** rng.uniform(0, 2, 30)
    c = rng.permutation(np.repeat(list("uvw"), 10))  # a level without runs of its own would leave the fit no full rank
    u, v = a - 2, np.log10(b) - 1
    y = 60 - 5 * (u - 0.3) ** 2 - 4 * (v + 0.2) ** 2 + u * v + 2.0 * (c == "v") + rng.normal(size=30)
    settings = [{"a": shift + scale * p, "b": q, "c": r} for p, q, r in zip(a, b, c.tolist(), strict=True)]
    points = region.code(settings)
    return model, region, points, fit_least_squares(model.matrix(points), y, model.terms), settings


@settings(max_examples=25, deadline=None)
@given(SEEDS, st.sampled_from([1e-9, 1e-3, 7.0, 1e6]), st.sampled_from([0.0, -5.0, 2.0]))
def test_units(seed: int, scale: float, shift: float) -> None:
    model, region, points, fit, _ = campaign(seed)
    model2, region2, points2, fit2, _ = campaign(seed, scale, scale * shift)
    np.testing.assert_allclose(points2, points, atol=1e-9)
    np.testing.assert_allclose(fit2.estimate, fit.estimate, rtol=1e-7, atol=1e-7)
    one, two = optimum(model, region, fit.estimate), optimum(model2, region2, fit2.estimate)
    assert two.value == pytest.approx(one.value, rel=1e-9)
    natural, natural2 = fit.predict(natural_transform(model)), fit2.predict(natural_transform(model2))
    square = model.term_names.index("a^2")
    assert natural2.mean[square] * scale**2 == pytest.approx(natural.mean[square], rel=1e-6)
    assert natural2.se_mean[square] * scale**2 == pytest.approx(natural.se_mean[square], rel=1e-6)


@settings(max_examples=25, deadline=None)
@given(SEEDS, st.permutations([0, 1, 2]), st.permutations("uvw"))
def test_order_of_factors_and_levels(seed: int, order: list[int], levels: list[str]) -> None:
    model, region, _, fit, _ = campaign(seed)
    model2, region2, _, fit2, _ = campaign(seed, order=tuple(order), levels="".join(levels))
    np.testing.assert_allclose(fit2.fitted, fit.fitted, rtol=1e-10)
    assert fit2.s == pytest.approx(fit.s, rel=1e-10)
    best, best2 = optimum(model, region, fit.estimate), optimum(model2, region2, fit2.estimate)
    assert best2.value == pytest.approx(best.value, rel=1e-10)
    for name in ("a", "b"):
        one, two = region.decode(best.point)[0][name], region2.decode(best2.point)[0][name]
        assert float(two) == pytest.approx(float(one), rel=1e-6)
    interval = fit.predict(model.matrix(best.point[None, :])).prediction
    interval2 = fit2.predict(model2.matrix(best2.point[None, :])).prediction
    assert interval2.low[0] == pytest.approx(interval.low[0], rel=1e-8)
    for factor in ("a", "b", "c"):
        ours, theirs = (f.partial_f(m.factor_terms(factor)).f for m, f in ((model, fit), (model2, fit2)))
        assert theirs == pytest.approx(ours, rel=1e-8)


@settings(max_examples=25, deadline=None)
@given(SEEDS)
def test_order_of_runs_and_positive_covariance(seed: int) -> None:
    model, _, points, fit, _ = campaign(seed)
    order = np.random.default_rng(seed).permutation(30)
    other = fit_least_squares(model.matrix(points[order]), fit.y[order], model.terms)
    np.testing.assert_allclose(other.estimate, fit.estimate, rtol=1e-11, atol=1e-11)
    np.testing.assert_allclose(other.leverage, fit.leverage[order], rtol=1e-9)
    assert np.linalg.eigvalsh(fit.covariance_unscaled)[0] > 0.0
    natural = fit.predict(natural_transform(model))
    T = natural_transform(model)
    assert np.linalg.eigvalsh(T @ fit.covariance_unscaled @ T.T)[0] > 0.0
    np.testing.assert_allclose(natural.se_mean**2, fit.s**2 * np.diagonal(T @ fit.covariance_unscaled @ T.T), rtol=1e-8)


@settings(max_examples=10, deadline=None)
@given(SEEDS)
def test_optimum_is_not_below_any_of_100_000_feasible_points(seed: int) -> None:
    model, region, _, fit, _ = campaign(seed)
    best = optimum(model, region, fit.estimate)
    values = model.matrix(region.sample(100_000, np.random.default_rng(seed))) @ fit.estimate
    assert best.value >= values.max() - 1e-9
