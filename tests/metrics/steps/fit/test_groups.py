"""Events of a lag's fit in groups: what all of them together tell, without the columns of all at once."""

import numpy as np
import pytest

from attlog.base import rotation
from attlog.metrics.steps import events as steps
from attlog.metrics.steps import fits as step_fits
from attlog.metrics.steps.fit import groups as step_groups
from attlog.metrics.steps.fit.groups import axes_of, axis_of
from attlog.metrics.steps.fit.turning import REACH_AFTER_S, REACH_BEFORE_S, SummedTurning, around
from tests.metrics.motions import motion, sampled


def both(seconds):
    t, q = motion("steps", seconds)
    row, ref = sampled(t, q, 200.0, 0.0073), sampled(t, q, 50.0, offset=0.0013)
    return row, ref, steps.find(ref.t, ref.q, ref.segment)


@pytest.mark.parametrize("kept", [0, 200_000, 10**9])
def test_events_in_groups_tell_the_same_as_all_at_once(monkeypatch, kept):
    whole = step_fits.fit(step_groups.groups(*both(60.0), None))["all"]
    monkeypatch.setattr(step_groups, "TOGETHER", 2000)
    groups = step_groups.groups(*both(60.0), None)
    groups._room = kept
    found = step_fits.fit(groups)["all"]
    assert len(groups.bounds) >= 5
    assert [k for own in groups.bounds for k in range(own.start, own.stop)] == list(range(len(groups.events)))
    assert found.delay == pytest.approx(whole.delay, abs=1e-10)
    np.testing.assert_allclose(found.left_out, whole.left_out, rtol=1e-7)


def test_columns_are_kept_up_to_a_size_however_many_events_there_are(monkeypatch):
    monkeypatch.setattr(step_groups, "TOGETHER", 2000)
    held = []
    for seconds in (60.0, 240.0):
        groups = step_groups.groups(*both(seconds), None)
        groups._kept.clear()
        groups._room = 500_000
        step_fits.fit(groups)
        held.append(sum(columns.nbytes for columns in groups._kept.values()))
        assert len(groups.bounds) > len(groups._kept)
    assert 0 < held[1] <= 500_000
    assert held[1] == pytest.approx(held[0], rel=0.3)


def test_samples_around_an_event_are_those_of_its_segment_and_reach_far_enough():
    t = np.delete(np.arange(0.0, 60.0, 0.01), np.arange(2011, 2061))
    q = rotation.from_euler(0 * t, 0.3 * np.sin(t), 0 * t)
    track = SummedTurning(t, q, (t > 33.333).astype(np.int64))
    events = [steps.StepEvent(1, at, at + 0.1, at + 0.3, 9.0, at - 0.5, at + 1.3) for at in np.arange(0.2, 59.0, 0.37)]
    for event, found in zip(events, around(track, events, 0.3), strict=True):
        middle = track.segment[np.searchsorted(track.t, event.middle)]
        near = (track.t >= event.begin - 0.3) & (track.t < event.end + 0.3) & (track.segment == middle)
        at = track.t[near]
        reaches = at[0] <= event.onset - REACH_BEFORE_S and at[-1] >= min(event.t90 + REACH_AFTER_S, event.end)
        assert (found is not None) == reaches
        if found is not None:
            np.testing.assert_array_equal(track.t[found], at)


def test_the_axis_of_an_event_is_unit_length_along_the_stroke_and_none_without_a_turn():
    _, ref, events = both(30.0)
    found = axes_of(ref, events)
    np.testing.assert_allclose(np.linalg.norm(found, axis=1), 1.0)
    assert all(found[k, e.axis] > 0.9 for k, e in enumerate(events))
    still = SummedTurning(ref.t, np.tile([1.0, 0.0, 0.0, 0.0], (len(ref.t), 1)), ref.segment)
    assert np.isnan(axes_of(still, events)).all()
    assert axis_of(still, events[0]) is None
