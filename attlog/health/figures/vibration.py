"""How strongly does it vibrate in flight, what was clipped, how fast are rotors, and where are notches?"""

from __future__ import annotations

import math
from typing import cast

import numpy as np

from attlog.flight.model import Array
from attlog.health.assessments import vibration
from attlog.health.assessments.model import HealthCase
from attlog.health.figures.samples import MOST, broken, flown
from attlog.metrics.figures.trace import Trace
from attlog.segments.spans import inside
from attlog.story.sensors import driven

FEWEST = 10
SECOND = 1.0
HARMONICS = 3
"""Of the rotors' speed: one blade out of balance, two blades, their next."""
TURNING_RPM = 300.0
"""Slower is starting or stopping."""


def levels(case: HealthCase) -> list[Trace]:
    """The level of each IMU in flight by the firmware's own measure, second by second, with its percentiles."""
    found = []
    for one in vibration.levels(case):
        t, level, fault = np.asarray(one["t"]), np.asarray(one["level"]), one["fault"]
        limits = (float(str(one["warning"])), math.nan if fault is None else float(str(fault)))
        if len(t) >= FEWEST:
            found.append(of_arrays(str(one["source"]), t, level, *limits))
    return found


def of_arrays(source: str, t: Array, level: Array, limit: float, fault: float) -> Trace:
    """The trace of levels (n,) m/s^2 with their percentiles, and the firmware's limits (m/s^2, NaN: none)."""
    p50, p80 = np.quantile(level, [0.5, 0.8])
    values = {"p50": float(p50), "p80": float(p80), "worst": float(level.max()), "limit": limit}
    values |= {"fault": fault} if math.isfinite(fault) else {}
    return Trace("levels", "", t, {"level": broken(t, level)}, source, values=values)


def clipping(case: HealthCase) -> list[Trace]:
    """Samples that the vehicle counted as clipped, of the unit that clipped most, while it flew or was driven."""
    within = [] if case.segments is None else driven(case.segments)
    found: list[Trace] = []
    for one in case.log.clippings:
        mine = inside(one.t, within) & (one.new > 0)
        if one.sensor == "accelerometer" and mine.any():
            second, place = np.unique(np.floor(one.t[mine] / SECOND), return_inverse=True)
            samples = np.bincount(place, one.new[mine].astype(np.float64)).astype(np.float64)
            kept = np.sort(np.argsort(-samples, kind="stable")[:MOST])
            at, total = SECOND * (second + 0.5), {"samples": float(samples.sum())}
            found.append(Trace("clipping", "", at[kept], {"samples": samples[kept]}, one.source, values=total))
    return sorted(found, key=lambda trace: -trace.values["samples"])[:1]


def rotor(case: HealthCase) -> list[Trace]:
    """The rotors' fundamental in flight and its harmonics, where their speed was logged."""
    rpm = case.log.rpm
    if rpm is None or len(rpm.t) < FEWEST:
        return []
    x = rpm.x[inside(rpm.t, flown(case.segments))]
    turning = x[np.isfinite(x) & (x > TURNING_RPM)]
    if len(turning) < FEWEST:
        return []
    low, middle, high = np.quantile(turning, [0.1, 0.5, 0.9]) / 60.0
    order = np.arange(1, HARMONICS + 1)
    return [Trace("rotor", "", middle * order, {"low": low * order, "high": high * order})]


def notches(case: HealthCase) -> list[Trace]:
    """Notches of the gyro that the firmware has on, and those that are proposed, where their frequency is fixed."""
    drawn = next((one["notches"] for one in vibration.spectrum(case) if one["sensor"] == "gyro"), [])
    found = []
    for key, proposed in (("set", False), ("proposed", True)):
        own = [n for n in cast("list[dict[str, float]]", drawn) if n["proposed"] == proposed]
        if own:
            f, width = np.array(sorted((n["frequency"], n["width"]) for n in own)).T
            found.append(Trace("notches", "", f, {"low": f - 0.5 * width, "high": f + 0.5 * width}, key))
    return found
