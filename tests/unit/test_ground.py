"""Two parts of the scatter of simulated scores: what a bundle says of them, and what they do to the stop rule."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from seqrsm.analysis.conclude import analyse
from seqrsm.analysis.fitted import fit_surface
from seqrsm.analysis.ground import Ground, future_sd, ground_of_scores, left_of_ground, prior_of_difference
from seqrsm.analysis.runs import ResponseScale, ScoredRuns, response_scale, scored_runs
from seqrsm.analysis.surfaces import TwoSources, expected_of_flights, surface_of
from seqrsm.arrays import BoolArray, FloatArray
from seqrsm.campaign.next_runs import _Chooser
from seqrsm.campaign.rehearsal import make_campaign, scored_run
from seqrsm.decide.sources import discrepancy_sd, fit_sources, guessed_sd
from seqrsm.decide.stopping import StopRule, flights_needed, target_problem
from seqrsm.design.quadratic import QuadraticModel
from seqrsm.spec.read import CampaignSpec, load_spec
from seqrsm.store.records import NewRun, NewScore

CAMPAIGN = """\
[campaign]
name = "one"
seed = 3
[[factor]]
name = "x"
low = -1.0
high = 1.0
[[application]]
name = "a"
utility = "measured"
goal = "maximize"
[model]
order = 1
[stop]
interval = "prediction_mean"
half_width = 30.0
max_runs = 24
"""


def bundle(rng: np.random.Generator, ground: float, chance: float, worlds: int = 16) -> np.ndarray:
    return 60.0 + ground * rng.standard_normal((worlds, 1)) + chance * rng.standard_normal((worlds, 2))


def test_a_bundle_tells_ground_from_chance() -> None:
    rng = np.random.default_rng(1)
    found = [ground_of_scores(bundle(rng, 5.0, 3.0)) for _ in range(2000)]
    assert np.mean([one.sd_chance**2 for one in found]) == pytest.approx(9.0, rel=0.04)
    assert np.mean([one.sd_ground**2 for one in found]) == pytest.approx(25.0, rel=0.04)
    assert np.mean([one.share for one in found]) == pytest.approx(25.0 / 34.0, abs=0.04)
    scores = bundle(rng, 1e-9, 3.0)
    assert 0.0 < ground_of_scores(scores).share < 0.35  # 16 worlds cannot say that there is nothing
    assert ground_of_scores(np.repeat(scores[:, :1], 2, axis=1)).share == 0.98
    assert ground_of_scores(np.ones((16, 2))).share == 0.0


def test_three_occasions_in_each_world_by_hand() -> None:
    """Means 2, 6 and 5 have the variance 13/3; of that in worlds, (1 + 1 + 7) / 3 = 3, a third is chance's part."""
    found = ground_of_scores([[1.0, 2.0, 3.0], [5.0, 6.0, 7.0], [3.0, 4.0, 8.0]])
    assert (found.sd_chance**2, found.sd_ground**2) == pytest.approx((3.0, 13.0 / 3.0 - 3.0 / 3.0))
    assert found.variance == pytest.approx(19.0 / 3.0)


def test_worlds_and_occasions_at_several_settings_tell_ground_from_chance() -> None:
    """What differs between settings is none of both."""
    draw = np.random.default_rng(2).standard_normal
    found = [
        ground_of_scores(60.0 + 20.0 * draw((16, 1, 1)) + 5.0 * draw((16, 2, 1)) + 3.0 * draw((16, 2, 2)))
        for _ in range(2000)
    ]
    assert np.mean([one.sd_chance**2 for one in found]) == pytest.approx(9.0, rel=0.03)
    assert np.mean([one.sd_ground**2 + one.sd_chance**2 for one in found]) == pytest.approx(34.0, rel=0.03)
    assert np.mean([one.share for one in found]) == pytest.approx(25.0 / 34.0, abs=0.04)
    # Sixteen settings with two worlds each leave 16 degrees of freedom between worlds, and 32 within.
    one, n = ground_of_scores(1.5 * draw((16, 2, 1)) + 3.0 * draw((16, 2, 2))), 400_000
    of_chance = one.sd_chance**2 * 32.0 / np.random.default_rng(3).chisquare(34, n)
    possible = 1.0 - of_chance / (one.variance * 16.0 / np.random.default_rng(4).chisquare(16, n))
    assert one.share == pytest.approx(np.mean(np.maximum(possible, 0.0)), abs=0.004)


def test_what_a_ground_does_to_a_mean_of_occasions_is_told_without_bias() -> None:
    rng = np.random.default_rng(2)
    for runs, wanted in ((1.0, 25.0), (5.0, 17.8), (np.inf, 16.0)):
        found = [future_sd(bundle(rng, 4.0, 3.0, 8), runs) ** 2 for _ in range(2000)]
        # A variance is never told below zero, which lifts its mean a little.
        assert np.mean(found) == pytest.approx(wanted, abs=4.0 * np.std(found) / np.sqrt(2000) + 0.3)


@pytest.mark.parametrize(
    ("interval", "share", "counts", "variance"),
    [
        ("prediction", 0.75, True, 1.0),
        ("prediction", 0.75, False, 0.25),
        ("prediction_mean", 0.75, True, 0.8),
        ("prediction_mean", 0.75, False, 0.05),
        ("prediction_mean", 0.0, True, 0.2),
        ("confidence", 0.75, True, 0.75),
        ("confidence", 0.75, False, 0.0),
    ],
)
def test_what_scatter_an_interval_counts(interval: str, share: float, counts: bool, variance: float) -> None:
    rule = StopRule(interval=interval, ground_share=share, counts_ground=counts)
    assert 1.0 / rule.replicates_of() == pytest.approx(variance)
    wide = rule.width(2.0, 1e9, 0.1)
    assert wide == pytest.approx(1.959964 * 2.0 * np.sqrt(variance + 0.1), rel=1e-6)


def test_what_flights_can_do_where_simulation_cannot() -> None:
    rule = StopRule(interval="prediction_mean", half_width=5.0, max_runs=80, ground_share=0.75)
    assert "below the noise floor" in target_problem(rule, 6.0, 6)
    assert target_problem(StopRule(interval="prediction_mean", half_width=5.0, max_runs=80), 6.0, 6) != ""
    n = flights_needed(rule, 6.0)
    widths = [3.0 * t * np.sqrt(1.0 / m + 0.2) for m, t in ((n, 2.5706), (n - 1, 2.7764))]  # t of 5 and of 4
    assert n == 6
    assert widths[0] <= 5.0 < widths[1]
    assert flights_needed(StopRule(half_width=1.0), 6.0) is None


def test_what_is_left_of_the_ground_and_its_error() -> None:
    """Without what one part of 0.8 has with another, 0.2 are left; of their product nothing, though each has none."""
    rng = np.random.default_rng(4)

    def found(worlds: int) -> tuple[float, float]:
        one, again, other, chance = np.sqrt([[0.8], [0.8], [0.2], [0.5]]) * rng.standard_normal((4, worlds))
        return left_of_ground(one + other + chance, again + other + chance, 1.0)

    sets = np.array([found(480) for _ in range(400)])
    assert sets[:, 0].mean() == pytest.approx(0.2, abs=0.01)
    assert np.sqrt(np.mean(np.square(sets[:, 1]))) == pytest.approx(sets[:, 0].std(), rel=0.15)
    one, again, other = rng.standard_normal((3, 200_000))
    assert left_of_ground(one * other, again * other, 1.0)[0] == pytest.approx(0.0, abs=0.02)
    left, se = left_of_ground(2.0 * np.arange(3.0), np.arange(3.0), 4.0)  # 0, 1/8, 1/2 of it
    assert left == pytest.approx(1.0 - 5.0 / 24.0)
    assert se == pytest.approx(np.std([0.0, 0.125, 0.5], ddof=1) / np.sqrt(3.0))


def test_flights_differ_from_simulations_as_worlds_do(tmp_path: Path) -> None:
    (tmp_path / "campaign.toml").write_text(CAMPAIGN.replace("order = 1", "order = 2"), encoding="utf-8")
    spec, rng = load_spec(tmp_path), np.random.default_rng(9)
    model, points = QuadraticModel(spec.factors, 2), np.linspace(-1.0, 1.0, 21)[:, None]
    ground = Ground(5.0, 3.0, 16, 32, 0.7)
    sd = discrepancy_sd(model, prior_of_difference(ground, model, points))
    difference = model.matrix(points) @ (sd[:, None] * rng.standard_normal((model.p, 20000)))
    assert np.sqrt(np.mean(np.square(difference))) == pytest.approx(5.0, rel=0.02)


def of_both(
    spec: CampaignSpec, points: FloatArray, flights: BoolArray, scores: FloatArray, ground: Ground
) -> tuple[QuadraticModel, ScoredRuns, ResponseScale, TwoSources]:
    """Model, runs and scale of flights beside simulations, and the surface of the flights."""
    runs = [
        scored_run(i + 1, 1, NewRun(settings, "", "", "flight" if flight else "simulation"), NewScore("a", score))
        for i, (settings, flight, score) in enumerate(
            zip(spec.region.decode(points), flights, scores.tolist(), strict=True)
        )
    ]
    data = scored_runs(spec.region, runs, "a")
    model, scale = QuadraticModel(spec.factors), response_scale(spec, data)
    found = surface_of(spec, data, scale, fit_surface(spec, data, scale), ground)
    assert isinstance(found, TwoSources)
    return model, data, scale, found


def test_flights_over_one_ground_are_guessed_to_scatter_by_chance_alone(tmp_path: Path) -> None:
    """Six flights over one ground, 40 simulations over grounds of their own: the scatter of flights is not theirs."""
    (tmp_path / "campaign.toml").write_text(CAMPAIGN.replace("order = 1", "order = 2"), encoding="utf-8")
    spec, sd_ground, sd_chance, told = load_spec(tmp_path), 4.0, 2.0, []
    for seed in range(40):
        rng = np.random.default_rng(seed)
        ground = ground_of_scores(bundle(rng, sd_ground, sd_chance))
        points = rng.uniform(-1.0, 1.0, (46, 1))
        flights = np.arange(46) >= 40
        of_ground = np.where(flights, sd_ground * rng.standard_normal(), sd_ground * rng.standard_normal(46))
        scores = 60.0 - 5.0 * points[:, 0] ** 2 + of_ground + sd_chance * rng.standard_normal(46)
        _, data, scale, found = of_both(spec, points, flights, scores, ground)
        of_process, _ = found.for_process()
        assert of_process is not None
        assert of_process.ratio == 1.0 / (1.0 - ground.share)
        told.append((found.both.s, found.both.s_simulation, found.both.prior_sd))
    flight, simulation, prior_sd = np.median(told, axis=0)
    assert flight == pytest.approx(sd_chance, rel=0.15)
    assert simulation == pytest.approx(np.hypot(sd_ground, sd_chance), rel=0.1)
    assert prior_sd == pytest.approx(sd_ground, rel=0.2)
    assert expected_of_flights(
        replace(spec, model=spec.model.model_copy(update={"discrepancy_sd": 1.5})), data, scale, ground
    ) == (1.5, pytest.approx(1.0 / (1.0 - ground.share)))  # fmt: skip


@pytest.mark.parametrize("off", [0.0, -19.0])
def test_flights_beyond_what_the_tables_allow_are_not_taken_for_noise(tmp_path: Path, off: float) -> None:
    """Near the ceiling of a score grounds differ by 0.4; four flights that agree on 19 less are no scatter of 19."""
    (tmp_path / "campaign.toml").write_text(CAMPAIGN.replace("order = 1", "order = 2"), encoding="utf-8")
    spec, held, told = load_spec(tmp_path), [], []
    for seed in range(12):
        rng = np.random.default_rng(seed)
        ground = Ground(0.4, 0.6, 16, 32, 0.3)
        points = rng.uniform(-1.0, 1.0, (44, 1))
        flights = np.arange(44) >= 40
        scores = 95.0 - 40.0 * points[:, 0] ** 2 + rng.standard_normal(44) + off * flights
        model, data, _, found = of_both(spec, points, flights, scores, ground)
        row = model.matrix(np.mean(points[flights], axis=0)[None, :])
        _, low, high = found.both.discrepancy(row[0])
        held.append(low <= off <= high)
        told.append("by far more than the uncertainty of the tables" in found.note or "times the prior" in found.note)
        assert found.both.s < 4.0
        as_tables = found.both.prior_sd == prior_of_difference(ground, model, data.points)
        assert as_tables == (off == 0.0)
    assert sum(held) >= 10
    assert all(told) == any(told) == (off < 0.0)


def test_before_the_first_flight_flights_are_expected_to_be_as_the_grounds_that_were_measured(tmp_path: Path) -> None:
    (tmp_path / "campaign.toml").write_text(CAMPAIGN, encoding="utf-8")
    spec, rng = load_spec(tmp_path), np.random.default_rng(5)

    def score(points: np.ndarray) -> list[NewScore]:
        return [NewScore("a", float(y)) for y in 60.0 + 4.0 * points[:, 0] + 5.0 * rng.standard_normal(len(points))]

    ground = ground_of_scores(bundle(rng, 4.0, 3.0, worlds=4000))
    analysis, _ = make_campaign(spec, "simulation", score, n_draws=50, ground=ground)
    assert analysis.sources is None
    sd, weight, sigma = _Chooser(spec, analysis).difference()
    assert sd == pytest.approx(4.0, rel=0.1)
    assert weight == pytest.approx((4.0**2 + 3.0**2) / 3.0**2, rel=0.1)
    assert sigma == analysis.fit.s


def test_what_the_quadratic_misses_is_no_ground(tmp_path: Path) -> None:
    """Over a step, table uncertainty was told as 7, beside a true one of 2."""
    (tmp_path / "campaign.toml").write_text(CAMPAIGN.replace("order = 1", "order = 2"), encoding="utf-8")
    spec, rng = load_spec(tmp_path), np.random.default_rng(3)

    def score(points: np.ndarray) -> list[NewScore]:
        scatter = np.hypot(2.0, 1.0) * rng.standard_normal(len(points))
        return [NewScore("a", float(y)) for y in 60.0 + 20.0 * np.tanh(20.0 * (points[:, 0] - 0.3)) + scatter]

    spec = replace(spec, stop=spec.stop.model_copy(update={"half_width": 1e-9}))
    found, _ = make_campaign(spec, "simulation", score, n_draws=50, ground=ground_of_scores(bundle(rng, 2.0, 1.0)))
    assert found.fitted.departure.probability > 0.99
    assert found.fit.s > 5.0
    assert found.fitted.ground is not None
    assert found.fitted.ground.sd_ground == pytest.approx(2.0, abs=1.0)


def test_the_target_is_for_the_whole_interval_or_for_its_part_by_chance(tmp_path: Path) -> None:
    (tmp_path / "campaign.toml").write_text(CAMPAIGN, encoding="utf-8")
    spec, rng, ground = load_spec(tmp_path), np.random.default_rng(7), Ground(4.0, 3.0, 16, 32, 0.64)

    def score(points: np.ndarray) -> list[NewScore]:
        return [NewScore("a", float(y)) for y in 60.0 + 4.0 * points[:, 0] + 5.0 * rng.standard_normal(len(points))]

    counted, runs = make_campaign(spec, "simulation", score, n_draws=50, ground=ground)
    stop = spec.stop.model_copy(update={"worlds": "ignore"})
    ignored = analyse(replace(spec, stop=stop), spec.applications[0], runs, ground=ground, n_draws=50)
    best = counted.optimum
    assert counted.decision.half_width == pytest.approx(best.whole.half_width)
    assert ignored.decision.half_width == pytest.approx(best.by_chance.half_width)
    assert best.whole.half_width > 1.3 * best.by_chance.half_width


def test_the_interval_of_several_flights_over_one_ground_covers(tmp_path: Path) -> None:
    """150 campaigns, each run on a ground of its own; then five flights over one ground.

    Without the ground 66 % are covered, of which 50 campaigns tell enough.
    """
    (tmp_path / "campaign.toml").write_text(CAMPAIGN, encoding="utf-8")
    spec, rng = load_spec(tmp_path), np.random.default_rng(7)
    never = spec.stop.model_copy(update={"half_width": 1e-9})  # the whole budget is spent, in two batches
    spec = replace(spec, stop=never, batch=24)
    ground, chance, inside, plain, widths = 5.0, 3.0, [], [], []
    for i in range(150):
        known = ground_of_scores(bundle(rng, ground, chance))

        def score(points: np.ndarray) -> list[NewScore]:
            scatter = np.hypot(ground, chance) * rng.standard_normal(len(points))
            return [NewScore("a", float(y)) for y in 60.0 + 4.0 * points[:, 0] + scatter]

        analysis, runs = make_campaign(spec, "simulation", score, n_draws=50, ground=known)
        best = analysis.optimum
        assert best.ground == known
        flights = 60.0 + 4.0 * best.point[0] + ground * rng.standard_normal() + chance * rng.standard_normal(5)
        inside.append(best.prediction_mean.low <= flights.mean() <= best.prediction_mean.high)
        if i < 50:
            without = analyse(spec, spec.applications[0], runs, n_draws=50).optimum.prediction_mean
            plain.append(without.low <= flights.mean() <= without.high)
        widths.append(best.whole.half_width)
        assert analysis.sd_of_run**2 == pytest.approx(best.ground.variance)
        assert best.whole.half_width**2 == pytest.approx(best.by_chance.half_width**2 + best.of_ground**2)
    # The share is known by 16 worlds only: an error of 0.11, which costs some points of coverage.
    assert np.mean(inside) == pytest.approx(0.94, abs=0.05)
    assert np.mean(plain) < 0.80
    # What counts is total - 0.8 chance, by 15 and 16 degrees of freedom.
    total, of_chance = ground**2 + chance**2, 0.8 * chance**2
    error = np.hypot(total / np.sqrt(15.0), of_chance / np.sqrt(16.0)) / np.sqrt(2.0)
    assert np.std(np.log(widths)) == pytest.approx(error / (total - of_chance), abs=0.05)  # the share ends at 0.98


def test_the_tables_prior_is_left_at_odds_of_twenty_to_one(tmp_path: Path) -> None:
    (tmp_path / "campaign.toml").write_text(CAMPAIGN.replace("order = 1", "order = 2"), encoding="utf-8")
    spec, ground = load_spec(tmp_path), Ground(0.4, 0.6, 16, 32, 0.3)
    rng = np.random.default_rng(1)
    points, flights = rng.uniform(-1.0, 1.0, (44, 1)), np.arange(44) >= 40
    scores, odds = 95.0 - 40.0 * points[:, 0] ** 2 + rng.standard_normal(44), []
    for off in np.linspace(0.0, -8.0, 33):
        model, data, scale, found = of_both(spec, points, flights, scores + off * flights, ground)
        narrow, ratio = expected_of_flights(spec, data, scale, ground)
        given = (model, data.points, scale.values, flights)
        tables, guess = (
            fit_sources(*given, weights=scale.weights, prior_sd=sd, ratio=ratio).log_evidence
            for sd in (narrow, guessed_sd(scale.values))
        )
        odds.append(np.exp(guess - tables))
        assert (found.both.prior_sd > narrow) == (odds[-1] > 20.0)
    assert any(1.0 < one < 20.0 for one in odds)
    assert any(20.0 < one < 400.0 for one in odds)
