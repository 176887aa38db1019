"""Every campaign command on a tiny campaign: results, JSON, exit codes, and what is left when it goes wrong."""

from __future__ import annotations

import json
import re
import shutil
import sqlite3
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from commands import ok, seqrsm
from tiny_campaign import TINY, make_tiny
from typer.testing import CliRunner

from seqrsm.analysis.ground import MEASURED, RANKED, ground_of_scores
from seqrsm.analysis.results import OptimumEstimate
from seqrsm.campaign import check, grounds
from seqrsm.campaign.campaign import Campaign
from seqrsm.campaign.check import _Scatter, _surfaces, combinations_of
from seqrsm.campaign.dossier import _reproduce as reproduce
from seqrsm.campaign.grounds import Grounds
from seqrsm.campaign.simulation import NO_RUN, bundle_tasks, carry_out, task_of
from seqrsm.cli.app import app
from seqrsm.plain import shallow
from seqrsm.simulate import runner
from seqrsm.simulate.runner import run_many
from seqrsm.spec.read import load_spec
from seqrsm.store.chain import event_hash
from seqrsm.store.records import NewRun

OF_TWO_PLACES = TINY.replace("seed = 5", "seed = 6")
"""Recommends other settings than those of its best run after the start."""


@pytest.fixture(scope="module")
def finished(tmp_path_factory, tiny_scene) -> tuple[Path, dict]:
    folder = make_tiny(tmp_path_factory.mktemp("run") / "tiny", tiny_scene, OF_TWO_PLACES)
    return folder, json.loads(ok("run", folder, "--json"))


@pytest.fixture
def copy(finished, tmp_path) -> Path:
    return Path(shutil.copytree(finished[0], tmp_path / "copy"))


def scores(folder: Path) -> list:
    out = folder.parent / f"{folder.name}.json"
    ok("export", folder, out)
    runs = json.loads(out.read_text(encoding="utf-8"))["runs"]
    return [(run["run_id"], run["proposed"], run["state"], [s["score"] for s in run["scores"]]) for run in runs]


def test_run_ends_by_its_rule_with_a_confirmation(finished) -> None:
    outcome = finished[1]
    assert outcome["held"]
    (analysis,) = outcome["applications"]
    assert analysis["stop"]["held"]
    assert analysis["optimum"]["prediction_mean"]["half_width"] <= 22.0
    assert len(analysis["confirmation"]["run_ids"]) == 3
    assert not set(analysis["confirmation"]["run_ids"]) & {run["run_id"] for run in analysis["diagnostics"]["runs"]}


def test_run_again_does_nothing_more(finished) -> None:
    folder, outcome = finished
    before = scores(folder)
    again = json.loads(ok("run", folder, "--json"))
    assert scores(folder) == before
    assert again["applications"][0]["optimum"] == outcome["applications"][0]["optimum"]


def test_what_a_flight_scatters_by_is_simulated_where_it_is_told(finished, monkeypatch) -> None:
    """Not at the best of the runs so far, nor over the region, where poor settings scatter more."""
    campaign = Campaign.open(finished[0])
    early, late = campaign.store.events(kind=MEASURED)
    first, last = early.detail, late.detail
    by_then = {event.run_id for event in campaign.store.events(kind="scored") if event.event < early.event}
    best = max((run for run in campaign.store.runs() if run.run_id in by_then), key=lambda run: run.scores[0].score)
    assert first["settings"] == best.settings
    (analysis,) = campaign.analyse_all()
    assert last["settings"] == analysis.optimum.settings != first["settings"]
    assert analysis.optimum.ground == ground_of_scores(last["scores"])
    assert [len(one["scores"]) for one in (first, last)] == [16, 16]
    cells = grounds.cells_of_ground(campaign.spec, campaign.store)
    bundle = bundle_tasks(campaign.spec, analysis.optimum.settings, cells)
    assert carry_out(bundle[0]).scores[0].score == pytest.approx(last["scores"][0][0])
    of_campaign = Grounds(campaign.spec, campaign.store)
    assert not of_campaign.measure_at([analysis])  # nothing is simulated twice
    elsewhere = replace(analysis, optimum=replace(analysis.optimum, settings=first["settings"] | {"resolution": 33.0}))
    monkeypatch.setattr(grounds, "scores_of", lambda tasks, *_: np.full(len(tasks), np.nan))
    assert not of_campaign.measure_at([elsewhere])  # nor again and again where nothing can be
    campaign.store.close()


def test_what_is_not_known_of_the_ground_is_told_everywhere(finished, copy) -> None:
    """Two parts of the half-width, what means rest on, and which are worth measuring: JSON, terminal and report."""
    (analysis,) = finished[1]["applications"]
    best, ground = analysis["optimum"], analysis["optimum"]["ground"]
    whole, chance = (best[name]["half_width"] for name in ("whole", "by_chance"))
    assert best["whole"] == {k: v for k, v in best["prediction_mean"].items() if k != "replicates"}
    assert whole**2 == pytest.approx(chance**2 + ground["half_width"] ** 2)
    assert (ground["n_worlds"], ground["n_simulations"]) == (16, 32)
    assert sum(finished[1]["rests_on"]["cover"].values()) == pytest.approx(1.0)
    text = " ".join(ok("run", copy).split())
    assert "Which covers to measure" in text
    assert "of table uncertainty" in text
    assert "Table values used at these settings, by scored area: " in text
    ok("report", copy, "--html", copy / "report.html")
    page = (copy / "report.html").read_text(encoding="utf-8").replace("\u00a0", " ")
    assert "Which covers to measure" in page
    assert "estimated from 32 simulations in 16 draws of the tables" in page


@pytest.mark.parametrize("before", ["other settings", "an earlier version"])
def test_covers_are_ranked_at_the_settings_that_are_recommended(copy, before: str) -> None:
    """Also where they were ranked at others before, or without what knowing them would leave."""
    campaign = Campaign.open(copy)
    (last,) = campaign.store.events(kind=RANKED)
    older = last.detail | {"settings": {}}
    if before == "an earlier version":
        older = {name: value for name, value in last.detail.items() if name != "known"}
    with sqlite3.connect(copy / "campaign.db") as base:
        base.execute("update events set detail = ? where kind = ?", (json.dumps(older), RANKED))
        base.commit()
        before = ""
        for event in campaign.store.events():  # else the change is told
            before = event_hash(before, {**shallow(event), "id": event.event})
            base.execute("update events set hash = ? where id = ?", (before, event.event))
    base.close()  # from Python 3.13 on sqlite3 warns of what is left open
    ok("run", copy)
    *_, again = campaign.store.events(kind=RANKED)
    assert again.detail == last.detail


def test_what_knowing_the_covers_that_move_the_score_would_leave(copy, monkeypatch) -> None:
    """Grass moves the score by 3, trees by 1, oats by a half; others hardly do and are left out after four worlds."""
    campaign, asked = Campaign.open(copy), []
    departs = np.random.default_rng(3).standard_normal((3, 2, 16))  # of grass, trees and oats, here and elsewhere
    grass, trees, oats = np.diff(departs, axis=1)[:, 0]
    moves = {"Grass": 3.0 * grass, "Trees": trees, "Oats": 0.5 * oats}
    hardly = np.full(16, 0.01)
    here = np.array(campaign.store.events(kind=MEASURED)[-1].detail["scores"])[:, 0]

    def scored(tasks, *_):
        asked.append([(task.world - 2**30, task.run_id - 2**30, task.elsewhere) for task in tasks])
        return np.array([here[world] + sum(moves.get(n, hardly)[world] for n in own) for world, _, own in asked[-1]])

    monkeypatch.setattr(grounds, "scores_of", scored)
    monkeypatch.setattr(Grounds, "_other_levels", lambda *_: [])
    covers = dict.fromkeys(("Water", "Oats", "Grass", "Asphalt", "Trees"), 2.0)
    monkeypatch.setattr(grounds, "mean_sds", lambda *_: (covers, "dB"))
    with sqlite3.connect(copy / "campaign.db") as base:
        base.execute("delete from events where kind = ?", (RANKED,))
    base.close()
    (analysis,) = campaign.analyse_all()
    ground = replace(analysis.optimum.ground, sd_ground=4.0, sd_chance=3.0, share=0.64)
    analysis = replace(analysis, optimum=replace(analysis.optimum, ground=ground))
    at = Grounds(campaign.spec, campaign.store)
    at.rank([analysis])  # of three covers grass alone helps
    assert [len(some) for some in asked] == [4 * 5, 12 * 3]
    asked.clear()
    monkeypatch.setattr(OptimumEstimate, "helped", lambda *_: True)
    at.rank([analysis])
    single, event = campaign.store.events(kind=RANKED)
    assert single.detail["known"] == event.detail["known"][:3]
    told = {tuple(one["covers"]): one["left"] for one in event.detail["known"]}
    every = tuple(moves)
    moved = {(name,): size for name, size in moves.items()} | {every: sum(moves.values())}
    assert list(told) == list(moved)
    assert told == {own: pytest.approx(1.0 - np.mean(d**2) / 32.0, abs=1e-4) for own, d in moved.items()}
    few, each, all_three = asked
    assert {(world, run) for world, run, _ in (*few, *each)} == {(k, 2 * k) for k in range(16)}  # the first occasion
    assert [len({own for *_, own in some}) for some in asked] == [5, 3, 1]
    assert [len(some) for some in asked] == [4 * 5, 12 * 3, 16]
    assert () not in {own for some in asked for *_, own in some}  # what an event keeps is not simulated again
    assert {own for _, _, own in all_three} == {every}
    moves["Trees"] = -3.0 * grass  # in these worlds all together hardly move the score
    at.rank([analysis])
    known = campaign.store.events(kind=RANKED)[-1].detail["known"]
    assert known[-1]["covers"] == [*moves]
    assert known[-1]["left"] == known[0]["left"] == pytest.approx(told["Grass",], abs=1e-4)


def test_simulated_runs_meet_worlds_of_their_own(copy) -> None:
    spec = Campaign.open(copy).spec
    settings = {"polarization": "HH", "resolution": 20.0}
    one, other, none = (task_of(spec, run, settings) for run in (3, 4, NO_RUN))
    assert none.world is None
    assert one.world != other.world
    levels = [task.scattering("psm").lookup(["Wheat"], 3.0, "HH").sigma0[0, 45] for task in (one, other, none)]
    assert len(set(levels)) == 3
    bundle = bundle_tasks(spec, settings)
    worlds, streams = [task.world for task in bundle], {task.run_id for task in bundle}
    assert worlds[0::2] == worlds[1::2]
    assert len(set(worlds)) == len(bundle) // 2
    assert len(streams) == len(bundle)
    apart = [replace(task, elsewhere=("Wheat",)) for task in bundle]
    assert [(task.world, task.run_id) for task in apart] == [(task.world, task.run_id) for task in bundle]
    looked = [t.scattering("psm").lookup(["Wheat", "Grass"], 3.0, "HH") for t in (apart[0], bundle[0])]
    assert looked[0].sigma0[1, 45] == looked[1].sigma0[1, 45]
    assert looked[0].sigma0[0, 45] != looked[1].sigma0[0, 45]
    assert looked[0].field_sd_db[0] != looked[1].field_sd_db[0]


def test_same_seed_gives_the_same_campaign_with_two_workers(finished, tmp_path, tiny_scene, monkeypatch) -> None:
    other = make_tiny(tmp_path / "other", tiny_scene, OF_TWO_PLACES)
    batches: list[tuple[int, int]] = []

    def noted(function, arguments, workers, *rest, **named):
        if function is carry_out:  # not the threads of one image
            batches.append((len(arguments), workers))
        return run_many(function, arguments, workers, *rest, **named)

    monkeypatch.setattr(runner, "run_many", noted)
    monkeypatch.setattr(grounds, "run_many", noted)
    ok("run", other, "--workers", 2)
    assert {workers for _, workers in batches} == {2}  # the confirmation runs among them
    # Two occasions in each of 16 worlds, after the start and at the end; the other level in 8 of those.
    assert batches.count((32, 2)) == 2
    assert (16, 2) in batches
    assert sum(n for n, _ in batches) > len(scores(other)) + 32  # and what each cover does
    assert scores(other) == scores(finished[0])
    # made at another time, in another folder, by other processes: the same report to the byte
    again = shutil.copytree(finished[0], tmp_path / "again" / "other")
    for folder in (other, again):
        ok("report", folder, "--html", folder / "report.html")
    assert (other / "report.html").read_bytes() == (again / "report.html").read_bytes()
    # the terminal, the report and fit --json tell the same numbers
    page = (other / "report.html").read_text(encoding="utf-8").replace("\u00a0", " ")
    lines = ok("fit", other).splitlines()
    rows = {cells[0]: cells[1:] for line in lines if len(cells := re.split(r" {2,}", line)) > 1}
    mean = rows["Mean score"][0]
    of_five = rows["Mean of 5 future runs"][0]
    assert mean in page
    assert of_five in page
    best = json.loads(ok("fit", other, "--json"))["optimum"]
    low, high = (float(end) for end in of_five.removesuffix(" percent").split(" to "))
    assert low == pytest.approx(best["prediction_mean"]["low"], abs=0.5)
    assert high == pytest.approx(best["prediction_mean"]["high"], abs=0.5)
    assert float(mean.split()[0]) == pytest.approx(best["mean"], abs=0.5)


def test_another_seed_gives_other_scores(finished, tmp_path, tiny_scene) -> None:
    other = make_tiny(tmp_path / "other", tiny_scene)
    assert seqrsm("run", other, "--max-runs", 14).exit_code == 3
    assert scores(other)[0][3] != scores(finished[0])[0][3]


def test_fit_json_keeps_the_contract(copy) -> None:
    document = json.loads(ok("fit", copy, "--json"))
    wanted = {
        "n_runs", "n_terms", "df_residual", "s", "r2", "r2_adjusted", "r2_predicted", "press", "terms", "anova",
        "lack_of_fit", "factors_importance", "stationary_point", "optimum", "posterior", "diagnostics", "stop",
    }  # fmt: skip
    assert wanted <= set(document)
    assert set(document["terms"][0]["coded"]) == {"estimate", "se", "t", "p", "low", "high"}
    assert {"settings", "coded", "at_bound", "mean", "confidence", "prediction", "level"} <= set(document["optimum"])
    assert {"tau", "ess", "acceptance", "r_hat"} <= set(document["posterior"]["sampler"])
    # with the flat prior the exact predictive interval is the t interval: emcee must meet it within its own error
    low, high = (document["optimum"]["prediction"][end] for end in ("low", "high"))
    predictive = document["posterior"]["optimum"]["predictive"]
    assert predictive["low"] == pytest.approx(low, abs=0.08 * (high - low))
    assert predictive["high"] == pytest.approx(high, abs=0.08 * (high - low))


def test_natural_coefficients_give_the_same_surface(copy) -> None:
    """The polynomial in log10(resolution) with the natural coefficients is that of the coded ones."""
    import numpy as np

    document = json.loads(ok("fit", copy, "--json"))
    assert all(set(term["natural"]) == {"estimate", "se", "low", "high"} for term in document["terms"])
    natural = {term["name"]: term["natural"]["estimate"] for term in document["terms"]}
    square = next(term for term in document["terms"] if term["name"] == "resolution^2")
    # one factor to a power, so only the scale changes: the interval is that of the coded coefficient, scaled
    ratio = square["natural"]["estimate"] / square["coded"]["estimate"]
    assert square["natural"]["se"] == pytest.approx(ratio * square["coded"]["se"], rel=1e-9)
    assert square["natural"]["low"] == pytest.approx(ratio * square["coded"]["low"], rel=1e-9)
    best = document["optimum"]["settings"]
    x = np.log10(best["resolution"])
    sign = 1.0 if best["polarization"] == "HH" else -1.0
    coded = {term["name"]: term["coded"]["estimate"] for term in document["terms"]}

    def value(of: dict[str, float], x: float) -> float:
        straight = of["intercept"] + of["resolution"] * x + of["resolution^2"] * x**2
        return straight + sign * (of["polarization[HH]"] + of["polarization[HH]:resolution"] * x)

    assert value(natural, x) == pytest.approx(value(coded, document["optimum"]["coded"]["resolution"]), rel=1e-9)


def test_texts_for_people(copy) -> None:
    for command in ("fit", "status", "check"):
        text = ok(command, copy)
        assert "\x1b" not in text
        assert "tiny" in text or "cover" in text
    history = ok("status", copy, "--history")
    assert history.count("scored run") >= 20
    assert not re.search(r"[\[{]['\[]|\d{13}", history), "tables and floats as a program writes them"


def test_check_tells_of_all_its_simulations(tiny, monkeypatch) -> None:
    made, told = [], []
    carry_out = check.carry_out
    monkeypatch.setattr(check, "carry_out", lambda task: (made.append(task), carry_out(task))[1])
    check.check_campaign(tiny, lambda done, total: told.append((len(made), total - done)))
    assert len(made) >= check.PROBES * check.PROBE_WORLDS
    assert [simulated for simulated, _ in told] == list(range(len(made) + 1))
    assert min(left for _, left in told) == 0


def test_check_tells_the_scatter_and_the_ground_that_the_scores_tell(copy) -> None:
    """And what future runs at the recommended settings scatter by, of which table uncertainty has a share."""
    told, best = json.loads(ok("check", copy, "--json")), json.loads(ok("fit", copy, "--json"))["optimum"]
    ground = best["ground"]
    simulations = f"{ground['n_simulations']} simulations near the optimum, in {ground['n_worlds']} draws of the tables"
    assert told["noise_source"] == simulations
    assert told["ground_share"] == best["ground"]["share_of_variance"]
    assert told["noise"] == pytest.approx(np.hypot(best["ground"]["sd_ground"], best["ground"]["sd_chance"]))
    campaign = Campaign.open(copy)
    (analysis,), (one,) = campaign.analyse_all(), campaign.spec.applications
    known = _surfaces(campaign.spec, one, _Scatter(), analysis)
    assert known.noise * known.at_best == pytest.approx(told["noise"])
    assert known.at_best == pytest.approx(np.sqrt(analysis.fitted.run_ratio)) != 1.0


def test_the_variation_over_the_region_is_told_from_grounds(tiny, monkeypatch) -> None:
    """Of the means of two grounds each, half of the variance of a ground is not the surface's."""
    spec, means = load_spec(tiny), {}

    def scored(task):
        mean = means.setdefault(task.settings["resolution"], 50.0 + 9.0 * task.settings["resolution"] ** 0.5)
        score = mean + 3.0 * (-1.0) ** task.world
        return SimpleNamespace(failure="", scores=[SimpleNamespace(score=score)])

    monkeypatch.setattr(check, "carry_out", scored)
    (found,), _, _ = check._probe(spec, lambda done, total: None)
    assert len(means) == check.PROBES
    assert found.noise == pytest.approx(3.0 * np.sqrt(2.0))
    assert found.spread == pytest.approx(np.sqrt(np.var(list(means.values()), ddof=1) - 9.0))


def test_budget_ends_with_3(tmp_path, tiny_scene) -> None:
    folder = make_tiny(tmp_path / "tiny", tiny_scene, TINY.replace("half_width = 22.0", "half_width = 1.0"))
    result = seqrsm("run", folder, "--max-runs", 17)
    assert result.exit_code == 3, result.output
    assert "The budget, 17 of the campaign's 40 runs, was spent before" in result.stdout
    assert len(scores(folder)) == 17
    campaign = Campaign.open(folder)  # what is told of flights at the end is of where it ended, held or not
    (analysis,) = campaign.analyse_all()
    assert campaign.store.events(kind=MEASURED)[-1].detail["settings"] == analysis.optimum.settings
    campaign.store.close()
    assert seqrsm("propose", folder, "-n", 2, "--source", "flight").exit_code == 0
    result = seqrsm("run", folder, "--max-runs", 19)
    assert "The budget, 19 of the campaign's 40 runs, was spent before the stop rule was met. 2 issued" in result.stdout
    text = (folder / "campaign.toml").read_text(encoding="utf-8")
    (folder / "campaign.toml").write_text(text.replace("max_runs = 40", "max_runs = 19"), encoding="utf-8")
    assert "The budget was spent before the stop rule was met. 2 issued" in seqrsm("run", folder).stdout


def test_a_budget_below_the_start_design_is_refused_before_anything_is_simulated(tiny) -> None:
    result = seqrsm("run", tiny, "--max-runs", 3)
    assert result.exit_code == 2
    assert "error: max_runs: the initial design has" in result.stderr
    assert json.loads(ok("status", tiny, "--json"))["runs"] == {}


def test_propose_simulate_void_by_hand(tiny) -> None:
    runs = json.loads(ok("propose", tiny, "--json"))
    assert len(runs) == 11  # five terms and six more
    assert {run["state"] for run in runs} == {"issued"}
    assert seqrsm("propose", tiny).exit_code == 2  # nothing to propose from before these are scored
    ok("simulate", tiny)
    ok("void", tiny, 3, "--why", "wrong altitude")
    status = json.loads(ok("status", tiny, "--json"))
    assert status["runs"] == {"scored": 10, "void": 1}
    assert (status["cost_spent"], status["cost_voided"]) == (10.0, 1.0)
    assert json.loads(ok("fit", tiny, "--json"))["n_runs"] == 10
    (more,) = json.loads(ok("propose", tiny, "-n", 1, "--json"))
    assert more["why"]


def test_flight_scores_enter_the_same_campaign(copy, tmp_path) -> None:
    before = json.loads(ok("fit", copy, "--json"))
    held_back = json.loads(ok("status", copy, "--json"))["runs"]["scored"] - before["n_runs"]  # to confirm
    form = tmp_path / "form.csv"
    spec = copy / "campaign.toml"  # the rule may have held only when the budget was spent
    spec.write_text(spec.read_text(encoding="utf-8").replace("max_runs = 40", "max_runs = 50"), encoding="utf-8")
    runs = json.loads(ok("propose", copy, "-n", 2, "--source", "flight", "--csv", form, "--json"))
    lines = form.read_text(encoding="utf-8").splitlines()
    header = lines[0].split(",")
    filled = [lines[0]]
    for line in lines[1:]:
        cells = line.split(",", len(header) - 1)
        cells[header.index("score")] = "70.5"
        filled.append(",".join(cells))
    form.write_text("\n".join(filled), encoding="utf-8")
    ok("ingest", copy, form, "--dry-run")
    assert json.loads(ok("fit", copy, "--json"))["n_runs"] == before["n_runs"]
    ok("ingest", copy, form)
    after = json.loads(ok("fit", copy, "--json"))
    assert after["n_runs"] == before["n_runs"] + held_back + len(runs)
    assert any(term["name"].startswith("block[") for term in after["terms"])  # the source is an effect of its own
    ok("ingest", copy, form)  # recognised, not doubled
    assert json.loads(ok("fit", copy, "--json"))["n_runs"] == after["n_runs"]


def test_no_form_is_made_of_runs_to_be_simulated(tiny, tmp_path) -> None:
    result = seqrsm("propose", tiny, "--csv", tmp_path / "form.csv")
    assert result.exit_code == 2
    assert "a form is for flights" in result.stderr
    assert "--source flight" in result.stderr
    assert not (tmp_path / "form.csv").exists()
    assert json.loads(ok("status", tiny, "--json"))["runs"] == {}


COSTS = "[cost]\nunit = 'kEUR'\nsimulation = {}\nflight = {}\n[stop]"


def room(folder: Path, simulation: float = 0.25, flight: float = 8.0) -> None:
    spec = folder / "campaign.toml"
    text = spec.read_text(encoding="utf-8").replace("max_runs = 40", "max_runs = 50")
    spec.write_text(text.replace("[stop]", COSTS.format(simulation, flight)), encoding="utf-8")


@pytest.mark.parametrize(("simulation", "flight", "chosen"), [(0.001, 1000.0, "simulation"), (1000.0, 0.001, "flight")])
def test_each_run_of_the_best_source_says_which_it_is_and_flights_alone_go_into_the_form(
    copy, tmp_path, simulation, flight, chosen
) -> None:
    room(copy, simulation, flight)
    form = tmp_path / "form.csv"
    result = seqrsm("propose", copy, "-n", 2, "--source", "best", "--csv", form)
    assert result.exit_code == 0, result.output
    assert len(re.findall(rf"run \d+ \({chosen}\): ", result.stdout)) == 2
    assert form.exists() == (chosen == "flight")
    assert ("no form: none of these runs is a flight" in result.stderr) == (chosen == "simulation")


def test_a_batch_of_both_sources_is_reproduced_as_it_was_proposed(copy) -> None:
    """It was left out: the commands that followed spoke of flights that nobody had issued."""
    room(copy)
    campaign = Campaign.open(copy)
    made = campaign.store.runs()
    new = [NewRun(made[0].proposed, "optimum", "", source) for source in ("simulation", "flight", "flight")]
    campaign.store.mark()
    campaign.store.add_batch(new)
    steps = reproduce(campaign, ())
    mixed = ("seqrsm propose copy -n 3 --source best", "seqrsm simulate copy")
    assert steps == ("seqrsm run copy", *mixed, "seqrsm fit copy", "seqrsm report copy")


def test_a_measured_score_of_a_run_to_be_simulated_needs_its_source(copy, tmp_path) -> None:
    """Without it a flight would count as a simulation, and cost as one."""
    room(copy)
    before = json.loads(ok("status", copy, "--json"))
    (run,) = json.loads(ok("propose", copy, "-n", 1, "--json"))
    file = tmp_path / "flown.csv"
    file.write_text(f"run_id,score\n{run['run_id']},70.5\n", encoding="utf-8")
    result = seqrsm("ingest", copy, file)
    assert result.exit_code == 2
    assert "proposed as a simulation" in result.stderr
    assert "column source" in result.stderr
    file.write_text(f"run_id,score,source\n{run['run_id']},70.5,flight\n", encoding="utf-8")
    ok("ingest", copy, file)
    after = json.loads(ok("status", copy, "--json"))
    assert after["cost_spent"] - before["cost_spent"] == pytest.approx(8.0)


def test_runs_that_the_stop_rule_does_not_ask_for_are_issued_with_a_word(copy, tiny) -> None:
    room(copy)
    result = seqrsm("propose", copy, "-n", 2)
    assert result.exit_code == 0, result.output
    assert "the stop rule is met: it asks for none of these runs" in result.stderr
    assert json.loads(ok("status", copy, "--json"))["runs"]["issued"] == 2
    assert "stop rule" not in seqrsm("propose", tiny).output


def test_a_target_of_one_application_is_refused_where_it_stands(tiny) -> None:
    """The error named [stop], whose half_width is another application's."""
    spec = tiny / "campaign.toml"
    own = '[[application]]\nname = "trees"\nutility = "f1 of Trees"\nhalf_width = 0.3\n\n[simulator]'
    text = spec.read_text(encoding="utf-8").replace("[simulator]", own, 1)
    spec.write_text(text, encoding="utf-8")
    result = seqrsm("check", tiny)
    assert result.exit_code == 2
    line = 1 + text.splitlines().index("half_width = 0.3")
    told = " ".join(result.stderr.split())
    assert f"campaign.toml:{line}: [[application]] half_width: trees: A half-width of 0.3 percent is below" in told
    assert "Widen [[application]] half_width to that, or more." in told


@pytest.mark.parametrize("suffix", ["png", "tif", "npz"])
def test_image_files_open(copy, tmp_path, suffix) -> None:
    import numpy as np

    out = tmp_path / f"image.{suffix}"
    document = json.loads(
        ok("image", copy, "--set", "polarization=HH+HV", "--set", "resolution=20", "--out", out, "--json")
    )
    assert document["settings"] == {"polarization": "HH+HV", "resolution": 20.0}
    channels, rows, columns = document["shape"]
    if suffix == "png":
        from PIL import Image

        with Image.open(out) as picture:
            assert picture.size == (columns, rows)
    elif suffix == "npz":
        with np.load(out) as arrays:
            assert arrays["intensity_w"].shape == (channels, rows, columns)
    else:
        import tifffile

        with tifffile.TiffFile(out) as tif:
            assert tif.asarray().shape == (2, 60, 80)
            assert tif.pages[0].tags[33550].value[:2] == (10.0, 10.0)


def test_export_csv_holds_every_run(copy, tmp_path) -> None:
    import csv

    out = tmp_path / "runs.csv"
    ok("export", copy, out)
    with out.open(encoding="utf-8", newline="") as stream:
        assert len(list(csv.DictReader(stream))) == len(scores(copy))


def test_rehearse_gives_coverage(copy) -> None:
    found = json.loads(ok("rehearse", copy, "--campaigns", 10, "--json"))
    numbers = found["numbers"]
    assert any("Surfaces are drawn" in note for note in found["notes"])
    assert 0.8 <= numbers["coverage_new_run"] <= 1.0
    assert numbers["runs_p10"] <= numbers["runs_median"] <= numbers["runs_p90"] <= 40


def test_design_stands_alone(tmp_path) -> None:
    out = tmp_path / "design.csv"
    document = json.loads(ok("design", "--factors", 2, "--runs", 9, "--csv", out, "--json"))
    assert document["d_efficiency"] == pytest.approx(0.97397, abs=1e-5)  # the best known design of 9 runs
    assert len(out.read_text(encoding="utf-8").splitlines()) == 10
    assert seqrsm("design", "--factors", 2, "--runs", 5).exit_code == 2


def test_check_says_what_cannot_be_built(tmp_path, tiny_scene) -> None:
    folder = make_tiny(tmp_path / "high", tiny_scene, TINY.replace("altitude_m = 4000.0", "altitude_m = 600000.0"))
    notes = [one for one in combinations_of(load_spec(folder)) if "this radar cannot be built" in one]
    assert any("speed against orbit" in one and "moves at 69" in one for one in notes)


def test_check_tells_the_margin_of_a_satellites_data_rate(tmp_path, tiny_scene) -> None:
    folder = make_tiny(tmp_path / "orbit", tiny_scene, TINY.replace("altitude_m = 4000.0", "altitude_m = 600000.0"))
    done = CliRunner().invoke(app, ["run", str(folder), "--max-runs", "12"])
    assert done.exit_code in (0, 3)
    for told in (done.stdout, ok("status", folder)):
        assert "At these settings this radar cannot be built (speed against orbit)" in " ".join(told.split())
    rate = json.loads(ok("check", folder, "--json"))["hardware"][-1]
    asked, margin = (float(rate.partition(word)[2].split()[0].rstrip(":")) for word in (": ", "margin "))
    assert margin == pytest.approx(3500.0 / asked, rel=0.01)
    assert "Sentinel-1 520, " in rate
    assert "SAOCOM-1 310?, " in rate
    assert rate.endswith("? recalled")


def test_check_tells_the_margins_of_the_best_so_far(copy) -> None:
    found = json.loads(ok("check", copy, "--json"))["hardware"]
    assert [one.partition(",")[0] for one in found] == [
        *("swath against pulse rate", "gain against beam", "antenna area against ambiguities", "data rate")
    ]
    assert all("margin" in one for one in found[:-1])
    assert "4 bits (assumed)" in found[-1]
    assert "downlink" not in found[-1]  # an aircraft keeps its data
    assert "cannot be built" in ok("check", copy)


def test_check_is_of_the_specification_as_it_is_now(copy) -> None:
    """The last look was recorded before the edit: its settings are those of the other goal."""
    file = copy / "campaign.toml"
    file.write_text(
        file.read_text("utf-8").replace('"percent_correct"', '"percent_correct"\ngoal = "minimize"'), "utf-8"
    )
    settings = json.loads(ok("fit", copy, "--json"))["optimum"]["settings"]
    assert check.check_campaign(copy).hardware == check._hardware(load_spec(copy), [settings])


def test_catalog_finds_soil_moisture() -> None:
    assert "A.16" in ok("catalog", "soil", "moisture")
    assert len(json.loads(ok("catalog", "soil", "moisture", "--json"))["entries"]) > 5


def test_catalog_knows_sensors_platforms_and_tables() -> None:
    found = json.loads(ok("catalog", "Sentinel-1", "--json"))
    values = {one["title"]: one["values"] for one in found["sensors"]}
    assert values["Sentinel-1 IW GRDH"]["altitude_km"] == {"value": 693.0, "status": "recalled"}
    assert values["Sentinel-1 IW GRDH"]["frequency_ghz"] == {"value": 5.405, "status": "seen"}
    text = ok("catalog", "Seasat")
    assert "Seasat SAR digital 25 m" in text
    assert "A.38 Seasat 1" in text
    assert "81.8?" in ok("catalog", "Sentinel-1", "IW", "GRDM")
    assert "Nimbus" in ok("catalog", "A.32")
    assert json.loads(ok("catalog", "a.16", "--json"))[0]["table"] == "A.16"
    whole = json.loads(ok("catalog", "--json"))
    tables = [{one["table"] for one in whole[kind]} for kind in ("entries", "platforms")]
    assert tables == [{f"A.{n}" for n in own} for own in (range(1, 21), {*range(21, 40)} - {26})]  # its page is missing


@pytest.mark.parametrize("options", [[], ["--json"]])
def test_what_the_catalog_does_not_know_is_an_error_that_tells_similar_names(options) -> None:
    for words, says in ((["Sentinal", "1"], "Similar names: Sentinel-1"), (["qwzzy"], "`seqrsm catalog` lists")):
        done = CliRunner().invoke(app, ["catalog", *words, *options])
        assert (done.exit_code, done.stdout) == (2, "")
        assert says in done.stderr
        assert f"(got '{' '.join(words)}')" in done.stderr


def test_the_report_warns_of_a_recommended_radar_that_cannot_be_built(copy) -> None:
    assert "cannot be built" not in ok("fit", copy)
    text = (copy / "campaign.toml").read_text(encoding="utf-8")
    higher = text.replace("peak_power = 1000.0", "peak_power = 1000.0\nantenna_gain_db = 60.0")
    price = '[[consideration]]\nname = "price"\nexpr = "100 / resolution"\nideal = 0\nunacceptable = 20\n\n'
    higher = higher.replace("[simulator]", f"{price}[simulator]", 1)
    weighed = higher.replace('"percent_correct"', '"percent_correct"\nideal = 100\nunacceptable = 1', 1)
    (copy / "campaign.toml").write_text(weighed, encoding="utf-8")
    scene = (copy / "scene.npz").read_bytes()
    (copy / "scene.npz").write_bytes(b"torn")  # a fit needs no scene; and that it could not be read is not remembered
    told = json.loads(ok("fit", copy, "--json"))
    assert not any("cannot be built" in text for text in told["warnings"])
    (copy / "scene.npz").write_bytes(scene)
    ok("report", copy, "--html", copy / "after.html")
    told = json.loads(ok("fit", copy, "--json"))
    assert any("cannot be built (gain against beam)" in text for text in told["warnings"])
    # Of the compromise in the summary, and of the optimum of the application alone in its section.
    for part in (copy / "after.html").read_text(encoding="utf-8").split("Overall desirability"):
        assert "this radar cannot be built (gain against beam)" in part


def test_check_begins_with_the_application_farthest_from_its_targets(tmp_path, tiny_scene) -> None:
    """Not the noise of one with the unit and the spread of another; and by more worlds than a few."""
    two = TINY.replace('levels = ["HH", "HH+HV"]', 'levels = ["HH", "VV"]').replace(
        "[simulator]",
        '[[application]]\nname = "wild"\nutility = "mine:wild"\nunit = "dB"\nhalf_width = 9\n[simulator]',
        1,
    )
    folder = make_tiny(tmp_path / "two", tiny_scene, two)
    wild = "import numpy as np\ndef wild(image, scene, *, seed, run_id):\n"
    wild += "    return 1e4 * float(np.random.default_rng((seed, run_id)).normal())\n"
    (folder / "mine.py").write_text(wild, encoding="utf-8")
    found = json.loads(seqrsm("check", folder, "--json").stdout)
    (other,) = found["others"]
    assert (found["application"], found["unit"]) == ("wild", "dB")
    assert (other["application"], other["unit"], other["target_problem"]) == ("cover", "percent", "")
    for one in (found, other):
        assert one["noise_source"] == "simulations at 16 settings of the region, 16 degrees of freedom"
    assert 4e3 < found["noise"] < 2e4
    assert found["plans"][0]["half_width"] > 1e3
