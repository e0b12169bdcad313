"""Rate, gaps and jitter of the inertial data."""

from __future__ import annotations

import numpy as np

from attlog.flight.clock.timing import gaps
from attlog.flight.inertial import LOW_RATE_HZ, REPLAY_MIN_HZ, fast_enough
from attlog.flight.model import Array, FlightLog
from attlog.health.model import Check, graded
from attlog.segments.flags import held
from attlog.segments.model import Segments

PAUSE_S, LONG_S, NEAR_S = 2.0, 5.0, 1.0
"""A shorter gap is lost records; where nothing tells of arming, a longer one is none."""
ARMED_S, ARMED_SHARE = 1.0, 0.1
"""A pause begins up to so long after disarming, and ends with arming."""
FEW, FEW_PCT, MANY_PCT = 3, 1.0, 20.0
"""So few gaps change nothing that is measured; a fifth of the time lost changes all."""
GAP_LIMIT = (
    f"ok: fewer than {FEW} above 50 ms while armed, and {FEW_PCT:.0f} % of the time; fault: above {MANY_PCT:.0f} %"
)
FULL_HZ = 95.0
"""Above this the rotation between samples is small enough for every estimator."""


def checks(log: FlightLog, segments: Segments) -> list[Check]:
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
    thinned = any(p.code == "imu_decimated" and p.text.startswith(f"{imu.gyro.source}:") for p in log.problems)
    even = [] if thinned else [jitter_check(steady)]  # a logger that drops most samples is told already
    return [rate_check(imu.gyro.source, imu.gyro.rate), gap_check(t, breaks, log, segments), *even]


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


def gap_check(t: np.ndarray, breaks: np.ndarray, log: FlightLog, segments: Segments) -> Check:
    """Are samples missing? ``breaks`` are the samples before the gaps of ``t`` (n,) s.

    A gap from disarming to arming is the logger, which rests while the vehicle does; so is a long one on the ground.
    """
    if len(breaks) == 0:
        return Check("gaps", "ok", "No gap in the inertial data.", 0.0, "s", GAP_LIMIT)
    begin, end = t[breaks], t[breaks + 1]
    paused = np.array([pauses(a, b, log, segments) for a, b in zip(begin.tolist(), end.tolist(), strict=True)])
    rest = f"The logger paused {'once' if paused.sum() == 1 else f'{paused.sum()} times'} on the ground, "
    rest += f"{float((end - begin)[paused].sum()):.0f} s in all."
    if paused.all():
        return Check("gaps", "ok", rest, 0.0, "s", GAP_LIMIT)
    lost = (end - begin)[~paused]
    total = float(lost.sum())
    share = 100.0 * total / float(t[-1] - t[0])
    text = f"{len(lost)} gap{'s' if len(lost) > 1 else ''} in the inertial data, {total:.2f} s in all ({share:.1f} %)"
    text += f", of {np.median(lost):.2f} s (median), the longest {lost.max():.2f} s" if len(lost) > 1 else ""
    few = len(lost) < FEW and share < FEW_PCT
    verdict = "ok" if few else "fault" if share > MANY_PCT else "warning"
    seen = [rest] if paused.any() else []
    others = logged_in_gaps(log, begin[~paused], end[~paused])
    if others:
        seen.append(f"{log.onboard} goes on in {others} of them.")
    cause = "The IMU, its driver or the rate of its messages: others go on in the gaps." if others else ""
    about = "stopped" if float(lost.max()) > LONG_S and not others else ""
    first = float(begin[~paused][0])
    return Check(
        "gaps",
        verdict,
        text + ".",
        round(total, 2),
        "s",
        GAP_LIMIT,
        t=first,
        count=len(lost),
        about=about,
        evidence=seen,
        cause=cause,
    )


def logged_in_gaps(log: FlightLog, start: Array, end: Array) -> int:
    """In how many gaps the attitude that flew was logged all the same: then not the card lost what is missing."""
    onboard = log.onboard_attitude
    if onboard is None or onboard.rate <= 0:
        return 0
    there = np.searchsorted(onboard.t, end) - np.searchsorted(onboard.t, start)
    return int(np.count_nonzero(there >= np.maximum(2.0, 0.5 * onboard.rate * (end - start))))


def pauses(t0: float, t1: float, log: FlightLog, segments: Segments) -> bool:
    """Whether a gap from ``t0`` to ``t1`` s lies where the vehicle was disarmed; where nothing tells, a long one.

    The record of disarming is often lost with the others: a long gap that no flight goes into or comes out of counts.
    """
    if log.armed is None or not log.armed.value:
        return t1 - t0 > LONG_S
    flown = any(a < t1 + NEAR_S and t0 - NEAR_S < b for a, b in segments.spans("airborne"))
    if t1 - t0 > LONG_S and "airborne" not in segments.unknown and not flown:
        return True
    armed = sum(b - a for a, b in held(log.armed, True, t0, t1))
    return t1 - t0 > PAUSE_S and armed < ARMED_SHARE * (t1 - t0) + ARMED_S


def jitter_check(dt: np.ndarray) -> Check:
    """How even are the sample times?"""
    jitter = 100.0 * float(dt.std() / np.median(dt)) if np.median(dt) > 0 else float("inf")
    text = f"Intervals {np.median(dt) * 1e3:.2f} ms, standard deviation {jitter:.1f} %."
    return Check("jitter", graded(jitter, 15.0, 60.0), text, round(jitter, 2), "%", "ok up to 15 %, fault above 60 %")
