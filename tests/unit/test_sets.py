"""Sets of sensors and their dates: who gets which parameter, and what is refused."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from scored_campaigns import campaign, specification

from seqrsm.campaign.simulation import SimulationTask, acquisitions_of
from seqrsm.campaign.simulator_checks import _idle_rows
from seqrsm.design.factors import CategoricalFactor, ContinuousFactor
from seqrsm.errors import ConfigurationError, ScatteringDataError, SpecError
from seqrsm.report.blocks import Paragraph, Table
from seqrsm.report.sections.summary import summary_section
from seqrsm.report.wording import rounded_settings, told_settings
from seqrsm.scattering.emissivity import load_emissivity_table
from seqrsm.sensor.sets import BANDS, Dates, day_of_year, members_of, set_problems
from seqrsm.spec.read import load_spec
from seqrsm.spec.sensors import without_effect

FIXED = {"polarization": "HH+HV", "bandwidth": 50.0, "peak_power": 30.0, "altitude_m": 6000.0, "depression_angle": 45.0}

PASSIVE = {
    "engine": "prm", "frequency": 1.4, "polarization": "H+V", "resolution": 300.0, "integration_time": 10.0,
    "bandwidth": 20.0, "noise_temperature": 500.0, "scan_period": 1.0, "speed_m_s": 60.0,
}  # fmt: skip


def made(settings, members=None, **fixed):
    return acquisitions_of("psm", settings, {**FIXED, **fixed}, members or {})


def test_a_single_sensor_is_what_it_was() -> None:
    (alone,) = made({"frequency": 5.4, "resolution": 20.0})
    assert (alone.member, alone.visit.days, alone.sensor.frequency_ghz, alone.label) == ("", (), 5.4, "")
    (by_letter,) = made({"frequency": "C", "resolution": 20.0})
    assert by_letter.sensor == alone.sensor
    (held,) = made({"resolution": 20.0}, frequency="C")
    assert held.sensor == alone.sensor


def test_each_member_has_its_own_before_what_holds_for_all() -> None:
    members = {"C": {"polarization": "VV+VH", "peak_power": 90.0}}
    settings = {"frequency": "L+C+9.6", "resolution": 20.0, "C.resolution": 10.0, "peak_power": 40.0}
    settings["9.6.resolution"] = 5.0
    low, middle, high = made(settings, members)
    assert [one.member for one in (low, middle, high)] == ["L", "C", "9.6"]
    assert [one.sensor.frequency_ghz for one in (low, middle, high)] == [BANDS["L"], BANDS["C"], 9.6]
    assert [one.sensor.resolution_m for one in (low, middle, high)] == [20.0, 10.0, 5.0]
    assert [one.sensor.peak_power_w for one in (low, middle, high)] == [40.0, 90.0, 40.0]
    assert middle.sensor.channels == ("VV", "VH")
    assert middle.sensor.n_transmit == 1
    assert [one.visit.member for one in (low, middle, high)] == [0, 1, 2]


def test_a_radiometer_beside_a_radar() -> None:
    radar, radiometer = made({"frequency": "C+passive", "resolution": 20.0}, {"passive": PASSIVE}, first_day=150.0)
    assert (radar.engine, radiometer.engine) == ("psm", "prm")
    assert (radiometer.sensor.resolution_m, radiometer.sensor.day_of_year) == (300.0, 150.0)
    assert radiometer.visit.day == radar.visit.day == 150.0


def test_a_series_over_the_new_year_is_one_season() -> None:
    """Days count on, so that gaps are right; what people and the sun are told is the day of the year."""
    when = {"dates": 6, "first_day": 300.0, "interval_days": 20.0}
    found = made({"frequency": "passive", "resolution": 20.0, **when}, {"passive": PASSIVE})
    assert [one.record()["day"] for one in found] == [300.0, 320.0, 340.0, 360.0, 15.0, 35.0]
    assert [one.sensor.day_of_year for one in found] == [300.0, 320.0, 340.0, 360.0, 15.0, 35.0]
    assert found[4].label == "passive, day 15"
    np.testing.assert_array_equal(np.diff(found[0].visit.days), 20.0)


def test_days_of_the_year_begin_anew_after_365() -> None:
    days = (1.0, 365.0, 365.75, 366.0, 380.5, 730.0, 731.0)
    assert [day_of_year(day) for day in days] == [1.0, 365.0, 365.75, 1.0, 15.5, 365.0, 1.0]


def test_days_of_all_members_are_one_calendar() -> None:
    found = made(
        {"frequency": "L+C", "resolution": 20.0, "dates": 2, "first_day": 120.0, "interval_days": 30.0},
        {"C": {"dates": 3, "interval_days": 15.0}},
    )
    assert [(one.member, one.visit.day) for one in found] == [
        ("L", 120.0), ("L", 150.0), ("C", 120.0), ("C", 135.0), ("C", 150.0),
    ]  # fmt: skip
    assert {one.visit.days for one in found} == {(120.0, 135.0, 150.0)}
    assert found[1].label == "L, day 150"


@pytest.mark.parametrize(
    ("given", "days"),
    [
        ({}, ()),
        ({"first_day": 100.0}, (100.0,)),
        ({"dates": 3, "first_day": 100.0, "interval_days": 10.0}, (100.0, 110.0, 120.0)),
        ({"days": "120+150.5+200"}, (120.0, 150.5, 200.0)),
        ({"first_day": 365.0}, (365.0,)),
        ({"dates": 3, "first_day": 340.0, "interval_days": 20.0}, (340.0, 360.0, 380.0)),
        ({"days": "340+380"}, (340.0, 380.0)),
    ],
)
def test_dates(given, days) -> None:
    assert Dates(**given).on == days


@pytest.mark.parametrize(
    ("given", "words"),
    [
        ({"dates": 2}, "need a first day"),
        ({"days": "120", "first_day": 100.0}, "specified twice"),
        ({"days": "120+spring"}, "no rising days"),
        ({"days": "300+20"}, "no rising days.*385"),  # October and the January after it, 85 days later
        ({"days": "120+120"}, "no rising days"),
        ({"days": "0"}, "no rising days"),
        ({"first_day": 5000.0}, "no rising days"),
    ],
)
def test_impossible_dates_are_refused(given, words) -> None:
    with pytest.raises(ConfigurationError, match=words):
        Dates(**given)


@pytest.mark.parametrize(
    ("settings", "members", "words"),
    [
        ({"frequency": "L+Q"}, {}, "no such member of a set.*Q"),
        ({"frequency": "L+L"}, {}, "stands twice"),
        ({"frequency": "L+C", "C.first_day": 100.0}, {}, "the sensor L of the set has no date"),
        (
            {"frequency": "L+C", "L.first_day": 10.0, "C.first_day": 380.0},
            {},
            "the dates span 370 days, more than one year of crops",
        ),
        ({"frequency": "C", "dates": 12, "first_day": 100.0, "interval_days": 180.0}, {}, "the dates span 1980 days"),
        ({"frequency": "C", "days": "10+375"}, {}, "the dates span 365 days"),
        ({"frequency": "C", "dates": 14, "first_day": 200.0, "interval_days": 30.0}, {}, "the dates span 390 days"),
        ({"frequency": "C", "first_day": 100.0, "season": "winter"}, {}, "the season follows from the dates"),
        ({"frequency": "L+C"}, {"C": {"resolution": 1.0, "antenna_length_m": 10.0}}, "sensor C of the set"),
    ],
)
def test_impossible_sets_are_refused(settings, members, words) -> None:
    with pytest.raises(ConfigurationError, match=words):
        made({"resolution": 20.0, **settings}, members)


def test_members_of_nothing_else_are_told_by_engine() -> None:
    (one, two) = members_of("psm", {"frequency": "1.25+radio"}, {}, {"radio": {"engine": "prm", "frequency": 1.4}})
    assert (one.engine, two.engine, two.settings["frequency"]) == ("psm", "prm", 1.4)


def test_each_sensor_of_a_set_takes_its_rows_of_the_users_table(tmp_path) -> None:
    """A crop that no built-in table has is seen by a radar and a radiometer; the main engine needs rows."""
    header = "quantity,category,frequency_ghz,polarization,theta_deg,value,unit,status,source\n"
    radar, radiometer = (
        "".join(f"{start},{theta},{value},{unit},measured,me\n" for theta in (0, 60))
        for start, value, unit in (("sigma0,Hemp,1.25,HH", -10, "dB"), ("emissivity,Hemp,1.4,H", 0.9, "1"))
    )
    own = tmp_path / "own.csv"
    own.write_text(header + radar + radiometer)
    task = SimulationTask("psm", 1, 0, {}, {}, "s.npz", str(own), ())
    assert task.scattering("psm").lookup(["Hemp"], 1.25, "HH").sigma0[0, 30] == pytest.approx(0.1)
    assert task.scattering("prm").lookup(["Hemp"], 1.4, "H").emissivity[0, 0, 30] == 0.9
    alone = tmp_path / "alone.csv"
    alone.write_text(header + radar)
    assert replace(task, table=str(alone)).scattering("prm").curves == load_emissivity_table().curves
    with pytest.raises(ScatteringDataError, match="no rows of emissivity"):
        replace(task, engine="prm", table=str(alone)).scattering("prm")


TOML = """
[campaign]
name = "sets"
[[factor]]
name = "frequency"
levels = ["L", "C", "L+C"]
[[factor]]
name = "{factor}"
low = 10.0
high = 40.0
[[application]]
name = "crops"
utility = "percent_correct"
[simulator]
engine = "psm"
scene = "s.npz"
[simulator.fixed]
polarization = "HH"
{more}
[stop]
half_width = 3.0
"""


@pytest.mark.parametrize(
    ("factor", "more", "words"),
    [
        ("C.resolution", "", None),
        ("resolution", '[simulator.members.C]\npolarization = "VV+VH"', None),
        ("X.resolution", "", "'X' is no member of a set"),
        ("C.resolutoin", "", "Did you mean 'C.resolution'"),
        ("resolution", "[simulator.members.S]\nlooks = 4", "no set has this member"),
        ("resolution", "[simulator.members.C]\nlocks = 4", "Did you mean 'looks'"),
        ("resolution", '[simulator.members.C]\nengine = "lidar"', "there is no such engine"),
        ("resolution", "[simulator.members.C]\nfrequency = [5.4]", r"members\.C\.frequency: a number is expected"),
        ("resolution", '"C.locks" = 4', "'C' has no such sensor parameter"),
        ("resolution", "heading_dge = 4", "no sensor of the set has such.*Did you mean 'heading_deg'"),
        ("C.frequency", "", "identifies the member"),
    ],
)
def test_what_a_file_says_of_a_set(tmp_path, factor, more, words) -> None:
    (tmp_path / "s.npz").write_bytes(b"")
    (tmp_path / "campaign.toml").write_text(TOML.format(factor=factor, more=more), encoding="utf-8")
    if words is None:
        assert load_spec(tmp_path).region.names == ("frequency", factor)
        return
    with pytest.raises(SpecError, match=words) as told:
        load_spec(tmp_path)
    assert told.value.problems[0].line


def test_a_factor_below_one_without_a_name_keeps_its_line(tmp_path) -> None:
    (tmp_path / "s.npz").write_bytes(b"")
    text = TOML.format(factor="X.resolution", more="").replace('name = "frequency"\n', "")
    (tmp_path / "campaign.toml").write_text(text, encoding="utf-8")
    with pytest.raises(SpecError) as told:
        load_spec(tmp_path)
    (problem,) = [one for one in told.value.problems if "no member of a set" in one.message]
    assert (problem.line, problem.field) == (
        text.splitlines().index('name = "X.resolution"') + 1,
        "factor 'X.resolution': name",
    )


def test_a_setting_of_a_sensor_that_is_not_in_the_recommended_set_is_not_recommended(tmp_path) -> None:
    """The best set lacks C: its angle has no effect, and no wider range of it would have one."""
    factors = '[[factor]]\nname = "frequency"\nlevels = ["L", "C"]\n[[factor]]\nname = "C.angle"\nlow = 20\nhigh = 50\n'
    points = np.column_stack([np.arange(40) % 2, np.random.default_rng(1).uniform(-1.0, 1.0, 40)])
    scores = 60.0 - 9.0 * points[:, 0] * (1.0 + points[:, 1]) + np.random.default_rng(2).normal(size=40)
    found = campaign(tmp_path / "c", specification(factors), points, scores)
    (analysis,) = found.analyse_all(n_draws=400)
    told = summary_section(found.spec, [analysis], None, ())
    words = [block.text for block in told.blocks if isinstance(block, Paragraph)]
    assert analysis.optimum.settings["frequency"] == "L"
    assert any(text.startswith("Recommended for score: frequency L, the settings") for text in words)
    assert "widening" not in str(told)
    (rows,) = [block.rows for block in told.blocks if isinstance(block, Table)]
    assert [[cell.text for cell in row] for row in rows][1] == ["C.angle", "–", "–", "–"]
    note = "Of no effect, as no sensor of the set takes it or there is but one date: C.angle."
    assert note in words
    assert analysis.notes == (note,)
    assert rounded_settings(analysis, analysis.optimum.settings) == "frequency L"
    assert told_settings(found.spec.region, {"frequency": "C", "C.angle": 30.0}, {})["C.angle"] == "30.00"


@pytest.mark.parametrize(
    ("settings", "idle"),
    [
        ({"dates": 1.0, "interval_days": 9.0}, ("interval_days",)),
        ({"dates": 2.0, "interval_days": 9.0}, ()),
        ({"interval_days": 9.0}, ()),
        ({"dates": 1.0, "interval_days": 9.0, "C.dates": 4.0}, ()),
        ({"dates": 1.0, "C.interval_days": 9.0}, ("C.interval_days",)),
        ({"dates": 4.0, "C.dates": 1.0, "C.interval_days": 9.0, "interval_days": 6.0}, ("C.interval_days",)),
    ],
)
def test_an_interval_between_dates_has_no_effect_on_one_date(settings, idle) -> None:
    """All of a run's acquisitions are the same whatever it is, or they are not."""
    factors = [CategoricalFactor("frequency", ("L+C", "C"))]
    factors += [ContinuousFactor(name, 1.0, 20.0) for name in settings]
    settings = {"frequency": "L+C", **settings}
    assert without_effect(factors, settings) == idle
    fixed = {"first_day": 100.0} | ({} if "dates" in settings else {"dates": 2.0})
    for name in (one for one in settings if one.endswith("interval_days")):
        when = [{m.dates.on for m in members_of("psm", {**settings, name: d}, fixed, {})} for d in (9.0, 12.0)]
        assert (when[0] == when[1]) == (name in idle)


def test_a_setting_that_no_sensor_of_the_set_takes_has_no_effect(tmp_path) -> None:
    """A radiometer has no depression angle, and polarizations of its own; beside a radar both hold for the radar."""
    (tmp_path / "s.npz").write_bytes(b"")
    own = {"engine": "prm", "frequency": 1.4, "polarization": "H", "integration_time": 5.0, "scan_period": 1.0}
    given = {**own, "noise_temperature": 500.0}
    more = "[simulator.members.passive]\n" + "".join(f"{key} = {value!r}\n" for key, value in given.items())
    text = TOML.format(factor="depression_angle", more=more).replace('"L+C"', '"L+C", "C+passive", "passive"')
    polarization = '[[factor]]\nname = "polarization"\nlevels = ["HH", "VV"]\n[[factor]]\nname = "C.resolution"'
    text = text.replace("[simulator]", f"{polarization}\nlow = 20\nhigh = 40\n[simulator]", 1)
    text = text.replace('polarization = "HH"\n[', "[")
    (tmp_path / "campaign.toml").write_text(text, encoding="utf-8")
    spec = load_spec(tmp_path)
    for sensors, idle in (("passive", 3), ("C+passive", 0), ("L", 1)):
        settings = {"frequency": sensors, "depression_angle": 50.0, "polarization": "HH", "C.resolution": 30.0}
        found = without_effect(spec.factors, settings)
        assert len(found) == idle
        for name, other in (("depression_angle", 40.0), ("polarization", "VV"), ("C.resolution", 20.0)):
            made = [members_of("psm", {**settings, **new}, {}, spec.simulator.members) for new in ({}, {name: other})]
            assert (made[0] == made[1]) == (name in found)


def test_an_interval_for_all_goes_with_dates_for_all(tmp_path) -> None:
    """A member with dates of its own would feel an interval that has no effect where all others look once."""
    (tmp_path / "s.npz").write_bytes(b"")
    text = TOML.format(factor="interval_days", more="[simulator.members.C]\ndates = 3")
    (tmp_path / "campaign.toml").write_text(text, encoding="utf-8")
    with pytest.raises(SpecError, match=r"members\.C\.dates: dates of its own.*Give it interval_days, too"):
        load_spec(tmp_path)
    (tmp_path / "campaign.toml").write_text(
        text.replace("dates = 3", "dates = 3\ninterval_days = 20"), encoding="utf-8"
    )
    assert load_spec(tmp_path).region.names == ("frequency", "interval_days")


def test_a_dot_in_a_name_alone_makes_no_member_of_a_set() -> None:
    """Factors of measured scores may have any name."""
    factors = [CategoricalFactor("frequency", ("L", "L + C")), ContinuousFactor("az.gain", 1.0, 2.0)]
    assert without_effect(factors, {"frequency": "L", "az.gain": 1.0}) == ()
    factors[1] = ContinuousFactor("C.gain", 1.0, 2.0)
    assert without_effect(factors, {"frequency": "L", "C.gain": 1.0}) == ("C.gain",)
    assert without_effect(factors, {"frequency": "L + C", "C.gain": 1.0}) == ()
    assert without_effect(factors[1:], {"C.gain": 1.0}) == ()


def test_a_band_with_a_table_of_its_own_is_named_once() -> None:
    (problem,) = set_problems("L+Q", {"C": {"polarization": "VV+VH"}, "az": {"frequency": 9.4}})
    assert problem.remedy.endswith(": P, L, S, C, X, Ku, K, Ka, az")


def test_rows_of_either_quantity_for_covers_that_a_scene_has_not_are_told(tmp_path) -> None:
    header = "quantity,category,frequency_ghz,polarization,theta_deg,value,unit,status,source\n"
    own = tmp_path / "own.csv"
    kinds = ("sigma0,Grass,1.25,HH", "-10,dB"), ("emissivity,Gras,1.4,H", "0.9,1")
    own.write_text(header + "".join(f"{a},{theta},{b},measured,me\n" for a, b in kinds for theta in (0, 60)))
    task = SimulationTask("psm", 1, 0, {}, {}, "s.npz", str(own), ())
    spec = SimpleNamespace(simulator=SimpleNamespace(engine="psm", table="own.csv", calendar=""))
    (note,) = _idle_rows(spec, SimpleNamespace(categories=("Grass", "Water")), task)
    assert note == "rows of own.csv for Gras have no effect: the scene has Grass, Water"
