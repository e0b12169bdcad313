"""The gyro bias of ArduPilot's EKFs: whose core, in what unit, and when none flew."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from attlog import flight
from attlog.core import rotation
from attlog.flight.ardupilot import reader
from tests.conftest import SAMPLES
from tests.flight.ardupilot.test_ardupilot import BANNER, imu, read
from tests.flight.fake import messages, micros

DEG_S = (0.57, -1.15, 1.72)


def state(factor: float = 1.0, n: int = 20) -> dict[str, Any]:
    return {"TimeUS": micros(n, 5.0)} | {
        c: np.full(n, factor * v, np.float32) for c, v in zip(("GX", "GY", "GZ"), DEG_S, strict=True)
    }


def primary(core: int, n: int = 20) -> dict[str, Any]:
    return {"TimeUS": micros(n, 5.0), "PI": np.full(n, core, np.int8)}


@pytest.mark.parametrize("family", ["XK", "NK"])
def test_the_records_hold_degrees_per_second(family: str) -> None:
    stream = read({("IMU", 0): imu(), (f"{family}F1", 0): state()}).estimator.gyro_bias
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
        stream = read(two_cores(), {"EK3_IMU_MASK": 3.0}, **asked).estimator.gyro_bias
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
    stream = read(tables, {"EK2_IMU_MASK": 3.0}).estimator.gyro_bias
    assert stream is not None
    assert stream.source == "NKF6:1"


@pytest.mark.parametrize(("name", "ekf"), [("EKF1", 1.0), ("XKF1", 0.0)])
def test_an_unknown_unit_and_an_ekf_that_did_not_fly_give_none(name: str, ekf: float) -> None:
    assert read({("IMU", 0): imu(), (name, 0): state()}, {"AHRS_EKF_TYPE": ekf}).estimator.gyro_bias is None


def test_the_accelerometer_bias_is_that_of_the_primary_core() -> None:
    def learned(x: float) -> dict[str, Any]:
        return {"TimeUS": micros(20, 5.0), **{a: np.full(20, x, np.float32) for a in ("AX", "AY", "AZ")}}

    stream = read(two_cores() | {("XKF2", 0): learned(0.1), ("XKF2", 1): learned(-0.3)}).estimator.acc_bias
    assert stream is not None
    np.testing.assert_allclose(stream.x[0], -0.3, rtol=1e-6)


def test_test_ratios_of_the_second_core_of_old_logs_are_read_under_its_own_name() -> None:
    ratios = {"TimeUS": micros(20, 5.0), "SM": np.linspace(0.1, 0.4, 20), "SV": np.linspace(0.3, 0.9, 20)}
    for core, name in ((1, "NKF9"), (0, "NKF4:0")):
        tables = {("IMU", 0): imu(), ("IMU2", 0): imu(), ("NKF1", 0): state(), ("NKF6", 0): state(2.0)}
        first = primary(core) | {k: 2.0 * v for k, v in ratios.items() if k != "TimeUS"}
        log = read(tables | {("NKF4", 0): first, ("NKF9", 0): ratios}, {"EK2_IMU_MASK": 3.0})
        found = {test.aid: test for test in log.estimator.innovation_tests}
        assert {aid: test.source for aid, test in found.items()} == {"compass": f"{name}.SM", "velocity": f"{name}.SV"}
        np.testing.assert_allclose(found["compass"].ratio, (1.0 if core else 2.0) * ratios["SM"])


# The heading that ArduPilot finds from GNSS motion: units of each era, whose core, and when it is valid.

YAW = np.array([0.2, -0.1, 0.1, 0.3, 0.5])
SIGMA = np.array([2.0 * np.pi / np.sqrt(10.0), 0.3, 0.2, 0.1, 0.05])
"""Radians; the first is what the estimator starts with."""


def estimated(yaw: Any = YAW, sigma: Any = SIGMA) -> dict[str, Any]:
    return {"TimeUS": micros(5, 1.0, 11_000_000), "YC": np.float32(yaw), "YCS": np.float32(sigma)}


def degrees(root: bool) -> dict[str, Any]:
    """As since 4.3: heading 0 to 360 deg; ``root``: with the square root of the variance's degrees."""
    return estimated(np.degrees(YAW) % 360.0, np.sqrt(np.degrees(SIGMA**2)) if root else np.degrees(SIGMA))


@pytest.mark.parametrize("family", ["XK", "NK"])
@pytest.mark.parametrize("table", [estimated(), degrees(root=True), degrees(root=False)])
def test_in_all_eras_it_is_valid_where_one_sigma_is_below_15_deg(family: str, table: dict[str, Any]) -> None:
    stream = read({("IMU", 0): imu(), (f"{family}Y0", 0): table}).estimator.yaw
    assert stream is not None
    np.testing.assert_allclose(rotation.wrap(stream.x[:, 0]), [0.1, 0.3, 0.5], atol=1e-5)
    np.testing.assert_allclose(stream.x[:, 1], [0.2, 0.1, 0.05], rtol=1e-5)
    np.testing.assert_allclose(stream.t, [3, 4, 5])
    assert (stream.unit, stream.frame, stream.source) == ("rad", "NED", f"{family}Y0:0")


def test_a_north_heading_in_degrees_is_known_by_its_unit() -> None:
    tables = {("IMU", 0): imu(), ("XKY0", 0): estimated(np.full(5, 3.0), np.sqrt(np.degrees(SIGMA**2)))}
    opened = messages("dataflash", tables, (), (BANNER,))
    fields = opened["XKY0", 0].fields
    fields["YC"] = fields["YC"]._replace(unit="degheading")
    stream = reader.read(opened).estimator.yaw
    assert stream is not None
    np.testing.assert_allclose(np.degrees(stream.x[:, 0]), 3.0, rtol=1e-5)


def test_it_is_that_of_the_primary_core_else_of_the_first_that_has_one() -> None:
    primary = {"TimeUS": micros(20, 5.0), "PI": np.ones(20, np.int8)}
    tables = {("IMU", 0): imu(), ("XKF4", 0): primary, ("XKY0", 0): estimated(), ("NKY0", 0): estimated()}
    for more, source in (({("XKY0", 1): estimated()}, "XKY0:1"), ({}, "XKY0:0")):
        stream = read(tables | more).estimator.yaw
        assert stream is not None
        assert stream.source == source


def test_in_a_simulated_flight_its_start_is_near_the_true_heading() -> None:
    """Clockwise from true north in radians; later this flight's gyro bias turns it away at 1 deg/s."""
    log = flight.read(SAMPLES / "copter_steps_stabilize.bin")
    assert log.estimator.yaw is not None
    assert log.truth is not None
    t = log.estimator.yaw.t_best[:20]
    q = rotation.slerp(log.truth.t, log.truth.q, t)
    off = np.degrees(rotation.wrap(log.estimator.yaw.x[:20, 0] - rotation.to_euler(q)[:, 2]))
    assert np.nanmedian(np.abs(off)) < 6.0
