"""Units, axes and choices of PX4's rarer topics: other numbers in every column."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import attlog
from attlog.flight.gnss import utc_offset
from attlog.flight.model import Problem, TimeLine
from attlog.flight.px4 import estimator, imu, sensors
from attlog.flight.px4.imu import TopicBuilder
from attlog.health.vibration import sample_levels, second_means
from tests.flight import fake
from tests.flight.fake import messages, micros

N = 6
T = fake.micros(N, 10.0)


def builder(**topics: dict[str, Any]) -> TopicBuilder:
    """Topics by ``name`` or ``name_at_instance``; each gets the same stamps."""
    tables = {}
    for key, columns in topics.items():
        name, _, instance = key.partition("_at_")
        made = {"timestamp": T, **{k: np.asarray(v) for k, v in columns.items()}}
        tables[name, int(instance or 0)] = made
    return TopicBuilder(fake.messages("ulog", tables), t0_us=int(T[0]))


def ramp(*factors: float) -> np.ndarray:
    return np.outer(1.0 + np.arange(N), factors).astype(np.float32)


def distance(**more: Any) -> dict[str, Any]:
    return {"current_distance": ramp(1.0)[:, 0], "orientation": np.full(N, 25, np.uint8), **more}


def test_the_first_rangefinder_that_always_looks_down_counts() -> None:
    aside = np.full(N, 25, np.uint8)
    aside[3] = 0
    found = sensors.rangefinder_stream(
        builder(
            distance_sensor=distance(orientation=aside),
            distance_sensor_at_1=distance(current_distance=2.0 * ramp(1.0)[:, 0]),
            distance_sensor_at_2=distance(),
        )
    )
    assert found is not None
    assert (found.source, found.x[:, 0].tolist()) == ("distance_sensor:1", [2.0, 4.0, 6.0, 8.0, 10.0, 12.0])
    assert sensors.rangefinder_stream(builder(distance_sensor=distance(orientation=np.zeros(N, np.uint8)))) is None
    few = distance(current_distance=np.array([1.0, 0.0, np.nan, -1.0, 0.0, 0.0], np.float32))
    assert sensors.rangefinder_stream(builder(distance_sensor=few)) is None


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
        (one,) = sensors.receivers(builder(vehicle_gps_position=columns))
        assert (one.lat[0], one.lon[0], one.alt[0]) == pytest.approx((47.3977420, -8.5455940, 488.15))
        np.testing.assert_allclose(one.vel_ned, ramp(1.0, -2.0, 0.5))
        assert (one.h_acc[0], one.v_acc[0], one.s_acc[0]) == pytest.approx((0.8, 1.6, 0.3), rel=1e-6)


def test_a_velocity_that_is_said_to_be_invalid_is_none() -> None:
    valid = np.array([1, 1, 0, 1, 0, 1], np.uint8)
    (one,) = sensors.receivers(builder(vehicle_gps_position=receiver(vel_ned_valid=valid)))
    assert np.isnan(one.vel_ned).any(axis=1).tolist() == [False, False, True, False, True, False]


def test_the_date_is_the_median_of_what_receivers_with_a_fix_tell() -> None:
    unix = 1_700_000_000_000_000 + (T - T[0]).astype(np.int64)
    unix[1] += 90_000_000
    columns = receiver(time_utc_usec=unix.astype(np.uint64))
    assert date(columns) == pytest.approx(1.7e9)
    columns["fix_type"] = np.full(N, 1, np.uint8)
    assert date(columns) is None
    columns["fix_type"], columns["time_utc_usec"] = np.full(N, 3, np.uint8), np.zeros(N, np.uint64)
    assert date(columns) is None


def date(columns: dict[str, Any]) -> float | None:
    made = builder(vehicle_gps_position=columns)
    made.log.gnss = sensors.receivers(made)
    return utc_offset(made)


def test_thrust_is_the_length_of_the_set_point_or_the_throttle_of_old_versions() -> None:
    thrust = ramp(0.03, -0.04, 0.12)
    both = builder(vehicle_thrust_setpoint={"xyz": thrust}, vehicle_rates_setpoint={"thrust_body": 0.5 * thrust})
    found = sensors.throttle_stream(both)
    assert found is not None
    np.testing.assert_allclose(found.x[:, 0], 0.13 * np.arange(1, N + 1), rtol=1e-5)
    old = sensors.throttle_stream(builder(vehicle_attitude_setpoint={"thrust": ramp(-0.1)[:, 0]}))
    assert old is not None
    np.testing.assert_allclose(old.x[:, 0], 0.1 * np.arange(1, N + 1), rtol=1e-5)
    assert sensors.throttle_stream(builder(vehicle_attitude_setpoint={"q_d": np.zeros((N, 4))})) is None


def test_only_rotors_that_ever_turn_are_rotors() -> None:
    columns = {f"esc[{k}].esc_rpm": (1000 * k * np.arange(N)).astype(np.int32) for k in (0, 1, 3)}
    found = sensors.rpm_stream(builder(esc_status=columns))
    assert found is not None
    assert found.x[-1].tolist() == [5000.0, 15000.0]
    assert sensors.rpm_stream(builder(esc_status={"esc[0].esc_rpm": np.zeros(N, np.int32)})) is None
    assert sensors.rpm_stream(builder(esc_status={"count": np.zeros(N)})) is None


def test_a_current_of_minus_one_was_not_measured() -> None:
    amperes = np.array([1.0, -1.0, 3.0, 4.0, 5.0, 6.0], np.float32)
    found = sensors.battery_stream(builder(battery_status={"voltage_v": ramp(3.0)[:, 0], "current_a": amperes}))
    assert found is not None
    assert found.x[:, 0].tolist() == pytest.approx([3.0, 6.0, 9.0, 12.0, 15.0, 18.0])
    assert np.isnan(found.x[:, 1]).tolist() == [False, True, False, False, False, False]


def test_set_points_are_quaternions_or_where_these_are_unset_euler_angles() -> None:
    angles = ramp(0.1, -0.05, 0.2)
    given = np.roll(Rotation.from_euler("ZYX", [0.3, 0.2, 0.1]).as_quat(), 1)
    q = np.tile(given, (N, 1)).astype(np.float32)
    q[2:] = 0.0
    euler = dict(zip(("roll_body", "pitch_body", "yaw_body"), angles.T, strict=True))
    found = estimator.attitude_setpoint(builder(vehicle_attitude_setpoint={"q_d": q, **euler}))
    assert found is not None
    wanted = np.roll(Rotation.from_euler("ZYX", angles[:, ::-1]).as_quat(), 1, axis=1)
    wanted[:2] = given
    same = np.abs(np.sum(found.q * wanted, axis=1))
    np.testing.assert_allclose(same, 1.0, atol=1e-6)
    alone = estimator.attitude_setpoint(builder(vehicle_attitude_setpoint={"q_d": q}))
    assert alone is not None
    assert len(alone.t) == 2
    assert estimator.attitude_setpoint(builder(vehicle_attitude_setpoint={"q_d": 0.0 * q})) is None


def test_rates_biases_and_airspeed_keep_their_axes() -> None:
    rates = sensors.rate_setpoint_stream(
        builder(vehicle_rates_setpoint=dict(zip(("roll", "pitch", "yaw"), ramp(0.1, 0.2, -0.3).T, strict=True)))
    )
    assert rates is not None
    np.testing.assert_allclose(rates.x, ramp(0.1, 0.2, -0.3), rtol=1e-6)
    bias = estimator.acc_bias_stream(builder(estimator_sensor_bias={"accel_bias": ramp(0.01, -0.02, 0.03)}))
    assert bias is not None
    np.testing.assert_allclose(bias.x, ramp(0.01, -0.02, 0.03), rtol=1e-6)
    speed = {"true_airspeed_m_s": ramp(2.0)[:, 0]}
    found = sensors.airspeed_stream(builder(airspeed={"true_airspeed_m_s": ramp(9.0)[:, 0]}, airspeed_validated=speed))
    assert found is not None
    assert (found.source, found.x[0, 0]) == ("airspeed_validated", 2.0)


def test_barometers_are_those_of_the_first_topic_that_has_any_and_repeats_count_once() -> None:
    high = np.array([5.0, 5.0, 6.0, 6.0, 7.0, 7.0], np.float32)
    both = builder(sensor_combined={"baro_alt_meter": high}, sensor_baro={"altitude": ramp(1.0)[:, 0]})
    (one,) = sensors.baro_streams(both)
    assert (one.source, one.x[:, 0].tolist()) == ("sensor_combined:0", [5.0, 6.0, 7.0])
    two = sensors.baro_streams(
        builder(sensor_baro={"altitude": ramp(1.0)[:, 0]}, sensor_baro_at_1={"altitude": ramp(3.0)[:, 0]})
    )
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
    if mav_type is not None:
        made.log.parameters.lines["MAV_TYPE"] = TimeLine(np.zeros(1), [mav_type], "made")
    assert sensors.vehicle_type(made) == said


def test_the_mode_is_the_failsafe_s_while_its_flag_is_set() -> None:
    line = sensors.mode_reason_line(builder(vehicle_status={"failsafe": np.array([0, 0, 1, 1, 0, 0], np.uint8)}))
    assert line is not None
    assert line.value == ["", "failsafe", ""]
    assert sensors.mode_reason_line(builder(vehicle_status={"nav_state": np.zeros(6, np.uint8)})) is None


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
    assert sensors.is_simulated(made) is simulated


def test_units_are_found_by_the_device_of_their_increments_else_of_their_status_else_of_the_raw_gyro() -> None:
    made = builder(
        vehicle_imu={"gyro_device_id": np.full(N, 11, np.uint32)},
        vehicle_imu_at_1={"gyro_device_id": np.array([0, 0, 0, 0, 0, 12], np.uint32)},
        vehicle_imu_status={"gyro_device_id": np.full(N, 13, np.uint32)},
        sensor_gyro_at_2={"device_id": np.array([14, 14, 14, 14, 0, 0], np.uint32)},
        sensor_gyro={"device_id": np.full(N, 12, np.uint32)},
    )
    assert imu.units_of_devices(made, {11, 12, 13, 14, 0, 99}) == {11: 0, 12: 1, 13: 0, 14: 2}


# Masks of a gyro at the end of its range count from 1.15 on, where values are masks and something else agrees.

MASK_RECORDS = 20
FAST, SLOW = np.radians(1601.0), np.radians(1599.0)


def told(mask: Any, rate: float, release: Any = 0x010F0000, counter: int = 0) -> list[Problem]:
    """Problems by a mask (n,), the fastest rate about z, the version, and how far the unit's counter moved."""
    combined = {"timestamp": micros(MASK_RECORDS, 10.0), "gyro_clipping": np.asarray(mask, np.uint8)}
    status = {
        "timestamp": micros(MASK_RECORDS, 10.0),
        "gyro_clipping": np.where(np.arange(MASK_RECORDS) < 9, 4, 4 + counter),
    }
    info = {} if release is None else {"ver_sw_release": release}
    tables = {("sensor_combined", 0): combined, ("vehicle_imu_status", 0): status}
    builder = TopicBuilder(messages("ulog", tables, info=info))
    rates = np.zeros((MASK_RECORDS, 3))
    rates[5, 2] = -rate
    table = builder.messages.tables["sensor_combined", 0]
    return imu.gyro_mask_problem(builder, "sensor_combined", table, "gyro_clipping", rates)


SOME = np.where(np.arange(MASK_RECORDS) % 7 == 3, 4, 0)


@pytest.mark.parametrize(
    ("mask", "rate", "release", "counter", "count"),
    [
        (SOME, FAST, 0x010F0000, 0, 3),
        (SOME, SLOW, 0x010F0000, 0, None),
        (SOME, SLOW, 0x010F0000, 1, 3),
        (SOME, FAST, 0x010EFFFF, 0, None),
        (SOME, FAST, 0x01100000, 0, 3),
        (SOME, FAST, None, 5, None),
        (SOME, FAST, "v1.15", 5, None),
        (np.where(SOME > 0, 7, 0), FAST, 0x010F0000, 0, 3),
        (np.where(SOME > 0, 8, 0), FAST, 0x010F0000, 5, None),
        (0 * SOME, FAST, 0x010F0000, 5, None),
    ],
)
def test_a_mask_counts_where_version_values_and_rate_or_counter_agree(
    mask: Any, rate: float, release: Any, counter: int, count: int | None
) -> None:
    found = told(mask, rate, release, counter)
    assert [p.count for p in found] == ([] if count is None else [count])
    if found:
        assert (found[0].code, f"in {count} samples (gyro_clipping)" in found[0].text) == ("gyro_clipped", True)


def test_counters_count_their_growth_over_all_axes_and_masks_their_samples() -> None:
    axes = np.zeros((MASK_RECORDS, 3), np.int64)
    axes[:, 0], axes[8:, 1], axes[12:, 2] = 7, 2, 300
    tables = {
        ("vehicle_imu_status", 1): {"timestamp": micros(MASK_RECORDS, 10.0), "accel_clipping": axes},
        ("sensor_combined", 0): {
            "timestamp": micros(MASK_RECORDS, 10.0),
            "accelerometer_clipping": SOME.astype(np.uint8),
        },
    }
    builder = TopicBuilder(messages("ulog", tables), t0_us=10_000_000)
    unit, mask = imu.clippings(builder)
    assert (unit.sensor, unit.unit, unit.whole, unit.source) == (
        "accelerometer",
        1,
        True,
        "vehicle_imu_status:1.accel_clipping",
    )
    assert {int(k): int(unit.new[k]) for k in np.flatnonzero(unit.new)} == {8: 2, 12: 300}
    assert unit.t[8] == pytest.approx(0.8)
    assert (mask.unit, mask.whole, mask.source) == (None, False, "sensor_combined.accelerometer_clipping")
    assert mask.new.tolist() == (SOME > 0).astype(int).tolist()


# PX4's own level in m/s^2 in every version, and the peaks of its spectrum.

VIBRATION_RECORDS = 20


def test_increments_of_velocity_become_accelerations_in_old_versions() -> None:
    t = fake.micros(VIBRATION_RECORDS, 1.0)
    old = {"timestamp": t, "accel_vibration_metric": np.full(VIBRATION_RECORDS, 0.05, np.float32)}
    new = old | {"var_accel": np.zeros((VIBRATION_RECORDS, 3), np.float32)}
    imu = {"timestamp": t, "delta_velocity_dt": np.full(VIBRATION_RECORDS, 4000, np.uint32)}
    tables = {("vehicle_imu_status", 0): old, ("vehicle_imu_status", 1): new, ("vehicle_imu", 0): imu}
    levels = sensors.vibration_levels(TopicBuilder(fake.messages("ulog", tables), t0_us=int(t[0])))
    assert [(v.unit, v.measure) for v in levels] == [(0, "difference"), (1, "difference")]
    assert levels[0].level == pytest.approx(0.05 / 0.004)
    assert levels[1].level == pytest.approx(0.05)


def test_impossible_peaks_of_the_onboard_spectrum_are_none() -> None:
    t = fake.micros(VIBRATION_RECORDS, 20.0)
    table = {
        "timestamp": t,
        "sensor_sample_rate_hz": np.full(VIBRATION_RECORDS, 2000.0),
        "resolution_hz": np.full(VIBRATION_RECORDS, 3.9),
    } | {
        f"peak_frequencies_{axis}": np.tile(np.array([90.0, np.nan, value], np.float32), (VIBRATION_RECORDS, 1))
        for axis, value in zip("xyz", (-5.0, 1e9, 150.0), strict=True)
    }
    found = sensors.onboard_spectrum(
        TopicBuilder(fake.messages("ulog", {("sensor_gyro_fft", 0): table}), t0_us=int(t[0]))
    )
    assert found is not None
    assert found.peaks.shape == (VIBRATION_RECORDS, 9)
    assert np.unique(found.peaks[np.isfinite(found.peaks)]).tolist() == [90.0, 150.0]
    assert (found.rate, found.resolution) == (2000.0, 3.9)


@pytest.mark.parametrize(
    ("name", "low", "high"), [("px4_1.14_clipping_field", 0.97, 1.03), ("px4_1.14_hard_landing", 0.90, 0.97)]
)
def test_the_level_of_samples_is_the_one_that_was_logged(corpus, name: str, low: float, high: float) -> None:
    """Measured 0.93 to 1.06 on 18 logs; where the logger lost samples it is least."""
    log = attlog.read(corpus / "logs" / "cases" / f"{name}.ulg")
    imu = log.replay_imu
    assert imu is not None
    own = sample_levels(imu)
    told = next(v for v in log.vibration.levels if v.unit == imu.index)
    t, logged = second_means(told.t, told.level)
    mine = np.interp(t, own.t, own.level)
    shaking = logged > 3.0
    assert low < np.median(mine[shaking]) / np.median(logged[shaking]) < high
