"""Findings and the assessments of sensors: one entry for a cause, one action, and none for what is unknown."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import pytest

import attlog
from attlog.flight.model import FlightLog, Mag, Parameters, Stream, TimeLine
from attlog.health import causes, compass
from attlog.health.causes import Finding, other_compass, switch_parameters, was_calibrated
from attlog.health.check import Assessment, Check, Setting, not_judged, unknown
from attlog.health.findings import answers_by_check, findings, reconcile, unused_sensors
from tests.conftest import SAMPLES
from tests.health.made import OFFSET, REFUSED, SILENT, SOUND

EMPTY_LOG = attlog.read(SAMPLES / "px4_hover.ulg")
CHECK = Check("field", "warning", "The field varies by 40 %.", value=40.0)
SET = "Set COMPASS_OFS_X 145, COMPASS_OFS_Y -20.25."


def of(kind: str, checks: list[Check], *health: Assessment) -> list[Finding]:
    return [finding for finding in findings(EMPTY_LOG, checks, health=health) if finding.kind == kind]


def test_a_finding_takes_what_to_set_from_the_assessment_and_keeps_its_sentence() -> None:
    (before,), (after,) = of("compass", [CHECK]), of("compass", [CHECK], OFFSET)
    assert before.action not in ("", SET)
    assert (after.text, after.severity, after.action) == (before.text, before.severity, SET)
    assert OFFSET.text in after.evidence


def test_an_assessment_that_no_check_told_becomes_a_finding() -> None:
    (found,) = of("compass", [], OFFSET)
    assert (found.severity, found.text, found.action) == ("warning", OFFSET.text, SET)
    assert (found.value, found.unit, found.evidence) == (OFFSET.value, OFFSET.unit, OFFSET.evidence)


def test_a_note_of_the_same_kind_gives_way_to_it() -> None:
    (found,) = of("compass", [Check("declination", "warning", "It differs by 2 deg.")], OFFSET)
    assert (found.severity, found.text) == ("warning", OFFSET.text)
    assert "It differs by 2 deg." in found.evidence


def test_several_of_one_kind_are_one_finding_whose_sentence_and_action_are_of_one_sensor() -> None:
    (found,) = of("compass", [], REFUSED, OFFSET)
    assert (found.text, found.action) == (OFFSET.text, SET)
    assert REFUSED.text in found.evidence


def test_why_there_is_nothing_to_set_is_the_action_of_a_finding() -> None:
    (found,) = of("compass", [], REFUSED)
    assert found.action == REFUSED.why_no_setting


def test_what_is_ok_or_unknown_makes_no_finding_and_offers_no_action() -> None:
    settings = [Setting("A", 1.0, 2.0)]
    quiet = [replace(SOUND, settings=settings), replace(SILENT, settings=settings)]
    assert findings(EMPTY_LOG, [CHECK], health=quiet) == findings(EMPTY_LOG, [CHECK])


def test_a_disputed_value_is_no_action() -> None:
    other = replace(REFUSED, settings=[Setting("COMPASS_OFS_X", -12.0, 99.0)])
    (before,), (found,) = of("compass", [CHECK]), of("compass", [CHECK], OFFSET, other)
    assert found.action == before.action


def test_a_question_that_nobody_knows_makes_no_finding() -> None:
    assert findings(EMPTY_LOG, [], health=[replace(OFFSET, question="not_known")]) == findings(EMPTY_LOG, [])


def test_a_question_that_names_its_parameters_says_itself_what_to_set() -> None:
    words = "A suggestion: COMPASS_OFS_X 145 and COMPASS_OFS_Y -20.25."
    (found,) = of("compass", [CHECK], replace(OFFSET, action=words))
    assert found.action == words
    (found,) = of("compass", [CHECK], replace(OFFSET, action="Reboot."))
    assert found.action == SET


def test_of_the_compass_what_an_assessment_advises_wins_without_values_too() -> None:
    """A calibration, which checks advise, mends no field of motors."""
    (found,) = of("compass", [CHECK], replace(REFUSED, action="Move it away from power wires."))
    assert found.action == "Move it away from power wires."
    check = Check("vibration", "warning", "It vibrates.")
    (before,), (after,) = (
        of("vibration", [check]),
        of("vibration", [check], replace(SOUND, verdict="fault", action="X.")),
    )
    assert after.action == before.action


def in_use(assessment: Assessment) -> Assessment:
    """The same of the compass that flew."""
    return replace(assessment, sensor=EMPTY_LOG.mags[EMPTY_LOG.mag or 0].field.source)


def test_the_cause_of_a_compass_is_that_which_its_advice_mends() -> None:
    """A wrong heading is not blamed on a calibration beside an advice about the motors."""
    (before,) = of("compass", [CHECK])
    (found,) = of("compass", [CHECK], in_use(replace(REFUSED, action="Move it.")))
    assert "not calibrated" in before.cause
    assert "Currents of motors" in found.cause
    assert found.action == "Move it."


def test_a_check_and_the_question_that_answers_it_are_one_sign() -> None:
    check = Check("field against motors", "ok", "Not the motors.", 40.0)
    (found,) = of("compass", [check], in_use(REFUSED))
    assert (found.text, found.count, found.evidence) == (REFUSED.text, 1, [])


def test_motors_that_turn_no_heading_are_not_blamed_for_it() -> None:
    heading = Check("heading by GNSS", "warning", "The heading is 15 deg off.", 15.0, "deg", t=3.0)
    check = Check("field against motors", "ok", "Not the motors.", 40.0)
    (found,) = of("compass", [heading, check], in_use(REFUSED))
    assert "motors" not in found.cause + found.action
    assert REFUSED.text in found.evidence
    assert found.action == EMPTY_LOG.remedies["compass"]


def test_a_check_that_a_question_clears_is_no_finding() -> None:
    check = Check("vibration", "warning", "It vibrates.", 4.0)
    assert of("vibration", [check])
    assert of("vibration", [check], SOUND) == []


def test_a_unit_that_is_not_in_use_is_a_note_and_sets_nothing_for_the_one_that_is() -> None:
    log = replace(
        EMPTY_LOG,
        mags=[*EMPTY_LOG.mags, replace(EMPTY_LOG.mags[0], field=replace(EMPTY_LOG.mags[0].field, source="spare"))],
    )
    spare = replace(OFFSET, sensor="spare")
    (alone,) = [f for f in findings(log, [], health=[spare]) if f.kind == "compass"]
    assert (alone.severity, alone.action) == ("note", SET)
    (found,) = [f for f in findings(log, [CHECK], health=[spare]) if f.kind == "compass"]
    assert (found.severity, found.text) == ("warning", CHECK.text)
    assert found.action != SET


def test_gyros_that_differ_are_no_accelerometer() -> None:
    apart = Assessment("IMU.9", "imu_instances", "warning", "They differ by 2 deg/s.", value=2.0, unit="deg/s")
    assert [f.kind for f in findings(EMPTY_LOG, [], health=[apart])] == ["gyro_bias"]
    assert [f.kind for f in findings(EMPTY_LOG, [], health=[replace(apart, unit="m/s^2")])] == ["accelerometer"]


def test_only_one_source_says_which_compass_to_use(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(causes, "other_compass", lambda log: "Use the other.")
    best = in_use(Assessment("", "compass_choice", "ok", "The one in use errs least."))
    (alone,), (told,) = of("compass", [CHECK]), of("compass", [CHECK], best)
    assert alone.action == "Use the other."
    assert told.action not in ("", "Use the other.")


def test_what_is_wrong_with_a_spare_compass_is_no_evidence_against_the_one_in_use() -> None:
    log = replace(
        EMPTY_LOG,
        mags=[*EMPTY_LOG.mags, replace(EMPTY_LOG.mags[0], field=replace(EMPTY_LOG.mags[0].field, source="spare"))],
    )
    (found,) = [f for f in findings(log, [CHECK], health=[replace(OFFSET, sensor="spare")]) if f.kind == "compass"]
    assert OFFSET.text not in found.evidence


# Another compass by the size of its field: the limits of what is sound and what is off, and which one is named.

EARTH_UT = 50.0


def mag(index: int, size: float, varying: float = 0.0) -> Mag:
    """A compass that reads ``size`` uT, half of the time more and half less by a share of it."""
    t = np.arange(0.0, 100.0, 0.1)
    direction = np.array([0.36, -0.48, 0.8])
    field = 1e-6 * size * (1.0 + varying * np.where(np.arange(len(t)) % 2, 1.0, -1.0))
    return Mag(index, Stream(t, field[:, None] * direction, "T", "FRD", f"MAG.{index}"))


@pytest.fixture
def log(monkeypatch: pytest.MonkeyPatch) -> Any:
    model = SimpleNamespace(strength_t=1e-6 * EARTH_UT)
    for place in (causes, compass):
        monkeypatch.setattr(place.declination, "model", lambda log: model)
    found: Any = SimpleNamespace(mag=0, compass_switches={}, compass_first="", parameters=Parameters(), replay_imu=None)
    found.param = lambda name: found.parameters.lines[name].value[-1] if name in found.parameters.lines else None
    return found


def advised(log: Any, used: float, other: float, varying: float = 0.0) -> str:
    """What is advised of a first compass that is in use and a second one."""
    log.mags = [mag(0, used), mag(1, other, varying)]
    return other_compass(log)


@pytest.mark.parametrize(
    ("used", "other", "varying", "advises"),
    [
        (39.5, 50.0, 0.0, True),
        (40.5, 50.0, 0.0, False),
        (60.5, 50.0, 0.0, True),
        (59.5, 50.0, 0.0, False),
        (80.0, 54.5, 0.0, True),
        (80.0, 55.5, 0.0, False),
        (80.0, 45.5, 0.0, True),
        (80.0, 44.5, 0.0, False),
        (80.0, 50.0, 0.09, True),
        (80.0, 50.0, 0.11, False),
    ],
)
def test_one_that_is_off_by_a_fifth_gives_way_to_one_within_a_tenth_that_hardly_varies(
    log: Any, used: float, other: float, varying: float, advises: bool
) -> None:
    assert bool(advised(log, used, other, varying)) is advises
    case: Any = SimpleNamespace(log=log, segments=SimpleNamespace())
    monkey = pytest.MonkeyPatch()
    monkey.setattr(compass, "compass_flight_spans", lambda segments: [(0.0, 100.0)])
    (found,) = compass._choice_by_size(case, log.mags[0], log.mags[1:])
    monkey.undo()
    assert found.verdict == ("warning" if advises else "ok")
    assert f"MAG.0, in use, reads {used:.1f} uT of 50.0, MAG.1 " in found.text
    assert f"varying by {100 * varying:.0f} %" in found.evidence[1]


def test_the_first_sound_one_is_named_with_its_field(log: Any) -> None:
    log.mags = [mag(0, 80.0), mag(1, 70.0), mag(2, 49.0), mag(3, 51.0)]
    assert other_compass(log) == "Use MAG.2 instead, which reads 49.0 uT."
    log.mag = 3
    assert other_compass(log) == ""
    log.mag = None
    assert other_compass(log) == ""


def test_a_switch_is_named_with_what_changes_and_only_where_both_are_known(log: Any) -> None:
    log.mags = [mag(0, 80.0), mag(1, 50.0)]
    log.compass_switches = {0: "USE", 1: "USE2"}
    log.parameters.lines = {"USE": TimeLine(np.zeros(1), [1.0], "P"), "USE2": TimeLine(np.zeros(1), [0.0], "P")}
    assert switch_parameters(log, log.mags[1], log.mags[0]) == {"USE2": 1.0, "USE": 0.0}
    assert other_compass(log).endswith("uT: set USE2 1 and USE 0.")
    log.parameters.lines["USE2"] = TimeLine(np.zeros(1), [1.0], "P")
    assert switch_parameters(log, log.mags[1], log.mags[0]) == {"USE": 0.0}
    log.compass_switches = {0: "USE"}
    assert switch_parameters(log, log.mags[1], log.mags[0]) == {}


def test_a_compass_with_offsets_of_zero_was_never_calibrated(log: Any) -> None:
    one = mag(0, 50.0)
    assert was_calibrated(one)
    one.offsets = Stream(np.zeros(1), np.zeros((1, 3)), "T", "", "OFS")
    assert not was_calibrated(one)
    one.offsets = Stream(np.zeros(1), np.array([[0.0, 1e-6, 0.0]]), "T", "", "OFS")
    assert was_calibrated(one)
    one.calibrated = False
    assert not was_calibrated(one)
    log.mags = [mag(0, 80.0), one]
    assert other_compass(log).startswith("Calibrate and use MAG.0")


# A check and a question of the same sensor say one thing, and a unit that flew nothing accuses nobody.


def imu(source: str) -> Any:
    return SimpleNamespace(gyro=SimpleNamespace(source=source), acc=SimpleNamespace(source=source))


def compass_named(source: str) -> Any:
    return SimpleNamespace(field=SimpleNamespace(source=source))


TWO_COMPASSES = cast(
    FlightLog,
    SimpleNamespace(
        mags=[compass_named("MAG:0"), compass_named("MAG:1")],
        mag=1,
        imus=[imu("IMU:0"), imu("IMU:1")],
        imu=0,
        estimator=SimpleNamespace(innovation_tests=[SimpleNamespace(aid="compass", source="XKF4.SM")]),
    ),
)
MOTORS = Check("field against motors", "ok", "Not the motors.", 40.0, "%", t=3.0, cause="Iron.")
BENT = Assessment("MAG:1", "compass_motors", "fault", "MAG:1 reads 9 uT.", 9.0, "uT", (8.0, 10.0), n=7, seconds=5.0)


def test_an_answered_question_gives_the_check_verdict_sentence_and_number() -> None:
    (found,) = reconcile(TWO_COMPASSES, [MOTORS], [BENT])
    assert (found.name, found.verdict, found.text, found.about) == (MOTORS.name, "fault", BENT.text, BENT.question)
    assert (found.value, found.unit, found.ci95, found.samples, found.seconds) == (9.0, "uT", (8.0, 10.0), 7, 5.0)
    assert (found.t, found.cause) == (None, ""), "what the check said of itself goes with its verdict"
    assert reconcile(TWO_COMPASSES, [found], [BENT]) == [found], "once more changes nothing"


@pytest.mark.parametrize("other", [unknown("MAG:1", "compass_motors", "No."), replace(BENT, sensor="MAG:0")])
def test_what_is_unknown_or_of_another_compass_leaves_the_check(other: Assessment) -> None:
    assert reconcile(TWO_COMPASSES, [MOTORS], [other]) == [MOTORS]
    assert answers_by_check(TWO_COMPASSES, [MOTORS], [other]) == {}


def test_a_question_about_something_else_leaves_the_check() -> None:
    assert reconcile(TWO_COMPASSES, [MOTORS], [replace(BENT, question="compass_offset")]) == [MOTORS]


def test_a_check_that_could_not_be_made_is_answered_too() -> None:
    (found,) = reconcile(TWO_COMPASSES, [not_judged(MOTORS.name, "No throttle.")], [BENT])
    assert (found.verdict, found.text) == ("fault", BENT.text)


def test_a_sensor_that_stopped_stands_for_itself() -> None:
    stopped = Check("gravity", "fault", "All values are zero.", "zero")
    fine = Assessment("IMU:0", "accelerometer_rest", "ok", "It shows 9.81.")
    assert reconcile(TWO_COMPASSES, [stopped], [fine]) == [stopped]


def test_a_wrong_scale_does_not_spoil_every_comparison_as_a_broken_accelerometer_does() -> None:
    scale = Assessment("IMU:0", "accelerometer_rest", "fault", "It shows 8.2.", 8.2)
    for own, found in (("ok", "warning"), ("warning", "warning"), ("fault", "fault")):
        assert reconcile(TWO_COMPASSES, [Check("gravity", own, "It shows 8.2.", 8.2)], [scale])[0].verdict == found


def test_of_vibration_the_worst_unit_counts() -> None:
    check = Check("vibration", "warning", "It vibrates by 4 m/s^2.", 4.0)
    levels = [Assessment(f"IMU.{k}", "vibration_level", v, v) for k, v in ((0, "ok"), (1, "fault"), (2, "warning"))]  # type: ignore[arg-type]
    assert reconcile(TWO_COMPASSES, [check], levels)[0].verdict == "fault"
    assert reconcile(TWO_COMPASSES, [check], levels[:1])[0].verdict == "ok"


def test_rejections_keep_their_time_and_take_the_verdict_of_the_ratios() -> None:
    told = Check("rejected compass", "warning", "Rejected for 14 s.", 14.0, "s", t=65.0, t_end=80.0)
    ratio = Assessment("XKF4.SM", "innovations", "fault", "It rejects its compass for 31 s.", 0.4)
    assert reconcile(TWO_COMPASSES, [told], [ratio]) == [replace(told, verdict="fault")]
    (found,) = reconcile(TWO_COMPASSES, [replace(told, verdict="ok", t=None, t_end=None)], [ratio])
    assert (found.verdict, found.text) == ("fault", ratio.text)
    assert reconcile(TWO_COMPASSES, [replace(told, name="rejected height")], [ratio])[0].verdict == "warning", (
        "another aid"
    )


def test_other_compasses_and_imus_are_known_and_estimators_are_not_among_them() -> None:
    seen = [replace(BENT, sensor=name) for name in ("MAG:0", "MAG:1", "IMU:0", "IMU:1", "XKF4.SM", "IMU.1")]
    assert [a.sensor for a in unused_sensors(TWO_COMPASSES, seen)] == ["MAG:0", "IMU:1"]
