"""Trim: the small rotation between IMU and vehicle that the autopilot's attitudes have taken out."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from attlog.base import rotation
from attlog.flight.model import Attitude, FlightLog
from attlog.reference.model import AlignmentStep

Array = NDArray[np.float64]


def apply(q: Array, trim: Array) -> Array:
    """Attitudes of the vehicle (n, 4) from those of its IMU: ``q_imu (x) exp(-trim)``."""
    return rotation.multiply(q, rotation.from_rotvec(-trim))


def step(log: FlightLog, attitude: Attitude, wanted: bool) -> tuple[Array | None, AlignmentStep]:
    """The trim, a rotation vector (3,) in rad, to take out of replays for a comparison with this attitude, and why.

    None for nothing.
    """
    if not attitude.has_trim:
        text = f"{attitude.source} is the attitude of the IMU itself: nothing to take out"
        return None, AlignmentStep("trim", text, 0.0, "deg", attitude.source, False, "config: trim")
    trim = log.trim
    if trim is None:
        missing = log.trim_source.replace(", ", " and ") or "it"
        text = f"{attitude.source} has a trim taken out, but the log does not hold {missing}"
        return None, AlignmentStep("trim", text, None, "deg", "", False, "config: trim")
    size = math.degrees(float(np.sqrt(np.sum(trim**2))))
    text = f"roll {math.degrees(trim[0]):.2f}, pitch {math.degrees(trim[1]):.2f} deg are inside {attitude.source}"
    applied = wanted and size > 0
    text += ": taken out of the replays once" if applied else ": nothing to do" if size == 0 else ": switched off"
    step = AlignmentStep("trim", text, size, "deg", log.trim_source, applied, "config: trim")
    return (trim if applied else None), step
