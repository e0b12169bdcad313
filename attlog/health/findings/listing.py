"""What is wrong with this log: one list, made once, from checks, reports of the autopilot, events and open questions.

Each check and each report is a sign of a kind of finding; what shares its cause is one finding.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, replace

from attlog.flight.model import FlightLog, Problem
from attlog.health import agreement
from attlog.health.assessments.model import Assessment
from attlog.health.findings import actions, assessed, attitude, autopilot, compass, record, repeated, sensors
from attlog.health.findings.finding import ORDER, Explanation, Finding, merged, of_problem
from attlog.health.model import FAILED, Check
from attlog.health.onboard.attitude import CONTRADICTED
from attlog.health.reason import as_sentence
from attlog.health.sensors import frozen
from attlog.health.sensors.gyro import CONSTANT, UNUSABLE_DPS, ZERO
from attlog.reference.model import Reference
from attlog.story.event import Event

ABOUT: Mapping[str, Explanation] = (
    autopilot.CHECKS | attitude.CHECKS | sensors.CHECKS | compass.CHECKS  # the order of findings that are equally bad
)
"""What a check that is not ok means, by its name."""
FIRST = ("gyro", "frozen_gyro", "gyro_spikes", "gyro_bias", autopilot.CRASH, sensors.VIBRATION)
"""Kinds of findings that stand first among those that are equally bad."""
REPORTS: Mapping[str, str] = attitude.REPORTS | sensors.REPORTS | compass.REPORTS
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
    its place (``attlog.health.agreement``); those of sensors that are not in use are notes.
    """
    events, health = list(events), list(health)
    checks = record.of_what_was_measured(list(checks), log)
    answers = agreement.answers(log, checks, health)
    checks = agreement.agreed(log, checks, health)
    spare = agreement.of_other_sensors(log, health)
    mine = [a for a in health if a not in spare]
    reports = [of_problem(p) for p in [*log.problems, *others]]
    happened = [sensors.shaken(sign, log.remedies) for sign in autopilot.of_events(events, reports, log.kind.hovers)]
    crashed = any(sign.kind == autopilot.CRASH for sign in happened)
    reported = any(REPORTS.get(report.kind) == sensors.RATE for report in reports)
    left_out = {autopilot.CRASH: crashed, "rate": reported}
    wrong = [c for c in checks if c.verdict in ("warning", "fault") and not left_out.get(c.name)]
    told = [assessed.explained(of_check(c, log), answers.get(c.name)) for c in wrong]
    told += happened
    crashed |= any(sign.kind == autopilot.CRASH for sign in told)
    reports = autopilot.after_crashes(autopilot.harmless(autopilot.untold(reports, events), events), events)
    reports = autopilot.of_the_start(reports, log)
    if not crashed:  # what the autopilot alone calls a crash is a bench or a hand
        reports = [autopilot.doubted(report) if report.kind == autopilot.CRASH else report for report in reports]
    told += [replace(report, kind=REPORTS.get(report.kind, report.kind)) for report in reports]
    told = sensors.settled(attitude.settled(compass.settled(repeated.joined(told)), log))
    told = assessed.with_assessments(told, [a for a in mine if a not in answers.values()], spare)
    told += [Finding(FAILED, "serious", check.text) for check in checks if check.value == FAILED]
    told += [*_unchecked(checks), *_open(list(unanswered))]
    found = merged(record.settled(told))
    place = {kind: i for i, kind in enumerate(dict.fromkeys([*FIRST, *(about.kind for about in ABOUT.values())]))}
    found.sort(key=lambda f: (ORDER.index(f.severity), place.get(f.kind, len(place)), f.t or 0.0))
    chosen = any(a.question == "compass_choice" and a.verdict != "unknown" for a in mine)
    return actions.with_actions(found, log, assessed.advice_of(mine), chosen=chosen)


def of_check(check: Check, log: FlightLog) -> Finding:
    """A check that is not ok as a sign of its kind."""
    own = compass.DEAD if check.name.startswith("magnetometer ") else Explanation(check.name.replace(" ", "_"))
    about = ABOUT.get(check.name, own)
    severity = about.as_fault if check.verdict == "fault" else about.as_warning
    if check.name == "gyro bias" and severity == "serious" and not unusable([check]):
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
        action=log.remedies.get(about.fault, "") if about.fault and mends else _logging(check, log),
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


def unusable(checks: Iterable[Check]) -> str:
    """Why no filter can be judged at all: a gyro far from zero while the vehicle stands, or one that is not what
    turned or stopped; empty where one can."""
    for check in checks:
        if check.name == "gyro against attitude" and check.value == CONTRADICTED:
            return f"{check.text[0].lower()}{check.text[1:].rstrip('.')}"
        if check.name == "gyro bias" and isinstance(check.value, float) and abs(check.value) >= UNUSABLE_DPS:
            return f"the gyro reads {check.value:.0f} deg/s while the vehicle stands still"
        if why := frozen.unusable(check):
            return why
    return ""


def _unchecked(checks: list[Check]) -> list[Finding]:
    """The checks that could not be made as one entry; why, as its evidence."""
    missing = [check for check in checks if check.verdict == "unknown" and check.value != FAILED]
    if not missing:
        return []
    text = f"Not checked: {', '.join(check.name for check in missing)}."
    return [Finding("not_checked", "info", text, evidence=[f"{check.name}: {check.text}" for check in missing])]


def _open(unanswered: list[OpenQuestion]) -> list[Finding]:
    """The questions without an answer as one entry; their cards say why."""
    if not unanswered:
        return []
    titles = ", ".join(item.title.lower() for item in unanswered)
    remedies = dict.fromkeys(item.remedy for item in unanswered if item.remedy)
    text = f"Not answered: {titles}."
    return [Finding("unanswered", "note", text, action=" ".join(remedies))]


def _logging(check: Check, log: FlightLog) -> str:
    """The setting that would log what a check lacks."""
    imu, onboard = log.replay_imu, log.onboard_attitude
    if check.name == "rate":
        return log.advice("fast_imu", imu.gyro.rate) if imu is not None else log.advice("imu")
    if check.name == "coverage":
        return log.advice("attitude", onboard.rate if onboard is not None else None)
    return ""
