"""Records sorted by kind and bytes copied, by compiled loops and by numpy alone."""

from __future__ import annotations

import numpy as np
import pytest

from attlog.formats import compiled, grouping, mapping
from attlog.formats.grouping import by_kind
from attlog.formats.mapping import gather
from attlog.kernels.obtain import obtained


@pytest.fixture(params=["compiled", "numpy"])
def loops(request: pytest.FixtureRequest, monkeypatch: pytest.MonkeyPatch) -> str:
    """Both ways of the loops, whatever this process has loaded."""
    for module in (grouping, mapping):
        monkeypatch.setattr(module, "is_ready", lambda size: request.param == "compiled")
        monkeypatch.setattr(module, "if_cheap", obtained)
    return str(request.param)


@pytest.mark.parametrize("kinds", [1, 7, 300])
def test_records_of_a_kind_stay_in_file_order(kinds: int, loops: str) -> None:
    rng = np.random.default_rng(kinds)
    offsets = np.cumsum(rng.integers(1, 99, 5000)).astype(np.int32)
    kind = rng.integers(0, kinds, 5000).astype(np.uint16) * np.uint16(65535 // kinds)
    found = by_kind([(offsets[:3], kind[:3]), (offsets[3:], kind[3:])])
    assert [k for k, _ in found] == sorted({*kind.tolist()})
    for k, mine in found:
        assert mine.tolist() == [at for at, this in zip(offsets.tolist(), kind.tolist(), strict=True) if this == k]


@pytest.mark.parametrize("size", [1, 2, 8, 15, 16, 17, 44, 300])
def test_bytes_are_copied_from_any_place_up_to_the_last(size: int, loops: str) -> None:
    rng = np.random.default_rng(size)
    data = rng.integers(0, 256, 2000).astype(np.uint8)
    at = np.append(rng.integers(0, 2001 - size, 500), 2000 - size).astype(np.int32)
    rows = gather(data, at, np.dtype((np.uint8, (size,))))
    assert rows.tobytes() == b"".join(data[k : k + size].tobytes() for k in at.tolist())


@pytest.mark.parametrize("place", [-1, 1985, 2**31 - 1])
def test_a_place_outside_the_file_is_refused_not_read(place: int, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(mapping, "is_ready", lambda size: True)
    monkeypatch.setattr(mapping, "if_cheap", obtained)
    with pytest.raises(IndexError):
        gather(np.zeros(2000, np.uint8), np.array([0, place], np.int32), np.dtype("S16"))


def test_a_process_that_reads_many_logs_loads_compiled_code(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delitem(compiled.sys.modules, "llvmlite", raising=False)
    name = "a reader of this test"
    told = [compiled.pays(name, 10 << 20, 25 << 20) for _ in range(4)]
    assert told == [False, False, True, True]
    assert not compiled.pays(name, 1000, 25 << 20)
