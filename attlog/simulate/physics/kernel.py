"""The simulator's loops as kernels, compiled like the filters'."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from attlog.kernels import loops
from attlog.kernels.calling import bound
from attlog.kernels.kernel import Kernel
from attlog.kernels.loops import Scratch, function_of

__all__ = ["bound", "function_of", "kernel_of"]

SOURCES = ("simulate", "estimators", "kernels", "base/earth.py", "base/errors.py", "base/limits.py", "base/rotation.py")
"""Files below the package that say what a loop of the simulator does."""


def kernel_of(function: Callable[..., Any], signature: str, what: str, scratch: Scratch = ()) -> Kernel:
    """``function`` (arrays and numbers only, the last ``scratch`` of them its own) for a compiler."""
    return loops.kernel_of(function, signature, "simulate", what, SOURCES, scratch)
