"""Scores of a campaign are made from one simulator, scene and utility: a change is told before a run is made."""

from __future__ import annotations

import shutil
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from tiny_campaign import TINY, make_tiny
from typer.testing import CliRunner, Result

from seqrsm import __version__
from seqrsm.campaign.campaign import Campaign
from seqrsm.campaign.dossier import assemble
from seqrsm.campaign.experiment import EXPERIMENT, experiment_of, see_experiment
from seqrsm.campaign.simulation import carry_out, files_of, scene_at, task_of
from seqrsm.cli.app import app
from seqrsm.spec.read import load_spec
from seqrsm.store.store import Store

RUNNER = CliRunner()
OWN = "def mine(image, scene, seed, run_id):\n    return 50.0 + run_id % 7\n"


def run(folder: Path, *more: str) -> Result:
    return RUNNER.invoke(app, ["run", str(folder), *more])


def scored(folder: Path) -> int:
    return len(Campaign.open(folder).store.runs("scored"))


@pytest.fixture
def begun(tmp_path: Path, made: Path) -> Path:
    """A copy of the campaign, the test's own."""
    return shutil.copytree(made, tmp_path / "c")


@pytest.fixture(scope="module")
def made(tmp_path_factory: pytest.TempPathFactory, tiny_scene: Path) -> Path:
    folder = make_tiny(
        tmp_path_factory.mktemp("made") / "c", tiny_scene, TINY.replace('"percent_correct"', '"own:mine"')
    )
    (folder / "own.py").write_text(OWN, encoding="utf-8")
    assert run(folder, "--max-runs", "14").exit_code in (0, 3)
    return folder


def changed(folder: Path, file: str, old: str, new: str) -> None:
    text = (folder / file).read_text(encoding="utf-8")
    assert old in text
    (folder / file).write_text(text.replace(old, new), encoding="utf-8")


@pytest.mark.parametrize(
    ("file", "old", "new", "words"),
    [
        (
            "campaign.toml",
            "bandwidth = 60.0",
            "bandwidth = 30.0",
            "bandwidth was 60.0 for earlier runs and is now 30.0",
        ),
        ("campaign.toml", "altitude_m = 4000.0", "altitude_m = 4000.0\nwind_low_m_s = 3.0", "is now 3.0"),
        ("own.py", "% 7", "% 5", "own.py: the file differs from the one"),
    ],
)
def test_what_changed_is_refused_and_can_be_accepted_or_put_back(begun, file, old, new, words) -> None:
    before = scored(begun)
    changed(begun, file, old, new)
    runs = Campaign.open(begun).store.runs()
    for command in ("run", "check", "propose", "simulate"):
        refused = RUNNER.invoke(app, [command, str(begun)])
        assert (refused.exit_code, words in refused.output) == (2, True), command
    assert Campaign.open(begun).store.runs() == runs
    changed(begun, file, new, old)
    assert run(begun, "--max-runs", "17").exit_code in (0, 3)
    changed(begun, file, old, new)
    assert run(begun, "--max-runs", "20", "--accept").exit_code in (0, 3)
    assert run(begun, "--max-runs", "23").exit_code in (0, 3)
    assert len(Campaign.open(begun).store.events(kind=EXPERIMENT)) == 2
    assert scored(begun) > before


def test_a_report_tells_what_has_changed_since_its_scores_were_simulated(begun) -> None:
    """Images and sources of a changed table stood beside scores of the former one, and nothing was said."""
    told = "since runs were simulated this has changed: "
    assert told not in " ".join(assemble(Campaign.open(begun)).assumptions)
    changed(begun, "own.py", "% 7", "% 5")
    changed(begun, "campaign.toml", "bandwidth = 60.0", "bandwidth = 30.0")
    assert f"{told}[simulator.fixed] bandwidth, own.py;" in " ".join(assemble(Campaign.open(begun)).assumptions)


def test_scores_of_a_former_utility_are_told_as_no_other(begun) -> None:
    """`status` had told them in the unit of the new utility, and `propose` had issued runs that were chosen by them."""
    changed(begun, "campaign.toml", '"own:mine"', '"kappa"')
    line = (begun / "campaign.toml").read_text(encoding="utf-8").splitlines().index('utility = "kappa"')
    told = f"campaign.toml:{line + 1}: utility of cover was own:mine for earlier runs and is now kappa"
    before = Campaign.open(begun).store.runs()
    for command in ("status", "fit", "propose", "simulate", "run", "report", "rehearse", "check"):
        refused = RUNNER.invoke(app, [command, str(begun)])
        assert refused.exit_code == 2, command
        assert told in refused.output, command
    for command, file in (("ingest", "s.csv"), ("export", "all.csv"), ("export", "all.json"), ("image --out", "i.png")):
        (begun / "s.csv").write_text("polarization,resolution,score\nHH,20,0.2\n", encoding="utf-8")
        place = command.split()
        refused = RUNNER.invoke(app, [place[0], str(begun), *place[1:], str(begun / file)])
        assert (refused.exit_code, told in refused.output) == (2, True), command
    assert Campaign.open(begun).store.runs() == before
    changed(begun, "campaign.toml", '"kappa"', '"own:mine"')
    assert RUNNER.invoke(app, ["status", str(begun)]).exit_code == 0


def test_a_level_that_runs_have_and_the_campaign_has_no_more_is_refused_before_any_run_is_made(begun) -> None:
    """`simulate` had made those that were issued, and only a look at the scores told of it."""
    Campaign.open(begun).propose(2)
    runs = Campaign.open(begun).store.runs()
    changed(begun, "campaign.toml", '"HH", "HH+HV"', '"HH", "VV"')
    for command in ("simulate", "run", "propose", "status", "fit"):
        refused = RUNNER.invoke(app, [command, str(begun)])
        assert refused.exit_code == 2, command
        assert "unknown level (got 'HH+HV'). campaign.toml was changed since: restore" in refused.output, command
    assert Campaign.open(begun).store.runs() == runs


def test_a_scene_of_another_ground_is_refused(begun) -> None:
    data = (begun / "scene.npz").read_bytes()
    (begun / "scene.npz").write_bytes(data + b"\0")
    refused = run(begun, "--max-runs", "17")
    assert refused.exit_code == 2
    assert "scene.npz: the file differs from the one earlier runs were simulated from" in refused.output
    assert RUNNER.invoke(app, ["simulate", str(begun)]).exit_code == 2
    for command in ("status", "fit"):  # what is there can be looked at
        assert RUNNER.invoke(app, [command, str(begun)]).exit_code == 0


def test_runs_fail_by_the_machine_where_the_scene_goes_away_meanwhile(begun) -> None:
    opened = Campaign.open(begun)
    opened.propose(2)
    (begun / "scene.npz").rename(begun / "away.npz")
    assert [run.fault for run in opened.simulate()] == ["machine", "machine"]


def test_before_the_first_score_anything_may_change(begun, tmp_path: Path) -> None:
    with Store.open(tmp_path, create=True, campaign="tiny") as store:
        spec = load_spec(begun)
        see_experiment(store, spec)
        see_experiment(store, replace(spec, simulator=spec.simulator.model_copy(update={"fixed": {}})))
        assert len(store.events(kind=EXPERIMENT)) == 2


def test_what_a_member_of_a_set_has_of_its_own_belongs_to_the_experiment() -> None:
    told = experiment_of(load_spec(Path(__file__).parents[2] / "campaigns" / "langegracht-dates"))
    assert told["[simulator.members.C] polarization"] == "VV+VH"


def test_noting_the_experiment_overtakes_no_decision(tmp_path: Path) -> None:
    with Store.open(tmp_path, create=True, campaign="c") as store, Store.open(tmp_path, campaign="c") as other:
        store.mark()
        other.add_event(EXPERIMENT, {EXPERIMENT: {}})
        assert store.record_look(0, "a", {}) == 1


def test_an_application_may_come_with_code_of_its_own_and_go(begun) -> None:
    (begun / "second.py").write_text(OWN.replace("% 7", "% 3"), encoding="utf-8")
    own, other = (f'[[application]]\nname = "{name}"\nutility = "{name}:mine"\n\n' for name in ("own", "second"))
    changed(begun, "campaign.toml", "[simulator]", own + other + "[simulator]")
    came = run(begun, "--max-runs", "17").output
    changed(begun, "campaign.toml", own, "")
    told = came + run(begun, "--max-runs", "20").output
    assert "simulated from" not in told
    assert "for earlier runs" not in told


def test_a_new_application_scores_the_runs_that_there_are(begun) -> None:
    """A run's images are those of its id: they are simulated once more, and no new initial design is needed."""
    before = Campaign.open(begun).store.runs("scored")
    both = '[[application]]\nname = "second"\nutility = "percent_correct"\nhalf_width = 30.0\n\n[simulator]'
    changed(begun, "campaign.toml", "[simulator]", both)
    done = RUNNER.invoke(app, ["simulate", str(begun), "--workers", "2"])
    assert done.exit_code == 0, done.output
    assert f"{len(before)} runs completed" in done.output
    opened = Campaign.open(begun)
    runs = opened.store.runs()
    assert [run.run_id for run in runs] == [run.run_id for run in before]
    for run in runs:
        fresh = carry_out(task_of(opened.spec, run.run_id, run.settings)).scores
        assert [(one.application, one.score) for one in run.scores] == [(one.application, one.score) for one in fresh]
    late = [one.run_id for one in opened.store.events(kind="scored") if one.detail["application"] == "second"]
    assert sorted(late) == [run.run_id for run in runs]
    count = len(opened.store.events())
    assert RUNNER.invoke(app, ["simulate", str(begun)]).exit_code == 0
    assert len(opened.store.events()) == count


def test_a_new_application_that_always_fails_ends_the_run(begun) -> None:
    before = scored(begun)
    both = '[[application]]\nname = "second"\nutility = "bad:score"\nhalf_width = 30.0\n\n[simulator]'
    changed(begun, "campaign.toml", "[simulator]", both)
    (begun / "bad.py").write_text("def score(image, scene, seed, run_id):\n    return 1 / 0\n", encoding="utf-8")
    done = run(begun, "--max-runs", "40")
    assert done.exit_code == 2
    assert "ZeroDivisionError" in done.output
    assert scored(begun) == before


def test_a_new_application_comes_from_the_images_before_any_other_run_is_proposed(begun) -> None:
    """`propose` issued another initial design, which `simulate` beside the images that there were made needless."""
    both = '[[application]]\nname = "second"\nutility = "percent_correct"\nhalf_width = 30.0\n\n[simulator]'
    changed(begun, "campaign.toml", "[simulator]", both)
    events = Campaign.open(begun).store.events()
    assert RUNNER.invoke(app, ["check", str(begun)]).exit_code == 0
    assert Campaign.open(begun).store.events() == events  # looking notes nothing
    before = len(Campaign.open(begun).store.runs())
    refused = RUNNER.invoke(app, ["propose", str(begun), "-n", "2"])
    assert refused.exit_code == 2
    assert "no simulated run has a score of 'second' yet. `seqrsm simulate` scores those" in refused.output
    assert f"{before} runs completed" in RUNNER.invoke(app, ["simulate", str(begun)]).output
    assert RUNNER.invoke(app, ["propose", str(begun), "-n", "2"]).exit_code == 0
    assert len(Campaign.open(begun).store.runs()) == before + 2


def test_a_new_application_that_scores_no_earlier_run_is_told_before_any_other_run_is_made(begun) -> None:
    """Three batches had been simulated that failed for the same reason."""
    both = '[[application]]\nname = "second"\nutility = "own:ice"\nhalf_width = 30.0\n\n[simulator]'
    changed(begun, "campaign.toml", "[simulator]", both)
    with (begun / "own.py").open("a", encoding="utf-8") as stream:
        stream.write("def ice(image, scene, seed, run_id):\n    raise ValueError('no ice')\n")
    before = Campaign.open(begun).store.runs()
    refused = run(begun, "--accept")
    assert refused.exit_code == 2
    assert "campaign.toml:22: earlier runs cannot be scored for 'second': [[application]] utility" in refused.output
    assert "no ice" in refused.output
    assert Campaign.open(begun).store.runs() == before


def test_a_new_application_goes_without_runs_that_it_cannot_score(begun) -> None:
    """They are tried once, and the others are fitted."""
    both = '[[application]]\nname = "second"\nutility = "own:ice"\nhalf_width = 30.0\n\n[simulator]'
    changed(begun, "campaign.toml", "[simulator]", both)
    with (begun / "own.py").open("a", encoding="utf-8") as stream:
        stream.write("def ice(image, scene, seed, run_id):\n    with open(f'{__file__}.tried', 'a') as tried:\n")
        stream.write("        tried.write(f'{run_id} ')\n")
        stream.write("    if run_id == 3:\n        raise ValueError('no ice')\n    return 50.0 + run_id % 5\n")
    assert run(begun, "--accept", "--max-runs", "17").exit_code in (0, 3)
    runs = Campaign.open(begun).store.runs("scored")
    assert [one.run_id for one in runs if one.score_of("second") is None] == [3]
    assert (begun / "own.py.tried").read_text(encoding="utf-8").split().count("3") == 1
    again = RUNNER.invoke(app, ["simulate", str(begun)])  # tries it once more, and goes on
    assert again.exit_code == 0, again.output


def test_a_factor_that_becomes_fixed_is_no_other_experiment(begun) -> None:
    """Earlier runs keep the values that they had, in which they differ: told, as the factor's effect is scatter now."""
    factor = '[[factor]]\nname = "polarization"\nlevels = ["HH", "HH+HV"]\n'
    changed(begun, "campaign.toml", factor, "")
    before = Campaign.open(begun).store.runs()
    told = f"{begun / 'campaign.toml'}:23: [simulator.fixed] polarization: missing. Make it a factor"
    for command in ("run", "propose", "simulate", "tradeoff", "check"):
        refused = RUNNER.invoke(app, [command, str(begun)])
        assert (refused.exit_code, told in refused.output) == (2, True), (command, refused.output)
    assert Campaign.open(begun).store.runs() == before  # three batches had failed for it
    assert RUNNER.invoke(app, ["propose", str(begun), "-n", "1", "--source", "flight"]).exit_code == 0
    changed(begun, "campaign.toml", "[simulator.fixed]", '[simulator.fixed]\npolarization = "HH"')
    assert RUNNER.invoke(app, ["check", str(begun)]).exit_code == 0
    done = run(begun, "--max-runs", "17")
    assert done.exit_code in (0, 3), done.output
    assert "differ in polarization, which is no longer a factor: " in " ".join(done.output.split())
    changed(begun, "campaign.toml", 'polarization = "HH"', 'polarization = "HV"')
    refused = run(begun, "--max-runs", "20")
    assert "[simulator.fixed] polarization was HH for earlier runs and is now HV" in " ".join(refused.output.split())


def test_a_scene_that_is_away_is_no_other_scene(begun) -> None:
    (begun / "scene.npz").rename(begun / "away.npz")
    away = run(begun, "--max-runs", "17")
    assert away.exit_code == 2
    assert "simulated from" not in away.output
    (begun / "away.npz").rename(begun / "scene.npz")
    assert run(begun, "--max-runs", "17").exit_code in (0, 3)


def test_another_version_of_the_program_is_told(begun, monkeypatch) -> None:
    monkeypatch.setattr("seqrsm.campaign.experiment.__version__", "9.9.9")
    assert f"seqrsm was {__version__} for earlier runs and is now 9.9.9" in run(begun, "--max-runs", "17").output
    assert run(begun, "--max-runs", "17", "--accept").exit_code in (0, 3)


def test_a_table_that_comes_or_goes_is_named(begun) -> None:
    header = "quantity,category,frequency_ghz,polarization,theta_deg,value,unit,status,source\n"
    rows = [f"sigma0,Hops,3.0,{p},{t},-10,dB,measured,me\n" for p in ("HH", "HV", "VV") for t in (20, 60)]
    (begun / "own.csv").write_text(header + "".join(rows), encoding="utf-8")
    changed(begun, "campaign.toml", 'scene = "scene.npz"', 'scene = "scene.npz"\ntable = "own.csv"')
    assert "own.csv: earlier runs were simulated without this file" in run(begun, "--max-runs", "17").output
    assert run(begun, "--max-runs", "17", "--accept").exit_code in (0, 3)
    changed(begun, "campaign.toml", '\ntable = "own.csv"', "")
    assert "were simulated from this file, which is no longer used" in run(begun, "--max-runs", "20").output


def test_a_map_that_is_there_already_is_the_floor_and_part_of_the_experiment(tmp_path, tiny_scene) -> None:
    folder = make_tiny(tmp_path / "c", tiny_scene, TINY.replace('"percent_correct"', '"percent_correct by field"'))
    plain = Campaign.open(folder)
    categories = scene_at(str(plain.spec.scene_path)).categories
    task = task_of(plain.spec, 1, plain.spec.region.decode(plain.spec.region.centre())[0])
    before = carry_out(task).scores[0]
    changed(folder, "campaign.toml", 'scene = "scene.npz"', 'scene = "scene.npz"\nknown_map = "old.csv"')
    missing = RUNNER.invoke(app, ["check", str(folder)])
    assert missing.exit_code == 2
    assert "known_map: there is no such file" in missing.output.replace("\n", " ")
    rows = [",".join([name, *("90" if name == other else "0" for other in categories)]) for name in categories]
    (folder / "old.csv").write_text("\n".join(["cover," + ",".join(categories), *rows]) + "\n", encoding="utf-8")
    spec = load_spec(folder)
    task = task_of(spec, 1, spec.region.decode(spec.region.centre())[0])
    after = carry_out(task).scores[0]
    assert after.metadata["guess"] == 100.0
    assert after.score > max(before.score, 95.0)  # what images contradict may be named by them
    assert before.metadata["guess"] < before.score < 100.0
    changed(folder, "old.csv", ",0", ",30")
    # Two occasions over one ground meet one map; another ground has another.
    alone = [carry_out(replace(task_of(spec, run, {**task.settings}), world=w)) for w in range(6) for run in (1, 2)]
    floors = np.array([result.scores[0].metadata["guess"] for result in alone]).reshape(6, 2)
    assert np.all(floors[:, 0] == floors[:, 1])
    assert np.ptp(floors) > 0.0
    assert str(folder / "old.csv") in files_of(task)
    assert run(folder, "--max-runs", "14").exit_code in (0, 3)
    changed(folder, "old.csv", ",90", ",many")
    wrong = RUNNER.invoke(app, ["check", str(folder)])
    assert wrong.exit_code == 2
    assert wrong.output.startswith(f"error: {folder / 'old.csv'}:2: ")
    assert "has no cells" not in wrong.output  # what is not a number is told once
    changed(folder, "old.csv", ",many", ",70")
    refused = run(folder, "--max-runs", "17")
    assert refused.exit_code == 2
    assert "old.csv: the file differs from the one" in refused.output
    changed(folder, "campaign.toml", '"percent_correct by field"', '"soil_moisture_skill"')
    assert "a map has no effect" in RUNNER.invoke(app, ["check", str(folder)]).output.replace("\n", " ")


def test_comments_targets_and_tolerances_are_no_change(begun) -> None:
    changed(begun, "campaign.toml", "half_width = 22.0", "half_width = 12.0  # narrower")
    changed(begun, "campaign.toml", "low = 10.0", "low = 12.0")
    changed(begun, "campaign.toml", 'scene = "scene.npz"', 'scene = "scene.npz"\ntolerance = 0.5')
    assert run(begun, "--max-runs", "17").exit_code in (0, 3)


def test_a_fixed_parameter_may_become_a_factor(begun) -> None:
    changed(begun, "campaign.toml", "bandwidth = 60.0\n", "")
    factor = '[[factor]]\nname = "bandwidth"\nunit = "MHz"\nlow = 30.0\nhigh = 90.0\n\n[[application]]'
    changed(begun, "campaign.toml", "[[application]]", factor)
    assert "for earlier runs" not in run(begun, "--max-runs", "17").output
