"""The ways to break a log are repeatable, bounded, and do break it."""

from __future__ import annotations

import random

import pytest

from tests.conftest import SAMPLES
from tests.fuzz.mutate import LARGEST, WAYS, Way, mutated

RAW = (SAMPLES / "px4_hover.ulg").read_bytes()[:200_000]


@pytest.mark.parametrize("way", WAYS, ids=lambda w: w.__name__)
def test_a_way_gives_the_same_bytes_for_a_seed_and_mostly_others_than_before(way: Way) -> None:
    once = [way(RAW, random.Random(seed)) for seed in range(20)]
    assert once == [way(RAW, random.Random(seed)) for seed in range(20)]
    assert sum(broken != RAW for broken in once) >= 15
    assert all(len(broken) < LARGEST for broken in once)


@pytest.mark.parametrize("length", [1, 3, 17])
def test_almost_nothing_can_be_broken_too(length: int) -> None:
    assert all(isinstance(mutated(RAW[:length], seed), bytes) for seed in range(200))


def test_seeds_differ() -> None:
    assert len({mutated(RAW, seed) for seed in range(40)}) > 35
