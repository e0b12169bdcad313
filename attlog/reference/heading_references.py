"""Heading references: who else can tell in the air where the nose, or the path, pointed."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from attlog import estimators
from attlog.base import rotation
from attlog.base.errors import AttlogError
from attlog.flight.model import Attitude, FlightLog, Gnss, Imu
from attlog.reference import clock
from attlog.reference.compare import interpolate
from attlog.reference.model import HeadingReference, Reference
from attlog.segments import Segments, gaps, resets

Array = NDArray[np.float64]
Index = NDArray[np.int64]

MAG_SMOOTHING_S = 1.0
COURSE_SPEED_M_S = 5.0
LEVELLED_BY = "mahony"
"""Its tilt levels the magnetometer where there is no reference, whichever filters are compared."""
LEAST = 10
MOST_OFF = 2.0
"""RMS, in its own sigmas, of a yaw estimator's difference to the reference: beyond, it is in error itself."""


def heading_references(log: FlightLog, segments: Segments, reference: Reference) -> dict[str, HeadingReference]:
    """Headings by name: onboard, truth, mag, gnss_yaw, yaw_estimator, course, as far as the log has them.

    Degrees on the log's clock; segments end at gaps and at resets of the heading reference. An
    attitude that was refused as reference, or is in error, is no heading reference either.
    """
    found: dict[str, HeadingReference] = {}
    for name, attitude in (("onboard", log.onboard_attitude), ("truth", log.truth_with_north)):
        if attitude is None or name in reference.refused or (name == "onboard" and reference.onboard_error):
            continue
        t, q, segment = _attitude(log, segments, reference, name, attitude)
        if len(t) >= LEAST:
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


def _attitude(
    log: FlightLog, segments: Segments, reference: Reference, name: str, attitude: Attitude
) -> tuple[Array, Array, Index]:
    """Times, attitudes and segments of the onboard attitude or the truth; those of the reference are known already."""
    if reference.kind == name and reference.name in ("", log.onboard):
        return reference.t, reference.q, reference.segment
    t, q, kept = clock.usable(attitude, reference.clock)
    imu = log.replay_imu
    jumped = np.zeros(len(attitude.t), np.int64)
    jumped[
        resets.known(log, log.onboard or "", segments)[0] if name == "onboard" else resets.find(attitude, imu)[0]
    ] = 1
    return t, q, gaps.renumber(gaps.number(t), np.cumsum(jumped)[kept])


def _magnetic(log: FlightLog, reference: Reference) -> HeadingReference | None:
    """Heading by the magnetometer, levelled with the reference's tilt (without reference: that of LEVELLED_BY)."""
    if log.mag is None:
        return None
    field = log.mags[log.mag].field
    t, x = gaps.rising(field.t_best, field.x)
    if reference.kind != "none":
        q, _ = interpolate(reference.t, reference.q, reference.segment, t)
        level = reference.source
    elif log.replay_imu is not None:
        try:
            own, tilt = _tilt(log.replay_imu, reference.clock)
        except AttlogError:
            return None  # an IMU that no filter can be run on levels nothing
        q, _ = interpolate(own, tilt, gaps.number(own), t)
        level = LEVELLED_BY
    else:
        return None
    good = rotation.finite(q) & np.any(x != 0, axis=1)
    if np.count_nonzero(good) < LEAST:
        return None
    t, x, q = t[good], x[good], q[good]
    roll_pitch = rotation.to_euler(q)
    levelled = rotation.rotate(rotation.from_euler(roll_pitch[:, 0], roll_pitch[:, 1], np.zeros(len(t))), x)
    north = reference.declination_deg or 0.0
    segment = gaps.number(t)
    heading = _smooth(t, -np.arctan2(levelled[:, 1], levelled[:, 0]), roll_pitch[:, 2], segment)
    text = f"{field.source} levelled with the tilt of {level}, mean over {MAG_SMOOTHING_S:.0f} s"
    text += f", declination {north:.1f} deg" if reference.declination_deg is not None else ", magnetic north"
    return HeadingReference("mag", t, np.degrees(rotation.wrap(heading + np.radians(north))), segment, text)


def _tilt(imu: Imu, which: clock.Clock) -> tuple[Array, Array]:
    """Times and attitudes of an IMU alone; only their tilt means anything."""
    t = imu.gyro.t_best if which == "sample" else imu.gyro.t
    found = estimators.estimate(LEVELLED_BY, t, imu.gyro.x, imu.acc.x, sampling=imu.gyro.sampling, dt=imu.dt)
    return found.t, found.q


def _smooth(t: Array, heading: Array, turning: Array, segment: Index) -> Array:
    """Headings (n,) rad low-passed by a centred mean over 1 s of their difference from ``turning``.

    Averaging the difference and not the heading keeps turns as they were: the
    magnetometer tells where north is, the levelling attitude how the nose moved.
    """
    off = np.exp(1j * (heading - turning))
    total = np.concatenate([[0], np.cumsum(off)])
    low = np.maximum(np.searchsorted(t, t - 0.5 * MAG_SMOOTHING_S), np.searchsorted(segment, segment))
    high = np.minimum(
        np.searchsorted(t, t + 0.5 * MAG_SMOOTHING_S, "right"), np.searchsorted(segment, segment, "right")
    )
    return np.asarray(turning + np.angle(total[high] - total[low]))


def _dual_antenna(log: FlightLog) -> HeadingReference | None:
    """Heading by the first receiver with two antennas."""
    for gnss in log.gnss:
        heading = gnss.heading
        if heading is not None and len(heading.t) >= LEAST:
            t, yaw = gaps.rising(heading.t, heading.x)
            return HeadingReference("gnss_yaw", t, np.degrees(rotation.wrap(yaw[:, 0])), gaps.number(t), heading.source)
    return None


def _yaw_estimator(log: FlightLog, reference: Reference) -> HeadingReference | None:
    """Heading by the autopilot's own estimator of yaw from GNSS motion, where it calls it valid.

    ArduPilot's is up to 110 deg off at a sigma of 4 in simulated flights: none where truth or smoother contradict it.
    """
    own = log.yaw_estimator
    if own is None:
        return None
    t, x = gaps.rising(own.t_best, own.x)
    if len(t) < LEAST:
        return None
    if reference.kind in ("truth", "smoother") and reference.heading_by == "own":
        q, _ = interpolate(reference.t, reference.q, reference.segment, t)
        known = rotation.finite(q)
        off = rotation.wrap(x[known, 0] - rotation.to_euler(q[known])[:, 2]) / x[known, 1]
        if len(off) >= LEAST and np.mean(off**2) > MOST_OFF**2:
            return None
    heading = np.degrees(rotation.wrap(x[:, 0]))
    sigma = float(np.degrees(np.median(x[:, 1])))
    text = f"yaw of {own.source} from GNSS motion, no compass (median sigma {sigma:.1f} deg)"
    return HeadingReference("yaw_estimator", t, heading, gaps.number(t), text)


def _course(log: FlightLog) -> HeadingReference | None:
    """Course over ground of a fixed-wing aircraft above 5 m/s: the path's direction, not the nose's."""
    if not log.kind.fixed_wing:
        return None
    for gnss in log.gnss:
        t, velocity = _moving(gnss)
        if len(t) >= LEAST:
            heading = np.degrees(np.arctan2(velocity[:, 1], velocity[:, 0]))
            text = f"course of {gnss.source} above {COURSE_SPEED_M_S:.0f} m/s; wind turns it off the heading"
            return HeadingReference("course", t, heading, gaps.number(t), text)
    return None


def _moving(gnss: Gnss) -> tuple[Array, Array]:
    """Times and horizontal velocities (m, 2) of a receiver with a 3D fix above 5 m/s."""
    t, velocity = gaps.rising(np.where(gnss.fix >= 3, gnss.t, np.nan), gnss.vel_ned[:, :2])
    fast = np.hypot(velocity[:, 0], velocity[:, 1]) > COURSE_SPEED_M_S
    return t[fast], velocity[fast]
