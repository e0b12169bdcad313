"""Calls object code with numpy arrays: what numba's own entry would check is checked here, then ctypes calls.

Code is loaded by llvmlite alone. It must be what was emitted: what is kept carries a checksum (:mod:`store`), and every
function of the C library that it calls is looked up first, since LLVM ends the process where one is missing.
"""

from __future__ import annotations

import ctypes
import threading
from collections.abc import Callable, Sequence
from functools import lru_cache
from typing import Any

import numpy as np

from attlog.kernels.kernel import Argument, Kernel, address

SMALL = 512
"""Arrays up to this many bytes are remembered with their address: loops that are called for each sample reuse them."""
CONTIGUOUS, WRITEABLE = 0x1 | 0x100, 0x400
"""numpy's flags C_CONTIGUOUS and ALIGNED, and WRITEABLE."""
NUMBERS: dict[str, Any] = {
    "b1": ctypes.c_int64,
    "i1": ctypes.c_int8,
    "i2": ctypes.c_int16,
    "i4": ctypes.c_int32,
    "i8": ctypes.c_int64,
    "u1": ctypes.c_uint8,
    "u2": ctypes.c_uint16,
    "u4": ctypes.c_uint32,
    "u8": ctypes.c_uint64,
    "f4": ctypes.c_float,
    "f8": ctypes.c_double,
    "void": None,
}


@lru_cache(maxsize=1)
def _target() -> Any:
    """LLVM's knowledge of this machine, set up once."""
    import llvmlite.binding as llvm

    llvm.initialize_native_target()
    llvm.initialize_native_asmprinter()
    target = llvm.Target.from_default_triple()
    llvm.create_mcjit_compiler(llvm.parse_assembly(""), target.create_target_machine(jit=True))  # opens the C library
    return target


def loadable(needs: Sequence[str]) -> bool:
    """Whether this process has the library's functions of these names."""
    import llvmlite.binding as llvm

    _target()
    return all(llvm.address_of_symbol(name) for name in needs)


def load(kernel: Kernel, code: bytes, symbol: str) -> Callable[..., Any]:
    """The function ``symbol`` of an object file as a kernel that is called with numpy arrays."""
    import llvmlite.binding as llvm

    engine = llvm.create_mcjit_compiler(llvm.parse_assembly(""), _target().create_target_machine(jit=True))
    engine.add_object_file(llvm.ObjectFileRef.from_data(code))
    engine.finalize_object()
    address = engine.get_function_address(symbol)
    types: list[Any] = []
    for argument in kernel.arguments:
        types += (
            [ctypes.c_void_p, *[ctypes.c_int64] * argument.dimensions]
            if argument.dimensions
            else [NUMBERS[argument.kind]]
        )
    return caller(kernel, ctypes.CFUNCTYPE(NUMBERS[kernel.result], *types)(address), engine)


def caller(kernel: Kernel, function: Callable[..., Any], engine: object) -> Callable[..., Any]:
    """``function`` of addresses and lengths as one of arrays and numbers. TypeError where an argument does not fit.

    ``engine`` owns its code, which goes when nothing holds it any more.
    """
    given = len(kernel.arguments) - len(kernel.scratch)
    known: list[tuple[Any, tuple[int, ...]]] = [(None, ())] * given
    checks = [(i, a, np.dtype(a.kind) if a.dimensions else None) for i, a in enumerate(kernel.arguments[:given])]
    room = _Scratch(kernel) if kernel.scratch else None

    def call(*values: Any, engine: object = engine) -> Any:
        if len(values) != given:
            raise TypeError(f"{kernel.name} takes {given} arguments, not {len(values)}")
        plain: list[Any] = []
        for i, argument, dtype in checks:
            value = values[i]
            if dtype is None:
                plain.append(value)
                continue
            before = known[i]
            if before[0] is value:
                plain += before[1]
                continue
            where = located(kernel.name, i, argument, dtype, value)
            plain += where
            if value.nbytes <= SMALL:
                known[i] = (value, where)
        return function(*plain) if room is None else function(*plain, *room.cleared())

    return call


class _Scratch(threading.local):
    """A kernel's scratch arrays, made once for each thread: while one is in a kernel, others run."""

    def __init__(self, kernel: Kernel) -> None:
        self.arrays = kernel.room()
        self.places = [n for array in self.arrays for n in (address(array), *array.shape)]

    def cleared(self) -> list[int]:
        """Addresses and lengths of the arrays, which are zero again."""
        for array in self.arrays:
            array.fill(0)
        return self.places


def located(name: str, number: int, argument: Argument, dtype: np.dtype[Any], value: Any) -> tuple[int, ...]:
    """Address and lengths of an array. TypeError unless it is just what the kernel was compiled for."""
    wanted = CONTIGUOUS if argument.readonly else CONTIGUOUS | WRITEABLE
    if (
        not isinstance(value, np.ndarray)
        or value.ndim != argument.dimensions
        or value.dtype != dtype
        or value.flags.num & wanted != wanted
    ):
        shown = f"{value.dtype} of shape {value.shape}" if isinstance(value, np.ndarray) else type(value).__name__
        raise TypeError(f"{name}: argument {number + 1} must be an array {argument.typed}, not {shown}")
    return (address(value), *value.shape)
