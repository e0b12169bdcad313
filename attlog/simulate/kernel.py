"""Compiles the simulator's loops like the filters' kernels; plain Python where ATTLOG_NO_JIT asks for it."""

from __future__ import annotations

import functools
from collections.abc import Callable
from typing import Any

from attlog.kernels import cache, generate
from attlog.kernels.kernel import Kernel
from attlog.kernels.obtain import obtained

SOURCES = ("simulate", "estimators", "kernels", "earth.py", "errors.py", "limits.py", "rotation.py")
"""Files below the package that say what a loop of the simulator does."""
Scratch = tuple[tuple[str, tuple[int, ...]], ...]


def kernel_of(function: Callable[..., Any], signature: str, what: str, scratch: Scratch = ()) -> Kernel:
    """``function`` (arrays and numbers only, the last ``scratch`` of them its own) for a compiler."""
    name = function.__name__

    text = functools.partial(generate.with_helpers, {name: function}, jit=True)
    return Kernel(f"simulate {name}", name, text, signature, what, SOURCES, scratch)


@functools.lru_cache(maxsize=32)
def function_of(kernel: Kernel, plain: Callable[..., Any]) -> Callable[..., Any]:
    """The compiled kernel, or ``plain``, the function it was made of."""
    return obtained(kernel) if cache.jit_wanted() else lambda *values: plain(*values, *kernel.room())
