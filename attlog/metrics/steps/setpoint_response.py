"""How does the attitude answer its set-point? A causal impulse response by regularised least squares.

Changes of the attitude are a sum of earlier changes of the set-point,

    dy(t) = sum_k h_k dx(t - k dt) + noise,    0 <= k dt <= 1 s,

so that trim, wind and slow drift do not enter. The response is expected to be smooth and to die
out: among those that explain the data the one with the smallest ``h' P^-1 h`` is taken, with
``P_ij = c min(d_i, d_j)``, d falling by e every 0.25 s (the tuned/correlated kernel of
Chen2012). Nothing before the set-point can be found, because there is no such lag.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view
from numpy.typing import NDArray

Array = NDArray[np.float64]
SetpointSegment = tuple[Array, Array, Array]
"""Times (n,) evenly spaced, set-point (n, 2) and attitude (n, 2) in deg: roll and pitch."""

MEMORY_S = 1.0
DECAY_S = 0.25
"""The response is expected to fall by e in this time."""
SHARP_S = 0.05
"""A response as short as this is still likely: the scale of the prior."""
BLOCK_S = 1.0
MOVING_DEG = 1.0
"""Seconds in which the set-point varies less, with the second before, show nothing of the response."""
BAND = 0.05
LEVEL_S = 0.8
"""The step response is divided by its mean from here to its end."""


@dataclass(slots=True)
class NormalEquations:
    """Normal equations of k blocks of one second: ``xx`` (k, m, m), ``xy`` (k, m), ``yy`` and ``count`` (k,).

    ``axis`` (k,) is 0 for roll, 1 for pitch; ``step`` the spacing of the m lags in s.
    """

    xx: Array
    xy: Array
    yy: Array
    count: Array
    axis: NDArray[np.int64]
    step: float

    def only(self, which: NDArray[np.bool_]) -> NormalEquations:
        """A choice (k,) of the blocks."""
        return NormalEquations(
            self.xx[which], self.xy[which], self.yy[which], self.count[which], self.axis[which], self.step
        )


def blocks_of(segments: list[SetpointSegment]) -> NormalEquations | None:
    """The blocks of both axes in which the set-point moved; None without any. All segments have one spacing."""
    if not segments:
        return None
    step = float(segments[0][0][1] - segments[0][0][0])
    lags, size = round(MEMORY_S / step) + 1, max(round(BLOCK_S / step), 1)
    found: list[tuple[Array, Array, float, float, int]] = []
    for t, wanted, flown in segments:
        for axis in (0, 1):
            x, y = wanted[:, axis], flown[:, axis]
            begins = np.arange(lags, len(t) - size, size)
            if len(begins) == 0:
                continue
            moving = np.std(sliding_window_view(x, lags + size)[begins - lags], axis=1) > MOVING_DEG
            for begin in begins[moving].tolist():
                found.append((*_normal(x, y, begin, size, lags), axis))
    if not found:
        return None
    xx, xy, yy, count, axes = (np.array(v) for v in zip(*found, strict=True))
    return NormalEquations(xx, xy, yy, count, axes.astype(np.int64), step)


def _normal(x: Array, y: Array, begin: int, size: int, lags: int) -> tuple[Array, Array, float, float]:
    dx = np.diff(x[begin - lags : begin + size])
    columns = sliding_window_view(dx, lags)[:, ::-1]
    dy = np.diff(y[begin - 1 : begin + size])[-len(columns) :]
    return columns.T @ columns, columns.T @ dy, float(dy @ dy), float(len(dy))


def response(blocks: NormalEquations) -> tuple[Array, Array]:
    """Times (m,) s from 0 on and the response to a unit step at 0, scaled to 1 at its end; NaN without a level."""
    xx, xy, yy = blocks.xx.sum(axis=0), blocks.xy.sum(axis=0), float(blocks.yy.sum())
    prior = np.linalg.inv(_prior(len(xy), blocks.step))
    noise, h = yy / max(float(blocks.count.sum()), 1.0), np.zeros(len(xy))
    for _ in range(ROUNDS):
        h = np.linalg.solve(xx + noise * prior, xy)
        left = max(yy - 2.0 * float(h @ xy) + float(h @ xx @ h), 1e-9 * yy)
        noise = left / max(float(blocks.count.sum()), 1.0)
    t = np.asarray(blocks.step * np.arange(len(h)), np.float64)
    step = np.cumsum(h) - 0.5 * h  # a sample's impulse is centred on its time
    level = float(np.mean(step[t >= LEVEL_S]))
    return t, np.asarray(step / (level if level > LEAST_LEVEL else np.nan), np.float64)


ROUNDS = 3
"""The noise that weighs the prior is that of the fit before."""
LEAST_LEVEL = 0.2


def _prior(count: int, step: float) -> Array:
    """Covariance (m, m) of the impulse response's samples before any data."""
    decay = np.exp(-step * np.arange(count) / DECAY_S)
    return np.asarray((step / SHARP_S) ** 2 * np.minimum(decay[:, None], decay[None, :]), np.float64)


def features(t: Array, step: Array) -> Array:
    """Delay to 50 % (s), rise from 10 to 90 % (s), peak, settling time (s) of a step response that ends at 1.

    ``t`` (m,) s, ``step`` (m,); NaN where it never gets there.
    """

    def reached(level: float) -> float:
        above = np.flatnonzero(step >= level)
        if len(above) == 0:
            return math.nan
        i = int(above[0])
        if i == 0:
            return float(t[0])
        return float(t[i - 1] + (t[i] - t[i - 1]) * (level - step[i - 1]) / (step[i] - step[i - 1]))

    if not np.isfinite(step).all():
        return np.full(4, math.nan)
    return np.array([reached(0.5), reached(0.9) - reached(0.1), float(np.max(step)), _settled(t, step)])


def _settled(t: Array, step: Array) -> float:
    """The time (s) from which the response stays within 5 % of 1, between samples by a straight line."""
    outside = np.flatnonzero(np.abs(step - 1.0) > BAND)
    if len(outside) == 0:
        return 0.0
    i = int(outside[-1])
    if i == len(t) - 1:
        return float(t[-1])
    edge = 1.0 + math.copysign(BAND, step[i] - 1.0)
    return float(t[i] + (t[i + 1] - t[i]) * (edge - step[i]) / (step[i + 1] - step[i]))
