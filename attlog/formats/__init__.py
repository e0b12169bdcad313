"""Flight logs as lazy columns: ``open`` tells the formats apart by content, never by suffix.

A new format is a folder with reader, writer and recogniser, and one line in :data:`FORMATS`.
"""

from __future__ import annotations

import os
from collections.abc import Callable
from dataclasses import dataclass
from importlib import import_module
from pathlib import Path
from typing import Any, BinaryIO

import numpy as np
from numpy.typing import NDArray

from attlog.core.errors import LogUnreadable, NotALog, UsageError
from attlog.formats.recording import MessageLayout, Recording
from attlog.formats.table import Boot, Damage, Field, Messages, ParamChange, Table, Text

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


# One entry per log format: how it is recognised, read, written and checked, loaded when it is needed.


@dataclass(frozen=True, slots=True)
class Format:
    """A log format. Recogniser, reader and writer name places below ``attlog.formats`` as ``module:name``.

    ``name`` is ``Messages.format``; ``title`` and ``suffix`` are what messages say (files are told apart by content
    when they are read, by suffix when they are written). ``recogniser(head) -> bool`` judges the first bytes;
    ``reader(path, *, data) -> Messages`` decodes; ``writer(path, recording)`` takes a
    :class:`attlog.formats.recording.Recording` and is None for formats that are only read.
    ``several_vehicles``: the reader takes ``system`` too.
    """

    name: str
    title: str
    suffix: str
    recogniser: str
    reader: str
    writer: str | None
    several_vehicles: bool = False

    @property
    def for_people(self) -> str:
        """Title and suffix."""
        return f"{self.title} {self.suffix}"

    def recognises(self, head: bytes) -> bool:
        """Whether a file that begins with these bytes is such a log."""
        return bool(_load_by_name(self.recogniser)(head))

    def read(self, path: Path, data: NDArray[np.uint8], system: int | None = None) -> Messages:
        """The log whose bytes are ``data``; ``system`` means nothing to a format of one vehicle."""
        read: Callable[..., Messages] = _load_by_name(self.reader)
        return read(path, system=system, data=data) if self.several_vehicles else read(path, data=data)

    def write(self, path: Path, recording: Recording) -> None:
        """Write the log; UsageError for what the format cannot hold, and where attlog has no writer for it."""
        if self.writer is None:
            raise UsageError(f"{path}: attlog reads {self.title} logs and does not write them")
        _load_by_name(self.writer)(path, recording)


def _load_by_name(place: str) -> Any:
    module, _, name = place.partition(":")
    return getattr(import_module(f"attlog.formats.{module}"), name)


# Bytes that are enough to recognise every format, also behind a damaged start.
MAX_HEAD_BYTES = 1 << 16

# name, title, suffix, recogniser, reader, writer; the first that recognises a file reads it
FORMATS = (
    Format("ulog", "ULog", ".ulg", "ulog.layout:is_ulog", "ulog.reader:read_ulog", "ulog.writer:write_ulog"),
    Format(
        "dataflash",
        "DataFlash",
        ".bin",
        "dataflash.walk:is_dataflash",
        "dataflash.reader:read_binary",
        "dataflash.writer:write_dataflash",
    ),
    Format(
        "dataflash_text",
        "DataFlash text",
        ".log",
        "dataflash.walk:is_dataflash_text",
        "dataflash.reader:read_text",
        None,
    ),
    Format(
        "ros",
        "ROS 2 bag",
        ".mcap",
        "ros.bag:is_bag",
        "ros.reader:read_ros",
        "ros.writer:write_mcap",
        several_vehicles=True,
    ),
    Format(
        "tlog",
        "MAVLink",
        ".tlog",
        "mavlink.walk:is_tlog",
        "mavlink.reader:read_mavlink",
        "mavlink.writer:write_tlog",
        several_vehicles=True,
    ),
    Format(
        "mavlink",
        "raw MAVLink",
        ".mavlink",
        "mavlink.walk:is_capture",
        "mavlink.reader:read_mavlink",
        None,
        several_vehicles=True,
    ),
)


def open(path: Path | str, system: int | None = None, *, key: Path | str | None = None) -> Messages:
    """The log as :class:`Messages`, whatever its format; a gzip file is unpacked first.

    ``system``: the MAVLink vehicle whose parameters, texts and boots are wanted, in formats that can hold several;
    the others hold one vehicle and take no notice. ``key``: the file of the private key that opens an encrypted log,
    None: that of the variable ATTLOG_KEY. LogUnreadable: missing, a folder, no permission. NotALog: empty
    or none of the formats. LogUnusable: a format that cannot be read (encrypted, newer), or a file that unpacks to
    more than any log.
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


_UNPACK_TEXT = "archive, not a log: unpack it"
# How a file begins that may hold a log, and what is to be done with it.
WRAPPERS = (
    (b"\xff\xfe", "text in UTF-16, as some editors save it, and no log as it was written: save it as UTF-8"),
    (b"\xfe\xff", "text in UTF-16, as some editors save it, and no log as it was written: save it as UTF-8"),
    (b"PK\x03\x04", f"a zip {_UNPACK_TEXT}; analyze and batch read the logs in it"),
    (b"7z\xbc\xaf\x27\x1c", f"a 7z {_UNPACK_TEXT}"),
    (b"Rar!\x1a\x07", f"a rar {_UNPACK_TEXT}"),
    (b"\xfd7zXZ\x00", f"an xz {_UNPACK_TEXT}"),
    (b"BZh", f"a bzip2 {_UNPACK_TEXT}"),
    (b"\x28\xb5\x2f\xfd", f"a zstd {_UNPACK_TEXT}"),
    (b"\x1f\x8b", f"a gzip {_UNPACK_TEXT}"),
    (b"#ROSBAG V", "a bag of ROS 1: convert it with rosbags-convert (pip install rosbags) to ROS 2"),
)


def recognise(path: Path | str) -> str:
    """The format's name as in ``Messages.format``; LogUnreadable and NotALog like :func:`open`."""
    path = Path(path)
    head = _head(path)
    if not head:
        raise NotALog(f"{path}: the file is empty")
    if name := _format_of(head):
        return name
    for begin, what in WRAPPERS:
        if head.startswith(begin):
            raise NotALog(f"{path}: {what}")
    raise NotALog(f"{path}: not a flight log that attlog knows ({', '.join(f.for_people for f in FORMATS)})")


def recognise_bytes(file: BinaryIO) -> str:
    """The format's name of an open file or of the first :data:`HEAD` bytes of one, packed or not; empty if none."""
    from attlog.formats.file_bytes import first_bytes_of

    return _format_of(first_bytes_of(file, MAX_HEAD_BYTES))


def write(path: Path | str, recording: Recording) -> None:
    """Write a log in the format of the path's suffix (``.ulg``, ``.bin``, ``.tlog``, ``.mcap``), whole or not at all.

    UsageError for another suffix and for what the format cannot hold, OutputError if the file cannot be written.
    The same recording gives the same bytes.
    """
    format_for(path).write(Path(path), recording)


def format_for(path: Path | str) -> Format:
    """The format that a path's suffix asks for when a log is written. UsageError if there is none."""
    suffix = Path(path).suffix.lower()
    for entry in FORMATS:
        if entry.writer is not None and entry.suffix == suffix:
            return entry
    known = ", ".join(entry.for_people for entry in FORMATS if entry.writer is not None)
    raise UsageError(f"{path}: the suffix tells the format of a log that is written, and it is none of {known}")


def format_named(name: str) -> Format:
    """The entry of a format. KeyError if there is none."""
    return {entry.name: entry for entry in FORMATS}[name]


def _format_of(head: bytes) -> str:
    return next((entry.name for entry in FORMATS if head and entry.recognises(head)), "")


def _head(path: Path) -> bytes:
    """The first bytes of the log, behind any compression."""
    from attlog.formats.file_bytes import first_bytes

    if os.path.isdir(path):
        raise LogUnreadable(f"{path}: is a folder, not a log; name the files in it")
    if os.path.exists(path) and not os.path.isfile(path):
        raise LogUnreadable(f"{path}: is no regular file; logs are memory-mapped, so save it to a file first")
    try:
        if not os.path.getsize(path):  # the system's own files have no size, and some wait for ever when they are read
            return b""
        return first_bytes(path, MAX_HEAD_BYTES)
    except FileNotFoundError:
        raise LogUnreadable(f"{path}: no such file") from None
    except (OSError, ValueError) as error:
        raise LogUnreadable(f"{path}: cannot be read ({getattr(error, 'strerror', None) or error})") from error
