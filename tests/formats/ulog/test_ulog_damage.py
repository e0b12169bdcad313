"""What is left of a damaged ULog; every expectation comes from the undamaged file."""

from __future__ import annotations

import time
import tracemalloc
from collections import Counter
from pathlib import Path

import numpy as np
import pytest

from attlog import formats
from attlog.core.errors import AttlogError
from attlog.formats import Messages
from attlog.formats.ulog import reader
from attlog.formats.ulog.content import implausible
from tests.conftest import SAMPLES, few
from tests.flight import fake
from tests.formats.test_truncation import small_ulog
from tests.fuzz.mutate import mutated

SOURCE = SAMPLES / "px4_hover.ulg"


@pytest.fixture(scope="module")
def raw() -> np.ndarray:
    """Definitions and about 20 000 records, up to the end of one."""
    whole = reader.read_ulog(SOURCE)
    starts = np.sort(np.concatenate([t.offsets for t in whole.values()]))
    return np.fromfile(SOURCE, np.uint8)[: starts[20_000]]


@pytest.fixture(scope="module")
def extents(raw: np.ndarray, tmp_path_factory: pytest.TempPathFactory) -> np.ndarray:
    """Start and end of every data record of the undamaged file (n, 2)."""
    path = tmp_path_factory.mktemp("whole") / "whole.ulg"
    raw.tofile(path)
    starts = np.sort(np.concatenate([t.offsets for t in reader.read_ulog(path).values()]))
    ends = starts + 3 + raw[starts].astype(np.int64) + 256 * raw[starts + 1].astype(np.int64)
    return np.stack([starts, ends], axis=1)


def salvage(hurt: np.ndarray, path: Path) -> tuple[Messages, Counter[bytes]]:
    hurt = hurt.astype(np.uint8)
    hurt.tofile(path)
    log = reader.read_ulog(path)
    records: Counter[bytes] = Counter()
    for table in log.values():
        for start in table.offsets.tolist():
            records[hurt[start : start + 3 + int(hurt[start]) + 256 * int(hurt[start + 1])].tobytes()] += 1
    return log, records


def as_records(raw: np.ndarray, extents: np.ndarray) -> Counter[bytes]:
    return Counter(raw[a:b].tobytes() for a, b in extents.tolist())


@pytest.mark.parametrize("seed", range(4))
def test_damage_costs_only_what_it_touches(seed: int, raw: np.ndarray, extents: np.ndarray, tmp_path: Path) -> None:
    """30 damage of up to 400 bytes: over 99 % of the untouched records stay, under one false record."""
    dice = np.random.default_rng(seed)
    hurt, alive = raw.copy(), np.ones(len(extents), bool)
    for _ in range(30):
        n = int(dice.integers(60, 400))
        at = int(dice.integers(extents[0, 0], len(raw) - n))
        hurt[at : at + n] = dice.integers(0, 256, n)
        alive &= (extents[:, 1] <= at) | (extents[:, 0] >= at + n)
    log, found = salvage(hurt, tmp_path / "hurt.ulg")
    intact = as_records(raw, extents[alive])
    assert (found & intact).total() > 0.999 * intact.total()
    assert (found - as_records(raw, extents)).total() <= 1
    assert 20 < len(log.damage) <= 40
    lost = int((extents[~alive, 1] - extents[~alive, 0]).sum())
    assert lost <= log.damage_bytes < lost + 30 * 400


@pytest.mark.parametrize("value", [0, 255])
def test_blank_flash_blocks_are_counted_to_the_byte(
    value: int, raw: np.ndarray, extents: np.ndarray, tmp_path: Path
) -> None:
    first, last = 5000, 5080
    begin, end = extents[first, 0], extents[last, 1]
    hurt = raw.copy()
    hurt[begin:end] = value
    log, found = salvage(hurt, tmp_path / "blank.ulg")
    expected = as_records(raw, np.delete(extents, np.arange(first - 1, last + 1), axis=0))
    assert found == expected, "the record before the block is given up, everything else is kept"
    [damage] = log.damage
    assert (damage.offset, damage.offset + damage.length) == (extents[first - 1, 0], end)
    assert log.damage_bytes == damage.length


@pytest.mark.parametrize("junk", [700, 5000, 60_000])
def test_junk_between_records_costs_the_record_before(
    junk: int, raw: np.ndarray, extents: np.ndarray, tmp_path: Path
) -> None:
    at = extents[7000, 0]
    noise = np.random.default_rng(junk).integers(0, 256, junk)
    log, found = salvage(np.concatenate([raw[:at], noise, raw[at:]]), tmp_path / "junk.ulg")
    assert found == as_records(raw, np.delete(extents, 6999, axis=0))
    assert log.damage[0].offset == extents[6999, 0]


@pytest.mark.parametrize("gap", [1, 17, 999, 20_000])
def test_missing_bytes_make_no_false_record(gap: int, raw: np.ndarray, extents: np.ndarray, tmp_path: Path) -> None:
    at = int(extents[4000, 0]) + 11
    _, found = salvage(np.concatenate([raw[:at], raw[at + gap :]]), tmp_path / "gap.ulg")
    alive = (extents[:, 1] <= at) | (extents[:, 0] >= at + gap)
    assert not found - as_records(raw, extents)
    assert (as_records(raw, extents[alive]) - found).total() <= 1


def test_a_lost_subscription_is_replaced_where_only_one_topic_fits(raw: np.ndarray, tmp_path: Path) -> None:
    name = b"vehicle_attitude"
    at = next(
        i
        for i in range(60_000, 120_000)
        if raw[i + 2] == ord("A") and raw[i + 6 : i + 22].tobytes() == name and raw[i] == 3 + len(name)
    )
    hurt = raw.copy()
    hurt[at : at + 3 + 3 + len(name)] = 0
    (tmp_path / "whole.ulg").write_bytes(raw.tobytes())
    (tmp_path / "hurt.ulg").write_bytes(hurt.tobytes())
    whole, log = reader.read_ulog(tmp_path / "whole.ulg"), reader.read_ulog(tmp_path / "hurt.ulg")
    assert np.array_equal(log["vehicle_attitude", 0]["q"], whole["vehicle_attitude", 0]["q"])
    assert any("vehicle_attitude" in d.lost for d in log.damage)


def test_two_logs_in_one_file_are_two_boots(tmp_path: Path) -> None:
    small_ulog(tmp_path / "one.ulg")
    one = (tmp_path / "one.ulg").read_bytes()
    both = one + SOURCE.read_bytes()[:300_000]
    (tmp_path / "both.ulg").write_bytes(both)
    log, first = reader.read_ulog(tmp_path / "both.ulg"), reader.read_ulog(tmp_path / "one.ulg")
    assert [(b.start, b.end) for b in log.boots] == [(0, len(one)), (len(one), len(both))]
    assert len(log.boot(0)["status", 1]) == len(first["status", 1])
    assert np.array_equal(log.boot(0)["sensor_combined", 0]["gyro_rad"], first["sensor_combined", 0]["gyro_rad"])
    (tmp_path / "two.ulg").write_bytes(both[len(one) :])
    second = reader.read_ulog(tmp_path / "two.ulg")
    assert np.array_equal(log.boot(1)["sensor_combined", 0]["gyro_rad"], second["sensor_combined", 0]["gyro_rad"])


def test_a_time_out_of_reach_does_not_stretch_the_log(raw: np.ndarray, extents: np.ndarray, tmp_path: Path) -> None:
    """Random bytes over a stamp leave the framing intact; a second damage elsewhere makes the reader look."""
    hurt = raw.copy()
    start = int(extents[9000, 0])
    hurt[start + 5 : start + 13] = 0x77
    at = int(extents[3000, 0])
    hurt[at : at + 200] = 0x99
    _, found = salvage(hurt, tmp_path / "stamp.ulg")
    assert not found - as_records(raw, extents)


def test_flags_in_the_middle_of_a_log_mean_nothing(raw: np.ndarray, extents: np.ndarray, tmp_path: Path) -> None:
    at = extents[500, 0]
    flags = np.frombuffer(b"\x28\x00B" + b"\xff" * 40, np.uint8)
    _, found = salvage(np.concatenate([raw[:at], flags, raw[at:]]), tmp_path / "flags.ulg")
    assert found == as_records(raw, extents)


@pytest.mark.parametrize("step", [50, 200])
def test_a_log_in_shreds_is_read_in_reasonable_time(step: int, raw: np.ndarray, tmp_path: Path) -> None:
    hurt = raw.copy()
    hurt[100_000:400_000:step] = 255
    begin = time.process_time()
    log, _ = salvage(hurt, tmp_path / "shreds.ulg")
    assert time.process_time() - begin < 20
    assert log.damage


@pytest.fixture(scope="module")
def small(tmp_path_factory: pytest.TempPathFactory) -> bytes:
    path = tmp_path_factory.mktemp("small") / "small.ulg"
    small_ulog(path)
    return path.read_bytes()


@pytest.mark.parametrize("seed", few(range(300), 60))
def test_a_log_broken_in_any_way_ends_with_a_log_or_an_error_in_time(seed: int, small: bytes, tmp_path: Path) -> None:
    """The ways of ``tests/fuzz/mutate.py``: definitions too, lengths and numbers that no logger writes."""
    broken = mutated(small, seed)
    (tmp_path / "broken.ulg").write_bytes(broken)
    begin = time.process_time()
    try:
        log = formats.open(tmp_path / "broken.ulg")
    except AttlogError:
        return
    for table in log.values():
        for name in table.fields:
            assert len(table[name]) == len(table) > 0
    assert time.process_time() - begin < 1 + 3e-6 * len(broken)
    assert "part_failed" not in {r.code for r in log.remarks}


def test_looking_for_false_records_keeps_none_of_them_in_memory(raw: np.ndarray, tmp_path: Path) -> None:
    hurt = raw.copy()
    hurt[600_000:600_100] = 255
    kept = []
    for name, content in (("whole.ulg", raw), ("hurt.ulg", hurt)):
        content.tofile(tmp_path / name)
        reader.read_ulog(tmp_path / name)  # what numpy keeps once and for all
        tracemalloc.start()
        try:
            log = reader.read_ulog(tmp_path / name)
            kept.append(tracemalloc.get_traced_memory()[0])
        finally:
            tracemalloc.stop()
    assert log.damage
    assert kept[1] < kept[0] + 0.5 * len(raw)


@pytest.mark.parametrize(("wrong", "doubted"), [(2, 2), (150, 0)])
def test_a_number_beyond_any_range_is_doubted_where_it_is_rare(wrong: int, doubted: int) -> None:
    """A column that holds such numbers often is logged that way: not initialised, say."""
    values = np.ones(300, np.float32)
    values[100 : 100 + wrong] = 1e20
    topic = fake.table("baro", 0, {"pressure": values}, np.arange(300))
    assert np.count_nonzero(implausible(topic)) == doubted


# Records whose subscription is lost: three of one size with rising times can only be of one format.
