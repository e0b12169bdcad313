"""One stroke of constant rate: its onset, half, 90 % and size are known to a sample."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from attlog.base import rotation
from attlog.metrics.steps import events as steps
from attlog.metrics.steps.events import StepEvent

STEP = 0.01
T = STEP * np.arange(1200)


def turned(*strokes: tuple[float, float, float]) -> np.ndarray:
    """The turn (n - 1,) in deg of each interval: strokes (begin, length in s, rate in deg/s)."""
    middle = T[:-1] + 0.5 * STEP
    rate = np.zeros(len(middle))
    for begin, length, dps in strokes:
        rate[(middle > begin) & (middle < begin + length)] = dps
    return STEP * rate


def found(*strokes: tuple[float, float, float], axis: int = 0) -> list[StepEvent]:
    return steps._of_axis(T, turned(*strokes), axis)


@pytest.mark.parametrize(("axis", "dps"), [(0, 40.0), (1, -40.0), (2, 60.0)])
def test_a_stroke_has_its_onset_half_and_ninety_percent_where_the_angle_has_them(axis: int, dps: float) -> None:
    (event,) = found((5.0, 0.5, dps), axis=axis)
    assert event.axis == axis
    assert event.onset == pytest.approx(5.0, abs=0.02)
    assert event.middle == pytest.approx(5.25, abs=0.011)
    assert event.t90 == pytest.approx(5.45, abs=0.011)
    assert event.delta_deg == pytest.approx(0.5 * dps, abs=0.02 * abs(dps))
    assert (event.begin, event.end) == (pytest.approx(event.onset - 0.5), pytest.approx(event.t90 + 1.0))


@pytest.mark.parametrize(("axis", "least"), [(0, 5.0), (1, 5.0), (2, 10.0)])
def test_a_stroke_of_each_axis_has_a_least_size(axis: int, least: float) -> None:
    assert len(found((5.0, 0.25, 4.4 * least), axis=axis)) == 1  # 1.1 times as much
    assert found((5.0, 0.25, 3.6 * least), axis=axis) == []


def test_what_turns_further_than_a_second_counts_for_its_first_second() -> None:
    (event,) = found((5.0, 2.0, 30.0))
    assert event.delta_deg == pytest.approx(30.0, abs=1.0)
    assert event.middle == pytest.approx(5.5, abs=0.03)


def test_the_largest_excursion_counts_and_not_the_last() -> None:
    (event,) = found((5.0, 0.3, 60.0), (5.4, 0.4, -50.0))
    assert event.delta_deg == pytest.approx(18.0, abs=1.3)
    assert event.t90 < 5.31


@pytest.mark.parametrize(("pause", "events"), [(0.24, 0), (0.36, 1)])
def test_three_tenths_of_a_second_before_an_onset_are_quiet(pause: float, events: int) -> None:
    """A third of the peak rate, a step of its own three seconds earlier, ends that long before the stroke."""
    many = found((2.0, 3.0 - pause, 20.0), (5.0, 0.5, 60.0))
    assert sum(abs(e.onset - 5.0) < 0.03 for e in many) == events


def test_a_rate_below_fifteen_percent_of_the_peak_is_quiet() -> None:
    for dps, quiet in ((7.0, True), (11.0, False)):
        many = found((3.0, 2.0, dps), (5.0, 0.5, 60.0))
        assert any(abs(e.onset - 5.0) < 0.03 for e in many) is quiet


@pytest.mark.parametrize(("pause", "events"), [(0.63, 1), (0.78, 2)])
def test_what_follows_within_seven_tenths_of_the_ninety_percent_belongs_to_the_same_step(
    pause: float, events: int
) -> None:
    many = found((5.0, 0.2, 80.0), (5.18 + pause, 0.2, -80.0))
    assert len(many) == events


def test_half_a_second_before_and_more_than_a_second_behind_belong_to_the_record() -> None:
    assert len(found((0.55, 0.2, 80.0))) == 1
    assert found((0.45, 0.2, 80.0)) == []
    end = T[-1]
    assert len(found((end - 1.43, 0.2, 80.0))) == 1  # 90 % come 0.18 s later
    assert found((end - 1.33, 0.2, 80.0)) == []


def test_no_step_crosses_a_segment_and_a_segment_needs_time_for_one() -> None:
    roll = np.radians(np.concatenate([[0.0], np.cumsum(turned((5.0, 0.5, 40.0)))]))
    q = rotation.from_euler(roll, 0.0 * T, 0.0 * T)
    zeros = np.zeros(len(T), np.int64)
    assert len(steps.find(T, q, zeros)) == 1
    assert steps.find(T, q, (T > 5.2).astype(np.int64)) == []
    assert len(steps.find(T, q, (T > 4.4).astype(np.int64))) == 1
    around = np.where((T > 4.4) & (T < 6.72), 1, np.where(T < 5.0, 0, 2))
    assert len(steps.find(T, q, around)) == 1


@pytest.mark.parametrize("axis", [0, 1, 2])
def test_a_turn_about_one_body_axis_is_a_step_of_this_axis_alone(axis: int) -> None:
    """Whatever the heading and the tilt: the axes are those of the body."""
    start = rotation.from_euler(0.2, -0.4, 2.0)
    angle = np.radians(np.concatenate([[0.0], np.cumsum(turned((5.0, 0.5, 60.0)))]))
    q = rotation.multiply(np.tile(start, (len(T), 1)), rotation.from_rotvec(angle[:, None] * np.eye(3)[axis]))
    (event,) = steps.find(T, q, np.zeros(len(T), np.int64))
    assert (event.axis, event.delta_deg) == (axis, pytest.approx(30.0, abs=1.3))


def test_steps_of_all_axes_come_in_the_order_of_time() -> None:
    def angle(*strokes: tuple[float, float, float]) -> Any:
        return np.radians(np.concatenate([[0.0], np.cumsum(turned(*strokes))]))

    q = rotation.from_euler(angle((6.0, 0.3, 60.0)), 0.0 * T, angle((3.0, 0.3, 60.0)))
    assert [e.axis for e in steps.find(T, q, np.zeros(len(T), np.int64))] == [2, 0]


def test_windows_of_neighbours_meet_half_way_between_one_and_the_next() -> None:
    events = [StepEvent(0, t, t + 0.1, t + 0.2, 20.0, t - 0.5, t + 1.2) for t in (2.0, 3.0, 9.0)]
    cut = steps._cut_to_neighbours(events)
    assert [(e.begin, e.end) for e in cut] == [(1.5, pytest.approx(2.6)), (pytest.approx(2.6), 4.2), (8.5, 10.2)]


@pytest.mark.parametrize("count", [1, 2, 3, 7, 50])
def test_the_largest_ahead_is_that_of_each_window(count: int) -> None:
    x = np.random.default_rng(count).normal(size=40)
    np.testing.assert_array_equal(steps._largest_ahead(x, count), [x[i : i + count].max() for i in range(40)])
