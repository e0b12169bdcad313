"""A flight in closed form: velocities are sines, so that force, velocity, place and field at any time are known."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from attlog.core import rotation
from attlog.flight.model import Firmware, FlightLog, Gnss, Imu, Stream, TimeLine
from attlog.health.check import HealthCase, MotionAttitude
from attlog.segments.model import Segment, Segments

G = 9.80665
SECONDS, RATE, GNSS_HZ = 100.0, 100.0, 5.0
SPEED, OMEGA = np.array([4.0, 3.0]), np.array([0.9, 0.53])
EARTH_UT = np.array([20.0, 3.0, 43.0])


def velocity(t: np.ndarray) -> np.ndarray:
    """North and east (n, 2) m/s."""
    return SPEED * np.sin(t[:, None] * OMEGA)


def attitude(t: np.ndarray) -> np.ndarray:
    """Level, turning to and fro by a radian (n, 4)."""
    return rotation.from_euler(np.zeros(len(t)), np.zeros(len(t)), np.sin(0.4 * t))


def flight(
    late_s: float = 0.0, seed: int = 0, firmware: str = "PX4", params: dict[str, float] | None = None
) -> FlightLog:
    """A log whose receiver is ``late_s`` late, its velocities with 0.05 m/s of noise."""
    t = np.arange(0.0, SECONDS, 1.0 / RATE)
    acc = SPEED * OMEGA * np.cos(t[:, None] * OMEGA)
    force = rotation.rotate_inverse(attitude(t), np.column_stack([acc, np.full(len(t), -G)]))
    log = FlightLog(Path("made"), "made", 0, 0, Firmware(firmware), "quadrotor")
    gyro = np.column_stack([np.zeros((len(t), 2)), 0.4 * np.cos(0.4 * t)])
    log.imus = [
        Imu(0, Stream(t, gyro, "rad/s", "FRD", "IMU"), Stream(t, force, "m/s^2", "FRD", "IMU"), filtered="none")
    ]
    log.imu = 0
    log.gnss = [receiver(late_s, seed)]
    log.parameters.lines = {name: TimeLine(np.zeros(1), [value], "made") for name, value in (params or {}).items()}
    log.seconds = SECONDS
    return log


def receiver(late_s: float, seed: int) -> Gnss:
    """5 Hz, at the equator."""
    t = np.arange(1.0, SECONDS - 1.0, 1.0 / GNSS_HZ)
    n, felt = len(t), t - late_s
    place = -SPEED / OMEGA * np.cos(felt[:, None] * OMEGA)
    v = velocity(felt) + np.random.default_rng(seed).normal(0.0, 0.05, (n, 2))
    down = np.zeros((n, 1))
    lat, lon = np.degrees(place / 6.371e6).T
    good = np.full(n, 0.5)
    return Gnss(0, t, "GPS:0", lat, lon, np.zeros(n), np.hstack([v, down]), good, good, good, np.full(n, 3))


def case(log: FlightLog, delay_ms: float | None = None, sigma_heading_deg: float = 1.0) -> HealthCase:
    """The case of a flight from 5 s to the end less 5 s, with the true attitude as that by motion alone.

    ``delay_ms``: what the smoother claims of the receiver.
    """
    t = np.arange(0.0, SECONDS, 1.0 / RATE)
    quality: dict[str, float | str] = {"sigma_heading_deg": sigma_heading_deg, "sigma_tilt_deg": 0.2}
    quality |= {} if delay_ms is None else {"gnss_delay_ms": delay_ms}
    zero = np.zeros(len(t))
    motion = MotionAttitude(t, attitude(t), np.zeros(len(t), np.int64), zero, zero, quality)
    segments = Segments([Segment("airborne", 5.0, SECONDS - 5.0)])
    return HealthCase(log, segments, None, lambda: motion)
