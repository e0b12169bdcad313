"""Rest and idling: when the vehicle stood still, by its own IMU.

Rest is what the noise and the gyro's offset are measured on, so it must never be
hover: the limit follows this log's quietest windows but is capped, because a log
with little rest would otherwise find "rest" in a calm hover.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from attlog.segments import spans
from attlog.segments.flags import FlagSpans
from attlog.segments.model import Segment
from attlog.segments.spans import Span
from attlog.segments.windows import Windows, join

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]

RATE_STD_LOW_DPS, RATE_STD_HIGH_DPS, FLOORS = 0.15, 0.6, 4.0
FORCE_STD_M_S2 = 0.15
MEAN_RATE_DPS = 0.3
NEIGHBOURS_S = 30.0
LONG_S, SHORT_S, IDLE_S = 10.0, 2.0, 1.0
"""Tried on simulated flights with truth and on real logs."""
IDLE_RATE_DPS = 1.0
IDLE_OFFSET_DPS = 3.0
"""Rates up to here may be the gyro's own offset where no rest tells it."""

ALIVE_M_S2 = 1.0
"""An accelerometer that shows less than this is not one that feels gravity."""


def rate_limit(windows: Windows) -> float:
    """The largest standard deviation of the gyro at rest, deg/s: clip(4 x floor, 0.15, 0.6)."""
    if len(windows.t0) == 0:
        return RATE_STD_LOW_DPS
    floor = np.quantile(windows.rate_std, 0.02)
    return float(np.clip(FLOORS * floor, RATE_STD_LOW_DPS, RATE_STD_HIGH_DPS))


def largest_limit(windows: Windows, motors: FlagSpans) -> float:
    """The largest standard deviation of the gyro that counts as rest in a log, deg/s."""
    return RATE_STD_HIGH_DPS if motors.measured else rate_limit(windows)


def still(windows: Windows, motors: FlagSpans) -> Mask:
    """Windows (m,) as still as a surface: little noise, and a mean rate like that of the other still windows around.

    The limit is capped because a calm hover is nearly as quiet. Where outputs show motors that stand still no
    hover is possible, and the cap alone is the limit.
    """
    limit = np.full(len(windows.t0), rate_limit(windows))
    if motors.measured:
        limit[~spans.overlaps(windows.t0, windows.t1, motors.spans)] = RATE_STD_HIGH_DPS
    quiet = (windows.rate_std < limit) & (windows.force_std < FORCE_STD_M_S2)
    quiet &= windows.force > ALIVE_M_S2
    around = _median_around(windows, quiet)
    off = np.sqrt(np.sum((windows.rate - around) ** 2, axis=1))
    steady: Mask = quiet & (off < MEAN_RATE_DPS)
    return steady


def rests(
    windows: Windows, still: Mask, airborne: FlagSpans, motors: FlagSpans, busy: list[Span], moving: Mask
) -> list[Segment]:
    """Rest of both classes. ``moving`` marks windows in which GNSS shows travel, or height a climb."""
    forbidden = [*airborne.spans, *busy]
    passed = still & ~moving & ~spans.overlaps(windows.t0, windows.t1, forbidden)
    limit = largest_limit(windows, motors)
    known = ["not airborne"] if airborne.known else []
    known += [f"not {motors.why}" if motors.why == "armed" else "motors stand still"] if motors.known else []
    found = []
    for t0, t1 in join(windows, passed):
        if t1 - t0 < SHORT_S:
            continue
        kind = "rest.long" if t1 - t0 >= LONG_S else "rest.short"
        inside = (windows.t0 >= t0 - 1e-9) & (windows.t1 <= t1 + 1e-9)
        noise = float(np.median(windows.rate_std[inside]))
        why = f"gyro noise {noise:.3f} deg/s (limit {limit:.2f}), accelerometer and mean rate steady"
        found.append(Segment(kind, t0, t1, ", ".join([why, *known])))
    return found


def idles(windows: Windows, still: Mask, airborne: FlagSpans, motors: FlagSpans, rests: list[Span]) -> list[Segment]:
    """Spans on the ground with motors turning, outside rest; none where nothing tells flight from ground."""
    if not airborne.known:
        return []
    offset = np.median(windows.rate[still], axis=0) if still.any() else np.zeros(3)
    limit = IDLE_RATE_DPS if still.any() else IDLE_OFFSET_DPS
    slow = np.sqrt(np.sum((windows.rate - offset) ** 2, axis=1)) < limit
    turning = spans.overlaps(windows.t0, windows.t1, motors.spans)
    passed = slow & turning & ~spans.overlaps(windows.t0, windows.t1, airborne.spans)
    allowed = spans.intersect(motors.spans, spans.complement(rests, -np.inf, np.inf))
    return [
        Segment("idle", t0, t1, f"{motors.why}, on the ground, mean rate under {limit:.0f} deg/s")
        for t0, t1 in spans.intersect(join(windows, passed), allowed)
        if t1 - t0 >= IDLE_S
    ]


def _median_around(windows: Windows, quiet: Mask) -> Array:
    """Median mean rate (m, 3) of the quiet windows within 30 s of each window; NaN where there is none."""
    around = np.full((len(quiet), 3), np.nan)
    i = np.flatnonzero(quiet)
    if len(i) == 0:
        return around
    t, rate = windows.middle[i], windows.rate[i]
    low = np.searchsorted(t, t - NEIGHBOURS_S, side="left")
    high = np.searchsorted(t, t + NEIGHBOURS_S, side="right")
    width = int(np.max(high - low))
    for a in range(0, len(i), 2048):
        block = slice(a, a + 2048)
        columns = low[block, None] + np.arange(width)
        beyond = columns >= high[block, None]
        values = rate[np.minimum(columns, len(i) - 1)]
        values[beyond] = np.inf
        values.sort(axis=1)
        count = high[block] - low[block]
        rows = np.arange(len(count))
        around[i[block]] = 0.5 * (values[rows, (count - 1) // 2] + values[rows, count // 2])
    return around
