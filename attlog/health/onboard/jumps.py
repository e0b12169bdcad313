"""Jumps of the onboard attitude: yaw realignments, resets and lane switches, with their size."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from attlog.base import rotation
from attlog.flight.model import FlightLog
from attlog.health.model import Check
from attlog.segments import resets, spans
from attlog.segments.model import Segments

Array = NDArray[np.float64]

LEAST_DEG, LARGE_DEG = 3.0, 15.0
"""Smaller ones are what an estimator does every day; from 15 deg a flight in position hold goes astray."""
ALIGNED_S = 15.0
"""Where nothing tells of arming: steps within so long after the first attitude are its alignment."""
SHOWN = 4


def checks(log: FlightLog, segments: Segments) -> list[Check]:
    """Steps of the onboard attitude that no rotation of the vehicle explains, once it was armed (aligned)."""
    attitude, imu = log.onboard_attitude, log.replay_imu
    if attitude is None or imu is None:
        return []
    limit = f"ok up to {LEAST_DEG:.0f} deg, fault above {LARGE_DEG:.0f} deg in flight"
    index, _ = resets.known(log, log.onboard or "", segments)
    index = index[in_use(attitude.t[index], float(attitude.t[0]), segments)]
    lost = [(s.t0, s.t1) for kind in ("loss_of_control", "impact") for s in segments.of(kind)]
    index = index[~spans.inside(attitude.t[index], lost)]
    sizes = resets.unexplained_deg(attitude, imu) if len(index) else None
    if sizes is None:
        return [Check("attitude jumps", "ok", f"{log.onboard} never jumps while in use.", 0.0, "deg", limit)]
    size = sizes[0][index - 1]
    large = np.isfinite(size) & (size > LEAST_DEG)
    if not large.any():
        worst = float(np.nanmax(size)) if np.isfinite(size).any() else 0.0
        text = f"{log.onboard} jumps by {worst:.1f} deg at most."
        return [Check("attitude jumps", "ok", text, round(worst, 1), "deg", limit)]
    t, size, index = attitude.t[index[large]], size[large], index[large]
    order = np.argsort(-size, kind="stable")
    flown = segments.mask(t, "airborne")
    yaw = yaw_share(attitude.q, index)
    shown = ", ".join(f"{size[k]:.1f} deg at {t[k]:.1f} s" for k in sorted(order[:SHOWN].tolist()))
    more = f" and {len(t) - SHOWN} smaller ones" if len(t) > SHOWN else ""
    kind = "heading is realigned" if (yaw > 0.9).all() else "attitude jumps"
    times = "once" if len(t) == 1 else f"{len(t)} times"
    text = f"The onboard {kind} {times}: {shown}{more}."
    verdict = "fault" if (size[flown] > LARGE_DEG).any() else "warning"
    worst = float(size.max())
    return [Check("attitude jumps", verdict, text, round(worst, 1), "deg", limit, t=float(t[0]), count=len(t))]


def in_use(t: Array, start: float, segments: Segments) -> NDArray[np.bool_]:
    """Which times (k,) are while armed or in the air, else well after the first attitude: before, it is aligned."""
    if "armed" in segments.unknown:
        later: NDArray[np.bool_] = t > start + ALIGNED_S
        return later | segments.mask(t, "airborne")
    used: NDArray[np.bool_] = segments.mask(t, "armed") | segments.mask(t, "airborne")
    return used


def yaw_share(q: Array, index: NDArray[np.int64]) -> Array:
    """How much (k,) of each step at ``index`` turns about the vertical, 0 to 1."""
    step = rotation.to_rotvec(rotation.multiply(q[index], rotation.conjugate(q[index - 1])))
    size = np.sqrt(np.sum(step**2, axis=1))
    share: Array = np.divide(np.abs(step[:, 2]), size, out=np.zeros(len(size)), where=size > 0)
    return share
