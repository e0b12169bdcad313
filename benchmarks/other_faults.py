"""Faults of sensors and onboard attitudes on which no threshold was chosen: ``python benchmarks/judge.py --others``.

Each changes a copy of a read log, into every unit of the sensor: from the middle of its flight (s) on, or all of it.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import NDArray

from attlog import segments
from attlog.core import rotation
from attlog.flight.model import FlightLog, Gnss

Array = NDArray[np.float64]
Fault = Callable[[FlightLog, float, np.random.Generator], None]
X, Y, Z = np.eye(3)
SOFT_IRON = np.array([[1.0, 0.1, -0.05], [0.1, 0.95, 0.08], [-0.05, 0.08, 1.05]])
COLUMNS = ("t", "lat", "lon", "alt", "vel_ned", "h_acc", "v_acc", "s_acc", "fix", "yaw", "utc_us")
METRES_PER_DEG = 111_320.0


def euler(roll: float, pitch: float, yaw: float) -> Array:
    return rotation.from_euler(*np.radians([roll, pitch, yaw]))


def gyro(dps: Array, share: Callable[[Array, float, float, float], NDArray[Any]]) -> Fault:
    """A rate (3,) deg/s times a share (n,) of times, the flight's middle, its begin and its end (s)."""

    def fault(log: FlightLog, middle: float, random: np.random.Generator) -> None:
        flown = segments.build(log).spans("airborne") or [(0.0, log.seconds)]
        a, b = max(flown, key=lambda span: span[1] - span[0])
        for imu in log.imus:
            imu.gyro.x = imu.gyro.x + np.radians(np.outer(share(imu.gyro.t_best, middle, a, b), dps))

    return fault


def field(change: Callable[[FlightLog, Array, Array, float], Array]) -> Fault:
    """A change of the field (n, 3) in uT at times (n,)."""

    def fault(log: FlightLog, middle: float, random: np.random.Generator) -> None:
        for mag in log.mags:
            mag.field.x = 1e-6 * change(log, mag.field.t_best, 1e6 * mag.field.x, middle)

    return fault


def by_throttle(log: FlightLog, t: Array, x: Array, middle: float) -> Array:
    if log.power.throttle is None:
        return x
    share = np.interp(
        t, log.power.throttle.t_best, np.nan_to_num(log.power.throttle.x.reshape(len(log.power.throttle.t), -1)[:, 0])
    )
    changed: Array = x + np.outer(np.clip(share, 0.0, 1.0), [25.0, -12.0, 15.0])
    return changed


def turned_late(log: FlightLog, t: Array, x: Array, middle: float) -> Array:
    return np.where((t >= middle)[:, None], rotation.rotate(euler(0.0, 0.0, 40.0), x), x)


def late_field(log: FlightLog, middle: float, random: np.random.Generator) -> None:
    for mag in log.mags:
        mag.field.t = mag.field.t + 0.25
        mag.field.t_sample = None if mag.field.t_sample is None else mag.field.t_sample + 0.25


def gyro_turned(log: FlightLog, middle: float, random: np.random.Generator) -> None:
    for imu in log.imus:
        imu.gyro.x = rotation.rotate(euler(1.5, -2.0, 2.0), imu.gyro.x)


def board_tilted(log: FlightLog, middle: float, random: np.random.Generator) -> None:
    for stream in [*(s for imu in log.imus for s in (imu.gyro, imu.acc)), *(mag.field for mag in log.mags)]:
        stream.x = rotation.rotate(euler(3.0, -2.6, 0.0), stream.x)


def force(scale: Array, late: Array, log: FlightLog, middle: float, random: np.random.Generator) -> None:
    for imu in log.imus:
        imu.acc.x = imu.acc.x * scale + np.outer(imu.acc.t_best >= middle, late)


def velocity(change: Callable[[Gnss, np.random.Generator], Array]) -> Fault:
    def fault(log: FlightLog, middle: float, random: np.random.Generator) -> None:
        for gnss in log.gnss:
            gnss.vel_ned = change(gnss, random)

    return fault


def wandering(gnss: Gnss, random: np.random.Generator) -> Array:
    """0.5 m/s of an error that lasts for 8 s."""
    keep = float(np.exp(-np.median(np.diff(gnss.t)) / 8.0))
    error = np.zeros((len(gnss.t), 3))
    for k in range(1, len(error)):
        error[k] = keep * error[k - 1] + 0.5 * np.sqrt(1.0 - keep**2) * random.standard_normal(3)
    wandered: Array = gnss.vel_ned + error
    return wandered


def position_jumps(log: FlightLog, middle: float, random: np.random.Generator) -> None:
    """20 m north for 20 s, with the velocity that leads there."""
    for gnss in log.gnss:
        there, back = (np.exp(-0.5 * ((gnss.t - middle - at) / 0.4) ** 2) for at in (-10.0, 10.0))
        gnss.lat = gnss.lat + np.where(np.abs(gnss.t - middle) < 10.0, 20.0 / METRES_PER_DEG, 0.0)
        gnss.vel_ned = gnss.vel_ned + 20.0 * np.outer(there - back, X)


def slow_and_late(log: FlightLog, middle: float, random: np.random.Generator) -> None:
    """At 1 Hz and 350 ms late."""
    for gnss in log.gnss:
        keep = np.unique(np.searchsorted(gnss.t, np.arange(gnss.t[0], gnss.t[-1], 1.0)))
        for name in COLUMNS:
            column = getattr(gnss, name)
            setattr(gnss, name, None if column is None else column[keep])
        gnss.t = gnss.t + 0.35


def onboard(turn: Callable[[Array, float, float], NDArray[Any]], about: str = "heading") -> Fault:
    """An angle in deg (n,) of times, the flight's middle and the log's length (s): heading, or pitch in earth axes."""

    def fault(log: FlightLog, middle: float, random: np.random.Generator) -> None:
        for attitude in log.attitudes.values():
            t = attitude.t if attitude.t_sample is None else attitude.t_sample
            angle = np.radians(turn(t, middle, log.seconds))
            axis = Z if about == "heading" else Y
            attitude.q = rotation.multiply(rotation.from_rotvec(np.outer(angle, axis)), attitude.q)
            attitude.normal = False

    return fault


def with_compass(deg: float, log: FlightLog, middle: float, random: np.random.Generator) -> None:
    """The onboard heading follows a turned compass."""
    for mag in log.mags:
        mag.field.x = rotation.rotate(euler(0.0, 0.0, -deg), mag.field.x)
    onboard(lambda t, middle, end: np.full(len(t), deg))(log, middle, random)


FAULTS: dict[str, Fault] = {
    "compass x scaled by 20 %": field(lambda log, t, x, m: x * [1.2, 1.0, 1.0]),
    "soft iron 10 %": field(lambda log, t, x, m: x @ SOFT_IRON.T),
    "field by throttle, 30 uT": field(by_throttle),
    "compass offset 35 uT": field(lambda log, t, x, m: x + np.array([-20.0, 15.0, 25.0])),
    "compass turned by 40 deg, second half": field(turned_late),
    "compass turned by 60 deg": field(lambda log, t, x, m: rotation.rotate(euler(0.0, 0.0, -60.0), x)),
    "compass 250 ms late": late_field,
    "gyro z drifts by 2 deg/s in 60 s": gyro(2 * Z, lambda t, m, a, b: np.clip((t - m + 30.0) / 60.0, 0.0, 1.0)),
    "gyro y steps by 1.5 deg/s at 30 %": gyro(1.5 * Y, lambda t, m, a, b: t >= a + 0.3 * (b - a)),
    "gyro z steps by 1.5 deg/s at 15 %": gyro(1.5 * Z, lambda t, m, a, b: t >= a + 0.15 * (b - a)),
    "gyro z steps by -2 deg/s at 80 %": gyro(-2 * Z, lambda t, m, a, b: t >= a + 0.8 * (b - a)),
    "gyro z off by 3 deg/s for 10 s": gyro(3 * Z, lambda t, m, a, b: np.abs(t - m) < 5.0),
    "gyro z steps twice": gyro(1.5 * Z, lambda t, m, a, b: 1.0 * (t > m - 12.0) - 2.0 * (t > m + 12.0)),
    "gyro turned by 3 deg": gyro_turned,
    "GNSS velocity turned by 5 deg": velocity(
        lambda gnss, r: rotation.rotate(euler(0.0, 0.0, 5.0), gnss.vel_ned)  # of a receiver on magnetic north
    ),
    "GNSS velocity wanders by 0.5 m/s": velocity(wandering),
    "GNSS jumps by 20 m": position_jumps,
    "GNSS at 1 Hz, 350 ms late": slow_and_late,
    "board mounted 4 deg tilted": board_tilted,
    "accelerometer z scaled by 5 %": partial(force, np.array([1.0, 1.0, 1.05]), np.zeros(3)),
    "accelerometer y steps by 0.5 m/s^2": partial(force, np.ones(3), 0.5 * Y),
    "onboard heading with compass 25 deg off": partial(with_compass, 25.0),
    "onboard heading with compass -20 deg off": partial(with_compass, -20.0),
    "onboard heading 25 deg off, second half": onboard(lambda t, m, end: 25.0 * np.clip((t - m) / 10.0, 0.0, 1.0)),
    "onboard heading drifts by 45 deg": onboard(lambda t, m, end: 45.0 * np.clip(t / end, 0.0, 1.0)),
    "onboard tilt 7 deg off for 20 s": onboard(lambda t, m, end: 7.0 * (np.abs(t - m) < 10.0), "tilt"),
    "onboard heading 170 deg off": onboard(lambda t, m, end: np.full(len(t), 170.0)),
}
