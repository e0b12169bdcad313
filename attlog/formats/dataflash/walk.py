"""Where the records of an undamaged DataFlash file begin, by a compiled walk along their lengths.

Gives what the numpy pass of :mod:`attlog.formats.dataflash.walk` gives, four times as fast, for a file whose records
follow each other from its first byte to its last and are defined before they are used. Any other file is left to that
pass. Used where the machine code is at hand and worth loading.
"""

from __future__ import annotations

import re
from bisect import bisect_left
from collections import Counter
from collections.abc import Iterable, Iterator
from dataclasses import dataclass, field
from functools import lru_cache
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from attlog.core import jit
from attlog.core.jit import IOut1
from attlog.core.limits import MAX_FORMATS, MAX_LAYOUTS_OF_A_NAME
from attlog.core.timestamps import Offsets
from attlog.formats import file_bytes
from attlog.formats.file_bytes import U8, I16Out, I32Out, compiled_if_cheap, gather, offset_type
from attlog.formats.table import DamageLog

MIN_COMPILED_BYTES = 32 << 20
"""Below this many bytes loading compiled code costs more than it saves (25 ms against 0.5 ms per MB)."""

FMT_TYPE, FMT_LENGTH = 128, 89
FoundRecords = tuple[NDArray[np.int32], NDArray[np.int16], NDArray[np.int64]]

_FIRST_RECORDS = 1 << 14  # records for which there is room before their mean length is known


def is_follower_worthwhile(data: NDArray[np.uint8]) -> bool:
    """Whether :class:`Follower` can be used and is worth it; it counts places in 32 bits."""
    is_worth = offset_type(len(data)) is np.int32 and file_bytes.is_compiled_worthwhile(
        "dataflash", len(data), MIN_COMPILED_BYTES
    )
    return is_worth and compiled_if_cheap(follow_records) is not None


class RecordFollower:
    """Follows records along their lengths, from the first byte of a file; layouts are numbered as they are defined."""

    def __init__(self, data: NDArray[np.uint8]) -> None:
        self.lengths, self._layouts = np.zeros(256, np.int32), np.zeros(256, np.int16)
        self._defined = np.zeros(MAX_FORMATS + 1, np.int32)
        self.lengths[FMT_TYPE] = FMT_LENGTH
        self._data, self._count = data, 0
        self._step = follow_records.compiled()
        self._starts, self._kinds, self._stamps = _record_arrays(_FIRST_RECORDS)

    @property
    def found(self) -> FoundRecords:
        """Offset, layout and first 8 bytes of payload of each record so far."""
        n = self._count
        return self._starts[:n], self._kinds[:n], self._stamps[:n]

    @property
    def definitions(self) -> list[int]:
        """Offset of the FMT record of layout 1 and of each that follows, in file order."""
        places: list[int] = self._defined[1 : int(self._layouts[FMT_TYPE]) + 1].tolist()
        return places

    def follow(self, position: int) -> int:
        """Add the records from ``position`` on; returns where none of a type with a length begins.

        One with fewer than 8 bytes behind its header is not followed where the file ends behind it.
        """
        while True:
            n = self._count
            free = self._starts[n:], self._kinds[n:], self._stamps[n:]
            added = self._step(self._data, position, self.lengths, self._layouts, self._defined, *free)
            self._count += added
            if added:
                last = int(self._starts[self._count - 1])
                position = last + int(self.lengths[self._data[last + 2]])
            if added < len(free[0]):
                return position
            self._grow(position)

    def add(self, position: int, record: bytes) -> None:
        """Add one record, given its bytes."""
        if self._count == len(self._starts):
            self._grow(position)
        k = self._count
        self._starts[k], self._kinds[k] = position, self._layouts[record[2]]
        self._stamps[k] = int.from_bytes(record[3:11], "little", signed=len(record) > 10)
        self._count += 1

    def _grow(self, position: int) -> None:
        """Make room for the rest of the file, if its records are about as long as those before ``position``."""
        rest = (len(self._data) - position) * self._count // max(position, 1)
        starts, kinds, stamps = self.found
        self._starts, self._kinds, self._stamps = _record_arrays(
            self._count + rest + rest // 16 + _FIRST_RECORDS // 16 + 1
        )
        n = self._count
        self._starts[:n], self._kinds[:n], self._stamps[:n] = starts, kinds, stamps


def _record_arrays(records: int) -> FoundRecords:
    return np.empty(records, np.int32), np.empty(records, np.int16), np.empty(records, np.int64)


@jit.loop("the reader's walk over records")
def follow_records(
    data: U8,
    position: int,
    lengths: I32Out,
    layouts: I16Out,
    defined: I32Out,
    starts: I32Out,
    kinds: I16Out,
    stamps: IOut1,
) -> int:
    """Consecutive records of known types from ``position`` on, as many as fit the arrays; returns how many.

    Takes up what FMT records (type 128) define, unless it is what holds already: ``defined`` are their places by
    layout, ``layouts[128]`` counts them.
    """
    n, size = 0, len(data)
    while n < len(starts) and position + 11 <= size:
        if data[position] != 0xA3 or data[position + 1] != 0x95:
            break
        kind = data[position + 2]
        length = np.int64(lengths[kind])
        if length == 0 or position + length > size:
            break
        starts[n] = position
        kinds[n] = layouts[kind]
        if kind == 128:
            kinds[n] = 0
            of, k = data[position + 3], 4 if data[position + 3] != 128 else 89
            before = defined[layouts[of]]
            while k < 89 and data[position + k] == data[before + k]:
                k += 1
            if lengths[of] == 0 or k < 89:
                if layouts[128] + 1 == len(defined):
                    break
                layouts[128] += 1
                lengths[of], layouts[of], defined[layouts[128]] = data[position + 4], layouts[128], position
        stamp = np.int64(0)
        for k in range(8):
            stamp |= np.int64(data[position + 3 + k]) << (8 * k)
        stamps[n] = stamp
        n += 1
        position += int(length)
    return n


# Where the records of a DataFlash file begin, found in one vectorised pass.
#
# Both formats frame alike: ``a3 95 type payload``, where FMT records (type 128)
# tell the length of every other type. There is no checksum, so a record counts
# only when its end is again a header (or the end of the file); what does not is
# damage, and reading goes on at the next record that is confirmed in this way.
# Work and memory are linear in the file size, whatever the bytes are.

HEADER_BYTES = 3
STAMP_BYTES = 8
_FMT_MARK = bytes([0xA3, 0x95, FMT_TYPE])
_HEADER_U16 = 0x95A3  # a3 95 read as little-endian u16
_SCAN_BYTES = 1 << 17  # bytes scanned at once, keeps the temporaries in cache

LETTER_DTYPES: dict[str, np.dtype[Any]] = {
    letter: np.dtype(name)
    for letter, name in {
        "a": "(32,)<i2",
        "b": "i1",
        "B": "u1",
        "h": "<i2",
        "H": "<u2",
        "i": "<i4",
        "I": "<u4",
        "q": "<i8",
        "Q": "<u8",
        "f": "<f4",
        "d": "<f8",
        "g": "<f2",
        "n": "S4",
        "N": "S16",
        "Z": "S64",
        "M": "u1",
        "c": "<i2",
        "C": "<u2",
        "e": "<i4",
        "E": "<u4",
        "L": "<i4",
    }.items()
}
_LETTER_SIZES = {letter: dtype.itemsize for letter, dtype in LETTER_DTYPES.items()}
LETTER_SCALES = {"c": 0.01, "C": 0.01, "e": 0.01, "E": 0.01, "L": 1e-7}


class MessageFormat(NamedTuple):
    """One FMT record: the layout of a message type, valid from ``offset`` in the file on.

    A tuple because each log defines some 200, and these are made four times as fast.
    """

    type: int
    length: int
    name: str
    letters: str
    columns: tuple[str, ...]
    offset: int

    @property
    def readable(self) -> bool:
        """True when the letters are known and their sizes add up to the declared length."""
        return _length_of(self.letters) == self.length

    def place(self, k: int) -> int:
        """Where the k-th column begins in the record (bytes)."""
        return HEADER_BYTES + sum(map(_LETTER_SIZES.__getitem__, self.letters[:k]))

    def same_layout(self, other: MessageFormat) -> bool:
        """True when both describe the same bytes by the same names."""
        return (self.length, self.name, self.letters, self.columns) == (
            other.length,
            other.name,
            other.letters,
            other.columns,
        )


@lru_cache(1 << 12)
def _length_of(letters: str) -> int | None:
    """Bytes of a record with columns of these letters; None where one is unknown or there are none."""
    if not letters or not LETTER_DTYPES.keys() >= set(letters):
        return None
    return HEADER_BYTES + sum(map(_LETTER_SIZES.__getitem__, letters))


FMT_FORMAT = MessageFormat(FMT_TYPE, FMT_LENGTH, "FMT", "BBnNZ", ("Type", "Length", "Name", "Format", "Columns"), 0)


@dataclass(slots=True)
class RecordIndex:
    """Offsets of all records in file order, the layout of each, and what is damaged.

    ``layout[i]`` is the position in ``layouts`` of the format of the record at
    ``offsets[i]``, ``stamps[i]`` the first 8 bytes of its payload, where most formats
    keep their time; whoever reads the times takes them out to free their memory.
    """

    layouts: list[MessageFormat]
    offsets: Offsets
    layout: NDArray[np.int16]
    stamps: NDArray[np.int64]
    losses: DamageLog = field(default_factory=DamageLog)


def _find_headers(data: NDArray[np.uint8]) -> tuple[Offsets, NDArray[np.uint8], NDArray[np.int64]]:
    """Every offset at which ``a3 95 type`` stands, real header or not, the type, and the 8 bytes behind it.

    All three come from one block of the file while it is in the processor's cache.
    """
    width = offset_type(len(data))
    found, types, stamps = [np.zeros(0, width)], [np.zeros(0, np.uint8)], [np.zeros(0, np.int64)]
    last = len(data) - HEADER_BYTES + 1
    for start in range(0, last, _SCAN_BYTES):
        stop = min(start + _SCAN_BYTES, last)
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


def _printable_text(raw: bytes) -> str | None:
    """The text before the first NUL without padding blanks, None if it is not plain ASCII."""
    text = raw.split(b"\0", 1)[0]
    if not text.isascii():
        return None
    plain = text.decode("ascii")
    return plain.strip() if plain.isprintable() else None


def parse_fmt_record(raw: bytes, offset: int) -> MessageFormat | None:
    """The Format in the 89 bytes of an FMT record, None if they cannot be one."""
    told = _parse_fmt_record(raw)
    return None if told is None else MessageFormat(*told[:-1], offset)


@lru_cache(1 << 10)
def _parse_fmt_record(raw: bytes) -> MessageFormat | None:
    """The same as if at the beginning; logs of one firmware, and the recogniser before the reader, ask for the same."""
    name, letters, columns = _printable_text(raw[5:9]), _printable_text(raw[9:25]), _printable_text(raw[25:89])
    if not name or letters is None or columns is None or raw[4] < HEADER_BYTES:
        return None
    if raw[3] == FMT_TYPE:
        return None if raw[4] != FMT_LENGTH else FMT_FORMAT
    return MessageFormat(raw[3], raw[4], name, letters, column_names(columns.split(",")) if columns else (), 0)


def column_names(listed: Iterable[str]) -> tuple[str, ...]:
    """The names without blanks around them; the second column of a name has none, as there is no way to ask for it."""
    names = tuple(map(str.strip, listed))
    if len(set(names)) == len(names):
        return names
    return tuple("" if name in names[:k] else name for k, name in enumerate(names))


class _Definitions:
    """The formats in file order, repetitions left out.

    A log may define only so many. A type whose new definition is refused has a Format without letters from there
    on, so that its records are framed and given up, never read by an older definition.
    """

    def __init__(self) -> None:
        self.layouts = [FMT_FORMAT]
        self.refused: list[int] = []
        self._current: dict[int, MessageFormat] = {FMT_TYPE: FMT_FORMAT}
        self._bytes: dict[int, bytes] = {}
        self._of_name: Counter[str] = Counter()

    def take(self, raw: bytes, offset: int) -> None:
        """The 89 bytes of an FMT record at this place."""
        if self._bytes.get(raw[3]) == raw or not 0x30 <= raw[5] <= 0x7A:  # a name begins with a letter or digit
            return
        fmt = parse_fmt_record(raw, offset)
        if fmt is None or fmt.type == FMT_TYPE:
            return
        self._bytes[fmt.type] = raw
        known = self._current.get(fmt.type)
        if known is not None and known.same_layout(fmt):
            return
        self._of_name[fmt.name] += 1
        if self._of_name[fmt.name] > MAX_LAYOUTS_OF_A_NAME or len(self.layouts) >= MAX_FORMATS:
            self.refused.append(offset)
            if known is None or not known.letters or len(self.layouts) >= MAX_FORMATS + 256:
                return
            fmt = MessageFormat(fmt.type, fmt.length, fmt.name, "", (), offset)
        self._current[fmt.type] = fmt
        self.layouts.append(fmt)

    def tell(self, losses: DamageLog) -> None:
        """What was refused."""
        if self.refused:
            lost = (
                f"{len(self.refused)} definitions beyond the {MAX_LAYOUTS_OF_A_NAME} of one message or the "
                f"{MAX_FORMATS} of a log that are read"
            )
            losses.add_kind(self.refused[0], FMT_LENGTH * len(self.refused), lost, "next definition")


def _defined_formats(
    data: NDArray[np.uint8], headers: Offsets, types: NDArray[np.uint8], losses: DamageLog
) -> list[MessageFormat]:
    """The formats that FMT records anywhere in the file define."""
    at = headers[types == FMT_TYPE]
    found = _Definitions()
    for offset in at[at + FMT_LENGTH <= len(data)].tolist():
        found.take(data[offset : offset + FMT_LENGTH].tobytes(), offset)
    found.tell(losses)
    return found.layouts


def _layout_of_headers(types: NDArray[np.uint8], headers: Offsets, layouts: list[MessageFormat]) -> NDArray[np.int16]:
    """The layout of each header: the last definition of its type before it, else the first; -1 without one."""
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


def index_records(data: NDArray[np.uint8]) -> RecordIndex:
    """The index of a whole file (bytes as uint8 array); no formats means no records."""
    walked = _follow_all(data) if is_follower_worthwhile(data) else None
    return search_records(data) if walked is None else walked


def _follow_all(data: NDArray[np.uint8]) -> RecordIndex | None:
    """The index of a file whose records follow each other from first to last; None for any other file."""
    chain = RecordFollower(data)
    position = chain.follow(0)
    while True:
        rest = data[position : position + 256].tobytes()  # no record is longer
        # a last record may be too short for the walk
        length = int(chain.lengths[rest[2]]) if rest[:2] == _FMT_MARK[:2] and len(rest) > 2 else 0
        if not 0 < length <= len(rest) <= HEADER_BYTES + STAMP_BYTES:
            break
        chain.add(position, rest)
        position += length
    if position + len(rest) < len(data) or not _is_cut_record(rest, chain.lengths):
        return None
    found = _Definitions()
    for offset in chain.definitions:
        found.take(data[offset : offset + FMT_LENGTH].tobytes(), offset)
    if found.refused or [fmt.offset for fmt in found.layouts[1:]] != chain.definitions:
        return None
    starts, kinds, stamps = chain.found
    index = RecordIndex(found.layouts, starts, kinds, stamps)
    if rest:
        index.losses.add(position, len(rest), f"{len(rest)} bytes at the end of the file", "end of file")
    return index


def _is_cut_record(rest: bytes, lengths: NDArray[np.int32]) -> bool:
    """Whether the end of a file is nothing, or the beginning of one record of a known type."""
    if rest[:2] != _FMT_MARK[: min(len(rest), 2)] or _FMT_MARK[:2] in rest[2:]:
        return False
    return len(rest) < HEADER_BYTES or rest[2] == FMT_TYPE or bool(lengths[rest[2]] > len(rest))


def search_records(data: NDArray[np.uint8]) -> RecordIndex:
    """The index of a whole file by its marks, also of one that is damaged.

    A header inside a payload is passed over because the chain of lengths does
    not lead to it. A record whose end is no header is given up: nothing tells
    whether its bytes or the following ones were overwritten.
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


def _stands_at_header(data: NDArray[np.uint8], at: Offsets) -> NDArray[np.bool_]:
    """True where a header stands at the offset, also one cut by the end of the file, or the file ends there."""
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
    """Which candidates are records, and the holes (from, to) between them.

    ``breaks`` are the candidates that do not end where the next one begins, ``followed``
    tells those that end at a header. Long segments of records that follow each other
    directly are taken at once; the loop only steps from break to break.
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
    """The first index from ``first`` on where the mask is true, else its length."""
    rest = mask[first:]
    k = int(rest.argmax()) if len(rest) else 0
    return first + k if len(rest) and rest[k] else len(mask)


def _report_holes(
    data: NDArray[np.uint8], holes: list[tuple[int, int]], layouts: list[MessageFormat], losses: DamageLog
) -> None:
    """Adds the holes to the losses. Records without FMT are counted per type, not one by one."""
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
            losses.add(begin, length, f"{length} bytes at the end of the file", "end of file")
        else:
            losses.add(begin, length, f"{length} bytes that are no records", f"next record at {stop}")
    for kind, count in sorted(unknown.items()):
        lost = f"{count} records of type {kind}, whose FMT record is missing"
        losses.add_kind(first[kind], unknown_bytes[kind], lost, "next record of a known type")


# Does a file hold DataFlash records or lines?

RECORD_MARK = b"\xa3\x95"
"""Before every binary record."""
MIN_MARKS = 5
"""Marks that show a log whose formats are lost (one per 400 bytes in longer files): no record is longer than 255."""
_FMT_LINE = re.compile(rb"(?:^|[\r\n])[ \t]*+FMT, *+\d{1,9}+, *+\d{1,9}+, *+\w")


def is_dataflash(head: bytes) -> bool:
    """A format definition, or (the start is lost) many record marks at the start."""
    if head[:2] == RECORD_MARK and len(head) < FMT_LENGTH:
        return True
    if any(True for _ in formats_in_head(head)):
        return True
    return head.count(RECORD_MARK) >= max(MIN_MARKS, len(head) // 400)


def is_dataflash_text(head: bytes) -> bool:
    """A line that defines a format, and no NUL near the start."""
    return b"\0" not in head[:4096] and _FMT_LINE.search(head) is not None


def formats_in_head(head: bytes) -> Iterator[MessageFormat]:
    """The formats that FMT records define, in binary framing."""
    fmt_mark = RECORD_MARK + bytes([FMT_TYPE])
    at = head.find(fmt_mark)
    while at >= 0 and at + FMT_LENGTH <= len(head):
        found = parse_fmt_record(head[at : at + FMT_LENGTH], at)
        if found is not None and LETTER_DTYPES.keys() >= set(found.letters):
            yield found
        at = head.find(fmt_mark, at + len(fmt_mark))
