"""The bytes of a file as a read-only array that the system pages in on demand, and records copied out of it."""

from __future__ import annotations

import errno
import mmap
import os
from collections.abc import Callable
from pathlib import Path
from typing import Any, BinaryIO

import numpy as np
from numpy.typing import NDArray

from attlog.base import limits
from attlog.base.errors import LogUnreadable, LogUnusable
from attlog.formats.base import Offsets
from attlog.formats.compiled import if_cheap, is_ready, kernel_of

SOURCE = "formats/mapping.py"


def map_bytes(path: str | Path) -> NDArray[np.uint8]:
    """The content of a file as uint8 array (n,), read into memory; reading costs some 0.3 ms per MB.

    A file that is cut while it is mapped ends the process that reads on (SIGBUS), which no handler in Python can
    prevent. So only a process that another one watches maps files larger than :data:`attlog.base.limits.READ_BYTES`,
    or one that asks for it by the environment's :data:`attlog.base.limits.MAPPED`. LogUnreadable if the file cannot be
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


def copy(data, at, size, out):  # type: ignore[no-untyped-def]
    """Copy ``size`` bytes from each place; returns how many, fewer where a place has no room."""
    for i in range(len(at)):
        begin, place = np.int64(at[i]), i * size
        if begin < 0 or begin + size > len(data):
            return i
        copy_one(data, begin, size, out, place)
    return len(at)


def copy_one(data: Any, begin: Any, size: int, out: Any, place: int) -> None:
    """Copy ``size`` bytes that are there, and up to 15 more: the record that is written next is to cover them."""
    whole = (size + 15) // 16 * 16
    if begin + whole > len(data) or place + whole > len(out):
        for k in range(size):
            out[place + k] = data[begin + k]
        return
    a, b, end = np.uint64(begin), np.uint64(place), np.uint64(place + size)
    while b < end:
        copy_sixteen(data, a, out, b)
        a += np.uint64(16)
        b += np.uint64(16)


def copy_sixteen(data: Any, a: Any, out: Any, b: Any) -> None:
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


COPY = kernel_of(copy, "i8((u1[::1]), (i4[::1]), i8, u1[::1])", SOURCE)


def gather(data: NDArray[np.uint8], at: Offsets, dtype: np.dtype[Any]) -> NDArray[Any]:
    """One value of ``dtype`` (also a sub-array) from each byte offset, (n,) or (n, k). Alignment does not matter.

    Values that lie k bytes behind each offset come from ``data[k:]``, which needs no further offsets.

    Offsets must leave room for the value; the callers' indexes ensure that.
    """
    if len(at) == 0:
        return np.zeros((0, *dtype.shape), dtype.base)
    if dtype.itemsize == 1:
        return data.take(at).view(dtype.base).reshape(len(at), *dtype.shape)
    if at.dtype == np.int32 and is_ready(len(at) * dtype.itemsize) and (loop := if_cheap(COPY)) is not None:
        found = np.empty(len(at) * dtype.itemsize, np.uint8)
        if loop(data, at, dtype.itemsize, found) < len(at):
            raise IndexError("an offset leaves no room for its value")
        return np.ndarray((len(at), *dtype.shape), dtype.base, buffer=found)
    bytewise = np.ndarray((len(data) - dtype.itemsize + 1,), f"V{dtype.itemsize}", buffer=data, strides=(1,))
    return np.ndarray((len(at), *dtype.shape), dtype.base, buffer=bytewise[at])


class Records:
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


def texts_of(column: NDArray[np.bytes_]) -> list[str]:
    """A column (n,) of strings, :func:`text_of` each; almost all are plain, and such are decoded together."""
    listed: list[bytes] = column.tolist()
    joined = b"\n".join(listed)
    if joined.isascii() and b"\0" not in joined:
        plain = joined.decode("ascii").split("\n")
        if len(plain) == len(listed):
            return plain
    return [text_of(raw) for raw in listed]


def text_of(raw: bytes) -> str:
    """A logged string: UTF-8, else Latin-1, which can spell every byte."""
    raw = raw.split(b"\0", 1)[0]
    try:
        return raw.decode("utf-8")
    except UnicodeDecodeError:
        return raw.decode("latin-1")
