"""How late the logged gyro is: by its filter's parameter, and by what the rates show."""

from __future__ import annotations

from attlog.flight.model import FlightLog
from attlog.health.model import Check, graded, not_judged
from attlog.reference.model import Reference
from attlog.reference.physics import delay

SHORT_MS = 6.0
AGREES_MS, WRONG_CLOCK_MS = 4.0, 20.0
"""A difference beyond the first needs a look; beyond the second a clock or a sampling rule is wrong."""


def checks(log: FlightLog, reference: Reference | None) -> list[Check]:
    """The delay of the filters ahead of the logger, and whether the reference's rotation confirms it."""
    if not log.imus:
        return []
    imu = log.imus[log.imu or 0]
    told = 1e3 * imu.gyro.delay
    seen = None if reference is None or log.imu is None else delay.measured(imu, reference)
    limit = f"ok up to {SHORT_MS:.0f} ms, and confirmed to {AGREES_MS:.0f} ms where it can be measured"
    known = told > 0 or imu.filtered not in ("unknown", "driver")
    if not known and seen is None:
        return [not_judged("delay", f"{imu.gyro.source}: the log does not tell how it was filtered.", limit)]
    text = (
        f"{imu.gyro.source}: the log does not tell how it was filtered"
        if not known
        else f"{imu.gyro.source} is logged without a low-pass filter"
        if told == 0
        else f"{imu.gyro.source} is late by {told:.1f} ms ({imu.filtered})"
    )
    verdict = graded(told, SHORT_MS, float("inf"))
    if seen is not None and reference is not None:
        however = ", yet" if told == 0 and known and 1e3 * seen > AGREES_MS else ";"
        text += f"{however} against {reference.source} its rates are late by {1e3 * seen:.1f} ms"
        off = abs(1e3 * seen - told)
        verdict = max(verdict, graded(off, AGREES_MS, WRONG_CLOCK_MS), key=("ok", "warning", "fault").index)
    return [Check("delay", verdict, text + ".", round(told if seen is None else 1e3 * seen, 2), "ms", limit)]
