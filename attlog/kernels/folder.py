"""Where is machine code kept that this machine made? In a folder that nobody else can write."""

from __future__ import annotations

import functools
import os
import platform
import sys
import tempfile
from pathlib import Path

import attlog
from attlog.base.files.private_folder import private_folder, version_of


@functools.lru_cache(maxsize=1)
def folder() -> Path | None:
    """The user's cache, a private temporary folder, or None."""
    python = f"{sys.version_info.major}.{sys.version_info.minor}"
    version = f"attlog-{attlog.__version__}-python-{python}-numba-{version_of('numba')}-{platform.machine()}"
    return private_folder("kernels", version)


def write(path: Path, content: bytes) -> None:
    """Write atomically, with a fixed time stamp: numba compares it, and two writers must agree."""
    handle, temporary = tempfile.mkstemp(prefix=f".{path.stem}.", dir=path.parent)
    with os.fdopen(handle, "wb") as file:
        file.write(content)
    os.utime(temporary, (1, 1))
    os.replace(temporary, path)
