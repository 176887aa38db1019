"""Flights on random days, Student-t errors among them: what a new day adds to runs, and the runs chosen for it."""

from __future__ import annotations

import re
from contextlib import suppress
from dataclasses import replace

import numpy as np
import pytest
from process_cases import bowl, factors, fitted, hill, spread
from scored_campaigns import analysed, campaign, numeric, specification

from seqrsm.analysis.belief import intervals_by_draws
from seqrsm.analysis.conclude import as_found
from seqrsm.analysis.posterior import draw_coefficients
from seqrsm.analysis.results import Analysis, BlockResponse
from seqrsm.analysis.study import block_study
from seqrsm.analysis.surfaces import RandomBlocks
from seqrsm.campaign import next_runs
from seqrsm.campaign.campaign import Campaign
from seqrsm.campaign.check import check_campaign
from seqrsm.decide.stopping import StopRule
from seqrsm.design.region import Region
from seqrsm.errors import FitError
from seqrsm.fit.blocks import fit_random_blocks
from seqrsm.fit.process import Blocks
from seqrsm.propose.cloud import Cloud, Runs, propose_from_process
from seqrsm.report.sections.check import check_sections
from seqrsm.report.wording import no_intervals
from seqrsm.store.records import IngestedFile, IngestedRun, NewScore

RANDOM = '[model]\nblock = "day"\nblock_effect = "random"\n'
DAYS = [f"day {i}" for i in range(8)] * 5
OF_DAYS = np.tile(5.0 * np.linspace(-1.5, 1.5, 8), 5)
NOISE = np.random.default_rng(9).standard_t(4.0, 40)
STUDENT = 2.0
"""Variance of Student's errors with four degrees of freedom over the square of their scale."""


@pytest.fixture(scope="module")
def flown(tmp_path_factory) -> tuple[Campaign, Analysis]:
    """A bowl by 40 flights on 8 days, their effects of a standard deviation of 5; wild scores."""
    points = np.round(spread(40, 2), 3)
    text = specification(numeric(2), rest=f'{RANDOM}errors = "student_t"\n')
    folder = tmp_path_factory.mktemp("days") / "c"
    made = campaign(folder, text, points, bowl(points) + OF_DAYS + NOISE, source="flight", block=DAYS)
    return made, made.analyse_all(n_draws=400)[0]


def test_a_run_of_a_new_day_scatters_by_its_error_and_its_day(flown) -> None:
    fitted, surface = flown[1].fitted, flown[1].fitted.surface
    assert isinstance(surface, RandomBlocks)
    found = surface.posterior
    own, day = found.shares @ np.square(found.s), surface.common_sd**2
    quadratic = replace(fitted.departure, process=None, by_scores=0.0)
    for weight in (1.0, 3.0):
        sd = quadratic.sd_of_run(surface.sd_of_run(weight), surface.errors, weight)
        assert sd**2 == pytest.approx(STUDENT * own / weight + day, rel=1e-9)
    known = as_found(StopRule(), replace(fitted, departure=quadratic), flown[1].optimum.point)
    assert known.ground_share == pytest.approx(day / (STUDENT * own + day), rel=1e-9)  # all of a day's runs share it
    _, _, of_days = found.draws(100_000, np.random.default_rng(1))
    assert surface.common_sd == pytest.approx(np.mean(of_days), rel=0.05)


def test_a_plane_asks_for_three_runs_a_term_where_another_surface_is_likelier(tmp_path) -> None:
    text = specification(numeric(10), rest="[model]\norder = 1\n")
    (tmp_path / "campaign.toml").write_text(text, encoding="utf-8")
    found = check_campaign(tmp_path)
    assert (found.n_terms, found.min_runs, found.min_runs_departed) == (11, 31, 33)


def test_check_counts_the_constants_of_fixed_days_as_the_stop_rule_does(tmp_path) -> None:
    """A quadratic in two factors and eight days are 13 terms: told were 18 runs where the rule asks for 33."""
    points = np.round(spread(40, 2), 3)
    text = specification(numeric(2), rest='[model]\nblock = "day"\n').replace("max_runs = 400", "max_runs = 44")
    (tmp_path / "new").mkdir()
    (tmp_path / "new" / "campaign.toml").write_text(text, encoding="utf-8")
    before = check_campaign(tmp_path / "new")
    scores = bowl(points) + OF_DAYS + NOISE
    (analysis,) = campaign(tmp_path / "c", text, points, scores, source="flight", block=DAYS).analyse_all(n_draws=400)
    after = check_campaign(tmp_path / "c")
    assert "33 are required (20 degrees of freedom)" in " ".join(check.text for check in analysis.decision.checks)
    assert (before.min_runs, after.min_runs) == (18, 33)
    assert (before.min_runs_departed, after.min_runs_departed) == (18, 39)
    assert {plan.asked for plan in after.plans if not plan.change} == {33}
    told = [dict(check_sections(one)[0].blocks[0].items) for one in (before, after)]
    assert [one["minimum runs to stop"] for one in told] == [
        "18, and more for each further flight day; the budget is enough for 18 of these",
        "33, or up to 39 if scores favour another surface than the model, and more for each further flight day; "
        "the budget is enough for 11 of these",
    ]
    random = check_campaign(
        campaign(
            tmp_path / "r",
            text.replace('"day"', '"day"\nblock_effect = "random"'),
            points,
            scores,
            source="flight",
            block=DAYS,
        ).folder
    )
    assert dict(check_sections(random)[0].blocks[0].items)["minimum runs to stop"] == "18"


@pytest.mark.parametrize("n_days", [2, 3, 5])
def test_few_days_leave_the_noise_floor_below_the_half_width(tmp_path, n_days: int) -> None:
    """The mean square of the effects of two days has no end: told was a floor above the interval as it was."""
    points, rng = np.round(spread(30, 2), 3), np.random.default_rng(n_days)
    y = bowl(points) + rng.normal(size=30)
    days = [f"day {i % n_days}" for i in range(30)]
    text = specification(numeric(2), rest=RANDOM).replace("[stop]", '[stop]\ninterval = "prediction_mean"')
    analysis = analysed(tmp_path / "c", text, points, y, block=days)
    assert 0.8 * 1.96 * np.sqrt(1.0 / 5.0) < analysis.decision.noise_floor < analysis.optimum.prediction_mean.half_width


def test_intervals_of_random_days_are_told_where_constants_would_leave_none(tmp_path) -> None:
    """Nine runs of a quadratic in two factors on four days: as constants, days take the last degrees of freedom."""
    points, rng = np.round(spread(9, 2), 3), np.random.default_rng(1)
    y = bowl(points) + rng.normal(size=9)
    text = specification(numeric(2), rest=RANDOM)
    analysis = analysed(tmp_path / "c", text, points, y, block=[f"day {i % 4}" for i in range(9)])
    assert analysis.fit.df_residual == 0
    assert analysis.fitted.departure.process is not None
    assert not any("error estimate" in warning for warning in analysis.warnings)
    assert no_intervals(analysis) == ""
    assert np.isfinite(analysis.optimum.prediction.half_width)


def test_equal_scores_on_random_days_are_refused_with_what_to_do(tmp_path) -> None:
    with pytest.raises(FitError) as refused:
        analysed(tmp_path / "c", specification(numeric(2), rest=RANDOM), spread(40, 2), np.full(40, 50.0), block=DAYS)
    (problem,) = refused.value.problems
    assert problem.remedy == 'Score more runs, or set [model] block_effect = "fixed".'


def test_days_of_the_process_are_its_own(flown) -> None:
    """Were its days all alike, the mean of many runs of a new one would be known as well as the surface."""
    made, analysis = flown
    process, at = analysis.fitted.departure.process, np.array([0.2, 0.2])
    alike = process.some(100)
    alike.hyper = replace(alike.hyper, block=np.zeros_like(alike.hyper.block))
    draws = draw_coefficients(made.spec, analysis.fitted, sampler="exact", n_draws=4000)
    widths = []
    for one in (process, alike):
        departure = replace(analysis.fitted.departure, process=one, by_scores=1.0)
        belief = replace(analysis.fitted, departure=departure)
        rng = np.random.default_rng(5)
        _, (mean, many) = intervals_by_draws(belief, at, 0.95, (100,), 0.0, draws, rng)
        widths.append(many.half_width / mean.half_width)
    assert widths[0] > 1.6
    assert widths[1] < 1.2


def test_intervals_of_a_new_day_are_students(flown) -> None:
    """Beside the headline: what the quadratic alone gives there, with runs that scatter by more than their scale."""
    made, analysis = flown
    study = block_study(made.spec, analysis.fitted, analysis.optimum.point)
    assert study is not None
    assert isinstance(study.new, BlockResponse)
    row = analysis.model.matrix(analysis.optimum.point[None, :])
    told = analysis.fitted.surface.posterior.predict(row, 0.95, weight=1.0 / STUDENT).prediction
    found = study.new.prediction
    assert [found.low, found.high] == pytest.approx([float(told.low[0]), float(told.high[0])], rel=1e-9)


def test_what_weights_tell_too_well_inflates_the_mean_alone() -> None:
    rng, days = np.random.default_rng(2), np.arange(30) % 6
    Z = np.column_stack([np.ones(30), rng.uniform(-1.0, 1.0, 30)])
    y = Z @ [50.0, 3.0] + 2.0 * rng.normal(size=6)[days] + rng.normal(size=30)
    plain, inflated = (fit_random_blocks(Z, y, days.tolist(), inflation=by) for by in (1.0, 1.4))
    one, other = (found.predict(Z[:3], 0.95) for found in (plain, inflated))
    away = np.square(Z[:3] @ plain.mean.T - one.mean[:, None]) @ plain.shares  # of the ratios: no error of weights
    np.testing.assert_allclose(other.se_mean**2 - away, 1.4 * (one.se_mean**2 - away), rtol=1e-9)
    np.testing.assert_array_equal(inflated.s, plain.s)
    np.testing.assert_array_equal(inflated.ratios, plain.ratios)


def test_the_first_run_of_a_new_day_is_judged_by_its_scatter_and_the_days() -> None:
    points, days = np.round(spread(24, 2), 3), np.arange(24) % 6
    y = hill(points) + 4.0 * np.linspace(-1.5, 1.5, 6)[days] + np.random.default_rng(1).normal(size=24)
    process = fitted(points, y, blocks=Blocks(np.eye(6)[days], new=True))
    region, top, rng = Region(factors(2)), np.array([0.3, 0.3]), np.random.default_rng(3)
    cloud = Cloud(process, region, top, points, 1.0, rng)
    best = np.argmax(cloud.draws(12, rng), axis=1)
    (one,) = propose_from_process(process, region, top, Runs(points, np.zeros(24, dtype=bool)), 1, seed=3)
    place = int(np.argmin(np.sum((cloud.points - one.point) ** 2, axis=1)))
    row = cloud.covariance[place]
    noise, block = (float(np.mean(one)) for one in (process.some(20).noise_variance, process.some(20).block_variance))
    gain = row[cloud.hat] ** 2 + np.mean((row[best] - row[cloud.hat]) ** 2)
    assert one.gain == pytest.approx(gain / (row[place] + noise + block), rel=1e-9)
    assert block > 4.0 * noise


def test_what_a_run_of_a_new_random_day_narrows_is_told(flown) -> None:
    """By generalized least squares with the ratio of variances found; told was 4 % for 0.3 % and for 5 %."""
    made, analysis = flown
    departure = replace(analysis.fitted.departure, process=None, by_scores=0.0)
    quadratic = replace(analysis, fitted=replace(analysis.fitted, departure=departure))
    new = next_runs.next_batch(made.spec, [quadratic], made.store.runs(), 3, "flight")
    surface, at, model = analysis.fitted.surface, analysis.optimum.point, analysis.model
    ratio = surface.common_sd**2 / (surface.s**2 - surface.common_sd**2)
    points = np.vstack([analysis.fitted.data.points, made.spec.region.code([run.settings for run in new])])
    day = np.append(np.tile(np.arange(8), 5), [8, 8, 8])
    weight = analysis.fitted.scale.weight_at(analysis.fitted.mean(at[None, :]))
    w = np.append(np.ones(40), np.repeat(weight, 3))
    row, h = model.matrix(at[None, :])[0], []
    for n in range(40, 44):
        Z, V = model.matrix(points[:n]), np.diag(1.0 / w[:n]) + ratio * (day[:n, None] == day[:n])
        h.append(row @ np.linalg.solve(Z.T @ np.linalg.solve(V, Z), row))
    for one, before, after in zip(new, h[:-1], h[1:], strict=True):
        of_run = 1.0 / weight[0] + ratio
        told = [float(share) for share in re.findall(r"by ([\d.e-]+) %", one.why)]
        true = [1.0 - np.sqrt((of_run + after) / (of_run + before)), 1.0 - np.sqrt(after / before)]
        if one.purpose == "optimum":
            assert told == pytest.approx([100.0 * share for share in true], rel=0.06, abs=1e-3)
    assert {"optimum"} <= {one.purpose for one in new}


def test_pending_flights_of_an_earlier_batch_are_of_a_day_of_their_own() -> None:
    """They tell of the surface, and nothing of the day of the runs that are chosen now."""
    points, days = np.round(spread(24, 2), 3), np.arange(24) % 6
    y = hill(points) + 4.0 * np.linspace(-1.5, 1.5, 6)[days] + np.random.default_rng(1).normal(size=24)
    process = fitted(points, y, blocks=Blocks(np.eye(6)[days], new=True))
    region, top = Region(factors(2)), np.array([0.3, 0.3])
    made, pending = np.vstack([points, [[0.5, -0.4]]]), np.arange(25) == 24
    found = {}
    for day in (1, 7):
        (found[day],) = propose_from_process(process, region, top, Runs(made, day * pending), 1, seed=3)
    rng = np.random.default_rng(3)
    cloud = Cloud(process, region, top, points, 1.0, rng, made[pending])
    best = np.argmax(cloud.draws(12, rng), axis=1)
    noise, block = (float(np.mean(one)) for one in (process.some(20).noise_variance, process.some(20).block_variance))
    place, waits = (int(np.argmin(np.sum((cloud.points - at) ** 2, axis=1))) for at in (found[7].point, made[24]))
    C = cloud.covariance
    left = C - np.outer(C[waits], C[waits]) / (C[waits, waits] + noise + block)
    gain = left[place, cloud.hat] ** 2 + np.mean((left[place, best] - left[place, cloud.hat]) ** 2)
    assert found[7].gain == pytest.approx(gain / (left[place, place] + noise + block), rel=1e-9)
    assert found[1].gain != pytest.approx(found[7].gain, rel=0.01)


@pytest.mark.parametrize("of", [lambda x: x[:, 0] > 0.0, lambda x: np.arange(len(x)) // 2], ids=["confounded", "many"])
def test_runs_of_one_more_day_are_proposed_where_days_hide_terms(tmp_path, of) -> None:
    """Refused were more runs, though the fit asked for them; flown on one day, they tell days and settings apart."""
    points = np.round(spread(18, 2), 3)
    points[:, 0] = np.where(points[:, 0] > 0.0, 1.0, -1.0)
    points[[0, 1], 0] = 0.0
    days = [f"day {d}" for d in of(points)]
    text = specification(numeric(2), rest='[model]\nblock = "day"\n')
    made = campaign(tmp_path / "c", text, points, bowl(points), source="flight", block=days)
    with pytest.raises(FitError, match="propose"):
        made.analyse_all(n_draws=400)
    for day in range(3):
        new = made.propose(4)
        assert len(new) == 4
        scores = bowl(made.spec.region.code([run.settings for run in new]))
        rows = zip(new, scores.tolist(), strict=True)
        again = tuple(
            IngestedRun(r.run_id, r.settings, "flight", f"new {day}", 1.0, (NewScore("score", y),)) for r, y in rows
        )
        made.store.ingest_files([IngestedFile(f"{day}.csv", f"new {day}", 4, again)])
        with suppress(FitError):
            assert made.analyse_all(n_draws=400)
            return
    raise AssertionError("three more days did not tell them apart")


@pytest.mark.parametrize(("scored", "own"), [(False, True), (True, False)])
def test_a_batch_of_which_nothing_is_flown_has_a_day_of_its_own(flown, monkeypatch, scored, own) -> None:
    """What is left over of one that was flown in part is flown with the next: its own day is over."""
    made, analysis = flown
    departure = replace(analysis.fitted.departure, by_scores=0.0)
    quadratic = replace(analysis, fitted=replace(analysis.fitted, departure=departure))
    runs = made.store.runs()
    waits = [replace(runs[i], run_id=90 + i, state="issued", block="", batch=9) for i in range(2)]
    runs = [*runs, replace(runs[5], run_id=99, batch=9), *waits] if scored else [*runs, *waits]
    real, given = next_runs.propose_batch, []
    monkeypatch.setattr(next_runs, "propose_batch", lambda *a, **more: given.append((a[2], more)) or real(*a, **more))
    next_runs.next_batch(made.spec, [quadratic], runs, 2, "flight")
    ((evidence, more),) = given
    new = more["source"].rows(np.zeros((1, 2)))[0]
    columns = evidence.rows[:, analysis.model.p :]
    assert new.sum() == pytest.approx(2.0)  # the intercept, and the new day
    assert np.all(columns.sum(axis=1) == 1.0)
    assert columns.shape[1] == (10 if own else 9)
    np.testing.assert_array_equal(columns[-2:, -1], 0.0 if own else 1.0)
    assert np.count_nonzero(evidence.prior_precision) == columns.shape[1]


def test_the_quadratic_chooses_a_new_days_runs_with_its_effect_unknown(flown, monkeypatch: pytest.MonkeyPatch) -> None:
    """Each day's is one of the days that are seen to differ so much: neither taken for 0, nor for anything."""
    made, analysis = flown
    departure = replace(analysis.fitted.departure, by_scores=0.0)
    quadratic = replace(analysis, fitted=replace(analysis.fitted, departure=departure))
    real, given = next_runs.propose_batch, []
    monkeypatch.setattr(next_runs, "propose_batch", lambda *a, **more: given.append(a[2]) or real(*a, **more))
    assert len(next_runs.next_batch(made.spec, [quadratic], made.store.runs(), 4, "flight")) == 4
    (evidence,) = given
    assert not evidence.rows[:, -1].any()  # nobody has flown on that day
    precision = np.asarray(evidence.prior_precision)
    ratio = analysis.fitted.surface.common_sd**2 / (analysis.fitted.surface.s**2 - analysis.fitted.surface.common_sd**2)
    np.testing.assert_allclose(precision[-9:, -9:], np.eye(9) / ratio, rtol=1e-9)
    assert np.count_nonzero(precision) == 9


@pytest.mark.parametrize("effect", ["fixed", "random"])
def test_a_new_day_promises_no_percentage_above_100(tmp_path, effect: str) -> None:
    """Told were a mean of 100.4 and an interval up to 103.9 percent."""
    points = np.round(spread(40, 2), 3)
    scores = np.minimum(102.0 - 10.0 * np.sum(np.square(points), axis=1) + 0.2 * OF_DAYS + NOISE, 100.0)
    text = specification(numeric(2), rest=f'[model]\nblock = "day"\nblock_effect = "{effect}"\n')
    text = text.replace('"measured"', '"percent_correct"')
    made = campaign(tmp_path / "c", text, points, scores, source="flight", block=DAYS)
    (found,) = made.analyse_all(n_draws=400, thorough=True)
    new = found.blocks.new
    assert found.fit.predict(found.model.matrix(found.optimum.point[None, :])).mean > 100.0
    assert (new.mean, new.confidence.high, new.prediction.high) == (100.0, 100.0, 100.0)
    assert new.prediction.low < new.confidence.low < 100.0
