"""Offset of each compass in flight by an attitude from motion alone.

Model ``m = R' h + o``: R attitude from motion alone, h the earth's field by the world magnetic model, o the offset. A
smoother that uses the compass absorbs part of its error (offsets wrong by 79 mG, against 9 to 22 mG without compass).
Heading from motion needs GNSS acceleration; without it sigma is too small (85 to 132 deg wrong at 1.8 to 5 deg).

An offset fitted in flight includes the motors' field. As a parameter it turned the heading on the ground, where the
estimator aligns its yaw, by up to 180 deg. So the ground must confirm the offset, and it must improve the heading in
cross-validation between both halves of the flight.
"""

from __future__ import annotations

import math
from itertools import pairwise
from typing import Literal, NamedTuple

import numpy as np
from numpy.typing import NDArray

from attlog.core import rotation
from attlog.core.earth import MagneticField
from attlog.core.log_cache import cached_per_log
from attlog.core.sorting import median
from attlog.core.spans import Span, inside
from attlog.estimators.evidence import velocity_steps
from attlog.flight import compass
from attlog.flight.model import Array, FlightLog, Mag, TimeLine
from attlog.health import settings
from attlog.health.check import Check, HealthCase, MotionAttitude, Verdict
from attlog.health.compass_turn import MODEL_SIZE_ERROR, STANDARD_ERRORS, TILT_RAD, TURN_OFF_DEG, fit_simplest
from attlog.health.flown import UPSIDE_DOWN_DEG, crash_spans, flight_before_crash
from attlog.health.regression import robust_fit
from attlog.reference import alignment
from attlog.segments.model import Segments

Mask = NDArray[np.bool_]
Cause = Literal["offset", "turn", "neither"]

# Time before take-off and after landing used as ground.
GROUND_S = 20.0
# Maximum power of idle motors, relative to hover; their field is negligible.
IDLE_SHARE = 0.25
# Maximum heading sigma of the attitude for a sample to count.
MAX_SIGMA_HEADING_RAD = np.radians(5.0)
# Maximum samples: attitude errors are correlated over seconds, so more add no information.
MAX_FLIGHT_SAMPLES, MAX_GROUND_SAMPLES = 2000, 400
# Minimum samples and time on the ground, to exclude short disturbances.
MIN_GROUND_SAMPLES, MIN_GROUND_S = 10, 2.0


class FieldSamples(NamedTuple):
    """Samples of one compass at ``t`` (n,) s: in the ``air``, ``before`` take-off, ``after`` landing (masks).

    ``measured`` and ``expected`` (n, 3) uT in body axes: the logged field, and the earth's (``earth``, (3,) uT NED)
    turned by the attitude ``q`` (n, 4) with ``sigma_heading`` (n,) rad. ``power`` (n,): current in A or throttle (0 to
    1) by ``power_kind``, NaN where unknown; ``hover``: its median in the air. ``seconds`` in the air.
    """

    mag: Mag
    t: Array
    measured: Array
    expected: Array
    q: Array
    sigma_heading: Array
    power: Array
    air: Mask
    before: Mask
    after: Mask
    earth: Array
    hover: float
    power_kind: compass.MotorPower
    seconds: float

    @property
    def source(self) -> str:
        """The compass's name in the log."""
        return self.mag.field.source

    @property
    def error(self) -> Array:
        """Measured minus expected field (n, 3), uT in body axes."""
        return self.measured - self.expected

    def mean_power(self, use: Mask) -> float:
        """Return the median power of selected samples; 0 where unknown (motors never ran)."""
        known = self.power[use & np.isfinite(self.power)]
        return float(median(known)) if len(known) else 0.0


def field_samples(case: HealthCase, mag: Mag, motion: MotionAttitude, model: MagneticField) -> FieldSamples | None:
    """Return the samples of a compass with known heading; None without any in flight."""
    t, field = mag.field.t_best, 1e6 * mag.field.x
    flown = flight_before_crash(case.segments)
    good = rotation.finite_rows(field) & np.isfinite(t)
    air = thinned(good & inside(t, flown), MAX_FLIGHT_SAMPLES)
    ground = [thinned(good & inside(t, spans), MAX_GROUND_SAMPLES) for spans in ground_spans(case.segments)]
    kind, drive = compass.motor_drive(case.log)
    in_flight = compass.power_at(drive, t[air])
    hover = float(median(in_flight[np.isfinite(in_flight)])) if np.isfinite(in_flight).any() else math.nan
    where = np.flatnonzero(air | ground[0] | ground[1])
    q, sample = rotation.slerp_in_segments(motion.t, motion.q, motion.segment, t[where])
    sigma = motion.sigma_heading[np.clip(sample, 0, len(motion.t) - 1)]
    known = rotation.finite_rows(q) & (sigma <= MAX_SIGMA_HEADING_RAD)
    known[known] &= np.degrees(rotation.tilt_angle(q[known])) < UPSIDE_DOWN_DEG
    where, q, sigma = where[known], q[known], sigma[known]
    if not air[where].any():
        return None
    earth = 1e6 * np.array(model.ned_t)
    power = compass.power_at(drive, t[where])
    idle = _idle_motors(case.log.state.armed, t[where], power, hover)
    rests = [mask[where] & idle for mask in ground]
    for rest in rests:
        if rest.sum() < MIN_GROUND_SAMPLES or np.ptp(t[where][rest]) < MIN_GROUND_S:
            rest[:] = False
    return FieldSamples(
        mag=mag,
        t=t[where],
        measured=field[where],
        expected=rotation.rotate_inverse(q, earth),
        q=q,
        sigma_heading=sigma,
        power=power,
        air=air[where],
        before=rests[0],
        after=rests[1],
        earth=earth,
        hover=hover,
        power_kind=kind,
        seconds=np.count_nonzero(air[where]) / int(np.count_nonzero(air)) * sum(b - a for a, b in flown),
    )


def ground_spans(segments: Segments) -> tuple[list[Span], list[Span]]:
    """Return spans before the first take-off and, without a crash, after the last landing."""
    flown = segments.spans("airborne")
    if not flown:
        return [], []
    first, last = flown[0][0], flown[-1][1]
    return [(first - GROUND_S, first)], [] if crash_spans(segments) else [(last, last + GROUND_S)]


def _idle_motors(armed: TimeLine | None, t: Array, power: Array, hover: float) -> Mask:
    """Mark times with motors off or idle: by power, else by disarming."""
    off = np.zeros(len(t), bool)
    if armed is not None and len(armed.value):
        k = np.clip(np.searchsorted(armed.t, t, side="right") - 1, 0, None)
        off = ~np.array([bool(v) for v in armed.value])[k]
    if not np.isfinite(hover) or hover <= 0:
        return off
    return np.asarray(np.where(np.isfinite(power), power < IDLE_SHARE * hover, off))


def thinned(use: Mask, most: int) -> Mask:
    """Select at most ``most`` of the marked samples, evenly."""
    where = np.flatnonzero(use)
    kept = np.zeros(len(use), bool)
    kept[where[:: max(1, -(-len(where) // most))]] = True
    return kept


# Minimum flight time with known heading.
MIN_HEADING_S = 30.0
# Minimum horizontal acceleration (RMS over 1 s) that determines the heading.
MIN_ACCELERATION_M_S2 = 0.25
# Typical delay of GNSS velocity (the RMS is insensitive to it), and correlation time of tilt errors.
GNSS_DELAY_S, TILT_ERROR_S = 0.1, 30.0
FLY_ADVICE = "Fly forward, stop hard, turn and repeat for a minute."


def reason_no_heading(case: HealthCase) -> str:
    """Return why motion gives no heading to check compasses, with advice; else empty."""
    if case.log.replay_imu is None:
        return "No inertial unit of this log can be replayed, so nothing judges the compass."
    flown = flight_before_crash(case.segments)
    if not flown:
        return "The log holds no flight in which the compass can be judged."
    if alignment.earth_field(case.log) is None:
        return "The log holds no position, so the earth's field is unknown."
    motion = case.motion
    if motion is None:
        return "Without GNSS velocity nothing but the compass shows the heading."
    air = inside(motion.t, flown)
    if not air.any() or not np.isfinite(motion.sigma_heading[air]).any():
        return "No attitude by motion covers the flight."
    if np.min(motion.sigma_heading[air]) >= np.pi:
        why = str(motion.quality.get("heading_why", "something contradicts it"))
        return f"Motion shows no heading that can be trusted: {why}."
    moved = horizontal_acceleration(case.log, motion, flown)
    if not moved >= MIN_ACCELERATION_M_S2:
        needed = f"{MIN_ACCELERATION_M_S2} needed"
        return f"Horizontal acceleration of {moved:.2f} m/s^2 shows no heading ({needed}). {FLY_ADVICE}"
    return ""


def horizontal_acceleration(log: FlightLog, motion: MotionAttitude, flown: list[Span]) -> float:
    """Return the smaller RMS of horizontal acceleration in m/s^2 by GNSS and by the force.

    GNSS acceleration contains noise and the force slow tilt errors (its mean over 30 s is removed), hence the smaller.
    """
    imu = log.replay_imu
    receiver = next((r for r in log.gnss if np.isfinite(r.vel_ned).any()), None)
    if imu is None or receiver is None:
        return 0.0
    near = inside(imu.acc.t_best, [(a - 2.0, b + 2.0) for a, b in flown])
    t, acc = imu.acc.t_best[near], imu.acc.x[near]
    q, _ = rotation.slerp_in_segments(motion.t, motion.q, motion.segment, t)
    steps = velocity_steps(t, acc, q, receiver.t, receiver.vel_ned, np.array(flown))
    if not len(steps.t0):
        return 0.0
    force = steps.force(GNSS_DELAY_S)
    _, number = np.unique(steps.t0 // TILT_ERROR_S, return_inverse=True)
    count = np.bincount(number)
    force = force - ((np.bincount(number, force.real) + 1j * np.bincount(number, force.imag)) / count)[number]
    seconds = np.maximum(steps.t1 - steps.t0, 0.1)
    return float(min(np.sqrt(np.mean(np.abs(x / seconds) ** 2)) for x in (steps.gnss, force)))


# Offset in uT in body axes, and its total error: of the fit, of heading and tilt, of the field model.

# Huber threshold in robust deviations (tuned on 98 compasses).
HUBER = 2.5
# Systematic error of compass and model: 3 mG.
SYSTEMATIC_ERROR_UT = 0.3
# Parts of a flight whose offsets are compared, their least length and samples.
PARTS, PART_S, MIN_PART_SAMPLES = 3, 10.0, 10
# Significance of an offset: 4 total sigma and 15 mG. None of 39 simulated flights without offset exceeds it; with 4
# sigma of the fit alone 29 do.
OFFSET_SIGMAS, MIN_OFFSET_UT = 4.0, 1.5


class OffsetFit(NamedTuple):
    """Offset (3,) uT of a compass in body axes with its total error ``sigma`` (3,).

    ``left_ut``: residual RMS; ``n`` samples in ``blocks`` of 5 s.
    """

    offset: Array
    sigma: Array
    left_ut: float
    n: int
    blocks: int

    @property
    def size(self) -> float:
        """Length of the offset, uT."""
        return float(np.sqrt(np.sum(self.offset**2)))

    @property
    def size_sigma(self) -> float:
        """Error of the length, uT."""
        return float(np.sqrt(np.sum((self.offset * self.sigma) ** 2))) / max(self.size, 1e-9)

    @property
    def counts(self) -> bool:
        """True if any axis has a significant offset."""
        return bool(np.any(np.abs(self.offset) > np.maximum(OFFSET_SIGMAS * self.sigma, MIN_OFFSET_UT)))


def fit_offset(samples: FieldSamples, use: Mask) -> OffsetFit | None:
    """Fit the offset to selected samples; None from fewer than two."""
    t, error = samples.t[use], samples.error[use]
    if len(t) < 2:
        return None
    found = robust_fit(t, np.broadcast_to(np.eye(3), (len(t), 3, 3)), error, huber=HUBER)
    if found is None:
        return None
    heading = float(np.sqrt(np.mean(samples.sigma_heading[use] ** 2)))
    sigma = total_sigma(np.maximum(found.sigma, parts_error(t, error)), heading, samples.earth)
    left = float(np.sqrt(np.mean(np.sum((error - found.x) ** 2, axis=1))))
    return OffsetFit(found.x, sigma, left, len(t), found.blocks)


def parts_error(t: Array, error: Array) -> Array:
    """Return the standard error (3,) of a mean by its scatter over three parts of the flight.

    Errors of heading, motors and place last for longer than blocks of 5 s. Zero for less than three parts of PART_S.
    """
    edges = np.linspace(t[0], t[-1], PARTS + 1)
    found = [error[(t >= a) & (t <= b)] for a, b in pairwise(edges)]
    if t[-1] - t[0] < PARTS * PART_S or min(map(len, found)) < MIN_PART_SAMPLES:
        return np.zeros(3)
    return np.asarray(np.std([median(x, axis=0) for x in found], axis=0, ddof=1) / math.sqrt(PARTS))


def total_sigma(standard: Array, sigma_heading: float, earth: Array) -> Array:
    """Return the total sigma (3,) in uT of an offset, for a mostly level vehicle.

    ``standard`` (3,) uT: standard errors of the fit; ``sigma_heading`` rad; ``earth`` (3,) uT NED.
    """
    level, down = math.hypot(earth[0], earth[1]), abs(float(earth[2]))
    across = math.hypot(sigma_heading * level, TILT_RAD * down)
    along = math.hypot(TILT_RAD * level, MODEL_SIZE_ERROR * math.hypot(level, down))
    fitted = STANDARD_ERRORS * standard
    return np.asarray(np.sqrt(fitted**2 + np.array([across, across, along]) ** 2 + SYSTEMATIC_ERROR_UT**2))


# Cross-validated heading errors of a compass before and after a correction.

# Required improvement: by 30 % and 1 deg, to below 12 deg.
MIN_IMPROVEMENT, MIN_IMPROVEMENT_DEG, MAX_HEADING_ERROR_DEG = 0.3, 1.0, 12.0


class HeadingProof(NamedTuple):
    """Cross-validated RMS heading error in deg ``before`` and ``after`` a correction."""

    before: float
    after: float

    @property
    def holds(self) -> bool:
        """True if the correction improves the heading enough."""
        least = max(MIN_IMPROVEMENT * self.before, MIN_IMPROVEMENT_DEG)
        return self.before - self.after >= least and self.after < MAX_HEADING_ERROR_DEG

    @property
    def sentence(self) -> str:
        """Both errors in words."""
        return f"Heading error on the half not fitted: {self.before:.1f} deg before, {self.after:.1f} deg after."


def heading_error(q: Array, field: Array, earth: Array) -> Array:
    """Return the heading error (n,) in rad of a tilt-compensated compass at attitudes ``q`` (n, 4).

    ``field`` (n, 3) in body axes and the earth's ``earth`` (3,) NED in the same unit.
    """
    seen = rotation.rotate(q, field)
    # A field rotated clockwise (to the east) gives a heading that is too small.
    return -rotation.wrap(np.arctan2(seen[:, 1], seen[:, 0]) - math.atan2(earth[1], earth[0]))


def rms_deg(angle: Array) -> float:
    """Return the RMS in deg of angles (n,) in rad."""
    return math.degrees(float(np.sqrt(np.mean(angle**2)))) if len(angle) else math.nan


def cross_validate(samples: FieldSamples, parts: tuple[Mask, Mask], error: tuple[Array, Array]) -> HeadingProof:
    """Return heading errors of two parts, each corrected by the fit to the other.

    ``error``: compass errors (n, 3) in uT by the fits to both parts.
    """
    before, after = [], []
    for part, other in zip(parts, reversed(error), strict=True):
        q, field = samples.q[part], samples.measured[part]
        before.append(heading_error(q, field, samples.earth))
        after.append(heading_error(q, field - other[part], samples.earth))
    return HeadingProof(rms_deg(np.concatenate(before)), rms_deg(np.concatenate(after)))


# Study of one compass: offset in the air and on the ground, and motor field.

# Minimum field strength, and minimum standard deviation of an axis in flight (3 mG), of a live compass.
MIN_ALIVE_UT, MIN_MOVING_UT = 5.0, 0.3
# Tolerance between fields before take-off and after landing: 25 mG or a fifth of the change in flight.
GROUND_REPEATS_UT, GROUND_REPEATS_SHARE = 2.5, 0.2
# Tolerance between offsets of both halves of the flight: 40 % of the offset or 3 sigma.
HALVES_SHARE, HALVES_SIGMAS = 0.4, 3.0
# Ground and air differ beyond 4 sigma and 20 mG. The ground confirms an offset within half of its horizontal size.
GROUND_UT, GROUND_SHARE = 2.0, 0.5
# Tolerance by which the motor model may be worse than a constant offset: with nearly constant power both fit equally.
MOTORS_AS_GOOD, MOTORS_AS_GOOD_DEG = 1.1, 0.5
# Minimum rise of power from ground to flight, relative to its median in flight.
MIN_POWER_RISE = 0.5


class MotorField(NamedTuple):
    """Magnetic field of the motors: ``per_unit`` (3,) uT per ampere or at full throttle.

    ``power`` (A, or 0 to 1): power in flight minus that on the ground. ``offset`` (3,) uT: field without power.
    """

    per_unit: Array
    power: float
    offset: Array

    def at(self, samples: FieldSamples) -> Array:
        """Return the error (n, 3) uT of the compass at every sample."""
        power = np.nan_to_num(samples.power, nan=samples.hover)
        return np.asarray(self.offset + power[:, None] * self.per_unit)


class CompassStudy(NamedTuple):
    """Study of one compass: offsets in the air, and on the ground with motors off.

    ``before``, ``after``, ``ground``: before take-off, after landing, and both. ``steady``: the offsets of both halves
    of the flight agree. ``cause``: single cause that explains the field in flight: offset, turn, or neither.
    ``motors``: None without ground or power.
    """

    samples: FieldSamples
    air: OffsetFit
    before: OffsetFit | None
    after: OffsetFit | None
    ground: OffsetFit | None
    steady: bool
    cause: Cause
    proof: HeadingProof
    motors: MotorField | None
    motor_proof: HeadingProof | None

    @property
    def ground_agrees(self) -> bool:
        """True if the ground confirms the horizontal offset in the air."""
        if self.ground is None or self.ground_differs:
            return False
        apart = self.air.offset - self.ground.offset
        level = float(np.hypot(self.air.offset[0], self.air.offset[1]))
        return float(np.hypot(apart[0], apart[1])) <= max(GROUND_UT, GROUND_SHARE * level)

    @property
    def ground_differs(self) -> bool:
        """True if offsets on the ground and in the air differ significantly."""
        return bool(self.ground_differs_along.any())

    @property
    def ground_differs_along(self) -> Mask:
        """Axes (3,) along which ground and air differ."""
        if self.ground is None:
            return np.zeros(3, bool)
        limit = np.maximum(OFFSET_SIGMAS * self.air.sigma, GROUND_UT)
        return np.asarray(np.abs(self.air.offset - self.ground.offset) > limit)

    @property
    def follows_motors(self) -> bool:
        """True if the motor model improves the heading at least as well as a constant offset."""
        one, other = self.motor_proof, self.proof
        return one is not None and one.holds and one.after <= MOTORS_AS_GOOD * other.after + MOTORS_AS_GOOD_DEG

    @property
    def ground_repeats(self) -> bool:
        """True if the offsets before take-off and after landing agree."""
        if self.before is None or self.after is None or self.ground is None:
            return False
        apart = float(np.linalg.norm(self.before.offset - self.after.offset))
        added = float(np.linalg.norm(self.air.offset - self.ground.offset))
        return apart <= max(GROUND_REPEATS_UT, GROUND_REPEATS_SHARE * added)


@cached_per_log
def compass_studies(case: HealthCase) -> tuple[list[CompassStudy], str]:
    """Return the studies of all compasses, and the reason where there are none."""
    why = reason_no_heading(case)
    model = alignment.earth_field(case.log)
    if why or case.motion is None or model is None:
        return [], why
    found: list[CompassStudy] = []
    for mag in case.log.mags:
        if compass.dead_reason(mag, case.log.replay_imu):
            continue
        samples = field_samples(case, mag, case.motion, model)
        if samples is None or samples.seconds < MIN_HEADING_S:
            continue
        field = samples.measured[samples.air]
        alive = median(np.linalg.norm(field, axis=1)) > MIN_ALIVE_UT and (np.std(field, axis=0) > MIN_MOVING_UT).any()
        if alive and (study := study_samples(samples)) is not None:
            found.append(study)
    if not found:
        why = f"No compass has {MIN_HEADING_S:.0f} s in flight with a heading known to 5 deg. {FLY_ADVICE}"
    return found, why


def study_samples(samples: FieldSamples) -> CompassStudy | None:
    """Fit the offsets and motor field of one compass; None where flight data is too little."""
    middle = np.cumsum(samples.air) <= np.count_nonzero(samples.air) // 2
    parts = samples.air & middle, samples.air & ~middle
    air, first, second = (fit_offset(samples, use) for use in (samples.air, *parts))
    if air is None or first is None or second is None:
        return None
    before, after = fit_offset(samples, samples.before), fit_offset(samples, samples.after)
    ground = fit_offset(samples, samples.before | samples.after)
    shape = samples.measured.shape
    by_offset = np.broadcast_to(first.offset, shape), np.broadcast_to(second.offset, shape)
    one, two = (motor_field(samples, part, fit, ground) for part, fit in zip(parts, (first, second), strict=True))
    by_motors = None if one is None or two is None else (one.at(samples), two.at(samples))
    same = np.maximum(HALVES_SHARE * air.size, HALVES_SIGMAS * np.minimum(first.sigma, second.sigma))
    return CompassStudy(
        samples,
        air,
        before,
        after,
        ground,
        steady=bool(np.all(np.abs(first.offset - second.offset) <= same)),
        cause=_single_cause(samples) if air.counts else "offset",
        proof=cross_validate(samples, parts, by_offset),
        motors=motor_field(samples, samples.air, air, ground),
        motor_proof=None if by_motors is None else cross_validate(samples, parts, by_motors),
    )


def motor_field(samples: FieldSamples, use: Mask, air: OffsetFit, ground: OffsetFit | None) -> MotorField | None:
    """Return the motor field from the difference of the offsets in air and on ground.

    ``air``: fit to the samples ``use``. None without ground or power, or where power hardly differs.
    """
    if ground is None or not np.isfinite(samples.hover):
        return None
    on_ground = samples.mean_power(samples.before | samples.after)
    power = samples.mean_power(use) - on_ground
    if not power > MIN_POWER_RISE * samples.hover:
        return None
    per_unit = (air.offset - ground.offset) / power
    return MotorField(per_unit, power, ground.offset - per_unit * on_ground if ground.counts else np.zeros(3))


def _single_cause(samples: FieldSamples) -> Cause:
    use = samples.air
    found = fit_simplest(samples.t[use], samples.expected[use], samples.measured[use], samples.seconds)
    if found is None or not found.one_fault:
        return "neither"
    return "offset" if abs(found.turn_deg) <= TURN_OFF_DEG else "turn"


# The check of an offset.

# 150 mG: the heading swings by 45 deg where the horizontal field is 20 uT.
OFFSET_FAR_UT = 15.0
# Maximum 4 sigma for verdict ok; unknown above.
MAX_UNCERTAINTY_UT = 10.0
OFFSET_LIMIT = (
    f"ok up to {OFFSET_SIGMAS:.0f} sigma or {MIN_OFFSET_UT} uT, fault above {OFFSET_FAR_UT:.0f} uT horizontally"
)
OFFSET_SOURCE = "measured on 39 simulated flights with truth and 98 compasses"


def offset_check(case: HealthCase, study: CompassStudy) -> Check:
    """Check the offset of one compass in flight, and offer the parameters that remove it."""
    found, source = study.air, study.samples.source
    verdict: Verdict = "unknown" if OFFSET_SIGMAS * float(found.sigma.max()) > MAX_UNCERTAINTY_UT else "ok"
    if found.counts:
        verdict = "fault" if float(np.hypot(found.offset[0], found.offset[1])) > OFFSET_FAR_UT else "warning"
    check = Check(
        "compass_offset",
        verdict,
        f"{source} is off by {axes_with_interval(found.offset, found.sigma)} uT in x, y, z in flight.",
        unit="uT",
        threshold=OFFSET_LIMIT,
        evidence=_offset_evidence(study),
        sensor=source,
        n=found.n,
        seconds=round(study.samples.seconds, 1),
        source=OFFSET_SOURCE,
    )
    check.measure(found.size, found.size_sigma, 1, least=0.0).measure_axes(found.offset, found.sigma, 2)
    if verdict == "unknown":
        unsure = "The flight turns too little or its heading is too unsure. Fly turns and hard stops."
        check.why_no_setting = reason_unsound(study) or unsure
    elif verdict != "ok":
        check.why_no_setting = offset_refusal(case, study)
        if not check.why_no_setting:
            offer = settings.compass_proposal(case.log, study.samples.mag, 1e-6 * found.offset)
            check.settings, check.why_no_setting = offer.settings, offer.refused
    return check


def offset_refusal(case: HealthCase, study: CompassStudy) -> str:
    """Return why the offset is not offered as parameters; empty where it is."""
    if why := reason_unsound(study):
        return why
    if study.ground is None:
        why = "No sample on the ground separates this offset from the motors' field."
        return f"{why} {case.log.advice('rest')}".strip()
    on_ground = axes_with_interval(study.ground.offset, study.ground.sigma)
    if study.ground_differs:
        return (
            f"On the ground it is off by {on_ground} uT. "
            "The motors or the place bend the field, and this offset would be wrong on the ground."
        )
    if not study.ground_agrees:
        return f"The ground does not confirm it: off by {on_ground} uT there."
    if study.cause == "turn":
        return "A compass mounted askew would read the same: compare its orientation with the parameters."
    if study.cause == "neither":
        return "No constant offset explains the field in flight: motors or soft iron bend it."
    if not study.proof.holds:
        return "The offset does not improve the heading of the half that it was not fitted to."
    return ""


def reason_unsound(study: CompassStudy) -> str:
    """Return why the offset of this flight is not constant; empty where it is."""
    if not study.samples.mag.calibrated:
        return "This compass was never calibrated: calibrate it on the ground."
    if not study.steady:
        return "The first half of the flight shows another offset than the second: none is constant."
    return ""


def _offset_evidence(study: CompassStudy) -> list[str]:
    evidence = [
        f"On the ground {when} it is off by {axes_with_interval(fit.offset, fit.sigma)} uT ({fit.n} samples)."
        for when, fit in (("before take-off", study.before), ("after landing", study.after))
        if fit is not None
    ]
    heading = rms_deg(study.samples.sigma_heading[study.samples.air])
    known = f"The heading by motion alone is known to {heading:.1f} deg (1 sigma), in {study.air.blocks} blocks."
    return [*evidence, study.proof.sentence, known]


def axes_with_interval(value: Array, sigma: Array) -> str:
    """Format three numbers, each with half of its 95 % interval."""
    return ", ".join(f"{v:.1f} ± {1.96 * s:.1f}" for v, s in zip(value, sigma, strict=True))
