"""How the process ends: by signals, beside a child with a mapped log, with a standard output that fails."""

from __future__ import annotations

import ast
import json
import os
import shutil
import signal
import subprocess
import sys
import time
import zipfile
from pathlib import Path
from typing import Any

import pytest

from attlog.cli.process import ended_by_signals
from tests.conftest import ROOT, SAMPLES, few

pytestmark = pytest.mark.usefixtures("interruptible")


@pytest.mark.parametrize("number", [signal.SIGTERM, signal.SIGHUP, signal.SIGINT])
def test_a_signal_interrupts_and_is_told(number: signal.Signals) -> None:
    before = signal.getsignal(number)
    with ended_by_signals() as received, pytest.raises(KeyboardInterrupt):
        signal.raise_signal(number)
    assert received == [number]
    assert signal.getsignal(number) == before


OLDER = "import sys; sys.version_info = (3, 10, 13); exec(sys.argv.pop(1))"


def test_an_older_python_is_told_which_one_is_needed(tmp_path: Path) -> None:
    older = tmp_path / "python3.10"
    older.write_text(f'#!/bin/sh\n[ "$1" = -c ] && shift\nexec "{sys.executable}" -c \'{OLDER}\' "$@"\n')
    older.chmod(0o755)
    run = "import runpy; runpy.run_module('attlog', run_name='__main__')"
    done = subprocess.run([older, run], cwd=ROOT, capture_output=True, text=True)
    assert (done.returncode, done.stderr) == (2, "attlog needs Python 3.11 or newer, this is 3.10\n")
    if shutil.which("make") is None:
        pytest.skip("no make")
    made = subprocess.run(
        ["make", "demo", f"PYTHON={older}", f"VENV={tmp_path / 'venv'}"], cwd=ROOT, capture_output=True, text=True
    )
    first = "attlog needs Python 3.11 or newer, this is 3.10: make demo PYTHON=python3.12"
    assert (made.returncode, made.stderr.splitlines()[0]) == (2, first)


def test_what_runs_before_the_check_is_read_by_an_older_python() -> None:
    """``pip install .`` imports the hook, ``-m attlog`` the others, before anything says which Python is needed."""
    for name in ("attlog/__init__.py", "attlog/__main__.py", "hatch_build.py"):
        tree = ast.parse((ROOT / name).read_text(encoding="utf-8"), feature_version=(3, 8))
        at_once = [one for node in tree.body if isinstance(node, ast.Import) for one in node.names]
        assert "tomllib" not in {one.name for one in at_once}, name


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


LOG = SAMPLES / "copter_yaw_turns.bin"
FORKS = pytest.mark.skipif(sys.platform == "win32", reason="nothing is forked there")
HEAD = """
import signal, sys, time
from attlog.core import limits
from attlog.cli import process
limits.READ_BYTES = 1
process.INTERRUPTED_S = 1
"""


def started(body: str, log: Path) -> subprocess.Popen[str]:
    """A process that runs ``body`` under the guard of a log."""
    log.write_bytes(bytes(10))
    code = f"{HEAD}{body}\nsys.exit(process.run_guarded(run, [{str(log)!r}]))"
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


# Cuts a log, and reads behind its new end, in the second of all flights.
CUT = """
import os, sys
from attlog.core import limits
limits.READ_BYTES, limits.READ_OF_SEVERAL_BYTES = 1000, int(sys.argv.pop(1))
import attlog.flight
inside, flights = attlog.flight.flight_in, []
def cut(messages, *a, **k):
    flights.append(messages)
    if len(flights) == 2:
        os.truncate(sys.argv[3], 5000)
    return inside(messages, *a, **k)
attlog.flight.flight_in = cut
from attlog.cli import main
main()
"""


@FORKS
@pytest.mark.parametrize("largest", [1 << 30, 1000], ids=["read", "mapped"])
def test_of_several_logs_the_one_that_was_cut_is_named_or_harmless(tmp_path: Path, largest: int) -> None:
    """Several logs are read into memory up to a larger size, so that one of them does not end the command."""
    logs = [Path(shutil.copy(LOG, tmp_path / name)) for name in ("a.bin", "b.bin")]
    done = run("-c", CUT, largest, "info", *logs)
    if largest > 1000:
        assert (done.returncode, done.stdout.count("a.bin") > 0, done.stdout.count("b.bin") > 0) == (0, True, True)
    else:
        said = f"attlog: {logs[1]}: became shorter while it was read; try again when it is whole\n"
        assert (done.returncode, done.stderr) == (66, said)


@FORKS
def test_a_bus_error_while_no_log_became_shorter_is_called_that(tmp_path: Path) -> None:
    """Such as an error of a card or network drive."""
    process = started("import os\ndef run(): os.kill(os.getpid(), signal.SIGBUS)", tmp_path / "x.ulg")
    _, err = process.communicate(timeout=30)
    assert (process.returncode, err.count("\n"), "bus error" in err, "shorter" in err) == (66, 1, True, False), err


COMMANDS = {
    "help": ["--help"],
    "schema": ["schema"],
    "one estimator": ["estimators", "vqf"],
    "info": ["info", LOG],
    "extract": ["extract", LOG, "ATT", "-o", "-"],
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


def test_a_reader_that_goes_away_hears_nothing(tmp_path: Path) -> None:
    ours, theirs = os.pipe()
    os.close(ours)
    done = start(["schema"], tmp_path, stdout=theirs)
    os.close(theirs)
    assert (done.returncode, done.stderr) == (73, b"")


@pytest.mark.parametrize("encoding", ["ascii", "cp1252"])
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
    assert "\\u" not in text.replace("\\udc", "")
    assert [line for line in text.splitlines() if line != line.rstrip()] == []


@pytest.mark.skipif(sys.platform == "darwin", reason="its file systems keep UTF-8 names only")
@pytest.mark.parametrize("arguments", few([["info"], ["extract", "ATT", "-o", "OUT"]], 1))
def test_a_file_name_that_is_not_utf8_works(tmp_path: Path, arguments: list[str]) -> None:
    log = os.path.join(os.fsencode(tmp_path), b"a\xff.bin")
    os.symlink(os.fsencode(LOG), log)
    done = start([arguments[0], log, *arguments[1:]], tmp_path, stdout=subprocess.PIPE)
    assert done.returncode == 0, done.stderr[-500:]
    if arguments == ["info"]:
        assert done.stdout.startswith(b"a\\xff.bin")


# How a command begins and ends: what it costs beside its work.


# Same log, version and machine: the same JSON and page to the bit, wherever and however attlog runs.

LOGS = ("copter_yaw_turns.bin", "cut.ulg")
HERE = {"PYTHONHASHSEED": "1", "TZ": "UTC", "LC_ALL": "C", "OPENBLAS_NUM_THREADS": "1", "COLUMNS": "200"}
THERE = {
    "PYTHONHASHSEED": "77",
    "TZ": "Asia/Kathmandu",
    "LC_ALL": "de_DE.UTF-8",
    "LANG": "tr_TR.UTF-8",
    "OPENBLAS_NUM_THREADS": "2",
    "COLUMNS": "40",
    "HOME": "/nowhere",
}


@pytest.mark.slow
def test_order_of_hashes_zone_locale_folder_and_jobs_change_no_bit(tmp_path: Path) -> None:
    written = []
    for folder, variables, jobs in ((tmp_path / "a", HERE, "1"), (tmp_path / "b" / "c d", THERE, "2")):
        folder.mkdir(parents=True)
        shutil.copy(SAMPLES / LOGS[0], folder)
        (folder / LOGS[1]).write_bytes((SAMPLES / "px4_steps.ulg").read_bytes()[:400_000])
        words = ["analyze", *LOGS, "-o", "out", "--estimators", "gyro,mahony", "--deterministic", "-q", "-j", jobs]
        paths = os.pathsep.join(filter(None, (str(ROOT), os.environ.get("PYTHONPATH"))))
        subprocess.run(
            [sys.executable, "-m", "attlog", *words],
            cwd=folder,
            env=os.environ | variables | {"PYTHONPATH": paths},
            check=True,
            capture_output=True,
        )
        written.append({p.name: p.read_bytes() for p in sorted((folder / "out").iterdir())})
    assert sorted(written[0]) == [f"{name}.{kind}" for name in sorted(LOGS) for kind in ("html", "json")]
    assert written[0] == written[1]


# What the terminal's encoding lacks, and file names that are not UTF-8, end no run.


@pytest.mark.slow
@pytest.mark.skipif(sys.platform == "darwin", reason="its file systems keep UTF-8 names only")
def test_analyze_works_where_signs_and_names_cannot_be_shown(samples, tmp_path):
    log = os.path.join(os.fsencode(tmp_path), b"a\xff.bin")
    shutil.copy(samples / "copter_steps_stabilize.bin", log)
    done = subprocess.run(
        [sys.executable, "-m", "attlog", "analyze", "--no-color", "--estimators", "gyro", "-o", str(tmp_path), log],
        capture_output=True,
        env={**os.environ, "PYTHONIOENCODING": "ascii"},
    )
    assert done.returncode == 0, done.stderr[-500:]
    assert b"a\\xff.bin" in done.stdout
    assert b" deg" in done.stdout
    assert b"\x1b" not in done.stdout
    assert [line for line in done.stdout.splitlines() if line != line.rstrip()] == []
    document = json.loads((tmp_path / "a_.bin.json").read_text(encoding="utf-8"))
    assert os.fsencode(document["log"]["name"]) == b"a\xff.bin"
    assert (tmp_path / "a_.bin.html").stat().st_size > 10_000


# Files beside a log that are named like modules of Python, or of packages that attlog uses, are never imported.

NAMED_LIKE_MODULES = ("numpy", "signal", "struct", "pickle", "json", "socket", "subprocess", "multiprocessing")
RAN = "from pathlib import Path\nPath(__file__).with_suffix('.ran').touch()\nraise SystemExit(5)\n"
FILTER = """
import numpy as np
from attlog.estimators import Estimate
def run(t, gyr, acc, mag, aids, params):
    return Estimate(t, np.tile([1.0, 0.0, 0.0, 0.0], (len(t), 1)))
"""
DROPPED = "import sys; del sys.path[0]; "
"""As the installed command begins: without the flag ``-P``, which child processes of ``multiprocessing`` inherit."""
COMMAND = "from attlog.__main__ import main; main()"


@pytest.mark.parametrize(
    "words",
    few(
        [
            pytest.param(["check-estimator", "mine.py"], id="filter of a file"),
            pytest.param(
                ["batch", "log.ulg", "-o", "out", "--estimators", "mine.py", "--reference", "onboard"], id="batch"
            ),
            pytest.param(
                ["compare", "log.ulg", "again.ulg", "gyro", "mahony", "-o", "out", "-j", "2"], id="several logs"
            ),
        ],
        1,
    ),
)
@pytest.mark.parametrize("start", [["-c", DROPPED + COMMAND], ["-m", "attlog"]], ids=["attlog", "-m attlog"])
def test_no_child_process_imports_a_file_of_the_current_folder(
    words: list[str], start: list[str], samples: Path, tmp_path: Path
) -> None:
    for name in NAMED_LIKE_MODULES:
        (tmp_path / f"{name}.py").write_text(RAN)
    (tmp_path / "mine.py").write_text(FILTER)
    for name in ("log.ulg", "again.ulg"):
        (tmp_path / name).symlink_to(samples / "px4_steps.ulg")
    done = subprocess.run(
        [sys.executable, *start, *words],
        cwd=tmp_path,
        env=os.environ | {"PYTHONPATH": str(ROOT)},
        capture_output=True,
        text=True,
        timeout=300,
    )
    assert [path.name for path in tmp_path.glob("*.ran")] == []
    assert "Traceback" not in done.stderr
    if words[0] != "check-estimator":  # whose verdict this filter, which ignores its sensors, does not get
        assert done.returncode == 0, done.stderr


# How Python is started, and from where: out of a zip file, without docstrings and assertions.


def run(*arguments: object, path: Path = ROOT) -> subprocess.CompletedProcess[str]:
    """Python with these arguments, which finds attlog in ``path``."""
    return subprocess.run(
        [sys.executable, "-P", *map(str, arguments)],
        env={**os.environ, "PYTHONPATH": str(path)},
        capture_output=True,
        text=True,
    )


def test_out_of_a_zip_file_it_says_what_to_do(tmp_path: Path) -> None:
    """Templates, scenarios and machine code are read as files; ``--help`` worked, ``analyze`` blamed the output."""
    with zipfile.ZipFile(tmp_path / "attlog.zip", "w") as archive:
        for path in (ROOT / "attlog" / "__init__.py", ROOT / "attlog" / "__main__.py"):
            archive.write(path, path.relative_to(ROOT).as_posix())
    done = run("-m", "attlog", "info", "x.ulg", path=tmp_path / "attlog.zip")
    assert (done.returncode, done.stdout) == (2, "")
    assert done.stderr == "attlog: does not run out of a zip file: install it (pip install), or unpack it\n"


@pytest.mark.slow
def test_without_docstrings_and_assertions_the_numbers_are_the_same(samples: Path, tmp_path: Path) -> None:
    """``python -OO``: what is said of a filter is its file's docstring and lost, no number and no check is."""

    def numbers(*options: str) -> Any:
        folder = tmp_path / "".join(options)
        log = samples / "copter_yaw_turns.bin"
        command = ["-m", "attlog", "analyze", log, "-q", "--deterministic", "--estimators", "gyro,mahony", "-o", folder]
        done = run(*options, *command)
        assert done.returncode == 0, done.stderr
        document = json.loads((folder / "copter_yaw_turns.bin.json").read_text(encoding="utf-8"))
        rows = [(row["name"], row["metrics"], row.get("parameters")) for row in document["estimators"]]
        return rows, document["checks"]

    assert numbers("-OO") == numbers("-B")
    assert run("-OO", "-m", "attlog", "analyze", "--imu", "99", samples / "copter_yaw_turns.bin").returncode == 2


@pytest.mark.skipif(not sys.platform.startswith("linux"), reason="the option is glibc's")
def test_a_freed_block_of_a_long_log_is_used_again() -> None:
    lines = [
        "import resource, numpy as np",
        "from attlog.cli.process import reuse_freed_memory",
        "faults = lambda: resource.getrusage(resource.RUSAGE_SELF).ru_minflt",
        "reuse_freed_memory()",
        "block = np.ones(8 << 20)",
        "del block",
        "before = faults()",
        "block = np.ones(8 << 20)",
        "print(faults() - before)",
    ]
    small_pages = os.environ | {"NUMPY_MADVISE_HUGEPAGE": "0"}
    done = subprocess.run([sys.executable, "-c", "\n".join(lines)], capture_output=True, env=small_pages, check=True)
    assert int(done.stdout) < 1000  # of 16,384 pages


# The end of the process: at once, but as Python ends.

WRITTEN = "import atexit, sys; from attlog.cli.process import end; atexit.register(print, 'last'); print('first'); "


@pytest.mark.parametrize("stop", ["None", "0", "66", "'a text'"])
def test_the_process_ends_at_once_as_python_would(stop: str) -> None:
    """Output is flushed and what is registered for the end has run; a text is an error."""
    here, pythons = (run("-c", WRITTEN + f"{way}({stop}); print('not reached')") for way in ("end", "sys.exit"))
    assert here.stdout == "first\nlast\n"
    assert (here.returncode, here.stdout, here.stderr) == (pythons.returncode, pythons.stdout, pythons.stderr)


def test_the_process_waits_for_its_other_threads() -> None:
    late = "import threading, time; threading.Thread(target=lambda: (time.sleep(0.3), print('late'))).start(); "
    assert run("-c", WRITTEN + late + "end(3)").stdout.splitlines() == ["first", "late", "last"]


def test_a_profiler_that_runs_the_command_writes_its_result(tmp_path: Path) -> None:
    """And who calls :func:`attlog.__main__.main` goes on afterwards."""
    done = run("-m", "cProfile", "-o", tmp_path / "profile", "-m", "attlog", "--version")
    assert (done.returncode, (tmp_path / "profile").exists()) == (0, True), done.stderr
    script = tmp_path / "attlog"
    script.write_text("from attlog.__main__ import command; command()")
    done = run("-m", "cProfile", "-o", tmp_path / "another", script, "--version")
    assert (done.returncode, (tmp_path / "another").exists()) == (0, True), done.stderr
    done = run("-c", "from attlog.__main__ import main\ntry: main()\nfinally: print('after')", "--version")
    assert (done.returncode, done.stdout.splitlines()[-1]) == (0, "after")


def test_the_command_ends_before_modules_are_taken_apart(tmp_path: Path) -> None:
    script = tmp_path / "attlog"
    script.write_text(
        "import sys\nclass Last:\n    def __del__(self): print('taken apart')\nsys.kept = Last()\n"
        "from attlog.__main__ import command\ncommand()\n"
    )
    done = run(script, "--version")
    assert (done.returncode, "attlog" in done.stdout, "taken apart" in done.stdout) == (0, True, False)
