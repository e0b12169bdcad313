"""Flight logs as lazy columns: ``open`` tells the formats apart by content, never by suffix."""

from __future__ import annotations

from pathlib import Path

from attlog.errors import LogUnreadable, LogUnusable, NotALog
from attlog.formats.base import Boot, Damage, Field, Messages, ParamChange, Table, Text

__all__ = ["Boot", "Damage", "Field", "Messages", "ParamChange", "Table", "Text", "open", "recognise"]

HEAD = 1 << 16
"""Bytes that are enough to recognise every format, also behind a damaged start."""


def open(path: Path | str) -> Messages:
    """The log as :class:`Messages`, whatever its format.

    LogUnreadable: missing, a folder, no permission. NotALog: empty or none of the
    formats. LogUnusable: a format that cannot be read (encrypted, newer).
    """
    path = Path(path)
    match recognise(path):
        case "ulog":
            from attlog.formats.ulog import reader

            return reader.read(path)
        case "dataflash":
            from attlog.formats.dataflash import reader

            return reader.read(path)
        case "px4log":
            from attlog.formats import sdlog2

            return sdlog2.read(path)
        case "dataflash_text":
            from attlog.formats.dataflash import text

            return text.read(path)
        case _:
            from attlog.formats.mavlink import reader

            return reader.read(path)


def recognise(path: Path | str) -> str:
    """The format's name as in ``Messages.format``; raises like :func:`open`."""
    from attlog.formats.detect import format_of

    path = Path(path)
    head, size = _head(path)
    if size == 0:
        raise NotALog(f"{path}: the file is empty")
    if head.startswith(b"ULogEnc"):
        raise LogUnusable(f"{path}: this ULog is encrypted; decrypt it with the key of the vehicle first")
    found = format_of(head)
    if found is None:
        raise NotALog(f"{path}: not a flight log that attlog knows (ULog, DataFlash .bin or .log, tlog, px4log)")
    return found


def _head(path: Path) -> tuple[bytes, int]:
    if path.is_dir():
        raise LogUnreadable(f"{path}: is a folder, not a log; name the files in it")
    if path.exists() and not path.is_file():
        raise LogUnreadable(f"{path}: is no regular file; logs are memory-mapped, so save it to a file first")
    try:
        with path.open("rb") as file:
            return file.read(HEAD), path.stat().st_size
    except FileNotFoundError:
        raise LogUnreadable(f"{path}: no such file") from None
    except (OSError, ValueError) as error:
        raise LogUnreadable(f"{path}: cannot be read ({getattr(error, 'strerror', None) or error})") from error
