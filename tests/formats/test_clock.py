"""Where a boot clock starts anew, and where records only carry old times."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import attlog
from attlog import formats
from attlog.formats.clock import restarts
from tests.conftest import SAMPLES

SECOND = 1_000_000


def counted(seconds: float, begin: float = 2.0, hz: float = 100.0) -> np.ndarray:
    """The clock of a boot that writes so many records a second."""
    return ((begin + np.arange(int(seconds * hz)) / hz) * SECOND).astype(np.int64)


@pytest.mark.parametrize("late_s", [1.5, 4.0, 30.0])
@pytest.mark.parametrize("count", [21, 28, 200])
def test_records_with_old_times_are_no_restart(late_s: float, count: int) -> None:
    time = counted(85.0)
    time[4500 : 4500 + count] -= int(late_s * SECOND)
    assert restarts(time) == []


@pytest.mark.parametrize("begin", [0.0, 2.0, 2.5, 5.0])
@pytest.mark.parametrize("first", [3.0, 60.0])
def test_a_clock_that_begins_anew_is_a_restart(begin: float, first: float) -> None:
    one = counted(first)
    assert restarts(np.concatenate([one, counted(60.0, begin)])) == ([] if first + 2.0 < begin + 1.0 else [len(one)])


def test_a_restart_stays_one_where_the_new_boot_pauses() -> None:
    """The second boot writes parameters, waits, and then happens to be as late as the first one ended."""
    one, two = counted(30.0), np.concatenate([counted(1.0), counted(20.0, 33.0)])
    assert restarts(np.concatenate([one, two])) == [len(one)]


def test_both_sides_of_late_records_are_one_flight(tmp_path: Path) -> None:
    """28 records in a row, two seconds late: 85 s of flight were 45, and the rest another boot."""
    source = SAMPLES / "copter_yaw_turns.bin"
    data, log = bytearray(source.read_bytes()), formats.open(source)
    at = np.sort(np.concatenate([table.offsets for table in log.values() if "TimeUS" in table.fields]))
    for start in at[len(at) // 2 :][:28].tolist():
        stamp = slice(start + 3, start + 11)
        data[stamp] = (int.from_bytes(data[stamp], "little") - 2 * SECOND).to_bytes(8, "little")
    (tmp_path / "late.bin").write_bytes(data)
    whole, late = attlog.read(source), attlog.read(tmp_path / "late.bin")
    assert late.boots == 1
    assert late.imus[late.imu].gyro.t[-1] == pytest.approx(whole.imus[whole.imu].gyro.t[-1])
    assert len(late.imus[late.imu].gyro.t) > 0.995 * len(whole.imus[whole.imu].gyro.t)
