"""How much memory this process may still take, and what a long log's steps freed given back to the system.

The C library keeps freed memory, in blocks that fit nothing.
"""

from __future__ import annotations

import functools
import sys
from collections.abc import Callable
from pathlib import Path

PROC, CGROUP = Path("/proc"), Path("/sys/fs/cgroup")


def free_bytes(proc: Path = PROC, cgroup: Path = CGROUP) -> int | None:
    """The least of what the machine has (free, or kept for files, or swap), what its control group may take, and what
    the process's own limit of address space leaves (``ulimit -v``); None where none of it is known."""
    limits = [_of_machine(proc), _of_group(cgroup), _of_process(proc)]
    return min((found for found in limits if found is not None), default=None)


def _of_machine(proc: Path) -> int | None:
    lines = _numbers(proc / "meminfo")
    return (lines["MemAvailable"] + lines.get("SwapFree", 0)) << 10 if "MemAvailable" in lines else None


def _of_group(cgroup: Path) -> int | None:
    """What a container is given; pages of files that it holds can be dropped."""
    most, held = _text(cgroup / "memory.max"), _text(cgroup / "memory.current")
    if not (most.isdecimal() and held.isdecimal()):
        return None
    return max(int(most) - int(held) + _numbers(cgroup / "memory.stat").get("file", 0), 0)


def _of_process(proc: Path) -> int | None:
    try:
        import resource
    except ImportError:  # Windows
        return None
    limit = resource.getrlimit(resource.RLIMIT_AS)[0]
    held = _numbers(proc / "self" / "status").get("VmSize")
    return None if limit == resource.RLIM_INFINITY or held is None else max(limit - (held << 10), 0)


def _numbers(path: Path) -> dict[str, int]:
    """Lines of a name and a whole number."""
    pairs = [line.replace(":", " ").split() for line in _text(path).splitlines()]
    return {pair[0]: int(pair[1]) for pair in pairs if len(pair) > 1 and pair[1].isdecimal()}


def _text(path: Path) -> str:
    try:
        return path.read_text().strip()
    except (OSError, ValueError):
        return ""


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
