"""Findings and the assessments of sensors: one entry for a cause, one action, and none for what is unknown."""

from __future__ import annotations

from dataclasses import replace

import attlog
from attlog.health.assessments import Assessment, Setting
from attlog.health.findings import Finding, findings
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
