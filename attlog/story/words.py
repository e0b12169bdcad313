"""What autopilots say, by kind: texts are told once, at their time, in the autopilot's own words."""

from __future__ import annotations

import re
from collections.abc import Iterable

from attlog.flight.model import FlightLog
from attlog.segments.spans import Span
from attlog.story.event import Event, Weight

Text = tuple[float, int, str]

WARNING = 4
"""The level of syslog from which a text is a warning."""
NEAR_S = 2.0
PLAIN = re.compile(
    r"fail|crash|glitch|variance|unhealthy|not healthy|inconsistent|error|lost|bad |emergency|terminat|estop|"
    r"thrust loss|imbalance|vibration comp|clipping|parachute|forced reset|stopped aiding|re-aligned|lane switch|"
    r"not safe|land now|too |needs calibration|low batt|battery \d? ?(is )?(low|critical)|rejected|timeout|"
    r"dead reckon|kill.?switch|thrust|throttle not",
    re.IGNORECASE,
)
"""ArduPilot gives most of its texts one level: these words make one a warning."""
NO_WARNING = re.compile(
    r"failsafe (cleared|deactivated)|glitch cleared|autotest|^SRC=|^scenario: |no error|fail.?safe.*(off|disabled)",
    re.I,
)
REALIGNED = re.compile(r"yaw re-?aligned|yaw align|yaw reset|emergency yaw", re.IGNORECASE)
ANOMALY = re.compile(r"anomaly|re-?aligned|reset|emergency", re.IGNORECASE)
LANE = re.compile(r"lane switch|primary EKF changed|primary changed", re.IGNORECASE)
COMPASS = re.compile(r"switching to compass|(mag|compass).*(switch|failed|failover)", re.IGNORECASE)
JUMP = re.compile(r"gps glitch(?! cleared)|gnss.*jump|gps.*jamm|spoof", re.IGNORECASE)
CLIPS = re.compile(r"clipping", re.IGNORECASE)
CRASHED = re.compile(r"\bcrash(ed)?\b(?!.{0,2}(check|dump|log|catcher))|crash: disarm", re.IGNORECASE)
KILLED = re.compile(r"kill.?switch engaged|motor ?e-?stop(ped)?( |:)*(high|on|engaged)?$|emergency stop", re.IGNORECASE)
FAILSAFE = re.compile(r"failsafe", re.IGNORECASE)
BATTERY = re.compile(r"batt", re.IGNORECASE)
MOTOR_TEST = re.compile(r"^starting motor test", re.IGNORECASE)
PREARM = re.compile(r"pre-?arm|preflight fail|^arm:|arming denied|arming_checks", re.IGNORECASE)
ARMING = re.compile(r"^pre-?arm|^arm:", re.IGNORECASE)
PREFIX = re.compile(r"^\[[\w ]+\]\s*")
LONGEST = 110
MOST = 100
"""A flight says a few dozen things; a damaged one could say anything."""


def cleaned(text: str) -> str:
    """A text without the module's name before it, in one line."""
    return PREFIX.sub("", " ".join(text.split()))[:LONGEST].strip()


def quoted(text: Text) -> str:
    """A text as evidence."""
    return f"text at {text[0]:.1f} s: {cleaned(text[2])}"


def matching(log: FlightLog, pattern: re.Pattern[str]) -> list[Text]:
    """The texts that a pattern fits, in time order; what is said of arming alone is none."""
    return sorted((x for x in log.texts if pattern.search(x[2]) and not ARMING.search(x[2])), key=lambda x: x[0])


def is_warning(text: Text) -> bool:
    """Whether the autopilot warns with a text."""
    return not NO_WARNING.search(text[2]) and (text[1] <= WARNING or bool(PLAIN.search(text[2])))


def messages(log: FlightLog, told: Iterable[Text], flights: list[Span]) -> list[Event]:
    """The warnings and errors that stand in no other event; one that repeats is one event.

    In flight (``flights``) they are warnings, on the ground notes.
    """
    near = [(a - NEAR_S, b + NEAR_S) for a, b in flights]
    taken = {(t, text) for t, _, text in told}
    found: dict[str, list[Text]] = {}
    for text in sorted(log.texts, key=lambda x: x[0]):
        if is_warning(text) and (text[0], text[2]) not in taken:
            found.setdefault(cleaned(text[2]), []).append(text)
    events = []
    for words, texts in list(found.items())[:MOST]:
        first, last = texts[0], texts[-1]
        in_flight = any(a <= t <= b for t, _, _ in texts for a, b in near)
        weight: Weight = "warning" if in_flight and not PREARM.search(first[2]) else "note"
        times = f" ({len(texts)} times)" if len(texts) > 1 else ""
        t_end = last[0] if len(texts) > 1 else None
        events.append(Event("message", first[0], weight, f"“{words}”{times}.", t_end, evidence=[quoted(first)]))
    return events
