"""What the autopilot says about arming and flying, and what physics says to that.

A flag decides only where no sensor can: land detectors are late by seconds, and some are never updated.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from attlog.flight.model import FlightLog, Stream, TimeLine
from attlog.segments import spans
from attlog.segments.airborne.in_air import InAir
from attlog.segments.spans import Span

LYING_S = 5.0
"""Without arming or drive to tell: a rest this long is no flight."""
STOPPED = 0.01
"""Share of the motors' range up to which they stand still."""


@dataclass(slots=True)
class FlagSpans:
    """Spans in which something holds. ``known``: whether the log can tell; ``measured``: not by a flag."""

    known: bool
    spans: list[Span] = field(default_factory=list)
    why: str = ""
    measured: bool = False


def held(line: TimeLine, wanted: bool, t0: float, t1: float) -> list[Span]:
    """Spans of [t0, t1] in which a flag's truth is ``wanted``; before its first entry the first holds."""
    if not line.value:
        return []
    t = np.concatenate([[t0], np.clip(np.asarray(line.t, np.float64), t0, t1), [t1]])
    values = [bool(v) for v in line.value]
    entries = zip(t[:-1], t[1:], [values[0], *values], strict=True)
    return spans.merge((float(a), float(b)) for a, b, value in entries if value is wanted and b > a)


def armed(log: FlightLog, t0: float, t1: float) -> FlagSpans:
    """When the motors were armed, by the autopilot's flag; unknown without one."""
    if log.armed is None or not log.armed.value:
        return FlagSpans(False, why="the log holds no arming state")
    return FlagSpans(True, held(log.armed, True, t0, t1), f"armed by {log.armed.source}")


def airborne(
    log: FlightLog, armed: FlagSpans, air: InAir | None, flights: list[Span], lying: list[Span], t0: float, t1: float
) -> FlagSpans:
    """When the vehicle flew: by physics; by the land detector only where nothing else tells.

    ``air``: what the sensors show of flight over [t0, t1] s, None without any; ``flights``: those of them that count;
    ``lying``: spans as still as a surface.
    """
    if not log.kind.flies:
        return FlagSpans(True, [], f"a {log.vehicle} does not fly")
    if air is not None and air.known:
        return FlagSpans(True, flights, air.why)
    if log.landed is None or not log.landed.value:
        missing = "throttle" if air is None or air.power_source == "arming" else "height"
        return FlagSpans(False, why=f"the log holds no land detector and no {missing} to replace it")
    not_landed = held(log.landed, False, t0, t1)
    on_ground = [s for s in lying if s[1] - s[0] >= LYING_S]
    kept = spans.intersect(not_landed, armed.spans if armed.known else spans.complement(on_ground, t0, t1))
    return FlagSpans(True, kept, f"not landed by {log.landed.source}, and no sensor that could check it")


def motors(log: FlightLog, armed: FlagSpans, t0: float, t1: float) -> FlagSpans:
    """When motors turned: by their outputs, else arming, else rotor speed, else throttle; and which of them says so."""
    if log.motors is not None and len(log.motors.t) > 1:
        return FlagSpans(True, _above(log.motors, STOPPED), f"motors turn by {log.motors.source}", measured=True)
    if armed.known:
        return FlagSpans(True, armed.spans, "armed")
    for name, stream, limit in (("RPM", log.rpm, 100.0), ("throttle", log.throttle, 0.05)):
        if stream is not None and len(stream.t) > 1 and (name != "RPM" or np.fmax.reduce(stream.x, axis=None) > limit):
            return FlagSpans(True, _above(stream, limit), f"motors turn by {name}")
    return FlagSpans(False, [], "nothing shows whether motors turned")


def busy(armed: FlagSpans, motors: FlagSpans) -> list[Span]:
    """When nothing rests: while motors turn, and from arming on until they have turned for the last time."""
    last = [(a, max((d for _, d in spans.intersect([(a, b)], motors.spans)), default=a)) for a, b in armed.spans]
    return spans.merge([*motors.spans, *last])


def _above(stream: Stream, limit: float) -> list[Span]:
    """Spans in which any column of a stream exceeds a limit."""
    turning = np.nanmax(np.nan_to_num(stream.x.reshape(len(stream.t), -1)), axis=1) > limit
    entries = zip(stream.t[:-1], stream.t[1:], turning[:-1], strict=True)
    return spans.merge((float(a), float(b)) for a, b, on in entries if on)
