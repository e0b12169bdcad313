"""Off the ground or on it, by height, throttle and the IMU: what flags of arming and landing are checked with.

A barometer drifts by a metre in minutes and a take-off level is soon forgotten, so height counts from the
ground that the vehicle last and next stood on: the line through its level at the moments without drive,
without climb and without speed.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from attlog.flight.model import FlightLog, Stream
from attlog.flight.vehicle import VehicleKind
from attlog.segments import motion, spans
from attlog.segments.spans import Span
from attlog.segments.windows import Windows

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]

GRID_S = 0.1
SMOOTH_S = 1.0
"""Height is averaged, and its slope taken, over this long."""
STALE_S = 1.5
"""A height older than this says nothing."""
OFF_M, CLIMB_M_S = 0.5, 1.0
"""Above this height, or changing it this fast, is off the ground."""
SURE_M = 1.0
"""A flight that reaches this height is believed against any flag; a lower one only where it lasts."""
HALF, LEAST_DRIVE = 0.5, 0.1
"""Drive is above half of the throttle that flight takes, and above a tenth."""
LIFTING = 0.2
"""Motors that idle take up to 0.15 of the throttle; rotors that never get less than this carry what they lift."""
STEADY_M_S, STANDING_M_S = 0.5, 2.0
BRIDGE_S, LEAST_S, LOW_S = 3.0, 1.0, 5.0
IDLE_S, CALM_S, CALM_DPS = 2.0, 5.0, 1.0
"""On the ground in spite of a flag: 2 s without drive, or 5 s with it in which the gyro's noise stays below 1 deg/s."""


@dataclass(slots=True)
class FlightEvidence:
    """What speaks for flight at times ``t`` (n,) 0.1 s apart.

    ``drive``: throttle above half of what moving up and down takes. ``height`` m above the ground, NaN where
    nothing tells it; ``climb`` m/s. ``off``: higher than 0.5 m, or climbing or sinking faster than 1 m/s.
    ``standing``: not so, and no speed. ``why`` names the sources. ``aloft``: a log that begins and ends in the air, of
    rotors that always lift: nothing in it tells where the ground is.
    """

    t: Array
    drive: Mask
    height: Array
    climb: Array
    off: Mask
    standing: Mask
    why: str
    aloft: bool = False


def evidence(log: FlightLog, armed: list[Span] | None, t0: float, t1: float) -> FlightEvidence | None:
    """The evidence over [t0, t1] s; None without a height, or where nothing tells drive. ``armed``: None where unknown.

    A log with neither throttle nor land detector has drive while it is armed, where it climbs or sinks as
    no barometer drifts.
    """
    throttle, above = drive(log), height(log)
    flag = log.landed is not None and bool(log.landed.value)
    by_arming = throttle is None and armed is not None and not flag
    if (throttle is None and not by_arming) or above is None or len(above.t) < 3 or t1 - t0 < SMOOTH_S:
        return None
    t = np.arange(t0, t1 + GRID_S, GRID_S)
    level, climb = _smooth(t, above)
    on, power, source = np.ones(len(t), bool), np.ones(len(t)), "arming"
    if throttle is not None:
        power, source = _held(t, throttle.t, throttle.x[:, 0]), f"throttle ({throttle.source})"
        on = power > max(HALF * _usual(power, climb), LEAST_DRIVE)
    if armed is not None:
        quick = np.abs(climb) > CLIMB_M_S
        climbing = [s for s in armed if np.count_nonzero(quick & spans.inside(t, [s])) * GRID_S >= LEAST_S]
        on &= spans.inside(t, climbing if by_arming else armed)
    slow = ~(motion.speed_m_s(log, t) > STANDING_M_S)
    ground = _eroded(~on & slow & (np.abs(climb) < STEADY_M_S), round(LEAST_S / GRID_S))
    known = ground & np.isfinite(level)
    high = level - np.interp(t, t[known], level[known]) if known.any() else np.full(len(t), np.nan)
    off = (high > OFF_M) | (np.abs(climb) > CLIMB_M_S)
    standing = np.isfinite(high) & ~off & (np.abs(climb) < STEADY_M_S) & slow
    lifting = log.throttle is not None and log.kind is VehicleKind.MULTIROTOR and bool(np.all(power > LIFTING))
    if lifting and armed is None and not flag and not known.any():
        return FlightEvidence(
            t, on, high, climb, off, standing, f"{source}, which is never below {LIFTING}", aloft=True
        )
    return FlightEvidence(t, on, high, climb, off, standing, f"{source} with a climb by {above.source}")


def flights(found: FlightEvidence) -> list[Span]:
    """Spans off the ground that drive has lifted: to 1 m, or for 5 s; ends reach out to where the climb began."""
    if found.aloft:
        return [(float(found.t[0]), float(found.t[-1]))]
    lifted = _bridged(found.off, found.drive, round(BRIDGE_S / GRID_S))
    kept = []
    for a, b in _runs(lifted):
        driven = np.count_nonzero(found.drive[a:b] & found.off[a:b]) * GRID_S
        top = np.max(np.nan_to_num(found.height[a:b]), initial=0.0)
        if driven < LEAST_S or top < OFF_M or (top < SURE_M and (b - a) * GRID_S < LOW_S):
            continue
        while a > 0 and found.drive[a - 1] and found.climb[a - 1] > 0.2 and found.height[a - 1] > 0.0:
            a -= 1
        kept.append((float(found.t[a]), float(found.t[b - 1])))
    return spans.merge(kept)


def grounded(found: FlightEvidence, windows: Windows | None) -> list[Span]:
    """Spans on the ground whatever a flag says: without drive, or with drive and neither height nor movement."""
    idle = [r for r in _runs(found.standing & ~found.drive) if (r[1] - r[0]) * GRID_S >= IDLE_S]
    calm: list[tuple[int, int]] = []
    if windows is not None and len(windows.t0):
        i = np.clip(np.searchsorted(windows.t0, found.t, side="right") - 1, 0, len(windows.t0) - 1)
        quiet = (windows.rate_std[i] < CALM_DPS) & (found.t <= windows.t1[i] + GRID_S)
        calm = [r for r in _runs(found.standing & quiet) if (r[1] - r[0]) * GRID_S >= CALM_S]
    return spans.merge((float(found.t[a]), float(found.t[b - 1])) for a, b in idle + calm)


def lifted(found: FlightEvidence, span: Span) -> bool:
    """Whether a span has drive for 1 s or a height of 1 m: what remains of a flag beside refused time must."""
    a, b = np.searchsorted(found.t, span)
    driven = np.count_nonzero(found.drive[a:b]) * GRID_S >= LEAST_S
    return bool(driven or np.max(np.nan_to_num(found.height[a:b]), initial=0.0) >= SURE_M)


def drive(log: FlightLog) -> Stream | None:
    """What lifts, (n, 1): the throttle, else the mean motor output, else rotor speed by its largest; None without."""
    if log.throttle is not None and len(log.throttle.t) > 1:
        x = np.nan_to_num(log.throttle.x.reshape(len(log.throttle.t), -1)[:, :1])
        return Stream(log.throttle.t, x, "1", "", log.throttle.source)
    for stream in (log.motors, log.rpm):
        if stream is not None and len(stream.t) > 1:
            x = np.mean(np.nan_to_num(stream.x), axis=1)[:, None]
            return Stream(stream.t, x / max(float(np.max(x)), 1e-9), "1", "", stream.source)
    return None


def height(log: FlightLog) -> Stream | None:
    """Height in m over time: the barometer, else GNSS altitude with a 3D fix, else None."""
    for stream in log.baro:
        x = stream.x.reshape(len(stream.t), -1)[:, 0] if len(stream.t) else np.zeros(0)
        if stream.unit == "m" and np.count_nonzero(np.isfinite(x)) > 10:
            good = np.isfinite(x)
            return Stream(stream.t[good], x[good, None], "m", "", stream.source)
    for gnss in log.gnss:
        good = (gnss.fix >= 3) & np.isfinite(gnss.alt)
        if np.count_nonzero(good) > 10:
            return Stream(gnss.t[good], gnss.alt[good, None], "m", "", gnss.source)
    return None


def _usual(power: Array, climb: Array) -> float:
    """The throttle that flight takes: its median while the height changes, else the largest that is held."""
    moving = (np.abs(climb) > STEADY_M_S) & (power > 0)
    if np.count_nonzero(moving) * GRID_S >= IDLE_S:
        return float(np.median(power[moving]))
    return max(np.quantile(power, 0.95), 1e-6)


def _smooth(t: Array, above: Stream) -> tuple[Array, Array]:
    """Height and its slope (n,) at ``t`` (n,) by straight lines over 1 s; NaN where no height is near."""
    after = np.clip(np.searchsorted(above.t, t), 1, len(above.t) - 1)
    apart = np.minimum(np.abs(above.t[after] - t), np.abs(t - above.t[after - 1]))
    raw = np.interp(t, above.t, above.x[:, 0])
    half = round(0.5 * SMOOTH_S / GRID_S)
    padded = np.pad(raw, half, mode="edge")
    offsets = np.arange(-half, half + 1) * GRID_S
    level = np.convolve(padded, np.full(2 * half + 1, 1.0 / (2 * half + 1)), "valid")
    slope = np.convolve(padded, -(offsets / np.sum(offsets**2)), "valid")
    near = apart <= STALE_S
    return np.where(near, level, np.nan), np.where(near, slope, 0.0)


def _held(t: Array, at: Array, x: Array) -> Array:
    """The last value (n,) of ``x`` at or before ``t``; 0 where it is older than 1.5 s and than five intervals."""
    i = np.clip(np.searchsorted(at, t, side="right") - 1, 0, len(at) - 1)
    fresh = t - at[i] <= max(STALE_S, 5.0 * float(np.median(np.diff(at))))
    return np.where(fresh, x[i], 0.0)


def _runs(mask: Mask) -> list[tuple[int, int]]:
    """Index ranges [a, b) of neighbouring samples that hold."""
    edges = np.flatnonzero(np.diff(np.concatenate([[0], mask.astype(np.int8), [0]])))
    return [(int(a), int(b)) for a, b in zip(edges[::2], edges[1::2], strict=True)]


def _eroded(mask: Mask, count: int) -> Mask:
    """The samples of ``mask`` that lie in runs of at least ``count`` samples."""
    kept = np.zeros(len(mask), bool)
    for a, b in _runs(mask):
        kept[a:b] = b - a >= count
    return kept


def _bridged(mask: Mask, where: Mask, count: int) -> Mask:
    """``mask`` with its holes of up to ``count`` samples closed in which ``where`` holds throughout."""
    closed = mask.copy()
    for a, b in _runs(~mask):
        closed[a:b] |= 0 < a and b < len(mask) and b - a <= count and bool(where[a:b].all())
    return closed
