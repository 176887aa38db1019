"""What a departure too small to be seen does to the interval at the recommended settings."""

from __future__ import annotations

import numpy as np
import pytest

from seqrsm.decide.allowance import (
    NO_ALLOWANCE,
    Allowance,
    departed_optimum,
    weigh_departures,
)
from seqrsm.decide.discrepancy import LENGTHS, VARIANCES
from seqrsm.decide.intervals import half_width, t_quantile
from seqrsm.design.factors import CategoricalFactor, ContinuousFactor
from seqrsm.design.quadratic import QuadraticModel
from seqrsm.design.region import Region
from seqrsm.fit.optimum import optimum


def stage(k: int = 1) -> tuple[QuadraticModel, Region]:
    factors = tuple(ContinuousFactor(f"x{i}", -1.0, 1.0) for i in range(k))
    return QuadraticModel(factors), Region(factors)


def departure_allowance(model, region, X, Z, y, point, row, weights=None) -> Allowance:
    """At one point, from the scores."""
    departures = weigh_departures(model, region, X, Z, y, weights)
    return NO_ALLOWANCE if departures is None else departures.allowance(point, row)


def test_it_is_the_average_over_conditioned_normal_models() -> None:
    """Against the posterior of f(x0) - fitted mean from the joint normal of scores and f(x0), kind by kind."""
    rng = np.random.default_rng(3)
    model, region = stage()
    X = np.sort(rng.uniform(-1.0, 1.0, 14))[:, None]
    y = 50.0 - 8.0 * X[:, 0] ** 2 + 2.0 * np.sin(4.0 * X[:, 0]) + 0.7 * rng.standard_normal(14)
    Z, at = model.matrix(X), np.array([[0.2]])
    row = model.matrix(at)[0]
    found = departure_allowance(model, region, X, Z, y, at[0], row)
    n, p = Z.shape
    C = np.linalg.inv(Z.T @ Z)
    beta = C @ Z.T @ y
    s2 = float(np.sum((y - Z @ beta) ** 2)) / (n - p)
    nodes, mass = np.polynomial.legendre.leggauss(6)
    grid = model.matrix(nodes[:, None])
    centred = grid - 0.5 * mass @ grid
    signal = 0.5 * float(mass @ ((centred @ beta) ** 2 - s2 * np.sum((centred @ C) * centred, axis=1))) / s2

    def bend(x: np.ndarray) -> np.ndarray:
        return 0.5 * (5.0 * x**3 - 3.0 * x)

    kinds = [(lambda a, b, g=g: np.exp(-0.5 * ((a - b.T) / g) ** 2), 1.0 / 6.0) for g in LENGTHS]
    kinds.append((lambda a, b: bend(a) @ bend(b).T, 0.5))
    # A flat prior of the quadratic as a very wide one: f = z'b + g, b ~ N(0, big), all moments by conditioning.
    table = []
    for kernel, share in kinds:
        for v in VARIANCES:
            V = np.eye(n) + v * kernel(X, X)
            W = np.linalg.inv(V)
            M = Z.T @ W @ Z
            b = np.linalg.solve(M, Z.T @ W @ y)
            rest = y - Z @ b
            rss = float(rest @ W @ rest)
            log_likelihood = -0.5 * (np.linalg.slogdet(V)[1] + np.linalg.slogdet(M)[1] + (n - p) * np.log(rss))
            k0 = v * kernel(X, at)[:, 0]
            mean = float(row @ b + k0 @ W @ rest)
            u = row - Z.T @ W @ k0
            variance = rss / (n - p) * float(v * kernel(at, at)[0, 0] - k0 @ W @ k0 + u @ np.linalg.solve(M, u))
            table.append((log_likelihood, share / (1.0 + (v / signal) ** 2), mean - row @ beta, variance))
    likelihood, prior, shift, variance = np.array(table).T
    weight = prior * np.exp(likelihood - likelihood.max())
    weight /= weight.sum()
    mean = weight @ shift
    total = weight @ (variance + shift**2) - mean**2
    assert found.shift == pytest.approx(mean, rel=1e-6)
    assert found.variance == pytest.approx(max(total - s2 * float(row @ C @ row), 0.0), rel=1e-6, abs=1e-9)


def test_ends_are_those_of_the_quadratic_without_a_departure() -> None:
    assert NO_ALLOWANCE.ends(10.0, 2.0, 12.0, 0.95) == (8.0, 12.0)
    low, high = Allowance(-1.0, 4.0).ends(10.0, 2.0, 12.0, 0.95)
    assert 0.5 * (low + high) == pytest.approx(9.0)
    assert 0.5 * (high - low) == pytest.approx(np.hypot(2.0, 2.0 * float(t_quantile(12.0, 0.95))))


@pytest.mark.parametrize(("bend", "least", "most"), [(0.0, 0.93, 0.995), (1.2, 0.86, 1.0)])
def test_coverage_at_a_fixed_point(bend: float, least: float, most: float) -> None:
    """1200 data sets: a true quadratic stays near nominal; a bend hardly seen is covered, by t intervals it is not."""
    model, region = stage(2)
    axis = np.array([-1.0, -0.4, 0.1, 0.6, 1.0])
    X = np.array([(a, b) for a in axis for b in axis])
    Z, at = model.matrix(X), np.array([0.55, 0.5])
    row = model.matrix(at[None, :])[0]
    rng = np.random.default_rng(11)

    def surface(x: np.ndarray) -> np.ndarray:
        return 60.0 + 2.0 * x[:, 0] - 3.0 * np.sum(x**2, axis=1) + bend * np.sum(2.5 * x**3 - 1.5 * x, axis=1)

    truth = float(surface(at[None, :])[0])
    C = np.linalg.inv(Z.T @ Z)
    h, df = float(row @ C @ row), len(X) - model.p
    hits = np.zeros(2)
    for _ in range(1200):
        y = surface(X) + rng.standard_normal(len(X))
        beta = C @ Z.T @ y
        s = float(np.sqrt(np.sum((y - Z @ beta) ** 2) / df))
        mean, half = float(row @ beta), float(half_width("confidence", s, df, h, 0.95))
        low, high = departure_allowance(model, region, X, Z, y, at, row).ends(mean, half, df, 0.95)
        hits += abs(truth - mean) <= half, low <= truth <= high
    plain, allowed = hits / 1200
    assert least <= allowed <= most
    if bend:
        assert plain < 0.6


def test_nothing_to_judge_by() -> None:
    model, region = stage(1)
    X = np.linspace(-1.0, 1.0, 5)[:, None]
    Z = model.matrix(X)
    row = model.matrix(np.zeros((1, 1)))[0]
    assert departure_allowance(model, region, X, Z, np.arange(5.0), np.zeros(1), row) == NO_ALLOWANCE
    X = np.linspace(-1.0, 1.0, 12)[:, None]
    assert departure_allowance(model, region, X, model.matrix(X), np.full(12, 3.0), np.zeros(1), row) == NO_ALLOWANCE


def test_categories_and_weights() -> None:
    """Weights times four are a noise of half the size: the same allowance."""
    factors = (ContinuousFactor("x", -1.0, 1.0), CategoricalFactor("c", ("a", "b")))
    model, region = QuadraticModel(factors), Region(factors)
    rng = np.random.default_rng(5)
    X = np.column_stack([rng.uniform(-1.0, 1.0, 20), np.arange(20) % 2])
    Z, y = model.matrix(X), rng.normal(size=20) + 3.0 * X[:, 0] ** 3
    weights = rng.uniform(0.5, 2.0, 20)
    at = np.array([0.5, 1.0])
    row = model.matrix(at[None, :])[0]
    plain = departure_allowance(model, region, X, Z, y, at, row, weights)
    assert plain.variance > 0.0
    twice = departure_allowance(model, region, X, Z, 2.0 * y, at, row, weights)
    assert twice.shift == pytest.approx(2.0 * plain.shift)
    assert twice.variance == pytest.approx(4.0 * plain.variance)


def test_shifts_at_many_settings_are_those_of_each() -> None:
    factors = (ContinuousFactor("x", -1.0, 1.0), CategoricalFactor("c", ("a", "b")))
    model, region = QuadraticModel(factors), Region(factors)
    rng = np.random.default_rng(6)
    X = np.column_stack([rng.uniform(-1.0, 1.0, 24), np.arange(24) % 2])
    block = np.repeat([-1.0, 1.0], 12)[:, None]
    Z, y = np.hstack([model.matrix(X), block]), rng.normal(size=24) + 4.0 * X[:, 0] ** 3 * (1.0 + X[:, 1])
    weights = rng.uniform(0.5, 2.0, 24)
    found = weigh_departures(model, region, X, Z, y, weights)
    assert found is not None
    at = np.column_stack([rng.uniform(-1.0, 1.0, 7), np.arange(7) % 2])
    rows = np.hstack([model.matrix(at), np.zeros((7, 1))])
    each = [departure_allowance(model, region, X, Z, y, p, r, weights).shift for p, r in zip(at, rows, strict=True)]
    np.testing.assert_allclose(found.shifts(at, rows), each, rtol=1e-9)
    assert np.ptp(each) > 0.5


def test_settings_chosen_for_their_departure_have_it_as_an_error() -> None:
    assert Allowance(-3.0, 4.0).of_chosen == Allowance(-3.0, 13.0)
    assert NO_ALLOWANCE.of_chosen == NO_ALLOWANCE


def saturating(x: np.ndarray) -> np.ndarray:
    """Rises steeply, levels off, and falls slowly; its top is the sum of the tops of each coordinate."""
    return np.asarray(40.0 + np.sum(24.0 * (1.0 - np.exp(-3.0 * (x + 1.0))) - 3.5 * (x + 1.0), axis=1))


@pytest.mark.parametrize("goal", ["maximize", "minimize"])
def test_departed_optimum_is_the_highest_centre_of_all_intervals(goal: str) -> None:
    """Against a fine grid, whose every point is looked at by itself; the mirrored surface has the same one."""
    model, region = stage(2)
    rng = np.random.default_rng(8)
    X = rng.uniform(-1.0, 1.0, (30, 2))
    sign = 1.0 if goal == "maximize" else -1.0
    y = sign * (saturating(X) + rng.standard_normal(30))
    Z = model.matrix(X)
    estimate = np.linalg.lstsq(Z, y, rcond=None)[0]
    found = weigh_departures(model, region, X, Z, y)
    assert found is not None
    point = departed_optimum(found, region, model.matrix, estimate, goal)  # type: ignore[arg-type]
    axis = np.linspace(-1.0, 1.0, 21)
    grid = np.array([(a, b) for a in axis for b in axis])

    def centre(p: np.ndarray) -> float:
        row = model.matrix(p[None, :])[0]
        return sign * float(row @ estimate + departure_allowance(model, region, X, Z, y, p, row).shift)

    assert np.all(np.abs(point) <= 1.0)
    assert centre(point) >= max(centre(p) for p in grid) - 1e-9
    again = departed_optimum(found, region, model.matrix, estimate, goal)  # type: ignore[arg-type]
    np.testing.assert_array_equal(point, again)


def test_departed_optimum_loses_half_of_what_the_quadratic_does_and_its_interval_covers() -> None:
    """Sixty data sets of 34 runs on a saturating surface; where the departure is not that of a quadratic."""
    model, region = stage(2)
    axis = np.linspace(-1.0, 1.0, 401)
    top = float(np.max(saturating(axis[:, None])) - 40.0) * 2.0 + 40.0
    ends = np.array([(a, b) for a in (-1.0, 0.0, 1.0) for b in (-1.0, 0.0, 1.0)])
    loss, hits, plain_hits = np.zeros((60, 2)), 0, 0
    for seed in range(60):
        rng = np.random.default_rng([21, seed])
        X = np.vstack([ends, rng.uniform(-1.0, 1.0, (25, 2))])
        y = saturating(X) + rng.standard_normal(34)
        Z = model.matrix(X)
        C = np.linalg.inv(Z.T @ Z)
        estimate = C @ Z.T @ y
        found = weigh_departures(model, region, X, Z, y)
        assert found is not None
        best = optimum(model, region, estimate).point
        point = departed_optimum(found, region, model.matrix, estimate)
        loss[seed] = [top - float(saturating(p[None, :])[0]) for p in (best, point)]
        row = model.matrix(point[None, :])[0]
        s, df = float(np.sqrt(np.sum((y - Z @ estimate) ** 2) / 28)), 28.0
        half = float(half_width("confidence", s, 28, float(row @ C @ row), 0.95))
        low, high = found.allowance(point, row).of_chosen.ends(float(row @ estimate), half, df, 0.95)
        truth = top - loss[seed, 1]
        hits += low <= truth <= high
        plain_hits += abs(truth - float(row @ estimate)) <= half
    assert np.median(loss[:, 1]) < 0.5 * np.median(loss[:, 0])
    assert np.mean(loss[:, 1]) < 0.5 * np.mean(loss[:, 0])
    assert hits >= 53  # 57 expected; 52 or fewer have a chance of 3 % or less at 95 %
    assert plain_hits < 53
