"""Findings of events with a cause: one entry, led by the first cause, with its effects."""

from __future__ import annotations

from dataclasses import replace

import pytest

from attlog.flight.model import Problem
from attlog.health.check import Check
from attlog.health.findings import Finding, findings
from attlog.story import causes
from attlog.story.flight_events import Event
from tests.health.made_flight import flight

LOST = Event("gnss_lost", 60.3, "warning", "GNSS had no fix for 30 s in flight, from 60.3 s.", 90.3)
FAILSAFE = Event("failsafe", 68.0, "warning", "EKF failsafe at 68.0 s.")
REPORT = Problem("ekf_failsafe", "error", "EKF failsafe: the EKF was given up (ERR 17/1).", 68.0, cause="Sensors.")


def found(events: list[Event], *problems: Problem) -> list[Finding]:
    """Findings of a flight with these events, linked, and the autopilot's reports."""
    log = flight(firmware="ArduPilot")
    log.problems = list(problems)
    return [f for f in findings(log, [], events=causes.link(log, events)) if f.is_trouble]


def test_an_effect_joins_the_entry_of_its_cause_which_names_it() -> None:
    (one,) = found([LOST, FAILSAFE])
    assert (one.kind, one.t) == ("gnss", 60.3)
    assert one.text == f"{LOST.text} Effect: EKF failsafe at 68.0 s."
    assert FAILSAFE.text not in one.evidence


def test_a_serious_report_of_the_effect_makes_the_entry_serious_and_drops_its_guesses() -> None:
    (one,) = found([LOST, FAILSAFE], REPORT)
    assert (one.kind, one.severity, one.cause) == ("gnss", "serious", "")
    assert one.text.startswith(LOST.text)


def test_without_evidence_both_stay_apart_in_time_order() -> None:
    late = replace(FAILSAFE, t=97.0, text="EKF failsafe at 97.0 s.")
    assert [f.kind for f in found([LOST, late])] == ["gnss", "failsafe"]


def test_a_crash_keeps_its_entry_and_gets_its_cause() -> None:
    fault = Event("motor_no_thrust", 97.0, "serious", "Motor 2 (rear left) gave no thrust from 97.0 s.", 97.5)
    crash = Event("overturn", 98.0, "serious", "Turned over at 98.0 s, to 120°.")
    one = next(f for f in found([fault, crash]) if f.kind == "crash")
    assert one.cause == fault.text


@pytest.mark.parametrize(("onset", "kinds"), [(50.0, ["vibration"]), (70.0, ["estimator", "vibration"])])
def test_a_wrong_vertical_force_explains_the_failsafe_that_follows_it(onset: float, kinds: list[str]) -> None:
    force = Check("vertical_force", "fault", "The mean vertical force is up to 3.1 m/s^2 off.", 3.1, "m/s^2", t=onset)
    log = flight(firmware="ArduPilot")
    log.problems = [REPORT]
    both = [f for f in findings(log, [force]) if f.is_trouble]
    assert sorted(f.kind for f in both) == kinds
    lead = next(f for f in both if f.kind == "vibration")
    assert ("Effect: EKF failsafe at 68.0 s." in lead.text) is (onset < 68.0)
