"""How an attitude turns: the sum of its body increments, and the samples around each step event."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import field

import numpy as np
from numpy.typing import NDArray

from attlog import rotation
from attlog.dataclass import dataclass
from attlog.metrics.steps import Event
from attlog.segments import gaps

Array = NDArray[np.float64]
Index = NDArray[np.int64]


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
    turned: Array = field(init=False)
    step: float = field(init=False)

    def __post_init__(self) -> None:
        good = rotation.finite(self.q)
        lost = np.cumsum(~good)[good].astype(np.int64)
        self.t, self.q = (np.ascontiguousarray(x, np.float64) for x in gaps.only(good, self.t, self.q))
        self.segment = gaps.renumber(gaps.number(self.t), self.segment[good], lost)
        self.step = float(np.median(np.diff(self.t))) if len(self.t) > 1 else math.inf
        self.turned = np.zeros((len(self.t), 3))
        np.cumsum(np.degrees(rotation.increments(self.q)), axis=0, out=self.turned[1:])


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
    first = np.searchsorted(track.t, [e.begin - margin for e in events])
    last = np.searchsorted(track.t, [e.end + margin for e in events])
    middle = np.searchsorted(track.t, [e.middle for e in events])
    found: list[slice | None] = []
    for event, i, j, m in zip(events, first.tolist(), last.tolist(), middle.tolist(), strict=True):
        own = track.segment[i:j] == track.segment[min(m, len(track.t) - 1)]
        same = np.flatnonzero(own)
        part = slice(i + int(same[0]), i + int(same[-1]) + 1) if len(same) > 1 else None
        reaches = (
            part is not None
            and track.t[part.start] <= event.onset - REACH_BEFORE_S
            and track.t[part.stop - 1] >= min(event.t90 + REACH_AFTER_S, event.end)
        )
        found.append(part if reaches else None)
    return found


REACH_BEFORE_S, REACH_AFTER_S = 0.1, 0.3
BLOCK = 4096
"""Samples of several events that are looked at together."""


def stacked(parts: Sequence[slice]) -> Stack:
    """The samples of the given ranges behind each other."""
    sizes = np.array([p.stop - p.start for p in parts], np.int64)
    first = np.concatenate([[0], np.cumsum(sizes)[:-1]]).astype(np.int64)
    of = np.repeat(np.arange(len(parts)), sizes)
    start = np.array([p.start for p in parts], np.int64)
    return Stack(np.arange(int(sizes.sum())) - first[of] + start[of], of, first)


def blocks(stack: Stack) -> Iterator[tuple[slice, Stack]]:
    """The stack event by event or a few at once: which of its samples, and those events as a stack of their own.

    What is computed on the way then stays in the processor's cache, and costs a long log no memory.
    """
    ends = np.append(stack.first[1:], len(stack.index))
    at = 0
    while at < len(ends):
        last = max(at, int(np.searchsorted(ends, stack.first[at] + BLOCK, side="right")) - 1)
        own = slice(int(stack.first[at]), int(ends[last]))
        yield own, Stack(stack.index[own], stack.of[own] - at, stack.first[at : last + 1] - own.start)
        at = last + 1
