"""What a new user does beyond the templates: own utilities, several applications, flights first, settings by hand."""

from __future__ import annotations

import json
import os
import re
import shlex
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import tifffile
from tiny_campaign import TINY, make_tiny
from typer.testing import CliRunner

import seqrsm
from seqrsm.campaign import check
from seqrsm.campaign.campaign import all_failed
from seqrsm.campaign.check import combinations_of
from seqrsm.campaign.next_runs import rounded_settings
from seqrsm.cli.app import app
from seqrsm.design.constraints import Constraint
from seqrsm.design.factors import ContinuousFactor
from seqrsm.design.region import Region
from seqrsm.errors import UserError
from seqrsm.scene.file import load_scene, save_scene
from seqrsm.spec.read import load_spec
from seqrsm.store.records import RunRecord

pytestmark = pytest.mark.usefixtures("few_draws")

OWN = TINY.replace('utility = "percent_correct"', 'utility = "mine:score"')


def call(*arguments: object, code: int = 0) -> str:
    result = CliRunner().invoke(app, [str(argument) for argument in arguments])
    assert result.exit_code == code, result.output + repr(result.exception)
    return " ".join(result.output.split()) if code else result.stdout


@pytest.fixture
def own(tmp_path, tiny_scene):
    """A campaign whose utility stands in mine.py beside campaign.toml."""

    def make(body: str, name: str = "own") -> Path:
        folder = make_tiny(tmp_path / name, tiny_scene, OWN)
        (folder / "mine.py").write_text(f"def score(image, scene, *, seed, run_id):\n    {body}\n", encoding="utf-8")
        return folder

    return make


def test_scores_that_are_all_alike_have_no_interval_and_no_parts_of_one(own) -> None:
    """The summary had: "± no error estimate: ..., combines ± no error estimate: ... of sampling error"."""
    told = call("run", own("return 50.0"), "--max-runs", 12, code=3)
    assert "All scores are equal" in told
    assert "combines" not in told
    assert "\u00b1\u00a0no" not in told


def test_a_utility_of_ones_own_is_told_by_its_name(own) -> None:
    """The question had "ice floes:f1 score". All grounds score alike here: no ratio of variances is made of that."""
    folder = own("return 50.0 + image.radar.resolution_m")
    (folder / "mine.py").rename(folder / "ice_floes.py")
    text = (folder / "campaign.toml").read_text(encoding="utf-8")
    (folder / "campaign.toml").write_text(text.replace("mine:score", "ice_floes:score"), encoding="utf-8")
    told = call("run", folder, "--max-runs", 12, code=3)
    assert "the highest score (ice_floes:score) for cover?" in told


def test_a_utility_of_ones_own_may_return_a_number(own, tmp_path, monkeypatch) -> None:
    monkeypatch.chdir(tmp_path)  # found beside campaign.toml from anywhere
    folder = own("return float(len(image.radar.channels)) + 0.001 * run_id")
    call("propose", folder)
    call("simulate", folder, "--workers", 2)
    call("export", folder, tmp_path / "out.json")
    runs = json.loads((tmp_path / "out.json").read_text(encoding="utf-8"))["runs"]
    for run in runs:
        channels = len(str(run["proposed"]["polarization"]).split("+"))
        assert run["scores"][0]["score"] == pytest.approx(channels + 0.001 * run["run_id"])
    # Another campaign's module of the same name is another module.
    other = own("return 50.0", "other")
    found = json.loads(call("image", other, "--out", tmp_path / "i.npz", "--json"))
    assert found["scores"] == {"cover": 50.0}


@pytest.mark.parametrize(
    ("body", "words"),
    [
        ("return 1 / 0", "utility: score() failed: ZeroDivisionError: division by zero. See line"),
        ("return 'good'", "score() returned str"),
        ("return float('nan')", "score() returned nan"),
        ("return = 3", "SyntaxError"),
        ("raise SystemExit", "score() failed: SystemExit"),  # it ended the command, with exit code 0
    ],
)
def test_a_utility_that_fails_is_told_with_its_place(own, body, words) -> None:
    folder = own(body)
    assert words in call("check", folder, code=2)
    assert "mine.py" in call("run", folder, code=2)
    assert not (folder / "campaign.db").exists() or json.loads(call("status", folder, "--json"))["runs"] == {}


@pytest.mark.skipif(not hasattr(os, "fork"), reason="no processes are forked here")
@pytest.mark.parametrize(
    "what", ["image.intensity", "image.pixel_of_cell", "scene.elevation_m", "scene.cover", "scene.scored"]
)
def test_a_utility_cannot_change_what_others_score(own, what) -> None:
    """A change of the scene had stayed for all later runs of a process, one of the image for the utilities after it."""
    told = call("run", own(f"{what}[0, ...] = 0; return 1.0"), code=2)
    assert "score() failed: ValueError: assignment destination is read-only. See line 2 of" in told


def test_a_utility_that_forks_leaves_no_copy_that_goes_on(own, tmp_path) -> None:
    """Each went on as the command: it simulated, and wrote scores, too."""
    calls = tmp_path / "calls"
    folder = own(
        f"""import os
    if run_id in (1, 2) and os.fork() == 0 and run_id == 2:
        raise ValueError("in the copy")
    with open({str(calls)!r}, "a") as file:
        print(run_id, os.getpid(), file=file)
    return 0.001 * run_id"""
    )
    call("propose", folder)
    command = [sys.executable, "-m", "seqrsm", "simulate", str(folder)]
    done = subprocess.run(command, capture_output=True, text=True, timeout=300, check=True)
    assert done.stdout.count("runs completed") == 1, done.stdout
    by_process: dict[str, list[str]] = {}
    for run_id, process in (row.split() for row in calls.read_text(encoding="ascii").splitlines()):
        by_process.setdefault(process, []).append(run_id)
    copy, program = sorted(by_process.values(), key=len)
    assert copy == ["1"]
    assert len(set(program)) >= json.loads(call("status", folder, "--json"))["runs"]["scored"]


def test_a_utility_that_changes_the_folder_takes_no_results_there(own, tmp_path, monkeypatch) -> None:
    folder = own("__import__('os').chdir('..'); return 0.001 * run_id")
    (tmp_path / "here").mkdir()
    monkeypatch.chdir(tmp_path / "here")
    call("image", folder, "--set", "resolution=20", "--set", "polarization=HH", "--out", "image.npz")
    assert [path.name for path in (tmp_path / "here").iterdir()] == ["image.npz"]
    call("propose", folder)
    call("simulate", folder)
    assert Path.cwd() == tmp_path / "here"


def test_several_shells_share_the_runs_of_one_campaign(own) -> None:
    """The first took all of them: a job array of `simulate` was one job, and the others ended with 0 runs."""
    folder = own("__import__('time').sleep(0.4); return 0.001 * run_id")
    call("propose", folder)
    command = [sys.executable, "-m", "seqrsm", "simulate", str(folder)]
    jobs = [subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True) for _ in range(2)]
    told = [job.communicate(timeout=300) for job in jobs]
    assert [job.returncode for job in jobs] == [0, 0], told
    shares = [int(out.splitlines()[-1].split()[0]) for out, _ in told]
    runs = json.loads(call("status", folder, "--json"))["runs"]
    assert min(shares) > 0
    assert runs == {"scored": sum(shares)}
    assert sum("another command is simulating 1 run" in err for _, err in told) == 1


def test_simulations_that_all_failed_end_with_2_and_are_made_once_the_cause_is_gone(own) -> None:
    folder = own("raise ValueError('too bright')")
    call("propose", folder)
    told = call("simulate", folder, code=2)
    n_runs = json.loads(call("status", folder, "--json"))["runs"]["failed"]
    assert f"error: none of these {n_runs} runs has a score: [[application]] utility: score() failed" in told
    shown = CliRunner().invoke(app, ["simulate", str(folder), "--json"])
    assert shown.exit_code == 2
    assert {run["state"] for run in json.loads(shown.stdout)} == {"failed"}
    (folder / "mine.py").write_text("def score(image, scene, *, seed, run_id):\n    return 1.0\n", encoding="utf-8")
    assert f"{n_runs} runs completed" in call("simulate", folder)


def test_one_run_without_a_score_is_told_as_one() -> None:
    run = RunRecord(1, 1, "start", "", "simulation", "failed", {}, None, "", 1.0, reason="too dark")
    assert str(all_failed([run])) == "the run has no score: too dark"
    assert str(all_failed([run, run])) == "none of these 2 runs has a score: too dark"


def test_a_module_that_ends_the_program_when_it_is_imported_is_told(own) -> None:
    folder = own("return 1.0")
    (folder / "mine.py").write_text("raise SystemExit(0)\n", encoding="utf-8")
    assert "the utility cannot be imported: SystemExit: 0" in call("run", folder, code=2)


@pytest.mark.parametrize(
    ("name", "body", "remedy"),
    [
        ("nowhere:score", "return 1.0", "Put its module beside campaign.toml, or install its package."),
        ("mine:other", "return 1.0", "Correct the module."),  # it was told to put the module where it is
        ("mine:score", "return = 3", "Correct the module."),
        ("mine:score", "return 1.0\nfrom math import nothing", "Correct the module."),
    ],
)
def test_a_module_that_is_wrong_is_not_told_to_be_elsewhere(own, name: str, body: str, remedy: str) -> None:
    folder = own(body)
    path = folder / "campaign.toml"
    path.write_text(path.read_text(encoding="utf-8").replace("mine:score", name), encoding="utf-8")
    told = call("check", folder, code=2)
    assert remedy in told
    assert told.count("module beside") == (name == "nowhere:score")


def test_a_utility_of_other_arguments_is_told_which_it_takes(own) -> None:
    """It was told to see a line of ours."""
    folder = own("return 1.0")
    (folder / "mine.py").write_text("def score(image, scene):\n    return 1.0\n", encoding="utf-8")
    told = call("run", folder, code=2)
    assert "score() got an unexpected keyword argument 'seed'" in told
    assert "Let it take (image, scene, *, seed, run_id)." in told


def test_what_a_utility_prints_is_no_part_of_the_document(own) -> None:
    """``--json`` prints one document on stdout and nothing else: a print left in a utility stood before it."""
    folder = own("print('so far'); return 50.0 + run_id % 7")
    done = CliRunner().invoke(app, ["run", str(folder), "--max-runs", "12", "--json"])
    assert json.loads(done.stdout)["n_scored"] == 12
    assert "so far" in done.stderr


def test_what_programs_of_a_utility_print_is_no_part_of_the_document(own) -> None:
    folder = own("__import__('os').system('echo so far'); return 50.0 + run_id % 7")
    call("propose", folder)
    command = [sys.executable, "-m", "seqrsm", "simulate", str(folder), "--json"]
    done = subprocess.run(command, capture_output=True, text=True, timeout=300, check=True)
    assert {run["state"] for run in json.loads(done.stdout)} == {"scored"}
    assert "so far" in done.stderr


def test_a_utility_that_is_not_there(own) -> None:
    folder = own("return 1.0")
    (folder / "mine.py").unlink()
    text = call("check", folder, code=2)
    assert "No module named 'mine'" in text
    assert "beside campaign.toml" in text
    assert "Narrow the factor" not in text


def test_run_goes_on_after_failures_in_the_start_design(own) -> None:
    # Of eleven runs of the start design eight fail: too few scores for five terms, and no reason to give up.
    folder = own("return 50.0 + run_id % 7 if run_id == 0 or run_id > 8 else 1 / 0")
    outcome = json.loads(call("run", folder, "--max-runs", 12, "--json", code=3))
    assert outcome["n_scored"] >= 6


def test_run_with_unscored_flights_says_what_to_do(tiny) -> None:
    call("propose", tiny, "--source", "flight")
    text = call("run", tiny, code=2)
    assert "11 flights have no scores" in text
    assert "seqrsm ingest" in text
    assert json.loads(call("status", tiny, "--json"))["runs"] == {"issued": 11}


def test_the_next_command_can_be_pasted_where_a_name_has_blanks(tmp_path, monkeypatch) -> None:
    monkeypatch.setattr(check, "settle_target", lambda *_: "")  # which simulates
    folder = tmp_path / "my flights"
    told = CliRunner().invoke(app, ["init", str(folder), "--template", "flevoland"]).stderr
    _, next_one = told.strip().split("next: ")
    assert shlex.split(next_one) == ["seqrsm", "ingest", str(folder), str(folder / "flight_scores.csv")]
    assert CliRunner().invoke(app, shlex.split(next_one)[1:]).exit_code == 0
    other = tmp_path / "my floods"
    told = CliRunner().invoke(app, ["init", str(other), "--application", "flood"]).stderr
    assert shlex.split(told.strip().split("next: ")[1]) == ["seqrsm", "check", str(other)]


def test_simulate_without_a_simulator_says_to_fly(tmp_path) -> None:
    folder = tmp_path / "polder"
    call("init", folder, "--template", "flevoland")
    call("propose", folder)
    told = call("simulate", folder, code=2)
    assert "campaign.toml: this campaign has no simulator" in told
    assert "seqrsm ingest" in told
    with pytest.raises(UserError, match="no simulator"):
        seqrsm.Campaign(folder).simulate()
    assert json.loads(call("status", folder, "--json"))["runs"].keys() == {"issued"}


def test_each_application_is_confirmed_by_runs_at_its_own_optimum(tmp_path, tiny_scene) -> None:
    second = '[[application]]\nname = "coarse"\nutility = "mine:coarse"\n\n[simulator]'
    text = TINY.replace("[simulator]", second).replace("half_width = 22.0", "half_width = 30.0")
    folder = make_tiny(tmp_path / "two", tiny_scene, text)
    body = "import numpy as np\n\n\ndef coarse(image, scene, *, seed, run_id):\n"
    body += "    rng = np.random.default_rng(run_id)\n    return 3.0 * image.radar.resolution_m**0.5 + rng.normal()\n"
    (folder / "mine.py").write_text(body, encoding="utf-8")
    outcome = json.loads(call("run", folder, "--json"))
    again = call("run", folder)  # at its end already: tells the same, under headings that name the application
    for name in ("cover", "coarse"):
        assert f"Importance of the sensor parameters, {name}\n" in again
        assert f"Which covers to measure, {name}\n" in again
    call("export", folder, tmp_path / "out.json")
    runs = {run["run_id"]: run for run in json.loads((tmp_path / "out.json").read_text(encoding="utf-8"))["runs"]}
    seen: set[int] = set()
    for analysis in outcome["applications"]:
        ids = analysis["confirmation"]["run_ids"]
        assert len(ids) == 3
        assert not seen & set(ids)
        seen |= set(ids)
        best = analysis["optimum"]["settings"]
        for run_id in ids:
            assert runs[run_id]["proposed"]["polarization"] == best["polarization"]
            assert runs[run_id]["proposed"]["resolution"] == pytest.approx(best["resolution"], rel=2e-3)


def test_image_says_what_is_wrong_with_a_setting(tiny, tmp_path) -> None:
    def told(*settings: str) -> str:
        arguments = [word for setting in settings for word in ("--set", setting)]
        return call("image", tiny, *arguments, "--out", tmp_path / "i.png", code=2)

    assert "resolution: outside the campaign's region (got '2000')" in told("resolution=2000")
    assert "Give 10 to 60 m" in told("resolution=2000")
    assert "resolution: not a finite number" in told("resolution=wide")
    plain = (tiny / "campaign.toml").read_text(encoding="utf-8")
    dates = '[[factor]]\nname = "interval_days"\nvalues = [1, 3, 6]\n[[application]]'
    (tiny / "campaign.toml").write_text(plain.replace("[[application]]", dates, 1), encoding="utf-8")
    assert "interval_days: outside the campaign's region (got '2'). Give 1 or 3 or 6 d" in told("interval_days=2")
    (tiny / "campaign.toml").write_text(plain, encoding="utf-8")
    assert "polarization: unknown level (got 'XX')" in told("polarization=XX")
    assert "other parameters stand in campaign.toml" in told("frequency=4")
    assert "line 1" not in told("polarization=XX", "resolution=")
    text = (tiny / "campaign.toml").read_text(encoding="utf-8")
    constraint = "[[constraint]]\nexpr = \"resolution >= 20 or polarization == 'HH'\"\n\n[[application]]"
    (tiny / "campaign.toml").write_text(text.replace("[[application]]", constraint), encoding="utf-8")
    assert "resolution >= 20 or polarization == 'HH'" in told("resolution=15", "polarization=HH+HV")


def test_image_is_made_at_the_optimum_of_the_latest_scores(tiny, tmp_path) -> None:
    rows = [
        f"{polarization},{resolution},{60 + 20 * (polarization == 'HH') - abs(resolution - 25)}"
        for polarization in ("HH", "HH+HV")
        for resolution in (10, 14, 20, 25, 30, 40, 50, 60)
    ]
    file = tmp_path / "flights.csv"
    file.write_text("polarization,resolution,score\n" + "\n".join(rows), encoding="utf-8")
    call("ingest", tiny, file)
    status = json.loads(call("status", tiny, "--json"))
    best = status["applications"][0]["last_look"]["optimum"]["settings"]
    made = json.loads(call("image", tiny, "--out", tmp_path / "i.npz", "--json"))["settings"]
    assert made["polarization"] == best["polarization"] == "HH"
    assert made["resolution"] == pytest.approx(best["resolution"], rel=1e-3)


def test_init_takes_the_words_of_an_application_with_or_without_quotes(tmp_path) -> None:
    call("init", tmp_path / "a", "--application", "oil", "spill")
    call("init", tmp_path / "b", "--application", "oil spill")
    texts = [(tmp_path / name / "campaign.toml").read_text(encoding="utf-8") for name in "ab"]
    assert texts[0] == texts[1]
    assert "one folder" in call("init", tmp_path / "c", "too", "--template", "flevoland", code=2)
    assert not (tmp_path / "c").exists()


def test_settings_at_a_constraint_keep_four_digits() -> None:
    region = Region(
        (
            ContinuousFactor("frequency", 12.0, 36.0, "GHz", "log"),
            ContinuousFactor("resolution", 60.0, 150.0, "m", "log"),
        ),
        (Constraint("resolution * frequency >= 1100"),),
    )
    frequency = np.array([12.3456789, 15.7071067, 17.974197610634025])
    settings = [{"frequency": f, "resolution": 1100.0 / f} for f in frequency]
    points = region.code(settings)
    for given, found in zip(settings, rounded_settings(region, points), strict=True):
        assert found["frequency"] * found["resolution"] >= 1100.0
        for name in ("frequency", "resolution"):
            assert float(f"{found[name]:.4g}") == found[name]
            assert found[name] == pytest.approx(given[name], rel=2e-3)


@pytest.mark.parametrize("utility", ["rank", "mine:score"])
def test_a_utility_that_cannot_score_is_told_with_its_line(tiny, utility) -> None:
    text = (tiny / "campaign.toml").read_text(encoding="utf-8")
    line = text[: text.index("utility =")].count("\n") + 1
    (tiny / "campaign.toml").write_text(text.replace('"percent_correct"', f'"{utility}"'), encoding="utf-8")
    assert f"campaign.toml:{line}: [[application]] utility: " in call("check", tiny, code=2)


def test_a_wrong_fixed_parameter_is_told_with_its_line_and_its_own_remedy(tiny) -> None:
    text = (tiny / "campaign.toml").read_text(encoding="utf-8")

    def told(old: str, new: str) -> str:
        (tiny / "campaign.toml").write_text(text.replace(old, new), encoding="utf-8")
        return call("check", tiny, code=2)

    line = text[: text.index("peak_power")].count("\n") + 1
    wrong = told("peak_power = 1000.0", "peak_power = -1")
    assert f"campaign.toml:{line}: [simulator.fixed] peak_power: out of range (got -1.0). Give a number" in wrong
    assert "Narrow" not in wrong
    missing = told("peak_power = 1000.0", "")
    says = "[simulator.fixed] peak_power: missing. Make it a factor or give it under [simulator.fixed]"
    assert says in missing
    assert says in call("simulate", tiny, code=2)  # without runs, too
    # A band that is too narrow for the finest resolution only lies with the factor.
    narrow = told("bandwidth = 60.0", "bandwidth = 10.0")
    assert re.search(r"This happens at \d+ of \d+ settings, for instance at polarization HH, resolution 10 m\.", narrow)
    assert "Narrow the factor's range" in narrow
    line = text[: text.rindex("[[factor]]")].count("\n") + 1
    assert f"campaign.toml:{line}: resolution: " in narrow
    # One that is wrong at all settings, with another limit at each, is not mended by a narrower range.
    height = '[[factor]]\nname = "altitude_m"\nlow = 3000\nhigh = 4000\n[[application]]'
    text = text.replace("altitude_m = 4000.0", "prf_hz = 190000.0").replace("[[application]]", height, 1)
    everywhere = told("nothing", "nothing")
    assert re.search(r"prf_hz: .* This happens at (\d+) of \1 settings", everywhere)
    assert "Change it or all ranges." in everywhere
    assert "Narrow" not in everywhere


def test_what_one_sensor_of_a_set_lacks_is_not_mended_by_a_range(tmp_path) -> None:
    call("init", tmp_path / "c", "--template", "langegracht-dates")
    file = tmp_path / "c" / "campaign.toml"
    file.write_text(file.read_text(encoding="utf-8").replace('polarization = "HH+HV"', ""), encoding="utf-8")
    told = call("check", tmp_path / "c", code=2)
    where = "[simulator.fixed] or, for L alone, [simulator.members.L]"
    assert f"polarization: sensor L of the set: missing. Make it a factor or give it under {where}: " in told
    assert "for instance at frequency L, " in told
    assert "Narrow" not in told


def test_a_sensor_that_cannot_be_built_is_told_once_however_many_its_numbers_are(tiny) -> None:
    text = (tiny / "campaign.toml").read_text(encoding="utf-8")
    looks = '[[factor]]\nname = "looks"\nlow = 1\nhigh = 1e6\nscale = "log"\n[[application]]'
    (tiny / "campaign.toml").write_text(text.replace("[[application]]", looks, 1), encoding="utf-8")
    told = call("check", tiny, code=2)
    assert told.count("independent samples at the centre of the scene") == 1
    assert re.search(r"\(got 1000\.0\).* This happens at \d+ of \d+ settings", told)


def test_a_form_that_cannot_be_written_issues_no_runs(tiny) -> None:
    assert "cannot be written" in call("propose", tiny, "--csv", tiny / "nowhere" / "form.csv", code=2)
    assert json.loads(call("status", tiny, "--json"))["runs"] == {}


def test_words_on_a_templates_scene_do_not_stay_beside_another_scene(tmp_path: Path) -> None:
    made, scene = tmp_path / "mine", tmp_path / "mine" / "scene.npz"
    assert CliRunner().invoke(app, ["init", str(made), "--template", "limburg-radar"]).exit_code == 0
    about = (made / "SCENE.md").read_text(encoding="utf-8")
    for name, value in (("dem", 5), ("cover", 1)):
        tags = [(33550, 12, 3, (5.0, 5.0, 0.0), True), (33922, 12, 6, (0.0, 0.0, 0.0, 1000.0, 5000.0, 0.0), True)]
        keys = (34735, 3, 16, (1, 1, 0, 3, 1024, 0, 1, 1, 1025, 0, 1, 1, 3072, 0, 1, 31370), True)
        tifffile.imwrite(tmp_path / f"{name}.tif", np.full((20, 20), value, np.uint8), extratags=[*tags, keys])
    (tmp_path / "legend.csv").write_text("code,category\n1,Wheat\n", encoding="utf-8")
    given = [f"--elevation={tmp_path / 'dem.tif'}", f"--cover={tmp_path / 'cover.tif'}"]
    done = CliRunner().invoke(
        app, ["scene", "import", *given, f"--legend={tmp_path / 'legend.csv'}", "--out", str(scene)]
    )
    assert done.exit_code == 0, done.output
    assert "SCENE-of-template.md" in done.output
    assert not (made / "SCENE.md").exists()
    assert (made / "SCENE-of-template.md").read_text(encoding="utf-8") == about


def test_too_little_memory_is_told_in_one_line(tmp_path: Path, monkeypatch) -> None:
    def none_left(*_arguments: object) -> None:
        raise MemoryError("Unable to allocate 3 GiB")

    monkeypatch.setattr("seqrsm.scene.file.load_scene", none_left)
    told = CliRunner().invoke(app, ["scene", "show", str(tmp_path / "scene.npz")])
    assert told.exit_code == 2
    assert "not enough memory: Unable to allocate 3 GiB" in told.stderr


@pytest.mark.parametrize(
    ("typed", "offered"),
    [
        ("seqrsm pro", {"propose"}),
        ("seqrsm propose --so", {"--source"}),
        ("seqrsm init --template l", {"langegracht-dates", "langegracht-radar", "limburg-radar"}),
    ],
)
def test_a_shell_completes_commands_options_and_templates(typed, offered):
    asked = {"COMP_WORDS": typed, "COMP_CWORD": str(len(typed.split()) - 1), "_SEQRSM_COMPLETE": "complete_bash"}
    done = subprocess.run(
        [sys.executable, "-c", "import sys; sys.argv = ['seqrsm']; from seqrsm.cli.app import main; main()"],
        env={**os.environ, **asked}, capture_output=True, text=True, check=True,
    )  # fmt: skip
    assert set(done.stdout.split()) == offered


def test_the_version_is_that_of_the_package():
    from importlib.metadata import version

    done = subprocess.run([sys.executable, "-m", "seqrsm", "--version"], capture_output=True, text=True, check=True)
    assert done.stdout == f"seqrsm {version('seqrsm')}\n"


def test_fields_that_training_and_test_divide_are_told_where_most_ground_is_theirs(tmp_path, tiny_scene) -> None:
    """Of one cover under four names 42 to 49 % were right over fields of 300 to 500 m, where 25 % are by chance."""
    scene, told = load_scene(tiny_scene), []
    row, column = (at // side for at, side in zip(np.indices(scene.shape), (30, 40), strict=True))
    few, rest = np.indices(scene.shape)[1] // 15, np.indices(scene.shape)[0] // 15
    lone = np.where(few == 0, 0, 1 + 8 * rest + few)  # of ground of one cover, a fifth
    for field, cover, name in (
        (2 * row + column, column, "four"),
        (lone, np.minimum(few, 1), "lone"),
        (column, column, "two"),
    ):
        _, number = np.unique(field, return_inverse=True)
        changed = {"cover": cover.astype(np.uint8), "field_id": number.reshape(field.shape).astype(np.int32)}
        save_scene(replace(scene, **changed, cell_m=10.0), tmp_path / f"{name}.npz")
        folder = make_tiny(tmp_path / name, tmp_path / f"{name}.npz")
        told.append(" ".join(combinations_of(load_spec(folder))))
    assert "scores are too high" not in told[0] + told[1]
    assert "100 % of the scored ground lies in fields that are most of their cover's" in told[2]
    assert "--field-m" in told[2]


def test_ground_of_one_cover_is_refused_and_a_cover_of_one_small_field_is_told(tmp_path, tiny_scene) -> None:
    scene = load_scene(tiny_scene)
    save_scene(replace(scene, cover=np.zeros_like(scene.cover)), tmp_path / "one.npz")
    folder = make_tiny(tmp_path / "one", tmp_path / "one.npz")
    assert "all scored ground is Grass: there is nothing to tell apart" in call("run", folder, code=2)
    assert json.loads(call("status", folder, "--json"))["runs"] == {}
    cover, field_id = np.minimum(scene.cover, 1), scene.field_id.copy()
    cover[30:33, 40:42], field_id[30:33, 40:42] = 2, scene.n_fields
    save_scene(replace(scene, cover=cover, field_id=field_id), tmp_path / "lone.npz")
    folder = make_tiny(tmp_path / "lone", tmp_path / "lone.npz")
    (told,) = combinations_of(load_spec(folder))
    assert told.startswith("Bareground is one field of 0.06 ha, not taught where it is tested")
    # Of a scored field nothing is right, whatever the settings, but by the ends of border pixels of other fields.
    call("run", folder, "--max-runs", 12, code=3)
    call("export", folder, tmp_path / "lone.json")
    runs = json.loads((tmp_path / "lone.json").read_text(encoding="utf-8"))["runs"]
    right = [run["scores"][0]["metadata"]["per_class_percent"]["Bareground"] for run in runs if run["scores"]]
    assert right.count(0.0) >= 10
