"""The second-order filters of both firmwares: Butterworth low-pass and notch, run causally as in flight.

The low-pass is the bilinear transform of the Butterworth filter with its cut-off kept (LowPassFilter2p of both
firmwares). The notch is the bilinear transform of the second-order notch; its width lies between the half-power
frequencies. Derivations: Oppenheim & Schafer, Discrete-Time Signal Processing, section 7.1.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from attlog.core.errors import UsageError

Array = NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class Biquad:
    """H(z) = (b0 + b1/z + b2/z^2) / (1 + a1/z + a2/z^2)."""

    b0: float
    b1: float
    b2: float
    a1: float
    a2: float


# Replaces a notch while it is switched off.
PASS_THROUGH = Biquad(1.0, 0.0, 0.0, 0.0, 0.0)


def lowpass(cutoff_hz: float, rate_hz: float) -> Biquad:
    """Return the Butterworth low-pass. UsageError from half the rate on."""
    _require_below_nyquist(cutoff_hz, rate_hz, "a low-pass at")
    w = math.tan(math.pi * cutoff_hz / rate_hz)
    norm = 1.0 + math.sqrt(2.0) * w + w * w
    b = w * w / norm
    return Biquad(b, 2.0 * b, b, 2.0 * (w * w - 1.0) / norm, (1.0 - math.sqrt(2.0) * w + w * w) / norm)


def notch(centre_hz: float, width_hz: float, rate_hz: float) -> Biquad:
    """Return the notch. UsageError from half the rate on."""
    _require_below_nyquist(centre_hz, rate_hz, "a notch at")
    _require_below_nyquist(width_hz, rate_hz, "a notch with a width of")
    alpha, middle = math.tan(math.pi * width_hz / rate_hz), math.cos(2.0 * math.pi * centre_hz / rate_hz)
    gain = 1.0 / (1.0 + alpha)
    return Biquad(gain, -2.0 * middle * gain, gain, -2.0 * middle * gain, (1.0 - alpha) * gain)


def run_biquads(filters: list[tuple[int, Biquad]], x: Array) -> Array:
    """Filter samples (n, k) with a filter that changes.

    ``filters``: pairs of the first sample and the filter from there on. The first sample counts as steady state before
    it, as in the firmwares. The state stays when the filter changes and starts anew after PASS_THROUGH. Samples that
    are not finite are skipped.
    """
    out = np.array(x, np.float64)
    for column in range(out.shape[1]):
        good = np.flatnonzero(np.isfinite(out[:, column]))
        if len(good):
            starts = np.searchsorted(good, [begin for begin, _ in filters]).tolist()
            out[good, column] = _run_column(starts, [f for _, f in filters], out[good, column].tolist())
    return out


def _run_column(starts: list[int], filters: list[Biquad], x: list[float]) -> list[float]:
    """Filter one column with plain numbers; the recursion leaves nothing to vectorise."""
    out: list[float] = []
    d1 = d2 = 0.0
    for k, f in enumerate(filters):
        end = starts[k + 1] if k + 1 < len(starts) else len(x)
        if f == PASS_THROUGH:
            out.extend(x[starts[k] : end])
            continue
        b0, b1, b2, a1, a2 = f.b0, f.b1, f.b2, f.a1, f.a2
        if (k == 0 or filters[k - 1] == PASS_THROUGH) and starts[k] < len(x):
            steady = x[starts[k]]  # all these filters have unit gain at zero frequency
            d1, d2 = steady * (1.0 - b0), steady * (b2 - a2)
        for value in x[starts[k] : end]:
            y = b0 * value + d1
            d1 = b1 * value - a1 * y + d2
            d2 = b2 * value - a2 * y
            out.append(y)
    return out


def _require_below_nyquist(frequency: float, rate: float, what: str) -> None:
    if not frequency < 0.5 * rate:
        raise UsageError(
            f"{what} {frequency:g} Hz needs samples above {2 * frequency:g} Hz; this log has them at {rate:.0f} Hz"
        )
