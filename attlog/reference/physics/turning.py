"""Is the logged gyro the one that turned? The onboard attitude and the earth's field turn as the vehicle does.

Every replay, the smoother's too, is made of the logged gyro. One in other units, with other
axes, clipped or on another clock makes attitudes that are wrong and sure of themselves, which
would then judge the onboard attitude. So before anything is made of the gyro, its turns are
held against those of the onboard attitude (or truth); where they contradict each other, the
direction of the magnetic field tells which of the two is right.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from itertools import permutations
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from attlog.base import rotation
from attlog.flight.model import Array, Attitude, Imu, Mag
from attlog.reference.compare import interpolate
from attlog.segments import gaps, increments

LEAST_DPS = 3.0
"""An axis that turns less than this (standard deviation) tells nothing about its scale."""
LEAST_SIGN_DPS = 0.5
"""About its sign it does down to here, where what goes with it is the same turn the other way (yaw in a hover)."""
LEAST_INTERVALS = 30
SPAN_S = 0.06
"""Turns are compared over so long at least: in single samples a gyro's noise and vibration look like turns that the
attitude did not make, and lower the slope (0.92 on a flight whose scales are equal)."""
LEAST_HZ = 20.0
"""Slower attitudes smear fast motion: low slopes alone are then no fault of the sensor."""
LEAST_CORRELATION = 0.8
SLOPES, FAR_SLOPES = (0.8, 1.25), (0.6, 1.6)
"""Of the attitude's rotation on the gyro's; outside one of them is in another unit; the second: surely so."""
BLIND = 1.0 / 3.0
"""A gyro that shows less than this of an attitude's turns does not see them, or the attitude makes them up."""
MOUNTED_DEG = 45.0
STEP_S = 0.3
"""The field is followed over so long: slow enough for its noise and delay, fast enough for one turn."""
CLEARLY = 3.0
"""What is right leaves so many times less of the field's change (squared) unexplained."""
LEAST_FIELD_DEG = 1.5
"""Less unexplained change of the field's direction (RMS) is its noise."""


@dataclass(frozen=True, slots=True)
class TurningFault:
    """Which of the two is wrong (``of``: gyro, attitude, empty for none), and the sentence why."""

    of: Literal["gyro", "attitude", ""] = ""
    why: str = ""


def contradiction(imu: Imu, attitude: Attitude, jumps: NDArray[np.int64], mag: Mag | None) -> TurningFault:
    """Whether gyro and attitude turn differently, and which of them may then not be used.

    ``jumps`` (k,) are indices of the attitude's samples after resets. The magnetic field tells who is right.
    Where it does not, the gyro is out if the attitude moves as it does in another scale, axis or sign:
    nothing tells then which is right, and all that is replayed is made of the gyro.
    """
    if len(attitude.t) < 3:
        return TurningFault()
    by_gyro, by_attitude = rotations(imu, attitude, jumps)
    wrong = otherwise(by_gyro, by_attitude)
    if not wrong:
        return TurningFault()
    said = f"the logged gyro ({imu.gyro.source}) and {attitude.source} turn differently: {wrong}"
    right = field_follows(imu, attitude, jumps, mag)
    if right:
        return TurningFault(
            "attitude" if right == "gyro" else "gyro", f"{said}; the magnetic field turns as the {right} does"
        )
    if attitude.rate < LEAST_HZ or not alike(by_gyro, by_attitude) or not otherwise(by_gyro, by_attitude, FAR_SLOPES):
        return TurningFault()
    return TurningFault("gyro", f"{said}; which is right cannot be determined")


def rotations(imu: Imu, attitude: Attitude, jumps: NDArray[np.int64]) -> tuple[Array, Array]:
    """Mean rates (n, 3) in rad/s of gyro and attitude over intervals of the attitude of SPAN_S or one of its samples;
    no gaps, large turns or ``jumps`` (indices of the samples after resets)."""
    t = attitude.t if attitude.t_sample is None else attitude.t_sample
    turning = increments.of(imu)
    if len(turning.t) < 3 or len(t) < 3:
        return np.zeros((0, 3)), np.zeros((0, 3))
    step = max(1, math.ceil(min(SPAN_S * attitude.rate, len(t) / LEAST_INTERVALS) - 0.01))
    reset = np.zeros(len(t), int)
    reset[np.concatenate([jumps - 1, jumps, jumps + 1]).clip(0, len(t) - 1)] = 1
    resets = np.cumsum(reset)[::step]
    t, q = t[::step], attitude.q[::step]
    dt = np.diff(t)
    good = (dt > 0) & (dt <= 1.0) & turning.known(t[:-1], t[1:])
    good &= np.diff(resets) == 0
    turned = rotation.turns(q[:-1], q[1:])
    good &= np.einsum("ni,ni->n", turned, turned) < 1.0
    gyro = turning.between(t[:-1], t[1:])
    good &= rotation.finite(gyro)
    return gyro[good] / dt[good, None], turned[good] / dt[good, None]


def otherwise(by_gyro: Array, by_attitude: Array, allowed: tuple[float, float] = SLOPES) -> str:
    """How the rates (n, 3) of an attitude differ from those of the gyro in kind; empty where they do not.

    ``allowed``: the least and the most that the attitude may turn for one turn of the gyro.
    """
    if len(by_gyro) < LEAST_INTERVALS:
        return ""
    g, a = centred(by_gyro), centred(by_attitude)
    by_the_gyro, by_the_attitude = (np.degrees(x.std(axis=0)) for x in (g, a))
    moving = by_the_gyro >= LEAST_DPS
    axes = (other_axes(g, a, moving) if moving.any() else "") or reversed_slowly(g, a, moving)
    if axes:
        return axes.rstrip(".")
    blind = ~moving & (by_the_attitude >= LEAST_DPS) & (by_the_gyro < BLIND * by_the_attitude)
    if blind.any():
        axis = int(np.argmax(np.where(blind, by_the_attitude, 0.0)))
        turns = f"{by_the_attitude[axis]:.1f} deg/s about {'xyz'[axis]} (standard deviation)"
        return f"the attitude turns by {turns}, the gyro by {by_the_gyro[axis]:.1f}"
    g = g @ mounting(g, a).T
    slopes = np.sum(g * a, axis=0) / np.maximum(np.sum(g * g, axis=0), 1e-30)
    outside = moving & ~((slopes >= allowed[0]) & (slopes <= allowed[1]))
    shown = ", ".join(f"{'xyz'[k]} {slopes[k]:.2f}" for k in np.flatnonzero(outside))
    return f"the attitude turns {shown} times as far" if shown else ""


def centred(rates: Array) -> Array:
    """Rates (n, 3) without their mean: the median of a flight with turns of one sense would move with the noise."""
    return np.asarray(rates - rates.mean(axis=0))


def mounting(g: Array, a: Array) -> Array:
    """The rotation (3, 3) that takes rates ``g`` (n, 3) nearest to ``a`` (Kabsch1976), if below MOUNTED_DEG.

    A sensor that sits askew in the vehicle turns as far as the vehicle does; gravity tells of it.
    """
    turn = rotation.nearest(a.T @ g)
    near = np.degrees(np.arccos(np.clip(0.5 * (np.trace(turn) - 1.0), -1.0, 1.0))) < MOUNTED_DEG
    return turn if near else np.eye(3)


def alike(by_gyro: Array, by_attitude: Array) -> bool:
    """Whether some axis of the attitude moves as some axis of the gyro does, whatever its scale, axis and sign.

    Both are rates (n, 3) in rad/s over the same intervals, body axes.

    Then both saw the same flight. Where the attitude does what the gyro never did, it is the
    attitude that nothing supports.
    """
    g, a = centred(by_gyro), centred(by_attitude)
    size = np.sqrt(np.outer(np.sum(a * a, axis=0), np.sum(g * g, axis=0)))
    match = np.abs(np.divide(a.T @ g, size, out=np.zeros((3, 3)), where=size > 0))
    return bool(match.max() > LEAST_CORRELATION)


def field_follows(
    imu: Imu, attitude: Attitude, jumps: NDArray[np.int64], mag: Mag | None
) -> Literal["gyro", "attitude", ""]:
    """With which of the two the magnetic field turns: ``gyro``, ``attitude``, empty where it does not tell.

    What is left of the change of the field's direction over STEP_S after the turn is taken out.
    ``jumps`` (k,): indices of the attitude after resets.
    """
    if mag is None:
        return ""
    start, end, field, changed = field_changes(mag)
    turning = increments.of(imu)
    own = attitude.t if attitude.t_sample is None else attitude.t_sample
    segment = gaps.renumber(gaps.number(own), np.cumsum(np.isin(np.arange(len(own)), jumps)))
    (before, first), (after, last) = (interpolate(own, attitude.q, segment, t) for t in (start, end))
    both = (first >= 0) & (first == last) & turning.known(start, end)
    if np.count_nonzero(both) < LEAST_INTERVALS:
        return ""
    before, after, field, changed = before[both], after[both], field[both], changed[both]
    by_gyro = rotation.from_rotvec(turning.between(start[both], end[both]))
    by_attitude = rotation.multiply(rotation.conjugate(before), after)
    left = [
        float(np.mean(np.sum((rotation.rotate_inverse(turn, field) - changed) ** 2, axis=1)))
        for turn in (by_gyro, by_attitude)
    ]
    if np.degrees(np.sqrt(max(left))) < LEAST_FIELD_DEG:
        return ""
    return "attitude" if left[0] > CLEARLY * left[1] else "gyro" if left[1] > CLEARLY * left[0] else ""


def field_changes(mag: Mag) -> tuple[Array, Array, Array, Array]:
    """Times (n,) s about STEP_S apart, from and to, and the direction (n, 3) of the field at both."""
    good = rotation.finite(mag.field.x)
    t, field = mag.field.t_best[good], mag.field.x[good]
    size = np.sqrt(np.sum(field**2, axis=1, keepdims=True))
    if len(t) < LEAST_INTERVALS or not (size > 0).all():
        return np.zeros(0), np.zeros(0), np.zeros((0, 3)), np.zeros((0, 3))
    field = field / size
    end = np.searchsorted(t, t + STEP_S)
    start = np.flatnonzero((end < len(t)) & (np.diff(t, append=t[-1]) < STEP_S))
    end = end[start]
    near = t[end] - t[start] < 2.0 * STEP_S
    start, end = start[near], end[near]
    return t[start], t[end], field[start], field[end]


def reversed_slowly(g: Array, a: Array, moving: NDArray[np.bool_]) -> str:
    """Which axes that turn little are reversed, empty for none. ``g``, ``a``: rates (n, 3) of gyro and attitude.

    What the attitude's axis has of the gyro's, the share of the other two (an askew mount) taken out of both, is then
    the same turn with the other sign, in each half of the log. On 198 attitudes of real and simulated logs no axis
    had a correlation below -0.3.
    """
    found = []
    for k in np.flatnonzero(~moving & (np.degrees(g.std(axis=0)) >= LEAST_SIGN_DPS)).tolist():
        others = np.delete(g, k, axis=1)
        x, y = (v - others @ np.linalg.lstsq(others, v, rcond=None)[0] for v in (g[:, k], a[:, k]))
        slope = float(x @ y) / max(float(x @ x), 1e-30)
        halves = (slice(None, len(x) // 2), slice(len(x) // 2, None))
        if (
            SLOPES[0] <= -slope <= SLOPES[1]
            and _correlation(x, y) < -LEAST_CORRELATION
            and all(_correlation(x[half], y[half]) < -0.5 for half in halves)
        ):
            found.append("xyz"[k])
    return f"reversed sign about {', '.join(found)}." if found else ""


def _correlation(x: Array, y: Array) -> float:
    return float(x @ y) / max(math.sqrt(float(x @ x) * float(y @ y)), 1e-30)


def other_axes(g: Array, a: Array, moving: NDArray[np.bool_]) -> str:
    """Which axes seem swapped or reversed, empty if the identity fits.

    ``g``, ``a`` (n, 3): rates in rad/s of gyro and attitude, body axes; ``moving`` (3,): the axes that turned.
    """
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
