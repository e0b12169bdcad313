"""Kernels that numba itself runs, kept between processes: plug-ins', and any that cannot do without numba.

A kernel is a generated module in the user's cache folder; numba keeps its machine
code beside it. The folder's name carries the versions of attlog, Python and numba,
the file's name the hash of its text, numba's own index the processor. Files are written whole or
not at all, so processes may compile at the same time. Without a writable cache
folder a private temporary one is used, and without that nothing is kept.
"""

from __future__ import annotations

import functools
import hashlib
import importlib.util
import logging
import os
import sys
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from types import ModuleType
from typing import Any

from attlog.kernels import folder

COMPILING = logging.getLogger("attlog.compiling")
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
    return _function(namespace, name)


@functools.lru_cache(maxsize=256)
def compiled(source: str, name: str, what: str = "") -> Callable[..., Any]:
    """The function ``name`` of source decorated for numba, from the cache where possible.

    ``what`` it is for people: the logger ``attlog.compiling`` tells that it is compiled, which takes seconds.
    """
    kept = folder.folder()
    text = f"{HEADER}from numba import njit\n\nKEEP = {kept is not None}\n\n{source}"
    if kept is None:
        COMPILING.info("compiling %s (at every start: no cache folder can be written)", what or name)
        namespace: dict[str, Any] = {}
        exec(compile(text, "<attlog kernel>", "exec"), namespace)
        return _function(namespace, name)
    stem = "k_" + hashlib.sha256(text.encode()).hexdigest()[:24]
    path = kept / f"{stem}.py"
    if not any(kept.glob(f"__pycache__/{stem}*.nbi")):
        COMPILING.info("compiling %s (once; kept in %s)", what or name, kept)
    try:
        return _function(vars(_load(path, text)), name)
    except Exception:
        # A damaged cache file fails at every start until it is removed; a real error fails again.
        for stale in kept.glob(f"**/{stem}*"):
            stale.unlink(missing_ok=True)
        return _function(vars(_load(path, text)), name)


def _function(namespace: Mapping[str, Any], name: str) -> Callable[..., Any]:
    """The function of that name in a module that was run."""
    function: Callable[..., Any] = namespace[name]
    return function


def _load(path: Path, text: str) -> ModuleType:
    """The module at ``path``, written first unless it is there already with this very text."""
    if not (path.is_file() and path.read_text(encoding="utf-8") == text):
        folder.write(path, text.encode())
    spec = importlib.util.spec_from_file_location(f"attlog_kernel_{path.stem}", path)
    if spec is None or spec.loader is None:
        raise ImportError(f"{path} cannot be loaded")
    module = importlib.util.module_from_spec(spec)
    # numba imports the module of cached machine code by its name; unknown, every start compiles again.
    sys.modules[spec.name] = module
    spec.loader.exec_module(module)
    return module
