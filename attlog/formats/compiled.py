"""A reader's loop as machine code, only where that pays: where its object code is at hand, or the compiler is loaded.

Importing numba and compiling cost more than a compiled loop saves on one log.
"""

from __future__ import annotations

import functools
import sys
from collections import Counter
from collections.abc import Callable
from typing import Any

from attlog.kernels import loops
from attlog.kernels.kernel import Kernel

WORTH_IF_READY = 1 << 18
"""Bytes from which a compiled loop is worth being asked for, in a process that has loaded compiled code already."""


def kernel_of(loop: Callable[..., Any], signature: str, source: str, *helpers: str) -> Kernel:
    """A loop (arrays and numbers only) for numba's ``signature``.

    ``source``: its file below the package; ``helpers``: those of functions that it calls.
    """
    return loops.kernel_of(loop, signature, source, f"the reader's {loop.__name__}", (source, *helpers, "kernels"))


@functools.cache
def if_cheap(kernel: Kernel) -> Callable[..., Any] | None:
    """The compiled loop; None where it would have to be compiled by a process that has no compiler loaded."""
    from attlog.kernels import cache
    from attlog.kernels.obtain import at_hand, obtained  # short logs are read without

    if not cache.jit_wanted():
        return None
    return at_hand(kernel) or (obtained(kernel) if "numba" in sys.modules else None)


def at_any_cost(kernel: Kernel) -> Callable[..., Any]:
    """The compiled loop, compiled now where no object is at hand."""
    from attlog.kernels.obtain import obtained

    return obtained(kernel)


def is_ready(size: int) -> bool:
    """Whether compiled code is loaded already, and so many bytes are worth a compiled loop."""
    return size >= WORTH_IF_READY and "llvmlite" in sys.modules


def pays(reader: str, size: int, alone: int) -> bool:
    """Whether a log of so many bytes is worth compiled loops.

    Loading code is, from ``alone`` bytes on; logs that were read without it before count as well, since a process that
    read so many will read more. So reading never costs much more than twice what it would have cost either way.
    """
    if size < WORTH_IF_READY or "llvmlite" in sys.modules:
        return size >= WORTH_IF_READY
    without = _without()
    without[reader] += size
    return without[reader] >= alone


@functools.cache
def _without() -> Counter[str]:
    """Bytes of logs that this process was asked for while it had no compiled code, by reader."""
    return Counter()
