"""Kernels that numba itself runs, kept between processes: plug-ins', and any that cannot do without numba.

A kernel is a generated module in the user's cache folder; numba keeps its machine
code beside it. The folder's name carries the versions of attlog, Python and numba,
the file's name the hash of its text, numba's own index the processor. Files are written whole or
not at all, so processes may compile at the same time. numba runs what it finds there
as it is, so the checksums of its files are kept too, and what does not match them is
removed before numba sees it, and compiled anew. Without a writable cache
folder a private temporary one is used, and without that nothing is kept.
"""

from __future__ import annotations

import functools
import hashlib
import importlib.util
import json
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
    drop_damaged(kept, stem)
    if not any(kept.glob(f"__pycache__/{stem}*.nbi")):
        COMPILING.info("compiling %s (once; kept in %s)", what or name, kept)
    try:
        function = _function(vars(_load(path, text)), name)
    except Exception:
        # A file that numba cannot use fails at every start until it is removed; a real error fails again.
        for stale in kept.glob(f"**/{stem}*"):
            stale.unlink(missing_ok=True)
        function = _function(vars(_load(path, text)), name)
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
            folder.write(path, content)
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
