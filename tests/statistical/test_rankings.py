"""Plackett-Luce scores against a published analysis, another library, brute force and simulated rankings."""

from __future__ import annotations

from itertools import permutations

import numpy as np
import pytest

from seqrsm.score import ranking
from seqrsm.score.ranking import Ranking, connected, fit_rankings, log_likelihood, most_probable


def maximum_likelihood(rankings, n_images):
    """Scores and their covariance without priors, of interpreters who are all as sharp."""
    return most_probable(rankings, np.zeros(n_images), np.zeros(1), np.inf)


def test_two_images_have_a_closed_form():
    """7 of 10 prefer the first: log(7/3), with variance 1/7 + 1/3 (a 2-by-1 table of counts)."""
    rankings = [Ranking(0, ((0,), (1,)))] * 7 + [Ranking(0, ((1,), (0,)))] * 3
    scores, covariance = maximum_likelihood(rankings, 2)
    assert scores[0] - scores[1] == pytest.approx(np.log(7 / 3), rel=1e-9)
    difference = np.array([1.0, -1.0])
    assert difference @ covariance @ difference == pytest.approx(1 / 7 + 1 / 3, rel=1e-9)
    at_estimate = log_likelihood(rankings, scores, np.zeros(1))[0]
    assert at_estimate == pytest.approx(7 * np.log(0.7) + 3 * np.log(0.3), rel=1e-9)


# Wins of the row over the column, American League (East) 1987: A. Agresti, Categorical Data Analysis, 2nd ed., p. 438.
TEAMS = ("Milwaukee", "Detroit", "Toronto", "New York", "Boston", "Cleveland", "Baltimore")
WINS = np.array(
    [
        [0, 7, 9, 7, 7, 9, 11],
        [6, 0, 7, 5, 11, 9, 9],
        [4, 6, 0, 7, 7, 8, 12],
        [6, 8, 6, 0, 6, 7, 10],
        [6, 2, 6, 7, 0, 7, 12],
        [4, 4, 5, 6, 6, 0, 6],
        [2, 4, 1, 3, 1, 7, 0],
    ]
)


def test_published_paired_comparisons():
    """A game is a ranking of two. Estimates of Agresti, table 10.11, as in the tests of the R package BradleyTerry2."""
    assert np.all((WINS + WINS.T)[~np.eye(7, dtype=bool)] == 13)
    games = [Ranking(0, ((i,), (j,))) for i in range(7) for j in range(7) for _ in range(WINS[i, j])]
    scores, covariance = maximum_likelihood(games, 7)
    over_baltimore = scores - scores[-1]
    assert np.round(np.sort(over_baltimore), 2) == pytest.approx([0.0, 0.68, 1.11, 1.25, 1.29, 1.44, 1.58])
    for i in range(6):
        difference = np.eye(7)[i] - np.eye(7)[6]
        assert np.sqrt(difference @ covariance @ difference) == pytest.approx(0.34, abs=0.01)


def random_ranking(rng, theta, kappa=1.0):
    """Sort by worth plus Gumbel noise: the ranking of Plackett and Luce."""
    return np.argsort(-(kappa * theta + rng.gumbel(size=len(theta))))


def test_full_rankings_against_statsmodels():
    """The order of deaths in strata, by Cox's partial likelihood, is the same model."""
    from statsmodels.duration.hazard_regression import PHReg

    rng = np.random.default_rng(3)
    theta = np.array([1.2, 0.4, 0.0, -0.5, -1.1])
    time, image, stratum, rankings = [], [], [], []
    for k in range(12):
        order = random_ranking(rng, theta)[: 3 + k % 3]  # some interpreters see three images only
        rankings.append(Ranking(0, tuple((int(i),) for i in order)))
        time += range(1, len(order) + 1)
        image += list(order)
        stratum += [k] * len(order)
    dummies = np.eye(5)[np.array(image)][:, 1:]
    reference = PHReg(np.array(time, float), dummies, strata=np.array(stratum), ties="breslow").fit(disp=False)
    scores, covariance = maximum_likelihood(rankings, 5)
    assert scores[1:] - scores[0] == pytest.approx(reference.params, abs=1e-6)
    for i in range(1, 5):
        difference = np.eye(5)[i] - np.eye(5)[0]
        assert difference @ covariance @ difference == pytest.approx(reference.cov_params()[i - 1, i - 1], rel=1e-5)


def strict_probability(order, theta):
    worth = np.exp(theta[list(order)])
    return np.prod([worth[k] / worth[k:].sum() for k in range(len(worth))])


@pytest.mark.parametrize("spread", [0.1, 1.0, 8.0])
def test_ties_sum_over_all_orders(spread):
    rng = np.random.default_rng(5)
    theta = spread * rng.normal(size=6)
    groups = ((2, 0, 4), (1,), (5, 3))
    total = sum(
        strict_probability((*first, *groups[1], *last), theta)
        for first in permutations(groups[0])
        for last in permutations(groups[2])
    )
    value = log_likelihood([Ranking(0, groups)], theta, np.zeros(1))[0]
    assert value == pytest.approx(np.log(total), rel=1e-10)


def test_derivatives_by_differences():
    rng = np.random.default_rng(8)
    rankings = [Ranking(0, ((0, 3), (1,), (2, 4))), Ranking(1, ((1,), (0, 2, 4), (3,))), Ranking(1, ((4,), (2,)))]
    scores, sharpness = rng.normal(size=5), rng.normal(size=2)
    _, gradient, hessian = log_likelihood(rankings, scores, sharpness)
    step = 1e-5
    for k in range(5):
        ends = [log_likelihood(rankings, scores + sign * step * np.eye(5)[k], sharpness) for sign in (1, -1)]
        assert gradient[k] == pytest.approx((ends[0][0] - ends[1][0]) / (2 * step), abs=1e-8)
        assert hessian[k] == pytest.approx((ends[0][1] - ends[1][1]) / (2 * step), abs=1e-7)


def test_recovery_with_coverage():
    """95 % intervals of score differences cover; 80 campaigns of 8 images by 6 interpreters, one of whom guesses."""
    rng = np.random.default_rng(11)
    kappa = np.array([1.5, 1.2, 1.0, 1.0, 0.8, 0.3])
    covered, guessing, n = 0, 0, 0
    for _ in range(80):
        theta = rng.normal(scale=1.5, size=8)
        rankings = [
            Ranking(j, tuple((int(i),) for i in random_ranking(rng, theta, kappa[j])))
            for j in range(6)
            for _ in range(2)
        ]
        found = fit_rankings(rankings, 8, 6)
        # Scores are in units of the average interpreter: the geometric mean of kappa.
        truth = theta * np.exp(np.log(kappa).mean())
        for i in range(1, 8):
            difference = np.eye(8)[i] - np.eye(8)[0]
            sd = np.sqrt(difference @ found.covariance @ difference)
            covered += abs(difference @ (found.scores - truth)) < 1.96 * sd
            n += 1
        guessing += int(np.argmin(found.sharpness)) == 5
    # Standard error of the coverage, were the 7 differences of a campaign one: sqrt(0.95 * 0.05 / 80) = 0.024.
    assert covered / n > 0.95 - 3 * 0.024
    assert guessing > 60


@pytest.mark.parametrize(
    ("n", "m", "spread", "of_sharpness"), [(27, 3, 1.0, 0.0), (27, 3, 3.0, 0.0), (27, 6, 1.5, 0.5), (40, 3, 1.0, 0.5)]
)
def test_few_interpreters_of_many_images(n, m, spread, of_sharpness):
    """The most probable scores and sharpnesses together put scores 1.6 times too far apart, and covered 43 %."""
    rng = np.random.default_rng(21)
    slopes, told, covered = [], [], []
    for _ in range(10):
        theta, log_kappa = rng.normal(scale=spread, size=n), rng.normal(scale=of_sharpness, size=m)
        log_kappa, theta = log_kappa - log_kappa.mean(), theta - theta.mean()
        orders = [random_ranking(rng, theta, kappa) for kappa in np.exp(log_kappa)]
        rankings = [Ranking(j, tuple((int(i),) for i in order)) for j, order in enumerate(orders)]
        found = fit_rankings(rankings, n, m)
        slopes.append(found.scores @ theta / (theta @ theta))
        told.append(found.scale_se)
        covered.append(np.mean(np.abs(found.scores - theta) < 1.96 * found.se))
    assert np.mean(slopes) == pytest.approx(1.0, abs=0.15)
    assert 0.5 < np.std(slopes) / np.mean(told) < 2.0  # of ten; sharpnesses are taken for known
    assert 0.89 < np.mean(covered) < 0.98


def test_separation_and_a_single_order_stay_finite():
    found = fit_rankings([Ranking(j, ((0,), (1,), (2,))) for j in range(5)], 3, 5)
    assert np.all(np.isfinite(found.scores))
    assert found.scores[0] > found.scores[1] > found.scores[2]
    assert np.all((found.se > 0.5) & (found.se < 5.0))
    assert found.agreement == pytest.approx(np.ones(5))
    assert found.scores.sum() == pytest.approx(0.0, abs=1e-9)


def test_connected():
    rankings = [Ranking(0, ((0,), (1,))), Ranking(0, ((2,), (3,))), Ranking(1, ((4,), (1,)))]
    groups = connected(rankings, 6)
    assert groups[0] == groups[1] == groups[4]
    assert groups[2] == groups[3]
    assert len({groups[0], groups[2], groups[5]}) == 3


def test_ranks_to_groups():
    assert Ranking.of(2, [7, 8, 9, 5], [2, 1, 2, 3.5]) == Ranking(2, ((8,), (7, 9), (5,)))


def test_agreement_is_that_of_scipy():
    from scipy.stats import kendalltau

    rng = np.random.default_rng(2)
    for _ in range(20):
        x, y = rng.integers(0, 4, 9).astype(float), rng.integers(0, 5, 9).astype(float)
        assert ranking._kendall(x, y) == pytest.approx(kendalltau(x, y).statistic)
    # One pair the wrong way round and six the right way.
    both = [Ranking(0, ((1,), (0,))), Ranking(0, ((0,), (1,), (2,), (3,)))]
    assert ranking._agreement(both, np.array([3.0, 2.0, 1.0, 0.0]), 0) == pytest.approx(5 / 7)


@pytest.mark.parametrize("n", [3, 12])
def test_rankings_that_say_nothing_leave_the_spread_that_is_assumed(n: int) -> None:
    """All images equal: scores are 0, and vary about their mean as draws of that standard deviation do."""
    found = fit_rankings([Ranking(0, (tuple(range(n)),))], n, 1)
    np.testing.assert_array_equal(found.scores, 0.0)
    assert np.isnan(found.agreement[0])
    left = ranking._LEAST_LEFT  # a fiftieth of a score's deviation is told at least
    np.testing.assert_allclose(found.se**2 * left, ranking.SPREAD_LOGIT**2 * (n - 1) / n, rtol=1e-3)
