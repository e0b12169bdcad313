"""Arming, lift-off, landing, and how flights ended: the events of movement."""

from __future__ import annotations

import re

import numpy as np

from attlog.flight.model import FlightLog
from attlog.segments.airborne.heights import height
from attlog.segments.crash import Ending, fast_enough
from attlog.segments.model import Segments
from attlog.segments.spans import between
from attlog.story.event import Event, Weight, figures
from attlog.story.words import CRASHED, Text, matching, quoted

END_S = 1.0
"""A flight that lasts to within so much of the log's end has no end in it."""
BEGUN_S = 0.5
"""A flight that lasts from so soon after the log's begin had begun before."""
BOOT_S = 3600.0
SURE_HZ = 100.0
"""Below this rate of the IMU a blow was at least what it shows."""
TAKE_OFF = re.compile(r"takeoff detected", re.IGNORECASE)
LANDED = re.compile(r"landing detected|land complete", re.IGNORECASE)
NEAR_S = 5.0
MOVES, MOVES_S = 0.4, 2.0
OVER_DEG = 90.0


def events(log: FlightLog, segments: Segments) -> tuple[list[Event], list[Text]]:
    """The events in no order, and the texts that are told in them."""
    told: list[Text] = []
    found = [*_power_up(log), *_arming(log)]
    flights = segments.spans("airborne")
    crashes = [e for e in segments.endings if e.is_crash]
    end = max((s.t1 for s in segments.of("continuous")), default=log.seconds)
    begin = min((s.t0 for s in segments.of("continuous")), default=0.0)
    for a, b in flights:
        if a - begin > BEGUN_S:
            found.append(_flown(log, "liftoff", a, "Lifted off", matching(log, TAKE_OFF), told))
        ended = [e for e in segments.endings if abs(e.t - b) <= NEAR_S]
        if not ended and end - b < END_S:
            found.append(Event("ends_in_air", b, "note", f"The log ends in the air, at {b:.1f} s.", evidence=_by(log)))
        elif not ended:
            found.append(_flown(log, "landing", b, "Landed", matching(log, LANDED), told))
    said = matching(log, CRASHED)
    reported = [p for p in log.problems if p.code == "crash" and p.t is not None]
    for ending in segments.endings:
        evidence = list(_physics(ending))
        near = [x for x in said if -2.0 <= x[0] - ending.t <= 10.0] if ending.is_crash else []
        told += near
        evidence += [quoted(x) for x in near[:1]]
        evidence += [
            p.text for p in reported if p.t is not None and ending.is_crash and -2.0 <= p.t - ending.t <= 10.0
        ][:1]
        found.append(_ended(ending, evidence))
    found += _moved(segments, crashes, end)
    return found, told


def _power_up(log: FlightLog) -> list[Event]:
    """When the autopilot was switched on, where its clock tells."""
    at = -1e-6 * log.t0_us
    if not 0 <= log.t0_us < 1e6 * BOOT_S:
        return []
    text = f"Switched on {-at:.0f} s before the log’s first sample."
    return [Event("power_up", at, "info", text, evidence=["boot clock"])]


def _arming(log: FlightLog) -> list[Event]:
    """Arming and disarming, by the flag's changes; what holds at the log's start began before it."""
    line = log.armed
    if line is None or not line.value:
        return []
    found = []
    before: bool | None = None
    for t, value in zip(line.t.tolist(), line.value, strict=True):
        armed = bool(value)
        if (before is not None and armed != before) or (before is None and armed):
            kind, word = ("armed", "Armed") if armed else ("disarmed", "Disarmed")
            since = " before the log begins" if before is None and t <= 0.0 else f" at {t:.1f} s"
            found.append(Event(kind, t, "info", f"{word}{since}.", evidence=[line.source]))
        before = armed
    return found


def _flown(log: FlightLog, kind: str, t: float, word: str, texts: list[Text], told: list[Text]) -> Event:
    """A lift-off or landing, with what the autopilot says of it."""
    near = [x for x in texts if abs(x[0] - t) <= NEAR_S]
    told += near
    return Event(kind, t, "info", f"{word} at {t:.1f} s.", evidence=[*_by(log), *(quoted(x) for x in near[:1])])


def _by(log: FlightLog) -> list[str]:
    """What tells flight in a log: its IMU, else a height."""
    if log.imu is not None:
        return ["IMU"]
    stream = height(log)
    return ["throttle" if stream is None else stream.source]


def _physics(ending: Ending) -> tuple[str, ...]:
    return tuple(f"{source}: {ending.why}" for source in ending.sources[:2]) or (ending.why,)


def sized(ending: Ending) -> str:
    """The size of an ending, with "at least" where the IMU was too slow for its peak."""
    if ending.unit == "g":
        least = "at least " if ending.rate < SURE_HZ else ""
        return f"{least}{figures(ending.size)} g"
    return f"{ending.size:.0f}°" + ("/s" if ending.unit == "deg/s" else "")


def turned(ending: Ending) -> str:
    """What an overturn is called: up to 90 deg it fell over."""
    return "Turned over" if ending.size > OVER_DEG else "Fell over"


def _ended(ending: Ending, evidence: list[str]) -> Event:
    lies = "" if ending.lies_deg is None else f" It then lay at {ending.lies_deg:.0f}°."
    words = {
        "impact": f"Hit the ground or an obstacle at {ending.t:.1f} s: {sized(ending)}.",
        "hard_landing": f"Hard landing at {ending.t:.1f} s: {sized(ending)}, and it stayed upright.",
        "overturn": f"{turned(ending)} at {ending.t:.1f} s, to {sized(ending)}.",
        "tumble": f"Tumbled at {ending.t:.1f} s, at up to {sized(ending)}, which nobody asked for.",
    }
    weight: Weight = "serious" if ending.is_crash else "warning"
    text = words[ending.kind] + (lies if ending.is_crash else "")
    unit = {"deg": "°", "deg/s": "°/s"}.get(ending.unit, ending.unit)
    t_end = ending.t_end if ending.t_end - ending.t > 0.5 else None
    return Event(ending.kind, ending.t, weight, text, t_end, round(ending.size, 2), unit, evidence)


def _moved(segments: Segments, crashes: list[Ending], end: float) -> list[Event]:
    """When a wreck was picked up or moved: it lay still for a while, and then moves without drive."""
    air = segments.air
    if air is None or not crashes or air.grid.slow:
        return []
    grid, found = air.grid, []
    for wreck in [s for kind in ("impact", "loss_of_control") for s in segments.of(kind)]:
        part = between(grid.t, wreck.t0 + NEAR_S, min(wreck.t1, end))
        moves = (np.nan_to_num(grid.dynamics[part]) > MOVES) & ~air.driven[part] & grid.known[part]
        still = np.flatnonzero(np.nan_to_num(grid.dynamics[part], nan=9.0) < 0.0)
        if len(still) and moves[still[0] :].sum() * 0.1 >= MOVES_S:
            t = float(grid.t[part][still[0] + int(np.argmax(moves[still[0] :]))])
            text = f"The wreck was moved or carried from {t:.0f} s."
            found.append(Event("wreck_moved", t, "info", text, evidence=["IMU, without drive"]))
    return found[:1]


def blows_told(log: FlightLog) -> str:
    """Why a crash that left it upright could not be told; empty where the IMU is fast enough."""
    rate = max((imu.acc.rate for imu in log.imus), default=0.0)
    if fast_enough(log) or rate == 0.0:
        return ""
    return f"IMU at {rate:.0f} Hz: a blow shorter than {1000.0 / rate:.0f} ms would not show"
