"""Files appear whole or not at all."""

from __future__ import annotations

import errno
import os
import re
import secrets
import shutil
import stat
from collections.abc import Iterator, Mapping
from contextlib import ExitStack, contextmanager, suppress
from pathlib import Path
from typing import BinaryIO

from attlog.base.errors import OutputError

KEPT = 40
"""Characters of a file's name that stand in the name of its temporary file."""
STAGE = "attlog-unfinished"
UNFINISHED = re.compile(r"\.(.*)\.[0-9a-f]{12}")
NO_ROOM = frozenset((errno.ENOSPC, errno.EDQUOT, errno.EROFS, errno.EIO))


def is_full(error: BaseException | None) -> bool:
    """Whether an error says that the whole file system takes no more, not this one file."""
    return isinstance(error, OSError) and error.errno in NO_ROOM


def write_atomic(path: Path, data: str | bytes) -> None:
    """Write through a temporary file in the same folder and rename; an old file survives any failure.

    The file gets the rights that any new file of the process gets there. What UTF-8 cannot hold (a byte of a file's
    name that is none) is written as an escape. OutputError says what could not be written and why.
    """
    with writing(path) as file:
        file.write(_bytes(data))


def _bytes(data: str | bytes) -> bytes:
    return data.encode("utf-8", "backslashreplace") if isinstance(data, str) else data


def write_together(files: Mapping[Path, str | bytes]) -> None:
    """Write several files that belong together: all are written before the first takes its name, so that either the
    old ones stay or all are new. OutputError as of :func:`write_atomic`."""
    with ExitStack() as open_files:
        for path, data in files.items():
            file = open_files.enter_context(writing(path))
            file.write(_bytes(data))
            file.flush()
            if path.is_dir():  # renaming would fail when another has its name already
                raise IsADirectoryError(errno.EISDIR, os.strerror(errno.EISDIR), str(path))


@contextmanager
def staged(folder: Path) -> Iterator[Path]:
    """The same for files that others write: a folder inside, whose files move into this one when the block ends well.

    OutputError names files where they were to be.
    """
    stage = None
    try:
        folder.mkdir(parents=True, exist_ok=True)
        stage = folder / f".{STAGE}.{secrets.token_hex(6)}"
        stage.mkdir()
        yield stage
        made = sorted(stage.iterdir(), key=lambda path: (path.suffix == ".json", path.name))
        for path in made:
            if (folder / path.name).is_dir():
                raise IsADirectoryError(errno.EISDIR, os.strerror(errno.EISDIR), str(folder / path.name))
            if is_special(folder / path.name):
                raise FileExistsError(errno.EEXIST, "is a device, a pipe or a socket", str(folder / path.name))
        for path in made:
            path.replace(folder / path.name)
    except OSError as error:
        place = error.filename if isinstance(error, (IsADirectoryError, FileExistsError)) else folder
        raise _cannot(Path(place), error) from error
    except OutputError as error:
        raise OutputError(str(error).replace(str(stage), str(folder))) from error.__cause__
    finally:
        if stage is not None:
            shutil.rmtree(stage, ignore_errors=True)


@contextmanager
def writing(path: Path) -> Iterator[BinaryIO]:
    """The same for what is written bit by bit: a file that takes its name when the block ends well, else none.

    A terminal, ``/dev/null``, a pipe or ``/dev/stdout`` are written into as they are: a file in their place would end
    them, for all programs where root does it.
    """
    if is_special(path):
        with _into(path) as special:
            yield special
        return
    temporary = None
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        file = None
        while file is None:
            temporary = path.with_name(f".{path.name[:KEPT]}.{secrets.token_hex(6)}")
            with suppress(FileExistsError):
                file = temporary.open("xb")  # the system itself applies umask and inherited rights, unlike ``mkstemp``
        with file:
            yield file
        if temporary is not None:
            temporary.replace(path)
    except BaseException as error:
        if temporary is not None:
            with suppress(OSError):  # it was never made
                temporary.unlink()
        if not isinstance(error, OSError):
            raise
        raise _cannot(path, error) from error


def is_special(path: Path) -> bool:
    """Whether a name is none of a file or folder, or one that the system keeps for what a process has open."""
    try:
        mode = path.stat().st_mode
        if not (stat.S_ISREG(mode) or stat.S_ISDIR(mode)):
            return True
        where = os.path.realpath(path.parent)
        return stat.S_ISREG(mode) and (where in ("/dev", "/dev/fd") or where.startswith("/proc/"))
    except (OSError, ValueError):  # nothing there, or no name of a file: writing it says so
        return False


@contextmanager
def _into(path: Path) -> Iterator[BinaryIO]:
    """What is no file, open for writing. A pipe that nobody reads is refused (it would wait for ever), so are disks."""
    try:
        mode = path.stat().st_mode
        if stat.S_ISBLK(mode):
            raise OSError(errno.EPERM, "is a disk")
        place = os.open(path, os.O_WRONLY | os.O_APPEND | os.O_NOCTTY | (os.O_NONBLOCK if stat.S_ISFIFO(mode) else 0))
        os.set_blocking(place, True)
        with os.fdopen(place, "wb") as file:
            yield file
    except OSError as error:
        if error.errno == errno.ENXIO:
            error = OSError(errno.ENXIO, "nobody reads this pipe")
        raise _cannot(path, error) from error


def remove_unfinished(folder: Path, *names: str) -> None:
    """Remove what processes that were killed left of files of these names (of any without): whoever calls this must
    know that nobody is writing them now."""
    for path in folder.glob(".*"):
        found = UNFINISHED.fullmatch(path.name)
        if found and found[1] == STAGE and path.is_dir() and not path.is_symlink():
            shutil.rmtree(path, ignore_errors=True)
        elif found and path.is_file() and (not names or found[1] in {name[:KEPT] for name in names}):
            path.unlink(missing_ok=True)


def _cannot(path: Path, error: OSError) -> OutputError:
    return OutputError(f"{path}: cannot be written ({error.strerror or error}); choose another place with -o")
