"""Which times of a file the others contradict, where a clock starts anew, and what time it was at a byte."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import attlog
from attlog import formats
from attlog.core.limits import LAST_TIME_US
from attlog.core.timestamps import false_times, restarts
from attlog.formats.table import boots_at, boots_of_timeline
from tests.conftest import SAMPLES

SECOND_US = 1_000_000
EVEN = 100 * SECOND_US + 10_000 * np.arange(1000, dtype=np.int64)


def moved(places: slice | list[int], by_s: float) -> np.ndarray:
    time = EVEN.copy()
    time[places] += round(by_s * SECOND_US)
    return time


@pytest.mark.parametrize("by_s", [-5.1, 5.1, 900.0])
@pytest.mark.parametrize(("begin", "count"), [(500, 1), (1, 1), (998, 1), (300, 64)])
def test_times_further_than_five_seconds_from_both_sides_are_false(begin: int, count: int, by_s: float) -> None:
    places = list(range(begin, begin + count))
    assert false_times(moved(places, by_s)).tolist() == places


def test_times_within_five_seconds_and_runs_of_more_than_sixty_four_are_believed() -> None:
    assert len(false_times(moved([500], 4.9))) == 0
    assert len(false_times(moved([500], -4.9))) == 0
    assert len(false_times(moved(slice(300, 365), 900.0))) == 0


def test_a_pause_and_a_restart_contradict_nothing() -> None:
    assert len(false_times(moved(slice(500, None), 300.0))) == 0
    assert len(false_times(moved(slice(500, None), -90.0))) == 0


def test_one_or_two_times_at_an_end_are_false_beyond_half_a_day_only() -> None:
    hours = 3600.0
    for places in ([0], [0, 1], [999], [998, 999]):
        assert false_times(moved(places, 12.1 * hours)).tolist() == places
        assert len(false_times(moved(places, 11.9 * hours))) == 0
    for places in (list(range(3)), list(range(997, 1000))):
        assert len(false_times(moved(places, 12.1 * hours))) == 0


def test_impossible_times_are_false_and_hide_no_others() -> None:
    time = moved([400, 401], 60.0)
    time[[3, 700]] = -1, LAST_TIME_US + 1
    assert false_times(time).tolist() == [3, 400, 401, 700]
    last = EVEN.copy()
    last[5] = LAST_TIME_US
    assert false_times(last).tolist() == [5]
    assert false_times(np.full(3, -1, np.int64)).tolist() == [0, 1, 2]
    assert len(false_times(EVEN[:0])) == 0


def test_where_a_quarter_of_all_times_are_steps_no_clock_contradicts_them() -> None:
    time = EVEN[:40].copy()
    time[2:32:6] += 60 * SECOND_US  # five false ones make ten steps: a quarter
    assert false_times(time).tolist() == [2, 8, 14, 20, 26]
    time[35] += 60 * SECOND_US
    assert len(false_times(time)) == 0


def test_a_clock_that_falls_by_a_second_and_a_half_starts_anew_and_by_half_a_second_does_not() -> None:
    for fall, found in ((1.5, [400]), (0.5, [])):
        assert restarts(moved(slice(400, None), -fall)) == found


def test_a_short_boot_between_two_others_is_one() -> None:
    one, two, three = (
        SECOND_US * b + 10_000 * np.arange(n, dtype=np.int64) for b, n in ((90, 500), (2, 300), (1, 500))
    )
    assert restarts(np.concatenate([one, two, three])) == [500, 800]


def test_one_false_time_just_before_or_behind_is_no_restart() -> None:
    for place in (1, 2, 500, 990):
        assert restarts(moved([place], 40.0)) == []
        assert restarts(moved([place], -40.0)) == []


def test_boots_begin_where_the_first_record_after_a_restart_lies() -> None:
    at = 50 + 7 * np.arange(1000, dtype=np.int64)
    found = boots_of_timeline((at, moved(slice(400, None), -60.0)), 9_000)
    assert [(b.start, b.end) for b in found] == [(0, 50 + 7 * 400), (50 + 7 * 400, 9_000)]
    assert [(b.start, b.end) for b in boots_at([], 10)] == [(0, 10)]


# Where a boot clock starts anew, and where records only carry old times.

ONE_S_US = 1_000_000


def counted(seconds: float, begin: float = 2.0, hz: float = 100.0) -> np.ndarray:
    """The clock of a boot that writes so many records a second."""
    return ((begin + np.arange(int(seconds * hz)) / hz) * ONE_S_US).astype(np.int64)


@pytest.mark.parametrize("late_s", [1.5, 4.0, 30.0])
@pytest.mark.parametrize("count", [21, 28, 200])
def test_records_with_old_times_are_no_restart(late_s: float, count: int) -> None:
    time = counted(85.0)
    time[4500 : 4500 + count] -= int(late_s * ONE_S_US)
    assert restarts(time) == []


@pytest.mark.parametrize("begin", [0.0, 2.0, 2.5, 5.0])
@pytest.mark.parametrize("first", [3.0, 60.0])
def test_a_clock_that_begins_anew_is_a_restart(begin: float, first: float) -> None:
    one = counted(first)
    assert restarts(np.concatenate([one, counted(60.0, begin)])) == ([] if first + 2.0 < begin + 1.0 else [len(one)])


def test_both_sides_of_late_records_are_one_flight(tmp_path: Path) -> None:
    """28 records in a row, two seconds late: 85 s of flight were 45, and the rest another boot."""
    source = SAMPLES / "copter_yaw_turns.bin"
    data, log = bytearray(source.read_bytes()), formats.open(source)
    at = np.sort(np.concatenate([table.offsets for table in log.values() if "TimeUS" in table.fields]))
    for start in at[len(at) // 2 :][:28].tolist():
        stamp = slice(start + 3, start + 11)
        data[stamp] = (int.from_bytes(data[stamp], "little") - 2 * ONE_S_US).to_bytes(8, "little")
    (tmp_path / "late.bin").write_bytes(data)
    whole, late = attlog.read(source), attlog.read(tmp_path / "late.bin")
    assert late.boots == 1
    assert late.imus[late.imu].gyro.t[-1] == pytest.approx(whole.imus[whole.imu].gyro.t[-1])
    assert len(late.imus[late.imu].gyro.t) > 0.995 * len(whole.imus[whole.imu].gyro.t)
