"""One batch at a time in a folder: a lock that the system gives back when its process ends, however it ends."""

from __future__ import annotations

import os
import socket
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from attlog.errors import OutputError
from attlog.fleet.record import INSIDE


@contextmanager
def locked(folder: Path) -> Iterator[str]:
    """A block in which no other batch writes to the folder.

    OutputError if one does (it is named), or if the folder cannot be made or written. The file stays behind: a lock
    on a file that is removed and made anew would be no lock. The block is given a warning where the file system
    cannot lock, else an empty text.
    """
    import fcntl

    place = folder / INSIDE / "lock"
    try:
        place.parent.mkdir(parents=True, exist_ok=True)
        file = place.open("a+")
    except OSError as error:
        raise OutputError(f"{folder}: cannot be written ({error.strerror}); choose another place with -o") from error
    with file:
        without = ""
        try:
            fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
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
