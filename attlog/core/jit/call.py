"""Calls object code with numpy arrays: what numba's own entry would check is checked here, then ctypes calls.

Code is loaded by llvmlite alone. It must be what was emitted: what is kept carries a checksum (:mod:`store`), and every
function of the C library that it calls is looked up first, since LLVM ends the process where one is missing.
"""

from __future__ import annotations

import ctypes
import functools
import hashlib
import importlib.util
import json
import logging
import os
import sys
import threading
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from functools import lru_cache
from pathlib import Path
from types import ModuleType
from typing import Any

import numpy as np

from attlog.core.jit import store
from attlog.core.jit.kernel import Argument, Kernel, address

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


# Kernels that numba itself runs, kept between processes: plug-ins', and any that cannot do without numba.
#
# A kernel is a generated module in the user's cache folder; numba keeps its machine
# code beside it. The folder's name carries the versions of attlog, Python and numba,
# the file's name the hash of its text, numba's own index the processor. Files are written whole or
# not at all, so processes may compile at the same time. numba runs what it finds there
# as it is, so the checksums of its files are kept too, and what does not match them is
# removed before numba sees it, and compiled anew. Without a writable cache
# folder a private temporary one is used, and without that nothing is kept.

COMPILING = logging.getLogger("attlog.compiling")
RUN = (".nbi", ".nbc", ".pyc")
"""Files whose content is run."""
PYCACHE, CHECKSUMS = "__pycache__", ".sha256.json"
HEADER = "import math\n\nimport numpy as np\n"


def jit_wanted() -> bool:
    """False where ATTLOG_NO_JIT asks for the plain Python twin."""
    return os.environ.get("ATTLOG_NO_JIT", "") in ("", "0")


@contextmanager
def plainly() -> Iterator[None]:
    """A block in which kernels are plain Python, which tells the line that raises; for processes of one thread."""
    before = os.environ.get("ATTLOG_NO_JIT")
    os.environ["ATTLOG_NO_JIT"] = "1"
    try:
        yield
    finally:
        os.environ.pop("ATTLOG_NO_JIT")
        if before is not None:
            os.environ["ATTLOG_NO_JIT"] = before


def plain(source: str, name: str, known: Mapping[str, Any]) -> Callable[..., Any]:
    """The function ``name`` of undecorated source, which uses the objects ``known``: the kernel's plain twin."""
    namespace: dict[str, Any] = dict(known)
    exec(compile(HEADER + source, "<attlog kernel>", "exec"), namespace)
    return _function_named(namespace, name)


@functools.lru_cache(maxsize=256)
def compiled(source: str, name: str, what: str = "") -> Callable[..., Any]:
    """The function ``name`` of source decorated for numba, from the cache where possible.

    ``what`` it is for people: the logger ``attlog.compiling`` tells that it is compiled, which takes seconds.
    """
    kept = store.folder()
    text = f"{HEADER}from numba import njit\n\nKEEP = {kept is not None}\n\n{source}"
    if kept is None:
        COMPILING.info("compiling %s (at every start: no cache folder can be written)", what or name)
        namespace: dict[str, Any] = {}
        exec(compile(text, "<attlog kernel>", "exec"), namespace)
        return _function_named(namespace, name)
    stem = "k_" + hashlib.sha256(text.encode()).hexdigest()[:24]
    path = kept / f"{stem}.py"
    drop_damaged(kept, stem)
    if not any(kept.glob(f"__pycache__/{stem}*.nbi")):
        COMPILING.info("compiling %s (once; kept in %s)", what or name, kept)
    try:
        function = _function_named(vars(_load(path, text)), name)
    except Exception:
        # A file that numba cannot use fails at every start until it is removed; a real error fails again.
        for stale in kept.glob(f"**/{stem}*"):
            stale.unlink(missing_ok=True)
        function = _function_named(vars(_load(path, text)), name)
    note_checksums(kept, stem)
    return function


def drop_damaged(kept: Path, stem: str) -> None:
    """Remove the files of a kernel that are not what was noted: machine code as a whole, Python's own one by one."""
    try:
        noted = json.loads((kept / f"{stem}{CHECKSUMS}").read_text(encoding="ascii"))
    except (OSError, ValueError):
        noted = {}
    noted = noted if isinstance(noted, dict) else {}
    found = checksums(kept, stem)
    damaged = [name for name, digest in found.items() if noted.get(name) != digest]
    if any(not name.endswith(".pyc") for name in damaged):
        damaged = list(found)
    for name in damaged:
        (kept / PYCACHE / name).unlink(missing_ok=True)


def note_checksums(kept: Path, stem: str) -> None:
    """Write down what the files of a kernel hold, where that is not written yet."""
    path, content = kept / f"{stem}{CHECKSUMS}", json.dumps(checksums(kept, stem), sort_keys=True).encode()
    try:
        if not (path.is_file() and path.read_bytes() == content):
            store.write(path, content)
    except OSError:  # not noted: compiled again at the next start
        return


def checksums(kept: Path, stem: str) -> dict[str, str]:
    """SHA-256 of each file that numba and Python keep of a kernel, by name; "" of one that cannot be read."""
    found = {}
    for path in kept.glob(f"{PYCACHE}/{stem}*"):
        if path.suffix not in RUN:  # what another process is writing
            continue
        try:
            found[path.name] = hashlib.sha256(path.read_bytes()).hexdigest()
        except OSError:
            found[path.name] = ""
    return found


def _function_named(namespace: Mapping[str, Any], name: str) -> Callable[..., Any]:
    """The function of that name in a module that was run."""
    function: Callable[..., Any] = namespace[name]
    return function


def _load(path: Path, text: str) -> ModuleType:
    """The module at ``path``, written first unless it is there already with this very text."""
    if not (path.is_file() and path.read_text(encoding="utf-8") == text):
        store.write(path, text.encode())
    spec = importlib.util.spec_from_file_location(f"attlog_kernel_{path.stem}", path)
    if spec is None or spec.loader is None:
        raise ImportError(f"{path} cannot be loaded")
    module = importlib.util.module_from_spec(spec)
    # numba imports the module of cached machine code by its name; unknown, every start compiles again.
    sys.modules[spec.name] = module
    spec.loader.exec_module(module)
    return module
