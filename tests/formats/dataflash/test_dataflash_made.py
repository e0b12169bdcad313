"""DataFlash logs made by hand: layouts, marks, units and clocks, each from both sides of its limit."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from attlog.formats.dataflash import clock, compiled, detect, index, units
from attlog.formats.dataflash.index import MessageFormat
from tests.formats.dataflash.made import form, record, size


def bytes_of(*parts: bytes) -> np.ndarray:
    return np.frombuffer(b"".join(parts), np.uint8)


@pytest.mark.parametrize("letter", list("bBhHiIqQfdnNZcCeELM"))
def test_a_letter_takes_as_many_bytes_as_the_loggers_type(letter: str) -> None:
    """ArduPilot, libraries/AP_Logger/README: one column of each letter and a byte behind it."""
    letters = letter + "B"
    fmt = index.parse_format(form(7, "ABC", letters, "X,Y"), 40)
    assert fmt == MessageFormat(7, size(letters), "ABC", letters, ("X", "Y"), 40)
    assert fmt.readable
    assert (fmt.place(0), fmt.place(1)) == (3, size(letters) - 1)
    assert not fmt._replace(length=fmt.length + 1).readable
    assert not fmt._replace(letters=letters + "?").readable


def test_scaled_letters_are_hundredths_and_degrees_ten_millionths() -> None:
    assert index.LETTER_SCALES == {"c": 0.01, "C": 0.01, "e": 0.01, "E": 0.01, "L": 1e-7}
    assert index.LETTER_DTYPES["a"].itemsize == 64
    assert index.LETTER_DTYPES["g"] == np.float16


@pytest.mark.parametrize(
    ("change", "fits"),
    [
        ({}, True),
        ({5: 0}, False),
        ({5: 7}, False),
        ({9: 0x81}, False),
        ({25: 7}, False),
        ({4: 2}, False),
        ({4: 3}, True),
        ({3: 128}, False),
        ({3: 128, 4: 89}, True),
    ],
)
def test_a_definition_has_a_name_plain_texts_and_a_length_beyond_its_header(change: dict[int, int], fits: bool) -> None:
    raw = bytearray(form(7, "ABC", "fB", "X,Y"))
    for at, value in change.items():
        raw[at] = value
    assert (index.parse_format(bytes(raw), 0) is not None) is fits


def test_a_layout_is_valid_from_its_definition_on_and_the_first_also_before() -> None:
    first, second = form(7, "ABC", "ff", "X,Y"), form(7, "ABD", "ii", "P,Q")
    early, late = record(7, "ff", 1.0, 2.0), record(7, "ii", 3, 4)
    data = bytes_of(early, first, early, first, second, late, late)
    found = index.searched(data)
    assert [f.name for f in found.layouts] == ["FMT", "ABC", "ABD"]
    assert found.layout.tolist() == [1, 0, 1, 0, 0, 2, 2]
    assert found.stamps[-1] == 3 + (4 << 32)
    assert found.losses.bytes == 0


def test_the_compiled_walk_counts_as_many_definitions_as_may_be_read(monkeypatch: pytest.MonkeyPatch) -> None:
    for module in (compiled, index):
        monkeypatch.setattr(module, "MAX_FORMATS", 5)
    forms = [form(10 + k, f"AB{k}", "ff", "X,Y") for k in range(5)]
    rows = [record(10 + k, "ff", 1.0, 2.0) for k in range(5)]
    whole = index._walked(bytes_of(*forms[:4], *rows[:4]))
    assert whole is not None
    assert [f.name for f in whole.layouts] == ["FMT", "AB0", "AB1", "AB2", "AB3"]
    assert whole.layout.tolist() == [0, 0, 0, 0, 1, 2, 3, 4]
    data = bytes_of(*forms, *rows)
    assert index._walked(data) is None
    assert [f.name for f in index.searched(data).layouts] == ["FMT", "AB0", "AB1", "AB2", "AB3"]
    chain = compiled.Follower(data)
    assert chain.follow(0) == len(data)
    assert chain.definitions == [89 * k for k in range(5)]


@pytest.mark.parametrize("cut", [0, 1, 2, 3, 7, 10, 11, 12])
def test_a_cut_last_record_is_a_loss_and_walked_as_it_is_searched(cut: int) -> None:
    row = record(7, "fff", 1.0, 2.0, 3.0)
    data = bytes_of(form(7, "ABC", "fff", "X,Y,Z"), row, row, row[:cut])
    walked, searched = index._walked(data), index.searched(data)
    assert walked is not None
    for found in (walked, searched):
        assert found.offsets.tolist() == [0, 89, 104]
        assert found.losses.bytes == cut


def test_a_mark_within_a_payload_begins_no_record_and_unknown_types_are_counted() -> None:
    odd = record(7, "BBBB", 0xA3, 0x95, 7, 1)
    stranger = record(9, "BBBB", 1, 2, 3, 4)
    data = bytes_of(form(7, "ABC", "BBBB", "W,X,Y,Z"), odd, stranger, stranger, odd, odd)
    found = index.searched(data)
    assert found.offsets.tolist() == [0, 89, 110, 117]
    (loss,) = found.losses.listed
    assert (loss.offset, loss.length) == (96, 14)
    assert "2 records of type 9" in loss.lost


@pytest.mark.parametrize(
    ("head", "binary"),
    [
        (b"\xa3\x95" + bytes(10), True),
        (b"\xa3\x94" + bytes(10), False),
        (bytes(9) + form(7, "ABC", "fB", "X,Y"), True),
        (bytes(9) + form(7, "ABC", "fB", "X,Y").replace(b"fB\0", b"f!\0"), False),
        (b"\0" * 90 + b"\xa3\x95\0" * 4, False),
        (b"\0" * 90 + b"\xa3\x95\0" * 5, True),
        (b"\0" * 4000 + b"\xa3\x95\0" * 9, False),
        (b"\0" * 4000 + b"\xa3\x95\0" * 10, True),
    ],
)
def test_a_binary_log_shows_a_definition_or_a_mark_every_400_bytes(head: bytes, binary: bool) -> None:
    assert detect.is_binary(head) is binary


@pytest.mark.parametrize(
    ("head", "text"),
    [
        (b"FMT, 128, 89, FMT, BBnNZ", True),
        (b"some words\r\n  FMT,128,89,FMT", True),
        (b"xFMT, 128, 89, FMT", False),
        (b"FMT, a, 89, FMT", False),
        (b"FMT, 128, 89, FMT\0", False),
        (b"FMT, 128, 89, FMT" + b"\n" * 4090 + b"\0", True),
    ],
)
def test_a_text_log_shows_a_line_that_defines_a_format(head: bytes, text: bool) -> None:
    assert detect.is_text(head) is text


@pytest.mark.parametrize(
    ("name", "unit_id", "factor", "mult_id", "scale", "want"),
    [
        ("m", "m", 1.0, "0", 1.0, "m"),
        ("m", "m", 0.01, "B", 1.0, "cm"),
        ("m", "m", 0.01, "B", 0.01, "m"),
        ("deg", "D", 1e-7, "G", 1e-7, "deg"),
        ("deg", "D", 1.0, "0", 0.01, "deg"),
        ("s", "s", 1e-6, "F", 1.0, "us"),
        ("s", "s", 1e-3, "C", 1.0, "ms"),
        ("s", "s", 1e-9, "I", 1.0, "ns"),
        ("m", "m", 0.1, "A", 1.0, "dm"),
        ("m", "m", 1e3, "x", 1.0, "km"),
        ("m", "m", 100.0, "2", 1.0, "100 m"),
        ("m", "m", 3.3, "!", 0.01, "330 m"),
        ("m", "m", 0.0, "-", 1.0, "m"),
        ("m", "m", 0.0, "z", 1.0, "m"),
        ("m", "-", 1.0, "0", 1.0, None),
        ("m", "?", 1.0, "0", 1.0, None),
        ("instance", "#", 1.0, "0", 1.0, None),
        ("m", "m", 1.0, "?", 1.0, None),
        ("", "m", 1.0, "0", 1.0, None),
        ("m", "m", -1.0, "0", 1.0, None),
        ("m", "m", float("inf"), "0", 1.0, None),
        ("m", "m", float("nan"), "0", 1.0, None),
    ],
)
def test_a_unit_is_that_of_the_printed_number(
    name: str, unit_id: str, factor: float, mult_id: str, scale: float, want: str | None
) -> None:
    assert units._unit_text(name, unit_id, factor, mult_id, scale) == want


@pytest.mark.parametrize(
    ("columns", "letters", "want"),
    [
        (("TimeUS", "X"), "Qf", ("TimeUS", 1)),
        (("X", "TimeUS"), "fq", ("TimeUS", 1)),
        (("TimeUS", "TimeMS"), "fI", ("TimeMS", 1000)),
        (("TimeMS", "X"), "If", ("TimeMS", 1000)),
        (("TimeMS", "X"), "if", ("TimeMS", 1000)),
        (("TimeMS", "X"), "ff", None),
        (("TimeMS", "Week", "T"), "IHI", ("T", 1000)),
        (("TimeMS", "GWk", "T"), "IHI", ("T", 1000)),
        (("TimeMS", "Week"), "IH", None),
        (("X", "Y"), "ff", None),
    ],
)
def test_the_boot_clock_is_microseconds_or_milliseconds(
    columns: tuple[str, ...], letters: str, want: tuple[str, int] | None
) -> None:
    assert clock.time_column(MessageFormat(7, 9, "ABC", letters, columns, 0)) == want


def test_times_stand_where_their_column_does_and_in_microseconds() -> None:
    forms = [form(7, "AAA", "Qf", "TimeUS,X"), form(8, "BBB", "fQ", "X,TimeUS"), form(9, "CCC", "BIf", "I,TimeMS,X")]
    rows = [record(7, "Qf", 5_000, 1.0), record(8, "fQ", 1.0, 6_000), record(9, "BIf", 3, 7, 1.0)]
    data = bytes_of(*forms, form(10, "DDD", "ff", "X,Y"), *rows, record(10, "ff", 1.0, 2.0), rows[0])
    at, times = clock.timeline(data, index.searched(data))
    assert times.tolist() == [5_000, 6_000, 7_000, 5_000]
    assert at.tolist()[0] == 4 * 89
    limit: Any = clock.LAST_TIME_US
    counts = np.array([-1, 0, limit // 1000, limit // 1000 + 1])
    assert clock._microseconds(counts, 1000).tolist() == [-1000, 0, limit // 1000 * 1000, -1000]
