"""Exceptions of attlog with exit codes, and a guard that turns a bug into one missing part of the result.

Every expected error derives from :class:`AttlogError` and carries the exit code of the command line (sysexits
numbering, ``docs/cli.md``). Messages are one or two sentences: what, where, what to do.
"""

from __future__ import annotations

import errno
import itertools
import os
from collections.abc import Callable, Iterable
from typing import TypeVar

T = TypeVar("T")
U = TypeVar("U")

EXIT_INTERRUPTED = 130
EXIT_BUG = 70
# With several logs the exit code is the first of these that occurred.
EXIT_ORDER = (EXIT_INTERRUPTED, EXIT_BUG, 73, 2, 66, 65, 75, 1, 0)
# Most lines of a message, and most letters of a line.
MAX_LINES, MAX_LINE_LETTERS = 20, 1000
OUT_OF_MEMORY_TEXT = (
    "memory ran out before the log was done, and nothing was written; close other programs, choose one power-up of "
    "several (--boot), or take a machine with more memory"
)
# The loader's words where a library found no memory (``ulimit -v``): an OSError or ImportError without errno.
LOADER_MEMORY_WORDS = ("failed to map segment", "annot allocate memory")
OUT_OF_PROCESSES_TEXT = (
    "the system allows this user no more processes or threads; close other programs, or allow more (ulimit -u)"
)
# Environment variable with which :func:`call_guarded` raises failures; set by tests.
RAISE_VARIABLE = "ATTLOG_RAISE"


class AttlogError(Exception):
    """Root of all expected errors.

    ``str(error)`` is a sentence for the user, ``exit_code`` that of the command.
    """

    exit_code = 70


class UsageError(AttlogError):
    """Wrong call, option or configuration file.

    The message says what is wrong, and where a name is unknown it lists the known ones or the nearest.
    """

    exit_code = 2


class LogUnusable(AttlogError):
    """Readable file without data to analyse."""

    exit_code = 65


class NotALog(LogUnusable):
    """File in none of the supported log formats."""


class LogUnreadable(AttlogError):
    """A missing file or one that cannot be opened."""

    exit_code = 66


class OutputError(AttlogError):
    """A result that cannot be written."""

    exit_code = 73


class PluginError(AttlogError):
    """A user's estimator file that cannot be loaded or breaks the estimator contract."""

    exit_code = 2


class PluginTimeout(PluginError):
    """A user's estimator that took longer than allowed."""

    exit_code = 75


class ClusterError(AttlogError):
    """Cluster that does not respond; a later attempt may succeed."""

    exit_code = 75


class TooLittleMemory(AttlogError):
    """A log that needs more memory than is free now."""

    exit_code = 75


def exit_code(error: BaseException) -> int:
    """Return the exit code of the process for an error."""
    if isinstance(error, KeyboardInterrupt):
        return EXIT_INTERRUPTED
    if isinstance(error, AttlogError):
        return error.exit_code
    return TooLittleMemory.exit_code if is_out_of_memory(error) or is_out_of_processes(error) else EXIT_BUG


def worst_exit_code(codes: Iterable[int]) -> int:
    """Return the most important of several logs' exit codes, 0 without failures."""
    return min(codes, key=EXIT_ORDER.index, default=0)


def is_out_of_memory(error: BaseException) -> bool:
    """Return whether an error or its cause is a lack of memory."""
    at: BaseException | None = error
    while at is not None:
        if isinstance(at, MemoryError) or (isinstance(at, OSError) and at.errno == errno.ENOMEM):
            return True
        if isinstance(at, (OSError, ImportError)) and any(words in str(at) for words in LOADER_MEMORY_WORDS):
            return True
        at = at.__cause__ or at.__context__
    return False


def is_out_of_processes(error: BaseException) -> bool:
    """Return whether no thread or process could be started."""
    if isinstance(error, RuntimeError):
        return str(error) == "can't start new thread"
    return isinstance(error, OSError) and error.errno == errno.EAGAIN


def error_message(error: BaseException, version: str, log: str = "") -> str:
    """Return an error's text for the user; ``log`` is the path of one of several logs."""
    where = f"{log}: " if log and log not in str(error) else ""
    if isinstance(error, AttlogError):
        return f"attlog: {where}{shortened_message(str(error))}"
    if is_out_of_memory(error):
        return f"attlog: {where}{OUT_OF_MEMORY_TEXT}"
    if is_out_of_processes(error):
        return f"attlog: {where}{OUT_OF_PROCESSES_TEXT}"
    return (
        f"attlog: {where}a bug in attlog {version}: {type(error).__name__}: {error}\n"
        "Please report this line with the output of the same command and -vv."
    )


def shortened_message(text: str) -> str:
    """Shorten a message to a limited number of lines and letters."""
    lines = [
        line if len(line) <= MAX_LINE_LETTERS else f"{line[:MAX_LINE_LETTERS]}..."
        for line in text.split("\n", MAX_LINES)
    ]
    if len(lines) > MAX_LINES:
        lines[MAX_LINES:] = [f"and {text.count(chr(10)) + 1 - MAX_LINES} more lines like these"]
    return "\n".join(lines)


def suggestion(name: str, known: Iterable[object]) -> str:
    """Return the nearest known name as the end of an error sentence."""
    import difflib

    names = [str(k) for k in known]
    near = difflib.get_close_matches(name, names, n=1, cutoff=0.6)
    if near:
        return f"; did you mean {near[0]}?"
    return f"; known are {', '.join(names)}" if names else "; there are none"


# Most names of a folder that are compared with a mistyped one.
MAX_COMPARED_NAMES = 5000


def missing_file(path: str) -> str:
    """Return the error sentence of a file that does not exist, with the nearest name of its folder."""
    import difflib

    folder, name = os.path.split(path)
    try:
        with os.scandir(folder or ".") as entries:
            found = [entry.name for entry in itertools.islice(entries, MAX_COMPARED_NAMES)]
    except OSError:
        found = []
    by_case = {one.lower(): one for one in found if not one.startswith(".")}
    near = difflib.get_close_matches(name.lower(), by_case, n=1, cutoff=0.7)
    return f"no such file; did you mean {os.path.join(folder, by_case[near[0]])}?" if near else "no such file"


def call_guarded(what: str, make: Callable[[], T], otherwise: Callable[[str], U]) -> T | U:
    """Return ``make()``, or ``otherwise(sentence)`` after an unexpected failure.

    An unexpected failure, for example by a damaged log, then costs one sensor, check or metric, and the sentence asks
    the user for a bug report. ``what`` begins the sentence ("The barometer"). Expected errors, MemoryError and
    interrupts are raised.
    """
    try:
        return make()
    except (AttlogError, MemoryError):
        raise
    except Exception as error:
        if os.environ.get(RAISE_VARIABLE):
            raise
        return otherwise(bug_sentence(what, error))


def bug_sentence(what: str, error: Exception) -> str:
    """Return a sentence with the missing part and the failed line, without the words of a library."""
    place, trace = "", error.__traceback__
    while trace is not None:
        name = trace.tb_frame.f_globals.get("__name__", "")
        if name.partition(".")[0] == "attlog":
            place = f" in {name}, line {trace.tb_lineno}"
        trace = trace.tb_next
    return f"{what} is left out because of a bug in attlog ({type(error).__name__}{place}); please report it."
