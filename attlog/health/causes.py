"""A finding: one cause of trouble in a log, however many checks, reports and events speak of it."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Literal

import numpy as np

from attlog.flight.advice import Fault
from attlog.flight.model import FlightLog, Mag, Problem, Severity
from attlog.health import attitude
from attlog.health.check import ACCELEROMETER as check_ACCELEROMETER
from attlog.health.check import GYRO_BIAS, TOPICS, Assessment, agreed_settings, settings_sentence
from attlog.health.gravity import MEAN_GRAVITY
from attlog.reference import alignment
from attlog.reference.sensor_faults import FRAME
from attlog.story.flight_events import Event

Weight = Literal["serious", "warning", "note", "info"]
SEVERITY_ORDER: tuple[Weight, ...] = ("serious", "warning", "note", "info")
"""Worst first."""
WEIGHTS: Mapping[Severity, Weight] = {"error": "serious", "warning": "warning", "note": "note", "info": "info"}
"""Of a reader's problem."""
SEPARATE_KINDS = ("part_failed", "estimator_failed", "estimator_timed_out")
"""Kinds of which each sign has a cause of its own."""
LARGEST_LEADS = ("hard_landing", "estimator")
"""Kinds whose signs have one unit (g of a blow, s of a rejection), so that the largest leads."""


@dataclass(frozen=True, slots=True)
class Finding:
    """One cause (``kind``) in a sentence: what, how much, from when; its evidence, and one action on this vehicle.

    ``t`` to ``t_end`` s is when, or ``offset`` bytes where in the file; ``count`` how often; ``value`` in ``unit`` the
    size. ``about``: the angle (tilt, heading) or the sensor that it speaks of. ``cause`` and ``action`` are empty where
    nobody knows.
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

    @property
    def is_trouble(self) -> bool:
        """Whether it is worth a pilot's time: serious, or a warning."""
        return self.severity in ("serious", "warning")


@dataclass(frozen=True, slots=True)
class Explanation:
    """What a check that is not ok means: of which finding it is a sign, how bad, why that is, what mends it."""

    kind: str
    as_warning: Weight = "warning"
    as_fault: Weight = "warning"
    cause: str = ""
    fault: Fault | None = None


def problem_finding(problem: Problem, kind: str = "") -> Finding:
    """What a reader, the autopilot's records or the analysis found, as a sign of ``kind`` (its code where empty)."""
    return Finding(
        kind or problem.code,
        WEIGHTS[problem.severity],
        problem.text,
        t=None if problem.t is None or abs(problem.t) >= 1e12 else problem.t,
        offset=problem.offset,
        count=problem.count,
        value=problem.value,
        unit=problem.unit,
        cause=problem.cause,
        action=problem.remedy,
    )


def event_finding(event: Event, kind: str) -> Finding:
    """What happened, as a sign of ``kind``."""
    return Finding(
        kind,
        event.severity,
        event.text,
        t=event.t,
        t_end=event.t_end,
        value=event.value,
        unit=event.unit,
        evidence=list(event.evidence),
    )


def merge_kinds(signs: Iterable[Finding]) -> list[Finding]:
    """One finding for each kind, in the order of their first sign.

    The worst sign leads, the largest or the first of equals: its sentence is the finding's, others are evidence.
    """
    kinds: dict[tuple[str, str], list[Finding]] = {}
    for sign in signs:
        kinds.setdefault((sign.kind, sign.text if sign.kind in SEPARATE_KINDS else ""), []).append(sign)
    return [_merge_kind(same) for same in kinds.values()]


def _lead_rank(sign: Finding) -> tuple[int, float]:
    """The place of a sign among those of its kind: the worse, then the larger, the earlier."""
    return SEVERITY_ORDER.index(sign.severity), -(sign.value or 0.0) if sign.kind in LARGEST_LEADS else 0.0


def _merge_kind(same: list[Finding]) -> Finding:
    lead = min(same, key=_lead_rank)
    others = [sign for sign in same if sign is not lead]
    texts = [*lead.evidence, *(text for sign in others for text in (sign.text, *sign.evidence))]
    alike = [sign for sign in same if sign.text == lead.text]
    return replace(
        lead,
        count=sum(sign.count for sign in alike),
        evidence=[text for text in dict.fromkeys(texts) if text != lead.text],
        cause=next((sign.cause for sign in (lead, *others) if sign.cause), ""),
        action=next((sign.action for sign in (lead, *others) if sign.action), ""),
    )


# The onboard attitude: wrong, different from its sisters, set anew, turned against its sensors; its estimator.

ATTITUDE, RESET, MOUNTING, SIMULATOR, ESTIMATOR = "attitude", "reset", "mounting", "simulator", "estimator"
_WRONG = Explanation(
    ATTITUDE,
    as_fault="serious",
    cause="The onboard estimator was not aligned, or learned a wrong bias or a wrong field.",
)
ATTITUDE_CHECKS = {
    attitude.AGAINST_TRUTH: _WRONG,
    attitude.AGAINST_SMOOTHER: _WRONG,
    "second source": Explanation(ATTITUDE),
    "gravity direction": Explanation(
        MOUNTING,
        as_fault="serious",
        cause="The sensor is mounted otherwise than set, or the onboard estimator failed.",
        fault="mounting",
    ),
    "gyro against attitude": Explanation(
        MOUNTING,
        as_warning="note",
        as_fault="serious",
        cause="A wrong scale, unit, orientation or clock of the logged gyro, or a slow or filtered attitude.",
        fault="mounting",
    ),
    "trim": Explanation(
        "trim",
        as_warning="note",
        cause="The level was calibrated on a slope, or the autopilot is mounted tilted.",
        fault="trim",
    ),
    "attitude jumps": Explanation(RESET),
    "coverage": Explanation("coverage", as_warning="note"),
    "rejected velocity": Explanation(ESTIMATOR, cause="Bad GNSS, vibration, or a wrong attitude."),
    "rejected position": Explanation(ESTIMATOR, cause="Bad GNSS, vibration, or a wrong attitude."),
    "rejected height": Explanation(ESTIMATOR, cause="A drifting barometer or vibration."),
    "rejected airspeed": Explanation(ESTIMATOR, cause="A blocked or badly calibrated airspeed sensor."),
}
ATTITUDE_REPORTS = {
    "reference_contradicted": ATTITUDE,
    "lane_switch": RESET,
    "estimator_instance_changed": RESET,
    "ekf_check": ESTIMATOR,
    "ekf_failsafe": ESTIMATOR,
    "ekf_fault": ESTIMATOR,
}
"""What readers and autopilot say of it, by code."""
ATTITUDE_AGAINST_FORCE = ("gravity direction", MEAN_GRAVITY, "gravity in flight", "vertical force", "trim")
"""Checks of the attitude against the accelerometer."""
REPEATS_WRONG_ATTITUDE = ("gravity direction", MEAN_GRAVITY, "gravity in flight", "vertical force")
"""What only repeats that the attitude is wrong, where that is known."""
LEVEL_CAUSE = "The accelerometer was calibrated on a slope, or its offsets are wrong."
FRAMES_CAUSE = "The simulator gives sensors and attitude in different frames: no setting of a vehicle mends it."


SMALL_JUMP_DEG = 10.0
"""A smaller jump is what an estimator does every day."""
GYRO_KINDS = ("gyro", "gyro_bias", "frozen_gyro")


def settle_attitude(signs: Sequence[Finding], log: FlightLog) -> list[Finding]:
    """The signs with one cause for what has one: a broken gyro, a wrong attitude or force, a simulator's frames."""
    signs = [_weigh_sign(sign, log) for sign in signs]
    gyro = next((sign.kind for sign in signs if sign.kind in GYRO_KINDS and sign.severity == "serious"), "")
    if gyro:
        return [_as_kind(gyro, sign) if sign.kind in (ATTITUDE, MOUNTING) else sign for sign in signs]
    if any(sign.kind == ATTITUDE and sign.severity == "serious" for sign in signs):
        signs = [
            _as_kind(ATTITUDE, s) if s.about in REPEATS_WRONG_ATTITUDE and s.kind != "vibration" else s for s in signs
        ]
    if any(sign.kind == FRAME.replace(" ", "_") for sign in signs):
        signs = [sign for sign in signs if sign.about not in ATTITUDE_AGAINST_FORCE]
    if log.simulated:
        signs = [
            replace(_as_kind(SIMULATOR, s), cause=FRAMES_CAUSE) if s.kind == MOUNTING and s.is_trouble else s
            for s in signs
        ]
    return signs


def _as_kind(kind: str, sign: Finding) -> Finding:
    """A sign as one of another kind, whose cause and action it shares."""
    return replace(sign, kind=kind, cause="", action="")


def _weigh_sign(sign: Finding, log: FlightLog) -> Finding:
    """A small jump as a note; a small angle to gravity as one of the accelerometer, for mountings turn by more."""
    if sign.kind == RESET and sign.value is not None and sign.value < SMALL_JUMP_DEG:
        return replace(sign, severity="note")
    if sign.about == "gravity direction" and sign.severity == "warning":
        return replace(sign, kind="accelerometer", cause=LEVEL_CAUSE, action=log.remedies.get("accelerometer", ""))
    return sign


# Gyro, accelerometer, vibration, GNSS, and how they were recorded.

VIBRATION, GNSS, ACCELEROMETER, RATE = "vibration", "gnss", "accelerometer", "rate"
_SENSOR_STOPPED = "The sensor, its driver or its bus stopped."
SENSOR_CHECKS = {
    "gyro": Explanation("gyro", as_fault="serious", cause=_SENSOR_STOPPED),
    "gravity": Explanation(
        ACCELEROMETER,
        cause="The accelerometer is not calibrated, has the wrong range set, or vibrates.",
        fault="accelerometer",
    ),
    "frozen gyro": Explanation("frozen_gyro", as_fault="serious", cause=_SENSOR_STOPPED, fault="bus"),
    "gyro spikes": Explanation(
        "gyro_spikes",
        as_fault="serious",
        cause="Errors on the sensor's bus, or samples that leave its range.",
        fault="bus",
    ),
    "accelerometer axes": Explanation(
        "accelerometer_axes",
        as_fault="serious",
        cause="The accelerometer is mounted otherwise than set, or its axes are mixed up.",
        fault="mounting",
    ),
    "accelerometer delay": Explanation(
        "accelerometer_delay",
        as_fault="serious",
        cause="Its samples wait in a queue, or are stamped by another clock.",
        fault="bus",
    ),
    "frozen sensors": Explanation("frozen_sensors", as_fault="serious", cause=_SENSOR_STOPPED, fault="bus"),
    "gyro bias": Explanation(
        "gyro_bias",
        as_fault="serious",
        cause="The gyro was not calibrated, was moved while it started, or warms up.",
        fault="gyro_bias",
    ),
    "vertical force": Explanation(
        VIBRATION,
        as_fault="serious",
        cause="Vibration that clips or is rectified in the sensor becomes a constant force.",
        fault="vibration",
    ),
    "vibration": Explanation(
        VIBRATION,
        cause="Unbalanced or damaged propellers, play in a bearing or arm, or a stiff mounting.",
        fault="vibration",
    ),
    "accelerometer bias": Explanation(
        ACCELEROMETER,
        cause="The accelerometer is off, was calibrated on a slope, or the estimator has learned wrongly.",
        fault="accelerometer",
    ),
    "gravity in flight": Explanation(
        ACCELEROMETER,
        cause="Wrong scale, vibration that the sensor rectifies or clips, or a wrong attitude.",
        fault="accelerometer",
    ),
    "gyro range": Explanation("gyro_range", cause="A blow or vibration beyond the sensor's range."),
    "GNSS": Explanation(GNSS, cause="Bad view of the sky, interference, or a receiver that failed.", fault="gnss"),
    "imu delay": Explanation(
        "imu_delay",
        as_fault="serious",
        cause="Samples are stamped when published, wait in a queue, or pass a filter that no parameter shows.",
        fault="clock",
    ),
    "gyro scale": Explanation(
        "gyro_scale",
        as_fault="serious",
        cause="The gyro's own scale or its range setting; no calibration corrects it.",
        fault="gyro_scale",
    ),
    "gyro bias step": Explanation(
        "gyro_bias", cause="The gyro warmed up or was struck, or its driver lost its calibration.", fault="gyro_scale"
    ),
    "force axes": Explanation(
        "accelerometer_axes",
        as_fault="serious",
        cause="The accelerometer is mounted otherwise than set, or its axes are mixed up.",
        fault="mounting",
    ),
    "force offset": Explanation(
        ACCELEROMETER,
        cause="The accelerometer was not calibrated, or on a slope or at another temperature.",
        fault="accelerometer",
    ),
    "gaps": Explanation("gaps", cause="The logger lost records: card or link are too slow.", fault="gaps"),
    "jitter": Explanation("jitter", as_warning="note", as_fault="note", cause="The logger was busy.", fault="gaps"),
    "rate": Explanation("rate", as_warning="note", as_fault="serious"),
    "delay": Explanation("delay", as_warning="note", cause="Low-pass filters ahead of the logger, or another clock."),
}
SENSOR_REPORTS = {
    "vibration_failsafe": VIBRATION,
    "gyro_clipped": "gyro_range",
    "gnss_glitch": GNSS,
    "err_7_1": GNSS,
    "err_31_1": GNSS,
    "ev_19": GNSS,
    "logger_dropouts": "gaps",
    "imu_low_rate": RATE,
    "imu_rate_too_low": RATE,
    "no_imu": RATE,
    "imu_too_short": RATE,
}
"""What readers and autopilot say of them, by code."""
SHAKEN_KINDS = ("imu_switched", "sensor_switch", "attitude", ESTIMATOR)
"""Kinds that vibration explains where they begin with it."""
LOGGER_STOPPED = "The logger stopped and went on later: no card loses seconds."
BEFORE_ONSET_S = 1.0


def explain_vibration(sign: Finding, remedies: Mapping[Fault, str]) -> Finding:
    """A sign with the cause and the action of strong vibration where it is an event of that."""
    if sign.about != "vibration":
        return sign
    return replace(sign, cause=SENSOR_CHECKS["vibration"].cause, action=remedies.get("vibration", ""))


def settle_vibration(signs: Sequence[Finding]) -> list[Finding]:
    """The signs with what vibration explains under it: a force that is off, switches and rejections from then on."""
    signs = [replace(s, cause=LOGGER_STOPPED, action="") if s.about == "stopped" else s for s in signs]
    shaken = [s for s in signs if s.kind == VIBRATION and s.is_trouble and s.about != "vertical force"]
    if not shaken:
        return list(signs)
    strong = any(s.about == "clipping" or s.severity == "serious" for s in shaken)
    onset = min((s.t for s in shaken if s.t is not None), default=None)
    signs = [_explain_by_vibration(sign, onset, strong) for sign in signs]
    own = {"clipping": 0, "vertical force": 1, "vibration": 1, "vibration_level": 1}
    return sorted(signs, key=lambda sign: own.get(sign.about, 2))


def _explain_by_vibration(sign: Finding, onset: float | None, strong: bool) -> Finding:
    begins_with_it = sign.t is not None and onset is not None and sign.t >= onset - BEFORE_ONSET_S
    if sign.severity == "serious":
        return sign
    if sign.about in ("gravity in flight", MEAN_GRAVITY) or (strong and sign.kind in SHAKEN_KINDS and begins_with_it):
        return replace(sign, kind=VIBRATION, cause="", action="")
    return sign


# One entry per compass: size, direction, declination, motors, rejections, realignments and texts are its evidence.

COMPASS = "compass"
COMPASS_CHECKS = {
    attitude.HEADING_BY_GNSS: Explanation(
        COMPASS,
        as_fault="serious",
        cause="The compass is turned, badly calibrated or disturbed, or the declination is wrong.",
        fault="compass",
    ),
    "compass axes": Explanation(
        COMPASS,
        as_fault="serious",
        cause="The compass is mounted otherwise than set, or its axes are mixed up.",
        fault="compass_mounting",
    ),
    "compass turn": Explanation(
        COMPASS,
        as_fault="serious",
        cause="The compass is mounted turned against what is set, or the attitude's heading is off.",
        fault="compass_mounting",
    ),
    "compass offset": Explanation(
        COMPASS, cause="Iron or a current near the compass that its calibration does not know.", fault="compass"
    ),
    "field": Explanation(COMPASS, cause="The compass is not calibrated, or iron is near.", fault="compass"),
    "field against motors": Explanation(
        COMPASS, cause="Currents of motors and battery bend the field at the compass.", fault="interference"
    ),
    "field against attitude": Explanation(
        COMPASS, cause="A disturbed or badly calibrated compass, or an attitude that turns away.", fault="compass"
    ),
    "rejected compass": Explanation(
        COMPASS, cause="A disturbed or badly calibrated compass, or a wrong heading.", fault="compass"
    ),
    "declination": Explanation(
        COMPASS,
        as_warning="note",
        cause="The compass does not point forward, or the heading is not of true north.",
        fault="compass",
    ),
    "declination set": Explanation(
        "declination", cause="A value set by hand, or kept from another place.", fault="declination"
    ),
}
"""By the name of the check, the one that leads among equals first."""
COMPASS_REPORTS = {
    "mag_spikes": COMPASS,
    "mag_uncalibrated": COMPASS,
    "err_3_1": COMPASS,
    "err_3_4": COMPASS,
    "compass_switch": COMPASS,
}
"""What readers and autopilot say of it, by code."""
ONLY_OFFSETS = "mag_only_offsets"
MISSING_COMPASS = ("mag_dead", "no_mag", "mag_not_in_log", ONLY_OFFSETS)
"""What a reader says of a compass that is not there says it all."""
DEAD_COMPASS = Explanation("mag_dead", cause="Its wiring, its bus or the compass itself.", fault="compass_wiring")
"""Of a compass that measures no field."""
ATTITUDE_KIND, HEADING_KINDS = "attitude", ("realigned", "reset", "attitude")
"""Kinds that are of the compass where they speak of heading and the compass is in doubt."""
LOST_HEADING = "The onboard estimator was not aligned, or drifted without a compass."
CHECKS_BY_FIELD = ("compass axes", "field", "field against motors")
BENT_PCT = 30.0
COMPASS_LEADS = (
    attitude.HEADING_BY_GNSS,
    "compass axes",
    "compass turn",
    "compass_motors",
    "compass offset",
    *CHECKS_BY_FIELD[1:],
    "field against attitude",
    "compass_offset",
    "innovations",
    "declination",
)
"""Checks of the compass alone, and what tells most of it first."""
CHECKS_BY_ATTITUDE = ("field against attitude", "declination", "compass turn", "compass offset")
"""Checks that turn the field by the onboard attitude."""


def settle_compass(signs: Sequence[Finding]) -> list[Finding]:
    """The signs with those of heading under the compass where it is in doubt itself.

    A heading that jumps or differs while the field is wrong has the same cause, and nobody who believed that field
    can tell whose heading is wrong.
    """
    signs = _by_gnss(_without_dead(signs))
    if any(sign.kind in MISSING_COMPASS and sign.is_trouble for sign in signs):
        signs = [sign for sign in signs if sign.kind != COMPASS]
    if any(sign.kind == COMPASS and sign.about in CHECKS_BY_FIELD and sign.is_trouble for sign in signs):
        signs = [replace(s, severity="warning") if _accuses_heading(s) else s for s in signs]
    if any(sign.kind == ATTITUDE_KIND and sign.severity == "serious" for sign in signs):
        signs = [sign for sign in signs if not (sign.kind == COMPASS and sign.about in CHECKS_BY_ATTITUDE)]
    if not any(sign.kind == COMPASS and sign.is_trouble for sign in signs):
        return list(signs)
    own = [replace(sign, kind=COMPASS) if _is_of_heading(sign) else sign for sign in signs]
    return sorted(own, key=_compass_place)


def _without_dead(signs: Sequence[Finding]) -> list[Finding]:
    """The signs without "all its values are zero" of a compass whose values are its offsets, and were left out."""
    dead = {_sign_source(sign): sign for sign in signs if sign.kind == DEAD_COMPASS.kind}
    left = {_sign_source(sign) for sign in signs if sign.kind == ONLY_OFFSETS}
    return [
        replace(sign, cause=dead[_sign_source(sign)].cause, action=dead[_sign_source(sign)].action)
        if sign.kind == ONLY_OFFSETS and _sign_source(sign) in dead
        else sign
        for sign in signs
        if not (sign.kind == DEAD_COMPASS.kind and _sign_source(sign) in left)
    ]


def _sign_source(sign: Finding) -> str:
    """The sensor that a sentence begins with."""
    return sign.text.partition(":")[0]


def _by_gnss(signs: Sequence[Finding]) -> list[Finding]:
    """The signs with what says that the heading is wrong under the compass too, where GNSS shows that it is.

    GNSS believed no field: nobody has to doubt it. What the field shows tells the cause better. Without a compass it
    is the attitude's.
    """
    gnss = [sign for sign in signs if sign.about == attitude.HEADING_BY_GNSS and sign.is_trouble]
    if not gnss:
        return list(signs)
    if any(sign.kind in MISSING_COMPASS and sign.is_trouble for sign in signs):
        return [
            replace(sign, kind=ATTITUDE_KIND, about="heading", cause=LOST_HEADING, action="") if sign in gnss else sign
            for sign in signs
        ]
    others = [sign for sign in signs if sign.kind == COMPASS and sign.is_trouble and sign not in gnss and sign.action]
    if others:
        signs = [replace(sign, cause="", action="") if sign in gnss else sign for sign in signs]
    return [_under_compass(sign) if sign.kind in HEADING_KINDS and sign.about == "heading" else sign for sign in signs]


def _under_compass(sign: Finding) -> Finding:
    return replace(sign, kind=COMPASS, cause="", action="")


def _compass_place(sign: Finding) -> int:
    """What tells most of a compass first: motors that bend it by a third, else its size."""
    if sign.about == "field against motors" and sign.value is not None and sign.value > BENT_PCT:
        return 0
    return COMPASS_LEADS.index(sign.about) if sign.about in COMPASS_LEADS else len(COMPASS_LEADS)


def _is_of_heading(sign: Finding) -> bool:
    return sign.kind in HEADING_KINDS and sign.about == "heading" and sign.severity != "serious"


def _accuses_heading(sign: Finding) -> bool:
    return sign.kind == ATTITUDE_KIND and sign.about == "heading" and sign.severity == "serious"


# What do the assessments of sensors add to the findings? A cause that no check told, and what should be set.

TROUBLE = ("warning", "fault")
"""Verdicts of which a finding is made: what is unknown is none."""
SURER_KINDS = ("compass",)
"""Kinds whose assessments know more of the cause than checks: a calibration mends no field of motors. What they say is
to be done wins also without values to set."""
RATE_UNIT = "deg/s"
"""IMUs that differ by a rate differ in their gyros."""
QUESTION_CAUSES = {
    "compass_motors": COMPASS_CHECKS["field against motors"].cause,
    "compass_offset": COMPASS_CHECKS["compass offset"].cause,
    "compass_choice": "The compass in use is disturbed or badly calibrated; another one is not.",
}
"""Why a compass is wrong, by the question that says what to do about it."""


@dataclass(frozen=True, slots=True)
class Advice:
    """What should be done for a kind of finding, and the cause that it mends (empty: that of the checks)."""

    action: str
    cause: str = ""


def add_assessments(
    signs: Iterable[Finding], health: Iterable[Assessment], others: Sequence[Assessment] = ()
) -> list[Finding]:
    """The signs, and one for each assessment that is not ok and whose kind no check has called trouble.

    Where a check has, its sentence stands, and assessments that are surer of the cause are its evidence. ``others``:
    assessments of sensors that are not in use, which are notes.
    """
    told = list(signs)
    known = {sign.kind for sign in told if sign.is_trouble}
    mine = [_assessment_sign(a) for a in troubles(health)]
    told += [sign for sign in mine if sign.kind not in known or sign.kind in SURER_KINDS]
    known |= {sign.kind for sign in mine}
    spare = [_assessment_sign(a, "note") for a in troubles(others)]
    return told + [sign for sign in spare if sign.kind not in known]


def assessment_kind(assessment: Assessment) -> str:
    """The kind of finding that an assessment belongs to."""
    kind = TOPICS[assessment.question].finding
    return GYRO_BIAS if kind == check_ACCELEROMETER and assessment.unit == RATE_UNIT else kind


def troubles(health: Iterable[Assessment]) -> list[Assessment]:
    """The assessments that are faults or warnings: first those with something to set, so that a finding's sentence and
    its action are of one sensor, then faults."""
    found = [a for a in health if a.verdict in TROUBLE and a.question in TOPICS]
    return sorted(found, key=lambda a: (not a.settings, -TROUBLE.index(a.verdict)))


def settings_advice(health: Sequence[Assessment]) -> dict[str, Advice]:
    """What should be set, or done, for each kind of finding; values that questions dispute are left out."""
    agreed = {setting.name for setting in agreed_settings(health)}
    to_set: dict[str, dict[str, str]] = {}
    to_do: dict[str, Advice] = {}
    for found in troubles(health):
        kind = assessment_kind(found)
        if found.settings and all(setting.name in agreed for setting in found.settings):
            to_set.setdefault(kind, {})[_settings_text(found)] = QUESTION_CAUSES.get(found.question, "")
        elif found.action and kind in SURER_KINDS:
            to_do.setdefault(kind, Advice(found.action, QUESTION_CAUSES.get(found.question, "")))
    return to_do | {kind: Advice(" ".join(told), next(iter(told.values()))) for kind, told in to_set.items()}


def _settings_text(found: Assessment) -> str:
    """The question's own words where they name each parameter, such as a suggestion; else what to set."""
    named = found.action and all(setting.name in found.action for setting in found.settings)
    return found.action if named else settings_sentence(found.settings)


def without_harmless(sign: Finding, answer: Assessment | None) -> Finding:
    """The sign of a check, without cause and action where its answer knows none: motors that turn no heading."""
    return replace(sign, cause="", action="") if answer is not None and _is_harmless(answer) else sign


def _is_harmless(found: Assessment) -> bool:
    return found.question == "compass_motors" and not (found.action or found.settings)


def _assessment_sign(assessment: Assessment, severity: Weight = "warning") -> Finding:
    """An assessment as a sign of its kind of finding. A fault is a warning, as that of a check of a sensor: what is
    serious is an attitude that it made wrong, which another check shows."""
    return Finding(
        assessment_kind(assessment),
        severity,
        assessment.text,
        t=assessment.t,
        value=assessment.value,
        unit=assessment.unit if assessment.value is not None else "",
        about=assessment.question,
        evidence=list(assessment.evidence),
        cause="" if _is_harmless(assessment) else QUESTION_CAUSES.get(assessment.question, ""),
        action=_settings_text(assessment) or assessment.action or assessment.why_no_setting,
    )


# One action on this vehicle for each finding, with its parameters where the log holds them; none twice.

CLOSE_SHARE, STEADY_SHARE = 0.1, 0.1
"""A compass that reads the earth's field to this share, and varies by so little, is sound."""
OFF_SHARE = 0.2
"""One that is off by more, while another is sound, is not to be used."""


def choose_actions(
    findings: Sequence[Finding], log: FlightLog, advice: Mapping[str, Advice] = {}, *, chosen: bool = False
) -> list[Finding]:
    """The findings, worst first, with the actions that this vehicle can take; what stands above is not said again.

    ``advice``: by the kind of finding, what the assessments of its sensors say is to be done, and why; it wins.
    ``chosen``: whether they tell which compass to use; only where they do not, the size of the fields does.
    """
    taken: set[str] = set()
    found = []
    for finding in findings:
        action, cause = finding.action, finding.cause
        if finding.is_trouble and finding.kind in advice:
            action, cause = advice[finding.kind].action, advice[finding.kind].cause or cause
        elif finding.kind == COMPASS and finding.is_trouble and not chosen:
            action = other_compass(log) or action
        found.append(replace(finding, cause=cause, action="" if action in taken else action))
        taken.add(action)
    return found


def other_compass(log: FlightLog) -> str:
    """The advice to use another compass that reads the earth's field while the one in use does not; empty without."""
    model = alignment.earth_field(log)
    if model is None or log.mag is None:
        return ""
    earth = model.strength_t
    sizes = {k: _field_size(mag.field.x) for k, mag in enumerate(log.mags)}
    own, _ = sizes[log.mag]
    sound = [
        k for k, (size, spread) in sizes.items() if abs(size / earth - 1) <= CLOSE_SHARE and spread <= STEADY_SHARE
    ]
    if abs(own / earth - 1) <= OFF_SHARE or not sound or log.mag in sound:
        return ""
    other, used = log.mags[sound[0]], log.mags[log.mag]
    reads = f"{other.field.source} instead, which reads {1e6 * sizes[sound[0]][0]:.1f} uT"
    if not was_calibrated(other):
        return f"Calibrate and use {reads}."
    changes = [f"{name} {now:g}" for name, now in switch_parameters(log, other, used).items()]
    return f"Use {reads}: set {' and '.join(changes)}." if changes else f"Use {reads}."


def was_calibrated(mag: Mag) -> bool:
    """Whether a compass ever was: a firmware that applies offsets of zero refuses to arm with it."""
    return mag.calibrated and (mag.offsets is None or len(mag.offsets.x) == 0 or bool(mag.offsets.x.any()))


def switch_parameters(log: FlightLog, other: Mag, used: Mag) -> dict[str, float]:
    """What uses one compass instead of another, of what changes; empty where the log does not hold both switches.

    An estimator that starts with the first one (``FlightLog.compass_first``) has none if that is only switched off.
    """
    names = [log.compass_switches.get(mag.index, "") for mag in (other, used)]
    if not all(names):
        return {}
    wanted = dict(zip(names, (1.0, 0.0), strict=True))
    if log.compass_first:
        wanted[log.compass_first] = float(other.index)
    return {name: value for name, value in wanted.items() if log.param(name) != value}


def _field_size(field: np.ndarray) -> tuple[float, float]:
    """Median size (T) of a field (n, 3), and its standard deviation as a share of it."""
    norm = np.sqrt(np.nansum(field**2, axis=1))
    norm = norm[norm > 0]
    if not len(norm):
        return 0.0, np.inf
    return float(np.median(norm)), float(np.std(norm) / np.median(norm))
