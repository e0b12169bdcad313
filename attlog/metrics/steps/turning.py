"""How an attitude turns: the sum of its body increments, and the samples around each step event."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from attlog.base import rotation
from attlog.kernels.loops import function_of
from attlog.metrics.steps.events import Event
from attlog.metrics.steps.turning_loop import SUMMED, summed_at_once, summed_turning
from attlog.segments import gaps

Array = NDArray[np.float64]
Index = NDArray[np.int64]


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
class Turning:
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


def around(track: Turning, events: Sequence[Event], margin: float) -> list[slice | None]:
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


REACH_BEFORE_S, REACH_AFTER_S = 0.1, 0.3


def stacked(parts: Sequence[slice]) -> Stack:
    """The samples of the given ranges behind each other."""
    sizes = np.array([p.stop - p.start for p in parts], np.int64)
    first = np.concatenate([[0], np.cumsum(sizes)[:-1]]).astype(np.int64)
    of = np.repeat(np.arange(len(parts)), sizes)
    start = np.array([p.start for p in parts], np.int64)
    return Stack(np.arange(int(sizes.sum())) - first[of] + start[of], of, first)


def places(stack: Stack) -> tuple[Index, Index]:
    """The number (events,) of each event's first sample; where each begins in the stack, and its end (events + 1,)."""
    return stack.index[stack.first], np.append(stack.first, len(stack.index))
