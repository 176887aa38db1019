"""Draws by importance against integrals known in closed form and by quadrature."""

from __future__ import annotations

import numpy as np
import pytest

from seqrsm.fit.conjugate import crossing
from seqrsm.fit.importance import _peak, weighted_draws

BOX = 5.0


def inside(log_likelihood):
    """With a standard normal prior, and nothing beyond five standard deviations."""

    def log_density(z: np.ndarray) -> np.ndarray:
        found = log_likelihood(z) - 0.5 * np.sum(z**2, axis=1)
        return np.where(np.all(np.abs(z) < BOX, axis=1), found, -np.inf)

    return log_density


@pytest.mark.parametrize("d", [1, 4, 11])
def test_a_normal_posterior(d: int) -> None:
    """Measurements of each coordinate, one far more exact than the others: evidence and moments are known."""
    noise, data = np.geomspace(0.05, 2.0, d), np.linspace(-1.0, 1.0, d)
    density = inside(lambda z: -0.5 * np.sum(((z - data) / noise) ** 2 + np.log(2.0 * np.pi * noise**2), axis=1))
    found = weighted_draws(density, d, np.random.default_rng(1))
    total = 1.0 + noise**2
    log_evidence = -0.5 * np.sum(data**2 / total + np.log(2.0 * np.pi * total))
    mean, sd = data / total, noise / np.sqrt(total)
    error = 4.0 / np.sqrt(found.effective)
    assert found.effective > 100.0
    assert found.log_evidence == pytest.approx(log_evidence, abs=error)
    assert found.shares.sum() == pytest.approx(1.0)
    np.testing.assert_array_less(np.abs(found.shares @ found.draws - mean) / sd, error)
    spread = np.sqrt(found.shares @ (found.draws - mean) ** 2)
    np.testing.assert_array_less(np.abs(np.log(spread / sd)), error)
    some = found.some(2000, np.random.default_rng(2))
    np.testing.assert_allclose(some.mean(axis=0), found.shares @ found.draws, atol=0.05)


def bent_ridge(z: np.ndarray) -> np.ndarray:
    """No normal distribution: along a parabola, with a second, lower top."""
    return -0.5 * ((z[:, 0] - z[:, 1] ** 2 + 1.0) / 0.2) ** 2 + np.log1p(np.exp(-2.0 * (z[:, 1] - 1.0) ** 2))


def test_a_bent_ridge_with_two_tops() -> None:
    density = inside(bent_ridge)

    def share(weight) -> float:
        """By sums over a fine grid, of middles."""
        step = 2.0 * BOX / 1000
        axis = np.arange(-BOX + 0.5 * step, BOX, step)
        z = np.stack(np.meshgrid(axis, axis), axis=-1).reshape(-1, 2)
        return float(np.sum(np.exp(density(z)) * weight(z))) * step**2 / (2.0 * np.pi)

    evidence = share(lambda z: np.ones(len(z)))
    right = share(lambda z: (z[:, 1] > 0.0).astype(float)) / evidence
    several = [weighted_draws(density, 2, np.random.default_rng(seed)) for seed in range(20)]
    logs = np.array([one.log_evidence for one in several]) - np.log(evidence)
    shares = np.array([one.shares @ (one.draws[:, 1] > 0.0) for one in several])
    assert abs(np.mean(logs)) < 4.0 * np.std(logs) / np.sqrt(20.0) + 0.02
    assert np.mean(shares) == pytest.approx(right, abs=0.04)
    assert np.std(logs) < 0.12


def test_a_peak_at_the_border_is_kept_inside() -> None:
    found = weighted_draws(inside(lambda z: 40.0 * z[:, 0]), 2, np.random.default_rng(3))
    assert np.all(np.abs(found.draws[found.shares > 0.0]) < BOX)
    assert found.shares @ found.draws[:, 0] > 4.5
    assert np.isfinite(found.log_evidence)


def test_crossings_of_steep_flat_and_exact_functions() -> None:
    zeros = np.array([0.3, -0.7, 0.0, 0.9999])

    def rising(x: np.ndarray, k: np.ndarray) -> np.ndarray:
        off = x - zeros[k]
        return np.choose(k, [np.tanh(300.0 * off), off**3, off, np.sign(off)])

    found = crossing(rising, np.full(4, -1.0), np.full(4, 1.0))
    np.testing.assert_allclose(found[[0, 2, 3]], zeros[[0, 2, 3]], atol=1e-12)
    assert found[1] == pytest.approx(zeros[1], abs=1e-4)


def test_the_peak_is_where_differences_see_no_slope() -> None:
    """BFGS leaves a slope of up to 0.1, at a place that hangs on the last digits."""

    def banana(z: np.ndarray) -> np.ndarray:
        return -0.5 * np.sum(z**2, axis=1) - 8.0 * (z[:, 1] - 0.7 * z[:, 0] ** 2 - 0.4 * z[:, 2]) ** 2 + z[:, 0]

    peak, _ = _peak(banana, 3)
    step = 0.03 * np.eye(3)
    np.testing.assert_allclose((banana(peak + step) - banana(peak - step)) / 0.06, 0.0, atol=1e-5)
