"""DataFlash logs made to break a reader: linear time, one sentence, and the rest goes on."""

from __future__ import annotations

import struct
import time
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest

from attlog import formats
from attlog.base.errors import LogUnusable
from attlog.base.limits import MAX_INSTANCES, MAX_LAYOUTS_OF_A_NAME, MAX_TEXT_FORMATS
from attlog.formats import sdlog2
from attlog.formats.dataflash import reader, text


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
    log = reader.read(path) if suffix == ".bin" else text.read(path)
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
    assert any(f"{3000 - MAX_LAYOUTS_OF_A_NAME} IMU records" in d.lost for d in log.damage)


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


def test_a_multiplier_that_is_no_number_leaves_no_unit(tmp_path: Path) -> None:
    units = fmt(132, 76, b"UNIT", b"QbZ", b"TimeUS,Id,Label") + record(132, "Qb64s", 0, ord("m"), b"m")
    factors = fmt(133, 20, b"MULT", b"Qbd", b"TimeUS,Id,Mult") + record(133, "Qbd", 0, ord("F"), float("nan"))
    described = record(130, "QB16s16s", 0, 150, b"sm", b"FF")
    log = opened(tmp_path, HEAD + FMTU + units + factors + IMU + described + record(150, "Qf", 5, 1.0))
    assert log["IMU", 0].fields["GyrX"].unit is None


@pytest.mark.parametrize(
    ("factor", "unit"), [(1.0, "deg"), (0.01, "deg"), (0.0, "deg"), (1e-5, "mdeg"), (10.0, "kdeg")]
)
def test_a_multiplier_of_one_beside_a_scaled_letter_leaves_the_unit_as_it_is(
    tmp_path: Path, factor: float, unit: str
) -> None:
    """Letter c is read in hundredths; firmwares write the same 0.01 again, or 1: the read number is in deg for both."""
    units = fmt(132, 76, b"UNIT", b"QbZ", b"TimeUS,Id,Label") + record(132, "Qb64s", 0, ord("d"), b"deg")
    factors = fmt(133, 20, b"MULT", b"Qbd", b"TimeUS,Id,Mult") + record(133, "Qbd", 0, ord("F"), factor)
    att = fmt(150, 13, b"ATT", b"Qc", b"TimeUS,Roll") + record(130, "QB16s16s", 0, 150, b"-d", b"-F")
    log = opened(tmp_path, HEAD + FMTU + units + factors + att + record(150, "Qh", 5, 250))
    assert log["ATT", 0]["Roll"].tolist() == [250]
    assert log["ATT", 0].value("Roll").tolist() == [pytest.approx(2.5)]
    assert log["ATT", 0].fields["Roll"].unit == unit


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
    from attlog.flight import damage

    [told] = damage(log)
    assert "damaged in 2500 places" in told.text
    assert told.count == 2500


def test_an_sdlog2_clock_of_text_is_refused_with_the_reason(tmp_path: Path) -> None:
    path = tmp_path / "hostile.px4log"
    first = fmt(129, 11, b"TIME", b"Q", b"StartTime")
    path.write_bytes(HEAD + first + fmt(129, 67, b"TIME", b"Z", b"StartTime") + record(129, "64s", b"noon"))
    with pytest.raises(LogUnusable, match="no TIME record"):
        sdlog2.read(path)


def test_the_groups_of_a_false_sdlog2_time_have_none(tmp_path: Path) -> None:
    path = tmp_path / "hostile.px4log"
    defined = fmt(129, 11, b"TIME", b"Q", b"StartTime") + fmt(130, 7, b"IMU", b"f", b"GyroX")
    times = [1_000_000 + 10_000 * i for i in range(200)]
    times[100], times[150] = 2**63 + 5, 10**12
    rows = b"".join(record(129, "Q", t) + record(130, "f", 1.0) for t in times)
    path.write_bytes(HEAD + defined + rows)
    log = sdlog2.read(path)
    told = log["IMU", 0][sdlog2.TIME]
    assert np.flatnonzero(told < 0).tolist() == [100, 150]
    assert (log.damage_places, len(log.boots)) == (2, 1)


# Text.


@pytest.mark.parametrize("digits", [27, 3_000_000])
def test_numbers_that_almost_fit_do_not_backtrack(tmp_path: Path, digits: int) -> None:
    cells = b", " + b"1" * digits
    line = b"IMU" + cells * 30 if digits < 100 else b"IMU" + cells
    log = opened(tmp_path, LINES + b"FMT, 129, 23, IMU, " + b"f" * 32 + b", A\n" + line + b", x\n", ".log")
    assert (len(log), log.damage_places) == (0, 1)


def test_the_issue_file_of_247_bytes_is_refused_or_read_at_once(tmp_path: Path) -> None:
    letters = b"f" * 16
    path = tmp_path / "redos.log"
    path.write_bytes(LINES + b"FMT, 129, 23, IMU, " + letters + b", A,B\nIMU" + b", 1111111111" * 15 + b", 1x\n")
    assert formats.open(path).damage_places == 1


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
