"""Signs of flight every 0.1 s, to tell air, ground and hand apart.

Thresholds are from docs/story.md, measured on real logs and on simulated flights with true height. On the ground and in
a hand the specific force is the reaction to gravity, so its sideways part follows the tilt. Rotor thrust is along the
body z axis, so in flight the sideways force hardly depends on the tilt.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from attlog.core import rotation
from attlog.core.brief import brief
from attlog.core.sorting import median
from attlog.flight.model import FlightLog, Imu, Stream

Array = NDArray[np.float64]

# Maximum time from an instant to the nearest GNSS velocity or attitude.
MAX_FIX_AGE_S = 1.5


def tilt_at(log: FlightLog, at: Array) -> Array:
    """Return tilt (m,) in deg of the onboard attitude, else the truth, at times ``at``.

    Nearest sample; NaN where none is within 1.5 s.
    """
    attitude = log.onboard_attitude or log.truth
    if attitude is None or len(attitude.t) == 0:
        return np.full(len(at), np.nan)
    i = _nearest_index(attitude.t, at)
    tilt = np.degrees(rotation.tilt_angle(attitude.q[i]))
    return np.where(np.abs(attitude.t[i] - at) <= MAX_FIX_AGE_S, tilt, np.nan)


def speed_at(log: FlightLog, at: Array) -> Array:
    """Return GNSS speed (m,) in m/s of the first receiver with a 3D fix at times ``at``.

    Nearest sample; NaN where none is within 1.5 s. Without a receiver, and without IMU or drive, the estimator's.
    """
    for gnss in log.gnss:
        velocity = np.where(np.isfinite(gnss.vel_ned), gnss.vel_ned, 0.0)
        good = (gnss.fix >= 3) & rotation.finite_rows(gnss.vel_ned[:, :2]) & np.isfinite(gnss.t)
        if np.count_nonzero(good) > 3:
            t, speed = gnss.t[good], np.sqrt(np.sum(velocity[good] ** 2, axis=1))
            i = _nearest_index(t, at)
            return np.where(np.abs(t[i] - at) <= MAX_FIX_AGE_S, speed[i], np.nan)
    own, driven = log.estimator.speed, log.power.throttle or log.power.motors or log.power.rpm
    if own is not None and (driven is None or not log.imus):
        i = _nearest_index(own.t, at)
        return np.where(np.abs(own.t[i] - at) <= MAX_FIX_AGE_S, own.x[i, 0], np.nan)
    return np.full(len(at), np.nan)


def _nearest_index(t: Array, at: Array) -> NDArray[np.int64]:
    """Return indices (m,) of the times nearest to ``at``."""
    i = np.clip(np.searchsorted(t, at), 1, max(len(t) - 1, 1)) if len(t) > 1 else np.zeros(len(at), np.int64)
    if len(t) > 1:
        i = i - (at - t[i - 1] < t[i] - at)
    return i


# --- signs of flight ---------------------------------------------------------------------------------------------

Mask = NDArray[np.bool_]

# Step of the grid.
STEP_S = 0.1
# Standard gravity in m/s^2.
G = 9.80665
# Averaging windows: mean force, its variation, dynamics, ground slope, length of the force.
MEAN_S, SPREAD_S, AVERAGE_S, SLOPE_S, SHORT_S = 0.4, 2.0, 3.0, 4.0, 0.2
# Usual values at rest: standard deviation of force, rate, standard deviation of tilt.
STILL_FORCE_M_S2, STILL_RATE_DPS, STILL_TILT_DEG = 0.03, 1.0, 0.2
# Minimum variance of gravity's sideways part, (m/s^2)^2, for a slope of the sideways force on it.
MIN_SLOPE_VARIANCE = 0.005
# Above this ground speed there is no contact with ground or hand.
MAX_HAND_M_S = 3.0
# Range of the ground slope that shows contact, and the minimum share of the window within it.
MIN_GROUND_SLOPE, MAX_GROUND_SLOPE, MIN_CONTACT_SHARE = 0.7, 1.6, 0.6
# Maximum age of an attitude or stream value, and maximum distance to the nearest IMU sample.
MAX_AGE_S, MAX_SAMPLE_GAP_S = 1.5, 0.5
# Minimum IMU rate for dynamics and contact.
MIN_IMU_HZ = 8.0
# Dynamics (:attr:`Grid.dynamics`) of a vehicle in the air, and at rest.
AIRBORNE_DYNAMICS, REST_DYNAMICS = 0.4, -0.6


@dataclass(slots=True)
class Grid:
    """Signs of flight at times ``t`` (n,) s, 0.1 s apart; NaN where unknown.

    ``known`` (n,): the IMU was logged. ``force`` (n, 3) m/s^2: specific force over 0.4 s. ``size`` (n,) m/s^2: its
    length over 0.2 s. ``dynamics`` (n,): mean of the logarithms of how much force, rate and tilt vary, relative to a
    vehicle at rest; above 0.4 airborne, below -0.6 at rest. ``slope`` (n,): regression slope of the sideways force on
    that of a vehicle on the ground, near 1 in contact. ``contact`` (n,): the slope shows the ground. ``speed`` (n,) m/s
    over ground. ``down`` (n, 3): down in body axes. ``slow``: the IMU is too slow for all but ``known`` and ``speed``.
    """

    t: Array
    known: Mask
    force: Array
    size: Array
    dynamics: Array
    slope: Array
    contact: Mask
    speed: Array
    down: Array
    slow: bool
    __repr__ = brief

    def index(self, t: float) -> int:
        """Return the grid index nearest to a time in s."""
        return int(np.clip(round((t - self.t[0]) / STEP_S), 0, len(self.t) - 1))


def build_grid(log: FlightLog, t0: float, t1: float) -> Grid | None:
    """Return the signs of flight over [t0, t1] s.

    None for less than 1 s, or without IMU, onboard attitude and the estimator's height.
    """
    imu, onboard = log.replay_imu or next(iter(log.imus), None), log.onboard_attitude
    height = log.estimator.height
    if not t1 - t0 > 1.0 or (imu is None and onboard is None and height is None):
        return None
    t = np.arange(t0, t1, STEP_S)
    down, speed, nothing = _down_axis(log, t), speed_at(log, t), np.full(len(t), np.nan)
    if imu is not None:
        force, rate, known = _mean_samples(imu, t)
    else:
        force, rate, known = np.zeros((len(t), 3)), np.zeros((len(t), 3)), np.isfinite(down[:, 0])
        if onboard is None and height is not None:
            known = seconds_to_nearest(t, height.t) <= MAX_AGE_S
    no_contact = np.zeros(len(t), bool)
    found = Grid(t, known, force, nothing, nothing.copy(), nothing.copy(), no_contact, speed, down, True)
    if imu is None or imu.acc.rate < MIN_IMU_HZ or not known.any():
        return found
    found.slow = False
    bias = median(rate[known], axis=0)
    for a, b in true_runs(known):
        _fill_signs(found, slice(a, b), np.degrees(rate[a:b] - bias))
    return found


def _fill_signs(grid: Grid, part: slice, rate: Array) -> None:
    """Fill the signs of a part without gaps; ``rate`` (n, 3) deg/s has no gyro offset."""
    raw, down = grid.force[part], grid.down[part]
    force, turned = _mean(raw, MEAN_S), rotation.length(_mean(rate, MEAN_S))
    signs = [np.sqrt(_variance(rotation.length(force), SPREAD_S)) / STILL_FORCE_M_S2]
    signs += [np.sqrt(_mean(turned**2, SPREAD_S)) / STILL_RATE_DPS]
    tilted = np.degrees(np.sqrt(np.sum(_variance(down, SPREAD_S), axis=1))) / STILL_TILT_DEG
    logs = np.log(np.clip([*signs, tilted], 1e-2, 1e3))
    dynamics = np.where(np.isfinite(logs[2]), np.nanmean(logs, axis=0), logs[:2].mean(axis=0))
    slope = _ground_slope(force, -G * down)
    touching = (
        _mean(((slope > MIN_GROUND_SLOPE) & (slope < MAX_GROUND_SLOPE)).astype(np.float64), SLOPE_S)
        >= MIN_CONTACT_SHARE
    )
    grid.size[part] = rotation.length(_mean(raw, SHORT_S))
    grid.force[part] = force
    grid.dynamics[part] = _mean(dynamics, AVERAGE_S)
    grid.slope[part] = slope
    grid.contact[part] = touching & ~(grid.speed[part] > MAX_HAND_M_S)


def _mean_samples(imu: Imu, t: Array) -> tuple[Array, Array, Mask]:
    """Return mean force (n, 3) m/s^2, mean rate (n, 3) rad/s, and a mask of known times."""
    at, acc, gyro = imu.acc.t_best, imu.acc.x, imu.gyro.x
    n = min(len(at), len(acc), len(gyro))
    good = np.isfinite(at[:n]) & rotation.finite_rows(acc[:n]) & rotation.finite_rows(gyro[:n])
    good &= (at[:n] >= t[0] - STEP_S) & (at[:n] <= t[-1] + STEP_S)
    at, both = at[:n][good], np.hstack([acc[:n][good], gyro[:n][good]])
    if len(at) < 2:
        return np.zeros((len(t), 3)), np.zeros((len(t), 3)), np.zeros(len(t), bool)
    k = np.clip(np.rint((at - t[0]) / STEP_S).astype(np.int64), 0, len(t) - 1)
    count = np.bincount(k, minlength=len(t))
    have = count > 0
    sums = np.column_stack([np.bincount(k, column, len(t)) for column in both.T])
    mean = sums[have] / count[have, None]
    filled = np.column_stack([np.interp(t, t[have], column) for column in mean.T])
    usual = float(median(np.diff(at)))
    return filled[:, :3], filled[:, 3:], seconds_to_nearest(t, at) <= max(MAX_SAMPLE_GAP_S, 2.0 * usual)


def _down_axis(log: FlightLog, t: Array) -> Array:
    """Return down in body axes (n, 3) from the onboard attitude, else the truth."""
    attitude = log.onboard_attitude or log.truth
    down = np.full((len(t), 3), np.nan)
    if attitude is None or len(attitude.t) < 2:
        return down
    w, x, y, z = attitude.q.T
    axes = np.column_stack([2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)])
    near = seconds_to_nearest(t, attitude.t) <= MAX_AGE_S
    for k in range(3):
        down[near, k] = np.interp(t[near], attitude.t, axes[:, k])
    return down


def _ground_slope(force: Array, gravity: Array) -> Array:
    """Return the slope (n,) over 4 s of the sideways force on gravity's sideways part."""
    both = gravity[:, :2], force[:, :2]
    known = np.isfinite(gravity[:, 0])
    g, f = (np.where(known[:, None], x, 0.0) for x in both)
    mean_g, mean_f, share = _mean(g, SLOPE_S), _mean(f, SLOPE_S), _mean(known.astype(np.float64), SLOPE_S)
    varied = np.sum(_mean(g * g, SLOPE_S) - mean_g**2, axis=1)
    common = np.sum(_mean(g * f, SLOPE_S) - mean_g * mean_f, axis=1)
    slope: Array = np.where((varied > MIN_SLOPE_VARIANCE) & (share > 0.99), common / np.maximum(varied, 1e-12), np.nan)
    return slope


def seconds_to_nearest(t: Array, at: Array) -> Array:
    """Return the time (n,) in s from each time to the nearest of rising times ``at``."""
    after = np.clip(np.searchsorted(at, t), 1, max(len(at) - 1, 1))
    return np.minimum(np.abs(at[np.minimum(after, len(at) - 1)] - t), np.abs(t - at[after - 1]))


def _mean(x: Array, seconds: float) -> Array:
    """Return the centred moving mean of x (n,) or (n, k), over fewer samples at the ends."""
    count = max(round(seconds / STEP_S), 2)
    flat = x.reshape(len(x), -1)
    total = np.concatenate([np.zeros((1, flat.shape[1])), np.cumsum(flat, axis=0)])
    i = np.arange(len(x))
    low, high = np.maximum(i - count // 2, 0), np.minimum(i + count - count // 2, len(x))
    mean: Array = ((total[high] - total[low]) / (high - low)[:, None]).reshape(x.shape)
    return mean


def _variance(x: Array, seconds: float) -> Array:
    """Return the centred moving variance of x (n,) or (n, k); NaN near a NaN."""
    known = rotation.finite_rows(x.reshape(len(x), -1))
    if not known.any():
        return np.full(x.shape, np.nan)
    small = np.zeros_like(x)
    small[known] = x[known] - np.mean(x[known], axis=0)
    found: Array = np.maximum(_mean(small**2, seconds) - _mean(small, seconds) ** 2, 0.0)
    found[_mean(known.astype(np.float64), seconds) < 0.999] = np.nan
    return found


def true_runs(mask: Mask) -> Iterator[tuple[int, int]]:
    """Return index ranges [a, b) of neighbouring true samples."""
    edges = np.flatnonzero(np.diff(np.concatenate([[0], mask.astype(np.int8), [0]])))
    return ((int(a), int(b)) for a, b in zip(edges[::2], edges[1::2], strict=True))


def hold_last(t: Array, stream: Stream, nothing: float = 0.0) -> Array:
    """Return the last value (n,) of a stream's first column at or before ``t``.

    ``nothing`` where that value is too old.
    """
    x = stream.x.reshape(len(stream.t), -1)[:, 0]
    usual = float(median(np.diff(stream.t))) if len(stream.t) > 1 else MAX_AGE_S
    i = np.clip(np.searchsorted(stream.t, t, side="right") - 1, 0, len(stream.t) - 1)
    fresh = (t - stream.t[i] <= max(MAX_AGE_S, 5.0 * usual)) & np.isfinite(x[i])
    return np.where(fresh, x[i], nothing)
