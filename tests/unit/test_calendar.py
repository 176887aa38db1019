"""The calendar of crops against the months that it was made from, and the history of fields over many dates."""

from __future__ import annotations

import csv

import numpy as np
import pytest
from scipy import stats

from seqrsm.errors import ScatteringDataError
from seqrsm.scattering.calendar import DAYS, canopy_share
from seqrsm.scattering.emissivity import load_emissivity_table
from seqrsm.scattering.readers import DATA
from seqrsm.scattering.sigma0 import load_sigma0_table
from seqrsm.scattering.worlds import World
from seqrsm.sensor.radar import from_settings
from seqrsm.simulate.radar.occasion import draw_occasion
from seqrsm.simulate.visits import Visit, deviates, moisture_share

CROPS = ("Wheat", "Oats", "Corn", "Rapeseed", "Vegetables", "Grass", "Hay", "Forage")
TABLE = load_sigma0_table()


def at(day, channel="VV", frequency=5.4, categories=CROPS, table=TABLE):
    return table.lookup(categories, frequency, channel, day=day)


def radar(frequency=5.4, polarization="VV"):
    settings = {"frequency": frequency, "polarization": polarization, "resolution": 20, "bandwidth": 50}
    return from_settings({**settings, "peak_power": 1.0, "depression_angle": 45.0}, {"altitude_m": 6000.0})


@pytest.mark.parametrize("channel", ["HV", "VV"])
def test_c_band_goes_through_the_year_as_the_sites_did(channel):
    """Level and course together give back the mean over sites of every month, at 38 degrees."""
    lines = [line for line in (DATA / "calendar_c_band.csv").read_text().splitlines() if not line.startswith("#")]
    rows = [r for r in csv.DictReader(lines) if r["polarization"] == channel]
    for month, day in ((1, 16), (5, 136), (7, 197), (10, 289)):
        found = 10.0 * np.log10(at(day, channel).sigma0[:, 38])
        for name, value in zip(CROPS, found, strict=True):
            by_source: dict[str, list[float]] = {}
            for r in rows:
                if r["category"] == name:
                    by_source.setdefault(r["source"], []).append(float(r[f"month_{month}_db"]))
            sites = [np.mean(v) for v in by_source.values()]
            # Bare months fall faster with the angle: 0.28 dB a degree at most, two degrees from the course's 40.
            assert value == pytest.approx(np.mean(sites), abs=0.7), (name, month)


def test_known_seasons_of_known_crops():
    """Cereals fall at stem elongation and come back (C-VV); maize rises and rapeseed drops (HV); grass is even."""
    wheat = at(136, "VV").course.change_db[0]
    assert wheat[135] < wheat[74] - 2.5
    assert wheat[135] < wheat[227] - 2.5
    corn = at(136, "HV").course.change_db[2]
    assert corn[196] > corn[135] + 2.0
    rapeseed = at(136, "HV").course.change_db[3]
    assert rapeseed[165] > rapeseed[196] + 4.0
    assert np.ptp(at(136, "VV").course.change_db[5]) < 2.0
    broadleaf = at(200, "HV", 1.25).sigma0[:, 40]
    assert 10 * np.log10(broadleaf[2] / broadleaf[0]) > 2.0  # L-HV tells maize from wheat in July


def test_the_l_band_course_stands_on_the_flights():
    for channel in ("HH", "HV", "VV"):
        course = at(180, channel, 1.25).course
        calm = [k for k, name in enumerate(CROPS) if name != "Rapeseed"]
        mean = 10.0 * np.log10((10.0 ** (0.1 * course.change_db[:, 172:200])).mean(axis=1))
        np.testing.assert_allclose(mean[calm], 0.0, atol=0.05)


def test_a_cover_without_a_calendar_is_refused_by_name(tmp_path):
    path = tmp_path / "own.csv"
    header = "quantity,category,frequency_ghz,polarization,theta_deg,value,unit,status,source\n"
    path.write_text(header + "".join(f"sigma0,Hops,5.4,VV,{t},-10,dB,measured,me\n" for t in (20, 60)))
    table = load_sigma0_table(path)
    with pytest.raises(ScatteringDataError, match=r"no calendar of this category.*Hops"):
        table.lookup(("Hops",), 5.4, "VV", day=150)


def test_worlds_differ_in_the_course_as_its_error_says():
    draws = np.array([at(150, "VV", table=TABLE.in_world(World(5, k))).course.change_db[:, 149] for k in range(400)])
    own = at(150, "VV").course
    np.testing.assert_allclose(draws.std(axis=0), own.sd_db, rtol=0.2)
    np.testing.assert_allclose(draws.mean(axis=0), own.change_db[:, 149], atol=0.45)


def test_emissivity_follows_the_water_of_the_canopy():
    """Bare maize ground is colder at L band than the crop in July, by what tau-omega says; grass does not change."""
    table = load_emissivity_table()

    def emissivity(name, day):
        return float(table.lookup((name,), 1.4, "H", day=day).emissivity[0, 6, 40])  # soil moisture 0.2, 40 degrees

    assert emissivity("Corn", 200) > emissivity("Corn", 100) + 0.02
    assert emissivity("Wheat", 150) > emissivity("Wheat", 250) + 0.05
    assert emissivity("Grass", 20) == pytest.approx(emissivity("Grass", 200))
    season = table.lookup(("Corn",), 1.4, "H").emissivity
    water = np.mean([canopy_share("Corn", day, "") for day in range(173, 201)])
    assert water == pytest.approx(1.0, abs=0.02)
    between = [table.lookup(("Corn",), 1.4, "H", day=day).emissivity[0, 6, 40] for day in (174, 200)]
    assert min(between) < season[0, 6, 40] < max(between)
    assert table.lookup(("Asphalt",), 1.4, "H", day=20).emissivity == pytest.approx(
        table.lookup(("Asphalt",), 1.4, "H").emissivity
    )
    with pytest.raises(ScatteringDataError, match="no calendar"):
        canopy_share("Hops", 100, "")


def test_bands_near_each_other_see_nearly_the_same_fields():
    low, high, next_to = (deviates(1, 2, "field", (40_000,), f) for f in (1.25, 5.4, 5.5))
    assert np.corrcoef(low, high)[0, 1] == pytest.approx(0.3, abs=0.05)
    assert np.corrcoef(high, next_to)[0, 1] > 0.99
    assert low.std() == pytest.approx(1.0, abs=0.02)


def test_soil_moisture_of_days_is_uniform_and_remembers():
    days = (120.0, 123.0, 180.0)
    u = np.array([[moisture_share(Visit(days, t), seed=1, run_id=k) for t in range(3)] for k in range(1500)])
    for t in range(3):
        assert stats.kstest(u[:, t], "uniform").pvalue > 1e-4
    z = stats.norm.ppf(u)
    for a, b in ((0, 1), (0, 2)):
        gap = days[b] - days[a]
        expected = 0.74 * np.exp(-gap / 30.0) + 0.26 * np.exp(-gap / 4.5)
        assert np.corrcoef(z[:, a], z[:, b])[0, 1] == pytest.approx(expected, abs=0.09)


def field_offsets(days, category, frequency=5.4, n=4000):
    fields = np.full(n, CROPS.index(category), dtype=np.uint8)
    return np.array(
        [
            draw_occasion(
                radar(frequency),
                [at(day, frequency=frequency)],
                fields,
                (0.2, 5.0),
                Visit(tuple(days), t),
                seed=7,
                run_id=1,
            ).field_offset_db[0]
            for t, day in enumerate(days)
        ]
    )


def test_a_field_stays_itself_over_dates():
    """Grass stays what it is, a cereal forgets within months; one date does not depend on later ones."""
    grass, wheat = (field_offsets((150.0, 160.0, 270.0), name) for name in ("Grass", "Wheat"))
    r_grass, r_wheat = np.corrcoef(grass), np.corrcoef(wheat)
    share, left = 0.78, np.exp(-10.0 / 86.0)
    assert r_grass[0, 1] == pytest.approx(share + (1.0 - share) * left, abs=0.03)
    assert r_grass[0, 2] > 0.75
    assert r_wheat[0, 1] > 0.5
    assert r_wheat[0, 2] < 0.35
    np.testing.assert_array_equal(field_offsets((150.0,), "Wheat")[0], wheat[0])


def test_fields_drawn_anew_would_make_dates_look_far_too_good():
    """Two covers a decibel apart, nine dates: the mean over dates tells far fewer fields apart where they last."""
    days = tuple(150.0 + 10.0 * t for t in range(9))
    grass = field_offsets(days, "Grass")
    kept = grass.mean(axis=0).std()
    anew = np.mean([row.std() for row in grass]) / np.sqrt(len(days))
    assert kept > 2.5 * anew
    shown = stats.norm.cdf(0.5 / np.array([kept, anew]))
    assert shown[1] - shown[0] > 0.15


def test_days_run_from_the_first_to_the_last_of_the_year():
    assert (DAYS[0], DAYS[-1], len(DAYS)) == (1.0, 365.0, 365)
    first, last = (at(day).sigma0 for day in (1.0, 365.0))
    np.testing.assert_allclose(10 * np.log10(first / last), 0.0, atol=0.2)
