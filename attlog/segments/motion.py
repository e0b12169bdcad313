"""How fast and how far tilted the vehicle was: the nearest that the log tells of it."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from attlog.base import rotation
from attlog.flight.model import FlightLog

Array = NDArray[np.float64]

STALE_S = 1.5
"""A position or attitude older than this says nothing about an instant."""


def tilt_deg(log: FlightLog, at: Array) -> Array:
    """Tilt (m,) in deg by the onboard attitude (else the truth) nearest in time; NaN where there is none near."""
    attitude = log.onboard_attitude or log.truth
    if attitude is None or len(attitude.t) == 0:
        return np.full(len(at), np.nan)
    i = _nearest(attitude.t, at)
    tilt = np.degrees(rotation.inclination_angle(attitude.q[i]))
    return np.where(np.abs(attitude.t[i] - at) <= STALE_S, tilt, np.nan)


def speed_m_s(log: FlightLog, at: Array) -> Array:
    """Speed (m,) in m/s by the first receiver with a 3D fix nearest in time; NaN where there is none near."""
    for gnss in log.gnss:
        velocity = np.where(np.isfinite(gnss.vel_ned), gnss.vel_ned, 0.0)
        good = (gnss.fix >= 3) & rotation.finite(gnss.vel_ned[:, :2]) & np.isfinite(gnss.t)
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
