"""Records of several messages put into one stream, in the order of their times."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray


def merged(
    blocks: Sequence[NDArray[np.uint8]], times: Sequence[NDArray[np.integer]], lengths: Sequence[NDArray[np.int64]]
) -> bytes:
    """All records by time, equal times in the order of the blocks.

    A block is (n, width) bytes, of which each row's first ``lengths`` count.
    """
    if not blocks:
        return b""
    order = np.argsort(np.concatenate([t.astype(np.int64) for t in times]), kind="stable")
    size = np.concatenate(lengths)[order]
    begins = np.empty(len(order), np.int64)
    begins[order] = np.cumsum(size) - size
    out = np.zeros(int(size.sum()), np.uint8)
    first = 0
    for rows, length in zip(blocks, lengths, strict=True):
        at = begins[first : first + len(rows)]
        first += len(rows)
        there = np.arange(rows.shape[1]) < length[:, np.newaxis]
        out[(at[:, np.newaxis] + np.arange(rows.shape[1]))[there]] = rows[there]
    return out.tobytes()
