"""Made cases: units that stand still, fly and stand again, with errors of known size, and a smoother's word."""

from __future__ import annotations

import numpy as np

from attlog.flight.model import Array, FlightLog, Imu, Stream
from attlog.health.check import Check, HealthCase, MotionAttitude
from attlog.reference.model import Reference
from attlog.segments import Segment, Segments
from tests.segments.flights import imu_log

G = 9.80665
REST_S, AIR_S, END_S = 30.0, 90.0, 120.0


def signals(t: Array, seed: int = 1) -> tuple[Array, Array]:
    """Gyro rad/s and force m/s^2 (n, 3) that every unit feels: sways in the air, stands level outside."""
    rng = np.random.default_rng(seed)
    air = ((t >= REST_S) & (t < AIR_S))[:, None]
    gyro = np.radians(10.0) * air * np.sin(np.outer(t, [1.1, 0.9, 0.4]))
    force = np.tile([0.0, 0.0, -G], (len(t), 1)) + 0.8 * air * np.sin(np.outer(t, [0.7, 0.5, 0.3]))
    return gyro + 1e-3 * rng.normal(size=gyro.shape), force + 0.02 * rng.normal(size=force.shape)


def unit(index: int, rate: float, acc: tuple[float, float, float], gyro_dps: tuple[float, float, float]) -> Imu:
    """A unit that reads so much too much [m/s^2, deg/s]."""
    t = np.arange(0.0, END_S, 1.0 / rate) + 0.003 * index
    w, f = signals(t, seed=index + 1)
    name = f"IMU:{index}"
    return Imu(
        index,
        Stream(t, w + np.radians(gyro_dps), "rad/s", "FRD", name),
        Stream(t, f + np.array(acc), "m/s^2", "FRD", name),
    )


def log_of(*units: Imu) -> FlightLog:
    log = imu_log(np.arange(3.0), np.zeros((3, 3)), np.zeros((3, 3)))
    log.imus = list(units)
    return log


def phases(*more: Segment) -> Segments:
    rest = [Segment("rest.long", 0.0, REST_S - 2.0), Segment("rest.long", AIR_S + 2.0, END_S)]
    return Segments([*rest, Segment("airborne", REST_S, AIR_S), *more])


def told(acc: tuple[float, float, float], sigma: float = 0.01, gyro: tuple[float, float, float] = (0.0, 0.0, 0.0)):
    """What a smoother says of itself: biases of the accelerometer m/s^2 and of the gyro deg/s."""
    found: dict[str, float | str] = {"heading_from": "both"}
    for k, axis in enumerate("xyz"):
        found |= {f"acc_bias_{axis}_m_s2": acc[k], f"acc_bias_{axis}_sigma_m_s2": sigma}
        found |= {f"gyro_bias_{axis}_dps": gyro[k], f"gyro_bias_{axis}_sigma_dps": 0.02}
    return found


def motion(quality: dict[str, float | str]) -> MotionAttitude:
    t = np.arange(0.0, END_S, 0.01)
    q, zero = np.tile([1.0, 0.0, 0.0, 0.0], (len(t), 1)), np.zeros(len(t))
    return MotionAttitude(t, q, np.zeros(len(t), np.int64), zero, zero, quality)


def case(
    log: FlightLog,
    quality: dict[str, float | str] | None = None,
    segments: Segments | None = None,
    checks: list[Check] | None = None,
    reference: Reference | None = None,
) -> HealthCase:
    said = None if quality is None else motion(quality)
    return HealthCase(log, segments or phases(), reference, lambda: said, checks or [])
