"""Names and units as a reader wants them."""

from __future__ import annotations

from pathlib import Path
from types import SimpleNamespace

import pytest

from seqrsm.design.constraints import Constraint
from seqrsm.design.factors import ContinuousFactor
from seqrsm.design.region import Region
from seqrsm.report.wording import (
    axis_label,
    fixed_unit,
    format_setting,
    readable,
    readable_term,
    readable_text,
    shortened,
    source_counts,
    targets_text,
    told_settings,
)
from seqrsm.sensor.parameters import RADAR, RADIOMETER
from seqrsm.spec.read import load_spec
from seqrsm.spec.write import create_campaign


@pytest.mark.parametrize(
    ("name", "value", "label", "unit"),
    [
        ("bandwidth", 50.0, "bandwidth", "MHz"),
        ("peak_power", 30.0, "peak power", "W"),
        ("altitude_m", 6000.0, "altitude", "m"),
        ("wind_low_m_s", 2.0, "wind low", "m/s"),
        ("rain_mm_h", 8.0, "rain", "mm/h"),
        ("noise_figure_db", 4.0, "noise figure", "dB"),
        ("snow_depth_cm", 15.0, "snow depth", "cm"),
        ("hour", 14.0, "hour", "h"),
        ("soil_moisture_low", 0.1, "soil moisture low", "m\u00b3/m\u00b3"),
        ("polarization", "HH", "polarization", ""),
        ("looks", 4.0, "looks", ""),
        ("n_bits", 8.0, "grey-tone bits", ""),
    ],
)
def test_fixed_parameters_have_their_unit(name, value, label, unit):
    assert (readable(name), fixed_unit(name, value)) == (label, unit)


def test_every_number_of_a_sensor_has_a_unit_or_is_a_pure_number():
    pure = {"looks", "film_gamma", "film_k", "i_qc", "g_rc", "gain_fluctuation", "day_of_year"}
    for table in (RADAR, RADIOMETER):
        numbers = {name for name, parameter in table.items() if parameter.kind == "number"}
        assert {name for name in numbers if not fixed_unit(name, 1.0)} <= pure


def test_terms_of_sensor_parameters_do_not_look_like_units():
    assert readable_term("altitude_m^2") == "altitude\u00b2"
    assert readable_term("season[fall]:pulse_length_us") == "season[fall] \u00d7 pulse length"
    assert readable_text("at altitude_m = 3000", ("altitude_m",)) == "at altitude = 3000"
    assert readable_text("is \u00b1 1.51e-09 W, of 1e+09 W", ()) == "is \u00b1 1.51 × 10⁻⁹ W, of 1 × 10⁹ W"
    minus = readable_text("scores -1.02 dB (-2.2 to -0.1) on 2026-11-28 by Sentinel-1, bounds [-1, 3]", ())
    assert minus == "scores −1.02 dB (−2.2 to −0.1) on 2026-11-28 by Sentinel-1, bounds [−1, 3]"
    assert readable("walking_speed_km_h") == "walking speed km h"
    altitude = ContinuousFactor("altitude_m", 1000.0, 3000.0, "m")
    assert axis_label(altitude) == "altitude [m]"
    assert format_setting(altitude, 2000.0) == "2000\u00a0m"


def test_factors_are_readable_in_sentences_of_others():
    text = "depression_angle and angle are flat; depression_angle_2 is not"
    assert readable_text(text, ("angle", "depression_angle")) == (
        "depression angle and angle are flat; depression_angle_2 is not"
    )


def test_a_setting_known_well_has_no_more_digits_than_a_sensor_can_be_set_to():
    resolution = ContinuousFactor("resolution", 30.0, 250.0, unit="m", scale="log")
    assert format_setting(resolution, 30.0324, 0.016, unit=False) == "30.03"
    assert format_setting(resolution, 141.482, 80.0, unit=False) == "140"
    assert format_setting(ContinuousFactor("time", 2.0, 20.0, scale="log"), 2.48045, 8.0) == "2.5"  # 2 is a bound


def test_rounded_settings_obey_the_constraints():
    """At 1.4 GHz, 190 m for 192.8 m would ask for an antenna of more than 2 m: the settings are then those of a run."""
    factors = ContinuousFactor("frequency", 1.4, 10.7, scale="log"), ContinuousFactor("resolution", 30.0, 250.0)
    spreads = {"frequency": 2.0, "resolution": 95.0}
    free, held = Region(factors), Region(factors, (Constraint("1.2 * (0.29979 / frequency) * 1500 / resolution <= 2"),))
    at = {"frequency": 1.4, "resolution": 192.7223}
    assert told_settings(free, at, spreads) == {"frequency": "1.4", "resolution": "190"}
    assert told_settings(held, at, spreads) == {"frequency": "1.4", "resolution": "192.8"}
    assert told_settings(held, {**at, "resolution": 204.0}, spreads)["resolution"] == "200"


def test_a_shortened_name_keeps_its_unit() -> None:
    assert shortened("angle [deg]", 12) == "angle [deg]"
    assert shortened("ground resolution of the product [m]", 20) == "ground resoluti\u2026 [m]"
    assert shortened("a level [with] brackets and more of it", 12) == "a level [wi\u2026"
    assert shortened("x [" + 30 * "y" + "]", 12) == "x [yyyyyyyy\u2026"


def test_scores_of_several_applications_are_told_beside_their_runs() -> None:
    """ "74 measured scores. They cost 280 kEUR (a flight 7 kEUR)" was told of 40 flights."""
    one, two = (SimpleNamespace(source="flight", scores=(None,) * n) for n in (1, 2))
    simulated = SimpleNamespace(source="simulation", scores=(None, None))
    assert source_counts([one] * 6 + [two] * 34) == "74 measured scores of 40 runs"
    assert source_counts([two]) == "2 measured scores of 1 run"
    assert source_counts([simulated, simulated, one]) == "2 simulated runs and 1 measured score"


def test_the_target_of_an_application_with_a_prior_is_told(tmp_path: Path) -> None:
    """A prior holds lists: no report of such a campaign could be written."""
    content = {
        "campaign": {"name": "c"},
        "factor": [{"name": "x", "low": 0.0, "high": 1.0}],
        "application": [{"name": "a", "utility": "measured", "unit": "K", "prior": {"utility": [2.0, 10.0]}}],
        "stop": {"half_width": 1.1},
    }
    create_campaign(tmp_path / "c", content)
    assert targets_text(load_spec(tmp_path / "c"), "half_width") == "1.1\u00a0K"
