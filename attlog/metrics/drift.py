"""Yaw drift at rest and in the air: heading error slopes."""

from __future__ import annotations

import functools
import math
from collections.abc import Hashable
from dataclasses import dataclass, field, replace
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from attlog.core import rotation
from attlog.core.sorting import is_in, median
from attlog.core.spans import Span, inside, intersect
from attlog.metrics import following, statistics
from attlog.metrics.accuracy import own_sigma
from attlog.metrics.metric import (
    Answer,
    Case,
    Metric,
    MetricGroup,
    Resolution,
    SpanAnswer,
    Wording,
    missing,
    paragraph,
    per_case,
    per_row,
)
from attlog.metrics.statistics import Ids, Summary, UnitValues, chi_square, make_ids, student
from attlog.metrics.windows import (
    DRIFT_AIR_S,
    DRIFT_REST_S,
    DRIFT_SLACK_S,
    reason_unavailable,
    row_segments,
    why_never_airborne,
    within,
)
from attlog.reference.model import HeadingReference, Track
from attlog.segments import model
from attlog.segments.model import DRIFT_AFTER_START_S, converged_spans

Array = NDArray[np.float64]

# Length of blocks; shorter ones in records under 20 s.
BLOCK_S, FINE_BLOCK_S, FINE_BELOW_S = 1.0, 0.5, 20.0
# Length of a group, and limits of their number.
GROUP_S, MIN_GROUPS, MAX_GROUPS = 10.0, 4, 12
MIN_BLOCKS = 3  # a slope of fewer has no residual
# A saw-tooth: the net change deviates from the groups' slopes by so many sigmas of its ends, and is less than this
# share of them. A curved drift, whose groups continue each other, has equal ones.
TOOTH_SIGMAS, TOOTH_SHARE = 4.0, 0.5
# Resolution: 1 deg/s, the bias of an uncalibrated gyro.
RESOLUTION = Resolution(60.0, "60 deg/min", "seconds")


@dataclass(slots=True)
class HeadingBlocks:
    """Block means ``e`` deg of a heading error at ``t`` s.

    All (n,); ``e`` is unwrapped within each ``segment``.
    """

    t: Array
    e: Array
    segment: NDArray[np.int64]
    block_s: float = BLOCK_S

    @property
    def seconds(self) -> float:
        """Covered time, s."""
        return len(self.t) * self.block_s


@dataclass(slots=True)
class Drift:
    """Mean drift of a record in deg/min, from slopes of groups.

    ``slopes`` of the groups in the times ``spans`` (s). ``value`` is None if the record is too short. ``sawtooth``: the
    heading is pulled back as it drifts, so that the value is the slope of the whole record. For pooled records,
    ``range``: smallest and largest value; ``agree``: one drift explains all.
    """

    value: float | None
    ci95: statistics.Interval | None
    slopes: Array
    spans: list[tuple[float, float]]
    seconds: float
    range: tuple[float, float] | None = None
    agree: bool = True
    sawtooth: bool = False
    records: list[SpanAnswer] = field(default_factory=list)


def block_means(t: Array, e_deg: Array, segment: NDArray[np.int64]) -> HeadingBlocks:
    """Return block means of a heading error (n,) in deg.

    Over 1 s (0.5 s in short records), unwrapped by segment. ``t`` (n,) s ascends within a segment, which ends at a gap
    or a reset of the heading reference: no block crosses these. Half-filled blocks are left out.
    """
    good = np.isfinite(e_deg)
    t, e_deg, segment = t[good], e_deg[good], segment[good]
    edges = np.concatenate([[0], np.flatnonzero(np.diff(segment) != 0) + 1, [len(t)]])
    whole = [(i, j) for i, j in pairwise(edges.tolist()) if j - i >= 2]
    length = BLOCK_S if sum(t[j - 1] - t[i] for i, j in whole) >= FINE_BELOW_S - 0.1 else FINE_BLOCK_S
    times, means, labels = [], [], []
    for label, (i, j) in enumerate(whole):
        own_t, own_e = t[i:j], rotation.unwrap(e_deg[i:j], 360.0)
        index = np.floor((own_t - own_t[0]) / length).astype(int)
        count = np.bincount(index)
        full = np.flatnonzero(count > 0.5 * median(count[count > 0]))
        times.append(np.bincount(index, own_t)[full] / count[full])
        means.append(np.bincount(index, own_e)[full] / count[full])
        labels.append(np.full(len(full), label))
    if not times:
        return HeadingBlocks(np.zeros(0), np.zeros(0), np.zeros(0, np.int64))
    return HeadingBlocks(np.concatenate(times), np.concatenate(means), np.concatenate(labels), length)


def _segments(blocks: HeadingBlocks) -> list[slice]:
    """Return the range of blocks of each segment."""
    return model.segment_slices(np.ones(len(blocks.t), bool), blocks.segment)


def fit_drift(blocks: HeadingBlocks, shortest_s: float = DRIFT_AIR_S) -> Drift:
    """Return the mean drift of a record from slopes of groups.

    The t interval over slopes of Ibragimov & Mueller 2010. One group for each 10 s of the record, 4 to 12. Each segment
    is cut into max(1, round(segment / (record / groups))) equal ones, each with its own offset; groups under 3 blocks
    are left out. No value for fewer than 4 groups or less than ``shortest_s``. A saw-tooth, whose groups rise again and
    again without the record rising, has the slope of the record as value; the interval holds the largest tooth.
    """
    record = blocks.seconds
    target = record / min(max(round(record / GROUP_S), MIN_GROUPS), MAX_GROUPS)
    slopes, spans = [], []
    rest = blocks.e.copy()
    for own in _segments(blocks):
        length = own.stop - own.start
        for part in statistics.equal_groups(length, max(1, round(length * blocks.block_s / target))):
            t, e = blocks.t[own][part], blocks.e[own][part]
            if len(t) >= MIN_BLOCKS:
                slope = _line(t, e)
                slopes.append(60.0 * slope)
                spans.append((float(t[0]), float(t[-1])))
                rest[own][part] = e - e.mean() - slope * (t - t.mean())
    found = Drift(None, None, np.array(slopes), spans, record)
    if len(slopes) < MIN_GROUPS or record < shortest_s - DRIFT_SLACK_S:
        return found
    found.value = float(np.mean(slopes))
    found.ci95 = statistics.mean_interval(slopes)
    _use_net_change(found, blocks, rest)
    return found


def _use_net_change(found: Drift, blocks: HeadingBlocks, rest: Array) -> None:
    """Replace the drift of a saw-tooth by the slope of the record; ``rest`` (n,) deg about the groups' lines."""
    assert found.value is not None
    assert found.ci95 is not None
    change, seconds, reach = 0.0, 0.0, 0.0
    for own in _segments(blocks):
        t, e = blocks.t[own], blocks.e[own]
        if len(t) >= 2 * MIN_BLOCKS:
            ends = [slice(None, MIN_BLOCKS), slice(-MIN_BLOCKS, None)]
            (t0, t1), (e0, e1) = ([float(np.mean(x[end])) for end in ends] for x in (t, e))
            change, seconds = change + e1 - e0, seconds + t1 - t0
            reach = max(reach, float(np.ptp(e - e0 - (e1 - e0) / (t1 - t0) * (t - t0))))
    if seconds == 0.0:
        return
    net, noise = 60.0 * change / seconds, 60.0 * float(np.std(rest)) / seconds
    inside = found.ci95[0] <= net <= found.ci95[1]
    if inside or abs(net - found.value) < TOOTH_SIGMAS * noise or abs(net) > TOOTH_SHARE * abs(found.value):
        return
    value, half = 60.0 * _slope(blocks), 60.0 * reach / seconds  # the line averages over the teeth
    found.value, found.ci95, found.sawtooth = value, (value - half, value + half), True


def drift_line(blocks: HeadingBlocks) -> Array:
    """Return the least-squares line (n,), for figures."""
    u, v = _about_means(blocks)
    return blocks.e - v + _slope(blocks) * u


def _slope(blocks: HeadingBlocks) -> float:
    """Return the least-squares slope in deg/s with an offset for each segment; 0 for one block each."""
    u, v = _about_means(blocks)
    spread = float(u @ u)
    return float(u @ v) / spread if spread > 0 else 0.0


def _about_means(blocks: HeadingBlocks) -> tuple[Array, Array]:
    """Return times and errors (n,) about the means of their segments."""
    u, v = blocks.t.copy(), blocks.e.copy()
    for own in _segments(blocks):
        u[own] -= np.mean(u[own])
        v[own] -= np.mean(v[own])
    return u, v


def pool_drifts(records: list[Drift]) -> Drift:
    """Pool the records of a log: mean weighted by length.

    If the records agree (chi-squared test, 95 %) the interval is that of the weighted mean (Satterthwaite degrees of
    freedom). Otherwise it covers all of their intervals, and ``range`` has the smallest and largest value.
    """
    usable = [r for r in records if r.value is not None and r.ci95 is not None]
    if len(usable) <= 1:
        return replace(usable[0] if usable else max(records, key=lambda r: r.seconds))
    values = np.array([r.value for r in usable], np.float64)
    weight = np.array([r.seconds for r in usable])
    weight = weight / weight.sum()
    dof = np.array([len(r.slopes) - 1 for r in usable])
    variance = np.array([float(np.var(r.slopes, ddof=1)) / len(r.slopes) for r in usable])
    precision = 1.0 / np.maximum(variance, 1e-12)
    centre = float(precision @ values / precision.sum())
    agree = float(precision @ (values - centre) ** 2) <= chi_square(0.95, len(values) - 1)
    mean = float(weight @ values)
    total = float(weight**2 @ variance)
    if agree and total > 0:
        effective = total**2 / float(np.sum((weight**2 * variance) ** 2 / dof))
        half = student(0.975, effective) * math.sqrt(total)
        ci95 = (mean - half, mean + half)
    else:
        ci95 = (min(r.ci95[0] for r in usable if r.ci95), max(r.ci95[1] for r in usable if r.ci95))
    return Drift(
        mean,
        ci95,
        np.concatenate([r.slopes for r in usable]),
        [s for r in usable for s in r.spans],
        sum(r.seconds for r in usable),
        range=(float(values.min()), float(values.max())),
        agree=bool(agree),
        sawtooth=any(r.sawtooth for r in usable),
    )


def _line(t: Array, e: Array) -> float:
    u = t - t.sum() / len(t)
    return float(u @ (e - e.sum() / len(e))) / float(u @ u)


def reason_too_short(found: Drift, shortest_s: float) -> str:
    """Return why a record has no drift: short time or short segments."""
    if found.seconds < shortest_s - DRIFT_SLACK_S:
        return f"{found.seconds:.0f} s; {shortest_s:.0f} are needed"
    return f"{found.seconds:.0f} s in segments too short for {MIN_GROUPS} slopes"


def drift_answer(found: Drift, window: str, against: str) -> Answer:
    """Return the answer for a drift with a value: significant or bounded."""
    reason = None
    if found.range is not None and not found.agree:
        reason = f"the rests of this log disagree: {found.range[0]:+.2f} to {found.range[1]:+.2f} deg/min"
    elif found.sawtooth:
        reason = "the heading drifts and is pulled back in turn: slope of the whole record"
    method = f"mean slope of {len(found.slopes)} groups of block means against {against}, t interval over the groups"
    return Answer(
        found.value,
        "deg/min",
        window,
        len(found.slopes),
        found.seconds,
        found.ci95,
        method,
        reason=reason,
        ranked=reason is None,
        records=found.records,
        disagree=None if found.agree else found.range,
        units=_units(found),
    )


def _units(found: Drift) -> UnitValues | None:
    """Return slopes of groups, paired between rows by the groups' start times."""
    ids = make_ids([start for start, _ in found.spans])
    if found.value is None or found.sawtooth or len(set(ids.tolist())) < len(ids):
        return None
    whole = Summary(found.value, found.ci95)
    return UnitValues("slope_group", ids, found.slopes, functools.partial(drift_on_groups, ids, found.slopes, whole))


def drift_on_groups(ids: Ids, slopes: Array, whole: Summary, wanted: Ids) -> Summary:
    """Return the drift on some groups; ``whole`` on all of them."""
    chosen = is_in(ids, wanted)
    if chosen.all():
        return whole
    return Summary(float(np.mean(slopes[chosen])), statistics.mean_interval(slopes[chosen]))


# Yaw drift at rest: the true heading is constant, so that every slope is the row's.

_TEXT = paragraph(
    """Mean slope of the row's own heading while the vehicle stands still: the heading itself should be constant.
    Nothing within 20 s of the filter's start or restart and within 5 s of the motors' stop counts; 8 s of the rest
    must remain. Block means over 1 s (0.5 s where less than 20 s remain), cut at gaps and resets; one group for
    each 10 s, 4 to 12, each with its own offset; value = mean of the group slopes, interval = t over them; the slope
    of the whole record where the heading is pulled back again and again. The drift is significant where the interval
    excludes zero, else bounded by its larger end. Rests that agree are pooled, others are a range; a row
    that lacks one of the rests that are long enough has no drift at rest. It is the mean drift of this record, not a
    property of the filter for ever. The earth's own turn (up to 0.25 deg/min)
    is part of it for filters that follow the gyro."""
)
REST_DRIFT_METRICS: tuple[Metric, ...] = (
    Metric(
        "drift_rest_deg_per_min",
        "Yaw drift at rest",
        "deg/min",
        "zero",
        _TEXT,
        resolution=RESOLUTION,
        wording=Wording("drifts", "less at rest", "more at rest", "drift at rest"),
        asked="rest",
    ),
)


@per_row
def rest_blocks(case: Case, row: Track, spans: tuple[Span, ...]) -> HeadingBlocks:
    """Return block means of a row's heading in one rest, deg."""
    resets_of = row_segments(case, row)
    t, e, label = [], [], []
    for k, segment in enumerate(s for span in spans for s in within(row.t, span, resets_of)):
        q = row.q[segment]
        if np.isfinite(q).all():
            t.append(row.t[segment])
            e.append(np.degrees(rotation.heading_angle(rotation.earth_error(q, rotation.mean(q)))))
            label.append(np.full(len(q), k))
    if not t:
        return HeadingBlocks(np.zeros(0), np.zeros(0), np.zeros(0, np.int64))
    return block_means(np.concatenate(t), np.concatenate(e), np.concatenate(label))


def _whole(case: Case, window: str) -> list[Span]:
    """Return the rests of a window."""
    whole = case.segments.spans("rest.long" if window == "rest.long" else "rest")
    return intersect(whole, case.segments.spans(window)) if ":" in window else whole


@per_row
def usable_rests(case: Case, row: Track, window: str) -> list[tuple[Span, tuple[Span, ...]]]:
    """Return each rest of a window with its settled spans."""
    whole = _whole(case, window)
    restarts = row.t[1:][np.diff(row.segment) != 0].tolist() if row.kind != "onboard" else []
    starts = [row.start, *restarts]
    usable = converged_spans(whole, case.segments, starts, DRIFT_AFTER_START_S)
    return [(span, tuple(spans)) for span, spans in zip(whole, usable, strict=True)]


def rests_of_window(case: Case, row: Track, window: str) -> Hashable:
    """Return the rests that a window means; the window itself where its name is in the reasons."""
    spans = _whole(case, window)
    return tuple(spans) if spans and ":" not in window else window


def rest_records(case: Case, row: Track, window: str) -> list[Drift]:
    """Return the drift of each rest of a window in time order."""
    found = []
    for (t0, t1), usable in usable_rests(case, row, window):
        one = fit_drift(rest_blocks(case, row, usable), DRIFT_REST_S)
        seconds = sum((b - a for a, b in usable), 0.0)
        reason = None if one.value is not None else _reason_rest_too_short(one, seconds)
        one.records = [SpanAnswer(t0, t1, seconds, one.value, one.ci95, reason)]
        found.append(one)
    return found


def _reason_rest_too_short(one: Drift, usable_s: float) -> str:
    if usable_s < DRIFT_REST_S - DRIFT_SLACK_S:
        return f"{usable_s:.0f} s after settling; {DRIFT_REST_S:.0f} are needed"
    return f"after settling {reason_too_short(one, DRIFT_REST_S)}"


@per_case
def long_enough(case: Case, window: str) -> int:
    """Return the number of rests long enough for a drift.

    For a row that runs from the log's first sample.
    """
    whole = _whole(case, window)
    starts = [t0 for t0, _ in case.segments.spans("all")]
    first = (
        model.restart_times(np.array([x for span in case.segments.spans("all") for x in span])[::2])
        if starts
        else starts
    )
    usable = converged_spans(whole, case.segments, [float(t) for t in first], DRIFT_AFTER_START_S)
    return sum(sum(b - a for a, b in spans) >= DRIFT_REST_S for spans in usable)


def compute_rest_drift(case: Case, row: Track, window: str) -> dict[str, Answer]:
    """Return the yaw drift of a row at rest."""
    found = rest_records(case, row, window)
    if not found:
        return REST_DRIFT.without(*reason_unavailable(case, "rest", window), window)
    pooled = pool_drifts(found)
    pooled.records = [r for one in found for r in one.records]
    if pooled.value is None:
        return {REST_DRIFT_METRICS[0].name: _none_long_enough(case, row, pooled, window)}
    shown, rests_of_log = sum(one.value is not None for one in found), long_enough(case, window)
    if shown < rests_of_log:
        reason = f"it is measured in {shown} of {rests_of_log} rests, and the rests of a log may disagree"
        answer = missing("not_covered", reason, "deg/min", window)
        answer.records = pooled.records
        return {REST_DRIFT_METRICS[0].name: answer}
    answer = drift_answer(pooled, window, "rest")
    return {REST_DRIFT_METRICS[0].name: following.unrank_frozen(case, row, "heading", answer)}


def _none_long_enough(case: Case, row: Track, pooled: Drift, window: str) -> Answer:
    """Return the answer if no rest is long enough."""
    longest = max(pooled.records, key=lambda r: r.usable_s)
    reason = f"the longest rest has {longest.reason}"
    turned = heading_change_deg(case, row, window)
    if turned is not None:
        reason += f"; between the first and the last rest the heading turned by {turned:+.1f} deg"
    answer = missing("rest_too_short", reason, "deg/min", window)
    answer.records = pooled.records
    return answer


def heading_change_deg(case: Case, row: Track, window: str) -> float | None:
    """Return the heading change from first to last rest in deg, None if unknown."""
    spans = intersect([whole for whole, _ in usable_rests(case, row, window)], [(row.start, np.inf)])
    if len(spans) < 2:
        return None
    means = [rotation.mean(row.q[w[0]]) for w in (within(row.t, s, row.segment) for s in (spans[0], spans[-1])) if w]
    if len(means) < 2 or not np.isfinite(means).all():
        return None
    return float(np.degrees(rotation.heading_angle(rotation.earth_error(means[1], means[0]))))


# Yaw drift in the air: slope of the heading error against each logged heading reference.

HEADING_REFERENCES = {
    "onboard": "the onboard heading",
    "truth": "the true heading (simulation or motion capture)",
    "smoother": "the smoothed heading",
    "mag": "the tilt-compensated magnetometer heading",
    "gnss_yaw": "the heading of a dual-antenna GNSS receiver",
    "yaw_estimator": "the heading that the autopilot finds from GNSS motion without a compass",
    "course": "the direction of the GNSS velocity of a plane (wind-compensated where its text says so)",
}
ABSENT = {
    "onboard": ("not_applicable", "the onboard attitude is not logged"),
    "truth": ("no_reference", "the log holds no ground truth"),
    "smoother": ("no_reference", "no smoothed attitude was built"),
    "mag": ("no_magnetometer", "the log holds no usable magnetometer heading"),
    "gnss_yaw": ("no_gnss", "the log holds no heading of a dual-antenna GNSS receiver"),
    "yaw_estimator": ("not_applicable", "the autopilot logged no valid yaw estimator, or the reference contradicts it"),
    "course": ("no_gnss", "needs GNSS velocity of a plane faster than 5 m/s"),
}
# Pitch above which the direction of the nose hardly determines the heading.
STEEP_RAD = math.radians(60.0)

AIR_DRIFT_METRICS: tuple[Metric, ...] = tuple(
    Metric(
        f"drift_air_deg_per_min.{name}",
        f"Yaw drift in the air against {name.replace('_', ' ')}",
        "deg/min",
        "zero",
        paragraph(
            f"""Mean slope of the row's heading error against {words}, airborne, after the scoring start, from 20 s on:
            1 s block means, cut at gaps and at resets of the heading reference; one group for each 10 s of the
            record, 4 to 12, each with its own offset; value = mean of the group slopes, interval = t over them (and
            2 sigma of a smoother over the record); the slope of the whole record where the heading is pulled back
            again and again. The drift is significant where the interval excludes zero, else
            bounded by its larger end: how the row drifts away from this heading reference, whose own drift counts
            too."""
        ),
        resolution=RESOLUTION,
        wording=Wording("drifts", "less in the air", "more in the air", "drift in the air"),
        covers=True,
    )
    for name, words in HEADING_REFERENCES.items()
)


def heading_error(row: Track, heading_reference: HeadingReference) -> tuple[Array, NDArray[np.int64]]:
    """Return a row's heading error in deg at the heading reference's times.

    With segment numbers; both (n,). NaN without an attitude within 0.5 s on each side or if the nose points steeply up
    or down.
    """
    q, before = rotation.slerp_in_segments(row.t, row.q, None, heading_reference.t)
    w, x, y, z = q.T
    nose = 2.0 * (w * y - z * x)  # the sine of the pitch
    heading = np.arctan2(2.0 * (w * z + x * y), 1.0 - 2.0 * (y * y + z * z))
    e = np.degrees(rotation.wrap(heading - np.radians(heading_reference.heading_deg)))
    after = np.clip(before + (row.t[before] < heading_reference.t), 1, max(len(row.t) - 1, 1))
    known = (len(row.t) > 1) & (np.abs(nose) < math.sin(STEEP_RAD))
    if len(row.t) > 1:
        known &= (row.t[after] - row.t[after - 1] < 0.5) & (row.segment[after] == row.segment[after - 1])
        labels = heading_reference.segment * (int(row.segment.max()) + 1) + row.segment[after]
    else:
        labels = heading_reference.segment
    return np.where(known, e, np.nan), labels


def error_blocks(case: Case, row: Track, name: str, window: str) -> HeadingBlocks | None:
    """Return block means of a heading error in scored flight."""
    spans = intersect(case.segments.spans("airborne"), case.segments.spans(window))
    return _error_blocks(case, row, name, spans)


@per_row
def _error_blocks(case: Case, row: Track, name: str, spans: list[tuple[float, float]]) -> HeadingBlocks | None:
    reference, heading_reference = case.reference, case.heading_references.get(name)
    if name == reference.kind and row.errors is not None:
        errors = row.errors
        keep = inside(errors.t, spans) & errors.scored
        return block_means(errors.t[keep], errors.heading[keep], split_at_steep(errors.segment, keep)[keep])
    if heading_reference is None:
        return None
    e, segment = heading_error(row, heading_reference)
    keep = (
        inside(heading_reference.t, spans)
        & (heading_reference.t >= reference.scoring.start)
        & (heading_reference.t <= reference.scoring.end)
    )
    return block_means(heading_reference.t[keep], e[keep], split_at_steep(segment, keep)[keep])


def split_at_steep(segment: NDArray[np.int64], keep: NDArray[np.bool_]) -> NDArray[np.int64]:
    """Return segments (n,) that also end where samples were left out."""
    return model.merge_numbers(segment, np.concatenate([[0], np.cumsum(~keep)])[: len(keep)])


def compute_air_drift(case: Case, row: Track, window: str) -> dict[str, Answer]:
    """Return a row's yaw drift in flight against each heading reference."""
    return {f"drift_air_deg_per_min.{name}": _against(case, row, name, window) for name in HEADING_REFERENCES}


def _against(case: Case, row: Track, name: str, window: str) -> Answer:
    reference = case.reference
    if name in reference.faults.refused:
        return missing("no_reference", reference.faults.refused[name], "deg/min", window)
    if name not in case.heading_references and name != reference.kind:
        return missing(*ABSENT[name], "deg/min", window)
    if name == "smoother" and reference.heading.by != "own":
        return missing("no_reference", reference.heading.why, "deg/min", window)
    if name == row.name or (row.is_reference and name == reference.kind):
        return missing("not_applicable", "this row is the heading reference itself", "deg/min", window)
    if not case.segments.spans("airborne"):
        return missing("not_covered", why_never_airborne(case), "deg/min", window)
    found = _air_drift(case, row, name, intersect(case.segments.spans("airborne"), case.segments.spans(window)))
    if found is None:
        return missing(
            "not_covered", f"there is no scored flight in common with {HEADING_REFERENCES[name]}", "deg/min", window
        )
    if found.value is None:
        reason = f"flight to compare with {HEADING_REFERENCES[name]}: {reason_too_short(found, DRIFT_AIR_S)}"
        return missing("record_too_short", reason, "deg/min", window)
    if name == reference.kind and found.ci95 is not None:
        per_min = 60.0 * own_sigma(case, "heading", window) / found.seconds
        found = replace(found, ci95=statistics.widen_by_reference(found.value, found.ci95, per_min))
    return drift_answer(found, window, name)


@per_row
def _air_drift(case: Case, row: Track, name: str, spans: list[Span]) -> Drift | None:
    """Return the drift against a heading reference in spans of flight; None without a common time."""
    blocks = _error_blocks(case, row, name, spans)
    return None if blocks is None or len(blocks.t) == 0 else fit_drift(blocks)


REST_DRIFT = MetricGroup(
    "drift at rest",
    "Yaw drift",
    REST_DRIFT_METRICS,
    compute_rest_drift,
    ("all", "rest", "rest.long"),
    rests_on=rests_of_window,
)
AIR_DRIFT = MetricGroup("drift in the air", "Yaw drift", AIR_DRIFT_METRICS, compute_air_drift, ("all", "airborne"))
METRIC_GROUPS = (REST_DRIFT, AIR_DRIFT)
