"""Does a file consist of MAVLink packets?"""

from __future__ import annotations

import numpy as np

from attlog.formats.mavlink.detect import is_capture, is_tlog

PACKET = b"\xfe" + bytes([9]) + bytes(15)
"""A packet of MAVLink 1 with 9 bytes, as far as its length tells."""


def test_one_length_that_fits_is_an_accident_and_four_in_a_row_are_none() -> None:
    noise = np.random.default_rng(1).integers(0, 200, 4000).astype(np.uint8).tobytes()
    assert not is_capture(noise[:100] + PACKET + noise)
    assert not is_capture(noise[:100] + 3 * PACKET + noise)
    assert not is_capture(noise[:2040] + 3 * PACKET)
    assert is_capture(noise[:2040] + 4 * PACKET)
    assert is_tlog(300 * (bytes(8) + PACKET))


def test_a_short_file_is_one_where_it_is_made_of_packets_only() -> None:
    assert is_capture(PACKET)
    assert not is_capture(PACKET + b"text")
