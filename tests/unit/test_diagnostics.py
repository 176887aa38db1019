"""Convergence diagnostics against arviz and against processes with known autocorrelation."""

from __future__ import annotations

import warnings

import numpy as np
import pytest

from seqrsm.fit.convergence import autocorrelation_time, ess_tail, r_hat

with warnings.catch_warnings():
    warnings.simplefilter("ignore")
    import arviz


def autoregressive(phi: float, shape: tuple[int, int], seed: int = 0) -> np.ndarray:
    """Stationary AR(1) chains (m, n) with unit innovations."""
    rng = np.random.default_rng(seed)
    x = rng.normal(size=shape)
    x[:, 0] /= np.sqrt(1 - phi**2)
    for t in range(1, shape[1]):
        x[:, t] += phi * x[:, t - 1]
    return x


@pytest.mark.parametrize("shape", [(4, 1000), (4, 501), (2, 300), (8, 64)])
@pytest.mark.parametrize("phi", [0.0, 0.5, 0.9, -0.5])
def test_equal_to_arviz(phi: float, shape: tuple[int, int]) -> None:
    for seed in range(3):
        x = autoregressive(phi, shape, seed) + 0.1 * np.arange(shape[0])[:, None]
        assert r_hat(x) == pytest.approx(float(arviz.rhat(x)), rel=1e-10)
        assert ess_tail(x) == pytest.approx(float(arviz.ess(x, method="tail", prob=(0.05, 0.95))), rel=1e-8)


def test_equal_to_arviz_with_heavy_tails_and_ties() -> None:
    x = np.random.default_rng(1).standard_cauchy((4, 400))
    for chains in (x, np.round(x)):
        assert r_hat(chains) == pytest.approx(float(arviz.rhat(chains)), rel=1e-10)
        assert ess_tail(chains) == pytest.approx(float(arviz.ess(chains, method="tail", prob=(0.05, 0.95))), rel=1e-8)


def test_chains_that_disagree_are_seen_in_place_and_in_width() -> None:
    x = np.random.default_rng(2).normal(size=(4, 1000))
    assert r_hat(x) < 1.01
    moved, widened = x.copy(), x.copy()
    moved[0] += 1.0
    widened[0] *= 3.0
    assert r_hat(moved) > 1.05
    assert r_hat(widened) > 1.05  # only the folded ranks see this one


@pytest.mark.parametrize("phi", [0.0, 0.6, 0.9, 0.97])
def test_autocorrelation_time_of_a_known_process(phi: float) -> None:
    """AR(1): tau = (1 + phi) / (1 - phi). Sokal's relative error: sqrt(2 (2M + 1) / (steps * walkers)), M = 5 tau."""
    x = autoregressive(phi, (200, 4000), 7).T[:, :, None]
    tau = (1 + phi) / (1 - phi)
    tolerance = 4 * np.sqrt(2 * (10 * tau + 1) / (4000 * 200)) + np.exp(-10) + 5 * tau / 4000
    assert autocorrelation_time(x)[0] == pytest.approx(tau, rel=tolerance + 0.01)


def test_constant_chains_are_not_called_converged() -> None:
    assert np.isinf(autocorrelation_time(np.ones((100, 4, 2)))).all()
    assert np.isnan(r_hat(np.ones((4, 100))))
