"""A campaign of dates and of sensors together, by its commands."""

from __future__ import annotations

import json
import re
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from commands import document, seqrsm
from PIL import Image
from test_any_factor import HEAD, SMALL, TAIL
from tiny_campaign import make_tiny

from seqrsm.campaign.check import combinations_of
from seqrsm.campaign.images import report_pictures
from seqrsm.campaign.rests_on import crop_calendar, mean_sds
from seqrsm.campaign.simulation import carry_out, files_of, task_of
from seqrsm.campaign.simulator_checks import not_to_be_used
from seqrsm.scattering.sigma0 import load_sigma0_table
from seqrsm.scene.file import load_scene, save_scene
from seqrsm.spec.read import load_spec

FACTORS = """
[[factor]]
name = "frequency"
levels = ["L", "C", "L+C"]
[[factor]]
name = "dates"
values = [1, 2, 3]
[[factor]]
name = "first_day"
low = 100.0
high = 180.0
[[factor]]
name = "C.resolution"
low = 20.0
high = 60.0

"""
FIXED = """polarization = "HH"
resolution = 40.0
interval_days = 20.0
bandwidth = 60.0
peak_power = 1000.0
depression_angle = 45.0
altitude_m = 6000.0

[simulator.members.C]
polarization = "VV+VH"

"""


def text(tail: str = TAIL) -> str:
    tail = tail.replace("max_runs = 40", "max_runs = 21")
    return HEAD + FACTORS + SMALL + re.sub(r"(?s)(\[simulator.fixed\]\n).*?\n\n", lambda found: found[1] + FIXED, tail)


@pytest.fixture
def folder(tmp_path, tiny_scene):
    return make_tiny(tmp_path / "sets", tiny_scene, text())


def test_a_campaign_of_dates_and_sets_runs_and_reports(folder) -> None:
    assert document("check", folder)["n_factors"] == 4
    assert seqrsm("run", folder).exit_code in (0, 3)
    found = document("fit", folder)
    steps = {(step["factor"], step["level"]) for step in found["steps"]}
    assert {("dates", 2.0), ("dates", 3.0)} <= steps
    assert len([factor for factor, _ in steps if factor == "frequency"]) == 2
    for step in found["steps"]:  # other sets of sensors are simulated over the same grounds, other dates are not
        assert (step["better_here"] is None) == (step["factor"] != "frequency")
    out = folder / "all.json"
    assert seqrsm("export", folder, out).exit_code == 0
    runs: list[dict[str, Any]] = json.loads(out.read_text(encoding="utf-8"))["runs"]
    for run in (run for run in runs if run["state"] == "scored"):
        made = run["scores"][0]["metadata"]["images"]
        settings = run["executed"] or run["proposed"]
        assert len(made) == settings["dates"] * (2 if settings["frequency"] == "L+C" else 1)
        assert made[0]["day"] == pytest.approx(settings["first_day"])
    page = folder / "r.html"
    assert seqrsm("report", folder, "--html", page).exit_code == 0
    shown = page.read_text(encoding="utf-8")
    assert "Crop calendar" in shown
    assert "Effect of changing one factor" in shown
    assert "Pr(better here)" in shown


def test_any_image_of_a_run_is_written(folder) -> None:
    chosen = ("--set", "frequency=L+C", "--set", "dates=2", "--set", "first_day=120", "--set", "C.resolution=20")
    shapes = []
    for number, member in ((1, "L, day 120"), (4, "C, day 140")):
        made = document("image", folder, *chosen, "--number", number, "--out", folder / f"{number}.npz")
        assert f"image {number} of 4: {member}" in made["summary"]
        shapes.append(made["shape"])
    assert shapes[1][1] > 1.5 * shapes[0][1]  # pixels of 20 m and of 40 m
    beyond = seqrsm("image", folder, *chosen, "--number", 5, "--out", folder / "5.npz")
    assert beyond.exit_code == 2
    assert "3 C, day 120, 4 C, day 140" in " ".join(beyond.stderr.split())


def test_the_calendar_is_what_is_simulated(folder) -> None:
    """Level and course of the report's picture are the table's backscatter of the day."""
    settings = {"frequency": "L+C", "dates": 2.0, "first_day": 120.0, "C.resolution": 30.0}
    found = crop_calendar(load_spec(folder), settings)
    assert found is not None
    assert (found.crops, found.channels, found.days) == (("Grass",), ("L HH", "C VV", "C VH"), (120.0, 140.0))
    table = load_sigma0_table()
    for row, (frequency, channel) in zip(found.sigma0_db, ((1.25, "HH"), (5.4, "VV"), (5.4, "HV")), strict=True):
        for day in (45, 120, 250):
            looked = table.lookup(("Grass",), frequency, channel, day=day).sigma0[0, 40]
            assert row[0, day - 1] == pytest.approx(10.0 * np.log10(looked), abs=1e-6)


def test_dates_of_more_than_a_year_are_refused_before_any_run(tmp_path, tiny_scene) -> None:
    late = text().replace("interval_days = 20.0", "interval_days = 180.0").replace("[1, 2, 3]", "[1, 2, 4]")
    folder = make_tiny(tmp_path / "late", tiny_scene, late)
    found = seqrsm("check", folder)
    assert found.exit_code == 2
    assert "span 540 days, more than one year of crops" in " ".join(found.stderr.split())


def beside_a_radiometer() -> str:
    passive = "[simulator.members.passive]\nengine = 'prm'\nfrequency = 1.4\npolarization = 'H'\nbandwidth = 25.0\n"
    passive += "noise_temperature = 500.0\nintegration_time = 10.0\nscan_period = 1.0\naltitude_m = 1500.0\n\n"
    return (
        text()
        .replace('"L+C"', '"L+C", "L+passive", "passive"')
        .replace("[simulator.members.C]", passive + "[simulator.members.C]")
    )


def test_the_deviation_of_a_mean_is_that_of_backscatter_beside_a_radiometer_too(tmp_path, tiny_scene) -> None:
    """Decibels and emissivities have no mean; a set of radiometers alone has the emissivity's, without unit."""
    spec = load_spec(make_tiny(tmp_path / "mixed", tiny_scene, beside_a_radiometer()))
    when = {"dates": 1.0, "first_day": 185.0, "C.resolution": 30.0}
    found = {name: mean_sds(spec, {"frequency": name, **when}) for name in ("L", "L+passive", "passive")}
    assert found["L+passive"] == found["L"]
    assert found["L"][1] == "dB"
    assert found["L"][0]["Trees"] == pytest.approx(2.5)  # an assumed mean
    sds, unit = found["passive"]
    assert (sds["Trees"], unit) == (pytest.approx(0.02, abs=0.011), "")


def test_the_report_tells_what_every_sensor_of_a_set_rests_on(tmp_path, tiny_scene) -> None:
    spec = load_spec(make_tiny(tmp_path / "both", tiny_scene, beside_a_radiometer()))
    own = {"dates": 1.0, "first_day": 120.0, "C.resolution": 30.0}
    chosen = {"At the optimum": {"frequency": "L+passive", **own}, "Worst of the region": {"frequency": "L", **own}}
    panels, _, notes = report_pictures(spec, chosen)
    assert "At the optimum: radiation by the Rayleigh-Jeans law" in notes
    assert "fading is independent between pixels and between channels" in notes
    titles = [f"At the optimum (image {k} of 2, {name}, day 120)" for k, name in ((1, "L"), (2, "passive"))]
    assert [one.title for one in panels] == [*titles, "Worst of the region"]
    # A footprint is no square: cells of the ground are shown, also where the campaign's engine is a radar's.
    scene = load_scene(tiny_scene)
    assert (panels[1].engine, panels[1].pixel_m) == ("prm", scene.cell_m)
    assert sorted(panels[1].greytone.shape[1:]) == sorted(scene.cover.shape)


def test_the_report_shows_the_first_image_of_every_sensor(tmp_path, tiny_scene) -> None:
    spec = load_spec(make_tiny(tmp_path / "both", tiny_scene, text()))
    settings = {"frequency": "L+C", "dates": 2.0, "first_day": 120.0, "C.resolution": 30.0}
    panels, _, _ = report_pictures(spec, {"At the optimum": settings})
    assert [(one.channels, one.title) for one in panels] == [
        (("HH",), "At the optimum (image 1 of 4, L, day 120)"),
        (("VV", "VH"), "At the optimum (image 3 of 4, C, day 120)"),
    ]
    assert panels[0].score == panels[1].score


@pytest.mark.parametrize(("sets", "n"), [(["L+C", "L+C+X"], 0), (["S+C"], 1), (["1.25+1.4", "1.4+1.25+C"], 1)])
def test_check_tells_of_bands_too_near_to_rest_on(tmp_path, tiny_scene, sets, n) -> None:
    """What near bands see differently is assumed, and with it what the second gains."""
    given = text().replace('["L", "C", "L+C"]', json.dumps(["C", *sets]))
    folder = make_tiny(tmp_path / "near", tiny_scene, given)
    found = [note for note in combinations_of(load_spec(folder)) if "octave" in note]
    assert len(found) == n
    assert all(note.endswith("assumed, and with it the gain of the second") for note in found)


@pytest.mark.parametrize(
    ("epsg", "dated", "expected"), [(32721, True, True), (32621, True, False), (32721, False, False)]
)
def test_check_tells_that_the_calendar_is_of_the_northern_hemisphere(
    tmp_path, tiny_scene, epsg, dated, expected
) -> None:
    """On day 15, wheat of the pampa is ripe; that of the calendar lies under the winter. EPSG 327xx is UTM south."""
    days = "first_day = 15.0\n" if dated else ""
    without_dates = re.sub(r"(?s)\[\[factor\]\]\nname = \"dates\".*?(?=\[\[factor\]\]\nname = \"C)", "", text())
    given = without_dates.replace("interval_days = 20.0\n", days)
    folder = make_tiny(tmp_path / "south", tiny_scene, given)
    (place,) = folder.glob("*.npz")
    save_scene(replace(load_scene(place), epsg=epsg), place)

    def northern() -> bool:
        return any(
            note.startswith("Grass: the built-in calendar") and "is of the northern hemisphere" in note
            for note in combinations_of(load_spec(folder))
        )

    assert northern() == expected
    if expected:  # with Grass in a calendar, or the built-in one moved, nothing is left to tell
        toml = folder / "campaign.toml"
        for shift, left in ((182, False), (-182, False), (150, False), (10, True), (-30, True), (364, True)):
            moved = given.replace('engine = "psm"', f'engine = "psm"\ncalendar_shift_days = {shift}')
            toml.write_text(moved, encoding="utf-8")
            assert northern() == left, f"{shift} days are {'no ' * left}half a year"
        (folder / "calendar.csv").write_text(CALENDAR, encoding="utf-8")
        toml.write_text(given.replace('engine = "psm"', 'engine = "psm"\ncalendar = "calendar.csv"'), encoding="utf-8")
        assert not northern()
        (folder / "calendar.csv").write_text(CALENDAR.replace("Grass", "Trees"), encoding="utf-8")
        assert northern()


CALENDAR = "quantity,category,frequency_ghz,polarization,day,value,unit,status,source\n" + "".join(
    f"sigma0,Grass,{f},{p},{day},{value},dB,assumed,by hand\n"
    for f, p in ((1.25, "HH"), (5.4, "VV"), (5.4, "HV"))
    for day, value in ((15, 0.5), (200, -1.5))
)


def with_calendar(tmp_path, tiny_scene, rows=CALENDAR, more=""):
    given = text().replace('engine = "psm"', f'engine = "psm"\ncalendar = "calendar.csv"{more}')
    folder = make_tiny(tmp_path / "calendar", tiny_scene, given)
    (folder / "calendar.csv").write_text(rows, encoding="utf-8")
    return folder


def test_a_phase_is_simulated_and_has_no_calendar_of_its_own(folder) -> None:
    settings = {"frequency": "L", "dates": 2.0, "first_day": 120.0, "C.resolution": 30.0}
    toml = folder / "campaign.toml"
    toml.write_text(toml.read_text("utf-8").replace('polarization = "HH"', 'polarization = "HH+VV+phase"'), "utf-8")
    found = crop_calendar(load_spec(folder), settings)
    assert found is not None
    assert found.channels == ("L HH", "L VV")
    made = document(
        "image", folder, *(f"--set={name}={value}" for name, value in settings.items()), "--out", folder / "i.npz"
    )
    assert "polarization HH+VV+phase" not in made["summary"]  # it is fixed
    with np.load(folder / "i.npz") as image:
        assert image["channels"].tolist() == ["HH", "VV", "HH+VV", "HH+iVV"]
    shown = seqrsm(
        "image", folder, *(f"--set={name}={value}" for name, value in settings.items()), "--out", folder / "i.png"
    )
    assert "shown are HH, VV, HH+VV, the .tif and the .npz hold HH, VV, HH+VV and HH+iVV" in " ".join(
        shown.stderr.split()
    )
    with Image.open(folder / "i.png") as composite:
        assert composite.mode == "RGB"


@pytest.mark.parametrize(("level", "n"), [("passive", 1), ("X", 0)])
def test_check_tells_that_radars_and_radiometers_are_scored_over_other_ground(tmp_path, tiny_scene, level, n) -> None:
    """Errors over bare fields and over squares of 250 m have other guesses to be held against."""
    toml = beside_a_radiometer().replace('"percent_correct"', '"soil_moisture_error"').replace('"L+passive", ', "")
    toml = toml.replace("\n[simulator.members.", "\nsoil_moisture_field_sd = 0.04\n[simulator.members.", 1)
    if level != "passive":
        toml = re.sub(r"(?s)\[simulator.members.passive\].*?\n\n", "", toml).replace('"passive"', f'"{level}"')
    notes = combinations_of(load_spec(make_tiny(tmp_path / "two", tiny_scene, toml)))
    assert len([note for note in notes if "squares of 250 m" in note]) == n


def test_ground_that_a_level_sees_as_moist_as_any_other_is_refused_before_runs(tmp_path, tiny_scene) -> None:
    """The centre of the region was scored, and `run` made run after run at another level, none of which was."""
    toml = text().replace('"percent_correct"', '"soil_moisture_error"')
    toml = toml.replace('polarization = "VV+VH"\n', 'polarization = "VV+VH"\nsoil_moisture_field_sd = 0.04\n')
    refused = seqrsm("check", make_tiny(tmp_path / "c", tiny_scene, toml))
    assert refused.exit_code == 2
    told = " ".join(refused.stderr.split())
    assert "all the ground of a run has the same soil moisture. Let fields differ: set soil_moisture_field_sd" in told
    assert "for instance at frequency L, dates 1" in told


def test_a_calendar_of_the_user_s_is_simulated_reported_and_watched(tmp_path, tiny_scene) -> None:
    folder = with_calendar(tmp_path, tiny_scene)
    found = document("check", folder)
    assert "Grass HH: course of calendar.csv (assumed: by hand)" in "\n".join(found["notes"])
    settings = {"frequency": "C", "dates": 1.0, "first_day": 120.0, "C.resolution": 30.0}
    drawn = crop_calendar(load_spec(folder), settings)
    assert drawn is not None
    assert np.ptp(drawn.sigma0_db[0, 0]) == pytest.approx(2.0)
    late = crop_calendar(load_spec(folder), {**settings, "dates": 2.0, "first_day": 350.0})
    assert late is not None
    assert late.days == (350.0, 5.0)  # 20 days later
    assert seqrsm("run", folder).exit_code in (0, 3)
    (folder / "calendar.csv").write_text(CALENDAR.replace("-1.5", "-2.5"), encoding="utf-8")
    stopped = seqrsm("run", folder)
    assert stopped.exit_code == 2
    assert "calendar.csv: the file differs from the one earlier runs" in " ".join(stopped.stderr.split())
    (folder / "calendar.csv").write_text(CALENDAR, encoding="utf-8")
    toml = folder / "campaign.toml"
    toml.write_text(toml.read_text().replace('engine = "psm"', 'engine = "psm"\ncalendar_shift_days = 182'))
    moved = seqrsm("run", folder)
    assert moved.exit_code == 2
    assert "calendar_shift_days was not given for earlier runs and is now 182" in " ".join(moved.stderr.split())


def test_faults_of_a_calendar_are_told_before_any_run(tmp_path, tiny_scene) -> None:
    """A wrong row, a channel that it lacks, a cover that the scene lacks, a shift of more than a year, no file."""
    folder = with_calendar(tmp_path, tiny_scene, CALENDAR.replace("200,-1.5", "1 May,-1.5", 1))
    for command in ("check", "run"):
        stopped = seqrsm(command, folder)
        assert stopped.exit_code == 2
        assert "calendar.csv:3: day: not a number from 1 to 365 (got '1 May')" in " ".join(stopped.stderr.split())
    assert not any(document("status", folder)["runs"].values())
    (folder / "calendar.csv").write_text(CALENDAR.replace(",HV,", ",HH,"), encoding="utf-8")
    stopped = seqrsm("check", folder)
    assert stopped.exit_code == 2
    assert "the calendar has no HV of Grass within an octave of 5.4 GHz" in " ".join(stopped.stderr.split())
    own = "quantity,category,frequency_ghz,polarization,theta_deg,value,unit,status,source\n" + "".join(
        f"sigma0,Hops,{f},{p},{theta},-12,dB,assumed,by hand\n"
        for f, p in ((1.25, "HH"), (5.4, "VV"), (5.4, "HV"))
        for theta in (20, 60)
    )
    (folder / "own.csv").write_text(own, encoding="utf-8")
    (place,) = folder.glob("*.npz")
    scene = load_scene(place)
    save_scene(replace(scene, categories=("Hops", *scene.categories[1:])), place)
    hops = text().replace('engine = "psm"', 'engine = "psm"\ntable = "own.csv"')
    (folder / "campaign.toml").write_text(hops, encoding="utf-8")
    stopped = seqrsm("check", folder)
    assert stopped.exit_code == 2
    said = " ".join(stopped.stderr.split())
    assert (
        "[simulator] scene: no calendar of this category (got 'Hops'). Leave first_day out, or add its rows to" in said
    )
    save_scene(scene, place)
    (folder / "campaign.toml").write_text(
        text().replace('engine = "psm"', 'engine = "psm"\ncalendar = "calendar.csv"'), encoding="utf-8"
    )
    (folder / "calendar.csv").write_text(CALENDAR + CALENDAR.replace("Grass", "Soybean").partition("\n")[2])
    idle = "rows of calendar.csv for Soybean have no effect: the scene has Grass, Trees"
    assert any(note.startswith(idle) for note in document("check", folder)["combinations"])
    toml = folder / "campaign.toml"
    dateless = text().replace('engine = "psm"', 'engine = "psm"\ncalendar_shift_days = 182')
    for factor in ('name = "dates"\nvalues = [1, 2, 3]\n', 'name = "first_day"\nlow = 100.0\nhigh = 180.0\n'):
        dateless = dateless.replace(f"[[factor]]\n{factor}", "")
    toml.write_text(dateless.replace("interval_days = 20.0", ""), encoding="utf-8")
    assert (
        "the calendar has no effect, as there are no dates: give first_day" in document("check", folder)["combinations"]
    )
    for given, words in (("calendar_shift_days = 400", "calendar_shift_days"), ("", "there is no such file")):
        toml.write_text(text().replace('engine = "psm"', f'engine = "psm"\ncalendar = "other.csv"\n{given}'))
        stopped = seqrsm("check", folder)
        assert stopped.exit_code == 2
        assert words in stopped.stderr


def test_a_warning_names_the_sensor_of_the_set_that_sees_nothing(tmp_path, tiny_scene) -> None:
    """Both do here, and are told apart; sensors that are not of the recommended set are not told of."""
    weak = text().replace("peak_power = 1000.0", "peak_power = 1e-6")
    spec = load_spec(make_tiny(tmp_path / "weak", tiny_scene, weak))
    own = {"dates": 2.0, "first_day": 120.0, "C.resolution": 30.0}
    both = not_to_be_used(spec, {"frequency": "L+C", **own})
    starts = [f"Sensor {name} at these settings: the echo is weaker than the receiver's noise" for name in ("L", "C")]
    assert [told.partition(": every cover")[0] for told in both] == starts
    (alone,) = not_to_be_used(spec, {"frequency": "L", **own})
    assert alone.startswith(starts[0])


@pytest.mark.parametrize("key", ["[simulator.members.C]\ntargets_file", '"C.targets_file"', "targets_file"])
def test_a_file_of_a_member_lies_in_the_campaign_s_folder_and_is_watched(
    tmp_path, tiny_scene, monkeypatch, key
) -> None:
    """Read from where the command runs it was not found, or another; and a change of it went unseen."""
    monkeypatch.chdir(tmp_path)
    given = text().replace(
        "interval_days = 20.0", "interval_days = 20.0\n" + ("" if "[" in key else f"{key} = 't.csv'")
    )
    folder = make_tiny(
        tmp_path / "files",
        tiny_scene,
        given.replace("[simulator.members.C]", f"{key} = 't.csv'") if "[" in key else given,
    )
    (folder / "t.csv").write_text("row,column,cross_section_dbm2\n5,5,40\n", encoding="utf-8")
    spec = load_spec(folder)
    when = {"frequency": "L+C", "dates": 1.0, "first_day": 185.0, "C.resolution": 30.0}
    task = task_of(spec, 1, when)
    radars = {one.member: one.sensor.targets_file for one in task.acquisitions}
    assert radars["C"] == str(folder / "t.csv")
    assert str(folder / "t.csv") in files_of(task)
    assert carry_out(task).failure == ""
