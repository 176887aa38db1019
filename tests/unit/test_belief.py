"""Quadratic and process by their probabilities: the ends 0 and 1, mixtures against root finding, and the extremes."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from process_cases import bowl, hill, spread
from scipy import optimize, stats
from scored_campaigns import analysed, campaign, numeric, specification

from seqrsm.analysis import belief as belief_module
from seqrsm.analysis.belief import Departure, Fitted, _mixture_quantile, intervals_by_draws, mixed_quantiles
from seqrsm.analysis.conclude import analyse
from seqrsm.analysis.ground import Ground
from seqrsm.analysis.optimism import optimism
from seqrsm.analysis.posterior import draw_coefficients
from seqrsm.analysis.results import Analysis
from seqrsm.analysis.surfaces import TwoSources
from seqrsm.analysis.to_json import analysis_to_json
from seqrsm.campaign import next_runs
from seqrsm.campaign.check import check_campaign
from seqrsm.campaign.rehearsal import scored_run
from seqrsm.design.factors import ContinuousFactor
from seqrsm.design.quadratic import QuadraticModel
from seqrsm.fit.intervals import Prediction
from seqrsm.fit.process import MOST_SETTINGS, Process
from seqrsm.report.blocks import Paragraph
from seqrsm.report.sections.shape import _departure, _place
from seqrsm.spec.read import load_spec
from seqrsm.store.records import NewRun, NewScore

TWO = specification(numeric(2))
NOISE = np.random.default_rng(9).normal(size=400)


@pytest.fixture(scope="module")
def narrow(tmp_path_factory) -> Analysis:
    """A narrow top, 30 runs."""
    points = np.round(spread(30, 2), 3)
    return analysed(tmp_path_factory.mktemp("narrow") / "c", TWO, points, hill(points) + NOISE[:30])


@pytest.mark.parametrize("error", [600.0, 2.1])
def test_a_stationary_point_that_nothing_determines_has_no_number(narrow: Analysis, error: float) -> None:
    """A report of a radiometer gave a resolution between 5 x 10^-136 and 7 x 10^136 m, in all digits."""
    told = _place(narrow, np.array([0.5, -0.25]), np.array([0.1, error]))
    first, second = narrow.region.names
    assert told.replace("\u00a0", " ") == f"{first} 0.50 ± 0.10 and {second} not determined"


def believed(analysis: Analysis, probability: float) -> Fitted:
    belief = analysis.fitted
    return replace(belief, departure=replace(belief.departure, by_scores=probability, reason=""))


def ends(found: Prediction) -> np.ndarray:
    return np.array([found.confidence.low, found.confidence.high, found.prediction.low, found.prediction.high])


AT = spread(5, 2, seed=12)


def test_probability_is_that_of_bayes(narrow: Analysis) -> None:
    departure = narrow.fitted.departure
    odds = np.exp(departure.log_bayes_factor)  # even before the scores
    share = odds / (1.0 + odds)
    assert departure.probability == (0.0 if share < 0.01 else pytest.approx(share))
    assert departure.probability > 0.9
    assert departure.reason == ""


@pytest.mark.parametrize(
    ("height", "weak", "terms"), [(35.0, 0.0, 6), (35.0, 0.3, 6), (35.0, 2.5, 10), (70.0, 2.0, 10)]
)
def test_runs_are_asked_for_terms_in_factors_that_matter(
    tmp_path: Path, height: float, weak: float, terms: int
) -> None:
    """A bell over two of five factors, and a slope in a third, to be seen in a scatter of 1 or not.

    One that is seen counts, be it less than a tenth of what the bell does.
    """
    points = np.round(spread(60, 5), 3)
    y = 50.0 + height * np.exp(-np.sum(points[:, :2] ** 2, axis=1) / 0.5) + weak * points[:, 2] + NOISE[:60]
    found = analysed(tmp_path / "c", specification(numeric(5)), points, y)
    assert found.fitted.departure.probability > 0.99
    assert found.fitted.acting_terms() == terms
    assert believed(found, 0.4).acting_terms() == 0  # the quadratic is likelier


def test_a_factor_that_was_hardly_moved_may_matter(tmp_path: Path) -> None:
    """Its mean effect is 0.3 of a run's scatter, with what the scores leave open 0.7."""
    points = np.round(spread(60, 5) * [1.0, 1.0, 1.0, 1.0, 0.15], 4)
    y = 50.0 + 35.0 * np.exp(-np.sum(points[:, :2] ** 2, axis=1) / 0.5) + NOISE[:60]
    assert analysed(tmp_path / "c", specification(numeric(5)), points, y).fitted.acting_terms() == 10


def test_all_terms_count_where_all_factors_matter(tmp_path: Path) -> None:
    points = np.round(spread(60, 5), 3)
    y = 50.0 + 4.0 * np.sum(np.abs(points), axis=1) + NOISE[:60]
    found = analysed(tmp_path / "c", specification(numeric(5)), points, y)
    assert believed(found, 1.0).acting_terms() == 21


def test_process_and_quadratic_have_even_odds_before_the_scores(tmp_path: Path) -> None:
    points = np.round(spread(30, 2), 3)
    y = 80.0 - 10.0 * np.sum((points - 0.2) ** 2, axis=1) + NOISE[:30]
    departure = analysed(tmp_path / "c", TWO, points, y).fitted.departure
    assert 0.01 < departure.probability < 0.9
    odds = departure.probability / (1.0 - departure.probability)
    assert np.log(odds) == pytest.approx(departure.log_bayes_factor, abs=1e-9)


@pytest.mark.parametrize(("n", "alone"), [(10, True), (11, True), (13, True), (14, False)])
def test_scores_that_a_quadratic_nearly_passes_through_are_told_by_the_process_alone(
    tmp_path: Path, n: int, alone: bool, monkeypatch
) -> None:
    """Of 11 scores of 67 to 76 the mean was told as 170 (59 to 603), of 10 as 151, without an interval."""
    monkeypatch.setattr(belief_module, "_FAR", np.inf)
    rng = np.random.default_rng(2)
    points = rng.uniform(-1.0, 1.0, (n, 3)).round(3)
    made = campaign(tmp_path / "c", specification(numeric(3)), points, 71.0 + 2.0 * rng.standard_normal(n))
    (analysis,) = made.analyse_all(n_draws=400)
    departure, best = analysis.fitted.departure, analysis.optimum
    told = " ".join(analysis.warnings)
    assert ("No error estimate" in told, "rest on shrunk coefficients" in told) == ((n == 10),) * 2
    assert (departure.probability == 1.0) is alone
    assert ("fewer than 4 degrees of freedom" in departure.reason) is alone
    assert departure.favoured is (departure.probability > 0.5 and not alone)
    if alone:
        assert analysis.of_quadratic.value > 85.0
        assert 65.0 < best.confidence.low < 71.0 < best.confidence.high < 80.0
        assert np.all(np.array(analysis.fitted.scatter(best.point)) > 0.0)
        (paragraph,) = [block for block in _departure(analysis) if isinstance(block, Paragraph)]
        assert "alone gives settings and intervals" in paragraph.text
        assert "another surface" not in check_campaign(tmp_path / "c").surfaces
        assert "spread" in {run.purpose for run in made.decide(4, analyses=[analysis])}  # as where neither is certain


@pytest.mark.parametrize("seed", [4, 5, 6, 7])
def test_a_hill_that_was_taken_for_a_plane_is_found_and_a_plane_stays_one(tmp_path: Path, seed: int) -> None:
    """By least squares alone the hill lost 11 points, and its mean was covered in 15 % of 40 campaigns."""
    rng, text = np.random.default_rng(seed), specification(numeric(2), rest="[model]\norder = 1\n")
    points = rng.uniform(-1.0, 1.0, (30, 2)).round(3)

    def hill_at(at: np.ndarray) -> np.ndarray:
        return 80.0 - 12.0 * np.sum((at - [0.2, -0.3]) ** 2, axis=1)

    def plane_at(at: np.ndarray) -> np.ndarray:
        return 70.0 + at @ [6.0, -4.0]

    for name, truth, top in (("hill", hill_at, 80.0), ("plane", plane_at, 80.0)):
        found = analysed(tmp_path / name, text, points, truth(points) + 2.0 * rng.standard_normal(30))
        best, here = found.optimum, truth(found.optimum.point[None, :])[0]
        assert here > top - 2.0
        assert best.confidence.low < here < best.confidence.high
        assert found.fitted.departure.favoured or name == "plane"


@pytest.mark.parametrize("seed", [3, 4, 5, 6])
def test_far_from_runs_that_lie_together_least_squares_are_not_believed(tmp_path: Path, seed: int) -> None:
    """Of 18 scores up to 92 the mean was told as 98 to 222 (-36 to 855) at settings that lose 24 to 44 points."""
    rng = np.random.default_rng(seed)
    points = np.clip(rng.uniform(-0.5, 0.5, 3) + 0.15 * rng.standard_normal((18, 3)), -1.0, 1.0).round(3)

    def truth(at: np.ndarray) -> np.ndarray:
        return 90.0 - 10.0 * np.sum((at - [0.4, -0.3, 0.0]) ** 2, axis=1)

    scores = truth(points) + 2.0 * rng.standard_normal(18)
    found = analysed(tmp_path / "c", specification(numeric(3)), points, scores)
    best, departure, here = found.optimum, found.fitted.departure, truth(found.optimum.point[None, :])[0]
    assert here > truth(points)[np.argmax(scores)] - 6.0
    assert best.confidence.low < here < best.confidence.high < best.confidence.low + 45.0
    assert departure.probability == 1.0
    assert departure.favoured == (departure.log_bayes_factor > 0.0)
    (paragraph,) = [block for block in _departure(found) if isinstance(block, Paragraph)]
    assert "alone gives settings and intervals" in paragraph.text
    assert "far from the runs" in paragraph.text


def test_the_process_that_is_believed_alone_for_want_of_scores_says_so_wherever_the_optimum_is(tmp_path: Path) -> None:
    rng = np.random.default_rng(3)
    points = 0.1 * rng.standard_normal((11, 3)).round(3)
    found = analysed(tmp_path / "c", specification(numeric(3)), points, 70.0 + 2.0 * rng.standard_normal(11))
    departure = found.fitted.departure
    assert departure.probability == 1.0
    assert departure.reason == "least squares of 11 scores leave fewer than 4 degrees of freedom"


def test_a_few_flights_on_days_of_their_own_leave_no_want_of_scores(tmp_path: Path) -> None:
    """Those of the flights' scatter passed for what least squares of all scores leave, and the process was alone."""
    rng = np.random.default_rng(3)
    points = rng.uniform(-1.0, 1.0, (34, 2)).round(3)
    scores = 80.0 - 10.0 * np.sum(points**2, axis=1) + rng.standard_normal(34)
    source, days = ["simulation"] * 30 + ["flight"] * 4, [""] * 30 + ["a", "a", "b", "b"]
    text = specification(numeric(2), rest='[model]\nblock = "day"\n')
    found = analysed(tmp_path / "c", text, points, scores, source=source, block=days)
    assert found.fitted.surface.df_residual < 4 < found.fit.df_residual
    assert found.fitted.departure.reason == ""
    assert found.fitted.departure.probability < 1.0


def test_with_probability_0_all_is_the_quadratics(narrow: Analysis) -> None:
    belief, surface = believed(narrow, 0.0), narrow.fitted.surface
    np.testing.assert_array_equal(belief.mean(AT), surface.rows(AT) @ surface.estimate)
    for weight, m in ((1.0, 1), (1.0, 5), (2.5, 3)):
        wanted = surface.predict(surface.rows(AT), 0.9, weight, m)
        np.testing.assert_array_equal(ends(belief.bands(AT, 0.9, weight, m)), ends(wanted))
    rng = np.random.default_rng(1)
    assert belief.best(narrow.of_quadratic, narrow.data.points, rng) is narrow.of_quadratic


@pytest.mark.parametrize("share", [0.0, 0.4, 1.0])
def test_runs_are_weighed_by_the_mean_that_is_believed(narrow: Analysis, share: float) -> None:
    belief = believed(narrow, share)
    found = belief.bands(AT, 0.9, lambda mean: 1.0 + np.square(mean / 50.0))
    wanted = belief.bands(AT, 0.9, 1.0 + np.square(belief.mean(AT) / 50.0))
    np.testing.assert_allclose(ends(found), ends(wanted), rtol=1e-10)


def test_beside_three_flights_an_improbable_process_leaves_intervals_as_they_are(tmp_path: Path) -> None:
    """They were 1.5 times as wide: flights' own scatter was taken for all that is not known of their mean."""
    points = np.round(spread(33, 2), 3)
    scores = hill(points) + NOISE[:33] - 2.0 * (np.arange(33) >= 30)
    source = ["simulation"] * 30 + ["flight"] * 3
    text = specification(numeric(2), rest="[model]\ndiscrepancy_sd = 2.0\n")
    analysis = analysed(tmp_path / "c", text, points, scores, source=source)
    belief, surface = believed(analysis, 1e-9), analysis.fitted.surface
    for m in (1, 5):
        wanted = surface.predict(surface.rows(AT), 0.95, 1.0, m)
        np.testing.assert_allclose(ends(belief.bands(AT, 0.95, 1.0, m)), ends(wanted), rtol=1e-5)


def distribution(belief: Fitted, at: int, points: np.ndarray, kind: str, m: int = 1):
    """Distribution function of the surface, or of the mean of m runs, at one point, and its rough reach."""
    surface, process, share = belief.surface, belief.departure.process, belief.departure.probability
    assert process is not None
    plain = surface.predict(surface.rows(points), 0.95, 1.0, m)
    half = 0.5 * (getattr(plain, kind).high - getattr(plain, kind).low)[at]
    se = half / stats.t.ppf(0.975, surface.df_residual)
    means, variances = process.marginals(points)
    added = process.noise_variance[:, None] / m if kind == "prediction" else np.zeros_like(means)
    sd = np.sqrt(variances + added)[:, at]

    def of(x: float) -> float:
        student = stats.t.cdf((x - plain.mean[at]) / se, surface.df_residual)
        return float((1.0 - share) * student + share * np.mean(stats.norm.cdf((x - means[:, at]) / sd)))

    return of


@pytest.mark.parametrize("share", [0.0, 0.3, 1.0])
def test_scatter_of_a_run_and_doubt_about_the_mean_are_those_of_the_mixture(narrow: Analysis, share: float) -> None:
    belief, process, surface = believed(narrow, share), narrow.fitted.departure.process, narrow.fitted.surface
    assert process is not None
    (means, variances), row = process.marginals(AT[:1]), surface.rows(AT[:1])
    noise = process.noise_variance
    rng, n = np.random.default_rng(4), 400_000
    d = rng.integers(len(noise), size=n)
    chosen = rng.random(n) < share
    sd = np.where(chosen, np.sqrt(variances[d, 0]), surface.s * np.sqrt(surface.variance_unscaled(row)[0]))
    drawn = np.where(chosen, means[d, 0], (row @ surface.estimate)[0]) + sd * rng.standard_normal(n)
    s, h = belief.scatter(AT[0])
    assert s**2 == pytest.approx(share * noise.mean() + (1.0 - share) * surface.s**2)
    assert s**2 * h == pytest.approx(np.var(drawn), rel=0.02)


def test_the_floor_is_the_scatter_of_runs_and_not_what_the_quadratic_misses(tmp_path: Path) -> None:
    """A step, and repeats that agree: the target was told to be below a floor of 12 that no run can lower."""
    points = np.repeat(np.linspace(-1.0, 1.0, 9)[:, None], 3, axis=0)
    scores = np.where(points[:, 0] > 0.1, 90.0, 50.0) + 0.5 * NOISE[:27]
    found = analysed(tmp_path / "c", specification(numeric(1)), points, scores)
    assert found.fit.s > 5.0
    assert found.fitted.departure.probability > 0.9
    assert found.decision.noise_floor < 4.0 < found.decision.half_width
    assert not any("noise floor" in text for text in found.decision.reasons)


@pytest.mark.parametrize("share", [0.02, 0.3, 0.7, 1.0])
@pytest.mark.parametrize("level", [0.8, 0.95, 0.99])
def test_ends_are_where_the_mixtures_distribution_function_says(narrow: Analysis, share: float, level: float) -> None:
    belief, tail = believed(narrow, share), 0.5 * (1.0 - level)
    for kind, m in (("confidence", 1), ("prediction", 1), ("prediction", 5)):
        found = getattr(belief.bands(AT, level, 1.0, m), kind)
        for i in range(len(AT)):
            of = distribution(belief, i, AT, kind, m)
            low, high = (optimize.brentq(lambda x, p=p, of=of: of(x) - p, -1e4, 1e4) for p in (tail, 1.0 - tail))
            np.testing.assert_allclose([found.low[i], found.high[i]], [low, high], atol=1e-6 * (high - low))


def test_with_probability_1_all_is_the_processes(narrow: Analysis) -> None:
    belief, process = believed(narrow, 1.0), narrow.fitted.departure.process
    assert process is not None
    np.testing.assert_allclose(belief.mean(AT), process.mean(AT), rtol=1e-12)
    np.testing.assert_allclose(belief.bands(AT, 0.95).mean, process.mean(AT), rtol=1e-12)
    best = belief.best(narrow.of_quadratic, narrow.data.points, np.random.default_rng(1))
    side = np.linspace(-1.0, 1.0, 81)
    grid = np.stack(np.meshgrid(side, side), axis=-1).reshape(-1, 2)
    assert best.value >= process.mean(grid).max() - 1e-6
    assert np.linalg.norm(best.point - 0.3) < 0.15
    assert best.value == pytest.approx(float(process.mean(best.point[None, :])[0]))


def test_mean_and_optimum_of_the_two_together(narrow: Analysis) -> None:
    belief, process, surface = believed(narrow, 0.4), narrow.fitted.departure.process, narrow.fitted.surface
    assert process is not None
    side = np.linspace(-1.0, 1.0, 81)
    grid = np.stack(np.meshgrid(side, side), axis=-1).reshape(-1, 2)
    both = 0.6 * surface.rows(grid) @ surface.estimate + 0.4 * process.mean(grid)
    np.testing.assert_allclose(belief.mean(grid), both, rtol=1e-12)
    best = belief.best(narrow.of_quadratic, narrow.data.points, np.random.default_rng(1))
    assert best.value >= both.max() - 1e-6


@pytest.mark.parametrize("share", [0.0, 0.05, 0.5, 1.0])
def test_interval_of_the_mean_lies_inside_that_of_five_runs_inside_that_of_one(narrow: Analysis, share: float) -> None:
    belief, at = believed(narrow, share), spread(12, 2, seed=4)
    one, five = belief.bands(at, 0.95), belief.bands(at, 0.95, 1.0, 5)
    np.testing.assert_array_equal(ends(one)[:2], ends(five)[:2])
    assert np.all(one.prediction.low < five.prediction.low)
    assert np.all(five.prediction.low < five.confidence.low)
    assert np.all(five.confidence.high < five.prediction.high)
    assert np.all(five.prediction.high < one.prediction.high)


@pytest.mark.parametrize("unit", [1e-150, 1e-30, 1e-15, 1e15])
def test_quantiles_do_not_depend_on_the_unit_of_the_scores(unit: float) -> None:
    rng = np.random.default_rng(3)
    mean, se, means, sd = rng.normal(60.0, 3.0, 4), np.full(4, 0.7), rng.normal(60.0, 3.0, (9, 4)), np.full((9, 4), 0.5)
    plain, small = (
        _mixture_quantile(0.025, 7.0, *(u * part for part in (mean, se, means, sd)), 0.3) for u in (1.0, unit)
    )
    np.testing.assert_allclose(small / unit, plain, rtol=1e-12)


def test_a_mixture_of_certainties_has_their_values() -> None:
    """What is known without any doubt, at one place of two, has no width."""
    nothing, means = np.zeros(2), np.array([[1.0, 2.0], [1.0, 2.0]])
    found = _mixture_quantile(0.025, 10.0, np.array([1.0, 2.0]), nothing, means, np.zeros((2, 2)), 0.5)
    np.testing.assert_allclose(found, [1.0, 2.0], atol=1e-6)


def test_quantiles_of_one_sample_are_hazens() -> None:
    values = np.random.default_rng(2).normal(size=501)
    found = mixed_quantiles([(values, 1.0)], 0.9)
    assert [found.low, found.high] == pytest.approx(np.quantile(values, [0.05, 0.95], method="hazen"))
    split = mixed_quantiles([(values[:200], 200 / 501), (values[200:], 301 / 501)], 0.9)
    assert [split.low, split.high] == pytest.approx([found.low, found.high])


def test_draws_of_the_optimum_are_those_of_the_process(narrow: Analysis) -> None:
    belief, process = believed(narrow, 1.0), narrow.fitted.departure.process
    assert process is not None
    point = narrow.optimum.point
    points, values, here = belief.optima(point, narrow.data.points, 1000, np.random.default_rng(3))
    assert points.shape == (1000, 2)
    assert np.all(values >= here)
    assert np.all(narrow.region.feasible(points))
    means, variances = process.some(20).marginals(point[None, :])
    sd = np.sqrt(np.mean(variances) + np.var(means))
    assert np.mean(here) == pytest.approx(float(np.mean(means)), abs=5.0 * sd / np.sqrt(1000))
    assert np.median(np.linalg.norm(points - 0.3, axis=1)) < 0.3


def test_analysis_is_made_of_the_belief(narrow: Analysis) -> None:
    best, belief = narrow.optimum, narrow.fitted
    one, five = (belief.bands(best.point[None, :], best.level, 1.0, m) for m in (1, best.replicates))
    assert best.mean == pytest.approx(float(one.mean[0]))
    for got, wanted in (
        (best.confidence, one.confidence),
        (best.prediction, one.prediction),
        (best.prediction_mean, five.prediction),
    ):
        assert [got.low, got.high] == pytest.approx([float(wanted.low[0]), float(wanted.high[0])])
    assert [check.name for check in narrow.decision.checks] == ["interval", "runs"]
    assert narrow.posterior.expected_regret >= 0.0


def test_document_tells_of_the_departure(narrow: Analysis) -> None:
    document = json.loads(json.dumps(analysis_to_json(narrow), default=np.ndarray.tolist))["departure"]
    process = narrow.fitted.departure.process
    assert process is not None
    assert document["probability"] == narrow.fitted.departure.probability
    assert document["log_bayes_factor"] == process.log_bayes_factor
    assert document["reason"] == ""
    assert document["optimum_of_quadratic"] == narrow.region.decode(narrow.of_quadratic.point)[0]
    assert document["lengths"] == {
        name: pytest.approx(np.median(process.hyper.lengths[:, j])) for j, name in enumerate(("x0", "x1"))
    }
    assert 0.2 < document["noise_sd"] < 4.0  # 1 in truth


def test_minimizing_mirrors_maximizing(tmp_path: Path) -> None:
    points = np.round(spread(20, 2), 3)
    y = hill(points) + NOISE[:20]
    up = analysed(tmp_path / "up", TWO, points, y)
    down = analysed(tmp_path / "down", specification(numeric(2), application='goal = "minimize"\n'), points, -y)
    assert up.fitted.departure.probability == down.fitted.departure.probability > 0.0
    np.testing.assert_array_equal(up.optimum.point, down.optimum.point)
    assert up.optimum.mean == pytest.approx(-down.optimum.mean, rel=1e-9)
    assert up.optimum.prediction.low == pytest.approx(-down.optimum.prediction.high, rel=1e-6)
    # 400 draws, those of the quadratic's coefficients not mirrored
    assert up.posterior.expected_regret == pytest.approx(down.posterior.expected_regret, rel=0.2)


@pytest.mark.parametrize("share", [0.0, 0.5, 1.0])
@pytest.mark.parametrize(
    ("errors", "ground"), [("normal", None), ("normal", Ground(4.0, 3.0, 16, 32, 0.6)), ("student_t", None)]
)
def test_intervals_by_draws_agree_with_those_by_quantiles(tmp_path: Path, errors, share, ground) -> None:
    """Draws of normal errors have the quantiles of `bands`; with wild errors the process is the same.

    Where grounds were simulated runs scatter as they do there, of either surface.
    """
    points = np.round(spread(30, 2), 3)
    y = hill(points) + NOISE[:30]
    text = specification(numeric(2), rest=f'[model]\nerrors = "{errors}"\n')
    made = campaign(tmp_path / "c", text, points, y)
    (analysis,) = made.analyse_all(n_draws=400)
    belief, at = replace(believed(analysis, share), ground=ground), np.array([0.3, 0.3])
    if ground is not None:
        wide = belief.bands(at[None, :], 0.95, 1.0, 1).prediction
        assert 0.5 * float(wide.high[0] - wide.low[0]) > 0.95 * 2.0 * 5.0  # of 4 and 3 together
    draws = draw_coefficients(made.spec, analysis.fitted, sampler="exact", n_draws=8000)
    mean, found = intervals_by_draws(belief, at, 0.95, (1, 5), 0.0, draws, np.random.default_rng(5))
    one, five = (belief.bands(at[None, :], 0.95, 1.0, m) for m in (1, 5))
    assert mean == pytest.approx(float(one.mean[0]), rel=1e-12)
    if errors == "student_t" and share < 1.0:
        return
    for got, wanted in zip(found, (one.confidence, one.prediction, five.prediction), strict=True):
        low, high = float(wanted.low[0]), float(wanted.high[0])
        slack = {"normal": 0.06, "student_t": 0.5}[errors] * (high - low)
        assert [got.low, got.high] == pytest.approx([low, high], abs=slack)


def means_of(process: Process, scores: np.ndarray, at: np.ndarray) -> np.ndarray:
    """Means (b, m) of the surface if the runs had these scores (b, n)."""
    return process.centre + (scores - process.centre) @ process.pull(at)


def test_means_of_new_scores_are_linear_in_them_and_those_of_the_runs_are_the_processes(narrow: Analysis) -> None:
    process, y = narrow.fitted.departure.process, narrow.fitted.fit.y
    assert process is not None
    other = y[::-1] + 3.0
    found = means_of(process, np.stack([y, other, 0.25 * y + 0.75 * other]), AT)
    np.testing.assert_allclose(found[0], process.mean(AT), rtol=1e-9)
    np.testing.assert_allclose(found[2], 0.25 * found[0] + 0.75 * found[1], rtol=1e-9)


@pytest.mark.parametrize("n", [40, 240])
def test_the_mean_told_is_less_by_what_choosing_adds(tmp_path: Path, narrow: Analysis, monkeypatch, n: int) -> None:
    """Against the best on a grid under each of other new scores, on a table; a narrow top leaves nothing to choose.

    Of many runs by the fewer places that they count at: arrays of all runs by all runs took 7 GB of 20,000.
    """
    monkeypatch.setattr("seqrsm.fit.process.MOST_SETTINGS", 60)
    asked, pull = [], Process.pull
    monkeypatch.setattr(Process, "pull", lambda self, at: asked.append(len(at)) or pull(self, at))
    points = np.round(spread(n, 2), 3)
    y = 50.0 + 35.0 / (1.0 + np.exp(8.0 * np.sum(points**2, axis=1) - 8.0)) + 2.0 * NOISE[:n]
    analysis = analysed(tmp_path / "c", TWO, points, y)
    assert asked == [min(n, 60) + 651]
    best, departure, made = analysis.optimum, analysis.fitted.departure, analysis.fitted.data.points
    process, share, fit = departure.process, departure.probability, analysis.fit
    assert process is not None
    side = np.linspace(-1.0, 1.0, 61)
    grid = np.stack(np.meshgrid(side, side), axis=-1).reshape(-1, 2)
    at = np.vstack([made, grid])

    def told(scores: np.ndarray) -> np.ndarray:
        quadratic = np.linalg.lstsq(fit.Z, scores.T, rcond=None)[0].T @ analysis.model.matrix(at).T
        return (1.0 - share) * quadratic + share * means_of(process, scores, at)

    noise = process.noise_variance.mean()
    sd = np.sqrt((1.0 - share) * fit.s**2 + share * noise)
    mean = analysis.fitted.mean(at)
    errors = sd * np.random.default_rng(8).standard_normal((800, len(made)))
    scatter = (told(mean[:n] + errors) - told(mean[None, :n]))[:, :n]
    kept = 1.0 - np.mean(np.var(scatter, axis=1)) / np.var(mean[:n])
    true = np.mean(mean[:n]) + kept * (mean - np.mean(mean[:n]))
    new = told(true[:n] + errors)[:, n:]
    above = new.max(axis=1) - true[n:][np.argmax(new, axis=1)]
    error = np.std(above) * np.sqrt(1.0 / 200 + 1.0 / 800)
    assert 0.0 < best.optimism == pytest.approx(np.mean(above), abs=4 * error)
    there = float(analysis.fitted.mean(best.point[None, :])[0])
    assert best.mean == pytest.approx(there - best.optimism)
    plain = analysis.fitted.bands(best.point[None, :], 0.95).confidence
    assert best.confidence.low == pytest.approx(float(plain.low[0]) - best.optimism)
    assert best.confidence.high == pytest.approx(float(plain.high[0]))
    assert narrow.optimum.optimism == pytest.approx(0.0, abs=0.01)


@pytest.mark.parametrize("rest", ["", 'errors = "student_t"\n', 'block = "day"\nblock_effect = "random"\n'])
@pytest.mark.parametrize("goal", ["maximize", "minimize"])
def test_of_a_slope_that_is_not_there_the_better_end_is_told_by_chance(tmp_path: Path, rest: str, goal: str) -> None:
    """The closed form E|b| = sd sqrt(2 / pi) of a slope b about 0: the better end of a level line."""
    points, y = np.tile([[-1.0], [1.0]], (6, 1)), np.repeat([60.0, 62.0, 60.0, 62.0, 60.0, 62.0], 2)
    text = specification(numeric(1), application=f'goal = "{goal}"\n', rest=f"[model]\norder = 1\n{rest}")
    analysis = analysed(tmp_path / "c", text, points, y, block=[f"{i // 4}" for i in range(12)])
    row = np.array([[0.0, 1.0]])
    sd = analysis.fitted.surface.s * float(np.sqrt(analysis.fitted.surface.variance_unscaled(row)[0]))
    found = analysis.optimum.optimism * (1.0 if goal == "maximize" else -1.0)
    assert found == pytest.approx(sd * np.sqrt(2.0 / np.pi), abs=4.0 * sd * np.sqrt((1.0 - 2.0 / np.pi) / 100.0))
    assert analysis.optimum.mean == pytest.approx(61.0 - analysis.optimum.optimism)


@pytest.mark.usefixtures("least_squares_alone")
@pytest.mark.parametrize("goal", ["maximize", "minimize"])
@pytest.mark.parametrize("apart", [0.0, 30.0])
def test_runs_proposed_for_the_optimum_measure_the_chosen_end_anew(tmp_path: Path, goal: str, apart: float) -> None:
    """Against campaigns played out here: six runs at each end of a level line, then eight at the end that looks better.

    With all twenty where they are, the bias would be half as large again. Two random days far apart, which choose no
    end, have no part in it: several times too much was taken off.
    """
    days = 'block = "day"\nblock_effect = "random"\n' if apart else ""
    text = specification(numeric(1), application=f'goal = "{goal}"\n', rest=f"[model]\norder = 1\n{days}")
    (tmp_path / "campaign.toml").write_text(text, encoding="utf-8")
    spec = load_spec(tmp_path)
    x, purposes = np.array([-1.0, 1.0] * 6 + [1.0] * 8), ["start"] * 12 + ["optimum"] * 8
    y = 50.0 + np.repeat([1.0, 1.0, -1.0, -1.0], 5)[np.argsort(np.argsort(x, kind="stable"), kind="stable")]
    y -= np.where(x > 0, np.mean(y[x > 0]), np.mean(y[x < 0])) - 50.0
    day = np.arange(20) // 2 % 2
    y += apart * day
    made = [NewRun({"x0": x[i]}, purposes[i], block=f"{day[i]}") for i in range(20)]
    runs = [scored_run(i + 1, 1 + i // 12, one, NewScore("score", y[i])) for i, one in enumerate(made)]
    found = analyse(spec, spec.applications[0], runs, n_draws=200)
    rng, s = np.random.default_rng(5), found.fit.s
    low, high = (rng.normal(size=(100_000, 6)).mean(axis=1) for _ in range(2))
    fresh, up = rng.normal(size=(100_000, 8)).mean(axis=1), high > low
    again = np.stack([(6.0 * np.where(up, high, low) + 8.0 * fresh) / 14.0, np.where(up, low, high)])
    bias = s * np.mean(again.max(axis=0))
    fixed = np.maximum(rng.normal(size=100_000) / np.sqrt(6.0), rng.normal(size=100_000) / np.sqrt(14.0))
    assert bias < 0.7 * s * np.mean(fixed)
    told = [optimism(found.fitted, found.optimum.point, np.random.default_rng(seed)) for seed in range(40)]
    sign = 1.0 if goal == "maximize" else -1.0
    assert np.mean(told) == pytest.approx(sign * bias, abs=4.0 * s / np.sqrt(14.0 * 200.0 * len(told)))


@pytest.mark.usefixtures("least_squares_alone")
@pytest.mark.parametrize("ratio", [0.0, 1.2, 1.8])
def test_replayed_runs_keep_their_weights_and_follow_the_slope_that_is_left(tmp_path: Path, ratio: float) -> None:
    """Against campaigns played out here by weighted least squares; the last eight runs weigh four times as much."""
    text = specification(numeric(1), rest='[model]\norder = 1\nweights = "se"\n')
    (tmp_path / "campaign.toml").write_text(text, encoding="utf-8")
    spec = load_spec(tmp_path)
    x, purposes = np.array([-1.0, 1.0] * 6 + [1.0] * 8), ["start"] * 12 + ["optimum"] * 8
    se = np.array([2.0] * 12 + [1.0] * 8)
    line = np.stack([np.ones(20), x], axis=1) / se[:, None]
    error = NOISE[:20] - line @ np.linalg.lstsq(line, NOISE[:20], rcond=None)[0]
    error /= np.sqrt(np.sum(error**2) / 18.0)
    slope = ratio * np.sqrt(np.linalg.inv(line.T @ line)[1, 1])  # in units of its standard error
    scores = [NewScore("score", 50.0 + slope * x[i] + se[i] * error[i], float(se[i])) for i in range(20)]
    runs = [scored_run(i + 1, 1 + i // 12, NewRun({"x0": x[i]}, purposes[i]), scores[i]) for i in range(20)]
    found = analyse(spec, spec.applications[0], runs, n_draws=200)
    s, w = found.fit.s, found.fit.weights
    left = slope * (1.0 - 1.0 / ratio**2) if ratio > 1.0 else 0.0

    def fitted(x: np.ndarray, y: np.ndarray, w: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Level and slope of every set."""
        middle, level = np.average(x, axis=1, weights=w), np.average(y, axis=1, weights=w)
        b = np.sum(w * (x - middle[:, None]) * y, axis=1) / np.sum(w * (x - middle[:, None]) ** 2, axis=1)
        return level - b * middle, b

    sets, rng = 40_000, np.random.default_rng(5)
    noise, weights = s * rng.normal(size=(sets, 20)) / np.sqrt(w), np.tile(w, (sets, 1))
    places = np.tile(x, (sets, 1))
    _, first = fitted(places[:, :12], left * places[:, :12] + noise[:, :12], weights[:, :12])
    places[:, 12:] = np.where(first > 0.0, 1.0, -1.0)[:, None]
    level, b = fitted(places, left * places + noise, weights)
    above = level + np.abs(b) - left * np.sign(b)
    told = [optimism(found.fitted, found.optimum.point, np.random.default_rng(seed)) for seed in range(60)]
    error = np.std(above) * np.sqrt(1.0 / sets + 1.0 / (200 * len(told)))
    assert np.mean(told) == pytest.approx(np.mean(above), abs=4.0 * error)


def test_optimism_is_the_quadratics_and_the_processes_by_their_probabilities(tmp_path: Path) -> None:
    points = np.round(spread(40, 2), 3)
    y = 50.0 + 35.0 / (1.0 + np.exp(8.0 * np.sum(points**2, axis=1) - 8.0)) + 2.0 * NOISE[:40]
    analysis = analysed(tmp_path / "c", TWO, points, y)

    def found(share: float) -> float:
        return optimism(believed(analysis, share), analysis.optimum.point, np.random.default_rng(1))

    assert found(0.0) > 0.0
    assert found(1.0) > 0.0
    assert found(0.3) == pytest.approx(0.7 * found(0.0) + 0.3 * found(1.0), rel=1e-12)


def test_the_seed_hardly_moves_what_is_told_of_the_same_scores(tmp_path: Path) -> None:
    """Half-widths at a cliff vary by 7 % (40 seeds), 16 % by twenty draws of what the process rests on."""
    near = np.array([0.3, -0.2, 0.4]) + 0.25 * NOISE[40:100].reshape(20, 3)
    points = np.round(np.vstack([spread(20, 3), np.clip(near, -1.0, 1.0)]), 3)
    y = 80.0 - 6.0 * (points[:, 0] - 0.3) ** 2 - np.where(points[:, 2] > 0.4, 60.0 * (points[:, 2] - 0.4), 0.0)
    y += 2.0 * points[:, 2] - 4.0 * (points[:, 1] + 0.2) ** 2 + 2.0 * NOISE[:40]
    told = [
        analysed(tmp_path / f"{seed}", specification(numeric(3), seed=seed), points, y).optimum for seed in range(1, 13)
    ]
    widths = np.array([one.confidence.half_width for one in told])
    assert np.std(widths) < 0.1 * np.mean(widths)
    assert np.std([one.mean for one in told]) < 0.12 * np.mean(widths)


def test_nothing_is_taken_off_without_an_estimate_of_error(tmp_path: Path) -> None:
    points = np.array([[-1.0], [0.0], [1.0]])
    analysis = analysed(tmp_path / "c", specification(numeric(1)), points, [60.0, 70.0, 65.0])
    assert analysis.optimum.optimism == 0.0


def test_what_is_told_of_a_flat_surface_is_true(tmp_path: Path) -> None:
    """120 campaigns of 16 runs: a mean too high by 0.8 sigma, intervals that cover 80 %, were the choice forgotten."""
    points, rng = np.round(spread(16, 2), 3), np.random.default_rng(4)
    bias, covers = [], []
    made = campaign(tmp_path / "c", TWO, points, rng.standard_normal(16))
    (first, *rest), (application,) = made.store.runs(), made.spec.applications
    for _ in range(120):
        runs = [
            replace(run, scores=(replace(run.scores[0], score=60.0 + float(rng.standard_normal())),))
            for run in (first, *rest)
        ]
        best = analyse(made.spec, application, runs, n_draws=400).optimum
        bias.append((best.mean - 60.0, best.mean + best.optimism - 60.0))
        covers.append(best.confidence.low <= 60.0 <= best.confidence.high)
    told, without = np.mean(bias, axis=0)
    assert told < 0.45 < without - 0.2
    assert np.mean(covers) > 0.95 - 3.0 * np.sqrt(0.95 * 0.05 / 120)


@pytest.mark.parametrize(
    "rest",
    [
        'errors = "student_t"',
        'block = "day"',
        'block = "day"\nblock_effect = "random"',
        'block = "day"\nblock_effect = "random"\nerrors = "student_t"',
    ],
    ids=["t", "fixed", "random", "random t"],
)
def test_a_narrow_top_is_found_whatever_the_model(tmp_path: Path, rest: str) -> None:
    points = np.round(spread(40, 2), 3)
    text = specification(numeric(2), rest=f"[model]\n{rest}\n")
    analysis = analysed(tmp_path / "c", text, points, hill(points) + NOISE[:40], block=["a", "b"] * 20)
    assert analysis.fitted.departure.probability > 0.95
    best = analysis.optimum
    assert best.confidence.low < best.mean < best.confidence.high
    assert best.mean == pytest.approx(80.0, abs=6.0)
    np.testing.assert_allclose(best.point, 0.3, atol=0.2)


# where no process is weighed ------------------------------------------------------------------------------------------


def refused(analysis: Analysis, reason: str) -> None:
    departure = analysis.fitted.departure
    assert departure.process is None
    assert departure.probability == 0.0
    assert np.isnan(departure.log_bayes_factor)
    assert reason in departure.reason
    assert analysis.optimum.point == pytest.approx(analysis.of_quadratic.point)
    document = analysis_to_json(analysis)["departure"]
    assert document["reason"] == departure.reason
    assert "lengths" not in document


@pytest.mark.parametrize(
    ("n", "more", "reason"),
    [
        (4, {}, "from 5 runs on, and there are 4"),
        (20, {"scores": np.full(20, 70.0)}, "it passes through every score"),
        (6, {"scores": np.full(6, 70.0)}, "it passes through every score"),
        (20, {"scores": np.full(20, 70.0), "rest": "[model]\norder = 1\n"}, "it passes through every score"),
    ],
    ids=["few", "equal", "equal, as many as terms", "equal, first order"],
)
def test_where_no_process_is_weighed_the_reason_is_told(tmp_path: Path, n: int, more: dict, reason: str) -> None:
    k = 1 if n < 6 else 2
    points = np.round(spread(n, k), 3)
    text = specification(numeric(k), rest=more.pop("rest", ""))
    scores = more.pop("scores", bowl(points) + NOISE[:n])
    analysis = analysed(tmp_path / "c", text, points, scores, **more)
    assert analysis.fitted.departure.reason
    refused(analysis, reason)
    assert {"pure_error", "lack_of_fit"} <= {check.name for check in analysis.decision.checks}


def test_too_many_levels_and_blocks_for_a_process_are_told(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("seqrsm.analysis.belief.MOST_SETTINGS", 8)
    points = np.round(spread(40, 2), 3)
    days = [f"d{i % 9}" for i in range(40)]
    text = specification(numeric(2), rest='[model]\nblock = "block"\n')
    refused(
        analysed(tmp_path / "c", text, points, bowl(points) + np.resize(NOISE, 40), block=days),
        "up to 8 combinations of levels and blocks, and there are 9",
    )


def test_flights_beside_simulations_are_told_by_a_process_that_knows_both(tmp_path: Path) -> None:
    """Flights score ten less on a narrow top, where few are flown: the surface told is theirs."""
    points = np.round(spread(40, 2), 3)
    flights = np.arange(40) % 4 == 0
    scores = hill(points) - 10.0 * flights + np.resize(NOISE, 40)
    source = ["flight" if one else "simulation" for one in flights]
    analysis = analysed(tmp_path / "c", specification(numeric(2)), points, scores, source=source)
    process = analysis.fitted.departure.process
    assert process is not None
    assert analysis.fitted.departure.probability > 0.9  # no quadratic
    at = spread(200, 2, seed=8)
    truth = hill(at) - 10.0
    bands = analysis.fitted.bands(at, 0.95)
    inside = (bands.confidence.low <= truth) & (truth <= bands.confidence.high)
    assert np.mean(inside) > 0.9
    of_quadratic = analysis.fitted.surface.predict(analysis.fitted.surface.rows(at))
    assert np.sqrt(np.mean((bands.mean - truth) ** 2)) < 0.7 * np.sqrt(np.mean((of_quadratic.mean - truth) ** 2))
    document = analysis_to_json(analysis)["departure"]
    assert not document["reason"]
    (told,) = _departure(analysis)
    assert isinstance(told, Paragraph)
    assert "a noise variance for each source" in told.method


def test_a_process_has_the_days_and_the_weight_of_flights_as_the_quadratic_has_them(tmp_path: Path) -> None:
    """Beside flights by days: the columns of blocks are no part of the surface, a flight counts by its own variance."""
    points = np.round(spread(40, 2), 3)
    flights = np.arange(40) % 2 == 0
    days = ["a" if i % 4 == 0 else "b" if one else "" for i, one in enumerate(flights)]
    scores = bowl(points) + np.where(flights, 0.3, 3.0) * NOISE[:40] + 6.0 * np.array([day == "b" for day in days])
    text = specification(numeric(2), rest='[model]\nblock = "day"\n')
    source = ["flight" if one else "simulation" for one in flights]
    surface = analysed(tmp_path / "c", text, points, scores, source=source, block=days).fitted.surface
    assert isinstance(surface, TwoSources)
    sources, blocks = surface.for_process()
    assert sources is not None
    assert blocks is not None
    assert not blocks.new
    of_days = {"": 0.0, "a": [0.5, -0.5], "b": [-0.5, 0.5]}  # about the mean of the two, and none in simulations
    wanted = np.array([np.zeros(2) + of_days[day] for day in days])
    np.testing.assert_allclose(blocks.columns @ blocks.columns.T, wanted @ wanted.T, atol=1e-12)
    np.testing.assert_array_equal(sources.own, flights)
    assert sources.weight == pytest.approx((surface.both.s_simulation / surface.both.s) ** 2)
    assert sources.weight > 10.0


@pytest.mark.parametrize(
    ("source", "waiting", "by_process"),
    [("flight", "flight", True), ("flight", "simulation", False), ("simulation", "simulation", False)],
)
def test_next_flights_beside_simulations_come_from_the_process(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, source: str, waiting: str, by_process: bool
) -> None:
    """It knows the surface of flights alone, and counts waiting runs as flights."""
    monkeypatch.setattr(belief_module, "PRIOR_LOG_ODDS", 50.0)
    points = np.round(spread(30, 2), 3)
    sources = ["flight" if i % 3 == 0 else "simulation" for i in range(30)]
    made = campaign(tmp_path / "c", specification(numeric(2)), points, bowl(points) + NOISE[:30], source=sources)
    made.store.add_batch([NewRun({"x0": 0.25, "x1": 0.25}, "optimum", "", waiting, 1.0)])
    analyses = made.analyse_all(n_draws=400)
    asked = []
    real = next_runs.propose_from_process
    monkeypatch.setattr(next_runs, "propose_from_process", lambda *a, **more: asked.append(a) or real(*a, **more))
    active = [run for run in made.store.runs() if run.state != "void"]
    found = next_runs.next_batch(made.spec, analyses, active, 2, source)
    assert [run.source for run in found] == [source, source]
    assert bool(asked) is by_process


@pytest.mark.parametrize(("odds", "asks"), [(-50.0, False), (-2.0, False), (-1.0, True), (50.0, True)])
def test_an_improbable_process_proposes_no_runs(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, odds: float, asks: bool
) -> None:
    points = np.round(spread(30, 2) * [0.5, 1.0] - [0.5, 0.0], 3)  # none where x0 > 0
    made = campaign(tmp_path / "c", specification(numeric(2)), points, bowl(points) + NOISE[:30])
    (plain,) = made.analyse_all(n_draws=400)
    monkeypatch.setattr(belief_module, "PRIOR_LOG_ODDS", odds - plain.fitted.departure.log_bayes_factor)
    analyses = made.analyse_all(n_draws=400)
    asked = []
    real = next_runs.propose_from_process
    monkeypatch.setattr(next_runs, "propose_from_process", lambda *a, **more: asked.append(a) or real(*a, **more))
    found = next_runs.next_batch(made.spec, analyses, made.store.runs(), 8, "simulation")
    assert len(found) == 8
    purposes = [run.purpose for run in found]
    # Where the process is not certain, runs go where none was near; the quadratic alone needs none there.
    assert ("spread" in purposes) is (odds == -1.0)
    assert set(purposes) <= {"optimum", "regret", "spread"}
    assert bool(asked) is asks


# extremes -------------------------------------------------------------------------------------------------------------


def whole(made, n: int = 3) -> Analysis:
    """Analysed and proposed from; nothing that is not finite."""
    (analysis,) = made.analyse_all(n_draws=400)
    best = analysis.optimum
    found = [best.mean]
    for interval in (best.prediction, best.prediction_mean, best.confidence):
        found += [interval.low, interval.high]
    assert np.all(np.isfinite(found))
    assert best.prediction.low <= best.prediction_mean.low <= best.confidence.low <= best.confidence.high
    assert analysis.fitted.departure.process is not None
    assert "lack_of_fit" not in {check.name for check in analysis.decision.checks}
    batch = made.decide(n, analyses=[analysis])
    assert len(batch) == n
    assert np.all(made.spec.region.feasible(made.spec.region.code([run.proposed for run in batch])))
    assert all(run.purpose in ("optimum", "regret", "spread") for run in batch)
    return analysis


def case(name: str) -> tuple[str, np.ndarray, np.ndarray, dict]:
    """Text, points, scores, and what else there is of the runs."""
    k = {"eight factors": 8, "one degree of freedom": 3}.get(name, 2)
    n = {"eight factors": 60, "one degree of freedom": 11, "as many scores as terms": 6}.get(name, 24)
    points, text, more = np.round(spread(n, k), 3), specification(numeric(k)), {}
    y = bowl(points) + NOISE[:n]
    if name == "repeats alone":
        points = np.repeat(points[:8], 3, axis=0)
        y = bowl(points) + NOISE[:n]
    elif name == "nothing and everything":
        y = np.where(points[:, 0] > 0.0, 100.0, 0.0)
    elif name == "logits of nothing and everything":
        text, y = specification(numeric(2), rest='[model]\nresponse = "logit"\n'), np.clip(y + 20.0, 0.0, 100.0)
    elif name == "weights":
        more["se"] = np.exp(np.linspace(np.log(1e-3), np.log(1.0), n))
    elif name == "large":
        y = 1e9 * y
    elif name == "small":
        y = 1e-9 * y
    elif name == "far from zero":
        y = 1e6 + y
    elif name == "no noise":
        y = bowl(points)
    elif name == "one wild score":
        y[3] += 1e5
    elif name == "blocks":
        text, more["block"] = specification(numeric(2), rest='[model]\nblock = "day"\n'), ["a", "b", "c"] * 8
    elif name == "wild errors":
        text = specification(numeric(2), rest='[model]\nerrors = "student_t"\n')
    return text, points, y, more


@pytest.mark.parametrize(
    "name",
    [
        "as many scores as terms",
        "one degree of freedom",
        "eight factors",
        "repeats alone",
        "nothing and everything",
        "logits of nothing and everything",
        "weights",
        "large",
        "small",
        "far from zero",
        "one wild score",
        "wild errors",
    ],
)
def test_extremes(tmp_path: Path, name: str) -> None:
    text, points, y, more = case(name)
    whole(campaign(tmp_path / "c", text, points, y, **more))


def test_scores_without_noise(tmp_path: Path) -> None:
    """Whether anything is left is a matter of rounding; either way there is an answer."""
    text, points, y, more = case("no noise")
    made = campaign(tmp_path / "c", text, points, y, **more)
    (analysis,) = made.analyse_all(n_draws=400)
    assert analysis.optimum.mean == pytest.approx(80.0, abs=0.1)
    np.testing.assert_allclose(analysis.optimum.point, 0.2, atol=0.05)
    assert len(made.decide(3, analyses=[analysis])) == 3


def test_constant_blocks_are_no_part_of_the_surface(tmp_path: Path) -> None:
    text, points, y, more = case("blocks")
    day = np.array([{"a": 0.0, "b": 30.0, "c": -30.0}[one] for one in more["block"]])
    (analysis,) = campaign(tmp_path / "c", text, points, y + day, **more).analyse_all(n_draws=400)
    process = analysis.fitted.departure.process
    assert process is not None
    at = spread(6, 2, seed=3)
    np.testing.assert_allclose(process.mean(at), bowl(at), atol=4.0)


@pytest.mark.slow
def test_a_further_run_takes_no_surface_away(tmp_path: Path) -> None:
    """Up to 250 settings each is one to the process, of more near ones count as repeats: the answer is the same."""
    n = MOST_SETTINGS + 50
    points = np.random.default_rng(4).uniform(-1.0, 1.0, (n, 1)).round(4)
    scores = hill(points) + np.random.default_rng(5).normal(size=n)
    found = {}
    for m in (MOST_SETTINGS, n):
        made = campaign(tmp_path / str(m), specification(numeric(1)), points[:m], scores[:m])
        found[m] = whole(made, 1)
        assert found[m].fitted.departure.probability > 0.99
        assert found[m].optimum.confidence.low < 80.0 < found[m].optimum.confidence.high
        assert found[m].optimum.point == pytest.approx([0.3], abs=0.1)
    ratio = found[n].optimum.confidence.half_width / found[MOST_SETTINGS].optimum.confidence.half_width
    assert 0.7 < ratio < 1.1


@pytest.mark.parametrize("times", [0.0, 0.9, 1.5, 3.0, 10.0])
def test_optimism_is_that_of_searching_a_surface_shrunk_by_its_own_error(tmp_path: Path, times: float) -> None:
    """By a Monte Carlo of its own over a grid: a slope whose variance over the runs is ``times`` that of the error."""
    points = np.round(spread(24, 2), 3)
    model = QuadraticModel((ContinuousFactor("x0", -1.0, 1.0), ContinuousFactor("x1", -1.0, 1.0)), 2)
    columns = model.matrix(points)
    basis, _ = np.linalg.qr(columns)
    noise = NOISE[:24] - basis @ (basis.T @ NOISE[:24])
    noise *= np.sqrt((24 - 6) / np.sum(noise**2))  # s is 1, the mean variance of the fitted means p / n
    slope = np.sqrt(times * 6 / 24) / np.std(points[:, 0])
    one = analysed(tmp_path / "c", TWO, points, 50.0 + slope * points[:, 0] + noise)
    belief = believed(one, 0.0)
    grid = np.stack(np.meshgrid(*2 * [np.linspace(-1.0, 1.0, 61)]), axis=-1).reshape(-1, 2)
    root = np.linalg.cholesky(np.linalg.inv(columns.T @ columns))
    errors = np.random.default_rng(3).normal(size=(4000, 6)) @ (model.matrix(grid) @ root).T
    true = max(1.0 - 1.0 / times, 0.0) * slope * grid[:, 0] if times else np.zeros(len(grid))
    expected = np.mean(errors[np.arange(4000), np.argmax(true + errors, axis=1)])
    sets = [optimism(belief, one.optimum.point, np.random.default_rng(seed)) for seed in range(20)]
    assert np.mean(sets) == pytest.approx(expected, rel=0.12)  # a few hundred places, not a fine grid


def test_each_future_run_has_its_own_weight(tmp_path) -> None:
    """Of logits those near 100 percent scatter more: profiles showed all points with the mean of their weights."""
    rng = np.random.default_rng(2)
    points = np.column_stack([np.tile(np.linspace(-1.0, 1.0, 5), 6)])
    scores = 80.0 - 30.0 * points[:, 0] ** 2 + 2.0 * rng.normal(size=6)[np.arange(30) // 5] + rng.normal(size=30)
    model = '[model]\nresponse = "logit"\nblock = "block"\nblock_effect = "random"\n'
    text = specification(numeric(1), rest=model).replace('"measured"', '"percent_correct"')
    found = analysed(tmp_path / "c", text, points, scores, block=[f"d{i // 5}" for i in range(30)])
    at = np.array([[-1.0], [0.0], [0.9]])
    weight = found.scale.weight_at(found.fitted.mean(at))
    assert np.ptp(weight) > 0.3
    together = found.fitted.bands(at, 0.95, weight)
    for i in range(3):
        alone = found.fitted.bands(at[i : i + 1], 0.95, weight[i : i + 1])
        for both, one in ((together.prediction, alone.prediction), (together.confidence, alone.confidence)):
            assert (both.low[i], both.high[i]) == pytest.approx((one.low[0], one.high[0]), rel=1e-9)


def test_the_scatter_of_a_run_is_a_standard_deviation_whatever_the_errors(tmp_path, monkeypatch) -> None:
    """Of Student-t errors with 4 degrees of freedom the scale was told, which is 0.71 of it."""
    alone = Departure(None, float("nan"), 0.0, "the quadratic is true")
    monkeypatch.setattr("seqrsm.analysis.fitted.weigh_departure", lambda *given: alone)
    rng = np.random.default_rng(5)
    points = rng.uniform(-1.0, 1.0, (300, 1))
    scores = 50.0 - 4.0 * points[:, 0] ** 2 + rng.standard_t(4, 300)
    found = analysed(tmp_path / "c", specification(numeric(1), rest='[model]\nerrors = "student_t"\n'), points, scores)
    assert found.sd_of_run == pytest.approx(np.sqrt(2.0), rel=0.1)
    s, h = found.fitted.scatter(found.optimum.point)
    assert s == pytest.approx(found.sd_of_run)
    row = found.model.matrix(found.optimum.point[None, :])
    assert s**2 * h == pytest.approx(float(found.fit.predict(row).se_mean[0]) ** 2, rel=1e-9)
