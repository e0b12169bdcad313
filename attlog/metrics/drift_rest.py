"""Yaw drift at rest: the heading should not move, so every slope is the row's own."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from attlog import earth, rotation
from attlog.metrics import drift, follow
from attlog.metrics.answer import Answer, missing
from attlog.metrics.base import Case, Metric, applies_to, paragraph, per_row
from attlog.metrics.evidence import row_segments, within
from attlog.metrics.settled import rest_spans, why_none
from attlog.reference.model import Row

Array = NDArray[np.float64]

_TEXT = paragraph(
    """Mean slope of the row's own heading while the vehicle stands still: the heading reference is the constant heading itself.
    1 s block means, cut at gaps and resets; groups of a quarter of the rest (a sixth from 120 s on), each with its
    own offset; value = mean of the group slopes, interval = t over them. Several rests are pooled if they agree,
    else the interval spans them all. It is the mean drift of this record, not a property of the filter for ever.
    The earth's own turn (up to 0.25 deg/min) is part of it for filters that follow the gyro."""
)
METRICS: tuple[Metric, ...] = (
    Metric("drift_rest_deg_per_min", "Yaw drift at rest", "deg/min", "zero", ("rest",), _TEXT),
)


@per_row
def rest_blocks(case: Case, row: Row, span: tuple[float, float]) -> drift.Blocks:
    """1 s means of the row's heading in deg during one rest, relative to its mean there."""
    pieces = within(row.t, span, row_segments(case, row))
    t, e, label = [], [], []
    for k, segment in enumerate(pieces):
        q = row.q[segment]
        if np.isfinite(q).all():
            t.append(row.t[segment])
            e.append(np.degrees(rotation.heading_angle(rotation.error(q, rotation.mean(q)))))
            label.append(np.full(len(q), k))
    if not t:
        return drift.Blocks(np.zeros(0), np.zeros(0), np.zeros(0, np.int64))
    return drift.block_means(np.concatenate(t), np.concatenate(e), np.concatenate(label))


@per_row
def records(case: Case, row: Row, window: str) -> list[drift.Drift]:
    """The drift of each rest of the window, in time order."""
    return [drift.slope(b) for b in (rest_blocks(case, row, s) for s in rest_spans(case, row, window)) if len(b.t)]


def compute(case: Case, row: Row, window: str) -> dict[str, Answer]:
    """Answers of METRICS for one row and window; nothing for windows without rest by definition."""
    if not applies_to(window, "all", "rest", "rest.long"):
        return {}
    found = records(case, row, window)
    if not found:
        code, reason = why_none(case, "rest", window)
        return {"drift_rest_deg_per_min": missing(code, reason, "deg/min", window)}
    answer = drift.answer(drift.together(found), window, "rest")
    answer.detail |= bias_beside(row, answer.value, rest_spans(case, row, window)) | heading_change(case, row, window)
    turn = earth_turn(case)
    if turn is not None:
        answer.detail["earth_turn_deg_per_min"] = turn
    return {"drift_rest_deg_per_min": follow.unrank_frozen(case, row, "heading", answer)}


def bias_beside(row: Row, drift_deg_per_min: float | None, spans: list[tuple[float, float]]) -> dict[str, float]:
    """The gyro z-bias that a drift implies (deg/s), and the filter's own mean z-bias estimate in the same time."""
    beside: dict[str, float] = {}
    if drift_deg_per_min is not None:
        beside["implied_bias_dps"] = drift_deg_per_min / 60.0
    if row.bias is not None:
        inside = np.zeros(len(row.t), bool)
        for t0, t1 in spans:
            inside |= (row.t >= t0) & (row.t <= t1)
        inside &= np.isfinite(row.bias[:, 2])
        if inside.any():
            beside["own_bias_z_dps"] = float(np.degrees(np.mean(row.bias[inside, 2])))
    return beside


def heading_change(case: Case, row: Row, window: str) -> dict[str, float]:
    """Heading of the last rest minus that of the first, deg, where there are two with other things between."""
    spans = rest_spans(case, row, window)
    means = [rotation.mean(row.q[w[0]]) for w in (within(row.t, s, row.segment) for s in (spans[0], spans[-1])) if w]
    if len(spans) < 2 or len(means) < 2 or not np.isfinite(means).all():
        return {}
    return {"heading_change_deg": float(np.degrees(rotation.heading_angle(rotation.error(means[1], means[0]))))}


def earth_turn(case: Case) -> float | None:
    """How fast the earth turns a perfect gyro's heading at the place of the log, deg/min; None where it is unknown."""
    for receiver in case.log.gnss:
        latitude = receiver.lat[np.isfinite(receiver.lat) & (receiver.fix >= 3)]
        if len(latitude):
            return earth.heading_turn(float(np.median(latitude)))
    return None
