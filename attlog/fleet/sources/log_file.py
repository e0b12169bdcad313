"""A log's file: copied and hashed on the way, and still the same after it was read.

Copies in progress grow, cards are pulled out, files are cut.
"""

from __future__ import annotations

import hashlib
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from pathlib import Path

from attlog.base.errors import LogUnreadable

BLOCK = 1 << 20
"""Bytes copied at a time."""


def copy(blocks: Iterable[bytes], path: Path) -> tuple[str, int]:
    """All blocks to a file: SHA-256 (hex) and size. LogUnreadable if the disk does not hold them."""
    sha256, size = hashlib.sha256(), 0
    try:
        file = path.open("wb")
    except OSError as error:
        raise _no_room(error) from error
    with file:
        for block in blocks:
            try:
                file.write(block)
            except OSError as error:
                raise _no_room(error) from error
            sha256.update(block)
            size += len(block)
        try:
            file.flush()
        except OSError as error:
            raise _no_room(error) from error
    return sha256.hexdigest(), size


def hashed(path: Path) -> str:
    """SHA-256 (hex) of a file, read once. LogUnreadable if it cannot be."""
    try:
        if path.exists() and not (path.is_file() or path.is_dir()):
            raise LogUnreadable(f"{path}: is no regular file; logs are memory-mapped, so save it to a file first")
        with path.open("rb") as file:
            return hashlib.file_digest(file, "sha256").hexdigest()
    except OSError as error:
        raise unreadable(str(path), error) from error


def unreadable(name: str, error: OSError) -> LogUnreadable:
    """The error of a file that cannot be opened or read."""
    if isinstance(error, FileNotFoundError):
        return LogUnreadable(f"{name}: no such file")
    return LogUnreadable(f"{name}: cannot be read ({error.strerror or error})")


def _no_room(error: OSError) -> LogUnreadable:
    import tempfile

    return LogUnreadable(f"{tempfile.gettempdir()}: the temporary folder cannot hold the log ({error.strerror})")


CHANGED = "changed while it was read (it is still being written or copied); try again when it is whole"


@contextmanager
def unchanged(path: Path) -> Iterator[None]:
    """A block that reads the file. LogUnreadable if the file is another one afterwards, whatever the block raised."""
    before = state(path)
    failure: Exception | None = None
    try:
        yield
    except Exception as error:
        failure = error
    if before is not None and state(path) != before:
        raise LogUnreadable(f"{path}: {CHANGED}") from failure
    if failure is not None:
        raise failure


def state(path: Path) -> tuple[int, int] | None:
    """Size and time of the last change; None where there is no such file."""
    try:
        told = path.stat()
    except OSError:
        return None
    return told.st_size, told.st_mtime_ns
