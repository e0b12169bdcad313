"""What a kernel is: the text of plain functions, what it is called with, and which files say what it does."""

from __future__ import annotations

import ast
import ctypes
import functools
import inspect
import math
import re
import textwrap
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from contextvars import ContextVar
from dataclasses import dataclass, field
from functools import cached_property
from types import BuiltinFunctionType, FunctionType, ModuleType
from typing import Any

import numpy as np
from numpy.typing import NDArray

from attlog.core.errors import PluginError

# The source of a kernel: an estimator's functions and everything they use, plus a loop.
#
# A generated module stands alone, so numba compiles and caches one function with one
# signature, and the same text without decorators is the plain Python twin.

INLINE = "@njit(forceinline=True, error_model='numpy', no_cpython_wrapper=True, no_cfunc_wrapper=True)\n"
"""Only the loop is called from Python: compiling entry points for its helpers costs a quarter of the time."""


def with_helpers(functions: Mapping[str, Callable[..., Any]], jit: bool, single: bool = False) -> str:
    """Source text that defines ``functions`` by name and, before them, all globals they need.

    ``jit`` puts numba's decorator on each; ``single`` writes float literals as float32.
    PluginError for a global that cannot be written down (an object, a closure).
    """
    parts: dict[str, str] = {}
    for name, function in functions.items():
        _collect(name, function, parts, jit, single)
    return "\n".join(parts.values())


def _collect(name: str, value: Any, parts: dict[str, str], jit: bool, single: bool) -> None:
    """Add what defines ``name`` to ``parts``, its own needs first."""
    value = getattr(value, "py_func", value)
    if isinstance(value, ModuleType):
        text = f"import {value.__name__} as {name}\n"
    elif isinstance(value, bool | int | str | tuple):
        text = f"{name} = {value!r}\n"
    elif isinstance(value, float):
        text = f"{name} = np.float32({value!r})\n" if single else f"{name} = {value!r}\n"
    elif isinstance(value, FunctionType):
        text = _function_text(name, value, parts, jit, single)
    elif isinstance(value, BuiltinFunctionType | type) and getattr(value, "__module__", None) in ("math", "numpy"):
        text = f"from {value.__module__} import {value.__name__} as {name}\n"
    else:
        raise PluginError(
            f"the kernel uses {name}, a {type(value).__name__}; "
            "use numbers, functions and the modules math and numpy only"
        )
    if parts.setdefault(name, text) != text:
        raise PluginError(f"two different things are called {name} in an estimator and its helpers; rename one")


def _function_text(name: str, function: FunctionType, parts: dict[str, str], jit: bool, single: bool) -> str:
    """The text of a function without its decorators; its globals go to ``parts`` first."""
    code = function.__code__
    if code.co_freevars:
        raise PluginError(f"{code.co_filename}, line {code.co_firstlineno}: {name} uses variables of an outer function")
    for used in sorted(_global_names(code)):
        if used in function.__globals__ and used != name:
            _collect(used, function.__globals__[used], parts, jit, single)
    tree = ast.parse(textwrap.dedent(inspect.getsource(function)))
    definition = tree.body[0]
    if not isinstance(definition, ast.FunctionDef):
        raise PluginError(f"{code.co_filename}, line {code.co_firstlineno}: {name} is not a plain function")
    definition.name = name
    definition.decorator_list = []
    definition.returns = None
    for argument in definition.args.args:
        argument.annotation = None
    if jit:
        whole = {n for n in _global_names(code) if type(function.__globals__.get(n)) is int}
        ours = {n for n in _global_names(code) if isinstance(function.__globals__.get(n), FunctionType)}
        definition = ast.fix_missing_locations(_PlainIntegers(whole - set(code.co_varnames), ours).visit(definition))
    if single:
        definition = ast.fix_missing_locations(_SinglePrecision().visit(definition))
    return (INLINE if jit else "") + ast.unparse(definition) + "\n"


def _global_names(code: Any) -> set[str]:
    """Names that the code and the code nested in it look up outside."""
    nested = [c for c in code.co_consts if inspect.iscode(c)]
    return set(code.co_names).union(*(_global_names(c) for c in nested))


class _SinglePrecision(ast.NodeTransformer):
    """Writes float literals as float32, so that no expression widens to float64."""

    def visit_Constant(self, node: ast.Constant) -> ast.AST:
        if not isinstance(node.value, float):
            return node
        return ast.Call(ast.Attribute(ast.Name("np", ast.Load()), "float32", ast.Load()), [node], [])


class _PlainIntegers(ast.NodeTransformer):
    """Hands whole numbers, written out or constants by name, to our own functions as integers of 64 bit.

    numba compiles a function anew for every whole number that it is called with as it stands.
    """

    def __init__(self, constants: set[str], functions: set[str]) -> None:
        self.constants = constants
        self.functions = functions

    def visit_Call(self, node: ast.Call) -> ast.AST:
        self.generic_visit(node)
        if isinstance(node.func, ast.Name) and node.func.id in self.functions:
            node.args = [self._plain(a) for a in node.args]
        return node

    def _plain(self, argument: ast.expr) -> ast.expr:
        written = isinstance(argument, ast.Constant) and type(argument.value) is int
        if not written and not (isinstance(argument, ast.Name) and argument.id in self.constants):
            return argument
        return ast.Call(ast.Attribute(ast.Name("np", ast.Load()), "int64", ast.Load()), [argument], [])


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


# Plain loops over arrays and numbers as kernels: compiled, or themselves where ATTLOG_NO_JIT asks for it.

Scratch = tuple[tuple[str, tuple[int, ...]], ...]


def kernel_of(
    function: Callable[..., Any], signature: str, room: str, what: str, sources: tuple[str, ...], scratch: Scratch = ()
) -> Kernel:
    """``function`` (arrays and numbers only, the last ``scratch`` of them its own) for a compiler.

    ``room``: what comes before its name where kernels are told apart; ``sources`` as of :class:`Kernel`.
    """
    name = function.__name__

    def text() -> str:

        return with_helpers({name: function}, jit=True)

    return Kernel(f"{room} {name}", name, text, signature, what, sources, scratch)


_BRIEFLY = ContextVar("briefly", default=False)


@contextmanager
def small_data() -> Iterator[None]:
    """A block that looks at little data: what numpy can do at once as well, no compiled loop is loaded for.

    To import llvmlite and to load a loop costs 60 ms and 50 MB, more than all the interpolation of a short log.
    """
    before = _BRIEFLY.set(True)
    try:
        yield
    finally:
        _BRIEFLY.reset(before)


def function_of(
    kernel: Kernel, plain: Callable[..., Any], at_once: Callable[..., Any] | None = None
) -> Callable[..., Any]:
    """The compiled kernel, or ``plain``, the function it was made of; ``briefly`` its twin ``at_once`` in numpy."""
    return at_once if at_once is not None and _BRIEFLY.get() else _loaded(kernel, plain)


@functools.lru_cache(maxsize=64)
def _loaded(kernel: Kernel, plain: Callable[..., Any]) -> Callable[..., Any]:
    from attlog.core.jit import call
    from attlog.core.jit.compile import obtained

    return obtained(kernel) if call.jit_wanted() else lambda *values: plain(*values, *kernel.room())
