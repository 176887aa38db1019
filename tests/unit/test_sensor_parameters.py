"""The table of sensor parameters against all that must agree with it: fields, defaults, campaign.toml."""

from __future__ import annotations

import math
import re
from collections import Counter
from dataclasses import MISSING, fields
from pathlib import Path
from typing import Any, Literal, get_args, get_origin, get_type_hints

import pytest

from seqrsm.design.factors import CategoricalFactor, ContinuousFactor, DiscreteFactor
from seqrsm.errors import ConfigurationError, Problem, SpecError
from seqrsm.report.wording import fixed_unit, readable
from seqrsm.sensor import radar, radiometer
from seqrsm.sensor.parameters import RADAR, RADIOMETER, Parameter
from seqrsm.sensor.radar import RadarConfiguration
from seqrsm.sensor.radiometer import RadiometerConfiguration
from seqrsm.spec.read import CampaignSpec, load_spec

README = (Path(__file__).parents[2] / "campaigns" / "README.md").read_text(encoding="utf-8")
SENSORS = {"psm": (RADAR, RadarConfiguration), "prm": (RADIOMETER, RadiometerConfiguration)}
ROWS = [(engine, row) for engine, (table, _) in SENSORS.items() for row in table.values()]
TABLE_1 = {
    "psm": ("frequency", "polarization", "resolution", "looks", "bandwidth", "peak_power", "depression_angle"),
    "prm": (
        "frequency", "polarization", "resolution", "integration_time", "bandwidth", "noise_temperature", "scan_period",
    ),
}  # fmt: skip
CANNOT_VARY = {"psm": {"processing", "targets_file"}, "prm": {"beam_file"}}

each_row = pytest.mark.parametrize(("engine", "row"), ROWS, ids=lambda item: getattr(item, "name", item))
each_sensor = pytest.mark.parametrize("engine", SENSORS)


# -- the table against the configurations ----------------------------------------------------------------------------


@each_sensor
def test_every_field_has_a_row_and_every_row_a_field(engine):
    table, configuration = SENSORS[engine]
    names = [field.name for field in fields(configuration)]
    assert list(dict.fromkeys(row.field for row in table.values())) == names
    assert {name for name, count in Counter(row.field for row in table.values()).items() if count > 1} <= {
        "pattern_table"
    }
    assert all(table[row.name] is row for row in table.values())
    # A name never means another parameter than the one whose field bears it.
    assert not any(name in names and table[name].field != name for name in table)


@each_row
def test_kinds_are_the_types_of_the_fields(engine, row):
    hint = get_type_hints(SENSORS[engine][1])[row.field]
    kind: Any = {"number": float, "whole": int, "function": str, "file": str, "channels": tuple, "pattern": tuple}
    if get_origin(hint) is Literal:
        assert (row.kind, row.levels) == ("word", get_args(hint))
    elif row.kind == "word":
        assert hint is str
    else:
        types = [get_origin(one) or one for one in (get_args(hint) if type(None) in get_args(hint) else (hint,))]
        assert types[0] is kind[row.kind]
    assert row.what
    assert not row.what.endswith(".")


@each_sensor
def test_defaults_are_possible(engine):
    table, configuration = SENSORS[engine]
    default = {field.name: field.default for field in fields(configuration)}
    for row in table.values():
        if default[row.field] not in (MISSING, None) and row.kind != "pattern":
            assert row.problem(default[row.field]) is None, row.name
    missing = {row.name for row in table.values() if default[row.field] is MISSING}
    assert missing == {*TABLE_1[engine], "altitude_m"} - {"looks"}


@each_row
def test_the_name_of_a_field_ends_in_its_unit(engine, row):
    del engine
    suffix = row.unit.lower().replace("/", "_")
    pure = {"m3/m3", "h"}  # soil_moisture_low, hour
    if row.unit and row.unit not in pure:
        assert row.field.endswith(f"_{suffix}")
    elif not row.unit:
        assert not re.search(r"_(m|cm|s|ms|us|hz|mhz|ghz|w|k|db|deg)$", row.field.removesuffix("film_k"))
    if row.numeric:
        assert -math.inf < row.low < row.high < math.inf
    else:
        assert not row.unit


def test_names_mean_the_same_for_both_sensors():
    for name in RADAR.keys() & RADIOMETER.keys():
        one, other = RADAR[name], RADIOMETER[name]
        assert (one.field, one.unit, one.numeric) == (other.field, other.unit, other.numeric)


def test_all_ten_names_of_table_1():
    """Seven radar and seven radiometer parameters share four names."""
    assert set(TABLE_1["psm"]) <= set(RADAR)
    assert set(TABLE_1["prm"]) <= set(RADIOMETER)
    assert len({*TABLE_1["psm"], *TABLE_1["prm"]}) == 10
    # Their names do not tell the unit, those of all others do.
    named = {row.name for _, row in ROWS if row.name != row.field}
    assert named == {*TABLE_1["psm"], *TABLE_1["prm"]} - {"looks"}


@each_row
def test_reports_show_unit_and_label_of_the_row(engine, row):
    del engine
    assert fixed_unit(row.name, 1.0).replace("\u00b5", "u").replace("\u00b3", "3").replace("\u00b2", "2") == row.unit
    assert fixed_unit(row.name, "word") == ""
    assert "_" not in readable(row.name)
    assert not {"prf", "adc", "agc", "n"} & set(readable(row.name).split())  # no word, and a capital is missing


@each_sensor
def test_no_two_parameters_have_one_label(engine):
    labels = Counter(row.label for row in SENSORS[engine][0].values())
    assert {label for label, count in labels.items() if count > 1} == set()


def test_readme_names_parameters_that_there_are():
    part = README[README.index("### More of the radar") : README.index("File paths are relative")]
    names = {name for row in re.findall(r"^\| (`.*?) \|", part, flags=re.M) for name in re.findall(r"`(\w+)", row)}
    assert len(names) > 25
    assert names <= RADAR.keys(), names - RADAR.keys()


# -- values ----------------------------------------------------------------------------------------------------------


@each_row
def test_limits_are_values_and_what_lies_beyond_is_refused_with_them(engine, row):
    del engine
    if not row.numeric:
        return
    for value in (row.low, row.high):
        assert row.problem(value) is None
    for value in (math.nextafter(row.low, -math.inf), math.nextafter(row.high, math.inf), math.nan, "1", True, None):
        problem = row.problem(value)
        assert isinstance(problem, Problem)
        assert (problem.field, problem.message) == (row.name, "out of range")
        assert row.allowed in problem.remedy
        assert row.what in problem.remedy
    if not row.values:
        assert f"{row.low:g} to {row.high:g} {row.unit}".strip() in row.allowed


@pytest.mark.parametrize(("name", "good", "bad"), [
    ("adc_bits", (0, 8), (7.5, 33)), ("season", ("winter",), ("monsoon", "", 3)),
    ("polarization", (("HH",), ("VV", "HV")), ((), ("HH", "HH"), ("H",), "HH")),
    ("receiver", ("agc", "mine:square"), ("magic",)), ("processing", ("", "mine:median"), ("magic",)),
])  # fmt: skip
def test_what_other_kinds_may_be(name, good, bad):
    for value in good:
        assert RADAR[name].problem(value) is None
    for value in bad:
        problem = RADAR[name].problem(value)
        assert problem is not None
        assert RADAR[name].allowed in problem.remedy


def test_a_number_of_few_values():
    assert RADIOMETER["heading_deg"].problem(90.0) is None
    problem = RADIOMETER["heading_deg"].problem(45.0)
    assert problem is not None
    assert "0, 90, 180, 270 deg" in problem.remedy


def test_what_is_missing_is_told_with_what_it_is():
    with pytest.raises(ConfigurationError) as caught:
        radar.from_settings({}, {"depression_angle": 45.0})
    missing = {problem.field: problem.remedy for problem in caught.value.problems}
    assert set(missing) == {"frequency", "polarization", "resolution", "bandwidth", "peak_power", "altitude_m"}
    assert RADAR["altitude_m"].what in missing["altitude_m"]


# -- campaign.toml ---------------------------------------------------------------------------------------------------

SPEC = """\
[campaign]
name = "any"
[[factor]]
{factor}
[[application]]
name = "a"
utility = "percent_correct"
[simulator]
engine = "{engine}"
scene = "scene.npz"
[simulator.fixed]
{fixed}
[stop]
half_width = 1.0
"""


@pytest.fixture
def load(tmp_path):
    (tmp_path / "scene.npz").write_bytes(b"")

    def loader(engine: str, factor: str, fixed: str = "") -> CampaignSpec:
        text = SPEC.format(factor=factor.replace("; ", "\n"), engine=engine, fixed=fixed)
        (tmp_path / "campaign.toml").write_text(text, encoding="utf-8")
        return load_spec(tmp_path)

    return loader


def refused(load, engine: str, factor: str, fixed: str = "") -> list[Problem]:
    with pytest.raises(SpecError) as caught:
        load(engine, factor, fixed)
    return list(caught.value.problems)


def as_factor(row: Parameter) -> str:
    """A factor of the parameter over all that it may be."""
    if row.continuous:
        return f'name = "{row.name}"; unit = "{row.unit}"; low = {row.low!r}; high = {row.high!r}'
    if row.numeric:
        return f'name = "{row.name}"; unit = "{row.unit}"; values = {list(row.values or (row.low, row.high))!r}'
    levels = row.levels if len(row.levels) > 1 else ("0:0, 90:0", "0:-20, 40:0")
    return f'name = "{row.name}"; levels = [{", ".join(chr(34) + level + chr(34) for level in levels)}]'


@each_row
def test_every_parameter_that_can_vary_is_a_factor(load, engine, row):
    assert bool(row.why_fixed) == (row.name in CANNOT_VARY[engine])
    if row.why_fixed:
        (problem,) = refused(load, engine, f'name = "{row.name}"; levels = ["one.csv", "two.csv"]')
        assert (problem.message, problem.value) == ("this parameter cannot be a factor", row.name)
        assert problem.field == f"factor '{row.name}': name"
        assert row.why_fixed in problem.remedy
        return
    (factor,) = load(engine, as_factor(row)).factors
    expected = ContinuousFactor if row.continuous else DiscreteFactor if row.numeric else CategoricalFactor
    assert isinstance(factor, expected)
    assert getattr(factor, "unit", "") == row.unit
    # Where no unit is written, it is the sensor's.
    (silent,) = load(engine, as_factor(row).replace(f'unit = "{row.unit}"; ', "")).factors
    assert silent == factor


@each_row
def test_every_level_becomes_the_value_of_its_field(load, engine, row):
    if row.why_fixed:
        return
    sensor, configuration = (radar, RadarConfiguration) if engine == "psm" else (radiometer, RadiometerConfiguration)
    (factor,) = load(engine, as_factor(row)).factors
    region = load(engine, as_factor(row)).region
    names = [field.name for field in fields(configuration)]
    for point in region.level_combinations() if isinstance(factor, CategoricalFactor) else [()]:
        coded = region.centre()
        coded[list(region.categorical)] = point
        settings = region.decode(coded)[0]
        built: dict[str, object] = {}
        with pytest.MonkeyPatch.context() as patch:
            # Alone, most levels of one parameter contradict the defaults of another.
            patch.setattr(sensor, "_set_problems", lambda _: [])
            base = {"frequency": 5.0, "bandwidth": 50.0, "resolution": 20.0, "altitude_m": 4000.0}
            base |= (
                {"polarization": "HH", "peak_power": 30.0, "depression_angle": 45.0}
                if engine == "psm"
                else {"polarization": "H", "integration_time": 1.0, "noise_temperature": 500.0, "scan_period": 2.0}
            )
            base.pop(row.name, None)
            made = sensor.from_settings(settings, base)
            built = {name: getattr(made, name) for name in names}
        value, written = built[row.field], settings[row.name]
        if row.kind == "channels":
            assert "+".join(value) == written  # type: ignore[arg-type]
        elif row.kind == "pattern":
            assert ", ".join(f"{look:g}:{gain:g}" for look, gain in value) == written  # type: ignore[attr-defined]
        else:
            assert value == written
            assert isinstance(value, {"whole": int, "number": float}.get(row.kind, str))
        for end in (row.low, row.high):  # which messages print
            assert isinstance(end, int) == (row.kind == "whole") or math.isinf(end)


@each_row
def test_another_unit_is_refused(load, engine, row):
    if not row.numeric:
        return
    (problem,) = refused(load, engine, re.sub(r'unit = ".*?"', 'unit = "furlong"', as_factor(row)))
    assert (problem.field, problem.value) == (f"factor '{row.name}': unit", "furlong")
    assert problem.remedy == (f'Write unit = "{row.unit}" and give the range in it.' if row.unit else "Leave it out.")


@each_row
def test_ranges_beyond_the_limits_and_unknown_levels_are_refused(load, engine, row):
    if row.why_fixed:
        return
    if not row.numeric:
        wrong = as_factor(row).replace("]", ', "monsoon"]')
        (problem,) = refused(load, engine, wrong)
        assert (problem.value, problem.field) == (
            "monsoon",
            f"factor '{row.name}': levels no. {wrong.count(chr(34)) // 2 - 1}",
        )
        assert all(level in problem.remedy for level in row.levels)
        return
    for end, step in (("low", -1.0), ("high", 1.0)):
        limit = getattr(row, end)
        beyond = limit + step * max(abs(limit), 1.0)
        factor = as_factor(row)
        wrong = factor.replace(f"{end} = {limit!r}", f"{end} = {beyond!r}")
        if not row.continuous:
            wrong = re.sub(r"values = \[", f"values = [{beyond!r}, ", factor)
        (problem,) = refused(load, engine, wrong)
        place = end if row.continuous else "values no. 1"
        assert (problem.field, problem.value) == (f"factor '{row.name}': {place}", beyond)
        assert row.allowed in problem.remedy


@each_row
def test_factors_of_the_wrong_kind_are_refused(load, engine, row):
    if row.why_fixed:
        return
    if row.name == "frequency":  # its levels are sets of sensors
        problem, *_ = refused(load, engine, 'name = "frequency"; levels = ["L", "middling"]')
        assert (problem.message, problem.value) == ("no such member of a set", "middling")
        return
    wrong = []
    if row.numeric:
        wrong.append(f'name = "{row.name}"; levels = ["a", "b"]')
    else:
        wrong.append(f'name = "{row.name}"; values = [1.0, 2.0]')
    if not row.continuous:
        wrong.append(f'name = "{row.name}"; low = 1.0; high = 2.0')
    for text in wrong:
        problem, *rest = refused(load, engine, text)
        assert not rest or row.kind == "whole"
        needed = "levels" if not row.numeric else "low and high, or values" if row.continuous else "values"
        assert (problem.field, problem.message) == (f"factor '{row.name}'", f"'{row.name}' is given by {needed}")
        assert row.allowed in problem.remedy


def test_whole_numbers_and_numbers_of_few_values_have_nothing_between(load):
    (problem,) = refused(load, "psm", 'name = "adc_bits"; values = [4, 6.5, 8]')
    assert (problem.field, problem.value) == ("factor 'adc_bits': values no. 2", 6.5)
    (problem,) = refused(load, "prm", 'name = "heading_deg"; values = [0, 45]')
    assert (problem.field, problem.value) == ("factor 'heading_deg': values no. 2", 45.0)
    assert "0, 90, 180, 270 deg" in problem.remedy


def test_a_function_of_the_users_is_no_level(load):
    (problem,) = refused(load, "psm", 'name = "receiver"; levels = ["linear", "mine:square"]')
    assert (problem.field, problem.value) == ("factor 'receiver': levels no. 2", "mine:square")
    assert "your own function cannot be a level" in problem.message
    assert "[simulator.fixed]" in problem.remedy
    (problem,) = refused(load, "psm", 'name = "receiver"; levels = ["linear", "agcc"]')
    assert problem.message == "unknown"
    assert load("psm", 'name = "looks"; low = 1; high = 8', 'receiver = "mine:square"').simulator.fixed


@each_row
def test_a_parameter_is_not_factor_and_fixed_at_once(load, engine, row):
    if row.why_fixed:
        return
    value = '"x"' if not row.numeric else repr(row.low)
    (problem,) = refused(load, engine, as_factor(row), f"{row.name} = {value}")
    assert problem.field == f"[simulator] fixed.{row.name}"
    assert f"'{row.name}' is both a factor and fixed" in problem.message


@each_row
def test_a_factor_bears_the_name_of_this_file(load, engine, row):
    if row.name == row.field or row.why_fixed:
        return
    (problem,) = refused(load, engine, as_factor(row).replace(row.name, row.field, 1))
    assert (problem.value, "no such sensor parameter" in problem.message) == (row.field, True)


def test_levels_of_channels_have_no_blanks(load):
    (problem,) = refused(load, "psm", 'name = "polarization"; levels = ["HH", "HH + HV"]')
    assert problem.value == "HH + HV"


def test_an_unknown_parameter_is_told_the_nearest_or_where_all_are_listed(load):
    (problem,) = refused(load, "psm", 'name = "altitude"; low = 1000; high = 2000')
    assert "altitude_m" in problem.remedy
    (problem,) = refused(load, "prm", 'name = "wings"; low = 1; high = 2')
    assert "seqrsm parameters prm" in problem.remedy


@pytest.mark.parametrize("value", [math.nan, math.inf])
def test_a_whole_number_that_is_none_is_told(value: float) -> None:
    (problem,) = RADAR["n_bits"].level_problems(value)
    assert problem.message == "out of range"
