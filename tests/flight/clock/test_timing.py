"""Which records of a message have a plausible time."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from attlog.flight.clock.timing import gaps, longest_rising, only_new, plausible
from attlog.flight.model import logged_rate

EVEN = np.arange(100, dtype=np.int64) * 10_000 + 5_000_000


def test_rising_stamps_are_all_kept() -> None:
    kept = plausible(EVEN)
    assert len(kept.index) == 100
    assert kept.dropped == 0


def test_later_records_with_an_equal_stamp_are_duplicates() -> None:
    kept = plausible(np.repeat(EVEN, 2))
    assert kept.duplicates == 100
    assert (kept.index % 2 == 0).all(), "the first of each pair stays"


def test_several_stamps_of_zero_were_never_set() -> None:
    kept = plausible(np.concatenate([np.zeros(300, np.int64), EVEN]))
    assert (kept.unset, kept.duplicates, kept.index[0], len(kept.index)) == (300, 0, 300, 100)
    assert plausible(np.arange(100) * 10_000).unset == 0, "a clock that starts at 0 does so once"


def test_one_false_late_time_does_not_take_the_good_ones_with_it() -> None:
    t = EVEN.copy()
    t[50] += 3_000_000
    kept = plausible(t)
    assert 50 not in kept.index
    assert len(kept.index) == 99
    assert kept.backward == 1


def test_a_clock_of_ten_to_the_thirteen_seconds_is_false() -> None:
    t = EVEN.copy()
    t[[0, 99]] = 10**19 // 2
    assert plausible(t).false == 2


@pytest.mark.parametrize("alone", [True, False])
def test_single_records_far_behind_the_end_are_false_where_nothing_else_was_logged(alone: bool) -> None:
    late = np.append(EVEN, EVEN[-1] + 1_174_000_000)
    kept = plausible(late, lambda t: np.full(len(t), alone))
    assert (kept.false, kept.index[-1]) == ((1, 99) if alone else (0, 100))
    assert plausible(late).dropped == 0, "one message alone cannot tell"


def test_a_pause_between_two_flights_is_no_fault() -> None:
    kept = plausible(np.concatenate([EVEN, EVEN + 628_000_000]))
    assert kept.dropped == 0


def test_the_unix_clock_keeps_its_microseconds() -> None:
    kept = plausible(EVEN + 1_710_773_350_346_001)
    assert kept.dropped == 0


@settings(deadline=None)  # shared machines are slow now and then
@given(st.lists(st.integers(0, 50), min_size=1, max_size=40))
def test_the_longest_rising_part_is_found(values: list[int]) -> None:
    best = [1] * len(values)
    for i in range(len(values)):
        best[i] = 1 + max((best[k] for k in range(i) if values[k] < values[i]), default=0)
    chain = longest_rising(np.array(values))
    assert len(chain) == max(best)
    assert (np.diff(np.array(values)[chain]) > 0).all()


def test_rate_leaves_out_pauses_but_counts_lost_samples() -> None:
    t = np.arange(0, 10, 0.02)
    assert logged_rate(np.concatenate([t, t + 600])) == pytest.approx(50, rel=0.01)
    assert logged_rate(np.delete(t, slice(100, 110))) < 49.5


def test_a_gap_is_longer_than_five_intervals_and_fifty_milliseconds() -> None:
    t = np.cumsum([0.005] * 20 + [0.049] + [0.005] * 20 + [0.051] + [0.005] * 20)
    assert gaps(t).tolist() == [41]


@pytest.mark.parametrize("rate", [250.0, 50.0, 5.0])
def test_a_sensor_that_stands_still_is_kept_once_a_second_and_never_has_false_times(rate: float) -> None:
    t = np.round(np.arange(60 * rate) * 1e6 / rate).astype(np.int64)
    field = np.tile([200.0, 0.0, 400.0], (len(t), 1))
    kept = t[only_new(field, t)]
    assert 59 <= len(kept) <= 60
    assert np.diff(kept).max() <= 1_000_000
    assert plausible(kept).dropped == 0


def test_a_repeated_value_is_left_out_and_every_change_is_kept() -> None:
    t = np.arange(12, dtype=np.int64) * 20_000
    values = np.repeat([1.0, 2.0, 1.0], 4)
    assert np.flatnonzero(only_new(values, t)).tolist() == [0, 4, 8]
    assert only_new(values[:1], t[:1]).tolist() == [True]
    assert only_new(values[:0], t[:0]).tolist() == []


@pytest.mark.parametrize(
    ("interval", "pause", "told"),
    [
        (0.02, 0.09, False),
        (0.02, 0.11, True),
        (0.001, 0.04, False),
        (0.001, 0.06, True),
        (0.2, 0.9, False),
        (0.2, 1.1, True),
    ],
)
def test_a_gap_is_longer_than_five_intervals_and_50_ms(interval, pause, told):
    t = np.concatenate([np.arange(20) * interval, 19 * interval + pause + np.arange(20) * interval])
    assert gaps(t).tolist() == ([20] if told else [])


def test_of_groups_that_are_equally_small_none_is_taken_for_false() -> None:
    """The records of a slow message come in bursts: nothing tells which of them would be the false one."""
    bursts = np.concatenate([EVEN[:3], EVEN[:3] + 60_000_000])
    assert plausible(bursts, lambda t: np.ones(len(t), bool)).dropped == 0
    assert plausible(bursts[:5], lambda t: np.ones(len(t), bool)).false == 2
