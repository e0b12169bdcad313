"""The samples of a track around each movement."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from attlog.kernels.loops import function_of
from attlog.metrics.steps.events import StepEvent
from attlog.metrics.steps.fit import turning
from attlog.metrics.steps.fit.turning import (
    ABOUT,
    SUMMED,
    SummedTurning,
    Timing,
    about_axes,
    around,
    stacked,
    summed_at_once,
    summed_turning,
)

T = np.arange(0.0, 20.0, 0.01)


def track(segment: np.ndarray | None = None) -> SummedTurning:
    return SummedTurning(
        T, np.tile([1.0, 0.0, 0.0, 0.0], (len(T), 1)), np.zeros(len(T), np.int64) if segment is None else segment
    )


def event(onset: float) -> StepEvent:
    return StepEvent(0, onset, onset + 0.2, onset + 0.3, 20.0, onset - 0.5, onset + 1.5)


@pytest.mark.parametrize("margin", [0.0, 0.25])
def test_the_samples_of_the_window_and_of_the_margin_on_both_sides_are_taken(margin: float) -> None:
    (part,) = around(track(), [event(8.005)], margin)
    assert part is not None
    inside = (T >= 8.005 - 0.5 - margin) & (T < 8.005 + 1.5 + margin)
    np.testing.assert_array_equal(np.flatnonzero(inside), np.arange(part.start, part.stop))


@pytest.mark.parametrize(("cut", "reaches"), [(7.85, True), (7.95, False), (8.55, False), (8.65, True)])
def test_a_movement_needs_a_tenth_of_a_second_before_and_three_after_in_one_segment(cut: float, reaches: bool) -> None:
    found = around(track((cut <= T).astype(np.int64)), [event(8.005)], 0.25)
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
@pytest.mark.parametrize("loop", [summed_turning, summed_at_once, function_of(SUMMED, summed_turning)])
def test_turning_is_the_sum_of_rotation_vectors_also_of_quaternions_that_are_not_quite_of_unit_length(step_rad, loop):
    q, turn = attitudes(step_rad)
    found = np.empty((len(q), 3))
    loop(found, q)
    wanted = np.degrees(np.cumsum(turn, axis=0))
    np.testing.assert_array_equal(found[0], 0.0)
    np.testing.assert_allclose(found[1:], wanted, atol=1e-12 + 2e-7 * np.degrees(step_rad) * 400)


def test_the_series_of_small_turns_meets_the_arc_tangent():
    q, _ = attitudes(0.057)
    series, arc = np.empty((len(q), 3)), np.empty((len(q), 3))
    summed_turning(series, q)
    summed_at_once(arc, q)
    np.testing.assert_allclose(series, arc, rtol=1e-12, atol=1e-12)


def test_turning_about_axes_begins_with_each_event():
    q, _ = attitudes(0.05)
    t = 0.01 * np.arange(len(q))
    track = SummedTurning(t, q, np.zeros(len(t), np.int64), Timing.of(t))
    parts, axes = [slice(10, 60), slice(40, 90)], np.array([[1.0, 0.0, 0.0], [0.0, 0.6, 0.8]])
    stack = stacked(parts)
    out, at = np.empty((100, 4)), np.empty(100)
    first = np.append(stack.first, 100)
    begin = stack.index[stack.first]
    function_of(ABOUT, about_axes)(out, at, axes, np.array([0.0, 64.0]), begin, first, track.t, track.turned, 1)
    for own, part, axis, start in zip((slice(0, 50), slice(50, 100)), parts, axes, (0.0, 64.0), strict=True):
        since = track.turned[part] - track.turned[part.start]
        np.testing.assert_allclose(out[own, 0], since @ axis, atol=1e-12)
        np.testing.assert_allclose(out[own, 1:], np.cross(since, axis), atol=1e-12)
        np.testing.assert_array_equal(at[own], t[part] + start)


def test_the_loops_are_among_what_is_compiled_when_the_package_is_built():
    from attlog import prebuilt

    names = {kernel.name for kernel in prebuilt.kernels()}
    assert {turning.SUMMED.name, turning.ABOUT.name} <= names


@pytest.mark.parametrize("share", [0.2, 0.98, 1.02, 9.0])
@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_a_turn_on_either_side_of_where_the_series_ends_is_its_rotation_vector(share: float, sign: float) -> None:
    """The series leaves its next term: s^7 / 15 of s = tan^2 of half the angle."""
    s = share * turning.SMALL
    vector = 2.0 * np.arctan(np.sqrt(s)) * np.array([0.36, -0.48, 0.8])
    q = np.roll(Rotation.from_rotvec([np.zeros(3), vector]).as_quat(), 1, axis=1)
    q[1] *= sign
    out = np.empty((2, 3))
    summed_turning(out, np.ascontiguousarray(q))
    np.testing.assert_allclose(out[1], np.degrees(vector), rtol=s**7 / 7.5 + 1e-14)
