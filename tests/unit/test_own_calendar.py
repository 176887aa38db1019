"""A calendar of the user's own, and the shipped one moved to other ground: against what is given by hand."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.stats import norm
from shorthands import percent_correct

from seqrsm.errors import ScatteringDataError
from seqrsm.scattering.calendar import SHIPPED, level_days, load_calendar
from seqrsm.scattering.emissivity import load_emissivity_table
from seqrsm.scattering.sigma0 import load_sigma0_table
from seqrsm.scattering.worlds import World, course_deviation
from seqrsm.scene.scene import Scene
from seqrsm.sensor.radar import from_settings
from seqrsm.sensor.radiometer import RadiometerConfiguration
from seqrsm.simulate.radar import occasion
from seqrsm.simulate.radar.psm import simulate_radar
from seqrsm.simulate.radiometer.prm import check_radiometer
from seqrsm.simulate.visits import Visit

CROPS = ("Wheat", "Corn", "Vegetables", "Grass", "Trees")
TABLE = load_sigma0_table()
HEADER = "quantity,category,frequency_ghz,polarization,day,value,unit,status,source,mean_sd\n"


def calendar(tmp_path, rows, late_days=0):
    """A file of rows (quantity, category, GHz, channel, day, value, sd)."""
    unit = {"sigma0": "dB", "emissivity": "1"}
    text = [f"{q},{c},{f},{p},{d},{v},{unit[q]},measured,my plots,{sd}\n" for q, c, f, p, d, v, sd in rows]
    path = tmp_path / "calendar.csv"
    path.write_text(HEADER + "".join(text))
    return load_calendar(path, late_days)


def radar(**more):
    settings = {"frequency": 5.4, "polarization": "VV", "resolution": 20.0, "bandwidth": 100.0, "peak_power": 500.0}
    return from_settings({**settings, "depression_angle": 50.0}, {"altitude_m": 6000.0, **more})


def fields(covers, side=8, n=192) -> Scene:
    """Square fields of 80 m on flat ground, each cover as often as the next."""
    place = np.arange(n) // side
    number = (place[:, None] * (n // side) + place[None, :]).astype(np.int32)
    cover = np.random.default_rng(4).permutation(np.arange(number.max() + 1) % len(covers)).astype(np.uint8)[number]
    shape = (n, n)
    return Scene(np.zeros(shape, np.float32), cover, tuple(covers), number, np.ones(shape, np.bool_), 10.0)


@pytest.mark.parametrize("world", [None, World(5, 3)])
@pytest.mark.parametrize("late", [182, -183])
def test_a_moved_calendar_is_the_shipped_one_on_other_days(world, late):
    south = replace(TABLE, calendar=load_calendar(None, late), world=world)
    for frequency, channel in ((1.25, "HV"), (5.4, "VV")):
        for day in (15.0, 150.5, 300.0):
            own = south.lookup(CROPS, frequency, channel, day=day + late)
            shipped = TABLE.in_world(world).lookup(CROPS, frequency, channel, day=day)
            np.testing.assert_array_equal(own.sigma0, shipped.sigma0)
            np.testing.assert_array_equal(own.mean_sd_db, shipped.mean_sd_db)
    emission = load_emissivity_table().in_world(world)
    own = replace(emission, calendar=south.calendar).lookup(CROPS, 1.4, "H", day=200.0 + late)
    np.testing.assert_array_equal(own.emissivity, emission.lookup(CROPS, 1.4, "H", day=200.0).emissivity)


def test_a_season_of_the_south_scores_as_that_of_the_north_half_a_year_before():
    """November to February, over the new year, with the calendar 182 days later and the same draws."""
    scene, worlds = fields(CROPS[:4]), World(2, 9)
    north = tuple(130.0 + 24.0 * k for k in range(4))
    assert north[-1] + 182.0 > 365.0
    scores = []
    for late in (0, 182):
        table = replace(TABLE, calendar=load_calendar(None, late), world=worlds)
        days = tuple(day + late for day in north)
        images = [simulate_radar(scene, radar(), table, seed=2, run_id=1, visit=Visit(days, k)) for k in range(4)]
        scores.append(percent_correct(images, scene, seed=2, run_id=1).value)
    assert scores[0] == scores[1]


def test_an_own_course_is_what_its_rows_say_the_year_round(tmp_path):
    """Straight lines over days and over the logarithm of frequency, one year as the next; the shift leaves it alone."""
    rows = [("sigma0", "Corn", 5.0, "VV", d, v, 0.7) for d, v in ((345, 2.0), (15, -1.5), (100, 0.0), (200, 3.0))]
    rows += [("sigma0", "Corn", 10.0, "VV", d, 2.0, 1.1) for d in (1, 200)]
    table = replace(TABLE, calendar=calendar(tmp_path, rows, 100))
    level = TABLE.lookup(CROPS, 5.0, "VV")
    for day, value in ((15, -1.5), (200, 3.0), (57.5, -0.75), (365, 0.0), (362.5, 0.25), (727.5, 0.25)):
        found = table.lookup(CROPS, 5.0, "VV", day=day)
        change = 10.0 * np.log10(found.sigma0 / level.sigma0)
        np.testing.assert_allclose(change[1], value, atol=1e-9)  # at all angles
        assert found.mean_sd_db[1] == pytest.approx(np.hypot(level.mean_sd_db[1], 0.7))
    between = table.lookup(CROPS, np.sqrt(50.0), "VV", day=15).course
    assert between.change_db[1, 14] == pytest.approx(0.25)
    assert between.sd_db[1, 14] == pytest.approx(0.9)
    assert any("course of calendar.csv (measured: my plots)" in note for note in found.notes)
    assert "the built-in calendar of crops comes 100 days later (as configured)" in found.notes
    assert load_calendar(None, -9).notes((), "VV") == (
        "the built-in calendar of crops comes 9 days earlier (as configured)",
    )
    for near, far in ((2.51, 2.49), (19.9, 20.1)):  # held for an octave
        assert table.lookup(("Corn",), near, "VV", day=15).course.change_db[0, 14] == (-1.5 if near < 5.0 else 2.0)
        with pytest.raises(ScatteringDataError, match=f"within an octave of {far} GHz"):
            table.lookup(("Corn",), far, "VV", day=15)
    here, moved = (replace(TABLE, calendar=c).lookup(CROPS, 5.0, "VV", day=150) for c in (SHIPPED, table.calendar))
    assert here.sigma0[0, 40] != pytest.approx(table.lookup(CROPS, 5.0, "VV", day=150).sigma0[0, 40])
    assert here.sigma0[0, 40] == pytest.approx(table.lookup(CROPS, 5.0, "VV", day=250).sigma0[0, 40])
    assert moved.sigma0[1, 40] != here.sigma0[1, 40]


def test_worlds_depart_from_an_own_course_by_what_its_file_states(tmp_path):
    """On all days alike, in cover and year."""
    table = replace(TABLE, calendar=calendar(tmp_path, [("sigma0", "Corn", 5.4, "VV", d, 0.0, 0.7) for d in (1, 200)]))
    draws = np.array(
        [table.in_world(World(5, k)).lookup(("Corn",), 5.4, "VV", day=9).course.change_db[0] for k in range(600)]
    )
    np.testing.assert_allclose(draws.std(axis=0), 0.7, rtol=0.12)
    np.testing.assert_allclose(draws.mean(axis=0), 0.0, atol=0.12)


def test_an_own_course_of_emissivity_adds_to_the_table(tmp_path):
    rows = [("emissivity", "Corn", 1.4, "H", d, v, 0.01) for d, v in ((100, -0.04), (200, 0.02))]
    table = load_emissivity_table()
    own = replace(table, calendar=calendar(tmp_path, rows), mixes=table.mixes | {"Hops": {"Corn": 1.0}})
    level, found = table.lookup(("Corn",), 1.4, "H"), own.lookup(("Corn",), 1.4, "H", day=100)
    np.testing.assert_allclose(found.emissivity, np.clip(level.emissivity - 0.04, 0.0, 1.0))
    assert found.mean_sd[0] == pytest.approx(np.hypot(level.mean_sd[0], 0.01))
    bright = replace(table, calendar=calendar(tmp_path, [(*row[:5], 0.5, 0.01) for row in rows]))
    assert bright.lookup(("Corn",), 1.4, "H", day=9).emissivity.max() == 1.0
    for refused in (own.lookup, own.refuse):
        with pytest.raises(ScatteringDataError, match=r"the calendar has no V of Corn within an octave of 1\.4 GHz"):
            refused(("Corn",), 1.4, "V", day=100)
        with pytest.raises(ScatteringDataError, match="no calendar of this category"):
            refused(("Hops",), 1.4, "H", day=100)
    own.refuse(("Corn",), 1.4, "H", 100)
    radiometer = RadiometerConfiguration(1.4, ("V",), 200.0, 20.0, 20.0, 500.0, 2.0, 1000.0)
    with pytest.raises(ScatteringDataError, match="the calendar has no V"):  # before any run
        check_radiometer(fields(("Corn",)), radiometer, own, 100.0)


def test_ground_with_a_course_of_ones_own_hides_the_soil_unless_it_is_bare(tmp_path):
    rows = [("sigma0", name, 5.4, "VV", d, -1.0, "") for name in ("Bareground", "Corn") for d in (100, 200)]
    own = calendar(tmp_path, rows)
    course = replace(TABLE, calendar=own).lookup(("Bareground", "Corn"), 5.4, "VV", day=15.0).course
    np.testing.assert_array_equal(course.change_db, -1.0)
    np.testing.assert_array_equal(course.closed, np.outer([0.0, 1.0], np.ones(365)))
    np.testing.assert_array_equal(course.soil_share, 1.0 - course.closed)
    assert [own.closed(name, 15.0) for name in ("Bareground", "Corn")] == [0.0, 1.0]


def test_deviations_that_are_not_stated_are_those_of_the_least_known_shipped_course(tmp_path):
    rows = [("sigma0", "Corn", f, "VV", d, 0.0, "") for d in (100, 200) for f in (1.25, 9.6)]
    course = replace(TABLE, calendar=calendar(tmp_path, rows)).lookup(("Corn",), 1.25, "VV", day=100).course
    np.testing.assert_allclose(course.sd_db, 2.0)
    shipped = TABLE.lookup(CROPS, 1.25, "VV", day=100).course
    by_day = shipped.sd_db / course_deviation(level_days(1.25))
    assert by_day.max() == pytest.approx(2.0, abs=0.02)  # of cereals that hide 0.99 of the soil


def two_crops(tmp_path, monkeypatch, levels_db, rows):
    """A table of two crops of 1.5 dB from field to field, with courses, and nothing else that a date does to them."""
    for name, value in (("_WEATHER_DB", (0.0, 0.0)), ("_CROP_WEATHER_DB", (0.0, 0.0)), ("_YEAR_DB", 0.0)):
        monkeypatch.setattr(occasion, name, value)
    own = tmp_path / "own.csv"
    lines = ["quantity,category,frequency_ghz,polarization,theta_deg,value,unit,status,source,sd\n"]
    for name, level in levels_db.items():
        lines += [f"sigma0,{name},5.4,VV,{theta},{level},dB,measured,me,1.5\n" for theta in (20, 60)]
    own.write_text("".join(lines))
    return replace(load_sigma0_table(own), calendar=calendar(tmp_path, rows))


@pytest.mark.parametrize("difference", [0.0, 3.0])
def test_two_crops_a_known_difference_apart_are_told_apart_as_often_as_two_gaussians(tmp_path, monkeypatch, difference):
    """Of equal levels and 1.5 dB from field to field: right in norm.cdf(difference / 3 dB) of the fields."""
    rows = [("sigma0", "Soybean", 5.4, "VV", d, 0.0, 0.5) for d in (1, 200)]
    rows += [("sigma0", "Sorghum", 5.4, "VV", d, v, 0.5) for d, v in ((100, 3.0), (200, 3.0), (250, 0.0), (350, 0.0))]
    table = two_crops(tmp_path, monkeypatch, {"Soybean": -10.0, "Sorghum": -10.0}, rows)
    scene, visit = fields(("Soybean", "Sorghum")), Visit((150.0 if difference else 300.0,))
    still = radar(texture_db=0.0, looks=150)
    got = []
    for k in range(1, 15):
        image = simulate_radar(scene, still, table, seed=2, run_id=k, visit=visit)
        got.append(percent_correct([image], scene, by="field", seed=2, run_id=k).value)
    assert np.mean(got) == pytest.approx(100.0 * norm.cdf(difference / 3.0), abs=2.5)


def test_fields_that_forget_themselves_would_make_dates_look_better(tmp_path, monkeypatch) -> None:
    """Six dates of six days of crops 1.5 dB apart tell fields hardly better than one; drawn anew, as a mean of six."""
    rows = [("sigma0", name, 5.4, "VV", d, 0.0, 0.5) for name in ("Soybean", "Sorghum") for d in (1, 200)]
    table = two_crops(tmp_path, monkeypatch, {"Soybean": -10.0, "Sorghum": -8.5}, rows)
    scene, still = fields(("Soybean", "Sorghum")), radar(texture_db=0.0, looks=150)
    days = tuple(150.0 + k for k in range(6))

    def right(visits, run) -> float:
        images = [simulate_radar(scene, still, table, seed=2, run_id=key, visit=visit) for key, visit in visits]
        return percent_correct(images, scene, by="field", seed=2, run_id=run).value

    runs = range(1, 9)
    one = [right([(run, Visit(days[:1]))], run) for run in runs]
    kept = [right([(run, Visit(days, k)) for k in range(6)], run) for run in runs]
    anew = [right([(100 * run + k, Visit((day,))) for k, day in enumerate(days)], run) for run in runs]
    assert np.mean(one) == pytest.approx(100.0 * norm.cdf(0.5), abs=2.5)
    assert np.mean(kept) < np.mean(one) + 4.0
    assert np.mean(anew) == pytest.approx(100.0 * norm.cdf(0.5 * np.sqrt(6.0)), abs=2.5)


def wrong(tmp_path, text):
    path = tmp_path / "calendar.csv"
    path.write_text(text)
    with pytest.raises(ScatteringDataError) as told:
        load_calendar(path)
    return told.value.problems


@pytest.mark.parametrize(
    ("row", "field", "value"),
    [
        ("sigma,Corn,5.4,VV,9,1,dB,measured,me,", "quantity", "sigma"),
        ("sigma0,Corn,5.4,VV,366,1,dB,measured,me,", "day", "366"),
        ("sigma0,Corn,5.4,VV,1 May,1,dB,measured,me,", "day", "1 May"),
        ("sigma0,Corn,5.4,VV,9,1,1,measured,me,", "unit", "1"),
        ("sigma0,Corn,5.4,H,9,1,dB,measured,me,", "polarization", "H"),
        ("sigma0,Corn,5.4,VV,9,-60,dB,measured,me,", "value", "-60"),
        ("emissivity,Corn,1.4,H,9,1.2,1,measured,me,", "value", "1.2"),
        ("sigma0,Corn,5.4,VV,9,1,dB,known,me,", "status", "known"),
        ("sigma0,Corn,5.4,VV,9,1,dB,measured,,", "source", ""),
        ("sigma0,Corn,5.4,VV,9,1,dB,measured,me,-1", "mean_sd", "-1"),
    ],
)
def test_a_wrong_row_is_told_with_its_place(tmp_path, row, field, value):
    good = "sigma0,Corn,5.4,VV,100,1,dB,measured,me,\nsigma0,Corn,5.4,VV,200,1,dB,measured,me,\n"
    (problem,) = wrong(tmp_path, HEADER + good + row + "\n")
    assert (problem.line, problem.field, problem.value) == (4, field, value)
    assert problem.file == str(tmp_path / "calendar.csv")


def test_a_year_of_one_day_or_of_a_day_twice_is_refused(tmp_path):
    (once,) = wrong(tmp_path, HEADER + "sigma0,Corn,5.4,VV,9,1,dB,measured,me,\n")
    assert "Corn, 5.4 GHz, VV: 1 row, at least 2 are needed" in str(once)
    twice = wrong(
        tmp_path, HEADER + 2 * "sigma0,Corn,5.4,VV,9,1,dB,measured,me,\n" + "sigma0,Corn,5.4,VV,8,1,dB,measured,me,\n"
    )
    assert [problem.line for problem in twice] == [2, 3]
    (missing,) = wrong(tmp_path, HEADER.replace("day,", ""))
    assert (missing.field, missing.line) == ("day", 1)


def test_covers_may_each_be_looked_up_on_a_day_of_their_own(tmp_path):
    """As early and late fields are: each is as a look-up of that day has it."""
    course = [(60, 0.0), (150, -0.05), (250, -0.1)]
    own = calendar(tmp_path, [("emissivity", "Grass", 1.4, "H", day, value, 0.02) for day, value in course])
    table = replace(load_emissivity_table(), calendar=own)
    covers, days = ("Corn", "Wheat", "Corn", "Grass", "Grass"), (100.0, 205.0, 190.0, 100.0, 190.0)
    together = table.lookup(covers, 1.4, "H", day=days)
    for k, (cover, day) in enumerate(zip(covers, days, strict=True)):
        alone = table.lookup((cover,), 1.4, "H", day=day)
        n = alone.emissivity.shape[1]
        np.testing.assert_array_equal(together.emissivity[k, :n], alone.emissivity[0])
        for name in ("closed", "heating", "moist", "field_part", "date_part", "mean_sd", "channel_correlation"):
            np.testing.assert_array_equal(getattr(together, name)[k], getattr(alone, name)[0], err_msg=name)
    for name in ("emissivity", "closed", "heating", "field_part"):
        assert not np.array_equal(getattr(together, name)[0], getattr(together, name)[2])
    assert not np.array_equal(together.emissivity[3], together.emissivity[4])
