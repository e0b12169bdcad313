"""Made samples of a compass: a vehicle that turns and tilts in a known field, with planted errors."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from attlog.core import rotation
from attlog.flight.model import Firmware, FlightLog, Mag, Stream
from attlog.health.check import HealthCase
from attlog.health.compass_offset import FieldSamples
from attlog.segments.model import Segments

EARTH = np.array([20.0, 3.0, 40.0])
"""The earth's field, uT north-east-down."""
HOVER = 20.0


def samples(
    offset: tuple[float, float, float] = (0.0, 0.0, 0.0),
    motor: tuple[float, float, float] = (0.0, 0.0, 0.0),
    *,
    turn_deg: float = 0.0,
    turns: float = 2.0,
    noise: float = 0.2,
    sigma_deg: float = 1.0,
    ground: tuple[bool, bool] = (True, True),
    power: bool = True,
    place: tuple[float, float, float] = (0.0, 0.0, 0.0),
    calibrated: bool = True,
    index: int = 0,
) -> FieldSamples:
    """20 s on the ground, 100 s of flight with so many ``turns``, 20 s on the ground at 10 Hz.

    The compass reads ``offset`` uT and ``motor`` uT per ampere too much, is mounted clockwise by ``turn_deg``, and the
    ``place`` adds its own field on the ground.
    """
    random = np.random.default_rng(1)
    t = np.arange(0.0, 140.0, 0.1)
    air, before, after = (t > 20.0) & (t < 120.0), t <= 20.0, t >= 120.0
    phase = np.clip((t - 20.0) / 100.0, 0.0, 1.0)
    q = rotation.from_euler(
        np.where(air, 0.2 * np.sin(t), 0.0),
        np.where(air, 0.2 * np.cos(0.7 * t), 0.0),
        2.0 * np.pi * turns * phase + 0.4,
    )
    expected = rotation.rotate_inverse(q, EARTH)
    amperes = np.where(air, HOVER + 3.0 * np.sin(0.3 * t), 0.5)
    mount = np.tile(rotation.from_euler(0.0, 0.0, np.radians(turn_deg)), (len(t), 1))
    measured = rotation.rotate_inverse(mount, expected) + np.array(offset) + amperes[:, None] * np.array(motor)
    measured = measured + np.outer(~air, place) + noise * random.normal(size=(len(t), 3))
    mag = Mag(index, Stream(t, 1e-6 * measured, "T", "FRD", f"MAG.{index}"), calibrated)
    return FieldSamples(
        mag=mag,
        t=t,
        measured=measured,
        expected=expected,
        q=q,
        sigma_heading=np.full(len(t), np.radians(sigma_deg)),
        power=amperes if power else np.full(len(t), np.nan),
        air=air,
        before=before & ground[0],
        after=after & ground[1],
        earth=EARTH,
        hover=HOVER if power else float("nan"),
        power_kind="current",
        seconds=100.0,
    )


def empty_log() -> FlightLog:
    """A log that holds nothing."""
    return FlightLog(Path("made.bin"), "dataflash", 0, 0, Firmware("ArduPilot", "4.5.0"), "copter")


def case_of(log: FlightLog) -> HealthCase:
    """A case that knows of no attitude."""
    return HealthCase(log, Segments())
