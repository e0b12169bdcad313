"""Bags of the official writers are read as their official readers read them."""

from __future__ import annotations

import sqlite3
import struct
from pathlib import Path

import numpy as np
import pytest

from attlog import formats
from attlog.core.errors import AttlogError, LogUnusable, NotALog, UsageError
from attlog.core.limits import UNPACKED_ANYWAY_BYTES
from attlog.formats.ros import bag
from attlog.formats.ros.bag import MCAP_MAGIC
from attlog.formats.ros.cdr import MessageLayoutCdr
from tests.formats.reference import differences
from tests.formats.ros.bags import (
    IMU,
    START_NS,
    combined,
    decoded,
    encoder,
    header,
    write_mcap,
    write_sqlite,
    writing,
    xyz,
)


def imus(n: int = 30, frames: tuple[str, ...] = ("imu_link",)) -> list[tuple[str, str, int, dict[str, object]]]:
    """IMU messages whose frames are named in turn."""
    rng = np.random.default_rng(2)
    return [
        (
            "/imu",
            IMU,
            5_000_000 * i,
            {
                "header": header(5_000_000 * i, frames[i % len(frames)]),
                "orientation": xyz([0, 0, 0, 1], "xyzw"),
                "orientation_covariance": [-1.0] + [0.0] * 8,
                "angular_velocity": xyz(rng.normal(size=3)),
                "angular_velocity_covariance": [0.0] * 9,
                "linear_acceleration": xyz(rng.normal(size=3)),
                "linear_acceleration_covariance": [0.0] * 9,
            },
        )
        for i in range(n)
    ]


@pytest.mark.parametrize("packed", ["NONE", "LZ4", "ZSTD"])
def test_px4_topics_have_the_names_and_columns_of_a_ulog(tmp_path: Path, packed: str) -> None:
    write_mcap(tmp_path / "a.mcap", combined(), packed, chunk=500)
    table = formats.open(tmp_path / "a.mcap")["sensor_combined", 0]
    theirs = decoded(tmp_path / "a.mcap")
    assert len(table) == len(theirs) == 40
    for column in ("timestamp", "gyro_rad", "accelerometer_m_s2", "accelerometer_timestamp_relative"):
        np.testing.assert_array_equal(table[column], np.array([getattr(m, column) for m in theirs]))
    assert table["gyro_rad"].dtype == np.float32


@pytest.mark.slow
def test_the_official_library_agrees_value_by_value(tmp_path: Path) -> None:
    write_mcap(tmp_path / "a.mcap", combined() + imus())
    assert differences(tmp_path / "a.mcap") == []
    path = write_sqlite(tmp_path / "bag", combined())
    assert differences(path) == []


def test_texts_of_several_lengths_move_the_numbers_behind_them(tmp_path: Path) -> None:
    write_mcap(tmp_path / "a.mcap", imus(frames=("imu", "base_link", "world", "")))
    table = formats.open(tmp_path / "a.mcap")["/imu", 0]
    theirs = decoded(tmp_path / "a.mcap")
    assert len(table) == 30
    np.testing.assert_array_equal(table["angular_velocity.y"], [m.angular_velocity.y for m in theirs])
    np.testing.assert_array_equal(table["header.stamp.nanosec"], [m.header.stamp.nanosec for m in theirs])


def test_a_sqlite_bag_is_read_like_an_mcap_bag(tmp_path: Path) -> None:
    write_mcap(tmp_path / "a.mcap", combined())
    path = write_sqlite(tmp_path / "bag", combined())
    one, other = (formats.open(p)["sensor_combined", 0] for p in (tmp_path / "a.mcap", path))
    assert formats.recognise(path) == "ros"
    for column in one.fields:
        np.testing.assert_array_equal(one[column], other[column])


def test_a_sqlite_bag_without_definitions_says_to_record_mcap(tmp_path: Path) -> None:
    path = write_sqlite(tmp_path / "bag", combined())
    with sqlite3.connect(path) as database:
        database.execute("delete from message_definitions")
    with pytest.raises(LogUnusable, match="record it as MCAP"):
        formats.open(path)


def test_another_programs_database_is_no_log(tmp_path: Path) -> None:
    with sqlite3.connect(tmp_path / "a.db") as database:
        database.execute("create table topics (id integer)")
    with pytest.raises(NotALog):
        formats.open(tmp_path / "a.db")


def test_a_bag_of_ros_1_is_told_how_to_be_converted(tmp_path: Path) -> None:
    (tmp_path / "a.bag").write_bytes(b"#ROSBAG V2.0\n" + bytes(100))
    with pytest.raises(NotALog, match="rosbags-convert"):
        formats.open(tmp_path / "a.bag")


def test_mcap_of_other_messages_is_refused_with_their_encoding(tmp_path: Path) -> None:
    with (tmp_path / "a.mcap").open("wb") as file:
        writer = writing.Writer(file)
        writer.start()
        schema = writer.register_schema("foxglove.Log", "jsonschema", b"{}")
        channel = writer.register_channel("/log", "json", schema)
        writer.add_message(channel, 1, b"{}", 1)
        writer.finish()
    with pytest.raises(LogUnusable, match=r"without messages of ROS 2 \(it holds json\)"):
        formats.open(tmp_path / "a.mcap")


def test_of_two_vehicles_the_one_with_most_messages_is_read_or_the_one_asked_for(tmp_path: Path) -> None:
    two = combined(40, "/px4_1/fmu/out/sensor_combined", 3) + combined(20, "/px4_2/fmu/out/sensor_combined_v1", 4)
    write_mcap(tmp_path / "a.mcap", two)
    log = formats.open(tmp_path / "a.mcap")
    assert len(log["sensor_combined", 0]) == 40
    assert [r.text for r in log.remarks] == ["The bag holds 2 vehicles; this is /px4_1. --system chooses another (2)."]
    assert len(formats.open(tmp_path / "a.mcap", system=2)["sensor_combined", 0]) == 20
    with pytest.raises(UsageError, match="no system 3; the bag holds 1"):
        formats.open(tmp_path / "a.mcap", system=3)


def test_one_file_of_a_split_bag_says_so(tmp_path: Path) -> None:
    write_mcap(tmp_path / "x_0.mcap", combined())
    (tmp_path / "metadata.yaml").write_text("info:\n  relative_file_paths:\n    - x_0.mcap\n    - x_1.mcap\n")
    assert "one of the 2 files" in formats.open(tmp_path / "x_0.mcap").remarks[0].text


def test_without_the_packages_the_sentence_names_them(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    write_mcap(tmp_path / "a.mcap", combined())
    monkeypatch.setitem(__import__("sys").modules, "mcap.records", None)
    with pytest.raises(UsageError, match="pip install"):
        formats.open(tmp_path / "a.mcap")


# Where the fields of a message lie: both byte orders, XCDR 1 and 2, against messages packed by hand.

rosbags = pytest.importorskip("rosbags.typesys")
KIND = "made_msgs/msg/Made"
TEXT = "uint8 a\nfloat64 b\nstring s\nint16 c\nfloat32[3] v\nuint64 e"


def message(second: int) -> bytes:
    """A message with the second byte ``second``: numbers stand at multiples of their size, of 4 at most in XCDR 2."""
    order = "<" if second & 1 else ">"
    most = 8 if second < 2 else 4
    out = b""
    for kind, values in (
        ("B", [7]),
        ("d", [-2.5]),
        ("I", [3]),
        ("3s", [b"ab\0"]),
        ("h", [-300]),
        ("f", [1.5, 2.5, 3.5]),
    ):
        for value in values:
            size = 1 if kind == "3s" else min(struct.calcsize(kind), most)
            out += bytes(-len(out) % size) + struct.pack(order + kind, value)
    out += bytes(-len(out) % min(8, most)) + struct.pack(order + "Q", 2**40 + 5)
    return bytes([0, second, 0, 0]) + out


@pytest.mark.parametrize("second", [0, 1, 6, 7])
def test_fields_lie_where_byte_order_and_alignment_put_them(second: int) -> None:
    types = rosbags.get_types_from_msg(TEXT, KIND)
    layout = MessageLayoutCdr(types, KIND, message(second))
    rows = np.frombuffer(message(second), np.uint8).reshape(1, -1)
    told = {name: layout.column(rows, name)[0] for name in layout.fields()}
    assert (told["a"], told["b"], told["c"], told["e"]) == (7, -2.5, -300, 2**40 + 5)
    assert told["v"].tolist() == [1.5, 2.5, 3.5]


@pytest.mark.parametrize("second", [2, 3, 8, 9, 10, 11])
def test_a_message_with_tags_is_refused(second: int) -> None:
    """Parameter lists (2, 3) and what XCDR 2 delimits (8 to 11) have members with headers of their own."""
    types = rosbags.get_types_from_msg(TEXT, KIND)
    with pytest.raises(ValueError, match="plain CDR"):
        MessageLayoutCdr(types, KIND, message(second))


# Cut, broken and made-up bags: what is whole is read, the rest is told, nothing ends with a traceback.


@pytest.mark.parametrize("packed", ["NONE", "ZSTD"])
def test_a_bag_without_its_end_gives_what_stands_before_the_cut(tmp_path: Path, packed: str) -> None:
    path = tmp_path / "a.mcap"
    write_mcap(path, combined(400), packed, chunk=2000)
    whole = formats.open(path)["sensor_combined", 0]["gyro_rad"]
    raw = path.read_bytes()
    counts = []
    for share in (0.2, 0.4, 0.6):
        path.write_bytes(raw[: int(share * len(raw))])
        log = formats.open(path)
        cut = log["sensor_combined", 0]["gyro_rad"]
        np.testing.assert_array_equal(cut, whole[: len(cut)])
        assert log.damage[0].lost.endswith("the last record, which is cut")
        assert log.damage_bytes == log.damage[0].length > 0
        counts.append(len(cut))
    assert 40 < counts[0] < counts[1] < counts[2] < 400


@pytest.mark.parametrize("packed", ["NONE", "LZ4", "ZSTD"])
def test_a_broken_chunk_costs_only_itself(tmp_path: Path, packed: str) -> None:
    path = tmp_path / "a.mcap"
    write_mcap(path, combined(400), packed, chunk=2000)
    raw = bytearray(path.read_bytes())
    raw[len(raw) // 3] ^= 0x55
    path.write_bytes(raw)
    log = formats.open(path)
    assert 340 < len(log["sensor_combined", 0]) < 400
    assert ["a chunk" in damage.lost for damage in log.damage] == [True]


def test_what_a_chunk_loses_is_told_in_words_of_no_library(tmp_path: Path) -> None:
    path = tmp_path / "a.mcap"
    write_mcap(path, combined(40), "ZSTD")
    raw = bytearray(path.read_bytes())
    begin = raw.index(b"\x28\xb5\x2f\xfd")
    raw[begin + 6 : begin + 40] = b"\xff" * 34
    path.write_bytes(raw)
    with pytest.raises(LogUnusable, match="its zstd bytes are damaged"):
        formats.open(path)


def test_messages_whose_channel_no_record_defines_are_counted(tmp_path: Path) -> None:
    path = tmp_path / "a.mcap"
    write_mcap(path, combined(40), "NONE")
    data = path.read_bytes()
    begin = next(at for at, kind, _, _ in bag._records(memoryview(data), 8) if kind == bag.CHUNK)
    foreign = struct.pack("<BQ", bag.MESSAGE, 22 + 4) + struct.pack("<HIQQ", 999, 0, START_NS, START_NS) + b"lost"
    path.write_bytes(data[:begin] + 3 * foreign + data[begin:])
    log = formats.open(path)
    assert len(log["sensor_combined", 0]) == 40
    assert [(r.code, r.count) for r in log.remarks] == [("unreadable_message", 3)]


def test_a_message_beyond_the_calendar_costs_only_itself(tmp_path: Path) -> None:
    messages = combined(60)
    topic, kind, _, values = messages[30]
    messages[30] = (topic, kind, 2**63 - START_NS, values)
    write_mcap(tmp_path / "a.mcap", messages)
    log = formats.open(tmp_path / "a.mcap")
    assert len(log["sensor_combined", 0]) == 59
    assert [(r.code, r.count) for r in log.remarks] == [("false_times", 1)]


def test_definitions_that_a_broken_chunk_held_are_taken_from_the_end(tmp_path: Path) -> None:
    path = tmp_path / "a.mcap"
    write_mcap(path, combined(400), "NONE", chunk=2000)
    raw = bytearray(path.read_bytes())
    raw[raw.index(b"float32[3] gyro_rad")] ^= 0x55
    path.write_bytes(raw)
    assert 340 < len(formats.open(path)["sensor_combined", 0]) < 400


def test_a_bag_cut_between_records_says_that_it_has_no_end(tmp_path: Path) -> None:
    path = tmp_path / "a.mcap"
    write_mcap(path, combined(40), "NONE")
    data = memoryview(path.read_bytes())
    end = next(at for at, opcode, _, _ in bag._records(data, len(MCAP_MAGIC)) if opcode == bag.DATA_END)
    path.write_bytes(data[:end])
    log = formats.open(path)
    assert (len(log["sensor_combined", 0]), [r.code for r in log.remarks]) == (40, ["cut_at_end"])


def test_a_chunk_that_unpacks_to_more_than_any_log_is_left_out(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(bag, "UNPACKED_ANYWAY_BYTES", 1000)
    monkeypatch.setattr(bag, "MAX_UNPACKED_RATIO", 0)
    assert UNPACKED_ANYWAY_BYTES > 1000
    write_mcap(tmp_path / "a.mcap", combined(400))
    with pytest.raises(LogUnusable, match="without readable topics"):
        formats.open(tmp_path / "a.mcap")


def test_a_bag_without_messages_is_refused(tmp_path: Path) -> None:
    write_mcap(tmp_path / "a.mcap", [])
    with pytest.raises(LogUnusable, match="no messages"):
        formats.open(tmp_path / "a.mcap")


def test_messages_of_a_definition_that_none_can_read_are_told(tmp_path: Path) -> None:
    with (tmp_path / "a.mcap").open("wb") as file:
        writer = encoder.Writer(file)
        good = combined()
        schema = writer.register_msgdef(good[0][1], "uint64 timestamp\nuint32 gyro_integral_dt\n")
        for _, _, ns, values in good:
            writer.write_message("/fmu/out/sensor_combined", schema, values, ns, ns)
        official = writer._writer
        broken = official.register_schema("px4_msgs/msg/Broken", "ros2msg", b"uint64 [ timestamp\n}{")
        official.add_message(official.register_channel("/fmu/out/broken", "cdr", broken), 1, b"\0\1\0\0", 1)
        writer.finish()
    log = formats.open(tmp_path / "a.mcap")
    assert log.names() == ["sensor_combined"]
    assert [r.code for r in log.remarks] == ["unreadable_message"]


def test_definitions_without_end_are_refused() -> None:
    circle = {"a/msg/A": ([], [("b", (2, "a/msg/A"))])}
    many = {"a/msg/A": ([], [(f"b{i}", (1, ("uint8", 0))) for i in range(5000)])}
    for types in (circle, many):
        with pytest.raises(ValueError, match=r"too deeply|more than"):
            MessageLayoutCdr(types, "a/msg/A", b"\0\1\0\0" + bytes(9000))


@pytest.mark.parametrize("kind", ["mcap", "db3"])
def test_random_bytes_and_random_errors_end_in_a_sentence(tmp_path: Path, kind: str) -> None:
    path = tmp_path / "a.mcap"
    if kind == "mcap":
        write_mcap(path, combined(60), "NONE", chunk=1500)
    else:
        path = write_sqlite(tmp_path / "bag", combined(60))
    raw, rng = np.frombuffer(path.read_bytes(), np.uint8), np.random.default_rng(5)
    opened = 0
    for k in range(60):
        broken = raw.copy()
        if k % 10 == 0:
            broken = np.concatenate([raw[:100], rng.integers(0, 256, 3000, np.uint8)])
        else:
            at = rng.integers(40, len(raw), 1 + k)
            broken[at] = rng.integers(0, 256, len(at))
        path.write_bytes(broken.tobytes())
        try:
            log = formats.open(path)
            opened += 1
            for table in log.values():
                for column in list(table.fields):
                    assert len(table[column]) == len(table)
        except AttlogError:
            continue
    assert opened > 5
