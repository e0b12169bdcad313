"""ULogs that no logger writes: n of one construct each, to find what costs more than its bytes."""

from __future__ import annotations

import struct
from collections.abc import Callable

HEAD = b"ULog\x01\x12\x35\x01" + struct.pack("<Q", 1000)
STAMP = "uint64_t timestamp;"


def record(kind: str, payload: bytes) -> bytes:
    return struct.pack("<HB", len(payload), ord(kind)) + payload


def log(*records: bytes) -> bytes:
    return HEAD + b"".join(records)


def form(text: str) -> bytes:
    return record("F", text.encode())


def subscribe(name: str, identifier: int, multi: int = 0) -> bytes:
    return record("A", struct.pack("<BH", multi, identifier) + name.encode())


def data(identifier: int, t_us: int, rest: bytes = b"") -> bytes:
    return record("D", struct.pack("<HQ", identifier, t_us) + rest)


def keyed(key: str, value: bytes) -> bytes:
    return bytes([len(key)]) + key.encode() + value


PLAIN = form(f"a:{STAMP}float x;") + subscribe("a", 1)
"""A topic of id 1 whose records are 12 bytes behind the id."""


def one(k: int) -> bytes:
    return data(1, 10_000 + k, b"\0\0\x80\x3f")


def nested_arrays(n: int) -> bytes:
    """Eight levels of 99999 elements, subscribed n times."""
    levels = [form(f"n{k}:n{k + 1}[99999] a;") for k in range(7)]
    return log(*levels, form("n7:uint8_t a;"), *(subscribe("n0", k) for k in range(n)))


def arrays_of_nothing(n: int) -> bytes:
    """Elements that hold no bytes, any number of them."""
    levels = [form(f"n{k}:n{k + 1}[99999] a;") for k in range(5)]
    return log(
        *levels,
        form(f"n5:uint8_t[0] a;{STAMP}"),
        form("n6:uint8_t[0] a;"),
        form(f"b:n6[9999999] a;{STAMP}"),
        *(subscribe("b", k) for k in range(n)),
        *(data(k % n, 9) for k in range(n)),
    )


def wide_topics(n: int) -> bytes:
    """Topics of 4000 fields each."""
    return log(
        form("b:uint8_t d;"),
        *(form(f"a{k}:{STAMP}b[4000] c;") for k in range(n)),
        *(subscribe(f"a{k}", k) for k in range(n)),
        *(data(k % 30, 9 + k, bytes(4000)) for k in range(n)),
    )


def a_chain_of_types(n: int) -> bytes:
    """Each format holds the next one; every one is subscribed."""
    return log(*(form(f"c{k}:c{k + 1} a;{STAMP}") for k in range(n)), *(subscribe(f"c{k}", k) for k in range(n)))


def types_in_a_circle(n: int) -> bytes:
    """Formats that contain themselves, through each other, all at once."""
    return log(
        *(form(f"c{k}:{STAMP}c{(k * 7 + 1) % n} a;c{(k * 3 + 2) % n}[9] b;") for k in range(n)),
        *(subscribe(f"c{k}", k) for k in range(n)),
    )


def unknown_ids(n: int) -> bytes:
    """Records of n ids without subscription, and n formats of their size, every other stamp elsewhere."""
    formats = (form(f"m{k}:" + ("uint8_t y;" * (k % 40)) + STAMP + "uint8_t z;" * (40 - k % 40)) for k in range(n))
    return log(*formats, *(data(k // 3, 9 + k, bytes(40)) for k in range(3 * n)))


def formats(n: int) -> bytes:
    return log(PLAIN, one(1), *(form(f"f{k}:{STAMP}float x;") for k in range(n)), one(2))


def formats_declared_anew(n: int) -> bytes:
    """A large format whose part changes before each subscription."""
    large = form("big:" + "float x;" * 2000 + "part p;")
    pairs = (form(f"part:uint8_t[{k % 9 + 1}] x;") + subscribe("big", k % 5) for k in range(n))
    return log(large, *pairs)


def a_format_that_backtracks(n: int) -> bytes:
    """Members without semicolons can be split in as many ways as two to their number."""
    return log(form("x:" + "aaaa bbbb cccc " * (n // 10) + "!"), subscribe("x", 1), *(one(k) for k in range(5)))


def instances(n: int) -> bytes:
    return log(
        form(f"a:{STAMP}float x;"),
        *(subscribe("a", k % 60_000, k % 256) + data(k % 60_000, k, bytes(4)) for k in range(n)),
    )


def topics(n: int) -> bytes:
    parts = (
        form(f"t{k}:{STAMP}float x;") + subscribe(f"t{k}", k) + data(k, k, bytes(4)) for k in range(min(n, 60_000))
    )
    return log(*parts)


def resubscriptions(n: int) -> bytes:
    """An id that changes its topic with every record."""
    return log(
        form(f"a:{STAMP}float x;"),
        form(f"b:{STAMP}uint32_t x;"),
        *(subscribe("ab"[k % 2], 1) + data(1, k, bytes(4)) for k in range(n)),
    )


def headers(n: int) -> bytes:
    return b"".join(log(PLAIN, one(k)) for k in range(n))


def bare_headers(n: int) -> bytes:
    return HEAD * n


def layouts(n: int) -> bytes:
    """A power-up for each of n layouts of one topic."""
    floats = [k % 500 + 1 for k in range(n)]
    return b"".join(
        log(form(f"a:{STAMP}float[{m}] x;"), subscribe("a", 1), data(1, k, bytes(4 * m))) for k, m in enumerate(floats)
    )


def parameters(n: int) -> bytes:
    return log(*(record("P", keyed(f"int32_t P{k:07d}", bytes(4))) for k in range(n)), PLAIN, one(1))


def parameters_in_data(n: int) -> bytes:
    return log(PLAIN, *(one(k) + record("P", keyed(f"float P{k:07d}", bytes(4))) for k in range(n)))


def texts(n: int) -> bytes:
    return log(PLAIN, *(record("L", b"6" + struct.pack("<Q", k) + b"text") + one(k) for k in range(n)))


def statements(n: int) -> bytes:
    return log(*(record("I", keyed(f"char[4] i{k:07d}", b"abcd")) for k in range(n)), PLAIN, one(1))


def a_statement_in_parts(n: int) -> bytes:
    return log(*(record("M", bytes([k > 0]) + keyed("char[60] dump", b"x" * 60)) for k in range(n)), PLAIN, one(1))


def dropouts(n: int) -> bytes:
    return log(PLAIN, *(one(k) + record("O", b"\x05\x00") for k in range(n)))


def synchronisation(n: int) -> bytes:
    return log(PLAIN, *(one(k) + record("S", b"\x2f\x73\x13\x20\x25\x0c\xbb\x12") for k in range(n)))


def records_of_an_unknown_type(n: int) -> bytes:
    return log(PLAIN, *(one(k) + record("Z", bytes(6)) for k in range(n)))


def damaged_everywhere(n: int) -> bytes:
    return log(PLAIN, *(one(k) + b"\xff\xfe\xfd" for k in range(n)))


def one_letter(letter: str) -> Callable[[int], bytes]:
    """Garbage in which every byte begins a record of this type with a long payload."""

    def build(n: int) -> bytes:
        return log(PLAIN, one(1), one(2), letter.encode() * (10 * n), one(3), one(4), one(5), one(6))

    build.__name__ = f"garbage_of_{letter}"
    return build


def letters_and_digits(n: int) -> bytes:
    """Garbage in which every other byte begins a text of 12 kB."""
    return log(PLAIN, one(1), b"L0" * (5 * n), one(2), one(3), one(4), one(5))


BUILDERS: tuple[Callable[[int], bytes], ...] = (
    nested_arrays,
    arrays_of_nothing,
    wide_topics,
    a_chain_of_types,
    types_in_a_circle,
    unknown_ids,
    formats,
    formats_declared_anew,
    a_format_that_backtracks,
    instances,
    topics,
    resubscriptions,
    headers,
    bare_headers,
    layouts,
    parameters,
    parameters_in_data,
    texts,
    statements,
    a_statement_in_parts,
    dropouts,
    synchronisation,
    records_of_an_unknown_type,
    damaged_everywhere,
    *map(one_letter, "ABCDFILMOPQRS"),
    letters_and_digits,
)
