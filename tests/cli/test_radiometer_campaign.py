"""A radiometer campaign through the command line: files beside campaign.toml, two utilities."""

from __future__ import annotations

import json
import re
import warnings
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from commands import call

from seqrsm.campaign.check import combinations_of
from seqrsm.campaign.simulator_checks import check_simulator
from seqrsm.scattering.emissivity import load_emissivity_table
from seqrsm.scene.file import load_scene, save_scene
from seqrsm.scene.scene import Scene
from seqrsm.spec.read import load_spec

pytestmark = pytest.mark.usefixtures("few_draws")

TOML = """\
[campaign]
name = "moisture"
seed = 5

[[factor]]
name = "frequency"
low = 1.4
high = 6.0
scale = "log"

[[factor]]
name = "resolution"
low = 20.0
high = 80.0
scale = "log"

[[application]]
name = "moisture"
utility = "soil_moisture_error"
goal = "minimize"

[[application]]
name = "water"
utility = "f1 of Water"
half_width = 3.0

[simulator]
engine = "prm"
scene = "scene.npz"

[simulator.fixed]
polarization = "H+V"
bandwidth = 300.0
noise_temperature = 300.0
integration_time = 0.3
scan_period = 0.3
altitude_m = 1000.0
speed_m_s = 100.0

[stop]
interval = "prediction_mean"
half_width = 3.0
max_runs = 20
"""
ROWS = "quantity,category,frequency_ghz,polarization,theta_deg,value,unit,status,source\n" + "".join(
    f"emissivity,Grass,{f},{p},{theta},{e},1,measured,mine\n"
    for f in (1.0, 10.0)
    for p in "HV"
    for theta, e in ((0, 0.30), (80, 0.29))
)


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    """Fields of bare soil and grass and some water, 600 m x 800 m, flat."""
    rng = np.random.default_rng(9)
    cover = np.kron(rng.choice(3, (12, 16), p=[0.5, 0.3, 0.2]), np.ones((5, 5), dtype=int)).astype(np.uint8)
    field = np.kron(np.arange(12 * 16).reshape(12, 16), np.ones((5, 5), dtype=int)).astype(np.int32)
    flat = np.zeros(cover.shape, dtype=np.float32)
    names = ("Bareground", "Grass", "Water")
    save_scene(Scene(flat, cover, names, field, flat == 0.0, 10.0), tmp_path / "scene.npz")
    (tmp_path / "campaign.toml").write_text(TOML, encoding="utf-8")
    return tmp_path


def layer(folder: Path, name: str) -> np.ndarray:
    with np.load(folder / "image.npz") as archive:
        return archive[name]


def image(folder: Path, *settings: str) -> dict:
    return json.loads(call("image", folder, *settings, "--out", folder / "image.npz", "--json").stdout)


def test_moisture_and_water_run_from_check_to_fit(folder):
    assert json.loads(call("check", folder, "--json").stdout)["seconds_per_run"] > 0.0
    outcome = json.loads(call("run", folder, "--max-runs", "14", "--json", code=3).stdout)
    assert not outcome["held"]
    found = json.loads(call("fit", folder, "--json").stdout)["applications"]
    assert len(found) == 2
    low = image(folder, "--set", "frequency=1.4", "--set", "resolution=20")["scores"]
    high = image(folder, "--set", "frequency=6.0", "--set", "resolution=80")["scores"]
    # Moisture is seen best at L band, water by the finest beam: known before the fit.
    assert low["moisture"] < high["moisture"]
    assert low["water"] > high["water"]


def test_a_table_of_ones_own_and_a_measured_beam_lie_beside_the_campaign(folder, monkeypatch):
    shipped = image(folder)
    text = TOML.replace('scene = "scene.npz"', 'scene = "scene.npz"\ntable = "emissivity.csv"')
    (folder / "campaign.toml").write_text(text, encoding="utf-8")
    call("check", folder, code=2)
    (folder / "emissivity.csv").write_text(ROWS, encoding="utf-8")
    # Grass of emissivity 0.30 leaves 90 K of some 300 K: told from bare soil at a glance.
    own = image(folder)
    coldest = np.nanmin(layer(folder, "brightness_k"))
    assert coldest < 110.0
    # The same draws: of grass by as much emissivity at nadir, which is less of what it reflects.
    met, table = (one["record"]["occasion"] for one in (own, shipped))
    assert met | {"class_offset": 0, "field_offset_sd": 0} == table | {"class_offset": 0, "field_offset_sd": 0}
    reflected = 1.0 - load_emissivity_table().lookup(["Grass"], own["settings"]["frequency"], "H").emissivity[0, 6, 0]
    for p in "HV":
        parts, known = met["class_offset"][p], table["class_offset"][p]
        assert parts.pop("Grass") * 0.7 == pytest.approx(known.pop("Grass") * reflected, abs=1e-5)
        assert parts == known
    assert any("mine" in note for note in own["notes"])
    # The path is from the campaign's folder, wherever the command is called.
    beam = "\n".join(f"{u},{np.exp(-4 * np.log(2) * u * u)}" for u in np.linspace(-1.75, 1.75, 60))
    (folder / "beam.csv").write_text(f"angle_beamwidths,gain\n{beam}\n", encoding="utf-8")
    measured = 'beam = "measured"\nbeam_file = "beam.csv"\npolarization = "H+V"'
    (folder / "campaign.toml").write_text(text.replace('polarization = "H+V"', measured), encoding="utf-8")
    monkeypatch.chdir(folder.parent)
    image(folder)
    np.testing.assert_allclose(np.nanmin(layer(folder, "brightness_k")), coldest, atol=0.5)


def test_check_names_covers_of_a_table_that_the_scene_has_not(folder):
    text = TOML.replace('scene = "scene.npz"', 'scene = "scene.npz"\ntable = "emissivity.csv"')
    (folder / "campaign.toml").write_text(text, encoding="utf-8")
    for rows, idle in ((ROWS, 0), (ROWS.replace("Grass", "Gras"), 1)):
        (folder / "emissivity.csv").write_text(rows, encoding="utf-8")
        notes = check_simulator(load_spec(folder))
        told = [note for note in notes if note.startswith("rows of emissivity.csv for Gras have no effect: ")]
        assert len(told) == idle


def test_faults_of_these_files_are_told_with_their_place(folder):
    text = TOML.replace('scene = "scene.npz"', 'scene = "scene.npz"\ntable = "emissivity.csv"')
    (folder / "campaign.toml").write_text(text, encoding="utf-8")
    assert "emissivity.csv" in call("check", folder, code=2).output
    (folder / "emissivity.csv").write_text(ROWS.replace("0.3,1", "1.3,1", 1), encoding="utf-8")
    assert "emissivity.csv:2" in call("check", folder, code=2).output.replace("\n", "")


def test_check_says_which_combinations_leave_gaps(folder):
    # 100 m/s and half of 1 s: sweeps 50 m apart, gaps for footprints of less.
    text = TOML.replace("scan_period = 0.3", "scan_period = 1.0")
    (folder / "campaign.toml").write_text(text, encoding="utf-8")
    gaps = [note for note in combinations_of(load_spec(folder)) if note.startswith("gaps")]
    assert len(gaps) == 1
    # Of three levels of resolution, 20, 40 and 80 m, two leave gaps, whatever the frequency.
    assert gaps[0].startswith("gaps at nadir at 6 of 9 settings")
    assert "resolution 20 m" in gaps[0]
    assert "gaps at nadir at 6 of 9" in call("check", folder).output
    refused = text.replace('polarization = "H+V"', 'polarization = "H+V"\ngaps = "refuse"')
    (folder / "campaign.toml").write_text(refused, encoding="utf-8")
    assert "gaps at nadir" in call("check", folder, code=2).output.replace("\n", " ")


def test_temperature_is_a_layer_of_the_data_base(folder):
    def antenna_k(temperature: str) -> np.ndarray:
        fixed = f'polarization = "H+V"\n{temperature}'
        (folder / "campaign.toml").write_text(TOML.replace('polarization = "H+V"', fixed), encoding="utf-8")
        call("image", folder, "--out", folder / "image.npz")
        return layer(folder, "mean_k")

    assert "no layer of temperature" in call(
        "image", write_layer(folder, None), "--out", folder / "i.npz", code=2
    ).output.replace("\n", " ")
    same = antenna_k('temperature = "constant"\ntemperature_low_k = 290.0')
    write_layer(folder, 290.0)
    np.testing.assert_array_equal(antenna_k('temperature = "layer"'), same)
    write_layer(folder, 320.0)
    # Each footprint is warmer by its emissivity times 30 K.
    warmer = antenna_k('temperature = "layer"') - same
    assert 30.0 * 0.3 < warmer.min() < warmer.max() < 30.0
    assert "320.0 to 320.0 K" in call("scene", "show", folder / "scene.npz").output


def write_layer(folder: Path, kelvin: float | None) -> Path:
    """The scene with one temperature everywhere, and a campaign that asks for the layer."""
    scene = load_scene(folder / "scene.npz")
    layer = None if kelvin is None else np.full(scene.shape, kelvin, dtype=np.float32)
    save_scene(replace(scene, temperature_k=layer), folder / "scene.npz")
    fixed = 'polarization = "H+V"\ntemperature = "layer"'
    (folder / "campaign.toml").write_text(TOML.replace('polarization = "H+V"', fixed), encoding="utf-8")
    return folder


def test_all_seven_passive_parameters_may_be_factors(folder):
    ranges = {
        "frequency": (1.4, 36.0),
        "resolution": (30.0, 80.0),
        "integration_time": (0.1, 0.3),
        "bandwidth": (20.0, 300.0),
        "noise_temperature": (100.0, 800.0),
        "scan_period": (0.3, 0.6),
    }
    factors = "".join(f'[[factor]]\nname = "{n}"\nlow = {a}\nhigh = {b}\n\n' for n, (a, b) in ranges.items())
    factors += '[[factor]]\nname = "polarization"\nlevels = ["H", "V", "H+V"]\n\n'
    head, _, rest = TOML.partition("[[factor]]")
    tail = "[[application]]" + rest.partition("[[application]]")[2]
    for name in (*ranges, "polarization"):
        tail = "\n".join(line for line in tail.splitlines() if not line.startswith(f"{name} ="))
    text = (
        head + factors + tail.replace("half_width = 3.0", "half_width = 90.0").replace("max_runs = 20", "max_runs = 40")
    )
    (folder / "campaign.toml").write_text(text + "\n[model]\norder = 1\n", encoding="utf-8")
    assert set(json.loads(call("status", folder, "--json").stdout)["units"]) == {*ranges, "polarization"}
    # Each one moves the noise of a footprint, or what the picture shows of the ground, as its formula says.

    def nedt(**changes: float) -> float:
        given = {**{name: a for name, (a, _) in ranges.items()}, **changes}
        settings = [word for name, value in given.items() for word in ("--set", f"{name}={value}")]
        return image(folder, *settings, "--set", "polarization=V")["record"]["nedt_k"][0]

    first = nedt()
    assert nedt(integration_time=0.3) == pytest.approx(first / 3.0**0.5, rel=2e-3)
    assert nedt(bandwidth=300.0) == pytest.approx(first / 15.0**0.5, rel=2e-3)
    # The system's temperature is the receiver's plus the antenna's, 200 to 280 K of land by how wet it is.
    antenna = (800.0 - 100.0) / (nedt(noise_temperature=800.0) / first - 1.0) - 100.0
    assert 200.0 < antenna < 300.0
    # Twice the period: sweeps twice as far apart, half as many of them in a line of 30 m.
    assert nedt(scan_period=0.6) == pytest.approx(first * 2.0**0.5, rel=0.03)


def test_greytone_and_geotiff_tell_the_same_temperatures(folder):
    import tifffile
    from PIL import Image

    text = TOML.replace('polarization = "H+V"', 'polarization = "V"')
    (folder / "campaign.toml").write_text(text, encoding="utf-8")
    for suffix in ("png", "npz", "tif"):
        call("image", folder, "--out", folder / f"image.{suffix}")
    with np.load(folder / "image.npz") as archive:
        arrays = {name: archive[name] for name in ("brightness_k", "pixel_of_cell")}
    kelvin = arrays["brightness_k"][0].astype(np.float64)
    # Eq. (3-50) with the black end as known emitter: grey tone 0 at T_a1, the density's range spread over 255.
    black, white = np.quantile(kelvin[np.isfinite(kelvin)], [0.02, 0.98])
    tone = np.clip(255.0 / np.log10(white / black) * np.log10(kelvin / black), 0.0, 255.0)
    with Image.open(folder / "image.png") as picture:
        np.testing.assert_allclose(np.asarray(picture, dtype=float), np.nan_to_num(np.rint(tone)), atol=1.0)
    cells = np.squeeze(tifffile.imread(folder / "image.tif"))
    footprint = arrays["pixel_of_cell"]
    np.testing.assert_allclose(cells[footprint >= 0], kelvin.ravel()[footprint[footprint >= 0]], rtol=1e-6)


def test_a_picture_of_noise_alone_says_nothing_about_logarithms(folder):
    text = TOML.replace('polarization = "H+V"', 'polarization = "V"\ntemperature = "layer"')
    text = re.sub(r"noise_temperature = .*", "noise_temperature = 1e5", text)
    (folder / "campaign.toml").write_text(text, encoding="utf-8")
    place = text.splitlines().index('temperature = "layer"') + 1
    assert f"campaign.toml:{place}: " in call("image", folder, "--out", folder / "i.png", code=2).stderr
    (folder / "campaign.toml").write_text(text.replace('"layer"', '"constant"'), encoding="utf-8")
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        call("image", folder, "--out", folder / "i.png")


def test_sensors_that_moisture_is_not_retrieved_by_together_are_refused_before_any_simulation(folder, monkeypatch):
    text = TOML.replace('low = 1.4\nhigh = 6.0\nscale = "log"', 'levels = ["L", "C", "L+C"]')
    dates = "[simulator.members.L]\nfirst_day = 120.0\n[simulator.members.C]\nfirst_day = 121.0\n"
    enough = text.replace("max_runs = 20", "max_runs = 30")
    (folder / "campaign.toml").write_text(enough + dates, encoding="utf-8")
    told = combinations_of(load_spec(folder))  # of what the message below proposes
    assert any(one.startswith("idle time at 9 of 9 settings") for one in told)
    (folder / "campaign.toml").write_text(text, encoding="utf-8")
    monkeypatch.setattr("seqrsm.campaign.simulation.carry_out", None)
    for command in ("check", "run"):
        output = " ".join(call(command, folder, code=2).output.split())
        assert "not by a combination" in output
        assert "Let each set hold radars only, or one radiometer" in output
        assert "frequency L+C" in output


def test_an_error_is_made_small_and_has_a_unit(folder):
    text = TOML.replace('utility = "soil_moisture_error"\ngoal = "minimize"', 'utility = "soil_moisture_error"')
    text = text.replace("f1 of Water", "area_error of Water")
    (folder / "campaign.toml").write_text(text, encoding="utf-8")
    spec = load_spec(folder)
    assert [(one.goal, one.score_unit) for one in spec.applications] == [("minimize", "m3/m3"), ("minimize", "percent")]
    wrong = text.replace('utility = "soil_moisture_error"', 'utility = "soil_moisture_error"\ngoal = "maximize"')
    (folder / "campaign.toml").write_text(wrong, encoding="utf-8")
    line = wrong[: wrong.index('goal = "maximize"')].count("\n") + 1
    output = call("check", folder, code=2).output
    assert f"campaign.toml:{line}: application 'moisture': goal: the utility is an error" in output
    assert 'Write goal = "minimize"' in output


def test_the_interval_of_the_mean_that_decides_has_table_uncertainty_wherever_it_is_told(folder):
    """What is held against the target is the mean over one ground; the mean over all has sampling error alone."""
    water = TOML[TOML.index('[[application]]\nname = "water"') : TOML.index("[simulator]")]
    text = TOML.replace(water, "").replace('"prediction_mean"', '"confidence"').replace("width = 3.0", "width = 0.2")
    (folder / "campaign.toml").write_text(text, encoding="utf-8")
    call("run", folder)
    found = json.loads(call("fit", folder, "--json").stdout)
    told, best = found["stop"]["half_width"], found["optimum"]
    parts = (best["confidence"]["half_width"], best["ground"]["half_width"])
    assert told == pytest.approx(np.hypot(*parts))
    assert parts[1] > 0.1 * told
    line = f"confidence interval of the mean over one ground: \u00b1 {told:#.3g} m3/m3, target"
    assert line in call("status", folder).stdout
    shown = call("fit", folder).stdout
    assert "Mean score over one ground" in shown
    assert "Mean score, sampling error only" not in shown
