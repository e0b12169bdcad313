"""A log names its messages as it likes: files stay in their folder, the terminal hears none of it, no cell is run."""

from __future__ import annotations

import csv
import json
import os
import re
from pathlib import Path

import pytest

NAMES = ("../../../pwned", "=1+1", "\x1b[31mred", "[red]x", "-rf", "x" * 240, "AA", "aa", "nul", "...")
CONTROL = re.compile("[\x00-\x08\x0b-\x1f\x7f-\x9f\u202a-\u202e]")
HEAD = """FMT, 128, 89, FMT, BBnNZ, Type,Length,Name,Format,Columns
FMT, 132, 49, IMU, QBffffff, TimeUS,I,GyrX,GyrY,GyrZ,AccX,AccY,AccZ
FMT, 133, 75, MSG, QZ, TimeUS,Message
FMT, 134, 20, FOO, QI, TimeUS,V
"""


@pytest.fixture(scope="module")
def hostile(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A text log of a second at rest whose messages, texts and fields attack whoever writes or prints them."""
    lines = [HEAD]
    for k, name in enumerate(NAMES):
        lines.append(f"FMT, {200 + k}, 20, {name}, QdN, TimeUS,=cmd,T\n")
        lines += [f"{name}, 100000000, 1.0, =1+1\n", f"{name}, 100001000, -2.0, -5\n"]
    lines.append("MSG, 100000000, \x1b]0;title\x07 [red]x[/red] \x9b31m\u202e=1\n")
    lines += [f"IMU, {100_000_000 + 4000 * k}, 0, 0, 0, 0.001, 0.1, 0, -9.8\n" for k in range(300)]
    path = tmp_path_factory.mktemp("hostile") / "log.log"
    path.write_text("".join(lines), encoding="utf-8")
    return path


def test_extract_writes_each_table_once_and_inside_the_folder(attlog, hostile, tmp_path):
    folder = tmp_path / "a" / "b" / "c"
    done = attlog("extract", hostile, "-o", folder)
    assert (done.code, done.err) == (0, "")
    inside = sorted(p for p in tmp_path.rglob("*") if p.is_file())
    assert {p.parent for p in inside} == {folder}
    tables = [p for p in inside if p.suffix == ".csv"]
    assert list(tmp_path.parent.glob("pwned*")) == []
    told = [json.loads(Path(f"{p}.json").read_text())["table"] for p in tables]
    assert len(set(told)) == len(told)
    assert {"../../../pwned", "=1+1", "-rf", "AA", "aa", "nul", "IMU"} <= set(told)
    assert not CONTROL.search(done.out)


def test_extracted_cells_and_headers_are_not_run(attlog, hostile, tmp_path):
    assert attlog("extract", hostile, "AA", "-o", tmp_path / "a.csv").code == 0
    head, first, second = csv.reader((tmp_path / "a.csv").open(newline=""))
    assert head == ["time_s", "TimeUS", "'=cmd", "T"]
    assert (first[2:], second[2:]) == (["1.0", "'=1+1"], ["-2.0", "-5"])


def test_a_planted_link_is_replaced_and_not_followed(attlog, hostile, tmp_path):
    folder, precious = tmp_path / "out", tmp_path / "precious"
    folder.mkdir()
    precious.write_text("mine")
    os.symlink(precious, folder / "MSG.csv")
    assert attlog("extract", hostile, "MSG", "-o", folder).code == 0
    assert precious.read_text() == "mine"
    assert not (folder / "MSG.csv").is_symlink()


@pytest.mark.parametrize(
    "command",
    [
        ["info"],
        ["info", "-v"],
        ["info", "--json"],
        ["health", "-v"],
        ["health", "--json"],
        ["analyze", "--estimators", "gyro", "-v"],
        ["analyze", "--estimators", "gyro", "--json"],
        ["extract", "nothing"],
        ["extract", "-o", "-", "AA"],
    ],
)
def test_no_command_of_a_log_reaches_the_terminal(attlog, hostile, tmp_path, command):
    place = ["-o", tmp_path / "out"] if command[0] == "analyze" else []
    done = attlog(command[0], hostile, *command[1:], *place)
    assert done.code in (0, 2)
    assert CONTROL.search(done.out + done.err) is None
    assert "[red]x" in done.out or command != ["info"]
    if "--json" in command:
        assert json.loads(done.out)


def test_a_name_of_a_file_steers_no_terminal(attlog, tmp_path):
    log = tmp_path / "\x1b[31m\x9b\u202e[red].ulg"
    log.write_bytes(b"no log")
    for command in ("info", "health", "analyze", "extract", "compare"):
        done = attlog(
            command,
            log,
            *(["mahony", "gyro"] if command == "compare" else ["-o", tmp_path / "o"] * (command != "info")),
        )
        assert done.code == 65
        assert CONTROL.search(done.out + done.err) is None
        assert "[31m" in done.err


@pytest.mark.parametrize("name", ["names.ulg", "names.log", "coll.ulg"])
def test_crafted_logs_of_the_corpus_stay_inside(attlog, corpus, tmp_path, name):
    folder = tmp_path / "a" / "b"
    assert attlog("extract", corpus / "hostile" / name, "-o", folder).code == 0
    assert {p.parent for p in tmp_path.rglob("*") if p.is_file()} == {folder}
