"""Actions of findings: what checks offer to set wins over the usual remedy; sensors not in use offer nothing."""

from __future__ import annotations

from dataclasses import replace

import pytest

import attlog
from attlog.health.check import Check, Setting
from attlog.health.findings import Finding, findings
from tests.conftest import SAMPLES
from tests.health.made import OFFSET, REFUSED, SILENT, SOUND

LOG = attlog.read(SAMPLES / "px4_hover.ulg")
FIELD = Check("field", "warning", "The field varies by 40 %.", value=40.0)
SET = "Set COMPASS_OFS_X 145, COMPASS_OFS_Y -20.25."


def of(kind: str, *checks: Check) -> list[Finding]:
    return [finding for finding in findings(LOG, checks) if finding.kind == kind]


def test_a_finding_takes_what_to_set_and_keeps_its_sentence() -> None:
    (before,), (after,) = of("compass", FIELD), of("compass", FIELD, OFFSET)
    assert before.action not in ("", SET)
    assert (after.text, after.severity, after.action) == (before.text, before.severity, SET)
    assert OFFSET.text in after.evidence


def test_a_note_of_the_same_kind_gives_way() -> None:
    (found,) = of("compass", Check("declination", "warning", "It differs by 2 deg."), OFFSET)
    assert (found.severity, found.text, found.value, found.action) == ("warning", OFFSET.text, OFFSET.value, SET)
    assert "It differs by 2 deg." in found.evidence


def test_what_is_ok_or_unknown_offers_no_action() -> None:
    quiet = [replace(check, settings=[Setting("A", 1.0, 2.0)]) for check in (SOUND, SILENT)]
    assert of("compass", FIELD, *quiet) == of("compass", FIELD)


def test_a_disputed_value_is_no_action() -> None:
    other = replace(REFUSED, settings=[Setting("COMPASS_OFS_X", -12.0, 99.0)])
    (found,) = of("compass", FIELD, OFFSET, other)
    assert found.action == LOG.remedy("interference")


def test_a_check_that_names_its_parameters_is_quoted() -> None:
    words = "A suggestion: COMPASS_OFS_X 145 and COMPASS_OFS_Y -20.25."
    assert of("compass", FIELD, replace(OFFSET, action=words))[0].action == words
    assert of("compass", FIELD, replace(OFFSET, action="Reboot."))[0].action == SET


def test_what_a_check_of_the_compass_advises_wins_with_its_cause() -> None:
    """A calibration mends no field of motors."""
    (before,), (found,) = of("compass", FIELD), of("compass", FIELD, replace(REFUSED, action="Move it."))
    assert "not calibrated" in before.cause
    assert "Currents of motors" in found.cause
    assert found.action == "Move it."


def test_of_other_sensors_the_usual_remedy_stays() -> None:
    shaken = Check("vibration_level", "warning", "It vibrates.", 4.0)
    (before,), (after,) = of("vibration", shaken), of("vibration", shaken, replace(shaken, action="X."))
    assert after.action == before.action == LOG.remedy("vibration")


def test_motors_that_turn_no_heading_are_no_cause() -> None:
    heading = Check("heading_by_gnss", "warning", "The heading is 15 deg off.", 15.0, "deg", t=3.0)
    (found,) = of("compass", heading, REFUSED)
    assert "motors" not in found.cause + found.action
    assert REFUSED.text in found.evidence
    assert found.action == LOG.remedy("compass")


def test_a_sensor_that_is_not_in_use_is_a_note_and_no_evidence_against_the_one_that_is() -> None:
    spare = replace(OFFSET, in_use=False)
    (alone,) = of("compass", spare)
    assert (alone.severity, alone.action) == ("note", SET)
    (found,) = of("compass", FIELD, spare)
    assert (found.severity, found.text, found.evidence) == ("warning", FIELD.text, [])
    assert found.action != SET


@pytest.mark.parametrize("kind", ["", "gyro_bias"])
def test_a_check_may_name_another_kind(kind: str) -> None:
    apart = Check("imu_instances", "warning", "They differ.", kind=kind)
    assert [f.kind for f in findings(LOG, [apart])] == [kind or "accelerometer"]
