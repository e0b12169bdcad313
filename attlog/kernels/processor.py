"""Which instructions may a kernel use?

Objects that are shipped are made for a level that many processors share, objects that are made on this machine for its
own. numba does not contract or reorder floating point unless told so, and no kernel tells it: all of them give the same
bits, up to what the C library's sin, exp and log give.
"""

from __future__ import annotations

import os
import platform
import sys
from functools import lru_cache

LEVELS = {
    "x86-64-v3": "avx avx2 bmi bmi2 f16c fma lzcnt movbe sse4.2 popcnt",
    "x86-64-v2": "cx16 popcnt sse3 sse4.1 sse4.2 ssse3",
}
"""Architecture levels of the x86-64 ABI, best first, and what they need (names as LLVM writes them)."""


@lru_cache(maxsize=1)
def target() -> tuple[str, str]:
    """Name and features of the processor that numba compiles for here; it heeds these variables as well."""
    import llvmlite.binding as llvm

    name = os.environ.get("NUMBA_CPU_NAME") or llvm.get_host_cpu_name()
    features = os.environ.get("NUMBA_CPU_FEATURES")
    if features is None:
        features = "" if "NUMBA_CPU_NAME" in os.environ else llvm.get_host_cpu_features().flatten()
    return name, features


def portable() -> tuple[str, ...]:
    """The levels for which objects are shipped on this kind of machine, best first."""
    if platform.machine().lower() in ("x86_64", "amd64"):
        return tuple(LEVELS)
    return ("generic",)


@lru_cache(maxsize=1)
def levels() -> tuple[str, ...]:
    """Those of them that this machine can run, best first."""
    import llvmlite.binding as llvm

    have = {name for name, there in llvm.get_host_cpu_features().items() if there}
    return tuple(level for level in portable() if set(LEVELS.get(level, "").split()) <= have)


def machine() -> str:
    """Which object files this system loads: their format and architecture."""
    return f"{sys.platform}-{platform.machine().lower()}"
