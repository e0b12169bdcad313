"""Yaw drift at rest: the heading should not move, so every slope is the row's own."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from attlog.base import rotation
from attlog.metrics.answer import Answer, SpanAnswer, missing
from attlog.metrics.base import Case, Metric, Wording, applies_to, paragraph, per_case, per_row
from attlog.metrics.drift import slope as drift
from attlog.metrics.evidence.phases import why_none
from attlog.metrics.evidence.samples import DRIFT_REST_S, DRIFT_SLACK_S, row_segments, within
from attlog.metrics.ranking import following
from attlog.reference.model import Row
from attlog.segments import gaps
from attlog.segments.settled import DRIFT_AFTER_START_S, settled
from attlog.segments.spans import Span, between, intersect, merge

Array = NDArray[np.float64]

_TEXT = paragraph(
    """Mean slope of the row's own heading while the vehicle stands still: the heading itself should be constant.
    Nothing within 20 s of the filter's start or restart and within 5 s of the motors' stop counts; 8 s of the rest
    must remain. Block means over 1 s (0.5 s where less than 20 s remain), cut at gaps and resets; one group for
    each 10 s, 4 to 12, each with its own offset; value = mean of the group slopes, interval = t over them. The
    drift is significant where the interval excludes zero, else bounded by its larger end. Rests that agree are
    pooled, others are a range; a row that lacks one of the rests that are long enough has no drift at rest. It is
    the mean drift of this record, not a property of the filter for ever. The earth's own turn (up to 0.25 deg/min)
    is part of it for filters that follow the gyro."""
)
METRICS: tuple[Metric, ...] = (
    Metric(
        "drift_rest_deg_per_min",
        "Yaw drift at rest",
        "deg/min",
        "zero",
        ("rest",),
        _TEXT,
        resolution=drift.RESOLUTION,
        wording=Wording("drifts", "less at rest", "more at rest", "drift at rest"),
        asked="rest",
    ),
)


@per_row
def rest_blocks(case: Case, row: Row, spans: tuple[Span, ...]) -> drift.HeadingBlocks:
    """Block means of the row's heading in deg during the usable spans of one rest, relative to its mean in each."""
    resets_of = row_segments(case, row)
    t, e, label = [], [], []
    for k, segment in enumerate(s for span in spans for s in within(row.t, span, resets_of)):
        q = row.q[segment]
        if np.isfinite(q).all():
            t.append(row.t[segment])
            e.append(np.degrees(rotation.heading_angle(rotation.error(q, rotation.mean(q)))))
            label.append(np.full(len(q), k))
    if not t:
        return drift.HeadingBlocks(np.zeros(0), np.zeros(0), np.zeros(0, np.int64))
    return drift.block_means(np.concatenate(t), np.concatenate(e), np.concatenate(label))


def _whole(case: Case, window: str) -> list[Span]:
    """The rests of a window."""
    whole = case.segments.spans("rest.long" if window == "rest.long" else "rest")
    return intersect(whole, case.segments.spans(window)) if ":" in window else whole


@per_row
def rests(case: Case, row: Row, window: str) -> list[tuple[Span, tuple[Span, ...]]]:
    """Each rest of the window with its usable spans: those in which the row has settled."""
    whole = _whole(case, window)
    restarts = row.t[1:][np.diff(row.segment) != 0].tolist() if row.kind == "replay" else []
    starts = [row.start, *restarts]
    usable = settled(whole, case.segments, starts, DRIFT_AFTER_START_S)
    return [(span, tuple(spans)) for span, spans in zip(whole, usable, strict=True)]


def records(case: Case, row: Row, window: str) -> list[drift.Drift]:
    """The drift of each rest of the window, in time order, each with its own record."""
    found = []
    for (t0, t1), usable in rests(case, row, window):
        one = drift.slope(rest_blocks(case, row, usable), DRIFT_REST_S)
        seconds = sum((b - a for a, b in usable), 0.0)
        reason = None if one.value is not None else _too_short(one, seconds)
        one.records = [SpanAnswer(t0, t1, seconds, one.value, one.ci95, reason)]
        found.append(one)
    return found


def _too_short(one: drift.Drift, usable_s: float) -> str:
    if usable_s < DRIFT_REST_S - DRIFT_SLACK_S:
        return f"{usable_s:.0f} s after settling; {DRIFT_REST_S:.0f} are needed"
    return f"after settling {drift.too_short(one, DRIFT_REST_S)}"


@per_case
def long_enough(case: Case, window: str) -> int:
    """In how many rests of the window a row that runs from the log's first sample on can show a drift."""
    whole = _whole(case, window)
    starts = [t0 for t0, _ in case.segments.spans("all")]
    first = gaps.restarts(np.array([x for span in case.segments.spans("all") for x in span])[::2]) if starts else starts
    usable = settled(whole, case.segments, [float(t) for t in first], DRIFT_AFTER_START_S)
    return sum(sum(b - a for a, b in spans) >= DRIFT_REST_S for spans in usable)


def compute(case: Case, row: Row, window: str) -> dict[str, Answer]:
    """Answers of METRICS for one row and window; nothing for windows without rest by definition."""
    if not applies_to(window, "all", "rest", "rest.long"):
        return {}
    found = records(case, row, window)
    if not found:
        code, reason = why_none(case, "rest", window)
        return {METRICS[0].name: missing(code, reason, "deg/min", window)}
    pooled = drift.together(found)
    pooled.records = [r for one in found for r in one.records]
    change = heading_change(case, row, window)
    if pooled.value is None:
        return {METRICS[0].name: _none_long_enough(pooled, change, window)}
    shown, rests_of_log = sum(one.value is not None for one in found), long_enough(case, window)
    if shown < rests_of_log:
        reason = f"it is measured in {shown} of {rests_of_log} rests, and the rests of a log may disagree"
        answer = missing("not_covered", reason, "deg/min", window, **change)
        answer.records = pooled.records
        return {METRICS[0].name: answer}
    answer = drift.answer(pooled, window, "rest")
    usable = [span for _, spans in rests(case, row, window) for span in spans]
    answer.detail |= bias_beside(row, answer.value, usable) | change
    return {METRICS[0].name: following.unrank_frozen(case, row, "heading", answer)}


def _none_long_enough(pooled: drift.Drift, change: dict[str, float], window: str) -> Answer:
    """The Answer where no rest is long enough: the longest, and the turn between the first and the last."""
    longest = max(pooled.records, key=lambda r: r.usable_s)
    reason = f"the longest rest has {longest.reason}"
    if change:
        reason += f"; between the first and the last rest the heading turned by {change['heading_change_deg']:+.1f} deg"
    answer = missing("rest_too_short", reason, "deg/min", window, **change)
    answer.records = pooled.records
    return answer


def bias_beside(row: Row, drift_deg_per_min: float | None, spans: list[tuple[float, float]]) -> dict[str, float]:
    """The gyro z-bias that a drift implies (deg/s), and the filter's own mean z-bias estimate in the same time."""
    beside: dict[str, float] = {}
    if drift_deg_per_min is not None:
        beside["implied_bias_dps"] = drift_deg_per_min / 60.0
    if row.bias is not None:
        own = [row.bias[between(row.t, t0, t1), 2] for t0, t1 in merge(spans)]
        z = np.concatenate([np.zeros(0), *own])
        z = z if np.isfinite(z.sum()) else z[np.isfinite(z)]
        if len(z):
            beside["own_bias_z_dps"] = float(np.degrees(np.mean(z)))
    return beside


def heading_change(case: Case, row: Row, window: str) -> dict[str, float]:
    """Heading of the last rest minus that of the first, deg, where there are two with other things between."""
    spans = intersect([whole for whole, _ in rests(case, row, window)], [(row.start, np.inf)])
    if len(spans) < 2:
        return {}
    means = [rotation.mean(row.q[w[0]]) for w in (within(row.t, s, row.segment) for s in (spans[0], spans[-1])) if w]
    if len(means) < 2 or not np.isfinite(means).all():
        return {}
    return {"heading_change_deg": float(np.degrees(rotation.heading_angle(rotation.error(means[1], means[0]))))}
