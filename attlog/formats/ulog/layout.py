"""Where each field of a ULog message lies, from the format texts in the log.

A format text reads ``vehicle_attitude:uint64_t timestamp;float[4] q;`` and may use
other formats as types. Nested types are flattened with dotted names
(``esc[0].esc_rpm``), arrays of numbers stay one column of shape (n, k).
"""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from attlog.formats.base import Field
from attlog.limits import MAX_FIELDS, MAX_NESTING

BASIC = {
    "int8_t": "<i1", "uint8_t": "<u1", "int16_t": "<i2", "uint16_t": "<u2", "int32_t": "<i4", "uint32_t": "<u4",
    "int64_t": "<i8", "uint64_t": "<u8", "float": "<f4", "double": "<f8", "bool": "<i1",
}  # fmt: skip
"""Stored types. ``bool`` is read as a small integer because a damaged one may hold any byte."""

_FORMAT = re.compile(r"([\w/-]+):((?:[\w/]+(?:\[\d{1,5}\])? [\w\[\]]+;?)*)\s*")
_MEMBER = re.compile(r"([\w/]+)(?:\[(\d{1,5})\])? ([\w\[\]]+)")

Members = list[tuple[str, int, str]]
"""(type, array length or 0, name) in stored order."""


@dataclass(frozen=True, slots=True)
class Layout:
    """The flattened message: fields with their byte positions behind the record's id.

    ``size`` is the payload without trailing padding, ``full_size`` with it; the logger
    may write either. ``time_at`` is the position of the u64 ``timestamp``, None if absent.
    """

    fields: dict[str, Field]
    positions: dict[str, int]
    size: int
    full_size: int
    time_at: int | None

    def record(self) -> np.dtype[np.void]:
        """The payload as one packed numpy record."""
        return np.dtype(
            {
                "names": list(self.fields),
                "formats": [f.dtype for f in self.fields.values()],
                "offsets": [self.positions[name] for name in self.fields],
                "itemsize": self.size,
            }
        )


def parse_format(text: str) -> tuple[str, Members] | None:
    """Name and members of a format text, None if it is not one."""
    match = _FORMAT.fullmatch(text)
    if match is None:
        return None
    members = [(kind, int(count or 0), name) for kind, count, name in _MEMBER.findall(match[2])]
    return (match[1], members) if members else None


def layout_of(name: str, formats: Mapping[str, Members]) -> Layout | None:
    """The flattened layout of a message; None if a type is missing, nested in itself or beyond the limits."""
    placed: list[tuple[str, np.dtype[np.generic], int]] = []
    full_size = _place(name, formats, "", 0, placed, 0)
    if full_size is None:
        return None
    size = full_size
    while placed and placed[-1][0].startswith("_padding"):
        size = placed.pop()[2]
    shown = [p for p in placed if not p[0].rpartition(".")[2].startswith("_padding")]
    if not shown:
        return None
    fields = {field: Field(field, dtype) for field, dtype, _ in shown}
    positions = {field: position for field, _, position in shown}
    has_time = "timestamp" in fields and fields["timestamp"].dtype == np.dtype("<u8")
    return Layout(fields, positions, size, full_size, positions["timestamp"] if has_time else None)


def _place(
    name: str,
    formats: Mapping[str, Members],
    prefix: str,
    position: int,
    placed: list[tuple[str, np.dtype[np.generic], int]],
    depth: int,
) -> int | None:
    """Append the members of one format; returns the position behind it."""
    if depth > MAX_NESTING or name not in formats:
        return None
    for kind, count, member in formats[name]:
        if kind == "char":
            dtype = np.dtype(f"S{max(count, 1)}")
        elif kind in BASIC:
            dtype = np.dtype((BASIC[kind], (count,))) if count else np.dtype(BASIC[kind])
        else:
            elements = [f"{prefix}{member}[{i}]." for i in range(count)] if count else [f"{prefix}{member}."]
            for element in elements:
                inner = _place(kind, formats, element, position, placed, depth + 1)
                if inner is None:
                    return None
                position = inner
            continue
        placed.append((prefix + member, dtype, position))
        position += dtype.itemsize
        if len(placed) > MAX_FIELDS or position > 0xFFFF:
            return None
    return position
