"""Impact is told from hard landings and from aerobatics by what follows."""

from __future__ import annotations

import numpy as np
import pytest

from attlog import segments
from attlog.base import rotation
from attlog.flight.model import FlightLog
from attlog.segments import impact
from attlog.segments.flags import FlagSpans

from .flights import DISARMED, LANDED, flight

CRASH = 74.0


def blow(log: FlightLog, t: float, g: float = 8.0, tumble_dps: float = 0.0) -> FlightLog:
    """Two samples of force and half a second of tumbling."""
    imu = log.imus[0]
    i = int(np.searchsorted(imu.acc.t, t))
    imu.acc.x[i : i + 2] = [0.0, 0.0, -g * 9.81]
    imu.gyro.x[i : i + len(imu.gyro.t) // 210, 0] += np.radians(tumble_dps)
    return log


def overturn(log: FlightLog, t0: float, t1: float) -> FlightLog:
    """Lie on the back between two times."""
    attitude = log.attitudes["ATT"]
    inside = (attitude.t >= t0) & (attitude.t < t1)
    attitude.q[inside] = rotation.multiply(attitude.q[inside], rotation.from_euler(np.pi - 0.1, 0, 0))
    return log


def impacts(log: FlightLog) -> list[float]:
    """Times of the impacts."""
    return [s.t0 for s in segments.build(log).of("impact")]


def test_a_normal_flight_has_no_impact():
    assert impacts(flight()) == []


def test_a_firm_touch_down_is_no_impact():
    """Two samples of 88 m/s^2 at touch-down were seen in simulated flights that went on normally."""
    assert impacts(blow(flight(), LANDED - 0.1, g=9.0)) == []


def test_a_blow_with_a_tumble_before_disarming_is_an_impact_to_the_end_of_the_log():
    log = blow(flight(), CRASH, tumble_dps=600.0)
    found = segments.build(log).of("impact")
    assert found[0].t0 == pytest.approx(CRASH, abs=0.02)
    assert found[0].t1 == pytest.approx(log.imus[0].gyro.t[-1])
    assert "8.0 g with a tumble" in found[0].why
    assert "4.0 s later" in found[0].why


def test_a_collision_in_the_air_that_is_flown_on_is_no_impact():
    assert impacts(blow(flight(), 50.0, tumble_dps=600.0)) == []


@pytest.mark.parametrize(("seconds", "counts"), [(4.0, True), (6.0, False)])
def test_a_vehicle_that_flies_again_for_5_seconds_had_no_impact_and_a_hop_is_no_flight(seconds, counts):
    log = blow(flight(), CRASH, tumble_dps=600.0)
    again = FlagSpans(True, [(35.0, 75.0), (90.0, 90.0 + seconds)])
    assert [s.t0 for s in impact.find(log, log.imus[0], again, [], [], 105.0)] == [CRASH] * counts


def test_a_flip_that_is_flown_on_is_no_impact_and_the_last_one_before_disarming_is():
    assert impacts(overturn(flight(), 50.0, 51.0)) == []
    assert impacts(overturn(flight(), CRASH, DISARMED + 10)) == [pytest.approx(CRASH, abs=0.1)]


def test_lying_on_the_back_with_motors_armed_is_an_end_too():
    log = overturn(flight(), 60.0, 75.0)
    log.armed.t[-1] = 1e4
    imu = log.imus[0]
    imu.gyro.x[imu.gyro.t > 62.0] *= 0.1
    assert impacts(log) == [pytest.approx(60.0, abs=0.1)]


@pytest.mark.parametrize(
    ("text", "counts"),
    [
        ("Crash: Disarming: AngErr=45>30, Accel=0.9<3.0", True),
        ("Crashed", True),
        ("Crash check disabled", False),
        ("crash_dump.bin found", False),
        ("GPS Glitch", False),
    ],
)
def test_the_autopilots_own_crash_message_counts_in_the_air(text, counts):
    log = flight()
    log.texts = [(60.0, 2, text)]
    assert impacts(log) == ([60.0] if counts else [])
    log.texts = [(5.0, 2, text)]
    assert impacts(log) == []


def test_a_log_that_ends_within_seconds_of_a_blow_ends_with_it():
    log = blow(flight(), 60.0, tumble_dps=600.0)
    for stream in (log.imus[0].gyro, log.imus[0].acc):
        keep = stream.t < 61.0
        stream.t, stream.x = stream.t[keep], stream.x[keep]
    assert impacts(log) == [pytest.approx(60.0, abs=0.02)]


def test_what_follows_at_once_is_not_zero_seconds_later():
    told = []
    for disarmed in (CRASH + 0.02, CRASH + 2.0):
        log = blow(flight(), CRASH, tumble_dps=600.0)
        log.armed.t[-1] = disarmed
        told.append(segments.build(log).of("impact")[0].why)
    assert "at once it was disarmed" in told[0]
    assert "2.0 s later it was disarmed" in told[1]


def test_rest_after_an_impact_is_a_wreck_and_no_rest():
    found = segments.build(blow(flight(), CRASH, tumble_dps=600.0))
    assert found.of("wreck")
    assert all(s.t0 >= CRASH for s in found.of("wreck"))
    assert all(s.t1 <= CRASH + 0.1 for kind in ("rest", "airborne", "idle", "hover", "cruise") for s in found.of(kind))
