"""Campaigns that vary what used to be fixed: altitude, pulse, season; weather and heading of a radiometer."""

from __future__ import annotations

import json
import re
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
from commands import document, seqrsm
from tiny_campaign import TINY, make_tiny

from seqrsm.campaign.simulation import SimulationTask, carry_out, task_of
from seqrsm.sensor.sets import SENSORS
from seqrsm.spec.read import load_spec

HEAD, TAIL = TINY[: TINY.index("[[factor]]")], TINY[TINY.index("[[application]]") :]
FACTORS = {
    "altitude_m": 'unit = "m"\nlow = 3000.0\nhigh = 9000.0',
    "pulse_length_us": 'low = 1.0\nhigh = 10.0\nscale = "log"',
    "season": 'levels = ["spring_summer", "fall", "winter"]',
    "prf_hz": 'unit = "Hz"\nvalues = [500, 1000, 2000]',
}
FIXED = {
    "frequency": "3.0", "bandwidth": "60.0", "peak_power": "1000.0", "depression_angle": "45.0", "polarization": '"HH"',
    "resolution": "20.0",
}  # fmt: skip
RADIOMETER_FIXED = {
    "frequency": "10.7", "polarization": '"H"', "resolution": "60.0", "integration_time": "5.0", "bandwidth": "100.0",
    "noise_temperature": "500.0", "scan_period": "1.0", "antenna_limit_m": "10.0",
}  # fmt: skip
SMALL = "[model]\norder = 1\n\n"
"""Seven terms in place of eighteen: a start design of few runs."""


def campaign(factors: dict[str, str], fixed: dict[str, str], engine: str = "psm") -> str:
    tables = "".join(f'[[factor]]\nname = "{name}"\n{text}\n\n' for name, text in factors.items())
    tail = TAIL.replace('"psm"', f'"{engine}"').replace("max_runs = 40", "max_runs = 18")
    given = "".join(f"{name} = {value}\n" for name, value in fixed.items())
    tail = re.sub(r"(?s)(\[simulator.fixed\]\n).*?\n\n", lambda found: f"{found[1]}{given}\n", tail)
    return HEAD + tables + SMALL + tail


@pytest.fixture(scope="module")
def varied(tmp_path_factory: pytest.TempPathFactory, tiny_scene: Path) -> Path:
    """Folder of a campaign that has run to the end of its budget."""
    folder = make_tiny(tmp_path_factory.mktemp("any") / "varied", tiny_scene, campaign(FACTORS, FIXED))
    assert seqrsm("run", folder).exit_code == 3
    return folder


def runs_of(folder: Path) -> list[dict[str, Any]]:
    file = folder / "all.json"
    assert seqrsm("export", folder, file).exit_code == 0
    return json.loads(file.read_text(encoding="utf-8"))["runs"]  # type: ignore[no-any-return]


def test_check_tells_what_every_season_rests_on(varied):
    found = document("check", varied)
    assert found["n_factors"] == 4
    assert found["n_terms"] == 6
    notes = "\n".join(found["notes"])
    assert "Grass: fall: short and partly dormant" in notes
    assert "Bareground: winter: frozen ground" in notes


def test_runs_take_all_kinds_of_levels(varied):
    runs = [run for run in runs_of(varied) if run["state"] == "scored"]
    assert len(runs) == 18
    assert {run["proposed"]["season"] for run in runs} == {"spring_summer", "fall", "winter"}
    assert {run["proposed"]["prf_hz"] for run in runs} <= {500.0, 1000.0, 2000.0}
    assert {3000.0, 9000.0} <= {run["proposed"]["altitude_m"] for run in runs}
    assert all(1.0 <= run["proposed"]["pulse_length_us"] <= 10.0 for run in runs)


def scores(task: SimulationTask) -> list[Any]:
    """What a run is scored, with everything kept beside it but its time."""
    result = carry_out(task)
    assert not result.failure
    return [
        (
            score.application,
            score.score,
            score.se,
            {**score.metadata, "fidelity": {**score.metadata["fidelity"], "seconds": 0}},
        )
        for score in result.scores
    ]


@pytest.mark.parametrize("cells", [0, 2])
def test_a_run_scores_as_one_whose_season_and_pulse_rate_are_fixed(varied, tiny_scene, tmp_path, cells):
    spec = load_spec(varied)
    made = {}
    settings = {"altitude_m": 5000.0, "pulse_length_us": 2.0}
    order = [(run, season) for run in (3, 8) for season in ("spring_summer", "winter", "fall", "winter")]
    for run, season in order:
        for prf in (500.0, 2000.0):
            task = task_of(spec, run, {**settings, "season": season, "prf_hz": prf})
            made[run, season, prf] = scores(replace(task, cells=cells))
    for season in ("winter", "fall", "spring_summer"):
        for prf in (2000.0, 500.0):
            fixed = {**FIXED, "season": f'"{season}"', "prf_hz": repr(prf)}
            numeric = {name: text for name, text in FACTORS.items() if name in settings}
            folder = make_tiny(tmp_path / f"{season}-{prf:g}", tiny_scene, campaign(numeric, fixed))
            own = load_spec(folder)
            for run in (3, 8):
                task = task_of(own, run, settings)
                assert scores(replace(task, cells=cells)) == made[run, season, prf]
    assert made[3, "winter", 500.0] != made[3, "fall", 500.0]


def test_pictures_and_studies_of_such_a_campaign(varied, tmp_path):
    image = tmp_path / "i.npz"
    assert seqrsm("image", varied, "--set", "season=winter", "--set", "altitude_m=4000", "--out", image).exit_code == 0
    refusal = seqrsm("image", varied, "--set", "season=monsoon", "--out", image)
    assert refusal.exit_code == 2
    assert "monsoon" in refusal.stderr
    study = document("tradeoff", varied)
    assert not study["simulation"]["failures"]
    assert {row["season"] for row in study["simulation"]["configurations"]} <= {"spring_summer", "fall", "winter"}


def test_levels_that_contradict_each_other_are_refused_with_the_settings(tmp_path, tiny_scene):
    fixed = {**FIXED, "snow": '"wet"'}
    folder = make_tiny(tmp_path / "snow", tiny_scene, campaign(FACTORS, fixed))
    result = seqrsm("check", folder)
    assert result.exit_code == 2
    said = " ".join(result.stderr.split())
    assert "snow occurs in winter only" in said
    assert "season spring_summer" in said
    assert "season winter" not in said


def test_a_fixed_value_that_cannot_be_is_told_with_its_line(tmp_path, tiny_scene):
    fixed = {**FIXED, "peak_power": "-1.0"}
    folder = make_tiny(tmp_path / "field", tiny_scene, campaign(FACTORS, fixed))
    line = (folder / "campaign.toml").read_text(encoding="utf-8").split("\n").index("peak_power = -1.0") + 1
    result = seqrsm("check", folder)
    assert result.exit_code == 2
    said = " ".join(result.stderr.split())
    for word in (f"campaign.toml:{line}", "[simulator.fixed] peak_power", "-1.0", "1e-06 to 1e+09 W"):
        assert word in said, said


def test_a_radiometer_varies_weather_heading_and_receiver(tmp_path, tiny_scene):
    factors = {
        "altitude_m": "low = 500.0\nhigh = 1500.0",
        "heading_deg": 'unit = "deg"\nvalues = [0, 90, 270]',
        "weather": 'levels = ["clear", "rain"]',
        "receiver": 'levels = ["total_power", "dicke"]',
    }
    folder = make_tiny(tmp_path / "passive", tiny_scene, campaign(factors, RADIOMETER_FIXED, "prm"))
    found = document("check", folder)
    assert found["n_terms"] == 5
    assert "rain" in "\n".join(found["notes"])
    image = tmp_path / "i.npz"
    given = ("heading_deg=270", "weather=rain", "receiver=dicke", "altitude_m=600")
    made = document("image", folder, *(word for setting in given for word in ("--set", setting)), "--out", image)
    assert made["settings"] == {"altitude_m": 600.0, "heading_deg": 270.0, "weather": "rain", "receiver": "dicke"}


def test_every_parameter_is_listed():
    for engine, table in SENSORS.items():
        rows = document("parameters", engine)
        assert [row["name"] for row in rows] == list(table)
        altitude = next(row for row in rows if row["name"] == "altitude_m")
        assert (altitude["unit"], altitude["low"], altitude["required"], altitude["factor"]) == ("m", 1.0, True, True)
        listed = " ".join(seqrsm("parameters", engine).stdout.split())
        for row in table.values():
            assert f"- {row.name}: {row.what}; {row.allowed}" in listed
    assert "targets_file: CSV file of cultural targets; the path of a file; cannot be a factor" in " ".join(
        seqrsm("parameters", "psm").stdout.split()
    )
    refusal = seqrsm("parameters", "lidar")
    assert refusal.exit_code == 2
    assert "psm or prm" in refusal.stderr
