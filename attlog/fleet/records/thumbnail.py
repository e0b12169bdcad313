"""A flight at a glance: its height over the log, or how far it leaned, with the serious events, in a few points."""

from __future__ import annotations

import itertools
import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from attlog.compare.gates.rows import BASELINES
from attlog.result import Result

Array = NDArray[np.float64]

POINTS = 48
"""Points of a thumbnail over the whole log."""
MOST_SPANS = 20
BRIDGED = 4
"""Points without a sample between two with one that are drawn straight, as in a short log with a slow barometer."""
FULL_DEG, LEAST_M = 90.0, 5.0
"""The full height of the picture: of tilt, on a square root's scale; of height at least."""
FULL_BYTE, NO_BYTE = 254, 255
MARKED = {"reset": "The attitude jumped", "impact": "Impact", "loss_of_control": "Loss of control"}
"""What a mark means that tells a kind instead of a sentence, as records of earlier versions have it."""


def thumbnail(result: Result) -> dict[str, Any] | None:
    """The largest height or tilt in each of POINTS equal parts of the log; None without traces of either.

    ``height`` (m) above the ground it stood on, of a log that never flew or tells no height the ``tilt`` (degrees) of
    the attitude that everything is compared with, of the one that flew, or of a filter; None where nothing is known.
    ``t0`` and ``t1``: the log's ends (s);
    ``air``: seconds in the air; ``marks``: [seconds, sentences] of serious events, those of one place together.
    """
    air = (result.log.get("timeline") or {}).get("airborne") or []
    found = (_height(result) if air else None) or _tilt(result)
    if found is None:
        return None
    name, t, y = found
    start = min(0.0, float(np.nanmin(t)))
    ends = [x for x in (float(np.nanmax(t)), result.log.get("duration_s")) if x is not None and math.isfinite(x)]
    edges = np.linspace(start, max(*ends, start + 1e-3), POINTS + 1)
    return {
        "t0": round(start, 2),
        "t1": round(float(edges[-1]), 2),
        name: [round(float(v), 1) if math.isfinite(v) else None for v in _bridged(_largest(t, y, edges))],
        "air": [[round(float(a), 1), round(float(b), 1)] for a, b in air[:MOST_SPANS]],
        "marks": _marks(result, edges),
    }


def encoded(seen: dict[str, Any] | None, out: bytearray) -> list[Any] | None:
    """What stands beside the curve of a thumbnail, with what it shows in words; the curve goes to ``out``, a byte for
    each point, from 0 at the foot of the picture to FULL_BYTE at its top."""
    if seen is None:
        return None
    at = len(out)
    curve = seen["height" if "height" in seen else "tilt"]
    held = [v for v in curve if v is not None]
    top = max(held, default=0.0)
    if "height" in seen:
        low = min(0.0, *held, 0.0)
        span = max(LEAST_M, top - low)
        shares = [None if v is None else (v - low) / span for v in curve]
        words = "Height over time"
    else:
        shares = [None if v is None else math.sqrt(min(v, FULL_DEG) / FULL_DEG) for v in curve]
        words = "Tilt over time"
    out += bytes(NO_BYTE if v is None else round(FULL_BYTE * v) for v in shares)
    return [at, seen["t0"], seen["t1"], words, seen["air"], [[t, MARKED.get(text, text)] for t, text in seen["marks"]]]


def _height(result: Result) -> tuple[str, Array, Array] | None:
    """The name of the curve, times (n,) s and heights (n,) m; None where no sensor tells them."""
    found = next((t for t in result.traces if t.figure == "height"), None)
    if found is None or not np.isfinite(found.columns["height"]).any():
        return None
    return "height", found.t, found.columns["height"]


def _tilt(result: Result) -> tuple[str, Array, Array] | None:
    """The name of the curve, times (n,) s and angles (n,) degrees; None without any attitude."""
    attitudes = {t.row: t for t in result.traces if t.figure == "attitude" and np.isfinite(t.t).any()}
    if not attitudes:
        return None
    choice = result.reference.choice if result.reference else ""
    filters = [r.name for r in result.estimators if r.kind == "replay" and r.estimator not in BASELINES]
    shown = next(attitudes[k] for k in (choice, "onboard", *filters, *attitudes) if k in attitudes)
    roll, pitch = (np.radians(shown.columns[c]) for c in ("roll", "pitch"))
    return "tilt", shown.t, np.degrees(np.arccos(np.clip(np.cos(roll) * np.cos(pitch), -1.0, 1.0)))


def _largest(t: Array, y: Array, edges: Array) -> Array:
    """The largest y (n,) between each pair of edges; NaN where there is no finite value."""
    y = np.asarray(y, np.float64)
    good = np.isfinite(y) & np.isfinite(t)
    out = np.full(len(edges) - 1, -np.inf)
    np.maximum.at(out, np.clip(np.searchsorted(edges, t[good], "right") - 1, 0, len(out) - 1), y[good])
    return np.where(np.isfinite(out), out, np.nan)


def _bridged(values: Array) -> Array:
    """The same with straight lines across short gaps."""
    known = np.flatnonzero(np.isfinite(values))
    for a, b in itertools.pairwise(known):
        if b - a <= BRIDGED:
            values[a : b + 1] = np.linspace(values[a], values[b], b - a + 1)
    return values


def _marks(result: Result, edges: Array) -> list[list[Any]]:
    """Serious events in the order of time; what lies closer than a point of the picture is one mark."""
    found: list[list[Any]] = []
    for event in sorted((e for e in result.events if e.severity == "serious"), key=lambda e: e.t):
        if found and event.t - found[-1][0] < edges[1] - edges[0]:
            found[-1][1] += f" {event.text}"
        elif len(found) < MOST_SPANS:
            found.append([round(event.t, 1), event.text])
    return found
