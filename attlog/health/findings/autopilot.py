"""What the autopilot did and said, and how flights ended: events of the story that are trouble."""

from __future__ import annotations

import re
from collections.abc import Iterable, Sequence
from dataclasses import replace

from attlog.flight.model import FlightLog
from attlog.health.findings import attitude, compass, crashes, sensors
from attlog.health.findings.finding import Explanation, Finding, of_event
from attlog.story.estimator import is_steady
from attlog.story.event import CRASHES, Event

CRASH = crashes.KIND
CHECKS = {CRASH: Explanation(CRASH, as_fault="serious")}
EVENTS = {
    "hard_landing": "hard_landing",
    "clipping": sensors.VIBRATION,
    "vibration": sensors.VIBRATION,
    "realigned": "realigned",
    "lane_switch": attitude.RESET,
    "sensor_switch": "sensor_switch",
    "compass_switch": compass.KIND,
    "gnss_lost": sensors.GNSS,
    "gnss_jump": sensors.GNSS,
    "failsafe": "failsafe",
    "battery": "battery",
}
"""Of which finding an event is a sign; crashes and messages are treated on their own."""
SAID = (
    (re.compile(r"\bmag|compass|yaw", re.I), compass.KIND),
    (re.compile(r"clipping|vibration", re.I), sensors.VIBRATION),
    (re.compile(r"\bgps|\bgnss|glitch", re.I), sensors.GNSS),
    (re.compile(r"\bekf|variance|estimator|attitude|\bahrs", re.I), attitude.ESTIMATOR),
)
"""What a message of the autopilot is about, by its words."""
TOLD_BY_EVENTS = {
    "failsafe": ("failsafe", "battery"),
    "err_5_1": ("failsafe",),
    "err_6_1": ("battery",),
    "err_8_1": ("failsafe",),
    "gnss_glitch": ("gnss_jump",),
    "ev_54": ("failsafe",),
    "imu_switched": ("sensor_switch",),
}
"""Codes of problems, and the events that tell the same better where there is one."""
ACTIONS = {"battery": "Charge or change the battery, and land earlier."}
EXPLAINED, SAME_S = ("err_7_1", "err_31_1", "ekf_failsafe", "vibration_failsafe"), 0.01
"""Failsafes of a sensor or the estimator, which are signs of those, and told at the same time."""
LEFT = "A wrong attitude, vibration or a wrong compass; GNSS itself is steady there."
"""Why the estimator says that GNSS jumped where its position and velocity agree."""
FEW = 4
"""So many sentences of the autopilot are quoted in one finding."""


def of_events(events: Iterable[Event], reports: Sequence[Finding] = (), hovers: bool = True) -> list[Finding]:
    """The signs in what happened: crashes as one, the others by their kind; a message is a sign of what it names.

    A failsafe that ``reports`` of the autopilot tell with its sensor is no sign of its own. ``hovers``: the vehicle
    takes off upright on its rotors.
    """
    events = list(events)
    found = crashes.signs(events, hovers)
    wrecks = crashes.wrecks(events)
    explained = [report.t for report in reports if report.kind in EXPLAINED and report.t is not None]
    for event in events:
        if event.kind in CRASHES or event.severity not in ("warning", "serious"):
            continue
        if event.kind == "failsafe" and any(abs(event.t - t) < SAME_S for t in explained):
            continue
        if event.kind == "message":
            kind = next((kind for words, kind in SAID if words.search(event.text)), "message")
            found.append(replace(of_event(event, kind), text=f"The autopilot said {event.text}"))
        elif event.kind in EVENTS:
            sign = of_event(event, EVENTS[event.kind])
            if is_steady(event):
                sign = replace(sign, kind=attitude.ESTIMATOR, value=None, unit="", cause=LEFT)
            about = {"clipping": "clipping", "realigned": "heading", "vibration": "vibration"}.get(event.kind, "")
            found.append(replace(sign, about=about, action=ACTIONS.get(event.kind, "")))
    counted = [sign for sign in found if sign.kind == CRASH or not _within(sign.t, wrecks)]
    return [replace(sign, evidence=sign.evidence[:FEW]) for sign in counted]


def _within(t: float | None, spans: Sequence[tuple[float, float]]) -> bool:
    return t is not None and any(a < t < b for a, b in spans)


def untold(problems: Sequence[Finding], events: Sequence[Event]) -> list[Finding]:
    """The signs of problems that no event tells already."""
    happened = {event.kind for event in events}
    return [p for p in problems if not happened.intersection(TOLD_BY_EVENTS.get(p.kind, ()))]


def after_crashes(reports: Sequence[Finding], events: Sequence[Event]) -> list[Finding]:
    """The reports, those of a wreck as notes: from a crash until it lifted off again."""
    wrecks = crashes.wrecks(events)
    return [
        replace(report, severity="note") if report.kind != CRASH and _within(report.t, wrecks) else report
        for report in reports
    ]


def harmless(reports: Sequence[Finding], events: Sequence[Event]) -> list[Finding]:
    """The reports, a failsafe as a note where the event at its time is one: disarmed, or before it could be true."""
    notes = [event.t for event in events if event.kind == "failsafe" and event.severity == "note"]
    return [
        replace(report, severity="note")
        if report.kind in EXPLAINED and any(report.t is not None and abs(report.t - t) < SAME_S for t in notes)
        else report
        for report in reports
    ]


def of_the_start(reports: Sequence[Finding], log: FlightLog) -> list[Finding]:
    """The reports, those from before the first sample as notes: an autopilot that starts, and is not armed yet."""
    line = log.armed
    armed = [] if line is None else [t for t, value in zip(line.t.tolist(), line.value, strict=True) if value]
    begin = min([0.0, *armed])
    return [replace(r, severity="note") if r.t is not None and r.t < begin and r.is_trouble else r for r in reports]


def doubted(report: Finding) -> Finding:
    """A crash that the autopilot reports while no sensor shows one."""
    return replace(report, kind="crash_check", severity="warning", cause="No sensor shows a crash: a bench, or a hand.")
