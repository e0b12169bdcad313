"""Plain loops over arrays and numbers as kernels: compiled, or themselves where ATTLOG_NO_JIT asks for it."""

from __future__ import annotations

import functools
from collections.abc import Callable
from typing import Any

from attlog.kernels import cache, generate
from attlog.kernels.kernel import Kernel
from attlog.kernels.obtain import obtained

Scratch = tuple[tuple[str, tuple[int, ...]], ...]


def kernel_of(
    function: Callable[..., Any],
    signature: str,
    room: str,
    what: str,
    sources: tuple[str, ...],
    scratch: Scratch = (),
) -> Kernel:
    """``function`` (arrays and numbers only, the last ``scratch`` of them its own) for a compiler.

    ``room``: what comes before its name where kernels are told apart; ``sources`` as of :class:`Kernel`.
    """
    name = function.__name__
    text = functools.partial(generate.with_helpers, {name: function}, jit=True)
    return Kernel(f"{room} {name}", name, text, signature, what, sources, scratch)


@functools.lru_cache(maxsize=64)
def function_of(kernel: Kernel, plain: Callable[..., Any]) -> Callable[..., Any]:
    """The compiled kernel, or ``plain``, the function it was made of."""
    return obtained(kernel) if cache.jit_wanted() else lambda *values: plain(*values, *kernel.room())
