"""Write columns as rows of CSV, numbers as machine code with the fewest digits that give them back.

A row is a line of bytes in which each column has cells of a fixed width. Bytes that a cell does not need are zero, and
go at the end.
"""

from __future__ import annotations

import math
import re
from collections.abc import Iterator, Sequence
from typing import Annotated, Any

import numpy as np
from numpy.typing import NDArray

from attlog.core import jit
from attlog.core.files import csv_cell

I2 = Annotated[NDArray[np.int64], jit.Cells("i8", 2)]
Block = Annotated[NDArray[np.uint8], jit.Cells("u1", 2, written=True)]

# Rows written together; bounds the memory of a block.
ROWS = 1 << 13
# Largest block; one with longer texts or more columns is written in halves.
BLOCK_BYTES = 1 << 24
# Bytes of the longest numbers, -1.2345678901234567e-308 and -9223372036854775807; of a quoted empty text.
FLOAT_BYTES, EMPTY_BYTES = 24, 2
BYTES = {"f2": FLOAT_BYTES, "f4": FLOAT_BYTES, "f8": FLOAT_BYTES, "i8": 20}
# Largest of both signs.
MAX_INTEGER = 2**63 - 1
# Digits that are enough for every single, and that never differ between two ways of rounding a double.
SINGLE_DIGITS, DOUBLE_DIGITS = 9, 15
# Powers of ten that a double holds exactly go to 22.
MAX_POWER = 22
POWERS = np.array([float(f"1e{k}") for k in range(-MAX_POWER, MAX_POWER + 1)])
# Numbers of at least this size are written without an exponent, to a size that Python has for doubles and numpy for
# singles.
MIN_POSITIONAL, MAX_POSITIONAL, MAX_POSITIONAL_SINGLE = 1e-4, 1e16, 1e6
# Share of the gap to the next single within which a decimal surely becomes this one, and beyond which surely not.
SURE_SHARE, POSSIBLE_SHARE = 0.5 - 2.0**-20, 0.5 + 2.0**-20
ZERO, MINUS, PLUS, POINT, EXPONENT = ord("0"), ord("-"), ord("+"), ord("."), ord("e")
QUOTED = re.compile('[,"\n]')


def csv_rows(columns: Sequence[NDArray[Any]]) -> Iterator[bytes]:
    """Yield the rows of columns of equal length, some thousand at a time; NaN and None are empty cells."""
    for first in range(0, len(columns[0]) if columns else 0, ROWS):
        yield _rows([column[first : first + ROWS] for column in columns])


def csv_texts(values: Sequence[Any]) -> list[bytes]:
    """Return values as cells that no spreadsheet executes, quoted where they hold a separator."""
    cells = ["" if value is None else str(csv_cell(value)) for value in values]
    quoted = [f'"{cell.replace(chr(34), 2 * chr(34))}"' if QUOTED.search(cell) else cell for cell in cells]
    return [cell.encode("utf-8", "replace") for cell in quoted]


def _rows(columns: list[NDArray[Any]]) -> bytes:
    kinds = [_kind(column) for column in columns]
    texts = {k: csv_texts(columns[k].tolist()) for k, kind in enumerate(kinds) if kind == "text"}
    widths = [max(EMPTY_BYTES, *map(len, texts[k])) if k in texts else BYTES[kind] for k, kind in enumerate(kinds)]
    ends = np.cumsum(np.array(widths, np.int64) + 1) - 1
    firsts, count = ends - widths, len(columns[0])
    if count > 1 and count * (ends[-1] + 1) > BLOCK_BYTES:
        return b"".join(
            _rows([column[part] for column in columns]) for part in (np.s_[: count // 2], np.s_[count // 2 :])
        )
    block = np.zeros((count, ends[-1] + 1), np.uint8)
    block[:, ends] = ord(",")
    block[:, -1] = ord("\n")
    for k, cells in texts.items():
        block[:, firsts[k] : ends[k]] = _fixed(np.array(cells, f"S{widths[k]}"))
    for kind in set(kinds).difference(["text"]):
        own = [k for k in range(len(columns)) if kinds[k] == kind]
        _put_numbers(block, firsts[own], np.array([columns[k] for k in own], kind))
    if len(columns) == 1:  # a line of nothing would be no row
        block[~block[:, :-1].any(axis=1), :EMPTY_BYTES] = ord('"')
    used: NDArray[np.uint8] = block[block != 0]
    return used.tobytes()


def _kind(column: NDArray[Any]) -> str:
    """Return the type as which a column is written: a key of BYTES, or ``text``."""
    if column.dtype in (np.int64, np.uint64) and (column.min() < -MAX_INTEGER or column.max() > MAX_INTEGER):
        return "text"
    if column.dtype.kind == "f":
        return f"f{min(column.dtype.itemsize, 8)}"
    return "i8" if column.dtype.kind in "iu" else "text"


def _fixed(cells: NDArray[np.bytes_]) -> NDArray[np.uint8]:
    """Return cells as a table of bytes."""
    return cells.view(np.uint8).reshape(len(cells), cells.dtype.itemsize)


def _put_numbers(block: NDArray[np.uint8], firsts: NDArray[np.int64], values: NDArray[Any]) -> None:
    """Write numbers, a row of ``values`` a column, into cells that begin at ``firsts``; numpy writes what is left."""
    if jit.jit_wanted():
        if values.dtype.kind == "i":
            put_integers(block, firsts, values)
        elif values.dtype != np.float16:
            _put_floats(block, firsts, values)
    width = BYTES[values.dtype.str[1:]]
    for first, column in zip(firsts, values, strict=True):
        left = np.flatnonzero((block[:, first] == 0) & ~np.isnan(column))
        if len(left):
            block[left, first : first + width] = _fixed(column[left].astype(f"S{width}"))


def _put_floats(block: NDArray[np.uint8], firsts: NDArray[np.int64], values: NDArray[Any]) -> None:
    """Write most singles or doubles."""
    with np.errstate(invalid="ignore", over="ignore"):
        x = values.astype(np.float64)
        if values.dtype == np.float32:
            size = np.abs(values)
            sure = SURE_SHARE * (size - np.nextafter(size, np.float32(0))).astype(np.float64)
            possible = POSSIBLE_SHARE * np.spacing(size).astype(np.float64)
            put_decimals(block, firsts, x, sure, possible, SINGLE_DIGITS, MAX_POSITIONAL_SINGLE, POWERS)
        else:
            exactly = np.zeros_like(x)
            put_decimals(block, firsts, x, exactly, exactly, DOUBLE_DIGITS, MAX_POSITIONAL, POWERS)


@jit.loop("the numbers of tables")
def put_decimals(
    block: Block, firsts: jit.I1, x: jit.F2, sure: jit.F2, possible: jit.F2, most: int, end: float, powers: jit.F1
) -> None:
    """Write numbers, a row of ``x`` a column of the block, each with the fewest digits that give it back.

    A decimal gives a number back if it differs by less than ``sure`` or not at all, and does not from ``possible`` on.
    Left empty: numbers between the two, those that need more than ``most`` digits or ``powers``, inf and NaN.
    Without an exponent below ``end``.
    """
    exponent = 0
    for c in range(len(firsts)):
        for i in range(len(block)):
            value = abs(x[c, i])
            if value == 0.0:
                put_number(block, i, put_sign(block, i, firsts[c], math.copysign(1.0, x[c, i]) < 0.0), 0, 1, 0, True)
            elif powers[most - 1] <= value < powers[2 * MAX_POWER]:
                while value < powers[MAX_POWER + exponent]:
                    exponent -= 1
                while value >= powers[MAX_POWER + exponent + 1]:
                    exponent += 1
                for count in range(1, most + 1):
                    number = np.rint(scaled(value, count - 1 - exponent, powers))
                    off = abs(scaled(number, exponent + 1 - count, powers) - value)
                    if off < sure[c, i] or off == 0.0:
                        up = 1 if count == 1 and number == 10.0 else 0  # to the next power of ten
                        at = put_sign(block, i, firsts[c], x[c, i] < 0.0)
                        positional = MIN_POSITIONAL <= value < end
                        put_number(block, i, at, 1 if up else int(number), count, exponent + up, positional)
                        break
                    if off < possible[c, i]:
                        break


def scaled(value: float, power: int, powers: NDArray[np.float64]) -> float:
    """Return a number times a power of ten, rounded once where the number is exact."""
    if power >= 0:
        return float(value * powers[MAX_POWER + power])
    return float(value / powers[MAX_POWER - power])


def put_number(
    block: NDArray[np.uint8], i: int, at: int, number: int, count: int, exponent: int, positional: bool
) -> None:
    """Write a number of ``count`` digits, the first of which counts 10^``exponent``."""
    before = max(-exponent, 0) if positional else 0
    whole = max(exponent + 1, 1) if positional else 1
    digits = max(before + count, whole + 1 if positional else 1)
    for k in range(digits - 1, -1, -1):
        digit = 0
        if k < before + count:
            digit, number = number % 10, number // 10
        block[i, at + k + (1 if k >= whole else 0)] = ZERO + digit
    if digits > whole:
        block[i, at + whole] = POINT
    if not positional:
        at += digits + (1 if digits > whole else 0)
        block[i, at], block[i, at + 1] = EXPONENT, MINUS if exponent < 0 else PLUS
        block[i, at + 2], block[i, at + 3] = ZERO + abs(exponent) // 10, ZERO + abs(exponent) % 10


def put_sign(block: NDArray[np.uint8], i: int, at: int, negative: bool) -> int:
    """Write a minus where there is one; return the place behind it."""
    if negative:
        block[i, at] = MINUS
    return at + negative


@jit.loop("the integers of tables")
def put_integers(block: Block, firsts: jit.I1, x: I2) -> None:
    """Write integers, a row of ``x`` a column of the block, into cells that begin at ``firsts``."""
    for c in range(len(firsts)):
        for i in range(len(block)):
            number = abs(x[c, i])
            at, count, above = put_sign(block, i, firsts[c], x[c, i] < 0), 1, number // 10
            while above > 0:
                count, above = count + 1, above // 10
            for k in range(count - 1, -1, -1):
                block[i, at + k] = ZERO + number % 10
                number //= 10
