"""Cut, broken and made-up bags: what is whole is read, the rest is told, nothing ends with a traceback."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from attlog import formats
from attlog.base.errors import AttlogError, LogUnusable
from attlog.base.limits import UNPACKED_ANYWAY_BYTES
from attlog.formats.ros import mcap
from attlog.formats.ros.cdr import Layout
from attlog.formats.ros.detect import MCAP
from tests.formats.ros.bags import combined, encoder, write_mcap, write_sqlite


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


def test_a_broken_chunk_costs_only_itself(tmp_path: Path) -> None:
    path = tmp_path / "a.mcap"
    write_mcap(path, combined(400), "NONE", chunk=2000)
    raw = bytearray(path.read_bytes())
    raw[len(raw) // 3] ^= 0x55
    path.write_bytes(raw)
    log = formats.open(path)
    assert 340 < len(log["sensor_combined", 0]) < 400
    assert ["checksum" in damage.lost for damage in log.damage] == [True]


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
    end = next(at for at, opcode, _, _ in mcap._records(data, len(MCAP)) if opcode == mcap.DATA_END)
    path.write_bytes(data[:end])
    log = formats.open(path)
    assert (len(log["sensor_combined", 0]), [r.code for r in log.remarks]) == (40, ["cut_at_end"])


def test_a_chunk_that_unpacks_to_more_than_any_log_is_left_out(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(mcap, "UNPACKED_ANYWAY_BYTES", 1000)
    monkeypatch.setattr(mcap, "MAX_UNPACKED_RATIO", 0)
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
            Layout(types, "a/msg/A", b"\0\1\0\0" + bytes(9000))


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
