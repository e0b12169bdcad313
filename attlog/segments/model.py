"""Segments of a flight with their reasons, and the gaps between continuous ones."""

from __future__ import annotations

import math
from bisect import bisect_left, bisect_right
from collections.abc import Iterable, Iterator
from dataclasses import dataclass, field
from itertools import pairwise
from operator import attrgetter
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

from attlog.core import rotation, spans, timestamps
from attlog.core.brief import brief
from attlog.core.spans import Span
from attlog.segments.airborne import InAir
from attlog.segments.impacts import CrashEvent

Array = NDArray[np.float64]

KINDS = (
    "continuous",
    "rest.long",
    "rest.short",
    "idle",
    "armed",
    "airborne",
    "hover",
    "cruise",
    "loss_of_control",
    "impact",
    "wreck",
    "reset",
    "gap",
)
WINDOWS = ("all", "rest", "rest.long", "idle", "armed", "airborne", "hover", "cruise")


@dataclass(frozen=True, slots=True)
class Segment:
    """Segment [t0, t1] in s on the log's clock; ``why`` is a sentence with numbers."""

    kind: str
    t0: float
    t1: float
    why: str = ""

    @property
    def seconds(self) -> float:
        """Length in s."""
        return self.t1 - self.t0


@dataclass(slots=True)
class Segments:
    """All segments of a log.

    ``notes``: source of each phase, by kind. ``unknown``: phases (armed, airborne) that the log does not show. ``air``:
    signs of flight, None without sensors. ``crash_events``: crashes and hard landings in time order.
    """

    segments: list[Segment] = field(default_factory=list)
    notes: dict[str, str] = field(default_factory=dict)
    unknown: tuple[str, ...] = ()
    air: InAir | None = None
    crash_events: list[CrashEvent] = field(default_factory=list)
    __repr__ = brief

    def seconds(self, kind: str) -> float | None:
        """Return the total length of a kind in s, None where it is not logged."""
        return None if kind in self.unknown else float(sum(s.seconds for s in self.of(kind)))

    def of(self, kind: str) -> list[Segment]:
        """Return the segments of a kind in time order; ``rest`` means long and short."""
        kinds = ("rest.long", "rest.short") if kind == "rest" else (kind,)
        return sorted([s for s in self.segments if s.kind in kinds], key=attrgetter("t0"))

    def spans(self, window: str) -> list[tuple[float, float]]:
        """Return (t0, t1) pairs of a ``--window``: a name of WINDOWS or ``T0:T1`` in s. ValueError otherwise."""
        if window == "all":
            return [(s.t0, s.t1) for s in self.of("continuous")]
        if window in WINDOWS:
            return [(s.t0, s.t1) for s in self.of(window)]
        start, colon, end = window.partition(":")
        try:
            span = (float(start), float(end)) if colon else None
        except ValueError:
            span = None
        if span is None or not -math.inf < span[0] < span[1] < math.inf:
            raise ValueError(f"window {window!r}: use {', '.join(WINDOWS)} or T0:T1 in seconds with T0 < T1")
        return [span]

    def mask(self, t: Array, window: str) -> NDArray[np.bool_]:
        """Mark the times (n,) inside a window."""
        return spans.inside(t, self.spans(window))


# --- gaps --------------------------------------------------------------------------------------------------------

T = TypeVar("T", bound=np.generic)


def sample_rate(t: Array) -> float:
    """Return the sample rate in Hz of times (n,) s outside gaps, 0 for fewer than two."""
    dt = np.diff(t)
    dt = dt[(dt > 0) & (dt <= timestamps.gap_limit_of_times(t))]
    return len(dt) / float(np.sum(dt)) if len(dt) else 0.0


def number_segments(t: Array, limit: float | None = None) -> NDArray[np.int64]:
    """Return the segment number (n,) of each time; a gap or backward step starts a new one."""
    if len(t) == 0:
        return np.zeros(0, np.int64)
    dt = np.diff(t)
    broken = ~((dt >= 0) & (dt <= (timestamps.MIN_GAP_S if limit is None else limit)))
    found = np.zeros(len(t), np.int64)
    if limit is None and broken.any():
        broken = ~((dt >= 0) & (dt <= timestamps.gap_limit_of_times(t)))
    if broken.any():
        np.cumsum(broken, out=found[1:])
    return found


def merge_numbers(*numbers: NDArray[np.int64]) -> NDArray[np.int64]:
    """Return segment numbers (n,) that increase wherever any input number changes.

    Returns the first array itself if equal, to save memory: read only.
    """
    if len(numbers[0]) == 0:
        return np.zeros(0, np.int64)
    changed = np.zeros(len(numbers[0]), bool)
    for n in numbers:
        changed[1:] |= n[1:] != n[:-1]
    found = np.cumsum(changed) if changed.any() else np.zeros(len(changed), np.int64)
    return numbers[0] if np.array_equal(found, numbers[0]) else found


def segment_slices(inside: NDArray[np.bool_], number: NDArray[np.int64]) -> list[slice]:
    """Return slices of consecutive samples inside a mask with one segment number."""
    if len(inside) == 0:
        return []
    edges = np.flatnonzero((inside[1:] != inside[:-1]) | (np.diff(number) != 0)) + 1
    bounds = [0, *edges.tolist(), len(inside)]
    return [slice(a, b) for a, b in pairwise(bounds) if inside[a]]


def select_good(good: NDArray[np.bool_], *arrays: NDArray[T]) -> tuple[NDArray[T], ...]:
    """Return the samples of arrays (n, ...) selected by a mask.

    Views without a copy where one contiguous majority is good: read only.
    """
    if good.all():
        return arrays
    begin, end = int(good.argmax()), len(good) - int(good[::-1].argmax())
    if 2 * (end - begin) > len(good) and good[begin:end].all():
        return tuple(x[begin:end] for x in arrays)
    return tuple(x[good] for x in arrays)


def select_rising(t: Array, x: Array) -> tuple[Array, Array]:
    """Return finite samples (m,), (m, k) whose times strictly increase.

    Returns the arrays themselves if all samples qualify.
    """
    good = np.isfinite(t) & rotation.finite_rows(x)
    if good.all() and (t[1:] > t[:-1]).all():
        return t, x
    highest = np.maximum.accumulate(np.where(good, t, -np.inf))
    good[1:] &= highest[1:] > highest[:-1]
    t, x = select_good(good, t, x)
    return t, x


def interpolate_attitudes(t: Array, q: Array, segment: NDArray[np.int64], at: Array) -> tuple[Array, NDArray[np.int64]]:
    """Return attitudes (m, 4) at times ``at`` and their segments (m,).

    ``t`` (n,) ascending, ``q`` (n, 4), ``segment`` (n,). Slerp between two samples of one segment; NaN and -1
    elsewhere.
    """
    out, before = rotation.slerp_in_segments(t, q, segment, at)
    return out, np.where(before >= 0, segment[before], -1) if len(t) else before


def find_continuous(t: Array, replayed: bool = True) -> list[Segment]:
    """Return continuous segments and the gaps between them from times (n,) of the replayed IMU.

    ``replayed``: False for times of the onboard attitude, in a log without an IMU for a filter.
    """
    if len(t) < 2:
        return []
    limit = timestamps.gap_limit_of_times(t)
    own = number_segments(t, limit)
    first = np.flatnonzero(np.concatenate([[True], np.diff(own) > 0]))
    last = np.append(first[1:], len(t)) - 1
    found = [
        Segment("continuous", float(t[a]), float(t[b]), f"{b - a + 1} samples, no interval above {1e3 * limit:.0f} ms")
        for a, b in zip(first, last, strict=True)
        if t[b] > t[a]
    ]
    for a, b in zip(last[:-1], first[1:], strict=True):
        seconds = float(t[b] - t[a])
        if seconds > 0:
            then = "a filter restarts" if seconds > timestamps.MAX_BRIDGED_GAP_S else "a filter integrates across"
            why = f"no IMU sample for {seconds:.2f} s; {then}" if replayed else f"no attitude for {seconds:.2f} s"
            found.append(Segment("gap", float(t[a]), float(t[b]), why))
    return found


def restart_times(t: Array) -> Array:
    """Return times (k,) of filter restarts: the first sample and those after long gaps."""
    if len(t) == 0:
        return np.zeros(0)
    dt = np.diff(t)
    began: Array = t[np.concatenate([[True], ~((dt >= 0) & (dt <= timestamps.MAX_BRIDGED_GAP_S))])]
    return began


# --- converged time ----------------------------------------------------------------------------------------------

CONVERGED_AFTER_MOTORS_S = 5.0  # filter states still contain vibration errors
# Observed: filters change their heading for 20 s after their start.
DRIFT_AFTER_START_S = 20.0


def converged_spans(
    each: Iterable[Span], segments: Segments, starts: Iterable[float], after_start_s: float
) -> Iterator[list[Span]]:
    """Yield the converged parts of each span.

    Excludes ``after_start_s`` after each of ``starts`` (first attitude and restarts), all time before the first start,
    and 5 s after each armed, airborne or idle segment.
    """
    began = sorted(starts)
    if not began:
        yield from ([] for _ in each)
        return
    stopped = [s.t1 for kind in ("armed", "airborne", "idle") for s in segments.of(kind)]
    unsettled = [(-np.inf, began[0]), *((t, t + after_start_s) for t in began)]
    unsettled += [(t, t + CONVERGED_AFTER_MOTORS_S) for t in stopped]
    free = spans.complement(unsettled, -np.inf, np.inf)
    begins, ends = [t0 for t0, _ in free], [t1 for _, t1 in free]
    for t0, t1 in each:
        overlapping = free[bisect_right(ends, t0) : bisect_left(begins, t1)]
        yield [(max(t0, a), min(t1, b)) for a, b in overlapping]
