"""Compute a question about a sensor or attitude once, and release the answer with the block.

The answers of a long log are as large as the log; they go before filters run.
"""

from __future__ import annotations

import functools
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from contextvars import ContextVar
from typing import Any, ParamSpec, TypeVar

P = ParamSpec("P")
T = TypeVar("T")

_FOUND: ContextVar[dict[tuple[Any, ...], tuple[Any, Any]] | None] = ContextVar("found", default=None)


@contextmanager
def log_cache() -> Iterator[None]:
    """Open a block of cached answers; nested blocks share them.

    The log must not change within it.
    """
    before = _FOUND.set({} if (found := _FOUND.get()) is None else found)
    try:
        yield
    finally:
        _FOUND.reset(before)


def cached_per_log(compute: Callable[P, T]) -> Callable[P, T]:
    """Cache a function of objects (by identity) per block.

    Callers must not write into the answer.
    """

    @functools.wraps(compute)
    def shared(*args: P.args, **kwargs: P.kwargs) -> T:
        found = _FOUND.get()
        if found is None or kwargs:
            return compute(*args, **kwargs)
        key = (compute, *map(id, args))
        if key not in found:
            found[key] = args, compute(*args, **kwargs)  # the objects, too: a later one never has the place of one gone
        answer: T = found[key][1]
        return answer

    return shared
