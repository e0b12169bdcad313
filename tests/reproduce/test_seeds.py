"""One experiment for many seeds: the same numbers in their order however many processes, and a death is told."""

from __future__ import annotations

import os

import pytest

from attlog.base.errors import AttlogError
from attlog.reproduce.lyu import runs as lyu_runs
from attlog.reproduce.paper import PaperOptions
from attlog.reproduce.samples import samples
from attlog.reproduce.seeds import each_seed
from attlog.simulate.fly import fly


def second(seed: int, angle: float) -> float:
    """The sum of all rates of a second of a lift."""
    board = lyu_runs.board(1.0, lyu_runs.lifted(angle))
    return float(samples(fly(board, seed), mag=False).gyr.sum())


def gone(seed: int) -> int:
    """Ends its process when its turn comes."""
    if seed == 1:
        os._exit(3)
    return seed


@pytest.mark.slow
def test_the_same_seeds_give_the_same_numbers_in_several_processes() -> None:
    alone, both = (each_seed("seconds", second, PaperOptions(seeds=3, processes=n), 20.0) for n in (1, 2))
    assert alone == both
    assert len(set(alone)) == 3
    assert alone[2] == second(2, 20.0)


@pytest.mark.slow
def test_a_process_that_dies_is_told_with_its_number() -> None:
    with pytest.raises(AttlogError, match="seeds, number 1"):
        each_seed("seeds", gone, PaperOptions(seeds=3, processes=2))
