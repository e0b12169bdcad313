"""Arithmetic with spans of time: lists of (t0, t1) in s."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Span = tuple[float, float]


def merge(spans: Iterable[Span]) -> list[Span]:
    """Return the union of spans as ascending, disjoint spans."""
    merged: list[Span] = []
    for t0, t1 in sorted(s for s in spans if s[1] > s[0]):
        if merged and t0 <= merged[-1][1]:
            merged[-1] = (merged[-1][0], max(merged[-1][1], t1))
        else:
            merged.append((t0, t1))
    return merged


def intersect(a: Iterable[Span], b: Iterable[Span]) -> list[Span]:
    """Return the intersection of two lists of spans."""
    a, b = merge(a), merge(b)
    common, i, j = [], 0, 0
    while i < len(a) and j < len(b):
        t0, t1 = max(a[i][0], b[j][0]), min(a[i][1], b[j][1])
        if t1 > t0:
            common.append((t0, t1))
        if a[i][1] < b[j][1]:
            i += 1
        else:
            j += 1
    return common


def clipped(spans: Iterable[Span], segments: Iterable[Span]) -> list[Span]:
    """Return the spans cut at the segments' edges; segments ascend and may touch."""
    a, found, i = merge(spans), [], 0
    for t0, t1 in (s for s in segments if s[1] > s[0]):
        while i < len(a) and a[i][1] <= t0:
            i += 1
        k = i
        while k < len(a) and a[k][0] < t1:
            found.append((max(a[k][0], t0), min(a[k][1], t1)))
            k += 1
    return found


def complement(spans: Iterable[Span], t0: float, t1: float) -> list[Span]:
    """Return the time of [t0, t1] outside all spans."""
    edges = [t0]
    for a, b in merge(spans):
        edges += [min(max(a, t0), t1), min(max(b, t0), t1)]
    edges.append(t1)
    return [(a, b) for a, b in zip(edges[::2], edges[1::2], strict=True) if b > a]


def seconds(spans: Iterable[Span]) -> float:
    """Return the total length in s; overlaps count once."""
    return float(sum(b - a for a, b in merge(spans)))


def inside(t: Array, spans: Iterable[Span]) -> NDArray[np.bool_]:
    """Select the times (n,) within a span, ends included."""
    if not (t[1:] >= t[:-1]).all():
        return overlaps(t, t, spans)
    ends = np.array(merge(spans)).reshape(-1, 2)
    edges = np.stack([np.searchsorted(t, ends[:, 0], "left"), np.searchsorted(t, ends[:, 1], "right")], axis=1).ravel()
    return np.repeat(np.arange(len(edges) + 1) % 2 == 1, np.diff(edges, prepend=0, append=len(t)))


def between(t: Array, t0: float, t1: float) -> slice:
    """Return the slice of rising times (n,) in [t0, t1], by bisection."""
    return slice(int(np.searchsorted(t, t0, side="left")), int(np.searchsorted(t, t1, side="right")))


def overlaps(t0: Array, t1: Array, spans: Iterable[Span]) -> NDArray[np.bool_]:
    """Select the windows [t0, t1] (n,) that touch a span."""
    merged = merge(spans)
    if not merged:
        return np.zeros(len(t0), bool)
    start, end = (np.array(x) for x in zip(*merged, strict=True))
    return np.searchsorted(end, t0, side="left") < np.searchsorted(start, t1, side="right")
