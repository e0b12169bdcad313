"""Decode ROS 2 messages into columns; field places are found once for all messages of a topic.

OMG's Common Data Representation (XCDR1): 4 bytes with the byte order, then the fields in order, numbers aligned to
their own size, texts and sequences behind their length. Messages of one topic mostly have equal lengths, so that a
field is a column of one array of bytes. Messages of other lengths form arrays of their own.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from attlog.core.limits import MAX_FIELDS, MAX_LAYOUTS, MAX_NESTING
from attlog.formats.table import Field, Table

# Types of numbers; of equal ones the last is the usual name.
NUMBER_TYPES = dict(
    zip(
        "bool byte octet char uint8 int8 uint16 int16 uint32 int32 uint64 int64 float32 float64".split(),
        "u1 u1 u1 u1 u1 i1 u2 i2 u4 i4 u8 i8 f4 f8".split(),
        strict=True,
    )
)
# Kinds of nodes of rosbags' parsed definitions.
BASE_NODE, NAME_NODE, ARRAY_NODE, SEQUENCE_NODE = 1, 2, 3, 4
HEAD_BYTES = 4
# Second bytes of messages without field tags: XCDR 1 and 2, big and little endian.
PLAIN_ENCODINGS = (0, 1, 6, 7)
# Longer sequences are images and point clouds.
MAX_ELEMENTS = 4096
# Column with the recorder's time of a message.
RECORDER_COLUMN = "log_time_ns"


@dataclass(frozen=True, slots=True)
class FieldPlace:
    """Place of a field, ``at`` bytes from the start of each message."""

    name: str
    at: int
    dtype: np.dtype[Any]


class MessageLayoutCdr:
    """Places of the fields of one message.

    ``lengths``: place and value of the lengths that other messages of this layout must share. ValueError for a
    truncated message or unsupported types.
    """

    def __init__(self, types: dict[str, Any], kind: str, message: bytes) -> None:
        self.places: dict[str, FieldPlace] = {}
        self.lengths: list[tuple[int, int]] = []
        self._nodes = self._depth = 0
        self._types, self._message = types, message
        if len(message) < HEAD_BYTES or message[0] != 0 or message[1] not in PLAIN_ENCODINGS:
            raise ValueError("it does not begin as plain CDR")
        self._order = "<" if message[1] & 1 else ">"
        self._most = 8 if message[1] < 6 else 4  # XCDR2 aligns to 4 at most
        self._at = HEAD_BYTES
        self._message_of(kind, "")
        if self._at > len(message):
            raise ValueError(f"{len(message)} bytes are too few for {kind}")

    def _message_of(self, kind: str, prefix: str) -> None:
        self._depth += 1
        if self._depth > MAX_NESTING:
            raise ValueError(f"{kind} is nested too deeply")
        for name, node in self._types[kind][1]:
            self._node(node, prefix + name)
        self._depth -= 1

    def _node(self, node: tuple[Any, Any], name: str) -> None:
        of, what = int(node[0]), node[1]
        self._nodes += 1
        if self._nodes > MAX_FIELDS:
            raise ValueError(f"it has more than {MAX_FIELDS} fields")
        if of == NAME_NODE:
            self._message_of(what, f"{name}.")
        elif of == BASE_NODE:
            self._base(what[0], name)
        elif of == ARRAY_NODE:
            self._elements(what[0], what[1], name)
        else:
            self._elements(what[0], self._length(), name)

    def _base(self, kind: str, name: str) -> None:
        if kind == "string":
            length = self._length()  # which moves on itself
            self._at += length
            return
        self._number(np.dtype(self._order + NUMBER_TYPES[kind]), name)

    def _elements(self, of: tuple[Any, Any], count: int, name: str) -> None:
        if count > MAX_ELEMENTS:
            raise ValueError(f"{name} has {count} elements")
        if int(of[0]) == BASE_NODE and of[1][0] != "string":
            if count:
                self._number(np.dtype(self._order + NUMBER_TYPES[of[1][0]]), name, count)
            return
        for k in range(count):
            self._node(of, f"{name}[{k}]")

    def _number(self, dtype: np.dtype[Any], name: str, count: int = 0) -> None:
        self._align(dtype.itemsize)
        whole = np.dtype((dtype, (count,))) if count else dtype
        self.places[name] = FieldPlace(name, self._at, whole)
        self._at += whole.itemsize

    def _length(self) -> int:
        self._align(4)
        if self._at + 4 > len(self._message):
            raise ValueError("the message ends early")
        length = int(np.frombuffer(self._message, self._order + "u4", 1, self._at)[0])
        self.lengths.append((self._at, length))
        self._at += 4
        return length

    def _align(self, size: int) -> None:
        size = min(size, self._most)
        self._at += -(self._at - HEAD_BYTES) % size

    def fields(self) -> dict[str, np.dtype[Any]]:
        """Return name and type of each number, in native byte order."""
        return {name: place.dtype.newbyteorder("=") for name, place in self.places.items()}

    def column(self, rows: NDArray[np.uint8], name: str) -> NDArray[Any]:
        """Return a field of messages (n, size), in native byte order."""
        place = self.places[name]
        part = np.ascontiguousarray(rows[:, place.at : place.at + place.dtype.itemsize])
        flat = part.view(place.dtype.base)
        values = flat.reshape(len(rows), *place.dtype.shape) if place.dtype.shape else flat[:, 0]
        return np.asarray(values.astype(values.dtype.newbyteorder("=")))

    def fits(self, rows: NDArray[np.uint8]) -> NDArray[np.bool_]:
        """Select the messages (n, size) with the same lengths in the same places."""
        same = np.ones(len(rows), bool)
        for at, length in self.lengths:
            seen = np.ascontiguousarray(rows[:, at : at + 4]).view(self._order + "u4")[:, 0]
            same &= seen == length
        return same


def decode_table(
    name: str, types: dict[str, Any], kind: str, messages: Sequence[bytes], times_ns: Sequence[int]
) -> Table:
    """Return the messages of one topic that can be decoded.

    Column ``log_time_ns`` is the recorder's time. ValueError where no message can be decoded.
    """
    parts = _split_by_layout(types, kind, messages)
    stored = parts[0].layout.fields()
    parts = [part for part in parts if part.layout.fields() == stored]
    index = np.concatenate([part.index for part in parts])
    order = np.argsort(index, kind="stable")
    stamps = np.asarray(times_ns, np.int64)[index[order]]
    fields = {column: Field(column, dtype) for column, dtype in stored.items()}
    fields[RECORDER_COLUMN] = Field(RECORDER_COLUMN, stamps.dtype)

    def decode(column: str, rows: NDArray[Any]) -> NDArray[Any]:
        if column == RECORDER_COLUMN:
            return np.asarray(stamps[rows])
        whole = [part.layout.column(part.rows, column) for part in parts]
        return np.asarray(whole[0][rows] if len(parts) == 1 else np.concatenate(whole)[order][rows])

    return Table(name, 0, fields, np.arange(len(index)), decode)


@dataclass(frozen=True, slots=True)
class _LayoutPart:
    """Messages of one layout: their indices (n,) and bytes (n, size)."""

    layout: MessageLayoutCdr
    index: NDArray[np.int64]
    rows: NDArray[np.uint8]


def _split_by_layout(types: dict[str, Any], kind: str, messages: Sequence[bytes]) -> list[_LayoutPart]:
    """Return the messages by layout, most first. ValueError with the reason where none can be decoded."""
    sizes = np.array([len(message) for message in messages])
    open_ = np.ones(len(messages), bool)
    parts: list[_LayoutPart] = []
    reason = "no messages"
    for _ in range(MAX_LAYOUTS):
        if not open_.any():
            break
        usual = int(np.bincount(sizes[open_]).argmax())
        index = np.flatnonzero(open_ & (sizes == usual))
        middle = int(index[len(index) // 2])
        try:
            layout = MessageLayoutCdr(types, kind, messages[middle])
        except ValueError as error:
            open_[middle], reason = False, str(error)
            continue
        rows = np.frombuffer(b"".join([messages[i] for i in index.tolist()]), np.uint8).reshape(len(index), usual)
        same = layout.fits(rows)
        parts.append(_LayoutPart(layout, index[same], rows[same]))
        open_[index[same]] = False
    if not parts:
        raise ValueError(reason)
    return sorted(parts, key=lambda part: -len(part.index))
