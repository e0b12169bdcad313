"""Delays of IMU, GNSS and compass by fits to an attitude, and their parameters.

GNSS: with attitude R, force f and gravity g the velocity is the integral V of ``R f + g``. Between fixes 2 s apart it
changes by ``V(t_j - tau) - V(t_i - tau)``, linear in a change of the delay tau, a turn of the attitude about the
vertical and a constant force. Compass: the field is ``R(t - tau)' h``, linear in tau, a turn, a scale and an offset.
Gauss-Newton with Huber weights; standard errors are clustered by 5 s (:mod:`attlog.health.regression`).
"""

from __future__ import annotations

import math
from collections.abc import Callable
from functools import partial
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from attlog.core import rotation
from attlog.core.spans import Span, inside
from attlog.flight import aiding
from attlog.flight.aiding import DelayParameter
from attlog.flight.model import FIX_3D, Array, Gnss, Imu
from attlog.health.check import Check, HealthCase, Limits, Setting, graded
from attlog.health.flown import driven_spans
from attlog.health.regression import RobustFit, interval_text, robust_fit
from attlog.health.sources import names_text
from attlog.reference import alignment
from attlog.reference.model import Reference

# Time between differenced velocities, and its tolerance.
VELOCITY_SPAN_S, SPAN_TOLERANCE_S = 2.0, 0.7
# Maximum interval between IMU samples for integration of the force.
MAX_STEP_S = 0.1
# Minimum samples for a fit of delay and turn in both halves; maximum plausible delay.
MIN_DELAY_SAMPLES, MAX_DELAY_S = 30, 0.6
# Gauss-Newton iterations, and convergence limit: a tenth of the resolution of parameters.
PASSES, CONVERGED_S = 8, 5e-4
# Half the step of the numerical derivatives.
SLOPE_S = 0.02
# Empirical factor on clustered standard errors.
STANDARD_ERRORS = 1.5


class AttitudePath(NamedTuple):
    """Attitudes ``q`` (n, 4) of the replayed IMU at ``t`` (n,) s; ``segment`` (n,) numbers the parts between gaps."""

    t: Array
    q: Array
    segment: NDArray[np.int64] | None
    name: str


class DelayFit(NamedTuple):
    """Delay and standard error in s; ``halves``: delays in both halves of the flight.

    ``turn_deg``: fitted rotation of the attitude about the vertical. ``moving``: RMS of the excitation, m/s^2 or uT/s.
    ``n`` samples in ``seconds``.
    """

    delay: float
    sigma: float
    halves: tuple[float, float]
    turn_deg: float
    moving: float
    n: int
    seconds: float


# Linearised equations at a delay in s: times (n,), columns (n, k, p) (delay, turn, others), residuals (n, k).
Equations = Callable[[float], tuple[Array, Array, Array]]


def fit_gnss_delay(imu: Imu, receiver: Gnss, path: AttitudePath, flown: list[Span], guess: float) -> DelayFit | None:
    """Fit the delay of GNSS velocities before their receipt; None from too few."""
    s, velocity, broken = _force_integral(imu, path, flown)
    t = receiver.t if receiver.received is None else receiver.received
    fixed = (receiver.fix >= FIX_3D) & np.isfinite(receiver.vel_ned[:, :2]).all(axis=1) & np.isfinite(t)
    t, v = t[fixed], receiver.vel_ned[fixed, :2]
    rising = np.flatnonzero(np.diff(t, prepend=-np.inf) > 0.0)
    t, v = t[rising], v[rising]
    if len(t) < MIN_DELAY_SAMPLES or len(s) < MIN_DELAY_SAMPLES:
        return None
    i = np.arange(len(t))
    j = np.searchsorted(t, t + VELOCITY_SPAN_S)
    i, j = i[j < len(t)], j[j < len(t)]
    use = (np.abs(t[j] - t[i] - VELOCITY_SPAN_S) < SPAN_TOLERANCE_S) & inside(t[i], flown) & inside(t[j], flown)
    i, j = i[use], j[use]

    def at(when: Array) -> Array:
        return np.column_stack([np.interp(when, s, velocity[:, k]) for k in range(2)])

    def slope(when: Array) -> Array:
        return np.asarray((at(when + SLOPE_S) - at(when - SLOPE_S)) / (2.0 * SLOPE_S))

    def equations(tau: float) -> tuple[Array, Array, Array]:
        a, b = t[i] - tau, t[j] - tau
        whole: NDArray[np.bool_] = (a - SLOPE_S > s[0]) & (b + SLOPE_S < s[-1])
        first, last = np.searchsorted(s, a - SLOPE_S, side="right"), np.searchsorted(s, b + SLOPE_S)
        whole &= broken[np.minimum(last, len(s) - 1)] == broken[np.maximum(first - 1, 0)]
        a, b = a[whole], b[whole]
        change, apart = at(b) - at(a), (b - a)
        columns = np.zeros((len(a), 2, 4))
        columns[:, :, 0] = slope(a) - slope(b)
        columns[:, 0, 1], columns[:, 1, 1] = -change[:, 1], change[:, 0]
        columns[:, 0, 2], columns[:, 1, 3] = apart, apart
        return t[i][whole], columns, v[j][whole] - v[i][whole] - change

    return _gauss_newton(equations, guess)


def fit_compass_delay(t: Array, field: Array, earth: Array, path: AttitudePath) -> DelayFit | None:
    """Fit the delay of a field (n, 3) uT at ``t`` (n,) s; ``earth`` (3,) uT NED. None from too few."""
    across = np.array([-earth[1], earth[0], 0.0])

    def expected(when: Array, what: Array) -> Array:
        q, _ = rotation.slerp_in_segments(path.t, path.q, path.segment, when)
        return rotation.rotate_inverse(q, np.broadcast_to(what, (len(when), 3)))

    def equations(tau: float) -> tuple[Array, Array, Array]:
        when = t - tau
        u = expected(when, earth)
        slope = (expected(when + SLOPE_S, earth) - expected(when - SLOPE_S, earth)) / (2.0 * SLOPE_S)
        columns = np.zeros((len(t), 3, 6))
        columns[:, :, 0], columns[:, :, 1], columns[:, :, 2] = -slope, expected(when, across), u
        columns[:, :, 3:] = np.eye(3)
        known = np.isfinite(u + slope + field).all(axis=1)
        return t[known], columns[known], (field - u)[known]

    return _gauss_newton(equations, 0.0)


def _force_integral(imu: Imu, path: AttitudePath, flown: list[Span]) -> tuple[Array, Array, Array]:
    """Return times (n,) s, integral of the force (n, 2) m/s north-east, and gap counts."""
    begin, end = (flown[0][0] - 2.0, flown[-1][1] + 2.0) if flown else (0.0, -1.0)
    stamps = imu.acc.t_best
    use = np.flatnonzero((stamps >= begin) & (stamps <= end))
    s = stamps[use] - imu.acc.delay
    q, _ = rotation.slerp_in_segments(path.t, path.q, path.segment, s)
    force = rotation.rotate(q, imu.acc.x[use])[:, :2]
    known: NDArray[np.bool_] = rotation.finite_rows(force)
    force = np.where(known[:, None], force, 0.0)
    dt = np.diff(s, prepend=s[:1])
    mean = force if imu.acc.sampling == "interval" else 0.5 * (force + np.vstack([force[:1], force[:-1]]))
    broken = ~known | (dt > MAX_STEP_S) | (dt < 0.0)
    return s, np.cumsum(mean * dt[:, None], axis=0), np.cumsum(broken).astype(np.float64)


def _gauss_newton(equations: Equations, guess: float) -> DelayFit | None:
    """Return the converged Gauss-Newton fit; None without convergence."""
    before = guess
    for _ in range(PASSES):
        t, columns, rest = equations(before)
        solution = _fit_delay(t, columns, rest)
        if solution is None:
            return None
        found: RobustFit = solution
        tau = before + float(found.x[0])
        if abs(tau) > MAX_DELAY_S:
            return None
        if abs(tau - before) < CONVERGED_S:
            break
        before = tau
    half = len(t) // 2
    parts = [_fit_delay(t[k], columns[k], rest[k]) for k in (slice(None, half), slice(half, None))]
    one, two = (np.nan if part is None else before + float(part.x[0]) for part in parts)
    moving = float(np.sqrt(np.mean(np.sum(columns[:, :, 0] ** 2, axis=1))))
    turn = float(np.degrees(found.x[1]))
    seconds = float(np.minimum(np.diff(t), VELOCITY_SPAN_S).sum())
    return DelayFit(tau, float(found.sigma[0]), (one, two), turn, moving, len(t), seconds)


def _fit_delay(t: Array, columns: Array, rest: Array) -> RobustFit | None:
    return robust_fit(t, columns, rest) if len(t) >= MIN_DELAY_SAMPLES else None


# Maximum sigmas of a smoother from motion alone: of heading, and of tilt where the heading is fitted.
SURE_HEADING_DEG, SURE_TILT_DEG = 5.0, 1.0


def attitude_path(case: HealthCase) -> AttitudePath | None:
    """Return the most accurate attitude to fit delays; None if none is accurate enough.

    Motion alone with known heading, else truth or a smoother with its own heading, else motion alone with a heading
    that is corrected by the fits.
    """
    motion, reference = case.motion, case.reference
    by_motion = None if motion is None else AttitudePath(motion.t, motion.q, motion.segment, "motion alone")
    if motion is not None and _at_most(motion.quality, "sigma_heading_deg", SURE_HEADING_DEG):
        return by_motion
    if reference is not None and reference.kind in ("truth", "smoother") and reference.heading.by == "own":
        return AttitudePath(reference.t, reference.q, reference.gap_segment, f"the {reference.kind}")
    if motion is not None and _at_most(motion.quality, "sigma_tilt_deg", SURE_TILT_DEG):
        return by_motion
    return None


def _at_most(quality: dict[str, float | str], name: str, limit: float) -> bool:
    value = quality.get(name)
    return isinstance(value, float) and value <= limit


def reason_no_path(case: HealthCase) -> str:
    """Return why no attitude is accurate enough to fit delays, with advice."""
    if case.log.replay_imu is None:
        return f"No IMU of this log can be replayed. {case.log.advice('imu')}".strip()
    return "No attitude of this log is sure enough to measure delays by; fly longer with GNSS, faster and slower."


# Delay of the logged gyro: by its filter's parameter, and by its rates.

# Maximum delay of low-pass filters of 40 Hz and more; slower ones cost phase margin.
SHORT_DELAY_MS = 6.0
# Limits of the measured minus the filter's delay: where the filter is logged, where it is not (sensor filter of 20 Hz),
# and beyond which the clock or the sampling convention is wrong.
AGREES_MS, HIDDEN_MS, WRONG_CLOCK_MS = 4.0, 10.0, 20.0
# Significance, and error of the reference's clock.
IMU_SIGMAS, IMU_FLOOR_MS = 4.0, 0.5
FILTER_LIMIT = f"ok up to {SHORT_DELAY_MS:.0f} ms"
IMU_LIMIT = (
    f"ok within {AGREES_MS:.0f} ms ({HIDDEN_MS:.0f} where the log names no filter) of its filter's, "
    f"or {IMU_SIGMAS:.0f} sigma; fault beyond {WRONG_CLOCK_MS:.0f} ms"
)


def imu_delay_checks(case: HealthCase) -> list[Check]:
    """Check the gyro's delay by its logged filter and against the reference's rates."""
    log = case.log
    if not log.imus:
        return []
    imu = log.imus[log.imu or 0]
    return [_filter_delay(imu), _rate_delay(imu, None if log.imu is None else case.rates)]


def _filter_delay(imu: Imu) -> Check:
    source, late = imu.gyro.source, 1e3 * imu.gyro.delay
    made = partial(Check, "filter_delay", threshold=FILTER_LIMIT, sensor=source)
    if late > 0:
        text = f"{source} is late by {late:.1f} ms ({imu.filtered})."
        return made(graded(late, SHORT_DELAY_MS, math.inf), text, value=round(late, 2), unit="ms")
    if imu.filtered not in ("unknown", "driver"):
        return made("ok", f"{source} is logged without a low-pass filter.", value=0.0, unit="ms")
    return made("unknown", f"{source}: the log does not show how it was filtered.")


def _rate_delay(imu: Imu, reference: Reference | None) -> Check:
    source, by_filter = imu.gyro.source, 1e3 * imu.gyro.delay
    made = partial(Check, "imu_delay", threshold=IMU_LIMIT, sensor=source)
    seen = None if reference is None else alignment.gyro_delay(imu, reference)
    if reference is None or seen is None:
        return made("unknown", "The vehicle turns too little to show a delay.")
    late, sigma = 1e3 * seen[0], math.hypot(STANDARD_ERRORS * 1e3 * seen[1], IMU_FLOOR_MS)
    made = partial(made, value=round(late, 2), unit="ms")
    off = late - by_filter
    known = f"its filter's {by_filter:.1f} ms" if by_filter > 0 else "no filter"
    agrees = HIDDEN_MS if imu.filtered in ("unknown", "driver") else AGREES_MS
    if -AGREES_MS <= off <= agrees or abs(off) <= IMU_SIGMAS * sigma:
        return made("ok", f"Against {reference.source} the rates of {source} are late by {late:.1f} ms: {known}.")
    if off < 0 and reference.kind == "onboard":
        text = f"{reference.source} comes {-off:.1f} ms later than {source}: the attitude, not the IMU, is late."
        return made("ok", text)
    text = f"{source} comes {abs(off):.1f} ms {'later' if off > 0 else 'earlier'} "
    text += f"({interval_text(abs(off), sigma, 1)}, 95 %) against "
    text += f"{reference.source} than {known} makes it: {late:.1f} ms in all."
    why = "No parameter moves the inertial samples: look at their filter and at the logger."
    return made("fault" if abs(off) > WRONG_CLOCK_MS else "warning", text, why_no_setting=why)


# Delay of an aid against the onboard estimator's parameter.


# Significance of a delay.
SIGMAS = 3.0
# Resolution of proposed parameters, the accuracy of a delay.
ROUND_MS = 5.0
# Wrong beyond this and 3 sigma. On 24 simulated flights fits and smoothers are within 18 ms of the true GNSS delay,
# with a standard deviation of 8 ms; compass delays scatter by 5 ms (44 to 53, and -2 to 2 ms).
OFF_MS = 20.0
# A single flight offers a value with an interval below +-20 ms and a difference from 40 ms on: five flights of one
# vehicle scatter by 20 ms about the value that is right. Two flights of one log that agree need the interval alone.
OFFER_CI_MS, OFFER_MS = 20.0, 40.0
DELAY_TEXT = f"ok within {OFF_MS:.0f} ms or {SIGMAS:.0f} sigma of what is set"
GNSS = Limits("gnss_delay", "ms", OFF_MS, math.inf, DELAY_TEXT, "planted delays on 24 simulated flights", 8.0)
COMPASS = Limits("magnetometer_delay", "ms", OFF_MS, math.inf, DELAY_TEXT, "24 simulated flights", 5.0)


def delay_check(
    limits: Limits,
    sensor: str,
    late: float,
    sigma: float,
    parameter: DelayParameter | str,
    buffer: DelayParameter | None = None,
    flights: int = 1,
) -> Check:
    """Check a delay in ms against its parameter, and offer a value if it is wrong.

    ``parameter``: text where unknown. ``buffer``: parameter of the estimator's maximum delay. ``flights``: number of
    flights that agree.
    """
    text = f"{sensor} is {late:.0f} ms late ({late - 1.96 * sigma:.0f} to {late + 1.96 * sigma:.0f}, 95 %)"
    check = Check(limits.question, "ok", f"{text}.", unit="ms", threshold=limits.text, sensor=sensor)
    check.source = limits.source
    check.measure(late, sigma, 1)
    if isinstance(parameter, str):
        check.verdict, check.why_no_setting = "unknown", parameter
        return check
    check.text = f"{text}; {parameter.words}."
    off = max(parameter.low - late, late - parameter.high, 0.0)
    if off <= max(limits.ok, SIGMAS * sigma):
        if off > limits.ok:
            fly = "accelerate and brake more" if limits is GNSS else "turn more"
            check.evidence.append(f"A difference of {off:.0f} ms is within {SIGMAS:.0f} sigma: {fly}.")
        if limits is GNSS and parameter.low < parameter.high:
            check.verdict = "unknown"
            check.why_no_setting = "The log does not name the receiver's hardware: log from boot on."
        return check
    new = ROUND_MS * round(late / ROUND_MS)
    if 1.96 * sigma >= OFFER_CI_MS or (off < OFFER_MS and flights < 2):
        check.verdict, who = "unknown", "One flight shows" if flights < 2 else f"{flights} flights show"
        check.why_no_setting = f"{who} a difference of {off:.0f} ms, ± {1.96 * sigma:.0f}: no value."
        check.action = "Compare the delays of two more flights with hard braking and turns."
        return check
    check.verdict = "warning"
    if not 0.0 < new <= parameter.most:
        check.why_no_setting = "No parameter holds this delay of a compass."
        if limits is GNSS:
            delays_it = "look for what delays the receiver"
            check.why_no_setting = f"{parameter.name} ends at {parameter.most:.0f} ms: {delays_it}."
        return check
    check.settings = [Setting(parameter.name, parameter.old, new, "ms")]
    if buffer is not None and new > buffer.old:
        check.settings.append(Setting(buffer.name, buffer.old, new, "ms"))
    check.action = f"Set {parameter.name} to {new:.0f} ms, reboot, and compare test ratios of the next flight."
    return check


# GNSS. Nearly independent estimates are averaged: the fit of velocities, and the likelihood of the smoother without and
# with compass. Half their range is added to the error.

# Minimum change of the horizontal force (RMS), and minimum flight time.
MIN_FORCE_CHANGE_M_S2, MIN_GNSS_S = 0.4, 15.0
# Maximum difference between estimates.
GNSS_APART_MS = 40.0
# Maximum fitted heading rotation; the linearisation is invalid above.
MAX_TURN_DEG = 10.0
# A larger sigma is too large to report a delay.
GNSS_SURE_MS = 30.0


def gnss_delays(case: HealthCase) -> list[Check]:
    """Check the delay of each receiver that had fixes in flight."""
    flown = driven_spans(case)
    receivers = [g for g in case.log.gnss if (g.fix >= FIX_3D).sum() > MIN_DELAY_SAMPLES]
    if not flown or not receivers:
        return []
    path = None if case.log.replay_imu is None else attitude_path(case)
    return [_gnss_delay(case, one, path, flown) for one in receivers]


def _gnss_delay(case: HealthCase, receiver: Gnss, path: AttitudePath | None, flown: list[Span]) -> Check:
    imu = case.log.replay_imu
    made = partial(Check, GNSS.question, sensor=receiver.source, threshold=GNSS.text, source=GNSS.source)
    if imu is None or path is None:
        return made("unknown", reason_no_path(case))
    smoothed = _smoother_delays(case, receiver)
    found = fit_gnss_delay(imu, receiver, path, flown, 1e-3 * smoothed[0] if smoothed else 0.1)
    if found is None:
        return made("unknown", "Too few GNSS velocities in flight to find their delay.")
    if why := gnss_reason_unsure(found, smoothed):
        return made("unknown", why)
    own, single = 1e3 * found.delay, _delays_by_flight(imu, receiver, path, flown, found.delay)
    every = [own, *smoothed]
    apart = 0.5 * max(max(x) - min(x) for x in (every, single or [own]))
    # The logged IMU's filters make the attitude late, and the receiver seem earlier.
    hidden = HIDDEN_MS if imu.filtered == "unknown" else 1e3 * imu.gyro.delay
    sigma = math.sqrt((STANDARD_ERRORS * 1e3 * found.sigma) ** 2 + GNSS.floor**2 + apart**2 + hidden**2)
    begin = flown[0][0]
    parameter, buffer = aiding.gnss_delay_parameter(case.log, receiver, begin), aiding.buffer(case.log, begin)
    check = delay_check(GNSS, receiver.source, sum(every) / len(every), sigma, parameter, buffer, len(single))
    check.n, check.seconds = found.n, round(found.seconds, 1)
    evidence = [f"By {path.name} the velocities are {own:.0f} ms late in {found.seconds:.0f} s of flight."]
    if len(single) > 1:
        evidence.append(f"Single flights show {names_text([f'{x:.0f}' for x in single])} ms.")
    if smoothed:
        evidence.append(f"The likelihood of the smoother finds {' and '.join(f'{x:.0f} ms' for x in smoothed)}.")
    check.evidence = [*evidence, *check.evidence]
    return check


def _delays_by_flight(imu: Imu, receiver: Gnss, path: AttitudePath, flown: list[Span], guess: float) -> list[float]:
    """Return the GNSS delays in ms of the single flights of a log that show one; empty for one flight."""
    if len(flown) < 2:
        return []
    found = [fit_gnss_delay(imu, receiver, path, [one], guess) for one in flown]
    return [1e3 * one.delay for one in found if one is not None and not gnss_reason_unsure(one, [])]


def _smoother_delays(case: HealthCase, receiver: Gnss) -> list[float]:
    """Return GNSS delays in ms by smoothers without and with compass.

    The time from receipt to the log record is subtracted. Empty for a receiver that the smoother does not use.
    """
    if receiver is not next((g for g in case.log.gnss if (g.fix >= FIX_3D).sum() > 1), None):
        return []
    qualities = [] if case.motion is None else [case.motion.quality]
    if case.reference is not None and case.reference.kind == "smoother":
        qualities.append(case.reference.quality)
    found = [quality.get("gnss_delay_ms") for quality in qualities]
    between = np.zeros(1) if receiver.received is None else np.sort(receiver.t - receiver.received)
    return [late - 1e3 * float(between[len(between) // 2]) for late in found if isinstance(late, float)]


def gnss_reason_unsure(found: DelayFit, smoothed: list[float]) -> str:
    """Return why a fit is no estimate of the delay; empty where it is."""
    if found.seconds < MIN_GNSS_S:
        return f"{found.seconds:.0f} s of flight with GNSS velocities; {MIN_GNSS_S:.0f} s are needed for their delay."
    if found.moving < MIN_FORCE_CHANGE_M_S2:
        return f"The force changes by {found.moving:.2f} m/s^2 only; accelerate and brake to show the delay of GNSS."
    sigma_ms = STANDARD_ERRORS * 1e3 * found.sigma
    if sigma_ms > GNSS_SURE_MS:
        return f"The delay of GNSS is known to {sigma_ms:.0f} ms only; accelerate and brake more."
    if abs(found.turn_deg) > MAX_TURN_DEG:
        off = f"{abs(found.turn_deg):.0f} deg off GNSS velocities"
        return f"The attitude's heading is {off}: no delay can be determined."
    if any(abs(1e3 * found.delay - late) > GNSS_APART_MS for late in smoothed):
        shown = names_text([f"{x:.0f}" for x in (1e3 * found.delay, *smoothed)])
        return f"Estimates of the GNSS delay differ: {shown} ms."
    one, two = found.halves
    if not abs(one - two) <= max(3.0 * math.sqrt(8.0) * found.sigma, 1e-3 * GNSS_APART_MS):
        return f"The halves of the flight show different GNSS delays: {1e3 * one:.0f} and {1e3 * two:.0f} ms."
    return ""


# The compass.

# A larger sigma is too large to report a delay.
COMPASS_SURE_MS = 15.0
# Minimum rate of change of the field (RMS), and minimum flight time.
MIN_FIELD_CHANGE_UT_S, MIN_COMPASS_S = 1.5, 20.0
# Tolerance between both halves: this, or 3 sigma of their difference (8.5 sigma of the whole fit).
COMPASS_APART_MS, HALVES_SIGMAS = 25.0, 8.5


def compass_delay(case: HealthCase) -> list[Check]:
    """Check the delay of the compass in use; nothing without one, or where nothing flew."""
    log, flown = case.log, driven_spans(case)
    model = None if log.mag is None else alignment.earth_field(log)
    if log.mag is None or model is None or not flown:
        return []
    field = log.mags[log.mag].field
    made = partial(Check, COMPASS.question, sensor=field.source, threshold=COMPASS.text, source=COMPASS.source)
    path = None if log.replay_imu is None else attitude_path(case)
    if path is None:
        return [made("unknown", reason_no_path(case))]
    use = inside(field.t_best, flown) & rotation.finite_rows(field.x)
    found = fit_compass_delay(field.t_best[use], 1e6 * field.x[use], 1e6 * np.array(model.ned_t), path)
    if found is None:
        return [made("unknown", "Too few samples of the compass in flight fit the attitude to find their delay.")]
    if why := compass_reason_unsure(found):
        return [made("unknown", why)]
    sigma = math.hypot(STANDARD_ERRORS * 1e3 * found.sigma, COMPASS.floor)
    check = delay_check(COMPASS, field.source, 1e3 * found.delay, sigma, aiding.of_compass(log, flown[0][0]))
    check.n, check.seconds = found.n, round(found.seconds, 1)
    check.evidence = [f"Found by {path.name} in {found.seconds:.0f} s of flight.", *check.evidence]
    return [check]


def compass_reason_unsure(found: DelayFit) -> str:
    """Return why a fit is no estimate of the delay; empty where it is."""
    if found.seconds < MIN_COMPASS_S or found.moving < MIN_FIELD_CHANGE_UT_S:
        return f"The field changes by {found.moving:.1f} uT/s in {found.seconds:.0f} s; turn more to show its delay."
    sigma_ms, (one, two) = STANDARD_ERRORS * 1e3 * found.sigma, (1e3 * x for x in found.halves)
    if sigma_ms > COMPASS_SURE_MS or not abs(one - two) <= max(COMPASS_APART_MS, HALVES_SIGMAS * 1e3 * found.sigma):
        return f"The delay of the compass is known to {sigma_ms:.0f} ms only; its field may be disturbed."
    return ""
