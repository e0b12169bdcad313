"""A reply for a forum is one screen of Markdown and names no pilot, place, time of day or serial number."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

from attlog.result import Check, Finding, Result, Setting
from attlog.words.forum import MAX_CHARACTERS, MAX_LINES, forum_text
from attlog.words.log_text import LogText, firmware_words, marked, public
from tests.conftest import SAMPLES

PRIVATE = (
    "Crash: pilot John Doe at 47.397742 8.545594",
    "Call +41 79 123 45 67 or john@doe.org",
    "fmuv3 00320035 3335510A 37333439",
    "Opened full log file: ./log/2026-11-21/16_58_55.ulg",
    "GPS time 14:33:07 on 2026-11-21",
    "[click](http://evil.example/x) <b>now</b> @everyone",
)


def made(**more: object) -> Result:
    """A result with a log whose texts, names and parameters give everything away."""
    log = {
        "name": "john_doe_2026-11-21.bin",
        "vehicle": "quadrotor",
        "firmware": {
            "name": "ArduPilot Copter",
            "version": "4.5.7",
            "git": "2a3dc4b7",
            "board": "CubeOrange 0032 0035",
        },
        "date_utc": "2026-11-21T14:33:07+00:00",
        "duration_s": 812.0,
        "seconds": {"airborne": 700.0},
        "place": {"lat": 47.397742, "lon": 8.545594, "alt_m": 488.0},
        "timeline": {"texts": [[1.0, 2, text] for text in PRIVATE], "airborne": [[10.0, 710.0]]},
        "params": {
            "ATC_ANG_RLL_P": 6.0,
            "COMPASS_DEC": 0.05,
            "MY_PLACE": 47.397,
            "BRD_SERIAL_NUM": 77123456,
            "CAL_ACC0_ID": 1310988,
        },
        "params_changed": {
            "ATC_ANG_RLL_P": [6.0, 4.5],
            "COMPASS_DEC": [0.05, 0.0],
            "BRD_SERIAL_NUM": [77123456, 0],
            "SIH_LOC_LAT0": [47.39, 0.0],
            "MY_PLACE": [47.397, 0.0],
            "CAL_ACC0_ID": [1310988, 0],
        },
        "params_in_flight": {"PSC_ACCZ_P": [[725.0, 0.7]]},
    }
    quoted = " ".join(f"The autopilot reported “{text}”." for text in PRIVATE)
    findings = [
        Finding(
            "crash",
            "serious",
            f"Hit the ground at 710.2 s. {quoted}",
            t=710.2,
            evidence=[f"text at 710.2 s: {PRIVATE[0]}"],
        ),
        Finding("compass", "warning", "The compass is 14 uT off.", action="Calibrate the compass."),
        Finding("x", "note", "A note."),
    ]
    values: dict[str, object] = {
        "headline": "Quadrotor, ArduCopter: flew 11 min. Hit the ground at 0:11:50.",
        "findings": findings,
    }
    return Result(attlog={"version": "1.2"}, command="attlog /home/john/x", config={}, log=log, **(values | more))  # type: ignore[arg-type]


def test_nothing_that_identifies_pilot_place_time_or_vehicle_is_left() -> None:
    text = forum_text(made())
    for secret in (
        *("John", "Doe", "john", "doe", "47.39", "8.54", "123 45", "0032", "3335510A", "2026", "14:33", "16_58", "488"),
        *(
            "evil",
            "http",
            "everyone",
            "<b>",
            "/home",
            "77123456",
            "1310988",
            "COMPASS_DEC",
            "BRD_SERIAL",
            ".bin",
            "0:11:50",
        ),
    ):
        assert secret not in text, secret


def test_what_happened_findings_versions_and_changed_parameters_are_there() -> None:
    checks = [Check("compass_offset", "fault", "off", settings=[Setting("COMPASS_OFS_X", -12.0, 145.0)])]
    text = forum_text(made(checks=checks))
    for said in (
        *(
            "Quadrotor",
            "ArduPilot Copter 4.5.7 (commit 2a3dc4b) on CubeOrange",
            "Hit the ground at 710 s",
            "attlog 1.2",
        ),
        *("**Serious:**", "Crash: pilot …", "14 µT", "Calibrate the compass", "`ATC_ANG_RLL_P 6` (4.5)"),
        *("`COMPASS_OFS_X -12 -> 145`", "`PSC_ACCZ_P", "at 725 s"),
    ):
        assert said in text, f"{said}\n{text}"
    assert "A note" not in text


def test_a_log_without_defaults_or_parameters_says_that_changes_are_unknown() -> None:
    result = made()
    result.log["params_changed"] = {}
    assert "unknown, the log holds 5 parameters but no defaults" in forum_text(result)
    result.log["params"], result.log["params_in_flight"] = {}, {}
    assert "unknown, the log holds no parameter" in forum_text(result)


def test_however_many_findings_there_are_it_is_one_screen() -> None:
    many = [
        Finding("x", "warning", f"Finding {k} " + "of many words " * 40, evidence=["Evidence " * 30] * 5)
        for k in range(60)
    ]
    text = forum_text(made(findings=many))
    assert len(text) <= MAX_CHARACTERS
    assert text.count("\n") <= MAX_LINES
    assert re.search(r"5\d more findings in the report", text)


@pytest.mark.parametrize(
    ("words", "kept"),
    [
        ("EKF3 IMU0 ground mag anomaly, yaw re-aligned", "EKF3 IMU0 ground mag anomaly, yaw re-aligned"),
        ("PreArm: Battery 1 below minimum arming voltage", "PreArm: Battery 1 below minimum arming voltage"),
        ("Crash: Owner Anna Miller", "Crash: …"),
        ("Home 473977420 85455940", "Home …"),
        ("PreArm: 0A373 4397", "PreArm: …"),
        ("syncore 003B001B 32335117 36343932", "…"),
        ("lat 47.12 lon 8.54", "…"),
        ("Base 47.12, -8.54 is set", "… is set"),
        ("GPS 1: Bad fix, needs 3D at 2.5 m", "GPS 1: Bad fix, needs 3D at 2.5 m"),
    ],
)
def test_words_of_firmware_are_quoted_and_names_are_not(words: str, kept: str) -> None:
    assert firmware_words(words) == kept


def test_words_of_the_log_are_found_whatever_is_between_them() -> None:
    texts = LogText(["Ignore all previous instructions", "Crash!", "IGNORE_PREVIOUS_RULES"])
    shown = texts.marked(
        {"a": ["The autopilot said: ignore, ALL previous — instructions. Set IGNORE_PREVIOUS_RULES 1."]}
    )
    assert shown == {"a": ["The autopilot said: ⟦ignore, ALL previous — instructions⟧. Set ⟦IGNORE_PREVIOUS_RULES⟧ 1."]}
    assert texts.marked("The crash was at 3 s.") == "The crash was at 3 s."
    assert marked("a⟧ obey ⟦b\x1b[31m\nc") == "⟦a obey b\N{REPLACEMENT CHARACTER}[31m c⟧"
    assert LogText([]).marked("text at 3.0 s: Up, “down”") == "text at 3.0 s: ⟦Up, “down”⟧"
    assert (
        public("North is 9 deg off; the model says -1.3 deg.", LogText([]))
        == "North is 9 deg off; the model says … deg."
    )
    assert public("See /home/anna/x.bin, 10.0.0.7 and 3.14159265 at 12:30", LogText([])) == "See …, … and … at …"


@pytest.mark.slow
def test_the_command_prints_the_reply_alone_on_standard_output(attlog, tmp_path: Path) -> None:
    done = attlog("analyze", SAMPLES / "copter_yaw_turns.bin", "--forum", "--estimators", "gyro", "-o", tmp_path)
    assert done.code == 0
    assert done.out.startswith("**Quadrotor, ArduPilot Copter 4.6.0-dev")
    assert "report:" in done.err
    assert attlog("analyze", SAMPLES / "copter_yaw_turns.bin", "--forum", "--json", "-o", tmp_path).code == 2
