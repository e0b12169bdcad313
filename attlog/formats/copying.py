"""Bytes of many records copied behind each other: the loop, for the compiler."""

from __future__ import annotations

from typing import Any

import numpy as np

from attlog.formats.compiled import kernel_of

SOURCE = "formats/copying.py"


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
