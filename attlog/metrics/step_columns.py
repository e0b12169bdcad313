"""The columns of the fit of a lag: turning rates about each event's axis, in row and reference, at one delay."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import field

import numpy as np
from numpy.typing import NDArray

from attlog.dataclass import dataclass
from attlog.estimators.engine.vectors import GRAVITY
from attlog.kernels.loops import function_of
from attlog.metrics import aiding
from attlog.metrics.step_loops import CORRELATIONS, PRODUCTS, correlations, event_products
from attlog.metrics.steps import Event
from attlog.metrics.turning import Stack, Turning, around, blocks, stacked

Array = NDArray[np.float64]

SPAN_S = 0.060
"""A rate is taken over this time, at least two samples of the slower one."""
MARGIN_S = 0.30
"""So far beyond an event's window the faster one is needed: delays of 250 ms, their slope and a sample."""
STRIDE_S = 64.0
"""Events are laid behind each other on one time axis; none lasts that long."""
HEAVY_M_S2 = 2.0 * GRAVITY
MIN_PAIRS = 4
SIZE = 12
"""Columns: rate of the row, slope, rate of the reference, its product with the axis (3), aiding (6)."""
MOVED = 9
"""Most that is moved by the delay: seven columns of the row, two free, the slope."""


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
    """All events of one row. ``slow_row`` tells that the reference is the one that is moved.

    ``begin`` and ``end`` (pairs,) number the samples of the slower one between which a
    rate is taken, ``of`` (pairs,) the event.
    """

    slow: Part
    fast: Part
    slow_row: bool
    begin: NDArray[np.int64]
    end: NDArray[np.int64]
    of: NDArray[np.int64]
    events: list[Event]
    heavy: float
    """Share of the samples in which the specific force exceeds 2 g."""

    @property
    def axis(self) -> NDArray[np.int64]:
        """Body axis (events,) of each event."""
        return np.array([e.axis for e in self.events], np.int64)

    def products(self, delay: float, slope_s: float, aids: Array) -> tuple[Array, NDArray[np.int64]]:
        """Sums of products (events, 12, 12) of the columns centred per event, and lines per event (events,).

        At a delay in s. The slope is taken over +-``slope_s`` of what the delay moves: the row's rate without its
        aiding of gains ``aids`` (6,), or the reference's rate.
        """
        main = self.fast.about if self.slow_row else self.fast.about - self.fast.x[:, 1:] @ aids
        events, first = len(self.events), np.searchsorted(self.of, np.arange(len(self.events) + 1))
        out, count = np.empty((events, SIZE, SIZE)), np.empty(events, np.int64)
        some = np.flatnonzero(np.diff(first))
        samples = self.end[first[some + 1] - 1] - self.begin[first[some]] + 1
        function_of(PRODUCTS, event_products)(
            out, count, np.empty((samples.max(), MOVED)), np.empty((np.diff(first).max(), SIZE)),
            self.slow.t, self.slow.x, self.fast.t, self.fast.x, main, self.fast.low, self.fast.high,
            self.begin, self.end, first, -delay if self.slow_row else delay, slope_s, int(self.slow_row),
        )  # fmt: skip
        return out, count

    def correlations(self, delays: Array) -> Array:
        """Correlation (n,) of both rates about the axes at delays (n,) s, centred per event, of some samples."""
        step = max(1, len(self.begin) // (THINNED * len(self.events)))
        begin, end, of = (np.ascontiguousarray(x[::step]) for x in (self.begin, self.end, self.of))
        out = np.empty(len(delays))
        function_of(CORRELATIONS, correlations)(
            out, np.empty((2, len(begin))), np.empty((3, len(self.events))), -delays if self.slow_row else delays,
            self.slow.t, self.slow.about, self.fast.t, self.fast.about, begin, end, of,
        )  # fmt: skip
        return out


THINNED = 60
"""About so many samples per event tell where the correlation is largest."""


def build(row: Turning, ref: Turning, events: Sequence[Event], sensors: aiding.Sensors | None) -> Columns | None:
    """The columns of the events that both attitudes cover without a gap; None without any."""
    slow_row = row.step > 1.05 * ref.step
    row_parts = around(row, events, 0.0 if slow_row else MARGIN_S)
    ref_parts = around(ref, events, MARGIN_S if slow_row else 0.0)
    covered = [
        (e, a, b) for e, a, b in zip(events, row_parts, ref_parts, strict=True) if a is not None and b is not None
    ]
    found = [(e, a, b, u) for e, a, b in covered if (u := axis_of(ref, e)) is not None]
    if not found:
        return None
    kept = [e for e, _, _, _ in found]
    axes = np.array([u for _, _, _, u in found])
    in_row, in_ref = stacked([a for _, a, _, _ in found]), stacked([b for _, _, b, _ in found])
    reference = _part(ref, in_ref, kept, _about(ref, in_ref, axes))
    own, heavy = np.zeros((len(in_row.index), 1 + len(aiding.NAMES))), 0
    for part, stack in blocks(in_row):
        (x, y, z), (ux, uy, uz) = row.turned[stack.index].T, axes[in_row.of[part]].T
        own[part, 0] = x * ux + y * uy + z * uz
        if sensors is not None:
            seen = sensors.around(stack)
            own[part, 1:] = aiding.turned(row, stack, seen, axes[in_row.of[part.start] :][: len(stack.first)])
            heavy += int(np.count_nonzero(np.einsum("ni,ni->n", seen.f, seen.f) > HEAVY_M_S2**2))
    estimate = _part(row, in_row, kept, own)
    slow, fast, stack = (estimate, reference, in_row) if slow_row else (reference, estimate, in_ref)
    step = row.step if slow_row else ref.step
    begin, end, of = _pairs(slow.t, stack, kept, max(2, round(SPAN_S / step)))
    if len(begin) < MIN_PAIRS:
        return None
    return Columns(slow, fast, slow_row, begin, end, of, kept, heavy / len(in_row.index))


def _about(ref: Turning, stack: Stack, axes: Array) -> Array:
    """The reference's turning (n, 4) about each event's axis (events, 3), and its product with that axis."""
    out = np.empty((len(stack.index), 4))
    for part, own in blocks(stack):
        (x, y, z), (ux, uy, uz) = ref.turned[own.index].T, axes[stack.of[part]].T
        out[part, 0] = x * ux + y * uy + z * uz
        out[part, 1], out[part, 2], out[part, 3] = y * uz - z * uy, z * ux - x * uz, x * uy - y * ux
    return out


def axis_of(ref: Turning, event: Event) -> Array | None:
    """The event's axis (3,) in the body: the reference's turning from onset to the 90 % point, sign of the stroke."""
    i, j = np.searchsorted(ref.t, [event.onset, event.t90])
    i, j = max(int(i) - 1, 0), min(int(j), len(ref.t) - 1)
    turn = ref.turned[j] - ref.turned[i]
    length = float(np.linalg.norm(turn))
    return None if length < 1e-6 else turn * math.copysign(1.0 / length, event.delta_deg)


def _part(track: Turning, stack: Stack, events: list[Event], x: Array) -> Part:
    """The columns ``x`` (n, k) of the samples of a stack, which are changed, counted from each event's first."""
    begin = np.array([e.begin for e in events])
    t = track.t[stack.index] - begin[stack.of] + STRIDE_S * stack.of
    last = np.append(stack.first[1:], len(t)) - 1
    for i, j in zip(stack.first.tolist(), (last + 1).tolist(), strict=True):
        x[i:j] -= x[i].copy()
    return Part(t, x, t[stack.first], t[last])


def _pairs(t: Array, stack: Stack, events: list[Event], span: int) -> tuple[NDArray[np.int64], ...]:
    """First and last sample of every span of ``span`` samples inside an event's window, and its event."""
    n = max(len(t) - span, 0)
    of = stack.of[:n]
    start, length = STRIDE_S * of, np.array([e.end - e.begin for e in events])[of]
    use = (stack.of[span : span + n] == of) & (t[:n] >= start - 1e-9) & (t[span : span + n] <= start + length + 1e-9)
    begin = np.flatnonzero(use)
    return begin, begin + span, of[begin]
