"""Many runs as fewer settings: what stays as it was, what may not be merged, and that answers stay true."""

from __future__ import annotations

import numpy as np
import pytest
from process_cases import bowl, factors, fitted, hill, noise_covariance, prior_covariance, spread
from scipy.stats import multivariate_normal

from seqrsm.design.quadratic import QuadraticModel
from seqrsm.fit.gather import gathered
from seqrsm.fit.process import kinds


def none(points: np.ndarray) -> np.ndarray:
    """No guess of the surface."""
    return np.zeros(len(points))


@pytest.mark.parametrize("levels", [(), (3,), (3, 2)])
def test_a_quadratic_stays_what_it_is(levels: tuple[int, ...]) -> None:
    """Scores without scatter are those of the quadratic at the merged settings, to rounding."""
    points, model = spread(500, 2, levels), QuadraticModel(factors(2, levels))
    weights = np.exp(np.random.default_rng(2).normal(size=500))

    def true(x: np.ndarray) -> np.ndarray:
        return bowl(x[:, :2]) + (7.0 * x[:, -1] if levels else 0.0)

    kind = kinds(model, points, None, None)
    group, at, y = gathered(model, points, true(points), weights, kind, none, np.ones(2), 60)
    assert len(np.unique(at, axis=0)) == group.max() + 1 == 60
    np.testing.assert_allclose(y, true(at), rtol=1e-10)
    np.testing.assert_array_equal(at[:, 2:], points[:, 2:])
    for k in range(60):
        mean = np.average(points[group == k, :2], axis=0, weights=weights[group == k])
        np.testing.assert_allclose(at[group == k, :2], np.tile(mean, (np.sum(group == k), 1)), rtol=1e-12, atol=1e-12)


def test_equal_settings_with_weights_of_their_own_are_merged_without_loss(monkeypatch: pytest.MonkeyPatch) -> None:
    """Twenty settings, five runs each: likelihood and posterior are those of the normal distribution of all."""
    monkeypatch.setattr("seqrsm.fit.process.MOST_SETTINGS", 40)
    rng, points, at = np.random.default_rng(1), np.repeat(spread(20, 2), 5, axis=0), spread(9, 2, seed=9)
    weights = np.exp(rng.normal(size=100))
    y = hill(points) + rng.normal(size=100) / np.sqrt(weights)
    process = fitted(points, y, weights=weights)
    assert (process.gathered, len(process._y)) == (True, 20)
    scores, chosen = (y - y.mean()) / y.std(), np.log([[0.5, 0.8, 0.1, 0.6, 0.5], [0.9, 0.5, 0.2, 0.4, 0.8]])
    chosen = np.hstack([chosen, [[0.2, -0.1], [-0.3, 0.4]]])
    process._keep(chosen)
    means, variances = process.marginals(at)
    told = process.centre + (y - process.centre) @ process.pull(at)
    np.testing.assert_allclose(told, means.mean(axis=0), rtol=1e-9)
    of_runs, logs = 0.0, []
    for theta, mean, variance in zip(chosen, means, variances, strict=True):
        own = prior_covariance(theta, points, points, 2) + noise_covariance(theta, weights)
        logs.append(multivariate_normal(np.zeros(100), own).logpdf(scores))
        cross = prior_covariance(theta, at, points, 2)
        np.testing.assert_allclose(mean, y.mean() + cross @ np.linalg.solve(own, y - y.mean()), rtol=1e-6)
        left = prior_covariance(theta, at, at, 2) - cross @ np.linalg.solve(own, cross.T)
        np.testing.assert_allclose(variance, y.var() * np.diag(left), rtol=1e-5)
        of_runs = of_runs + 0.5 * y.var() * np.diag(noise_covariance(theta, weights))
    assert np.diff(process._log_likelihood(chosen)) == pytest.approx(np.diff(logs), rel=1e-6)
    np.testing.assert_allclose(process.variance_of_runs, of_runs, rtol=1e-6)


def test_groups_are_where_the_runs_are() -> None:
    """Nine runs in ten lie near a point: so do most groups; equal runs are never parted."""
    rng = np.random.default_rng(4)
    points = np.vstack([0.3 + 0.02 * rng.normal(size=(450, 2)), spread(50, 2)])
    points = np.vstack([points, points])
    model = QuadraticModel(factors(2))
    _, at, _ = gathered(model, points, bowl(points), np.ones(1000), np.empty((1000, 0)), none, np.ones(2), 100)
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
    _, at, y = gathered(model, points, bowl(points[:, :1]) + effect, np.ones(200), kind, none, np.ones(1), 10)
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


def test_scores_that_are_equal_but_for_a_few(monkeypatch: pytest.MonkeyPatch) -> None:
    """The first process is of a part of the runs, among which none may differ."""
    monkeypatch.setattr("seqrsm.fit.process.MOST_SETTINGS", 60)
    points, y = spread(400, 2), np.full(400, 100.0)
    y[7] = 97.0
    process = fitted(points, y)
    assert np.isfinite(process.log_bayes_factor)
    assert process.mean(spread(9, 2, seed=9)) == pytest.approx(np.full(9, 100.0), abs=1.0)
