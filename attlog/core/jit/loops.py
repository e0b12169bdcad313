"""A plain function over arrays and numbers that runs as machine code.

    @jit.loop("envelopes of long lines")
    def extremes(out: Out2, columns: F2, edges: I1) -> None:

The annotations are the signature: :class:`Cells` for arrays, ``int``, ``float``, ``bool``, and NamedTuples of these.
The function may use numbers, the modules math and numpy, and plain functions by name. It allocates nothing: who calls
it brings the arrays that it works with. The first call loads its object code (:mod:`attlog.core.jit.store`) or compiles
it (:mod:`attlog.core.jit.compile`). With ``ATTLOG_NO_JIT=1`` the same text runs as plain Python.
"""

from __future__ import annotations

import ctypes
import hashlib
import inspect
import linecache
import math
import os
import time
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from functools import cache, cached_property
from types import CodeType, FunctionType, ModuleType
from typing import Annotated, Any, Generic, NamedTuple, ParamSpec, TypeVar, get_type_hints

import numpy as np
from numpy.typing import NDArray

from attlog.core.errors import PluginError

P = ParamSpec("P")
R = TypeVar("R")

# Changes of how entries are compiled and called change this number, and with it every key.
FORMAT = 2
# An object loads its arrays fastest when each begins at a cache line of so many bytes.
CACHE_LINE = 64
# When this module was imported, which is before any loop is made.
STARTED = time.time()
# numpy's flags C_CONTIGUOUS and ALIGNED, and WRITEABLE.
CONTIGUOUS, WRITEABLE = 0x1 | 0x100, 0x400


class Cells(NamedTuple):
    """An array in an annotation: numpy's kind of number, dimensions, and whether the loop writes it."""

    kind: str
    dimensions: int
    written: bool = False


# Contiguous arrays that a loop reads, and those that it writes.
F1 = Annotated[NDArray[np.float64], Cells("f8", 1)]
F2 = Annotated[NDArray[np.float64], Cells("f8", 2)]
F3 = Annotated[NDArray[np.float64], Cells("f8", 3)]
I1 = Annotated[NDArray[np.int64], Cells("i8", 1)]
B1 = Annotated[NDArray[np.int8], Cells("i1", 1)]
Out1 = Annotated[NDArray[np.float64], Cells("f8", 1, True)]
Out2 = Annotated[NDArray[np.float64], Cells("f8", 2, True)]
Out3 = Annotated[NDArray[np.float64], Cells("f8", 3, True)]
IOut1 = Annotated[NDArray[np.int64], Cells("i8", 1, True)]
NUMBERS = {float: Cells("f8", 0), int: Cells("i8", 0), bool: Cells("b1", 0)}
CTYPES: dict[str, Any] = {"f8": ctypes.c_double, "i8": ctypes.c_int64, "b1": ctypes.c_int64}


class Group(NamedTuple):
    """A NamedTuple among the arguments, and what it holds."""

    made: type
    fields: tuple[Cells, ...]


Argument = Cells | Group


class Loop(Generic[P, R]):
    """A function that runs as machine code, ``what`` it is for people.

    ``given`` replaces globals of the function by name, such as a filter's step. ``keep`` False: its object code is not
    stored, nor looked for.
    """

    def __init__(self, function: Callable[P, R], what: str, given: Mapping[str, Any] | None = None) -> None:
        assert isinstance(function, FunctionType)
        self.function, self.what = (with_globals(function, given) if given else function), what
        self.name = f"{function.__module__}.{function.__qualname__}"
        self.__doc__ = function.__doc__
        self._compiled: Callable[..., R] | None = None

    def __call__(self, *values: P.args, **named: P.kwargs) -> R:
        """Run the loop; keyword arguments are not taken."""
        if not jit_wanted():
            with np.errstate(all="ignore"):  # machine code divides by zero in silence
                result: R = self.function(*values)
                return result
        return self.compiled()(*values)

    def compiled(self) -> Callable[..., R]:
        """Return the machine code as a function, loaded or compiled at the first call."""
        if self._compiled is None:
            from attlog.core.jit.compile import obtain

            self._compiled = obtain(self)
        return self._compiled

    def bound(self, *values: Any) -> Callable[..., R]:
        """Return the loop with these arguments, whose arrays are looked at once; ``...`` is a number still to come.

        For calls thousands of times a second in one thread: an array costs 0.1 us a call instead of 1.
        """
        made = self.compiled() if jit_wanted() else None
        if isinstance(made, Call):
            return made.bound(*values)
        coming = [i for i, value in enumerate(values) if value is ...]
        run: Callable[..., R] = self

        def call(*numbers: Any) -> R:
            filled = list(values)
            for at, number in zip(coming, numbers, strict=True):
                filled[at] = number
            return run(*filled)

        return call

    @cached_property
    def signature(self) -> tuple[tuple[Argument, ...], str]:
        """The arguments, and the kind of number that is returned or ``void``."""
        hints = inspect.get_annotations(self.function, eval_str=True)
        result = hints.pop("return", None)
        kind = "void" if result in (None, type(None)) else NUMBERS[result].kind
        return tuple(_argument(hint) for hint in hints.values()), kind

    @cached_property
    def functions(self) -> dict[str, FunctionType]:
        """The function and all that it uses, by name."""
        found: dict[str, FunctionType] = {}
        _reach(self.function, found)
        return dict(sorted(found.items()))

    @cached_property
    def text(self) -> str:
        """All functions, and the constants that they use."""
        parts = [str(FORMAT), str(self.signature)]
        for name, function in self.functions.items():
            parts += [
                name,
                _lines(function.__code__),
                *(f"{n} = {_value(x)}" for n, x in used_globals(function).items()),
            ]
        return "\n".join(parts)

    @cached_property
    def key(self) -> str:
        """The name of the object file: a hash of the text."""
        return hashlib.sha256(self.text.encode()).hexdigest()[:32]

    @property
    def edited(self) -> bool:
        """Return whether a file may have changed since this process imported it, so that the text is not what runs."""
        files = {function.__code__.co_filename for function in self.functions.values()}
        return any(os.path.exists(file) and os.stat(file).st_mtime >= STARTED - 2.0 for file in files)


def loop(what: str) -> Callable[[Callable[P, R]], Loop[P, R]]:
    """Make a function a :class:`Loop`."""
    return lambda function: Loop(function, what)


def jit_wanted() -> bool:
    """Return whether machine code is wanted: False with ``ATTLOG_NO_JIT=1``."""
    return os.environ.get("ATTLOG_NO_JIT", "") in ("", "0")


@contextmanager
def plain_python() -> Iterator[None]:
    """Run loops as plain Python inside the block, which reports the line that raises; for processes of one thread."""
    before = os.environ.get("ATTLOG_NO_JIT")
    os.environ["ATTLOG_NO_JIT"] = "1"
    try:
        yield
    finally:
        os.environ.pop("ATTLOG_NO_JIT")
        if before is not None:
            os.environ["ATTLOG_NO_JIT"] = before


def with_globals(function: Callable[..., Any], given: Mapping[str, Any]) -> FunctionType:
    """Return the function with some of its globals replaced."""
    assert isinstance(function, FunctionType)
    made = FunctionType(function.__code__, {**function.__globals__, **given}, function.__name__, function.__defaults__)
    made.__annotations__ = function.__annotations__
    made.__module__, made.__qualname__ = function.__module__, function.__qualname__
    return made


def with_constants(function: Callable[..., Any], name: str, given: Mapping[str, Any]) -> FunctionType:
    """Return the function as ``name``, with constants replaced in it and in all functions that it uses."""
    made: dict[FunctionType, FunctionType] = {}

    def changed(one: FunctionType) -> FunctionType:
        if one not in made:
            made[one] = with_globals(one, given)
            helpers = {n: x for n, x in used_globals(one).items() if isinstance(x, FunctionType)}
            made[one].__globals__.update({n: changed(x) for n, x in helpers.items()})
        return made[one]

    assert isinstance(function, FunctionType)
    found = changed(function)
    found.__name__ = found.__qualname__ = name
    return found


def used_globals(function: FunctionType) -> dict[str, Any]:
    """Return what a function looks up by name outside itself; loops as their functions."""
    if function.__code__.co_freevars:
        raise PluginError(f"{_where(function)} uses variables of an outer function")
    found = {n: function.__globals__[n] for n in _names(function.__code__) if n in function.__globals__}
    found = {name: value.function if isinstance(value, Loop) else value for name, value in found.items()}
    for name, value in found.items():
        if _value(value) == "":
            raise PluginError(
                f"{_where(function)} uses {name}, a {type(value).__name__}; "
                "use numbers, functions and the modules math and numpy only"
            )
    return found


def _value(value: Any) -> str:
    """Return what a global is, in text; empty for what a loop cannot use."""
    if isinstance(value, FunctionType):
        return f"{value.__module__}.{value.__qualname__}"
    if isinstance(value, type) and hasattr(value, "_fields"):
        return f"{value.__name__}{value._fields}"
    if isinstance(value, int | float | str | tuple):
        return repr(value)
    known = value if isinstance(value, ModuleType) else getattr(value, "__module__", None)
    return repr(value) if getattr(known, "__name__", known) in ("math", "numpy", "builtins") else ""


@cache
def _names(code: CodeType) -> list[str]:
    """Return the names that a function looks up outside itself, in alphabetical order."""
    nested = [c for c in code.co_consts if inspect.iscode(c)]
    return sorted(set(code.co_names).union(*map(_names, nested)))


def _reach(function: FunctionType, found: dict[str, FunctionType]) -> None:
    """Add a function and all that it uses to ``found``."""
    name = f"{function.__module__}.{function.__qualname__}"
    if name not in found:
        found[name] = function
        for used in used_globals(function).values():
            if isinstance(used, FunctionType):
                _reach(used, found)


def _where(function: FunctionType) -> str:
    code = function.__code__
    return f"{code.co_filename}, line {code.co_firstlineno}: {function.__name__}"


@cache
def _lines(code: CodeType) -> str:
    """Return the lines of a function: to the last that holds code, and on to the next that is not indented."""
    lines = linecache.getlines(code.co_filename)
    first = code.co_firstlineno - 1
    end = max(line for _, _, line in code.co_lines() if line is not None)
    while end < len(lines) and lines[end][:1] in (" ", "\n", ")"):
        end += 1
    return "".join(lines[first:end]).rstrip() or repr((code.co_code, code.co_consts))


@cache
def _argument(hint: Any) -> Argument:
    if isinstance(hint, type) and hasattr(hint, "_fields"):
        inner = get_type_hints(hint, include_extras=True)
        return Group(hint, tuple(_cells(h) for h in inner.values()))
    return _cells(hint)


def _cells(hint: Any) -> Cells:
    found = [x for x in getattr(hint, "__metadata__", ()) if isinstance(x, Cells)]
    return found[0] if found else NUMBERS[hint]


def aligned_zeros(*shape: int, kind: str = "f8") -> NDArray[Any]:
    """Return zeros that begin at a cache line: what a loop keeps writing must not straddle two."""
    size = math.prod(shape) * np.dtype(kind).itemsize
    block = np.zeros(size + CACHE_LINE, np.uint8)
    skip = -address(block) % CACHE_LINE
    return block[skip : skip + size].view(kind).reshape(shape)


def address(array: NDArray[Any]) -> int:
    """Return where a contiguous array's first byte lies."""
    if array.flags.writeable and array.nbytes:  # four times as fast; a loop in flight asks thousands of times a second
        return ctypes.addressof(ctypes.c_char.from_buffer(array.data))
    return int(array.__array_interface__["data"][0])


class Call:
    """Machine code as a function of arrays and numbers. TypeError where an argument does not fit.

    ``engine`` owns the code, which goes with the last reference.
    """

    def __init__(self, loop: Loop[Any, Any], place: int, engine: object) -> None:
        self.name, self._engine = loop.name, engine
        self._arguments, result = loop.signature
        types: list[Any] = []
        for cells in flat_arguments(self._arguments):
            types += (
                [ctypes.c_void_p, *[ctypes.c_int64] * cells.dimensions] if cells.dimensions else [CTYPES[cells.kind]]
            )
        self._function: Any = ctypes.CFUNCTYPE(CTYPES.get(result), *types)(place)

    def __call__(self, *values: Any) -> Any:
        return self._function(*self._plain(values))

    def bound(self, *values: Any) -> Callable[..., Any]:
        """See :meth:`Loop.bound`."""
        plain = self._plain([0 if value is ... else value for value in values])
        typed = [kind(value) for kind, value in zip(self._function.argtypes, plain, strict=True)]
        before = np.cumsum([0, *(_width(argument) for argument in self._arguments)])
        coming = [typed[before[i]] for i, value in enumerate(values) if value is ...]
        function = self._function

        def call(*numbers: Any, held: object = (self, values)) -> Any:
            for cell, number in zip(coming, numbers, strict=True):
                cell.value = number
            return function(*typed)

        return call

    def _plain(self, values: Any) -> list[Any]:
        """Return numbers as they are, and each array as its address and lengths."""
        if len(values) != len(self._arguments):
            raise TypeError(f"{self.name} takes {len(self._arguments)} arguments, not {len(values)}")
        pairs = zip(self._arguments, values, strict=True)
        return [x for argument, value in pairs for x in self._plain_one(argument, value)]

    def _plain_one(self, argument: Argument, value: Any) -> tuple[Any, ...]:
        if isinstance(argument, Group):
            if not isinstance(value, argument.made):
                raise TypeError(f"{self.name} takes a {argument.made.__name__}, not a {type(value).__name__}")
            pairs = zip(argument.fields, value, strict=True)  # type: ignore[call-overload]
            return tuple(x for cells, one in pairs for x in self._plain_one(cells, one))
        if argument.dimensions == 0:
            return (value,)
        wanted = CONTIGUOUS | WRITEABLE if argument.written else CONTIGUOUS
        if (
            not isinstance(value, np.ndarray)
            or value.ndim != argument.dimensions
            or value.dtype != argument.kind
            or value.flags.num & wanted != wanted
        ):
            shown = f"{value.dtype} of shape {value.shape}" if isinstance(value, np.ndarray) else type(value).__name__
            raise TypeError(f"{self.name} takes a contiguous array of {argument}, not {shown}")
        return (address(value), *value.shape)


def _width(argument: Argument) -> int:
    """Return how many numbers an argument takes in a call: an array its address and lengths."""
    return sum(1 + cells.dimensions for cells in flat_arguments((argument,)))


def flat_arguments(arguments: tuple[Argument, ...]) -> Iterator[Cells]:
    """Yield the arrays and numbers of all arguments."""
    for argument in arguments:
        yield from argument.fields if isinstance(argument, Group) else (argument,)


def last_before(t: NDArray[np.float64], x: float, i: int, last: int) -> int:
    """Return the highest number up to ``last`` whose time (n,) is not after ``x``, 0 if none; search from ``i`` on."""
    if x < t[i]:
        i = 0
    step = 1
    while i + step <= last and t[i + step] <= x:  # doubled steps, then bisection
        i += step
        step *= 2
    high = min(i + step, last + 1)
    while high - i > 1:
        middle = (i + high) // 2
        if t[middle] <= x:
            i = middle
        else:
            high = middle
    return i
