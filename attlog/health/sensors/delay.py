"""How late the logged gyro is: by its filter's parameter, and by what the rates show beyond it."""

from __future__ import annotations

import math

from attlog.flight.model import FlightLog
from attlog.health.fits.regression import interval
from attlog.health.model import Check, graded, not_judged
from attlog.reference.model import Reference
from attlog.reference.physics import delay

SHORT_MS = 6.0
AGREES_MS, HIDDEN_MS, WRONG_CLOCK_MS = 4.0, 10.0, 20.0
"""A difference beyond the first is no filter's that is named, beyond the second none that a sensor has by itself
(20 Hz), beyond the third a clock or a sampling rule is wrong."""
SIGMAS, FLOOR_MS = 4.0, 0.5
"""Told above four times sqrt((1.5 standard errors)^2 + 0.5^2)."""
NAME, UNEXPLAINED = "delay", "imu delay"
LIMIT = f"ok up to {SHORT_MS:.0f} ms"
SEEN_LIMIT = (
    f"ok within {AGREES_MS:.0f} ms ({HIDDEN_MS:.0f} where the log names no filter) of its filter's, "
    f"or {SIGMAS:.0f} sigma; fault beyond {WRONG_CLOCK_MS:.0f} ms"
)


def checks(log: FlightLog, reference: Reference | None) -> list[Check]:
    """The delay of the filters ahead of the logger, and how much later the rates are against the reference's."""
    if not log.imus:
        return []
    imu = log.imus[log.imu or 0]
    by_filter = 1e3 * imu.gyro.delay
    seen = None if reference is None or log.imu is None else delay.measured(imu, reference)
    if by_filter > 0:
        text = f"{imu.gyro.source} is late by {by_filter:.1f} ms ({imu.filtered})."
        own = Check(NAME, graded(by_filter, SHORT_MS, math.inf), text, round(by_filter, 2), "ms", LIMIT)
    elif imu.filtered not in ("unknown", "driver"):
        text = f"{imu.gyro.source} is logged without a low-pass filter."
        own = Check(NAME, "ok", text, 0.0, "ms", LIMIT)
    else:
        own = not_judged(NAME, f"{imu.gyro.source}: the log does not show how it was filtered.", LIMIT)
    if reference is None or seen is None:
        return [own, not_judged(UNEXPLAINED, "The vehicle turns too little to show a delay.", SEEN_LIMIT)]
    late, sigma = 1e3 * seen[0], math.hypot(1.5e3 * seen[1], FLOOR_MS)
    off = late - by_filter
    way = "later" if off > 0 else "earlier"
    known = f"its filter's {by_filter:.1f} ms" if by_filter > 0 else "no filter"
    agrees = HIDDEN_MS if imu.filtered in ("unknown", "driver") else AGREES_MS
    if -AGREES_MS <= off <= agrees or abs(off) <= SIGMAS * sigma:
        text = f"Against {reference.source} the rates of {imu.gyro.source} are late by {late:.1f} ms: {known}."
        return [own, Check(UNEXPLAINED, "ok", text, round(late, 2), "ms", SEEN_LIMIT)]
    if off < 0 and reference.kind == "onboard":
        text = (
            f"{reference.source} comes {-off:.1f} ms later than {imu.gyro.source}: the attitude, not the IMU, is late."
        )
        return [own, Check(UNEXPLAINED, "ok", text, round(late, 2), "ms", SEEN_LIMIT)]
    text = f"{imu.gyro.source} comes {abs(off):.1f} ms {way} ({interval(abs(off), sigma, 1)}, 95 %) against "
    text += f"{reference.source} than {known} makes it: {late:.1f} ms in all."
    verdict = "fault" if abs(off) > WRONG_CLOCK_MS else "warning"
    return [own, Check(UNEXPLAINED, verdict, text, round(late, 2), "ms", SEEN_LIMIT)]
