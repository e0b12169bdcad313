"""Heights above what a vehicle stood on: by rangefinder, barometer or GNSS, never by what an estimator believes."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view
from numpy.typing import NDArray

from attlog.flight.model import FlightLog, Stream
from attlog.segments.airborne.grid import STALE_S, STEP_S, Grid, held, nearest_s, runs

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]

HINT_M = {"range": 0.3, "barometer": 0.7, "GNSS": 3.0}
SURE_M = {"range": 0.5, "barometer": 2.0, "GNSS": 12.0}
HIGHEST_HAND_M_S, CLIMBS_M_S = 2.0, 0.5
"""What stands moves no faster over the ground, and neither climbs nor sinks faster."""
LEVEL_S, STANDS_S = 1.0, 1.0
MOVED_M = 0.5
"""A rangefinder that never reads this much more than at its lowest hangs too low, or looks at nothing."""
SEEN = 0.95
"""A rangefinder in range for this part of a flight tells how high it went."""
ROSE_M = 0.3
"""A height that never rose by more tells of no flight."""
BEYOND, BEYOND_M = 1.5, 5.0
"""A barometer that rose by this factor and so much more than a rangefinder: that one looked out of its range. Wind and
propellers move a barometer by 4 m."""
SPIKE_M, SPIKE_S = 15.0, 4.0
"""A height so far off the median of so many s was never flown: a climb of 10 m/s^2 is 5 m off there."""
FALLS_S, FALLS_M = 10.0, 5.0
"""A pause of the drive of up to so long in which the height changes by more than this is a fall or a climb in the air:
on the ground propellers move a barometer by up to 4 m."""


@dataclass(frozen=True, slots=True)
class Level:
    """A height (n,) m above what the vehicle stood on, NaN where unknown, by a ``sensor`` named as in HINT_M."""

    sensor: str
    source: str
    above: Array

    @property
    def hint(self) -> Mask:
        """Where it is higher than what makes a flight likely."""
        return np.nan_to_num(self.above, nan=-1.0) > HINT_M[self.sensor]

    @property
    def sure(self) -> Mask:
        """Where it is higher than what proves a flight."""
        return np.nan_to_num(self.above, nan=-1.0) > SURE_M[self.sensor]


def levels_of(log: FlightLog, grid: Grid, driven: Mask) -> list[Level]:
    """Heights over the ground, the surest first."""
    stands = ~driven & grid.known & ~(grid.speed > HIGHEST_HAND_M_S)
    found = []
    if log.rangefinder is not None and len(log.rangefinder.t) > 3:
        raw = held(grid.t, log.rangefinder, np.nan) * np.clip(np.nan_to_num(grid.down[:, 2], nan=1.0), 0.0, 1.0)
        ranged = (
            raw - np.nanmedian(raw[stands]) if np.isfinite(raw[stands]).any() else raw - np.nanmin(raw, initial=1e9)
        )
        if np.nanmax(ranged, initial=0.0) > MOVED_M:
            found.append(Level("range", log.rangefinder.source, ranged))
    for sensor, stream in _heights(log):
        level = _averaged(grid.t, stream)
        climb = np.gradient(level, STEP_S)
        ground = _eroded(stands & (np.abs(np.nan_to_num(climb, nan=9.0)) < CLIMBS_M_S), round(STANDS_S / STEP_S))
        ground &= np.isfinite(level)
        if ground.any():
            found.append(Level(sensor, stream.source, level - np.interp(grid.t, grid.t[ground], level[ground])))
            break
    return found


def highest(levels: list[Level], flying: Mask) -> tuple[Level, float] | None:
    """The height that tells how high it went while ``flying`` (n,), and its largest there, m; None where none does.

    A rangefinder that sees the ground nearly all the time is right, unless the barometer shows that it went beyond its
    range; a barometer feels wind; GNSS stays behind.
    """
    tops = [(level, float(np.nanmax(level.above[flying], initial=-np.inf))) for level in levels]
    others = max((top for level, top in tops if level.sensor != "range"), default=-np.inf)

    def rank(told: tuple[Level, float]) -> int:
        level, top = told
        if level.sensor != "range":
            return 1
        seen = np.isfinite(level.above[flying]).mean() > SEEN
        return 0 if seen and others <= BEYOND * top + BEYOND_M else 2

    return next((told for told in sorted(tops, key=rank) if told[1] > ROSE_M), None)


def joined_aloft(log: FlightLog, grid: Grid, found: list[tuple[int, int]]) -> list[tuple[int, int]]:
    """Index ranges of flights, as one where the height between two of them moves as nothing on the ground does.

    Throttle near zero, or a force near zero, ends the signs of flight; a vehicle that falls is still in the air.
    """
    stream = height(log)
    if stream is None or len(found) < 2:
        return found
    level = _averaged(grid.t, stream)
    joined = found[:1]
    for a, b in found[1:]:
        end = joined[-1][1]
        pause = level[end : a + 1]
        moved = float(np.nanmax(pause) - np.nanmin(pause)) if np.isfinite(pause).any() else 0.0
        if (a - end) * STEP_S <= FALLS_S and moved > FALLS_M and bool(grid.known[end:a].all()):
            joined[-1] = joined[-1][0], b
        else:
            joined.append((a, b))
    return joined


def height(log: FlightLog) -> Stream | None:
    """Height (n, 1) in m over time: the barometer, else GNSS altitude with a 3D fix, else None."""
    return next((stream for _, stream in _heights(log)), None)


def _heights(log: FlightLog) -> list[tuple[str, Stream]]:
    """Streams of height in m (m, 1) without bad values: the barometer, then GNSS with a fix."""
    found = []
    for stream in log.baro:
        x = stream.x.reshape(len(stream.t), -1)[:, 0] if len(stream.t) else np.zeros(0)
        good = np.isfinite(x)
        if stream.unit == "m" and np.count_nonzero(good) > 10:
            found.append(("barometer", Stream(stream.t[good], x[good, None], "m", "", stream.source)))
            break
    for gnss in log.gnss:
        good = (gnss.fix >= 3) & np.isfinite(gnss.alt) & np.isfinite(gnss.t)
        if np.count_nonzero(good) > 10:
            found.append(("GNSS", Stream(gnss.t[good], gnss.alt[good, None], "m", "", gnss.source)))
            break
    return found


def _averaged(t: Array, stream: Stream) -> Array:
    """A height (n,) averaged over 1 s without spikes, NaN where none is near."""
    raw = np.interp(t, stream.t, stream.x[:, 0])
    around = round(0.5 * SPIKE_S / STEP_S)
    middle = np.median(sliding_window_view(np.pad(raw, around, mode="edge"), 2 * around + 1), axis=1)
    raw = np.where(np.abs(raw - middle) > SPIKE_M, middle, raw)
    half = round(0.5 * LEVEL_S / STEP_S)
    mean = np.convolve(np.pad(raw, half, mode="edge"), np.full(2 * half + 1, 1.0 / (2 * half + 1)), "valid")
    near: Array = np.where(nearest_s(t, stream.t) <= STALE_S, mean, np.nan)
    return near


def _eroded(mask: Mask, count: int) -> Mask:
    """The samples of a mask that lie in runs of at least ``count`` samples."""
    kept = np.zeros(len(mask), bool)
    for a, b in runs(mask):
        kept[a:b] = b - a >= count
    return kept
