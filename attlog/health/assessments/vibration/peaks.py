"""Which peaks does a spectrum have, how large are they, and where is each from window to window?"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from attlog.health.assessments.vibration.spectra import Spectra

Array = NDArray[np.float64]
Follows = Literal["throttle", "rotors", "nothing", ""]
"""What a peak's frequency follows; empty where throttle hardly moved, so that nothing tells."""

LOWEST_HZ = 20.0
"""What is slower is the flight itself and its control."""
PROMINENT_DB = 10.0
"""Above the floor: 6 dB passes a peak on every log tried."""
FLOOR_HZ = 40.0
"""The floor is the median on both sides within this."""
NEAR_HZ = 12.0
"""Of peaks closer than this the higher one is told."""
MOST = 4
TOLERANCE = 0.04
"""Of the frequency, or 1.5 lines: so near is where it was foretold."""
PRESENT_DB = 6.0
"""In a single window a peak is there where it stands so far above the floor."""
MEDIAN_SD = 1.25
"""Standard error of a median over that of a mean, for a normal distribution."""
TRACKED = (0.72, 1.4)
"""A peak is looked for within these parts of its usual frequency: half to twice the usual thrust."""


@dataclass(slots=True)
class Peak:
    """A peak at ``frequency`` Hz as the source shows it, ``height`` dB above the floor, ``rms`` in the sensor's unit
    (deg/s or m/s^2) along its strongest ``axis`` (0 to 2), ``density`` that of all axes at its line.

    ``share`` of the windows show it; it ``follows`` throttle, rotors or nothing in ``windows`` that could tell.
    ``possible``: the frequencies in Hz that a source of this rate shows here; ``true``: the one that it is, None
    where that is not known; ``why``: what tells. ``harmonic`` of the rotors' speed, 0 for none.
    """

    frequency: float
    height: float
    rms: float
    axis: int
    density: float
    share: float = 0.0
    follows: Follows = ""
    windows: int = 0
    possible: list[float] = field(default_factory=list)
    true: float | None = None
    why: str = ""
    harmonic: int = 0


def floor(density: Array, step: float) -> Array:
    """The local floor (k,) of a density (k,): its median within 40 Hz on both sides, lines ``step`` Hz apart."""
    half = max(3, round(FLOOR_HZ / step))
    padded = np.pad(density, half, mode="reflect") if len(density) > half else np.pad(density, half, mode="edge")
    level: Array = np.median(np.lib.stride_tricks.sliding_window_view(padded, 2 * half + 1), axis=1)
    return level


def peaks(spectra: Spectra) -> list[Peak]:
    """The prominent peaks of the flight's usual window, the strongest first, at most four."""
    f, usual = spectra.frequency, np.median(spectra.total, axis=0)
    low = floor(usual, spectra.step)
    with np.errstate(divide="ignore", invalid="ignore"):
        height = 10.0 * np.log10(usual / low)
    inner = np.zeros(len(f), bool)
    inner[1:-1] = (usual[1:-1] >= usual[:-2]) & (usual[1:-1] > usual[2:])
    inner &= (f >= LOWEST_HZ) & (f <= 0.48 * spectra.rate) & (height >= PROMINENT_DB)
    found: list[Peak] = []
    for k in sorted(np.flatnonzero(inner), key=lambda k: -usual[k]):
        if any(abs(f[k] - p.frequency) < NEAR_HZ for p in found) or len(found) == MOST:
            continue
        if any(_hidden(float(f[k] / p.frequency), float(usual[k]), p) for p in found):
            continue
        wide = slice(max(k - 3, 0), k + 4)
        axes = spectra.median[wide].sum(axis=0)
        power = max(float(axes.max()) - float(low[wide].sum()) * float(axes.max() / axes.sum()), 0.0)
        near = spectra.total[:, wide].sum(axis=1) > 10.0 ** (PRESENT_DB / 10.0) * float(low[wide].sum())
        at, axis = _between(usual, int(k), spectra.step), int(np.argmax(axes))
        rms = float(np.sqrt(power * spectra.step))
        found.append(Peak(at, float(height[k]), rms, axis, float(usual[k]), float(near.mean())))
    return found


def _hidden(ratio: float, density: float, peak: Peak) -> bool:
    """Whether a line lies where a much stronger peak goes, so that it would be taken for that one."""
    return TRACKED[0] <= ratio <= TRACKED[1] and density < peak.density * 10.0 ** (-PROMINENT_DB / 10.0)


def _between(density: Array, k: int, step: float) -> float:
    """A peak's frequency in Hz, between lines, by the parabola through three logarithms."""
    a, b, c = np.log(np.maximum(density[k - 1 : k + 2], 1e-300))
    bend = a - 2.0 * b + c
    return float((k + (0.5 * (a - c) / bend if bend < 0 else 0.0)) * step)


def track(spectra: Spectra, frequency: float) -> Array:
    """Where a peak is in every window (w,) in Hz, NaN where none stands above the floor."""
    band = (spectra.frequency >= TRACKED[0] * frequency) & (spectra.frequency <= TRACKED[1] * frequency)
    band &= (spectra.frequency >= 0.5 * LOWEST_HZ) & (spectra.frequency <= 0.48 * spectra.rate)
    if np.count_nonzero(band) < 3:
        return np.full(len(spectra.t), np.nan)
    part = spectra.total[:, band]
    k = np.argmax(part, axis=1)
    size = part[np.arange(len(k)), k]
    clear = size > 10.0 ** (PRESENT_DB / 10.0) * np.maximum(np.median(spectra.total, axis=1), 1e-300)
    return np.where(clear, spectra.frequency[band][k], np.nan)


def tolerance(spectra: Spectra, frequency: float) -> float:
    """How near in Hz a peak must be to where it was foretold."""
    return max(1.5 * spectra.step, TOLERANCE * frequency)


def interval(spectra: Spectra, peak: Peak) -> tuple[float, float] | None:
    """95 % interval in Hz of a peak's usual frequency by its windows, no narrower than half a line; None without."""
    places = track(spectra, peak.frequency)
    places = places[np.isfinite(places)]
    if len(places) < 2:
        return None
    half = max(1.96 * MEDIAN_SD * float(np.std(places)) / float(np.sqrt(len(places))), 0.5 * spectra.step)
    middle = peak.true if peak.true is not None else peak.frequency
    return round(middle - half, 1), round(middle + half, 1)
