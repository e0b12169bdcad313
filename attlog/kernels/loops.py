"""Plain loops over arrays and numbers as kernels: compiled, or themselves where ATTLOG_NO_JIT asks for it."""

from __future__ import annotations

import functools
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from contextvars import ContextVar
from typing import Any

from attlog.kernels.kernel import Kernel

Scratch = tuple[tuple[str, tuple[int, ...]], ...]


def kernel_of(
    function: Callable[..., Any], signature: str, room: str, what: str, sources: tuple[str, ...], scratch: Scratch = ()
) -> Kernel:
    """``function`` (arrays and numbers only, the last ``scratch`` of them its own) for a compiler.

    ``room``: what comes before its name where kernels are told apart; ``sources`` as of :class:`Kernel`.
    """
    name = function.__name__

    def text() -> str:
        from attlog.kernels import generate

        return generate.with_helpers({name: function}, jit=True)

    return Kernel(f"{room} {name}", name, text, signature, what, sources, scratch)


_BRIEFLY = ContextVar("briefly", default=False)


@contextmanager
def briefly() -> Iterator[None]:
    """A block that looks at little data: what numpy can do at once as well, no compiled loop is loaded for.

    To import llvmlite and to load a loop costs 60 ms and 50 MB, more than all the interpolation of a short log.
    """
    before = _BRIEFLY.set(True)
    try:
        yield
    finally:
        _BRIEFLY.reset(before)


def function_of(
    kernel: Kernel, plain: Callable[..., Any], at_once: Callable[..., Any] | None = None
) -> Callable[..., Any]:
    """The compiled kernel, or ``plain``, the function it was made of; ``briefly`` its twin ``at_once`` in numpy."""
    return at_once if at_once is not None and _BRIEFLY.get() else _loaded(kernel, plain)


@functools.lru_cache(maxsize=64)
def _loaded(kernel: Kernel, plain: Callable[..., Any]) -> Callable[..., Any]:
    from attlog.kernels import cache
    from attlog.kernels.obtain import obtained

    return obtained(kernel) if cache.jit_wanted() else lambda *values: plain(*values, *kernel.room())
