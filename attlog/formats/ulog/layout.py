"""Layout of ULog records: fields of topics from the format texts, checks of all other records, definitions of a log.

A format text reads ``vehicle_attitude:uint64_t timestamp;float[4] q;`` and may use other formats as types. Nested types
are flattened with dotted names (``esc[0].esc_rpm``); arrays of numbers stay one column of shape (n, k). A few bytes of
text can ask for any number of columns (``n1[99999] a`` in ``n0``, and so on), so the extent of each format is counted
first, and columns are made only of accepted formats. ULog file format:
https://docs.px4.io/main/en/dev_log/ulog_file_format.html
"""

from __future__ import annotations

import re
import struct
from collections.abc import Callable, Iterable, Mapping
from functools import cached_property, lru_cache
from types import MappingProxyType
from typing import Any, NamedTuple

import numpy as np

from attlog.core.limits import MAX_FIELDS, MAX_FORMATS, MAX_NESTING, MAX_REDEFINED, MAX_RESUBSCRIBED
from attlog.formats.file_bytes import ERASED
from attlog.formats.table import DamageLog, Field

# Stored types. ``bool`` is read as a small integer because a damaged one may hold any byte.
BASIC_TYPES = dict(
    zip(
        "int8_t uint8_t int16_t uint16_t int32_t uint32_t int64_t uint64_t float double bool".split(),
        "<i1 <u1 <i2 <u2 <i4 <u4 <i8 <u8 <f4 <f8 <i1".split(),
        strict=True,
    )
)
# Payload of a data record behind the id; the record's size is a u16.
MAX_PAYLOAD_BYTES = 0xFFFF - 2

# Longer format texts are not cached.
MAX_CACHED_LETTERS = 2048

_FORMAT_NAME = re.compile(r"[\w/-]+")
_MEMBER_PATTERN = re.compile(r"([\w/]+)(?:\[(\d{1,20})\])? ([\w\[\]]+)")
_TYPE_WIDTHS = {kind: int(dtype[2:]) for kind, dtype in BASIC_TYPES.items()} | {"char": 1}
_TYPE_DTYPES = {kind: np.dtype(dtype) for kind, dtype in BASIC_TYPES.items()} | {"char": np.dtype("S1")}

# (type, array length or None, name) in stored order.
Members = list[tuple[str, int | None, str]]


class _Extent(NamedTuple):
    """Size of a flattened format, or why it cannot be used."""

    size: int = 0
    columns: int = 0
    height: int = 1
    why_not: str = ""


class TopicLayout:
    """Layout of a flattened message: fields with their byte positions behind the record's id.

    ``size`` is the payload without trailing padding, ``full_size`` with it; the logger may write either. ``time_at`` is
    the position of the u64 ``timestamp``, None if absent. ``columns`` counts the fields with padding.
    """

    def __init__(self, name: str, formats: Formats, size: int, full_size: int, columns: int, time_at: int | None):
        self.name, self._formats = name, formats
        self.size, self.full_size, self.columns, self.time_at = size, full_size, columns, time_at

    def __eq__(self, other: object) -> bool:
        """Return whether records of both layouts are decoded identically."""
        if self is other:
            return True
        return isinstance(other, TopicLayout) and self.size == other.size and self._placed == other._placed

    __hash__ = None  # type: ignore[assignment]

    @cached_property
    def fields(self) -> dict[str, Field]:
        """The visible columns, in stored order."""
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
                placed.setdefault(name, (dtype, position))  # only the first field of a name can be asked for
        return placed


class Formats:
    """Format texts of one log, with extents and layouts; a text that was used is never changed."""

    def __init__(self, texts: Mapping[str, str] = MappingProxyType({})) -> None:
        self.texts = dict(texts)
        self._members: dict[str, Members | None] = {}
        self._extents: dict[str, _Extent] = {}
        self._layouts: dict[str, TopicLayout | str] = {}

    def is_used(self, name: str) -> bool:
        """Return whether the format of this name was used, or found missing."""
        return name in self._members

    def layout(self, name: str) -> TopicLayout | str:
        """Return the layout of a message, or the reason why it cannot be used."""
        if name not in self._layouts:
            self._layouts[name] = self._layout(name)
        return self._layouts[name]

    def flattened(self, name: str, prefix: str = "", at: int = 0) -> Iterable[tuple[str, np.dtype[np.generic], int]]:
        """Yield name, type and position of each column, padding included."""
        for kind, count, member in self._members_of(name) or ():
            if count == 0:
                continue
            if kind not in _TYPE_WIDTHS:
                inner = self._extents[kind]
                if inner.columns:
                    for element in [f"{member}."] if count is None else (f"{member}[{i}]." for i in range(count)):
                        yield from self.flattened(kind, prefix + element, at)
                        at += inner.size
                continue
            dtype = _TYPE_DTYPES[kind]
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
            if member == "timestamp" and kind in _TYPE_WIDTHS and count != 0 and not timed:
                timed = True
                time_at = at if kind == "uint64_t" and count is None else None
            at += self._bytes(kind, count)
            shown = shown if member.startswith("_padding") else at
        if not shown:
            return "it holds nothing"
        return TopicLayout(name, self, shown, extent.size, extent.columns, time_at)

    def _bytes(self, kind: str, count: int | None) -> int:
        return (_TYPE_WIDTHS[kind] if kind in _TYPE_WIDTHS else self._extents[kind].size) * (
            1 if count is None else count
        )

    def _extent(self, name: str) -> _Extent:
        """Return the size of a format with its nested types, without recursion."""
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
            inner = [kind for kind, _, _ in members if kind not in _TYPE_WIDTHS and kind not in self._extents]
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
            if kind not in _TYPE_WIDTHS:
                inner = self._extents[kind]
                if inner.why_not:
                    return inner
                columns += inner.columns * (1 if count is None else count)
                height = max(height, 1 + inner.height)
            else:
                columns += count != 0
            size += self._bytes(kind, count)
        if size > MAX_PAYLOAD_BYTES:
            return _Extent(why_not=f"{name} asks for {size} bytes, a record holds {MAX_PAYLOAD_BYTES}")
        if columns > MAX_FIELDS:
            return _Extent(why_not=f"{name} asks for {columns} fields, more than the {MAX_FIELDS} that are read")
        if height > MAX_NESTING + 1:
            return _Extent(why_not=f"{name} nests its types more than {MAX_NESTING} deep")
        return _Extent(size, columns, height)

    def _members_of(self, name: str) -> Members | None:
        if name not in self._members:
            text = self.texts.get(name)
            members_in = _members_in if text is not None and len(text) < MAX_CACHED_LETTERS else _members_in.__wrapped__
            self._members[name] = None if text is None else members_in(text)
        return self._members[name]


@lru_cache(1 << 10)
def _members_in(text: str) -> Members | None:
    """Return the members of a format text, cached."""
    parsed = parse_format(text)
    return None if parsed is None else parsed[1]


def parse_format(text: str) -> tuple[str, Members] | None:
    """Parse a format text into name and members, None if invalid."""
    name, _, described = text.partition(":")
    if _FORMAT_NAME.fullmatch(name) is None:
        return None
    parts = described.rstrip().removesuffix(";").split(";")
    found = [_MEMBER_PATTERN.fullmatch(part) for part in parts]
    members = [(m[1], None if m[2] is None else int(m[2]), m[3]) for m in found if m is not None]
    return (name, members) if len(members) == len(parts) else None


# Records that are not data. Types: B flags, I info, M info in parts, F format, P parameter, Q default parameter,
# A subscription, R unsubscription, D data, L text, C text with tag, S synchronisation mark, O dropout. The checks are
# strict enough to find records among garbage.

MAGIC = b"ULog\x01\x12\x35"
FILE_HEADER = 16
SYNC = b"\x2f\x73\x13\x20\x25\x0c\xbb\x12"
SYNC_MARK = b"\x08\x00S" + SYNC
# Records of unknown type with a longer payload count as garbage.
MAX_UNKNOWN_BYTES = 10_000
# Letters of a topic's name, as in file systems and keys.
MAX_TOPIC_LETTERS = 255
# Bits of a default's kind: of the firmware, and of the airframe's configuration.
FIRMWARE_DEFAULT, AIRFRAME_DEFAULT = 1, 2
# Longer messages must be ASCII to differ from garbage.
MAX_BINARY_TEXT_BYTES = 1024
# Bytes of a payload that are checked: every byte of garbage may claim a record of 64 kB.
MAX_HEAD_BYTES = 2 * MAX_BINARY_TEXT_BYTES

_KEY_PATTERN = re.compile(rb"[\w/]+(?:\[\d{1,5}\])? [^\x00-\x20\x7f]+")
_FORMAT_START_PATTERN = re.compile(rb"[\w/-]{1,255}:[\w/]{1,255}(?:\[\d{1,20}\])? [\w\[\]]+")
# Position of the name, or of its length, in the payload.
_NAME_AT = {ord("F"): 0, ord("A"): 3, ord("I"): 0, ord("P"): 0, ord("M"): 1, ord("Q"): 1}
_TOPIC_PATTERN = re.compile(rb"[\w/-]+")
_PARAMETER_STRUCTS = {"int32_t": struct.Struct("<i"), "float": struct.Struct("<f")}


def is_record(kind: int, head: bytes, size: int) -> bool:
    """Return whether a payload of ``size`` bytes is valid for its type (all but D), by its ``head``."""
    check = _CHECKS.get(kind)
    return check is not None and check(head, size)


def is_odd_definition(kind: int, head: bytes, size: int) -> bool:
    """Return whether a record is a printable definition under an unusual name.

    It is accepted behind a valid record, but not when records are searched among damaged bytes.
    """
    at = _NAME_AT.get(kind)
    if at is None or size <= at or size > len(head):
        return False
    if kind in b"IMPQ":
        at, size = at + 1, at + 1 + head[at]
    try:
        name = head[at:size].decode("utf-8")
    except UnicodeDecodeError:
        return False
    return bool(name) and size <= len(head) and name.isprintable()


def decode_ulog_text(raw: bytes) -> str:
    """Decode text up to NUL, with replacement characters."""
    return raw.split(b"\0", 1)[0].decode("utf-8", "replace")


def split_key(payload: bytes) -> tuple[str, str, bytes]:
    """Return type, name and value bytes of a keyed payload.

    Of types I and P, and of M and Q behind their first byte.
    """
    end = 1 + payload[0]
    kind, _, name = payload[1:end].decode("utf-8", "replace").partition(" ")
    return kind, name, payload[end:]


def info_value(kind: str, raw: bytes) -> Any:
    """Return an info value as text or number, else as bytes."""
    if kind == "char" or kind.startswith("char["):
        return decode_ulog_text(raw)
    if kind not in BASIC_TYPES or len(raw) < _TYPE_WIDTHS[kind]:
        return raw
    value = np.frombuffer(raw, BASIC_TYPES[kind], 1)[0].item()
    return bool(value) if kind == "bool" else value


def parameter_value(kind: str, raw: bytes) -> float | int | None:
    """Return a parameter's value, None for other types than int32_t and float."""
    form = _PARAMETER_STRUCTS.get(kind)
    return form.unpack_from(raw)[0] if form is not None and len(raw) >= 4 else None


def _is_keyed(head: bytes, size: int, at: int = 0) -> bool:
    end = at + 1 + head[at] if size > at + 3 else size + 1
    return end <= size and _KEY_PATTERN.fullmatch(head, at + 1, end) is not None


def _is_info(head: bytes, size: int, at: int = 0) -> bool:
    if not _is_keyed(head, size, at):
        return False
    kind, _, _ = split_key(head[at:])
    base, _, count = kind.rstrip("]").partition("[")
    width = 1 if base == "char" else int(BASIC_TYPES[base][2:]) if base in BASIC_TYPES else 0
    return width > 0 and size - at - 1 - head[at] == width * (int(count) if count else 1)


def _is_parameter(head: bytes, size: int, at: int = 0) -> bool:
    named = head.startswith((b"int32_t ", b"float "), at + 1)
    return named and 6 < head[at] < 64 and size - at == head[at] + 5


def _is_text(head: bytes, size: int, least: int) -> bool:
    if size < least or not 0x30 <= head[0] <= 0x37:
        return False
    return size <= MAX_BINARY_TEXT_BYTES or head.isascii()


_CHECKS: dict[int, Callable[[bytes, int], bool]] = {
    ord("B"): lambda p, n: 40 <= n <= 256,
    ord("I"): _is_info,
    ord("M"): lambda p, n: n > 5 and p[0] <= 1 and _is_info(p, n, 1),
    ord("F"): lambda p, n: _FORMAT_START_PATTERN.match(p) is not None,
    ord("P"): _is_parameter,
    ord("Q"): lambda p, n: n > 5 and p[0] <= 15 and _is_parameter(p, n, 1),
    ord("A"): lambda p, n: 3 < n <= 3 + MAX_TOPIC_LETTERS and _TOPIC_PATTERN.fullmatch(p, 3) is not None,
    ord("R"): lambda p, n: n == 2,
    ord("L"): lambda p, n: _is_text(p, n, 9),
    ord("C"): lambda p, n: _is_text(p, n, 11),
    ord("S"): lambda p, n: p == SYNC,
    ord("O"): lambda p, n: n == 2,
}


class Subscription(NamedTuple):
    """Topic, instance and layout of an id."""

    name: str
    multi: int
    layout: TopicLayout


class Definitions:
    """The formats and subscriptions of one power-up, within the limits of a log."""

    def __init__(self) -> None:
        self.by_id: dict[int, Subscription] = {}
        self.why_not: dict[int, tuple[str, str]] = {}
        self._formats = Formats()
        self._redefined = self._resubscribed = self._too_many = 0
        self._free_of_size: dict[int, list[tuple[str, TopicLayout]]] | None = None

    def declare(self, text: str) -> None:
        """Add a format text; it is parsed on first use."""
        name = text.partition(":")[0]
        known = self._formats.texts.get(name)
        if known == text:
            return
        if known is None and len(self._formats.texts) >= MAX_FORMATS:
            self._too_many += 1
        elif not self._formats.is_used(name):
            self._formats.texts[name] = text
        elif self._redefined < MAX_REDEFINED:
            self._redefined += 1
            self._formats = Formats(self._formats.texts | {name: text})
        else:
            self._redefined += 1

    def subscription(self, identifier: int, name: str, multi: int) -> Subscription | None:
        """Return topic, instance and layout of an id by its subscription, None if its format is unusable."""
        layout = self._formats.layout(name)
        before = self.by_id.get(identifier)
        if isinstance(layout, str):
            self.why_not.setdefault(identifier, (name, layout))
            return None
        now = Subscription(name, multi, layout)
        if before is None or before == now:
            return before or now
        self._resubscribed += 1
        return before if self._resubscribed > MAX_RESUBSCRIBED else now

    def without_subscription(self, size: int) -> list[tuple[str, TopicLayout]]:
        """Return the formats without subscription that fit records of ``size`` bytes (id not included)."""
        if self._free_of_size is None:
            self._free_of_size = {}
            subscribed = {subscription.name for subscription in self.by_id.values()}
            for name in sorted(self._formats.texts.keys() - subscribed):
                layout = self._formats.layout(name)
                if isinstance(layout, TopicLayout):
                    for length in {layout.size, layout.full_size}:
                        self._free_of_size.setdefault(length, []).append((name, layout))
        return self._free_of_size.get(size, [])

    def report(self, losses: DamageLog) -> None:
        """Report unusable definitions and exceeded limits, each sentence once."""
        known = {remark.text for remark in losses.remarks}
        refused = dict(self.why_not.values())
        others = {1: "", 2: "; one other topic neither"}.get(len(refused), f"; {len(refused) - 1} other topics neither")
        for name, why in list(refused.items())[:1]:
            text = f"{name} cannot be used: {why}{others}."
            if text not in known:
                losses.add_remark("unreadable_message", text, count=len(refused))
        for beyond, most, what, then in (
            (self._too_many, MAX_FORMATS, "formats", "the others are not read"),
            (self._redefined - MAX_REDEFINED, MAX_REDEFINED, "formats declared anew", "then they stay"),
            (self._resubscribed - MAX_RESUBSCRIBED, MAX_RESUBSCRIBED, "ids that change their topic", "then they stay"),
        ):
            text = f"The log has {most + beyond} {what}; the first {most} count, {then}."
            if beyond > 0 and text not in known:
                losses.add_limit(text, count=beyond)


# First bytes of an encrypted log, and of the key beside one of PX4 1.13 to 1.15.
ENCRYPTED_MAGIC, KEY_FILE_MAGIC = b"ULogEnc", b"ULogKey"


def is_ulog(head: bytes) -> bool:
    """Return whether a file is a ULog, encrypted or not."""
    return head.lstrip(ERASED).startswith((MAGIC, ENCRYPTED_MAGIC, KEY_FILE_MAGIC))
