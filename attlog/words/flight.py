"""What flew, when, how long, with which sensors: the line below the title."""

from __future__ import annotations

import re
from dataclasses import dataclass
from typing import TYPE_CHECKING

from attlog.result import Result
from attlog.words.names import truth_name
from attlog.words.numbers import duration, number

if TYPE_CHECKING:
    from attlog.result import CommonBias


COMPARED_WITH = {"truth": "the logged truth", "smoother": "the smoother", "onboard": "the onboard attitude"}


def subtitle(result: Result) -> list[str]:
    """The parts of the line below the title."""
    log, reference = result.log, result.reference
    vehicle = str(log.get("vehicle") or "vehicle unknown")
    what = [firmware(result), "(simulated)" if log.get("simulated") else ""]
    date = str(log["date_utc"])[:16].replace("T", " ") + " UTC" if log.get("date_utc") else "date unknown"
    compared = COMPARED_WITH.get(reference.choice) if reference else None
    if reference is not None and reference.fit is not None:
        compared = f"{truth_name(result)} ({reference.source})"
    parts = [vehicle[:1].upper() + vehicle[1:], " ".join(filter(None, what)), date, flight_length(result)]
    return [p for p in parts if p] + [f"compared with {compared}" if compared else "nothing to compare with"]


def what_happened(result: Result) -> str:
    """The headline without who flew, which stands in the line below the title."""
    who, colon, what = result.headline.partition(": ")
    return what[:1].upper() + what[1:] if colon else who


def flight_tone(result: Result) -> str:
    """How bad a flight was: ``bad``, ``warn``, ``good``, or empty where nothing flew or nothing can be told."""
    if any(event.is_crash for event in result.events):
        return "bad"
    found = {finding.severity for finding in result.findings}
    if "serious" in found or "warning" in found:
        return "bad" if "serious" in found else "warn"
    return "good" if (result.log.get("seconds") or {}).get("airborne") else ""


def flight_length(result: Result) -> str:
    """How long the log is, and how much of it was flown."""
    flown = (result.log.get("seconds") or {}).get("airborne")
    whole = duration(result.log.get("duration_s"))
    return f"{whole}, {duration(flown)} in flight" if flown else whole


def sensor_rates(result: Result) -> str:
    """How often each sensor was logged."""
    log = result.log
    return ", ".join(
        f"{word} {number(log[key]['rate_hz'], 'Hz')} Hz"
        for key, word in (("imu", "IMU"), ("mag", "magnetometer"), ("attitude", "attitude"))
        if log.get(key)
    )


def firmware(result: Result) -> str:
    """Name, version and board of the autopilot."""
    said = result.log.get("firmware") or {}
    name = " ".join(str(said[k]) for k in ("name", "version") if said.get(k))
    return f"{name} on {said['board']}" if name and said.get("board") else name


# What was subtracted from the gyro for every filter alike, in a sentence.


def gyro_bias_text(result: Result) -> list[str]:
    """A sentence for each replayed IMU: how much was subtracted from its gyro and why, or why nothing was."""
    several = len(result.gyro_bias) > 1
    return [(f"{bias.imu}: " if several else "") + bias_sentence(bias) for bias in result.gyro_bias]


def bias_sentence(bias: CommonBias) -> str:
    """The sentence for one IMU."""
    if bias.dps is None:
        why = f": {bias.why}" if bias.why else " (--gyro-bias none)"
        return f"No gyro bias was subtracted before the filters ran{why}."
    if bias.taken == "onboard":
        mean = rates_text(bias.dps)
        return f"Subtracted from the gyro for every filter: the onboard estimator's bias, in the mean {mean}."
    seconds = duration(bias.seconds)
    text = f"Subtracted from the gyro for every filter: {rates_text(bias.dps)}, its mean over {seconds} of rest"
    text += " before take-off" if bias.flew else ""
    if bias.half95_dps is not None:
        text += f" (±{max(bias.half95_dps):.2g} deg/s)"
    if bias.landed_dps is not None:
        moved = max(abs(after - before) for after, before in zip(bias.landed_dps, bias.dps, strict=True))
        text += f". After landing its mean differs by up to {moved:.2g} deg/s"
    return text + "."


def rates_text(dps: list[float]) -> str:
    """Three rates about the body axes."""
    x, y, z = (f"{0.0 if abs(v) < 0.0005 else v:+.3f}" for v in dps)
    return f"{x}, {y}, {z} deg/s about x, y, z"


# What the autopilot said, and which of it a pilot looks for first.

ALARM = re.compile(r"fail[- ]?safe|crash|emergency|lost|terminat|\bland(ing)? now\b|parachute", re.IGNORECASE)
"""Texts that a pilot looks for first whatever their level."""

LEVELS = ("emergency", "alert", "critical", "error", "warning", "notice", "info", "debug")
CRITICAL, WARNING = 2, 4


def messages(result: Result) -> list[tuple[float, int, str]]:
    """The autopilot's messages in time order: (t, level, text)."""
    found = (result.log.get("timeline") or {}).get("texts") or []
    return sorted(((float(t), int(level), str(text)) for t, level, text in found), key=lambda m: m[0])


def alarming(level: int, text: str) -> bool:
    """Whether a message is one that a pilot looks for first."""
    return level <= CRITICAL or bool(ALARM.search(text))


def level_name(level: int) -> str:
    """A syslog level in words."""
    return LEVELS[level] if 0 <= level < len(LEVELS) else str(level)


# What happened in a flight, as it is listed: time, words, how bad, and the evidence.

EVENT_STYLES = {"serious": "bad", "warning": "warn"}
EVENT_LABELS = {
    "armed": "armed",
    "disarmed": "disarmed",
    "liftoff": "lift-off",
    "landing": "landing",
    "hard_landing": "hard landing",
    "impact": "impact",
    "overturn": "overturned",
    "tumble": "tumbling",
    "wreck_moved": "carried",
    "ends_in_air": "log ends",
    "clipping": "clipping",
    "vibration": "vibration",
    "realigned": "EKF realigned",
    "reset": "attitude jump",
    "lane_switch": "EKF lane",
    "sensor_switch": "sensor switch",
    "compass_switch": "compass switch",
    "aid_rejected": "aid rejected",
    "gnss_lost": "GNSS lost",
    "gnss_jump": "GNSS jump",
    "failsafe": "failsafe",
    "battery": "battery",
    "message": "message",
}
"""An event in two words, by its kind."""
MINOR_EVENTS = ("power_up", "reset")
"""Kinds that are listed only where somebody asks for all."""


@dataclass(slots=True)
class ShownEvent:
    """An event as it is shown: ``t`` s, its sentence, its style, and the sources that tell it."""

    t: float
    text: str
    style: str
    evidence: str


def shown_events(result: Result) -> tuple[list[ShownEvent], list[ShownEvent]]:
    """What happened, in time order, and what of it is custom or detail."""
    listed: list[ShownEvent] = []
    details: list[ShownEvent] = []
    for event in result.events:
        shown = ShownEvent(event.t, event.text, EVENT_STYLES.get(event.severity, ""), "; ".join(event.evidence))
        minor = event.kind in MINOR_EVENTS or (event.kind == "message" and event.severity == "note")
        (details if minor else listed).append(shown)
    return listed, details
