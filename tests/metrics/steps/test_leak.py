import pytest

from attlog.metrics.steps import leak
from tests.conftest import few
from tests.metrics.motions import motion, sampled
from tests.metrics.steps.test_fits import thrust_flight
from tests.metrics.steps.test_lag import step_case


@pytest.mark.parametrize("kp", few([0.0, 0.6, 2.0], 2))
def test_the_leak_of_a_filter_aided_by_direction_is_its_gain(kp):
    case, row = thrust_flight(kp)
    told = leak.compute(case, row, "all")["leak_per_s"]
    assert told.value == pytest.approx(kp, abs=0.01)
    assert told.ci95[0] <= kp + 0.01
    assert told.ci95[1] >= kp - 0.01
    assert not told.ranked


def test_yaw_turns_alone_tell_no_leak():
    t, q = motion("yaw", 40.0)
    case, row = step_case(sampled(t, q, 200.0), sampled(t, q, 25.0))
    told = leak.compute(case, row, "all")["leak_per_s"]
    assert told.code == "too_few_events"
    assert told.reason.startswith("0 ")


def test_without_an_accelerometer_there_is_no_leak():
    t, q = motion("steps", 40.0)
    case, row = step_case(sampled(t, q, 200.0), sampled(t, q, 25.0))
    assert leak.compute(case, row, "all")["leak_per_s"].code == "not_covered"


def test_a_wide_interval_is_no_answer(monkeypatch):
    case, row = thrust_flight(0.6)
    monkeypatch.setattr(leak, "LARGEST_HALF_PER_S", 1e-9)
    monkeypatch.setattr(leak, "LARGEST_HALF", 1e-9)
    told = leak.compute(case, row, "all")["leak_per_s"]
    assert told.value is None
    assert told.detail["fitted"] == pytest.approx(0.6, abs=0.01)


@pytest.mark.parametrize(("kp", "least"), [(0.0, 0.004), (2.0, 0.04)])
def test_scale_of_the_logged_gyro_stays_in_the_interval_of_a_leak(kp, least):
    case, row = thrust_flight(kp)
    told = leak.compute(case, row, "all")["leak_per_s"]
    assert 0.5 * (told.ci95[1] - told.ci95[0]) >= 0.99 * least


def test_a_leak_without_interval_is_not_told_as_infinity(monkeypatch):
    case, row = thrust_flight(0.6)
    monkeypatch.setattr(leak.math, "hypot", lambda *x: float("inf"))
    told = leak.compute(case, row, "all")["leak_per_s"]
    assert "inf" not in told.reason
    assert "without interval" in told.reason
