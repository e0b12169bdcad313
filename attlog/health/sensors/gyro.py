"""The gyro by itself: alive on all axes, within range, small at rest."""

from __future__ import annotations

from functools import reduce

import numpy as np

from attlog.flight.model import FlightLog, Imu
from attlog.health.model import Check, graded, not_judged
from attlog.health.sound import before_crashes
from attlog.segments.model import Segments

BIAS_DPS = (1.0, 3.0)
UNUSABLE_DPS = 10.0
"""From here on no filter can be judged: it shows how it copes with a broken gyro."""
RANGES_DPS = (125.0, 250.0, 500.0, 1000.0, 2000.0)
"""Ranges of an autopilot's gyros; 2000 deg/s is the usual one."""
AT_LIMIT = 0.0005
"""Part of the range within which a sample lies at its end."""
ZERO, CONSTANT = "zero", "constant"
DEAD = "The sensor does not answer: its wiring, its bus or the sensor itself."
"""Values and the cause of a check that finds a sensor dead: no calibration mends it."""
FLAT = 3
"""So many samples in a row at the end of a smaller range are no chance."""


def checks(log: FlightLog, segments: Segments) -> list[Check]:
    """Alive, saturated, bias at rest."""
    if not log.imus:
        return []
    imu = log.imus[log.imu or 0]
    found = alive("gyro", imu.gyro.x, imu.gyro.source)
    if found:
        return found
    whole = before_crashes(segments, imu.gyro.t)
    flown = imu.gyro.x[whole] if whole.any() else imu.gyro.x  # a wreck turns as it will
    peak = float(np.degrees(np.abs(flown).max()))
    limit = "warning from 1999 deg/s, or where it stays at 125, 250, 500 or 1000 deg/s: the range of the sensor"
    clipped = at_limit(np.degrees(reduce(np.maximum, np.abs(flown).T)))
    samples = "1 sample is" if clipped == 1 else f"{clipped} samples are"
    text = f"Largest rate {peak:.0f} deg/s" + (f"; {samples} at the sensor's limit." if clipped else ".")
    found = [Check("gyro range", "warning" if clipped else "ok", text, round(peak, 1), "deg/s", limit)]
    found.append(bias(imu, segments))
    return found


def at_limit(rate: np.ndarray) -> int:
    """How many of the rates (n,) deg/s lie at the end of the sensor's range: flat at a known range, or beyond all."""
    peak = float(rate.max(initial=0.0))
    if peak >= RANGES_DPS[-1] * (1.0 - AT_LIMIT):
        return int((rate >= RANGES_DPS[-1] * (1.0 - AT_LIMIT)).sum())
    for full in RANGES_DPS[:-1]:
        if abs(peak / full - 1.0) <= AT_LIMIT:
            there = rate >= full * (1.0 - AT_LIMIT)
            in_a_row = np.convolve(there, np.ones(FLAT, int), "valid").max(initial=0) >= FLAT
            return int(there.sum()) if in_a_row else 0
    return 0


def bias(imu: Imu, segments: Segments) -> Check:
    """The median rate at rest, and how far it moved from one rest to another; on the ground with motors on where the
    vehicle never rests."""
    limit = f"ok up to {BIAS_DPS[0]:.0f} deg/s, fault above {BIAS_DPS[1]:.0f} deg/s; the same for its change"
    for kind, where in (("rest", "Standing still"), ("idle", "On the ground with motors on")):
        mask = segments.mask(imu.gyro.t, kind)
        if mask.sum() < 10:
            continue
        x, y, z = (float(v) for v in np.degrees(np.median(imu.gyro.x[mask], axis=0)))
        worst = max(x, y, z, key=abs)
        text = f"{where} the gyro reads {x:.2f}, {y:.2f}, {z:.2f} deg/s about x, y, z."
        verdict = graded(abs(worst), *BIAS_DPS)
        moved = _moved(imu, segments, limit) if kind == "rest" and verdict != "fault" else None
        return moved or Check("gyro bias", verdict, text, round(worst, 3), "deg/s", limit)
    return not_judged("gyro bias", "The vehicle never stands still on the ground in this log.", limit)


def _moved(imu: Imu, segments: Segments, limit: str) -> Check | None:
    """The check where two rests disagree by more than BIAS_DPS about an axis, which their common median hides."""
    t = imu.gyro.t
    rests = [(a, b, imu.gyro.x[(t >= a) & (t <= b)]) for a, b in segments.spans("rest")]
    told = [(a, b, np.degrees(np.median(x, axis=0))) for a, b, x in rests if len(x) >= 10]
    if len(told) < 2:
        return None
    readings = np.array([x for _, _, x in told])
    axis = int(np.argmax(np.ptp(readings, axis=0)))
    low, high = sorted((int(np.argmin(readings[:, axis])), int(np.argmax(readings[:, axis]))))
    change = float(np.ptp(readings[:, axis]))
    if change <= BIAS_DPS[0]:
        return None
    before, after = (", ".join(f"{v:.2f}" for v in readings[k]) for k in (low, high))
    text = (
        f"Standing still the gyro reads {before} deg/s about x, y, z until {told[low][1]:.0f} s, and {after} from "
        f"{told[high][0]:.0f} s on: its bias moved by {change:.2f} deg/s about {'xyz'[axis]}."
    )
    worst = float(readings.ravel()[np.argmax(np.abs(readings))])
    verdict = graded(max(change, abs(worst)), *BIAS_DPS)
    return Check("gyro bias", verdict, text, round(worst, 3), "deg/s", limit, t=told[high][0])


def alive(name: str, x: np.ndarray, source: str) -> list[Check]:
    """A fault if a sensor is all zero or has an axis that never changes, else nothing."""
    limit, sensor = "every axis must change", "accelerometer" if name == "gravity" else name
    if not x.any():
        return [Check(name, "fault", f"{source}: all values of the {sensor} are zero.", ZERO, "", limit, cause=DEAD)]
    stuck = [axis for axis, spread in zip("xyz", map(np.ptp, x.T), strict=True) if spread == 0]
    if stuck and len(x) >= 20:
        which = f"{sensor} axis {', '.join(stuck)} is" if len(stuck) < 3 else f"all axes of the {sensor} are"
        return [Check(name, "fault", f"{source}: {which} constant.", CONSTANT, "", limit, cause=DEAD)]
    return []
