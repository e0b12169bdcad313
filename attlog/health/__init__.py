"""Does physics agree with what the log says, and what can this log answer?"""

from __future__ import annotations

from attlog.flight.model import FlightLog
from attlog.health import (
    acc_bias,
    accelerometer,
    against_smoother,
    attitude,
    crash,
    declination_told,
    delay,
    gnss,
    gyro,
    interference,
    jumps,
    magnetometer,
    sources,
    timing,
    vibration,
)
from attlog.health.model import Answerable, Check
from attlog.health.questions import answerable
from attlog.reference import choose
from attlog.reference.model import Reference
from attlog.segments.model import Segments

__all__ = ["Answerable", "Check", "answerable", "audit"]


def audit(log: FlightLog, segments: Segments | None, reference: Reference | None = None) -> list[Check]:
    """Every check of the log in a fixed order; ``segments`` None where there is no usable IMU.

    ``reference`` judges the onboard attitude, and the delay is measured against it; where it is not given, or is
    a smoother, made of the very gyro whose delay is asked for, truth or the onboard attitude is taken for that.
    """
    phases = segments or Segments()
    rates = reference
    if (reference is None or reference.kind == "smoother") and segments is not None and log.imu is not None:
        rates = choose(log, segments)
    return [
        *timing.checks(log),
        *delay.checks(log, rates),
        *gyro.checks(log, phases),
        *against_smoother.checks(log, phases, reference),
        *accelerometer.checks(log, phases),
        *acc_bias.checks(log, phases),
        *vibration.checks(log, phases),
        *attitude.checks(log, phases),
        *jumps.checks(log, phases),
        *sources.checks(log, phases),
        *magnetometer.checks(log),
        *declination_told.checks(log),
        *interference.checks(log, phases),
        *gnss.checks(log, phases),
        *(crash.checks(phases) if log.imus else []),
    ]
