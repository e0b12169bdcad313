"""The compiled walk along a DataFlash file finds what the search for marks finds, or leaves the file to it."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

from attlog.formats.dataflash import index
from attlog.formats.mapping import map_bytes
from tests.conftest import SAMPLES, corpus_logs
from tests.fuzz.mutate import mutated

LOG = SAMPLES / "copter_steps_stabilize.bin"


def both(data: NDArray[np.uint8]) -> bool:
    """Whether the walk takes the file; then its index is that of the search."""
    walked = index._walked(data)
    if walked is None:
        return False
    searched = index.searched(data)
    assert walked.layouts == searched.layouts
    for name in ("offsets", "layout", "stamps"):
        mine, theirs = getattr(walked, name), getattr(searched, name)
        assert np.array_equal(mine, theirs), name
    assert walked.losses.listed == searched.losses.listed
    assert (walked.losses.places, walked.losses.bytes) == (searched.losses.places, searched.losses.bytes)
    return True


@pytest.mark.parametrize("path", corpus_logs(".bin", ".px4log"), ids=lambda p: p.name)
def test_undamaged_logs_are_walked_and_give_the_same_index(path: Path) -> None:
    data = map_bytes(path)
    whole = all(d.offset + d.length == len(data) and d.length < 256 for d in index.searched(data).losses.listed)
    assert both(data) or not whole or path.name.startswith("made_")


@pytest.mark.parametrize("cut", range(1, 120))
def test_a_file_cut_anywhere_gives_the_same_index(cut: int) -> None:
    assert both(map_bytes(LOG)[: 150_000 - cut])


def test_broken_files_give_the_same_index_or_are_searched() -> None:
    raw = LOG.read_bytes()[:150_000]
    walked = [both(np.frombuffer(mutated(raw, seed), np.uint8)) for seed in range(120)]
    assert 5 < sum(walked) < 115, "some are still whole, some are not"


def test_definitions_beyond_the_limits_are_searched() -> None:
    raw = LOG.read_bytes()
    first = raw[89 : 2 * 89]
    more = [first[:25] + b"%d" % k + first[25 + len(b"%d" % k) :] for k in range(100)]
    assert not both(np.frombuffer(raw[:89] + b"".join(more) + raw[89:150_000], np.uint8))
