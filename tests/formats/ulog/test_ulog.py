"""The ULog reader tells what pyulog tells, on every undamaged log in hand."""

from __future__ import annotations

import struct
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from pyulog import ULog

from attlog.core.errors import LogUnusable, NotALog
from attlog.formats import Messages
from attlog.formats.table import Field
from attlog.formats.ulog import reader
from attlog.formats.ulog.content import implausible
from attlog.formats.ulog.layout import (
    SYNC,
    decode_ulog_text,
    info_value,
    is_odd_definition,
    is_record,
    parameter_value,
    split_key,
)
from tests.conftest import SAMPLES, corpus_logs
from tests.formats.ulog.crafted import keyed as with_key

CLEAN = [p for p in corpus_logs(".ulg") if not p.name.startswith("made_")]


@pytest.fixture(params=CLEAN, ids=lambda p: p.name, scope="module")
def both(request: pytest.FixtureRequest) -> tuple[Messages, ULog]:
    return reader.read_ulog(request.param), ULog(str(request.param))


def test_parameters_are_equal(both: tuple[Messages, ULog]) -> None:
    ours, theirs = both
    initial = {p.name: p.value for p in ours.params if p.t_us is None and not p.is_default}
    assert initial == theirs.initial_parameters
    changed = [(p.name, p.value) for p in ours.params if p.t_us is not None]
    assert changed == [(name, value) for _, name, value in theirs.changed_parameters]
    for mine, (their_time, _, _) in zip(
        [p for p in ours.params if p.t_us is not None], theirs.changed_parameters, strict=True
    ):
        assert mine.t_us <= their_time, "the record before, not the largest stamp so far"
    defaults = {p.name for p in ours.params if p.is_default}
    assert defaults == set(theirs.get_default_parameters(0)) | set(theirs.get_default_parameters(1))


def test_texts_and_dropouts_are_equal(both: tuple[Messages, ULog]) -> None:
    ours, theirs = both
    tagged = [m for messages in theirs.logged_messages_tagged.values() for m in messages]
    expected = sorted((m.timestamp, m.log_level - ord("0"), m.message) for m in [*theirs.logged_messages, *tagged])
    assert sorted((t.t_us, t.level, t.text) for t in ours.texts) == expected
    assert ours.dropouts_ms == [d.duration for d in theirs.dropouts]


def test_info_is_equal(both: tuple[Messages, ULog]) -> None:
    ours, theirs = both
    for name, value in theirs.msg_info_dict.items():
        assert ours.info[name] == (value.rstrip("\0") if isinstance(value, str) else value), name
    for name, groups in theirs.msg_info_multiple_dict.items():
        joined = ["".join(p.split("\0")[0] for p in g) if isinstance(g[0], str) else b"".join(g) for g in groups]
        assert ours.info[name] == joined, name


def test_undamaged_logs_have_no_damage(both: tuple[Messages, ULog]) -> None:
    ours, _ = both
    assert (ours.damage_bytes, ours.damage) == (0, [])


def test_columns_of_selected_rows_are_those_rows() -> None:
    table = reader.read_ulog(SAMPLES / "px4_steps.ulg").first("sensor_combined")
    assert table is not None
    part = table.rows(slice(100, 200))
    assert np.array_equal(part["gyro_rad"], table["gyro_rad"][100:200])
    assert np.array_equal(part["gyro_rad[2]"], table["gyro_rad"][100:200, 2])
    assert "gyro_rad[3]" not in table
    with pytest.raises(KeyError, match="sensor_combined has no field"):
        table["gyro_rad[3]"]


def test_unknown_incompatible_flag_stops_with_a_reason(tmp_path: Path) -> None:
    raw = bytearray((SAMPLES / "px4_hover.ulg").read_bytes()[:5000])
    assert raw[18] == ord("B")
    raw[19 + 8] = 0b10
    (tmp_path / "future.ulg").write_bytes(raw)
    with pytest.raises(LogUnusable, match="newer reader"):
        reader.read_ulog(tmp_path / "future.ulg")


def test_appended_data_is_read_and_the_cut_record_before_it_is_counted(tmp_path: Path) -> None:
    """A crash dump is appended behind a data section that ends in half a record."""
    raw = bytearray((SAMPLES / "px4_hover.ulg").read_bytes())
    whole = reader.read_ulog(SAMPLES / "px4_hover.ulg")
    last = max(int(t.offsets[-1]) for t in whole.values())
    offset = last + 9
    dump = b"char[4] dump"
    appended = b"\0" + bytes([len(dump)]) + dump + b"oops"
    raw[19 + 8] |= 1
    raw[19 + 16 : 19 + 24] = offset.to_bytes(8, "little")
    (tmp_path / "crash.ulg").write_bytes(raw[:offset] + len(appended).to_bytes(2, "little") + b"M" + appended)
    log = reader.read_ulog(tmp_path / "crash.ulg")
    assert log.info["dump"] == ["oops"]
    assert log.damage_bytes == 9
    assert sum(map(len, log.values())) == sum(map(len, whole.values())) - 1


def test_what_is_no_ulog_is_refused(tmp_path: Path) -> None:
    (tmp_path / "empty.ulg").write_bytes(b"")
    (tmp_path / "other.ulg").write_bytes(b"\xa3\x95" * 100)
    (tmp_path / "locked.ulg").write_bytes(b"ULogEnc" + bytes(100))
    for name, error in [("empty.ulg", LogUnusable), ("other.ulg", NotALog), ("locked.ulg", LogUnusable)]:
        with pytest.raises(error):
            reader.read_ulog(tmp_path / name)


# What a record of a ULog must look like, and what its value is.


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


# What may be a record, a name, a time or a number of a ULog: each limit from both sides.


def keyed(*keys: tuple[str, int]) -> list[bytes]:
    """Payloads of a key and as many bytes."""
    return [with_key(key, bytes(size)) for key, size in keys]


VALID = {
    "L": [b"0" + bytes(8), b"7" + bytes(8) + b"text"],
    "C": [b"0" + bytes(10), b"7" + bytes(10) + b"text"],
    "I": keyed(("uint32_t ver", 4), ("uint8_t[3] id", 3), ("double x", 8), ("char[7] name", 7), ("char name", 1)),
    "P": keyed(("float A", 4), ("int32_t A", 4), ("float " + "A" * 57, 4)),
    "F": [b"a:uint64_t timestamp;", b"a/b-c:float[3] x;"],
    "A": [b"\0\1\0topic", b"\0\1\0" + b"t" * 255],
    "R": [b"\1\0"],
    "O": [b"\1\0"],
    "S": [SYNC],
}
INVALID = {
    "L": [b"/" + bytes(8), b"8" + bytes(8) + b"text", b"0" + bytes(7)],
    "C": [b"/" + bytes(10), b"8" + bytes(10) + b"text", b"0" + bytes(9)],
    "I": keyed(("uint32_t ver", 5), ("uint8_t[3] id", 4), ("char[7] name", 6), ("what x", 4), ("uint32_t", 4))
    + keyed(("uint32_t a b", 4)),
    "P": keyed(("float A", 5), ("float A", 3), ("double A", 4), ("float ", 4), ("float " + "A" * 58, 4)),
    "F": [b"a uint64_t", b":float x;"],
    "A": [b"\0\1\0", b"\0\1\0to pic", b"\0\1\0" + b"t" * 256],
    "R": [b"\1\0\0"],
    "O": [b"\1"],
    "S": [SYNC[:-1] + b"\0"],
    "Z": [b"\0"],
}


@pytest.mark.parametrize(("payloads", "valid"), [(VALID, True), (INVALID, False)], ids=["valid", "invalid"])
def test_a_record_fits_its_type_by_size_key_and_letters(payloads: dict[str, list[bytes]], valid: bool) -> None:
    """M is an I and Q a P behind a byte: 0 or 1 of a part, up to 15 of the sources of a default."""
    for kind, every in payloads.items():
        for payload in every:
            assert is_record(ord(kind), payload, len(payload)) is valid, (kind, payload)
            behind, most = {"I": ("M", 1), "P": ("Q", 15)}.get(kind, ("", -2))
            for first in (0, most, most + 1) if behind else ():
                whole = bytes([first]) + payload
                assert is_record(ord(behind), whole, len(whole)) is (valid and first <= most), (behind, whole)


@pytest.mark.parametrize(
    ("kind", "payload", "is_one"),
    [
        ("F", "größe:float x;".encode(), True),
        ("F", b"a\x07b", False),
        ("A", "\0\1\0tö pic".encode(), True),
        ("A", b"\0\1\0", False),
        ("I", with_key("float my name", b"\0\0\0\0"), True),
        ("I", b"\x20short", False),
        ("M", b"\0" + with_key("odd", b""), True),
        ("P", b"\x01\xff", False),
        ("Q", b"\0" + with_key("float A B", bytes(4)), True),
        ("L", b"4 a text", False),
    ],
)
def test_an_odd_definition_is_named_in_letters(kind: str, payload: bytes, is_one: bool) -> None:
    assert is_odd_definition(ord(kind), payload, len(payload)) is is_one
    assert not is_odd_definition(ord(kind), payload, len(payload) + 1)


def test_values_are_those_of_their_types() -> None:
    forms = {"int8_t": "<b", "uint8_t": "<B", "int16_t": "<h", "uint16_t": "<H", "int32_t": "<i", "uint32_t": "<I"}
    forms |= {"int64_t": "<q", "uint64_t": "<Q"}
    for kind, form in forms.items():
        size = struct.calcsize(form)
        value = 7 - (2 ** (8 * size - 1) if form[1].islower() else 0)
        raw = value.to_bytes(size, "little", signed=form[1].islower())
        assert info_value(kind, raw) == value
    assert info_value("double", np.float64(1.25).tobytes()) == 1.25
    assert info_value("bool", b"\1") is True
    assert split_key(with_key("float[2] a b", b"xyz")) == ("float[2]", "a b", b"xyz")
    assert parameter_value("int32_t", struct.pack("<i", -5)) == -5
    assert parameter_value("float", struct.pack("<f", 0.5)) == 0.5
    assert parameter_value("float", b"\0\0\0") is None
    assert parameter_value("double", bytes(8)) is None
    assert decode_ulog_text(b"a\xffb\0c") == "a\ufffdb"


def table(n: int = 200, **columns: np.ndarray) -> Any:
    fields = {
        name: Field(name, x.dtype if x.ndim == 1 else np.dtype((x.dtype, x.shape[1:]))) for name, x in columns.items()
    }

    class Made(dict[str, np.ndarray]):
        def __len__(self) -> int:
            return n

    made = Made(columns)
    made.fields = fields  # type: ignore[attr-defined]
    return made


@pytest.mark.parametrize(
    ("value", "odd"),
    [
        (1.1e15, True),
        (-1.1e15, True),
        (0.9e15, False),
        (0.9e-30, True),
        (1.1e-30, False),
        (np.inf, False),
        (0.0, False),
    ],
)
def test_numbers_beyond_any_measurement_are_doubted(value: float, odd: bool) -> None:
    x = np.ones(200)
    x[[7, 9]] = value
    assert np.flatnonzero(implausible(table(x=x))).tolist() == ([7, 9] if odd else [])
    axes = np.ones((200, 3))
    axes[7, 1] = value
    assert np.flatnonzero(implausible(table(x=axes))).tolist() == ([7] if odd else [])


# What a ULog defines on the way, within the limits of what a log may ask for.
