"""DataFlash records from their description alone: struct and nothing of the package."""

from __future__ import annotations

import struct

LETTERS = {"b": "b", "B": "B", "h": "h", "H": "H", "i": "i", "I": "I", "q": "q", "Q": "Q", "f": "f", "d": "d"}
LETTERS |= {"n": "4s", "N": "16s", "Z": "64s", "c": "h", "C": "H", "e": "i", "E": "I", "L": "i", "M": "B"}


def record(kind: int, letters: str, *values: object) -> bytes:
    return b"\xa3\x95" + bytes([kind]) + struct.pack("<" + "".join(LETTERS[x] for x in letters), *values)


def size(letters: str) -> int:
    return 3 + struct.calcsize("<" + "".join(LETTERS[x] for x in letters))


def form(kind: int, name: str, letters: str, columns: str) -> bytes:
    """The FMT record (type 128) of a message."""
    return record(128, "BBnNZ", kind, size(letters), name.encode(), letters.encode(), columns.encode())
