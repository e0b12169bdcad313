"""sdlog2 logs: values as pymavlink reads them, times from the TIME records."""

from __future__ import annotations

from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from attlog import formats
from attlog.base.errors import LogUnusable
from attlog.formats import sdlog2
from tests.conftest import corpus_logs
from tests.formats.dataflash.test_dataflash import differences, read_with_pymavlink

LOGS = [p for p in corpus_logs(".px4log", ".bin") if p.name.startswith("px4log") and "badformat" not in p.name]


@pytest.mark.parametrize("path", LOGS, ids=lambda p: p.name)
def test_every_value_equals_what_pymavlink_reads(path: Path) -> None:
    assert differences(sdlog2.read(path), read_with_pymavlink(path)) == []


@pytest.mark.parametrize("path", LOGS, ids=lambda p: p.name)
def test_records_have_the_time_of_the_time_record_before_them(path: Path) -> None:
    log = sdlog2.read(path)
    clock, imu = log["TIME", 0], log["IMU", 0]
    for k in (0, len(imu) // 2, len(imu) - 1):
        before = [t for o, t in zip(clock.offsets, clock["StartTime"], strict=True) if o < imu.offsets[k]]
        assert imu[sdlog2.TIME][k] == before[-1]
    assert np.all(np.diff(imu[sdlog2.TIME]) >= 0)


def test_rows_keep_their_own_times(corpus: Path) -> None:
    imu = sdlog2.read(corpus / "logs" / "px4log_log001_cut.bin")["IMU", 0]
    half = imu.rows(slice(100, None, 2))
    np.testing.assert_array_equal(half[sdlog2.TIME], imu[sdlog2.TIME][100::2])
    np.testing.assert_array_equal(half["AccX"], imu["AccX"][100::2])


def test_an_ardupilot_log_is_no_px4log(samples: Path) -> None:
    assert not sdlog2.is_sdlog2((samples / "copter_steps_stabilize.bin").read_bytes()[: formats.HEAD])


@pytest.mark.parametrize("path", LOGS, ids=lambda p: p.name)
def test_a_px4log_is_recognised_by_its_time_record(path: Path) -> None:
    assert sdlog2.is_sdlog2(path.read_bytes()[: formats.HEAD])


def test_a_log_whose_formats_name_no_columns_is_refused(corpus: Path) -> None:
    with pytest.raises(LogUnusable, match="name no columns"):
        sdlog2.read(corpus / "logs" / "px4log_tiny_badformat.px4log")


def test_records_before_the_first_time_record_have_no_time() -> None:
    """-1 stands for none, and a false time record takes it from its whole group."""
    at, time = np.array([100, 200, 300]), np.array([5_000, -1, 9_000])
    table: Any = SimpleNamespace(offsets=np.array([50, 150, 250, 350]))
    decode = sdlog2._with_time(table, at, time)
    assert decode(sdlog2.TIME, table.offsets).tolist() == [-1, 5_000, -1, 9_000]
