"""Memory goes back to the system after a step over many samples."""

from __future__ import annotations

import re
import sys
from pathlib import Path

import numpy as np
import pytest

from attlog.base import memory

glibc = pytest.mark.skipif(
    not sys.platform.startswith("linux") or memory._trim() is None, reason="only glibc gives memory back when told"
)


def resident_mb() -> float:
    found = re.search(r"RssAnon:\s+(\d+)", Path("/proc/self/status").read_text())
    assert found is not None
    return int(found.group(1)) / 1024


@glibc
def test_what_is_freed_between_what_is_kept_leaves_the_process() -> None:
    # Below the size that the C library maps by itself at first, and each followed by one that stays.
    pieces = [np.ones(12_000) for _ in range(1_000)]
    held = pieces[::2][-250:], pieces[-1]
    before = resident_mb()
    del pieces
    assert memory.give_back(memory.MANY)
    assert resident_mb() < before - 40
    assert held[1][0] == 1.0


def test_a_short_log_is_left_alone() -> None:
    assert not memory.give_back(memory.MANY - 1)
