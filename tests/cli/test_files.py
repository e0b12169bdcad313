"""Files that are cut, disks that are full, outputs that are closed, runs that are ended: a sentence and a code."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

from attlog import formats
from tests.conftest import SAMPLES, few

pytestmark = pytest.mark.usefixtures("interruptible")

LOG = SAMPLES / "copter_yaw_turns.bin"
LINUX = pytest.mark.skipif(sys.platform != "linux", reason="signals and limits as Linux knows them")
MAPPED = """
import os, sys
from attlog.base import limits
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
@pytest.mark.parametrize("command", few(["analyze", "extract"], 1))
def test_a_large_log_that_is_cut_while_it_is_mapped_is_66(tmp_path: Path, command: str) -> None:
    log = tmp_path / "a.bin"
    log.write_bytes(LOG.read_bytes())
    done = attlog(command, log, "-o", tmp_path / "out", before=MAPPED, stdout=subprocess.PIPE)
    assert (done.returncode, done.stderr.count("\n")) == (66, 1), done.stderr
    assert "became shorter while it was read" in done.stderr
    assert not (tmp_path / "out").exists()


@pytest.mark.slow
@LINUX
def test_a_log_that_is_cut_while_it_is_analysed_is_66(tmp_path: Path) -> None:
    log = tmp_path / "a.bin"
    log.write_bytes(LOG.read_bytes())
    before = MAPPED.replace("limits.READ_BYTES = 1000", "")
    done = attlog("analyze", log, "-o", tmp_path / "out", "--estimators", "gyro", before=before, stdout=subprocess.PIPE)
    assert (done.returncode, done.stderr.count("\n")) == (66, 1), done.stderr
    assert "changed while it was read" in done.stderr
    assert not (tmp_path / "out").exists()


@LINUX
@pytest.mark.parametrize(
    "words", few([["info", LOG], ["info", LOG, "--json"], ["schema"], ["extract", LOG, "ATT", "-o", "-"]], 1)
)
def test_a_closed_standard_output_is_73(words: list[object]) -> None:
    command = " ".join(map(str, [sys.executable, "-m", "attlog", *words, ">&-"]))
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
    old = {tmp_path / f"{LOG.name}.{kind}": f"old {kind}" for kind in ("html", "json")}
    for path, text in old.items():
        path.write_text(text)
    before = (
        "import attlog.base.files.output as o\nreal = o.write_atomic\n"
        "def write(path, data):\n"
        "    if path.suffix == '.json':\n"
        "        raise o._cannot(path, OSError(28, 'No space left on device'))\n"
        "    real(path, data)\n"
        "o.write_atomic = write\nfrom attlog.cli import main\nmain()\n"
    )
    done = attlog("analyze", LOG, "-o", tmp_path, "--estimators", "gyro", before=before, stdout=subprocess.PIPE)
    assert done.returncode == 73, done.stderr
    assert f"{LOG.name}.json: cannot be written (No space left on device)" in done.stderr
    assert {path: path.read_text() for path in tmp_path.iterdir()} == old


@LINUX
@pytest.mark.parametrize("number", few([signal.SIGINT, signal.SIGTERM, signal.SIGHUP], 1))
def test_a_run_that_is_ended_leaves_old_reports_and_nothing_else(tmp_path: Path, number: int) -> None:
    (tmp_path / f"{LOG.name}.json").write_text("old")
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
    os.kill(run.pid, number)
    _, err = run.communicate(timeout=60)
    assert (run.returncode, "Traceback" in err) == (130, False), err
    assert sorted(p.name for p in tmp_path.iterdir()) == [f"{LOG.name}.json", "there"]
    assert (tmp_path / f"{LOG.name}.json").read_text() == "old"


STARVED = """
import attlog.flight
def starved(*_, **__):
    raise MemoryError("Unable to allocate 16.8 MiB for an array")
attlog.flight.read_messages = starved
from attlog.cli import main
main()
"""


@pytest.mark.parametrize("words", few([["info"], ["analyze", "--estimators", "gyro"], ["extract", "ATT"]], 1))
def test_memory_that_runs_out_is_75_without_a_traceback(tmp_path: Path, words: list[str]) -> None:
    command, *options = words
    out = [] if command == "info" else ["-o", tmp_path / "out"]
    done = attlog(command, LOG, *options, *out, before=STARVED, stdout=subprocess.PIPE)
    assert (done.returncode, done.stderr.count("\n")) == (75, 1), done.stderr
    assert "memory ran out" in done.stderr
    assert not (tmp_path / "out").exists()


@LINUX
def test_the_library_reads_a_large_log_that_is_cut_meanwhile(tmp_path: Path) -> None:
    log = tmp_path / "a.bin"
    log.write_bytes(LOG.read_bytes())
    code = (
        "import os, sys, attlog.base.limits\nattlog.base.limits.READ_BYTES = 1000\nfrom attlog import formats\n"
        "log = formats.open(sys.argv[1])\nos.truncate(sys.argv[1], 5000)\n"
        "print(sum(len(table[c]) for table in log.values() for c in table.fields))"
    )
    whole = formats.open(LOG)
    done = subprocess.run([sys.executable, "-c", code, log], capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    assert int(done.stdout) == sum(len(table) * len(table.fields) for table in whole.values())
