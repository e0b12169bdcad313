"""Numbers as people read them."""

from __future__ import annotations

import math

import pytest

from attlog.words.numbers import (
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
from attlog.words.text import clean, encodable, on_encode_error, plain_value, typeset


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


# Texts of strangers and sentences of other rooms, as they are shown.


@pytest.mark.parametrize("text", ["a\x00b", "a\x9bb", "a\u2028b", "a\ud800b"])
def test_control_characters_become_a_visible_mark(text):
    assert clean(text) == "a\ufffdb"


@pytest.mark.parametrize(
    ("text", "shown"),
    [
        ("the interval is +-6.0 deg/min", "the interval is ±6.0°/min"),
        ("reads -24 deg/s standing still", "reads −24°/s standing still"),
        ("the first at -0.0 s", "the first at 0.0 s"),
        ("changes by -0.04 deg", "changes by −0.04°"),
        ("diverged from 1043.2 s", "diverged from 0:17:23"),
        ("at 599.9 s, until 7384.0 s", "at 599.9 s, until 2:03:04"),
        ("900 s of rest", "900 s of rest"),
        ("log flight-0 of x-0.5", "log flight-0 of x-0.5"),
    ],
)
def test_units_signs_and_times_are_written_as_everywhere(text, shown):
    assert typeset(text) == shown


def test_values_of_unknown_type():
    assert [plain_value(v, u) for v, u in ((None, ""), (True, ""), (-0.0, "deg"), (-1.5, "ms"), (3, ""))] == [
        "",
        "yes",
        "0°",
        "−1.5 ms",
        "3",
    ]


def test_a_minus_before_a_colon_is_one_too():
    assert typeset("shows an acceleration of -1.6: it is wrong by -3.0; or -2 deg") == (
        "shows an acceleration of −1.6: it is wrong by −3.0; or −2°"
    )


# Outputs that cannot show every sign.


@pytest.mark.parametrize(
    ("text", "encoding", "shown"),
    [
        ("0.012°, ±2 ms, −1.2°/min", "ascii", "0.012 deg, +/-2 ms, -1.2 deg/min"),
        ("0.012°, ±2 ms, −1.2°/min", "latin-1", "0.012°, ±2 ms, -1.2°/min"),
        ("0.012°, ±2 ms, −1.2°/min", "cp1252", "0.012°, ±2 ms, -1.2°/min"),
        ("RMS °", "ascii", "RMS deg"),
        ("Müller…", "ascii", "Muller..."),
        ("飞", "ascii", "\\u98de"),
        ("a\udcffb.bin", "utf-8", "a\\xffb.bin"),
        ("0.012° √h", "utf-8", "0.012° √h"),
    ],
)
def test_signs_get_stand_ins_only_where_they_must(text, encoding, shown):
    assert encodable(text, encoding) == shown
    assert shown.encode(encoding).decode(encoding) == shown


def test_the_error_handler_writes_the_same():
    import codecs

    codecs.register_error("attlog-test", on_encode_error)
    assert "x 0.5°±".encode("ascii", "attlog-test") == b"x 0.5 deg+/-"
    with pytest.raises(UnicodeDecodeError):
        b"\xff".decode("utf-8", "attlog-test")
