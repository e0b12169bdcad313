"""Does physics agree with what the log says, and what can this log answer?"""

from __future__ import annotations

from attlog.audit import accelerometer, attitude, gyro, magnetometer, timing
from attlog.audit.model import Answerable, Check
from attlog.audit.questions import answerable
from attlog.flight.model import FlightLog
from attlog.segments.model import Segments

__all__ = ["Answerable", "Check", "answerable", "audit"]


def audit(log: FlightLog, segments: Segments | None) -> list[Check]:
    """Every check of the log in a fixed order; ``segments`` None where there is no usable IMU."""
    phases = segments or Segments()
    return [
        *timing.checks(log),
        *gyro.checks(log, phases),
        *accelerometer.checks(log, phases),
        *attitude.checks(log, phases),
        *magnetometer.checks(log),
    ]
