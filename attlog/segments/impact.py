"""Impact: the moment from which a log tells about a wreck and not about a flight."""

from __future__ import annotations

import re

import numpy as np
from numpy.typing import NDArray

from attlog import rotation
from attlog.flight.model import FlightLog, Imu
from attlog.segments import hover, spans
from attlog.segments.flags import Phase
from attlog.segments.model import Segment
from attlog.segments.spans import Span
from attlog.segments.windows import Windows, join

Array = NDArray[np.float64]

FORCE_M_S2 = 4 * 9.80665
TUMBLE_DPS = 200.0
TILT_DEG = 90.0
END_S, LOST_S = 10.0, 3.0
LYING_DEG, LYING_DPS, LYING_S = 60.0, 10.0, 3.0
"""Thresholds proposed, not measured: the logs in hand hold few crashes (METRICS 1)."""
CRASH = re.compile(r"\bcrash(ed)?\b(?!.{0,2}(check|dump|log|catcher))", re.IGNORECASE)


def find(log: FlightLog, imu: Imu, airborne: Phase, lying: list[Span], t1: float) -> list[Segment]:
    """The first impact as a list of one segment that lasts to the log's end ``t1``, or an empty list.

    The autopilot's own crash message; or, in the air, a specific force above 4 g
    with a tumble (200 deg/s within half a second: a firm touch-down has none), or a
    tilt beyond 90 deg, either followed within 10 s by disarming or by lying still. A
    blow is also final if the log ends within 3 s: power is often lost with the rotors.
    """
    found = [
        Segment("impact", t, t1, f"the autopilot says: {text.strip()[:80]}")
        for t, _, text in log.texts
        if CRASH.search(text) and spans.inside(np.array([t]), _stretched(airborne.spans)).any()
    ]
    ends = [(a, "it lay still") for a, _ in lying] + [(t, "it was disarmed") for t in _disarmed(log)]
    blows = _blows(imu, airborne)
    for t, why in blows + _overturned(log, airborne):
        after = [(e, what) for e, what in ends if -0.5 <= e - t <= END_S]
        after += [(t1, "the log ended")] if (t, why) in blows and t1 - t <= LOST_S else []
        if after:
            end, what = min(after)
            when = f"{end - t:.1f} s later" if end - t >= 0.1 else "at once"
            found.append(Segment("impact", t, t1, f"{why}, and {when} {what}"))
    return sorted(found, key=lambda s: s.t0)[:1]


def lying(log: FlightLog, windows: Windows, still: list[Span]) -> list[Span]:
    """Stretches as still as a surface, and those of at least 3 s in which a rotorcraft lies beyond 60 deg of tilt."""
    if log.kind.winged:
        return still
    overturned = (windows.rate_rms < LYING_DPS) & (hover.tilt_deg(log, windows.middle) > LYING_DEG)
    return still + [(a, b) for a, b in join(windows, overturned) if b - a >= LYING_S]


def _disarmed(log: FlightLog) -> list[float]:
    """Times of disarming."""
    if log.armed is None:
        return []
    values = [bool(v) for v in log.armed.value]
    pairs = zip(values[:-1], values[1:], log.armed.t[1:], strict=True)
    return [float(t) for before, after, t in pairs if before and not after]


def _blows(imu: Imu, airborne: Phase) -> list[tuple[float, str]]:
    """Times and descriptions of specific forces above 4 g with a tumble, in the air or within 1 s of it."""
    force = np.sqrt(np.sum(imu.acc.x**2, axis=1))
    t = imu.acc.t_best
    hit = np.flatnonzero((force > FORCE_M_S2) & spans.inside(t, _stretched(airborne.spans)))
    speed = np.degrees(np.sqrt(np.sum(imu.gyro.x**2, axis=1)))
    tumbling = imu.gyro.t_best[speed > TUMBLE_DPS]
    near = np.searchsorted(tumbling, t[hit] + 0.5) > np.searchsorted(tumbling, t[hit] - 0.5)
    return [(float(t[i]), f"{force[i] / 9.80665:.1f} g with a tumble") for i in hit[near]]


def _overturned(log: FlightLog, airborne: Phase) -> list[tuple[float, str]]:
    """Starts of the segments in the air in which the onboard attitude lies beyond 90 deg of tilt."""
    attitude = log.attitudes.get(log.onboard or "")
    if attitude is None or len(attitude.t) == 0:
        return []
    over = np.degrees(rotation.inclination_angle(attitude.q))
    beyond = (over > TILT_DEG) & spans.inside(attitude.t, airborne.spans)
    starts = np.flatnonzero(beyond & ~np.concatenate([[False], beyond[:-1]]))
    return [(float(attitude.t[i]), f"tilt of {over[i]:.0f} deg") for i in starts]


def _stretched(airborne: list[Span]) -> list[Span]:
    """Flight with a second on each side: the land detector and the ground do not wait for each other."""
    return [(a - 1.0, b + 1.0) for a, b in airborne]
