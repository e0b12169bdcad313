"""Flags are believed only as far as the sensors agree, and arming alone is no flight."""

from __future__ import annotations

import numpy as np
import pytest

from attlog import segments
from attlog.flight.model import Stream, TimeLine
from attlog.segments import spans

from .flights import ARMED, DISARMED, END, LANDED, TAKE_OFF, flight

SECONDS = np.arange(0.0, END, 0.1)


def height(top: float = 20.0, start: float = 400.0) -> Stream:
    """A climb at 3 m/s to ``top`` above the start, and down again at landing."""
    rise = np.interp(SECONDS, [TAKE_OFF, TAKE_OFF + top / 3, LANDED - top / 3, LANDED], [0, top, top, 0])
    return Stream(SECONDS, start + rise[:, None], "m", "", "BARO:0")


def throttle() -> Stream:
    """Idling, half throttle in the air, idling, off."""
    x = np.where((SECONDS > TAKE_OFF - 1) & (SECONDS < LANDED), 0.5, np.where(SECONDS > ARMED, 0.08, 0.0))
    return Stream(SECONDS, np.where(SECONDS > DISARMED, 0.0, x)[:, None], "1", "", "CTUN.ThO")


def airborne(**more) -> tuple[list[tuple[float, float]], str]:
    """Flight of a log and the reason for it."""
    found = segments.build(flight(50.0, **more))
    return found.spans("airborne"), found.notes["airborne"]


def test_the_land_detector_tells_flight():
    found, why = airborne()
    assert found == [(TAKE_OFF, LANDED)]
    assert "vehicle_land_detected" in why


def test_a_vehicle_is_not_airborne_by_arming_alone():
    found, why = airborne(landed=None)
    assert found == []
    assert "no land detector" in why
    assert segments.build(flight(50.0, landed=None)).spans("hover") == []


def test_not_landed_while_disarmed_is_a_flag_that_nobody_updated():
    """Some firmwares say "not landed" from boot until the first landing."""
    never = TimeLine(np.array([0.0, LANDED]), [False, True], "vehicle_land_detected")
    found, why = airborne(landed=never)
    assert found == [(ARMED, LANDED)]
    assert "vehicle_land_detected" in why


def test_not_landed_of_a_vehicle_that_lies_still_is_refused_where_arming_is_unknown():
    never = TimeLine(np.array([0.0]), [False], "vehicle_land_detected")
    found, _ = airborne(landed=never, armed=None)
    assert spans.seconds(spans.intersect(found, [(0, ARMED - 1), (DISARMED + 1, END)])) == 0.0
    assert spans.seconds(spans.intersect(found, [(TAKE_OFF, LANDED)])) > 39


def test_without_land_detector_throttle_with_climb_tells_flight():
    found, why = airborne(landed=None, throttle=throttle(), baro=[height()])
    assert len(found) == 1
    assert found[0][0] == pytest.approx(TAKE_OFF, abs=1.0)
    assert found[0][1] == pytest.approx(LANDED, abs=1.0)
    assert "CTUN.ThO" in why
    assert "BARO:0" in why


def test_without_land_detector_and_throttle_a_fast_climb_while_armed_tells_flight():
    found, why = airborne(landed=None, baro=[height()])
    assert len(found) == 1
    assert found[0] == pytest.approx((TAKE_OFF, LANDED), abs=1.0)
    assert "driven (arming)" in why
    assert airborne(landed=None, baro=[height()], armed=None)[0] == []


def test_throttle_without_climb_is_no_flight():
    found, _ = airborne(landed=None, throttle=throttle(), baro=[height(top=0.0)])
    assert found == []


def test_landed_throughout_a_flight_that_climbs_is_refuted():
    stuck = TimeLine(np.array([0.0]), [True], "vehicle_land_detected")
    found, _ = airborne(landed=stuck, throttle=throttle(), baro=[height()])
    assert spans.seconds(spans.intersect(found, [(TAKE_OFF, LANDED)])) > 38


@pytest.mark.parametrize("vehicle", ["rover", "boat", "submarine"])
def test_vehicles_that_cannot_fly_do_not(vehicle):
    found, why = airborne(vehicle=vehicle)
    assert found == []
    assert vehicle in why


def test_without_any_flag_nothing_is_claimed_about_flight():
    found = segments.build(flight(50.0, armed=None, landed=None))
    assert found.of("airborne") == []
    assert found.of("armed") == []
    assert found.of("idle") == []
    assert "unknown" in found.notes["rest"]


def test_a_log_without_imu_has_the_runs_of_its_attitude_and_no_rest():
    log = flight(50.0, imu=None, imus=[])
    found = segments.build(log)
    assert len(found.of("continuous")) == 1
    assert found.of("rest") == []
    assert "no IMU" in found.notes["continuous"]


def test_a_log_with_nothing_has_no_segment():
    log = flight(50.0, imu=None, imus=[], attitudes={}, onboard=None)
    assert segments.build(log).segments == []


@pytest.mark.parametrize("vehicle", ["fixed wing", "quadrotor"])
def test_only_what_can_hover_hovers(vehicle):
    found = segments.build(flight(50.0, vehicle=vehicle))
    assert bool(found.of("hover")) == (vehicle == "quadrotor")
    assert all(s.seconds >= 3 for s in found.of("hover"))
