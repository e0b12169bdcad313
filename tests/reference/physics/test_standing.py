"""Where the vehicle stands still, gravity says who is tilted, the judge or the accused."""

from __future__ import annotations

import numpy as np
import pytest

from attlog.base import rotation
from attlog.flight.model import Attitude
from attlog.reference import Reference
from attlog.reference.physics.standing import StillResiduals, refusal
from attlog.reference.physics.standing import residuals as residuals_of
from tests.reference.flights import attitude_at, flight


def residuals(judge: float, accused: float, sigma: float = 0.5, begin: float = 10.0) -> StillResiduals:
    """Ten still windows from ``begin`` s on with these residuals in deg."""
    start = begin + 0.5 * np.arange(10)
    each = np.ones(10)
    return StillResiduals(np.column_stack([start, start + 2.0]), judge * each, accused * each, sigma * each)


@pytest.mark.parametrize(
    ("judge", "accused", "acquitted"),
    [
        (8.4, 1.05, True),  # the judge is the wrong one
        (0.1, 2.4, True),  # an accelerometer bias explains it
        (0.1, 6.0, False),
        (7.0, 6.0, True),  # both are off, the judge by more
    ],
)
def test_nobody_is_accused_of_tilt_against_gravity(judge: float, accused: float, acquitted: bool) -> None:
    assert residuals(judge, accused).acquits((11.0, 15.0)) is acquitted


def test_windows_beside_a_span_count_where_none_lies_within() -> None:
    found = residuals(8.0, 1.0)
    assert found.acquits((17.0, 30.0))
    assert found.medians((17.0, 30.0)) == (8.0, 1.0)
    assert not found.acquits((25.0, 40.0))
    assert found.medians((25.0, 40.0)) is None


@pytest.mark.parametrize(
    ("judge", "accused", "sigma", "refused"),
    [
        (2.4, 0.8, 0.9, True),  # twice the other's
        (2.4, 1.5, 0.9, False),
        (4.0, 3.5, 0.2, True),  # above 3 sigmas with 1 deg of the accelerometer's own
        (4.0, 3.5, 1.2, False),
        (1.9, 0.1, 0.1, False),
        (4.0, np.nan, 0.2, True),
    ],
)
def test_gravity_refuses_a_judge_that_is_further_off_than_it_says(
    judge: float, accused: float, sigma: float, refused: bool
) -> None:
    assert bool(residuals(judge, accused, sigma).refusing()) is refused


def judge_over(seconds: float) -> Reference:
    """A smoother without gaps."""
    t = np.arange(0.0, seconds, 0.1)
    none = np.zeros(len(t), np.int64)
    return Reference("smoother", "made", t, attitude_at(t), none, none)


def test_a_judge_is_refused_throughout_where_little_else_is_known_of_it() -> None:
    """Off gravity from 10 to 16.5 s: a third of 20 s, but little of 100 s."""
    found = residuals(8.0, 1.0)
    why, refused = refusal(found, judge_over(20.0), "ATT")
    assert why == "standing still from 10 to 16 s it is 8.0 deg off gravity (sigma 0.5), ATT 1.0 deg"
    assert refused == [(0.0, pytest.approx(19.9))]
    assert refusal(found, judge_over(100.0), "ATT") == ("", [(10.0, 16.5)])


def test_the_trim_of_vehicle_and_judge_is_no_residual() -> None:
    """Both are attitudes of a vehicle in which the IMU sits tilted: ``q_imu (x) exp(-trim)``."""
    log, judge, vector = flight(), judge_over(60.0), np.radians([4.0, -3.0, 0.0])
    mount = rotation.from_rotvec(-vector)
    judge.q, judge.trim, log.trim = rotation.multiply(judge.q, mount), vector, vector
    onboard = Attitude(judge.t, judge.q, "ATT", has_trim=True)
    found = residuals_of(log, judge, onboard)
    assert found is not None
    assert found.judge == pytest.approx(0.0, abs=0.2)
    assert found.accused == pytest.approx(0.0, abs=0.2)
