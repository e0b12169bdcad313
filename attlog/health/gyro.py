"""The gyro by itself: alive on all axes, within range, small at rest."""

from __future__ import annotations

import numpy as np

from attlog.flight.model import FlightLog
from attlog.health.model import Check, graded, not_judged
from attlog.segments.model import Segments

FULL_SCALE_DPS = 1999.0
"""The usual largest range of an autopilot's gyro is 2000 deg/s."""


def checks(log: FlightLog, segments: Segments) -> list[Check]:
    """Alive, saturated, bias at rest."""
    if not log.imus:
        return []
    imu = log.imus[log.imu or 0]
    found = alive("gyro", imu.gyro.x, imu.gyro.source)
    if found:
        return found
    peak = float(np.degrees(np.abs(imu.gyro.x).max()))
    limit = "look from 1999 deg/s, the range of the sensor"
    clipped = int((np.degrees(np.abs(imu.gyro.x)).max(axis=1) >= FULL_SCALE_DPS).sum())
    text = f"Largest rate {peak:.0f} deg/s" + (f"; {clipped} samples at the sensor's limit." if clipped else ".")
    found = [Check("gyro range", "warn" if clipped else "good", text, round(peak, 1), "deg/s", limit)]
    mask = segments.mask(imu.gyro.t, "rest")
    limit = "good up to 1 deg/s, bad above 3 deg/s"
    if mask.sum() < 10:
        found.append(not_judged("gyro bias", "The vehicle never rests with motors off in this log.", limit))
    else:
        bias = np.degrees(np.median(imu.gyro.x[mask], axis=0))
        worst = float(np.abs(bias).max())
        text = f"At rest {bias[0]:.2f}, {bias[1]:.2f}, {bias[2]:.2f} deg/s about x, y, z."
        found.append(Check("gyro bias", graded(worst, 1.0, 3.0), text, round(worst, 3), "deg/s", limit))
    return found


def alive(name: str, x: np.ndarray, source: str) -> list[Check]:
    """A bad check if a sensor is all zero or has an axis that never changes, else nothing."""
    limit = "every axis must change"
    if not x.any():
        return [Check(name, "bad", f"{source}: all values are zero.", "zero", "", limit)]
    stuck = [axis for axis, spread in zip("xyz", np.ptp(x, axis=0), strict=True) if spread == 0]
    if stuck and len(x) >= 20:
        which = "all axes are" if len(stuck) == 3 else f"axis {', '.join(stuck)} is"
        return [Check(name, "bad", f"{source}: {which} constant.", "constant", "", limit)]
    return []
