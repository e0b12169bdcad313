"""Does physics agree with what the log says, and what can this log answer?"""

from __future__ import annotations

from collections.abc import Callable
from functools import partial

from attlog.base.barrier import guarded
from attlog.flight.model import FlightLog, part_of
from attlog.health.fits import compass, force, turns
from attlog.health.model import Answerable, Check, failed
from attlog.health.onboard import against_smoother, aids, attitude, crash, gnss_heading, jumps, sources
from attlog.health.onboard import declination as declination_told
from attlog.health.questions import answerable
from attlog.health.sensors import (
    acc_bias,
    accelerometer,
    delay,
    frozen,
    gnss,
    gyro,
    interference,
    magnetometer,
    sensor_faults,
    timing,
    vibration,
)
from attlog.reference import choose
from attlog.reference.model import Reference
from attlog.segments.model import Segments

__all__ = ["Answerable", "Check", "answerable", "audit"]


BEFORE = "heading by GNSS"
"""The onboard attitude stands before this check and is judged when all sensors are."""


def audit(log: FlightLog, segments: Segments | None, reference: Reference | None = None) -> list[Check]:
    """Every check of the log in a fixed order; ``segments`` None where there is no usable IMU.

    ``reference`` judges the onboard attitude, and the delay is measured against it; where it is not given, or is
    a smoother, made of the very gyro whose delay is asked for, truth or the onboard attitude is taken for that.
    """
    phases = segments or Segments()
    rates = reference
    if (reference is None or reference.kind == "smoother") and segments is not None and log.imu is not None:
        rates = part_of(log, "The reference", lambda: choose(log, phases, heading=False), lambda: reference)
    every: dict[str, Callable[[], list[Check]]] = {
        "gaps and rate": lambda: timing.checks(log, phases),
        "delay": lambda: delay.checks(log, rates),
        "gyro": lambda: gyro.checks(log, phases),
        "frozen sensors": lambda: frozen.checks(log, phases),
        "sensor faults": lambda: sensor_faults.checks(rates),
        "heading by GNSS": lambda: gnss_heading.checks(log, phases),
        "turns": lambda: turns.checks(log, phases, rates, reference),
        "force": lambda: force.checks(log, phases, reference or rates),
        "compass error": lambda: compass.checks(log, phases, _heading(reference, rates)),
        "gravity": lambda: accelerometer.checks(log, phases),
        "accelerometer bias": lambda: acc_bias.checks(log, phases),
        "vibration": lambda: vibration.checks(log, phases),
        "gravity direction": lambda: attitude.checks(log, phases, "" if rates is None else rates.gyro_fault),
        "attitude jumps": lambda: jumps.checks(log, phases, reference),
        "second source": lambda: sources.checks(log, phases, reference),
        "field": lambda: magnetometer.checks(log, phases),
        "aids": lambda: aids.checks(log, phases),
        "declination set": lambda: declination_told.checks(log),
        "field against motors": lambda: interference.checks(log, phases),
        "GNSS": lambda: gnss.checks(log, phases),
        "crash": lambda: crash.checks(log, phases) if log.imus else [],
    }
    found = {name: guarded(f"The check {name}", make, partial(failed, name)) for name, make in every.items()}
    sensors = [check for made in found.values() for check in made]
    name = against_smoother.NAME
    accused = guarded(
        f"The check {name}", lambda: against_smoother.checks(log, phases, reference, sensors), partial(failed, name)
    )
    return [check for room, made in found.items() for check in [*(accused if room == BEFORE else []), *made]]


def _heading(reference: Reference | None, otherwise: Reference | None) -> Reference | None:
    """Whose heading may judge the compass: truth's or a smoother's own, else the onboard attitude's if it is right."""
    judge = reference if reference is not None and reference.heading_by == "own" else otherwise
    return judge if judge is None or judge.heading_by == "own" else None
