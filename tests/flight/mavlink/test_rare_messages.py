"""Units and unset values of MAVLink's rarer messages: other numbers in every column."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from attlog.flight.builder import LogBuilder
from attlog.flight.mavlink import state
from attlog.flight.mavlink.clock import PacketClock
from attlog.flight.model import Firmware, FlightLog
from tests.flight import fake

N = 6
BOOT_MS = (10_000 + 100 * np.arange(N)).astype(np.uint32)


def read(function: Any, *more: Any, **tables: dict[str, Any]) -> Any:
    """What a function makes of messages of vehicle 1, whose records have the same times."""
    made = {(name, 1): {"time_boot_ms": BOOT_MS, **columns} for name, columns in tables.items()}
    messages = fake.messages("tlog", made)
    builder = LogBuilder(messages, t0_us=10_000_500)
    return function(builder, PacketClock(messages, 1), 1, *more)


def receiver(**more: Any) -> dict[str, Any]:
    return {
        "time_usec": np.zeros(N, np.uint64),
        "lat": np.full(N, 473_977_420, np.int32),
        "lon": np.full(N, -85_455_940, np.int32),
        "alt": np.full(N, 488_150, np.int32),
        "fix_type": np.full(N, 3, np.uint8),
        "vel": np.array([500, 600, 0xFFFF, 700, 800, 900], np.uint16),
        "cog": np.array([3000, 12_000, 9000, 0xFFFF, 27_000, 0], np.uint16),
        "h_acc": np.array([800, 0, 900, 800, 800, 800], np.uint32),
        "v_acc": np.full(N, 1600, np.uint32),
        "vel_acc": np.full(N, 300, np.uint32),
        "yaw": np.array([0, 36_000, 9000, 27_000, 0xFFFF, 18_100], np.uint16),
        "satellites_visible": np.full(N, 17, np.uint8),
        "eph": np.full(N, 85, np.uint16),
        **more,
    }


def test_a_receiver_counts_centimetres_hundredths_of_a_degree_and_millimetres() -> None:
    found = read(state.one_receiver, 0, GPS_RAW_INT=receiver())
    assert found is not None
    assert (found.lat[0], found.lon[0], found.alt[0]) == pytest.approx((47.3977420, -8.5455940, 488.15))
    course = np.radians([30.0, 120.0, 90.0, np.nan, 270.0, 0.0])
    speed = np.array([5.0, 6.0, np.nan, 7.0, 8.0, 9.0])
    np.testing.assert_allclose(found.vel_ned[:, 0], speed * np.cos(course), atol=1e-9)
    np.testing.assert_allclose(found.vel_ned[:, 1], speed * np.sin(course), atol=1e-9)
    assert np.isnan(found.vel_ned[:, 2]).all()
    np.testing.assert_allclose(found.h_acc, [0.8, np.nan, 0.9, 0.8, 0.8, 0.8])
    assert (found.v_acc[0], found.s_acc[0]) == pytest.approx((1.6, 0.3))
    assert read(state.one_receiver, 1, GPS_RAW_INT=receiver()) is None
    assert read(state.one_receiver, 1, GPS2_RAW=receiver()).source == "GPS2_RAW"


def test_a_heading_of_antennas_is_hundredths_of_a_degree_and_zero_or_all_ones_is_none() -> None:
    found = read(state.one_receiver, 0, GPS_RAW_INT=receiver())
    yaw = np.radians([np.nan, 0.0, 90.0, -90.0, np.nan, -179.0])
    assert found.yaw is not None
    np.testing.assert_allclose(found.yaw, yaw, atol=1e-9)
    for unset in (0, 0xFFFF):
        assert read(state.one_receiver, 0, GPS_RAW_INT=receiver(yaw=np.full(N, unset, np.uint16))).yaw is None


@pytest.mark.parametrize(("hpa", "metres"), [(1013.25, 0.0), (898.75, 1000.0), (794.95, 2000.0)])
def test_pressure_is_the_altitude_of_the_standard_atmosphere(hpa: float, metres: float) -> None:
    """US Standard Atmosphere 1976, table I."""
    pressure = {"press_abs": np.full(N, hpa, np.float32)}
    found = read(state.baro, "", SCALED_PRESSURE=pressure)
    assert found is not None
    assert found.x[0, 0] == pytest.approx(metres, abs=1.5)
    second = read(state.baro, "2", SCALED_PRESSURE2=pressure)
    assert second is not None
    assert second.source == "SCALED_PRESSURE2"
    assert read(state.baro, "", SCALED_PRESSURE2=pressure) is None
    nothing = {"press_abs": np.array([0.5, *[hpa] * (N - 1)], np.float32)}
    assert len(read(state.baro, "", SCALED_PRESSURE=nothing).x) == N - 1


def test_a_battery_is_in_millivolts_and_hundredths_of_an_ampere() -> None:
    volts = np.array([12_000, 0xFFFF, 11_500, 11_400, 11_300, 11_200], np.uint16)
    amperes = np.array([1_550, 200, -1, 300, 400, 500], np.int16)
    found = read(state.battery, SYS_STATUS={"voltage_battery": volts, "current_battery": amperes})
    assert found is not None
    np.testing.assert_allclose(found.x[[0, 3]], [[12.0, 15.5], [11.4, 3.0]])
    assert np.isnan(found.x[1, 0])
    assert np.isnan(found.x[2, 1])


def test_only_rotors_that_ever_turn_are_rotors() -> None:
    rpm = np.outer(np.arange(N), [1000, 0, 300, 0]).astype(np.uint16)
    found = read(state.rpm, ESC_TELEMETRY_1_TO_4={"rpm": rpm})
    assert found is not None
    assert found.x[-1].tolist() == [5000.0, 1500.0]
    assert read(state.rpm, ESC_TELEMETRY_1_TO_4={"rpm": 0 * rpm}) is None


def log(vehicle: str = "quadrotor") -> FlightLog:
    made = FlightLog(Path("made"), "tlog", 0, 0, Firmware("ArduPilot"), "quadrotor")
    made.vehicle = vehicle
    return made


@pytest.mark.parametrize(("vehicle", "has_airspeed"), [("quadrotor", False), ("fixed wing", True)])
def test_throttle_is_percent_and_airspeed_that_of_planes(vehicle: str, has_airspeed: bool) -> None:
    made = log(vehicle)
    hud = {"throttle": np.full(N, 43, np.uint16), "airspeed": np.full(N, 17.5, np.float32)}
    read(state.hud, made, VFR_HUD=hud)
    assert made.throttle is not None
    assert made.throttle.x[0, 0] == pytest.approx(0.43)
    assert (made.airspeed is not None) is has_airspeed
    if made.airspeed is not None:
        assert made.airspeed.x[0, 0] == 17.5


def test_set_points_keep_their_axes() -> None:
    made = log()
    rates = {f"body_{axis}_rate": np.full(N, 0.1 * k, np.float32) for k, axis in enumerate(("roll", "pitch", "yaw"), 1)}
    q = np.tile(np.array([0.8, 0.0, 0.6, 0.0], np.float32), (N, 1))
    read(state.targets, 3, made, ATTITUDE_TARGET={"q": q, **rates})
    assert made.setpoints is not None
    np.testing.assert_allclose(made.setpoints.q[0], [0.8, 0.0, 0.6, 0.0], atol=1e-6)
    assert made.setpoints.has_trim
    assert made.rate_setpoints is not None
    np.testing.assert_allclose(made.rate_setpoints.x[0], [0.1, 0.2, 0.3], rtol=1e-6)


def test_a_date_is_unix_time_between_the_first_flights_and_the_end_of_the_clock() -> None:
    builder = LogBuilder(fake.messages("tlog", {}), t0_us=0)
    assert state.date(builder, 1_700_000_000_000_000) == pytest.approx(1.7e9)
    assert builder.problems == []
    for unix in (10**14, 10**16):
        assert state.date(builder, unix) is None
    assert len(builder.problems) == 2
