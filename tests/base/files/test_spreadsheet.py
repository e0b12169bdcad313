"""CSV cells: a spreadsheet shows them and runs none."""

from __future__ import annotations

import csv
import io

import pytest

from attlog.base.files.spreadsheet import cell, csv_text


@pytest.mark.parametrize(
    "text",
    [
        "=1+1",
        "+1+1",
        "-1+1",
        "@SUM(A1)",
        " =1",
        '"=1',
        '=HYPERLINK("http://x")',
        "＝1+1",
        "=cmd|' /C calc'!A0",
        "-2+3+cmd|' /C calc'!A0",
        "--1",
        "+-1",
        "-1 -1",
        "-1_0",
        "-٣",
    ],
)
def test_what_a_spreadsheet_would_run_begins_with_an_apostrophe(text: str) -> None:
    assert cell(text) == f"'{text}"


@pytest.mark.parametrize(
    "text", ["-1.5", "+3", "-1e-6", "-.5", "-inf", "nan", "a=b", "", "-", "+", "1-2", "ATT", "x@y"]
)
def test_numbers_and_plain_words_stay(text: str) -> None:
    assert cell(text) == text


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("\t=1", "'\t'=1"),
        ("\n=1", "'\n'=1"),
        ("\r=1", "'\n'=1"),
        ("a\r=cmd|x", "a\n'=cmd|x"),
        ("a\r\n@x", "a\n'@x"),
        ("a;=1", "a;'=1"),
        ('a;"=1', "a;'\"=1"),
        ("a; -5", "a; -5"),
        ("a;-5+cmd|x", "a;'-5+cmd|x"),
        ("a;;\t+x", "a;;\t'+x"),
        ("two\nlines; three", "two\nlines; three"),
        ("\ufeff=1", "\ufffd=1"),
    ],
)
def test_so_does_what_is_a_cell_with_another_separator(text: str, expected: str) -> None:
    assert cell(text) == expected


def test_a_lone_carriage_return_ends_no_row() -> None:
    """Python's writer quotes none, and spreadsheets end the row there."""
    assert "\r" not in csv_text([["a\r=1", "b\rc"], ["d\r", "\r"]])


def test_a_cell_costs_time_in_proportion_to_its_length() -> None:
    long = '";\t' * 300_000
    assert len(cell(long)) == len(long)


@pytest.mark.parametrize("value", [-1.5, -3, None, True, float("inf")])
def test_values_that_are_no_text_stay(value: object) -> None:
    assert cell(value) is value


def test_nothing_in_a_cell_steers_a_terminal() -> None:
    assert cell("a\x1b]0;x\x07\x9b31m\u202e\udcffb") == "a\ufffd]0;x\ufffd\ufffd31m\ufffd\ufffdb"


def test_a_file_reads_back_as_it_was() -> None:
    lines = [["name", "=1"], ['quote " and , comma', -1.5], ["two\nlines", None]]
    read = list(csv.reader(io.StringIO(csv_text(lines))))
    assert read == [["name", "'=1"], ['quote " and , comma', "-1.5"], ["two\nlines", ""]]
