"""A flight whose phases are known: 30 s rest, 5 s idling, 40 s in the air, 25 s rest."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from attlog.core import rotation
from attlog.flight.model import Attitude, Firmware, FlightLog, Imu, Stream, TimeLine
from tests.flight.made_log import with_fields

Array = NDArray[np.float64]

ARMED, TAKE_OFF, LANDED, DISARMED, END = 30.0, 35.0, 75.0, 78.0, 105.0
OFFSET_DPS = np.array([0.5, -0.3, 0.2])
G = 9.81


def imu_log(t: Array, gyro: Array, acc: Array, **more: Any) -> FlightLog:
    """A log of one IMU and whatever else is given."""
    imu = Imu(
        0, Stream(t, gyro, "rad/s", "body FRD", "IMU:0"), Stream(t, acc, "m/s^2", "body FRD", "IMU:0"), filtered="none"
    )
    log = FlightLog(Path("made.bin"), "made", 0, 0, Firmware("made"), "quadrotor", imus=[imu], imu=0)
    return with_fields(log, **more)


def flight(rate: float = 200.0, calm: bool = False, seed: int = 1, **more: Any) -> FlightLog:
    """The flight of the module's docstring; ``calm`` makes a hover that is nearly as still as a table."""
    rng = np.random.default_rng(seed)
    t = np.arange(0.0, END, 1.0 / rate)
    air = (t >= TAKE_OFF) & (t < LANDED)
    motors = (t >= ARMED) & (t < DISARMED)
    vibration = np.where(motors, 0.4 if calm else 2.0, 0.05)
    shaking = np.where(motors, 0.1 if calm else 1.0, 0.02)
    sway = np.where(air, 0.02 if calm else 5.0, 0.0)
    rate_dps = OFFSET_DPS + rng.normal(size=(len(t), 3)) * vibration[:, None]
    swing = sway[:, None] * np.sin(2 * np.pi * np.array([0.31, 0.23, 0.11]) * (t[:, None] - TAKE_OFF))
    truth = np.cumsum(np.radians(swing), axis=0) / rate
    gyro = np.radians(rate_dps + swing)
    q = rotation.from_euler(truth[:, 0], truth[:, 1], truth[:, 2])
    acc = rotation.rotate_inverse(q, np.array([0.0, 0.0, -G])) + rng.normal(size=(len(t), 3)) * shaking[:, None]
    every = max(1, round(rate / 20))
    return imu_log(
        t,
        gyro,
        acc,
        **{"attitudes": {"ATT": Attitude(t[::every], q[::every], "ATT")}, "onboard": "ATT", **flags(), **more},
    )


def flags() -> dict[str, TimeLine]:
    """Arming and land detector of the flight."""
    return {
        "armed": TimeLine(np.array([0.0, ARMED, DISARMED]), [False, True, False], "vehicle_status"),
        "landed": TimeLine(np.array([0.0, TAKE_OFF, LANDED]), [True, False, True], "vehicle_land_detected"),
    }
