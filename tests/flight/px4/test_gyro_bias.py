"""The gyro bias of PX4's estimator: whose, in what unit, and when none follows from the log."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from tests.flight.fake import micros
from tests.flight.px4.test_px4 import RATE, RATE_XYZ, N, combined, increments, read

BIAS = np.array([0.01, -0.02, 0.03], np.float32)


def bias(x: np.ndarray, device: int = 7, n: int = 5) -> dict[str, Any]:
    return {
        "timestamp": micros(n, 1.0, 11_000_000),
        "gyro_device_id": np.full(n, device, np.uint32),
        "gyro_bias": np.tile(x, (n, 1)).astype(np.float32),
    }


def selector(instance: int, device: int, n: int = 5) -> dict[str, Any]:
    return {
        "timestamp": micros(n, 1.0),
        "primary_instance": np.full(n, instance, np.uint8),
        "gyro_device_id": np.full(n, device, np.uint32),
    }


def test_the_bias_is_rad_per_second_on_the_clock_of_the_log() -> None:
    stream = read({("sensor_combined", 0): combined(), ("estimator_sensor_bias", 0): bias(BIAS)}).onboard_gyro_bias
    assert stream is not None
    np.testing.assert_allclose(stream.x[0], BIAS)
    np.testing.assert_allclose(stream.t, [1, 2, 3, 4, 5])
    assert (stream.unit, stream.frame, stream.source) == ("rad/s", "FRD", "estimator_sensor_bias:0")


def two_units(primary: int, flew: int) -> dict[tuple[str, int], Any]:
    return {
        ("vehicle_imu", 0): increments(N, RATE, 7),
        ("vehicle_imu", 1): increments(N, RATE, 8),
        ("estimator_selector_status", 0): selector(primary, flew),
        ("estimator_sensor_bias", 0): bias(BIAS, 7),
        ("estimator_sensor_bias", 1): bias(2 * BIAS, 8),
        ("estimator_sensor_bias", 2): bias(3 * BIAS, 8),
    }


@pytest.mark.parametrize("primary", [1, 2])
def test_it_is_that_of_the_selected_instance(primary: int) -> None:
    stream = read(two_units(primary, 8)).onboard_gyro_bias
    assert stream is not None
    np.testing.assert_allclose(stream.x[0], (primary + 1) * BIAS, rtol=1e-6)


def test_another_unit_has_the_bias_of_the_instance_that_runs_on_it() -> None:
    stream = read(two_units(2, 8), imu=0).onboard_gyro_bias
    assert stream is not None
    assert stream.source == "estimator_sensor_bias:0"


def test_a_bias_of_another_gyro_is_none_of_the_replayed_one() -> None:
    tables = {("vehicle_imu", 0): increments(N, RATE, 7), ("estimator_sensor_bias", 0): bias(BIAS, 9)}
    assert read(tables).onboard_gyro_bias is None


def test_an_angle_per_step_of_unknown_length_is_no_rate() -> None:
    states = {"timestamp": micros(5, 1.0), "states": np.full((5, 24), 1e-4, np.float32)}
    assert read({("sensor_combined", 0): combined(), ("estimator_status", 0): states}).onboard_gyro_bias is None


def test_a_gyro_that_has_the_bias_taken_off_has_none_to_subtract() -> None:
    tables = {
        ("vehicle_angular_velocity", 0): {
            "timestamp": micros(N, RATE),
            "timestamp_sample": micros(N, RATE),
            "xyz": np.tile(RATE_XYZ, (N, 1)).astype(np.float32),
        },
        ("vehicle_acceleration", 0): {
            "timestamp": micros(N, RATE),
            "timestamp_sample": micros(N, RATE),
            "xyz": np.tile(np.array([0, 0, -9.81], np.float32), (N, 1)),
        },
        ("estimator_sensor_bias", 0): bias(BIAS),
    }
    log = read(tables)
    assert log.replay_imu is not None
    assert log.onboard_gyro_bias is None
