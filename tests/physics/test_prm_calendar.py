"""Fields that are early or late, as a radiometer meets them: against the table of other days, and their moisture."""

from __future__ import annotations

import math
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from prm_cases import radiometer, scene
from shorthands import still_radiometer

from seqrsm.scattering.calendar import SHIPPED, Calendar, fields_by_category, load_calendar
from seqrsm.scattering.emissivity import MOISTURE_NODES, load_emissivity_table
from seqrsm.scattering.worlds import World
from seqrsm.scene.scene import NO_COVER
from seqrsm.score.brightness import _covariance, _expected_lookups, expected_ground, retrieved_squares
from seqrsm.score.pixels import seen_pixels
from seqrsm.simulate.radiometer.occasion import Stages, draw_radiometer_occasion, stages_of
from seqrsm.simulate.radiometer.prm import simulate_radiometer
from seqrsm.simulate.visits import Visit, field_shift_days, year_shift_days

TABLE = load_emissivity_table()
COVERS = ("Wheat", "Corn", "Trees")
KEY = {"seed": 4, "run_id": 2}
SIDE = 6  # fields on a side
FIELD = np.kron(np.arange(SIDE**2).reshape(SIDE, SIDE), np.ones((10, 10), dtype=int))
KIND = np.random.default_rng(3).integers(0, len(COVERS), SIDE**2)
GROUND = scene(np.zeros(FIELD.shape), 25.0, KIND[FIELD], FIELD, COVERS)


def late_days():
    """Days by which the year of each field's cover and the field itself are late, as radars have them."""
    shift = np.array([fields_by_category()[COVERS[k]].shift_days for k in KIND])
    return year_shift_days(len(COVERS), **KEY)[KIND] + field_shift_days(shift, **KEY)


def emissivity(cover, channel, day):
    """At the middle moisture and 50 degrees."""
    look = TABLE.lookup((cover,), 1.4, channel, day=day)
    return np.interp(0.2, MOISTURE_NODES[: look.emissivity.shape[1]], look.emissivity[0, :, 50])


@pytest.mark.parametrize("day", [160.0, 205.0])
def test_a_late_field_emits_as_the_calendar_has_it_so_many_days_before(day):
    sensor = radiometer(
        frequency_ghz=1.4, channels=("H", "V"), resolution_m=30.0, conical_incidence_deg=50.0, altitude_m=3000.0,
        bandwidth_mhz=25.0, temperature="constant", atmosphere="none", soil_moisture_low=0.1, soil_moisture_high=0.3,
        scan_period_s=0.2, integration_time_ms=0.5, speed_m_s=60.0,
    )  # fmt: skip
    image = still_radiometer(GROUND, sensor, TABLE, visit=Visit((day,)), **KEY)
    middle = image.mean_k.reshape(2, -1)[:, image.pixel_of_cell[5::10, 5::10].ravel()]
    for channel, kelvin in zip("HV", middle, strict=True):
        # Shifts are told to 5 days.
        around = [
            [emissivity(COVERS[k], channel, day - late + off) for k, late in zip(KIND, late_days(), strict=True)]
            for off in (-2.5, 2.5)
        ]
        low, high = np.sort(2.7 + (sensor.temperature_low_k - 2.7) * np.array(around), axis=0)
        assert (kelvin > low - 1.0).all()
        assert (kelvin < high + 1.0).all()
        spread = [np.ptp(kelvin[cover == KIND]) for cover in range(3)]
        assert max(spread[:2]) > 10.0
        assert spread[2] < 0.5


def test_a_season_without_a_day_has_no_late_fields():
    stages = stages_of(GROUND, SHIPPED, Visit(), **KEY)
    assert (stages.categories, stages.day) == (COVERS, None)
    np.testing.assert_array_equal(stages.of_field, KIND)


def test_a_course_of_the_users_own_is_late_with_its_year():
    """Grass keeps one water all year, and its fields are on time; its course is the user's."""
    field = np.arange(64).reshape(8, 8)
    ground = scene(np.zeros(field.shape), 10.0, np.zeros(field.shape), field, ("Grass",))
    days = []
    for own in ({}, {"Grass": {"H": None}}):
        stages = stages_of(ground, Calendar(own), Visit((205.0,)), **KEY)
        days.append(stages.day[stages.of_field])
    np.testing.assert_array_equal(days[0], 205.0)
    np.testing.assert_allclose(days[1], 205.0 - year_shift_days(1, **KEY)[0], atol=2.5)
    assert np.abs(days[1] - 205.0).min() >= 5.0


@pytest.mark.parametrize(("n", "most_days"), [(30, 5.0), (60, 20.0), (200, 80.0)])
def test_many_late_covers_are_told_by_more_days(n, most_days):
    """No more stages than a byte holds, each within half a step of its fields' own day."""
    fields = 6000
    field = np.arange(fields).reshape(60, 100)
    ground = scene(np.zeros(field.shape), 10.0, field % n, field, tuple(f"crop {k}" for k in range(n)))
    calendar = SimpleNamespace(shift_days=lambda names: np.full(len(names), 8.0), emission_changes=bool)
    stages = stages_of(ground, calendar, Visit((180.0,)), **KEY)
    assert len(stages.categories) <= 255
    np.testing.assert_array_equal(stages.parent[stages.of_field], np.arange(fields) % n)
    late = year_shift_days(n, **KEY)[np.arange(fields) % n] + field_shift_days(np.full(fields, 8.0), **KEY)
    away = 180.0 - stages.day[stages.of_field] - late
    assert 2.5 < np.abs(away).max() <= most_days


def test_ground_of_another_cover_within_a_field_keeps_its_own():
    """Averaged cells may hold both."""
    cover = KIND[FIELD].copy()
    cover[0, 0] = 2 if KIND[0] != 2 else 0
    stages = stages_of(GROUND, SHIPPED, Visit((205.0,)), **KEY)
    found = stages.of_cells(cover.astype(np.uint8), FIELD)
    assert found[0, 0] == cover[0, 0]
    np.testing.assert_array_equal(stages.parent[found], cover)
    unknown = np.where(FIELD == 7, NO_COVER, KIND[FIELD])
    ground = scene(np.zeros(FIELD.shape), 25.0, unknown, FIELD, COVERS)
    assert stages_of(ground, SHIPPED, Visit((205.0,)), **KEY).of_field[7] == NO_COVER
    late = np.abs(late_days()[FIELD]) > 2.5
    late[0, 0] = False
    np.testing.assert_array_equal(found >= 3, late & (cover != 2))


@pytest.mark.parametrize("day", [185.0, 205.0])
def test_what_is_expected_of_late_fields_is_their_mean_and_scatter(day):
    """Against draws of years and fields, looked up one by one."""
    sensor = radiometer(frequency_ghz=1.4, channels=("H", "V"))
    lookups, of_fields, of_years = _expected_lookups(GROUND, sensor, TABLE, day)
    rng = np.random.default_rng(5)
    year, field = 7.0 * math.sqrt(2.0) * rng.standard_normal((400, 1)), 8.0 * rng.standard_normal((400, 100))
    days = np.arange(100.0, 310.0)
    drawn = []
    for channel in "HV":
        course = TABLE.lookup(("Wheat",) * len(days), 1.4, channel, day=days).emissivity[:, 6, 40]
        drawn.append(1.0 - np.interp(day - year - field, days, course))
    for c, d in ((0, 0), (0, 1), (1, 1)):
        together = drawn[c] * drawn[d]
        within = (together.mean(axis=1) - drawn[c].mean(axis=1) * drawn[d].mean(axis=1)).mean() * 100.0 / 99.0
        between = np.cov(drawn[c].mean(axis=1), drawn[d].mean(axis=1))[0, 1] - within / 100.0
        assert of_fields[c, d, 0, 6, 40] == pytest.approx(within, rel=0.06)
        assert of_years[c, d, 0, 6, 40] == pytest.approx(between, rel=0.2)
        assert 1.0 - lookups[c].emissivity[0, 6, 40] == pytest.approx(drawn[c].mean(), abs=0.005)
    np.testing.assert_allclose(of_fields[:, :, 2] + of_years[:, :, 2], 0.0, atol=1e-12)


def test_fields_that_are_on_time_vary_by_their_year_alone(tmp_path):
    """Grass, whose fields are, has a course of the user's."""
    own = "quantity,category,frequency_ghz,polarization,day,value,unit,status,source,mean_sd\n"
    own += "".join(f"emissivity,Grass,1.4,H,{d},{e},1,measured,mine,0.02\n" for d, e in ((60, 0.0), (250, -0.2)))
    (tmp_path / "own.csv").write_text(own)
    table = replace(TABLE, calendar=load_calendar(tmp_path / "own.csv"))
    ground = scene(np.zeros((4, 4)), categories=("Grass",))
    _, of_fields, of_years = _expected_lookups(ground, radiometer(frequency_ghz=1.4), table, 150.0)
    assert of_years[0, 0, 0, 0, 0] > 1e-6
    np.testing.assert_allclose(of_fields, 0.0, atol=1e-12)


def test_footprints_vary_by_late_fields_and_their_mean_by_late_years():
    """What is added to the covariance, of ground under one cover where no field is known."""
    field = np.arange(400).reshape(20, 20)
    ground = scene(np.zeros(field.shape), 200.0, np.zeros(field.shape), field, ("Wheat",))
    sensor = radiometer(frequency_ghz=1.4, channels=("H", "V"), resolution_m=200.0, conical_incidence_deg=40.0)
    image = still_radiometer(ground, sensor, TABLE, visit=Visit((205.0,)), **KEY)
    expected = expected_ground(image, ground, seen_pixels(image))
    none = replace(expected, of_fields=0.0 * expected.of_fields, of_years=0.0 * expected.of_years)
    slope = np.zeros((2, *expected.temperature_k.shape))
    inside = expected.share[..., 0] > 0.999
    kelvin = expected.air[1][:, None] * (expected.temperature_k - expected.air[2][:, None])
    for own, late in ((None, expected.of_years), (np.zeros(inside.shape), expected.of_fields)):
        with_late, without = (_covariance(image, one, slope, 0.2, own) for one in (expected, none))
        together = 1.0 if own is None else expected.footprints_a_piece
        for a, b in ((0, 0), (0, 1), (1, 1)):
            added = (with_late - without)[..., a, b] / (np.square(kelvin) * together)
            np.testing.assert_allclose(added[inside], late[a, b, 0, 6, 40], rtol=0.02)


def test_early_and_late_fields_depart_as_their_own_stage_does():
    """Emission of bare and covered fields of one crop, and of trees, has standard deviations of its own."""
    sensor, parts = radiometer(frequency_ghz=1.4, channels=("H",)), []
    for run in range(60):
        key = {"seed": 5, "run_id": run}
        stages = stages_of(GROUND, SHIPPED, Visit((205.0,)), **key)
        looked = [TABLE.lookup(stages.categories, 1.4, "H", day=stages.day)]
        met = draw_radiometer_occasion(sensor, looked, stages, GROUND, Visit((205.0,)), **key)
        own = looked[0].field_part[stages.of_field]
        parts.append(met.field_offset[0] / own)
        assert own.max() > 1.3 * own.min()
    for cover in range(3):
        assert np.std(np.array(parts)[:, cover == KIND]) == pytest.approx(1.0, abs=0.1)


def test_crops_that_leave_soil_bare_depart_on_a_date_as_bare_soil_does():
    """In April nothing but soil is seen of maize, as its weather left it; less of it once the canopy closes."""
    covers = ("Corn", "Bareground", "Trees")
    field = np.arange(9).reshape(3, 3)
    ground = scene(np.zeros(field.shape), 25.0, field % 3, field, covers)
    sensor, parts = radiometer(frequency_ghz=1.4, channels=("H", "V")), {}
    stages = Stages(covers, None, np.arange(3), np.arange(9, dtype=np.uint8) % 3)
    for visit in (Visit((100.0, 104.5)), Visit((100.0, 104.5), 1), Visit((150.0,))):
        looks = [
            replace(TABLE.lookup(covers, 1.4, c, day=visit.day), channel_correlation=np.full(3, 0.5)) for c in "HV"
        ]
        drawn = (
            draw_radiometer_occasion(sensor, looks, stages, ground, visit, seed=6, run_id=run) for run in range(400)
        )
        offset = np.array([one.class_offset for one in drawn]) / [look.date_part for look in looks]
        assert np.mean(offset[:, 0] * offset[:, 1]) == pytest.approx(0.5, abs=0.1)
        parts[visit.day] = offset[:, 0]
    few = 4.0 / math.sqrt(400.0)
    np.testing.assert_allclose(parts[100.0][:, 0], parts[100.0][:, 1], rtol=1e-12)
    assert np.mean(parts[100.0][:, 0] * parts[104.5][:, 0]) == pytest.approx(math.exp(-1.0), abs=few)
    shut = TABLE.lookup(("Corn",), 1.4, "H", day=150.0).closed[0]
    expected = [(1.0 - shut) / math.hypot(shut, 1.0 - shut), 0.0]
    found = [np.mean(parts[150.0][:, k] * parts[150.0][:, 1]) for k in (0, 2)]
    np.testing.assert_allclose(found, expected, atol=few)
    np.testing.assert_allclose(parts[150.0].std(axis=0), 1.0, atol=few)


def test_moisture_of_a_date_is_believed_as_far_as_late_fields_let():
    """Retrieved moisture is a mean given the image: the truth regressed on it has about the slope 1.

    Taken for on time, half-harvested wheat would be believed too far: 0.3.
    """
    field = np.kron(np.arange(256).reshape(16, 16), np.ones((10, 10), dtype=int))
    ground = scene(np.zeros(field.shape), 25.0, np.zeros(field.shape), field, ("Wheat",))
    sensor = radiometer(
        frequency_ghz=6.9, channels=("H", "V"), resolution_m=60.0, altitude_m=2000.0, bandwidth_mhz=25.0,
        scan_period_s=0.6, integration_time_ms=2.0,
    )  # fmt: skip
    slopes = []
    for run in range(12):
        table = TABLE.in_world(World(4, run))
        image = simulate_radiometer(ground, sensor, table, seed=4, run_id=run, visit=Visit((205.0,)))
        value, unit = retrieved_squares(image, ground)
        cells = unit >= 0
        count = np.bincount(unit[cells], minlength=len(value))
        truth = np.bincount(unit[cells], image.occasion.field_moisture[field[cells]], len(value))
        used = count > 0
        slopes.append(np.cov(value[used], truth[used] / count[used])[0, 1] / value[used].var())
    assert 0.5 < np.mean(slopes) < 1.25
