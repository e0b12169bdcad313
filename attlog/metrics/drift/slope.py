"""How fast does the heading drift? Mean slope of the heading error of a record, significant or bounded."""

from __future__ import annotations

import functools
import math
from dataclasses import dataclass, field, replace
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from attlog.base import rotation
from attlog.metrics.answer import Answer, SpanAnswer
from attlog.metrics.base import Resolution
from attlog.metrics.evidence.samples import DRIFT_AIR_S, DRIFT_SLACK_S
from attlog.metrics.statistics import intervals as interval
from attlog.metrics.statistics.quantiles import chi_square, student
from attlog.metrics.statistics.units import Ids, Summary, UnitValues, ids_of
from attlog.segments import gaps

Array = NDArray[np.float64]

BLOCK_S, FINE_BLOCK_S, FINE_BELOW_S = 1.0, 0.5, 20.0
"""Block means are over 1 s, over half a second in records under 20 s."""
GROUP_S, MIN_GROUPS, MAX_GROUPS = 10.0, 4, 12
"""A record makes one group for each 10 s, 4 at least and 12 at most."""
MIN_BLOCKS = 3
RESOLUTION = Resolution(60.0, "60 deg/min", "seconds")
"""An uncalibrated gyro turns by as much: 1 deg/s."""


@dataclass(slots=True)
class HeadingBlocks:
    """Block means: ``t`` s, ``e`` deg (unwrapped within a segment), ``segment`` counts segments; all (n,)."""

    t: Array
    e: Array
    segment: NDArray[np.int64]
    block_s: float = BLOCK_S
    slopes: dict[float, Drift] = field(default_factory=dict, repr=False, compare=False)
    """What :func:`slope` found, by the shortest record that it was asked for: several metrics ask for the same."""

    @property
    def seconds(self) -> float:
        """Time covered, s."""
        return len(self.t) * self.block_s


@dataclass(slots=True)
class Drift:
    """Mean drift of one record in deg/min. ``slopes`` are those of the groups, ``spans`` their times (s).

    ``value`` is None where the record is too short. ``changes`` holds the first and the
    last group slope where the slopes rise or fall steadily. ``wander`` is the RMS (deg)
    that remains when the mean slope and each segment's offset are taken away. Of several records
    together, ``range`` holds the least and the largest, and ``agree`` tells whether one drift explains them.
    """

    value: float | None
    ci95: interval.Interval | None
    slopes: Array
    spans: list[tuple[float, float]]
    seconds: float
    wander: float = math.nan
    changes: tuple[float, float] | None = None
    range: tuple[float, float] | None = None
    agree: bool = True
    records: list[SpanAnswer] = field(default_factory=list)

    @property
    def significant(self) -> bool:
        """Whether the interval excludes zero: there is a drift, however wide the interval."""
        return self.ci95 is not None and not self.ci95[0] <= 0.0 <= self.ci95[1]

    @property
    def less_than(self) -> float | None:
        """What the size of the drift stays below: the larger end of the interval, deg/min."""
        return None if self.ci95 is None else max(abs(self.ci95[0]), abs(self.ci95[1]))


def block_means(t: Array, e_deg: Array, segment: NDArray[np.int64]) -> HeadingBlocks:
    """Means over 1 s (0.5 s in short records) of a heading error (n,) in deg, unwrapped within each segment.

    ``t`` (n,) s ascending within a segment. A segment ends where the heading reference was reset, or at a gap:
    nothing is averaged across. Half-filled blocks are left out.
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
        full = np.flatnonzero(count > 0.5 * np.median(count[count > 0]))
        times.append(np.bincount(index, own_t)[full] / count[full])
        means.append(np.bincount(index, own_e)[full] / count[full])
        labels.append(np.full(len(full), label))
    if not times:
        return HeadingBlocks(np.zeros(0), np.zeros(0), np.zeros(0, np.int64))
    return HeadingBlocks(np.concatenate(times), np.concatenate(means), np.concatenate(labels), length)


def _segments(blocks: HeadingBlocks) -> list[slice]:
    """Which blocks belong to each segment; they lie together."""
    return gaps.slices(np.ones(len(blocks.t), bool), blocks.segment)


def slope(blocks: HeadingBlocks, shortest_s: float = DRIFT_AIR_S) -> Drift:
    """The mean drift of a record and its interval: t over the slopes of groups (Ibragimov & Mueller 2010).

    One group for each 10 s of the record, 4 to 12; each segment is cut into
    max(1, round(segment / (record / groups))) equal ones, each with its own offset; groups under 3 blocks are left
    out. Fewer than 4 groups or less than ``shortest_s``: no value.
    """
    if shortest_s not in blocks.slopes:
        blocks.slopes[shortest_s] = _slope(blocks, shortest_s)
    return replace(blocks.slopes[shortest_s])


def _slope(blocks: HeadingBlocks, shortest_s: float) -> Drift:
    record = blocks.seconds
    target = record / min(max(round(record / GROUP_S), MIN_GROUPS), MAX_GROUPS)
    slopes, spans = [], []
    for own in _segments(blocks):
        length = own.stop - own.start
        for part in interval.equal_groups(length, max(1, round(length * blocks.block_s / target))):
            t, e = blocks.t[own][part], blocks.e[own][part]
            if len(t) >= MIN_BLOCKS:
                slopes.append(60.0 * _line(t, e))
                spans.append((float(t[0]), float(t[-1])))
    found = Drift(None, None, np.array(slopes), spans, record)
    if len(slopes) < MIN_GROUPS or record < shortest_s - DRIFT_SLACK_S:
        return found
    found.value = float(np.mean(slopes))
    found.ci95 = interval.of_mean(slopes)
    found.wander = math.sqrt(float(np.mean(without_slope(blocks, found.value) ** 2)))
    rises = np.diff(slopes)
    width = found.ci95[1] - found.ci95[0] if found.ci95 else math.inf
    if ((rises > 0).all() or (rises < 0).all()) and abs(slopes[-1] - slopes[0]) > width:
        found.changes = (slopes[0], slopes[-1])
    return found


def without_slope(blocks: HeadingBlocks, deg_per_min: float) -> Array:
    """The heading error (n,) in deg without a drift and without each segment's own offset."""
    rest = blocks.e - deg_per_min / 60.0 * blocks.t
    for own in _segments(blocks):
        rest[own] -= np.mean(rest[own])
    return rest


def line(blocks: HeadingBlocks) -> Array:
    """The least-squares line (n,) with one slope and an offset per segment: for the eye, never quoted as the drift."""
    u, v = blocks.t.copy(), blocks.e.copy()
    for own in _segments(blocks):
        u[own] -= np.mean(u[own])
        v[own] -= np.mean(v[own])
    spread = float(u @ u)
    return blocks.e - v + (float(u @ v) / spread if spread > 0 else 0.0) * u


def together(records: list[Drift]) -> Drift:
    """Several records of one log as one: the mean weighted by their length.

    Where the records agree (chi-squared of their values, 95 %) the interval is that of
    the weighted mean (Satterthwaite degrees of freedom); where they do not they are not pooled: the
    interval spans all of theirs, and ``range`` holds the least and the largest.
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
        float(np.sqrt(weight @ np.array([r.wander**2 for r in usable]))),
        range=(float(values.min()), float(values.max())),
        agree=bool(agree),
    )


def _line(t: Array, e: Array) -> float:
    u = t - t.sum() / len(t)
    return float(u @ (e - e.sum() / len(e))) / float(u @ u)


def too_short(found: Drift, shortest_s: float) -> str:
    """Why a record gives no drift: its time, or the segments it is broken into."""
    if found.seconds < shortest_s - DRIFT_SLACK_S:
        return f"{found.seconds:.0f} s; {shortest_s:.0f} are needed"
    return f"{found.seconds:.0f} s in segments too short for {MIN_GROUPS} slopes"


def answer(found: Drift, window: str, against: str) -> Answer:
    """The Answer of a drift that has a value: significant or bounded, never "not measurable"."""
    reason = None
    if found.range is not None and not found.agree:
        reason = f"the rests of this log disagree: {found.range[0]:+.2f} to {found.range[1]:+.2f} deg/min"
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
        detail={
            "slopes": [float(s) for s in found.slopes],
            "significant": found.significant,
            "less_than": found.less_than,
            "wander_deg": found.wander,
            **({} if found.range is None else {"range": list(found.range)}),
        },
        records=found.records,
        disagree=None if found.agree else found.range,
        changes=found.changes,
        units=_units(found),
    )


def _units(found: Drift) -> UnitValues | None:
    """The slopes of the groups, paired between rows by the times at which their groups begin."""
    ids = ids_of([start for start, _ in found.spans])
    if found.value is None or len(set(ids.tolist())) < len(ids):
        return None
    whole = Summary(found.value, found.ci95)
    return UnitValues("slope_group", ids, found.slopes, functools.partial(_on, ids, found.slopes, whole))


def _on(ids: Ids, slopes: Array, whole: Summary, wanted: Ids) -> Summary:
    """The drift on some of a record's groups; on all of them what it was."""
    chosen = np.isin(ids, wanted)
    if chosen.all():
        return whole
    return Summary(float(np.mean(slopes[chosen])), interval.of_mean(slopes[chosen]))
