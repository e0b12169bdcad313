"""Log files: hashed copies, change detection while reading, recognition by name."""

from __future__ import annotations

import hashlib
import stat
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from pathlib import Path, PurePath

from attlog import formats
from attlog.core.errors import LogUnreadable, NotALog, missing_file

# Bytes copied at a time.
BLOCK = 1 << 20


def copy(blocks: Iterable[bytes], path: Path) -> tuple[str, int]:
    """Write blocks to a file; return SHA-256 (hex) and size.

    LogUnreadable if the disk is full.
    """
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


def hash_file(path: Path) -> str:
    """Return the SHA-256 (hex) of a file. LogUnreadable if it cannot be read."""
    try:
        if path.exists() and not (path.is_file() or path.is_dir()):
            raise LogUnreadable(f"{path}: is no regular file; logs are memory-mapped, so save it to a file first")
        with path.open("rb") as file:
            return hashlib.file_digest(file, "sha256").hexdigest()
    except OSError as error:
        raise unreadable(str(path), error) from error


def unreadable(name: str, error: OSError) -> LogUnreadable:
    """Return the error of a file that cannot be opened or read."""
    if isinstance(error, FileNotFoundError):
        return LogUnreadable(f"{name}: {missing_file(str(error.filename or name))}")
    return LogUnreadable(f"{name}: cannot be read ({error.strerror or error})")


def _no_room(error: OSError) -> LogUnreadable:
    import tempfile

    return LogUnreadable(f"{tempfile.gettempdir()}: the temporary folder cannot hold the log ({error.strerror})")


CHANGED = "changed while it was read (it is still being written or copied); try again when it is whole"


@contextmanager
def require_unchanged(path: Path) -> Iterator[None]:
    """Raise LogUnreadable if the file changes inside the with block.

    It replaces any exception of the block.
    """
    before = file_state(path)
    failure: Exception | None = None
    try:
        yield
    except Exception as error:
        failure = error
    if before is not None and file_state(path) != before:
        raise LogUnreadable(f"{path}: {CHANGED}") from failure
    if failure is not None:
        raise failure


def file_state(path: Path) -> tuple[int, int] | None:
    """Return size and time of the last change; None without the file."""
    try:
        found = path.stat()
    except OSError:
        return None
    return found.st_size, found.st_mtime_ns


# Recognition of logs and archives among other files.

# Suffixes that only logs have. Such a file counts as a log even if damaged.
LOG_SUFFIXES = frozenset((".ulg", ".ulge", ".tlog", ".mcap", ".db3"))

# First bytes of zip archives.
MAGICS = (b"PK\x03\x04", b"PK\x05\x06")

# Suffixes that logs may have. Files behind URLs are recognised by name, because reading each would take hours.
POSSIBLE_SUFFIXES = LOG_SUFFIXES | {".bin", ".log", ".mavlink"}


def is_meant(path: Path) -> bool:
    """Return True for a log by content, or by name if damaged or unreadable."""
    try:
        formats.recognise(path)
    except NotALog:
        return named_as_log(path.name)
    except LogUnreadable:
        return may_be_log(path.name)  # an unreadable file is kept, so that it is reported
    return True


def is_archive(path: Path) -> bool:
    """Recognise a zip archive by its first bytes; False for pipes and unreadable files."""
    try:
        if not stat.S_ISREG(path.stat().st_mode):
            return False
        with path.open("rb") as file:
            return file.read(4) in MAGICS
    except OSError:
        return False


def named_as_log(name: str) -> bool:
    """Return True for a name that only logs have."""
    return _suffix(name) in LOG_SUFFIXES


def may_be_log(name: str) -> bool:
    """Return True for a name that logs may have."""
    return _suffix(name) in POSSIBLE_SUFFIXES


def _suffix(name: str) -> str:
    return PurePath(name.lower().removesuffix(".gz")).suffix
