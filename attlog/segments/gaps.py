"""Gaps: where samples are missing, and the continuous segments between them, which no metric leaves."""

from __future__ import annotations

from itertools import pairwise
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

from attlog.base import gap, rotation
from attlog.segments.model import Segment

Array = NDArray[np.float64]
T = TypeVar("T", bound=np.generic)


def rate(t: Array) -> float:
    """Samples per second in Hz of times ``t`` (n,) s: time lost in gaps does not count; 0 for fewer than two."""
    dt = np.diff(t)
    dt = dt[(dt > 0) & (dt <= gap.limit_of(t))]
    return len(dt) / float(np.sum(dt)) if len(dt) else 0.0


def number(t: Array, limit: float | None = None) -> NDArray[np.int64]:
    """The number of the segment (n,) that each time belongs to; a gap or a backward step begins a new one."""
    if len(t) == 0:
        return np.zeros(0, np.int64)
    dt = np.diff(t)
    broken = ~((dt >= 0) & (dt <= (gap.LEAST_S if limit is None else limit)))
    found = np.zeros(len(t), np.int64)
    if limit is None and broken.any():
        broken = ~((dt >= 0) & (dt <= gap.limit_of(t)))
    if broken.any():
        np.cumsum(broken, out=found[1:])
    return found


def renumber(*numbers: NDArray[np.int64]) -> NDArray[np.int64]:
    """Segment numbers (n,) from 0 that rise by one wherever one of these numbers (n,) changes.

    The first of them itself where it is that already, because copies add up: to be read alone.
    """
    if len(numbers[0]) == 0:
        return np.zeros(0, np.int64)
    changed = np.zeros(len(numbers[0]), bool)
    for n in numbers:
        changed[1:] |= n[1:] != n[:-1]
    found = np.cumsum(changed) if changed.any() else np.zeros(len(changed), np.int64)
    return numbers[0] if np.array_equal(found, numbers[0]) else found


def slices(inside: NDArray[np.bool_], number: NDArray[np.int64]) -> list[slice]:
    """Index ranges of neighbouring samples that are all inside and bear the same segment number (n,)."""
    if len(inside) == 0:
        return []
    edges = np.flatnonzero((inside[1:] != inside[:-1]) | (np.diff(number) != 0)) + 1
    bounds = [0, *edges.tolist(), len(inside)]
    return [slice(a, b) for a, b in pairwise(bounds) if inside[a]]


def only(good: NDArray[np.bool_], *arrays: NDArray[T]) -> tuple[NDArray[T], ...]:
    """The good samples of arrays (n, ...); the arrays themselves where all are good, because copies add up.

    Where only some at the ends are not, as of two records of one flight, parts of the arrays: to be read alone.
    """
    if good.all():
        return arrays
    begin, end = int(good.argmax()), len(good) - int(good[::-1].argmax())
    if 2 * (end - begin) > len(good) and good[begin:end].all():
        return tuple(x[begin:end] for x in arrays)
    return tuple(x[good] for x in arrays)


def rising(t: Array, x: Array) -> tuple[Array, Array]:
    """The samples (m,), (m, k) that are finite and later than all before them; the arrays themselves if all are."""
    good = np.isfinite(t) & rotation.finite(x)
    if good.all() and (t[1:] > t[:-1]).all():
        return t, x
    highest = np.maximum.accumulate(np.where(good, t, -np.inf))
    good[1:] &= highest[1:] > highest[:-1]
    t, x = only(good, t, x)
    return t, x


def find(t: Array, replayed: bool = True) -> list[Segment]:
    """Continuous segments and the gaps between them, of the times (n,) of the replayed IMU.

    ``replayed``: False where they are those of the onboard attitude, because the log has no IMU for a filter.
    """
    if len(t) < 2:
        return []
    limit = gap.limit_of(t)
    own = number(t, limit)
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
            then = "a filter restarts" if seconds > gap.RESTART_S else "a filter integrates across"
            why = f"no IMU sample for {seconds:.2f} s; {then}" if replayed else f"no attitude for {seconds:.2f} s"
            found.append(Segment("gap", float(t[a]), float(t[b]), why))
    return found


def restarts(t: Array) -> Array:
    """Times (k,) at which a filter has to start anew: the first sample, and those after gaps beyond 0.5 s."""
    if len(t) == 0:
        return np.zeros(0)
    dt = np.diff(t)
    began: Array = t[np.concatenate([[True], ~((dt >= 0) & (dt <= gap.RESTART_S))])]
    return began
