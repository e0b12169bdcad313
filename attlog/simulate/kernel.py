"""Compiles the simulator's loops by the engine's kernel cache; plain Python where ATTLOG_NO_JIT asks for it."""

from __future__ import annotations

import inspect
from collections.abc import Callable
from functools import lru_cache
from typing import Any

from attlog.estimators.engine import cache, generate


@lru_cache(maxsize=32)
def kernel(function: Callable[..., Any], signature: str, what: str) -> Callable[..., Any]:
    """``function`` (arrays and numbers only) compiled for numba's ``signature``; ``what`` it is for people."""
    if not cache.jit_wanted():
        return function
    arguments = ", ".join(inspect.signature(function).parameters)
    name = function.__name__
    helpers = generate.with_helpers({name: function}, jit=True)
    text = (
        f"{helpers}\n\n@njit({signature!r}, cache=KEEP, error_model='numpy', no_cfunc_wrapper=True)\n"
        f"def run_{name}({arguments}):\n    return {name}({arguments})\n"
    )
    return cache.compiled(text, f"run_{name}", what)
