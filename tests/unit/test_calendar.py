"""The calendar of crops against the months that it was made from, and the history of fields over many dates."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from scipy import stats
from shorthands import left

from seqrsm.campaign.simulation import acquisitions_of
from seqrsm.errors import ScatteringDataError
from seqrsm.scattering.calendar import DAYS, SHIPPED, fields_by_category, has_course, level_days, on_day
from seqrsm.scattering.curves import moisture_change_db
from seqrsm.scattering.emissivity import load_emissivity_table
from seqrsm.scattering.readers import shipped_rows
from seqrsm.scattering.sigma0 import load_sigma0_table
from seqrsm.scattering.worlds import World, course_deviation, own_weights, related_by_frequency
from seqrsm.sensor.radar import from_settings
from seqrsm.simulate.radar import occasion
from seqrsm.simulate.radar.occasion import draw_ground_state, draw_occasion
from seqrsm.simulate.visits import (
    Visit,
    changing,
    field_shift_days,
    half_lasting,
    moisture_share,
    related_fields,
    year_shift_days,
)
from seqrsm.units import linear_to_db

SOIL_RMS_M = 0.01  # of bare ground, as shipped
CROPS = ("Wheat", "Oats", "Corn", "Rapeseed", "Vegetables", "Grass", "Hay", "Forage")
TABLE = load_sigma0_table()


def at(day, channel="VV", frequency=5.4, categories=CROPS, table=TABLE):
    return table.lookup(categories, frequency, channel, day=day)


def radar(frequency=5.4, polarization="VV"):
    settings = {"frequency": frequency, "polarization": polarization, "resolution": 20, "bandwidth": 50}
    return from_settings({**settings, "peak_power": 1.0, "depression_angle": 45.0}, {"altitude_m": 6000.0})


@pytest.mark.parametrize("channel", ["HV", "VV"])
def test_c_band_goes_through_the_year_as_the_sites_did(channel):
    """A month less the level is the mean over sites of the month less their own summer, at 38 degrees."""
    rows = [r.cells for r in shipped_rows("calendar_c_band.csv") if r.text("polarization") == channel]
    for month, day in ((1, 16), (5, 136), (7, 197), (10, 289)):
        level = TABLE.lookup(CROPS, 5.4, channel)
        found = 10.0 * np.log10(at(day, channel).sigma0[:, 38] / level.sigma0[:, 38])
        for name, value in zip(CROPS, found, strict=True):
            by_source: dict[str, list[float]] = {}
            for r in rows:
                if r["category"] == name:
                    summer = np.mean([float(r[f"month_{m}_db"]) for m in (5, 6, 7, 8)])
                    by_source.setdefault(r["source"], []).append(float(r[f"month_{month}_db"]) - summer)
            sites = [np.mean(v) for v in by_source.values()]
            # Bare months fall faster with the angle: 0.28 dB a degree at most, two degrees from the course's 40.
            assert value == pytest.approx(np.mean(sites), abs=0.7), (name, month)


def test_covers_with_a_course_are_those_whose_months_were_measured():
    """Bare soil goes through the year as it is: it has the fields' spread and history, and no course."""
    measured = {row.text("category") for row in shipped_rows("calendar_c_band.csv")}
    assert {name for name in fields_by_category() if has_course(name)} == measured == set(CROPS)
    course = at(15, categories=("Bareground", "Trees")).course
    np.testing.assert_array_equal([course.change_db, course.tilt_db_per_deg], 0.0)
    np.testing.assert_array_equal(course.even, [False, True])
    np.testing.assert_array_equal(course.soil_share, np.outer([1.0, 0.0], np.ones(365)))
    assert [SHIPPED.closed(name, 15.0) for name in ("Bareground", "Trees")] == [0.0, 1.0]


@pytest.mark.parametrize(("frequency", "share"), [(0.8, 0.0), (1.25, 0.0), (np.sqrt(1.25 * 5.4), 0.5)])
def test_between_l_and_c_band_a_course_is_part_a_water_cloud_over_soil(frequency, share):
    """Attema and Ulaby 1978: own (1 - T) + soil T, 0 dB on the flights' days; 0.15 Np m2/kg at 1.4 GHz."""
    names = ("Wheat", "Corn", "Rapeseed", "Vegetables")
    found = TABLE.lookup(names, frequency, "VV", day=150).course
    level, soil = (TABLE.lookup(own, frequency, "VV").sigma0[:, 40] for own in (names, ["Bareground"]))
    for k, name in enumerate(names):
        rows = [r.cells for r in shipped_rows("calendar_canopy.csv") if r.text("category") == name]
        day, water, cover = (np.array([float(r[c]) for r in rows]) for c in ("day", "water_kg_m2", "cover_fraction"))
        rate = 2.0 * 0.15 * frequency / 1.4 / np.cos(np.deg2rad(40.0))
        through = np.exp(-rate * np.interp(DAYS, day, water, period=365))
        # The level of rapeseed is that of canola of 3.5 kg/m2.
        then = np.exp(-rate * 3.5) if name == "Rapeseed" else through[172:200].mean()
        below = min(soil[0] / level[k], 0.7 / then)  # 0.3 of the level at least is the canopy's own
        cloud = (1.0 - below * then) / (1.0 - then) * (1.0 - through) + below * through
        in_c = TABLE.lookup([name], 5.4, "VV", day=150).course.change_db[0]
        wanted = share * in_c + (1.0 - share) * 10.0 * np.log10(cloud)
        np.testing.assert_allclose(found.change_db[k], wanted, atol=1e-9)
        closed = np.interp(DAYS, day, cover, period=365)
        np.testing.assert_allclose(found.closed[k], closed)
        bare = share * (1.0 - closed) + (1.0 - share) * below * through / cloud
        np.testing.assert_allclose(found.soil_share[k], bare, atol=1e-12)


def test_a_cover_without_a_calendar_is_refused_by_name(tmp_path):
    path = tmp_path / "own.csv"
    header = "quantity,category,frequency_ghz,polarization,theta_deg,value,unit,status,source\n"
    rows = (f"sigma0,{name},5.4,VV,{t},-10,dB,measured,me\n" for name in ("Hops", "Vines") for t in (20, 60))
    path.write_text(header + "".join(rows))
    table = load_sigma0_table(path)
    with pytest.raises(ScatteringDataError, match=r"no calendar of this category.*Hops") as caught:
        table.lookup(("Hops", "Vines"), 5.4, "VV", day=150)
    assert [problem.value for problem in caught.value.problems] == ["Hops", "Vines"]
    assert str(caught.value).count("known: ") == 1


def test_worlds_differ_in_the_course_as_its_error_says():
    draws = np.array([at(150, "VV", table=TABLE.in_world(World(5, k))).course.change_db[:, 149] for k in range(400)])
    own = at(150, "VV").course
    # Of sites in C band, 1 dB and of cereals 2, root mean square; what lies bare departs as one soil.
    sd = 1.0 + np.array([name in ("Wheat", "Oats") for name in CROPS])[:, None] * own.closed
    np.testing.assert_allclose(draws.std(axis=0), sd[:, 149] * course_deviation(level_days(5.4))[149], rtol=0.2)
    np.testing.assert_allclose(own.sd_db, sd * course_deviation(level_days(5.4)))
    assert np.sqrt((course_deviation(level_days(5.4)) ** 2).mean()) == pytest.approx(1.0)
    np.testing.assert_allclose(draws.mean(axis=0), own.change_db[:, 149], atol=0.45)


@pytest.mark.parametrize("frequency", [1.25, 2.6, 5.4, 9.6])
@pytest.mark.parametrize("channel", ["HH", "HV"])
def test_bare_fields_depart_by_the_error_of_one_soil(channel, frequency):
    """In January no world tells bare ground, maize, oats and vegetables from each other; in July most do."""
    covers = (*CROPS, "Bareground")
    worlds = [TABLE.in_world(World(5, k)) for k in range(300)]
    for day, apart in ((15, False), (190, True)):
        draws = np.array([10.0 * np.log10(at(day, channel, frequency, covers, world).sigma0) for world in worlds])
        told = at(day, channel, frequency, covers)
        np.testing.assert_allclose(draws[:, :, 40].std(axis=0), told.mean_sd_db, rtol=0.35)
        maize, *others = (draws[:, covers.index(name)] for name in ("Corn", "Oats", "Vegetables", "Bareground"))
        for other in others:
            between = (maize - other).std(axis=0)[[20, 40, 60]]
            if apart:
                assert (between > 0.7 * told.mean_sd_db.min()).all()
            else:
                np.testing.assert_allclose(between, 0.0, atol=1e-9)


def test_half_closed_crops_depart_as_far_as_is_told():
    """A crop's own departure and the soil's are related: taken for independent, their sum would be 10 % too wide."""
    worlds = [TABLE.in_world(World(5, k)) for k in range(1500)]
    pair, day, frequency = ("Corn", "Vegetables"), 152, 1.25
    told = at(day, "HH", frequency, pair)
    looked = [at(day, "HH", frequency, pair, world) for world in worlds]
    course = np.array([one.course.at_angles(day, np.array([40.0]))[:, 0] for one in looked])
    level = np.array([10.0 * np.log10(one.sigma0[:, 40]) for one in looked]) - course
    of_course = told.course.sd_db[:, day - 1]
    np.testing.assert_allclose(told.course.closed[:, day - 1], 0.5, atol=0.15)
    np.testing.assert_allclose(course.std(axis=0), of_course, rtol=0.05)
    np.testing.assert_allclose(level.std(axis=0), np.sqrt(told.mean_sd_db**2 - of_course**2), rtol=0.05)


def test_a_world_knows_how_far_bare_fields_lie_apart():
    world = World(5, 2)
    factor = world.field_factor("Bareground")
    own, drawn = (at(15, table=table).field_sd_db for table in (TABLE, TABLE.in_world(world)))
    assert abs(factor - 1.0) > 0.1
    for name in ("Corn", "Vegetables"):
        assert drawn[CROPS.index(name)] == pytest.approx(own[CROPS.index(name)] * factor)


def test_bare_fields_differ_as_much_whatever_was_sown():
    """By the seasonal and the lasting deviation of maize, soybean, sunflower, barley and wheat of western France."""
    fields = {
        "VV": ((1.46, 0.22), (1.84, 1.13), (1.77, 0.60), (1.91, 0.94), (1.74, 0.49)),
        "HV": ((1.35, 0.46), (1.12, 1.37), (1.19, 1.00), (1.56, 0.46), (1.39, 0.75)),
    }
    for channel, sd_db in fields.items():
        wanted = pytest.approx(np.hypot(*np.transpose(sd_db)).mean(), abs=0.05)
        corn, vegetables, bare = at(15, channel, categories=("Corn", "Vegetables", "Bareground")).field_sd_db
        assert corn == vegetables == bare == wanted
        summer = at(190, channel).field_sd_db
        assert summer[CROPS.index("Vegetables")] > 1.4 * summer[CROPS.index("Corn")]


@pytest.mark.parametrize(("frequency", "days"), [(1.25, slice(172, 200)), (5.4, slice(120, 243))])
def test_the_course_is_known_where_the_level_was_measured(frequency, days):
    """A level of late June and July leaves nothing open on these days but the level itself."""
    departure = World(5, 7).season("Wheat", "crop", frequency, "VV", level_days(frequency))
    assert np.abs(departure).max() > 0.5
    assert departure[days].mean() == pytest.approx(0.0, abs=1e-12)
    level_db = TABLE.lookup(CROPS, 1.25, "HH").mean_sd_db
    (soil_db,) = TABLE.lookup(("Bareground",), 1.25, "HH").mean_sd_db
    here, winter = (TABLE.lookup(CROPS, 1.25, "HH", day=day) for day in (186, 10))
    of_day = [one.course.closed[:, day - 1] for one, day in ((here, 186), (winter, 10))]
    known, left = (closed * level_db + (1.0 - closed) * soil_db for closed in of_day)
    np.testing.assert_allclose(here.mean_sd_db, known, rtol=0.02)
    assert (winter.mean_sd_db > left + 0.2).all()


def test_crops_share_part_of_their_departures_from_the_course():
    """A quarter is common to all covers, another to kin, as of their means; of C-band sites, see worlds.py."""
    days = level_days(5.4)
    worlds = [World(9, k) for k in range(500)]
    wheat, corn, grass = (
        np.array([w.season(*key, 5.4, "VV", days)[20] for w in worlds])
        for key in (("Wheat", "crop"), ("Corn", "crop"), ("Grass", "grass"))
    )
    assert np.corrcoef(wheat, corn)[0, 1] == pytest.approx(0.5, abs=0.1)
    assert np.corrcoef(wheat, grass)[0, 1] == pytest.approx(0.25, abs=0.1)


def emissivity(name, day):
    """Of a cover at L band, H, at 40 degrees, of a soil moisture of 0.2."""
    return float(load_emissivity_table().lookup((name,), 1.4, "H", day=day).emissivity[0, 6, 40])


def test_emissivity_follows_the_water_of_the_canopy():
    """Bare maize ground is colder at L band than the crop in July, by what tau-omega says; grass does not change."""
    table = load_emissivity_table()
    assert emissivity("Corn", 200) > emissivity("Corn", 100) + 0.02
    assert emissivity("Wheat", 150) > emissivity("Wheat", 250) + 0.05
    assert emissivity("Grass", 20) == pytest.approx(emissivity("Grass", 200))
    season = table.lookup(("Corn",), 1.4, "H").emissivity
    water = np.mean([SHIPPED.canopy_share("Corn", day) for day in range(173, 201)])
    assert water == pytest.approx(1.0, abs=0.02)
    between = [emissivity("Corn", day) for day in (174, 200)]
    assert min(between) < season[0, 6, 40] < max(between)
    assert table.lookup(("Asphalt",), 1.4, "H", day=20).emissivity == pytest.approx(
        table.lookup(("Asphalt",), 1.4, "H").emissivity
    )
    with pytest.raises(ScatteringDataError, match="no calendar"):
        SHIPPED.canopy_share("Hops", 100)


@pytest.mark.parametrize(("other_ghz", "own"), [(5.4005, 0.0), (5.401, 0.0), (6.2, 1.0)])
def test_a_tenth_of_fields_is_a_band_s_own(other_ghz, own):
    """Where two bands see all but the same, that tenth is left: twice 0.1 of the variance; of one band nothing."""
    one, other, again = (
        half_lasting(Visit(), "texture", (40_000,), f, seed=1, run_id=2) for f in (5.4, other_ghz, 5.4)
    )
    told = 2.0 * (0.1 * own + 0.9 * (1.0 - related_by_frequency(5.4, other_ghz)))
    assert np.var(one - other) == pytest.approx(told, rel=0.03, abs=3e-5)
    assert (one.std(), other.std()) == pytest.approx((1.0, 1.0), abs=0.02)
    np.testing.assert_array_equal(one, again)


@pytest.mark.parametrize("visit", [Visit(), Visit((150.0,))])
def test_images_of_two_bands_see_fields_as_related(visit):
    looked = at(visit.day, categories=("Grass",))  # whose fields are neither early nor late
    fields = np.zeros(40_000, dtype=np.uint8)
    one, near, other = (
        draw_occasion(radar(f), [looked], fields, (0.2, 5.0), visit, seed=1, run_id=2).field_offset_db[0]
        for f in (5.4, 5.41, 6.2)
    )
    for seen, ghz in ((near, 5.41), (other, 6.2)):
        assert np.corrcoef(one, seen)[0, 1] == pytest.approx(related_fields(5.4, ghz), abs=0.005)
    assert related_fields(5.4, 5.41) > 0.999 > 0.91 > related_fields(5.4, 6.2)


def seen_at(incidences_deg, days="", frequencies=("5.4",) * 3, polarization="VV", n=40_000):
    """What radars of one run see of fields of grass, whose calendars are the same."""
    names = [f"{name} {k}" for k, name in enumerate(frequencies)][: len(incidences_deg)]
    members = {
        name: {"frequency": frequency, "depression_angle": 90.0 - angle}
        for name, frequency, angle in zip(names, frequencies, incidences_deg, strict=False)
    }
    fixed = {"polarization": polarization, "resolution": 20.0, "bandwidth": 50.0, "peak_power": 1.0, "earth": "flat"}
    settings = {"frequency": "+".join(names), **({"days": days} if days else {})}
    fields, found = np.zeros(n, dtype=np.uint8), []
    for made in acquisitions_of("psm", settings, {**fixed, "altitude_m": 6000.0}, members):
        looked = [at(made.visit.day, frequency=made.sensor.frequency_ghz, categories=("Grass",))]
        met = draw_occasion(made.sensor, looked, fields, (0.2, 5.0), made.visit, seed=1, run_id=2)
        found.append(met.field_offset_db[0])
    return np.array(found)


@pytest.mark.parametrize("days", ["", "150", "150+156"])
def test_radars_see_fields_the_more_differently_the_further_their_angles_are_apart(days):
    """By exp(-apart / 45), in whatever order they are named; the steepest as if it were alone.

    Looking steeply a channel takes part of the other's own, so that it is its own of 43 degrees the less.
    """
    angles = (43.0, 23.0, 35.0)
    found = seen_at(angles, days)[:: len(days.split("+"))]
    apart = np.abs(np.subtract.outer(angles, angles))
    own = np.array([own_weights("VV", angle) for angle in angles])
    np.testing.assert_allclose(np.corrcoef(found), (0.75 + 0.25 * own @ own.T) * np.exp(-apart / 45.0), atol=0.02)
    assert (own @ own.T).min() > 0.85
    np.testing.assert_allclose(found.std(axis=1), found[0].std(), rtol=0.02)
    np.testing.assert_array_equal(found[1], seen_at((23.0,), days)[0])


def test_angles_and_bands_relate_what_is_seen_together():
    for bands, apart in ((("5.4", "9.6"), 20.0), (("1.25", "5.4"), 10.0), (("5.4", "5.4"), 0.0)):
        found = np.corrcoef(seen_at((45.0, 45.0 + apart), frequencies=bands))[0, 1]
        told = related_fields(*map(float, bands), apart)
        assert found == pytest.approx(told, abs=0.02)
        assert told == pytest.approx(related_fields(*map(float, bands)) * np.exp(-apart / 45.0))


def test_a_field_keeps_at_two_angles_what_it_is_over_dates():
    """What lasts and what fades are related by the angle alike: of six days and twenty degrees the product is left."""
    found = np.corrcoef(seen_at((43.0, 63.0), "150+156"))
    assert found[0, 3] == pytest.approx(found[0, 1] * np.exp(-20.0 / 45.0), abs=0.02)


def test_what_changes_over_days_is_smooth_and_each_field_has_its_memory():
    days, memory = (120.0, 120.1, 120.2, 124.0, 160.0), np.repeat([4.5, 86.0], 40_000)
    draws = list(np.random.default_rng(4).standard_normal((len(days), memory.size)))
    states = [changing(draws[: t + 1], days[: t + 1], memory) for t in range(len(days))]
    np.testing.assert_array_equal(states[0], draws[0])
    for mine in (memory == 4.5, memory == 86.0):
        found = np.corrcoef([state[mine] for state in states])
        wanted = [[left(abs(one - other), memory[mine][0]) for one in days] for other in days]
        np.testing.assert_allclose(found, wanted, atol=0.02)
        hours, twice = (np.std(states[t][mine] - states[0][mine]) for t in (1, 2))
        assert twice / hours == pytest.approx(2.0, rel=0.02)  # the root of 2 where it is rough


def test_days_that_are_seconds_apart_and_a_date_on_each_day_have_states():
    draws = list(np.random.default_rng(5).standard_normal((120, 3)))
    together = [changing(draws[: t + 1], (120.0, 120.0 + 1e-9, 120.0 + 2e-9)[: t + 1], 4.5) for t in range(3)]
    np.testing.assert_allclose(together, np.broadcast_to(draws[0], (3, 3)), atol=3e-4)
    assert np.isfinite(changing(draws, tuple(range(1, 121)), np.array([4.5, 86.0, 98.0]))).all()


def test_soil_moisture_of_days_is_uniform_and_remembers():
    days = (120.0, 123.0, 180.0)
    u = np.array([[moisture_share(Visit(days, t), seed=1, run_id=k) for t in range(3)] for k in range(1500)])
    for t in range(3):
        assert stats.kstest(u[:, t], "uniform").pvalue > 1e-4
    z = stats.norm.ppf(u)
    for a, b in ((0, 1), (0, 2)):
        gap = days[b] - days[a]
        expected = 0.74 * left(gap, 30.0) + 0.26 * left(gap, 4.5)
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
    share, fast = 0.78, 0.4**2 / grass[0].var()
    slow, quick = left(10.0, 86.0), left(10.0, 4.5)
    assert r_grass[0, 1] == pytest.approx(share + (1.0 - share - fast) * slow + fast * quick, abs=0.02)
    assert r_grass[0, 2] > 0.75
    assert r_wheat[0, 1] > 0.5
    assert r_wheat[0, 2] < 0.35
    np.testing.assert_array_equal(field_offsets((150.0,), "Wheat")[0], wheat[0])


@pytest.mark.parametrize("frequency", [1.25, 5.4])
@pytest.mark.parametrize("name", ["Wheat", "Oats", "Corn", "Vegetables"])
def test_fields_differ_on_a_day_by_what_was_measured_on_such_days(name, frequency):
    """By the table's spread with early and late fields in it, or by more where the shift of the calendar alone does."""
    k = CROPS.index(name)
    for day in (150.0, 184.0):
        looked = at(day, frequency=frequency)
        told = looked.field_sd_db[k]
        shifted = on_day(looked.course.change_db[k], day + np.random.default_rng(1).normal(0.0, 8.0, 4000)).std()
        got = field_offsets((day,), name, frequency)[0].std()
        assert 0.9 * told < got < 1.1 * np.hypot(told, shifted)


def test_bare_months_fall_faster_with_the_angle():
    """By 0.28 dB a degree where nothing covers the ground, over what the table has for the season."""
    dry, season = at(100).sigma0, TABLE.lookup(CROPS, 5.4, "VV").sigma0
    fall = 10.0 * np.log10(dry[:, 30] / dry[:, 50]) - 10.0 * np.log10(season[:, 30] / season[:, 50])
    corn, wheat = fall[CROPS.index("Corn")], fall[CROPS.index("Wheat")]
    assert corn == pytest.approx(20.0 * 0.28, rel=0.25)
    assert 0.0 < wheat < 0.6 * corn


def test_other_channels_and_bands_follow_c_band_as_is_said():
    vv, hh = (at(136, channel).course.change_db for channel in ("VV", "HH"))
    wheat, corn = CROPS.index("Wheat"), CROPS.index("Corn")
    assert hh[wheat, 135] == pytest.approx(0.5 * vv[wheat, 135])
    assert hh[wheat, 300] == pytest.approx(vv[wheat, 300])  # above the level: no dip
    np.testing.assert_allclose(hh[corn], vv[corn])
    for frequency, factor in ((9.6, 0.7), (13.6, 0.5)):
        other = at(136, "VV", frequency).course.change_db
        np.testing.assert_allclose(other[wheat], factor * vv[wheat])
        np.testing.assert_allclose(other[corn], vv[corn])


@pytest.mark.parametrize(("channels", "correlation"), [(("HH", "VV"), 0.85), (("HV", "VV"), 0.75)])
def test_courses_of_channels_are_related_as_their_levels_are_from_40_deg_on(
    channels: tuple[str, str], correlation: float
) -> None:
    """A course holds at all angles: what HH and VV have more in common when steep is no part of it."""
    days = np.full(365, 1.0 / 365.0)
    one, other = (
        np.array([World(3, k).season("Wheat", "crop", 5.4, channel, days) for k in range(400)]) for channel in channels
    )
    each = np.mean(one * other, axis=1)  # of unit mean square over the year and worlds
    assert abs(each.mean() - correlation) < 4.0 * each.std() / np.sqrt(len(each)) < 0.13


def test_the_course_of_worlds_has_four_harmonics():
    days = np.full(365, 1.0 / 365.0)  # over which harmonics have no mean
    draws = np.array([World(3, k).season("Wheat", "crop", 5.4, "VV", days) for k in range(600)])
    assert np.mean(draws**2) == pytest.approx(1.0, abs=0.05)
    np.testing.assert_allclose(course_deviation(days), 1.0)
    shares = (0.4, 0.3, 0.2, 0.1)
    for lag in (30, 91, 182):
        expected = sum(w * np.cos(2.0 * np.pi * h * lag / 365.0) for h, w in enumerate(shares, start=1))
        found = np.mean(draws[:, 0] * draws[:, lag]) / np.mean(draws**2)
        assert found == pytest.approx(expected, abs=0.12)


def test_what_half_lasts_is_half_the_same_on_two_dates():
    days, key = (120.0, 120.25, 123.0, 150.0), {"seed": 3, "run_id": 4}
    one, *others = (half_lasting(Visit(days, t), "texture", (40_000,), 5.4, **key) for t in range(4))
    for day, other in zip(days[1:], others, strict=True):
        assert (one.std(), other.std()) == pytest.approx((1.0, 1.0), abs=0.02)
        related = 0.5 + 0.5 * left(day - 120.0, 4.5)  # the weather's half
        assert np.corrcoef(one, other)[0, 1] == pytest.approx(related, abs=0.02)
    static = half_lasting(Visit(), "texture", (40_000,), 5.4, **key)
    assert static.std() == pytest.approx(1.0, abs=0.02)


def test_a_late_year_and_a_late_field_are_looked_at_before_their_time(monkeypatch):
    """Nothing else is left: offsets are what the course was so many days ago."""
    for name, value in (("_WEATHER_DB", (0.0, 0.0)), ("_CROP_WEATHER_DB", (0.0, 0.0)), ("_YEAR_DB", 0.0)):
        monkeypatch.setattr(occasion, name, value)
    monkeypatch.setattr("seqrsm.scattering.calendar._BARE_FIELDS_DB", (0.0, 0.0))
    looked = at(150.0)
    looked = replace(looked, field_sd_db=np.zeros_like(looked.field_sd_db))
    fields = np.repeat(np.arange(len(CROPS), dtype=np.uint8), 50)
    key = {"seed": 8, "run_id": 9}
    found = draw_occasion(radar(), [looked], fields, (0.2, 5.0), Visit((150.0,)), **key)
    late = year_shift_days(len(CROPS), **key)
    shift = field_shift_days(looked.course.shift_days[fields], **key)
    assert np.abs(late).min() > 0.5

    def course(k, day):
        return np.interp(day, DAYS, looked.course.change_db[k], period=365.0)

    for k in range(len(CROPS)):
        assert found.class_offset_db[0, k] == pytest.approx(course(k, 150.0 - late[k]) - course(k, 150.0))
        mine = fields == k
        expected = course(k, 150.0 - late[k] - shift[mine]) - course(k, 150.0 - late[k])
        np.testing.assert_allclose(found.field_offset_db[0, mine], expected, atol=1e-12)


def test_two_looks_on_one_day_meet_the_same_weather(monkeypatch):
    """Else a second look after six hours would tell crops apart by weather that is drawn anew for each of them."""
    monkeypatch.setattr(occasion, "_YEAR_DB", 0.0)
    monkeypatch.setattr(occasion, "year_shift_days", lambda n, **key: np.zeros(n))
    days, covers = (150.0, 150.25, 154.5, 180.0), (*CROPS, "Trees")
    looked, fields = [at(day, categories=covers) for day in days], np.zeros(1, dtype=np.uint8)

    def offsets(run):
        given = [(radar(), [one], fields, (0.2, 5.0), Visit(days, t)) for t, one in enumerate(looked)]
        return [draw_occasion(*one, seed=3, run_id=run).class_offset_db[0] for one in given]

    found = np.array([offsets(run) for run in range(900)])
    canopy = [1.0 - on_day(one.course.soil_share, day)[:-1] for one, day in zip(looked, days, strict=True)]
    np.testing.assert_allclose(found[:, :, :-1].std(axis=0), np.hypot(0.8 * np.array(canopy), 0.5), rtol=0.1)
    assert found[:, :, -1].std() == pytest.approx(looked[0].date_sd_db[-1], rel=0.06)
    for t, day in enumerate(days):
        together = [np.corrcoef(found[:, 0, k], found[:, t, k])[0, 1] for k in range(len(covers))]
        weather, crop = left(day - 150.0, 4.5), left(day - 150.0, 10.0)
        assert together[-1] == pytest.approx(weather, abs=0.1)
        shared, own = np.square(0.8 * canopy[0]), 0.5**2
        wanted = (0.8**2 * canopy[0] * canopy[t] * weather + own * crop) / np.sqrt(
            (shared + own) * (np.square(0.8 * canopy[t]) + own)
        )
        assert np.mean(together[:-1]) == pytest.approx(wanted.mean(), abs=0.05)


def test_a_crops_own_weather_is_forgotten_in_ten_days(monkeypatch):
    """Of grass, which always covers its ground: nothing of that is the soil's."""
    for name, value in (("_WEATHER_DB", (0.0, 0.0)), ("_YEAR_DB", 0.0)):
        monkeypatch.setattr(occasion, name, value)
    monkeypatch.setattr(occasion, "year_shift_days", lambda n, **key: np.zeros(n))
    days, grass = (150.0, 155.0, 160.0), CROPS.index("Grass")
    looked, field = [at(day) for day in days], np.zeros(1, dtype=np.uint8)

    def offset(t, run):
        met = draw_occasion(radar(), [looked[t]], field, (0.2, 5.0), Visit(days, t), seed=3, run_id=run)
        return met.class_offset_db[0, grass]

    found = np.corrcoef([[offset(t, run) for run in range(900)] for t in range(3)])[0]
    np.testing.assert_allclose(found, [left(day - 150.0, 10.0) for day in days], atol=0.06)


@pytest.mark.parametrize(("channel", "shared", "own"), [("VV", 0.8, 0.5), ("HV", 1.1, 0.85)])
def test_weather_that_crops_share_is_of_the_part_of_the_echo_that_is_not_the_soils(monkeypatch, channel, shared, own):
    """The soil's part has the moisture of the date in its place; L band sees more soil than is bare."""
    monkeypatch.setattr(occasion, "_YEAR_DB", 0.0)
    monkeypatch.setattr(occasion, "year_shift_days", lambda n, **key: np.zeros(n))
    looked, given = at(165.0, channel, frequency=1.25), ((0.2, 5.0), Visit((165.0,)))
    sensor = radar(1.25, channel)
    found = [
        draw_occasion(sensor, [looked], np.zeros(1, dtype=np.uint8), *given, seed=3, run_id=run).class_offset_db[0]
        for run in range(1000)
    ]
    soil = on_day(looked.course.soil_share, 165.0)
    assert channel == "HV" or (soil > 1.0 - looked.closed + 0.1).any()
    np.testing.assert_allclose(np.std(found, axis=0), np.hypot(shared * (1.0 - soil), own), rtol=0.08)


@pytest.mark.parametrize(
    ("channel", "weather_db", "share", "memory"), [("VV", 0.4, 0.78, 86.0), ("HV", 0.55, 0.77, 49.0)]
)
def test_fields_have_weather_of_their_own(channel, weather_db, share, memory):
    """Grass, whose fields are neither early nor late: of what does not last it takes its part, and is gone in days."""
    days, fields = (150.0, 152.0, 159.0), np.full(40_000, CROPS.index("Grass"), dtype=np.uint8)
    met = [
        draw_occasion(radar(5.4, channel), [at(day, channel)], fields, (0.2, 5.0), Visit(days, t), seed=7, run_id=1)
        for t, day in enumerate(days)
    ]
    found = np.array([one.field_offset_db[0] for one in met])
    fast = weather_db**2 / found[0].var()
    for t in (1, 2):
        slow, quick = left(days[t] - days[0], memory), left(days[t] - days[0], 4.5)
        wanted = share + (1.0 - share - fast) * slow + fast * quick
        assert np.corrcoef(found[0], found[t])[0, 1] == pytest.approx(wanted, abs=0.005)


def test_wind_goes_with_the_weather_and_is_uniform_on_each_date():
    """Else water alone would change between two looks within the hour."""
    days = (150.0, 150.04, 153.0, 180.0)
    windy = replace(radar(), wind_low_m_s=2.0, wind_high_m_s=10.0)
    wind = np.array(
        [[draw_ground_state(windy, Visit(days, t), seed=5, run_id=k)[1] for t in range(4)] for k in range(1500)]
    )
    normal = stats.norm.ppf((wind - 2.0) / 8.0)
    for t, day in enumerate(days):
        assert stats.kstest(wind[:, t], "uniform", (2.0, 8.0)).pvalue > 0.01
        assert np.corrcoef(normal[:, 0], normal[:, t])[0, 1] == pytest.approx(left(day - 150.0, 4.5), abs=0.06)


def test_calibration_errs_for_all_covers_of_a_channel_alike():
    looks = [at(150.0), at(150.0, "HV")]
    fields = np.zeros(1, dtype=np.uint8)

    def offsets(sd, run):
        configuration = replace(radar(polarization="VV+VH"), calibration_sd_db=sd)
        visit = Visit((150.0,))
        return draw_occasion(configuration, looks, fields, (0.2, 5.0), visit, seed=2, run_id=run).class_offset_db

    errors = np.array([offsets(2.0, run) - offsets(0.0, run) for run in range(400)])
    np.testing.assert_allclose(np.ptp(errors, axis=2), 0.0, atol=1e-12)
    np.testing.assert_allclose(errors[:, :, 0].std(axis=0), 2.0, rtol=0.15)
    assert abs(np.corrcoef(errors[:, 0, 0], errors[:, 1, 0])[0, 1]) < 0.2


def test_values_on_days_are_those_of_numpy_across_the_ends_of_the_year():
    years = np.random.default_rng(4).normal(size=(3, 365))
    days = np.array([-400.2, -0.5, 0.0, 0.3, 1.0, 180.25, 364.0, 364.9, 365.0, 365.4, 366.0, 800.7])
    np.testing.assert_array_equal(on_day(years, days), [np.interp(days, DAYS, year, period=365.0) for year in years])
    np.testing.assert_array_equal(on_day(years, 364.9), on_day(years, days)[:, 7])


@pytest.mark.parametrize("world", [None, World(5, 3)])
def test_the_year_is_a_circle(world):
    """Day 380 is day 15, and the night to day 1 takes what the nights around it take."""
    table = TABLE.in_world(world)
    for frequency in (1.25, 5.4):
        now, later = (at(day, "HV", frequency, table=table) for day in (15.5, 380.5))
        np.testing.assert_array_equal(now.sigma0, later.sigma0)
        np.testing.assert_array_equal(now.mean_sd_db, later.mean_sd_db)
        year = at(15.0, "HV", frequency, table=table).course.change_db
        nights = np.abs(np.diff(year[:, np.arange(-8, 8)], axis=1))  # day 358 to day 8
        assert (nights[:, 7] <= nights.max(axis=1, where=np.arange(15) != 7, initial=0.0) + 0.01).all()
    emission = load_emissivity_table()
    now, later = (emission.lookup(("Wheat",), 1.4, "H", day=day).emissivity for day in (15.0, 380.0))
    np.testing.assert_array_equal(now, later)


def test_fields_keep_their_history_over_the_new_year():
    """Twenty days apart they are as much alike at the turn of the year as in spring."""
    met = [field_offsets(days, "Grass") for days in ((355.0, 375.0), (100.0, 120.0))]
    turn, spring = (np.corrcoef(fields) for fields in met)
    assert turn[0, 1] == pytest.approx(spring[0, 1], abs=0.03)
    fast, (left, quick) = 0.4**2 / met[0].var(), np.exp(-20.0 / np.array([86.0, 4.5]))
    assert turn[0, 1] == pytest.approx(0.78 + (0.22 - fast) * left + fast * quick, abs=0.02)
    moist = np.array([[moisture_share(Visit((355.0, 375.0), t), seed=1, run_id=k) for t in (0, 1)] for k in range(900)])
    expected = 0.74 * np.exp(-20.0 / 30.0) + 0.26 * np.exp(-20.0 / 4.5)
    assert np.corrcoef(stats.norm.ppf(moist).T)[0, 1] == pytest.approx(expected, abs=0.09)


@pytest.mark.parametrize("frequency", [1.4, 10.7, 37.0])
@pytest.mark.parametrize("channel", ["H", "V"])
def test_bare_fields_emit_as_bare_soil_whatever_was_sown(frequency, channel):
    """In January, at all angles and moistures, as warm and as uneven; in July maize is no bare soil."""
    covers = ("Bareground", "Corn", "Oats", "Vegetables")
    bare, *crops = range(len(covers))
    table = load_emissivity_table()
    for world in (None, World(6, 1)):
        january = table.in_world(world).lookup(covers, frequency, channel, day=15)
        for crop in crops:
            np.testing.assert_allclose(january.emissivity[crop], january.emissivity[bare], rtol=1e-12)
        for of_covers in (january.heating, january.field_part, january.date_part):
            np.testing.assert_allclose(of_covers, of_covers[bare], rtol=1e-12)
    july = table.lookup(covers, frequency, channel, day=190)
    assert np.abs(july.emissivity[crops, 6, 40] - july.emissivity[bare, 6, 40]).min() > 0.01
    assert july.heating[crops].max() < 0.6 < july.heating[bare]
    nadir = july.field_part * (1.0 - july.emissivity[:, 6, 0])
    assert nadir[crops].max() < 0.8 * nadir[bare]


def test_rapeseed_emits_by_the_water_of_its_own_canopy():
    """Sown in August it covers the ground in January, when the vegetables whose emissivity it has are not sown."""
    assert SHIPPED.canopy_share("Rapeseed", 15) == pytest.approx(0.74, abs=0.01)
    day = next(d for d in range(150, 200) if SHIPPED.canopy_share("Vegetables", d) > 0.737)
    assert emissivity("Rapeseed", 15) == pytest.approx(emissivity("Vegetables", day), abs=0.01)
    assert emissivity("Rapeseed", 15) > emissivity("Bareground", 15) + 0.1


@pytest.mark.parametrize("day", [15, 152, 200])
def test_half_closed_crops_emit_as_far_off_as_is_told(day):
    """Maize, bare, half closed and closed."""
    table = load_emissivity_table()
    told = table.lookup(("Corn",), 1.4, "H", day=day)
    worlds = (table.in_world(World(6, k)).lookup(("Corn",), 1.4, "H", day=day) for k in range(1500))
    parts = [(1.0 - world.emissivity[0, 4, 40]) / (1.0 - told.emissivity[0, 4, 40]) for world in worlds]
    assert np.std(parts) == pytest.approx(told.mean_part[0], rel=0.06)


def test_weather_and_year_do_not_tell_bare_fields_of_one_crop_from_those_of_another():
    """In January bare ground, maize and vegetables depart from their courses as one, in July each by itself."""
    covers = ("Corn", "Vegetables", "Bareground")
    for day, apart_db in ((15.0, 0.0), (190.0, math.hypot(0.4, 1.0) * math.sqrt(2.0))):
        looked = at(day, categories=covers)
        looked = replace(looked, course=replace(looked.course, change_db=0.0 * looked.course.change_db))
        drawn = [
            draw_occasion(radar(), [looked], np.zeros(1, dtype=np.uint8), (0.2, 5.0), Visit((day,)), seed=8, run_id=k)
            for k in range(300)
        ]
        offset = np.array([one.class_offset_db[0] for one in drawn])
        assert offset.std(axis=0).min() > 1.0
        assert (offset[:, 0] - offset[:, 1]).std() == pytest.approx(apart_db, rel=0.15, abs=1e-12)
        if day == 15.0:
            np.testing.assert_allclose(offset[:, 2], offset[:, 0], atol=1e-12)


@pytest.mark.parametrize("frequency", [1.25, 2.6, 5.4, 9.6])
@pytest.mark.parametrize("channel", ["HH", "HV", "VV"])
def test_fields_that_lie_bare_feel_the_moisture_of_bare_ground(channel, frequency):
    """By the part of the echo that is the soil's; trees and water feel none of it."""
    covers = (*CROPS, "Bareground", "Trees", "Gravel")

    def change(**when):
        levels = [
            linear_to_db(TABLE.lookup(covers, frequency, channel, soil_moisture=mv, **when).sigma0) for mv in (0.1, 0.3)
        ]
        return dict(zip(covers, (levels[1] - levels[0])[:, [20, 40, 60]], strict=True))

    summer, january, july, fall = change(), change(day=15), change(day=195), change(season="fall")
    soil = moisture_change_db(frequency, SOIL_RMS_M, 0.3, 0.2) - moisture_change_db(frequency, SOIL_RMS_M, 0.1, 0.2)
    soil = soil[("HH", "HV", "VV").index(channel)][[20, 40, 60]]
    for found in (summer, january, july, fall):
        np.testing.assert_allclose(found["Bareground"], soil, atol=1e-9)
        np.testing.assert_array_equal([found["Trees"], found["Gravel"]], 0.0)
    np.testing.assert_allclose([january["Corn"], january["Vegetables"]], [soil, soil], atol=1e-9)
    assert all((summer[name] == 0.0).all() for name in CROPS)
    assert (fall["Wheat"] > 0.45 * soil).all()
    assert (fall["Wheat"] < 1.05 * soil).all()
    course = at(195, channel, frequency, covers).course
    part = dict(zip(covers, on_day(course.soil_share, 195.0), strict=True))
    for name in ("Corn", "Wheat"):
        steps = [moisture_change_db(frequency, SOIL_RMS_M, mv, 0.2) for mv in (0.1, 0.3)]
        felt = [1.0 + part[name] * (10.0 ** (0.1 * one[("HH", "HV", "VV").index(channel), 40]) - 1.0) for one in steps]
        assert july[name][1] == pytest.approx(10.0 * math.log10(felt[1] / felt[0]), abs=1e-9)
        assert part[name] < (0.75 if frequency < 2.0 else 0.6)


def test_ground_of_fall_has_the_power_of_its_bare_part():
    """Stubble is 0.85 bare soil in power: what moisture adds to it is 0.85 of what it adds to bare ground."""
    dry, wet = (
        TABLE.lookup(("Wheat", "Bareground"), 5.4, "VV", season="fall", soil_moisture=mv).sigma0[:, 40]
        for mv in (0.1, 0.3)
    )
    added = wet - dry
    assert added[0] == pytest.approx(0.85 * added[1], rel=1e-9)
