"""What the audit says: checks with verdicts, and which questions a log can answer."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property
from math import isclose
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from attlog.flight.model import FlightLog
from attlog.reference.model import Reference
from attlog.segments.model import Segments

__all__ = [
    "TOPICS",
    "Assessment",
    "HealthCase",
    "MotionAttitude",
    "SensorQuestion",
    "Setting",
    "Verdict",
    "agreed_settings",
    "unknown",
]


@dataclass(slots=True)
class Check:
    """One physics check of the log: ``verdict`` is ok, warning, fault or unknown.

    ``t`` s is where it begins and ``t_end`` s where it ends, None for all of the log; ``count`` how often it happens.
    ``about``: the angle (tilt, heading) or the sensor that it speaks of, where not of what its name says.
    ``evidence``: further sentences with numbers. ``cause`` where this log tells it, empty where it is the usual one.
    ``ci95``: the 95 % interval of ``value`` where one is known, by so many ``samples`` in ``seconds``.
    """

    name: str
    verdict: str
    text: str
    value: int | float | str | None = None
    unit: str = ""
    threshold: str = ""
    t: float | None = None
    count: int = 1
    t_end: float | None = None
    about: str = ""
    evidence: list[str] = field(default_factory=list)
    cause: str = ""
    ci95: tuple[float, float] | None = None
    samples: int = 0
    seconds: float = 0.0


@dataclass(frozen=True, slots=True)
class Answerable:
    """Whether one of the four questions (accuracy, noise, lag, yaw_drift) can be answered from this log.

    ``reason`` is a sentence with the numbers; ``setting`` names what would log what is
    missing, for the firmware that flew, empty where nothing is missing.
    """

    question: str
    can: bool
    reason: str
    setting: str = ""


def graded(value: float, ok: float, warning: float) -> Literal["ok", "warning", "fault"]:
    """The verdict of a size: ok up to ``ok``, warning up to ``warning``, else fault."""
    return "ok" if value <= ok else "warning" if value <= warning else "fault"


FAILED = "part_failed"
"""The value of a check that ended in a bug."""


def failed_check(name: str, sentence: str) -> list[Check]:
    """A check that ended in a bug, with the sentence that says so."""
    return [Check(name, "unknown", sentence, value=FAILED)]


def not_judged(name: str, why: str, threshold: str = "") -> Check:
    """A check that cannot be made, with the reason."""
    return Check(name, "unknown", why, threshold=threshold)


# A reason, written as a part of a sentence, as a sentence of its own.


def as_sentence(reason: str) -> str:
    """With a capital and a full stop; a message's name at its beginning stays as the log writes it."""
    text = reason.rstrip(".")
    name = "_" in text.partition(" ")[0]
    return f"{text if name else text[:1].upper() + text[1:]}."


# What one question about a sensor found: a verdict with its number, and what should be set.

Array = NDArray[np.float64]
Verdict = Literal["ok", "warning", "fault", "unknown"]


@dataclass(frozen=True, slots=True)
class Setting:
    """A parameter to set. ``old`` is its value when the log was flown, None where the log does not hold it."""

    name: str
    old: float | None
    new: float
    unit: str = ""


@dataclass(slots=True)
class Assessment:
    """One question about one sensor, answered.

    ``sensor``: which one, as the log calls it (``MAG.0``); ``question``: an id (``compass_offset``). ``text`` is one
    sentence with the number. ``value`` in ``unit`` with its 95 % interval ``ci95``; ``vector`` its components along the
    body's axes x, y, z where it has any, ``vector_ci95`` half the width of their intervals. ``n`` samples or blocks in
    ``seconds``. ``threshold`` with its ``source``. ``settings``: what to set; ``why_no_setting``: why there is nothing
    to set although something is off, and what to log or fly for it. ``evidence``: further sentences with numbers.
    """

    sensor: str
    question: str
    verdict: Verdict
    text: str
    value: float | None = None
    unit: str = ""
    ci95: tuple[float, float] | None = None
    vector: list[float] = field(default_factory=list)
    vector_ci95: list[float] = field(default_factory=list)
    n: int = 0
    seconds: float = 0.0
    t: float | None = None
    threshold: str = ""
    source: str = ""
    settings: list[Setting] = field(default_factory=list)
    why_no_setting: str = ""
    action: str = ""
    evidence: list[str] = field(default_factory=list)


def finite(found: Assessment) -> Assessment:
    """The assessment without numbers that are none: JSON holds no NaN, and a vehicle takes none.

    With one value to set that is none all of them go, because they only fit together.
    """
    numbers = [found.value] if found.value is not None else []
    lists = [numbers, list(found.ci95 or ()), found.vector, found.vector_ci95, [s.new for s in found.settings]]
    value, ci95, vector, vector_ci95, settings = (all(map(math.isfinite, each)) for each in lists)
    return replace(
        found,
        value=found.value if value else None,
        ci95=found.ci95 if ci95 and value else None,
        vector=found.vector if vector else [],
        vector_ci95=found.vector_ci95 if vector and vector_ci95 else [],
        settings=found.settings if settings else [],
    )


@dataclass(frozen=True, slots=True)
class MotionAttitude:
    """The smoother without any compass: its heading is that of motion alone.

    ``q`` (n, 4) turns vectors in the axes of the replayed IMU to north-east-down at ``t`` (n,) s; ``segment`` (n,)
    numbers what is between gaps. ``sigma_tilt``, ``sigma_heading`` (n,) rad: what the run says of itself, of the
    heading also where it is too unsure for a reference of attitudes; pi where something contradicts it. ``quality``:
    the same in single numbers.
    """

    t: Array
    q: Array
    segment: NDArray[np.int64]
    sigma_tilt: Array
    sigma_heading: Array
    quality: dict[str, float | str]


@dataclass
class HealthCase:
    """What every question may look at. ``reference`` and ``checks`` are those of the analysis.

    ``segments`` are there without an IMU too, as far as arming, position and attitudes tell them; ``reference`` is None
    where no IMU can be replayed. ``smooth`` runs the smoother without a compass, at most once (``motion``).
    """

    log: FlightLog
    segments: Segments
    reference: Reference | None
    checks: list[Check]
    smooth: Callable[[], MotionAttitude | None]

    @cached_property
    def motion(self) -> MotionAttitude | None:
        """The attitude by motion alone, None where there is none: no GNSS, no flight, too long a log."""
        return self.smooth()


def unknown(sensor: str, question: str, why: str, threshold: str = "", source: str = "") -> Assessment:
    """A question that this log cannot answer, with the reason and what would answer it."""
    return Assessment(sensor, question, "unknown", why, threshold=threshold, source=source)


# Which questions about sensors are there? Each id once: its words, and the finding that it belongs to.
#
# Tables, gates and findings take their words and names from here, so that a new question needs its line and no more.


@dataclass(frozen=True, slots=True)
class SensorQuestion:
    """``title`` in words; ``finding``: the kind of finding (``attlog.health.findings``) that a warning belongs to."""

    title: str
    finding: str


COMPASS, ACCELEROMETER, GYRO_BIAS, VIBRATION, GNSS, ESTIMATOR = (
    "compass",
    "accelerometer",
    "gyro_bias",
    "vibration",
    "gnss",
    "estimator",
)
TOPICS: Mapping[str, SensorQuestion] = {
    "compass_offset": SensorQuestion("compass offset", COMPASS),
    "compass_motors": SensorQuestion("compass and motor current", COMPASS),
    "soft_iron": SensorQuestion("compass soft iron", COMPASS),
    "compass_choice": SensorQuestion("compass in use", COMPASS),
    "accelerometer_offset": SensorQuestion("accelerometer offset", ACCELEROMETER),
    "accelerometer_rest": SensorQuestion("gravity at rest", ACCELEROMETER),
    "accelerometer_temperature": SensorQuestion("accelerometer and temperature", ACCELEROMETER),
    "imu_instances": SensorQuestion("IMUs against each other", ACCELEROMETER),
    "gyro_bias": SensorQuestion("gyro bias", GYRO_BIAS),
    "gyro_bias_step": SensorQuestion("step of the gyro bias", GYRO_BIAS),
    "gyro_temperature": SensorQuestion("gyro bias and temperature", GYRO_BIAS),
    "gyro_scale": SensorQuestion("gyro scale", "gyro_scale"),
    "vibration_level": SensorQuestion("vibration", VIBRATION),
    "clipping": SensorQuestion("clipping", VIBRATION),
    "gyro_spectrum": SensorQuestion("gyro spectrum", VIBRATION),
    "notch": SensorQuestion("notch filter", VIBRATION),
    "gnss_delay": SensorQuestion("GNSS delay", ESTIMATOR),
    "magnetometer_delay": SensorQuestion("magnetometer delay", ESTIMATOR),
    "barometer_delay": SensorQuestion("barometer delay", ESTIMATOR),
    "imu_delay": SensorQuestion("IMU delay", "imu_delay"),
    "innovations": SensorQuestion("test ratios", ESTIMATOR),
    "lanes": SensorQuestion("estimator lane in use", ESTIMATOR),
    "gnss_quality": SensorQuestion("GNSS quality", GNSS),
    "gnss_jumps": SensorQuestion("GNSS jumps", GNSS),
    "gnss_interference": SensorQuestion("GNSS interference", GNSS),
    "barometer_noise": SensorQuestion("barometer noise", ESTIMATOR),
}
"""By question id, in the order of tables."""


# What should be set, all questions about a log together? Each parameter once, and none that two questions dispute.

SETTING_TOLERANCE = 1e-6
"""Values that differ by this share are equal: logs and files hold parameters as 32 bit floating point."""


def agreed_settings(assessments: Iterable[Assessment]) -> list[Setting]:
    """The parameters to set, in the order of the questions.

    One that two questions would set to different values is left out: one of them is wrong. So are all others of those
    questions, because offsets and scales only fit together.
    """
    given = [assessment.settings for assessment in assessments if assessment.settings]
    values: dict[str, list[float]] = {}
    for settings in given:
        for setting in settings:
            values.setdefault(setting.name, []).append(setting.new)
    disputed = {
        name for name, new in values.items() if any(not isclose(x, new[0], rel_tol=SETTING_TOLERANCE) for x in new)
    }
    agreed = [settings for settings in given if disputed.isdisjoint(setting.name for setting in settings)]
    found: dict[str, Setting] = {}
    for settings in agreed:
        for setting in settings:
            found.setdefault(setting.name, setting)
    return list(found.values())


def number_text(value: float) -> str:
    """A parameter's value as a ground station takes it: seven digits, as many as 32 bit floating point holds."""
    return f"{value + 0.0:.7g}"


def settings_sentence(settings: Iterable[Setting]) -> str:
    """What to set as one sentence, empty without: ``Set COMPASS_OFS_X 145, COMPASS_OFS_Y -20.``"""
    words = ", ".join(f"{setting.name} {number_text(setting.new)}" for setting in settings)
    return f"Set {words}." if words else ""


# Can these sensors be trusted, and what should be set? One file per question; each answers with assessments.
