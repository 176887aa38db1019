"""Grey tone and quantised intensity: the report's own worked examples (eqs. 3-16 to 3-19)."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest

from seqrsm.simulate.radar.receiver import (
    film_density,
    greytone,
    least_intensity,
    quantised_intensity,
    received,
    to_levels,
)


def test_greytone_of_a_hundred_times_the_calibration_power_is_white():
    p_c = 3e-12
    power = np.array([p_c, 10 * p_c, 100 * p_c, 1000 * p_c, p_c / 10])
    tone = greytone(film_density(power), float(film_density(np.array(p_c))), 0.0, 8, 20.0)
    np.testing.assert_allclose(tone, [0.0, 127.5, 255.0, 255.0, 0.0], atol=1e-9)


def test_greytone_calibrated_at_mid_grey():
    tone = greytone(film_density(np.array([10.0, 1.0, 0.1])), 0.0, 127.5)
    np.testing.assert_allclose(tone, [255.0, 127.5, 0.0], atol=1e-9)


def test_linear_quantisation_by_its_least_intensity():
    np.testing.assert_allclose(quantised_intensity(np.array([1.0, 100.0, 0.5, 1e4]) * 7e-9, 7e-9), [0, 255, 0, 255])
    assert quantised_intensity(np.array(50.5), 1.0) == pytest.approx(127.5)


def test_linear_quantisation_by_a_calibrated_pair():
    got = quantised_intensity(np.array([2.0 / 50, 2.0, 4.0]), least_intensity(2.0, 126.0))
    # The report rounds: I_C/50 gives 0 and 2 I_C gives 255; exactly -0.006 (clipped) and 254.58.
    np.testing.assert_allclose(got, [0.0, 126.0, 126.0 + 126.0 + 255.0 / 99.0], atol=0.01)
    assert to_levels(got).tolist() == [0, 126, 255]


def test_no_power_is_black_and_makes_no_warning():
    tone = greytone(film_density(np.array([0.0, 1.0])), -1.0)
    assert to_levels(tone).tolist() == [0, 128]


def test_film_slope_and_constant():
    np.testing.assert_allclose(film_density(np.array([100.0]), gamma=1.5, k=10.0), [4.0])


def test_stages_are_applied_in_order_and_none_is_free():
    x = np.array([[[1.0, 3.0, 9.0]]])
    given = {"processing": "", "adc_bits": 0, "adc_range_db": 10.0 * np.log10(1.5), "receiver_level_db": 0.0}
    assert received(x, SimpleNamespace(receiver="linear", **given), 2.0) is x
    # Square-law over a level of 2, then two bits up to 3, then the square root.
    given |= {"adc_bits": 2, "processing": "numpy:sqrt"}
    got = received(x, SimpleNamespace(receiver="square_law", **given), 2.0)
    np.testing.assert_allclose(got, [[[0.0, np.sqrt(3.0), np.sqrt(3.0)]]], rtol=1e-12)


def test_levels_take_the_smallest_type():
    assert to_levels(np.array([300.0, np.nan])).tolist() == [255, 0]
    assert to_levels(np.array([4095.0]), 12).dtype == np.uint16
    assert to_levels(np.array([2.0**31]), 32).dtype == np.uint32
