"""Available memory, release of memory, number of processors, and software versions."""

from __future__ import annotations

import functools
import os
import platform
import sys
from collections.abc import Callable
from pathlib import Path

import numpy as np

import attlog

PROC, CGROUP = Path("/proc"), Path("/sys/fs/cgroup")


def cores() -> int:
    """Return how many processors this process may use."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


def available_bytes(proc: Path = PROC, cgroup: Path = CGROUP) -> int | None:
    """Return the memory in bytes available to this process, None if unknown.

    The minimum of the machine's free memory (with file cache and swap), the rest of the control group's limit, and the
    rest of the address space limit (``ulimit -v``).
    """
    limits = [_machine_limit(proc), _cgroup_limit(cgroup), _process_limit(proc)]
    return min((found for found in limits if found is not None), default=None)


def _machine_limit(proc: Path) -> int | None:
    lines = _read_numbers(proc / "meminfo")
    return (lines["MemAvailable"] + lines.get("SwapFree", 0)) << 10 if "MemAvailable" in lines else None


def _cgroup_limit(cgroup: Path) -> int | None:
    """Return the rest of a container's memory; its file pages can be dropped."""
    most, held = _read_text(cgroup / "memory.max"), _read_text(cgroup / "memory.current")
    if not (most.isdecimal() and held.isdecimal()):
        return None
    return max(int(most) - int(held) + _read_numbers(cgroup / "memory.stat").get("file", 0), 0)


def _process_limit(proc: Path) -> int | None:
    try:
        import resource
    except ImportError:  # Windows
        return None
    limit = resource.getrlimit(resource.RLIMIT_AS)[0]
    held = _read_numbers(proc / "self" / "status").get("VmSize")
    return None if limit == resource.RLIM_INFINITY or held is None else max(limit - (held << 10), 0)


def _read_numbers(path: Path) -> dict[str, int]:
    """Parse lines of a name and a whole number."""
    pairs = [line.replace(":", " ").split() for line in _read_text(path).splitlines()]
    return {pair[0]: int(pair[1]) for pair in pairs if len(pair) > 1 and pair[1].isdecimal()}


def _read_text(path: Path) -> str:
    try:
        return path.read_text().strip()
    except (OSError, ValueError):
        return ""


# Smaller arrays are reused from the memory that the C library keeps.
MIN_TRIMMED_SAMPLES = 100_000


def release_memory(samples: int) -> bool:
    """Return freed memory to the system after a long step.

    False where the C library cannot. The C library keeps freed blocks that fit no later request.
    """
    trim = _malloc_trim() if samples >= MIN_TRIMMED_SAMPLES else None
    return trim is not None and bool(trim(0))


@functools.lru_cache(maxsize=1)
def _malloc_trim() -> Callable[[int], int] | None:
    """Return ``malloc_trim`` of glibc, None elsewhere: other C libraries keep less."""
    if not sys.platform.startswith("linux"):
        return None
    import ctypes

    found: Callable[[int], int] | None = getattr(ctypes.CDLL(None), "malloc_trim", None)
    return found


def versions() -> dict[str, str]:
    """Return the versions of attlog, Python and numpy, and the processor."""
    return {
        "version": attlog.__version__,
        "python": platform.python_version(),
        "numpy": np.__version__,
        # ``platform.processor`` starts ``uname``, which on Linux returns the same or nothing.
        "cpu": os.environ.get("PROCESSOR_IDENTIFIER") or platform.machine(),
    }
