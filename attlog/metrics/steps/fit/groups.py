"""All steps of one row as columns for the fit of its lag, some at a time: of thousands the columns are not kept."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from attlog.estimators.engine.vectors import GRAVITY
from attlog.kernels.loops import function_of
from attlog.metrics.steps.events import StepEvent
from attlog.metrics.steps.fit import aiding
from attlog.metrics.steps.fit.columns import EventTurning, FitColumns
from attlog.metrics.steps.fit.sensors import RowSensors
from attlog.metrics.steps.fit.turning import ABOUT, Stack, SummedTurning, about_axes, around, places, stacked

Array = NDArray[np.float64]


SPAN_S = 0.060
"""A rate is taken over this time, at least two samples of the slower one."""
MARGIN_S = 0.30
"""So far beyond an event's window the faster one is needed: delays of 250 ms, their slope and a sample."""
STRIDE_S = 64.0
"""Events are laid behind each other on one time axis; none lasts that long."""
HEAVY_M_S2 = 2.0 * GRAVITY
TOGETHER = 1 << 15
"""Samples of row and reference whose columns are made at once."""
KEPT_BYTES = 64_000_000
"""Columns up to this size are kept, as of 40 minutes full of steps; those beyond are made anew for each delay."""
MIN_PAIRS = 4


@dataclass(frozen=True, slots=True)
class EventRanges:
    """An event that row and reference show without a gap: their samples around it, its ``axis`` (3,) in the body."""

    event: StepEvent
    row: slice
    ref: slice
    axis: Array


@dataclass(slots=True)
class Groups:
    """The events that both attitudes cover without a gap, in groups; ``slow_row``: the reference is the one moved."""

    row: SummedTurning
    ref: SummedTurning
    covered: list[EventRanges]
    sensors: RowSensors | None
    slow_row: bool
    bounds: list[slice] = field(init=False)
    """Which of the events each group has."""
    _kept: dict[int, FitColumns] = field(default_factory=dict)
    _heavy: dict[int, int] = field(default_factory=dict)
    _room: int = KEPT_BYTES

    def __post_init__(self) -> None:
        sizes: NDArray[np.int64] = np.cumsum(
            [c.row.stop - c.row.start + c.ref.stop - c.ref.start for c in self.covered]
        )
        edges = np.flatnonzero(np.diff((sizes - 1) // TOGETHER)) + 1
        ends = [0, *edges.tolist(), len(self.covered)]
        self.bounds = [slice(a, b) for a, b in pairwise(ends)]

    @property
    def events(self) -> list[StepEvent]:
        """The events themselves."""
        return [c.event for c in self.covered]

    @property
    def heavy(self) -> float:
        """Share of the row's samples in which the specific force exceeds 2 g, once :meth:`products` was asked."""
        return sum(self._heavy.values()) / sum(int(c.row.stop - c.row.start) for c in self.covered)

    def enough(self) -> bool:
        """Whether there are rates to compare."""
        pairs = 0
        for columns in self.each():
            pairs += len(columns.begin)
            if pairs >= MIN_PAIRS:
                return True
        return False

    def each(self, *, aided: bool = True) -> Iterator[FitColumns]:
        """The columns group by group; not ``aided``: those of the aiding may be zero where columns are not kept."""
        for k, own in enumerate(self.bounds):
            columns = self._kept.get(k)
            if columns is None:
                whole = aided or self._room > 0
                columns = build(self.row, self.ref, self.covered[own], self.sensors if whole else None, self.slow_row)
                if whole or self.sensors is None:
                    self._heavy[k] = columns.heavy
                    self._room -= columns.nbytes
                    if self._room > 0:
                        self._kept[k] = columns
            yield columns

    def products(self, delay: float, slope_s: float, aids: Array) -> tuple[Array, NDArray[np.int64]]:
        """Those of all events, see :meth:`FitColumns.products`."""
        products, lines = zip(*(columns.products(delay, slope_s, aids) for columns in self.each()), strict=True)
        return np.concatenate(products), np.concatenate(lines)

    def correlations(self, delays: Array) -> Array:
        """Correlation (n,) of both rates about the axes at delays (n,) s, of some samples of each event."""
        xx, yy, xy = sum((columns.powers(delays) for columns in self.each(aided=False)), np.zeros((len(delays), 3))).T
        size = np.sqrt(xx * yy)
        return np.asarray(np.divide(xy, size, out=np.zeros(len(delays)), where=size > 0.0))


def groups(
    row: SummedTurning, ref: SummedTurning, events: Sequence[StepEvent], sensors: RowSensors | None
) -> Groups | None:
    """The events that both attitudes cover without a gap; None without any."""
    slow_row = row.step > 1.05 * ref.step
    row_parts = around(row, events, 0.0 if slow_row else MARGIN_S)
    ref_parts = around(ref, events, MARGIN_S if slow_row else 0.0)
    axes = axes_of(ref, events) if len(ref.t) else np.full((len(events), 3), np.nan)
    covered = [
        EventRanges(event, a, b, axis)
        for event, a, b, axis in zip(events, row_parts, ref_parts, axes, strict=True)
        if a is not None and b is not None and np.isfinite(axis[0])
    ]
    found = Groups(row, ref, covered, sensors, slow_row)
    return found if covered and found.enough() else None


def build(
    row: SummedTurning, ref: SummedTurning, events: Sequence[EventRanges], sensors: RowSensors | None, slow_row: bool
) -> FitColumns:
    """The columns of some events (at least one)."""
    kept, axes = [one.event for one in events], np.array([one.axis for one in events])
    in_row, in_ref = stacked([one.row for one in events]), stacked([one.ref for one in events])
    reference = _part(ref, in_ref, kept, np.empty((len(in_ref.index), 4)), axes)
    estimate, heavy = _part(row, in_row, kept, np.zeros((len(in_row.index), 1 + len(aiding.NAMES))), axes), 0
    if sensors is not None:
        seen = sensors.around(in_row)
        aiding.add_turned(estimate.x, row, in_row, seen, axes)
        heavy = int(np.count_nonzero(np.einsum("ni,ni->n", seen.f, seen.f) > HEAVY_M_S2**2))
    slow, fast, stack = (estimate, reference, in_row) if slow_row else (reference, estimate, in_ref)
    step = row.step if slow_row else ref.step
    begin, end, of = _pairs(slow.t, stack, kept, max(2, round(SPAN_S / step)))
    return FitColumns(slow, fast, slow_row, begin, end, of, heavy)


def axes_of(ref: SummedTurning, events: Sequence[StepEvent]) -> Array:
    """The events' axes (events, 3) in the body, NaN without any.

    That is the reference's turning from onset to the 90 % point, with the sign of the stroke.
    """
    times = np.array([(e.onset, e.t90, e.delta_deg) for e in events]).reshape(-1, 3)
    i, j = (np.searchsorted(ref.t, times[:, k]) for k in (0, 1))
    turn = ref.turned[np.minimum(j, len(ref.t) - 1)] - ref.turned[np.maximum(i - 1, 0)]
    length = np.sqrt(np.einsum("ni,ni->n", turn, turn))
    scale = np.divide(np.copysign(1.0, times[:, 2]), length, out=np.full(len(turn), math.nan), where=length >= 1e-6)
    return np.asarray(turn * scale[:, None])


def axis_of(ref: SummedTurning, event: StepEvent) -> Array | None:
    """The same (3,) of one event; None without any."""
    axis = axes_of(ref, [event])[0]
    return axis if np.isfinite(axis[0]) else None


def _part(track: SummedTurning, stack: Stack, events: list[StepEvent], x: Array, axes: Array) -> EventTurning:
    """What is turned since each event's first sample in the first column of ``x`` (n, k), of (n, 4) with its products.

    About ``axes`` (events, 3); the other columns are kept.
    """
    t, (begin, first) = np.empty(len(x)), places(stack)
    start = STRIDE_S * np.arange(len(events)) - np.array([e.begin for e in events])
    cross = int(x.shape[1] == 4)
    function_of(ABOUT, about_axes)(x, t, axes, start, begin, first, track.t, track.turned, cross)
    return EventTurning(t, x, t[first[:-1]], t[first[1:] - 1])


def _pairs(t: Array, stack: Stack, events: list[StepEvent], span: int) -> tuple[NDArray[np.int64], ...]:
    """First and last sample of every span of ``span`` samples inside an event's window, and its event."""
    n = max(len(t) - span, 0)
    of = stack.of[:n]
    start, length = STRIDE_S * of, np.array([e.end - e.begin for e in events])[of]
    use = (stack.of[span : span + n] == of) & (t[:n] >= start - 1e-9) & (t[span : span + n] <= start + length + 1e-9)
    begin = np.flatnonzero(use)
    return begin, begin + span, of[begin]
