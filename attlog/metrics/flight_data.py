"""Traces of flight data: lines of the panels, as envelopes within a budget.

``data`` (no row): lines of a panel (``key``) by label, in the panel's unit, for lines of one message the same times.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from attlog.core.sorting import median
from attlog.core.spans import Span, merge
from attlog.flight.model import Array, FlightLog, without_pauses
from attlog.flight.panels import RATE_PANELS, PanelLine, panel_lines
from attlog.metrics.trace import Trace, detailed
from attlog.story.flight_events import Event

# Samples of all lines together, and fewest and most of one.
BUDGET, MIN_SAMPLES, MAX_SAMPLES = 120_000, 800, 6000
# A slow line is broken at an interval this many times the usual one, if the logger paused in it; times of the records
# at both ends of a pause differ by less than ROUNDING_S between messages.
LONGER, ROUNDING_S = 1.5, 0.2
# Events that are faster than an envelope of a long log: at most the gravest of them, with the time about each, and the
# samples of a line that are kept for them.
FAST = {"overturn", "tumble", "impact", "hard_landing", "oscillation", "clipping", "rate_tracking"}
FAST |= {"motor_no_thrust", "motor_off", "motor_frozen", "motors_off", "no_thrust_left", "yaw_backwards"}
MAX_FAST, BEFORE_S, AFTER_S, MAX_NEAR = 8, 2.0, 4.0, 6000
# Smallest share of that time that is kept, the gravest event's in any case.
MIN_SHARE = 0.25
# Panels with such detail.
DETAILED = {*RATE_PANELS, "motors", "outputs", "commands"}
AXES = ("x", "y", "z")
# Time on the ground before take-off whose height is 0.
GROUND_S = 5.0
# Whose height at take-off is subtracted from a line; a distance to the ground keeps its own.
ZERO_OF = {"set-point": "onboard", "TECS set-point": "GNSS"}
MEASURED_FROM_GROUND = ("rangefinder",)


def flight_data(log: FlightLog, flights: list[Span], events: Sequence[Event] = ()) -> list[Trace]:
    """Return the traces of flight data; ``flights``: spans in the air, ``events``: around them detail is kept."""
    lines = panel_lines(log)
    heights = {line.label for line in lines if line.panel == "height"}
    lines = [x for x in lines if x.panel != "height" or ZERO_OF.get(x.label, x.label) in heights]
    _zero_heights([line for line in lines if line.panel == "height"], flights)
    keep = int(np.clip(BUDGET // (len(lines) + len(RATE_PANELS) + len(AXES)), MIN_SAMPLES, MAX_SAMPLES))
    found, imu = [], log.replay_imu
    stops, near = _stops(log), near_events(events)
    if imu is not None and len(imu.gyro.t) > 1:
        t, rates = _detailed(imu.gyro.t, imu.gyro.x, keep, near)
        ratio, pauses = len(imu.gyro.t) / len(t), broken_spans(imu.gyro.t, stops)
        found += [
            _trace(panel, ["gyro"], t, np.degrees(rates[:, [k]]), ratio, pauses) for k, panel in enumerate(RATE_PANELS)
        ]
        t, force = _detailed(imu.acc.t, imu.acc.x, keep, near)
        pauses, ratio = broken_spans(imu.acc.t, stops), len(imu.acc.t) / max(len(t), 1)
        found.append(_trace("acceleration", list(AXES), t, force, ratio, pauses))
    grouped: dict[tuple[str, bytes], list[PanelLine]] = {}
    for line in lines:
        grouped.setdefault((line.panel, line.t.tobytes()), []).append(line)
    for same in grouped.values():
        values = np.column_stack([line.y for line in same])
        t, x = _detailed(same[0].t, values, keep, near if same[0].panel in DETAILED else near[:0])
        pauses, ratio = broken_spans(same[0].t, stops), len(same[0].t) / len(t)
        found.append(_trace(same[0].panel, [line.label for line in same], t, x, ratio, pauses))
    return found


def near_events(events: Sequence[Event]) -> Array:
    """Return the spans (n, 2) s around the gravest events of the vehicle's motion, the gravest first."""
    grave = sorted((e for e in events if e.kind in FAST), key=lambda e: (e.severity != "serious", e.t))[:MAX_FAST]
    return np.array([(e.t - BEFORE_S, e.t + AFTER_S) for e in grave]).reshape(-1, 2)


def _detailed(t: Array, x: Array, keep: int, near: Array) -> tuple[Array, Array]:
    """Return an envelope with every sample near events, of a shorter time for those that a line has little room for."""
    chosen: list[Span] = []
    room = float(MAX_NEAR)
    for (start, _), count in zip(near, np.diff(np.searchsorted(t, near), axis=1)[:, 0], strict=True):
        share = min(1.0, room / max(count, 1))
        if share >= MIN_SHARE or not chosen:
            at = start + BEFORE_S
            chosen.append((at - share * BEFORE_S, at + share * AFTER_S))
            room -= share * count
    return detailed(t, x, keep, np.array(merge(chosen)).reshape(-1, 2))


def _stops(log: FlightLog) -> Array:
    """Return the spans (n, 2) s in which the gyro was not logged."""
    t = log.replay_imu.gyro.t if log.replay_imu is not None else np.zeros(0)
    k = np.flatnonzero(~without_pauses(t))
    return np.column_stack([t[k], t[k + 1]])


def broken_spans(t: Array, stops: Array) -> Array:
    """Return the intervals (m, 2) s of a line's own times (n,) that it does not cross.

    Those are pauses, and for a slow line also intervals longer than usual with one of ``stops`` (k, 2) s in them.
    """
    dt, broken = np.diff(t), ~without_pauses(t)
    if len(dt):
        k = np.searchsorted(t, stops[:, 0] + ROUNDING_S, side="right") - 1
        inside = (k >= 0) & (k < len(dt))
        k, ends = k[inside], stops[inside, 1]
        broken[k[(t[k + 1] > ends - ROUNDING_S) & (dt[k] > LONGER * median(dt))]] = True
    return np.column_stack([t[:-1][broken], t[1:][broken]])


def _trace(panel: str, labels: list[str], t: Array, x: Array, ratio: float, pauses: Array) -> Trace:
    """Return thinned lines (n, k) of a panel as a trace, broken in ``pauses`` (m, 2) s of the logger."""
    at, first = np.unique(np.searchsorted(t, pauses[:, 0], side="right"), return_index=True)
    t, x = np.insert(t, at, pauses[first, 1]), np.insert(x, at, np.nan, axis=0)
    return Trace("data", "", t, {label: x[:, k] for k, label in enumerate(labels)}, panel, ratio=ratio)


def _zero_heights(lines: list[PanelLine], flights: list[Span]) -> None:
    """Subtract each height's own value on the ground before the first flight."""
    grounds = {line.label: _ground(line.t, line.y, flights) for line in lines}
    for line in lines:
        if line.label not in MEASURED_FROM_GROUND:
            line.y = line.y - grounds.get(ZERO_OF.get(line.label, line.label), 0.0)


def _ground(t: Array, y: Array, flights: list[Span]) -> float:
    """Return the height before take-off, else the first one."""
    known = np.isfinite(y)
    start = flights[0][0] if flights else float(t[0]) + GROUND_S
    ground = known & (t >= start - GROUND_S) & (t <= start)
    if ground.any():
        return float(median(y[ground]))
    return float(y[np.argmax(known)]) if known.any() else 0.0
