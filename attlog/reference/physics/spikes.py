"""Does the gyro jump for single samples? No vehicle turns away and back within two samples."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from attlog.base import rotation
from attlog.flight.model import Imu
from attlog.segments import gaps

TIMES, LEAST_DPS = 20.0, 100.0
"""A spike is so many times further from the mean of its neighbours than the median sample, and so far."""
ALONE = 3.0
"""It is so many times further from them than they are from each other: else it is the turn itself."""
FEW = 5
"""So many in a log are reported; a blow makes one or two."""
BLOW_M_S2, BLOW_S = 30.0, 0.02
"""So near a force of 3 g the vehicle was struck, and the gyro felt it too."""
MOST_DEG_PER_MIN = 20.0
"""Spikes that turn further than this, together, are more than the bias of a calibrated gyro (0.3 deg/s)."""


@dataclass(frozen=True, slots=True)
class Spikes:
    """How many samples jump, how far they turn together (deg/min), the first's time, and why that is wrong (or "")."""

    count: int = 0
    deg_per_min: float = 0.0
    t: float | None = None
    why: str = ""

    @property
    def misleads(self) -> bool:
        """Whether who integrates them is wrong by more than a filter can learn."""
        return self.deg_per_min > MOST_DEG_PER_MIN


def of(imu: Imu) -> Spikes:
    """The spikes of a gyro, counted where both neighbours are a usual interval away."""
    t, rate = gaps.rising(imu.gyro.t_best, imu.gyro.x)
    if len(t) < 100:
        return Spikes()
    dt = np.diff(t)
    usual = float(np.median(dt))
    off = rate[1:-1] - 0.5 * (rate[:-2] + rate[2:])
    size = rotation.length(off)
    change = rotation.length(rate[2:] - rate[:-2])
    regular = (np.maximum(dt[:-1], dt[1:]) < 1.5 * usual) & np.isfinite(size)
    if not regular.any():
        return Spikes()
    least = max(TIMES * float(np.median(size[regular])), np.radians(LEAST_DPS))
    found = np.flatnonzero(regular & (size > least) & (size > ALONE * change))
    found = found[~_struck(imu, t[found + 1])]
    if len(found) < FEW:
        return Spikes(len(found))
    turned = float(np.degrees(np.sum(size[found]) * usual)) * 60.0 / (usual * len(t))
    why = (
        f"{imu.gyro.source} jumps {len(found)} times for a single sample, by up to "
        f"{np.degrees(size[found].max()):.0f} deg/s; together they turn a filter by {turned:.0f} deg in a minute"
    )
    return Spikes(len(found), turned, float(t[found[0] + 1]), why)


def _struck(imu: Imu, t: NDArray[np.float64]) -> NDArray[np.bool_]:
    """Which times (n,) lie so near a blow on the accelerometer that both sensors felt the same."""
    stamps = imu.acc.t_best
    blows = np.sort(stamps[(rotation.length(imu.acc.x) > BLOW_M_S2) & np.isfinite(stamps)])
    if not len(blows):
        return np.zeros(len(t), bool)
    k = np.searchsorted(blows, t)
    before, after = blows[np.maximum(k - 1, 0)], blows[np.minimum(k, len(blows) - 1)]
    near: NDArray[np.bool_] = np.minimum(np.abs(t - before), np.abs(t - after)) < BLOW_S
    return near
