"""What a ULog record that is not data may look like, checked strictly enough to find records among garbage.

Types (one letter): B flags, I info, M info in parts, F format, P parameter,
Q default parameter, A subscription, R unsubscription, D data, L text,
C text with tag, S synchronisation mark, O dropout. ULog file format:
https://docs.px4.io/main/en/dev_log/ulog_file_format.html
"""

from __future__ import annotations

import re
import struct
from collections.abc import Callable
from typing import Any

from attlog.formats.ulog.layout import BASIC

MAGIC = b"ULog\x01\x12\x35"
FILE_HEADER = 16
SYNC = b"\x2f\x73\x13\x20\x25\x0c\xbb\x12"
SYNC_MARK = b"\x08\x00S" + SYNC
LARGEST_UNKNOWN = 10_000
"""Payload bytes that a record of a type we do not know may have before it counts as garbage."""
LONGEST_NAME = 255
"""Characters of a topic's name; file systems and keys end there too."""
LONGEST_BINARY_TEXT = 1024
"""Bytes of a message that may hold anything; longer ones must be ASCII to be told from garbage."""
ENOUGH = 2 * LONGEST_BINARY_TEXT
"""Bytes of a payload that tell whether it is one: every byte of garbage may be asked, and claim 64 kB."""

_KEY = re.compile(rb"[\w/]+(?:\[\d{1,5}\])? [^\x00-\x20\x7f]+")
_FORMAT_START = re.compile(rb"[\w/-]{1,255}:[\w/]{1,255}(?:\[\d{1,20}\])? [\w\[\]]+")
_NAME_AT = {ord("F"): 0, ord("A"): 3, ord("I"): 0, ord("P"): 0, ord("M"): 1, ord("Q"): 1}
"""Where the name, or its length, begins in the payload."""
_TOPIC = re.compile(rb"[\w/-]+")
_NUMBERS = {"int32_t": struct.Struct("<i"), "float": struct.Struct("<f")}
_SCALARS = {
    "int8_t": "<b",
    "uint8_t": "<B",
    "int16_t": "<h",
    "uint16_t": "<H",
    "int32_t": "<i",
    "uint32_t": "<I",
    "int64_t": "<q",
    "uint64_t": "<Q",
    "float": "<f",
    "double": "<d",
    "bool": "<?",
}


def is_record(kind: int, head: bytes, size: int) -> bool:
    """Whether a payload of ``size`` bytes, of which ``head`` are the first :data:`ENOUGH`, is what the type demands.

    All types but D.
    """
    check = _CHECKS.get(kind)
    return check is not None and check(head, size)


def is_odd_definition(kind: int, head: bytes, size: int) -> bool:
    """Whether a payload defines something under a name that no logger gives: framed as the type demands, in letters.

    Enough for a record that follows a good one; not to find records among garbage.
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


def text(raw: bytes) -> str:
    """Text up to the first NUL; bytes that are no UTF-8 become replacement characters."""
    return raw.split(b"\0", 1)[0].decode("utf-8", "replace")


def keyed(payload: bytes) -> tuple[str, str, bytes]:
    """Type, name and value bytes of an I, P or (behind its first byte) M and Q payload."""
    end = 1 + payload[0]
    kind, _, name = payload[1:end].decode("utf-8", "replace").partition(" ")
    return kind, name, payload[end:]


def info_value(kind: str, raw: bytes) -> Any:
    """An info value as text, number, or bytes where it is an array or none of these."""
    if kind == "char" or kind.startswith("char["):
        return text(raw)
    form = _SCALARS.get(kind)
    if form is not None and len(raw) >= struct.calcsize(form):
        return struct.unpack_from(form, raw)[0]
    return raw


def parameter_value(kind: str, raw: bytes) -> float | int | None:
    """A parameter's value, None if the type is neither int32_t nor float."""
    form = _NUMBERS.get(kind)
    return form.unpack_from(raw)[0] if form is not None and len(raw) >= 4 else None


def _keyed(head: bytes, size: int, at: int = 0) -> bool:
    end = at + 1 + head[at] if size > at + 3 else size + 1
    return end <= size and _KEY.fullmatch(head, at + 1, end) is not None


def _is_info(head: bytes, size: int, at: int = 0) -> bool:
    if not _keyed(head, size, at):
        return False
    kind, _, _ = keyed(head[at:])
    base, _, count = kind.rstrip("]").partition("[")
    width = 1 if base == "char" else int(BASIC[base][2:]) if base in BASIC else 0
    return width > 0 and size - at - 1 - head[at] == width * (int(count) if count else 1)


def _is_parameter(head: bytes, size: int, at: int = 0) -> bool:
    named = head.startswith((b"int32_t ", b"float "), at + 1)
    return named and 6 < head[at] < 64 and size - at == head[at] + 5


def _is_text(head: bytes, size: int, least: int) -> bool:
    if size < least or not 0x30 <= head[0] <= 0x37:
        return False
    return size <= LONGEST_BINARY_TEXT or head.isascii()


_CHECKS: dict[int, Callable[[bytes, int], bool]] = {
    ord("B"): lambda p, n: 40 <= n <= 256,
    ord("I"): _is_info,
    ord("M"): lambda p, n: n > 5 and p[0] <= 1 and _is_info(p, n, 1),
    ord("F"): lambda p, n: _FORMAT_START.match(p) is not None,
    ord("P"): _is_parameter,
    ord("Q"): lambda p, n: n > 5 and p[0] <= 15 and _is_parameter(p, n, 1),
    ord("A"): lambda p, n: 3 < n <= 3 + LONGEST_NAME and _TOPIC.fullmatch(p, 3) is not None,
    ord("R"): lambda p, n: n == 2,
    ord("L"): lambda p, n: _is_text(p, n, 9),
    ord("C"): lambda p, n: _is_text(p, n, 11),
    ord("S"): lambda p, n: p == SYNC,
    ord("O"): lambda p, n: n == 2,
}
