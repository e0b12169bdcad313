"""Atomic writing of files, safe file names, private folders, reading of settings, and safe CSV cells."""

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

from attlog.core.errors import LogUnreadable, OutputError, UsageError, missing_file
from attlog.core.limits import MAX_SETTINGS_BYTES
from attlog.core.own_files import ANY_FILE, FileKind, is_special, require_replaceable

# Letters of a file's name in the name of its temporary file.
MAX_TEMPORARY_LETTERS = 40
STAGING_NAME = "attlog-unfinished"
UNFINISHED_NAME = re.compile(r"\.(.*)\.[0-9a-f]{12}")
DISK_FULL_ERRNOS = frozenset((errno.ENOSPC, errno.EDQUOT, errno.EROFS, errno.EIO))


def is_disk_full(error: BaseException | None) -> bool:
    """Return whether an error is a full file system, not a limit of this file."""
    return isinstance(error, OSError) and error.errno in DISK_FULL_ERRNOS


def write_atomic(path: Path, data: str | bytes, kind: FileKind | None = None) -> None:
    """Write a temporary file in the same folder and rename it.

    An existing file is replaced if it is of this kind or has this content, else OutputError; None replaces nothing.
    An old file survives any failure. The file gets the rights of any new file of the process. Bytes of names that are
    no UTF-8 are written as escapes. OutputError names the file and the reason.
    """
    content = _encoded(data)
    with open_atomic(path, ANY_FILE if _holds(path, content) else kind) as file:
        file.write(content)


def _holds(path: Path, content: bytes) -> bool:
    """Return whether a file has this content already, so that nothing is lost."""
    try:
        return path.is_file() and path.stat().st_size == len(content) and path.read_bytes() == content
    except (OSError, ValueError):
        return False


def _encoded(data: str | bytes) -> bytes:
    return data.encode("utf-8", "backslashreplace") if isinstance(data, str) else data


def write_all_atomic(files: Mapping[Path, str | bytes], kind: FileKind | None = None) -> None:
    """Write several files of a kind: either all are replaced or none.

    OutputError as write_atomic.
    """
    with ExitStack() as open_files:
        for path, data in files.items():
            file = open_files.enter_context(open_atomic(path, kind))
            file.write(_encoded(data))
            file.flush()


@contextmanager
def staging_folder(folder: Path, kind: FileKind | None = None) -> Iterator[Path]:
    """Yield a temporary folder whose files move into ``folder`` at the end, all or none.

    They replace files of this kind only, as in :func:`write_atomic`. The JSON files move last. OutputError names the
    final places.
    """
    stage = None
    try:
        folder.mkdir(parents=True, exist_ok=True)
        stage = folder / f".{STAGING_NAME}.{secrets.token_hex(6)}"
        stage.mkdir()
        yield stage
        made = sorted(stage.iterdir(), key=lambda path: (path.suffix == ".json", path.name))
        for path in made:
            if is_special(folder / path.name):
                raise FileExistsError(errno.EEXIST, "is a device, a pipe or a socket", str(folder / path.name))
            require_replaceable(folder / path.name, kind)
        for path in made:
            path.replace(folder / path.name)
    except OSError as error:
        place = error.filename if isinstance(error, FileExistsError) else folder
        raise _write_error(Path(place), error) from error
    except OutputError as error:
        raise OutputError(str(error).replace(str(stage), str(folder))) from error.__cause__
    finally:
        if stage is not None:
            shutil.rmtree(stage, ignore_errors=True)


@contextmanager
def open_atomic(path: Path, kind: FileKind | None = None) -> Iterator[BinaryIO]:
    """Yield a temporary file that gets its final name if the block ends without error.

    ``kind`` as in :func:`write_atomic`. A terminal, ``/dev/null``, a pipe or ``/dev/stdout`` is written in place: a
    file instead would destroy it.
    """
    if is_special(path):
        with _open_special(path) as special:
            yield special
        return
    require_replaceable(path, kind)
    temporary = None
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        file = None
        while file is None:
            temporary = path.with_name(f".{path.name[:MAX_TEMPORARY_LETTERS]}.{secrets.token_hex(6)}")
            with suppress(FileExistsError):
                file = temporary.open("xb")  # with umask and inherited rights, unlike ``mkstemp``
        with file:
            yield file
        if temporary is not None:
            temporary.replace(path)
    except BaseException as error:
        if temporary is not None:
            with suppress(OSError):  # it may not exist
                temporary.unlink()
        if not isinstance(error, OSError):
            raise
        raise _write_error(path, error) from error


@contextmanager
def _open_special(path: Path) -> Iterator[BinaryIO]:
    """Yield a special file open for writing.

    Disks are refused, and pipes without a reader, which block for ever.
    """
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
            error = OSError(errno.ENXIO, "the pipe has no reader")
        raise _write_error(path, error) from error


def sha256(path: Path) -> str:
    """Return the SHA-256 of a file (hex). LogUnreadable if it cannot be read."""
    try:
        with open(path, "rb") as file:
            return hashlib.file_digest(file, "sha256").hexdigest()
    except OSError as error:
        raise LogUnreadable(f"{path}: cannot be read any more ({error.strerror or error})") from error


def remove_unfinished(folder: Path, *names: str) -> None:
    """Remove temporary files of these names (default: of all) left by killed processes.

    The caller must know that no process is writing them.
    """
    for path in folder.glob(".*"):
        found = UNFINISHED_NAME.fullmatch(path.name)
        if found and found[1] == STAGING_NAME and path.is_dir() and not path.is_symlink():
            shutil.rmtree(path, ignore_errors=True)
        elif found and path.is_file() and (not names or found[1] in {name[:MAX_TEMPORARY_LETTERS] for name in names}):
            path.unlink(missing_ok=True)


def _write_error(path: Path, error: OSError) -> OutputError:
    return OutputError(f"{path}: cannot be written ({error.strerror or error}); choose another place with -o")


# Names from logs, archives and servers come from strangers and are never used as a path. What could lead out of a
# folder, mean a device, hide a file or not be writable is replaced here.

# Bytes of UTF-8. File systems end at 255; a number, suffixes and the temporary file's letters are added.
MAX_NAME_BYTES = 200
# Bytes of the ending that a shortened name keeps (``.ulg.gz``).
MAX_SUFFIX_BYTES = 24
# Separators of folders, drives and streams on any system, and letters that some file system refuses.
FORBIDDEN_LETTERS = frozenset('/\\:*?"<>|')
# Devices on Windows, whatever follows the first dot.
DEVICE_NAME = re.compile(r"(con|prn|aux|nul|conin\$|conout\$|com[0-9¹²³]|lpt[0-9¹²³]) *(\..*)?", re.IGNORECASE)


def file_name(text: str, longest: int = MAX_NAME_BYTES) -> str:
    """Return a harmless file name of at most ``longest`` bytes.

    No separator, control or direction sign; no dot, dash or blank at the beginning, no dot or blank at the end.
    Forbidden letters become ``_``. A name that is too long keeps its beginning and ending around a hash of the whole.
    """
    name = "".join("_" if c in FORBIDDEN_LETTERS or not c.isprintable() else c for c in text)
    name = re.sub(r"^[ .\-]+", _underlined, name)
    name = re.sub(r"[ .]+$", _underlined, name)
    if DEVICE_NAME.fullmatch(name):
        name = f"_{name}"
    return _shortened(name, text, longest) or "unnamed"


def file_names(texts: Iterable[str], taken: Iterable[str] = (), longest: int = MAX_NAME_BYTES) -> list[str]:
    """Return the file name of each text; repeated names get numbers.

    Names that some file systems do not distinguish (case, composed accents) count as equal. ``taken`` names are in use.
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
    """Cut a name to ``longest`` bytes with a hash of the text."""
    if len(name.encode()) <= longest:
        return name
    digest = hashlib.sha256(text.encode("utf-8", "surrogatepass")).hexdigest()[:10]
    dots = re.search(r"(\.\w{1,12}){1,2}$", name)
    suffix = dots[0] if dots and len(dots[0].encode()) <= MAX_SUFFIX_BYTES else ""
    room = longest - len(digest) - len(suffix.encode()) - 1
    return f"{name.encode()[:room].decode(errors='ignore')}~{digest}{suffix}"


def _collation_key(name: str) -> str:
    return unicodedata.normalize("NFC", unicodedata.normalize("NFC", name).casefold())


# Code that this machine compiles and runs again lies in a folder that no other user can write to.

OTHERS_WRITE = stat.S_IWGRP | stat.S_IWOTH
# Trusted owners of the folders above: root, and the id that a container shows for unknown owners.
TRUSTED_OWNERS = (0, 65_534)


def private_folder(kind: str, version: str) -> Path | None:
    """Return a folder in the user's cache, or a temporary one.

    None if neither is usable. It exists, can be written, and belongs to the user alone.
    """
    import platformdirs

    user = Path(platformdirs.user_cache_dir("attlog")) / kind / version
    if is_private_folder(user):
        return user
    try:
        temporary = Path(tempfile.gettempdir()) / f"attlog-{kind}-{_user_name()}" / version
    except OSError:  # a read-only container
        return None
    return temporary if is_private_folder(temporary) else None


@cache
def installed_version(package: str) -> str:
    """Return the installed version of a package, "none" if missing.

    The package is not imported.
    """
    spec = find_spec(package)
    beside = Path(spec.origin).parents[1].iterdir() if spec is not None and spec.origin else ()
    names = [path.stem for path in beside if path.suffix == ".dist-info"]
    found = [name for name in names if name.lower().startswith(f"{package}-")]
    if len(found) == 1:  # importlib.metadata imports email and socket: 20 ms
        return found[0][len(package) + 1 :]
    from importlib.metadata import PackageNotFoundError, version

    try:
        return version(package)
    except PackageNotFoundError:
        return "none"


def is_private_folder(folder: Path) -> bool:
    """Return whether the folder is writable, and by this user alone."""
    try:
        # One by one: with ``parents=True`` folders get the rights of the umask, on many systems writable by the group.
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
    """Return whether no other user can replace a folder below (POSIX; elsewhere True).

    Write permission for a folder allows renaming its entries, also those of other owners, unless its sticky bit is set.
    """
    if not hasattr(os, "getuid"):
        return True
    info = above.stat()
    if info.st_uid not in (os.getuid(), *TRUSTED_OWNERS):
        return False
    by_group = info.st_mode & stat.S_IWGRP and info.st_gid not in (os.getgid(), 0)
    return bool(info.st_mode & stat.S_ISVTX) or not (info.st_mode & stat.S_IWOTH or by_group)


def _revoke_others_write(folder: Path) -> None:
    """Remove other users' right to write into a folder of the user."""
    info = folder.stat()
    if hasattr(os, "getuid") and info.st_uid == os.getuid() and info.st_mode & OTHERS_WRITE:
        folder.chmod(stat.S_IMODE(info.st_mode) & ~OTHERS_WRITE)


def _is_private(folder: Path) -> bool:
    """Return whether only the user can write to the folder (POSIX; elsewhere True)."""
    if not hasattr(os, "getuid"):
        return True
    info = folder.stat()
    return info.st_uid == os.getuid() and not info.st_mode & OTHERS_WRITE


def _user_name() -> str:
    return str(os.getuid()) if hasattr(os, "getuid") else os.environ.get("USERNAME", "user")


# Settings.


def read_settings_bytes(path: Path, largest: int = MAX_SETTINGS_BYTES) -> bytes:
    """Return the bytes of a settings file.

    LogUnreadable if it cannot be opened. UsageError for a device or a pipe, which may never end, and for more than
    ``largest`` bytes.
    """
    try:
        status = path.stat()
        mode = status.st_mode
        if not (stat.S_ISREG(mode) or stat.S_ISDIR(mode)):
            raise UsageError(f"{path}: is no file but a device or a pipe; write it to a file first")
        if stat.S_ISREG(mode) and status.st_size > largest:
            raise _too_large(path, largest)
        with path.open("rb") as file:
            content = file.read(largest + 1)
    except FileNotFoundError:
        raise LogUnreadable(f"{path}: {missing_file(str(path))}") from None
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
    """Return the text of a settings file without byte order mark.

    UsageError also where it is no UTF-8.
    """
    try:
        return read_settings_bytes(path, largest).decode("utf-8-sig").replace("\r\n", "\n")
    except UnicodeDecodeError as error:
        raise UsageError(f"{path}: no UTF-8 text at byte {error.start}") from error


def parse_toml(text: str, path: Path) -> dict[str, Any]:
    """Return the values of a TOML text.

    UsageError with line and column names ``path``.
    """
    import tomllib

    try:
        return tomllib.loads(text)
    except RecursionError:
        raise UsageError(f"{path}: not valid TOML: nested too deeply") from None
    except ValueError as error:  # also what tomllib leaves to Python: numbers of thousands of digits, dates in year 0
        raise UsageError(f"{path}: not valid TOML: {error}") from error


# CSV. Excel, LibreOffice and Google Sheets execute a cell that begins like a formula, also where it is quoted.
# Names and texts of a log can be any (``=HYPERLINK(...)``, ``@SUM(...)``, ``=cmd|...``).

# Beginnings of formulas, full-width signs included; spreadsheets skip white space before them.
FORMULA_START = re.compile(r"[\s\"]*[=+\-@＝＋－＠].|[\t\r\n].", re.DOTALL)
# Numbers begin like formulas and stay.
PLAIN_NUMBER = re.compile(r"[+-]?(\d+\.?\d*|\.\d+)([eE][+-]?\d+)?|[+-]?(inf|nan)", re.ASCII)
LINE_END = re.compile(r"\r\n?")
# Separators of cells in other dialects of CSV.
CELL_SEPARATOR = re.compile(r"([;\t\n])")
# Control and direction signs, byte order marks and bytes that are no UTF-8: they steer a terminal or hide a beginning.
INVISIBLE = re.compile(
    r"[\x00-\x08\x0b\x0c\x0e-\x1f\x7f-\x9f\u061c\u200e\u200f\u202a-\u202e\u2060\u2066-\u2069\ufeff\ud800-\udfff]"
)


def csv_cell(value: Any) -> Any:
    """Return a value as CSV cell that no spreadsheet executes.

    Texts that begin like a formula get an apostrophe in front, also behind a line end, a tab or a semicolon, where
    other CSV dialects begin a cell. Line ends become ``\\n``: a lone ``\\r`` ends a row in spreadsheets, and writers do
    not quote it.
    """
    if not isinstance(value, str):
        return value
    text = INVISIBLE.sub("\ufffd", LINE_END.sub("\n", value))
    parts = CELL_SEPARATOR.split(text)
    return _defused(parts[0], text) + "".join(_defused(part, part) for part in parts[1:])


def _defused(text: str, whole: str) -> str:
    """Put an apostrophe before a part of a text that would be executed."""
    return f"'{text}" if FORMULA_START.match(whole) and not PLAIN_NUMBER.fullmatch(text.strip()) else text


def csv_text(lines: Iterable[Sequence[Any]]) -> str:
    """Return lines of cells as CSV; None is an empty cell."""
    out = io.StringIO()
    csv.writer(out, lineterminator="\n").writerows([csv_cell(value) for value in line] for line in lines)
    return out.getvalue()
