"""One log in a process of its own where no program can fork: the same records, from fresh interpreters."""

from __future__ import annotations

import errno
import fcntl
import os
import socket
import sys
import threading
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import pytest

from attlog.base.errors import OutputError
from attlog.base.processes.forks import Closed, Forks
from attlog.fleet.processes.run import forks, run_one
from attlog.fleet.records.lock import locked
from attlog.fleet.records.record import Record
from tests.fleet.harm import harm, installed
from tests.fleet.processes.test_run import gone, pid_in, plugin, work


@pytest.fixture
def processes(monkeypatch: pytest.MonkeyPatch) -> Iterator[Forks]:
    monkeypatch.delattr(os, "fork")
    for name in ("send_fds", "recv_fds"):
        monkeypatch.delattr(socket, name)
    with installed():
        kept = forks()
        yield kept
        kept.close()


def unmeasured(record: Record) -> Record:
    return replace(record, wall_s=0.0, cpu_s=0.0, peak_mb=0.0)


@pytest.mark.slow
def test_a_fresh_process_writes_what_a_forked_one_does(tmp_path: Path, request: pytest.FixtureRequest) -> None:
    forking = forks()
    forked = run_one(work(tmp_path / "forked"), forking)
    forking.close()
    stages: list[str] = []
    without = request.getfixturevalue("processes")
    fresh = run_one(work(tmp_path / "fresh"), without, lambda told: stages.extend(map(str, told)))
    assert unmeasured(fresh) == unmeasured(forked)
    assert (fresh.code, "stage" in stages) == (0, True)


@pytest.mark.slow
def test_a_fresh_process_that_fails_is_one_record(tmp_path: Path, processes: Forks) -> None:
    record = run_one(work(tmp_path, specs=harm("import os; os._exit(9)")), processes)
    assert (record.code, "without a word (exit status 9)" in record.message) == (70, True)
    slow = replace(work(tmp_path, specs=harm("import time; time.sleep(100)")), timeout=3.0)
    record = run_one(slow, processes)
    assert (record.code, "longer than 3 s" in record.message) == (75, True)


def test_closing_ends_fresh_processes_too(tmp_path: Path, processes: Forks) -> None:
    body = f"import os, time\nopen({str(tmp_path / 'pid')!r}, 'w').write(str(os.getpid()))\ntime.sleep(100)"
    ended: list[object] = []

    def run() -> None:
        try:
            ended.append(run_one(work(tmp_path, specs=plugin(tmp_path, body)), processes))
        except Closed as closed:
            ended.append(closed)

    thread = threading.Thread(target=run)
    thread.start()
    pid = pid_in(tmp_path / "pid")
    processes.close()
    thread.join(10)
    assert [type(e) for e in ended] == [Closed]
    assert gone(pid)
    with pytest.raises(Closed):
        run_one(work(tmp_path), processes)


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
