"""Flights of one minute that shake at known frequencies."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from attlog.flight.model import Firmware, FlightLog, Imu, Stream, TimeLine
from attlog.health.check import HealthCase
from attlog.segments.model import Segment, Segments
from tests.flight.made_log import with_fields

Array = NDArray[np.float64]
BEGIN, END, SECONDS = 10.0, 70.0, 80.0
TURNED_UP = 0.4
"""Throttle is that of hover, in two of five steps of 5 s this part above and below."""


def throttle_at(t: Array, hover: float = 0.3, change: float = TURNED_UP) -> Array:
    """Throttle (n,) that repeats itself every 25 s."""
    return hover * (1.0 + change * np.array([0.0, 1.0, 0.0, -1.0, 0.0])[np.floor(t / 5.0).astype(int) % 5])


def tone(t: Array, frequency: Array | float, rms: float) -> Array:
    """A tone (n,) whose frequency in Hz may change over time."""
    fine = np.broadcast_to(np.asarray(frequency, np.float64), t.shape)
    phase = 2.0 * np.pi * np.concatenate([[0.0], np.cumsum(0.5 * (fine[1:] + fine[:-1]) * np.diff(t))])
    return rms * np.sqrt(2.0) * np.sin(phase)


def shaken(rate: float, frequency: Any, rms_dps: float = 5.0, units: int = 1, noise_dps: float = 0.3,
           firmware: str = "ArduPilot", **more: Any) -> FlightLog:  # fmt: skip
    """A log whose gyros at ``rate`` Hz shake along y; ``frequency`` is a number in Hz or a function of time."""
    t = np.arange(0.0, SECONDS, 1.0 / rate)
    imus = []
    for unit in range(units):
        rng = np.random.default_rng(unit)
        gyro = np.radians(noise_dps) * rng.standard_normal((len(t), 3))
        gyro[:, 1] += np.radians(tone(t, frequency(t) if callable(frequency) else frequency, rms_dps))
        acc = 0.1 * rng.standard_normal((len(t), 3)) + [0.0, 0.0, -9.81]
        imus.append(
            Imu(unit, Stream(t, gyro, "rad/s", "FRD", f"GYR:{unit}"), Stream(t, acc, "m/s^2", "FRD", f"ACC:{unit}"),
                filtered="none")
        )  # fmt: skip
    at = np.arange(0.0, SECONDS, 0.1)
    log = FlightLog(Path("made"), "made", 0, 0, Firmware(firmware, "4.6.0"), "quadrotor", imus=imus, imu=0)
    log.power.throttle = Stream(at, throttle_at(at)[:, None], "1", "", "CTUN.ThO")
    return with_fields(log, **more)


def params(**values: float) -> dict[str, TimeLine]:
    """Parameters that never change."""
    return {name: TimeLine(np.zeros(1), [value], "PARM") for name, value in values.items()}


def phases() -> Segments:
    """One flight, 60 s."""
    return Segments([Segment("continuous", 0.0, SECONDS), Segment("airborne", BEGIN, END)])


def case(log: FlightLog) -> HealthCase:
    return HealthCase(log, phases())
