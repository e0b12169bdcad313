"""What a person reads about an error stays readable, however much is wrong."""

from __future__ import annotations

import errno
import os
import sys
from pathlib import Path

import pytest

from attlog.core import errors
from attlog.core.errors import MAX_LINE_LETTERS, MAX_LINES, OUT_OF_MEMORY_TEXT, UsageError, error_message, exit_code


def test_thousands_of_lines_are_counted_and_a_line_of_megabytes_is_cut() -> None:
    lines = error_message(UsageError("\n".join(f"line {k}" for k in range(3000))), "1").split("\n")
    assert len(lines) == MAX_LINES + 1
    assert lines[-1] == f"and {3000 - MAX_LINES} more lines like these"
    assert len(error_message(UsageError("x" * 10**6), "1")) < MAX_LINE_LETTERS + 20


def llvm_could_not_be_loaded() -> OSError:
    """As llvmlite tells it: the loader's own error is the one it came from."""
    try:
        try:
            raise OSError("libllvmlite.so: failed to map segment from shared object")
        except OSError:
            raise OSError("Could not find/load shared object file 'libllvmlite.so'")  # noqa: B904
    except OSError as error:
        return error


@pytest.mark.parametrize(
    "error",
    [
        MemoryError(),
        OSError(errno.ENOMEM, "Cannot allocate memory"),
        ImportError("numpy/core.so: cannot allocate memory in static TLS block"),
        llvm_could_not_be_loaded(),
    ],
    ids=["memory", "map", "import", "library"],
)
def test_memory_that_ran_out_is_no_bug_whoever_says_so(error: Exception) -> None:
    assert exit_code(error) == 75
    assert error_message(error, "1.0", "a.ulg") == f"attlog: a.ulg: {OUT_OF_MEMORY_TEXT}"


@pytest.mark.skipif(not sys.platform.startswith("linux"), reason="elsewhere a limit of address space is not heeded")
def test_a_log_that_does_not_fit_under_a_limit_of_memory_ends_with_75(tmp_path: Path) -> None:
    """A file of 4 GB that takes no room: it is larger than what may be mapped, whatever Python itself needs."""
    import subprocess

    log = tmp_path / "x.ulg"
    with log.open("wb") as file:
        file.write(b"ULog\x01\x12\x35\x01" + bytes(8))
        file.truncate(4 << 30)
    command = f"ulimit -v 2000000; exec '{sys.executable}' -m attlog info '{log}'"
    done = subprocess.run(["bash", "-c", command], capture_output=True, text=True)
    assert (done.returncode, done.stdout) == (75, "")
    assert "memory" in done.stderr
    assert "Traceback" not in done.stderr


@pytest.mark.parametrize(
    "error", [RuntimeError("can't start new thread"), BlockingIOError(errno.EAGAIN, os.strerror(errno.EAGAIN))]
)
def test_a_system_that_allows_no_more_processes_is_no_bug(error: Exception) -> None:
    assert errors.exit_code(error) == 75
    said = errors.error_message(error, "1.0", "a.ulg")
    assert said.startswith("attlog: a.ulg: the system allows this user no more processes")
    assert errors.exit_code(RuntimeError("another")) == errors.exit_code(OSError(errno.EIO, "")) == errors.EXIT_BUG
