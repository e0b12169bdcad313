"""Arithmetic with segments agrees with counting seconds one by one."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from attlog.core import spans

END = 30
segments = st.lists(
    st.tuples(st.integers(0, END), st.integers(0, END)).map(lambda s: (float(min(s)), float(max(s)))), max_size=8
)
CELLS = np.arange(END) + 0.5


def cells(found: list[tuple[float, float]]) -> np.ndarray:
    """Which whole seconds lie in a segment, by looking at each."""
    return np.array([any(a <= c <= b for a, b in found) for c in CELLS])


@given(a=segments, b=segments)
def test_intersection_complement_and_length_are_those_of_the_single_seconds(a, b):
    np.testing.assert_array_equal(cells(spans.intersect(a, b)), cells(a) & cells(b))
    np.testing.assert_array_equal(cells(spans.complement(a, 0, END)), ~cells(a))
    np.testing.assert_array_equal(cells(spans.merge(a)), cells(a))
    assert spans.seconds(a) == cells(a).sum()


@given(a=segments, windows=segments)
def test_inside_and_overlaps_agree_with_looking_at_each(a, windows):
    real = [s for s in a if s[1] > s[0]]
    np.testing.assert_array_equal(spans.inside(CELLS, a), cells(real))
    if windows:
        t0, t1 = (np.array(x) for x in zip(*windows, strict=True))
        expected = [any(x0 <= b and x1 >= a0 for a0, b in real) for x0, x1 in windows]
        np.testing.assert_array_equal(spans.overlaps(t0, t1, a), expected)


def test_what_lies_between_two_times_is_what_a_mask_says():
    t = np.cumsum(np.random.default_rng(0).uniform(0.1, 1.0, 200))
    for t0, t1 in ((0.0, 5.0), (float(t[10]), float(t[20])), (50.0, 50.01), (-2.0, -1.0), (1e3, 2e3)):
        np.testing.assert_array_equal(t[spans.between(t, t0, t1)], t[(t >= t0) & (t <= t1)])


@given(a=segments, edges=st.lists(st.integers(0, END), max_size=12))
def test_clipping_to_pieces_that_touch_is_cutting_each_of_them_out(a, edges):
    pieces = [(float(x), float(y)) for x, y in pairwise(sorted(edges))]
    expected = [s for piece in pieces for s in spans.intersect(a, [piece])]
    assert spans.clipped(a, pieces) == expected
