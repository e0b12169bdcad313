"""Samples of a compass in flight and on the ground, its offset, and the proof by the other half of the flight."""

from __future__ import annotations

import math

import numpy as np
import pytest

from attlog import flight as attlog_flight
from attlog.core import rotation
from attlog.flight.compass import motor_drive, power_at
from attlog.flight.model import Mag, Stream, TimeLine
from attlog.health import compass_offset
from attlog.health.check import HealthCase, MotionAttitude
from attlog.health.compass_offset import (
    FieldSamples,
    HeadingProof,
    cross_validate,
    fit_offset,
    heading_error,
    rms_deg,
    total_sigma,
)
from attlog.health.flown import flight_before_crash
from attlog.reference import alignment
from attlog.segments.model import Segment, Segments
from tests.conftest import SAMPLES
from tests.flight.made_log import with_fields
from tests.health.made_compass import EARTH, empty_log, samples
from tests.health.made_flight import OMEGA, SPEED, case, flight


class Model:
    """The earth's field."""

    ned_t = tuple(1e-6 * EARTH)


def flown(*more: Segment) -> Segments:
    return Segments([Segment("airborne", 30.0, 60.0), Segment("airborne", 80.0, 100.0), *more])


def test_the_ground_is_20_s_before_and_after_and_never_a_wreck() -> None:
    assert compass_offset.ground_spans(flown()) == ([(10.0, 30.0)], [(100.0, 120.0)])
    assert compass_offset.ground_spans(flown(Segment("impact", 99.0, 101.0)))[1] == []
    assert compass_offset.ground_spans(Segments()) == ([], [])


def test_power_far_from_any_record_is_unknown() -> None:
    drive = Stream(np.array([0.0, 1.0, 20.0]), np.array([[2.0], [4.0], [6.0]]), "A", "", "BAT")
    at = power_at(drive, np.array([0.5, 2.0, 10.0, 20.0, 30.0]))
    assert at[[0, 1, 3]] == pytest.approx([3.0, 4.0 + 2.0 / 19.0, 6.0])
    assert np.isnan(at[[2, 4]]).all()
    assert np.isnan(power_at(None, np.zeros(2))).all()


def test_a_current_of_zero_gives_way_to_the_throttle() -> None:
    t = np.arange(100.0)
    throttle = Stream(t, np.full((100, 1), 0.5), "1", "", "CTUN")
    log = with_fields(empty_log(), throttle=throttle, battery=Stream(t, np.zeros((100, 2)), "V", "", "BAT"))
    assert motor_drive(log) == ("throttle", throttle)
    log.power.battery = Stream(t, np.full((100, 2), 12.0), "V", "", "BAT")
    assert motor_drive(log)[0] == "current"


def gathered(sigma_deg: float = 1.0, throttle_on_ground: float = 0.0, tilt: float = 0.0) -> FieldSamples | None:
    t = np.arange(0.0, 140.0, 0.1)
    air = (t > 30.0) & (t < 100.0)
    power = np.where(air, 0.5, throttle_on_ground)
    log = with_fields(empty_log(), throttle=Stream(t, power[:, None], "1", "", "CTUN"))
    log.state.armed = TimeLine(np.array([0.0, 25.0]), [False, True], "ARM")
    q = np.tile([np.cos(tilt / 2), np.sin(tilt / 2), 0.0, 0.0], (len(t), 1))
    sigma = np.radians(np.full(len(t), sigma_deg))
    motion = MotionAttitude(t, q, np.zeros(len(t), np.int64), sigma, sigma, {})
    case = HealthCase(log, flown(), None, lambda: motion)
    mag = Mag(0, Stream(t, np.tile(1e-6 * EARTH, (len(t), 1)), "T", "FRD", "MAG.0"))
    mag.field.x[500] = np.nan
    return compass_offset.field_samples(case, mag, motion, Model())  # type: ignore[arg-type]


def test_samples_lie_in_the_air_or_on_the_ground_with_motors_off() -> None:
    found = gathered()
    assert found is not None
    assert found.seconds == pytest.approx(46.0, rel=0.01)
    assert found.error == pytest.approx(np.zeros((len(found.t), 3)), abs=1e-9)
    assert np.all(found.t[found.before] <= 30.0)
    assert np.all(found.t[found.after] >= 100.0)
    assert (found.before.any(), found.after.any()) == (True, True)
    assert found.hover == pytest.approx(0.5)


def test_idling_above_a_quarter_of_the_power_is_no_ground() -> None:
    found = gathered(throttle_on_ground=0.2)
    assert found is not None
    assert not found.before.any()
    assert not found.after.any()


def test_an_unsure_heading_and_a_vehicle_on_its_back_give_no_samples() -> None:
    assert gathered(sigma_deg=6.0) is None
    assert gathered(tilt=np.pi) is None


# Why no attitude judges a compass: each reason in its turn, and the acceleration that shows a heading.


def test_the_acceleration_is_its_rms_over_the_flight_whichever_of_gnss_and_force_shows_less() -> None:
    """Sines of 3.6 and 1.59 m/s^2 north and east, without the mean of each half minute."""
    log = flight()
    one = case(log)
    assert one.motion is not None
    flown_spans = flight_before_crash(one.segments)
    whole = np.sqrt(np.sum((SPEED * OMEGA) ** 2) / 2.0)
    found = compass_offset.horizontal_acceleration(log, one.motion, flown_spans)
    assert found == pytest.approx(whole, rel=0.1)
    log.gnss[0].vel_ned *= 0.5
    assert compass_offset.horizontal_acceleration(log, one.motion, flown_spans) == pytest.approx(0.5 * found, rel=0.1)
    log.gnss = []
    assert compass_offset.horizontal_acceleration(log, one.motion, flown_spans) == 0.0


# The offset of a compass against planted ones, closed forms and MAGFit's formula.


def test_a_tenth_of_wild_samples_moves_it_by_little() -> None:
    made = samples((-12.0, 5.0, 3.0))
    wild = made.air & (np.arange(len(made.t)) % 10 == 0)
    made.measured[wild] += 40.0
    found = fit_offset(made, made.air)
    assert found is not None
    assert found.offset == pytest.approx([-12.0, 5.0, 3.0], abs=0.15)


def test_the_error_holds_heading_tilt_and_model() -> None:
    """By hand: 2 deg of heading in 20 uT, 0.8 deg of tilt in 40 uT, 1 % of 44.7 uT, 0.3 uT, 1.5 standard errors."""
    sigma = total_sigma(np.array([0.2, 0.2, 0.2]), math.radians(2.0), np.array([20.0, 0.0, 40.0]))
    across = math.sqrt(0.3**2 + (0.0349066 * 20) ** 2 + (0.0139626 * 40) ** 2 + 0.3**2)
    along = math.sqrt(0.3**2 + (0.0139626 * 20) ** 2 + (0.01 * 44.72136) ** 2 + 0.3**2)
    assert sigma == pytest.approx([across, across, along], rel=1e-5)


def test_an_offset_with_an_unsure_heading_does_not_count() -> None:
    sure, unsure = (fit_offset(one, one.air) for one in (samples((3.0, 0.0, 0.0), sigma_deg=s) for s in (0.5, 4.0)))
    assert sure is not None
    assert unsure is not None
    assert (sure.counts, unsure.counts) == (True, False)


def test_on_the_same_numbers_it_is_that_of_magfit() -> None:
    """MAGFit's offsets only: least squares of raw + ofs - expected, with the attitude of the log; within 1 mG."""
    log = attlog_flight.read(SAMPLES / "copter_steps_stabilize.bin")
    attitude, model = log.onboard_attitude, alignment.earth_field(log)
    assert attitude is not None
    assert model is not None
    field = log.mags[0].field
    planted = np.array([-14.0, 6.0, 9.0])
    q = rotation.slerp(attitude.t, attitude.q, field.t_best)
    use = rotation.finite_rows(q) & rotation.finite_rows(field.x) & (field.t_best > 25.0) & (field.t_best < 60.0)
    raw_mgauss = 1e7 * field.x[use] + 10.0 * planted
    w, x, y, z = q[use].T
    down_to_body = np.array(  # the transposed direction cosine matrix, written out
        [
            [1 - 2 * (y * y + z * z), 2 * (x * y + w * z), 2 * (x * z - w * y)],
            [2 * (x * y - w * z), 1 - 2 * (x * x + z * z), 2 * (y * z + w * x)],
            [2 * (x * z + w * y), 2 * (y * z - w * x), 1 - 2 * (x * x + y * y)],
        ]
    )
    expected = np.einsum("ijn,j->ni", down_to_body, 1e7 * np.array(model.ned_t))
    rows = np.tile(np.eye(3), (len(raw_mgauss), 1))
    ofs, *_ = np.linalg.lstsq(rows, (expected - raw_mgauss).ravel(), rcond=None)
    zeros, t = np.zeros(len(raw_mgauss)), field.t_best[use]
    made = samples()._replace(t=t, measured=0.1 * raw_mgauss, expected=0.1 * expected, sigma_heading=zeros)
    found = fit_offset(made, zeros == 0.0)
    assert found is not None
    assert 10.0 * found.offset == pytest.approx(-ofs, abs=1.0)
    assert found.offset == pytest.approx(planted, abs=1.5)  # the attitude of the log errs


# The compass's heading before and after a correction, by hand.


def test_the_error_is_what_a_pilot_reads_too_much() -> None:
    """Nose 30 deg, a field turned anticlockwise by 10 deg about the vertical: the compass reads 40 deg."""
    q = np.tile(rotation.from_euler(0.1, -0.2, np.radians(30.0)), (4, 1))
    seen = rotation.rotate_inverse(q, np.array([np.cos(np.radians(-10)), np.sin(np.radians(-10)), 2.0]))
    error = heading_error(q, seen, np.array([1.0, 0.0, 2.0]))
    assert np.degrees(error) == pytest.approx(10.0)


def test_each_half_is_corrected_by_what_was_fitted_in_the_other() -> None:
    made = samples(noise=0.0)
    first, second = made.air & (made.t <= 70.0), made.air & (made.t > 70.0)
    made.measured[second] += [8.0, 0.0, 0.0]
    right, nothing = np.tile([8.0, 0.0, 0.0], (len(made.t), 1)), np.zeros((len(made.t), 3))
    proof = cross_validate(made, (first, second), (right, nothing))
    assert proof.before == pytest.approx(rms_deg(heading_error(made.q, made.measured, EARTH)[made.air]))
    assert proof.after == pytest.approx(0.0, abs=0.01)
    assert cross_validate(made, (first, second), (nothing, right)).after > proof.before


@pytest.mark.parametrize(
    ("before", "after", "holds"),
    [
        (15.0, 1.5, True),
        (2.0, 1.2, False),
        (30.0, 22.0, False),
        (30.0, 13.0, False),
        (4.0, 2.9, False),
        (4.0, 2.7, True),
    ],
)
def test_a_correction_helps_by_30_percent_and_1_deg_to_below_12_deg(before: float, after: float, holds: bool) -> None:
    assert HeadingProof(before, after).holds == holds
