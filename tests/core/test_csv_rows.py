"""Rows of CSV: what is written gives each number back, in the fewest digits."""

from __future__ import annotations

import csv
import io
import tracemalloc

import numpy as np
import pytest

from attlog.core.csv_rows import BLOCK_BYTES, ROWS, csv_rows

RNG = np.random.default_rng(52)
EDGES = [0.0, -0.0, np.inf, -np.inf, 1e-5, 1e-4, 0.00123, 1.0, -12.5, 1e6, 1e15, 1e16, 1.5e22, 2.0**30, 5e-324, 1e300]
# Powers of two have a narrower gap below; of ten, many are just below their decimal.
POWERS = [s * b**k for s in (1.0, -1.0) for b in (2.0, 10.0) for k in range(-30, 31)]


def cells(*columns):
    """Return rows as a reader of CSV sees them."""
    return list(csv.reader(io.StringIO(b"".join(csv_rows(columns)).decode())))


@pytest.mark.parametrize("compiled", [True, False])
@pytest.mark.parametrize("kind", [np.float16, np.float32, np.float64])
def test_floats_read_back_as_they_were_in_the_digits_of_numpy(kind, compiled, monkeypatch):
    monkeypatch.setenv("ATTLOG_NO_JIT", "0" if compiled else "1")
    digits = np.array([float(f"{x:.6g}") for x in 10 ** RNG.uniform(-12, 20, 500)])
    with np.errstate(over="ignore", under="ignore"):
        values = np.concatenate([EDGES, POWERS, RNG.normal(size=500), digits, RNG.integers(0, 2**31, 500)]).astype(kind)
    values = np.concatenate([values, np.nextafter(values, kind(0)), np.nextafter(values, kind(np.inf))])
    written = [row[0] for row in cells(values, values)]
    assert np.array_equal(np.array(written, kind), values)
    assert np.array_equal(np.signbit(np.array(written, kind)), np.signbit(values))
    assert written == values.astype(str).tolist()


@pytest.mark.parametrize("compiled", [True, False])
@pytest.mark.parametrize("kind", [np.int8, np.uint8, np.int16, np.uint32, np.int64, np.uint64])
def test_integers_are_written_whole(kind, compiled, monkeypatch):
    monkeypatch.setenv("ATTLOG_NO_JIT", "0" if compiled else "1")
    info = np.iinfo(kind)
    values = np.array([0, 1, 9, 10, 99, 100, info.max, info.min, info.max - 1], kind)
    assert [int(row[1]) for row in cells(values, values)] == values.tolist()


def test_texts_are_quoted_and_defused_beside_numbers_and_empty_cells():
    texts = np.array(["plain", 'a "quoted", text', "two\nlines", "=SUM(A1)", "", "ä µ", None], object)
    x = np.array([1.5, np.nan, 3, 4, 5, 6, 7], np.float32)
    rows = cells(x, texts, x > 3)
    assert [row[1] for row in rows] == ["plain", 'a "quoted", text', "two\nlines", "'=SUM(A1)", "", "ä µ", ""]
    assert [row[0] for row in rows] == ["1.5", "", "3.0", "4.0", "5.0", "6.0", "7.0"]
    assert [row[2] for row in rows] == ["False"] * 3 + ["True"] * 4


def test_one_long_text_does_not_widen_thousands_of_rows():
    texts = np.array(["a"] * ROWS, object)
    texts[ROWS // 3] = "b" * 60_000
    tracemalloc.start()
    rows = cells(np.arange(ROWS), texts)
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert [row[1] for row in rows] == texts.tolist()
    assert [int(row[0]) for row in rows] == list(range(ROWS))
    assert peak < 6 * BLOCK_BYTES


def test_a_row_of_one_empty_cell_remains_a_row():
    assert b"".join(csv_rows([np.array([1.0, np.nan, 2.0])])) == b'1.0\n""\n2.0\n'
    assert b"".join(csv_rows([np.array(["", "a"], object)])) == b'""\na\n'


def test_rows_go_on_over_blocks_and_no_rows_are_none():
    t = np.arange(2 * ROWS + 3) / 1e6
    assert [float(row[0]) for row in cells(t, t)] == t.tolist()
    assert list(csv_rows([np.zeros(0), np.zeros(0, np.int64)])) == []
    assert list(csv_rows([])) == []
