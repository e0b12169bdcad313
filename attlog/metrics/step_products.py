"""Columns of the lag fit: turning rates of row and reference at a delay, and sums of their products.

Both attitudes lie on one time axis, event after event; the faster one is interpolated at the slower one's samples.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from itertools import pairwise
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from attlog.core import jit
from attlog.core.jit import F1, F2, I1, IOut1, Out2, Out3
from attlog.estimators.vectors import GRAVITY
from attlog.metrics import step_sensors
from attlog.metrics.step_sensors import RowSensors
from attlog.metrics.step_turning import (
    EventIndex,
    StepEvent,
    SummedTurning,
    about_axes,
    around,
    event_places,
    stack_events,
)

Array = NDArray[np.float64]
Index = NDArray[np.int64]


# Columns: rate of the row, slope, rate of the reference, its product with the axis (3), aiding (6).
COLUMNS = 12
# Most that is moved by the delay: seven columns of the row, two free, the slope.
MOVED_COLUMNS = 9
# Samples per event that locate the largest correlation.
COARSE_SAMPLES = 60


def next_index(t: Array, at: float, i: int) -> int:
    """Return the first number from ``i`` on whose time is not before ``at``; at least 1, at most the last."""
    i = max(i, 1)
    while i < len(t) - 1 and t[i] < at:
        i += 1
    return i


@jit.loop("the fit of steps")
def event_products(
    out: Out3,
    count: IOut1,
    moved: Out2,
    rows: Out2,
    slow_t: F1,
    slow_x: F2,
    fast_t: F1,
    fast_x: F2,
    main: F1,
    low: F1,
    high: F1,
    begin: I1,
    end: I1,
    first: I1,
    shift: float,
    slope: float,
    slow_row: int,
) -> None:
    """Fill ``out`` (events, 12, 12) with products of the columns centred per event, ``count`` (events,) with lines.

    Columns of a pair of samples ``begin``, ``end`` (pairs,) of the slower one: rate of the row, slope over +-``slope``
    s of ``main``, rate of the reference and its product with the axis, aiding. Event e has the pairs ``first[e]`` to
    ``first[e + 1]``; those reaching beyond ``low[e]`` or ``high[e]`` are left out. ``moved`` (samples of the longest
    event, 9) and ``rows`` (its pairs, 12) are room.
    """
    wide, wide_fast = slow_x.shape[1], fast_x.shape[1]
    last = len(fast_t) - 1
    for e in range(len(count)):
        count[e] = 0
        a, b = first[e], first[e + 1]
        for i in range(12):
            for j in range(12):
                out[e, i, j] = 0.0
        if a == b:
            continue
        start, left, right = begin[a], 0, last
        while left < right:  # bisection: where the event begins in the faster one
            middle = (left + right) // 2
            if fast_t[middle] < low[e]:
                left = middle + 1
            else:
                right = middle
        here = ahead = behind = left
        for k in range(start, end[b - 1] + 1):
            at = slow_t[k] + shift
            if at - slope < low[e] or at + slope > high[e]:
                continue
            here, ahead = next_index(fast_t, at, here), next_index(fast_t, at + slope, ahead)
            behind = next_index(fast_t, at - slope, behind)
            share = (at - fast_t[here - 1]) / (fast_t[here] - fast_t[here - 1])
            for j in range(wide_fast):
                moved[k - start, j] = fast_x[here - 1, j] + share * (fast_x[here, j] - fast_x[here - 1, j])
            steep = (main[ahead] - main[ahead - 1]) / (fast_t[ahead] - fast_t[ahead - 1])
            top = steep * (at + slope - fast_t[ahead - 1]) + main[ahead - 1]
            steep = (main[behind] - main[behind - 1]) / (fast_t[behind] - fast_t[behind - 1])
            bottom = steep * (at - slope - fast_t[behind - 1]) + main[behind - 1]
            moved[k - start, 8] = (top - bottom) / (2.0 * slope)
        lines = 0
        for p in range(a, b):
            i, j = begin[p], end[p]
            if slow_t[i] + shift - slope < low[e] or slow_t[j] + shift + slope > high[e]:
                continue
            span = slow_t[j] - slow_t[i]
            rows[lines, 1] = (moved[j - start, 8] - moved[i - start, 8]) / span
            for c in range(wide):
                place = (c + 5 if c > 0 else 0) if slow_row == 1 else c + 2
                rows[lines, place] = (slow_x[j, c] - slow_x[i, c]) / span
            for c in range(wide_fast):
                place = c + 2 if slow_row == 1 else (c + 5 if c > 0 else 0)
                rows[lines, place] = (moved[j - start, c] - moved[i - start, c]) / span
            lines += 1
        count[e] = lines
        for c in range(12):
            total = 0.0
            for k in range(lines):
                total += rows[k, c]
            for k in range(lines):
                rows[k, c] -= total / lines
        for k in range(lines):
            for i in range(12):
                for j in range(i, 12):
                    out[e, i, j] += rows[k, i] * rows[k, j]
        for i in range(12):
            for j in range(i):
                out[e, i, j] = out[e, j, i]


@jit.loop("the coarse fit of steps")
def rate_products(
    out: Out2,
    x: Out2,
    sums: Out2,
    delays: F1,
    slow_t: F1,
    slow_x: F1,
    fast_t: F1,
    fast_x: F1,
    begin: I1,
    end: I1,
    of: I1,
) -> None:
    """Fill ``out`` (delays, 3) with sums of squares of two rates, centred per event, and of their product.

    The first is that of the faster one, at each of ``delays`` [s], the second that of the slower one.

    ``slow_x``, ``fast_x`` (n,) are what both have turned, ``begin``, ``end`` (pairs,) samples of the slower one, ``of``
    their events. ``x`` (2, pairs) and ``sums`` (3, events) are room.
    """
    last, pairs = len(fast_t) - 1, len(begin)
    for g in range(-1, len(delays)):
        row = 0 if g < 0 else 1
        i, j = 1, 1
        for e in range(sums.shape[1]):
            sums[2, e], sums[row, e] = 0.0, 0.0
        for p in range(pairs):
            a, b = slow_t[begin[p]], slow_t[end[p]]
            if g < 0:
                turned = slow_x[end[p]] - slow_x[begin[p]]
            else:
                i, j = next_index(fast_t, a + delays[g], i), next_index(fast_t, b + delays[g], j)
                at = min(max(a + delays[g], fast_t[0]), fast_t[last])
                share = (fast_x[i] - fast_x[i - 1]) / (fast_t[i] - fast_t[i - 1])
                turned = -(share * (at - fast_t[i - 1]) + fast_x[i - 1])
                at = min(max(b + delays[g], fast_t[0]), fast_t[last])
                share = (fast_x[j] - fast_x[j - 1]) / (fast_t[j] - fast_t[j - 1])
                turned += share * (at - fast_t[j - 1]) + fast_x[j - 1]
            x[row, p] = turned / (b - a)
            sums[row, of[p]] += x[row, p]
            sums[2, of[p]] += 1.0
        for p in range(pairs):
            x[row, p] -= sums[row, of[p]] / sums[2, of[p]]
        if g >= 0:
            xx, yy, xy = 0.0, 0.0, 0.0
            for p in range(pairs):
                xx, yy, xy = xx + x[1, p] * x[1, p], yy + x[0, p] * x[0, p], xy + x[1, p] * x[0, p]
            out[g, 0], out[g, 1], out[g, 2] = xx, yy, xy


@dataclass(slots=True)
class EventTurning:
    """Columns (n, k) of summed turning of one attitude at ``t`` (n,) on the common time axis."""

    t: Array
    x: Array
    # (events,) first and last time of each event.
    low: Array
    high: Array
    # The first column (n,), the turning about the events' axes, without the others between its values.
    about: Array = field(init=False)

    def __post_init__(self) -> None:
        self.about = np.ascontiguousarray(self.x[:, 0])


@dataclass(slots=True)
class FitColumns:
    """Columns of some events of one row. ``slow_row``: the reference is the one that is moved.

    ``begin`` and ``end`` (pairs,) number the samples of the slower one between which a rate is taken, ``of`` (pairs,)
    the event.
    """

    slow: EventTurning
    fast: EventTurning
    slow_row: bool
    begin: NDArray[np.int64]
    end: NDArray[np.int64]
    of: NDArray[np.int64]
    # Of how many samples the specific force exceeds 2 g.
    heavy: int

    @property
    def nbytes(self) -> int:
        """Memory of the columns."""
        arrays = (self.slow.t, self.slow.x, self.fast.t, self.fast.x, self.begin, self.end, self.of)
        return sum(x.nbytes for x in arrays)

    def products(self, delay: float, slope_s: float, aids: Array) -> tuple[Array, NDArray[np.int64]]:
        """Return sums of products (events, 12, 12) of the centred columns, and lines per event (events,).

        At a delay in s. The slope is taken over +-``slope_s`` of what the delay moves: the row's rate without its
        aiding of gains ``aids`` (6,), or the reference's rate.
        """
        bare = self.slow_row or not aids.any()
        main = self.fast.about if bare else self.fast.about - self.fast.x[:, 1:] @ aids
        events, first = len(self.slow.low), np.searchsorted(self.of, np.arange(len(self.slow.low) + 1))
        out, count = np.zeros((events, COLUMNS, COLUMNS)), np.zeros(events, np.int64)
        some = np.flatnonzero(np.diff(first))
        if len(some) == 0:
            return out, count
        samples = self.end[first[some + 1] - 1] - self.begin[first[some]] + 1
        event_products(
            out,
            count,
            np.empty((samples.max(), MOVED_COLUMNS)),
            np.empty((np.diff(first).max(), COLUMNS)),
            self.slow.t,
            self.slow.x,
            self.fast.t,
            self.fast.x,
            main,
            self.fast.low,
            self.fast.high,
            self.begin,
            self.end,
            first,
            -delay if self.slow_row else delay,
            slope_s,
            int(self.slow_row),
        )
        return out, count

    def rate_products(self, delays: Array) -> Array:
        """Return squares of both rates about the axes and their product (n, 3), at delays (n,) s.

        Summed over some of the samples, centred per event.
        """
        out, events = np.zeros((len(delays), 3)), len(self.slow.low)
        step = max(1, len(self.begin) // (COARSE_SAMPLES * events))
        begin, end, of = (np.ascontiguousarray(x[::step]) for x in (self.begin, self.end, self.of))
        rate_products(
            out,
            np.empty((2, len(begin))),
            np.empty((3, events)),
            -delays if self.slow_row else delays,
            self.slow.t,
            self.slow.about,
            self.fast.t,
            self.fast.about,
            begin,
            end,
            of,
        )
        return out


# All steps of one row as columns for the fit of its lag, some at a time: of thousands the columns are not kept.

# A rate is taken over this time, at least two samples of the slower one.
SPAN_S = 0.060
# So far beyond an event's window the faster one is needed: delays of 250 ms, their slope and a sample.
MARGIN_S = 0.30
# Events are laid behind each other on one time axis; none lasts that long.
STRIDE_S = 64.0
HEAVY_M_S2 = 2.0 * GRAVITY
# Samples of row and reference whose columns are made at once.
BATCH_SAMPLES = 1 << 15
# Columns up to this size are kept, as of 40 minutes full of steps; those beyond are made anew for each delay.
MAX_KEPT_BYTES = 64_000_000
MIN_PAIRS = 4  # fewer rates fit nothing


class EventRanges(NamedTuple):
    """An event that row and reference show without a gap: their samples, its ``axis`` (3,) in the body."""

    event: StepEvent
    row: slice
    ref: slice
    axis: Array


@dataclass(slots=True)
class EventBatches:
    """Events covered by both attitudes, in groups; ``slow_row``: the reference is the one moved."""

    row: SummedTurning
    ref: SummedTurning
    covered: list[EventRanges]
    sensors: RowSensors | None
    slow_row: bool
    # Which of the events each group has.
    bounds: list[slice] = field(init=False)
    _kept: dict[int, FitColumns] = field(default_factory=dict)
    _heavy: dict[int, int] = field(default_factory=dict)
    _room: int = MAX_KEPT_BYTES

    def __post_init__(self) -> None:
        sizes: NDArray[np.int64] = np.cumsum(
            [c.row.stop - c.row.start + c.ref.stop - c.ref.start for c in self.covered]
        )
        edges = np.flatnonzero(np.diff((sizes - 1) // BATCH_SAMPLES)) + 1
        ends = [0, *edges.tolist(), len(self.covered)]
        self.bounds = [slice(a, b) for a, b in pairwise(ends)]

    @property
    def events(self) -> list[StepEvent]:
        """Return the events themselves."""
        return [c.event for c in self.covered]

    @property
    def heavy(self) -> float:
        """Share of the row's samples with a specific force above 2 g, after :meth:`products`."""
        return sum(self._heavy.values()) / sum(int(c.row.stop - c.row.start) for c in self.covered)

    def enough(self) -> bool:
        """Return whether there are rates to compare."""
        pairs = 0
        for columns in self.each():
            pairs += len(columns.begin)
            if pairs >= MIN_PAIRS:
                return True
        return False

    def each(self) -> Iterator[FitColumns]:
        """Yield the columns group by group."""
        for k, own in enumerate(self.bounds):
            columns = self._kept.get(k)
            if columns is None:
                columns = build_batch(self.row, self.ref, self.covered[own], self.sensors, self.slow_row)
                self._heavy[k] = columns.heavy
                self._room -= columns.nbytes
                if self._room > 0:
                    self._kept[k] = columns
            yield columns

    def products(self, delay: float, slope_s: float, aids: Array) -> tuple[Array, NDArray[np.int64]]:
        """Return :meth:`FitColumns.products` of all events."""
        products, lines = zip(*(columns.products(delay, slope_s, aids) for columns in self.each()), strict=True)
        return np.concatenate(products), np.concatenate(lines)

    def correlations(self, delays: Array) -> Array:
        """Return the correlation (n,) of both rates about the axes at delays (n,) s."""
        xx, yy, xy = sum((columns.rate_products(delays) for columns in self.each()), np.zeros((len(delays), 3))).T
        size = np.sqrt(xx * yy)
        return np.asarray(np.divide(xy, size, out=np.zeros(len(delays)), where=size > 0.0))


def event_batches(
    row: SummedTurning, ref: SummedTurning, events: Sequence[StepEvent], sensors: RowSensors | None
) -> EventBatches | None:
    """Return the events that both attitudes cover without a gap; None without any."""
    slow_row = row.step > 1.05 * ref.step
    row_parts = around(row, events, 0.0 if slow_row else MARGIN_S)
    ref_parts = around(ref, events, MARGIN_S if slow_row else 0.0)
    axes = axes_of(ref, events) if len(ref.t) else np.full((len(events), 3), np.nan)
    covered = [
        EventRanges(event, a, b, axis)
        for event, a, b, axis in zip(events, row_parts, ref_parts, axes, strict=True)
        if a is not None and b is not None and np.isfinite(axis[0])
    ]
    found = EventBatches(row, ref, covered, sensors, slow_row)
    return found if covered and found.enough() else None


def build_batch(
    row: SummedTurning, ref: SummedTurning, events: Sequence[EventRanges], sensors: RowSensors | None, slow_row: bool
) -> FitColumns:
    """Return the columns of some events (at least one)."""
    kept, axes = [one.event for one in events], np.array([one.axis for one in events])
    in_row, in_ref = stack_events([one.row for one in events]), stack_events([one.ref for one in events])
    reference = _part(ref, in_ref, kept, np.empty((len(in_ref.index), 4)), axes)
    estimate, heavy = _part(row, in_row, kept, np.zeros((len(in_row.index), 1 + len(step_sensors.NAMES))), axes), 0
    if sensors is not None:
        seen = sensors.around(in_row)
        step_sensors.add_turned(estimate.x, row, in_row, seen, axes)
        heavy = int(np.count_nonzero(np.einsum("ni,ni->n", seen.f, seen.f) > HEAVY_M_S2**2))
    slow, fast, stack = (estimate, reference, in_row) if slow_row else (reference, estimate, in_ref)
    step = row.step if slow_row else ref.step
    begin, end, of = _pairs(slow.t, stack, kept, max(2, round(SPAN_S / step)))
    return FitColumns(slow, fast, slow_row, begin, end, of, heavy)


def axes_of(ref: SummedTurning, events: Sequence[StepEvent]) -> Array:
    """Return the events' axes (events, 3) in the body, NaN without any.

    That is the reference's turning from onset to the 90 % point, with the sign of the stroke.
    """
    times = np.array([(e.onset, e.t90, e.delta_deg) for e in events]).reshape(-1, 3)
    i, j = (np.searchsorted(ref.t, times[:, k]) for k in (0, 1))
    turn = ref.turned[np.minimum(j, len(ref.t) - 1)] - ref.turned[np.maximum(i - 1, 0)]
    length = np.sqrt(np.einsum("ni,ni->n", turn, turn))
    scale = np.divide(np.copysign(1.0, times[:, 2]), length, out=np.full(len(turn), math.nan), where=length >= 1e-6)
    return np.asarray(turn * scale[:, None])


def axis_of(ref: SummedTurning, event: StepEvent) -> Array | None:
    """Return the axis (3,) of one event; None without any."""
    axis = axes_of(ref, [event])[0]
    return axis if np.isfinite(axis[0]) else None


def _part(track: SummedTurning, stack: EventIndex, events: list[StepEvent], x: Array, axes: Array) -> EventTurning:
    """Fill the first column of ``x`` (n, k) with the turning since each event's first sample, about ``axes``.

    Of ``x`` (n, 4) the others become its products with the axis.
    """
    t, (begin, first) = np.empty(len(x)), event_places(stack)
    start = STRIDE_S * np.arange(len(events)) - np.array([e.begin for e in events])
    cross = int(x.shape[1] == 4)
    about_axes(x, t, axes, start, begin, first, track.t, track.turned, cross)
    return EventTurning(t, x, t[first[:-1]], t[first[1:] - 1])


def _pairs(t: Array, stack: EventIndex, events: list[StepEvent], span: int) -> tuple[NDArray[np.int64], ...]:
    """Return first and last sample of every span of ``span`` samples inside an event's window, and its event."""
    n = max(len(t) - span, 0)
    of = stack.of[:n]
    start, length = STRIDE_S * of, np.array([e.end - e.begin for e in events])[of]
    use = (stack.of[span : span + n] == of) & (t[:n] >= start - 1e-9) & (t[span : span + n] <= start + length + 1e-9)
    begin = np.flatnonzero(use)
    return begin, begin + span, of[begin]
