"""The gyro in flight against the attitude that did not come from it: its scale, and a bias that steps.

Over intervals of SPAN_S the attitude turned by ``a = S g + b`` where the gyro turned by ``g``. Off-diagonal elements of
S are the mounting, the diagonal is one over the gyro's scale, -b its bias. A smoother is made of this very gyro and
cannot judge its scale: truth or the onboard attitude does, whose aids keep it from turning as far as a wrong scale.
Whether the bias steps a smoother with GNSS knows best, by likelihood: where it is the reference its word is taken.
"""

from __future__ import annotations

import math
from functools import partial

import numpy as np
from numpy.typing import NDArray

from attlog.base import rotation
from attlog.flight.model import Array, FlightLog, Imu
from attlog.health.fits.regression import BLOCK_S, RobustFit, fit, interval
from attlog.health.model import Check, graded, not_judged
from attlog.reference.model import GyroJump, Reference
from attlog.segments import increments
from attlog.segments.model import Segments

SCALE, STEP = "gyro scale", "gyro bias step"
SPAN_S = 0.3
"""Long enough that noise, vibration and a delay of some milliseconds do not lower the slope (0.98 at 0.1 s, 1.00 here,
on flights whose scale is right), short enough for turns."""
LEAST_DPS = 8.0
"""An axis that turns less (standard deviation) does not tell its scale to a percent."""
FEWEST, LEAST_BLOCKS, LEAST_S = 60, 6, 20.0
LARGEST_RAD = 1.0
OFF, FAR = 0.02, 0.1
SIGMAS, FLOOR = 4.0, 0.006
"""Told above four times sqrt((1.5 standard errors)^2 + 0.006^2): slopes of sound flights are 0.99 to 1.01."""
LIMIT = f"ok within {100 * OFF:.0f} % or {SIGMAS:.0f} sigma of 1, fault beyond {100 * FAR:.0f} %"
STEP_DPS, FAR_DPS = 0.5, 3.0
STEP_SIGMAS, STEP_FLOOR_DPS = 6.0, 0.03
BEFORE_AFTER = 3
"""Blocks of 5 s before and after a step at least."""
STEP_LIMIT = f"ok: no step above {STEP_DPS} deg/s and {STEP_SIGMAS:.0f} sigma; fault above {FAR_DPS:.0f} deg/s"


def checks(
    log: FlightLog, segments: Segments, reference: Reference | None, smoother: Reference | None = None
) -> list[Check]:
    """Scale and steps of the bias in flight; nothing where nothing flew.

    ``reference`` is not made of this gyro alone; ``smoother`` may know of steps, where that is what it is.
    """
    imu = log.replay_imu
    flown = segments.spans("airborne")
    if imu is None or not flown:
        return []
    jumps = None if smoother is None else smoother.gyro_jumps
    found = _rates(imu, segments, reference)
    return found if jumps is None else [_jump(imu, jumps) if check.name == STEP else check for check in found]


def _rates(imu: Imu, segments: Segments, reference: Reference | None) -> list[Check]:
    """Both by the rates of an attitude."""
    if reference is None or reference.kind not in ("truth", "onboard") or reference.gyro_fault:
        why = "No attitude that is not made of this gyro can be trusted."
        return [not_judged(SCALE, why, LIMIT), not_judged(STEP, why, STEP_LIMIT)]
    t, g, a = turned(imu, reference)
    use = segments.mask(t, "airborne") & (t < reference.end)
    t, g, a = t[use], g[use], a[use]
    columns = np.concatenate([g, np.ones((len(g), 1))], axis=1)
    if len(t) < FEWEST or len(t) * SPAN_S < LEAST_S:
        why = f"{len(t)} intervals of {SPAN_S} s in flight can be compared; {FEWEST} and {LEAST_S:.0f} s are needed."
        return [not_judged(SCALE, why, LIMIT), not_judged(STEP, why, STEP_LIMIT)]
    found = [fit(t, columns[:, None, :], a[:, k : k + 1]) for k in range(3)]
    return [_scale(imu, reference, t, g, found), _step(imu, reference, t, columns, a, found)]


def turned(imu: Imu, reference: Reference) -> tuple[Array, Array, Array]:
    """Begin (n,) s, and mean rates (n, 3) rad/s by gyro and attitude over SPAN_S; not across gaps and resets."""
    t, q = reference.t, reference.q
    summed = increments.of(imu)
    if len(t) < 3 or len(summed.t) < 3 or reference.rate <= 0:
        return np.zeros(0), np.zeros((0, 3)), np.zeros((0, 3))
    step = max(1, round(SPAN_S * reference.rate))
    first = np.arange(0, len(t) - step, step)
    start, end = t[first], t[first + step]
    good = (end - start < 2.0 * SPAN_S + 0.1) & (reference.segment[first] == reference.segment[first + step])
    good &= (start >= reference.scoring_start) & summed.known(start, end) & (end > start)
    by_attitude, by_gyro = rotation.turns(q[first], q[first + step]), summed.between(start, end)
    good &= rotation.finite(by_attitude) & rotation.finite(by_gyro) & (rotation.length(by_gyro) < LARGEST_RAD)
    dt = (end - start)[good, None]
    return start[good], by_gyro[good] / dt, by_attitude[good] / dt


def _jump(imu: Imu, jumps: tuple[GyroJump, ...]) -> Check:
    """The step of the bias that a smoother found by likelihood."""
    if not jumps:
        return Check(STEP, "ok", f"The smoother finds no step of the bias of {imu.gyro.source}.", threshold=STEP_LIMIT)
    jump = jumps[0]
    axis = int(np.argmax(np.abs(jump.size_dps)))
    size, sigma = jump.size_dps[axis], math.hypot(jump.sigma_dps[axis], STEP_FLOOR_DPS)
    verdict = graded(abs(size), STEP_DPS, FAR_DPS)
    text = f"The bias of {imu.gyro.source} steps by {size:+.2f} deg/s about {'xyz'[axis]} "
    text += f"({interval(size, sigma, 2)}, 95 %) at {jump.t:.0f} s by the smoother, which models it."
    ci95 = round(size - 1.96 * sigma, 2), round(size + 1.96 * sigma, 2)
    return Check(STEP, verdict, text, round(size, 2), "deg/s", STEP_LIMIT, t=round(jump.t, 1), ci95=ci95)


def _scale(imu: Imu, reference: Reference, t: Array, g: Array, found: list[RobustFit | None]) -> Check:
    moving = np.degrees(g.std(axis=0))
    told: list[tuple[float, float, int]] = []
    for k, one in enumerate(found):
        if one is not None and moving[k] >= LEAST_DPS and one.blocks >= LEAST_BLOCKS and one.x[k] > 0.1:
            sigma = math.hypot(1.5 * float(one.sigma[k]), FLOOR)
            told.append((1.0 / float(one.x[k]) - 1.0, sigma / float(one.x[k]) ** 2, k))
    if not told:
        shown = ", ".join(f"{v:.0f}" for v in moving)
        why = f"In flight x, y, z turn by {shown} deg/s (standard deviation); {LEAST_DPS:.0f} are needed."
        return not_judged(SCALE, why, LIMIT)
    error, sigma, _ = max(told, key=lambda one: abs(one[0]) / one[1])
    off = [one for one in told if abs(one[0]) > max(OFF, SIGMAS * one[1])]
    seconds = len(t) * SPAN_S
    ci95 = round(100.0 * error - 196.0 * sigma, 2), round(100.0 * error + 196.0 * sigma, 2)
    made = partial(Check, SCALE, unit="%", threshold=LIMIT, ci95=ci95, samples=len(t), seconds=round(seconds, 1))
    if not off:
        shown = ", ".join(f"{'xyz'[k]} {1.0 + e:.3f}" for e, _, k in told)
        text = f"{imu.gyro.source} against {reference.source} turns {shown} times as far in {seconds:.0f} s of flight."
        return made("ok", text, round(100.0 * error, 2))
    verdict = "fault" if max(abs(one[0]) for one in off) > FAR else "warning"
    which = ", ".join("xyz"[k] for _, _, k in off)
    text = f"{imu.gyro.source} reads {100 * abs(error):.1f} % too {'much' if error > 0 else 'little'} about {which} "
    text += f"({interval(100 * abs(error), 100 * sigma, 1)}, 95 %) against {reference.source}, "
    text += f"{len(t)} intervals in {seconds:.0f} s of flight."
    return made(verdict, text, round(100.0 * error, 2))


def _step(imu: Imu, reference: Reference, t: Array, columns: Array, a: Array, found: list[RobustFit | None]) -> Check:
    """The clearest step of the bias between two parts of the flight.

    About z truth alone tells: a compass drags an onboard heading by degrees per second, as a bias would.
    """
    solved = [one for one in found if one is not None]
    if len(solved) < 3:
        return not_judged(STEP, "The flight turns too little about one axis.", STEP_LIMIT)
    left = np.degrees(columns @ np.column_stack([one.x for one in solved]) - a)
    block = (t // BLOCK_S).astype(np.int64)
    numbers = np.unique(block)
    bias = np.array([np.median(left[block == n], axis=0) for n in numbers])
    if len(bias) < 2 * BEFORE_AFTER:
        return not_judged(STEP, f"{len(bias)} blocks of {BLOCK_S:.0f} s; {2 * BEFORE_AFTER} are needed.", STEP_LIMIT)
    size, sigma, axis, at = largest_step(bias if reference.kind == "truth" else bias[:, :2])
    when = _onset(t, left[:, axis], float(numbers[at]) * BLOCK_S)
    if abs(size) <= max(STEP_DPS, STEP_SIGMAS * sigma):
        text = f"The bias of {imu.gyro.source} steps by less than {max(STEP_DPS, abs(size)):.1f} deg/s about "
        text += f"{'x, y and z' if reference.kind == 'truth' else 'x and y'} in flight."
        return Check(STEP, "ok", text, round(size, 2), "deg/s", STEP_LIMIT)
    verdict = "fault" if abs(size) > FAR_DPS else "warning"
    text = f"The bias of {imu.gyro.source} steps by {size:+.2f} deg/s about {'xyz'[axis]} "
    text += f"({interval(size, sigma, 2)}, 95 %) at {when:.0f} s against {reference.source}."
    ci95 = round(size - 1.96 * sigma, 2), round(size + 1.96 * sigma, 2)
    seconds = round(len(t) * SPAN_S, 1)
    told = partial(Check, STEP, verdict, text, round(size, 2), "deg/s", STEP_LIMIT, t=round(when, 1))
    return told(ci95=ci95, samples=len(t), seconds=seconds)


def largest_step(bias: Array) -> tuple[float, float, int, int]:
    """Size and standard error of the clearest step of block means (n, axes), its axis, and the first block after it.

    Medians before and after; the scatter of a block from the differences of neighbours, which one step hardly widens.
    """
    scatter = 1.4826 * np.median(np.abs(np.diff(bias, axis=0)), axis=0) / math.sqrt(2.0)
    found = [_step_at(bias[:, axis], float(scatter[axis])) for axis in range(bias.shape[1])]
    axis = int(np.argmax([abs(size) / sigma for size, sigma, _ in found]))
    size, sigma, at = found[axis]
    return size, sigma, axis, at


def _step_at(bias: Array, scatter: float) -> tuple[float, float, int]:
    """Size and standard error of a step of one axis (n,), where the squares left by two means are the least."""
    parts = range(BEFORE_AFTER, len(bias) - BEFORE_AFTER + 1)
    at = min(parts, key=lambda k: float(np.var(bias[:k]) * k + np.var(bias[k:]) * (len(bias) - k)))
    size = float(np.median(bias[at:]) - np.median(bias[:at]))
    sigma = 1.25 * scatter * math.sqrt(1.0 / at + 1.0 / (len(bias) - at))
    return size, math.hypot(sigma, STEP_FLOOR_DPS), at


def _onset(t: Array, left: Array, near: float) -> float:
    """The time within a block either way of ``near`` at which the residual's mean changes most."""
    around: NDArray[np.int64] = np.flatnonzero(np.abs(t - near) <= 2.0 * BLOCK_S)
    if len(around) < 8:
        return near
    x = left[around] - left[around].mean()
    k = int(np.argmax(np.abs(np.cumsum(x)[2:-3]))) + 2
    return float(t[around[k + 1]])
