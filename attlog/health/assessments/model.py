"""What one question about a sensor found: a verdict with its number, and what should be set."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from attlog.flight.model import FlightLog
from attlog.health.model import Check
from attlog.reference.model import Reference
from attlog.segments.model import Segments

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
