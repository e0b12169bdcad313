"""Cache results computed from a sensor or attitude within a ``with`` block.

Cached results of a long log take as much memory as the log; they are released before filters run.
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
    """Cache results until the block ends; nested blocks share one cache.

    The log must not change within it.
    """
    before = _FOUND.set({} if (found := _FOUND.get()) is None else found)
    try:
        yield
    finally:
        _FOUND.reset(before)


def cached_per_log(compute: Callable[P, T]) -> Callable[P, T]:
    """Cache a function by the identity of its positional arguments within a :func:`log_cache` block.

    Callers must not modify the result.
    """

    @functools.wraps(compute)
    def shared(*args: P.args, **kwargs: P.kwargs) -> T:
        found = _FOUND.get()
        if found is None or kwargs:
            return compute(*args, **kwargs)
        key = (compute, *map(id, args))
        if key not in found:
            found[key] = args, compute(*args, **kwargs)  # keeps the arguments alive: ``id`` is reused after deletion
        answer: T = found[key][1]
        return answer

    return shared
