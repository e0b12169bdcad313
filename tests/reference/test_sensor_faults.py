"""The dip of the field tells an accelerometer in a frame of its own from an attitude that is wrong."""

from __future__ import annotations

import copy

import numpy as np
import pytest

from attlog import flight as attlog_flight
from attlog import segments
from attlog.core import rotation
from attlog.flight.model import FlightLog, Gnss
from attlog.reference import sensor_faults
from tests.conftest import SAMPLES
from tests.reference.flights import Array, flight
from tests.reference.test_gyro_checks import with_compass


def at_home() -> FlightLog:
    """In Zurich, where the field dips by 63 deg, as that of the made flights does."""
    log = with_compass(flight())
    t = np.arange(0.0, 60.0, 0.2)
    one, places = np.ones(len(t)), np.tile([47.4, 8.5, 400.0], (len(t), 1)).T
    log.gnss = [Gnss(0, t, "GPS", *places, np.zeros((len(t), 3)), one, one, one, np.full(len(t), 3))]
    return log


def said(log: FlightLog) -> str:
    return sensor_faults.accelerometer_contradicted(
        sensor_faults.measure_dips(log, segments.build(log), log.onboard_attitude), log.onboard_attitude
    )


def test_a_sound_accelerometer_is_not_accused() -> None:
    assert said(at_home()) == ""


@pytest.mark.parametrize("turn", [np.array([np.pi, 0, 0]), np.array([0, np.pi / 2, 0])])
def test_an_accelerometer_in_another_frame_is_found(turn: Array) -> None:
    log = at_home()
    log.imus[0].acc.x = rotation.rotate(rotation.from_rotvec(turn), log.imus[0].acc.x)
    assert "the accelerometer's axes are wrong" in said(log)


def test_an_attitude_that_is_wrong_accuses_nothing() -> None:
    log = at_home()
    attitude = log.attitudes["ATT"]
    attitude.q = rotation.multiply(attitude.q, rotation.from_rotvec(np.array([np.pi, 0.0, 0.0])))
    assert said(log) == ""


def test_without_field_place_or_attitude_nothing_tells() -> None:
    for change in ("mag", "gnss", "onboard"):
        log = at_home()
        log.imus[0].acc.x = -log.imus[0].acc.x
        assert said(log)
        setattr(log, change, [] if change == "gnss" else None)
        assert said(log) == ""


def test_a_dead_accelerometer_or_one_without_numbers_is_no_case_for_the_field() -> None:
    log = at_home()
    phases = segments.build(log)
    for value in (0.0, np.nan):
        log.imus[0].acc.x = np.full_like(log.imus[0].acc.x, value)
        assert (
            sensor_faults.accelerometer_contradicted(
                sensor_faults.measure_dips(log, phases, log.onboard_attitude), log.onboard_attitude
            )
            == ""
        )


def test_a_compass_whose_field_dips_the_other_way_is_found_and_one_in_doubt_is_not() -> None:
    log = at_home()
    phases = segments.build(log)

    def compass() -> str:
        attitude = log.onboard_attitude
        return sensor_faults.compass_contradicted(sensor_faults.measure_dips(log, phases, attitude), attitude, "MAG")

    assert compass() == ""
    field = log.mags[log.mag or 0].field
    field.x = -field.x
    assert compass().endswith("iron is near")
    assert compass().startswith("the field of MAG points 68 deg above the level of the accelerometer and of ATT;")
    log.imus[0].acc.x = -log.imus[0].acc.x  # which of the two is wrong, nothing tells
    assert compass() == ""


@pytest.mark.parametrize(("by_attitude", "accused"), [(55.0, True), (45.0, False)])
def test_an_attitude_that_is_off_itself_accuses_no_accelerometer(by_attitude: float, accused: bool) -> None:
    attitude = at_home().onboard_attitude
    found = sensor_faults.accelerometer_contradicted(sensor_faults.DipAngles(-60.0, by_attitude, 63.0), attitude)
    assert bool(found) is accused


# Is the accelerometer on the clock of the attitude?


@pytest.fixture(scope="module")
def sound():
    return attlog_flight.read(SAMPLES / "px4_steps.ulg")


def shifted(log, seconds):
    log = copy.copy(log)
    imu = copy.copy(log.imus[log.imu])
    imu.acc = copy.copy(imu.acc)
    imu.acc.x = np.column_stack([np.interp(imu.acc.t - seconds, imu.acc.t, imu.acc.x[:, k]) for k in range(3)])
    log.imus = [imu if k == log.imu else other for k, other in enumerate(log.imus)]
    return log


@pytest.mark.parametrize("seconds", [-3.0, 1.2, 6.0])
def test_a_delay_of_the_accelerometer_is_found_with_its_size_and_sign(sound, seconds):
    assert sensor_faults.accelerometer_delay(shifted(sound, seconds)) == pytest.approx(seconds, abs=0.15)


def test_an_accelerometer_on_time_a_noisy_one_and_one_without_gnss_are_not_late(sound):
    assert sensor_faults.accelerometer_delay(sound) is None
    noisy = shifted(sound, 0.0)
    noisy.replay_imu.acc.x += 3.0 * np.random.default_rng(0).normal(size=noisy.replay_imu.acc.x.shape)
    assert sensor_faults.accelerometer_delay(noisy) is None
    without = copy.copy(shifted(sound, 3.0))
    without.gnss = []
    assert sensor_faults.accelerometer_delay(without) is None
