"""Which angle of the onboard attitude the checks prove wrong."""

from __future__ import annotations

import pytest

import attlog
from attlog.health.model import Check
from attlog.health.onboard.proven_wrong import wrong_angle
from attlog.story import WrongAngle

GNSS = Check("heading by GNSS", "fault", "", 26.5, "deg", t=11.0, t_end=102.0)
SMOOTHER = Check("onboard against smoother", "fault", "", 7.2, "deg", t=30.0, t_end=40.0, about="tilt")


def test_gnss_acceleration_which_assumes_least_is_taken_before_the_smoother():
    assert wrong_angle([SMOOTHER, GNSS]) == WrongAngle("heading", 26.5, 11.0, 102.0)
    assert wrong_angle([SMOOTHER]) == WrongAngle("tilt", 7.2, 30.0, 40.0)


def test_a_warning_or_a_check_of_something_else_proves_nothing():
    warning = Check("heading by GNSS", "warning", "", 10.0, "deg", t=11.0)
    assert wrong_angle([warning, Check("field", "fault", "", 80.0, "uT", t=1.0)]) is None


@pytest.mark.slow
def test_the_headline_and_the_finding_give_the_same_degrees(corpus):
    result = attlog.analyze(corpus / "logs" / "cases" / "copter_heading_28deg_off.BIN", {"estimators": ["gyro"]})
    size = next(check.value for check in result.audit if check.name == "heading by GNSS")
    assert f"Heading was {size:.0f}° wrong throughout" in result.headline
    assert f"{size:.0f}" in result.findings[0].text
