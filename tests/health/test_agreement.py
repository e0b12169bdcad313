"""A check and a question of the same sensor say one thing, and a unit that flew nothing accuses nobody."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace
from typing import Any, cast

import pytest

from attlog.flight.model import FlightLog
from attlog.health.agreement import agreed, answers, of_other_sensors
from attlog.health.assessments import Assessment, unknown
from attlog.health.model import Check, not_judged


def imu(source: str) -> Any:
    return SimpleNamespace(gyro=SimpleNamespace(source=source), acc=SimpleNamespace(source=source))


def mag(source: str) -> Any:
    return SimpleNamespace(field=SimpleNamespace(source=source))


LOG = cast(
    FlightLog,
    SimpleNamespace(
        mags=[mag("MAG:0"), mag("MAG:1")],
        mag=1,
        imus=[imu("IMU:0"), imu("IMU:1")],
        imu=0,
        innovation_tests=[SimpleNamespace(aid="compass", source="XKF4.SM")],
    ),
)
MOTORS = Check("field against motors", "ok", "Not the motors.", 40.0, "%", t=3.0, cause="Iron.")
BENT = Assessment("MAG:1", "compass_motors", "fault", "MAG:1 reads 9 uT.", 9.0, "uT", (8.0, 10.0), n=7, seconds=5.0)


def test_an_answered_question_gives_the_check_verdict_sentence_and_number() -> None:
    (found,) = agreed(LOG, [MOTORS], [BENT])
    assert (found.name, found.verdict, found.text, found.about) == (MOTORS.name, "fault", BENT.text, BENT.question)
    assert (found.value, found.unit, found.ci95, found.samples, found.seconds) == (9.0, "uT", (8.0, 10.0), 7, 5.0)
    assert (found.t, found.cause) == (None, ""), "what the check said of itself goes with its verdict"
    assert agreed(LOG, [found], [BENT]) == [found], "once more changes nothing"


@pytest.mark.parametrize("other", [unknown("MAG:1", "compass_motors", "No."), replace(BENT, sensor="MAG:0")])
def test_what_is_unknown_or_of_another_compass_leaves_the_check(other: Assessment) -> None:
    assert agreed(LOG, [MOTORS], [other]) == [MOTORS]
    assert answers(LOG, [MOTORS], [other]) == {}


def test_a_question_about_something_else_leaves_the_check() -> None:
    assert agreed(LOG, [MOTORS], [replace(BENT, question="compass_offset")]) == [MOTORS]


def test_a_check_that_could_not_be_made_is_answered_too() -> None:
    (found,) = agreed(LOG, [not_judged(MOTORS.name, "No throttle.")], [BENT])
    assert (found.verdict, found.text) == ("fault", BENT.text)


def test_a_sensor_that_stopped_stands_for_itself() -> None:
    stopped = Check("gravity", "fault", "All values are zero.", "zero")
    fine = Assessment("IMU:0", "accelerometer_rest", "ok", "It shows 9.81.")
    assert agreed(LOG, [stopped], [fine]) == [stopped]


def test_a_wrong_scale_does_not_spoil_every_comparison_as_a_broken_accelerometer_does() -> None:
    scale = Assessment("IMU:0", "accelerometer_rest", "fault", "It shows 8.2.", 8.2)
    for own, found in (("ok", "warning"), ("warning", "warning"), ("fault", "fault")):
        assert agreed(LOG, [Check("gravity", own, "It shows 8.2.", 8.2)], [scale])[0].verdict == found


def test_of_vibration_the_worst_unit_counts() -> None:
    check = Check("vibration", "warning", "It vibrates by 4 m/s^2.", 4.0)
    levels = [Assessment(f"IMU.{k}", "vibration_level", v, v) for k, v in ((0, "ok"), (1, "fault"), (2, "warning"))]  # type: ignore[arg-type]
    assert agreed(LOG, [check], levels)[0].verdict == "fault"
    assert agreed(LOG, [check], levels[:1])[0].verdict == "ok"


def test_rejections_keep_their_time_and_take_the_verdict_of_the_ratios() -> None:
    told = Check("rejected compass", "warning", "Rejected for 14 s.", 14.0, "s", t=65.0, t_end=80.0)
    ratio = Assessment("XKF4.SM", "innovations", "fault", "It rejects its compass for 31 s.", 0.4)
    assert agreed(LOG, [told], [ratio]) == [replace(told, verdict="fault")]
    (found,) = agreed(LOG, [replace(told, verdict="ok", t=None, t_end=None)], [ratio])
    assert (found.verdict, found.text) == ("fault", ratio.text)
    assert agreed(LOG, [replace(told, name="rejected height")], [ratio])[0].verdict == "warning", "another aid"


def test_other_compasses_and_imus_are_known_and_estimators_are_not_among_them() -> None:
    seen = [replace(BENT, sensor=name) for name in ("MAG:0", "MAG:1", "IMU:0", "IMU:1", "XKF4.SM", "IMU.1")]
    assert [a.sensor for a in of_other_sensors(LOG, seen)] == ["MAG:0", "IMU:1"]
