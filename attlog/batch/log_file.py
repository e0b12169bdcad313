"""A log's file: copied and hashed on the way, and still the same after it was read.

Copies in progress grow, cards are pulled out, files are cut.
"""

from __future__ import annotations

import hashlib
import stat
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from pathlib import Path, PurePath

from attlog import formats
from attlog.core.errors import LogUnreadable, NotALog

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


# Was a file that lies somewhere meant as a log, or as an archive of logs?

LOG_SUFFIXES = frozenset((".ulg", ".ulge", ".tlog", ".mcap", ".db3"))
"""A file of these names was meant as a log even where its content is none; other names serve other things too."""

MAGICS = (b"PK\x03\x04", b"PK\x05\x06")
"""Zip archives begin so."""

SUFFIXES_OF_LOGS = LOG_SUFFIXES | {".bin", ".log", ".mavlink"}
"""Names that logs have; what stands behind a URL is told by its name alone, because asking each would take hours."""


def is_meant(path: Path) -> bool:
    """Whether a file found in a folder is a log, by its content; one that is damaged or cannot be read, by its name."""
    try:
        formats.recognise(path)
    except NotALog:
        return named_as_log(path.name)
    except LogUnreadable:
        return may_be_log(path.name)  # nobody knows what is in it: rather told than left out
    return True


def is_archive(path: Path) -> bool:
    """Whether a file begins as zip archives do; False where it cannot be read, or is a pipe that may never say."""
    try:
        if not stat.S_ISREG(path.stat().st_mode):
            return False
        with path.open("rb") as file:
            return file.read(4) in MAGICS
    except OSError:
        return False


def named_as_log(name: str) -> bool:
    """Whether a file of this name can only have been meant as a log."""
    return _suffix(name) in LOG_SUFFIXES


def may_be_log(name: str) -> bool:
    """Whether logs have such names."""
    return _suffix(name) in SUFFIXES_OF_LOGS


def _suffix(name: str) -> str:
    return PurePath(name.lower().removesuffix(".gz")).suffix
