"""A check and a question may ask the same of the sensor in use. Where the question was answered, its answer is both's.

Questions look at more: a heading without any compass, the total error, the firmware's own measure. Two numbers for one
thing, or an "ok" beside a warning, would only leave the reader to choose.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import replace

from attlog.flight.model import FlightLog
from attlog.health.assessments.model import Assessment
from attlog.health.model import Check

SAME: Mapping[str, str] = {
    "compass offset": "compass_offset",
    "field against motors": "compass_motors",
    "force offset": "accelerometer_offset",
    "gravity": "accelerometer_rest",
    "gyro bias": "gyro_bias",
    "vibration": "vibration_level",
}
"""The question that asks what a check asks, by the check's name; of ``rejected ...`` it is RATIOS, for each aid."""
OF_THE_VEHICLE = ("vibration_level",)
"""Questions whose worst sensor answers: every IMU feels the same propellers, and estimators run on each."""
SPOILS = ("gravity",)
"""Checks whose fault makes every comparison worthless: that is for them to say, a wrong scale does not."""
RATIOS = "innovations"
ORDER = ("ok", "warning", "fault")


def answers(log: FlightLog, checks: Iterable[Check], health: Iterable[Assessment]) -> dict[str, Assessment]:
    """The assessment that answers a check, by the check's name; none for what is unknown or of another sensor.

    A check whose value is a word, such as a sensor that stopped, stands for itself.
    """
    known = [a for a in health if a.verdict in ORDER]
    found: dict[str, Assessment] = {}
    for check in checks:
        if isinstance(check.value, str):
            continue
        same = [a for a in known if _is_same(log, check.name, a)]
        if same:
            found[check.name] = max(same, key=lambda a: ORDER.index(a.verdict))
    return found


def _is_same(log: FlightLog, name: str, assessment: Assessment) -> bool:
    if assessment.question == RATIOS:
        return any(t.source == assessment.sensor and name == f"rejected {t.aid}" for t in log.innovation_tests)
    if SAME.get(name) != assessment.question:
        return False
    return assessment.question in OF_THE_VEHICLE or assessment.sensor in _in_use(log)


def agreed(log: FlightLog, checks: Iterable[Check], health: Iterable[Assessment]) -> list[Check]:
    """The checks, each with the verdict, sentence and number of the question that asks the same, where it is known."""
    checks = list(checks)
    found = answers(log, checks, health)
    return [_answered(check, found[check.name]) if check.name in found else check for check in checks]


def _answered(check: Check, answer: Assessment) -> Check:
    if answer.question == RATIOS and "ok" not in (check.verdict, answer.verdict) and check.verdict in ORDER:
        return replace(check, verdict=answer.verdict)  # its own sentence tells when, and by how much
    verdict: str = answer.verdict
    if check.name in SPOILS and verdict == "fault":
        verdict = check.verdict if check.verdict in ORDER[1:] else "warning"
    same = check.verdict == verdict
    return Check(
        check.name,
        verdict,
        answer.text,
        answer.value,
        answer.unit,
        answer.threshold,
        check.t if answer.t is None and same else answer.t,
        check.count if same else 1,
        check.t_end if same else None,
        answer.question,
        list(answer.evidence),
        check.cause if same else "",
        answer.ci95,
        answer.n,
        answer.seconds,
    )


def of_other_sensors(log: FlightLog, health: Iterable[Assessment]) -> list[Assessment]:
    """The assessments of compasses and IMUs that are logged beside those in use: nothing flew by them."""
    sources = {mag.field.source for mag in log.mags}
    sources |= {source for imu in log.imus for source in (imu.gyro.source, imu.acc.source)}
    return [a for a in health if a.sensor in sources - _in_use(log)]


def _in_use(log: FlightLog) -> set[str]:
    """The sources of the compass and of the IMU that flew."""
    imu = log.imus[log.imu or 0] if log.imus else None
    used = {log.mags[log.mag].field.source} if log.mag is not None else set()
    return used | ({imu.gyro.source, imu.acc.source} if imu is not None else set())
