"""One recording for all writers: what comes back, what is refused, the same bytes every time."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from attlog import formats
from attlog.core.errors import OutputError, UsageError
from attlog.formats import MessageLayout, ParamChange, Recording, Text
from attlog.formats.recording import MERGED_ROWS, fit_to_type, merge_records

TIME = np.arange(1, 101, dtype=np.uint64) * 10_000
CLOCK = {".ulg": "timestamp", ".bin": "TimeUS", ".tlog": "_t_us"}


def recording(suffix: str, **more: Any) -> Recording:
    """Two instances of an inertial message."""
    name, column = {".ulg": ("imu", "x"), ".bin": ("IMU", "GyrX"), ".tlog": ("ATTITUDE", "roll")}[suffix]
    messages = {}
    for k in (0, 1):
        columns = {CLOCK[suffix]: TIME + np.uint64(k), column: np.linspace(-1, k, 100).astype(np.float32)}
        if suffix == ".bin":
            columns["I"] = np.full(100, k, np.uint8)
        messages[name, 257 + k if suffix == ".tlog" else k] = columns
    return Recording(messages, **more)


@pytest.mark.parametrize("suffix", CLOCK)
def test_the_suffix_chooses_the_writer_and_everything_comes_back(suffix: str, tmp_path: Path) -> None:
    params = [ParamChange("GAIN", 0.5), ParamChange("COUNT", 7, 500_000)]
    texts = [Text("armed", 6), Text("failsafe " * 7, 4, 500_000)]
    written = recording(suffix, params=params, texts=texts, start_us=5000)
    formats.write(tmp_path / f"a{suffix.upper()}", written)
    log = formats.open(tmp_path / f"a{suffix.upper()}")
    assert log.damage == []
    for key, columns in written.messages.items():
        for name, values in columns.items():
            np.testing.assert_array_equal(log[key][name], values)
    assert [(p.name, p.value) for p in log.params] == [("GAIN", 0.5), ("COUNT", 7)]
    assert [x.text.strip() for x in log.texts] == ["armed", ("failsafe " * 7).strip()]


@pytest.mark.parametrize("suffix", CLOCK)
def test_the_same_recording_gives_the_same_bytes(suffix: str, tmp_path: Path) -> None:
    for name in ("a", "b"):
        formats.write(tmp_path / f"{name}{suffix}", recording(suffix, params=[ParamChange("A", 1)]))
    assert (tmp_path / f"a{suffix}").read_bytes() == (tmp_path / f"b{suffix}").read_bytes()


@pytest.mark.parametrize("name", ["a.log", "a", "a.ulg.gz"])
def test_other_suffixes_are_refused(name: str, tmp_path: Path) -> None:
    with pytest.raises(UsageError, match=r"ULog \.ulg, DataFlash \.bin, ROS 2 bag \.mcap, MAVLink \.tlog"):
        formats.write(tmp_path / name, recording(".ulg"))
    with pytest.raises(UsageError, match="reads DataFlash text logs and does not write them"):
        formats.format_named("dataflash_text").write(tmp_path / name, recording(".ulg"))


@pytest.mark.parametrize("suffix", CLOCK)
def test_a_refused_recording_leaves_the_old_file(suffix: str, tmp_path: Path) -> None:
    path = tmp_path / f"a{suffix}"
    path.write_text("before")
    name = "ATTITUDE" if suffix == ".tlog" else "A"
    clock = CLOCK[suffix]
    for columns, reason in [
        ({"x": np.zeros(3)}, f"needs a column {clock}"),
        ({clock: np.zeros(3, np.uint64), "x": np.zeros(4)}, "not one value for each"),
        ({clock: np.zeros(3), "x": np.zeros(3)}, "whole microseconds"),
        ({clock: np.full(3, 2**63, np.uint64), "x": np.zeros(3)}, "63 bits"),
        ({clock: np.full(3, -1), "x": np.zeros(3)}, "negative"),
    ]:
        with pytest.raises(UsageError, match=reason):
            formats.write(path, Recording({(name, 0): columns}))
    with pytest.raises(UsageError, match="layout but is no message"):
        formats.write(path, recording(suffix, layouts={"NONE": MessageLayout("Q")}))
    assert path.read_text() == "before"
    with pytest.raises(OutputError):
        formats.write(path / f"a{suffix}", recording(suffix))


@pytest.mark.parametrize(
    ("suffix", "more", "reason"),
    [
        (".ulg", {"layouts": {"imu": MessageLayout("Qf")}}, "no letters"),
        (".ulg", {"layouts": {"imu": MessageLayout(nested={"esc": "report"})}}, "nested type of 'esc'"),
        (".ulg", {"params": [ParamChange("A", 2**31)]}, "32 bits"),
        (".ulg", {"info": {"a": 2**31}}, "32 bits"),
        (".ulg", {"info": {"a" * 300: 1}}, "255 bytes"),
        (".ulg", {"texts": [Text("a", 8)]}, "level is 0 to 7"),
        (".ulg", {"texts": [Text("a" * 70_000, 1)]}, "65535"),
        (".bin", {"info": {"sys_name": "x"}}, "no place for the info 'sys_name'"),
        (".bin", {"params": [ParamChange("A" * 17, 1)]}, "16 characters"),
        (".bin", {"params": [ParamChange("A", 1, is_default=True)]}, "default without its parameter"),
        (".bin", {"layouts": {"IMU": MessageLayout("Qf")}}, "do not fit 3 columns"),
        (".bin", {"layouts": {"IMU": MessageLayout("QfB", "sE", "F-")}}, "units 'sE' are not 3"),
        (".bin", {"layouts": {"IMU": MessageLayout("QfB", "sEx", "F--")}}, "known ids"),
        (".bin", {"layouts": {"IMU": MessageLayout("QfB", "sE#", "F")}}, "multipliers 'F' are not 3"),
        (".bin", {"layouts": {"IMU": MessageLayout(nested={"esc": "report"})}}, "no nested types"),
        (".tlog", {"info": {"sys_name": "x"}}, "no place for the info 'sys_name'"),
        (".tlog", {"info": {"system": 256}}, "0 to 255"),
        (".tlog", {"layouts": {"ATTITUDE": MessageLayout("f")}}, "layout of"),
        (".tlog", {"params": [ParamChange("A", 1, is_default=True)]}, "default of 'A'"),
        (".tlog", {"params": [ParamChange("A", 2**24 + 1)]}, "as a float"),
        (".tlog", {"texts": [Text("a" * 12_801, 1)]}, "256 chunks"),
        (".tlog", {"texts": [Text("a", 256)]}, "does not fit uint8"),
    ],
)
def test_what_a_format_has_no_place_for_is_refused(suffix: str, more: dict, reason: str, tmp_path: Path) -> None:
    with pytest.raises(UsageError, match=reason):
        formats.write(tmp_path / f"a{suffix}", recording(suffix, **more))
    assert list(tmp_path.iterdir()) == []


def test_an_instance_must_be_told_by_its_records(tmp_path: Path) -> None:
    columns = {"TimeUS": TIME, "GyrX": np.zeros(100)}
    with pytest.raises(UsageError, match="needs a column with its number"):
        formats.write(tmp_path / "a.bin", Recording({("IMU", 1): columns}))
    with pytest.raises(UsageError, match="not all of it is 1"):
        formats.write(tmp_path / "a.bin", Recording({("IMU", 1): columns | {"I": np.zeros(100, np.uint8)}}))
    both = {("IMU", 0): columns | {"I": np.zeros(100, np.uint8)}, ("IMU", 1): columns}
    with pytest.raises(UsageError, match="same columns"):
        formats.write(tmp_path / "a.bin", Recording(both))
    log = Recording(
        {("OWN", 1): columns | {"N": np.ones(100, np.uint8)}}, layouts={"OWN": MessageLayout("", "sE#", "F--")}
    )
    formats.write(tmp_path / "a.bin", log)
    assert list(formats.open(tmp_path / "a.bin").instances("OWN")) == [1]


def test_nested_members_are_written_as_pyulog_reads_them(tmp_path: Path) -> None:
    from pyulog import ULog

    columns: dict[str, np.ndarray] = {"timestamp": TIME, "counter": np.arange(100, dtype=np.uint16)}
    for k in range(3):
        columns[f"esc[{k}].timestamp"] = TIME - np.uint64(5)
        columns[f"esc[{k}].esc_rpm"] = np.arange(100, dtype=np.int32) * (k + 1)
    columns["last.flags"] = np.ones(100, np.uint8)
    layout = MessageLayout(nested={"esc": "esc_report"})
    formats.write(tmp_path / "a.ulg", Recording({("esc_status", 0): columns}, layouts={"esc_status": layout}))
    mine = formats.open(tmp_path / "a.ulg")["esc_status", 0]
    theirs = ULog(str(tmp_path / "a.ulg"))
    assert list(mine.fields) == list(columns)
    assert list(theirs.message_formats) == ["esc_report", "esc_status_last", "esc_status"]
    for name, values in columns.items():
        np.testing.assert_array_equal(mine[name], values)
        np.testing.assert_array_equal(theirs.get_dataset("esc_status").data[name], values)


def test_nested_members_that_are_no_array_of_one_type_are_refused(tmp_path: Path) -> None:
    base = {"timestamp": TIME}
    for columns, reason in [
        ({"e[1].a": np.zeros(100)}, "numbered"),
        ({"e[0].a": np.zeros(100), "e[1].b": np.zeros(100)}, "same columns"),
        ({"e[0].a": np.zeros(100), "x": np.zeros(100), "e[1].a": np.zeros(100)}, "follow each other"),
        ({"e[x].a": np.zeros(100)}, "not a ULog field name"),
    ]:
        with pytest.raises(UsageError, match=reason):
            formats.write(tmp_path / "a.ulg", Recording({("t", 0): base | columns}))


def test_parameters_and_texts_of_a_tlog_are_what_pymavlink_reads(tmp_path: Path) -> None:
    from pymavlink import mavutil

    beats = {"_t_us": TIME[:1], "autopilot": np.array([3])}
    exact = "x" * 100
    written = Recording(
        {("HEARTBEAT", 0x0207): beats},
        [ParamChange("INT", -3), ParamChange("LONG_NAME_OF_16_", 0.25)],
        [Text("short", 4), Text(exact, 5), Text("and a long one " * 8, 3)],
        {"system": 2, "component": 7},
    )
    formats.write(tmp_path / "a.tlog", written)
    link = mavutil.mavlink_connection(str(tmp_path / "a.tlog"))
    found = []
    while (message := link.recv_match()) is not None:
        found.append(message)
    assert {(m.get_srcSystem(), m.get_srcComponent()) for m in found} == {(2, 7)}
    assert [m.get_seq() for m in found] == list(range(len(found)))
    params = [m for m in found if m.get_type() == "PARAM_VALUE"]
    assert [(m.param_id, m.param_value, m.param_type, m.param_index, m.param_count) for m in params] == [
        ("INT", -3.0, 6, 0, 2),
        ("LONG_NAME_OF_16_", 0.25, 9, 1, 2),
    ]
    log = formats.open(tmp_path / "a.tlog")
    assert [(x.text, x.level) for x in log.texts] == [("short", 4), (exact, 5), ("and a long one " * 8, 3)]


def test_px4_sends_whole_parameters_as_bits(tmp_path: Path) -> None:
    beats = {"_t_us": TIME[:1], "autopilot": np.array([12])}
    big = 2**31 - 5
    formats.write(tmp_path / "a.tlog", Recording({("HEARTBEAT", 257): beats}, [ParamChange("A", big)]))
    assert [p.value for p in formats.open(tmp_path / "a.tlog").params] == [big]


def test_a_value_is_stored_rounded_or_not_at_all() -> None:
    assert fit_to_type(np.array([1.6, -1.4]), np.dtype("i2"), "x").tolist() == [2, -1]
    assert fit_to_type(np.array([2**63], np.uint64), np.dtype("u8"), "x").tolist() == [2**63]
    for values, kind in [
        (np.array([32768.0]), "i2"),
        (np.array([-1]), "u1"),
        (np.array([np.nan]), "i4"),
        (np.array([1e39]), "f4"),
        (np.array([2.0**63]), "i8"),
        (np.array([b"abcde"]), "S4"),
        (np.zeros((1, 2)), "f4"),
        (np.array([b"1"]), "f4"),
    ]:
        with pytest.raises(UsageError, match="x: "):
            fit_to_type(values, np.dtype(kind), "x")
    assert np.isnan(fit_to_type(np.array([np.nan]), np.dtype("f4"), "x"))[0]


def test_records_are_merged_alike_in_one_step_and_in_several() -> None:
    n = 2 * MERGED_ROWS + 7
    rng = np.random.default_rng(2)
    rows, time = rng.integers(0, 256, (n, 5)).astype(np.uint8), rng.integers(0, n, n)
    lengths = rng.integers(1, 6, n)
    order = np.argsort(time, kind="stable")
    expected = b"".join(rows[k, : lengths[k]].tobytes() for k in order)
    assert merge_records([rows], [time], [lengths]) == expected
