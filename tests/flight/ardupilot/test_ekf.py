"""The gyro bias of ArduPilot's EKFs: whose core, in what unit, and when none flew."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from tests.flight.ardupilot.test_ardupilot import imu, read
from tests.flight.fake import micros

DEG_S = (0.57, -1.15, 1.72)


def state(factor: float = 1.0, n: int = 20) -> dict[str, Any]:
    return {"TimeUS": micros(n, 5.0)} | {
        c: np.full(n, factor * v, np.float32) for c, v in zip(("GX", "GY", "GZ"), DEG_S, strict=True)
    }


def primary(core: int, n: int = 20) -> dict[str, Any]:
    return {"TimeUS": micros(n, 5.0), "PI": np.full(n, core, np.int8)}


@pytest.mark.parametrize("family", ["XK", "NK"])
def test_the_records_hold_degrees_per_second(family: str) -> None:
    stream = read({("IMU", 0): imu(), (f"{family}F1", 0): state()}).onboard_gyro_bias
    assert stream is not None
    np.testing.assert_allclose(np.degrees(stream.x[0]), DEG_S, rtol=1e-6)
    assert (stream.unit, stream.frame, stream.source) == ("rad/s", "FRD", f"{family}F1:0")


def two_cores() -> dict[tuple[str, int], Any]:
    return {
        ("IMU", 0): imu(I=np.zeros(1000, np.uint8)),
        ("IMU", 1): imu(I=np.ones(1000, np.uint8)),
        ("XKF1", 0): state(),
        ("XKF1", 1): state(2.0),
        ("XKF4", 0): primary(1),
    }


def test_it_is_that_of_the_primary_core_or_of_the_core_on_the_unit_asked_for() -> None:
    for asked, factor in (({}, 2.0), ({"imu": 0}, 1.0)):
        stream = read(two_cores(), {"EK3_IMU_MASK": 3.0}, **asked).onboard_gyro_bias
        assert stream is not None
        np.testing.assert_allclose(np.degrees(stream.x[0]), factor * np.array(DEG_S), rtol=1e-6)


def test_the_second_core_of_old_logs_stands_under_its_own_name() -> None:
    tables = {
        ("IMU", 0): imu(),
        ("IMU2", 0): imu(),
        ("NKF1", 0): state(),
        ("NKF6", 0): state(2.0),
        ("NKF4", 0): primary(1),
    }
    stream = read(tables, {"EK2_IMU_MASK": 3.0}).onboard_gyro_bias
    assert stream is not None
    assert stream.source == "NKF6:1"


@pytest.mark.parametrize(("name", "ekf"), [("EKF1", 1.0), ("XKF1", 0.0)])
def test_an_unknown_unit_and_an_ekf_that_did_not_fly_give_none(name: str, ekf: float) -> None:
    assert read({("IMU", 0): imu(), (name, 0): state()}, {"AHRS_EKF_TYPE": ekf}).onboard_gyro_bias is None


def test_the_accelerometer_bias_is_that_of_the_primary_core() -> None:
    def learned(x: float) -> dict[str, Any]:
        return {"TimeUS": micros(20, 5.0), **{a: np.full(20, x, np.float32) for a in ("AX", "AY", "AZ")}}

    stream = read(two_cores() | {("XKF2", 0): learned(0.1), ("XKF2", 1): learned(-0.3)}).acc_bias
    assert stream is not None
    np.testing.assert_allclose(stream.x[0], -0.3, rtol=1e-6)


def test_the_core_that_flew_is_a_time_line() -> None:
    changes = primary(0) | {"PI": np.where(np.arange(20) < 8, 0, 1).astype(np.int8)}
    lane = read({("IMU", 0): imu(), ("XKF4", 0): changes}, {"AHRS_EKF_TYPE": 3.0}).lane
    assert lane is not None
    assert lane.value == [0, 1]
    assert lane.t[1] - lane.t[0] == pytest.approx(8 / 5.0)
    assert read({("IMU", 0): imu(), ("XKF4", 0): changes}, {"AHRS_EKF_TYPE": 0.0}).lane is None


def test_test_ratios_of_the_second_core_of_old_logs_are_read_under_its_own_name() -> None:
    ratios = {"TimeUS": micros(20, 5.0), "SM": np.linspace(0.1, 0.4, 20), "SV": np.linspace(0.3, 0.9, 20)}
    for core, name in ((1, "NKF9"), (0, "NKF4:0")):
        tables = {("IMU", 0): imu(), ("IMU2", 0): imu(), ("NKF1", 0): state(), ("NKF6", 0): state(2.0)}
        first = primary(core) | {k: 2.0 * v for k, v in ratios.items() if k != "TimeUS"}
        log = read(tables | {("NKF4", 0): first, ("NKF9", 0): ratios}, {"EK2_IMU_MASK": 3.0})
        found = {test.aid: test for test in log.innovation_tests}
        assert {aid: test.source for aid, test in found.items()} == {"compass": f"{name}.SM", "velocity": f"{name}.SV"}
        np.testing.assert_allclose(found["compass"].ratio, (1.0 if core else 2.0) * ratios["SM"])
