"""How an attitude turns: the sum of its body increments, and the samples around each step."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from attlog.base import rotation
from attlog.kernels.loops import function_of, kernel_of
from attlog.segments import gaps

if TYPE_CHECKING:
    from attlog.metrics.steps.events import StepEvent

Array = NDArray[np.float64]
Index = NDArray[np.int64]


SUMMED_SIGNATURE = "void(f8[:, ::1], (f8[:, ::1]))"
ABOUT_SIGNATURE = (
    "void(f8[:, ::1], f8[::1], (f8[:, ::1]), (f8[::1]), (i8[::1]), (i8[::1]), (f8[::1]), (f8[:, ::1]), i8)"
)
SOURCES = ("metrics/steps/fit/turning.py", "kernels")


DEG = math.degrees(1.0)
SMALL = 0.0025
"""Squared tangent of half an angle below which a series holds to the last digit: 0.1 rad, as between most samples."""


REACH_BEFORE_S, REACH_AFTER_S = 0.1, 0.3
"""So far before the onset and beyond the 90 % point a step must be covered, s."""


def summed_turning(out: Array, q: Array) -> None:
    """Fill ``out`` (n, 3) with the summed rotation vectors in deg of ``q_i^* q_(i+1)`` of attitudes ``q`` (n, 4)."""
    sx, sy, sz = 0.0, 0.0, 0.0
    for i in range(len(q)):
        if i > 0:
            w, x, y, z = q[i - 1, 0], q[i - 1, 1], q[i - 1, 2], q[i - 1, 3]
            e, f, g, h = q[i, 0], q[i, 1], q[i, 2], q[i, 3]
            tx, ty, tz = w * f - x * e - y * h + z * g, w * g + x * h - y * e - z * f, w * h - x * g + y * f - z * e
            cosine, square = w * e + x * f + y * g + z * h, tx * tx + ty * ty + tz * tz
            size, factor = abs(cosine), 2.0
            if square < SMALL * size * size:
                s = square / (size * size)
                factor = 1.0 - s * (
                    1.0 / 3.0 - s * (0.2 - s * (1.0 / 7.0 - s * (1.0 / 9.0 - s * (1.0 / 11.0 - s / 13.0))))
                )
                factor *= 2.0 / size
            elif square > 1e-24:
                sine = math.sqrt(square)
                factor = 2.0 * math.atan2(sine, size) / sine
            factor *= -DEG if cosine < 0.0 else DEG
            sx, sy, sz = sx + factor * tx, sy + factor * ty, sz + factor * tz
        out[i, 0], out[i, 1], out[i, 2] = sx, sy, sz


def summed_at_once(out: Array, q: Array) -> None:
    """The same in numpy: summed turning ``out`` (n, 3) in deg of attitudes ``q`` (n, 4), body axes."""
    turn = rotation.increments(q)
    out[:1] = 0.0
    np.cumsum(np.degrees(turn, out=turn), axis=0, out=out[1:])


def about_axes(
    out: Array, at: Array, axes: Array, start: Array, begin: Index, first: Index, t: Array, turned: Array, cross: int
) -> None:
    """Fill ``out[:, 0]`` with what is turned (n,) in deg about each event's axis since its first sample.

    Event e has ``axes[e]`` and the samples ``first[e]`` to ``first[e + 1]`` of ``out`` and ``at``, which are those from
    ``begin[e]`` on of ``t`` and ``turned`` (m, 3). ``at`` becomes their time after ``-start[e]``; with ``cross`` the
    next three columns what is turned, times the axis.
    """
    for e in range(len(begin)):
        ux, uy, uz = axes[e, 0], axes[e, 1], axes[e, 2]
        k0 = begin[e]
        for i in range(first[e], first[e + 1]):
            k = k0 + i - first[e]
            x, y, z = turned[k, 0] - turned[k0, 0], turned[k, 1] - turned[k0, 1], turned[k, 2] - turned[k0, 2]
            at[i] = t[k] + start[e]
            out[i, 0] = x * ux + y * uy + z * uz
            if cross == 1:
                out[i, 1], out[i, 2], out[i, 3] = y * uz - z * uy, z * ux - x * uz, x * uy - y * ux


SUMMED = kernel_of(summed_turning, SUMMED_SIGNATURE, "metrics", "the turning of an attitude", SOURCES)
ABOUT = kernel_of(about_axes, ABOUT_SIGNATURE, "metrics", "the turning in steps", SOURCES)


@dataclass(frozen=True, slots=True)
class Timing:
    """Of times (n,): the ``number`` (n,) of their segments between gaps, and the median ``step`` in s."""

    number: Index
    step: float

    @classmethod
    def of(cls, t: Array) -> Timing:
        """Of times (n,) s."""
        return cls(gaps.number(t), float(np.median(np.diff(t))) if len(t) > 1 else math.inf)


@dataclass(slots=True)
class SummedTurning:
    """An attitude over time with its summed turning.

    ``t`` (n,) s, ``q`` (n, 4) finite samples only; ``segment`` (n,) changes at gaps, restarts and
    left-out samples; ``turned`` (n, 3) deg: the rotation vectors of ``q_i^* q_(i+1)`` summed in
    body axes; ``step`` median time between samples, s.
    """

    t: Array
    q: Array
    segment: Index
    timing: Timing | None = None
    """What is known of ``t`` where others have the same times."""
    turned: Array = field(init=False)
    step: float = field(init=False)

    def __post_init__(self) -> None:
        good = rotation.finite(self.q)
        if good.all():
            timing = self.timing or Timing.of(self.t)
            self.segment = gaps.renumber(timing.number, self.segment)
        else:
            lost = np.cumsum(~good)[good].astype(np.int64)
            self.t, self.q = self.t[good], self.q[good]
            timing = Timing.of(self.t)
            self.segment = gaps.renumber(timing.number, self.segment[good], lost)
        self.t, self.q = (np.ascontiguousarray(x, np.float64) for x in (self.t, self.q))
        self.step, self.timing = timing.step, None
        self.turned = np.empty((len(self.t), 3))
        function_of(SUMMED, summed_turning, summed_at_once)(self.turned, self.q)


@dataclass(slots=True)
class Stack:
    """Samples of a :class:`Turning` around several events, one event after the other.

    ``index`` (n,) sample numbers, ``of`` (n,) number of the event, ``first`` (events,) where each
    event begins in ``index``.
    """

    index: Index
    of: Index
    first: Index


def around(track: SummedTurning, events: Sequence[StepEvent], margin: float) -> list[slice | None]:
    """The samples from ``margin`` s before to after each event's window that no gap parts from its mid-step.

    None where they do not reach from 0.1 s before the onset to 0.3 s after the 90 % point.
    """
    if len(track.t) < 2:
        return [None] * len(events)
    last = len(track.t) - 1
    times = np.array([(e.begin, e.onset, e.middle, e.t90, e.end) for e in events]).reshape(-1, 5)
    begin, onset, middle, t90, close = times.T
    own = track.segment[np.minimum(np.searchsorted(track.t, middle), last)]  # segments are numbered in time
    first = np.maximum(np.searchsorted(track.t, begin - margin), np.searchsorted(track.segment, own))
    end = np.minimum(np.searchsorted(track.t, close + margin), np.searchsorted(track.segment, own, side="right"))
    reaches = (end - first > 1) & (track.t[np.minimum(first, last)] <= onset - REACH_BEFORE_S)
    reaches &= track.t[end - 1] >= np.minimum(t90 + REACH_AFTER_S, close)
    return [slice(i, j) if ok else None for i, j, ok in zip(first.tolist(), end.tolist(), reaches, strict=True)]


def stacked(parts: Sequence[slice]) -> Stack:
    """The samples of these ranges behind each other."""
    sizes = np.array([p.stop - p.start for p in parts], np.int64)
    first = np.concatenate([[0], np.cumsum(sizes)[:-1]]).astype(np.int64)
    of = np.repeat(np.arange(len(parts)), sizes)
    start = np.array([p.start for p in parts], np.int64)
    return Stack(np.arange(int(sizes.sum())) - first[of] + start[of], of, first)


def places(stack: Stack) -> tuple[Index, Index]:
    """The number (events,) of each event's first sample; where each begins in the stack, and its end (events + 1,)."""
    return stack.index[stack.first], np.append(stack.first, len(stack.index))
