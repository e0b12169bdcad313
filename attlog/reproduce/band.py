"""How much a signal moves within a band of frequencies, at which frequency most, and at which in the mean.

Power by Welch's method (1967): windows of 10 s that overlap by half, each without its straight line, tapered by
Hann's window. The band's RMS is the root of the power between its ends.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
WINDOW_S = 10.0
LEAST = 8
"""Samples that a window must have."""


@dataclass(frozen=True, slots=True)
class Spectrum:
    """Power ``density`` (m,) in unit^2/Hz at frequencies ``f`` (m,) Hz."""

    f: Array
    density: Array

    def rms(self, band: tuple[float, float]) -> float:
        """The RMS between two frequencies (Hz, the first included) in the unit of the signal."""
        return math.sqrt(float(np.sum(self.density[self._inside(band)])) * float(self.f[1]))

    def dominant_hz(self, band: tuple[float, float]) -> float:
        """The frequency of the band with most power per octave (f times density)."""
        inside = np.flatnonzero(self._inside(band))
        return float(self.f[inside[np.argmax(self.f[inside] * self.density[inside])]])

    def crossing_hz(self, band: tuple[float, float]) -> float:
        """How often the part of the signal within the band crosses zero upwards, 1/s: the root of the mean of f^2,
        weighted by power (Rice 1944)."""
        inside = self._inside(band)
        power = self.density[inside]
        return math.sqrt(float(np.sum(self.f[inside] ** 2 * power)) / float(np.sum(power)))

    def _inside(self, band: tuple[float, float]) -> NDArray[np.bool_]:
        return (self.f >= band[0]) & (self.f < band[1])


def spectrum(t: Array, y: Array, window_s: float = WINDOW_S) -> Spectrum:
    """The spectrum of ``y`` (n,) at even times ``t`` (n,) s; a signal shorter than the window is one window.

    ValueError for less than 8 samples.
    """
    if len(t) < LEAST:
        raise ValueError(f"{len(t)} samples are too few for a spectrum")
    dt = float(t[-1] - t[0]) / (len(t) - 1)
    size = min(len(t), max(LEAST, round(window_s / dt)))
    return of_windows(dt, [y[k : k + size] for k in range(0, len(t) - size + 1, max(1, size // 2))])


def of_windows(dt: float, windows: Sequence[Array]) -> Spectrum:
    """The mean spectrum of windows (n,) of one length, samples ``dt`` s apart."""
    size = len(windows[0])
    taper = np.hanning(size + 1)[:-1]
    line = np.vander(np.arange(size) - 0.5 * (size - 1), 2)
    power = []
    for part in windows:
        flat = part - line @ np.linalg.lstsq(line, part, rcond=None)[0]
        power.append(np.abs(np.fft.rfft(flat * taper)) ** 2)
    density = np.mean(power, axis=0) * 2.0 * dt / float(taper @ taper)
    density[0] *= 0.5
    if size % 2 == 0:
        density[-1] *= 0.5
    return Spectrum(np.asarray(np.fft.rfftfreq(size, dt), np.float64), np.asarray(density, np.float64))
