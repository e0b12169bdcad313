"""Did GNSS have a fix all through the flight?"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from attlog.flight.model import FlightLog, Gnss
from attlog.health.model import Check
from attlog.segments.model import Segments

LOST_S = 3.0
"""A shorter outage is a late message."""
THREE_DIMENSIONAL = 3
NAME = "GNSS"
LIMIT = f"ok: never without a fix for more than {LOST_S:.0f} s in flight"


def checks(log: FlightLog, segments: Segments) -> list[Check]:
    """Outages of the best receiver while airborne; nothing where none ever had a fix, or nothing flew."""
    flights = segments.spans("airborne")
    had = [g for g in log.gnss if (g.fix >= THREE_DIMENSIONAL).any()]
    if not had or not flights:
        return []
    found = min((outages(one, flights, log) for one in had), key=lambda lost: sum(b - a for a, b in lost))
    if not found:
        return [Check(NAME, "ok", "GNSS had a fix all through the flight.", 0.0, "s", LIMIT)]
    seconds = sum(b - a for a, b in found)
    times = "" if len(found) == 1 else f" in {len(found)} outages"
    text = f"GNSS had no fix for {seconds:.0f} s in flight{times}, first at {found[0][0]:.0f} s."
    return [Check(NAME, "warning", text, round(seconds, 1), "s", LIMIT, t=found[0][0], count=len(found))]


def outages(gnss: Gnss, flights: list[tuple[float, float]], log: FlightLog) -> list[tuple[float, float]]:
    """Spans (t0, t1) s in flight without a 3D fix, from the last fix to the next; pauses of the logger are none."""
    t: NDArray[np.float64] = gnss.t[gnss.fix >= THREE_DIMENSIONAL]
    imu = log.replay_imu
    found = []
    for begin, end in flights:
        inside = t[(t > begin) & (t < end)]
        edges = np.concatenate([[begin], inside, [end]])
        for a, b in zip(edges[:-1].tolist(), edges[1:].tolist(), strict=True):
            if b - a > LOST_S and (imu is None or not _paused(imu.gyro.t, a, b)):
                found.append((a, b))
    return found


def _paused(t: NDArray[np.float64], begin: float, end: float) -> bool:
    """Whether the inertial samples at ``t`` leave out half of a span, so that nothing at all was logged then."""
    inside = np.concatenate([[begin], t[(t > begin) & (t < end)], [end]])
    return float(np.diff(inside).max()) > 0.5 * (end - begin)
