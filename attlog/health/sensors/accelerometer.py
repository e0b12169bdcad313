"""The accelerometer: gravity's size at rest (scale), and its direction against the onboard attitude (mounting)."""

from __future__ import annotations

from itertools import product

import numpy as np
from numpy.typing import NDArray

from attlog.base import earth, rotation
from attlog.flight.model import Array, Attitude, FlightLog, Imu
from attlog.health.model import Check, graded, not_judged
from attlog.health.sensors.gyro import alive
from attlog.health.sensors.stillness import degrees_between, still_directions
from attlog.reference import declination
from attlog.segments.model import Segments

STANDARD_GRAVITY = 9.80665
TILT_LIMITS_DEG = (3.0, 10.0)
CLIMB_M_S = 8.0
"""Change of vertical speed that a flight may begin or end with: its share of the mean falls with time."""
MEAN_GRAVITY = "mean gravity"
"""What the direction of gravity is about where it is the mean force of a flight, in whose limits no level lies."""
LOST = 5.0
"""A sample stands for so many usual intervals at most: what was lost for longer is not known."""


def checks(log: FlightLog, segments: Segments) -> list[Check]:
    """Alive, size of gravity, direction of gravity."""
    if not log.imus:
        return []
    imu = log.imus[log.imu or 0]
    found = alive("gravity", imu.acc.x, imu.acc.source)
    if found:
        return found
    rest = segments.mask(imu.acc.t, "rest")
    where = "at rest"
    if rest.sum() < 10:
        rest, where = segments.mask(imu.acc.t, "idle"), "on the ground with motors on"
    return [gravity(log, imu, rest, segments, where), direction(log, imu, rest, segments, where)]


def expected(log: FlightLog) -> float:
    """Gravity in m/s^2 at the place of the flight, the standard value where it is unknown."""
    where = declination.place(log)
    return STANDARD_GRAVITY if where is None else earth.gravity(where[0], where[2])


def gravity(log: FlightLog, imu: Imu, rest: NDArray[np.bool_], segments: Segments, where: str) -> Check:
    """Size of gravity in the specific force: its norm at rest (``where``), else its mean in flight."""
    g = expected(log)
    if rest.sum() < 10:
        return gravity_in_flight(log, imu, segments, g)
    value = float(np.median(np.sqrt(np.sum(imu.acc.x[rest] ** 2, axis=1))))
    verdict = "fault" if not 7.0 <= value <= 13.0 else graded(abs(value - g), 0.3, np.inf)
    text = f"{where[0].upper()}{where[1:]} the accelerometer shows {value:.3f} m/s^2; gravity is {g:.3f}."
    limit = f"ok within 0.3 of {g:.2f}, fault outside 7 to 13"
    scale = [f"Its scale seems to be {value / g:.2f} of what it should be, or it has an offset."]
    return Check("gravity", verdict, text, round(value, 3), "m/s^2", limit, evidence=scale if verdict != "ok" else [])


def gravity_in_flight(log: FlightLog, imu: Imu, segments: Segments, g: float) -> Check:
    """The same without rest in the log."""
    flown = in_flight(log, imu, segments)
    if flown is None:
        return not_judged("gravity in flight", "No rest in the log, and no attitude to find gravity in flight.")
    mean, seconds = flown
    value = -float(mean[2])
    good = max(0.5, CLIMB_M_S / seconds)
    verdict = graded(abs(value - g), good, good + 1.0)
    text = f"The mean vertical force over {seconds:.0f} s is {value:.2f} m/s^2; gravity is {g:.2f}."
    limit = f"ok within {good:.1f} of {g:.2f}, fault beyond {good + 1.0:.1f}"
    return Check("gravity in flight", verdict, text, round(value, 3), "m/s^2", limit)


def in_flight(log: FlightLog, imu: Imu, segments: Segments) -> tuple[Array, float] | None:
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
    q = rotation.slerp(onboard.t, of_imu(log, onboard), imu.acc.t[use])
    known = rotation.finite(q)
    seconds = float(known.sum()) / imu.acc.rate if imu.acc.rate > 0 else 0.0
    if seconds < 5.0:
        return None
    force = rotation.rotate(q[known], imu.acc.x[use][known])
    return np.average(force, axis=0, weights=_held(imu.acc.t[use][known])), seconds


def _held(t: Array) -> Array:
    """The time (n,) s that each sample stands for: half of the way to both of its neighbours."""
    step = np.diff(t)
    half = 0.5 * np.minimum(step, LOST * float(np.median(step)))
    return np.append(half, 0.0) + np.insert(half, 0, 0.0)


def direction(log: FlightLog, imu: Imu, rest: NDArray[np.bool_], segments: Segments, where: str) -> Check:
    """Angle between measured gravity and the attitude's down, with the vehicle's trim put back."""
    onboard = log.onboard_attitude
    if onboard is None:
        return not_judged("gravity direction", "There is no onboard attitude to compare with.", "ok up to 3 deg")
    if rest.sum() < 10:
        return direction_in_flight(log, imu, segments)
    limit = "ok up to 3 deg, fault above 10 deg"
    q = rotation.slerp(onboard.t, of_imu(log, onboard), imu.acc.t[rest])
    whole = np.full((len(imu.acc.x), 4), np.nan)
    whole[rest] = q
    measured, up = still_directions(imu, rest, whole)
    if not len(measured):
        return not_judged("gravity direction", "The onboard attitude covers no still time on the ground.", limit)
    angle = float(np.median(degrees_between(measured, up)))
    text = f"Measured gravity and {log.onboard} differ by {angle:.3g} deg {where}."
    hint = mounting_hint(measured, up) if angle > TILT_LIMITS_DEG[1] else []
    verdict = graded(angle, *TILT_LIMITS_DEG)
    return Check("gravity direction", verdict, text, round(angle, 3), "deg", limit, evidence=hint)


def direction_in_flight(log: FlightLog, imu: Imu, segments: Segments) -> Check:
    """The same from the mean specific force in flight, which holds less tightly."""
    limit = "ok up to 10 deg in flight, fault above 30 deg"
    flown = in_flight(log, imu, segments)
    if flown is None:
        return not_judged("gravity direction", "No rest in the log, and too little attitude in flight.", limit)
    mean, seconds = flown
    angle = float(np.degrees(np.arctan2(np.hypot(mean[0], mean[1]), -mean[2])))
    text = f"Mean gravity over {seconds:.0f} s and {log.onboard} differ by {angle:.1f} deg."
    verdict = graded(angle, 10.0, 30.0)
    return Check("gravity direction", verdict, text, round(angle, 2), "deg", limit, about=MEAN_GRAVITY)


def of_imu(log: FlightLog, attitude: Attitude) -> Array:
    """The attitude of the IMU (n, 4): the logged one with the vehicle's trim put back where it was taken out."""
    turned = log.trim if attitude.has_trim else None
    return attitude.q if turned is None else rotation.multiply(attitude.q, rotation.from_rotvec(turned))


def mounting_hint(measured: Array, up: Array) -> list[str]:
    """A sentence with the quarter turn that would explain the difference, none if none does."""
    for roll, pitch in product((0, 90, 180, 270), (0, 90, 270)):
        turn = rotation.from_euler(np.radians(roll), np.radians(pitch), 0.0)
        if (roll or pitch) and np.median(degrees_between(rotation.rotate(turn, measured), up)) < TILT_LIMITS_DEG[1]:
            name = " and ".join(f"{n} {a} deg" for n, a in (("roll", roll), ("pitch", pitch)) if a)
            return [f"A sensor mounted with {name} would show this."]
    return []
