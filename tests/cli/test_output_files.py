"""What a command writes is never what it reads, nor a flight log; devices and pipes stay what they are."""

from __future__ import annotations

import csv
import json
import os
import re
import shutil
import signal
import stat
import subprocess
import sys
import threading
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from attlog import formats
from tests.conftest import SAMPLES

LOG = SAMPLES / "copter_yaw_turns.bin"
GYRO = ("--estimators", "gyro", "--reference", "onboard", "-q")
pytestmark = pytest.mark.usefixtures("interruptible")
POSIX = pytest.mark.skipif(os.name != "posix", reason="devices and pipes as POSIX knows them")


@pytest.fixture
def log(tmp_path: Path) -> Path:
    """A log that could be lost."""
    return Path(shutil.copy(LOG, tmp_path / "flight.md"))


@pytest.mark.parametrize("option", ["--junit", "--summary"])
@pytest.mark.parametrize("which", ["this log", "another log", "a link to it"])
def test_no_output_takes_the_place_of_a_log(
    attlog: Callable[..., Any], log: Path, tmp_path: Path, option: str, which: str
) -> None:
    read, written = log, log
    if which == "another log":
        read = Path(shutil.copy(LOG, tmp_path / "other.bin"))
    elif which == "a link to it":
        written = tmp_path / "link.md"
        written.symlink_to(log)
    done = attlog("batch", read, *GYRO, "-o", tmp_path / "out", option, written)
    assert done.code == 2
    assert "would be overwritten" in done.err
    assert log.read_bytes() == LOG.read_bytes()
    assert not (tmp_path / "out").exists()


def test_no_output_takes_the_place_of_another_input(attlog: Callable[..., Any], tmp_path: Path) -> None:
    gates = tmp_path / "gates.toml"
    gates.write_text("[gates]\nlag_ms = { max = 5 }\n")
    assert attlog("batch", LOG, *GYRO, "-o", tmp_path / "out", "--gates", gates, "--junit", gates).code == 2
    estimate = tmp_path / "mine.csv"
    estimate.write_text("time_s,roll_deg\n")
    words = ("batch", LOG, "--estimators", f"gyro,{estimate}", "--junit", estimate, "-o", tmp_path / "out")
    assert attlog(*words).code == 2
    assert attlog("diff", estimate, gates, "-o", estimate).code == 2
    assert attlog("diff", gates, estimate, "-o", estimate).code == 2
    assert estimate.read_text() == "time_s,roll_deg\n"
    assert gates.read_text().startswith("[gates]")


@POSIX
def test_a_pipe_is_written_into_and_stays(attlog: Callable[..., Any], tmp_path: Path) -> None:
    pipe = tmp_path / "pipe"
    os.mkfifo(pipe)
    read: list[str] = []
    reader = threading.Thread(target=lambda: read.append(pipe.read_text()), daemon=True)
    place = os.open(pipe, os.O_RDONLY | os.O_NONBLOCK)  # so that the writer meets a reader, whoever is first
    reader.start()
    assert attlog("batch", LOG, *GYRO, "-o", tmp_path / "out", "--junit", pipe).code == 0
    os.close(place)
    reader.join(10)
    assert read[0].endswith("</testsuites>\n")
    assert stat.S_ISFIFO(pipe.stat().st_mode)


@pytest.mark.parametrize("name", ["", "..", "a/b", "x" * 300, "/abs"])
def test_a_comparison_stays_in_its_folder(attlog: Callable[..., Any], tmp_path: Path, name: str) -> None:
    done = attlog("compare", LOG, "gyro", "mahony", "-o", tmp_path / "out", "--name", name)
    assert done.code == 2
    assert not (tmp_path / "out").exists()


@POSIX
@pytest.mark.parametrize("command", ["info", "health", "analyze", "batch", "compare", "extract"])
def test_a_pipe_in_place_of_a_log_is_refused_at_once(attlog: Callable[..., Any], tmp_path: Path, command: str) -> None:
    pipe = tmp_path / "log.ulg"
    os.mkfifo(pipe)
    more = ["gyro", "mahony"] if command == "compare" else []
    place = [] if command == "info" else ["-o", tmp_path / "out"]
    done = attlog(command, pipe, *more, *place)
    assert done.code == 66
    assert "is no regular file" in done.err


def test_what_is_no_log_is_refused_before_it_is_read(attlog: Callable[..., Any], tmp_path: Path) -> None:
    """The image of a disk, here a file of which only the size is there: hashing it would take hours."""
    image = tmp_path / "disk.ulg"
    with image.open("wb") as file:
        file.truncate(1 << 40)
    signals = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)
    before = [signal.getsignal(number) for number in signals]
    for command in ("analyze", "batch"):
        assert attlog(command, image, "-o", tmp_path / "out").code == 65
    assert [signal.getsignal(number) for number in signals] == before  # another process has watched the mapped file
    settings = tmp_path / "settings.toml"
    os.link(image, settings)
    assert attlog("analyze", LOG, "--config", settings).code == 2


@pytest.mark.parametrize("command", ["info", "health", "analyze", "extract"])
def test_a_log_that_no_memory_can_hold_is_no_bug(
    attlog: Callable[..., Any], tmp_path: Path, monkeypatch: pytest.MonkeyPatch, command: str
) -> None:
    def too_much(*_: object, **__: object) -> None:
        raise MemoryError("Unable to allocate 193. GiB for an array")

    monkeypatch.setattr("attlog.formats.open", too_much)
    done = attlog(command, LOG, *([] if command == "info" else ["-o", tmp_path / "out"]))
    assert done.code == 75
    assert "memory ran out" in done.err
    assert "bug" not in done.err


@pytest.mark.parametrize(
    "words", [["analyze", ""], ["diff", "", ""], ["table", ""], ["analyze", LOG, "-o", ""], ["batch", LOG, "--junit="]]
)
def test_an_unset_variable_means_no_folder(
    attlog: Callable[..., Any], tmp_path: Path, monkeypatch: pytest.MonkeyPatch, words: list[Any]
) -> None:
    monkeypatch.chdir(tmp_path)
    done = attlog(*words)
    assert (done.code, "an empty word" in done.err) == (2, True)
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("command", ["analyze", "batch", "compare"])
def test_a_window_is_judged_before_any_log_is_read(attlog: Callable[..., Any], tmp_path: Path, command: str) -> None:
    more = ["gyro", "mahony"] if command == "compare" else []
    done = attlog(command, LOG, *more, "--window", "5:1", "-o", tmp_path / "out")
    assert done.code == 2
    assert done.err.startswith("attlog: --window '5:1': use all")
    assert not (tmp_path / "out").exists()


# Files that are cut, disks that are full, outputs that are closed, runs that are ended: a sentence and a code.

LINUX = pytest.mark.skipif(sys.platform != "linux", reason="signals and limits as Linux knows them")
MAPPED = """
import os, sys
from attlog.core import limits
limits.READ_BYTES = 1000
import attlog.flight
inside = attlog.flight.flight_in
def cut(messages, *a, **k):
    os.truncate(sys.argv[2], 5000)
    return inside(messages, *a, **k)
attlog.flight.flight_in = cut
from attlog.cli import main
main()
"""


def attlog(*words: object, before: str = "", **how: object) -> subprocess.CompletedProcess[str]:
    start = ["-m", "attlog"] if not before else ["-c", before]
    command = [sys.executable, *start, *map(str, words)]
    return subprocess.run(command, stderr=subprocess.PIPE, text=True, **how)  # type: ignore[call-overload, no-any-return]


@pytest.mark.slow
@LINUX
@pytest.mark.parametrize(
    ("before", "said"),
    [
        (MAPPED, "became shorter while it was read"),
        (MAPPED.replace("limits.READ_BYTES = 1000", ""), "changed while it was read"),
    ],
    ids=["mapped", "read"],
)
def test_a_log_that_is_cut_while_it_is_analysed_is_66(tmp_path: Path, before: str, said: str) -> None:
    log = tmp_path / "a.bin"
    log.write_bytes(LOG.read_bytes())
    words = ("analyze", log, "-q", "-o", tmp_path / "out", "--estimators", "gyro")
    done = attlog(*words, before=before, stdout=subprocess.PIPE)
    assert (done.returncode, done.stderr.count("\n"), said in done.stderr) == (66, 1, True), done.stderr
    assert not (tmp_path / "out").exists()


@LINUX
def test_a_closed_standard_output_is_73() -> None:
    command = f"{sys.executable} -m attlog info {LOG} >&-"
    done = subprocess.run(["sh", "-c", command], capture_output=True, text=True)
    assert (done.returncode, done.stderr.count("\n")) == (73, 1), done.stderr
    assert "standard output cannot be written" in done.stderr


@LINUX
def test_with_all_streams_closed_the_files_are_written(tmp_path: Path) -> None:
    out = tmp_path / "att.csv"
    command = f"{sys.executable} -m attlog extract {LOG} ATT -q -o {out} <&- >&- 2>&-"
    assert subprocess.run(["sh", "-c", command]).returncode == 0
    assert out.read_text().startswith("time_s,")


@pytest.mark.slow
@LINUX
def test_where_the_disk_takes_one_file_and_not_the_other_both_old_ones_stay(tmp_path: Path) -> None:
    head = '<!doctype html><html><head><meta http-equiv="Content-Security-Policy" content="default-src"><title>a'
    old = {
        tmp_path / f"{LOG.name}.html": f"{head} · attitude report</title>",
        tmp_path / f"{LOG.name}.json": '{"schema":"attlog-result/7"}',
    }
    for path, text in old.items():
        path.write_text(text)
    before = (
        "import attlog.core.files as o\nreal = o.write_atomic\n"
        "def write(path, data, kind=None):\n"
        "    if path.suffix == '.json':\n"
        "        raise o._write_error(path, OSError(28, 'No space left on device'))\n"
        "    real(path, data, kind)\n"
        "o.write_atomic = write\nfrom attlog.cli import main\nmain()\n"
    )
    done = attlog("analyze", LOG, "-o", tmp_path, "--estimators", "gyro", before=before, stdout=subprocess.PIPE)
    assert done.returncode == 73, done.stderr
    assert f"{LOG.name}.json: cannot be written (No space left on device)" in done.stderr
    assert {path: path.read_text() for path in tmp_path.iterdir()} == old


@LINUX
def test_a_run_that_is_ended_leaves_old_reports_and_nothing_else(tmp_path: Path) -> None:
    assert attlog("analyze", LOG, "-q", "-o", tmp_path, "--estimators", "gyro").returncode == 0
    earlier = {path.name: path.read_bytes() for path in tmp_path.iterdir()}
    before = (
        "import time, pathlib, attlog.result as r\nreal = r.Result.to_json\n"
        "def slow(self, path=None, *a, **k):\n"
        "    text = real(self, path, *a, **k)\n"
        f"    pathlib.Path({str(tmp_path / 'there')!r}).touch() if path else None\n"
        "    time.sleep(60 if path else 0)\n    return text\n"
        "r.Result.to_json = slow\nfrom attlog.cli import main\nmain()\n"
    )
    run = subprocess.Popen(
        [sys.executable, "-c", before, "analyze", LOG, "-o", tmp_path, "--estimators", "gyro"],
        stdout=subprocess.DEVNULL,
        stderr=subprocess.PIPE,
        text=True,
        start_new_session=True,
    )
    for _ in range(2400):
        if (tmp_path / "there").exists() or run.poll() is not None:
            break
        time.sleep(0.05)
    os.kill(run.pid, signal.SIGTERM)
    _, err = run.communicate(timeout=60)
    assert (run.returncode, "Traceback" in err) == (130, False), err
    assert {path.name: path.read_bytes() for path in tmp_path.iterdir()} == earlier | {"there": b""}


@LINUX
def test_the_library_reads_a_large_log_that_is_cut_meanwhile(tmp_path: Path) -> None:
    log = tmp_path / "a.bin"
    log.write_bytes(LOG.read_bytes())
    code = (
        "import os, sys, attlog.core.limits\nattlog.core.limits.READ_BYTES = 1000\nfrom attlog import formats\n"
        "log = formats.open(sys.argv[1])\nos.truncate(sys.argv[1], 5000)\n"
        "print(sum(len(table[c]) for table in log.values() for c in table.fields))"
    )
    whole = formats.open(LOG)
    done = subprocess.run([sys.executable, "-c", code, log], capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    assert int(done.stdout) == sum(len(table) * len(table.fields) for table in whole.values())


# A log names its messages as it likes: files stay in their folder, the terminal hears none of it, no cell is run.

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


def test_a_planted_link_is_neither_replaced_nor_followed(attlog, hostile, tmp_path):
    folder, precious = tmp_path / "out", tmp_path / "precious"
    folder.mkdir()
    precious.write_text("mine")
    os.symlink(precious, folder / "MSG.csv")
    assert attlog("extract", hostile, "MSG", "-o", folder).code == 73
    assert precious.read_text() == "mine"
    assert (folder / "MSG.csv").is_symlink()


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
    assert "[red]x" in done.out or command != ["info", "-v"]
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
