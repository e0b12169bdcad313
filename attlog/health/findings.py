"""A check and a question may ask the same of the sensor in use. Where the question was answered, its answer is both's.

Questions look at more: a heading without any compass, the total error, the firmware's own measure. Two numbers for one
thing, or an "ok" beside a warning, would only leave the reader to choose.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise

from attlog.flight.model import FlightLog, Problem
from attlog.health import causes, timing
from attlog.health.attitude import CONTRADICTED
from attlog.health.causes import (
    RATE,
    SEVERITY_ORDER,
    Explanation,
    Finding,
    Weight,
    event_finding,
    merge_kinds,
    problem_finding,
)
from attlog.health.check import FAILED, Assessment, Check, as_sentence
from attlog.health.imu import CONSTANT, UNUSABLE_DPS, ZERO
from attlog.reference.model import Reference
from attlog.story.estimator_events import is_estimator_jump
from attlog.story.flight_events import CRASHES, Event

__all__ = [
    "EXPLANATIONS",
    "Finding",
    "OpenQuestion",
    "Weight",
    "contradiction",
    "findings",
    "nothing_wrong",
    "unusable_gyro",
]


SAME_QUESTION: Mapping[str, str] = {
    "compass offset": "compass_offset",
    "field against motors": "compass_motors",
    "force offset": "accelerometer_offset",
    "gravity": "accelerometer_rest",
    "gyro bias": "gyro_bias",
    "vibration": "vibration_level",
}
"""The question that asks what a check asks, by the check's name; of ``rejected ...`` it is RATIOS, for each aid."""
VEHICLE_QUESTIONS = ("vibration_level",)
"""Questions whose worst sensor answers: every IMU feels the same propellers, and estimators run on each."""
SPOILING_CHECKS = ("gravity",)
"""Checks whose fault makes every comparison worthless: that is for them to say, a wrong scale does not."""
RATIO_QUESTION = "innovations"
VERDICT_ORDER = ("ok", "warning", "fault")


def answers_by_check(log: FlightLog, checks: Iterable[Check], health: Iterable[Assessment]) -> dict[str, Assessment]:
    """The assessment that answers a check, by the check's name; none for what is unknown or of another sensor.

    A check whose value is a word, such as a sensor that stopped, stands for itself.
    """
    known = [a for a in health if a.verdict in VERDICT_ORDER]
    found: dict[str, Assessment] = {}
    for check in checks:
        if isinstance(check.value, str):
            continue
        same = [a for a in known if _answers_check(log, check.name, a)]
        if same:
            found[check.name] = max(same, key=lambda a: VERDICT_ORDER.index(a.verdict))
    return found


def _answers_check(log: FlightLog, name: str, assessment: Assessment) -> bool:
    if assessment.question == RATIO_QUESTION:
        return any(
            t.source == assessment.sensor and name == f"rejected {t.aid}" for t in log.estimator.innovation_tests
        )
    if SAME_QUESTION.get(name) != assessment.question:
        return False
    return assessment.question in VEHICLE_QUESTIONS or assessment.sensor in _sources_in_use(log)


def reconcile(log: FlightLog, checks: Iterable[Check], health: Iterable[Assessment]) -> list[Check]:
    """The checks, each with the verdict, sentence and number of the question that asks the same, where it is known."""
    checks = list(checks)
    found = answers_by_check(log, checks, health)
    return [_reconciled(check, found[check.name]) if check.name in found else check for check in checks]


def _reconciled(check: Check, answer: Assessment) -> Check:
    if (
        answer.question == RATIO_QUESTION
        and "ok" not in (check.verdict, answer.verdict)
        and check.verdict in VERDICT_ORDER
    ):
        return replace(check, verdict=answer.verdict)  # its own sentence tells when, and by how much
    verdict: str = answer.verdict
    if check.name in SPOILING_CHECKS and verdict == "fault":
        verdict = check.verdict if check.verdict in VERDICT_ORDER[1:] else "warning"
    same = check.verdict == verdict
    return Check(
        check.name,
        verdict,
        answer.text,
        answer.value,
        answer.unit,
        answer.threshold,
        check.t if answer.t is None and same else answer.t,
        check.count if same else 1,
        check.t_end if same else None,
        answer.question,
        list(answer.evidence),
        check.cause if same else "",
        answer.ci95,
        answer.n,
        answer.seconds,
    )


def unused_sensors(log: FlightLog, health: Iterable[Assessment]) -> list[Assessment]:
    """The assessments of compasses and IMUs that are logged beside those in use: nothing flew by them."""
    sources = {mag.field.source for mag in log.mags}
    sources |= {source for imu in log.imus for source in (imu.gyro.source, imu.acc.source)}
    return [a for a in health if a.sensor in sources - _sources_in_use(log)]


def _sources_in_use(log: FlightLog) -> set[str]:
    """The sources of the compass and of the IMU that flew."""
    imu = log.imus[log.imu or 0] if log.imus else None
    used = {log.mags[log.mag].field.source} if log.mag is not None else set()
    return used | ({imu.gyro.source, imu.acc.source} if imu is not None else set())


# Signs of one kind that are too many to list: one with their number, the first of them and what all share.

MAX_LISTED = 5
"""Up to so many signs of one kind stand for themselves; a hostile or badly damaged log brings hundreds."""
MAX_QUOTED = 3
"""Of more than that, so many are quoted."""


def join_repeated(signs: Iterable[Finding]) -> list[Finding]:
    """The signs in their order; equal ones once, more than :data:`MANY` of a kind and severity as one sign.

    Its ``count`` is the sum of theirs. Cause and action stay where all have the same.
    """
    kinds: dict[tuple[str, str, str], list[Finding]] = {}
    for sign in signs:
        kinds.setdefault((sign.kind, sign.severity, sign.about), []).append(sign)
    told: list[Finding] = []
    for same in kinds.values():
        told += same if len(same) <= MAX_LISTED else [_join_signs(same)]
    return told


def _join_signs(same: list[Finding]) -> Finding:
    first, *_ = same
    times = [sign.t for sign in same if sign.t is not None]
    return replace(
        first,
        text=f"{first.text.rstrip('.')}, and {len(same) - 1} more of the kind.",
        t=min(times, default=None),
        count=sum(sign.count for sign in same),
        value=None,
        unit="",
        evidence=[sign.text for sign in same[1:MAX_QUOTED]],
        cause=_shared_text([sign.cause for sign in same]),
        action=_shared_text([sign.action for sign in same]),
    )


def _shared_text(texts: list[str]) -> str:
    return texts[0] if len(set(texts)) == 1 else ""


# What is wrong with the recording alone: it costs detail, and nothing went wrong in the flight.

RECORD_KINDS = frozenset(
    """calibration_applied calibration_not_applied coverage cut_at_end damage damaged_reports delay duplicate_times
    estimator_failed estimator_not_compiled estimator_timed_out false_times gaps gaps_and_rate imu_covers_a_part
    imu_decimated imu_delay imu_that_flew_too_slow jitter late_field log_limit not_checked params_differ
    params_unknown rate rate_impossible several_boots several_systems time_backward truth_packet_times unanswered
    unreadable_message unset_times values_out_of_range""".split()
)
"""Kinds of findings that are of the record or of filters."""
IMU_CHECKS = ("gravity", "gravity in flight", "gravity direction", "rate", "gaps", "jitter", "delay", "vibration")
"""Checks of inertial data, which say nothing where most of them were refused."""
MINOR_KINDS = ("duplicate_times", "time_backward", "unset_times", "imu_decimated", "no_mag", "mag_disabled")
"""What is not in the log, or left out, without harm."""
IMU_REFUSED = "imu_mostly_refused"
FEW_VALUES = 10
"""Values left out, of thousands."""


def nothing_wrong(findings: Sequence[Finding]) -> bool:
    """Whether no finding about the flight is a warning."""
    return not any(finding.is_trouble and finding.kind not in RECORD_KINDS for finding in findings)


def without_refused_imu(checks: list[Check], log: FlightLog) -> list[Check]:
    """The checks but for those of inertial data of which most were refused: what is left is chance."""
    refused = any(problem.code == IMU_REFUSED for problem in log.problems)
    return [check for check in checks if check.name not in IMU_CHECKS] if refused else checks


def settle_record(signs: Sequence[Finding]) -> list[Finding]:
    """The signs, those that cost the reader and change nothing as notes."""
    refused = any(sign.kind == IMU_REFUSED for sign in signs)
    return [_note_minor(sign, refused) if sign.is_trouble else sign for sign in signs]


def _note_minor(sign: Finding, refused: bool) -> Finding:
    """A slow but usable IMU, records left out here and there, one parameter's value as notes; an IMU that is too slow
    for filters is no fault of a flight. ``refused``: most values, which says it all."""
    if sign.kind == RATE:
        return replace(sign, severity="warning" if sign.severity == "serious" else "note")
    minor = sign.kind in MINOR_KINDS or (sign.kind == "values_out_of_range" and (refused or sign.count < FEW_VALUES))
    return replace(sign, severity="note") if minor else sign


# How often did it crash, and what is said of each crash? Events that belong together are one crash.

CRASH_KIND = "crash"
ONE_CRASH_S = 5.0
"""Blows and overturns that follow each other so soon are one crash, as in the headline."""
MAX_LATER_CRASHES = 3
"""Later crashes that are told by their time."""
SOON_AFTER_ARMING_S = 10.0
FLIPPED_ADVICE = "Check motor order, spin and propellers, and how the autopilot is mounted."


def crash_signs(events: Sequence[Event], hovers: bool = True) -> list[Finding]:
    """One sign for each event that is a crash, in time order; the first of them says what all of them were.

    Who ``hovers`` and turns over soon after arming, before any lift-off, has its rotors or its autopilot mounted
    otherwise than set.
    """
    happened = [event for event in events if event.is_crash]
    found = [event_finding(event, CRASH_KIND) for event in happened]
    if found:
        flipped = hovers and happened[0].kind == "overturn" and _was_on_ground(events, happened[0].t)
        found[0] = replace(
            found[0], text=_crash_text(_group_crashes(happened)), action=FLIPPED_ADVICE if flipped else ""
        )
    return found


def wreck_spans(events: Sequence[Event]) -> list[tuple[float, float]]:
    """Spans (t0, t1) s from each crash to the next lift-off, or for ever."""
    lifts = [event.t for event in events if event.kind == "liftoff"]
    return [(e.t, min((t for t in lifts if t > e.t), default=float("inf"))) for e in events if e.is_crash]


def _was_on_ground(events: Sequence[Event], t: float) -> bool:
    """Whether it armed just before and did not lift off; a log that begins long after arming may begin in the air."""
    before = [event for event in events if event.t < t]
    armed = any(event.kind == "armed" and event.t >= max(t - SOON_AFTER_ARMING_S, 0.0) for event in before)
    return armed and not any(event.kind in ("liftoff", "landing") for event in before)


def _group_crashes(events: Sequence[Event]) -> list[list[Event]]:
    """The events of each crash."""
    groups = [[event] for event in events[:1]]
    for before, event in pairwise(events):
        if event.t - (before.t_end or before.t) < ONE_CRASH_S:
            groups[-1].append(event)
        else:
            groups.append([event])
    return groups


def _crash_text(groups: Sequence[Sequence[Event]]) -> str:
    """What happened in the first crash and how it lay in the end, then when it crashed again."""
    told = [event.text.split(". ", 1) for event in groups[0]]
    moves = list(dict.fromkeys(f"{sentences[0].rstrip('.')}." for sentences in told))
    lay = told[-1][1:]  # how it lay before the last of them is over
    again = [f"{group[0].t:.1f} s" for group in groups[1:]]
    if len(again) > MAX_LATER_CRASHES:
        again = [*again[: MAX_LATER_CRASHES - 1], f"{len(again) - MAX_LATER_CRASHES + 1} times more"]
    times = " and ".join([", ".join(again[:-1]), again[-1]] if len(again) > 1 else again)
    return " ".join([*moves, *lay, *([f"Crashed again at {times}."] if again else [])])


# What the autopilot did and said, and how flights ended: events of the story that are trouble.

CRASH = CRASH_KIND
CRASH_CHECKS = {CRASH: Explanation(CRASH, as_fault="serious")}
EVENT_KINDS = {
    "hard_landing": "hard_landing",
    "clipping": causes.VIBRATION,
    "vibration": causes.VIBRATION,
    "realigned": "realigned",
    "lane_switch": causes.RESET,
    "sensor_switch": "sensor_switch",
    "compass_switch": causes.COMPASS,
    "gnss_lost": causes.GNSS,
    "gnss_jump": causes.GNSS,
    "failsafe": "failsafe",
    "battery": "battery",
}
"""Of which finding an event is a sign; crashes and messages are treated on their own."""
MESSAGE_KINDS = (
    (re.compile(r"\bmag|compass|yaw", re.I), causes.COMPASS),
    (re.compile(r"clipping|vibration", re.I), causes.VIBRATION),
    (re.compile(r"\bgps|\bgnss|glitch", re.I), causes.GNSS),
    (re.compile(r"\bekf|variance|estimator|attitude|\bahrs", re.I), causes.ESTIMATOR),
)
"""What a message of the autopilot is about, by its words."""
EVENTS_FOR_CODES = {
    "failsafe": ("failsafe", "battery"),
    "err_5_1": ("failsafe",),
    "err_6_1": ("battery",),
    "err_8_1": ("failsafe",),
    "gnss_glitch": ("gnss_jump",),
    "ev_54": ("failsafe",),
    "imu_switched": ("sensor_switch",),
}
"""Codes of problems, and the events that tell the same better where there is one."""
EVENT_ACTIONS = {"battery": "Charge or change the battery, and land earlier."}
EXPLAINED_FAILSAFES, SAME_TIME_S = ("err_7_1", "err_31_1", "ekf_failsafe", "vibration_failsafe"), 0.01
"""Failsafes of a sensor or the estimator, which are signs of those, and told at the same time."""
STEADY_GNSS_CAUSE = "A wrong attitude, vibration or a wrong compass; GNSS itself is steady there."
"""Why the estimator says that GNSS jumped where its position and velocity agree."""
MAX_EVIDENCE = 4
"""So many sentences of the autopilot are quoted in one finding."""


def event_signs(events: Iterable[Event], reports: Sequence[Finding] = (), hovers: bool = True) -> list[Finding]:
    """The signs in what happened: crashes as one, the others by their kind; a message is a sign of what it names.

    A failsafe that ``reports`` of the autopilot tell with its sensor is no sign of its own. ``hovers``: the vehicle
    takes off upright on its rotors.
    """
    events = list(events)
    found = crash_signs(events, hovers)
    wrecks = wreck_spans(events)
    explained = [report.t for report in reports if report.kind in EXPLAINED_FAILSAFES and report.t is not None]
    for event in events:
        if event.kind in CRASHES or event.severity not in ("warning", "serious"):
            continue
        if event.kind == "failsafe" and any(abs(event.t - t) < SAME_TIME_S for t in explained):
            continue
        if event.kind == "message":
            kind = next((kind for words, kind in MESSAGE_KINDS if words.search(event.text)), "message")
            found.append(replace(event_finding(event, kind), text=f"The autopilot said {event.text}"))
        elif event.kind in EVENT_KINDS:
            sign = event_finding(event, EVENT_KINDS[event.kind])
            if is_estimator_jump(event):
                sign = replace(sign, kind=causes.ESTIMATOR, value=None, unit="", cause=STEADY_GNSS_CAUSE)
            about = {"clipping": "clipping", "realigned": "heading", "vibration": "vibration"}.get(event.kind, "")
            found.append(replace(sign, about=about, action=EVENT_ACTIONS.get(event.kind, "")))
    counted = [sign for sign in found if sign.kind == CRASH or not _is_within(sign.t, wrecks)]
    return [replace(sign, evidence=sign.evidence[:MAX_EVIDENCE]) for sign in counted]


def _is_within(t: float | None, spans: Sequence[tuple[float, float]]) -> bool:
    return t is not None and any(a < t < b for a, b in spans)


def without_events(problems: Sequence[Finding], events: Sequence[Event]) -> list[Finding]:
    """The signs of problems that no event tells already."""
    happened = {event.kind for event in events}
    return [p for p in problems if not happened.intersection(EVENTS_FOR_CODES.get(p.kind, ()))]


def note_after_crashes(reports: Sequence[Finding], events: Sequence[Event]) -> list[Finding]:
    """The reports, those of a wreck as notes: from a crash until it lifted off again."""
    wrecks = wreck_spans(events)
    return [
        replace(report, severity="note") if report.kind != CRASH and _is_within(report.t, wrecks) else report
        for report in reports
    ]


def note_harmless(reports: Sequence[Finding], events: Sequence[Event]) -> list[Finding]:
    """The reports, a failsafe as a note where the event at its time is one: disarmed, or before it could be true."""
    notes = [event.t for event in events if event.kind == "failsafe" and event.severity == "note"]
    return [
        replace(report, severity="note")
        if report.kind in EXPLAINED_FAILSAFES
        and any(report.t is not None and abs(report.t - t) < SAME_TIME_S for t in notes)
        else report
        for report in reports
    ]


def note_before_start(reports: Sequence[Finding], log: FlightLog) -> list[Finding]:
    """The reports, those from before the first sample as notes: an autopilot that starts, and is not armed yet."""
    line = log.state.armed
    armed = [] if line is None else [t for t, value in zip(line.t.tolist(), line.value, strict=True) if value]
    begin = min([0.0, *armed])
    return [replace(r, severity="note") if r.t is not None and r.t < begin and r.is_trouble else r for r in reports]


def doubt_crash(report: Finding) -> Finding:
    """A crash that the autopilot reports while no sensor shows one."""
    return replace(report, kind="crash_check", severity="warning", cause="No sensor shows a crash: a bench, or a hand.")


# What is wrong with this log: one list, made once, from checks, reports of the autopilot, events and open questions.
#
# Each check and each report is a sign of a kind of finding; what shares its cause is one finding.

EXPLANATIONS: Mapping[str, Explanation] = (
    CRASH_CHECKS
    | causes.ATTITUDE_CHECKS
    | causes.SENSOR_CHECKS
    | causes.COMPASS_CHECKS  # the order of findings that are equally bad
)
"""What a check that is not ok means, by its name."""
FIRST_KINDS = ("gyro", "frozen_gyro", "gyro_spikes", "gyro_bias", CRASH, causes.VIBRATION)
"""Kinds of findings that stand first among those that are equally bad."""
REPORT_KINDS: Mapping[str, str] = causes.ATTITUDE_REPORTS | causes.SENSOR_REPORTS | causes.COMPASS_REPORTS
"""Of which kind of finding a problem is a sign, by its code; of its own where it stands nowhere."""


@dataclass(frozen=True, slots=True)
class OpenQuestion:
    """A question without an answer, as its card is titled, and what would answer it (may be empty)."""

    title: str
    remedy: str = ""


def findings(
    log: FlightLog,
    checks: Iterable[Check],
    others: Iterable[Problem] = (),
    unanswered: Iterable[OpenQuestion] = (),
    events: Iterable[Event] = (),
    health: Iterable[Assessment] = (),
) -> list[Finding]:
    """Everything that is not ok, worst first, one entry for each cause.

    ``others`` are problems that the analysis itself found, ``events`` what happened, ``health`` the assessments of the
    sensors: what they offer to set is the action of the findings that they belong to. One that answers a check takes
    its place (``attlog.health.findings``); those of sensors that are not in use are notes.
    """
    events, health = list(events), list(health)
    checks = without_refused_imu(list(checks), log)
    answers = answers_by_check(log, checks, health)
    checks = reconcile(log, checks, health)
    spare = unused_sensors(log, health)
    mine = [a for a in health if a not in spare]
    reports = [problem_finding(p) for p in [*log.problems, *others]]
    happened = [causes.explain_vibration(sign, log.remedies) for sign in event_signs(events, reports, log.kind.hovers)]
    crashed = any(sign.kind == CRASH for sign in happened)
    reported = any(REPORT_KINDS.get(report.kind) == causes.RATE for report in reports)
    left_out = {CRASH: crashed, "rate": reported}
    wrong = [c for c in checks if c.verdict in ("warning", "fault") and not left_out.get(c.name)]
    told = [causes.without_harmless(check_sign(c, log), answers.get(c.name)) for c in wrong]
    told += happened
    crashed |= any(sign.kind == CRASH for sign in told)
    reports = note_after_crashes(note_harmless(without_events(reports, events), events), events)
    reports = note_before_start(reports, log)
    if not crashed:  # what the autopilot alone calls a crash is a bench or a hand
        reports = [doubt_crash(report) if report.kind == CRASH else report for report in reports]
    told += [replace(report, kind=REPORT_KINDS.get(report.kind, report.kind)) for report in reports]
    told = causes.settle_vibration(causes.settle_attitude(causes.settle_compass(join_repeated(told)), log))
    told = causes.add_assessments(told, [a for a in mine if a not in answers.values()], spare)
    told += [Finding(FAILED, "serious", check.text) for check in checks if check.value == FAILED]
    told += [*_unchecked_finding(checks), *_open_finding(list(unanswered))]
    found = merge_kinds(settle_record(told))
    place = {
        kind: i
        for i, kind in enumerate(dict.fromkeys([*FIRST_KINDS, *(about.kind for about in EXPLANATIONS.values())]))
    }
    found.sort(key=lambda f: (SEVERITY_ORDER.index(f.severity), place.get(f.kind, len(place)), f.t or 0.0))
    chosen = any(a.question == "compass_choice" and a.verdict != "unknown" for a in mine)
    return causes.choose_actions(found, log, causes.settings_advice(mine), chosen=chosen)


def check_sign(check: Check, log: FlightLog) -> Finding:
    """A check that is not ok as a sign of its kind."""
    own = causes.DEAD_COMPASS if check.name.startswith("magnetometer ") else Explanation(check.name.replace(" ", "_"))
    about = EXPLANATIONS.get(check.name, own)
    severity = about.as_fault if check.verdict == "fault" else about.as_warning
    if check.name == "gyro bias" and severity == "serious" and not unusable_gyro([check]):
        severity = "warning"
    value = check.value if isinstance(check.value, (int, float)) else None
    mends = check.value not in (ZERO, CONSTANT)  # no setting mends a dead sensor
    return Finding(
        about.kind,
        severity,
        check.text,
        t=check.t,
        t_end=check.t_end,
        count=check.count,
        value=value,
        unit=check.unit if value is not None else "",
        about=check.about or check.name,
        evidence=list(check.evidence),
        cause=check.cause or about.cause,
        action=log.remedies.get(about.fault, "") if about.fault and mends else _logging_advice(check, log),
    )


def contradiction(reference: Reference) -> list[Problem]:
    """A reference that physics contradicts, or that had to give way to the smoother, as an entry; none otherwise.

    A wrong onboard heading is an entry by its own check.
    """
    taken = reference.kind in ("smoother", "onboard")
    told = {name: why for name, why in reference.refused.items() if why != reference.wrong_heading}
    gave_way = [told[name] for name in ("truth", "onboard") if taken and name in told]
    if gave_way:
        return [Problem("reference_contradicted", "error", as_sentence(why)) for why in gave_way]
    if not reference.fault or reference.fault == reference.wrong_heading:
        return []
    sentences = [reference.fault, *(step.text for step in reference.steps if step.name == "contradiction")]
    return [Problem("reference_contradicted", "error", f"{sentence}.") for sentence in sentences]


def unusable_gyro(checks: Iterable[Check]) -> str:
    """Why no filter can be judged at all: a gyro far from zero while the vehicle stands, or one that is not what
    turned or stopped; empty where one can."""
    for check in checks:
        if check.name == "gyro against attitude" and check.value == CONTRADICTED:
            return f"{check.text[0].lower()}{check.text[1:].rstrip('.')}"
        if check.name == "gyro bias" and isinstance(check.value, float) and abs(check.value) >= UNUSABLE_DPS:
            return f"the gyro reads {check.value:.0f} deg/s while the vehicle stands still"
        if why := timing.frozen_gyro_reason(check):
            return why
    return ""


def _unchecked_finding(checks: list[Check]) -> list[Finding]:
    """The checks that could not be made as one entry; why, as its evidence."""
    missing = [check for check in checks if check.verdict == "unknown" and check.value != FAILED]
    if not missing:
        return []
    text = f"Not checked: {', '.join(check.name for check in missing)}."
    return [Finding("not_checked", "info", text, evidence=[f"{check.name}: {check.text}" for check in missing])]


def _open_finding(unanswered: list[OpenQuestion]) -> list[Finding]:
    """The questions without an answer as one entry; their cards say why."""
    if not unanswered:
        return []
    titles = ", ".join(item.title.lower() for item in unanswered)
    remedies = dict.fromkeys(item.remedy for item in unanswered if item.remedy)
    text = f"Not answered: {titles}."
    return [Finding("unanswered", "note", text, action=" ".join(remedies))]


def _logging_advice(check: Check, log: FlightLog) -> str:
    """The setting that would log what a check lacks."""
    imu, onboard = log.replay_imu, log.onboard_attitude
    if check.name == "rate":
        return log.advice("fast_imu", imu.gyro.rate) if imu is not None else log.advice("imu")
    if check.name == "coverage":
        return log.advice("attitude", onboard.rate if onboard is not None else None)
    return ""


# What is wrong with a log, and what to do about it: one finding for each cause.
