"""An inertial unit in a flight: its errors drawn from the seed, its samples as they come."""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from attlog.base import biquad, rotation
from attlog.simulate.flight import ImuStream
from attlog.simulate.physics.kernel import bound, function_of, kernel_of
from attlog.simulate.physics.streams import generator
from attlog.simulate.scenario.scenario import Scenario
from attlog.simulate.sensors.damage import damaged, silent
from attlog.simulate.sensors.imu_kernel import OUT, RAW, SIGNATURE, STATE, imu_samples
from attlog.simulate.sensors.settings import ImuSettings
from attlog.simulate.sensors.timing import instants, kept

Array = NDArray[np.float64]
G = 9.80665
BLOCK = 512
"""Periods of the loop whose noise is drawn at once."""

KERNEL = kernel_of(imu_samples, SIGNATURE, "the simulated inertial unit")


class ImuSensor:
    """Instance ``number`` of a scenario's inertial units. ``advance`` is called with the raw rows of the periods in
    order."""

    def __init__(self, scenario: Scenario, number: int, seed: int, gravity: float) -> None:
        self.settings: ImuSettings = scenario.sensors.imu[number]
        self.number, self.seed, s = number, seed, self.settings
        self.substeps = scenario.loop.substeps
        self.period = 1.0 / scenario.loop.rate_hz
        self.h = self.period / self.substeps
        raw_hz = 1.0 / self.h
        timing = generator(seed, "imu", number, "timing")
        self.instants = instants(s.rate_hz, scenario.seconds, s.jitter_s, timing)
        self.times: list[float] = self.instants.tolist()
        self.kept = kept(self.instants, s.loss_pct, s.gaps, generator(seed, "imu", number, "loss"))
        self.faults = [f for f in scenario.fault if f.part in ("gyro", "acc") and f.instance == number]
        self.kept &= ~silent(self.faults, self.instants)
        self.unbalanced = [f for f in scenario.fault if f.part == "rotor" and f.kind == "unbalanced"]
        self.out = np.zeros((len(self.instants), OUT))
        self.bias = _biases(s, seed, number, round(scenario.seconds * scenario.loop.rate_hz), self.period)
        self.noise = generator(seed, "imu", number, "noise")
        self.block, self.used = np.zeros((0, 6)), 0
        self.matrices = np.ascontiguousarray(
            [_matrix(s, s.gyro.misalign_deg, s.gyro.scale_pct), _matrix(s, s.acc.misalign_deg, s.acc.scale_pct)]
        )
        bandwidth = [
            raw_hz if s.sampling == "interval" or low > 0 else s.rate_hz
            for low in (s.gyro.lowpass_hz, s.acc.lowpass_hz)
        ]
        hover = scenario.vehicle.speed_max_rad_s * math.sqrt(min(scenario.vehicle.hover_command(gravity), 1.0))
        self.numbers = np.array(
            [
                *s.position_m,
                math.radians(s.gyro.range_dps),
                s.acc.range_g * G,
                math.radians(s.gyro.step_dps),
                s.acc.step_mg * 1e-3 * G,
                math.radians(s.gyro.noise_dps_rthz) * math.sqrt(bandwidth[0]),
                s.acc.noise_ug_rthz * 1e-6 * G * math.sqrt(bandwidth[1]),
                float(s.gyro.lowpass_hz > 0),
                float(s.acc.lowpass_hz > 0),
                *low_pass(s.gyro.lowpass_hz, raw_hz),
                *low_pass(s.acc.lowpass_hz, raw_hz),
                float(s.sampling == "interval"),
                hover,
            ]
        )
        self.harmonics, self.shake, self.phase = _vibration(s, seed, number)
        self.balanced = self.shake.copy()
        self.state = np.zeros(STATE)
        self.run, self._raw = function_of(KERNEL, imu_samples), np.zeros((0, RAW))
        self.next, self.told = 0, 0
        self.late = s.hidden_delay_s + (s.delay_s if s.delay_s > self.period else 0.0)

    def advance(self, step: int, raw: Array) -> None:
        """Take the raw rows (m * substeps, RAW) of the m periods that begin with number ``step``.

        Handed the same array every time, it is looked at once.
        """
        if self._drawn(len(raw)) or raw is not self._raw:
            self._raw, self._samples = raw, self._bound(raw)
        if self.unbalanced:
            self._shake_at(step * self.period)
        before = self.next
        self.next = self._samples(step * self.substeps, self.used - len(raw), before)
        if self.faults and self.next > before:
            t = self.instants[before : self.next]
            for part, columns in (("gyro", slice(1, 4)), ("acc", slice(4, 7))):
                faults = [f for f in self.faults if f.part == part]
                last = self.out[before - 1, columns] if before else np.zeros(3)
                self.out[before : self.next, columns] = damaged(
                    faults, t, self.out[before : self.next, columns], last, self.seed
                )

    def _shake_at(self, t: float) -> None:
        """Shake at ``t`` s, in place, as rotors do that are out of balance then."""
        self.shake[:] = self.balanced
        for fault in self.unbalanced:
            if fault.holds(t):
                self.shake[:, fault.instance] *= fault.factor

    def arrived(self, now: float) -> Array:
        """Rows (k, 8) that arrived since it was last asked: t_sample, dt, gyro, acc.

        The unit triggers the loop, so a publication within one period is not late; a hidden delay is.
        """
        begin, end, limit = self.told, self.told, now - self.late + 1e-6 * self.h
        while end < self.next and self.times[end] <= limit:
            end += 1
        self.told = end
        if end - begin == 1 and self.kept[begin]:
            row = np.empty((1, 8))
            row[0, 0] = self.times[begin] + self.settings.hidden_delay_s
            row[0, 1:] = self.out[begin, :7]
            return row
        rows = slice(begin, end)
        keep = self.kept[rows]
        t = self.instants[rows][keep] + self.settings.hidden_delay_s
        return np.column_stack([t, self.out[rows][keep, :7]])

    def stream(self) -> ImuStream:
        """All samples that arrived, as a log holds them."""
        s, keep = self.settings, self.kept & (np.arange(len(self.kept)) < self.next)
        t, out = self.instants[keep], self.out[keep]
        told = t + s.hidden_delay_s
        row = np.clip(np.ceil(t / self.period - 1e-6).astype(int) - 1, 0, len(self.bias) - 1)
        return ImuStream(
            instance=self.number,
            sampling=s.sampling,
            rate_hz=s.rate_hz,
            lowpass_hz=(s.gyro.lowpass_hz, s.acc.lowpass_hz),
            t=told + s.delay_s,
            t_sample=told,
            dt=out[:, 0].copy(),
            gyro=out[:, 1:4].copy(),
            acc=out[:, 4:7].copy(),
            temperature=s.temperature_c + warming(s, t),
            clipped=out[:, 7:9].astype(np.int64),
            gyro_bias=self.bias[row, :3],
            acc_bias=self.bias[row, 3:],
        )

    def _bound(self, raw: Array) -> Callable[[int, int, int], int]:
        """The loop over these raw rows: of the first row's number, the noise's row, the next sample."""
        errors = (self.bias, self.substeps, self.matrices, self.numbers, self.harmonics, self.shake, self.phase)
        return bound(self.run, ..., self.h, raw, self.block, ..., *errors, self.state, self.instants, ..., self.out)

    def _drawn(self, rows: int) -> bool:
        """Use the next rows of standard normal noise, in any portions. Whether the block is a new one."""
        empty = self.used + rows > len(self.block)
        if empty:
            fresh = self.noise.standard_normal((max(BLOCK * self.substeps, rows), 6))
            self.block, self.used = np.concatenate([self.block[self.used :], fresh]), 0
        self.used += rows
        return empty


def warming(s: ImuSettings, t: Array) -> Array:
    """How much warmer than at the start (n,) [K] the unit is at times ``t`` (n,) s."""
    return s.warming_k * -np.expm1(-t / s.warming_s)


def _biases(s: ImuSettings, seed: int, number: int, periods: int, period: float) -> Array:
    """True bias (periods, 6) of gyro [rad/s] and accelerometer [m/s^2] in each period of the loop."""
    start, walk = generator(seed, "imu", number, "bias"), generator(seed, "imu", number, "walk")
    first = start.standard_normal(6)
    steps = walk.standard_normal((periods, 6)) * math.sqrt(period)
    steps[0] = 0.0
    warm = warming(s, np.arange(periods, dtype=np.float64) * period)[:, None]
    walked = np.cumsum(steps, axis=0)
    gyro = np.radians(
        np.array(s.gyro.bias_dps)
        + s.gyro.bias_spread_dps * first[:3]
        + s.gyro.walk_dps_rts * walked[:, :3]
        + warm * np.array(s.gyro.drift_dps_per_k)
    )
    acc = (
        np.array(s.acc.bias_m_s2)
        + s.acc.bias_spread_m_s2 * first[3:]
        + s.acc.walk_m_s2_rts * walked[:, 3:]
        + warm * np.array(s.acc.drift_m_s2_per_k)
    )
    return np.ascontiguousarray(np.hstack([gyro, acc]))


def _matrix(s: ImuSettings, misalign_deg: tuple[float, float, float], scale_pct: tuple[float, float, float]) -> Array:
    """What the unit tells (3, 3) of a vector in body axes: mounting, misalignment, scale."""
    mount = rotation.to_matrix(rotation.from_euler(*np.radians(s.rotation_deg)))
    small = rotation.to_matrix(rotation.from_rotvec(np.radians(misalign_deg)))
    matrix: Array = np.diag(1.0 + np.array(scale_pct) / 100.0) @ small.T @ mount.T
    return matrix


def _vibration(s: ImuSettings, seed: int, number: int) -> tuple[Array, Array, Array]:
    """Harmonics (H,), amplitudes and phases (H, 4, 6) of gyro and accelerometer: a direction per rotor and harmonic."""
    random = generator(seed, "imu", number, "vibration")
    count = len(s.vibration.harmonics)
    direction = random.standard_normal((count, 4, 2, 3))
    direction /= np.linalg.norm(direction, axis=-1, keepdims=True)
    size = np.stack([np.radians(s.vibration.gyro_dps), np.array(s.vibration.acc_m_s2, float)], axis=1).reshape(
        count, 1, 2, 1
    )
    phase = random.uniform(0.0, 2 * np.pi, (count, 4, 6))
    shake = np.ascontiguousarray((direction * size).reshape(count, 4, 6))
    return np.array(s.vibration.harmonics, float), shake, phase


def low_pass(cutoff_hz: float, rate_hz: float) -> tuple[float, float, float, float, float]:
    """b0, b1, b2, a1, a2 of the low-pass ahead of the sampling; without one, or above half of the rate, what passes."""
    inside = 0.0 < cutoff_hz < 0.5 * rate_hz
    f = biquad.lowpass(cutoff_hz, rate_hz) if inside else biquad.PASSES
    return f.b0, f.b1, f.b2, f.a1, f.a2
