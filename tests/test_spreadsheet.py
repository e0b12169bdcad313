"""CSV cells: a spreadsheet shows them and runs none."""

from __future__ import annotations

import csv
import io

import pytest

from attlog.spreadsheet import cell, csv_text


@pytest.mark.parametrize(
    "text",
    ["=1+1", "+1+1", "-1+1", "@SUM(A1)", "\t=1", "\r=1", "\n=1", " =1", "=HYPERLINK(\"http://x\")", "＝1+1",
     "=cmd|' /C calc'!A0",
     "-2+3+cmd|' /C calc'!A0", "--1", "+-1", "-1 -1", "-1_0", "-٣"],
)  # fmt: skip
def test_what_a_spreadsheet_would_run_begins_with_an_apostrophe(text: str) -> None:
    assert cell(text) == f"'{text}"


@pytest.mark.parametrize(
    "text", ["-1.5", "+3", "-1e-6", "-.5", "-inf", "nan", "a=b", "", "-", "+", "1-2", "ATT", "x@y"]
)
def test_numbers_and_plain_words_stay(text: str) -> None:
    assert cell(text) == text


@pytest.mark.parametrize("value", [-1.5, -3, None, True, float("inf")])
def test_values_that_are_no_text_stay(value: object) -> None:
    assert cell(value) is value


def test_nothing_in_a_cell_steers_a_terminal() -> None:
    assert cell("a\x1b]0;x\x07\x9b31m\u202e\udcffb") == "a\ufffd]0;x\ufffd\ufffd31m\ufffd\ufffdb"


def test_a_file_reads_back_as_it_was() -> None:
    lines = [["name", "=1"], ['quote " and , comma', -1.5], ["two\nlines", None]]
    read = list(csv.reader(io.StringIO(csv_text(lines))))
    assert read == [["name", "'=1"], ['quote " and , comma', "-1.5"], ["two\nlines", ""]]
