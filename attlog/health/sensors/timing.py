"""Rate, gaps and jitter of the inertial data."""

from __future__ import annotations

import numpy as np

from attlog.flight.clock.timing import gaps
from attlog.flight.inertial import LOW_RATE_HZ, REPLAY_MIN_HZ, fast_enough
from attlog.flight.model import FlightLog
from attlog.health.model import Check, graded
from attlog.segments.flags import held

PAUSE_S, LONG_S = 2.0, 5.0
"""A shorter gap is lost records; where nothing tells of arming, a longer one is none."""
ARMED_S, ARMED_SHARE = 1.0, 0.1
"""A pause begins up to so long after disarming, and ends with arming."""
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
    return [rate_check(imu.gyro.source, imu.gyro.rate), gap_check(t, breaks, log), jitter_check(steady)]


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


def gap_check(t: np.ndarray, breaks: np.ndarray, log: FlightLog) -> Check:
    """Are samples missing? ``breaks`` are the samples before the gaps of ``t`` (n,) s.

    A gap from disarming to arming is the logger, which rests while the vehicle does.
    """
    limit = "ok: none above 50 ms while armed; fault: above 20 % of the time"
    if len(breaks) == 0:
        return Check("gaps", "ok", "No gap in the inertial data.", 0, "", limit)
    begin, end = t[breaks], t[breaks + 1]
    paused = np.array([pauses(a, b, log) for a, b in zip(begin.tolist(), end.tolist(), strict=True)])
    rest = f"The logger paused {'once' if paused.sum() == 1 else f'{paused.sum()} times'} while disarmed, "
    rest += f"{float((end - begin)[paused].sum()):.0f} s in all."
    if paused.all():
        return Check("gaps", "ok", rest, 0, "", limit)
    lost = (end - begin)[~paused]
    total = float(lost.sum())
    share = 100.0 * total / float(t[-1] - t[0])
    text = f"{len(lost)} gap{'s' if len(lost) > 1 else ''} in the inertial data, {total:.2f} s in all ({share:.1f} %)"
    text += f", the longest {lost.max():.2f} s" if len(lost) > 1 else ""
    verdict, first = "fault" if share > 20.0 else "warning", float(begin[~paused][0])
    seen = [rest] if paused.any() else []
    about = "stopped" if float(lost.max()) > LONG_S else ""
    return Check(
        "gaps", verdict, text + ".", len(lost), "", limit, t=first, count=len(lost), about=about, evidence=seen
    )


def pauses(t0: float, t1: float, log: FlightLog) -> bool:
    """Whether a gap from ``t0`` to ``t1`` s lies where the vehicle was disarmed; where nothing tells, a long one."""
    if log.armed is None or not log.armed.value:
        return t1 - t0 > LONG_S
    armed = sum(b - a for a, b in held(log.armed, True, t0, t1))
    return t1 - t0 > PAUSE_S and armed < ARMED_SHARE * (t1 - t0) + ARMED_S


def jitter_check(dt: np.ndarray) -> Check:
    """How even are the sample times?"""
    jitter = 100.0 * float(dt.std() / np.median(dt)) if np.median(dt) > 0 else float("inf")
    text = f"Intervals {np.median(dt) * 1e3:.2f} ms, standard deviation {jitter:.1f} %."
    return Check("jitter", graded(jitter, 15.0, 60.0), text, round(jitter, 2), "%", "ok up to 15 %, fault above 60 %")
