"""Rate, gaps and jitter of the inertial data."""

from __future__ import annotations

import numpy as np

from attlog.flight.clock.timing import gaps
from attlog.flight.inertial import LOW_RATE_HZ, REPLAY_MIN_HZ, fast_enough
from attlog.flight.model import FlightLog
from attlog.health.model import Check, graded

FULL_HZ = 95.0
"""Above this the rotation between samples is small enough for every estimator."""


def checks(log: FlightLog) -> list[Check]:
    """The checks that need no attitude."""
    if not log.imus:
        return [Check("rate", "fault", "There is no usable gyro and accelerometer data.", 0.0, "Hz", ">= 10 Hz")]
    imu = log.imus[log.imu or 0]
    t = imu.gyro.t
    if len(t) < 3:
        return [Check("rate", "fault", f"{imu.gyro.source}: too short, {len(t)} of 3 samples.", 0.0, "Hz", ">= 10 Hz")]
    dt = np.diff(t)
    breaks = gaps(t) - 1
    steady = np.delete(dt, breaks)
    return [rate_check(imu.gyro.source, imu.gyro.rate), gap_check(t, dt[breaks]), jitter_check(steady)]


def rate_check(source: str, rate: float) -> Check:
    """Is the IMU logged fast enough?"""
    verdict = "ok" if rate >= FULL_HZ else "warning" if fast_enough(rate) else "fault"
    what = (
        "fast enough for every figure"
        if verdict == "ok"
        else "usable, but vibration is aliased"
        if rate < LOW_RATE_HZ and verdict == "warning"
        else "usable; lags are coarser than at 100 Hz and more"
        if verdict == "warning"
        else f"too slow for a replay, which needs {REPLAY_MIN_HZ:.0f} Hz"
    )
    return Check(
        "rate", verdict, f"{source}: {rate:.1f} Hz, {what}.", round(rate, 2), "Hz", "ok from 95, replay from 10"
    )


def gap_check(t: np.ndarray, lost: np.ndarray) -> Check:
    """Are samples missing?"""
    total = float(lost.sum())
    share = 100.0 * total / float(t[-1] - t[0])
    limit = "ok: none above 50 ms; fault: above 20 % of the time"
    if len(lost) == 0:
        return Check("gaps", "ok", "No gap in the inertial data.", 0, "", limit)
    text = f"{len(lost)} gap{'s' if len(lost) > 1 else ''}, {total:.2f} s in all ({share:.1f} %)"
    text += f", the longest {lost.max():.2f} s" if len(lost) > 1 else ""
    return Check("gaps", "fault" if share > 20.0 else "warning", text + ".", len(lost), "", limit)


def jitter_check(dt: np.ndarray) -> Check:
    """How even are the sample times?"""
    jitter = 100.0 * float(dt.std() / np.median(dt)) if np.median(dt) > 0 else float("inf")
    text = f"Intervals {np.median(dt) * 1e3:.2f} ms, standard deviation {jitter:.1f} %."
    return Check("jitter", graded(jitter, 15.0, 60.0), text, round(jitter, 2), "%", "ok up to 15 %, fault above 60 %")
