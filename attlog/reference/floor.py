"""The replay floor: the smallest difference between attitudes that a log can resolve."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from attlog.base import gap, rotation
from attlog.flight.model import Imu
from attlog.reference.model import AlignmentStep
from attlog.segments import gaps

Array = NDArray[np.float64]

FLOAT32_DEG = 1e-5
"""What float32 quaternions resolve when angles come from the vector part."""

REPEATED_SHARE, MULTIPLE_SHARE = 0.01, 0.9
TICK_S = 1e-3
SAMPLES = 20_000


def step_deg(q: Array) -> float:
    """The step in deg of logged attitudes (n, 4): the smallest difference of roll or pitch that repeats.

    Values printed or stored with a step differ by its multiples only; attitudes
    without one resolve what float32 does.
    """
    angles = np.degrees(rotation.to_euler(q[:SAMPLES])[:, :2])
    d = np.abs(np.diff(angles, axis=0)).ravel()
    d = d[np.isfinite(d) & (d > FLOAT32_DEG)]
    if len(d) < 20:
        return FLOAT32_DEG
    values, count = np.unique(np.round(d, 4), return_counts=True)
    repeated = values[(count >= max(5, REPEATED_SHARE * len(d))) & (values > 1e-3)]
    if len(repeated) == 0:
        return FLOAT32_DEG
    step = float(repeated[0])
    small = d[d < 50 * step]
    off = np.abs(small / step - np.round(small / step))
    return step if len(small) and np.mean(off < 0.05) >= MULTIPLE_SHARE else FLOAT32_DEG


def tick_s(t: Array) -> float:
    """The step in s of the stamps (n,) where it shows: 1 ms where all intervals are whole ms and differ, else 0."""
    dt = np.diff(t[:SAMPLES])
    dt = dt[(dt > 0) & (dt < 1.0)]
    if len(dt) < 10:
        return 0.0
    ticks = dt / TICK_S
    usual = np.abs(ticks - np.median(ticks)) < 1.5
    whole = bool(np.all(np.abs(ticks - np.round(ticks)) < 1e-2))
    return TICK_S if whole and usual.any() and np.ptp(np.round(ticks[usual])) > 0 else 0.0


def missing_deg(imu: Imu | None) -> float:
    """Attitude error in deg that bridged gaps can have caused: a quarter of each gap times its change of rate.

    The filters integrate gaps with the mean rate of the neighbours; a rate that
    went its own way in between is off by about that. Independent gaps add in square.
    """
    if imu is None or len(imu.gyro.t) < 3:
        return 0.0
    t, rate = gaps.rising(imu.gyro.t_best, imu.gyro.x)
    dt = np.diff(t)
    bridged = (dt > gap.limit_of(t)) & (dt <= gap.RESTART_S)
    change = rotation.length(rate[1:][bridged] - rate[:-1][bridged])
    return float(np.degrees(np.sqrt(np.sum((0.25 * dt[bridged] * change) ** 2))))


def step(t: Array, q: Array, known_step: float, imu: Imu | None) -> tuple[float, float, AlignmentStep]:
    """Floor and logged step in deg of attitudes ``q`` (n, 4) at ``t`` (n,) s, and what the floor is made of."""
    own = known_step if known_step > 0 else step_deg(q)
    tick = tick_s(t)
    rate = 0.0
    if imu is not None and len(imu.gyro.x):
        (x,) = gaps.only(rotation.finite(imu.gyro.x), imu.gyro.x)
        centred = x - np.median(x, axis=0) if len(x) else x
        rate = float(np.degrees(np.sqrt(np.mean(np.einsum("ij,ij->i", centred, centred))))) if len(x) else 0.0
    timing = tick / np.sqrt(12) * rate
    missing = missing_deg(imu)
    floor = float(np.sqrt(own**2 + timing**2 + missing**2))
    text = f"logged step {own:.2g} deg, time stamps {timing:.2g} deg, bridged gaps {missing:.2g} deg"
    return floor, own, AlignmentStep("replay_floor", text, floor, "deg", "measured in this log")
