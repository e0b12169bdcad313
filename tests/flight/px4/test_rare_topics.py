"""Units, axes and choices of PX4's rarer topics: other numbers in every column."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from attlog.flight.builder import LogBuilder
from attlog.flight.px4 import imus, state
from tests.flight import fake

N = 6
T = fake.micros(N, 10.0)


def builder(**topics: dict[str, Any]) -> LogBuilder:
    """Topics by ``name`` or ``name_at_instance``; each gets the same stamps."""
    tables = {}
    for key, columns in topics.items():
        name, _, instance = key.partition("_at_")
        made = {"timestamp": T, **{k: np.asarray(v) for k, v in columns.items()}}
        tables[name, int(instance or 0)] = made
    return LogBuilder(fake.messages("ulog", tables), t0_us=int(T[0]))


def ramp(*factors: float) -> np.ndarray:
    return np.outer(1.0 + np.arange(N), factors).astype(np.float32)


def distance(**more: Any) -> dict[str, Any]:
    return {"current_distance": ramp(1.0)[:, 0], "orientation": np.full(N, 25, np.uint8), **more}


def test_the_first_rangefinder_that_always_looks_down_counts() -> None:
    aside = np.full(N, 25, np.uint8)
    aside[3] = 0
    found = state.rangefinder(
        builder(
            distance_sensor=distance(orientation=aside),
            distance_sensor_at_1=distance(current_distance=2.0 * ramp(1.0)[:, 0]),
            distance_sensor_at_2=distance(),
        )
    )
    assert found is not None
    assert (found.source, found.x[:, 0].tolist()) == ("distance_sensor:1", [2.0, 4.0, 6.0, 8.0, 10.0, 12.0])
    assert state.rangefinder(builder(distance_sensor=distance(orientation=np.zeros(N, np.uint8)))) is None
    few = distance(current_distance=np.array([1.0, 0.0, np.nan, -1.0, 0.0, 0.0], np.float32))
    assert state.rangefinder(builder(distance_sensor=few)) is None


def receiver(**more: Any) -> dict[str, Any]:
    return {
        "lat": np.full(N, 473_977_420, np.int32),
        "lon": np.full(N, -85_455_940, np.int32),
        "alt": np.full(N, 488_150, np.int32),
        "fix_type": np.full(N, 3, np.uint8),
        "vel_n_m_s": ramp(1.0)[:, 0],
        "vel_e_m_s": ramp(-2.0)[:, 0],
        "vel_d_m_s": ramp(0.5)[:, 0],
        "eph": np.full(N, 0.8, np.float32),
        "epv": np.full(N, 1.6, np.float32),
        "s_variance_m_s": np.full(N, 0.3, np.float32),
        **more,
    }


def test_positions_are_tenths_of_a_microdegree_and_millimetres_or_degrees_and_metres() -> None:
    degrees = {"latitude_deg": np.full(N, 47.3977420), "longitude_deg": np.full(N, -8.5455940)}
    degrees["altitude_msl_m"] = np.full(N, 488.15)
    for columns in (receiver(), {k: v for k, v in receiver(**degrees).items() if k not in ("lat", "lon", "alt")}):
        (one,) = state.gnss(builder(vehicle_gps_position=columns))
        assert (one.lat[0], one.lon[0], one.alt[0]) == pytest.approx((47.3977420, -8.5455940, 488.15))
        np.testing.assert_allclose(one.vel_ned, ramp(1.0, -2.0, 0.5))
        assert (one.h_acc[0], one.v_acc[0], one.s_acc[0]) == pytest.approx((0.8, 1.6, 0.3), rel=1e-6)


def test_a_velocity_that_is_said_to_be_invalid_is_none() -> None:
    valid = np.array([1, 1, 0, 1, 0, 1], np.uint8)
    (one,) = state.gnss(builder(vehicle_gps_position=receiver(vel_ned_valid=valid)))
    assert np.isnan(one.vel_ned).any(axis=1).tolist() == [False, False, True, False, True, False]


def test_the_topic_that_was_logged_faster_is_the_receiver() -> None:
    made = builder(vehicle_gps_position=receiver(), sensor_gps=receiver())
    short = {"timestamp": T[:3], **{k: v[:3] for k, v in receiver().items()}}
    tables: Any = {("vehicle_gps_position", 0): short, ("sensor_gps", 1): {"timestamp": T, **receiver()}}
    faster = LogBuilder(fake.messages("ulog", tables), t0_us=int(T[0]))
    assert state.gnss(made)[0].source == "vehicle_gps_position:0"
    assert state.gnss(faster)[0].source == "sensor_gps:1"
    assert state.gnss(builder(other={"x": np.zeros(N)})) == []


def test_the_date_is_the_median_of_what_receivers_with_a_fix_tell() -> None:
    unix = 1_700_000_000_000_000 + (T - T[0]).astype(np.int64)
    unix[1] += 90_000_000
    columns = receiver(time_utc_usec=unix.astype(np.uint64))
    assert state.utc_offset(state.gnss(builder(vehicle_gps_position=columns))) == pytest.approx(1.7e9)
    columns["fix_type"] = np.full(N, 1, np.uint8)
    assert state.utc_offset(state.gnss(builder(vehicle_gps_position=columns))) is None
    columns["fix_type"], columns["time_utc_usec"] = np.full(N, 3, np.uint8), np.zeros(N, np.uint64)
    assert state.utc_offset(state.gnss(builder(vehicle_gps_position=columns))) is None


def test_thrust_is_the_length_of_the_set_point_or_the_throttle_of_old_versions() -> None:
    thrust = ramp(0.03, -0.04, 0.12)
    both = builder(vehicle_thrust_setpoint={"xyz": thrust}, vehicle_rates_setpoint={"thrust_body": 0.5 * thrust})
    found = state.throttle(both)
    assert found is not None
    np.testing.assert_allclose(found.x[:, 0], 0.13 * np.arange(1, N + 1), rtol=1e-5)
    old = state.throttle(builder(vehicle_attitude_setpoint={"thrust": ramp(-0.1)[:, 0]}))
    assert old is not None
    np.testing.assert_allclose(old.x[:, 0], 0.1 * np.arange(1, N + 1), rtol=1e-5)
    assert state.throttle(builder(vehicle_attitude_setpoint={"q_d": np.zeros((N, 4))})) is None


def test_only_rotors_that_ever_turn_are_rotors() -> None:
    columns = {f"esc[{k}].esc_rpm": (1000 * k * np.arange(N)).astype(np.int32) for k in (0, 1, 3)}
    found = state.rpm(builder(esc_status=columns))
    assert found is not None
    assert found.x[-1].tolist() == [5000.0, 15000.0]
    assert state.rpm(builder(esc_status={"esc[0].esc_rpm": np.zeros(N, np.int32)})) is None
    assert state.rpm(builder(esc_status={"count": np.zeros(N)})) is None


def test_a_current_of_minus_one_was_not_measured() -> None:
    amperes = np.array([1.0, -1.0, 3.0, 4.0, 5.0, 6.0], np.float32)
    found = state.battery(builder(battery_status={"voltage_v": ramp(3.0)[:, 0], "current_a": amperes}))
    assert found is not None
    assert found.x[:, 0].tolist() == pytest.approx([3.0, 6.0, 9.0, 12.0, 15.0, 18.0])
    assert np.isnan(found.x[:, 1]).tolist() == [False, True, False, False, False, False]


def test_set_points_are_quaternions_or_where_these_are_unset_euler_angles() -> None:
    angles = ramp(0.1, -0.05, 0.2)
    given = np.roll(Rotation.from_euler("ZYX", [0.3, 0.2, 0.1]).as_quat(), 1)
    q = np.tile(given, (N, 1)).astype(np.float32)
    q[2:] = 0.0
    euler = dict(zip(("roll_body", "pitch_body", "yaw_body"), angles.T, strict=True))
    found = state.setpoints(builder(vehicle_attitude_setpoint={"q_d": q, **euler}))
    assert found is not None
    wanted = np.roll(Rotation.from_euler("ZYX", angles[:, ::-1]).as_quat(), 1, axis=1)
    wanted[:2] = given
    same = np.abs(np.sum(found.q * wanted, axis=1))
    np.testing.assert_allclose(same, 1.0, atol=1e-6)
    alone = state.setpoints(builder(vehicle_attitude_setpoint={"q_d": q}))
    assert alone is not None
    assert len(alone.t) == 2
    assert state.setpoints(builder(vehicle_attitude_setpoint={"q_d": 0.0 * q})) is None


def test_rates_biases_and_airspeed_keep_their_axes() -> None:
    rates = state.rate_setpoints(
        builder(vehicle_rates_setpoint=dict(zip(("roll", "pitch", "yaw"), ramp(0.1, 0.2, -0.3).T, strict=True)))
    )
    assert rates is not None
    np.testing.assert_allclose(rates.x, ramp(0.1, 0.2, -0.3), rtol=1e-6)
    bias = state.acc_bias(builder(estimator_sensor_bias={"accel_bias": ramp(0.01, -0.02, 0.03)}))
    assert bias is not None
    np.testing.assert_allclose(bias.x, ramp(0.01, -0.02, 0.03), rtol=1e-6)
    speed = {"true_airspeed_m_s": ramp(2.0)[:, 0]}
    found = state.airspeed(builder(airspeed={"true_airspeed_m_s": ramp(9.0)[:, 0]}, airspeed_validated=speed))
    assert found is not None
    assert (found.source, found.x[0, 0]) == ("airspeed_validated", 2.0)


def test_barometers_are_those_of_the_first_topic_that_has_any_and_repeats_count_once() -> None:
    high = np.array([5.0, 5.0, 6.0, 6.0, 7.0, 7.0], np.float32)
    both = builder(sensor_combined={"baro_alt_meter": high}, sensor_baro={"altitude": ramp(1.0)[:, 0]})
    (one,) = state.baro(both)
    assert (one.source, one.x[:, 0].tolist()) == ("sensor_combined:0", [5.0, 6.0, 7.0])
    two = state.baro(builder(sensor_baro={"altitude": ramp(1.0)[:, 0]}, sensor_baro_at_1={"altitude": ramp(3.0)[:, 0]}))
    assert [s.x[1, 0] for s in two] == [2.0, 6.0]


@pytest.mark.parametrize(
    ("columns", "mav_type", "said"),
    [
        ({"is_vtol": np.array([0, 0, 1, 0, 0, 0], np.uint8), "system_type": np.full(N, 2)}, None, "VTOL"),
        ({"is_vtol": np.zeros(N, np.uint8), "vehicle_type": np.full(N, 1)}, None, "multirotor"),
    ],
)
def test_the_vehicle_is_what_its_status_says(columns: dict[str, Any], mav_type: float | None, said: str) -> None:
    made = builder(vehicle_status=columns)
    assert state.vehicle(made.messages.tables["vehicle_status", 0], mav_type) == said


def test_the_version_is_three_bytes_and_the_kind_of_release_the_fourth() -> None:
    for number, said in ((0x010E03FF, "1.14.3"), (0x010F0080, "1.15.0 beta"), (0x010D02C1, "1.13.2 type 193"), (0, "")):
        assert state.firmware(fake.messages("ulog", {}, info={"ver_sw_release": number})).version == said


@pytest.mark.parametrize(
    ("info", "hil", "truth", "simulated"),
    [
        ({"ver_hw": "PX4_FMU_V5"}, 0, False, False),
        ({"ver_hw": "PX4_SITL"}, 0, False, True),
        ({"sys_mcu": "sitl"}, 0, False, True),
        ({}, 1, False, True),
        ({}, 0, True, True),
    ],
)
def test_a_log_is_simulated_by_its_board_its_state_or_its_truth(
    info: dict[str, Any], hil: int, truth: bool, simulated: bool
) -> None:
    topics = {"vehicle_status": {"hil_state": np.array([0, hil, 0, 0, 0, 0], np.uint8)}}
    if truth:
        topics["vehicle_attitude_groundtruth"] = {"q": np.zeros((N, 4))}
    made = builder(**topics)
    made.messages.info.update(info)
    assert state.simulated(made, made.messages.tables["vehicle_status", 0]) is simulated


def test_units_are_found_by_the_device_of_their_increments_else_of_their_status_else_of_the_raw_gyro() -> None:
    made = builder(
        vehicle_imu={"gyro_device_id": np.full(N, 11, np.uint32)},
        vehicle_imu_at_1={"gyro_device_id": np.array([0, 0, 0, 0, 0, 12], np.uint32)},
        vehicle_imu_status={"gyro_device_id": np.full(N, 13, np.uint32)},
        sensor_gyro_at_2={"device_id": np.array([14, 14, 14, 14, 0, 0], np.uint32)},
        sensor_gyro={"device_id": np.full(N, 12, np.uint32)},
    )
    assert imus.units_of_devices(made, {11, 12, 13, 14, 0, 99}) == {11: 0, 12: 1, 13: 0, 14: 2}
    assert imus.unit_of_device(made, 14) == 2
    assert imus.unit_of_device(made, 99) is None
    assert imus.unit_of_device(made, 0) is None


def test_unix_time_is_that_of_the_first_receiver_with_a_fix() -> None:
    def one(fix: int, utc_us: float, unknown: int = 0) -> Any:
        t = np.arange(6.0)
        utc = np.where(np.arange(6) < unknown, 0.0, utc_us + 1e6 * t)
        return SimpleNamespace(t=t, utc_us=utc, fix=np.full(6, fix))

    none = SimpleNamespace(t=np.arange(6.0), utc_us=None, fix=np.full(6, 3))
    assert state.utc_offset([none, one(1, 8e15), one(2, 1.7e15), one(3, 1.6e15)]) == pytest.approx(1.7e9)
    assert state.utc_offset([one(3, 1.5e15, unknown=4)]) == pytest.approx(1.5e9)
    assert state.utc_offset([one(3, 0.0, unknown=6), none]) is None
