"""One stroke of constant rate: its onset, half, 90 % and size are known to a sample."""

from __future__ import annotations

import itertools
from types import SimpleNamespace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from attlog.core import rotation
from attlog.metrics import step_turning
from attlog.metrics.step_turning import (
    StepEvent,
    SummedTurning,
    Timing,
    about_axes,
    around,
    stack_events,
    summed_turning,
)
from attlog.reference.model import Scoring
from tests.metrics.flights import motion, sampled


def find(track):
    return step_turning.find_steps(track.t, track.q, track.segment)


@pytest.mark.parametrize("hz", [10.0, 25.0, 250.0])
def test_each_commanded_movement_is_one_event_at_any_reference_rate(hz):
    t, q = motion("yaw", 40.0)
    events = find(sampled(t, q, hz))
    assert len(events) == len(np.arange(3.0, 37.0, 3.0))
    assert {e.axis for e in events} == {2}
    np.testing.assert_allclose(np.diff([e.onset for e in events]), 3.0, atol=0.15)


def test_events_count_from_the_scoring_start_and_only_those_that_end_before_the_end():
    t, q = motion("yaw", 40.0)
    track = sampled(t, q, 50.0)
    whole = find(track)
    begin, end = whole[1].begin + 0.1, whole[-2].end - 0.1
    reference = SimpleNamespace(t=track.t, q=track.q, segment=track.segment, scoring=Scoring(begin, end))
    assert step_turning.scored_steps(reference) == whole[2:-2]


def test_windows_of_neighbouring_events_do_not_overlap():
    t, q = motion("steps", 60.0)
    events = find(sampled(t, q, 100.0))
    for axis in (0, 1):
        own = [e for e in events if e.axis == axis]
        assert all(a.end <= b.begin for a, b in itertools.pairwise(own))
        assert all(e.begin < e.onset < e.middle <= e.t90 < e.end for e in own)


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
    return step_turning._of_axis(T, turned(*strokes), axis)


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
    assert len(step_turning.find_steps(T, q, zeros)) == 1
    assert step_turning.find_steps(T, q, (T > 5.2).astype(np.int64)) == []
    assert len(step_turning.find_steps(T, q, (T > 4.4).astype(np.int64))) == 1
    around = np.where((T > 4.4) & (T < 6.72), 1, np.where(T < 5.0, 0, 2))
    assert len(step_turning.find_steps(T, q, around)) == 1


@pytest.mark.parametrize("axis", [0, 1, 2])
def test_a_turn_about_one_body_axis_is_a_step_of_this_axis_alone(axis: int) -> None:
    """Whatever the heading and the tilt: the axes are those of the body."""
    start = rotation.from_euler(0.2, -0.4, 2.0)
    angle = np.radians(np.concatenate([[0.0], np.cumsum(turned((5.0, 0.5, 60.0)))]))
    q = rotation.multiply(np.tile(start, (len(T), 1)), rotation.from_rotvec(angle[:, None] * np.eye(3)[axis]))
    (event,) = step_turning.find_steps(T, q, np.zeros(len(T), np.int64))
    assert (event.axis, event.delta_deg) == (axis, pytest.approx(30.0, abs=1.3))


# The samples of a track around each movement.

TURNING_T = np.arange(0.0, 20.0, 0.01)


def track(segment: np.ndarray | None = None) -> SummedTurning:
    return SummedTurning(
        TURNING_T,
        np.tile([1.0, 0.0, 0.0, 0.0], (len(TURNING_T), 1)),
        np.zeros(len(TURNING_T), np.int64) if segment is None else segment,
    )


def event(onset: float) -> StepEvent:
    return StepEvent(0, onset, onset + 0.2, onset + 0.3, 20.0, onset - 0.5, onset + 1.5)


@pytest.mark.parametrize("margin", [0.0, 0.25])
def test_the_samples_of_the_window_and_of_the_margin_on_both_sides_are_taken(margin: float) -> None:
    (part,) = around(track(), [event(8.005)], margin)
    assert part is not None
    inside = (TURNING_T >= 8.005 - 0.5 - margin) & (TURNING_T < 8.005 + 1.5 + margin)
    np.testing.assert_array_equal(np.flatnonzero(inside), np.arange(part.start, part.stop))


@pytest.mark.parametrize(("cut", "reaches"), [(7.85, True), (7.95, False), (8.55, False), (8.65, True)])
def test_a_movement_needs_a_tenth_of_a_second_before_and_three_after_in_one_segment(cut: float, reaches: bool) -> None:
    found = around(track((cut <= TURNING_T).astype(np.int64)), [event(8.005)], 0.25)
    assert (found[0] is not None) is reaches


def attitudes(step_rad, n=400):
    """Attitudes that turn by about so much from one to the next, with signs at random; the turns (n - 1, 3)."""
    rng = np.random.default_rng(5)
    turn = Rotation.from_rotvec(step_rad * rng.uniform(-1, 1, (n - 1, 3)))
    q = [Rotation.random(rng=rng)]
    for one in turn:
        q.append(q[-1] * one)
    xyzw = (
        np.array([r.as_quat() for r in q])
        * rng.choice([-1.0, 1.0], (n, 1))
        * (1.0 + 1e-7 * rng.standard_normal((n, 1)))
    )
    return np.ascontiguousarray(np.roll(xyzw, 1, axis=1)), turn.as_rotvec()


@pytest.mark.parametrize("step_rad", [1e-13, 1e-4, 0.03, 0.2, 1.5])
@pytest.mark.parametrize("loop", [summed_turning.function, summed_turning])
def test_turning_is_the_sum_of_rotation_vectors_also_of_quaternions_that_are_not_quite_of_unit_length(step_rad, loop):
    q, turn = attitudes(step_rad)
    found = np.empty((len(q), 3))
    loop(found, q)
    wanted = np.degrees(np.cumsum(turn, axis=0))
    np.testing.assert_array_equal(found[0], 0.0)
    np.testing.assert_allclose(found[1:], wanted, atol=1e-12 + 2e-7 * np.degrees(step_rad) * 400)


def test_turning_about_axes_begins_with_each_event():
    q, _ = attitudes(0.05)
    t = 0.01 * np.arange(len(q))
    track = SummedTurning(t, q, np.zeros(len(t), np.int64), Timing.of(t))
    parts, axes = [slice(10, 60), slice(40, 90)], np.array([[1.0, 0.0, 0.0], [0.0, 0.6, 0.8]])
    stack = stack_events(parts)
    out, at = np.empty((100, 4)), np.empty(100)
    first = np.append(stack.first, 100)
    begin = stack.index[stack.first]
    about_axes(out, at, axes, np.array([0.0, 64.0]), begin, first, track.t, track.turned, 1)
    for own, part, axis, start in zip((slice(0, 50), slice(50, 100)), parts, axes, (0.0, 64.0), strict=True):
        since = track.turned[part] - track.turned[part.start]
        np.testing.assert_allclose(out[own, 0], since @ axis, atol=1e-12)
        np.testing.assert_allclose(out[own, 1:], np.cross(since, axis), atol=1e-12)
        np.testing.assert_array_equal(at[own], t[part] + start)
