"""Packing gives back what went in."""

from __future__ import annotations

import base64
import gzip
import json

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp

from attlog.report.pack import Store

FINITE = st.floats(-180, 180, width=32)


def unpacked(text: str) -> tuple[object, bytes]:
    """Header and array bytes of a packed block, read as the page's script does."""
    raw = gzip.decompress(base64.b64decode(text))
    size = int.from_bytes(raw[:4], "little")
    return json.loads(raw[4 : 4 + size]), raw[4 + size :]


def integers(place: dict, raw: bytes, dtype: str) -> np.ndarray:
    """The stored integers of one array."""
    width = np.dtype(dtype).itemsize
    parts = np.frombuffer(raw[place["o"] : place["o"] + width * place["n"]], np.uint8).reshape(width, place["n"])
    return np.cumsum(np.ascontiguousarray(parts.T).view(dtype).ravel(), dtype=dtype)


@given(hnp.arrays(np.float64, st.integers(1, 300), elements=FINITE | st.just(np.nan)))
def test_values_come_back_within_half_a_step(y):
    store = Store()
    place = store.values(y, 0.01)
    _, raw = unpacked(store.pack({}))
    whole = integers(place, raw, "<i2")
    assert np.array_equal(whole == -32768, np.isnan(y))
    good = ~np.isnan(y)
    assert np.all(np.abs(whole[good] * place["s"] - y[good]) <= 0.5001 * place["s"])
    assert place["s"] == 0.01


@pytest.mark.parametrize("size", [1e-4, 1e-3, 1.0, 5000.0, 1e9])
def test_the_step_grows_with_the_range(size):
    store = Store()
    y = size * np.linspace(-1, 1, 101)
    place = store.values(y)
    whole = integers(place, unpacked(store.pack({}))[1], "<i2")
    assert np.max(np.abs(whole * place["s"] - y)) <= 0.51 * place["s"]
    assert place["s"] < size / 16000


def test_times_of_a_long_log_keep_a_tenth_of_a_millisecond():
    store = Store()
    t = np.arange(0, 6 * 3600, 0.25) + 0.00012
    place = store.times(t)
    back = integers(place, unpacked(store.pack({}))[1], "<i4") * place["s"]
    assert np.max(np.abs(back - t)) <= 0.51e-4


def test_equal_arrays_are_stored_once():
    store = Store()
    t = np.arange(1000) * 0.004
    assert store.times(t) == store.times(t.copy())
    assert len(unpacked(store.pack({}))[1]) == 4000


def test_the_same_input_gives_the_same_bytes():
    def block():
        store = Store()
        store.values(np.sin(np.arange(1000)), 0.01)
        return store.pack({"a": 1})

    assert block() == block()
