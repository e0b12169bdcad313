"""How late is the compass, and does the onboard estimator know it? And how late are the inertial samples?"""

from __future__ import annotations

import math

import numpy as np

from attlog.base import rotation
from attlog.flight.aiding import delays as aiding
from attlog.flight.aiding.delays import DelayParameter
from attlog.health.assessments.model import Assessment, HealthCase, Setting, unknown
from attlog.health.assessments.onboard import in_flight
from attlog.health.fits import delays
from attlog.health.fits.delays import DelayFit
from attlog.health.sensors import delay as imu_delays
from attlog.reference import declination
from attlog.segments.spans import inside

QUESTION = "magnetometer_delay"
OFF_MS, SIGMAS, FLOOR_MS, SURE_MS = 20.0, 3.0, 5.0, 15.0
"""Told beyond both; the floor is the scatter over 24 simulated flights (44 to 53, and -2 to 2 ms)."""
LEAST_UT_S, LEAST_S = 1.5, 20.0
"""The field must change so fast (RMS), for so long."""
APART_MS = 25.0
ROUND_MS = 5.0
LIMIT = f"ok within {OFF_MS:.0f} ms or {SIGMAS:.0f} sigma of what is set"
SOURCE = "24 simulated flights"


def assessments(case: HealthCase) -> list[Assessment]:
    """The delay of the compass that is replayed; nothing without one, or where nothing flew."""
    log = case.log
    model = None if log.mag is None else declination.model(log)
    flown = in_flight.flown(case)
    if log.mag is None or model is None or not flown:
        return []
    field = log.mags[log.mag].field
    path = None if log.replay_imu is None else in_flight.attitude_path(case)
    if path is None:
        return [unknown(field.source, QUESTION, in_flight.no_path(case), LIMIT, SOURCE)]
    use = inside(field.t_best, flown) & rotation.finite(field.x)
    found = delays.compass(field.t_best[use], 1e6 * field.x[use], 1e6 * np.array(model.ned_t), path)
    why = _doubt(found)
    if found is None or why:
        return [unknown(field.source, QUESTION, why, LIMIT, SOURCE)]
    told = _told(field.source, found, aiding.of_compass(log, flown[0][0]))
    told.n, told.seconds = found.n, round(found.seconds, 1)
    told.evidence = [f"Found by {path.name} in {found.seconds:.0f} s of flight."]
    return [told]


def _told(source: str, found: DelayFit, parameter: DelayParameter | str) -> Assessment:
    late, sigma = 1e3 * found.delay, math.hypot(1.5e3 * found.sigma, FLOOR_MS)
    text = f"{source} is {late:.0f} ms late ({late - 1.96 * sigma:.0f} to {late + 1.96 * sigma:.0f}, 95 %)"
    told = Assessment(source, QUESTION, "ok", f"{text}.", threshold=LIMIT, source=SOURCE)
    told.value, told.unit = round(late, 1), "ms"
    told.ci95 = (round(late - 1.96 * sigma, 1), round(late + 1.96 * sigma, 1))
    if isinstance(parameter, str):
        told.verdict, told.why_no_setting = "unknown", parameter
        return told
    told.text = f"{text}; {parameter.words}."
    if max(parameter.low - late, late - parameter.high) <= max(OFF_MS, SIGMAS * sigma):
        return told
    told.verdict, new = "warning", ROUND_MS * round(late / ROUND_MS)
    if not 0.0 < new <= parameter.most:
        told.why_no_setting = "No parameter holds this delay of a compass."
        return told
    told.settings = [Setting(parameter.name, parameter.old, new, "ms")]
    told.action = f"Set {parameter.name} to {new:.0f} ms, reboot, and compare test ratios of the next flight."
    return told


def _doubt(found: DelayFit | None) -> str:
    """Why a fit is not believed; empty where it is."""
    if found is None:
        return "Too few samples of the compass in flight fit the attitude to find their delay."
    if found.seconds < LEAST_S or found.moving < LEAST_UT_S:
        return f"The field changes by {found.moving:.1f} uT/s in {found.seconds:.0f} s; turn more to show its delay."
    one, two = (1e3 * x for x in found.halves)
    if 1.5e3 * found.sigma > SURE_MS or not abs(one - two) <= max(APART_MS, 8.5e3 * found.sigma):
        return f"The delay of the compass is known to {1.5e3 * found.sigma:.0f} ms only; its field may be disturbed."
    return ""


def of_imu(case: HealthCase) -> list[Assessment]:
    """What the audit found of the delay of the inertial samples."""
    imu = case.log.replay_imu
    found = next((check for check in case.checks if check.name == imu_delays.UNEXPLAINED), None)
    if imu is None or found is None:
        return []
    verdict = found.verdict if found.verdict in ("ok", "warning", "fault") else "unknown"
    told = unknown(imu.gyro.source, "imu_delay", found.text, found.threshold)
    told.verdict = verdict  # type: ignore[assignment]
    if isinstance(found.value, int | float):
        told.value, told.unit = float(found.value), "ms"
    if verdict in ("warning", "fault"):
        told.why_no_setting = "No parameter moves the inertial samples: look at their filter and at the logger."
    return [told]
