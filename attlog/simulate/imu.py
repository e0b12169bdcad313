"""An inertial unit: errors drawn from the seed, raw samples and their reduction in one compiled loop.

At the raw rate (loop rate x substeps) the body's rate and specific force are moved to the unit's place, shaken, rotated
and scaled, biased, made noisy, clipped and rounded to counts, then low-passed. At each sampling instant the loop writes
the low-pass (instant) or the mean since the last instant (interval): for the gyro the rotation vector over the
interval, composed to second order with the term of a linearly changing rate (Bortz 1971), divided by its length.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray

from attlog.core import jit, rotation, signal
from attlog.core.jit import F1, F2, F3, Out1, Out2
from attlog.simulate.environment import generator
from attlog.simulate.flight import ImuStream
from attlog.simulate.scenario import Scenario
from attlog.simulate.sensor_settings import ImuSettings
from attlog.simulate.sensors import arriving_samples, damage, kept_samples, sampling_instants

# Columns of a raw row: w (3), w_dot (3), specific force at the centre of gravity (3), rotor speeds (4), rotor angles
# (4).
RAW_COLUMNS = 17
# Columns of a sample: dt, gyro (3), acc (3), clipped raw samples of gyro and accelerometer.
SAMPLE_COLUMNS = 9
# y (6) 0, filter memories (6 x 2) 6, angle (3) 18, velocity (3) 21, last instant 24, clipped (2) 25, primed 27, true
# rate and force of the raw row before 28, y of the raw row before 34.
IMU_STATE_SIZE = 50


@jit.loop("the simulated inertial unit")
def imu_samples(
    first: int,
    h: float,
    raw: F2,
    noise: F2,
    used: int,
    bias: F2,
    substeps: int,
    matrices: F3,
    numbers: F1,
    harmonics: F1,
    shake: F3,
    phase: F3,
    state: Out1,
    instants: F1,
    k: int,
    out: Out2,
) -> int:
    """Run through the raw rows from number ``first`` on, fill ``out`` from row ``k`` on, return the next row's number.

    Row ``first`` ends at ``(first + 1) h``. ``noise`` (n, 6): standard normal, row ``used`` for the first. ``bias``
    (periods, 6): a row for every ``substeps`` raw rows of the flight. ``numbers``: lever arm (3), limits (2), steps
    (2), noise (2), low-pass on (2) and coefficients (2 x 5), interval (1 or 0), hover speed.
    """
    mean = numbers[21] > 0.5
    for j in range(len(raw)):
        x0, x1, x2 = raw[j, 0], raw[j, 1], raw[j, 2]
        a0, a1, a2 = raw[j, 3], raw[j, 4], raw[j, 5]
        r0, r1, r2 = numbers[0], numbers[1], numbers[2]
        d = x0 * r0 + x1 * r1 + x2 * r2
        s2 = x0 * x0 + x1 * x1 + x2 * x2
        f0 = raw[j, 6] + a1 * r2 - a2 * r1 + x0 * d - r0 * s2
        f1 = raw[j, 7] + a2 * r0 - a0 * r2 + x1 * d - r1 * s2
        f2 = raw[j, 8] + a0 * r1 - a1 * r0 + x2 * d - r2 * s2
        for n in range(len(harmonics)):
            for r in range(4):
                size = raw[j, 9 + r] / numbers[22]
                size *= size
                if size > 1e-6:
                    angle = harmonics[n] * raw[j, 13 + r]
                    x0 += size * shake[n, r, 0] * math.sin(angle + phase[n, r, 0])
                    x1 += size * shake[n, r, 1] * math.sin(angle + phase[n, r, 1])
                    x2 += size * shake[n, r, 2] * math.sin(angle + phase[n, r, 2])
                    f0 += size * shake[n, r, 3] * math.sin(angle + phase[n, r, 3])
                    f1 += size * shake[n, r, 4] * math.sin(angle + phase[n, r, 4])
                    f2 += size * shake[n, r, 5] * math.sin(angle + phase[n, r, 5])
        b = (first + j) // substeps
        fresh = state[27] < 0.5
        state[27] = 1.0
        if mean:
            # What a converter that integrates sees: the mean over the raw step, for the rate its rotation vector.
            t0, t1, t2, t3, t4, t5 = x0, x1, x2, f0, f1, f2
            if not fresh:
                p0, p1, p2 = state[28], state[29], state[30]
                c = h / 12.0
                x0 = 0.5 * (p0 + t0) + c * (p1 * t2 - p2 * t1)
                x1 = 0.5 * (p1 + t1) + c * (p2 * t0 - p0 * t2)
                x2 = 0.5 * (p2 + t2) + c * (p0 * t1 - p1 * t0)
                f0, f1, f2 = 0.5 * (state[31] + t3), 0.5 * (state[32] + t4), 0.5 * (state[33] + t5)
            state[28], state[29], state[30], state[31], state[32], state[33] = t0, t1, t2, t3, t4, t5
        for i in range(6):
            state[34 + i] = state[i]
        for i in range(6):
            g = 0 if i < 3 else 1
            c = i - 3 * g
            if g == 0:
                y = matrices[0, c, 0] * x0 + matrices[0, c, 1] * x1 + matrices[0, c, 2] * x2
            else:
                y = matrices[1, c, 0] * f0 + matrices[1, c, 1] * f1 + matrices[1, c, 2] * f2
            y += bias[b, i] + numbers[7 + g] * noise[used + j, i]
            limit = numbers[3 + g]
            if abs(y) >= limit:
                y = limit if y > 0 else -limit
                state[25 + g] += 1.0
            if numbers[5 + g] > 0:
                y = numbers[5 + g] * math.floor(y / numbers[5 + g] + 0.5)
            if numbers[9 + g] > 0.5:
                q = 11 + 5 * g
                if fresh:
                    # Begin as if the first value had always been there.
                    state[6 + 2 * i] = y * (1.0 - numbers[q])
                    state[7 + 2 * i] = y * (numbers[q + 2] - numbers[q + 4])
                filtered = numbers[q] * y + state[6 + 2 * i]
                state[6 + 2 * i] = numbers[q + 1] * y - numbers[q + 3] * filtered + state[7 + 2 * i]
                state[7 + 2 * i] = numbers[q + 2] * y - numbers[q + 4] * filtered
                y = filtered
            state[i] = y
        if fresh:
            for i in range(6):
                state[34 + i] = state[i]
        begin = (first + j) * h
        done = 0.0
        while k < len(instants) and instants[k] <= begin + h * 1.000001:
            u = (instants[k] - begin) / h
            if u > 1.0:
                u = 1.0
            if mean:
                _integrate(state, (u - done) * h)
                dt = instants[k] - state[24]
                for i in range(6):
                    out[k, 1 + i] = state[18 + i] / dt
                    state[18 + i] = 0.0
            else:
                dt = instants[k] - state[24]
                for i in range(6):
                    out[k, 1 + i] = state[34 + i] + u * (state[i] - state[34 + i])
            out[k, 0] = dt
            out[k, 7] = state[25]
            out[k, 8] = state[26]
            state[25] = 0.0
            state[26] = 0.0
            state[24] = instants[k]
            done = u
            k += 1
        if mean and done < 1.0:
            _integrate(state, (1.0 - done) * h)
    return k


def _integrate(state: Any, seconds: float) -> None:
    """Add ``seconds`` of the present values: the turn to second order, the velocity as a sum."""
    d0, d1, d2 = state[0] * seconds, state[1] * seconds, state[2] * seconds
    a0, a1, a2 = state[18], state[19], state[20]
    state[18] = a0 + d0 + 0.5 * (a1 * d2 - a2 * d1)
    state[19] = a1 + d1 + 0.5 * (a2 * d0 - a0 * d2)
    state[20] = a2 + d2 + 0.5 * (a0 * d1 - a1 * d0)
    for i in range(3):
        state[21 + i] += seconds * state[3 + i]


Array = NDArray[np.float64]
G = 9.80665
# Periods of the loop whose noise is drawn at once.
BLOCK_ROWS = 512


class ImuSensor:
    """Instance ``number`` of a scenario's inertial units; ``advance`` takes the raw rows in order."""

    def __init__(self, scenario: Scenario, number: int, seed: int, gravity: float) -> None:
        self.settings: ImuSettings = scenario.sensors.imu[number]
        self.number, self.seed, s = number, seed, self.settings
        self.substeps = scenario.loop.substeps
        self.period = 1.0 / scenario.loop.rate_hz
        self.h = self.period / self.substeps
        raw_hz = 1.0 / self.h
        timing = generator(seed, "imu", number, "timing")
        self.instants = sampling_instants(s.rate_hz, scenario.seconds, s.jitter_s, timing)
        self.times: list[float] = self.instants.tolist()
        self.kept = kept_samples(self.instants, s.loss_pct, s.gaps, generator(seed, "imu", number, "loss"))
        self.faults = [f for f in scenario.fault if f.part in ("gyro", "acc") and f.instance == number]
        self.kept &= ~arriving_samples(self.faults, self.instants)
        self.unbalanced = [f for f in scenario.fault if f.part == "rotor" and f.kind == "unbalanced"]
        self.out = np.zeros((len(self.instants), SAMPLE_COLUMNS))
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
        self.state = np.zeros(IMU_STATE_SIZE)
        self._raw = np.zeros((0, RAW_COLUMNS))
        self.next, self.delivered = 0, 0
        self.late = s.hidden_delay_s + (s.delay_s if s.delay_s > self.period else 0.0)

    def advance(self, step: int, raw: Array) -> None:
        """Take the raw rows (m * substeps, RAW_COLUMNS) of the m periods from number ``step`` on.

        The same array each time is bound once.
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
                self.out[before : self.next, columns] = damage(
                    faults, t, self.out[before : self.next, columns], last, self.seed
                )

    def _shake_at(self, t: float) -> None:
        """Set the shake of unbalanced rotors at ``t`` s."""
        self.shake[:] = self.balanced
        for fault in self.unbalanced:
            if fault.holds(t):
                self.shake[:, fault.instance] *= fault.factor

    def arrived(self, now: float) -> Array:
        """Return rows (k, 8) since the last call: t_sample, dt, gyro, acc.

        The unit triggers the loop, so a publication within one period is not late; a hidden delay is.
        """
        begin, end, limit = self.delivered, self.delivered, now - self.late + 1e-6 * self.h
        while end < self.next and self.times[end] <= limit:
            end += 1
        self.delivered = end
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
        """Return all samples that arrived, as a log holds them."""
        s, keep = self.settings, self.kept & (np.arange(len(self.kept)) < self.next)
        t, out = self.instants[keep], self.out[keep]
        reported = t + s.hidden_delay_s
        row = np.clip(np.ceil(t / self.period - 1e-6).astype(int) - 1, 0, len(self.bias) - 1)
        return ImuStream(
            instance=self.number,
            sampling=s.sampling,
            rate_hz=s.rate_hz,
            lowpass_hz=(s.gyro.lowpass_hz, s.acc.lowpass_hz),
            t=reported + s.delay_s,
            t_sample=reported,
            dt=out[:, 0].copy(),
            gyro=out[:, 1:4].copy(),
            acc=out[:, 4:7].copy(),
            temperature=s.temperature_c + warming(s, t),
            clipped=out[:, 7:9].astype(np.int64),
            gyro_bias=self.bias[row, :3],
            acc_bias=self.bias[row, 3:],
        )

    def _bound(self, raw: Array) -> Callable[[int, int, int], int]:
        """Return the loop over these raw rows: of the first row's number, the noise's row, the next sample."""
        errors = (self.bias, self.substeps, self.matrices, self.numbers, self.harmonics, self.shake, self.phase)
        return imu_samples.bound(..., self.h, raw, self.block, ..., *errors, self.state, self.instants, ..., self.out)

    def _drawn(self, rows: int) -> bool:
        """Use the next rows of standard normal noise; return whether the block is new."""
        empty = self.used + rows > len(self.block)
        if empty:
            fresh = self.noise.standard_normal((max(BLOCK_ROWS * self.substeps, rows), 6))
            self.block, self.used = np.concatenate([self.block[self.used :], fresh]), 0
        self.used += rows
        return empty


def warming(s: ImuSettings, t: Array) -> Array:
    """Return the warming since the start (n,) [K] at times ``t`` (n,) s."""
    return s.warming_k * -np.expm1(-t / s.warming_s)


def _biases(s: ImuSettings, seed: int, number: int, periods: int, period: float) -> Array:
    """Return the true bias (periods, 6) of gyro [rad/s] and accelerometer [m/s^2] by period of the loop."""
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
    """Return mounting, misalignment and scale as one matrix (3, 3) of body vectors."""
    mount = rotation.to_matrix(rotation.from_euler(*np.radians(s.rotation_deg)))
    small = rotation.to_matrix(rotation.from_rotvec(np.radians(misalign_deg)))
    matrix: Array = np.diag(1.0 + np.array(scale_pct) / 100.0) @ small.T @ mount.T
    return matrix


def _vibration(s: ImuSettings, seed: int, number: int) -> tuple[Array, Array, Array]:
    """Return harmonics (H,), amplitudes and phases (H, 4, 6) of gyro and accelerometer, with random directions."""
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
    """Return b0, b1, b2, a1, a2 of the low-pass before sampling; above half of the rate it passes everything."""
    inside = 0.0 < cutoff_hz < 0.5 * rate_hz
    f = signal.lowpass(cutoff_hz, rate_hz) if inside else signal.PASS_THROUGH
    return f.b0, f.b1, f.b2, f.a1, f.a2
