"""Find the records of a DataFlash file in one vectorised pass.

There is no checksum, so a record is accepted only if another header (or the end of the file) is at its end. Anything
else is damage, and reading resumes at the next record that is confirmed in this way. Work and memory are linear in the
file size for any content.
"""

from __future__ import annotations

from bisect import bisect_left
from collections import Counter
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from attlog.core.brief import counted
from attlog.core.timestamps import Offsets
from attlog.formats.dataflash.layout import FMT_LENGTH, FMT_TYPE, HEADER_BYTES, Definitions, MessageFormat
from attlog.formats.file_bytes import gather, offset_type
from attlog.formats.table import DamageLog

# Bytes of a time stamp.
STAMP_BYTES = 8
_HEADER_U16 = 0x95A3  # a3 95 read as little-endian u16
_SCAN_CHUNK_BYTES = 1 << 17  # bytes scanned at once; temporary arrays stay in cache


@dataclass(slots=True)
class RecordIndex:
    """Offsets and layouts of all records in file order, and damage.

    ``layout[i]`` is the position in ``layouts`` of the format of the record at ``offsets[i]``, ``stamps[i]`` the first
    8 bytes of its payload, usually the time. They are released once the times are read.
    """

    layouts: list[MessageFormat]
    offsets: Offsets
    layout: NDArray[np.int16]
    stamps: NDArray[np.int64]
    losses: DamageLog = field(default_factory=DamageLog)


def index_records(data: NDArray[np.uint8]) -> RecordIndex:
    """Index the records of a whole file; without formats there are none.

    Headers inside a payload are skipped, because record lengths do not lead to them. A record without a header at its
    end is rejected, because its bytes or the following ones may be overwritten.
    """
    size = len(data)
    start, types, stamps = _find_headers(data)
    losses = DamageLog()
    layouts = _defined_formats(data, start, types, losses)
    layout = _layout_of_headers(types, start, layouts)
    lengths = np.array([*(f.length for f in layouts), 0], np.int32)  # 0: no format
    end = start + lengths[layout].astype(start.dtype, copy=False)
    followed = np.zeros(len(start), np.bool_)
    np.equal(end[:-1], start[1:], out=followed[:-1])
    breaks = np.flatnonzero(~followed)
    followed[breaks] = _stands_at_header(data, end[breaks]) & (layout[breaks] >= 0)
    kept, holes = _chain_candidates(start, end, breaks, followed, size)
    _report_holes(data, holes, layouts, losses)
    if not kept.all():
        start, layout, stamps = start[kept], layout[kept], stamps[kept]
    return RecordIndex(layouts, start, layout, stamps, losses)


def _find_headers(data: NDArray[np.uint8]) -> tuple[Offsets, NDArray[np.uint8], NDArray[np.int64]]:
    """Return offset, type and next 8 bytes of every ``a3 95``."""
    width = offset_type(len(data))
    found, types, stamps = [np.zeros(0, width)], [np.zeros(0, np.uint8)], [np.zeros(0, np.int64)]
    last = len(data) - HEADER_BYTES + 1
    for start in range(0, last, _SCAN_CHUNK_BYTES):
        stop = min(start + _SCAN_CHUNK_BYTES, last)
        block = data[start : stop + HEADER_BYTES + STAMP_BYTES]
        mark = block[: stop - start] == 0xA3
        mark &= block[1 : stop - start + 1] == 0x95
        at = mark.nonzero()[0]
        found.append(np.add(at, start, dtype=width, casting="same_kind"))
        at += HEADER_BYTES - 1
        types.append(block.take(at))
        if len(block) < stop - start + HEADER_BYTES + STAMP_BYTES:
            block = np.append(block, np.zeros(STAMP_BYTES, np.uint8))
        at += 1
        stamps.append(gather(block, at, np.dtype("<i8")))
    return np.concatenate(found), np.concatenate(types), np.concatenate(stamps)


def _defined_formats(
    data: NDArray[np.uint8], headers: Offsets, types: NDArray[np.uint8], losses: DamageLog
) -> list[MessageFormat]:
    """Return the formats defined by FMT records anywhere in the file."""
    at = headers[types == FMT_TYPE]
    found = Definitions()
    for offset in at[at + FMT_LENGTH <= len(data)].tolist():
        found.take(data[offset : offset + FMT_LENGTH].tobytes(), offset)
    found.report(losses)
    return found.layouts


def _layout_of_headers(types: NDArray[np.uint8], headers: Offsets, layouts: list[MessageFormat]) -> NDArray[np.int16]:
    """Return the layout of each header: the last definition of its type before it, else the first, else -1."""
    table = np.full(256, -1, np.int16)
    per_type: dict[int, list[int]] = {}
    for k, fmt in enumerate(layouts):
        per_type.setdefault(fmt.type, []).append(k)
        if table[fmt.type] < 0:
            table[fmt.type] = k
    layout = table[types]
    for kind, defined in per_type.items():
        if len(defined) > 1:
            mine = np.flatnonzero(types == kind)
            since = np.array([layouts[k].offset for k in defined])
            which = np.searchsorted(since, headers[mine], side="right") - 1
            layout[mine] = np.array(defined, np.int16)[np.maximum(which, 0)]
    return layout


def _stands_at_header(data: NDArray[np.uint8], at: Offsets) -> NDArray[np.bool_]:
    """Mark offsets at a header, at a header cut by the end of the file, or at the end."""
    size = len(data)
    result: NDArray[np.bool_] = at == size
    if size >= 2:
        pairs = np.ndarray((size - 1,), "<u2", buffer=data, strides=(1,))
        result |= (at < size - 1) & (pairs[np.minimum(at, size - 2)] == _HEADER_U16)
        result |= (at == size - 1) & (data[-1] == 0xA3)
    return result


def _chain_candidates(
    start: Offsets, end: Offsets, breaks: NDArray[np.int64], followed: NDArray[np.bool_], size: int
) -> tuple[NDArray[np.bool_], list[tuple[int, int]]]:
    """Return the mask of candidates that are records, and the holes (from, to) between them.

    ``breaks``: candidates that do not end where the next one begins. ``followed``: mask of candidates that end at a
    header. The loop steps from break to break over segments of successive records.
    """
    n = len(start)
    kept = np.zeros(n, np.bool_)
    holes: list[tuple[int, int]] = []
    if n == 0:
        return kept, [(0, size)] if size else []
    ends_of_segments = breaks.tolist()
    i = _next_true(followed, 0)
    hole = 0
    while True:
        stop = int(start[i]) if i < n else size
        if stop > hole:
            holes.append((hole, stop))
        if i >= n:
            break
        last = ends_of_segments[bisect_left(ends_of_segments, i)]
        if followed[last]:
            kept[i : last + 1] = True
            hole = int(end[last])
            following = int(start.searchsorted(end[last]))
            if following < n and start[following] == hole:
                i = following
                continue
        else:
            kept[i:last] = True
            hole = int(start[last])
            following = last + 1
        i = _next_true(followed, following)
    return kept, holes


def _next_true(mask: NDArray[np.bool_], first: int) -> int:
    """Return the index of the first True from ``first`` on, else the length."""
    rest = mask[first:]
    k = int(rest.argmax()) if len(rest) else 0
    return first + k if len(rest) and rest[k] else len(mask)


def _report_holes(
    data: NDArray[np.uint8], holes: list[tuple[int, int]], layouts: list[MessageFormat], losses: DamageLog
) -> None:
    """Report holes as damage; records without FMT are counted by type."""
    size = len(data)
    defined = {f.type for f in layouts}
    unknown: Counter[int] = Counter()
    unknown_bytes: Counter[int] = Counter()
    first: dict[int, int] = {}
    for begin, stop in holes:
        length = stop - begin
        if length >= HEADER_BYTES and data[begin] == 0xA3 and data[begin + 1] == 0x95:
            kind = int(data[begin + 2])
            if kind not in defined and stop < size:
                unknown[kind] += data[begin:stop].tobytes().count(bytes([0xA3, 0x95, kind]))
                unknown_bytes[kind] += length
                first.setdefault(kind, begin)
                continue
        if stop == size:
            losses.add(begin, length, f"{counted(length, 'byte')} at the end of the file", "end of file")
        else:
            losses.add(begin, length, f"{counted(length, 'byte')} outside records", f"next record at {stop}")
    for kind, count in sorted(unknown.items()):
        lost = f"{counted(count, 'record')} of type {kind}, whose FMT record is missing"
        losses.add_kind(first[kind], unknown_bytes[kind], lost, "next record of a known type")
