"""PX4 logs of eras and profiles: the best source, the unit that flew, resets, compasses."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from attlog.core import rotation
from attlog.flight.calibration import board_rotation
from attlog.flight.model import FlightLog
from attlog.flight.px4 import reader
from attlog.flight.px4.imu import TopicBuilder
from attlog.flight.px4.sensors import rangefinder_stream
from tests.flight import fake
from tests.flight.fake import gravity, level, messages, micros

N, RATE = 1000, 200.0
RATE_XYZ = np.array([0.1, -0.2, 0.3])


def combined(n: int = N, rate: float = RATE, dt_us: int = 5000) -> dict[str, Any]:
    return {
        "timestamp": micros(n, rate),
        "gyro_rad": np.tile(RATE_XYZ, (n, 1)).astype(np.float32),
        "gyro_integral_dt": np.full(n, dt_us, np.uint32),
        "accelerometer_timestamp_relative": np.zeros(n, np.int32),
        "accelerometer_m_s2": gravity(n),
        "accelerometer_integral_dt": np.full(n, dt_us, np.uint32),
    }


def increments(n: int, rate: float, device: int, angle: np.ndarray = RATE_XYZ) -> dict[str, Any]:
    dt = 1 / rate
    return {
        "timestamp": micros(n, rate) + np.uint64(1500),
        "timestamp_sample": micros(n, rate),
        "gyro_device_id": np.full(n, device, np.uint32),
        "accel_device_id": np.full(n, device + 1, np.uint32),
        "delta_angle": np.tile(angle * dt, (n, 1)).astype(np.float32),
        "delta_velocity": gravity(n) * np.float32(dt),
        "delta_angle_dt": np.full(n, round(dt * 1e6), np.uint32),
        "delta_velocity_dt": np.full(n, round(dt * 1e6), np.uint32),
    }


def read(tables: dict[tuple[str, int], Any], params: Any = (), **asked: Any) -> FlightLog:
    return reader.read(
        messages("ulog", tables, params, info={"sys_name": "PX4", "ver_sw_release": 0x010F01FF}), **asked
    )


def test_a_combined_sample_is_a_mean_over_the_interval_before() -> None:
    log = read({("sensor_combined", 0): combined()})
    assert log.imus[log.imu].gyro.sampling == "interval"
    assert log.imus[log.imu].gyro.t[0] == 0
    assert log.t0_us == 10_000_000
    assert str(log.firmware) == "PX4 1.15.1"


def test_integration_time_is_seconds_as_float_and_microseconds_as_integer() -> None:
    old = combined(dt_us=5000) | {"gyro_integral_dt": np.full(N, 0.005, np.float32)}
    for columns in (old, combined()):
        log = read({("sensor_combined", 0): columns})
        assert log.imu == 0
        assert not log.problems or all(p.code != "imu_decimated" for p in log.problems)


def test_a_decimated_sensor_combined_is_told_and_refused_below_ten_hertz() -> None:
    log = read({("sensor_combined", 0): combined(200, 9.6, 4000)})
    assert log.imu is None
    assert {"imu_decimated", "imu_rate_too_low"} <= {p.code for p in log.problems}
    assert "SDLOG_PROFILE" in " ".join(p.remedy for p in log.problems)


def test_fast_increments_of_the_unit_that_flew_are_preferred_and_divided_by_their_own_time() -> None:
    tables = {
        ("sensor_combined", 0): combined(),
        ("vehicle_imu", 0): increments(N, RATE, 11),
        ("vehicle_imu", 1): increments(N, RATE, 22, 2 * RATE_XYZ),
        ("sensor_selection", 0): {"timestamp": micros(1, 1), "gyro_device_id": np.array([22], np.uint32)},
    }
    log = read(tables)
    imu = log.imus[log.imu]
    assert (imu.index, imu.gyro.source) == (1, "vehicle_imu:1")
    np.testing.assert_allclose(imu.gyro.x, np.tile(2 * RATE_XYZ, (N, 1)), rtol=1e-6)
    np.testing.assert_allclose(imu.dt, 0.005)
    assert log.imu_that_flew.value == [1]
    assert read(tables, imu=0).imus[0].gyro.source == "vehicle_imu:0"
    assert read(tables, imu=7).imu is None


def test_slow_increments_do_not_replace_sensor_combined() -> None:
    tables = {
        ("sensor_combined", 0): combined(),
        ("vehicle_imu", 0): increments(10, 2.0, 11),
        ("vehicle_imu", 1): increments(10, 2.0, 22),
    }
    log = read(tables)
    assert [i.gyro.source for i in log.imus] == ["sensor_combined", "vehicle_imu:1"]
    assert log.imus[log.imu].gyro.source == "sensor_combined"


def fifo(batches: int, per_batch: int, dt_us: float, value: tuple[int, int, int], device: int) -> dict[str, Any]:
    jitter = np.random.default_rng(1).integers(-40, 40, batches)
    end = (10_000_000 + np.round(np.arange(1, batches + 1) * per_batch * dt_us) + jitter).astype(np.uint64)
    axes = {a: np.tile(np.array([v], np.int16), (batches, 32)) for a, v in zip("xyz", value, strict=True)}
    return {
        "timestamp": end + np.uint64(200),
        "timestamp_sample": end,
        "device_id": np.full(batches, device, np.uint32),
        "dt": np.full(batches, dt_us, np.float32),
        "scale": np.full(batches, 0.001, np.float32),
        "samples": np.full(batches, per_batch, np.uint8),
        **axes,
    }


def test_fifo_samples_are_spread_over_time_calibrated_and_turned_into_the_body() -> None:
    params = {
        "CAL_GYRO0_ID": 11,
        "CAL_GYRO0_XOFF": 0.1,
        "SENS_BOARD_ROT": 4,
        "CAL_ACC0_ID": 12,
        "CAL_ACC0_ZSCALE": 1.01,
    }
    tables = {
        ("sensor_gyro_fifo", 0): fifo(300, 8, 125.0, (1000, 200, 300), 11),
        ("sensor_accel_fifo", 0): fifo(300, 4, 250.0, (0, 0, -9000), 12),
        ("sensor_combined", 0): combined(),
    }
    log = read(tables, params)
    imu = log.imus[log.imu]
    assert imu.gyro.source == "sensor_gyro_fifo:0"
    assert imu.gyro.rate == pytest.approx(8000, rel=0.01)
    assert (np.diff(imu.gyro.t) > 0).all()
    # Stamps jitter by 40 us: spread over the batch's own time, no interval is longer than (1000 + 80) / 8 us.
    assert np.diff(imu.gyro.t).max() < 137e-6
    assert "time_backward" not in {p.code for p in log.problems}
    np.testing.assert_allclose(imu.gyro.x[50], [-0.9, -0.2, 0.3], atol=1e-6)  # yaw 180: x and y change sign
    np.testing.assert_allclose(imu.acc.x[50], [0, 0, -9.09], atol=1e-5)


@pytest.mark.parametrize("told", [0.0, -125.0, np.nan, np.inf, 3e38, 1e-40, 400.0])
def test_fifo_samples_whose_interval_is_none_are_spread_over_the_time_of_their_batch(told: float) -> None:
    tables = {("sensor_gyro_fifo", 0): fifo(300, 8, 125.0, (1000, 200, 300), 11), ("sensor_combined", 0): combined()}
    tables["sensor_gyro_fifo", 0]["dt"] = np.full(300, told, np.float32)
    imu = read(tables).imus[0]
    assert imu.gyro.source == "sensor_gyro_fifo:0"
    assert imu.gyro.rate == pytest.approx(8000, rel=0.01)
    assert np.diff(imu.gyro.t).max() < 0.0002


def test_fifo_samples_keep_their_interval_where_most_batches_are_lost() -> None:
    sound = fifo(3000, 8, 125.0, (1000, 200, 300), 11)
    few = {name: column[::10] for name, column in sound.items()}
    imu = read({("sensor_gyro_fifo", 0): few, ("sensor_combined", 0): combined(3000, 500.0)}).imus[0]
    np.testing.assert_allclose(np.median(np.diff(imu.gyro.t)), 125e-6)


def test_fifo_batches_that_tell_of_more_samples_than_they_have_room_for_are_left_out_and_told() -> None:
    batches = fifo(300, 8, 125.0, (1000, 200, 300), 11)
    batches["samples"][100:110] = 255
    log = read({("sensor_gyro_fifo", 0): batches, ("sensor_combined", 0): combined()})
    assert len(log.imus[0].gyro.t) == 8 * 290
    assert [p.count for p in log.problems if p.code == "values_out_of_range"] == [10]
    batches["samples"][:200] = 255
    log = read({("sensor_gyro_fifo", 0): batches, ("sensor_combined", 0): combined()})
    assert log.imus[log.imu].gyro.source == "sensor_combined"


@pytest.mark.parametrize("stamps", ["standing still", "backwards"])
def test_a_message_that_covers_next_to_nothing_is_not_preferred(stamps: str) -> None:
    batches = fifo(300, 30, 125.0, (1000, 200, 300), 11)
    end = batches["timestamp_sample"]
    batches["timestamp_sample"] = end[::-1] if stamps == "backwards" else np.full_like(end, end[150])
    log = read({("sensor_gyro_fifo", 0): batches, ("sensor_combined", 0): combined()})
    assert log.imus[log.imu].gyro.source == "sensor_combined"
    log = read({("sensor_gyro_fifo", 0): batches, ("sensor_accel_fifo", 0): batches})
    assert log.imu is None


def test_samples_for_which_the_accelerometer_has_no_value_are_told() -> None:
    dead = combined()
    dead["accelerometer_m_s2"][20:40] = np.inf
    tables = {("sensor_gyro_fifo", 0): fifo(300, 8, 125.0, (1000, 200, 300), 11), ("sensor_combined", 0): dead}
    log = read(tables)
    assert any("sensor_combined has no value" in p.text for p in log.problems)


def test_the_board_rotation_is_not_applied_to_what_px4_has_turned_already() -> None:
    """``sensor_combined``, ``vehicle_imu``, ``vehicle_magnetometer`` are in the body frame: turning them is twice."""
    turned = {"SENS_BOARD_ROT": 4, "SENS_BOARD_X_OFF": 5.0, "CAL_GYRO0_ID": 11, "CAL_GYRO0_XOFF": 0.1}
    field = {
        "timestamp": micros(200, 40),
        "timestamp_sample": micros(200, 40),
        "magnetometer_ga": np.tile(np.array([0.2, 0.1, 0.4], np.float32), (200, 1)),
    }
    imus = {"sensor_combined": combined(), "vehicle_imu": increments(N, RATE, 11)}
    for name, columns in imus.items():
        tables = {(name, 0): columns, ("vehicle_magnetometer", 0): field}
        plain, told = read(tables), read(tables, turned)
        assert told.imus[told.imu].gyro.source.startswith(name)
        np.testing.assert_allclose(told.imus[told.imu].gyro.x[5], RATE_XYZ, rtol=1e-5)
        np.testing.assert_array_equal(told.imus[told.imu].acc.x, plain.imus[plain.imu].acc.x)
        np.testing.assert_allclose(told.mags[told.mag].field.x[5], np.array([0.2, 0.1, 0.4]) * 1e-4, rtol=1e-5)


def attitude(n: int, counter: np.ndarray, q: np.ndarray | None = None) -> dict[str, Any]:
    return {
        "timestamp": micros(n, 20),
        "q": level(n) if q is None else q.astype(np.float32),
        "quat_reset_counter": counter.astype(np.uint8),
    }


def test_the_reset_counter_marks_the_step_also_when_it_wraps() -> None:
    counter = np.concatenate([np.full(20, 255), np.full(30, 0)])
    log = read({("sensor_combined", 0): combined(), ("vehicle_attitude", 0): attitude(50, counter)})
    assert log.attitudes["vehicle_attitude"].resets.tolist() == [20]


def test_another_estimator_instance_is_a_reset_even_without_the_counter() -> None:
    q = rotation.from_euler(0, 0, np.where(np.arange(100) < 60, 0.0, 0.1))
    selector = {
        "timestamp": micros(5, 1),
        "primary_instance": np.array([0, 0, 0, 1, 1], np.uint8),
        "last_instance_change": np.array([0, 0, 0, 13_000_000, 13_000_000], np.uint64),
    }
    tables = {
        ("sensor_combined", 0): combined(),
        ("vehicle_attitude", 0): attitude(100, np.zeros(100), q),
        ("estimator_selector_status", 0): selector,
    }
    log = read(tables)
    assert log.attitudes["vehicle_attitude"].resets.tolist() == [60]
    assert "estimator_instance_changed" in {p.code for p in log.problems}


def test_a_raw_compass_is_calibrated_by_its_device_and_a_disabled_one_is_not_used() -> None:
    raw = {
        "timestamp": micros(20, 1),
        "device_id": np.full(20, 77, np.uint32),
        **{a: np.full(20, v, np.float32) for a, v in zip("xyz", (0.3, 0.1, 0.5), strict=True)},
    }
    params = {"CAL_MAG1_ID": 77, "CAL_MAG1_XOFF": 0.1, "CAL_MAG1_ROT": 2, "CAL_MAG1_PRIO": 50}
    log = read({("sensor_combined", 0): combined(), ("sensor_mag", 0): raw}, params)
    np.testing.assert_allclose(log.mags[log.mag].field.x[0], np.array([-0.1, 0.2, 0.5]) * 1e-4, atol=1e-9)  # yaw 90
    log = read({("sensor_combined", 0): combined(), ("sensor_mag", 0): raw}, params | {"CAL_MAG1_PRIO": 0})
    assert log.mag is None
    assert "mag_disabled" in {p.code for p in log.problems}
    assert (
        read({("sensor_combined", 0): combined(), ("sensor_mag", 0): raw}, params | {"CAL_MAG1_PRIO": 0}, mag=0).mag
        == 0
    )


def test_the_fine_offsets_of_a_board_turn_after_its_rotation_as_px4_multiplies_them() -> None:
    """PX4 (sensor_calibration/Utilities.cpp): Dcmf(Eulerf(x, y, z)) * get_rot_matrix(SENS_BOARD_ROT)."""
    values = {"SENS_BOARD_ROT": 2.0, "SENS_BOARD_X_OFF": 5.0, "SENS_BOARD_Y_OFF": 3.0, "SENS_BOARD_Z_OFF": -2.0}
    expected = Rotation.from_euler("ZYX", [-2.0, 3.0, 5.0], degrees=True) * Rotation.from_euler("z", 90.0, degrees=True)
    np.testing.assert_allclose(board_rotation(values), expected.as_matrix(), atol=1e-9)


def test_a_compass_inside_sensor_combined_counts_only_new_values_at_their_own_time() -> None:
    columns = combined()
    field = np.repeat(np.random.default_rng(2).normal(0.3, 0.01, (N // 4, 3)), 4, axis=0).astype(np.float32)
    columns |= {"magnetometer_ga": field, "magnetometer_timestamp_relative": np.full(N, -10_000, np.int32)}
    log = read({("sensor_combined", 0): columns})
    mag = log.mags[log.mag].field
    assert mag.rate == pytest.approx(50, rel=0.02)
    assert mag.t[0] == pytest.approx(-0.01)
    assert np.median(mag.x) == pytest.approx(0.3e-4, rel=0.02)


def receiver(new: bool, place: tuple[float, float, float] = (47.3977, 8.5456, 488.0)) -> dict[str, Any]:
    """Twenty fixes of one place, whose velocity is 0.5 m/s along each axis."""
    columns: dict[str, Any] = {"timestamp": micros(20, 5), "time_utc_usec": micros(20, 5, 1_700_000_000_000_000)}
    columns["fix_type"] = np.full(20, 3, np.uint8)
    for name in ("eph", "epv", "s_variance_m_s", "vel_n_m_s", "vel_e_m_s", "vel_d_m_s"):
        columns[name] = np.full(20, 0.5, np.float32)
    names = ("latitude_deg", "longitude_deg", "altitude_msl_m") if new else ("lat", "lon", "alt")
    for name, value, factor in zip(names, place, (1, 1, 1) if new else (1e7, 1e7, 1e3), strict=True):
        columns[name] = np.full(20, value * factor, np.float64 if new else np.int32)
    return columns


def test_a_switch_of_the_gyro_in_flight_is_told() -> None:
    selection = {"timestamp": micros(2, 0.5), "gyro_device_id": np.array([11, 22], np.uint32)}
    tables = {
        ("sensor_combined", 0): combined(),
        ("vehicle_imu", 0): increments(10, 2.0, 11),
        ("vehicle_imu", 1): increments(10, 2.0, 22),
        ("sensor_selection", 0): selection,
    }
    log = read(tables)
    assert log.imu_that_flew.value == [0, 1]
    assert "imu_switched" in {p.code for p in log.problems}


@pytest.mark.parametrize(
    ("bit", "old", "new"),
    [
        (1, "The EKF failed numerically: compass y.", "The EKF failed numerically: compass y."),
        (10, "The EKF failed numerically: velocity east.", "The EKF found bad vertical acceleration."),
        (11, "The EKF failed numerically: velocity down.", "The EKF found a clipping accelerometer."),
        (9, "The EKF failed numerically: velocity north.", None),
        (15, "The EKF failed numerically: accelerometer bias.", None),
    ],
)
def test_bits_of_faults_moved_with_1_15(bit: int, old: str, new: str | None) -> None:
    """Told by the names of ``estimator_status_flags`` where they were logged."""
    flags = np.full(5, 1 << bit, np.uint32)
    status = {"timestamp": micros(5, 1.0, 11_000_000), "filter_fault_flags": flags}
    none = np.zeros(5, np.uint8)
    named = {"timestamp": micros(5, 1.0, 11_000_000), "fs_bad_acc_vertical": none}
    for more, told in ((named, new), (named | {"fs_bad_vel_n": none}, old)):
        tables = {("sensor_combined", 0): combined(), ("estimator_status", 0): status}
        log = read(tables | {("estimator_status_flags", 0): more})
        assert [p.text for p in log.problems if p.code == "ekf_fault"] == ([told] if told else [])


def test_what_a_receiver_says_of_its_signals_is_kept_by_name() -> None:
    told = {
        "satellites_used": np.full(20, 14, np.uint8),
        "hdop": np.full(20, 0.7, np.float32),
        "noise_per_ms": np.full(20, 101, np.int32),
        "jamming_indicator": np.full(20, 33, np.int32),
        "jamming_state": np.full(20, 2, np.uint8),
        "spoofing_state": np.where(np.arange(20) < 5, 1, 3).astype(np.uint8),
    }
    tables = {("sensor_combined", 0): combined(), ("vehicle_gps_position", 0): receiver(True) | told}
    reception = read(tables).gnss[0].reception
    assert reception is not None
    assert (reception.satellites[0], reception.noise[0], reception.jamming[0]) == (14.0, 101.0, 33.0)
    assert (reception.jamming_state[0], reception.spoofing_state[0], reception.spoofing_state[-1]) == (2.0, 1.0, 3.0)
    assert reception.hdop[0] == pytest.approx(0.7)
    assert (
        read({("sensor_combined", 0): combined(), ("vehicle_gps_position", 0): receiver(True)}).gnss[0].reception
        is None
    )


def test_the_headings_ratio_of_1_16_is_the_compass_and_squares_fill_what_is_missing() -> None:
    n = 20
    status = {"timestamp": micros(n, 1.0), "hdg_test_ratio": np.full(n, 0.3, np.float32)}
    squares = {
        "timestamp": micros(n, 1.0),
        "gps_hvel": np.tile(np.array([0.04, 0.25], np.float32), (n, 1)),
        "gps_vvel": np.full(n, 0.09, np.float32),
        "gps_hpos": np.full((n, 2), np.inf, np.float32),
        "mag_field": np.full((n, 3), 4.0, np.float32),
    }
    tables = {("sensor_combined", 0): combined(), ("estimator_status", 0): status}
    log = read(tables | {("estimator_innovation_test_ratios", 0): squares})
    ratios = {one.aid: float(one.ratio[3]) for one in log.estimator.innovation_tests}
    assert ratios == {"compass": pytest.approx(0.3), "velocity": pytest.approx(0.5)}


def test_the_instance_that_flew_is_a_time_line() -> None:
    selector = {"timestamp": micros(4, 1.0), "primary_instance": np.array([0, 0, 1, 1], np.uint8)}
    log = read({("sensor_combined", 0): combined(), ("estimator_selector_status", 0): selector})
    assert log.estimator.lane is not None
    assert log.estimator.lane.value == [0, 1]
    assert read({("sensor_combined", 0): combined()}).estimator.lane is None


@pytest.mark.parametrize("old", [False, True], ids=["position", "x y z"])
def test_a_pose_of_motion_capture_has_the_position_at_the_times_of_its_attitude(old: bool) -> None:
    """1 m/s north; every third record has no position, which lies on the line between its neighbours."""
    n = 60
    north = np.arange(n) * 0.1
    place = np.column_stack([north, np.full(n, 2.0), np.full(n, -3.0)]).astype(np.float32)
    place[1::3] = np.nan
    named = dict(zip("xyz", place.T, strict=True)) if old else {"position": place}
    odometry = {"timestamp": micros(n, 10.0), "q": np.tile(np.float32([1, 0, 0, 0]), (n, 1))} | named
    log = read({("sensor_combined", 0): combined(), ("vehicle_mocap_odometry", 0): odometry})
    found = log.attitudes["vehicle_mocap_odometry"].position
    np.testing.assert_allclose(found, np.column_stack([north, np.full(n, 2.0), np.full(n, -3.0)]), atol=1e-5)
    without = {name: x for name, x in odometry.items() if name not in named}
    log = read({("sensor_combined", 0): combined(), ("vehicle_mocap_odometry", 0): without})
    assert log.attitudes["vehicle_mocap_odometry"].position is None


# What PX4 logs of its aids: which readings count.


def test_of_a_rangefinder_only_readings_with_a_signal_and_in_range_count() -> None:
    """signal_quality: 0 is no signal, -1 unknown; a distance at the end of the range is no reading."""
    columns = {
        "timestamp": fake.micros(6, 10.0),
        "current_distance": np.array([1.0, 2.0, 3.0, 0.1, 40.0, 6.0], np.float32),
        "min_distance": np.full(6, 0.2, np.float32),
        "max_distance": np.full(6, 40.0, np.float32),
        "signal_quality": np.array([80, 0, -1, 90, 90, 1], np.int8),
        "orientation": np.full(6, 25, np.uint8),
    }
    found = rangefinder_stream(TopicBuilder(fake.messages("ulog", {("distance_sensor", 0): columns}), t0_us=10_000_000))
    assert found is not None
    assert found.x[:, 0].tolist() == [1.0, 3.0, 6.0]
