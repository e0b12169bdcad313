"""Where the fields of a message lie: both byte orders, XCDR 1 and 2, against messages packed by hand."""

from __future__ import annotations

import struct

import numpy as np
import pytest

from attlog.formats.ros.cdr import Layout

rosbags = pytest.importorskip("rosbags.typesys")
KIND = "made_msgs/msg/Made"
TEXT = "uint8 a\nfloat64 b\nstring s\nint16 c\nfloat32[3] v\nuint64 e"


def message(second: int) -> bytes:
    """A message with the second byte ``second``: numbers stand at multiples of their size, of 4 at most in XCDR 2."""
    order = "<" if second & 1 else ">"
    most = 8 if second < 2 else 4
    out = b""
    for kind, values in (
        ("B", [7]),
        ("d", [-2.5]),
        ("I", [3]),
        ("3s", [b"ab\0"]),
        ("h", [-300]),
        ("f", [1.5, 2.5, 3.5]),
    ):
        for value in values:
            size = 1 if kind == "3s" else min(struct.calcsize(kind), most)
            out += bytes(-len(out) % size) + struct.pack(order + kind, value)
    out += bytes(-len(out) % min(8, most)) + struct.pack(order + "Q", 2**40 + 5)
    return bytes([0, second, 0, 0]) + out


@pytest.mark.parametrize("second", [0, 1, 6, 7])
def test_fields_lie_where_byte_order_and_alignment_put_them(second: int) -> None:
    types = rosbags.get_types_from_msg(TEXT, KIND)
    layout = Layout(types, KIND, message(second))
    rows = np.frombuffer(message(second), np.uint8).reshape(1, -1)
    told = {name: layout.column(rows, name)[0] for name in layout.fields()}
    assert (told["a"], told["b"], told["c"], told["e"]) == (7, -2.5, -300, 2**40 + 5)
    assert told["v"].tolist() == [1.5, 2.5, 3.5]


@pytest.mark.parametrize("second", [2, 3, 8, 9, 10, 11])
def test_a_message_with_tags_is_refused(second: int) -> None:
    """Parameter lists (2, 3) and what XCDR 2 delimits (8 to 11) have members with headers of their own."""
    types = rosbags.get_types_from_msg(TEXT, KIND)
    with pytest.raises(ValueError, match="plain CDR"):
        Layout(types, KIND, message(second))
