"""Files appear whole or not at all."""

from __future__ import annotations

import csv
import errno
import hashlib
import io
import os
import re
import secrets
import shutil
import stat
import tempfile
import unicodedata
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import ExitStack, contextmanager, suppress
from functools import cache
from importlib.util import find_spec
from pathlib import Path
from typing import Any, BinaryIO

from attlog.core.errors import LogUnreadable, OutputError, UsageError
from attlog.core.limits import MAX_SETTINGS_BYTES

MAX_TEMPORARY_LETTERS = 40
"""Characters of a file's name that stand in the name of its temporary file."""
STAGING_NAME = "attlog-unfinished"
UNFINISHED_NAME = re.compile(r"\.(.*)\.[0-9a-f]{12}")
DISK_FULL_ERRNOS = frozenset((errno.ENOSPC, errno.EDQUOT, errno.EROFS, errno.EIO))


def is_disk_full(error: BaseException | None) -> bool:
    """Whether an error says that the whole file system takes no more, not this one file."""
    return isinstance(error, OSError) and error.errno in DISK_FULL_ERRNOS


def write_atomic(path: Path, data: str | bytes) -> None:
    """Write through a temporary file in the same folder and rename; an old file survives any failure.

    The file gets the rights that any new file of the process gets there. What UTF-8 cannot hold (a byte of a file's
    name that is none) is written as an escape. OutputError says what could not be written and why.
    """
    with open_atomic(path) as file:
        file.write(_encoded(data))


def _encoded(data: str | bytes) -> bytes:
    return data.encode("utf-8", "backslashreplace") if isinstance(data, str) else data


def write_all_atomic(files: Mapping[Path, str | bytes]) -> None:
    """Write several files that belong together: all are written before the first takes its name, so that either the
    old ones stay or all are new. OutputError as of :func:`write_atomic`."""
    with ExitStack() as open_files:
        for path, data in files.items():
            file = open_files.enter_context(open_atomic(path))
            file.write(_encoded(data))
            file.flush()
            if path.is_dir():  # renaming would fail when another has its name already
                raise IsADirectoryError(errno.EISDIR, os.strerror(errno.EISDIR), str(path))


@contextmanager
def staging_folder(folder: Path) -> Iterator[Path]:
    """The same for files that others write: a folder inside, whose files move into this one when the block ends well.

    OutputError names files where they were to be.
    """
    stage = None
    try:
        folder.mkdir(parents=True, exist_ok=True)
        stage = folder / f".{STAGING_NAME}.{secrets.token_hex(6)}"
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
        raise _write_error(Path(place), error) from error
    except OutputError as error:
        raise OutputError(str(error).replace(str(stage), str(folder))) from error.__cause__
    finally:
        if stage is not None:
            shutil.rmtree(stage, ignore_errors=True)


@contextmanager
def open_atomic(path: Path) -> Iterator[BinaryIO]:
    """The same for what is written bit by bit: a file that takes its name when the block ends well, else none.

    A terminal, ``/dev/null``, a pipe or ``/dev/stdout`` are written into as they are: a file in their place would end
    them, for all programs where root does it.
    """
    if is_special(path):
        with _open_special(path) as special:
            yield special
        return
    temporary = None
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        file = None
        while file is None:
            temporary = path.with_name(f".{path.name[:MAX_TEMPORARY_LETTERS]}.{secrets.token_hex(6)}")
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
        raise _write_error(path, error) from error


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
def _open_special(path: Path) -> Iterator[BinaryIO]:
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
        raise _write_error(path, error) from error


def remove_unfinished(folder: Path, *names: str) -> None:
    """Remove what processes that were killed left of files of these names (of any without): whoever calls this must
    know that nobody is writing them now."""
    for path in folder.glob(".*"):
        found = UNFINISHED_NAME.fullmatch(path.name)
        if found and found[1] == STAGING_NAME and path.is_dir() and not path.is_symlink():
            shutil.rmtree(path, ignore_errors=True)
        elif found and path.is_file() and (not names or found[1] in {name[:MAX_TEMPORARY_LETTERS] for name in names}):
            path.unlink(missing_ok=True)


def _write_error(path: Path, error: OSError) -> OutputError:
    return OutputError(f"{path}: cannot be written ({error.strerror or error}); choose another place with -o")


# Names from logs, archives and servers as names of files: harmless, short enough, each once.
#
# A log is a stranger's file, and so is what it calls its messages. No such name is ever used as a path: what could
# lead
# out of a folder, mean a device, hide a file or not be written at all is replaced here, and only here.

MAX_NAME_BYTES = 200
"""Bytes of UTF-8; file systems end at 255, and a number, suffixes and what temporary files need are added."""
MAX_SUFFIX_BYTES = 24
"""Bytes of an ending that a shortened name keeps (``.ulg.gz``): it says what the file was."""
FORBIDDEN_LETTERS = frozenset('/\\:*?"<>|')
"""What separates folders, drives and streams somewhere, or what some file system refuses."""
DEVICE_NAME = re.compile(r"(con|prn|aux|nul|conin\$|conout\$|com[0-9¹²³]|lpt[0-9¹²³]) *(\..*)?", re.IGNORECASE)
"""Names that mean a device on Windows, whatever follows the first dot."""


def file_name(text: str, longest: int = MAX_NAME_BYTES) -> str:
    """A name from outside as the name of one file: no separator, control or direction sign, at most ``longest`` bytes.

    It begins with no dot (hidden), dash (an option to other programs) or blank and ends with neither dot nor blank.
    What is forbidden becomes ``_``; a name that has to be shortened keeps its beginning and ending around a hash of
    the whole. Names without fault stay as they are, letters of all scripts included.
    """
    name = "".join("_" if c in FORBIDDEN_LETTERS or not c.isprintable() else c for c in text)
    name = re.sub(r"^[ .\-]+", _underlined, name)
    name = re.sub(r"[ .]+$", _underlined, name)
    if DEVICE_NAME.fullmatch(name):
        name = f"_{name}"
    return _shortened(name, text, longest) or "unnamed"


def file_names(texts: Iterable[str], taken: Iterable[str] = (), longest: int = MAX_NAME_BYTES) -> list[str]:
    """The file name of each text; a second of the same name gets a number, in the order given.

    Names that some file systems do not distinguish (case, composed accents) count as the same. ``taken`` are names
    that are in use already.
    """
    used = {_collation_key(name) for name in taken}
    next_number: dict[str, int] = {}
    names = []
    for text in texts:
        own = name = file_name(text, longest)
        number = next_number.get(_collation_key(own), 1)
        while _collation_key(name) in used:
            number += 1
            name = f"{own}-{number}"
        next_number[_collation_key(own)] = number
        used.add(_collation_key(name))
        names.append(name)
    return names


def _underlined(match: re.Match[str]) -> str:
    return "_" * len(match[0])


def _shortened(name: str, text: str, longest: int) -> str:
    """The name in at most ``longest`` bytes, distinguished from others that begin alike by a hash of the whole text."""
    if len(name.encode()) <= longest:
        return name
    digest = hashlib.sha256(text.encode("utf-8", "surrogatepass")).hexdigest()[:10]
    dots = re.search(r"(\.\w{1,12}){1,2}$", name)
    suffix = dots[0] if dots and len(dots[0].encode()) <= MAX_SUFFIX_BYTES else ""
    room = longest - len(digest) - len(suffix.encode()) - 1
    return f"{name.encode()[:room].decode(errors='ignore')}~{digest}{suffix}"


def _collation_key(name: str) -> str:
    return unicodedata.normalize("NFC", unicodedata.normalize("NFC", name).casefold())


# Where is kept what this machine made for itself and runs again? In a folder that nobody else can write into.

OTHERS_WRITE = stat.S_IWGRP | stat.S_IWOTH
TRUSTED_OWNERS = (0, 65_534)
"""Owners of the folders above: root, and whom a container shows in the place of an owner that it does not know."""


def private_folder(kind: str, version: str) -> Path | None:
    """The folder for things of this kind and version: in the user's cache, else a temporary one; None if neither is.

    It exists, can be written, and belongs to the user alone.
    """
    import platformdirs

    user = Path(platformdirs.user_cache_dir("attlog")) / kind / version
    if is_private_folder(user):
        return user
    try:
        temporary = Path(tempfile.gettempdir()) / f"attlog-{kind}-{_user_name()}" / version
    except OSError:  # no folder of the system's can be written either: a container that is read-only
        return None
    return temporary if is_private_folder(temporary) else None


@cache
def installed_version(package: str) -> str:
    """The installed version of a package, for the name of a folder; "none" where there is none. Imports it not."""
    spec = find_spec(package)
    beside = Path(spec.origin).parents[1].iterdir() if spec is not None and spec.origin else ()
    names = [path.stem for path in beside if path.suffix == ".dist-info"]
    found = [name for name in names if name.lower().startswith(f"{package}-")]
    if len(found) == 1:  # the metadata would tell as well, but imports email and socket: 20 ms
        return found[0][len(package) + 1 :]
    from importlib.metadata import PackageNotFoundError, version

    try:
        return version(package)
    except PackageNotFoundError:
        return "none"


def is_private_folder(folder: Path) -> bool:
    """True if the folder can be made and written and nobody else can put code into it."""
    try:
        # One by one: folders made on the way get the rights of the umask, and with that of many systems (002) the
        # user's own group could write into them.
        for above in reversed([path for path in folder.parents if not path.exists()]):
            above.mkdir(mode=0o700, exist_ok=True)
        _revoke_others_write(folder.parent)  # earlier versions left it open
        folder.mkdir(mode=0o700, exist_ok=True)
        with tempfile.NamedTemporaryFile(dir=folder):
            pass
        return _is_private(folder) and _is_private(folder.parent) and all(map(_is_unmovable, folder.resolve().parents))
    except OSError:
        return False


def _is_unmovable(above: Path) -> bool:
    """True if nobody else can put another folder in the place of one that lies here (POSIX; elsewhere True).

    Who may write to a folder may rename what is in it, also what belongs to others, unless its sticky bit is set.
    """
    if not hasattr(os, "getuid"):
        return True
    info = above.stat()
    if info.st_uid not in (os.getuid(), *TRUSTED_OWNERS):
        return False
    by_group = info.st_mode & stat.S_IWGRP and info.st_gid not in (os.getgid(), 0)
    return bool(info.st_mode & stat.S_ISVTX) or not (info.st_mode & stat.S_IWOTH or by_group)


def _revoke_others_write(folder: Path) -> None:
    """Nobody else may write into a folder of the user's; what others put there before is theirs and never used."""
    info = folder.stat()
    if hasattr(os, "getuid") and info.st_uid == os.getuid() and info.st_mode & OTHERS_WRITE:
        folder.chmod(stat.S_IMODE(info.st_mode) & ~OTHERS_WRITE)


def _is_private(folder: Path) -> bool:
    """True if the folder belongs to the user and is not writable by others (POSIX; elsewhere True)."""
    if not hasattr(os, "getuid"):
        return True
    info = folder.stat()
    return info.st_uid == os.getuid() and not info.st_mode & OTHERS_WRITE


def _user_name() -> str:
    return str(os.getuid()) if hasattr(os, "getuid") else os.environ.get("USERNAME", "user")


# Files that people write for attlog (options, parameters, scenarios, gates): their bytes, text and TOML.


def read_settings_bytes(path: Path, largest: int = MAX_SETTINGS_BYTES) -> bytes:
    """What a file holds. LogUnreadable if it cannot be opened, UsageError where it is no file (a device or a pipe
    may never end) or larger than ``largest`` bytes."""
    try:
        status = path.stat()
        mode = status.st_mode
        if not (stat.S_ISREG(mode) or stat.S_ISDIR(mode)):
            raise UsageError(f"{path}: is no file but a device or a pipe; write it to a file first")
        if stat.S_ISREG(mode) and status.st_size > largest:
            raise _too_large(path, largest)
        with path.open("rb") as file:
            content = file.read(largest + 1)
    except OSError as error:
        raise LogUnreadable(f"{path}: cannot be read ({error.strerror or error})") from error
    except ValueError as error:  # a NUL in the name
        raise UsageError(f"{str(path)!r}: no name of a file ({error})") from None
    if len(content) > largest:
        raise _too_large(path, largest)
    return content


def _too_large(path: Path, largest: int) -> UsageError:
    return UsageError(f"{path}: larger than {largest / 1e6:,.0f} MB, which no such file is")


def read_settings_text(path: Path, largest: int = MAX_SETTINGS_BYTES) -> str:
    """The text of a file, with or without a byte order mark. Errors as of :func:`bytes_of`, and UsageError where it
    is no UTF-8."""
    try:
        return read_settings_bytes(path, largest).decode("utf-8-sig").replace("\r\n", "\n")
    except UnicodeDecodeError as error:
        raise UsageError(f"{path}: no UTF-8 text at byte {error.start}") from error


def parse_toml(text: str, path: Path) -> dict[str, Any]:
    """The values of a TOML text, which ``path`` names in messages. UsageError with line and column."""
    import tomllib

    try:
        return tomllib.loads(text)
    except RecursionError:
        raise UsageError(f"{path}: not valid TOML: nested too deeply") from None
    except ValueError as error:  # also what tomllib leaves to Python: numbers of thousands of digits, dates in year 0
        raise UsageError(f"{path}: not valid TOML: {error}") from error


# CSV that a spreadsheet shows and does not run: all cells and headers that attlog writes go through here.
#
# Excel, LibreOffice and Google Sheets take a cell that begins with one of a few signs for a formula, also where it is
# quoted in the file; a log's names and texts can say anything (``=HYPERLINK(...)``, ``@SUM(...)``, ``=cmd|...``).

FORMULA_START = re.compile(r"[\s\"]*[=+\-@＝＋－＠].|[\t\r\n].", re.DOTALL)
"""Beginnings that spreadsheets take for a formula, full-width signs included; they skip white space before them."""
PLAIN_NUMBER = re.compile(r"[+-]?(\d+\.?\d*|\.\d+)([eE][+-]?\d+)?|[+-]?(inf|nan)", re.ASCII)
"""What stays a number: formulas begin like these too."""
LINE_END = re.compile(r"\r\n?")
CELL_SEPARATOR = re.compile(r"([;\t\n])")
"""What ends a cell elsewhere."""
INVISIBLE = re.compile(
    r"[\x00-\x08\x0b\x0c\x0e-\x1f\x7f-\x9f\u061c\u200e\u200f\u202a-\u202e\u2060\u2066-\u2069\ufeff\ud800-\udfff]"
)
"""Control and direction signs, marks of byte order, bytes that are no UTF-8: they would steer the terminal that shows
the file, or hide how it begins."""


def csv_cell(value: Any) -> Any:
    """A value as a CSV cell: a text that would be run gets an apostrophe before it, all else stays what it is.

    So does the rest of a text behind a line end, a tab or a semicolon: read with another separator, it is a cell. Line
    ends become ``\\n``, for a lone ``\\r`` ends a row in spreadsheets and is not quoted by those who write CSV.
    """
    if not isinstance(value, str):
        return value
    text = INVISIBLE.sub("\ufffd", LINE_END.sub("\n", value))
    parts = CELL_SEPARATOR.split(text)
    return _defused(parts[0], text) + "".join(_defused(part, part) for part in parts[1:])


def _defused(text: str, whole: str) -> str:
    """A part of a text, behind an apostrophe where it, or the whole that it begins, would be run."""
    return f"'{text}" if FORMULA_START.match(whole) and not PLAIN_NUMBER.fullmatch(text.strip()) else text


def csv_text(lines: Iterable[Sequence[Any]]) -> str:
    """Lines of cells as CSV, head and all; None is an empty cell."""
    out = io.StringIO()
    csv.writer(out, lineterminator="\n").writerows([csv_cell(value) for value in line] for line in lines)
    return out.getvalue()
