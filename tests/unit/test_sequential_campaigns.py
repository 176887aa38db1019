"""Whole campaigns on known surfaces, without an engine: what the loop does at the extremes."""

from __future__ import annotations

import dataclasses
import shutil
from collections.abc import Callable
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

from seqrsm.analysis.compromise import campaign_compromise
from seqrsm.analysis.fitted import confirmation_reason
from seqrsm.campaign import experiment, loop, simulation, simulator_checks
from seqrsm.campaign.campaign import Campaign
from seqrsm.campaign.grounds import Grounds
from seqrsm.campaign.loop import run_campaign
from seqrsm.campaign.next_runs import next_batch
from seqrsm.errors import RegionError, SpecError, StoreError, UserError
from seqrsm.simulate import runner
from seqrsm.spec.read import load_spec
from seqrsm.spec.tables import SimulatorSpec
from seqrsm.store.records import CONFIRMATION, IngestedFile, IngestedRun, NewRun, NewScore

pytestmark = pytest.mark.usefixtures("few_draws")

HEAD = '[campaign]\nname = "test"\nseed = 3\nbatch = {batch}\n{more}\n'


def applications(*names: str) -> str:
    return "".join(f'[[application]]\nname = "{name}"\nutility = "measured"\n' for name in names)


APPLICATION = applications("score")


def spec_text(factors: str, stop: str, *, batch: int = 4, more: str = "", rest: str = "") -> str:
    return HEAD.format(batch=batch, more=more) + factors + APPLICATION + rest + f"[stop]\n{stop}\n"


def numeric(k: int) -> str:
    return "".join(f'[[factor]]\nname = "x{i}"\nlow = -1.0\nhigh = 1.0\n' for i in range(k))


Score = Callable[[dict, int], float | dict[str, float]]


@pytest.fixture
def campaign(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    """A campaign whose runs are scored by a function of settings and run id; raising an error fails the run.

    The function returns one score, or one for each application by its name.
    """

    def make(text: str, score: Score, folder: str = "c") -> Campaign:
        def carry(_function, tasks, *_rest):
            for index, task in enumerate(tasks):
                try:
                    value, failure = score(task.settings, task.run_id), ""
                except ValueError as error:
                    value, failure = 0.0, str(error)
                named = value if isinstance(value, dict) else {"score": value}
                scores = () if failure else tuple(NewScore(name, float(one)) for name, one in named.items())
                yield (
                    index,
                    SimpleNamespace(run_id=task.run_id, scores=scores, failure=failure, fault="settings", check=None),
                )

        monkeypatch.setattr(runner, "run_many", carry)
        monkeypatch.setattr(loop, "check_simulator", lambda spec: None)
        monkeypatch.setattr(simulator_checks, "see_parameters", lambda spec: None)
        monkeypatch.setattr(
            simulation, "task_of", lambda spec, run_id, settings, *_: SimpleNamespace(run_id=run_id, settings=settings)
        )
        # These scores know nothing of files and grounds.
        monkeypatch.setattr(experiment, "experiment_of", lambda spec: {"seqrsm": "stub"})
        monkeypatch.setattr(Grounds, "measure", lambda *_: None)
        monkeypatch.setattr(Grounds, "rank", lambda *_: None)
        monkeypatch.setattr(loop, "rests_on", lambda *_: {})
        place = tmp_path / folder
        place.mkdir()
        (place / "campaign.toml").write_text(text, encoding="utf-8")
        return Campaign.open(place)

    return make


def noise(run_id: int) -> float:
    return float(np.random.default_rng([7, run_id]).normal())


def bowl(settings: dict, run_id: int) -> float:
    return 80.0 - 10.0 * sum((float(v) - 0.2) ** 2 for v in settings.values()) + noise(run_id)


def test_one_factor(campaign) -> None:
    made = campaign(spec_text(numeric(1), 'half_width = 2.0\ninterval = "prediction_mean"\nmax_runs = 40'), bowl)
    outcome = run_campaign(made)
    assert outcome.held
    assert outcome.analyses[0].optimum.settings["x0"] == pytest.approx(0.2, abs=0.25)


def test_eight_factors(campaign) -> None:
    made = campaign(spec_text(numeric(8), "half_width = 5.0\nmax_runs = 80", batch=8), bowl)
    points = np.random.default_rng(1).uniform(-1, 1, (70, 8))
    runs = [
        IngestedRun(None, settings, "simulation", "", 1.0, (NewScore("score", bowl(settings, i)),))
        for i, settings in enumerate(made.spec.region.decode(points))
    ]
    made.store.ingest_files([IngestedFile("f.csv", "0", len(runs), tuple(runs))])
    (analysis,) = made.analyse_all(n_draws=200)
    assert analysis.fit.n_terms == 45
    asked = "70 runs for 45 terms; 65 are required (20 degrees of freedom)."
    assert asked in [check.text for check in analysis.decision.checks]
    assert len(made.decide(8, analyses=[analysis])) == 8


def test_batch_larger_than_the_distinct_settings_repeats_them(campaign) -> None:
    factors = '[[factor]]\nname = "a"\nvalues = [1, 2, 3]\n[[factor]]\nname = "b"\nlevels = ["u", "v"]\n'
    made = campaign(
        spec_text(factors, "half_width = 0.9\nmax_runs = 60", batch=20),
        lambda s, i: (50.0 - (s["a"] - 2.0) ** 2 + (3.0 if s["b"] == "v" else 0.0)) + 0.1 * noise(i),
    )
    outcome = run_campaign(made)
    assert outcome.held
    assert outcome.analyses[0].optimum.settings == {"a": 2.0, "b": "v"}
    runs = made.store.runs()
    assert max(run.batch for run in runs) >= 2
    assert len({tuple(run.proposed.items()) for run in runs}) <= 6


def test_sliver_and_nothing(campaign) -> None:
    sliver = '[[constraint]]\nexpr = "abs(x0 + x1) <= 0.02"\n'
    made = campaign(spec_text(numeric(2), "half_width = 3.0", rest=sliver + "[model]\norder = 1\n"), bowl)
    made.propose(source="simulation")
    made.simulate()
    made.propose(2, source="simulation")
    assert len(made.store.runs()) == 11
    assert all(abs(run.proposed["x0"] + run.proposed["x1"]) <= 0.0201 for run in made.store.runs())
    nothing = "".join(f'[[constraint]]\nexpr = "{expr}"\n' for expr in ("x0 >= 0.5", "x1 <= 0.9", "x0 + x1 <= -0.8"))
    with pytest.raises((SpecError, RegionError), match="no setting") as caught:
        campaign(spec_text(numeric(2), "half_width = 3.0", rest=nothing), bowl, "d")
    told = [expr in str(caught.value) for expr in ("x0 >= 0.5", "x1 <= 0.9", "x0 + x1 <= -0.8")]
    assert told == [True, False, True]  # those in conflict


def test_equal_scores_everywhere(campaign) -> None:
    made = campaign(spec_text(numeric(2), "half_width = 1.0\nmax_runs = 30"), lambda s, i: 7.0)
    outcome = run_campaign(made)
    (analysis,) = outcome.analyses
    assert analysis.optimum.mean == pytest.approx(7.0)
    assert any("equal" in warning for warning in analysis.warnings)


def wild(settings: dict, run_id: int) -> float:
    return bowl(settings, run_id) + (400.0 if run_id == 5 else 0.0)


def test_student_errors_recover_from_one_wild_outlier(campaign) -> None:
    text = spec_text(numeric(2), "half_width = 2.0\nmax_runs = 24", rest="[model]\n{0}")
    found = {}
    for errors in ("normal", "student_t"):
        # the scores of one campaign with normal errors, fitted both ways
        made = campaign(text.format(f'errors = "{errors}"\n'), bowl, errors)
        runs = [
            IngestedRun(None, settings, "flight", "", 1.0, (NewScore("score", wild(settings, i + 1)),))
            for i, settings in enumerate(
                {"x0": float(x), "x1": float(y)} for x in (-1, -0.5, 0, 0.5, 1) for y in (-1, -0.5, 0, 0.5, 1)
            )
        ]
        made.store.ingest_files([IngestedFile("f.csv", "0", len(runs), tuple(runs))])
        (found[errors],) = made.analyse_all(n_draws=1000)
    robust, naive = found["student_t"], found["normal"]
    truth = np.array([0.2, 0.2])
    assert np.abs(robust.optimum.point - truth).max() < 0.25
    assert np.abs(naive.optimum.point - truth).max() > 0.5
    assert robust.optimum.prediction.half_width < 6.0 < naive.optimum.prediction.half_width
    assert robust.optimum.prediction.low < 80.0 < robust.optimum.prediction.high


def test_source_that_always_fails_ends_at_once(campaign) -> None:
    def broken(_settings: dict, _run_id: int) -> float:
        raise ValueError("no licence for the engine")

    made = campaign(spec_text(numeric(2), "half_width = 1.0\nmax_runs = 30"), broken)
    with pytest.raises(UserError, match="no licence"):
        run_campaign(made)
    assert len(made.store.runs()) == 12  # the start design, once


def test_source_that_breaks_later_is_given_up_after_a_few_batches(campaign) -> None:
    def breaks(settings: dict, run_id: int) -> float:
        if run_id > 15:
            raise ValueError("disk full")
        return bowl(settings, run_id)

    made = campaign(spec_text(numeric(2), "half_width = 0.1\nmax_runs = 60"), breaks)
    with pytest.raises(UserError, match="disk full"):
        run_campaign(made)
    assert sum(run.state == "failed" for run in made.store.runs()) == 1 + 3 * 4  # one of the batch before them


def test_settings_that_fail_are_left_alone_and_the_campaign_ends(campaign) -> None:
    """A quarter of the region cannot be carried out: it is not proposed for ever."""

    def corner(settings: dict, run_id: int) -> float:
        if settings["x0"] > 0.5 and settings["x1"] > 0.5:
            raise ValueError("no signal")
        return bowl(settings, run_id)

    made = campaign(spec_text(numeric(2), "half_width = 2.5\nmax_runs = 40"), corner)
    outcome = run_campaign(made)
    failed = np.array([[run.proposed["x0"], run.proposed["x1"]] for run in made.store.runs("failed")])
    assert outcome.n_scored >= 18
    assert len(failed) <= 20
    later = [run for run in made.store.runs("failed") if run.batch > 1]
    for i, run in enumerate(later):
        here = np.array([run.proposed["x0"], run.proposed["x1"]])
        before = [r for r in made.store.runs("failed") if r.batch < run.batch]
        gap = [np.abs(here - [r.proposed["x0"], r.proposed["x1"]]).max() for r in before]
        assert not gap or min(gap) > 0.09, i


@pytest.mark.parametrize("guard", ["runs", "confirmation"])
def test_guards_by_name(campaign, guard: str) -> None:
    rule = f'half_width = 2.0\ninterval = "prediction_mean"\nguard = "{guard}"\nmax_runs = 80'
    outcome = run_campaign(campaign(spec_text(numeric(2), rule), bowl))
    assert outcome.held
    (analysis,) = outcome.analyses
    asked = {"runs": ["runs"], "confirmation": ["confirmation"]}.get(guard, [])
    assert [check.name for check in analysis.decision.checks] == ["interval", *asked]


def test_futility_is_told(campaign) -> None:
    """A surface of noise alone, and a target that the budget cannot reach."""
    cases = {
        "no parameter matters": (lambda s, i: 50.0 + noise(i), "half_width = 1.5\nmax_runs = 20"),
        "the target": (lambda s, i: bowl(s, i) + 9.0 * noise(i + 7), "half_width = 4.0\nmax_runs = 20"),
    }
    for name, (score, rule) in cases.items():
        made = campaign(spec_text(numeric(2), rule), score, name)
        run_campaign(made)
        assert any(look.summary["futility"] for look in made.store.looks())


def two_humps(settings: dict, run_id: int) -> float:
    x = np.array([settings["x0"], settings["x1"]])
    high, low = np.sum((x - [0.5, 0.2]) ** 2), np.sum((x - [-0.5, -0.2]) ** 2)
    return 45 + 35 * np.exp(-high / 0.32) + 27 * np.exp(-low / 0.32) + noise(run_id)


def test_interrupted_campaign_ends_like_one_that_was_not(campaign) -> None:
    text = spec_text(numeric(2), 'half_width = 1.5\ninterval = "confidence"\nmax_runs = 28')
    whole = campaign(text, two_humps)
    run_campaign(whole)
    broken = campaign(text, two_humps, "broken")
    for budget in (16, 22):
        run_campaign(broken, max_runs=budget)
        broken = Campaign.open(broken.folder)
    run_campaign(broken)

    def settings(made: Campaign) -> list:
        return [run.proposed for run in made.store.runs() if run.purpose != "confirmation"]

    assert settings(broken)[:20] == settings(whole)[:20]


TWO = """
[campaign]
name = "two"
[[factor]]
name = "resolution"
low = 5.0
high = 50.0
scale = "log"
[[factor]]
name = "angle"
low = 20.0
high = 60.0
[[application]]
name = "crops"
utility = "percent_correct"
weight = 2.0
unacceptable = 40.0
[[application]]
name = "moisture"
utility = "measured"
goal = "minimize"
[[consideration]]
name = "cost"
expr = "100 / resolution"
[stop]
half_width = 4.0
"""


def test_two_applications_and_a_cost(campaign) -> None:
    made = campaign(TWO, bowl)
    rng = np.random.default_rng(1)
    points = rng.uniform(-1, 1, (40, 2))
    runs = []
    for settings, (x, y) in zip(made.spec.region.decode(points), points, strict=True):
        crops = 75 - 10 * (x + 0.6) ** 2 - 8 * (y - 0.2) ** 2 + rng.normal()
        moisture = 4 + 2 * (x - 0.5) ** 2 + (y + 0.4) ** 2 + 0.2 * rng.normal()
        scores = (NewScore("crops", crops), NewScore("moisture", moisture))
        runs.append(IngestedRun(None, settings, "flight", "", 1.0, scores))
    made.store.ingest_files([IngestedFile("f.csv", "0", len(runs), tuple(runs))])
    analyses = made.analyse_all(n_draws=300)
    found = campaign_compromise(made.spec, analyses)
    crops, moisture, cost = found.given_up
    assert analyses[0].optimum.settings["resolution"] < found.settings["resolution"]
    assert crops.given_up > 0.0
    assert moisture.given_up > 0.0
    assert moisture.interval.low <= moisture.given_up <= moisture.interval.high
    assert cost.value == pytest.approx(100 / found.settings["resolution"])
    assert cost.own_settings["resolution"] == pytest.approx(50.0)
    assert found.to_json()["pareto_front"]
    assert campaign_compromise(made.spec, analyses[:1]) is None


def test_fresh_runs_that_one_application_wants_do_not_wait_for_the_other(campaign) -> None:
    def score(settings: dict, run_id: int) -> dict[str, float]:
        return {"sharp": bowl(settings, run_id), "noisy": bowl(settings, run_id) + 30.0 * noise(1000 + run_id)}

    rule = 'half_width = 3.5\nmax_runs = 18\nguard = "confirmation"\nconfirmation_runs = 3\ninterval = "confidence"'
    made = campaign(spec_text(numeric(2), rule).replace(APPLICATION, applications("sharp", "noisy")), score)
    outcome = run_campaign(made)
    sharp, noisy = outcome.analyses
    assert not outcome.held
    assert not noisy.decision.held
    assert sharp.confirmation is not None
    assert sharp.decision.held
    assert "at the recommended settings averaged" in sharp.confirmation.text
    # Settings recommended by another model are not those that were confirmed.
    toml = made.folder / "campaign.toml"
    toml.write_text(toml.read_text("utf-8") + "\n[model]\norder = 1\n", "utf-8")
    moved = Campaign.open(made.folder).analyse_all("sharp")[0].confirmation
    assert moved is not None
    assert "at x0 " in moved.text
    assert "recommended before, averaged" in moved.text


def test_each_application_without_a_confirmation_gets_one_of_its_own(campaign) -> None:
    """Fresh runs at the optimum of one of two fail: a second call makes them anew, and those of the other no more."""
    failing = True

    def score(settings: dict, run_id: int) -> dict[str, float]:
        if failing and made.store.runs()[run_id - 1].why == confirmation_reason("low"):
            raise ValueError("a cloud")
        rest = {"x1": settings["x1"]}
        return {name: bowl(rest | {"x0": settings["x0"] - at}, run_id) for name, at in (("low", -0.6), ("high", 0.4))}

    def confirmed(name: str) -> list[float]:
        why = (CONFIRMATION, confirmation_reason(name))
        return [run.settings["x0"] for run in made.store.runs("scored") if (run.purpose, run.why) == why]

    text = spec_text(numeric(2), "half_width = 4.0\nmax_runs = 40\nconfirmation_runs = 3")
    made = campaign(text.replace(APPLICATION, applications("low", "high")), score)
    made.spec = dataclasses.replace(made.spec, simulator=SimulatorSpec(engine="psm", scene="scene.npz"))
    low, high = run_campaign(made).analyses
    assert low.confirmation is None
    assert confirmed("high") == pytest.approx([high.optimum.settings["x0"]] * 3, abs=1e-3)
    failing = False
    low, high = run_campaign(made).analyses
    assert [len(analysis.confirmation.run_ids) for analysis in (low, high)] == [3, 3]
    assert low.optimum.settings["x0"] < -0.2 < 0.4 < high.optimum.settings["x0"]
    assert confirmed("low") == pytest.approx([low.optimum.settings["x0"]] * 3, abs=1e-3)
    assert len(confirmed("high")) == 3


def test_fresh_runs_that_contradict_enter_the_fit_and_the_campaign_goes_on(campaign) -> None:
    """The first set lies 40 below the surface: it is no end, and evidence from the next runs on; the second agrees."""

    def score(settings: dict, run_id: int) -> float:
        run = made.store.runs()[run_id - 1]
        first = min((one.batch for one in made.store.runs() if one.purpose == CONFIRMATION), default=0)
        return bowl(settings, run_id) - 40.0 * (run.purpose == CONFIRMATION and run.batch == first)

    made = campaign(spec_text(numeric(1), "half_width = 60.0\nmax_runs = 26\nconfirmation_runs = 3"), score)
    made.spec = dataclasses.replace(made.spec, simulator=SimulatorSpec(engine="psm", scene="scene.npz"))
    said: list[str] = []
    outcome = run_campaign(made, say=said.append)
    assert outcome.held
    assert "the confirmation runs contradict the model; continuing" in said
    runs = made.store.runs("scored")
    first, second = sorted({run.batch for run in runs if run.purpose == CONFIRMATION})
    (analysis,) = outcome.analyses
    fitted = set(analysis.data.run_ids.tolist())
    assert {run.run_id for run in runs if run.batch == first} <= fitted
    assert fitted == {run.run_id for run in runs if run.batch != second}
    assert analysis.confirmation is not None
    assert analysis.confirmation.agrees
    assert set(analysis.confirmation.run_ids) == {run.run_id for run in runs if run.batch == second}
    assert any(first < run.batch < second for run in runs)


def test_a_batch_is_cut_at_the_budget_which_a_later_call_may_lower(campaign) -> None:
    made = campaign(spec_text(numeric(1), "half_width = 0.01\nmax_runs = 10"), bowl)
    outcome = run_campaign(made)
    assert not outcome.held
    assert outcome.n_scored == 10  # nine of the start design, and one of a batch of four
    assert run_campaign(made, max_runs=2).n_scored == 10
    assert run_campaign(made, max_runs=11, batch=3).n_scored == 11


def test_as_many_scores_as_terms_wait_for_the_flights(campaign) -> None:
    made = campaign(spec_text(numeric(1), "half_width = 2.0\nmax_runs = 20"), bowl)
    runs = [
        IngestedRun(None, {"x0": x}, "flight", "", 1.0, (NewScore("score", bowl({"x0": x}, i)),))
        for i, x in enumerate((-1.0, 0.0, 1.0))
    ]
    made.store.ingest_files([IngestedFile("f.csv", "0", 3, tuple(runs))])
    made.store.add_batch([NewRun({"x0": 0.5}, source="flight")])
    with pytest.raises(StoreError, match="3 scores cannot determine 3 terms, and 1 flights have no scores"):
        run_campaign(made)


def test_a_contradiction_ends_with_the_budget(campaign) -> None:
    def score(settings: dict, run_id: int) -> float:
        return bowl(settings, run_id) - 40.0 * (made.store.runs()[run_id - 1].purpose == CONFIRMATION)

    made = campaign(spec_text(numeric(1), "half_width = 60.0\nmax_runs = 13\nconfirmation_runs = 3"), score)
    made.spec = dataclasses.replace(made.spec, simulator=SimulatorSpec(engine="psm", scene="scene.npz"))
    outcome = run_campaign(made)
    assert len([run for run in made.store.runs("scored") if run.purpose != CONFIRMATION]) == 13
    assert outcome.held  # the rule does, and there is no run left to go on with
    assert outcome.analyses[0].contradicted


def test_simulation_and_flight_share_a_surface(campaign) -> None:
    text = spec_text(numeric(2), "half_width = 3.0\nmax_runs = 80", rest="[cost]\nflight = 20.0\n")
    made = campaign(text, bowl)
    run_campaign(made, max_runs=18)
    before = made.analyse_all()[0]
    assert before.sources is None
    rng = np.random.default_rng(5)
    flights = [
        IngestedRun(None, s, "flight", "", 20.0, (NewScore("score", bowl(s, 100 + i) + 4.0 + 2 * s["x0"]),))
        for i, s in enumerate(made.spec.region.decode(rng.uniform(-1, 1, (12, 2))))
    ]
    made.store.ingest_files([IngestedFile("a.csv", "1", 2, tuple(flights[:2]))])
    few = made.analyse_all()[0]
    assert few.sources.both.prior_driven
    assert any("prior" in warning for warning in few.warnings)
    made.store.ingest_files([IngestedFile("b.csv", "2", 10, tuple(flights[2:]))])
    many = made.analyse_all()[0]
    assert many.sources.both.n_flights == 12
    assert many.sources.interval.low < 4.4 < many.sources.interval.high
    assert many.sources.both.prior_share < few.sources.both.prior_share
    assert many.optimum.mean == pytest.approx(84.5, abs=2.0)
    for cost, source in ((10.0, "flight"), (60.0, "simulation")):  # by what a run gains for its cost
        spec = dataclasses.replace(made.spec, cost=made.spec.cost.model_copy(update={"flight": cost}))
        (run,) = next_batch(spec, [many], made.store.runs(), 1, "best")
        assert run.source == source


@pytest.mark.parametrize(
    ("old", "new", "said"),
    [
        ('expr = "100 / resolution"', 'expr = "100 / band"', "band"),
        ('expr = "100 / resolution"', 'expr = "100 /"', "consideration"),
        ("unacceptable = 40.0", "unacceptable = 40.0\nideal = 30.0", "ideal is not better"),
        ('name = "two"', 'name = "two"\ncriterion = "steepest"', "'criterion' is not a known key"),
        ('name = "two"', 'name = "two"\nattempts = 3', "'attempts' is not a known key"),
        ("half_width = 4.0", 'half_width = 4.0\nguard = "luck"', "guard"),
        ("[stop]", '[model]\nregion = "fixed"\n[stop]', "'region' is not a known key"),
        ("[stop]", '[model]\nterms = "hierarchical"\n[stop]', "'terms' is not a known key"),
        ("[stop]", "[model]\ndiscrepancy_sd = -1.0\n[stop]", "discrepancy_sd"),
    ],
)
def test_faults_of_the_new_keys(tmp_path: Path, old: str, new: str, said: str) -> None:
    (tmp_path / "campaign.toml").write_text(TWO.replace(old, new, 1), encoding="utf-8")
    with pytest.raises(SpecError) as caught:
        load_spec(tmp_path)
    assert said in str(caught.value)
    assert all(problem.line for problem in caught.value.problems)


TEMPLATES = Path(__file__).parents[2] / "campaigns"


def test_the_template_of_two_applications_keeps_its_platform_limits() -> None:
    """Tables A.21 and A.23: an antenna of 2 m at most, 10 kbit/s of telemetry."""
    spec = load_spec(TEMPLATES / "crops-and-moisture")
    assert [application.name for application in spec.applications] == ["crops", "moisture"]
    for settings in spec.region.decode(spec.region.sample(300, np.random.default_rng(0))):
        wavelength_m = 299_792_458.0 / (settings["frequency"] * 1e9)
        assert 1.2 * wavelength_m * 1500.0 / settings["resolution"] <= 2.0 * (1.0 + 1e-5)
        assert 8.0 * 3000.0 * 80.0 / settings["resolution"] ** 2 <= 10_000.0 * (1.0 + 1e-5)


@pytest.mark.parametrize("template", sorted(path.parent.name for path in TEMPLATES.glob("*/campaign.toml")))
def test_one_run_of_each_template_is_scored(template, tmp_path) -> None:
    """Carried out at the centre of its region, or its scores taken in."""
    folder = Path(shutil.copytree(TEMPLATES / template, tmp_path / "c", ignore=shutil.ignore_patterns("*.db*")))
    made = Campaign.open(folder)
    scores = sorted(folder.glob("*_scores.csv"))
    if scores:
        made.ingest(scores[0])
    else:
        region = made.spec.region
        settings = region.decode(region.centre()[None, :])[0]
        made.store.add_batch([NewRun(settings, "start", "one run", "simulation", 1.0)])
        made.simulate()
    runs = made.store.runs()
    assert runs[0].state == "scored"
    names = {score.application for score in runs[0].scores}
    assert names == {application.name for application in made.spec.applications}


def test_flights_of_the_start_design_are_not_flown_in_the_order_of_the_search(campaign) -> None:
    """The same runs as for a simulator, whose first three are repeats at the centre, in other places."""
    orders = []
    for source in ("simulation", "flight"):
        made = campaign(spec_text(numeric(2), "half_width = 2.0\nmax_runs = 30"), bowl, source)
        orders.append([tuple(run.proposed.values()) for run in made.propose(source=source)])
    assert orders[0][:3] == [(0.0, 0.0)] * 3
    assert sorted(orders[0]) == sorted(orders[1])
    assert orders[0] != orders[1]


ALL_KINDS = """
[[factor]]
name = "frequency"
low = 1.3
high = 17.7
scale = "log"
[[factor]]
name = "angle"
low = 20.0
high = 70.0
[[factor]]
name = "looks"
values = [1, 2, 4, 8]
scale = "log"
[[factor]]
name = "polarization"
levels = ["HH", "VV"]
"""


def flown_otherwise(made: Campaign, unasked: int) -> list[IngestedRun]:
    """Flights of the start design at other settings than those that were asked for, and some that nobody asked for."""

    def flown(run_id: int | None, asked: dict) -> IngestedRun:
        frequency = float(f"{0.93 * asked['frequency'] + 0.2:.4g}")
        angle = float(f"{0.9 * asked['angle'] + 3.0:.4g}")
        score = 60.0 - 0.2 * (frequency - 6.0) ** 2 - 0.01 * (angle - 45.0) ** 2 + noise(round(1000 * frequency))
        settings = asked | {"frequency": frequency, "angle": angle}
        return IngestedRun(run_id, settings, "flight", "", 1.0, (NewScore("score", score),))

    runs = [flown(run.run_id, run.proposed) for run in made.propose(source="flight")]
    settings = made.spec.region.decode(made.spec.region.sample(unasked, np.random.default_rng(2)))
    runs += [flown(None, one) for one in settings]
    made.store.ingest_files([IngestedFile("f.csv", "0", len(runs), tuple(runs))])
    return runs


def test_a_proposed_repeat_has_the_settings_that_were_flown(campaign, monkeypatch) -> None:
    """To the last digit, and those of the flight, not those that it was asked for: else it is no repeat of it."""
    monkeypatch.setattr("seqrsm.analysis.belief.LEAST_RUNS", 1000)  # beside a process no run is kept for repeats
    text = spec_text(ALL_KINDS, "half_width = 1.0\nmax_runs = 90", rest="[model]\norder = 1\n")
    made = campaign(text, bowl)
    runs = flown_otherwise(made, 12)
    assert len(runs) == 23  # so that the first of the next runs is one kept for repeats
    executed = [run.settings for run in runs]
    batch = made.propose(5, source="flight")
    repeats = [run.proposed for run in batch if run.purpose == "repeat"]
    assert repeats
    assert any(settings in executed for settings in repeats)
    for run in batch:
        if run.proposed in repeats and run.proposed not in executed:  # of a run of the same batch, then
            assert sum(run.proposed == other.proposed for other in batch) > 1


def test_what_the_process_asks_for_again_has_the_settings_that_were_made(campaign) -> None:
    """An optimum in a corner that was run already: there the next runs tell most."""

    def slope(settings: dict, run_id: int) -> float:
        return 50.0 + 8.0 * np.log(settings["frequency"]) + 0.2 * settings["angle"] + 2.0 * noise(run_id)

    made = campaign(spec_text(ALL_KINDS, "half_width = 1.0\nmax_runs = 24"), slope)
    run_campaign(made)
    runs = made.store.runs()
    again = [run for run in runs if "repeats settings run or proposed before" in run.why]
    assert again
    for run in again:
        assert run.purpose in ("optimum", "regret")
        assert any(run.proposed == other.proposed for other in runs if other.run_id != run.run_id)


def test_equal_scores_promise_no_gain(campaign) -> None:
    """A share of an expected loss or of a width is of nothing: neither is known."""
    made = campaign(spec_text(numeric(2), "half_width = 1.0\nmax_runs = 90"), lambda *_: 50.0)
    made.propose(source="simulation")
    made.simulate()
    told = {run.why for run in made.propose(4, source="simulation")}
    assert told == {"all scores so far are equal, so no settings are known to be better than others"}


def test_sources_are_weighed_by_one_criterion(campaign) -> None:
    """The cheaper one where both tell the same: a process knows of one source only."""
    for flight, chosen in ((1000.0, "simulation"), (0.001, "flight")):
        costs = f"[cost]\nsimulation = 1.0\nflight = {flight}\n"
        made = campaign(spec_text(numeric(2), "half_width = 1.0\nmax_runs = 90", rest=costs), bowl, chosen)
        settings = made.spec.region.decode(made.spec.region.sample(24, np.random.default_rng(2)))
        runs = tuple(
            IngestedRun(None, one, "simulation", "", 1.0, (NewScore("score", 1e-3 * bowl(one, i)),))
            for i, one in enumerate(settings)
        )
        made.store.ingest_files([IngestedFile("f.csv", "0", 24, runs)])
        assert {run.source for run in made.propose(2, source="best")} == {chosen}
