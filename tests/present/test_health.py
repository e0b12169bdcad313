"""Assessments in words: values with their intervals, the worst first, what to set."""

from __future__ import annotations

from dataclasses import replace

import pytest

from attlog.health.assessments import Setting
from attlog.present.health import change, changes, question_title, shown_assessments, value_text
from tests.health.assessments.made import MADE, OFFSET, SILENT


@pytest.mark.parametrize(
    ("value", "unit", "ci95", "text"),
    [
        (24.0, "uT", (21.0, 27.0), "24.0 ± 3.00 µT"),
        (30.0, "uT", (20.0, 60.0), "30.0 (20.0 to 60.0) µT"),
        (-1.5, "deg", (-2.0, -1.0), "−1.5 ± 0.50°"),
        (120.0, "ms", None, "+120 ms"),
        (7.0, "", (6.0, 8.0), "7.00 ± 1.00"),
        (3.0, "", None, "3.00"),
        (None, "uT", None, ""),
        (1.0, "uT", (float("nan"), 2.0), "1.00 µT"),
        (float("inf"), "uT", None, ""),
        (7.0, "satellites", None, "7 satellites"),
        (1317.0, "samples", None, "1,317 samples"),
        (float("nan"), "samples", None, ""),
    ],
)
def test_a_value_has_its_unit_and_interval(value, unit, ci95, text):
    assert value_text(replace(OFFSET, value=value, unit=unit, ci95=ci95)) == text


def test_the_worst_stands_first_and_what_cannot_be_told_last():
    shown = shown_assessments([SILENT, *MADE])
    assert [a.verdict for a in shown] == ["fault", "warning", "ok", "unknown", "unknown"]
    assert [a.offers for a in shown] == [False, True, False, False, False]
    assert shown[1].to_set == "COMPASS_OFS_X -12 -> 145, COMPASS_OFS_Y 4.5 -> -20.25"


def test_without_values_the_row_says_what_to_do_and_its_details_why_there_are_none():
    made = replace(OFFSET, settings=[], action="Balance the propellers.", why_no_setting="No parameter removes it.")
    (shown,) = shown_assessments([made])
    assert shown.to_set == "Balance the propellers."
    assert "No parameter removes it." in shown.why
    (shown,) = shown_assessments([replace(made, action="")])
    assert shown.to_set == "No parameter removes it."


def test_what_to_set_can_be_typed_and_names_the_old_value_where_it_is_known():
    assert change(Setting("A", -12.0, 145.0)) == "A -12 -> 145"
    assert change(Setting("A", None, 0.5)) == "A 0.5"
    settings = [Setting(name, None, 1.0) for name in "ABC"]
    assert changes(settings, 3) == "A 1, B 1, C 1"
    assert changes(settings, 1) == "A 1 and 2 more"


def test_a_question_of_another_version_is_told_by_its_id():
    assert question_title("compass_offset") == "compass offset"
    assert question_title("some_thing") == "some thing"
