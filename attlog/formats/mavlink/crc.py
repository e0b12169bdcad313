"""MAVLink's checksum, CRC-16/MCRF4XX: reflected polynomial 0x1021, first state 0xffff.

One table of single bytes; the others are made of it, for several bytes a step.
"""

from __future__ import annotations

from functools import cache
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

_POLYNOMIAL = 0x8408  # 0x1021 with its bits reversed


@cache
def byte_table() -> NDArray[np.uint16]:
    """The state after one more byte (256), by the lower byte of the state xor that byte."""
    state = np.arange(256, dtype=np.uint16)
    for _ in range(8):
        state = np.where(state & 1, (state >> 1) ^ _POLYNOMIAL, state >> 1).astype(np.uint16)
    return state


@cache
def word_table() -> NDArray[np.uint16]:
    """The state after two more bytes (65536), by state xor those bytes as little-endian word."""
    byte = byte_table()
    state = np.arange(65536, dtype=np.uint16)
    for _ in range(2):
        state = (state >> 8) ^ byte[state & 0xFF]
    return state


def slicing_tables() -> NDArray[np.uint16]:
    """The state after one byte followed by 0 to 7 zero bytes, from a zero state: (8, 256)."""
    tables = [byte_table()]
    for _ in range(7):
        tables.append((tables[-1] >> 8) ^ byte_table()[tables[-1] & 0xFF])
    return np.stack(tables)


def crc_of_padded_rows(rows: NDArray[np.uint8], pad: NDArray[np.int64]) -> NDArray[np.uint16]:
    """CRC-16/MCRF4XX of rows (n, k), k even, whose first ``pad`` (sorted) bytes do not count; changes ``rows``.

    A state of zero does not change by zero bytes, so rows of many lengths go
    together when the padding is zero and the start value 0xffff is put on the
    first two bytes.
    """
    edges = [0, *(np.flatnonzero(np.diff(pad)) + 1).tolist(), len(rows)]
    for begin, stop in pairwise(edges):
        skipped = int(pad[begin]) if stop > begin else 0
        rows[begin:stop, :skipped] = 0
        rows[begin:stop, skipped : skipped + 2] ^= 0xFF
    crc, table = np.zeros(len(rows), np.uint16), word_table()
    for column in np.ascontiguousarray(rows.view("<u2").T):
        column ^= crc
        # every u16 is a valid index; wrap only spares numpy the check
        table.take(column, out=crc, mode="wrap")
    return crc


def crc_of_rows(rows: NDArray[np.uint8]) -> NDArray[np.uint16]:
    """CRC-16/MCRF4XX, the checksum of MAVLink, of each row of (n, k) bytes, k > 1."""
    pad = rows.shape[1] % 2
    padded = np.zeros((len(rows), rows.shape[1] + pad), np.uint8)
    padded[:, pad:] = rows
    return crc_of_padded_rows(padded, np.full(len(rows), pad))
