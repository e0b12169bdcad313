"""Where did it go, and did its heading point along the course? The path over ground by GNSS, with both directions."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from attlog.base import rotation
from attlog.flight.model import Array, Attitude, Gnss, covered_seconds, running
from attlog.flight.vehicle import VehicleKind
from attlog.health.assessments.model import HealthCase
from attlog.health.figures.samples import end_of
from attlog.metrics.figures.trace import Trace
from attlog.segments.gaps import rising
from attlog.segments.spans import Span, inside

MOST = 2000
"""Points of the path."""
FEWEST = 10
FIX_3D = 3
M_PER_DEG = 6371008.8 * math.pi / 180.0
"""Of latitude on a sphere of the earth's mean radius; a flight is too short for more."""
MOVED_M, WANDER_M, MOVED_S = 5.0, 15.0, 3.0
"""So far goes what shows a course for MOVED_S; without velocities a receiver wanders by less than WANDER_M."""
SLOW_M_S = 1.0
"""Slower than this GNSS tells no course."""
FAST_M_S, WINGED_M_S = 2.0, 5.0
"""From this speed on (a plane: from that) heading and course are compared."""
NEAR_S = 1.0


def track(case: HealthCase) -> list[Trace]:
    """The path of the receiver with most fixes; nothing where the vehicle stayed in its place while driven."""
    log = case.log
    receiver = max(log.gnss, key=lambda g: int(np.count_nonzero(_placed(g))), default=None)
    if receiver is None or np.count_nonzero(_placed(receiver)) < FEWEST:
        return []
    spans = [] if case.segments is None else case.segments.spans("airborne" if log.kind.flies else "armed")
    forward = log.kind.fixed_wing or log.kind in (VehicleKind.ROVER, VehicleKind.BOAT)
    least = WINGED_M_S if log.kind.fixed_wing else FAST_M_S
    found = path(receiver, log.onboard_attitude, spans, least, end_of(case.segments))
    driven = found.columns["driven"] > 0 if spans else np.ones(len(found.t), bool)
    moving = driven & np.isfinite(found.columns["course"])
    enough = MOVED_M if covered_seconds(found.t[moving]) >= MOVED_S else WANDER_M
    if driven.sum() < FEWEST or _extent(found, driven) < enough:
        return []
    found.values["forward"] = float(forward)
    return [found]


def path(receiver: Gnss, attitude: Attitude | None, spans: list[Span], least: float, end: float) -> Trace:
    """The path of a receiver: north and east (m), heading and course (deg), speed (m/s), driven 1 within ``spans``.

    Course and heading are NaN below SLOW_M_S. Values: ``lat``, ``lon`` (deg) of zero; ``difference``, ``low``,
    ``high``: median and quartiles of heading minus course (deg) while driven before ``end`` s at ``least`` m/s or more,
    and ``seconds`` of it.
    """
    use = _placed(receiver)
    t, x = rising(np.where(use, receiver.t, np.nan), np.column_stack([receiver.lat, receiver.lon]).astype(np.float64))
    velocity = receiver.vel_ned[np.searchsorted(receiver.t, t).clip(max=len(receiver.t) - 1), :2]
    driven = inside(t, spans)
    lat, lon = (float(v) for v in x[int(np.argmax(driven))])  # where it started
    north = (x[:, 0] - lat) * M_PER_DEG
    east = ((x[:, 1] - lon + 180.0) % 360.0 - 180.0) * M_PER_DEG * math.cos(math.radians(lat))
    speed = np.hypot(velocity[:, 0], velocity[:, 1])
    slow = ~(speed >= SLOW_M_S)
    course = np.where(slow, np.nan, np.degrees(np.arctan2(velocity[:, 1], velocity[:, 0])))
    heading = np.where(slow, np.nan, heading_at(attitude, t))
    columns = {"north": north, "east": east, "heading": heading, "course": course, "speed": speed, "driven": driven}
    values = {"lat": lat, "lon": lon, "least": least} | off_course(
        t, heading - course, driven & (t <= end) & (speed >= least)
    )
    kept = slice(None, None, -(-len(t) // MOST))
    pause = np.append(False, ~running(t[kept]))
    columns = {name: np.where(pause, np.nan, y[kept]) for name, y in columns.items()}
    return Trace("track", "", t[kept], columns, receiver.source, values=values)


def heading_at(attitude: Attitude | None, t: Array) -> Array:
    """Heading (n,) deg of an attitude at ``t`` (n,) s; NaN where no sample is near."""
    if attitude is None or len(attitude.t) < 2:
        return np.full(len(t), np.nan)
    at, q = rising(attitude.t, attitude.q)
    if len(at) < 2:
        return np.full(len(t), np.nan)
    after = np.searchsorted(at, t).clip(1, len(at) - 1)
    near = np.minimum(np.abs(at[after] - t), np.abs(t - at[after - 1])) < NEAR_S
    return np.where(near, np.degrees(rotation.to_euler(rotation.slerp(at, q, t))[:, 2]), np.nan)


def off_course(t: Array, difference: Array, use: NDArray[np.bool_]) -> dict[str, float]:
    """Median and quartiles (deg) of angles (n,) about their circular mean; nothing from fewer than FEWEST."""
    use = use & np.isfinite(difference)
    if np.count_nonzero(use) < FEWEST:
        return {}
    angle = np.radians(difference[use])
    mean = math.atan2(float(np.mean(np.sin(angle))), float(np.mean(np.cos(angle))))
    around = np.degrees(rotation.wrap(angle - mean)) + math.degrees(mean)
    low, middle, high = (float(v) for v in np.quantile(around, [0.25, 0.5, 0.75]))
    turn = 360.0 * round(middle / 360.0)
    return {"difference": middle - turn, "low": low - turn, "high": high - turn, "seconds": covered_seconds(t[use])}


def _placed(receiver: Gnss) -> NDArray[np.bool_]:
    """Which records (n,) hold a position with a 3D fix; 0, 0 is none."""
    known = np.isfinite(receiver.lat) & np.isfinite(receiver.lon) & (receiver.fix >= FIX_3D)
    return np.asarray(known & ((receiver.lat != 0.0) | (receiver.lon != 0.0)))


def _extent(found: Trace, use: NDArray[np.bool_]) -> float:
    """The larger side (m) of the box that holds all points but the outermost hundredth on either end."""
    sides = [np.nanquantile(found.columns[name][use], [0.01, 0.99]) for name in ("north", "east")]
    return max(float(high - low) for low, high in sides)
