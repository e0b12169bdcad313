"""Texts of strangers and sentences of other rooms, as they are shown."""

from __future__ import annotations

import pytest

from attlog.present.text import clean, plain_value, typeset


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
