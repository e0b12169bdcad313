"""The heading that ArduPilot finds from GNSS motion: units of each era, whose core, and when it is valid."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from attlog import flight
from attlog.base import rotation
from attlog.flight.ardupilot import reader
from tests.conftest import SAMPLES
from tests.flight.ardupilot.test_ardupilot import BANNER, imu, read
from tests.flight.fake import messages, micros

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
    stream = read({("IMU", 0): imu(), (f"{family}Y0", 0): table}).yaw_estimator
    assert stream is not None
    np.testing.assert_allclose(rotation.wrap(stream.x[:, 0]), [0.1, 0.3, 0.5], atol=1e-5)
    np.testing.assert_allclose(stream.x[:, 1], [0.2, 0.1, 0.05], rtol=1e-5)
    np.testing.assert_allclose(stream.t, [3, 4, 5])
    assert (stream.unit, stream.frame, stream.source) == ("rad", "NED", f"{family}Y0:0")


def test_a_north_heading_in_degrees_is_known_by_its_unit() -> None:
    tables = {("IMU", 0): imu(), ("XKY0", 0): estimated(np.full(5, 3.0), np.sqrt(np.degrees(SIGMA**2)))}
    opened = messages("dataflash", tables, (), (BANNER,))
    fields = opened["XKY0", 0].fields
    fields["YC"] = replace(fields["YC"], unit="degheading")
    stream = reader.read(opened).yaw_estimator
    assert stream is not None
    np.testing.assert_allclose(np.degrees(stream.x[:, 0]), 3.0, rtol=1e-5)


def test_it_is_that_of_the_primary_core_else_of_the_first_that_has_one() -> None:
    primary = {"TimeUS": micros(20, 5.0), "PI": np.ones(20, np.int8)}
    tables = {("IMU", 0): imu(), ("XKF4", 0): primary, ("XKY0", 0): estimated(), ("NKY0", 0): estimated()}
    for more, source in (({("XKY0", 1): estimated()}, "XKY0:1"), ({}, "XKY0:0")):
        stream = read(tables | more).yaw_estimator
        assert stream is not None
        assert stream.source == source


@pytest.mark.parametrize("without", ["YC", "YCS"])
def test_without_heading_or_sigma_there_is_none(without: str) -> None:
    table = {name: x for name, x in estimated().items() if name != without}
    assert read({("IMU", 0): imu(), ("XKY0", 0): table}).yaw_estimator is None


def test_an_estimator_that_is_never_sure_tells_nothing() -> None:
    assert read({("IMU", 0): imu(), ("XKY0", 0): estimated(YAW, np.full(5, 0.27))}).yaw_estimator is None


def test_in_a_simulated_flight_its_start_is_near_the_true_heading() -> None:
    """Clockwise from true north in radians; later this flight's gyro bias turns it away at 1 deg/s."""
    log = flight.read(SAMPLES / "copter_steps_stabilize.bin")
    assert log.yaw_estimator is not None
    assert log.truth is not None
    t = log.yaw_estimator.t_best[:20]
    q = rotation.slerp(log.truth.t, log.truth.q, t)
    off = np.degrees(rotation.wrap(log.yaw_estimator.x[:20, 0] - rotation.to_euler(q)[:, 2]))
    assert np.nanmedian(np.abs(off)) < 6.0
