"""Extremes, each with a defined result: a number, a named reason or an error that says what to do."""

from __future__ import annotations

import re

import numpy as np
import pytest
from half_widths import half_width

from seqrsm.analysis.scale import ResponseScale
from seqrsm.design.factors import CategoricalFactor, ContinuousFactor
from seqrsm.design.quadratic import QuadraticModel
from seqrsm.design.region import Region
from seqrsm.errors import FitError
from seqrsm.fit.blocks import fit_random_blocks
from seqrsm.fit.conjugate import posterior, weakly_informative
from seqrsm.fit.error_models import StudentT
from seqrsm.fit.estimability import missing_runs
from seqrsm.fit.least_squares import AliasedError, fit_least_squares, influential_runs, normal_plot
from seqrsm.fit.natural import natural_transform
from seqrsm.fit.optimum import optimum
from seqrsm.fit.transforms import logit_to_percent


def cube(k: int) -> tuple[QuadraticModel, Region]:
    factors = tuple(ContinuousFactor(f"x{i}", -1.0, 1.0) for i in range(k))
    return QuadraticModel(factors), Region(factors)


def scattered(k: int, n: int, seed: int = 0):
    model, region = cube(k)
    rng = np.random.default_rng(seed)
    points = region.sample(n, rng)
    return model, region, points, 60 + model.matrix(points) @ rng.normal(0, 3, model.p) + rng.normal(size=n)


def test_scores_that_do_not_vary_refuse_what_needs_scatter() -> None:
    model, region, points, _ = scattered(2, 12)
    Z, y = model.matrix(points), np.full(12, 50.0)
    fit = fit_least_squares(Z, y, model.terms)
    best = optimum(model, region, fit.estimate)
    assert best.value == pytest.approx(50.0, rel=1e-12)
    assert influential_runs(fit) == () or all("leverage" in run.reasons[0] for run in influential_runs(fit))
    assert normal_plot(fit).runs.size == 0
    days = ["a", "b"] * 6
    with pytest.raises(FitError):
        fit_random_blocks(Z, y, days)
    assert np.isfinite(posterior(Z, y, None, weakly_informative([t.kind for t in model.terms], y)).scale)


def test_percent_scores_of_nothing_and_everything() -> None:
    model, _, points, _ = scattered(1, 9)
    percent = np.array([0.0, 0, 0, 50, 50, 50, 100, 100, 100])[np.argsort(np.argsort(points[:, 0]))]
    scale = ResponseScale.of("logit", percent, model.matrix(points))
    fit = fit_least_squares(model.matrix(points), scale.values, model.terms, weights=scale.weights)
    ends = logit_to_percent(fit.predict(model.matrix(np.array([[-1.0], [1.0]]))).prediction.low)
    assert np.all((ends > 0) & (ends < 100))
    assert np.isfinite(fit.se).all()


@pytest.mark.parametrize("extra", [0, 1])
def test_as_many_runs_as_terms_and_one_more(extra: int) -> None:
    model, _, points, y = scattered(3, 10 + extra)
    fit = fit_least_squares(model.matrix(points), y, model.terms)
    assert fit.df_residual == extra
    assert np.isfinite(fit.estimate).all()
    natural = fit.predict(natural_transform(model))
    assert np.isfinite(natural.mean).all()
    if extra == 0:
        assert "no residual degrees of freedom" in fit.reason
        assert np.isnan(natural.se_mean).all()
        assert np.isnan([row.f for row in fit.anova()]).all()
    else:
        # one degree of freedom: Student's t is Cauchy, tan(0.95 pi / 2) = 12.7
        half = half_width(fit.interval(0.95))
        np.testing.assert_allclose(half, np.tan(0.475 * np.pi) * fit.se, rtol=1e-10)
        assert np.isnan(fit.studentised).all()  # deleting a run leaves no error estimate


def test_all_runs_at_one_setting() -> None:
    model, region = cube(2)
    points = np.tile([0.25, -0.5], (8, 1))
    y = np.random.default_rng(0).normal(70, 2, 8)
    with pytest.raises(AliasedError, match=", ".join(map(re.escape, model.term_names))) as caught:
        fit_least_squares(model.matrix(points), y, model.terms, setting_ids=[0] * 8)
    assert caught.value.n_dependent == 5
    assert len(missing_runs(model, region, points)[0]) == 5


def test_two_identical_factors() -> None:
    model, region = cube(2)
    x = np.linspace(-1, 1, 9)
    points = np.column_stack([x, x])
    with pytest.raises(AliasedError) as caught:
        fit_least_squares(model.matrix(points), 3 * x + x**2, model.terms)
    told = caught.value.problems[0].message.rpartition(": ")[2]
    assert set(told.split(", ")) == {"x0", "x1", "x0:x1", "x0^2", "x1^2"}
    mended = np.vstack([points, missing_runs(model, region, points)[0]])
    fit_least_squares(model.matrix(mended), np.zeros(len(mended)), model.terms)


@pytest.mark.parametrize(("low", "high"), [(0.0, 1e-12), (-1e12, 1e12), (5.0, 5.0 + 1e-12), (1e-30, 1e30)])
def test_fit_and_optimum_do_not_see_the_range_of_a_factor(low: float, high: float) -> None:
    scale = "log" if low == 1e-30 else "linear"
    factors = (ContinuousFactor("x", low, high, scale=scale), ContinuousFactor("z", -1.0, 1.0))
    model, region = QuadraticModel(factors), Region(factors)
    plain, box = cube(2)
    points = box.sample(14, np.random.default_rng(0))
    y = plain.matrix(points) @ np.array([60.0, 2, 1, 0.5, -3, -2]) + np.random.default_rng(1).normal(size=14)
    natural = region.decode(points)
    coded = region.code(natural)
    assert np.max(np.abs(coded - points)) < (0.01 if low == 5.0 else 1e-9)  # 5 + 1e-12 has a thousand values only
    ours = fit_least_squares(model.matrix(coded), y, model.terms)
    reference = fit_least_squares(plain.matrix(coded), y, plain.terms)
    np.testing.assert_array_equal(ours.estimate, reference.estimate)
    best = optimum(model, region, ours.estimate)
    np.testing.assert_array_equal(best.point, optimum(plain, box, reference.estimate).point)
    x = region.decode(best.point[None, :])[0]["x"]
    assert low <= float(x) <= high


def test_a_level_that_was_never_run() -> None:
    factors = (ContinuousFactor("x", -1.0, 1.0), CategoricalFactor("c", ("u", "v", "w")))
    model, region = QuadraticModel(factors), Region(factors)
    rng = np.random.default_rng(0)
    points = np.column_stack([rng.uniform(-1, 1, 20), rng.integers(2, size=20)])
    with pytest.raises(AliasedError) as caught:
        fit_least_squares(model.matrix(points), rng.normal(size=20), model.terms)
    assert caught.value.n_dependent == 2
    further = region.decode(missing_runs(model, region, points)[0])
    assert {setting["c"] for setting in further} == {"w"}
    assert len(further) == 2


def test_eight_factors_with_forty_five_terms() -> None:
    model, region, points, y = scattered(8, 60)
    assert model.p == 45
    fit = fit_least_squares(model.matrix(points), y, model.terms)
    reference = np.linalg.lstsq(model.matrix(points), y, rcond=None)[0]
    np.testing.assert_allclose(fit.estimate, reference, rtol=1e-9, atol=1e-9)
    best = optimum(model, region, fit.estimate)
    assert best.value >= np.max(model.matrix(region.sample(20_000, np.random.default_rng(1))) @ fit.estimate)


def test_weights_over_twelve_decades() -> None:
    model, _, points, _ = scattered(2, 24)
    Z = model.matrix(points)
    rng = np.random.default_rng(3)
    w = 10.0 ** np.linspace(-6, 6, 24)[rng.permutation(24)]
    beta = np.array([60.0, 2, 1, 0.5, -3, -2])
    y = Z @ beta + rng.normal(size=24) / np.sqrt(w)
    fit = fit_least_squares(Z, y, model.terms, weights=w)
    # exact rational arithmetic on the normal equations
    from fractions import Fraction

    rows = [[Fraction(v) for v in row] for row in Z.tolist()]
    weights, values = [Fraction(v) for v in w.tolist()], [Fraction(v) for v in y.tolist()]
    p = model.p
    A = [[sum(wi * r[i] * r[j] for wi, r in zip(weights, rows, strict=True)) for j in range(p)] for i in range(p)]
    b = [sum(wi * r[i] * v for wi, r, v in zip(weights, rows, values, strict=True)) for i in range(p)]
    for i in range(p):
        for j in range(i + 1, p):
            factor = A[j][i] / A[i][i]
            A[j] = [x - factor * z for x, z in zip(A[j], A[i], strict=True)]
            b[j] -= factor * b[i]
    exact = [Fraction(0)] * p
    for i in reversed(range(p)):
        exact[i] = (b[i] - sum(A[i][j] * exact[j] for j in range(i + 1, p))) / A[i][i]
    # sqrt(w) is rounded to 1 in 10^16, and that is amplified by the condition number of the weighted rows
    np.testing.assert_allclose(fit.estimate, [float(v) for v in exact], rtol=1e-10)
    assert np.isfinite(fit.se).all()
    assert np.max(np.abs(fit.estimate - beta) / fit.se) < 6


@pytest.mark.parametrize("unit", [1e-100, 1e-12, 1e12, 1e100])
def test_heavy_tails_do_not_see_the_unit_of_the_scores(unit: float) -> None:
    model, _, points, y = scattered(2, 18)
    y[3] += 40.0
    Z, ones = model.matrix(points), np.ones(18)
    weights = StudentT().weights(Z, y, ones)
    assert weights[3] < 0.1 * np.median(weights)
    np.testing.assert_allclose(StudentT().weights(Z, unit * y, ones), weights, rtol=1e-7)
    np.testing.assert_array_equal(StudentT().weights(Z, Z @ np.ones(model.p), ones), ones)  # nothing but rounding
