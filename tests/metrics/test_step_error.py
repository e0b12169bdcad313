"""What rows show of steps: none of a row that has no sample, however it came to that."""

from __future__ import annotations

import numpy as np
import pytest

from attlog.core import rotation
from attlog.metrics import step_error, step_turning
from attlog.metrics.step_error import Curve
from attlog.metrics.step_turning import StepEvent
from attlog.segments.model import Segment
from tests.metrics import flights
from tests.metrics.flights import motion, sampled


def test_a_row_without_a_sample_beside_the_reference_shows_no_movement():
    t, q = motion("steps", 30.0)
    row = flights.row(t + 100.0, q)
    case = flights.case([row], [Segment("continuous", 0, 30.0)], (t[::4], q[::4]))
    events = tuple(step_turning.reference_steps(case))
    assert events
    assert list(step_error.event_curves(case, row, events)) == []


# What a row shows around one stroke: errors about its axis, ends and settling, by closed forms in each axis.

T = np.arange(0.0, 12.0, 0.01)


def stroke(degrees: float) -> np.ndarray:
    """An angle that moves from 0 to so many deg between 5 and 5.5 s."""
    return np.radians(degrees) * np.clip((T - 5.0) / 0.5, 0.0, 1.0)


def shown(axis: int, degrees: float, error_deg: np.ndarray, beside_deg: float = 0.0) -> Curve:
    """The curve of a row that is off by an error about the axis of the stroke, and by another about the next axis."""
    start = rotation.from_euler(0.15, -0.25, 1.4)
    q = rotation.multiply(np.tile(start, (len(T), 1)), rotation.from_rotvec(stroke(degrees)[:, None] * np.eye(3)[axis]))
    vector = np.radians(error_deg)[:, None] * np.eye(3)[axis] + np.radians(beside_deg) * np.eye(3)[(axis + 1) % 3]
    row = flights.row(T, rotation.multiply(q, rotation.from_rotvec(vector)))
    case = flights.case([row], [Segment("continuous", 0, 12)], (T, q))
    (event,) = step_turning.reference_steps(case)
    (found,) = step_error.event_curves(case, row, [event])
    assert found.event.axis == axis
    return found


@pytest.mark.parametrize("axis", [0, 1, 2])
@pytest.mark.parametrize("degrees", [30.0, -30.0])
def test_an_error_counts_along_the_stroke_from_its_mean_before_the_onset(axis: int, degrees: float) -> None:
    """4 deg before the onset are nobody's; 2 deg more in the way of the stroke are 2, whatever its sign."""
    way = np.sign(degrees)
    error = 4.0 + way * np.where(T >= 5.2, 2.0, 0.0)
    found = shown(axis, degrees, error, beside_deg=0.5)
    later = found.t > 5.25
    np.testing.assert_allclose(found.error[later], 2.0, atol=0.05)
    np.testing.assert_allclose(found.error[found.t < found.event.onset], 0.0, atol=0.05)
    np.testing.assert_allclose(found.reference[found.t > 5.55], 30.0, atol=0.4)
    np.testing.assert_allclose(np.interp(5.25, found.t, found.reference), 15.0, atol=0.5)
    assert found.seconds[0] == pytest.approx(found.t[0] - found.event.onset)


EVENT = StepEvent(0, 5.0, 5.25, 5.45, -20.0, 4.5, 6.45)
AT = np.round(np.arange(4.5, 6.45, 0.01), 2)


def curve(error: np.ndarray, reference: np.ndarray | None = None) -> Curve:
    return Curve(EVENT, AT, 20.0 * np.clip((AT - 5.0) / 0.5, 0.0, 1.0) if reference is None else reference, error)


def test_an_error_after_a_step_is_the_mean_of_fifty_milliseconds_either_way() -> None:
    one = curve(AT**2)
    near = np.abs(AT - 5.95) <= 0.05 + 1e-9
    assert step_error.error_at(one, 5.95) == pytest.approx(np.mean(AT[near] ** 2), rel=1e-2)
    assert step_error.error_at(one, 6.7) is None
    slow = Curve(EVENT, AT[::40], 0.0 * AT[::40], AT[::40])
    assert step_error.error_at(slow, 5.68) == pytest.approx(5.7)
    assert step_error.error_at(slow, 4.3) is None
    found = step_error.errors_after([one])
    assert (found.ids.tolist(), found.stroke.tolist()) == ([5000], [20.0])
    assert step_error.errors_after([curve(-AT)]).deg[0] == pytest.approx(-5.95, abs=0.01)


def answers(est, seconds=36.0, kind="yaw", against="truth"):
    """Answers for a row ``est(t, q)`` (n, 4) in turns of yaw every 3 s."""
    t, q = motion(kind, seconds)
    ref, row = sampled(t, q, 50.0), sampled(t, est(t, q), 200.0)
    made = flights.row(row.t, row.q)
    end = float(ref.t[-1])
    case = flights.case([made], [Segment("continuous", 0, end), Segment("airborne", 1, end)], (ref.t, ref.q), against)
    return step_error.STEP_ERROR.ask(case, made, "all")


def short_by(t, q, share):
    """Falls short by ``share(since)`` of each turn from 0.5 s after its start on, right again before the next."""
    yaw = np.unwrap(rotation.to_euler(q)[:, 2])
    starts = np.arange(3.0, 33.0, 3.0)
    since = t - starts[np.clip(np.searchsorted(starts, t, side="right") - 1, 0, None)]
    before = np.interp(starts, t, yaw)[np.clip(np.searchsorted(starts, t, side="right") - 1, 0, None)]
    lost = np.where((since > 0.5) & (since < 2.4) & (t > 3.0), share(since), 0.0)
    return rotation.from_euler(0.02, -0.03, yaw - lost * (yaw - before))


def test_a_row_that_shows_10_percent_too_little_is_told_so():
    found = answers(lambda t, q: short_by(t, q, lambda since: 0.1))
    pct, deg = found["step_error_pct.0.5s"], found["step_error_deg.0.5s"]
    assert pct.value == pytest.approx(-10.0, abs=1.0)
    assert pct.n >= 8
    strokes = 0.1 * np.array(deg.each) / np.abs(np.array(pct.each) / 100.0)
    assert deg.value == pytest.approx(np.median(strokes), rel=0.1)
    assert deg.ci95[0] <= deg.value <= deg.ci95[1]


def test_too_much_is_positive_and_left_turns_count_like_right_ones():
    found = answers(lambda t, q: short_by(t, q, lambda since: -0.1))["step_error_pct.0.5s"]
    assert found.value == pytest.approx(10.0, abs=1.0)
    assert min(found.each) > 8.0


def test_a_constant_heading_offset_and_misalignment_cancel():
    turn = rotation.from_rotvec(np.radians([2.0, -1.5, 3.0]))
    found = answers(lambda t, q: rotation.turn_about_down(rotation.multiply(q, turn), 1.0))
    assert found["step_error_deg.0.5s"].value == pytest.approx(0.0, abs=0.05)
    assert found["step_error_pct.0.5s"].value == pytest.approx(0.0, abs=0.1)


def test_the_error_is_read_half_a_second_after_90_percent():
    """An error that decays at 2 1/s is a clock: the steps of this motion reach 90 % after 0.48 s."""
    found = answers(lambda t, q: short_by(t, q, lambda since: 0.3 * np.exp(-2.0 * since)))
    since = -0.5 * np.log(found["step_error_pct.0.5s"].value / -30.0)
    assert since == pytest.approx(0.98, abs=0.05)


def test_two_events_are_too_few():
    found = answers(lambda t, q: q, seconds=10.5)
    assert found["step_error_deg.0.5s"].code == "too_few_events"


def test_the_own_error_of_a_smoother_is_a_floor_in_both_units():
    def est(t, q):
        return short_by(t, q, lambda since: 0.1)

    found = answers(est, against="smoother")
    deg, pct = found["step_error_deg.0.5s"], found["step_error_pct.0.5s"]
    stroke = np.median(np.array(deg.each) / np.abs(np.array(pct.each) / 100.0))
    assert deg.floor == 0.05
    assert pct.floor == pytest.approx(100.0 * 0.05 / stroke)
    assert answers(est)["step_error_deg.0.5s"].floor == 0.0
