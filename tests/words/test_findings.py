"""Findings and checks in words: made ones, and a file of what is said of them."""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path

import pytest

from attlog.cli.tables import finding_lines
from attlog.health.check import Setting, unknown
from attlog.result import Check, Finding
from attlog.words.findings import (
    first_screen_findings,
    no_problem_text,
    parameter_changes,
    question_title,
    question_titles,
    reasons_unknown,
    repeat_advice_once,
    shown_checks,
    shown_findings,
    value_text,
)
from attlog.words.text import with_fixed_units
from tests.golden import check_golden
from tests.health.made import MADE, OFFSET, REFUSED, SILENT, SOUND

GOLDEN = Path(__file__).parent / "golden"
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
FOUND = (
    GYRO,
    NOTE,
    Finding("x", "warning", "It shook at 53.7 s.", t=53.7),
    Finding("x", "warning", "From 54 s on it shakes.", t=53.7),
    Finding("x", "warning", "It shakes.", t=53.7),
    Finding("x", "warning", "It shakes by 53.7 m/s^2."),
    Finding("x", "warning", "It shook at 3000.0 s.", t=3000.0),
    Finding("x", "warning", "It failed 3 times. Mend it.", count=3, action="Mend it."),
    Finding("x", "warning", "It failed at 7.0 s.", t=7.0, count=3),
    Finding("x", "warning", "It left out 2,078 of 2,797 records.", count=2078),
    Finding("x", "warning", "It left out 2078 records.", count=2078),
    Finding("x", "warning", "It shook.", count=2078),
)


def test_a_byte_is_said_once_however_it_is_written() -> None:
    for text in ("Cut at byte 958,441, as after a power cut.", "Cut at byte 958441."):
        (shown,) = shown_findings([Finding("cut_at_end", "note", text, offset=958441)])
        assert shown.line == text
    (shown,) = shown_findings([Finding("damage", "note", "Damaged, 1958,441 bytes.", offset=41)])
    assert shown.line == "Damaged, 1958,441 bytes, at byte 41."


def test_the_first_screen_has_first_sentences_and_few_words() -> None:
    long = Finding(
        "x", "warning", f"It shook at 53.7 s{' very' * 30}. It rolled. It fell.", t=53.7, evidence=["By IMU."]
    )
    (one, two) = first_screen_findings(shown_findings([long, replace(long, kind="y"), replace(long, kind="z")]))
    assert one.line.startswith("It shook at 53.7 s")
    assert one.why == ("It rolled. It fell.", "By IMU.")
    assert two.line.endswith("very.")
    assert len(first_screen_findings(shown_findings([GYRO] * 9))) == 5
    late = Finding("x", "warning", "It shook. It fell at 7.0 s.", t=7.0)
    (kept,) = first_screen_findings(shown_findings([late]))
    assert (kept.line, kept.when) == (late.text, "7.0 s")


def test_a_number_stays_with_its_unit() -> None:
    assert with_fixed_units("flew 1 to 77.5 s (13 g)") == "flew 1\u00a0to 77.5\u00a0s (13\u00a0g)"


def test_findings_are_as_reviewed_with_their_time_to_click_on_once() -> None:
    """``[...]`` is the link to the time."""
    lines = []
    for found in FOUND:
        (one,) = shown_findings([found])
        lines.append(f"{one.label}: {one.before}{f'[{one.when}]' if one.when else ''}{one.after} {one.action}".rstrip())
        lines += [f"  {line}" for line in one.why]
    lines += [line.text for line in finding_lines(shown_findings(FOUND[:2]), 100, True)]
    lines += [line.text for found in ([], [NOTE]) for line in finding_lines(shown_findings(found), 100, False)]
    check_golden(GOLDEN / "findings.txt", lines)
    assert no_problem_text(shown_findings([NOTE])) == ""


def checks() -> list[Check]:
    balance = replace(OFFSET, settings=[], action="Balance the propellers.", why_no_setting="No parameter removes it.")
    moved = replace(REFUSED, action="Move it.")
    broken = replace(OFFSET, value=math.nan, ci95=(math.nan, 1.0), vector=[math.nan], vector_ci95=[math.inf])
    return [
        *(OFFSET, balance, replace(balance, action=""), REFUSED, moved, SILENT),
        replace(moved, settings=[Setting("A", 1.0, 2.0), Setting("B", None, 0.5)], why_no_setting=""),
        replace(SOUND, threshold="ok up to 30 m/s^2"),
        replace(SOUND, verdict="better", question="of_another_version"),
        replace(broken, evidence=[]),
    ]


def test_checks_are_as_reviewed() -> None:
    lines = []
    for check in checks():
        (one,) = shown_checks([check])
        head = f"{one.question} of {one.sensor}: {one.verdict}, {'listed' if one.listed else 'not listed'}"
        lines += [
            head,
            f"  value: {one.value or None}",
            f"  {one.text}",
            f"  to set: {one.to_set or None}; advice: {one.advice or None}",
        ]
        lines += [f"  - {line}" for line in one.why]
    check_golden(GOLDEN / "checks.txt", lines)


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
    assert [a.verdict for a in shown_checks([SILENT, *MADE])] == ["fault", "warning", "ok", "unknown", "unknown"]
    severities = [one.label for one in shown_findings([NOTE, FOUND[2], GYRO])]
    assert severities == ["Serious", "Warning", "Note"]


def test_more_parameters_than_fit_are_counted():
    settings = [Setting(name, None, 1.0) for name in "ABC"]
    assert parameter_changes(settings, 3) == "A 1, B 1, C 1"
    assert parameter_changes(settings, 1) == "A 1 and 2 more"


def test_the_same_advice_to_one_question_and_one_reason_of_many_stand_once():
    rows = shown_checks([REFUSED, replace(REFUSED, sensor="MAG.2"), replace(REFUSED, question="soft_iron")])
    assert [a.advice for a in repeat_advice_once(rows)] == [
        REFUSED.why_no_setting,
        "The same as for MAG.1.",
        REFUSED.why_no_setting,
    ]
    bare = shown_checks([replace(SOUND, sensor=name) for name in ("IMU.0", "IMU.1")])
    assert repeat_advice_once(bare) == bare
    assert question_titles(bare) == "vibration (2)"
    why = "The flight is too short."
    found = [unknown("gnss_delay", why, sensor="GPS"), unknown("lanes", why), unknown("notch", "Too slow.")]
    found[2].action = "Log more."
    assert reasons_unknown(shown_checks(found)) == [
        ("GNSS delay of GPS; estimator lane in use", why),
        ("notch filter", "Too slow. Log more."),
    ]
    assert question_title("some_thing") == "some thing"
