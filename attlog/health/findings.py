"""What is wrong with this log: one list, made once, from checks, the autopilot's own reports and open questions.

Each entry says what was seen, since when, why that usually happens, what to do, and
what it means for the comparison. What two of them tell is one entry.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, replace

import numpy as np

from attlog.flight.model import FlightLog, Problem, Severity
from attlog.flight.remedies import Fault
from attlog.health import repeated as many_of_a_kind
from attlog.health.model import FAILED, Check
from attlog.health.onboard import against_smoother
from attlog.health.onboard.attitude import CONTRADICTED
from attlog.health.reason import as_sentence
from attlog.health.sensors import frozen
from attlog.health.sensors.gyro import UNUSABLE_DPS
from attlog.reference.model import Reference
from attlog.reference.physics.sensor_faults import FRAME

ORDER: tuple[Severity, ...] = ("error", "warning", "note", "info")
"""Worst first."""


@dataclass(frozen=True, slots=True)
class Explanation:
    """What a check that is not ok means: how bad, why, which remedy, what for the comparison.

    ``codes``: problems of readers and reports that say the same; ``beside``: those that are as important.
    """

    as_warning: Severity = "warning"
    as_fault: Severity = "warning"
    cause: str = ""
    fault: Fault | None = None
    means: str = ""
    codes: tuple[str, ...] = ()
    beside: tuple[str, ...] = ()


_TILT = "Where the attitude is wrong, filters that agree with it are wrong as well."
_HEADING = "Filters that use the compass take its error for heading."
_STOPPED = "The sensor, its driver or its bus stopped."
ABOUT: dict[str, Explanation] = {
    "gyro": Explanation(as_fault="error", cause=_STOPPED, means="No filter can follow."),
    "gravity": Explanation(
        cause="The accelerometer is not calibrated, has the wrong range set, or vibrates.",
        fault="accelerometer",
        means="Filters that check the size of the force trust it less; a wrong direction tilts all of them.",
    ),
    "frozen gyro": Explanation(as_fault="error", cause=_STOPPED, means="No filter can follow."),
    "gyro spikes": Explanation(
        as_fault="error",
        cause="Errors on the sensor's bus, or samples that leave its range.",
        fault="bus",
        means="Every filter turns by them as if the vehicle had turned.",
    ),
    "compass axes": Explanation(
        as_fault="error",
        cause="The compass is mounted otherwise than set, or its axes are mixed up.",
        fault="compass_mounting",
        means=_HEADING,
    ),
    "accelerometer axes": Explanation(
        as_fault="error",
        cause="The accelerometer is mounted otherwise than set, or its axes are mixed up.",
        fault="mounting",
        means="Filters take its down for down. The attitude that flew is right.",
    ),
    "accelerometer delay": Explanation(
        as_fault="error",
        cause="Its samples wait in a queue, or are stamped by another clock.",
        fault="bus",
        means="Filters take the force of one moment for gravity of another.",
    ),
    "frozen sensors": Explanation(
        as_fault="error", cause=_STOPPED, means="Filters that use it go on with its last value as if it were measured."
    ),
    "gyro bias": Explanation(
        as_fault="error",
        cause="The gyro was not calibrated, was moved while it started, or warms up.",
        fault="gyro_bias",
        means="Filters that do not estimate the gyro's bias lean and turn away by it.",
    ),
    "crash": Explanation(
        as_fault="error",
        cause="Lost thrust, lost attitude or contact with something.",
        fault="crash",
        means="Errors in a tumble say little about flight.",
        codes=("crash",),
    ),
    "onboard against smoother": Explanation(
        as_fault="error",
        cause="The onboard estimator was not aligned, or learned a wrong bias or a disturbed field.",
        fault="estimator",
        means="Filters are compared with the smoother and not with it; what it flew on was wrong.",
        codes=("reference_contradicted",),
    ),
    against_smoother.TRUTH: Explanation(
        as_fault="error",
        cause="The onboard estimator was not aligned, or learned a wrong bias or a disturbed field.",
        fault="estimator",
        means="What it flew on was wrong; filters are compared with the truth and not with it.",
    ),
    "gravity direction": Explanation(
        as_fault="error",
        cause="The onboard estimator failed, or the sensor is mounted otherwise than set.",
        fault="mounting",
        means=_TILT,
        codes=("reference_contradicted",),
        beside=("ekf_failsafe", "ekf_check", "ekf_fault"),
    ),
    "gyro against attitude": Explanation(
        as_warning="note",
        as_fault="error",
        cause="A wrong scale, unit, orientation or clock of the logged gyro, or a slow or filtered attitude.",
        fault="mounting",
        means="Errors grow with every turn.",
    ),
    "attitude jumps": Explanation(
        cause="The estimator found its heading or attitude wrong and set it anew.",
        fault="compass",
        means="Before a jump the onboard attitude was wrong by about its size; jumps are cut out of comparisons.",
        codes=("lane_switch", "estimator_instance_changed"),
    ),
    "second source": Explanation(
        cause="One of these estimators has failed, or was never aligned.",
        fault="estimator",
        means="At least one of them is wrong; where the wrong one is the reference, the comparison is wrong too.",
    ),
    "field against motors": Explanation(
        cause="Currents of motors and battery bend the field at the compass.", fault="interference", means=_HEADING
    ),
    "field against attitude": Explanation(
        cause="A disturbed or badly calibrated compass, or an attitude that turns away.",
        fault="compass",
        means=_HEADING,
    ),
    "field": Explanation(
        cause="The compass is not calibrated, or iron is near.",
        fault="compass",
        means=_HEADING,
        codes=("mag_uncalibrated", "mag_raw", "mag_disabled"),
    ),
    "vibration": Explanation(
        cause="Unbalanced or damaged propellers, play in a bearing or arm, or a stiff mounting.",
        fault="vibration",
        means="Filters that trust the accelerometer are pushed about; noise in flight contains it.",
    ),
    "vertical force": Explanation(
        as_fault="error",
        cause="Vibration that clips or is rectified in the sensor becomes a constant force.",
        fault="vibration",
        means="Filters that trust the accelerometer tilt; gravity in flight is not to be trusted.",
        codes=("vibration_failsafe",),
    ),
    "accelerometer bias": Explanation(
        cause="The accelerometer is off or was calibrated on a tilted surface, or the estimator has learned wrongly.",
        fault="accelerometer",
        means="Filters that are run again see the accelerometer as logged and lean by this tilt against it.",
    ),
    "gravity in flight": Explanation(
        cause="Wrong scale, vibration that the sensor rectifies or clips, or a wrong attitude.",
        fault="accelerometer",
        means=_TILT,
    ),
    "declination": Explanation(
        as_warning="note",
        fault="declination",
        cause="A compass that does not point forward, or a heading that was not aligned with true north.",
        means="Headings of filters and of the onboard attitude differ by a constant.",
    ),
    "declination told": Explanation(
        fault="declination",
        cause="A value set by hand, or kept from another place.",
        means="Headings that use the parameter, onboard or of filters, are off by the difference.",
    ),
    "GNSS": Explanation(
        as_warning="note",
        cause="Bad view of the sky, interference, or a receiver that failed.",
        means="Filters and references that use GNSS run on without it there.",
    ),
    "gaps": Explanation(
        as_warning="note",
        cause="The logger lost records, or stops while the vehicle is disarmed.",
        means="Filters start anew after each gap longer than half a second.",
        codes=("logger_dropouts",),
    ),
    "gyro range": Explanation(
        cause="A blow or vibration beyond the sensor's range.", fault="vibration", means="Rotation is lost there."
    ),
    "jitter": Explanation(as_warning="note", cause="The logger was busy, or samples were lost.", fault="gaps"),
    "rate": Explanation(
        as_warning="note",
        as_fault="error",
        codes=("imu_low_rate", "imu_rate_too_low", "imu_decimated", "no_imu", "imu_too_short"),
    ),
    "delay": Explanation(
        as_warning="note",
        cause="Low-pass filters ahead of the logger, or a clock that differs.",
        means="All filters are late by it; lags are given without what the log tells of it.",
    ),
    "coverage": Explanation(
        as_warning="note",
        cause="The attitude was logged for a part of the time only.",
        means="Filters are compared with it for that part only.",
    ),
    "trim": Explanation(
        as_warning="note",
        cause="The level was calibrated on a slope, or the autopilot is mounted tilted.",
        fault="trim",
    ),
}
"""By the name of the check, in the order of entries that are equally bad."""
BY_ATTITUDE = ("gravity direction", "gravity in flight", "vertical force", "field against attitude", "declination")
"""What is judged by the onboard attitude: nothing of its own where that is refused, or the wrong one."""
BY_FORCE = ("gravity direction", "gravity in flight", "vertical force", "trim")
"""What holds the attitude against the accelerometer: nothing of its own where that is the wrong one."""
UNCHECKED = "What could not be checked may still be wrong."
PAUSE_S = 5.0
"""A gap this long is a pause of the logger and not lost records."""
SPECIFIC = ("mag_dead", "no_mag", "mag_not_in_log", "mag_only_offsets")
"""What a reader says of a compass that is not there says it all."""


@dataclass(frozen=True, slots=True)
class OpenQuestion:
    """A question without an answer, as its card is titled, and what would answer it (may be empty)."""

    title: str
    remedy: str = ""


def findings(
    log: FlightLog, checks: Iterable[Check], others: Iterable[Problem] = (), unanswered: Iterable[OpenQuestion] = ()
) -> list[Problem]:
    """Everything that is not ok, worst first, each once, what comes in dozens as one entry with their number.

    ``others`` are problems that the analysis itself found.
    """
    checks = list(checks)
    told = [_timed(p) for p in [*log.problems, *others]]
    for check in checks:
        if check.verdict in ("warning", "fault"):
            told = _joined(told, check, log)
    told += [Problem(FAILED, "error", c.text, means=UNCHECKED) for c in checks if c.value == FAILED]
    missing = [c for c in checks if c.verdict == "unknown" and c.value != FAILED]
    if missing:
        names = ", ".join(c.name for c in missing)
        text = f"Not checked: {names}. {missing[0].text}" if len(missing) == 1 else f"Not checked: {names}."
        told.append(Problem("not_checked", "info", text, count=1, means=UNCHECKED))
    told += _open(list(unanswered))
    told = [_explained(p, checks, log) for p in told]
    place: dict[str, int] = {}
    for i, (name, about) in enumerate(ABOUT.items()):
        place |= dict.fromkeys((_code(name), *about.codes, *about.beside), i)
    return sorted(
        many_of_a_kind.joined(_once(told)),
        key=lambda p: (ORDER.index(p.severity), place.get(p.code, len(place)), p.t or 0.0),
    )


def contradiction(reference: Reference) -> list[Problem]:
    """A reference that physics contradicts, or that had to give way to the smoother, as an entry; none otherwise."""
    taken = {"smoother": "the smoother", "onboard": "the onboard attitude"}.get(reference.kind, "")
    gave_way = [reference.refused[name] for name in ("truth", "onboard") if taken and name in reference.refused]
    if gave_way:
        means = f"Filters are compared with {taken} and not with it."
        return [Problem("reference_contradicted", "error", as_sentence(why), means=means) for why in gave_way]
    if not reference.fault:
        return []
    asked = "It was asked for as reference all the same"
    means = "It is no reference for anything" if reference.kind == "none" else asked
    sentences = [reference.fault, *(step.text for step in reference.steps if step.name == "contradiction")]
    text = " ".join(f"{sentence}." for sentence in sentences)
    return [Problem("reference_contradicted", "error", text, means=f"{means}.")]


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


def _joined(told: list[Problem], check: Check, log: FlightLog) -> list[Problem]:
    """The list with what a check says: as an entry of its own, or as a part of the one that says the same."""
    about = ABOUT.get(check.name, Explanation())
    severity = about.as_fault if check.verdict == "fault" else about.as_warning
    value = check.value if isinstance(check.value, (int, float)) else None
    means = about.means
    if unusable([check]):
        means = "Nothing below is judged: filters would show how they cope with this gyro, not how good they are."
    elif check.name == "gyro bias" and severity == "error":
        severity = "warning"
    own = Problem(
        _code(check.name),
        severity,
        check.text,
        t=check.t,
        count=check.count,
        value=value,
        unit=check.unit if value is not None else "",
        cause=about.cause,
        remedy=log.remedies.get(about.fault, "") if about.fault else _logging(check, log),
        means=means,
    )
    if check.name in BY_ATTITUDE and any(p.code == "reference_contradicted" or _wrong_one(p) for p in told):
        return told
    if check.name in BY_FORCE and any(p.code == _code(FRAME) for p in told):
        return told
    if check.name.startswith(("field", "magnetometer")) and any(p.code in SPECIFIC for p in told):
        return told
    same = [p for p in told if p.code in about.codes]
    if not same:
        return [*told, own]
    return [_merged(p, own, check.name) if p is same[0] else p for p in told if p is same[0] or p not in same]


def _wrong_one(problem: Problem) -> bool:
    """Whether this says that the onboard attitude is the wrong one."""
    return problem.code in map(_code, against_smoother.NAMES.values()) and problem.severity == "error"


def _explained(problem: Problem, checks: list[Check], log: FlightLog) -> Problem:
    """A refused reference with its cause: a mounting where it is off at rest throughout, else the estimator."""
    if problem.code != "reference_contradicted" or problem.cause:
        return problem
    throughout = any(c.name == "gravity direction" and c.verdict == "fault" for c in checks)
    cause = ABOUT["gravity direction"].cause if throughout else "The onboard estimator failed, or had not aligned."
    return replace(problem, cause=cause, remedy=log.remedies["mounting" if throughout else "estimator"])


def _merged(reported: Problem, own: Problem, name: str) -> Problem:
    """One entry of a check and of what a reader, the autopilot or the analysis said of the same."""
    if name == "rate":
        return reported
    severity = min(reported.severity, own.severity, key=ORDER.index)
    told = own.text if reported.text in own.text else f"{reported.text} {own.text}"
    first = min((t for t in (reported.t, own.t) if t is not None), default=None)
    return replace(
        own,
        code=reported.code,
        severity=severity,
        text=told,
        t=first,
        count=max(reported.count, own.count),
        cause=reported.cause or own.cause,
        remedy=reported.remedy or own.remedy,
        means=reported.means or own.means,
    )


def _open(unanswered: list[OpenQuestion]) -> list[Problem]:
    """The questions without an answer as one entry; their cards say why."""
    if not unanswered:
        return []
    titles = ", ".join(item.title.lower() for item in unanswered)
    remedies = dict.fromkeys(item.remedy for item in unanswered if item.remedy)
    return [Problem("unanswered", "note", f"Not answered: {titles}.", count=len(unanswered), remedy=" ".join(remedies))]


def _once(told: list[Problem]) -> list[Problem]:
    """Entries of the same code and sentence as one, with the sum of their counts and the first time."""
    found: dict[tuple[str, str], Problem] = {}
    for p in told:
        known = found.get((p.code, p.text))
        if known is not None:
            t = min((x for x in (p.t, known.t) if x is not None), default=None)
            p = replace(known, t=t, count=known.count + p.count)
        found[p.code, p.text] = p
    return list(found.values())


def _timed(problem: Problem) -> Problem:
    """A problem whose time is a number, or none."""
    return problem if problem.t is None or abs(problem.t) < 1e12 else replace(problem, t=None)


def _logging(check: Check, log: FlightLog) -> str:
    """The setting that would log what a check lacks."""
    imu, onboard = log.replay_imu, log.onboard_attitude
    if check.name == "rate":
        return log.advice("fast_imu", imu.gyro.rate) if imu is not None else log.advice("imu")
    if check.name == "gaps" and imu is not None:
        paused = float(np.diff(imu.gyro.t).max(initial=0.0)) >= PAUSE_S
        return log.advice("rest") if paused else log.remedies["gaps"]
    if check.name == "coverage":
        return log.advice("attitude", onboard.rate if onboard is not None else None)
    return ""


def _code(name: str) -> str:
    return name.replace(" ", "_")
