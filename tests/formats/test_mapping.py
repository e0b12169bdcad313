"""Strings of a log: every byte can be spelt."""

from __future__ import annotations

import numpy as np
import pytest

from attlog.formats.mapping import text_of, texts_of


@pytest.mark.parametrize(
    ("raw", "text"),
    [
        (b"plain\0rest", "plain"),
        ("Höhe 5 µT".encode(), "Höhe 5 µT"),
        ("Höhe 5 µT".encode("latin-1"), "Höhe 5 µT"),
        (b"\xff\xfe", "ÿþ"),
    ],
)
def test_a_text_is_utf_8_or_else_latin_1_up_to_its_end(raw: bytes, text: str) -> None:
    assert text_of(raw) == text
    assert texts_of(np.array([b"GPS", raw, b""])) == ["GPS", text, ""]
