"""Coverage with runs of cheaper simulations among full ones, whose own error is known."""

from __future__ import annotations

import numpy as np
import pytest

from seqrsm.fit.least_squares import fit_least_squares
from seqrsm.fit.weights import own_weights

N, CASES = 24, 1500


def cases(own_sd: float, seed: int):
    """Quadratics in one factor: half of the runs have an error of their own."""
    rng = np.random.default_rng(seed)
    for _ in range(CASES):
        x = rng.uniform(-1.0, 1.0, N)
        Z = np.column_stack([np.ones(N), x, x**2])
        sd = np.where(np.arange(N) % 2 == 0, 0.0, own_sd)
        yield Z, Z @ np.array([5.0, 1.0, -2.0]) + rng.standard_normal(N) + sd * rng.standard_normal(N), sd, rng


def fitted(Z, y, weights):
    return fit_least_squares(Z, y, ["1", "x", "x^2"], weights=weights)


def test_weights_are_those_of_the_closed_form() -> None:
    """Without slope and with equal known variances nothing is to be weighed: sigma^2 + v is the sample variance."""
    rng = np.random.default_rng(1)
    y = rng.normal(0.0, 3.0, 50)
    found = own_weights(np.ones((50, 1)), y, np.full(50, 4.0), np.ones(50))
    sigma2 = y.var(ddof=1) - 4.0
    np.testing.assert_allclose(found, sigma2 / (sigma2 + 4.0), rtol=1e-4)


def test_runs_without_an_error_of_their_own_keep_their_weights() -> None:
    rng = np.random.default_rng(2)
    weights = rng.uniform(0.5, 2.0, 20)
    assert own_weights(np.ones((20, 1)), rng.normal(size=20), np.zeros(20), weights) is weights


def test_scores_without_scatter_of_their_own_are_weighed_by_the_known_one() -> None:
    Z, y = np.ones((6, 1)), np.full(6, 3.0)
    found = own_weights(Z, y, np.array([1.0, 1.0, 1.0, 4.0, 4.0, 4.0]), np.ones(6))
    assert found[0] / found[-1] == pytest.approx(4.0, rel=0.02)


@pytest.mark.parametrize("own_sd", [0.5, 1.0])
def test_intervals_of_a_full_run_hold(own_sd: float) -> None:
    row = np.array([[1.0, 0.3, 0.09]])
    true = float((row @ np.array([5.0, 1.0, -2.0]))[0])
    mean = future = plain = 0
    square = square_plain = 0.0
    for Z, y, sd, rng in cases(own_sd, 3):
        fresh = true + rng.standard_normal()
        found = fitted(Z, y, own_weights(Z, y, sd**2, np.ones(N))).predict(row, 0.95)
        mean += found.confidence.low[0] <= true <= found.confidence.high[0]
        future += found.prediction.low[0] <= fresh <= found.prediction.high[0]
        square += (found.mean[0] - true) ** 2
        equal = fitted(Z, y, np.ones(N)).predict(row, 0.95)
        plain += equal.prediction.low[0] <= fresh <= equal.prediction.high[0]
        square_plain += (equal.mean[0] - true) ** 2
    error = np.sqrt(0.95 * 0.05 / CASES)
    # sigma is estimated beside a known variance, which costs a little of the t interval's exactness.
    assert abs(mean / CASES - 0.95) < 4.0 * error + 0.01
    assert abs(future / CASES - 0.95) < 4.0 * error + 0.01
    assert square < square_plain
    if own_sd == 1.0:
        # The negative control: counted alike, cheap runs make the interval of a full one too wide.
        assert plain / CASES > 0.97
