"""Bias against temperature: planted slopes, and what is too little to tell one."""

from __future__ import annotations

import numpy as np
import pytest

from attlog.flight.model import FlightLog, Stream
from attlog.health import temperature
from attlog.segments import Segment, Segments
from tests.segments.flights import imu_log

REST = Segments([Segment("rest.long", 0.0, 600.0)])


def warming(dps_per_k: float, m_s2_per_k: float, kelvin: float, seed: int = 1) -> FlightLog:
    """Ten minutes standing still while it warms up, faster at first; noise that lasts for seconds."""
    rng = np.random.default_rng(seed)
    t = np.arange(0.0, 600.0, 0.2)
    warmer = kelvin * (1.0 - np.exp(-t / 200.0)) / (1.0 - np.exp(-3.0))
    slow = 0.02 * rng.normal(size=(61, 3))[(t // 10.0).astype(int)]
    gyro = np.radians(np.outer(warmer, [0.0, dps_per_k, 0.0]) + slow + 0.05 * rng.normal(size=(len(t), 3)))
    acc = np.tile([0.0, 0.0, -9.81], (len(t), 1)) + 0.02 * rng.normal(size=(len(t), 3))
    acc[:, 2] -= m_s2_per_k * warmer
    log = imu_log(t, gyro, acc)
    log.imus[0].temperature = Stream(t, 25.0 + warmer[:, None], "degC", "", "IMU:0")
    return log


def of(log: FlightLog, segments: Segments = REST):
    from attlog.health.check import HealthCase

    one = HealthCase(log, segments)
    return temperature.gyro_temperature(one), temperature.accelerometer_temperature(one)


@pytest.mark.parametrize(("slope", "verdict"), [(0.0, "ok"), (0.03, "ok"), (-0.1, "warning"), (0.3, "fault")])
def test_a_planted_slope_of_the_gyro_lies_inside_its_interval(slope: float, verdict: str) -> None:
    missed = 0
    for seed in range(3):
        (found,), _ = of(warming(slope, 0.0, 20.0, seed))
        assert (found.verdict, found.unit) == (verdict, "deg/s/K")
        assert found.vector_ci95[1] < 0.01
        missed += abs(found.vector[1] - slope) > found.vector_ci95[1]
    assert missed <= 1


@pytest.mark.parametrize(("slope", "verdict"), [(0.0, "ok"), (0.03, "warning")])
def test_a_planted_slope_of_gravity_s_size(slope: float, verdict: str) -> None:
    _, (found,) = of(warming(0.0, slope, 20.0))
    assert found.verdict == verdict
    assert found.ci95 is not None
    assert found.ci95[0] <= slope <= found.ci95[1]
    assert bool(found.action) == (verdict != "ok")


def test_too_little_warming_no_rest_and_no_thermometer_are_unknown() -> None:
    cold, no_thermometer = warming(1.0, 0.0, 3.0), warming(1.0, 0.0, 20.0)
    no_thermometer.imus[0].temperature = None
    for log, segments in ((cold, REST), (no_thermometer, REST), (warming(1.0, 0.0, 20.0), Segments())):
        for found in of(log, segments):
            assert [a.verdict for a in found] == ["unknown"]
            assert found[0].action


def test_a_thermometer_without_numbers_does_no_harm() -> None:
    log = warming(0.1, 0.0, 20.0)
    assert log.imus[0].temperature is not None
    log.imus[0].temperature.x[:] = np.nan
    assert [a.verdict for found in of(log) for a in found] == ["unknown", "unknown"]
