"""Detect records of one flight, as from a card and a radio.

They count once where logs are pooled. Both hold the onboard attitude on the autopilot's own clock. In motion two
flights differ by degrees at the same time since boot, two records of one flight only by interpolation: on 27 simulated
flights, three of them recorded twice, 2.6 deg and more against 0.002 to 0.016 deg. Without motion only equal content
proves it.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from attlog.core import rotation
from attlog.core.sorting import median
from attlog.flight.model import FlightLog

Array = NDArray[np.float64]

# Step of the sampled attitude, and longest interval of a record that is interpolated.
STEP_S, MAX_GAP_S = 0.2, 1.0
# One hour at STEP_S.
MAX_STEPS = 18_000
# Largest median angle between records of one flight: geometric mean of the two groups measured (see above).
MAX_MEDIAN_DEG = 0.2
# RMS angle about the mean that counts as motion: at rest two vehicles may have equal attitudes.
MIN_MOTION_DEG = 2.0
# Shortest common time, and its smallest share of the shorter log.
MIN_COMMON_S, MIN_COMMON_SHARE = 20.0, 0.5


@dataclass(frozen=True, slots=True)
class FlightTrack:
    """Onboard attitude ``q`` (n, 4) every STEP_S s since boot, from step ``first`` on.

    ``rate_hz``: rate of the replayed IMU. Of two logs of one flight the one with the higher rate counts.
    """

    name: str
    sha256: str
    rate_hz: float
    first: int
    q: Array


def flight_track(log: FlightLog, name: str, sha256: str = "") -> FlightTrack:
    """Sample the onboard attitude of a log; empty without one, matching no other."""
    imu = log.replay_imu
    rate = 0.0 if imu is None or len(imu.gyro.t) < 2 else float(1.0 / median(np.diff(imu.gyro.t)))
    found = FlightTrack(name, sha256, rate, 0, np.zeros((0, 4)))
    attitude = None if log.onboard is None else log.attitudes.get(log.onboard)
    if attitude is None:
        return found
    usable = np.isfinite(attitude.q).all(axis=1) & np.isfinite(attitude.t)
    t, q = attitude.t[usable] + 1e-6 * log.t0_us, attitude.q[usable]
    rising = np.concatenate([np.ones(min(len(t), 1), bool), t[1:] > np.maximum.accumulate(t)[:-1]])
    t, q = t[rising], q[rising]
    if len(t) < 2:
        return found
    first, last = int(np.ceil(t[0] / STEP_S)), int(np.floor(t[-1] / STEP_S))
    at = STEP_S * np.arange(first, min(last + 1, first + MAX_STEPS))
    before = np.clip(np.searchsorted(t, at, side="right") - 1, 0, len(t) - 2)
    sampled = rotation.slerp(t, q, at)
    sampled[t[before + 1] - t[before] > MAX_GAP_S] = np.nan
    return replace(found, first=first, q=sampled)


def same_flight(a: FlightTrack, b: FlightTrack) -> bool:
    """Return whether two logs are of one flight.

    They are the same file, or have equal attitudes at equal times, in motion.
    """
    if a.sha256 and a.sha256 == b.sha256:
        return True
    begin, end = max(a.first, b.first), min(a.first + len(a.q), b.first + len(b.q))
    if end <= begin:
        return False
    x, y = a.q[begin - a.first : end - a.first], b.q[begin - b.first : end - b.first]
    known = np.isfinite(x).all(axis=1) & np.isfinite(y).all(axis=1)
    if known.sum() < max(MIN_COMMON_S / STEP_S, MIN_COMMON_SHARE * min(len(a.q), len(b.q))):
        return False
    x, y = x[known], y[known]
    moved = np.degrees(rotation.total_angle(rotation.earth_error(x, rotation.mean(x))))
    apart = np.degrees(rotation.total_angle(rotation.earth_error(x, y)))
    return bool(np.sqrt(np.mean(moved**2)) > MIN_MOTION_DEG and median(apart) < MAX_MEDIAN_DEG)


def find_repeats(tracks: Sequence[FlightTrack]) -> dict[str, str]:
    """Map each repeated log to the log of the same flight that replaces it.

    The log with the highest IMU rate counts, of equal ones the first.
    """
    kept: list[FlightTrack] = []
    repeats: dict[str, str] = {}
    for one in sorted(tracks, key=lambda t: -t.rate_hz):
        same = next((other for other in kept if same_flight(one, other)), None)
        if same is None:
            kept.append(one)
        else:
            repeats[one.name] = same.name
    return repeats


def repeat_warning(repeat: str, kept: str) -> str:
    """Return the warning for a repeated log."""
    return f"{repeat} and {kept} are one flight: only {kept} counts in what is pooled"
