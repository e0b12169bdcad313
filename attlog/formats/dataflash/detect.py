"""Does a file hold DataFlash records or lines?"""

from __future__ import annotations

import re
from collections.abc import Iterator

from attlog.formats.dataflash.compiled import FMT_LENGTH, FMT_TYPE
from attlog.formats.dataflash.index import LETTER_DTYPES, MessageFormat, parse_format

MARK = b"\xa3\x95"
"""Before every binary record."""
FEWEST_MARKS = 5
"""Marks that show a log whose formats are lost (one per 400 bytes in longer files): no record is longer than 255."""
_FMT_LINE = re.compile(rb"(?:^|[\r\n])[ \t]*+FMT, *+\d{1,9}+, *+\d{1,9}+, *+\w")


def is_binary(head: bytes) -> bool:
    """A format definition, or (the start is lost) many record marks at the start."""
    if head[:2] == MARK and len(head) < FMT_LENGTH:
        return True
    if any(True for _ in formats(head)):
        return True
    return head.count(MARK) >= max(FEWEST_MARKS, len(head) // 400)


def is_text(head: bytes) -> bool:
    """A line that defines a format, and no NUL near the start."""
    return b"\0" not in head[:4096] and _FMT_LINE.search(head) is not None


def formats(head: bytes) -> Iterator[MessageFormat]:
    """The formats that FMT records define, in binary framing."""
    fmt_mark = MARK + bytes([FMT_TYPE])
    at = head.find(fmt_mark)
    while at >= 0 and at + FMT_LENGTH <= len(head):
        found = parse_format(head[at : at + FMT_LENGTH], at)
        if found is not None and LETTER_DTYPES.keys() >= set(found.letters):
            yield found
        at = head.find(fmt_mark, at + len(fmt_mark))
