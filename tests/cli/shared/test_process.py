"""How the process ends: by signals, beside a child with a mapped log, with a standard output that fails."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

from attlog.cli.shared.process import ended_by_signals
from tests.conftest import SAMPLES, few

pytestmark = pytest.mark.usefixtures("interruptible")


@pytest.mark.parametrize("number", [signal.SIGTERM, signal.SIGHUP, signal.SIGINT])
def test_a_signal_interrupts_and_is_told(number: signal.Signals) -> None:
    before = signal.getsignal(number)
    with ended_by_signals() as received, pytest.raises(KeyboardInterrupt):
        signal.raise_signal(number)
    assert received == [number]
    assert signal.getsignal(number) == before


def test_what_nohup_ignores_stays_ignored() -> None:
    before = signal.signal(signal.SIGHUP, signal.SIG_IGN)
    try:
        with ended_by_signals() as received:
            signal.raise_signal(signal.SIGHUP)
        assert received == []
    finally:
        signal.signal(signal.SIGHUP, before)


@pytest.mark.skipif(os.name != "posix", reason="signals")
def test_an_interrupt_during_start_up_leaves_no_traceback(tmp_path):
    (tmp_path / "typer.py").write_text("import os, signal, time\nos.kill(os.getpid(), signal.SIGINT)\ntime.sleep(5)\n")
    path = os.pathsep.join([str(tmp_path), *filter(None, [os.environ.get("PYTHONPATH")])])
    done = subprocess.run(
        [sys.executable, "-m", "attlog", "--help"],
        env=os.environ | {"PYTHONPATH": path},
        capture_output=True,
        text=True,
    )
    assert (done.returncode, done.stderr) == (-signal.SIGINT, "")


FORKS = pytest.mark.skipif(sys.platform == "win32", reason="nothing is forked there")
HEAD = """
import signal, sys, time
from attlog.base import limits
from attlog.cli.shared import process
limits.READ_BYTES = 1
process.INTERRUPTED_S = 1
"""


def started(body: str, log: Path) -> subprocess.Popen[str]:
    """A process that runs ``body`` under the guard of a log."""
    log.write_bytes(bytes(10))
    code = f"{HEAD}{body}\nsys.exit(process.guarded(run, [{str(log)!r}]))"
    return subprocess.Popen([sys.executable, "-c", code], stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)


@FORKS
def test_an_error_that_nobody_told_is_told(tmp_path: Path) -> None:
    """Where memory is too short to write the sentence, or to import what writes it; it was 70 and silence."""
    out, err = (process := started("def run(): raise MemoryError", tmp_path / "x.ulg")).communicate(timeout=30)
    assert (process.returncode, out) == (75, "")
    assert err.startswith("attlog: memory ran out")


@FORKS
def test_an_interrupt_of_the_waiting_process_alone_reaches_the_other(tmp_path: Path) -> None:
    """``kill -INT``, or a program that started it: only a terminal interrupts both. It was ignored."""
    body = """
def run():
    signal.signal(signal.SIGINT, signal.default_int_handler)
    try:
        time.sleep(0.5)  # until the other has its handlers
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


LOG = SAMPLES / "copter_yaw_turns.bin"
COMMANDS = {
    "help": ["--help"],
    "schema": ["schema"],
    "estimators": ["estimators"],
    "one estimator": ["estimators", "vqf"],
    "info": ["info", LOG],
    "info json": ["info", LOG, "--json"],
    "extract": ["extract", LOG, "ATT", "-o", "-"],
    "analyze": ["analyze", LOG, "--estimators", "gyro", "-o", "OUT"],
}


def start(arguments: list[str | Path | bytes], tmp_path: Path, **how: object) -> subprocess.CompletedProcess[bytes]:
    command = [sys.executable, "-m", "attlog", *(str(tmp_path / "out") if a == "OUT" else a for a in arguments)]
    return subprocess.run(command, stderr=subprocess.PIPE, **how)  # type: ignore[call-overload, no-any-return]


@pytest.mark.skipif(not os.path.exists("/dev/full"), reason="no full device here")
@pytest.mark.parametrize("arguments", few(COMMANDS.values(), 2), ids=COMMANDS.keys())
def test_a_full_disk_behind_standard_output_is_73(tmp_path: Path, arguments: list[str | Path | bytes]) -> None:
    with open("/dev/full", "wb") as full:
        done = start(arguments, tmp_path, stdout=full)
    assert (done.returncode, done.stderr.count(b"\n")) == (73, 1), done.stderr
    assert b"standard output cannot be written" in done.stderr


@pytest.mark.parametrize("arguments", few([["schema"], ["info", LOG]], 1), ids=["schema", "info"])
def test_a_reader_that_goes_away_hears_nothing(tmp_path: Path, arguments: list[str | Path | bytes]) -> None:
    ours, theirs = os.pipe()
    os.close(ours)
    done = start(arguments, tmp_path, stdout=theirs)
    os.close(theirs)
    assert (done.returncode, done.stderr) == (73, b"")


@pytest.mark.parametrize("encoding", ["ascii", "latin-1", "cp1252"])
@pytest.mark.parametrize("arguments", few(COMMANDS.values(), 1), ids=COMMANDS.keys())
def test_every_command_works_where_signs_cannot_be_shown(
    tmp_path: Path, arguments: list[str | Path | bytes], encoding: str
) -> None:
    environment = {**os.environ, "PYTHONIOENCODING": encoding, "NO_COLOR": "1"}
    done = start(arguments, tmp_path, stdout=subprocess.PIPE, env=environment)
    assert done.returncode == 0, done.stderr[-500:]
    text = done.stdout.decode(encoding)
    assert len(text) > 100
    assert "\x1b" not in text
    assert "\\u" not in text.replace("\\udc", "") or arguments[-1] == "--json"
    assert [line for line in text.splitlines() if line != line.rstrip()] == []


@pytest.mark.skipif(sys.platform == "darwin", reason="its file systems keep UTF-8 names only")
@pytest.mark.parametrize(
    "arguments", few([["info"], ["info", "--json"], ["extract", "ATT", "-o", "OUT"], ["extract", "ATT", "-o", "-"]], 1)
)
def test_a_file_name_that_is_not_utf8_works(tmp_path: Path, arguments: list[str]) -> None:
    log = os.path.join(os.fsencode(tmp_path), b"a\xff.bin")
    os.symlink(os.fsencode(LOG), log)
    done = start([arguments[0], log, *arguments[1:]], tmp_path, stdout=subprocess.PIPE)
    assert done.returncode == 0, done.stderr[-500:]
    if arguments == ["info"]:
        assert done.stdout.startswith(b"a\\xff.bin")
