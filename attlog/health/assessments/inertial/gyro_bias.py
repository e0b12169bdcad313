"""What does each gyro read while nothing turns: at rest, in flight, how far that moves, and does it step?

Verdicts of the replayed unit are those of the checks ``gyro bias`` and ``gyro bias step``; what is added are intervals,
the bias in flight, and the other units.
"""

from __future__ import annotations

import numpy as np

from attlog.flight.model import Array, Imu
from attlog.health.assessments.inertial.biases import Bias, gyro_bias
from attlog.health.assessments.inertial.blocks import Blocks, in_air, listed, of_stream, still, usable
from attlog.health.assessments.inertial.gyro_scale import VERDICTS
from attlog.health.assessments.inertial.imu_instances import difference_in_flight
from attlog.health.assessments.model import Assessment, HealthCase, Verdict, unknown
from attlog.health.fits import turns
from attlog.health.model import Check, graded
from attlog.health.sensors.gyro import BIAS_DPS

QUESTION, STEP = "gyro_bias", "gyro_bias_step"
FLOOR_DPS = 0.01
"""One step of the gyro's numbers in old logs."""
LIMIT = f"ok up to {BIAS_DPS[0]:.0f} deg/s, fault above {BIAS_DPS[1]:.0f} deg/s; the same for its change"
SOURCE = "what estimators learn within seconds; the check of the gyro's bias"
NO_SETTING = "Gyro offsets are measured while the vehicle stands still, not in a log."
STAND = "Log 10 s standing still before take-off."


def answer(case: HealthCase) -> list[Assessment]:
    """One assessment for each gyro, one ``unknown`` where none can be judged; a step of the bias is another one."""
    units = usable(case)
    if not units:
        return []
    found = [one for imu in units if (one := _assessed(case, imu)) is not None]
    if not found:
        why = "The vehicle never stands still in this log, and no smoother estimates the bias in flight."
        found = [unknown(units[0].gyro.source, QUESTION, why, LIMIT, SOURCE)]
        found[0].action = STAND
    return found + _stepped(case)


def _assessed(case: HealthCase, imu: Imu) -> Assessment | None:
    """The bias of one unit at rest and in flight; None where neither is known."""
    if case.segments is None:
        return None
    spans, where = still(case.segments)
    rest, air = of_stream(imu.gyro, spans), _flown(case, imu)
    if rest is not None and 1.96 * float(np.degrees(rest.sigma(0.0).max())) > BIAS_DPS[0]:
        rest = None
    if rest is None and air is None:
        return None
    if rest is not None:
        mean, sigma = np.degrees(rest.middle), np.degrees(rest.sigma(np.radians(FLOOR_DPS)))
        n, seconds = rest.samples, rest.seconds
    else:
        assert air is not None
        mean, sigma, n, seconds, where = air.mean, air.sigma, air.n, air.seconds, "in flight"
    worst = int(np.argmax(np.abs(mean)))
    size, unsure = float(mean[worst]), float(sigma[worst])
    verdict = _verdict(case, imu, mean, _moved(rest, air))
    text = f"{imu.gyro.source} reads {listed(mean)} deg/s {where} (± {1.96 * float(sigma.max()):.2f}, 95 %)."
    evidence = []
    if rest is not None and air is not None:
        evidence = [f"In flight it reads {listed(air.mean)} deg/s by {air.by} (± {1.96 * air.sigma.max():.2f})."]
    off = verdict != "ok"
    return Assessment(
        imu.gyro.source,
        QUESTION,
        verdict,
        text,
        value=round(size, 3),
        unit="deg/s",
        ci95=(round(size - 1.96 * unsure, 3), round(size + 1.96 * unsure, 3)),
        vector=[round(float(v), 3) for v in mean],
        vector_ci95=[round(1.96 * float(v), 3) for v in sigma],
        n=n,
        seconds=round(seconds, 1),
        threshold=LIMIT,
        source=SOURCE,
        why_no_setting=NO_SETTING if off else "",
        action=case.log.remedies.get("gyro_bias", "") if off else "",
        evidence=evidence,
    )


def _flown(case: HealthCase, imu: Imu) -> Bias | None:
    """The bias in flight: the smoother's of the replayed unit, and what another one reads more."""
    found, replayed = gyro_bias(case), case.log.replay_imu
    if found is None or replayed is None or case.segments is None or not in_air(case.segments):
        return None
    if imu is replayed:
        return found if found.sure else None
    more = difference_in_flight(case, "gyro", replayed, imu)
    if more is None:
        return None
    sigma = np.hypot(found.sigma, np.degrees(more.sigma(0.0)))
    if not found.sure or 1.96 * float(sigma.max()) > BIAS_DPS[0]:
        return None
    return Bias(found.mean + np.degrees(more.middle), sigma, found.known, found.n, found.seconds, found.by)


def _moved(rest: Blocks | None, air: Bias | None) -> float:
    """By how much the bias surely changes from rest to flight about its worst axis, deg/s; 0 where one is unknown."""
    if rest is None or air is None:
        return 0.0
    change = np.abs(air.mean - np.degrees(rest.middle))
    unsure = np.hypot(air.sigma, np.degrees(rest.sigma(0.0)))
    return float(np.max(np.where(change > 4.0 * unsure, change, 0.0)))


def _verdict(case: HealthCase, imu: Imu, mean: Array, moved: float) -> Verdict:
    """The check's where there is one of this unit, else by the same limits; a change in flight counts as well."""
    check = _check(case, "gyro bias") if imu is case.log.replay_imu else None
    told = VERDICTS.get("" if check is None else check.verdict)
    by_size = graded(max(float(np.abs(mean).max()), moved), *BIAS_DPS)
    if told is None:
        return by_size
    return max(told, graded(moved, *BIAS_DPS), key=list(VERDICTS).index)


def _stepped(case: HealthCase) -> list[Assessment]:
    """The step of the replayed gyro's bias that the check found, with its time; nothing where it found none."""
    check, imu = _check(case, turns.STEP), case.log.replay_imu
    if check is None or imu is None or check.verdict not in ("warning", "fault"):
        return []
    found = Assessment(imu.gyro.source, STEP, VERDICTS[check.verdict], check.text, unit=check.unit, t=check.t)
    found.value = float(check.value) if isinstance(check.value, float | int) else None
    found.ci95, found.n, found.seconds = check.ci95, check.samples, check.seconds
    found.threshold, found.source = check.threshold, "steps that a sound gyro does not make"
    found.why_no_setting, found.action = NO_SETTING, case.log.remedies.get("bus", "")
    return [found]


def _check(case: HealthCase, name: str) -> Check | None:
    return next((c for c in case.checks if c.name == name), None)
