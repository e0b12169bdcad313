"""How fast does the heading drift? Mean slope of the heading error, at rest and in the air."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from itertools import pairwise
from typing import Any

import numpy as np
from numpy.typing import NDArray

from attlog.metrics import interval
from attlog.metrics.answer import Answer, missing
from attlog.metrics.evidence import DRIFT_RECORD_S, DRIFT_SLACK_S
from attlog.metrics.quantiles import chi_square, student

Array = NDArray[np.float64]

BLOCK_S = 1.0
MIN_GROUPS = 4
MIN_BLOCKS = 3
SHORTEST_S = DRIFT_RECORD_S
"""4 groups of 5 s."""
LONG_S = 120.0
NOT_MEASURABLE = 5.0
"""Half-width in deg/min beyond which a drift is shown as not measurable."""


@dataclass(slots=True)
class Blocks:
    """Block means: ``t`` s, ``e`` deg (unwrapped within a segment), ``segment`` counts segments; all (n,)."""

    t: Array
    e: Array
    segment: NDArray[np.int64]

    @property
    def seconds(self) -> float:
        """Time covered, s."""
        return len(self.t) * BLOCK_S


@dataclass(slots=True)
class Drift:
    """Mean drift of one record in deg/min. ``slopes`` are those of the groups, ``spans`` their times (s).

    ``value`` is None where the record is too short. ``changes`` holds the first and the
    last group slope where the slopes rise or fall steadily. ``wander`` is the RMS (deg)
    that remains when the mean slope and each segment's offset are taken away.
    """

    value: float | None
    ci95: interval.Interval | None
    slopes: Array
    spans: list[tuple[float, float]]
    seconds: float
    wander: float = math.nan
    changes: tuple[float, float] | None = None
    notes: dict[str, Any] = field(default_factory=dict)


def block_means(t: Array, e_deg: Array, segment: NDArray[np.int64]) -> Blocks:
    """Means over 1 s of a heading error (n,) in deg, unwrapped within each segment; half-filled blocks are left out.

    ``t`` (n,) s ascending within a segment. A segment ends where the heading reference was reset, at
    a gap, or where a run ends: nothing is averaged across.
    """
    good = np.isfinite(e_deg)
    t, e_deg, segment = t[good], e_deg[good], segment[good]
    times, means, labels = [], [], []
    edges = np.concatenate([[0], np.flatnonzero(np.diff(segment) != 0) + 1, [len(t)]])
    for label, (i, j) in enumerate(pairwise(edges)):
        if j - i < 2:
            continue
        own_t, own_e = t[i:j], np.unwrap(e_deg[i:j], period=360.0)
        index = np.floor((own_t - own_t[0]) / BLOCK_S).astype(int)
        count = np.bincount(index)
        full = np.flatnonzero(count > 0.5 * np.median(count[count > 0]))
        times.append(np.bincount(index, own_t)[full] / count[full])
        means.append(np.bincount(index, own_e)[full] / count[full])
        labels.append(np.full(len(full), label))
    if not times:
        return Blocks(np.zeros(0), np.zeros(0), np.zeros(0, np.int64))
    return Blocks(np.concatenate(times), np.concatenate(means), np.concatenate(labels))


def slope(blocks: Blocks) -> Drift:
    """The mean drift of a record and its interval: t over the slopes of groups (Ibragimov & Mueller 2010).

    Target length of a group: a quarter of the record (a sixth from 120 s on); each
    segment is cut into max(1, round(segment / target)) equal groups, each with its own
    offset; groups under 3 blocks are left out. Fewer than 4 groups or 20 s: no value.
    """
    record = blocks.seconds
    target = record / (6.0 if record >= LONG_S else 4.0)
    slopes, spans = [], []
    for label in np.unique(blocks.segment):
        own = np.flatnonzero(blocks.segment == label)
        for part in interval.equal_groups(len(own), max(1, round(len(own) * BLOCK_S / target))):
            at = own[part]
            if len(at) >= MIN_BLOCKS:
                slopes.append(60.0 * _line(blocks.t[at], blocks.e[at]))
                spans.append((float(blocks.t[at[0]]), float(blocks.t[at[-1]])))
    found = Drift(None, None, np.array(slopes), spans, record)
    if len(slopes) < MIN_GROUPS or record < SHORTEST_S - DRIFT_SLACK_S:
        return found
    found.value = float(np.mean(slopes))
    found.ci95 = interval.of_mean(slopes)
    found.wander = math.sqrt(float(np.mean(without_slope(blocks, found.value) ** 2)))
    rises = np.diff(slopes)
    width = found.ci95[1] - found.ci95[0] if found.ci95 else math.inf
    if ((rises > 0).all() or (rises < 0).all()) and abs(slopes[-1] - slopes[0]) > width:
        found.changes = (slopes[0], slopes[-1])
    return found


def without_slope(blocks: Blocks, deg_per_min: float) -> Array:
    """The heading error (n,) in deg without a drift and without each segment's own offset."""
    rest = blocks.e - deg_per_min / 60.0 * blocks.t
    for label in np.unique(blocks.segment):
        own = blocks.segment == label
        rest[own] -= np.mean(rest[own])
    return rest


def line(blocks: Blocks) -> Array:
    """The least-squares line (n,) with one slope and an offset per segment: for the eye, never quoted as the drift."""
    u, v = blocks.t.copy(), blocks.e.copy()
    for label in np.unique(blocks.segment):
        own = blocks.segment == label
        u[own] -= np.mean(u[own])
        v[own] -= np.mean(v[own])
    spread = float(u @ u)
    return blocks.e - v + (float(u @ v) / spread if spread > 0 else 0.0) * u


def together(records: list[Drift]) -> Drift:
    """Several records of one log as one: the mean weighted by their length.

    Where the records agree (chi-squared of their values, 95 %) the interval is that of
    the weighted mean (Satterthwaite degrees of freedom); where they do not, it spans
    all their intervals and ``notes["agree"]`` is False.
    """
    usable = [r for r in records if r.value is not None and r.ci95 is not None]
    if len(usable) <= 1:
        return usable[0] if usable else max(records, key=lambda r: r.seconds)
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
        notes={"agree": bool(agree), "range": [float(values.min()), float(values.max())], "records": len(usable)},
    )


def _line(t: Array, e: Array) -> float:
    u = t - np.mean(t)
    return float(u @ (e - np.mean(e))) / float(u @ u)


def too_short(found: Drift, heading_reference: str) -> str:
    """Why a record gives no drift: its time, or the pieces it is broken into."""
    what = "of usable rest" if heading_reference == "rest" else f"of flight comparable with {heading_reference}"
    if found.seconds < SHORTEST_S - DRIFT_SLACK_S:
        return f"{found.seconds:.0f} s {what}; {SHORTEST_S:.0f} s are needed"
    return f"{found.seconds:.0f} s {what} in pieces too short for {MIN_GROUPS} slopes"


def answer(found: Drift, window: str, heading_reference: str) -> Answer:
    """The Answer of a drift: too short, not measurable, disagreeing, or a value with its interval."""
    if found.value is None or found.ci95 is None:
        return missing("record_too_short", too_short(found, heading_reference), "deg/min", window)
    half = 0.5 * (found.ci95[1] - found.ci95[0])
    reason = None
    if half > NOT_MEASURABLE:
        reason = f"not measurable: the interval is +-{half:.1f} deg/min"
    elif found.notes.get("agree") is False:
        low, high = found.notes["range"]
        reason = f"the rests of this log disagree: {low:+.2f} to {high:+.2f} deg/min"
    detail: dict[str, Any] = {
        "slopes": [float(s) for s in found.slopes],
        "covers_zero": found.ci95[0] <= 0.0 <= found.ci95[1],
        "wander_deg": found.wander,
        **found.notes,
    }
    if found.changes is not None:
        detail["changes"] = list(found.changes)
    return Answer(
        found.value,
        "deg/min",
        window,
        len(found.slopes),
        found.seconds,
        found.ci95,
        f"mean slope of {len(found.slopes)} groups of 1 s block means against {heading_reference}, t interval over the groups",
        reason=reason,
        ranked=reason is None,
        detail=detail,
    )
