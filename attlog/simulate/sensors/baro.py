"""A barometer: pressure of the standard atmosphere with noise, walk and counts."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from attlog.simulate.flight import BaroStream, Truth
from attlog.simulate.physics.environment import LAPSE, SEA_KELVIN, height_of, pressure
from attlog.simulate.physics.streams import generator
from attlog.simulate.scenario.scenario import Scenario
from attlog.simulate.sensors.base import SlowSensor, at
from attlog.simulate.sensors.damage import damaged, silent

Array = NDArray[np.float64]


class BaroSensor(SlowSensor):
    """Pressure [Pa] and the height of the standard atmosphere that it means [m]."""

    def __init__(self, scenario: Scenario, number: int, seed: int) -> None:
        s = scenario.sensors.baro[number]
        super().__init__("baro", number, scenario, seed, s.rate_hz, s.jitter_s, s.delay_s, s.loss_pct, s.gaps)
        self.kept &= ~silent(self.faults, self.instants)
        count = len(self.instants)
        noise = generator(seed, "baro", number, "noise").standard_normal((count, 2))
        walk = np.cumsum(noise[:, 1]) * s.walk_m_rts / math.sqrt(s.rate_hz)
        self.error = s.offset_m + s.noise_m_rthz * math.sqrt(s.rate_hz) * noise[:, 0] + walk
        self.pressure, self.step, self.rate_hz = np.zeros(count), s.step_pa, s.rate_hz

    def measure(self, truth: Truth, k: NDArray[np.int64]) -> None:
        t = self.instants[k]
        height = self.scenario.place.alt_m - at(truth.p, t, self.period)[:, 2] + self.error[k]
        if self.faults:
            last = height_of(self.pressure[k[0] - 1 : k[0]]) if k[0] else height[:1]
            height = damaged(self.faults, t, height[:, None], last, self.seed)[:, 0]
        told = pressure(height)
        self.pressure[k] = self.step * np.round(told / self.step) if self.step > 0 else told

    def height(self, k: int) -> float:
        """Height [m] above the take-off place that sample ``k`` means."""
        return float(height_of(self.pressure[k : k + 1])[0]) - self.scenario.place.alt_m

    def stream(self) -> BaroStream:
        """All samples that arrived."""
        keep = np.flatnonzero(self.kept[: self.next])
        p = self.pressure[keep]
        height = height_of(p)
        warm = SEA_KELVIN - 273.15 - LAPSE * height + 20.0
        return BaroStream(self.number, self.rate_hz, self.t[keep], self.t_sample[keep], p, height, warm)
