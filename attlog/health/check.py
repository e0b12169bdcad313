"""Check of a sensor or estimator: verdict, value with interval, evidence, and parameters to set."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable
from dataclasses import dataclass, field, replace
from functools import cached_property
from math import isclose
from typing import Literal, NamedTuple

import numpy as np
from numpy.typing import NDArray

from attlog.core.brief import brief
from attlog.flight.model import FlightLog, guarded_part
from attlog.reference import choose
from attlog.reference.model import Reference
from attlog.segments.model import Segments

Array = NDArray[np.float64]
Verdict = Literal["ok", "warning", "fault", "unknown"]
Weight = Literal["serious", "warning", "note", "info"]
TROUBLE = ("warning", "fault")
BUG = "part_failed"
# Relative tolerance for equal parameters, which are 32-bit floats in logs and files.
SETTING_TOLERANCE = 1e-6


@dataclass(frozen=True, slots=True)
class Setting:
    """Parameter to set. ``old``: its value when the log was flown, None where the log does not hold it."""

    name: str
    old: float | None
    new: float
    unit: str = ""


@dataclass(slots=True)
class Check:
    """Result of one check of one sensor or estimator.

    ``question``: id of a row in :data:`attlog.health.registry.CHECKS`; ``sensor``: name in the log (``MAG.0``);
    ``in_use``: False where the autopilot did not use it. ``text`` is one sentence with the number. ``value`` in
    ``unit`` has the 95 % interval ``ci95``; ``vector`` holds components
    along the body axes x, y, z, ``vector_ci95`` half the widths of their intervals. ``n`` samples in ``seconds``.
    ``t`` to ``t_end`` s: begin and end, None for the whole log; ``count``: number of events. ``about``: angle (tilt,
    heading) or case; ``kind``: kind of finding, empty for
    that of the row. ``threshold`` with its ``source``. ``settings``: parameters to set; ``why_no_setting``: reason
    for none and what to log or fly. ``other_compass``: name of the compass that the action selects.
    ``cause``: cause found in this log, empty for the usual one of the row.
    """

    question: str
    verdict: Verdict
    text: str
    value: float | None = None
    unit: str = ""
    threshold: str = ""
    t: float | None = None
    count: int = 1
    t_end: float | None = None
    about: str = ""
    kind: str = ""
    evidence: list[str] = field(default_factory=list)
    cause: str = ""
    sensor: str = ""
    in_use: bool = True
    ci95: tuple[float, float] | None = None
    vector: list[float] = field(default_factory=list)
    vector_ci95: list[float] = field(default_factory=list)
    n: int = 0
    seconds: float = 0.0
    source: str = ""
    settings: list[Setting] = field(default_factory=list)
    why_no_setting: str = ""
    action: str = ""
    other_compass: str = ""
    __repr__ = brief

    @property
    def is_trouble(self) -> bool:
        """True if the verdict is a warning or a fault."""
        return self.verdict in TROUBLE

    def measure(self, value: float, sigma: float, digits: int, least: float = -math.inf) -> Check:
        """Set value and 95 % interval, rounded; the interval begins at ``least`` or above."""
        self.value = round(value, digits)
        self.ci95 = round(max(value - 1.96 * sigma, least), digits), round(value + 1.96 * sigma, digits)
        return self

    def measure_axes(self, vector: Array, sigma: Array, digits: int) -> Check:
        """Set the components (3,) and half their 95 % intervals, rounded."""
        self.vector = [round(float(v), digits) for v in vector]
        self.vector_ci95 = [round(1.96 * float(s), digits) for s in sigma]
        return self


class Limits(NamedTuple):
    """Limits of a quantity: ok up to ``ok``, fault above ``fault``; ``floor``: error added to every sigma."""

    question: str
    unit: str
    ok: float
    fault: float
    text: str
    source: str
    floor: float = 0.0


def unknown(question: str, why: str, threshold: str = "", *, sensor: str = "", source: str = "") -> Check:
    """Return a check with verdict ``unknown`` and its reason."""
    return Check(question, "unknown", why, threshold=threshold, sensor=sensor, source=source)


def graded(value: float, ok: float, warning: float) -> Literal["ok", "warning", "fault"]:
    """Return ok up to ``ok``, warning up to ``warning``, else fault."""
    return "ok" if value <= ok else "warning" if value <= warning else "fault"


def finite(check: Check) -> Check:
    """Return the check without NaN and infinite numbers, which neither JSON nor a vehicle accepts.

    One invalid setting removes all settings, because they are valid only together.
    """
    numbers = [check.value] if check.value is not None else []
    lists = [numbers, list(check.ci95 or ()), check.vector, check.vector_ci95, [s.new for s in check.settings]]
    value, ci95, vector, vector_ci95, settings = (all(map(math.isfinite, each)) for each in lists)
    return replace(
        check,
        value=check.value if value else None,
        ci95=check.ci95 if ci95 and value else None,
        vector=check.vector if vector else [],
        vector_ci95=check.vector_ci95 if vector and vector_ci95 else [],
        settings=check.settings if settings else [],
    )


def as_sentence(reason: str) -> str:
    """Return a clause with capital and full stop; message names keep their case."""
    text = reason.rstrip(".")
    name = "_" in text.partition(" ")[0]
    return f"{text if name else text[:1].upper() + text[1:]}."


class MotionAttitude(NamedTuple):
    """Attitude by the smoother without any compass: its heading follows from motion alone.

    ``q`` (n, 4) turns vectors in the axes of the replayed IMU to north-east-down at ``t`` (n,) s; ``segment`` (n,)
    numbers the parts between gaps. ``sigma_tilt``, ``sigma_heading`` (n,) rad: 1-sigma errors, pi where the heading is
    contradicted. ``quality``: summary values.
    """

    t: Array
    q: Array
    segment: NDArray[np.int64]
    sigma_tilt: Array
    sigma_heading: Array
    quality: dict[str, float | str]


@dataclass
class HealthCase:
    """Input of every check; ``reference`` None where no IMU can be replayed.

    ``segments`` exist without an IMU too. ``smooth`` runs the smoother without a compass, at most once (``motion``).
    ``found``: checks made so far, for those that depend on others.
    """

    log: FlightLog
    segments: Segments
    reference: Reference | None = None
    smooth: Callable[[], MotionAttitude | None] = lambda: None
    found: list[Check] = field(default_factory=list)

    @cached_property
    def motion(self) -> MotionAttitude | None:
        """Attitude by motion alone; None without GNSS or flight."""
        return self.smooth()

    @cached_property
    def rates(self) -> Reference | None:
        """Reference independent of the replayed gyro: truth or onboard instead of a smoother."""
        if (self.reference is None or self.reference.kind == "smoother") and self.log.imu is not None:
            what = "The reference"
            return guarded_part(
                self.log, what, lambda: choose(self.log, self.segments, heading=False), lambda: self.reference
            )
        return self.reference

    def trouble(self, *questions: str) -> list[Check]:
        """Return warnings and faults of sensors in use, of the given or all questions."""
        return [c for c in self.found if c.is_trouble and c.in_use and (not questions or c.question in questions)]


def spare_sensors(log: FlightLog) -> set[str]:
    """Return the sources of compasses and IMUs that are not in use."""
    imu = log.imus[log.imu or 0] if log.imus else None
    used = {log.mags[log.mag].field.source} if log.mag is not None else set()
    used |= {imu.gyro.source, imu.acc.source} if imu is not None else set()
    every = {mag.field.source for mag in log.mags}
    every |= {source for imu in log.imus for source in (imu.gyro.source, imu.acc.source)}
    return every - used


def agreed_settings(checks: Iterable[Check]) -> list[Setting]:
    """Return the parameters to set, each once, in the order of the checks.

    A parameter that two checks set to different values is dropped with all settings of those checks, because offsets
    and scales are valid only together.
    """
    given = [check.settings for check in checks if check.settings]
    values: dict[str, list[float]] = {}
    for settings in given:
        for setting in settings:
            values.setdefault(setting.name, []).append(setting.new)
    disputed = {
        name for name, new in values.items() if any(not isclose(x, new[0], rel_tol=SETTING_TOLERANCE) for x in new)
    }
    found: dict[str, Setting] = {}
    for settings in given:
        if disputed.isdisjoint(setting.name for setting in settings):
            for setting in settings:
                found.setdefault(setting.name, setting)
    return list(found.values())


def number_text(value: float) -> str:
    """Format a parameter with seven digits, the precision of 32-bit floats."""
    return f"{value + 0.0:.7g}"


def settings_sentence(settings: Iterable[Setting]) -> str:
    """Return ``Set COMPASS_OFS_X 145, COMPASS_OFS_Y -20.``; empty without settings."""
    words = ", ".join(f"{setting.name} {number_text(setting.new)}" for setting in settings)
    return f"Set {words}." if words else ""
