"""Noise of given size on a climb comes back; more than the estimator expects is a warning."""

from __future__ import annotations

import numpy as np
import pytest

from attlog.flight.model import InnovationTest, Stream
from attlog.health import baro
from attlog.health.check import Check
from tests.health.made_flight import SECONDS, case, flight


def told(noise_m: float, repeat: int = 1, **params: float) -> Check:
    log = flight(firmware="ArduPilot", params=params)
    t = np.arange(0.0, SECONDS, 0.1)
    x = 3.0 * t + np.random.default_rng(4).normal(0.0, noise_m, len(t))
    x, t = np.repeat(x, repeat), np.sort(np.concatenate([t + 0.1 * k / repeat for k in range(repeat)]))
    log.baro = [Stream(t, x[:, None], "m", "", "BARO:0")]
    log.estimator.innovation_tests = [InnovationTest("height", t, np.full(len(t), 0.1), "XKF4:0.SH")]
    (one,) = baro.barometer_noise(case(log))
    return one


@pytest.mark.parametrize(("noise_m", "repeat"), [(0.1, 1), (0.5, 1), (0.5, 4)])
def test_the_noise_of_a_climb_is_found_inside_its_interval(noise_m: float, repeat: int) -> None:
    one = told(noise_m, repeat)
    assert one.value == pytest.approx(noise_m, rel=0.12)
    assert one.ci95 is not None
    assert one.ci95[0] < noise_m < one.ci95[1]
    assert one.verdict == "ok"


def test_the_limit_is_what_the_estimator_expects() -> None:
    expected = {"EK3_ALT_M_NSE": 2.0, "EK3_HGT_I_GATE": 500.0}
    assert told(1.5).verdict == "warning"
    assert told(1.5, **expected).verdict == "ok"
    assert told(3.0, **expected).verdict == "warning"


def test_a_barometer_without_values_is_no_question() -> None:
    log = flight()
    log.baro = [Stream(np.arange(100.0), np.full((100, 1), np.nan), "m", "", "BARO:0")]
    assert baro.barometer_noise(case(log)) == []
