"""Logs inside gzip files (``flight.ulg.gz``), unpacked once into an anonymous temporary file.

The readers map a log's bytes, so a compressed one needs a place for them: the
temporary folder, from which the system removes the file as soon as nobody maps
it. What a stranger's file may unpack to is limited (``attlog.base.limits``).
"""

from __future__ import annotations

import zlib
from collections.abc import Iterator
from pathlib import Path
from typing import BinaryIO

import numpy as np
from numpy.typing import NDArray

from attlog.base.errors import LogUnreadable, LogUnusable
from attlog.base.limits import MAX_UNPACKED_BYTES, MAX_UNPACKED_RATIO, UNPACKED_ANYWAY_BYTES
from attlog.formats.base import Damage
from attlog.formats.mapping import map_bytes, map_open_file

MAGIC = b"\x1f\x8b"
_GZIP = 16 + zlib.MAX_WBITS  # zlib's word for "with a gzip header and its checksum"
_PACKED, _UNPACKED = 1 << 16, 1 << 20  # bytes taken in and given out at a time
_BITE = 64  # bytes at a time where something before is broken


def is_gzip(path: Path) -> bool:
    """Whether a file begins as gzip files do. OSError if it cannot be opened."""
    with path.open("rb") as file:
        return file.read(len(MAGIC)) == MAGIC


def first_bytes(path: Path, count: int) -> bytes:
    """The first bytes of a log, unpacked if need be. OSError if the file cannot be opened."""
    with path.open("rb") as file:
        return first_bytes_of(file, count)


def first_bytes_of(file: BinaryIO, count: int) -> bytes:
    """As :func:`first_bytes` of an open file that can be rewound."""
    head = file.read(count)
    if not head.startswith(MAGIC):
        return head
    file.seek(0)
    head = b""
    for block in GzipContent(file).blocks():
        head += block
        if len(head) >= count:
            break
    return head[:count]


def content(path: Path) -> tuple[NDArray[np.uint8], Damage | None]:
    """The bytes of a log as uint8 array (n,), unpacked if need be, and what a broken gzip file lost of them.

    LogUnreadable if the file cannot be opened or the temporary folder cannot hold
    the log, LogUnusable if nothing or too much comes out.
    """
    try:
        packed = is_gzip(path)
    except OSError as error:
        raise LogUnreadable(f"{path}: cannot be read ({error.strerror or error})") from error
    if not packed:
        return map_bytes(path), None
    import tempfile  # with random, 3 ms: nearly no log is packed

    try:
        unpacked = tempfile.TemporaryFile(prefix="attlog-")
    except OSError as error:
        raise LogUnreadable(f"{path}: no temporary folder to unpack it in ({error.strerror or error})") from error
    with unpacked as file:
        lost = unpack(path, file)
        return map_open_file(file, path), lost


def unpack(path: Path, into: BinaryIO) -> Damage | None:
    """Write what a gzip file holds; the place where it breaks off, None if it is whole. Errors as :func:`content`."""
    written = 0
    try:
        limit = min(MAX_UNPACKED_BYTES, max(UNPACKED_ANYWAY_BYTES, MAX_UNPACKED_RATIO * path.stat().st_size))
        with path.open("rb") as file:
            unpacking = GzipContent(file)
            for block in unpacking.blocks():
                written += len(block)
                if written > limit:
                    raise LogUnusable(f"{path}: unpacks to more than {limit >> 20} MB; no flight log does that")
                into.write(block)
        into.flush()
    except OSError as error:
        raise LogUnreadable(f"{path}: cannot be unpacked ({error.strerror or error})") from error
    if unpacking.lost is None:
        return None
    return Damage(written, 0, unpacking.lost, "nowhere, nothing behind it can be unpacked")


class GzipContent:
    """The content of a gzip file (one or more members) block by block, as far as it is sound.

    ``lost`` says after the last block what is missing, None if nothing is.
    """

    def __init__(self, file: BinaryIO) -> None:
        self._file = file
        self.lost: str | None = None

    def blocks(self) -> Iterator[bytes]:
        """Blocks of bounded size, however much a byte of the file stands for."""
        inflate, at_start = zlib.decompressobj(_GZIP), True
        while packed := self._file.read(_PACKED):
            while packed := packed.lstrip(b"\0") if at_start else packed:
                before = inflate.copy()
                try:
                    block = inflate.decompress(packed, _UNPACKED)
                except zlib.error as error:
                    yield _up_to_the_error(before, packed)
                    self.lost = (
                        f"{len(packed)} or more bytes behind the compressed log, which are no gzip data"
                        if at_start
                        else f"the rest of the log, because its gzip file is damaged ({_reason(error)})"
                    )
                    return
                at_start = False
                yield block
                packed = inflate.unconsumed_tail
                if inflate.eof:  # another member may follow, or zeros that fill the last block of a medium
                    packed = inflate.unused_data
                    inflate, at_start = zlib.decompressobj(_GZIP), True
        if not at_start:
            yield inflate.flush()
            self.lost = "the rest of the log, because its gzip file ends early"


def _up_to_the_error(inflate: zlib._Decompress, packed: bytes) -> bytes:
    """What comes out of the bytes before the broken place; zlib gives nothing back from a call that fails."""
    found = []
    for k in range(0, len(packed), _BITE):
        try:
            found.append(inflate.decompress(packed[k : k + _BITE], _UNPACKED))
        except zlib.error:
            break
    return b"".join(found)


def _reason(error: zlib.error) -> str:
    """zlib's own words without its numbers: "Error -3 while decompressing data: incorrect data check"."""
    return str(error).rpartition(": ")[2]
