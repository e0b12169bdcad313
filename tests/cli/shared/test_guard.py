"""The process that waits for one with a mapped log: it tells what that one could not, and hands an interrupt on."""

from __future__ import annotations

import subprocess
import sys
import time
from pathlib import Path

import pytest

pytestmark = pytest.mark.skipif(sys.platform == "win32", reason="nothing is forked there")
HEAD = """
import signal, sys, time
from attlog.base import limits
from attlog.cli.shared import guard
limits.READ_BYTES = 1
guard.INTERRUPTED_S = 1
"""


def started(body: str, log: Path) -> subprocess.Popen[str]:
    """A process that runs ``body`` under the guard of a log."""
    log.write_bytes(bytes(10))
    code = f"{HEAD}{body}\nsys.exit(guard.guarded(run, [{str(log)!r}]))"
    return subprocess.Popen([sys.executable, "-c", code], stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)


def test_an_error_that_nobody_told_is_told(tmp_path: Path) -> None:
    """Where memory is too short to write the sentence, or to import what writes it; it was 70 and silence."""
    out, err = (process := started("def run(): raise MemoryError", tmp_path / "x.ulg")).communicate(timeout=30)
    assert (process.returncode, out) == (75, "")
    assert err.startswith("attlog: memory ran out")


def test_an_interrupt_of_the_waiting_process_alone_reaches_the_other(tmp_path: Path) -> None:
    """``kill -INT``, or a program that started it: only a terminal interrupts both. It was ignored."""
    body = """
def run():
    signal.signal(signal.SIGINT, signal.default_int_handler)
    try:
        print("begun", flush=True)
        time.sleep(30)
    except KeyboardInterrupt:
        return 130
    return 0
"""
    process = started(body, tmp_path / "x.ulg")
    assert process.stdout is not None
    assert process.stdout.readline() == "begun\n"
    begin = time.monotonic()
    process.send_signal(2)
    assert process.wait(timeout=25) == 130
    assert time.monotonic() - begin < 20
    process.communicate()
