"""A GNSS receiver: position and velocity of its antenna, late, with white noise and a slow wander."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from attlog.base import rotation
from attlog.simulate.autopilot.autopilot import Fix
from attlog.simulate.flight import GnssStream, Truth
from attlog.simulate.physics.environment import geodetic
from attlog.simulate.physics.streams import generator
from attlog.simulate.scenario.scenario import Scenario
from attlog.simulate.sensors.base import SlowSensor, at, attitude_at
from attlog.simulate.sensors.damage import damaged, silent

Array = NDArray[np.float64]
STILL_UNKNOWN = 99.0
"""What a receiver states as its accuracy without a fix, m."""


class GnssSensor(SlowSensor):
    """Fixes in earth axes; the antenna's lever arm acts on position and velocity."""

    def __init__(self, scenario: Scenario, number: int, seed: int) -> None:
        s = self.settings = scenario.sensors.gnss[number]
        super().__init__("gnss", number, scenario, seed, s.rate_hz, s.jitter_s, s.delay_s, s.loss_pct)
        self.kept &= ~silent(self.faults, self.instants)
        count = len(self.instants)
        white = generator(seed, "gnss", number, "noise").standard_normal((count, 6))
        self.noise = white * np.array([s.noise_h_m] * 2 + [s.noise_v_m] + [s.noise_speed_m_s] * 3)
        stays = math.exp(-1.0 / (s.rate_hz * s.wander_s))
        drawn = generator(seed, "gnss", number, "wander").standard_normal((count, 3)) * [1.0, 1.0, 2.0]
        wander = np.zeros((count, 3))
        value = np.zeros(3)
        for k in range(count):
            value = drawn[k] if k == 0 else stays * value + math.sqrt(1.0 - stays * stays) * drawn[k]
            wander[k] = value
        self.noise[:, :3] += s.wander_m * wander
        self.fixed = self.instants >= s.first_fix_s
        for begin, end in s.outages:
            self.fixed &= (self.instants < begin) | (self.instants >= end)
        self.pv = np.zeros((count, 6))

    def measure(self, truth: Truth, k: NDArray[np.int64]) -> None:
        t, arm = self.instants[k], np.array(self.settings.antenna_m)
        self.pv[k, :3] = at(truth.p, t, self.period)
        self.pv[k, 3:] = at(truth.v, t, self.period)
        if arm.any():
            q = attitude_at(truth.q, t, self.period)
            self.pv[k, :3] += rotation.rotate(q, arm)
            self.pv[k, 3:] += rotation.rotate(q, np.cross(at(truth.w, t, self.period), arm))
        self.pv[k] += self.noise[k]
        for part in (slice(0, 3), slice(3, 6)) if self.faults else ():
            last = self.pv[k[0] - 1, part] if k[0] else np.zeros(3)
            self.pv[k, part] = damaged(self.faults, t, self.pv[k, part], last, self.seed)

    def fix(self, k: int) -> Fix | None:
        """Fix number ``k`` as the autopilot gets it, None where there was none."""
        return Fix(float(self.t_sample[k]), self.pv[k, :3], self.pv[k, 3:]) if self.fixed[k] else None

    def stream(self) -> GnssStream:
        """All messages that arrived; those without a fix hold no position."""
        s, keep = self.settings, np.flatnonzero(self.kept[: self.next])
        has = self.fixed[keep]
        ned = np.where(has[:, None], self.pv[keep, :3], np.nan)
        lat, lon, alt = geodetic(self.scenario, ned)
        h = math.hypot(math.sqrt(2.0) * s.noise_h_m, math.sqrt(2.0) * s.wander_m)
        v = math.hypot(s.noise_v_m, 2.0 * s.wander_m)
        return GnssStream(
            instance=self.number,
            rate_hz=s.rate_hz,
            t=self.t[keep],
            t_sample=self.t_sample[keep],
            lat=lat,
            lon=lon,
            alt=alt,
            ned=ned,
            vel=np.where(has[:, None], self.pv[keep, 3:], np.nan),
            h_acc=np.where(has, h, STILL_UNKNOWN),
            v_acc=np.where(has, v, STILL_UNKNOWN),
            s_acc=np.where(has, max(math.sqrt(3.0) * s.noise_speed_m_s, 0.01), STILL_UNKNOWN),
            fix=np.where(has, 3, 0),
            satellites=np.where(has, 14, 0),
            utc=self.scenario.place.unix_time + self.t_sample[keep],
        )
