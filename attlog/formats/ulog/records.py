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

_KEY = re.compile(rb"[\w/]+(?:\[\d{1,5}\])? [^\x00-\x20\x7f]+")
_FORMAT_START = re.compile(rb"[\w/-]+:[\w/]+(?:\[\d{1,5}\])? [\w\[\]]+")
_TOPIC = re.compile(rb"[\w/-]+")
_NUMBERS = {"int32_t": struct.Struct("<i"), "float": struct.Struct("<f")}
_SCALARS = {
    "int8_t": "<b", "uint8_t": "<B", "int16_t": "<h", "uint16_t": "<H", "int32_t": "<i", "uint32_t": "<I",
    "int64_t": "<q", "uint64_t": "<Q", "float": "<f", "double": "<d", "bool": "<?",
}  # fmt: skip


def is_record(kind: int, payload: bytes) -> bool:
    """Whether the payload is what a record of this type must look like (all types but D)."""
    check = _CHECKS.get(kind)
    return check is not None and check(payload)


def text(raw: bytes) -> str:
    """Text up to the first NUL; bytes that are no UTF-8 become replacement characters."""
    return raw.split(b"\0", 1)[0].decode("utf-8", "replace")


def keyed(payload: bytes) -> tuple[str, str, bytes]:
    """Type, name and value bytes of an I, P or (behind its first byte) M and Q payload."""
    key = payload[1 : 1 + payload[0]].decode("utf-8", "replace")
    kind, _, name = key.partition(" ")
    return kind, name, payload[1 + payload[0] :]


def info_value(kind: str, raw: bytes) -> Any:
    """An info value as text, number, or bytes where it is an array."""
    if kind.startswith("char"):
        return text(raw)
    form = _SCALARS.get(kind)
    if form is not None and len(raw) >= struct.calcsize(form):
        return struct.unpack_from(form, raw)[0]
    return raw


def parameter_value(kind: str, raw: bytes) -> float | int | None:
    """A parameter's value, None if the type is neither int32_t nor float."""
    form = _NUMBERS.get(kind)
    return form.unpack_from(raw)[0] if form is not None and len(raw) >= 4 else None


def _keyed(payload: bytes, longest: int) -> bool:
    if len(payload) < 4 or len(payload) < 1 + payload[0]:
        return False
    return len(payload) - 1 - payload[0] <= longest and _KEY.fullmatch(payload, 1, 1 + payload[0]) is not None


def _is_info(payload: bytes) -> bool:
    if not _keyed(payload, 0xFFFF):
        return False
    kind, _, raw = keyed(payload)
    base, _, count = kind.rstrip("]").partition("[")
    width = 1 if base == "char" else int(BASIC[base][2:]) if base in BASIC else 0
    return width > 0 and len(raw) == width * (int(count) if count else 1)


def _is_parameter(payload: bytes) -> bool:
    named = payload.startswith((b"int32_t ", b"float "), 1)
    return named and 6 < payload[0] < 64 and len(payload) == payload[0] + 5


def _is_text(payload: bytes, head: int) -> bool:
    if len(payload) < head or not 0x30 <= payload[0] <= 0x37:
        return False
    return len(payload) <= LONGEST_BINARY_TEXT or payload.isascii()


_CHECKS: dict[int, Callable[[bytes], bool]] = {
    ord("B"): lambda p: 40 <= len(p) <= 256,
    ord("I"): _is_info,
    ord("M"): lambda p: len(p) > 5 and p[0] <= 1 and _is_info(p[1:]),
    ord("F"): lambda p: _FORMAT_START.match(p) is not None,
    ord("P"): _is_parameter,
    ord("Q"): lambda p: len(p) > 5 and p[0] <= 15 and _is_parameter(p[1:]),
    ord("A"): lambda p: 3 < len(p) <= 3 + LONGEST_NAME and _TOPIC.fullmatch(p, 3) is not None,
    ord("R"): lambda p: len(p) == 2,
    ord("L"): lambda p: _is_text(p, 9),
    ord("C"): lambda p: _is_text(p, 11),
    ord("S"): lambda p: p == SYNC,
    ord("O"): lambda p: len(p) == 2,
}
