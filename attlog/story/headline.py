"""One sentence or three, of at most 30 words: what flew, from when to when, what went wrong first, how it ended."""

from __future__ import annotations

import itertools
import re
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from attlog.flight.model import FlightLog
from attlog.flight.vehicle import VehicleKind
from attlog.segments.crash import Ending
from attlog.segments.model import Segments
from attlog.story import failsafes
from attlog.story.event import Event, figures
from attlog.story.flights import SURE_HZ, blows_told, sized, turned
from attlog.story.flown import flown, has_open_end, how_often

WORDS = 30
TOGETHER_S = 5.0
"""Endings so close to each other are one crash."""
KILLED_S = 5.0
HIGH_M = 5.0
"""A blow above this height is no ground."""
NAMES = {"Copter": "ArduCopter", "Plane": "ArduPlane", "Rover": "ArduRover", "Sub": "ArduSub"}
TOLD_FIRST = (
    "clipping",
    "vibration",
    "failsafe",
    "battery",
    "realigned",
    "lane_switch",
    "compass_switch",
    "aid_rejected",
    "gnss_lost",
    "gnss_jump",
)
"""What may explain an end, by kind."""
THROUGHOUT_S = 10.0
"""An angle that is wrong from so soon after the first lift-off until so shortly before the last landing."""


@dataclass(frozen=True, slots=True)
class WrongAngle:
    """An angle (tilt, heading) of the onboard attitude, proven wrong by ``size_deg`` from ``t`` to ``t_end`` s."""

    angle: str
    size_deg: float
    t: float
    t_end: float


def headline(
    log: FlightLog, segments: Segments, events: Sequence[Event], sound: bool = True, wrong: WrongAngle | None = None
) -> str:
    """The headline. ``events``: of the flight, in time order; ``sound``: no finding is a warning; ``wrong``: what was
    wrong with the onboard attitude in flight.

    The fullest wording that fits into 30 words is taken.
    """
    who = f"{_vehicle(log)}, {_firmware(log)}" if _firmware(log) else _vehicle(log)
    flew, end = flown(log, segments, events), _end(log, segments, events, sound)
    first = _with_angle(failsafes.in_headline(_first(segments, events), log, segments, events), wrong, segments)
    said = ""
    for b, c, a in itertools.product(end, first, flew):
        said = f"{who}: " + " ".join(x for x in (a, c, b) if x)
        if len(said.split()) <= WORDS:
            return said
    return " ".join(said.split()[:WORDS])


def _vehicle(log: FlightLog) -> str:
    """What people call the vehicle, with what is special about the log."""
    name = log.vehicle if log.vehicle not in ("unknown", "generic", "") else "vehicle"
    name = name[0].upper() + name[1:]
    return f"{name} (simulated)" if log.simulated else name


def _firmware(log: FlightLog) -> str:
    """Firmware and version as people say them: ArduCopter 4.7-dev, PX4 1.14.3."""
    version = log.firmware.version
    family, _, number = version.partition(" ")
    if log.firmware.name == "ArduPilot" and family in NAMES:
        said = f"{NAMES[family]} {number}"
    else:
        said = f"{log.firmware.name} {version}"
    return re.sub(r"(\d+\.\d+)\.0[- ]dev\b", r"\1-dev", said).replace(" dev", "-dev").strip()


def _first(segments: Segments, events: Sequence[Event]) -> list[str]:
    """What went wrong first before a crash, or at all; the fullest first."""
    crash = next((e.t for e in events if e.is_crash), np.inf)
    found = [e for e in events if e.severity == "warning" and e.kind in TOLD_FIRST and e.t <= crash]
    found = [e for e in found if not (e.kind == "failsafe" and "Kill switch" in e.text)]
    if not found:
        return [""]
    first = next((e for e in found if e.kind == "clipping"), None) if found[0].kind == "vibration" else None
    first = first or found[0]
    since = f"{first.t:.0f} s" if first.t_end else f"{first.t:.1f} s"
    shaken = next((e for e in found if e.kind == "vibration" and e.value), None)
    words = {
        "clipping": f"Accelerometer clipped from {first.t:.0f} s",
        "vibration": f"Strong vibration ({figures(first.value or 0.0)} m/s²) from {first.t:.0f} s",
        "failsafe": first.text.rstrip("."),
        "battery": first.text.rstrip("."),
        "realigned": _realigned([e for e in found if e.kind == "realigned"]),
        "lane_switch": f"Estimator core changed at {since}",
        "compass_switch": f"Compass changed at {since}",
        "aid_rejected": f"{first.text.partition(' for ')[0]} from {since}",
        "gnss_lost": f"GNSS lost from {since}",
        "gnss_jump": first.text.partition(",")[0].rstrip("."),
    }[first.kind]
    more = f" (vibration {figures(shaken.value or 0.0)} m/s²)" if first.kind == "clipping" and shaken else ""
    return [f"{words}{more}.", f"{words}.", ""] if more else [f"{words}.", ""]


def _with_angle(first: list[str], wrong: WrongAngle | None, segments: Segments) -> list[str]:
    """What went wrong first with an angle that was wrong in flight, which explains what the estimator did."""
    flights = segments.spans("airborne")
    if wrong is None or not flights:
        return first
    whole = wrong.t <= flights[0][0] + THROUGHOUT_S and wrong.t_end >= flights[-1][1] - THROUGHOUT_S
    when = "throughout" if whole else f"from {wrong.t:.0f} to {wrong.t_end:.0f} s"
    said = f"{wrong.angle.capitalize()} was {wrong.size_deg:.0f}° wrong {when}"
    return [*(f"{said}; {text}" for text in first if text), f"{said}."]


def _realigned(found: Sequence[Event]) -> str:
    times = [f"{e.t:.1f}" if e.t < 100 else f"{e.t:.0f}" for e in found]
    if len(times) > 2:
        return f"EKF re-aligned yaw {how_often(len(times))}"
    return f"EKF re-aligned yaw at {' and '.join(times)} s"


def _end(log: FlightLog, segments: Segments, events: Sequence[Event], sound: bool) -> list[str]:
    """How it ended, the fullest first."""
    crashes = _crashes(segments.endings)
    if crashes:
        blow = next((e.t for e in crashes[0] if e.kind == "impact"), crashes[0][0].t)
        full, short = _crash(crashes[0], _where(log.kind, segments, blow))
        if len(crashes) == 1:
            return list(dict.fromkeys((f"{full}.", f"{short}.")))
        again = f"; crashed again at {crashes[1][0].t:.1f} s"
        sizes = f"{again}{_size(crashes[1])}"
        bare = short.partition(" (")[0]  # a second crash is worth more than the size of the first
        return list(dict.fromkeys((f"{full}{sizes}.", f"{short}{sizes}.", f"{bare}{again}.", f"{short}.")))
    warned = any(e.severity in ("warning", "serious") for e in events if e.kind != "hard_landing")
    hard = [e for e in segments.endings if e.kind == "hard_landing"]
    if hard:
        worst = max(hard, key=lambda e: e.size)
        killed = next((e for e in events if "Kill switch" in e.text and 0 <= worst.t - e.t < KILLED_S), None)
        before = f"Kill switch at {killed.t:.1f} s, then hard landing" if killed else "Hard landing"
        said_ = f"{before} at {worst.t:.1f} s ({sized(worst)}), upright"
        return [f"{said_}; nothing else went wrong." if sound and not warned else f"{said_}."]
    if has_open_end(events):
        return ["The log ends in the air."]
    cannot = "Blows cannot be determined." if segments.spans("airborne") and _too_slow(log) else ""
    if sound and not warned and segments.spans("airborne"):
        return [cannot or "Nothing went wrong."]
    return [cannot, ""] if cannot else [""]


def _too_slow(log: FlightLog) -> bool:
    """Whether no blow at all could be told: a tenth of the rate at which most are."""
    rate = max((imu.acc.rate for imu in log.imus), default=0.0)
    return bool(blows_told(log)) and rate < 0.1 * SURE_HZ


def _crashes(endings: Sequence[Ending]) -> list[list[Ending]]:
    """The endings of each crash, in time order."""
    groups: list[list[Ending]] = []
    for ending in (e for e in endings if e.is_crash):
        if groups and ending.t - groups[-1][-1].t_end < TOGETHER_S:
            groups[-1].append(ending)
        else:
            groups.append([ending])
    return groups


def _size(group: Sequence[Ending]) -> str:
    blow = next((e for e in group if e.kind == "impact"), None)
    return "" if blow is None else f" ({sized(blow)})"


def _where(kind: VehicleKind, segments: Segments, t: float) -> str:
    """What a crash at a time hit: the ground, something higher up, or nothing because it never flew."""
    if not segments.spans("airborne"):
        return ""
    air = segments.air
    if kind.winged:
        return "the ground"
    levels = [] if air is None else [level.above[air.grid.index(t)] for level in air.levels]
    high = [x for x in levels if np.isfinite(x)]
    return "something" if high and max(high) > HIGH_M else "the ground"


def _crash(group: Sequence[Ending], what: str) -> tuple[str, str]:
    """One crash in words, and shorter. ``what`` was hit; empty for what never flew."""
    blow, over, spun = (next((e for e in group if e.kind == kind), None) for kind in ("impact", "overturn", "tumble"))
    if blow is not None:
        hit = f"hit {what or 'something'} at {blow.t:.1f} s ({sized(blow)})"
        short = hit[0].upper() + hit[1:]
        if over is None:
            return f"{short}{_lies(blow)}", short
        if over.t <= blow.t:
            return f"Rolled to {over.size:.0f}° at {over.t:.1f} s and {hit}", short
        return f"{short} and turned over to {over.size:.0f}°", short
    if over is not None:
        last = [e for e in group if e.kind == "overturn"][-1]
        text = f"{turned(over) if what else 'Flipped over at take-off'} at {over.t:.1f} s ({over.size:.0f}°)"
        later = f" and turned over at {last.t:.1f} s ({last.size:.0f}°)" if last is not over else ""
        return f"{text}{later}{_lies(last)}", text
    spin = spun or group[0]
    text = f"Tumbled at {spin.t:.1f} s ({spin.size:.0f}°/s)"
    return text, text


def _lies(ending: Ending) -> str:
    """How it lay afterwards."""
    angle = ending.lies_deg
    if angle is None:
        return ""
    return ", lay upside down" if angle > 150.0 else f", lay at {angle:.0f}°" if angle > 15.0 else ", upright"
