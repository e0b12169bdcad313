"""Which of the three questions a log can answer, and what would be needed for the others.

The limits are those by which the metrics answer or refuse: ``metrics/evidence.py``
and the step events of ``metrics/steps.py``.
"""

from __future__ import annotations

import math

from attlog.flight.model import FlightLog
from attlog.health.model import Answerable, Check
from attlog.metrics.evidence import (
    DRIFT_AIR_S,
    DRIFT_REST_S,
    DRIFT_SLACK_S,
    NOISE_REST_S,
    REST_SETTLE_S,
    STEP_EVENTS,
    STEP_REFERENCE_HZ,
)
from attlog.metrics.steps import scored
from attlog.reference.model import Reference
from attlog.segments.gaps import restarts
from attlog.segments.model import Segments
from attlog.segments.settled import DRIFT_AFTER_START_S, settled
from attlog.segments.spans import Span, complement, intersect, seconds


def answerable(
    log: FlightLog, segments: Segments | None, checks: list[Check], reference: Reference | None = None
) -> list[Answerable]:
    """The three questions in the order of the report, each with a reason and the setting that is missing.

    ``reference`` is what filters would be compared with (``attlog.reference.choose``), None where there is none.
    """
    imu = log.replay_imu
    if imu is None:
        reason = next((p.text for p in log.problems if p.severity == "error"), "There is no usable IMU in this log.")
        setting = "" if log.imus else log.advice("imu")
        setting = "" if setting in reason else setting
        return [Answerable(q, False, reason, setting) for q in ("quiet", "late", "drifting")]
    phases = segments or Segments()
    broken = [c for c in checks if c.verdict == "bad" and c.name in ("gyro", "gravity")]
    if broken:
        return [Answerable(q, False, broken[0].text, "") for q in ("quiet", "late", "drifting")]
    rests = intersect(phases.spans("rest"), [(float(imu.gyro.t[0]) + REST_SETTLE_S, math.inf)])
    return [quiet(log, rests), late(log, reference), drifting(log, phases, reference)]


def quiet(log: FlightLog, rests: list[Span]) -> Answerable:
    """Static noise needs rest with motors off, ``rests`` that count."""
    lengths = [b - a for a, b in rests]
    longest = max(lengths, default=0.0)
    if longest < NOISE_REST_S:
        reason = f"The vehicle never stands still with motors off for {NOISE_REST_S:.0f} s while the log runs"
        reason += f" and filters have settled ({REST_SETTLE_S:.0f} s)."
        return Answerable("quiet", False, reason, log.advice("rest"))
    if len(rests) == 1:
        return Answerable("quiet", True, f"1 usable rest of {longest:.1f} s.")
    return Answerable(
        "quiet", True, f"{len(rests)} usable rests, {sum(lengths):.1f} s in all, the longest {longest:.1f} s."
    )


def late(log: FlightLog, reference: Reference | None) -> Answerable:
    """Lag needs an attitude of at least 5 Hz to compare with, and quick movements of it."""
    if reference is None or reference.kind == "none":
        refused = "" if reference is None or not reference.fault else f" {reference.fault}."
        known = log.truth is not None or log.onboard is not None
        setting = "" if refused or known else log.advice("attitude")
        return Answerable("late", False, f"There is no attitude to compare with.{refused}", setting)
    name = reference.name or reference.source
    if reference.rate < STEP_REFERENCE_HZ:
        reason = f"{name} is logged at {reference.rate:.1f} Hz; lag needs {STEP_REFERENCE_HZ:.0f} Hz."
        return Answerable("late", False, reason, log.advice("attitude", reference.rate))
    events = scored(reference)
    counts = [sum(e.axis == axis for e in events) for axis in range(3)]
    counted = "Quick movements in roll, pitch, yaw: " + ", ".join(map(str, counts))
    if len(events) < STEP_EVENTS:
        advice = "Fly quick attitude steps of 15 deg and more in Stabilize." if log.kind.hovers else ""
        return Answerable("late", False, f"{counted}; {STEP_EVENTS} are needed.", advice)
    return Answerable("late", True, f"{counted}; compared with {name} at {reference.rate:.0f} Hz.")


def drifting(log: FlightLog, segments: Segments, reference: Reference | None) -> Answerable:
    """Yaw drift needs a rest that is long enough after settling, or scored flight with a heading to compare with."""
    imu = log.replay_imu
    starts = [] if imu is None else restarts(imu.gyro.t_best).tolist()
    usable = [settled([s], segments, starts, DRIFT_AFTER_START_S) for s in segments.spans("rest")]
    rest = max((seconds(spans) for spans in usable), default=0.0)
    scored = [(-math.inf, math.inf)]
    if reference is not None:
        scored = complement(reference.unscored, reference.scoring_start, reference.end)
    air = seconds(intersect(segments.spans("airborne"), scored))
    known = (
        ("truth", log.truth is not None), ("onboard attitude", log.onboard is not None),
        ("magnetometer", log.mag is not None), ("GNSS yaw", any(g.yaw is not None for g in log.gnss)),
    )  # fmt: skip
    headings = ", ".join(name for name, there in known if there)
    if rest >= DRIFT_REST_S - DRIFT_SLACK_S:
        return Answerable(
            "drifting", True, f"The longest rest has {rest:.0f} s after settling; in the air: {air:.0f} s."
        )
    if air >= DRIFT_AIR_S - DRIFT_SLACK_S and headings:
        reason = f"{air:.0f} s in the air against {headings}; rest after settling: {rest:.0f} s."
        return Answerable("drifting", True, reason)
    reason = f"The longest rest has {rest:.0f} s after settling, {DRIFT_REST_S:.0f} are needed; "
    reason += f"the flight {air:.0f} s after the scoring start, {DRIFT_AIR_S:.0f} are needed."
    return Answerable("drifting", False, reason, log.advice("rest"))
