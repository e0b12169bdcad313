"""Assessments as they are shown: worst first, intervals, axes, what to set with old and new."""

from __future__ import annotations

import math

from attlog.present.sensors import checks_by_trouble, health, title
from attlog.result import Assessment, Check, Setting
from tests.report.conftest import assessments, make_result


def shown(*found: Assessment):
    """These assessments as they are shown."""
    result = make_result(with_traces=False)
    result.health = list(found)
    return health(result)


def test_faults_come_before_warnings_and_the_rest_is_apart():
    found = shown(*assessments())
    assert [(a.title, a.verdict) for a in found.trouble] == [("Compass offset", "fault"), ("Vibration", "warning")]
    assert [a.title for a in found.ok] == ["GNSS delay"]
    assert found.ok_titles == "GNSS delay GPS:0"
    assert [a.title for a in found.unknown] == ["Soft iron"]


def test_value_interval_axes_and_settings_are_written_as_everywhere():
    offset = shown(*assessments()).trouble[0]
    assert (offset.value, offset.ci) == ("12.0 µT", "10.0 to 14.0")
    assert offset.axes == ("x 12.0 ± 2.0", "y −0.50 ± 2.00", "z 0.20 ± 1.00")
    assert [(s.name, s.old, s.new) for s in offset.settings] == [
        ("COMPASS_OFS_X", "-12.5", "-133.5"),
        ("COMPASS_OFS_Y", "", "0"),
    ]
    assert offset.why == (
        "Heading error of the other half falls from 15.5° to 1.5°.",
        "n = 38 over 2.1 min",
        "Limit: ok below 1.5 µT (the prototypes)",
    )


def test_where_nothing_can_be_set_action_and_reason_stand_in_its_place():
    one = Assessment("MAG:0", "compass_motors", "warning", "Off.", action="Move it.", why_no_setting="No rest.")
    assert shown(one).trouble[0].advice == "Move it. No rest."
    one.settings = [Setting("A", 1.0, 2.0)]
    assert shown(one).trouble[0].advice == ""
    assert shown(one).trouble[0].why == ("Move it.",)


def test_values_that_are_no_numbers_are_shown_as_nothing():
    one = Assessment("", "x", "fault", "?", math.nan, "uT", (math.nan, 1.0), [math.nan], [math.inf])
    found = shown(one).trouble[0]
    assert (found.value, found.ci, found.axes) == ("", "", ("x",))


def test_a_question_in_words_keeps_abbreviations():
    assert title("gnss_delay") == "GNSS delay"
    assert title("imu_delay") == "IMU delay"
    assert title("accelerometer_offset") == "Accelerometer offset"
    assert title("") == "Question"


def test_checks_that_are_not_ok_come_first_with_faults_before_warnings():
    checks = [Check(v, v, "") for v in ("ok", "warning", "unknown", "fault")]
    trouble, others = checks_by_trouble(checks)
    assert [c.verdict for c in trouble] == ["fault", "warning"]
    assert [c.verdict for c in others] == ["ok", "unknown"]
