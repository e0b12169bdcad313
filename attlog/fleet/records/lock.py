"""One batch at a time in a folder: a lock that the system gives back when its process ends, however it ends."""

from __future__ import annotations

import os
import socket
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import IO

from attlog.base.errors import OutputError
from attlog.fleet.records.record import INSIDE

BEYOND = 1 << 30
"""Windows lets nobody read a byte that is locked: one that the file does not have."""


@contextmanager
def locked(folder: Path) -> Iterator[str]:
    """A block in which no other batch writes to the folder.

    OutputError if one does (it is named), or if the folder cannot be made or written. The file stays behind: a lock
    on a file that is removed and made anew would be no lock. The block is given a warning where the file system
    cannot lock, else an empty text.
    """
    place = folder / INSIDE / "lock"
    try:
        place.parent.mkdir(parents=True, exist_ok=True)
        file = place.open("a+")
    except OSError as error:
        raise OutputError(f"{folder}: cannot be written ({error.strerror}); choose another place with -o") from error
    with file:
        without = ""
        try:
            _lock(file)
        except BlockingIOError:
            file.seek(0)
            raise OutputError(
                f"{folder}: another batch is writing there ({file.read(200).strip() or 'just started'}); "
                "wait for it, or choose another folder with -o"
            ) from None
        except OSError as error:
            without = f"{folder}: no locks on this file system ({error.strerror}); let no other batch write there"
        try:
            file.truncate(0)
            file.write(f"process {os.getpid()} on {socket.gethostname()}\n")
            file.flush()
        except OSError as error:
            raise OutputError(
                f"{folder}: cannot be written ({error.strerror}); choose another place with -o"
            ) from error
        yield without


def _lock(file: IO[str]) -> None:
    """Lock the file until it is closed. BlockingIOError if somebody else has; OSError where files cannot be locked."""
    if sys.platform == "win32":
        import msvcrt

        file.seek(BEYOND)
        try:
            msvcrt.locking(file.fileno(), msvcrt.LK_NBLCK, 1)
        except PermissionError as error:
            raise BlockingIOError(error.errno, error.strerror) from None
        file.seek(0)
    else:
        import fcntl

        fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
