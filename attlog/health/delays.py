"""How late are GNSS and compass against the inertial samples? By an attitude that both are compared with.

GNSS: with attitude R, force f and gravity g, the velocity is the integral of ``R f + g``. Between fixes 2 s apart it
changes by ``V(t_j - tau) - V(t_i - tau)``; linear in a change of tau, a turn of the attitude about the vertical and a
constant force. Compass: the field is ``R(t - tau)' h``, linear in tau, a turn, a scale and an offset. Gauss-Newton
with Huber weights; the standard errors are clustered by 5 s (:mod:`attlog.health.regression`).
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from attlog.core import rotation
from attlog.core.spans import Span, complement, inside, intersect
from attlog.flight import aiding
from attlog.flight.aiding import DelayParameter
from attlog.flight.model import Array, FlightLog, Gnss, Imu
from attlog.health.check import Check, HealthCase, Setting, graded, unknown
from attlog.health.flown import crash_spans
from attlog.health.regression import RobustFit, interval_text, robust_fit
from attlog.reference import alignment

VELOCITY_SPAN_S, SPAN_TOLERANCE_S = 2.0, 0.7
"""Velocities change over so long, give or take."""
MAX_STEP_S = 0.1
"""Force is not integrated across a longer hole between inertial samples."""
FIX_3D = 3
MIN_DELAY_SAMPLES, MAX_DELAY_S = 30, 0.6
PASSES, CONVERGED_S = 8, 5e-4
SLOPE_S = 0.02
"""Derivatives are differences over twice so long."""


@dataclass(frozen=True, slots=True)
class AttitudePath:
    """Attitudes ``q`` (n, 4) of the replayed IMU at ``t`` (n,) s; ``segment`` (n,) numbers what is between gaps."""

    t: Array
    q: Array
    segment: NDArray[np.int64] | None
    name: str


@dataclass(frozen=True, slots=True)
class DelayFit:
    """A delay and its standard error in s; ``halves`` are those of both halves of the flight.

    ``turn_deg`` is the turn of the attitude about the vertical that fits best. ``moving``: RMS of what shows the
    delay, m/s^2 or uT/s. ``n`` samples in ``seconds``.
    """

    delay: float
    sigma: float
    halves: tuple[float, float]
    turn_deg: float
    moving: float
    n: int
    seconds: float


Equations = Callable[[float], tuple[Array, Array, Array]]
"""At a delay in s: times (n,), columns (n, k, p), the first two those of delay and turn, and the rest (n, k)."""


def fit_gnss_delay(imu: Imu, receiver: Gnss, path: AttitudePath, flown: list[Span], guess: float) -> DelayFit | None:
    """How late the velocities of a receiver are against its own time of receipt; None where too little tells."""
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
    """How late a field (n, 3) uT at ``t`` (n,) s is against the attitude; ``earth`` (3,) uT north, east, down."""
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
    """Times (n,) s when the force was felt, its integral (n, 2) m/s north and east, and the holes up to each."""
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
    """The delay at which nothing is left to change."""
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


# When a vehicle flew, and by which attitude its other sensors are compared: for every question of this folder.

EDGE_S = 1.0
"""Left out at both ends of a flight: the ground pushes there."""
BLOCK_S = 5.0
"""Samples within so long are not independent: intervals come from blocks."""
SURE_HEADING_DEG, SURE_TILT_DEG = 5.0, 1.0
"""A smoother that is surer than this knows its heading by motion alone; its tilt, where only that is needed."""


def flight_spans(case: HealthCase) -> list[Span]:
    """Spans (t0, t1) s in the air before any crash; while armed, where a log cannot tell of flight."""
    segments = case.segments
    if "airborne" in segments.unknown:
        spans = armed_spans(case.log)
    else:
        spans = segments.spans("airborne")
    spans = [(a + EDGE_S, b - EDGE_S) for a, b in spans if b - a > 2.0 * EDGE_S]
    return intersect(spans, complement(crash_spans(segments), -np.inf, np.inf))


def armed_spans(log: FlightLog) -> list[Span]:
    """Spans (t0, t1) s armed; none where the log does not tell."""
    if log.state.armed is None or len(log.state.armed.t) == 0:
        return []
    ends = [*log.state.armed.t[1:].tolist(), _last_time(log)]
    return [
        (a, b) for a, b, on in zip(log.state.armed.t.tolist(), ends, log.state.armed.value, strict=True) if on and b > a
    ]


def _last_time(log: FlightLog) -> float:
    """The last time of anything that is asked for here, s."""
    every = (
        [a.t for a in log.attitudes.values()] + [g.t for g in log.gnss] + [i.t for i in log.estimator.innovation_tests]
    )
    return max((float(t[-1]) for t in every if len(t)), default=log.seconds)


def attitude_path(case: HealthCase) -> AttitudePath | None:
    """The attitude that the delays of other sensors are measured by; None where none is sound.

    By motion alone where that knows its heading, else truth or a smoother with its own heading, else motion alone
    with a heading that the fits turn as they need.
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
    """Why there is no attitude to measure delays by, and what would give one."""
    if case.log.replay_imu is None:
        return f"No IMU of this log can be replayed. {case.log.advice('imu')}".strip()
    return "No attitude of this log is sure enough to measure delays by; fly longer with GNSS, faster and slower."


def median_interval(t: Array, x: Array) -> tuple[float, float]:
    """The 95 % interval of the median of ``x`` (n,) at ``t`` (n,) s: order statistics of medians of blocks of 5 s."""
    block = (t // BLOCK_S).astype(np.int64)
    starts = np.flatnonzero(np.diff(block, prepend=block[0] - 1))
    medians = np.sort([float(np.median(part)) for part in np.split(x, starts[1:])])
    n = len(medians)
    reach = 0.98 * np.sqrt(n)
    low, high = int(np.floor(0.5 * n - reach)), int(np.ceil(0.5 * n + reach))
    return float(medians[max(low, 0)]), float(medians[min(high, n - 1)])


def held_seconds(t: Array) -> Array:
    """How long each sample (n,) at ``t`` stands for, s: to the next, at most three usual steps."""
    if len(t) < 2:
        return np.zeros(len(t))
    step = np.diff(t)
    usual = float(np.median(step))
    return np.asarray(np.minimum(np.append(step, usual), 3.0 * usual))


# How late the logged gyro is: by its filter's parameter, and by what the rates show beyond it.

SHORT_DELAY_MS = 6.0
AGREES_MS, HIDDEN_MS, WRONG_CLOCK_MS = 4.0, 10.0, 20.0
"""A difference beyond the first is no filter's that is named, beyond the second none that a sensor has by itself
(20 Hz), beyond the third a clock or a sampling rule is wrong."""
IMU_DELAY_SIGMAS, IMU_FLOOR_MS = 4.0, 0.5
"""Told above four times sqrt((1.5 standard errors)^2 + 0.5^2)."""
FILTER_DELAY_LIMIT = f"ok up to {SHORT_DELAY_MS:.0f} ms"
IMU_DELAY_LIMIT = (
    f"ok within {AGREES_MS:.0f} ms ({HIDDEN_MS:.0f} where the log names no filter) of its filter's, "
    f"or {IMU_DELAY_SIGMAS:.0f} sigma; fault beyond {WRONG_CLOCK_MS:.0f} ms"
)


def imu_delay_checks(case: HealthCase) -> list[Check]:
    """Check the delay of the filters ahead of the logger, and of the gyro rates against those of the reference."""
    log, reference = case.log, case.rates
    if not log.imus:
        return []
    imu = log.imus[log.imu or 0]
    by_filter = 1e3 * imu.gyro.delay
    own = Check("filter_delay", "ok", "", threshold=FILTER_DELAY_LIMIT, sensor=imu.gyro.source)
    if by_filter > 0:
        own.verdict = graded(by_filter, SHORT_DELAY_MS, math.inf)
        own.text, own.value, own.unit = f"{own.sensor} is late by {by_filter:.1f} ms ({imu.filtered}).", by_filter, "ms"
        own.value = round(by_filter, 2)
    elif imu.filtered not in ("unknown", "driver"):
        own.text, own.value, own.unit = f"{own.sensor} is logged without a low-pass filter.", 0.0, "ms"
    else:
        own.verdict, own.text = "unknown", f"{own.sensor}: the log does not show how it was filtered."
    rates = Check("imu_delay", "ok", "", threshold=IMU_DELAY_LIMIT, sensor=imu.gyro.source)
    seen = None if reference is None or log.imu is None else alignment.gyro_delay(imu, reference)
    if reference is None or seen is None:
        rates.verdict, rates.text = "unknown", "The vehicle turns too little to show a delay."
        return [own, rates]
    late, sigma = 1e3 * seen[0], math.hypot(1.5e3 * seen[1], IMU_FLOOR_MS)
    rates.value, rates.unit = round(late, 2), "ms"
    off = late - by_filter
    known = f"its filter's {by_filter:.1f} ms" if by_filter > 0 else "no filter"
    agrees = HIDDEN_MS if imu.filtered in ("unknown", "driver") else AGREES_MS
    if -AGREES_MS <= off <= agrees or abs(off) <= IMU_DELAY_SIGMAS * sigma:
        rates.text = f"Against {reference.source} the rates of {rates.sensor} are late by {late:.1f} ms: {known}."
    elif off < 0 and reference.kind == "onboard":
        rates.text = (
            f"{reference.source} comes {-off:.1f} ms later than {rates.sensor}: the attitude, not the IMU, is late."
        )
    else:
        way = "later" if off > 0 else "earlier"
        rates.text = (
            f"{rates.sensor} comes {abs(off):.1f} ms {way} ({interval_text(abs(off), sigma, 1)}, 95 %) against "
        )
        rates.text += f"{reference.source} than {known} makes it: {late:.1f} ms in all."
        rates.verdict = "fault" if abs(off) > WRONG_CLOCK_MS else "warning"
        rates.why_no_setting = "No parameter moves the inertial samples: look at their filter and at the logger."
    return [own, rates]


# How late is GNSS, and does the onboard estimator know it?
#
# Estimates with little in common: the fit of velocities by :mod:`attlog.health.delays`, and the likelihood of
# the
# smoother, without and with the compass. Their mean is told; half their range is part of its error.

GNSS_OFF_MS, GNSS_SIGMAS, GNSS_FLOOR_MS = 20.0, 3.0, 8.0
"""Offered beyond both. On 24 simulated flights both estimates lie within 18 ms of the truth; floor: their scatter."""
MIN_FORCE_CHANGE_M_S2, MIN_GNSS_S = 0.4, 15.0
"""Change of the horizontal force that shows a delay (RMS), and how much flight."""
GNSS_APART_MS = 40.0
"""Estimates further apart than this tell nothing."""
MAX_TURN_DEG = 10.0
"""The equations are linear in a turn of the heading: up to so much."""
GNSS_SURE_MS = 30.0
"""A delay known less well than this (one sigma) is not told."""
GNSS_ROUND_MS = 5.0
GNSS_DELAY_LIMIT = f"ok within {GNSS_OFF_MS:.0f} ms or {GNSS_SIGMAS:.0f} sigma of what is set"
GNSS_DELAY_SOURCE = "planted delays on 24 simulated flights"


def gnss_delays(case: HealthCase) -> list[Check]:
    """The delay of each receiver that had fixes in flight against the parameter that flew."""
    flown = flight_spans(case)
    receivers = [g for g in case.log.gnss if (g.fix >= FIX_3D).sum() > MIN_DELAY_SAMPLES]
    if not flown or not receivers:
        return []
    path = None if case.log.replay_imu is None else attitude_path(case)
    return [_gnss_delay(case, one, path, flown) for one in receivers]


def _gnss_delay(case: HealthCase, receiver: Gnss, path: AttitudePath | None, flown: list[tuple[float, float]]) -> Check:
    imu = case.log.replay_imu
    if imu is None or path is None:
        return unknown(
            "gnss_delay", reason_no_path(case), GNSS_DELAY_LIMIT, sensor=receiver.source, source=GNSS_DELAY_SOURCE
        )
    smoothed = _smoother_delays(case, receiver)
    found = fit_gnss_delay(imu, receiver, path, flown, 1e-3 * smoothed[0] if smoothed else 0.1)
    why = _gnss_delay_doubt(found, smoothed)
    if found is None or why:
        return unknown("gnss_delay", why, GNSS_DELAY_LIMIT, sensor=receiver.source, source=GNSS_DELAY_SOURCE)
    own = 1e3 * found.delay
    every = [own, *smoothed]
    late, apart = sum(every) / len(every), 0.5 * (max(every) - min(every))
    sigma = math.sqrt((1.5e3 * found.sigma) ** 2 + GNSS_FLOOR_MS**2 + apart**2)
    parameter = aiding.gnss_delay_parameter(case.log, receiver, flown[0][0])
    told = _gnss_delay_assessment(receiver, late, sigma, parameter, aiding.buffer(case.log, flown[0][0]))
    told.n, told.seconds = found.n, round(found.seconds, 1)
    told.evidence.insert(0, f"By {path.name} the velocities are {own:.0f} ms late in {found.seconds:.0f} s of flight.")
    if smoothed:
        shown = " and ".join(f"{x:.0f} ms" for x in smoothed)
        told.evidence.insert(1, f"The likelihood of the smoother finds {shown}.")
    return told


def _gnss_delay_assessment(
    receiver: Gnss, late: float, sigma: float, parameter: DelayParameter | str, buffer: DelayParameter | None
) -> Check:
    """The delay beside the parameter; a value where it is off by more than both limits."""
    interval = f"{late - 1.96 * sigma:.0f} to {late + 1.96 * sigma:.0f}"
    text = f"{receiver.source} is {late:.0f} ms late ({interval}, 95 %)"
    found = Check(
        "gnss_delay", "ok", f"{text}.", sensor=receiver.source, threshold=GNSS_DELAY_LIMIT, source=GNSS_DELAY_SOURCE
    )
    found.value, found.unit = round(late, 1), "ms"
    found.ci95 = (round(late - 1.96 * sigma, 1), round(late + 1.96 * sigma, 1))
    if isinstance(parameter, str):
        found.verdict, found.why_no_setting = "unknown", parameter
        return found
    found.text = f"{text}; {parameter.words}."
    off = max(parameter.low - late, late - parameter.high, 0.0)
    if off <= max(GNSS_OFF_MS, GNSS_SIGMAS * sigma):
        if off > GNSS_OFF_MS:
            found.evidence.append(
                f"A difference of {off:.0f} ms is within {GNSS_SIGMAS:.0f} sigma: accelerate and brake more."
            )
        if parameter.low < parameter.high:
            found.verdict = "unknown"
            found.why_no_setting = "The log does not name the receiver's hardware: log from boot on."
        return found
    found.verdict = "warning"
    new = GNSS_ROUND_MS * round(late / GNSS_ROUND_MS)
    if not 0.0 < new <= parameter.most:
        found.why_no_setting = f"{parameter.name} ends at {parameter.most:.0f} ms: look for what delays the receiver."
        return found
    found.settings = [Setting(parameter.name, parameter.old, new, "ms")]
    if buffer is not None and new > buffer.old:
        found.settings.append(Setting(buffer.name, buffer.old, new, "ms"))
    found.action = f"Set {parameter.name} to {new:.0f} ms, reboot, and compare test ratios of the next flight."
    return found


def _smoother_delays(case: HealthCase, receiver: Gnss) -> list[float]:
    """What smoothers without and with the compass find in ms since a record's receipt, of the receiver they use."""
    used = next((g for g in case.log.gnss if (g.fix >= FIX_3D).sum() > 1), None)
    qualities = [] if case.motion is None else [case.motion.quality]
    if case.reference is not None and case.reference.kind == "smoother":
        qualities.append(case.reference.quality)
    found = [quality.get("gnss_delay_ms") for quality in qualities]
    between = 1e3 * _write_delay_s(receiver)
    return [late - between for late in found if isinstance(late, float)] if used is receiver else []


def _write_delay_s(receiver: Gnss) -> float:
    """How long after its receipt a record was written, s: the median."""
    if receiver.received is None or len(receiver.t) == 0:
        return 0.0
    between = sorted((receiver.t - receiver.received).tolist())
    return float(between[len(between) // 2])


def _gnss_delay_doubt(found: DelayFit | None, smoothed: list[float]) -> str:
    """Why a fit is not believed; empty where it is."""
    if found is None:
        return "Too few GNSS velocities in flight to find their delay."
    if found.seconds < MIN_GNSS_S:
        return f"{found.seconds:.0f} s of flight with GNSS velocities; {MIN_GNSS_S:.0f} s are needed for their delay."
    if found.moving < MIN_FORCE_CHANGE_M_S2:
        return f"The force changes by {found.moving:.2f} m/s^2 only; accelerate and brake to show the delay of GNSS."
    if 1.5e3 * found.sigma > GNSS_SURE_MS:
        return f"The delay of GNSS is known to {1.5e3 * found.sigma:.0f} ms only; accelerate and brake more."
    if abs(found.turn_deg) > MAX_TURN_DEG:
        return (
            f"The attitude's heading is {abs(found.turn_deg):.0f} deg off GNSS velocities: no delay can be determined."
        )
    if any(abs(1e3 * found.delay - late) > GNSS_APART_MS for late in smoothed):
        shown = " and ".join(f"{x:.0f}" for x in (1e3 * found.delay, *smoothed))
        return f"Estimates of the GNSS delay differ: {shown} ms."
    one, two = found.halves
    if not abs(one - two) <= max(3.0 * math.sqrt(8.0) * found.sigma, 1e-3 * GNSS_APART_MS):
        return f"The halves of the flight show different GNSS delays: {1e3 * one:.0f} and {1e3 * two:.0f} ms."
    return ""


# How late is the compass, and does the onboard estimator know it? And how late are the inertial samples?

COMPASS_OFF_MS, COMPASS_SIGMAS, COMPASS_FLOOR_MS, COMPASS_SURE_MS = 20.0, 3.0, 5.0, 15.0
"""Told beyond both; the floor is the scatter over 24 simulated flights (44 to 53, and -2 to 2 ms)."""
MIN_FIELD_CHANGE_UT_S, MIN_COMPASS_S = 1.5, 20.0
"""The field must change so fast (RMS), for so long."""
COMPASS_APART_MS = 25.0
COMPASS_ROUND_MS = 5.0
COMPASS_DELAY_LIMIT = f"ok within {COMPASS_OFF_MS:.0f} ms or {COMPASS_SIGMAS:.0f} sigma of what is set"
COMPASS_DELAY_SOURCE = "24 simulated flights"


def compass_delay(case: HealthCase) -> list[Check]:
    """The delay of the compass that is replayed; nothing without one, or where nothing flew."""
    log = case.log
    model = None if log.mag is None else alignment.earth_field(log)
    flown = flight_spans(case)
    if log.mag is None or model is None or not flown:
        return []
    field = log.mags[log.mag].field
    path = None if log.replay_imu is None else attitude_path(case)
    if path is None:
        return [
            unknown(
                "magnetometer_delay",
                reason_no_path(case),
                COMPASS_DELAY_LIMIT,
                sensor=field.source,
                source=COMPASS_DELAY_SOURCE,
            )
        ]
    use = inside(field.t_best, flown) & rotation.finite_rows(field.x)
    found = fit_compass_delay(field.t_best[use], 1e6 * field.x[use], 1e6 * np.array(model.ned_t), path)
    why = _compass_delay_doubt(found)
    if found is None or why:
        return [
            unknown("magnetometer_delay", why, COMPASS_DELAY_LIMIT, sensor=field.source, source=COMPASS_DELAY_SOURCE)
        ]
    told = _compass_delay_assessment(field.source, found, aiding.of_compass(log, flown[0][0]))
    told.n, told.seconds = found.n, round(found.seconds, 1)
    told.evidence = [f"Found by {path.name} in {found.seconds:.0f} s of flight."]
    return [told]


def _compass_delay_assessment(source: str, found: DelayFit, parameter: DelayParameter | str) -> Check:
    late, sigma = 1e3 * found.delay, math.hypot(1.5e3 * found.sigma, COMPASS_FLOOR_MS)
    text = f"{source} is {late:.0f} ms late ({late - 1.96 * sigma:.0f} to {late + 1.96 * sigma:.0f}, 95 %)"
    told = Check(
        "magnetometer_delay",
        "ok",
        f"{text}.",
        sensor=source,
        threshold=COMPASS_DELAY_LIMIT,
        source=COMPASS_DELAY_SOURCE,
    )
    told.value, told.unit = round(late, 1), "ms"
    told.ci95 = (round(late - 1.96 * sigma, 1), round(late + 1.96 * sigma, 1))
    if isinstance(parameter, str):
        told.verdict, told.why_no_setting = "unknown", parameter
        return told
    told.text = f"{text}; {parameter.words}."
    if max(parameter.low - late, late - parameter.high) <= max(COMPASS_OFF_MS, COMPASS_SIGMAS * sigma):
        return told
    told.verdict, new = "warning", COMPASS_ROUND_MS * round(late / COMPASS_ROUND_MS)
    if not 0.0 < new <= parameter.most:
        told.why_no_setting = "No parameter holds this delay of a compass."
        return told
    told.settings = [Setting(parameter.name, parameter.old, new, "ms")]
    told.action = f"Set {parameter.name} to {new:.0f} ms, reboot, and compare test ratios of the next flight."
    return told


def _compass_delay_doubt(found: DelayFit | None) -> str:
    """Why a fit is not believed; empty where it is."""
    if found is None:
        return "Too few samples of the compass in flight fit the attitude to find their delay."
    if found.seconds < MIN_COMPASS_S or found.moving < MIN_FIELD_CHANGE_UT_S:
        return f"The field changes by {found.moving:.1f} uT/s in {found.seconds:.0f} s; turn more to show its delay."
    one, two = (1e3 * x for x in found.halves)
    if 1.5e3 * found.sigma > COMPASS_SURE_MS or not abs(one - two) <= max(COMPASS_APART_MS, 8.5e3 * found.sigma):
        return f"The delay of the compass is known to {1.5e3 * found.sigma:.0f} ms only; its field may be disturbed."
    return ""
