"""What is wrong with the recording alone: it costs detail, and nothing went wrong in the flight."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

from attlog.flight.model import FlightLog
from attlog.health.findings.finding import Finding
from attlog.health.findings.sensors import RATE
from attlog.health.model import Check

KINDS = frozenset(
    """calibration_applied calibration_not_applied coverage cut_at_end damage damaged_reports delay duplicate_times
    estimator_failed estimator_not_compiled estimator_timed_out false_times gaps gaps_and_rate imu_covers_a_part
    imu_decimated imu_delay imu_that_flew_too_slow jitter late_field log_limit not_checked params_differ
    params_unknown rate rate_impossible several_boots several_systems time_backward truth_packet_times unanswered
    unreadable_message unset_times values_out_of_range""".split()
)
"""Kinds of findings that are of the record or of filters."""
OF_THE_IMU = ("gravity", "gravity in flight", "gravity direction", "rate", "gaps", "jitter", "delay", "vibration")
"""Checks of inertial data, which say nothing where most of them were refused."""
MINOR = ("duplicate_times", "time_backward", "unset_times", "imu_decimated", "no_mag", "mag_disabled")
"""What is not in the log, or left out, without harm."""
REFUSED = "imu_mostly_refused"
FEW = 10
"""Values left out, of thousands."""


def nothing_wrong(findings: Sequence[Finding]) -> bool:
    """Whether no finding about the flight is a warning."""
    return not any(finding.is_trouble and finding.kind not in KINDS for finding in findings)


def of_what_was_measured(checks: list[Check], log: FlightLog) -> list[Check]:
    """The checks but for those of inertial data of which most were refused: what is left is chance."""
    refused = any(problem.code == REFUSED for problem in log.problems)
    return [check for check in checks if check.name not in OF_THE_IMU] if refused else checks


def settled(signs: Sequence[Finding]) -> list[Finding]:
    """The signs, those that cost the reader and change nothing as notes."""
    refused = any(sign.kind == REFUSED for sign in signs)
    return [_noted(sign, refused) if sign.is_trouble else sign for sign in signs]


def _noted(sign: Finding, refused: bool) -> Finding:
    """A slow but usable IMU, records left out here and there, one parameter's value as notes; an IMU that is too slow
    for filters is no fault of a flight. ``refused``: most values, which says it all."""
    if sign.kind == RATE:
        return replace(sign, severity="warning" if sign.severity == "serious" else "note")
    minor = sign.kind in MINOR or (sign.kind == "values_out_of_range" and (refused or sign.count < FEW))
    return replace(sign, severity="note") if minor else sign
