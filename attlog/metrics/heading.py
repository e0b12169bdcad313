"""How far is a row's heading off by GNSS acceleration? It needs neither a reference nor a compass."""

from __future__ import annotations

from dataclasses import replace
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from attlog.estimators.evidence import HeadingOffset
from attlog.metrics import drift, following
from attlog.metrics import intervals as interval
from attlog.metrics.accuracy import own_sigma
from attlog.metrics.drift import error_blocks, rest_blocks, usable_rests
from attlog.metrics.metric import (
    Answer,
    Case,
    Metric,
    SpanAnswer,
    Wording,
    applies_to,
    missing,
    paragraph,
    per_case,
    per_row,
)
from attlog.metrics.statistics import root_mean_square
from attlog.metrics.windows import (
    DRIFT_AIR_S,
    DRIFT_REST_S,
    imu_of,
    logged_unit,
    own_start,
    why_no_errors,
    why_no_heading,
)
from attlog.reference.heading_sources import GnssMotion, find_gnss_motion
from attlog.reference.model import Row
from attlog.segments import model

GNSS_HEADING_NAME, GNSS_HEADING_UNIT = "gnss_heading_deg", "deg"
GNSS_HEADING_METRICS: tuple[Metric, ...] = (
    Metric(
        GNSS_HEADING_NAME,
        "Heading error by GNSS acceleration",
        GNSS_HEADING_UNIT,
        "zero",
        ("gnss",),
        paragraph(
            """Angle by which specific force, turned to earth by this row, is turned against GNSS acceleration in
            flight, clockwise positive. Changes of velocity over 1 s; means of 30 s removed; one delay of GNSS for the
            flight. Interval: jackknife of blocks of 5 s, 0.3 deg, and what the delay leaves open. Answered where both
            show one motion: correlation 0.7 or more, scale 0.7 to 1.3, sigma up to 10 deg, more than one movement.
            Every row shares the errors of GNSS, so nobody is ranked."""
        ),
        wording=Wording("errs", "less", "more", "heading by GNSS acceleration"),
    ),
)
SHARED = "every row shares the errors of GNSS"
T_95 = 1.96


def compute_gnss_heading(case: Case, row: Row, window: str) -> dict[str, Answer]:
    """Answers of METRICS for one row and window; nothing for windows on the ground."""
    if not applies_to(window, "all"):
        return {}
    motion = _motion_of(case, row)
    if motion is None:
        return {
            GNSS_HEADING_NAME: missing(
                "no_gnss", "the log holds no GNSS velocity with a 3D fix", GNSS_HEADING_UNIT, window
            )
        }
    turned = own_north(row)
    if turned is None:
        reason = "it has no north of its own: its heading was turned to the reference's"
        return {GNSS_HEADING_NAME: missing("not_applicable", reason, GNSS_HEADING_UNIT, window)}
    whole, parts = _offsets(case, row, window)
    wrong = [_record(part, turned) for part in parts if _shifted(part, turned).wrong]
    if not whole.told:
        answer = missing("too_uncertain", whole.why, GNSS_HEADING_UNIT, window)
    else:
        value = _shifted(whole, turned).offset_deg
        half = T_95 * whole.sigma_deg
        answer = Answer(
            value,
            GNSS_HEADING_UNIT,
            window,
            max(1, int(whole.blocks)),
            whole.t1 - whole.t0,
            (value - half, value + half),
            "rotation between force and GNSS acceleration, 1 s windows",
            reason=SHARED,
            ranked=False,
            detail={"delay_s": whole.delay_s, "scale": whole.scale, "correlation": whole.correlation},
        )
    answer.records = wrong
    return {GNSS_HEADING_NAME: answer}


def _motion_of(case: Case, row: Row) -> GnssMotion | None:
    """The motion by the unit that a row was made of; what rows share is made once."""
    imu = imu_of(case, row)
    unit = None if imu is None else logged_unit(case, imu)
    return find_gnss_motion(case.log, case.segments, imu) if unit is None else _motion_by(case, unit)


@per_case
def _motion_by(case: Case, unit: int) -> GnssMotion | None:
    return find_gnss_motion(case.log, case.segments, case.log.imus[unit])


@per_row
def _offsets(case: Case, row: Row, window: str) -> tuple[HeadingOffset, list[HeadingOffset]]:
    """Of the flight and of each 30 s, as the row now stands."""
    motion = _motion_of(case, row)
    assert motion is not None
    segment = model.merge_numbers(model.number_segments(row.t), row.segment)
    within = case.segments.spans(window) if ":" in window else None
    return motion.offsets(row.t, row.q, segment, own_start(case, row), within)


def own_north(row: Row) -> float | None:
    """The heading that was taken out of a row with a north of its own, deg; None where it has none, or not one."""
    if row.heading_offset_deg is None:
        return 0.0
    one = len(row.segment) > 0 and row.segment[0] == row.segment[-1]
    return row.heading_offset_deg if row.knows_north and one else None


def _shifted(found: HeadingOffset, turned: float) -> HeadingOffset:
    """The same of the heading as the filter gave it."""
    if not turned:
        return found
    return replace(found, offset_deg=float((found.offset_deg + turned + 180.0) % 360.0 - 180.0))


def _record(found: HeadingOffset, turned: float) -> SpanAnswer:
    """One of the 30 s in which the heading is wrong."""
    value, half = _shifted(found, turned).offset_deg, T_95 * found.sigma_deg
    return SpanAnswer(found.t0, found.t1, found.t1 - found.t0, value, (value - half, value + half))


# How far does the heading wander when its mean drift is taken away?

Array = NDArray[np.float64]

HEADING_RESIDUAL_METRICS: tuple[Metric, ...] = (
    Metric(
        "wander_deg",
        "Heading wander",
        "deg",
        "low",
        ("rest",),
        paragraph(
            """RMS of the block means of the heading (1 s, 0.5 s in records under 20 s) after the mean drift and each
            segment's offset are removed: of the heading itself at rest, of the heading error against the reference in
            the window airborne. Interval: t over the mean squares of the drift's groups, and 2 sigma of a smoother."""
        ),
    ),
)


LARGEST_DEG = 180.0
"""A heading that is further from its mean drift has turned round: no size of it means anything."""


def pooled(records: list[drift.HeadingBlocks], shortest_s: float) -> tuple[float, interval.Interval | None, int] | None:
    """RMS in deg about each record's mean drift, its interval and the number of groups; None without a long record."""
    residuals: list[Array] = []
    groups: list[slice] = []
    for blocks in records:
        found = drift.fit_drift(blocks, shortest_s)
        if found.value is None:
            continue
        begin = sum(len(r) for r in residuals)
        residuals.append(drift.without_slope(blocks, found.value))
        edges = [int(np.searchsorted(blocks.t, t0)) for t0, _ in found.spans] + [len(blocks.t)]
        groups += [slice(begin + a, begin + b) for a, b in pairwise(edges)]
    if not residuals:
        return None
    value, ci95 = root_mean_square(np.concatenate(residuals), groups)
    return value, ci95, len(groups)


def compute_heading_residual(case: Case, row: Row, window: str) -> dict[str, Answer]:
    """Answers of METRICS for one row and window; nothing for windows without a heading record by definition."""
    if not applies_to(window, "all", "rest", "rest.long", "airborne"):
        return {}
    if window == "airborne":
        absent = why_no_errors(case, row) or why_no_heading(case, row)
        if absent is not None:
            return {"wander_deg": missing(*absent, "deg", window)}
        flown = error_blocks(case, row, case.reference.kind, window)
        records, shortest_s = [] if flown is None else [flown], DRIFT_AIR_S
    else:
        records = [rest_blocks(case, row, usable) for _, usable in usable_rests(case, row, window)]
        shortest_s = DRIFT_REST_S
    records = [r for r in records if len(r.t)]
    found = pooled(records, shortest_s)
    if found is None:
        longest = max((r.seconds for r in records), default=0.0)
        reason = f"the longest record is {longest:.0f} s; {shortest_s:.0f} s are needed"
        return {"wander_deg": missing("record_too_short", reason, "deg", window)}
    value, ci95, groups = found
    if window == "airborne" and ci95 is not None:
        low, high = interval.widen_by_reference(value, ci95, own_sigma(case, "heading", window))
        ci95 = max(low, 0.0), high
    if value > LARGEST_DEG:
        reason = f"the heading runs round by {value:.0f} deg about its mean drift: it does not wander, it is lost"
        return {"wander_deg": missing("diverged", reason, "deg", window)}
    if ci95 is not None and ci95[1] > LARGEST_DEG:
        ci95 = None
    floor = case.reference.floor_deg if window == "airborne" else row.step_deg / 2.0
    answer = Answer(
        value,
        "deg",
        window,
        groups,
        sum(r.seconds for r in records),
        ci95,
        f"RMS about the mean drift, {groups} groups",
        floor=floor,
    )
    return {"wander_deg": following.unrank_frozen(case, row, "heading", answer)}
