"""DataFlash logs: framing, formats, units, clocks, and the text form."""

from __future__ import annotations

from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from attlog.core.errors import LogUnusable
from attlog.formats.dataflash import layout, reader, tables, walk
from attlog.formats.dataflash import reader as text
from attlog.formats.dataflash.layout import MessageFormat
from attlog.formats.dataflash.tables import time_column
from tests.conftest import corpus_logs
from tests.formats.dataflash.made import form, record, size


def test_units_are_those_of_the_printed_numbers(samples: Path, tmp_path: Path) -> None:
    head = tmp_path / "head.bin"
    head.write_bytes((samples / "copter_steps_stabilize.bin").read_bytes()[:400_001])
    log = reader.read_binary(head)
    assert len(log["IMU", 0]) > 400
    assert [log["MAG", 0].fields[c].unit for c in ("TimeUS", "I", "MagX", "OfsX")] == ["us", None, "mGauss", "mGauss"]
    assert [log["GPS", 0].fields[c].unit for c in ("Lat", "Alt", "GMS")] == ["deglatitude", "m", "ms"]


# Which column of a record is the boot clock, in the formats that ArduPilot's versions wrote.


@pytest.mark.parametrize(
    ("columns", "letters", "clock"),
    [
        ("TimeUS,Status,GMS,GWk,NSats", "QBIHB", ("TimeUS", 1)),  # 3.3 and later
        ("Status,TimeMS,Week,NSats,HDop,Lat,Lng,RelAlt,Alt,Spd,GCrs,VZ,T", "BIHBcLLeeEefI", ("T", 1000)),  # 3.1, 3.2
        ("Status,GMS,GWk,NSats,T", "BIHBI", ("T", 1000)),
        ("TimeMS,GyrX,GyrY", "Iff", ("TimeMS", 1000)),
        ("Status,TimeMS,Week,NSats", "BIHB", None),  # the time of the week alone is no clock of the boot
        ("TimeUS,Value", "ff", None),
    ],
)
def test_the_time_of_the_gps_week_is_never_taken_for_the_boot_clock(columns: str, letters: str, clock: object) -> None:
    fmt: Any = SimpleNamespace(columns=tuple(columns.split(",")), letters=letters)
    assert time_column(fmt) == clock


# DataFlash logs made by hand: layouts, marks, units and clocks, each from both sides of its limit.


def bytes_of(*parts: bytes) -> np.ndarray:
    return np.frombuffer(b"".join(parts), np.uint8)


@pytest.mark.parametrize("letter", list("bBhHiIqQfdnNZcCeELM"))
def test_a_letter_takes_as_many_bytes_as_the_loggers_type(letter: str) -> None:
    """ArduPilot, libraries/AP_Logger/README: one column of each letter and a byte behind it."""
    letters = letter + "B"
    fmt = layout.parse_fmt_record(form(7, "ABC", letters, "X,Y"), 40)
    assert fmt == MessageFormat(7, size(letters), "ABC", letters, ("X", "Y"), 40)
    assert fmt.readable
    assert (fmt.place(0), fmt.place(1)) == (3, size(letters) - 1)
    assert not fmt._replace(length=fmt.length + 1).readable
    assert not fmt._replace(letters=letters + "?").readable


@pytest.mark.parametrize(
    ("change", "fits"),
    [
        ({}, True),
        ({5: 0}, False),
        ({5: 7}, False),
        ({9: 0x81}, False),
        ({25: 7}, False),
        ({4: 2}, False),
        ({4: 3}, True),
        ({3: 128}, False),
        ({3: 128, 4: 89}, True),
    ],
)
def test_a_definition_has_a_name_plain_texts_and_a_length_beyond_its_header(change: dict[int, int], fits: bool) -> None:
    raw = bytearray(form(7, "ABC", "fB", "X,Y"))
    for at, value in change.items():
        raw[at] = value
    assert (layout.parse_fmt_record(bytes(raw), 0) is not None) is fits


def test_a_layout_is_valid_from_its_definition_on_and_the_first_also_before() -> None:
    first, second = form(7, "ABC", "ff", "X,Y"), form(7, "ABD", "ii", "P,Q")
    early, late = record(7, "ff", 1.0, 2.0), record(7, "ii", 3, 4)
    data = bytes_of(early, first, early, first, second, late, late)
    found = walk.index_records(data)
    assert [f.name for f in found.layouts] == ["FMT", "ABC", "ABD"]
    assert found.layout.tolist() == [1, 0, 1, 0, 0, 2, 2]
    assert found.stamps[-1] == 3 + (4 << 32)
    assert found.losses.bytes == 0


@pytest.mark.parametrize("cut", [0, 1, 2, 3, 7, 10, 11, 12])
def test_a_cut_last_record_is_a_loss(cut: int) -> None:
    row = record(7, "fff", 1.0, 2.0, 3.0)
    data = bytes_of(form(7, "ABC", "fff", "X,Y,Z"), row, row, row[:cut])
    found = walk.index_records(data)
    assert found.offsets.tolist() == [0, 89, 104]
    assert found.losses.bytes == cut


def test_a_mark_within_a_payload_begins_no_record_and_unknown_types_are_counted() -> None:
    odd = record(7, "BBBB", 0xA3, 0x95, 7, 1)
    stranger = record(9, "BBBB", 1, 2, 3, 4)
    data = bytes_of(form(7, "ABC", "BBBB", "W,X,Y,Z"), odd, stranger, stranger, odd, odd)
    found = walk.index_records(data)
    assert found.offsets.tolist() == [0, 89, 110, 117]
    (loss,) = found.losses.listed
    assert (loss.offset, loss.length) == (96, 14)
    assert "2 records of type 9" in loss.lost


@pytest.mark.parametrize(
    ("head", "binary"),
    [
        (b"\xa3\x95" + bytes(10), True),
        (b"\xa3\x94" + bytes(10), False),
        (bytes(9) + form(7, "ABC", "fB", "X,Y"), True),
        (bytes(9) + form(7, "ABC", "fB", "X,Y").replace(b"fB\0", b"f!\0"), False),
        (b"\0" * 90 + b"\xa3\x95\0" * 4, False),
        (b"\0" * 90 + b"\xa3\x95\0" * 5, True),
        (b"\0" * 4000 + b"\xa3\x95\0" * 9, False),
        (b"\0" * 4000 + b"\xa3\x95\0" * 10, True),
    ],
)
def test_a_binary_log_shows_a_definition_or_a_mark_every_400_bytes(head: bytes, binary: bool) -> None:
    assert layout.is_dataflash(head) is binary


@pytest.mark.parametrize(
    ("head", "text"),
    [
        (b"FMT, 128, 89, FMT, BBnNZ", True),
        (b"some words\r\n  FMT,128,89,FMT", True),
        (b"xFMT, 128, 89, FMT", False),
        (b"FMT, a, 89, FMT", False),
        (b"FMT, 128, 89, FMT\0", False),
        (b"FMT, 128, 89, FMT" + b"\n" * 4090 + b"\0", True),
    ],
)
def test_a_text_log_shows_a_line_that_defines_a_format(head: bytes, text: bool) -> None:
    assert layout.is_dataflash_text(head) is text


@pytest.mark.parametrize(
    ("name", "unit_id", "factor", "mult_id", "scale", "want"),
    [
        ("m", "m", 0.01, "B", 1.0, "cm"),
        ("m", "m", 0.01, "B", 0.01, "m"),
        ("deg", "D", 1.0, "0", 0.01, "deg"),
        ("s", "s", 1e-6, "F", 1.0, "us"),
        ("m", "m", 100.0, "2", 1.0, "100 m"),
        ("m", "m", 0.0, "z", 1.0, "m"),
        ("m", "-", 1.0, "0", 1.0, None),
        ("m", "m", 1.0, "?", 1.0, None),
        ("", "m", 1.0, "0", 1.0, None),
        ("m", "m", float("nan"), "0", 1.0, None),
    ],
)
def test_a_unit_is_that_of_the_printed_number(
    name: str, unit_id: str, factor: float, mult_id: str, scale: float, want: str | None
) -> None:
    assert tables._unit_text(name, unit_id, factor, mult_id, scale) == want


def test_times_stand_where_their_column_does_and_in_microseconds() -> None:
    forms = [form(7, "AAA", "Qf", "TimeUS,X"), form(8, "BBB", "fQ", "X,TimeUS"), form(9, "CCC", "BIf", "I,TimeMS,X")]
    rows = [record(7, "Qf", 5_000, 1.0), record(8, "fQ", 1.0, 6_000), record(9, "BIf", 3, 7, 1.0)]
    data = bytes_of(*forms, form(10, "DDD", "ff", "X,Y"), *rows, record(10, "ff", 1.0, 2.0), rows[0])
    at, times = tables.record_timeline(data, walk.index_records(data))
    assert times.tolist() == [5_000, 6_000, 7_000, 5_000]
    assert at.tolist()[0] == 4 * 89


# Text logs: values as pymavlink reads them, cut and mixed lines left out.

TEXT_LOGS = corpus_logs(".log")

FORMATS = b"""1

ArduCopter V3.1 (5c6503e2)
FMT, 128, 89, FMT, BBnNZ, Type,Length,Name,Format
FMT, 129, 23, PARM, Nf, Name,Value
FMT, 131, 31, IMU, Iff, TimeMS,GyrX,AccZ
FMT, 132, 67, MSG, Z, Message
FMT, 3, 6, MODE, Mh, Mode,ThrCrs
"""


def log_of(tmp_path: Path, *lines: bytes, end: bytes = b"\n") -> Path:
    path = tmp_path / "flight.log"
    path.write_bytes(FORMATS.replace(b"\n", end) + b"".join(line + end for line in lines))
    return path


@pytest.mark.parametrize("path", TEXT_LOGS, ids=lambda p: p.name)
def test_every_log_of_the_corpus_gives_numbers_without_damage_or_says_where(path: Path) -> None:
    log = text.read_text(path)
    raw = path.read_bytes()
    rows = sum(len(table) for table in log.values())
    lines = [line for line in raw.split(b"\n") if b"," in line and not line.startswith(b"FMT")]
    assert rows + len(log.damage) == len(lines)
    for table in log.values():
        for column in table.fields:
            assert len(table[column]) == len(table)


@pytest.mark.parametrize("end", [b"\n", b"\r\n"])
def test_line_ends_do_not_matter(tmp_path: Path, end: bytes) -> None:
    log = text.read_text(log_of(tmp_path, b"IMU, 10, 0.5, -9.8", b"IMU, 30, NaN, -9.7", end=end))
    assert log["IMU", 0]["TimeMS"].tolist() == [10, 30]
    np.testing.assert_array_equal(log["IMU", 0]["GyrX"], [0.5, np.nan])
    assert log.damage == []
    assert log.info["banner"] == ["1", "ArduCopter V3.1 (5c6503e2)"]


def test_cut_and_mixed_lines_are_left_out_and_told(tmp_path: Path) -> None:
    path = log_of(tmp_path, b"IMU, 10, 0.5, -9.8", b"IMU, 20, 0.5", b"IMU, 30, 0.1IMU, 40, 0.2, -9.8", b"IMU, 50, 1, 2")
    log = text.read_text(path)
    assert log["IMU", 0]["TimeMS"].tolist() == [10, 50]
    assert [path.read_bytes()[d.offset :].split(b",")[1] for d in log.damage] == [b" 20", b" 30"]
    assert log.damage_bytes == sum(d.length for d in log.damage)


def test_numbers_that_no_logger_prints_are_damage(tmp_path: Path) -> None:
    log = text.read_text(log_of(tmp_path, b"IMU, 99999999999999999999, 0, 0", b"IMU, 5, 0x1, 0", b"IMU, 7, -inf, 2"))
    assert log["IMU", 0]["TimeMS"].tolist() == [7]
    assert log["IMU", 0]["GyrX"].tolist() == [-np.inf]
    assert len(log.damage) == 2


def test_further_values_are_ignored_but_a_text_keeps_its_commas(tmp_path: Path) -> None:
    log = text.read_text(log_of(tmp_path, b"IMU, 10, 0.5, -9.8, 7, 8", b"MSG, one, two, three"))
    assert log["IMU", 0]["AccZ"].tolist() == [-9.8]
    assert log.texts[-1].text == "one, two, three"


def test_modes_are_names_and_parameters_take_the_time_before(tmp_path: Path) -> None:
    log = text.read_text(log_of(tmp_path, b"IMU, 10, 0, 0", b"MODE, Loiter, 500", b"PARM, RATE_P, 0.15"))
    assert log["MODE", 0]["Mode"].tolist() == [b"Loiter"]
    assert [(p.name, p.value, p.t_us) for p in log.params] == [("RATE_P", 0.15, 10_000)]


def test_a_column_list_behind_further_values_is_found(tmp_path: Path) -> None:
    path = tmp_path / "converted.log"
    path.write_bytes(b"FMT, 131, 31, IMU, Iff, 0, 0, TimeMS,GyrX,AccZ\nIMU, 5, 1, 2\n")
    assert list(text.read_text(path)["IMU", 0].fields) == ["TimeMS", "GyrX", "AccZ"]


def test_a_clock_that_falls_splits_the_log(tmp_path: Path) -> None:
    rows = [b"IMU, %d, 0, 0" % t for t in [*range(60_000, 60_500, 20), *range(1000, 1500, 20)]]
    log = text.read_text(log_of(tmp_path, *rows))
    assert [len(log.boot(k)["IMU", 0]) for k in (0, 1)] == [25, 25]


def test_text_without_formats_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "notes.log"
    path.write_text("IMU, 1, 2, 3\n")
    with pytest.raises(LogUnusable, match="no FMT line"):
        text.read_text(path)
