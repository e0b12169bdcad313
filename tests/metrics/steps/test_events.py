import itertools
from types import SimpleNamespace

import numpy as np
import pytest

from attlog.base import rotation
from attlog.metrics.steps import events as steps
from tests.metrics.motions import motion, sampled, vehicle


def find(track):
    return steps.find(track.t, track.q, track.segment)


@pytest.mark.parametrize("hz", [10.0, 25.0, 250.0])
def test_each_commanded_movement_is_one_event_at_any_reference_rate(hz):
    t, q = motion("yaw", 40.0)
    events = find(sampled(t, q, hz))
    assert len(events) == len(np.arange(3.0, 37.0, 3.0))
    assert {e.axis for e in events} == {2}
    np.testing.assert_allclose(np.diff([e.onset for e in events]), 3.0, atol=0.15)


@pytest.mark.parametrize(("seconds", "events_each"), [(0.5, 1), (0.75, 1), (1.4, 2)])
def test_a_doublet_is_counted_once_unless_its_way_back_comes_0_7_s_later(seconds, events_each):
    t = np.arange(0.0, 20.0, 0.0025)
    command = np.zeros(len(t))
    for at in (4.0, 9.0, 14.0):
        command[(t >= at) & (t < at + seconds)] = np.radians(20)
    q = rotation.from_euler(vehicle(command, 15.0), 0 * t, 0 * t)
    events = find(sampled(t, q, 100.0))
    assert [e.delta_deg > 0 for e in events] == [True, False][:events_each] * 3


def test_small_and_slow_movements_are_no_events():
    t = np.arange(0.0, 20.0, 0.0025)
    small = vehicle(np.where((t > 5) & (t < 10), np.radians(4.0), 0.0), 12.0)
    slow = np.radians(4.0) * t
    assert find(sampled(t, rotation.from_euler(small, 0 * t, slow), 50.0)) == []


def test_no_event_without_half_a_second_of_the_same_piece_before_it():
    t, q = motion("yaw", 16.0)
    track = sampled(t, q, 50.0)
    whole = find(track)
    track.segment = (track.t > whole[1].onset - 0.3).astype(np.int64)
    assert [e.onset for e in find(track)] == [e.onset for e in whole if e is not whole[1]]


def test_events_count_from_the_scoring_start_and_only_those_that_end_before_the_end():
    t, q = motion("yaw", 40.0)
    track = sampled(t, q, 50.0)
    whole = find(track)
    begin, end = whole[1].begin + 0.1, whole[-2].end - 0.1
    reference = SimpleNamespace(t=track.t, q=track.q, segment=track.segment, scoring_start=begin, end=end)
    assert steps.scored(reference) == whole[2:-2]


def test_windows_of_neighbouring_events_do_not_overlap():
    t, q = motion("steps", 60.0)
    events = find(sampled(t, q, 100.0))
    for axis in (0, 1):
        own = [e for e in events if e.axis == axis]
        assert all(a.end <= b.begin for a, b in itertools.pairwise(own))
        assert all(e.begin < e.onset < e.middle <= e.t90 < e.end for e in own)
