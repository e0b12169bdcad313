"""A magnetometer: the earth's field in body axes, iron on board, the battery's current, noise, counts."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from attlog.base import rotation
from attlog.simulate.flight import MagStream, Truth
from attlog.simulate.physics.streams import generator
from attlog.simulate.scenario.scenario import Scenario
from attlog.simulate.sensors.base import SlowSensor, at, attitude_at
from attlog.simulate.sensors.damage import damaged, silent
from attlog.simulate.sensors.power import current

Array = NDArray[np.float64]


class MagSensor(SlowSensor):
    """``field = soft_iron R_mount^T (R^T B + hard iron + current) + noise``, clipped and rounded, T."""

    def __init__(self, scenario: Scenario, number: int, seed: int) -> None:
        s = scenario.sensors.mag[number]
        super().__init__(
            "mag", number, scenario, seed, s.rate_hz, s.jitter_s, s.delay_s, s.loss_pct, s.gaps, s.hidden_delay_s
        )
        self.kept &= ~silent(self.faults, self.instants)
        spread = generator(seed, "mag", number, "iron").standard_normal(3)
        self.hard = (np.array(s.hard_iron_ut) + s.hard_iron_spread_ut * spread) * 1e-6
        mount = rotation.to_matrix(rotation.from_euler(*np.radians(s.rotation_deg)))
        self.matrix: Array = np.array(s.soft_iron) @ mount.T
        noise = generator(seed, "mag", number, "noise").standard_normal((len(self.instants), 3))
        self.noise = noise * s.noise_ut_rthz * 1e-6 * math.sqrt(s.rate_hz)
        self.per_ampere = np.array(s.current_ut_a) * 1e-6
        self.limit, self.step, self.rate_hz = s.range_ut * 1e-6, s.step_ut * 1e-6, s.rate_hz
        self.field = np.zeros((len(self.instants), 3))

    def measure(self, truth: Truth, k: NDArray[np.int64]) -> None:
        t = self.instants[k]
        b = rotation.rotate_inverse(attitude_at(truth.q, t, self.period), at(truth.field, t, self.period))
        b = b + self.hard
        if self.per_ampere.any():
            b = b + current(self.scenario, at(truth.rotor, t, self.period))[:, None] * self.per_ampere
        x = b @ self.matrix.T + self.noise[k]
        x = np.clip(x, -self.limit, self.limit)
        if self.step > 0:
            x = self.step * np.floor(x / self.step + 0.5)
        if self.faults:
            last = self.field[k[0] - 1] if k[0] else np.zeros(3)
            x = damaged(self.faults, t, x, last, self.seed)
        self.field[k] = x

    def stream(self) -> MagStream:
        """All samples that arrived."""
        keep = np.flatnonzero(self.kept[: self.next])
        return MagStream(self.number, self.rate_hz, self.t[keep], self.t_sample[keep], self.field[keep])
