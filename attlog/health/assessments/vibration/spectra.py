"""Power spectra of gyro and accelerometer in flight, window by window, from every source a log has."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from attlog.flight.model import FlightLog, Stream
from attlog.flight.vibration.model import Burst
from attlog.segments import gaps
from attlog.segments.spans import Span, inside

Array = NDArray[np.float64]

WINDOW_S, SEGMENTS = 2.0, 4
"""A window of a stream is cut into so many lengths of a segment, which overlap by half: 2 Hz at 2 s."""
BURST_SEGMENTS = 2
"""Of a burst, which is 0.5 s long: 4 Hz."""
MOST_WINDOWS, MOST_SAMPLES = 150, 200_000
"""Of a source, evenly spread over the flight: hours of it, or 8 kHz, cost no more than these."""
LEAST_RATE_HZ = 90.0
"""Rotors turn 30 to 250 times a second: a slower stream shows nothing of them but aliases of aliases."""
GAP, LOST = 5.0, 0.1
"""A window holds no interval longer than 5 usual ones, and lacks at most a tenth of its samples: loggers drop single
ones, which are interpolated."""


@dataclass(frozen=True, slots=True)
class Spectra:
    """Spectra of one sensor: ``density`` (w, k, 3) of windows with their middle at ``t`` (w,) s over ``frequency`` (k,)
    Hz, body axes, in (deg/s)^2/Hz or (m/s^2)^2/Hz. ``rate`` Hz is the source's, ``seconds`` one window's length;
    ``filtered``: behind low-pass and notches of the autopilot."""

    sensor: str
    unit: int
    source: str
    rate: float
    seconds: float
    filtered: bool
    t: Array
    frequency: Array
    density: Array

    @property
    def median(self) -> Array:
        """The usual window's density (k, 3)."""
        middle: Array = np.median(self.density, axis=0)
        return middle

    @property
    def total(self) -> Array:
        """Density (w, k) of all three axes."""
        whole: Array = self.density.sum(axis=2)
        return whole

    @property
    def step(self) -> float:
        """Distance in Hz of neighbouring frequencies."""
        return float(self.frequency[1])


def all_of(log: FlightLog, within: list[Span], sensor: str = "gyro") -> list[Spectra]:
    """Spectra of every unit's fastest source in the ``within`` spans, unfiltered and fast ones first."""
    found = []
    for unit in sorted({imu.index for imu in log.imus} | {b.unit for b in log.bursts}):
        raw = [b for b in log.bursts if (b.sensor, b.unit, b.filtered) == (sensor, unit, False)]
        one = of_bursts(raw, within) if raw else None
        found += [] if one is None else [one]
        for imu in (i for i in log.imus if i.index == unit):
            stream = imu.gyro if sensor == "gyro" else imu.acc
            behind = imu.filtered not in ("none", "driver")
            one = of_stream(stream, within, sensor, unit, behind)
            found += [] if one is None else [one]
    return sorted(found, key=lambda s: (-s.rate, s.unit))


def of_stream(stream: Stream, within: list[Span], sensor: str, unit: int, filtered: bool) -> Spectra | None:
    """Spectra of 2 s windows of a stream without gaps, None where it is too slow or no window is whole."""
    t = stream.t_best
    if len(t) < 8:
        return None
    number, dt = numbered(t)
    rate = 1.0 / dt if dt > 0 else 0.0
    if rate < LEAST_RATE_HZ:
        return None
    n = round(WINDOW_S * rate)
    starts = _whole(t, number, within, dt, n)
    if len(starts) == 0:
        return None
    most = max(1, min(MOST_WINDOWS, MOST_SAMPLES // n))
    starts = starts[np.unique(np.linspace(0, len(starts) - 1, most).round().astype(int))]
    grid = starts[:, None] + np.arange(n)
    x = np.stack([np.interp(grid, number, stream.x[:, k]) for k in range(3)], axis=-1)
    good = np.isfinite(x).all(axis=(1, 2))
    if not good.any():
        return None
    frequency, density = welch(x[good], rate, n // SEGMENTS, sensor)
    middle = np.interp(starts[good] + 0.5 * n, number, t)
    return Spectra(sensor, unit, stream.source, rate, n * dt, filtered, middle, frequency, density)


def numbered(t: Array) -> tuple[Array, float]:
    """The number (n,) of each sample at t (n,) s, one more for each that was lost between, and the seconds between
    two numbers. By numbers and not by times, because interpolation between samples would take high frequencies out."""
    steps = np.diff(t)
    usual = float(np.median(steps))
    if not usual > 0:
        return np.arange(len(t), dtype=np.float64), 0.0
    count = np.clip(np.round(steps / usual), 1.0, GAP)
    near = (steps > 0) & (steps < GAP * usual)
    dt = float(steps[near].sum() / count[near].sum()) if near.any() else usual
    return np.concatenate([[0.0], np.cumsum(count)]), dt


def _whole(t: Array, number: Array, within: list[Span], dt: float, n: int) -> Array:
    """First numbers (m,) of windows of ``n`` numbers that lie in the spans, have no gap and few lost samples."""
    found: list[Array] = []
    for part in gaps.slices(inside(t, within), gaps.number(t, GAP * dt)):
        first, last = number[part.start], number[part.stop - 1]
        found.append(first + n * np.arange(int((last - first + 1) // n)))
    starts = np.concatenate(found) if found else np.zeros(0)
    held = np.searchsorted(number, starts + n) - np.searchsorted(number, starts)
    return starts[held >= (1.0 - LOST) * n]


def of_bursts(bursts: list[Burst], within: list[Span]) -> Spectra | None:
    """Spectra of the bursts of one sensor that lie in the spans, those of the usual length and rate; None without."""
    t = np.array([b.t + 0.5 * len(b.x) / b.rate for b in bursts])
    mine = [(at, b) for at, b, good in zip(t, bursts, inside(t, within), strict=True) if good]
    if not mine:
        return None
    n = int(np.median([len(b.x) for _, b in mine]))
    rate = float(np.median([b.rate for _, b in mine]))
    mine = [(at, b) for at, b in mine if len(b.x) >= n and abs(b.rate / rate - 1.0) < 0.02]
    if not mine:
        return None
    x = np.stack([b.x[:n] for _, b in mine]).astype(np.float64)
    first = mine[0][1]
    frequency, density = welch(x, rate, n // BURST_SEGMENTS, first.sensor)
    at = np.array([a for a, _ in mine])
    return Spectra(first.sensor, first.unit, first.source, rate, n / rate, first.filtered, at, frequency, density)


def welch(x: NDArray[Any], rate: float, size: int, sensor: str = "") -> tuple[Array, Array]:
    """Frequencies (k,) Hz and one-sided densities (w, k, c) of windows x (w, n, c) by Welch's method: segments of
    ``size`` samples that overlap by half, each without its mean, Hann. A gyro's rad/s become deg/s."""
    taper = np.hanning(size + 1)[:-1][:, None]
    scale = 2.0 / (rate * float(np.sum(taper**2))) * (math.degrees(1.0) ** 2 if sensor == "gyro" else 1.0)
    frequency = np.asarray(np.fft.rfftfreq(size, 1.0 / rate), np.float64)
    density = np.zeros((len(x), len(frequency), x.shape[2]))
    begins = range(0, x.shape[1] - size + 1, max(size // 2, 1))
    for begin in begins:
        part = x[:, begin : begin + size]
        flat = (part - part.mean(axis=1, keepdims=True)) * taper
        density += np.abs(np.fft.rfft(flat, axis=1)) ** 2
    return frequency, density * (scale / len(begins))
