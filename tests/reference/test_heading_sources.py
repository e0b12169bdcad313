"""Every heading reference tells the heading it claims to tell, in pieces without gap or reset."""

from __future__ import annotations

import math

import numpy as np
import pytest

from attlog import segments
from attlog.core import rotation
from attlog.flight.model import Gnss, Mag, Stream
from attlog.reference import ReferenceOptions, choose, heading_references
from attlog.reference.model import HeadingReference, Reference
from tests.reference.flights import RATE, SECONDS, attitude_at, flight

T = np.arange(0.0, SECONDS, 1 / RATE)
NORTH = np.array([math.cos(math.radians(5.0)), math.sin(math.radians(5.0)), 2.0]) * 2e-5


def with_mag(noise: float = 0.0, **more):
    """A flight with truth and a magnetometer at 20 Hz in a field with 5 deg of declination."""
    log = flight(truth_hz=50.0, **more)
    t = T[::5]
    x = rotation.rotate_inverse(attitude_at(t), NORTH) + noise * np.random.default_rng(1).normal(size=(len(t), 3))
    log.mags, log.mag = [Mag(0, Stream(t, x, "T", "FRD", "MAG:0"))], 0
    return log


def told(log, **options) -> tuple[dict[str, HeadingReference], Reference]:
    """The heading_references of a log."""
    found = segments.build(log)
    reference = choose(log, found, ReferenceOptions(**{"declination": 5.0, **options}))
    return heading_references(log, found, reference), reference


def off_deg(heading_reference: HeadingReference) -> np.ndarray:
    """How far a heading reference is from the true heading, deg."""
    true = rotation.to_euler(attitude_at(heading_reference.t))[:, 2]
    return np.degrees(rotation.wrap(np.radians(heading_reference.heading_deg) - true))


def receiver(vel_ned: np.ndarray, t: np.ndarray, yaw: np.ndarray | None = None) -> Gnss:
    """A receiver with velocities."""
    one = np.ones(len(t))
    return Gnss(0, t, "GPS:0", 47 * one, 8 * one, 400 * one, vel_ned, one, one, one, np.full(len(t), 3), yaw=yaw)


def test_truth_onboard_and_magnetometer_tell_the_same_heading():
    found, _ = told(with_mag())
    assert set(found) == {"onboard", "truth", "mag"}
    for heading_reference in found.values():
        assert np.abs(off_deg(heading_reference)).max() < 0.2, heading_reference.name
        assert len(heading_reference.t) == len(heading_reference.heading_deg) == len(heading_reference.segment)


def test_the_magnetometer_is_low_passed_without_lag_in_turns():
    quiet, _ = told(with_mag(noise=0.0))
    noisy, _ = told(with_mag(noise=1e-6))
    assert np.std(off_deg(noisy["mag"])) < 1.2
    assert abs(np.mean(off_deg(noisy["mag"])[noisy["mag"].t > 25])) < 0.2
    assert np.abs(off_deg(quiet["mag"])).max() < 0.2


def test_a_magnetometer_without_declination_says_magnetic_north():
    log = with_mag()
    found, reference = told(log, declination="auto")
    assert reference.alignment.declination_deg is None
    assert "magnetic north" in found["mag"].text
    assert np.median(off_deg(found["mag"])) == pytest.approx(-5.0, abs=0.1)


def test_without_reference_the_magnetometer_is_levelled_by_a_filter_of_its_own():
    """Not by one of those compared: what they are compared with must not change with them."""
    log = with_mag()
    log.truth, log.attitudes, log.onboard = None, {}, None
    found = segments.build(log)
    heading_reference = heading_references(log, found, choose(log, found, ReferenceOptions(declination=5.0)))["mag"]
    assert "tilt of mahony" in heading_reference.text
    assert np.abs(off_deg(heading_reference)).max() < 1.0


def test_a_reset_and_a_gap_begin_a_new_piece():
    log = with_mag()
    attitude = log.attitudes["ATT"]
    attitude.q[800:] = rotation.turn_about_down(attitude.q[800:], np.radians(30.0))
    for stream in (log.mags[0].field,):
        keep = (stream.t < 30) | (stream.t > 33)
        stream.t, stream.x = stream.t[keep], stream.x[keep]
    found, _ = told(log)
    assert np.unique(found["onboard"].segment).tolist() == [0, 1]
    assert found["onboard"].t[np.argmax(found["onboard"].segment == 1)] == pytest.approx(40.0)
    assert np.unique(found["mag"].segment).tolist() == [0, 1]
    assert np.unique(found["truth"].segment).tolist() == [0]


def test_course_is_told_for_fixed_wings_above_five_metres_per_second_only():
    log = flight()
    t = np.arange(0.0, SECONDS, 0.2)
    speed = np.where(t > 20, 15.0, 2.0)
    yaw = rotation.to_euler(attitude_at(t))[:, 2]
    log.gnss = [receiver(np.column_stack([speed * np.cos(yaw), speed * np.sin(yaw), 0 * t]), t)]
    assert "course" not in told(log)[0]
    log.vehicle = "fixed wing"
    course = told(log)[0]["course"]
    assert course.t.min() > 20
    assert np.abs(off_deg(course)).max() < 1e-6
    assert "course" in course.text
    assert "wind" in course.text


def test_two_antennas_tell_a_heading_in_radians_of_the_log():
    log = flight()
    t = np.arange(0.0, SECONDS, 0.2)
    yaw = rotation.to_euler(attitude_at(t))[:, 2]
    yaw[::7] = np.nan
    log.gnss = [receiver(np.zeros((len(t), 3)), t, yaw=yaw)]
    heading_reference = told(log)[0]["gnss_yaw"]
    assert np.abs(off_deg(heading_reference)).max() < 1e-6


def test_a_magnetometer_that_is_all_zero_is_no_heading_reference():
    log = with_mag()
    log.mags[0].field.x[:] = 0.0
    assert "mag" not in told(log)[0]


def test_the_yaw_that_an_autopilot_finds_from_gnss_motion_is_a_heading_of_its_own():
    log = flight()
    t = np.arange(0.0, SECONDS, 0.2)
    yaw = rotation.to_euler(attitude_at(t))[:, 2]
    log.estimator.yaw = Stream(t, np.column_stack([yaw, np.full(len(t), 0.05)]), "rad", "NED", "yaw_estimator_status")
    heading_reference = told(log)[0]["yaw_estimator"]
    assert np.abs(off_deg(heading_reference)).max() < 1e-6
    assert "sigma 2.9 deg" in heading_reference.text


def test_a_yaw_estimator_that_the_truth_contradicts_is_no_heading_reference():
    log = flight(truth_hz=50.0)
    t = np.arange(0.0, SECONDS, 0.2)
    yaw = rotation.to_euler(attitude_at(t))[:, 2]
    for off_sigmas, kept in ((1.0, True), (5.0, False)):
        x = np.column_stack([yaw + off_sigmas * 0.05, np.full(len(t), 0.05)])
        log.estimator.yaw = Stream(t, x, "rad", "NED", "XKY0:0")
        assert ("yaw_estimator" in told(log)[0]) == kept
