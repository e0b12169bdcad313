"""Checks of accelerometer axes and offset in flight by GNSS and an attitude.

At rest on level ground neither the order of the axes nor an offset (it acts as a tilt error) is observable. In flight
both are, from the mean force between two GNSS velocities: with attitude R, logged force f and gravity g,
``dv/dt - g = R (A f + b)``. A is near the identity for a sound sensor and a signed permutation where axes are swapped
or reversed; -b is the offset. Only horizontal axes are fitted, because f_z is mostly weight and varies too little.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from attlog.core import rotation
from attlog.core.log_cache import cached_per_log
from attlog.core.sorting import median, nanmedian
from attlog.core.spans import Span, inside
from attlog.flight.model import FIX_3D, Array, FlightLog, Gnss, Imu
from attlog.health import gravity
from attlog.health.check import Check, HealthCase, Verdict, graded, unknown
from attlog.health.flown import EDGE_S, flight_spans, still_spans
from attlog.health.gravity import STANDARD_GRAVITY, expected_gravity
from attlog.health.imu import FLOOR_M_S2, SensorBias, axes_text, smoothed_acc_bias, stream_blocks, usable_imus
from attlog.health.imu_checks import MIN_FLOWN_HZ, difference_in_flight
from attlog.health.regression import RobustFit, interval_text, robust_fit
from attlog.health.settings import accelerometer_proposal
from attlog.reference import alignment
from attlog.reference.model import Reference
from attlog.segments.model import Segments

# Time between the differenced velocities: receiver noise of 0.1 m/s gives 0.07 m/s^2.
VELOCITY_SPAN_S = 2.0
# Minimum flight time of the fit, and its maximum: the first 15 min of long logs.
MIN_FLIGHT_S, MAX_FLIGHT_S = 20.0, 900.0
# Candidate GNSS delays; the best fit is used.
GNSS_DELAYS_S = np.arange(0.0, 0.61, 0.1)
# Maximum interval between force samples; longer ones are gaps.
MAX_HOLE_S, MIN_FORCE_SAMPLES = 0.2, 100
# Horizontal gravity error by attitude source, from tilt errors of 0.06, 0.3 and 0.6 deg (onboard attitudes measured
# against truth: 0.3 to 0.9). An external truth has its own sigma.
TILT_M_S2 = {"truth": 0.01, "smoother": 0.05, "onboard": 0.1}
# Minimum horizontal force (RMS about its mean) to identify the axes.
MIN_SPREAD_M_S2 = 0.15
# Another order of axes is accepted if its squared residual is this factor smaller and its residual is below this share
# of the force's spread.
AXES_RATIO, MAX_LEFT_SHARE = 4.0, 0.5
# Offset limits: 1 and 3 deg of tilt.
FORCE_OFF_M_S2, FORCE_FAR_M_S2 = 0.17, 0.5
# Significance: 4 sigma with sigma = sqrt((1.5 standard errors)^2 + 0.03^2); a planted 0.3 was found within 2 sigma.
FORCE_SIGMAS, STANDARD_ERRORS, FORCE_FLOOR_M_S2 = 4.0, 1.5, 0.03
FORCE_LIMIT = (
    f"ok up to {FORCE_OFF_M_S2} m/s^2 or {FORCE_SIGMAS:.0f} sigma, fault above {FORCE_FAR_M_S2} (1 and 3 deg of tilt)"
)
AXES_LIMIT = f"fault: other axes leave {AXES_RATIO:.0f} times less of the force (squared) unexplained"
AXIS_ORDERS: dict[str, Array] = {
    "x and y are exchanged": np.array([[0.0, 1.0], [1.0, 0.0]]),
    "x and y are both reversed": -np.eye(2),
    "x is reversed": np.diag([-1.0, 1.0]),
    "y is reversed": np.diag([1.0, -1.0]),
    "it is turned by 90 deg": np.array([[0.0, -1.0], [1.0, 0.0]]),
    "it is turned by -90 deg": np.array([[0.0, 1.0], [-1.0, 0.0]]),
}


class ForceFit(NamedTuple):
    """Linear fit ``y = columns x`` of horizontal acceleration at ``t`` (n,) s.

    ``columns`` (n, 2, 8): A by rows, b, and a constant tilt of the attitude (two). ``y`` (n, 2) in m/s^2.
    """

    solution: RobustFit
    columns: Array
    y: Array
    t: Array
    seconds: float

    def left(self, order: Array) -> float:
        """Return the median squared residual with a given axes matrix (2, 2), offsets removed."""
        rest = self.y - self.columns[:, :, :4] @ order.ravel()
        rest = rest - self.columns[:, :, 4:] @ np.concatenate([self.solution.x[4:6], self.solution.x[6:8]])
        return float(median(np.sum((rest - median(rest, axis=0)) ** 2, axis=1)))

    @property
    def spread(self) -> float:
        """RMS of the horizontal force about its mean, m/s^2."""
        force = np.stack([self.columns[:, :, 0], self.columns[:, :, 1]])
        size = np.sqrt(np.sum(force**2, axis=2))
        return float(np.sqrt(np.sum(np.var(size, axis=1))))


def accelerometer_checks(case: HealthCase) -> list[Check]:
    """Check axes and offsets of the accelerometers in flight by GNSS.

    The offset is the smoother's bias, else that of a fit with the reference's attitude.
    """
    log, reference = case.log, case.reference or case.rates
    offsets = accelerometer_offsets(case)
    if log.replay_imu is None or not log.gnss or not case.segments.of("airborne"):
        return offsets
    fitted = None if reference is None or reference.kind == "none" else fit_force(log, case.segments, reference)
    if reference is None or fitted is None:
        why = f"Less than {MIN_FLIGHT_S:.0f} s of flight have a GNSS velocity."
        if reference is None or reference.kind == "none":
            why = "No attitude in this log can turn the force to earth."
        return [unknown("force_axes", why, AXES_LIMIT), *offsets]
    axes = _force_axes_check(log, fitted, reference)
    coarse = _force_offset_check(log, fitted, reference)
    finer = bool(offsets) and (offsets[0].verdict != "unknown" or offsets[0].about == CONTRADICTED)
    if axes.verdict == "fault" or coarse.verdict == "unknown" or finer:
        return [axes, *offsets]
    offset, sigma = _fitted_offset(fitted)
    bias = SensorBias(offset, sigma, (True, True, False), len(fitted.t), fitted.seconds, "GNSS and the attitude")
    shown = _confirmations(case, log.replay_imu, bias) if coarse.is_trouble else []
    if _is_contradicted(shown):
        return [axes, _contradicted_offset(log.replay_imu, bias, shown), *offsets[1:]]
    return [axes, coarse, *offsets[1:]]


def _force_axes_check(log: FlightLog, found: ForceFit, reference: Reference) -> Check:
    source = log.imus[log.imu or 0].acc.source
    usual = found.left(np.eye(2))
    name, best = min(((n, found.left(order)) for n, order in AXIS_ORDERS.items()), key=lambda pair: pair[1])
    shown = f"{len(found.t)} changes of the GNSS velocity in {found.seconds:.0f} s of flight"
    if found.spread < MIN_SPREAD_M_S2:
        why = f"The horizontal force hardly changes in flight ({found.spread:.2f} m/s^2)."
        return unknown("force_axes", why, AXES_LIMIT)
    clear = best * AXES_RATIO < usual and np.sqrt(best) < MAX_LEFT_SHARE * found.spread
    if not clear:
        text = f"{source} fits {shown}, turned by {reference.source}."
        return Check("force_axes", "ok", text, round(float(np.sqrt(usual)), 3), "m/s^2", AXES_LIMIT)
    times = np.sqrt(usual / max(best, 1e-12))
    text = f"{source}: {name} against {shown}, turned by {reference.source}; that leaves {times:.1f} times less."
    return Check("force_axes", "fault", text, round(float(np.sqrt(usual)), 3), "m/s^2", AXES_LIMIT)


def _force_offset_check(log: FlightLog, found: ForceFit, reference: Reference) -> Check:
    source = log.imus[log.imu or 0].acc.source
    offset, sigma = (x[:2] for x in _fitted_offset(found))
    worst = int(np.argmax(np.abs(offset) - FORCE_SIGMAS * sigma))
    size, unsure = float(offset[worst]), float(sigma[worst])
    if unsure * FORCE_SIGMAS > FORCE_FAR_M_S2:
        why = f"The flight shows the offset to {1.96 * unsure:.2f} m/s^2 only (95 %)."
        return unknown("accelerometer_offset", why, FORCE_LIMIT)
    verdict = graded(abs(size), max(FORCE_OFF_M_S2, FORCE_SIGMAS * unsure), FORCE_FAR_M_S2)
    text = f"{source} reads {size:+.2f} m/s^2 too much in {'xy'[worst]} ({interval_text(size, unsure, 2)}, 95 %) by "
    text += f"{len(found.t)} changes of the GNSS velocity in {found.seconds:.0f} s, turned by {reference.source}."
    return Check("accelerometer_offset", verdict, text, round(size, 3), "m/s^2", FORCE_LIMIT, sensor=source)


def _fitted_offset(found: ForceFit) -> tuple[Array, Array]:
    """Return offset (3,) and sigma (3,) in m/s^2 of a fit; z is unknown."""
    sigma = np.hypot(STANDARD_ERRORS * found.solution.sigma[4:6], FORCE_FLOOR_M_S2)
    return np.append(-found.solution.x[4:6], 0.0), np.append(sigma, np.inf)


@cached_per_log
def fit_force(log: FlightLog, segments: Segments, reference: Reference) -> ForceFit | None:
    """Fit axes and offset over all flights; None with too little flight with GNSS."""
    imu, gnss = log.replay_imu, max(log.gnss, key=lambda g: np.count_nonzero(_has_velocity(g)), default=None)
    spans = [(a + EDGE_S, min(b - EDGE_S, reference.scoring.end)) for a, b in segments.spans("airborne")]
    spans = _first_spans([(a, b) for a, b in spans if b - a > 2.0 * VELOCITY_SPAN_S], MAX_FLIGHT_S)
    if imu is None or gnss is None or sum(b - a for a, b in spans) < MIN_FLIGHT_S:
        return None
    start, end, change = _velocity_changes(gnss, spans)
    turned = _turned_force(imu, reference, spans)
    if turned is None or len(start) < MIN_FLIGHT_S / VELOCITY_SPAN_S:
        return None
    tilt, best = TILT_M_S2[reference.kind], None
    if reference.fit is not None:
        tilt = max(tilt, STANDARD_GRAVITY * math.radians(reference.fit.sigma_tilt_deg))
    prior = np.array([np.inf] * 6 + [tilt] * 2)
    for late in GNSS_DELAYS_S:
        means, known = turned.means(start - late, end - late)
        t, y = end[known], change[known] - means[known][:, :, 8]
        if len(t) < MIN_FLIGHT_S / VELOCITY_SPAN_S:
            continue
        columns = means[known][:, :, :8]
        solution = robust_fit(t, columns, y, prior)
        if solution is not None and (best is None or solution.scatter < best.solution.scatter):
            best = ForceFit(solution, columns, y, t, float(np.sum(np.minimum(np.diff(t), VELOCITY_SPAN_S))))
    return best


def _first_spans(spans: list[Span], seconds: float) -> list[Span]:
    """Return the first ``seconds`` of spans."""
    kept: list[Span] = []
    for a, b in spans:
        left = seconds - sum(end - begin for begin, end in kept)
        if left > 0.0:
            kept.append((a, min(b, a + left)))
    return kept


def _has_velocity(gnss: Gnss) -> Array:
    return np.asarray((gnss.fix >= FIX_3D) & rotation.finite_rows(gnss.vel_ned[:, :2]))


def _velocity_changes(gnss: Gnss, spans: list[tuple[float, float]]) -> tuple[Array, Array, Array]:
    """Return begin and end (n,) s of velocity pairs, and mean accelerations (n, 2) between."""
    use = _has_velocity(gnss).astype(bool)
    t, first = np.unique(gnss.t[use], return_index=True)
    velocity = gnss.vel_ned[use][first, :2]
    none = np.zeros(0, np.int64)
    starts, ends = [none], [none]
    for a, b in spans:
        mine = np.flatnonzero((t >= a) & (t <= b))
        if len(mine) < 3:
            continue
        every = max(1, round(0.5 * VELOCITY_SPAN_S / max(float(median(np.diff(t[mine]))), 1e-3)))
        i = mine[::every]
        j = np.searchsorted(t, t[i] + VELOCITY_SPAN_S - 1e-6)
        good = (j <= mine[-1]) & (t[np.minimum(j, len(t) - 1)] - t[i] < 1.5 * VELOCITY_SPAN_S)
        starts.append(i[good])
        ends.append(j[good])
    i, j = np.concatenate(starts), np.concatenate(ends)
    return t[i], t[j], (velocity[j] - velocity[i]) / (t[j] - t[i])[:, None]


class TurnedForce:
    """Prefix sums of the force's components in earth axes, for means over any span."""

    def __init__(self, t: Array, force: Array, q: Array) -> None:
        dt = np.diff(t, prepend=t[0])
        self.t, self.hole = t, np.cumsum(dt > MAX_HOLE_S)
        self.sums, dt = np.zeros((len(t), 18)), np.minimum(dt, MAX_HOLE_S)
        turn, sums = rotation.to_matrix(q), self.sums.reshape(-1, 2, 9)
        for axis in (0, 1):  # a column at a time: in long logs copies add up
            x, y, z = turn[:, axis].T
            for k, (row, j) in enumerate(((x, 0), (x, 1), (y, 0), (y, 1))):
                sums[:, axis, k] = np.cumsum(row * force[:, j] * dt)
            sums[:, axis, 4], sums[:, axis, 5] = np.cumsum(x * dt), np.cumsum(y * dt)
            sums[:, axis, 6 + axis], sums[:, axis, 8] = np.cumsum(dt), np.cumsum(z * force[:, 2] * dt)

    def means(self, start: Array, end: Array) -> tuple[Array, Array]:
        """Return means (n, 2, 9) over spans, and a mask (n,) of spans without gaps."""
        i = np.clip(np.searchsorted(self.t, [start, end]), 1, len(self.t) - 1)
        known = (start > self.t[0]) & (end < self.t[-1]) & (self.hole[i[0]] == self.hole[i[1]])
        share = [(x - self.t[k - 1]) / (self.t[k] - self.t[k - 1]) for x, k in ((start, i[0]), (end, i[1]))]
        first, last = (
            self.sums[k - 1] + s[:, None] * (self.sums[k] - self.sums[k - 1])
            for s, k in zip(share, (i[0], i[1]), strict=True)
        )
        return ((last - first) / (end - start)[:, None]).reshape(-1, 2, 9), known


def _turned_force(imu: Imu, reference: Reference, spans: list[Span]) -> TurnedForce | None:
    """Rotate the force to earth axes by the reference's attitude, in and before ``spans``."""
    trim = reference.alignment.trim
    own = reference.q if trim is None else alignment.apply_trim(reference.q, -trim)
    near = inside(imu.acc.t_best, [(a - GNSS_DELAYS_S[-1] - EDGE_S, b) for a, b in spans])
    t, force = imu.acc.t_best[near], imu.acc.x[near]
    q, _ = rotation.slerp_in_segments(reference.t, own, reference.gap_segment, t)
    good = rotation.finite_rows(q) & rotation.finite_rows(force)
    t, first = np.unique(t[good], return_index=True)
    return None if len(t) < MIN_FORCE_SAMPLES else TurnedForce(t, force[good][first], q[good][first])


# Offset of each accelerometer in flight, and the parameters that remove it. The replayed IMU's bias is the smoother's;
# without one, a fit with the reference's attitude (truth or smoother) gives the horizontal axes. The bias of another
# IMU is this bias plus the mean difference. Vibration shifts an accelerometer in flight only, so a vertical offset must
# be confirmed at rest on the ground.

# Offset limits (warning, fault): 1 and 3 deg of tilt horizontally; along z as for the size of gravity at rest.
OFFSET_OFF_M_S2, OFFSET_FAR_M_S2 = np.array([0.17, 0.17, 0.3]), np.array([0.5, 0.5, 1.0])
# Offered from 4 sigma up to this size: beyond it the smoother's prior biases the result (4.5 gave 3.5).
OFFSET_SIGMAS, MAX_OFFSET_M_S2 = 4.0, 1.0
# 3 deg of tilt: smaller differences of two IMUs may come from mounting.
MOUNTING_M_S2 = 0.5
# Tolerance for the same offset at rest and in the onboard estimator: ground is level within 1 deg or so.
CONFIRMED_SHARE = 0.5
# Tolerance for the vertical offset at rest: 0.1 m/s^2 or this share of it.
GROUND_M_S2, GROUND_SHARE = 0.1, 0.3
OFFSET_LIMIT = "ok up to 0.17 m/s^2 horizontally, 0.3 along z, or 4 sigma; fault above 0.5 and 1 m/s^2"
OFFSET_SOURCE = "1 and 3 deg of tilt; total error measured on 24 flights with truth"
TURN_ADVICE = "Fly a minute with GNSS: turn slowly through 360 deg and accelerate in several directions."
# A level calibration done with the offset contains it, so it must be repeated after removing the offset.
SET_ADVICE = "Set the offsets, then calibrate the level; or calibrate the accelerometer in six positions."


def accelerometer_offsets(case: HealthCase) -> list[Check]:
    """Check the offset of each accelerometer in flight; one ``unknown`` where none is known."""
    units = usable_imus(case)
    if not units:
        return []
    own, why = _replayed_bias(case)
    if own is None or not any(own.known):
        found = unknown("accelerometer_offset", why, OFFSET_LIMIT, sensor=units[0].acc.source, source=OFFSET_SOURCE)
        found.action = TURN_ADVICE
        return [found]
    if units[0] is not case.log.replay_imu:
        return []
    biases = [(imu, bias) for imu in units if (bias := _imu_bias(case, own, units[0], imu)) is not None]
    checks = [_offset_check(case, imu, bias, own) for imu, bias in biases]
    return [one for k, one in enumerate(checks) if k == 0 or one.verdict != "unknown"]


def _replayed_bias(case: HealthCase) -> tuple[SensorBias | None, str]:
    """Return the bias of the replayed unit, or why it is not known."""
    if not flight_spans(case.segments):
        return None, "The vehicle does not fly in this log, so GNSS shows no offset."
    found, reference = smoothed_acc_bias(case), case.reference
    if found is not None and any(found.known):
        return found, ""
    kinds = ("truth", "smoother") if found is None else ("truth",)  # not by a smoother whose own bias is unknown
    if reference is not None and reference.kind in kinds:
        fitted = fit_force(case.log, case.segments, reference)
        if fitted is not None:
            sigma = np.append(np.hypot(STANDARD_ERRORS * fitted.solution.sigma[4:6], FLOOR_M_S2[:2]), np.inf)
            mean = np.append(-fitted.solution.x[4:6], 0.0)
            level = bool(OFFSET_SIGMAS * sigma[:2].max() <= OFFSET_FAR_M_S2[0])
            known, by = (level, level, False), f"GNSS and {reference.source}"
            return SensorBias(mean, sigma, known, len(fitted.t), fitted.seconds, by), _turned_too_little(sigma)
    if found is not None:
        return found, _turned_too_little(found.sigma)
    return None, "No velocity by GNSS in flight that a smoother could use, so no offset."


def _turned_too_little(sigma: Array) -> str:
    return f"The flight turns too little: the offset is known to ± {1.96 * sigma[:2].max():.2f} m/s^2 only (95 %)."


def _imu_bias(case: HealthCase, own: SensorBias, replayed: Imu, imu: Imu) -> SensorBias | None:
    """Return the bias of an IMU: the replayed one's plus the mean difference in flight."""
    if imu is replayed:
        return own
    if imu.acc.rate < MIN_FLOWN_HZ:
        return None
    more = difference_in_flight(case, "acc", replayed, imu)
    if more is None:
        return None
    return own._replace(mean=own.mean + more.middle, sigma=np.hypot(own.sigma, more.sigma(0.0)))


def offset_limits(bias: SensorBias) -> Array:
    """Return the limits (3,) in m/s^2 above which an offset is significant."""
    return np.asarray(np.maximum(OFFSET_OFF_M_S2, OFFSET_SIGMAS * bias.sigma))


def offset_axes(bias: SensorBias) -> NDArray[np.bool_]:
    """Mark the axes (3,) with a significant offset."""
    return np.asarray(np.array(bias.known) & (np.abs(bias.mean) > offset_limits(bias)))


def _offset_check(case: HealthCase, imu: Imu, bias: SensorBias, own: SensorBias) -> Check:
    """Check the offset of an IMU; ``own``: bias of the replayed IMU."""
    known, limits, off = np.array(bias.known), offset_limits(bias), offset_axes(bias)
    worst = int(np.argmax(np.where(known, np.abs(bias.mean) / limits, -1.0)))
    size, sigma = float(bias.mean[worst]), float(bias.sigma[worst])
    verdict: Verdict = graded(abs(size), float(limits[worst]), max(float(OFFSET_FAR_M_S2[worst]), float(limits[worst])))
    source = imu.acc.source
    if off.any():
        also = ", offset or scale" if worst == 2 else ""
        text = f"{source} is off by {size:+.2f} m/s^2 along {'xyz'[worst]} "
        text += f"({interval_text(size, sigma, 2)}, 95 %) in flight{also}."
    elif known.all():
        text = f"{source} is off by {axes_text(bias.mean)} m/s^2 in flight, which is little."
    else:
        verdict = "unknown"
        axes, others = (" and ".join("xyz"[k] for k in np.flatnonzero(which)) for which in (known, ~known))
        text = f"The flight turns too little to show the offset of {source} along {others}; along {axes} it is small."
    check = Check("accelerometer_offset", verdict, text, unit="m/s^2", threshold=OFFSET_LIMIT, sensor=source)
    check.n, check.seconds, check.source = bias.n, round(bias.seconds, 1), OFFSET_SOURCE
    check.action, check.evidence = TURN_ADVICE if verdict == "unknown" else "", _evidence(case, imu, bias)
    check.measure(size, sigma, 3)
    if known.all():
        check.measure_axes(bias.mean, bias.sigma, 3)
    if off.any():
        rest, onboard = shown = _confirmations(case, imu, bias)
        if _is_contradicted(shown):
            return replace(_contradicted_offset(imu, bias, shown), evidence=check.evidence)
        check.why_no_setting = _refusal(case, imu, bias, own)
        if not check.why_no_setting and rest is not True:
            check.why_no_setting = "No reading at rest shows the same offset. Log before arming, on level ground."
        if not check.why_no_setting and onboard is False:
            check.why_no_setting = "The onboard estimator subtracts another bias; six positions show which is right."
        if not check.why_no_setting:
            offered = accelerometer_proposal(case.log, imu, np.where(off, bias.mean, 0.0))
            check.settings, check.why_no_setting = offered.settings, offered.refused
        check.action = SET_ADVICE if check.settings else case.log.remedy("accelerometer")
    return check


def _refusal(case: HealthCase, imu: Imu, bias: SensorBias, own: SensorBias) -> str:
    """Return why no parameters are offered for an offset; empty where they are."""
    off = offset_axes(bias)
    if float(np.abs(own.mean[np.array(own.known)]).max()) > MAX_OFFSET_M_S2:
        return "Above 1 m/s^2 a flight does not show it exactly; six positions do."
    if imu is not case.log.replay_imu and (off & (np.abs(bias.mean) < MOUNTING_M_S2))[:2].any():
        return "A unit that is mounted 1 to 3 deg off level reads the same; six positions show which."
    flew = case.log.imu_that_flew
    if flew is not None and len(set(flew.value)) > 1:
        return "The unit in use changed, and the offset of each is not known."
    if case.trouble("vibration_level"):
        return "Vibration as strong as here shifts an accelerometer too. Reduce it first, then fly again."
    if case.trouble("force_axes"):
        return "Its axes are exchanged or reversed: correct these first."
    if off[2]:
        ground = ground_excess(case, imu, bias)
        if ground is None:
            return "No rest on the ground confirms the vertical offset. Log before arming."
        shown, foreseen = ground
        if abs(shown - foreseen) > max(GROUND_M_S2, GROUND_SHARE * abs(float(bias.mean[2]))):
            return (
                f"The force on the ground is {shown:+.2f} m/s^2 off gravity, not {foreseen:+.2f}: no constant offset."
            )
    return ""


# Mark of an offset by the flight that rest or the onboard estimator contradicts.
CONTRADICTED = "contradicted"


def _is_contradicted(shown: Sequence[bool | None]) -> bool:
    """Return whether at least one of rest and onboard estimator contradicts an offset, and none confirms it."""
    return False in shown and True not in shown


def _contradicted_offset(imu: Imu, bias: SensorBias, shown: Sequence[bool | None]) -> Check:
    """Return the unknown check of an offset that only the flight shows, by what :func:`_confirmations` found."""
    worst = int(np.argmax(np.where(offset_axes(bias), np.abs(bias.mean), -1.0)))
    why = f"By {bias.by} it is off by {bias.mean[worst]:+.2f} m/s^2 along {'xyz'[worst]}; "
    others = [name for name, shows in zip(("rest", "the onboard bias"), shown, strict=True) if shows is False]
    why += f"{' and '.join(others)} {'do' if len(others) > 1 else 'does'} not show it."
    check = unknown("accelerometer_offset", why, OFFSET_LIMIT, sensor=imu.acc.source, source=OFFSET_SOURCE)
    check.about, check.action = CONTRADICTED, TURN_ADVICE
    return check


def _confirmations(case: HealthCase, imu: Imu, bias: SensorBias) -> list[bool | None]:
    """Return whether rest and the onboard estimator show the significant offsets; None where not logged.

    A vehicle that rests tilted by 3 deg or more beyond the offset (a tail wheel, a slope) shows nothing of it.
    """
    off = offset_axes(bias)
    near = np.maximum(CONFIRMED_SHARE * np.abs(bias.mean), 1.96 * bias.sigma)
    still = stream_blocks(imu.acc, still_spans(case.segments)[0])
    rest = None
    if still is not None and np.hypot(*still.middle[:2]) <= np.hypot(*bias.mean[:2]) + MOUNTING_M_S2:
        level = bool(np.all(np.abs(still.middle - bias.mean)[:2][off[:2]] <= near[:2][off[:2]]))
        ground = ground_excess(case, imu, bias) if off[2] else None
        rest = level and (ground is None or abs(ground[0] - ground[1]) <= float(near[2]))
    own, most = onboard_bias(case, imu), _largest_learned(case.log)
    foreseen = np.clip(bias.mean, -most, most)
    near = np.maximum(CONFIRMED_SHARE * np.abs(foreseen), 1.96 * bias.sigma)
    return [rest, None if own is None else bool(np.all(np.abs(own - foreseen)[off] <= near[off]))]


# Parameters that limit the accelerometer bias of the EKF, m/s^2.
LEARNED_LIMITS = ("EKF2_ABL_LIM", "EK3_ACC_BIAS_LIM")


def _largest_learned(log: FlightLog) -> float:
    """Return the largest bias in m/s^2 that the onboard estimator learns, infinity if unknown."""
    known = [limit for name in LEARNED_LIMITS if (limit := log.param(name)) is not None and limit > 0.0]
    return float(known[0]) if known else math.inf


def onboard_bias(case: HealthCase, imu: Imu) -> Array | None:
    """Return the accelerometer bias (3,) m/s^2 that the onboard estimator learned; None if none or of another unit."""
    learned = case.log.estimator.acc_bias
    if learned is None or imu is not case.log.replay_imu or not len(learned.x):
        return None
    own = nanmedian(learned.x[len(learned.x) // 2 :], axis=0)
    return np.asarray(own) if np.isfinite(own).all() and own.any() else None


@cached_per_log
def ground_excess(case: HealthCase, imu: Imu, bias: SensorBias) -> tuple[float, float] | None:
    """Return force at rest minus gravity in m/s^2, measured and expected from ``bias``."""
    size = gravity.size_at_rest(case, imu)
    if size is None:
        return None
    shown = stream_blocks(imu.acc, still_spans(case.segments)[0])
    if shown is None:
        return None
    along = shown.middle / max(float(size.middle[0]), 1e-9)
    mean = np.where(np.array(bias.known), bias.mean, 0.0)
    return float(size.middle[0]) - expected_gravity(case.log), float(along @ mean)


def _evidence(case: HealthCase, imu: Imu, bias: SensorBias) -> list[str]:
    evidence = [f"By {bias.by}, {bias.seconds:.0f} s."]
    if bias.known[2] and (ground := ground_excess(case, imu, bias)) is not None:
        shown, expected = ground
        evidence.append(
            f"The force on the ground is {shown:+.2f} m/s^2 off gravity; this offset makes {expected:+.2f}."
        )
    if (own := onboard_bias(case, imu)) is not None:
        evidence.append(f"The onboard estimator subtracts {axes_text(own)} m/s^2.")
    return evidence
