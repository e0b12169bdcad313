"""Damaged DataFlash logs: what is intact comes back, next to nothing else does, and the damage is told."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from attlog import formats
from attlog.base.errors import LogUnreadable, LogUnusable
from attlog.formats import Recording
from attlog.formats.dataflash import reader
from attlog.formats.dataflash.compiled import FMT_LENGTH
from attlog.formats.dataflash.index import RecordIndex, index_records
from tests.conftest import SAMPLES
from tests.formats.damage import KINDS, Damaged, damage


@pytest.fixture(scope="module")
def raw(samples: Path) -> bytes:
    """The first 400 kB of a flight, cut at no particular place."""
    return (samples / "copter_steps_stabilize.bin").read_bytes()[:400_000]


@pytest.fixture(scope="module")
def clean(raw: bytes) -> RecordIndex:
    return index_records(np.frombuffer(raw, np.uint8))


def lengths_of(index: RecordIndex) -> np.ndarray:
    return np.array([fmt.length for fmt in index.layouts], np.int64)[index.layout]


def after_formats(index: RecordIndex) -> int:
    return int(index.offsets[index.layout == 0].max()) + FMT_LENGTH


def kept_and_false(clean: RecordIndex, log: Damaged) -> tuple[float, int]:
    """The share of intact records that are found, and how many found ones never were."""
    found = index_records(log.data)
    whole = log.whole(clean.offsets, lengths_of(clean))
    source = log.source[found.offsets]
    k = np.minimum(np.searchsorted(clean.offsets, source), len(clean.offsets) - 1)
    true = (source >= 0) & (clean.offsets[k] == source) & whole[k] & (lengths_of(clean)[k] == lengths_of(found))
    return np.count_nonzero(true) / np.count_nonzero(whole), np.count_nonzero(~true)


@pytest.mark.parametrize("kind", [k for k in KINDS if k != "flipped bits"])
def test_intact_records_are_kept_and_hardly_any_false_one_appears(raw: bytes, clean: RecordIndex, kind: str) -> None:
    false = []
    for seed in range(12):
        log = damage(raw, kind, 5, np.random.default_rng(seed), keep=after_formats(clean))
        kept, wrong = kept_and_false(clean, log)
        assert kept > 0.999
        false.append(wrong)
    assert np.mean(false) < 0.5


def test_a_changed_bit_costs_at_most_its_record(raw: bytes, clean: RecordIndex) -> None:
    for seed in range(12):
        log = damage(raw, "flipped bits", 5, np.random.default_rng(seed), keep=after_formats(clean))
        assert kept_and_false(clean, log)[0] > 0.999


def test_a_record_with_a_changed_time_is_left_out(raw: bytes, clean: RecordIndex, tmp_path: Path) -> None:
    before = reader.read(written(tmp_path, raw))
    imu = before["IMU", 0]
    log = Damaged.of(raw)
    log.data[imu.offsets[100] + 3 + 6] ^= 0x40  # a high byte of TimeUS
    after = reader.read(written(tmp_path, log.data.tobytes()))
    assert len(after["IMU", 0]) == len(imu) - 1
    assert [(d.offset, "time is far" in d.lost) for d in after.damage[:1]] == [(imu.offsets[100], True)]
    assert after.boots == before.boots


@pytest.mark.parametrize("message", ["IMU", "ATT", "all"])
@pytest.mark.parametrize("run", [1, 2, 30])
@pytest.mark.parametrize("moved_s", [7.0, -9.0, 3600.0])
def test_runs_of_false_times_are_left_out_and_no_others(
    raw: bytes, clean: RecordIndex, tmp_path: Path, message: str, run: int, moved_s: float
) -> None:
    """Neighbours in the file tell; a pause and a restart of the clock are no contradiction."""
    before = reader.read(written(tmp_path, raw))
    timed = sorted(
        int(at) for (name, _), t in before.items() if "TimeUS" in t and message in (name, "all") for at in t.offsets
    )
    log, first = Damaged.of(raw), len(timed) // 2
    planted = timed[first : first + run] if message == "all" else timed[first : first + min(run, 3)]
    for offset in planted:
        time = int.from_bytes(log.data[offset + 3 : offset + 11].tobytes(), "little") + round(moved_s * 1e6)
        log.data[offset + 3 : offset + 11] = np.frombuffer(max(time, 0).to_bytes(8, "little"), np.uint8)
    after = reader.read(written(tmp_path, log.data.tobytes()))
    assert [d.offset for d in after.damage if "time is far" in d.lost] == planted
    assert sum(map(len, before.values())) - sum(map(len, after.values())) == len(planted)
    assert after.boots == before.boots


def test_a_pause_of_the_logger_is_no_false_time(raw: bytes, clean: RecordIndex, tmp_path: Path) -> None:
    before = reader.read(written(tmp_path, raw))
    log = Damaged.of(raw)
    half = len(raw) // 2
    for table in before.values():
        for offset in table.offsets[table.offsets > half].tolist() if "TimeUS" in table else []:
            time = int.from_bytes(log.data[offset + 3 : offset + 11].tobytes(), "little") + 600_000_000
            log.data[offset + 3 : offset + 11] = np.frombuffer(time.to_bytes(8, "little"), np.uint8)
    after = reader.read(written(tmp_path, log.data.tobytes()))
    assert (after.damage, {k: len(t) for k, t in after.items()}) == (
        before.damage,
        {k: len(t) for k, t in before.items()},
    )


def test_a_message_with_a_clock_of_its_own_is_kept(tmp_path: Path) -> None:
    time = np.arange(200, dtype=np.uint64) * 20_000 + 10**9
    other = {"TimeUS": time[::20], "Unix": time[::20] + np.uint64(1_700_000_000_000_000)}
    imu = {"TimeUS": time, "I": np.zeros(200, np.uint8)}
    formats.write(tmp_path / "b.bin", Recording({("IMU", 0): imu, ("GCS", 0): other}))
    raw = bytearray((tmp_path / "b.bin").read_bytes())
    for offset in reader.read(tmp_path / "b.bin")["GCS", 0].offsets.tolist():
        raw[offset + 3 : offset + 11] = raw[offset + 11 : offset + 19]
    log = reader.read(written(tmp_path, bytes(raw)))
    assert (len(log["GCS", 0]), len(log["IMU", 0]), len(log.boots)) == (10, 200, 1)


def written(folder: Path, raw: bytes) -> Path:
    path = folder / "flight.bin"
    path.write_bytes(raw)
    return path


def test_damage_is_told_with_its_bytes(raw: bytes, clean: RecordIndex, tmp_path: Path) -> None:
    at = int(clean.offsets[5000])
    log = Damaged.of(raw)
    log.insert(at, b"\xff" * 1000)
    found = reader.read(written(tmp_path, log.data.tobytes()))
    # the record before the block is given up with it: nothing tells whether its end was overwritten
    hole = found.damage[0]
    assert hole.offset == clean.offsets[4999]
    assert hole.offset + hole.length == at + 1000
    assert f"next record at {at + 1000}" in hole.resumed
    tail = len(raw) - int(clean.offsets[-1] + lengths_of(clean)[-1])
    assert found.damage_bytes == sum(d.length for d in found.damage) == hole.length + tail


@pytest.mark.parametrize("cut", [1, 2, 3, 4, 50, 1000])
def test_a_file_cut_anywhere_keeps_its_whole_records(raw: bytes, clean: RecordIndex, cut: int) -> None:
    end = len(raw) - cut
    found = index_records(np.frombuffer(raw[:end], np.uint8))
    whole = clean.offsets + lengths_of(clean) <= end
    np.testing.assert_array_equal(found.offsets, clean.offsets[whole])
    assert found.losses.bytes == end - int((clean.offsets + lengths_of(clean))[whole].max())


def test_a_lost_format_costs_its_message_only(raw: bytes, clean: RecordIndex, tmp_path: Path) -> None:
    kind = next(fmt for fmt in clean.layouts if fmt.name == "IMU")
    log = Damaged.of(raw)
    log.delete(kind.offset, FMT_LENGTH)
    before = reader.read(written(tmp_path, raw))
    after = reader.read(written(tmp_path, log.data.tobytes()))
    assert set(before) - set(after) == {("IMU", 0)}
    assert {key: len(table) for key, table in after.items() if key != ("FMT", 0)} == {
        key: len(table) for key, table in before.items() if key not in {("IMU", 0), ("FMT", 0)}
    }
    told = [d.lost for d in after.damage if "FMT record is missing" in d.lost]
    assert told == [f"{len(before['IMU', 0])} records of type {kind.type}, whose FMT record is missing"]


def test_a_format_whose_letters_have_another_length_drops_its_message_and_keeps_framing(
    raw: bytes, clean: RecordIndex, tmp_path: Path
) -> None:
    kind = next(fmt for fmt in clean.layouts if fmt.name == "IMU")
    log = Damaged.of(raw)
    log.data[kind.offset + 9] = ord("B")  # first letter Q
    after = reader.read(written(tmp_path, log.data.tobytes()))
    before = reader.read(written(tmp_path, raw))
    assert ("IMU", 0) not in after
    assert len(after["ATT", 0]) == len(before["ATT", 0])
    assert any("does not have" in d.lost and "IMU" in d.lost for d in after.damage)


def test_a_file_that_starts_in_the_middle_is_refused_with_the_reason(
    raw: bytes, clean: RecordIndex, tmp_path: Path
) -> None:
    with pytest.raises(LogUnusable, match="no FMT record"):
        reader.read(written(tmp_path, raw[after_formats(clean) + 7 :]))


def test_an_empty_and_a_missing_file_are_told_apart(tmp_path: Path) -> None:
    with pytest.raises(LogUnusable, match="empty"):
        reader.read(written(tmp_path, b""))
    with pytest.raises(LogUnreadable, match="cannot be read"):
        reader.read(tmp_path / "missing.bin")


def test_two_joined_logs_are_two_boots_with_their_own_formats(corpus: Path) -> None:
    log = reader.read(corpus / "logs" / "made_bin_two_boots_two_firmwares.bin")
    assert len(log.boots) == 2
    first, second = log.boot(0), log.boot(1)
    assert len(log["ATT", 0]) == len(first["ATT", 0]) + len(second["ATT", 0]) == 133
    assert "ErrRP" in first["ATT", 0]
    assert "ErrRP" not in second["ATT", 0]
    both = log["ATT", 0]["ErrRP"]
    assert np.count_nonzero(np.isnan(both)) == len(second["ATT", 0])
    np.testing.assert_allclose(log["ATT", 0].value("Roll")[: len(first["ATT", 0])], first["ATT", 0].value("Roll"))


def test_the_same_log_twice_is_two_boots(raw: bytes, tmp_path: Path) -> None:
    log = reader.read(written(tmp_path, raw + raw))
    once = reader.read(written(tmp_path, raw))
    assert [len(log.boot(k)["IMU", 0]) for k in (0, 1)] == [len(once["IMU", 0])] * 2
    assert [len(log.boot(k).params) for k in (0, 1)] == [len(once.params)] * 2


@pytest.mark.parametrize(
    "filler",
    [
        lambda n: bytes(n),
        lambda n: b"\xff" * n,
        lambda n: np.random.default_rng(0).bytes(n),
        lambda n: b"\xa3\x95" * (n // 2),
        lambda n: b"\xa3\x95\x80" * (n // 3),
        lambda n: (b"\xa3\x95\x80" + bytes(6)) * (n // 9),
    ],
    ids=["zeros", "erased", "random", "marks", "format marks", "empty formats"],
)
def test_megabytes_of_nonsense_take_no_time(raw: bytes, tmp_path: Path, filler: Callable[[int], bytes]) -> None:
    import time

    path = written(tmp_path, raw[:150_000] + filler(3_000_000) + raw[150_000:])
    begin = time.process_time()
    found = reader.read(path)
    assert time.process_time() - begin < 5
    assert found.damage_bytes > 2_900_000
    assert len(found["IMU", 0]) >= len(reader.read(written(tmp_path, raw))["IMU", 0]) - 1


def test_a_clock_that_falls_is_a_new_boot_also_without_formats(raw: bytes, clean: RecordIndex, tmp_path: Path) -> None:
    end = int((clean.offsets + lengths_of(clean))[-1])
    log = reader.read(written(tmp_path, raw[:end] + raw[after_formats(clean) :]))
    assert [boot.start for boot in log.boots] == [0, end]
    imu = [log.boot(k)["IMU", 0]["TimeUS"].astype(np.int64) for k in (0, 1)]
    assert all(np.all(np.diff(t) > 0) for t in imu)


def test_formats_that_come_late_hold_for_what_lies_before(raw: bytes, clean: RecordIndex, tmp_path: Path) -> None:
    start = after_formats(clean)
    moved = raw[start:] + raw[:start]
    before = reader.read(written(tmp_path, raw))["IMU", 0]["GyrX"]
    after = reader.read(written(tmp_path, moved))["IMU", 0]["GyrX"]
    np.testing.assert_array_equal(np.sort(after), np.sort(before))


def test_texts_of_two_layouts_keep_their_length(raw: bytes, tmp_path: Path) -> None:
    short = {("NOTE", 0): {"TimeUS": np.array([10], np.uint64), "Text": np.array([b"abc"], "S4")}}
    long = {("NOTE", 0): {"TimeUS": np.array([20], np.uint64), "Text": np.array([b"a longer text"], "S16")}}
    for name, messages in (("a.bin", short), ("b.bin", long)):
        formats.write(tmp_path / name, Recording(messages))
    joined = (tmp_path / "a.bin").read_bytes() + (tmp_path / "b.bin").read_bytes()
    assert reader.read(written(tmp_path, joined))["NOTE", 0]["Text"].tolist() == [b"abc", b"a longer text"]


@pytest.mark.parametrize("seed", range(12))
def test_everything_in_a_damaged_log_can_be_decoded(raw: bytes, tmp_path: Path, seed: int) -> None:
    rng = np.random.default_rng(seed)
    log = damage(raw[:150_000], KINDS[seed % len(KINDS)], 60, rng, size=300)
    found = reader.read(written(tmp_path, log.data.tobytes()))
    for table in found.values():
        for column in table.fields:
            assert len(table[column]) == len(table)
            if table[column].dtype.kind in "iuf":
                assert table.value(column).dtype == np.float64
    assert 0 < found.damage_bytes < found.size
    assert sum(len(found.boot(k).get(("IMU", 0), ())) for k in range(len(found.boots))) == len(
        found.get(("IMU", 0), ())
    )


@pytest.mark.parametrize(
    ("name", "letters", "false"),
    [
        ("MSG", b"QZ", b"Qa"),
        ("PARM", b"QNff", b"QNnf"),
        ("PARM", b"QNff", b"Qqqff"),
        ("UNIT", b"QbZ", b"QZb"),
        ("MULT", b"Qbd", b"Qbq"),
        ("FMTU", b"QBNN", b"QNBN"),
        ("FMTU", b"QBNN", b"QBNqq"),
    ],
)
def test_a_format_that_gives_a_known_column_another_type_is_read(
    name: str, letters: bytes, false: bytes, tmp_path: Path
) -> None:
    """Foreign writers and damage do that; what has the wrong type is left out, the data stands."""
    raw = bytearray((SAMPLES / "copter_steps_stabilize.bin").read_bytes()[:400_000])
    at = raw.find(name.encode().ljust(4, b"\0") + letters.ljust(16, b"\0"))
    assert at > 0
    whole = tmp_path / "whole.bin"
    whole.write_bytes(raw)
    raw[at + 4 : at + 20] = false.ljust(16, b"\0")
    path = tmp_path / "false.bin"
    path.write_bytes(raw)
    log, true = reader.read(path), reader.read(whole)
    np.testing.assert_array_equal(log["IMU", 0]["GyrX"], true["IMU", 0]["GyrX"])
    assert all(isinstance(p.name, str) and isinstance(p.value, int | float) for p in log.params)


def test_a_message_of_which_a_third_has_other_times_is_not_damaged(tmp_path: Path) -> None:
    """Damage changes a few records; what is late so often has a clock of its own."""
    time = np.arange(300, dtype=np.uint64) * 20_000 + 10**9
    other = time[::10] + np.uint64(60_000_000) * (np.arange(30) % 3 == 1).astype(np.uint64)
    imu = {"TimeUS": time, "I": np.zeros(300, np.uint8)}
    event = {"TimeUS": time[::10], "Late": other}
    formats.write(tmp_path / "b.bin", Recording({("IMU", 0): imu, ("EVT", 0): event}))
    raw = bytearray((tmp_path / "b.bin").read_bytes())
    for offset in reader.read(tmp_path / "b.bin")["EVT", 0].offsets.tolist():
        raw[offset + 3 : offset + 11] = raw[offset + 11 : offset + 19]
    log = reader.read(written(tmp_path, bytes(raw)))
    assert (len(log["EVT", 0]), len(log["IMU", 0])) == (30, 300)
