"""Findings and the assessments of sensors: one entry for a cause, one action, and none for what is unknown."""

from __future__ import annotations

from dataclasses import replace

import pytest

import attlog
from attlog.health.assessments import Assessment, Setting
from attlog.health.findings import Finding, actions, findings
from attlog.health.model import Check
from tests.conftest import SAMPLES
from tests.health.assessments.made import OFFSET, REFUSED, SILENT, SOUND

LOG = attlog.read(SAMPLES / "px4_hover.ulg")
CHECK = Check("field", "warning", "The field varies by 40 %.", value=40.0)
SET = "Set COMPASS_OFS_X 145, COMPASS_OFS_Y -20.25."


def of(kind: str, checks: list[Check], *health: Assessment) -> list[Finding]:
    return [finding for finding in findings(LOG, checks, health=health) if finding.kind == kind]


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
    assert findings(LOG, [CHECK], health=quiet) == findings(LOG, [CHECK])


def test_a_disputed_value_is_no_action() -> None:
    other = replace(REFUSED, settings=[Setting("COMPASS_OFS_X", -12.0, 99.0)])
    (before,), (found,) = of("compass", [CHECK]), of("compass", [CHECK], OFFSET, other)
    assert found.action == before.action


def test_a_question_that_nobody_knows_makes_no_finding() -> None:
    assert findings(LOG, [], health=[replace(OFFSET, question="not_known")]) == findings(LOG, [])


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
    return replace(assessment, sensor=LOG.mags[LOG.mag or 0].field.source)


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
    assert found.action == LOG.remedies["compass"]


def test_a_check_that_a_question_clears_is_no_finding() -> None:
    check = Check("vibration", "warning", "It vibrates.", 4.0)
    assert of("vibration", [check])
    assert of("vibration", [check], SOUND) == []


def test_a_unit_that_is_not_in_use_is_a_note_and_sets_nothing_for_the_one_that_is() -> None:
    log = replace(LOG, mags=[*LOG.mags, replace(LOG.mags[0], field=replace(LOG.mags[0].field, source="spare"))])
    spare = replace(OFFSET, sensor="spare")
    (alone,) = [f for f in findings(log, [], health=[spare]) if f.kind == "compass"]
    assert (alone.severity, alone.action) == ("note", SET)
    (found,) = [f for f in findings(log, [CHECK], health=[spare]) if f.kind == "compass"]
    assert (found.severity, found.text) == ("warning", CHECK.text)
    assert found.action != SET


def test_gyros_that_differ_are_no_accelerometer() -> None:
    apart = Assessment("IMU.9", "imu_instances", "warning", "They differ by 2 deg/s.", value=2.0, unit="deg/s")
    assert [f.kind for f in findings(LOG, [], health=[apart])] == ["gyro_bias"]
    assert [f.kind for f in findings(LOG, [], health=[replace(apart, unit="m/s^2")])] == ["accelerometer"]


def test_only_one_source_says_which_compass_to_use(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(actions, "other_compass", lambda log: "Use the other.")
    best = in_use(Assessment("", "compass_choice", "ok", "The one in use errs least."))
    (alone,), (told,) = of("compass", [CHECK]), of("compass", [CHECK], best)
    assert alone.action == "Use the other."
    assert told.action not in ("", "Use the other.")


def test_what_is_wrong_with_a_spare_compass_is_no_evidence_against_the_one_in_use() -> None:
    log = replace(LOG, mags=[*LOG.mags, replace(LOG.mags[0], field=replace(LOG.mags[0].field, source="spare"))])
    (found,) = [f for f in findings(log, [CHECK], health=[replace(OFFSET, sensor="spare")]) if f.kind == "compass"]
    assert OFFSET.text not in found.evidence
