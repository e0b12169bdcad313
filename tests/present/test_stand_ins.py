"""Outputs that cannot show every sign."""

from __future__ import annotations

import pytest

from attlog.present.stand_ins import on_encode_error, stand_in


@pytest.mark.parametrize(
    ("text", "encoding", "shown"),
    [
        ("0.012°, ±2 ms, −1.2°/min", "ascii", "0.012 deg, +/-2 ms, -1.2 deg/min"),
        ("0.012°, ±2 ms, −1.2°/min", "latin-1", "0.012°, ±2 ms, -1.2°/min"),
        ("0.012°, ±2 ms, −1.2°/min", "cp1252", "0.012°, ±2 ms, -1.2°/min"),
        ("RMS °", "ascii", "RMS deg"),
        ("Müller…", "ascii", "Muller..."),
        ("飞", "ascii", "\\u98de"),
        ("a\udcffb.bin", "utf-8", "a\\xffb.bin"),
        ("0.012° √h", "utf-8", "0.012° √h"),
    ],
)
def test_signs_get_stand_ins_only_where_they_must(text, encoding, shown):
    assert stand_in(text, encoding) == shown
    assert shown.encode(encoding).decode(encoding) == shown


def test_the_error_handler_writes_the_same():
    import codecs

    codecs.register_error("attlog-test", on_encode_error)
    assert "x 0.5°±".encode("ascii", "attlog-test") == b"x 0.5 deg+/-"
    with pytest.raises(UnicodeDecodeError):
        b"\xff".decode("utf-8", "attlog-test")
