"""The state of the ground of a run: spreads, correlation, and what the draws depend on."""

from __future__ import annotations

import json
from types import SimpleNamespace

import numpy as np
import pytest

from seqrsm.scattering.sigma0 import load_sigma0_table
from seqrsm.sensor.radar import from_settings
from seqrsm.simulate.radar.occasion import draw_ground_state, draw_occasion, nominal_ground_state
from seqrsm.simulate.visits import ONCE, Visit, related_fields


def radar(polarization):
    settings = {"frequency": 5.3, "polarization": polarization, "resolution": 20, "bandwidth": 50}
    return from_settings({**settings, "peak_power": 1.0, "depression_angle": 45.0}, {"altitude_m": 6000.0})


def lookup(field_sd=(1.5, 0.5), date_sd=(2.0, 1.0), correlation=0.6):
    return SimpleNamespace(
        sigma0=np.ones((2, 91)),
        field_sd_db=np.array(field_sd),
        date_sd_db=np.array(date_sd),
        channel_correlation=correlation,
        closed=np.ones(2),
        course=None,
        of_fields_db=lambda _: (np.array(field_sd), np.zeros(2)),
    )


fields_of_two = np.tile(np.array([0, 1, 255], dtype=np.uint8), 20_000)


def test_fields_spread_as_the_table_says():
    o = draw_occasion(radar("HH+VV"), [lookup(), lookup()], fields_of_two, (0.2, 5.0), ONCE, seed=1, run_id=1)
    n = 20_000
    for c in range(2):
        for k, sd in ((0, 1.5), (1, 0.5)):
            x = o.field_offset_db[c, fields_of_two == k]
            assert x.mean() == pytest.approx(0.0, abs=4.5 * sd / np.sqrt(n))
            assert x.std() == pytest.approx(sd, rel=4.5 / np.sqrt(2 * n))
        assert (o.field_offset_db[c, fields_of_two == 255] == 0.0).all()
    for k in (0, 1):
        r = np.corrcoef(o.field_offset_db[:, fields_of_two == k])[0, 1]
        assert r == pytest.approx(0.6, abs=4.5 * (1 - 0.36) / np.sqrt(n))


def test_dates_spread_and_correlate_over_runs():
    draws = np.array(
        [
            draw_occasion(
                radar("HH+HV"), [lookup(), lookup()], fields_of_two[:3], (0.2, 5.0), ONCE, seed=1, run_id=k
            ).class_offset_db
            for k in range(3000)
        ]
    )
    np.testing.assert_allclose(draws.std(axis=0), [[2.0, 1.0]] * 2, rtol=4.5 / np.sqrt(6000))
    assert np.corrcoef(draws[:, 0, 0], draws[:, 1, 0])[0, 1] == pytest.approx(0.6, abs=0.055)
    assert abs(np.corrcoef(draws[:, 0, 0], draws[:, 0, 1])[0, 1]) < 0.085


def test_a_channel_draws_the_same_whoever_is_beside_it():
    alone = draw_occasion(radar("VV"), [lookup()], fields_of_two, (0.2, 5.0), ONCE, seed=1, run_id=4)
    beside = draw_occasion(radar("HH+HV+VV"), [lookup()] * 3, fields_of_two, (0.2, 5.0), ONCE, seed=1, run_id=4)
    np.testing.assert_array_equal(alone.field_offset_db[0], beside.field_offset_db[2])
    np.testing.assert_array_equal(alone.class_offset_db[0], beside.class_offset_db[2])
    other = draw_occasion(radar("VV"), [lookup()], fields_of_two, (0.2, 5.0), ONCE, seed=1, run_id=5)
    assert not np.array_equal(alone.class_offset_db, other.class_offset_db)


def test_moisture_and_wind_are_uniform_between_their_ends():
    r = radar("HH")
    x = np.array([draw_ground_state(r, ONCE, seed=3, run_id=k) for k in range(2000)])
    assert ((x >= [0.10, 2.0]) & (x <= [0.30, 8.0])).all()
    np.testing.assert_allclose(x.mean(axis=0), [0.2, 5.0], atol=np.array([0.2, 6.0]).max() * 4.5 / np.sqrt(12 * 2000))
    np.testing.assert_allclose(x.std(axis=0), np.array([0.2, 6.0]) / np.sqrt(12), rtol=0.06)
    assert nominal_ground_state(r) == pytest.approx((0.2, 5.0))


def test_the_record_is_plain_data():
    o = draw_occasion(radar("HH+VV"), [lookup(), lookup()], fields_of_two[:6], (0.2, 5.0), ONCE, seed=1, run_id=1)
    record = json.loads(json.dumps(o.record(("HH", "VV"), ("Wheat", "Water"))))
    assert record["soil_moisture"] == 0.2
    assert set(record["class_offset_db"]["HH"]) == {"Wheat", "Water"}


def bare_offsets(frequency_ghz: float, angle_deg: float, channels: str, n: int, day: float | None = None) -> np.ndarray:
    """Offsets (channels, n) of fields of bare soil [dB], less what all share."""
    settings = {"frequency": frequency_ghz, "polarization": channels, "resolution": 20, "bandwidth": 50}
    of_run = {**settings, "peak_power": 1.0, "depression_angle": 90.0 - angle_deg}
    own = from_settings(of_run, {"altitude_m": 60_000.0})
    table = load_sigma0_table()
    looks = [table.lookup(["Bareground"], frequency_ghz, channel, day=day) for channel in own.recorded]
    visit = ONCE if day is None else Visit((day,))
    made = draw_occasion(own, looks, np.zeros(n, dtype=np.uint8), (0.2, 5.0), visit, seed=1, run_id=1)
    return made.field_offset_db


@pytest.mark.parametrize("day", [None, 120.0])
def test_bare_fields_depart_the_more_by_roughness_the_higher_the_angle(day: float | None) -> None:
    """Baghdadi et al. 2016: 8.6, 4.4 and 7.1 dB times sin(angle) for ten times the height (HH, HV, VV)."""
    n, decades = 40_000, 0.2
    at_40 = (1.42, 1.10, 1.42) if day is None else (1.9, 1.6, 1.9)
    heights = decades * np.sin(np.deg2rad(40.0)) * np.array([8.6, 4.4, 7.1])
    rest = np.square(at_40) - heights**2
    seen = {angle: bare_offsets(5.4, angle, "HH+HV+VV", n, day) for angle in (12.0, 40.0, 65.0)}
    for angle, found in seen.items():
        height = decades * np.sin(np.deg2rad(angle)) * np.array([8.6, 4.4, 7.1])
        apart = min(np.sin(np.deg2rad(angle)) / np.sin(np.deg2rad(40.0)), 1.0) ** 2  # of HH and VV
        parts = np.sqrt(rest)
        parts[[0, 2]] = apart * parts[[0, 2]] + (1.0 - apart) * parts[[0, 2]].mean()
        assert found.std(axis=1) == pytest.approx(np.hypot(parts, height), rel=0.02)
        shared = (1.0 - 0.25 * apart**2) * parts[0] * parts[2] + height[0] * height[2]
        assert np.cov(found)[0, 2] == pytest.approx(shared, rel=0.03)


def test_all_bands_see_the_same_roughness() -> None:
    """L and C band share what is left of their relation, and all of it."""
    n = 40_000
    low, high = (bare_offsets(f, 60.0, "HH", n)[0] for f in (1.25, 5.4))
    height = 0.2 * 8.6 * np.sin(np.deg2rad(60.0))
    rest = 1.42**2 - (0.2 * 8.6 * np.sin(np.deg2rad(40.0))) ** 2
    wanted = related_fields(1.25, 5.4) * rest + height**2
    assert np.cov(low, high)[0, 1] == pytest.approx(wanted, rel=0.03)
    assert np.corrcoef(low, high)[0, 1] > 0.7


@pytest.mark.parametrize("day", [None, 150.0])
def test_hh_and_vv_depart_alike_near_nadir_and_apart_from_forty_degrees(day: float | None) -> None:
    """By the square of the sine; what they differ by at 40 degrees they still do at 60."""
    n, differs = 40_000, {}
    for angle in (5.0, 20.0, 40.0, 60.0):
        settings = {"frequency": 5.4, "polarization": "HH+VV", "resolution": 20, "bandwidth": 150}
        own = from_settings(
            {**settings, "peak_power": 1.0, "depression_angle": 90.0 - angle}, {"altitude_m": 60_000.0, "earth": "flat"}
        )
        looks = [load_sigma0_table().lookup(["Grass"], 5.4, channel, day=day) for channel in ("HH", "VV")]
        visit = ONCE if day is None else Visit((day,))
        made = draw_occasion(own, looks, np.zeros(n, dtype=np.uint8), (0.2, 5.0), visit, seed=1, run_id=1)
        differs[angle] = np.diff(made.field_offset_db, axis=0).std()
        assert made.field_offset_db[0].std() == pytest.approx(looks[0].field_sd_db[0], rel=0.02)
    sine = np.sin(np.deg2rad([5.0, 20.0, 40.0]))
    wanted = differs[40.0] * np.square(sine / sine[-1])
    assert [differs[5.0], differs[20.0]] == pytest.approx(wanted[:2], rel=0.02)
    assert differs[60.0] == pytest.approx(differs[40.0], rel=1e-9)
    assert differs[40.0] == pytest.approx(looks[0].field_sd_db[0] * np.sqrt(2.0 * 0.25), rel=0.02)
