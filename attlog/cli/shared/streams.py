"""Standard output and error: signs that they lack, a disk that is full, a reader that went away."""

from __future__ import annotations

import codecs
import errno
import io
import os
import sys

from attlog.base.errors import OutputError

FULL = frozenset((errno.ENOSPC, errno.EDQUOT, errno.EFBIG, errno.EIO, errno.EPIPE, errno.EBADF))


def show_everything() -> None:
    """Signs that the output's encoding lacks get ASCII stand-ins, file names that are not UTF-8 escapes."""
    from attlog.present.stand_ins import on_encode_error

    codecs.register_error("attlog", on_encode_error)
    _reopen_closed()
    for stream in (sys.stdout, sys.stderr):
        if isinstance(stream, io.TextIOWrapper):
            stream.reconfigure(errors="attlog")


def _reopen_closed() -> None:
    """Standard streams that were closed (``>&-``) get places of their own, or the first file opened would take theirs.

    What is printed to a closed output fails like on a full disk; what a closed error output would say is lost.
    """
    while (place := os.open(os.devnull, os.O_RDONLY)) <= 2:
        continue
    os.close(place)
    if sys.stdout is None:
        sys.stdout = open(1, "w", closefd=False)
    if sys.stderr is None:
        sys.stderr = open(os.devnull, "w")


def is_of_a_stream(error: BaseException) -> bool:
    """Whether an error says that standard output cannot take more: files name themselves, a stream does not."""
    return isinstance(error, OSError) and error.filename is None and error.errno in FULL


def flushed(code: int) -> int:
    """The exit code once all output is written; that of an OutputError if it cannot be."""
    try:
        sys.stdout.flush()
    except OSError as error:
        return lost(error)
    return code


def lost(error: OSError) -> int:
    """Say that standard output failed (not where its reader just went away) and stop Python from trying again."""
    try:
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
    except (OSError, ValueError):
        sys.stdout = open(os.devnull, "w")
    if error.errno != errno.EPIPE:
        print(f"attlog: standard output cannot be written ({error.strerror})", file=sys.stderr)
    return OutputError.exit_code
