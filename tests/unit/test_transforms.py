"""Logit of percent scores: definitions, ends, the delta method against Monte Carlo, fits against those in percent."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.optimize import least_squares
from scipy.special import expit
from scipy.stats import binom

from seqrsm.analysis.scale import Interval, ResponseScale
from seqrsm.errors import FitError
from seqrsm.fit.least_squares import fit_least_squares
from seqrsm.fit.transforms import logit_scores, logit_to_percent, logit_variance
from seqrsm.fit.weights import unbiased_logits


def test_there_and_back() -> None:
    y = np.array([0.25, 1.0, 37.5, 50.0, 92.0, 99.75])
    np.testing.assert_allclose(logit_to_percent(logit_scores(y)), y, rtol=1e-13)
    np.testing.assert_allclose(logit_to_percent(np.array([0.0, np.log(3.0)])), [50.0, 75.0])


def test_counts_give_the_empirical_logit() -> None:
    scores = logit_scores(np.array([0.0, 100.0, 80.0]), counts=np.array([10.0, 10.0, 50.0]))
    np.testing.assert_allclose(scores, np.log([0.5 / 10.5, 10.5 / 0.5, 40.5 / 10.5]), rtol=1e-14)


def test_ends_without_counts_are_finite_and_light() -> None:
    percent = np.array([0.0, 50.0, 100.0])
    scores = logit_scores(percent)
    assert np.isfinite(scores).all()
    np.testing.assert_allclose(scores[[0, 2]], np.log([0.0025 / 0.9975, 0.9975 / 0.0025]), rtol=1e-12)
    scale = ResponseScale.of("logit", percent, np.eye(3))
    np.testing.assert_array_equal(scale.values, scores)
    assert scale.weights.mean() == pytest.approx(1.0)
    assert scale.weights[0] == pytest.approx(4.0 * 0.0025 * 0.9975 * scale.weights[1])


def test_known_and_unknown_precision_mix() -> None:
    scores = logit_scores(np.array([60.0, 60.0]), counts=np.array([np.nan, 100.0]))
    np.testing.assert_allclose(scores, np.log([60.0 / 40.0, 60.5 / 40.5]), rtol=1e-14)
    assert logit_variance(np.array([60.0]))[0] == pytest.approx(4.0 * 0.24 * (0.01 / 0.24) ** 2, rel=1e-13)
    assert logit_variance(np.array([60.0]), equal=True)[0] == pytest.approx((0.01 / 0.24) ** 2, rel=1e-13)


@pytest.mark.parametrize("n", [10, 100, 401, 5000])
@pytest.mark.parametrize("wrong", [0.5, 1.0, 2.0, 5.0, 19.9, 20.1, 80.0])
def test_variance_of_an_empirical_logit_is_that_over_all_counts(n: int, wrong: float) -> None:
    """1 / (correct + 1/2) + 1 / (wrong + 1/2) tells 2.6 times as much where 1/2 is expected, of 5 a fifth less."""
    if wrong > 0.5 * n:
        return
    counts = np.arange(n + 1)
    shares, logits = binom.pmf(counts, n, 1.0 - wrong / n), np.log((counts + 0.5) / (n - counts + 0.5))
    true = shares @ np.square(logits) - (shares @ logits) ** 2
    ends = logit_variance(100.0 * np.array([wrong / n, 1.0 - wrong / n]), count=np.array([n, n]))
    np.testing.assert_allclose(ends, true, rtol=4e-3)


def test_variance_of_counts_knows_no_certainty() -> None:
    ends = logit_variance(np.array([0.0, 2.0, 98.0, 100.0]), count=25.0)
    np.testing.assert_allclose(ends, ends[1], rtol=1e-12)


@pytest.mark.parametrize("p", [0.2, 0.5, 0.9])
def test_variance_of_a_point_against_monte_carlo(p: float) -> None:
    rng = np.random.default_rng(0)
    for equal, sd in ((True, 1.0), (False, 2.0 * np.sqrt(p * (1.0 - p)))):
        noisy = 100 * p + rng.normal(0, sd, 200_000)
        assert np.var(logit_scores(noisy)) == pytest.approx(
            logit_variance(np.array([100 * p]), equal=equal)[0], rel=0.06
        )


def test_scores_outside_the_scale_are_named() -> None:
    with pytest.raises(FitError, match="run 2, 3 "):
        logit_scores(np.array([50.0, 101.0, np.nan]))


def squares(reps: int) -> tuple[np.ndarray, np.ndarray]:
    """Model matrix of a 3 x 3 design, run ``reps`` times, and the true coefficients: 95 % at its best."""
    a, b = np.tile([(a, b) for a in (-1.0, 0.0, 1.0) for b in (-1.0, 0.0, 1.0)], (reps, 1)).T
    Z = np.column_stack([np.ones(len(a)), a, b, a * b, a * a, b * b])
    return Z, np.array([np.log(19.0) - 0.04, 0.3, -0.1, 0.2, -0.8, -0.6])


@pytest.mark.parametrize("seed", range(3))
def test_fit_of_logits_is_least_squares_in_percent(seed: int) -> None:
    """Coefficients and standard errors are those of scipy's nonlinear fit of expit(Z beta) to the scores themselves."""
    Z, beta = squares(8)
    se = np.random.default_rng(seed).uniform(0.5, 3.0, len(Z))
    percent = 100.0 * expit(Z @ beta) + se * np.random.default_rng(seed).normal(size=len(Z))
    scale = ResponseScale.of("logit", percent, Z, se)
    found = fit_least_squares(Z, scale.values, ["1", "a", "b", "ab", "aa", "bb"], weights=scale.weights)
    theirs = least_squares(lambda b: (percent - 100.0 * expit(Z @ b)) / se, found.estimate)
    s = np.sqrt(2.0 * theirs.cost / found.df_residual)
    their_se = s * np.sqrt(np.diag(np.linalg.inv(theirs.jac.T @ theirs.jac)))
    np.testing.assert_array_less(np.abs(found.estimate - theirs.x) / their_se, 0.35)
    np.testing.assert_allclose(found.se, their_se, rtol=0.1)


@pytest.mark.parametrize("as_shares", [True, False])
def test_mean_of_a_logit_fit_is_covered_however_many_runs(as_shares: bool) -> None:
    """Of 144 runs of 2 points at 95 percent, as shares scatter, or all alike, as their standard errors say.

    Weights by the scores themselves, the control, hold the optimum of the latter half a point too low: a third covered.
    """
    Z, beta = squares(16)
    at = np.array([[1.0, 0.2, -0.1, -0.02, 0.04, 0.01]])
    truth, rng, covered = float(at[0] @ beta), np.random.default_rng(0), []
    mean = 100.0 * expit(Z @ beta)
    sd = 2.0 * np.sqrt(mean * (100.0 - mean) / 475.0) if as_shares else np.full(len(Z), 2.0)
    for _ in range(300):
        percent = np.clip(mean + sd * rng.normal(size=len(Z)), 0.0, 100.0)
        scale = ResponseScale.of("logit", percent, Z, None if as_shares else sd)
        of_scores = logit_scores(percent), 1.0 / logit_variance(percent, equal=not as_shares)
        for values, weights in ((scale.values, scale.weights), of_scores):
            fit = fit_least_squares(Z, values, ["1", "a", "b", "ab", "aa", "bb"], weights=weights).predict(at)
            covered.append(fit.confidence.low[0] <= truth <= fit.confidence.high[0])
    ours, control = np.mean(np.reshape(covered, (-1, 2)), axis=0)
    assert 0.90 < ours < 0.98
    assert control < (0.9 if as_shares else 0.5)


@pytest.mark.parametrize("known", ["nothing", "counts", "se"])
def test_a_future_run_weighs_as_one_that_was_made_where_as_much_is_expected(known) -> None:
    """As shares do by p (1 - p); with one standard error in percent by (p (1 - p))^2, the delta method."""
    Z = np.column_stack([np.ones(60), np.linspace(-1.0, 1.0, 60)])
    scores = 100.0 * expit(Z @ [1.0, 1.5])
    made = ResponseScale.of("logit", scores, Z, np.full(60, 2.0) if known == "se" else None)
    power = 2 if known == "se" else 1
    if known == "counts":
        made = ResponseScale.of_counts("logit", scores, np.full(60, 400.0), Z)
    shares = np.array([0.5, 0.8, 0.92])
    weights = made.weight_at(np.log(shares / (1.0 - shares)))
    assert weights / weights[0] == pytest.approx((4.0 * shares * (1.0 - shares)) ** power, rel=0.03)
    assert made.weight_at(Z @ [1.0, 1.5]) == pytest.approx(made.weights, rel=0.03)


def test_logits_of_a_fit_with_few_degrees_of_freedom_are_right_on_average() -> None:
    """Ten runs of six terms about 95 percent, none repeated: their residuals have two fifths of the scatter."""
    rng = np.random.default_rng(0)
    Z = np.column_stack([np.ones(10), rng.uniform(-1.0, 1.0, (10, 5))])
    slope = 1.0 / (100.0 * 0.95 * 0.05)  # of the logit at 95 percent: what errors of mean 0 do is left out
    errors = 1.2 * rng.standard_normal((60, 10))
    found = [np.mean(unbiased_logits(Z, 95.0 + error, np.ones(10))[0] - slope * error) for error in errors]
    assert np.mean(found) == pytest.approx(float(logit_scores(np.array(95.0))), abs=0.012)


@pytest.mark.parametrize("percent", [50.0, 95.0])
def test_a_short_prediction_interval_of_percentages_is_as_long_as_its_parts_together(percent: float) -> None:
    """0.03 logits of the mean and 0.04 of a run's chance are 0.05, times the slope 100 p (1 - p)."""
    scale = ResponseScale("logit", np.zeros(1), np.ones(1), 1.0)
    middle = float(logit_scores(np.array(percent)))
    low, high = scale.of_runs(Interval(middle - 0.03, middle + 0.03), Interval(middle - 0.05, middle + 0.05), 1.0)
    half = 0.05 * percent * (1.0 - percent / 100.0)
    assert (percent - float(low), float(high) - percent) == pytest.approx((half, half), rel=0.015)


def test_a_future_score_rests_on_the_median_of_the_decisions() -> None:
    trials, Z = np.array([100.0, 900.0, 100.0, 200.0, 150.0]), np.ones((5, 1))
    for kind in ("identity", "logit"):
        assert ResponseScale.of_counts(kind, np.full(5, 80.0), trials, Z).trials == 150.0
