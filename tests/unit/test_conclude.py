"""Which runs a look is made of, what it promises of percentages, and what it weighs against another application."""

from __future__ import annotations

import re
import sys
from dataclasses import replace
from pathlib import Path
from types import FrameType, SimpleNamespace

import numpy as np
import pandas as pd
import pytest
from process_cases import bowl, hill, spread
from scipy.stats import norm
from scored_campaigns import analysed, campaign, numeric, specification

from seqrsm.analysis import compromise
from seqrsm.analysis.conclude import _gain_of_student, _possible, analyse, as_found
from seqrsm.analysis.ground import Ground
from seqrsm.analysis.results import Analysis, OptimumEstimate
from seqrsm.analysis.runs import evidence, n_fitted, response_scale
from seqrsm.analysis.scale import Interval
from seqrsm.campaign.campaign import Campaign
from seqrsm.campaign.rehearsal import scored_run
from seqrsm.decide.stopping import StopRule
from seqrsm.errors import FitError
from seqrsm.fit.robust import student_evidence
from seqrsm.report.rounding import format_plain
from seqrsm.report.sections.model import diagnostics_section
from seqrsm.report.sections.summary import _ends, _next_steps, _settings_table, recommendation, summary_section
from seqrsm.report.wording import half_width_text
from seqrsm.spec.tables import ApplicationSpec
from seqrsm.store.records import CONFIRMATION, NewRun, NewScore

POINTS = np.round(spread(24, 2), 3)
NOISE = np.random.default_rng(9).normal(size=24)


@pytest.fixture(scope="module")
def made(tmp_path_factory) -> Campaign:
    """A narrow top: what is believed is nearly the process alone."""
    folder = tmp_path_factory.mktemp("narrow") / "c"
    return campaign(folder, specification(numeric(2)), POINTS, hill(POINTS) + NOISE)


@pytest.fixture(scope="module")
def narrow(made: Campaign) -> Analysis:
    return made.analyse_all(n_draws=400)[0]


def promised(estimate: OptimumEstimate) -> list[float]:
    of = (estimate.confidence, estimate.prediction, estimate.prediction_mean)
    return [estimate.mean, *(end for interval in of for end in (interval.low, interval.high))]


@pytest.mark.parametrize(
    ("ends", "kept"),
    [
        ((90.0, 100.0), (90.0, 100.0)),  # the bound itself is a percentage like others
        ((90.0, np.nextafter(100.0, 200.0)), (90.0, 100.0)),
        ((0.0, 10.0), (0.0, 10.0)),
        ((-1e-300, 10.0), (0.0, 10.0)),
        ((101.0, 120.0), (100.0, 100.0)),
        ((-20.0, -1.0), (0.0, 0.0)),
        ((-5.0, 105.0), (0.0, 100.0)),
    ],
)
def test_nothing_above_100_or_below_0_is_promised(narrow: Analysis, ends: tuple, kept: tuple) -> None:
    wide = Interval(*ends)
    for mean, shown in zip(ends, kept, strict=True):
        estimate = replace(narrow.optimum, mean=mean, confidence=wide, prediction=wide, prediction_mean=wide)
        assert promised(_possible(estimate, 0.0, 100.0)) == [shown, *kept * 3]


@pytest.mark.parametrize(("goal", "bound"), [("maximize", 100.0), ("minimize", 0.0)])
def test_a_surface_that_passes_its_bound_promises_the_bound(tmp_path: Path, goal: str, bound: float) -> None:
    """The rule watches the whole interval all the same; a utility that is no percentage is told as it is."""
    sign = 1.0 if goal == "maximize" else -1.0
    scores = bound + sign * (6.0 - 9.0 * np.sum(np.square(POINTS), axis=1) + NOISE)
    text = specification(numeric(2), application=f'goal = "{goal}"\n')
    scores = np.clip(scores, 0.0, 100.0)
    percent = analysed(tmp_path / "percent", text.replace("measured", "percent_correct"), POINTS, scores)
    bare = analysed(tmp_path / "measured", text, POINTS, scores)
    assert percent.decision.half_width == bare.decision.half_width
    worse = "low" if goal == "maximize" else "high"
    better = "high" if goal == "maximize" else "low"
    for name in ("confidence", "prediction", "prediction_mean"):
        shown, uncut = getattr(percent.optimum, name), getattr(bare.optimum, name)
        assert sign * getattr(uncut, better) > sign * bound
        assert getattr(shown, better) == bound
        assert getattr(shown, worse) == getattr(uncut, worse)
        assert shown.half_width == uncut.half_width
    # One number for one meaning.
    assert percent.optimum.whole.half_width == pytest.approx(percent.decision.half_width, rel=1e-12)


@pytest.mark.parametrize("share", [0.0, 0.25, 1.0])
def test_the_compromise_counts_draws_of_the_process_by_its_probability(
    made: Campaign, narrow: Analysis, share: float
) -> None:
    departure = replace(narrow.fitted.departure, by_scores=share)
    analysis = replace(narrow, fitted=replace(narrow.fitted, departure=departure))
    objective = compromise._application(made.spec, analysis)
    assert objective.draws is not None
    at = np.array([[0.3, 0.3], [-0.8, 0.6]])
    np.testing.assert_allclose(objective.mean(at), analysis.fitted.mean(at))
    found = objective.draws(at)
    quadratics = narrow.posterior.term_draws @ narrow.model.matrix(at).T
    of_quadratic = np.isclose(found[:, None], quadratics, rtol=1e-9).all(axis=2).any(axis=1)
    assert (len(found), np.count_nonzero(of_quadratic)) == (compromise.DRAWS, round((1.0 - share) * compromise.DRAWS))
    process = departure.process
    assert process is not None
    means, variances = process.marginals(at)
    sd = np.sqrt(variances.mean(axis=0) + means.var(axis=0))
    rest = found[~of_quadratic]
    assert np.all(np.abs(rest - process.mean(at)) < 5.0 * sd)
    if share:
        assert np.all(np.abs(rest.mean(axis=0) - process.mean(at)) < 4.0 * sd / np.sqrt(len(rest)))
        assert abs(rest[:, 0].mean() - quadratics[:, 0].mean()) > 2.0  # the two are told apart


def test_the_compromise_weighs_percent_of_logits_from_unacceptable_to_ideal(tmp_path: Path) -> None:
    use = "unacceptable = 60.0\nideal = 90.0\n"
    text = specification(numeric(2), application=use, rest='[model]\nresponse = "logit"\n')
    text = text.replace("measured", "percent_correct")
    logit = campaign(tmp_path / "c", text, POINTS, 95.0 - 9.0 * np.sum(np.square(POINTS), axis=1) + NOISE)
    (analysis,) = logit.analyse_all(n_draws=400)
    objective = compromise._application(logit.spec, analysis)
    assert objective.draws is not None
    found = objective.mean(POINTS)
    np.testing.assert_allclose(found, analysis.scale.to_score(analysis.fitted.mean(POINTS)))
    assert 70.0 < found.min() < found.max() < 100.0
    drawn = objective.draws(POINTS)
    np.testing.assert_allclose(drawn.mean(axis=0), found, atol=2.0)
    assert (objective.unacceptable, objective.ideal) == (60.0, 90.0)


# the runs that enter -------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("errors", ["normal", "student_t"])
def test_a_measured_percentage_on_the_logit_scale_is_promised_no_more_than_100(tmp_path: Path, errors: str) -> None:
    text = specification(numeric(2), rest=f'[model]\nresponse = "logit"\nerrors = "{errors}"\n')
    scores = np.minimum(np.round(2.0 * (99.0 - 3.0 * np.sum(np.square(POINTS), axis=1) + NOISE)) / 2.0, 100.0)
    found = analysed(tmp_path / "c", text, POINTS, scores).optimum
    assert found.prediction.high == 100.0
    assert max(promised(found)) == 100.0


def test_scores_at_the_end_of_their_scale_are_told_to_hide_what_others_scatter_by(tmp_path: Path, monkeypatch) -> None:
    """Repeats that all scored 100 percent made intervals of a tenth of a percent, and nothing was said."""
    monkeypatch.setattr(ApplicationSpec, "score_limits", property(lambda self: (0.0, 100.0)))
    points = np.random.default_rng(2).uniform(-1.0, 1.0, (20, 2)).round(3)
    for high, told in ((11, True), (10, False)):
        scores = np.r_[np.full(high, 100.0), np.linspace(80.0, 99.0, 20 - high)]
        found = analysed(tmp_path / str(high), specification(numeric(2)), points, scores)
        assert any(f"{high} of 20 scores lie at the end of their scale" in text for text in found.warnings) is told


def test_confirmation_runs_are_evidence_once_later_runs_are_scored() -> None:
    def run(number: int, batch: int, purpose: str = "optimum"):
        return scored_run(number, batch, NewRun({"x0": 0.0}, purpose), NewScore("score", 70.0))

    first, fresh, later = run(1, 1), run(2, 2, CONFIRMATION), run(3, 3)
    assert evidence([first, fresh]) == [first]
    for state in ("proposed", "issued", "running", "failed", "void"):
        waiting = replace(later, state=state)
        assert evidence([first, fresh, waiting]) == [first, waiting]
    beside = run(3, 2)  # made together with it, it does not follow
    assert evidence([first, fresh, beside]) == [first, beside]
    assert evidence([first, fresh, later]) == [first, fresh, later]


def test_scores_without_a_standard_error_are_named_where_they_would_count_by_it(
    made: Campaign, narrow: Analysis
) -> None:
    spec = replace(made.spec, model=made.spec.model.model_copy(update={"weights": "se"}))
    se = np.full(24, 2.0)
    assert response_scale(spec, replace(narrow.data, score_se=se)).weights.tolist() == [1.0] * 24
    se[[3, 7]] = np.nan
    with pytest.raises(FitError, match="runs 4, 8 without a standard error"):
        response_scale(spec, replace(narrow.data, score_se=se))


def test_a_look_enters_few_modules(made: Campaign, narrow: Analysis) -> None:
    """Who reads what becomes of scores reads these; what the first look loads is loaded by the fixture."""
    entered: set[str] = set()

    def note(frame: FrameType, event: str, _: object) -> None:
        name = frame.f_globals.get("__name__", "")
        if event == "call" and name.startswith("seqrsm."):
            entered.add(name)

    runs = made.store.runs()
    sys.setprofile(note)
    try:
        again = analyse(made.spec, made.spec.applications[0], runs, n_draws=400)
    finally:
        sys.setprofile(None)
    assert again.optimum.mean == narrow.optimum.mean
    assert {"seqrsm.analysis.conclude", "seqrsm.fit.process", "seqrsm.decide.stopping"} <= entered
    assert len(entered) <= 31, sorted(entered)


def with_ends(folder: Path, scores: np.ndarray, goal: str, **ends: float) -> Analysis:
    """A campaign of measured scores that know what a guess and perfect data score."""
    made = campaign(folder, specification(numeric(2), application=f'goal = "{goal}"\n'), POINTS, scores)
    runs = [
        replace(run, scores=tuple(replace(score, metadata={**score.metadata, **ends}) for score in run.scores))
        for run in made.store.runs()
    ]
    return analyse(made.spec, made.spec.applications[0], runs)


def test_no_stop_where_a_guess_may_do_as_well(tmp_path: Path) -> None:
    """The rule holds where the optimum is better than a guess by more than the interval that decides."""
    scores = 60.0 + 5.0 * POINTS[:, 0] + 0.1 * NOISE
    free = with_ends(tmp_path / "free", scores, "maximize")
    spec = campaign(tmp_path / "spec", specification(numeric(2)), POINTS, scores).spec
    assert free.decision.held
    assert np.isnan(free.data.guess)
    best, width = free.optimum.mean, free.decision.half_width
    for k, (away, held) in enumerate([(-2.0 * width, True), (-0.5 * width, False), (3.0, False)]):
        found = with_ends(tmp_path / str(k), scores, "maximize", guess=best + away, perfect=100.0)
        assert found.decision.held is held
        (check,) = [check for check in found.decision.checks if check.name == "guess"]
        assert check.holds is held
        assert (found.data.guess, found.data.perfect) == (pytest.approx(best + away), pytest.approx(100.0))
        told = [float(number) for number in re.findall(r"[\d.]+", _ends(found)[0][1])]
        assert told == pytest.approx([best + away, 100.0], abs=0.01)
        assert any("no setting is shown to beat guessing" in text for text in found.decision.reasons) is not held
        assert recommendation(found).startswith("Recommended" if held else "No setting is shown to do better")
        title = _settings_table(found).caption
        assert title.startswith("Recommended settings" if held else "Best settings of the fitted surface")
        spent = replace(found, decision=replace(found.decision, budget_spent=True))
        first = next(_next_steps(spec, spent))
        assert first.startswith("Stop." if held else "Change the region or the sensor")
        if held:
            short = replace(spent.decision, held=False, wants_confirmation=False)
            floors = {"Raise the budget": 0.5, "Accept the interval as it stands: more runs cannot reach": 2.0}
            for start, share in floors.items():
                floor = replace(short, noise_floor=share * spec.stop.half_width)
                assert next(_next_steps(spec, replace(spent, decision=floor))).startswith(start)
        doubt = replace(found.optimum, ground=Ground(4.0, 3.0, 16, 32, 0.6), by_chance=Interval(0.0, 0.0))
        after = half_width_text(found, 0.6 * doubt.whole.half_width)
        for budget, says in ((found, "Fly, or measure"), (spent, "Fly (raise [stop] max_runs first), or measure")):
            last = list(_next_steps(spec, replace(budget, optimum=doubt)))[-1]
            assert last.startswith(says)
            assert last.endswith(f"which one flight over the site would reduce to {after}.")
        of_map = replace(spent, known_map=True)
        assert ("better than the existing map for" in recommendation(of_map)) is not held
        assert next(_next_steps(spec, of_map)).endswith("more than the existing map alone.") is not held
        assert _ends(of_map)[0][-1] == "the existing map alone, and error-free data"
    made = campaign(tmp_path / "map", specification(numeric(2)), POINTS, scores)
    told = {"guess": 59.9}
    runs = [replace(run, scores=tuple(replace(one, metadata=told) for one in run.scores)) for run in made.store.runs()]
    beside = replace(made.spec, simulator=SimpleNamespace(known_map="old.csv"))
    found = analyse(beside, made.spec.applications[0].model_copy(update={"utility": "percent_correct"}), runs)
    assert found.known_map
    (check,) = [check for check in found.decision.checks if check.name == "guess"]
    assert check.text.startswith("The existing map alone scores 59.9")
    # An error is better the smaller it is.
    low = with_ends(tmp_path / "low", scores, "minimize", guess=float(scores.min()) + 40.0, perfect=0.0)
    assert low.decision.held
    assert not with_ends(tmp_path / "high", scores, "minimize", guess=10.0, perfect=0.0).decision.held


def test_no_edge_is_widened_that_has_nothing_beyond(tmp_path: Path) -> None:
    """Of four headings none is higher than the highest; of a campaign without a simulator nothing is known."""
    made = campaign(tmp_path / "c", specification(numeric(2)), POINTS, 60.0 + 5.0 * POINTS[:, 0] + 0.1 * NOISE)
    (found,) = made.analyse_all()
    best = replace(
        found.optimum,
        settings={"heading_deg": 0.0, "integration_time": 10.0},
        at_bound={"heading_deg": "low", "integration_time": "high"},
        active_constraints=("x0 <= 0.5",),
    )
    for simulator, edge in (
        (None, "heading_deg (low), integration_time (high) and"),
        ("prm", "integration_time (high) and"),
    ):
        spec = replace(made.spec, simulator=simulator and SimpleNamespace(engine=simulator))
        (told,) = [step for step in _next_steps(spec, replace(found, optimum=best)) if step.startswith("Consider")]
        assert told.endswith(f"its edge, {edge} constraint x0 <= 0.5.")


def test_the_diagnostics_call_the_recommended_settings_an_extrapolation_where_the_warnings_do(tmp_path) -> None:
    """Whatever the quadratic alone would recommend: the first page and the appendix are of the same settings."""
    points = np.random.default_rng(5).uniform(-0.7, 0.7, (14, 2))
    found = analysed(tmp_path / "c", specification(numeric(2)), points, points.sum(axis=1) + 0.1 * NOISE[:14])
    assert any(text.startswith("The optimum is an extrapolation") for text in found.warnings)  # at a corner
    inner = replace(found, of_quadratic=replace(found.of_quadratic, point=np.zeros(2)))
    assert "The recommended settings are an extrapolation" in str(diagnostics_section(inner, "x"))


def test_what_the_key_figures_tell_is_no_next_step(tmp_path) -> None:
    """The half-width beside its target, and that the budget is spent, stand there once."""
    text = specification(numeric(2)).replace("half_width = 5.0\nmax_runs = 400", "half_width = 0.1\nmax_runs = 24")
    found = campaign(tmp_path / "c", text, POINTS, POINTS.sum(axis=1) + NOISE)
    (analysis,) = found.analyse_all(n_draws=400)
    assert analysis.verdict == "Budget spent"
    (steps,) = summary_section(found.spec, [analysis], None, ()).sections[0].blocks
    assert not any(" at the optimum is \u00b1" in step or "was spent" in step for step in steps.items)
    assert any("below the noise floor" in step for step in steps.items)


def test_no_factor_is_most_important_where_none_is_significant(tmp_path) -> None:
    """By the test of all terms; one of two factors may pass its own by chance."""
    scores = np.random.default_rng(35).normal(size=24)
    found = campaign(tmp_path / "c", specification(numeric(2)), POINTS, scores)
    (analysis,) = found.analyse_all(n_draws=400)
    assert min(row.p for row in analysis.importance) < 0.05
    told = str(summary_section(found.spec, [analysis], None, ()))
    assert told.count("No factor has a significant effect") == 1
    assert "none significant" in told


@pytest.mark.parametrize(("top", "unit", "rest", "told"), [
    (97.0, "percent", "", True), (97.0, "%", "", True), (60.0, "percent", "", False), (97.0, "dB", "", False),
    (97.0, "percent", "[model]\nresponse = 'logit'\n", False), (120.0, "percent", "", False),
])  # fmt: skip
def test_measured_percentages_whose_intervals_pass_100_are_told_how_to_end_there(tmp_path, top, unit, rest, told):
    """A measured score has no ends of its own: a percentage may be a change. Where a score lies beyond, it has none."""
    scores = np.minimum(bowl(POINTS) - 80.0 + top + 3.0 * NOISE, 99.5 if top < 100.0 else np.inf)
    text = specification(numeric(2), application=f'unit = "{unit}"\n', rest=rest)
    found = analysed(tmp_path / "c", text, POINTS, scores)
    assert (found.optimum.prediction.high > 100.0) == (top > 90.0 and not rest)
    assert any("reach beyond 0 to 100 percent" in note for note in found.notes) == told


def test_the_rule_asks_for_more_runs_where_the_surface_is_likely_no_quadratic(narrow: Analysis) -> None:
    for probability, terms in ((0.49, 0), (0.51, narrow.fitted.surface.n_terms)):
        fitted = replace(narrow.fitted, departure=replace(narrow.fitted.departure, by_scores=probability))
        assert as_found(StopRule(), fitted, narrow.optimum.point).acting_terms == terms


def test_an_expected_loss_is_that_of_the_look_with_and_without_a_limit(tmp_path: Path) -> None:
    """Other draws of the posterior had the report say "continue" of what `run` had stopped."""
    text = specification(numeric(2)).replace("[stop]", "[stop]\nloss = LIMIT")
    scores = bowl(POINTS) + NOISE
    unlimited = campaign(tmp_path / "free", text.replace("loss = LIMIT\n", ""), POINTS, scores)
    (free,), (told,) = unlimited.analyse_all(n_draws=1000), unlimited.analyse_all(n_draws=300, sampler="emcee")
    assert "loss" not in {check.name for check in free.decision.checks}
    loss = free.posterior.expected_regret
    assert told.posterior.expected_regret == loss  # the report's table of looks says the same as its summary
    for limit in (0.999 * loss, 1.001 * loss):
        limited = campaign(tmp_path / f"{limit}", text.replace("LIMIT", repr(limit)), POINTS, scores)
        looks = [limited.analyse_all(n_draws=n, sampler=how)[0] for n, how in ((1000, "exact"), (300, "emcee"))]
        for one in looks:
            (check,) = [check for check in one.decision.checks if check.name == "loss"]
            assert (check.holds, one.posterior.expected_regret) == (loss <= limit, loss)
    step = next(_next_steps(limited.spec, looks[0]))
    assert f"(target: at most {format_plain(limit)}" in step


@pytest.mark.parametrize(
    ("errors", "prior"),
    [
        ('errors = "student_t"', ""),
        ('errors = "student_t"', "[application.prior]\nutility = [10.0, 90.0]\nrepeat_sd = 2.0\n"),
        ('errors = "beta_binomial"\nresponse = "logit"', ""),
    ],
)
def test_intervals_by_draws_are_those_of_the_look(tmp_path: Path, errors: str, prior: str) -> None:
    """`fit` and the report told other ends, and another half-width of the stop rule, than `status` and `run`."""
    text = specification(numeric(2), rest=f"{prior}[model]\n{errors}\n").replace('"measured"', '"percent_correct"')
    made = campaign(tmp_path / "c", text, POINTS[:0], ())
    right = np.round(30.0 - 3.0 * np.sum(np.square(POINTS), axis=1) + NOISE).astype(int)
    made.ingest(pd.DataFrame({"x0": POINTS[:, 0], "x1": POINTS[:, 1], "n": 40, "correct": right}))
    (look,) = made.analyse_all(n_draws=1000)
    for n_draws, sampler in ((300, "exact"), (1000, "emcee")):
        (told,) = made.analyse_all(n_draws=n_draws, sampler=sampler)
        for name in ("mean", "confidence", "prediction", "prediction_mean", "whole"):
            assert getattr(told.optimum, name) == getattr(look.optimum, name)
        assert told.decision.half_width == look.decision.half_width


def test_what_the_settings_lose_is_that_of_each_draw_on_a_grid(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Told is the mean loss, and how probable more than a quarter of the target is: 1.25 of 5. By the quadratic."""
    monkeypatch.setattr("seqrsm.analysis.belief.LEAST_RUNS", 8)
    x = np.array([-1.0, -0.6, -0.2, 0.0, 0.2, 0.6, 1.0])
    scores = 60.0 - 8.0 * (x - 0.2) ** 2 + np.array([1.7, 4.1, 1.6, -2.7, -6.5, 4.5, 2.2])
    made = campaign(tmp_path / "c", specification(numeric(1)), x[:, None], scores)
    found = made.analyse_all(n_draws=4000)[0]
    grid = np.append(np.linspace(-1.0, 1.0, 2001), found.optimum.point)
    values = found.posterior.term_draws @ np.stack([grid**0, grid, grid**2])
    loss = values.max(axis=1) - values[:, -1]
    assert found.posterior.expected_regret == pytest.approx(loss.mean(), rel=0.05)
    assert found.posterior.p_regret_above == pytest.approx(np.mean(loss > 1.25), abs=0.02)
    assert np.mean(loss > 1.25) - np.mean(loss > 2.5) > 0.05


def test_runs_that_can_be_fitted_are_those_of_the_application_that_has_fewest(tmp_path) -> None:
    other = '[[application]]\nname = "other"\nutility = "measured"\n'
    points = np.linspace(-1.0, 1.0, 12)[:, None]
    made = campaign(tmp_path / "c", specification(numeric(1), rest=other), points, points[:, 0])
    one = campaign(tmp_path / "d", specification(numeric(1)), points, points[:, 0])
    assert [n_fitted(each.spec, each.store.runs()) for each in (made, one)] == [0, 12]


def test_runs_are_proposed_where_factors_differ_by_less_than_rounding(tmp_path) -> None:
    """The fit asked for runs that `propose` would name, and `propose` ended with the fit's error."""
    rng = np.random.default_rng(0)
    x = rng.uniform(-1.0, 1.0, 14)
    points = np.column_stack([x, x + 1e-5 * rng.normal(size=14)])
    made = campaign(tmp_path / "c", specification(numeric(2)), points, x, source="flight")
    with pytest.raises(FitError, match="cannot separate"):
        made.analyse_all()
    more = made.propose(3, source="flight")
    made.ingest(pd.DataFrame([{"run_id": run.run_id, **run.proposed, "score": 0.1 * run.run_id} for run in more]))
    assert len(made.analyse_all()) == 1


def test_student_errors_are_offered_for_wild_flights_alone(tmp_path):
    """Two in one direction hide each other from the test of single outliers."""
    points = np.round(spread(40, 2), 3)
    scores = bowl(points) + norm.ppf((np.random.default_rng(9).permutation(40) + 0.5) / 40)

    def offered(name: str, y: np.ndarray, source: str, rest: str = "") -> list[str]:
        found = analysed(tmp_path / name, specification(numeric(2), rest=rest), points, y, source=source)
        return [text for text in found.warnings if "student_t" in text]

    assert offered("tame", scores, "flight") == []
    wild = scores.copy()
    wild[[3, 20]] -= 15.0
    (told,) = offered("wild", wild, "flight")
    assert "Student-t errors are more than 1000 times as probable" in told
    assert "Void the runs in which something went wrong" in told
    slight = scores.copy()
    slight[3] -= 4.0
    (told,) = offered("slight", slight, "flight")
    assert 7 <= int(re.search(r"errors are (\d+) times", told).group(1)) <= 1000
    assert offered("simulated", wild, "simulation") == []
    assert offered("heeded", wild, "flight", '[model]\nerrors = "student_t"\n') == []
    # A narrow top is far off a quadratic, and no fault of a run.
    assert offered("narrow", 3.0 * hill(points) + scores, "flight") == []


def test_student_errors_are_weighed_where_all_is_measured_and_no_other_surface_explains_more() -> None:
    Z, y, weights = np.ones((20, 1)), norm.ppf((np.arange(20) + 0.5) / 20), np.ones(20)
    y[4] = 8.0
    likelier = student_evidence(Z, y, weights)
    assert likelier > 3.0

    def gain(sources: list[str], of_process: float = 0.0, exact: bool = True) -> float:
        return _gain_of_student(
            SimpleNamespace(
                fit=SimpleNamespace(Z=Z, y=y, weights=weights),
                surface=SimpleNamespace(errors=SimpleNamespace(exact=exact)),
                data=SimpleNamespace(sources=sources),
                departure=SimpleNamespace(log_bayes_factor=of_process),
            )
        )

    assert gain(["flight"] * 20) == gain(["flight"] * 20, likelier - 0.1) == likelier
    assert gain(["flight"] * 20, likelier + 0.1) == 0.0
    assert gain(["simulation"] * 20) == gain(["flight"] * 19 + ["simulation"]) == 0.0
    assert gain(["flight"] * 20, exact=False) == 0.0
