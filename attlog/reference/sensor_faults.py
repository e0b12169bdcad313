"""Faults of accelerometer, compass and gyro that would mislead a smoother.

With mirrored compass axes, gyro spikes or a late accelerometer a smoother reports a small sigma for an attitude that is
degrees off. The dip of the earth's field, measured by a third sensor, decides between accelerometer and attitude.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from attlog.core import rotation, spans
from attlog.core.log_cache import cached_per_log
from attlog.core.sorting import median
from attlog.flight.model import Array, Attitude, FlightLog, guarded_part
from attlog.reference import accelerometer_checks, alignment, gyro_checks
from attlog.reference.compass_orientation import compass_orientation
from attlog.reference.model import SensorFault
from attlog.segments import Segments, model
from attlog.segments import model as gaps

# Kinds of segments whose mean specific force is gravity; the first in the log is used.
GRAVITY_SEGMENTS = ("rest", "idle", "hover")
# Dip errors: iron and a bad calibration stay below the first; wrong axes exceed the second.
MAX_DIP_ERROR_DEG, MIN_DIP_FAULT_DEG = 10.0, 25.0
# Smallest number of samples of each sensor in a quiet segment.
MIN_DIP_RECORDS = 10
DOWN = np.array([0.0, 0.0, 1.0])


def accelerometer_contradicted(seen: DipAngles | None, attitude: Attitude | None) -> str:
    """Return why the accelerometer's axes are wrong; empty if nothing shows it."""
    if seen is None or attitude is None:
        return ""
    off = abs(seen.by_force - seen.on_earth), abs(seen.by_attitude - seen.on_earth)
    if not (off[0] >= MIN_DIP_FAULT_DEG and off[1] <= MAX_DIP_ERROR_DEG):
        return ""
    return (
        f"the field {_dip_text(seen.by_force)} the level of the accelerometer and {_dip_text(seen.by_attitude)} "
        f"that of {attitude.source}; the earth's field there {_dip_text(seen.on_earth)} the horizon: "
        "the accelerometer's axes are wrong"
    )


def compass_contradicted(seen: DipAngles | None, attitude: Attitude | None, source: str) -> str:
    """Return why the compass does not measure the earth's field, or empty.

    Accelerometer and onboard attitude agree on a dip that differs from the model's.
    """
    if seen is None or attitude is None or abs(seen.by_force - seen.by_attitude) > MAX_DIP_ERROR_DEG:
        return ""
    if abs(seen.by_force - seen.on_earth) < MIN_DIP_FAULT_DEG:
        return ""
    return (
        f"the field of {source} {_dip_text(seen.by_force)} the level of the accelerometer and of {attitude.source}; "
        f"the earth's field there {_dip_text(seen.on_earth)} the horizon: "
        "iron is near"
    )


def _dip_text(angle: float) -> str:
    """Return a dip in words: ``points 60 deg below``."""
    return f"points {abs(angle):.0f} deg {'above' if angle < -0.5 else 'below'}"


class DipAngles(NamedTuple):
    """Dip (deg) by accelerometer, by an attitude, and by the earth model."""

    by_force: float
    by_attitude: float
    on_earth: float


def measure_dips(log: FlightLog, segments: Segments, attitude: Attitude | None) -> DipAngles | None:
    """Return the median dips over the quiet segments; None without any."""
    imu, model = log.replay_imu, alignment.earth_field(log)
    if imu is None or attitude is None or log.mag is None or model is None:
        return None
    kind = next((k for k in GRAVITY_SEGMENTS if segments.of(k)), None)
    if kind is None:
        return None
    mag = log.mags[log.mag].field
    by_force, by_attitude = [], []
    both = [gaps.select_rising(s.t_best, s.x) for s in (imu.acc, mag)]
    for one in segments.of(kind):
        force, field = (_span_mean(t, x, one.t0, one.t1) for t, x in both)
        flown = spans.between(attitude.t, one.t0, one.t1)
        if force is None or field is None or flown.stop - flown.start < MIN_DIP_RECORDS:
            continue
        down = np.mean(rotation.rotate_inverse(attitude.q[flown], DOWN), axis=0)
        by_force.append(_dip_deg(-force, field))
        by_attitude.append(_dip_deg(down, field))
    if not by_force:
        return None
    return DipAngles(float(median(by_force)), float(median(by_attitude)), model.inclination_deg)


def _span_mean(t: Array, x: Array, t0: float, t1: float) -> Array | None:
    """Return the mean (3,) of the samples in a span, or None."""
    inside = spans.between(t, t0, t1)
    if inside.stop - inside.start < MIN_DIP_RECORDS:
        return None
    mean: Array = np.mean(x[inside], axis=0)
    return mean if mean.any() else None


def _dip_deg(down: Array, field: Array) -> float:
    """Return the dip of a field in deg, given down."""
    size = math.sqrt(float(down @ down) * float(field @ field))
    return math.degrees(math.asin(max(-1.0, min(1.0, float(down @ field) / size)))) if size > 0 else math.nan


# Delay of the accelerometer: in earth axes its force must explain the changes of the GNSS velocity.

# Averaging time of the force, and step of its shift.
FORCE_STEP_S = 0.1
# Searched delay of the accelerometer, either way, and largest delay of the receiver.
MAX_DELAY_S, GNSS_LATE_S = 10.0, 0.6
# Smaller delays may be the receiver's.
MIN_DELAY_S = 0.3
# Interval of a change of velocity; shorter ones are noise.
VELOCITY_SPAN_S = 1.0
# Weaker acceleration (RMS) or fewer pairs show no delay; of long flights the first minutes are used.
MIN_ACCELERATION_M_S2, MIN_VELOCITY_PAIRS, MAX_FORCE_S = 0.5, 60, 300.0
# Ratio of squared residuals without and with the shift, and correlation with it.
MIN_DELAY_MISFIT_RATIO, MIN_DELAY_CORRELATION = 9.0, 0.8
# Step of the coarse search, and its ratio of squared residuals that starts the fine one.
COARSE_STEPS, MIN_COARSE_RATIO = 4, 2.0
# Correlation above which a force without shift is on time.
ON_TIME_CORRELATION = 0.95
FIX_3D = 3


def accelerometer_delay(log: FlightLog) -> float | None:
    """Return the accelerometer's delay in s; None if on time or unknown."""
    imu, attitude, gnss = log.replay_imu, log.onboard_attitude, next(iter(log.gnss), None)
    if imu is None or attitude is None or gnss is None:
        return None
    grid, force = _mean_force(*model.select_rising(imu.acc.t_best, imu.acc.x))
    good = rotation.finite_rows(gnss.vel_ned[:, :2]) & (gnss.fix >= FIX_3D)
    t, velocity = gnss.t[good], gnss.vel_ned[good, :2]
    if len(grid) < MIN_VELOCITY_PAIRS:
        return None
    first, last = _velocity_pairs(t, grid)
    if len(first) < MIN_VELOCITY_PAIRS:
        return None
    change = (velocity[last] - velocity[first]) / (t[last] - t[first])[:, None]
    change = change - median(change, axis=0)
    if np.sqrt(np.mean(np.sum(change**2, axis=1))) < MIN_ACCELERATION_M_S2:
        return None
    q, _ = rotation.slerp_in_segments(attitude.t, attitude.q, None, grid)
    spans = t[first] - grid[0], t[last] - grid[0]
    receivers = np.arange(0.0, GNSS_LATE_S, FORCE_STEP_S).tolist()

    def fit(shift: int, receiver_s: float) -> tuple[float, float]:
        return _delay_misfit(q, force, shift, receiver_s, spans, change)

    left, alike = min(fit(0, receiver_s) for receiver_s in receivers)
    if alike > ON_TIME_CORRELATION:
        return None
    steps = round(MAX_DELAY_S / FORCE_STEP_S)
    rough, near = min((fit(k, receivers[1]), k) for k in range(-steps, steps + 1, COARSE_STEPS))
    if rough[0] * MIN_COARSE_RATIO > left:
        return None
    (best, then), shift = min(
        (fit(k, r), k) for k in range(near - COARSE_STEPS, near + COARSE_STEPS + 1) for r in receivers
    )
    late = shift * FORCE_STEP_S
    return (
        late
        if abs(late) >= MIN_DELAY_S - 1e-9 and best * MIN_DELAY_MISFIT_RATIO < left and then > MIN_DELAY_CORRELATION
        else None
    )


def _mean_force(t: Array, force: Array) -> tuple[Array, Array]:
    """Return middles (n,) and means (n, 3) of the force over FORCE_STEP_S."""
    known = rotation.finite_rows(force)
    t, force = t[known], force[known]
    if len(t) < 2:
        return np.zeros(0), np.zeros((0, 3))
    index = ((t - t[0]) / FORCE_STEP_S).astype(np.int64)
    kept = index < round(MAX_FORCE_S / FORCE_STEP_S)
    index, force = index[kept], force[kept]
    count = np.bincount(index)
    with np.errstate(invalid="ignore", divide="ignore"):
        mean = np.column_stack([np.bincount(index, force[:, k]) for k in range(3)]) / count[:, None]
    return t[0] + FORCE_STEP_S * (np.arange(len(count)) + 0.5), mean


def _velocity_pairs(t: Array, grid: Array) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Return indices of fixes VELOCITY_SPAN_S apart, within the force record."""
    last = np.searchsorted(t, t + VELOCITY_SPAN_S)
    first = np.flatnonzero(last < len(t))
    last = last[first]
    near = (t[last] - t[first] < 1.6 * VELOCITY_SPAN_S) & (t[first] > grid[0] + 1.0) & (t[last] < grid[-1] - 1.0)
    return first[near], last[near]


def _delay_misfit(
    q: Array, force: Array, shift: int, receiver_s: float, spans: tuple[Array, Array], change: Array
) -> tuple[float, float]:
    """Return mean square residual and correlation of a shifted force."""
    moved = np.full_like(force, np.nan)
    if shift >= 0:
        moved[: len(force) - shift] = force[shift:]
    else:
        moved[-shift:] = force[:shift]
    earth = rotation.rotate(q, moved)[:, :2]
    known: NDArray[np.bool_] = np.asarray(rotation.finite_rows(earth))
    sums = np.concatenate([np.zeros((1, 2)), np.cumsum(np.where(known[:, None], earth, 0.0) * FORCE_STEP_S, axis=0)])
    missing = np.concatenate([[0], np.cumsum(~known)])
    place = [np.clip((s - receiver_s) / FORCE_STEP_S + 0.5, 0.0, len(force)) for s in spans]
    whole = np.arange(len(force) + 1)
    a, b = (np.column_stack([np.interp(p, whole, sums[:, k]) for k in range(2)]) for p in place)
    inside = missing[np.ceil(place[1]).astype(int)] == missing[np.floor(place[0]).astype(int)]
    if np.count_nonzero(inside) < max(MIN_VELOCITY_PAIRS, len(inside) // 2):
        return np.inf, 0.0
    by_force = ((b - a) / ((place[1] - place[0]) * FORCE_STEP_S)[:, None])[inside]
    by_force, own = by_force - median(by_force, axis=0), change[inside]
    alike = float(np.sum(by_force * own) / np.sqrt(np.sum(by_force**2) * np.sum(own**2) + 1e-30))
    return float(np.mean(np.sum((by_force - own) ** 2, axis=1))), alike


# Comparison of each sensor with the others, before a smoother is run.

GYRO, COMPASS, IRON = "gyro spikes", "compass orientation", "compass iron"
LATE, FRAME = "accelerometer delay", "accelerometer axes"


def find_sensor_faults(log: FlightLog, segments: Segments) -> dict[str, SensorFault]:
    """Return the faults of the replayed sensors by name; empty without any."""
    seen = guarded_part(log, "The dip of the field", lambda: _log_dips(log, segments), lambda: None)
    asked: dict[str, Callable[[], SensorFault | None]] = {
        GYRO: lambda: _spike_fault(log),
        COMPASS: lambda: _as_fault(wrong_mounting(log, segments)),
        IRON: lambda: _iron_fault(log, segments, seen),
        LATE: lambda: _delay_fault(log),
        FRAME: lambda: _as_fault(wrong_frame(log, segments)),
    }
    made = {name: guarded_part(log, f"The check {name}", ask, lambda: None) for name, ask in asked.items()}
    return {name: fault for name, fault in made.items() if fault is not None}


def wrong_mounting(log: FlightLog, segments: Segments) -> str:
    """Return why the axes of the compass in use are wrong, or empty."""
    if log.mag is None:
        return ""
    mag = log.mags[log.mag]
    found = compass_orientation(log, segments, mag)
    if found.verdict != "fault":
        return ""
    how = "has mirrored axes" if found.mirrored else f"is mounted rotated by {found.angle_deg:.0f} deg"
    return f"{mag.field.source} {how}: its field then turns {found.ratio:.1f} times better with the gyro"


def _iron_fault(log: FlightLog, segments: Segments, seen: DipAngles | None) -> SensorFault | None:
    """Return the fault of a wrong dip that no mounting explains."""
    if log.mag is None or not (why := compass_contradicted(seen, log.onboard_attitude, log.mags[log.mag].field.source)):
        return None
    return None if compass_orientation(log, segments, log.mags[log.mag]).verdict != "unknown" else SensorFault(why)


def wrong_frame(log: FlightLog, segments: Segments) -> str:
    """Return why dip or GNSS velocity show wrong axes or a large offset of the accelerometer, or empty."""
    why = accelerometer_contradicted(_log_dips(log, segments), log.onboard_attitude)
    return why or accelerometer_checks.accelerometer_fault(log, segments)


@cached_per_log
def _log_dips(log: FlightLog, segments: Segments) -> DipAngles | None:
    return measure_dips(log, segments, log.onboard_attitude)


def _as_fault(why: str) -> SensorFault | None:
    return SensorFault(why) if why else None


def _spike_fault(log: FlightLog) -> SensorFault | None:
    counted = None if log.replay_imu is None else gyro_checks.find_spikes(log.replay_imu)
    if counted is None or not counted.why:
        return None
    turned = round(counted.deg_per_min, 1)
    return SensorFault(counted.why, turned, "deg/min", counted.t, counted.count, misleads=counted.misleads)


def _delay_fault(log: FlightLog) -> SensorFault | None:
    late = accelerometer_delay(log)
    if late is None:
        return None
    why = (
        f"the specific force fits the change of the GNSS velocity only when it is taken {abs(late):.1f} s "
        f"{'later' if late > 0 else 'earlier'}: the accelerometer's times are wrong"
    )
    return SensorFault(why, round(late, 1), "s")
