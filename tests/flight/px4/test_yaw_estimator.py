"""The heading that PX4 finds from GNSS motion: in which eras, and when it is valid."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from attlog import flight
from attlog.base import rotation
from tests.conftest import SAMPLES
from tests.flight.fake import micros
from tests.flight.px4.test_px4 import combined, read

TOPIC = "yaw_estimator_status"
VARIANCE = np.array([1.0, 0.09, 0.01, 0.0025, 0.0004], np.float32)


def estimated(**more: Any) -> dict[str, Any]:
    """Five records of an estimator that becomes surer each second."""
    yaw = np.linspace(0.1, 0.5, 5).astype(np.float32)
    return {"timestamp": micros(5, 1.0, 11_000_000), "yaw_composite": yaw, "yaw_variance": VARIANCE} | more


def test_before_it_had_a_flag_it_is_valid_where_one_sigma_is_below_15_deg() -> None:
    stream = read({("sensor_combined", 0): combined(), (TOPIC, 0): estimated()}).yaw_estimator
    assert stream is not None
    np.testing.assert_allclose(stream.x[:, 0], [0.3, 0.4, 0.5], rtol=1e-6)
    np.testing.assert_allclose(stream.x[:, 1], [0.1, 0.05, 0.02], rtol=1e-6)
    np.testing.assert_allclose(stream.t, [3, 4, 5])
    assert stream.unit == "rad"


def test_a_flag_leaves_out_what_the_estimator_itself_calls_invalid() -> None:
    topic = estimated(yaw_composite_valid=np.array([0, 0, 0, 1, 1], np.uint8))
    stream = read({("sensor_combined", 0): combined(), (TOPIC, 0): topic}).yaw_estimator
    assert stream is not None
    np.testing.assert_allclose(stream.x[:, 0], [0.4, 0.5], rtol=1e-6)


@pytest.mark.parametrize("selected", [0, 1])
def test_of_two_estimators_it_is_the_selected_ones(selected: int) -> None:
    chosen = {"timestamp": micros(5, 1.0, 11_000_000), "primary_instance": np.full(5, selected, np.uint8)}
    tables = {("sensor_combined", 0): combined(), ("estimator_selector_status", 0): chosen, (TOPIC, 0): estimated()}
    stream = read(tables | {(TOPIC, 1): estimated(yaw_composite=np.full(5, 1.5, np.float32))}).yaw_estimator
    assert stream is not None
    assert stream.source == f"{TOPIC}:{selected}"
    np.testing.assert_allclose(stream.x[:, 0], [[0.3, 0.4, 0.5], [1.5, 1.5, 1.5]][selected], rtol=1e-6)


@pytest.mark.parametrize("without", ["yaw_composite", "yaw_variance"])
def test_without_yaw_or_variance_there_is_none(without: str) -> None:
    topic = {name: x for name, x in estimated().items() if name != without}
    assert read({("sensor_combined", 0): combined(), (TOPIC, 0): topic}).yaw_estimator is None


def test_in_a_simulated_flight_it_is_near_the_true_heading() -> None:
    """Clockwise from true north, in radians: its own sigma there is 2 deg."""
    log = flight.read(SAMPLES / "px4_steps.ulg")
    assert log.yaw_estimator is not None
    assert log.truth is not None
    q = rotation.slerp(log.truth.t, log.truth.q, log.yaw_estimator.t_best)
    off = np.degrees(rotation.wrap(log.yaw_estimator.x[:, 0] - rotation.to_euler(q)[:, 2]))
    assert np.nanmedian(np.abs(off)) < 6.0
