"""Vibration in the accelerometer: how strong, since when, and whether the sensor makes a constant force of it."""

from __future__ import annotations

from bisect import insort

import numpy as np
from numpy.typing import NDArray

from attlog.base import rotation
from attlog.flight.model import FlightLog, Imu, Stream
from attlog.flight.vibration.model import LIMITS
from attlog.health.model import Check, not_judged
from attlog.health.sensors.accelerometer import of_imu
from attlog.segments.airborne.heights import height
from attlog.segments.model import Segments
from attlog.segments.spans import Span, inside
from attlog.segments.vibration import levels

Array = NDArray[np.float64]

STRONG_M_S2, VERY_STRONG_M_S2 = 3.0, 15.0
"""Of the logged, mostly low-passed accelerometer: measured on the logs in hand (docs/flight.md)."""
ONBOARD_M_S2 = (LIMITS["rest"].warning, LIMITS["rest"].fault)
"""Of the autopilot's own level at full rate."""
LEAST_S = 10
GROWN, BEFORE_S, AFTER_S = 3.0, 20, 10
"""Onset: the median of the next 10 s is three times the median of all flight before, at least 20 s."""
MORE_POWER = 1.3
"""Vibration that comes with so much more throttle is none that something broke."""
TIMES_OWN = 5.0
"""Where the autopilot's own level is so much higher, the logger's rate is too low to show what vibrates."""
FORCE_S, CHANGED_M_S2, WRONG_M_S2 = 10.0, 0.7, 1.5
"""Mean vertical force over 10 s: what it may change by without a change of vertical speed that explains it."""


def checks(log: FlightLog, segments: Segments) -> list[Check]:
    """Level of vibration in flight, and the mean vertical force against the barometer."""
    imu = log.replay_imu
    if imu is None:
        return []
    flown = segments.spans("airborne")
    return [level(log, imu, flown), vertical_force(log, imu, flown)]


def level(log: FlightLog, imu: Imu, flown: list[Span]) -> Check:
    """The typical level in flight, and the time from which it had grown to several times what it was."""
    limit = f"ok up to {STRONG_M_S2:.0f} m/s^2 and steady, fault above {VERY_STRONG_M_S2:.0f}; onboard level 30 and 60"
    t, x = levels(imu, flown)
    if len(t) < LEAST_S:
        return not_judged("vibration", "Too little flight to measure vibration in.", limit)
    axis = int(np.argmax(np.median(x, axis=0)))
    strongest = x.max(axis=1)
    typical = float(np.median(strongest))
    shown, unit, since = typical, "m/s^2", onset(strongest)
    since = None if since is None or more_power(log.throttle, t, since) else since
    text = f"In flight the accelerometer vibrates by {typical:.1f} m/s^2 (1 sigma, {'xyz'[axis]} most)."
    verdict = "fault" if typical > VERY_STRONG_M_S2 else "warning" if typical > STRONG_M_S2 else "ok"
    own = onboard_level(log.onboard_vibration, flown)
    seen: list[str] = []
    if own is not None and own <= ONBOARD_M_S2[0]:
        verdict = "ok" if verdict == "warning" else verdict  # the logged samples fold and hold motion
    elif own is not None:
        verdict = "fault" if own > ONBOARD_M_S2[1] or verdict == "fault" else "warning"
        seen = [text]
        text = f"The autopilot measured vibration of {own:.0f} m/s^2 or more in 5 % of the flight."
        if own > TIMES_OWN * typical:
            seen.append(f"The logged {imu.acc.rate:.0f} Hz show little of it.")
    if since is None:
        return Check("vibration", verdict, text, round(shown, 2), unit, limit, evidence=seen)
    later = x[since:]
    axis = int(np.argmax(np.median(later, axis=0)))
    before, after = float(np.median(x[:since, axis])), float(np.median(later[:, axis]))
    peak = np.quantile(later[:, axis], 0.95)
    text = (
        f"From {t[since]:.0f} s on the accelerometer's {'xyz'[axis]} vibrates by {after:.1f} m/s^2 instead of "
        f"{before:.1f}."
    )
    seen.append(f"95 % of the seconds from then on stay below {peak:.1f} m/s^2.")
    verdict = "fault" if after > STRONG_M_S2 else "warning"
    return Check("vibration", verdict, text, round(after, 2), unit, limit, t=float(t[since]), evidence=seen)


def onset(level_: Array) -> int | None:
    """Index of the window (m,) from which vibration has grown for good, None where it has not."""
    if len(level_) < BEFORE_S + AFTER_S:
        return None
    k = np.arange(BEFORE_S, len(level_) - AFTER_S + 1)
    before, rest = medians(level_)[k - 1], medians(level_[::-1])[::-1][k]
    after = np.median(np.lib.stride_tricks.sliding_window_view(level_, AFTER_S), axis=1)[k]
    grown = (np.minimum(after, rest) > np.maximum(GROWN * before, 1.0)) & (level_[k] > 0.5 * GROWN * before)
    return int(k[np.argmax(grown)]) if grown.any() else None


def medians(x: Array) -> Array:
    """The median (n,) of the first 1, 2, ... n of finite numbers (n,): each is sorted in, not all anew."""
    ordered: list[float] = []
    out = np.empty(len(x))
    for n, value in enumerate(x.tolist()):
        insort(ordered, value)
        out[n] = 0.5 * (ordered[n // 2] + ordered[(n + 1) // 2])
    return out


def more_power(throttle: Stream | None, t: Array, since: int) -> bool:
    """Whether the throttle is higher as vibration begins than before, with windows at ``t`` (m,) s."""
    if throttle is None or len(throttle.t) < 2:
        return False
    x = np.interp(t, throttle.t, np.nan_to_num(throttle.x[:, 0]))
    return float(np.median(x[since : since + 3])) > MORE_POWER * float(np.median(x[:since]))


def onboard_level(own: Stream | None, flown: list[Span]) -> float | None:
    """The level that the autopilot's own measure of the worst axis exceeds for 5 % of the flight; None without."""
    if own is None:
        return None
    x = own.x[inside(own.t, flown)].max(axis=1, initial=0.0)
    return np.quantile(x, 0.95) if len(x) >= 10 else None


def vertical_force(log: FlightLog, imu: Imu, flown: list[Span]) -> Check:
    """Whether the mean vertical force changes in flight without a climb that explains it (vibration rectification)."""
    limit = f"ok up to {CHANGED_M_S2} m/s^2 over {FORCE_S:.0f} s, fault above {WRONG_M_S2}"
    above, onboard = height(log), log.onboard_attitude
    if above is None or onboard is None or onboard.rate < 5.0:
        return not_judged("vertical force", "No barometer or no attitude to compare the vertical force with.", limit)
    found = [w for span in flown for w in _windows(span, imu, above)]
    if len(found) < 2:
        return not_judged("vertical force", f"Less than {2 * FORCE_S:.0f} s of unbroken flight.", limit)
    q = of_imu(log, onboard)
    force = np.array([_force(imu, onboard.t, q, w) for w in found])
    by_height = np.array([_acceleration(above, w) for w in found])
    good = np.isfinite(force) & np.isfinite(by_height)
    if good.sum() < 2:
        return not_judged("vertical force", "No barometer or no attitude to compare the vertical force with.", limit)
    force, by_height = force[good], by_height[good]
    times = np.array([w[0] for w in found])[good]
    unexplained = force - by_height - (force[0] - by_height[0])
    worst = int(np.argmax(np.abs(unexplained)))
    size = float(abs(unexplained[worst]))
    verdict = "ok" if size <= CHANGED_M_S2 else "warning" if size <= WRONG_M_S2 else "fault"
    text = f"The mean vertical force over {FORCE_S:.0f} s stays within {size:.2f} m/s^2 of what the height explains."
    if verdict == "ok":
        return Check("vertical force", verdict, text, round(size, 2), "m/s^2", limit)
    since = int(np.argmax(np.abs(unexplained) > CHANGED_M_S2))
    first = f"{times[since]:.0f} to {times[since] + FORCE_S:.0f} s"
    text = f"The mean vertical force is up to {size:.1f} m/s^2 off what the height shows, first from {first}."
    seen = [
        f"At {times[worst]:.0f} s it is {force[worst]:.2f} m/s^2 after {force[0]:.2f} at first, while the height shows "
        f"an acceleration of {by_height[worst]:+.1f} m/s^2."
    ]
    return Check("vertical force", verdict, text, round(size, 2), "m/s^2", limit, t=float(times[since]), evidence=seen)


def _windows(span: Span, imu: Imu, above: Stream) -> list[Span]:
    """Unbroken windows of 10 s in a span, 2 s after its start and before its end (landing is a blow)."""
    t = imu.acc.t_best
    found = []
    start = span[0] + 2.0
    while start + FORCE_S <= span[1] - 2.0:
        i, j = np.searchsorted(t, [start, start + FORCE_S])
        a, b = np.searchsorted(above.t, [start, start + FORCE_S])
        if j - i > 10 and b - a > 10 and np.diff(t[i:j]).max() < 0.5 and np.diff(above.t[a:b]).max() < 1.0:
            found.append((start, start + FORCE_S))
        start += FORCE_S
    return found


def _force(imu: Imu, t: Array, q: Array, window: Span) -> float:
    """Mean upward specific force in m/s^2 over a window, NaN where the attitude does not cover it."""
    at = imu.acc.t_best
    i, j = np.searchsorted(at, window)
    turned = rotation.slerp(t, q, at[i:j])
    known = rotation.finite(turned)
    if known.sum() < 0.9 * (j - i):
        return float("nan")
    return float(-rotation.rotate(turned[known], imu.acc.x[i:j][known])[:, 2].mean())


def _acceleration(above: Stream, window: Span) -> float:
    """Mean upward acceleration in m/s^2 over a window: the change of the climb rate between its ends."""
    rates = []
    for at in window:
        i, j = np.searchsorted(above.t, [at - 1.5, at + 1.5])
        t, x = above.t[i:j], above.x[i:j, 0]
        good = np.isfinite(x)
        if good.sum() < 4 or np.ptp(t[good]) < 1.0:
            return float("nan")
        rates.append(float(np.polyfit(t[good] - at, x[good], 1)[0]))
    return (rates[1] - rates[0]) / (window[1] - window[0])
