"""The compiled search for MAVLink packets finds what the numpy search finds."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from attlog.formats.mapping import map_bytes
from attlog.formats.mavlink import index, reader
from attlog.formats.mavlink.compiled import compiled_packets
from attlog.kernels.obtain import obtained
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


@pytest.mark.parametrize("version", [0xFE, 0xFD])
def test_compiled_payloads_are_numpys_also_short_ones_and_at_the_end_of_the_file(
    version: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Messages of every length: shorter than the record, longer, the last one without room for a whole record."""
    head = 6 if version == 0xFE else 10
    packets = [bytes([version, length]) + bytes(head - 2) + bytes(range(1, length + 1)) for length in range(60)]
    data = np.frombuffer(b"".join(packets), np.uint8)
    offsets = np.cumsum([0, *(len(packet) for packet in packets[:-1])]).astype(np.int32)
    record = np.dtype([("a", "<f4"), ("b", "(9,)<u4"), ("c", "S3")])
    size = record.itemsize
    monkeypatch.setattr(reader, "is_ready", lambda size: False)
    by_numpy = reader.payloads(data, offsets, record)
    monkeypatch.setattr(reader, "is_ready", lambda size: True)
    monkeypatch.setattr(reader, "if_cheap", obtained)
    compiled = reader.payloads(data, offsets, record)
    assert by_numpy.tobytes() == compiled.tobytes()
    assert compiled.tobytes() == b"".join(bytes(range(1, n + 1))[:size].ljust(size, b"\0") for n in range(60))
