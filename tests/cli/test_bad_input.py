"""What a user can get wrong: exit code 2, the place and the remedy, and nothing changed."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from typer.testing import CliRunner, Result

from seqrsm.cli.app import app


def seqrsm(*arguments: object) -> Result:
    return CliRunner().invoke(app, [str(argument) for argument in arguments])


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
    "missing parameter": ("altitude_m = 4000.0", "", ["altitude_m"]),
    "unknown parameter": ("altitude_m = 4000.0", "altitude_m = 4000.0\nwings = 2", ["wings"]),
    "not TOML": ("[campaign]", "[campaign", ["campaign.toml:1"]),
    "impossible sensor": ("bandwidth = 60.0", "bandwidth = 1.0", ["resolution", "campaign.toml"]),
    "target below the noise": ("half_width = 16.0", "half_width = 0.01", ["half-width", "half_width"]),
}


@pytest.mark.parametrize("name", SPEC_ERRORS)
def test_spec(tiny, name) -> None:
    old, new, words = SPEC_ERRORS[name]
    path = tiny / "campaign.toml"
    text = path.read_text(encoding="utf-8")
    assert old in text
    path.write_text(text.replace(old, new), encoding="utf-8")
    before = listing(tiny)
    refused(seqrsm("check", tiny), *words)
    assert listing(tiny) == before
    if name != "target below the noise":
        refused(seqrsm("run", tiny))


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


def test_command_line(tiny, tmp_path) -> None:
    refused(seqrsm("status", tmp_path / "nowhere"), "nowhere")
    refused(seqrsm("init", tmp_path / "new"), "--template")
    refused(seqrsm("init", tmp_path / "new", "--template", "moon"), "moon", "flevoland")
    refused(seqrsm("init", tiny, "--template", "flevoland"), "not empty")
    refused(seqrsm("void", tiny, 99, "--why", "x"), "99")
    refused(seqrsm("image", tiny, "--out", tmp_path / "a.gif"), ".png")
    refused(seqrsm("image", tiny, "--set", "colour=1", "--out", tmp_path / "a.png"), "colour")
    refused(seqrsm("fit", tiny), "0 scored runs")
    refused(seqrsm("report", tiny), "0 scored runs")
    refused(seqrsm("propose", tiny, "--source", "balloon"), "balloon")
    refused(seqrsm("scene", "show", tmp_path / "no.npz"), "no.npz")
    refused(seqrsm("design", "--factors", 3, "--runs", 4))
