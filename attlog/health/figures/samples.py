"""Which samples of a stream a figure keeps: before the first crash, few enough, gaps as gaps."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from attlog.flight.model import Array, running
from attlog.health.sound import crashed
from attlog.segments.model import Segments
from attlog.segments.spans import Span, between

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


def chosen(t: Array, use: NDArray[np.bool_], most: int = MOST) -> NDArray[np.int64]:
    """Which of the samples ``use`` (n,) at ``t`` (n,) s to draw: at most ``most``, evenly chosen."""
    own = np.flatnonzero(use & np.isfinite(t))
    return own[:: -(-len(own) // most)] if len(own) > most else own


def broken(t: Array, columns: Array) -> Array:
    """Columns (n,) or (n, k) with NaN at the first sample after a pause, so that no line crosses it."""
    out = np.array(columns, np.float64)
    if len(t) > 1:
        out[1:][~running(t)] = np.nan
    return out


def highest(t: Array, x: Array, spans: list[Span], seconds: float) -> tuple[Array, Array]:
    """Middle (m,) and largest finite value (m,) of windows of ``seconds``, longer where more than MOST; (n,) each.

    Windows begin with each span; one without a finite value is left out.
    """
    length = max(seconds, sum(b - a for a, b in spans) / max(MOST - len(spans), 1))
    at, most = [], []
    for a, b in spans:
        own = between(t, a, b)
        here, y = t[own], np.where(np.isfinite(x[own]), x[own], -np.inf)
        if len(here) == 0:
            continue
        window = ((here - here[0]) // length).astype(np.int64)
        first = np.flatnonzero(np.diff(window, prepend=-1))
        top = np.maximum.reduceat(y, first)
        at.append((here[0] + (window[first] + 0.5) * length)[np.isfinite(top)])
        most.append(top[np.isfinite(top)])
    return (np.concatenate(at), np.concatenate(most)) if at else (np.zeros(0), np.zeros(0))
