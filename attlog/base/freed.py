"""What a long log's steps freed, given back to the system: the C library keeps it, cut into pieces that fit nothing."""

from __future__ import annotations

import functools
import sys
from collections.abc import Callable

MANY = 100_000
"""Samples from which it is worth its time: arrays of less are used again from what is kept."""


def give_back(samples: int) -> bool:
    """Give freed memory back after a step over so many samples; False where there is nothing to be done."""
    trim = _trim() if samples >= MANY else None
    return trim is not None and bool(trim(0))


@functools.lru_cache(maxsize=1)
def _trim() -> Callable[[int], int] | None:
    """``malloc_trim`` of glibc; other C libraries have none, and none of their own accord keeps as much."""
    if not sys.platform.startswith("linux"):
        return None
    import ctypes

    found: Callable[[int], int] | None = getattr(ctypes.CDLL(None), "malloc_trim", None)
    return found
