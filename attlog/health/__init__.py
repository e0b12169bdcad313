"""Which of the four questions a log can answer, and what would be needed for the others.

The metrics say it themselves (``metrics/evidence/possible.py``): what they find in the gyro alone
every filter can be judged by, what they refuse to it they refuse to every filter.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import partial

from attlog.core.errors import guarded
from attlog.flight.model import FlightLog, guarded_part
from attlog.health import (
    accelerometer,
    attitude,
    compass,
    compass_fit,
    delays,
    gnss,
    gravity,
    gyro,
    imu,
    innovations,
    sources,
    timing,
    vibration,
)
from attlog.health import compass as declination_told
from attlog.health.check import Answerable, Check, as_sentence, failed_check
from attlog.metrics.answerable import ASKED, Availability, ask
from attlog.metrics.metric import Case
from attlog.reference import choose
from attlog.reference.model import Reference
from attlog.segments.model import Segments

__all__ = ["Answerable", "Check", "answerable", "audit"]


FLY_STEPS = "Fly quick attitude steps of 15 deg and more in Stabilize."


def answerable(log: FlightLog, case: Case | None) -> list[Answerable]:
    """The four questions in the order of the report, each with a reason and the setting that is missing.

    ``case``: the log made ready, None where there is no usable IMU.
    """
    if case is None or log.replay_imu is None:
        reason = next((p.text for p in log.problems if p.severity == "error"), "There is no usable IMU in this log.")
        setting = "" if log.imus else log.advice("imu")
        return [Answerable(q, False, reason, "" if setting in reason else setting) for q in ASKED]
    if fault := case.reference.gyro_fault:
        return [Answerable(q, False, as_sentence(fault)) for q in ASKED]
    return [_answerable(q, ask(case, q), case) for q in ASKED]


def _answerable(question: str, found: Availability, case: Case) -> Answerable:
    reason = as_sentence("; ".join(found.found or found.why))
    return Answerable(question, found.can, reason, "" if found.can else missing_setting(question, found.codes, case))


def missing_setting(question: str, codes: tuple[str, ...], case: Case) -> str:
    """What would log, or what to fly for, what a question lacks; empty where nothing is known or a fault is told."""
    log, reference = case.log, case.reference
    if question in ("noise", "yaw_drift"):
        return log.advice("rest")
    if reference.kind == "none":
        known = reference.fault or log.truth is not None or log.onboard is not None
        return "" if known else log.advice("attitude")
    if "reference_too_slow" in codes:
        return log.advice("attitude", reference.rate)
    return FLY_STEPS if question == "lag" and log.kind.hovers and {"no_events", "too_few_events"} & {*codes} else ""


# Does physics agree with what the log says, and what can this log answer?

BEFORE_CHECK = "heading by GNSS"
"""The onboard attitude stands before this check and is judged when all sensors are."""


def audit(log: FlightLog, segments: Segments | None, reference: Reference | None = None) -> list[Check]:
    """Every check of the log in a fixed order; ``segments`` None where there is no usable IMU.

    ``reference`` judges the onboard attitude, and the delay is measured against it; where it is not given, or is
    a smoother, made of the very gyro whose delay is asked for, truth or the onboard attitude is taken for that.
    """
    phases = segments or Segments()
    rates = reference
    if (reference is None or reference.kind == "smoother") and segments is not None and log.imu is not None:
        rates = guarded_part(log, "The reference", lambda: choose(log, phases, heading=False), lambda: reference)
    every: dict[str, Callable[[], list[Check]]] = {
        "gaps and rate": lambda: timing.timing_checks(log, phases),
        "delay": lambda: delays.imu_delay_checks(log, rates),
        "gyro": lambda: imu.gyro_checks(log, phases),
        "frozen sensors": lambda: timing.frozen_checks(log, phases),
        "sensor faults": lambda: timing.sensor_fault_checks(rates),
        "heading by GNSS": lambda: attitude.gnss_heading_checks(log, phases),
        "turns": lambda: gyro.turn_checks(log, phases, rates, reference),
        "force": lambda: accelerometer.force_checks(log, phases, reference or rates),
        "compass error": lambda: compass_fit.compass_error_checks(log, phases, _heading_reference(reference, rates)),
        "gravity": lambda: gravity.gravity_checks(log, phases),
        "accelerometer bias": lambda: gravity.onboard_acc_bias_check(log, phases),
        "vibration": lambda: vibration.vibration_checks(log, phases),
        "gravity direction": lambda: attitude.attitude_checks(log, phases, "" if rates is None else rates.gyro_fault),
        "attitude jumps": lambda: attitude.jump_checks(log, phases, reference),
        "second source": lambda: sources.source_checks(log, phases, reference),
        "field": lambda: compass.field_checks(log, phases),
        "aids": lambda: innovations.aid_checks(log, phases),
        "declination set": lambda: declination_told.declination_checks(log),
        "field against motors": lambda: compass_fit.interference_checks(log, phases),
        "GNSS": lambda: gnss.gnss_checks(log, phases),
        "crash": lambda: attitude.crash_checks(log, phases) if log.imus else [],
    }
    found = {name: guarded(f"The check {name}", make, partial(failed_check, name)) for name, make in every.items()}
    sensors = [check for made in found.values() for check in made]
    name = attitude.AGAINST_SMOOTHER
    accused = guarded(
        f"The check {name}",
        lambda: attitude.smoother_checks(log, phases, reference, sensors),
        partial(failed_check, name),
    )
    return [check for room, made in found.items() for check in [*(accused if room == BEFORE_CHECK else []), *made]]


def _heading_reference(reference: Reference | None, otherwise: Reference | None) -> Reference | None:
    """Whose heading may judge the compass: truth's or a smoother's own, else the onboard attitude's if it is right."""
    judge = reference if reference is not None and reference.heading_by == "own" else otherwise
    return judge if judge is None or judge.heading_by == "own" else None
