"""Start and end of the process: signals, memory-mapped logs that are cut, standard streams that fail."""

from __future__ import annotations

import atexit
import codecs
import errno
import io
import os
import signal
import sys
import threading
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager, suppress
from typing import Any, NoReturn

from attlog import __version__
from attlog.core import limits
from attlog.core.errors import AttlogError, LogUnreadable, OutputError, error_message, exit_code


@contextmanager
def ended_by_signals() -> Iterator[list[int]]:
    """Raise KeyboardInterrupt on SIGTERM, SIGHUP (a closed terminal) and SIGINT; yield the signals received.

    An ignored signal (SIGHUP under nohup) stays ignored.
    """
    received: list[int] = []

    def stop(number: int, _: Any) -> None:
        received.append(number)
        raise KeyboardInterrupt

    known = [getattr(signal, name) for name in ("SIGTERM", "SIGHUP", "SIGINT") if hasattr(signal, name)]
    watched = [s for s in known if signal.getsignal(s) != signal.SIG_IGN]
    before = {number: signal.signal(number, stop) for number in watched}
    try:
        yield received
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)


# glibc's numbers for the free memory that it keeps, and for the count of blocks that it asks the kernel for one by one.
TRIM_THRESHOLD, MMAP_MAX = -1, -4
LARGEST = 2**31 - 1


def reuse_freed_memory() -> None:
    """Have glibc use freed blocks of any size again.

    It gives those above 32 MB back to the kernel, which clears each new one: 14 of 56 CPU s of ``info`` on 500 MB.
    What the C library keeps is returned after each stage (:func:`attlog.core.machine.release_memory`).
    """
    if not sys.platform.startswith("linux"):
        return
    import ctypes

    set_option = getattr(ctypes.CDLL(None), "mallopt", None)
    if set_option is not None:
        set_option(TRIM_THRESHOLD, LARGEST)
        set_option(MMAP_MAX, 0)


# Time after which a child is interrupted: a terminal interrupts both processes, ``kill -INT`` this one alone.
INTERRUPTED_S = 2


def run_guarded(run: Callable[[], int], words: Sequence[str]) -> int:
    """Return the exit code of ``run``, in a child process if one of the ``words`` is a file that is mapped."""
    sizes = {word: os.path.getsize(word) for word in words if os.path.isfile(word)}
    mapped_from = limits.READ_BYTES
    if max(sizes.values(), default=0) > mapped_from and sum(map(_is_log, sizes)) > 1:
        mapped_from = limits.READ_OF_SEVERAL_BYTES
    mapped = {word: size for word, size in sizes.items() if size > mapped_from}
    if not mapped or not hasattr(os, "fork"):
        return run()
    child = os.fork()
    if not child:
        os.environ[limits.MAPPED], limits.READ_BYTES = "1", mapped_from
        code = 70
        try:
            code = run()
        except BaseException as error:  # ``run`` reports errors itself, unless memory is too short even for that
            code = exit_code(error)
            os.write(2, f"{error_message(error, __version__)}\n".encode(errors="replace"))
        finally:
            os._exit(code)

    def hand_on(number: int, _: Any) -> None:
        os.kill(child, number)

    def hand_on_later(number: int, _: Any) -> None:
        signal.signal(signal.SIGALRM, lambda *_: os.kill(child, number))
        signal.alarm(INTERRUPTED_S)

    before = {number: signal.getsignal(number) for number in (signal.SIGTERM, signal.SIGHUP, signal.SIGINT)}
    before[signal.SIGALRM] = signal.getsignal(signal.SIGALRM)
    for number in (signal.SIGTERM, signal.SIGHUP, signal.SIGINT):
        if before[number] != signal.SIG_IGN:
            signal.signal(number, hand_on_later if number == signal.SIGINT else hand_on)
    code = os.waitstatus_to_exitcode(os.waitpid(child, 0)[1])
    signal.alarm(0)
    for number, handler in before.items():
        signal.signal(number, handler)
    if code == -signal.SIGBUS:
        print(f"attlog: {_lost_file(mapped)}", file=sys.stderr)
        return LogUnreadable.exit_code
    if code < 0:
        signal.signal(-code, signal.SIG_DFL)
        os.kill(os.getpid(), -code)
    return code


def _is_log(path: str) -> bool:
    from attlog import formats

    try:
        return bool(formats.recognise(path))
    except AttlogError:
        return False


def _lost_file(mapped: dict[str, int]) -> str:
    """Return what is known of the mapped files (sizes at the start) after one of them could not be read."""
    for path, size in mapped.items():
        if not os.path.exists(path) or os.path.getsize(path) < size:
            return f"{path}: became shorter while it was read; try again when it is whole"
    return f"{', '.join(mapped)}: could not be read to the end (bus error); copy to another disk and try again"


WRITE_ERRORS = frozenset((errno.ENOSPC, errno.EDQUOT, errno.EFBIG, errno.EIO, errno.EPIPE, errno.EBADF))


def show_everything() -> None:
    """Replace signs that the output's encoding lacks by ASCII, bytes that are not UTF-8 by escapes."""
    from attlog.words.text import on_encode_error

    codecs.register_error("attlog", on_encode_error)
    _reopen_closed()
    for stream in (sys.stdout, sys.stderr):
        if isinstance(stream, io.TextIOWrapper):
            stream.reconfigure(errors="attlog")


def _reopen_closed() -> None:
    """Reopen closed standard streams (``>&-``), whose numbers the next opened files would get.

    Printing to a closed output fails as on a full disk; errors to a closed error output are lost.
    """
    while (place := os.open(os.devnull, os.O_RDONLY)) <= 2:
        continue
    os.close(place)
    if sys.stdout is None:
        sys.stdout = open(1, "w", closefd=False)
    if sys.stderr is None:
        sys.stderr = open(os.devnull, "w")


def is_of_a_stream(error: BaseException) -> bool:
    """Return True for an error of a standard stream, which has no file name."""
    return isinstance(error, OSError) and error.filename is None and error.errno in WRITE_ERRORS


def flush_output(code: int) -> int:
    """Return the exit code after writing all output, or that of an OutputError."""
    try:
        sys.stdout.flush()
    except OSError as error:
        return report_lost_output(error)
    return code


def end(code: object) -> NoReturn:
    """End the process as ``sys.exit(code)``, but leave its memory to the system.

    Python would take modules and objects apart first, one by one: 10 ms of CPU, 30 ms until the prompt.
    """
    if threading.active_count() > 1:  # Python waits for them
        sys.exit(code)  # type: ignore[arg-type]
    if not isinstance(code, int | None):
        print(code, file=sys.stderr)
        code = 1
    atexit._run_exitfuncs()
    for stream in (sys.stdout, sys.stderr):
        with suppress(OSError, ValueError):
            stream.flush()
    os._exit(code or 0)


def report_lost_output(error: OSError) -> int:
    """Report a failed standard output, unless its reader went away, and close it."""
    try:
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
    except (OSError, ValueError):
        sys.stdout = open(os.devnull, "w")
    if error.errno != errno.EPIPE:
        print(f"attlog: standard output cannot be written ({error.strerror})", file=sys.stderr)
    return OutputError.exit_code
