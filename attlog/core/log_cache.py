"""Cache results computed from a sensor or attitude within a ``with`` block.

Cached results of a long log take as much memory as the log; they are released before filters run.
"""

from __future__ import annotations

import functools
import hashlib
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from contextvars import ContextVar
from dataclasses import fields, is_dataclass
from typing import Any, ParamSpec, TypeVar

import numpy as np

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


def cached_by_content(compute: Callable[P, T]) -> Callable[P, T]:
    """Cache a function by the content of its positional arguments within a :func:`log_cache` block.

    Arguments are arrays, numbers and dataclasses of these. Callers must not modify the result.
    """

    @functools.wraps(compute)
    def shared(*args: P.args, **kwargs: P.kwargs) -> T:
        found = _FOUND.get()
        if found is None or kwargs:
            return compute(*args, **kwargs)
        digest = hashlib.blake2b()
        for value in args:
            _add_content(digest, value)
        key = (compute, digest.digest())
        if key not in found:
            found[key] = (), compute(*args, **kwargs)
        answer: T = found[key][1]
        return answer

    return shared


def _add_content(digest: Any, value: Any) -> None:
    if is_dataclass(value):
        for part in fields(value):
            _add_content(digest, getattr(value, part.name))
    elif isinstance(value, np.ndarray):
        digest.update(f"{value.dtype}{value.shape}".encode())
        digest.update(np.ascontiguousarray(value))
    else:
        digest.update(repr(value).encode() + b"\0")
