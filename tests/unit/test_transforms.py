"""Logit of percent scores: definitions, ends, and the delta method against Monte Carlo."""

from __future__ import annotations

import numpy as np
import pytest

from seqrsm.analysis.scale import ResponseScale
from seqrsm.errors import FitError
from seqrsm.fit.transforms import logit_scores, logit_to_percent, logit_variance


def test_there_and_back() -> None:
    y = np.array([0.25, 1.0, 37.5, 50.0, 92.0, 99.75])
    np.testing.assert_allclose(logit_to_percent(logit_scores(y)), y, rtol=1e-13)
    np.testing.assert_allclose(logit_to_percent(np.array([0.0, np.log(3.0)])), [50.0, 75.0])


def test_counts_give_the_empirical_logit() -> None:
    scores = logit_scores(np.array([0.0, 100.0, 80.0]), counts=np.array([10.0, 10.0, 50.0]))
    np.testing.assert_allclose(scores, np.log([0.5 / 10.5, 10.5 / 0.5, 40.5 / 10.5]), rtol=1e-14)
    assert logit_variance(np.array([80.0]), count=50.0)[0] == pytest.approx(1 / 40.5 + 1 / 10.5, rel=1e-13)


def test_ends_without_counts_are_finite_and_light() -> None:
    percent = np.array([0.0, 50.0, 100.0])
    scores = logit_scores(percent)
    assert np.isfinite(scores).all()
    np.testing.assert_allclose(scores[[0, 2]], np.log([0.0025 / 0.9975, 0.9975 / 0.0025]), rtol=1e-12)
    scale = ResponseScale.of("logit", percent)
    np.testing.assert_array_equal(scale.values, scores)
    assert scale.weights.mean() == pytest.approx(1.0)
    assert scale.weights[0] < 1e-3 * scale.weights[1]


def test_known_and_unknown_precision_mix() -> None:
    scores = logit_scores(np.array([60.0, 60.0]), counts=np.array([np.nan, 100.0]))
    np.testing.assert_allclose(scores, np.log([60.0 / 40.0, 60.5 / 40.5]), rtol=1e-14)
    assert logit_variance(np.array([60.0]))[0] == pytest.approx((0.01 / 0.24) ** 2, rel=1e-13)
    assert logit_variance(np.array([60.0]), count=100.0)[0] == pytest.approx(1 / 60.5 + 1 / 40.5, rel=1e-13)


@pytest.mark.parametrize("p", [0.2, 0.5, 0.9])
def test_variances_against_monte_carlo(p: float) -> None:
    rng = np.random.default_rng(0)
    correct = rng.binomial(400, p, 200_000)
    logits = np.log((correct + 0.5) / (400 - correct + 0.5))
    predicted = logit_variance(np.array([100 * p]), count=400.0)[0]
    assert np.var(logits) == pytest.approx(predicted, rel=0.03)  # second-order term about 1 / (m p (1 - p))
    noisy = 100 * p + rng.normal(0, 1.0, 200_000)
    assert np.var(logit_scores(noisy)) == pytest.approx(logit_variance(np.array([100 * p]))[0], rel=0.06)


def test_scores_outside_the_scale_are_named() -> None:
    with pytest.raises(FitError, match="run 2, 3 "):
        logit_scores(np.array([50.0, 101.0, np.nan]))
