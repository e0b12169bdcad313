"""Records of many kinds, in file order: which are those of each kind?"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from attlog.formats.base import Offsets
from attlog.formats.compiled import if_cheap, is_ready, kernel_of

Kinds = NDArray[np.unsignedinteger[Any]]
KINDS = 1 << 16
"""So many kinds, told by 16 bits, are sorted in linear time."""
USUAL_RECORD = 40
"""Bytes of a log that a record stands for."""


def by_kind(segments: Sequence[tuple[Offsets, Kinds]]) -> list[tuple[int, Offsets]]:
    """Each kind that occurs, ascending, and the offsets of its records, in the given order.

    ``segments``: offsets (n,) and kinds (n,) of records, one type of offset in all.
    """
    records = sum(len(kinds) for _, kinds in segments)
    if is_ready(USUAL_RECORD * records) and segments[0][0].dtype == np.int32 and segments[0][1].dtype == np.uint16:
        counted, scattered = if_cheap(COUNT), if_cheap(SCATTER)
        if counted is not None and scattered is not None:
            return _by_counting(segments, counted, scattered)
    offsets, kinds = (np.concatenate(parts) for parts in zip(*segments, strict=True))
    order = kinds.argsort(kind="stable")
    offsets, kinds = offsets.take(order), kinds.take(order)
    begins = (kinds[1:] != kinds[:-1]).nonzero()[0] + 1
    return list(zip(kinds[[0, *begins]].tolist(), np.split(offsets, begins), strict=True)) if len(kinds) else []


def _by_counting(segments: Sequence[tuple[Offsets, Kinds]], counted: Any, scattered: Any) -> list[tuple[int, Offsets]]:
    counts = np.zeros(1 + max(int(kinds.max(initial=0)) for _, kinds in segments), np.int64)
    for _, kinds in segments:
        counted(kinds, counts)
    ends = counts.cumsum()
    places, found = ends - counts, np.empty(ends[-1], np.int32)
    for offsets, kinds in segments:
        scattered(offsets, kinds, places, found)
    return [(kind, found[ends[kind] - counts[kind] : ends[kind]]) for kind in counts.nonzero()[0].tolist()]


# Places are unsigned in these loops: a signed one could count from the end, and asking costs a third of the time.


def count(kinds, counts):  # type: ignore[no-untyped-def]
    """Add how often each kind stands in a segment."""
    for i in range(len(kinds)):
        counts[kinds[i]] += 1


def scatter(offsets, kinds, places, out):  # type: ignore[no-untyped-def]
    """Put each offset at the next free place of its kind."""
    for i in range(len(offsets)):
        place = places[kinds[i]]
        out[np.uint64(place)] = offsets[i]
        places[kinds[i]] = place + 1


SOURCE = "formats/grouping.py"
COUNT = kernel_of(count, "void((u2[::1]), i8[::1])", SOURCE)
SCATTER = kernel_of(scatter, "void((i4[::1]), (u2[::1]), i8[::1], i4[::1])", SOURCE)
