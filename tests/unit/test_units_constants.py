"""Conversions against exact values, constants against scipy's CODATA table."""

from __future__ import annotations

import numpy as np
import pytest
import scipy.constants

from seqrsm import constants, units
from seqrsm.sensor.parameters import RADAR, RADIOMETER


def test_constants_match_codata() -> None:
    assert scipy.constants.c == constants.SPEED_OF_LIGHT_M_S
    assert scipy.constants.k == constants.BOLTZMANN_J_K
    assert scipy.constants.h == constants.PLANCK_J_S
    assert constants.wavenumber_rad_m(1.25) == pytest.approx(2.0 * np.pi / 0.2398339664)


def test_decibels() -> None:
    assert units.db_to_linear(20.0) == pytest.approx(100.0, rel=1e-14)
    assert units.linear_to_db(0.5) == pytest.approx(-3.010299956639812)
    assert units.linear_to_db(0.0) == -np.inf
    assert np.isnan(units.linear_to_db(-1.0))
    values = np.linspace(-60.0, 60.0, 25)
    assert units.linear_to_db(units.db_to_linear(values)) == pytest.approx(values, abs=1e-12)
    assert isinstance(units.db_to_linear(3.0), float)


@pytest.mark.parametrize(
    ("parameter", "value", "unit", "expected"),
    [
        ("frequency", 9600.0, "MHz", 9.6),
        ("frequency", 9.6, "GHz", 9.6),
        ("resolution", 0.025, "km", 25.0),
        ("bandwidth", 500.0, "kHz", 0.5),
        ("peak_power", 2.5, "kW", 2500.0),
        ("depression_angle", np.pi / 4, "rad", 45.0),
        ("frequency", 1.25e9, "Hz", 1.25),
        ("integration_time", 0.1, "s", 100.0),
        ("scan_period", 250.0, "ms", 0.25),
        ("looks", 4.0, "", 4.0),
    ],
)
def test_values_in_the_unit_of_a_parameter(parameter: str, value: float, unit: str, expected: float) -> None:
    row = RADAR.get(parameter) or RADIOMETER[parameter]
    factor = units.unit_factor(unit, row.unit)
    assert factor is not None
    assert value * factor == pytest.approx(expected)
    assert unit in (*units.units_like(row.unit), "")


def test_units_of_different_kinds_have_no_factor() -> None:
    assert units.unit_factor("m", "GHz") is None
    assert units.unit_factor("", "m") is units.unit_factor("m", "") is units.unit_factor("furlong", "m") is None
    assert units.units_like("GHz") == ("GHz", "MHz", "kHz", "Hz")
    assert units.units_like("furlong") == ()
