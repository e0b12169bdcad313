"""The two compiled functions of the model, kept between processes like all kernels."""

from __future__ import annotations

import functools
import inspect
from collections.abc import Callable
from typing import Any

from attlog.estimators.engine import cache, generate
from attlog.estimators.filters.navigation import backward, forward

OPTIONS = "cache=KEEP, error_model='numpy', no_cfunc_wrapper=True, fastmath={'reassoc', 'contract', 'nsz'}"
VECTOR, MATRIX, CUBE, INTS, SHORTS = "f8[::1]", "f8[:, ::1]", "f8[:, :, ::1]", "i8[::1]", "i1[::1]"
FORWARD = {
    "first": "i8", "last": "i8", "dt": VECTOR, "gyr": MATRIX, "acc": MATRIX, "rest": SHORTS, "node_at": INTS,
    "node_event": INTS, "kind": INTS, "offset": VECTOR, "z": MATRIX, "f_mean": MATRIX, "w_mean": MATRIX,
    "sigma": MATRIX,
    "par": VECTOR, "along": MATRIX, "use_along": "b1", "x0": VECTOR, "q": VECTOR, "x": VECTOR, "P": MATRIX,
    "memory": VECTOR, "q_all": MATRIX, "bias": MATRIX, "variance": MATRIX, "ratio": MATRIX,
    "keep": "b1", "P_rows": CUBE, "sums": MATRIX,
    "update_of": INTS, "K": MATRIX, "H": MATRIX, "H_at": "i1[:, ::1]", "wide_of": SHORTS, "s_of": VECTOR,
    "nu_of": VECTOR, "r_of": VECTOR, "group": SHORTS, "soft": SHORTS,
}  # fmt: skip
BACKWARD = {
    "nodes": "i8", "rest_of": SHORTS, "par": VECTOR, "P_rows": CUBE, "sums": MATRIX, "update_of": INTS, "K": MATRIX,
    "H": MATRIX, "H_at": "i1[:, ::1]", "wide_of": SHORTS, "s_of": VECTOR, "nu_of": VECTOR, "lam": VECTOR, "Lam": MATRIX,
    "d": MATRIX, "spread": MATRIX, "score": VECTOR, "scores": MATRIX, "gone": "b1",
}  # fmt: skip


@functools.lru_cache(maxsize=1)
def run_forward() -> Callable[..., Any]:
    """The compiled :func:`forward.forward`."""
    return _compiled(forward.forward, "forward", FORWARD, "i8")


@functools.lru_cache(maxsize=1)
def run_backward() -> Callable[..., Any]:
    """The compiled :func:`backward.backward`."""
    return _compiled(backward.backward, "backward", BACKWARD, "void")


def _compiled(function: Callable[..., Any], name: str, types: dict[str, str], result: str) -> Callable[..., Any]:
    """A function with everything it uses as one module; plain Python where no compiler is wanted."""
    assert tuple(inspect.signature(function).parameters) == tuple(types)
    if not cache.jit_wanted():
        return function
    helpers = generate.with_helpers({name: function}, jit=True)
    arguments = ", ".join(types)
    text = f"{helpers}\n\n@njit('{result}({', '.join(types.values())})', {OPTIONS})\n"
    text += f"def run_{name}({arguments}):\n    return {name}({arguments})\n"
    return cache.compiled(text, f"run_{name}", f"the navigation filter, {name}")
