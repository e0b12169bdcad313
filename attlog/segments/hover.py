"""Hover: in the air, hardly turning, hardly tilted, hardly moving."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from attlog import rotation
from attlog.flight.model import FlightLog
from attlog.segments import spans
from attlog.segments.flags import Phase
from attlog.segments.model import Segment
from attlog.segments.windows import Windows, join

Array = NDArray[np.float64]

SECONDS, RATE_DPS, TILT_DEG, SPEED_M_S = 3.0, 10.0, 20.0, 1.0
"""METRICS 1. A tilt limit of 10 deg loses two thirds of a hover in wind."""
STALE_S = 1.5
"""A position or attitude older than this says nothing about a window."""


def find(log: FlightLog, windows: Windows, airborne: Phase) -> list[Segment]:
    """Stretches of at least 3 s with rate < 10 deg/s rms, tilt < 20 deg and speed < 1 m/s where it is known."""
    if not airborne.spans or not log.kind.hovers:
        return []
    wholly = ~spans.overlaps(windows.t0, windows.t1, spans.complement(airborne.spans, -np.inf, np.inf))
    slow = windows.rate_rms < RATE_DPS
    tilt = tilt_deg(log, windows.middle)
    speed = speed_m_s(log, windows.middle)
    passed = wholly & slow & ~(tilt >= TILT_DEG) & ~(speed >= SPEED_M_S)
    limits = [f"rate under {RATE_DPS:.0f} deg/s"]
    limits += [f"tilt under {TILT_DEG:.0f} deg"] if np.isfinite(tilt).any() else ["tilt unknown"]
    limits += [f"speed under {SPEED_M_S:.0f} m/s"] if np.isfinite(speed).any() else ["speed unknown"]
    return [Segment("hover", a, b, ", ".join(limits)) for a, b in join(windows, passed) if b - a >= SECONDS]


def tilt_deg(log: FlightLog, at: Array) -> Array:
    """Tilt (m,) in deg by the onboard attitude (else the truth) nearest in time; NaN where there is none near."""
    attitude = log.attitudes.get(log.onboard or "") or log.truth
    if attitude is None or len(attitude.t) == 0:
        return np.full(len(at), np.nan)
    i = _nearest(attitude.t, at)
    tilt = np.degrees(rotation.inclination_angle(attitude.q[i]))
    return np.where(np.abs(attitude.t[i] - at) <= STALE_S, tilt, np.nan)


def speed_m_s(log: FlightLog, at: Array) -> Array:
    """Speed (m,) in m/s by the first receiver with a 3D fix nearest in time; NaN where there is none near."""
    for gnss in log.gnss:
        velocity = np.where(np.isfinite(gnss.vel_ned), gnss.vel_ned, 0.0)
        good = (gnss.fix >= 3) & np.isfinite(gnss.vel_ned[:, :2]).all(axis=1) & np.isfinite(gnss.t)
        if np.count_nonzero(good) > 3:
            t, speed = gnss.t[good], np.sqrt(np.sum(velocity[good] ** 2, axis=1))
            i = _nearest(t, at)
            return np.where(np.abs(t[i] - at) <= STALE_S, speed[i], np.nan)
    return np.full(len(at), np.nan)


def _nearest(t: Array, at: Array) -> NDArray[np.int64]:
    """Indices (m,) of the times nearest to ``at``."""
    i = np.clip(np.searchsorted(t, at), 1, max(len(t) - 1, 1)) if len(t) > 1 else np.zeros(len(at), np.int64)
    if len(t) > 1:
        i = i - (at - t[i - 1] < t[i] - at)
    return i
