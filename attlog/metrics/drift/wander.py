"""How far does the heading wander when its mean drift is taken away?"""

from __future__ import annotations

from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from attlog.metrics.answer import Answer, missing
from attlog.metrics.base import Case, Metric, applies_to, paragraph
from attlog.metrics.drift import slope as drift
from attlog.metrics.drift.air import error_blocks
from attlog.metrics.drift.rest import rest_blocks, rests
from attlog.metrics.errors.rmse import own_sigma
from attlog.metrics.evidence.phases import why_no_errors, why_no_heading
from attlog.metrics.evidence.samples import DRIFT_AIR_S, DRIFT_REST_S
from attlog.metrics.ranking import following
from attlog.metrics.statistics import intervals as interval
from attlog.metrics.statistics.angles import root_mean_square
from attlog.reference.model import Row

Array = NDArray[np.float64]

METRICS: tuple[Metric, ...] = (
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
        found = drift.slope(blocks, shortest_s)
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


def compute(case: Case, row: Row, window: str) -> dict[str, Answer]:
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
        records = [rest_blocks(case, row, usable) for _, usable in rests(case, row, window)]
        shortest_s = DRIFT_REST_S
    records = [r for r in records if len(r.t)]
    found = pooled(records, shortest_s)
    if found is None:
        longest = max((r.seconds for r in records), default=0.0)
        reason = f"the longest record is {longest:.0f} s; {shortest_s:.0f} s are needed"
        return {"wander_deg": missing("record_too_short", reason, "deg", window)}
    value, ci95, groups = found
    if window == "airborne" and ci95 is not None:
        low, high = interval.with_reference(value, ci95, own_sigma(case, "heading", window))
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
