"""Did GNSS itself jump? Its position against its own velocity, which a receiver measures apart (Doppler)."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from attlog.flight.model import Gnss

BEFORE_S, AFTER_S = 10.0, 1.0
"""An estimator rejects GNSS for a while before it says so: what is looked at around a report."""
LEAST_S = 5.0
"""Fewer seconds with fixes before the report tell nothing."""
STEADY_M = 5.0
"""Below this the position follows the velocity: ArduPilot's EK2_GLITCH_RAD and EK3_GLITCH_RAD are 25 m, and a
position wanders by some metres in minutes."""
GAP_S, FIX_3D = 2.0, 3
M_PER_DEG = 111_195.0
"""Of a sphere of 6,371 km."""


def disagreement(receivers: Sequence[Gnss], t: float) -> float:
    """By how many metres (horizontal) the position left its integrated velocity around ``t`` s; NaN where unknown.

    Of the first receiver that had a 3D fix without a gap, with position and velocity, from 10 s before to 1 s after;
    the largest distance between any two moments. A lost fix is a disagreement of infinite size.
    """
    for gnss in receivers:
        near = (gnss.t >= t - BEFORE_S) & (gnss.t <= t + AFTER_S)
        if not near.any():
            continue
        if (gnss.fix[near] < FIX_3D).any():
            return float("inf")
        use = near & np.isfinite(gnss.lat) & np.isfinite(gnss.lon) & np.isfinite(gnss.vel_ned[:, :2]).all(axis=1)
        stamps = gnss.t[use]
        if len(stamps) < 3 or t - stamps[0] < LEAST_S or np.diff(stamps).max() > GAP_S:
            continue
        return _spread(stamps, gnss.lat[use], gnss.lon[use], gnss.vel_ned[use, :2])
    return float("nan")


def _spread(
    t: NDArray[np.float64], lat: NDArray[np.float64], lon: NDArray[np.float64], velocity: NDArray[np.float64]
) -> float:
    """The largest change, m, of position less integrated velocity (n, 2) m/s north and east."""
    north = (lat - lat[0]) * M_PER_DEG
    east = (lon - lon[0]) * M_PER_DEG * np.cos(np.radians(lat[0]))
    moved = np.cumsum(0.5 * (velocity[1:] + velocity[:-1]) * np.diff(t)[:, None], axis=0)
    apart = np.column_stack([north, east])
    apart[1:] -= moved
    return float(np.hypot(*np.ptp(apart, axis=0)))
