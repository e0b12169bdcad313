"""Whose down is it where accelerometer and attitude disagree? The earth's field dips below level by a known angle.

A smoother made of an accelerometer in a frame of its own is sure of a down that is none. The field
is measured by a third sensor: where it dips as it must below the level of the onboard attitude,
and not below that of the accelerometer, the accelerometer is the one that is wrong.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from attlog.base import rotation
from attlog.flight.model import Array, Attitude, FlightLog
from attlog.reference import declination
from attlog.segments import Segments, gaps, spans

QUIET = ("rest", "idle", "hover")
"""Where the mean specific force is gravity's; the first kind that the log has."""
RIGHT_DEG, WRONG_DEG = 10.0, 25.0
"""How far the dip may be from the model's: iron and a bad calibration stay below the first, no compass error without
another cause reaches the second where the first holds for the same field."""
FEWEST = 10
"""Records of each sensor in a quiet segment."""
DOWN = np.array([0.0, 0.0, 1.0])


def accelerometer_contradicted(seen: DipAngles | None, attitude: Attitude | None) -> str:
    """Why the accelerometer's down is none; empty where nothing tells, or it is right."""
    if seen is None or attitude is None:
        return ""
    off = abs(seen.by_force - seen.on_earth), abs(seen.by_attitude - seen.on_earth)
    if not (off[0] >= WRONG_DEG and off[1] <= RIGHT_DEG):
        return ""
    return (
        f"the field {_dips(seen.by_force)} the level of the accelerometer and {_dips(seen.by_attitude)} that of "
        f"{attitude.source}; the earth's field there {_dips(seen.on_earth)} the horizon: the accelerometer's axes are "
        "wrong"
    )


def compass_contradicted(seen: DipAngles | None, attitude: Attitude | None, source: str) -> str:
    """Why the compass does not show the earth's field: it dips otherwise below the level of the accelerometer and below
    that of the onboard attitude, which agree; empty where nothing tells, or it is right."""
    if seen is None or attitude is None or abs(seen.by_force - seen.by_attitude) > RIGHT_DEG:
        return ""
    if abs(seen.by_force - seen.on_earth) < WRONG_DEG:
        return ""
    signs = abs(seen.by_force + seen.on_earth) <= RIGHT_DEG and abs(seen.on_earth) >= WRONG_DEG
    return (
        f"the field of {source} {_dips(seen.by_force)} the level of the accelerometer and of {attitude.source}; the "
        f"earth's field there {_dips(seen.on_earth)} the horizon: "
        f"{'all its axes have the other sign' if signs else 'its axes are wrong, or iron bends it'}"
    )


def _dips(angle: float) -> str:
    """``points 60 deg below``: a dip in words, the sign in its last one."""
    return f"points {abs(angle):.0f} deg {'above' if angle < -0.5 else 'below'}"


@dataclass(frozen=True, slots=True)
class DipAngles:
    """How far (deg) the field points below the levels of the accelerometer and of an attitude, and on earth."""

    by_force: float
    by_attitude: float
    on_earth: float


def dips(log: FlightLog, segments: Segments, attitude: Attitude | None) -> DipAngles | None:
    """The median dips over the quiet segments of the first kind that the log has; None where nothing tells."""
    imu, model = log.replay_imu, declination.model(log)
    if imu is None or attitude is None or log.mag is None or model is None:
        return None
    kind = next((k for k in QUIET if segments.of(k)), None)
    if kind is None:
        return None
    mag = log.mags[log.mag].field
    by_force, by_attitude = [], []
    both = [gaps.rising(s.t_best, s.x) for s in (imu.acc, mag)]
    for one in segments.of(kind):
        force, field = (_mean(t, x, one.t0, one.t1) for t, x in both)
        flown = spans.between(attitude.t, one.t0, one.t1)
        if force is None or field is None or flown.stop - flown.start < FEWEST:
            continue
        down = np.mean(rotation.rotate_inverse(attitude.q[flown], DOWN), axis=0)
        by_force.append(_dip_deg(-force, field))
        by_attitude.append(_dip_deg(down, field))
    if not by_force:
        return None
    return DipAngles(float(np.median(by_force)), float(np.median(by_attitude)), model.inclination_deg)


def _mean(t: Array, x: Array, t0: float, t1: float) -> Array | None:
    """The mean (3,) of the samples in a span; None for too few or none with a direction."""
    inside = spans.between(t, t0, t1)
    if inside.stop - inside.start < FEWEST:
        return None
    mean: Array = np.mean(x[inside], axis=0)
    return mean if mean.any() else None


def _dip_deg(down: Array, field: Array) -> float:
    """The angle of a field below the level of a down, deg."""
    size = math.sqrt(float(down @ down) * float(field @ field))
    return math.degrees(math.asin(max(-1.0, min(1.0, float(down @ field) / size)))) if size > 0 else math.nan
