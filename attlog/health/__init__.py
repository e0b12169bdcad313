"""Health of sensors and onboard estimator: checks with verdicts, findings, and which questions a log can answer."""

from __future__ import annotations

from dataclasses import dataclass

from attlog.flight.model import FlightLog
from attlog.health.check import Check, HealthCase, MotionAttitude, Setting, agreed_settings, as_sentence
from attlog.health.findings import Finding, OpenQuestion, contradiction, nothing_wrong
from attlog.health.gyro import unusable_gyro
from attlog.health.registry import CHECKS, run_checks
from attlog.metrics.answerable import ASKED, Availability, ask
from attlog.metrics.metric import Case

__all__ = [
    "CHECKS",
    "Answerable",
    "Check",
    "Finding",
    "HealthCase",
    "MotionAttitude",
    "OpenQuestion",
    "Setting",
    "agreed_settings",
    "answerable",
    "contradiction",
    "nothing_wrong",
    "run_checks",
    "unusable_gyro",
]


FLY_STEPS = "Fly quick attitude steps of 15 deg and more in Stabilize."


@dataclass(frozen=True, slots=True)
class Answerable:
    """Availability of one of the four questions (accuracy, noise, lag, yaw_drift) in a log.

    ``reason``: a sentence with numbers; ``setting``: firmware setting that logs the missing data.
    """

    question: str
    can: bool
    reason: str
    setting: str = ""


def answerable(log: FlightLog, case: Case | None) -> list[Answerable]:
    """Return the four questions in the order of the report; ``case``: None where there is no usable IMU."""
    if case is None or log.replay_imu is None:
        reason = next((p.text for p in log.problems if p.severity == "error"), "There is no usable IMU in this log.")
        setting = "" if log.imus else log.advice("imu")
        return [Answerable(q, False, reason, "" if setting in reason else setting) for q in ASKED]
    if fault := case.reference.faults.gyro:
        return [Answerable(q, False, as_sentence(fault)) for q in ASKED]
    return [_answerable(q, ask(case, q), case) for q in ASKED]


def _answerable(question: str, found: Availability, case: Case) -> Answerable:
    reason = as_sentence("; ".join(found.found or found.why))
    return Answerable(question, found.can, reason, "" if found.can else missing_setting(question, found.codes, case))


def missing_setting(question: str, codes: tuple[str, ...], case: Case) -> str:
    """Return what to log or fly to answer a question; empty if unknown or a fault is reported."""
    log, reference = case.log, case.reference
    if question in ("noise", "yaw_drift"):
        return log.advice("rest")
    if reference.kind == "none":
        known = reference.faults.reference or log.truth is not None or log.onboard is not None
        return "" if known else log.advice("attitude")
    if "reference_too_slow" in codes:
        return log.advice("attitude", reference.rate)
    return FLY_STEPS if question == "lag" and log.kind.hovers and {"no_events", "too_few_events"} & {*codes} else ""
