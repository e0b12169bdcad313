"""Messages of ROS 2 as columns: where in their bytes every number lies, once for all messages of a topic.

OMG's Common Data Representation (XCDR1): 4 bytes that tell the byte order, then the fields in order, numbers aligned to
their own size, texts and sequences after their length. Messages of one topic mostly have equal lengths in all these
places: then a field lies in the same place in each, and is a column of one array of bytes.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from attlog.formats.base import Field, Table

NUMBERS = {
    "bool": "u1",
    "byte": "u1",
    "octet": "u1",
    "char": "u1",
    "uint8": "u1",
    "int8": "i1",
    "uint16": "u2",
    "int16": "i2",
    "uint32": "u4",
    "int32": "i4",
    "uint64": "u8",
    "int64": "i8",
    "float32": "f4",
    "float64": "f8",
}
BASE, NAME, ARRAY, SEQUENCE = 1, 2, 3, 4
"""Kinds of nodes of rosbags' parsed definitions."""
HEAD = 4
MOST_ELEMENTS = 4096
"""Longer sequences are pictures and clouds."""


@dataclass(frozen=True, slots=True)
class Place:
    """A field that lies ``at`` bytes from the start of each message, as ``dtype`` (of an array: with its shape)."""

    name: str
    at: int
    dtype: np.dtype[Any]


class Layout:
    """Where the fields of one message lie; ``lengths`` are the places (uint32) that must be the same in others.

    ValueError for a message that ends early or holds what is not decoded.
    """

    def __init__(self, types: dict[str, Any], kind: str, message: bytes) -> None:
        self.places: list[Place] = []
        self.lengths: list[tuple[int, int]] = []
        self._types, self._message = types, message
        if len(message) < HEAD or message[0] != 0:
            raise ValueError("no CDR header")
        self._order = "<" if message[1] & 1 else ">"
        self._most = 8 if message[1] < 6 else 4  # XCDR2 aligns to 4 at most
        self._at = HEAD
        self._message_of(kind, "")
        if self._at > len(message):
            raise ValueError(f"{len(message)} bytes are too few for {kind}")

    def _message_of(self, kind: str, prefix: str) -> None:
        for name, node in self._types[kind][1]:
            self._node(node, prefix + name)

    def _node(self, node: tuple[Any, Any], name: str) -> None:
        of, what = int(node[0]), node[1]
        if of == NAME:
            self._message_of(what, f"{name}.")
        elif of == BASE:
            self._base(what[0], name)
        elif of == ARRAY:
            self._elements(what[0], what[1], name)
        else:
            self._elements(what[0], self._length(), name)

    def _base(self, kind: str, name: str) -> None:
        if kind == "string":
            self._at += self._length()
            return
        self._number(np.dtype(self._order + NUMBERS[kind]), name)

    def _elements(self, of: tuple[Any, Any], count: int, name: str) -> None:
        if count > MOST_ELEMENTS:
            raise ValueError(f"{name} has {count} elements")
        if int(of[0]) == BASE and of[1][0] != "string":
            if count:
                self._number(np.dtype(self._order + NUMBERS[of[1][0]]), name, count)
            return
        for k in range(count):
            self._node(of, f"{name}[{k}]")

    def _number(self, dtype: np.dtype[Any], name: str, count: int = 0) -> None:
        self._align(dtype.itemsize)
        whole = np.dtype((dtype, (count,))) if count else dtype
        self.places.append(Place(name, self._at, whole))
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
        self._at += -(self._at - HEAD) % size

    def column(self, rows: NDArray[np.uint8], place: Place) -> NDArray[Any]:
        """A field of messages (n, size) of this layout, in the machine's byte order."""
        part = np.ascontiguousarray(rows[:, place.at : place.at + place.dtype.itemsize])
        flat = part.view(place.dtype.base)
        values = flat.reshape(len(rows), *place.dtype.shape) if place.dtype.shape else flat[:, 0]
        return np.asarray(values.astype(values.dtype.newbyteorder("=")))

    def fits(self, rows: NDArray[np.uint8]) -> NDArray[np.bool_]:
        """Which messages (n, size) have the same lengths in the same places."""
        same = np.ones(len(rows), bool)
        for at, length in self.lengths:
            seen = np.ascontiguousarray(rows[:, at : at + 4]).view(self._order + "u4")[:, 0]
            same &= seen == length
        return same


def table(name: str, types: dict[str, Any], kind: str, messages: Sequence[bytes], times_ns: Sequence[int]) -> Table:
    """Messages of one topic as a table; those that are laid out otherwise than most are left out.

    Column ``log_time_ns`` is when the recorder got them. ValueError where nothing can be decoded.
    """
    size = np.array([len(m) for m in messages])
    usual = int(np.bincount(size).argmax())
    chosen = np.flatnonzero(size == usual)
    rows = np.frombuffer(b"".join(messages[i] for i in chosen.tolist()), np.uint8).reshape(len(chosen), usual)
    layout = Layout(types, kind, messages[int(chosen[len(chosen) // 2])])
    same = layout.fits(rows)
    chosen, rows = chosen[same], rows[same]
    stamps = np.asarray(times_ns, np.int64)[chosen]
    places = {place.name: place for place in layout.places}
    fields = {place.name: Field(place.name, place.dtype.newbyteorder("=")) for place in layout.places}
    fields["log_time_ns"] = Field("log_time_ns", np.dtype("i8"))

    def decode(column: str, index: NDArray[Any]) -> NDArray[Any]:
        if column == "log_time_ns":
            return np.asarray(stamps[index])
        return layout.column(rows[index], places[column])

    return Table(name, 0, fields, np.arange(len(rows)), decode)
