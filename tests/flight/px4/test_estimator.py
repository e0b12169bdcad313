"""The gyro bias of PX4's estimator: whose, in what unit, and when none follows from the log."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

import attlog
from attlog import flight
from attlog.core import rotation
from tests.conftest import SAMPLES
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
    stream = read({("sensor_combined", 0): combined(), ("estimator_sensor_bias", 0): bias(BIAS)}).estimator.gyro_bias
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
    stream = read(two_units(primary, 8)).estimator.gyro_bias
    assert stream is not None
    np.testing.assert_allclose(stream.x[0], (primary + 1) * BIAS, rtol=1e-6)


def test_another_unit_has_the_bias_of_the_instance_that_runs_on_it() -> None:
    stream = read(two_units(2, 8), imu=0).estimator.gyro_bias
    assert stream is not None
    assert stream.source == "estimator_sensor_bias:0"


def test_a_bias_of_another_gyro_is_none_of_the_replayed_one() -> None:
    tables = {("vehicle_imu", 0): increments(N, RATE, 7), ("estimator_sensor_bias", 0): bias(BIAS, 9)}
    assert read(tables).estimator.gyro_bias is None


@pytest.mark.parametrize(("imu", "expected"), [(0, 0.1), (1, 0.2), (2, None)])
def test_the_accelerometer_bias_is_of_an_instance_on_the_replayed_unit(imu: int, expected: float | None) -> None:
    tables = two_units(0, 7) | {("vehicle_imu", 2): increments(N, RATE, 9)}
    for i, device in ((0, 7), (1, 8)):
        tables["vehicle_imu", i]["accel_device_id"] = np.full(N, device, np.uint32)
        tables["estimator_sensor_bias", i] |= {
            "accel_device_id": np.full(5, device, np.uint32),
            "accel_bias": np.full((5, 3), 0.1 * (i + 1), np.float32),
        }
    tables["vehicle_imu", 2]["accel_device_id"] = np.full(N, 9, np.uint32)
    stream = read(tables, imu=imu).estimator.acc_bias
    assert (None if stream is None else pytest.approx(float(stream.x[0, 0]), rel=1e-6)) == expected


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
    assert log.estimator.gyro_bias is None


# The heading that PX4 finds from GNSS motion: in which eras, and when it is valid.

TOPIC = "yaw_estimator_status"
VARIANCE = np.array([1.0, 0.09, 0.01, 0.0025, 0.0004], np.float32)


def estimated(**more: Any) -> dict[str, Any]:
    """Five records of an estimator that becomes surer each second."""
    yaw = np.linspace(0.1, 0.5, 5).astype(np.float32)
    return {"timestamp": micros(5, 1.0, 11_000_000), "yaw_composite": yaw, "yaw_variance": VARIANCE} | more


def test_before_it_had_a_flag_it_is_valid_where_one_sigma_is_below_15_deg() -> None:
    stream = read({("sensor_combined", 0): combined(), (TOPIC, 0): estimated()}).estimator.yaw
    assert stream is not None
    np.testing.assert_allclose(stream.x[:, 0], [0.3, 0.4, 0.5], rtol=1e-6)
    np.testing.assert_allclose(stream.x[:, 1], [0.1, 0.05, 0.02], rtol=1e-6)
    np.testing.assert_allclose(stream.t, [3, 4, 5])
    assert stream.unit == "rad"


def test_a_flag_leaves_out_what_the_estimator_itself_calls_invalid() -> None:
    topic = estimated(yaw_composite_valid=np.array([0, 0, 0, 1, 1], np.uint8))
    stream = read({("sensor_combined", 0): combined(), (TOPIC, 0): topic}).estimator.yaw
    assert stream is not None
    np.testing.assert_allclose(stream.x[:, 0], [0.4, 0.5], rtol=1e-6)


@pytest.mark.parametrize("selected", [0, 1])
def test_of_two_estimators_it_is_the_selected_ones(selected: int) -> None:
    chosen = {"timestamp": micros(5, 1.0, 11_000_000), "primary_instance": np.full(5, selected, np.uint8)}
    tables = {("sensor_combined", 0): combined(), ("estimator_selector_status", 0): chosen, (TOPIC, 0): estimated()}
    stream = read(tables | {(TOPIC, 1): estimated(yaw_composite=np.full(5, 1.5, np.float32))}).estimator.yaw
    assert stream is not None
    assert stream.source == f"{TOPIC}:{selected}"
    np.testing.assert_allclose(stream.x[:, 0], [[0.3, 0.4, 0.5], [1.5, 1.5, 1.5]][selected], rtol=1e-6)


def test_in_a_simulated_flight_it_is_near_the_true_heading() -> None:
    """Clockwise from true north, in radians: its own sigma there is 2 deg."""
    log = flight.read(SAMPLES / "px4_steps.ulg")
    assert log.estimator.yaw is not None
    assert log.truth is not None
    q = rotation.slerp(log.truth.t, log.truth.q, log.estimator.yaw.t_best)
    off = np.degrees(rotation.wrap(log.estimator.yaw.x[:, 0] - rotation.to_euler(q)[:, 2]))
    assert np.nanmedian(np.abs(off)) < 6.0


# Size and sign of the onboard gyro bias, on simulated flights whose gyros have a planted bias.

WITHIN_DEG_S = {"px4": 0.03, "ardupilot": 0.1}
"""The planted biases are 0.2 to 0.9 deg/s. A mean of 8 s of this noise is good to 0.01 deg/s, the earth's turn is
0.004 deg/s. ArduPilot logs steps of 0.01 deg/s, and its z, seen through the compass only, is still settling at
arming: 0.08 deg/s short at the most."""


@pytest.mark.parametrize(
    "name",
    [
        "px4/px4_static.ulg",
        "px4/px4_hover.ulg",
        "px4/px4_steps.ulg",
        "ardupilot/copter_hover_rest.bin",
        "ardupilot/copter_static_hop.bin",
        "ardupilot/copter_long.bin",
    ],
)
def test_before_arming_it_is_what_the_logged_gyro_shows_standing_still(corpus: Path, name: str) -> None:
    log = attlog.read(corpus / "sitl" / name)
    bias, imu, armed = log.estimator.gyro_bias, log.replay_imu, log.state.armed
    assert bias is not None
    assert imu is not None
    assert armed is not None
    start = float(armed.t[armed.value.index(True)])
    still = (imu.gyro.t > start - 9.0) & (imu.gyro.t < start - 1.0)
    apart = np.degrees(bias.x[bias.t < start][-1] - imu.gyro.x[still].mean(axis=0))
    assert np.abs(apart).max() < WITHIN_DEG_S[name.split("/")[0]]
