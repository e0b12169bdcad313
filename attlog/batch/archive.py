"""Logs inside zip archives: list the members, copy one out.

Archives are untrusted: a member's name is never used as a path, and its unpacked size is limited
(``attlog.core.limits``).
"""

from __future__ import annotations

import io
import zipfile
import zlib
from collections.abc import Iterator
from contextlib import contextmanager
from fnmatch import fnmatchcase
from itertools import count
from pathlib import Path, PurePosixPath
from tempfile import TemporaryDirectory
from typing import IO

from attlog import formats
from attlog.batch.log_file import BLOCK, copy, may_be_log, named_as_log, unreadable
from attlog.batch.remote import is_url, without_secrets
from attlog.core.errors import LogUnreadable, LogUnusable
from attlog.core.limits import MAX_MEMBERS, MAX_UNPACKED_BYTES, MAX_UNPACKED_RATIO, UNPACKED_ANYWAY_BYTES

_ENCRYPTED = 1
# macOS adds this folder with one small file of the same name for each file.
MADE_BY_MACOS = "__MACOSX"
# Errors of a damaged or foreign archive; RuntimeError: the member is encrypted.
_BROKEN = (zipfile.BadZipFile, zlib.error, EOFError, NotImplementedError, RuntimeError, ValueError, OverflowError)


def list_members(place: str, pattern: str = "") -> list[str]:
    """Return the log members of an archive (path or URL) that match ``pattern``.

    Encrypted members are recognised by name, hidden ones by content only. LogUnreadable: the archive cannot be read.
    LogUnusable: the archive is damaged or has too many members.
    """
    with _archive(place) as archive:
        entries = _entries(archive)
        if len(entries) > MAX_MEMBERS:
            raise LogUnusable(
                f"{without_secrets(place)}: holds more than {MAX_MEMBERS} files; unpack what you need of it"
            )
        if pattern:
            wanted = [name for name in entries if name == pattern] or [n for n in entries if fnmatchcase(n, pattern)]
        else:
            wanted = [name for name in entries if MADE_BY_MACOS not in name.split("/")]
        if wanted == [pattern]:
            return wanted
        return [name for name in sorted(wanted) if _is_log(archive, entries[name])]


def count_encrypted(place: str) -> int:
    """Count the encrypted files of an archive. Errors as :func:`list_members`."""
    with _archive(place) as archive:
        return sum(map(_encrypted, archive.infolist()))


def extract_member(place: str, member: str, path: Path) -> tuple[str, int]:
    """Write a member to a file; return SHA-256 and size. Errors as :meth:`attlog.batch.sources.Source.local`."""
    name = f"{without_secrets(place)}/{member}"
    with _archive(place) as archive:
        entry = _entry(archive, member, name)
        if _encrypted(entry):
            raise LogUnusable(f"{name}: is encrypted in its archive; unpack it with its password first")
        try:
            return copy(_blocks(archive, entry, name), path)
        except NotImplementedError as error:
            raise LogUnusable(
                f"{name}: cannot be unpacked ({error}); unpack it with the program that made it"
            ) from error
        except _BROKEN as error:
            raise LogUnusable(f"{name}: is damaged in its archive ({error})") from error
        except OSError as error:
            raise unreadable(name, error) from error


def member_stamp(place: str, member: str) -> str:
    """Return size and checksum of a member from its archive."""
    with _archive(place) as archive:
        entry = _entry(archive, member, f"{without_secrets(place)}/{member}")
        return f"{entry.file_size}-{entry.CRC:08x}"


@contextmanager
def _archive(place: str) -> Iterator[zipfile.ZipFile]:
    """Open an archive; download it first if its server cannot send parts of files."""
    if not is_url(place):
        with _opened(place, place) as archive:
            yield archive
        return
    from attlog.batch.remote import download, random_access

    with random_access(place) as file:
        if file is not None:
            with _opened(file, place) as archive:
                yield archive
            return
    try:
        scratch = TemporaryDirectory(prefix="attlog-")
    except OSError as error:
        raise LogUnreadable(
            f"{without_secrets(place)}: no temporary folder for it ({error.strerror or error})"
        ) from error
    with scratch as folder:
        path = Path(folder) / "archive.zip"
        download(place, path)
        with _opened(path, place) as archive:
            yield archive


def _opened(file: str | Path | IO[bytes], place: str) -> zipfile.ZipFile:
    """Open the archive in a file. LogUnreadable, LogUnusable."""
    try:
        return zipfile.ZipFile(file)
    except OSError as error:
        raise unreadable(without_secrets(place), error) from error
    except _BROKEN as error:
        raise LogUnusable(f"{without_secrets(place)}: is a damaged zip archive ({error})") from error


def _entry(archive: zipfile.ZipFile, member: str, name: str) -> zipfile.ZipInfo:
    try:
        return _entries(archive)[member]
    except KeyError:
        raise LogUnreadable(f"{name}: no such member of the archive") from None


def _entries(archive: zipfile.ZipFile) -> dict[str, zipfile.ZipInfo]:
    """Return the entries of an archive by name.

    Appended archives repeat names: a second file of one name becomes ``a (2).ulg``, identical copies are dropped.
    """
    found: dict[str, zipfile.ZipInfo] = {}
    taken = set(archive.namelist())
    seen: dict[str, set[tuple[int, int]]] = {}
    numbers: dict[str, Iterator[int]] = {}
    for entry in archive.infolist():
        name, content = entry.filename, (entry.file_size, entry.CRC)
        if entry.is_dir() or content in seen.setdefault(name, set()):
            continue
        seen[name].add(content)
        if name in found:
            path = PurePosixPath(name)
            counting = numbers.setdefault(name, count(2))
            name = next(n for k in counting if (n := f"{path.parent / path.stem} ({k}){path.suffix}") not in taken)
            taken.add(name)
        found[name] = entry
    return found


def _encrypted(entry: zipfile.ZipInfo) -> bool:
    return bool(entry.flag_bits & _ENCRYPTED)


def _blocks(archive: zipfile.ZipFile, entry: zipfile.ZipInfo, name: str) -> Iterator[bytes]:
    """Yield a member's content up to the size limit, whatever its declared size."""
    limit = min(MAX_UNPACKED_BYTES, max(UNPACKED_ANYWAY_BYTES, MAX_UNPACKED_RATIO * entry.compress_size))
    given = 0
    with archive.open(entry) as file:
        while block := file.read(BLOCK):
            given += len(block)
            if given > limit:
                raise LogUnusable(f"{name}: unpacks to more than {limit >> 20} MB; no flight log does that")
            yield block


def _is_log(archive: zipfile.ZipFile, entry: zipfile.ZipInfo) -> bool:
    """Recognise a log by content, else by name, as :func:`attlog.batch.log_file.is_meant`."""
    if _encrypted(entry):
        return may_be_log(entry.filename)  # an unreadable member is kept, so that it is reported
    try:
        with archive.open(entry) as file:
            head = file.read(formats.MAX_HEAD_BYTES)
        if formats.recognise_bytes(io.BytesIO(head)):
            return True
    except (*_BROKEN, OSError):
        pass  # damaged: recognised by name
    return named_as_log(entry.filename) and not _hidden(entry.filename)


def _hidden(name: str) -> bool:
    return any(part[:1] == "." and part not in (".", "..") for part in name.split("/"))
