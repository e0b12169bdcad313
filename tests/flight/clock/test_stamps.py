"""Columns of times as stamps, pieces of a file by their length, and where nothing else was logged: closed forms."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from attlog.flight.clock.corroboration import times_alone
from attlog.flight.clock.pieces import others, seconds_of
from attlog.flight.clock.record_time import clock_of, ends_of
from attlog.flight.clock.timing import LATEST_US, on_a_clock, only_new, plausible, stamps_of
from attlog.formats.base import Boot, Field, Messages, Table

SECOND = 1_000_000
HALF_DAY = 12 * 3600 * SECOND


def table(name: str, instance: int = 0, **columns: Any) -> Table:
    arrays = {key: np.asarray(values) for key, values in columns.items()}
    fields = {key: Field(key, values.dtype) for key, values in arrays.items()}
    count = len(next(iter(arrays.values())))
    return Table(name, instance, fields, np.arange(count), lambda key, at: arrays[key][at])


def log_of(*tables: Table, log_format: str = "ulog") -> Messages:
    return Messages(Path("made.log"), log_format, 1, {(t.name, t.instance): t for t in tables})


def test_a_time_in_milliseconds_is_a_thousand_microseconds_and_what_is_none_is_negative() -> None:
    told = table("GPS", TimeMS=np.array([0, 7, -3, LATEST_US // 1000, LATEST_US // 1000 + 1], np.int64))
    assert stamps_of(told, "TimeMS", 1000).tolist() == [0, 7000, -1, LATEST_US // 1000 * 1000, -1]


def test_a_time_in_floating_point_that_is_no_number_or_beyond_any_clock_is_negative() -> None:
    told = table("X", time=np.array([0.0, 12.9, np.nan, np.inf, -1.0, 1e19, float(LATEST_US)]))
    assert stamps_of(told, "time").tolist() == [0, 12, -1, -1, -1, -1, LATEST_US]


def test_text_and_several_numbers_per_record_are_no_time() -> None:
    for column in (np.array(["a", "b"]), np.zeros((2, 3))):
        with pytest.raises(ValueError, match="is no time"):
            stamps_of(table("X", time=column), "time")


def test_a_stamp_beyond_any_clock_counts_as_zero() -> None:
    told = [on_a_clock(t) for t in (-1, 0, 5, LATEST_US, LATEST_US + 1)]
    assert told == [0, 0, 5, LATEST_US, 0]


def test_records_half_a_day_from_most_are_false_whether_they_come_before_or_behind() -> None:
    near = np.arange(20, dtype=np.int64) * SECOND + 3 * HALF_DAY
    for far in (near[0] - HALF_DAY - SECOND, near[-1] + HALF_DAY + SECOND):
        kept = plausible(np.append(near, far))
        assert (kept.false, kept.backward, kept.index.tolist()) == (1, 0, list(range(20)))
    assert plausible(np.append(near, near[-1] + HALF_DAY)).dropped == 0


def test_every_record_that_is_left_out_is_counted_under_one_reason() -> None:
    """Three that were never set, one beyond any clock, one twice, one that goes back, one twice and out of order."""
    t = SECOND * np.array([0, 0, 0, 10, 11, 11, 12, 9, 13, 14, 12, 15], np.int64)
    t = np.append(t, LATEST_US + 5)
    kept = plausible(t)
    assert t[kept.index].tolist() == [SECOND * s for s in (10, 11, 12, 13, 14, 15)]
    assert (kept.unset, kept.false, kept.duplicates, kept.backward) == (3, 1, 2, 1)
    assert kept.dropped == 7


def test_two_stamps_of_zero_are_a_clock_that_began() -> None:
    kept = plausible(np.array([0, 0, 5, 6], np.int64))
    assert (kept.unset, kept.duplicates, kept.index.tolist()) == (0, 1, [0, 2, 3])


def test_sixty_four_records_behind_a_gap_may_be_false_and_sixty_five_may_not() -> None:
    most = np.arange(200, dtype=np.int64) * 10_000
    for count in (64, 65):
        late = most[-1] + 60 * SECOND + 10_000 * np.arange(count)
        kept = plausible(np.append(most, late), lambda t: np.ones(len(t), bool))
        assert kept.false == (64 if count == 64 else 0)


def test_a_gap_of_more_than_ten_seconds_sets_records_apart() -> None:
    most = np.arange(50, dtype=np.int64) * 10_000
    for gap, false in ((10 * SECOND, 0), (10 * SECOND + 1, 1)):
        assert plausible(np.append(most, most[-1] + gap), lambda t: np.ones(len(t), bool)).false == false


def test_records_with_other_records_of_their_message_near_them_are_not_alone() -> None:
    """What was left out for its value stands 10 s from the late record, or a little more."""
    most = np.arange(50, dtype=np.int64) * 10_000
    late = int(most[-1]) + 100 * SECOND
    for beside, false in ((10 * SECOND, 0), (10 * SECOND + 1, 1)):
        for side in (-1, 1):
            whole = np.sort(np.append(most, [late, late + side * beside]))
            assert plausible(np.append(most, late), lambda t: np.ones(len(t), bool), whole).false == false


def test_a_repeated_value_counts_anew_in_each_second_since_its_last_change() -> None:
    t = np.array([0, 400, 900, 1100, 1900, 2100, 2500, 2600, 3500], np.int64) * 1000
    values = np.array([1.0, 1.0, 1.0, 1.0, 1.0, 1.0, 2.0, 2.0, 2.0])
    assert np.flatnonzero(only_new(values, t)).tolist() == [0, 3, 5, 6, 8]
    two = np.column_stack([np.zeros(9), values])
    np.testing.assert_array_equal(only_new(two, t), only_new(values, t))


def test_a_piece_lasts_from_the_first_to_the_last_stamp_of_any_message_whatever_its_unit() -> None:
    log = log_of(
        table("A", TimeUS=np.array([5 * SECOND, 20 * SECOND])),
        table("B", time_boot_ms=np.array([4_000, 12_000])),
        table("C", TimeMS=np.array([6_000, 21_500])),
    )
    assert seconds_of(log) == pytest.approx(17.5)


def test_stamps_that_were_never_set_the_time_of_the_week_and_a_false_stamp_lengthen_no_piece() -> None:
    week = 7 * 86_400
    log = log_of(
        table("A", timestamp=np.array([0, 100 * SECOND, 130 * SECOND])),
        table("GPS", TimeMS=np.array([300_000_000, 300_090_000])),
        table("B", timestamp=np.array([101 * SECOND, (102 + week) * SECOND])),
        table("D", timestamp=np.array([(500 + week) * SECOND, (900 + week) * SECOND])),
        table("E", timestamp=np.array([99 * SECOND, 120 * SECOND])),
        table("F", other=np.array([1, 2])),
    )
    assert seconds_of(log) == pytest.approx(31.0)
    assert seconds_of(log_of(table("F", other=np.array([1, 2])))) == 0.0


def test_the_pieces_that_were_not_taken_are_told_with_their_numbers_and_lengths() -> None:
    class Pieces:
        boots = tuple(Boot(k, k + 1) for k in range(7))

        def boot(self, k: int) -> Messages:
            return log_of(table("A", TimeUS=np.array([SECOND, (2 + k) * SECOND])))

    told = others(Pieces(), 2)  # type: ignore[arg-type]
    assert told == "Number 0 lasts 1 s, number 1 lasts 2 s, number 3 lasts 4 s, number 4 lasts 5 s and 2 more"


@pytest.mark.parametrize("beside", [-10 * SECOND, 10 * SECOND])
def test_a_time_with_another_message_within_ten_seconds_is_not_alone(beside: int) -> None:
    at = 500 * SECOND
    far = np.arange(100, 110) * SECOND
    judged = table("J", timestamp=np.append(far, at))
    log = [judged, table("A", timestamp=far), table("B", timestamp=np.sort(np.append(far, at + beside)))]
    assert times_alone(log_of(*log), np.array([at])).tolist() == [False]
    log[2] = table("B", timestamp=np.sort(np.append(far, at + beside + np.sign(beside))))
    assert times_alone(log_of(*log), np.array([at, 105 * SECOND])).tolist() == [True, False]
    assert times_alone(log_of(*log[:2]), np.array([at])).tolist() == [False]


def test_the_ends_of_a_message_are_its_first_and_last_boot_time() -> None:
    told = table("A", timestamp=np.array([7, 30, 90]), x=np.zeros(3))
    log = log_of(told)
    assert ends_of(log)(told) == (7, 90)
    assert ends_of(log)(table("B", x=np.zeros(2))) is None
    assert ends_of(log)(table("B", timestamp=np.zeros(0, np.int64))) is None
    assert clock_of(log)(told).tolist() == [7, 30, 90]  # type: ignore[union-attr]
    assert clock_of(log)(table("B", timestamp=np.zeros((2, 2)))) is None
