"""A time is false where the rest of the log contradicts it, and only there."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from attlog.core.limits import LAST_TIME_US
from attlog.core.timestamps import changed_records, gap_indices, longest_rising, plausible_records
from attlog.flight.builder import LogBuilder
from attlog.flight.model import logged_rate
from attlog.flight.timestamps import (
    describe_other_boots,
    foreign_clocks,
    isolated_timestamps,
    logged_seconds,
    read_stamps,
    record_clock,
    table_time_span,
    valid_stamp,
)
from attlog.formats.table import Boot, Field, Messages, Table
from tests.flight.fake import messages

FLIGHT = np.concatenate([np.arange(0, 60_000_000, 20_000), np.arange(400_000_000, 460_000_000, 20_000)])
"""Two minutes at 50 Hz with a pause of the logger of over five minutes."""


def log_with_stamps(judged: NDArray[np.int64], *others: NDArray[np.int64], log_format: str = "ulog") -> LogBuilder:
    """A log of the judged message and others, by their times."""
    tables = {}
    for name, times in [("judged", judged), *((f"other_{k}", t) for k, t in enumerate(others))]:
        fields = {"timestamp": Field("timestamp", np.dtype(np.int64))}
        tables[name, 0] = Table(name, 0, fields, np.arange(len(times)), lambda _, at, t=times: t[at])
    return LogBuilder(Messages(Path("made.ulg"), log_format, 1, tables))


def refused(builder: LogBuilder, good: NDArray[np.bool_] | None = None) -> list[int]:
    """Which records are left out, and each one counted as such."""
    t = builder.messages["judged", 0]["timestamp"]
    kept = builder.select_records(t, "judged", good)
    lost = np.setdiff1d(np.arange(len(t)) if good is None else np.flatnonzero(good), kept)
    assert sum(p.count for p in builder.problems if p.code in ("false_times", "time_backward")) == len(lost)
    return lost.tolist()


OTHERS = (FLIGHT + 1_000, FLIGHT[::50] + 2_000, FLIGHT[::5] + 3_000)
LAST = len(FLIGHT) - 1


@pytest.mark.parametrize(
    ("places", "moved_s"),
    [
        ([70], 3600.0),  # single
        ([70], -30.0),
        (list(range(900, 930)), 3600.0),  # a run
        ([LAST], 3600.0),  # at the end, where nothing follows
        ([LAST], 15.0),
        (list(range(LAST - 29, LAST + 1)), 900.0),
        ([0], 200.0),  # the first, into the pause
        ([0], 5000.0),
        ([2999], 100.0),  # the last before the pause
    ],
)
def test_planted_false_times_are_found(places: list[int], moved_s: float) -> None:
    t = FLIGHT + 100_000_000
    t[places] += round(moved_s * 1e6)
    others = [o + 100_000_000 for o in OTHERS]
    assert refused(log_with_stamps(t, *others)) == places


@pytest.mark.parametrize("count", [1, 2, 10])
def test_a_few_records_behind_a_pause_of_the_whole_log_are_kept(count: int) -> None:
    end = 5_000_000_000
    t = np.append(FLIGHT, end + 20_000 * np.arange(count))
    assert refused(log_with_stamps(t, *(np.append(o, end + 500_000) for o in OTHERS))) == []


def test_records_beside_others_with_values_out_of_range_are_kept() -> None:
    """Only every 15 s a value can be used: the times are continuous all the same."""
    t = np.arange(0, 600_000_000, 200_000)
    good = np.zeros(len(t), bool)
    good[:500] = good[500::75] = True
    assert refused(log_with_stamps(t, *OTHERS), good) == []


def test_flights_of_more_than_a_day_keep_their_beginning_and_end() -> None:
    t = np.arange(0, 30 * 3600, 2, dtype=np.int64) * 1_000_000
    assert refused(log_with_stamps(t, t + 1, t + 2)) == []


def test_checked_telemetry_has_no_false_times() -> None:
    t = np.append(FLIGHT, FLIGHT[-1] + 900_000_000)
    assert refused(log_with_stamps(t, *OTHERS, log_format="tlog")) == []


# Columns of times as stamps, pieces of a file by their length, and where nothing else was logged: closed forms.

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
    told = table("GPS", TimeMS=np.array([0, 7, -3, LAST_TIME_US // 1000, LAST_TIME_US // 1000 + 1], np.int64))
    assert read_stamps(told, "TimeMS", 1000).tolist() == [0, 7000, -1, LAST_TIME_US // 1000 * 1000, -1]


def test_a_time_in_floating_point_that_is_no_number_or_beyond_any_clock_is_negative() -> None:
    told = table("X", time=np.array([0.0, 12.9, np.nan, np.inf, -1.0, 1e19, float(LAST_TIME_US)]))
    assert read_stamps(told, "time").tolist() == [0, 12, -1, -1, -1, -1, LAST_TIME_US]


def test_text_and_several_numbers_per_record_are_no_time() -> None:
    for column in (np.array(["a", "b"]), np.zeros((2, 3))):
        with pytest.raises(ValueError, match="is no time"):
            read_stamps(table("X", time=column), "time")


def test_a_stamp_beyond_any_clock_counts_as_zero() -> None:
    told = [valid_stamp(t) for t in (-1, 0, 5, LAST_TIME_US, LAST_TIME_US + 1)]
    assert told == [0, 0, 5, LAST_TIME_US, 0]


def test_records_half_a_day_from_most_are_false_whether_they_come_before_or_behind() -> None:
    near = np.arange(20, dtype=np.int64) * SECOND + 3 * HALF_DAY
    for far in (near[0] - HALF_DAY - SECOND, near[-1] + HALF_DAY + SECOND):
        kept = plausible_records(np.append(near, far))
        assert (kept.false, kept.backward, kept.index.tolist()) == (1, 0, list(range(20)))
    assert plausible_records(np.append(near, near[-1] + HALF_DAY)).dropped == 0


def test_every_record_that_is_left_out_is_counted_under_one_reason() -> None:
    """Three that were never set, one beyond any clock, one twice, one that goes back, one twice and out of order."""
    t = SECOND * np.array([0, 0, 0, 10, 11, 11, 12, 9, 13, 14, 12, 15], np.int64)
    t = np.append(t, LAST_TIME_US + 5)
    kept = plausible_records(t)
    assert t[kept.index].tolist() == [SECOND * s for s in (10, 11, 12, 13, 14, 15)]
    assert (kept.unset, kept.false, kept.duplicates, kept.backward) == (3, 1, 2, 1)
    assert kept.dropped == 7


def test_two_stamps_of_zero_are_a_clock_that_began() -> None:
    kept = plausible_records(np.array([0, 0, 5, 6], np.int64))
    assert (kept.unset, kept.duplicates, kept.index.tolist()) == (0, 1, [0, 2, 3])


def test_sixty_four_records_behind_a_gap_may_be_false_and_sixty_five_may_not() -> None:
    most = np.arange(200, dtype=np.int64) * 10_000
    for count in (64, 65):
        late = most[-1] + 60 * SECOND + 10_000 * np.arange(count)
        kept = plausible_records(np.append(most, late), lambda t: np.ones(len(t), bool))
        assert kept.false == (64 if count == 64 else 0)


def test_a_gap_of_more_than_ten_seconds_sets_records_apart() -> None:
    most = np.arange(50, dtype=np.int64) * 10_000
    for gap, false in ((10 * SECOND, 0), (10 * SECOND + 1, 1)):
        assert plausible_records(np.append(most, most[-1] + gap), lambda t: np.ones(len(t), bool)).false == false


def test_records_with_other_records_of_their_message_near_them_are_not_alone() -> None:
    """What was left out for its value stands 10 s from the late record, or a little more."""
    most = np.arange(50, dtype=np.int64) * 10_000
    late = int(most[-1]) + 100 * SECOND
    for beside, false in ((10 * SECOND, 0), (10 * SECOND + 1, 1)):
        for side in (-1, 1):
            whole = np.sort(np.append(most, [late, late + side * beside]))
            assert plausible_records(np.append(most, late), lambda t: np.ones(len(t), bool), whole).false == false


def test_a_repeated_value_counts_anew_in_each_second_since_its_last_change() -> None:
    t = np.array([0, 400, 900, 1100, 1900, 2100, 2500, 2600, 3500], np.int64) * 1000
    values = np.array([1.0, 1.0, 1.0, 1.0, 1.0, 1.0, 2.0, 2.0, 2.0])
    assert np.flatnonzero(changed_records(values, t)).tolist() == [0, 3, 5, 6, 8]
    two = np.column_stack([np.zeros(9), values])
    np.testing.assert_array_equal(changed_records(two, t), changed_records(values, t))


def test_a_piece_lasts_from_the_first_to_the_last_stamp_of_any_message_whatever_its_unit() -> None:
    log = log_of(
        table("A", TimeUS=np.array([5 * SECOND, 20 * SECOND])),
        table("B", time_boot_ms=np.array([4_000, 12_000])),
        table("C", TimeMS=np.array([6_000, 21_500])),
    )
    assert logged_seconds(log) == pytest.approx(17.5)


def on_clocks(shift_s: float, shifted: str, n: int = 200) -> Messages:
    """Messages at 10 Hz, one after the other in the file, of which one is on another clock."""
    names = ("A", "B", "C", "D", "E")
    columns = {
        (name, 0): {"timestamp": (np.arange(n) * 100_000 + 5 * SECOND + (shift_s * SECOND if name == shifted else 0))}
        for name in names
    }
    made = messages("ulog", {key: {"timestamp": c["timestamp"].astype(np.uint64)} for key, c in columns.items()})
    for k, key in enumerate(columns):
        own = made.tables[key]
        offsets = 1000 + 50 * np.arange(n, dtype=np.int64) + 10 * k
        stored = columns[key]["timestamp"].astype(np.uint64)
        made.tables[key] = Table(
            own.name, 0, own.fields, offsets, lambda c, at, o=offsets, x=stored: x[np.searchsorted(o, at)]
        )
    return made


@pytest.mark.parametrize("shift_s", [1000.0, -900.0, 40.0, 100_000.0])
def test_a_message_on_another_clock_is_named_with_its_difference(shift_s: float) -> None:
    assert foreign_clocks(on_clocks(shift_s, "C")) == {("C", 0): pytest.approx(shift_s, abs=1.0)}


def test_messages_written_some_seconds_late_are_on_the_same_clock() -> None:
    assert foreign_clocks(on_clocks(-8.0, "C")) == {}
    assert foreign_clocks(on_clocks(0.0, "C")) == {}


@pytest.mark.parametrize("stamp", [0, 100_000 * SECOND])
def test_stamps_that_are_unset_or_do_not_run_are_no_clock(stamp: int) -> None:
    made = on_clocks(0.0, "C", 600)
    own = made.tables["C", 0]
    stored = np.full(600, stamp, np.uint64)
    made.tables["C", 0] = Table(own.name, 0, own.fields, own.offsets, lambda c, at: stored[: len(at)])
    assert foreign_clocks(made) == {}


def test_records_with_an_unset_stamp_are_left_out_of_the_comparison() -> None:
    made = on_clocks(1000.0, "C", 600)
    own = made.tables["C", 0]
    stored = own["timestamp"].copy()
    stored[::2] = 0
    offsets = own.offsets
    made.tables["C", 0] = Table(own.name, 0, own.fields, offsets, lambda c, at: stored[np.searchsorted(offsets, at)])
    assert foreign_clocks(made) == {("C", 0): pytest.approx(1000.0, abs=1.0)}


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
    assert logged_seconds(log) == pytest.approx(31.0)
    assert logged_seconds(log_of(table("F", other=np.array([1, 2])))) == 0.0
    text = table("H", timestamp=np.array([b"x", b"y"]))
    assert logged_seconds(log_of(text)) == 0.0, "a time of letters is no time"
    apart = [
        table("A", timestamp=np.array([SECOND, 9 * SECOND])),
        table("B", timestamp=np.array([2, 2]) * week * SECOND),
    ]
    assert logged_seconds(log_of(*apart)) == 0.0, "two clocks weeks apart: the later one's length"


def test_the_pieces_that_were_not_taken_are_told_with_their_numbers_and_lengths() -> None:
    class Pieces:
        boots = tuple(Boot(k, k + 1) for k in range(7))

        def boot(self, k: int) -> Messages:
            return log_of(table("A", TimeUS=np.array([SECOND, (2 + k) * SECOND])))

    told = describe_other_boots(Pieces(), 2)  # type: ignore[arg-type]
    assert told == "Number 0 lasts 1 s, number 1 lasts 2 s, number 3 lasts 4 s, number 4 lasts 5 s and 2 more"


@pytest.mark.parametrize("beside", [-10 * SECOND, 10 * SECOND])
def test_a_time_with_another_message_within_ten_seconds_is_not_alone(beside: int) -> None:
    at = 500 * SECOND
    far = np.arange(100, 110) * SECOND
    judged = table("J", timestamp=np.append(far, at))
    log = [judged, table("A", timestamp=far), table("B", timestamp=np.sort(np.append(far, at + beside)))]
    assert isolated_timestamps(log_of(*log), np.array([at])).tolist() == [False]
    log[2] = table("B", timestamp=np.sort(np.append(far, at + beside + np.sign(beside))))
    assert isolated_timestamps(log_of(*log), np.array([at, 105 * SECOND])).tolist() == [True, False]
    assert isolated_timestamps(log_of(*log[:2]), np.array([at])).tolist() == [False]


def test_the_ends_of_a_message_are_its_first_and_last_boot_time() -> None:
    told = table("A", timestamp=np.array([7, 30, 90]), x=np.zeros(3))
    log = log_of(told)
    assert table_time_span(log)(told) == (7, 90)
    assert table_time_span(log)(table("B", x=np.zeros(2))) is None
    assert table_time_span(log)(table("B", timestamp=np.zeros(0, np.int64))) is None
    assert record_clock(log)(told).tolist() == [7, 30, 90]  # type: ignore[union-attr]
    assert record_clock(log)(table("B", timestamp=np.zeros((2, 2)))) is None


# Which records of a message have a plausible time.

EVEN = np.arange(100, dtype=np.int64) * 10_000 + 5_000_000


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
    assert gap_indices(t).tolist() == ([20] if told else [])


def test_of_groups_that_are_equally_small_none_is_taken_for_false() -> None:
    """The records of a slow message come in bursts: nothing tells which of them would be the false one."""
    bursts = np.concatenate([EVEN[:3], EVEN[:3] + 60_000_000])
    assert plausible_records(bursts, lambda t: np.ones(len(t), bool)).dropped == 0
    assert plausible_records(bursts[:5], lambda t: np.ones(len(t), bool)).false == 2


def test_a_clock_of_another_unit_gives_no_flight_of_months() -> None:
    """Steps of 5,000 s, as of nanoseconds read as microseconds: what is left spans three days at most."""
    times = 5_000 * SECOND * np.arange(1, 2400, dtype=np.int64)
    builder = log_with_stamps(times)
    kept = builder.select_records(times, "judged")
    assert 0 < np.ptp(times[kept]) <= 3 * 86_400 * SECOND
    assert [(p.code, p.count) for p in builder.problems] == [("false_times", len(times) - len(kept))]


def test_a_few_records_a_microsecond_apart_are_no_stream() -> None:
    builder = log_with_stamps(np.arange(5, dtype=np.int64) + SECOND)
    t = builder.messages["judged", 0]["timestamp"]
    assert len(builder.select_records(t, "judged")) == 0
    assert [p.code for p in builder.problems] == ["rate_impossible"]
    pair = np.array([0, 10, 2 * SECOND, 4 * SECOND], np.int64) + SECOND
    assert len(log_with_stamps(pair).select_records(pair, "judged")) == 4
