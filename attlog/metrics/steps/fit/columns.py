"""The columns of the fit of a lag: turning rates about each event's axis, in row and reference, at one delay."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from attlog.estimators.engine.vectors import GRAVITY
from attlog.kernels.loops import function_of
from attlog.metrics.evidence import aiding
from attlog.metrics.steps.events import Event
from attlog.metrics.steps.fit.loops import POWERS, PRODUCTS, event_products, powers
from attlog.metrics.steps.turning import Stack, Turning, places, stacked
from attlog.metrics.steps.turning_loop import ABOUT, about_axes

Array = NDArray[np.float64]

SPAN_S = 0.060
"""A rate is taken over this time, at least two samples of the slower one."""
MARGIN_S = 0.30
"""So far beyond an event's window the faster one is needed: delays of 250 ms, their slope and a sample."""
STRIDE_S = 64.0
"""Events are laid behind each other on one time axis; none lasts that long."""
HEAVY_M_S2 = 2.0 * GRAVITY
SIZE = 12
"""Columns: rate of the row, slope, rate of the reference, its product with the axis (3), aiding (6)."""
MOVED = 9
"""Most that is moved by the delay: seven columns of the row, two free, the slope."""


@dataclass(frozen=True, slots=True)
class Covered:
    """An event that row and reference show without a gap: their samples around it, its ``axis`` (3,) in the body."""

    event: Event
    row: slice
    ref: slice
    axis: Array


@dataclass(slots=True)
class Part:
    """One of the two attitudes: columns (n, k) of summed turning at ``t`` (n,) on the common time axis."""

    t: Array
    x: Array
    low: Array
    """(events,) first and last time of each event."""
    high: Array
    about: Array = field(init=False)
    """The first column (n,), the turning about the events' axes, without the others between its values."""

    def __post_init__(self) -> None:
        self.about = np.ascontiguousarray(self.x[:, 0])


@dataclass(slots=True)
class Columns:
    """Some events of one row. ``slow_row`` tells that the reference is the one that is moved.

    ``begin`` and ``end`` (pairs,) number the samples of the slower one between which a
    rate is taken, ``of`` (pairs,) the event.
    """

    slow: Part
    fast: Part
    slow_row: bool
    begin: NDArray[np.int64]
    end: NDArray[np.int64]
    of: NDArray[np.int64]
    heavy: int
    """Of how many samples the specific force exceeds 2 g."""

    @property
    def nbytes(self) -> int:
        """What they take of memory."""
        arrays = (self.slow.t, self.slow.x, self.fast.t, self.fast.x, self.begin, self.end, self.of)
        return sum(x.nbytes for x in arrays)

    def products(self, delay: float, slope_s: float, aids: Array) -> tuple[Array, NDArray[np.int64]]:
        """Sums of products (events, 12, 12) of the columns centred per event, and lines per event (events,).

        At a delay in s. The slope is taken over +-``slope_s`` of what the delay moves: the row's rate without its
        aiding of gains ``aids`` (6,), or the reference's rate.
        """
        bare = self.slow_row or not aids.any()
        main = self.fast.about if bare else self.fast.about - self.fast.x[:, 1:] @ aids
        events, first = len(self.slow.low), np.searchsorted(self.of, np.arange(len(self.slow.low) + 1))
        out, count = np.zeros((events, SIZE, SIZE)), np.zeros(events, np.int64)
        some = np.flatnonzero(np.diff(first))
        if len(some) == 0:
            return out, count
        samples = self.end[first[some + 1] - 1] - self.begin[first[some]] + 1
        function_of(PRODUCTS, event_products)(
            out,
            count,
            np.empty((samples.max(), MOVED)),
            np.empty((np.diff(first).max(), SIZE)),
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

    def powers(self, delays: Array) -> Array:
        """Squares of the row's and of the reference's rate about the axes, and their product (n, 3), at delays (n,) s.

        Summed over some of the samples, centred per event.
        """
        out, events = np.zeros((len(delays), 3)), len(self.slow.low)
        step = max(1, len(self.begin) // (THINNED * events))
        begin, end, of = (np.ascontiguousarray(x[::step]) for x in (self.begin, self.end, self.of))
        function_of(POWERS, powers)(
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


THINNED = 60
"""About so many samples per event tell where the correlation is largest."""


def build(
    row: Turning, ref: Turning, events: Sequence[Covered], sensors: aiding.Sensors | None, slow_row: bool
) -> Columns:
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
    return Columns(slow, fast, slow_row, begin, end, of, heavy)


def axes_of(ref: Turning, events: Sequence[Event]) -> Array:
    """The events' axes (events, 3) in the body, NaN without any.

    That is the reference's turning from onset to the 90 % point, with the sign of the stroke.
    """
    times = np.array([(e.onset, e.t90, e.delta_deg) for e in events]).reshape(-1, 3)
    i, j = (np.searchsorted(ref.t, times[:, k]) for k in (0, 1))
    turn = ref.turned[np.minimum(j, len(ref.t) - 1)] - ref.turned[np.maximum(i - 1, 0)]
    length = np.sqrt(np.einsum("ni,ni->n", turn, turn))
    scale = np.divide(np.copysign(1.0, times[:, 2]), length, out=np.full(len(turn), math.nan), where=length >= 1e-6)
    return np.asarray(turn * scale[:, None])


def axis_of(ref: Turning, event: Event) -> Array | None:
    """The same (3,) of one event; None without any."""
    axis = axes_of(ref, [event])[0]
    return axis if np.isfinite(axis[0]) else None


def _part(track: Turning, stack: Stack, events: list[Event], x: Array, axes: Array) -> Part:
    """What is turned since each event's first sample in the first column of ``x`` (n, k), of (n, 4) with its products.

    About ``axes`` (events, 3); the other columns are kept.
    """
    t, (begin, first) = np.empty(len(x)), places(stack)
    start = STRIDE_S * np.arange(len(events)) - np.array([e.begin for e in events])
    cross = int(x.shape[1] == 4)
    function_of(ABOUT, about_axes)(x, t, axes, start, begin, first, track.t, track.turned, cross)
    return Part(t, x, t[first[:-1]], t[first[1:] - 1])


def _pairs(t: Array, stack: Stack, events: list[Event], span: int) -> tuple[NDArray[np.int64], ...]:
    """First and last sample of every span of ``span`` samples inside an event's window, and its event."""
    n = max(len(t) - span, 0)
    of = stack.of[:n]
    start, length = STRIDE_S * of, np.array([e.end - e.begin for e in events])[of]
    use = (stack.of[span : span + n] == of) & (t[:n] >= start - 1e-9) & (t[span : span + n] <= start + length + 1e-9)
    begin = np.flatnonzero(use)
    return begin, begin + span, of[begin]
