"""What the autopilot says about arming and flying, and what the sensors say to that.

A flag alone never decides: "not landed" of a disarmed vehicle, or of one that lies
as still as a table, is a flag that nobody updated; "landed" throughout a flight
that climbs is one too.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from attlog.flight.model import FlightLog, Stream, TimeLine
from attlog.segments import spans
from attlog.segments.spans import Span

Array = NDArray[np.float64]

CLIMB_M = 1.0
"""Height above the ground from which a vehicle with throttle is taken to fly."""

STUCK_CLIMB_M = 5.0
"""A climb by this much while the land detector says "landed" refutes it."""


@dataclass(slots=True)
class Phase:
    """Stretches in which something holds. ``known`` is False where the log cannot tell."""

    known: bool
    spans: list[Span] = field(default_factory=list)
    why: str = ""


def held(line: TimeLine, wanted: bool, t0: float, t1: float) -> list[Span]:
    """Stretches of [t0, t1] in which a flag's truth is ``wanted``; before its first entry the first holds."""
    if not line.value:
        return []
    t = np.concatenate([[t0], np.clip(np.asarray(line.t, np.float64), t0, t1), [t1]])
    values = [bool(v) for v in line.value]
    entries = zip(t[:-1], t[1:], [values[0], *values], strict=True)
    return spans.merge((float(a), float(b)) for a, b, value in entries if value is wanted and b > a)


def armed(log: FlightLog, t0: float, t1: float) -> Phase:
    """When the motors were armed, by the autopilot's flag; unknown without one."""
    if log.armed is None or not log.armed.value:
        return Phase(False, why="the log holds no arming state")
    return Phase(True, held(log.armed, True, t0, t1), f"armed by {log.armed.source}")


def airborne(log: FlightLog, armed: Phase, still: list[Span], t0: float, t1: float) -> Phase:
    """When the vehicle flew: the land detector checked by arming, stillness and height; else throttle with climb."""
    if not log.kind.flies:
        return Phase(True, [], f"a {log.vehicle} does not fly")
    climb = _throttle_and_climb(log, armed, t0, t1)
    if log.landed is None or not log.landed.value:
        return climb
    flying = held(log.landed, False, t0, t1)
    source = log.landed.source
    if not flying and climb.known and climb.spans and _highest(log, climb.spans) > STUCK_CLIMB_M:
        return Phase(True, climb.spans, f"{source} says landed throughout, yet {climb.why}")
    kept = spans.intersect(flying, armed.spans) if armed.known else flying
    doubted = [s for s in still if s[1] - s[0] >= 5.0] if not armed.known else []
    kept = spans.intersect(kept, spans.complement(doubted, t0, t1))
    why = f"not landed by {source}"
    refused = spans.seconds(flying) - spans.seconds(kept)
    if refused > 1.0:
        against = "the vehicle was disarmed" if armed.known else "the sensors lie still"
        why += f"; {refused:.0f} s of it refused because {against}"
    return Phase(True, kept, why)


def height(log: FlightLog) -> Stream | None:
    """Height in m over time: the barometer, else GNSS altitude with a 3D fix, else None."""
    for stream in log.baro:
        x = stream.x.reshape(len(stream.t), -1)[:, 0] if len(stream.t) else np.zeros(0)
        if stream.unit == "m" and np.count_nonzero(np.isfinite(x)) > 10:
            good = np.isfinite(x)
            return Stream(stream.t[good], x[good, None], "m", "", stream.source)
    for gnss in log.gnss:
        good = (gnss.fix >= 3) & np.isfinite(gnss.alt)
        if np.count_nonzero(good) > 10:
            return Stream(gnss.t[good], gnss.alt[good, None], "m", "", gnss.source)
    return None


def _throttle_and_climb(log: FlightLog, armed: Phase, t0: float, t1: float) -> Phase:
    """Flight without a land detector: from take-off throttle and climb to the last moment above ground."""
    above = height(log)
    if log.throttle is None or len(log.throttle.t) < 2 or above is None or len(above.t) < 2:
        missing = "throttle" if log.throttle is None else "height"
        return Phase(False, why=f"the log holds no land detector and no {missing} to replace it")
    t, x = log.throttle.t, log.throttle.x.reshape(len(log.throttle.t), -1)[:, 0]
    x = np.where(np.isfinite(x), x, 0.0)
    up = x > 0.3 * np.percentile(x, 95) if np.percentile(x, 95) > 0 else np.zeros(len(x), bool)
    found: list[Span] = []
    for a, b in armed.spans if armed.known else [(t0, t1)]:
        inside = (above.t >= a - 1.0) & (above.t <= b + 1.0)
        if np.count_nonzero(inside) < 3:
            continue
        ht, hx = above.t[inside], above.x[inside, 0]
        start, end = float(np.median(hx[:3])), float(np.median(hx[-3:]))
        flying = np.interp(ht, t, up.astype(np.float64)) > 0.5
        took_off = np.flatnonzero(flying & (hx - start > CLIMB_M))
        if len(took_off) == 0:
            continue
        above_end = np.flatnonzero(flying & (np.arange(len(ht)) >= took_off[0]) & (hx - end > CLIMB_M))
        last = above_end[-1] if len(above_end) else len(ht) - 1
        found.append((max(float(ht[took_off[0]]), a), min(float(ht[last]), b)))
    return Phase(True, spans.merge(found), f"throttle ({log.throttle.source}) with a climb by {above.source}")


def _highest(log: FlightLog, within: list[Span]) -> float:
    """The largest height in m above the start of the segments."""
    above = height(log)
    if above is None or not within:
        return 0.0
    inside = spans.inside(above.t, within)
    return float(np.max(above.x[inside, 0]) - np.interp(within[0][0], above.t, above.x[:, 0])) if inside.any() else 0.0
