"""Is a log still the same after it was read? Copies in progress grow, cards are pulled out, files are cut."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from attlog.base.errors import LogUnreadable

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
