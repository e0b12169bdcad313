"""The compiled functions of the model, kept between processes like all kernels."""

from __future__ import annotations

import functools
import inspect
from collections.abc import Callable, Mapping
from typing import Any

from attlog.estimators.engine.loop import SOURCES
from attlog.estimators.filters.navigation import ahead, backward, chain, forward
from attlog.kernels import cache, generate
from attlog.kernels.kernel import Kernel
from attlog.kernels.obtain import obtained

VECTOR, MATRIX, INTS, SHORTS = "f8[::1]", "f8[:, ::1]", "i8[::1]", "i1[::1]"
FORWARD = {
    "first": "i8", "last": "i8", "dt": VECTOR, "gyr": MATRIX, "acc": MATRIX, "rest": SHORTS, "node_at": INTS,
    "node_event": INTS, "kind": INTS, "offset": VECTOR, "z": MATRIX, "f_mean": MATRIX, "w_mean": MATRIX,
    "sigma": MATRIX,
    "par": VECTOR, "along": MATRIX, "use_along": "b1", "x0": VECTOR, "q": VECTOR, "x": VECTOR, "P": VECTOR,
    "memory": VECTOR, "q_all": MATRIX, "bias": MATRIX, "variance": MATRIX, "ratio": MATRIX,
    "keep": "b1", "P_rows": VECTOR, "sums": MATRIX,
    "update_of": INTS, "K": VECTOR, "H": MATRIX, "H_at": "i1[:, ::1]", "wide_of": SHORTS, "s_of": VECTOR,
    "nu_of": VECTOR, "r_of": VECTOR, "group": SHORTS, "soft": SHORTS,
}  # fmt: skip
BACKWARD = {
    "nodes": "i8", "rest_of": SHORTS, "par": VECTOR, "P_rows": VECTOR, "sums": MATRIX, "update_of": INTS, "K": VECTOR,
    "H": MATRIX, "H_at": "i1[:, ::1]", "wide_of": SHORTS, "s_of": VECTOR, "nu_of": VECTOR, "lam": VECTOR, "Lam": VECTOR,
    "d": MATRIX, "spread": MATRIX, "score": VECTOR, "scores": MATRIX, "gone": "b1", "wanted": "b1",
}  # fmt: skip
AHEAD = {
    "then": INTS, "dt": VECTOR, "gyr": MATRIX, "rest": SHORTS, "lag": "f8", "q": MATRIX, "bias": MATRIX,
    "first_bias": VECTOR, "ring": MATRIX, "out": MATRIX,
}  # fmt: skip


def kernel_of(
    function: Callable[..., Any], types: Mapping[str, str], scratch: Mapping[str, Any], result: str
) -> Kernel:
    """A function with everything it uses, for a compiler."""
    name = function.__name__
    assert tuple(inspect.signature(function).parameters) == (*types, *scratch)
    return Kernel(
        f"navigation {name}",
        name,
        functools.partial(generate.with_helpers, {name: function}, jit=True),
        f"{result}({', '.join(types.values())})",
        f"the navigation filter, {name}",
        SOURCES,
        tuple(scratch.values()),
    )


FORWARD_KERNEL = kernel_of(forward.forward, FORWARD, forward.SCRATCH, "i8")
CHAIN_KERNEL = kernel_of(chain.chain, {"steps": MATRIX, "q": MATRIX}, {}, "void")
AHEAD_KERNEL = kernel_of(ahead.ahead, AHEAD, ahead.SCRATCH, "void")
BACKWARD_KERNEL = kernel_of(backward.backward, BACKWARD, backward.SCRATCH, "void")


@functools.lru_cache(maxsize=1)
def run_forward() -> Callable[..., Any]:
    """The compiled :func:`forward.forward`."""
    return _function(forward.forward, FORWARD_KERNEL)


@functools.lru_cache(maxsize=1)
def run_backward() -> Callable[..., Any]:
    """The compiled :func:`backward.backward`."""
    return _function(backward.backward, BACKWARD_KERNEL)


@functools.lru_cache(maxsize=1)
def run_chain() -> Callable[..., Any]:
    """The compiled :func:`chain.chain`."""
    return _function(chain.chain, CHAIN_KERNEL)


@functools.lru_cache(maxsize=1)
def run_ahead() -> Callable[..., Any]:
    """The compiled :func:`ahead.ahead`."""
    return _function(ahead.ahead, AHEAD_KERNEL)


def _function(function: Callable[..., Any], kernel: Kernel) -> Callable[..., Any]:
    """The kernel; plain Python where no compiler is wanted."""
    return obtained(kernel) if cache.jit_wanted() else lambda *values: function(*values, *kernel.room())
