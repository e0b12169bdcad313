"""The first part of a headline: when it flew, how high and how tilted; or why it never did."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from attlog.base import rotation
from attlog.flight.model import FlightLog
from attlog.segments.airborne.grid import runs
from attlog.segments.airborne.heights import highest
from attlog.segments.airborne.in_air import IDLING
from attlog.segments.model import Segments
from attlog.segments.motion import speed_m_s
from attlog.segments.spans import Span, inside
from attlog.story.event import Event, figures
from attlog.story.words import MOTOR_TEST, matching

TOGETHER_S = 5.0
"""Pushes of the throttle so close to each other are one."""
STOOD_S = 10.0
"""Motors that ran for longer than this before a flight are told."""
LISTED = 3
"""Up to so many flights are told with their times; more are counted."""
OF_FLIGHT = 0.5
"""Throttle is up above this part of its largest value."""
UPRIGHT_DEG = 30.0


def flown(log: FlightLog, segments: Segments, events: Sequence[Event]) -> list[str]:
    """When it flew, and how high and how tilted; or why it did not; the fullest first."""
    flights = segments.spans("airborne")
    crashed = any(e.is_crash for e in events)
    if not flights:
        return _grounded(log, segments, events)
    counted = f"{number(len(flights))} flights from {flights[0][0]:.0f} s"
    few = len(flights) < LISTED
    listed = f"flew {seconds_of(flights)}" if few else counted
    begun = flights[0][0] - min((s.t0 for s in segments.of("continuous")), default=0.0) < 0.5
    if begun and len(flights) == 1:
        listed = f"flying as the log begins, to {flights[0][1]:.0f} s"
    slow = segments.air is not None and segments.air.grid.slow
    rate = max((imu.acc.rate for imu in log.imus), default=0.0)
    listed = f"telemetry at {rate:.0f} Hz, {listed}" if slow and rate else listed
    stood = (
        f"stood armed to {flights[0][0]:.0f} s, " if few and not begun and _stood_armed(segments, flights[0][0]) else ""
    )
    sizes = [] if crashed else _sizes(log, segments, flights)
    unended = crashed or has_open_end(events) or has_hard_landing(events)
    safe = "" if unended else ending_of_slow(log, flights[-1][1]) if slow else ", landed safely"
    said = [f"{listed}{extra}{safe}." for extra in (*sizes, "")]
    return [f"{stood}{said[0]}", *said] if stood else said


def ending_of_slow(log: FlightLog, t: float) -> str:
    """How a vehicle stood after a flight whose end nothing faster than its attitude tells."""
    tilt = largest_tilt(log, [(t + 2.0, t + 5.0)])
    return "" if tilt is None else ", ended upright" if tilt < UPRIGHT_DEG else f", ended at {tilt:.0f}° of tilt"


def number(n: int) -> str:
    return ("no", "one", "two", "three", "four", "five", "six", "seven", "eight", "nine")[n] if n < 10 else str(n)


def _sizes(log: FlightLog, segments: Segments, flights: Sequence[Span]) -> list[str]:
    """Height and tilt reached, the fullest first."""
    air = segments.air
    found = None if air is None else highest(air.levels, inside(air.grid.t, flights))
    top = None if found is None else found[1]
    tilt = largest_tilt(log, flights)
    high = "" if top is None else f"{top:.0f} m" if top >= 2.0 else f"{top:.1f} m"
    tilted = "" if tilt is None or tilt < 1.0 else f"{tilt:.0f}° of tilt"
    both = " and ".join(x for x in (high, tilted) if x)
    return [f", up to {x}" for x in dict.fromkeys((both, high)) if x]


def largest_tilt(log: FlightLog, spans: Sequence[Span]) -> float | None:
    """The largest tilt (deg) of the onboard attitude within spans, None without one."""
    attitude = log.onboard_attitude or log.truth
    mine = None if attitude is None else inside(attitude.t, spans)
    if attitude is None or mine is None or not mine.any():
        return None
    return float(np.degrees(np.max(rotation.inclination_angle(attitude.q[mine]))))


def _stood_armed(segments: Segments, liftoff: float) -> bool:
    """Whether motors ran for more than 10 s before a lift-off, idling or more."""
    return any(a < liftoff <= b and liftoff - a > STOOD_S for a, b in segments.spans("armed"))


def _grounded(log: FlightLog, segments: Segments, events: Sequence[Event]) -> list[str]:
    """What it did that never flew."""
    # a failsafe after the last sample may be told beside it; other texts go on long after what was measured
    seconds = max([log.seconds, *(e.t for e in events if e.kind in ("failsafe", "battery"))])
    total = f"{seconds:.0f} s"
    if not log.kind.flies:
        air = np.arange(0.0, max(log.seconds, 1.0), 1.0)
        speed = speed_m_s(log, air)
        if not np.isfinite(speed).any():
            return [f"logged for {total}."]
        top = float(np.nanmax(speed))
        return [f"moved at up to {figures(top)} m/s in {total}." if top > 0.5 else f"stood still for {total}."]
    if "airborne" in segments.unknown:
        return [f"{f'{total}; ' if seconds > 0 else ''}nothing in the log shows whether it flew."]
    if any(e.is_crash for e in events):
        return ["never flew."]
    armed = sum(e.kind == "armed" for e in events)
    pushed = _pushed(segments)
    if not pushed:
        if not armed:
            never = "never armed" if log.armed is not None else "motors never ran"
            never = "only motor tests" if matching(log, MOTOR_TEST) else never
            tilt = largest_tilt(log, [(-1e9, 1e9)])
            return [f"{never} in {total}" + (f", tilted up to {tilt:.0f}° by hand." if tilt and tilt > 15 else ".")]
        return [f"armed{_times(armed)} but never left the ground in {total}."]
    up = f"throttle up {seconds_of(pushed)}" if len(pushed) < LISTED else f"throttle up {how_often(len(pushed))}"
    reason = _still_reason(log, segments, pushed)
    often = f"armed {how_often(armed)}, " if armed > 1 else ""
    return [f"never left the ground in {total}; {often}{up}{x}." for x in (reason, "")] + [
        f"never left the ground; {up}."
    ]


def _times(n: int) -> str:
    return f" {how_often(n)}" if n > 1 else ""


def how_often(n: int) -> str:
    return "twice" if n == 2 else f"{number(n)} times"


def _pushed(segments: Segments) -> list[Span]:
    """When throttle was up, for a second and more, with pauses of up to 5 s."""
    air = segments.air
    if air is None or not air.driven.any() or air.power_source == "arming":
        return []
    up = air.driven & (air.power > max(OF_FLIGHT * float(air.power[air.driven].max()), IDLING))
    found: list[Span] = []
    for a, b in runs(up):
        t0, t1 = float(air.grid.t[a]), float(air.grid.t[b - 1])
        if found and t0 - found[-1][1] < TOGETHER_S:
            found[-1] = found[-1][0], t1
        else:
            found.append((t0, t1))
    return [s for s in found if s[1] - s[0] >= 1.0]


def _still_reason(log: FlightLog, segments: Segments, pushed: Sequence[Span]) -> str:
    """The best reason why it did not fly: a height that did not move, or a tilt that did not change."""
    tilt = largest_tilt(log, pushed)
    levels = segments.air.levels if segments.air is not None else []
    ranged = log.rangefinder is not None and all(level.sensor != "range" for level in levels)
    said = ["rangefinder unmoved"] if ranged else []
    said += [f"tilt under {max(np.ceil(tilt), 1):.0f}°"] if tilt is not None and tilt < 15.0 else []
    return f"; {', '.join(said)}" if said else ""


def seconds_of(spans: Sequence[Span]) -> str:
    """Spans as "11 to 103 s and 120 to 130 s"."""
    return " and ".join(f"{a:.0f} to {b:.0f} s" for a, b in spans)


def has_open_end(events: Sequence[Event]) -> bool:
    return any(e.kind == "ends_in_air" for e in events)


def has_hard_landing(events: Sequence[Event]) -> bool:
    return any(e.kind == "hard_landing" for e in events)
