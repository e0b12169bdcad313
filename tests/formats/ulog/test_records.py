"""What a record of a ULog must look like, and what its value is."""

from __future__ import annotations

import struct

import numpy as np
import pytest

from attlog.formats.ulog.framing import Framing
from attlog.formats.ulog.records import info_value


@pytest.mark.parametrize(
    ("kind", "raw", "value"),
    [
        ("float", struct.pack("<f", 1.5), 1.5),
        ("float", b"\0\0", b"\0\0"),
        ("uint32_t", struct.pack("<I", 7), 7),
        ("uint32_t", b"\1\0\0", b"\1\0\0"),
        ("char[5]", b"PX4\0x", "PX4"),
        ("float[2]", bytes(8), bytes(8)),
    ],
)
def test_a_value_that_is_too_short_for_its_type_stays_bytes(kind: str, raw: bytes, value: object) -> None:
    assert info_value(kind, raw) == value


class Raw(bytes):
    """Bytes as a log holds them."""

    @property
    def data(self) -> bytes:
        return self


@pytest.mark.parametrize(("extra", "strict"), [(0, True), (1, False), (3, False), (-1, False)])
def test_a_record_is_as_long_as_its_type_says(extra: int, strict: bool) -> None:
    """``uint32_t ver`` has a value of 4 bytes, neither more nor less."""
    key = b"uint32_t ver"
    payload = bytes([len(key)]) + key + bytes(4 + extra)
    record = struct.pack("<HB", len(payload), ord("I")) + payload
    framing = Framing(Raw(record + bytes(16)), np.zeros(1 << 16, np.int64), lambda start: True)  # type: ignore[arg-type]
    assert framing.end(0) == len(record)
    assert framing.is_strict(0, framing.end(0)) is strict
