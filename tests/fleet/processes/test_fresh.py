"""One log in a process of its own where no program can fork: the same records, from fresh interpreters."""

from __future__ import annotations

import errno
import fcntl
import os
import signal
import socket
import subprocess
import sys
import threading
import time
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import pytest

from attlog.base.errors import OutputError
from attlog.fleet.processes.nursery import Closed, Nursery
from attlog.fleet.processes.run import run_one
from attlog.fleet.records.lock import locked
from attlog.fleet.records.record import Record
from tests.conftest import few
from tests.fleet.harm import harm, installed
from tests.fleet.processes.test_run import LOG, gone, plugin, work

pytestmark = pytest.mark.usefixtures("interruptible")

ROOT = Path(__file__).parents[3]
POSIX_ALONE = {
    os: ("fork", "killpg", "setsid", "wait4", "sched_getaffinity", "getuid"),
    signal: ("SIGBUS", "SIGHUP", "SIGCHLD"),
    socket: ("send_fds", "recv_fds"),
}
"""What Windows has not, of all that is used here but SIGKILL, which ``subprocess`` itself needs."""


@pytest.fixture
def nursery(monkeypatch: pytest.MonkeyPatch) -> Iterator[Nursery]:
    """In a process that lacks all that Windows lacks."""
    for module, names in POSIX_ALONE.items():
        for name in names:
            monkeypatch.delattr(module, name)
    with installed():
        kept = Nursery()
        yield kept
        kept.close()


def unmeasured(record: Record) -> Record:
    return replace(record, wall_s=0.0, cpu_s=0.0, peak_mb=0.0)


@pytest.mark.slow
def test_a_fresh_process_writes_what_a_forked_one_does(tmp_path: Path, request: pytest.FixtureRequest) -> None:
    forking = Nursery()
    forked = run_one(work(tmp_path / "forked"), forking)
    forking.close()
    stages: list[str] = []
    fresh = run_one(
        work(tmp_path / "fresh"), request.getfixturevalue("nursery"), lambda told: stages.extend(map(str, told))
    )
    assert unmeasured(fresh) == unmeasured(forked)
    assert (fresh.code, "stage" in stages) == (0, True)
    assert 0.1 < fresh.cpu_s < 60
    assert 50 < fresh.peak_mb < 5000
    assert not list((tmp_path / "fresh" / ".attlog" / "rooms").iterdir())


@pytest.mark.parametrize(("body", "code", "words"), few([
    ("import os; os._exit(9)", 70, "without a word (exit status 9)"),
    ("raise KeyboardInterrupt", 70, "without a word (exit status 70)"),
    ("import os, signal; os.kill(os.getpid(), signal.SIGSEGV)", 70, "crashed (SIGSEGV)"),
    ("import time; time.sleep(100)", 75, "longer than 3 s"),
    ("x = bytearray(10**9)\nwhile True: pass", 75, "more than 600 MB"),
], 1))  # fmt: skip
def test_a_fresh_process_that_fails_is_one_record(
    tmp_path: Path, nursery: Nursery, body: str, code: int, words: str
) -> None:
    task = replace(work(tmp_path, specs=harm(body)), timeout=3.0 if "sleep" in body else 300.0, memory=600.0)
    record = run_one(task, nursery)
    assert record.code == code
    assert words in record.message
    assert not list(tmp_path.glob("*.json"))


@pytest.mark.slow
def test_an_interrupt_is_left_to_the_parent(tmp_path: Path, nursery: Nursery) -> None:
    body = "import os, signal; os.kill(os.getpid(), signal.SIGINT)"
    assert run_one(work(tmp_path, specs=harm(body)), nursery).code == 0


@pytest.mark.slow
def test_closing_ends_fresh_processes_too(tmp_path: Path, nursery: Nursery) -> None:
    body = f"import os, time\nopen({str(tmp_path / 'pid')!r}, 'w').write(str(os.getpid()))\ntime.sleep(100)"
    ended: list[object] = []

    def run() -> None:
        try:
            ended.append(run_one(work(tmp_path, specs=plugin(tmp_path, body)), nursery))
        except Closed as closed:
            ended.append(closed)

    thread = threading.Thread(target=run)
    thread.start()
    pid = told(tmp_path / "pid")
    nursery.close()
    thread.join(10)
    assert [type(e) for e in ended] == [Closed]
    assert gone(pid)
    with pytest.raises(Closed):
        run_one(work(tmp_path), nursery)


def told(place: Path) -> int:
    """The process number that a filter wrote to that file."""
    for _ in range(1200):
        if place.exists() and place.read_text():
            return int(place.read_text())
        time.sleep(0.05)
    raise AssertionError("the process never came to its filter")


WITHOUT = """
import os, signal, socket, sys
for module, names in (("os", {os}), ("signal", {signal}), ("socket", {socket})):
    for name in names:
        delattr(sys.modules[module], name)
from attlog.cli import main
main()
"""


FOUND = {"PYTHONPATH": str(ROOT)}


def command_without(*words: object) -> list[str]:
    """The command line in a program that lacks what Windows lacks."""
    code = WITHOUT.format(**{module.__name__: names for module, names in POSIX_ALONE.items()})
    return [sys.executable, "-P", "-c", code, *map(str, words)]


@pytest.mark.slow
def test_several_logs_are_analysed_without_fork_and_no_file_beside_them_is_imported(tmp_path: Path) -> None:
    (tmp_path / "numpy.py").write_text("raise SystemExit('a file beside a log was imported')")
    logs = [tmp_path / name for name in ("a.bin", "b.bin")]
    for log in logs:
        log.write_bytes(LOG.read_bytes())
    command = command_without("analyze", *logs, "-o", tmp_path / "out", "--estimators", "gyro", "-j", 2)
    done = subprocess.run(command, cwd=tmp_path, env=os.environ | FOUND, capture_output=True, text=True, timeout=120)
    assert done.returncode == 0, done.stderr
    assert {"a.bin.html", "b.bin.json"} < {path.name for path in (tmp_path / "out").iterdir()}


@pytest.mark.slow
def test_a_fresh_process_ends_with_a_parent_that_is_killed(tmp_path: Path) -> None:
    body = f"import os, time\nopen({str(tmp_path / 'pid')!r}, 'w').write(str(os.getpid()))\ntime.sleep(100)"
    more = ("--estimators", plugin(tmp_path, body), "--jobs", 1)
    run = subprocess.Popen(
        command_without("batch", LOG, "-o", tmp_path / "out", *more),
        env=os.environ | FOUND, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL,
    )  # fmt: skip
    pid = told(tmp_path / "pid")
    run.kill()
    run.wait()
    assert gone(pid)


def test_the_lock_of_windows_refuses_a_second_batch(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Its call is played by this system's; a lock that another has is refused there as EACCES."""

    def locking(number: int, mode: int, count: int) -> None:
        assert (mode, count) == (2, 1)
        assert os.lseek(number, 0, os.SEEK_CUR) > 1000  # bytes that are locked could not be read
        try:
            fcntl.flock(number, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            raise PermissionError(errno.EACCES, "Permission denied") from None

    monkeypatch.setitem(sys.modules, "msvcrt", SimpleNamespace(LK_NBLCK=2, locking=locking))
    monkeypatch.setattr(sys, "platform", "win32")
    with locked(tmp_path) as warning:
        assert warning == ""
        with pytest.raises(OutputError, match=f"another batch is writing there .process {os.getpid()} on"):
            locked(tmp_path).__enter__()
    with locked(tmp_path):
        pass
