"""Which of the three questions a log can answer, and what would be needed for the others."""

from __future__ import annotations

import math

import numpy as np

from attlog.flight.model import FlightLog, Imu
from attlog.flight.settings import how_to_log
from attlog.health.model import Answerable, Check
from attlog.reference.scoring import start_and_unscored
from attlog.segments.gaps import restarts
from attlog.segments.model import Segments
from attlog.segments.settled import DRIFT_AFTER_START_S, settled
from attlog.segments.spans import complement, intersect, seconds

REST_S = 2.0
"""Shortest rest in which noise is measured (docs/metrics.md)."""
DRIFT_REST_S, DRIFT_AIR_S = 8.0, 20.0
"""Shortest record of a drift at rest after settling, and in the air (docs/metrics.md)."""
SLOW_REFERENCE_HZ = 5.0
STROKE_DEG, STROKE_YAW_DEG = 5.0, 10.0
EVENTS = 3


def answerable(log: FlightLog, segments: Segments | None, checks: list[Check]) -> list[Answerable]:
    """The three questions in the order of the report, each with a reason and the setting that is missing."""
    if log.imu is None:
        reason = next((p.text for p in log.problems if p.severity == "error"), "There is no usable IMU in this log.")
        setting = setting_for(log, "imu")
        setting = "" if setting in reason else setting
        return [Answerable(q, False, reason, setting) for q in ("quiet", "late", "drifting")]
    phases = segments or Segments()
    broken = [c for c in checks if c.verdict == "bad" and c.name in ("gyro", "gravity")]
    if broken:
        return [Answerable(q, False, broken[0].text, "") for q in ("quiet", "late", "drifting")]
    imu = log.imus[log.imu]
    return [quiet(log, phases), late(log, imu), drifting(log, phases, imu)]


def setting_for(log: FlightLog, what: str) -> str:
    """The sentence on the setting that would log what is missing, for this firmware."""
    telemetry = log.format in ("tlog", "mavlink")
    return how_to_log(log.firmware.name, log.firmware.version, what, telemetry)


def quiet(log: FlightLog, segments: Segments) -> Answerable:
    """Static noise needs rest with motors off."""
    rests = [s.seconds for s in segments.of("rest")]
    longest = max(rests, default=0.0)
    if longest < REST_S:
        reason = "The vehicle never stands still with motors off for 2 s while the log runs."
        return Answerable("quiet", False, reason, setting_for(log, "rest"))
    if len(rests) == 1:
        return Answerable("quiet", True, f"1 rest of {longest:.1f} s.")
    return Answerable("quiet", True, f"{len(rests)} rests, {sum(rests):.1f} s in all, the longest {longest:.1f} s.")


def late(log: FlightLog, imu: Imu) -> Answerable:
    """Lag needs an attitude of at least 5 Hz to compare with, and quick turns."""
    reference = log.truth or log.attitudes.get(log.onboard or "")
    if reference is None:
        return Answerable("late", False, "There is no attitude to compare with.", setting_for(log, "attitude"))
    name = "truth" if log.truth is not None else log.onboard
    if reference.rate < SLOW_REFERENCE_HZ:
        reason = f"{name} is logged at {reference.rate:.1f} Hz; lag needs {SLOW_REFERENCE_HZ:.0f} Hz."
        return Answerable("late", False, reason, setting_for(log, "attitude"))
    turns = strokes(imu)
    if max(turns) < EVENTS:
        reason = f"Quick turns about x, y, z: {turns[0]}, {turns[1]}, {turns[2]}; {EVENTS} about one axis are needed."
        return Answerable("late", False, reason, "Fly quick attitude steps of 15 deg and more in Stabilize.")
    counted = f"Quick turns about x, y, z: {turns[0]}, {turns[1]}, {turns[2]}"
    return Answerable("late", True, f"{counted}; compared with {name} at {reference.rate:.0f} Hz.")


def strokes(imu: Imu) -> tuple[int, int, int]:
    """About how many separate turns of more than 5 deg (yaw 10) within a second the gyro shows, per axis."""
    t, x = imu.gyro.t, imu.gyro.x - np.median(imu.gyro.x, axis=0)
    dt = np.minimum(np.diff(t, prepend=t[0]), 0.1)
    angle = np.degrees(np.cumsum(x * dt[:, None], axis=0))
    later = np.searchsorted(t, t + 1.0) - 1
    counts = []
    for axis, least in enumerate((STROKE_DEG, STROKE_DEG, STROKE_YAW_DEG)):
        quick = np.abs(angle[later, axis] - angle[:, axis]) >= least
        starts = np.flatnonzero(np.diff(quick.astype(np.int8), prepend=0) == 1)
        counts.append(len(starts))
    return counts[0], counts[1], counts[2]


def drifting(log: FlightLog, segments: Segments, imu: Imu) -> Answerable:
    """Yaw drift needs a rest that is long enough after settling, or flight with a heading reference."""
    starts = restarts(imu.gyro.t_best)
    usable = [settled([s], segments, starts.tolist(), DRIFT_AFTER_START_S) for s in segments.spans("rest")]
    rest = max((seconds(spans) for spans in usable), default=0.0)
    begin, unscored = start_and_unscored(imu.gyro.t_best, None)
    end = min((s.t0 for s in segments.of("impact")), default=math.inf)
    flown = intersect(segments.spans("airborne"), complement(unscored, begin, end))
    air = seconds(flown)
    known = (
        ("truth", log.truth is not None), ("onboard attitude", log.onboard is not None),
        ("magnetometer", log.mag is not None), ("GNSS yaw", any(g.yaw is not None for g in log.gnss)),
    )  # fmt: skip
    references = ", ".join(name for name, there in known if there)
    if rest >= DRIFT_REST_S - 0.5:
        return Answerable(
            "drifting", True, f"The longest rest has {rest:.0f} s after settling; in the air: {air:.0f} s."
        )
    if air >= DRIFT_AIR_S - 0.5 and references:
        reason = f"{air:.0f} s in the air against {references}; rest after settling: {rest:.0f} s."
        return Answerable("drifting", True, reason)
    reason = f"The longest rest has {rest:.0f} s after settling, {DRIFT_REST_S:.0f} are needed; "
    reason += f"the flight {air:.0f} s after the scoring start, {DRIFT_AIR_S:.0f} are needed."
    return Answerable("drifting", False, reason, setting_for(log, "rest"))
