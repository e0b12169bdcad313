"""The compiled search for MAVLink packets finds what the numpy search finds."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from attlog.formats.mapping import map_bytes
from attlog.formats.mavlink import index, reader
from attlog.formats.mavlink.compiled import compiled_packets
from tests.conftest import SAMPLES, corpus_logs


@pytest.mark.parametrize("path", corpus_logs(".tlog", ".mavlink"), ids=lambda p: p.name)
def test_compiled_search_equals_numpy_search(path: Path) -> None:
    data, known = map_bytes(path), reader.catalogue()
    expected = index.searched(data, known)
    for mine, theirs in zip(compiled_packets(data, known.seeds, known.sizes), expected, strict=True):
        assert np.array_equal(mine, theirs)


@pytest.mark.parametrize("seed", range(5))
def test_compiled_search_equals_numpy_search_on_damaged_bytes(seed: int) -> None:
    dice = np.random.default_rng(seed)
    data, known = map_bytes(SAMPLES / "copter_steps_stabilize.tlog")[:200_000].copy(), reader.catalogue()
    for at in dice.integers(0, len(data) - 300, 60).tolist():
        data[at : at + int(dice.integers(1, 300))] = dice.choice([0, 0xFD, 0xFE, 0xFF])
    data.flags.writeable = False
    expected = index.searched(data, known)
    for mine, theirs in zip(compiled_packets(data, known.seeds, known.sizes), expected, strict=True):
        assert np.array_equal(mine, theirs)
