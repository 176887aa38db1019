"""Grey tone and quantised intensity: the report's own worked examples (eqs. 3-16 to 3-19)."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest

from seqrsm.errors import ConfigurationError
from seqrsm.simulate.radar.receiver import (
    converter_error,
    film_density,
    greytone,
    least_intensity,
    named_function,
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
    given = {"processing": "", "receiver_level_db": 0.0}
    assert received(x, SimpleNamespace(receiver="linear", **given), 2.0) is x
    # Square-law over a level of 2, then the square root.
    given |= {"processing": "numpy:sqrt"}
    got = received(x, SimpleNamespace(receiver="square_law", **given), 2.0)
    np.testing.assert_allclose(got, x / np.sqrt(2.0), rtol=1e-12)


@pytest.mark.parametrize(
    ("bits", "step", "error"),
    [(1, 1.596, 0.3634), (2, 0.9957, 0.1188), (3, 0.5860, 0.03744), (4, 0.3352, 0.01154), (5, 0.1881, 0.003495)],
)
def test_error_of_a_converter_is_that_of_the_best_equal_steps(bits, step, error):
    """Max (1960, IRE Trans. Inf. Theory 6, 7-12), Table II: steps and mean square error of a signal of variance 1."""
    full_scale_db = 20.0 * np.log10(0.5 * step * 2**bits / np.sqrt(2.0))  # I and Q have half of the power each
    # The best step leaves an error that is unrelated to what comes out: error and 1 - error are noise and signal.
    assert converter_error(bits, full_scale_db) == pytest.approx(error / (1.0 - error), rel=2e-3)


def test_error_of_a_converter_at_its_ends():
    assert converter_error(1, 30.0) == pytest.approx(0.5 * np.pi - 1.0)  # the sign alone, whatever the scale
    assert converter_error(8, 40.0) == pytest.approx((2.0 * np.sqrt(2.0) * 100.0 / 256) ** 2 / 12.0, rel=0.01)
    by_guide = [-10.0 * np.log10(converter_error(bits, 8.0)) for bits in (4, 8)]
    assert [round(level) for level in by_guide] == [18, 40]
    # Steps too fine to matter: a limiter at half the standard deviation of I and Q, by numbers drawn.
    x = np.random.default_rng(4).standard_normal(1_000_000)
    y = np.clip(x, -0.5, 0.5)
    gain = (x * y).mean()
    assert converter_error(16, 20.0 * np.log10(0.5 / np.sqrt(2.0))) == pytest.approx(
        ((y * y).mean() - gain**2) / gain**2, rel=0.01
    )


def test_levels_take_the_smallest_type():
    assert to_levels(np.array([300.0, np.nan])).tolist() == [255, 0]
    assert to_levels(np.array([4095.0]), 12).dtype == np.uint16
    assert to_levels(np.array([2.0**31]), 32).dtype == np.uint32


def test_a_function_of_the_users_own_that_ends_the_program_is_told_as_failed(tmp_path):
    for text, told in (("def f(p):\n    raise SystemExit(0)\n", "failed"), ("raise SystemExit(0)\n", "cannot be imp")):
        file = tmp_path / f"{told[:3]}.py"
        file.write_text(text, encoding="utf-8")
        with pytest.raises(ConfigurationError, match=f"the function {told}.*SystemExit: 0"):
            named_function("receiver", f"{file}:f")(np.ones(3))
