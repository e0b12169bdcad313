"""Bytes of a log: read, map and unpack files; gather, sort and decode records."""

from __future__ import annotations

import errno
import mmap
import os
import zlib
from collections.abc import Callable, Iterator, Sequence
from functools import partial
from pathlib import Path
from typing import Any, BinaryIO

import numpy as np
from numpy.typing import NDArray

from attlog.core import limits
from attlog.core.errors import LogUnreadable, LogUnusable
from attlog.core.limits import MAX_UNPACKED_BYTES, MAX_UNPACKED_RATIO, UNPACKED_ANYWAY_BYTES
from attlog.core.timestamps import Offsets
from attlog.formats.table import Damage

Kinds = NDArray[np.unsignedinteger[Any]]

GZIP_MAGIC = b"\x1f\x8b"
# Bytes of a card that were erased or never written, and how many of them stay before the content: the receiver time of
# a telemetry packet begins with zeros.
ERASED, KEPT_ERASED_BYTES = b"\0\xff", 16
_GZIP_WBITS = 16 + zlib.MAX_WBITS  # zlib's code for "with a gzip header and its checksum"
_PACKED_BLOCK, _UNPACKED_BLOCK = 1 << 16, 1 << 20  # bytes read and returned at a time
_SALVAGE_STEP = 64  # bytes unpacked at a time before a broken place


def read_file_bytes(path: str | Path) -> NDArray[np.uint8]:
    """Read a file into a uint8 array (n,).

    Files larger than :data:`attlog.core.limits.READ_BYTES` are mapped, but only with the environment variable
    :data:`attlog.core.limits.MAPPED`, because truncation of a mapped file kills the process (SIGBUS). LogUnreadable if
    the file cannot be opened or is truncated meanwhile, LogUnusable if it is empty.
    """
    try:
        with open(path, "rb") as file:
            size = os.fstat(file.fileno()).st_size
            if not size or (size > limits.READ_BYTES and os.environ.get(limits.MAPPED)):
                return map_open_file(file, path)
            data = np.fromfile(file, np.uint8, size)
    except OSError as error:
        if error.errno == errno.ENOMEM:
            raise MemoryError from error
        raise LogUnreadable(f"{path}: cannot be read ({error.strerror or error}).") from error
    if len(data) < size:
        raise LogUnreadable(f"{path}: became shorter while it was read; try again when it is whole")
    return data


def map_open_file(file: BinaryIO, path: str | Path) -> NDArray[np.uint8]:
    """Map an open file, which may be closed afterwards; errors name ``path``."""
    if file.seek(0, 2) == 0:
        raise LogUnusable(f"{path}: the file is empty.")
    return np.frombuffer(mmap.mmap(file.fileno(), 0, access=mmap.ACCESS_READ), np.uint8)


# Records.


def offset_type(size: int) -> type[np.int32] | type[np.int64]:
    """Return the narrowest integer for offsets in a file."""
    return np.int32 if size < (1 << 31) - (1 << 16) else np.int64


def gather(data: NDArray[np.uint8], at: Offsets, dtype: np.dtype[Any]) -> NDArray[Any]:
    """Return one value of ``dtype`` from each byte offset.

    (n,), or (n, k) for a sub-array, at any alignment. Offsets must leave room for the value. For values k bytes behind
    each offset pass ``data[k:]``.
    """
    if len(at) == 0:
        return np.zeros((0, *dtype.shape), dtype.base)
    if dtype.itemsize == 1:
        return data.take(at).view(dtype.base).reshape(len(at), *dtype.shape)
    bytewise = np.ndarray((len(data) - dtype.itemsize + 1,), f"V{dtype.itemsize}", buffer=data, strides=(1,))
    return np.ndarray((len(at), *dtype.shape), dtype.base, buffer=bytewise[at])


class RecordColumns:
    """Decoder of one table's columns as views of a single copy.

    ``fetch(offsets)`` returns the records as structured array.
    """

    def __init__(self, fetch: Callable[[Offsets], NDArray[Any]]) -> None:
        self._fetch = fetch
        self.forget()

    def forget(self) -> None:
        """Release the copy."""
        self._offsets: Offsets | None = None
        self._records: NDArray[Any] = np.zeros(0)

    def __call__(self, column: str, offsets: Offsets) -> NDArray[Any]:
        """Return one column at some records; text is cut at its first NUL."""
        if self._offsets is not offsets:
            self._records, self._offsets = self._fetch(offsets), offsets
        values = self._records[column]
        return cut_at_nul(np.ascontiguousarray(values)) if values.dtype.kind == "S" else values


def offsets_by_kind(segments: Sequence[tuple[Offsets, Kinds]]) -> list[tuple[int, Offsets]]:
    """Group records by kind: each kind, ascending, with the offsets of its records.

    ``segments``: offsets (n,) and kinds (n,) of records.
    """
    offsets, kinds = (np.concatenate(parts) for parts in zip(*segments, strict=True))
    order = kinds.argsort(kind="stable")
    offsets, kinds = offsets.take(order), kinds.take(order)
    begins = (kinds[1:] != kinds[:-1]).nonzero()[0] + 1
    return list(zip(kinds[[0, *begins]].tolist(), np.split(offsets, begins), strict=True)) if len(kinds) else []


def cut_at_nul(text: NDArray[np.bytes_]) -> NDArray[np.bytes_]:
    """Clear strings (n,) behind their first NUL byte."""
    width = text.dtype.itemsize
    if len(text) == 0 or width == 0:
        return text
    chars = text.view(np.uint8).reshape(len(text), width).copy()
    chars[np.logical_or.accumulate(chars == 0, axis=1)] = 0
    return chars.view(text.dtype).reshape(len(text))


def decode_texts(column: NDArray[np.bytes_]) -> list[str]:
    """Decode a column (n,) of strings."""
    return [decode_text(raw) for raw in column.tolist()]


def decode_text(raw: bytes) -> str:
    """Decode a logged string as UTF-8, else as Latin-1."""
    raw = raw.split(b"\0", 1)[0]
    try:
        return raw.decode("utf-8")
    except UnicodeDecodeError:
        return raw.decode("latin-1")


# Gzip files (``flight.ulg.gz``) are unpacked once into an anonymous temporary file, which readers map. The system
# removes it when it is not mapped any more.


def is_gzip(path: Path) -> bool:
    """Return whether a file is gzip. OSError if it cannot be opened."""
    with path.open("rb") as file:
        return file.read(len(GZIP_MAGIC)) == GZIP_MAGIC


def first_bytes(path: Path, count: int) -> bytes:
    """Return the first bytes of a log, unpacked. OSError if the file cannot be opened."""
    with path.open("rb") as file:
        return first_bytes_of(file, count)


def first_bytes_of(file: BinaryIO, count: int) -> bytes:
    """Return the first bytes of an open file that can be rewound, unpacked and without leading ERASED bytes."""
    packed = file.read(len(GZIP_MAGIC)) == GZIP_MAGIC
    file.seek(0)
    blocks = GzipContent(file).blocks() if packed else iter(partial(file.read, count), b"")
    head, before = b"", 0
    for block in blocks:
        head += block
        if before < UNPACKED_ANYWAY_BYTES:
            erased = len(head) - len(head.lstrip(ERASED)) - KEPT_ERASED_BYTES
            head, before = head[max(erased, 0) :], before + max(erased, 0)
        if len(head) >= count:
            break
    return head[:count]


def unpacked_bytes(path: Path) -> tuple[NDArray[np.uint8], Damage | None]:
    """Return a log's unpacked bytes, and the damage of a broken gzip file, if any.

    LogUnreadable if the file cannot be opened or the temporary folder cannot hold the log, LogUnusable if nothing or
    too much comes out.
    """
    try:
        packed = is_gzip(path)
    except OSError as error:
        raise LogUnreadable(f"{path}: cannot be read ({error.strerror or error})") from error
    if not packed:
        return read_file_bytes(path), None
    import tempfile  # 3 ms with its imports; few logs are packed

    try:
        unpacked = tempfile.TemporaryFile(prefix="attlog-")
    except OSError as error:
        raise LogUnreadable(f"{path}: no temporary folder to unpack it in ({error.strerror or error})") from error
    with unpacked as file:
        lost = unpack_gzip(path, file)
        return map_open_file(file, path), lost


def unpack_gzip(path: Path, into: BinaryIO) -> Damage | None:
    """Write the content of a gzip file; return its damage, if any. Errors as for :func:`unpacked_bytes`."""
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
    """The content of a gzip file in blocks, up to the first error.

    A file may have several members. ``lost`` is the missing part after the last block, None if the file is whole.
    """

    def __init__(self, file: BinaryIO) -> None:
        self._file = file
        self.lost: str | None = None

    def blocks(self) -> Iterator[bytes]:
        """Yield blocks of bounded size at any compression ratio."""
        inflate, at_start = zlib.decompressobj(_GZIP_WBITS), True
        while packed := self._file.read(_PACKED_BLOCK):
            while packed := packed.lstrip(b"\0") if at_start else packed:
                before = inflate.copy()
                try:
                    block = inflate.decompress(packed, _UNPACKED_BLOCK)
                except zlib.error:
                    yield _up_to_the_error(before, packed)
                    self.lost = (
                        f"{len(packed)} or more bytes behind the compressed log, which are no gzip data"
                        if at_start
                        else "the rest of the log, because its gzip file is damaged"
                    )
                    return
                at_start = False
                yield block
                packed = inflate.unconsumed_tail
                if inflate.eof:  # another member may follow, or zeros that fill the last block of a medium
                    packed = inflate.unused_data
                    inflate, at_start = zlib.decompressobj(_GZIP_WBITS), True
        if not at_start:
            yield inflate.flush()
            self.lost = "the rest of the log, because its gzip file ends early"


def _up_to_the_error(inflate: zlib._Decompress, packed: bytes) -> bytes:
    """Return the bytes that can be unpacked before an error."""
    found = []
    for k in range(0, len(packed), _SALVAGE_STEP):
        try:
            found.append(inflate.decompress(packed[k : k + _SALVAGE_STEP], _UNPACKED_BLOCK))
        except zlib.error:
            break
    return b"".join(found)
