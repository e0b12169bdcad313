"""Which time of a flight counts for a row, and why does none? Phases without settling; rows that can be compared."""

from __future__ import annotations

import math

import numpy as np

from attlog.metrics.base import Case, per_case
from attlog.reference.model import Row
from attlog.segments import gaps
from attlog.segments.spans import Span, clipped, complement, intersect

PHASES = ("rest", "hover", "cruise", "idle")
"""Never pooled: the same filter is up to ten times as noisy in one as in another. In the order of the sentences."""
START_S = 10.0
"""A row settles for so long after its own start, and after a restart."""
MOTORS_S = 5.0
"""And for so long after the motors stop: the accelerometer still believes in vibration."""
ALIGNING_S = 30.0
"""Resets of an onboard attitude on the ground within this time of its first sample are its alignment."""
SHORTEST_S = 2.0


@per_case
def settling(case: Case, phase: str) -> list[Span]:
    """Spans in which no row is settled: after the first sample, after a restart, at rest also after the motors stop."""
    continuous = case.segments.spans("all")
    starts = gaps.restarts(np.array([x for span in continuous for x in span])[::2]) if continuous else np.zeros(0)
    found = [(float(t), float(t) + START_S) for t in starts]
    for kind in ("armed", "airborne", "idle") if phase == "rest" else ():
        found += [(t1, t1 + MOTORS_S) for _, t1 in case.segments.spans(kind)]
    return found


def own_start(case: Case, row: Row) -> float:
    """When a row is settled after its own start, s; an onboard attitude after the resets that align it.

    An autopilot shows an attitude before its estimator is aligned; the alignment is a reset.
    """
    start = row.start
    if row.kind == "onboard":
        takeoff = min((t0 for t0, _ in case.segments.spans("airborne")), default=math.inf)
        end = min(takeoff, start + ALIGNING_S)
        start = max([start, *(s.t1 for s in case.segments.of("reset") if s.t1 < end)])
    return start + START_S


def phase_of(case: Case, window: str) -> str | None:
    """The one phase that a window stands for: itself, rest for ``all``, the first one found in ``T0:T1``; else None."""
    if window in ("all", "rest", "rest.long"):
        return "rest"
    if window in PHASES:
        return window
    if ":" in window:
        return next((p for p in PHASES if phase_spans(case, p, window)), "rest")
    return None


@per_case
def phase_spans(case: Case, phase: str, window: str) -> list[Span]:
    """Spans of a phase inside a window, within continuous segments, settled; in the air also scored."""
    allowed = complement(settling(case, phase), -math.inf, math.inf)
    if phase in ("hover", "cruise"):
        reference = case.reference
        allowed = intersect(allowed, complement(reference.unscored, reference.scoring_start, reference.end))
    if ":" in window or window == "rest.long":
        allowed = intersect(allowed, case.segments.spans(window))
    return clipped(intersect(case.segments.spans(phase), allowed), case.segments.spans("all"))


def rest_spans(case: Case, row: Row, window: str) -> list[Span]:
    """Rest inside a window, from when the row is settled."""
    return intersect(phase_spans(case, "rest", window), [(own_start(case, row), math.inf)])


def why_none(case: Case, phase: str, window: str) -> tuple[str, str]:
    """Code and reason where a phase of a window holds nothing usable for any row or for one."""
    where = f" in {window} s" if ":" in window else ""
    if phase == "idle":
        if not case.segments.spans("idle"):
            return "no_rest", "the vehicle never stood with its motors turning"
        return "rest_too_short", f"it never stood{where} for 5 s with its motors turning, once the filter had settled"
    if phase in ("hover", "cruise"):
        what = "hover" if phase == "hover" else "flight other than hover"
        if not case.segments.spans(phase):
            return "not_applicable", f"there is no {what} in this log"
        return "record_too_short", f"no 5 s of {what}{where} in which this row is scored without a gap or a turn"
    if not case.segments.spans("rest"):
        return "no_rest", "the vehicle never stood still with motors off for 2 s; record 20 s before arming"
    if window == "rest.long" and not case.segments.spans(window):
        return "no_rest", "no rest of this log is long enough to count as long; record 20 s before arming"
    if ":" in window and not intersect(case.segments.spans("rest"), case.segments.spans(window)):
        return "no_rest", f"there is no rest{where}"
    return "rest_too_short", (
        f"no {SHORTEST_S:.0f} s of rest{where} after the filter settled ({START_S:.0f} s after its start, "
        f"{MOTORS_S:.0f} s after the motors stopped)"
    )


def why_no_errors(case: Case, row: Row) -> tuple[str, str] | None:
    """Code and reason where a row cannot be compared with the reference, else None."""
    if case.reference.kind == "none" or len(case.reference.t) == 0:
        nothing = "the log holds no attitude to compare with; log the autopilot's attitude (or ground truth)"
        return "no_reference", case.reference.fault or nothing
    if row.is_reference:
        return "not_applicable", "this row is the reference itself"
    if row.errors is None or len(row.errors.t) == 0:
        return "not_covered", row.reason or "this row and the reference have no time in common"
    return None


def why_no_heading(case: Case, row: Row) -> tuple[str, str] | None:
    """Code and reason where a row's heading cannot be compared though its tilt can, else None."""
    if row.heading_shared:
        return "not_applicable", f"{case.reference.heading_why}, so the reference has its heading from this row"
    if case.reference.heading_by == "nobody":
        return "no_reference", f"{case.reference.heading_why}, and no other heading can be compared with"
    return None


def why_never_airborne(case: Case) -> str:
    """The reason where a log has no flight: the vehicle cannot fly, or nothing tells that it did."""
    if not case.log.kind.flies:
        return f"a {case.log.vehicle} does not fly"
    return "the vehicle was never airborne (as far as the log shows)"
