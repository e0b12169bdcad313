"""Damaged DataFlash logs: what is intact comes back, next to nothing else does, and the damage is told."""

from __future__ import annotations

import struct
import time
from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np
import pytest

from attlog import formats
from attlog.core.errors import LogUnusable
from attlog.core.limits import MAX_INSTANCES, MAX_LAYOUTS_OF_A_NAME, MAX_TEXT_FORMATS
from attlog.formats import Recording
from attlog.formats.dataflash import reader
from attlog.formats.dataflash.layout import FMT_LENGTH
from attlog.formats.dataflash.walk import RecordIndex, index_records
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


@pytest.mark.parametrize("message", ["IMU", "ATT", "all"])
@pytest.mark.parametrize("run", [1, 2, 30])
@pytest.mark.parametrize("moved_s", [7.0, -9.0, 3600.0])
def test_runs_of_false_times_are_left_out_and_no_others(
    raw: bytes, clean: RecordIndex, tmp_path: Path, message: str, run: int, moved_s: float
) -> None:
    """Neighbours in the file tell; a pause and a restart of the clock are no contradiction."""
    before = reader.read_binary(written(tmp_path, raw))
    timed = sorted(
        int(at) for (name, _), t in before.items() if "TimeUS" in t and message in (name, "all") for at in t.offsets
    )
    log, first = Damaged.of(raw), len(timed) // 2
    planted = timed[first : first + run] if message == "all" else timed[first : first + min(run, 3)]
    for offset in planted:
        time = int.from_bytes(log.data[offset + 3 : offset + 11].tobytes(), "little") + round(moved_s * 1e6)
        log.data[offset + 3 : offset + 11] = np.frombuffer(max(time, 0).to_bytes(8, "little"), np.uint8)
    after = reader.read_binary(written(tmp_path, log.data.tobytes()))
    assert [d.offset for d in after.damage if "time is far" in d.lost] == planted
    assert sum(map(len, before.values())) - sum(map(len, after.values())) == len(planted)
    assert after.boots == before.boots


def test_a_pause_of_the_logger_is_no_false_time(raw: bytes, clean: RecordIndex, tmp_path: Path) -> None:
    before = reader.read_binary(written(tmp_path, raw))
    log = Damaged.of(raw)
    half = len(raw) // 2
    for table in before.values():
        for offset in table.offsets[table.offsets > half].tolist() if "TimeUS" in table else []:
            time = int.from_bytes(log.data[offset + 3 : offset + 11].tobytes(), "little") + 600_000_000
            log.data[offset + 3 : offset + 11] = np.frombuffer(time.to_bytes(8, "little"), np.uint8)
    after = reader.read_binary(written(tmp_path, log.data.tobytes()))
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
    for offset in reader.read_binary(tmp_path / "b.bin")["GCS", 0].offsets.tolist():
        raw[offset + 3 : offset + 11] = raw[offset + 11 : offset + 19]
    log = reader.read_binary(written(tmp_path, bytes(raw)))
    assert (len(log["GCS", 0]), len(log["IMU", 0]), len(log.boots)) == (10, 200, 1)


def written(folder: Path, raw: bytes) -> Path:
    path = folder / "flight.bin"
    path.write_bytes(raw)
    return path


def test_damage_is_told_with_its_bytes(raw: bytes, clean: RecordIndex, tmp_path: Path) -> None:
    at = int(clean.offsets[5000])
    log = Damaged.of(raw)
    log.insert(at, b"\xff" * 1000)
    found = reader.read_binary(written(tmp_path, log.data.tobytes()))
    # the record before the block is given up with it: nothing tells whether its end was overwritten
    hole = found.damage[0]
    assert hole.offset == clean.offsets[4999]
    assert hole.offset + hole.length == at + 1000
    assert f"next record at {at + 1000}" in hole.resumed
    tail = len(raw) - int(clean.offsets[-1] + lengths_of(clean)[-1])
    assert found.damage_bytes == sum(d.length for d in found.damage) == hole.length + tail


def test_a_lost_format_costs_its_message_only(raw: bytes, clean: RecordIndex, tmp_path: Path) -> None:
    kind = next(fmt for fmt in clean.layouts if fmt.name == "IMU")
    log = Damaged.of(raw)
    log.delete(kind.offset, FMT_LENGTH)
    before = reader.read_binary(written(tmp_path, raw))
    after = reader.read_binary(written(tmp_path, log.data.tobytes()))
    assert set(before) - set(after) == {("IMU", 0)}
    assert {key: len(table) for key, table in after.items() if key != ("FMT", 0)} == {
        key: len(table) for key, table in before.items() if key not in {("IMU", 0), ("FMT", 0)}
    }
    told = [d.lost for d in after.damage if "FMT record is missing" in d.lost]
    assert told == [f"{len(before['IMU', 0]):,} records of type {kind.type}, whose FMT record is missing"]


def test_a_format_whose_letters_have_another_length_drops_its_message_and_keeps_framing(
    raw: bytes, clean: RecordIndex, tmp_path: Path
) -> None:
    kind = next(fmt for fmt in clean.layouts if fmt.name == "IMU")
    log = Damaged.of(raw)
    log.data[kind.offset + 9] = ord("B")  # first letter Q
    after = reader.read_binary(written(tmp_path, log.data.tobytes()))
    before = reader.read_binary(written(tmp_path, raw))
    assert ("IMU", 0) not in after
    assert len(after["ATT", 0]) == len(before["ATT", 0])
    assert any("does not have" in d.lost and "IMU" in d.lost for d in after.damage)


def test_a_file_that_starts_in_the_middle_is_refused_with_the_reason(
    raw: bytes, clean: RecordIndex, tmp_path: Path
) -> None:
    with pytest.raises(LogUnusable, match="no FMT record"):
        reader.read_binary(written(tmp_path, raw[after_formats(clean) + 7 :]))


def test_two_joined_logs_are_two_boots_with_their_own_formats(corpus: Path) -> None:
    log = reader.read_binary(corpus / "logs" / "made_bin_two_boots_two_firmwares.bin")
    assert len(log.boots) == 2
    first, second = log.boot(0), log.boot(1)
    assert len(log["ATT", 0]) == len(first["ATT", 0]) + len(second["ATT", 0]) == 133
    assert "ErrRP" in first["ATT", 0]
    assert "ErrRP" not in second["ATT", 0]
    both = log["ATT", 0]["ErrRP"]
    assert np.count_nonzero(np.isnan(both)) == len(second["ATT", 0])
    np.testing.assert_allclose(log["ATT", 0].value("Roll")[: len(first["ATT", 0])], first["ATT", 0].value("Roll"))


def test_the_same_log_twice_is_two_boots(raw: bytes, tmp_path: Path) -> None:
    log = reader.read_binary(written(tmp_path, raw + raw))
    once = reader.read_binary(written(tmp_path, raw))
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
    found = reader.read_binary(path)
    assert time.process_time() - begin < 5
    assert found.damage_bytes > 2_900_000
    assert len(found["IMU", 0]) >= len(reader.read_binary(written(tmp_path, raw))["IMU", 0]) - 1


def test_a_clock_that_falls_is_a_new_boot_also_without_formats(raw: bytes, clean: RecordIndex, tmp_path: Path) -> None:
    end = int((clean.offsets + lengths_of(clean))[-1])
    log = reader.read_binary(written(tmp_path, raw[:end] + raw[after_formats(clean) :]))
    assert [boot.start for boot in log.boots] == [0, end]
    imu = [log.boot(k)["IMU", 0]["TimeUS"].astype(np.int64) for k in (0, 1)]
    assert all(np.all(np.diff(t) > 0) for t in imu)


def test_formats_that_come_late_hold_for_what_lies_before(raw: bytes, clean: RecordIndex, tmp_path: Path) -> None:
    start = after_formats(clean)
    moved = raw[start:] + raw[:start]
    before = reader.read_binary(written(tmp_path, raw))["IMU", 0]["GyrX"]
    after = reader.read_binary(written(tmp_path, moved))["IMU", 0]["GyrX"]
    np.testing.assert_array_equal(np.sort(after), np.sort(before))


def test_texts_of_two_layouts_keep_their_length(raw: bytes, tmp_path: Path) -> None:
    short = {("NOTE", 0): {"TimeUS": np.array([10], np.uint64), "Text": np.array([b"abc"], "S4")}}
    long = {("NOTE", 0): {"TimeUS": np.array([20], np.uint64), "Text": np.array([b"a longer text"], "S16")}}
    for name, messages in (("a.bin", short), ("b.bin", long)):
        formats.write(tmp_path / name, Recording(messages))
    joined = (tmp_path / "a.bin").read_bytes() + (tmp_path / "b.bin").read_bytes()
    assert reader.read_binary(written(tmp_path, joined))["NOTE", 0]["Text"].tolist() == [b"abc", b"a longer text"]


@pytest.mark.parametrize("seed", range(12))
def test_everything_in_a_damaged_log_can_be_decoded(raw: bytes, tmp_path: Path, seed: int) -> None:
    rng = np.random.default_rng(seed)
    log = damage(raw[:150_000], KINDS[seed % len(KINDS)], 60, rng, size=300)
    found = reader.read_binary(written(tmp_path, log.data.tobytes()))
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
    log, true = reader.read_binary(path), reader.read_binary(whole)
    np.testing.assert_array_equal(log["IMU", 0]["GyrX"], true["IMU", 0]["GyrX"])
    assert all(isinstance(p.name, str) and isinstance(p.value, int | float) for p in log.params)


# DataFlash logs made to break a reader: linear time, one sentence, and the rest goes on.


def fmt(kind: int, length: int, name: bytes, letters: bytes, columns: bytes) -> bytes:
    return b"\xa3\x95\x80" + struct.pack("<BB4s16s64s", kind, length, name, letters, columns)


def record(kind: int, layout: str, *values: object) -> bytes:
    return b"\xa3\x95" + bytes([kind]) + struct.pack("<" + layout, *values)


HEAD = fmt(128, 89, b"FMT", b"BBnNZ", b"Type,Length,Name,Format,Columns")
FMTU = fmt(130, 44, b"FMTU", b"QBNN", b"TimeUS,FmtType,UnitIds,MultIds")
IMU = fmt(150, 15, b"IMU", b"Qf", b"TimeUS,GyrX")
LINES = b"FMT, 128, 89, FMT, BBnNZ, Type,Length,Name,Format\n"
QUICKLY_S = 4.0
"""Far above what linear work takes on these sizes on a busy machine, far below what quadratic work takes."""


@pytest.fixture(autouse=True)
def linear() -> Iterator[None]:
    begin = time.process_time()
    yield
    assert time.process_time() - begin < QUICKLY_S


def opened(tmp_path: Path, content: bytes, suffix: str = ".bin") -> formats.Messages:
    """The log, with every column decoded."""
    path = tmp_path / f"hostile{suffix}"
    path.write_bytes(content)
    log = reader.read_binary(path) if suffix == ".bin" else reader.read_text(path)
    for table in log.values():
        for column in table.fields:
            assert len(table[column]) == len(table)
    return log


# Binary.


def test_a_column_of_many_numbers_is_no_instance(tmp_path: Path) -> None:
    described = record(130, "QB16s16s", 0, 150, b"s#", b"F-")
    rows = b"".join(record(150, "QQ", i, i) for i in range(100_000))
    log = opened(tmp_path, HEAD + FMTU + fmt(150, 19, b"XKF1", b"QQ", b"TimeUS,C") + described + rows)
    assert log.instances("XKF1") == [0]
    assert len(log["XKF1", 0]) == 100_000
    few = b"".join(record(150, "QQ", i, i % MAX_INSTANCES) for i in range(1000))
    log = opened(tmp_path, HEAD + FMTU + fmt(150, 19, b"XKF1", b"QQ", b"TimeUS,C") + described + few)
    assert log.instances("XKF1") == list(range(MAX_INSTANCES))


def test_a_format_said_a_hundred_thousand_times_is_one(tmp_path: Path) -> None:
    log = opened(tmp_path, HEAD + IMU * 100_000 + record(150, "Qf", 5, 1.0) * 3)
    assert (len(log["IMU", 0]), log.damage) == (3, [])


def test_records_behind_too_many_definitions_of_a_message_are_told_and_never_read_by_an_older_one(
    tmp_path: Path,
) -> None:
    defined = [
        fmt(150, 15, b"IMU", b"Qf" if k % 2 else b"Qi", b"TimeUS,A%d" % k) + record(150, "Qf", k, 1.0)
        for k in range(3000)
    ]
    tail = fmt(151, 11, b"ATT", b"Q", b"TimeUS") + record(151, "Q", 7)
    log = opened(tmp_path, HEAD + b"".join(defined) + tail)
    assert len(log["IMU", 0]) == MAX_LAYOUTS_OF_A_NAME
    assert len(log["ATT", 0]) == 1
    assert any("definitions beyond" in d.lost for d in log.damage)
    assert any(f"{3000 - MAX_LAYOUTS_OF_A_NAME:,} IMU records" in d.lost for d in log.damage)


def test_lengths_that_cannot_be_and_formats_of_formats_cost_their_message_only(tmp_path: Path) -> None:
    wrong = fmt(151, 0, b"MAG", b"Q", b"TimeUS") + fmt(152, 255, b"GPS", b"Q", b"TimeUS") + fmt(153, 3, b"A", b"", b"")
    own = fmt(128, 12, b"FMT", b"BB", b"A,B")
    log = opened(tmp_path, HEAD + IMU + wrong + own + record(150, "Qf", 5, 1.0) * 4)
    assert len(log["IMU", 0]) == 4
    assert log["FMT", 0].fields.keys() == {"Type", "Length", "Name", "Format", "Columns"}


def test_a_column_named_twice_is_the_first_one(tmp_path: Path) -> None:
    rows = b"".join(record(150, "BQI", i % 3, i, 9) for i in range(30))
    log = opened(tmp_path, HEAD + fmt(150, 16, b"IMU", b"BQI", b"I,TimeUS,I") + rows)
    assert log.instances("IMU") == [0, 1, 2]
    np.testing.assert_array_equal(log["IMU", 1]["I"], np.ones(10))


@pytest.mark.parametrize(
    ("letters", "layout", "value"), [(b"Z", "64s", b"[bold red]x[/]"), (b"f", "f", float("nan")), (b"a", "64s", b"x")]
)
def test_a_time_or_value_of_another_type_is_taken_for_neither(
    tmp_path: Path, letters: bytes, layout: str, value: object
) -> None:
    size = struct.calcsize("<" + layout)
    hostile = b""
    for kind, name, column in ((150, b"IMU", b"TimeUS"), (151, b"PARM", b"Value"), (152, b"VER", b"FWS")):
        hostile += fmt(kind, 3 + 16 + size, name, b"N" + letters, b"Name," + column) + record(
            kind, "16s" + layout, b"A", value
        )
    timed = fmt(160, 11, b"ATT", b"Q", b"TimeUS") + b"".join(record(160, "Q", i) for i in range(5))
    log = opened(tmp_path, HEAD + hostile + timed)
    assert [p.t_us for p in log.params] in ([], [None])
    assert len(log["ATT", 0]) == 5


def test_ids_of_units_that_are_no_whole_numbers_describe_nothing(tmp_path: Path) -> None:
    units = fmt(132, 79, b"UNIT", b"QfZ", b"TimeUS,Id,Label") + record(132, "Qf64s", 0, float("nan"), b"m")
    factors = fmt(133, 23, b"MULT", b"Qfd", b"TimeUS,Id,Mult") + record(133, "Qfd", 0, float("inf"), float("nan"))
    log = opened(
        tmp_path,
        HEAD
        + FMTU
        + units
        + factors
        + IMU
        + record(130, "QB16s16s", 0, 150, b"sm", b"F\xff")
        + record(150, "Qf", 5, 1.0),
    )
    assert log["IMU", 0].fields["GyrX"].unit is None


def test_descriptions_without_end_are_read_in_linear_time(tmp_path: Path) -> None:
    defined = b"".join(fmt(150, 11, b"I%d" % (i % 200), b"Q", b"T%d" % i) for i in range(3000))
    described = b"".join(record(130, "QB16s16s", 0, 150, b"s%d" % (i % 50), b"F") for i in range(30_000))
    opened(tmp_path, HEAD + FMTU + defined + described + record(150, "Q", 5))


@pytest.mark.parametrize("period", [2, 50])
def test_a_clock_that_always_falls_makes_no_boots_without_end(tmp_path: Path, period: int) -> None:
    rows = b"".join(record(150, "Qf", (i % period) * 10**7 + i, 1.0) for i in range(100_000))
    log = opened(tmp_path, HEAD + IMU + rows)
    assert 1 <= len(log.boots) <= 100


def test_the_number_of_damaged_places_is_counted_beyond_what_is_listed(tmp_path: Path) -> None:
    good = record(150, "Qf", 5, 1.0)
    log = opened(tmp_path, HEAD + IMU + (good * 2 + b"\xff\xff") * 2500 + good)
    assert (log.damage_places, len(log.damage)) == (2500, 1000)
    assert log.damage_bytes >= 5000
    from attlog.flight import damage_problems

    [told] = damage_problems(log, 60.0)
    assert "damaged in 2500 places" in told.text
    assert told.count == 2500


# Text.


@pytest.mark.parametrize("digits", [27, 3_000_000])
def test_numbers_that_almost_fit_do_not_backtrack(tmp_path: Path, digits: int) -> None:
    cells = b", " + b"1" * digits
    line = b"IMU" + cells * 30 if digits < 100 else b"IMU" + cells
    log = opened(tmp_path, LINES + b"FMT, 129, 23, IMU, " + b"f" * 32 + b", A\n" + line + b", x\n", ".log")
    assert (len(log), log.damage_places) == (0, 1)


def test_formats_without_end_are_told_and_the_first_are_read(tmp_path: Path) -> None:
    lines = [b"FMT, 129, 23, I%d, %s, A\nI%d" % (i, b"f" * 32, i) + b", 1" * 32 + b"\n" for i in range(3000)]
    log = opened(tmp_path, LINES + b"".join(lines), ".log")
    assert len(log) == MAX_TEXT_FORMATS - 1
    assert any("beyond" in d.lost for d in log.damage)


def test_megabytes_of_letters_define_nothing(tmp_path: Path) -> None:
    long = b"FMT, 129, 23, IMU, " + b"f" * 3_000_000 + b", " + b"a," * 1_000_000 + b"\n"
    log = opened(tmp_path, LINES + b"FMT, 130, 9, ATT, I, TimeMS\nATT, 5\n" + long, ".log")
    assert log.names() == ["ATT"]


def test_a_text_line_of_megabytes_does_not_widen_the_column(tmp_path: Path) -> None:
    rows = b"".join(b"MSG, %d\n" % i for i in range(50_000))
    log = opened(tmp_path, LINES + b"FMT, 129, 23, MSG, Z, Message\n" + rows + b"MSG, " + b"x" * 4_000_000, ".log")
    assert log["MSG", 0]["Message"].nbytes < 50_001 * 600


def test_numbers_of_lines_that_are_no_instances_and_times_beyond_any_clock(tmp_path: Path) -> None:
    rows = b"".join(b"IMU, %d, %d\n" % (i, 10**17 + i) for i in range(30_000))
    log = opened(tmp_path, LINES + b"FMT, 129, 23, IMU, BI, I,TimeMS\n" + rows, ".log")
    assert log.instances("IMU") == [0]
    assert len(log.boots) == 1


def test_blank_lines_without_end_before_the_first_format(tmp_path: Path) -> None:
    path = tmp_path / "blank.log"
    path.write_bytes(b"\n" * 65_000 + LINES + b" " * 3_000_000)
    assert formats.recognise(path) == "dataflash_text"
    path.write_bytes(b"\n" + b" " * 65_000 + b"x" + LINES)
    with pytest.raises(formats.NotALog):
        formats.recognise(path)


def test_a_unit_belongs_to_the_definition_before_it(tmp_path: Path) -> None:
    """A type that is defined anew has other columns, and units of its own."""
    units = fmt(132, 76, b"UNIT", b"QbZ", b"TimeUS,Id,Label")
    units += b"".join(record(132, "Qb64s", 0, ord(k), label) for k, label in (("m", b"m"), ("d", b"deg")))
    one = fmt(150, 15, b"ONE", b"Qf", b"TimeUS,A") + record(130, "QB16s16s", 0, 150, b"-m", b"--")
    two = fmt(150, 15, b"TWO", b"Qf", b"TimeUS,B") + record(130, "QB16s16s", 0, 150, b"-d", b"--")
    log = opened(tmp_path, HEAD + FMTU + units + one + record(150, "Qf", 5, 1.0) + two + record(150, "Qf", 6, 1.0))
    assert (log["ONE", 0].fields["A"].unit, log["TWO", 0].fields["B"].unit) == ("m", "deg")
