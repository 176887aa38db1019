"""Digits by uncertainty against the rule's own published examples and exact arithmetic."""

from __future__ import annotations

from decimal import Decimal

import pytest
from hypothesis import given
from hypothesis import strategies as st

from seqrsm.report.rounding import (
    MINUS,
    NOTHING,
    decimals_for,
    format_around,
    format_number,
    format_p,
    format_percent,
    format_plain,
    format_plus_minus,
    format_range,
    format_significant,
)


@pytest.mark.parametrize(
    ("value", "uncertainty", "text"),
    [
        # Review of Particle Physics, Introduction 5.3: 0.827 +- 0.119 -> 0.83 +- 0.12, 0.827 +- 0.367 -> 0.8 +- 0.4.
        (0.827, 0.119, "0.83\u00a0±\u00a00.12"),
        (0.827, 0.367, "0.8\u00a0±\u00a00.4"),
        (14.674, 0.964, "14.7\u00a0±\u00a01.0"),
        (14.674, 0.354, "14.67\u00a0±\u00a00.35"),
        (14.674, 0.355, "14.7\u00a0±\u00a00.4"),
        (123456.0, 1234.0, "123500\u00a0±\u00a01200"),
        (-0.004, 0.2, "0.00\u00a0±\u00a00.20"),
        (5.0, float("nan"), "5.00"),
        (5.0, 5e-324, "5.00\u00a0±\u00a00.00"),
    ],
)
def test_plus_minus_follows_the_particle_data_group(value, uncertainty, text):
    assert format_plus_minus(value, uncertainty) == text


@given(st.floats(1e-8, 1e8), st.floats(-1e8, 1e8))
def test_the_last_digit_is_between_a_thirtieth_and_nine_tenths_of_the_uncertainty(uncertainty, value):
    last = 10.0 ** -decimals_for(uncertainty)
    assert uncertainty / 35.6 <= last <= uncertainty / 0.949 / 1.0
    rounded = round(value, decimals_for(uncertainty))
    assert abs(rounded - value) <= 0.5000001 * last + 1e-9 + 4e-16 * abs(value)


@given(st.floats(-1e6, 1e6), st.integers(0, 6))
def test_numbers_read_back_to_the_decimals_shown(value, decimals):
    text = format_number(value, decimals).replace(MINUS, "-")
    assert abs(Decimal(text) - Decimal(value)) <= Decimal("0.50000001") * Decimal(10) ** -decimals
    assert not text.startswith("-0.") or any(digit in text for digit in "123456789")


def test_special_values_are_words_or_signs_never_nan():
    assert format_number(float("nan")) == NOTHING
    assert format_number(float("-inf")) == MINUS + "∞"
    assert format_range(float("nan"), 1.0) == NOTHING
    assert format_p(float("nan")) == NOTHING
    assert format_number(-0.0001, 2) == "0.00"


def test_a_value_between_unequal_ends_keeps_the_digits_of_the_nearer_one():
    assert format_around(1.55, 2.07, 2.76) == "2.1 (1.6 to 2.8)"
    assert format_around(0.02, 1.04, 54.1) == "1.0 (0.02 to 54.1)"


def test_probabilities():
    assert [format_p(p) for p in (0.2345, 0.04567, 0.0012, 0.00099, 1.0)] == [
        "0.23",
        "0.046",
        "0.001",
        "< 0.001",
        "1.00",
    ]
    assert [format_percent(q).replace("\u00a0", " ") for q in (0.0, 1.0, 0.5, 0.004, 0.0005, 0.9999)] == [
        "0 %", "100 %", "50 %", "0.4 %", "< 0.1 %", "> 99.9 %"
    ]  # fmt: skip


def test_powers_of_ten_where_plain_digits_are_long():
    assert format_number(1.234e-9, 11) == "1.23 × 10⁻⁹"
    assert format_number(-1.234e9, -7) == MINUS + "1.23 × 10⁹"
    assert format_significant(1234.5, 2) == "1200"
    assert [format_significant(x, 2) for x in (9.96, 9.94, 0.0996, -99.6)] == ["10", "9.9", "0.10", "\u2212100"]
    assert format_plain(1e-9) == "1 × 10⁻⁹"
    assert [format_plain(x) for x in (1e9, -2.5e8, 1.5e-7, 1e6, 123456789.0)] == [
        *("1 × 10⁹", "\u22122.5 × 10⁸", "1.5 × 10⁻⁷", "1000000", "123456789")
    ]
    assert format_plain(0.1) == "0.1"
