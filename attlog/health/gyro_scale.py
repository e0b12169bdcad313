"""Scale of the gyro by evidence that is not made of it, and the clocks that feign one.

``s`` is how much further the world turns than the gyro, as a share; above 0 the gyro reads too little. Truth, the
magnetic field and a second unit show it. The onboard attitude does not: it integrates this gyro, and with a scale error
of 5 % it agrees with it to 0.1 %. It shows clocks: the interval at which the main loop ought to log, the time that the
estimator integrates, and Universal Time against the log's own.
"""

from __future__ import annotations

import math
from itertools import pairwise
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from attlog.core import rotation
from attlog.core.kinematics import BodyRates, body_rates
from attlog.core.sorting import is_in, median
from attlog.core.spans import inside, seconds
from attlog.flight.compass import motor_drive
from attlog.flight.model import Array, Attitude, FlightLog, Imu, Mag
from attlog.health.check import Check, HealthCase, unknown
from attlog.health.flown import before_crashes, flight_spans
from attlog.health.imu import usable_imus
from attlog.health.regression import interval_text, robust_fit
from attlog.health.timing import MAX_LOOP_OFF, ClockRate, clock_check, is_clock_off, loop_check, loop_rate, utc_rate
from attlog.segments import increments, model

# Interval of mean rates, short against turns and long enough that noise and vibration do not lower the slope (0.98 at
# 0.1 s, 1.00 here); the longest interval and rotation in it; the largest number of intervals, for speed.
INTERVAL_S, MAX_INTERVAL_S, MAX_INTERVAL_RAD, MAX_INTERVALS = 0.3, 0.7, 1.0, 3000
# Searched delays either way, the grid, and half the step of the derivative.
MAX_DELAY_S, DELAY_GRID_S, SLOPE_S = 0.08, 0.02, 0.02
# Least intervals and blocks of 5 s for a clustered standard error, and its factor.
MIN_INTERVALS, MIN_BLOCKS, STANDARD_ERRORS = 60, 6, 1.5
# Least standard deviation of the rate about an axis, by an independent source and by the onboard attitude.
MIN_TURN_DPS, MIN_ONBOARD_TURN_DPS = 3.0, 8.0
# Least rate of a second unit; slower ones alias turns.
MIN_UNIT_HZ = 10.0
# Error of slopes and of the field's turns besides their scatter.
SLOPE_FLOOR, FIELD_FLOOR = 0.006, 0.008


class Turn(NamedTuple):
    """Excess of the world's turn over the gyro's about ``axis``, as a share with its ``sigma``, by a source ``by``."""

    axis: int
    share: float
    sigma: float
    by: str
    seconds: float


def fit_turns(imu: Imu, rates: BodyRates, least_dps: float, by: str) -> list[Turn]:
    """Fit rates (n, 3) rad/s of another source to a gyro with its delay, about each axis that turns."""
    turning = increments.gyro_increments(imu)
    rates = rates.at_most(MAX_INTERVALS)
    if len(rates.start) < MIN_INTERVALS or len(turning.t) < MIN_INTERVALS:
        return []
    span = rates.end - rates.start

    def gyro(delay: float) -> Array:
        return turning.mean_rates(rates.start + delay, rates.end + delay)

    shifted = {delay: gyro(delay) for delay in np.arange(-MAX_DELAY_S, MAX_DELAY_S + 1e-9, DELAY_GRID_S).tolist()}
    misfits = {delay: _misfit(rates.rate, g) for delay, g in shifted.items()}
    delay = min(misfits, key=lambda d: misfits[d])
    if not math.isfinite(misfits[delay]):
        return []
    found: list[Turn] = []
    for _ in range(2):
        g, slope = gyro(delay), (gyro(delay + SLOPE_S) - gyro(delay - SLOPE_S)) / (2.0 * SLOPE_S)
        good = rotation.finite_rows(g + slope) & (rotation.length(g) * span < MAX_INTERVAL_RAD)
        g, slope, a, t = g[good], slope[good], rates.rate[good], rates.start[good]
        if len(t) < MIN_INTERVALS:
            return []
        moving = np.degrees(g.std(axis=0))
        found, late = [], []
        for k in range(3):
            columns = np.column_stack([g, slope[:, k], np.ones(len(t))])
            fit = robust_fit(t, columns[:, None, :], a[:, k : k + 1]) if moving[k] >= least_dps else None
            if fit is None or fit.blocks < MIN_BLOCKS:
                continue
            sigma = math.hypot(STANDARD_ERRORS * float(fit.sigma[k]), SLOPE_FLOOR)
            found.append(Turn(k, float(fit.x[k]) - 1.0, sigma, by, float(span[good].sum())))
            late.append((float(fit.sigma[3]), float(fit.x[3])))
        if not late:
            return []
        delay += float(np.clip(min(late)[1], -DELAY_GRID_S, DELAY_GRID_S))
    return found


def _misfit(a: Array, g: Array) -> float:
    """Return the mean squared difference of rates (n, 3) without their medians."""
    off = a - g
    off = off[rotation.finite_rows(off)]
    if len(off) < MIN_INTERVALS:
        return math.inf
    size = np.sum((off - median(off, axis=0)) ** 2, axis=1)
    return float(np.mean(np.sort(size)[: int(0.98 * len(size))]))


def attitude_rates(case: HealthCase, attitude: Attitude, segment: NDArray[np.int64]) -> BodyRates:
    """Return mean rates of an attitude over intervals in use."""
    t = attitude.t if attitude.t_sample is None else attitude.t_sample
    step = max(1, round(INTERVAL_S * attitude.rate))
    return in_use(case, body_rates(t, attitude.q, segment, step, step, MAX_INTERVAL_S))


def onboard_turns(case: HealthCase, imu: Imu) -> list[Turn]:
    """Return the turns of the onboard attitude, which is made of the gyro, against it."""
    log, onboard = case.log, case.log.onboard_attitude
    if onboard is None or len(onboard.t) < MIN_INTERVALS:
        return []
    t = onboard.t if onboard.t_sample is None else onboard.t_sample
    jumps, _ = increments.known_resets(log, log.onboard or "", case.segments)
    reset = is_in(np.arange(len(t)), jumps).astype(np.int64)
    segment = model.merge_numbers(model.number_segments(t), np.cumsum(reset))
    return fit_turns(imu, attitude_rates(case, onboard, segment), MIN_ONBOARD_TURN_DPS, onboard.source)


def truth_turns(case: HealthCase, imu: Imu) -> list[Turn]:
    """Return the turns of the truth against the gyro."""
    truth = case.rates if case.rates is not None and case.rates.kind == "truth" else None
    if truth is None or len(truth.t) < MIN_INTERVALS:
        return []
    step = max(1, round(INTERVAL_S * truth.rate))
    rates = body_rates(truth.t, truth.q, truth.segment, step, step, MAX_INTERVAL_S)
    return fit_turns(imu, in_use(case, rates), MIN_TURN_DPS, truth.source)


def unit_turns(case: HealthCase, imu: Imu, other: Imu) -> list[Turn]:
    """Return the turns of a second unit against the gyro."""
    turning = increments.gyro_increments(other)
    if len(turning.t) < MIN_INTERVALS or other.gyro.rate < MIN_UNIT_HZ:
        return []
    start = np.arange(turning.t[0], turning.t[-1] - INTERVAL_S, INTERVAL_S)
    rates = BodyRates(start, start + INTERVAL_S, turning.mean_rates(start, start + INTERVAL_S))
    known = rotation.finite_rows(rates.rate)
    return fit_turns(imu, in_use(case, rates.select(known)), MIN_TURN_DPS, other.gyro.source)


def in_use(case: HealthCase, rates: BodyRates) -> BodyRates:
    """Select intervals in flight, in a log that hardly flies all before a crash."""
    return rates.select(mask_in_use(case, rates.start))


# Least flight; with less the whole log outside wrecks counts.
MIN_FLIGHT_S = 15.0


def mask_in_use(case: HealthCase, t: Array) -> NDArray[np.bool_]:
    """Mark times (n,) in flight, in a log that hardly flies all outside wrecks."""
    flown = flight_spans(case.segments)
    return inside(t, flown) if seconds(flown) >= MIN_FLIGHT_S else before_crashes(case.segments, t)


# Turns of the field. Samples of a compass at 8 Hz at most, in parts without gaps.

FIELD_HZ, MIN_PART_S, MAX_PARTS = 8.0, 15.0, 8


class FieldPart(NamedTuple):
    """Field ``m`` (n, 3) T at ``t`` (n,) s without gaps; ``turn`` (n - 1, 3): the gyro's rotation vectors between."""

    t: Array
    m: Array
    turn: Array


def field_parts(case: HealthCase, imu: Imu, mag: Mag) -> list[FieldPart]:
    """Return the longest parts of a compass's record beside the gyro, in use."""
    t, m = model.select_rising(mag.field.t_best, mag.field.x)
    step = max(1, round(mag.field.rate / FIELD_HZ))
    if step > 1:  # means: vibration and noise of a fast compass are lower, its delay is fitted
        n = len(t) // step * step
        t, m = t[:n].reshape(-1, step).mean(axis=1), m[:n].reshape(-1, step, 3).mean(axis=1)
    fresh = np.append(True, np.any(np.diff(m, axis=0) != 0.0, axis=1)) if len(m) else np.zeros(0, bool)
    use = fresh & rotation.finite_rows(m) & mask_in_use(case, t)
    t, m = t[use], m[use]
    turning = increments.gyro_increments(imu)
    if len(t) < MIN_INTERVALS:
        return []
    whole = turning.known(t[:-1], t[1:]) & (np.diff(t) < 4.0 / FIELD_HZ)
    edges = [0, *(np.flatnonzero(~whole) + 1).tolist(), len(t)]
    longest = sorted(pairwise(edges), key=lambda e: e[0] - e[1])[:MAX_PARTS]
    return [
        FieldPart(t[a:b], m[a:b], turning.between(t[a : b - 1], t[a + 1 : b]))
        for a, b in longest
        if b - a > 16 and t[b - 1] - t[a] >= MIN_PART_S
    ]


# A turn by the heading of the field: least range of heading and time; largest residual and largest amplitudes of the
# first and second harmonic of heading (left by iron), deg; largest error of the share.
MIN_RANGE_DEG, MIN_TURN_S, MAX_REST_DEG, MAX_HARMONICS_DEG, MAX_TURN_SIGMA = 360.0, 30.0, 3.0, (10.0, 5.0), 0.011


def heading_turn(case: HealthCase, parts: list[FieldPart], by: str) -> Turn | None:
    """Return the turn of a compass's heading against the gyro's, both level by the onboard tilt."""
    onboard = case.log.onboard_attitude
    if onboard is None or not parts:
        return None
    t_own = onboard.t if onboard.t_sample is None else onboard.t_sample
    segment = model.number_segments(t_own)
    times, level, turned, number = list[Array](), list[Array](), list[Array](), list[Array]()
    for part in parts:
        q, _ = rotation.slerp_in_segments(t_own, onboard.q, segment, part.t)
        if not rotation.finite_rows(q).all():
            continue
        heading = np.unwrap(_yaw(q))
        predicted = rotation.multiply(q[:-1], rotation.from_rotvec(part.turn))
        slip = rotation.to_rotvec(rotation.multiply(q[1:], rotation.conjugate(predicted)))[:, 2]
        field = rotation.rotate(q, part.m)
        c, s = np.cos(heading), np.sin(heading)
        level.append(np.column_stack([c * field[:, 0] + s * field[:, 1], c * field[:, 1] - s * field[:, 0]]))
        turned.append(heading - np.append(0.0, np.cumsum(slip)))
        times.append(part.t)
        number.append(np.full(len(part.t), len(number)))
    if not times:
        return None
    t, xy, psi, n = (np.concatenate(x) for x in (times, level, turned, number))
    length = sum(float(one[-1] - one[0]) for one in times)
    spread = max(float(np.ptp(one)) for one in turned)
    if np.degrees(spread) < MIN_RANGE_DEG or length < MIN_TURN_S:
        return None
    centre = np.linalg.lstsq(np.column_stack([2.0 * xy, np.ones(len(t))]), np.sum(xy**2, axis=1), rcond=None)[0][:2]
    xy = xy - centre
    off = -np.arctan2(xy[:, 1], xy[:, 0]) - psi
    off = np.concatenate([np.unwrap(off[n == k]) for k in range(len(times))])
    own = [(n == k).astype(float) for k in range(len(times))]
    drift = [one * (t - t[one > 0].mean()) for one in own]
    rate = np.gradient(psi, t)
    waves = [np.sin(psi), np.cos(psi), np.sin(2.0 * psi), np.cos(2.0 * psi)]
    columns = np.column_stack([psi - psi.mean(), *waves, rate, *own, *drift])
    fit = robust_fit(t, columns[:, None, :], off[:, None])
    if fit is None:
        return None
    first, second = (np.degrees(math.hypot(*fit.x[k : k + 2])) for k in (1, 3))
    sigma = math.hypot(STANDARD_ERRORS * float(fit.sigma[0]), FIELD_FLOOR)
    sound = np.degrees(fit.scatter) <= MAX_REST_DEG and first <= MAX_HARMONICS_DEG[0] and second <= MAX_HARMONICS_DEG[1]
    return Turn(2, float(fit.x[0]), sigma, by, length) if sound and sigma <= MAX_TURN_SIGMA else None


def _yaw(q: Array) -> Array:
    """Return the heading (n,) rad of attitudes (n, 4)."""
    w, x, y, z = q.T
    return np.asarray(np.arctan2(2.0 * (w * z + x * y), 1.0 - 2.0 * (y * y + z * z)))


# A turn by pairs of field vectors: their distance in time, least standard deviation of the angle about an axis, largest
# standard error, and largest residual as a share of the field.
PAIR_S, MIN_ANGLE_DEG, MAX_PAIR_ERROR, MAX_PAIR_REST = 2.0, 25.0, 0.01, 0.03


def pair_turns(case: HealthCase, parts: list[FieldPart], by: str) -> list[Turn]:
    """Return turns by pairs of field vectors 2 s apart: ``m2 - G' m1`` on iron, scale, bias, delay and motors."""
    power = motor_power(case.log)
    size = float(median(np.concatenate([rotation.length(part.m) for part in parts]))) if parts else 0.0
    if size <= 0.0:
        return []
    rows, targets, times, angles = [], [], [], []
    for part in parts:
        steps = 2 ** max(0, round(math.log2(PAIR_S / float(median(np.diff(part.t))))))
        m, turned, k = part.m / size, rotation.from_rotvec(part.turn), 1
        excess = part.turn[:, None, :] * np.eye(3)  # by a share of each axis
        drift = np.diff(part.t)[:, None, None] * np.eye(3)  # by a bias
        angle = part.turn
        while k < steps and len(turned) > k:  # each pass joins two neighbours
            later = rotation.to_matrix(turned[k:]).transpose(0, 2, 1)
            excess, drift = (later @ x[:-k] + x[k:] for x in (excess, drift))
            turned, angle, k = rotation.multiply(turned[:-k], turned[k:]), angle[:-k] + angle[k:], 2 * k
        if len(turned) < MIN_BLOCKS or k < steps:
            continue
        a, b = slice(0, len(turned)), slice(steps, steps + len(turned))
        back = rotation.rotate_inverse(turned, m[a])
        rate = np.gradient(np.cumsum(np.vstack([np.zeros(3), part.turn]), axis=0), part.t, axis=0)
        flow = np.cross(rate, m)
        late = flow[b] - rotation.rotate_inverse(turned, flow[a])
        eye, skew = np.broadcast_to(np.eye(3), (len(turned), 3, 3)), _cross_matrix(back)
        inverse = rotation.to_matrix(turned).transpose(0, 2, 1)
        columns = [eye - inverse, skew @ excess, skew @ drift, late[:, :, None]]
        if power is not None:
            p = np.interp(part.t, *power)
            p = (p - p.mean()) / max(float(np.ptp(p)), 1e-9)
            columns.append(p[b, None, None] * eye - p[a, None, None] * inverse)
        rows.append(np.concatenate(columns, axis=2))
        targets.append(m[b] - back)
        times.append(part.t[a])
        angles.append(angle)
    if not rows or sum(map(len, times)) < MIN_INTERVALS:
        return []
    t, x, y, angle = (np.concatenate(one) for one in (times, rows, targets, angles))
    spread = np.degrees(angle.std(axis=0))
    if not (spread >= MIN_ANGLE_DEG).any():
        return []
    fit = robust_fit(t, x, y)
    if fit is None or fit.blocks < MIN_BLOCKS or fit.scatter > MAX_PAIR_REST:
        return []
    length = sum(float(part.t[-1] - part.t[0]) for part in parts)
    return [
        Turn(k, float(fit.x[3 + k]), math.hypot(STANDARD_ERRORS * float(fit.sigma[3 + k]), FIELD_FLOOR), by, length)
        for k in range(3)
        if spread[k] >= MIN_ANGLE_DEG and STANDARD_ERRORS * fit.sigma[3 + k] <= MAX_PAIR_ERROR
    ]


def _cross_matrix(v: Array) -> Array:
    """Return the matrices (n, 3, 3) of ``v x``."""
    out = np.zeros((len(v), 3, 3))
    out[:, 0, 1], out[:, 0, 2], out[:, 1, 2] = -v[:, 2], v[:, 1], -v[:, 0]
    return np.asarray(out - out.transpose(0, 2, 1))


def motor_power(log: FlightLog) -> tuple[Array, Array] | None:
    """Return times and current, else throttle, of the motors; None if constant or missing."""
    _, stream = motor_drive(log)
    known = np.zeros(0, bool) if stream is None else np.isfinite(stream.x[:, 0])
    if stream is None or known.sum() < 2 or not np.ptp(stream.x[known, 0]) > 0.0:
        return None
    return stream.t[known], stream.x[known, 0]


# Checks.

# Largest error of a sound gyro's scale, and its significance: by independent sources, by the onboard attitude.
SCALE_OFF, SIGMAS, ONBOARD_SIGMAS = 0.02, 3.0, 4.0
# Smallest error of the main loop that counts in a comparison.
LOOP_COUNTS = 0.01
# Largest difference of two units' turns, and its largest error, with which they count as equal.
EQUAL_UNITS, SOUND_UNITS, MAX_UNIT_SIGMA = 0.01, 0.015, 0.011
SCALE_LIMIT = (
    f"ok within {100 * SCALE_OFF:.0f} % or {SIGMAS:.0f} sigma by truth or compass; the onboard attitude is no judge"
)
TURN_ADVICE = "Turn by 360 deg and back at 30 deg/s."
NO_SCALE_SETTING = "No parameter scales a gyro."
AXES = "xyz"
# Largest error of a turn that shows a sound scale: the largest that a compass is used with.
MAX_SOUND_SIGMA = math.hypot(MAX_PAIR_ERROR, FIELD_FLOOR)


class ScaleEvidence(NamedTuple):
    """Turns of the world against a gyro: by truth, compasses, other units and the onboard attitude, and clocks.

    ``utc`` and ``loop``: seconds of Universal Time and of the main loop's schedule in a logged second, None if unknown.
    """

    truth: list[Turn]
    field: list[Turn]
    units: list[Turn]
    onboard: list[Turn]
    utc: ClockRate | None = None
    loop: ClockRate | None = None

    def independent(self, axis: int) -> list[Turn]:
        """Return turns that judge a scale about an axis: truth, else the best of each compass; the best first."""
        own = [t for t in self.truth if t.axis == axis] or [t for t in self.field if t.axis == axis]
        best: dict[str, Turn] = {}
        for turn in sorted(own, key=lambda turn: turn.sigma):
            best.setdefault(turn.by, turn)
        return list(best.values())

    def equal_unit(self, axis: int, within: float) -> Turn | None:
        """Return the turn of another unit that equals the gyro's."""
        return next(
            (t for t in self.units if t.axis == axis and abs(t.share) <= within and t.sigma <= MAX_UNIT_SIGMA), None
        )

    @property
    def loop_off(self) -> float:
        """Error of the main loop that may feign a scale, 0 if none."""
        off = 0.0 if self.loop is None else self.loop.rate - 1.0
        return off if LOOP_COUNTS <= abs(off) <= MAX_LOOP_OFF else 0.0

    @property
    def clock_off(self) -> float:
        """Error of the log's clock, 0 if none is significant."""
        return self.utc.rate - 1.0 if self.utc is not None and is_clock_off(self.utc) else 0.0


def scale_checks(case: HealthCase) -> list[Check]:
    """Check the scale of the replayed gyro, the log's clock and the main loop."""
    imu = case.log.replay_imu
    if imu is None:
        return [clock_check(utc_rate(case.log), None)]
    found = scale_evidence(case, imu)
    scale = scale_check(imu, found)
    if scale.is_trouble:
        scale.why_no_setting = NO_SCALE_SETTING
    slowed = [
        _onboard_sentence(found, imu.gyro.source, turn) for turn in _different_turns(found) if _is_by_loop(found, turn)
    ]
    in_time = found.loop
    if in_time is not None and found.utc is not None and found.clock_off:
        # A scheduler keeps time by the log's clock, or by a timer of its own: one that is right by either is not slow.
        in_time = min(in_time, in_time._replace(rate=in_time.rate / found.utc.rate), key=lambda r: abs(r.rate - 1.0))
    loop = [] if in_time is None else [loop_check(case.log, imu, in_time, slowed)]
    return [clock_check(found.utc, found.loop), *loop, scale]


def scale_evidence(case: HealthCase, imu: Imu) -> ScaleEvidence:
    """Return all evidence of a gyro's scale in a log."""
    log, field = case.log, list[Turn]()
    for mag in log.mags:
        parts = field_parts(case, imu, mag)
        heading = heading_turn(case, parts, mag.field.source)
        field += [*pair_turns(case, parts, mag.field.source), *([] if heading is None else [heading])]
    units = [turn for other in usable_imus(case) if other is not imu for turn in unit_turns(case, imu, other)]
    return ScaleEvidence(
        truth_turns(case, imu), field, units, onboard_turns(case, imu), utc_rate(log), loop_rate(log, imu)
    )


def scale_check(imu: Imu, found: ScaleEvidence) -> Check:
    """Check a gyro's scale; only truth and compasses accuse it."""
    source = imu.gyro.source
    if found.clock_off:
        why = f"The log's clock is {100 * abs(found.clock_off):.1f} % off, so it shows no scale."
        return unknown("gyro_scale", why, SCALE_LIMIT, sensor=source)
    accused, doubts, known = [], [], []
    for axis in range(3):
        if not (own := found.independent(axis)):
            continue
        turn, spread = own[0], max(t.share for t in own) - min(t.share for t in own)
        if abs(turn.share) <= max(SCALE_OFF, SIGMAS * turn.sigma):
            if spread > SCALE_OFF and turn not in found.truth:
                doubts.append(f"{turn.by} turns {_times(turn)} times as far about {AXES[axis]}, but compasses differ.")
            else:
                known += [turn] if turn.sigma <= MAX_SOUND_SIGMA else []
        elif turn not in found.truth and (why := _doubt(found, axis, spread)):
            doubts.append(f"{turn.by} turns {_times(turn)} times as far about {AXES[axis]}, but {why}.")
        else:
            accused.append(turn)
    if accused:
        return _faulty_scale(source, found, max(accused, key=lambda turn: abs(turn.share) / turn.sigma))
    evidence = [_onboard_sentence(found, source, turn) for turn in _different_turns(found)]
    if known and not doubts:
        parts = []
        for by in dict.fromkeys(turn.by for turn in known):
            shown = ", ".join(f"{AXES[turn.axis]} {_times(turn)}" for turn in known if turn.by == by)
            parts.append(f"{by} turns {shown} times")
        text = f"{' and '.join(parts)} as far as {source}, {known[0].seconds:.0f} s."
        check = Check("gyro_scale", "ok", text, unit="%", threshold=SCALE_LIMIT, seconds=round(known[0].seconds, 1))
        worst = max(known, key=lambda turn: abs(turn.share))
        check.measure(-100.0 * worst.share / (1.0 + worst.share), 100.0 * worst.sigma / (1.0 + worst.share) ** 2, 2)
    else:
        why = doubts[0] if doubts else "Neither truth nor a compass shows how far the vehicle turned."
        check = unknown("gyro_scale", why, SCALE_LIMIT)
        check.action = TURN_ADVICE
    check.sensor, check.evidence = source, evidence
    return check


def _times(turn: Turn) -> str:
    return f"{1.0 + turn.share:.3f}"


def _doubt(found: ScaleEvidence, axis: int, spread: float) -> str:
    """Return what else explains the turn of a compass, or empty."""
    if spread > SCALE_OFF:
        return "compasses differ"
    if found.loop_off:
        return f"the main loop is {100 * abs(found.loop_off):.1f} % off"
    unit = found.equal_unit(axis, EQUAL_UNITS)
    return f"{unit.by} turns {_times(unit)} times as far" if unit is not None else ""


def _faulty_scale(source: str, found: ScaleEvidence, turn: Turn) -> Check:
    """Return the fault of a scale, with the remedy that the number of its signs allows."""
    error, sigma = -turn.share / (1.0 + turn.share), turn.sigma / (1.0 + turn.share) ** 2
    signs = {t.by for t in found.independent(turn.axis)} | {
        t.by
        for t in found.units
        if t.axis == turn.axis and abs(t.share - turn.share) <= SIGMAS * math.hypot(t.sigma, turn.sigma)
    }
    text = f"{source} reads {100 * abs(error):.1f} % too {'much' if error > 0 else 'little'} about {AXES[turn.axis]} "
    text += f"({interval_text(100 * abs(error), 100 * sigma, 1)}, 95 %) against {turn.by}, {turn.seconds:.0f} s."
    check = Check("gyro_scale", "fault", text, unit="%", threshold=SCALE_LIMIT, seconds=round(turn.seconds, 1))
    check.sensor = source
    check.evidence = [
        f"{t.by} turns {_times(t)} times as far about {AXES[t.axis]}."
        for t in (*found.truth, *found.field, *found.units)
        if t is not turn and t.axis == turn.axis
    ]
    sure = turn in found.truth or len(signs) > 1
    replace = "Fly on another IMU, and replace this one." if found.units else "Replace this IMU."
    check.action = replace if sure else f"{TURN_ADVICE} Then compare again."
    return check.measure(100.0 * error, 100.0 * sigma, 2)


def _different_turns(found: ScaleEvidence) -> list[Turn]:
    """Return the turns of the onboard attitude that differ from the gyro's."""
    return [turn for turn in found.onboard if abs(turn.share) > max(SCALE_OFF, ONBOARD_SIGMAS * turn.sigma)]


def _is_by_loop(found: ScaleEvidence, turn: Turn) -> bool:
    """Return whether an error of the main loop explains a turn of the onboard attitude."""
    return bool(found.loop_off) and abs((1.0 + turn.share) / (1.0 + found.loop_off) - 1.0) <= SCALE_OFF


def _onboard_sentence(found: ScaleEvidence, source: str, turn: Turn) -> str:
    """Return a sentence on a turn of the onboard attitude that differs from the gyro's, with what explains it."""
    text = f"{turn.by} turns {_times(turn)} times as far as {source} about {AXES[turn.axis]}"
    own, unit = found.independent(turn.axis), found.equal_unit(turn.axis, SOUND_UNITS)
    if _is_by_loop(found, turn):
        text += f": the log's clock and the main loop differ by {100 * abs(found.loop_off):.1f} %"
    elif own and abs(own[0].share) <= SCALE_OFF and abs(own[0].share - turn.share) > SIGMAS * own[0].sigma:
        text += f", {own[0].by} {_times(own[0])} times: the attitude is in error, not the gyro"
    elif unit is not None:
        text += f", {unit.by} {_times(unit)} times: the attitude is in error, not the gyro"
    return f"{text}."
