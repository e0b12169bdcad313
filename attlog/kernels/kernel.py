"""What a kernel is: the text of plain functions, what it is called with, and which files say what it does."""

from __future__ import annotations

import ctypes
import math
import re
from collections.abc import Callable
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from attlog.kernels.generate import INLINE

LINE = 64
"""Bytes of a cache line."""
ENTRY_OPTIONS = "cache=KEEP, error_model='numpy', no_cfunc_wrapper=True"


def address(array: NDArray[Any]) -> int:
    """Where a contiguous array's first byte lies."""
    if array.flags.writeable and array.nbytes:  # four times as fast; a loop in flight asks thousands of times a second
        return ctypes.addressof(ctypes.c_char.from_buffer(array.data))
    return int(array.__array_interface__["data"][0])


@dataclass(frozen=True, slots=True)
class Argument:
    """An argument of a kernel: ``kind`` is numba's word for its numbers (f8, i8, u1, ...), ``dimensions`` 0 for one.

    Arrays are contiguous; the kernel may write those that are not ``readonly``.
    """

    kind: str
    dimensions: int = 0
    readonly: bool = False

    @property
    def typed(self) -> str:
        """The argument in a signature for numba's ``njit``."""
        if self.dimensions == 0:
            return self.kind
        if self.readonly:
            return f"Array({self.kind}, {self.dimensions}, 'C', readonly=True)"
        return f"{self.kind}[{':, ' * (self.dimensions - 1)}::1]"


@dataclass(frozen=True)
class Kernel:
    """One compiled function.

    ``name`` tells it from all others made from the same files; ``text()`` defines plain functions, the last of them
    ``entry``. ``signature``: its arguments and result as numba writes them, ``"i8(f8, f8[::1], u1[:, ::1])"``; an array
    in round brackets, ``(u1[::1])``, is only read. ``scratch``: kind and shape of the arrays of zeros that each call
    gets as the last arguments, since a kernel that allocates needs numba when it runs. ``sources``: files and folders
    below the package that the text depends on, none where it does not come from the package. ``what`` it is for people.
    """

    name: str
    entry: str
    text: Callable[[], str] = field(repr=False)
    signature: str
    what: str
    sources: tuple[str, ...] = ()
    scratch: tuple[tuple[str, tuple[int, ...]], ...] = ()

    @cached_property
    def arguments(self) -> tuple[Argument, ...]:
        """All arguments, the scratch arrays last. ValueError for a signature that is none."""
        inside = self.signature.partition("(")[2].rpartition(")")[0]
        found = re.findall(r"(\()?([a-z]\d)(\[[:, 1]+\])?", inside)
        given = [
            Argument(kind, shape.count("::1") + shape.count(":,"), bool(bracket)) for bracket, kind, shape in found
        ]
        if not inside or len(given) != len(re.split(r", (?=[(a-z])", inside)):
            raise ValueError(f"{self.signature} is no signature of a kernel")
        return (*given, *(Argument(kind, len(shape)) for kind, shape in self.scratch))

    @property
    def result(self) -> str:
        """What it returns: ``void`` or a number's kind."""
        return self.signature.partition("(")[0]

    def room(self) -> list[NDArray[Any]]:
        """Fresh scratch arrays, each at the begin of a cache line: what a loop keeps writing must not straddle two."""
        made = []
        for kind, shape in self.scratch:
            count = math.prod(shape)
            block = np.zeros(count * 8 + LINE, np.uint8)
            skip = -address(block) % LINE
            made.append(block[skip : skip + count * np.dtype(kind).itemsize].view(kind).reshape(shape))
        return made

    def parts(self) -> tuple[str, str]:
        """The text before the entry, and the entry's from its definition on, without a decorator."""
        before, found, body = self.text().rpartition(f"def {self.entry}(")
        return before.removesuffix(INLINE), found + body

    def decorated(self) -> str:
        """The text with numba's decorator on the entry, for the loaded compiler."""
        before, entry = self.parts()
        typed = f"{self.result}({', '.join(a.typed for a in self.arguments)})"
        return f"{before}@njit({typed!r}, {ENTRY_OPTIONS})\n{entry}"
