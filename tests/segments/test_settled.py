"""Settled time of many spans at once equals that of each span alone, by plain arithmetic with sets of seconds."""

from __future__ import annotations

import numpy as np
import pytest

from attlog.segments.model import Segment, Segments
from attlog.segments.settled import AFTER_MOTORS_S, settled


@pytest.mark.parametrize("seed", range(5))
def test_settled_time_is_what_neither_start_nor_motors_disturb(seed: int) -> None:
    draw = np.random.default_rng(seed)
    edges = np.unique(draw.integers(0, 900, 40)).astype(float)
    rests = list(zip(edges[::2].tolist(), edges[1::2].tolist(), strict=False))
    flown = np.unique(draw.integers(0, 900, 12)).astype(float)
    segments = Segments(
        [Segment("armed", a, b) for a, b in zip(flown[::2].tolist(), flown[1::2].tolist(), strict=False)]
    )
    starts = sorted(draw.integers(20, 900, 3).astype(float).tolist())
    t = np.arange(0.0, 1000.0, 0.25) + 0.125
    free = t > starts[0]
    for begin in starts:
        free &= ~((t > begin) & (t < begin + 20.0))
    for one in segments.of("armed"):
        free &= ~((t > one.t1) & (t < one.t1 + AFTER_MOTORS_S))
    found = list(settled(rests, segments, starts, 20.0))
    assert len(found) == len(rests)
    for (t0, t1), spans in zip(rests, found, strict=True):
        inside = np.zeros(len(t), bool)
        for a, b in spans:
            assert t0 <= a < b <= t1
            inside |= (t > a) & (t < b)
        np.testing.assert_array_equal(inside, free & (t > t0) & (t < t1))


def test_without_a_start_nothing_is_settled() -> None:
    assert list(settled([(0.0, 10.0), (20.0, 30.0)], Segments(), [], 5.0)) == [[], []]


@pytest.mark.parametrize("kind", ["armed", "airborne", "idle"])
def test_every_sign_of_motors_that_stop_unsettles_and_what_tells_no_motor_does_not(kind: str) -> None:
    for name, free in ((kind, (30.0 + AFTER_MOTORS_S, 60.0)), ("hover", (30.0, 60.0))):
        (found,) = settled([(30.0, 60.0)], Segments([Segment(name, 10.0, 30.0)]), [0.0], 20.0)
        assert found == [free]
