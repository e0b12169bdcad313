"""Speed and current of motors by their speed controllers (ESCs): which one stopped, and which differs from the others.

A controller's number need not be that of its motor: telemetry has a wiring of its own. The speed follows the output of
one motor, by which the two are matched.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from attlog.core.sorting import median, nanmedian
from attlog.core.spans import Span, between, inside
from attlog.flight.drive import Esc, MotorOutputs
from attlog.flight.model import Array
from attlog.segments.flight_signs import true_runs

# Delays of speeds after outputs that are tried, in s: of motor and telemetry.
DELAYS_S = (0.0, 0.1, 0.2, 0.3, 0.4)
# A match needs so many records in flight, this correlation of what differs between the motors, and this much more than
# the second best as arctanh.
MIN_MATCH_RECORDS, MIN_CORRELATION, MIN_AHEAD, MAX_CORRELATION = 50, 0.5, 0.2, 0.999
# A motor has stopped below this share of the others' median speed, and turns above the second one.
STOPPED_SHARE, TURNING_SHARE = 0.05, 0.5
# Least time and records of a stop.
MIN_STOP_S, MIN_STOP_RECORDS = 0.5, 3
# A standing motor draws less than this share of the others' median current, which is at least so many A.
NO_CURRENT_SHARE, MIN_CURRENT_A = 0.2, 1.0


class Stop(NamedTuple):
    """A stop of the motor at ``esc`` (index) from ``t`` to ``t_end`` s; ``others`` rpm: median of the others.

    ``without_current``: whether the controller measured no current either, None where currents are not measured.
    """

    esc: int
    t: float
    t_end: float
    others: float
    without_current: bool | None


def match_motors(escs: Sequence[Esc], outputs: MotorOutputs, spans: Sequence[Span]) -> list[int | None]:
    """Return the index of the motor of each ESC: as logged, else by outputs in flight; None where neither is clear."""
    logged = [None if esc.motor is None else esc.motor - 1 for esc in escs]
    if all(motor is not None for motor in logged) or len(escs) != outputs.motors:
        return logged
    flown = inside(outputs.t, spans) & np.isfinite(outputs.x).all(axis=1)
    t, x = outputs.t[flown], outputs.x[flown]
    best, found = 0.0, list[int | None](logged)
    for delay in DELAYS_S:
        speed = np.column_stack([np.interp(t + delay, esc.t, esc.rpm) for esc in escs])
        turning = speed.min(axis=1) > TURNING_SHARE * median(speed, axis=1)
        if np.count_nonzero(turning) < MIN_MATCH_RECORDS:
            continue
        a, b = (_differences(y[turning]) for y in (speed, x))
        size = np.outer(np.linalg.norm(a, axis=0), np.linalg.norm(b, axis=0))
        r = np.divide(a.T @ b, size, out=np.zeros_like(size), where=size > 0)
        motors = r.argmax(axis=1)
        second, first = np.arctanh(np.clip(np.sort(r, axis=1)[:, -2:], -MAX_CORRELATION, MAX_CORRELATION)).T
        clear = len(set(motors.tolist())) == len(escs) and float((first - second).min()) >= MIN_AHEAD
        if clear and r.max(axis=1).min() > max(best, MIN_CORRELATION):
            best, found = float(r.max(axis=1).min()), [int(motor) for motor in motors]
    return found


def _differences(x: Array) -> Array:
    """Return records (n, motors) without what the motors have in common, and without their means."""
    apart = x - x.mean(axis=1, keepdims=True)
    result: Array = apart - apart.mean(axis=0)
    return result


def motor_stops(escs: Sequence[Esc], spans: Sequence[Span]) -> list[Stop]:
    """Return the stops in ``spans`` of motors that turned before, while the others turn, in time order."""
    found = []
    for k, esc in enumerate(escs):
        others = [other for other in escs if other is not esc]
        flown = inside(esc.t, spans)
        if len(others) < 2 or not flown.any():
            continue
        usual = median([np.interp(esc.t, other.t, other.rpm) for other in others], axis=0)
        standing = flown & (usual > 0) & (esc.rpm < STOPPED_SHARE * usual)
        for a, b in true_runs(standing):
            turned = (esc.rpm[:a] > TURNING_SHARE * usual[:a]) & flown[:a]
            if b - a < MIN_STOP_RECORDS or esc.t[b - 1] - esc.t[a] < MIN_STOP_S or not turned.any():
                continue
            t0, t1 = float(esc.t[a]), float(esc.t[b - 1])
            level = float(median(usual[a:b]))
            found.append(Stop(k, t0, t1, level, _without_current(esc, others, t0, t1)))
    return sorted(found, key=lambda stop: stop.t)


def _without_current(esc: Esc, others: Sequence[Esc], t0: float, t1: float) -> bool | None:
    means = currents_in([esc, *others], t0, t1)
    if not np.isfinite(means).all() or median(means[1:]) < MIN_CURRENT_A:
        return None
    return bool(means[0] < NO_CURRENT_SHARE * median(means[1:]))


def _mean(t: Array, x: Array, t0: float, t1: float) -> float:
    part = x[between(t, t0, t1)]
    return float(np.mean(part)) if len(part) else np.nan


def speeds_in(escs: Sequence[Esc], t0: float, t1: float) -> Array:
    """Return the last speed (escs,) in rpm of each ESC between two times, NaN without records there."""
    parts = [esc.rpm[between(esc.t, t0, t1)] for esc in escs]
    return np.array([part[-1] if len(part) else np.nan for part in parts])


def currents_in(escs: Sequence[Esc], t0: float, t1: float) -> Array:
    """Return the mean current (escs,) in A of each ESC between two times, NaN without records there."""
    return np.array([_mean(esc.t, esc.current, t0, t1) for esc in escs])


# --- load --------------------------------------------------------------------------------------------------------

# The current rises with the cube of the speed: a propeller's power. Records count above this share of the fastest.
MIN_LOAD_SHARE, MIN_LOAD_RECORDS = 0.3, 20


def motor_loads(escs: Sequence[Esc], spans: Sequence[Span]) -> Array:
    """Return the current at a speed (escs,) over the median of the others', NaN where it is not measured."""
    loads = []
    for esc in escs:
        fast = inside(esc.t, spans) & (esc.rpm > MIN_LOAD_SHARE * np.max(esc.rpm, initial=0.0)) & (esc.current > 0)
        enough = np.count_nonzero(fast) >= MIN_LOAD_RECORDS
        loads.append(float(median(esc.current[fast] / esc.rpm[fast] ** 3)) if enough else np.nan)
    return over_others(np.array(loads), np.divide)


def hottest_excess(escs: Sequence[Esc], spans: Sequence[Span]) -> Array:
    """Return the highest temperature (escs,) in flight less the median of the others' in K, NaN where not measured."""
    peaks = [np.max(esc.temperature[inside(esc.t, spans)], initial=-np.inf) for esc in escs]
    return over_others(np.where(np.isfinite(peaks), peaks, np.nan), np.subtract)


def over_others(x: Array, compare: np.ufunc) -> Array:
    """Return each of x (n,) beside the median of the others by ``compare``; NaN for fewer than three numbers."""
    if np.count_nonzero(np.isfinite(x)) < 3:
        return np.full(len(x), np.nan)
    result: Array = compare(x, [nanmedian(np.delete(x, k)) for k in range(len(x))])
    return result
