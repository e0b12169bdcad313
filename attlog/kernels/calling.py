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


def load(kernel: Kernel, code: bytes, symbol: str) -> Call:
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
    return Call(kernel, ctypes.CFUNCTYPE(NUMBERS[kernel.result], *types)(address), engine)


class Call:
    """``function`` of addresses and lengths as one of arrays and numbers. TypeError where an argument does not fit.

    ``engine`` owns its code, which goes when nothing holds it any more.
    """

    def __init__(self, kernel: Kernel, function: Any, engine: object) -> None:
        self._kernel, self._function, self._engine = kernel, function, engine
        given = kernel.arguments[: len(kernel.arguments) - len(kernel.scratch)]
        self._arguments = [(a, np.dtype(a.kind) if a.dimensions else None) for a in given]
        self._scratch = _Scratch(kernel) if kernel.scratch else None

    def __call__(self, *values: Any) -> Any:
        plain = self._plain(values)
        return self._function(*plain) if self._scratch is None else self._function(*plain, *self._scratch.cleared())

    def bound(self, *values: Any) -> Callable[..., Any]:
        """The kernel with these arguments, whose arrays are looked at now and never again; ``...`` is a number to come.

        For what calls a kernel thousands of times a second with the same arrays, in one thread: an array costs 0.1 us
        a call instead of 1.
        """
        scratch, function = _Scratch(self._kernel), self._function
        plain = [*self._plain([0 if value is ... else value for value in values]), *scratch.places]
        typed = [kind(value) for kind, value in zip(function.argtypes, plain, strict=True)]
        before = np.cumsum([0, *(argument.dimensions for argument, _ in self._arguments)])
        coming = [typed[i + before[i]] for i, value in enumerate(values) if value is ...]
        arrays = scratch.arrays

        def call(*numbers: Any, held: object = (self, values)) -> Any:
            for cell, number in zip(coming, numbers, strict=True):
                cell.value = number
            for array in arrays:
                array.fill(0)
            return function(*typed)

        return call

    def _plain(self, values: Sequence[Any]) -> list[Any]:
        """Numbers as they are, an array as its address and lengths."""
        if len(values) != len(self._arguments):
            raise TypeError(f"{self._kernel.name} takes {len(self._arguments)} arguments, not {len(values)}")
        plain: list[Any] = []
        for i, ((argument, dtype), value) in enumerate(zip(self._arguments, values, strict=True)):
            plain += [value] if dtype is None else located(self._kernel.name, i, argument, dtype, value)
        return plain


def bound(function: Callable[..., Any], *values: Any) -> Callable[..., Any]:
    """``function`` with these arguments, ``...`` standing for numbers to come: :meth:`Call.bound` where it is one."""
    if isinstance(function, Call):
        return function.bound(*values)
    coming = [i for i, value in enumerate(values) if value is ...]

    def call(*numbers: Any) -> Any:
        filled = list(values)
        for at, number in zip(coming, numbers, strict=True):
            filled[at] = number
        return function(*filled)

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
