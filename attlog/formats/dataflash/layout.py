"""Layout of DataFlash records: letters, message formats and their definitions, recognition.

A record is ``a3 95 type payload``; FMT records (type 128) define the length, letters and columns of every other type.
Source: ArduPilot, libraries/AP_Logger/LogStructure.h.
"""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Iterable, Iterator
from functools import lru_cache
from typing import Any, NamedTuple

import numpy as np

from attlog.core.limits import MAX_FORMATS, MAX_LAYOUTS_OF_A_NAME
from attlog.formats.table import DamageLog

RECORD_MARK = b"\xa3\x95"
HEADER_BYTES = 3
FMT_TYPE, FMT_LENGTH = 128, 89
FMT_MARK = RECORD_MARK + bytes([FMT_TYPE])
# Marks (one per 400 bytes in longer files) of a log without formats; no record is longer than 255 bytes.
MIN_MARKS = 5
_FMT_LINE = re.compile(rb"(?:^|[\r\n])[ \t]*+FMT, *+\d{1,9}+, *+\d{1,9}+, *+\w")

LETTER_DTYPES: dict[str, np.dtype[Any]] = {
    letter: np.dtype(name)
    for letter, name in zip(
        "bBhHiIqQfdgcCeELMnNZa",
        "i1 u1 <i2 <u2 <i4 <u4 <i8 <u8 <f4 <f8 <f2 <i2 <u2 <i4 <u4 <i4 u1 S4 S16 S64 (32,)<i2".split(),
        strict=True,
    )
}
_LETTER_SIZES = {letter: dtype.itemsize for letter, dtype in LETTER_DTYPES.items()}
LETTER_SCALES = {"c": 0.01, "C": 0.01, "e": 0.01, "E": 0.01, "L": 1e-7}


class MessageFormat(NamedTuple):
    """Layout of a message type from byte ``offset`` on, as defined by an FMT record."""

    type: int
    length: int
    name: str
    letters: str
    columns: tuple[str, ...]
    offset: int

    @property
    def readable(self) -> bool:
        """True if all letters are known and add up to the declared length."""
        return _length_of(self.letters) == self.length

    def place(self, k: int) -> int:
        """Return the byte position of the k-th column in the record."""
        return HEADER_BYTES + sum(map(_LETTER_SIZES.__getitem__, self.letters[:k]))

    def same_layout(self, other: MessageFormat) -> bool:
        """Return whether both describe the same bytes by the same names."""
        return self[1:5] == other[1:5]


@lru_cache(1 << 12)
def _length_of(letters: str) -> int | None:
    """Return the bytes of a record, None for unknown letters."""
    if not letters or not LETTER_DTYPES.keys() >= set(letters):
        return None
    return HEADER_BYTES + sum(map(_LETTER_SIZES.__getitem__, letters))


FMT_FORMAT = MessageFormat(FMT_TYPE, FMT_LENGTH, "FMT", "BBnNZ", ("Type", "Length", "Name", "Format", "Columns"), 0)


def parse_fmt_record(raw: bytes, offset: int) -> MessageFormat | None:
    """Return the format in an FMT record, None if invalid."""
    text = raw.decode("latin-1")
    name, letters, columns = _printable_text(text[5:9]), _printable_text(text[9:25]), _printable_text(text[25:89])
    if not name or letters is None or columns is None or raw[4] < HEADER_BYTES:
        return None
    if raw[3] == FMT_TYPE:
        return None if raw[4] != FMT_LENGTH else FMT_FORMAT
    return MessageFormat(raw[3], raw[4], name, letters, column_names(columns.split(",")) if columns else (), offset)


def _printable_text(text: str) -> str | None:
    """Return stripped text up to NUL, None if not plain ASCII."""
    text = text.partition("\0")[0]
    return text.strip() if text.isascii() and text.isprintable() else None


def column_names(listed: Iterable[str]) -> tuple[str, ...]:
    """Strip the column names; a repeated name becomes empty, so that it selects its first column."""
    names = tuple(map(str.strip, listed))
    if len(set(names)) == len(names):
        return names
    return tuple("" if name in names[:k] else name for k, name in enumerate(names))


class Definitions:
    """Distinct message formats of a log in file order.

    Redefinitions beyond the limits become formats without letters, so that their records are framed but not decoded.
    """

    def __init__(self) -> None:
        self.layouts = [FMT_FORMAT]
        self.refused: list[int] = []
        self._current: dict[int, MessageFormat] = {FMT_TYPE: FMT_FORMAT}
        self._bytes: dict[int, bytes] = {}
        self._of_name: Counter[str] = Counter()

    def take(self, raw: bytes, offset: int) -> None:
        """Add the 89 bytes of the FMT record at ``offset``."""
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

    def report(self, losses: DamageLog) -> None:
        """Report refused definitions."""
        if self.refused:
            lost = (
                f"{len(self.refused)} definitions beyond the {MAX_LAYOUTS_OF_A_NAME} of one message or the "
                f"{MAX_FORMATS} of a log that are read"
            )
            losses.add_kind(self.refused[0], FMT_LENGTH * len(self.refused), lost, "next definition")


def is_dataflash(head: bytes) -> bool:
    """Return whether a file begins with a format definition or many record marks."""
    if head[:2] == RECORD_MARK and len(head) < FMT_LENGTH:
        return True
    if any(True for _ in _formats_in(head)):
        return True
    return head.count(RECORD_MARK) >= max(MIN_MARKS, len(head) // 400)


def is_dataflash_text(head: bytes) -> bool:
    """Return whether a file begins with text that defines a format."""
    return b"\0" not in head[:4096] and _FMT_LINE.search(head) is not None


def _formats_in(head: bytes) -> Iterator[MessageFormat]:
    at = head.find(FMT_MARK)
    while at >= 0 and at + FMT_LENGTH <= len(head):
        found = parse_fmt_record(head[at : at + FMT_LENGTH], at)
        if found is not None and LETTER_DTYPES.keys() >= set(found.letters):
            yield found
        at = head.find(FMT_MARK, at + len(FMT_MARK))
