"""Coverage at the estimated optimum, where the place was chosen by the same scores."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from seqrsm.design.factors import ContinuousFactor
from seqrsm.design.quadratic import QuadraticModel
from seqrsm.design.region import Region
from seqrsm.errors import FitError
from seqrsm.fit.conjugate import Flat, posterior
from seqrsm.fit.intervals import student_quantile
from seqrsm.fit.least_squares import fit_least_squares
from seqrsm.fit.optimum import optimum_draws
from seqrsm.fit.optimum_interval import searched_from_draws, searched_interval
from seqrsm.fit.robust import student_draws, student_weights


def setup(k: int, n: int, curvature: float, tilt: float):
    factors = tuple(ContinuousFactor(f"x{i}", -1.0, 1.0) for i in range(k))
    model, region = QuadraticModel(factors), Region(factors)
    points = region.sample(n, np.random.default_rng(1))
    points[: 2**k] = [[2.0 * (i >> j & 1) - 1 for j in range(k)] for i in range(2**k)]
    beta = np.zeros(model.p)
    beta[0] = 70.0
    for t, term in enumerate(model.terms):
        beta[t] += -curvature * (term.kind == "square") + tilt * curvature * (term.kind == "linear")
    return model, region, points, beta


def test_curved_surface_has_nominal_t_intervals_and_flat_ones_do_not() -> None:
    """10 000 data sets: within 1 % of nominal where the surface is curved beside the noise."""
    found = []
    for curvature in (6.0, 0.5):
        model, region, points, beta = setup(2, 16, curvature, 0.2)
        Z, sets = model.matrix(points), 10_000
        rng = np.random.default_rng(0)
        y = Z @ beta + 0.5 * rng.normal(size=(sets, 16))
        fit = fit_least_squares(Z, y[0], model.terms)
        estimates = y @ Z @ fit.covariance_unscaled
        s = np.sqrt(np.sum((y - estimates @ Z.T) ** 2, axis=1) / fit.df_residual)
        best, value = optimum_draws(model, region, estimates)
        rows = model.matrix(best)
        h, truth = fit.variance_unscaled(rows), rows @ beta
        t = student_quantile(fit.df_residual, 0.95)
        future = truth + 0.5 * rng.normal(size=sets)
        found.append(
            (
                np.mean(np.abs(value - truth) <= t * s * np.sqrt(h)),
                np.mean(np.abs(value - future) <= t * s * np.sqrt(1 + h)),
            )
        )
    assert found[0] == pytest.approx((0.95, 0.95), abs=0.01)
    assert found[1][0] < 0.94  # what the t interval leaves out


@pytest.mark.parametrize(
    ("k", "n", "curvature", "tilt"),
    [(2, 16, 0.5, 0.2), (2, 16, 0.5, 1.0), (2, 16, 6.0, 0.2), (3, 24, 0.5, 0.2), (4, 36, 0.25, 0.2)],
)
def test_interval_that_allows_for_the_search_covers(k: int, n: int, curvature: float, tilt: float) -> None:
    """In full, to 10,000 data sets, by tests/studies/statistics_study.py."""
    model, region, points, beta = setup(k, n, curvature, tilt)
    Z, sets = model.matrix(points), 400 if k == 2 else 250
    rng = np.random.default_rng(2)
    template = fit_least_squares(Z, Z @ beta + rng.normal(size=n), model.terms)
    mean, new, gaps, optimism = 0, 0, [], []
    for i in range(sets):
        y = Z @ beta + 0.5 * rng.normal(size=n)
        estimate = template.covariance_unscaled @ Z.T @ y
        s = float(np.sqrt(np.sum((y - Z @ estimate) ** 2) / template.df_residual))
        fit = dataclasses.replace(template, estimate=estimate, s=s)
        found = searched_interval(model, region, fit, draws=300 if k == 2 else 200, seed=i)
        truth = float((model.matrix(found.point[None, :]) @ beta)[0])
        mean += found.confidence[0] <= truth <= found.confidence[1]
        new += found.predictions[0][0] <= truth + 0.5 * rng.normal() <= found.predictions[0][1]
        gaps.append(found.mean - truth)
        optimism.append(found.optimism)
    error = 4 * np.sqrt(0.95 * 0.05 / sets)
    assert mean / sets > 0.95 - error
    assert new / sets > 0.95 - error
    if curvature > 1:
        assert np.mean(optimism) == pytest.approx(np.mean(gaps), abs=0.05)


def test_never_shorter_than_t_and_the_minimum_mirrors_the_maximum() -> None:
    model, region, points, beta = setup(2, 16, 1.0, 0.5)
    Z = model.matrix(points)
    y = Z @ beta + np.random.default_rng(3).normal(size=16)
    fit, mirror = fit_least_squares(Z, y, model.terms), fit_least_squares(Z, -y, model.terms)
    found, other = searched_interval(model, region, fit), searched_interval(model, region, mirror, "minimize")
    plain = fit.predict(model.matrix(found.point[None, :]))
    assert found.confidence[0] <= plain.confidence.low[0] + 1e-12
    assert found.predictions[0][1] >= plain.prediction.high[0] - 1e-12
    assert found.optimism > 0 > other.optimism
    assert other.mean == pytest.approx(-found.mean, rel=1e-12)
    saturated = fit_least_squares(Z[:6], y[:6], model.terms)
    with pytest.raises(FitError, match="no interval"):
        searched_interval(model, region, saturated)


@pytest.mark.parametrize(("curvature", "tilt"), [(6.0, 0.2), (0.5, 0.2), (0.0, 0.0)])
@pytest.mark.parametrize("goal", ["maximize", "minimize"])
def test_draws_of_the_exact_posterior_give_what_the_bootstrap_gives(curvature: float, tilt: float, goal) -> None:
    model, region, points, beta = setup(2, 16, curvature, tilt)
    rng = np.random.default_rng(4)
    y = model.matrix(points) @ beta + 0.5 * rng.normal(size=16)
    fit = fit_least_squares(model.matrix(points), y, model.terms)
    want = searched_interval(model, region, fit, goal, draws=20_000)
    betas, sigma = posterior(fit.Z, y).draws(20_000, rng)
    noise = [np.zeros(20_000), sigma * rng.normal(size=20_000)]
    optimism, ends = searched_from_draws(model, region, fit.estimate, betas, noise, goal)
    se = np.array([1.0, 1.0]) * fit.s
    assert optimism == pytest.approx(want.optimism, abs=0.15 * fit.s)
    np.testing.assert_allclose(ends[0], want.confidence, atol=0.15 * se[0])
    np.testing.assert_allclose(ends[1], want.predictions[0], atol=0.25 * se[0])


def test_heavy_tails_are_covered_after_the_search() -> None:
    """Nearly flat, Student-t errors: without the search allowed for 83 % (1 %) where 95 % are claimed."""
    model, region, points, beta = setup(2, 24, 0.5, 0.2)
    Z, rng, sets = model.matrix(points), np.random.default_rng(5), 250
    hits = np.zeros((sets, 3))
    for i in range(sets):
        y = Z @ beta + 0.5 * rng.standard_t(4, size=24)
        own = np.random.default_rng(i)
        estimate = fit_least_squares(Z, y, model.terms, weights=student_weights(Z, y, np.ones(24))).estimate
        found = student_draws(Z, y, np.ones(24), Flat(), 800, own)
        noise = found.sigma * own.standard_t(4, len(found.sigma))
        place, _ = optimum_draws(model, region, estimate[None, :])
        row = model.matrix(place)[0]
        truth, future = float(row @ beta), float(row @ beta) + 0.5 * rng.standard_t(4)
        _, ends = searched_from_draws(model, region, estimate, found.beta, [np.zeros(len(noise)), noise])
        plain = np.quantile(found.beta @ row, [0.025, 0.975])
        pairs = ((ends[0], truth), (ends[1], future), (plain, truth))
        hits[i] = [low <= value <= high for (low, high), value in pairs]
    searched, run, plain = hits.mean(axis=0)
    assert searched > 0.92
    assert run > 0.91
    assert plain < 0.89
