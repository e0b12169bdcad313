"""Events of a flight for display: rows in time order, with severity and source in words."""

from __future__ import annotations

import re
from collections.abc import Sequence
from typing import NamedTuple

from attlog.result import Event, Finding, Result
from attlog.words.findings import SEVERITY, question_title
from attlog.words.numbers import listed
from attlog.words.text import typeset

# Label of an event by its kind.
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
    "motor_no_thrust": "no thrust",
    "motor_off": "output off",
    "motor_frozen": "output frozen",
    "motors_off": "motors off",
    "no_thrust_left": "no thrust reserve",
    "yaw_backwards": "yaw reversed",
    "rate_tracking": "poor control",
    "oscillation": "oscillation",
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
    "gnss_interference": "GNSS interference",
    "full_stick": "full stick",
    "radio_lost": "radio lost",
    "failsafe": "failsafe",
    "battery": "battery",
    "arming_refused": "arming refused",
    "device_error": "device error",
    "parameter_changed": "parameters",
    "sensor_fault": "sensor fault",
    "message": "message",
}
# Subjects of events that say more than the label of their kind.
SUBJECT_LABELS = ("kill switch",)
# Label of a finding by the angle or check that it is about; others have their kind.
FINDING_LABELS = {"heading": "heading wrong", "heading_by_gnss": "heading wrong"}
# Labels of ArduPilot's reports that are no events, by subsystem of ERR; others are "report".
REPORT = re.compile(r"(?:err_(?P<subsystem>\d+)|ev)_\d+")
REPORT_LABELS = {
    **{"2": "radio", "3": "compass", "5": "radio failsafe", "6": "battery", "7": "GNSS failsafe", "8": "link failsafe"},
    **{"15": "parachute", "18": "barometer", "19": "main loop", "21": "terrain", "23": "terrain", "25": "thrust loss"},
    **{"26": "sensor failsafe", "27": "leak", "28": "no pilot input", "30": "internal error", "31": "position lost"},
}
# Names of the event kinds that are folded.
MINOR_KINDS = {"power_up": "power-up", "reset": "resets", "message": "messages"}
# A finding this close to an event in trouble is the same thing, s.
SAME_S = 0.5
# What a message of the log holds, by its name without instance.
SOURCES = {
    **dict.fromkeys(("ARM", "EV", "STAT", "vehicle_status", "actuator_armed", "HEARTBEAT"), "arming state"),
    **dict.fromkeys(("ATT", "ANG", "AHR2", "vehicle_attitude", "ATTITUDE", "ATTITUDE_QUATERNION"), "onboard attitude"),
    **dict.fromkeys(("EKF1", "NKF1", "XKF1", "vehicle_local_position"), "onboard estimate"),
    **dict.fromkeys(("EKF4", "NKF4", "XKF4", "estimator_status", "EKF_STATUS_REPORT"), "EKF test ratio"),
    **dict.fromkeys(("estimator_innovation_test_ratios", "ekf2_innovations"), "EKF test ratio"),
    **dict.fromkeys(("IMU2", "IMU3", "RAW_IMU", "SCALED_IMU", "SCALED_IMU2", "HIGHRES_IMU"), "IMU"),
    **dict.fromkeys(("sensor_combined", "vehicle_imu", "vehicle_acceleration", "sensor_accel"), "IMU"),
    **dict.fromkeys(
        ("VIBE", "vehicle_imu_status", "VIBRATION", "sensor_combined.accelerometer_clipping"), "clip counter"
    ),
    **dict.fromkeys(("BARO", "CTUN.BarAlt", "SCALED_PRESSURE", "vehicle_air_data", "sensor_baro"), "barometer"),
    **dict.fromkeys(("RFND", "distance_sensor", "DISTANCE_SENSOR"), "rangefinder"),
    **dict.fromkeys(("RCOU", "actuator_outputs", "actuator_motors", "SERVO_OUTPUT_RAW"), "motor outputs"),
    **dict.fromkeys(("GPS", "GPA", "vehicle_gps_position", "sensor_gps", "GPS_RAW_INT"), "GNSS"),
    "estimator_selector_status": "EKF selector",
}
MESSAGE = re.compile(r"(\w+)(?::\d+)?(?:\.(\w+))?(?=: |$)")
TEXT = re.compile(r"(?:text|report) at \S+ s: (?P<words>.*)", re.DOTALL)


class ShownEvent(NamedTuple):
    """Event, or finding with a time, as a row of the list and a mark of the strip.

    ``label``: short name of a mark; ``severity``: Serious, Warning or empty; ``style``: ``bad``, ``warn`` or empty.
    """

    t: float
    kind: str
    label: str
    severity: str
    style: str
    text: str
    source: str
    minor: bool = False
    about: str = ""
    t_end: float | None = None


def shown_events(result: Result) -> list[ShownEvent]:
    """Return events and findings with a time of their own, in time order."""
    events = [shown_event(event) for event in result.events]
    trouble = [event.t for event in result.events if event.severity in ("serious", "warning")]
    alone = [f for f in result.findings if f.is_trouble and f.t is not None]
    events += [_finding(f, f.t) for f in alone if f.t is not None and all(abs(t - f.t) > SAME_S for t in trouble)]
    return sorted(events, key=lambda event: event.t)


def shown_event(event: Event) -> ShownEvent:
    """Return an event as a row."""
    minor = event.kind in ("power_up", "reset") or (event.kind == "message" and event.severity == "note")
    label = event.about if event.about in SUBJECT_LABELS else EVENT_LABELS.get(event.kind, "")
    source = source_text(event)
    words = typeset(event.text)
    return ShownEvent(event.t, event.kind, label, *_severity(event.severity), words, source, minor, t_end=event.t_end)


def _finding(finding: Finding, t: float) -> ShownEvent:
    report = REPORT.fullmatch(finding.kind)
    usual = finding.kind.replace("_", " ") if report is None else REPORT_LABELS.get(report["subsystem"], "report")
    label = FINDING_LABELS.get(finding.about, usual)
    source = f"check of {question_title(finding.about)}" if finding.about else "checks"
    words, about = typeset(finding.text), finding.about or finding.kind
    return ShownEvent(
        t, "finding", label, *_severity(finding.severity), words, source, about=about, t_end=finding.t_end
    )


def _severity(severity: str) -> tuple[str, str]:
    """Return word and style, empty for what is no trouble."""
    return SEVERITY[severity] if severity in ("serious", "warning") else ("", "")


def minor_title(events: Sequence[ShownEvent]) -> str:
    """Return number and kinds of the folded events: ``5 minor: power-up, resets``."""
    kinds = [name for kind, name in MINOR_KINDS.items() if any(e.kind == kind for e in events)]
    return f"{len(events)} minor: {listed(kinds)}"


def source_text(event: Event) -> str:
    """Return the sources of an event in words, without what its sentence has."""
    said = [found for line in event.evidence if (found := TEXT.fullmatch(line)) is not None]
    quotes = dict.fromkeys(f"“{x['words']}”" for x in said if x["words"] not in event.text)
    texts = f"autopilot: {', '.join(quotes)}" if quotes else "autopilot’s text" if said else ""
    rest = [_source(line, event) for line in event.evidence if not TEXT.fullmatch(line)]
    return "; ".join(dict.fromkeys(text for text in (*rest, texts) if text))


def _source(line: str, event: Event) -> str:
    """Return a line of evidence in words, empty where the sentence of the event has it."""
    name = MESSAGE.match(line)
    words = None if name is None else SOURCES.get(f"{name[1]}.{name[2]}") or SOURCES.get(name[1])
    rest = line if name is None or words is None else line[name.end() :]
    rest = "" if line in event.text else rest.rstrip(".")
    if name is not None and words is not None:
        return typeset(f"{words} ({name[0]}){rest}")
    if event.kind == "reset":
        return "reset counter" if "counter" in line else "attitude against the gyro"
    return typeset(rest)
