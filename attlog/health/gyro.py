"""The gyro by itself: alive on all axes, within range, small at rest."""

from __future__ import annotations

import numpy as np

from attlog.flight.model import FlightLog, Imu
from attlog.health.model import Check, graded, not_judged
from attlog.segments.model import Segments

BIAS_DPS = (1.0, 3.0)
HOPELESS_DPS = 10.0
"""From here on no filter can be judged: it shows how it copes with a broken gyro."""
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
    limit = "warn from 1999 deg/s, the range of the sensor"
    clipped = int((np.degrees(np.abs(imu.gyro.x)).max(axis=1) >= FULL_SCALE_DPS).sum())
    text = f"Largest rate {peak:.0f} deg/s" + (f"; {clipped} samples at the sensor's limit." if clipped else ".")
    found = [Check("gyro range", "warn" if clipped else "good", text, round(peak, 1), "deg/s", limit)]
    found.append(bias(imu, segments))
    return found


def bias(imu: Imu, segments: Segments) -> Check:
    """The median rate at rest; on the ground with motors on where the vehicle never rests."""
    limit = f"good up to {BIAS_DPS[0]:.0f} deg/s, bad above {BIAS_DPS[1]:.0f} deg/s"
    for kind, where in (("rest", "Standing still"), ("idle", "On the ground with motors on")):
        mask = segments.mask(imu.gyro.t, kind)
        if mask.sum() < 10:
            continue
        x, y, z = (float(v) for v in np.degrees(np.median(imu.gyro.x[mask], axis=0)))
        worst = max(x, y, z, key=abs)
        text = f"{where} the gyro reads {x:.2f}, {y:.2f}, {z:.2f} deg/s about x, y, z."
        return Check("gyro bias", graded(abs(worst), *BIAS_DPS), text, round(worst, 3), "deg/s", limit)
    return not_judged("gyro bias", "The vehicle never stands still on the ground in this log.", limit)


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
