"""Findings: problems of a log, one for each cause, from checks, reports and events.

Each check, report and event that is not ok is a sign. :data:`REPORT_RULES` set severity and kind of the reports of
readers and autopilot. :data:`RULES` give signs with a common cause the same kind; signs of a kind become one finding.
"""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from itertools import pairwise
from typing import NamedTuple

import numpy as np

from attlog.core.brief import brief
from attlog.core.spans import between
from attlog.flight.model import FlightLog, Problem, Severity
from attlog.health.check import BUG, TROUBLE, Check, Weight, agreed_settings, as_sentence, settings_sentence
from attlog.health.gravity import MEAN_GRAVITY
from attlog.health.gyro import UNUSABLE_DPS
from attlog.health.innovations import REJECTED_POSITION
from attlog.health.registry import CAUSES, CHECKS
from attlog.reference.model import Reference
from attlog.segments.heights import height_stream
from attlog.story import causes
from attlog.story.estimator_events import is_estimator_jump
from attlog.story.failsafe_events import KILL
from attlog.story.flight_events import CRASHES, QUOTED, Event

# Subject of signs that compare units, and kind of notes on sensors that are not in use.
COMPARED, UNUSED = "imu_instances", "unused_sensor"
# Worst first.
SEVERITY_ORDER: tuple[Weight, ...] = ("serious", "warning", "note", "info")
WEIGHTS: Mapping[Severity, Weight] = {"error": "serious", "warning": "warning", "note": "note", "info": "info"}
# Kinds whose signs are not merged.
SEPARATE_KINDS = (BUG, "estimator_failed", "estimator_timed_out")
# Order of kinds among findings of equal severity.
KINDS = (
    *("motor", "motor_output", "thrust", "propellers", "control"),
    *("gyro", "frozen_gyro", "gyro_spikes", "gyro_bias", "crash", "hard_landing"),
    *("vibration", "attitude", "mounting", "trim", "reset"),
    *("coverage", "estimator", "accelerometer", "accelerometer_axes", "accelerometer_delay", "frozen_sensors"),
    *("device", "parameters", "arming", "gyro_range", "gnss", "imu_delay", "gyro_scale", "main_loop", "gaps"),
    *("jitter", "rate", "delay", "compass", "declination", "log_clock"),
)


@dataclass(frozen=True, slots=True)
class Finding:
    """Finding of one kind: a sentence with evidence, cause and action.

    ``t`` to ``t_end`` s: time; ``offset`` bytes: position in the file; ``count``: number of events; ``value`` in
    ``unit``: size. ``about``: angle (tilt, heading) or source check. ``cause``, ``action``: empty where unknown.
    """

    kind: str
    severity: Weight
    text: str
    t: float | None = None
    t_end: float | None = None
    offset: int | None = None
    count: int = 1
    value: float | None = None
    unit: str = ""
    about: str = ""
    evidence: list[str] = field(default_factory=list)
    cause: str = ""
    action: str = ""
    __repr__ = brief

    @property
    def is_trouble(self) -> bool:
        """True if the severity is serious or warning."""
        return self.severity in ("serious", "warning")


class OpenQuestion(NamedTuple):
    """Question without an answer: title, and how to get an answer (may be empty)."""

    title: str
    remedy: str = ""


class Context(NamedTuple):
    """Input of the rules beside the signs; ``crashed``: sensors show a crash."""

    log: FlightLog
    events: Sequence[Event] = ()
    crashed: bool = False


Signs = list[Finding]
Rule = Callable[[Signs, Context], Signs]


def findings(
    log: FlightLog,
    checks: Iterable[Check],
    others: Iterable[Problem] = (),
    unanswered: Iterable[OpenQuestion] = (),
    events: Iterable[Event] = (),
) -> list[Finding]:
    """Return the findings of a log, most severe first.

    ``others``: problems found by the analysis. Parameters proposed by checks become the action of their findings.
    Checks of sensors not in use are notes.
    """
    events, checks = list(events), list(checks)
    if any(problem.code == IMU_REFUSED for problem in log.problems):
        checks = [check for check in checks if check.question not in IMU_CHECKS]
    reports = [problem_finding(problem) for problem in [*log.problems, *others]]
    happened = event_signs(events, reports, log)
    named = {"crash", "clipping"} & {name for sign in happened for name in (sign.kind, sign.about)}
    signs = [*check_signs(checks, log, reports, skip=named), *happened]
    context = Context(log, events, any(sign.kind == "crash" for sign in signs))
    for rule in REPORT_RULES:
        reports = rule(reports, context)
    signs = [*signs, *reports]
    for rule in RULES:
        signs = rule(signs, context)
    signs = add_spares(signs, checks, log)
    signs += [Finding(BUG, "serious", check.text) for check in checks if check.about == BUG]
    signs += [*_unchecked(checks), *_open(list(unanswered))]
    found = merge_causes(signs)
    place = {kind: k for k, kind in enumerate(KINDS)}
    found.sort(key=lambda f: (SEVERITY_ORDER.index(f.severity), place.get(f.kind, len(place)), f.t or 0.0))
    return choose_actions(found, checks, log)


def add_spares(signs: Signs, checks: Sequence[Check], log: FlightLog) -> Signs:
    """Add the signs of sensors that are not in use, as notes.

    They are no evidence against the sensor in use: beside signs of their kind only those with parameters to set count,
    apart from them unless these compare the units.
    """
    known, found = {sign.kind for sign in signs}, list(signs)
    for check in _settings_first(c for c in checks if not c.in_use):
        spare = check_sign(check, log, "note")
        if spare.kind not in known:
            found.append(spare)
        elif check.settings:
            pair = next((k for k, s in enumerate(found) if s.kind == spare.kind and s.about == COMPARED), None)
            if pair is None:
                found.append(replace(spare, kind=UNUSED))
                continue
            sign, values = found[pair], settings_text(check)
            action = f"{sign.action.rstrip('.')}, or {values[:1].lower()}{values[1:]}" if sign.action else values
            found[pair] = replace(sign, evidence=[*sign.evidence, check.text], action=action)
    return found


# Signs.


def problem_finding(problem: Problem, kind: str = "") -> Finding:
    """Convert a problem to a sign of ``kind``, by default the problem's code."""
    return Finding(
        kind or problem.code,
        WEIGHTS[problem.severity],
        problem.text,
        t=None if problem.t is None or abs(problem.t) >= 1e12 else problem.t,
        offset=problem.offset,
        count=problem.count,
        value=problem.value,
        unit=problem.unit,
        cause=problem.cause or REPORT_CAUSES.get(problem.code, ""),
        action=problem.remedy,
    )


def event_finding(event: Event, kind: str) -> Finding:
    """Convert an event to a sign of ``kind``; the autopilot's own words follow what was measured."""
    words = f" Autopilot: “{event.quote}”." if event.quote and event.quote not in event.text else ""
    return Finding(
        kind,
        event.severity,
        event.text + words,
        t=event.t,
        t_end=event.t_end,
        value=event.value,
        unit=event.unit,
        evidence=list(event.evidence),
    )


def check_signs(checks: Sequence[Check], log: FlightLog, reports: Signs, skip: Iterable[str] = ()) -> Signs:
    """Return signs of warnings and faults of sensors in use.

    Without the questions in ``skip``, covered by events, and without ``rate`` if in ``reports``.
    """
    left_out = {*skip, *({"rate"} if any(REPORT_KINDS.get(report.kind) == "rate" for report in reports) else ())}
    return [
        check_sign(check, log)
        for check in checks
        if check.verdict in TROUBLE and check.question not in left_out and check.in_use
    ]


def check_sign(check: Check, log: FlightLog, severity: Weight | None = None) -> Finding:
    """Convert a check that is not ok to a sign of its kind."""
    row = CHECKS[check.question]
    usual = row.fault if check.verdict == "fault" else row.warning
    if check.question == "gyro_bias" and usual == "serious" and abs(check.value or 0.0) < UNUSABLE_DPS:
        usual = "warning"
    action = settings_text(check) or check.action or check.why_no_setting or _logging_advice(check, log)
    if severity is None and row.remedy is not None and not check.action:
        action = log.remedy(row.remedy)
    harmless = check.question == "compass_motors" and not (check.action or check.settings)  # no effect on the heading
    return Finding(
        check.kind or row.kind,
        severity or usual,
        check.text,
        t=check.t,
        t_end=check.t_end,
        count=check.count,
        value=check.value,
        unit=check.unit if check.value is not None else "",
        about=check.about or check.question,
        evidence=list(check.evidence),
        cause="" if harmless else check.cause or CAUSES.get(check.question, ""),
        action="" if harmless else action,
    )


def settings_text(check: Check) -> str:
    """Return the check's action if it names each parameter, else a sentence of settings."""
    named = check.action and all(setting.name in check.action for setting in check.settings)
    return check.action if check.settings and named else settings_sentence(check.settings)


def _logging_advice(check: Check, log: FlightLog) -> str:
    """Return the setting that logs the data missing for a check."""
    imu, onboard = log.replay_imu, log.onboard_attitude
    if check.question == "rate":
        return log.advice("fast_imu", imu.gyro.rate) if imu is not None else log.advice("imu")
    if check.question == "coverage":
        return log.advice("attitude", onboard.rate if onboard is not None else None)
    return ""


# Checks that are invalid where most IMU data was rejected.
IMU_CHECKS = (
    *("accelerometer_rest", "gravity_in_flight", "gravity_direction", "rate", "gaps", "jitter", "filter_delay"),
    *("vibration_level", "imu_instances", "accelerometer_offset", "gyro_bias"),
)
IMU_REFUSED = "imu_mostly_refused"


def _unchecked(checks: list[Check]) -> Signs:
    """Merge the unknown checks into one entry, with the reasons as evidence."""
    missing = [check for check in checks if check.verdict == "unknown" and check.about != BUG]
    if not missing:
        return []
    names = dict.fromkeys(check.question.replace("_", " ") for check in missing)
    reasons: dict[str, dict[str, None]] = {}
    for check in missing:
        reasons.setdefault(check.text, {})[check.question.replace("_", " ")] = None
    evidence = [f"{', '.join(questions)}: {reason}" for reason, questions in reasons.items()]
    return [Finding("not_checked", "info", f"Not checked: {', '.join(names)}.", evidence=evidence)]


def _open(unanswered: list[OpenQuestion]) -> Signs:
    """Merge the unanswered questions into one entry."""
    if not unanswered:
        return []
    titles = ", ".join(item.title.lower() for item in unanswered)
    remedies = dict.fromkeys(item.remedy for item in unanswered if item.remedy)
    return [Finding("unanswered", "note", f"Not answered: {titles}.", action=" ".join(remedies))]


def contradiction(reference: Reference) -> list[Problem]:
    """Return problems for a reference that sensors contradict or that was replaced.

    A wrong onboard heading is excluded, because it has its own check.
    """
    taken = reference.kind in ("smoother", "onboard")
    reasons = {name: why for name, why in reference.faults.refused.items() if why != reference.faults.onboard_heading}
    gave_way = [reasons[name] for name in ("truth", "onboard") if taken and name in reasons]
    if gave_way:
        return [Problem("reference_contradicted", "error", as_sentence(why)) for why in gave_way]
    if not reference.faults.reference or reference.faults.reference == reference.faults.onboard_heading:
        return []
    sentences = [
        reference.faults.reference,
        *(step.text for step in reference.alignment.steps if step.name == "contradiction"),
    ]
    return [Problem("reference_contradicted", "error", f"{sentence}.") for sentence in sentences]


# Events.

# Kind of finding by kind of event; crashes and messages are handled apart.
EVENT_KINDS = {
    "hard_landing": "hard_landing",
    "clipping": "vibration",
    "vibration": "vibration",
    "realigned": "realigned",
    "lane_switch": "reset",
    "sensor_switch": "sensor_switch",
    "compass_switch": "compass",
    "gnss_lost": "gnss",
    "gnss_jump": "gnss",
    "gnss_interference": "gnss",
    "arming_refused": "arming",
    "device_error": "device",
    "parameter_changed": "parameters",
    "radio_lost": "failsafe",
    "failsafe": "failsafe",
    "battery": "battery",
}
# Kinds of events that only a flight has.
FLOWN = ("liftoff", "landing", "hard_landing", "ends_in_air")
# Kind of finding by the words of the autopilot's message.
MESSAGE_KINDS = (
    (re.compile(r"\bmag|compass|yaw", re.I), "compass"),
    (re.compile(r"clipping|vibration", re.I), "vibration"),
    (re.compile(r"\bgps|\bgnss|glitch", re.I), "gnss"),
    (re.compile(r"\bekf|variance|estimator|attitude|\bahrs", re.I), "estimator"),
)
# Action by the words of the autopilot's message.
MESSAGE_ACTIONS = (
    (re.compile(r"thrust loss", re.I), "Check motors, propellers and battery; compare the motor outputs."),
    (re.compile(r"requires (a )?position", re.I), "Wait for the EKF's position before choosing a position mode."),
    (re.compile(r"ground station lost|data ?link lost", re.I), "Check the telemetry link and its antennas."),
)
# Action by kind of event, and by what the event is about.
EVENT_ACTIONS = {
    "radio_lost": "Check antennas and range of the radio, and its receiver's failsafe.",
    "battery": "Charge or change the battery, and return earlier.",
    "arming_refused": "Mend what the autopilot names, then arm again.",
    "parameter_changed": "Set parameters on the ground, and find what changed them in flight.",
    "device_error": "Check wiring, power and baud rate of this device.",
    "lane_switch": "Compare IMU, compass and innovations of the lane that was left with those of the others.",
    "sensor_switch": "Compare the IMU that was left with the others: vibration, bias and temperature.",
    "failsafe": "Look for its trigger in the messages of that time: radio link, battery, position or another.",
    "gnss_interference": "Look for transmitters near the antenna; do not rely on position modes there.",
}
ACTIONS_BY_ABOUT = {
    ("failsafe", "radio"): "Check range, antennas and receiver of the radio.",
    ("failsafe", "ground station"): "Check the telemetry link, and the time-out of this failsafe.",
    ("failsafe", "ekf"): "Find the aid that the EKF lost or rejected before.",
    ("failsafe", "gnss"): "Give the GNSS antenna a free view of the sky, and check its cable.",
    ("failsafe", "terrain"): "Load terrain data for the route, and check the rangefinder.",
    ("failsafe", "kill switch"): "Check who or what used the kill switch, and its channel.",
    ("radio_lost", "pilot input"): "Check the radio or joystick and its link at that time.",
    ("gnss_lost", "fix"): "Give the GNSS antenna a free view of the sky, away from cameras, radios and power wires.",
    ("gnss_lost", "messages"): "Check cable, power and baud rate of the GNSS receiver.",
}
# Failsafes of a sensor or the estimator, and maximum time from report to event.
EXPLAINED_FAILSAFES, SAME_TIME_S = ("err_7_1", "err_31_1", "ekf_failsafe", "vibration_failsafe"), 0.01
# Action of a finding that has none by its signs, by kind and by what it is about: a remedy's key, or a sentence.
USUAL_REMEDIES = {
    "mag_only_offsets": "compass_wiring",
    "mag_dead": "compass_wiring",
    "imu_all_zero": "bus",
    "accelerometer_dead": "bus",
}
ATTITUDE_ACTION = "Keep the vehicle still as it starts, and compare its horizon with the real one before flying."
ESTIMATOR_ACTION = "Look at the EKF's test ratios: the first above 1 names the sensor to check."
USUAL_ACTIONS = {
    ("attitude", "heading"): "Compare its heading with a known direction before the next flight.",
    ("attitude", ""): ATTITUDE_ACTION,
    ("estimator", ""): ESTIMATOR_ACTION,
    ("realigned", ""): "Arm away from steel, reinforced concrete and cars, and check the compass calibration.",
    ("imu_switched", ""): EVENT_ACTIONS["sensor_switch"],
    ("damage", ""): "Copy the log again; if it stays damaged, check the memory card.",
    ("damage", "telemetry"): "Take the vehicle's own log: a radio link loses packets.",
}
STEADY_GNSS_CAUSE = "A wrong attitude, vibration or a wrong compass; GNSS itself is steady there."
# Maximum number of quoted messages in a finding.
MAX_EVIDENCE = 4
# Maximum number of effects named in a finding; subject of a sign that has some, unless it has its own.
MAX_EFFECTS, FIRST_CAUSE = 2, "first_cause"
# Kinds of events whose sentence gives a span.
LASTING_EFFECTS = ("clipping", "aid_rejected")
# Maximum time between events of one crash, as in the headline.
ONE_CRASH_S = 5.0
# Maximum time from the begin of clipping to the crash that may be its cause.
BY_CRASH_S = 2.0
# Maximum number of later crashes listed.
MAX_LATER_CRASHES = 3
# Maximum time from arming to an overturn at take-off.
SOON_AFTER_ARMING_S = 10.0
FLIPPED_ADVICE = "Check motor order, spin and propellers, and how the autopilot is mounted."
# Actions after a crash without a known cause: of a vehicle that hovers, with and without logged motor outputs, and of
# any other.
LOST_ADVICE = "Compare attitude, set-points and motor outputs in the 5 s before it."
UNLOGGED_ADVICE = "Log the motor outputs, without which no cause is found; inspect motors, propellers and ESCs."
OUTPUT_MESSAGES = {"RCOU", "MOT", "actuator_outputs", "actuator_motors", "SERVO_OUTPUT_RAW"}
STEERED_ADVICE = "Compare attitude, set-points and control outputs in the 5 s before it."


def event_signs(events: Sequence[Event], reports: Sequence[Finding], log: FlightLog) -> Signs:
    """Convert events to signs, by kind of event or words of a message.

    A failsafe already in ``reports`` with its sensor is dropped.
    """
    pairs: list[tuple[Event, Finding]] = []
    reported: list[Event] = []
    wrecks = wreck_spans(events)
    flown = any(event.is_crash or event.kind in FLOWN for event in events)
    explained = [report.t for report in reports if report.kind in EXPLAINED_FAILSAFES and report.t is not None]
    for event in events:
        if event.kind in CRASHES or event.severity not in ("warning", "serious"):
            continue
        if event.kind == "failsafe" and any(abs(event.t - t) < SAME_TIME_S for t in explained):
            reported.append(event)
            continue
        if event.kind == "message":
            kind = next((kind for words, kind in MESSAGE_KINDS if words.search(event.text)), "message")
            action = next((action for words, action in MESSAGE_ACTIONS if words.search(event.text)), "")
            text = f"The autopilot reported {event.text}"
            pairs.append((event, replace(event_finding(event, kind), text=text, action=action)))
        elif event.kind in EVENT_KINDS:
            sign = event_finding(event, EVENT_KINDS[event.kind])
            if is_estimator_jump(event):
                sign = replace(sign, kind="estimator", value=None, unit="", cause=STEADY_GNSS_CAUSE)
            about = {"clipping": "clipping", "realigned": "heading", "vibration": "vibration"}.get(event.kind, "")
            action = ACTIONS_BY_ABOUT.get((event.kind, event.about), EVENT_ACTIONS.get(event.kind, ""))
            if event.about == KILL:
                about = KILL
            if event.kind == "battery" and not flown:
                action = "Charge or change the battery."
            sign = replace(sign, about=about, action=action)
            if event.kind == "hard_landing" and event.cause is None:
                sign = replace(sign, action=landing_advice(log, event.t, events))
            if event.kind == "clipping" and not any(0.0 <= e.t - event.t <= BY_CRASH_S for e in events if e.is_crash):
                sign = replace(sign, action=log.remedy("vibration"))
            if about == "vibration":
                sign = replace(sign, cause=CAUSES["vibration_level"], action=log.remedy("vibration"))
            pairs.append((event, sign))
    found = [*crash_signs(events, log), *join_effects(pairs, events, reported)]
    counted = [sign for sign in found if sign.kind == "crash" or not _is_within(sign.t, wrecks)]
    return [replace(sign, evidence=sign.evidence[:MAX_EVIDENCE]) for sign in counted]


# Modes that land by themselves, and the parameters of their final speed of descent with their unit.
LANDING_MODES = re.compile(r"land|rtl|rth|return|mission|^auto$", re.I)
LANDING_SPEEDS = {"LAND_SPEED": "cm/s", "LAND_SPD_MS": "m/s", "MPC_LAND_SPEED": "m/s"}
# Time from stopped motors to the impact of a fall from some metres.
STOPPED_S = 2.0
# Shortest time in a sentence of one decimal.
JUST_BEFORE_S = 0.05
# Time before the impact at which the mode counts: firmwares change it at touch-down.
BEFORE_LANDING_S = 1.0
# Span before the touch-down of a steady descent, and its speeds, as share of the set one, that are as set.
SINKING_S, AS_SET = (4.0, 1.0), (0.5, 1.3)


def _sink_speed(log: FlightLog, t: float) -> float:
    """Return the speed of descent in m/s just before ``t`` s, infinity where no height is logged."""
    height = height_stream(log)
    if height is None:
        return math.inf
    use = between(height.t, t - SINKING_S[0], t - SINKING_S[1])
    since = height.t[use] - t
    return -float(np.polyfit(since, height.x[use, 0], 1)[0]) if len(since) > 2 else math.inf


def landing_advice(log: FlightLog, t: float, events: Sequence[Event]) -> str:
    """Return what to do about a hard landing at ``t`` s: by motors stopped before, its mode's speed, or the pilot."""
    inspect = "Inspect the frame, its legs and propellers"
    stopped = [e for e in events if (e.kind == "disarmed" or e.about == "kill switch") and 0.0 < t - e.t <= STOPPED_S]
    if stopped:
        early = t - stopped[-1].t
        before = f"{early:.1f} s" if early >= JUST_BEFORE_S else "just"
        return f"{inspect}; stop the motors on the ground, not {before} before as here."
    mode = log.state.mode
    if mode is None or not LANDING_MODES.search(str(mode.at(t - BEFORE_LANDING_S))):
        return f"{inspect}, and sink slower near the ground."
    speeds = [(name, value, unit) for name, unit in LANDING_SPEEDS.items() if (value := log.param(name)) is not None]
    if not speeds:
        return f"{inspect}, and lower the landing speed of the autopilot."
    name, value, unit = speeds[0]
    speed = value * (0.01 if unit == "cm/s" else 1.0)
    if AS_SET[0] * speed < _sink_speed(log, t) < AS_SET[1] * speed:
        return f"Inspect frame and propellers; it sank as {name} ({value:g} {unit}) sets: lower it, or soften the legs."
    return f"{inspect}; check {name} ({value:g} {unit}) and the height near the ground."


def join_effects(
    pairs: Sequence[tuple[Event, Finding]], events: Sequence[Event], reported: Sequence[Event] = ()
) -> Signs:
    """Return the signs of events: those of a kind with their first cause, which lists its effects.

    ``reported``: events whose sign is a report.
    """
    kinds = {id(event): sign.kind for event, sign in pairs}
    joined = []
    for event, sign in pairs:
        first = causes.root(event, events)
        if first is not event and id(first) in kinds:
            sign = replace(sign, kind=kinds[id(first)], cause="", action="")
        elif event.cause is not None:
            sign = replace(sign, cause=sign.cause or event.cause.text)
        others = [*(other for other, its in pairs if its.kind != sign.kind), *reported]
        results = sorted((other for other in others if causes.follows(other, event)), key=lambda other: other.t)
        if results:
            sign = _with_effects(sign, [(other.text, other.t, other.kind in LASTING_EFFECTS) for other in results])
        joined.append(sign)
    return joined


def _with_effects(sign: Finding, results: Sequence[tuple[str, float, bool]]) -> Finding:
    """Return a first cause that names its effects (sentence, t, whether it gives a span), in time order."""
    said = [causes.effect_phrase(*effect) for effect in results[:MAX_EFFECTS]]
    said += [f"{len(results) - MAX_EFFECTS} more"] if len(results) > MAX_EFFECTS else []
    text = f"{sign.text} {'Effects' if len(said) > 1 else 'Effect'}: {'; '.join(said)}."
    return replace(sign, text=text, about=sign.about or FIRST_CAUSE)


def crash_signs(events: Sequence[Event], log: FlightLog) -> Signs:
    """Return signs of crashes; the text of the first covers all.

    One with a known cause has no action of its own: that of the cause is at its finding.
    """
    happened = [event for event in events if event.is_crash]
    found = [event_finding(event, "crash") for event in happened]
    if found:
        text = _crash_text(_group_crashes(happened))
        first = causes.root(happened[0], events)
        cause = "" if first.kind in CRASHES else first.text
        found[0] = replace(
            found[0], text=text, cause=cause, action="" if cause else _crash_action(events, happened[0], log)
        )
    return found


def _crash_action(events: Sequence[Event], crash: Event, log: FlightLog) -> str:
    """Return what to check after a crash without a known cause."""
    if not log.kind.hovers:
        return STEERED_ADVICE
    if crash.kind == "overturn" and _was_on_ground(events, crash.t):
        return FLIPPED_ADVICE
    logged = log.power.outputs is not None or log.messages is None or OUTPUT_MESSAGES & {*log.messages.names()}
    return LOST_ADVICE if logged else UNLOGGED_ADVICE


def wreck_spans(events: Sequence[Event]) -> list[tuple[float, float]]:
    """Return spans (t0, t1) s from each crash to the next lift-off, or to infinity."""
    lifts = [event.t for event in events if event.kind == "liftoff"]
    return [(e.t, min((t for t in lifts if t > e.t), default=float("inf"))) for e in events if e.is_crash]


def _is_within(t: float | None, spans: Sequence[tuple[float, float]]) -> bool:
    return t is not None and any(a < t < b for a, b in spans)


def _was_on_ground(events: Sequence[Event], t: float) -> bool:
    """Return whether the vehicle armed just before ``t`` and never lifted off.

    False without an arming event: such a log may begin in the air.
    """
    before = [event for event in events if event.t < t]
    armed = any(event.kind == "armed" and event.t >= max(t - SOON_AFTER_ARMING_S, 0.0) for event in before)
    return armed and not any(event.kind in ("liftoff", "landing") for event in before)


def _group_crashes(events: Sequence[Event]) -> list[list[Event]]:
    """Group events by crash."""
    groups = [[event] for event in events[:1]]
    for before, event in pairwise(events):
        if event.t - (before.t_end or before.t) < ONE_CRASH_S:
            groups[-1].append(event)
        else:
            groups.append([event])
    return groups


def _crash_text(groups: Sequence[Sequence[Event]]) -> str:
    """Return a text on the first crash, the final tilt, and times of later crashes."""
    texts = [event.text.split(". ", 1) for event in groups[0]]
    moves = list(dict.fromkeys(f"{sentences[0].rstrip('.')}." for sentences in texts))
    lay = texts[-1][1:]  # tilt at rest after the last event of the crash
    again = [f"{group[0].t:.1f} s" for group in groups[1:]]
    if len(again) > MAX_LATER_CRASHES:
        again = [*again[: MAX_LATER_CRASHES - 1], f"{len(again) - MAX_LATER_CRASHES + 1} times more"]
    times = " and ".join([", ".join(again[:-1]), again[-1]] if len(again) > 1 else again)
    return " ".join([*moves, *lay, *([f"Crashed again at {times}."] if again else [])])


# Rules of reports.

# Causes of reports whose reader knows none.
REPORT_CAUSES = dict.fromkeys(("mag_only_offsets", "mag_dead"), CAUSES["compass_dead"])
# Kinds of events that describe a problem code in more detail.
EVENTS_FOR_CODES = {
    "failsafe": ("failsafe", "battery"),
    "err_5_1": ("failsafe",),
    "err_6_1": ("battery",),
    "err_8_1": ("failsafe",),
    "gnss_glitch": ("gnss_jump",),
    "ev_54": ("failsafe",),
    "imu_switched": ("sensor_switch",),
}
# Kind of finding by problem code; codes not listed are kinds themselves.
REPORT_KINDS = {
    **dict.fromkeys(("reference_contradicted",), "attitude"),
    **dict.fromkeys(("lane_switch", "estimator_instance_changed"), "reset"),
    **dict.fromkeys(("ekf_check", "ekf_failsafe", "ekf_fault"), "estimator"),
    **dict.fromkeys(("vibration_failsafe",), "vibration"),
    **dict.fromkeys(("gyro_clipped",), "gyro_range"),
    **dict.fromkeys(("gnss_glitch", "err_7_1", "err_31_1", "ev_19"), "gnss"),
    **dict.fromkeys(("logger_dropouts",), "gaps"),
    **dict.fromkeys(("imu_low_rate", "imu_rate_too_low", "no_imu", "imu_too_short"), "rate"),
    **dict.fromkeys(("mag_spikes", "mag_uncalibrated", "err_3_1", "err_3_4", "compass_switch"), "compass"),
}


def drop_repeated_by_events(reports: Signs, context: Context) -> Signs:
    """Drop reports that an event describes in more detail."""
    happened = {event.kind for event in context.events}
    return [p for p in reports if not happened.intersection(EVENTS_FOR_CODES.get(p.kind, ()))]


def note_harmless_reports(reports: Signs, context: Context) -> Signs:
    """Reduce harmless reports to notes: note-level failsafes, wrecks, autopilot start.

    A wreck lasts from a crash until the next lift-off; an autopilot starts before the first sample and before arming.
    """
    notes = [event.t for event in context.events if event.kind == "failsafe" and event.severity == "note"]
    wrecks, line = wreck_spans(context.events), context.log.state.armed
    armed = [] if line is None else [t for t, value in zip(line.t.tolist(), line.value, strict=True) if value]
    begin = min([0.0, *armed])

    def harmless(report: Finding) -> bool:
        if report.t is None:
            return False
        at_note = report.kind in EXPLAINED_FAILSAFES and any(abs(report.t - t) < SAME_TIME_S for t in notes)
        wrecked = report.kind != "crash" and _is_within(report.t, wrecks)
        return at_note or wrecked or (report.t < begin and report.is_trouble)

    return [replace(report, severity="note") if harmless(report) else report for report in reports]


def explain_failsafe_reports(reports: Signs, context: Context) -> Signs:
    """Attribute the report of a failsafe to the kind of its first cause."""
    caused = [event for event in context.events if event.kind == "failsafe" and event.cause is not None]

    def explained(report: Finding) -> Finding:
        own = [e for e in caused if report.t is not None and abs(e.t - report.t) < SAME_TIME_S]
        kind = EVENT_KINDS.get(causes.root(own[0], context.events).kind, "") if own else ""
        return replace(report, kind=kind, cause="", action="") if kind else report

    return [explained(r) if r.kind in (*EXPLAINED_FAILSAFES, "ekf_check") else r for r in reports]


def doubt_reported_crashes(reports: Signs, context: Context) -> Signs:
    """Reduce a reported crash to a warning where no sensor shows one."""
    if context.crashed:
        return reports
    cause = "No sensor shows a crash: a bench, or a hand."
    return [
        replace(r, kind="crash_check", severity="warning", cause=cause) if r.kind == "crash" else r for r in reports
    ]


def name_kinds(reports: Signs, context: Context) -> Signs:
    """Set the kind of finding of reports by their code."""
    return [replace(report, kind=REPORT_KINDS.get(report.kind, report.kind)) for report in reports]


REPORT_RULES: tuple[Rule, ...] = (
    drop_repeated_by_events,
    note_harmless_reports,
    explain_failsafe_reports,
    doubt_reported_crashes,
    name_kinds,
)


# Rules of all signs.

# Maximum number of listed signs of a kind (a damaged log has hundreds); of more, MAX_QUOTED texts are quoted.
MAX_LISTED, MAX_QUOTED = 5, 3
# Problem codes of a missing compass.
ONLY_OFFSETS = "mag_only_offsets"
MISSING_COMPASS = ("mag_dead", "no_mag", "mag_not_in_log", ONLY_OFFSETS)
# Kinds that are attributed to a suspect compass if about heading.
HEADING_KINDS = ("realigned", "reset", "attitude")
LOST_HEADING = "The onboard estimator was not aligned, or drifted without a compass."
FIELD_CHECKS = ("compass_orientation", "field", "field_size")
# Checks that rotate the field by the onboard attitude.
FIELD_BY_ATTITUDE = ("field_against_attitude", "declination", "compass_turn", "attitude")
# Change of the field in percent by motors above which they lead the finding.
BENT_PCT = 30.0
# Checks of the compass in order of explanatory power.
COMPASS_LEADS = (
    *("compass_orientation", "heading_by_gnss", "compass_turn", "compass_motors", "attitude", "field", "field_size"),
    *("field_against_attitude", "compass_offset", "declination"),
)
# Checks of the attitude against the accelerometer, and those that are consequences of a wrong attitude.
ATTITUDE_AGAINST_FORCE = ("gravity_direction", MEAN_GRAVITY, "gravity_in_flight", "vertical_force", "trim")
REPEATS_WRONG_ATTITUDE = ("gravity_direction", MEAN_GRAVITY, "gravity_in_flight", "vertical_force")
LEVEL_CAUSE = "The accelerometer was calibrated on a slope, or its offsets are wrong."
FRAMES_CAUSE = "The simulator gives sensors and attitude in different frames: no setting of a vehicle mends it."
# Jumps below this are normal for an estimator.
SMALL_JUMP_DEG = 10.0
GYRO_KINDS = ("gyro", "gyro_bias", "frozen_gyro")
# Kinds that strong vibration explains if they begin after its onset.
SHAKEN_KINDS = ("imu_switched", "sensor_switch", "attitude", "estimator")
LOGGER_STOPPED = "The logger stopped and went on later: no card loses seconds."
# Time resolution of the onset: levels are per second.
BEFORE_ONSET_S = 1.0


def join_repeated(signs: Signs, context: Context) -> Signs:
    """Join more than :data:`MAX_LISTED` signs of a kind, severity and subject into one with the sum of counts.

    Crashes stay: the text of the first lists the others, and each report is evidence.
    """
    kinds: dict[tuple[str, str, str], Signs] = {}
    for sign in signs:
        kinds.setdefault((sign.kind, sign.severity, sign.about), []).append(sign)
    joined: Signs = []
    for same in kinds.values():
        joined += same if len(same) <= MAX_LISTED or same[0].kind == "crash" else [_joined(same)]
    return joined


def _joined(same: Signs) -> Finding:
    return replace(
        same[0],
        text=f"{same[0].text.rstrip('.')}, and {len(same) - 1} more of the kind.",
        t=min((sign.t for sign in same if sign.t is not None), default=None),
        count=sum(sign.count for sign in same),
        value=None,
        unit="",
        evidence=[sign.text for sign in same[1:MAX_QUOTED]],
        cause=same[0].cause if len({sign.cause for sign in same}) == 1 else "",
        action=same[0].action if len({sign.action for sign in same}) == 1 else "",
    )


def gather_wrong_heading(signs: Signs, context: Context) -> Signs:
    """Attribute a wrong heading by GNSS to the compass, without one to the attitude.

    The GNSS check is independent of the field. Cause and action come from other compass checks if these have an action.
    """
    gnss = [sign for sign in signs if sign.about == "heading_by_gnss" and sign.is_trouble]
    if not gnss:
        return signs
    if any(map(_is_missing_compass, signs)):
        return [
            replace(sign, kind="attitude", about="heading", cause=LOST_HEADING, action="") if sign in gnss else sign
            for sign in signs
        ]
    others = [s for s in signs if s.kind == "compass" and s.is_trouble and s not in gnss and s.action]
    if others:
        signs = [replace(sign, cause="", action="") if sign in gnss else sign for sign in signs]
    return [_as_kind("compass", s) if s.kind in HEADING_KINDS and s.about == "heading" else s for s in signs]


def gather_heading(signs: Signs, context: Context) -> Signs:
    """Attribute heading signs to a suspect compass, sorted by explanatory power."""
    if not any(sign.kind == "compass" and sign.is_trouble for sign in signs):
        return signs
    own = [
        replace(s, kind="compass")
        if s.kind in HEADING_KINDS and s.about == "heading" and s.severity != "serious"
        else s
        for s in signs
    ]
    return sorted(own, key=_compass_place)


def _compass_place(sign: Finding) -> int:
    """Return the sort key of a compass sign; motor fields above 30 % are first."""
    if sign.about == "field_size" and (sign.value or 0.0) > BENT_PCT:
        return 0
    return COMPASS_LEADS.index(sign.about) if sign.about in COMPASS_LEADS else len(COMPASS_LEADS)


def explain_small_tilts(signs: Signs, context: Context) -> Signs:
    """Attribute a small angle to gravity to the accelerometer; mounting errors are larger."""
    action = context.log.remedy("accelerometer")
    return [
        replace(s, kind="accelerometer", cause=LEVEL_CAUSE, action=action)
        if s.about == "gravity_direction" and s.severity == "warning"
        else s
        for s in signs
    ]


def explain_by_gyro(signs: Signs, context: Context) -> Signs:
    """Attribute wrong attitude and mounting to a faulty gyro."""
    gyro = next((sign.kind for sign in signs if sign.kind in GYRO_KINDS and sign.severity == "serious"), "")
    return [_as_kind(gyro, s) if gyro and s.kind in ("attitude", "mounting") else s for s in signs]


def explain_simulator(signs: Signs, context: Context) -> Signs:
    """Attribute a mounting error of a simulated vehicle to the simulator's frames."""
    return [
        replace(_as_kind("simulator", s), cause=FRAMES_CAUSE)
        if context.log.simulated and s.kind == "mounting" and s.is_trouble
        else s
        for s in signs
    ]


def explain_by_vibration(signs: Signs, context: Context) -> Signs:
    """Attribute a wrong mean force to vibration.

    Strong vibration also explains switches and rejections after its onset.
    """
    shaken = [s for s in signs if s.kind == "vibration" and s.is_trouble and s.about != "vertical_force"]
    if not shaken:
        return signs
    strong = any(s.about == "clipping" or s.severity == "serious" for s in shaken)
    onset = min((s.t for s in shaken if s.t is not None), default=None)

    def explained(sign: Finding) -> Finding:
        begins_with_it = sign.t is not None and onset is not None and sign.t >= onset - BEFORE_ONSET_S
        force = sign.about in ("gravity_in_flight", MEAN_GRAVITY)
        if sign.severity == "serious" or not (force or (strong and sign.kind in SHAKEN_KINDS and begins_with_it)):
            return sign
        return _as_kind("vibration", sign)

    place = {"clipping": 0, "vertical_force": 1, "vibration": 1, "vibration_level": 1}
    return sorted(map(explained, signs), key=lambda sign: place.get(sign.about, 2))


def explain_by_force(signs: Signs, context: Context) -> Signs:
    """Attribute rejections and failsafes of the estimator to a wrong mean vertical force from its onset on.

    A force that is wrong by metres per second squared makes predictions of vertical velocity and height wrong; a
    rejected position has other causes.
    """
    force = next(
        (s for s in signs if s.about == "vertical_force" and s.severity == "serious" and s.t is not None), None
    )
    if force is None:
        return signs
    since = force.t or 0.0
    later = [s for s in signs if s.kind == "estimator" and s.t is not None and s.t >= since]
    later = [s for s in later if s.about != REJECTED_POSITION]
    named = [(s.text, s.t or 0.0, s.about in TEST_RATIOS) for s in sorted(later, key=lambda s: s.t or 0.0)]
    caused = _with_effects(force, named) if named else force
    return [caused if s is force else _as_kind(force.kind, s) if s in later else s for s in signs]


def _as_kind(kind: str, sign: Finding) -> Finding:
    """Change the kind of a sign and clear its cause and action."""
    return replace(sign, kind=kind, cause="", action="")


# Kinds of skipped records without consequence.
MINOR_KINDS = ("duplicate_times", "time_backward", "unset_times", "imu_decimated", "no_mag", "mag_disabled")
# Number of skipped values below which they are a note.
FEW_VALUES = 10


def note_minor_records(signs: Signs, context: Context) -> Signs:
    """Reduce a slow but usable IMU and a few skipped records to notes."""
    refused = any(sign.kind == IMU_REFUSED for sign in signs)

    def noted(sign: Finding) -> Finding:
        if sign.kind == "rate":
            return replace(sign, severity="warning" if sign.severity == "serious" else "note")
        left_out = sign.kind in ("values_out_of_range", "false_times")
        few = left_out and (refused or sign.count < FEW_VALUES)
        return replace(sign, severity="note") if sign.kind in MINOR_KINDS or few else sign

    return [noted(sign) if sign.is_trouble else sign for sign in signs]


@dataclass(frozen=True, slots=True)
class Change:
    """Rule that replaces ``fields`` of the signs ``of`` a kind, or drops them without fields.

    It applies where any sign meets ``where``, by default always.
    """

    of: Callable[[Finding], bool]
    where: Callable[[Finding], bool] = lambda _: True
    fields: Mapping[str, str] = field(default_factory=dict)

    def __call__(self, signs: Signs, context: Context) -> Signs:
        """Apply the rule."""
        if not any(map(self.where, signs)):
            return signs
        changed = ((s, self.of(s)) for s in signs)
        return [replace(s, **self.fields) if mine else s for s, mine in changed if self.fields or not mine]  # type: ignore[arg-type]


def _is_missing_compass(sign: Finding) -> bool:
    return sign.kind in MISSING_COMPASS and sign.is_trouble


def _is_wrong_attitude(sign: Finding) -> bool:
    return sign.kind == "attitude" and sign.severity == "serious"


RULES: tuple[Rule, ...] = (
    join_repeated,
    gather_wrong_heading,
    Change(lambda s: s.kind == "compass", _is_missing_compass),
    # The reference of the heading uses the same field.
    Change(
        lambda s: _is_wrong_attitude(s) and s.about == "heading",
        lambda s: s.kind == "compass" and s.about in FIELD_CHECKS and s.is_trouble,
        {"severity": "warning"},
    ),
    # These compass checks depend on the onboard attitude.
    Change(lambda s: s.kind == "compass" and s.about in FIELD_BY_ATTITUDE, _is_wrong_attitude),
    # An attitude that integrates a gyro with a wrong scale turns away from a sound compass.
    Change(
        lambda s: s.kind == "compass" and s.about in FIELD_BY_ATTITUDE,
        lambda s: s.kind == "gyro_scale" and s.severity == "serious",
        {"kind": "gyro_scale", "cause": "", "action": ""},
    ),
    gather_heading,
    Change(
        lambda s: s.kind == "reset" and s.value is not None and s.value < SMALL_JUMP_DEG, fields={"severity": "note"}
    ),
    explain_small_tilts,
    explain_by_gyro,
    Change(
        lambda s: s.about in REPEATS_WRONG_ATTITUDE and s.kind != "vibration",
        _is_wrong_attitude,
        {"kind": "attitude", "cause": "", "action": ""},
    ),
    Change(lambda s: s.about in ATTITUDE_AGAINST_FORCE, lambda s: s.about == "accelerometer_axes"),
    explain_simulator,
    Change(lambda s: s.about == "stopped", fields={"cause": LOGGER_STOPPED, "action": ""}),
    explain_by_vibration,
    explain_by_force,
    note_minor_records,
)


# Findings.


def merge_causes(signs: Iterable[Finding]) -> list[Finding]:
    """Merge signs of a kind: the most severe leads, the others are evidence."""
    kinds: dict[tuple[str, str], Signs] = {}
    for sign in signs:
        apart = sign.text if sign.kind in SEPARATE_KINDS else KILL if sign.about == KILL else ""
        kinds.setdefault((sign.kind, apart), []).append(sign)
    merged = []
    for same in kinds.values():
        lead = min(same, key=_lead_rank)
        others = [sign for sign in same if sign is not lead]
        texts = [*lead.evidence, *(text for sign in others for text in _as_evidence(sign, lead))]
        evidence = [text for text in dict.fromkeys(texts) if text.rstrip(".") not in lead.text]
        count = sum(sign.count for sign in same if sign.text == lead.text)
        cause = next((sign.cause for sign in (lead, *others) if sign.cause), "")
        action = next((sign.action for sign in (lead, *others) if sign.action), "")
        severity = min((sign.severity for sign in same), key=SEVERITY_ORDER.index)
        merged.append(replace(lead, severity=severity, count=count, evidence=evidence, cause=cause, action=action))
    return merged


def _as_evidence(sign: Finding, lead: Finding) -> list[str]:
    """Return text and evidence of a sign merged with ``lead``: of one that ``lead`` names, only quoted texts."""
    if sign.text == lead.text or sign.text.rstrip(".") not in lead.text:
        return [sign.text, *sign.evidence]
    return [text for text in sign.evidence if text.startswith(QUOTED)]


# What findings of test ratios are about.
TEST_RATIOS = ("innovations", REJECTED_POSITION)


def _lead_rank(sign: Finding) -> tuple[bool, int, float]:
    """Return the sort key of a sign: a first cause, then severity, then size of impacts and test ratios.

    A step of the gyro's bias goes before its mean, poor GNSS quality comes last.
    """
    by_size = sign.kind == "hard_landing" or (sign.kind == "estimator" and sign.about in TEST_RATIOS)
    poor = sign.about == "gnss_quality" and sign.unit != "s"
    first = sign.about != FIRST_CAUSE
    place = float(poor) - float(sign.about == "gyro_bias_step")
    return first, SEVERITY_ORDER.index(sign.severity), -(sign.value or 0.0) if by_size else place


def choose_actions(found: Sequence[Finding], checks: Sequence[Check], log: FlightLog) -> list[Finding]:
    """Set the actions of findings from checks; each action only at its first finding."""
    advice = settings_advice(checks, log)
    taken: set[str] = set()
    chosen = []
    for finding in found:
        action, cause = finding.action or usual_action(finding, log), finding.cause
        if finding.is_trouble and finding.kind in advice:
            action, why = advice[finding.kind]
            cause = why or cause
        chosen.append(replace(finding, cause=cause, action="" if action in taken else action))
        taken.add(action)
    return chosen


def usual_action(finding: Finding, log: FlightLog) -> str:
    """Return what to do about a warning whose signs have no action, empty if nothing is known."""
    if not finding.is_trouble:
        return ""
    for name in (finding.about, finding.kind):
        if name in USUAL_REMEDIES:
            return log.remedy(USUAL_REMEDIES[name])
    kind = finding.kind
    about = log.settings.kind if kind == "damage" else finding.about
    return USUAL_ACTIONS.get((kind, about), USUAL_ACTIONS.get((kind, ""), ""))


def settings_advice(checks: Sequence[Check], log: FlightLog) -> dict[str, tuple[str, str]]:
    """Return action and cause by kind of finding from checks with settings.

    Compass checks also give actions without settings, which replace the usual remedy, because calibration does not
    remove a motor field. Settings that differ between checks are dropped.
    """
    agreed = {setting.name for setting in agreed_settings(checks)}
    to_set: dict[str, dict[str, str]] = {}
    to_do: dict[str, tuple[str, str]] = {}
    for check in _settings_first(c for c in checks if c.in_use):
        kind, cause = check_sign(check, log).kind, CAUSES[check.question] if check.question in OFFERS else ""
        if check.settings and all(setting.name in agreed for setting in check.settings):
            to_set.setdefault(kind, {})[settings_text(check)] = cause
        elif check.action and kind == "compass" and check.question in OFFERS:
            to_do.setdefault(kind, (check.action, cause))
    return to_do | {kind: (" ".join(texts), next(iter(texts.values()))) for kind, texts in to_set.items()}


# Checks whose settings or action remove the usual cause of their row.
OFFERS = ("compass_orientation", "compass_offset", "compass_motors", "compass_choice")


def _settings_first(checks: Iterable[Check]) -> list[Check]:
    """Sort warnings and faults: with settings first, then faults."""
    return sorted((c for c in checks if c.is_trouble), key=lambda c: (not c.settings, c.verdict != "fault"))


# Kinds of findings about logging or filters, not about the flight.
RECORD_KINDS = frozenset(
    """calibration_applied calibration_not_applied coverage cut_at_end damage damaged_reports delay
    duplicate_times estimator_failed estimator_not_compiled estimator_timed_out false_date false_times
    foreign_clock gaps gaps_and_rate imu_covers_a_part imu_decimated imu_delay imu_that_flew_too_slow jitter
    late_field log_clock log_limit not_checked params_differ params_unknown rate rate_impossible
    several_boots several_systems stale_packets time_backward truth_packet_times unanswered
    unreadable_message unset_times values_out_of_range""".split()
)


def first_serious(found: Sequence[Finding]) -> str:
    """Return the name of the first serious finding, empty without one."""
    first = next((f for f in found if f.severity == "serious"), None)
    if first is None:
        return ""
    kind = first.kind.replace("_", " ").replace("imu", "IMU").replace("gnss", "GNSS")
    return CHECKS[first.about].title if first.about in CHECKS else kind


def nothing_wrong(found: Sequence[Finding]) -> bool:
    """Return whether no finding about the flight is a warning."""
    return not any(finding.is_trouble and finding.kind not in RECORD_KINDS for finding in found)
