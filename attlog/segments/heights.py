"""Heights above the ground that show flight, by rangefinder, barometer, GNSS or the onboard estimator.

They are relative to the ground height interpolated between rests before and after. The estimator's height counts only
where sensors are missing: on the ground with motors on it read +7.7 m.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view
from numpy.typing import NDArray

from attlog.core.brief import brief
from attlog.core.sorting import median, nanmedian
from attlog.flight.model import FlightLog, Stream
from attlog.segments.flight_signs import MAX_AGE_S, STEP_S, Grid, hold_last, seconds_to_nearest, true_runs

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]

LIKELY_HEIGHT_M = {"range": 0.3, "barometer": 0.7, "GNSS": 3.0, "estimator": 3.0}
CERTAIN_HEIGHT_M = {"range": 0.5, "barometer": 2.0, "GNSS": 12.0, "estimator": 12.0}
# Maximum ground speed and climb rate of a vehicle at rest or carried by hand.
MAX_GROUND_SPEED_M_S, MAX_GROUND_CLIMB_M_S = 2.0, 0.5
# Averaging time of a height, and minimum time at rest that gives the ground height.
HEIGHT_MEAN_S, MIN_STAND_S = 1.0, 1.0
# Minimum change of a rangefinder's height; below it the sensor sits too low or sees no ground.
MIN_RANGE_CHANGE_M = 0.5
# Minimum share of a flight in range for a rangefinder to be preferred for the height.
MIN_RANGED_SHARE = 0.95
# Minimum height that is reported for a flight.
MIN_REPORTED_HEIGHT_M = 0.3
# A flight left the rangefinder's range where the barometer's top exceeds this ratio of the range's plus this height:
# wind and propellers shift a barometer by up to 4 m.
OUT_OF_RANGE_RATIO, OUT_OF_RANGE_M = 1.5, 5.0
# A height sample further than SPIKE_M from the median over SPIKE_S is a spike: 10 m/s^2 of climb gives 5 m only.
SPIKE_M, SPIKE_S = 15.0, 4.0
# Step of an estimated height that is a reset: minimum, and minimum vertical speed.
JUMP_M, JUMP_M_S = 10.0, 60.0


@dataclass(frozen=True, slots=True)
class HeightLevel:
    """Height (n,) m above the ground, NaN where unknown, by a ``sensor`` of LIKELY_HEIGHT_M.

    ``jumps``: it is reset by metres in the air, so that its top means nothing.
    """

    sensor: str
    source: str
    above: Array
    jumps: bool = False
    __repr__ = brief

    @property
    def hint(self) -> Mask:
        """Mask (n,) of heights above which flight is likely."""
        return np.nan_to_num(self.above, nan=-1.0) > LIKELY_HEIGHT_M[self.sensor]

    @property
    def sure(self) -> Mask:
        """Mask (n,) of heights above which flight is certain."""
        return np.nan_to_num(self.above, nan=-1.0) > CERTAIN_HEIGHT_M[self.sensor]


def height_levels(log: FlightLog, grid: Grid, grounded: Mask) -> list[HeightLevel]:
    """Return heights above ground: rangefinder first, then barometer or GNSS, else the estimator's.

    ``grounded`` (n,): mask of times at which the vehicle may be on the ground; moving and climbing are left out.
    """
    grounded = grounded & grid.known & ~(grid.speed > MAX_GROUND_SPEED_M_S)
    found = []
    if log.rangefinder is not None and len(log.rangefinder.t) > 3:
        raw = hold_last(grid.t, log.rangefinder, np.nan) * np.clip(np.nan_to_num(grid.down[:, 2], nan=1.0), 0.0, 1.0)
        ranged = (
            raw - nanmedian(raw[grounded]) if np.isfinite(raw[grounded]).any() else raw - np.nanmin(raw, initial=1e9)
        )
        if np.nanmax(ranged, initial=0.0) > MIN_RANGE_CHANGE_M:
            found.append(HeightLevel("range", log.rangefinder.source, ranged))
    for sensor, stream in _height_streams(log):
        level = averaged_height(grid.t, stream)
        climb = np.gradient(level, STEP_S)
        level_ground = grounded & (np.abs(np.nan_to_num(climb, nan=9.0)) < MAX_GROUND_CLIMB_M_S)
        ground = long_runs(level_ground, round(MIN_STAND_S / STEP_S)) & np.isfinite(level)
        if ground.any():
            above = level - np.interp(grid.t, grid.t[ground], level[ground])
            found.append(HeightLevel(sensor, stream.source, above, sensor == "estimator" and has_jumps(stream)))
            break
    return found


def highest_level(levels: list[HeightLevel], flying: Mask) -> tuple[HeightLevel, float] | None:
    """Return the preferred height source and its maximum in m while flying.

    ``flying`` (n,): mask. None without a reportable height. A rangefinder in range for 95 % of the time is preferred,
    unless the barometer shows that the vehicle left its range. Barometer height changes with wind; GNSS height lags.
    """
    steady = [level for level in levels if not level.jumps]
    tops = [(level, float(np.nanmax(level.above[flying], initial=-np.inf))) for level in steady]
    others = max((top for level, top in tops if level.sensor != "range"), default=-np.inf)

    def rank(candidate: tuple[HeightLevel, float]) -> int:
        level, top = candidate
        if level.sensor != "range":
            return 1
        seen = np.count_nonzero(np.isfinite(level.above[flying])) > MIN_RANGED_SHARE * np.count_nonzero(flying)
        return 0 if seen and others <= OUT_OF_RANGE_RATIO * top + OUT_OF_RANGE_M else 2

    return next(((level, top) for level, top in sorted(tops, key=rank) if top > MIN_REPORTED_HEIGHT_M), None)


def height_stream(log: FlightLog) -> Stream | None:
    """Return height (n, 1) in m over time: barometer, else GNSS with a 3D fix, else the estimator, else None."""
    return next((stream for _, stream in _height_streams(log)), None)


def _height_streams(log: FlightLog) -> list[tuple[str, Stream]]:
    """Return good heights (m, 1) in m: barometer that is not stuck, then GNSS with a fix, else the estimator."""
    found = []
    for stream in log.baro:
        x = stream.x.reshape(len(stream.t), -1)[:, 0] if len(stream.t) else np.zeros(0)
        good = np.isfinite(x)
        if stream.unit == "m" and np.count_nonzero(good) > 10 and np.ptp(x[good]) > 0.0:
            found.append(("barometer", Stream(stream.t[good], x[good, None], "m", "", stream.source)))
            break
    for gnss in log.gnss:
        good = (gnss.fix >= 3) & np.isfinite(gnss.alt) & np.isfinite(gnss.t)
        if np.count_nonzero(good) > 10:
            found.append(("GNSS", Stream(gnss.t[good], gnss.alt[good, None], "m", "", gnss.source)))
            break
    height = log.estimator.height
    if not found and height is not None and len(height.t) > 10:
        found.append(("estimator", height))
    return found


def has_jumps(stream: Stream) -> bool:
    """Return whether a height steps as no vehicle moves."""
    step = np.abs(np.diff(stream.x[:, 0]))
    return bool(np.any((step > JUMP_M) & (step > JUMP_M_S * np.diff(stream.t))))


def averaged_height(t: Array, stream: Stream) -> Array:
    """Return height (n,) averaged over 1 s, without spikes; NaN where no sample is near."""
    raw = np.interp(t, stream.t, stream.x[:, 0])
    around = round(0.5 * SPIKE_S / STEP_S)
    middle = median(sliding_window_view(np.pad(raw, around, mode="edge"), 2 * around + 1), axis=1)
    raw = np.where(np.abs(raw - middle) > SPIKE_M, middle, raw)
    half = round(0.5 * HEIGHT_MEAN_S / STEP_S)
    mean = np.convolve(np.pad(raw, half, mode="edge"), np.full(2 * half + 1, 1.0 / (2 * half + 1)), "valid")
    usual = float(median(np.diff(stream.t))) if len(stream.t) > 1 else 0.0
    near: Array = np.where(seconds_to_nearest(t, stream.t) <= max(MAX_AGE_S, usual), mean, np.nan)
    return near


def long_runs(mask: Mask, count: int) -> Mask:
    """Return the samples of a mask in runs of at least ``count`` samples."""
    kept = np.zeros(len(mask), bool)
    for a, b in true_runs(mask):
        kept[a:b] = b - a >= count
    return kept
