"""Numbers as people read them."""

from __future__ import annotations

import math

import pytest

from attlog.present.numbers import (
    between,
    change,
    change_end,
    counted,
    duration,
    half_width,
    interval,
    listed,
    moment,
    number,
    quantity,
)


@pytest.mark.parametrize(
    ("value", "unit", "text"),
    [
        (0.0123, "deg", "0.012"),
        (0.0996, "deg", "0.10"),
        (0.123, "deg", "0.12"),
        (0.996, "deg", "1.0"),
        (99.94, "deg", "99.9"),
        (1908.7, "deg/min", "+1909"),
        (12.34, "deg", "12.3"),
        (0.0001, "deg", "<0.001"),
        (-0.0001, "deg", "−<0.001"),
        (0.0, "deg", "0.000"),
        (-1.234, "deg/min", "−1.2"),
        (0.123, "deg/min", "+0.12"),
        (0.0, "deg/min", "0.00"),
        (-0.001, "deg/min", "0.00"),
        (12.4, "ms", "+12"),
        (-0.4, "ms", "0"),
        (99.7, "%", "100"),
        (1.004, "1", "1.00"),
        (12345.0, "ns", "12,345"),
        (None, "deg", ""),
        (math.nan, "deg", ""),
        (math.inf, "ms", ""),
    ],
)
def test_decimals_follow_the_unit(value, unit, text):
    assert number(value, unit) == text


def test_degrees_stand_close_and_words_apart():
    assert quantity(0.5, "deg") == "0.50°"
    assert quantity(-3.2, "deg/min") == "−3.2°/min"
    assert quantity(12, "ms") == "+12 ms"
    assert quantity(None, "ms") == ""


def test_intervals():
    assert interval((-6.7, -2.71), "deg/min") == "−6.7 to −2.7"
    assert interval(None, "deg") == ""
    assert interval((math.nan, 1.0), "deg") == ""


@pytest.mark.parametrize(
    ("seconds", "text"),
    [(0.42, "0.4 s"), (36.2, "36 s"), (242.6, "4.0 min"), (7500.0, "2 h 05 min"), (None, ""), (3599.0, "60.0 min")],
)
def test_durations(seconds, text):
    assert duration(seconds) == text


def test_lists():
    assert [listed(x) for x in ([], ["a"], ["a", "b"], ["a", "b", "c"])] == ["", "a", "a and b", "a, b and c"]


@pytest.mark.parametrize(
    ("t", "text"),
    [(0.0, "0.0 s"), (-0.01, "0.0 s"), (-2.5, "−2.5 s"), (599.9, "599.9 s"), (600.0, "0:10:00"), (7384.4, "2:03:04")],
)
def test_moments_beyond_ten_minutes_are_clock_times(t, text):
    assert moment(t) == text


def test_one_is_singular():
    assert [counted(n, "quick movement") for n in (0, 1, 2)] == [
        "0 quick movements",
        "1 quick movement",
        "2 quick movements",
    ]


def test_half_of_an_interval_has_no_sign():
    assert half_width((-6.7, -2.7), "deg/min") == "±2.0"
    assert half_width(None, "ms") == ""


@pytest.mark.parametrize(
    ("ratio", "text"),
    [
        (0.76, "\N{MINUS SIGN}24 %"),
        (1.063, "+6.3 %"),
        (1.0, "0 %"),
        (1.0001, "<0.1 %"),
        (3.18, "+218 %"),
        (12.2, "12 times"),
        (885502.5, "not comparable"),
        (0.001, "not comparable"),
        (math.inf, "not comparable"),
        (math.nan, "not comparable"),
    ],
)
def test_a_change_beyond_ten_is_a_factor_and_beyond_a_hundred_no_comparison(ratio: float, text: str) -> None:
    assert change(ratio) == text
    assert change(ratio, signed=False) == text.lstrip("+\N{MINUS SIGN}")


def test_a_range_has_its_unit_once_and_no_end_that_cannot_be_shown() -> None:
    assert between("0.86°", "1.5°") == "0.86 to 1.5°"
    assert between("4 ms", "12 ms") == "4 to 12 ms"
    assert between("1.0°", "1.0°") == "1.0°"
    assert between("<0.001°", "0.004°") == "up to 0.004°"
    assert between(change_end(0.001), change_end(700.0)) == "\N{MINUS SIGN}99 % to over 100 times"
    assert between("+40 %", "12 times") == "+40 % to 12 times"
