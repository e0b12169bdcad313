"""Files appear whole or not at all."""

from __future__ import annotations

import errno
import re
import secrets
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import BinaryIO

from attlog.errors import OutputError

KEPT = 40
"""Characters of a file's name that stand in the name of its temporary file."""
UNFINISHED = re.compile(r"\.(.*)\.[0-9a-f]{12}")
NO_ROOM = frozenset((errno.ENOSPC, errno.EDQUOT, errno.EROFS, errno.EIO))


def is_full(error: BaseException | None) -> bool:
    """Whether an error says that the whole file system takes no more, not this one file."""
    return isinstance(error, OSError) and error.errno in NO_ROOM


def write_atomic(path: Path, data: str | bytes) -> None:
    """Write through a temporary file in the same folder and rename; an old file survives any failure.

    The file gets the rights that any new file of the process gets there. OutputError
    says what could not be written and why.
    """
    with writing(path) as file:
        file.write(data.encode("utf-8") if isinstance(data, str) else data)


@contextmanager
def writing(path: Path) -> Iterator[BinaryIO]:
    """The same for what is written bit by bit: a file that takes its name when the block ends well, else none."""
    temporary = None
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        file, temporary = _new_file_beside(path)
        with file:
            yield file
        temporary.replace(path)
    except BaseException as error:
        if temporary is not None:
            temporary.unlink(missing_ok=True)
        if not isinstance(error, OSError):
            raise
        raise OutputError(
            f"{path}: cannot be written ({error.strerror or error}); choose another place with -o"
        ) from error


def remove_unfinished(folder: Path, *names: str) -> None:
    """Remove what processes that were killed left of files of these names (of any without): whoever calls this must
    know that nobody is writing them now."""
    for path in folder.glob(".*"):
        found = UNFINISHED.fullmatch(path.name)
        if found and path.is_file() and (not names or found[1] in {name[:KEPT] for name in names}):
            path.unlink(missing_ok=True)


def _new_file_beside(path: Path) -> tuple[BinaryIO, Path]:
    """A file that did not exist before; the system itself applies umask and inherited rights, unlike ``mkstemp``."""
    while True:
        place = path.with_name(f".{path.name[:KEPT]}.{secrets.token_hex(6)}")
        try:
            return place.open("xb"), place
        except FileExistsError:
            continue
