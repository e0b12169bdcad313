"""Where a log comes from, as a small value that travels: a file, a member of a zip archive, a URL."""

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
from attlog.batch.log_file import hashed, is_archive, is_meant, may_be_log, unreadable
from attlog.batch.remote import is_url, shown
from attlog.core import limits
from attlog.core.errors import AttlogError, LogUnreadable, LogUnusable, NotALog, UsageError
from attlog.core.files import file_name
from attlog.core.limits import MAX_FILE_NAME_BYTES
from attlog.words.numbers import counted


@dataclass(frozen=True)
class Local:
    """A log's bytes as a file on this machine; ``copied``: their SHA-256 and how many, where they were copied there."""

    path: Path
    copied: tuple[str, int] | None = None

    @cached_property
    def sha256(self) -> str:
        """Their SHA-256 (hex). LogUnreadable where the file cannot be read."""
        return self.copied[0] if self.copied is not None else hashed(self.path)


@dataclass(frozen=True, slots=True, order=True)
class Source:
    """A log by its place: path or URL, and the member where that is a zip archive. Pickles to a few bytes.

    ``copy``: a file with its bytes, on a machine that cannot reach the place.
    """

    place: str
    member: str = ""
    copy: str = ""

    @property
    def name(self) -> str:
        """What people read and what stays the same between runs: ``archive.zip/flights/a.ulg``, ``s3://...``.

        Names and passwords of users and signatures in a URL are left out.
        """
        place = shown(self.place)
        return _printable(f"{place}/{self.member}" if self.member else place)

    @property
    def file_name(self) -> str:
        """A name for files made of this log: its last part alone, harmless whatever a stranger called it."""
        if not self.member and not is_url(self.place):
            return Path(self.place).name
        if self.member:
            last = re.split(r"[/\\]", self.member)[-1]
        else:
            url = urlsplit(shown(self.place))
            last = unquote(url.path.rstrip("/").rpartition("/")[2] or url.netloc)
            last += f"_{unquote(url.query)}" if url.query else ""
        return file_name(last, MAX_FILE_NAME_BYTES) if last else "log"

    def stamp(self) -> str:
        """A cheap sign of the content that changes when it is replaced, empty where nothing tells.

        Size and time of a file, checksum of a member, what the server says of a URL; nothing is
        downloaded. LogUnreadable if the place cannot be asked.
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
        """The log as a file on the machine that asks, for as long as the context lasts.

        A file is used where it lies. A member or a URL is copied whole to a folder of its own in
        ``scratch`` (the system's temporary folder by default), which is removed at the end, also
        after an error. LogUnreadable: missing, refused, cut short, timed out, or no room for it.
        LogUnusable: an encrypted or damaged member, or more bytes than a log can have. What goes wrong
        with the file inside the context is told under the log's name, not under that of the copy.
        """
        if self.copy or not (self.member or is_url(self.place)):
            path = Path(self.copy or self.place)
            with self._named(path):
                _worth_reading(path)
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
                from attlog.batch.archive import extract

                told = extract(self.place, self.member, path)
            else:
                from attlog.batch.remote import download

                told = download(self.place, path)
            with self._named(path):
                yield Local(path, told)
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
    """Without control characters: a member's name is a stranger's text on the user's terminal."""
    return "".join(c if c.isprintable() or "\ud800" <= c <= "\udfff" else "?" for c in text)


def _worth_reading(path: Path) -> None:
    """NotALog for a large file that is none, before all of it is read: a disk's image takes hours.

    A small one is read for its hash, by which a batch that goes on knows that it was tried.
    """
    try:
        formats.recognise(path)
    except NotALog:
        if path.stat().st_size > limits.READ_BYTES:
            raise


# Which logs do files, folders, patterns, archives and URLs mean?

_PATTERN = frozenset("*?[")


def find(given: Iterable[Path]) -> tuple[list[Path], list[AttlogError]]:
    """The logs that were named and lie as files on this machine, each once, and what is wrong with the names.

    As :func:`sources`, for commands that work on files: an archive is a file like another.
    """
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
    """UsageError for a URL, of which a path has lost a slash."""
    url = str(path).replace(":/", "://", 1)
    if is_url(url) and not os.path.lexists(path):
        raise UsageError(
            f"{shown(url)}: is a URL, and this command reads files: download it first; analyze and batch read URLs"
        )


def sources(given: Iterable[str | Path]) -> tuple[list[Source], list[AttlogError]]:
    """The logs that were named, each once, and what is wrong with the names.

    A file is taken as it is, also where it does not exist: reading it says so. A folder
    stands for the logs in it at any depth (what is hidden left out), a pattern that no
    file bears as its name for the logs that it matches (``**`` reaches into folders),
    a zip archive for the logs in it, ``archive.zip/a.ulg`` or ``archive.zip/*.ulg`` for
    those members; there logs are known by their content, also in gzip files. A URL is one
    log, an archive, a folder (``s3://bucket/flights``; ``https://host/flights/``) or a
    pattern where the place can be listed; there logs are known by their names. What
    means no log is a LogUnreadable, ``-`` a UsageError.
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
    """The logs that a name means; what cannot be read below it goes to ``wrong`` and hides no other log."""
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
    """The logs in a folder; LogUnreadable if there are none and nothing else is wrong."""
    refused: list[AttlogError] = []
    logs = [log for path in sorted(_below(folder, refused)) for log in _logs_of(path, archives)]
    wrong += refused
    if not logs and not refused:
        raise LogUnreadable(f"{folder}: is a folder without a flight log")
    return logs


def _below(folder: Path, refused: list[AttlogError]) -> Iterator[Path]:
    """The files in a folder at any depth but hidden ones; folders that cannot be read are ``refused``."""

    def refuse(error: OSError) -> None:
        if not isinstance(error, FileNotFoundError):  # gone meanwhile
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
    """Why nothing can match: the folder in which a pattern begins cannot be read."""
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
    """What a file that was not named itself stands for. A broken archive is one source, which tells so when read."""
    if archives and is_archive(file):
        from attlog.batch.archive import members

        try:
            return [Source(str(file), member) for member in members(str(file))]
        except (LogUnreadable, LogUnusable):
            return [Source(str(file))] if file.suffix.lower() == ".zip" else []
    return [Source(str(file))] if is_meant(file) else []


def _of_file(path: Path) -> list[Source]:
    """What the name of a file stands for."""
    if not is_archive(path):
        inside = None if os.path.exists(path) else _in_archive(path)
        return [Source(str(path))] if inside is None else inside
    return _members(str(path))


def _in_archive(path: Path) -> list[Source] | None:
    """The members that ``archive.zip/flights/a.ulg`` means, None where no part of the path is an archive."""
    for archive in path.parents:
        if os.path.isfile(archive):
            return _members(str(archive), path.relative_to(archive).as_posix()) if is_archive(archive) else None
    return None


def _members(place: str, pattern: str = "") -> list[Source]:
    from attlog.batch.archive import locked, members

    found = [Source(place, member) for member in members(place, pattern)]
    if not found:
        what = f"no flight log matches {pattern}" if pattern else "is an archive without a flight log"
        if hidden := locked(place):
            what += (
                f", but {counted(hidden, 'file')} in it cannot be looked at: encrypted, unpack with the password first"
            )
        raise LogUnreadable(f"{shown(place)}: {what}")
    return found


def _behind(url: str) -> list[Source]:
    from attlog.batch.remote import meant

    logs: list[Source] = []
    for found in meant(url, lambda name: may_be_log(name) or _is_zip(name)):
        logs += _members(found) if _is_zip(found) else [Source(found)]
    return logs


def _is_zip(url: str) -> bool:
    return (urlsplit(url).path if url.lower().startswith("http") else url).lower().endswith(".zip")
