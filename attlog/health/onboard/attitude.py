"""The onboard attitude against the gyro: coverage, scale, axes and signs; and the vehicle's trim."""

from __future__ import annotations

import numpy as np

from attlog.flight.model import Attitude, FlightLog, Imu
from attlog.health.model import Check, graded, not_judged
from attlog.health.reason import as_sentence
from attlog.reference.physics.turning import (
    LEAST_DPS,
    LEAST_HZ,
    LEAST_INTERVALS,
    centred,
    other_axes,
    reversed_slowly,
    rotations,
)
from attlog.segments import resets
from attlog.segments.model import Segments

CONTRADICTED = "contradicted"
"""The value of the check where the gyro is not the one that turned: nothing that is made of it can be judged."""


def checks(log: FlightLog, segments: Segments, gyro_fault: str = "") -> list[Check]:
    """Coverage, gyro against attitude, trim. ``gyro_fault``: what ``reference.turning`` found, empty for nothing."""
    if not log.imus:
        return []
    imu = log.imus[log.imu or 0]
    onboard = log.onboard_attitude
    if onboard is None or len(onboard.t) < 2:
        return [not_judged("coverage", "There is no onboard attitude in this log.", "ok from 95 %")]
    against = against_attitude(log, imu, onboard, segments)
    if gyro_fault:
        against = Check("gyro against attitude", "fault", as_sentence(gyro_fault), CONTRADICTED, "", against.threshold)
    return [coverage(imu, onboard, log.onboard or ""), against, *trims(log, onboard)]


def coverage(imu: Imu, onboard: Attitude, name: str) -> Check:
    """The share of the inertial data that the onboard attitude covers; its pauses do not count."""
    share = round(100.0 * float(np.mean(onboard.covers(imu.gyro.t))), 1)
    verdict = "ok" if share >= 95.0 else "warning" if share >= 50.0 else "fault"
    text = f"{name} at {onboard.rate:.1f} Hz covers {share:.1f} % of the inertial data."
    return Check("coverage", verdict, text, share, "%", "ok from 95 %, fault below 50 %")


def against_attitude(log: FlightLog, imu: Imu, onboard: Attitude, segments: Segments) -> Check:
    """Slopes of the attitude's rotation on the gyro's, and whether another order or sign of axes fits better."""
    limit = "ok: slopes 0.95 to 1.05; fault: swapped or reversed axes, or slopes outside 0.8 to 1.25"
    name = log.onboard or ""
    jumps, _ = resets.known(log, name, segments) if imu is log.replay_imu else resets.find(onboard, imu)
    by_gyro, by_attitude = rotations(imu, onboard, jumps)
    if imu.gyro.rate < LEAST_HZ:
        return not_judged("gyro against attitude", f"At {imu.gyro.rate:.0f} Hz {imu.gyro.source} misses turns.", limit)
    if len(by_gyro) < LEAST_INTERVALS:
        return not_judged("gyro against attitude", f"{name} has too few intervals with inertial data.", limit)
    g, a = centred(by_gyro), centred(by_attitude)
    moving = np.degrees(g.std(axis=0)) >= LEAST_DPS
    slowly = reversed_slowly(g, a, moving)
    if not moving.any() and not slowly:
        text = (
            f"The vehicle hardly turns: {', '.join(f'{s:.1f}' for s in np.degrees(g.std(axis=0)))} deg/s about x, y, z."
        )
        return not_judged("gyro against attitude", text, limit)
    wrong = (other_axes(g, a, moving) if moving.any() else "") or slowly
    if wrong:
        return Check("gyro against attitude", "fault", f"{imu.gyro.source} against {name}: {wrong}", wrong, "", limit)
    slopes = np.sum(g * a, axis=0) / np.sum(g * g, axis=0)
    shown = ", ".join(f"{axis} {s:.3f}" for axis, s, m in zip("xyz", slopes, moving, strict=True) if m)
    worst = float(np.abs(np.log(np.maximum(slopes[moving], 1e-3))).max())
    slow = onboard.rate < LEAST_HZ
    verdict = graded(worst, np.log(1.055), np.log(1.25))
    text = f"{name} turns as the gyro does by {shown} (1 is equal)."
    if slow and verdict == "fault":
        verdict, text = "warning", text + f" At {onboard.rate:.0f} Hz the attitude smears fast motion."
    value = float(slopes[moving][np.argmax(np.abs(slopes[moving] - 1))])
    return Check("gyro against attitude", verdict, text, round(value, 4), "", limit)


def trims(log: FlightLog, onboard: Attitude) -> list[Check]:
    """The vehicle's trim: a constant difference between the IMU and what the attitude says."""
    if not onboard.has_trim:
        return []
    limit = "warning above 3 deg"
    vector = log.trim
    if vector is None:
        return [not_judged("trim", "The log holds no parameters of the trim.", limit)]
    roll, pitch = np.degrees(vector[:2])
    size = float(np.hypot(roll, pitch))
    text = f"The vehicle's trim turns roll by {roll:.2f} and pitch by {pitch:.2f} deg."
    return [Check("trim", "ok" if size <= 3.0 else "warning", text, round(size, 3), "deg", limit)]
