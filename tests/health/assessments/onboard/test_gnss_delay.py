"""A late receiver is offered its delay where both limits are passed, and nothing else is offered anything."""

from __future__ import annotations

import numpy as np
import pytest

from attlog.flight.model import FlightLog
from attlog.health.assessments import Assessment
from attlog.health.assessments.onboard import gnss_delay
from tests.health.assessments.onboard.made import case, flight


def told(log: FlightLog, delay_ms: float | None = None) -> Assessment:
    (one,) = gnss_delay.assessments(case(log, delay_ms))
    return one


def test_a_receiver_as_late_as_the_parameter_says_is_ok() -> None:
    one = told(flight(0.11, params={"EKF2_GPS_DELAY": 110.0}))
    assert (one.verdict, one.settings) == ("ok", [])
    assert one.value == pytest.approx(110.0, abs=6.0)
    assert one.ci95 is not None
    assert one.ci95[0] < 110.0 < one.ci95[1]
    assert "EKF2_GPS_DELAY says 110 ms" in one.text


def test_a_later_one_is_offered_its_delay_and_a_longer_buffer() -> None:
    one = told(flight(0.25, params={"EKF2_GPS_DELAY": 110.0, "EKF2_DELAY_MAX": 200.0}), delay_ms=250.0)
    assert one.verdict == "warning"
    offered = {s.name: (s.old, s.new) for s in one.settings}
    assert offered == {"EKF2_GPS_DELAY": (110.0, 250.0), "EKF2_DELAY_MAX": (200.0, 250.0)}


def test_18_ms_are_not_offered() -> None:
    assert told(flight(0.128, params={"EKF2_GPS_DELAY": 110.0})).settings == []


def test_estimates_that_disagree_tell_nothing() -> None:
    one = told(flight(0.2, params={"EKF2_GPS_DELAY": 110.0}), delay_ms=110.0)
    assert (one.verdict, one.settings) == ("unknown", [])
    assert "differ" in one.text


def test_their_disagreement_widens_the_interval() -> None:
    near, far = (told(flight(0.2, params={"EKF2_GPS_DELAY": 200.0}), delay_ms=ms) for ms in (200.0, 170.0))
    assert near.ci95 is not None
    assert far.ci95 is not None
    assert far.ci95[1] - far.ci95[0] > 1.5 * (near.ci95[1] - near.ci95[0])


def test_a_delay_beyond_the_range_is_a_warning_without_value() -> None:
    one = told(flight(0.35, params={"EKF2_GPS_DELAY": 110.0}))
    assert (one.verdict, one.settings) == ("warning", [])
    assert "300 ms" in one.why_no_setting


def test_a_parameter_of_zero_is_the_drivers_own_delay_by_hardware() -> None:
    params = {"GPS1_DELAY_MS": 0.0, "AHRS_EKF_TYPE": 3.0}
    log = flight(0.2, firmware="ArduPilot", params=params)
    log.gnss[0].received = log.gnss[0].t
    unnamed = told(log)  # between 50 and 220 ms, as drivers take it
    assert (unnamed.verdict, unnamed.settings) == ("unknown", [])
    assert unnamed.value == pytest.approx(200.0, abs=6.0)
    log.texts = [(0.0, 6, "u-blox 1 HW: 00080000 SW: EXT CORE 3.01 (107900)")]
    (setting,) = told(log).settings
    assert (setting.name, setting.old, setting.new) == ("GPS1_DELAY_MS", 0.0, 200.0)


def test_without_the_time_of_receipt_that_parameter_is_not_offered() -> None:
    one = told(flight(0.2, firmware="ArduPilot", params={"GPS_DELAY_MS": 100.0, "AHRS_EKF_TYPE": 3.0}))
    assert (one.verdict, one.settings) == ("unknown", [])
    assert "GPA.SMS" in one.why_no_setting


def test_a_flight_that_hardly_moves_cannot_tell() -> None:
    log = flight(0.2, params={"EKF2_GPS_DELAY": 110.0})
    imu = log.replay_imu
    assert imu is not None
    imu.acc.x[:, :2] *= 0.05
    log.gnss[0].vel_ned *= 0.05
    assert told(log).verdict == "unknown"


def test_broken_receivers_raise_nothing() -> None:
    for break_it in ("vel_ned", "lat"):
        log = flight(0.1)
        getattr(log.gnss[0], break_it)[:] = np.nan
        gnss_delay.assessments(case(log))
    log = flight(0.1)
    log.imu = None
    assert told(log).verdict == "unknown"
