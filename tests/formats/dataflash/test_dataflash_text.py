"""Text logs: values as pymavlink reads them, cut and mixed lines left out."""

from __future__ import annotations

from collections import defaultdict
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from attlog.base.errors import LogUnusable
from attlog.formats.dataflash import text
from attlog.formats.mapping import text_of
from tests.conftest import corpus_logs

# the clock of pymavlink's text reader fails on logs without time fields
WITHOUT_TIME = ("octo_pm", "tradheli", "underpowered", "noimu")
LOGS = corpus_logs(".log")

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


@pytest.mark.parametrize("path", [p for p in LOGS if not any(w in p.name for w in WITHOUT_TIME)], ids=lambda p: p.name)
def test_every_value_equals_what_pymavlink_reads(path: Path) -> None:
    from pymavlink.DFReader import DFReader_text

    reader = DFReader_text(str(path))
    theirs: dict[str, dict[str, list[Any]]] = defaultdict(lambda: defaultdict(list))
    while (message := reader.recv_msg()) is not None:
        for column in message.get_fieldnames():
            theirs[message.get_type()][column].append(getattr(message, column))
    ours = text.read(path)
    theirs.pop("FMT")  # a layout, not data
    assert set(ours.names()) == set(theirs)
    for name, columns in theirs.items():
        for column, values in columns.items():
            mine = ours[name, 0][column]
            if mine.dtype.kind == "S":
                assert [text_of(raw) for raw in mine.tolist()] == [str(v).strip() for v in values], (name, column)
            else:
                np.testing.assert_array_equal(mine, np.array(values, mine.dtype), err_msg=f"{name}.{column}")


@pytest.mark.parametrize("path", LOGS, ids=lambda p: p.name)
def test_every_log_of_the_corpus_gives_numbers_without_damage_or_says_where(path: Path) -> None:
    log = text.read(path)
    raw = path.read_bytes()
    rows = sum(len(table) for table in log.values())
    lines = [line for line in raw.split(b"\n") if b"," in line and not line.startswith(b"FMT")]
    assert rows + len(log.damage) == len(lines)
    for table in log.values():
        for column in table.fields:
            assert len(table[column]) == len(table)


@pytest.mark.parametrize("end", [b"\n", b"\r\n"])
def test_line_ends_do_not_matter(tmp_path: Path, end: bytes) -> None:
    log = text.read(log_of(tmp_path, b"IMU, 10, 0.5, -9.8", b"IMU, 30, NaN, -9.7", end=end))
    assert log["IMU", 0]["TimeMS"].tolist() == [10, 30]
    np.testing.assert_array_equal(log["IMU", 0]["GyrX"], [0.5, np.nan])
    assert log.damage == []
    assert log.info["banner"] == ["1", "ArduCopter V3.1 (5c6503e2)"]


def test_cut_and_mixed_lines_are_left_out_and_told(tmp_path: Path) -> None:
    path = log_of(tmp_path, b"IMU, 10, 0.5, -9.8", b"IMU, 20, 0.5", b"IMU, 30, 0.1IMU, 40, 0.2, -9.8", b"IMU, 50, 1, 2")
    log = text.read(path)
    assert log["IMU", 0]["TimeMS"].tolist() == [10, 50]
    assert [path.read_bytes()[d.offset :].split(b",")[1] for d in log.damage] == [b" 20", b" 30"]
    assert log.damage_bytes == sum(d.length for d in log.damage)


def test_numbers_that_no_logger_prints_are_damage(tmp_path: Path) -> None:
    log = text.read(log_of(tmp_path, b"IMU, 99999999999999999999, 0, 0", b"IMU, 5, 0x1, 0", b"IMU, 7, -inf, 2"))
    assert log["IMU", 0]["TimeMS"].tolist() == [7]
    assert log["IMU", 0]["GyrX"].tolist() == [-np.inf]
    assert len(log.damage) == 2


def test_further_values_are_ignored_but_a_text_keeps_its_commas(tmp_path: Path) -> None:
    log = text.read(log_of(tmp_path, b"IMU, 10, 0.5, -9.8, 7, 8", b"MSG, one, two, three"))
    assert log["IMU", 0]["AccZ"].tolist() == [-9.8]
    assert log.texts[-1].text == "one, two, three"


def test_modes_are_names_and_parameters_take_the_time_before(tmp_path: Path) -> None:
    log = text.read(log_of(tmp_path, b"IMU, 10, 0, 0", b"MODE, Loiter, 500", b"PARM, RATE_P, 0.15"))
    assert log["MODE", 0]["Mode"].tolist() == [b"Loiter"]
    assert [(p.name, p.value, p.t_us) for p in log.params] == [("RATE_P", 0.15, 10_000)]


def test_a_column_list_behind_further_values_is_found(tmp_path: Path) -> None:
    path = tmp_path / "converted.log"
    path.write_bytes(b"FMT, 131, 31, IMU, Iff, 0, 0, TimeMS,GyrX,AccZ\nIMU, 5, 1, 2\n")
    assert list(text.read(path)["IMU", 0].fields) == ["TimeMS", "GyrX", "AccZ"]


def test_a_clock_that_falls_splits_the_log(tmp_path: Path) -> None:
    rows = [b"IMU, %d, 0, 0" % t for t in [*range(60_000, 60_500, 20), *range(1000, 1500, 20)]]
    log = text.read(log_of(tmp_path, *rows))
    assert [len(log.boot(k)["IMU", 0]) for k in (0, 1)] == [25, 25]


def test_text_without_formats_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "notes.log"
    path.write_text("IMU, 1, 2, 3\n")
    with pytest.raises(LogUnusable, match="no FMT line"):
        text.read(path)
