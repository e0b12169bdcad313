"""Does each compass show the earth's field, before and after, and does it follow the motors? Arrays of the question."""

from __future__ import annotations

from typing import TypeVar

import numpy as np

from attlog.base import rotation
from attlog.health.assessments import compass
from attlog.health.assessments.compass import FieldHistory, Interference
from attlog.health.assessments.model import Assessment, HealthCase
from attlog.health.figures.samples import broken, end_of, flown
from attlog.health.sensors.interference import LEAST_AMPERE, LEAST_THROTTLE
from attlog.metrics.figures.trace import Trace

T = TypeVar("T", FieldHistory, Interference)
AXES = ("x", "y", "z")
FEWEST, FEWEST_POINTS = 10, 50
LEAST = {"current": (1.0, LEAST_AMPERE), "throttle": (100.0, LEAST_THROTTLE)}
"""By drive: from its own unit to A or %, and the range in its own unit that shows anything."""


def field(case: HealthCase, found: list[Assessment]) -> list[Trace]:
    """The field of every compass over the flight, the one in use first; nothing without a place or an attitude.

    ``found``: what the questions answered; only an offset that they offer is drawn as a correction.
    """
    offered = {a.sensor for a in found if a.question == "compass_offset" and a.settings}
    histories = _in_use_first(case, compass.field_against_expected(case))
    drawn = (_of_history(one, one.source in offered, end_of(case.segments)) for one in histories)
    return [trace for trace in drawn if trace is not None]


def interference(case: HealthCase) -> list[Trace]:
    """Points and line of the compass in use; nothing where the drive does not vary in flight."""
    for one in _in_use_first(case, compass.interference(case))[:1]:
        scale, least = LEAST[one.kind]
        if len(one.power) >= FEWEST_POINTS and np.ptp(np.quantile(one.power, [0.05, 0.95])) >= least:
            seconds = sum(b - a for a, b in flown(case.segments))
            return [of_points(one.kind, scale * one.power, one.excess, seconds)]
    return []


def of_points(key: str, power: np.ndarray, residual: np.ndarray, seconds: float) -> Trace:
    """The trace of residuals (n,) uT against a drive (n,) in A or %, with the line of least squares."""
    slope, start = np.polyfit(power, residual, 1)
    spread = float(np.std(power) * np.std(residual))
    r = float(np.mean((power - power.mean()) * (residual - residual.mean()))) / spread if spread > 0 else 0.0
    values = {"slope": float(slope), "start": float(start), "r": r, "seconds": seconds}
    return Trace("interference", "", power, {"residual": residual}, key, values=values)


def _in_use_first(case: HealthCase, each: list[T]) -> list[T]:
    log = case.log
    used = "" if log.mag is None else log.mags[log.mag].field.source
    return sorted(each, key=lambda one: one.source != used)


def _of_history(one: FieldHistory, offered: bool, end: float) -> Trace | None:
    """The trace of one compass up to ``end`` s; None where hardly any sample has an attitude."""
    use = (one.t < end) & rotation.finite(one.expected)
    if np.count_nonzero(use) < FEWEST:
        return None
    t = one.t[use]
    parts = {"": one.measured, "expected_": one.expected}
    if one.corrected is not None and offered:
        parts["corrected_"] = one.corrected
    columns = {
        f"{name}{axis}": column
        for name, part in parts.items()
        for axis, column in zip(AXES, broken(t, part[use]).T, strict=True)
    }
    return Trace("compass", "", t, columns, one.source, values={"by_motion": float(one.by == "motion")})
