"""Log formats read as lazy columns; :func:`open` recognises the format by content, not by suffix.

A new format is a folder with recogniser, reader and writer, and one line in :data:`FORMATS`.
"""

from __future__ import annotations

import os
from collections.abc import Callable
from importlib import import_module
from pathlib import Path
from typing import TYPE_CHECKING, Any, BinaryIO, NamedTuple

import numpy as np
from numpy.typing import NDArray

from attlog.core.errors import LogUnreadable, NotALog, UsageError, missing_file
from attlog.formats.recording import MessageLayout, Recording
from attlog.formats.table import Boot, Damage, Field, Messages, ParamChange, Table, Text

if TYPE_CHECKING:
    from attlog.core.own_files import FileKind

__all__ = [
    "FORMATS",
    "Boot",
    "Damage",
    "Field",
    "MessageLayout",
    "Messages",
    "ParamChange",
    "Recording",
    "Table",
    "Text",
    "format_for",
    "format_named",
    "open",
    "recognise",
    "recognise_bytes",
    "write",
]

# Bytes that suffice to recognise every format, also behind a damaged start.
MAX_HEAD_BYTES = 1 << 16


class Format(NamedTuple):
    """Log format with the functions that recognise, read and write it.

    Functions are given as ``module.name`` in the format's ``folder`` and imported on use. ``name`` is
    ``Messages.format``; ``title`` and ``suffix`` are for display. ``recogniser(head) -> bool`` tests the first bytes;
    ``reader(path, *, data) -> Messages`` has a further argument ``system`` with ``several_vehicles``;
    ``writer(path, recording)`` is empty for read-only formats.
    """

    name: str
    title: str
    suffix: str
    folder: str
    recogniser: str
    reader: str
    writer: str = ""
    several_vehicles: bool = False

    @property
    def for_people(self) -> str:
        """Title and suffix for display."""
        return f"{self.title} {self.suffix}"

    def recognises(self, head: bytes) -> bool:
        """Return whether a file with these first bytes has this format."""
        return bool(self._load(self.recogniser)(head))

    def read(self, path: Path, data: NDArray[np.uint8], system: int | None = None) -> Messages:
        """Read the log with the bytes ``data``; formats of one vehicle ignore ``system``."""
        read: Callable[..., Messages] = self._load(self.reader)
        return read(path, system=system, data=data) if self.several_vehicles else read(path, data=data)

    def write(self, path: Path, recording: Recording, kind: FileKind | None = None) -> None:
        """Write the log; it replaces a file of this kind, by default a simulated log.

        UsageError for what the format cannot hold, and for formats that are only read.
        """
        if not self.writer:
            raise UsageError(f"{path}: attlog reads {self.title} logs and does not write them")
        self._load(self.writer)(path, recording, *([kind] if kind else []))

    def _load(self, place: str) -> Any:
        module, _, name = place.partition(".")
        return getattr(import_module(f"attlog.formats.{self.folder}.{module}"), name)


# The first format that recognises a file reads it.
FORMATS = (
    Format("ulog", "ULog", ".ulg", "ulog", "layout.is_ulog", "reader.read_ulog", "writer.write_ulog"),
    Format(
        "dataflash",
        "DataFlash",
        ".bin",
        "dataflash",
        "layout.is_dataflash",
        "reader.read_binary",
        "writer.write_dataflash",
    ),
    Format("dataflash_text", "DataFlash text", ".log", "dataflash", "layout.is_dataflash_text", "reader.read_text"),
    Format("ros", "ROS 2 bag", ".mcap", "ros", "bag.is_bag", "reader.read_ros", "writer.write_mcap", True),
    Format("tlog", "MAVLink", ".tlog", "mavlink", "layout.is_tlog", "reader.read_mavlink", "writer.write_tlog", True),
    Format("mavlink", "raw MAVLink", ".mavlink", "mavlink", "layout.is_capture", "reader.read_mavlink", "", True),
)

_UNPACK_TEXT = "archive, not a log: unpack it"
_UTF_16_TEXT = "text in UTF-16, as some editors save it, and no log as it was written: save it as UTF-8"
# First bytes of files that may hold a log, and what to do with them.
WRAPPERS = (
    (b"\xff\xfe", _UTF_16_TEXT),
    (b"\xfe\xff", _UTF_16_TEXT),
    (b"PK\x03\x04", f"a zip {_UNPACK_TEXT}; analyze and batch read the logs in it"),
    (b"7z\xbc\xaf\x27\x1c", f"a 7z {_UNPACK_TEXT}"),
    (b"Rar!\x1a\x07", f"a rar {_UNPACK_TEXT}"),
    (b"\xfd7zXZ\x00", f"an xz {_UNPACK_TEXT}"),
    (b"BZh", f"a bzip2 {_UNPACK_TEXT}"),
    (b"\x28\xb5\x2f\xfd", f"a zstd {_UNPACK_TEXT}"),
    (b"\x1f\x8b", f"a gzip {_UNPACK_TEXT}"),
    (b"#ROSBAG V", "a bag of ROS 1: convert it with rosbags-convert (pip install rosbags) to ROS 2"),
)


def open(path: Path | str, system: int | None = None, *, key: Path | str | None = None) -> Messages:
    """Open a log of any format; a gzip file is unpacked first.

    ``system``: number of the vehicle, in formats that can hold several. ``key``: private key file of an encrypted log,
    by default from the environment variable ATTLOG_KEY. LogUnreadable: missing, a folder, no permission. NotALog:
    empty or of another format. LogUnusable: cannot be read (encrypted, newer), or too large when unpacked.
    """
    from attlog.formats.file_bytes import unpacked_bytes
    from attlog.formats.ulog.encrypted import using_key

    path = Path(path)
    entry = format_named(recognise(path))
    data, lost = unpacked_bytes(path)
    with using_key(key):
        messages = entry.read(path, data, system)
    if lost is not None:
        messages.losses.add_cause(lost)
    return messages


def recognise(path: Path | str) -> str:
    """Return a file's format as in ``Messages.format``; LogUnreadable and NotALog as for :func:`open`."""
    from attlog.formats.file_bytes import ERASED

    path = Path(path)
    head = _head(path)
    if not head:
        raise NotALog(f"{path}: the file is empty")
    if name := _format_of(head):
        return name
    if not head.strip(ERASED):
        raise NotALog(f"{path}: the file holds only erased bytes (zeros or 0xff); copy it from the card again")
    for begin, what in WRAPPERS:
        if head.startswith(begin):
            raise NotALog(f"{path}: {what}")
    raise NotALog(f"{path}: not a flight log that attlog knows ({', '.join(f.for_people for f in FORMATS)})")


def recognise_bytes(file: BinaryIO) -> str:
    """Return the format of an open file, also of a gzip file; empty if unknown."""
    from attlog.formats.file_bytes import first_bytes_of

    return _format_of(first_bytes_of(file, MAX_HEAD_BYTES))


def _format_of(head: bytes) -> str:
    return next((entry.name for entry in FORMATS if head and entry.recognises(head)), "")


def _head(path: Path) -> bytes:
    """Return the first bytes of the log, unpacked."""
    from attlog.formats.file_bytes import first_bytes

    if os.path.isdir(path):
        raise LogUnreadable(f"{path}: is a folder, not a log; name the files in it")
    if os.path.exists(path) and not os.path.isfile(path):
        raise LogUnreadable(f"{path}: is no regular file; logs are memory-mapped, so save it to a file first")
    try:
        if not os.path.getsize(path):  # files in /proc have no size, and some block a reader for ever
            return b""
        return first_bytes(path, MAX_HEAD_BYTES)
    except FileNotFoundError:
        raise LogUnreadable(f"{path}: {missing_file(str(path))}") from None
    except (OSError, ValueError) as error:
        raise LogUnreadable(f"{path}: cannot be read ({getattr(error, 'strerror', None) or error})") from error


def write(path: Path | str, recording: Recording, *, replace: bool = False) -> None:
    """Write a log in the format of the path's suffix.

    ``.ulg``, ``.bin``, ``.tlog`` or ``.mcap``, whole or not at all. UsageError for another suffix and for what the
    format cannot hold, OutputError if the file cannot be written. The same recording gives the same bytes. An existing
    file is replaced if it has these bytes or is a simulated log; any with ``replace``.
    """
    from attlog.core.own_files import ANY_FILE

    format_for(path).write(Path(path), recording, ANY_FILE if replace else None)


def format_for(path: Path | str) -> Format:
    """Return the format of a path's suffix. UsageError without one."""
    suffix = Path(path).suffix.lower()
    for entry in FORMATS:
        if entry.writer and entry.suffix == suffix:
            return entry
    known = ", ".join(entry.for_people for entry in FORMATS if entry.writer)
    raise UsageError(f"{path}: the suffix of a written log chooses its format, and it is none of {known}")


def format_named(name: str) -> Format:
    """Return a format by name. KeyError without one."""
    return {entry.name: entry for entry in FORMATS}[name]
