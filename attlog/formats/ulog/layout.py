"""Where each field of a ULog message lies, from the format texts in the log.

A format text reads ``vehicle_attitude:uint64_t timestamp;float[4] q;`` and may use
other formats as types. Nested types are flattened with dotted names
(``esc[0].esc_rpm``), arrays of numbers stay one column of shape (n, k).

A few bytes of text can ask for any number of columns (``n1[99999] a`` in ``n0``, and so
on). What a format amounts to is therefore counted first, each format once; columns are
written out only for accepted formats, when somebody asks for them.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from functools import cached_property, lru_cache
from types import MappingProxyType

import numpy as np

from attlog.base.limits import MAX_FIELDS, MAX_NESTING
from attlog.formats.base import Field

BASIC = {
    "int8_t": "<i1",
    "uint8_t": "<u1",
    "int16_t": "<i2",
    "uint16_t": "<u2",
    "int32_t": "<i4",
    "uint32_t": "<u4",
    "int64_t": "<i8",
    "uint64_t": "<u8",
    "float": "<f4",
    "double": "<f8",
    "bool": "<i1",
}
"""Stored types. ``bool`` is read as a small integer because a damaged one may hold any byte."""
LARGEST = 0xFFFF - 2
"""Bytes of a data record's payload behind the id: the record's size is a u16."""

USUAL = 2048
"""Letters of a format text up to which what it says is remembered."""

_NAME = re.compile(r"[\w/-]+")
_MEMBER = re.compile(r"([\w/]+)(?:\[(\d{1,20})\])? ([\w\[\]]+)")
_WIDTH = {kind: int(dtype[2:]) for kind, dtype in BASIC.items()} | {"char": 1}
_SINGLE = {kind: np.dtype(dtype) for kind, dtype in BASIC.items()} | {"char": np.dtype("S1")}

Members = list[tuple[str, int | None, str]]
"""(type, array length or None, name) in stored order."""


@dataclass(frozen=True, slots=True)
class _Extent:
    """What a format amounts to when it is flattened; ``why_not`` says why it cannot be used."""

    size: int = 0
    columns: int = 0
    height: int = 1
    why_not: str = ""


class TopicLayout:
    """The flattened message: fields with their byte positions behind the record's id.

    ``size`` is the payload without trailing padding, ``full_size`` with it; the logger
    may write either. ``time_at`` is the position of the u64 ``timestamp``, None if absent.
    ``columns`` counts the fields with padding.
    """

    def __init__(self, name: str, formats: Formats, size: int, full_size: int, columns: int, time_at: int | None):
        self.name, self._formats = name, formats
        self.size, self.full_size, self.columns, self.time_at = size, full_size, columns, time_at

    def __eq__(self, other: object) -> bool:
        """Whether records of both are read alike."""
        if self is other:
            return True
        return isinstance(other, TopicLayout) and self.size == other.size and self._placed == other._placed

    __hash__ = None  # type: ignore[assignment]

    @cached_property
    def fields(self) -> dict[str, Field]:
        """The columns that are shown, in stored order."""
        return {name: Field(name, dtype) for name, (dtype, _) in self._placed.items()}

    @cached_property
    def record(self) -> np.dtype[np.void]:
        """The payload as one packed numpy record."""
        return np.dtype(
            {
                "names": list(self._placed),
                "formats": [dtype for dtype, _ in self._placed.values()],
                "offsets": [position for _, position in self._placed.values()],
                "itemsize": self.size,
            }
        )

    @cached_property
    def _placed(self) -> dict[str, tuple[np.dtype[np.generic], int]]:
        placed: dict[str, tuple[np.dtype[np.generic], int]] = {}
        for name, dtype, position in self._formats.flattened(self.name):
            if not name.rpartition(".")[2].startswith("_padding") and position + dtype.itemsize <= self.size:
                placed.setdefault(name, (dtype, position))  # nothing can ask for a second field of a name
        return placed


class Formats:
    """The format texts of one log by name, and what they amount to. A text once used is never changed."""

    def __init__(self, texts: Mapping[str, str] = MappingProxyType({})) -> None:
        self.texts = dict(texts)
        self._members: dict[str, Members | None] = {}
        self._extents: dict[str, _Extent] = {}
        self._layouts: dict[str, TopicLayout | str] = {}

    def is_used(self, name: str) -> bool:
        """Whether something was concluded from this name's text, or from its lack."""
        return name in self._members

    def layout(self, name: str) -> TopicLayout | str:
        """The flattened layout of a message, or why there is none."""
        if name not in self._layouts:
            self._layouts[name] = self._layout(name)
        return self._layouts[name]

    def flattened(self, name: str, prefix: str = "", at: int = 0) -> Iterable[tuple[str, np.dtype[np.generic], int]]:
        """Name, type and position of each column of a format that was accepted, padding too."""
        for kind, count, member in self._members_of(name) or ():
            if count == 0:
                continue
            if kind not in _WIDTH:
                inner = self._extents[kind]
                if inner.columns:
                    for element in [f"{member}."] if count is None else (f"{member}[{i}]." for i in range(count)):
                        yield from self.flattened(kind, prefix + element, at)
                        at += inner.size
                continue
            dtype = _SINGLE[kind]
            if count is not None:
                dtype = np.dtype(f"S{count}") if kind == "char" else np.dtype((dtype, (count,)))
            yield prefix + member, dtype, at
            at += dtype.itemsize

    def _layout(self, name: str) -> TopicLayout | str:
        extent = self._extent(name)
        if extent.why_not:
            return extent.why_not
        time_at, timed, at, shown = None, False, 0, 0
        for kind, count, member in self._members_of(name) or ():
            if member == "timestamp" and kind in _WIDTH and count != 0 and not timed:
                timed = True
                time_at = at if kind == "uint64_t" and count is None else None
            at += self._bytes(kind, count)
            shown = shown if member.startswith("_padding") else at
        if not shown:
            return "it holds nothing"
        return TopicLayout(name, self, shown, extent.size, extent.columns, time_at)

    def _bytes(self, kind: str, count: int | None) -> int:
        return (_WIDTH[kind] if kind in _WIDTH else self._extents[kind].size) * (1 if count is None else count)

    def _extent(self, name: str) -> _Extent:
        """Counts a format and what it is made of, each once; no recursion, because definitions may nest at will."""
        waiting, opened = [name], set()
        while waiting:
            top = waiting[-1]
            members = None if top in self._extents else self._members_of(top)
            if members is None:
                if top not in self._extents:
                    why = "cannot be read" if top in self.texts else "is missing"
                    self._extents[top] = _Extent(why_not=f"the definition of {top} {why}")
                waiting.pop()
                continue
            inner = [kind for kind, _, _ in members if kind not in _WIDTH and kind not in self._extents]
            if inner and top not in opened:
                opened.add(top)
                waiting += dict.fromkeys(inner)
                continue
            self._extents[top] = _Extent(why_not=f"{top} contains itself") if inner else self._sum(top, members)
            waiting.pop()
        return self._extents[name]

    def _sum(self, name: str, members: Members) -> _Extent:
        size = columns = 0
        height = 1
        for kind, count, _ in members:
            if kind not in _WIDTH:
                inner = self._extents[kind]
                if inner.why_not:
                    return inner
                columns += inner.columns * (1 if count is None else count)
                height = max(height, 1 + inner.height)
            else:
                columns += count != 0
            size += self._bytes(kind, count)
        if size > LARGEST:
            return _Extent(why_not=f"{name} asks for {size} bytes, a record holds {LARGEST}")
        if columns > MAX_FIELDS:
            return _Extent(why_not=f"{name} asks for {columns} fields, more than the {MAX_FIELDS} that are read")
        if height > MAX_NESTING + 1:
            return _Extent(why_not=f"{name} nests its types more than {MAX_NESTING} deep")
        return _Extent(size, columns, height)

    def _members_of(self, name: str) -> Members | None:
        if name not in self._members:
            text = self.texts.get(name)
            members_in = _members_in if text is not None and len(text) < USUAL else _members_in.__wrapped__
            self._members[name] = None if text is None else members_in(text)
        return self._members[name]


@lru_cache(1 << 10)
def _members_in(text: str) -> Members | None:
    """The members of a format text of usual length: logs of one firmware define the same ones."""
    parsed = parse_format(text)
    return None if parsed is None else parsed[1]


def parse_format(text: str) -> tuple[str, Members] | None:
    """Name and members of a format text, None if it is not one."""
    name, _, described = text.partition(":")
    if _NAME.fullmatch(name) is None:
        return None
    parts = described.rstrip().removesuffix(";").split(";")
    found = [_MEMBER.fullmatch(part) for part in parts]
    members = [(m[1], None if m[2] is None else int(m[2]), m[3]) for m in found if m is not None]
    return (name, members) if len(members) == len(parts) else None
