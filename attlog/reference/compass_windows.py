"""Windows of a compass's field beside an attitude that keeps its tilt and turns with the gyro.

The tilt is the onboard attitude's, or that of the mean force where the gyro's turns are undone.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from attlog.core import rotation
from attlog.core.sorting import unique
from attlog.core.spans import Span, inside, intersect
from attlog.flight.compass import motor_drive, power_at
from attlog.flight.model import Array, FlightLog, Imu, Mag
from attlog.segments import Segments, model
from attlog.segments.increments import gyro_increments

# Rate of samples: attitude errors are correlated over longer times.
SAMPLE_HZ = 8.0
# Length of a window with one heading, drift and offset, and its least number of samples.
WINDOW_S, MIN_WINDOW_SAMPLES = 60.0, 40
# Windows used of a long flight: evenly chosen ones show a mounting as well as all.
MAX_WINDOWS = 20
# Longer steps between samples end a window.
MAX_STEP_S = 1.0
# Time cut from both ends of a flight (ground contact). Shorter flights use the whole log.
EDGE_S, MIN_FLIGHT_S = 1.0, 15.0
# Time constant of the force's low-pass, run forward and backward: turns and gusts average out.
FORCE_S = 5.0
# Least number of samples for any tilt.
MIN_SAMPLES = 60


@dataclass(frozen=True)
class Window:
    """Samples of a window: time from its middle (n,) s, body-to-earth matrices (n, 3, 3), field (n, 3) uT, power (n,).

    ``power`` is None where it is unknown or constant.
    """

    t: Array
    earth: Array
    field: Array
    power: Array | None
    middle: float = 0.0
    """Time of the middle, s."""

    @cached_property
    def nuisance(self) -> Array:
        """Return columns (n, k) of offset and power."""
        one = np.ones((len(self.t), 1))
        return one if self.power is None else np.column_stack([one, self.power])


def use_spans(log: FlightLog, segments: Segments) -> list[Span]:
    """Return the flight without its ends, the whole log where it is short; before the first crash."""
    end = min((s.t0 for k in ("impact", "loss_of_control", "wreck") for s in segments.of(k)), default=log.seconds)
    flown = [(a + EDGE_S, b - EDGE_S) for a, b in segments.spans("airborne") if b - a > 2.0 * EDGE_S]
    flown = intersect(flown, [(-np.inf, end)])
    return flown if sum(b - a for a, b in flown) >= MIN_FLIGHT_S else [(-np.inf, end)]


def _field_samples(log: FlightLog, segments: Segments, mag: Mag) -> tuple[Array, Array]:
    """Return times (n,) s and fields (n, 3) uT at 8 Hz at most, without repeats."""
    t, x = model.select_rising(mag.field.t_best, 1e6 * mag.field.x)
    use = inside(t, use_spans(log, segments)) & np.any(np.diff(x, axis=0, prepend=np.nan) != 0.0, axis=1)
    t, x = t[use], x[use]
    number = np.floor(t * SAMPLE_HZ).astype(np.int64)
    first = np.diff(number, prepend=-1) != 0
    return t[first], x[first]


def _cut(log: FlightLog, t: Array, x: Array, earth: Array, joined: NDArray[np.bool_]) -> list[Window]:
    """Return windows of samples that are ``joined`` (n,) to the one before; not upside down."""
    upright = earth[:, 2, 2] > 0.0
    run = np.cumsum(~joined)
    t, x, earth, run = t[upright], x[upright], earth[upright], run[upright]
    power = power_at(motor_drive(log)[1], t)
    windows = []
    for number in unique(run):
        k = np.flatnonzero(run == number)
        for part in np.array_split(k, max(1, math.ceil((t[k[-1]] - t[k[0]]) / WINDOW_S))):
            if len(part) < MIN_WINDOW_SAMPLES:
                continue
            p = power[part]
            middle = 0.5 * (t[part[0]] + t[part[-1]])
            varies = np.isfinite(p).all() and np.ptp(p) > 1e-3 * max(float(np.abs(p).max()), 1e-9)
            windows.append(Window(t[part] - middle, earth[part], x[part], p if varies else None, middle))
    return windows[:: math.ceil(len(windows) / MAX_WINDOWS) or 1]


def by_onboard_tilt(log: FlightLog, segments: Segments, imu: Imu, mag: Mag) -> list[Window]:
    """Return windows with the onboard tilt; its heading turns with the gyro."""
    attitude = log.onboard_attitude
    if attitude is None or len(attitude.t) < MIN_SAMPLES:
        return []
    t, x = _field_samples(log, segments, mag)
    own = attitude.t if attitude.t_sample is None else attitude.t_sample
    q, _ = rotation.slerp_in_segments(own, attitude.q, model.number_segments(own), t)
    known = rotation.finite_rows(q)
    t, x, q = t[known], x[known], q[known]
    if len(t) < MIN_WINDOW_SAMPLES:
        return []
    turning = gyro_increments(imu)
    turned = rotation.from_rotvec(turning.between(t[:-1], t[1:]))
    slip = rotation.multiply(q[1:], rotation.conjugate(rotation.multiply(q[:-1], turned)))
    drift = np.concatenate([[0.0], np.cumsum(2.0 * np.arctan2(slip[:, 3], slip[:, 0]))])
    matrices = rotation.to_matrix(rotation.turn_about_down(q, -drift))
    return _cut(log, t, x, matrices, _joined(t, turning.known(t[:-1], t[1:])))


def by_mean_force(log: FlightLog, segments: Segments, imu: Imu, mag: Mag) -> list[Window]:
    """Return windows with the tilt by gyro and mean force alone."""
    t, x = _field_samples(log, segments, mag)
    if len(t) < MIN_WINDOW_SAMPLES:
        return []
    turning = gyro_increments(imu)
    joined = _joined(t, turning.known(t[:-1], t[1:]))
    steps = rotation.from_rotvec(turning.between(t[:-1], t[1:]))
    q = _running_turns(steps)
    at, force = model.select_rising(imu.acc.t_best, imu.acc.x)
    if len(at) < MIN_SAMPLES:
        return []
    sums = np.concatenate([np.zeros((1, 3)), np.cumsum(np.diff(at)[:, None] * force[1:], axis=0)])
    half = 0.5 / SAMPLE_HZ
    mean = np.column_stack([np.interp(t + half, at, s) - np.interp(t - half, at, s) for s in sums.T])
    down = -rotation.rotate(q, mean)
    matrices = np.empty((len(t), 3, 3))
    run = np.cumsum(~joined)
    for number in unique(run):
        own = run == number
        level = _smooth(t[own], down[own])
        size = np.maximum(rotation.length(level), 1e-9)[:, None]
        matrices[own] = _least_turns(level / size) @ rotation.to_matrix(q[own])
    return _cut(log, t, x, matrices, joined)


def _running_turns(steps: Array) -> Array:
    """Return the attitudes (n + 1, 4) after each of the rotations (n, 4), by doubling; the first is level."""
    q = np.concatenate([[[1.0, 0.0, 0.0, 0.0]], steps])
    for reach in _doublings(len(q)):
        q[reach:] = rotation.multiply(q[:-reach], q[reach:])
    return rotation.normalize(q)


def _smooth(t: Array, x: Array) -> Array:
    """Low-pass vectors (n, 3) at ``t`` (n,) s with FORCE_S, forward and backward."""
    kept = np.exp(-np.abs(np.diff(t)) / FORCE_S)[:, None]
    for keep in (kept, kept[::-1]):
        start = x[: int(SAMPLE_HZ * FORCE_S)].mean(axis=0, keepdims=True)
        share, out = np.concatenate([[[0.0]], keep]), np.concatenate([start, (1.0 - keep) * x[1:]])
        for reach in _doublings(len(out)):
            out[reach:] = out[reach:] + share[reach:] * out[:-reach]
            share[reach:] = share[reach:] * share[:-reach]
        x = out[::-1]
    return x


def _doublings(count: int) -> list[int]:
    """Return 1, 2, 4, ... below ``count``: the reaches of a running product by doubling."""
    return [1 << k for k in range(max(count - 1, 0).bit_length())]


def _least_turns(down: Array) -> Array:
    """Return the least rotations (n, 3, 3) that take unit vectors (n, 3) to (0, 0, 1)."""
    axis = np.column_stack([down[:, 1], -down[:, 0], np.zeros(len(down))])  # down x (0, 0, 1)
    q = np.column_stack([1.0 + down[:, 2], axis])
    return rotation.to_matrix(rotation.normalize(q))


def _joined(t: Array, known: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """Mark samples (n,) that gyro and field join to the one before."""
    return np.concatenate([[False], known & (np.diff(t) < MAX_STEP_S)])


TILTS: tuple[Callable[[FlightLog, Segments, Imu, Mag], list[Window]], ...] = (by_onboard_tilt, by_mean_force)
