"""Records of several messages put into one stream, in the order of their times."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

ROWS_AT_ONCE = 1 << 14
"""Rows that are put in their places in one step, so that the indices of their bytes stay small."""


def order_of(times: Sequence[NDArray[np.integer]]) -> NDArray[np.int64]:
    """Which record (counted through all blocks) stands at each place: by time, equal times as the blocks stand."""
    if not times:
        return np.zeros(0, np.int64)
    return np.argsort(np.concatenate([t.astype(np.int64) for t in times]), kind="stable")


def merged(
    blocks: Sequence[NDArray[np.uint8]], times: Sequence[NDArray[np.integer]], lengths: Sequence[NDArray[np.int64]]
) -> bytes:
    """All records in the order of :func:`order_of`.

    A block is (n, width) bytes, of which each row's first ``lengths`` count.
    """
    if not blocks:
        return b""
    order = order_of(times)
    size = np.concatenate(lengths)[order]
    begins = np.empty(len(order), np.int64)
    begins[order] = np.cumsum(size) - size
    out = np.zeros(int(size.sum()), np.uint8)
    first = 0
    for rows, length in zip(blocks, lengths, strict=True):
        column = np.arange(rows.shape[1])
        for start in range(0, len(rows), ROWS_AT_ONCE):
            some = slice(start, min(start + ROWS_AT_ONCE, len(rows)))
            there = column < length[some, np.newaxis]
            at = begins[first + some.start : first + some.stop, np.newaxis] + column
            out[at[there]] = rows[some][there]
        first += len(rows)
    return out.tobytes()
