"""Arrays of one row or a sensor for a figure; long ones are envelopes that keep every peak."""

from __future__ import annotations

import math
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from attlog.core import jit
from attlog.core.jit import F2, I1, Out2

Array = NDArray[np.float64]


# Samples per angle over all rows of a figure; beyond it envelopes take over.
BUDGET = 100_000
# Samples that every row keeps, however many rows there are.
MIN_SAMPLES = 2000
# What is beyond is infinite. (The question whether a number is finite would call the compiler's own library.)
LARGEST = 1e300


@dataclass(slots=True)
class Trace:
    """Arrays of one row for one figure; never in the JSON.

    ``figure`` and its ``columns`` (all (n,), degrees, NaN breaks the line):
    ``attitude``: roll pitch heading at the row's own times (the reference is drawn
    too, as ``truth`` or ``smoother`` where it is no row); ``difference``: total heading tilt roll pitch at
    the reference's times; ``sigma``: tilt and heading, how wrong a smoother says it may be itself;
    ``rest``: roll pitch heading in the longest rest, each minus its straight line; ``spread``: angle and
    share (%) of the samples of roll and pitch there, a straight line taken out of every 5 s;
    ``drift``: heading error block means and ``line`` (fit), each minus the mean of the heading, ``key`` = "rest" or the
    heading reference; ``allan``: tau (also ``t``), deviation of the averaged angle, low, high,
    ``key`` = axis; ``bias``: x y z in deg/s, of filters and of the onboard estimator; ``step``: est and ref of the
    representative event and ``set`` (set-point), t from its onset, ``key`` = "axis@onset";
    ``steps``: median low high of the error in % of the stroke over all events
    of an axis, ``ref`` the reference's median, ``key`` = "axis (events)"; ``setpoint``: roll and pitch response to a
    unit step, t from the step; ``demand`` (no row): roll pitch heading of the attitude set-point.

    Traces of sensors and the height have no row: see :mod:`attlog.metrics.sensor_traces` and ``height``.

    Long arrays are envelopes: smallest and largest value of each bucket; ``ratio`` is
    the number of samples that one stored sample stands for. ``values`` are single
    numbers that belong to the arrays.
    """

    figure: str
    row: str
    t: NDArray[np.float64]
    columns: dict[str, NDArray[np.float64]]
    key: str = ""
    ratio: float = 1.0
    values: dict[str, float] = field(default_factory=dict)


@dataclass(slots=True)
class SampleBudget:
    """Number of samples that each row of a figure keeps, for rows that pass one by one.

    First ``replays`` replayed rows pass, then others with ``others`` samples in all. A replayed row has the share that
    it would have if all were as long: they have the samples of one unit.
    """

    replays: int = 0
    others: int = 0
    passed: int = 0

    def keep(self, n: int, replayed: bool) -> int:
        """Return how many of its n samples the next row keeps."""
        self.passed += n if replayed else 0
        total = self.others + (self.replays * n if replayed else self.passed)
        return n if total <= 1.1 * BUDGET else min(n, max(BUDGET * n // total, MIN_SAMPLES))


def envelope(t: Array, columns: Array, keep: int) -> tuple[Array, Array]:
    """Return times (m,) and columns (m, k) of (n,), (n, k) with at most ``keep`` samples: extremes of buckets.

    The two values of a bucket stand at its first and its middle time, so that all columns share the times; a peak keeps
    its height and moves by less than a bucket. A bucket with NaN in it keeps a NaN, so that a gap stays a gap.
    """
    n, buckets = len(t), max(keep // 2, 1)
    if n <= max(keep, 2):
        return t, columns
    edges = np.linspace(0, n, buckets + 1).astype(np.int64)
    first, middle = edges[:-1], (edges[:-1] + edges[1:]) // 2
    out = np.empty((2 * buckets, columns.shape[1]))
    extremes(out, np.ascontiguousarray(columns), edges)
    return np.column_stack([t[first], t[middle]]).ravel(), out


@jit.loop("envelopes of long lines")
def extremes(out: Out2, x: F2, edges: I1) -> None:
    """Fill ``out`` (2 m, k) with both extremes of the columns of ``x`` (n, k) between ``edges`` (m + 1,), as they came.

    NaN for the second where the bucket holds a NaN, for both where it holds nothing else, and for what is infinite.
    """
    for b in range(len(edges) - 1):
        for c in range(x.shape[1]):
            low, high = math.inf, -math.inf
            at_low, at_high, gap = 0, 0, False
            for i in range(edges[b], edges[b + 1]):
                value = x[i, c]
                if value < low:
                    low, at_low = value, i
                if value > high:
                    high, at_high = value, i
                if value != value:
                    gap = True
            first, second = low, high
            if at_high < at_low:
                first, second = high, low
            if gap or not -LARGEST < second < LARGEST:
                second = math.nan
            if not -LARGEST < first < LARGEST:
                first = math.nan
            out[2 * b, c], out[2 * b + 1, c] = first, second
