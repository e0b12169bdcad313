"""What can go wrong, as one small family of exceptions.

Every error that attlog expects derives from :class:`AttlogError` and carries the
process exit code that the command line ends with (sysexits numbering, see
``docs/cli.md``). Messages are one or two sentences: what, where, what to do.
"""

from __future__ import annotations

import errno
import os
from collections.abc import Callable, Iterable
from typing import TypeVar


class AttlogError(Exception):
    """Root of all errors that attlog raises on purpose.

    ``str(error)`` is a sentence for people, ``exit_code`` what a command ends with; both stand in docs/cli.md.
    """

    exit_code = 70


class UsageError(AttlogError):
    """The call, an option or a configuration file is wrong."""

    exit_code = 2


class LogUnusable(AttlogError):
    """The file is readable but holds nothing that can be analysed."""

    exit_code = 65


class NotALog(LogUnusable):
    """The content is none of the supported log formats."""


class LogUnreadable(AttlogError):
    """The file does not exist or cannot be opened."""

    exit_code = 66


class OutputError(AttlogError):
    """A result cannot be written."""

    exit_code = 73


class PluginError(AttlogError):
    """A user's estimator file cannot be loaded or breaks the estimator contract."""

    exit_code = 2


class PluginTimeout(PluginError):
    """A user's estimator took longer than allowed."""

    exit_code = 75


class ClusterError(AttlogError):
    """A cluster does not answer, or not any more; later it may."""

    exit_code = 75


class TooLittleMemory(AttlogError):
    """A log needs more memory than there is; elsewhere, or later, it may be there."""

    exit_code = 75


MAX_LINES, MAX_LINE_LETTERS = 20, 1000
"""Of a message, and of a line of it."""
EXIT_INTERRUPTED = 130
EXIT_BUG = 70
OUT_OF_MEMORY_TEXT = (
    "memory ran out before the log was done, and nothing was written; close other programs, choose one power-up of "
    "several (--boot), or take a machine with more memory"
)
LOADER_MEMORY_WORDS = ("failed to map segment", "annot allocate memory")
OUT_OF_PROCESSES_TEXT = (
    "the system allows this user no more processes or threads; close other programs, or allow more (ulimit -u)"
)
EXIT_ORDER = (EXIT_INTERRUPTED, EXIT_BUG, 73, 2, 66, 65, 75, 1, 0)
"""With several logs, the first of these that occurred is the exit code."""


def exit_code(error: BaseException) -> int:
    """The process exit code for an error: its own, that of too little memory, or that of a bug."""
    if isinstance(error, KeyboardInterrupt):
        return EXIT_INTERRUPTED
    if isinstance(error, AttlogError):
        return error.exit_code
    return TooLittleMemory.exit_code if is_out_of_memory(error) or is_out_of_processes(error) else EXIT_BUG


def is_out_of_memory(error: BaseException) -> bool:
    """Whether an error, or one it came from, says that memory ran out.

    A library that could not be loaded for want of it (``ulimit -v``) is an OSError or ImportError of which only the
    loader's words are left.
    """
    at: BaseException | None = error
    while at is not None:
        if isinstance(at, MemoryError) or (isinstance(at, OSError) and at.errno == errno.ENOMEM):
            return True
        if isinstance(at, (OSError, ImportError)) and any(words in str(at) for words in LOADER_MEMORY_WORDS):
            return True
        at = at.__cause__ or at.__context__
    return False


def is_out_of_processes(error: BaseException) -> bool:
    """Whether an error says that no thread or no process could be started."""
    if isinstance(error, RuntimeError):
        return str(error) == "can't start new thread"
    return isinstance(error, OSError) and error.errno == errno.EAGAIN


def worst_exit_code(codes: Iterable[int]) -> int:
    """The exit code of several logs; 0 without any."""
    return min(codes, key=EXIT_ORDER.index, default=0)


def shortened_message(text: str) -> str:
    """A message that a person can read: settings may be wrong in thousands of lines, or in one of megabytes."""
    lines = [
        line if len(line) <= MAX_LINE_LETTERS else f"{line[:MAX_LINE_LETTERS]}..."
        for line in text.split("\n", MAX_LINES)
    ]
    if len(lines) > MAX_LINES:
        lines[MAX_LINES:] = [f"and {text.count(chr(10)) + 1 - MAX_LINES} more lines like these"]
    return "\n".join(lines)


def error_message(error: BaseException, version: str, log: str = "") -> str:
    """What a user reads about an error: its own sentences, or the line to report for a bug; ``log``: one of several."""
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


def suggestion(name: str, known: Iterable[object]) -> str:
    """The end of an error sentence: the nearest known names, or all of them."""
    import difflib

    names = [str(k) for k in known]
    near = difflib.get_close_matches(name, names, n=1, cutoff=0.6)
    if near:
        return f"; did you mean {near[0]}?"
    return f"; known are {', '.join(names)}" if names else "; there are none"


# The last barrier: what fails unexpectedly while one part is made costs that part and not the whole log.
#
# Readers and checks refuse what is wrong where it enters. A log that is hostile in a way
# nobody thought of still meets a line that did not expect it: then one sensor, one check or
# one metric is missing, a problem says so and asks for a report, and the rest goes on. Tests
# set ``ATTLOG_RAISE``, so that the barrier hides nothing from them.

T = TypeVar("T")
U = TypeVar("U")
RAISE_VARIABLE = "ATTLOG_RAISE"
"""The environment variable with which failures go through the barrier."""


def guarded(what: str, make: Callable[[], T], otherwise: Callable[[str], U]) -> T | U:
    """What ``make`` returns; where it fails in a way that nobody expected, what ``otherwise`` returns for the sentence.

    ``what`` begins the sentence ("The barometer"). Errors that attlog raises on purpose, too little
    memory and an interrupt pass.
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
    """What is missing, and where attlog failed, so that it can be reported and found."""
    place, trace = "", error.__traceback__
    while trace is not None:
        name = trace.tb_frame.f_globals.get("__name__", "")
        if name.partition(".")[0] == "attlog":
            place = f" in {name}, line {trace.tb_lineno}"
        trace = trace.tb_next
    reason = " ".join(str(error).split())[:200]
    return f"{what} is left out because of a bug in attlog ({type(error).__name__}{place}: {reason}); please report it."
