"""Lanes with planted errors: the better one is named where the one in use is clearly worse."""

from __future__ import annotations

import numpy as np
import pytest

from attlog.base import rotation
from attlog.flight.model import Attitude, TimeLine
from attlog.health.assessments import Assessment, HealthCase
from attlog.health.assessments.onboard import lanes
from attlog.reference.model import Reference
from tests.health.assessments.onboard.made import SECONDS, attitude, case, flight


def lane(t: np.ndarray, tilt_deg: float) -> Attitude:
    lean = rotation.from_euler(np.full(len(t), np.radians(tilt_deg)), np.zeros(len(t)), np.zeros(len(t)))
    return Attitude(t, rotation.multiply(attitude(t), lean), "XKQ")


def flew(*tilts_deg: float, used: int = 0, judged: bool = True) -> HealthCase:
    log = flight(firmware="ArduPilot")
    t = np.arange(0.0, SECONDS, 0.1)
    log.attitudes = {f"XKQ.{k}": lane(t, deg) for k, deg in enumerate(tilts_deg)}
    log.lane = TimeLine(np.array([0.0, 60.0]), [used, 1 - used], "XKF4.PI")
    asked = case(log)
    whole = np.zeros(len(t), np.int64)
    asked.reference = Reference("truth" if judged else "onboard", "SIM", t, attitude(t), whole, whole)
    return asked


def told(asked: HealthCase) -> Assessment:
    (one,) = lanes.assessments(asked)
    return one


def test_a_worse_lane_in_use_is_named_with_both_errors() -> None:
    one = told(flew(8.0, 1.0))
    assert one.verdict == "warning"
    assert one.value == pytest.approx(8.0, abs=0.1)
    assert "Lane 0 flew 8.0 deg off" in one.text
    assert "lane 1 errs by 1.0 deg" in one.text
    assert "changed once in flight, at 60.0 s" in one.evidence[-1]


@pytest.mark.parametrize("tilts", [(1.0, 8.0), (8.0, 7.0), (2.0, 0.1)])
def test_a_lane_in_use_that_is_better_or_no_worse_or_small_is_ok(tilts: tuple[float, float]) -> None:
    assert told(flew(*tilts)).verdict == "ok"


def test_the_lane_that_flew_longest_is_the_one_in_use() -> None:
    one = told(flew(1.0, 8.0, used=1))
    assert one.verdict == "warning"
    assert "Lane 1 flew 8.0 deg off" in one.text


def test_without_truth_or_smoother_nobody_judges_but_the_difference_is_told() -> None:
    one = told(flew(8.0, 1.0, judged=False))
    assert one.verdict == "unknown"
    assert "7.0 deg" in one.text


def test_one_lane_is_no_question() -> None:
    assert lanes.assessments(flew(8.0)) == []
