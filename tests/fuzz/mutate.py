"""Logs broken on purpose: bytes and a seed give bytes, the same ones every time, for every format.

``mutated(raw, seed)`` breaks a log in one to four ways. Each way is a function ``(raw, rng) -> bytes`` in
:data:`WAYS` and can be asked for alone. What they know of formats is only what all have in common: definitions
stand near the beginning as text, lengths and values are little-endian numbers of 1 to 8 bytes.
"""

from __future__ import annotations

import random
import re
import struct
from collections.abc import Callable, Sequence

Way = Callable[[bytes, random.Random], bytes]

HEAD = 1 << 16
"""Definitions stand within so many bytes; half of all changes are made there, whatever the log's size."""
LARGEST = 32 << 20
"""What grows stops growing here, so that a reader's time measures the reader."""

INTEGERS = tuple(
    value.to_bytes(width, "little")
    for width in (1, 2, 4, 8)
    for value in (0, 1, (1 << (8 * width - 1)) - 1, 1 << (8 * width - 1), (1 << (8 * width)) - 1)
)
"""Lengths, counts, ids and times at which arithmetic turns over."""
_REALS = (float("nan"), float("inf"), float("-inf"), 3e38, -3e38, 1e18, 1e-40, -0.0, 9.8e9)
NUMBERS = (
    *(struct.pack(kind, value) for kind in ("<f", "<d") for value in _REALS),
    *(struct.pack("<d", value) for value in (1e308, -1e308)),
    *(b"\x01\x00\xa0\x7f", b"\x01\x00\x00\x00\x00\x00\xf0\x7f"),
)
"""Values no sensor has: not a number (quiet and signalling), infinite, beyond every range, denormal."""
WORDS = (
    b"../../up",
    b"/abs/olute",
    b"a\x00b",
    b"\x1b[31m",
    b"=1+1",
    b"\xff\xfe\xfd",
    b"'\"<b>",
    b"\n\r\t",
    b"%s%n",
    b"[0]",
    b"[4000000000]",
    b"[-1]",
    b"nan",
    b"1e999",
    b"9" * 40,
    b" ",
    b";;",
    b"::",
    b"char",
    b"uint64_t",
    b"QBfNZ",
    b"\xe2\x80\xae",
    b"timestamp",
    b"x" * 300,
)
"""What a name, a unit or a text must not be able to do."""


def mutated(raw: bytes, seed: int | str, ways: Sequence[Way] = ()) -> bytes:
    """``raw`` broken in one to four ways out of ``ways`` (all of :data:`WAYS` if none are named)."""
    rng = random.Random(f"{seed}:{len(raw)}")
    for _ in range(rng.choice((1, 1, 1, 2, 2, 3, 4))):
        raw = rng.choice(ways or WAYS)(raw, rng) or raw
    return raw


def truncated(raw: bytes, rng: random.Random) -> bytes:
    """Ends anywhere, or begins anywhere behind the first bytes that tell the format."""
    at = _place(raw, rng)
    return raw[: max(at, 1)] if rng.random() < 0.8 else raw[:16] + raw[at:]


def flipped(raw: bytes, rng: random.Random) -> bytes:
    """One to two hundred single bits."""
    out = bytearray(raw)
    for _ in range(_few(rng, 200)):
        out[_place(raw, rng)] ^= 1 << rng.randrange(8)
    return bytes(out)


def wounded(raw: bytes, rng: random.Random) -> bytes:
    """A block overwritten with zeros, erased flash, noise, or one byte again and again; as a card does it."""
    out = bytearray(raw)
    for _ in range(_few(rng, 8)):
        at, length = _place(raw, rng), _few(rng, 5000)
        length = min(length, len(raw) - at)
        fill = rng.randrange(4)
        out[at : at + length] = (
            rng.randbytes(length) if fill == 0 else bytes([(0, 255, rng.randrange(256))[fill - 1]]) * length
        )
    return bytes(out)


def inserted(raw: bytes, rng: random.Random) -> bytes:
    """Foreign bytes between others."""
    at = _place(raw, rng)
    return raw[:at] + rng.randbytes(_few(rng, 3000)) + raw[at:]


def removed(raw: bytes, rng: random.Random) -> bytes:
    """A block missing."""
    at = _place(raw, rng)
    return raw[:at] + raw[at + _few(rng, 20_000) :]


def duplicated(raw: bytes, rng: random.Random) -> bytes:
    """A block again behind itself, once or many times: definitions, headers and data that repeat."""
    at = _place(raw, rng)
    block = raw[at : at + _few(rng, 8000)]
    times = min(rng.choice((1, 1, 2, 10, 300)), max(1, (LARGEST - len(raw)) // max(len(block), 1)))
    return raw[:at] + block * (1 + times) + raw[at + len(block) :]


def spliced(raw: bytes, rng: random.Random) -> bytes:
    """A block from somewhere over another place, in place of it, or two blocks exchanged; the whole log twice."""
    one, two = sorted((_place(raw, rng), _place(raw, rng)))
    length = min(_few(rng, 30_000), max(two - one, 1))
    here, there = raw[one : one + length], raw[two : two + length]
    choice = rng.randrange(4)
    if choice == 0:
        return raw[:one] + there + raw[one + length : two] + here + raw[two + length :]
    if choice == 1:
        return raw[:one] + there + raw[one:]
    if choice == 2:
        return raw[:two] + here + raw[two + length :]
    return (raw[:one] if rng.random() < 0.5 else raw) + (raw if len(raw) < LARGEST else here)


def hostile_numbers(raw: bytes, rng: random.Random) -> bytes:
    """Integers and floats that no log has, over one to fifty places."""
    out = bytearray(raw)
    for _ in range(_few(rng, 50)):
        at, value = _place(raw, rng), rng.choice(INTEGERS if rng.random() < 0.6 else NUMBERS)
        out[at : at + len(value)] = value
    return bytes(out[: len(raw)])


def one_value_everywhere(raw: bytes, rng: random.Random) -> bytes:
    """One hostile number at equal distances over a part of the log: a column that is never what it should be."""
    out, value = bytearray(raw), rng.choice(INTEGERS + NUMBERS)
    begin = _place(raw, rng)
    for at in range(begin, min(len(raw), begin + 200_000), rng.randrange(len(value), 400)):
        out[at : at + len(value)] = value
    return bytes(out[: len(raw)])


def hostile_words(raw: bytes, rng: random.Random) -> bytes:
    """Names, types and texts in the definitions overwritten in place, so that lengths stay true, or grown."""
    names = [m.span() for m in re.finditer(rb"[A-Za-z_][\w./\[\] ]{2,40}", raw[:HEAD])]
    out = bytearray(raw)
    for _ in range(min(_few(rng, 10), len(names))):
        begin, end = rng.choice(names)
        word = rng.choice(WORDS)
        if rng.random() < 0.8:
            word = word[: end - begin]
            at = rng.randint(begin, end - len(word))
            out[at : at + len(word)] = word
        else:
            return bytes(out[:begin]) + word + bytes(out[end:])
    return bytes(out)


def renamed(raw: bytes, rng: random.Random) -> bytes:
    """A name of the definitions where another stood, everywhere: types swapped, fields that are missing or twice."""
    words = list(dict.fromkeys(re.findall(rb"[A-Za-z_]\w{2,24}", raw[:HEAD])))
    if len(words) < 2:
        return raw
    one, two = rng.sample(words, 2)
    two = two[: len(one)].ljust(len(one), b"_") if rng.random() < 0.8 else two
    return raw.replace(one, two) if rng.random() < 0.5 else raw.replace(one, two, 1)


def other_counts(raw: bytes, rng: random.Random) -> bytes:
    """Digits of the definitions (array lengths, versions, columns of text logs) as other digits."""
    digits = [m.span() for m in re.finditer(rb"\d+", raw[:HEAD])]
    out = bytearray(raw)
    for _ in range(min(_few(rng, 20), len(digits))):
        begin, end = rng.choice(digits)
        out[begin:end] = bytes(rng.choice(b"0123456789") for _ in range(end - begin))
    return bytes(out)


WAYS: tuple[Way, ...] = (
    truncated,
    flipped,
    wounded,
    inserted,
    removed,
    duplicated,
    spliced,
    hostile_numbers,
    one_value_everywhere,
    hostile_words,
    renamed,
    other_counts,
)


def _place(raw: bytes, rng: random.Random) -> int:
    """Somewhere in the log, half of the time among the definitions."""
    return rng.randrange(min(len(raw), HEAD) if rng.random() < 0.5 else len(raw))


def _few(rng: random.Random, most: int) -> int:
    """1 to ``most``, small numbers as often as large ones."""
    return max(1, min(most, int(most ** rng.random())))
