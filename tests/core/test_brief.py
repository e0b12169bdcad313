"""Short texts: ten lines whatever an object holds, and nothing of a log that a terminal or a browser would obey."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
import pytest

from attlog.core.brief import brief, counted, first_part, table_html, table_text


@dataclass(slots=True)
class Made:
    name: str = ""
    x: np.ndarray = field(default_factory=lambda: np.zeros(0))
    parts: dict[str, object] = field(default_factory=dict)
    rest: list[str] = field(default_factory=list)
    __repr__ = brief


def test_arrays_stand_by_their_shape_and_defaults_are_left_out() -> None:
    made = Made("imu", np.zeros((100_000, 3)))
    assert repr(made) == "Made(name='imu', x=float64[100000, 3])"
    assert repr(Made(parts={"own": made})) == "Made(x=float64[0], parts={'own'})"


@pytest.mark.parametrize(
    "made", [Made("a" * 5000), Made(rest=["word"] * 5000), Made(parts={f"part {k}": k for k in range(5000)})]
)
def test_no_text_has_more_than_ten_lines_of_110_characters(made: Made) -> None:
    lines = repr(made).splitlines()
    assert len(lines) <= 10
    assert max(map(len, lines)) <= 110


def test_text_of_a_log_is_neither_a_terminal_sequence_nor_markup() -> None:
    evil = "\x1b[31m<script>alert(1)</script>\u202e\nline"
    rows = [("row", evil)] * 40
    text, page = table_text(evil, rows), table_html(evil, rows)
    assert "\x1b" not in text + page
    assert "\u202e" not in text + page
    assert "<script" not in page
    assert len(text.splitlines()) == 10
    assert page.count("<tr>") == 9


def test_a_number_of_one_has_a_noun_of_one() -> None:
    assert [counted(n, "record") for n in (0, 1, 2, 4000)] == ["0 records", "1 record", "2 records", "4,000 records"]
    assert counted([7], "check") == "1 check"


def test_a_sentence_is_never_cut_inside_brackets() -> None:
    assert first_part("Hit the ground (at 3 s, 4.0 g), then it lay", ",") == "Hit the ground (at 3 s, 4.0 g)"
    assert first_part("Lost (from 3 s: none) from 5 s", " for ", " from ") == "Lost (from 3 s: none)"
    assert first_part("whole (at least 4.0", ",") == "whole (at least 4.0"
