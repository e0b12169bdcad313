"""Failsafes, the kill switch and the battery: what the autopilot did about trouble."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from attlog.flight.model import FlightLog
from attlog.segments.model import Segments
from attlog.segments.spans import inside
from attlog.story.event import Event, Weight, moment
from attlog.story.words import BATTERY, FAILSAFE, KILLED, NO_WARNING, Text, matching, quoted

CAUSE_S = 2.0
"""A failsafe's cause is said so soon before or after it."""
AGAIN_S = 60.0
KILLED_S = 1.0
MEASURED_S = 1.0
"""In a log's first second a battery may not have been measured yet."""
ENDED_S = 2.0
"""A failsafe so soon after a landing still belongs to the flight; a mode set so soon before one ends none."""
AT_ONCE_S = 10.0
SET_S = 1.0
"""A failsafe sets its mode so soon before or after it is told."""
NAMED = (
    (re.compile(r"\bradio|\brc\b|\bmanual control|trigger 0x[13]\b", re.I), "Radio failsafe"),
    (re.compile(r"\bgcs\b|ground station|data ?link|trigger 0x2\b", re.I), "Ground station failsafe"),
    (re.compile(r"\bekf\b", re.I), "EKF failsafe"),
    (re.compile(r"\bgps\b|\bgnss\b", re.I), "GNSS failsafe"),
    (re.compile(r"\bterrain", re.I), "Terrain failsafe"),
)
"""What a failsafe is of, where its text says so. Rovers to 2.50 say bits: 1 throttle, 2 ground station (APMrover2,
defines.h)."""
FIRST_FIX_S, FIX_3D = 5.0, 3
"""The failsafe of GNSS means 5 s without a position: so soon after the first one they cannot have passed."""
CODES = {
    "err_5_1": "Radio failsafe",
    "err_7_1": "GNSS failsafe",
    "err_8_1": "Ground station failsafe",
    "err_23_1": "Terrain failsafe",
    "ekf_failsafe": "EKF failsafe",
    "vibration_failsafe": "Vibration failsafe",
    "err_31_1": "Dead reckoning failsafe",
    "failsafe": "Failsafe",
}
"""ERR records of ArduPilot and PX4's flag, by the codes of their problems."""


def events(log: FlightLog, segments: Segments) -> tuple[list[Event], list[Text]]:
    """The events in no order, and the texts that are told in them."""
    told: list[Text] = []
    found = _killed(log, segments, told)
    said = [x for x in matching(log, FAILSAFE) if not NO_WARNING.search(x[2])]
    low = matching(log, BATTERY)
    for text in said:
        t = text[0]
        causes = [x for x in low if abs(x[0] - t) <= CAUSE_S]
        battery = bool(causes) or bool(BATTERY.search(text[2]))
        told += [text, *causes]
        kind = "battery" if battery else "failsafe"
        if any(e.kind == kind and (e.t_end or e.t) > t - AGAIN_S for e in found):
            continue
        found.append(_event(kind, t, _named(text, battery), [quoted(text), *(quoted(x) for x in causes[:1])]))
    for problem in log.problems:
        if problem.t is None or _known(found, problem.t):
            continue
        if problem.code == "err_6_1":
            found.append(_event("battery", problem.t, "Battery failsafe", [problem.text]))
        elif problem.code in CODES:
            words = f"{CODES[problem.code]} {moment(problem.t)}."
            first = problem.code == "err_7_1" and _first_fix(log, problem.t)
            early: Weight = "note" if problem.t < MEASURED_S or first else "warning"
            found.append(Event("failsafe", problem.t, early, words, evidence=[problem.text]))
    return [_weighed(e, segments) for e in found], told


def _first_fix(log: FlightLog, t: float) -> bool:
    """Whether GNSS has just found its first 3D fix: ArduPilot 3 counts the seconds without one from its start, and
    begins to look only now (ArduCopter/events.pde, failsafe_gps_check)."""
    first = min((float(g.t[g.fix >= FIX_3D][0]) for g in log.gnss if (g.fix >= FIX_3D).any()), default=np.inf)
    return 0.0 <= t - first < FIRST_FIX_S


def _weighed(event: Event, segments: Segments) -> Event:
    """A failsafe as it counts: of a vehicle that is known to be disarmed it warns nobody."""
    if "armed" in segments.unknown:
        return event
    driven = [(a, b + CAUSE_S) for a, b in (*segments.spans("armed"), *segments.spans("airborne"))]
    return event if inside(np.array([event.t]), driven).any() else replace(event, severity="note")


def _known(found: list[Event], t: float) -> bool:
    return any(abs(e.t - t) <= AGAIN_S and e.kind in ("failsafe", "battery") for e in found)


def _named(text: Text, battery: bool) -> str:
    """What a failsafe is called, by the autopilot's words."""
    return "Battery failsafe" if battery else next((name for words, name in NAMED if words.search(text[2])), "Failsafe")


def _event(kind: str, t: float, words: str, evidence: list[str]) -> Event:
    weight: Weight = "note" if kind == "battery" and t < MEASURED_S else "warning"
    return Event(kind, t, weight, f"{words} {moment(t)}.", evidence=evidence)


def _killed(log: FlightLog, segments: Segments, told: list[Text]) -> list[Event]:
    """The kill switch, which stops motors wherever the vehicle is; on the ground nothing is wrong with that."""

    def weight(t: float) -> Weight:
        flown = [(a, b + KILLED_S) for a, b in segments.spans("airborne")]
        return "warning" if "airborne" in segments.unknown or inside(np.array([t]), flown).any() else "note"

    found: list[Event] = []
    texts = matching(log, KILLED)
    told += texts
    for text in texts:
        if not any(abs(e.t - text[0]) < AGAIN_S for e in found):
            found.append(
                Event("failsafe", text[0], weight(text[0]), f"Kill switch at {text[0]:.1f} s.", evidence=[quoted(text)])
            )
    stopped = [p for p in log.problems if p.code == "ev_54" and p.t is not None]
    if not found and stopped and stopped[0].t is not None:
        t = stopped[0].t
        found.append(Event("failsafe", t, weight(t), f"Kill switch at {t:.1f} s.", evidence=[stopped[0].text]))
    return found


def in_headline(first: list[str], log: FlightLog, segments: Segments, events: Sequence[Event]) -> list[str]:
    """What went wrong first and, where that is something else, the last failsafe in flight; one that ended the flight
    is told in any case.

    One of a disarmed vehicle that never flew warns nobody, but is what happened where nothing else did.
    """
    crash = next((e.t for e in events if e.is_crash), np.inf)
    found = [e for e in events if e.kind in ("failsafe", "battery") and "Kill switch" not in e.text]
    for a, b in reversed(segments.spans("airborne")):
        aloft = [e for e in found if e.severity == "warning" and a <= e.t <= min(b + ENDED_S, crash)]
        if aloft:
            last = aloft[-1]
            both = [x if x == last.text else f"{x} {last.text}" for x in first if x] or [last.text]
            return [*both, last.text] if _ended_it(log, last.t, b) else list(dict.fromkeys((*both, *first)))
    if first == [""] and not segments.spans("airborne") and "armed" not in segments.unknown:
        idle = [e for e in found if e.t >= MEASURED_S and not inside(np.array([e.t]), segments.spans("armed")).any()]
        return [f"{idle[0].text.rstrip('.')}, disarmed.", ""] if idle else first
    return first


def _ended_it(log: FlightLog, t: float, landing: float) -> bool:
    """Whether a failsafe at ``t`` ended a flight: it landed at once, or nobody changed the mode that was set then."""
    if landing - t <= AT_ONCE_S:
        return True
    set_ = [] if log.mode is None else [x for x in log.mode.t.tolist() if t - SET_S <= x < landing - ENDED_S]
    return bool(set_) and set_[-1] <= t + SET_S
