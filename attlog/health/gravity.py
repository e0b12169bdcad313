"""Accelerometer against gravity: dead, size at rest and in flight (scale), and direction (mounting, level)."""

from __future__ import annotations

from functools import partial
from itertools import product

import numpy as np
from numpy.typing import NDArray

from attlog.core import earth, rotation
from attlog.core.kinematics import known_earth_force, tilt_deg
from attlog.core.log_cache import cached_per_log
from attlog.core.sorting import median
from attlog.estimators.evidence import mean_directions, still_windows
from attlog.flight.model import Array, Attitude, FlightLog, Imu, Stream
from attlog.health.check import Check, HealthCase, Verdict, graded, unknown
from attlog.health.flown import still_spans
from attlog.health.imu import Blocks, dead_reason, stream_blocks, usable_imus
from attlog.reference import alignment
from attlog.segments import model
from attlog.segments.model import Segments

# Gravity in m/s^2 where the position is unknown.
STANDARD_GRAVITY = 9.80665
# Limits of the size of gravity: 3 % has no effect on tilt but on height; above the second an offset fitted in flight is
# inexact, too.
GRAVITY_OFF_M_S2, GRAVITY_FAR_M_S2 = 0.3, 1.0
# Range of calibration errors; outside, the accelerometer is faulty and unusable for comparisons.
USABLE_M_S2 = (7.0, 13.0)
# Significance, and error of the gravity model and of a tilted rest.
GRAVITY_SIGMAS, GRAVITY_FLOOR_M_S2 = 4.0, 0.01
REST_LIMIT = (
    f"ok within {GRAVITY_OFF_M_S2} m/s^2 or {GRAVITY_SIGMAS:.0f} sigma of gravity, fault beyond {GRAVITY_FAR_M_S2:.0f}"
)
REST_SOURCE = "gravity at the place of the flight"
# Limits of the tilt at rest (level calibrated on a slope, other mounting), and by the mean force of a flight.
TILT_LIMITS_DEG, FLOWN_TILT_LIMITS_DEG = (3.0, 10.0), (10.0, 30.0)
# Name of the direction check by mean force of a flight, too coarse for a level calibration.
MEAN_GRAVITY = "mean gravity"
# Maximum change of vertical speed over a flight, whose effect on the mean falls with time; limit of the size in flight.
CLIMB_M_S, FLOWN_OFF_M_S2 = 8.0, 0.5
# Maximum weight of a sample in median intervals, at gaps.
MAX_SAMPLE_STEPS = 5.0
# Minimum samples at rest, samples and time in flight, and attitude rate (slower ones smear manoeuvres).
MIN_SAMPLES, MIN_FLOWN_SAMPLES, MIN_FLOWN_S, MIN_ATTITUDE_HZ = 10, 50, 5.0, 5.0


def gravity_checks(case: HealthCase) -> list[Check]:
    """Check size and direction of gravity at rest, else over a flight."""
    log = case.log
    if not log.imus:
        return []
    imu = log.imus[log.imu or 0]
    if why := dead_reason(imu.acc.x, imu.acc.source, "accelerometer"):
        dead = Check("accelerometer_dead", "fault", why, threshold="every axis must change", sensor=imu.acc.source)
        return [dead, *gravity_at_rest(case)]
    rest, where = case.segments.mask(imu.acc.t, "rest"), "at rest"
    if rest.sum() < MIN_SAMPLES:
        rest, where = case.segments.mask(imu.acc.t, "idle"), "on the ground with motors on"
    still = bool(rest.sum() >= MIN_SAMPLES)
    sizes = gravity_at_rest(case)
    if not any(check.sensor == imu.acc.source and check.verdict != "unknown" for check in sizes):
        own = _short_rest(log, imu, rest, where) if still else gravity_in_flight(log, imu, case.segments)
        sizes = [own, *(check for check in sizes if check.verdict != "unknown" or own.verdict == "unknown")]
    if log.onboard_attitude is None:
        no_attitude = "There is no onboard attitude to compare with."
        return [*sizes, unknown("gravity_direction", no_attitude, "ok up to 3 deg")]
    direction = direction_at_rest(log, imu, rest, where) if still else direction_in_flight(log, imu, case.segments)
    return [*sizes, direction]


def expected_gravity(log: FlightLog) -> float:
    """Return gravity in m/s^2 at the place of the flight, the standard value where it is unknown."""
    where = alignment.flight_place(log)
    return STANDARD_GRAVITY if where is None else earth.gravity(where[0], where[2])


def is_usable_gravity(size: float) -> bool:
    """Return whether a size of gravity in m/s^2 may come from a calibration error."""
    return USABLE_M_S2[0] <= size <= USABLE_M_S2[1]


# Size at rest. One position cannot separate a vertical offset from a scale error.


def gravity_at_rest(case: HealthCase) -> list[Check]:
    """Check the size of gravity of each usable IMU; one ``unknown`` without rest."""
    units = usable_imus(case)
    sizes = [(imu, size) for imu in units if (size := size_at_rest(case, imu)) is not None]
    found = [_rest_check(case, imu, size) for imu, size in sizes if 1.96 * _size_sigma(size) <= GRAVITY_OFF_M_S2]
    if found or not units:
        return found
    why = "The vehicle never stands still on the ground in this log, or shakes too much."
    return [unknown("accelerometer_rest", why, REST_LIMIT, sensor=units[0].acc.source, source=REST_SOURCE)]


def _size_sigma(size: Blocks) -> float:
    return float(size.sigma(GRAVITY_FLOOR_M_S2)[0])


@cached_per_log
def size_at_rest(case: HealthCase, imu: Imu) -> Blocks | None:
    """Return blocks (b, 1) of the specific force's length in m/s^2 at rest."""
    return stream_blocks(force_size(imu.acc), still_spans(case.segments)[0])


def force_size(acc: Stream) -> Stream:
    """Return the length (n, 1) of an accelerometer's samples."""
    return Stream(acc.t, rotation.length(acc.x)[:, None], acc.unit, "", acc.source, t_sample=acc.t_sample)


def _rest_check(case: HealthCase, imu: Imu, found: Blocks) -> Check:
    where, g = still_spans(case.segments)[1], expected_gravity(case.log)
    size, sigma = float(found.middle[0]), _size_sigma(found)
    off_from = max(GRAVITY_OFF_M_S2, GRAVITY_SIGMAS * sigma)
    verdict = graded(abs(size - g), off_from, max(GRAVITY_FAR_M_S2, off_from))
    text = f"{imu.acc.source} shows {size:.2f} ± {1.96 * sigma:.2f} m/s^2 {where}; gravity is {g:.2f}."
    check = Check("accelerometer_rest", verdict, text, unit="m/s^2", threshold=REST_LIMIT, sensor=imu.acc.source)
    check.n, check.seconds, check.source = found.samples, round(found.seconds, 1), REST_SOURCE
    check.measure(size, sigma, 3)
    if check.is_trouble:
        scale = f"Scale {size / g:.3f} or an offset: one position cannot show which." if np.isfinite(size) else ""
        check.why_no_setting = f"{scale} Log six positions, or a flight with GNSS.".strip()
        check.action = case.log.remedy("accelerometer")
    return check


def _short_rest(log: FlightLog, imu: Imu, rest: NDArray[np.bool_], where: str) -> Check:
    """Check the size of gravity by the median of a rest too short for blocks."""
    g = expected_gravity(log)
    value = float(median(rotation.length(imu.acc.x[rest])))
    off = abs(value - g) > GRAVITY_OFF_M_S2
    verdict: Verdict = "ok" if not off else "warning" if is_usable_gravity(value) else "fault"
    text = f"{where[0].upper()}{where[1:]} the accelerometer shows {value:.3f} m/s^2; gravity is {g:.3f}."
    limit = f"ok within {GRAVITY_OFF_M_S2} of {g:.2f}, fault outside {USABLE_M_S2[0]:.0f} to {USABLE_M_S2[1]:.0f}"
    check = Check("accelerometer_rest", verdict, text, round(value, 3), "m/s^2", limit, sensor=imu.acc.source)
    if check.is_trouble:
        check.evidence = [f"Its scale seems to be {value / g:.2f} of what it should be, or it has an offset."]
    return check


# Size and direction by the mean force of a flight.


def mean_force_in_flight(log: FlightLog, imu: Imu, segments: Segments) -> tuple[Array, float] | None:
    """Return the mean specific force (3,) in earth axes in flight, and its seconds.

    Rotated by the onboard attitude; None from too few samples. Mean acceleration is change of speed over time, which is
    small, so the mean is gravity. Samples are weighted by time, because thinned logs are uneven.
    """
    onboard = log.onboard_attitude
    if onboard is None or onboard.rate < MIN_ATTITUDE_HZ or imu.acc.rate <= 0:
        return None
    use = segments.mask(imu.acc.t, "airborne")
    use = use if use.sum() >= MIN_FLOWN_SAMPLES else np.ones(len(use), bool)
    t, force = known_earth_force(imu.acc.t[use], imu.acc.x[use], onboard.t, imu_attitude(log, onboard))
    seconds = len(t) / imu.acc.rate
    if seconds < MIN_FLOWN_S:
        return None
    step = np.diff(t)
    half = 0.5 * np.minimum(step, MAX_SAMPLE_STEPS * float(median(step)))
    return np.average(force, axis=0, weights=np.append(half, 0.0) + np.insert(half, 0, 0.0)), seconds


def gravity_in_flight(log: FlightLog, imu: Imu, segments: Segments) -> Check:
    """Check the size of gravity by the mean vertical force of a flight."""
    g, flown = expected_gravity(log), mean_force_in_flight(log, imu, segments)
    if flown is None:
        return unknown("gravity_in_flight", "No rest in the log, and no attitude to find gravity in flight.")
    mean, seconds = flown
    value = -float(mean[2])
    good = max(FLOWN_OFF_M_S2, CLIMB_M_S / seconds)
    verdict = graded(abs(value - g), good, good + 1.0)
    text = f"The mean vertical force over {seconds:.0f} s is {value:.2f} m/s^2; gravity is {g:.2f}."
    limit = f"ok within {good:.1f} of {g:.2f}, fault beyond {good + 1.0:.1f}"
    return Check("gravity_in_flight", verdict, text, round(value, 3), "m/s^2", limit, sensor=imu.acc.source)


def direction_in_flight(log: FlightLog, imu: Imu, segments: Segments) -> Check:
    """Check down of the attitude against the mean specific force of a flight."""
    limit = "ok up to 10 deg in flight, fault above 30 deg"
    flown = mean_force_in_flight(log, imu, segments)
    if flown is None:
        return unknown("gravity_direction", "No rest in the log, and too little attitude in flight.", limit)
    mean, seconds = flown
    angle = tilt_deg(mean)
    text = f"Mean gravity over {seconds:.0f} s and {log.onboard} differ by {angle:.1f} deg."
    verdict = graded(angle, *FLOWN_TILT_LIMITS_DEG)
    return Check("gravity_direction", verdict, text, round(angle, 2), "deg", limit, about=MEAN_GRAVITY)


# Direction at rest.


def direction_at_rest(log: FlightLog, imu: Imu, rest: NDArray[np.bool_], where: str) -> Check:
    """Check the angle between gravity at rest and down of the IMU's attitude."""
    onboard = log.onboard_attitude
    assert onboard is not None
    limit = "ok up to 3 deg, fault above 10 deg"
    q = np.full((len(imu.acc.x), 4), np.nan)
    q[rest] = rotation.slerp(onboard.t, imu_attitude(log, onboard), imu.acc.t[rest])
    force, up = still_directions(imu, rest, q)
    if not len(force):
        return unknown("gravity_direction", "The onboard attitude covers no still time on the ground.", limit)
    angle = float(median(degrees_between(force, up)))
    text = f"Measured gravity and {log.onboard} differ by {angle:.3g} deg {where}."
    hint = mounting_hint(force, up) if angle > TILT_LIMITS_DEG[1] else []
    verdict = graded(angle, *TILT_LIMITS_DEG)
    return Check("gravity_direction", verdict, text, round(angle, 3), "deg", limit, evidence=hint)


def still_directions(imu: Imu, use: NDArray[np.bool_], q: Array) -> tuple[Array, Array]:
    """Return mean force (k, 3) in m/s^2 and up (k, 3), a unit vector, in body axes over still windows.

    ``use`` (n,) selects samples; ``q`` (n, 4) is the unit's attitude at the accelerometer's times, NaN where unknown.
    The length of the force is not tested: with a wrong scale the direction is still valid.
    """
    n = min(len(imu.acc.t_best), len(imu.gyro.x))
    t, x = model.select_rising(
        np.where(use, imu.acc.t_best, np.nan)[:n], np.column_stack([imu.gyro.x, imu.acc.x, q])[:n]
    )
    windows = still_windows(t, x[:, :3], x[:, 3:6], near_m_s2=np.inf)
    force, up = mean_directions(windows, t, x[:, 3:6], x[:, 6:])
    known = np.isfinite(force[:, 0]) & np.isfinite(up[:, 0])
    return force[known], up[known]


def degrees_between(a: Array, b: Array) -> Array:
    """Return the angles (n,) in deg between vectors (n, 3)."""
    angle: Array = np.arctan2(np.sqrt(np.sum(np.cross(a, b) ** 2, axis=1)), np.sum(a * b, axis=1))
    return np.degrees(angle)


def imu_attitude(log: FlightLog, attitude: Attitude) -> Array:
    """Return the attitude (n, 4) of the IMU: the logged one with the trim removed."""
    trim = log.parameters.trim if attitude.has_trim else None
    return attitude.q if trim is None else rotation.multiply(attitude.q, rotation.from_rotvec(trim))


def mounting_hint(force: Array, up: Array) -> list[str]:
    """Return a sentence with the 90 deg rotation that explains a difference, if any."""
    for roll, pitch in product((0, 90, 180, 270), (0, 90, 270)):
        turn = rotation.from_euler(np.radians(roll), np.radians(pitch), 0.0)
        if (roll or pitch) and median(degrees_between(rotation.rotate(turn, force), up)) < TILT_LIMITS_DEG[1]:
            name = " and ".join(f"{n} {a} deg" for n, a in (("roll", roll), ("pitch", pitch)) if a)
            return [f"A sensor mounted with {name} would show this."]
    return []


# Accelerometer bias of the onboard estimator, and whether gravity at rest confirms it.

# A horizontal bias of 0.17 m/s^2 tilts the level by 1 deg, 0.5 m/s^2 by 3 deg.
BIAS_TILT_DEG = (1.0, 3.0)
# A bias explains a tilt difference at rest where it leaves less than half of it.
MAX_LEFT_SHARE = 0.5


def onboard_acc_bias_check(case: HealthCase) -> list[Check]:
    """Check the tilt equivalent of the onboard accelerometer bias."""
    log, stream = case.log, case.log.estimator.acc_bias
    if stream is None:
        return []
    bias = median(stream.x, axis=0)
    tilt = float(np.degrees(np.arctan2(np.hypot(bias[0], bias[1]), STANDARD_GRAVITY)))
    axis = int(np.argmax(np.abs(bias[:2])))
    least, most = BIAS_TILT_DEG
    limit = f"ok up to {least:.0f} deg of tilt, where gravity at rest does not show it up to {most:.0f}; fault above"
    text = f"The onboard estimator subtracts {bias[axis]:+.2f} m/s^2 from the accelerometer's {'xy'[axis]}: "
    text += f"{tilt:.1f} deg of tilt."
    both = tilt_with_and_without_bias(log, case.segments, bias) if tilt > least else None
    made = partial(Check, "onboard_acc_bias", value=round(float(bias[axis]), 3), unit="m/s^2", threshold=limit)
    if both is None or both[1] >= MAX_LEFT_SHARE * both[0]:
        return [made("fault" if tilt > most else "ok", text)]
    plain, corrected = both
    seen = [f"It explains {plain - corrected:.1f} of {plain:.1f} deg between {log.onboard} and gravity at rest."]
    return [made("fault" if tilt > most else "warning", text, evidence=seen)]


def tilt_with_and_without_bias(log: FlightLog, segments: Segments, bias: Array) -> tuple[float, float] | None:
    """Return the median angle in deg at rest between up and force, with and without bias."""
    imu, onboard = log.replay_imu, log.onboard_attitude
    if imu is None or onboard is None:
        return None
    rest = segments.mask(imu.acc.t, "rest")
    q = rotation.slerp(onboard.t, imu_attitude(log, onboard), imu.acc.t[rest])
    known = rotation.finite_rows(q)
    if known.sum() < MIN_SAMPLES:
        return None
    up = rotation.rotate_inverse(q[known], np.array([0.0, 0.0, -1.0]))
    plain, corrected = (
        float(median(degrees_between(force, up))) for force in (imu.acc.x[rest][known], imu.acc.x[rest][known] - bias)
    )
    return plain, corrected
