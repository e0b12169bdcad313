"""Where a log comes from, as a small value that travels: a file, a member of a zip archive, a URL."""

from __future__ import annotations

import re
import shutil
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from urllib.parse import unquote, urlsplit

from attlog import formats
from attlog.base import limits
from attlog.base.errors import AttlogError, LogUnreadable, NotALog
from attlog.base.files.file_names import file_name
from attlog.base.limits import MAX_FILE_NAME_BYTES
from attlog.fleet.sources.log_file import hashed, unreadable
from attlog.fleet.sources.remote import is_url, shown


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
            from attlog.fleet.sources.archive import member_stamp

            return member_stamp(self.place, self.member)
        if is_url(self.place):
            from attlog.fleet.sources.remote import url_stamp

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
                from attlog.fleet.sources.archive import extract

                told = extract(self.place, self.member, path)
            else:
                from attlog.fleet.sources.remote import download

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
