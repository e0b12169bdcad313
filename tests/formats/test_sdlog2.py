"""sdlog2 logs: values as pymavlink reads them, times from the TIME records."""

from __future__ import annotations

import struct
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from attlog import formats
from attlog.core.errors import LogUnusable
from attlog.formats import sdlog2
from tests.conftest import corpus_logs
from tests.formats.dataflash.made import form, record
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
    assert not sdlog2.is_sdlog2((samples / "copter_steps_stabilize.bin").read_bytes()[: formats.MAX_HEAD_BYTES])


@pytest.mark.parametrize("path", LOGS, ids=lambda p: p.name)
def test_a_px4log_is_recognised_by_its_time_record(path: Path) -> None:
    assert sdlog2.is_sdlog2(path.read_bytes()[: formats.MAX_HEAD_BYTES])


def test_a_log_whose_formats_name_no_columns_is_refused(corpus: Path) -> None:
    with pytest.raises(LogUnusable, match="name no columns"):
        sdlog2.read(corpus / "logs" / "px4log_tiny_badformat.px4log")


def test_records_before_the_first_time_record_have_no_time() -> None:
    """-1 stands for none, and a false time record takes it from its whole group."""
    at, time = np.array([100, 200, 300]), np.array([5_000, -1, 9_000])
    table: Any = SimpleNamespace(offsets=np.array([50, 150, 250, 350]))
    decode = sdlog2._with_time(table, at, time)
    assert decode(sdlog2.TIME, table.offsets).tolist() == [-1, 5_000, -1, 9_000]


# sdlog2 logs made by hand: what makes a file one, times of groups, parameters, versions, power-ups.

FORMS = (
    form(129, "TIME", "Q", "StartTime")
    + form(2, "IMU", "ff", "AccX,AccY")
    + form(3, "PARM", "Nf", "Name,Value")
    + form(4, "VER", "NZ", "Arch,FwGit")
)


def time(t_us: int) -> bytes:
    return record(129, "Q", t_us)


def imu(x: float) -> bytes:
    return record(2, "ff", x, -x)


def read(tmp_path: Path, *parts: bytes) -> sdlog2.Messages:
    path = tmp_path / "a.px4log"
    path.write_bytes(b"".join(parts))
    return sdlog2.read(path)


@pytest.mark.parametrize(
    ("head", "is_one"),
    [
        (FORMS, True),
        (form(129, "IMU", "ff", "AccX,AccY") + form(128 - 1, "TIME", "Q", "StartTime"), True),
        (form(129, "TIME", "QB", "StartTime,I"), False),
        (form(129, "TIMX", "Q", "StartTime"), False),
        (b"TIME Q " * 9, False),
        (b"", False),
    ],
)
def test_a_file_whose_time_message_holds_one_clock_is_one(head: bytes, is_one: bool) -> None:
    assert sdlog2.is_sdlog2(head) is is_one


def test_each_record_has_the_time_of_its_group(tmp_path: Path) -> None:
    log = read(tmp_path, FORMS, imu(1.0), time(5_000), imu(2.0), imu(3.0), time(25_000), imu(4.0))
    assert log["IMU", 0][sdlog2.TIME].tolist() == [-1, 5_000, 5_000, 25_000]
    assert log["IMU", 0]["AccX"].tolist() == [1.0, 2.0, 3.0, 4.0]
    assert log["IMU", 0]["AccY"].tolist() == [-1.0, -2.0, -3.0, -4.0]
    assert log["TIME", 0][sdlog2.TIME].tolist() == [5_000, 25_000]
    assert log["IMU", 0].fields[sdlog2.TIME].unit == "us"
    assert next(iter(log["IMU", 0].fields)) == sdlog2.TIME
    some = log["IMU", 0].rows(np.array([0, 2, 3]))
    assert some[sdlog2.TIME].tolist() == [-1, 5_000, 25_000]
    assert some["AccX"].tolist() == [1.0, 3.0, 4.0]
    assert (log.format, log.damage_bytes) == ("px4log", 0)


def test_parameters_have_the_time_of_their_group_and_versions_are_texts(tmp_path: Path) -> None:
    ver = record(4, "NZ", b"FMU_V1", b"abc123")
    parts = [record(3, "Nf", b"A_GAIN", 0.5), time(7_000), record(3, "Nf", b"B_GAIN", -2.0)]
    parts += [time(0), record(3, "Nf", b"C_GAIN", 3.0)]
    log = read(tmp_path, FORMS, ver, *parts, imu(1.0))
    assert [(p.name, p.value, p.t_us) for p in log.params] == [
        ("A_GAIN", 0.5, None),
        ("B_GAIN", -2.0, 7_000),
        ("C_GAIN", 3.0, 0),
    ]
    assert log.info["VER"] == {"Arch": "FMU_V1", "FwGit": "abc123"}


def test_a_false_time_leaves_its_group_without_one(tmp_path: Path) -> None:
    groups = [time(1_000_000 + 10_000 * k) + imu(float(k)) for k in range(40)]
    groups[20] = time(9_000_000_000_000) + imu(20.0)
    log = read(tmp_path, FORMS, *groups)
    times = log["IMU", 0][sdlog2.TIME]
    assert np.flatnonzero(times < 0).tolist() == [20]
    assert np.delete(times, 20).tolist() == [1_000_000 + 10_000 * k for k in range(40) if k != 20]
    assert len(log.damage) == log.damage_places == 1
    assert "time of a group" in log.damage[0].lost
    assert log.damage[0].offset == len(FORMS) + sum(map(len, groups[:20]))


def test_without_a_start_time_nothing_can_be_decoded(tmp_path: Path) -> None:
    for forms in (form(2, "IMU", "ff", "AccX,AccY"), FORMS.replace(b"StartTime", b"StartTine")):
        with pytest.raises(LogUnusable, match="no TIME record with StartTime"):
            read(tmp_path, forms, time(1), imu(1.0))
    blank = struct.pack("<BBBBB4s16s64s", 0xA3, 0x95, 128, 2, 11, b"IMU", b"ff", b"")
    with pytest.raises(LogUnusable, match="name no columns"):
        read(tmp_path, blank, imu(1.0))
