"""Source of a log: file, archive member or URL, as a picklable value."""

from __future__ import annotations

import glob
import os
import re
import shutil
import stat
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from urllib.parse import unquote, urlsplit

from attlog import formats
from attlog.batch.log_file import hash_file, is_archive, is_meant, may_be_log, unreadable
from attlog.batch.remote import is_url, without_secrets
from attlog.core import limits
from attlog.core.errors import AttlogError, LogUnreadable, LogUnusable, NotALog, UsageError
from attlog.core.files import file_name
from attlog.core.limits import MAX_FILE_NAME_BYTES
from attlog.words.numbers import counted


@dataclass(frozen=True)
class Local:
    """Log as a file on this machine; ``copied``: SHA-256 and size of a copy."""

    path: Path
    copied: tuple[str, int] | None = None

    @cached_property
    def sha256(self) -> str:
        """SHA-256 (hex). LogUnreadable if the file cannot be read."""
        return self.copied[0] if self.copied is not None else hash_file(self.path)


@dataclass(frozen=True, slots=True, order=True)
class Source:
    """Place of a log: path or URL, and the member of a zip archive.

    ``copy``: a file with the log's bytes, for a machine that cannot reach the place.
    """

    place: str
    member: str = ""
    copy: str = ""

    @property
    def needs_copy(self) -> bool:
        """True for a URL or an archive member: both are copied before reading."""
        return bool(self.member) or is_url(self.place)

    @property
    def is_missing(self) -> bool:
        """True for a local path where there is nothing; a URL is not asked."""
        return not is_url(self.place) and not os.path.exists(self.place)

    @property
    def name(self) -> str:
        """Display name, equal across runs, such as ``archive.zip/flights/a.ulg``.

        Secrets of a URL are removed.
        """
        place = without_secrets(self.place)
        return _printable(f"{place}/{self.member}" if self.member else place)

    @property
    def file_name(self) -> str:
        """Safe file name for outputs, from the last part of the log's place."""
        if not self.member and not is_url(self.place):
            return Path(self.place).name
        if self.member:
            last = re.split(r"[/\\]", self.member)[-1]
        else:
            url = urlsplit(without_secrets(self.place))
            last = unquote(url.path.rstrip("/").rpartition("/")[2] or url.netloc)
            last += f"_{unquote(url.query)}" if url.query else ""
        return file_name(last, MAX_FILE_NAME_BYTES) if last else "log"

    def stamp(self) -> str:
        """Return a fingerprint of the content without a download.

        It is size and time, checksum of a member, or tag of a server; empty where the server has none. LogUnreadable if
        the place cannot be read.
        """
        if self.copy:
            return ""
        if self.member:
            from attlog.batch.archive import member_stamp

            return member_stamp(self.place, self.member)
        if is_url(self.place):
            from attlog.batch.remote import url_stamp

            return url_stamp(self.place)
        try:
            found = Path(self.place).stat()
        except OSError as error:
            raise unreadable(self.place, error) from error
        return f"{found.st_size}-{found.st_mtime_ns}"

    @contextmanager
    def local(self, scratch: Path | None = None) -> Iterator[Local]:
        """Provide the log as a local file inside a with block.

        A member or a URL is copied to a new folder in ``scratch`` (default: the system's temporary folder), removed at
        the end. LogUnreadable: missing, refused, cut short, timed out, no space. LogUnusable: an encrypted or damaged
        member, or too large for a log. Errors name the log, not its copy.
        """
        if self.copy or not self.needs_copy:
            path = Path(self.copy or self.place)
            with self._named(path):
                _refuse_large_non_log(path)
                yield Local(path)
            return
        import tempfile

        try:
            folder = Path(tempfile.mkdtemp(prefix="attlog-", dir=scratch))
        except OSError as error:
            raise LogUnreadable(f"{self.name}: no temporary folder for it ({error.strerror or error})") from error
        try:
            path = folder / self.file_name
            if self.member:
                from attlog.batch.archive import extract_member

                copied = extract_member(self.place, self.member, path)
            else:
                from attlog.batch.remote import download

                copied = download(self.place, path)
            with self._named(path):
                yield Local(path, copied)
        finally:
            shutil.rmtree(folder, ignore_errors=True)

    @contextmanager
    def _named(self, path: Path) -> Iterator[None]:
        try:
            yield
        except AttlogError as error:
            if str(path) not in str(error) or str(path) == self.name:
                raise
            raise type(error)(str(error).replace(str(path), self.name)) from error


def _printable(text: str) -> str:
    """Replace control characters: member names are untrusted."""
    return "".join(c if c.isprintable() or "\ud800" <= c <= "\udfff" else "?" for c in text)


def _refuse_large_non_log(path: Path) -> None:
    """Raise NotALog for a large file such as a disk image, before hashing."""
    try:
        formats.recognise(path)
    except NotALog:
        if path.stat().st_size > limits.NO_LOG_BYTES:
            raise


# Expansion of files, folders, patterns, archives and URLs to logs.

_PATTERN = frozenset("*?[")


def find(given: Iterable[Path]) -> tuple[list[Path], list[AttlogError]]:
    """Return the log files matched by paths, without archives, and errors."""
    logs: dict[Path, None] = {}
    wrong: list[AttlogError] = []
    for path in given:
        try:
            _refuse_url(path)
            logs |= dict.fromkeys(Path(source.place) for source in _meant(path, False, wrong))
        except AttlogError as error:
            wrong.append(error)
    return list(logs), wrong


def _refuse_url(path: Path) -> None:
    """Raise UsageError for a URL given as a path, which lacks a slash."""
    url = str(path).replace(":/", "://", 1)
    if is_url(url) and not os.path.lexists(path):
        raise UsageError(
            f"{without_secrets(url)}: is a URL, and this command reads files: download it first; "
            "analyze and batch read URLs"
        )


def sources(given: Iterable[str | Path]) -> tuple[list[Source], list[AttlogError]]:
    """Return the logs matched by names, each once, and errors.

    A file is taken unchecked, even if missing. A folder matches its logs at any depth except hidden ones. A pattern
    matches logs (``**`` includes folders). A zip archive matches its logs, ``archive.zip/*.ulg`` those members. These
    logs are recognised by content, also in gzip files. A URL is a log, an archive, a folder (``s3://bucket/flights``;
    ``https://host/flights/``) or a pattern where the place can be listed; these logs are recognised by name. A name
    without a log gives a LogUnreadable, ``-`` a UsageError.
    """
    logs: dict[Source, None] = {}
    wrong: list[AttlogError] = []
    for place in map(str, given):
        try:
            if place.lower().startswith("file://"):
                from urllib.request import url2pathname  # heavy: http and ssl come with it

                place = url2pathname(urlsplit(place).path)
            found = _behind(place) if is_url(place) else _meant(Path(place), True, wrong)
            logs |= dict.fromkeys(found)
        except AttlogError as error:
            wrong.append(error)
    return list(logs), wrong


def _meant(path: Path, archives: bool, wrong: list[AttlogError]) -> list[Source]:
    """Return the logs matched by one name; unreadable folders go to ``wrong``."""
    if str(path) == "-":
        raise UsageError("a log cannot come from standard input: it is memory-mapped; give a file name")
    if os.path.isdir(path):
        return _in_folder(path, archives, wrong)
    if os.path.exists(path) or not _PATTERN & set(str(path)):
        return _of_file(path) if archives else [Source(str(path))]
    if archives and (inside := _in_archive(path)) is not None:
        return inside
    matches = sorted(map(Path, glob.glob(str(path), recursive=True)))
    if not matches:
        raise _unreadable_root(path) or LogUnreadable(f"{path}: no file matches this pattern")
    files = [m for m in matches if not os.path.isdir(m)]
    logs = [log for file in files for log in _logs_of(file, archives)]
    if not files:
        logs = [log for folder in matches for log in _in_folder(folder, archives, wrong)]
    elif not logs:
        raise LogUnreadable(f"{path}: none of the {len(files)} files that match is a flight log")
    return logs


def _in_folder(folder: Path, archives: bool, wrong: list[AttlogError]) -> list[Source]:
    """Return the logs in a folder; LogUnreadable without any."""
    refused: list[AttlogError] = []
    logs = [log for path in sorted(_below(folder, refused)) for log in _logs_of(path, archives)]
    wrong += refused
    if not logs and not refused:
        raise LogUnreadable(f"{folder}: is a folder without a flight log")
    return logs


def _below(folder: Path, refused: list[AttlogError]) -> Iterator[Path]:
    """Yield visible files of a folder at any depth; unreadable folders into ``refused``."""

    def refuse(error: OSError) -> None:
        if not isinstance(error, FileNotFoundError):  # deleted meanwhile
            refused.append(_cannot_be_read(error))

    for place, folders, files in os.walk(folder, onerror=refuse):
        folders[:] = [name for name in folders if not name.startswith(".")]
        for name in files:
            path = Path(place, name)
            try:
                regular = not name.startswith(".") and stat.S_ISREG(path.stat().st_mode)
            except OSError as error:
                if isinstance(error, FileNotFoundError) and may_be_log(name) and path.is_symlink():
                    refused.append(LogUnreadable(f"{path}: is a link to nothing"))
                refuse(error)
                continue
            if regular:
                yield path


def _unreadable_root(pattern: Path) -> LogUnreadable | None:
    """Return the error of a pattern whose first folder cannot be read."""
    root = next(folder for folder in pattern.parents if not _PATTERN & set(str(folder)))
    try:
        os.scandir(root).close()
    except (FileNotFoundError, NotADirectoryError):
        return None
    except OSError as error:
        return _cannot_be_read(error)
    return None


def _cannot_be_read(error: OSError) -> LogUnreadable:
    return LogUnreadable(f"{error.filename}: cannot be read ({error.strerror})")


def _logs_of(file: Path, archives: bool = True) -> list[Source]:
    """Return the logs of a file found in a folder.

    A broken archive becomes a source that fails when read.
    """
    if archives and is_archive(file):
        from attlog.batch.archive import list_members

        try:
            return [Source(str(file), member) for member in list_members(str(file))]
        except (LogUnreadable, LogUnusable):
            return [Source(str(file))] if file.suffix.lower() == ".zip" else []
    return [Source(str(file))] if is_meant(file) else []


def _of_file(path: Path) -> list[Source]:
    """Return the logs of a named file."""
    if not is_archive(path):
        inside = None if os.path.exists(path) else _in_archive(path)
        return [Source(str(path))] if inside is None else inside
    return _members(str(path))


def _in_archive(path: Path) -> list[Source] | None:
    """Return the members that ``archive.zip/flights/a.ulg`` matches, else None."""
    for archive in path.parents:
        if os.path.isfile(archive):
            return _members(str(archive), path.relative_to(archive).as_posix()) if is_archive(archive) else None
    return None


def _members(place: str, pattern: str = "") -> list[Source]:
    from attlog.batch.archive import count_encrypted, list_members

    found = [Source(place, member) for member in list_members(place, pattern)]
    if not found:
        what = f"no flight log matches {pattern}" if pattern else "is an archive without a flight log"
        if hidden := count_encrypted(place):
            what += (
                f", but {counted(hidden, 'file')} in it cannot be looked at: encrypted, unpack with the password first"
            )
        raise LogUnreadable(f"{without_secrets(place)}: {what}")
    return found


def _behind(url: str) -> list[Source]:
    from attlog.batch.remote import expand_url

    logs: list[Source] = []
    for found in expand_url(url, lambda name: may_be_log(name) or _is_zip(name)):
        logs += _members(found) if _is_zip(found) else [Source(found)]
    return logs


def _is_zip(url: str) -> bool:
    return (urlsplit(url).path if url.lower().startswith("http") else url).lower().endswith(".zip")
