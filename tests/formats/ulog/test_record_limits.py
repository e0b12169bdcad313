"""What may be a record, a name, a time or a number of a ULog: each limit from both sides."""

from __future__ import annotations

import struct
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from attlog.formats.base import Field
from attlog.formats.ulog.clock import RecordClock, far_from_most, rise
from attlog.formats.ulog.doubt import doubtful
from attlog.formats.ulog.records import SYNC, info_value, is_odd_definition, is_record, keyed, parameter_value, text
from tests.formats.ulog.crafted import keyed as with_key


def fits(kind: str, payload: bytes) -> bool:
    return is_record(ord(kind), payload, len(payload))


LOG_LEVELS = [(0x2F, False), (0x30, True), (0x37, True), (0x38, False)]


@pytest.mark.parametrize(("level", "is_text"), LOG_LEVELS)
@pytest.mark.parametrize(("kind", "header"), [("L", 9), ("C", 11)])
def test_a_logged_text_has_a_level_from_0_to_7_and_its_stamp(level: int, is_text: bool, kind: str, header: int) -> None:
    head = bytes([level]) + bytes(header - 1)
    assert fits(kind, head + b"text") is is_text
    assert fits(kind, head) is is_text
    assert not fits(kind, head[:-1])


def test_a_text_of_more_than_a_kilobyte_must_be_letters() -> None:
    head = b"4" + bytes(8)
    assert fits("L", head + b"\xff" * (1024 - 9))
    assert not fits("L", head + b"\xff" * (1025 - 9))
    assert fits("L", head + b"a" * 3000)


@pytest.mark.parametrize(("size", "is_flags"), [(39, False), (40, True), (256, True), (257, False)])
def test_flags_are_40_to_256_bytes(size: int, is_flags: bool) -> None:
    assert fits("B", bytes(size)) is is_flags


@pytest.mark.parametrize(
    ("key", "size", "is_info"),
    [
        ("uint32_t ver", 4, True),
        ("uint32_t ver", 5, False),
        ("uint8_t[3] id", 3, True),
        ("uint8_t[3] id", 4, False),
        ("double x", 8, True),
        ("char[7] name", 7, True),
        ("char[7] name", 6, False),
        ("char name", 1, True),
        ("what x", 4, False),
        ("uint32_t", 4, False),
        ("uint32_t a b", 4, False),
    ],
)
def test_an_info_has_a_type_a_name_and_as_many_bytes_as_the_type(key: str, size: int, is_info: bool) -> None:
    assert fits("I", with_key(key, bytes(size))) is is_info
    for first, more in ((0, True), (1, True), (2, False)):
        assert fits("M", bytes([first]) + with_key(key, bytes(size))) is (is_info and more)


@pytest.mark.parametrize(
    ("key", "size", "is_parameter"),
    [
        ("float A", 4, True),
        ("float A", 5, False),
        ("float A", 3, False),
        ("int32_t A", 4, True),
        ("double A", 4, False),
        ("float ", 4, False),
        ("float " + "A" * 57, 4, True),
        ("float " + "A" * 58, 4, False),
    ],
)
def test_a_parameter_is_a_named_float_or_int32(key: str, size: int, is_parameter: bool) -> None:
    assert fits("P", with_key(key, bytes(size))) is is_parameter
    for first, known in ((0, True), (15, True), (16, False)):
        assert fits("Q", bytes([first]) + with_key(key, bytes(size))) is (is_parameter and known)


@pytest.mark.parametrize(
    ("kind", "payload", "is_one"),
    [
        ("F", b"a:uint64_t timestamp;", True),
        ("F", b"a/b-c:float[3] x;", True),
        ("F", b"a uint64_t", False),
        ("F", b":float x;", False),
        ("A", b"\0\1\0topic", True),
        ("A", b"\0\1\0", False),
        ("A", b"\0\1\0to pic", False),
        ("A", b"\0\1\0" + b"t" * 255, True),
        ("A", b"\0\1\0" + b"t" * 256, False),
        ("R", b"\1\0", True),
        ("R", b"\1\0\0", False),
        ("O", b"\1\0", True),
        ("O", b"\1", False),
        ("S", SYNC, True),
        ("S", SYNC[:-1] + b"\0", False),
        ("Z", b"\0", False),
    ],
)
def test_formats_subscriptions_and_marks_look_as_described(kind: str, payload: bytes, is_one: bool) -> None:
    assert fits(kind, payload) is is_one


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
    assert keyed(with_key("float[2] a b", b"xyz")) == ("float[2]", "a b", b"xyz")
    assert parameter_value("int32_t", struct.pack("<i", -5)) == -5
    assert parameter_value("float", struct.pack("<f", 0.5)) == 0.5
    assert parameter_value("float", b"\0\0\0") is None
    assert parameter_value("double", bytes(8)) is None
    assert text(b"a\xffb\0c") == "a\ufffdb"


def clocked(*records: tuple[int, int]) -> RecordClock:
    """Data records of 16 bytes: id and stamp; id 1 has its stamp at byte 3 behind the header, id 2 has none."""
    raw = b"".join(struct.pack("<HBH3xQ", 13, ord("D"), one, t) for one, t in records)
    clock = RecordClock(memoryview(raw))
    clock.subscribe(1, SimpleNamespace(time_at=3))  # type: ignore[arg-type]
    clock.subscribe(2, SimpleNamespace(time_at=None))  # type: ignore[arg-type]
    return clock


def test_a_time_is_believed_that_is_near_any_of_those_before() -> None:
    from attlog.base.limits import MAX_TIME_JUMP_S

    jump = round(MAX_TIME_JUMP_S * 1e6)
    clock = clocked((1, 500), (1, 10 * jump), (2, 7), (1, 11 * jump - 1), (1, 11 * jump), (1, 9 * jump + 1))
    assert clock.time_at(16) == 10 * jump
    assert clock.time_at(32) is None
    assert clock.is_timely(48, [0, 16])
    assert not clock.is_timely(64, [0, 16])
    assert clock.is_timely(80, [0, 16, 32])
    assert not clock.is_timely(48, [0])
    assert clock.is_timely(48, [32])
    assert clock.is_timely(48, [])
    assert clock.is_timely(32, [0])
    clock.forget()
    assert clock.time_at(16) is None


def test_times_of_one_topic_rise_and_stay_near_each_other() -> None:
    from attlog.base.limits import MAX_TIME_JUMP_S

    jump = round(MAX_TIME_JUMP_S * 1e6)

    def told(*times: int, at: int | None = 3) -> bool:
        raw = b"".join(struct.pack("<HBH3xQ", 13, ord("D"), 1, t) for t in times)
        layout: Any = SimpleNamespace(time_at=at)
        return rise(np.frombuffer(raw, np.uint8), 16 * np.arange(len(times)), layout)

    assert told(5, 5, jump + 4)
    assert not told(5, 5, jump + 5)
    assert not told(6, 5, 7)
    assert not told(5, 6, 7, at=None)
    far = far_from_most(np.array([0, jump, jump, jump + 1, 2 * jump + 1], np.uint64))
    assert far.tolist() == [False, False, False, False, True]


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
    assert np.flatnonzero(doubtful(table(x=x))).tolist() == ([7, 9] if odd else [])
    axes = np.ones((200, 3))
    axes[7, 1] = value
    assert np.flatnonzero(doubtful(table(x=axes))).tolist() == ([7] if odd else [])


def test_a_hundredth_or_one_is_rare_and_four_records_are_too_few() -> None:
    for count, doubted in ((2, True), (3, False)):
        x = np.ones(200)
        x[:count] = 1e20
        assert doubtful(table(x=x)).any() == doubted
    for n, doubted in ((4, False), (5, True)):
        x = np.ones(n)
        x[0] = 1e20
        assert doubtful(table(n, x=x)).any() == doubted
    times = np.arange(200, dtype=np.uint64)
    times[3] = 10**15
    assert np.flatnonzero(doubtful(table(timestamp=times))).tolist() == [3]
    assert not doubtful(table(other=times)).any()
