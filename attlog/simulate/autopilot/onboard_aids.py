"""Fixes and heights on their way to an estimator in the loop: each waits for the first sample at or after its time."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import ArrayLike, NDArray

from attlog.estimators.aids import (
    ALT,
    AT_REST,
    BARO,
    LAT,
    LON,
    POS_H_ACC,
    POS_V_ACC,
    SIZE,
    VEL_ACC,
    VEL_D,
    VEL_E,
    VEL_N,
)

Array = NDArray[np.float64]


class Inbox:
    """What has arrived and no sample has taken yet. ``north`` rad: where true north is from the north of the steps;
    ``asks_rest``: whether the estimator uses that the vehicle stands."""

    def __init__(self, north: float, asks_rest: bool) -> None:
        self._north, self._asks_rest = north, asks_rest
        self._arrived: list[tuple[float, dict[int, float]]] = []
        self._resting = math.nan

    def gnss(
        self, t: float, position: ArrayLike | None, velocity: ArrayLike | None, sigma: tuple[float, float, float]
    ) -> None:
        """A fix with stamp ``t``: latitude, longitude (deg), altitude (m); velocity NED (m/s) relative to true north.

        ``sigma``: 1 sigma of horizontal and vertical position (m) and of the velocity (m/s).
        """
        told: dict[int, float] = {}
        if position is not None:
            told |= dict(zip((LAT, LON, ALT), np.asarray(position, np.float64).tolist(), strict=True))
            told |= {POS_H_ACC: sigma[0], POS_V_ACC: sigma[1]}
        if velocity is not None:
            north, east, down = np.asarray(velocity, np.float64).tolist()
            # A step knows magnetic north only.
            c, s = math.cos(self._north), math.sin(self._north)
            told |= {VEL_N: c * north + s * east, VEL_E: c * east - s * north, VEL_D: down, VEL_ACC: sigma[2]}
        self._arrived.append((t, told))

    def baro(self, t: float, height: float) -> None:
        """Barometric height (m) with stamp ``t``."""
        self._arrived.append((t, {BARO: height}))

    def resting(self, rest: bool) -> None:
        """Whether the vehicle knows that it stands: landed and disarmed. Unknown until it is told."""
        self._resting = 1.0 if rest else 0.0

    def due(self, t: float, begins: bool) -> Array:
        """What has arrived until ``t``, the newest of each (2, SIZE), as the shared loop hands it to a step.

        The first sample of a segment (``begins``) takes no step, so it gets none.
        """
        due = [told for at, told in self._arrived if at <= t]
        self._arrived = [(at, told) for at, told in self._arrived if at > t]
        aid = np.full((2, SIZE), np.nan)
        aid[:, AT_REST] = self._resting if self._asks_rest else math.nan
        for told in due if not begins else ():
            for where, value in told.items():
                if math.isfinite(value):
                    aid[1, where] = value
        return aid
