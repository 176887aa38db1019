"""A sensor inside the region against the optimum, by the fitted surface: Student's t of a difference, and its draws."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from scipy import stats
from test_steps import analysis

from seqrsm.analysis.candidates import Sufficing, by_surface

OPTIMISM, SD_DIFFERENCE, SD_SCORE, DRAWS = 0.5, 1.5, 4.0, 400_000


@pytest.fixture(scope="module")
def found(tmp_path_factory):
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("seqrsm.analysis.belief.PRIOR_LOG_ODDS", -100.0)
        made = analysis(tmp_path_factory.mktemp("candidates"))
    assert made.fitted.departure.probability == 0.0
    return made


def told(found, points, rule, optimism=OPTIMISM, limits=(-np.inf, np.inf)):
    application = SimpleNamespace(goal=found.goal, score_limits=limits)
    fitted, optimum = replace(found.fitted, application=application), replace(found.optimum, optimism=optimism)
    of = replace(found, fitted=fitted, optimum=optimum)
    return by_surface(of, points, rule, (np.array([SD_DIFFERENCE]), np.array([SD_SCORE])), np.random.default_rng(1))


def expected(found, points):
    """Means of the two settings, and what draws of the two by Student's distribution of the fit depart from them by."""
    fit, rows, rng = found.fit, found.model.matrix(points), np.random.default_rng(2)
    normal = rng.multivariate_normal(np.zeros(2), fit.s**2 * rows @ fit.covariance_unscaled @ rows.T, DRAWS)
    scale = np.sqrt(fit.df_residual / rng.chisquare(fit.df_residual, DRAWS))
    return rows @ fit.estimate, normal * scale[:, None], rng


@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_a_sensor_not_better_has_the_t_interval_of_the_difference(found, sign: float) -> None:
    low, high = np.array([-1.0, -0.5, 1.0]), np.array([1.0, 0.4, 2.0])
    points = np.array([low, high] if sign > 0.0 else [high, low])
    means, scatter, rng = expected(found, points)
    shift = means[0] - means[1] + sign * OPTIMISM
    assert sign * shift < -1.0
    rule = Sufficing(0.8 * shift, True, sign)
    one = told(found, points, rule, sign * OPTIMISM)
    assert one.score == pytest.approx(means[0])
    assert one.difference == pytest.approx(shift)
    row, fit = np.subtract(*found.model.matrix(points)), found.fit
    half = float(stats.t.ppf(0.975, fit.df_residual) * fit.s * np.sqrt(row @ fit.covariance_unscaled @ row))
    wanted = [shift - half - max(sign, 0.0) * OPTIMISM, shift + half - min(sign, 0.0) * OPTIMISM]
    assert [one.confidence.low, one.confidence.high] == pytest.approx(wanted, abs=0.1 * half)
    future = shift + scatter[:, 0] - scatter[:, 1] + SD_DIFFERENCE * rng.standard_normal(DRAWS)
    ends = np.quantile(future, [0.025, 0.975]) - OPTIMISM * np.array([max(sign, 0.0), min(sign, 0.0)])
    assert [one.one_ground.low, one.one_ground.high] == pytest.approx(ends, abs=0.08 * np.ptp(ends))
    assert one.probability == pytest.approx(np.mean(sign * (future - rule.score) >= 0.0), abs=0.03)


def test_a_sensor_that_seems_better_is_told_as_good_as_the_optimum(found) -> None:
    points = np.array([[1.0, 0.4, 2.0], [-1.0, -0.5, 1.0]])
    means, _, _ = expected(found, points)
    assert means[0] > means[1] + 3.0
    one = told(found, points, Sufficing(0.0, True, 1.0))
    assert one.difference == pytest.approx(0.0, abs=1e-9)
    assert one.score == pytest.approx(means[1] - OPTIMISM)


def test_a_target_counts_the_score_itself_and_its_own_scatter(found) -> None:
    points = np.array([[-1.0, -0.5, 1.0], [1.0, 0.4, 2.0]])
    means, scatter, rng = expected(found, points)
    future = means[0] + scatter[:, 0] + SD_SCORE * rng.standard_normal(DRAWS)
    for target in (means[0] - SD_SCORE, means[0] + 2.0):
        one = told(found, points, Sufficing(float(target), False, 1.0))
        assert one.probability == pytest.approx(np.mean(future >= target), abs=0.03)


@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_no_score_is_beyond_what_there_can_be(found, sign: float) -> None:
    """Told was 100.3 percent, and a difference that draws beyond 100 make."""
    points = np.array([[1.0, 0.3, 2.0], [1.0, 0.4, 2.0]])
    means, scatter, _ = expected(found, points)
    end = float(means.mean()) - sign  # both settings are beyond it
    limits = (-np.inf, end) if sign > 0.0 else (end, np.inf)
    one = told(found, points, Sufficing(0.0, True, sign), 0.0, limits)
    assert (one.score, one.difference) == (end, 0.0)
    above = max(sign * (means[0] - means[1]), 0.0) * sign  # as chosen as the optimum
    drawn = np.clip(means + scatter - [above, 0.0], *limits)
    ends = np.quantile(drawn[:, 0] - drawn[:, 1], [0.025, 0.975]) - [max(-above, 0.0), min(-above, 0.0)]
    assert [one.confidence.low, one.confidence.high] == pytest.approx(ends, abs=0.1 * np.ptp(ends))


def test_one_ground_tells_no_difference_beyond_the_scale(found) -> None:
    points = np.array([[-1.0, -0.5, 1.0], [1.0, 0.4, 2.0]])
    free = told(found, points, Sufficing(-2.0, True, 1.0)).one_ground
    most = -0.5 * (free.low + free.high)
    cut = told(found, points, Sufficing(-2.0, True, 1.0, most)).one_ground
    assert free.low < -most < free.high < 0.0
    assert (cut.low, cut.high) == (-most, free.high)
