"""What is wrong in words: one line with its action, why behind it, a time to click on, nothing said twice."""

from __future__ import annotations

import math
from dataclasses import replace

import pytest

from attlog.cli.tables import finding_lines
from attlog.health.check import Setting, unknown
from attlog.result import Finding, Result
from attlog.words.findings import (
    findings,
    no_problem_text,
    parameter_change,
    parameter_changes,
    question_title,
    question_titles,
    reasons_unknown,
    repeat_advice_once,
    shown_checks,
    value_text,
)
from tests.health.made import MADE, OFFSET, REFUSED, SILENT, SOUND


def found(*found: Finding) -> Result:
    return Result({}, "", {}, {"name": "x"}, findings=list(found))


def printed(made: Result, verbose: bool = False, width: int = 100) -> list[str]:
    return [line.text for line in finding_lines(findings(made), width, verbose)]


GYRO = Finding(
    "gyro_bias",
    "serious",
    "Standing still the gyro reads -24.30 deg/s.",
    value=-24.3,
    unit="deg/s",
    evidence=["Its bias moved."],
    cause="It is warm.",
    action="Calibrate it.",
)
NOTE = Finding("cut_at_end", "note", "The last record is cut.")


def test_a_finding_is_one_line_with_its_action_and_why_only_where_asked_for() -> None:
    assert printed(found(GYRO)) == ["serious   Standing still the gyro reads −24.30°/s. Calibrate it."]
    assert [line.strip() for line in printed(found(GYRO), verbose=True)[1:]] == [
        "Its bias moved.",
        "Cause: It is warm.",
    ]


def test_no_problem_is_only_said_where_there_is_none_and_hidden_notes_are_counted() -> None:
    assert printed(found())[0].strip() == "No problem was found."
    assert printed(found(NOTE))[0].strip() == "No problem was found; 1 note with -v."
    assert "cut" in printed(found(NOTE), verbose=True)[0]
    assert "No problem" not in "".join(printed(found(GYRO, NOTE)))
    assert no_problem_text(findings(found(NOTE))) == ""


@pytest.mark.parametrize(
    ("text", "t", "parts"),
    [
        ("It shook at 53.7 s.", 53.7, ("It shook at ", "53.7 s", ".")),
        ("From 54 s on it shakes.", 53.7, ("From ", "54 s", " on it shakes.")),
        ("It shakes.", 53.7, ("It shakes (at ", "53.7 s", ").")),
        ("It shakes by 53.7 m/s^2.", None, ("It shakes by 53.7 m/s².", "", "")),
        ("It shook at 3000.0 s.", 3000.0, ("It shook at ", "0:50:00", ".")),
    ],
)
def test_a_sentence_is_parted_at_its_time(text: str, t: float | None, parts: tuple[str, str, str]) -> None:
    (one,) = findings(found(Finding("x", "warning", text, t=t)))
    assert (one.before, one.when, one.after) == parts


def test_a_count_and_an_action_that_the_sentence_holds_are_not_said_again() -> None:
    (one,) = findings(found(Finding("x", "warning", "It failed 3 times. Mend it.", count=3, action="Mend it.")))
    assert one.line == "It failed 3 times. Mend it."
    (one,) = findings(found(Finding("x", "warning", "It failed at 7.0 s.", t=7.0, count=3)))
    assert one.line == "It failed at 7.0 s (3 times)."
    for text in ("It left out 2,078 of 2,797 records.", "It left out 2078 records."):
        assert findings(found(Finding("x", "warning", text, count=2078)))[0].line == text
    (one,) = findings(found(Finding("x", "warning", "It shook.", count=2078)))
    assert one.line == "It shook (2,078 times)."


# Assessments in words: values with their intervals, the worst first, what to set.


@pytest.mark.parametrize(
    ("value", "unit", "ci95", "text"),
    [
        (24.0, "uT", (21.0, 27.0), "24.0 ± 3.0 µT"),
        (30.0, "uT", (20.0, 60.0), "30.0 (20.0 to 60.0) µT"),
        (-1.5, "deg", (-2.0, -1.0), "−1.5 ± 0.5°"),
        (10.208, "m/s^2", (10.174, 10.242), "10.21 ± 0.03 m/s²"),
        (0.01, "", (0.01, 0.01), "0.010"),
        (120.0, "ms", None, "+120 ms"),
        (120.0, "ms", (100.0, 140.0), "+120 ± 20 ms"),
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
    shown = shown_checks([SILENT, *MADE])
    assert [a.verdict for a in shown] == ["fault", "warning", "ok", "unknown", "unknown"]
    assert [a.listed for a in shown] == [True, True, False, False, False]
    assert shown[1].to_set == "COMPASS_OFS_X -12 -> 145, COMPASS_OFS_Y 4.5 -> -20.25"


def test_without_values_the_row_says_what_to_do_and_its_details_why_there_are_none():
    made = replace(OFFSET, settings=[], action="Balance the propellers.", why_no_setting="No parameter removes it.")
    (shown,) = shown_checks([made])
    assert shown.to_set == "Balance the propellers."
    assert "No parameter removes it." in shown.why
    (shown,) = shown_checks([replace(made, action="")])
    assert shown.to_set == "No parameter removes it."


def test_what_to_set_can_be_typed_and_names_the_old_value_where_it_is_known():
    assert str(parameter_change(Setting("A", -12.0, 145.0))) == "A -12 -> 145"
    assert str(parameter_change(Setting("A", None, 0.5))) == "A 0.5"
    settings = [Setting(name, None, 1.0) for name in "ABC"]
    assert parameter_changes(settings, 3) == "A 1, B 1, C 1"
    assert parameter_changes(settings, 1) == "A 1 and 2 more"


def test_a_question_of_another_version_is_told_by_its_id():
    assert question_title("compass_offset") == "compass offset"
    assert question_title("some_thing") == "some thing"


def test_axes_evidence_extent_and_limit_stand_beside_the_answer():
    (shown,) = shown_checks([OFFSET])
    assert shown.why == (
        "x 24.0 ± 3.0, y −3.00 ± 3.00, z 0.50 ± 4.00 µT.",
        "The compass heading was off by 15°, after it by 1.5°.",
        "n = 40 over 3.3 min.",
        "Limit: 1.5 µT and 4 standard errors (measured on 39 simulated flights).",
    )


def test_where_nothing_can_be_set_the_action_stands_and_the_reason_is_a_detail():
    both = replace(REFUSED, action="Move it.")
    (shown,) = shown_checks([both])
    assert (shown.to_set, shown.why) == ("Move it.", (REFUSED.why_no_setting,))
    assert shown_checks([replace(SOUND, threshold="ok up to 30 m/s^2")])[0].why == ("Ok up to 30 m/s².",)
    assert shown_checks([REFUSED])[0].to_set == REFUSED.why_no_setting
    offering = replace(both, settings=[Setting("A", 1.0, 2.0)], why_no_setting="")
    (shown,) = shown_checks([offering])
    assert (shown.advice, shown.to_set, shown.why) == ("", "A 1 -> 2", ("Move it.",))


def test_values_that_are_no_numbers_are_shown_as_nothing():
    broken = replace(
        OFFSET, value=math.nan, ci95=(math.nan, 1.0), vector=[math.nan], vector_ci95=[math.inf], evidence=[]
    )
    (shown,) = shown_checks([broken])
    assert shown.value == ""
    assert "x" not in shown.why[0]


def test_a_verdict_of_another_version_cannot_be_told():
    assert shown_checks([replace(SOUND, verdict="better")])[0].verdict == "unknown"


def test_the_same_advice_to_one_question_stands_once():
    rows = shown_checks([REFUSED, replace(REFUSED, sensor="MAG.2"), replace(REFUSED, question="soft_iron")])
    assert [a.advice for a in repeat_advice_once(rows)] == [
        REFUSED.why_no_setting,
        "The same as for MAG.1.",
        REFUSED.why_no_setting,
    ]
    bare = shown_checks([replace(SOUND, sensor=name) for name in ("IMU.0", "IMU.1")])
    assert repeat_advice_once(bare) == bare
    assert question_titles(bare) == "vibration (2)"


def test_questions_that_cannot_be_told_for_one_reason_stand_together():
    why = "The flight is too short."
    found = [unknown("gnss_delay", why, sensor="GPS"), unknown("lanes", why), unknown("notch", "Too slow.")]
    found[2].action = "Log more."
    assert reasons_unknown(shown_checks(found)) == [
        ("GNSS delay of GPS; estimator lane in use", why),
        ("notch filter", "Too slow. Log more."),
    ]
