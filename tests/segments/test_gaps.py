"""Runs end at gaps, restarts at longer ones, and nothing else counts as a gap."""

from __future__ import annotations

import numpy as np
import pytest

from attlog.base import gap
from attlog.segments import gaps


def at_rate(rate: float, seconds: float, start: float = 0.0) -> np.ndarray:
    """Regular times."""
    return start + np.arange(0, seconds, 1 / rate)


def kinds(t: np.ndarray) -> list[tuple[str, float, float]]:
    """Kind, start and end of what is found."""
    return [(s.kind, round(s.t0, 3), round(s.t1, 3)) for s in sorted(gaps.find(t), key=lambda s: s.t0)]


def test_a_log_without_gap_is_one_run():
    assert kinds(at_rate(200, 10)) == [("continuous", 0.0, 9.995)]


@pytest.mark.parametrize(("rate", "limit"), [(400, 0.05), (200, 0.05), (50, 0.1), (25, 0.2), (10, 0.5)])
def test_a_gap_is_longer_than_five_intervals_and_than_fifty_milliseconds(rate, limit):
    assert gap.limit_of(at_rate(rate, 20)) == pytest.approx(limit)
    head = at_rate(rate, 5)
    below = np.concatenate([head, head + head[-1] + 0.98 * limit])
    above = np.concatenate([head, head + head[-1] + 1.02 * limit])
    assert [k for k, _, _ in kinds(below)] == ["continuous"]
    assert [k for k, _, _ in kinds(above)] == ["continuous", "gap", "continuous"]


def test_a_gap_says_how_long_it_is_and_what_a_filter_does_there():
    t = np.concatenate([at_rate(100, 5), at_rate(100, 5, 5.2), at_rate(100, 5, 20)])
    found = [s for s in gaps.find(t) if s.kind == "gap"]
    assert "integrates across" in found[0].why
    assert "restarts" in found[1].why
    np.testing.assert_allclose(gaps.restarts(t), [0.0, 20.0])


def test_without_an_imu_a_gap_is_the_attitudes_and_no_filter_restarts():
    t = np.concatenate([at_rate(100, 5), at_rate(100, 5, 20)])
    (found,) = (s for s in gaps.find(t, replayed=False) if s.kind == "gap")
    assert found.why == "no attitude for 15.01 s"


def test_time_that_goes_back_ends_a_run():
    t = np.concatenate([at_rate(100, 5), at_rate(100, 5)])
    assert [k for k, _, _ in kinds(t)] == ["continuous", "continuous"]
    np.testing.assert_array_equal(np.unique(gaps.number(t)), [0, 1])


def test_nothing_and_a_single_sample_have_no_run():
    assert gaps.find(np.zeros(0)) == []
    assert gaps.find(np.zeros(1)) == []
    assert len(gaps.number(np.zeros(0))) == 0


def test_samples_that_are_not_finite_or_not_later_are_left_out():
    t = np.array([0.0, 1.0, 1.0, np.nan, 0.5, 2.0, 3.0])
    x = np.array([[0.0], [1.0], [9.0], [9.0], [9.0], [np.nan], [3.0]])
    kept_t, kept_x = gaps.rising(t, x)
    np.testing.assert_array_equal(kept_t, [0.0, 1.0, 3.0])
    np.testing.assert_array_equal(kept_x[:, 0], [0.0, 1.0, 3.0])


def test_the_rate_does_not_count_the_time_lost_in_gaps():
    assert gaps.rate(np.concatenate([at_rate(50, 10), at_rate(50, 10, 100)])) == pytest.approx(50.0)
    assert gaps.rate(np.array([0.0, 0.1, 0.3, 0.4])) == pytest.approx(7.5)
    assert gaps.rate(np.zeros(1)) == 0.0


def test_good_samples_are_copied_only_where_some_are_bad():
    x, y = np.arange(5.0), np.arange(10.0).reshape(5, 2)
    assert gaps.only(np.ones(5, bool), x, y) == (x, y)
    some = gaps.only(np.array([True, False, True, True, False]), x, y)
    np.testing.assert_array_equal(some[0], [0.0, 2.0, 3.0])
    np.testing.assert_array_equal(some[1], y[[0, 2, 3]])


def test_samples_lacking_at_the_ends_alone_cost_no_copy():
    x, good = np.arange(20.0).reshape(10, 2), np.ones(10, bool)
    good[[0, 1, 9]] = False
    (ends,) = gaps.only(good, x)
    assert np.array_equal(ends, x[good])
    assert np.shares_memory(ends, x)
    good[4] = False
    (amid,) = gaps.only(good, x)
    assert np.array_equal(amid, x[good])
    assert not np.shares_memory(amid, x)
    few = np.arange(10) < 3
    assert not np.shares_memory(gaps.only(few, x)[0], x)  # else a few samples would keep all of them
    assert len(gaps.only(np.zeros(10, bool), x)[0]) == 0


def test_numbers_that_rise_by_one_already_are_themselves():
    own, other = np.array([0, 0, 1, 1, 2]), np.array([7, 7, 7, 9, 9])
    assert gaps.renumber(own, np.full(5, 3)) is own
    assert gaps.renumber(own, other).tolist() == [0, 0, 1, 2, 3]
    assert gaps.renumber(other).tolist() == [0, 0, 0, 1, 1]
    assert gaps.renumber(np.zeros(0, np.int64)).tolist() == []


@pytest.mark.parametrize("number", [[0, 0, 1, 1], [1, 1, 0, 0]])
def test_neighbours_of_two_segments_are_never_one_range(number):
    """Numbers rise by one; of two kinds joined they may also fall."""
    inside = np.array([True, True, True, True])
    assert gaps.slices(inside, np.array(number)) == [slice(0, 2), slice(2, 4)]
    assert gaps.renumber(np.array(number), np.zeros(4, np.int64)).tolist() == [0, 0, 1, 1]
    assert gaps.renumber(np.array([4, 4, 4, 5]), np.array(number)).tolist() == [0, 0, 1, 2]
