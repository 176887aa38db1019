"""Many runs as fewer settings: what stays as it was, what may not be merged, and that answers stay true."""

from __future__ import annotations

import numpy as np
import pytest
from process_cases import bowl, factors, fitted, hill, noise_covariance, prior_covariance, spread

from seqrsm.design.quadratic import QuadraticModel
from seqrsm.fit.gather import gathered
from seqrsm.fit.process import kinds


def none(points: np.ndarray) -> np.ndarray:
    """No guess of the surface."""
    return np.zeros(len(points))


def of_runs(n: int, levels: tuple[int, ...] = (), most: int = 60, seed: int = 2):
    rng, points = np.random.default_rng(seed), spread(n, 2, levels)
    weights, model = np.exp(rng.normal(size=n)), QuadraticModel(factors(2, levels))
    y = bowl(points[:, :2]) + (7.0 * points[:, -1] if levels else 0.0)
    return (
        points,
        y,
        weights,
        gathered(model, points, y, weights, kinds(model, points, None, None), none, np.ones(2), most),
    )


@pytest.mark.parametrize("levels", [(), (3,), (3, 2)])
def test_a_quadratic_stays_what_it_is(levels: tuple[int, ...]) -> None:
    """Scores without scatter are those of the quadratic at the merged settings, to rounding."""
    points, _, _, (at, y, _) = of_runs(500, levels)
    assert len(np.unique(at, axis=0)) == 60
    np.testing.assert_allclose(y, bowl(at[:, :2]) + (7.0 * at[:, -1] if levels else 0.0), rtol=1e-10)
    np.testing.assert_array_equal(at[:, 2:], points[:, 2:])


def test_the_mean_of_a_group_has_the_variance_that_its_weight_says() -> None:
    _, _, weights, (at, _, merged) = of_runs(500)
    for place in np.unique(at, axis=0):
        own = np.all(at == place, axis=1)
        n = own.sum()
        assert np.ptp(merged[own]) == 0.0
        assert 1.0 / (n * merged[own][0]) == pytest.approx(np.sum(1.0 / weights[own]) / n**2, rel=1e-12)


def test_groups_are_where_the_runs_are() -> None:
    """Nine runs in ten lie near a point: so do most groups; equal runs are never parted."""
    rng = np.random.default_rng(4)
    points = np.vstack([0.3 + 0.02 * rng.normal(size=(450, 2)), spread(50, 2)])
    points = np.vstack([points, points])
    model = QuadraticModel(factors(2))
    at, _, _ = gathered(model, points, bowl(points), np.ones(1000), np.empty((1000, 0)), none, np.ones(2), 100)
    np.testing.assert_array_equal(at[:500], at[500:])
    assert len(np.unique(at, axis=0)) == 100
    assert np.max(np.abs(at - points)) < 0.5
    assert np.median(np.abs(at - points)) < 0.01


def test_blocks_and_levels_are_not_merged() -> None:
    """Ten kinds make ten groups; of days that follow the settings, what the days differ by is no slope."""
    points = np.column_stack([np.sort(spread(200, 1), axis=0), np.arange(200) % 2])
    day = np.arange(200) // 40
    model, blocks = QuadraticModel(factors(1, (2,))), np.eye(5)[day]
    effect, kind = np.array([0.0, 9.0, -4.0, 3.0, 12.0])[day], np.hstack([points[:, 1:], blocks])
    at, y, _ = gathered(model, points, bowl(points[:, :1]) + effect, np.ones(200), kind, none, np.ones(1), 10)
    assert len(np.unique(np.hstack([at, blocks]), axis=0)) == 10
    np.testing.assert_array_equal(at[:, 1], points[:, 1])
    np.testing.assert_allclose(y, bowl(at[:, :1]) + effect, rtol=1e-10)


def test_runs_are_merged_along_factors_that_matter_little(monkeypatch: pytest.MonkeyPatch) -> None:
    """A narrow top over two of five factors: merged alike in all five, its height came out 7 of 30 too low."""
    monkeypatch.setattr("seqrsm.fit.process.MOST_SETTINGS", 120)
    points, top = spread(500, 5), np.full((1, 5), 0.3)
    y = hill(points[:, :2]) + np.random.default_rng(1).normal(size=500)
    process = fitted(points, y)
    assert np.mean(process.hyper.lengths, axis=0)[2:].min() > 3.0 * np.mean(process.hyper.lengths, axis=0)[:2].max()
    means, variances = process.marginals(top)
    assert means.mean() == pytest.approx(80.0, abs=2.0 * np.sqrt(variances.mean() + means.var()))
    assert np.sqrt(variances.mean() + means.var()) < 1.0


def test_few_enough_settings_are_left_alone(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("seqrsm.fit.process.MOST_SETTINGS", 60)
    points = np.vstack([spread(60, 1)] * 2)
    y = hill(points) + np.random.default_rng(1).normal(size=len(points))
    monkeypatch.setattr("seqrsm.fit.process.gathered", None)  # not called
    assert len(fitted(points, y)._y) == 60


def test_the_surface_is_nearly_that_of_all_runs(monkeypatch: pytest.MonkeyPatch) -> None:
    """Against the textbook's formula for all 200 runs, under hyperparameters near those of the scores."""
    monkeypatch.setattr("seqrsm.fit.process.MOST_SETTINGS", 120)
    rng, points, at = np.random.default_rng(3), spread(200, 2), spread(25, 2, seed=9)
    y = hill(points) + 2.0 * rng.normal(size=200)
    process, sd = fitted(points, y), y.std()
    assert len(process._y) == 120
    theta = np.array([*np.log([0.5, 1.0, 2.0 / sd, 0.5, 0.5]), 0.2, -0.1])
    process._keep(theta[None, :])
    own = prior_covariance(theta, points, points, 2) + noise_covariance(theta, np.ones(200))
    cross = prior_covariance(theta, at, points, 2)
    exact = y.mean() + cross @ np.linalg.solve(own, y - y.mean())
    variances = np.diag(prior_covariance(theta, at, at, 2) - cross @ np.linalg.solve(own, cross.T))
    (means,), (found,) = process.marginals(at)
    assert np.sqrt(np.mean(np.square(means - exact) / (sd**2 * variances))) < 0.3
    assert 0.9 < np.min(found / (sd**2 * variances)) < np.max(found / (sd**2 * variances)) < 1.25


def test_what_many_runs_tell_of_a_narrow_top_is_true(monkeypatch: pytest.MonkeyPatch) -> None:
    """Twelve sets of four times as many runs as settings: means are covered as often as 95 % intervals allow."""
    monkeypatch.setattr("seqrsm.fit.process.MOST_SETTINGS", 60)
    at, inside = spread(20, 2, seed=9), 0.0
    for seed in range(12):
        points = spread(240, 2, seed=100 + seed)
        process = fitted(points, hill(points) + 2.0 * np.random.default_rng(seed).normal(size=240))
        assert process.log_bayes_factor > 10.0
        means, variances = process.marginals(at)
        mean, total = means.mean(axis=0), variances.mean(axis=0) + means.var(axis=0)
        inside += np.mean(np.abs(mean - hill(at)) < 1.96 * np.sqrt(total)) / 12
    assert 0.88 < inside < 0.995
