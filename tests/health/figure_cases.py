"""A flight with known fields, currents and ratios, for the figures of the sensors."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from attlog.core import rotation
from attlog.flight.model import Attitude, Firmware, FlightLog, Gnss, Imu, InnovationTest, Mag, Stream
from attlog.health.check import HealthCase, MotionAttitude
from attlog.reference import alignment
from attlog.reference.model import Reference
from attlog.segments.model import Segment, Segments

SECONDS = 100.0
AIR = (10.0, 90.0)
T = np.arange(0, SECONDS, 0.1)
HEADING = np.radians(3.0 * T)


def attitude() -> np.ndarray:
    """It turns by 3 deg/s, level."""
    return np.column_stack([np.cos(HEADING / 2), 0 * T, 0 * T, np.sin(HEADING / 2)])


def log(offset_ut: tuple[float, float, float] = (0.0, 0.0, 0.0), per_ampere: float = 0.0) -> FlightLog:
    """A vehicle near Zurich that sways, whose compass is off by an offset, and along z by so much per ampere."""
    force = rotation.rotate_inverse(attitude(), np.column_stack([1.5 * np.cos(T / 2), 0 * T, 0 * T - 9.8]))
    imu = Imu(0, Stream(T, 0 * force, "rad/s", "FRD", "IMU:0"), Stream(T, force, "m/s^2", "FRD", "IMU:0"))
    made = FlightLog(
        Path("x.bin"), "DataFlash", 0, 0, Firmware("ArduPilot"), "Copter", imus=[imu], imu=0, seconds=SECONDS
    )
    where = [np.full(len(T), v) for v in (47.4, 8.5, 500.0)]
    velocity = np.column_stack([3.0 * np.sin(T / 2), 0 * T, 0 * T])
    ones, fix = np.ones(len(T)), np.full(len(T), 3)
    made.gnss = [Gnss(0, T, "GPS:0", *where, velocity, ones, ones, ones, fix)]
    amperes = np.where((T > AIR[0]) & (T < AIR[1]), 20.0 + 10.0 * np.sin(T / 3), 0.5)
    made.power.battery = Stream(T, np.column_stack([15.0 + 0 * T, amperes]), "V, A", "", "BAT")
    field = rotation.rotate_inverse(attitude(), np.array(alignment.earth_field(made).ned_t))
    field = field + 1e-6 * np.array(offset_ut) + 1e-6 * per_ampere * np.outer(amperes, [0, 0, 1])
    made.mags, made.mag = [Mag(0, Stream(T, field, "T", "FRD", "MAG:0"))], 0
    made.attitudes, made.onboard = {"ATT": Attitude(T, attitude(), "ATT")}, "ATT"
    return made


def case(made: FlightLog, sigma_deg: float | None = 1.0, crash: float | None = None) -> HealthCase:
    """Asked with an attitude by motion alone of that sigma (None: there is none), and a reference 90 deg beside it."""
    number = np.zeros(len(T), np.int64)
    aside = rotation.multiply(np.tile([np.sqrt(0.5), 0.0, 0.0, np.sqrt(0.5)], (len(T), 1)), attitude())
    reference = Reference("onboard", "ATT", T, aside, number, number)
    motion = None
    if sigma_deg is not None:
        motion = MotionAttitude(T, attitude(), number, 0 * T, 0 * T + np.radians(sigma_deg), {})
    kinds = [Segment("continuous", 0.0, SECONDS), Segment("armed", 5.0, 95.0), Segment("airborne", *AIR)]
    kinds += [] if crash is None else [Segment("impact", crash, crash + 0.5), Segment("wreck", crash, crash + 10.0)]
    return HealthCase(made, Segments(kinds), reference, lambda: motion)


def innovations(ratio: np.ndarray, aid: str = "compass") -> InnovationTest:
    """Ratios at 10 Hz."""
    return InnovationTest(aid, 0.1 * np.arange(len(ratio)), ratio, "XKF4")
