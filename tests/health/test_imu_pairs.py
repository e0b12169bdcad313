"""Units against each other: the size with its sign, which one is off, and streams that are the same sensor."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from attlog.health.imu_pairs import difference, imu_differences
from tests.health.imu_cases import AIR_S, REST_S, case, log_of, phases, told, unit

NONE = (0.0, 0.0, 0.0)


@pytest.mark.parametrize("rates", [(100.0, 50.0), (100.0, 2.0), (25.0, 100.0)])
def test_the_difference_comes_back_with_its_sign_whichever_unit_is_faster(rates: tuple[float, float]) -> None:
    a, b = unit(0, rates[0], NONE, NONE), unit(1, rates[1], (0.3, -0.2, 0.6), (0.0, 1.4, 0.0))
    for spans in ([(0.0, 28.0)], [(31.0, 89.0)]):
        found = difference(a.acc, b.acc, spans)
        assert found is not None
        assert np.abs(found.middle - [0.3, -0.2, 0.6]).max() < max(1.96 * found.sigma(0.02).max(), 0.05)


def test_gravity_tells_which_accelerometer_is_off_and_rest_which_gyro() -> None:
    one = case(log_of(unit(0, 100.0, (0.0, 0.0, 0.7), NONE), unit(1, 50.0, NONE, (0.0, 1.4, 0.0))))
    force, rate = imu_differences(one)
    assert (force.verdict, force.sensor) == ("warning", "IMU:0")
    assert "IMU:0 is off" in force.text
    assert (rate.verdict, rate.sensor) == ("warning", "IMU:1")
    assert force.vector[2] == pytest.approx(-0.7, abs=0.03)
    assert rate.vector[1] == pytest.approx(1.4, abs=0.05)
    assert force.ci95 is not None
    assert force.ci95[0] < 0.7 < force.ci95[1]


def test_a_horizontal_difference_that_gravity_hardly_shows_the_smoother_attributes() -> None:
    log = log_of(unit(0, 100.0, NONE, NONE), unit(1, 50.0, (0.6, 0.0, 0.0), NONE))
    assert imu_differences(case(log, told((0.0, 0.0, 0.0))))[0].sensor == "IMU:1"
    undecided = imu_differences(case(log))[0]
    assert "shows which one is off" in undecided.text


def test_units_that_agree_are_ok_and_two_that_are_both_off_are_both_named() -> None:
    sound = imu_differences(case(log_of(unit(0, 100.0, NONE, NONE), unit(1, 50.0, NONE, NONE))))
    assert [a.verdict for a in sound] == ["ok", "ok"]
    both = imu_differences(case(log_of(unit(0, 100.0, (0.0, 0.0, 1.0), NONE), unit(1, 50.0, (0.0, 0.0, -0.8), NONE))))[
        0
    ]
    assert both.verdict == "fault"
    assert "Both are off" in both.text


def test_a_stream_that_repeats_another_one_is_no_second_unit() -> None:
    """PX4's selected unit after a switch: the same numbers twice."""
    a = unit(0, 100.0, NONE, NONE)
    assert difference(a.acc, replace(a.acc, t=a.acc.t[::10], x=a.acc.x[::10]), [(0.0, 28.0)]) is None


def test_units_that_differ_in_flight_only_are_parted_by_vibration_and_slow_ones_are_not_compared_there() -> None:
    fast, slow = (unit(1, rate, NONE, NONE) for rate in (50.0, 2.0))
    for one in (fast, slow):
        one.acc.x[(one.acc.t > REST_S) & (one.acc.t < AIR_S), 2] += 1.3
    shaken = imu_differences(case(log_of(unit(0, 100.0, NONE, NONE), fast)))[0]
    assert shaken.verdict == "warning"
    assert "vibration" in shaken.text
    assert shaken.value == pytest.approx(1.3, abs=0.05)
    folded = imu_differences(case(log_of(unit(0, 100.0, NONE, NONE), slow)))[0]
    assert (folded.verdict, folded.seconds < 60.0) == ("ok", True)


def test_one_unit_says_nothing_and_units_without_common_time_that_they_cannot_be_compared() -> None:
    assert imu_differences(case(log_of(unit(0, 100.0, NONE, NONE)))) == []
    late = unit(1, 50.0, NONE, NONE)
    late.acc.t, late.gyro.t = late.acc.t + 1e4, late.gyro.t + 1e4
    assert [a.verdict for a in imu_differences(case(log_of(unit(0, 100.0, NONE, NONE), late), segments=phases()))] == [
        "unknown"
    ]
