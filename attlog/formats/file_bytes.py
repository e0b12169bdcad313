"""A reader's loop as machine code, only where that pays: where its object code is at hand, or the compiler is loaded.

Importing numba and compiling cost more than a compiled loop saves on one log.
"""

from __future__ import annotations

import errno
import functools
import mmap
import os
import sys
import zlib
from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import Annotated, Any, BinaryIO

import numpy as np
from numpy.typing import NDArray

from attlog.core import jit, limits
from attlog.core.errors import LogUnreadable, LogUnusable
from attlog.core.jit import Cells, IOut1, Loop
from attlog.core.limits import MAX_UNPACKED_BYTES, MAX_UNPACKED_RATIO, UNPACKED_ANYWAY_BYTES
from attlog.core.timestamps import Offsets
from attlog.formats.table import Damage

MIN_LOADED_BYTES = 1 << 18
"""Bytes from which a compiled loop is worth being asked for, in a process that has loaded compiled code already."""


# Arrays that the readers' loops read, and those that they write.
U8 = Annotated[NDArray[np.uint8], Cells("u1", 1)]
U16 = Annotated[NDArray[np.uint16], Cells("u2", 1)]
U16Table = Annotated[NDArray[np.uint16], Cells("u2", 2)]
I16 = Annotated[NDArray[np.int16], Cells("i2", 1)]
I32 = Annotated[NDArray[np.int32], Cells("i4", 1)]
U8Out = Annotated[NDArray[np.uint8], Cells("u1", 1, True)]
U16Out = Annotated[NDArray[np.uint16], Cells("u2", 1, True)]
I16Out = Annotated[NDArray[np.int16], Cells("i2", 1, True)]
I32Out = Annotated[NDArray[np.int32], Cells("i4", 1, True)]


@functools.cache
def compiled_if_cheap(loop: Loop[..., Any]) -> Callable[..., Any] | None:
    """Return the compiled loop; None where it would have to be compiled by a process that has no compiler loaded."""
    from attlog.core.jit.compile import at_hand  # short logs are read without

    if not jit.jit_wanted():
        return None
    return at_hand(loop) or (loop.compiled() if "numba" in sys.modules else None)


def is_compiled_loaded(size: int) -> bool:
    """Whether compiled code is loaded already, and so many bytes are worth a compiled loop."""
    return size >= MIN_LOADED_BYTES and "llvmlite" in sys.modules


def is_compiled_worthwhile(reader: str, size: int, alone: int) -> bool:
    """Whether a log of so many bytes is worth compiled loops.

    Loading code is, from ``alone`` bytes on; logs that were read without it before count as well, since a process that
    read so many will read more. So reading never costs much more than twice what it would have cost either way.
    """
    if size < MIN_LOADED_BYTES or "llvmlite" in sys.modules:
        return size >= MIN_LOADED_BYTES
    without = _bytes_read_uncompiled()
    without[reader] += size
    return without[reader] >= alone


@functools.cache
def _bytes_read_uncompiled() -> Counter[str]:
    """Bytes of logs that this process was asked for while it had no compiled code, by reader."""
    return Counter()


# The bytes of a file as a read-only array that the system pages in on demand, and records copied out of it.


def read_file_bytes(path: str | Path) -> NDArray[np.uint8]:
    """The content of a file as uint8 array (n,), read into memory; reading costs some 0.3 ms per MB.

    A file that is cut while it is mapped ends the process that reads on (SIGBUS), which no handler in Python can
    prevent. So only a process that another one watches maps files larger than :data:`attlog.core.limits.READ_BYTES`,
    or one that asks for it by the environment's :data:`attlog.core.limits.MAPPED`. LogUnreadable if the file cannot be
    opened or is cut while it is read, LogUnusable if it is empty.
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
    """The content of an open file, as uint8 (n,), which may be closed afterwards; ``path`` is what errors call it."""
    if file.seek(0, 2) == 0:
        raise LogUnusable(f"{path}: the file is empty.")
    return np.frombuffer(mmap.mmap(file.fileno(), 0, access=mmap.ACCESS_READ), np.uint8)


def offset_type(size: int) -> type[np.int32] | type[np.int64]:
    """The narrowest integer for places in a file of ``size`` bytes and the ends of records that begin there."""
    return np.int32 if size < (1 << 31) - (1 << 16) else np.int64


@jit.loop("the reader's copying")
def copy_records(data: U8, at: I32, size: int, out: U8Out) -> int:
    """Copy ``size`` bytes from each place; returns how many, fewer where a place has no room."""
    for i in range(len(at)):
        begin, place = np.int64(at[i]), i * size
        if begin < 0 or begin + size > len(data):
            return i
        copy_record(data, begin, size, out, place)
    return len(at)


def copy_record(data: Any, begin: Any, size: int, out: Any, place: int) -> None:
    """Copy ``size`` bytes that are there, and up to 15 more: the record that is written next is to cover them."""
    whole = (size + 15) // 16 * 16
    if begin + whole > len(data) or place + whole > len(out):
        for k in range(size):
            out[place + k] = data[begin + k]
        return
    a, b, end = np.uint64(begin), np.uint64(place), np.uint64(place + size)
    while b < end:
        copy_16_bytes(data, a, out, b)
        a += np.uint64(16)
        b += np.uint64(16)


def copy_16_bytes(data: Any, a: Any, out: Any, b: Any) -> None:
    """Sixteen bytes; all are read before one is written, so that they become one instruction each."""
    d0, d1, d2, d3 = data[a], data[a + np.uint64(1)], data[a + np.uint64(2)], data[a + np.uint64(3)]
    d4, d5, d6, d7 = data[a + np.uint64(4)], data[a + np.uint64(5)], data[a + np.uint64(6)], data[a + np.uint64(7)]
    d8, d9, d10, d11 = data[a + np.uint64(8)], data[a + np.uint64(9)], data[a + np.uint64(10)], data[a + np.uint64(11)]
    d12, d13, d14 = data[a + np.uint64(12)], data[a + np.uint64(13)], data[a + np.uint64(14)]
    d15 = data[a + np.uint64(15)]
    out[b], out[b + np.uint64(1)], out[b + np.uint64(2)], out[b + np.uint64(3)] = d0, d1, d2, d3
    out[b + np.uint64(4)], out[b + np.uint64(5)], out[b + np.uint64(6)], out[b + np.uint64(7)] = d4, d5, d6, d7
    out[b + np.uint64(8)], out[b + np.uint64(9)], out[b + np.uint64(10)], out[b + np.uint64(11)] = d8, d9, d10, d11
    out[b + np.uint64(12)], out[b + np.uint64(13)], out[b + np.uint64(14)], out[b + np.uint64(15)] = d12, d13, d14, d15


def gather(data: NDArray[np.uint8], at: Offsets, dtype: np.dtype[Any]) -> NDArray[Any]:
    """One value of ``dtype`` (also a sub-array) from each byte offset, (n,) or (n, k). Alignment does not matter.

    Values that lie k bytes behind each offset come from ``data[k:]``, which needs no further offsets.

    Offsets must leave room for the value; the callers' indexes ensure that.
    """
    if len(at) == 0:
        return np.zeros((0, *dtype.shape), dtype.base)
    if dtype.itemsize == 1:
        return data.take(at).view(dtype.base).reshape(len(at), *dtype.shape)
    if (
        at.dtype == np.int32
        and is_compiled_loaded(len(at) * dtype.itemsize)
        and (loop := compiled_if_cheap(copy_records)) is not None
    ):
        found = np.empty(len(at) * dtype.itemsize, np.uint8)
        if loop(data, at, dtype.itemsize, found) < len(at):
            raise IndexError("an offset leaves no room for its value")
        return np.ndarray((len(at), *dtype.shape), dtype.base, buffer=found)
    bytewise = np.ndarray((len(data) - dtype.itemsize + 1,), f"V{dtype.itemsize}", buffer=data, strides=(1,))
    return np.ndarray((len(at), *dtype.shape), dtype.base, buffer=bytewise[at])


class RecordColumns:
    """Decodes the columns of one table from a single copy of its records, which is made when the first is asked for.

    ``fetch(offsets)`` gives the records as structured array. Columns are views of
    it, so that a table in use takes the memory of its records once.
    """

    def __init__(self, fetch: Callable[[Offsets], NDArray[Any]]) -> None:
        self._fetch = fetch
        self._offsets: Offsets | None = None
        self._records: NDArray[Any] = np.zeros(0)

    def forget(self) -> None:
        """Drop the copy."""
        self._offsets, self._records = None, np.zeros(0)

    def __call__(self, column: str, offsets: Offsets) -> NDArray[Any]:
        """One column at some records; text without what stands behind its first NUL."""
        if self._offsets is not offsets:
            self._records, self._offsets = self._fetch(offsets), offsets
        values = self._records[column]
        return cut_at_nul(np.ascontiguousarray(values)) if values.dtype.kind == "S" else values


def cut_at_nul(text: NDArray[np.bytes_]) -> NDArray[np.bytes_]:
    """The same strings (n,) without anything behind their first NUL byte."""
    width = text.dtype.itemsize
    if len(text) == 0 or width == 0:
        return text
    chars = text.view(np.uint8).reshape(len(text), width).copy()
    chars[np.logical_or.accumulate(chars == 0, axis=1)] = 0
    return chars.view(text.dtype).reshape(len(text))


def decode_texts(column: NDArray[np.bytes_]) -> list[str]:
    """A column (n,) of strings, :func:`text_of` each; almost all are plain, and such are decoded together."""
    listed: list[bytes] = column.tolist()
    joined = b"\n".join(listed)
    if joined.isascii() and b"\0" not in joined:
        plain = joined.decode("ascii").split("\n")
        if len(plain) == len(listed):
            return plain
    return [decode_text(raw) for raw in listed]


def decode_text(raw: bytes) -> str:
    """A logged string: UTF-8, else Latin-1, which can spell every byte."""
    raw = raw.split(b"\0", 1)[0]
    try:
        return raw.decode("utf-8")
    except UnicodeDecodeError:
        return raw.decode("latin-1")


# Records of many kinds, in file order: which are those of each kind?

Kinds = NDArray[np.unsignedinteger[Any]]
MAX_SORTED_KINDS = 1 << 16
"""So many kinds, told by 16 bits, are sorted in linear time."""
MEAN_RECORD_BYTES = 40
"""Bytes of a log that a record stands for."""


def offsets_by_kind(segments: Sequence[tuple[Offsets, Kinds]]) -> list[tuple[int, Offsets]]:
    """Each kind that occurs, ascending, and the offsets of its records, in the given order.

    ``segments``: offsets (n,) and kinds (n,) of records, one type of offset in all.
    """
    records = sum(len(kinds) for _, kinds in segments)
    if (
        is_compiled_loaded(MEAN_RECORD_BYTES * records)
        and segments[0][0].dtype == np.int32
        and segments[0][1].dtype == np.uint16
    ):
        counted, scattered = compiled_if_cheap(count_kinds), compiled_if_cheap(scatter_offsets)
        if counted is not None and scattered is not None:
            return _counting_sort(segments, counted, scattered)
    offsets, kinds = (np.concatenate(parts) for parts in zip(*segments, strict=True))
    order = kinds.argsort(kind="stable")
    offsets, kinds = offsets.take(order), kinds.take(order)
    begins = (kinds[1:] != kinds[:-1]).nonzero()[0] + 1
    return list(zip(kinds[[0, *begins]].tolist(), np.split(offsets, begins), strict=True)) if len(kinds) else []


def _counting_sort(
    segments: Sequence[tuple[Offsets, Kinds]], counted: Any, scattered: Any
) -> list[tuple[int, Offsets]]:
    counts = np.zeros(1 + max(int(kinds.max(initial=0)) for _, kinds in segments), np.int64)
    for _, kinds in segments:
        counted(kinds, counts)
    ends = counts.cumsum()
    places, found = ends - counts, np.empty(ends[-1], np.int32)
    for offsets, kinds in segments:
        scattered(offsets, kinds, places, found)
    return [(kind, found[ends[kind] - counts[kind] : ends[kind]]) for kind in counts.nonzero()[0].tolist()]


# Places are unsigned in these loops: a signed one could count from the end, and asking costs a third of the time.


@jit.loop("the reader's counting")
def count_kinds(kinds: U16, counts: IOut1) -> None:
    """Add how often each kind stands in a segment."""
    for i in range(len(kinds)):
        counts[kinds[i]] += 1


@jit.loop("the reader's sorting")
def scatter_offsets(offsets: I32, kinds: U16, places: IOut1, out: I32Out) -> None:
    """Put each offset at the next free place of its kind."""
    for i in range(len(offsets)):
        place = places[kinds[i]]
        out[np.uint64(place)] = offsets[i]
        places[kinds[i]] = place + 1


# Logs inside gzip files (``flight.ulg.gz``), unpacked once into an anonymous temporary file.
#
# The readers map a log's bytes, so a compressed one needs a place for them: the
# temporary folder, from which the system removes the file as soon as nobody maps
# it. What a stranger's file may unpack to is limited (``attlog.core.limits``).

GZIP_MAGIC = b"\x1f\x8b"
_GZIP_WBITS = 16 + zlib.MAX_WBITS  # zlib's word for "with a gzip header and its checksum"
_PACKED_BLOCK, _UNPACKED_BLOCK = 1 << 16, 1 << 20  # bytes taken in and given out at a time
_SALVAGE_STEP = 64  # bytes at a time where something before is broken


def is_gzip(path: Path) -> bool:
    """Whether a file begins as gzip files do. OSError if it cannot be opened."""
    with path.open("rb") as file:
        return file.read(len(GZIP_MAGIC)) == GZIP_MAGIC


def first_bytes(path: Path, count: int) -> bytes:
    """The first bytes of a log, unpacked if need be. OSError if the file cannot be opened."""
    with path.open("rb") as file:
        return first_bytes_of(file, count)


def first_bytes_of(file: BinaryIO, count: int) -> bytes:
    """As :func:`first_bytes` of an open file that can be rewound."""
    head = file.read(count)
    if not head.startswith(GZIP_MAGIC):
        return head
    file.seek(0)
    head = b""
    for block in GzipContent(file).blocks():
        head += block
        if len(head) >= count:
            break
    return head[:count]


def unpacked_bytes(path: Path) -> tuple[NDArray[np.uint8], Damage | None]:
    """The bytes of a log as uint8 array (n,), unpacked if need be, and what a broken gzip file lost of them.

    LogUnreadable if the file cannot be opened or the temporary folder cannot hold
    the log, LogUnusable if nothing or too much comes out.
    """
    try:
        packed = is_gzip(path)
    except OSError as error:
        raise LogUnreadable(f"{path}: cannot be read ({error.strerror or error})") from error
    if not packed:
        return read_file_bytes(path), None
    import tempfile  # with random, 3 ms: nearly no log is packed

    try:
        unpacked = tempfile.TemporaryFile(prefix="attlog-")
    except OSError as error:
        raise LogUnreadable(f"{path}: no temporary folder to unpack it in ({error.strerror or error})") from error
    with unpacked as file:
        lost = unpack_gzip(path, file)
        return map_open_file(file, path), lost


def unpack_gzip(path: Path, into: BinaryIO) -> Damage | None:
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
        inflate, at_start = zlib.decompressobj(_GZIP_WBITS), True
        while packed := self._file.read(_PACKED_BLOCK):
            while packed := packed.lstrip(b"\0") if at_start else packed:
                before = inflate.copy()
                try:
                    block = inflate.decompress(packed, _UNPACKED_BLOCK)
                except zlib.error as error:
                    yield _up_to_the_error(before, packed)
                    self.lost = (
                        f"{len(packed)} or more bytes behind the compressed log, which are no gzip data"
                        if at_start
                        else f"the rest of the log, because its gzip file is damaged ({_zlib_reason(error)})"
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
    """What comes out of the bytes before the broken place; zlib gives nothing back from a call that fails."""
    found = []
    for k in range(0, len(packed), _SALVAGE_STEP):
        try:
            found.append(inflate.decompress(packed[k : k + _SALVAGE_STEP], _UNPACKED_BLOCK))
        except zlib.error:
            break
    return b"".join(found)


def _zlib_reason(error: zlib.error) -> str:
    """zlib's own words without its numbers: "Error -3 while decompressing data: incorrect data check"."""
    return str(error).rpartition(": ")[2]
