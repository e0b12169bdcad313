"""The mean force, and an attitude's up, over windows of a phase in which the vehicle stands still."""

from __future__ import annotations

from itertools import product

import numpy as np
from numpy.typing import NDArray

from attlog.core import earth, rotation
from attlog.core.log_cache import cached_per_log
from attlog.estimators.evidence import mean_directions, still_windows
from attlog.flight.model import Array, Attitude, FlightLog, Imu, Stream
from attlog.health.check import Check, HealthCase, Verdict, graded, measured, unknown
from attlog.health.imu import Blocks, dead_reason, still_spans, stream_blocks, usable_imus
from attlog.reference import alignment
from attlog.segments import model
from attlog.segments.model import Segments


def still_directions(imu: Imu, use: NDArray[np.bool_], q: Array) -> tuple[Array, Array]:
    """Mean force (k, 3) in m/s^2 and up (k, 3), a unit vector, in body axes over still windows of samples ``use`` (n,).

    ``q`` (n, 4) is the attitude of the unit at the accelerometer's times, NaN where unknown. The force may have any
    size: an accelerometer with a wrong scale still shows a direction.
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
    """Angles (n,) in deg between vectors (n, 3)."""
    angle: Array = np.arctan2(np.sqrt(np.sum(np.cross(a, b) ** 2, axis=1)), np.sum(a * b, axis=1))
    return np.degrees(angle)


# The accelerometer: gravity's size at rest (scale), and its direction against the onboard attitude (mounting).

STANDARD_GRAVITY = 9.80665
TILT_LIMITS_DEG = (3.0, 10.0)
CLIMB_M_S = 8.0
"""Change of vertical speed that a flight may begin or end with: its share of the mean falls with time."""
MEAN_GRAVITY = "mean gravity"
"""What the direction of gravity is about where it is the mean force of a flight, in whose limits no level lies."""
MAX_SAMPLE_STEPS = 5.0
"""A sample stands for so many usual intervals at most: what was lost for longer is not known."""


def gravity_checks(case: HealthCase) -> list[Check]:
    """Check size and direction of gravity: at rest, else over a flight; the size of every unit."""
    log = case.log
    if not log.imus:
        return []
    imu = log.imus[log.imu or 0]
    if why := dead_reason(imu.acc.x, imu.acc.source, "accelerometer"):
        dead = Check("accelerometer_dead", "fault", why, threshold="every axis must change", sensor=imu.acc.source)
        return [dead, *gravity_at_rest(case)]
    rest, where = case.segments.mask(imu.acc.t, "rest"), "at rest"
    if rest.sum() < 10:
        rest, where = case.segments.mask(imu.acc.t, "idle"), "on the ground with motors on"
    sizes = gravity_at_rest(case)
    if not any(check.sensor == imu.acc.source and check.verdict != "unknown" for check in sizes):
        own = _short_rest(log, imu, rest, where) if rest.sum() >= 10 else gravity_in_flight(log, imu, case.segments)
        sizes = [own, *(check for check in sizes if check.verdict != "unknown" or own.verdict == "unknown")]
    return [*sizes, direction_check(log, imu, rest, case.segments, where)]


def expected_gravity(log: FlightLog) -> float:
    """Gravity in m/s^2 at the place of the flight, the standard value where it is unknown."""
    where = alignment.flight_place(log)
    return STANDARD_GRAVITY if where is None else earth.gravity(where[0], where[2])


def _short_rest(log: FlightLog, imu: Imu, rest: NDArray[np.bool_], where: str) -> Check:
    """Check the size of gravity by the median of a rest that is too short for blocks."""
    g = expected_gravity(log)
    value = float(np.median(rotation.length(imu.acc.x[rest])))
    verdict: Verdict = (
        "ok" if abs(value - g) <= GRAVITY_OFF_M_S2 else "warning" if is_usable_gravity(value) else "fault"
    )
    text = f"{where[0].upper()}{where[1:]} the accelerometer shows {value:.3f} m/s^2; gravity is {g:.3f}."
    limit = f"ok within {GRAVITY_OFF_M_S2} of {g:.2f}, fault outside {USABLE_M_S2[0]:.0f} to {USABLE_M_S2[1]:.0f}"
    found = Check("accelerometer_rest", verdict, text, round(value, 3), "m/s^2", limit, sensor=imu.acc.source)
    if found.is_trouble:
        found.evidence = [f"Its scale seems to be {value / g:.2f} of what it should be, or it has an offset."]
    return found


def gravity_in_flight(log: FlightLog, imu: Imu, segments: Segments) -> Check:
    """Check the size of gravity by the mean vertical force of a flight."""
    g, flown = expected_gravity(log), mean_force_in_flight(log, imu, segments)
    if flown is None:
        return unknown("gravity_in_flight", "No rest in the log, and no attitude to find gravity in flight.")
    mean, seconds = flown
    value = -float(mean[2])
    good = max(0.5, CLIMB_M_S / seconds)
    verdict = graded(abs(value - g), good, good + 1.0)
    text = f"The mean vertical force over {seconds:.0f} s is {value:.2f} m/s^2; gravity is {g:.2f}."
    limit = f"ok within {good:.1f} of {g:.2f}, fault beyond {good + 1.0:.1f}"
    return Check("gravity_in_flight", verdict, text, round(value, 3), "m/s^2", limit, sensor=imu.acc.source)


def mean_force_in_flight(log: FlightLog, imu: Imu, segments: Segments) -> tuple[Array, float] | None:
    """Mean specific force (3,) in earth axes by the onboard attitude and the seconds it is over; None without.

    Over seconds the vehicle's own acceleration averages to its change of speed by the
    time, so that gravity is left: manoeuvres do not matter, long records count. Each sample counts for the time that it
    stands for: a logger that thins its records keeps them unevenly.
    """
    onboard = log.onboard_attitude
    if onboard is None or onboard.rate < 5.0:
        return None
    use = segments.mask(imu.acc.t, "airborne")
    use = use if use.sum() >= 50 else np.ones(len(use), bool)
    q = rotation.slerp(onboard.t, imu_attitude(log, onboard), imu.acc.t[use])
    known = rotation.finite_rows(q)
    seconds = float(known.sum()) / imu.acc.rate if imu.acc.rate > 0 else 0.0
    if seconds < 5.0:
        return None
    force = rotation.rotate(q[known], imu.acc.x[use][known])
    return np.average(force, axis=0, weights=_sample_weights(imu.acc.t[use][known])), seconds


def _sample_weights(t: Array) -> Array:
    """The time (n,) s that each sample stands for: half of the way to both of its neighbours."""
    step = np.diff(t)
    half = 0.5 * np.minimum(step, MAX_SAMPLE_STEPS * float(np.median(step)))
    return np.append(half, 0.0) + np.insert(half, 0, 0.0)


def direction_check(log: FlightLog, imu: Imu, rest: NDArray[np.bool_], segments: Segments, where: str) -> Check:
    """Angle between measured gravity and the attitude's down, with the vehicle's trim put back."""
    onboard = log.onboard_attitude
    if onboard is None:
        return unknown("gravity_direction", "There is no onboard attitude to compare with.", "ok up to 3 deg")
    if rest.sum() < 10:
        return direction_in_flight(log, imu, segments)
    limit = "ok up to 3 deg, fault above 10 deg"
    q = rotation.slerp(onboard.t, imu_attitude(log, onboard), imu.acc.t[rest])
    whole = np.full((len(imu.acc.x), 4), np.nan)
    whole[rest] = q
    measured, up = still_directions(imu, rest, whole)
    if not len(measured):
        return unknown("gravity_direction", "The onboard attitude covers no still time on the ground.", limit)
    angle = float(np.median(degrees_between(measured, up)))
    text = f"Measured gravity and {log.onboard} differ by {angle:.3g} deg {where}."
    hint = mounting_hint(measured, up) if angle > TILT_LIMITS_DEG[1] else []
    verdict = graded(angle, *TILT_LIMITS_DEG)
    return Check("gravity_direction", verdict, text, round(angle, 3), "deg", limit, evidence=hint)


def direction_in_flight(log: FlightLog, imu: Imu, segments: Segments) -> Check:
    """The same from the mean specific force in flight, which holds less tightly."""
    limit = "ok up to 10 deg in flight, fault above 30 deg"
    flown = mean_force_in_flight(log, imu, segments)
    if flown is None:
        return unknown("gravity_direction", "No rest in the log, and too little attitude in flight.", limit)
    mean, seconds = flown
    angle = float(np.degrees(np.arctan2(np.hypot(mean[0], mean[1]), -mean[2])))
    text = f"Mean gravity over {seconds:.0f} s and {log.onboard} differ by {angle:.1f} deg."
    verdict = graded(angle, 10.0, 30.0)
    return Check("gravity_direction", verdict, text, round(angle, 2), "deg", limit, about=MEAN_GRAVITY)


def imu_attitude(log: FlightLog, attitude: Attitude) -> Array:
    """The attitude of the IMU (n, 4): the logged one with the vehicle's trim put back where it was taken out."""
    turned = log.parameters.trim if attitude.has_trim else None
    return attitude.q if turned is None else rotation.multiply(attitude.q, rotation.from_rotvec(turned))


def mounting_hint(measured: Array, up: Array) -> list[str]:
    """A sentence with the quarter turn that would explain the difference, none if none does."""
    for roll, pitch in product((0, 90, 180, 270), (0, 90, 270)):
        turn = rotation.from_euler(np.radians(roll), np.radians(pitch), 0.0)
        if (roll or pitch) and np.median(degrees_between(rotation.rotate(turn, measured), up)) < TILT_LIMITS_DEG[1]:
            name = " and ".join(f"{n} {a} deg" for n, a in (("roll", roll), ("pitch", pitch)) if a)
            return [f"A sensor mounted with {name} would show this."]
    return []


# Does the onboard estimator take so much off the accelerometer that its attitude is tilted by it?

G = 9.80665
ACC_BIAS_TILT_DEG = (1.0, 3.0)
"""A horizontal bias of 0.17 m/s^2 tilts the level by 1 deg, 0.5 m/s^2 by 3 deg."""
MAX_LEFT_SHARE = 0.5
"""It explains a tilt difference at rest where it leaves less than half of it."""


def onboard_acc_bias_check(case: HealthCase) -> list[Check]:
    """The tilt that the estimated accelerometer bias makes, and whether gravity at rest confirms or refutes it."""
    log, stream = case.log, case.log.estimator.acc_bias
    if stream is None:
        return []
    bias = np.median(stream.x, axis=0)
    tilt = float(np.degrees(np.arctan2(np.hypot(bias[0], bias[1]), G)))
    worst = "xy"[int(np.argmax(np.abs(bias[:2])))]
    size = float(bias["xy".index(worst)])
    least, most = ACC_BIAS_TILT_DEG
    limit = f"ok up to {least:.0f} deg of tilt, where gravity at rest does not show it up to {most:.0f}; fault above"
    text = (
        f"The onboard estimator subtracts {size:+.2f} m/s^2 from the accelerometer's {worst}: {tilt:.1f} deg of tilt."
    )
    both = tilt_with_and_without_bias(log, case.segments, bias) if tilt > ACC_BIAS_TILT_DEG[0] else None
    seen = []
    if both is not None and both[1] < MAX_LEFT_SHARE * both[0]:
        plain, corrected = both
        seen = [f"It explains {plain - corrected:.1f} of {plain:.1f} deg between {log.onboard} and gravity at rest."]
    verdict: Verdict = "fault" if tilt > ACC_BIAS_TILT_DEG[1] else "warning" if seen else "ok"
    return [Check("onboard_acc_bias", verdict, text, round(size, 3), "m/s^2", limit, evidence=seen)]


def tilt_with_and_without_bias(log: FlightLog, segments: Segments, bias: Array) -> tuple[float, float] | None:
    """Median angle in deg at rest between the attitude's up and the force: as measured, and without the bias."""
    imu, onboard = log.replay_imu, log.onboard_attitude
    if imu is None or onboard is None:
        return None
    rest = segments.mask(imu.acc.t, "rest")
    q = rotation.slerp(onboard.t, imu_attitude(log, onboard), imu.acc.t[rest])
    known = rotation.finite_rows(q)
    if known.sum() < 10:
        return None
    up = rotation.rotate_inverse(q[known], np.array([0.0, 0.0, -1.0]))
    found = []
    for force in (imu.acc.x[rest][known], imu.acc.x[rest][known] - bias):
        found.append(float(np.median(degrees_between(force / np.sqrt(np.sum(force**2, axis=1, keepdims=True)), up))))
    return found[0], found[1]


# Size of gravity at rest. One position shows neither an offset along the vertical nor a wrong scale alone.

# 3 % of gravity: tilts nothing but spoils heights; beyond the second an offset fitted in flight is not exact either.
GRAVITY_OFF_M_S2, GRAVITY_FAR_M_S2 = 0.3, 1.0
# Sizes outside are no calibration error: the accelerometer is wrong and every comparison with it.
USABLE_M_S2 = (7.0, 13.0)
# The floor covers the model of gravity and a level that is not exact.
GRAVITY_SIGMAS, GRAVITY_FLOOR_M_S2 = 4.0, 0.01
REST_LIMIT = (
    f"ok within {GRAVITY_OFF_M_S2} m/s^2 or {GRAVITY_SIGMAS:.0f} sigma of gravity, fault beyond {GRAVITY_FAR_M_S2:.0f}"
)
REST_SOURCE = "gravity at the place of the flight"


def is_usable_gravity(size: float) -> bool:
    """Return whether a size of gravity in m/s^2 may come from a calibration error."""
    return USABLE_M_S2[0] <= size <= USABLE_M_S2[1]


def gravity_at_rest(case: HealthCase) -> list[Check]:
    """Check the size of gravity of each usable unit; one ``unknown`` where the vehicle never stands still."""
    units = usable_imus(case)
    sizes = [(imu, size) for imu in units if (size := size_at_rest(case, imu)) is not None]
    found = [_rest_check(case, imu, size) for imu, size in sizes if 1.96 * _size_sigma(size) <= GRAVITY_OFF_M_S2]
    if found or not units:
        return found
    why = "The vehicle never stands still on the ground in this log, or shakes too much."
    return [unknown("accelerometer_rest", why, REST_LIMIT, sensor=units[0].acc.source, source=REST_SOURCE)]


def _size_sigma(size: Blocks) -> float:
    """Return the 1-sigma error of the size of gravity in m/s^2."""
    return float(size.sigma(GRAVITY_FLOOR_M_S2)[0])


@cached_per_log
def size_at_rest(case: HealthCase, imu: Imu) -> Blocks | None:
    """Return blocks (b, 1) of the size of the specific force in m/s^2 while the vehicle stands still."""
    acc = imu.acc
    size = Stream(acc.t, rotation.length(acc.x)[:, None], acc.unit, "", acc.source, t_sample=acc.t_sample)
    return stream_blocks(size, still_spans(case.segments)[0])


def _rest_check(case: HealthCase, imu: Imu, found: Blocks) -> Check:
    where, g = still_spans(case.segments)[1], expected_gravity(case.log)
    size, sigma = float(found.middle[0]), _size_sigma(found)
    off_from = max(GRAVITY_OFF_M_S2, GRAVITY_SIGMAS * sigma)
    verdict = graded(abs(size - g), off_from, max(GRAVITY_FAR_M_S2, off_from))
    text = f"{imu.acc.source} shows {size:.2f} ± {1.96 * sigma:.2f} m/s^2 {where}; gravity is {g:.2f}."
    check = Check(
        "accelerometer_rest",
        verdict,
        text,
        unit="m/s^2",
        threshold=REST_LIMIT,
        sensor=imu.acc.source,
        **measured(size, sigma, 3),
        n=found.samples,
        seconds=round(found.seconds, 1),
        source=REST_SOURCE,
    )
    if check.is_trouble:
        scale = f"Scale {size / g:.3f} or an offset: one position cannot show which." if np.isfinite(size) else ""
        check.why_no_setting = f"{scale} Log six positions, or a flight with GNSS.".strip()
        check.action = case.log.remedy("accelerometer")
    return check
