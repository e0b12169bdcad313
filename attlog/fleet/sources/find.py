"""Which logs do files, folders, patterns, archives and URLs mean?"""

from __future__ import annotations

import glob
import os
import stat
from collections.abc import Iterable, Iterator
from pathlib import Path
from urllib.parse import urlsplit

from attlog.base.errors import AttlogError, LogUnreadable, LogUnusable, UsageError
from attlog.fleet.sources.recognition import is_archive, is_meant, may_be_log
from attlog.fleet.sources.remote import is_url, shown
from attlog.fleet.sources.source import Source
from attlog.present.numbers import counted

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
        from attlog.fleet.sources.archive import members

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
    from attlog.fleet.sources.archive import locked, members

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
    from attlog.fleet.sources.remote import meant

    logs: list[Source] = []
    for found in meant(url, lambda name: may_be_log(name) or _is_zip(name)):
        logs += _members(found) if _is_zip(found) else [Source(found)]
    return logs


def _is_zip(url: str) -> bool:
    return (urlsplit(url).path if url.lower().startswith("http") else url).lower().endswith(".zip")
