"""A reader's loop as machine code, only where that pays: where its object code is at hand, or the compiler is loaded.

Importing numba and compiling cost more than a compiled loop saves on one log.
"""

from __future__ import annotations

import functools
import sys
from collections.abc import Callable
from typing import Any

from attlog.kernels import cache, generate
from attlog.kernels.kernel import Kernel
from attlog.kernels.obtain import at_hand, obtained


def kernel_of(loop: Callable[..., Any], signature: str, source: str) -> Kernel:
    """A loop (arrays and numbers only) for numba's ``signature``; ``source``: its file below the package."""
    name = loop.__name__
    text = functools.partial(generate.with_helpers, {name: loop}, jit=True)
    return Kernel(f"{source} {name}", name, text, signature, f"the reader's {name}", (source, "kernels"))


def if_cheap(kernel: Kernel) -> Callable[..., Any] | None:
    """The compiled loop; None where it would have to be compiled by a process that has no compiler loaded."""
    if not cache.jit_wanted():
        return None
    return at_hand(kernel) or (obtained(kernel) if "numba" in sys.modules else None)
