"""Samples as an estimator in the loop takes them: each cleaned by the rules of the shared loop as it comes."""

from __future__ import annotations

import math
from collections import Counter
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from attlog.base import gap
from attlog.base.limits import ACC_LIMIT_M_S2, GYRO_LIMIT_RAD_S
from attlog.estimators.engine.samples import HELD, HOLD_PERIODS, MISSING, NEW
from attlog.simulate.autopilot.onboard_aids import Inbox

Array = NDArray[np.float64]


@dataclass(slots=True)
class Sample:
    """One cleaned sample, as a row of :class:`attlog.estimators.engine.samples.Samples`, with its aid or None.

    ``restart``: it comes after a gap that nothing bridges, and begins a segment.
    """

    t: float
    dt: float
    substeps: int
    gyr: Array
    acc: Array
    mag: Array
    use: int
    aid: Array | None
    restart: bool = False


class Cleaner:
    """Remembers of the samples before what the next one needs. ``hold_mag``: whether a field serves until the next;
    ``aids``: where a sample's aid comes from, None for an estimator that takes none. ``skipped`` counts why."""

    def __init__(
        self, imu_rate: float, mag_rate: float | None, *, hold_mag: bool, instant: bool, aids: Inbox | None
    ) -> None:
        self._gap = gap.limit(1.0 / imu_rate)
        self._hold = HOLD_PERIODS / mag_rate if mag_rate and hold_mag else -1.0
        self._instant, self._aids = instant, aids
        self.skipped: Counter[str] = Counter()
        self._last_t: float | None = None
        self._raw_last = np.zeros(3)
        self._field_t = -math.inf

    def cleaned(self, t: float, gyr: Array, acc: Array, mag: Array | None, own: float) -> Sample | None:
        """The sample as :func:`attlog.estimators.engine.samples.prepare` would clean it; None if it is left out."""
        last_t = self._last_t
        x, y, z = gyr.tolist()
        if not math.isfinite(t + x + y + z):
            self.skipped["nan"] += 1
            return None
        if max(abs(x), abs(y), abs(z)) > GYRO_LIMIT_RAD_S:
            self.skipped["saturated"] += 1
            return None
        if last_t is not None and t <= last_t:
            self.skipped["time_not_rising"] += 1
            return None
        gyr = np.array(gyr, np.float64)
        step = 0.0 if last_t is None else t - last_t
        restart = step > max(self._gap, gap.RESTART_S)
        if restart:
            self.skipped["restart"] += 1
            self._field_t = -math.inf
        begins = restart or last_t is None
        rate = gyr
        if not begins and (self._instant or step > self._gap):
            if step > self._gap:
                self.skipped["gap_bridged"] += 1
            rate = 0.5 * (self._raw_last + gyr)
        dt = 0.0 if begins else own if own > 0.0 and step < 1.5 * own else step
        angle = math.sqrt(float(rate @ rate)) * dt
        force = self._vector(acc, ACC_LIMIT_M_S2)
        field = np.zeros(3) if mag is None else self._vector(mag, math.inf)
        use = MISSING
        if mag is not None and field.any():
            use, self._field_t = NEW, t
        elif t - self._field_t <= self._hold:
            use = HELD
        self._last_t, self._raw_last = t, gyr
        aid = None if self._aids is None else self._aids.due(t, begins)
        return Sample(t, dt, 0 if begins else max(math.ceil(angle), 1), rate, force, field, use, aid, restart)

    def _vector(self, x: Array, limit: float) -> Array:
        """The vector, or zeros, which are counted, where it is not finite or not possible."""
        a, b, c = x.tolist()
        if not math.isfinite(a + b + c):
            self.skipped["nan"] += 1
        elif max(abs(a), abs(b), abs(c)) > limit:
            self.skipped["saturated"] += 1
        elif a == b == c == 0.0:
            self.skipped["zero_vector"] += 1
        else:
            return np.array(x, np.float64)
        return np.zeros(3)
