"""The accelerometer: gravity's size at rest (scale), and its direction against the onboard attitude (mounting)."""

from __future__ import annotations

from itertools import product

import numpy as np
from numpy.typing import NDArray

from attlog import earth, rotation
from attlog.audit.gyro import alive
from attlog.audit.model import Check, graded, not_judged
from attlog.flight.model import Array, Attitude, FlightLog, Imu
from attlog.reference import declination, trim
from attlog.segments.model import Segments

STANDARD_GRAVITY = 9.80665
TILT_LIMITS_DEG = (3.0, 10.0)


def checks(log: FlightLog, segments: Segments) -> list[Check]:
    """Alive, size of gravity, direction of gravity."""
    if not log.imus:
        return []
    imu = log.imus[log.imu or 0]
    found = alive("gravity", imu.acc.x, imu.acc.source)
    if found:
        return found
    mask = segments.mask(imu.acc.t, "rest")
    return [gravity(log, imu, mask, segments), direction(log, imu, mask)]


def expected(log: FlightLog) -> float:
    """Gravity in m/s^2 at the place of the flight, the standard value where it is unknown."""
    where = declination.place(log)
    return STANDARD_GRAVITY if where is None else earth.gravity(where[0], where[2])


def gravity(log: FlightLog, imu: Imu, rest: NDArray[np.bool_], segments: Segments) -> Check:
    """Specific force at rest against gravity; without rest that of the flight's half seconds, which holds less tightly."""
    g = expected(log)
    if rest.sum() >= 10:
        value = float(np.median(np.sqrt(np.sum(imu.acc.x[rest] ** 2, axis=1))))
        text = f"At rest the accelerometer shows {value:.3f} m/s^2; gravity is {g:.3f}."
        tolerance, limit = 0.3, f"good within 0.3 of {g:.2f}, bad outside 7 to 13"
    else:
        value = in_flight(imu, segments)
        text = f"Without rest in the log: in half seconds of flight {value:.2f} m/s^2; gravity is {g:.2f}."
        tolerance, limit = 1.5, f"good within 1.5 of {g:.2f} without rest, bad outside 6 to 15"
    outside = not 7.0 <= value <= 13.0 if tolerance == 0.3 else not 6.0 <= value <= 15.0
    verdict = "bad" if outside else graded(abs(value - g), tolerance, np.inf)
    if outside or (verdict == "look" and tolerance == 0.3):
        text += f" Its scale seems to be {value / g:.2f} of what it should be, or it has an offset."
    elif verdict == "look":
        text += " Manoeuvres or a wrong scale explain this."
    return Check("gravity", verdict, text, round(value, 3), "m/s^2", limit)


def in_flight(imu: Imu, segments: Segments, width: float = 0.5) -> float:
    """Median size in m/s^2 of the mean specific force over half seconds: vibration cancels, the load factor stays."""
    airborne = segments.mask(imu.acc.t, "airborne")
    use = airborne if airborne.sum() >= 50 else np.ones(len(airborne), bool)
    t, x = imu.acc.t[use], imu.acc.x[use]
    starts = np.flatnonzero(np.diff(np.floor((t - t[0]) / width), prepend=-1.0))
    counts = np.diff(np.append(starts, len(t)))
    means = np.add.reduceat(x, starts, axis=0) / counts[:, None]
    return float(np.median(np.sqrt(np.sum(means**2, axis=1))))


def direction(log: FlightLog, imu: Imu, rest: NDArray[np.bool_]) -> Check:
    """Angle between measured gravity at rest and the attitude's down, with the vehicle's trim put back."""
    limit = "good up to 3 deg, bad above 10 deg"
    onboard = log.attitudes.get(log.onboard or "")
    if onboard is None:
        return not_judged("gravity direction", "There is no onboard attitude to compare with.", limit)
    if rest.sum() < 10:
        return not_judged("gravity direction", "The vehicle never rests with motors off in this log.", limit)
    q = rotation.slerp(onboard.t, of_imu(log, onboard), imu.acc.t[rest])
    known = np.isfinite(q).all(axis=1)
    if known.sum() < 10:
        return not_judged("gravity direction", "The onboard attitude does not cover the rest.", limit)
    up = rotation.rotate_inverse(q[known], np.array([0.0, 0.0, -1.0]))
    measured = imu.acc.x[rest][known]
    measured = measured / np.sqrt(np.sum(measured**2, axis=1, keepdims=True))
    angle = float(np.median(degrees_between(measured, up)))
    text = f"Measured gravity and {log.onboard} differ by {angle:.2f} deg at rest."
    if angle > TILT_LIMITS_DEG[1]:
        text += mounting_hint(measured, up)
    return Check("gravity direction", graded(angle, *TILT_LIMITS_DEG), text, round(angle, 3), "deg", limit)


def of_imu(log: FlightLog, attitude: Attitude) -> Array:
    """The attitude of the IMU (n, 4): the logged one with the vehicle's trim put back where it was taken out."""
    turned = trim.of(log) if attitude.has_trim else None
    return attitude.q if turned is None else rotation.multiply(attitude.q, rotation.from_rotvec(turned))


def degrees_between(a: Array, b: Array) -> Array:
    """Angles (n,) in deg between unit vectors (n, 3)."""
    return np.degrees(np.arctan2(np.sqrt(np.sum(np.cross(a, b) ** 2, axis=1)), np.sum(a * b, axis=1)))


def mounting_hint(measured: Array, up: Array) -> str:
    """A sentence with the quarter turn that would explain the difference, empty if none does."""
    for roll, pitch in product((0, 90, 180, 270), (0, 90, 270)):
        turn = rotation.from_euler(np.radians(roll), np.radians(pitch), 0.0)
        if (roll or pitch) and np.median(degrees_between(rotation.rotate(turn, measured), up)) < TILT_LIMITS_DEG[1]:
            name = " and ".join(f"{n} {a} deg" for n, a in (("roll", roll), ("pitch", pitch)) if a)
            return f" A sensor mounted with {name} would show this."
    return " Either the sensor's mounting or the onboard attitude is wrong."
