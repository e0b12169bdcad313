"""The onboard attitude against the gyro: coverage, scale, axes and signs; and the vehicle's trim."""

from __future__ import annotations

from itertools import permutations

import numpy as np
from numpy.typing import NDArray

from attlog import rotation
from attlog.flight.model import Array, Attitude, FlightLog, Imu
from attlog.health.model import Check, graded, not_judged
from attlog.segments import gaps, resets
from attlog.segments.increments import Turning
from attlog.segments.model import Segments

LEAST_DPS = 3.0
"""An axis that turns less than this (standard deviation) tells nothing about its scale."""
LEAST_INTERVALS = 30
SLOPE_RATE_HZ = 20.0
"""Slower attitudes smear fast motion: low slopes are then no fault of the sensor."""
LEAST_CORRELATION = 0.8


def checks(log: FlightLog, segments: Segments) -> list[Check]:
    """Coverage, gyro against attitude, trim."""
    if not log.imus:
        return []
    imu = log.imus[log.imu or 0]
    onboard = log.onboard_attitude
    if onboard is None or len(onboard.t) < 2:
        return [not_judged("coverage", "There is no onboard attitude in this log.", "good from 95 %")]
    return [coverage(imu, onboard, log.onboard or ""), turning(log, imu, onboard, segments), *trims(log, onboard)]


def coverage(imu: Imu, onboard: Attitude, name: str) -> Check:
    """The share of the inertial data that the onboard attitude covers; its pauses do not count."""
    share = round(100.0 * float(np.mean(onboard.covers(imu.gyro.t))), 1)
    verdict = "good" if share >= 95.0 else "warn" if share >= 50.0 else "bad"
    text = f"{name} at {onboard.rate:.1f} Hz covers {share:.1f} % of the inertial data."
    return Check("coverage", verdict, text, share, "%", "good from 95 %, bad below 50 %")


def turning(log: FlightLog, imu: Imu, onboard: Attitude, segments: Segments) -> Check:
    """Slopes of the attitude's rotation on the gyro's, and whether another order or sign of axes fits better."""
    limit = "good: slopes 0.95 to 1.05; bad: swapped or reversed axes, or slopes outside 0.8 to 1.25"
    name = log.onboard or ""
    jumps, _ = resets.known(log, name, segments) if imu is log.replay_imu else resets.find(onboard, imu)
    by_gyro, by_attitude = rotations(imu, onboard, jumps)
    if len(by_gyro) < LEAST_INTERVALS:
        return not_judged("gyro against attitude", f"{name} has too few intervals with inertial data.", limit)
    g, a = by_gyro - np.median(by_gyro, axis=0), by_attitude - np.median(by_attitude, axis=0)
    moving = np.degrees(g.std(axis=0)) >= LEAST_DPS
    if not moving.any():
        text = (
            f"The vehicle hardly turns: {', '.join(f'{s:.1f}' for s in np.degrees(g.std(axis=0)))} deg/s about x, y, z."
        )
        return not_judged("gyro against attitude", text, limit)
    wrong = other_axes(g, a, moving)
    if wrong:
        return Check("gyro against attitude", "bad", f"{imu.gyro.source} against {name}: {wrong}", wrong, "", limit)
    slopes = np.sum(g * a, axis=0) / np.sum(g * g, axis=0)
    shown = ", ".join(f"{axis} {s:.3f}" for axis, s, m in zip("xyz", slopes, moving, strict=True) if m)
    worst = float(np.abs(np.log(np.maximum(slopes[moving], 1e-3))).max())
    slow = onboard.rate < SLOPE_RATE_HZ
    verdict = graded(worst, np.log(1.055), np.log(1.25))
    text = f"{name} turns as the gyro does by {shown} (1 is equal)."
    if slow and verdict == "bad":
        verdict, text = "warn", text + f" At {onboard.rate:.0f} Hz the attitude smears fast motion."
    value = float(slopes[moving][np.argmax(np.abs(slopes[moving] - 1))])
    return Check("gyro against attitude", verdict, text, round(value, 4), "", limit)


def rotations(imu: Imu, onboard: Attitude, jumps: NDArray[np.int64]) -> tuple[Array, Array]:
    """Mean rates (n, 3) in rad/s of gyro and attitude over the attitude's intervals; no gaps, large turns or ``jumps``
    (indices of the samples after resets)."""
    t = onboard.t if onboard.t_sample is None else onboard.t_sample
    gyro_t, rate = gaps.rising(imu.gyro.t_best, imu.gyro.x)
    if len(gyro_t) < 3 or len(t) < 3:
        return np.zeros((0, 3)), np.zeros((0, 3))
    dt = np.diff(t)
    segment = gaps.number(gyro_t)
    at = segment[np.clip(np.searchsorted(gyro_t, t), 0, len(gyro_t) - 1)]
    good = (dt > 0) & (dt <= 1.0) & (t[:-1] >= gyro_t[0]) & (t[1:] <= gyro_t[-1]) & (at[1:] == at[:-1])
    around = np.unique(np.concatenate([jumps - 2, jumps - 1, jumps])) if len(jumps) else np.zeros(0, np.int64)
    good[around[(around >= 0) & (around < len(good))]] = False
    turned = rotation.to_rotvec(rotation.multiply(rotation.conjugate(onboard.q[:-1]), onboard.q[1:]))
    good &= np.sqrt(np.sum(turned**2, axis=1)) < 1.0
    gyro = Turning(gyro_t, rate, imu.gyro.sampling).between(t[:-1], t[1:])
    good &= np.isfinite(gyro).all(axis=1)
    return gyro[good] / dt[good, None], turned[good] / dt[good, None]


def other_axes(g: Array, a: Array, moving: np.ndarray) -> str:
    """Which axes seem swapped or reversed, empty if the identity fits."""
    size = np.sqrt(np.outer(np.sum(a * a, axis=0), np.sum(g * g, axis=0)))
    match = np.divide(a.T @ g, size, out=np.zeros((3, 3)), where=size > 0)
    axes = [k for k in range(3) if moving[k]]
    if max(abs(match[k]).max() for k in axes) < LEAST_CORRELATION:
        return ""
    best = max(permutations(range(3)), key=lambda p: sum(abs(match[p[k], k]) for k in axes))
    swapped = [k for k in axes if best[k] != k and abs(match[best[k], k]) > LEAST_CORRELATION > abs(match[k, k])]
    reversed_ = [k for k in axes if match[best[k], k] < -LEAST_CORRELATION]
    parts = []
    if swapped:
        parts.append("the gyro's " + ", ".join(f"{'xyz'[k]} is the attitude's {'xyz'[best[k]]}" for k in swapped))
    if reversed_:
        parts.append("reversed sign about " + ", ".join("xyz"[k] for k in reversed_))
    return "; ".join(parts) + ("." if parts else "")


def trims(log: FlightLog, onboard: Attitude) -> list[Check]:
    """The vehicle's trim: a constant difference between the IMU and what the attitude says."""
    if not onboard.has_trim:
        return []
    limit = "warn above 3 deg"
    vector = log.trim
    if vector is None:
        return [not_judged("trim", "The log holds no parameters of the trim.", limit)]
    roll, pitch = np.degrees(vector[:2])
    size = float(np.hypot(roll, pitch))
    text = f"The vehicle's trim turns roll by {roll:.2f} and pitch by {pitch:.2f} deg."
    return [Check("trim", "good" if size <= 3.0 else "warn", text, round(size, 3), "deg", limit)]
