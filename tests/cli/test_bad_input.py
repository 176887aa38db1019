"""What a user can get wrong: exit code 2, the place and the remedy, and nothing changed."""

from __future__ import annotations

import json
import sqlite3
from contextlib import closing
from pathlib import Path

import measured_campaign
import numpy as np
import pytest
from commands import seqrsm
from typer.testing import Result


def refused(result: Result, *words: str) -> None:
    assert result.exit_code == 2, result.output + repr(result.exception)
    assert result.stdout == ""
    for word in words:
        assert word in result.stderr, result.stderr


def listing(folder: Path) -> dict[str, bytes]:
    return {path.name: path.read_bytes() for path in folder.iterdir() if path.is_file()}


SPEC_ERRORS = {
    "misspelt key": ("batch = 3", "bacth = 3", ["campaign.toml:5", "bacth", "batch"]),
    "misspelt table": ("[stop]", "[stopp]", ["stopp", "[stop]"]),
    "low above high": ("low = 10.0", "low = 100.0", ["resolution", "low"]),
    "log of a negative": ("low = 10.0", "low = -1.0", ["resolution", "log"]),
    "text for a number": ("max_runs = 40", 'max_runs = "many"', ["max_runs", "many"]),
    "not a polarization": ('"HH+HV"', '"HX"', ["polarization", "HX"]),
    "wrong unit": ('unit = "m"', 'unit = "GHz"', ["resolution", "GHz", "m"]),
    "no scene": ('scene = "scene.npz"', 'scene = "none.npz"', ["none.npz"]),
    "a list for an engine": ('engine = "psm"', 'engine = ["psm"]', ["campaign.toml", "engine"]),
    "a name too long for a file": ('scene = "scene.npz"', f'scene = "{"x" * 3000}"', ["campaign.toml", "no such file"]),
    "missing parameter": ("altitude_m = 4000.0", "", ["altitude_m"]),
    "unknown parameter": ("altitude_m = 4000.0", "altitude_m = 4000.0\nwings = 2", ["wings"]),
    "not TOML": ("[campaign]", "[campaign", ["campaign.toml:1"]),
    "impossible sensor": ("bandwidth = 60.0", "bandwidth = 1.0", ["resolution", "campaign.toml"]),
    "nobody's level": ("half_width = 22.0", "half_width = 22.0\nlevel = 1e-300", ["level", "0.5"]),
    "no frequency": ("frequency = 3.0", "frequency = 1e300", ["frequency", "0.1 to 100 GHz"]),
    "signs that are no pictures": ('scene = "scene.npz"', 'scene = ":x:.npz"', [":x:.npz"]),
    "target below the noise": ("half_width = 22.0", "half_width = 0.01", ["half-width", "half_width"]),
}


@pytest.mark.parametrize("name", SPEC_ERRORS)
def test_spec(tiny, name) -> None:
    old, new, words = SPEC_ERRORS[name]
    path = tiny / "campaign.toml"
    text = path.read_text(encoding="utf-8")
    assert old in text
    path.write_text(text.replace(old, new), encoding="utf-8")
    before = listing(tiny)
    done = seqrsm("check", tiny)
    assert done.exit_code == 2, done.output
    assert ("budget" in done.stdout) == (name == "target below the noise")  # what could be reached is told all the same
    assert all(word in done.stderr for word in words), done.stderr
    assert listing(tiny) == before
    if name != "target below the noise":
        refused(seqrsm("run", tiny))


def test_a_cover_without_backscatter_is_named_with_its_scene(tiny) -> None:
    with np.load(tiny / "scene.npz") as scene:
        layers = dict(scene)
    layers["categories"] = np.array(["Moor", *layers["categories"][1:]])
    np.savez_compressed(tiny / "scene.npz", **layers)
    refused(seqrsm("check", tiny), "campaign.toml:24: [simulator] scene", "'Moor'", "Trees", "legend")


def test_covers_that_differ_by_a_number_are_told_one_by_one(tiny) -> None:
    """They were taken for one, met at twice as many settings as there are, which narrower ranges would mend."""
    with np.load(tiny / "scene.npz") as scene:
        layers = dict(scene)
    layers["categories"] = np.array(["Wheat 2", "Wheat 3", *layers["categories"][2:]])
    np.savez_compressed(tiny / "scene.npz", **layers)
    done = seqrsm("check", tiny)
    refused(done, "'Wheat 2'", "'Wheat 3'")
    assert done.stderr.count("campaign.toml:24: [simulator] scene") == 2
    assert "This happens at" not in done.stderr


def test_scene_layers_that_differ_in_size(tiny) -> None:
    with np.load(tiny / "scene.npz") as scene:
        arrays = dict(scene)
    arrays["cover"] = arrays["cover"][:-1]
    np.savez_compressed(tiny / "scene.npz", **arrays)
    refused(seqrsm("check", tiny), "scene.npz", "cover", "59 x 80", "60 x 80")


HEADER = "polarization,resolution,score\n"
FILES = {
    "empty": ("", ["empty"]),
    "no rows": (HEADER, ["row"]),
    "missing column": ("polarization,score\nHH,50\n", ["resolution"]),
    "text in a number": (HEADER + "HH,20,good\n", ["scores.csv:2", "score", "good"]),
    "nan": (HEADER + "HH,20,50\nHH,nan,50\n", ["scores.csv:3", "resolution", "nan"]),
    "above 100 percent": (HEADER + "HH,20,101\n", ["scores.csv:2", "101"]),
    "unknown level": (HEADER + "VX,20,50\n", ["scores.csv:2", "polarization", "VX"]),
}


@pytest.mark.parametrize("name", FILES)
def test_scores_file(tiny, tmp_path, name) -> None:
    text, words = FILES[name]
    path = tmp_path / "scores.csv"
    path.write_text(text, encoding="utf-8")
    refused(seqrsm("ingest", tiny, path), "scores.csv", *words)
    status = seqrsm("status", tiny, "--json")
    assert '"runs": {}' in status.stdout


def test_a_report_is_written_over_nothing_of_another_kind(tiny) -> None:
    before = listing(tiny)
    refused(seqrsm("report", tiny, "--html", tiny / "scene.npz"), "scene.npz: unknown kind of report", ".html")
    refused(seqrsm("report", tiny, "--pdf", tiny / "campaign.toml"), "campaign.toml: unknown kind of report", ".pdf")
    assert {name: data for name, data in listing(tiny).items() if not name.startswith("campaign.db")} == before


def test_a_campaign_without_simulator_is_not_run(tmp_path) -> None:
    folder = tmp_path / "polder"
    assert seqrsm("init", folder, "--template", "flevoland").exit_code == 0
    scores = folder / "flight_scores.csv"
    scores.write_text("".join(scores.read_text(encoding="utf-8").splitlines(keepends=True)[::5]), encoding="utf-8")
    refused(seqrsm("run", folder), "no simulator", "ingest")
    assert seqrsm("ingest", folder, scores).exit_code == 0
    refused(seqrsm("run", folder), "no simulator")
    refused(seqrsm("propose", folder, "--source", "simulation"), "no simulator")
    assert '"issued"' not in seqrsm("status", folder, "--json").stdout
    proposed = seqrsm("propose", folder, "-n", "1", "--json")
    assert '"source": "flight"' in proposed.stdout


def test_reading_a_new_campaign_leaves_its_folder_as_it_is(tmp_path) -> None:
    folder = tmp_path / "polder"
    assert seqrsm("init", folder, "--template", "flevoland").exit_code == 0
    before = sorted(folder.iterdir())
    for command in ("status", "fit", "report", "check", "candidates", "export"):
        seqrsm(command, folder, *([tmp_path / "all.json"] if command == "export" else []))
        assert sorted(folder.iterdir()) == before, command


def test_command_line(tiny, tmp_path) -> None:
    refused(seqrsm("status", tmp_path / "nowhere"), "nowhere")
    refused(seqrsm("init", tmp_path / "new"), "--template")
    refused(seqrsm("init", tmp_path / "new", "--template", "moon"), "moon", "flevoland")
    refused(seqrsm("init", tiny, "--template", "flevoland"), "not empty")
    refused(seqrsm("void", tiny, 99, "--why", "x"), "99")
    refused(seqrsm("image", tiny, "--out", tmp_path / "a.gif"), ".png")
    refused(seqrsm("image", tiny, "--set", "colour=1", "--out", tmp_path / "a.png"), "colour")
    twice = ("--set", "resolution=30", "--set", "resolution=40")
    refused(seqrsm("image", tiny, *twice, "--out", tmp_path / "a.png"), "resolution: this factor is set twice")
    refused(seqrsm("fit", tiny), "0 scored runs", "`seqrsm run` simulates some.")
    refused(seqrsm("report", tiny), "0 scored runs")
    refused(seqrsm("propose", tiny, "--source", "balloon"), "balloon")
    refused(seqrsm("scene", "show", tmp_path / "no.npz"), "no.npz")
    refused(seqrsm("design", "--factors", 3, "--runs", 4))


@pytest.mark.parametrize("row", ["1e308,1", "-1e13,1", "1,1e308", "1e15,", "1,5e-324", "1,1e-13"])
def test_numbers_that_are_no_scores(tmp_path, row) -> None:
    text = '[campaign]\nname = "m"\n[[factor]]\nname = "x"\nlow = -1.0\nhigh = 1.0\n'
    text += '[[application]]\nname = "worth"\nutility = "measured"\n[stop]\nhalf_width = 0.5\n'
    (tmp_path / "campaign.toml").write_text(text, encoding="utf-8")
    (tmp_path / "s.csv").write_text(f"x,score,se\n0.5,3,1\n0.5,{row}\n", encoding="utf-8")
    refused(seqrsm("ingest", tmp_path, tmp_path / "s.csv"), "s.csv:3", "not a usable number")
    assert "none yet" in seqrsm("status", tmp_path).output


def test_a_large_offset_leaves_the_noise_as_it_is(tmp_path) -> None:
    """Up to the largest scores that are taken."""
    noise = np.random.default_rng(1).normal(size=21)
    found = []
    for offset in (0.0, 9e11):
        folder = tmp_path / str(offset)
        folder.mkdir()
        text = '[campaign]\nname = "m"\n[[factor]]\nname = "x"\nlow = -1.0\nhigh = 1.0\n'
        text += '[[application]]\nname = "worth"\nutility = "measured"\n[stop]\nhalf_width = 0.5\n'
        (folder / "campaign.toml").write_text(text, encoding="utf-8")
        rows = [f"{k / 10 - 1},{offset + one!r}" for k, one in enumerate(noise.tolist())]
        (folder / "s.csv").write_text("x,score\n" + "\n".join(rows) + "\n", encoding="utf-8")
        assert seqrsm("ingest", folder, folder / "s.csv").exit_code == 0
        found.append(json.loads(seqrsm("fit", folder, "--json").stdout)["s"])
    assert found[1] == pytest.approx(found[0], rel=1e-4)


def test_what_a_file_holds_that_is_none_of_ours_is_not_told(tiny) -> None:
    secret = tiny.parent / "secret.txt"
    secret.write_text("root:hunter2:0\n", encoding="utf-8")
    path = tiny / "campaign.toml"
    text = path.read_text(encoding="utf-8").replace("[stop]", f'targets_file = "{secret}"\n[stop]')
    path.write_text(text, encoding="utf-8")
    result = seqrsm("check", tiny)
    refused(result, "targets", "secret.txt")
    assert "hunter2" not in result.stderr


def test_cells_wider_than_a_province(tiny) -> None:
    with np.load(tiny / "scene.npz") as archive:
        members = {name: archive[name] for name in archive.files} | {"cell_m": np.array(1e9)}
    np.savez(tiny / "scene.npz", **members)
    refused(seqrsm("check", tiny), "cell_m", "larger than 100000 m")


@pytest.mark.parametrize("command", ["check", "status", "fit", "propose", "report", "rehearse"])
def test_every_command_refuses_a_score_that_was_changed_in_the_file(command: str, tmp_path: Path) -> None:
    folder = measured_campaign.make(
        tmp_path / "c", measured_campaign.X + measured_campaign.FREQUENCY, measured_campaign.quadratic()
    )
    with closing(sqlite3.connect(folder / "campaign.db")) as base, base:
        base.execute("UPDATE scores SET score = score + 7 WHERE run_id = 3")
    refused(seqrsm(command, folder), "score of run 3")
