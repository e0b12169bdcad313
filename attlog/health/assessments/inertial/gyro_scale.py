"""Does the gyro turn as far as the vehicle does? The check of its scale as an assessment, with its interval."""

from __future__ import annotations

from attlog.health.assessments.inertial.blocks import usable
from attlog.health.assessments.model import Assessment, HealthCase, Verdict
from attlog.health.fits import turns
from attlog.health.model import Check

QUESTION = "gyro_scale"
SOURCE = "slopes of sound flights are 0.99 to 1.01"
TURN = "Fly turns of 90 deg and quick steps of 15 deg about all axes."
VERDICTS: dict[str, Verdict] = {"ok": "ok", "warning": "warning", "fault": "fault"}
NO_SETTING = "No parameter scales a gyro."


def answer(case: HealthCase) -> list[Assessment]:
    """Of the replayed gyro; ``unknown`` where the flight turns too little or no attitude can judge it."""
    imu = case.log.replay_imu
    if imu is None or imu not in usable(case):
        return []
    check = next((c for c in case.checks if c.name == turns.SCALE), None)
    if check is None:
        why = "The vehicle does not fly in this log, so nothing shows how far it turns."
        check = Check(turns.SCALE, "unknown", why, threshold=turns.LIMIT)
    verdict = VERDICTS.get(check.verdict, "unknown")
    found = Assessment(imu.gyro.source, QUESTION, verdict, check.text, threshold=check.threshold, source=SOURCE)
    if isinstance(check.value, float | int) and verdict != "unknown":
        found.value, found.unit, found.ci95 = float(check.value), check.unit, check.ci95
        found.n, found.seconds = check.samples, check.seconds
    if verdict == "unknown":
        found.action = TURN
    elif verdict != "ok":
        found.why_no_setting, found.action = NO_SETTING, case.log.remedies.get("gyro_scale", "")
    return [found]
