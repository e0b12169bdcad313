"""Jumps of the onboard attitude: yaw realignments, resets and lane switches, with their size."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from attlog.base import rotation
from attlog.flight.model import FlightLog
from attlog.health.model import Check
from attlog.health.sound import before_crashes
from attlog.reference.model import Reference
from attlog.reference.smoothed import differences_deg
from attlog.segments import resets
from attlog.segments.model import Segments

Array = NDArray[np.float64]

LEAST_DEG, LARGE_DEG = 3.0, 15.0
"""Smaller ones are what an estimator does every day; from 15 deg a flight in position hold goes astray."""
ALIGNED_S = 15.0
"""Where nothing tells of arming: steps within so long after the first attitude are its alignment."""
SHOWN = 4
AROUND_S = 3.0
"""So long before and after a jump the attitude is held against truth or smoother."""
LEFT = 0.4
"""A jump sets right (or wrong) what had (or has then) so much of the error of its other side at most."""


def checks(log: FlightLog, segments: Segments, reference: Reference | None = None) -> list[Check]:
    """Steps of the onboard attitude that no rotation of the vehicle explains, once it was armed (aligned) and whole.

    ``reference``: truth or smoother tell on which side of the largest jump the attitude was right.
    """
    attitude, imu = log.onboard_attitude, log.replay_imu
    if attitude is None or imu is None:
        return []
    limit = f"ok up to {LEAST_DEG:.0f} deg, fault above {LARGE_DEG:.0f} deg in flight"
    index, _ = resets.known(log, log.onboard or "", segments)
    stamps = attitude.t[index]
    index = index[in_use(stamps, float(attitude.t[0]), segments) & before_crashes(segments, stamps)]
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
    heading = bool((yaw > 0.9).all())
    times = "once" if len(t) == 1 else f"{len(t)} times"
    text = f"The onboard {'heading' if heading else 'attitude'} jumped {times}: {shown}{more}."
    verdict = "fault" if (size[flown] > LARGE_DEG).any() else "warning"
    k = int(order[0])
    side = right_side(log, reference, int(index[k]), heading, float(size[k]))
    return [
        Check(
            "attitude jumps",
            verdict,
            text,
            round(float(size.max()), 1),
            "deg",
            limit,
            t=float(t[0]),
            t_end=float(t[-1]) if len(t) > 1 else None,
            count=len(t),
            about="heading" if heading else "tilt",
            evidence=[side] if side else [],
        )
    ]


def right_side(log: FlightLog, reference: Reference | None, k: int, heading: bool, size: float) -> str:
    """On which side of the jump to sample ``k`` truth or smoother find the attitude right; empty where on none."""
    attitude = log.onboard_attitude
    if reference is None or attitude is None or reference.kind not in ("truth", "smoother"):
        return ""
    if heading and reference.heading_by != "own":
        return ""
    errors = []
    for a, b in ((attitude.t[k] - AROUND_S, attitude.t[k - 1]), (attitude.t[k], attitude.t[k] + AROUND_S)):
        i, j = np.searchsorted(attitude.t, [a, b], side="left")
        tilt, turned = differences_deg(reference, attitude.t[i : j + 1], attitude.q[i : j + 1])
        off = np.abs(turned if heading else tilt)
        errors.append(float(np.nanmedian(off)) if np.isfinite(off).any() else np.nan)
    before, after = errors
    whom = "the truth" if reference.kind == "truth" else "the smoother"
    if not np.isfinite(before + after) or max(before, after) < 0.5 * size:
        return ""
    if after < LEFT * before:
        return f"Before the jump at {attitude.t[k]:.1f} s it was {before:.0f} deg off {whom}, then {after:.0f} deg."
    if before < LEFT * after:
        return f"The jump at {attitude.t[k]:.1f} s set it wrong: {before:.0f} deg off {whom} before, then {after:.0f}."
    return ""


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
