"""When a sensor measures: a raster with jitter, from which samples are lost."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from attlog.simulate.sensors.settings import Span

Array = NDArray[np.float64]


def instants(rate_hz: float, seconds: float, jitter_s: float, random: np.random.Generator, phase: float = 1.0) -> Array:
    """Times of measurement (n,) s, ascending, up to ``seconds``; the first is ``phase`` of a period after 0.

    Jitter is normal about the raster, kept within 0.45 of a period so that samples stay in order.
    """
    nominal: Array = (np.arange(int(seconds * rate_hz + 1.0), dtype=np.float64) + phase) / rate_hz
    nominal = nominal[nominal <= seconds + 1e-9]
    moved = jitter_s * random.standard_normal(len(nominal))
    jittered = nominal + np.clip(moved, -0.45 / rate_hz, 0.45 / rate_hz)
    return jittered[(jittered > 0) & (jittered <= seconds + 1e-9)]


def kept(t: Array, loss_pct: float, gaps: tuple[Span, ...], random: np.random.Generator) -> NDArray[np.bool_]:
    """Which of the samples at ``t`` (n,) s arrive: the others are lost at random or fall into a gap (from, to)."""
    arrives = random.random(len(t)) >= loss_pct / 100.0
    for begin, end in gaps:
        arrives &= (t < begin) | (t >= end)
    return arrives
