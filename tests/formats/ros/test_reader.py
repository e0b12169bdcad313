"""Bags of the official writers are read as their official readers read them."""

from __future__ import annotations

import sqlite3
from pathlib import Path

import numpy as np
import pytest

from attlog import formats
from attlog.base.errors import LogUnusable, NotALog, UsageError
from attlog.formats.verify import verify
from tests.formats.ros.bags import IMU, combined, decoded, header, write_mcap, write_sqlite, writing, xyz


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
    found = verify(tmp_path / "a.mcap")
    assert (found.agrees, found.records) == (True, 70)
    path = write_sqlite(tmp_path / "bag", combined())
    assert verify(path).agrees


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
