"""Which samples of a stream a figure keeps: before the first crash, few enough, gaps as gaps."""

from __future__ import annotations

import math

import numpy as np

from attlog.flight.model import Array, running
from attlog.health.sound import crashed
from attlog.segments.model import Segments
from attlog.segments.spans import Span

MOST = 1500
"""Samples of a line: a figure is at most as many pixels wide."""


def end_of(segments: Segments | None) -> float:
    """Where figures end, s: at the first crash, else never."""
    wrecks = [] if segments is None else crashed(segments)
    return wrecks[0][0] if wrecks else math.inf


def flown(segments: Segments | None) -> list[Span]:
    """Spans in the air before the first crash, s."""
    end = end_of(segments)
    spans = [] if segments is None else segments.spans("airborne")
    return [(a, min(b, end)) for a, b in spans if a < end]


def broken(t: Array, columns: Array) -> Array:
    """Columns (n,) or (n, k) with NaN at the first sample after a pause, so that no line crosses it."""
    out = np.array(columns, np.float64)
    if len(t) > 1:
        out[1:][~running(t)] = np.nan
    return out
