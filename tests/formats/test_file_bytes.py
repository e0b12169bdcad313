"""The bytes of a log: strings, gathered records, gzip files, wide offsets, and memory."""

from __future__ import annotations

import gc
import gzip
import weakref
import zlib
from pathlib import Path

import numpy as np
import pytest

from attlog import formats
from attlog.core.errors import LogUnreadable, LogUnusable, NotALog
from attlog.formats import file_bytes
from attlog.formats.dataflash import walk as dataflash_walk
from attlog.formats.file_bytes import decode_text, decode_texts, gather, offset_type, offsets_by_kind
from attlog.formats.mavlink import walk as mavlink_walk
from attlog.formats.table import Messages
from attlog.formats.ulog import reader as ulog_reader
from attlog.formats.ulog import walk as ulog_walk
from tests.conftest import SAMPLES, few


@pytest.mark.parametrize(
    ("raw", "text"),
    [
        (b"plain\0rest", "plain"),
        ("Höhe 5 µT".encode(), "Höhe 5 µT"),
        ("Höhe 5 µT".encode("latin-1"), "Höhe 5 µT"),
        (b"\xff\xfe", "ÿþ"),
    ],
)
def test_a_text_is_utf_8_or_else_latin_1_up_to_its_end(raw: bytes, text: str) -> None:
    assert decode_text(raw) == text
    assert decode_texts(np.array([b"GPS", raw, b""])) == ["GPS", text, ""]


@pytest.mark.parametrize("kinds", [1, 7, 300])
def test_records_of_a_kind_stay_in_file_order(kinds: int) -> None:
    rng = np.random.default_rng(kinds)
    offsets = np.cumsum(rng.integers(1, 99, 5000)).astype(np.int32)
    kind = rng.integers(0, kinds, 5000).astype(np.uint16) * np.uint16(65535 // kinds)
    found = offsets_by_kind([(offsets[:3], kind[:3]), (offsets[3:], kind[3:])])
    assert [k for k, _ in found] == sorted({*kind.tolist()})
    for k, mine in found:
        assert mine.tolist() == [at for at, this in zip(offsets.tolist(), kind.tolist(), strict=True) if this == k]


@pytest.mark.parametrize("size", [1, 2, 8, 15, 16, 17, 44, 300])
def test_bytes_are_copied_from_any_place_up_to_the_last(size: int) -> None:
    rng = np.random.default_rng(size)
    data = rng.integers(0, 256, 2000).astype(np.uint8)
    at = np.append(rng.integers(0, 2001 - size, 500), 2000 - size).astype(np.int32)
    rows = gather(data, at, np.dtype((np.uint8, (size,))))
    assert rows.tobytes() == b"".join(data[k : k + size].tobytes() for k in at.tolist())


@pytest.mark.parametrize("place", [1985, 2**31 - 1])
def test_a_place_outside_the_file_is_refused_not_read(place: int) -> None:
    with pytest.raises(IndexError):
        gather(np.zeros(2000, np.uint8), np.array([0, place], np.int32), np.dtype("S16"))


# Logs inside gzip files: read as pyulog reads the unpacked log, as far as they are sound, and never without limit.

LOGS = ["px4_steps.ulg", "copter_steps_stabilize.bin", "copter_steps_stabilize.tlog"]


def same(one: Messages, other: Messages) -> bool:
    """Whether two readings hold the same records, bit by bit."""
    return list(one) == list(other) and all(
        np.array_equal(table.offsets, other[key].offsets)
        and all(table[f].tobytes() == other[key][f].tobytes() for f in table.fields)
        for key, table in one.items()
    )


@pytest.mark.parametrize("name", LOGS)
def test_a_compressed_log_of_any_name_reads_like_the_log(name: str, tmp_path: Path) -> None:
    path = tmp_path / "anything"
    path.write_bytes(gzip.compress((SAMPLES / name).read_bytes(), 1))
    log, plain = formats.open(path), formats.open(SAMPLES / name)
    assert formats.recognise(path) == plain.format == log.format
    assert same(log, plain)
    assert (log.size, log.damage, log.boots, log.params) == (plain.size, plain.damage, plain.boots, plain.params)


def test_a_cut_gzip_file_gives_what_was_packed_before_the_cut(tmp_path: Path) -> None:
    raw = (SAMPLES / "px4_steps.ulg").read_bytes()
    packed = gzip.compress(raw, 6)[:-300_000]
    expected = zlib.decompressobj(31).decompress(packed)
    (tmp_path / "cut.ulg.gz").write_bytes(packed)
    (tmp_path / "cut.ulg").write_bytes(expected)
    log, plain = formats.open(tmp_path / "cut.ulg.gz"), formats.open(tmp_path / "cut.ulg")
    assert log.size == len(expected)
    assert raw.startswith(expected)
    assert same(log, plain)
    assert [d for d in log.damage if d not in plain.damage] == [log.damage[0]]
    assert "ends early" in log.damage[0].lost
    assert log.damage[0].offset == len(expected)


def test_a_damaged_gzip_file_gives_what_stands_before_the_damage(tmp_path: Path) -> None:
    raw = (SAMPLES / "px4_steps.ulg").read_bytes()
    packed = bytearray(gzip.compress(raw, 6))
    half = len(packed) // 2
    packed[half : half + 400] = bytes(400)
    (tmp_path / "hurt.ulg.gz").write_bytes(packed)
    log = formats.open(tmp_path / "hurt.ulg.gz")
    assert "gzip file is damaged" in log.damage[0].lost
    before = len(zlib.decompressobj(31).decompress(bytes(packed[:half])))
    assert log.size >= before > 0.3 * len(raw)


def test_a_wrong_checksum_costs_no_record_but_is_told(tmp_path: Path) -> None:
    packed = bytearray(gzip.compress((SAMPLES / "px4_steps.ulg").read_bytes(), 1))
    packed[-8] ^= 0xFF
    (tmp_path / "sum.gz").write_bytes(packed)
    log = formats.open(tmp_path / "sum.gz")
    assert same(log, formats.open(SAMPLES / "px4_steps.ulg"))
    assert [d.lost for d in log.damage] == ["the rest of the log, because its gzip file is damaged"]


def test_members_are_joined_zeros_behind_them_ignored_and_junk_told(tmp_path: Path) -> None:
    raw = (SAMPLES / "px4_steps.ulg").read_bytes()
    third = len(raw) // 3
    members = b"".join(gzip.compress(part, 1) for part in (raw[:third], raw[third:]))
    for tail, damages in [(b"", 0), (bytes(70_000), 0), (b"junk" * 30, 1)]:
        (tmp_path / "x.gz").write_bytes(members + tail)
        log = formats.open(tmp_path / "x.gz")
        assert same(log, formats.open(SAMPLES / "px4_steps.ulg"))
        assert len(log.damage) == damages


def test_a_bomb_is_refused_before_it_fills_the_disk(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    log = (SAMPLES / "px4_steps.ulg").read_bytes()[:500_000]
    (tmp_path / "bomb.ulg.gz").write_bytes(gzip.compress(log + bytes(100_000_000), 9))
    written = []
    monkeypatch.setattr(file_bytes, "UNPACKED_ANYWAY_BYTES", 1 << 20)
    monkeypatch.setattr(file_bytes, "map_open_file", lambda *_: written.append(1))
    with pytest.raises(LogUnusable, match="unpacks to more than") as caught:
        formats.open(tmp_path / "bomb.ulg.gz")
    assert caught.value.exit_code == 65
    assert not written
    monkeypatch.setattr(file_bytes, "MAX_UNPACKED_BYTES", 1 << 19)
    with pytest.raises(LogUnusable, match="more than 0 MB"):
        formats.open(tmp_path / "bomb.ulg.gz")


@pytest.mark.parametrize("content", [b"", b"\x1f\x8b", b"\x1f\x8b\x08" + bytes(500), b"\x1f\x8bjunk" * 50])
def test_what_unpacks_to_nothing_is_no_log(content: bytes, tmp_path: Path) -> None:
    (tmp_path / "x.gz").write_bytes(content)
    with pytest.raises(NotALog):
        formats.open(tmp_path / "x.gz")


def test_nothing_is_left_in_the_temporary_folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    import tempfile

    (tmp_path / "temporary").mkdir()
    monkeypatch.setattr(tempfile, "tempdir", str(tmp_path / "temporary"))
    (tmp_path / "x.gz").write_bytes(gzip.compress((SAMPLES / "px4_steps.ulg").read_bytes(), 1))
    log = formats.open(tmp_path / "x.gz")
    assert len(log["sensor_combined", 0]["timestamp"]) > 1000
    assert list((tmp_path / "temporary").iterdir()) == []


def test_a_system_without_a_temporary_folder_is_told(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A container whose file system is read-only: plain logs are read all the same."""
    import tempfile

    monkeypatch.setattr(tempfile, "tempdir", None)
    monkeypatch.setattr(tempfile, "_candidate_tempdir_list", lambda: [str(tmp_path / "nowhere")])
    packed, plain = tmp_path / "x.gz", SAMPLES / "px4_steps.ulg"
    packed.write_bytes(gzip.compress(plain.read_bytes(), 1))
    with pytest.raises(LogUnreadable, match=r"x\.gz: no temporary folder to unpack it in"):
        formats.open(packed)
    assert len(formats.open(plain)["sensor_combined", 0]["timestamp"]) > 1000


# Files above 2 GB are indexed in 64-bit offsets; what is read does not depend on the width.


@pytest.mark.parametrize("name", ["copter_steps_stabilize.bin", "copter_steps_stabilize.tlog", "px4_hover.ulg"])
def test_offsets_of_both_widths_give_the_same_log(
    name: str, samples: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    raw = bytearray((samples / name).read_bytes()[:400_000])
    raw[200_000:200_100] = bytes(100)
    path = tmp_path / name
    path.write_bytes(raw)
    narrow = formats.open(path)
    for module in (dataflash_walk, mavlink_walk, ulog_walk, ulog_reader):
        monkeypatch.setattr(module, "offset_type", lambda size: np.int64)
    wide = formats.open(path)
    assert narrow.keys() == wide.keys()
    assert narrow.damage == wide.damage != []
    for key, table in narrow.items():
        assert (table.offsets.dtype, wide[key].offsets.dtype) == (np.int32, np.int64)
        assert np.array_equal(table.offsets, wide[key].offsets)
        for column in table.fields:
            assert table[column].tobytes() == wide[key][column].tobytes()


def test_offsets_hold_the_end_of_a_record_that_begins_at_the_end() -> None:
    for size in (1, 1 << 30, (1 << 31) - 70_000, 1 << 31, 5 << 30):
        assert size + 65_538 <= np.iinfo(offset_type(size)).max


# A log's bytes go with its messages at once: those that wait for the collector of cycles are held twice.


@pytest.mark.parametrize("name", few(["px4_steps.ulg", "copter_yaw_turns.bin", "copter_steps_stabilize.tlog"], 1))
def test_the_bytes_of_a_log_are_let_go_of_with_its_messages(monkeypatch, name):
    read, seen = np.fromfile, []

    def noted(*args, **options):
        data = read(*args, **options)
        seen.append(weakref.ref(data))
        return data

    monkeypatch.setattr(np, "fromfile", noted)
    gc.collect()
    gc.disable()
    try:
        messages = formats.open(SAMPLES / name)
        assert messages.size
        assert [data() is not None for data in seen] == [True]
        del messages
        assert [data() for data in seen] == [None]
    finally:
        gc.enable()
