"""Failsafes, kill switch and battery warnings of the autopilot, each with its reason."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from attlog.core.spans import inside
from attlog.flight.model import FIX_3D, FlightLog
from attlog.segments.model import Segments
from attlog.story import causes
from attlog.story.flight_events import (
    BATTERY,
    FAILSAFE,
    HARMLESS_WORDS,
    KILLED,
    LANE,
    PREARM,
    REALIGNED,
    Event,
    EventSeverity,
    Text,
    clean_text,
    format_time,
    is_warning,
    matching_texts,
    quote_text,
)

# Maximum time between a failsafe and the text with its cause, and between two reports of one failsafe.
CAUSE_S, AGAIN_S = 2.0, 60.0
# A kill switch up to this long after landing is one of the flight.
KILLED_S = 1.0
# Battery values in the first second of a log may be unmeasured.
MEASURED_S = 1.0
# A failsafe up to this long after landing belongs to the flight; a mode set later than this before landing did not end
# it.
ENDED_S = 2.0
AT_ONCE_S = 10.0
# First word of a failsafe without a name, and what the kill switch is about.
UNNAMED, KILL = "Failsafe", "kill switch"
# Name of a low battery without a failsafe, and PX4's parameter that is 0 where a low battery only warns.
LOW_BATTERY, BATTERY_ACTION = "Low battery", "COM_LOW_BAT_ACT"
# Maximum time between a failsafe's text and its mode change.
SET_S = 1.0
# Name of a failsafe by its text. Rover up to 2.50 reports bits: 1 throttle, 2 ground station (APMrover2, defines.h).
FAILSAFE_NAMES = (
    (re.compile(r"\bradio|\brc\b|\bmanual control|trigger 0x[13]\b", re.I), "Radio failsafe"),
    (re.compile(r"\bgcs\b|ground station|data ?link|trigger 0x2\b", re.I), "Ground station failsafe"),
    (re.compile(r"\bekf\b", re.I), "EKF failsafe"),
    (re.compile(r"\bgps\b|\bgnss\b", re.I), "GNSS failsafe"),
    (re.compile(r"\bterrain", re.I), "Terrain failsafe"),
)
# PX4's text of what a failsafe does.
ACTION = re.compile(r"^failsafe: *(\w[\w -]*)$", re.IGNORECASE)
# PX4's words for stopped motors, beside those of the kill switch.
TERMINATED = re.compile(r"flight termination active", re.IGNORECASE)
# Words before the reason in a text.
REPORTED = re.compile(r"^(preflight fail|failsafe): *", re.IGNORECASE)
# A GNSS failsafe needs 5 s without a position, so it is false within 5 s of the first fix.
FIRST_FIX_S = 5.0
# Failsafe name by problem code (ArduPilot ERR records, PX4 flag).
FAILSAFE_CODES = {
    "err_5_1": "Radio failsafe",
    "err_6_1": "Battery failsafe",
    "err_7_1": "GNSS failsafe",
    "err_8_1": "Ground station failsafe",
    "err_23_1": "Terrain failsafe",
    "ekf_failsafe": "EKF failsafe",
    "vibration_failsafe": "Vibration failsafe",
    "err_31_1": "Dead reckoning failsafe",
    "failsafe": "Failsafe",
}


def failsafe_events(log: FlightLog, segments: Segments) -> tuple[list[Event], list[Text]]:
    """Return events of failsafes, kill switch and battery, unordered, and their texts."""
    quoted: list[Text] = []
    found = _kill_switch_events(log, segments, quoted)
    said = [x for x in matching_texts(log, FAILSAFE) if not HARMLESS_WORDS.search(x[2])]
    low = sorted(x for x in log.texts if BATTERY.search(x[2]) and is_warning(x))
    for text in said:
        t = text[0]
        drained = [x for x in low if abs(x[0] - t) <= CAUSE_S and x != text]
        battery = bool(drained) or bool(BATTERY.search(text[2]))
        quoted += [text, *drained]
        kind = "battery" if battery else "failsafe"
        together = [x for x in said if abs(x[0] - t) <= CAUSE_S]
        name = next((name for x in together if (name := _failsafe_name(x, battery)) != "Failsafe"), "Failsafe")
        if battery and log.param(BATTERY_ACTION) == 0:
            name = LOW_BATTERY
        if any(e.kind == kind and _is_repeated(name, t, e) for e in found if e.t <= t):
            continue
        reasons = drained or ([] if battery else _failsafe_reasons(log, t, said))
        quoted += reasons
        evidence = [quote_text(x) for x in (text, *reasons[:1])]
        found.append(_failsafe_event(kind, t, name, evidence, _failsafe_quote(text, reasons)))
    for problem in log.problems:
        at = problem.t
        name = FAILSAFE_CODES.get(problem.code, "")
        if at is None or not name or any(_is_repeated(name, at, e) for e in found):
            continue
        if problem.code == "err_6_1":
            found.append(_failsafe_event("battery", at, name, [problem.text]))
        else:
            words = f"{name} {format_time(at)}."
            first = problem.code == "err_7_1" and _first_fix(log, at)
            early: EventSeverity = "note" if at < MEASURED_S or first else "warning"
            found.append(Event("failsafe", at, early, words, evidence=[problem.text], about=_about(name)))
    found += _low_battery_events([x for x in low if not PREARM.search(x[2])], found, quoted)
    return [_weigh_failsafe(e, segments) for e in found], quoted


def _is_repeated(name: str, t: float, other: Event) -> bool:
    """Return whether a failsafe is another event again: at the same time, or of the same or no name within a minute.

    What follows a kill switch within a minute belongs to it.
    """
    apart = t - (other.t_end or other.t)
    same = name.startswith(UNNAMED) or other.text.startswith((UNNAMED, name)) or (other.about == KILL and apart >= 0.0)
    return abs(apart) <= (AGAIN_S if same else CAUSE_S)


def _failsafe_reasons(log: FlightLog, t: float, failsafes: Sequence[Text]) -> list[Text]:
    """Return the warnings that the autopilot gave with a failsafe, the last one before it first."""
    near = [x for x in log.texts if abs(x[0] - t) <= CAUSE_S and is_warning(x) and x not in failsafes]
    near = [x for x in near if not any(p.search(x[2]) for p in (LANE, REALIGNED))]
    return sorted(near, key=lambda x: (x[0] > t, abs(x[0] - t)))


def _failsafe_quote(text: Text, reasons: Sequence[Text]) -> str:
    """Return the autopilot's reason for a failsafe, else the text of the failsafe."""
    return REPORTED.sub("", clean_text(reasons[0][2] if reasons else text[2]))


def _low_battery_events(texts: Sequence[Text], found: Sequence[Event], quoted: list[Text]) -> list[Event]:
    """Return warnings of a low battery, one for all within a minute; those near a battery failsafe belong to it."""
    events: list[Event] = []
    for text in texts:
        if text in quoted:
            continue
        quoted.append(text)
        before = [e for e in (*found, *events) if e.kind == "battery" and abs((e.t_end or e.t) - text[0]) <= AGAIN_S]
        if not before:
            evidence, words = [quote_text(text)], clean_text(text[2])
            events.append(_failsafe_event("battery", text[0], LOW_BATTERY, evidence, words))
        elif before[-1] in events:
            events[-1] = replace(events[-1], t_end=text[0], evidence=[*events[-1].evidence, quote_text(text)])
    return events


def _first_fix(log: FlightLog, t: float) -> bool:
    """Return whether GNSS has just found its first 3D fix.

    ArduPilot 3 counts the seconds without one from its start, and begins to look only now (ArduCopter/events.pde,
    failsafe_gps_check).
    """
    first = min((float(g.t[g.fix >= FIX_3D][0]) for g in log.gnss if (g.fix >= FIX_3D).any()), default=np.inf)
    return 0.0 <= t - first < FIRST_FIX_S


def _weigh_failsafe(event: Event, segments: Segments) -> Event:
    """Set the severity of a failsafe: a note while disarmed."""
    if "armed" in segments.unknown:
        return event
    driven = [(a, b + CAUSE_S) for a, b in (*segments.spans("armed"), *segments.spans("airborne"))]
    return event if inside(np.array([event.t]), driven).any() else replace(event, severity="note")


def _failsafe_name(text: Text, battery: bool) -> str:
    """Return the name of a failsafe by the autopilot's text, else the action that the text names."""
    if battery:
        return "Battery failsafe"
    named = next((name for words, name in FAILSAFE_NAMES if words.search(text[2])), "")
    action = ACTION.search(clean_text(text[2]))
    return named or (f"Failsafe “{action.group(1)}”" if action else "Failsafe")


def _failsafe_event(kind: str, t: float, words: str, evidence: list[str], quote: str = "") -> Event:
    weight: EventSeverity = "note" if kind == "battery" and t < MEASURED_S else "warning"
    text, about = f"{words} {format_time(t)}.", _about(words)
    return Event(kind, t, weight, text, evidence=evidence, quote=quote, about=about)


def _about(name: str) -> str:
    """Return what a failsafe is about, as "radio"; empty where its name does not say."""
    about, _, rest = name.lower().partition(" failsafe")
    return about if about != name.lower() and not rest else ""


def _kill_switch_events(log: FlightLog, segments: Segments, quoted: list[Text]) -> list[Event]:
    """Return uses of the kill switch; on the ground they are notes."""

    def weight(t: float) -> EventSeverity:
        flown = [(a, b + KILLED_S) for a, b in segments.spans("airborne")]
        return "warning" if "airborne" in segments.unknown or inside(np.array([t]), flown).any() else "note"

    found: list[Event] = []
    texts = matching_texts(log, KILLED)
    ended = [
        x for x in log.texts if TERMINATED.search(x[2]) and any(-CAUSE_S <= x[0] - t <= AGAIN_S for t, _, _ in texts)
    ]
    quoted += [*texts, *ended]
    for text in texts:
        if not any(abs(e.t - text[0]) < AGAIN_S for e in found):
            found.append(
                Event(
                    "failsafe",
                    text[0],
                    weight(text[0]),
                    f"Kill switch at {text[0]:.1f} s.",
                    evidence=[quote_text(x) for x in (text, *ended[:1])],
                    quote=clean_text(text[2]),
                    about=KILL,
                )
            )
    stopped = [p for p in log.problems if p.code == "ev_54" and p.t is not None]
    if not found and stopped and stopped[0].t is not None:
        t = stopped[0].t
        evidence = [stopped[0].text]
        found.append(Event("failsafe", t, weight(t), f"Kill switch at {t:.1f} s.", evidence=evidence, about=KILL))
    return found


def failsafe_phrases(first: list[str], log: FlightLog, segments: Segments, events: Sequence[Event]) -> list[str]:
    """Return the first fault and, where it differs, the last failsafe in flight, for the headline.

    A failsafe that ended the flight is always named. One of a disarmed vehicle that never flew is named where nothing
    else happened.
    """
    crash = next((e.t for e in events if e.is_crash), np.inf)
    found = [e for e in events if e.kind in ("failsafe", "battery") and e.about != KILL]
    for a, b in reversed(segments.spans("airborne")):
        aloft = [e for e in found if e.severity == "warning" and a <= e.t <= min(b + ENDED_S, crash)]
        if aloft:
            last = aloft[-1]
            own = causes.effect_phrase(last.text, last.t)
            both = [x if x == last.text or own in x else f"{x} {last.text}" for x in first if x] or [last.text]
            return [*both, last.text] if _ended_it(log, last.t, b) else list(dict.fromkeys((*both, *first)))
    if first == [""] and not segments.spans("airborne") and "armed" not in segments.unknown:
        idle = [e for e in found if e.t >= MEASURED_S and not inside(np.array([e.t]), segments.spans("armed")).any()]
        return [f"{idle[0].text.rstrip('.')}, disarmed.", ""] if idle else first
    return first


def _ended_it(log: FlightLog, t: float, landing: float) -> bool:
    """Return whether a failsafe at ``t`` ended the flight.

    The vehicle landed within 10 s, or in the mode set at the failsafe.
    """
    if landing - t <= AT_ONCE_S:
        return True
    set_ = (
        [] if log.state.mode is None else [x for x in log.state.mode.t.tolist() if t - SET_S <= x < landing - ENDED_S]
    )
    return bool(set_) and set_[-1] <= t + SET_S
