"""Does the measured field follow throttle or current? Then motors bend the compass."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from attlog.core import rotation
from attlog.core.earth import MagneticField
from attlog.core.log_cache import cached_per_log
from attlog.core.spans import Span, inside
from attlog.estimators.evidence import velocity_steps
from attlog.flight import compass
from attlog.flight.model import Array, FlightLog, Mag, Stream, TimeLine
from attlog.health.check import Check, HealthCase, MotionAttitude, Verdict, unknown
from attlog.health.flown import UPSIDE_DOWN_DEG, crash_spans, samples_in_use
from attlog.health.regression import robust_fit
from attlog.reference import alignment
from attlog.reference.model import Reference
from attlog.segments.model import Segments

MOVE_ADVICE = "Move the compass away from power wires, or calibrate it against the motors."
MIN_CORRELATION = 0.6
"""Weaker correlation is no sign: the field also changes with attitude and place."""
MIN_FIELD_UT = 1.0
"""The earth's field has 22 uT and more: a line that ends below this, or below zero, is compared with this."""
INTERFERENCE_PCT = (12.0, 30.0)
"""Change of the field over the range of throttle: ardupilot.org, "Magnetic Interference", calls 30 % the limit."""
MIN_THROTTLE_RANGE, MIN_CURRENT_RANGE_A = 0.1, 2.0
"""A drive that varies by less tells nothing."""
MIN_FIELD_S, MIN_FIELD_SAMPLES = 10.0, 50
STEADIER_SHARE, MIN_SPHERE_TURN_DEG = 0.5, 15.0
"""Offsets explain a field whose size then varies by half; only where the vehicle turned can they be known."""


def interference_check(log: FlightLog, segments: Segments, mag: Mag) -> Check:
    """Check the size of a compass's field against the motors' current, else their throttle."""
    limit = (
        f"ok up to {INTERFERENCE_PCT[0]:.0f} % or r below {MIN_CORRELATION}, fault above {INTERFERENCE_PCT[1]:.0f} %"
    )
    field = mag.field
    use = samples_in_use(log, segments, field.t_best, ("armed", "airborne"))
    use &= inside(field.t_best, segments.spans("armed") or segments.spans("airborne"))
    flown = use & inside(field.t_best, segments.spans("airborne"))
    best: Check | None = None
    for what, stream, least in motor_drives(log):
        seen = follow_drive(field, stream, use, least)
        if seen is None:
            continue
        r, low, high = seen
        change = 100.0 * abs(high - low) / max(min(low, high), MIN_FIELD_UT)
        follows = abs(r) >= MIN_CORRELATION and change > INTERFERENCE_PCT[0]
        verdict: Verdict = "ok" if not follows else "fault" if change > INTERFERENCE_PCT[1] else "warning"
        text = f"The field goes from {low:.1f} to {high:.1f} uT with {what} (r = {r:.2f})."
        if follows and offsets_explain(field, stream, flown if flown.sum() >= MIN_FIELD_SAMPLES else use):
            verdict, text = "ok", f"{text[:-1]}, but offsets of the compass explain that: not the motors."
        check = Check("compass_motors", verdict, text, round(change, 1), "%", limit, sensor=field.source)
        check.about = "field_size"
        if best is None or (verdict != "ok" and change > float(best.value or 0.0)):
            best = check
    if best is None:
        why = "The log holds no throttle or current that changes while armed."
        return unknown("compass_motors", why, limit, sensor=field.source)
    best.source = "correlation in flight; ardupilot.org, Magnetic Interference"
    if best.is_trouble:
        best.why_no_setting = "Without a heading by motion no value is known. Fly with GNSS, turning and braking."
        best.action = log.remedy("interference") or MOVE_ADVICE
    return best


def motor_drives(log: FlightLog) -> list[tuple[str, Stream, float]]:
    """What may bend the field: name, stream, and the least range that tells something."""
    found = []
    if (
        log.power.battery is not None
        and log.power.battery.x.shape[1] > 1
        and np.isfinite(log.power.battery.x[:, 1]).any()
    ):
        current = Stream(log.power.battery.t, log.power.battery.x[:, 1:2], "A", "", log.power.battery.source)
        found.append(("the current", current, MIN_CURRENT_RANGE_A))
    if log.power.throttle is not None and len(log.power.throttle.t) > 1:
        found.append(("the throttle", log.power.throttle, MIN_THROTTLE_RANGE))
    return found


def follow_drive(
    field: Stream, drive: Stream, use: NDArray[np.bool_], least: float
) -> tuple[float, float, float] | None:
    """Correlation of the field's size with a drive, and the line through both (uT) at the drive's 5th and 95th
    percentile, over the samples ``use`` (n,); None where the drive varies by less than ``least`` or there are few."""
    x = drive.x[:, 0]
    known = np.isfinite(x)
    t = field.t_best
    size = np.sqrt(np.sum(field.x**2, axis=1)) * 1e6
    use = np.isfinite(size) & (size > 0) & use
    if known.sum() < MIN_FIELD_SAMPLES or use.sum() < MIN_FIELD_SAMPLES or np.ptp(t[use]) < MIN_FIELD_S:
        return None
    power = np.interp(t[use], drive.t[known], x[known])
    near = np.abs(t[use] - drive.t[known][np.clip(np.searchsorted(drive.t[known], t[use]), 0, known.sum() - 1)]) < 1.0
    power, size = power[near], size[use][near]
    if len(power) < MIN_FIELD_SAMPLES:
        return None
    low, high = np.quantile(power, 0.05), np.quantile(power, 0.95)
    if high - low < least or np.std(size) == 0:
        return None
    r = float(np.corrcoef(power, size)[0, 1])
    slope, start = np.polyfit(power, size, 1)
    return r, float(start + slope * low), float(start + slope * high)


def offsets_explain(field: Stream, drive: Stream, use: NDArray[np.bool_]) -> bool:
    """Whether constant offsets of the compass explain why its size follows a drive, as where it flies one way fast.

    The field less the offsets of the best sphere has a size that follows the drive by less than LEAST_R.
    """
    use = use & np.isfinite(field.x).all(axis=1)
    x = 1e6 * field.x[use]
    if len(x) < MIN_FIELD_SAMPLES:
        return False
    unit = x / np.linalg.norm(x, axis=1, keepdims=True)
    middle = unit.mean(axis=0) / max(float(np.linalg.norm(unit.mean(axis=0))), 1e-9)
    if np.degrees(np.quantile(np.arccos(np.clip(unit @ middle, -1.0, 1.0)), 0.95)) < MIN_SPHERE_TURN_DEG:
        return False
    scale = float(np.median(np.linalg.norm(x, axis=1)))
    centre, *_ = np.linalg.lstsq(np.column_stack([2.0 * x, np.ones(len(x))]), np.sum(x**2, axis=1), rcond=1e-3 / scale)
    before, after = np.linalg.norm(x, axis=1), np.linalg.norm(x - centre[:3], axis=1)
    known = np.isfinite(drive.x[:, 0])
    power = np.interp(field.t_best[use], drive.t[known], drive.x[known, 0])
    if np.std(after) > STEADIER_SHARE * np.std(before) or np.std(power) == 0 or np.std(after) == 0:
        return False
    return abs(float(np.corrcoef(power, after)[0, 1])) < MIN_CORRELATION


# What is wrong with the compass: an offset (iron, current) or a turn (mounting), by attitude and earth's field.
#
# The earth's field ``h`` is the world magnetic model's at the flight's place. Seen by an attitude R the compass shows
# ``m = T R' h + o``: o moves with the vehicle (hard iron), T turns about the vehicle's vertical (mounting, or an
# attitude
# whose heading is off). Over a turn both are found; without one, a turn keeps the horizontal field's size and an
# offset
# does not.

MIN_COMPASS_SAMPLES, MIN_COMPASS_FLIGHT_S = 50, 20.0
OFFSET_OFF_UT, OFFSET_CHECK_FAR_UT = 5.0, 15.0
"""50 and 150 mG, horizontally: by 5 uT the heading swings by 14 deg where the horizontal field is 20 uT."""
CHECK_SIGMAS, CHECK_FLOOR_UT, LEVEL_RAD = 4.0, 0.3, math.radians(0.8)
"""Told above four sigmas: 1.5 standard errors, 0.3 uT, and 0.8 deg of tilt of the attitude in the vertical field."""
HEADING_PRIOR_RAD = math.radians(3.0)
"""Onboard headings of flights with truth are off by 0.3 to 3 deg: the prior of the turn where nothing turns."""
TURN_OFF_DEG, TURN_FAR_DEG = 10.0, 20.0
IDENTITY = np.array([1.0, 0.0, 0.0, 0.0])
SCALE_PRIOR, SIZE_KEPT = 0.02, 0.1
"""The horizontal field's size is the model's to 2 % (prior); a turn keeps it to 10 %."""
HALVES_AGREE = 0.4
SIMPLER_RATIO = 1.5
"""One fault alone explains the field where it leaves at most so many times what both leave (RMS)."""
OFFSET_CHECK_LIMIT = (
    f"ok up to {OFFSET_OFF_UT:.0f} uT or {CHECK_SIGMAS:.0f} sigma, fault above {OFFSET_CHECK_FAR_UT:.0f} uT"
)
TURN_LIMIT = f"ok up to {TURN_OFF_DEG:.0f} deg, fault above {TURN_FAR_DEG:.0f} deg"


@dataclass(frozen=True, slots=True)
class CompassFit:
    """Offset (3,) uT with sigmas, and turn with sigma in deg, of the model that explains the field most simply."""

    offset: Array
    offset_sigma: Array
    turn_deg: float
    turn_sigma: float
    left_ut: float
    samples: int
    seconds: float
    steady: bool = True
    """Whether both halves of the flight tell the same."""
    one_fault: bool = True
    """Whether an offset alone or a turn alone explains the field."""

    def by(self, reference: Reference) -> str:
        """What it was found by, in words."""
        return f"{self.samples} samples in {self.seconds:.0f} s, turned by {reference.source}"

    def doubt(self, reference: Reference) -> str:
        """Why neither offset nor turn is told although the field is off; empty where they are."""
        if not self.one_fault and reference.kind != "truth":
            return "Neither an offset nor a turn alone explains the field: the attitude's heading may be in error."
        return (
            "" if self.steady else "The first half of the flight shows another error than the second: none is constant."
        )


def compass_error_checks(case: HealthCase) -> list[Check]:
    """Check offset and turn of the replayed compass in flight by the reference's heading, or the onboard one."""
    log = case.log
    if log.mag is None or not case.segments.of("airborne"):
        return []
    model, reference, source = alignment.earth_field(log), _heading_reference(case), log.mags[log.mag].field.source
    found = None
    if reference is None or reference.kind == "none" or model is None:
        why = "No attitude in this log can turn the field." if model is not None else "No position, so no earth field."
    else:
        found = fit_compass(log, case.segments, reference)
        why = f"Fewer than {MIN_COMPASS_SAMPLES} samples or {MIN_COMPASS_FLIGHT_S:.0f} s of flight have an attitude."
    if reference is None or found is None:
        checks = [unknown("compass_offset", why, OFFSET_CHECK_LIMIT), unknown("compass_turn", why, TURN_LIMIT)]
    else:
        checks = [_offset_check(source, found, reference), _turn_check(source, found, reference)]
    for check in checks:
        check.sensor, check.about = source, "attitude"
    return checks


def _heading_reference(case: HealthCase) -> Reference | None:
    """Return the reference whose heading may judge the compass: truth or a smoother, else a sound onboard attitude."""
    own = case.reference is not None and case.reference.heading.by == "own"
    judge = case.reference if own else case.rates
    return judge if judge is None or judge.heading.by == "own" else None


def _offset_check(source: str, found: CompassFit, reference: Reference) -> Check:
    size = float(np.sqrt(np.sum(found.offset**2)))
    level, unsure = float(np.hypot(*found.offset[:2])), float(found.offset_sigma[:2].max())
    told = level > max(OFFSET_OFF_UT, CHECK_SIGMAS * unsure)
    if not told and CHECK_SIGMAS * unsure > OFFSET_CHECK_FAR_UT:
        return unknown(
            "compass_offset",
            f"The flight turns too little: the offset is known to {unsure:.0f} uT only.",
            OFFSET_CHECK_LIMIT,
        )
    if told and (why := found.doubt(reference)):
        return unknown("compass_offset", why, OFFSET_CHECK_LIMIT)
    verdict: Verdict = "ok" if not told else "warning" if level <= OFFSET_CHECK_FAR_UT else "fault"
    sizes = ", ".join(f"{v:.0f} ± {1.96 * s:.0f}" for v, s in zip(found.offset, found.offset_sigma, strict=True))
    text = f"{source} is off by {sizes} uT in x, y, z (95 %), {found.by(reference)}."
    return Check("compass_offset", verdict, text, round(size, 1), "uT", OFFSET_CHECK_LIMIT)


def _turn_check(source: str, found: CompassFit, reference: Reference) -> Check:
    size = abs(found.turn_deg)
    told = size > max(TURN_OFF_DEG, CHECK_SIGMAS * found.turn_sigma)
    if not told and CHECK_SIGMAS * found.turn_sigma > TURN_FAR_DEG:
        why = f"The flight turns too little: the turn is known to {found.turn_sigma:.0f} deg only."
        return unknown("compass_turn", why, TURN_LIMIT)
    if told and (why := found.doubt(reference)):
        return unknown("compass_turn", why, TURN_LIMIT)
    verdict: Verdict = "ok" if not told else "warning" if size <= TURN_FAR_DEG else "fault"
    way = "clockwise" if found.turn_deg > 0 else "anticlockwise"
    text = f"{source} points {size:.0f} ± {1.96 * found.turn_sigma:.0f} deg {way} of the attitude's heading (95 %), "
    text += f"{found.by(reference)}."
    return Check("compass_turn", verdict, text, round(found.turn_deg, 1), "deg", TURN_LIMIT)


def fit_compass(log: FlightLog, segments: Segments, reference: Reference) -> CompassFit | None:
    """The simplest model that explains the field in flight; None where too little can be compared."""
    model = alignment.earth_field(log)
    if log.mag is None or model is None:
        return None
    field = log.mags[log.mag].field
    q, _ = rotation.slerp_in_segments(reference.t, reference.q, reference.gap_segment, field.t_best)
    use = rotation.finite_rows(q) & rotation.finite_rows(field.x) & segments.mask(field.t_best, "airborne")
    use &= (field.t_best >= reference.scoring.start) & (field.t_best < reference.scoring.end)
    t, m = field.t_best[use], 1e6 * field.x[use]
    seconds = len(t) / max(field.rate, 1e-9)
    if len(t) < MIN_COMPASS_SAMPLES or seconds < MIN_COMPASS_FLIGHT_S:
        return None
    u = rotation.rotate_inverse(q[use], 1e6 * np.array(model.ned_t))
    found = fit_simplest(t, u, m, seconds)
    middle = len(t) // 2
    halves = [fit_simplest(t[k], u[k], m[k], seconds / 2) for k in (slice(None, middle), slice(middle, None))]
    return None if found is None else replace(found, steady=_halves_agree(found, *halves))


def _halves_agree(found: CompassFit, one: CompassFit | None, two: CompassFit | None) -> bool:
    """Whether the halves differ by at most 40 % or three sigmas of what the whole flight tells."""
    if one is None or two is None:
        return False
    size, apart = float(np.hypot(*found.offset[:2])), float(np.hypot(*(one.offset - two.offset)[:2]))
    unsure = float(np.hypot(one.offset_sigma[:2].max(), two.offset_sigma[:2].max()))
    turned = abs((one.turn_deg - two.turn_deg + 180.0) % 360.0 - 180.0)
    doubt = math.hypot(one.turn_sigma, two.turn_sigma)
    same_turn = turned <= max(HALVES_AGREE * abs(found.turn_deg), 3.0 * doubt)
    return same_turn and apart <= max(HALVES_AGREE * size, 3.0 * unsure)


def fit_simplest(t: Array, u: Array, m: Array, seconds: float) -> CompassFit | None:
    """One fault where it explains the field, else both. ``u``, ``m`` (n, 3) uT: the earth's field and the compass's.

    ``m_x = a u_x + b u_y + o_x`` and ``m_y = a u_y - b u_x + o_y``: a turn by the angle of (a, b).
    """
    along, across = u[:, :2], np.column_stack([u[:, 1], -u[:, 0]])
    unit = np.broadcast_to(np.eye(2), (len(t), 2, 2))
    columns = np.concatenate([np.stack([along, across], axis=2), unit], axis=2)
    target = m[:, :2] - along
    both = robust_fit(t, columns, target, np.array([SCALE_PRIOR, 10.0, np.inf, np.inf]))
    turned = robust_fit(t, columns[:, :, :2], m[:, :2])
    moved = robust_fit(t, columns, target, np.array([SCALE_PRIOR, HEADING_PRIOR_RAD, np.inf, np.inf]))
    if both is None or turned is None or moved is None:
        return None
    least = _rms_left(columns, target, both.x)
    level, down = (float(np.median(rotation.length(u[:, :2]))), float(np.median(np.abs(u[:, 2]))))
    alone = _rms_left(columns[:, :, :2], m[:, :2], turned.x)
    one_fault = True
    keeps = abs(math.hypot(*turned.x) - 1.0) < SIZE_KEPT
    if keeps and alone <= SIMPLER_RATIO * least + CHECK_FLOOR_UT:
        x = np.array([turned.x[0], turned.x[1], 0.0, 0.0])
        sigma = np.array([*turned.sigma, CHECK_FLOOR_UT, CHECK_FLOOR_UT])
    elif (
        abs(moved.x[1]) <= 2.0 * HEADING_PRIOR_RAD
        and _rms_left(columns, target, moved.x) <= SIMPLER_RATIO * least + CHECK_FLOOR_UT
    ):
        x, sigma = moved.x + IDENTITY, moved.sigma
    else:
        x, sigma, one_fault = both.x + IDENTITY, both.sigma, False
    below = m[:, 2] - u[:, 2]
    offset = np.array([x[2], x[3], float(np.median(below))])
    tilted = np.array(
        [LEVEL_RAD * down, LEVEL_RAD * down, math.hypot(LEVEL_RAD * level, 0.01 * math.hypot(level, down))]
    )
    unsure = np.sqrt(np.array([1.5 * sigma[2], 1.5 * sigma[3], 0.0]) ** 2 + tilted**2 + CHECK_FLOOR_UT**2)
    turn = math.degrees(math.atan2(x[1], x[0]))
    return CompassFit(
        offset,
        unsure,
        turn,
        math.degrees(math.hypot(1.5 * sigma[1], HEADING_PRIOR_RAD)),
        least,
        len(t),
        seconds,
        one_fault=one_fault,
    )


def _rms_left(columns: Array, target: Array, x: Array) -> float:
    """RMS that a model leaves, uT, without its largest twentieth."""
    left = np.sort(np.sum((target - columns @ x) ** 2, axis=1))
    return float(np.sqrt(np.mean(left[: max(1, int(0.95 * len(left)))])))


# What one compass read in the air and on the ground, beside the earth's field as the motion attitude turns it.

Mask = NDArray[np.bool_]
Power = Literal["current", "throttle"]

FLIGHT_EDGE_S = 1.0
"""Left out at both ends of a flight: the vehicle is near the ground, and its attitude is that of a take-off."""
GROUND_S = 20.0
"""So long before take-off and after landing the vehicle counts as standing where it took off or landed."""
IDLE_SHARE = 0.25
"""Below this share of the power in flight motors bend no field that matters."""
MAX_SIGMA_HEADING_RAD = np.radians(5.0)
"""Samples count where the motion attitude says that its heading is known to this (one sigma)."""
MAX_FIELD_SAMPLES = 2000
"""Samples in flight that are compared: errors of an attitude last for seconds, and a long log must cost little more."""
MAX_POWER_DISTANCE_S = 2.0
"""A record of power further away than this from a sample of the field says nothing of it."""
MIN_GROUND_SAMPLES, MIN_GROUND_S = 10, 2.0
MIN_CURRENT_A = 0.5
"""A current that never exceeds this is that of a sensor that is not there."""


@dataclass(frozen=True, slots=True)
class FieldSamples:
    """Samples of one compass at ``t`` (n,) s, some of the ``air``, some ``before`` take-off, some ``after`` landing.

    ``measured`` and ``expected`` (n, 3) uT in body axes: the logged field, and the earth's (``earth``, (3,) uT NED)
    turned by the attitude ``q`` (n, 4). ``sigma_heading`` (n,) rad is what the attitude says of its heading. ``power``
    (n,) is the battery's current in A or the throttle (0 to 1), as ``power_kind`` says, NaN where unknown; ``hover``
    its median in the air, NaN where no power is logged. ``seconds`` in the air.
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
    power_kind: Power
    seconds: float

    @property
    def source(self) -> str:
        """The compass as the log calls it."""
        return self.mag.field.source

    @property
    def error(self) -> Array:
        """What the compass reads too much (n, 3), uT in body axes."""
        return self.measured - self.expected

    def mean_power(self, use: Mask) -> float:
        """The median power of some samples; 0 where none is known there, as with motors that never ran."""
        known = self.power[use & np.isfinite(self.power)]
        return float(np.median(known)) if len(known) else 0.0


def field_samples(case: HealthCase, mag: Mag, motion: MotionAttitude, model: MagneticField) -> FieldSamples | None:
    """Samples of ``mag`` where the ``motion`` attitude knows its heading; None where the flight holds none."""
    t, field = mag.field.t_best, 1e6 * mag.field.x
    flown = compass_flight_spans(case.segments)
    good = rotation.finite_rows(field) & np.isfinite(t)
    air = _thinned_mask(good & inside(t, flown), MAX_FIELD_SAMPLES)
    kind, drive = motor_drive(case.log)
    hover = _finite_median(power_at(drive, t[air]))
    before, after = ground_spans(case.segments)
    on_ground = [_thinned_mask(good & inside(t, spans), MAX_FIELD_SAMPLES // 5) for spans in (before, after)]
    wanted = air | on_ground[0] | on_ground[1]
    where = np.flatnonzero(wanted)
    q, sample = rotation.slerp_in_segments(motion.t, motion.q, motion.segment, t[where])
    sigma = motion.sigma_heading[np.clip(sample, 0, len(motion.t) - 1)]
    known = rotation.finite_rows(q) & (sigma <= MAX_SIGMA_HEADING_RAD)
    known[known] &= np.degrees(rotation.tilt_angle(q[known])) < UPSIDE_DOWN_DEG
    where, q, sigma = where[known], q[known], sigma[known]
    if not air[where].any():
        return None
    earth = 1e6 * np.array(model.ned_t)
    power = power_at(drive, t[where])
    idle = _idle_motors(case.log.state.armed, t[where], power, hover)
    share = np.count_nonzero(air[where]) / int(np.count_nonzero(air))
    standing = [_enough_ground(t[where], mask[where] & idle) for mask in on_ground]
    return FieldSamples(
        mag=mag,
        t=t[where],
        measured=field[where],
        expected=rotation.rotate_inverse(q, earth),
        q=q,
        sigma_heading=sigma,
        power=power,
        air=air[where],
        before=standing[0],
        after=standing[1],
        earth=earth,
        hover=hover,
        power_kind=kind,
        seconds=share * sum(b - a for a, b in flown),
    )


def compass_flight_spans(segments: Segments) -> list[Span]:
    """When the vehicle flew, less EDGE_S at both ends, up to the first crash."""
    end = min((span[0] for span in crash_spans(segments)), default=np.inf)
    spans = [(a + FLIGHT_EDGE_S, min(b, end) - FLIGHT_EDGE_S) for a, b in segments.spans("airborne")]
    return [(a, b) for a, b in spans if b > a]


def ground_spans(segments: Segments) -> tuple[list[Span], list[Span]]:
    """Up to GROUND_S before the first take-off, and after the last landing unless something crashed."""
    flown = segments.spans("airborne")
    if not flown:
        return [], []
    end = min((span[0] for span in crash_spans(segments)), default=np.inf)
    first, last = flown[0][0], flown[-1][1]
    return [(first - GROUND_S, first)], [(last, last + GROUND_S)] if end == np.inf else []


def motor_drive(log: FlightLog) -> tuple[Power, Stream | None]:
    """What tells of the motors' power: the battery's current, else the throttle."""
    for what, stream, _ in motor_drives(log):
        if what.endswith("current") and np.nanmax(np.abs(stream.x[:, 0])) < MIN_CURRENT_A:
            continue
        return ("current" if what.endswith("current") else "throttle"), stream
    return "throttle", None


def power_at(drive: Stream | None, t: Array) -> Array:
    """The power (n,) at times ``t`` (n,) s; NaN further than NEAR_S from any record, or without one."""
    if drive is None:
        return np.full(len(t), np.nan)
    known = np.isfinite(drive.x[:, 0])
    at, x = drive.t[known], drive.x[known, 0]
    if not len(at):
        return np.full(len(t), np.nan)
    k = np.clip(np.searchsorted(at, t), 1, max(len(at) - 1, 1))
    gap = np.minimum(np.abs(t - at[k - 1]), np.abs(at[np.minimum(k, len(at) - 1)] - t))
    return np.where(gap <= MAX_POWER_DISTANCE_S, np.interp(t, at, x), np.nan)


def _idle_motors(armed: TimeLine | None, t: Array, power: Array, hover: float) -> Mask:
    """Where motors stand or idle: by the power, where none is known by being disarmed."""
    off = np.zeros(len(t), bool)
    if armed is not None and len(armed.value):
        k = np.clip(np.searchsorted(armed.t, t, side="right") - 1, 0, None)
        off = ~np.array([bool(v) for v in armed.value])[k]
    if not np.isfinite(hover) or hover <= 0:
        return off
    return np.asarray(np.where(np.isfinite(power), power < IDLE_SHARE * hover, off))


def _enough_ground(t: Array, use: Mask) -> Mask:
    """The samples, none of them where they are too few to tell a field."""
    few = use.sum() < MIN_GROUND_SAMPLES or np.ptp(t[use]) < MIN_GROUND_S
    return np.zeros(len(t), bool) if few else use


def _thinned_mask(use: Mask, most: int) -> Mask:
    """At most so many of the samples, evenly over them."""
    where = np.flatnonzero(use)
    kept = np.zeros(len(use), bool)
    kept[where[:: max(1, -(-len(where) // most))]] = True
    return kept


def _finite_median(x: Array) -> float:
    known = x[np.isfinite(x)]
    return float(np.median(known)) if len(known) else float("nan")


# May the attitude by motion alone judge a compass? It shares nothing with any compass, and must know its heading.
#
# A smoother that was given the compass believes part of what is wrong with it: by 79 mG where one without it erred by
# 9
# to 22. Its heading comes from GNSS acceleration: a vehicle that stands still in the air shows none, whatever the
# smoother claims (85 to 132 deg wrong at a sigma of 1.8 to 5 deg).

MIN_HEADING_S = 30.0
"""Seconds of flight in which the heading is known to 5 deg."""
MIN_ACCELERATION_M_S2 = 0.25
"""Horizontal acceleration (rms of changes of velocity over 1 s) that shows a heading."""
FLY_ADVICE = "Fly forward, stop hard, turn and repeat for a minute."
GNSS_DELAY_S = 0.1
"""GNSS velocity is about so late; the rms of accelerations hardly depends on it."""


def reason_no_heading(case: HealthCase) -> str:
    """Why no attitude can judge the compasses of this log, with what would help; empty where one can."""
    if case.log.replay_imu is None:
        return "No inertial unit of this log can be replayed, so nothing judges the compass."
    flown = compass_flight_spans(case.segments)
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
    moved = horizontal_acceleration(case.log, motion, case)
    if not moved >= MIN_ACCELERATION_M_S2:
        needed = f"{MIN_ACCELERATION_M_S2} needed"
        return f"Horizontal acceleration of {moved:.2f} m/s^2 shows no heading ({needed}). {FLY_ADVICE}"
    return ""


def horizontal_acceleration(log: FlightLog, motion: MotionAttitude, case: HealthCase) -> float:
    """Horizontal acceleration in the air, rms in m/s^2: by GNSS or by the force, whichever shows less.

    GNSS alone takes its noise for acceleration, the force alone the errors of its tilt, which change slowly: the mean
    of every 30 s goes.
    """
    imu = log.replay_imu
    receiver = next((r for r in log.gnss if np.isfinite(r.vel_ned).any()), None)
    if imu is None or receiver is None:
        return 0.0
    flown = compass_flight_spans(case.segments)
    near = inside(imu.acc.t_best, [(a - 2.0, b + 2.0) for a, b in flown])
    t, acc = imu.acc.t_best[near], imu.acc.x[near]
    q, _ = rotation.slerp_in_segments(motion.t, motion.q, motion.segment, t)
    steps = velocity_steps(t, acc, q, receiver.t, receiver.vel_ned, np.array(flown))
    if not len(steps.t0):
        return 0.0
    force = steps.force[int(np.argmin(np.abs(steps.delays - GNSS_DELAY_S)))]
    _, number = np.unique(steps.t0 // 30.0, return_inverse=True)
    count = np.bincount(number)
    force = force - ((np.bincount(number, force.real) + 1j * np.bincount(number, force.imag)) / count)[number]
    seconds = np.maximum(steps.t1 - steps.t0, 0.1)
    return float(min(np.sqrt(np.mean(np.abs(x / seconds) ** 2)) for x in (steps.gnss, force)))


# How far is a compass off, in uT along the body's axes, and how wrong may that number be in all?
#
# ``m = R' h + o``: m logged (corrected) field, R attitude, h the earth's field, o the residual offset. The error of o
# is
# that of the fit and of all that the fit cannot see: heading and tilt of the attitude, the model of the earth's
# field.

COMPASS_HUBER = 2.5
"""Residuals beyond so many robust deviations are weighted down (measured on 98 compasses)."""
STANDARD_ERRORS = 1.5
"""Standard errors clustered by few blocks are too small by about this."""
TILT_RAD = math.radians(0.8)
"""Tilt error of a smoothed attitude: it turns the vertical field into the horizontal, and back."""
MODEL_SIZE_ERROR = 0.01
"""Error of the model's field in size."""
OFFSET_FLOOR_UT = 0.3
"""What remains of compass and model however long the flight: 3 mG."""
OFFSET_SIGMAS, MIN_OFFSET_UT = 4.0, 1.5
"""An offset counts above four total errors and 15 mG: no false one on 39 untouched simulated flights; with four
standard errors of the fit 29."""


@dataclass(frozen=True, slots=True)
class OffsetFit:
    """What a compass reads too much, ``offset`` (3,) uT in body axes, with its total error ``sigma`` (3,).

    ``left_ut``: the residuals' root mean square; ``n`` samples in ``blocks`` of 5 s.
    """

    offset: Array
    sigma: Array
    left_ut: float
    n: int
    blocks: int

    @property
    def size(self) -> float:
        """Its length, uT."""
        return float(np.sqrt(np.sum(self.offset**2)))

    @property
    def size_ci95(self) -> tuple[float, float]:
        """The 95 % interval of its length, uT."""
        along = self.offset / max(self.size, 1e-9)
        half = 1.96 * float(np.sqrt(np.sum((along * self.sigma) ** 2)))
        return max(self.size - half, 0.0), self.size + half

    @property
    def counts(self) -> bool:
        """Whether an axis is off beyond doubt, and by enough."""
        return bool(np.any(np.abs(self.offset) > np.maximum(OFFSET_SIGMAS * self.sigma, MIN_OFFSET_UT)))


def fit_offset(t: Array, error: Array, sigma_heading: Array, earth: Array) -> OffsetFit | None:
    """The offset that samples at ``t`` (n,) s show; None without any.

    ``error`` (n, 3) uT is what the compass reads more than the earth's field ``earth`` (3,) uT NED, ``sigma_heading``
    (n,) rad one sigma of the attitude's heading.
    """
    if len(t) < 2:
        return None
    found = robust_fit(t, np.broadcast_to(np.eye(3), (len(t), 3, 3)), error, huber=COMPASS_HUBER)
    if found is None:
        return None
    left = error - found.x
    heading = float(np.sqrt(np.mean(sigma_heading**2)))
    sigma = total_offset_sigma(found.sigma, heading, earth)
    return OffsetFit(found.x, sigma, float(np.sqrt(np.mean(np.sum(left**2, axis=1)))), len(t), found.blocks)


def fit_offset_of(samples: FieldSamples, use: Mask) -> OffsetFit | None:
    """:func:`offset_of` of some of the samples."""
    return fit_offset(samples.t[use], samples.error[use], samples.sigma_heading[use], samples.earth)


def total_offset_sigma(standard: Array, sigma_heading: float, earth: Array) -> Array:
    """One sigma (3,) uT of an offset in body axes of a vehicle that is mostly level.

    ``standard`` (3,) uT are the errors of the fit, ``sigma_heading`` rad that of the heading; ``earth`` (3,) uT NED.
    """
    level, down = math.hypot(earth[0], earth[1]), abs(float(earth[2]))
    across = math.hypot(sigma_heading * level, TILT_RAD * down)
    along = math.hypot(TILT_RAD * level, MODEL_SIZE_ERROR * math.hypot(level, down))
    sigma: Array = np.sqrt(
        (STANDARD_ERRORS * standard) ** 2 + np.array([across, across, along]) ** 2 + OFFSET_FLOOR_UT**2
    )
    return sigma


# What would a correction do to the compass's heading, on the half of the flight that it was not fitted to?

MIN_IMPROVEMENT, MIN_IMPROVEMENT_DEG, MAX_HEADING_ERROR_DEG = 0.3, 1.0, 12.0
"""A correction is offered where the heading of the other half improves by 30 % and 1 deg to below 12 deg."""


@dataclass(frozen=True, slots=True)
class HeadingProof:
    """RMS in deg of the compass's heading error ``before`` and ``after`` a correction that was fitted elsewhere."""

    before: float
    after: float

    @property
    def holds(self) -> bool:
        """Whether the correction helps beyond doubt."""
        least = max(MIN_IMPROVEMENT * self.before, MIN_IMPROVEMENT_DEG)
        return self.before - self.after >= least and self.after < MAX_HEADING_ERROR_DEG

    @property
    def sentence(self) -> str:
        """The proof in words."""
        return f"Heading error on the half not fitted: {self.before:.1f} deg before, {self.after:.1f} deg after."


def heading_error(q: Array, field: Array, earth: Array) -> Array:
    """Heading error (n,) in rad of a tilt-compensated compass, against the heading of attitudes ``q`` (n, 4).

    ``field`` (n, 3) in body axes and the earth's ``earth`` (3,), north-east-down, in the same unit.
    """
    seen = rotation.rotate(q, field)
    # A field that is seen turned to the east (clockwise) makes the heading read too little.
    return -rotation.wrap(np.arctan2(seen[:, 1], seen[:, 0]) - math.atan2(earth[1], earth[0]))


def rms_deg(angle: Array) -> float:
    """Root mean square in deg of angles (n,) in rad."""
    return math.degrees(float(np.sqrt(np.mean(angle**2)))) if len(angle) else float("nan")


def flight_halves(samples: FieldSamples) -> tuple[Mask, Mask]:
    """The samples in the air of the first and of the second half of the flight."""
    where = np.flatnonzero(samples.air)
    first, second = np.zeros(len(samples.t), bool), np.zeros(len(samples.t), bool)
    first[where[: len(where) // 2]] = True
    second[where[len(where) // 2 :]] = True
    return first, second


def cross_validate(samples: FieldSamples, parts: tuple[Mask, Mask], wrong: tuple[Array, Array]) -> HeadingProof:
    """The heading before and after: each of two ``parts`` of the flight corrected by what was fitted in the other.

    ``wrong``: what the compass reads too much (n, 3) uT at every sample, by the first and by the second part.
    """
    before, after = [], []
    for part, other in zip(parts, reversed(wrong), strict=True):
        q, field = samples.q[part], samples.measured[part]
        before.append(heading_error(q, field, samples.earth))
        after.append(heading_error(q, field - other[part], samples.earth))
    return HeadingProof(rms_deg(np.concatenate(before)), rms_deg(np.concatenate(after)))


# Everything that a flight tells of one compass: its offset in the air and on the ground, and what the motors add.

MIN_ALIVE_UT, MIN_MOVING_UT = 5.0, 0.3
"""A compass that reads less, or whose axes all change by less than 3 mG while the vehicle moves, measures nothing."""
GROUND_REPEATS_UT, GROUND_REPEATS_SHARE = 2.5, 0.2
"""Fields before take-off and after landing are one within 25 mG or a fifth of what the flight adds."""
HALVES_SHARE, HALVES_SIGMAS = 0.4, 3.0
"""Offsets of both halves agree within 40 % of the offset or three sigmas."""
GROUND_UT, GROUND_SHARE = 2.0, 0.5
"""Ground and air differ beyond four sigmas and 20 mG; the ground confirms an offset that lies nearer to it than to
none."""
MOTORS_AS_GOOD, MOTORS_AS_GOOD_DEG = 1.1, 0.5
"""Where the power hardly changes, a constant offset explains the flight as well as the motors do: up to this."""
Cause = Literal["offset", "turn", "neither"]


@dataclass(frozen=True, slots=True)
class MotorField:
    """What the motors add, ``per_unit`` (3,) uT for each ampere or for full throttle.

    ``added`` (3,) uT is what they add in flight, with its sigma (3,), at ``power`` (A, or 0 to 1) more than on the
    ground. ``offset`` (3,) uT is what remains without any power, zero where it may be.
    """

    per_unit: Array
    added: Array
    sigma: Array
    power: float
    offset: Array

    def at(self, samples: FieldSamples) -> Array:
        """What the compass reads too much (n, 3) uT at every sample."""
        power = np.nan_to_num(samples.power, nan=samples.hover)
        return np.asarray(self.offset + power[:, None] * self.per_unit)


@dataclass(frozen=True, slots=True)
class CompassStudy:
    """One compass: fits of the ``air``, and of the ``ground`` ``before`` and ``after`` where it stood with motors off.

    ``steady``: both halves of the flight show the same offset. ``cause``: what alone explains the field in flight, an
    offset, a turn of a compass that is mounted askew, or neither. ``motors`` is None without ground or power.
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
        """Whether the ground confirms that the compass is off as it is in the air."""
        if self.ground is None or self.ground_differs:
            return False
        apart = self.air.offset - self.ground.offset
        level = float(np.hypot(self.air.offset[0], self.air.offset[1]))
        return float(np.hypot(apart[0], apart[1])) <= max(GROUND_UT, GROUND_SHARE * level)

    @property
    def ground_differs(self) -> bool:
        """Whether the compass reads another field on the ground than in the air."""
        return bool(self.ground_differs_along.any())

    @property
    def ground_differs_along(self) -> NDArray[np.bool_]:
        """Along which axes (3,) it does."""
        if self.ground is None:
            return np.zeros(3, bool)
        limit = np.maximum(OFFSET_SIGMAS * self.air.sigma, GROUND_UT)
        return np.asarray(np.abs(self.air.offset - self.ground.offset) > limit)

    @property
    def follows_motors(self) -> bool:
        """Whether power explains the heading in flight, and no worse than a constant offset does."""
        one, other = self.motor_proof, self.proof
        return one is not None and one.holds and one.after <= MOTORS_AS_GOOD * other.after + MOTORS_AS_GOOD_DEG

    @property
    def ground_repeats(self) -> bool:
        """Whether the compass reads the same before take-off and after landing."""
        if self.before is None or self.after is None or self.ground is None:
            return False
        apart = float(np.linalg.norm(self.before.offset - self.after.offset))
        added = float(np.linalg.norm(self.air.offset - self.ground.offset))
        return apart <= max(GROUND_REPEATS_UT, GROUND_REPEATS_SHARE * added)


@cached_per_log
def compass_studies(case: HealthCase) -> tuple[list[CompassStudy], str]:
    """Every compass that can be judged, and why there is none."""
    why = reason_no_heading(case)
    model = alignment.earth_field(case.log)
    if why or case.motion is None or model is None:
        return [], why
    found: list[CompassStudy] = []
    for mag in case.log.mags:
        if compass.dead_reason(mag, case.log.replay_imu):
            continue
        samples = field_samples(case, mag, case.motion, model)
        if samples is None or samples.seconds < MIN_HEADING_S or not is_alive(samples):
            continue
        one = study_samples(samples)
        found += [one] if one is not None else []
    if not found:
        why = f"No compass has {MIN_HEADING_S:.0f} s in flight with a heading known to 5 deg. {FLY_ADVICE}"
    return found, why


def is_alive(samples: FieldSamples) -> bool:
    """Whether the compass reads a field that changes."""
    field = samples.measured[samples.air]
    size = float(np.median(np.linalg.norm(field, axis=1)))
    return size > MIN_ALIVE_UT and bool(np.any(np.std(field, axis=0) > MIN_MOVING_UT))


def study_samples(samples: FieldSamples) -> CompassStudy | None:
    """What samples of a compass show; None where they determine nothing."""
    air = fit_offset_of(samples, samples.air)
    if air is None:
        return None
    before, after = (fit_offset_of(samples, use) if use.any() else None for use in (samples.before, samples.after))
    on_ground = samples.before | samples.after
    ground = fit_offset_of(samples, on_ground) if on_ground.any() else None
    parts = flight_halves(samples)
    first, second = (fit_offset_of(samples, half) for half in parts)
    if first is None or second is None:
        return None
    shape = samples.measured.shape
    proof = cross_validate(
        samples, parts, (np.broadcast_to(first.offset, shape), np.broadcast_to(second.offset, shape))
    )
    added = motor_field(samples, samples.air, air, ground)
    fields = [motor_field(samples, part, fit, ground) for part, fit in zip(parts, (first, second), strict=True)]
    one, two = (None if field is None else field.at(samples) for field in fields)
    return CompassStudy(
        samples,
        air,
        before,
        after,
        ground,
        _is_steady(air, first, second),
        _single_cause(samples) if air.counts else "offset",
        proof,
        added,
        None if one is None or two is None else cross_validate(samples, parts, (one, two)),
    )


def motor_field(samples: FieldSamples, use: Mask, air: OffsetFit, ground: OffsetFit | None) -> MotorField | None:
    """The field of the motors by two points, the ground and the fit ``air`` of the samples ``use``.

    None without ground or power, or where that hardly differs.
    """
    if ground is None or not np.isfinite(samples.hover):
        return None
    on_ground = samples.mean_power(samples.before | samples.after)
    power = samples.mean_power(use) - on_ground
    if not power > 0.5 * samples.hover:
        return None
    added = air.offset - ground.offset
    still = ground.offset - added / power * on_ground
    sigma = np.hypot(air.sigma, ground.sigma)
    return MotorField(added / power, added, sigma, power, still if ground.counts else np.zeros(3))


def _is_steady(whole: OffsetFit, one: OffsetFit, two: OffsetFit) -> bool:
    limit = np.maximum(HALVES_SHARE * whole.size, HALVES_SIGMAS * whole.sigma)
    return bool(np.all(np.abs(one.offset - two.offset) <= limit))


def _single_cause(samples: FieldSamples) -> Cause:
    """What alone explains the field in flight."""
    use = samples.air
    found = fit_simplest(samples.t[use], samples.expected[use], samples.measured[use], samples.seconds)
    if found is None or not found.one_fault:
        return "neither"
    return "offset" if abs(found.turn_deg) <= TURN_OFF_DEG else "turn"
