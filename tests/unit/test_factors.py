from __future__ import annotations

from decimal import Decimal, localcontext

import numpy as np
import pytest

from seqrsm.campaign.next_runs import rounded_settings
from seqrsm.design.factors import CategoricalFactor, ContinuousFactor, DiscreteFactor, plain_setting, setting_with_unit
from seqrsm.design.region import Region
from seqrsm.errors import RegionError


def test_linear_coding_matches_the_closed_form():
    factor = ContinuousFactor("angle", 20.0, 60.0, "deg")
    np.testing.assert_allclose(factor.code([20.0, 40.0, 55.0, 60.0, 80.0]), [-1.0, 0.0, 0.75, 1.0, 2.0], atol=1e-15)
    np.testing.assert_allclose(factor.decode([-1.0, 0.0, 0.75, 1.0]), [20.0, 40.0, 55.0, 60.0], rtol=1e-15)


def test_log_coding_puts_the_geometric_mean_in_the_middle():
    factor = ContinuousFactor("frequency", 1.0, 16.0, "GHz", "log")
    np.testing.assert_allclose(factor.code([1.0, 2.0, 4.0, 8.0, 16.0]), [-1.0, -0.5, 0.0, 0.5, 1.0], atol=1e-15)
    assert float(factor.decode(0.0)) == pytest.approx(4.0, rel=1e-15)


@pytest.mark.parametrize("scale", ["linear", "log"])
@pytest.mark.parametrize(("low", "high"), [(1.2, 17.0), (0.1, 0.3), (1e-9, 1e9), (12.1, 12.2)])
def test_the_ends_are_exact_both_ways(low, high, scale):
    factor = ContinuousFactor("x", low, high, scale=scale)
    assert factor.code([low, high]).tolist() == [-1.0, 1.0]
    assert factor.decode([-1.0, 1.0]).tolist() == [low, high]


@pytest.mark.parametrize("scale", ["linear", "log"])
def test_rounding_next_to_an_end_is_the_end(scale):
    factor = ContinuousFactor("frequency", 1.25, 35.0, "GHz", scale)
    assert factor.decode([-1.0 + 2e-16, 1.0 - 2e-16]).tolist() == [1.25, 35.0]
    assert factor.decode([-1.0 + 1e-12])[0] > 1.25, "a setting of its own"


def test_discrete_levels_come_back_exactly_and_in_order():
    factor = DiscreteFactor("resolution", (50.0, 3.0, 12.1), "m", "log")
    assert factor.values == (3.0, 12.1, 50.0)
    assert factor.coded_levels[[0, -1]].tolist() == [-1.0, 1.0]
    assert factor.decode(factor.coded_levels).tolist() == [3.0, 12.1, 50.0]
    assert factor.decode(factor.code(np.float32(12.1))) == 12.1
    assert factor.decode(factor.code(float("12.10"))) == 12.1


def test_a_value_between_discrete_levels_stays_what_it_is():
    factor = DiscreteFactor("looks", (1, 2, 4, 8), scale="log")
    coded = factor.code(3.0)
    assert float(factor.decode(coded)) == pytest.approx(3.0, rel=1e-14)
    assert not factor.match(coded)[1]


def test_contrasts_sum_to_zero():
    contrasts = CategoricalFactor("polarization", ("HH", "VV", "HV")).contrasts
    assert contrasts.tolist() == [[1.0, 0.0], [0.0, 1.0], [-1.0, -1.0]]


@pytest.mark.parametrize(
    ("make", "fragment"),
    [
        (lambda: ContinuousFactor("x", 2.0, 2.0), "lower end is not below"),
        (lambda: ContinuousFactor("x", 3.0, 2.0), "lower end is not below"),
        (lambda: ContinuousFactor("x", -1e308, 1e308), "lower end is not below"),
        (lambda: ContinuousFactor("x", 0.0, 2.0, scale="log"), "must be positive"),
        (lambda: ContinuousFactor("x", float("nan"), 2.0), "not a finite number"),
        (lambda: ContinuousFactor("x", 1.0, float("inf")), "not a finite number"),
        (lambda: ContinuousFactor("x y", 1.0, 2.0), "name is not usable"),
        (lambda: ContinuousFactor("fréquence", 1.0, 2.0), "name is not usable"),
        (lambda: ContinuousFactor("", 1.0, 2.0), "name is not usable"),
        (lambda: ContinuousFactor("log", 1.0, 2.0), "reserved name"),
        (lambda: ContinuousFactor("and", 1.0, 2.0), "reserved name"),
        (lambda: DiscreteFactor("x", (1.0,)), "at least two values"),
        (lambda: DiscreteFactor("x", ()), "at least two values"),
        (lambda: DiscreteFactor("x", (1.0, 1.0, 2.0)), "listed twice"),
        (lambda: DiscreteFactor("x", (1.0, float("nan"))), "not a finite number"),
        (lambda: DiscreteFactor("x", (-1.0, 2.0), scale="log"), "must be positive"),
        (lambda: CategoricalFactor("x", ("HH",)), "at least two levels"),
        (lambda: CategoricalFactor("x", ("HH", "HH")), "listed twice"),
        (lambda: CategoricalFactor("x", ("HH", " VV")), "level's name"),
        (lambda: CategoricalFactor("x", ("HH", "")), "level's name"),
    ],
)
def test_a_wrong_factor_is_refused_by_name(make, fragment):
    with pytest.raises(RegionError, match=fragment):
        make()


def test_all_problems_are_told_at_once():
    with pytest.raises(RegionError) as caught:
        ContinuousFactor("a b", -2.0, -5.0, scale="log")
    assert len(caught.value.problems) == 3


def test_a_log_factor_refuses_a_value_that_has_no_logarithm():
    with pytest.raises(RegionError, match="positive values only"):
        ContinuousFactor("x", 1.0, 2.0, scale="log").code([1.5, 0.0])


@pytest.mark.parametrize("ratio", [1e2, 1e6, 1e12])
def test_a_narrow_logarithmic_range_is_coded_to_full_precision(ratio):
    """Against 60-digit logarithms; a difference of rounded logarithms keeps 3 digits at a ratio of 1e12."""
    factor = ContinuousFactor("x", ratio, ratio + 1.0, scale="log")
    values = factor.decode(np.linspace(-1.0, 1.0, 9))
    with localcontext(prec=60):
        low, high = Decimal(factor.low).ln(), Decimal(factor.high).ln()
        exact = [float((2 * Decimal(float(v)).ln() - low - high) / (high - low)) for v in values]
    np.testing.assert_allclose(factor.code(values), exact, rtol=0, atol=1e-15)
    # one ulp of the value itself is this much in coded units
    np.testing.assert_allclose(factor.code(values), np.linspace(-1.0, 1.0, 9), atol=8 * ratio * 2.3e-16 + 1e-15)


def test_settings_are_rounded_as_far_as_the_range_allows():
    assert plain_setting(ContinuousFactor("f", 1.2, 17.0, scale="log"), 3.14159265) == 3.142
    narrow = ContinuousFactor("f", 10.0, 10.01)
    assert plain_setting(narrow, 10.0034159265) == 10.0034
    assert setting_with_unit(narrow, 10.0034159265) == "10.0034"
    far = ContinuousFactor("t", 1e9, 1e9 + 1.0)
    assert plain_setting(far, 1e9 + 0.123456789) == 1e9 + 0.123
    assert setting_with_unit(DiscreteFactor("n", (1.0, 2.0)), 2.0) == "2"
    assert setting_with_unit(CategoricalFactor("p", ("HH", "VV")), "VV") == "VV"


@pytest.mark.parametrize(("low", "high"), [(10.0, 10.01), (1e6, 1e6 + 1.0), (1.2, 17.0)])
def test_proposed_settings_of_a_narrow_range_stay_apart(low, high):
    region = Region((ContinuousFactor("x", low, high, scale="log"), ContinuousFactor("z", 0.0, 1.0)))
    points = np.column_stack([np.linspace(-1, 1, 21), np.zeros(21)])
    back = region.code(rounded_settings(region, points))
    np.testing.assert_allclose(back, points, atol=0.005)
