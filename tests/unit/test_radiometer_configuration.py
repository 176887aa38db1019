"""Radiometer settings: names of Table 1, refusals with numbers, derived quantities."""

from __future__ import annotations

import math

import pytest

from seqrsm.errors import ConfigurationError
from seqrsm.sensor.parameters import RADIOMETER
from seqrsm.sensor.radiometer import RadiometerConfiguration, from_settings

SETTINGS = {
    "frequency": 10.7,
    "polarization": "H+V",
    "resolution": 100.0,
    "integration_time": 10.0,
    "bandwidth": 100.0,
    "noise_temperature": 500.0,
    "scan_period": 2.0,
}
FIXED = {"altitude_m": 3000.0, "speed_m_s": 80.0, "weather": "rain"}


def test_all_seven_passive_parameters_are_factors():
    made = from_settings(SETTINGS, FIXED)
    assert made.channels == ("H", "V")
    assert (made.frequency_ghz, made.resolution_m, made.integration_time_ms) == (10.7, 100.0, 10.0)
    assert (made.bandwidth_mhz, made.noise_temperature_k, made.scan_period_s) == (100.0, 500.0, 2.0)
    assert made.weather == "rain"
    assert set(SETTINGS) == {row.name for row in RADIOMETER.values() if row.name != row.field}
    assert not any(RADIOMETER[name].why_fixed for name in SETTINGS)


@pytest.mark.parametrize("name", SETTINGS)
def test_each_parameter_may_be_fixed_and_none_may_be_missing(name):
    rest = {key: value for key, value in SETTINGS.items() if key != name}
    assert from_settings(rest, {**FIXED, name: SETTINGS[name]}) == from_settings(SETTINGS, FIXED)
    with pytest.raises(ConfigurationError, match=rf"{name}: missing"):
        from_settings(rest, FIXED)


def test_faults_of_names_are_told_together():
    with pytest.raises(ConfigurationError) as caught:
        from_settings({**SETTINGS, "looks": 4.0, "bandwidth": "wide"}, {**FIXED, "frequency_ghz": 5.0})
    text = str(caught.value)
    assert "looks: no such radiometer parameter" in text
    assert "bandwidth: not a number" in text
    assert "frequency_ghz: no such radiometer parameter (got 5.0). Did you mean 'frequency'?" in text


@pytest.mark.parametrize(("name", "value"), [
    ("frequency", 183.3), ("frequency", 0.2), ("polarization", "HH"), ("polarization", "H+H"), ("resolution", 0.0),
    ("integration_time", -1.0), ("bandwidth", 0.0), ("noise_temperature", -5.0), ("scan_period", 0.0),
    ("bandwidth", math.nan), ("weather", "fog"), ("heading_deg", 45.0), ("receiver", "crystal"), ("beam", "pencil"),
])  # fmt: skip
def test_impossible_values_are_refused_by_name(name, value):
    given = {**SETTINGS, **FIXED, name: value}
    with pytest.raises(ConfigurationError, match=name):
        from_settings(given)


def test_contradictions_are_refused():
    with pytest.raises(ConfigurationError, match="larger than the frequency"):
        from_settings({**SETTINGS, "frequency": 1.4, "bandwidth": 2000.0}, FIXED)
    with pytest.raises(ConfigurationError, match="less than one independent sample"):
        from_settings({**SETTINGS, "integration_time": 1e-3, "bandwidth": 0.1}, FIXED)
    with pytest.raises(ConfigurationError, match="beam_file"):
        from_settings(SETTINGS, {**FIXED, "beam": "measured"})
    with pytest.raises(ConfigurationError, match="temperature_low_k"):
        from_settings(SETTINGS, {**FIXED, "temperature_low_k": 350.0})


def test_derived_quantities():
    made = from_settings(SETTINGS, FIXED)
    beta = made.beamwidth_rad(3000.0)
    assert 2.0 * 3000.0 * math.tan(0.5 * beta) == pytest.approx(100.0)
    assert made.antenna_m(3000.0) == pytest.approx(1.22 * 0.299792458 / 10.7 / beta)
    assert made.nedt_k(300.0) == pytest.approx(800.0 / math.sqrt(1e8 * 0.01))
    # 0.048 K a gigahertz.
    assert made.planck_offset_k == pytest.approx(0.0479924 * 10.7, rel=1e-5)


def test_configuration_is_frozen():
    made = from_settings(SETTINGS, FIXED)
    with pytest.raises(AttributeError):
        made.frequency_ghz = 5.0
    assert isinstance(made, RadiometerConfiguration)
