"""The columns of the fit of a lag: turning rates of row and reference at a delay, and sums of their products.

Both attitudes lie on one time axis, event after event; the faster one is interpolated at the slower one's samples.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from attlog.kernels.loops import function_of, kernel_of

Array = NDArray[np.float64]
Index = NDArray[np.int64]


SIZE = 12
"""Columns: rate of the row, slope, rate of the reference, its product with the axis (3), aiding (6)."""
MOVED = 9
"""Most that is moved by the delay: seven columns of the row, two free, the slope."""
THINNED = 60
"""About so many samples per event tell where the correlation is largest."""


SOURCES = ("metrics/steps/fit/columns.py", "kernels")


PRODUCTS_SIGNATURE = (
    "void(f8[:, :, ::1], i8[::1], f8[:, ::1], f8[:, ::1], (f8[::1]), (f8[:, ::1]), (f8[::1]), (f8[:, ::1]), (f8[::1]), "
    "(f8[::1]), (f8[::1]), (i8[::1]), (i8[::1]), (i8[::1]), f8, f8, i8)"
)
POWERS_SIGNATURE = (
    "void(f8[:, ::1], f8[:, ::1], f8[:, ::1], (f8[::1]), (f8[::1]), (f8[::1]), (f8[::1]), (f8[::1]), "
    "(i8[::1]), (i8[::1]), (i8[::1]))"
)


def after(t: Array, at: float, i: int) -> int:
    """The first number from ``i`` on whose time is not before ``at``; at least 1, at most the last."""
    i = max(i, 1)
    while i < len(t) - 1 and t[i] < at:
        i += 1
    return i


def event_products(
    out: Array,
    count: Index,
    moved: Array,
    rows: Array,
    slow_t: Array,
    slow_x: Array,
    fast_t: Array,
    fast_x: Array,
    main: Array,
    low: Array,
    high: Array,
    begin: Index,
    end: Index,
    first: Index,
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
            here, ahead = after(fast_t, at, here), after(fast_t, at + slope, ahead)
            behind = after(fast_t, at - slope, behind)
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


def powers(
    out: Array,
    x: Array,
    sums: Array,
    delays: Array,
    slow_t: Array,
    slow_x: Array,
    fast_t: Array,
    fast_x: Array,
    begin: Index,
    end: Index,
    of: Index,
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
                i, j = after(fast_t, a + delays[g], i), after(fast_t, b + delays[g], j)
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


PRODUCTS = kernel_of(event_products, PRODUCTS_SIGNATURE, "metrics", "the fit of steps", SOURCES)
POWERS = kernel_of(powers, POWERS_SIGNATURE, "metrics", "the coarse fit of steps", SOURCES)


@dataclass(slots=True)
class EventTurning:
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
class FitColumns:
    """Some events of one row. ``slow_row`` tells that the reference is the one that is moved.

    ``begin`` and ``end`` (pairs,) number the samples of the slower one between which a
    rate is taken, ``of`` (pairs,) the event.
    """

    slow: EventTurning
    fast: EventTurning
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
