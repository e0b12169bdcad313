"""Input delay: how late the logged gyro is, by the firmware's filter and by measurement."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from attlog.base import rotation
from attlog.base.errors import UsageError
from attlog.flight.model import FlightLog, Imu
from attlog.reference.model import AlignmentStep, Reference
from attlog.segments import increments

Array = NDArray[np.float64]

ACTIVE_DPS = 12.0
"""Slower rotation is mostly noise and tells nothing about delay."""
RANGE_S, COARSE_S = 0.06, 5e-3
"""Delays looked for on both sides, and their grid: a low-pass at 20 Hz is late by 11 ms."""
LOOKED_AT, MOST = 100_000, 1200
"""Intervals that are examined, and of those that turn, how many are fitted: a long log takes no longer."""
INTERVAL_SAMPLES, LONGEST_S = 8, 0.2
FEWEST = 100
SLOWEST_HZ = 5.0
AGREES_S, SURE_S = 2e-3, 1e-3
"""Formula and rates agree within 2 ms; a fit less sure than 1 ms (one sigma) is not used."""
OUTLIER_RAD_S = np.radians(60.0)
"""A larger difference is a reset of the reference, not a delay."""


def by_parameter(imu: Imu) -> tuple[float, str]:
    """Delay in s of the gyro's low-pass, and where it comes from; 0 where no filter ahead of the logger is known."""
    if imu.gyro.delay > 0:
        return imu.gyro.delay, f"{imu.gyro.source}, {imu.filtered}"
    return 0.0, f"{imu.gyro.source}: no filter known"


def by_rates(imu: Imu, reference: Reference) -> tuple[float, float] | None:
    """Delay of the gyro against the reference's own rotation and its standard error, both in s; None where the log
    moves too little or too slowly.

    Least squares between the reference's rotation over an interval and the gyro's over
    the same interval shifted by tau, offset per axis removed, where it turns faster
    than 12 deg/s: 5 ms grid, then a parabola. An interval holds at least 8 IMU samples:
    in shorter ones the gyro's noise, which shrinks at half a sample's shift, pulls tau.
    """
    t, q = reference.t, reference.q
    turning = increments.of(imu)
    gyro_t = turning.t
    if reference.rate < SLOWEST_HZ or len(t) < FEWEST or len(gyro_t) < FEWEST:
        return None
    wanted = min(INTERVAL_SAMPLES * (gyro_t[-1] - gyro_t[0]) / (len(gyro_t) - 1), LONGEST_S)
    k = max(1, math.ceil(wanted * reference.rate))
    first = np.arange(0, len(t) - k, max(1, (len(t) - k) // LOOKED_AT))
    start, end = t[first], t[first + k]
    with np.errstate(divide="ignore", invalid="ignore"):
        turn = rotation.to_rotvec(rotation.multiply(rotation.conjugate(q[first]), q[first + k]))
        own = turn / (end - start)[:, None]
    active = np.degrees(np.sqrt(np.sum(own * own, axis=1))) > ACTIVE_DPS
    active &= (reference.segment[first + k] == reference.segment[first]) & (start >= reference.scoring_start)
    active &= (start > gyro_t[0] + RANGE_S) & (end < gyro_t[-1] - RANGE_S)
    i = np.flatnonzero(active)
    if len(i) < FEWEST:
        return None
    i = i[:: max(1, len(i) // MOST)]
    start, end, own = start[i], end[i], own[i]

    def misfits(delays: Array) -> list[float]:
        shifted = ((t + delays[:, None]).ravel() for t in (start, end))
        turned = turning.between(*shifted).reshape(len(delays), len(own), 3)
        return [misfit(rates - own) for rates in turned / (end - start)[:, None]]

    def misfit(off: Array) -> float:
        usual = np.sum((off - np.median(off, axis=0)) ** 2, axis=1) < OUTLIER_RAD_S**2
        if not usual.any():  # nothing like the gyro's rates at this shift
            return math.inf
        off = off[usual] - np.mean(off[usual], axis=0)
        return float(np.mean(np.sum(off * off, axis=1)))

    coarse = np.arange(-RANGE_S, RANGE_S + 1e-9, COARSE_S)
    best = int(np.argmin(misfits(coarse)))
    if not 0 < best < len(coarse) - 1:
        return None
    fine = np.linspace(-COARSE_S, COARSE_S, 5)
    around = misfits(coarse[best] + fine)
    if not np.isfinite(around).all():
        return None
    a, b, c = np.polyfit(fine, around, 2)
    variance = max(c - b * b / (4 * a), 0.0) / (a * len(i) / k) if a > 0 else math.inf
    return None if variance > SURE_S**2 else (float(coarse[best] - b / (2 * a)), math.sqrt(variance))


def measured(imu: Imu, reference: Reference) -> tuple[float, float] | None:
    """The same, measured once for a unit and a reference."""
    for known, delay in reference.delays_seen:
        if known is imu:
            return delay
    found = by_rates(imu, reference)
    reference.delays_seen.append((imu, found))
    return found


def step(log: FlightLog, imu: Imu | None, reference: Reference, option: str | float) -> tuple[float, AlignmentStep]:
    """The input delay in s that is subtracted from lags of replayed rows; the step says what the rates show too."""
    name, switch = "input_delay", "config: input_delay"
    if option == "off":
        text = "switched off: lags contain the sensor's filters"
        return 0.0, AlignmentStep(name, text, 0.0, "ms", "option", False, switch)
    if option != "auto":
        try:
            option_ms = float(option)
        except ValueError:
            raise UsageError(f"input_delay {option!r}: use auto, off or milliseconds") from None
        return 1e-3 * option_ms, AlignmentStep(name, "given by the user", option_ms, "ms", "option", option=switch)
    if imu is None:
        return 0.0, AlignmentStep(name, "no IMU is replayed", 0.0, "ms", "", False, switch)
    known, source = by_parameter(imu)
    found = None if reference.kind == "smoother" else measured(imu, reference)
    seen = None if found is None else found[0]
    if reference.kind == "smoother":
        check = "the smoother is without it; made of this gyro, it cannot check it"
    elif seen is None:
        check = "the log turns too little to check it"
    else:
        verdict = "" if abs(seen - known) <= AGREES_S else ", which disagrees: look at clock in --config"
        check = f"the rates show {1e3 * seen:.1f} ms against {reference.source}{verdict}"
    text = f"{1e3 * known:.1f} ms by {source}; {check}"
    return known, AlignmentStep(name, text, 1e3 * known, "ms", source, known > 0, switch)
