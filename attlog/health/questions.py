"""Which of the four questions a log can answer, and what would be needed for the others.

The metrics say it themselves (``metrics/evidence/possible.py``): what they find in the gyro alone
every filter can be judged by, what they refuse to it they refuse to every filter.
"""

from __future__ import annotations

from attlog.flight.model import FlightLog
from attlog.health.model import Answerable
from attlog.health.reason import as_sentence
from attlog.metrics.answerable.questions import ASKED, Availability, ask
from attlog.metrics.base import Case

STEPS = "Fly quick attitude steps of 15 deg and more in Stabilize."


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
    return Answerable(question, found.can, reason, "" if found.can else setting(question, found.codes, case))


def setting(question: str, codes: tuple[str, ...], case: Case) -> str:
    """What would log, or what to fly for, what a question lacks; empty where nothing is known or a fault is told."""
    log, reference = case.log, case.reference
    if question in ("noise", "yaw_drift"):
        return log.advice("rest")
    if reference.kind == "none":
        known = reference.fault or log.truth is not None or log.onboard is not None
        return "" if known else log.advice("attitude")
    if "reference_too_slow" in codes:
        return log.advice("attitude", reference.rate)
    return STEPS if question == "lag" and log.kind.hovers and {"no_events", "too_few_events"} & {*codes} else ""
