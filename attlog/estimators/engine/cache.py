"""Compiled kernels, kept between processes.

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
import platform
import stat
import sys
import tempfile
from collections.abc import Callable, Mapping
from pathlib import Path
from types import ModuleType
from typing import Any

import attlog

COMPILING = logging.getLogger("attlog.compiling")
HEADER = "import math\n\nimport numpy as np\n"


def jit_wanted() -> bool:
    """False where ATTLOG_NO_JIT asks for the plain Python twin."""
    return os.environ.get("ATTLOG_NO_JIT", "") in ("", "0")


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
    folder = _folder()
    text = f"{HEADER}from numba import njit\n\nKEEP = {folder is not None}\n\n{source}"
    if folder is None:
        COMPILING.info("compiling %s (at every start: no cache folder can be written)", what or name)
        namespace: dict[str, Any] = {}
        exec(compile(text, "<attlog kernel>", "exec"), namespace)
        return _function(namespace, name)
    stem = "k_" + hashlib.sha256(text.encode()).hexdigest()[:24]
    path = folder / f"{stem}.py"
    if not any(folder.glob(f"__pycache__/{stem}*.nbi")):
        COMPILING.info("compiling %s (once; kept in %s)", what or name, folder)
    try:
        return _function(vars(_load(path, text)), name)
    except Exception:
        # A damaged cache file fails at every start until it is removed; a real error fails again.
        for stale in folder.glob(f"**/{stem}*"):
            stale.unlink(missing_ok=True)
        return _function(vars(_load(path, text)), name)


def _function(namespace: Mapping[str, Any], name: str) -> Callable[..., Any]:
    """The function of that name in a module that was run."""
    function: Callable[..., Any] = namespace[name]
    return function


def _load(path: Path, text: str) -> ModuleType:
    """The module at ``path``, written first unless it is there already with this very text."""
    if not (path.is_file() and path.read_text(encoding="utf-8") == text):
        _write(path, text)
    spec = importlib.util.spec_from_file_location(f"attlog_kernel_{path.stem}", path)
    if spec is None or spec.loader is None:
        raise ImportError(f"{path} cannot be loaded")
    module = importlib.util.module_from_spec(spec)
    # numba imports the module of cached machine code by its name; unknown, every start compiles again.
    sys.modules[spec.name] = module
    spec.loader.exec_module(module)
    return module


def _write(path: Path, text: str) -> None:
    """Write atomically, with a fixed time stamp: numba compares it, and two writers must agree."""
    handle, temporary = tempfile.mkstemp(prefix=f".{path.stem}.", dir=path.parent)
    with os.fdopen(handle, "w", encoding="utf-8") as file:
        file.write(text)
    os.utime(temporary, (1, 1))
    os.replace(temporary, path)


@functools.lru_cache(maxsize=1)
def _folder() -> Path | None:
    """Where kernels are kept: the user's cache, a private temporary folder, or None."""
    import numba
    import platformdirs

    python = f"{sys.version_info.major}.{sys.version_info.minor}"
    version = f"attlog-{attlog.__version__}-python-{python}-numba-{numba.__version__}-{platform.machine()}"
    user = Path(platformdirs.user_cache_dir("attlog")) / "kernels" / version
    temporary = Path(tempfile.gettempdir()) / f"attlog-kernels-{_user()}" / version
    return next((f for f in (user, temporary) if _usable(f)), None)


def _usable(folder: Path) -> bool:
    """True if the folder can be made and written and nobody else can put code into it."""
    try:
        folder.mkdir(mode=0o700, parents=True, exist_ok=True)
        with tempfile.NamedTemporaryFile(dir=folder):
            pass
        return _private(folder) and _private(folder.parent)
    except OSError:
        return False


def _private(folder: Path) -> bool:
    """True if the folder belongs to the user and is not writable by others (POSIX; elsewhere True)."""
    if not hasattr(os, "getuid"):
        return True
    info = folder.stat()
    return info.st_uid == os.getuid() and not info.st_mode & (stat.S_IWGRP | stat.S_IWOTH)


def _user() -> str:
    return str(os.getuid()) if hasattr(os, "getuid") else os.environ.get("USERNAME", "user")
