"""Compile a loop of a reader with numba, only where that pays.

Importing numba costs more than compiled loops save on one log, so they are used
where something else (an estimator) has loaded it, for large files, and where
numba can keep the machine code for the next process.
"""

from __future__ import annotations

import sys
from collections.abc import Callable
from typing import Any


def numba_is_loaded() -> bool:
    """Whether this process has imported numba already."""
    return "numba" in sys.modules


def compile_once(signature: Any, loop: Callable[..., Any]) -> Any | None:
    """The compiled loop, its machine code kept in numba's cache folder; None where no such folder is writable."""
    import numba

    try:
        return numba.njit(signature, error_model="numpy", nogil=True, cache=True)(loop)
    except RuntimeError:  # numba's word for "no folder for the cache": compiling in each process would cost seconds
        return None
