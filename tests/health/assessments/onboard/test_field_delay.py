"""A late compass is found against an attitude, and offered only where a parameter is off by both limits."""

from __future__ import annotations

import numpy as np
import pytest

from attlog.base import rotation
from attlog.flight.model import Mag, Stream
from attlog.health.assessments import Assessment
from attlog.health.assessments.onboard import field_delay
from attlog.health.model import Check
from attlog.reference import declination
from tests.health.assessments.onboard.made import EARTH_UT, SECONDS, attitude, case, flight


@pytest.fixture(autouse=True)
def known_field(monkeypatch: pytest.MonkeyPatch) -> None:
    """The earth's field is that of the made flight."""

    class Known:
        ned_t = tuple(1e-6 * EARTH_UT)

    monkeypatch.setattr(declination, "model", lambda log: Known())


def told(late_s: float, firmware: str = "PX4", noise_ut: float = 0.3, **params: float) -> Assessment:
    log = flight(firmware=firmware, params=params)
    t = np.arange(0.0, SECONDS, 0.1)
    field = rotation.rotate_inverse(attitude(t - late_s), np.tile(EARTH_UT, (len(t), 1)))
    field += np.random.default_rng(2).normal(0.0, noise_ut, field.shape)
    log.mags, log.mag = [Mag(0, Stream(t, 1e-6 * field, "T", "FRD", "MAG:0"))], 0
    (one,) = field_delay.assessments(case(log))
    return one


def test_a_compass_on_time_is_ok() -> None:
    one = told(0.0, EKF2_MAG_DELAY=0.0)
    assert (one.verdict, one.settings) == ("ok", [])
    assert one.value == pytest.approx(0.0, abs=6.0)


def test_a_late_one_is_offered_its_delay() -> None:
    one = told(0.06, EKF2_MAG_DELAY=0.0)
    (setting,) = one.settings
    assert (one.verdict, setting.name, setting.old, setting.new) == ("warning", "EKF2_MAG_DELAY", 0.0, 60.0)


def test_15_ms_are_not_offered() -> None:
    assert told(0.015, EKF2_MAG_DELAY=0.0).settings == []


@pytest.mark.parametrize(("late_s", "verdict"), [(0.0, "ok"), (0.05, "ok"), (0.12, "warning")])
def test_where_no_parameter_sets_it_words_say_so(late_s: float, verdict: str) -> None:
    one = told(late_s, "ArduPilot")
    assert (one.verdict, one.settings) == (verdict, [])
    assert "the EKF takes 60 ms" in one.text


def test_a_disturbed_field_tells_nothing() -> None:
    assert told(0.06, noise_ut=30.0, EKF2_MAG_DELAY=0.0).verdict == "unknown"


def test_the_delay_of_the_imu_is_the_audits() -> None:
    asked = case(flight())
    assert field_delay.of_imu(asked) == []
    asked.checks = [Check("imu delay", "fault", "IMU comes 25 ms later.", 25.0, "ms")]
    (one,) = field_delay.of_imu(asked)
    assert (one.verdict, one.value, one.settings) == ("fault", 25.0, [])
    assert one.why_no_setting
