"""One log on a terminal: whole outputs as golden files, no line wider than the terminal, no number cut."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import replace
from pathlib import Path

import pytest

from attlog.cli.printing import TextLine, table, wrapped
from attlog.cli.tables import filter_table, merge_missing, result_lines, sensor_lines, set_line
from attlog.health.check import Setting
from attlog.result import Finding, Result
from attlog.words.names import row_names
from attlog.words.table import main_table
from tests.golden import check_golden
from tests.health.made import MADE, SILENT
from tests.report.conftest import make_result, unconfirmed_onboard

GOLDEN = Path(__file__).with_name("golden")


def texts(lines: Iterable[TextLine]) -> list[str]:
    found = [line.text for line in lines]
    assert [text for text in found if text != text.rstrip()] == []
    return found


@pytest.mark.parametrize("width", [60, 80, 160])
@pytest.mark.parametrize("verbose", [False, True])
def test_a_log_on_the_terminal(width: int, verbose: bool) -> None:
    found = texts(result_lines(make_result(), "all", width, verbose))
    check_golden(GOLDEN / f"result-{width}{'-v' * verbose}.txt", found)


@pytest.mark.parametrize("verbose", [False, True])
def test_sensors_on_the_terminal(verbose: bool) -> None:
    check_golden(GOLDEN / f"sensors{'-v' * verbose}.txt", texts(sensor_lines(MADE, 80, verbose)))


@pytest.mark.parametrize("width", [60, 80, 100, 160])
def test_every_number_is_whole_and_no_line_is_wider_than_the_terminal(width: int) -> None:
    result = make_result()
    found = texts(filter_table(result, "all", width, True))
    assert max(map(len, found)) <= width
    shown = main_table(result)
    for row, cells in shown.rows:
        line = " ".join(x for x in found if x.startswith(row_names(result)[row.name]))
        for cell in cells:
            assert cell.missing or cell.text in line.replace("*", " ").replace("~", " ").split()
    assert max(map(len, texts(sensor_lines(MADE, width, True)))) <= width


def test_a_filter_without_enough_data_is_named_below_the_table() -> None:
    result = make_result()
    row = next(row for row in result.estimators if row.kind == "replay")
    row.status, row.reason = "failed", "no GNSS motion told the heading"
    result.findings = [Finding("estimator_failed", "note", f"{row.name}: {row.reason}")]
    said = f"{row_names(result)[row.name]} failed: no GNSS motion told the heading."
    assert said in texts(filter_table(result, "all", 200, True))
    result.findings = [Finding("estimator_failed", "serious", f"{row.name}: {row.reason}")]
    assert said not in texts(filter_table(result, "all", 200, True))


def _gyro_only(result: Result) -> None:
    result.estimators = [r for r in result.estimators if r.estimator == "gyro" or r.kind == "onboard"]


def _no_values(result: Result) -> None:
    for row in result.estimators:
        row.metrics = {}


@pytest.mark.parametrize(
    ("change", "gyro"), [(lambda _: None, False), (_gyro_only, True), (_no_values, False)], ids=["all", "gyro", "none"]
)
def test_the_gyro_alone_is_in_the_short_table_only_without_other_filters(change, gyro: bool) -> None:
    result = make_result()
    change(result)
    found = texts(filter_table(result, "all", 80))
    assert any(line.startswith("Gyro") for line in found) == gyro
    assert bool(found) == (change is not _no_values)


def test_a_reason_why_several_questions_have_no_answer_appears_once() -> None:
    no = "Cannot be determined: no step."
    answers = {"accuracy": "Tilt: A 1.0°.", "noise": no, "lag": "Cannot be determined: x.", "yaw drift": no}
    found = list(merge_missing(answers))
    assert [label for label, _ in found] == ["accuracy", "lag", "no answer"]
    assert found[-1][1] == "Noise and yaw drift: no step."


def test_of_many_findings_five_are_shown() -> None:
    result = make_result()
    result.findings = [Finding("x", "warning", f"Number {i} is wrong.") for i in range(9)]
    for verbose, count in ((False, 5), (True, 9)):
        found = texts(result_lines(result, "all", 80, verbose))
        assert sum("is wrong." in line for line in found) == count
        assert ("          and 4 more with -v" in found) == (not verbose)


def test_what_to_set_takes_two_lines_at_most_and_counts_the_rest() -> None:
    many = [Setting(f"COMPASS_OFS{k}_X", float(k), 145.0 + k) for k in range(12)]
    for count in (0, 1, 2, 12):
        lines = texts(set_line(many[:count], "a_flight.bin", 80))
        assert len(lines) <= 2
        assert max(map(len, lines), default=0) <= 80
        assert ("more" in " ".join(lines)) == (count == 12)
    assert texts(set_line(many, "a" * 200, 80)) == ["set       12 parameters; attlog health shows which and why."]


def test_sensors_without_an_answer_are_counted_and_give_their_reason_once() -> None:
    same = [SILENT, replace(SILENT, sensor="GPS.1")]
    assert texts(sensor_lines(same, 80, False)) == ["  no answer: GNSS delay (2) (why: -v)"]
    assert len(texts(sensor_lines(same, 80, True))) == 2


def test_a_line_is_not_broken_between_a_number_and_its_unit() -> None:
    text = "flew 36 to 140 s, up to 6 m and 23 m/s² for 12 minutes"
    for width in range(12, 40):
        found = texts(wrapped("", text, width))
        assert " ".join(found) == text
        assert not any(line.startswith(("s,", "m ", "m/s²")) for line in found)


def test_a_table_aligns_its_columns_and_wraps_the_last() -> None:
    rows = [
        ("a", "1.5", "first words, and then some more of them, until the line is full"),
        ("long name", "12.25", "x"),
    ]
    found = list(table(rows, ("of\nwhom", "size", "said"), left=(0, -1), width=50, indent="  ", styles=["red", ""]))
    assert [line.style for line in found] == ["bold", "bold", "red", "red", "red", ""]
    assert [line.text for line in found] == [
        "  of",
        "  whom        size  said",
        "  a            1.5  first words, and then some",
        "                    more of them, until the line",
        "                    is full",
        "  long name  12.25  x",
    ]
    assert list(table([])) == []


def test_the_terminal_names_agreement_and_no_best_against_an_unproven_onboard_attitude() -> None:
    result = unconfirmed_onboard()
    found = texts(result_lines(result, "all", 160))
    assert any(line.startswith("agreement Not ranked (the onboard attitude is unproven): tilt ") for line in found)
    values = {cells[0].text for _, cells in main_table(result).rows if cells[0].unranked}
    shown = [line for line in found if any(f" {value} " in line or f" {value}~" in line for value in values)]
    assert len(shown) >= len(values) > 1
    assert not any(f" {value}*" in line for line in shown for value in values)
    assert not any(line.startswith("accuracy") for line in found)
