"""Rehearsed campaigns: what their truths are drawn from, and what their intervals cover."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from functools import cache
from pathlib import Path
from tempfile import TemporaryDirectory
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from scipy.stats import kstest
from scipy.stats import t as student_t

from seqrsm.analysis.conclude import analyse
from seqrsm.analysis.ground import Ground
from seqrsm.analysis.posterior import draw_coefficients
from seqrsm.analysis.results import Analysis
from seqrsm.analysis.scale import Interval
from seqrsm.campaign import rehearsal
from seqrsm.campaign.next_runs import start_batch
from seqrsm.fit.process import Process
from seqrsm.spec.read import CampaignSpec, load_spec
from seqrsm.store.records import NewRun, NewScore, RunRecord

SIGMA = 2.0
Mean = Callable[[np.ndarray], np.ndarray]


def hill(x: np.ndarray) -> np.ndarray:
    return 80.0 - 9.0 * (x[:, 0] - 0.3) ** 2 - 6.0 * (x[:, 1] + 0.2) ** 2


def cliff(x: np.ndarray) -> np.ndarray:
    return hill(x) - 30.0 / (1.0 + np.exp(-12.0 * (x[:, 0] - 0.4)))


@cache
def known(
    mean: Mean, sign: float = 1.0, model: str = "", days: float = 0.0, ground: Ground | None = None
) -> tuple[CampaignSpec, Analysis]:
    """What is known after a start design and fourteen runs anywhere, on eight ``days`` that scatter by so much.

    With a ``ground`` they are simulations.
    """
    goal = "maximize" if sign > 0.0 else "minimize"
    factors = "".join(f'[[factor]]\nname = "{name}"\nlow = -1.0\nhigh = 1.0\n' for name in "ab")
    with TemporaryDirectory() as folder:
        (Path(folder) / "campaign.toml").write_text(
            f'[campaign]\nname = "r"\nseed = 3\nbatch = 6\n{factors}[[application]]\nname = "score"\n'
            f'utility = "measured"\ngoal = "{goal}"\n{model}[stop]\nhalf_width = 5.0\nmax_runs = 30\n',
            encoding="utf-8",
        )
        spec = load_spec(Path(folder))
    rng = np.random.default_rng(4)
    source = "simulation" if ground else "flight"
    new = start_batch(spec, source)
    start = spec.region.code([run.settings for run in new])
    points = np.vstack([start, rng.uniform(-1.0, 1.0, (14, 2))])
    scores = sign * (mean(points) + SIGMA * rng.standard_normal(len(points)))
    day = np.arange(len(points)) % 8
    scores += days * np.linspace(-1.5, 1.5, 8)[day]
    new = [
        NewRun(settings, "start", "", source, block=f"{one}" if days else "")
        for settings, one in zip(spec.region.decode(points), day, strict=True)
    ]
    runs: list[RunRecord] = [
        rehearsal.scored_run(i + 1, 1, run, NewScore("score", float(score)))
        for i, (run, score) in enumerate(zip(new, scores, strict=True))
    ]
    return spec, analyse(spec, spec.applications[0], runs, n_draws=500, ground=ground)


def rehearsed(spec: CampaignSpec, analysis: Analysis, n: int) -> tuple[dict, list[tuple[int, int]]]:
    told: list[tuple[int, int]] = []
    campaign = SimpleNamespace(spec=spec, analyse_all=lambda _name: (analysis,))
    return rehearsal.rehearse_campaign(campaign, n, lambda done, total: told.append((done, total))), told


def test_intervals_cover_truths_that_are_drawn() -> None:
    spec, analysis = known(hill)
    found, told = rehearsed(spec, analysis, 6)
    numbers = found["numbers"]
    assert told[-1] == (6, 6)
    assert 18 <= numbers["runs_p10"] <= numbers["runs_median"] <= numbers["runs_p90"] <= 30
    assert numbers["stopped"] >= 0.5
    assert 0.85 <= numbers["coverage_new_run"] <= 1.0
    assert numbers["coverage_rule"] == numbers["coverage_new_run"]  # it watches the interval of one run
    assert 0.0 <= numbers["regret_median"] <= numbers["regret_p95"] < 5.0
    assert rehearsed(spec, analysis, 1)[0] == rehearsed(spec, analysis, 1)[0]


@pytest.mark.parametrize("mean", [hill, cliff])
def test_batches_of_random_days_are_rehearsed_by_days(monkeypatch: pytest.MonkeyPatch, mean: Mean) -> None:
    """Days that scatter thrice as much as runs: a batch shares its day's effect, and its analysis knows of days."""
    random = '[model]\nblock = "block"\nblock_effect = "random"\n'
    spec, analysis = known(mean, model=random, days=3.0 * SIGMA)
    draws = draw_coefficients(spec, analysis.fitted, sampler="exact", n_draws=500)
    for share in (0.0, 1.0):
        fitted = replace(analysis.fitted, departure=replace(analysis.fitted.departure, by_scores=share))
        given = replace(analysis, fitted=fitted)
        truths = [rehearsal._truth(given, draws, np.random.default_rng(i)) for i in range(15)]
        assert np.median([one.of_day for one in truths]) == pytest.approx(3.0 * SIGMA, rel=0.5)
    assert np.median([one.sd(np.zeros((1, 2))) for one in truths]) == pytest.approx(SIGMA, rel=0.5)  # of the process
    made, make = [], rehearsal.make_campaign

    def kept(*given: Any, **more: Any) -> tuple[Analysis, list[RunRecord]]:
        made.append(make(*given, **more))
        return made[-1]

    monkeypatch.setattr(rehearsal, "make_campaign", kept)
    found, _ = rehearsed(spec, analysis, 3)
    assert "Each rehearsed batch is a block of its own." in found["notes"]
    # Four days of one campaign may be alike by chance.
    assert np.median([last.fitted.surface.posterior.sigma_day for last, _ in made]) > 0.5 * SIGMA
    for last, runs in made:
        assert not last.fitted.surface.fixed_blocks
        assert [run.block for run in runs] == [f"day {run.batch}" for run in runs]


def test_a_ground_that_scatters_less_than_the_runs_is_rehearsed_with_their_scatter() -> None:
    """The rehearsed analysis took the variance measured at one place for runs that scattered as all did: 80 % of 95."""
    quiet = Ground(sd_ground=0.8, sd_chance=0.6, n_worlds=16, n_simulations=32, share=0.6)
    numbers = rehearsed(*known(hill, ground=quiet), 40)[0]["numbers"]
    for name in ("coverage_rule", "coverage_new_run", "coverage_mean"):
        assert 0.89 < numbers[name] < 0.99, name


@pytest.mark.parametrize("share", [0.0, 1.0])
def test_runs_of_student_errors_are_rehearsed_with_their_standard_deviation(share: float) -> None:
    """They scattered by its scale: seven in eight stopped at a target that `fit` and `check` put below the floor."""
    spec, analysis = known(hill, model='[model]\nerrors = "student_t"\n')
    draws = draw_coefficients(spec, analysis.fitted, sampler="exact", n_draws=500)
    departure = replace(analysis.fitted.departure, by_scores=share)
    given = replace(analysis, fitted=replace(analysis.fitted, departure=departure))
    truths = [rehearsal._truth(given, draws, np.random.default_rng(i)) for i in range(60)]
    process = analysis.fitted.departure.process
    assert process is not None
    scale = np.sqrt(process.noise_variance) if share else draws.sigma
    rehearsed_sd = np.median([one.sd(np.zeros((1, 2))) for one in truths])
    assert rehearsed_sd == pytest.approx(student_t(4).std() * np.median(scale), rel=0.12)


def test_minimising_mirrors_maximising() -> None:
    up, _ = rehearsed(*known(hill), 2)
    down, _ = rehearsed(*known(hill, -1.0), 2)
    for numbers in (up["numbers"], down["numbers"]):  # the draws are not mirrored, what they are like is
        assert 18 <= numbers["runs_median"] <= 30
        assert 0.0 <= numbers["regret_median"] < 2.0
        assert numbers["coverage_new_run"] > 0.8


def test_truths_are_quadratics_and_processes_by_their_probability() -> None:
    spec, analysis = known(cliff)
    departure = analysis.fitted.departure
    assert departure.probability > 0.9
    draws = draw_coefficients(spec, analysis.fitted, sampler="exact", n_draws=500)
    at = np.array([[0.1, 0.0], [0.9, -0.5]])
    truths = [rehearsal._truth(analysis, draws, np.random.default_rng(i)) for i in range(100)]
    values = np.array([truth.mean(at) for truth in truths])
    process = departure.process
    assert isinstance(process, Process)
    means, variances = process.marginals(at)
    sd = np.sqrt(variances.mean(axis=0) + means.var(axis=0))
    np.testing.assert_allclose(values.mean(axis=0), analysis.fitted.mean(at), atol=float(4.0 * np.max(sd) / 10.0))
    assert min(truth.best - float(truth.mean(analysis.optimum.point[None, :])[0]) for truth in truths[:20]) > -0.05


@pytest.mark.parametrize("share", [0.0, 1.0])
def test_runs_of_a_truth_scatter_as_its_scale_says(share: float) -> None:
    """On the logit's scale more where the score is nearer to 100, in percent less."""
    spec, analysis = known(lambda x: hill(x) + 14.0, model='[model]\nresponse = "logit"\n')
    draws = draw_coefficients(spec, analysis.fitted, sampler="exact", n_draws=500)
    fitted = replace(analysis.fitted, departure=replace(analysis.fitted.departure, by_scores=share))
    truth = rehearsal._truth(replace(analysis, fitted=fitted), draws, np.random.default_rng(2))
    at = np.array([[0.3, -0.2], [-1.0, 1.0]])
    percent = analysis.scale.to_score(truth.mean(at))
    assert percent[0] > 90.0 > 80.0 > percent[1]
    y = analysis.data.scores
    each, usual = percent * (100.0 - percent), np.median(y * (100.0 - y))
    np.testing.assert_allclose(truth.sd(at) * each / 100.0, SIGMA * np.sqrt(each / usual), rtol=0.5)
    assert truth.sd(at)[0] / truth.sd(at)[1] == pytest.approx(np.sqrt(each[1] / each[0]))


def test_a_campaign_in_memory_stops_by_its_rule_or_at_its_budget() -> None:
    spec, _ = known(hill)
    spec = replace(spec, stop=spec.stop.model_copy(update={"half_width": 50.0, "max_runs": 22}))

    def made(**rule: Any) -> tuple[Analysis, list[RunRecord]]:
        own = replace(spec, stop=spec.stop.model_copy(update=rule))
        rng = np.random.default_rng(1)
        score = lambda at: [NewScore("score", float(y)) for y in hill(at) + rng.standard_normal(len(at))]  # noqa: E731
        return rehearsal.make_campaign(own, "flight", score, n_draws=50)

    (stopped, few), (whole, all_runs) = made(), made(half_width=1e-3)
    assert stopped.decision.held
    assert len(few) == 18  # three for each of six terms: after the start design and one batch
    assert [run.run_id for run in all_runs] == list(range(1, 23))
    assert whole.fit.n_runs == 22
    assert [run.proposed for run in all_runs[:18]] == [run.proposed for run in few]


def test_the_first_look_forecasts_what_campaigns_reach() -> None:
    """Ten campaigns: were the variance of the mean to fall as 1/n, half-widths would be foretold 2.2 times too wide."""
    spec, _ = known(hill)
    rule = spec.stop.model_copy(update={"interval": "confidence", "half_width": 1e-3, "max_runs": 30})
    ratio = []
    for seed in range(10):
        rng = np.random.default_rng(seed)
        score = lambda at: [NewScore("score", float(y)) for y in hill(at) + SIGMA * rng.standard_normal(len(at))]  # noqa: B023, E731
        own = replace(spec, stop=rule, seed=seed)
        last, runs = rehearsal.make_campaign(own, "flight", score, n_draws=50)
        first = analyse(own, own.applications[0], [run for run in runs if run.batch == 1], n_draws=50)
        ratio.append(first.decision.attainable_half_width / last.decision.half_width)
    assert 0.7 < np.exp(np.mean(np.log(ratio))) < 1.5


def test_the_first_application_alone_is_rehearsed() -> None:
    spec, analysis = known(hill)
    other = spec.applications[0].model_copy(update={"name": "other"})
    plain = rehearsal._plain(replace(spec, applications=(*spec.applications, other)), analysis)
    assert [one.name for one in plain.applications] == ["score"]
    assert plain.considerations == ()
    # What stops, costs and loses is its own, which no line told.
    draws = draw_coefficients(spec, analysis.fitted, sampler="exact", n_draws=10)
    ended = [dict.fromkeys(("rule", "prediction", "confidence", "held", "runs", "loss"), 1.0)] * 2
    for applications, told in ((spec.applications, False), ((*spec.applications, other), True)):
        notes = rehearsal._summary(replace(spec, applications=applications), analysis, draws, ended)["notes"]
        assert ("Rehearsed is the first application alone: score." in notes) == told


def test_numbers_of_a_rehearsal_by_hand() -> None:
    assert rehearsal._share(np.array([1.0, 1.5, 2.0, 3.5, 4.0]), Interval(1.5, 3.5)) == 0.6
    spec, analysis = known(hill)
    draws = draw_coefficients(spec, analysis.fitted, sampler="exact", n_draws=10)
    covered = {"rule": 1.0, "prediction": 0.5}
    ended = [{**covered, "confidence": i < 9, "held": i < 8, "runs": 20 + i, "loss": float(i)} for i in range(11)]
    numbers = rehearsal._summary(spec, analysis, draws, ended)["numbers"]
    assert numbers == {
        "stopped": 8 / 11,
        "runs_p10": 21,
        "runs_median": 25,
        "runs_p90": 29,
        "cost_median": 25.0,
        "coverage_rule": 1.0,
        "coverage_new_run": 0.5,
        "coverage_mean": 9 / 11,
        "regret_median": 5.0,
        "regret_p95": 9.5,
    }


def test_a_draw_of_the_process_is_distributed_as_its_marginals() -> None:
    _, analysis = known(cliff)
    process = analysis.fitted.departure.process
    assert process is not None
    at = np.array([[0.45, 0.3]])
    rng = np.random.default_rng(0)
    values = np.array([process.draw(rng)[0](at)[0] for _ in range(800)])
    means, variances = process.marginals(at)
    marginal = means[:, 0] + np.sqrt(variances[:, 0]) * rng.standard_normal((4000, len(means)))
    found = np.sort(marginal.ravel())
    assert kstest(values, lambda x: np.searchsorted(found, x) / len(found)).pvalue > 1e-3


def test_truths_beyond_100_percent_are_covered_as_the_scores_that_they_give() -> None:
    spec, _ = known(lambda x: hill(x) + 19.0)
    percent = spec.applications[0].model_copy(update={"utility": "percent_correct"})
    percent.model_post_init(None)
    spec = replace(spec, applications=(percent,))
    rng = np.random.default_rng(4)
    at = spec.region.sample(30, rng)
    scores = np.minimum(hill(at) + 19.0 + SIGMA * rng.standard_normal(30), 100.0)
    runs = [
        rehearsal.scored_run(i + 1, 1, NewRun(settings, "start", "", "flight"), NewScore("score", float(score)))
        for i, (settings, score) in enumerate(zip(spec.region.decode(at), scores, strict=True))
    ]
    numbers = rehearsed(spec, analyse(spec, percent, runs, n_draws=500), 8)[0]["numbers"]
    assert numbers["coverage_mean"] >= 0.75
    assert numbers["coverage_new_run"] >= 0.85
    assert numbers["regret_p95"] < 5.0


def test_confirmation_runs_are_rehearsed() -> None:
    """Where they are the guard, no campaign could stop without them; they are beyond the budget of runs."""
    spec, analysis = known(hill)
    stop = spec.stop.model_copy(update={"guard": "confirmation", "confirmation_runs": 4, "half_width": 9.0})
    numbers = rehearsed(replace(spec, stop=stop), analysis, 6)[0]["numbers"]
    assert numbers["stopped"] >= 0.5
    assert 16 <= numbers["runs_p10"] <= numbers["runs_median"] < 30


def test_a_campaign_that_may_be_no_better_than_a_guess_does_not_stop_in_rehearsal_either() -> None:
    spec, analysis = known(hill)
    for guess, stopped in ((40.0, True), (79.0, False)):
        data = replace(analysis.data, guess=guess)
        numbers = rehearsed(spec, replace(analysis, fitted=replace(analysis.fitted, data=data)), 4)[0]["numbers"]
        assert (numbers["stopped"] > 0.4) is stopped


@pytest.mark.parametrize("response", ["identity", "logit"])
def test_counts_are_rehearsed_as_counts(monkeypatch: pytest.MonkeyPatch, response: str) -> None:
    """Runs of 96 percent scatter less than runs of 60, in rehearsed scores and for their fits: by p (1 - p) / n."""
    spec, _ = known(hill)
    percent = spec.applications[0].model_copy(update={"utility": "percent_correct"})
    percent.model_post_init(None)
    counts = spec.model.model_copy(update={"weights": "counts", "response": response})
    spec = replace(spec, applications=(percent,), model=counts)
    rng = np.random.default_rng(4)
    at = spec.region.sample(40, rng)
    correct = rng.binomial(150, (96.0 - 20.0 * at[:, 0] ** 2 - 16.0 * at[:, 1] ** 2) / 100.0)
    runs = [
        rehearsal.scored_run(i, 1, NewRun(one, "", "", "flight"), NewScore("score", n / 1.5, n=150, correct=int(n)))
        for i, (one, n) in enumerate(zip(spec.region.decode(at), correct, strict=True))
    ]
    made: list[tuple[Analysis, list[RunRecord]]] = []
    whole = rehearsal.make_campaign
    monkeypatch.setattr(rehearsal, "make_campaign", lambda *of, **more: made.append(whole(*of, **more)) or made[-1])
    first = analyse(spec, spec.applications[0], runs, n_draws=500)
    numbers = rehearsed(spec, first, 3)[0]["numbers"]
    assert numbers["coverage_new_run"] > 0.8

    def binomial(values: Any) -> Any:
        p = first.scale.to_score(values) / 100.0
        return p * (1.0 - p) if response == "identity" else 1.0 / (p * (1.0 - p))

    draws = draw_coefficients(spec, first.fitted, sampler="exact", n_draws=500)
    truth = rehearsal._truth(first, draws, np.random.default_rng(2))
    ends = np.array([[0.0, 0.0], [1.0, -1.0]])
    high, low = truth.sd(ends) / np.sqrt(binomial(truth.mean(ends)))
    assert high == pytest.approx(low, rel=0.05)
    for analysis, done in made:
        assert {score.n for run in done for score in run.scores} == {150}
        each = binomial(analysis.fit.y - analysis.fit.residuals)
        expected = (1.0 / each) / np.mean(1.0 / each)
        np.testing.assert_allclose(analysis.fit.weights, expected, rtol=0.12)
        assert np.ptp(expected) > 1.0
