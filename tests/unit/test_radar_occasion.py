"""The state of the ground of a run: spreads, correlation, and what the draws depend on."""

from __future__ import annotations

import json
from types import SimpleNamespace

import numpy as np
import pytest

from seqrsm.sensor.radar import from_settings
from seqrsm.simulate.radar.occasion import draw_ground_state, draw_occasion, nominal_ground_state
from seqrsm.simulate.visits import ONCE


def radar(polarization):
    settings = {"frequency": 5.3, "polarization": polarization, "resolution": 20, "bandwidth": 50}
    return from_settings({**settings, "peak_power": 1.0, "depression_angle": 45.0}, {"altitude_m": 6000.0})


def lookup(field_sd=(1.5, 0.5), date_sd=(2.0, 1.0), correlation=0.6):
    return SimpleNamespace(
        sigma0=np.ones((2, 91)),
        field_sd_db=np.array(field_sd),
        date_sd_db=np.array(date_sd),
        channel_correlation=correlation,
        course=None,
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
