"""Headings by GNSS motion, compass, receivers and autopilot; onboard heading test."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from attlog import estimators
from attlog.core import rotation
from attlog.core.errors import AttlogError
from attlog.core.log_cache import cached_per_log
from attlog.core.sorting import median
from attlog.core.spans import Span, between, complement, intersect, merge
from attlog.estimators.evidence import WRONG_DEG, WRONG_SIGMAS, HeadingOffset, both
from attlog.flight.model import Attitude, FlightLog, Gnss, Imu
from attlog.reference import alignment, scoring, sensor_faults
from attlog.reference.model import HeadingReference, Reference
from attlog.reference.smoother import smoothable
from attlog.segments import Segments, increments, model
from attlog.segments.model import interpolate_attitudes

Array = NDArray[np.float64]
FIX_3D = 3
# Windows of 1.3 s, with the longest delay of a receiver, depend on no sample further from them.
BESIDE_SPAN_S = 2.0


@dataclass(frozen=True, slots=True, eq=False)
class GnssMotion:
    """Specific force and GNSS velocities, from which a heading error is estimated.

    ``acc`` (n, 3) m/s^2 at ``t`` (n,) s; ``velocity`` (m, 3) m/s NED of 3D fixes at ``fixes_t`` (m,) s; ``spans``:
    usable time.
    """

    t: Array
    acc: Array
    fixes_t: Array
    velocity: Array
    spans: list[Span]

    def near(self, span: Span) -> GnssMotion:
        """Return all that offsets within a span depend on."""
        begin, end = span[0] - BESIDE_SPAN_S, span[1] + BESIDE_SPAN_S
        at, fixes = between(self.t, begin, end), between(self.fixes_t, begin, end)
        spans = intersect(self.spans, [span])
        return GnssMotion(self.t[at], self.acc[at], self.fixes_t[fixes], self.velocity[fixes], spans)

    def offsets(
        self, t: Array, q: Array, segment: NDArray[np.int64], since: float = -np.inf, spans: list[Span] | None = None
    ) -> tuple[HeadingOffset, list[HeadingOffset]]:
        """Return heading errors of attitudes over the flight and per 30 s.

        Attitudes ``q`` (n, 4) at ``t`` (n,) s; none is interpolated between different ``segment`` numbers (n,). Limited
        to times from ``since`` s on and to ``spans``.
        """
        q = q if t is self.t else interpolate_attitudes(t, q, segment, self.t)[0]
        counted = intersect(self.spans, [(since, np.inf)])
        counted = counted if spans is None else intersect(counted, spans)
        return both(self.t, self.acc, q, self.fixes_t, self.velocity, np.array(counted).reshape(-1, 2))


@cached_per_log
def find_gnss_motion(log: FlightLog, segments: Segments) -> GnssMotion | None:
    """Return specific force of the replayed IMU and GNSS velocities in flight, up to an impact.

    In the whole log where no flight is known. None without GNSS, or if the accelerometer's axes are wrong: every
    heading would appear wrong.
    """
    if log.replay_imu is None or sensor_faults.wrong_frame(log, segments):
        return None
    return gnss_motion(log, segments, log.replay_imu)


def gnss_motion(log: FlightLog, segments: Segments, imu: Imu) -> GnssMotion | None:
    """Return specific force and GNSS velocities in flight, up to an impact; None without GNSS.

    In the whole log where no flight is known.
    """
    receiver = next((g for g in log.gnss if np.count_nonzero(g.fix >= FIX_3D) > 1), None)
    if receiver is None:
        return None
    fixes_t, velocity = model.select_rising(np.where(receiver.fix >= FIX_3D, receiver.t, np.nan), receiver.vel_ned)
    if len(fixes_t) < 2:
        return None
    flown, whole = segments.spans("airborne"), smoothable(log, segments)
    spans = intersect(whole, flown) if flown else whole
    spans = intersect(spans, complement(_clipped(log, imu), -np.inf, np.inf))
    return GnssMotion(imu.gyro.t_best, imu.acc.x, fixes_t, velocity, spans)


def _clipped(log: FlightLog, imu: Imu) -> list[Span]:
    """Return the spans in which the accelerometer clipped."""
    found: list[Span] = []
    for clipping in log.vibration.clippings:
        if clipping.sensor == "accelerometer" and clipping.unit in (None, imu.index):
            k = np.flatnonzero(clipping.new > 0)
            found += zip(clipping.t[np.maximum(k - 1, 0)].tolist(), clipping.t[k].tolist(), strict=True)
    return found


# Test of the onboard heading against GNSS acceleration, over the flight and in parts of 30 s.

# Two parts of 30 s have equal offsets within this many joint sigmas.
SAME_SIGMAS = 2.0


class WrongHeading(NamedTuple):
    """Spans of a wrong heading, with the best known offset."""

    spans: list[Span]
    offset: HeadingOffset
    partly: bool = False


@cached_per_log
def onboard_offsets(log: FlightLog, segments: Segments) -> tuple[HeadingOffset, list[HeadingOffset]] | None:
    """Return the aligned onboard attitude's heading error, overall and per 30 s; None without attitude or GNSS."""
    motion, attitude = find_gnss_motion(log, segments), log.onboard_attitude
    if motion is None or attitude is None:
        return None
    t, q, _ = alignment.usable_samples(attitude, "sample")
    aligned = scoring.aligned_at(attitude, increments.known_resets(log, log.onboard or "", segments)[0], segments)
    return motion.offsets(t, q, model.number_segments(t), -np.inf if aligned is None else aligned)


def find_wrong_heading(whole: HeadingOffset, parts: list[HeadingOffset]) -> WrongHeading | None:
    """Return the spans of a wrong heading; None without any."""
    off = [part for part in parts if part.wrong]
    if whole.wrong and not any(part.known and not part.wrong for part in parts):
        return WrongHeading([(whole.t0, whole.t1)], whole)
    if off:
        spans = list(merge((part.t0, part.t1) for part in [*off, *_equal_offsets(off, parts)]))
        return WrongHeading(spans, min(off, key=lambda part: part.sigma_deg), partly=any(part.sound for part in parts))
    return WrongHeading([(whole.t0, whole.t1)], whole) if whole.wrong else None


def _equal_offsets(off: list[HeadingOffset], parts: list[HeadingOffset]) -> list[HeadingOffset]:
    """Return neighbours of wrong parts with equal, less significant offsets."""
    found: list[HeadingOffset] = []
    queue = list(off)
    while queue:
        one = queue.pop()
        for part in parts:
            apart = abs((part.offset_deg - one.offset_deg + 180.0) % 360.0 - 180.0)
            near = part.t0 <= one.t1 and part.t1 >= one.t0 and part not in found and not part.known
            off_too = abs(part.offset_deg) > max(WRONG_DEG, WRONG_SIGMAS * part.sigma_deg)
            if near and off_too and apart <= SAME_SIGMAS * math.hypot(part.sigma_deg, one.sigma_deg):
                found.append(part)
                queue.append(part)
    return found


@cached_per_log
def wrong_onboard_heading(log: FlightLog, segments: Segments) -> str:
    """Return the onboard heading error by GNSS as a clause, or empty."""
    offsets = onboard_offsets(log, segments)
    wrong = None if offsets is None else find_wrong_heading(*offsets)
    return "" if wrong is None else f"the heading of {log.onboard} is {heading_error_words(wrong.offset)}"


def heading_error_words(found: HeadingOffset) -> str:
    """Return ``28 deg wrong (± 4 deg) by the motion that GNSS shows``."""
    size, sigma = round(abs(found.offset_deg), 1), max(found.sigma_deg, 1.0)  # rounded as the check's value
    return f"{size:.0f} deg wrong (± {sigma:.0f} deg) by the motion that GNSS shows"


# Heading references in the air: other sources of the direction of the nose, or of the path.

Index = NDArray[np.int64]

MAG_SMOOTHING_S = 1.0  # averages magnetometer noise
COURSE_SPEED_M_S = 5.0  # slower, noise and wind turn the course
# Filter whose tilt levels the magnetometer where there is no reference.
LEVELLED_BY = "mahony"
MIN_HEADINGS = 10  # fewer are no track
# RMS difference of a yaw estimator to the reference, in its sigmas, above which it is wrong.
MAX_YAW_SIGMAS = 2.0


def heading_references(log: FlightLog, segments: Segments, reference: Reference) -> dict[str, HeadingReference]:
    """Return headings by source name, where logged.

    Names: onboard, truth, mag, gnss_yaw, yaw_estimator, course. Segments end at gaps and at resets of the source.
    Attitudes that were refused as reference or are in error are left out.
    """
    found: dict[str, HeadingReference] = {}
    for name, attitude in (("onboard", log.onboard_attitude), ("truth", log.truth_with_north)):
        if attitude is None or name in reference.faults.refused or (name == "onboard" and reference.faults.onboard):
            continue
        t, q, segment = _attitude_samples(log, segments, reference, name, attitude)
        if len(t) >= MIN_HEADINGS:
            found[name] = HeadingReference(
                name, t, np.degrees(rotation.to_euler(q)[:, 2]), segment, f"yaw of {attitude.source}"
            )
    for heading_reference in (
        _magnetic(log, reference),
        _dual_antenna(log),
        _yaw_estimator(log, reference),
        _course(log),
    ):
        if heading_reference is not None:
            found[heading_reference.name] = heading_reference
    return found


def _attitude_samples(
    log: FlightLog, segments: Segments, reference: Reference, name: str, attitude: Attitude
) -> tuple[Array, Array, Index]:
    """Return times, attitudes and segments of the onboard attitude or the truth."""
    if reference.kind == name and reference.name in ("", log.onboard):
        return reference.t, reference.q, reference.segment
    t, q, kept = alignment.usable_samples(attitude, reference.alignment.clock)
    imu = log.replay_imu
    jumped = np.zeros(len(attitude.t), np.int64)
    jumped[
        increments.known_resets(log, log.onboard or "", segments)[0]
        if name == "onboard"
        else increments.find_resets(attitude, imu)[0]
    ] = 1
    return t, q, model.merge_numbers(model.number_segments(t), np.cumsum(jumped)[kept])


def _magnetic(log: FlightLog, reference: Reference) -> HeadingReference | None:
    """Return the heading by the magnetometer, levelled with the reference's tilt, else that of LEVELLED_BY."""
    if log.mag is None:
        return None
    field = log.mags[log.mag].field
    t, x = model.select_rising(field.t_best, field.x)
    if reference.kind != "none":
        q, _ = interpolate_attitudes(reference.t, reference.q, reference.segment, t)
        level = reference.source
    elif log.replay_imu is not None:
        try:
            own, tilt = _levelling_attitude(log.replay_imu, reference.alignment.clock)
        except AttlogError:
            return None  # no filter can be run on this IMU
        q, _ = interpolate_attitudes(own, tilt, model.number_segments(own), t)
        level = LEVELLED_BY
    else:
        return None
    good = rotation.finite_rows(q) & np.any(x != 0, axis=1)
    if np.count_nonzero(good) < MIN_HEADINGS:
        return None
    t, x, q = t[good], x[good], q[good]
    roll_pitch = rotation.to_euler(q)
    levelled = rotation.rotate(rotation.from_euler(roll_pitch[:, 0], roll_pitch[:, 1], np.zeros(len(t))), x)
    north = reference.alignment.declination_deg or 0.0
    segment = model.number_segments(t)
    heading = _smooth(t, -np.arctan2(levelled[:, 1], levelled[:, 0]), roll_pitch[:, 2], segment)
    text = f"{field.source} levelled with the tilt of {level}, mean over {MAG_SMOOTHING_S:.0f} s"
    text += f", declination {north:.1f} deg" if reference.alignment.declination_deg is not None else ", magnetic north"
    return HeadingReference("mag", t, np.degrees(rotation.wrap(heading + np.radians(north))), segment, text)


def _levelling_attitude(imu: Imu, which: alignment.Clock) -> tuple[Array, Array]:
    """Return times and attitudes of filter LEVELLED_BY without a magnetometer."""
    t = imu.gyro.t_best if which == "sample" else imu.gyro.t
    found = estimators.estimate(
        LEVELLED_BY, t, imu.gyro.x, imu.acc.x, sampling=imu.gyro.sampling, dt=imu.dt, check_units=False
    )
    return found.t, found.q


def _smooth(t: Array, heading: Array, turning: Array, segment: Index) -> Array:
    """Return headings (n,) rad, low-passed relative to ``turning`` (n,) rad.

    A centred mean of the difference over 1 s keeps turns unchanged.
    """
    off = np.exp(1j * (heading - turning))
    total = np.concatenate([[0], np.cumsum(off)])
    low = np.maximum(np.searchsorted(t, t - 0.5 * MAG_SMOOTHING_S), np.searchsorted(segment, segment))
    high = np.minimum(
        np.searchsorted(t, t + 0.5 * MAG_SMOOTHING_S, "right"), np.searchsorted(segment, segment, "right")
    )
    return np.asarray(turning + np.angle(total[high] - total[low]))


def _dual_antenna(log: FlightLog) -> HeadingReference | None:
    """Return the heading of the first receiver with two antennas."""
    for gnss in log.gnss:
        heading = gnss.heading
        if heading is not None and len(heading.t) >= MIN_HEADINGS:
            t, yaw = model.select_rising(heading.t, heading.x)
            return HeadingReference(
                "gnss_yaw", t, np.degrees(rotation.wrap(yaw[:, 0])), model.number_segments(t), heading.source
            )
    return None


def _yaw_estimator(log: FlightLog, reference: Reference) -> HeadingReference | None:
    """Return the autopilot's yaw estimate from GNSS motion, where valid.

    None if truth or smoother contradict it: ArduPilot's is up to 110 deg off at a sigma of 4 deg in simulated flights.
    """
    own = log.estimator.yaw
    if own is None:
        return None
    t, x = model.select_rising(own.t_best, own.x)
    if len(t) < MIN_HEADINGS:
        return None
    if reference.kind in ("truth", "smoother") and reference.heading.by == "own":
        q, _ = interpolate_attitudes(reference.t, reference.q, reference.segment, t)
        known = rotation.finite_rows(q)
        off = rotation.wrap(x[known, 0] - rotation.to_euler(q[known])[:, 2]) / x[known, 1]
        if len(off) >= MIN_HEADINGS and np.mean(off**2) > MAX_YAW_SIGMAS**2:
            return None
    heading = np.degrees(rotation.wrap(x[:, 0]))
    sigma = float(np.degrees(median(x[:, 1])))
    text = f"yaw of {own.source} from GNSS motion, no compass (median sigma {sigma:.1f} deg)"
    return HeadingReference("yaw_estimator", t, heading, model.number_segments(t), text)


def _course(log: FlightLog) -> HeadingReference | None:
    """Return the course over ground of a fixed-wing aircraft above 5 m/s."""
    if not log.kind.fixed_wing:
        return None
    for gnss in log.gnss:
        t, velocity = _moving(gnss)
        if len(t) >= MIN_HEADINGS:
            heading = np.degrees(np.arctan2(velocity[:, 1], velocity[:, 0]))
            text = f"course of {gnss.source} above {COURSE_SPEED_M_S:.0f} m/s; wind turns it off the heading"
            return HeadingReference("course", t, heading, model.number_segments(t), text)
    return None


def _moving(gnss: Gnss) -> tuple[Array, Array]:
    """Return times and horizontal velocities (m, 2) of fast 3D fixes."""
    t, velocity = model.select_rising(np.where(gnss.fix >= 3, gnss.t, np.nan), gnss.vel_ned[:, :2])
    fast = np.hypot(velocity[:, 0], velocity[:, 1]) > COURSE_SPEED_M_S
    return t[fast], velocity[fast]
